"""Sequences: retraction against exact times, order, dwell, time-outs, commands, malformed files.

Oracle of the retraction (``tests/data/mechanism_oracles.json``): a load on a drive with a limit,
integrated by an independent program. A slide with known acceleration is the oracle of times at
which conditions hold.
"""

import json
import random
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import UsageError
from slides import make_element, make_slide, write_slide

DATA = json.loads((Path(__file__).parent / "data" / "mechanism_oracles.json").read_text())
RETRACTION = DATA["retraction"]
DRIVE = {
    "type": "drive",
    "target": 0.0,
    "speed": 0.01,
    "acceleration": 0.002,
    "approach": 2e-5,
    "gain": 2e6,
    "limit": 600.0,
}
X, V = "element.one.coordinate", "element.one.rate"


def when(quantity: str, **bounds: object) -> dict:
    return {"quantity": quantity, **bounds}


def step(name: str, *rows: tuple, phase: int = 1, **members: object) -> dict:
    """A step; a row is (condition, next step) and may end with an outcome."""
    keys = ("when", "go", "outcome")
    rows = [dict(zip(keys, row, strict=False)) for row in rows]
    return {"name": name, "phase": phase, "next": rows, **members}


@pytest.fixture(params=["auto", "rosenbrock"])
def dock(tmp_path, request):
    """Make a docking of a slide with laws and steps; other members are those of the mechanism.

    Steps of the second method may end after the communication point.
    """

    def make(*steps: dict, laws: tuple, mass: float = 40.0, rate: float = 0.0, **keys: object):
        mechanism = make_slide(mass, make_element(*laws), sequence={"steps": list(steps)})
        docking = dl.Docking(write_slide(tmp_path, mechanism, rate), overrides=keys)
        docking.set("solver.method", request.param)
        return docking

    return make


def advance(docking, stop: float, h: float = 0.05) -> list[tuple[float, int]]:
    """Step to a time; return the times after which the step of the sequence had changed."""
    seen = [(docking.time, docking.get("sequence.step"))]
    while docking.time < stop - 1e-9:
        docking.step(min(h, stop - docking.time))
        if docking.get("sequence.step") != seen[-1][1]:
            seen.append((docking.time, docking.get("sequence.step")))
    return seen


@pytest.mark.parametrize("h", [0.01, 2.0])
def test_a_window_that_is_passed_within_one_inner_step_is_seen(dock, h):
    """A free slide takes steps of seconds; the condition holds for a third of a second."""
    docking = dock(
        step("before", (when(X, between=[0.1, 0.2]), "inside")),
        step("inside"),
        laws=({"type": "spring", "stages": [[10.0, 400]], "side": "positive"},),
        rate=0.3,
    )
    times = advance(docking, 2.0, h)
    assert times[-1][1] == 2
    assert docking.get("sequence.time_in_step") == pytest.approx(2.0 - 1.0 / 3.0, abs=1e-6)


def retract(run: dict) -> tuple[dict, ...]:
    """Run the drive; end at the target, or held by a stall."""
    stall = {
        "all": [
            when("element.one.saturation", above=0.98),
            when(V, between=[-2e-4, 2e-4]),
        ],
        "for": 2,
    }
    return (
        step(
            "retract",
            (when(X, above=run["target"] - 1e-4), "seated"),
            (stall, "hold", "retraction_stalled"),
            phase=6,
            do=[{"element": "one", "run": run}],
        ),
        step("seated", phase=7),
        step("hold", phase=11),
    )


RUN = {"target": RETRACTION["distance"], "speed": RETRACTION["speed"], "acceleration": 0.002}


@pytest.mark.parametrize("case", RETRACTION["checked"], ids=["free", "160 N", "140 N"])
def test_a_sequence_retracts_a_load_in_the_stated_time(dock, case):
    """The drive starts two seconds late: its ramp counts from the step."""
    load = {"type": "constant", "force": -RETRACTION["friction"]}
    brake = {"type": "brake", "forward": 1000}
    wait = step("wait", (when("time", above=2.0), "retract"), do=[{"element": "one", "run": "off"}])
    run, *others = retract(RUN)
    run["do"] += [{"element": "one", "engagement": 0}]
    docking = dock(
        wait,
        run,
        *others,
        laws=({**DRIVE, "limit": case["limit"]}, load, brake),
        mass=RETRACTION["m_eq"],
    )
    times = {place: time for time, place in advance(docking, 40.0, 0.01)}
    # The brake holds the load before; its bristle relaxes within milliseconds.
    assert times[3] - 2.0 == pytest.approx(case["time_law"], abs=0.03)
    assert docking.get("phase") == 7
    assert docking.get("energy.drive_work") == pytest.approx(RETRACTION["work"], rel=5e-3)
    assert abs(docking.get("energy.residual")) < 1e-7 * RETRACTION["work"]


