"""Is a run right? A docking against its reference solution and its own audits, with a verdict.

A run is *right* if every figure of `run_errors.find_figures` is within the wanted error of a tight
run of the explicit method, momentum is conserved to rounding, and the energy audit keeps what is
promised. It is *refused* if a start value or a step is refused with a reason. It is *warned* if a
figure or the energy audit is off and the run says so in a warning. It is *undetermined* if a figure
is off, but two neighbours of the reference solution (slightly other start, other tolerance, other
steps) do not agree on that figure either: it depends on the last digits, or the reference solution
is not good enough. It is *loose* if a figure, or the energy audit by less than `ENERGY`, is off,
but becomes right with a hundredth of the tolerance (a quarter of a fixed step), tried up to three
times. All else is *wrong*; *hung* (a step does not end) and *crashed* are found by
`dockloop.runs.crew`. A run whose steps all end, but not the last one in time, is *slow*: it is not
judged.

With a `host` a vehicle is integrated outside, as a co-simulation master does it: it makes every
step with the mean load of the docking's own step. The mass that the case gives is then only what
the docking receives; the vehicle, and the reference solution, have that of the scene.

A run of which no reference solution is found in time is judged by its audits alone (``audited``).
"""

import copy
import math
import re
import shlex
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dockloop.base.errors import DockloopError, one_line
from dockloop.base.sections import Section
from dockloop.base.words import LIMIT
from dockloop.fmu.ssp import take_out
from dockloop.native.core import number_choice
from dockloop.native.variables import MOTION, VEHICLES
from dockloop.result.accuracy import list_tolerances, tighten
from dockloop.result.recording import Result, list_points
from dockloop.result.run_errors import find_errors
from dockloop.runs.assured import assure
from dockloop.runs.crew import Ending
from dockloop.runs.docking import Docking, Scene
from dockloop.runs.outcome import Result as CaseResult
from dockloop.scene.values import list_settings

VERDICTS = {  # and their meanings; the order numbers them
    "right": "within what its tolerance promises of the reference solution, audits hold",
    "refused": "a start value or a step is refused, with a reason",
    "warned": "off, and the run issues a warning that says so",
    "undetermined": "off, but neighbours of the reference solution do not agree on that figure",
    "slow": "all steps end, but the run takes too long to be judged",
    "wrong": "none of the others",
    "hung": "no end within the time limit",
    "crashed": "the process died",
    "loose": "off by more than the tolerance promises, right with a tighter one",
}
BAD = ("wrong", "hung", "crashed")
NUMBERS = ("error", "energy", "momentum", "evaluations", "seconds")  # of a verdict
MEASURES = ("verdict", "audited", *NUMBERS)
_NUMBERED = tuple(VERDICTS)
REFERENCE_RTOL, NEIGHBOUR_RTOL = 1e-11, 1e-10
LEAST_SHIFT = 1e-9  # of the neighbours, relative
MOMENTUM = 1e-9  # largest momentum.residual that is rounding
ENERGY = 0.01  # of the energy in play: beyond it the run must issue a warning
ATOL_ERRORS = 100.0  # absolute tolerances of energy that a residual may have in addition
_NEIGHBOURS = (1.0, -1.0, 10.0, -10.0)  # times the shift
_AGREE = 1.0 / 3.0  # neighbours agree on a figure if it differs by this part of the wanted error
_TIGHTER = 3  # times that tighter settings are tried
_SAME_TIME = 1e-9  # s between two points that are the same one
_POINTS = 100  # communication steps of a reference solution, about
_KEPT = 24  # reference solutions that a process remembers
_DOUBTS = re.compile(  # warnings that loads or motion may be off; of vehicles: diagnoses of hosts
    "energy audit|loads may be wrong|^chaser|^target|^assured"
)
_LEAST_WORDS = 3  # of a reason


