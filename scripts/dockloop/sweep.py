"""Runs many dockings: plans the cases, runs them by one of two engines, keeps every result at once.

Planning a case means resolving the scene with its values. The engine ``core`` gets what differs
from the scene of the sweep (`dockloop.batch`). For the engine ``fmu`` vehicles are placed here, by
dockloop-core, so that Dask workers need neither core nor scene. What an FMU can be told by start
values is told that way, so that cases share one FMU; it is built once per combination of all other
scene keys. Results, journal and table are the same for both.

Results are appended to a journal (JSON lines) as they arrive, in any order. ``--resume`` reads it
back and runs what is missing: a case is known by its values, not by its number, so that a sweep may
also be continued with more cases.
"""

import copy
import hashlib
import json
import logging
import os
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dockloop import __version__
from dockloop.batch import make_patch, run_batch
from dockloop.capture import list_needed
from dockloop.cases import Job, Result, run_case, say_version
from dockloop.errors import DockloopError, UsageError, did_you_mean
from dockloop.fmu import find_placement, write_fmu
from dockloop.journal import InterruptedWorkError, Journal, find_digests, make_digest, make_report
from dockloop.outputs import Kind, claim, scratch
from dockloop.paths import shown
from dockloop.sampling import Quantity, Sweep, Value, as_setting
from dockloop.scene import SceneReader, scene_keys
from dockloop.simulate import ProgressBar, communication_points, unpack_fmu

COMMAND = "dockloop sweep"
DIGEST = "dockloop.digest"  # of a sweep, in the metadata of its table

# Members of a resolved scene that an FMU takes as start values, with the names of their variables.
_SETTABLE = {
    **{
        (vehicle, member): f"{vehicle}.{member}"
        for vehicle in ("chaser", "target")
        for member in (
            *("position", "velocity", "attitude", "angular_velocity"),
            *("mass", "mass_includes_mechanism"),
            *("contact_thrust", "contact_thrust_delay"),
        )
    },
    ("contact", "friction_coefficient"): "friction.coefficient",
}
_PLACED = ("capture_body", "joints")  # of [initial], all that the FMU reads itself
_OUTCOMES = (
    *("outcome", "time_of_contact", "time_of_capture"),
    *(f"capture.peak.{load}" for load in ("compression", "tension", "shear", "bending", "torsion")),
    *("capture.peak.load_ratio", "energy.residual"),
)
_UNITS = {"_deg_s": "deg/s", "_deg": "deg", "_speed": "m/s", "_offset": "m", "_time": "s"}
_KEPT_FMUS = 16  # that cases of a sweep share at a time
_AHEAD = 4  # cases planned per thread of the cluster


@dataclass(frozen=True)
class Plan:
    """A case that can be sent to a worker.

    Attributes:
        fmu: key of its FMU, for `Planner.fmu`.
        job: what to do with it.
        warning: what the placement had to say.
    """

    fmu: str
    job: Job
    warning: str | None