def test_a_lock_stops_and_holds_a_load_as_its_spring_and_damper_do(dock):
    """Closed form: a free run under a force, a damped swing about the lock, a free run again."""
    mass, force, rate, begin, end = 40.0, 10.0, 0.002, 0.1, 100.0
    stiffness, damping = 1e6, 2e3
    lock = {"element": "one", "lock": "on", "stiffness": stiffness, "damping": damping}
    docking = dock(
        step("run", (when("time", above=begin), "held")),
        step("held", (when("time", above=1.0), "held again"), do=[lock]),
        step("held again", (when("time", above=end - 1.0), "free"), do=[lock]),
        step("free", do=[{"elements": "o*", "lock": "off"}]),
        laws=({"type": "constant", "force": force},),
        mass=mass,
        rate=rate,
    )
    place = rate * begin + force / mass * begin**2 / 2
    speed = rate + force / mass * begin
    decay, sag = damping / (2 * mass), force / stiffness
    turns = np.sqrt(stiffness / mass - decay**2)

    def swing(t: float) -> float:
        sine = (speed - decay * sag) / turns
        return sag + np.exp(-decay * t) * (sine * np.sin(turns * t) - sag * np.cos(turns * t))

    advance(docking, begin, 0.1)
    for t in (0.004, 0.01, 0.03, 0.2):
        docking.step(begin + t - docking.time)
        assert docking.get("element[1].coordinate") == pytest.approx(place + swing(t), abs=1e-9)
    advance(docking, begin + end - 2.0, 10.0)
    assert docking.get("element[1].force") == pytest.approx(0.0, abs=1e-3)  # held at rest
    advance(docking, begin + end, 10.0)
    assert docking.get("element[1].coordinate") == pytest.approx(place + sag, abs=1e-9)
    brought = mass * speed**2 / 2
    assert docking.get("energy.dissipated_brakes") == pytest.approx(brought + force * sag, rel=1e-6)
    docking.step(0.5)
    run = place + sag + force / mass * 0.5**2 / 2
    assert docking.get("element[1].coordinate") == pytest.approx(run, abs=1e-6)
    assert abs(docking.get("energy.residual")) < 1e-8


def test_a_lock_of_its_own_stiffness_holds_without_creep(dock):
    """In turns: a saved state in the middle restores the hold, and the energy that it stores."""
    docking = dock(
        step("held", (when("time", above=100.0), "free"), do=[{"element": "one", "lock": "on"}]),
        step("free", do=[{"element": "one", "lock": "off"}]),
        laws=({"type": "constant", "force": 200.0},),
    )
    docking.step(50.0)
    state, results = docking.save(), []
    for _ in range(2):
        docking.restore(state)
        docking.step(49.0)
        results += [[docking.get(name) for name in ("element[1].coordinate", "energy.potential")]]
        docking.step(2.0)
        results[-1].append(docking.get("element[1].coordinate"))
    assert results[0] == results[1]
    held, _, free = results[0]
    assert abs(held) < 5e-6
    assert free == pytest.approx(held + 200.0 / 40.0 / 2, rel=1e-6)


def test_a_drive_below_its_load_stalls(dock):
    docking = dock(
        *retract(RUN),
        laws=({**DRIVE, "limit": 100.0, "gain": 1e5}, {"type": "brake", "forward": 120}),
        mass=RETRACTION["m_eq"],
    )
    times = advance(docking, 5.0)
    assert [place for _, place in times] == [1, 3]
    assert times[1][0] == pytest.approx(2.52, abs=0.06)  # saturated from 0.49 s on
    assert abs(docking.get("element[1].coordinate")) < 1e-4
    assert (docking.get("phase"), docking.get("outcome")) == (11, 9)


def test_a_drive_stalls_where_a_spring_and_friction_take_its_limit(dock):
    exact = RETRACTION["spring_stall"]
    laws = (
        {**DRIVE, "limit": exact["limit"], "gain": 2e5},
        {"type": "spring", "stages": [[0, exact["spring"]]]},
        {"type": "brake", "forward": RETRACTION["friction"]},
    )
    docking = dock(*retract(RUN), laws=laws, mass=1.0)
    advance(docking, 60.0)
    assert docking.get("element[1].coordinate") == pytest.approx(exact["stalls_at"], abs=1e-3)
    assert docking.get("outcome") == 9


