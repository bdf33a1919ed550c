"""What random scenes say: a summary, and a page with the table by outcome and every command."""

import argparse
import math
import shlex
import statistics
from collections import Counter
from collections.abc import Callable
from typing import Any

from dockloop.base import paths
from dockloop.base.errors import is_watched, one_line, say
from dockloop.base.files import claim, table_kind, write_text
from dockloop.base.progress import ProgressBar
from dockloop.base.sections import FACTS, Section, list_files, write_markdown
from dockloop.base.words import LIMIT
from dockloop.runs.judging import BAD, ENERGY, MOMENTUM, VERDICTS, list_reasons, report_reasons
from dockloop.studies.extremes.random_scenes import Drawn, Outcome, run_random
from dockloop.sweeps.campaign import read_how
from dockloop.sweeps.journal import journal_kind

COMMAND = "dockloop extremes"
OFF = ("loose", "warned", "undetermined", "slow")  # neither right nor refused nor bad
_TITLE = "Random extremes"
_PAGE = table_kind("page", COMMAND, f"# {_TITLE}")


def run_command(options: argparse.Namespace) -> dict:
    """Judge random scenes, write the page; returns the summary.

    Raises:
        UsageError: an option is bad.
        InterruptedWorkError: by Ctrl-C.
    """
    folder = options.output or paths.RESULTS / "extremes"
    page, journal = folder / "random.md", folder / "random.jsonl"
    claim(page, _PAGE)
    claim(journal, journal_kind("extremes"))
    outcome = run_random(
        options.random,
        options.seed,
        first=options.first,
        limit=options.limit,
        journal=journal,
        progress=_make_progress(),
        **read_how(options),
    )
    summary = summarise(outcome)
    summary["files"] = [paths.shown(page), paths.shown(journal)]
    write_text(page, _PAGE, write_markdown(complete_report(summary, _find_command(options))))
    return summary


def _find_command(options: argparse.Namespace) -> str:
    words = ["dockloop", "extremes", "--random", str(options.random), "--seed", str(options.seed)]
    words += ["--first", str(options.first)] if options.first != 1 else []
    return shlex.join(words + (["--limit", f"{options.limit:g}"] if options.limit != LIMIT else []))


def _make_progress() -> Callable[[int, int, Counter], None]:
    """Return what shows progress: a bar at a terminal, else a line now and then."""
    bar, shown = ProgressBar("extremes"), 0

    def show(done: int, total: int, tally: Counter) -> None:
        nonlocal shown
        text = ", ".join(f"{count} {name}" for name, count in tally.most_common())
        bar(0.999 * done / total, text)
        if not is_watched() and 10 * done // total > shown:
            shown = 10 * done // total
            say(f"extremes: {done} of {total} scenes: {text}")

    return show


def summarise(outcome: Outcome) -> dict:
    """Return what ``--json`` prints: counts of the verdicts, and everything that is bad."""
    verdicts = [drawn.verdict for drawn in outcome.drawn]
    tally = Counter(verdict.verdict for verdict in verdicts)
    right = [d for d in outcome.drawn if d.verdict.verdict == "right"]
    compared = [d for d in right if not d.verdict.audited]
    slowest = max(outcome.drawn, key=lambda d: d.verdict.seconds)
    summary: dict[str, Any] = {
        "scenes": len(verdicts),
        "seed": outcome.seed,
        "limit": outcome.limit,
        **{name: tally[name] for name in VERDICTS},
        "right_by_audits_only": len(right) - len(compared),
        "slowest": {"seconds": slowest.verdict.seconds, "command": _repeat(outcome, slowest)},
        "refusals": list_reasons([v for v in verdicts if v.verdict == "refused"]),
        "without_solution": list_reasons([d.verdict for d in right if d.verdict.reason]),
        "bad": [_describe_case(outcome, d) for d in outcome.drawn if d.verdict.verdict in BAD],
        "off": [_describe_case(outcome, d) for d in outcome.drawn if d.verdict.verdict in OFF],
    }
    for name in ("error", "energy", "momentum"):
        known = [d for d in right if math.isfinite(getattr(d.verdict, name))]
        if known:
            values = [getattr(d.verdict, name) for d in known]
            worst = max(known, key=lambda d: getattr(d.verdict, name))
            summary[f"largest_{name}"] = {
                "value": max(values),
                "median": statistics.median(values),
                "command": _repeat(outcome, worst),
            }
    return summary


