"""From the values of a case to what runs it: a scene and start values.

Names are checked once, against the members of scenes and the variables of the core.
"""

import copy
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from dockloop.base.errors import DockloopError, UsageError, did_you_mean, warn_once
from dockloop.base.number import as_number
from dockloop.base.paths import is_file, next_to, read_text, shown
from dockloop.base.units import find_factor
from dockloop.base.version import __version__
from dockloop.fmu.binaries import find_libraries
from dockloop.native.core import core_errors, list_loads, name_source, to_json
from dockloop.native.variables import (
    TYPES,
    WORDS,
    find_number,
    is_of_type,
    list_names,
    list_outputs,
    match_names,
    read_variables,
)
from dockloop.result.capture import list_needed
from dockloop.result.criteria import Criterion, parse_criterion, say_not_seen
from dockloop.result.limits import EXCEEDED
from dockloop.result.peaks import list_with_places
from dockloop.result.recording import Result as Recording
from dockloop.result.recording import find_vector
from dockloop.result.run_errors import is_figure
from dockloop.runs.assured import check_assurable, list_recorded
from dockloop.runs.docking import run
from dockloop.runs.outcome import Result
from dockloop.scene.blame import find_guilty
from dockloop.scene.placement import find_idleness, find_placement
from dockloop.scene.resolve import SceneReader, find_key, is_scene_key, scene_members
from dockloop.scene.values import as_setting
from dockloop.sweeps.cases import Job, list_case_points
from dockloop.sweeps.journal import make_digest
from dockloop.sweeps.sampling import Quantity, Sweep, Value

