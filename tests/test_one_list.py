"""One list for each fact: does a file of the product type the members of a list once more?

The core has the lists: values of choices, loads, dissipated energies, units, names of FMI. A second
list is a run of text literals with most members of a list, or a text that numbers its members again
("1 regularised, 2 bristle"). In Python also a number where a choice is meant. `OWNERS` is where a
list is typed. `ALLOWED` and `NUMBERS` name the other places, each with its reason; a place that no
longer types the list must leave them.
"""

import ast
import functools
import itertools
import json
import math
import re
from pathlib import Path

import pytest

import dockloop
from dockloop.base import schema
from dockloop.native.core import list_loads, load_core
from dockloop.native.variables import TYPES
from dockloop.runs.docking import Docking
from dockloop.scene.mechanism import check_mechanism
from programs import call

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("src", "fmu", "scripts", "modelDescription/*.schema.json")
SUFFIXES = {"", ".py", ".cpp", ".hpp", ".json", ".js", ".html", ".cmake"}
NOT_LISTS = ("scripts/dockloop/view/web/three",)
GAP = 150  # characters between two members of one list
GROUPS = "outputs.groups"

TABLE = "src/interface/variables.cpp"
OWNERS = {
    "phase": "src/docking/phases.hpp",
    "outcome": "src/docking/phases.hpp",
    "capture.reason": "src/docking/phases.hpp",
    "latch.state": "src/docking/phases.hpp",
    "command": "src/docking/sequence.hpp",
    "hard_dock.command": "src/docking/hard_dock.hpp",
    "friction.model": "src/docking/scene.hpp",
    "coupling.mode": "src/docking/scene.hpp",
    "coupling.diagnosis": "src/sim/host_diagnosis.hpp",
    "model.level": "src/docking/scene.hpp",
    "model.flight": "src/sim/values.hpp",
    "solver.dae_form": "src/sim/values.hpp",
    "solver.method": "src/sim/solver_methods.cpp",
    **dict.fromkeys(("loads", "units", GROUPS), TABLE),
    "dissipated energies": "src/interface/variables_solver.cpp",
    **dict.fromkeys(("types", "causalities", "variabilities"), TABLE),
}
_SCHEMA = "values that a file may have, for editors of files; a test below compares the lists"
ALLOWED = {
    ("command", "modelDescription/mechanism.schema.json"): _SCHEMA,
    ("outcome", "modelDescription/mechanism.schema.json"): _SCHEMA,
    ("coupling.mode", "modelDescription/scene.schema.json"): _SCHEMA,
    ("friction.model", "modelDescription/mechanism.schema.json"): _SCHEMA,
    ("friction.model", "modelDescription/scene.schema.json"): _SCHEMA,
    ("model.level", "modelDescription/scene.schema.json"): _SCHEMA,
    ("solver.method", "modelDescription/scene.schema.json"): _SCHEMA,
    (GROUPS, "modelDescription/scene.schema.json"): _SCHEMA,
    ("causalities", "scripts/dockloop/scene/catalogue.py"): "the heading of each kind of name",
    ("dissipated energies", "scripts/dockloop/scene/patterns.py"): "parts of a file",
    ("capture.reason", "scripts/dockloop/result/capture.py"): "a sentence for each reason",
    ("types", "scripts/dockloop/fmu/host.py"): "the getter and the parser of each type",
    ("types", "scripts/dockloop/native/variables.py"): "the Python type and the words of each type",
    ("loads", "src/docking/scene_json.cpp"): "reads the rated loads into their members",
    ("friction.model", "src/contact/contact_model.cpp"): "lies below the list (src/README.md)",
    ("friction.model", "src/contact/laws.hpp"): "lies below the list (src/README.md)",
    ("friction.model", "src/sim/values.hpp"): "a comment on the member",
    ("model.level", "src/math/choice.hpp"): "the example in a comment",
    ("units", "src/interface/variable_table.hpp"): "each quantity names its unit",
    ("model.level", "src/sim/start_checks.cpp"): "the message names two levels",
    ("solver.method", "src/sim/start_checks.cpp"): "the message names two methods",
}
NUMBERS = {  # files in which Python has a table of a choice, and why
    "scripts/dockloop/result/capture.py": "a sentence for each reason",
}
LITERAL = re.compile(r'"((?:\\.|[^"\\\n])*)"|\'((?:\\.|[^\'\\\n])*)\'')


