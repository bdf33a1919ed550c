"""What a fit found: a summary for programs, a report for people, a figure."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dockloop.base.files import MADE_BY
from dockloop.base.palette import BLUE, GREY, SKY, VERMILION
from dockloop.base.paths import shown
from dockloop.base.sections import FACTS, Section, list_files
from dockloop.base.tables import say_form
from dockloop.report.parts import describe_base, show_figure
from dockloop.studies.fits.plan import Planned
from dockloop.studies.fits.problem import Problem, Series
from dockloop.studies.fits.profile import choose_pair
from dockloop.studies.fits.search import MANY, Found
from dockloop.studies.fits.statistics import GUESS, QUANTILE, Estimate, describe_direction
from dockloop.sweeps.fitted import COMMAND

if TYPE_CHECKING:
    from dockloop.studies.fits.order import Fitted

_MOST_PANELS = 12
_ELLIPSE = 2.4477  # radius that holds 95 % of two normal parameters, in deviations
_STRONG = 0.9  # correlation that is said
_AT_BOUND, _ON_BOUND = 2e-3, 1e-4  # of the range: if uncertain by that, and in any case


def summarise_fit(fitted: "Fitted") -> dict[str, Any]:
    """Return what ``--json`` prints: all numbers of a fit."""
    problem, found = fitted.problem, fitted.found
    assert isinstance(found, Found)
    labels = [parameter.label for parameter in problem.parameters]
    values, deviations = _list_values(problem, found)
    made = found.estimate
    return {
        **_begin(fitted),
        "values": values,
        "deviations": deviations,
        "intervals": {
            name: None
            if (by := deviations[name]) is None
            else [values[name] - QUANTILE * by, values[name] + QUANTILE * by]
            for name in labels
        },
        "at_bound": [
            name
            for name, part, by in zip(labels, found.x, made.deviations, strict=False)
            if min(part, 1.0 - part) < min(_AT_BOUND, np.fmax(3.0 * by, _ON_BOUND))
        ],
        "correlations": {
            a: {b: _as_number(made.correlations[i, j]) for j, b in enumerate(labels)}
            for i, a in enumerate(labels)
        },
        "not_identified": _describe_directions(made, labels),
        "singular_values": made.singular.tolist(),
        "residuals": _describe_residuals(problem, found),
        "hidden": list(_list_hidden(problem, found)),
        "by_test": {
            trial.name: _describe_trial(problem, found, number)
            for number, trial in enumerate(problem.trials)
        },
        "starts": found.starts,
        "outcome_changes": found.changes,
        "loss": fitted.order.loss,
        "covariance": made.covariance[: len(labels), : len(labels)].tolist(),
        "worst_pair": [labels[i] for i in choose_pair(made)],
        "profile": _describe_profile(fitted) if fitted.profile else None,
    }


def _describe_profile(fitted: "Fitted") -> dict[str, Any]:
    """Return the profile in units: values of all parameters at its points."""
    parameters, profile = fitted.problem.parameters, fitted.profile
    assert profile
    held = parameters[profile.pair[0]].vary
    return {
        "parameters": [parameters[i].label for i in profile.pair],
        "values": {
            p.label: [p.vary.value(part) for part in profile.points[:, i]]
            for i, p in enumerate(parameters)
        },
        "rise": profile.rise.tolist(),
        "interval": [None if math.isnan(end) else held.value(end) for end in profile.interval],
    }


def summarise_plan(fitted: "Fitted") -> dict[str, Any]:
    """Return what ``--plan --json`` prints."""
    problem, found = fitted.problem, fitted.found
    assert isinstance(found, Planned)

    labels = [parameter.label for parameter in problem.parameters]
    spans = [p.vary.high - p.vary.low for p in problem.parameters]

    def name(deviations: np.ndarray) -> dict[str, float | None]:
        return dict(zip(labels, map(_as_number, deviations * spans), strict=True))

    trials = [trial.name for trial in problem.trials]
    alone = np.array([made.deviations for made in found.alone])
    return {
        **_begin(fitted),
        "guess": name(np.full(len(labels), GUESS)),
        "by_test": {
            trial: {
                "deviations": name(made.deviations),
                "not_identified": _describe_directions(made, labels),
                "channels": {
                    c: name(by.deviations) for (of, c), by in found.channels.items() if of == k
                },
                "outcome": problem.compare_outcome(found.x, k),
            }
            for k, (trial, made) in enumerate(zip(trials, found.alone, strict=True))
        },
        "order": [
            {"test": trials[k], "deviations": name(made.deviations)}
            for k, made in zip(found.order, found.together, strict=True)
        ],
        "best": {
            label: trials[int(np.nanargmin(alone[:, j]))]
            for j, label in enumerate(labels)
            if not np.isnan(alone[:, j]).all()
        },
        "not_identified": _describe_directions(found.together[-1], labels),
        "hidden": list(_list_missed(problem)),
        "outcome_changes": found.changes,
    }


def _describe_directions(made: Estimate, labels: Sequence[str]) -> list[dict[str, Any]]:
    """Return what data do not determine: parameters and a sentence for each direction."""
    described = (describe_direction(axis, labels) for axis in made.directions)
    return [{"parameters": names, "sentence": sentence} for names, sentence in described]


def _begin(fitted: "Fitted") -> dict[str, Any]:
    problem = fitted.problem
    return {
        MADE_BY: COMMAND,
        "scene": problem.planner.scene_reference,
        "set": dict(fitted.order.settings),
        "vary": {v.name: [v.low, v.high] for v in fitted.order.vary},
        "units": dict(zip([p.label for p in problem.parameters], fitted.units, strict=True)),
        "scene_values": {
            p.label: None if part is None else p.vary.value(part)
            for p, part in zip(problem.parameters, fitted.own, strict=True)
        },
        "runs": problem.count_runs(),
        "not_done": problem.list_reasons(),
        "ran": fitted.ran,
        "seconds": fitted.seconds,
    }


def _list_values(problem: Problem, found: Found) -> tuple[dict, dict]:
    """Return values and standard deviations by label."""
    values, deviations = {}, {}
    for i, parameter in enumerate(problem.parameters):
        low, high = parameter.vary.low, parameter.vary.high
        values[parameter.label] = parameter.vary.value(found.x[i])
        deviations[parameter.label] = _as_number(found.estimate.deviations[i] * (high - low))
    return values, deviations


def _as_number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _describe_trial(problem: Problem, found: Found, number: int) -> dict[str, Any]:
    """Return what a summary says of a test."""
    trial = problem.trials[number]
    unknowns: dict[str, Any] = {}
    for i, (of, kind, channel) in enumerate(problem.labels, len(problem.parameters)):
        if of == number:
            unit = problem.units[i - len(problem.parameters)]
            deviation = np.sqrt(found.estimate.covariance[i, i]) * unit
            unknowns[f"{kind} of {channel}" if channel else kind] = {
                "value": problem.to_unit(found.x, i),
                "deviation": float(deviation),
            }
    return {
        "file": shown(Path(trial.file)),
        "set": dict(trial.settings),
        "held_back": trial.is_held,
        "read": trial.data.source if trial.data else {},
        "outcome": problem.compare_outcome(found.x, number),
        "unknowns": unknowns,
    }


def _describe_residuals(problem: Problem, found: Found) -> dict[str, Any]:
    """Return how well each channel is met, by test and channel."""
    rows: dict[str, Any] = {}
    for series, judged, band in zip(problem.series, found.judged, found.bands, strict=True):
        inside = np.isfinite(series.sigma)
        error = _find_error(problem, found.x, series)[inside]
        before = None if found.before is None else _find_error(problem, found.before, series)
        stated = series.noise is not None
        is_known = not np.isnan(band).all()
        rows.setdefault(problem.trials[series.trial].name, {})[series.name] = {
            "unit": problem.planner.variables[series.name].unit,
            "samples": int(inside.sum()),
            "range": series.extent,
            "rms_before": None if before is None else _find_rms(before[inside]),
            "rms": _find_rms(error),
            "noise": series.noise if stated else found.noise.get(series.name),
            "noise_is": "stated" if stated else "estimated" if is_known else "not known",
            "in_band": float(np.mean(np.abs(error) <= band[inside])) if is_known else None,
            **judged,
        }
    return rows


def _find_error(problem: Problem, x: np.ndarray, series: Series) -> np.ndarray:
    run = problem.get_run(x, series.trial)
    if isinstance(run, str):
        return np.full(len(series.time), np.nan)
    return problem.predict(x, series, run) - series.values


def _find_rms(error: np.ndarray) -> float | None:
    return _as_number(float(np.sqrt(np.mean(error**2)))) if len(error) else None


def _list_missed(problem: Problem) -> Iterator[str]:
    """Yield sentences on tests that are sampled too slowly."""
    for number in problem.list_trials():
        if all(series.misses_impacts for series in problem.choose([number])):
            yield (
                f"every channel of '{problem.trials[number].name}' has impacts between two samples,"
                " which make false valleys: sample faster, or fit a channel of the motion too"
            )


def _list_hidden(problem: Problem, found: Found) -> Iterator[str]:
    """Yield sentences on what the residuals hide, or on why that is not known."""
    yield from _list_missed(problem)
    for series, judged, band in zip(problem.series, found.judged, found.bands, strict=True):
        channel = f"{series.name} in '{problem.trials[series.trial].name}'"
        if np.isnan(band).all():
            yield (
                f"the residuals of {channel} are not judged: no fitted test has it: state --noise"
                f" {series.name}=SIGMA"
            )
        counted, count = int(np.isfinite(series.sigma).sum()), len(series.time)
        if problem.sensors.shift is None and counted < MANY * count:
            yield (
                f"only {counted} of {count} samples of {channel} are within the run, at the shift"
                " that was found: state --shift if this is wrong"
            )
        if judged["hidden"]:
            yield (
                f"the residuals of {channel} hide something, most of it from {judged['from']:.4g}"
                f" to {judged['to']:.4g} s of its clock: {judged['hidden']}: the model is of"
                " another kind, or the noise is not white"
            )


# ------------------------------------------------------------------------------------- words


def report_fit(summary: dict[str, Any]) -> list[Section]:
    """Return the report of a fit or a plan."""
    if "order" in summary:
        return _report_plan(summary)
    rows = [
        (
            name,
            f"{value:.6g}",
            "not determined" if (by := summary["deviations"][name]) is None else f"{by:.2g}",
            "" if (ends := summary["intervals"][name]) is None else f"{ends[0]:.5g}",
            "" if ends is None else f"{ends[1]:.5g}",
            "" if (own := summary["scene_values"][name]) is None else f"{own:.5g}",
            _say_unit(summary["units"][name]),
        )
        for name, value in summary["values"].items()
    ]
    heads = ("parameter", "value", "deviation", "95 % from", "to", "scene", "unit")
    return [
        Section(f"Fit of {summary['scene']}", table=[FACTS, *_list_facts(summary)]),
        Section("Parameters", table=[heads, *rows]),
        Section("What to know", points=list(_list_points(summary))),
        *_report_profile(summary),
        *_report_residuals(summary),
        Section("Unknowns of tests", table=[("test", "unknown", "value", "deviation"), *(
            (test, name, each["value"], each["deviation"])
            for test, row in summary["by_test"].items() for name, each in row["unknowns"].items()
        )]),
    ]  # fmt: skip


def _list_facts(summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    tests = summary.get("by_test", {})
    names = [f"{name} (held back)" if row["held_back"] else name for name, row in tests.items()]
    yield "fitted", ", ".join(names)
    yield "runs", f"{summary['runs']} in {summary['seconds']:.1f} s"
    starts = (f"{count} {outcome}" for outcome, count in summary["starts"].items())
    yield "starts", ", ".join(starts)
    for name, row in tests.items():
        if form := say_form(row["read"].get("form", {})):
            yield f"table {name}", form
    if applied := summary.get("applied"):
        yield "copy", f"{applied['file']} has {', '.join(applied['keys']) or 'no fitted number'}"
    yield from list_files(summary.get("files", []))


def _list_points(summary: dict[str, Any]) -> Iterator[str]:
    """Yield what a user must know."""
    yield from (f"not identified: {each}" for each in _list_blind(summary))
    for name in summary["at_bound"]:
        yield f"{name} is at a bound of its range: widen the range, or doubt the model"
    names = list(summary["values"])
    for i, a in enumerate(names):
        for b in names[:i]:
            value = summary["correlations"][a][b]
            if value is not None and abs(value) > _STRONG:
                yield f"{b} and {a} are correlated by {value:+.2f}: read their deviations together"
    yield from _list_outcomes(summary, "with the fitted numbers")
    if reasons := summary["not_done"]:
        yield f"{len(reasons)} runs were not done, and the search went around: {reasons[0]}"
    yield from summary["hidden"]


def _report_profile(summary: dict[str, Any]) -> Iterator[Section]:
    """Yield how fast other values of the worst pair meet the measurements worse."""
    if not (profile := summary["profile"]):
        return
    first, *_ = pair = profile["parameters"]
    value, by = summary["values"][first], summary["deviations"][first]
    columns = [profile["values"][name] for name in pair]
    rows = [
        (
            *(f"{each:.6g}" for each in row),
            f"{rise:.3g}",
            "" if by is None else f"{((row[0] - value) / by) ** 2:.3g}",
        )
        for *row, rise in zip(*columns, profile["rise"], strict=True)
    ]
    low, high = profile["interval"]
    unit = _say_unit(summary["units"][first])
    ends = (
        "no lower bound" if low is None else f"from {low:.5g} {unit}".rstrip(),
        "no upper bound" if high is None else f"to {high:.5g} {unit}".rstrip(),
    )
    yield Section(
        f"Profile of {' and '.join(pair)}",
        points=[f"95 % of {first} by the profile: {', '.join(ends)}"],
        table=[(*pair, "rise of misfit", "if linear"), *rows],
    )


def _list_blind(row: dict[str, Any]) -> list[str]:
    return [each["sentence"] for each in row["not_identified"]]


def _list_outcomes(summary: dict[str, Any], numbers: str) -> Iterator[str]:
    """Yield which outcomes are others than the stated ones, and which change close by."""
    for name, row in summary["by_test"].items():
        if row["outcome"].get("agrees") is False:
            measured, computed = (row["outcome"][side] for side in ("measured", "computed"))
            yield f"outcome of '{name}': measured {measured}, {numbers} {computed}"
    yield from (
        f"outcome: {each}: no difference is taken across" for each in summary["outcome_changes"]
    )


def _report_residuals(summary: dict[str, Any]) -> Iterator[Section]:
    rows = [
        (
            test, name, row["samples"], row["rms_before"], row["rms"], row["noise"],
            row["noise_is"], "" if row["in_band"] is None else f"{row['in_band']:.0%}",
            _say_unit(row["unit"]),
        )
        for test, channels in summary["residuals"].items() for name, row in channels.items()
    ]  # fmt: skip
    heads = (
        *("test", "channel", "samples", "rms before", "rms", "noise", "is", "in 95 % band", "unit"),
    )
    yield Section("Residuals", table=[heads, *rows])


def _report_plan(summary: dict[str, Any]) -> list[Section]:
    names = list(summary["guess"])
    units = summary["units"]
    heads = [f"{n} [{_say_unit(units[n])}]" if _say_unit(units[n]) else n for n in names]

    def list_cells(row: dict[str, float | None]) -> list[str]:
        return ["not determined" if (by := row[n]) is None else f"{by:.3g}" for n in names]

    alone = [
        (test, "all", *list_cells(row["deviations"]), row["outcome"]["computed"])
        for test, row in summary["by_test"].items()
    ]
    channels = [
        (test, channel, *list_cells(deviations), "")
        for test, row in summary["by_test"].items()
        for channel, deviations in row["channels"].items()
        if len(row["channels"]) > 1
    ]
    order = [
        (i, row["test"], *list_cells(row["deviations"]))
        for i, row in enumerate(summary["order"], 1)
    ]
    points = [f"{test} says most about {name}" for name, test in summary["best"].items()]
    points += (f"not identified, by all together: {each}" for each in _list_blind(summary))
    points += (
        f"not identified, by {test} alone: {each['sentence']}"
        for test, row in summary["by_test"].items()
        for each in row["not_identified"]
        if len(each["parameters"]) > 1 < len(summary["by_test"])  # the table has the others
    )
    points += [*_list_outcomes(summary, "with the values of the scene"), *summary["hidden"]]
    facts = [
        ("expected", "standard deviations at the values of the scene"),
        ("runs", f"{summary['runs']} in {summary['seconds']:.1f} s"),
        *list_files(summary.get("files", [])),
    ]
    first = ("test", "channel")
    return [
        Section(f"Plan of tests of {summary['scene']}", points=points, table=[FACTS, *facts]),
        Section("One test alone", table=[(*first, *heads, "outcome"), *alone, *channels]),
        Section("In this order", table=[("number", "test", *heads), *order]),
    ]


def _say_unit(unit: str) -> str:
    return "" if unit == "1" else unit.replace(".", " ")


def complete_report(
    summary: dict[str, Any], fitted: "Fitted", figures: Sequence[Path]
) -> list[Section]:
    """Return the report as a page has it: with figure, scene and settings."""
    planner = fitted.problem.planner
    head, *others = report_fit(summary)
    names = list(summary["units"])
    correlations = (
        [(a, *(summary["correlations"][a][b] for b in names)) for a in names]
        if "correlations" in summary
        else []
    )
    return [
        head,
        *others,
        Section("Correlations", table=[("", *names), *correlations]),
        *(show_figure(figure) for figure in figures),
        *describe_base(planner, []),
    ]


# ------------------------------------------------------------------------------------- figure


def draw_fit(fitted: "Fitted") -> Any:
    """Return the figure: every channel with its band and its residuals, then the profile."""
    from matplotlib.figure import Figure

    problem, found = fitted.problem, fitted.found
    assert isinstance(found, Found)
    chosen = list(zip(problem.series, found.bands, strict=True))[:_MOST_PANELS]
    rows = len(chosen) + (fitted.profile is not None)
    figure = Figure(figsize=(11, 1.0 + 2.2 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, squeeze=False, width_ratios=(2, 1))
    for (left, right), (series, band) in zip(panels, chosen, strict=False):
        trial = problem.trials[series.trial]
        time = series.time + problem.find_unknown(found.x, series, "shift")
        fitted_to = series.values + _find_error(problem, found.x, series)
        left.plot(time, series.values, ".", markersize=2, color="0.35", label="measured")
        if found.before is not None:
            before = series.values + _find_error(problem, found.before, series)
            left.plot(time, before, "--", linewidth=0.9, color=GREY, label="scene")
        left.plot(time, fitted_to, linewidth=0.9, color=VERMILION, label="fitted")
        left.set_ylim(left.get_ylim())  # next to an impact the band is wide
        left.fill_between(time, fitted_to - band, fitted_to + band, color=SKY, alpha=0.5,
                          label="95 % band")  # fmt: skip
        unit = problem.planner.variables[series.name].unit.replace(".", " ")
        left.set_ylabel(f"{series.name} [{unit}]", fontsize="small")
        held = ", held back" if trial.is_held else ""
        left.set_title(f"{trial.name}{held}", fontsize="small")
        right.plot(time, (fitted_to - series.values) / series.sigma, ".", markersize=2, color=BLUE)
        right.set_title("residual over noise", fontsize="small")
        for panel in (left, right):
            panel.grid(alpha=0.3)
    panels[len(chosen) - 1][0].set_xlabel("time of the run [s]")
    if fitted.profile:
        _draw_profile(fitted, *panels[-1])
    panels[0][0].legend(loc="best", fontsize="x-small")
    figure.suptitle(problem.planner.base["title"], fontsize="medium")
    return figure


def _draw_profile(fitted: "Fitted", left: Any, right: Any) -> None:
    """Draw the way of the pair over the ellipse of its covariance, and the rise of the misfit."""
    problem, found, profile = fitted.problem, fitted.found, fitted.profile
    assert isinstance(found, Found)
    assert profile
    pair = profile.pair
    varies = [problem.parameters[i].vary for i in pair]
    labels = [problem.parameters[i].label for i in pair]
    first, *second = (
        [vary.value(part) for part in profile.points[:, i]]
        for i, vary in zip(pair, varies, strict=True)
    )
    spread = found.estimate.covariance[np.ix_(pair, pair)]
    is_known = not np.isnan(found.estimate.deviations[pair]).any()
    if second and is_known:
        turn = np.linspace(0.0, 2.0 * np.pi, 121)
        circle = np.array([np.cos(turn), np.sin(turn)])
        edge = found.x[pair, None] + _ELLIPSE * np.linalg.cholesky(spread) @ circle
        ends = ([vary.value(e) for e in row] for vary, row in zip(varies, edge, strict=True))
        left.plot(*ends, color=SKY, label="95 % by covariance")
    if second:
        left.plot(first, *second, ".-", color=VERMILION, label="profile")
        left.set_ylabel(labels[1], fontsize="small")
        left.legend(loc="best", fontsize="x-small")
    else:
        left.set_axis_off()
    right.plot(first, profile.rise, ".-", color=VERMILION, label="profile")
    if is_known:
        fine = np.linspace(profile.points[0, pair[0]], profile.points[-1, pair[0]], 61)
        linear = (fine - found.x[pair[0]]) ** 2 / spread[0, 0]
        right.plot([varies[0].value(part) for part in fine], linear, color=SKY, label="if linear")
    right.axhline(QUANTILE**2, linestyle="--", linewidth=0.9, color=GREY, label="95 %")
    right.set_title("rise of misfit", fontsize="small")
    right.legend(loc="best", fontsize="x-small")
    for panel in (left, right):
        panel.set_xlabel(labels[0], fontsize="small")
        panel.grid(alpha=0.3)
