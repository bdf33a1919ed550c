"""Assured accuracy on dockings outside of the calibration: share within, share refused, price.

Random dockings of `unseen` run with ``accuracy`` alone, and assured. Both are compared with a
reference solution of another method with tight tolerances. Rows are kept as they arrive, so that
the same command goes on after an interruption.

Examples:
    .venv/bin/python tests/studies/assured.py                     # tests/validation/assured.md
    .venv/bin/python tests/studies/assured.py --first 1000 --cases 8 -o build/others.md
"""

import os
import time
from collections import Counter
from pathlib import Path

import numpy as np

import dockloop as dl
from dockloop.base.errors import DockloopError, one_line
from dockloop.base.paths import ROOT
from dockloop.result.accuracy import list_tolerances
from dockloop.result.run_errors import find_worst
from dockloop.runs.assured import compare
from finer import run_finely
from page import Table, make_parser, write_page, write_points
from rows import measure_rows, read_rows
from unseen import SEED, STOP, draw_docking

PAGE = ROOT / "tests" / "validation" / "assured.md"
CASES = 40
WANTED = (1e-2, 1e-3)
REFERENCE, TOLERANCES = "bdf", (1e-9, 1e-11)  # the second where the first calls a run wrong
LIMIT = 15.0  # s of processor time of a reference solution
KINDS = {  # of dockings, on the page
    "all": lambda row: True,
    "own mechanisms": lambda row: row["is_own"],
    "bristle friction": lambda row: row["has_bristles"],
    "thrust after contact": lambda row: row["has_thrust"],
    "30 s, with a sequence or rattling": lambda row: row["is_long"],
    "slower than 0.03 m/s": lambda row: row["speed"] < 0.03,
}


def solve(docking, tolerance):
    """Return the reference solution at the communication points of a docking."""
    settings = {"solver.method": REFERENCE, **list_tolerances(tolerance)}
    until = time.process_time() + LIMIT

    def watch(_):
        if time.process_time() > until:
            raise DockloopError(f"it needs more than {LIMIT:g} s of processor time")

    def run(step):
        return dl.run(
            docking.scene, docking.keys, settings, stop=docking.stop, step=step, progress=watch
        )

    return run_finely(run, docking.keys["experiment.step"])


def find_error(reference, run):
    """Return the largest error of a run, and its figure; an infinite one as None."""
    figure, error = find_worst(compare(reference, run))
    return [figure, float(error) if np.isfinite(error) else None]


def measure(number):
    """Return the row of a docking."""
    docking = draw_docking(number)
    keys = docking.keys
    row = {
        "number": number,
        "scene": docking.scene,
        "speed": keys["initial.closing_speed"],
        "is_own": any(name.startswith("mechanism.set") for name in keys),
        "has_bristles": "contact.friction_model" in keys,
        "has_thrust": "chaser.contact_thrust" in keys,
        "is_long": docking.stop > STOP,
    }
    for tolerance in TOLERANCES:
        try:
            reference = solve(docking, tolerance)
        except DockloopError as error:
            return row | {"failure": one_line(str(error))}
        row |= {f"{wanted:g}": measure_one(docking, wanted, reference) for wanted in WANTED}
        if not any(is_wrong(row[f"{wanted:g}"], wanted) for wanted in WANTED):
            break
    return row


def measure_one(docking, wanted, reference):
    """Return what a run with an accuracy costs and is worth, alone and assured."""
    options = {"stop": docking.stop, "accuracy": wanted}
    found = {}
    for name in ("alone", "assured"):
        began = time.process_time()
        try:
            run = dl.run(docking.scene, docking.keys, assured=name == "assured", **options)
        except DockloopError as error:
            return found | {"failure": one_line(str(error))}
        found[name] = {
            "error": find_error(reference, run),
            "seconds": time.process_time() - began,
        }
    made = run.assurance
    found["assured"] |= {"settings": len(made.list_settings()), "price": made.price}
    found["assured"]["refused"] = made.refused
    return found


def is_within(found, name, wanted):
    """Return whether the largest error of a run is within the wanted one."""
    error = found[name]["error"][1]
    return error is not None and error <= wanted


def is_wrong(found, wanted):
    """Return whether a run is called assured, but not within the wanted error."""
    return (
        "failure" not in found
        and not found["assured"]["refused"]
        and not is_within(found, "assured", wanted)
    )


def describe_share(count, total):
    """Return a share in words."""
    return f"{count} of {total} ({count / total:.0%})" if total else "none"


def list_found(rows, wanted):
    """Return what was found at an accuracy; without dockings that have no start."""
    return [row[f"{wanted:g}"] for row in rows if "failure" not in row[f"{wanted:g}"]]


