"""The part of dockings that fail when few do: subset simulation.

Plain sampling needs a thousand dockings to see one failure in a thousand, and many failures for a
narrow interval. Subset simulation (Au and Beck, Prob. Eng. Mech. 16 (2001) 263) goes there in
levels: the tenth of a level that is nearest to failing is kept, and Markov chains from there give
the next level, all of it at least as near. The part that fails is the product of the parts of the
levels. Chains move by conditional sampling (Papaioannou et al., Prob. Eng. Mech. 41 (2015) 89).

The interval follows from the parts and the correlation within chains. Levels that follow each other
share dockings; their correlation is taken as one half, between the bounds 0 and 1 of Au and Beck.
`tests/test_rare.py` counts how often the interval holds the right answer.
"""

import itertools
import math
import shlex
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.files import MADE_BY, Kind, json_kind
from dockloop.base.paths import shown
from dockloop.base.progress import ProgressBar
from dockloop.base.sections import FACTS, Section, list_files
from dockloop.result.criteria import Criterion
from dockloop.sweeps.campaign import Campaign, How
from dockloop.sweeps.executors import open_executor
from dockloop.sweeps.journal import Journal, make_digest, make_report
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import LISTED, Sweep, Value, count_drawn, transform_cube
from dockloop.sweeps.table import COMMAND

SUMMARY: Kind = json_kind("summary", COMMAND)
WORK = "sweep --rare"
SAMPLES = 500  # in a level, unless the user says otherwise
PART = 0.1  # of the dockings of a level, kept for the next
_MOST_LEVELS = 10
_CORRELATION = 0.5  # of levels that follow each other
_ACCEPTED = 0.44  # part of the moves that a chain should accept
_NORMAL_95, _NORMAL_ONE_SIDED = 1.959963984540054, 1.6448536269514722
_SHOWN = 5  # failures in a summary


