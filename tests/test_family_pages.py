"""The pages of the families say what files and variables say, and their figures are there.

1. numbers and variables of a page are those of mechanism file and FMU;
2. loads and figures were made from the mechanism and scene of today;
3. a change of a number is noticed, and only what stands between marks is written.
"""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "studies"))

import family_pages as pages

RUN = f"run .venv/bin/python {pages.COMMAND}"
LARGEST = 150_000  # bytes of a figure


@pytest.fixture(scope="module", params=pages.FAMILIES)
def name(request):
    return request.param


def test_numbers_and_variables_are_those_of_today(name):
    assert pages.find_page(name).read_text(encoding="utf-8") == pages.make_page(name), RUN


def test_loads_are_those_of_the_present_files(name):
    text = pages.find_page(name).read_text(encoding="utf-8")
    assert re.findall(r"<!-- files (\w+) -->", text) == [pages.find_stamp(name)], RUN


def test_the_drawing_is_that_of_today(name):
    drawing = pages.FIGURES / f"{name}_drawing.svg"
    assert drawing.read_text(encoding="utf-8") == pages.draw_mechanism_of(name), RUN


def test_figures_are_small_and_shown(name):
    text = pages.find_page(name).read_text(encoding="utf-8")
    shown = re.findall(r"!\[.*?\]\(figures/(.*?)\)", text)
    assert shown == [f"{name}.png", f"{name}_drawing.svg", f"{name}_docking.png"]
    assert all(0 < (pages.FIGURES / file).stat().st_size < LARGEST for file in shown)


def test_a_changed_number_is_noticed(monkeypatch):
    document = pages.read_mechanism("hexapod")
    document["bodies"][0]["mass"] = 41.0
    monkeypatch.setattr(pages, "read_mechanism", lambda _: document)
    assert "mass 41 kg" in str(pages.list_numbers("hexapod"))


def test_every_number_has_a_unit_or_none():
    """A member of unknown path would have no unit; these have none."""
    rows = "\n".join(str(pages.list_numbers(name)) for name in pages.FAMILIES)
    bare = set(re.findall(r"(\w+) [\d.e+-]+(?=;| \|)", rows))
    assert bare == {
        "node_count", "petal_count", "regularisation", "restitution", "friction_model",
        "friction_coefficient", "count", "engagement",
    }  # fmt: skip


def test_typed_text_stays():
    page = "typed <!-- made: a -->\nold<!-- end --> and <!-- made: b -->\nkept<!-- end -->"
    filled = pages.fill(page, {"a": lambda: ["new"]})
    assert "typed" in filled
    assert "new" in filled
    assert "old" not in filled
    assert "kept" in filled
