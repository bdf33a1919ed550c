"""The equation map of ``src/loops/README.md``: no tag dangles, in the table or in the code.

A tag is ``[Y2 (7)]``, ``[Y2 (1)-(4)]``, ``[Y2 list 3-7]`` and the like. Every tag in the code is
a row of the map; every row names a function and a test that exist; the published equations (1)
to (11) and the ten items of the list are all there.
"""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MAP = ROOT / "src" / "loops" / "README.md"
ROW = re.compile(r"^\| ((?:\(|list )[^|]+?) \| [^|]+ \| `([^:`]+): (\w+)` \| `([^`]+)` \|$")


def read_rows() -> dict[str, tuple[str, str, str]]:
    """Rows of the map: tag -> file, function, test."""
    rows = {}
    for line in MAP.read_text().splitlines():
        if found := ROW.match(line):
            tag, file, function, test = found.groups()
            assert tag not in rows, f"{tag} stands twice in the map"
            rows[tag] = (file, function, test)
    return rows


ROWS = read_rows()


def expand(text: str) -> list[str]:
    """Single tags of the inside of one bracket: "(1)-(4), (9a)" or "list 3-7"."""
    tags = []
    text = text.split(", differs", maxsplit=1)[0]
    if found := re.fullmatch(r"list (\d+)(?:-(\d+))?", text):
        first, last = int(found[1]), int(found[2] or found[1])
        return [f"list {i}" for i in range(first, last + 1)]
    for part in text.split(","):
        found = re.fullmatch(r"\s*\((\w+)\)(?:-\((\d+)\))?\s*", part)
        assert found, f"a tag that is not understood: [Y2 {text}]"
        if found[2]:
            tags += [f"({i})" for i in range(int(found[1]), int(found[2]) + 1)]
        else:
            tags.append(f"({found[1]})")
    return tags


def test_every_equation_and_every_step_of_the_paper_is_in_the_map():
    wanted = [f"({i})" for i in range(1, 12)] + [f"list {i}" for i in range(1, 11)]
    assert [tag for tag in wanted if tag not in ROWS] == []


@pytest.mark.parametrize("tag", ROWS)
def test_a_row_names_a_function_and_a_test_that_exist(tag):
    file, function, test = ROWS[tag]
    source = ROOT / "src" / file
    assert source.is_file(), file
    assert re.search(rf"\b{function}\b\s*(<[^>]*>)?\(", source.read_text()), f"{function} in {file}"
    if ".py" in test:
        path, name = test.split(": ")
        assert f"def {name}(" in (ROOT / path).read_text(), test
        return
    suite, name = test.split(".")
    tests = "\n".join(path.read_text() for path in (ROOT / "tests" / "unit").glob("*_test.cpp"))
    assert re.search(rf"TEST(_P|_F)?\({suite},\s*{name}\)", tests), test


def test_every_tag_in_the_code_is_in_the_map():
    used = 0
    for path in sorted((ROOT / "src").rglob("*")):
        if path.suffix not in {".cpp", ".hpp", ".md"}:
            continue
        text = re.sub(r"\s*\n\s*(///?)?\s*", " ", path.read_text())
        for found in re.findall(r"\[Y2 ((?:\(|list)[^\]]*)\]", text):
            used += 1
            missing = [tag for tag in expand(found) if tag not in ROWS]
            assert not missing, f"{path.relative_to(ROOT)}: [Y2 {found}] is not in the map"
    assert used > 20
