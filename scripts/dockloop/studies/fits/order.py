"""What a fit is asked for, and its work: everything is checked before the first run."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.number import as_number, check_number, check_whole, is_number
from dockloop.base.progress import ProgressBar
from dockloop.native.variables import fits
from dockloop.scene.catalogue import list_entries
from dockloop.scene.find import find_scene
from dockloop.scene.resolve import PATHS, is_scene_key
from dockloop.scene.values import as_setting
from dockloop.studies.fits.plan import Planned, plan
from dockloop.studies.fits.problem import Problem, Sensors, Vary
from dockloop.studies.fits.profile import Profile, find_profile
from dockloop.studies.fits.search import Found, find_fit
from dockloop.studies.fits.statistics import PENALTIES
from dockloop.studies.fits.trials import Trial, check_noise, list_trials, read_trials
from dockloop.sweeps.campaign import Campaign, How
from dockloop.sweeps.executors import open_executor
from dockloop.sweeps.fitted import draw_fitted, make_numbers
from dockloop.sweeps.journal import Journal, make_digest
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Cases, Sweep, list_quantities
from dockloop.sweeps.settings import Settings

WORK = "fit"
_TEST = "test"  # the column of the names of tests
_STOP = "experiment.stop"
_LATE = [1e6, 2e6]  # s: stops that any scene can have
_MOST_POINTS = 20_000  # of a run
_FINER = 0.1  # of a step, where sensors have a limited rate
_MOST_CASES = 100_000


@dataclass(frozen=True)
class Order:
    """What is asked for.

    Attributes:
        scene: name or path of the scene.
        data: files, lists of tests, or members of such lists.
        vary: what is fitted.
        settings: quantities that all runs have otherwise than the scene.
        experiment: ``stop``, ``step`` [s] where they differ from the scene.
        columns: what columns mean, as texts.
        form: of the tables, as a text.
        noise: standard deviations by channel, for all tests.
        sensors: what is known of them.
        loss: of residuals.
        starts: of the search, at most.
        seed: of these.
        is_plan: tests are planned; there are no data.
        is_profiled: the worst pair gets a profile.
    """

    scene: str
    data: Sequence[Any]
    vary: Sequence[Vary]
    settings: Settings = field(default_factory=Settings)
    experiment: Mapping[str, float] = field(default_factory=dict)
    columns: Sequence[str] = ()
    form: str = ""
    noise: Mapping[str, float] = field(default_factory=dict)
    sensors: Sensors = field(default_factory=Sensors)
    loss: str = "linear"
    starts: int = 8
    seed: int = 0
    is_plan: bool = False
    is_profiled: bool = False


@dataclass
class Fitted:
    """A fit or a plan, done."""

    order: Order
    problem: Problem
    own: Sequence[float | None]
    units: Sequence[str]
    found: Found | Planned
    profile: Profile | None
    ran: int
    seconds: float


def work(
    order: Order, journal: Path, progress: ProgressBar | None = None, **how: Unpack[How]
) -> Fitted:
    """Fit, or plan.

    Raises:
        UsageError: what is asked for, a file or the journal is bad.
        DockloopError: no run could be made, or the engine failed.
        InterruptedWorkError: by Ctrl-C.
    """
    began = time.perf_counter()
    _check(order)
    trials = list_trials(order.data, is_plan=order.is_plan)
    planner = Planner(_make_sweep(order, trials))
    trials = read_trials(trials, planner, order.columns, order.form, order.noise)
    _check_channels(order, trials)
    own = _find_own(order, planner, trials)
    read = (t.channels + ["captured"] * (t.is_captured is not None) for t in trials)
    planner.histories = list(dict.fromkeys(name for names in read for name in names))
    _choose_step(order, planner, trials)
    digest = make_digest([planner.digest, planner.histories, order.vary])
    kept = Journal(
        journal, planner.find_setup(), _MOST_CASES, resume=how.get("resume", False), work=WORK,
        digest=digest,
    )  # fmt: skip
    campaign = Campaign(kept, lambda: open_executor(planner, how, _MOST_CASES))
    note = ""

    def say(what: str) -> None:
        nonlocal note
        note = what

    def show(runs: int) -> None:
        if progress:
            progress(1.0 - 0.97**runs, f"{note}, {runs} runs so far")

    accuracy = float(order.settings["accuracy"])
    problem = Problem(
        planner, campaign, trials, order.vary, order.sensors,
        accuracy=accuracy, is_open=_is_open(order, trials), report=show,
    )  # fmt: skip
    parts, units = zip(*(own[parameter.vary.name] for parameter in problem.parameters), strict=True)
    profile = None
    with campaign.at_work():
        if order.is_plan:
            found: Found | Planned = plan(problem, parts)
        else:
            found = find_fit(
                problem, parts, starts=order.starts, seed=order.seed, loss=order.loss, report=say
            )
            if order.is_profiled:
                say("profile")
                profile = find_profile(problem, found, order.loss)
        kept.finish()
    if progress:
        progress(1.0)
    seconds = time.perf_counter() - began
    return Fitted(order, problem, parts, units, found, profile, campaign.ran, seconds)


def check_count(order: Order, count: int) -> None:
    """Raise UsageError: so many cases cannot be drawn, or every test has parameters of its own."""
    check_whole("--cases", count, 1, _MOST_CASES)
    if all(vary.is_own for vary in order.vary):
        raise UsageError("--cases: every test has values of its own: give --vary, too")


def draw_cases(
    summary: Mapping[str, Any], count: int, seed: int
) -> tuple[list[str], list[list[Any]]]:
    """Return heads and rows of cases for a sweep: parameters drawn with their covariance.

    Args:
        summary: of `dockloop.studies.fits.report.summarise_fit`.
        count: of cases, as `check_count` takes it.
        seed: of the draws.
    """
    numbers = make_numbers(summary)
    cube = np.random.default_rng(seed).random((count, len(numbers["names"])))
    rows = [[f"drawn {i}", *row] for i, row in enumerate(draw_fitted(numbers, cube).tolist(), 1)]
    return ["name", *numbers["names"]], rows


def _check(order: Order) -> None:
    """Check numbers, before anything is read."""
    if not order.vary:
        raise UsageError("--vary: at least one quantity is needed: --vary NAME LOW HIGH")
    names = [vary.name for vary in order.vary]
    for vary in order.vary:
        if not -np.inf < vary.low < vary.high < np.inf:
            raise UsageError(f"{vary.option}: must be finite and ascend")
        if names.count(vary.name) > 1 or vary.name in order.settings:
            raise UsageError(f"--vary {vary.name}: this quantity is given twice")
    accuracy = as_number(order.settings["accuracy"])
    if not 0.0 < accuracy <= 1e-2:
        raise UsageError(
            f"--accuracy {order.settings['accuracy']!r}: must be a number above 0, at most 0.01:"
            " derivatives are differences of runs"
        )
    if order.loss not in PENALTIES:
        raise UsageError(f"--loss {order.loss}: must be one of {', '.join(PENALTIES)}")
    check_whole("--starts", order.starts, 1, 10_000)
    check_whole("--seed", order.seed, 0)
    for name, corner in order.sensors.filters.items():
        if not 0.0 < as_number(corner) < np.inf:
            raise UsageError(f"--filter {name}={corner!r}: must be a frequency above 0 [Hz]")
    for name, rate in order.sensors.rate_limits.items():
        if not 0.0 < as_number(rate) < np.inf:
            raise UsageError(f"--rate-limit {name}={rate!r}: must be a rate above 0 [unit/s]")
    for name, value in order.noise.items():
        check_noise(f"--noise {name}", value)
    if order.sensors.shift is not None:
        check_number("--shift", order.sensors.shift)


def _check_channels(order: Order, trials: Sequence[Trial]) -> None:
    """Refuse names of channels that no test has."""
    channels = {name for trial in trials for name in trial.channels}
    sensors = order.sensors
    for option, names in (
        ("--filter", sensors.filters),
        ("--rate-limit", sensors.rate_limits),
        ("--offset", sensors.offsets),
        ("--scale", sensors.scales),
        ("--noise", order.noise),
    ):
        for name in names:
            if name not in channels:
                has = ", ".join(sorted(channels))
                raise UsageError(f"{option} {name}: no test has this channel; they have {has}")


def _make_sweep(order: Order, trials: Sequence[Trial]) -> Sweep:
    """Return the sweep whose cases are the ends of the ranges in each test, for the planner."""
    vary: list[dict[str, Any]] = [
        {"type": "cases", "name": _TEST, "cases": {t.name: dict(t.settings) for t in trials}},
        *({"type": "uniform", "name": v.name, "range": [v.low, v.high]} for v in order.vary),
    ]
    document = {
        "title": f"{WORK} of {order.scene}",
        "scene": order.scene,
        "set": dict(order.settings),
        "vary": vary,
        "experiment": dict(order.experiment),
    }
    ends = [[v.low, v.high] for v in order.vary]
    if _is_open(order, trials):
        vary.append({"type": "uniform", "name": _STOP, "range": _LATE})  # cases say it
        ends.append(_LATE)
    quantities = list_quantities(document)
    scene = find_scene(order.scene)
    by_data = {name: f"DATA: set '{name}'" for t in trials for name in t.settings}
    by_options = order.settings.given_by | {v.name: v.option for v in order.vary}
    given_by = by_data | by_options | {_TEST: "DATA"}
    cases = Cases(vary, np.array(ends).T)
    return Sweep(Path(WORK), "", scene, document, quantities, cases, given_by=given_by)


def _is_open(order: Order, trials: Sequence[Trial]) -> bool:
    """Return whether runs may end with the data: nothing says when they stop."""
    given = [order.settings, [v.name for v in order.vary], *(t.settings for t in trials)]
    return not (
        order.is_plan or "stop" in order.experiment or any(_STOP in names for names in given)
    )


def _find_own(
    order: Order, planner: Planner, trials: Sequence[Trial]
) -> dict[str, tuple[float | None, str]]:
    """Return the values of the scene as parts of the ranges, None if not known, and their units.

    Raises:
        UsageError: paths with ``*`` mean what is given otherwise, too.
    """
    keys = [as_setting(n, v) for n, v in order.settings.items() if is_scene_key(n)]
    entries = {entry.name: entry for entry in list_entries(order.scene, keys)}
    varied = [vary.name for vary in order.vary]
    given = dict.fromkeys([*varied, *order.settings, *(n for t in trials for n in t.settings)])
    for name in entries:
        by = [each for each in given if _means(each, name)]
        if len(by) > 1 and by[0] in varied:
            raise UsageError(f"--vary {by[0]}: {name} is given twice, by {by[1]} too")
    found = {}
    for vary in order.vary:
        entry = entries.get(vary.name)
        part = vary.part(entry.default) if entry and is_number(entry.default) else None
        like = (e.unit for n, e in entries.items() if "*" in vary.name and fits(n, vary.name))
        found[vary.name] = part, entry.unit if entry else next(like, "")
    return found


def _means(given: str, name: str) -> bool:
    """Return whether a given name is a key, or a path whose parts with ``*`` mean it."""
    parts, others = given.split("."), name.split(".")
    return given == name or (
        given.startswith(PATHS)
        and len(parts) == len(others)
        and all(a == b or ("*" in a and fits(b, a)) for a, b in zip(parts, others, strict=True))
    )


def _choose_step(order: Order, planner: Planner, trials: Sequence[Trial]) -> None:
    """Let runs have as many points as the data, unless the step is given."""
    if "step" in order.experiment or order.is_plan:  # samples of a plan are points of its runs
        return
    times = planner.times
    steps = [float(np.median(np.diff(t.data.time))) for t in trials if t.data is not None]
    step = min([float(times[1] - times[0]), *(step for step in steps if step > 0.0)])
    if order.sensors.rate_limits:  # errors of the time of a jump stay for as long as a sensor lags
        step *= _FINER
    step = max(step, float(times[-1] - times[0]) / _MOST_POINTS)
    planner.experiment = {**planner.experiment, "step": step}
