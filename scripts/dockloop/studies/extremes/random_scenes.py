"""``dockloop extremes --random N``: whole scenes drawn at random over many decades, each judged.

Masses, stiffnesses, speeds, offsets, times, steps and tolerances are drawn log-uniformly
(`draw_scene`), method and level by name. Every scene runs in a process that is killed when it takes
too long, and is judged against its reference solution and its audits (`dockloop.runs.judging`). A
bad case (wrong, hung, crashed) is made simpler: quantities go back to their defaults, or half-way,
as long as the case stays bad.
"""

import math
import random
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

from dockloop.base.files import scratch
from dockloop.base.version import __version__
from dockloop.base.words import LIMIT
from dockloop.native.core import list_choices, list_methods
from dockloop.result.accuracy import list_tolerances
from dockloop.runs.judging import BAD, Case, Verdict
from dockloop.sweeps.campaign import Campaign, How
from dockloop.sweeps.journal import Journal, make_digest
from dockloop.sweeps.judges import Judges

WORK = "extremes"
_SHRINKS = {"wrong": 24, "crashed": 24, "hung": 6}  # scenes, at most, tried to find a simpler one
_HALVINGS = 2  # of a quantity towards its default
_MOST_STEPS = 500  # communication steps of a scene

BASES = {  # scene: how often it is drawn, contact law can be set, numbers of its legs
    "idss_25t_350t": (5, True, "mechanism.set.leg_defaults"),
    "hexapod": (2, True, ""),
    "probe_drogue": (3, True, ""),
    "apda": (1, True, ""),
    "absorber_1d": (1, False, ""),
}


class Range(NamedTuple):
    """Where a quantity is drawn, log-uniformly.

    Attributes:
        low: lower end, above 0.
        high: upper end.
        default: of the scene, towards which a bad case shrinks.
        zero: how often it is 0 instead.
    """

    low: float
    high: float
    default: float
    zero: float = 0.0


RANGES = {  # of every scene
    "chaser.mass": Range(1.0, 1e7, 25e3),
    "target.mass": Range(1.0, 1e7, 350e3),
    "initial.closing_speed": Range(1e-4, 2.0, 0.1, 0.02),
    "initial.approach_time": Range(1e-4, 0.3, 0.1),
    "experiment.start": Range(1e-3, 1e9, 0.0, 0.5),
    "experiment.step": Range(1e-6, 10.0, 0.01),
    "solver.rtol": Range(1e-12, 1e-2, 1e-6),
    "solver.step": Range(1e-5, 0.1, 1e-3),
}
TURNED = {  # of scenes whose vehicles may meet askew
    "initial.lateral_offset": Range(1e-4, 0.5, 0.05, 0.05),
    "initial.lateral_speed": Range(1e-5, 0.5, 0.01, 0.3),
    "initial.pitch_yaw_deg": Range(1e-3, 29.0, 1.5, 0.05),
    "initial.pitch_yaw_rate_deg_s": Range(1e-3, 360.0, 0.05, 0.3),
    "initial.roll_rate_deg_s": Range(1e-3, 360.0, 0.05, 0.3),
}
CONTACT = {
    "contact.stiffness": Range(1e2, 1e10, 2e6),
    "contact.node_stiffness": Range(1e2, 1e10, 2e5),
    "contact.friction_coefficient": Range(1e-3, 2.0, 0.1, 0.1),
    "contact.friction_speed": Range(1e-6, 0.1, 1e-3),
}
LEGS = {"stiffness": Range(1e2, 1e10, 2e3), "damping": Range(1.0, 1e6, 1e3, 0.1)}
ANGLES = {  # uniform
    "initial.lateral_direction_deg": 360.0,
    "initial.pitch_yaw_direction_deg": 360.0,
    "initial.pitch_yaw_rate_direction_deg": 360.0,
}
SIZES = (0.3, 10.0)  # m, edges of the box that a vehicle is
DURATION = (0.1, 2.0)  # s after first contact


