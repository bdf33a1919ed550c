"""What a host may do between communication points, and what it may rely on.

1. Setting the inputs of the next step does not change the mean loads of the step just made.
2. A driven vehicle that is put into contact begins the contact there and then.
3. A step that is refused leaves the FMU as it was: the corrected step succeeds.
4. Vehicles at rest audit as at rest.
5. A host that begins with zeros in every input, before it passes anything on, is understood: the
   first step begins at the start values. The same in initialization mode. Later, or with a
   position, zeros are no attitude.
"""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from extreme_cases.fmi_host import Host


@pytest.fixture
def host(runs, request):
    """A host of the default scene with overrides."""
    made = Host(runs.fmu("idss_25t_350t", *request.param))
    yield made
    made.slave.terminate()
    made.slave.freeInstance()


@pytest.mark.parametrize("host", [("initial.approach_time=0.0",)], indirect=True)
def test_setting_the_next_inputs_does_not_change_the_mean_loads_of_the_last_step(host):
    host.start()
    for _ in range(20):
        host.step()
    before = np.concatenate([host.vector("chaser.force_mean"), host.vector("chaser.torque_mean")])
    host.put("chaser.force_ext", (1000.0, 0.0, 0.0))
    host.put("chaser.torque_ext", (0.0, 100.0, 0.0))
    after = np.concatenate([host.vector("chaser.force_mean"), host.vector("chaser.torque_mean")])
    assert np.array_equal(before, after)
    assert np.linalg.norm(before) > 0.0


@pytest.mark.parametrize("host", [("target.motion=driven",)], indirect=True)
def test_a_driven_vehicle_put_into_contact_begins_it_there(host):
    host.start()
    host.step()
    assert host.phase() == 1
    # The host moves the target to where the surfaces overlap by a millimetre.
    position = host.get("target.position[1]", "target.position[2]", "target.position[3]")
    shift = host.get("gap")[0] + 1e-3
    while host.get("gap")[0] > 0.0 and shift < 0.5:
        host.put("target.position", position - np.array([shift, 0.0, 0.0]))
        host.step()
        shift += 0.01
    assert host.phase() == 2
    assert 0.0 < host.get("time_of_contact")[0] <= host.time


@pytest.mark.parametrize("host", [("target.motion=driven",)], indirect=True)
def test_a_refused_step_leaves_everything_as_it_was(host):
    host.start()
    for _ in range(5):
        host.step()
    names = ("relative.axial", "chaser.velocity[1]", "energy.kinetic", "chaser.force_mean[1]")
    before = host.get(*names)
    host.put("target.attitude", (0.5, 0.0, 0.0, 0.0))
    with pytest.raises(FMICallException):
        host.step()
    assert np.array_equal(before, host.get(*names))
    host.put("target.attitude", (1.0, 0.0, 0.0, 0.0))
    host.step()
    assert host.get("relative.axial")[0] != before[0]


@pytest.mark.parametrize(
    "host", [("initial.at=start", "chaser.position=[-20, 0, 0]")], indirect=True
)
def test_vehicles_at_rest_audit_as_at_rest(host):
    host.start()
    for _ in range(10):
        host.step()
    assert host.get("momentum.residual")[0] < 1e-6
    assert abs(host.get("energy.residual")[0]) < 1e-12


MOTION = {"position": 3, "velocity": 3, "attitude": 4, "angular_velocity": 3}


def put_zeros(host, but=()):
    """Set every input of the target's motion to 0, but those named."""
    for name, count in MOTION.items():
        if name not in but:
            host.put(f"target.{name}", [0.0] * count)


@pytest.mark.parametrize(
    "host", [("target.motion=driven", "target.position=[9, 8, 7]")], indirect=True
)
def test_a_host_may_begin_with_zeros_in_every_input(host):
    before = host.vector("relative.position")
    host.start()
    put_zeros(host)
    host.step()
    # The vehicles approach each other at 0.1 m/s from where they were.
    assert 0.0 < np.linalg.norm(host.vector("relative.position") - before) < 2e-3
    with pytest.raises(FMICallException):
        host.step()


@pytest.mark.parametrize(
    "host", [("target.motion=driven", "target.position=[9, 8, 7]")], indirect=True
)
def test_a_host_may_initialise_with_zeros_in_every_input(host):
    motion = {name: host.vector(f"target.{name}", count) for name, count in MOTION.items()}
    expected = host.vector("relative.position")
    put_zeros(host)
    host.start()
    assert np.array_equal(host.vector("relative.position"), expected)
    for name, values in motion.items():
        host.put(f"target.{name}", values)
    host.step()
    assert 0.0 < np.linalg.norm(host.vector("relative.position") - expected) < 2e-3


@pytest.mark.parametrize(
    "host", [("target.motion=driven", "target.position=[9, 8, 7]")], indirect=True
)
def test_zeros_are_no_attitude_where_a_position_is_reported(host):
    host.start()
    put_zeros(host, but=["position"])
    with pytest.raises(FMICallException):
        host.step()
