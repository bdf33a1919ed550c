"""The docking of a live page: settings in, data of the page out, the newest request only."""

import fnmatch
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from dockloop.base.errors import DockloopError, UsageError
from dockloop.native.core import has_only_legs
from dockloop.native.variables import VEHICLES
from dockloop.result.accuracy import estimate_error
from dockloop.result.recording import Result
from dockloop.runs.docking import Scene, run
from dockloop.scene.catalogue import Entry, list_entries
from dockloop.scene.find import find_scene
from dockloop.scene.mechanism import find_turning
from dockloop.scene.placement import find_idleness
from dockloop.scene.resolve import SceneReader, has_contact_law, parse_value
from dockloop.scene.values import as_setting, to_text
from dockloop.view.page import make_data

COARSE = 1e-2  # accuracy while a slider moves
_POINTS = 400  # of a docking while a slider moves
_MOST_POINTS = 100_000  # of any docking: some 200 MB
# Quantities with a slider from the start, by heading.
SLIDERS = {
    "initial conditions": r"initial\.(closing_speed|lateral_\w+|pitch_yaw_\w+|roll_\w+)",
    "vehicles": r"(chaser|target)\.mass|chaser\.contact_thrust",
    "contact": r"(mechanism\.set\.)?contact\.(stiffness|damping|friction_coefficient|restitution)",
    "legs and springs": r"mechanism\.set\.((leg_defaults|legs\.[^.]+)\.(stiffness|damping)"
    r"|(patterns\.\w+\.)?forces\.[^.]+\.(laws\.\d+\.(stages\.\d+\.2|slope|linear|quadratic"
    r"|stiffness|preload|forward|back|force|limit|current_limit|factor)"
    r"|stiffness|damping|preload))",
    "forces between the vehicles": r"force\[\d+\]\.(stiffness|damping|free_length|scale|size"
    r"|(chaser|target)_moment\[1\])",
    "latches": r"mechanism\.set\.latches\.(range|catch|play|window|push_force|stiffness)",
}
_NUMBERED = re.compile(r"(mechanism\.set\.(?:legs|forces)\.[^.*]*?)\d+(\..+)")  # parts of a kind
_LAW = re.compile(r"mechanism\.set\.(?:patterns\.\w+\.)?forces\.([^.]+)\.laws\.\d+\.(.+)")
_HALF_TURN = 180.0  # deg
_WIDTHS = {"N": 100.0}  # of sliders from 0, by unit
_NAME = r"[A-Za-z0-9_.\[\]*#-]+"  # of a setting: what a value begins with must not be in it


class DroppedError(DockloopError):
    """The docking is not wanted any more: a newer request came, or it was stopped."""


class RefusedError(UsageError):
    """A setting is refused; `name` says which one, if the sentence does."""

    def __init__(self, name: str, sentence: str) -> None:
        super().__init__(sentence)
        self.name = name


