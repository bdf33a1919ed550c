"""Saved FMU states: kept, restored, turned into bytes, carried elsewhere, damaged.

1. Every communication step made twice, with a restore in between, gives the bits of the
   uninterrupted run in every variable: explicit, linearly implicit and fixed-step integration,
   both friction models, through contact and capture, and with a driven vehicle.
2. A state goes on with the same bits in another instance, even one with other parameters, and, as
   bytes, in another process.
3. Bytes with one flipped bit, cut short, extended, or of another scene or interface are refused
   with a line that says why, and the instance goes on as if nothing had happened.
4. A state saved in any stage of life brings that stage back: instantiated, initialization mode,
   after a discarded step, terminated. One saved before an error brings the instance back.
5. A state object may be used again, freeing nothing is allowed, and what cannot be is refused.
6. The states of a model exchange instance restore as well.
7. Variables and derivatives can be read whatever friction model is chosen; reading changes nothing.
8. A mechanism that has gone over to other independent coordinates restores too.
"""

import ctypes
import os
import random
import sys
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from extreme_cases import mechanism_benchmarks
from extreme_cases.fmi_host import DISCARD, ERROR, OK, STEP, Host, go_on_elsewhere
from extreme_cases.own_mechanism import FIXED_BASE, write_scene
from programs import call

DEFAULT = "idss_25t_350t"
NEAR = "initial.approach_time=0.1"  # contact after 0.1 s, capture before 1 s
BRISTLES = "contact.friction_model=2"
LOOSE = ("solver.rtol=1e-3", "solver.atol_position=1e-5", "solver.atol_velocity=1e-5")
CAPTURED = 3  # phase


class Drive:
    """Imposes motion on the chaser: straight on from where it starts, without turning."""

    def __init__(self, host):
        self.position = host.vector("chaser.position")
        self.velocity = host.vector("chaser.velocity")
        self.attitude = host.vector("chaser.attitude", 4)

    def __call__(self, host):
        """Set the pose at the beginning of the coming step."""
        host.put("chaser.position", self.position + host.time * self.velocity)
        host.put("chaser.velocity", self.velocity)
        host.put("chaser.attitude", self.attitude)
        host.put("chaser.angular_velocity", (0.0, 0.0, 0.0))


def nothing(_host):
    """No inputs."""


