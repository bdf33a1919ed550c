"""Stiffness and damping between two free vehicles at their docking interface, from a linear model.

The chaser is held, and P moves slowly with the target. The mechanism follows in equilibrium: this
is Guyan's condensation of stiffness and damping. The force and the torque that hold the chaser are
then the load on the target.
"""

from typing import TYPE_CHECKING

import numpy as np

from dockloop.base.rotations import find_matrix
from dockloop.native.variables import VEHICLES

if TYPE_CHECKING:
    from dockloop.runs.linear import LinearModel

_RANK = 1e-12  # stiffness of a free coordinate, of the largest


def find_interface(model: "LinearModel") -> tuple[np.ndarray, np.ndarray] | None:
    """Return stiffness and damping of the docking interface.

    Returns:
        Two matrices of shape (6, 6). Rows: force [N] and torque [N m] on the target, with the
        opposite sign, about the present place of P. Columns: displacement [m] and rotation vector
        [rad] of P, or their rates [m/s], [rad/s]. All are in axes of A. None: a vehicle is not free
        or has parts, or the output group `relative` is missing.
    """
    docking, states = model.docking, model.states
    momenta = _list(VEHICLES, ("momentum", "angular_momentum"), "ode.")
    rates = _list(VEHICLES, ("velocity", "angular_velocity"))
    relative = _list(("relative",), ("velocity", "angular_velocity"))
    holding = _list(VEHICLES, ("force_ext", "torque_ext"))
    known = {*states, *model.inputs, *model.outputs}
    if not known.issuperset([*momenta, *rates, *relative, *holding]):
        return None
    if any(name.startswith("part[") for name in docking.variables):
        return None
    p = [states.index(name) for name in momenta]
    v = [row for row, name in enumerate(states) if name.startswith("ode.mechanism.v[")]
    u = [model.inputs.index(name) for name in holding]
    motion = model.C[[model.outputs.index(name) for name in rates]]
    between = model.C[[model.outputs.index(name) for name in relative]]

    # Velocities: of P with the chaser held, and of the mechanism with both vehicles held.
    to_momenta = np.linalg.inv(motion[:, p])
    moving, mechanism = np.zeros((len(states), 6)), np.eye(len(states))[:, v]
    moving[p] = to_momenta[:, 6:] @ np.linalg.inv(between[:, p] @ to_momenta[:, 6:])
    mechanism[p] = -to_momenta @ motion[:, v]
    # Displacements are their integrals; velocities of P stay zero.
    is_place = np.ones((len(states), 1), dtype=bool)
    is_place[p + v] = False
    place, inside = (is_place * (model.A @ each) for each in (moving, mechanism))
    place -= moving @ (between @ place)
    # Loads that hold the vehicles, and accelerations of the mechanism under them.
    hold = -np.linalg.inv(motion @ model.B[:, u]) @ motion @ model.A
    accelerate = model.A[v] + model.B[np.ix_(v, u)] @ hold
    follow = -np.linalg.pinv(accelerate @ inside, rcond=_RANK) @ accelerate
    slope = follow @ place
    slow = moving + mechanism @ slope
    found = (place + inside @ slope, slow + inside @ (follow @ slow))

    to_body = find_matrix(docking.get("chaser.attitude")).T
    to_body_from_a = find_matrix(docking.get("chaser.interface_attitude"))
    arm = docking.get("chaser.interface_position")
    arm = arm + to_body_from_a @ docking.get("relative.position")
    matrices = []
    for columns in found:
        force, torque = to_body @ hold[:3] @ columns, hold[3:6] @ columns
        torque -= np.cross(arm, force, axisb=0, axisc=0)
        matrices.append(-np.vstack([to_body_from_a.T @ each for each in (force, torque)]))
    return matrices[0], matrices[1]


def _list(owners: tuple[str, ...], members: tuple[str, ...], before: str = "") -> list[str]:
    """Return the names of vectors of three."""
    return [f"{before}{o}.{m}[{i}]" for o in owners for m in members for i in (1, 2, 3)]
