"""Mass properties of the stack (outputs ``stack.*``), and the rigid joint where it cannot be.

1. Without bodies of a mechanism they are the sum of two rigid bodies by Steiner's theorem.
2. The momenta of a joined stack that turns are those of one rigid body with these properties, and
   joining changes none of them.
3. A stated mass that includes the mechanism is the mass of the chaser's side.
4. A rigid joint with a vehicle that a host moves is an FMI error: no smaller step helps.
"""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import dockloop as dl
from test_fmu import instance

TURNED = {"initial.pitch_yaw_deg": 12.0, "initial.pitch_yaw_direction_deg": 35.0}


def rotation(q):
    """Return the matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = q
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def symmetric(entries):
    """Return the matrix of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def steiner(mass, arm):
    """Return the inertia of a point mass."""
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def read_stack(docking):
    return (docking.get("stack.mass"), docking.get("stack.com"), docking.get("stack.inertia"))


def test_two_bodies_add_up():
    docking = dl.Docking("absorber_1d", TURNED | {"initial.approach_time": 0.5})
    docking.set("chaser.attitude", [0.6, 0.0, 0.8, 0.0])
    docking.set("target.inertia", [4e7, 8e7, 9e7, 1e6, -2e6, 3e6])
    docking.step(0.01)
    to_chaser = rotation(docking.get("chaser.attitude")).T
    turn = to_chaser @ rotation(docking.get("target.attitude"))
    apart = to_chaser @ (docking.get("target.position") - docking.get("chaser.position"))
    masses = [docking.get(f"{v}.mass") for v in ("chaser", "target")]
    own = [symmetric(docking.get(f"{v}.inertia")) for v in ("chaser", "target")]
    mass, com, inertia = read_stack(docking)
    centre = masses[1] * apart / sum(masses)
    expected = own[0] + turn @ own[1] @ turn.T
    expected += steiner(masses[0], centre) + steiner(masses[1], apart - centre)
    assert mass == sum(masses)
    assert com == pytest.approx(centre, abs=1e-12 * np.linalg.norm(apart))
    assert symmetric(inertia) == pytest.approx(expected, abs=1e-12 * np.max(expected))


def test_a_joined_stack_turns_as_one_body_with_these_properties():
    docking = dl.Docking("apda")
    docking.set("chaser.angular_velocity", [0.02, -0.01, 0.015])
    docking.step(1e-6)
    apart = read_stack(docking)
    docking.set("hard_dock.command", "join")
    for _ in range(20):
        docking.step(1.0)
    mass, com, inertia = read_stack(docking)
    for before, after in zip(apart, (mass, com, inertia), strict=True):
        assert after == pytest.approx(before, rel=1e-5, abs=1e-5 * np.max(np.abs(before)))
    turn = rotation(docking.get("chaser.attitude"))
    spin = docking.get("chaser.angular_velocity")
    linear = mass * (docking.get("chaser.velocity") + turn @ np.cross(spin, com))
    place = docking.get("chaser.position") + turn @ com - docking.get("momentum.reference")
    angular = turn @ symmetric(inertia) @ spin + np.cross(place, linear)
    for name, expected in (("linear", linear), ("angular", angular)):
        found = docking.get(f"momentum.{name}")
        scale = np.linalg.norm(found)
        assert found == pytest.approx(expected, abs=1e-9 * scale), name
    assert np.linalg.norm(turn @ symmetric(inertia) @ spin) > 1e3


def test_a_stated_mass_that_includes_the_mechanism_is_that_of_the_stack():
    docking = dl.Docking("apda", {"chaser.mass_includes_mechanism": 2})
    total = docking.get("chaser.mass") + docking.get("target.mass")
    assert docking.get("stack.mass") == pytest.approx(total, rel=1e-14)
    alone = dl.Docking("apda", {"chaser.mass_includes_mechanism": 1})
    assert alone.get("stack.mass") > total + 1.0


def test_a_rigid_joint_with_a_driven_vehicle_is_an_error_with_its_reason(runs):
    fmu = runs.fmu("apda", "chaser.motion=driven")
    with instance(fmu) as (slave, references):
        slave.setInteger([references["hard_dock.command"]], [6])
        with pytest.raises(FMICallException) as error:
            slave.doStep(0.0, 0.01)
        assert error.value.status == 3  # fmi2Error
    docking = dl.Docking("apda", {"chaser.motion": "driven"})
    docking.set("hard_dock.command", "join")
    with pytest.raises(dl.DockloopError, match="a rigid joint needs vehicles that no host moves"):
        docking.step(0.01)
