"""Rooms of the code depend on each other one way only; outside libraries stay in their room."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
INCLUDE_ROOTS = [ROOT / "src", ROOT / "fmu"]  # as CMakeLists.txt has them

# What a room may include besides itself: the arrows of src/README.md.
MAY_SEE = {
    "math": set(),
    "integrate": set(),
    "model": {"math"},
    "contact": {"math"},
    "tree": {"math", "model"},
    "loops": {"math", "model", "tree"},
    "mechanism": {"math", "model", "tree", "loops"},
    "docking": {"math", "model", "tree", "loops", "mechanism", "contact"},
    "sim": {"math", "model", "contact", "mechanism", "docking", "integrate"},
    "interface": {"math", "model", "mechanism", "docking", "sim"},
    "fmu": {"mechanism", "sim", "interface"},
    # Nobody sees these: other ways to compute the same, and two programs.
    "compare": {"math", "integrate", "sim"},
    "codegen": {"math", "model", "tree", "loops", "mechanism", "docking"},
    "tool": {"math", "docking", "sim", "interface"},
    "check": {"math", "model", "tree", "loops", "contact", "mechanism", "docking", "interface"},
    "python": {"docking", "sim", "interface", "fmu", "check"},
}
# Where an outside library may be included: library header prefix -> folders.
LIBRARIES = {
    "arkode/": {"src/integrate"},
    "cvode/": {"src/integrate"},
    "ida/": {"src/integrate"},
    "nvector/": {"src/integrate"},
    "sundials/": {"src/integrate"},
    "sunlinsol/": {"src/integrate"},
    "sunmatrix/": {"src/integrate"},
    "sunnonlinsol/": {"src/integrate"},
    "nlohmann/": {"src/model", "src/docking", "src/check", "src/tool", "tests/unit"},
    "nanobind/": {"src/python"},
    "fmi2": {"fmu", "tests/unit"},
}


def list_sources(*folders: str) -> list[Path]:
    found = (path for folder in folders for path in (ROOT / folder).rglob("*"))
    return sorted(path for path in found if path.suffix in {".cpp", ".hpp"})


def find_room(path: Path) -> str:
    """The folder below src/, or the top folder."""
    parts = path.relative_to(ROOT).parts
    return parts[1] if parts[0] == "src" else parts[0]


def find_includes(text: str) -> list[str]:
    return re.findall(r'^#include [<"]([^>"]+)[>"]', text, re.MULTILINE)


def resolve(path: Path, include: str) -> Path | None:
    """The file of the project that an include names, by whatever way; None for outside headers."""
    for root in [path.parent, *INCLUDE_ROOTS]:
        if (root / include).exists():
            return (root / include).resolve()
    return None


def find_hidden_edges(path: Path, text: str) -> list[str]:
    """What a source with this text includes and must not."""
    room, wrong = find_room(path), []
    for include in find_includes(text):
        other = resolve(path, include)
        if other is None:
            continue
        if other.suffix == ".cpp":
            wrong.append(f"{path.name} includes the source file {include}")
        elif find_room(other) not in MAY_SEE[room] | {room}:
            wrong.append(f"{path.name} includes {include}, which {room}/ must not see")
    return wrong


def test_every_room_is_in_the_list():
    assert {find_room(path) for path in list_sources("src", "fmu")} == set(MAY_SEE)


def test_there_is_no_circle():
    seen: set[str] = set()
    while left := MAY_SEE.keys() - seen:
        free = {room for room in left if MAY_SEE[room] <= seen}
        assert free, f"circle among {left}"
        seen |= free


@pytest.mark.parametrize("room", MAY_SEE)
def test_a_room_includes_only_what_lies_below_it(room):
    folder = ROOT / room if room == "fmu" else ROOT / "src" / room
    wrong = []
    for path in list_sources(str(folder)):
        wrong += find_hidden_edges(path, path.read_text())
    assert not wrong, wrong


# Edges that once were there and that no test saw.
@pytest.mark.parametrize(
    ("file", "include"),
    [
        ("src/tool/new.cpp", "instance.hpp"),  # fmu/ by its bare name
        ("src/codegen/new.cpp", "loops/loop_plan.cpp"),  # a source file
        ("src/model/new.hpp", "contact/contact_model.hpp"),
        ("src/sim/new.cpp", "interface/variables.hpp"),
        ("src/math/new.hpp", "../tree/tree.hpp"),  # a relative path
    ],
)
def test_a_hidden_edge_is_found(file, include):
    assert len(find_hidden_edges(ROOT / file, f'#include "{include}"\n')) == 1


def test_outside_libraries_are_included_in_their_room_only():
    for path in list_sources("src", "fmu", "tests/unit"):
        folder = str(path.parent.relative_to(ROOT))
        for include in find_includes(path.read_text()):
            for prefix, rooms in LIBRARIES.items():
                if include.startswith(prefix):
                    assert folder in rooms, f"{folder}/{path.name} includes {include}"


def test_every_source_file_explains_itself_in_its_first_lines():
    for path in list_sources("src", "fmu", "tests/unit"):
        assert path.read_text().startswith("//"), path
