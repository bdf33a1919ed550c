"""The edges of what numbers can be, each with a verdict; also hosts and oracles of other tests.

Twelve items (mass ratios, stiffnesses, singular poses, long runs, impossible inputs, ...), each in
parts. A part runs many cases over a stated range and compares every one with a stated oracle. A
case ends *right* (its error is within the limit of the part) or *refused* (with a reason, and
checked to have changed nothing where there is a state to change); anything else is *bad*: a wrong
figure, NaN, a refusal without a reason, a defect. One bad case makes the verdict of its part bad.

| file | what it holds |
|---|---|
| ``__init__.py`` | what a part and a score are; the run over all parts; the table |
| ``mechanics.py`` | items 1 to 4, 10, 12: masses, stiffnesses, poses, redundancy, scales, frames |
| ``running.py`` | items 5 to 9, 11: time, steps, inputs, contact, saved states, tolerances |
| ``scenes.py`` | scenes and mechanisms made in code, built in a temporary folder |
| ``reference.py`` | independent motions of two of the problems |
| ``absolute_kkt.py`` | oracle: all bodies in absolute coordinates, one dense system |
| ``mechanism_benchmarks.py`` | oracle: mechanisms whose motion is known |
| ``fmi_host.py`` | a host that steps an FMU, saves and restores it |
| ``own_mechanism.py`` | scene files of mechanisms made in code |

``tests/test_extremes.py`` runs the shorter ranges, ``tests/studies/extremes.py`` the full ones.
"""

import math
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from dockloop.base.errors import DockloopError, UsageError

TITLES = {
    1: "mass ratios",
    2: "stiffness, damping, friction speed",
    3: "near-singular closures",
    4: "redundant constraints",
    5: "long runs",
    6: "step sizes and times",
    7: "impossible inputs",
    8: "contact at its edges",
    9: "saved states",
    10: "scale invariance",
    11: "tolerance ladder",
    12: "frame invariance",
}


@dataclass
class Score:
    """What became of the cases of one part.

    Attributes:
        right: cases within the limit.
        refused: cases refused with a reason.
        bad: what is wrong with every other case, one sentence each.
        worst: largest error of the right cases, and where it is.
        reasons: one refusal of every kind (numbers left out), with an example.
        notes: further figures, for the JSON report.
    """

    limit: float
    right: int = 0
    refused: int = 0
    bad: list[str] = field(default_factory=list)
    worst: float = 0.0
    where: str = ""
    reasons: list[str] = field(default_factory=list)
    notes: dict = field(default_factory=dict)

    def compare(self, error: float, where: str) -> None:
        """Count a case by its error; NaN is bad."""
        error = float(error)
        if not error <= self.limit:
            self.bad.append(f"{where}: error {error:.3g}, limit {self.limit:.3g}")
            return
        self.right += 1
        if error >= self.worst:
            self.worst, self.where = error, where

    def check(self, holds: bool, where: str, what: str = "does not hold") -> None:
        """Count a case that is right or wrong, without a figure."""
        if holds:
            self.right += 1
        else:
            self.bad.append(f"{where}: {what}")

    def refuse(self, reason: str, where: str) -> None:
        """Count a refusal; one without words is bad."""
        if len(reason.split()) < 3:
            self.bad.append(f"{where}: refused without a reason")
            return
        self.refused += 1
        reason = re.sub(r"\S*[/\\](?=[\w.]+: )", "", reason)  # the temporary folder
        kind = "".join(c for c in reason if c.isalpha())
        if all(kind != "".join(c for c in r if c.isalpha()) for r in self.reasons):
            self.reasons.append(reason)

    def right_or_refused(self, where: str, find_error: Callable[[], float]) -> None:
        """Count a case by the error that a function finds, or by its refusal."""
        try:
            error = find_error()
        except DockloopError as refusal:
            self.refuse(str(refusal), where)
        else:
            self.compare(error, where)

    def must_be_refused(self, where: str, act: Callable[[], object]) -> None:
        """Count a case that has no right answer: only its refusal is right."""
        try:
            act()
        except DockloopError as refusal:
            self.refuse(str(refusal), where)
        else:
            self.bad.append(f"{where}: accepted")