@dataclass(frozen=True)
class Case:
    """A docking to judge.

    Attributes:
        scene: name or path.
        overrides: keys of the scene.
        starts: start values of variables.
        stop: end [s]; None: that of the scene.
        wanted: relative error; None: whatever the tolerance promises (`find_promise`).
        limit: most processor time of one step, and of the whole judgement [s].
        host: vehicle that is integrated outside; empty: none.
        assured: the run is repeated until its figures are within its accuracy.
    """

    scene: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    starts: Mapping[str, Any] = field(default_factory=dict)
    stop: float | None = None
    wanted: float | None = None
    limit: float = LIMIT
    host: str = ""
    assured: bool = False

    @property
    def patience(self) -> float:
        """Most processor time of the run, and of a reference solution [s]."""
        return self.limit / 3.0

    def make_command(self) -> str:
        """Return the command that runs the docking alone."""
        words = ["dockloop", "run", self.scene]
        words += list_settings("--scene", self.overrides) + list_settings("--set", self.starts)
        words += [] if self.stop is None else ["--stop", repr(self.stop)]
        return shlex.join([*words, *(["--assured"] if self.assured else [])])


@dataclass
class Verdict:
    """What became of a case.

    Attributes:
        verdict: one of `VERDICTS`.
        reason: of a refusal, or what is off.
        audited: judged without a reference solution.
        error: largest figure; infinite for another outcome, NaN if it is not known.
        energy: largest residual over the energy in play.
        momentum: largest ``momentum.residual``.
        evaluations: of the run.
        seconds: it took.
        assured: of assured runs, as in `dockloop.runs.outcome.Result`.
    """

    verdict: str
    reason: str = ""
    audited: bool = False
    error: float = math.nan
    energy: float = math.nan
    momentum: float = math.nan
    evaluations: int = 0
    seconds: float = 0.0
    assured: dict[str, Any] | None = None

    def to_result(self) -> CaseResult:
        """Return it as a result of a case, for journals: the `MEASURES` are its outputs."""
        numbers = [getattr(self, name) for name in NUMBERS]
        outputs = (_NUMBERED.index(self.verdict), self.audited, *numbers)
        return CaseResult("done", self.reason or None, outputs=outputs, assured=self.assured)

    @staticmethod
    def from_result(result: CaseResult) -> "Verdict":
        """Return the verdict that a result holds; one that did not run was refused."""
        if result.status != "done":
            return Verdict("refused", result.reason or "")
        verdict, audited, *numbers = result.outputs
        named: dict[str, Any] = dict(zip(NUMBERS, numbers, strict=True))
        named["assured"] = result.assured
        return Verdict(_NUMBERED[int(verdict)], result.reason or "", bool(audited), **named)


def find_promise(rtol: float) -> float:
    """Return the relative error that a relative tolerance promises; 1 or more: none.

    Kinks of contact and friction keep the error from falling as fast as the tolerance.
    """
    return 30.0 * rtol**0.6


def find_verdict(ending: Ending) -> Verdict:
    """Return the verdict on a case from the ending of its process."""
    if ending.kind == "done":
        return ending.value
    if ending.value is not None:  # the run was there, its reference solution was not
        return replace(ending.value, audited=True)
    return Verdict(ending.kind, ending.reason)


class _OutOfTimeError(DockloopError):
    """A run takes too long."""


def judge(case: Case, note: Callable[[Verdict], None] = lambda _: None) -> Verdict:
    """Run a case and judge it.

    Args:
        case: the docking.
        note: receives the verdict of the audits as soon as the run is there.
    """
    began = time.process_time()
    try:
        run = _run_case(case)
    except _OutOfTimeError as slow:
        return Verdict("slow", str(slow), seconds=case.patience)
    except DockloopError as refusal:
        reason = str(refusal)
        has_words = len(reason.split()) >= _LEAST_WORDS
        return Verdict(
            "refused" if has_words else "wrong",
            reason if has_words else f"refused without a reason: {reason!r}",
            seconds=time.process_time() - began,
        )
    audited = _audit(run, time.process_time() - began)
    note(audited)
    if audited.verdict == "wrong":
        promise = _find_energy_promise(run)
        if promise < audited.energy <= ENERGY:  # beyond that a run must say so itself
            return _excuse(audited, case, run, lambda run: _find_energy_error(run) <= promise)
        return audited
    return _compare(case, run, audited)


def _run_case(case: Case) -> Result:
    """Run a docking as its case says."""
    run = _run_hosted(case) if case.host else _run(case, None, case.overrides)
    if not case.assured:
        return run

    def repeat(other: dict[str, float]) -> Result:
        return _run_case(replace(case, starts={**case.starts, **other}, assured=False))

    return assure(run, repeat)


