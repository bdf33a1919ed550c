"""Judges the points of a map: the search of envelopes asks, processes that may be killed answer."""

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from dockloop.cases import Result
from dockloop.crew import Crew
from dockloop.criteria import Criterion
from dockloop.envelopes.mesh import Point
from dockloop.envelopes.search import Search
from dockloop.judging import MEASURES, VERDICTS, Case, Verdict, find_verdict, judge
from dockloop.planning import Planner
from dockloop.run_errors import find_frame
from dockloop.sampling import Value


@dataclass
class PointJudge:
    """Judges points against a wanted error; see `dockloop.envelopes.search.Judge`.

    Attributes:
        wanted: relative error up to which a point is right.
        limit: most processor time of a point [s].
        host: vehicle that is integrated outside; empty: none.
    """

    wanted: float
    limit: float
    host: str = ""
    work: str = "map"

    def __post_init__(self) -> None:
        """Make what the search asks for: points are alike that have the same verdict."""
        self.setup: dict[str, Any] = {"error": self.wanted, "limit": self.limit, "host": self.host}
        self.outputs = list(MEASURES)
        self.criteria = [_make_criterion(number, name) for number, name in enumerate(VERDICTS)]

    def check(self, planner: Planner) -> None:
        """Check that the scene has outputs that are compared. Raises UsageError."""
        find_frame([name for name, v in planner.variables.items() if v.causality == "output"])

    @contextmanager
    def open(self, planner: Planner, workers: int | None) -> Iterator["_Judging"]:
        """Start the processes."""
        with Crew(judge, workers) as crew:
            yield _Judging(self, planner, crew)

    def make_case(self, planner: Planner, values: tuple[Value, ...]) -> Case:
        """Return the case of a point."""
        settings = planner.list_settings(values) | {
            f"experiment.{name}": value for name, value in planner.experiment.items()
        }
        keys = {name: value for name, value in settings.items() if planner.is_scene_key(name)}
        starts = {name: value for name, value in settings.items() if name not in keys}
        return Case(
            planner.scene_reference,
            keys,
            starts,
            wanted=self.wanted,
            limit=self.limit,
            host=self.host,
        )


def _make_criterion(number: int, name: str) -> Criterion:
    """Return the criterion that points with a verdict meet."""

    def holds(values: Any) -> bool:
        return bool(values["verdict"] == number)

    return Criterion(name, ("verdict",), holds, lambda values: 1.0 if holds(values) else -1.0)


class _Judging:
    """Executor (`dockloop.executors.Executor`) whose results are verdicts."""

    def __init__(self, judge: PointJudge, planner: Planner, crew: Crew) -> None:
        self._judge, self._planner, self._crew = judge, planner, crew

    def count(self) -> int:
        """Return the number of processes."""
        return self._crew.count()

    def submit(self, values: tuple[Value, ...]) -> Future:
        """Begin a point. Raises UsageError: the scene refuses these values."""
        self._planner.resolve(values)
        case = self._judge.make_case(self._planner, values)
        return self._crew.begin(case, case.limit)

    def collect(self, future: Future) -> Result:
        """Return the verdict on a point."""
        return find_verdict(future.result()).to_result()


def read_verdict(search: Search, point: Point) -> Verdict:
    """Return the verdict on a point of a search."""
    return Verdict.from_result(search.runs[point])
