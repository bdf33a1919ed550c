"""The parameter `accuracy`: its calibration, and how well it keeps its promise.

Three commands. They draw random dockings (`draw_case`) of these kinds:

* the shipped scenes: passive rings in the IDSS box, with four pairs of vehicles, random friction
  and stiffness of the contact, soft and stiff legs; and the three families of mechanisms, with
  steps of 10 ms and 0.25 s;
* long ones of them, over the whole sequence and with steps of 0.1 s and 1 s: an error of long steps
  grows with the time after the first contact. Only ``check`` draws them;
* other hardware and own mechanisms (`unseen`): vehicles of 1 to 1000 t, 5 to 400 mm/s, thrust,
  bristles, 12 to 30 s. They are in the calibration, too, with another seed.

* ``calibrate`` runs dockings at a ladder of tolerances, compares each run with a run at a tight
  tolerance, and writes all errors into tests/data/accuracy.json and the table of the core.
* ``table`` writes the table of the core, src/sim/accuracy_table.hpp, from that file.
* ``check`` runs other dockings with `accuracy` and writes tests/validation/accuracy.md.

Examples:
    .venv/bin/python tests/studies/accuracy.py calibrate                     # half an hour
    .venv/bin/python tests/studies/accuracy.py calibrate --cases 8 3 4 4 -o build/accuracy.json
    .venv/bin/python tests/studies/accuracy.py check                         # an hour
"""

import json
import math
import os
import random
import time
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import dockloop as dl
from dockloop.base.errors import DockloopError
from dockloop.base.paths import ROOT
from dockloop.result.accuracy import ATOL_PER_RTOL, list_tolerances, state_rtol
from dockloop.result.run_errors import find_error, find_errors, find_further_figures
from finer import run_finely
from page import Table, make_parser, write_page
from rows import measure_rows
from unseen import draw_docking

DATA = ROOT / "tests" / "data" / "accuracy.json"
TABLE = ROOT / "src" / "sim" / "accuracy_table.hpp"
PAGE = ROOT / "tests" / "validation" / "accuracy.md"

RING, FAMILIES = "idss_25t_350t", ("hexapod", "apda", "probe_drogue")
STOP, STEPS = 12.0, (0.01, 0.25)
LIMIT = math.sqrt(STEPS[0] * STEPS[1])  # s, between short and long communication steps
LONG_SCENES, LONG_STOP, LONG_STEPS = (RING, *FAMILIES), 300.0, (0.1, 1.0)
EARLY = 20.0  # long dockings are compared here too: after capture, before they rattle for minutes
GROUPS = ["relative", "capture", "phase", "ring", "solver"]
METHODS = ("stabilised", "bdf", "rosenbrock")  # of the calibration; the cheapest one is chosen
WITH_BRISTLES = ("stabilised",)  # the others become this one
LADDER = tuple(10.0**-k for k in range(2, 12))  # relative tolerances
TIGHTEST = {"rosenbrock": 1e-7, "bdf": 1e-10}  # of the ladder; tighter ones cost too much
REFERENCE = ("bdf", 1e-11)  # method and tolerance of the reference solution: errors below 1e-7
REFERENCE_WITH_BRISTLES = ("explicit", 1e-12, 1e-11, 1e-10, 1e-9)  # the first that runs
TIGHTER = 10.0  # a reference solution with bristles has at most a tenth of the tolerance
KNOWN = 1e-7  # smaller errors may be those of the reference solution: a ladder ends there
WANTED = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7)  # rows
# The promise is 95 % of all dockings. From 95 % of the measured ones, 89 to 98 % of others kept it:
# some dozen dockings do not show a share any better. So it is MARGIN times the error of 98 % of
# them, and 99 % are within WORST times of it.
SHARES = (0.98, 0.99)
MARGIN, WORST = 1.2, 4.0

SEED, FIRST_CHECK = 2026, 1001  # number of the first docking of ``check``
FAMILY = 500  # above this number, in each thousand, dockings are those of families
LONG = 800  # and above this number those of the long ones
WIDE, BRISTLES = 10_000, 20_000  # first dockings of `unseen` in the calibration
UNSEEN = {"changed": 30_000, "own": 40_000}  # and in the check
CALIBRATED, CHECKS = (48, 60, 90, 89), (152, 40, 8, 200, 200)  # dockings, see `list_numbers`
CHECKED = (1e-2, 1e-3, 1e-4, 1e-6)
ESTIMATED = (1e-2, 1e-3, 1e-4)  # with error estimates by second runs
BY_HAND = (24, 9)  # dockings of the check whose best setting is looked for, rings and families