def _run(
    case: Case,
    starts: Mapping[str, Any] | None,
    overrides: Mapping[str, Any],
    parts: int = 1,
) -> Result:
    """Run a docking: at its own communication points, or with `starts` at those of a reference.

    Args:
        case: the docking.
        starts: start values of a reference solution.
        overrides: keys of the scene.
        parts: into which each communication step of a reference solution is divided.
    """
    docking = Docking(case.scene, overrides)
    times = _list_points(case, docking)
    values = dict(case.starts)
    if starts is not None:
        times = _divide(times[0], times[-1], parts)
        values = {n: v for n, v in values.items() if not n.startswith("solver.")}
        values |= {n: v for n, v in starts.items() if n in docking.variables}
    for name, value in values.items():
        docking.set(name, value)
    until = time.process_time() + case.patience

    def watch(part: float) -> None:
        if time.process_time() > until:
            raise _OutOfTimeError(
                f"{part:.0%} of the run are done after {case.patience:g} s of processor time"
            )

    return docking.record(times, watch)


def _divide(begin: float, end: float, parts: int) -> np.ndarray:
    """Return the points of a reference solution, with others between; common ones to the bit."""
    points = np.linspace(begin, end, _POINTS + 1)
    share = np.arange(parts) / parts
    return np.append((points[:-1, None] + np.diff(points)[:, None] * share).ravel(), end)


def _list_points(case: Case, docking: Docking) -> np.ndarray:
    """Return the communication points of a case [s]."""
    experiment = docking.scene.document["experiment"]
    stop = experiment["stop"] if case.stop is None else case.stop
    return list_points(float(experiment["start"]), float(stop), float(experiment["step"]))


def _run_hosted(case: Case) -> Result:
    """Run a docking one of whose vehicles is integrated outside, the docking first."""
    true = Scene(case.scene, _without_reported(case))
    vehicle, driven = copy.copy(true), Scene(case.scene, case.overrides)
    vehicle.document = take_out(true.document, case.host)
    driven.document = copy.deepcopy(driven.document)
    for name in VEHICLES:  # both begin where they begin with the true mass
        if name in driven.document:
            driven.document[name] |= {m: true.document[name][m] for m in MOTION}
    driven.document[case.host]["motion"] = "driven"
    docking, body = Docking(driven), Docking(vehicle)
    for name, value in ({"coupling.mode": "sequential"} | dict(case.starts)).items():
        docking.set(name, value)
    times = _list_points(case, docking)
    rows = [docking.record(times[:1])]
    for h in np.diff(times):
        for name in MOTION:
            docking.set(f"{case.host}.{name}", body.get(f"chaser.{name}"))
        rows.append(docking.record(np.array([docking.time, docking.time + h])))
        for name in ("force", "torque"):
            body.set(f"chaser.{name}_ext", docking.get(f"{case.host}.{name}_mean"))
        body.step(h)
    values = np.array([row.values[-1] for row in rows])
    return replace(rows[0], values=values, warnings=docking.warnings)


def _without_reported(case: Case) -> dict[str, Any]:
    """Return the keys of the scene as they truly are: without the mass that a host reports."""
    if not case.host:
        return dict(case.overrides)
    reported = {f"{case.host}.{name}" for name in ("mass", "inertia")}
    true = {name: value for name, value in case.overrides.items() if name not in reported}
    return true | {f"{case.host}.motion": "free"}


def _audit(run: Result, seconds: float) -> Verdict:
    """Return what a run says of itself."""
    verdict = Verdict("right", audited=True, seconds=seconds)
    if "solver.rhs_evaluations" in run:
        verdict.evaluations = int(run["solver.rhs_evaluations"][-1])
    if run.assurance:
        verdict.evaluations = sum(each["evaluations"] for each in run.assurance.runs)
        verdict.assured = run.assurance.to_case()
    broken = [name for name in run.names if not np.isfinite(run[name]).all()]
    if broken:
        return replace(verdict, verdict="wrong", reason=f"{broken[0]} is not finite")
    if "momentum.residual" in run:
        verdict.momentum = float(np.max(run["momentum.residual"]))
        if verdict.momentum > MOMENTUM:
            reason = f"momentum.residual is {verdict.momentum:.2g}, more than {MOMENTUM:g}"
            return replace(verdict, verdict="wrong", reason=reason)
    if "energy.residual" in run:
        verdict.energy = _find_energy_error(run)
        if verdict.energy > _find_energy_promise(run):
            return _blame(
                verdict,
                run,
                f"energy.residual is {verdict.energy:.2g} of the energy in play, more than the"
                f" {_find_energy_promise(run):.2g} promised",
            )
    return verdict


