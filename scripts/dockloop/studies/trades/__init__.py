"""``dockloop trade``: what accuracy costs, measured on one scene.

A grid of settings (level of the model, method of integration, tolerance or inner step,
communication step) is run through the FMU. Each run is compared with the reference solution and
priced: evaluations, steps, and processor time next to that of the default setting, which is run
again by turns. What pays is the Pareto front; what the FMU refuses is a row with the reason.

The FMU on the bench carries all methods of the grid, also `dae`, which other FMUs do not
carry (`dockloop.native.compiled`). A second name of a method is that method: it has no rows.

| file | what it holds |
|---|---|
| ``__init__.py`` | the grid; which settings of it are run; one row; all rows, kept in a journal |
| ``bench.py`` | the FMU, loaded once and run again and again |
| ``solution.py`` | the reference solution, of dockloop-compare or of the FMU at its best |
| ``columns.py`` | what is measured of a run: error against that solution, residuals, cost |
| ``report.py`` | front, recommendation, table, figure |
| ``command.py`` | `dockloop.trade`; what it shares with the command line |
| ``apply.py`` | ``--apply``: a copy of the scene with the recommended settings |
"""

import itertools
import math
import statistics
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

from dockloop.base.errors import DockloopError, UsageError, did_you_mean, is_watched, say
from dockloop.base.number import check_number, read_number
from dockloop.base.progress import ProgressBar
from dockloop.base.version import __version__
from dockloop.native.core import (
    FULL,
    REFERENCE,
    list_choices,
    list_compared_methods,
    list_different_methods,
    list_methods,
    name_choice,
    number_choice,
)
from dockloop.native.variables import happened
from dockloop.result.criteria import say_not_seen
from dockloop.result.peaks import list_steps_after
from dockloop.result.recording import Result
from dockloop.result.run_errors import find_compared, find_frame, find_scales, find_times
from dockloop.runs.outcome import Result as CaseResult
from dockloop.studies.trades.bench import Bench
from dockloop.studies.trades.columns import FIGURES, find_audits, find_error_columns
from dockloop.studies.trades.solution import find_solution
from dockloop.sweeps.campaign import Campaign, InTurn
from dockloop.sweeps.journal import InterruptedWorkError, Journal, make_digest, make_report

_MULTIPLIERS = "dae"  # the method of that level


@dataclass(frozen=True)
class Block:
    """Every combination of these values is a setting of the grid.

    Attributes:
        methods: values of solver.method.
        tolerances: of solver.rtol; the absolute ones keep their ratio to it.
        inner_steps: of solver.step [s], for fixed methods.
        steps: communication steps over that of the scene; none is longer than the run.
        levels: values of model.level; None: that of the FMU.
        forms: values of solver.dae_form.
    """

    methods: tuple[int, ...]
    tolerances: tuple[float | None, ...] = (None,)
    inner_steps: tuple[float | None, ...] = (None,)
    steps: tuple[int, ...] = (1, 10, 100)
    levels: tuple[int | None, ...] = (None,)
    forms: tuple[int | None, ...] = (None,)


_LADDER = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10, 1e-12)
_SHORT = (1e-3, 1e-6, 1e-9)
_INNER_STEPS = (4e-3, 2e-3, 1e-3, 5e-4)
_OF_OTHER_LEVELS = ("explicit", "rosenbrock")  # methods
_QUICK_STEPS, _QUICK_STRIDE = (1, 10), 3  # --quick: of every method; every third value of a ladder
_LOOKS = 40  # times, at least, at which a run is compared with the reference solution
_AFTER_CAPTURE = 1.0  # s that a run goes on by default
_PAIRS = 5  # most runs of a setting and of the default, one after the other ...
_ENOUGH = 1.0  # ... until those of the setting have taken so long [s]


def make_grid() -> tuple[Block, ...]:
    """Return the grid: every method that the core lists, once."""
    numbers: dict[str, list[int]] = {"carried": [], "fixed": [], "multipliers": []}
    for method in list_different_methods():
        kind = "fixed" if method["fixed_step"] else "carried"
        kind = "multipliers" if method["name"] == _MULTIPLIERS else kind
        numbers[kind].append(method["number"])
    carried, fixed, multipliers = map(tuple, numbers.values())
    simplified = range(1, number_choice("model.level", FULL))
    of_others = (number_choice("solver.method", name) for name in _OF_OTHER_LEVELS)
    return (
        Block(methods=carried, tolerances=_LADDER),
        Block(methods=fixed, inner_steps=_INNER_STEPS, steps=(1,)),
        Block(levels=tuple(simplified), methods=tuple(of_others), tolerances=_SHORT),
        Block(
            levels=(number_choice("model.level", REFERENCE),),
            methods=multipliers,
            forms=tuple(form.number for form in list_choices("solver.dae_form")),
            tolerances=_SHORT,
            steps=(10, 100),
        ),
    )


