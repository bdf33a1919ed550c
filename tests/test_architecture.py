"""Rooms of the code depend on each other one way only; outside libraries stay in their room.

The product in scripts/ does without tests/: it imports no module from there and adds no such folder
to the module path.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
INCLUDE_ROOTS = [ROOT / "src", ROOT / "fmu"]  # as CMakeLists.txt has them

# What a room may include as well as itself: the arrows of src/README.md.
MAY_SEE = {
    "math": set(),
    "integrate": {"math"},
    "model": {"math"},
    "contact": {"math"},
    "tree": {"math", "model"},
    "loops": {"math", "model", "tree"},
    "mechanism": {"math", "model", "tree", "loops"},
    "docking": {"math", "model", "tree", "loops", "mechanism", "contact"},
    "sim": {"math", "model", "contact", "mechanism", "docking", "integrate"},
    "interface": {"math", "model", "mechanism", "docking", "sim"},
    "fmu": {"mechanism", "sim", "interface"},
    "api": {"math", "docking", "sim", "interface", "fmu"},
    # No room sees these: other ways to compute the same, and two programs.
    "compare": {
        *("math", "model", "tree", "loops", "mechanism", "contact", "docking"),
        *("integrate", "sim", "interface"),
    },
    "codegen": {"math", "model", "tree", "loops", "mechanism", "docking"},
    "check": {"math", "model", "tree", "loops", "contact", "mechanism", "docking", "interface"},
    "python": {"docking", "sim", "interface", "check", "api"},
}
# Where an outside library may be included: library header prefix -> folders.
LIBRARIES = {
    "cvode/": {"src/integrate"},
    "ida/": {"src/compare"},
    "nvector/": {"src/integrate"},
    "sundials/": {"src/integrate"},
    "sunlinsol/": {"src/integrate"},
    "sunmatrix/": {"src/integrate", "src/compare"},
    "sunnonlinsol/": {"src/integrate"},
    "nlohmann/": {
        "src/model",
        "src/docking",
        "src/check",
        "src/compare",
        "src/python",
        "tests/unit",
    },
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


LONGEST = 700  # lines of a source file


def test_a_source_file_can_be_read_at_once():
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text().splitlines())
        for path in list_sources("src", "fmu")
    }
    assert {name for name, lines in lengths.items() if lines > LONGEST} == set()


# Edges that once were there and that no test saw.
@pytest.mark.parametrize(
    ("file", "include"),
    [
        ("src/check/new.cpp", "instance.hpp"),  # fmu/ by its bare name
        ("src/codegen/new.cpp", "loops/loop_plan.cpp"),  # a source file
        ("src/model/new.hpp", "contact/contact_model.hpp"),
        ("src/sim/new.cpp", "interface/variables.hpp"),
        ("src/math/new.hpp", "../tree/tree.hpp"),  # a relative path
    ],
)
def test_a_hidden_edge_is_found(file, include):
    assert len(find_hidden_edges(ROOT / file, f'#include "{include}"\n')) == 1


# ---------------------------------------------------------------- Python

TESTS = ROOT / "tests"
TEST_MODULES = {path.stem for path in TESTS.iterdir() if path.suffix == ".py" or path.is_dir()}


def list_scripts() -> list[Path]:
    return sorted((ROOT / "scripts").rglob("*.py"))


def find_test_edges(text: str) -> list[str]:
    """What a script with this text takes from tests/: modules, the module path, files."""
    wrong = []
    for node in ast.walk(ast.parse(text)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module or ""]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            # A folder of its own, as in ROOT / "tests"; program text that imports is text too.
            if node.value == "tests" or node.value.startswith("tests/"):
                wrong.append(f"line {node.lineno} names the folder {node.value}")
            imported = re.findall(r"^(?:from|import) (\w+)", node.value, re.MULTILINE)
            names = imported if "\n" in node.value else []
        wrong += [
            f"line {node.lineno} imports {name}"
            for name in names
            if name.split(".")[0] in TEST_MODULES | {"tests"}
        ]
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "sys.path":
            wrong.append(f"line {node.lineno} changes the module path")
    return wrong


@pytest.mark.parametrize("path", list_scripts(), ids=lambda path: str(path.relative_to(ROOT)))
def test_the_product_does_without_the_tests(path):
    wrong = find_test_edges(path.read_text(encoding="utf-8"))
    assert not wrong, wrong


# Edges that once were there.
@pytest.mark.parametrize(
    "text",
    [
        'import sys\nsys.path.append(str(paths.ROOT / "tests"))\n',
        "import random_mechanisms\n",
        "from tests.conftest import Runs\n",
        'CONTINUE = """\nimport pickle\nfrom coupling_host import Host\n"""\n',
        'text = (paths.ROOT / "tests" / "data" / "closures.json").read_text()\n',
    ],
)
def test_an_edge_to_the_tests_is_found(text):
    assert find_test_edges(text)


PACKAGE = ROOT / "scripts" / "dockloop"
FACE = {"__init__", "__main__"}  # above all rooms
# Imports of a higher floor that are meant: methods of a result draw it, for a notebook.
UPWARDS = {("result/recording.py", "report"), ("result/recording.py", "view")}
STUDIES = {path.parent.name for path in PACKAGE.glob("studies/*/__init__.py")}
BUILDS_UPON = {"maps": {"envelopes"}, "fits": {"measured"}}


def read_floors(text: str) -> dict[str, int]:
    """Rooms and their floors, as the docstring of the package lists them."""
    rows = re.findall(r"^ +(\d+)  (\w+) ", text, re.MULTILINE)
    return {room: int(floor) for floor, room in rows}


FLOORS = read_floors((PACKAGE / "__init__.py").read_text(encoding="utf-8"))


def find_imports(text: str) -> set[str]:
    """Names inside the package that a module with this text imports, at any depth."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{'.' * node.level}{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and "import_" in ast.unparse(node.func):
            names |= set(re.findall(r"dockloop\.[\w.]+", ast.unparse(node)))
    return {name for name in names if name.split(".")[0] in ("dockloop", "")}


