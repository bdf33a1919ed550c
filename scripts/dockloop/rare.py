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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.criteria import Criterion
from dockloop.errors import DockloopError, UsageError
from dockloop.executors import Executor, open_executor
from dockloop.journal import Journal, make_digest, make_report
from dockloop.outputs import MADE_BY, Kind, json_kind
from dockloop.paths import shown
from dockloop.planning import Planner
from dockloop.results import ProgressBar
from dockloop.sampling import LISTED, Sweep, Value, count_drawn, transform_cube
from dockloop.sweeps import COMMAND, run_cases

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
    engine: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: ProgressBar | None = None,
) -> dict:
    """Estimate the part of the dockings of a sweep that fail.

    Args:
        sweep: what varies, by distributions.
        failure: criterion that a docking meets when it fails.
        samples: dockings in every level; a multiple of 10, at least 50.
        journal: where every result is kept.
        engine: as for `run_sweep`.
        workers: local threads or processes.
        scheduler: address of a Dask scheduler.
        resume: go on with the journal.
        progress: shows how far it is.

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
    setup = planner.find_setup()
    kept = Journal(journal, setup, most, resume=resume, work=WORK, digest=digest)
    began = time.perf_counter()
    with kept.at_work(lambda: f"{len(kept.known)} dockings"):
        with open_executor(planner, engine, workers, scheduler, samples) as executor:
            ranker = _Ranker(sweep, planner, criterion, kept, executor)
            ranker.progress = progress
            width, seed = count_drawn(sweep.document), sweep.document["seed"]
            estimate = estimate_rare(ranker.rank, width, samples, seed)
        kept.finish()
    summary = _summarise(sweep, failure, estimate, ranker)
    summary["time"] = {"ran": ranker.ran, "wall": time.perf_counter() - began}
    return summary


class _Ranker:
    """Runs dockings and says how near they are to failing."""

    def __init__(
        self,
        sweep: Sweep,
        planner: Planner,
        criterion: Criterion,
        journal: Journal,
        executor: Executor,
    ) -> None:
        self._sweep, self._criterion, self._executor = sweep, criterion, executor
        self._journal = journal
        self.progress: ProgressBar | None = None
        self.planner = planner
        self.ran = 0
        self.not_run = 0
        self.failures: dict[tuple[Value, ...], str | None] = {}  # of the sample, with a reason

    def rank(self, cube: np.ndarray) -> np.ndarray:
        """Return how near points of the unit cube are to failing; what does not run fails."""
        drawn = transform_cube(self._sweep.document, cube).tolist()
        cases = [self._sweep.complete(values) for values in drawn]
        missing = [c for c in dict.fromkeys(cases) if c not in self._journal.known]
        report = make_report(self.progress, len(cases) - len(missing), len(cases))
        run_cases(self._executor, self.planner, missing, self._journal, report)
        self.ran += len(missing)
        return np.array([self._rank(case) for case in cases])

    def _rank(self, case: tuple[Value, ...]) -> float:
        result = self._journal.known[case]
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


def describe_rare(summary: dict) -> str:
    """Say a summary in words and numbers."""
    lines = [
        f"{summary['sweep']}: {summary['title']}",
        f"  fails        {summary['failure']}",
    ]
    if summary["probability"]:
        lines.append(
            f"  part         {summary['probability']:.3g} (95 % interval {summary['low']:.3g} to"
            f" {summary['high']:.3g})"
        )
        lines.append(
            f"  dockings     {summary['dockings']} in {len(summary['levels'])} levels; plain"
            f" sampling needs {summary['plain_dockings']} for the same interval"
        )
    else:
        lines.append(
            f"  part         at most {summary['high']:.2g} (95 % confidence): none of"
            f" {summary['dockings']} failed"
        )
        if summary["stuck"]:
            lines.append("               the last level led no further: try more --rare-cases")
    if summary["not_run"]:
        lines.append(f"  not run      {summary['not_run']} dockings, which count as failures")
    if summary["examples"]:
        lines.append("  failures, alone:")
        lines += [f"    {example['command']}" for example in summary["examples"]]
    clock = summary["time"]
    lines.append(f"  time         {clock['ran']} dockings in {clock['wall']:.1f} s")
    if "files" in summary:
        lines.append(f"  files        {', '.join(summary['files'])}")
    return "\n".join(lines)
