"""Linear models of a docking at one instant, from its exact derivatives.

The states are those of model exchange: coordinates and velocities of the mechanism, poses and
momenta of the vehicles, and sums such as dissipated energies, which act on nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.core import core_errors, number_choice
from dockloop.docking import Docking, Scene
from dockloop.errors import UsageError, did_you_mean, names_arguments
from dockloop.number import as_number

INSTANTS = {"capture": ("captured", True), "hard_docked": ("phase", "hard_docked")}
_STILL = 1e-6  # part of the fastest pole; slower ones are zeros with rounding


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

    def __repr__(self) -> str:
        return (
            f"LinearModel({self.time:g} s: {len(self.states)} states, {len(self.inputs)} inputs,"
            f" {len(self.outputs)} outputs)"
        )

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A [1/s], largest first, shape (states,), complex."""
        found = np.linalg.eigvals(self.A)
        return found[np.lexsort((-found.imag, -np.abs(found)))]

    @property
    def moving(self) -> list[complex]:
        """Poles [1/s] that are not zero, fastest first: one of each pair of complex poles.

        Below 1e-6 of the fastest pole, a pole is a zero with rounding, and an imaginary part too.
        """
        poles = self.poles
        still = _STILL * abs(poles[0])
        return [
            complex(pole.real, pole.imag if pole.imag > still else 0.0)
            for pole in poles
            if abs(pole) > still and pole.imag >= -still
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
            frequencies: [Hz], above 0.

        Returns:
            Complex amplitudes, unit of the output per unit of the input, shape (frequencies,).

        Raises:
            UsageError: there is no such output or input.
        """
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
    _go_to(docking, at)
    names = list(docking.variables)
    states = [name for name in names if f"der({name})" in docking.variables]
    if not states:
        raise UsageError(
            f"{docking.scene.name} has a driven vehicle, whose motion is no state: set"
            " chaser.motion and target.motion to free"
        )
    inputs = [
        n for n, v in docking.variables.items() if v.causality == "input" and v.type == "Real"
    ]
    outputs = [names[row] for row in docking._core.differentiable()]
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
    return LinearModel(
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
