"""Case C: the least approach speed of a capture, with a thrust that begins late.

A vehicle of mass m meets a resistance F(x) over the travel s; at s it is held. From the time T
after first contact a thrust P acts. Captured is a motion that reaches s.

1. Constant F, as in the source: x1 = v T - F T^2/(2m), v1 = v - F T/m; captured if
   x1 + m v1^2/(2 (F - P)) >= s, or if s is reached before T.
2. Spring F = k x, with the latches of dockloop at s: x1 = (v/w) sin(w T), v1 = v cos(w T);
   captured if m v1^2/2 + P (s - x1) >= k (s^2 - x1^2)/2, or if s is reached before T.
"""

import itertools
import math
from collections.abc import Callable

from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_near, compare_range, compare_words
from models import make_scene

import dockloop as dl

MASS, FORCE, THRUST, TRAVEL = 4650.0, 1500.0, 400.0, 0.05  # kg, N, N, m
STIFFNESS = 2.0 * FORCE / TRAVEL  # N/m: takes the same energy over the travel
DELAYS = (0.0, 0.1, 0.25, 0.5, 1.0)  # s
CATCH = 1e-4  # m, distance at which a latch catches
RESOLUTION = 2e-6  # m/s, of the bisection


def captures_against_force(v: float, delay: float, thrust: float = THRUST) -> bool:
    """Return whether a constant resistance is overcome."""
    stop = MASS * v / FORCE
    if stop <= delay:
        return 0.5 * MASS * v * v / FORCE >= TRAVEL or thrust >= FORCE
    if 0.5 * MASS * v * v / FORCE >= TRAVEL or thrust >= FORCE:
        return True
    x, speed = v * delay - 0.5 * FORCE / MASS * delay**2, v - FORCE / MASS * delay
    return x + 0.5 * MASS * speed**2 / (FORCE - thrust) >= TRAVEL


def captures_against_spring(v: float, delay: float) -> bool:
    """Return whether a spring is overcome."""
    w = math.sqrt(STIFFNESS / MASS)
    if v >= w * TRAVEL:
        return True
    turn = w * delay
    if turn >= 0.5 * math.pi:  # it returns; no case here
        return False
    x, speed = v / w * math.sin(turn), v * math.cos(turn)
    work = THRUST * (TRAVEL - x)
    return 0.5 * MASS * speed**2 + work >= 0.5 * STIFFNESS * (TRAVEL**2 - x**2)


def find_least(captures: Callable[[float], bool], low: float = 0.05, high: float = 0.25) -> float:
    """Return the least speed that captures, by bisection [m/s]."""
    while high - low > RESOLUTION:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if captures(middle) else (middle, high)
    return 0.5 * (low + high)


def make_buffer(stiffness: float, v: float) -> dl.Scene:
    """Return a vehicle in front of a fixed one; latches catch when the spring has given way."""
    latch = {"hook": [0, 0.6, 0], "striker": [TRAVEL + CATCH, 0.6, 0]}
    rules = {"range": 2.0 * CATCH, "catch": CATCH, "play": 2.0 * CATCH, "window": 0.025}
    strength = {"push_force": 1e-6, "stiffness": 1e6, "damping": 4}
    return make_scene(
        {
            "bodies": [],
            "contact": {"type": "absorber", "stiffness": stiffness, "damping": 0, "pulls": False},
            "latches": rules | strength | {"list": [latch]},
        },
        chaser={"mass": MASS},
        target={"motion": "fixed"},
        initial={"at": "first_contact", "approach_time": 0.0, "closing_speed": v},
        groups=("relative", "capture", "contact", "phase"),
    )


def runs_to_capture(
    v: float, delay: float, *, constant: bool = False, thrust: float = THRUST
) -> bool:
    """Return whether a run is captured, against the spring or against a constant force."""
    settings = {"chaser.contact_thrust_delay": delay, "chaser.contact_thrust": thrust}
    if constant:
        settings["chaser.force_ext[1]"] = -FORCE
    scene = make_buffer(1e-3 if constant else STIFFNESS, v)
    run = dl.run(scene, None, settings, stop=2.0, step=0.05)
    return bool(run["captured"].max())


