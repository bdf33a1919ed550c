"""Linear models of a docking at one instant, from its exact derivatives.

The states are those of model exchange: coordinates and velocities of the mechanism, poses and
momenta of the vehicles, and sums such as dissipated energies, which act on nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base.errors import UsageError, did_you_mean, names_arguments
from dockloop.base.number import as_number, check_number
from dockloop.native.core import core_errors, number_choice
from dockloop.native.variables import VEHICLES
from dockloop.runs.docking import Docking, Scene
from dockloop.runs.linear_interface import find_interface

INSTANTS = {"capture": ("captured", True), "hard_docked": ("phase", "hard_docked")}
_BALANCINGS = 30  # each halves the logarithms of the ratios


@dataclass(repr=False)
class LinearModel:
    """Rates and outputs near one instant: ``dx' = A dx + B du``, ``dy = C dx + D du``.

    All in SI units. Free vehicles, attitude quaternions (four numbers each) and sums have poles at
    zero. Contact, friction and latches are those of this instant. Positions and velocities of free
    vehicles are those in a frame that falls with gravity, so gravity is no input there.

    Attributes:
        time: of the instant [s].
        docking: the docking at this instant, with values and units of all variables.
        states: names x, as in model exchange.
        inputs: names u.
        outputs: names y.
        A: shape (states, states).
        B: shape (states, inputs).
        C: shape (outputs, states).
        D: shape (outputs, inputs).
        turn_rate: angular velocity of the free vehicle that turns fastest, without one of the ring
            [rad/s]. The model holds for shorter times than these turns take.
        stiffness: of the docking interface between free vehicles without parts, else None; shape
            (6, 6). Rows are force [N] and torque [N m] on the target, with the opposite sign, about
            the place of P at the instant. Columns are displacement [m] and rotation vector [rad] of
            P. All are in axes of A, which is held; the mechanism is in equilibrium.
        damping: the same by the rates of these [m/s], [rad/s].
    """

    time: float
    docking: Docking
    states: list[str]
    inputs: list[str]
    outputs: list[str]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    turn_rate: float = 0.0
    stiffness: np.ndarray | None = None
    damping: np.ndarray | None = None

    def __repr__(self) -> str:
        return (
            f"LinearModel({self.time:g} s: {len(self.states)} states, {len(self.inputs)} inputs,"
            f" {len(self.outputs)} outputs)"
        )

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A [1/s], largest first, shape (states,), complex.

        Zeros of free motion, quaternions and sums are exact.
        """
        found = _find_poles(self.A)
        return found[np.lexsort((-found.imag, -np.abs(found)))]

    @property
    def moving(self) -> list[complex]:
        """Poles [1/s] that are faster than turns, fastest first: one of each complex pair.

        Slower poles (`turn_rate`) belong to the motion at the instant, not to the docking.
        """
        poles = self.poles
        rounding = 1e-12 * abs(poles[0])
        return [
            complex(pole.real, pole.imag if pole.imag > rounding else 0.0)
            for pole in poles
            if abs(pole) > max(self.turn_rate, rounding) and pole.imag >= -rounding
        ]

    @property
    def oscillations(self) -> list[tuple[float, float]]:
        """Natural frequency [Hz] and damping ratio of each pair of complex poles, fastest first."""
        pairs = [pole for pole in self.moving if pole.imag]
        return [(abs(pole) / (2.0 * np.pi), -pole.real / abs(pole)) for pole in pairs]

    def find_response(self, output: str, input_: str, frequencies: Sequence[float]) -> np.ndarray:
        """Return the frequency response of an output by an input, for a Bode diagram.

        Args:
            output: one of `outputs`.
            input_: one of `inputs`.
            frequencies: [Hz], above 0; shape (frequencies,).

        Returns:
            Complex amplitudes, unit of the output per unit of the input, shape (frequencies,).

        Raises:
            UsageError: there is no such output or input, or a frequency is bad.
        """
        for frequency in frequencies:
            if check_number("find_response: a frequency is", frequency) <= 0.0:
                raise UsageError(f"find_response: a frequency is {frequency} Hz: must be above 0")
        row = _find_place("outputs", self.outputs, output)
        column = _find_place("inputs", self.inputs, input_)
        eye = np.eye(len(self.states))
        return np.array(
            [
                self.C[row] @ np.linalg.solve(2j * np.pi * f * eye - self.A, self.B[:, column])
                + self.D[row, column]
                for f in frequencies
            ]
        )


@names_arguments
def linearise(
    scene: str | Path | Scene | Mapping[str, Any],
    at: float | str,
    overrides: Mapping[str, Any] | None = None,
    start_values: Mapping[str, Any] | None = None,
) -> LinearModel:
    """Run a docking to one instant and return its linear model there, from exact derivatives.

    Args:
        scene: name of a shipped scene, path of a ``.toml`` file, its members, or a `Scene`.
        at: ``"capture"``, ``"hard_docked"`` (the first communication point at which that is so), or
            a time [s].
        overrides: as for `Scene`.
        start_values: values of variables at the start, as for `Docking.set`.

    Raises:
        UsageError: the scene has a driven vehicle, or does not come to this instant.
        DockloopError: a step failed.
    """
    docking = Docking(scene, overrides)
    for name, value in (start_values or {}).items():
        docking.set(name, value)
    return find_linear_model(docking, at)