_TRIED = 9  # cases that show whether all share a fault


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
        assured: those of them, and of criteria, that each case is assured in
            (`dockloop.runs.assured`); None: cases run once.
        asked: these, what explains why there was no capture, and limits that were passed.
        histories: names of the outputs whose time histories are kept.
        variables: of a docking of `base`, by name.
        model_digest: SHA-256 of `base` and of the libraries that an FMU of it would hold.
        experiment: ``stop``, ``step``, ``end_after_outcome`` [s], those that the sweep gives.
        times: communication points of a case that runs to its stop.
        digest: of all that the user decides: scene, what is set and varies, cases, outcomes.
    """

    def __init__(self, sweep: Sweep) -> None:
        """Read the base scene and check all names of the sweep against its variables."""
        self._sweep = sweep
        self.experiment = sweep.document["experiment"]
        self._matches: dict[str, list[str]] = {}
        fixed = sweep.document["set"]
        self._reader = SceneReader(sweep.scene)
        like = self._reader.list_keys_like
        pairs = ((name, n, value) for n, value in fixed.items() for name in like(n))
        texts = {as_setting(name, value): sweep.name_setting(n) for name, n, value in pairs}
        self.base = self._reader.resolve([*texts], texts, self._place)
        libraries = {name: _hash(file.read_bytes()) for name, file in find_libraries().items()}
        self.model_digest = _hash(json.dumps([self.base, libraries]).encode())
        for name, value in fixed.items():
            self._check_name(name, "set", [value])
        for number, quantity in enumerate(sweep.quantities):
            self._check_quantity(quantity, sweep.cases.list_examples(number))
        self._check_decided_once()
        self.quantities = [self.with_unit(quantity) for quantity in sweep.quantities]
        self.quantities = [self._convert(quantity) for quantity in self.quantities]
        self.varied = self.quantities[: -1 if sweep.passes else None]
        self._check_shared()
        self.outcomes = self._find_outcomes()
        self.histories = self._find_histories()
        self.assured: tuple[str, ...] | None = None
        if sweep.assured:
            self.check_assured()
            self.assured = tuple(filter(is_figure, self.outcomes))
        known = [v.name for v in self.variables.values() if v.causality in ("output", "parameter")]
        limits = [EXCEEDED] if EXCEEDED in known else []
        self.asked = list(dict.fromkeys([*self.outcomes, *list_needed(known), *limits]))
        self.times = list_case_points(self.base, self.experiment)
        names = [quantity.name for quantity in self.quantities]
        named = [quantity.named for quantity in self.quantities]
        passes = sweep.passes and asdict(sweep.passes)
        decided = [self.unplaced, fixed, names, named, sweep.cases.find_digest(), self.outcomes]
        decided += [self.experiment, passes, self.histories]
        decided += ["assured"] if sweep.assured else []
        self.digest = make_digest(decided)

    def _place(self, document: dict) -> None:
        """Find what is known of the base scene: as it is stated, and placed."""
        self.unplaced = copy.deepcopy(document)
        find_placement(document, self._sweep.scene)
        with core_errors(self._sweep.scene) as core:
            docking = core.Docking(to_json(document), name_source(self._sweep.scene))
            self.variables = read_variables(docking)

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
            "assured": None if self.assured is None else list(self.assured),
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
        if self.assured is not None:
            figures = filter(is_figure, criterion.outputs)
            self.assured = tuple(dict.fromkeys([*self.assured, *figures]))
        has_ratio = any(name.endswith(".load_ratio") for name in criterion.outputs)
        if has_ratio and not self.base["mechanism"].get("limits"):
            warn_once(
                f"{option} '{text}': the mechanism has no rated loads (member 'limits'), so"
                " load_ratio is always 0: compare loads, for example compression < 1000"
            )
        return criterion

    def list_outputs(self) -> list[str]:
        """Return the names of all outputs of a docking of `base`."""
        return list_outputs(self.variables)

    def check_assured(self) -> None:
        """Check with the first case that cases can be assured. Raises UsageError."""
        try:
            docking = self._start(self.list_settings(self._sweep.cases[0]))
        except DockloopError:  # becomes the result of this case
            return
        check_assurable(self.list_outputs(), lambda name: docking.get(docking.find([name]))[0])

    def _find_option(self, name: str) -> str | None:
        """Return the option that has set or varied this name, or names like it."""
        given = self._sweep.given_by
        return given.get(name) or next(
            (given[like] for like in given if "*" in like and name in self._match(like)), None
        )

    def _check_shared(self) -> None:
        """Refuse what no docking starts with and all cases share: some of them say the same."""
        fixed = self._expand(self._sweep.document["set"])
        said, cases = self._refuse(fixed), self._sweep.cases
        rows = sorted({k * (len(cases) - 1) // (_TRIED - 1) for k in range(_TRIED)})
        if said and all(said == self._refuse(self.list_settings(cases[row])) for row in rows):
            raise UsageError(self._blame(fixed, said))

    def explain_refusal(self, values: tuple[Value, ...]) -> str:
        """Return why a case does not start, after the option to blame; empty: it does."""
        settings = self.list_settings(values)
        try:
            self._resolve(settings)  # what the scene refuses begins with the option already
        except UsageError as error:
            return str(error)
        said = self._refuse(settings)
        return said and self._blame(settings, said)

    def _blame(self, settings: Mapping[str, Any], said: str) -> str:
        """Return what is said of settings, after the one to blame."""
        guilty = find_guilty(
            [*settings], lambda names: self._refuse({name: settings[name] for name in names})
        )
        if guilty is None:
            return f"{shown(self._sweep.scene)}: {said}"
        fixed = self._sweep.document["set"]
        given = next((name for name in fixed if guilty in self._match(name)), guilty)
        return f"{self._find_option(guilty) or self._sweep.name_setting(given)}: {said}"

    def _refuse(self, settings: Mapping[str, Any]) -> str:
        """Return what is said of settings with which a docking does not start."""
        try:
            self._start(settings)
        except DockloopError as error:
            return str(error) if isinstance(error, UsageError) else ""
        return ""

    def _start(self, settings: Mapping[str, Any]) -> Any:
        """Return a docking of the core that has started. Raises DockloopError."""
        document, starts = self._resolve(settings)
        with core_errors() as core:
            docking = core.Docking(to_json(document), name_source(self._sweep.scene), place=True)
            docking.set(docking.find([*starts]), [float(value) for value in starts.values()])
            docking.start()
        return docking

    def collect_like(self, outcomes: list[str]) -> None:
        """Collect what a journal holds, if that has all that is asked for."""
        if set(self.asked) <= set(outcomes):
            self.asked = outcomes

    def name_values(self, values: tuple[Value, ...], result: Result) -> dict[str, Any]:
        """Return the quantities of a case that was done and its outputs at the end, by name."""
        names = (quantity.name for quantity in self.quantities)
        varied = zip(names, values, strict=True)
        return {**dict(zip(self.asked, result.outputs, strict=True)), **dict(varied)}

    def resolve(self, values: tuple[Value, ...]) -> tuple[dict, dict[str, Any]]:
        """Return the scene of a case, vehicles not placed, and its other start values.

        Raises:
            UsageError: the scene refuses these values.
        """
        return self._resolve(self.list_settings(values))

    def _resolve(self, settings: Mapping[str, Any]) -> tuple[dict, dict[str, Any]]:
        keys, starts = _split(settings)
        scene = {as_setting(name, value): self._find_option(name) for name, value in keys.items()}
        begins = {text: option for text, option in scene.items() if option}
        try:
            return self._reader.resolve([*scene], begins), self._as_types(starts)
        except UsageError as error:
            raise UsageError(
                str(error).replace(shown(self._sweep.scene), self._sweep.scene.name)
            ) from None

    def record(self, values: tuple[Value, ...], end: float) -> Recording:
        """Run a case again up to `end` [s], and record everything. Raises like `resolve`."""
        keys, starts = self.split_settings(values)
        return run(self._sweep.scene, keys, starts, stop=end, step=self._find_step(keys))

    def find_key(self, values: tuple[Value, ...]) -> bytes | None:
        """Return a digest of what a case runs: its scene and start values; None: it is refused.

        Cases of other values may run the same, such as other directions of an offset of 0.
        """
        keys, starts = self.split_settings(values)
        texts = [as_setting(name, value) for name, value in keys.items()]
        try:
            content = json.dumps((self._reader.apply(texts), self._as_types(starts)))
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
        files = {name: next_to(self._sweep.scene, f"{name}.json") for name in sorted(names)}
        return {name: read_text(f) for name, f in files.items() if is_file(f)}

    def list_settings(self, values: tuple[Value, ...]) -> dict[str, Any]:
        """Return all in which a case differs from the scene: scene keys and start values."""
        settings = dict(self._sweep.document["set"])
        for quantity, value in zip(self.quantities, values, strict=True):
            settings |= quantity.settings(value)
        return self._expand(settings)

    def _expand(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        return {each: value for name, value in settings.items() for each in self._match(name)}

    def split_settings(self, values: tuple[Value, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the scene keys of `list_settings`, and its start values."""
        return _split(self.list_settings(values))

    def _find_step(self, keys: dict[str, Any]) -> float:
        """Return the communication step of a case with these keys of the scene [s]."""
        own = keys.get("experiment.step", self.base["experiment"]["step"])
        return self.experiment.get("step", own)

    def _match(self, name: str) -> list[str]:
        """Return keys of the scene and start values that a name with ``*`` means."""
        if "*" not in name or is_scene_key(name):  # paths expand where their scene is read
            return [name]
        if name not in self._matches:
            settable = [n for n, v in self.variables.items() if v.start is not None]
            known = dict.fromkeys([*self._reader.list_keys(), *settable])
            self._matches[name] = match_names(name, known, self._sweep.name_setting(name))
        return self._matches[name]

    def _check_decided_once(self) -> None:
        """Refuse names with ``*`` that mean what another entry decides."""
        owners: dict[str, str] = {}
        for given in self._sweep.document["set"]:
            for name in self._match(given):
                if name in owners:
                    begin = self._sweep.name_setting(given)
                    raise UsageError(f"{begin}: '{name}' is given twice, by {owners[name]} too")
                owners[name] = self._sweep.given_by.get(given, f"set '{given}'")
        for number, quantity in enumerate(self._sweep.quantities):
            values = self._sweep.cases.list_examples(number)
            decided = {name: "" for value in values for name in quantity.settings(value)}
            for name in {each: "" for given in decided for each in self._match(given)}:
                if name in owners:
                    begin = self._sweep.name_setting(quantity.name)
                    raise UsageError(
                        f"{begin}: varies '{name}', which {owners[name]} decides already"
                    )
                owners[name] = self._sweep.given_by.get(quantity.name, f"vary '{quantity.name}'")

    def list_not_seen(self) -> list[str]:
        """Return sentences on what the cases do not see: they end before their scene does."""
        texts = [say_not_seen(float(self.times[-1]), float(self.base["experiment"]["stop"]))]
        if (patience := self.experiment.get("end_after_outcome")) is not None:
            texts.append(
                f"not seen: a case ends {patience:g} s after its outcome is final, and later steps"
                " of the sequence are not judged"
            )
        return [text for text in texts if text]

    def make_job(self, engine: str) -> Job:
        """Return what all cases have in common: ``core`` or ``fmu`` runs them."""
        whole = (name for name in self.asked if self.variables[name].type != "Real")
        needed = [] if self.assured is None else list_recorded(self.list_outputs(), self.assured)
        return Job(
            engine,
            Path(f"{self.base['name']}.toml"),
            tuple(self.asked),
            frozenset(whole),
            tuple(self.histories),
            self.experiment,
            self.assured,
            tuple(needed),
        )

    def make_command(self, values: tuple[Value, ...], end: float) -> list[str]:
        """Return the words of the command that runs one case by itself."""
        settings = self.list_settings(values)
        words = ["dockloop", "run", self.scene_reference]
        for name, value in settings.items():
            words += ["--scene" if is_scene_key(name) else "--set", as_setting(name, value)]
        words += ["--stop", repr(float(end)), "--step", repr(self._find_step(settings))]
        return [*words, *([] if self.assured is None else ["--assured"])]

    def _as_types(self, starts: dict[str, Any]) -> dict[str, Any]:
        types = {}
        for name, value in starts.items():
            variable = self.variables[name]
            is_name = isinstance(value, str)
            number = find_number(name, variable.description, value) if is_name else value
            kind = TYPES[variable.type]
            types[name] = as_number(number) if kind is float else kind(number)
        return types

    def _check_quantity(self, quantity: Quantity, values: list[Value]) -> None:
        """Check the names of what varies, and one value of each kind."""
        if quantity.named is None:
            examples = {value if isinstance(value, str) else type(value): value for value in values}
            self._check_name(quantity.name, "vary", examples.values())
            return
        if quantity.name in self.variables or is_scene_key(quantity.name):
            raise UsageError(
                f"{shown(self._sweep.path)}: vary '{quantity.name}': is the column of the names of"
                " cases: choose a name that no key and no variable has"
            )
        for case, settings in quantity.named.items():
            for name, value in settings.items():
                where = f"the table {quantity.file} has" if quantity.file else None
                where = where or f"vary '{quantity.name}', case '{case}':"
                self._check_name(name, where, [value])

    def _check_name(self, name: str, where: str, values: Any) -> None:
        """Check that there is something of this name that takes values of this kind."""
        place = self._sweep.name_setting(name, where)
        if is_scene_key(name):
            if where.startswith("vary") and (why := find_idleness(name, self.base)):
                raise UsageError(f"{place}: has {why}")
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
                    said = str(error).removeprefix(f"'{name}' ")
                    raise UsageError(f"{place}: {said}") from None
            elif not is_of_type(value, variable.type):
                wanted = f"one of {', '.join(names)}" if names else WORDS[variable.type]
                raise UsageError(f"{place}: takes {value!r}: must be {wanted}")

    def with_unit(self, quantity: Quantity) -> Quantity:
        """Fill in a unit that the sweep file leaves out. Raises UsageError: it is another one."""
        name, unit = quantity.name, quantity.unit
        first = self._match(name)[0]
        variable = self.variables.get(first)
        own = variable.unit if variable is not None else ""
        own = own or (find_key(first) or {}).get("unit", "")
        if unit and own and unit != own and find_factor(unit, own) != 1.0:
            raise UsageError(
                f"{shown(self._sweep.path)}: the unit of '{name}' is '{unit}': must be {own};"
                " values are not converted"
            )
        return replace(quantity, unit=unit or own)

    def _convert(self, quantity: Quantity) -> Quantity:
        """Return named cases in the units of their keys and variables."""
        if quantity.named is None or not quantity.units:
            return quantity
        factors: dict[str, float] = {}
        for name, unit in quantity.units.items():
            own = self.with_unit(Quantity(name, "")).unit
            factor = find_factor(unit, own) if own else None
            if factor is None:
                wanted = f"must be in a unit of {own}" if own else "leave the unit out"
                place = quantity.file or shown(self._sweep.path)
                raise UsageError(f"{place}: '{name}' is in '{unit}': {wanted}")
            factors[name] = factor

        def convert(name: str, value: Value) -> Value:
            factor = factors.get(name, 1.0)
            return value if factor == 1.0 or isinstance(value, bool | str) else factor * value

        named = {
            case: {name: convert(name, value) for name, value in settings.items()}
            for case, settings in quantity.named.items()
        }
        return replace(quantity, named=named)

    def _find_outcomes(self) -> list[str]:
        """Return the outputs to collect, checked against those of the FMU."""
        outputs = list_outputs(self.variables)
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
        outputs = list_outputs(self.variables)
        place = f"{shown(self._sweep.path)}: histories"
        found: dict[str, None] = {}
        for name in self._sweep.document.get("histories", []):
            meant = [output for output in outputs if name in (output, find_vector(output))]
            if "*" in name:
                meant = match_names(name, outputs, place)
            if not meant:
                raise UsageError(
                    f"{place} lists '{name}', which is no output of the FMU of"
                    f" {shown(self._sweep.scene)}{did_you_mean(name, outputs)}"
                )
            found |= dict.fromkeys(meant)
        return list(found)


def _split(settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return keys of the scene and start values."""
    keys = {name: value for name, value in settings.items() if is_scene_key(name)}
    return keys, {name: value for name, value in settings.items() if name not in keys}


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
