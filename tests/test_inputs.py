"""What a host sets between steps has the effect that it should have, and no other.

1. A force, a gravity and a leg command that are reported with their slopes act as the ramps that
   they are: the impulse is the exact integral, and the motion is that of the same ramp held in
   pieces of
   0.1 ms. A slope lasts one step; its input goes on from the value that it has reached.
2. Slopes of higher order, of other variables, or not finite are refused.
3. Tunable parameters act from the next step on. Out of range, in the wrong state, or together with
   one that is impossible they are refused, and nothing changes.
4. The start time does not matter: relative motion has the same bits for -5, 0 and 1e9 s.
5. Communication steps of any sizes lead to the same motion.
6. Only the log categories that are asked for are reported.
7. A tolerance of the host makes the integration finer.
8. After fmi2Reset a run has the same bits, also if states were saved before.
9. Integration in fixed steps (solver.method 7) costs the same in every communication step and
   comes closer to the motion with smaller steps; steps that cannot be made are refused.
10. After a discarded step the last successful time is that of the last step, and a corrected or
    smaller step succeeds.
"""

import ctypes
import math
import random

import numpy as np
import pytest

from extreme_cases.fmi_host import DISCARD, ERROR, OK, Host

DEFAULT = "idss_25t_350t"
NEAR = "initial.approach_time=0.1"
AWAY = "initial.approach_time=5.0"  # nothing touches during the test
EXACT = 1.0 / 128  # s, a step that binary numbers hold


def started(host):
    """The host in its first step."""
    host.start()
    return host


# ---------------------------------------------------------------- slopes

RAMP = {"chaser.force_ext[1]": (10.0, 400.0), "chaser.force_ext[2]": (-20.0, 300.0)}  # N, N/s


def run_ramps(host, ramps, step, steps, reported):
    """Steps with inputs (value at the start, slope), reported with slopes or held at midpoints."""
    t0 = host.time
    for i in range(steps):
        time = t0 + i * step
        if reported:
            if i == 0:
                host.slave.setReal(host.references(ramps), [value for value, _ in ramps.values()])
            host.slope_status({name: slope for name, (_, slope) in ramps.items()})
        else:
            middle = time - t0 + step / 2
            values = [value + middle * slope for value, slope in ramps.values()]
            host.slave.setReal(host.references(ramps), values)
        host.slave.doStep(time, step)
    host.time = t0 + steps * step


@pytest.mark.parametrize("method", [2, 7])
def test_the_impulse_of_a_force_that_is_reported_by_slopes_is_the_integral_of_the_ramp(
    runs, method
):
    with Host(runs.fmu(DEFAULT, AWAY)) as host:
        host.choose(solver__method=method)
        host.start()
        before = host.vector("momentum.linear")
        run_ramps(host, RAMP, 0.1, 10, reported=True)
        impulse = host.vector("momentum.linear") - before
        exact = [value + slope / 2 for value, slope in RAMP.values()]  # N s, over 1 s
        # Held over steps of 0.1 s the ramps would miss 20 and 15 N s.
        error = np.abs(impulse - [*exact, 0.0]).max()
        assert error < 1e-9, error  # measured 5e-11 N s; the momentum is 2.5e3 N s
        assert host.value("momentum.residual") < 1e-13
        assert abs(host.value("energy.residual")) < 1e-6


