"""Processes that judge cases and may be killed: the executor of maps and random extremes."""

from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future

from dockloop.runs.crew import Crew
from dockloop.runs.judging import Case, Verdict, find_verdict, judge
from dockloop.runs.outcome import Result
from dockloop.sweeps.campaign import Values


class Judges:
    """Executor (`dockloop.sweeps.campaign.Executor`) whose results are verdicts.

    Attributes:
        tally: how many of each verdict there were.
    """

    def __init__(self, make_case: Callable[[Values], Case], workers: int | None) -> None:
        """Prepare processes; `make_case` returns what is judged, and raises like `submit`."""
        self._make_case, self._crew = make_case, Crew(judge, workers)
        self.tally: Counter[str] = Counter()

    def __enter__(self) -> "Judges":
        self._crew.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._crew.__exit__(*error)

    def count(self) -> int:
        """Return the number of processes."""
        return self._crew.count()

    def submit(self, values: Values) -> Future:
        """Begin a case. Raises UsageError: the scene refuses these values."""
        return self._begin(self._make_case(values))

    def collect(self, future: Future) -> Result:
        """Return the verdict on a case."""
        verdict = find_verdict(future.result())
        self.tally[verdict.verdict] += 1
        return verdict.to_result()

    def ask(self, case: Case) -> Verdict:
        """Judge a case that is none of the campaign, and wait for the verdict."""
        return find_verdict(self._begin(case).result())

    def _begin(self, case: Case) -> Future:
        return self._crew.begin(case, case.limit)
