"""From a scene file to the one document that an FMU carries (``resources/model.json``).

A scene (TOML) says which vehicles, which mechanism, how they meet, and what to export. Resolving it

1. finds the scene and its mechanism (next to the scene first, then among the shipped ones),
2. applies ``--scene KEY=VALUE`` overrides and ``[mechanism.set]``,
3. checks both against their schemas,
4. converts what people write (degrees, magnitudes with directions) to SI vectors.

Frames: A is the active interface on the chaser, P the passive one on the target, both with +x along
the docking axis into the target. All relative quantities are P with respect to A, axes of A.
"""

import atexit
import copy
import hashlib
import itertools
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from dockloop import schema
from dockloop.core import number_choice
from dockloop.errors import UsageError, did_you_mean, find_reason
from dockloop.number import as_number, read_number, read_whole, to_plain
from dockloop.outputs import scratch
from dockloop.paths import MECHANISMS, SCENES, check_file, is_file, name_kind, read_text, shown
from dockloop.variables import NAMED_NUMBERS, match_names, say_matches

FORMAT = "dockloop-scene/1"
_PATHS = ("mechanism.set.", "sequence.set.")  # begin keys that go on as paths into the mechanism
_DISTURBANCE = "disturbance."  # begins keys of a disturbance, by its number from 1
# Begin keys that no list of keys of a scene holds.
OPEN_KEYS = (*_PATHS, _DISTURBANCE, "initial.joints.")
_KEPT = 16  # mechanisms, with what is set in them, that a reader of a scene remembers
_BASE = ("position", "attitude")  # of the base of the mechanism in A: base_position, ...

_NUMBERED = {  # choices that a scene names and its document numbers: the variable with the names
    ("solver", "method"): "solver.method",
    ("contact", "friction_model"): "friction.model",
}


def find_shipped(reference: str, kind: str, folder: Path) -> Path:
    """Find a scene or a sweep by name (among the shipped ones) or by path. Raises UsageError.

    Args:
        reference: the name, or the path, which ends in ``.toml``.
        kind: ``scene`` or ``sweep``.
        folder: of the shipped ones.
    """
    path = Path(reference)
    if path.suffix != ".toml":
        shipped = folder / f"{reference}.toml"
        if not is_file(shipped):
            names = [file.stem for file in sorted(folder.glob("*.toml"))]
            if is_file(path):
                raise UsageError(f"{reference}: is no {kind}: {kind} files end in .toml")
            near = name_kind(reference) or did_you_mean(reference, names)
            raise UsageError(
                f"no {kind} '{reference}' in {shown(folder)}{near}:"
                f" there are {', '.join(names)}; a {kind} of your own is given by its path,"
                " ending in .toml"
            )
        path = shipped
    check_file(path, f"{kind} file")
    return path


def find_scene(reference: str) -> Path:
    """Find a scene by name (among the shipped ones) or by path.

    Raises:
        UsageError: there is none, or its name cannot name an FMU.
    """
    path = find_shipped(reference, "scene", SCENES)
    if not re.fullmatch(r"[A-Za-z_]\w*", path.stem, re.ASCII):
        raise UsageError(
            f"{shown(path)}: the file name becomes the name of the FMU, so it must consist of"
            " letters, digits and _ and not begin with a digit"
        )
    return path


def write_scene(members: Mapping[str, Any]) -> Path:
    """Write the members of a scene file into a folder of this process; returns the file.

    Args:
        members: as in the file. ``mechanism`` may hold the members of a mechanism file, as well as
            ``set``, ``base_position`` and ``base_attitude`` of the section.

    Raises:
        UsageError: a member is neither number, text, list nor group.
        DockloopError: there is no folder for it.
    """
    scene = without_nulls(dict(members))
    named, files = scene.get("mechanism"), {}
    section = ("name", "set", *(f"base_{m}" for m in _BASE))
    if isinstance(named, dict) and set(named) - set(section):
        own = {m: named[m] for m in section[1:] if m in named}
        mechanism = get_mechanism({key: value for key, value in named.items() if key not in own})
        name = str(mechanism.get("name", "mechanism"))
        scene["mechanism"] = {"name": name, **own}
        files[f"{name}.json"] = json.dumps(mechanism, default=_to_plain)
    files["scene.toml"] = "".join(f"{to_text(k)} = {to_text(v)}\n" for k, v in scene.items())
    digest = hashlib.sha256(json.dumps(files).encode()).hexdigest()[:16]
    folder = _make_own_folder() / digest
    folder.mkdir(exist_ok=True)
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8")
    return folder / "scene.toml"