@pytest.mark.parametrize("gravity", [False, True])
def test_a_ramp_reported_by_slopes_moves_as_one_held_in_pieces_of_a_tenth_of_a_millisecond(
    runs, gravity
):
    ramps = {"gravity[1]": (1.0, 7.0), "gravity[3]": (0.0, -9.0)} if gravity else RAMP
    fmu = runs.fmu(DEFAULT, AWAY)
    with (
        started(Host(fmu, tolerance=1e-10)) as reported,
        started(Host(fmu, tolerance=1e-10)) as held,
    ):
        start = reported.vector("chaser.position")
        velocity = reported.vector("chaser.velocity")
        run_ramps(reported, ramps, 0.1, 3, reported=True)
        run_ramps(held, ramps, 1e-4, 3000, reported=False)
        for name in ("chaser.position", "chaser.velocity", "relative.position"):
            error = np.abs(reported.vector(name) - held.vector(name)).max()
            # measured 3e-11 m; pieces of gravity are wrong by slope h^2 t/12 = 2.3e-9 m themselves
            assert error < (1e-8 if gravity else 1e-9), (name, error)
        if gravity:
            # Everything falls together: nothing but the free motion and the fall.
            t = 0.3
            fall = np.array([t**2 / 2 + 7.0 * t**3 / 6, 0.0, -9.0 * t**3 / 6])
            error = np.abs(reported.vector("chaser.position") - start - t * velocity - fall).max()
            assert error < 3e-9, error  # measured 2.7e-10 m


def test_a_leg_command_reported_by_slopes_moves_as_one_held_in_small_pieces(runs):
    ramps = {
        f"leg[{i + 1}].force_command": (0.0, 200.0 + 100.0 * (-1) ** i) for i in range(6)
    }  # N, N/s
    fmu = runs.fmu("hexapod_bench")
    with started(Host(fmu)) as reported, started(Host(fmu)) as held, started(Host(fmu)) as without:
        run_ramps(reported, ramps, 0.1, 3, reported=True)
        run_ramps(held, ramps, 1e-4, 3000, reported=False)
        run_ramps(without, {}, 0.1, 3, reported=False)
        error = np.abs(reported.vector("ring.position") - held.vector("ring.position")).max()
        effect = np.abs(reported.vector("ring.position") - without.vector("ring.position")).max()
        assert effect > 1e-3, effect
        assert error < 1e-9, (error, effect)


def test_a_slope_lasts_one_step_and_its_input_goes_on_from_the_value_it_has_reached(runs):
    with started(Host(runs.fmu(DEFAULT, AWAY))) as host:
        host.put("chaser.force_ext", (10.0, 0.0, 0.0))
        assert host.slope_status({"chaser.force_ext[1]": 400.0}) == OK
        start = host.vector("momentum.linear")[0]
        host.step(0.1)
        assert host.value("chaser.force_ext[1]") == 50.0
        middle = host.vector("momentum.linear")[0]
        host.step(0.1)
        assert host.value("chaser.force_ext[1]") == 50.0
        end = host.vector("momentum.linear")[0]
        assert math.isclose(middle - start, 3.0, abs_tol=1e-9), middle - start
        assert math.isclose(end - middle, 5.0, abs_tol=1e-9), end - middle


def test_a_slope_that_is_set_changes_nothing_at_the_communication_point(runs):
    """Steps run ahead of it: the slope begins at the point, not where those steps began."""
    with started(Host(runs.fmu(DEFAULT, AWAY))) as host:
        host.put("chaser.force_ext", (1.0, 0.0, 0.0))
        for _ in range(20):
            host.step(0.05)
        names = [f"chaser.{name}[{i}]" for name in ("velocity", "force") for i in (1, 2, 3)]
        before = [*host.output_derivatives(names[:3])[1], *map(host.value, names)]
        assert host.slope_status({"chaser.force_ext[1]": 100.0}) == OK
        host.put("chaser.force_ext", (1.0, 0.0, 0.0))
        after = [*host.output_derivatives(names[:3])[1], *map(host.value, names)]
        assert after == before


def test_the_mean_load_leaves_out_the_whole_ramp(runs):
    # The mean load is of the docking system only: away from contact, the ramp must not show in it.
    with started(Host(runs.fmu("absorber_1d", "initial.approach_time=5.0"))) as host:
        host.put("chaser.force_ext", (10.0, 0.0, 0.0))
        host.slope_status({"chaser.force_ext[1]": 400.0, "gravity[2]": 3.0})
        host.step(0.1)
        load = np.abs(host.vector("chaser.force_mean")).max()
        assert load < 1e-7, load  # measured 1e-9 N next to 30 N and 3750 N


