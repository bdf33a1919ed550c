"""Runs the dockings from which the boundary of criteria follows.

The mesh says which points it needs, the sweep engine runs them and keeps every result in its
journal, the criteria say which points are alike. All criteria share the runs. Points at random in
cells that were not refined show whether a part of the boundary was missed; one that differs from
its cell is refined like all others.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Unpack

import numpy as np

from dockloop.base.errors import UsageError
from dockloop.base.number import check_number, check_whole
from dockloop.result.criteria import Criterion
from dockloop.runs.outcome import Result
from dockloop.scene.find import find_scene
from dockloop.studies.envelopes.mesh import Bracket, Class, Mesh, Point
from dockloop.sweeps.campaign import Campaign, Executor, How, explain_undone
from dockloop.sweeps.executors import open_executor
from dockloop.sweeps.journal import Journal, find_outcomes, make_digest
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import Cases, Sweep, list_quantities
from dockloop.sweeps.settings import Settings, say_range

COMMAND = "dockloop envelope"
WORK = "envelope"
_COARSE = {2: 8, 3: 4}  # cells along an axis at the beginning
_TOLERANCE = {2: 0.01, 3: 0.04}
_MOST_CELLS = 4096  # along an axis
_MOST_CHECKS = 100_000
FINEST = 0.000125  # smallest tolerance: 4 000 cells
Progress = Callable[[int, int, str], None]  # runs done, runs asked for so far, what is being done


class Axis(NamedTuple):
    """A quantity and the range in which the boundary is looked for.

    Attributes:
        name: a key of the scene or a start value of the FMU.
        low: lower end, in the unit of the quantity.
        high: upper end.
        is_log: equal cells are equal ratios.
    """

    name: str
    low: float
    high: float
    is_log: bool = False

    def say(self, letter: str) -> str:
        """Return its option as it may have been typed."""
        return say_range(f"--{letter}", self.name, self.low, self.high)

    def value(self, part: float) -> float:
        """Return the value at a part of the range, 0 to 1."""
        if part in (0.0, 1.0):
            return self.high if part else self.low
        if self.is_log:
            return self.low * (self.high / self.low) ** part
        return self.low + (self.high - self.low) * part


@dataclass(frozen=True)
class Order:
    """What is asked for.

    Attributes:
        scene: name or path of the scene.
        axes: two or three.
        criteria: texts.
        settings: quantities that all runs have otherwise than the scene.
        experiment: ``stop``, ``step`` [s] where they differ from the scene.
        tolerance: half the distance of the points between which the boundary is, as a part of the
            range; None: 0.01 for two quantities, 0.04 for three.
        coarse: cells along an axis at the beginning; None: 8 for two quantities, 4 for three.
        checks: points at random in cells that were not refined.
        seed: of these points.
        assured: each docking is repeated until its figures are within the accuracy.
    """

    scene: str
    axes: tuple[Axis, ...]
    criteria: tuple[str, ...]
    settings: Settings = field(default_factory=Settings)
    experiment: Mapping[str, float] = field(default_factory=dict)
    tolerance: float | None = None
    coarse: int | None = None
    checks: int = 16
    seed: int = 0
    assured: bool = False


class Judge(Protocol):
    """Runs points in a way of its own, and says what is alike: criteria on its own outputs.

    Attributes:
        work: the command, as journals name it.
        setup: all that decides its results and is not in the planner.
        outputs: what `Result.outputs` of its executor are.
        criteria: on these outputs.
    """

    work: str
    setup: dict[str, Any]
    outputs: list[str]
    criteria: list[Criterion]

    def check(self, planner: Planner) -> None:
        """Check, before anything runs, that the scene can be judged. Raises UsageError."""

    def open(self, planner: Planner, how: How) -> AbstractContextManager[Executor]:
        """Start what runs points."""


@dataclass
class Search:
    """What was found.

    Attributes:
        order: what was asked for.
        planner: how cases were run; has the units.
        criteria: parsed.
        mesh: its cells, refined.
        runs: results by point.
        known: which criteria every point meets.
        checks: points that were checked: did they differ from their cells?
        ran: dockings run now; the others were in the journal.
        wall: time of these [s].
    """

    order: Order
    planner: Planner
    criteria: list[Criterion]
    mesh: Mesh
    runs: dict[Point, Result] = field(default_factory=dict)
    known: dict[Point, Class] = field(default_factory=dict)
    checks: dict[Point, bool] = field(default_factory=dict)
    ran: int = 0
    wall: float = 0.0

    def values(self, point: Point) -> tuple[float, ...]:
        """Return the quantities at a point."""
        parts = (coordinate / self.mesh.size for coordinate in point)
        return tuple(axis.value(p) for axis, p in zip(self.order.axes, parts, strict=True))

    def outputs(self, point: Point) -> dict[str, Any]:
        """Return the outputs at the end of the run at a point; none if it was not done."""
        return dict(zip(self.planner.asked, self.runs[point].outputs, strict=False))

    def middle(self, bracket: Bracket) -> tuple[float, ...]:
        """Return the quantities half-way between the points of a bracket: on the boundary."""
        pairs = zip(bracket.inside, bracket.outside, strict=True)
        parts = [(a + b) / 2 / self.mesh.size for a, b in pairs]
        return tuple(axis.value(p) for axis, p in zip(self.order.axes, parts, strict=True))


def find_envelope(
    order: Order,
    journal: Path,
    *,
    progress: Progress | None = None,
    judge: Judge | None = None,
    **how: Unpack[How],
) -> Search:
    """Find the boundary of criteria.

    Args:
        order: what is asked for.
        journal: where every result is kept.
        progress: receives runs done, runs asked for so far, and what is being done.
        judge: runs the points and has the criteria; None: dockings end with the outputs of the FMU.
        how: see `How`; criteria, ranges and tolerance of a journal that goes on may be others.

    Raises:
        UsageError: a name, range, criterion or the journal is bad, or all dockings are refused.
        DockloopError: no docking could be run, or the engine failed.
        InterruptedWorkError: by Ctrl-C.
    """
    search = prepare_search(order, judge)
    planner, resume = search.planner, how.get("resume", False)
    if resume:
        planner.collect_like(find_outcomes(journal))
    digest = make_digest([planner.unplaced, order.axes, order.criteria, search.mesh.size])
    most = (search.mesh.size + 1) ** len(order.axes)
    setup = planner.find_setup() | (judge.setup if judge else {})
    work = judge.work if judge else WORK
    kept = Journal(journal, setup, most, resume=resume, work=work, digest=digest)

    def start() -> AbstractContextManager[Executor]:
        return judge.open(planner, how) if judge else open_executor(planner, how, most)

    campaign = Campaign(kept, start)
    with campaign.at_work():
        _refine(search, campaign, progress, "refining")
        _check(search, campaign, progress)
        kept.finish()
        if not any(result.status == "done" for result in search.runs.values()):
            what = "no docking could be run, for example"
            runs = ((search.values(point), result) for point, result in search.runs.items())
            raise explain_undone(runs, what, planner.explain_refusal)
    search.ran, search.wall = campaign.ran, campaign.wall
    return search


def _check_numbers(order: Order) -> Order:
    """Return the same with numbers of Python, for JSON. Raises UsageError: one is none."""
    tolerance, coarse = order.tolerance, order.coarse
    return replace(
        order,
        tolerance=None if tolerance is None else check_number("--tolerance", tolerance),
        coarse=None if coarse is None else check_whole("--coarse", coarse, 2, _MOST_CELLS // 4),
        checks=min(check_whole("--check", order.checks, 0), _MOST_CHECKS),
        seed=check_whole("--seed", order.seed, 0),
    )


def prepare_search(order: Order, judge: Judge | None = None) -> Search:
    """Check what is asked for, before anything runs. Raises UsageError."""
    dimensions = len(order.axes)
    if dimensions not in _COARSE:
        raise UsageError(f"--x, --y, --z: there are {dimensions} quantities: must be 2 or 3")
    if not order.criteria and judge is None:
        raise UsageError('--criterion: at least one is needed, for example "captured within 5 s"')
    for letter, axis in zip("xyz", order.axes, strict=False):
        _check_axis(axis.say(letter), axis)
    names = [axis.name for axis in order.axes]
    for number, name in enumerate(names):
        if name in names[:number] or name in order.settings:
            raise UsageError(f"--{'xyz'[number]} {name}: this quantity is given twice")
    order = _check_numbers(order)
    tolerance = _TOLERANCE[dimensions] if order.tolerance is None else order.tolerance
    coarse = _COARSE[dimensions] if order.coarse is None else order.coarse
    check_tolerance(tolerance)
    levels = max(0, math.ceil(math.log2(0.5 / tolerance / coarse) - 1e-9))
    planner = Planner(_make_sweep(order, judge.work if judge else WORK))
    if judge is not None:
        judge.check(planner)
        planner.asked = judge.outputs
        return Search(order, planner, judge.criteria, Mesh(dimensions, coarse, levels))
    criteria = [planner.ask(text, "--criterion") for text in order.criteria]
    return Search(order, planner, criteria, Mesh(dimensions, coarse, levels))


def check_tolerance(tolerance: float) -> None:
    """Check how well a boundary shall be known. Raises UsageError."""
    if not FINEST <= tolerance <= 0.25:
        raise UsageError(f"--tolerance {tolerance:g}: must be {FINEST:g} to 0.25 (of the range)")


def _check_axis(place: str, axis: Axis) -> None:
    """Check a range."""
    if not (math.isfinite(axis.low) and math.isfinite(axis.high) and axis.low < axis.high):
        raise UsageError(f"{place}: must be finite and ascend")
    if axis.is_log and axis.low <= 0.0:
        raise UsageError(f"{place}: must be above 0 on a logarithmic axis")


def _make_sweep(order: Order, work: str) -> Sweep:
    """Return the sweep whose cases are the corners of the box, for the planner."""
    vary = [{"type": "uniform", "name": a.name, "range": [a.low, a.high]} for a in order.axes]
    document = {
        "title": f"{work} of {order.scene}",
        "scene": order.scene,
        "set": dict(order.settings),
        "vary": vary,
        "experiment": dict(order.experiment),
    }
    ends = np.array([[axis.low, axis.high] for axis in order.axes]).T
    scene, quantities = find_scene(order.scene), list_quantities(document)
    axes = {axis.name: axis.say(x) for x, axis in zip("xyz", order.axes, strict=False)}
    return Sweep(
        Path(work), "", scene, document, quantities, Cases(vary, ends),
        assured=order.assured, given_by=order.settings.given_by | axes,
    )  # fmt: skip


def _refine(search: Search, campaign: Campaign, progress: Progress | None, note: str) -> None:
    """Run corners and split cells until nothing differs in a cell that can be split."""
    while True:
        _run(search, campaign, search.mesh.list_missing(search.known), progress, note)
        if not search.mesh.split(search.known):
            return


def _check(search: Search, campaign: Campaign, progress: Progress | None) -> None:
    """Run points at random in wide cells; refine where one is another than its cell."""
    order = search.order
    points = search.mesh.draw_checks(search.known, order.checks, order.seed)
    expected = {point: search.mesh.predict(point, search.known) for point in points}
    _run(search, campaign, points, progress, "checking")
    search.checks = {p: search.known[p] != expected[p] for p in points}
    if any(search.checks.values()):
        _refine(search, campaign, progress, "refining what a check found")


def _run(
    search: Search,
    campaign: Campaign,
    points: Sequence[Point],
    progress: Progress | None,
    note: str,
) -> None:
    """Run points that are not in the journal, and classify all of them."""
    cases = {search.values(point): point for point in points}
    before = len(search.runs)

    def report(done: int, total: int) -> None:
        if progress:
            progress(before + done, before + total, note)

    campaign.run(list(cases), report=report)
    for values, point in cases.items():
        search.runs[point] = campaign.known[values]
        search.known[point] = _classify(search, point)


def _classify(search: Search, point: Point) -> Class:
    """Return which criteria a point meets; none, if it could not be run."""
    if search.runs[point].status != "done":
        return (False,) * len(search.criteria)
    values = search.planner.name_values(search.values(point), search.runs[point])
    return tuple(criterion.holds(values) for criterion in search.criteria)
