"""The command ``dockloop fit``, and the same in Python: `fit` and `plan_fit`."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.base import paths
from dockloop.base.errors import UsageError, names_arguments, warn
from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import (
    check_suffix,
    claim,
    figure_kind,
    json_kind,
    scratch,
    table_kind,
    write_csv,
)
from dockloop.base.number import as_number
from dockloop.base.paths import as_path, shown
from dockloop.base.progress import ProgressBar, import_optional
from dockloop.base.sections import find_html, html_kind, write_html
from dockloop.result.summary import write_summary
from dockloop.runs.docking import Scene
from dockloop.scene.copies import make_copy, write_copy
from dockloop.scene.find import find_scene
from dockloop.scene.resolve import SceneReader, is_scene_key
from dockloop.studies.fits import report
from dockloop.studies.fits.order import WORK, Fitted, Order, check_count, draw_cases, work
from dockloop.studies.fits.problem import Sensors, Vary
from dockloop.studies.fits.trials import Trial, list_trials
from dockloop.sweeps.campaign import read_how
from dockloop.sweeps.journal import journal_kind, keeps_results
from dockloop.sweeps.settings import (
    Settings,
    give_accuracy,
    make_experiment,
    name_scene,
    parse_range,
    parse_settings,
)

if TYPE_CHECKING:
    import pandas as pd

COMMAND = "dockloop fit"
_BEGIN = "# Fitted numbers by: dockloop fit"
_COPY = table_kind("scene", COMMAND, _BEGIN)
_CASES = table_kind("table", COMMAND, "name,")
_ACCURACY = 1e-6  # of runs


@dataclass
class Fit:
    """Parameters with their uncertainty.

    Attributes:
        summary: what ``dockloop fit --json`` prints.
    """

    summary: dict[str, Any]
    _fitted: Fitted

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by name, in the units of the quantities."""
        return self.summary["values"]

    @property
    def deviations(self) -> dict[str, float | None]:
        """Standard deviations by name; None: these data do not determine it."""
        return self.summary["deviations"]

    @property
    def correlations(self) -> dict[str, dict[str, float | None]]:
        """Correlations of every pair of parameters, by names."""
        return self.summary["correlations"]

    @property
    def not_identified(self) -> list[dict[str, Any]]:
        """What these data do not determine: ``parameters`` and a ``sentence``."""
        return self.summary["not_identified"]

    @property
    def residuals(self) -> dict[str, dict[str, Any]]:
        """How well each channel of each test is met, before and after."""
        return self.summary["residuals"]

    def plot(self) -> Any:
        """Draw measured and computed histories; returns a ``matplotlib.figure.Figure``."""
        import_optional("matplotlib")
        return report.draw_fit(self._fitted)

    def draw(self, count: int, seed: int = 0) -> "pd.DataFrame":
        """Draw parameters of all tests with their covariance, within their ranges.

        The table is one of cases for `dockloop.sweep`. What is not determined is anywhere.
        """
        check_count(self._fitted.order, count)
        columns, rows = draw_cases(self.summary, count, seed)
        return import_optional("pandas").DataFrame(rows, columns=columns)

    def apply(self, path: str | Path) -> None:
        """Write a copy of the scene with the fitted numbers.

        Raises:
            UsageError: the file is there and of something else, or a number is no key of the scene.
        """
        _apply(self._fitted, self.summary, as_path("apply", path))