def _find_energy_error(run: Result) -> float:
    """Return the largest energy residual over the energy in play (as the core's audit has it).

    Errors of some absolute tolerances do not count.
    """
    kinetic, potential = run["energy.kinetic"], run["energy.potential"]
    brought = sum(run[name] for name in ("energy.external", "energy.drive_work") if name in run)
    at_start = kinetic[0] + potential[0] + run["energy.dissipated"][0]  # latches that catch there
    in_play = abs(at_start) + np.abs(brought)
    in_play = np.maximum.accumulate(in_play + np.maximum(0.0, -potential))
    atol = run.parameters.get("solver.atol_energy", 0.0)
    in_play = np.maximum(in_play, max(1e4 * atol, np.finfo(float).tiny))
    missing = np.maximum(0.0, np.abs(run["energy.residual"]) - ATOL_ERRORS * atol)
    return float(np.max(missing / in_play))


def _find_rtol(run: Result) -> float:
    """Return the relative tolerance in use; 0 with fixed steps, which promise nothing."""
    return float(run["solver.chosen_rtol"][-1]) if "solver.chosen_rtol" in run else 0.0


def _find_energy_promise(run: Result) -> float:
    """Return the energy residual that a run may have without a warning."""
    rtol = _find_rtol(run)
    return ENERGY if rtol == 0.0 else min(ENERGY, max(1e-9, find_promise(rtol)))


def _blame(verdict: Verdict, run: Result, reason: str) -> Verdict:
    """Return the verdict on a run that is off: did it say so?"""
    warnings = [text for text in run.warnings if _DOUBTS.search(text)]
    if warnings:
        return replace(verdict, verdict="warned", reason=f"{reason}; {warnings[-1]}")
    return replace(verdict, verdict="wrong", reason=reason)


def _compare(case: Case, run: Result, audited: Verdict) -> Verdict:
    """Compare a run with its reference solution."""
    rtol = _find_rtol(run)
    wanted = case.wanted
    if wanted is None:
        wanted = find_promise(rtol) if rtol else math.inf
        if wanted >= 1.0:
            return audited
    shift = LEAST_SHIFT if case.wanted is not None else max(LEAST_SHIFT, rtol)
    try:
        reference = _take_common(_find_reference(case, 0.0), run)
        figures = find_errors(reference, run)
        off = {name for name, error in figures.items() if not error <= wanted}
        determined = _find_determined(case, reference, shift, wanted) if off else set()
    except DockloopError as error:
        return replace(audited, reason=f"no reference solution: {error}")
    worst = max(off & determined or figures, key=lambda name: figures[name])
    verdict = replace(audited, audited=False, error=figures[worst])
    if not off:
        return verdict
    if not off & determined:
        reason = f"{worst}: tight runs of neighbours do not agree on it"
        return replace(verdict, verdict="undetermined", reason=reason)
    reason = f"{worst} is off by {figures[worst]:.2g}, more than {wanted:.2g}"
    blamed = _blame(verdict, run, reason)
    if blamed.verdict != "wrong":
        return blamed
    return _excuse(
        blamed, case, run, lambda run: _is_right(reference, run, off & determined, wanted)
    )


def _find_determined(case: Case, reference: Result, shift: float, wanted: float) -> set[str]:
    """Return the figures on which neighbours of the reference solution agree."""
    changes = [find_errors(reference, _find_reference(case, size * shift)) for size in _NEIGHBOURS]
    most = _AGREE * wanted
    return {name for name in changes[0] if all(c.get(name, math.inf) <= most for c in changes)}


def _is_right(reference: Result, run: Result, names: set[str], wanted: float) -> bool:
    """Return whether some figures of a run have the wanted error."""
    figures = find_errors(reference, run)
    return all(figures.get(name, math.inf) <= wanted for name in names)


def _excuse(wrong: Verdict, case: Case, run: Result, is_right: Callable[[Result], bool]) -> Verdict:
    """Return the verdict on a run that is wrong: loose, if tighter settings make it right."""
    for _ in range(_TIGHTER):
        tighter = tighten(run)
        try:
            run = _run_case(replace(case, starts={**case.starts, **tighter}))
        except _OutOfTimeError as slow:
            reason = f"{wrong.reason}; with tighter settings {slow}"
            return replace(wrong, verdict="slow", reason=reason)
        except DockloopError:
            return wrong
        if is_right(run):
            name = "solver.rtol" if "solver.rtol" in tighter else "solver.step"
            reason = f"{wrong.reason}; right with {name} {tighter[name]:.2g}"
            return replace(wrong, verdict="loose", reason=reason)
    return wrong


