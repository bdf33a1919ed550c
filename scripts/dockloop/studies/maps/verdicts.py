"""Judges the points of a map: the search of envelopes asks, processes that may be killed answer."""

from dataclasses import dataclass
from typing import Any

from dockloop.result.criteria import Criterion
from dockloop.result.run_errors import find_frame
from dockloop.runs.judging import MEASURES, VERDICTS, Case, Verdict
from dockloop.studies.envelopes.mesh import Point
from dockloop.studies.envelopes.search import Search
from dockloop.sweeps.campaign import How, Values
from dockloop.sweeps.judges import Judges
from dockloop.sweeps.planning import Planner


@dataclass
class PointJudge:
    """Judges points against a wanted error; see `dockloop.studies.envelopes.search.Judge`.

    Attributes:
        wanted: relative error up to which a point is right.
        limit: most processor time of a point [s].
        host: vehicle that is integrated outside; empty: none.
        assured: runs are repeated until their figures are within their accuracy.
    """

    wanted: float
    limit: float
    host: str = ""
    assured: bool = False
    work: str = "map"

    def __post_init__(self) -> None:
        """Make what the search asks for: points are alike that have the same verdict."""
        self.setup: dict[str, Any] = {"error": self.wanted, "limit": self.limit, "host": self.host}
        self.setup |= {"assured": True} if self.assured else {}
        self.outputs = list(MEASURES)
        self.criteria = [_make_criterion(number, name) for number, name in enumerate(VERDICTS)]

    def check(self, planner: Planner) -> None:
        """Check that the scene has outputs that are compared. Raises UsageError."""
        find_frame(planner.list_outputs())
        if self.assured:
            planner.check_assured()

    def open(self, planner: Planner, how: How) -> Judges:
        """Start the processes."""

        def make_case(values: Values) -> Case:
            planner.resolve(values)
            return self.make_case(planner, values)

        return Judges(make_case, how.get("workers"))

    def make_case(self, planner: Planner, values: Values) -> Case:
        """Return the case of a point."""
        keys, starts = planner.split_settings(values)
        keys |= {f"experiment.{name}": value for name, value in planner.experiment.items()}
        return Case(
            planner.scene_reference,
            keys,
            starts,
            wanted=self.wanted,
            limit=self.limit,
            host=self.host,
            assured=self.assured,
        )


def _make_criterion(number: int, name: str) -> Criterion:
    """Return the criterion that points with a verdict meet."""

    def holds(values: Any) -> bool:
        return bool(values["verdict"] == number)

    return Criterion(name, ("verdict",), holds, lambda values: 1.0 if holds(values) else -1.0)


def read_verdict(search: Search, point: Point) -> Verdict:
    """Return the verdict on a point of a search."""
    return Verdict.from_result(search.runs[point])