class Bench:
    """A scene whose dockings are computed one at a time; a newer one ends those before.

    Attributes:
        reference: name or path of the scene.
        base: settings that the page begins with, as texts by name; its own come on top.
        entries: everything that can be set, by name; of two things with one name the key of the
            scene, as sweeps choose.
        options: of ``dockloop run``, so that its docking has the bits of this one.
    """

    def __init__(self, reference: str, overrides: list[str] | tuple[str, ...] = ()) -> None:
        """Read the scene.

        Args:
            reference: name or path.
            overrides: ``KEY=VALUE`` texts, as given to ``--scene``.

        Raises:
            UsageError: naming file, member, value and limit.
        """
        self.reference = reference
        pairs = (text.partition("=") for text in overrides)
        self.base = {name.strip(): value.strip() for name, _, value in pairs}
        self.entries = _find_entries(reference, overrides)
        self._reader = SceneReader(find_scene(reference))
        self._scene = Scene(reference, self.split({})[0], self._reader)
        document = self._scene.document  # of a docking as computed here, an FMU has no kernel
        self.options = [] if has_only_legs(document, self._scene.path) else ["--no-kernel"]
        self._busy = threading.Lock()
        self._counting = threading.Lock()
        self._newest = 0

    def find_turning(self) -> dict[str, bool]:
        """Return whether the coordinate of each force element is an angle, by name."""
        return find_turning(self._scene.document["mechanism"], self._scene.path)

    def acts(self, name: str) -> bool:
        """Return whether something that can be set has an effect in the scene as it is."""
        document, section = self._scene.document, name.partition(".")[0]
        mechanism = document["mechanism"]
        if section == "contact":
            return has_contact_law(mechanism)
        if name.startswith("chaser.contact_thrust") and "sequence" in mechanism:
            actions = (a for step in mechanism["sequence"]["steps"] for a in step.get("do", ()))
            return any("thrust" in action for action in actions)
        is_fixed = section in VEHICLES and document[section]["motion"] == "fixed"
        return not find_idleness(name, document) and not is_fixed

    def split(self, settings: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the keys of the scene and the start values among settings, with their values.

        Raises:
            RefusedError: a setting has not the form of a name, or its value that of a path.
        """
        for name, text in settings.items():
            if not re.fullmatch(_NAME, name):
                raise RefusedError(
                    name, f"{name!r} is no name: must be of letters, digits and _ . [ ] * # -"
                )
            if "/" in text or "\\" in text:
                raise RefusedError(
                    name, f"{name} is {text}: must be without / and \\, as paths have"
                )
        overrides: dict[str, Any] = {}
        starts: dict[str, Any] = {}
        for name, text in (self.base | dict(settings)).items():
            entry = self.entries.get(name)
            set_by = entry.set_by if entry else "--set" if "[" in name else "--scene"
            (overrides if set_by == "--scene" else starts)[name] = parse_value(text)
        return overrides, starts

    def find_defaults(self, settings: Mapping[str, str]) -> dict[str, str]:
        """Return what has which value with these settings, by name, without those that are set.

        Raises:
            UsageError: a setting is bad.
        """
        overrides = [as_setting(*pair) for pair in self.split(settings)[0].items()]
        entries = _find_entries(self.reference, overrides)
        return {n: _say_default(e) for n, e in entries.items() if n not in settings}

    def compute(self, settings: Mapping[str, str], *, is_coarse: bool = False) -> Result:
        """Run the docking with these settings, unless a newer request comes.

        Args:
            settings: values as the command line takes them, by name.
            is_coarse: whether errors of `COARSE` and a few hundred points suffice; otherwise the
                result is that of ``dockloop run``.

        Raises:
            RefusedError: a setting is bad.
            DroppedError: a newer request came, or `stop` was called.
            DockloopError: a step failed.
        """
        with self._prepare(settings) as start:
            return start(is_coarse=is_coarse)

    def estimate(self, settings: Mapping[str, str]) -> dict[str, Any]:
        """Run the docking and once more with tighter settings, unless a newer request comes.

        Args:
            settings: as for `compute`.

        Returns:
            ``sentence`` of the `estimate_error`, and ``tighter``: figures (`condense`) of the run
            with tighter settings; None: it ends in another way, so that no figure has an error.

        Raises:
            RefusedError: a setting is bad, or the scene lacks outputs that are compared.
            DroppedError: a newer request came, or `stop` was called.
            DockloopError: a step failed.
        """
        with self._prepare(settings) as start:
            seen: list[Result] = []

            def repeat(other: Mapping[str, Any]) -> Result:
                seen.append(start(other))
                return seen[-1]

            estimate = estimate_error(start(), repeat)
            tighter = None if estimate["error"] is None else condense(seen[0])
            return {"sentence": estimate["sentence"], "tighter": tighter}

    @contextmanager
    def _prepare(self, settings: Mapping[str, str]) -> Iterator[Callable[..., Result]]:
        """Wait for the docking before; yields what runs this one, with other start values."""
        overrides, starts = self.split(settings)
        with self._turn() as check:
            try:
                if repr(overrides) != repr(self._scene.overrides):
                    self._scene = Scene(self.reference, overrides, self._reader)
                experiment = self._scene.document["experiment"]
                span, step = experiment["stop"] - experiment["start"], experiment["step"]
                if span > _MOST_POINTS * step:
                    raise UsageError(
                        f"experiment.step is {step}: gives {span / step:.3g} points, a page has"
                        f" at most {_MOST_POINTS}: make experiment.stop smaller, or the step larger"
                    )
                coarse = {"accuracy": COARSE, "step": max(span / _POINTS, step)}

                def start(*other: Mapping[str, Any], is_coarse: bool = False) -> Result:
                    values = starts | dict(*other)
                    more = coarse if is_coarse else {}
                    return run(self._scene, None, values, progress=check, **more)

                yield start
            except UsageError as error:
                named = (name for name in settings if name in str(error))
                raise RefusedError(max(named, key=len, default=""), str(error)) from None

    def stop(self) -> int:
        """End the docking that is computed, and those that wait; returns the next number."""
        with self._counting:
            self._newest += 1
            return self._newest

    @contextmanager
    def _turn(self) -> Iterator[Any]:
        """Wait for the docking before, which ends now; yields what raises `DroppedError`."""
        number = self.stop()

        def check(_part: float = 0.0) -> None:
            if number != self._newest:
                raise DroppedError("a newer request came, or this one was stopped")

        with self._busy:
            check()
            yield check


def _find_entries(reference: str, overrides: Sequence[str]) -> dict[str, Entry]:
    entries: dict[str, Entry] = {}
    for entry in list_entries(reference, overrides):
        if entry.set_by:
            entries.setdefault(entry.name, entry)
    return entries | _join_equal(entries)


def _join_equal(entries: Mapping[str, Entry]) -> dict[str, Entry]:
    """Return one entry for the parts of a kind (leg1, leg2, ...) if they agree, by its pattern."""
    kinds: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries.values():
        if match := _NUMBERED.fullmatch(entry.name):
            kinds.setdefault((match[1], match[2]), []).append(entry)
    joined = {}
    for (begin, end), parts in kinds.items():
        like = {tuple(name.split(".")[:4]) for name in entries if name.startswith(begin)}
        first, *others = (replace(part, name=f"{begin}*{end}") for part in parts)
        if others and len(like) == len(parts) and all(other == first for other in others):
            joined[first.name] = first
    return joined


def describe_entries(bench: Bench) -> list[dict[str, Any]]:
    """Return what can be set, as the page shows it: texts, heading and range of a slider."""
    found = []
    turning = bench.find_turning()
    for entry in bench.entries.values():
        heading = next((h for h, p in SLIDERS.items() if re.fullmatch(p, entry.name)), None)
        is_joined = _NUMBERED.sub(r"\1*\2", entry.name) in bench.entries.keys() - {entry.name}
        is_live = entry.default is not None and bench.acts(entry.name) and not is_joined
        found.append(
            {
                "name": entry.name,
                "unit": _find_unit(entry, turning),
                "default": _say_default(entry),
                "limits": ", ".join(entry.choices) if entry.choices else entry.limits,
                "meaning": entry.meaning,
                "label": _find_label(entry),
                "heading": heading if is_live else None,
                "range": find_range(entry),
            }
        )
    return found


def _find_unit(entry: Entry, turning: Mapping[str, bool]) -> str:
    """Return the unit of a value; of a law only that of its element, not that of others too."""
    match = _LAW.fullmatch(entry.name)
    elements = fnmatch.filter(turning, match[1]) if match else []
    units = entry.unit.split(" or ")
    if elements and len(units) > 1:
        return units[turning[elements[0]]]
    return "" if entry.unit == "1" else entry.unit


def _find_label(entry: Entry) -> str:
    """Return what names a number of a law, with its kind; empty: the name says it."""
    if not (match := _LAW.fullmatch(entry.name)):
        return ""
    member = re.sub(r"stages\.(\d+)\.2", r"stage \1", match[2])
    return f"{match[1]}: {entry.meaning.partition(':')[0]} {member}"


def _say_default(entry: Entry) -> str:
    value = entry.default
    return "" if value is None else to_text(value).strip('"').removesuffix(".0")


def find_range(entry: Entry) -> tuple[float, float, bool] | None:
    """Return begin and end of a slider, and whether it is logarithmic; None: there is no slider.

    The range is a view of the numbers that a user is likely to try. It is no limit: a field takes
    what the core takes.
    """
    value = entry.default
    if entry.choices or isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if "direction" in entry.name:
        return -_HALF_TURN, _HALF_TURN, False
    if entry.limits.startswith("> 0") and value > 0.0 and "at most" not in entry.limits:
        return value / 10.0, value * 10.0, True
    if low_high := re.fullmatch(r"(\S+) to (\S+)|> 0, at most (\S+)", entry.limits):
        low, high = (
            (float(low_high[k]) for k in (1, 2)) if low_high[1] else (0.0, float(low_high[3]))
        )
        return low, high, False
    width = 2.0 * abs(value) or _WIDTHS.get(entry.unit, 1.0)
    return (0.0 if entry.limits.startswith(">") else -width), width, False


def condense(result: Result) -> dict[str, Any]:
    """Return what the page lays next to each other of two dockings, with the bits of the run."""
    kept = ("outcome", "phase", "time_of_contact", "time_of_capture", "peak_loads", "energy")
    summary = result.summary
    return {name: summary[name] for name in (*kept, "legs", "limits") if name in summary}


def make_page(result: Result, command: str) -> dict[str, Any]:
    """Return the data of a page: those of ``dockloop view``, the summary of the run, warnings."""
    more = {"summary": condense(result), "warnings": result.warnings}
    return make_data(result, command) | more
