"""The formats of scene, mechanism and sweep files: their page, their words, their defaults.

1. modelDescription/FORMATS.md is what the schemas say now;
2. every member has a meaning, every number of a model a unit; defaults and examples are valid;
3. a member that is left out has the default that the schema states, in Python and in the core.
"""

import copy
import json

import jsonschema
import pytest

from dockloop.base import schema
from dockloop.base.paths import MECHANISMS, SCENES
from dockloop.native.core import load_core, to_json
from dockloop.scene import formats
from dockloop.scene.resolve import resolve_scene

FORMATS = ("scene", "mechanism", "sweep")


def list_all():
    """(format, path, schema, is required) of every member but comments."""
    return [
        (name, path, node, is_required)
        for name in FORMATS
        for path, node, is_required in formats.list_members(name)
        if path.rsplit(".", 1)[-1] != "comment"
    ]


def is_number(node):
    """Is a member a number, or numbers?"""
    items = node.get("items", {})
    if "$ref" in items:
        items = schema.load_schema("mechanism")["$defs"].get(items["$ref"].rsplit("/", 1)[1], {})
        return is_number(items)
    return "number" in (node.get("type"), items.get("type"))


def test_the_page_is_what_the_schemas_say():
    assert formats.PAGE.read_text(encoding="utf-8") == formats.make_page(), (
        "run .venv/bin/python -m dockloop.scene.formats"
    )


def test_every_member_has_a_meaning_and_every_number_a_unit():
    members = list_all()
    assert len(members) > 150
    assert not [(name, path) for name, path, node, _ in members if not node.get("description")]
    models = [member for member in members if member[0] != "sweep"]
    assert not [path for _, path, node, _ in models if is_number(node) and "unit" not in node]


def test_a_member_without_effect_when_left_out_is_a_group_or_says_so():
    plain = [
        f"{name}: {path}"
        for name, path, node, is_required in list_all()
        if not is_required
        and not {"default", "otherwise"} & set(node)
        and node.get("type") != "array"
        and not formats._is_group(node)
        and "additionalProperties" not in node
    ]
    assert plain == ["scene: mechanism.set", "scene: sequence.set"]


@pytest.mark.parametrize("name", FORMATS)
def test_defaults_and_examples_are_valid(name):
    root = schema.load_schema(name)
    for path, node, _ in formats.list_members(name):
        for value in [*node.get("examples", []), *([node["default"]] if "default" in node else [])]:
            words = {key: part for key, part in node.items() if key != "properties"}
            jsonschema.Draft202012Validator({**words, "$defs": root["$defs"]}).validate(value)
            assert value is not None, path


# ---------------------------------------------------------------------------- defaults of the core


def with_defaults(document, node, root, *, written):
    """A document in which members at their defaults are written out, or left out."""
    result = dict(document)
    for member, child in schema.known_members(node, root, document).items():
        if not isinstance(child, dict) or member == "legs":  # a leg has the defaults of the file
            continue
        merged = formats._merge(child, root)
        if "default" in merged and written:
            result.setdefault(member, copy.deepcopy(merged["default"]))
        elif result.get(member) == merged.get("default", result):
            del result[member]
        elif isinstance(result.get(member), dict):
            result[member] = with_defaults(result[member], merged, root, written=written)
        elif isinstance(result.get(member), list) and "items" in merged:
            items = formats._merge(merged["items"], root)
            if formats._is_group(items):
                result[member] = [
                    with_defaults(entry, items, root, written=written) for entry in result[member]
                ]
    return result


def run_start(document):
    """Variables of a document, and its outputs a little after the first contact."""
    core = load_core().Docking(to_json(document), "test")
    rows = core.variables()
    outputs = [i for i, row in enumerate(rows) if row[3] != "fixed" and row[2] == "output"]
    values, _, _ = core.record([0.0, 0.6, 1.2], outputs)
    return [row[:-1] for row in rows], values.tolist()


def differs(document, change):
    """Does a changed document do something else?"""
    return run_start(document) != run_start(change)


@pytest.fixture(scope="module")
def document():
    """The default docking, 0.5 s before first contact."""
    scene = resolve_scene(SCENES / "idss_25t_350t.toml", ["initial.approach_time=0.5"])
    placed = load_core().place(to_json(scene), "test")
    for vehicle in ("chaser", "target"):
        scene[vehicle] |= placed[vehicle]
    scene["initial"]["at"] = "start"
    return scene


def of_core(document, *, written):
    """The document with defaults of scene and mechanism written out or left out."""
    scene, mechanism = schema.load_schema("scene"), schema.load_schema("mechanism")
    result = dict(document)
    for part in ("chaser", "target", "solver", "experiment", "coupling", "model"):
        node = formats._merge(scene["properties"][part], scene)
        result[part] = with_defaults(document.get(part, {}), node, scene, written=written)
    for part in ("coupling", "model"):
        if not result[part]:
            del result[part]
    node = formats._merge(mechanism, mechanism)
    result["mechanism"] = with_defaults(document["mechanism"], node, mechanism, written=written)
    return result


def test_the_core_has_the_defaults_of_the_schemas(document):
    left_out, written = (of_core(document, written=written) for written in (False, True))
    count = [len(json.dumps(part)) for part in (left_out, written)]
    assert count[1] - count[0] > 500  # characters: there is something to compare
    assert not differs(left_out, written)


CHANGED = {
    "solver.rtol": ("solver", "rtol", 1e-5),
    "contact.friction_coefficient": ("contact", "friction_coefficient", 0.3),
    "leg_defaults.preload": ("mechanism", "leg_defaults", "preload", 10.0),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_wrong_default_would_be_noticed(document, name):
    changed = copy.deepcopy(document)
    *path, member, value = CHANGED[name]
    node = changed
    for part in path:
        node = node[part]
    node[member] = value
    assert differs(document, changed)


def test_every_shipped_mechanism_has_the_same_check_with_defaults_written_out():
    root = schema.load_schema("mechanism")
    for file in sorted(MECHANISMS.glob("*.json")):
        plain = json.loads(file.read_text(encoding="utf-8"))
        node = formats._merge(root, root)
        both = [with_defaults(plain, node, root, written=written) for written in (False, True)]
        assert both[0] != both[1]
        reports = [load_core().check(json.dumps(document), "test") for document in both]
        assert reports[0] == reports[1], file.name
