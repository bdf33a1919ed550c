"""Derivatives that the FMU returns, against differences of what it computes.

1. fmi2GetDirectionalDerivative of every output and every rate by every state and input is what
   sixth-order central differences through the interface give: apart, sliding in contact, held by
   the latches, and with thrust.
2. Dependencies in modelDescription.xml are true: pairs that are not declared have no derivative,
   and most pairs are not declared.
3. A direction with several components gives the sum of them.
4. In co-simulation outputs are differentiated by inputs the same way.
5. fmi2GetRealOutputDerivatives of order 1 is the slope along the motion; position gives velocity,
   and an input slope counts. Higher orders are zero.
6. What has no derivative is refused with a reason.
"""

import ctypes
import math
from collections import defaultdict

import numpy as np
import pytest
from fmpy.fmi2 import FMU2Model

from extreme_cases.fmi_host import ERROR, OK, Host

DEFAULT = "idss_25t_350t"
NEAR = "initial.approach_time=0.1"
WEIGHTS = ((1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0))  # of sixth order

FLOOR = 1e-4  # rows with smaller entries (in the unit of the unknown) are measured by this
STEPS = (1e-4, 1e-6, 1e-7)  # of the nominal values

# Both vehicles have an array and a mode; the chaser's mechanism and P stand on springs.
ARRAY = "mass=150, com=[0, 3, 0], inertia=[300, 5, 300, 0, 0, 0], joint='hinge', axis=[1, 0, 0]"
PARTS = tuple(
    f"{vehicle}.{member}"
    for vehicle, x in (("chaser", 3.0), ("target", -14.0))
    for member in (
        f"part=[{{{ARRAY}, frequency=0.3, coordinate=0.1}}]",
        *("modes.frequency=[0.5]", "modes.participation=[[3, -20, 9, 4, 8, -60]]"),
        *("modes.damping_ratio=0.01", "modes.point=[0.5, 0.2, 0]", "modes.coordinate=[0.3]"),
        *("adapter.mass=2000", "adapter.inertia=[2000, 1500, 1500, 0, 0, 0]"),
        *(f"adapter.position=[{x}, 0, 0]", "adapter.joint=elastic", "adapter.frequency=12"),
        "adapter.damping_ratio=0.01",
    )
)
# name: overrides, time [s], step of the way there [s], latches held
INSTANTS = {
    "apart": ((), 0.05, 1e-3, 0),
    "sliding": ((), 0.2, 1e-3, 0),
    "bristles": (("contact.friction_model=2",), 0.115, 0.25e-3, 0),
    "latched": ((), 1.3, 1e-3, 3),
    "thrust": (("chaser.contact_thrust=500",), 0.2, 1e-3, 0),
    "parts": (("chaser.contact_thrust=500", *PARTS), 0.2, 1e-3, 0),
}