def _take_common(reference: Result, run: Result) -> Result:
    """Return a reference solution at the communication points that a run has, too.

    Neighbours are compared at the same points. Elsewhere they may agree on a stroke that the run
    does not show, and disagree where it does.
    """
    common = [i for i, t in enumerate(reference.time) if np.min(np.abs(run.time - t)) < _SAME_TIME]
    return replace(reference, values=reference.values[common])


_REFERENCES: OrderedDict[str, "Result | DockloopError"] = OrderedDict()


def _find_reference(case: Case, shift: float) -> Result:
    """Return the reference solution of a case, or a neighbour of it; remembered in this process.

    Raises:
        DockloopError: it cannot be found, or not in time.
    """
    overrides = {
        name: value
        for name, value in _without_reported(case).items()
        if not name.startswith("solver.") and name != "experiment.step"
    }
    starts = {name: value for name, value in case.starts.items() if name[:7] != "solver."}
    key = repr((case.scene, overrides, starts, case.stop, shift))
    if key not in _REFERENCES:
        try:
            _REFERENCES[key] = _solve(case, overrides, shift)
        except DockloopError as error:
            _REFERENCES[key] = error
        if len(_REFERENCES) > _KEPT:
            _REFERENCES.popitem(last=False)
    found = _REFERENCES[key]
    _REFERENCES.move_to_end(key)
    if isinstance(found, DockloopError):
        raise found
    return found


def _solve(case: Case, overrides: Mapping[str, Any], shift: float) -> Result:
    """Run the explicit method with tight tolerances.

    Where a solution is smooth, communication steps are shorter than its tolerance asks for. Another
    tolerance then gives the same steps and the same peaks, so that neighbours would confirm a peak
    at a kink between two steps. Their communication steps are a half and a third.
    """
    rtol = NEIGHBOUR_RTOL if shift else REFERENCE_RTOL
    explicit = number_choice("solver.method", "explicit")
    starts = {"accuracy": 0.0, "solver.method": explicit} | list_tolerances(rtol)
    if shift:
        starts |= _shift_start(case, overrides, shift)
    return _run(case, starts, overrides, 1 if not shift else 2 if shift > 0.0 else 3)


def _shift_start(case: Case, overrides: Mapping[str, Any], shift: float) -> dict[str, Any]:
    """Return start values of a docking that begins almost like another one."""
    docking = Docking(case.scene, overrides)
    shifted: dict[str, Any] = {}
    for vehicle in VEHICLES:
        if docking.scene.document.get(vehicle, {}).get("motion") != "free":
            continue
        shifted[f"{vehicle}.mass"] = docking.get(f"{vehicle}.mass") * (1.0 + shift)
        for name in ("position", "velocity"):
            values = docking.get(f"{vehicle}.{name}")
            for i, value in enumerate(values, 1):
                moved = float(value) * (1.0 + shift * (name == "velocity"))
                shifted[f"{vehicle}.{name}[{i}]"] = moved + 0.01 * shift * (-1.0) ** i
        break
    return {name: value for name, value in shifted.items() if name not in case.starts}


def list_reasons(verdicts: Iterable[Verdict]) -> list[dict]:
    """Return the kinds of reasons (numbers and names left out) with how often and an example."""
    kinds: dict[str, list[str]] = {}
    for verdict in verdicts:
        kind = " ".join(word for word in verdict.reason.split() if word.isalpha())
        kinds.setdefault(kind, []).append(one_line(verdict.reason))
    rows = [{"count": len(texts), "example": texts[0]} for texts in kinds.values()]
    return sorted(rows, key=lambda row: -row["count"])


def report_reasons(summary: dict, what: str) -> list[Section]:
    """Return the sections of what `list_reasons` found; `what` is judged: scenes, points."""
    titles = {
        "refusals": "Refused",
        "without_solution": "Right by audits, without a reference solution",
    }
    return [
        Section(title, table=[(what, "reason, for example"),
                              *(row.values() for row in summary[key])])
        for key, title in titles.items()
    ]  # fmt: skip