VARIANTS = {
    "explicit, regularised friction": ((), 2),
    "explicit, bristle friction": ((BRISTLES,), 2),
    "fixed steps, regularised friction": ((), 7),
    "fixed steps, bristle friction": ((BRISTLES, "solver.step=0.00025"), 7),
    "driven chaser": (("chaser.motion=driven",), 2),
    "steps that end after the communication point": (LOOSE, 12),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_step_made_twice_gives_the_bits_of_the_uninterrupted_run(runs, variant):
    overrides, method = VARIANTS[variant]
    driven = "chaser.motion=driven" in overrides
    fmu = runs.fmu(DEFAULT, NEAR, *overrides)
    with Host(fmu) as plain, Host(fmu) as twice:
        for host in (plain, twice):
            host.choose(solver__method=method)
        drives = [Drive(h) if driven else nothing for h in (plain, twice)]
        plain.start()
        twice.start()
        phases = set()
        for _ in range(130):
            drives[0](plain)
            plain.step()
            saved = twice.save()
            drives[1](twice)
            twice.step()
            twice.everything()
            twice.restore(saved)
            twice.release(saved)
            drives[1](twice)
            twice.step()
            assert twice.everything() == plain.everything(), twice.differences(plain)
            phases.add(plain.phase())
        # The motion goes through contact, and capture where nothing is driven.
        assert 2 in phases
        assert driven or max(phases) >= CAPTURED


def run_on(host, steps, drive=nothing):
    """Everything after each of some steps."""
    seen = []
    for _ in range(steps):
        drive(host)
        host.step()
        seen.append(host.everything())
    return seen


@pytest.fixture
def near(runs):
    """A host of the default scene in the middle of contact."""
    with Host(runs.fmu(DEFAULT, NEAR)) as host:
        host.start()
        run_on(host, 40)
        assert host.phase() == 2
        yield host


def test_a_state_goes_on_in_another_instance_with_other_parameters(runs, near):
    near.put("chaser.force_ext", (100.0, 0.0, -20.0))
    near.slope_status({"target.torque_ext[2]": 30.0})
    saved = near.save()
    with Host(runs.fmu(DEFAULT, NEAR), start_time=7.0) as other:
        other.set(chaser__mass=40e3, friction__coefficient=0.3)
        other.start()
        run_on(other, 3)
        expected = run_on(near, 40)
        other.restore(saved)
        for i, seen in enumerate(run_on(other, 40)):
            assert seen == expected[i], f"step {i}"
    near.release(saved)


@pytest.mark.parametrize("friction", [1, 2])
def test_bytes_go_on_with_the_same_bits_in_another_process(runs, tmp_path, friction):
    fmu = runs.fmu(DEFAULT, NEAR, f"contact.friction_model={friction}")
    with Host(fmu) as host:
        host.start()
        run_on(host, 40)
        data, time = host.save_bytes(), host.time
        expected = run_on(host, 90)
        assert host.phase() >= CAPTURED
    # Into an instance that has not started, and into one that has.
    seen = go_on_elsewhere(fmu, data, time, 90, tmp_path, starts=friction == 2)
    assert [i for i in range(60) if seen[i] != expected[i]] == []


def refused_bytes(host, data):
    """Status and log line of reading bytes; nothing may come of it."""
    saved = ctypes.c_void_p()
    host.lines.clear()
    status = host.status(
        "fmi2DeSerializeFMUstate",
        ctypes.create_string_buffer(bytes(data), len(data)),
        ctypes.c_size_t(len(data)),
        ctypes.byref(saved),
    )
    if saved:
        host.release(saved)
    return status, host.lines[-1][2] if host.lines else ""


def flipped(data, bit):
    """The same bytes but for one bit."""
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << (bit % 8)
    return damaged


def test_bytes_with_one_flipped_bit_are_refused_and_the_instance_goes_on(runs, near):
    with Host(runs.fmu(DEFAULT, NEAR)) as undisturbed:
        undisturbed.start()
        run_on(undisturbed, 40)
        data = near.save_bytes()
        header = 8 * 80
        bits = random.Random(1).sample(range(header, 8 * len(data)), 200)
        bits += range(0, header, 5)
        accepted = [b for b in bits if refused_bytes(near, flipped(data, b))[0] != ERROR]
        assert run_on(near, 5) == run_on(undisturbed, 5)
    assert accepted == [], f"in bytes {sorted({b // 8 for b in accepted})}"


def test_the_line_about_damaged_bytes_is_printable_text(near):
    data = near.save_bytes()
    lines = [refused_bytes(near, flipped(data, bit))[1] for bit in range(8 * 80)]
    assert [line for line in lines if line and not line.isprintable()] == []


def test_bytes_that_are_short_long_or_of_something_else_are_refused_with_the_reason(runs, near):
    data = near.save_bytes()
    for size in (0, 1, 79, 80, 81, len(data) // 2, len(data) - 1):
        status, line = refused_bytes(near, data[:size])
        assert status == ERROR, size
        assert "too short" in line or "damaged" in line, line
    status, line = refused_bytes(near, data + b"\0")
    assert (status, "length" in line) == (ERROR, True), line
    with Host(runs.fmu("idss_100t_100t")) as other:
        status, line = refused_bytes(other, data)
        assert status == ERROR
        assert other.description.guid in line
        assert near.description.guid in line
    status, line = refused_bytes(near, b"something else" * 100)
    assert (status, "not a saved state" in line) == (ERROR, True), line


def test_a_state_of_another_scene_or_interface_is_refused_and_nothing_changes(runs, near):
    saved = near.save()
    with Host(runs.fmu("idss_100t_100t")) as other, Host(runs.fmu("idss_100t_100t")) as alone:
        other.start()
        alone.start()
        assert other.status("fmi2SetFMUstate", saved) == ERROR
        assert near.description.guid in other.last_line
        assert run_on(other, 5) == run_on(alone, 5)
    with Host(runs.fmu(DEFAULT, NEAR), exchange=True) as other:
        other.start_exchange()
        before = other.everything()
        assert other.status("fmi2SetFMUstate", saved) == ERROR
        assert "FMI kind" in other.last_line
        assert other.everything() == before
    near.release(saved)


# ---------------------------------------------------------------- stages of life


def test_a_state_saved_before_the_initialisation_brings_that_stage_back(runs):
    with Host(runs.fmu(DEFAULT, NEAR), initialisation=False) as host:
        host.set(chaser__mass=30e3)
        saved = host.save()

        def run():
            host.time = 0.0
            host.slave.enterInitializationMode()
            host.start()
            return run_on(host, 20)

        expected = run()
        host.restore(saved)
        assert host.value("chaser.mass") == 30e3
        host.set(chaser__mass=20e3)
        assert run() != expected
        host.restore(saved)
        assert run() == expected
        host.release(saved)


def test_a_state_saved_in_initialization_mode_brings_that_mode_back(runs):
    with Host(runs.fmu(DEFAULT, NEAR)) as host:
        host.set(chaser__mass=30e3)
        host.value("relative.axial")  # computes the start state
        saved = host.save()
        data = host.save_bytes()
        host.start()
        expected = run_on(host, 20)
        for restore in (lambda: host.restore(saved), lambda: host.restore_bytes(data, 0.0)):
            restore()
            assert host.status("fmi2DoStep", 0.0, STEP, 1) == ERROR
            host.start()
            assert run_on(host, 20) == expected
        host.release(saved)


def test_a_state_saved_after_a_discarded_step_brings_that_back(runs):
    with Host(runs.fmu(DEFAULT, NEAR, "chaser.motion=driven")) as host:
        drive = Drive(host)
        host.start()
        run_on(host, 20, drive)
        host.put("chaser.attitude", (0.5, 0.0, 0.0, 0.0))
        assert host.step_status() == DISCARD
        saved = host.save()
        status = ctypes.c_int(-1)
        expected = run_on(host, 20, drive)
        host.status("fmi2GetStatus", 0, ctypes.byref(status))
        assert status.value == OK
        host.restore(saved)
        host.status("fmi2GetStatus", 0, ctypes.byref(status))
        assert status.value == DISCARD
        assert run_on(host, 20, drive) == expected
        host.release(saved)


def test_a_state_saved_after_the_end_brings_that_back(near):
    before = near.everything()
    near.slave.terminate()
    saved = near.save()
    near.slave.reset()
    near.restore(saved)
    near.release(saved)
    assert near.everything() == before
    assert near.step_status() == ERROR
    assert "terminated" in near.last_line


def test_a_state_saved_before_a_failed_step_brings_the_instance_back(near):
    saved = near.save()
    expected = run_on(near, 5)
    near.restore(saved)
    near.put("chaser.force_ext", (1e12, 0.0, 0.0))
    assert near.step_status() == DISCARD
    near.restore(saved)
    assert run_on(near, 5) == expected
    near.release(saved)


def test_a_state_is_restored_after_a_reset(near):
    saved = near.save()
    expected = run_on(near, 20)
    near.slave.reset()
    near.restore(saved)
    assert run_on(near, 20) == expected
    near.release(saved)


# ---------------------------------------------------------------- objects and arguments


def test_a_state_object_may_be_used_again(near):
    saved = near.save()
    address = saved.value

    def check():
        assert saved.value == address
        saved.time = near.time
        before = near.everything()
        expected = run_on(near, 5)
        near.restore(saved)
        assert near.everything() == before
        assert run_on(near, 5) == expected

    run_on(near, 5)
    assert near.status("fmi2GetFMUstate", ctypes.byref(saved)) == OK
    check()
    near.slave.deSerializeFMUstate(near.save_bytes(), saved)
    check()
    near.release(saved)
    assert not saved.value


def test_freeing_nothing_is_allowed_and_a_missing_state_is_refused(near):
    nothing_saved = ctypes.c_void_p()
    assert near.status("fmi2FreeFMUstate", ctypes.byref(nothing_saved)) == OK
    assert near.status("fmi2FreeFMUstate", None) == OK
    size = ctypes.c_size_t()
    assert near.status("fmi2SetFMUstate", None) == ERROR
    assert "null" in near.last_line
    assert near.status("fmi2GetFMUstate", None) == ERROR
    assert near.status("fmi2SerializedFMUstateSize", None, ctypes.byref(size)) == ERROR


def test_a_buffer_that_is_too_small_is_refused_and_left_alone(near):
    saved = near.save()
    size = ctypes.c_size_t()
    assert near.status("fmi2SerializedFMUstateSize", saved, ctypes.byref(size)) == OK
    buffer = ctypes.create_string_buffer(b"x" * size.value, size.value)
    for short in (0, 1, size.value - 1):
        room = ctypes.c_size_t(short)
        assert near.status("fmi2SerializeFMUstate", saved, buffer, room) == ERROR
        assert str(size.value) in near.last_line
        assert str(short) in near.last_line
    assert buffer.raw == b"x" * size.value
    assert near.status("fmi2SerializeFMUstate", saved, buffer, size) == OK
    assert buffer.raw == near.save_bytes()
    near.release(saved)


def test_the_same_state_gives_the_same_bytes(near):
    data = near.save_bytes()
    run_on(near, 3)
    near.restore_bytes(data, 0.0)
    assert near.save_bytes() == data


# ---------------------------------------------------------------- model exchange


@pytest.mark.parametrize("friction", [1, 2])
def test_states_of_a_model_exchange_instance_restore(runs, friction):
    fmu = runs.fmu(DEFAULT, NEAR, f"contact.friction_model={friction}")
    stop, size = (0.3, 2e-3) if friction == 1 else (0.14, 0.25e-3)  # s; bristles relax in 1 ms
    with Host(fmu, exchange=True) as host, Host(fmu, exchange=True) as other:
        info = host.integrate(stop, size, host.start_exchange())
        assert host.phase() == 2
        saved, data = host.save(), host.save_bytes()

        def go_on(at):
            at.integrate(stop + 0.02, size, info)
            return at.everything(), at.rates().tobytes(), at.indicators().tobytes()

        expected = go_on(host)
        host.restore(saved)
        assert go_on(host) == expected
        other.start_exchange()
        for restore in (
            lambda: other.restore(saved),
            lambda: other.restore_bytes(data, saved.time),
        ):
            restore()
            assert go_on(other) == expected
        host.release(saved)


# ---------------------------------------------------------------- other coordinates


@pytest.fixture(scope="module")
def slider_crank(runs, tmp_path_factory):
    """An FMU that goes over from the slider to the crank near its first dead centre, at 0.1 s."""
    scene = write_scene(
        tmp_path_factory.mktemp("saved"),
        mechanism_benchmarks.slider_crank("slider"),
        FIXED_BASE,
        "[initial.joints.slider]\nrate = -1.0",
        '[outputs]\ngroups = ["ring", "states", "loops", "energy", "solver"]',
    )
    return runs.fmu(scene)


def test_every_step_made_twice_gives_the_same_bits_through_a_change_of_coordinates(slider_crank):
    with Host(slider_crank) as plain, Host(slider_crank) as twice:
        plain.start()
        twice.start()
        for _ in range(40):
            saved = twice.save()
            run_on(twice, 1)
            twice.restore(saved)
            twice.release(saved)
            assert run_on(twice, 1) == run_on(plain, 1), plain.time


def test_a_state_with_other_coordinates_goes_on_in_another_instance(slider_crank):
    with Host(slider_crank) as host, Host(slider_crank) as other:
        host.start()
        run_on(host, 20)
        data, time = host.save_bytes(), host.time
        expected = run_on(host, 20)
        other.restore_bytes(data, time)
        seen = run_on(other, 20)
        assert [i for i in range(20) if seen[i] != expected[i]] == []


def test_a_change_of_coordinates_in_model_exchange_is_reported_and_restores(slider_crank):
    with Host(slider_crank, exchange=True) as host:
        reported = []
        info = host.start_exchange()
        info = host.integrate(0.095, 1e-3, info)
        saved = host.save()
        before = host.vector("ring.position"), host.value("energy.kinetic")

        def run():
            host.integrate(0.12, 0.1e-3, info, lambda at: reported.append(at.information[2]))
            return host.everything()

        expected = run()
        assert reported == [True], reported  # the nominal values of the states have changed
        host.restore(saved)
        assert np.array_equal(before[0], host.vector("ring.position"))
        assert run() == expected
        assert abs(host.value("energy.residual")) < 1e-6
        host.release(saved)


# ---------------------------------------------------------------- reading

OTHER_FRICTION = """
import sys
sys.path.insert(0, sys.argv[1])
from extreme_cases.fmi_host import Host
fmu, chosen, use = sys.argv[2:]
axial, force = ["relative.axial"], ["chaser.force_ext[1]"]
with Host(fmu) as host:
    if use == "derivatives after a reset":
        host.start()
        host.step()
        host.directional_derivative(axial, force, [1.0])
        host.slave.reset()
        host.slave.setupExperiment(startTime=0.0)
        host.slave.enterInitializationMode()
        host.time = 0.0
    host.choose(friction__model=int(chosen))
    host.start()
    for _ in range(5):
        host.step()
        saved = host.save()
        if use == "all variables":
            host.everything()
        elif use == "output derivatives":
            assert host.output_derivatives(axial)[0] == 0
        else:
            assert host.directional_derivative(axial, force, [1.0])[0] == 0
        host.restore(saved)
        host.release(saved)
"""


@pytest.mark.parametrize(("of_scene", "chosen"), [(1, 2), (2, 1)])
@pytest.mark.parametrize(
    "use",
    ["all variables", "output derivatives", "derivatives", "derivatives after a reset"],
)
def test_everything_can_be_read_with_another_friction_model_than_that_of_the_scene(
    runs, of_scene, chosen, use
):
    # In a process of its own: writing beyond the end of an array ends it.
    fmu = runs.fmu(DEFAULT, NEAR, f"contact.friction_model={of_scene}")
    words = (OTHER_FRICTION, Path(__file__).parent, fmu, chosen, use)
    perturbed = os.environ | {"MALLOC_PERTURB_": "165"}
    call(sys.executable, "-c", *words, env=perturbed, timeout=20)


def test_reading_variables_changes_none_of_them(near):
    first = near.everything()
    assert near.everything() == first
    near.put("chaser.force_ext", (0.0, 0.0, 0.0))  # the values that they have
    assert near.everything() == first


@pytest.mark.parametrize("length", [1e-10, 1e-16])
@pytest.mark.parametrize("motion", ["free", "driven"])
def test_a_step_without_length_keeps_mean_loads_and_can_be_saved(length, motion):
    """The rounding of momenta, divided by its length, is no load."""
    docking = dl.Docking(DEFAULT, {"initial.approach_time": 0.1, "target.motion": motion})
    for _ in range(20):
        docking.step(0.01)
    before = docking.get("target.force_mean")
    assert np.abs(before).max() > 1.0
    docking.step(length)
    after = docking.get("target.force_mean")
    assert np.abs(after).max() <= np.abs(before).max()
    saved = docking.save()
    docking.step(0.01)
    next_load = docking.get("target.force_mean")
    assert np.abs(next_load).max() < 10.0 * np.abs(before).max()
    docking.restore(saved)
    docking.step(0.01)
    assert (docking.get("target.force_mean") == next_load).all()
