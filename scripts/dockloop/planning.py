"""From the values of a case to what runs it: a scene and start values, or an FMU and a job.

Planning a case means resolving the scene with its values. Threads of the core take the scene as it
is. Workers without a core receive FMUs: vehicles are placed here, and what an FMU accepts as start
values is set that way, so that cases share one FMU; it is built once per combination of all other
scene keys. Names are checked against the variables of the core: no FMU is built for that.
"""

import copy
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from dockloop import __version__
from dockloop.binaries import find_libraries
from dockloop.capture import list_needed
from dockloop.cases import Job, Result
from dockloop.core import core_errors, list_final_outcomes, list_loads, name_source, to_json
from dockloop.criteria import Criterion, parse_criterion, say_not_seen
from dockloop.errors import UsageError, did_you_mean, warn
from dockloop.fmu import find_placement, write_fmu
from dockloop.journal import make_digest
from dockloop.limits import EXCEEDED
from dockloop.outputs import scratch
from dockloop.paths import is_file, read_text, shown
from dockloop.peaks import list_with_places
from dockloop.results import list_points
from dockloop.sampling import Quantity, Sweep, Value, as_setting
from dockloop.scene import OPEN_KEYS, SceneReader, scene_members
from dockloop.variables import (
    MOTION,
    TYPES,
    WORDS,
    find_number,
    fits,
    is_of_type,
    list_names,
    match_names,
    read_variables,
)

# Members of a resolved scene that an FMU takes as start values, with the names of their variables.
_SETTABLE = {
    **{
        (vehicle, member): f"{vehicle}.{member}"
        for vehicle in ("chaser", "target")
        for member in (
            *MOTION,
            *("mass", "mass_includes_mechanism", "contact_thrust", "contact_thrust_delay"),
        )
    },
    ("contact", "friction_coefficient"): "friction.coefficient",
}
_PLACED = ("capture_body", "joints")  # of [initial], all that the FMU reads itself
KEPT_FMUS = 16  # that cases of a sweep share at a time


@dataclass(frozen=True)
class Plan:
    """A case for a worker that has no core.

    Attributes:
        fmu: key of its FMU, for `Planner.fmu`.
        job: what to do with it.
    """

    fmu: str
    job: Job


def _list_outcomes() -> list[str]:
    """Return what a sweep collects unless its file names outcomes."""
    peaks = [f"capture.peak.{load}" for load in (*list_loads(), "load_ratio")]
    return ["outcome", "time_of_contact", "time_of_capture", *peaks, "energy.residual"]