PAIRS = (  # chaser and target: mass, principal moments, distance of the docking interface
    ((25e3, (60.5e3, 132e3, 132e3), 4.0), (350e3, (4e7, 8e7, 8e7), 15.0)),
    ((100e3, (8e5, 3.7e6, 3.7e6), 10.0), (100e3, (8e5, 3.7e6, 3.7e6), 10.0)),
    ((12e3, (25e3, 45e3, 45e3), 3.0), (25e3, (60.5e3, 132e3, 132e3), 4.0)),
    ((5e3, (8e3, 12e3, 12e3), 2.0), (350e3, (4e7, 8e7, 8e7), 15.0)),
)
DISCS = {  # magnitude: direction, limit of the standard
    "lateral_offset": ("lateral_direction_deg", 0.1),
    "lateral_speed": ("lateral_speed_direction_deg", 0.04),
    "pitch_yaw_deg": ("pitch_yaw_direction_deg", 4.0),
    "pitch_yaw_rate_deg_s": ("pitch_yaw_rate_direction_deg", 0.2),
}
STIFF_LEGS = {
    "mechanism.set.leg_defaults.stiffness": 7100.0,
    "mechanism.set.leg_defaults.damping": 4600.0,
}


class Case(NamedTuple):
    """A docking: scene, keys of the scene, communication step and time of the end [s]."""

    scene: str
    keys: dict
    step: float
    stop: float


def is_long(number):
    """Is this a long docking?"""
    return number < WIDE and number % 1000 > LONG


def is_family(number):
    """Is this a docking of one of the families as they are shipped, and not a long one?"""
    return number < WIDE and number % 1000 > FAMILY and not is_long(number)


def is_unseen(kind, number):
    """Is this a docking of other hardware, or of an own mechanism?"""
    return UNSEEN[kind] <= number < UNSEEN[kind] + WIDE


KINDS = {  # tables of the core: are they of passive rings, of contacts with bristles?
    "kPassiveRings": (True, False),
    "kPassiveRingsWithBristles": (True, True),
    "kOthers": (False, False),
    "kOthersWithBristles": (False, True),
}


def has_bristles(case):
    """Do the contacts of a docking have bristles?"""
    return case.keys.get("contact.friction_model") == "bristle"


def select(data, kind):
    """Return the data of the dockings of one kind only, with the methods that they have."""
    cases = [c for c in data["cases"] if (c["scene"] == RING, c["has_bristles"]) == KINDS[kind]]
    return data | {"cases": cases, "methods": WITH_BRISTLES if KINDS[kind][1] else METHODS}


def list_numbers(first, counts):
    """Return the numbers of dockings: with rings, with families, then those of the other kinds.

    For the calibration (``first`` 1) these are dockings of `unseen` without and with bristles, for
    ``check`` long ones, those with other hardware, and those of own mechanisms.
    """
    others = (WIDE, BRISTLES) if first == 1 else (first + LONG, *UNSEEN.values())
    starts = zip((first, first + FAMILY, *others), counts, strict=False)
    return [start + i for start, count in starts for i in range(count)]


def draw_wide_case(number):
    """Draw a docking of `unseen`; in the calibration the number decides whether it has bristles."""
    for kind in UNSEEN:
        if is_unseen(kind, number):
            docking = draw_docking(number, f"{SEED}/check", kind)
            return Case(*docking[:2], docking.keys["experiment.step"], docking.stop)
    docking = draw_docking(number, f"{SEED}/wide")
    keys = {k: v for k, v in docking.keys.items() if k != "contact.friction_model"}
    if number >= BRISTLES:
        keys["contact.friction_model"] = "bristle"
    return Case(docking.scene, keys, keys["experiment.step"], docking.stop)