@pytest.mark.parametrize("accuracy", [0.0, 1e-3])  # 1e-3: points inside linearly implicit steps
def test_mean_loads_are_the_changes_of_momentum_that_a_host_reads(runs, accuracy):
    fmu = runs.fmu(DEFAULT, NEAR, f"solver.accuracy={accuracy}")
    with started(Host(fmu)) as host, started(Host(fmu)) as seldom:
        mass, largest = host.value("target.mass"), 0.0
        for point in range(150):
            before = mass * host.vector("target.velocity")
            host.step(0.01)
            seldom.step(0.01)
            load = host.vector("target.force_mean")
            change = (mass * host.vector("target.velocity") - before) / 0.01
            np.testing.assert_allclose(load, change, atol=1e-4)
            largest = max(largest, np.abs(load).max())
            if point % 3 == 0:  # the point before was not read
                assert np.array_equal(seldom.vector("target.force_mean"), load)
        assert largest > 100.0


def test_inputs_that_are_set_back_leave_no_trace_in_outputs(runs):
    with started(Host(runs.fmu(DEFAULT, NEAR, "solver.accuracy=1e-3"))) as host:
        for _ in range(60):  # most points lie inside an inner step
            host.step(0.01)
            before = host.everything()
            host.put("chaser.force_ext", (500.0, 0.0, 0.0))
            assert host.everything() != before
            host.put("chaser.force_ext", (0.0, 0.0, 0.0))
            assert host.everything() == before


def test_slopes_that_cannot_be_used_are_refused_and_nothing_changes(runs):
    fmu = runs.fmu(DEFAULT, AWAY)
    with started(Host(fmu)) as host, started(Host(fmu)) as alone:
        for slopes, order, why in (
            ({"chaser.force_ext[1]": 1.0}, 2, "order 2"),
            ({"chaser.force_ext[1]": 1.0}, 0, "order 0"),
            ({"chaser.force_ext[1]": math.nan}, 1, "not a finite number"),
            ({"chaser.force_ext[1]": 9.0, "chaser.mass": 1.0}, 1, "not an input"),
            ({"chaser.force_ext[1]": 9.0, "relative.axial": 1.0}, 1, "not an input"),
        ):
            assert host.slope_status(slopes, order) == ERROR
            assert why in host.last_line
        host.step()
        alone.step()
        assert host.everything() == alone.everything()


# ---------------------------------------------------------------- tunable parameters


@pytest.fixture
def contact(runs):
    """Two hosts of the default scene in the middle of contact: one to try, one to compare."""
    fmu = runs.fmu(DEFAULT, NEAR)
    with started(Host(fmu)) as host, started(Host(fmu)) as alone:
        for each in (host, alone):
            for _ in range(40):
                each.step()
        assert host.phase() == 2
        yield host, alone


def growth(host, name):
    """Growth of a variable over one step."""
    before = host.value(name)
    host.step()
    return host.value(name) - before


def test_friction_and_damping_that_are_switched_off_dissipate_no_more(contact):
    host, alone = contact
    host.set(friction__coefficient=0.0)
    assert growth(alone, "energy.dissipated_friction") > 1e-6
    assert abs(growth(host, "energy.dissipated_friction")) < 1e-15
    host.slave.setReal(host.references(["restitution", "restitution_speed"]), [1.0, 0.1])
    assert growth(alone, "energy.dissipated_contact") != 0.0
    assert abs(growth(host, "energy.dissipated_contact")) < 1e-15


def test_restitution_at_a_lower_speed_means_more_damping(contact):
    host, alone = contact
    for each, speed in ((host, 0.01), (alone, 1.0)):
        each.slave.setReal(each.references(["restitution", "restitution_speed"]), [0.5, speed])
    more, less = (growth(h, "energy.dissipated_contact") for h in (host, alone))
    assert more > 10.0 * less > 0.0, (more, less)