def _to_plain(value: Any) -> Any:
    """Return an array or a number of numpy as JSON has it."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise UsageError(f"a mechanism holds {value!r}: must be numbers, texts, lists and groups")


@cache
def _make_own_folder() -> Path:
    """Return the folder of scenes that are no files; it is removed when the process ends."""
    stack = ExitStack()
    atexit.register(stack.close)
    return stack.enter_context(scratch())


def resolve_scene(path: Path, overrides: list[str] | tuple[str, ...] = ()) -> dict:
    """Read a scene and return the resolved document.

    Args:
        path: the scene file.
        overrides: ``KEY=VALUE`` texts, as given to ``--scene``.

    Returns:
        The document "dockloop-scene/1"; start states are still those of the file.

    Raises:
        UsageError: naming file, member, value and limit.
    """
    return SceneReader(path).resolve(overrides)


class SceneReader:
    """Resolves one scene with many overrides: files are read once, mechanisms checked once."""

    def __init__(self, path: Path) -> None:
        """Read the scene. Raises UsageError."""
        self._path = path
        self._scene, _ = read_toml(path)
        if "vary" in self._scene:
            raise UsageError(f"{shown(path)}: is a sweep, no scene: 'dockloop sweep' runs it")
        self._checker, checker = schema.Checker("scene"), schema.Checker("mechanism")
        self._mechanism = lru_cache(_KEPT)(
            lambda text: load_mechanism(json.loads(text), path, checker)
        )

    def list_keys(self) -> dict[str, dict]:
        """Return the keys that a name with ``*`` can mean, as `list_keys`."""
        return list_keys(self._scene)

    def resolve(self, overrides: list[str] | tuple[str, ...] = ()) -> dict:
        """Do the work of `resolve_scene`; documents of equal mechanisms share them."""
        scene = without_nulls(self._scene)  # a copy: TOML has no nulls
        changes: dict[tuple[str | int, ...], Any] = {}
        for text in overrides:
            changes |= apply_override(scene, text)
        if found := self._checker.find_violation(scene, changes):
            raise UsageError(f"{shown(self._path)}: {found.sentence}")
        _number_choices(scene)
        # A scene without mechanism is a vehicle by itself (or two that pass through each other).
        named = scene.get("mechanism")
        text = json.dumps(named and named | {"sequence": scene.get("sequence", {})}, default=str)
        return _resolve(scene, self._mechanism(text) if named else {"name": "none"}, self._path)


def _number_choices(scene: dict) -> None:
    """Replace names of choices by their numbers; the schema has checked the names."""
    for (section, member), variable in _NUMBERED.items():
        name = scene.get(section, {}).get(member)
        if isinstance(name, str):
            scene[section][member] = number_choice(variable, name)
    accuracy = scene.get("solver", {}).get("accuracy")
    if isinstance(accuracy, str):
        scene["solver"]["accuracy"] = NAMED_NUMBERS["accuracy"][accuracy]


def _resolve(scene: dict, mechanism: dict, path: Path) -> dict:
    """Put the document together from a scene that its schema accepts, and its mechanism."""
    named = scene.get("mechanism", {})
    law = scene.get("contact", {})
    if law and mechanism.get("contact", {}).get("type") not in ("guide_ring", "surfaces"):
        raise UsageError(
            f"{shown(path)}: [contact] overrides the law of surfaces or of a guide ring,"
            + (f" but the mechanism '{named['name']}' has none" if named else " but there is none")
        )
    document = {
        "format": FORMAT,
        "name": path.stem,
        "title": scene.get("title", path.stem),
        "chaser": {**_defaults("target"), **_defaults("chaser"), **scene["chaser"]},
        "mechanism": mechanism,
        "contact": law,
        "initial": _initial(scene, path),
        "solver": _defaults("solver") | scene.get("solver", {}),
        "experiment": _defaults("experiment") | scene.get("experiment", {}),
        "outputs": _defaults("outputs") | scene.get("outputs", {}),
    }
    for key in ("coupling", "disturbance", "model", "phases"):
        if key in scene:
            document[key] = scene[key]
    if "target" in scene:
        document["target"] = _defaults("target") | scene["target"]
    if base := {m: named[f"base_{m}"] for m in _BASE if f"base_{m}" in named}:
        document["base"] = base
    experiment = document["experiment"]
    if experiment["stop"] <= experiment["start"]:
        raise UsageError(
            f"{shown(path)}: experiment.stop is {experiment['stop']}:"
            f" must be greater than experiment.start = {experiment['start']}"
        )
    return document


def load_mechanism(
    reference: dict, scene_path: Path, checker: schema.Checker | None = None
) -> dict:
    """Find, read, modify and check the mechanism that a scene names.

    Args:
        reference: section ``[mechanism]`` of the scene, of which ``name`` and ``set`` are read;
            with ``sequence``, the section of this name.
        scene_path: the scene file; a mechanism next to it wins over a shipped one.
        checker: of mechanisms of this scene.

    Returns:
        The mechanism document, angles in rad, comments removed.
    """
    name = reference["name"]
    path = find_mechanism(name, scene_path)
    mechanism = read_mechanism(path)
    where = f"{shown(scene_path)}: mechanism.set"
    changed = _expand(mechanism, reference.get("set", {}), where)
    places = {
        f"mechanism.set.{dotted}": _set_member(mechanism, dotted, value, path, f"{where}.{dotted}")
        for dotted, value in changed.items()
    }
    sequence = reference.get("sequence", {})
    if isinstance(mechanism.get("sequence"), dict) and "set" in sequence:
        steps = mechanism["sequence"].get("steps", [])
        where = f"{shown(scene_path)}: sequence.set"
        sequence = {**sequence, "set": _expand(steps, sequence["set"], where)}
    places |= _change_sequence(mechanism, sequence, path, scene_path)
    values = (*changed.values(), *sequence.get("set", {}).values())
    changes = dict(zip(places.values(), values, strict=True))
    changes |= {("name",): name, ("sequence.stop_after",): sequence.get("stop_after")}
    checker = checker or schema.Checker("mechanism")
    if found := checker.find_violation(mechanism, changes):
        schema.check(read_mechanism(path), "mechanism", path)  # of the file itself
        keys = [key for key, place in places.items() if _is_below(found.path, place)]
        keys = keys or [key for key, place in places.items() if _is_below(place, found.path)]
        raise UsageError(
            f"{shown(scene_path)}: {' and '.join(keys or places)} cannot be set in {shown(path)}:"
            f" {found.sentence}"
        )
    return {"name": name, **convert_degrees(without_nulls(mechanism))}


def find_mechanism(name: str, scene_path: Path) -> Path:
    """Find a mechanism next to a scene, or else among the shipped ones. Raises UsageError."""
    for folder in (scene_path.parent, MECHANISMS):
        if is_file(folder / f"{name}.json"):
            return folder / f"{name}.json"
    names = sorted({f.stem for f in MECHANISMS.glob("*.json")})
    raise UsageError(
        f"{shown(scene_path)}: mechanism.name is '{name}': there is no {name}.json next to the"
        f" scene or in {shown(MECHANISMS)}{did_you_mean(name, names)}"
    )


def read_mechanism(path: Path) -> dict:
    """Read a mechanism file; the document may stand alone or under the key "mechanism"."""
    document = read_json(path)
    if isinstance(document, dict):
        document = get_mechanism(document)
    if not isinstance(document, dict):
        raise UsageError(f"{shown(path)}: is no mechanism, but {type(document).__name__}")
    if isinstance(document.get("latches"), list):  # short for a list of single latches
        document["latches"] = {"list": document["latches"]}
    return document


def get_mechanism(document: dict) -> Any:
    """Return the mechanism of a document: all of it, or a member and the home pose next to it."""
    mechanism = document.get("mechanism", document)
    if isinstance(mechanism, dict) and "home_q" in document:
        return {"home_q": document["home_q"], **mechanism}
    return mechanism


def read_json(path: Path) -> Any:
    """Read a JSON file. Raises UsageError."""
    with reading(path, "JSON", "groups"):
        return parse_json(read_text(path))


class _Repeated(dict):
    """An object of a JSON file that has a key twice."""

    key: str


def parse_json(text: str) -> Any:
    """Parse JSON. Raises ValueError, also where an object has a key twice."""
    repeated: list[_Repeated] = []

    def make_object(pairs: list[tuple[str, Any]]) -> dict:
        members = dict(pairs)
        if len(members) == len(pairs):
            return members
        names = [name for name, _ in pairs]
        found = _Repeated(members)
        found.key = next(name for name in members if names.count(name) > 1)
        repeated.append(found)
        return found

    document = json.loads(text, object_pairs_hook=make_object)
    if repeated:
        raise ValueError(f"the member {_find_repeated(document)} is there twice")
    return document


def _find_repeated(node: Any, path: str = "") -> str:
    """Return the path of the first key that is there twice; empty: there is none."""
    if isinstance(node, _Repeated):
        return f"{path}.{node.key}".lstrip(".")
    entries: Any = ()
    if isinstance(node, dict):
        entries = ((f"{path}.{name}", child) for name, child in node.items())
    elif isinstance(node, list):
        entries = ((f"{path}[{number}]", child) for number, child in enumerate(node, 1))
    return next(filter(None, (_find_repeated(child, where) for where, child in entries)), "")


@contextmanager
def reading(path: Path, language: str, parts: str) -> Iterator[None]:
    """Say what is wrong with a file that cannot be read or parsed."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{shown(path)}: cannot be read ({find_reason(error)})") from None
    except ValueError as error:
        raise UsageError(f"{shown(path)}: is not {language} ({error})") from None
    except RecursionError:
        raise UsageError(f"{shown(path)}: lists and {parts} are nested too deeply") from None