class Jacobian:
    """Derivatives of all continuous outputs and rates at the present state of an instance."""

    def __init__(self, host, leave_out=()):
        self.host = host
        description = host.description
        self.outputs = [
            u.variable.name
            for u in description.outputs
            if u.variable.type == "Real"
            and u.variable.variability == "continuous"
            and not u.variable.name.startswith("solver")
            and ".peak" not in u.variable.name  # follows an input only where it is the largest yet
        ]
        self.rates = [u.variable.name for u in description.derivatives]
        self.unknowns = self.outputs + self.rates
        self.states = [u.variable.derivative.name for u in description.derivatives]
        self.inputs = [v.name for v in description.modelVariables if v.causality == "input"]
        self.knowns = [n for n in self.states + self.inputs if n not in leave_out]
        nominals = {}
        if isinstance(host.slave, FMU2Model):
            nominals = dict(zip(self.states, host.nominals(), strict=True))
        # What a known varies by: states by their nominal value, loads and gravity by these.
        self.scale = np.array(
            [nominals.get(n, 1.0 if "gravity" in n else 100.0) for n in self.knowns]
        )
        declared = {u.variable.name: u.dependencies for u in description.outputs}
        declared |= {u.variable.name: u.dependencies for u in description.derivatives}
        self.declared = np.zeros((len(self.unknowns), len(self.knowns)), dtype=bool)
        place = {name: k for k, name in enumerate(self.knowns)}
        for i, name in enumerate(self.unknowns):
            for known in declared[name]:
                if known.name in place:
                    self.declared[i, place[known.name]] = True

    def reported(self):
        """What the FMU says."""
        columns = []
        for name in self.knowns:
            status, column = self.host.directional_derivative(self.unknowns, [name], [1.0])
            assert status == OK, self.host.last_line
            columns.append(column)
        return np.array(columns).T

    def values(self):
        """Values of the unknowns."""
        return np.array(self.host.slave.getReal(self.host.references(self.unknowns)))

    def difference(self, known, step):
        """Central difference of sixth order by one known."""
        host = self.host
        exact = host.value(known)
        states = host.states() if known in self.states else None
        place = self.states.index(known) if known in self.states else None

        def put(value):
            if states is None:
                host.slave.setReal([host.reference[known]], [value])
            else:
                moved = states.copy()
                moved[place] = value
                host.put_states(moved)

        total = np.zeros(len(self.unknowns))
        for n, weight in WEIGHTS:
            for sign in (1, -1):
                put(exact + sign * n * step)
                total += sign * weight * self.values()
        put(exact)
        return total / step

    def differences(self, steps):
        """All of them, steps as parts of what the knowns vary by."""
        return np.array(
            [self.difference(k, steps * s) for k, s in zip(self.knowns, self.scale, strict=True)]
        ).T

    def errors(self, reported):
        """Largest error of each group, as a part of the largest entry of a row.

        Of several step sizes the best counts for an entry: contact that begins within a step
        spoils long ones, rounding spoils short ones.
        """
        size = np.abs(reported) * self.scale
        seen = [self.differences(steps) for steps in STEPS]
        error = np.min([np.abs(reported - each) for each in seen], axis=0) * self.scale
        error /= np.maximum(size.max(axis=1, keepdims=True), FLOOR)
        worst = defaultdict(float)
        for i, name in enumerate(self.unknowns):
            worst[group(name)] = max(worst[group(name)], float(error[i].max()))
        return dict(worst), error


def group(name):
    """What a variable belongs to."""
    return name.removeprefix("der(").split(".")[0].split("[")[0] + (
        " rates" if name.startswith("der(") else ""
    )


def bring_to(fmu, time, size):
    """A model exchange instance in continuous-time mode at some time."""
    host = Host(fmu, exchange=True)
    host.integrate(time, size, host.start_exchange())
    return host


@pytest.mark.parametrize("instant", INSTANTS)
def test_directional_derivatives_are_those_of_central_differences(runs, instant):
    overrides, time, size, held = INSTANTS[instant]
    with bring_to(runs.fmu(DEFAULT, NEAR, *overrides), time, size) as host:
        latched = [host.reference[f"latched[{i}]"] for i in (1, 2, 3)]
        assert sum(host.slave.getBoolean(latched)) == held
        # There are 639 bristles: some will do.
        some = [v for i, v in enumerate(n for n in host.variables if "ode.bristle" in n) if i % 40]
        jacobian = Jacobian(host, leave_out=some)
        reported = jacobian.reported()
        by_group, error = jacobian.errors(reported)
        # Measured: 2e-8 of the largest entry of a row, at every instant.
        assert max(by_group.values()) < 1e-6, by_group
        # What is not declared is not there, in what is reported and in what is seen.
        part = np.abs(reported) * jacobian.scale
        part /= np.maximum(part.max(axis=1, keepdims=True), FLOOR)
        assert part[~jacobian.declared].max() < 1e-9  # measured 3e-10, where latches are stiff
        assert error[~jacobian.declared].max() < 1e-6
        # A third of all pairs is declared (4276 of 13916 with regularised friction).
        share = jacobian.declared.sum() / jacobian.declared.size
        assert share < 0.4, share
        assert np.count_nonzero(reported) > 1000