def test_thrust_that_is_switched_on_in_contact_acts_in_the_next_step(contact):
    host, _ = contact
    before = host.vector("momentum.linear")
    host.set(chaser__contact_thrust=500.0)
    host.step()
    impulse = np.linalg.norm(host.vector("momentum.linear") - before)
    assert math.isclose(impulse, 5.0, rel_tol=1e-4), impulse  # 500 N for 0.01 s, turning with A


def test_the_delay_of_thrust_can_be_changed_while_it_runs(runs):
    with started(Host(runs.fmu(DEFAULT, NEAR, "chaser.contact_thrust=500"))) as host:
        host.set(chaser__contact_thrust_delay=0.15)
        start = host.vector("momentum.linear")
        while host.value("time_of_contact") < 0.0:
            host.step()
        host.set(chaser__contact_thrust_delay=0.205)
        while host.time < 0.5:
            host.step()
        on = host.time - host.value("time_of_contact") - 0.205
        impulse = np.linalg.norm(host.vector("momentum.linear") - start)
        assert math.isclose(impulse, 500.0 * on, rel_tol=1e-4), (impulse, 500.0 * on)


def test_a_host_that_sets_what_is_there_already_changes_nothing(contact):
    host, alone = contact
    names = ["friction.coefficient", "restitution", "restitution_speed", "chaser.contact_thrust"]
    host.slave.setReal(host.references(names), list(host.get(*names)))
    for each in contact:
        each.step()
    assert host.everything() == alone.everything()


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"friction.coefficient": -0.1}, "below its minimum"),
        ({"restitution": 1.5}, "above its maximum"),
        ({"restitution": 0.0}, "must be above 0"),
        ({"restitution": 0.5, "restitution_speed": 0.0}, "must be above 0"),
        ({"chaser.contact_thrust_delay": -1.0}, "below its minimum"),
        ({"chaser.contact_thrust": math.nan}, "not a finite number"),
        ({"chaser.contact_thrust": 500.0, "friction.coefficient": -1.0}, "below its minimum"),
        ({"chaser.contact_thrust": 500.0, "restitution": 0.0}, "must be above 0"),
        ({"chaser.force_ext[1]": 500.0, "restitution": 0.0}, "must be above 0"),
        ({"chaser.contact_thrust": 500.0, "chaser.mass": 1.0}, "fixed parameter"),
    ],
    ids=str,
)
def test_values_that_cannot_be_used_are_refused_and_nothing_changes(contact, values, why):
    host, alone = contact
    assert host.set_status(values) == ERROR
    assert why in host.last_line
    for each in contact:
        for _ in range(5):
            each.step()
    assert host.everything() == alone.everything(), host.differences(alone)[:5]


def test_tunable_parameters_cannot_be_set_after_the_end_or_between_events(runs, contact):
    host, _ = contact
    host.slave.terminate()
    assert host.set_status({"friction.coefficient": 0.2}) == ERROR
    with Host(runs.fmu(DEFAULT, NEAR), exchange=True) as other:
        other.start_exchange()
        before = other.value("friction.coefficient")
        assert other.set_status({"friction.coefficient": 0.2}) == ERROR
        assert "event mode" in other.last_line
        assert other.value("friction.coefficient") == before
        other.slave.enterEventMode()
        assert other.set_status({"friction.coefficient": 0.2}) == OK
        assert other.value("friction.coefficient") == 0.2


def test_parameters_that_are_fixed_cannot_be_set_between_steps(contact):
    host, alone = contact
    assert host.set_status({"friction.model": 2}, "Integer") == ERROR
    assert host.set_status({"chaser.position[1]": 2.0}) == ERROR
    assert "start value" in host.last_line
    for each in contact:
        each.step()
    assert host.everything() == alone.everything()


# ---------------------------------------------------------------- time and steps

