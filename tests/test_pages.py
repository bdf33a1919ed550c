"""Pages: a link leads to a file and a heading that exist; limits are those of the code."""

import re

from test_words import ROOT, list_files

FENCES = re.compile(r"```.*?```", re.DOTALL)


def list_anchors(text):
    """Return the names by which links reach the headings of a page."""
    heads = re.findall(r"^#+ (.*)$", FENCES.sub("", text), flags=re.MULTILINE)
    bare = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head).strip().lower() for head in heads]
    return {re.sub(r"[^\w\- ]", "", head).replace(" ", "-") for head in bare}


def list_dead_links(page):
    """Return the links of a page that lead nowhere."""
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", FENCES.sub("", page.read_text(encoding="utf-8"))):
        name, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue  # of the web
        file = page.parent / name if name else page
        is_there = file.exists()
        if is_there and anchor and file.suffix == ".md":
            is_there = anchor in list_anchors(file.read_text(encoding="utf-8"))
        if not is_there:
            dead.append(link)
    return dead


def test_links_of_pages_lead_somewhere():
    pages = [ROOT / name for name in list_files() if name.endswith(".md")]
    assert len(pages) > 20
    dead = {str(page.relative_to(ROOT)): list_dead_links(page) for page in pages}
    assert not {name: links for name, links in dead.items() if links}


def test_dead_links_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A `word` here\n[a](other.md) [b](page.md#a-word-here) [c](#nothing) [d](https://x.y)\n"
        "```\n[e](gone.md)\n```\n"
    )
    assert list_dead_links(page) == ["other.md", "#nothing"]


def test_the_page_states_the_limits_of_the_code_for_a_step():
    code = (ROOT / "src" / "sim" / "step_loop.cpp").read_text(encoding="utf-8")
    page = " ".join((ROOT / "fmu" / "README.md").read_text(encoding="utf-8").split())
    base = re.search(r"#define DOCKLOOP_REFUSAL_TIME ([\d.]+)", code)[1]
    rate = float(re.search(r"kRefusalTimePerSecond = ([\d.]+)", code)[1])
    most = float(re.search(r"kLongestRefusal = ([\d.]+)", code)[1])
    steps = float(re.search(r"kLeastSteps = ([\d.]+)", code)[1])
    limits = f"{base} s, and {rate:g} s more per second of the step, but at most {most:g} s"
    assert limits in page
    assert f"may make {steps:g} inner steps in any case" in page