def find_arrows(room: str, text: str) -> set[str]:
    """Rooms that a module of a room imports; else what it imports that is in no room."""
    arrows = set()
    for name in find_imports(text):
        to = name.split(".")[1] if name.startswith("dockloop.") else name
        arrows.add(to if to in FLOORS else name)
    return arrows - {room} - ({"dockloop._core"} if room == "native" else set())


def list_arrows() -> dict[tuple[str, str], set[str]]:
    """Arrows between rooms of Python, with the files that have them."""
    arrows: dict[tuple[str, str], set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        file = path.relative_to(PACKAGE)
        room = file.parts[0].removesuffix(".py")
        for to in find_arrows(room, path.read_text(encoding="utf-8")) if room not in FACE else ():
            arrows.setdefault((room, to), set()).add(str(file))
    return arrows


def test_every_room_of_python_has_a_floor():
    rooms = {
        path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        for path in list_scripts()
        if path.is_relative_to(PACKAGE)
    }
    assert rooms - FACE == set(FLOORS)


def test_python_imports_from_lower_floors():
    above = {
        (file, to)
        for (room, to), files in list_arrows().items()
        if FLOORS.get(to, 99) > FLOORS[room]
        for file in files
    }
    assert above == UPWARDS


def test_on_one_floor_imports_go_one_way():
    arrows = list_arrows()
    both = {(a, b) for a, b in arrows if FLOORS[a] == FLOORS.get(b) and (b, a) in arrows}
    assert not both
    assert sum(FLOORS[a] == FLOORS.get(b) for a, b in arrows) == 1  # so there is no longer circle


@pytest.mark.parametrize(
    ("room", "text", "found"),
    [
        ("base", "from dockloop.scene.resolve import FORMAT", {"scene"}),
        ("base", "def do():\n    from dockloop.scene import resolve", {"scene"}),
        ("base", "import dockloop.scene.resolve as scene", {"scene"}),
        ("fmu", "from dockloop import __version__", {"dockloop.__version__"}),
        ("fmu", "from dockloop import _core", {"dockloop._core"}),
        ("fmu", "from ..scene import resolve", {"..scene.resolve"}),
        ("runs", "import dockloop", {"dockloop"}),
        ("runs", "importlib.import_module('dockloop.view.page')", {"view"}),
        ("scene", "from dockloop.scene.find import find_scene", set()),
        ("native", "from dockloop import _core", set()),
    ],
)
def test_an_arrow_of_python_is_found(room, text, found):
    assert find_arrows(room, text) == found


@pytest.mark.parametrize("study", sorted(STUDIES))
def test_a_study_imports_no_other_study(study):
    for path in (PACKAGE / "studies" / study).glob("*.py"):
        names = find_imports(path.read_text(encoding="utf-8"))
        used = {name.split(".")[2] for name in names if name.startswith("dockloop.studies.")}
        assert used <= {study} | BUILDS_UPON.get(study, set()), path


def test_outside_libraries_are_included_in_their_room_only():
    for path in list_sources("src", "fmu", "tests/unit"):
        folder = str(path.parent.relative_to(ROOT))
        for include in find_includes(path.read_text()):
            for prefix, rooms in LIBRARIES.items():
                if include.startswith(prefix):
                    assert folder in rooms, f"{folder}/{path.name} includes {include}"


def test_an_fmu_carries_no_library_that_only_the_comparison_uses():
    collected = (ROOT / "scripts" / "lib" / "sources.cmake").read_text()
    parts = re.search(r"foreach\(part ([^)]*)\)", collected)[1].split()
    needed = {prefix.rstrip("/") for prefix, rooms in LIBRARIES.items() if rooms != {"src/compare"}}
    assert "cvode" in parts
    assert {part.partition("/")[0] for part in parts} <= needed


def find_named(text: str) -> list[str]:
    """Constants and types that a source file defines outside functions."""
    pattern = r"^(?:constexpr .*?\b(k[A-Z]\w*)\b|(?:struct|class|enum class) (\w+)\b(?! *;))"
    return [constant or kind for constant, kind in re.findall(pattern, text, re.MULTILINE)]


def test_source_files_of_the_library_share_no_name():
    """An FMU with sources compiles several files as one: unnamed namespaces then become one."""
    homes = {}
    for path in list_sources("src"):
        room = find_room(path)
        if path.suffix != ".cpp" or room == "compare" or "_avx" in path.name:
            continue
        for name in find_named(path.read_text()):
            other = homes.setdefault(name, path)
            assert other == path, f"{name} of {path} is defined in {other} too: rename one"
    assert len(homes) > 100


def test_a_shared_name_is_found():
    text = "namespace {\nconstexpr std::array<double, 2> kTime = {0, 1};\nstruct Row {\n};\n}"
    assert find_named(text) == ["kTime", "Row"]


def test_every_source_file_explains_itself_in_its_first_lines():
    for path in list_sources("src", "fmu", "tests/unit"):
        assert path.read_text().startswith("//"), path