RELATIVE = [
    *(f"relative.position[{i}]" for i in (1, 2, 3)),
    *(f"relative.attitude[{i}]" for i in (1, 2, 3, 4)),
    *(f"relative.velocity[{i}]" for i in (1, 2, 3)),
    *(f"ring.position[{i}]" for i in (1, 2, 3)),
    "capture.peak.compression",
    "energy.dissipated",
    "solver.steps",
]


@pytest.mark.parametrize("start", [-5.0, 1e9])
def test_the_start_time_does_not_matter_for_relative_motion(runs, start):
    fmu = runs.fmu(DEFAULT, NEAR)
    with started(Host(fmu)) as zero, started(Host(fmu, start_time=start)) as host:
        for _ in range(160):
            zero.step(EXACT)
            host.step(EXACT)
            assert np.array_equal(zero.get(*RELATIVE), host.get(*RELATIVE))
        assert zero.phase() >= 3
        # Times are stated by the host's clock, with what it can hold.
        peaks = [name for name in host.reference if ".peak_time" in name]
        times = [n for n in ("time_of_contact", "time_of_capture", *peaks) if zero.value(n) >= 0.0]
        assert len(times) > 4
        for name in times:
            assert host.value(name) == start + zero.value(name)
        differing = host.differences(zero, but=times)
        assert differing == []


def test_communication_steps_of_any_sizes_lead_to_the_same_motion(runs):
    sizes = random.Random(3)
    fmu = runs.fmu(DEFAULT, NEAR)
    with started(Host(fmu, tolerance=1e-9)) as even, started(Host(fmu, tolerance=1e-9)) as odd:
        for _ in range(130):
            even.step(0.01)
        while odd.time < 1.3:
            odd.step(min(10 ** sizes.uniform(-5, -1.3), 1.3 - odd.time))
        assert odd.phase() == even.phase() >= 3
        error = np.abs(odd.vector("relative.position") - even.vector("relative.position")).max()
        assert error < 1e-7, error  # measured 1e-9 m
        error = odd.value("time_of_capture") - even.value("time_of_capture")
        assert abs(error) < 1e-6, error


def test_a_tolerance_of_the_host_makes_the_integration_finer(runs):
    steps = []
    for tolerance in (None, 1e-8, 1e-10):
        with started(Host(runs.fmu(DEFAULT, NEAR), tolerance=tolerance)) as host:
            for _ in range(10):
                host.step(0.1)
            steps.append(host.value("solver.steps"))
    assert 1.1 * steps[0] < steps[1] < steps[2], steps  # measured 499, 586, 596


# ---------------------------------------------------------------- fixed steps


def test_fixed_steps_cost_the_same_in_every_communication_step(runs):
    fmu = runs.fmu(DEFAULT, NEAR)
    with Host(fmu, tolerance=1e-10) as adaptive:
        adaptive.set(solver__atol_position=1e-12, solver__atol_velocity=1e-12)
        adaptive.start()
        for _ in range(130):
            adaptive.step()
        assert adaptive.phase() >= 3
        errors = []
        for size in (2e-3, 1e-3, 0.5e-3):
            with Host(fmu) as host:
                host.choose(solver__method=7)
                host.set(solver__step=size)
                host.start()
                costs = [growth(host, "solver.rhs_evaluations") for _ in range(130)]
                assert set(costs) == {4 * round(0.01 / size)}, set(costs)
                error = host.vector("relative.position") - adaptive.vector("relative.position")
                errors.append(float(np.abs(error).max()))
                late = host.value("time_of_capture") - adaptive.value("time_of_capture")
                assert 0.0 <= late <= size, late  # events are seen at the ends of steps
        # Where a latch is caught up to a step late, the error is that of the lateness.
        assert errors[2] < 0.7 * errors[0], errors
        assert errors[2] < 1e-4, errors