# ---------------------------------------------------------------- conditions

PUSH = ({"type": "constant", "force": 4.0},)  # 0.1 m/s2 on 40 kg


def test_conditions_are_located_and_do_not_depend_on_the_communication_step(dock):
    steps = (
        step("a", (when(X, above=0.05), "b")),  # at 1 s
        step("b", (when(V, above=0.2), "c"), phase=2),  # at 2 s
        step("c", (when("time", above=0.5), "d"), phase=3),  # at 2.5 s
        step("d", phase=4),
    )
    for h in (0.013, 0.17, 3.0):
        docking = dock(*steps, laws=PUSH)
        advance(docking, 3.0, h)
        assert docking.get("sequence.step") == 4
        assert docking.get("phase") == 4
        assert docking.get("sequence.time_in_step") == pytest.approx(0.5, abs=1e-8)


def test_all_any_and_the_order_of_rows(dock):
    both = {"all": [when(X, above=0.05), when(V, above=0.2)]}  # at 2 s
    either = {"any": [when(X, above=0.05), when(V, above=0.2)]}  # at 1 s
    docking = dock(step("a", (both, "b")), step("b", phase=2), laws=PUSH)
    assert advance(docking, 3.0)[1][0] == pytest.approx(2.0, abs=0.051)
    docking = dock(step("a", (either, "b"), (both, "c")), step("b"), step("c"), laws=PUSH)
    assert [place for _, place in advance(docking, 3.0)] == [1, 2]
    first = step("a", (when(X, above=0.05), "c"), (when(X, above=0.05), "b"))
    docking = dock(first, step("b"), step("c"), laws=PUSH)
    assert [place for _, place in advance(docking, 3.0)] == [1, 3]


def test_a_dwell_counts_without_breaks(dock):
    """On a spring with a period of 2 s, x > 0 holds for 1 s at a time."""
    spring = ({"type": "spring", "stages": [[0, 40 * np.pi**2]]},)
    long = step("a", ({**when(X, above=0.0), "for": 1.1}, "b"), phase=1)
    docking = dock(long, step("b"), laws=spring, rate=0.1)
    assert len(advance(docking, 9.0, 0.31)) == 1
    short = step("a", ({**when(X, above=0.01), "for": 0.25}, "b"), phase=1)
    docking = dock(short, step("b"), laws=spring, rate=0.1)
    advance(docking, 1.0, 1.0)
    began = np.arcsin(0.01 * np.pi / 0.1) / np.pi
    assert docking.get("sequence.time_in_step") == pytest.approx(1.0 - began - 0.25, abs=1e-7)


def test_a_step_times_out(dock):
    late = {"go": "b", "outcome": "timed_out"}
    docking = dock(step("a", timeout=1.25, on_timeout=late), step("b", phase=11), laws=PUSH)
    advance(docking, 2.0, 0.4)
    assert (docking.get("sequence.step"), docking.get("outcome")) == (2, 10)
    assert docking.get("sequence.time_in_step") == pytest.approx(0.75, abs=1e-9)
    stays = dock(step("a", timeout=1.25), laws=PUSH)
    advance(stays, 2.0, 0.4)
    assert (stays.get("sequence.step"), stays.get("outcome")) == (1, 10)


def test_a_summary_has_the_steps_between_two_communication_points(dock):
    """B and c last 0.1 s each, the communication step is 1 s; d leads back within one step."""
    steps = (
        step("a", (when("time", above=0.35), "b")),
        step("b", (when("time", above=0.1), "c")),
        step("c", (when("time", above=0.1), "e")),
        step("d", (when("time", above=0.1), "e")),
        step("e", (when("time", above=0.75), "d")),
    )
    docking = dock(*steps, laws=PUSH)
    result = docking.record(np.arange(3.0))
    assert result["sequence.step"].tolist() == [1, 5, 5]
    assert result["sequence.entered"][-1] == pytest.approx([0, 0.35, 0.45, 1.3, 0.55])
    assert result["sequence.entered"][1].tolist()[3] == -1.0
    assert result.summary["sequence"]["steps"] == ["a", "b", "c", "e", "d", "e"]


