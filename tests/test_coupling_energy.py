"""A coupling that creates energy is named, then refused, before its loads leave physics.

The host has a vehicle of two bodies: 300 kg with the docking interface, behind a spring the rest of
25 t. The FMU takes it for one rigid body. With short steps that is right; they are the oracle. With
long steps the oscillation of the small body grows.
"""

from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from coupling_host import cross, turn
from dockloop.native.core import name_choice

MASS, INERTIA = 25e3, np.array([60.5e3, 132e3, 132e3])
PART, FREQUENCY, DAMPING = 300.0, 2.0 * np.pi * 8.0, 0.02
MOTION = ("position", "velocity", "attitude", "angular_velocity")
SHOWN = ("target.velocity", "chaser.force_mean", "coupling.work_residual", "capture.compression")
STOP = 4.0
UNSTABLE = 0.03  # s
TOO_LONG = 0.05  # s, two fifths of a period


def dock(step, seen=None, scene="probe_drogue"):
    """Couple until STOP; returns the docking, and the refusal if there is one.

    `seen` receives time, peak and diagnosis of each step.
    """
    docking = dl.Docking(
        scene,
        {"chaser.motion": "driven", "initial.approach_time": 0.5, "coupling.mode": "parallel"},
    )
    docking.set("coupling.expected_step", step)
    p, v, q, w = (np.array(docking.get(f"chaser.{name}")) for name in MOTION)
    rest = MASS - PART
    stiffness = FREQUENCY**2 * PART * rest / MASS
    damping = 2.0 * DAMPING * stiffness / FREQUENCY
    u = du = 0.0  # the rest relative to the part, along x of the body
    while docking.time < STOP - step / 2:
        force, torque = (np.array(docking.get(f"chaser.{n}_mean")) for n in ("force", "torque"))
        for name, value in zip(MOTION, (p, v, q, w), strict=True):
            docking.set(f"chaser.{name}", value)
        before = np.hstack([docking.get(name) for name in SHOWN])
        try:
            docking.step(step)
        except dl.DockloopError as error:
            after = np.hstack([docking.get(name) for name in SHOWN])
            assert np.array_equal(after, before)  # the state stays
            return docking, str(error)
        if seen is not None:
            shown = ("capture.peak.compression", "coupling.diagnosis")
            seen.append((docking.time, *map(docking.get, shown)))
        count = round(step / 1e-3)
        h = step / count
        for _ in range(count):
            pull = stiffness * u + damping * du
            body = turn(q * [1, -1, -1, -1], force)
            a = body / MASS
            a[0] = (body[0] + pull) / PART
            du += h * (-pull / rest - a[0])
            u += h * du
            v = v + h * turn(q, a)
            p = p + h * v
            w = w + h * (torque - cross(w, INERTIA * w)) / INERTIA
            q = q + h / 2 * np.array([-q[1:] @ w, *(q[0] * w + cross(q[1:], w))])
            q /= np.linalg.norm(q)
    return docking, ""


def test_an_unstable_coupling_is_refused_with_its_cause_and_a_step_that_is_stable():
    docking, refusal = dock(UNSTABLE)
    assert "coupling.work_residual" in refusal
    assert "a flexible part" in refusal
    named = [text for text in docking.warnings if "creates energy" in text]
    assert len(named) == 1, docking.warnings
    assert "a flexible part" in named[0]
    assert not any("gravity" in text for text in docking.warnings), docking.warnings
    advice = float(refusal.split("a step of ")[1].split(" s")[0])
    right, refused = dock(0.003)
    assert not refused
    assert not any("creates energy" in text for text in right.warnings)
    peak = right.get("capture.peak.compression")
    assert docking.get("capture.peak.compression") < 10.0 * peak
    obeyed, refused = dock(round(advice, 3))
    assert 0.001 < advice < UNSTABLE
    assert not refused
    assert obeyed.get("capture.peak.compression") == pytest.approx(peak, rel=0.1)


def test_steps_that_do_not_resolve_a_part_are_refused_where_the_interface_feels_it():
    seen = []
    docking, refusal = dock(TOO_LONG, seen)
    assert "a flexible part, which swings at 8 Hz" in refusal
    assert "a step of 0.05 s does not resolve it" in refusal
    right, refused = dock(0.003)
    assert not refused
    peak = right.get("capture.peak.compression")
    assert docking.get("capture.peak.compression") < 1.1 * peak


@pytest.mark.parametrize(
    ("scene", "step"), [("probe_drogue", 0.01), ("probe_drogue", 0.1), ("idss_25t_350t", 0.1)]
)
def test_a_flexible_part_is_named_before_loads_are_wrong(scene, step):
    """The mode has 8 Hz. In steps of 0.1 s, four fifths of its period, reports look like 2 Hz."""
    seen, right = [], []
    docking, _ = dock(step, seen, scene)
    dock(0.003, right, scene)
    assert name_choice("coupling.diagnosis", docking.get("coupling.diagnosis")) == "flexible part"
    named = [text for text in docking.warnings if "has a flexible part" in text]
    assert len(named) == 1, docking.warnings
    assert "[chaser.adapter]" in named[0]
    assert docking.get("coupling.diagnosis_value") == pytest.approx(8.0, rel=0.01)
    time, peak, _ = next(row for row in seen if row[2] != 1)
    so_far = max(row[1] for row in right if row[0] < time + 1e-9)
    assert peak == pytest.approx(so_far, rel=0.1)


@pytest.mark.parametrize("step", [0.05, 0.1])
def test_a_part_that_swings_whole_periods_in_a_step_is_named_and_refused(monkeypatch, step):
    """20 Hz: velocities are right within 0.1 %, but positions show how far the part gives way."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "studies"))
    import host_vehicles as hv

    docking = hv.make_docking("driven", {"coupling.mode": "parallel"}, scene="apda")
    docking.set("coupling.expected_step", step)
    names = [f"chaser.{name}" for name in MOTION]
    host = hv.Sprung([docking.get(name) for name in names], hv.PART, 20.0)

    def couple():
        for _ in range(round(4.0 / step)):
            loads = [docking.get(f"chaser.{load}_mean") for load in ("force", "torque")]
            for name, value in zip(names, host.motion(), strict=True):
                docking.set(name, value)
            docking.step(step)
            host.advance(*loads, step)

    with pytest.raises(dl.DockloopError, match=f"a step of {step} s does not resolve it"):
        couple()
    assert name_choice("coupling.diagnosis", docking.get("coupling.diagnosis")) == "flexible part"
    assert 20.0 / docking.get("coupling.diagnosis_value") == pytest.approx(20.0 * step, rel=0.01)