class Planner:
    """Turns the values of a case into what an engine runs.

    Attributes:
        unplaced: the resolved scene with ``[set]``, before anything varies.
        base: the same with both vehicles at their start.
        quantities: what varies, with units; with passes ``accuracy`` is the last one.
        varied: those that the sweep file names.
        outcomes: names of the outputs to collect.
        asked: these, what explains why there was no capture, and limits that were passed.
        histories: names of the outputs whose time histories are kept.
        variables: of a docking of `base`, by name.
        model_digest: SHA-256 of `base` and of the libraries that an FMU of it would hold.
        experiment: ``stop``, ``step``, ``end_after_outcome`` [s], those that the sweep gives.
        fmu: returns the SHA-256 and the bytes of the FMU of a key, built if it is not at hand.
        built: number of FMUs built so far.
        times: communication points of a case that runs to its stop.
        digest: of all that the user decides: scene, what is set and varies, cases, outcomes.
    """

    def __init__(self, sweep: Sweep) -> None:
        """Read the base scene and check all names of the sweep against its variables."""
        self._sweep = sweep
        self.experiment = sweep.document["experiment"]
        self.fmu = lru_cache(KEPT_FMUS)(self._build)
        self.built = 0
        self._matches: dict[str, list[str]] = {}
        fixed = sweep.document["set"]
        self._reader = SceneReader(sweep.scene)
        self.unplaced = self._reader.resolve(
            [as_setting(n, v) for n, v in fixed.items() for n in self._list_keys_like(n)]
        )
        self.base = copy.deepcopy(self.unplaced)
        find_placement(self.base, sweep.scene)
        with core_errors() as core:
            docking = core.Docking(to_json(self.base), name_source(sweep.scene))
        self.variables = read_variables(docking)
        libraries = {name: _hash(file.read_bytes()) for name, file in find_libraries().items()}
        self.model_digest = _hash(json.dumps([self.base, libraries]).encode())
        for name, value in fixed.items():
            self._check_name(name, "set", [value])
        for number, quantity in enumerate(sweep.quantities):
            self._check_quantity(quantity, sweep.cases.list_examples(number))
        self._check_decided_once()
        self.quantities = [self.with_unit(quantity) for quantity in sweep.quantities]
        self.varied = self.quantities[: -1 if sweep.passes else None]
        self.outcomes = self._find_outcomes()
        self.histories = self._find_histories()
        known = [v.name for v in self.variables.values() if v.causality in ("output", "parameter")]
        limits = [EXCEEDED] if EXCEEDED in known else []
        self.asked = list(dict.fromkeys([*self.outcomes, *list_needed(known), *limits]))
        self.times = self.list_points(self.base)
        names = [quantity.name for quantity in self.quantities]
        named = [quantity.named for quantity in self.quantities]
        passes = sweep.passes and asdict(sweep.passes)
        decided = [self.unplaced, fixed, names, named, sweep.cases.find_digest(), self.outcomes]
        decided += [self.experiment, passes, self.histories]
        self.digest = make_digest(decided)

    def find_setup(self) -> dict[str, Any]:
        """Return all that decides the result of a case but its values: the head of a journal."""
        return {
            "dockloop": __version__,
            "model": self.model_digest,
            "set": self._sweep.document["set"],
            "quantities": [quantity.name for quantity in self.quantities],
            "named_cases": [quantity.named for quantity in self.quantities],
            "outcomes": self.asked,
            "histories": self.histories,
            "experiment": self.experiment,
        }

    def ask(self, text: str, option: str) -> Criterion:
        """Return a criterion of the user, and collect the outputs that it looks at.

        Raises:
            UsageError: it is bad; the option names where it stands.
        """
        outputs = {name: v for name, v in self.variables.items() if v.causality == "output"}
        names = [quantity.name for quantity in self.quantities]
        criterion = parse_criterion(text, outputs, names, option=option)
        self.asked = list(dict.fromkeys([*self.asked, *criterion.outputs]))
        has_ratio = any(name.endswith(".load_ratio") for name in criterion.outputs)
        if has_ratio and not self.base["mechanism"].get("limits"):
            warn(
                f"{option} '{text}': the mechanism has no rated loads (member 'limits'), so"
                " load_ratio is always 0: compare loads, for example compression < 1000"
            )
        return criterion

    def collect_like(self, outcomes: list[str]) -> None:
        """Collect what a journal holds, if that has all that is asked for."""
        if set(self.asked) <= set(outcomes):
            self.asked = outcomes

    def name_values(self, values: tuple[Value, ...], result: Result) -> dict[str, Any]:
        """Return the quantities of a case that was done and its outputs at the end, by name."""
        names = (quantity.name for quantity in self.quantities)
        varied = zip(names, values, strict=True)
        return {**dict(zip(self.asked, result.outputs, strict=True)), **dict(varied)}

    def is_scene_key(self, name: str) -> bool:
        """Return whether a name is a key of the scene; if not, it is a start value of the FMU."""
        return name in scene_members() or name.startswith(OPEN_KEYS)

    def resolve(self, values: tuple[Value, ...]) -> tuple[dict, dict[str, Any]]:
        """Return the scene of a case, vehicles not placed, and its other start values.

        Raises:
            UsageError: the scene refuses these values.
        """
        scene: list[str] = []
        starts: dict[str, Any] = {}
        for name, setting in self.list_settings(values).items():
            if self.is_scene_key(name):
                scene.append(as_setting(name, setting))
            else:
                starts[name] = setting
        return self._reader.resolve(scene), self._as_types(starts)

    def find_key(self, values: tuple[Value, ...]) -> bytes | None:
        """Return a digest of what a case runs: its scene and start values; None: it is refused.

        Cases of other values may run the same, such as other directions of an offset of 0.
        """
        try:
            content = json.dumps(self.resolve(values))
        except UsageError:
            return None
        return hashlib.blake2b(content.encode(), digest_size=12).digest()

    @property
    def scene_reference(self) -> str:
        """Name or path of the scene, as commands take it."""
        reference = self._sweep.document["scene"]
        return shown(self._sweep.scene) if reference.endswith(".toml") else reference

    def read_own_mechanisms(self) -> dict[str, str]:
        """Return the mechanism files next to the scene that cases use, by name: their texts."""
        names = {self.base["mechanism"]["name"]}
        for number, quantity in enumerate(self._sweep.quantities):
            for value in self._sweep.cases.list_examples(number):
                names |= {quantity.settings(value).get("mechanism.name")} - {None}
        files = {name: self._sweep.scene.parent / f"{name}.json" for name in sorted(names)}
        return {name: read_text(f) for name, f in files.items() if is_file(f)}

    def list_settings(self, values: tuple[Value, ...]) -> dict[str, Any]:
        """Return all in which a case differs from the scene: scene keys and start values."""
        settings = dict(self._sweep.document["set"])
        for quantity, value in zip(self.quantities, values, strict=True):
            settings |= quantity.settings(value)
        return {each: value for name, value in settings.items() for each in self._match(name)}

    def _list_keys_like(self, name: str) -> list[str]:
        """Return the keys of the scene that a name means; none: it means start values alone."""
        if self.is_scene_key(name):
            return [name]
        return [key for key in self._reader.list_keys() if "*" in name and fits(key, name)]

    def _match(self, name: str) -> list[str]:
        """Return keys of the scene and start values that a name with ``*`` means."""
        if "*" not in name or self.is_scene_key(name):  # paths expand where their scene is read
            return [name]
        if name not in self._matches:
            settable = [n for n, v in self.variables.items() if v.start is not None]
            known = dict.fromkeys([*self._reader.list_keys(), *settable])
            place = f"{shown(self._sweep.path)}: '{name}'"
            self._matches[name] = match_names(name, known, place)
        return self._matches[name]

    def _check_decided_once(self) -> None:
        """Refuse names with ``*`` that mean what another entry decides."""
        owners: dict[str, str] = {}
        for given in self._sweep.document["set"]:
            for name in self._match(given):
                if name in owners:
                    raise UsageError(
                        f"{shown(self._sweep.path)}: set decides '{name}' twice, by '{given}', too"
                    )
                owners[name] = "set"
        for number, quantity in enumerate(self._sweep.quantities):
            values = self._sweep.cases.list_examples(number)
            decided = {name: "" for value in values for name in quantity.settings(value)}
            for name in {each: "" for given in decided for each in self._match(given)}:
                where = f"vary '{quantity.name}'"
                if name in owners:
                    raise UsageError(
                        f"{shown(self._sweep.path)}: {where} varies '{name}', which {owners[name]}"
                        " decides already"
                    )
                owners[name] = where

    def list_points(self, document: dict) -> np.ndarray:
        """Return the communication points of a case with this scene [s]."""
        experiment = {**document["experiment"], **self.experiment}
        return list_points(*(float(experiment[name]) for name in ("start", "stop", "step")))

    def list_not_seen(self) -> list[str]:
        """Return sentences on what the cases do not see: they end before their scene does."""
        texts = [say_not_seen(float(self.times[-1]), float(self.base["experiment"]["stop"]))]
        if (patience := self.experiment.get("end_after_outcome")) is not None:
            texts.append(
                f"not seen: a case ends {patience:g} s after its outcome is final, and later steps"
                " of the sequence are not judged"
            )
        return [text for text in texts if text]

    def plan(self, values: tuple[Value, ...]) -> Plan:
        """Plan one case for a worker with its FMU. Raises UsageError like `resolve`."""
        document, starts = self.resolve(values)
        warning = find_placement(document, self._sweep.scene)
        reported = {**self._as_types(self._differences(document)), **starts}
        job = Job(
            tuple(reported.items()),
            tuple(self.asked),
            tuple(self.histories),
            self.experiment.get("stop"),
            self.experiment.get("step"),
            self.experiment.get("end_after_outcome"),
            list_final_outcomes(),
            warning or None,
        )
        return Plan(self._key(document), job)

    def _build(self, key: str) -> tuple[str, bytes]:
        """Do the work of `fmu`."""
        with scratch() as folder:
            path = folder / "sweep.fmu"
            write_fmu(json.loads(key), self._sweep.scene, path, kernel=False, bare=True)
            fmu = path.read_bytes()
        self.built += 1
        return _hash(fmu), fmu

    def make_command(self, values: tuple[Value, ...], end: float) -> list[str]:
        """Return the words of the command that runs one case by itself."""
        settings = self.list_settings(values)
        words = ["dockloop", "run", self.scene_reference]
        for name, value in settings.items():
            words += ["--scene" if self.is_scene_key(name) else "--set", as_setting(name, value)]
        step = settings.get("experiment.step", self.base["experiment"]["step"])
        step = self.experiment.get("step", step)
        return [*words, "--stop", repr(float(end)), "--step", repr(step)]

    def without_folder(self, text: str) -> str:
        """Return a sentence that names the scene file wherever one stands."""
        return text.replace(shown(self._sweep.scene), self._sweep.scene.name)

    def _key(self, document: dict) -> str:
        """Return the document of the FMU for this one: what can be set is as in the base."""
        common = json.loads(json.dumps(document))
        for section, name in self._settable(document):
            common[section][name] = self.base[section][name]
        common["initial"] = {
            **self.base["initial"],
            **{name: document["initial"][name] for name in _PLACED},
        }
        return json.dumps(common)

    def _settable(self, document: dict) -> Iterator[tuple[str, str]]:
        """Yield the members of a document that the FMU of the base takes as start values."""
        for (section, member), variable in _SETTABLE.items():
            both = (self.base.get(section, {}), document.get(section, {}))
            known = variable in self.variables or f"{variable}[1]" in self.variables
            if known and all(member in group for group in both):
                yield section, member

    def _differences(self, document: dict) -> dict[str, Any]:
        """Return what the FMU of `_key(document)` must receive to be that of the document."""
        reported: dict[str, Any] = {}
        for section, member in self._settable(document):
            value, variable = document[section][member], _SETTABLE[section, member]
            if value == self.base[section][member]:
                continue
            if isinstance(value, list):
                reported |= {f"{variable}[{i}]": entry for i, entry in enumerate(value, 1)}
            else:
                reported[variable] = value
        return reported

    def _as_types(self, starts: dict[str, Any]) -> dict[str, Any]:
        types = {}
        for name, value in starts.items():
            variable = self.variables[name]
            is_name = isinstance(value, str)
            number = find_number(name, variable.description, value) if is_name else value
            types[name] = TYPES[variable.type](number)
        return types

    def _check_quantity(self, quantity: Quantity, values: list[Value]) -> None:
        """Check the names of what varies, and one value of each kind."""
        if quantity.named is None:
            examples = {value if isinstance(value, str) else type(value): value for value in values}
            self._check_name(quantity.name, "vary", examples.values())
            return
        if quantity.name in self.variables or self.is_scene_key(quantity.name):
            raise UsageError(
                f"{shown(self._sweep.path)}: vary '{quantity.name}': is the column of the names of"
                " cases: choose a name that no key and no variable has"
            )
        for case, settings in quantity.named.items():
            for name, value in settings.items():
                self._check_name(name, f"vary '{quantity.name}', case '{case}':", [value])

    def _check_name(self, name: str, where: str, values: Any) -> None:
        """Check that there is something of this name that takes values of this kind."""
        place = f"{shown(self._sweep.path)}: {where} '{name}'"
        if self.is_scene_key(name):
            placed = name.startswith("initial.") and name.split(".")[1] not in ("at", *_PLACED)
            if (
                placed
                and where.startswith("vary")
                and self.base["initial"]["at"] != "first_contact"
            ):
                raise UsageError(f"{place}: has no effect while initial.at is not 'first_contact'")
            return
        if "*" in name:
            for each in self._match(name):
                self._check_name(each, where, values)
            return
        variable = self.variables.get(name)
        if variable is None:
            near = did_you_mean(name, [*scene_members(), *self.variables])
            raise UsageError(
                f"{place}: is neither a key of the scene nor a variable of its FMU{near}"
            )
        if variable.start is None:
            raise UsageError(f"{place}: is computed by the FMU and has no start value")
        names = list_names(name, variable.description)
        for value in values:
            if isinstance(value, str) and names:
                try:
                    find_number(name, variable.description, value)
                except UsageError as error:
                    raise UsageError(f"{shown(self._sweep.path)}: {where} {error}") from None
            elif not is_of_type(value, variable.type):
                wanted = f"one of {', '.join(names)}" if names else WORDS[variable.type]
                raise UsageError(f"{place}: takes {value!r}: must be {wanted}")

    def with_unit(self, quantity: Quantity) -> Quantity:
        """Fill in a unit that the sweep file leaves out."""
        name, unit = quantity.name, quantity.unit
        first = self._match(name)[0]
        section, _, member = first.partition(".")
        variable = self.variables.get(_SETTABLE.get((section, member), first))
        if not unit and variable is not None:
            unit = variable.unit
        if not unit:
            unit = scene_members().get(first, {}).get("unit", "")
        return Quantity(name, unit, quantity.named)

    def _find_outcomes(self) -> list[str]:
        """Return the outputs to collect, checked against those of the FMU."""
        outputs = [v.name for v in self.variables.values() if v.causality == "output"]
        document, place = self._sweep.document, shown(self._sweep.path)
        chosen = document.get("outcomes", [name for name in _list_outcomes() if name in outputs])
        placed = [each for name in chosen for each in list_with_places(name) if each in outputs]
        for name in chosen:
            if name not in outputs:
                near = did_you_mean(name, outputs)
                raise UsageError(
                    f"{place}: outcomes lists '{name}', which is no output of the FMU of"
                    f" {shown(self._sweep.scene)}{near}"
                )
        if not chosen:
            raise UsageError(f"{place}: outcomes must list some: the scene has none of the usual")
        if document.get("worst", chosen[0]) not in chosen:
            raise UsageError(
                f"{place}: worst is '{document['worst']}': must be one of the outcomes"
                f"{did_you_mean(document['worst'], chosen)}"
            )
        if "end_after_outcome" in document["experiment"] and "outcome" not in outputs:
            raise UsageError(
                f"{place}: experiment.end_after_outcome needs the output 'outcome' (group phase)"
            )
        return list(dict.fromkeys(placed))

    def _find_histories(self) -> list[str]:
        """Return the outputs that are kept at every point: names, vectors, names with ``*``."""
        outputs = [v.name for v in self.variables.values() if v.causality == "output"]
        place = f"{shown(self._sweep.path)}: histories"
        found: dict[str, None] = {}
        for name in self._sweep.document.get("histories", []):
            entry = re.compile(re.escape(name) + r"(\[\d+\])?")
            meant = [output for output in outputs if entry.fullmatch(output)]
            if "*" in name:
                meant = match_names(name, outputs, place)
            if not meant:
                raise UsageError(
                    f"{place} lists '{name}', which is no output of the FMU of"
                    f" {shown(self._sweep.scene)}{did_you_mean(name, outputs)}"
                )
            found |= dict.fromkeys(meant)
        return list(found)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