def test_a_command_acts_at_the_start_of_a_communication_step(dock):
    steps = (step("a", ({"command": "retract"}, "b")), step("b", ({"command": "abort"}, "a")))
    docking = dock(*steps, laws=PUSH)
    advance(docking, 1.0, 0.25)
    docking.set("command", "retract")
    docking.step(0.25)
    assert docking.get("sequence.step") == 2
    assert docking.get("sequence.time_in_step") == pytest.approx(0.25, abs=1e-12)
    docking.set("command", "abort")
    docking.step(0.25)
    assert docking.get("sequence.step") == 1


def test_hold_stops_drives_and_timers(dock):
    run = {"element": "one", "run": {"target": 0.1, "speed": 0.01, "acceleration": 0.1}}
    docking = dock(step("a", do=[run], timeout=6.0), laws=({**DRIVE, "gain": 1e5},))
    advance(docking, 3.0)
    docking.set("command", "hold")
    docking.step(0.1)
    there = docking.get("element[1].coordinate")
    advance(docking, 10.0)
    assert docking.get("element[1].coordinate") == pytest.approx(there, abs=1e-4)
    assert docking.get("sequence.time_in_step") == pytest.approx(3.0, abs=1e-9)
    assert docking.get("outcome") == 1
    docking.set("command", "none")
    advance(docking, 12.9)
    assert docking.get("outcome") == 1
    assert docking.get("element[1].coordinate") > there + 0.02
    advance(docking, 13.1)
    assert docking.get("outcome") == 10


def test_a_sequence_that_chatters_is_refused_with_the_names_of_its_steps(dock):
    a = step("left", (when(X, below=0.05), "right"), (when(X, above=0.05), "right"))
    b = step("right", (when(X, between=[-1, 1]), "left"))
    with pytest.raises(UsageError, match=r"more than 8 times at one instant .*'left', 'right'"):
        dock(a, b, laws=PUSH).step(0.1)
    late = step("calm", (when("time", above=0.5), "left"))
    docking = dock(late, a, b, laws=PUSH)
    docking.step(0.4)
    before = docking.get("element[1].coordinate")
    with pytest.raises(dl.DockloopError, match="'left', 'right'"):
        docking.step(0.2)
    assert docking.get("element[1].coordinate") == before
    assert docking.get("sequence.step") == 1


# ---------------------------------------------------------------- states, scenes, files


def test_a_saved_state_restores_a_sequence_bit_for_bit(dock):
    stall, *others = retract(RUN)
    docking = dock(
        step("wait", ({**when(X, above=-1), "for": 0.7}, "retract")),
        stall,
        *others,
        laws=({**DRIVE, "gain": 1e4}, {"type": "brake", "forward": 120}),
        mass=500.0,
    )
    draw = random.Random(5)
    for _ in range(30):
        docking.set("command", draw.choice(["none", "none", "hold", "retract"]))
        docking.step(draw.uniform(0.01, 0.5))
        state = docking.save()
        steps = [draw.uniform(0.01, 0.5) for _ in range(3)]
        names = ["element[1].coordinate", "element[1].force", "sequence.time_in_step", "outcome"]
        results = []
        for _ in range(2):
            docking.restore(state)
            for h in steps:
                docking.step(h)
            results.append([docking.get(name) for name in names])
        assert results[0] == results[1]
        docking.restore(state)


def test_a_scene_changes_a_sequence_and_stops_it(dock):
    steps = (
        step("a", (when(X, above=0.05), "b")),
        step("b", (when(V, above=0.2), "c"), phase=2, timeout=9.0),
        step("c", phase=3),
    )
    docking = dock(*steps, laws=PUSH, **{"sequence.set.a.next.1.when.above": 0.2})
    assert advance(docking, 3.0)[1][0] == pytest.approx(2.0, abs=0.051)
    docking = dock(*steps, laws=PUSH, **{"sequence.stop_after": "b", "sequence.set.b.timeout": 0.1})
    assert [place for _, place in advance(docking, 3.0)] == [1, 2]
    assert docking.get("outcome") == 1  # not timed out
    with pytest.raises(UsageError, match=r"stop_after is 'd': .* its steps are a, b, c"):
        dock(*steps, laws=PUSH, **{"sequence.stop_after": "d"})


