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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from dockloop.base import schema
from dockloop.base.errors import DockloopError, UsageError, did_you_mean, warn
from dockloop.base.files import scratch
from dockloop.base.number import as_number, is_number, read_number, read_whole
from dockloop.base.paths import shown
from dockloop.native.core import number_choice
from dockloop.native.variables import NAMED_NUMBERS, VEHICLES, fits, match_names, say_matches
from dockloop.scene.blame import find_guilty
from dockloop.scene.find import find_mechanism, get_mechanism, read_mechanism, read_toml
from dockloop.scene.patterns import expand_patterns
from dockloop.scene.tables import list_files, put_force_tables, put_law_tables, read_inputs
from dockloop.scene.values import as_setting, to_text

FORMAT = "dockloop-scene/1"
# Texts in quotes; words of lists and groups that are values.
_WORD = re.compile(r"""("(?:[^"\\]|\\.)*"|'[^']*')|(?<=[\[,=\s])[^\s\[\]{},"'=]+(?=\s*[,\]}])""")
PATHS = ("mechanism.set.", "sequence.set.")  # begin keys that go on as paths into the mechanism
# Lists of tables: what an entry is, by the beginning of its keys, which its number from 1 follows.
LISTS = {
    "disturbance.": "disturbance",
    "force.": "force between the vehicles",
    "input.": "table of inputs",
    "chaser.part.": "part of the chaser",
    "target.part.": "part of the target",
}
# Begin keys that no list of keys of a scene holds.
OPEN_KEYS = (*PATHS, *LISTS, "initial.joints.")
_KEPT = 16  # mechanisms, with what is set in them, that a reader of a scene remembers
_BASE = ("position", "attitude")  # of the base of the mechanism in A: base_position, ...

_NUMBERED = {  # choices that a scene names and its document numbers: the variable with the names
    ("solver", "method"): "solver.method",
    ("contact", "friction_model"): "friction.model",
}


def write_scene(members: Mapping[str, Any]) -> Path:
    """Write the members of a scene file into a folder of this process; returns the file.

    Args:
        members: as in the file. ``mechanism`` may hold the members of a mechanism file, as well as
            ``set``, ``base_position`` and ``base_attitude`` of the section. Tables are relative to
            the present folder.

    Raises:
        UsageError: a member is neither number, text, list nor group.
        DockloopError: there is no folder for it.
    """
    scene = without_nulls(dict(members))
    for entry in list_files(scene):
        entry["file"] = str(Path.cwd() / str(entry["file"]))
    named, files = scene.get("mechanism"), {}
    section = ("name", "set", *(f"base_{m}" for m in _BASE))
    if isinstance(named, dict) and set(named) - set(section):
        own = {m: named[m] for m in section[1:] if m in named}
        mechanism = get_mechanism({key: value for key, value in named.items() if key not in own})
        name = str(mechanism.get("name", "mechanism"))
        if Path(name).name != name:
            raise UsageError(f"mechanism.name is {name!r}: must be a name without a folder")
        scene["mechanism"] = {"name": name, **own}
        files[f"{name}.json"] = json.dumps(mechanism, default=_to_plain)
    pairs = (as_setting(to_text(name), value) for name, value in scene.items())
    files["scene.toml"] = "".join(f"{pair}\n" for pair in pairs)
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

    def list_keys_like(self, name: str) -> list[str]:
        """Return the keys of the scene that a name means; none: it is that of a variable alone."""
        if is_scene_key(name):
            return [name]
        return [key for key in self.list_keys() if "*" in name and fits(key, name)]

    def resolve(
        self,
        overrides: Sequence[str] = (),
        given_by: Mapping[str, str] | None = None,
        work: Callable[[dict], str | None] = lambda _: None,
        say: Callable[[str], None] | None = None,
    ) -> dict:
        """Do the work of `resolve_scene`; documents of equal mechanisms share them.

        What is said of the document begins with the override to blame, if there is one.

        Args:
            overrides: ``KEY=VALUE`` texts.
            given_by: of overrides that no ``--scene`` has given: with what messages begin.
            work: what else is done to the document; returns a warning, if there is one.
            say: receives that; default: it is printed.

        Raises:
            UsageError: naming override or file, member, value and limit.
        """

        def try_with(texts: list[str]) -> str:
            try:
                return work(self.apply(texts)) or ""
            except DockloopError as error:
                return str(error)

        def blame(said: str) -> str:
            guilty = find_guilty(overrides, try_with)
            if guilty is None:
                return said
            own = f"--scene {guilty}: "
            begin = f"{given_by[guilty]}: " if given_by and guilty in given_by else own
            return begin + said.removeprefix(f"{shown(self._path)}: ").removeprefix(own)

        try:
            document = self.apply(overrides)
            warning = work(document)
        except UsageError as error:
            raise UsageError(blame(str(error))) from None
        if warning:
            say(warning) if say else warn(blame(f"{shown(self._path)}: {warning}"))
        return document

    def apply(self, overrides: Sequence[str]) -> dict:
        """Do the work of `resolve`, without a search for the override to blame."""
        scene = without_nulls(self._scene)  # a copy: TOML has no nulls
        changes: dict[tuple[str | int, ...], Any] = {}
        for text in overrides:
            changes |= apply_override(scene, text)
        if found := self._checker.find_violation(scene, changes):
            raise UsageError(f"{shown(self._path)}: {found.sentence}")
        _number_choices(scene)
        # Without mechanism it is a vehicle by itself, or two that pass through each other.
        named = scene.get("mechanism")
        text = json.dumps(named and named | {"sequence": scene.get("sequence", {})}, default=str)
        mechanism = self._mechanism(text) if named else {"name": "none"}
        return _resolve(scene, mechanism, self._path)


