"""Residuals of a fit and their derivatives, from runs of the scene.

The unknowns are one vector: parameters as parts of their ranges (0 to 1), then for each test what
is not of interest: time shift, offsets and scales of channels. Only parameters need runs. Their
derivatives are differences of runs (`sqrt(accuracy)` of the range: between error of a run and
curvature), which are cases of a campaign and run side by side. A difference is never taken across a
change of the outcome. Derivatives go along to the next point, corrected by what changed on the way
(Broyden), as long as they foresee most of that change. Starts run to the stop of the scene, since
data may be anywhere in it; the runs that follow end soon after the data.

Runs are read linearly between communication points. A sample where the run bends within one step
(contact, capture, a jump) counts less, and hardly if it bends by more than the noise: the height of
an impact that no step resolves says nothing, but many of them make false valleys.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from scipy.signal import lfilter

from dockloop.base.errors import DockloopError
from dockloop.native.core import name_choice
from dockloop.result.recording import Result as Recording
from dockloop.studies.fits.trials import Trial
from dockloop.studies.measured.overlay import check_overlap, find_shift
from dockloop.sweeps.campaign import Campaign, explain_undone
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.settings import say_range

_FORESEEN = 0.3  # part of a change of a run that derivatives may miss, and go along
_ROUNDS = 5  # of the estimate of noise with bends
_MISSED, _SEEN = 0.1, 3.0  # a peak of one sample is an impact: of the range of a channel, its noise
_LATER = 0.1  # of the time of a test: by how much a search may shift its data behind a start
_SAVED = 0.1  # of a run: less is not worth to run a start again
_FAR = 0.1  # deviation of a channel before anything is known, part of its range


class Vary(NamedTuple):
    """What is fitted.

    Attributes:
        name: a key of the scene or a start value of the FMU.
        low: lower bound, in the unit of the quantity.
        high: upper bound.
        is_own: each test has a value of its own.
    """

    name: str
    low: float
    high: float
    is_own: bool = False

    @property
    def option(self) -> str:
        """The option as it may have been typed."""
        option = "--vary-each" if self.is_own else "--vary"
        return say_range(option, self.name, self.low, self.high)

    def value(self, part: float) -> float:
        """Return the value at a part of the range."""
        return self.low + (self.high - self.low) * float(part)

    def part(self, value: float) -> float:
        """Return the part of the range at which a value is."""
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Sensors:
    """What is known of sensors.

    Attributes:
        filters: corner frequencies [Hz] of first-order low-passes, by channel.
        offsets: channels with an unknown offset in each test.
        scales: channels with an unknown factor in each test.
        shift: time of the run less time of the data [s]; None: unknown in each test.
        rate_limits: largest change within a second that an output of a sensor can have, by channel.
    """

    filters: Mapping[str, float] = field(default_factory=dict)
    offsets: Sequence[str] = ()
    scales: Sequence[str] = ()
    shift: float | None = None
    rate_limits: Mapping[str, float] = field(default_factory=dict)


class Parameter(NamedTuple):
    """One unknown of interest: its label, what varies, and the test (None: all tests)."""

    label: str
    vary: Vary
    trial: int | None


@dataclass
class Series:
    """One channel of one test.

    Attributes:
        trial: number of the test.
        name: of the output.
        time: of the data [s], shape (samples,).
        values: in the unit of the output.
        noise: standard deviation that is stated; None: it is estimated.
        sigma: standard deviations of the samples; infinite: it does not count.
        extent: largest less smallest value.
        unknowns: which entries of the vector are its ``shift``, ``offset`` and ``scale``.
        peak: the highest sample of the run above both its neighbours, or below; as `values`.
    """

    trial: int
    name: str
    time: np.ndarray
    values: np.ndarray
    noise: float | None
    sigma: np.ndarray
    extent: float
    unknowns: dict[str, int]
    peak: float = 0.0

    @property
    def misses_impacts(self) -> bool:
        """Whether impacts are shorter than the time between two samples: peaks of one sample."""
        return self.peak > max(_MISSED * self.extent, _SEEN * float(self.sigma.min()))


@dataclass
class Slopes:
    """Derivatives of the run of a test.

    Attributes:
        x: the vector where they hold.
        is_central: of differences both ways, near x.
        by: with respect to each parameter of the test: of time and channels, as a run has them.
    """

    x: np.ndarray
    is_central: bool
    by: dict[int, np.ndarray]


class Problem:
    """What a fit minimises.

    Attributes:
        trials: the tests.
        parameters: unknowns of interest, first in the vector.
        series: every channel of every test.
        size: length of the vector.
        labels: of the entries behind the parameters: test, kind, channel (empty for a shift).
        step: part of the range over which differences go.
        ends: when runs of tests end that need not go on to their stop [s].
    """

    def __init__(
        self,
        planner: Planner,
        campaign: Campaign,
        trials: Sequence[Trial],
        vary: Sequence[Vary],
        sensors: Sensors,
        *,
        accuracy: float,
        is_open: bool = False,
        report: Callable[[int], None] = lambda _: None,
    ) -> None:
        """Lay out the unknowns; nothing runs yet. Cases of an open problem say when they end."""
        self.planner, self.trials, self.sensors = planner, list(trials), sensors
        self._campaign, self._report, self._vary = campaign, report, list(vary)
        self.accuracy = accuracy
        self.step = math.sqrt(accuracy)
        self._is_open, self._stop = is_open, float(planner.times[-1])
        self.ends: dict[int, float] = {}
        self._runs: dict[tuple, Any] = {}  # by case: a recording, or why there is none
        self.outcomes: dict[tuple, str] = {}
        self._slopes: dict[int, Slopes] = {}  # by test, where the search has them
        self.parameters = list(self._list_parameters())
        self.labels: list[tuple[int, str, str]] = []
        self.units: list[float] = []  # of these entries: what 1 means
        self._shifts: dict[int, float] = {}  # of tests, from which those of the vector count
        self.series = [s for number in range(len(self.trials)) for s in self._list_series(number)]
        self.size = len(self.parameters) + len(self.labels)
        self.forget_weights()

    def _list_parameters(self) -> Iterator[Parameter]:
        for vary in self._vary:
            owners = range(len(self.trials)) if vary.is_own else [None]
            for owner in owners:
                label = vary.name if owner is None else f"{vary.name} @ {self.trials[owner].name}"
                yield Parameter(label, vary, owner)

    def _list_series(self, number: int) -> Iterator[Series]:
        trial, shift = self.trials[number], {}
        if self.sensors.shift is None:
            span = float(np.ptp(self._find_times(number)))
            shift = {"shift": self._add(number, "shift", "", span)}
        for name in trial.channels:
            if trial.data is None:
                time = self._find_times(number)
                values = np.zeros(len(time))
            else:
                is_there = np.isfinite(trial.data[name])
                time, values = trial.data.time[is_there], trial.data[name][is_there]
            extent = float(np.ptp(values)) or float(np.max(np.abs(values))) or 1.0
            unknowns = dict(shift)
            if name in self.sensors.offsets:
                unknowns["offset"] = self._add(number, "offset", name, extent)
            if name in self.sensors.scales:
                unknowns["scale"] = self._add(number, "scale", name, 1.0)
            noise = trial.noise.get(name)
            yield Series(number, name, time, values, noise, np.ones(len(time)), extent, unknowns)

    def _find_times(self, number: int) -> np.ndarray:
        """Return the times of the samples of a test [s]."""
        data = self.trials[number].data
        return self.planner.times if data is None else data.time

    def _add(self, trial: int, kind: str, channel: str, unit: float) -> int:
        self.labels.append((trial, kind, channel))
        self.units.append(unit)
        return len(self.parameters) + len(self.labels) - 1

    # ------------------------------------------------------------------------------------ runs

    def list_trials(self, *, held: bool | None = False) -> list[int]:
        """Return the numbers of tests: those that are fitted, held back, or all (None)."""
        return [k for k, t in enumerate(self.trials) if held is None or t.is_held == held]

    def make_case(self, x: np.ndarray, trial: int) -> tuple:
        """Return the case of a test in the campaign."""
        values = {
            p.vary.name: p.vary.value(part)
            for p, part in zip(self.parameters, x, strict=False)
            if p.trial in (None, trial)
        }
        end = [self.ends.get(trial, self._stop)] if self._is_open else []
        return (self.trials[trial].name, *(values[vary.name] for vary in self._vary), *end)

    def cut(self, points: Sequence[np.ndarray], trials: Sequence[int]) -> None:
        """Let runs end after the data, as shifted at some vectors and by what a search may add.

        Those with a stated outcome go on: it may come after the data.
        """
        for k in trials if self._is_open and points else ():
            run = self.get_run(points[0], k)
            if self.trials[k].outcome or isinstance(run, str):
                continue
            first, second = run.time[:2]
            last = max(self._find_last(x, k) for x in points)
            span = float(np.ptp(self._find_times(k)))
            last += _LATER * span if self.sensors.shift is None else 0.0
            steps = math.ceil((last - first) / (second - first)) + 1
            end = float(first + steps * (second - first))
            if end < first + (1.0 - _SAVED) * (self._stop - first):
                self.ends[k] = end
                self._slopes.pop(k, None)

    def lengthen(self, ends: Mapping[int, float] = {}) -> None:
        """Let runs go on to their stop, or those of some tests to given ends."""
        if self.ends != ends:
            self.ends = dict(ends)
            self._slopes.clear()

    def is_short(self, x: np.ndarray) -> bool:
        """Return whether data go on behind the end of a run that was cut."""
        return any(end < min(self._find_last(x, k), self._stop) for k, end in self.ends.items())

    def _find_last(self, x: np.ndarray, trial: int) -> float:
        """Return the time of the run at the last sample [s]."""
        series = self.choose([trial])[0]
        return float(self._find_times(trial)[-1]) + self.find_unknown(x, series, "shift")

    def run(self, cases: Sequence[tuple]) -> None:
        """Run cases that are not known yet, side by side."""
        missing = [case for case in dict.fromkeys(cases) if case not in self._runs]
        if not missing:
            return
        self._campaign.run(missing)
        names = ["time", *self.planner.histories]
        for case in missing:
            result = self._campaign.known[case]
            if result.status != "done":
                self._runs[case] = result.reason or result.status
                self.outcomes[case] = result.status
                continue
            values = np.array(result.histories, dtype=float).T
            for name, corner in self.sensors.filters.items():
                column = names.index(name)
                values[:, column] = filter_low(values[:, 0], values[:, column], corner)
            for name, rate in self.sensors.rate_limits.items():
                column = names.index(name)
                values[:, column] = limit_rate(values[:, 0], values[:, column], rate)
            self._runs[case] = Recording({}, names, [""] * len(names), values)
            ends = dict(zip(self.planner.asked, result.outputs, strict=True))
            known = "outcome" in ends
            self.outcomes[case] = name_choice("outcome", ends["outcome"]) if known else "done"
        self._report(len(self._runs))

    def count_runs(self) -> int:
        """Return how many runs the fit asked for."""
        return len(self._runs)

    def list_reasons(self) -> list[str]:
        """Return why runs were not done, one text for each."""
        return [run for run in self._runs.values() if isinstance(run, str)]

    def explain_undone(self, what: str, cases: Iterable[tuple] | None = None) -> DockloopError:
        """Return the error of a fit that needs runs, of some cases or any, that are not done."""
        known = self._campaign.known
        runs = [(case, known[case]) for case in cases or self._runs]
        return explain_undone(runs, what, self.planner.explain_refusal)

    def require_run(self, x: np.ndarray, trial: int) -> Recording:
        """Return the run of a test. Raises DockloopError: it is not done."""
        run = self.get_run(x, trial)
        if isinstance(run, str):
            what = f"test '{self.trials[trial].name}' cannot be run"
            raise self.explain_undone(what, [self.make_case(x, trial)])
        return run

    def get_run(self, x: np.ndarray, trial: int) -> Any:
        """Return the run of a test, or why there is none."""
        case = self.make_case(x, trial)
        self.run([case])
        return self._runs[case]

    # ------------------------------------------------------------------------------- residuals

    def find_unknown(self, x: np.ndarray, series: Series, kind: str) -> float:
        """Return a shift [s], an offset in the unit of the channel, or a factor."""
        index = series.unknowns.get(kind)
        if index is None:
            return {"shift": self.sensors.shift or 0.0, "offset": 0.0, "scale": 1.0}[kind]
        return self.to_unit(x, index)

    def to_unit(self, x: np.ndarray, index: int) -> float:
        """Return an entry behind the parameters in its unit: shift, offset or factor."""
        trial, kind, _ = self.labels[index - len(self.parameters)]
        base = {"shift": self._shifts.get(trial, 0.0), "offset": 0.0, "scale": 1.0}[kind]
        return base + float(x[index]) * self.units[index - len(self.parameters)]

    def predict(self, x: np.ndarray, series: Series, run: Recording) -> np.ndarray:
        """Return what a channel would show at its samples."""
        offset, scale = (self.find_unknown(x, series, kind) for kind in ("offset", "scale"))
        return scale * self._read(x, series, run) + offset

    def _read(self, x: np.ndarray, series: Series, run: Recording, later: float = 0.0) -> Any:
        return self._interpolate(x, series, run.time - later, run.values)

    def _interpolate(
        self, x: np.ndarray, series: Series, time: np.ndarray, values: np.ndarray
    ) -> np.ndarray:
        """Return the channel of a series at its samples, from columns as a run has them."""
        column = values[:, 1 + self.planner.histories.index(series.name)]
        return np.interp(series.time + self.find_unknown(x, series, "shift"), time, column)

    def calc_residuals(self, x: np.ndarray, trials: Sequence[int] | None = None) -> np.ndarray:
        """Return run less data over standard deviation, shape (samples of all series,).

        Those of a run that was not done are NaN: a search takes a shorter step then.
        """
        trials = self.list_trials() if trials is None else trials
        self.run([self.make_case(x, trial) for trial in trials])
        parts = []
        for series in self.choose(trials):
            run = self.get_run(x, series.trial)
            if isinstance(run, str):
                parts.append(np.full(len(series.time), np.nan))
            else:
                parts.append((self.predict(x, series, run) - series.values) / series.sigma)
        return np.concatenate(parts)

    def calc_jacobian(
        self, x: np.ndarray, trials: Sequence[int] | None = None, *, is_central: bool = False
    ) -> np.ndarray:
        """Return the derivatives of the residuals, shape (samples of all series, unknowns).

        With `is_central`, differences go both ways. Parameters without a run on either side with
        the same outcome have zeros.
        """
        trials = self.list_trials() if trials is None else trials
        self.run([self.make_case(x, k) for k in trials])
        new = [k for k in trials if not self._follow(x, k, is_central=is_central)]
        sides = {(k, j): self._list_sides(x, k, j) for k in new for j in self._find_own(k)}
        wanted = {key: pair if is_central else pair[:1] for key, pair in sides.items()}
        self.run([case for pair in wanted.values() for case, _ in pair])
        for (k, j), pair in wanted.items():
            if not any(self._is_alike(x, k, case) for case, _ in pair):
                wanted[k, j] = sides[k, j]
        self.run([case for pair in wanted.values() for case, _ in pair])
        for k in new:
            by = {j: self._find_slope(x, k, wanted[k, j]) for j in self._find_own(k)}
            self._slopes[k] = Slopes(x.copy(), is_central, by)
        return np.vstack(
            [self._calc_rows(x, s, self._slopes[s.trial]) for s in self.choose(trials)]
        )

    def _find_slope(self, x: np.ndarray, trial: int, sides: Sequence[tuple]) -> np.ndarray:
        """Return a derivative of a run by a difference; empty: there is no run."""
        if isinstance(run := self.get_run(x, trial), str):
            return np.zeros(0)
        alike = [(by, self._runs[case]) for case, by in sides if self._is_alike(x, trial, case)]
        ends = sorted([(0.0, run), *alike], key=lambda end: end[0])
        (low, first), (high, last) = ends[0], ends[-1]
        return (last.values - first.values) / (high - low or 1.0)

    def _follow(self, x: np.ndarray, trial: int, *, is_central: bool) -> bool:
        """Return whether the derivatives of a run go along to here, and correct them."""
        if not (slopes := self._slopes.get(trial)) or (is_central and not slopes.is_central):
            return False
        case = self.make_case(x, trial)
        if not self._is_alike(slopes.x, trial, case):
            return False
        own = self._find_own(trial)
        way = x[own] - slopes.x[own]
        length = float(np.linalg.norm(way))
        if length < self.step or is_central:
            return length < self.step
        old, new = self.get_run(slopes.x, trial), self._runs[case]
        change = new.values - old.values
        missed = change - sum(slopes.by[j] * by for j, by in zip(own, way, strict=True))

        def size(part: np.ndarray) -> float:
            chosen = self.choose([trial])
            rows = [self._interpolate(x, s, new.time, part) / s.sigma for s in chosen]
            return float(np.linalg.norm(np.concatenate(rows)))

        if size(missed) > _FORESEEN * size(change):
            return False
        by = {j: slopes.by[j] + missed * (w / length**2) for j, w in zip(own, way, strict=True)}
        self._slopes[trial] = Slopes(x.copy(), False, by)
        return True

    def _calc_rows(self, x: np.ndarray, series: Series, slopes: Slopes | None) -> np.ndarray:
        """Return the rows of one series; without derivatives of runs only those behind them."""
        rows = np.zeros((len(series.time), self.size))
        run = self.get_run(x, series.trial)
        if isinstance(run, str):
            return rows
        scale, base = self.find_unknown(x, series, "scale"), self._read(x, series, run)
        for j, slope in slopes.by.items() if slopes else ():
            rows[:, j] = scale * self._interpolate(x, series, run.time, slope)
        for kind, index in series.unknowns.items():
            unit = self.units[index - len(self.parameters)]
            if kind == "shift":
                half = 0.5 * float(run.time[1] - run.time[0])
                later, sooner = (self._read(x, series, run, by) for by in (half, -half))
                rows[:, index] = unit * scale * (later - sooner) / (2.0 * half)
            else:
                rows[:, index] = unit * (base if kind == "scale" else 1.0)
        return rows / series.sigma[:, None]

    def choose(self, trials: Sequence[int]) -> list[Series]:
        """Return every channel of some tests."""
        return [series for series in self.series if series.trial in trials]

    def split(self, rows: np.ndarray, trials: Sequence[int]) -> list[np.ndarray]:
        """Return the rows of every channel of some tests."""
        return np.split(rows, np.cumsum([len(s.time) for s in self.choose(trials)])[:-1])

    def smooth(self, rows: np.ndarray, part: float) -> np.ndarray:
        """Return residuals or derivatives of the fitted tests as means over a part of their time.

        Of a load this is its impulse: impacts that come a little later change it by little.
        """
        split = self.split(rows, self.list_trials())
        return np.concatenate(
            [gaussian_filter1d(r, part * len(r), axis=0, mode="constant") for r in split]
        )

    def _find_own(self, trial: int) -> list[int]:
        """Return which parameters a test has."""
        return [j for j, p in enumerate(self.parameters) if p.trial in (None, trial)]

    def _list_sides(self, x: np.ndarray, trial: int, j: int) -> list[tuple[tuple, float]]:
        """Return the cases on either side in one parameter, and how far away they are."""
        found = []
        for by in (self.step, -self.step):
            moved = x.copy()
            moved[j] = min(max(x[j] + by, 0.0), 1.0)
            if moved[j] != x[j]:
                found.append((self.make_case(moved, trial), float(moved[j] - x[j])))
        return found

    def _is_alike(self, x: np.ndarray, trial: int, case: tuple) -> bool:
        """Return whether a case was done and has the outcome of the unmoved one."""
        same = self.outcomes[self.make_case(x, trial)]
        return self.outcomes[case] == same and not isinstance(self._runs[case], str)

    def compare_outcome(self, x: np.ndarray, trial: int) -> dict[str, Any]:
        """Return what became of a docking here, and if measured, of that and whether both agree."""
        computed, stated = self.outcomes[self.make_case(x, trial)], self.trials[trial].outcome
        measured, run = self.trials[trial].is_captured, self.get_run(x, trial)
        if stated:
            return {"computed": computed, "measured": stated, "agrees": computed == stated}
        if measured is None or isinstance(run, str):
            return {"computed": computed}
        agrees = bool((run["captured"] > 0.5).any()) == measured
        said = "captured" if measured else "not captured"
        return {"computed": computed, "measured": said, "agrees": agrees}

    def list_changes(self, x: np.ndarray) -> list[str]:
        """Return sentences on outcomes that change within one difference from here."""
        found = []
        for k in self.list_trials():
            here = self.outcomes[self.make_case(x, k)]
            at = self._slopes[k].x if k in self._slopes else x  # where differences were taken
            for j in self._find_own(k):
                sides = self._list_sides(at, k, j)
                others = {self.outcomes.get(case, here) for case, _ in sides} - {here}
                if others:
                    found.append(
                        f"'{self.trials[k].name}' is {here} here and {', '.join(sorted(others))}"
                        f" within {self.step:.1%} of the range of {self.parameters[j].label}"
                    )
        return found

    # --------------------------------------------------------------------- shifts and weights

    def polish(self, x: np.ndarray, trials: Sequence[int] | None = None) -> np.ndarray:
        """Return the vector with the best shifts, offsets and scales for these parameters."""
        trials = self.list_trials() if trials is None else trials
        first = len(self.parameters)
        free = [first + i for i, (k, *_) in enumerate(self.labels) if k in trials]
        self.run([self.make_case(x, k) for k in trials])
        if not free or any(isinstance(self.get_run(x, k), str) for k in trials):
            return x
        moved = x.copy()

        def put(way: np.ndarray) -> np.ndarray:
            moved[free] = x[free] + way
            return moved

        def calc_rows(way: np.ndarray) -> np.ndarray:
            rows = [self._calc_rows(put(way), s, None) for s in self.choose(trials)]
            return np.vstack(rows)[:, free]

        found = least_squares(
            lambda way: self.calc_residuals(put(way), trials),
            np.zeros(len(free)),  # the length of the start limits the first step, unless it is 0
            calc_rows,
            max_nfev=30,
        )
        return put(found.x).copy()

    def shift(self, x: np.ndarray, trials: Sequence[int]) -> np.ndarray:
        """Return the vector with the time shift of each test that fits all its channels best."""
        x = x.copy()
        for k in trials if self.sensors.shift is None else ():
            data, run = self.trials[k].data, self.get_run(x, k)
            if data is not None and not isinstance(run, str):
                unknowns = {s.name: s.unknowns for s in self.choose([k])}
                index = next(iter(unknowns.values()))["shift"]
                found = float(find_shift(run, data, unknowns))
                base = self._shifts.setdefault(
                    k, found
                )  # so that the vector has entries of about 1
                x[index] = (found - base) / self.units[index - len(self.parameters)]
        return x

    def _find_inside(self, x: np.ndarray, series: Series, run: Recording) -> np.ndarray:
        """Return which samples fall into the run. Raises TooFewSamplesError."""
        data, shift = self.trials[series.trial].data, self.find_unknown(x, series, "shift")
        if data is not None:
            origin = "found" if self.sensors.shift is None else "given"
            check_overlap(Path(self.trials[series.trial].file), run, data, shift, origin)
        time = series.time + shift
        return (time >= run.time[0]) & (time <= run.time[-1])

    def mask(self, x: np.ndarray, trials: Sequence[int]) -> None:
        """Let samples outside of the run not count. Raises TooFewSamplesError."""
        for series in self.choose(trials):
            run = self.get_run(x, series.trial)
            if not isinstance(run, str):
                inside = self._find_inside(x, series, run)
                series.sigma = np.where(inside, series.sigma, np.inf)

    def forget_weights(self) -> None:
        """Let all samples of a channel count the same, as before anything is known."""
        for s in self.series:
            sigma = _FAR * s.extent if s.noise is None else s.noise
            s.sigma = np.full(len(s.time), sigma)

    def find_resolution(self, chosen: Sequence[Series]) -> float:
        """Return the singular value of derivatives of channels that errors of differences have."""
        extents = np.concatenate([series.extent / series.sigma for series in chosen])
        return self.accuracy / (2.0 * self.step) * float(np.linalg.norm(extents))

    def find_floor(self, name: str) -> float:
        """Return the standard deviation of a channel below which errors of runs decide."""
        return 10.0 * self.accuracy * max(s.extent for s in self.series if s.name == name)

    def weigh(
        self,
        x: np.ndarray,
        trials: Sequence[int],
        *,
        is_robust: bool,
        noise: Mapping[str, float] = {},
    ) -> dict[str, float]:
        """Set the standard deviations of all samples from the run; return those of channels.

        Samples outside of the run do not count.

        Args:
            x: the vector.
            trials: numbers of tests.
            is_robust: from the median of the residuals.
            noise: of channels whose standard deviation is known; it follows from x elsewhere.

        Raises:
            DockloopError: a test cannot be run.
        """
        parts: dict[str, list[tuple[Any, ...]]] = {}  # series, error, bend, inside
        for series in self.choose(trials):
            run = self.require_run(x, series.trial)
            inside = self._find_inside(x, series, run)
            time = series.time + self.find_unknown(x, series, "shift")
            scale = abs(self.find_unknown(x, series, "scale"))
            bend = scale * find_bends(run.time, run[series.name], time)
            values = self.predict(x, series, run)
            series.peak, error = find_peak(values[inside]), values - series.values
            parts.setdefault(series.name, []).append((series, error, bend, inside))
        found: dict[str, float] = {}
        for name, entries in parts.items():
            errors, bends = (np.concatenate([e[i][e[3]] for e in entries]) for i in (1, 2))
            own = estimate_noise(errors, bends, is_robust=is_robust)
            found[name] = noise.get(name, max(own, self.find_floor(name)))
            for series, _, bend, inside in entries:
                sigma = found[name] if series.noise is None else series.noise
                series.sigma = np.where(inside, sigma + bend**2 / sigma, np.inf)
        return found


def filter_low(time: np.ndarray, values: np.ndarray, corner: float) -> np.ndarray:
    """Return what a first-order low-pass makes of values at equal steps, exact between them.

    Args:
        time: [s], shape (points,).
        values: shape (points,).
        corner: frequency [Hz].
    """
    part = 2.0 * math.pi * corner * float(time[1] - time[0])
    kept = math.exp(-part)
    new = 1.0 - (1.0 - kept) / part
    old = (1.0 - kept) / part - kept
    filtered, _ = lfilter([new, old], [1.0, -kept], values, zi=[values[0] * (1.0 - new)])
    return filtered


def limit_rate(time: np.ndarray, values: np.ndarray, rate: float) -> np.ndarray:
    """Return values at equal steps that follow others, but change by at most a rate [1/s]."""
    most = rate * float(time[1] - time[0])
    follow = itertools.accumulate(values.tolist(), lambda y, v: min(max(v, y - most), y + most))
    return np.fromiter(follow, float, len(values))


def find_bends(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return by how much values between points may differ from a straight line: rms at a jump."""
    second = np.zeros(len(values))
    second[1:-1] = np.abs(np.diff(values, 2)) / math.sqrt(3.0)
    cell = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    return np.maximum(second[cell], second[cell + 1])


def find_peak(values: np.ndarray) -> float:
    """Return by how much a value is above both its neighbours, or below, at most."""
    left, right = np.diff(values)[:-1], -np.diff(values)[1:]
    sides = np.minimum(np.abs(left), np.abs(right))
    return float(sides[left * right > 0.0].max(initial=0.0))


def estimate_noise(errors: np.ndarray, bends: np.ndarray, *, is_robust: bool) -> float:
    """Return the standard deviation of samples, of which those at bends count less."""
    if is_robust:
        return float(1.4826 * np.median(np.abs(errors)))
    variance = float(np.mean(errors**2))
    for _ in range(_ROUNDS):
        weights = (1.0 + bends**2 / variance) ** -2 if variance > 0.0 else np.ones(len(errors))
        variance = float(np.sum(weights * errors**2) / np.sum(weights))
    return math.sqrt(variance)