def compare_exactly() -> list[Comparison]:
    """The least speed, by bisection with the formula and with runs."""
    rows = []
    for delay in DELAYS:
        expected = find_least(lambda v, t=delay: captures_against_force(v, t))
        found = find_least(lambda v, t=delay: runs_to_capture(v, t, constant=True))
        what = f"least speed, constant force, thrust after {delay:g} s [m/s]"
        rows.append(compare_near(what, found, expected, relative=1e-4))
    for delay in DELAYS[:3]:
        expected = find_least(lambda v, t=delay: captures_against_spring(v, t))
        found = find_least(lambda v, t=delay: runs_to_capture(v, t))
        what = f"least speed, spring and latch, thrust after {delay:g} s [m/s]"
        rows.append(compare_near(what, found, expected, relative=1e-4))
    slow = runs_to_capture(0.002, 0.0, constant=True, thrust=2.0 * FORCE)
    rows.append(
        compare_words(
            "thrust above the resistance, no delay, 0.002 m/s",
            "captured" if slow else "not captured",
            "captured at any speed",
            slow,
        )
    )
    return rows


def compare_trends() -> list[Comparison]:
    """Order of size, and monotony over delay and thrust, of runs."""
    speeds = [find_least(lambda v, t=t: runs_to_capture(v, t, constant=True)) for t in DELAYS]
    rising = all(a < b for a, b in itertools.pairwise(speeds))
    part = (speeds[3] - speeds[0]) / (speeds[4] - speeds[0])
    by_thrust = [
        find_least(lambda v, p=p: runs_to_capture(v, 0.0, constant=True, thrust=p))
        for p in (0.0, 400.0, 800.0)
    ]
    falling = all(a > b for a, b in itertools.pairwise(by_thrust))
    return [
        compare_range("least speed with thrust and no delay [m/s]", speeds[0], 0.1, 0.2),
        compare_words(
            "least speed over the delay of the thrust",
            "rises" if rising else "does not rise",
            "rises",
            rising,
        ),
        compare_words(
            "benefit of the thrust that a delay of 0.5 s takes away",
            f"{100 * part:.0f} %",
            "nearly all: above 90 %",
            part > 0.9,
        ),
        compare_words(
            "least speed over the thrust",
            "falls" if falling else "does not fall",
            "falls",
            falling,
        ),
    ]


def draw(axes) -> None:
    """Draw the least speed over the delay."""
    delays = [0.01 * i for i in range(111)]
    for name, captures in (
        ("constant force", captures_against_force),
        ("spring", captures_against_spring),
    ):
        shown = [t for t in delays if name != "spring" or t < 0.27]
        axes.plot(shown, [find_least(lambda v, t=t: captures(v, t)) for t in shown], label=name)  # noqa: B023
    for t in DELAYS:
        least = find_least(lambda v, t=t: runs_to_capture(v, t, constant=True))
        axes.plot(t, least, "o", color="C0")
    axes.set_xlabel("delay of the thrust after first contact [s]")
    axes.set_ylabel("least approach speed [m/s]; dots: dockloop")
    axes.legend(title="resistance")


CASE = Case(
    "C",
    "Least approach speed with a delayed thrust",
    "Syromiatnikov, pages 234-235, 303",
    (
        Input("least speed with thrust", "0.14 m/s", GIVEN, "234"),
        Input("largest delay of the thrust", "0.5 s", GIVEN, "234"),
        Input("a thrust above the resistance links at any speed", "yes", GIVEN, "234-235"),
        Input("mass", "4650 kg", ASSUMED),
        Input("resistance, travel", "1.5 kN over 50 mm; spring 60 kN/m", ASSUMED),
        Input("thrust", "400 N", ASSUMED),
    ),
    "The thrust is triggered by first contact, and ends with the capture by the latches. Both"
    " events are those of the product. The constant resistance is an external force; the spring is"
    " a contact. The published 0.14 m/s is met in size only, as mass, springs and thrust are lost.",
    exact=compare_exactly,
    trend=compare_trends,
    figure=draw,
)