MALFORMED = {
    "start is 'x'; no step has this name": {"start": "x"},
    "'a' is used twice": {"steps": [step("a"), step("a")]},
    "go is 'x'; no step has this name": {"steps": [step("a", (when(X, above=0), "x"))]},
    "phase .*12": {"steps": [step("a", phase=12)]},
    "one of above, below, between; it has 2": {
        "steps": [step("a", (when(X, above=0, below=1), "a"))]
    },
    "known quantities are time": {"steps": [step("a", (when("speed", above=0), "a"))]},
    "no force element has the name 'two'": {
        "steps": [step("a", (when("element.two.rate", above=0), "a"))]
    },
    "an element has coordinate": {"steps": [step("a", (when("element.one.x", above=0), "a"))]},
    "is 1 and 0; it must be two numbers that increase": {
        "steps": [step("a", (when(X, between=[1, 0]), "a"))]
    },
    "is 'leg\\[3\\].length', but there are 0 legs": {
        "steps": [step("a", (when("leg[3].length", above=0), "a"))]
    },
    "is 'relative.position\\[4\\]', but its index is 1 to 3": {
        "steps": [step("a", (when("relative.position[4]", above=0), "a"))]
    },
    "is 'gap', but the mechanism has no contact": {
        "steps": [step("a", (when("gap", below=0), "a"))]
    },
    "latched is 1, but the mechanism has no latches": {"steps": [step("a", ({"latched": 1}, "a"))]},
    "latched_below is 2, but the mechanism has no latches": {
        "steps": [step("a", ({"latched_below": 2}, "a"))]
    },
    "one of quantity, latched, latched_below, hooks_closed, command": {
        "steps": [step("a", ({**when(X, above=0), "latched": 1}, "a"))]
    },
    "both all and any": {
        "steps": [step("a", ({"all": [when(X, above=0)], "any": [when(X, above=0)]}, "a"))]
    },
    "all.* '?all'?": {"steps": [step("a", ({"all": [{"all": [when(X, above=0)]}]}, "a"))]},
    "on_timeout, but no timeout": {"steps": [step("a", on_timeout={"go": "a"})]},
    "timeout .*greater than 0|timeout .*above 0": {"steps": [step("a", timeout=0)]},
    "'two'; no force element has this name": {
        "steps": [step("a", do=[{"element": "two", "engagement": 1}])]
    },
    "which has no law of type drive to switch": {
        "steps": [step("a", do=[{"elements": "o*", "run": "off"}])]
    },
    'lock is "tight": must be one of on, off': {
        "steps": [step("a", do=[{"element": "one", "lock": "tight"}])]
    },
    "'x\\*'; no force element has this name": {
        "steps": [step("a", do=[{"elements": "x*", "lock": "off"}])]
    },
    "stiffness .*(greater than|above) 0": {
        "steps": [step("a", do=[{"element": "one", "lock": "on", "stiffness": 0}])]
    },
    "is no action; an action has one of thrust, latches, grasp, run, engagement": {
        "steps": [step("a", do=[{"element": "one"}])]
    },
    "either element or elements": {"steps": [step("a", do=[{"engagement": 0.5}])]},
    "has the member 'element', which the action 'thrust' does not use": {
        "steps": [step("a", do=[{"thrust": "on", "element": "one"}])]
    },
    "has the member 'stiffness', which the action 'thrust' does not use": {
        "steps": [step("a", do=[{"thrust": "on", "stiffness": 3}])]
    },
    "has the member 'law', which the action 'lock' does not use": {
        "steps": [step("a", do=[{"element": "one", "lock": "on", "law": "brake"}])]
    },
    "stiffness has no effect with 'lock': 'off'": {
        "steps": [step("a", do=[{"element": "one", "lock": "off", "stiffness": 3}])]
    },
    "has the actions thrust and latches; give each one an item of its own": {
        "steps": [step("a", do=[{"latches": "arm", "thrust": "on"}])]
    },
    "command .*dance": {"steps": [step("a", ({"command": "dance"}, "a"))]},
    "outcome .*success": {"steps": [step("a", outcome="success")]},
    r"steps\[2\] \('b'\) cannot be reached from the first step 'a'": {
        "steps": [step("a", timeout=1), step("b", (when(X, above=0), "c")), step("c", timeout=1)]
    },
    "'a'. cannot be reached from the first step 'b'": {
        "start": "b",
        "steps": [step("a", (when(X, above=0), "b")), step("b")],
    },
}


@pytest.mark.parametrize("sentence", MALFORMED)
def test_a_malformed_sequence_is_refused_in_one_sentence(tmp_path, sentence):
    sequence = {"steps": [step("a")], **MALFORMED[sentence]}
    laws = ({"type": "brake", "forward": 5},)
    mechanism = make_slide(40.0, make_element(*laws), sequence=sequence)
    with pytest.raises(UsageError, match=sentence) as raised:
        dl.Docking(write_slide(tmp_path, mechanism))
    assert "\n" not in str(raised.value)
    with pytest.raises(UsageError, match=sentence):
        dl.check(mechanism)