def describe_shares(rows):
    """Return the table of shares and prices."""
    table = Table(
        *("dockings", "`accuracy`", "one run within it", "assured", "assured and within it"),
        *("largest error of those assured, over `accuracy`", "refused", "more than two settings"),
        "evaluations over those of one run: median, 90 %, largest",
    )
    for kind, belongs in KINDS.items():
        for wanted in WANTED:
            found = list_found(filter(belongs, rows), wanted)
            if not found:
                continue
            sure = [each for each in found if not each["assured"]["refused"]]
            errors = [each["assured"]["error"][1] or np.inf for each in sure]
            prices = [each["assured"]["price"] for each in found]
            within = sum(is_within(each, "assured", wanted) for each in sure)
            table.add(
                kind,
                f"{wanted:g}",
                describe_share(sum(is_within(each, "alone", wanted) for each in found), len(found)),
                describe_share(len(sure), len(found)),
                describe_share(within, len(sure)),
                f"{max(errors) / wanted:.2f}" if errors else "",
                describe_share(len(found) - len(sure), len(found)),
                sum(each["assured"]["settings"] > 2 for each in found),
                ", ".join(
                    f"{value:.1f}" for value in (*np.quantile(prices, (0.5, 0.9)), np.max(prices))
                ),
            )
    return table


def describe_refused(rows):
    """Return the list of dockings that cannot be assured, and those that were wrong."""
    points = []
    for wanted in WANTED:
        for row in rows:
            found = row[f"{wanted:g}"]
            if "failure" in found or not found["assured"]["refused"]:
                continue
            refused = found["assured"]["refused"]
            figure, why = next(iter(refused.items()))
            more = f" (and {len(refused) - 1} more figures)" if len(refused) > 1 else ""
            docking = f"{row['number']} (`{row['scene']}`), `accuracy` {wanted:g}"
            points.append(f"{docking}: {figure}{more}: {why}.")
    return write_points(points) or "None."


def describe_wrong(rows):
    """Return the sentence on dockings that were called assured and are not within."""
    wrong = [
        f"{row['number']} at {wanted:g} ({found['assured']['error'][0]})"
        for wanted in WANTED
        for row in rows
        if is_wrong(found := row[f"{wanted:g}"], wanted)
    ]
    if not wrong:
        return "Every assured run is within its accuracy."
    return f"Called assured, but not within it: {', '.join(wrong)}."


def describe_page(drawn, left=()):
    """Return the blocks of the page; `left` are numbers of dockings that were not measured."""
    rows = [row for row in drawn if "failure" not in row]
    scenes = Counter(row["scene"] for row in rows)
    blocks = [
        f"{len(rows)} of {len(drawn) + len(left)} random dockings (`tests/studies/unseen.py`,"
        f" seed {SEED}), others than those of the tables. They have own guide rings and hexapods,"
        " vehicles of 1 to 1000 t, closing speeds of 0.005 to 0.4 m/s, bristles, thrust, sequences."
        f" Scenes: {', '.join(f'{n} of `{name}`' for name, n in scenes.items())}."
        f" The reference solution is that of {REFERENCE} at a tolerance of {TOLERANCES[0]:g}, and"
        f" of {TOLERANCES[1]:g} where an assured run is not within its accuracy by that one."
        " The error is the largest one of all figures"
        " (`scripts/dockloop/result/run_errors.py`), also times of the sequence.",
        describe_wrong(rows),
        describe_shares(rows),
        "## Refused",
        describe_refused(rows),
    ]
    broken = [
        f"{row['number']} (`{row['scene']}`), `accuracy` {wanted:g}: {found['failure']}."
        for wanted in WANTED
        for row in rows
        if "failure" in (found := row[f"{wanted:g}"])
    ]
    if broken:
        blocks += ["## Runs that failed", write_points(broken)]
    failed = [row for row in drawn if "failure" in row]
    if failed:
        points = (f"{row['number']} (`{row['scene']}`): {row['failure']}." for row in failed)
        blocks += ["## Without a reference solution", write_points(points)]
    if left:
        numbers = ", ".join(map(str, left))
        blocks += ["## Not measured", f"For lack of time, so no share counts them: {numbers}."]
    return blocks


def main():
    """Do the command."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--first", type=int, default=0, help="number of the first docking")
    parser.add_argument("--cases", type=int, default=CASES, help=f"dockings (default: {CASES})")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--rows", type=Path, default=ROOT / "build" / "assured.jsonl")
    parser.add_argument("--known", action="store_true", help="run nothing more: rows as they are")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.cases)
    if options.known:
        known = read_rows(options.rows, numbers)
        rows = [known[number] for number in numbers if number in known]
    else:
        rows = measure_rows(measure, numbers, options.rows, options.workers, "assured")
    left = [number for number in numbers if number not in {row["number"] for row in rows}]
    blocks = describe_page(rows, left)
    write_page(options.output, "Assured accuracy", "tests/studies/assured.py", *blocks)


if __name__ == "__main__":
    main()