class Planner:
    """Turns the values of a case into what an engine runs.

    Attributes:
        unplaced: the resolved scene with ``[set]``, before anything varies.
        base: the same with both vehicles at their start.
        base_key: key of its FMU.
        quantities: what varies, with units.
        outcomes: names of the outputs to collect.
        asked: these, and what explains why there was no capture.
        variables: of the FMU of `base`, by name.
        base_digest: SHA-256 of that FMU.
        experiment: ``stop``, ``step``, ``end_after_outcome`` [s], those that the sweep gives.
        built: number of FMUs built so far.
        times: communication points of a case that runs to its stop.
        digest: of all that the user decides: scene, what is set and varies, cases, outcomes.
    """

    def __init__(self, sweep: Sweep) -> None:
        """Build the FMU of the base scene and check all names of the sweep against it."""
        self._sweep = sweep
        self.experiment = sweep.document["experiment"]
        self._keys = set(scene_keys())
        self._fmus: OrderedDict[str, tuple[str, bytes]] = OrderedDict()
        self.built = 0
        fixed = sweep.document["set"]
        self._fixed_scene = [as_setting(n, v) for n, v in fixed.items() if self.is_scene_key(n)]
        self._fixed_starts = {n: v for n, v in fixed.items() if not self.is_scene_key(n)}
        self._reader = SceneReader(sweep.scene)
        self.unplaced = self._reader.resolve(self._fixed_scene)
        self.base = copy.deepcopy(self.unplaced)
        find_placement(self.base, sweep.scene)
        self.base_key = json.dumps(self.base)
        self.base_digest, fmu = self.fmu(self.base_key)
        description = _read_description(fmu)
        self.variables = {v.name: v for v in description.modelVariables}
        for name, value in fixed.items():
            self._check_name(name, "set", [value])
        for number, quantity in enumerate(sweep.quantities):
            examples = {type(case[number]): case[number] for case in sweep.cases}
            self._check_name(quantity.name, "vary", examples.values())
        self.quantities = [self._with_unit(quantity) for quantity in sweep.quantities]
        self.outcomes = self._find_outcomes()
        outputs = [v.name for v in self.variables.values() if v.causality == "output"]
        self.asked = list(dict.fromkeys([*self.outcomes, *list_needed(outputs)]))
        self.times = communication_points(
            description, self.experiment.get("stop"), self.experiment.get("step")
        )
        names = [quantity.name for quantity in self.quantities]
        decided = [self.unplaced, fixed, names, sweep.cases, self.outcomes, self.experiment]
        self.digest = make_digest(decided)

    def is_scene_key(self, name: str) -> bool:
        """Tell whether a name is a key of the scene; if not, it is a start value of the FMU."""
        return name in self._keys or name.startswith(("mechanism.set.", "initial.joints."))

    def plan(self, values: tuple[Value, ...]) -> Plan:
        """Plan one case for a worker with its FMU.

        Raises:
            UsageError: the scene refuses these values.
        """
        document, starts = self._resolve(values)
        warning = find_placement(document, self._sweep.scene)
        key = self._key(document)
        told = {**self._differences(document), **starts}
        job = Job(
            tuple(self._as_types(told).items()),
            tuple(self.asked),
            self.experiment.get("stop"),
            self.experiment.get("step"),
            self.experiment.get("end_after_outcome"),
        )
        return Plan(key, job, warning or None)

    def plan_batch(self, values: tuple[Value, ...]) -> dict:
        """Plan one case for ``dockloop-core batch``. Raises UsageError like `plan`."""
        document, starts = self._resolve(values)
        return {"scene": make_patch(self.unplaced, document), "set": self._as_types(starts)}

    def fmu(self, key: str) -> tuple[str, bytes]:
        """Return the SHA-256 and the bytes of the FMU of a key; builds it if it is not at hand."""
        if key not in self._fmus:
            with scratch() as folder:
                path = folder / "sweep.fmu"
                write_fmu(json.loads(key), self._sweep.scene, path, kernel=False, bare=True)
                fmu = path.read_bytes()
            self._fmus[key] = (hashlib.sha256(fmu).hexdigest(), fmu)
            self.built += 1
            if len(self._fmus) > _KEPT_FMUS:
                self._fmus.popitem(last=False)
        self._fmus.move_to_end(key)
        return self._fmus[key]

    def make_command(self, values: tuple[Value, ...], end: float) -> list[str]:
        """Return the words of the command that runs one case by itself."""
        names = [quantity.name for quantity in self.quantities]
        settings = {**self._sweep.document["set"], **dict(zip(names, values, strict=True))}
        words = ["dockloop", "run", self._sweep.document["scene"]]
        if self._sweep.document["scene"].endswith(".toml"):
            words[-1] = shown(self._sweep.scene)
        for name, value in settings.items():
            words += ["--scene" if self.is_scene_key(name) else "--set", as_setting(name, value)]
        step = self.experiment.get("step", self.base["experiment"]["step"])
        return [*words, "--stop", repr(float(end)), "--step", repr(step)]

    def without_folder(self, text: str) -> str:
        """Return a sentence that names the scene file wherever one stands."""
        return text.replace(shown(self._sweep.scene), self._sweep.scene.name)

    def _resolve(self, values: tuple[Value, ...]) -> tuple[dict, dict[str, Value]]:
        """Return the scene of a case, vehicles not placed, and its other start values."""
        scene, starts = list(self._fixed_scene), dict(self._fixed_starts)
        for quantity, value in zip(self.quantities, values, strict=True):
            if self.is_scene_key(quantity.name):
                scene.append(as_setting(quantity.name, value))
            else:
                starts[quantity.name] = value
        return self._reader.resolve(scene), starts

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
        """Return what the FMU of `_key(document)` must be told to be that of the document."""
        told = {}
        for section, member in self._settable(document):
            value, variable = document[section][member], _SETTABLE[section, member]
            if value == self.base[section][member]:
                continue
            if isinstance(value, list):
                told |= {f"{variable}[{i}]": entry for i, entry in enumerate(value, 1)}
            else:
                told[variable] = value
        return told

    def _as_types(self, starts: dict[str, Value]) -> dict[str, Value]:
        types = {"Real": float, "Integer": int, "Boolean": bool}
        return {name: types[self.variables[name].type](value) for name, value in starts.items()}

    def _check_name(self, name: str, where: str, values: Any) -> None:
        """Check that there is something of this name that takes values of this kind."""
        place = f"{shown(self._sweep.path)}: {where} '{name}'"
        if self.is_scene_key(name):
            placed = name.startswith("initial.") and name.split(".")[1] not in ("at", *_PLACED)
            if placed and where == "vary" and self.base["initial"]["at"] != "first_contact":
                raise UsageError(f"{place}: has no effect while initial.at is not 'first_contact'")
            return
        variable = self.variables.get(name)
        if variable is None:
            near = did_you_mean(name, [*self._keys, *self.variables])
            raise UsageError(
                f"{place}: is neither a key of the scene nor a variable of its FMU{near}"
            )
        if variable.causality not in ("parameter", "input") and variable.initial != "exact":
            raise UsageError(f"{place}: is computed by the FMU and has no start value")
        kinds = {"Real": (int, float), "Integer": (int,), "Boolean": (bool,)}[variable.type]
        for value in values:
            if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
                kind = {"Real": "a number", "Integer": "a whole number", "Boolean": "true or false"}
                raise UsageError(f"{place}: takes {value!r}: must be {kind[variable.type]}")

    def _with_unit(self, quantity: Quantity) -> Quantity:
        """Fill in a unit that the sweep file leaves out."""
        name, unit = quantity.name, quantity.unit
        section, _, member = name.partition(".")
        variable = self.variables.get(_SETTABLE.get((section, member), name))
        if not unit and variable is not None:
            unit = variable.unit or ""
        if not unit and section == "initial":
            unit = next((text for end, text in _UNITS.items() if name.endswith(end)), "")
        return Quantity(name, unit)

    def _find_outcomes(self) -> list[str]:
        """Return the outputs to collect, checked against those of the FMU."""
        outputs = [v.name for v in self.variables.values() if v.causality == "output"]
        document, place = self._sweep.document, shown(self._sweep.path)
        chosen = document.get("outcomes", [name for name in _OUTCOMES if name in outputs])
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
        return list(chosen)