def draw_case(number):
    """Draw a docking."""
    if number >= WIDE:
        return draw_wide_case(number)
    draw = random.Random(f"{SEED}/{number}")
    keys = {"outputs.groups": GROUPS, "initial.approach_time": 0.5}
    stop = STOP
    if is_long(number):
        scene, stop = LONG_SCENES[number % len(LONG_SCENES)], LONG_STOP
        step = LONG_STEPS[number // len(LONG_SCENES) % len(LONG_STEPS)]
        keys |= draw_approach(draw)
    elif is_family(number):
        scene = FAMILIES[number % len(FAMILIES)]
        step = STEPS[number // len(FAMILIES) % len(STEPS)]
        keys |= draw_approach(draw)
    else:
        scene = RING
        step = STEPS[number // len(PAIRS) % len(STEPS)]
        keys |= draw_ring(draw, PAIRS[number % len(PAIRS)])
    return Case(scene, keys | {"experiment.step": step}, step, stop)


def draw_ring(draw, pair):
    """Draw masses, contact, legs and initial conditions of a docking with passive rings."""
    keys = {}
    for name, sign, (mass, moments, distance) in zip(
        ("chaser", "target"), (1.0, -1.0), pair, strict=True
    ):
        keys[f"{name}.mass"] = mass
        keys[f"{name}.inertia"] = [*moments, 0.0, 0.0, 0.0]
        keys[f"{name}.interface_position"] = [sign * distance, 0.0, 0.0]
    stiffness = 2e6 * 10.0 ** draw.uniform(-1.0, 1.0)
    keys |= {"contact.stiffness": stiffness, "contact.node_stiffness": stiffness / 12.0}
    keys |= draw_approach(draw)
    if draw.random() < 0.5:
        keys |= STIFF_LEGS
    return keys


def draw_approach(draw):
    """Draw initial conditions and friction."""
    keys = {"initial.closing_speed": draw.uniform(0.05, 0.10)}
    keys["initial.roll_deg"] = draw.uniform(-4.0, 4.0)
    keys["initial.roll_rate_deg_s"] = draw.uniform(-0.2, 0.2)
    keys["contact.friction_coefficient"] = draw.uniform(0.0, 0.3)
    for size, (direction, limit) in DISCS.items():
        keys[f"initial.{size}"] = limit * math.sqrt(draw.random())
        keys[f"initial.{direction}"] = draw.uniform(0.0, 360.0)
    return keys


def make_run(case, start_values, step=None, **options):
    """Run a docking. Raises DockloopError: its start is refused, or a step fails."""
    return dl.run(
        case.scene, case.keys, start_values, stop=case.stop, step=step or case.step, **options
    )


def run(case, start_values):
    """Run a docking; None if its start is refused or a step fails."""
    try:
        return make_run(case, start_values)
    except DockloopError:
        return None


def set_tolerance(method, rtol):
    """Return start values: a method, a relative tolerance and absolute ones in proportion."""
    return {"solver.method": method, **list_tolerances(rtol)}


def is_refused(case):
    """Is the start refused, because surfaces overlap before the first contact?"""
    return run(case._replace(stop=case.step), {}) is None


def find_reference(case):
    """Return the reference solution at the communication points, and its tolerance.

    Where steps of the tightest tolerance need too much work, the next one is tried.
    Without a solution: None, and an infinite tolerance.
    """
    method, *tolerances = REFERENCE_WITH_BRISTLES if has_bristles(case) else REFERENCE
    for rtol in tolerances:
        start = set_tolerance(method, rtol)
        try:
            return run_finely(partial(make_run, case, start), case.step), rtol
        except DockloopError:
            continue
    return None, math.inf


def count(result):
    """Return the evaluations of a run."""
    return int(result["solver.rhs_evaluations"][-1])


def round_error(error):
    """Return an error with three digits; None if it is infinite."""
    return float(f"{error:.3g}") if math.isfinite(error) else None


def run_ladder(case, reference, known, method):
    """Return errors and costs of a docking along the ladder; None: refused, other outcome.

    Costs are evaluations and seconds of the processor: evaluations of methods cost differently.
    Errors are known at tolerances from `known` on; an unknown one is None, too.
    """
    errors, costs, seconds = [], [], []
    for rtol in (rtol for rtol in LADDER if rtol >= TIGHTEST.get(method, 0.0)):
        began = time.process_time()
        made = run(case, state_rtol(method, rtol, accuracy=1.0))  # absolute ones are chosen
        took = time.process_time() - began
        is_known = made is not None and rtol >= 0.99 * known
        errors.append(round_error(find_error(reference, made)) if is_known else None)
        costs.append(None if made is None else count(made))
        seconds.append(None if made is None else round(took, 4))
        if errors[-1] is not None and errors[-1] < KNOWN:
            break
    return {"errors": errors, "evaluations": costs, "seconds": seconds}


def calibrate_case(number):
    """Return the row of a docking; without a start or a reference solution, which is missing."""
    case = draw_case(number)
    if is_refused(case):
        return {"number": number, "missing": "start"}
    reference, rtol = find_reference(case)
    if reference is None:
        return {"number": number, "missing": "reference"}
    bristles = has_bristles(case)
    methods, known = (WITH_BRISTLES, TIGHTER * rtol) if bristles else (METHODS, 0.0)
    ladders = {method: run_ladder(case, reference, known, method) for method in methods}
    about = {"number": number, "scene": case.scene, "step": case.step, "has_bristles": bristles}
    return about | ladders


def run_cases(function, options, first, counts):
    """Return what a function returns for every docking, and what became of the others."""
    numbers = list_numbers(first, options.cases or counts)
    rows = measure_rows(function, numbers, options.rows, options.workers, options.command)
    missing = Counter(row["missing"] for row in rows if "missing" in row)
    return [row for row in rows if "missing" not in row], missing


def write_data(rows, path):
    """Write the errors, one docking per line."""
    lines = ",\n".join(f"  {json.dumps(row)}" for row in rows)
    about = "written by tests/studies/accuracy.py calibrate"
    head = {"comment": about, "seed": SEED, "stop": STOP, "rtol": LADDER, "methods": METHODS}
    text = json.dumps(head)[:-1] + f', "cases": [\n{lines}\n]}}\n'
    path.write_text(text, encoding="utf-8")


def list_errors(data, method):
    """Return the errors of all dockings, a row for each; where a ladder ended, its last error."""
    count = max(len(case[method]["errors"]) for case in data["cases"])
    errors = []
    for case in data["cases"]:
        known = [np.inf if e is None else e for e in case[method]["errors"]]
        errors.append(known + known[-1:] * (count - len(known)))
    return np.array(errors)


def find_promises(data, method):
    """Return the error that is promised at every tolerance of the ladder."""
    errors = list_errors(data, method)
    most = np.quantile(errors, SHARES[0], axis=0, method="higher")
    rare = np.quantile(errors, SHARES[1], axis=0, method="lower")
    promises = np.maximum(MARGIN * most, rare / WORST)
    # Where too many runs are refused the table ends.
    promises = promises[: np.max(np.nonzero(np.isfinite(promises)), initial=-1) + 1]
    return np.maximum.accumulate(promises[::-1])[::-1]  # a tighter tolerance promises no more


def find_rtol(ladder, promises, wanted):
    """Return the tolerance for a wanted error, interpolated; None: no tolerance is tight enough."""
    if not len(promises) or promises[-1] > wanted:
        return None
    first = int(np.argmax(promises <= wanted))
    if first == 0 or not math.isfinite(promises[first - 1]):
        return ladder[first]
    a, b = (math.log(promises[i]) for i in (first - 1, first))
    share = (math.log(wanted) - a) / (b - a)
    return ladder[first - 1] * (ladder[first] / ladder[first - 1]) ** share


def find_cost(data, method, rtol, step, what="seconds"):
    """Return the geometric mean of a cost over the dockings with such a communication step.

    The same dockings count at every tolerance: where a ladder has ended, the cost goes on as in its
    last decade.
    """
    ladder, costs = -np.log(data["rtol"]), []
    for case in data["cases"]:
        rungs = [i for i, each in enumerate(case[method][what]) if each is not None]
        if (case["step"] < LIMIT) != (step < LIMIT) or len(rungs) < 2:
            continue
        known, at = np.log([case[method][what][i] for i in rungs]), -math.log(rtol)
        slope = (known[-1] - known[-2]) / (ladder[rungs[-1]] - ladder[rungs[-2]])
        beyond = max(0.0, at - ladder[rungs[-1]])
        costs.append(np.interp(at, ladder[rungs], known) + slope * beyond)
    return math.exp(np.mean(costs))


def list_rows(data):
    """Return rows of the table: wanted error, cheapest methods, tolerance of every method, costs.

    The methods are those for short and for long communication steps. A tolerance of 0: the method
    does not reach this error. Costs are seconds by method, for both steps.
    """
    rows = []
    promises = {method: find_promises(data, method) for method in data["methods"]}
    least = min(each[-1] for each in promises.values() if len(each))
    last = [float(f"{1.05 * least:.2g}")] if least > WANTED[-1] else []  # the least, a last row
    for wanted in sorted((*WANTED, *last), reverse=True):
        rtols = {m: find_rtol(data["rtol"], each, wanted) for m, each in promises.items()}
        reached = {method: rtol for method, rtol in rtols.items() if rtol}
        if not reached:
            break
        values = [float(f"{rtol or 0.0:.2g}") for rtol in rtols.values()]
        if rows and any(a <= b for a, b in zip(rows[-1][2], values, strict=True) if b > 0.0):
            rows.pop()  # not tighter: the row before says less
        costs = [
            {m: find_cost(data, m, rtol, step) for m, rtol in reached.items()} for step in STEPS
        ]
        while rows and all(
            min(before.values()) >= min(cost.values())
            for before, cost in zip(rows[-1][3], costs, strict=True)
        ):
            rows.pop()  # bristles that slip too late cost more steps than the smaller error
        rows.append((wanted, [min(cost, key=cost.get) for cost in costs], values, costs))
    return rows


def list_enumerators(methods):
    """Return methods as a list of the core."""
    return "{" + ", ".join(map(name_enumerator, methods)) + "}"


def name_enumerator(method):
    """Return the name of a method in the core: kFixedRk4 of fixed_rk4."""
    return "k" + "".join(word.capitalize() for word in method.split("_"))


def make_rows(data):
    """Return the rows of one table of the core, as text."""
    rows = []
    for error, best, rtols, _ in list_rows(data):
        known = dict(zip(data["methods"], rtols, strict=True))
        columns = ", ".join(f"{known.get(method, 0.0):g}" for method in METHODS)
        rows.append(f"    {{{error:g}, {list_enumerators(best)}, {{{columns}}}}},")
    return rows


def find_longest(data):
    """Return the time of the longest docking of the calibration [s]."""
    return max(draw_case(case["number"]).stop for case in data["cases"])


def make_table(data):
    """Return the text of the tables of the core."""
    methods = ", ".join(map(name_enumerator, METHODS))
    shares = [
        f"constexpr double kAtol{name.removeprefix('atol_').capitalize()} = {share:g};"
        for name, share in ATOL_PER_RTOL.items()
    ]
    tables = []
    for kind in KINDS:
        of_kind = select(data, kind)
        rows = make_rows(of_kind)
        name = f"kRowsOf{kind.removeprefix('k')}"
        tables += [
            f"constexpr std::array<AccuracyRow, {len(rows)}> {name} = {{{{",
            *rows,
            "}};",
            f"constexpr AccuracyTable {kind}({name}, {len(of_kind['cases'])});",
            "",
        ]
    return f"""// Written by tests/studies/accuracy.py from tests/data/accuracy.json: do not edit.
//
// Tolerances with which 98 % of the measured dockings stay below an error, so that 95 % of others
// do, too (accuracy.hpp).
#pragma once

#include <array>

#include "sim/solver_methods.hpp"

namespace dockloop {{

constexpr size_t kColumns = {len(METHODS)};
constexpr std::array<SolverMethod, kColumns> kCalibratedMethods = {{{methods}}};

// Absolute tolerances over the relative one, for a usual approach: [m], [m/s], [J].
{chr(10).join(shares)}

/// The longest measured docking [s].
constexpr double kMeasuredTime = {find_longest(data):g};

/// Limit between short and long communication steps [s].
constexpr double kLongStep = {LIMIT:g};

struct AccuracyRow {{
  /// Wanted.
  double error;
  /// The cheapest ones for short and for long communication steps.
  std::array<SolverMethod, 2> method;
  /// Of each method; 0 = not reached.
  std::array<double, kColumns> rtol;
}};
struct AccuracyTable {{
  const AccuracyRow* row;
  size_t size;
  int dockings;  ///< that were measured

  template <size_t n>
  constexpr AccuracyTable(const std::array<AccuracyRow, n>& rows, int measured)
      : row(rows.data()), size(n), dockings(measured) {{}}
}};

{chr(10).join(tables)}
}}  // namespace dockloop
"""


def cut(result, end):
    """Return a run until a time."""
    return replace(result, values=result.values[result.time <= end + 1e-9])


def find_best_by_hand(case, reference):
    """Return the least seconds of the processor for each error of the check that is reached.

    The candidates are all methods of the calibration at all tolerances of the ladder.
    """
    ladders = [run_ladder(case, reference, 0.0, method) for method in METHODS]
    made = [pair for each in ladders for pair in zip(each["errors"], each["seconds"], strict=True)]
    reached = {
        wanted: [seconds for error, seconds in made if error is not None and error <= wanted]
        for wanted in CHECKED
    }
    return {wanted: min(seconds) for wanted, seconds in reached.items() if seconds}


def is_by_hand(number):
    """Is the best setting of this docking looked for?"""
    return number < WIDE and number % 1000 % FAMILY <= BY_HAND[is_family(number)]


def is_estimated(number):
    """Is the error measured? It costs more than all others: of every fourth unseen docking."""
    return number < WIDE or number % 4 == 0


def find_estimate(case, accuracy):
    """Return the measured error of a run; nothing if it is refused."""
    made = run(case, {"accuracy": accuracy, "solver.measure_error": True})
    return {} if made is None else {"estimate": float(made["solver.error_estimate"][-1])}


REFUSED = {  # what is found of a run that fails
    "error": math.inf,
    "early_error": math.inf,
    "figures": {},
    "evaluations": None,
    "seconds": math.nan,
}


def check_case(number):
    """Return errors, costs and estimates; without a start or a reference, which is missing."""
    case = draw_case(number)
    if is_refused(case):
        return {"number": number, "missing": "start"}
    reference, _ = find_reference(case)
    if reference is None:
        return {"number": number, "missing": "reference"}
    row = {"number": number, "has_bristles": has_bristles(case)}
    for accuracy in CHECKED if is_long(number) else (*CHECKED, "real-time"):
        began = time.process_time()
        made = run(case, {"accuracy": accuracy})
        took = time.process_time() - began
        if made is None:
            row[str(accuracy)] = dict(REFUSED)
            continue
        found = {"error": find_error(reference, made), "evaluations": count(made), "seconds": took}
        found["promise"] = float(made["solver.error_estimate"][-1])
        if is_long(number):
            found["figures"] = find_errors(reference, made) | find_further_figures(reference, made)
            found["early_error"] = find_error(*(cut(each, EARLY) for each in (reference, made)))
        if accuracy in ESTIMATED and is_estimated(number):
            found |= find_estimate(case, accuracy)
        row[str(accuracy)] = found
    if is_by_hand(number):
        for wanted, seconds in find_best_by_hand(case, reference).items():
            row[str(wanted)]["over_best"] = row[str(wanted)]["seconds"] / seconds
    return row


def describe_spread(ratios, digits):
    """Return median and range of some ratios; those that are unknown do not count."""
    low, median, high = np.nanquantile(ratios, (0.1, 0.5, 0.9))
    return f"{median:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def describe_errors(rows):
    """Return the table of errors and costs of some dockings."""
    if not rows:
        return []
    costs, seconds = (
        {a: np.array([row[str(a)][what] for row in rows], float) for a in CHECKED}
        for what in ("evaluations", "seconds")
    )
    table = Table(
        *("`accuracy`", "within it", "within 5 times", "median error", "largest error"),
        *("processor time over that of 1e-6, median (10 to 90 %)", "evaluations, median"),
        "time over the best by hand, median (10 to 90 %)",
    )
    for accuracy in CHECKED:
        made = [row[str(accuracy)] for row in rows]
        errors = np.array([each["error"] for each in made])
        ratios = np.array([each.get("over_best", np.nan) for each in made])
        over_best = ratios[np.isfinite(ratios)]
        table.add(
            f"{accuracy:g}",
            f"{np.mean(errors <= accuracy):.0%}",
            f"{np.mean(errors <= 5.0 * accuracy):.0%}",
            f"{np.median(errors):.0e}",
            f"{np.max(errors):.0e}",
            describe_spread(seconds[accuracy] / seconds[1e-6], 2),
            f"{np.nanmedian(costs[accuracy]):.0f}",
            f"{describe_spread(over_best, 1)}, {len(over_best)} dockings" if len(over_best) else "",
        )
    return table


LONG_FIGURES = {  # of long dockings: words, and which figures they are
    "peak loads": lambda name: "peak" in name,
    "stroke": lambda name: name == "stroke",
    "times of capture, contact and the sequence": lambda name: "time" in name or "entered" in name,
    "final position and attitude": lambda name: name in ("final_position", "final_attitude"),
    "final velocities": lambda name: name.startswith("final") and name.endswith("velocity"),
}


def describe_long(rows):
    """Return the blocks about long dockings: errors early and at their end."""
    if not rows:
        return []
    text = (
        f"{len(rows)} long dockings, {LONG_STOP:g} s, steps of"
        f" {' and '.join(f'{step:g} s' for step in LONG_STEPS)}"
        f" ({', '.join(f'`{scene}`' for scene in LONG_SCENES)}):"
    )
    table = Table(
        *("`accuracy`", f"at {EARLY:g} s: within it", "within 5 times", "largest error"),
        *(f"at {LONG_STOP:g} s: within it", "within 5 times", "largest error"),
        "measured error within a factor of 5",
    )
    for accuracy in CHECKED:
        cells = []
        for which in ("early_error", "error"):
            errors = np.array([row[str(accuracy)][which] for row in rows])
            cells += [f"{np.mean(errors <= times * accuracy):.0%}" for times in (1.0, 5.0)]
            cells.append(f"{np.max(errors):.0e}")
        if accuracy in ESTIMATED:
            ratios = find_ratios([row[str(accuracy)] for row in rows])
            cells.append(f"{np.mean((ratios > 0.2) & (ratios < 5.0)):.0%}")
        table.add(f"{accuracy:g}", *cells, *[""] * (accuracy not in ESTIMATED))
    groups = Table("at the end, within `accuracy`", *(f"{accuracy:g}" for accuracy in CHECKED))
    for what, belongs in LONG_FIGURES.items():
        cells = []
        for accuracy in CHECKED:
            errors = [
                error
                for row in rows
                for name, error in row[str(accuracy)]["figures"].items()
                if belongs(name)
            ]
            share = np.mean(np.array(errors) <= accuracy)
            cells.append(f"{share:.0%} of {len(errors)}, largest {np.max(errors):.0e}")
        groups.add(what, *cells)
    return [
        text,
        table,
        "After capture surfaces can rattle in their play for minutes. Small differences then grow"
        " at the same rate at every tolerance, so the error at the end can be far above the wanted"
        " one. A measured error finds such cases. A run that goes on for more than 30 s after first"
        " contact says so in its note. What holds all the same, by figure:",
        groups,
    ]


def find_ratios(found):
    """Return the measured errors over the errors, where there is one."""
    known = [each for each in found if each.get("estimate") and math.isfinite(each["error"])]
    return np.array([each["estimate"] / each["error"] for each in known])


def describe_real_time(rows, of):
    """Return the sentences about real time."""
    real = [row["real-time"] for row in rows if row["real-time"]["evaluations"]]
    if not real:
        return f"Real time, {of}: no docking ran to the end."
    half, most = np.quantile([each["error"] for each in real], (0.5, 0.95), method="higher")
    return (
        f"Real time, {of}: {len(real)} of {len(rows)} dockings ran to the end. Half of them have an"
        f" error below {half:.0e}, and 95 % below {most:.0e}. The median cost is"
        f" {np.median([each['evaluations'] for each in real]):.0f} evaluations."
    )


def find_residuals(errors):
    """Return how far errors are from what could be said of them, in logarithms.

    Args:
        errors: a row for each docking, tolerances fall from column to column.

    Returns:
        First from the median error of all dockings at this tolerance; second from the error of the
        same docking at the tolerance before, times the best factor.
    """
    alone, paired = [], []
    for pair in zip(errors.T[:-1], errors.T[1:], strict=True):
        known = np.isfinite(pair[0]) & np.isfinite(pair[1]) & (pair[1] > KNOWN)
        if np.count_nonzero(known) < len(errors) / 2:
            continue
        before, here = (np.log(each[known]) for each in pair)
        alone += list(here - np.median(here))
        paired += list(here - before - np.median(here - before))
    return np.array(alone), np.array(paired)


def describe_one_run(data):
    """Return the blocks on what one run can know of its error."""
    table = Table(
        *("dockings", "method", "median of all dockings"),
        "error of the same docking with ten times the tolerance",
    )
    for kind in KINDS:
        of_kind = select(data, kind)
        method = of_kind["methods"][-1]
        shares = [
            np.mean(np.abs(each) < math.log(5.0))
            for each in find_residuals(list_errors(of_kind, method))
        ]
        table.add(describe_kind(kind), method, *(f"{share:.0%}" for share in shares))
    return [
        "A companion with larger tolerances would be cheap, but it would say little of the error."
        " Share of errors in the calibration that are within a factor of 5 of what is said of them,"
        " with the best factor for each tolerance:",
        table,
        "So no estimate of one run is above nearly all errors and also close to them. Only a"
        " tighter run knows the error, which is why the companion has smaller tolerances.",
    ]


def describe_check(rows):
    """Return the blocks of the page."""
    families = [row for row in rows if is_family(row["number"])]
    long = [row for row in rows if is_long(row["number"])]
    unseen = {k: [row for row in rows if is_unseen(k, row["number"])] for k in UNSEEN}
    rings = [row for row in rows if row["number"] % 1000 <= FAMILY and row["number"] < WIDE]
    bristles = [row for each in unseen.values() for row in each if row["has_bristles"]]
    estimates = Table(
        *("`accuracy`", "measured: within a factor of 5", "above the error"),
        *("measured over error: 5 %, median, 95 %", "statistical value: within a factor of 5"),
    )
    for accuracy in ESTIMATED:
        made = [row[str(accuracy)] for row in rows if row[str(accuracy)]["evaluations"]]
        found = [each for each in made if "estimate" in each]
        ratios = find_ratios(found)
        promises = np.array([e["promise"] / e["error"] for e in made])
        close = [np.mean((each > 0.2) & (each < 5.0)) for each in (ratios, promises)]
        quantiles = np.quantile(ratios, (0.05, 0.5, 0.95))
        estimates.add(
            f"{accuracy:g}",
            f"{close[0]:.0%}",
            f"{np.mean(ratios >= 1.0):.0%}",
            ", ".join(f"{q:.2f}" for q in quantiles),
            f"{close[1]:.0%}",
        )
    return [
        f"{len(rings)} dockings with passive rings (`{RING}`):",
        describe_errors(rings),
        f"{len(families)} dockings of the families ({', '.join(f'`{f}`' for f in FAMILIES)}):",
        describe_errors(families),
        "Dockings of `tests/studies/unseen.py` have vehicles of 1 to 1000 t that close at 5 to"
        " 400 mm/s. A third has bristles, a third takes 30 s, some have thrust. Own mechanisms are"
        " drawn as in the calibration, with another seed. Changed hardware is not in it.",
        f"{len(unseen['changed'])} of them with changed hardware. Springs, dampers, brakes, drives,"
        " latches and contacts of the shipped mechanisms are multiplied or divided by up to 2.5:",
        describe_errors(unseen["changed"]),
        f"{len(unseen['own'])} with own mechanisms. All points of the legs of ring or hexapod are"
        " moved by up to 50 mm, and the ring has another mass:",
        describe_errors(unseen["own"]),
        f"Those {len(bristles)} of both that have bristles:",
        describe_errors(bristles),
        describe_long(long),
        describe_real_time(rings + families, "shipped scenes"),
        describe_real_time(unseen["changed"], "changed hardware"),
        describe_real_time(unseen["own"], "own mechanisms"),
        "## Error estimates",
        "`solver.error_estimate` of the same runs. With `solver.measure_error` it is measured, by a"
        " companion with smaller tolerances. Otherwise it is a statistical value, an"
        " upper limit for 98 % of the measured dockings, so most errors are much smaller.",
        estimates,
    ]


def describe_kind(kind):
    """Return the words for the dockings of a table."""
    is_ring, with_bristles = KINDS[kind]
    return ("Passive rings" if is_ring else "Other mechanisms") + (
        " with bristles" if with_bristles else ""
    )


def describe_calibration(data):
    """Return the table of errors by tolerance, and the choice."""
    table = Table("`solver.rtol`", *(f"{m}: median, 95 %, largest" for m in data["methods"]))
    errors = {method: list_errors(data, method) for method in data["methods"]}
    for i, rtol in enumerate(data["rtol"]):
        cells = []
        for of_method in errors.values():
            known = of_method[:, i : i + 1]
            at = [np.quantile(known, q, method="higher") for q in (0.5, 0.95, 1.0) if known.size]
            cells.append(", ".join(f"{value:.0e}" for value in at))
        table.add(f"{rtol:g}", *cells)
    titles = (
        f"steps of {step:g} s: method, `solver.rtol`, evaluations, processor time over that of 1e-6"
        for step in STEPS
    )
    chosen = Table("`accuracy`", *titles)
    rows = list_rows(data)
    floor = [min(cost.values()) for cost in rows[-1][3]]
    for error, methods, rtols, costs in rows:
        cells = []
        for method, cost, step, most in zip(methods, costs, STEPS, floor, strict=True):
            rtol = rtols[data["methods"].index(method)]
            evaluations = find_cost(data, method, rtol, step, "evaluations")
            ratio = cost[method] / most
            cells.append(f"{method}, {rtol:g}, {evaluations:.0f}, {ratio:.2f}")
        chosen.add(f"{error:g}", *cells)
    return [table, chosen]


def main():
    """Do the command."""
    parser = make_parser(__doc__)
    parser.add_argument("command", choices=("calibrate", "table", "check"))
    parser.add_argument(
        "--cases",
        type=int,
        nargs="+",
        metavar="N",
        help=f"dockings of each kind, in the order above (default: {CALIBRATED}, check: {CHECKS})",
    )
    parser.add_argument(
        "--rows", type=Path, help="file that keeps rows: an interrupted run goes on"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("-o", "--output", type=Path, help="the data or the page")
    options = parser.parse_args()
    if options.command == "check":
        rows, missing = run_cases(check_case, options, FIRST_CHECK, CHECKS)
        data = json.loads(DATA.read_text(encoding="utf-8"))
        write_page(
            options.output or PAGE,
            "The parameter accuracy",
            "tests/studies/accuracy.py check",
            f"{len(rows)} random dockings, most of {STOP:g} s, that are not in the calibration, of"
            f" {len(rows) + missing.total()} drawn: {missing['start']} start with overlapping"
            f" surfaces and are refused, {missing['reference']} have no reference solution."
            " The error of a run is the largest relative one of five peak loads, stroke, time of"
            " capture and final motion (`scripts/dockloop/result/run_errors.py`).",
            f"The reference solution is that of {REFERENCE[0]} at a tolerance of {REFERENCE[1]:g}."
            f" With bristles it is that of {REFERENCE_WITH_BRISTLES[0]} at"
            f" {REFERENCE_WITH_BRISTLES[1]:g}, or a looser one where that takes too many steps."
            " Another outcome counts as an infinite error, and so does a run that is refused. The"
            " best by hand is the least time of all methods of the calibration, at tolerances a"
            " decade apart, that has the error in this docking: a user would have to try them all.",
            describe_check(rows),
            describe_one_run(data),
            "## Calibration",
            f"Errors of {len(data['cases'])} other dockings (`tests/data/accuracy.json`) with the"
            " absolute tolerances that `accuracy` chooses, and the settings that follow. Ladders of"
            f" tolerances end at the first error below {KNOWN:g}: smaller ones count as this one,"
            " and costs go on as in the last decade.",
            *(
                block
                for kind in KINDS
                for block in (
                    f"{describe_kind(kind)}:",
                    *describe_calibration(select(data, kind)),
                )
            ),
        )
        return
    path = options.output or DATA
    if options.command == "calibrate":
        rows, _ = run_cases(calibrate_case, options, 1, CALIBRATED)
        write_data(rows, path)
    if path == DATA:
        TABLE.write_text(make_table(json.loads(DATA.read_text(encoding="utf-8"))), "utf-8")


if __name__ == "__main__":
    main()