def find_linear_model(docking: Docking, at: float | str) -> LinearModel:
    """Step a docking to one instant and return its linear model there; as for `linearise`."""
    states, inputs, outputs = _list_signals(docking)
    _go_to(docking, at)
    names = list(docking.variables)
    unknowns = [f"der({name})" for name in states] + outputs
    places = {name: row for row, name in enumerate(names)}
    with core_errors():
        found = docking._core.derivatives(
            [places[name] for name in unknowns], [places[name] for name in states + inputs]
        )
    matrix = np.array(found).reshape(len(states) + len(inputs), len(unknowns)).T
    count = len(states)
    # The origin of free vehicles falls with gravity, which then acts on no state.
    acting = [
        column
        for column, name in enumerate(inputs, count)
        if not name.startswith("gravity[") or matrix[:count, column].any()
    ]
    by_states, by_inputs = matrix[:, :count], matrix[:, acting]
    model = LinearModel(
        docking.time,
        docking,
        states,
        [inputs[column - count] for column in acting],
        outputs,
        by_states[:count],
        by_inputs[:count],
        by_states[count:],
        by_inputs[count:],
    )
    free = [v for v in VEHICLES if f"ode.{v}.attitude[1]" in states]
    turning = [f"{v}.angular_velocity" for v in free or ["ring"]]
    rates = [docking.get(name) for name in turning if f"{name}[1]" in names]
    model.turn_rate = float(max(map(np.linalg.norm, rates), default=0.0))
    model.stiffness, model.damping = find_interface(model) or (None, None)
    return model


def check_pair(docking: Docking, input_: str, output: str) -> None:
    """Check names before a docking is stepped. Raises UsageError: the model will not have one."""
    _, inputs, outputs = _list_signals(docking)
    _find_place("inputs", inputs, input_)
    _find_place("outputs", outputs, output)


def _list_signals(docking: Docking) -> tuple[list[str], list[str], list[str]]:
    """Return states, inputs and outputs. Raises UsageError: a driven vehicle has no states."""
    variables = docking.variables
    names = list(variables)
    states = [name for name in names if f"der({name})" in variables]
    if not states:
        raise UsageError(
            f"{docking.scene.name} has a driven vehicle, whose motion is no state: set"
            " chaser.motion and target.motion to free"
        )
    inputs = [n for n, v in variables.items() if v.causality == "input" and v.type == "Real"]
    return states, inputs, [names[row] for row in docking._core.differentiable()]


def _find_poles(matrix: np.ndarray) -> np.ndarray:
    """Return eigenvalues; zeros are taken out first, as far as they are zeros to rounding.

    Chains of zeros, such as position and velocity of a free body, would otherwise become small
    numbers. The null space of a balanced matrix has the eigenvalue zero; the rest has the others.
    """
    count = len(matrix)
    while len(matrix):
        matrix = _balance(matrix)
        _, sizes, vectors = np.linalg.svd(matrix)
        rank = int(np.sum(sizes > count * np.finfo(float).eps * sizes[0]))
        if rank == len(matrix):
            break
        matrix = vectors[:rank] @ matrix @ vectors[:rank].T
    return np.append(np.linalg.eigvals(matrix), np.zeros(count - len(matrix)))


def _balance(matrix: np.ndarray) -> np.ndarray:
    """Return a similar matrix whose rows and columns have equal sums, by powers of two."""
    matrix = matrix.copy()
    for _ in range(_BALANCINGS):
        off = np.abs(matrix - np.diag(np.diag(matrix)))
        rows, columns = off.sum(axis=1), off.sum(axis=0)
        there = (rows > 0.0) & (columns > 0.0)
        factors = np.ones(len(matrix))
        factors[there] = 2.0 ** np.round(0.25 * np.log2(rows[there] / columns[there]))
        matrix = matrix * factors / factors[:, None]
    return matrix


def _find_place(kind: str, names: list[str], name: str) -> int:
    """Return the place of an input or output. Raises UsageError: there is none."""
    if name not in names:
        near = did_you_mean(name, names)
        raise UsageError(f"the linear model has no '{name}'{near}; its {kind} list all")
    return names.index(name)


def _go_to(docking: Docking, at: float | str) -> None:
    """Step to the instant. Raises UsageError: the scene does not come to it."""
    experiment = docking.scene.document["experiment"]
    stop, step = float(experiment["stop"]), float(experiment["step"])
    if not isinstance(at, str):
        if not docking.time <= as_number(at) <= 1e9:
            raise UsageError(f"--at is {at!r}: must be a time from {docking.time:g} s on")
        while (left := as_number(at) - docking.time) > 1e-9 * step:
            docking.step(min(step, left))
        return
    if at not in INSTANTS:
        near = did_you_mean(at, INSTANTS)
        raise UsageError(f"--at is {at!r}: must be a time or {', '.join(INSTANTS)}{near}")
    name, wanted = INSTANTS[at]
    value = number_choice(name, wanted) if isinstance(wanted, str) else wanted
    while docking.get(name) != value:
        if docking.time >= stop:
            raise UsageError(
                f"{docking.scene.name} does not come to '{at}' until its stop at"
                f" {stop:g} s: choose a later one (experiment.stop)"
            )
        docking.step(step)