def run_sweep(
    sweep: Sweep,
    output: Path,
    *,
    engine: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: ProgressBar | None = None,
) -> dict:
    """Run all cases of a sweep that are not done yet.

    Args:
        sweep: what to do.
        output: the table that will be written; the journal is beside it.
        engine: ``core``, ``fmu`` or ``auto``: the core, unless there is a scheduler.
        workers: local threads (of the core) or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with an interrupted sweep.
        progress: shows how far it is.

    Returns:
        ``planner``, ``results`` (one per case, in order), ``ran`` (cases run now), ``wall`` [s],
        ``engine`` and ``workers``.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: the engine cannot be used, or a defect showed on it.
        InterruptedWorkError: by Ctrl-C.
    """
    planner = Planner(sweep)
    setup = {
        "dockloop": __version__,
        "FMU": planner.base_digest,
        "set": sweep.document["set"],
        "quantities": [quantity.name for quantity in planner.quantities],
        "outcomes": planner.asked,
        "experiment": sweep.document["experiment"],
    }
    path = find_journal(output)
    _check_table(output, {planner.digest, *(find_digests(path) if resume else ())})
    journal = Journal(path, setup, len(sweep.cases), resume=resume, digest=planner.digest)
    missing = [values for values in dict.fromkeys(sweep.cases) if values not in journal.known]
    done = len(sweep.cases) - len(missing)
    began, threads = time.perf_counter(), 0
    if engine == "auto":
        engine = "fmu" if scheduler else "core"
    try:
        if missing and engine == "core":
            threads = _count_workers(workers, len(missing))
            report = make_report(progress, done, len(sweep.cases))
            run_batch(planner, missing, threads, journal.add, report)
        elif missing:
            with _open_cluster(workers, scheduler, len(missing)) as client:
                began = time.perf_counter()
                threads = sum(client.nthreads().values())
                report = make_report(progress, done, len(sweep.cases))
                _run_cases(client, planner, missing, journal.add, report)
    except KeyboardInterrupt:
        raise InterruptedWorkError(
            f"interrupted with {sum(case in journal.known for case in sweep.cases)} of"
            f" {len(sweep.cases)} cases in {shown(journal.path)}; the same command with --resume"
            " goes on"
        ) from None
    finally:
        journal.close()
    return {
        "planner": planner,
        "results": [journal.known[values] for values in sweep.cases],
        "ran": len(missing),
        "wall": time.perf_counter() - began,
        "engine": engine,
        "workers": threads,
    }


def find_journal(output: Path) -> Path:
    """Return where the journal beside the table of a sweep is."""
    return output.with_suffix(".jsonl")