@dataclass(frozen=True)
class Part:
    """One row of the table.

    Attributes:
        item: number of the item it belongs to.
        what: what is varied, over which range (quick range in brackets where it is smaller).
        oracle: what the figures are compared with.
        unit: of the error.
        limit: largest error that is right.
        run: runs the cases; arguments: workshop, score, quick.
    """

    item: int
    what: str
    oracle: str
    unit: str
    limit: float
    run: Callable


def list_parts(items: Iterable[int] = ()) -> list[Part]:
    """Return the parts of some items, or of all."""
    # Threads of numpy's linear algebra wait for each other on small matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from extreme_cases import mechanics, running

    parts = sorted((*mechanics.PARTS, *running.PARTS), key=lambda part: part.item)
    there = {part.item for part in parts}
    for item in (wanted := set(items)):
        if item not in there:
            names = ", ".join(map(str, sorted(there)))
            raise UsageError(f"--item {item}: no such item; there are {names}")
    return [part for part in parts if not wanted or part.item in wanted]


def run_part(part: Part, quick: bool) -> dict:
    """Run one part; returns its row of the report."""
    from extreme_cases.scenes import Workshop

    score, began = Score(part.limit), time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="dockloop-") as folder:
        try:
            part.run(Workshop(folder), score, quick)
        except Exception as error:  # noqa: BLE001  a part that breaks down is a bad case
            score.bad.append(f"broke down: {type(error).__name__}: {error}")
    if not score.right + score.refused + len(score.bad):
        score.bad.append("no case was run")
    return {
        "item": part.item,
        "title": TITLES[part.item],
        "what": part.what,
        "oracle": part.oracle,
        "unit": part.unit,
        "limit": part.limit,
        "cases": score.right + score.refused + len(score.bad),
        "right": score.right,
        "refused": score.refused,
        "worst": score.worst,
        "where": score.where,
        "verdict": "bad" if score.bad else "right" if score.right else "refused",
        "bad": score.bad,
        "reasons": score.reasons,
        "notes": score.notes,
        "seconds": round(time.perf_counter() - began, 1),
    }


def run_extremes(items: Iterable[int], quick: bool, progress: Callable[[float], None]) -> list:
    """Run the parts of some items (of all, if none is named); returns rows of the report."""
    parts = list_parts(items)
    rows = []
    for i, part in enumerate(parts):
        progress(i / len(parts))
        rows.append(run_part(part, quick))
    progress(1.0)
    return rows


def describe(rows: list[dict]) -> str:
    """Return the report as a table (Markdown), then what was refused and what is bad."""
    lines = [
        "| item | range | oracle | cases | right / refused | worst error (limit) | verdict |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        figure = "-"
        if math.isfinite(row["limit"]) and row["where"]:
            worst, limit = (f"{x:.0e}" if x else "0" for x in (row["worst"], row["limit"]))
            figure = f"{worst} ({limit}) {row['unit']}, {row['where']}"
        cells = (
            f"{row['item']} {row['title']}", row["what"], row["oracle"], row["cases"],
            f"{row['right']} / {row['refused']}", figure, row["verdict"],
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    reasons = [f"  {r['item']}: {reason}" for r in rows for reason in r["reasons"]]
    if reasons:
        lines += ["", "refusals, one of each kind:", *reasons]
    bad = [f"  {r['item']}: {text}" for r in rows for text in r["bad"]]
    if bad:
        lines += ["", "bad:", *bad]
    seconds = sum(row["seconds"] for row in rows)
    lines += ["", f"{len(rows)} parts, {len(bad)} bad cases, {seconds:.0f} s"]
    return "\n".join(lines)