def apply_override(scene: dict, text: str) -> dict[tuple[str | int, ...], Any]:
    """Apply one ``KEY=VALUE`` to a scene as read from its file.

    Args:
        scene: modified in place.
        text: dotted key, ``=``, a TOML value; bare words are texts. A key with ``*`` means all keys
            that are like it. What follows ``mechanism.set.`` is a path into the mechanism file, and
            what follows ``sequence.set.`` one into its steps; what follows ``initial.joints.``
            begins with the name of a body, and what follows ``disturbance.`` with a number from 1.

    Returns:
        The value, by each place in the scene where it is.

    Raises:
        UsageError: no ``=``, or a key that no scene has.
    """
    key, equals, value_text = (part.strip() for part in text.partition("="))
    if not equals or not key:
        raise UsageError(f"--scene {text}: must be KEY=VALUE, for example chaser.motion=driven")
    value = parse_value(value_text)
    return {_set_key(scene, each, value, text): value for each in _expand_key(scene, key, text)}


def _expand_key(scene: dict, key: str, text: str) -> list[str]:
    """Return the keys that a key with ``*`` means; paths into a mechanism are expanded later."""
    if "*" not in key or key.startswith(_PATHS):
        return [key]
    keys = [*list_keys(scene)]
    if isinstance(listed := scene.get("disturbance"), list):
        component = key[-2:] if key[-2:] in (".1", ".2", ".3") else ""
        for number, member in itertools.product(range(len(listed)), disturbance_members()):
            keys.append(f"{_DISTURBANCE}{number + 1}.{member}{component}")
    if isinstance(joints := scene.get("initial", {}).get("joints"), dict):
        keys += [f"initial.joints.{body}.{m}" for body in joints for m in ("position", "rate")]
    return match_names(key, keys, f"--scene {text}")