@names_arguments
def fit(
    scene: str | Path | Scene | Mapping[str, Any],
    data: Any,
    vary: Mapping[str, tuple[float, float]],
    *,
    vary_each: Mapping[str, tuple[float, float]] | None = None,
    overrides: Mapping[str, Any] | None = None,
    start_values: Mapping[str, Any] | None = None,
    stop: float | None = None,
    step: float | None = None,
    columns: str | Sequence[str] = (),
    csv: str = "",
    noise: Mapping[str, float] | None = None,
    filters: Mapping[str, float] | None = None,
    rate_limits: Mapping[str, float] | None = None,
    offsets: str | Sequence[str] = (),
    scales: str | Sequence[str] = (),
    shift: float | None = None,
    loss: str = "linear",
    starts: int = 8,
    seed: int = 0,
    accuracy: float | None = None,
    profile: bool = False,
    output: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
) -> Fit:
    """Find parameters from measurements, with their uncertainty.

    Args:
        scene: name of a shipped scene, path of a ``.toml`` file, its members, or a
            `dockloop.Scene`.
        data: one or several tests: path of a table, path of a TOML list of tests, or the members of
            such a test (``{"file": "slow.csv", "set": {"initial.closing_speed": 0.05}}``).
        vary: low and high by name: a key of the scene or a variable of the FMU.
        vary_each: the same, where each test has a value of its own.
        overrides: keys of the scene that all tests have otherwise.
        start_values: values of variables that all tests start with.
        stop: end of a run [s]; default: that of the scene, or sooner with the data of a test.
        step: communication step [s]; default: that of the scene, or that of the data if smaller.
        columns: what columns mean, as ``--columns``.
        csv: form of the tables, as ``--csv``.
        noise: standard deviations by channel, in the unit of the output; default: estimated.
        filters: corner frequencies of first-order sensors by channel [Hz].
        rate_limits: largest change within a second of outputs of sensors, by channel, in the unit
            of the output.
        offsets: channels with an unknown offset in each test.
        scales: channels with an unknown factor in each test.
        shift: time of the run less time of the data [s]; default: unknown in each test.
        loss: ``"linear"``, or ``"soft_l1"`` against outliers.
        starts: of the search, at most; all but one are for a result in doubt.
        seed: of these.
        accuracy: wanted relative error of the runs; default: 1e-6.
        profile: show how fast other values of the worst pair meet the measurements worse.
        output: a ``.json`` file for the summary; the journal is next to it. Default: no files.
        workers: threads; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with the journal of `output`.

    Raises:
        UsageError: naming what is bad, its value and the limit.
        DockloopError: a package is missing, or no run could be made.
    """
    import_optional("scipy")
    order = _make_order(
        scene, data, (overrides, start_values),
        {"vary": vary, "vary_each": vary_each},
        experiment=make_experiment(stop, step), accuracy=accuracy,
        columns=_as_names(columns), form=csv, noise=noise or {},
        sensors=_make_sensors(filters, offsets, scales, shift, rate_limits),
        loss=loss, starts=starts, seed=seed, is_profiled=profile,
    )  # fmt: skip
    with scratch() as folder:
        place = _claim_summary(as_path("-o", output) if output else folder / f"{WORK}.json")
        journal = place.with_suffix(".jsonl")
        fitted = work(order, journal, workers=workers, scheduler=scheduler, resume=resume)
    summary = report.summarise_fit(fitted)
    if output:
        write_summary(summary, place, [place])
    return Fit(summary, fitted)


def _claim_summary(path: Path) -> Path:
    """Make sure, before any work, that the summary of a fit can be written; returns its file."""
    check_suffix(path, ".json")
    claim(path, json_kind("fit", COMMAND))
    return path


@names_arguments
def plan_fit(
    scene: str | Path | Scene | Mapping[str, Any],
    tests: Any,
    vary: Mapping[str, tuple[float, float]],
    *,
    vary_each: Mapping[str, tuple[float, float]] | None = None,
    overrides: Mapping[str, Any] | None = None,
    start_values: Mapping[str, Any] | None = None,
    stop: float | None = None,
    step: float | None = None,
    noise: Mapping[str, float] | None = None,
    filters: Mapping[str, float] | None = None,
    rate_limits: Mapping[str, float] | None = None,
    offsets: str | Sequence[str] = (),
    scales: str | Sequence[str] = (),
    shift: float | None = None,
    accuracy: float | None = None,
    workers: int | None = None,
) -> dict[str, Any]:
    """Say before measuring which test would say most about which parameter.

    Args:
        scene: as for `fit`.
        tests: path of a TOML list of tests, or the members of tests, with ``set`` and ``noise``.
        vary: as for `fit`; derivatives are those at the values of the scene.
        vary_each: as for `fit`.
        overrides: as for `fit`.
        start_values: as for `fit`.
        stop: as for `fit`.
        step: time between two samples [s]; default: that of the scene.
        noise: channels of all tests with their standard deviations.
        filters: as for `fit`.
        rate_limits: as for `fit`.
        offsets: as for `fit`.
        scales: as for `fit`.
        shift: as for `fit`.
        accuracy: as for `fit`.
        workers: threads.

    Returns:
        What ``dockloop fit --plan --json`` prints.
    """
    order = _make_order(
        scene, tests, (overrides, start_values), {"vary": vary, "vary_each": vary_each},
        experiment=make_experiment(stop, step), accuracy=accuracy,
        noise=noise or {},
        sensors=_make_sensors(filters, offsets, scales, shift, rate_limits), is_plan=True,
    )  # fmt: skip
    with scratch() as folder:
        return report.summarise_plan(work(order, folder / "plan.jsonl", workers=workers))


