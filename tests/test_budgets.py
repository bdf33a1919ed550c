"""Work that the product does, watched: counts and sizes, which repeat, instead of seconds.

``data/budgets.json`` says what each figure is today and how far it may move, up or down. After a
change that is meant, ``.venv/bin/python tests/test_budgets.py`` writes the new figures (with the
argument ``long`` also those of instructions, in some minutes). A budget may have an aim and a day:
from that day on a figure above its aim fails.
"""

import datetime
import functools
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from dockloop.base import paths
from dockloop.fmu.build import build_fmu
from dockloop.fmu.host import run_fmu

FILE = Path(__file__).parent / "data" / "budgets.json"
BUDGETS = json.loads(FILE.read_text())["budgets"]
PACKAGE = paths.ROOT / "scripts" / "dockloop"
CODE = {".py", ".pyi", ".html", ".css", ".js", ".cpp", ".hpp"}
PAGE = paths.ROOT / "src" / "mechanism" / "README.md"  # has a table of the operations
COUNTED = {
    "hexapod_r2p1r3": "24 / 6",
    "hexapod_bench": "24 / 6",
    "crank_nested": "40 / 7, 12 loops",
    "planar_two_loop": "6 / 2",
}


@functools.cache
def run(scene: str, stop: float, step: float, *settings: str) -> dict[str, float]:
    """Return the last values of all outputs of a run."""
    with tempfile.TemporaryDirectory(prefix="dockloop-test-") as folder:
        fmu = build_fmu(scene, (), Path(folder) / "it.fmu", bare=True)
        recording = run_fmu(fmu, settings, stop, step)
    return {name: recording[name][-1] for name in recording.names}


@functools.cache
def recorded(program: str, test: str) -> dict[str, str]:
    """Return what a C++ test has recorded."""
    with tempfile.TemporaryDirectory(prefix="dockloop-test-") as folder:
        file = Path(folder) / "out.json"
        options = [f"--gtest_filter={test}", f"--gtest_output=json:{file}"]
        subprocess.run([paths.COMPILED / program, *options], capture_output=True, check=True)
        suites = json.loads(file.read_text())["testsuites"]
    return suites[0]["testsuite"][0] if suites else {}


def stripped_size(library: Path) -> int:
    """Return the size of a library without symbols [B]."""
    with tempfile.TemporaryDirectory(prefix="dockloop-test-") as folder:
        stripped = Path(folder) / "stripped"
        subprocess.run(["strip", "-o", stripped, library], check=True)
        return stripped.stat().st_size


def count_instructions(scene: str, accuracy: float, reads: str) -> float:
    """Return the instructions inside ``fmi2DoStep`` for an evaluation, or to read outputs."""
    with pytest.MonkeyPatch.context() as patched, tempfile.TemporaryDirectory() as folder:
        patched.syspath_prepend(str(Path(__file__).parent / "studies"))
        import instructions

        if reads:
            return instructions.count_reading(scene, accuracy, Path(folder), reads)
        evaluations, _, functions = instructions.count(scene, accuracy, Path(folder))
        return functions[instructions.ALL] / evaluations


def count_lines(*rooms: str) -> int:
    """Return the lines of rooms: code, templates, pages."""
    files = (path for room in rooms for path in (paths.ROOT / room).rglob("*"))
    own = (path for path in files if path.suffix in CODE and ".min." not in path.name)
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in own)


def measure(budget: dict) -> float | None:
    """Return the figure of today; None where it cannot be had (sanitizers, other C libraries)."""
    source = budget["source"]
    if "scene" in source:
        settings = source.get("settings", [])
        return run(source["scene"], source["stop"], source["step"], *settings)[source["output"]]
    if "accuracy" in source:
        return count_instructions(source["of"], source["accuracy"], source.get("reads", ""))
    if "room" in source:
        return count_lines(source["room"])
    if "rooms" in source:
        return count_lines(*source["rooms"])
    if "test" in source:
        value = recorded(source["program"], source["test"]).get(source["property"])
        return None if value is None else float(value)
    return stripped_size(paths.COMPILED / source["library"])


def is_long(budget: dict) -> bool:
    """Return whether a figure takes a minute: instructions, which callgrind counts."""
    return "accuracy" in budget["source"]


@pytest.mark.parametrize(
    "budget",
    [
        pytest.param(budget, id=budget["name"], marks=[pytest.mark.long] if is_long(budget) else [])
        for budget in BUDGETS
    ],
)
def test_a_figure_is_what_the_budget_says(budget):
    if "library" in budget["source"] and paths.COMPILED.name != "release":
        pytest.skip("sizes are those of a release build")
    if is_long(budget) and (paths.COMPILED.name != "release" or not shutil.which("valgrind")):
        pytest.skip("valgrind counts the instructions of a release build")
    figure = measure(budget)
    if figure is None:
        pytest.skip("not counted by this build")
    room = budget["tolerance"] * budget["figure"]
    assert abs(figure - budget["figure"]) <= room, (
        f"{budget['name']}: {figure:.0f} {budget['unit']}, budget {budget['figure']:.0f} within "
        f"{budget['tolerance']:.0%}. If that is meant, write it into tests/data/budgets.json: "
        "'.venv/bin/python tests/test_budgets.py'"
    )
    aim = budget.get("aim")
    if aim and datetime.date.today() >= datetime.date.fromisoformat(aim["day"]):
        assert figure <= aim["figure"], f"{budget['name']}: the aim of {aim['day']} is missed"


def test_every_room_has_a_budget():
    rooms = {file.parent for file in PACKAGE.glob("*/__init__.py")}
    rooms |= {file.parent for file in (paths.ROOT / "src").glob("*/*.cpp")}
    rooms |= {paths.ROOT / "fmu", paths.ROOT / "tests"}
    named = {paths.ROOT / b["source"]["room"] for b in BUDGETS if "room" in b["source"]}
    assert named == rooms


def make_table(budgets: list[dict]) -> str:
    """Return the rows of the page: operations of the accelerations, and with all reactions."""
    figures = {budget["name"]: f"{budget['figure']:,}".replace(",", " ") for budget in budgets}

    def count(mechanism: str, what: str) -> str:
        name = f"operations: {mechanism}, {what}"
        return f"{figures[name]}, {figures[f'{name}, zeros and ones taken out']} left"

    return "".join(
        f"| `{name}` ({velocities}) | {count(name, 'accelerations')}"
        f" | {count(name, 'with cut forces and base wrench')} |\n"
        for name, velocities in COUNTED.items()
    )


def test_the_page_has_the_counts_of_the_budgets():
    assert make_table(BUDGETS) in PAGE.read_text()


def update() -> None:
    """Write the figures of today into the file and the page."""
    document = json.loads(FILE.read_text())
    for budget in document["budgets"]:
        if is_long(budget) and "long" not in sys.argv[1:]:
            continue
        figure = measure(budget)
        if figure is None:
            print(f"{budget['name']}: not counted by this build, left as it is")
        elif round(figure) != budget["figure"]:
            print(f"{budget['name']}: {budget['figure']} -> {round(figure)} {budget['unit']}")
            budget["figure"] = round(figure)
    comment = json.dumps(document["comment"], indent=2).replace("\n", "\n  ")
    lines = ",\n    ".join(json.dumps(budget) for budget in document["budgets"])
    page = PAGE.read_text()
    PAGE.write_text(page.replace(make_table(BUDGETS), make_table(document["budgets"])))
    FILE.write_text(f'{{\n  "comment": {comment},\n  "budgets": [\n    {lines}\n  ]\n}}\n')


if __name__ == "__main__":
    update()