def _set_key(scene: dict, key: str, value: Any, text: str) -> tuple[str | int, ...]:
    """Set one key of a scene; returns where its value is. Messages quote the override `text`."""
    for prefix in _PATHS:
        if key.startswith(prefix):
            sections, last = prefix.rstrip(".").split("."), key.removeprefix(prefix)
            _find_section(scene, sections, text)[last] = value
            return (*sections, last)
    if key.startswith(_DISTURBANCE):
        return _set_disturbance(scene, key, value, text)
    known = scene_members()
    if key not in known and not key.startswith(OPEN_KEYS):
        hint = did_you_mean(key, known)
        if any(name.startswith(f"{key}.") for name in known):
            hint = f" (it is a section: write {key}.MEMBER)"
        raise UsageError(f"--scene {text}: a scene has no key '{key}'{hint}")
    *sections, last = key.split(".")
    _find_section(scene, sections, text)[last] = value
    return (*sections, last)


def _set_disturbance(scene: dict, key: str, value: Any, text: str) -> tuple[str | int, ...]:
    """Set a member of a disturbance, or one of the three numbers of a member; the next one is new.

    Returns:
        Where the value is in the scene.
    """
    number, _, path = key.removeprefix(_DISTURBANCE).partition(".")
    listed = scene.setdefault("disturbance", [])
    place = int(number) if number.isdecimal() and len(number) < 10 else 0
    if not isinstance(listed, list) or not 1 <= place <= len(listed) + 1:
        count = len(listed)
        raise UsageError(
            f"--scene {text}: the scene has {count} disturbances, counted from 1; write"
            f" disturbance.NUMBER.MEMBER, where {count + 1} adds a disturbance"
        )
    member, _, component = path.partition(".")
    if member not in disturbance_members():
        hint = did_you_mean(member, list(disturbance_members()))
        raise UsageError(f"--scene {text}: a disturbance has no member '{member}'{hint}")
    if place > len(listed):
        listed.append({})
    entry = listed[place - 1]
    if not component:
        entry[member] = value
        return ("disturbance", place - 1, member)
    numbers = entry.setdefault(member, copy.deepcopy(disturbance_members()[member].get("default")))
    if not isinstance(numbers, list) or component not in ("1", "2", "3") or len(numbers) != 3:
        raise UsageError(
            f"--scene {text}: {member} of a disturbance has no number '{component}':"
            " force and torque have 1, 2 and 3"
        )
    numbers[int(component) - 1] = value
    return ("disturbance", place - 1, member, int(component) - 1)