@pytest.mark.parametrize(("size", "why"), [(0.0, "above 0"), (1e-9, "the limit is ")])
def test_fixed_steps_that_cannot_be_made_are_refused(runs, size, why):
    with Host(runs.fmu(DEFAULT, NEAR)) as host:
        host.choose(solver__method=7)
        host.set(solver__step=size)
        if size > 0.0:
            host.start()
            assert host.step_status() == DISCARD
            assert "0.000000 s" not in host.last_line, host.last_line  # the number that was set
        else:
            assert host.status("fmi2ExitInitializationMode") == ERROR
        assert why in host.last_line


# ---------------------------------------------------------------- log


def test_only_the_log_categories_that_are_asked_for_are_reported(runs):
    def run(*selection):
        with Host(runs.fmu(DEFAULT, NEAR)) as host:
            if selection:
                host.slave.setDebugLogging(*selection)
            host.start()
            for _ in range(20):
                host.step()
            host.set_status({"chaser.mass": 1.0})  # an error
            return {category for _, category, _ in host.lines}

    assert run() == {"logStatusError"}
    assert run(True, []) == {"logStatusError", "logEvents"}
    assert run(True, ["logEvents"]) == {"logEvents"}
    assert run(True, ["logStatusError"]) == {"logStatusError"}
    assert run(False, []) == set()
    with Host(runs.fmu(DEFAULT, NEAR), logging_on=True) as host:
        categories = (ctypes.c_char_p * 1)(b"logNothing")
        assert host.status("fmi2SetDebugLogging", 1, ctypes.c_size_t(1), categories) == ERROR
        assert "logNothing" in host.last_line
        declared = {c.name for c in host.description.logCategories or []}
        assert not declared or "logEvents" in declared


# ---------------------------------------------------------------- reset, discarded steps


def test_a_run_after_reset_has_the_same_bits_also_if_states_were_saved(runs):
    with Host(runs.fmu(DEFAULT, NEAR)) as host:
        seen = []
        saved = []
        for turn in range(2):
            host.start()
            host.time = 0.0
            host.put("chaser.force_ext", (5.0, 0.0, 0.0))
            fingerprints = []
            for _ in range(50):
                host.step()
                fingerprints.append(host.everything())
                saved.append(host.save())
            if turn == 0:
                host.restore(saved[10])
                host.slope_status({"chaser.force_ext[2]": 5.0})
                host.set(friction__coefficient=0.3)
                host.slave.reset()
                host.slave.setupExperiment(startTime=0.0)
                host.slave.enterInitializationMode()
            seen.append(fingerprints)
        assert seen[0] == seen[1]
        for each in saved:
            host.release(each)


def last_successful_time(host):
    """What fmi2GetRealStatus says."""
    time = ctypes.c_double(math.nan)
    assert host.status("fmi2GetRealStatus", 2, ctypes.byref(time)) == OK
    return time.value


def test_after_a_discarded_step_the_last_successful_time_is_reported(runs):
    with started(Host(runs.fmu(DEFAULT, NEAR, "target.motion=driven"))) as host:
        for _ in range(5):
            host.step()
        time = host.time
        position = host.vector("target.position")
        # An impossible attitude, then a target deep inside the other surfaces.
        host.put("target.attitude", (0.5, 0.0, 0.0, 0.0))
        assert host.step_status() == DISCARD
        assert last_successful_time(host) == time
        host.put("target.attitude", (1.0, 0.0, 0.0, 0.0))
        host.put("target.position", position - np.array([0.1, 0.0, 0.0]))
        assert host.step_status() == DISCARD
        assert "pressed together" in host.last_line or "pass through" in host.last_line, (
            host.last_line
        )
        assert last_successful_time(host) == time
        status = ctypes.c_int(-1)
        assert host.status("fmi2GetStatus", 0, ctypes.byref(status)) == OK
        assert status.value == DISCARD
        host.put("target.position", position)
        assert host.step_status(0.005) == OK
        assert last_successful_time(host) == time + 0.005