def read_choices():
    """Names of the values of every choice, in the order of their numbers."""
    return {
        variable: [name for _, name, _ in rows]
        for variable, rows in json.loads(load_core().choices()).items()
    }


def read_groups():
    """Output groups that the schema of scenes knows."""
    return schema.load_schema("scene")["properties"]["outputs"]["properties"]["groups"]["items"][
        "enum"
    ]


@pytest.fixture(scope="module")
def variables():
    return Docking("idss_25t_350t").variables


@pytest.fixture(scope="module")
def lists(variables):
    """Every list of the core by its name."""
    dissipated = "energy.dissipated_"
    rows = variables.values()
    return {
        **read_choices(),
        "loads": list(list_loads()),
        "dissipated energies": [
            name.removeprefix(dissipated) for name in variables if name.startswith(dissipated)
        ],
        "units": sorted({row.unit for row in rows if row.unit}),
        "types": sorted({row.type for row in rows}),
        "causalities": sorted({row.causality for row in rows}),
        "variabilities": sorted({row.variability for row in rows}),
        GROUPS: read_groups(),
    }


def count_most(members):
    """Number of members that make a second list."""
    return 2 if len(members) == 2 else max(3, -(-6 * len(members) // 10))


@functools.cache
def find_literals(text):
    """Begin, end and content of every literal."""
    return [(m.start(), m.end(), m.group(1) or m.group(2)) for m in LITERAL.finditer(text)]


def find_runs(text, members):
    """Lines at which `text` has literals with most of the members close together."""
    known, found, run = set(members), [], []
    hits = [literal for literal in find_literals(text) if literal[2] in known]
    for hit, following in zip(hits, [*hits[1:], (math.inf, 0, "")], strict=False):
        run.append(hit)
        if following[0] - hit[1] > GAP:
            if len({name for _, _, name in run}) >= count_most(members):
                found.append(text.count("\n", 0, run[0][0]) + 1)
            run = []
    return found


def find_numbered(text, members):
    """Lines at which `text` numbers at least two members again."""
    hits = sorted(
        match.start()
        for number, name in enumerate(members, 1)
        if name in text
        for match in re.finditer(rf"\b{number}\W{{1,3}}{re.escape(name)}\b", text)
    )
    pairs = itertools.pairwise(hits)
    return [text.count("\n", 0, a) + 1 for a, b in pairs if b - a < GAP]


def find_numbers(text, choices):
    """Lines at which Python text has a number, or a table by number or name, in place of a choice.

    Numbers: the value of a variable (`{"solver.method": 2}`, `values["phase"] == 5`), an argument
    (`levels=(1, 2)`), a constant with the name or a remark (`_REFERENCE = 4`). Tables: dictionaries
    with three keys of a choice.
    """
    words = {name.split(".")[-1].removeprefix("dae_") for name in choices}
    plurals = {f"{word}s" for word in words}
    remarks = plurals | {name for name in choices if "." in name}
    members = {name: {member.upper() for member in names} for name, names in choices.items()}
    lines = text.splitlines()

    def is_number(node):
        if isinstance(node, ast.Tuple | ast.List | ast.Set):
            return any(map(is_number, node.elts))
        return isinstance(node, ast.Constant) and type(node.value) is int and node.value > 0

    def is_choice(node):
        return isinstance(node, ast.Constant) and node.value in choices

    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values, strict=True)
            keys = [key.value for key in node.keys if isinstance(key, ast.Constant)]
            numbered = sum(type(key) is int and key > 0 for key in keys) > 2
            named = any(len(set(keys) & {*names}) > 2 for names in choices.values())
            is_found = numbered or named or any(is_choice(k) and is_number(v) for k, v in pairs)
        elif isinstance(node, ast.keyword):
            is_found = node.arg in words | plurals and is_number(node.value)
        elif isinstance(node, ast.Compare):
            is_read = isinstance(node.left, ast.Subscript) and is_choice(node.left.slice)
            is_found = is_read and any(map(is_number, node.comparators))
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            name, line = node.targets[0].id.strip("_"), lines[node.lineno - 1]
            remark = set(re.findall(r"[a-z_]+(?:[.][a-z_]+)*", line.partition("#")[2]))
            is_meant = any(name in names for names in members.values())
            is_found = is_number(node.value) and (is_meant or bool(remark & remarks))
        else:
            continue
        if is_found:
            found.append(node.lineno if hasattr(node, "lineno") else node.value.lineno)
    return sorted(set(found))


def read_sources():
    """Name and text of every file of the product that can type a list."""
    for name in call("git", "ls-files", *SOURCES, cwd=ROOT).split():
        path = ROOT / name
        if path.suffix in SUFFIXES and not name.startswith(NOT_LISTS) and path.is_file():
            yield name, path.read_text(encoding="utf-8")


def test_no_file_types_a_list_again(lists):
    places = {}
    for name, text in read_sources():
        for key, members in lists.items():
            lines = find_runs(text, members)
            if key in read_choices():
                lines += find_numbered(text, members)
            if lines and OWNERS[key] != name:
                places[key, name] = lines
    second = [f"{name}:{at[0]}: {key}" for (key, name), at in places.items()
              if (key, name) not in ALLOWED]  # fmt: skip
    assert not second, f"read these lists from the core instead: {second}"
    assert not [place for place in ALLOWED if place not in places], "no longer needed"


def test_python_names_a_choice_and_types_no_number():
    choices, places = read_choices(), []
    for name, text in read_sources():
        if name.startswith("scripts/dockloop/") and name.endswith(".py"):
            places += [(name, line) for line in find_numbers(text, choices)]
    found = {name for name, _ in places}
    assert not found - {*NUMBERS}, f"name the choice instead: {places}"
    assert not {*NUMBERS} - found, "no longer needed"


def test_every_list_is_typed_by_its_owner(lists):
    for key, members in lists.items():
        text = (ROOT / OWNERS[key]).read_text(encoding="utf-8")
        missing = [name for name in members if f'"{name}"' not in text]
        assert not missing, f"{key}: {missing} are not in {OWNERS[key]}"


def test_the_choices_of_python_are_those_of_the_table(variables):
    """Each Integer whose description numbers names is a choice with these names."""
    choices = read_choices()
    for row in variables.values():
        key = re.sub(r"\[\d+\]", "", row.name)
        named = re.findall(r"(?:: |\), )(\d+) ([\w ]+?)(?= \(|, \d|$)", row.description)
        if row.type == "Integer" and not row.name.endswith("mass_includes_mechanism"):
            for number, name in named:
                assert choices[key][int(number) - 1] == name, row


def test_schemas_list_what_the_core_lists(variables):
    scene, mechanism = schema.load_schema("scene"), schema.load_schema("mechanism")
    choices = read_choices()
    assert scene["properties"]["coupling"]["properties"]["mode"]["enum"] == choices["coupling.mode"]
    assert scene["properties"]["model"]["properties"]["level"]["enum"] == choices["model.level"]
    for section, member, variable in (
        ("solver", "method", "solver.method"),
        ("contact", "friction_model", "friction.model"),
    ):
        names = choices[variable]  # their numbers are allowed too
        listed = scene["properties"][section]["properties"][member]["enum"]
        assert listed == [*names, *range(1, len(names) + 1)]
    condition = mechanism["$defs"]["condition_members"]["properties"]
    assert condition["command"]["enum"] == choices["command"]
    outcomes = [name.replace(" ", "_").replace("-", "_") for name in choices["outcome"]]
    assert mechanism["$defs"]["outcome"]["enum"] == outcomes
    numbered = ", ".join(f"{i} {name}" for i, name in enumerate(choices["friction.model"], 1))
    member = mechanism["$defs"]["law_members"]["properties"]["friction_model"]
    assert member["enum"] == [1, 2]
    assert numbered in member["description"]
    limits = schema.known_members(mechanism["$defs"]["limits"], mechanism)
    assert set(limits) - {"comment"} == set(list_loads())
    assert set(TYPES) == {row.type for row in variables.values()}


@pytest.mark.parametrize("group", read_groups())
def test_every_output_group_of_the_schema_adds_outputs(group):
    motion = {"target.motion": "driven" if group == "coupling" else "free"}
    none, one = (
        Docking("idss_25t_350t", {"outputs.groups": groups, **motion}) for groups in ([], [group])
    )
    assert len(one.variables) > len(none.variables)


def test_a_check_names_the_cuts_as_the_file_does():
    for name in ("hexapod_r2p1r3", "crank_nested", "planar_two_loop"):
        path = ROOT / "tests" / "data" / f"{name}.json"
        document = json.loads(path.read_text(encoding="utf-8"))
        cuts = {loop["name"]: loop["cut"]["type"] for loop in document["mechanism"]["loops"]}
        report = check_mechanism(path)
        assert {loop["name"]: loop["cut"] for loop in report["loops"]} == cuts


def test_a_second_list_is_found():
    members = ["undecided", "captured", "partial capture", "rebound", "miss"]
    assert find_runs('x = ("captured",\n "rebound", "miss")', members) == [1]
    assert find_runs('if outcome in ("captured", "rebound"):', members) == []
    assert find_runs(f'"captured" {GAP * "-"} "rebound", "miss"', members) == []
    assert find_numbered("int outcome;\n// 1 undecided, 2 captured", members) == [2]
    assert find_numbered("in 5 s, 2 captured", members) == []


@pytest.mark.parametrize(
    "text",
    [
        "_REFERENCE = 4",
        "_EXPLICIT = 2  # solver.method",
        "_OF_OTHER_LEVELS = (2, 12)  # methods",
        "Block(levels=(1, 2), methods=methods)",
        "Block(forms=(1, 2, 3))",
        'starts = {"solver.method": 2}',
        'if values["capture.reason"] != 1: pass',
        "boxes = {1: (10, 60), 2: (165, 60), 3: (330, 60)}",
        '_NEXT_PHASES = {"approach": "2", "contact": "3, 8", "captured": "4"}',
        '_COLOURS = {"captured": "blue", "rebound": "red", "miss": "tab:purple"}',
    ],
)
def test_a_number_in_place_of_a_choice_is_found(text):
    assert find_numbers(text, read_choices()) == [1]


def test_what_is_no_choice_is_not_found():
    text = "_KEPT = 16\ncount(steps=(1, 10))\nx = {'solver.method': number, 1: 2}"
    assert find_numbers(text, read_choices()) == []


def test_the_version_is_the_same_everywhere():
    """CMake gives it to the core; four files type it, and one page names a wheel."""
    patterns = {
        "CMakeLists.txt": r"project\(dockloop VERSION ([\d.]+)",
        "pyproject.toml": r'^version = "([\d.]+)"',
        "scripts/dockloop/base/version.py": r'^__version__ = "([\d.]+)"',
        "src/interface/model_description.hpp": r'#define DOCKLOOP_VERSION "([\d.]+)"',
        "scripts/README.md": r"dockloop-([\d.]+)-cp",
    }
    found = {
        name: re.findall(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
        for name, pattern in patterns.items()
    }
    assert {name for name, own in found.items() if set(own) != {dockloop.__version__}} == set()