@cache
def disturbance_members() -> dict[str, dict]:
    """Return the members of a disturbance, with their nodes of the schema."""
    root = schema.load_schema("scene")
    return root["properties"]["disturbance"]["items"]["properties"]


def _find_section(scene: dict, sections: list[str], text: str) -> dict:
    """Return a section of a scene, made if it is not there; messages quote the override `text`."""
    node: Any = scene
    for number, section in enumerate(sections, 1):
        node = node.setdefault(section, {})
        if not isinstance(node, dict):
            where = ".".join(sections[:number])
            raise UsageError(f"--scene {text}: {where} of the scene is {node!r}: must be a section")
    return node


def parse_value(text: str) -> Any:
    """Parse the right side of KEY=VALUE: a TOML value, or a bare word as text."""
    for read in (read_whole, read_number):
        with suppress(ValueError):
            return read(text)
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    value = parsed["value"]
    is_other = math.isfinite(as_number(value))  # a number of TOML alone, such as 1_000
    return value if len(parsed) == 1 and not is_other else text


def to_text(value: Any) -> str:
    """Return a value as it is written in TOML and after ``KEY=``, with all digits."""
    value = to_plain(value)
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case list() | tuple():
            return "[" + ", ".join(map(to_text, value)) + "]"
        case dict():
            return "{" + ", ".join(f"{to_text(k)} = {to_text(v)}" for k, v in value.items()) + "}"
    return repr(value)


def read_toml(path: Path) -> tuple[dict, str]:
    """Read a TOML file; returns what it says, and its text. Raises UsageError."""
    with reading(path, "TOML", "tables"):
        text = read_text(path)
        return tomllib.loads(text), text


@cache
def scene_members() -> dict[str, dict]:
    """Return every dotted key that the schema of scenes knows, with its node of the schema."""
    root = schema.load_schema("scene")

    def walk(node: dict, prefix: str) -> dict[str, dict]:
        members: dict[str, dict] = {}
        for name, child in schema.known_members(node, root).items():
            inner = schema.resolve(child, root)
            below = walk(inner, f"{prefix}{name}.")
            members |= below or {f"{prefix}{name}": {**inner, **child}}
        return members

    return walk(root, "")