def _make_order(
    scene: Any,
    data: Any,
    settings: Sequence[Mapping[str, Any] | None],
    ranges: Mapping[str, Any],
    *,
    accuracy: float | None,
    **more: Any,
) -> Order:
    """Return what is asked for in Python."""
    reference, merged = name_scene(scene, *settings)
    tests = [data] if isinstance(data, str | Path | Mapping) else data
    tests = list(tests) if isinstance(tests, Iterable) else [tests]
    for test in tests:
        if not isinstance(test, str | Path | Mapping):
            raise UsageError(f"data has {test!r}: must be a path or the members of a test")
    wanted = [
        Vary(name, *_read_ends(name, ends), option == "vary_each")
        for option, table in ranges.items()
        for name, ends in (table or {}).items()
    ]
    return Order(reference, tests, wanted, _choose_accuracy(merged, accuracy), **more)


def _make_sensors(
    filters: Mapping[str, float] | None,
    offsets: str | Sequence[str],
    scales: str | Sequence[str],
    shift: float | None,
    rate_limits: Mapping[str, float] | None,
) -> Sensors:
    return Sensors(filters or {}, _as_names(offsets), _as_names(scales), shift, rate_limits or {})


def _as_names(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return a list of texts; a text is a list of one."""
    return (names,) if isinstance(names, str) else tuple(names)


def _choose_accuracy(settings: Settings, accuracy: float | None) -> Settings:
    """Return the settings with the accuracy. Raises UsageError: it is given twice."""
    given = [name for name in ("accuracy", "solver.accuracy") if name in settings]
    if len(given) + (accuracy is not None) > 1:
        raise UsageError(
            f"--accuracy: is given twice, {given[0]} = {settings[given[0]]!r} too: leave one out"
        )
    if accuracy is not None:
        return settings | give_accuracy(accuracy)
    if not given:
        return settings | {"accuracy": _ACCURACY}
    begin = settings.given_by.get(given[0], "fit")
    return settings | Settings({"accuracy": settings[given[0]]}, {"accuracy": begin})


def _read_ends(name: str, ends: Any) -> tuple[float, float]:
    if not (isinstance(ends, Sequence | np.ndarray) and len(ends) == 2):
        raise UsageError(f"vary {name}: is {ends!r}: must be low and high")
    low, high = map(as_number, ends)
    return low, high


# ------------------------------------------------------------------------------------ command


def run_command(options: argparse.Namespace) -> dict[str, Any]:
    """Fit or plan, write the files, and return the summary.

    Raises:
        UsageError: an option or a file is bad.
        DockloopError: the work failed.
    """
    name = find_scene(options.scene).stem
    output = _claim_summary(options.output or paths.RESULTS / "fits" / name / f"{WORK}.json")
    for member in ("apply", "cases", "profile"):
        if options.plan and getattr(options, member):
            raise UsageError(f"--{member}: a plan has no fitted numbers: leave it or --plan out")
    figure, page, copy = output.with_suffix(".png"), find_html(output), options.apply
    cases = output.with_name(f"{output.stem}_cases.csv")
    claim(output.with_suffix(".jsonl"), journal_kind(WORK))
    for is_written, path, kind in (
        (not options.no_plots, figure, figure_kind(COMMAND)),
        (options.report, page, html_kind(COMMAND)),
        (copy, copy, _COPY),
        (options.cases, cases, _CASES),
    ):
        if is_written:
            claim(path, kind)
    order = _read_order(options)
    if copy:
        keys, _ = _list_shared(order, list_trials(order.data, is_plan=False))
        make_copy(order.scene, keys | {vary.name: vary.low for vary in _list_keys(order)}, copy)
    if options.cases:
        check_count(order, options.cases)
    fitted = work(order, output.with_suffix(".jsonl"), ProgressBar(name), **read_how(options))
    files = [output]
    with keeps_results():
        summary = (report.summarise_plan if options.plan else report.summarise_fit)(fitted)
        figures = []
        if not (options.no_plots or options.plan) and can_draw():
            save_figure(report.draw_fit(fitted), figure, COMMAND)
            figures.append(figure)
        if copy:
            _apply(fitted, summary, copy)
            files.append(copy)
        if options.cases:
            write_csv(cases, _CASES, *draw_cases(summary, options.cases, options.seed))
            files.append(cases)
        files += figures
        if options.report:
            sections = report.complete_report(summary, fitted, figures)
            write_html(page, COMMAND, sections)
            files.append(page)
        write_summary(summary, output, files)
    return summary


def _read_order(options: argparse.Namespace) -> Order:
    """Return what the options ask for."""
    settings = parse_settings("--scene", options.overrides) | parse_settings("--set", options.set)
    wanted = [
        Vary(*parse_range(option, given), option == "--vary-each")
        for option, ranges in (("--vary", options.vary), ("--vary-each", options.vary_each))
        for given in ranges
    ]
    return Order(
        options.scene,
        options.data,
        wanted,
        _choose_accuracy(settings, options.accuracy),
        make_experiment(options.stop, options.step),
        tuple(options.columns),
        options.csv or "",
        parse_settings("--noise", options.noise),
        Sensors(
            parse_settings("--filter", options.filters),
            tuple(options.offsets),
            tuple(options.scales),
            options.shift,
            parse_settings("--rate-limit", options.rate_limits),
        ),
        options.loss,
        options.starts,
        options.seed,
        options.plan,
        options.profile,
    )


def _list_keys(order: Order) -> list[Vary]:
    """Return the keys that are fitted for all tests. Raises UsageError: one is no key."""
    shared = [vary for vary in order.vary if not vary.is_own]
    for vary in shared:
        if not is_scene_key(vary.name):
            raise UsageError(
                f"--apply: '{vary.name}' is no key of the scene, so a copy cannot have it: fit a"
                " key, or leave out --apply and set it by --set"
            )
    return shared


def _list_shared(order: Order, trials: Sequence[Trial]) -> tuple[dict[str, Any], list[str]]:
    """Return the keys that all tests have otherwise than the scene, and names of all the rest.

    The rest are start values, and what differs between tests: a copy of the scene cannot hold them.
    """
    reader, keys = SceneReader(find_scene(order.scene)), dict[str, Any]()
    names = dict.fromkeys(n for n in (*order.settings, *(n for t in trials for n in t.settings)))
    names.pop("accuracy")  # of the runs of a fit
    rest = [vary.name for vary in order.vary if vary.is_own]
    for name in names:
        first, *others = ({**order.settings, **t.settings}.get(name) for t in trials)
        found = reader.list_keys_like(name) if all(value == first for value in others) else []
        keys |= dict.fromkeys(found, first)
        rest += [] if found else [name]
    return keys, rest


def _apply(fitted: Fitted, summary: dict[str, Any], path: Path) -> None:
    """Write the copy of the scene; the summary names it, and a warning what it lacks."""
    is_known = {name: by is not None for name, by in summary["deviations"].items()}
    names = [vary.name for vary in _list_keys(fitted.order) if is_known[vary.name]]
    shared, rest = _list_shared(fitted.order, fitted.problem.trials)
    keys = {name: summary["values"][name] for name in names}
    claim(path, _COPY)
    note = ", ".join(keys) + (f"; of all tests: {', '.join(shared)}" if shared else "")
    write_copy(fitted.order.scene, shared | keys, path, _COPY, begin=_BEGIN, note=note)
    summary["applied"] = {"file": shown(path), "keys": keys, "shared": shared}
    if rest:
        warn(
            f"--apply: {shown(path)} has no {', '.join(rest)}: a copy holds the keys of the scene"
            " that all tests have, so give the others to each run"
        )