@dataclass(frozen=True)
class Setting:
    """One setting of the FMU and of its host; None: the FMU has no such thing, or ignores it."""

    level: int | None
    method: int
    dae_form: int | None
    rtol: float | None
    inner_step: float | None
    step: float

    @property
    def scheme(self) -> str:
        """Name of level and method, for example ``rigid, explicit``."""
        words = [] if self.level is None else [name_choice("model.level", self.level)]
        words.append(name_choice("solver.method", self.method))
        if self.dae_form is not None:
            words[-1] += f" {self.dae_form}"
        return ", ".join(words)

    @property
    def label(self) -> str:
        """The setting in words."""
        tuned = [f"rtol {self.rtol:g}"] if self.rtol is not None else []
        tuned += [f"inner step {self.inner_step:g} s"] if self.inner_step is not None else []
        return ", ".join([self.scheme, *tuned, f"step {self.step:g} s"])

    def starts(self, bench: Bench) -> dict[str, Any]:
        """Return the start values that make it."""
        reported = {
            "model.level": self.level,
            "solver.method": self.method,
            "solver.dae_form": self.dae_form,
            "solver.step": self.inner_step,
        }
        reported = {name: value for name, value in reported.items() if value is not None}
        if bench.start("accuracy"):  # of the scene; it would choose other values
            reported["accuracy"] = 0.0
        return reported | (bench.tolerances(self.rtol) if self.rtol is not None else {})


@dataclass(frozen=True)
class Choice:
    """What the user wants of the grid; empty: all of it.

    Attributes:
        levels: only these.
        methods: only these.
        tolerances: instead of those of the grid.
        steps: communication steps [s] instead of those of the grid.
        stop: end [s]; None: 1 s after the capture, in whole seconds, or that of the scene.
        quick: methods that FMUs carry (and those named), all at the same two communication steps,
            a third of the tolerances, no repeated timing, a reference solution of the FMU itself.
    """

    levels: tuple[int, ...] = ()
    methods: tuple[int, ...] = ()
    tolerances: tuple[float, ...] = ()
    steps: tuple[float, ...] = ()
    stop: float | None = None
    quick: bool = False


@dataclass
class Trade:
    """All that was measured.

    Attributes:
        rows: one per setting: its fields, ``setting``, ``scheme``, ``status``, ``reason``,
            ``is_default``, ``options`` (those of `dockloop run`) and the `FIGURES`.
        about: scene, end, reference solution, scales.
    """

    rows: list[dict]
    about: dict


def parse_numbers(option: str, text: str | None, least: float, most: float) -> tuple[float, ...]:
    """Parse numbers that are greater than `least`, at most `most` and separated by commas."""
    if text is None:
        return ()
    try:
        numbers = tuple(map(read_number, text.split(",")))
    except ValueError:
        wrong = f"{option} {text}: must be finite numbers separated by commas"
        raise UsageError(wrong) from None
    for number in numbers:
        if not least < number <= most:
            limit = f" and at most {most:g}" if math.isfinite(most) else ""
            raise UsageError(f"{option} {text}: must be greater than {least:g}{limit}")
    return numbers


def parse_names(option: str, text: str | None, variable: str) -> tuple[int, ...]:
    """Parse names or numbers of the values of a choice, separated by commas."""
    choices = list_choices(variable)
    numbers = {key: c.number for c in choices for key in (c.name, str(c.number))}
    chosen = []
    for word in text.split(",") if text is not None else ():
        if word.strip() not in numbers:
            all_of_them = ", ".join(f"{c.number} {c.name}" for c in choices)
            near = did_you_mean(word.strip(), [c.name for c in choices])
            near = near or f": must be of {all_of_them}"
            raise UsageError(f"{option} {text}: there is no '{word.strip()}'{near}")
        chosen.append(numbers[word.strip()])
    return tuple(chosen)