def list_keys(scene: dict) -> dict[str, dict]:
    """Return the `scene_members` of a scene: without those of a target and adapters it lacks."""
    lacks = ["target."] if "target" not in scene else []
    lacks += [f"{v}.adapter." for v in ("chaser", "target") if "adapter" not in scene.get(v, {})]
    return {
        name: node for name, node in scene_members().items() if not name.startswith(tuple(lacks))
    }


@cache
def _defaults(*section: str) -> dict[str, Any]:
    """Return the defaults of a section of a scene file, to be merged into another dictionary."""
    return schema.list_defaults("scene", *section)


def _initial(scene: dict, path: Path) -> dict:
    """Convert section [initial]: magnitudes and directions in degrees to SI vectors of A.

    A direction of 0 is +y of A, turning towards +z. Tilt is the rotation vector of the swing.
    """
    given = _defaults("initial") | scene.get("initial", {})
    at = given["at"]
    if at == "first_contact" and "target" not in scene:
        raise UsageError(
            f"{shown(path)}: initial.at is 'first_contact', which needs a [target] to touch"
        )
    if at == "first_contact" and "closing_speed" not in given:
        raise UsageError(f"{shown(path)}: initial lacks the member 'closing_speed'")

    def disc(magnitude: str, direction: str, unit: float = 1.0) -> list[float]:
        size = unit * given[magnitude]
        angle = math.radians(given[direction]) if size else 0.0  # no offset, no direction
        return [size * math.cos(angle), size * math.sin(angle)]

    degree = math.radians(1.0)
    rates = disc("pitch_yaw_rate_deg_s", "pitch_yaw_rate_direction_deg", degree)
    return {
        "at": at,
        "approach_time": given["approach_time"],
        "closing_speed": given.get("closing_speed", 0.0),
        "lateral": disc("lateral_offset", "lateral_direction_deg"),
        "tilt": disc("pitch_yaw_deg", "pitch_yaw_direction_deg", degree),
        "roll": degree * given["roll_deg"],
        "lateral_velocity": disc("lateral_speed", "lateral_speed_direction_deg"),
        "angular_velocity": [degree * given["roll_rate_deg_s"], *rates],
        "capture_body": _defaults("initial", "capture_body") | given.get("capture_body", {}),
        "joints": given.get("joints", {}),
    }


def _is_below(path: tuple, other: tuple) -> bool:
    return path[: len(other)] == other


def _change_sequence(
    mechanism: dict, changes: dict, path: Path, scene_path: Path
) -> dict[str, tuple]:
    """Apply section ``[sequence]`` of a scene to the sequence of its mechanism.

    Returns:
        The keys of the section with their places in the document.

    Raises:
        UsageError: the mechanism has no sequence, or no such step or member.
    """
    if not changes:
        return {}
    where = f"{shown(scene_path)}: sequence"
    if not isinstance(mechanism.get("sequence"), dict):
        raise UsageError(f"{where}: the mechanism in {shown(path)} has no sequence")
    places = {
        f"sequence.set.{dotted}": _set_member(
            mechanism, f"sequence.steps.{dotted}", value, path, f"{where}.set.{dotted}"
        )
        for dotted, value in changes.get("set", {}).items()
    }
    if (last := changes.get("stop_after")) is not None:
        listed = mechanism["sequence"].get("steps", [])
        steps = {str(step.get("name")): step for step in listed if isinstance(step, dict)}
        if last not in steps:
            raise UsageError(
                f"{where}.stop_after is '{last}': the sequence in {shown(path)} has no such"
                f" step{did_you_mean(last, list(steps))}; its steps are {', '.join(steps)}"
            )
        mechanism["sequence"]["stop_after"] = last
    return places