NO_FRICTION = ("contact.friction_coefficient=0", {"friction.coefficient": 0.3})
OFFSETS = {"chaser.interface_position[2]": 0.05, "chaser.inertia[4]": 5e3, "target.inertia[6]": 8e6}
SLACK = [
    f"force.1.{member}"
    for member in ("type=tether", "stiffness=8", "free_length=90", "target_point=[0, 1, 0]")
]
TAUT = {"force[1].free_length": 0.1}
VARIANTS = {
    "no friction until it is set": (DEFAULT, (NEAR, NO_FRICTION[0]), NO_FRICTION[1]),
    "no thrust until it is set": (DEFAULT, (NEAR,), {"chaser.contact_thrust": 300.0}),
    "other vehicles than those of the scene": (DEFAULT, (NEAR,), OFFSETS),
    "fixed target": (DEFAULT, (NEAR, "target.motion=fixed"), {}),
    "equal vehicles": ("idss_100t_100t", (NEAR,), {}),
    "base fixed, no target": ("hexapod_bench", (), {}),
    "absorber": ("absorber_1d", (), {}),
    "a tether that is slack until it is set": ("absorber_1d", SLACK, TAUT),
    "parts of vehicles": (DEFAULT, (NEAR, *PARTS), {}),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_dependencies_are_true_whatever_start_values_the_host_sets(runs, variant):
    scene, overrides, values = VARIANTS[variant]
    with Host(runs.fmu(scene, *overrides), exchange=True) as host:
        host.slave.setReal(host.references(values), list(values.values()))
        host.integrate(0.2, 1e-3, host.start_exchange())
        jacobian = Jacobian(host)
        part = np.abs(jacobian.reported()) * jacobian.scale
        part /= np.maximum(part.max(axis=1, keepdims=True), FLOOR)
        false = zip(*np.nonzero((part > 1e-10) & ~jacobian.declared), strict=True)
        named = [f"{jacobian.unknowns[i]} by {jacobian.knowns[k]}" for i, k in false]
        assert named == [], len(named)


def test_every_continuous_output_that_follows_from_the_states_declares_it(runs):
    with bring_to(runs.fmu(DEFAULT, NEAR), 0.2, 1e-3) as host:
        silent = [
            u.variable.name
            for u in host.description.outputs
            if u.variable.type == "Real"
            and u.variable.variability == "continuous"
            and u.dependencies is not None
            and len(u.dependencies) == 0
        ]
        before = host.get(*silent)
        x = host.states()
        host.put_states(x + 1e-3 * host.nominals())
        moved = np.abs(host.get(*silent) - before)
        changed = [n for n, by in zip(silent, moved, strict=True) if by > 1e-12]
        assert changed == []


def test_a_direction_with_several_components_gives_the_sum(runs):
    with bring_to(runs.fmu(DEFAULT, NEAR), 0.2, 1e-3) as host:
        jacobian = Jacobian(host)
        reported = jacobian.reported()
        seeds = np.random.default_rng(1).normal(size=len(jacobian.knowns)) * jacobian.scale
        status, together = host.directional_derivative(jacobian.unknowns, jacobian.knowns, seeds)
        assert status == OK
        size = (np.abs(reported) * np.abs(seeds)).max(axis=1)
        # Half the rotation about a seeded axis is all that a scalar part varies by.
        error = np.abs(together - reported @ seeds) / np.maximum(size, 1e-7)
        assert error.max() < 1e-11, error.max()  # measured 4e-13
        # The same known twice counts twice; none at all gives zeros.
        twice = ["ode.chaser.position[1]"] * 2
        status, values = host.directional_derivative(["relative.axial"], twice, [1.0, 2.0])
        once = host.directional_derivative(["relative.axial"], twice[:1], [3.0])[1]
        assert status == OK
        assert values == pytest.approx(once, rel=1e-14)
        status, values = host.directional_derivative(["relative.axial"], [], [])
        assert (status, values[0]) == (OK, 0.0)


def test_a_derivative_leaves_the_instance_as_it_was(runs):
    with bring_to(runs.fmu(DEFAULT, NEAR), 0.2, 1e-3) as host:
        before = host.save_bytes()
        Jacobian(host).reported()
        assert host.save_bytes() == before


def test_derivatives_exist_in_an_aligned_docking(runs):
    # Angles, offsets and side loads are zero there: their absolute values have a kink.
    with Host(runs.fmu("absorber_1d"), exchange=True) as host:
        host.integrate(0.5, 1e-3, host.start_exchange())
        reported = Jacobian(host).reported()
        assert np.all(np.isfinite(reported))


# ---------------------------------------------------------------- co-simulation


def cosimulation(fmu, time=0.3, step=0.01, **options):
    """A co-simulation instance at some time."""
    host = Host(fmu, **options)
    host.set(solver__rtol=1e-11, solver__atol_position=1e-12, solver__atol_velocity=1e-12)
    host.start()
    for _ in range(round(time / step)):
        host.step(step)
    return host


def test_in_co_simulation_outputs_are_differentiated_by_inputs(runs):
    with cosimulation(runs.fmu(DEFAULT, NEAR)) as host:
        jacobian = Jacobian(host, leave_out=[n for n in host.variables if n.startswith("ode.")])
        reported = jacobian.reported()
        by_group, error = jacobian.errors(reported)
        assert max(by_group.values()) < 1e-6, by_group
        assert error[~jacobian.declared].max() < 1e-6
        assert np.count_nonzero(reported) > 50


def test_in_co_simulation_outputs_are_differentiated_by_states_too(runs):
    # Both interfaces hold the same equations: only gravity is treated differently.
    fmu = runs.fmu(DEFAULT, NEAR)
    with cosimulation(fmu, 0.3) as inside, bring_to(fmu, 0.29, 1e-3) as outside:
        x = inside.get(*Jacobian(inside).states)
        outside.put_time(0.3)
        outside.put_states(x)
        jacobian, other = Jacobian(inside), Jacobian(outside)
        mean = [i for i, n in enumerate(jacobian.unknowns) if "_mean" not in n]
        columns = [k for k, n in enumerate(jacobian.knowns) if "gravity" not in n]
        a, b = (
            j.reported()[np.ix_(mean, columns)] * other.scale[columns] for j in (jacobian, other)
        )
        error = np.abs(a - b) / np.maximum(np.abs(b).max(axis=1, keepdims=True), FLOOR)
        assert error.max() < 1e-9, error.max()


# ---------------------------------------------------------------- derivatives in time


def test_output_derivatives_are_the_slope_along_the_motion(runs):
    fmu = runs.fmu(DEFAULT, NEAR)
    errors = []
    for step in (0.5e-3, 0.25e-3, 0.125e-3):
        with cosimulation(fmu, 0.5) as host:
            names = [
                u.variable.name
                for u in host.description.outputs
                if u.variable.type == "Real"
                and u.variable.variability == "continuous"
                and not u.variable.name.startswith(("solver", "momentum.residual"))
                and ".peak" not in u.variable.name
                and "_mean" not in u.variable.name
            ]
            before = host.get(*names)
            host.step(step)
            status, slope = host.output_derivatives(names)
            assert status == OK, host.last_line
            host.step(step)
            difference = (host.get(*names) - before) / (2 * step)
            size = np.maximum(np.abs(slope), 1e-3)
            errors.append(np.abs(difference - slope) / size)
    median = [float(np.median(e[e > 0.0])) for e in errors]
    worst = [float(e.max()) for e in errors]
    # Differences are of second order: four times better with half the step.
    assert 3.0 < median[0] / median[1] < 5.0, median
    assert 3.0 < median[1] / median[2] < 5.0, median
    assert worst[2] < 0.01, (worst, names[int(np.argmax(errors[2]))])


def test_the_derivative_of_a_position_is_the_velocity_and_that_of_a_velocity_force_over_mass(runs):
    with cosimulation(runs.fmu(DEFAULT, NEAR)) as host:
        axes = (1, 2, 3)
        for vehicle in ("chaser", "target"):
            status, rate = host.output_derivatives([f"{vehicle}.position[{i}]" for i in axes])
            assert status == OK
            error = np.abs(rate - host.vector(f"{vehicle}.velocity")).max()
            assert error < 1e-14, error
            _, rate = host.output_derivatives([f"{vehicle}.velocity[{i}]" for i in axes])
            force = host.vector(f"{vehicle}.force")
            error = np.abs(rate * host.value(f"{vehicle}.mass") - force).max()
            assert error < 1e-10 * np.abs(force).max(), error
        _, rate = host.output_derivatives([f"relative.position[{i}]" for i in axes])
        error = np.abs(rate - host.vector("relative.velocity")).max()
        assert error < 1e-14, error
        _, rate = host.output_derivatives([f"leg[{i}].length" for i in axes])
        error = np.abs(rate - host.get(*(f"leg[{i}].rate" for i in axes))).max()
        assert error < 1e-14, error


def test_gravity_and_outer_forces_count_in_the_derivative_of_velocity(runs):
    fmu = runs.fmu(DEFAULT, "initial.approach_time=5.0")
    with cosimulation(fmu, 0.1) as host:
        host.put("gravity", (0.0, -9.0, 1.0))
        names = [f"target.velocity[{i}]" for i in (1, 2, 3)]
        _, rate = host.output_derivatives(names)
        assert np.abs(rate - [0.0, -9.0, 1.0]).max() < 1e-12, rate
        host.put("target.force_ext", (350e3, 0.0, 0.0))
        _, rate = host.output_derivatives(names)
        assert np.abs(rate - [1.0, -9.0, 1.0]).max() < 1e-12, rate


def test_a_slope_of_an_input_counts_as_much_as_its_directional_derivative(runs):
    with cosimulation(runs.fmu(DEFAULT, NEAR)) as host:
        outputs = ["leg[1].force", "chaser.torque[2]", "capture.force[1]", "chaser.force[1]"]
        _, without = host.output_derivatives(outputs)
        slopes = {"leg[1].force_command": 30.0, "chaser.force_ext[2]": -70.0}
        assert host.slope_status(slopes) == OK
        _, with_slopes = host.output_derivatives(outputs)
        _, expected = host.directional_derivative(outputs, list(slopes), list(slopes.values()))
        assert np.abs(expected).max() > 1.0
        error = np.abs(with_slopes - without - expected).max()
        assert error < 1e-9 * max(1.0, np.abs(without).max()), error


def test_higher_orders_are_zero_and_what_jumps_has_no_slope(runs):
    with cosimulation(runs.fmu(DEFAULT, NEAR)) as host:
        for order in (2, 3):
            status, rate = host.output_derivatives(["relative.axial", "leg[1].force"], order)
            assert (status, list(rate)) == (OK, [0.0, 0.0])
        status, rate = host.output_derivatives(["time_of_contact", "capture.peak.shear"])
        assert (status, list(rate)) == (OK, [0.0, 0.0])


# ---------------------------------------------------------------- what is refused


def test_what_has_no_derivative_is_refused_with_a_reason(runs):
    with cosimulation(runs.fmu(DEFAULT, NEAR), 0.2) as host:
        axial = ["relative.axial"]
        force = ["chaser.force_ext[1]"]
        for unknowns, knowns, seeds, why in (
            (axial, ["chaser.mass"], [1.0], "neither an input nor a continuous state"),
            (axial, ["friction.coefficient"], [1.0], "neither an input nor a continuous state"),
            (axial, ["time_of_contact"], [1.0], "neither an input nor a continuous state"),
            (axial, ["phase"], [1.0], "not of type Real"),
            (axial, force, [math.nan], "seed"),
            (axial, force, [math.inf], "seed"),
            (["chaser.mass"], force, [1.0], "neither an output"),
            (["ode.chaser.position[1]"], force, [1.0], "neither an output"),
            (["phase"], force, [1.0], "not of type Real"),
        ):
            status, values = host.directional_derivative(unknowns, knowns, seeds)
            assert status == ERROR, (unknowns, knowns)
            assert why in host.last_line, host.last_line
            assert math.isnan(values[0])
        for names, order, why in (
            (axial, 0, "order 0"),
            (axial, -1, "order -1"),
            (force, 1, "not an output"),
            (["chaser.mass"], 1, "not an output"),
            (["phase"], 1, "not of type Real"),
        ):
            status, values = host.output_derivatives(names, order)
            assert status == ERROR, names
            assert why in host.last_line, host.last_line
            assert math.isnan(values[0])
        none = ctypes.c_size_t(1)
        assert host.status("fmi2GetRealOutputDerivatives", None, none, None, None) == ERROR
        assert "null" in host.last_line


def test_before_the_initialisation_there_are_no_derivatives(runs):
    with Host(runs.fmu(DEFAULT, NEAR), initialisation=False) as host:
        axial, force = ["relative.axial"], ["chaser.force_ext[1]"]
        assert host.directional_derivative(axial, force, [1.0])[0] == ERROR
        assert host.output_derivatives(axial)[0] == ERROR
        host.slave.enterInitializationMode()
        assert host.directional_derivative(axial, force, [1.0])[0] == OK
