"""One report, three writers: what a section has comes out in each, and nothing else.

1. The terminal has at most 100 columns, but a command stays one line; facts have no heads.
2. A bar in a cell does not end the cell of a Markdown table.
3. A page escapes what comes from files, holds its figures, and links the motion.
4. Sections without content are left out; the head stays.
"""

import html
import re
from pathlib import Path

import pytest

from dockloop.base.sections import FACTS, Section, write_html, write_markdown, write_text

LONG = "a load on the target | " * 8 + "end"
COMMAND = f"dockloop run own.toml --set {'name=1.25 ' * 20}".strip()
PIXEL = b"\x89PNG\r\n"


@pytest.fixture
def report(tmp_path):
    (tmp_path / "loads.png").write_bytes(PIXEL)
    return [
        Section("own: <a> & b", "Captured.", [FACTS, ("legs", LONG), ("", "and more")]),
        Section("Empty", table=[("load", "peak")]),
        Section("Loads", table=[("load", "peak", "known"), ("a|b", 12345.6, True), ("c", None, 3)]),
        Section("Worst", commands=[("case 3", COMMAND)], links={"case 3": Path("a b.html")}),
        Section("Figure", "Seen.", points=["one", "two"], figures=[tmp_path / "loads.png"]),
    ]


def test_the_terminal_has_aligned_lines_of_a_hundred_columns(report):
    lines = write_text(report).splitlines()
    assert lines[:2] == ["own: <a> & b", "  Captured."]
    assert lines[2].startswith("  legs  a load on the target | ")
    assert [line for line in lines if len(line) > 100] == [f"    {COMMAND}"]
    assert "        and more" in lines
    start = lines.index("Loads")
    assert lines[start + 1 : start + 4] == [
        "  load  peak   known",
        "  a|b   12346  yes",
        "  c            3",
    ]
    assert not {"Empty", "  what  is"} & set(lines)


def test_markdown_keeps_cells_apart(report):
    page = write_markdown(report)
    assert page.startswith(
        "# own: <a> & b\n\nCaptured.\n\n| what | is |\n|---|---|\n| legs | a load"
    )
    assert (
        "\n| load | peak | known |\n|---|---|---|\n| a\\|b | 12346 | yes |\n| c |  | 3 |\n" in page
    )
    assert f"\n## Worst\n\n```sh\n# case 3\n{COMMAND}\n```\n" in page
    assert page.endswith("## Figure\n\nSeen.\n\n* one\n* two\n\n![Figure](loads.png)\n")
    assert "Empty" not in page


def test_a_page_escapes_and_holds_all(report, tmp_path):
    write_html(tmp_path / "page.html", "dockloop own", report)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>\n<!-- made by dockloop own -->\n<html")
    assert "<h1>own: &lt;a&gt; &amp; b</h1>" in page
    assert re.findall(r"<h2>(.*?)</h2>", page) == ["Loads", "Worst", "Figure"]
    assert "<tr><td>a|b</td><td>12346</td><td>yes</td></tr>" in page
    assert 'src="data:image/png;base64,iVBORw0K"' in page
    assert f'href="a%20b.html">see the motion</a></div><pre>{COMMAND}</pre>' in html.unescape(page)
    assert "<li>one</li><li>two</li>" in page