def _expand(node: Any, settings: dict[str, Any], where: str) -> dict[str, Any]:
    """Return settings, where a path with ``*`` in its parts is replaced by all that are like it.

    Raises:
        UsageError: there are none. The message begins with `where`.
    """

    def list_paths(node: Any, parts: list[str], key: str) -> list[str]:
        part, *rest = parts
        children = dict(_list_children(node))
        if "*" not in part:
            below = list_paths(children.get(part), rest, key) if rest else []
            return [f"{part}.{path}" for path in below] if rest else [part]
        found = []
        for name in match_names(part, children, f"{where}.{key}"):
            below = list_paths(children[name], rest, key) if rest else []
            found += [f"{name}.{path}" for path in below] if rest else [name]
        return found

    return {
        path: value
        for key, value in settings.items()
        for path in (list_paths(node, key.split("."), key) if "*" in key else [key])
    }


def list_matches(path: Path, overrides: list[str] | tuple[str, ...]) -> list[str]:
    """Say of every override with ``*`` how many members it sets; `resolve_scene` accepts all."""
    scene, _ = read_toml(path)
    counts = {text: len(apply_override(scene, text)) for text in overrides}
    notes = []
    for text in overrides:
        key = text.partition("=")[0].strip()
        if "*" not in key:
            continue
        if prefix := next((prefix for prefix in _PATHS if key.startswith(prefix)), None):
            node = read_mechanism(find_mechanism(scene["mechanism"]["name"], path))
            node = node["sequence"]["steps"] if prefix == _PATHS[1] else node
            counts[text] = len(_expand(node, {key.removeprefix(prefix): 0}, ""))
        notes.append(say_matches(text, counts[text]))
    return notes


def _list_children(node: Any) -> Iterator[tuple[str, Any]]:
    """Yield what paths can name: members of a group, entries of a list by name or number."""
    if isinstance(node, dict):
        yield from ((name, child) for name, child in node.items() if name != "comment")
    elif isinstance(node, list):
        for number, entry in enumerate(node, 1):
            named = entry.get("name", number) if isinstance(entry, dict) else number
            yield str(named), entry


def _set_member(mechanism: dict, dotted: str, value: Any, path: Path, key: str) -> tuple:
    """Set one member of a mechanism; list entries are addressed by name or number, from 1.

    Messages begin with `key`.

    Returns:
        Where it is in the document, as schemas count.
    """
    node: Any = mechanism
    walked: list[str] = []
    place: list[str | int] = []
    *groups, last = dotted.split(".")
    for part in groups:
        if isinstance(node, list):
            names = [
                str(entry.get("name", i)) if isinstance(entry, dict) else str(i)
                for i, entry in enumerate(node, 1)
            ]
            number = names.index(part) + 1 if part in names else 0
            if not number and part.isdecimal() and len(part) < 10:
                number = int(part)
            child = node[number - 1] if 1 <= number <= len(node) else None
            place.append(number - 1)
        else:
            names = [name for name in node if name != "comment"]
            child = node.get(part)
            place.append(part)
        if not isinstance(child, dict | list):
            where = ".".join(walked) or "the mechanism"
            wrong = f"{where} has no group '{part}'{did_you_mean(part, names)}"
            if part in names:
                wrong = f"{'.'.join((*walked, part))} is no group"
            raise UsageError(f"{key} cannot be set in {shown(path)}: {wrong}")
        node = child
        walked.append(part)
    if not isinstance(node, dict):
        raise UsageError(f"{key} must end with the name of a member")
    node[last] = copy.deepcopy(value)
    return (*place, last)


def without_nulls(node: Any) -> Any:
    """Return a document without members that are null: they are as if left out."""
    if isinstance(node, list):
        return [without_nulls(entry) for entry in node]
    if isinstance(node, dict):
        return {key: without_nulls(value) for key, value in node.items() if value is not None}
    return node


def convert_degrees(node: Any) -> Any:
    """Return a mechanism without comments, with every NAME_deg as NAME in rad."""
    if isinstance(node, list):
        return [convert_degrees(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    plain = {}
    for key, value in node.items():
        if key.endswith("_deg"):
            to_rad = [math.radians(v) for v in value] if isinstance(value, list) else None
            plain[key.removesuffix("_deg")] = math.radians(value) if to_rad is None else to_rad
        elif key != "comment":
            plain[key] = convert_degrees(value)
    return plain