@dataclass
class Estimate:
    """The part of all samples that fails.

    Attributes:
        probability: the estimate.
        variation: standard deviation of the estimate over the estimate; if nothing failed, that of
            the part that is at least as near to failing as the last level.
        levels: for every level how near its samples are to failing at least (-inf: any sample), and
            the part of them that went on, or failed in the last level.
        samples: number of evaluations.
        is_stuck: the chains of the last level did not move on: with more samples they may.
    """

    probability: float
    variation: float
    levels: list[tuple[float, float]]
    samples: int
    is_stuck: bool = False

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval, of a lognormal estimate; from 0 if nothing failed.

        What fails is nearer to failing than the last level. So the part of the last level,
        with 95 % confidence, is above the part that fails.
        """
        deviation = math.sqrt(math.log1p(self.variation**2))
        if not self.probability:
            reached = math.prod(part for _, part in self.levels[:-1])
            return 0.0, min(1.0, reached * math.exp(_NORMAL_ONE_SIDED * deviation))
        half = _NORMAL_95 * deviation
        low, high = (self.probability * math.exp(sign * half) for sign in (-1.0, 1.0))
        return low, min(1.0, high)

    @property
    def plain_samples(self) -> int:
        """Samples that plain sampling would need for the same variation."""
        if len(self.levels) == 1:  # this was plain sampling
            return self.samples
        if not self.probability:
            return 0
        return math.ceil((1.0 / self.probability - 1.0) / self.variation**2)


def estimate_rare(
    rank: Callable[[np.ndarray], np.ndarray], width: int, samples: int, seed: int
) -> Estimate:
    """Estimate the part of samples whose rank is infinite.

    Args:
        rank: takes points of the unit cube, shape (points, width), and says how near each is to
            failing, shape (points,): infinite if it fails.
        width: dimensions of the cube.
        samples: in every level; a multiple of 10.
        seed: of the random numbers.

    Raises:
        DockloopError: most samples are equally near, so that none can be kept for the next level.
    """
    from scipy.stats import norm

    random = np.random.default_rng(seed)
    kept, steps = round(PART * samples), round(1.0 / PART)
    points = random.standard_normal((samples, width))
    ranks = rank(norm.cdf(points))
    count, floor, scale = samples, -math.inf, 0.6
    levels: list[tuple[float, float]] = []
    variations: list[float] = []
    while True:
        order = np.argsort(-ranks, kind="stable")
        next_floor = ranks[order[kept - 1]]
        is_stuck = next_floor < math.inf and (ranks >= next_floor).sum() > 0.5 * samples
        is_last = next_floor == math.inf or is_stuck or len(levels) == _MOST_LEVELS - 1
        passed = ranks == math.inf if is_last else ranks >= next_floor
        if is_stuck and not levels:
            raise DockloopError(
                "--rare: most dockings are equally near to failing, so rare failures cannot be"
                " found: compare numbers, for example load_ratio > 1 or not captured within 5 s"
            )
        part = float(passed.mean())
        levels.append((floor, part))
        variations.append(_find_variation(passed, len(levels) > 1, kept, steps))
        if is_last:
            probability = math.prod(part for _, part in levels)
            if not part:
                variations.pop()  # the last level says nothing: none of its samples failed
            neighbours = sum(a * b for a, b in itertools.pairwise(variations))
            variance = sum(v**2 for v in variations) + 2.0 * _CORRELATION * neighbours
            return Estimate(probability, math.sqrt(variance), levels, count, bool(is_stuck))
        chosen = np.flatnonzero(passed)
        starts = random.permutation(chosen)[:kept]
        floor = float(next_floor)
        # Markov chains that stay above the floor: all of them make a step at a time.
        chains, chain_ranks = [points[starts]], [ranks[starts]]
        for step in range(1, steps):
            keep = math.sqrt(1.0 - scale**2)
            moved = keep * chains[-1] + scale * random.standard_normal(chains[-1].shape)
            new = rank(norm.cdf(moved))
            accepted = new >= floor
            chains.append(np.where(accepted[:, None], moved, chains[-1]))
            chain_ranks.append(np.where(accepted, new, chain_ranks[-1]))
            change = (float(accepted.mean()) - _ACCEPTED) / math.sqrt(step)
            scale = min(0.95, max(0.05, scale * math.exp(change)))  # follows what is accepted
        points, ranks = np.concatenate(chains), np.concatenate(chain_ranks)
        count += kept * (steps - 1)


def _find_variation(passed: np.ndarray, is_chained: bool, chains: int, steps: int) -> float:
    """Return the variation of the part of a level that passes."""
    total, part = len(passed), float(passed.mean())
    if part in (0.0, 1.0):
        return 1.0 / math.sqrt(total)
    correlation = 0.0
    if is_chained:
        table = passed.reshape(steps, chains).astype(float)
        spread = part * (1.0 - part)
        for lag in range(1, steps):
            covariance = float(np.mean(table[:-lag] * table[lag:])) - part**2
            correlation += 2.0 * (1.0 - lag / steps) * covariance / spread
    return math.sqrt((1.0 - part) / (part * total) * (1.0 + max(0.0, correlation)))


def name_files(output: Path) -> tuple[Path, Path]:
    """Return ``own_rare.json`` (summary) and ``own_rare.jsonl`` (journal) next to a table."""
    stem = output.with_name(f"{output.stem}_rare")
    return stem.with_suffix(".json"), stem.with_suffix(".jsonl")


def run_rare(
    sweep: Sweep,
    failure: str,
    samples: int,
    journal: Path,
    *,
    progress: ProgressBar | None = None,
    **how: Unpack[How],
) -> dict:
    """Estimate the part of the dockings of a sweep that fail.

    Args:
        sweep: what varies, by distributions.
        failure: criterion that a docking meets when it fails.
        samples: dockings in every level; a multiple of 10, at least 50.
        journal: where every result is kept.
        progress: shows how far it is.
        how: see `How`.

    Returns:
        The summary, a dictionary that can be written as JSON.

    Raises:
        UsageError: the sweep, the criterion or the journal is bad.
        DockloopError: the criterion leads nowhere, or the engine cannot be used.
        InterruptedWorkError: by Ctrl-C.
    """
    for entry in sweep.document["vary"]:
        if entry["type"] in LISTED:
            raise UsageError(
                f"{shown(sweep.path)}: --rare needs distributions, no vary of type {entry['type']}"
            )
    if samples < 50 or samples % 10:
        raise UsageError(f"--rare-cases {samples}: must be a multiple of 10, at least 50")
    planner = Planner(sweep)
    criterion = planner.ask(failure, "--rare")
    decided = [planner.unplaced, sweep.document["vary"], failure, samples, list(sweep.complete(()))]
    digest = make_digest(decided)
    most = samples * (_MOST_LEVELS + 1)
    kept = Journal(
        journal,
        planner.find_setup(),
        most,
        resume=how.get("resume", False),
        work=WORK,
        digest=digest,
    )
    campaign = Campaign(kept, lambda: open_executor(planner, how, samples))
    began = time.perf_counter()
    ranker = _Ranker(sweep, planner, criterion, campaign, progress)
    with campaign.at_work():
        width, seed = count_drawn(sweep.document), sweep.document["seed"]
        estimate = estimate_rare(ranker.rank, width, samples, seed)
        kept.finish()
    summary = _summarise(sweep, failure, estimate, ranker)
    summary["time"] = {"ran": campaign.ran, "wall": time.perf_counter() - began}
    return summary


class _Ranker:
    """Runs dockings and says how near they are to failing."""

    def __init__(
        self,
        sweep: Sweep,
        planner: Planner,
        criterion: Criterion,
        campaign: Campaign,
        progress: ProgressBar | None,
    ) -> None:
        self._sweep, self._criterion, self._campaign = sweep, criterion, campaign
        self._progress, self.planner = progress, planner
        self.not_run = 0
        self.failures: dict[tuple[Value, ...], str | None] = {}  # of the sample, with a reason

    def rank(self, cube: np.ndarray) -> np.ndarray:
        """Return how near points of the unit cube are to failing; what does not run fails."""
        drawn = transform_cube(self._sweep.document, cube).tolist()
        cases = [self._sweep.complete(values) for values in drawn]
        self._campaign.run(list(dict.fromkeys(cases)), report=make_report(self._progress))
        return np.array([self._rank(case) for case in cases])

    def _rank(self, case: tuple[Value, ...]) -> float:
        result = self._campaign.known[case]
        if result.status != "done":
            self.not_run += 1
            self.failures[case] = result.reason
            return math.inf
        rank = self._criterion.rank(self.planner.name_values(case, result))
        if rank == math.inf:
            self.failures[case] = None
        return rank


def _summarise(sweep: Sweep, failure: str, estimate: Estimate, ranker: _Ranker) -> dict:
    """Return the estimate with some failures and their commands."""
    planner = ranker.planner
    low, high = estimate.interval
    examples = []
    for case, reason in list(ranker.failures.items())[-_SHOWN:]:
        example: dict[str, Any] = {
            "command": shlex.join(planner.make_command(case, float(planner.times[-1])))
        }
        examples.append({**example, "reason": reason} if reason else example)
    return {
        MADE_BY: COMMAND,
        "sweep": sweep.path.stem,
        "title": sweep.document["title"],
        "scene": sweep.document["scene"],
        "seed": sweep.document["seed"],
        "failure": failure,
        "probability": estimate.probability,
        "low": low,
        "high": high,
        "variation": estimate.variation,
        "levels": [
            {"floor": None if math.isinf(floor) else floor, "part": part}
            for floor, part in estimate.levels
        ],
        "dockings": estimate.samples,
        "plain_dockings": estimate.plain_samples,
        "stuck": estimate.is_stuck,
        "not_run": ranker.not_run,
        "examples": examples,
    }


def report_rare(summary: dict) -> list[Section]:
    """Return the report of `run_rare`."""
    title = f"{summary['sweep']}: {summary['title']}"
    alone = [("a failure, alone:", example["command"]) for example in summary["examples"]]
    return [Section(title, table=[FACTS, *_list_facts(summary)], commands=alone)]


def _list_facts(summary: dict) -> Iterator[tuple[str, str]]:
    """Yield what fails, how often, and what it took to know that."""
    yield "fails", summary["failure"]
    if summary["probability"]:
        interval = f"95 % interval {summary['low']:.3g} to {summary['high']:.3g}"
        yield "part", f"{summary['probability']:.3g} ({interval})"
        done = f"{summary['dockings']} in {len(summary['levels'])} levels"
        plain = f"plain sampling needs {summary['plain_dockings']} for the same interval"
        yield "dockings", f"{done}; {plain}"
    else:
        most = f"at most {summary['high']:.2g} (95 % confidence)"
        yield "part", f"{most}: none of {summary['dockings']} failed"
        if summary["stuck"]:
            yield "", "the last level led no further: try more --rare-cases"
    if summary["not_run"]:
        yield "not run", f"{summary['not_run']} dockings, which count as failures"
    clock = summary["time"]
    yield "time", f"{clock['ran']} dockings in {clock['wall']:.1f} s"
    yield from list_files(summary.get("files", ()))
