"""Modules of the core depend on each other one way only; outside libraries stay in their room."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Which modules a module may include besides itself.
MAY_SEE = {
    "math": set(),
    "model": {"math", "contact"},  # a scene holds a contact model
    "tree": {"math", "model"},
    "loops": {"math", "model", "tree"},
    "forces": {"math", "model"},
    "contact": {"math"},
    "dynamics": {"math", "model", "tree", "loops", "forces", "contact"},
    "kernels": {"math", "model", "tree", "loops", "dynamics"},
    "integrate": set(),
    "sim": {"math", "model", "contact", "dynamics", "kernels", "integrate"},
    "truth": {"math", "integrate", "sim"},  # outside the core: it may know Impl of sim
    # a program of its own, which compiles the algorithms once more
    "generator": {"math", "model", "tree", "loops", "dynamics", "kernels", "sim"},
    "tool": {"math", "model", "forces", "contact", "dynamics", "sim"},
}
# Where an outside library may be included: library header prefix -> folders.
ROOMS = {
    "arkode/": {"src/integrate"},
    "cvode/": {"src/integrate"},
    "ida/": {"src/integrate"},
    "nvector/": {"src/integrate"},
    "sundials/": {"src/integrate"},
    "sunlinsol/": {"src/integrate"},
    "sunmatrix/": {"src/integrate"},
    "sunnonlinsol/": {"src/integrate"},
    "nlohmann/": {"src/model", "src/tool", "tests/unit"},
    "fmi2": {"fmu", "tests/unit"},
}
SOURCES = sorted(
    path
    for folder in ("src", "fmu", "tests/unit")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in {".cpp", ".hpp"}
)


def includes(path: Path) -> list[str]:
    return re.findall(r'^#include [<"]([^>"]+)[>"]', path.read_text(), re.MULTILINE)


@pytest.mark.parametrize("module", MAY_SEE)
def test_a_module_includes_only_what_lies_below_it(module):
    for path in (ROOT / "src" / module).iterdir():
        if path.suffix not in {".cpp", ".hpp"}:
            continue
        for include in includes(path):
            other = include.split("/")[0]
            if other in MAY_SEE and other != module:
                assert other in MAY_SEE[module], f"{path.name} includes {include}"


def test_outside_libraries_are_included_in_their_room_only():
    for path in SOURCES:
        folder = str(path.parent.relative_to(ROOT))
        for include in includes(path):
            for prefix, rooms in ROOMS.items():
                if include.startswith(prefix):
                    assert folder in rooms, f"{folder}/{path.name} includes {include}"


def test_every_source_file_explains_itself_in_its_first_lines():
    for path in SOURCES:
        assert path.read_text().startswith("//"), path