def _number_choices(scene: dict) -> None:
    """Replace names of choices by their numbers; the schema has checked the names."""
    for (section, member), variable in _NUMBERED.items():
        name = scene.get(section, {}).get(member)
        if isinstance(name, str):
            scene[section][member] = number_choice(variable, name)
    accuracy = scene.get("solver", {}).get("accuracy")
    if isinstance(accuracy, str):
        scene["solver"]["accuracy"] = NAMED_NUMBERS["accuracy"][accuracy]


def has_contact_law(mechanism: dict) -> bool:
    """Return whether a mechanism has a law that section ``[contact]`` of a scene can override."""
    return mechanism.get("contact", {}).get("type") in ("guide_ring", "surfaces")


def _resolve(scene: dict, mechanism: dict, path: Path) -> dict:
    """Put the document together from a scene that its schema accepts, and its mechanism."""
    named = scene.get("mechanism", {})
    law = scene.get("contact", {})
    if law and not has_contact_law(mechanism):
        raise UsageError(
            f"{shown(path)}: [contact] overrides the law of surfaces or of a guide ring,"
            + (
                f" but mechanism.name is '{named['name']}', which has none; its file states what"
                " mechanism.set.contact.MEMBER changes"
                if named
                else " but there is none"
            )
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
    for key in ("coupling", "disturbance", "force", "model", "phases"):
        if key in scene:
            document[key] = scene[key]
    if "target" in scene:
        document["target"] = _defaults("target") | scene["target"]
    put_force_tables(document.get("force", ()), path)
    if base := {m: named[f"base_{m}"] for m in _BASE if f"base_{m}" in named}:
        document["base"] = base
    if "input" in scene:
        document["input"] = read_inputs(scene["input"], document, path)
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
    changed = expand_paths(mechanism, reference.get("set", {}), where)
    places = {
        f"mechanism.set.{dotted}": set_member(mechanism, dotted, value, path, f"{where}.{dotted}")
        for dotted, value in changed.items()
    }
    sequence = reference.get("sequence", {})
    if isinstance(mechanism.get("sequence"), dict) and "set" in sequence:
        steps = mechanism["sequence"].get("steps", [])
        where = f"{shown(scene_path)}: sequence.set"
        sequence = {**sequence, "set": expand_paths(steps, sequence["set"], where)}
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
    mechanism = without_nulls(mechanism)
    expand_patterns(mechanism, path)
    put_law_tables(mechanism, path)
    return {"name": name, **convert_degrees(mechanism)}


def apply_override(scene: dict, text: str) -> dict[tuple[str | int, ...], Any]:
    """Apply one ``KEY=VALUE`` to a scene as read from its file.

    Args:
        scene: modified in place.
        text: dotted key, ``=``, a TOML value; bare words are texts. A key with ``*`` means all keys
            that are like it. What follows ``mechanism.set.`` is a path into the mechanism file, and
            what follows ``sequence.set.`` one into its steps; what follows ``initial.joints.``
            begins with the name of a body, and what follows ``disturbance.``, ``force.``,
            ``input.``, ``chaser.part.`` or ``target.part.`` with a number from 1.

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
    if "*" not in key or key.startswith(PATHS):
        return [key]
    keys = [*list_keys(scene)]
    component = match[0] if (match := re.search(r"\.[1-6]$", key)) else ""
    for prefix in LISTS:
        count = len(find_entries(scene, prefix))
        for number, member in itertools.product(range(1, count + 1), entry_members(prefix)):
            keys.append(f"{prefix}{number}.{member}{component}")
    if isinstance(joints := scene.get("initial", {}).get("joints"), dict):
        keys += [f"initial.joints.{body}.{m}" for body in joints for m in ("position", "rate")]
    return match_names(key, keys, f"--scene {text}")


def split_key(key: str) -> list[str]:
    """Return the tables of a scene file and the member that a key means."""
    for prefix in PATHS:
        if key.startswith(prefix):
            return [*prefix.rstrip(".").split("."), key.removeprefix(prefix)]
    return key.split(".")


def _set_key(scene: dict, key: str, value: Any, text: str) -> tuple[str | int, ...]:
    """Set one key of a scene; returns where its value is. Messages quote the override `text`."""
    for prefix in LISTS:
        if key.startswith(prefix):
            return _set_entry(scene, prefix, key.removeprefix(prefix), value, text)
    known = scene_members()
    whole, _, component = key.rpartition(".")
    if component.isdecimal() and whole in known:
        *sections, last = whole.split(".")
        group = _find_section(scene, sections, text)
        if numbers := _find_numbers(group, last, known[whole], component):
            numbers[int(component) - 1] = value
            return (*sections, last, int(component) - 1)
        if isinstance(group[last], list):
            raise UsageError(
                f"--scene {text}: {whole} has no number '{component}': it is {group[last]}"
            )
    if key not in known and not key.startswith(OPEN_KEYS):
        hint = did_you_mean(key, known)
        if any(name.startswith(f"{key}.") for name in known):
            hint = f" (it is a section: write {key}.MEMBER)"
        raise UsageError(f"--scene {text}: a scene has no key '{key}'{hint}")
    *sections, last = split_key(key)
    _find_section(scene, sections, text)[last] = value
    return (*sections, last)


def _find_numbers(group: dict, member: str, node: dict, component: str) -> list | None:
    """Return the list of a member that has a number of this place, from 1; None: there is none."""
    numbers = group.setdefault(member, copy.deepcopy(node.get("default")))
    has_it = isinstance(numbers, list) and component in map(str, range(1, len(numbers) + 1))
    return numbers if has_it else None


def _set_entry(scene: dict, prefix: str, key: str, value: Any, text: str) -> tuple[str | int, ...]:
    """Set a member of an entry of a list, or one number of a member; the next entry is new.

    Returns:
        Where the value is in the scene.
    """
    what, (*sections, name) = LISTS[prefix], prefix.rstrip(".").split(".")
    listed = _find_section(scene, sections, text).setdefault(name, [])
    number, _, path = key.partition(".")
    place = int(number) if number.isdecimal() and len(number) < 10 else 0
    if not isinstance(listed, list) or not 1 <= place <= len(listed) + 1:
        count = len(listed)
        raise UsageError(
            f"--scene {text}: the scene has {count} times a {what}, counted from 1; write"
            f" {prefix}NUMBER.MEMBER, where {count + 1} adds a {what}"
        )
    member, _, component = path.partition(".")
    members = entry_members(prefix)
    if not member:
        raise UsageError(f"--scene {text}: is a {what}: write {prefix}{number}.MEMBER")
    if member not in members:
        hint = did_you_mean(member, list(members))
        raise UsageError(f"--scene {text}: a {what} has no member '{member}'{hint}")
    if place > len(listed):
        listed.append({})
    entry = listed[place - 1]
    where: tuple[str | int, ...] = (*sections, name, place - 1, member)
    if not component:
        entry[member] = value
        return where
    numbers = _find_numbers(entry, member, members[member], component)
    if numbers is None:
        defaults = {each: node.get("default") for each, node in members.items()}
        lists = [m for m, known in (defaults | entry).items() if isinstance(known, list)]
        raise UsageError(
            f"--scene {text}: {member} of a {what} has no number '{component}':"
            f" {' and '.join(lists)} have numbers, counted from 1"
        )
    numbers[int(component) - 1] = value
    return (*where, int(component) - 1)


def find_member(node: Any, parts: Iterable[str]) -> Any:
    """Return the member of nested groups, None if there is none; entries have numbers from 1."""
    for part in parts:
        if isinstance(node, list):
            node = dict(enumerate(node, 1)).get(int(part)) if part.isdecimal() else None
        else:
            node = node.get(part) if isinstance(node, dict) else None
    return node


def find_entries(scene: dict, prefix: str) -> list[dict]:
    """Return the entries of a list of a scene; none if it has no such list."""
    node = find_member(scene, prefix.rstrip(".").split("."))
    return node if isinstance(node, list) else []


@cache
def entry_members(prefix: str) -> dict[str, dict]:
    """Return the members of an entry of a list, with their nodes of the schema."""
    root = schema.load_schema("scene")
    node = root
    for section in prefix.rstrip(".").split("."):
        node = schema.known_members(node, root)[section]
    return schema.known_members(node["items"], root)


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
        parsed = tomllib.loads(f"value = {_WORD.sub(_as_toml, text)}")
    except (ValueError, RecursionError):
        return text
    value = parsed["value"]
    is_other = math.isfinite(as_number(value))  # a number of TOML alone, such as 1_000
    return value if len(parsed) == 1 and not is_other else text


def _as_toml(word: re.Match) -> str:
    """Return a number of a list as TOML writes it; what is none here becomes a text."""
    if word[1] or word[0] in ("true", "false"):
        return word[0]
    value = parse_value(word[0])
    return to_text(value if is_number(value) else word[0])


def is_scene_key(name: str) -> bool:
    """Return whether a name is a key of scenes; if not, it is a start value of the FMU."""
    return find_key(name) is not None or name.startswith(OPEN_KEYS)


def find_key(name: str) -> dict | None:
    """Return the node of the schema of a key, or of the vector of which it is one number."""
    whole, _, last = name.rpartition(".")
    known = scene_members()
    return known.get(whole if last.isdecimal() and name not in known else name)


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
    """Return the `scene_members` of a scene: without those of groups that it lacks."""
    lacks = ["target."] if "target" not in scene else []
    groups = [(v, group) for v in VEHICLES for group in ("modes", "adapter")]
    lacks += [f"{v}.{group}." for v, group in groups if group not in scene.get(v, {})]
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
        f"sequence.set.{dotted}": set_member(
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


def expand_paths(node: Any, settings: dict[str, Any], where: str) -> dict[str, Any]:
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
    if not any("*" in text.partition("=")[0] for text in overrides):
        return []  # without reading the scene again
    scene, _ = read_toml(path)
    counts = {text: len(apply_override(scene, text)) for text in overrides}
    notes = []
    for text in overrides:
        key = text.partition("=")[0].strip()
        if "*" not in key:
            continue
        if prefix := next((prefix for prefix in PATHS if key.startswith(prefix)), None):
            node = read_mechanism(find_mechanism(scene["mechanism"]["name"], path))
            node = node["sequence"]["steps"] if prefix == PATHS[1] else node
            counts[text] = len(expand_paths(node, {key.removeprefix(prefix): 0}, ""))
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


def set_member(mechanism: dict, dotted: str, value: Any, path: Path, key: str) -> tuple:
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
    if isinstance(node, list) and last in map(str, range(1, len(node) + 1)):
        number = int(last) - 1
        if not isinstance(node[number], dict | list):
            node[number] = value
            return (*place, number)
    if not isinstance(node, dict):
        raise UsageError(f"{key} must end with the name of a member, or the place of a number")
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