def parse_methods(text: str | None) -> tuple[int, ...]:
    """Parse names or numbers of methods; another name means the method that it stands for."""
    facts = {method["number"]: method for method in list_methods()}
    chosen = [facts[number] for number in parse_names("--methods", text, "solver.method")]
    for method in chosen:
        if not method["is_built"]:
            raise UsageError(f"--methods {text}: {method['name']}: {method['meaning']}")
    return tuple(dict.fromkeys(method["same_as"] or method["number"] for method in chosen))


def needs_comparison(choice: Choice) -> bool:
    """Return whether settings have methods that ordinary FMUs refuse."""
    return not choice.quick or not list_compared_methods().isdisjoint(choice.methods)


def find_default(bench: Bench) -> Setting:
    """Return the setting that the scene has by itself."""
    level, method = bench.start("model.level"), bench.start("solver.method")
    return Setting(level, method, None, bench.start("solver.rtol"), None, bench.step)


def make_settings(bench: Bench, choice: Choice, stop: float) -> list[Setting]:
    """Return the chosen settings of the grid, the default first.

    Raises:
        UsageError: there are none.
    """
    settings = [setting for block in make_grid() for setting in _expand(block, bench, choice, stop)]
    if choice.levels and bench.start("model.level") is None:
        raise UsageError("--levels: the FMU of this scene has no variable 'model.level'")
    if not settings:
        raise UsageError("the grid has no setting with these --levels and --methods: leave one out")
    return list(dict.fromkeys([find_default(bench), *settings]))


def run_trade(
    bench: Bench,
    choice: Choice,
    folder: Path,
    *,
    resume: bool = False,
    progress: ProgressBar | None = None,
) -> Trade:
    """Run the settings that are not done yet, and return all.

    Args:
        bench: the FMU of the scene.
        choice: of the grid.
        folder: for the journal.
        resume: go on with an interrupted run.
        progress: shows how far it is.

    Raises:
        UsageError: the choice or the journal is bad.
        InterruptedWorkError: by Ctrl-C.
    """
    default = find_default(bench)
    if choice.stop is not None:
        check_number("--stop", choice.stop)
    whole = _run_scene(bench, default) if choice.stop is None else None
    stop = choice.stop if choice.stop is not None else _find_stop(bench, whole)
    settings = make_settings(bench, choice, stop)
    names = find_compared(bench.outputs)
    try:
        interval = find_interval(bench.step, stop)
        solution = find_solution(bench, stop, interval, names, _say, quick=choice.quick)
        setup = {
            "dockloop": __version__,
            "FMU": bench.fmu_digest,
            "stop": stop,
            "truth": solution.key,
            "figures": list(FIGURES),
        }
        journal = Journal(
            folder / "trade.jsonl",
            setup,
            len(settings),
            resume=resume,
            work="trade",
            digest=make_digest([bench.scene, stop, [astuple(setting) for setting in settings]]),
        )
    except KeyboardInterrupt:
        raise InterruptedWorkError("interrupted before the first case") from None
    cases = [astuple(setting) for setting in settings]
    pairs = 1 if choice.quick else _PAIRS

    def work(values: tuple) -> CaseResult:
        setting = Setting(*values)
        return measure(bench, setting, default, solution.recording, stop, pairs=pairs)

    campaign = Campaign(journal, lambda: nullcontext(InTurn(work)))
    with campaign.at_work(lambda: cases):
        campaign.run(cases, report=make_report(progress))
    known = solution.recording
    doubt = find_error_columns(known, solution.doubt)["error"]
    about = {
        "scene": bench.scene["name"],
        "title": bench.scene["title"],
        "stop": stop,
        "not_seen": say_not_seen(stop, bench.stop, whole and list_steps_after(whole, stop)),
        "interval": float(known.time[1]),
        "default": default.label,
        "truth": {"source": solution.source, **solution.facts, "error": doubt},
        "frame": find_frame(names),
        "scales": find_scales(known),
    }
    rows = [make_row(bench, s, default, journal.known[astuple(s)], stop) for s in settings]
    return Trade(rows, about)