@dataclass
class Drawn:
    """A scene of a seed.

    Attributes:
        number: of the scene.
        case: what is judged.
        verdict: on it.
        simpler: a bad case made simpler, and its verdict; None: it was not bad.
    """

    number: int
    case: Case
    verdict: Verdict
    simpler: tuple[Case, Verdict] | None = None


@dataclass
class Outcome:
    """All that a run of random scenes found.

    Attributes:
        seed: of the scenes.
        limit: time limit [s].
        drawn: the scenes in order.
    """

    seed: int
    limit: float
    drawn: list[Drawn] = field(default_factory=list)


class Dice:
    """Random numbers of a scene: each quantity has its own, so a new one leaves the others alone.

    Attributes:
        name: of the scene.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def draw(self, what: str) -> float:
        """Return the number of a quantity, from 0 to 1."""
        return random.Random(f"{self.name}/{what}").random()

    def draw_log(self, what: str, low: float, high: float) -> float:
        """Draw a quantity log-uniformly, four digits of it."""
        return float(f"{low * (high / low) ** self.draw(what):.4g}")

    def choose(self, what: str, weights: dict[str, float]) -> str:
        """Choose a name. Where a new name is added, it takes its share of all others."""
        return max(weights, key=lambda name: self.draw(f"{what}={name}") ** (1.0 / weights[name]))


def draw_scene(seed: int, number: int, limit: float = LIMIT) -> Case:
    """Return a scene of a seed: always the same one for the same two numbers."""
    dice = Dice(f"{seed}/{number}")
    scene = dice.choose("scene", {name: often for name, (often, _, _) in BASES.items()})
    keys: dict[str, Any] = {}
    for name, where in list_ranges(scene).items():
        is_zero = dice.draw(f"{name} is zero") < where.zero
        keys[name] = 0.0 if is_zero else dice.draw_log(name, where.low, where.high)
    if BASES[scene][1]:
        keys |= {name: most * dice.draw(name) for name, most in ANGLES.items()}
        keys["contact.friction_model"] = _choose(dice, "friction.model")
    for vehicle, sign in (("chaser", 1.0), ("target", -1.0)):
        length, *others = (dice.draw_log(f"{vehicle} {axis}", *SIZES) for axis in "xyz")
        keys[f"{vehicle}.inertia"] = _find_inertia(keys[f"{vehicle}.mass"], length, *others)
        keys[f"{vehicle}.interface_position"] = [sign * length / 2.0, 0.0, 0.0]
    keys["solver.method"] = _draw_method(dice)
    keys["model.level"] = _choose(dice, "model.level", 3)
    if dice.draw("reference level") < 0.03:
        keys["model.level"] = "reference"  # which no FMU carries
    keys |= list_tolerances(keys["solver.rtol"])
    span = keys["initial.approach_time"] + dice.draw_log("duration", *DURATION)
    span = max(min(span, _MOST_STEPS * keys["experiment.step"]), keys["experiment.step"])
    if span < 4.0 * keys["initial.approach_time"]:  # few steps: begin close to the contact
        keys["initial.approach_time"] = span / 4.0
    keys["experiment.stop"] = keys["experiment.start"] + span
    return Case(scene, keys, limit=limit)


def list_ranges(scene: str) -> dict[str, Range]:
    """Return the quantities of a scene that are drawn log-uniformly."""
    _, has_contact, legs = BASES[scene]
    ranges = dict(RANGES)
    if has_contact:
        ranges |= TURNED | CONTACT
    return ranges | ({f"{legs}.{name}": where for name, where in LEGS.items()} if legs else {})


def _choose(dice: Dice, what: str, count: int | None = None) -> str:
    """Choose one of the first names of a list of choices."""
    return dice.choose(what, {choice.name: 1.0 for choice in list_choices(what)[:count]})


def _draw_method(dice: Dice) -> str:
    """Draw a method: mostly one that FMUs carry."""
    is_carried = dice.draw("carried method") < 0.95
    names = [m["name"] for m in list_methods() if m["for_comparison"] != is_carried]
    return dice.choose("method", dict.fromkeys(names, 1.0))


def _find_inertia(mass: float, a: float, b: float, c: float) -> list[float]:
    """Return the inertia of a homogeneous box."""
    squares = (b * b + c * c, a * a + c * c, a * a + b * b)
    return [*(mass * square / 12.0 for square in squares), 0.0, 0.0, 0.0]


def run_random(
    count: int,
    seed: int,
    *,
    first: int = 1,
    limit: float = LIMIT,
    journal: Path | None = None,
    progress: Callable[[int, int, Counter], None] = lambda *_: None,
    **how: Unpack[How],
) -> Outcome:
    """Draw scenes and judge them.

    Args:
        count: how many.
        seed: of the random numbers.
        first: number of the first scene.
        limit: most processor time of a scene [s].
        journal: file in which verdicts are kept; None: nowhere.
        progress: receives scenes judged, scenes asked for, and how many of each verdict.
        how: see `How`.

    Raises:
        UsageError: the journal belongs to other scenes.
        InterruptedWorkError: by Ctrl-C.
    """
    numbers = range(first, first + count)
    cases = [(number,) for number in numbers]
    outcome = Outcome(seed, limit)
    with ExitStack() as stack:
        path = journal or stack.enter_context(scratch()) / "journal.jsonl"
        setup = {"dockloop": __version__, "seed": seed, "limit": limit}
        resume, digest = how.get("resume", False), make_digest([*numbers])
        kept = Journal(path, setup, count, resume=resume, work=WORK, digest=digest)
        judges = stack.enter_context(
            Judges(lambda values: draw_scene(seed, int(values[0]), limit), how.get("workers"))
        )
        campaign = Campaign(kept, lambda: nullcontext(judges))
        stack.enter_context(campaign.at_work(lambda: cases))
        found = (Verdict.from_result(kept.known[case]) for case in cases if case in kept.known)
        judges.tally.update(verdict.verdict for verdict in found)
        campaign.run(cases, report=lambda done, total: progress(done, total, judges.tally))
        for number in numbers:
            case = draw_scene(seed, number, limit)
            verdict = Verdict.from_result(kept.known[number,])
            drawn = Drawn(number, case, verdict)
            if verdict.verdict in BAD:
                drawn.simpler = shrink(judges, case, verdict)
            outcome.drawn.append(drawn)
    return outcome


def shrink(judges: Judges, case: Case, verdict: Verdict) -> tuple[Case, Verdict]:
    """Make a bad case simpler: every quantity at its default, else half-way, if it stays bad."""
    left = _SHRINKS[verdict.verdict]

    def try_out(simpler: Case) -> bool:
        nonlocal case, verdict, left
        if left == 0 or simpler == case:
            return False
        left -= 1
        found = judges.ask(simpler)
        if found.verdict != verdict.verdict:
            return False
        case, verdict = simpler, found
        return True

    ranges = list_ranges(case.scene)
    for names in _list_groups(case):
        rest = {name: value for name, value in case.overrides.items() if name not in names}
        try_out(replace(case, overrides=rest))
    for name in [n for n in ranges if n in case.overrides and n != "experiment.start"]:
        for _ in range(_HALVINGS):
            half = _go_half_way(case.overrides[name], ranges[name].default)
            if not try_out(replace(case, overrides={**case.overrides, name: half})):
                break
    return case, verdict


def _list_groups(case: Case) -> Iterator[list[str]]:
    """Yield names that go back to their defaults together."""
    groups: dict[str, list[str]] = {}
    for name in case.overrides:
        head = name.partition(".")[0]
        if name in ("experiment.step", "solver.method", "solver.step", "model.level"):
            head = name
        if name in ("experiment.start", "experiment.stop", "initial.approach_time"):
            continue  # they belong together
        if "rate" in name or "speed" in name:
            head = name
        groups.setdefault(head, []).append(name)
    yield from groups.values()


def _go_half_way(value: float, default: float) -> float:
    """Return the value between another one and the default, in decades where both are above 0."""
    if value > 0.0 and default > 0.0:
        return float(f"{math.sqrt(value * default):.4g}")
    return (value + default) / 2.0