def read_table_metadata(path: Path) -> dict[str, str]:
    """Return the metadata of a table. Raises OSError or ValueError: it is none."""
    from pyarrow import parquet

    found = parquet.read_metadata(path).metadata or {}
    return {key.decode(): value.decode() for key, value in found.items()}


TABLE = Kind("table", COMMAND, lambda path: "dockloop.sweep" in read_table_metadata(path))


def _check_table(path: Path, digests: set[str]) -> None:
    """Refuse to replace anything but the table of a sweep that has one of these digests."""
    claim(path, TABLE)
    if path.exists() and read_table_metadata(path).get(DIGEST) not in digests:
        raise UsageError(
            f"{shown(path)}: holds the finished table of another sweep (cases, scene or outcomes"
            " differ): choose another -o or delete it"
        )


def _count_workers(wanted: int | None, cases: int) -> int:
    return min(wanted or len(os.sched_getaffinity(0)), cases)


def _run_cases(
    client: Any,
    planner: Planner,
    cases: list[tuple],
    keep: Callable[[tuple, Result], None],
    report: Callable[[], None],
) -> None:
    """Plan cases, send a few more than the cluster has threads, keep what comes back.

    An FMU travels as the result of a task of its own: every worker that needs it gets it once, and
    when the workers that had it are gone the scheduler makes it again.
    """
    from distributed import as_completed

    todo, running, arriving = iter(cases), {}, as_completed()
    sent: OrderedDict[str, tuple[str, Any]] = OrderedDict()

    def submit_next() -> bool:
        for values in todo:
            try:
                plan = planner.plan(values)
                if plan.fmu not in sent:
                    digest, fmu = planner.fmu(plan.fmu)
                    sent[plan.fmu] = (digest, client.submit(bytes, fmu, key=f"fmu-{digest}"))
            except UsageError as error:
                keep(values, Result("refused", planner.without_folder(str(error))))
                report()
                continue
            sent.move_to_end(plan.fmu)
            if len(sent) > _KEPT_FMUS:
                sent.popitem(last=False)
            digest, fmu_there = sent[plan.fmu]
            future = client.submit(run_case, fmu_there, digest, plan.job, pure=False)
            running[future] = (values, plan)
            arriving.add(future)
            return True
        return False

    def fill() -> None:
        most = _AHEAD * max(1, sum(client.nthreads().values()))
        while len(running) < most and submit_next():
            pass

    fill()
    for future in arriving:
        values, plan = running.pop(future)
        result = _get_result(future)
        warnings = [text for text in (plan.warning, result.warning) if text]
        result.warning = "; ".join(warnings) or None
        keep(values, result)
        report()
        fill()


def _get_result(future: Any) -> Result:
    """Return what a worker made of a case, or say what became of the worker."""
    from distributed import CancelledError, KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        attempts = getattr(error, "allowed_failures", 0) + 1
        return Result("lost", f"{attempts} workers in turn died while they had this case")
    except (CancelledError, OSError) as error:
        raise DockloopError(
            f"the Dask scheduler is gone ({error}); the same command with --resume goes on"
        ) from None


@contextmanager
def _open_cluster(workers: int | None, scheduler: str | None, cases: int) -> Iterator[Any]:
    """Connect to a scheduler, or start local processes that end with the sweep."""
    import dask
    from distributed import Client, LocalCluster

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise DockloopError(f"--scheduler {scheduler}: cannot be reached ({error})") from None
        with client:
            _check_workers(client, scheduler)
            yield client
        return
    count = _count_workers(workers, cases)
    # A Ctrl-C reaches all processes of a terminal: workers leave it to this one.
    ignore = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    with (
        dask.config.set({"distributed.worker.preload": [ignore]}),
        scratch() as folder,
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # its page of health, unseen
            memory_limit=None,
            silence_logs=logging.CRITICAL,
            local_directory=str(folder),
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _check_workers(client: Any, scheduler: str) -> None:
    """Check that the workers of a foreign cluster have this package."""
    found: set[str] = set()
    with suppress(Exception):  # whatever it is, the sentence below says what is needed
        client.wait_for_workers(1, timeout=30)
        found = set(client.run(say_version).values())
    if found != {__version__}:
        raise DockloopError(
            f"--scheduler {scheduler}: it must have at least one worker, and all of them need the"
            f" Python package dockloop {__version__} (nothing compiled)"
        )


def _read_description(fmu: bytes) -> Any:
    """Return the model description of an FMU."""
    with scratch() as folder:
        path = folder / "sweep.fmu"
        path.write_bytes(fmu)
        return unpack_fmu(path, folder)[0]