def measure(
    bench: Bench,
    setting: Setting,
    default: Setting,
    solution: Result,
    stop: float,
    *,
    pairs: int = _PAIRS,
) -> CaseResult:
    """Run one setting and the default by turns; compare and time it.

    Returns:
        ``outputs`` are the values of `FIGURES`.
    """
    starts, ordinary = setting.starts(bench), default.starts(bench)
    times, ordinary_times, first = [], [], None
    try:
        while len(times) < pairs and sum(times) < _ENOUGH:
            run = bench.run(starts, stop, setting.step)
            times.append(run.wall["do_step"])
            ordinary_times.append(bench.run(ordinary, stop, default.step).wall["do_step"])
            first = first or run
        seen = first
        if find_times(solution["time"], first["time"]) is None:
            seen = bench.probe(starts, stop, setting.step, solution["time"])
    except DockloopError as error:
        return CaseResult("refused" if isinstance(error, UsageError) else "failed", str(error))
    figures = find_error_columns(solution, seen) | find_audits(seen)
    for name, output in (
        ("evaluations", "solver.rhs_evaluations"),
        ("steps", "solver.steps"),
        ("rejected_steps", "solver.rejected_steps"),
    ):
        figures[name] = round(first[output][-1])
    figures["time_ratio"] = statistics.median(times) / statistics.median(ordinary_times)
    figures["time_ratio_of_best"] = min(times) / min(ordinary_times)
    warning = "; ".join(first.warnings) or None
    return CaseResult("done", None, warning, stop, tuple(figures[name] for name in FIGURES))


def make_row(
    bench: Bench, setting: Setting, default: Setting, result: CaseResult, stop: float
) -> dict:
    """Return all that is known of one setting."""
    words = [f"--set {n}={v:.12g}" for n, v in setting.starts(bench).items()]
    options = [*words, f"--stop {stop:.12g}", f"--step {setting.step:.12g}"]
    return {
        "setting": setting.label,
        "scheme": setting.scheme,
        **asdict(setting),
        "is_default": setting == default,
        "status": result.status,
        "reason": result.reason,
        "options": " ".join(options),
        **dict(zip(FIGURES, result.outputs or [None] * len(FIGURES), strict=True)),
    }


def _expand(block: Block, bench: Bench, choice: Choice, stop: float) -> Iterator[Setting]:
    """Yield the settings of a block that are wanted and that the FMU can be asked for."""
    stride = _QUICK_STRIDE if choice.quick else 1
    tolerances, inner_steps = block.tolerances[::stride], block.inner_steps[::stride]
    if choice.tolerances and block.tolerances != (None,):
        tolerances = choice.tolerances
    multiples = _QUICK_STEPS if choice.quick else block.steps
    steps = choice.steps or [multiple * bench.step for multiple in multiples]
    steps = sorted({float(f"{min(step, stop):.12g}") for step in steps})
    own_level = bench.start("model.level")
    if own_level is None:  # an FMU without levels: what it says to method dae is worth a row
        reference = number_choice("model.level", REFERENCE)
        levels = [None for level in block.levels if level in (None, reference)]
    else:
        levels = [own_level if level is None else level for level in block.levels]
        levels = [level for level in levels if not choice.levels or level in choice.levels]
    forms = block.forms if "solver.dae_form" in bench.variables else (None,)
    left_out = list_compared_methods() if choice.quick else set()
    methods = [m for m in block.methods if m in (choice.methods or {*block.methods} - left_out)]
    combined = itertools.product(levels, methods, forms, tolerances, inner_steps, steps)
    yield from itertools.starmap(Setting, combined)


def find_interval(step: float, stop: float) -> float:
    """Return how often runs are compared with that solution [s]: as often whatever their own steps.

    About ten or a hundred times the step of the scene, as long as that is often enough.
    """
    coarser = 10 ** math.floor(math.log10(max(1.0, stop / step / _LOOKS)))
    return stop / math.ceil(stop / (step * coarser) * (1.0 - 1e-12))


def _run_scene(bench: Bench, default: Setting) -> Result | None:
    """Return a recording of the whole scene; None: the scene has no capture that ends its runs."""
    if "time_of_capture" not in bench.outputs:
        return None
    return bench.run(default.starts(bench), bench.stop, default.step)


def _find_stop(bench: Bench, whole: Result | None) -> float:
    """Return the end by default: a little after the capture, or that of the scene."""
    if whole and happened(capture := whole["time_of_capture"][-1]):
        return min(bench.stop, float(math.ceil(capture + _AFTER_CAPTURE)))
    return bench.stop


def _say(text: str) -> None:
    if is_watched():
        say(f"\r\033[K{text}", end="")