def _repeat(outcome: Outcome, drawn: Drawn) -> str:
    """Return the command that draws and judges one scene again."""
    words = ["dockloop", "extremes", "--random", "1", "--seed", str(outcome.seed)]
    return shlex.join([*words, "--first", str(drawn.number)])


def _describe_case(outcome: Outcome, drawn: Drawn) -> dict:
    """Return all that is known of a case that is not right."""
    found = {
        "number": drawn.number,
        "verdict": drawn.verdict.verdict,
        "reason": drawn.verdict.reason,
        "repeat": _repeat(outcome, drawn),
        "run": drawn.case.make_command(),
    }
    if drawn.simpler:
        case, verdict = drawn.simpler
        found |= {"simpler": case.make_command(), "simpler_reason": verdict.reason}
    return found


def report_random(summary: dict) -> list[Section]:
    """Return the report of random scenes; `summary` is that of `summarise`."""
    verdicts = ((name, summary[name], meaning) for name, meaning in VERDICTS.items())
    return [
        Section(f"{summary['scenes']} random scenes, seed {summary['seed']}",
                table=[FACTS, *list_files(summary.get("files", ()))]),
        Section("Verdicts", table=[("outcome", "scenes", "meaning"), *verdicts]),
        Section("Bad", commands=_list_commands(summary["bad"])),
    ]  # fmt: skip


def _list_commands(cases: list[dict]) -> list[tuple[str, str]]:
    """Return commands: one that draws a case again, and one that runs it, or a simpler one."""
    lines = []
    for case in cases:
        lines.append((f"{case['verdict']}: {one_line(case['reason'])}", case["repeat"]))
        if "simpler" in case:
            lines.append((f"simpler: {one_line(case['simpler_reason'])}", case["simpler"]))
        else:
            lines.append(("the same", case["run"]))
    return lines


def complete_report(summary: dict, command: str) -> list[Section]:
    """Return the report of random scenes as their page has it."""
    head, *others = report_random(summary)
    head.title = _TITLE
    head.text = (
        f"Written by `{command}`: {summary['scenes']} whole scenes drawn over many decades"
        " (`scripts/dockloop/studies/extremes/random_scenes.py`)."
    )
    head.points = [
        "Reference solution: the explicit method at a relative tolerance of 1e-11.",
        "A relative tolerance r promises an error of 30 r^0.6 in peak loads, stroke, time of"
        " capture and final motion. It promises the same part of the energy in play, and 100"
        " absolute tolerances. Kinks of contact and friction keep the error from falling as fast"
        " as the tolerance.",
        "From r = 3.5e-3 on, and with fixed steps, no error is promised: audits must hold.",
        f"Audits: all outputs are finite, momentum is conserved within {MOMENTUM:g}, a warning"
        f" reports an energy residual above {ENERGY:.0%}.",
        f"A scene is hung after {summary['limit']:g} s of processor time.",
        f"{summary['right_by_audits_only']} of the right scenes are judged by audits only: no error"
        " is promised, or there is no reference solution (see below).",
    ]
    rows = [
        (name, f"{found['median']:.0e}", f"{found['value']:.0e}", f"`{found['command']}`")
        for name in ("error", "energy", "momentum")
        if (found := summary.get(f"largest_{name}"))
    ]
    slowest = summary["slowest"]
    text = f"Slowest: {slowest['seconds']:.3g} s, `{slowest['command']}`."
    heads = ("of the right scenes", "median", "largest", "command")
    return [
        head,
        Section("Largest residuals", text, [heads, *rows]),
        *others,
        Section("Off, but not bad", commands=_list_commands(summary["off"])),
        *report_reasons(summary, "scenes"),
    ]
