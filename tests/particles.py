"""Vehicles with parts as clouds of particles: a dense reference of their equations of motion.

A rigid body is seven particles with its mass, centre and inertia. Coordinates are the position and
rotation vector of the vehicle and the coordinates of its parts. The places r of all particles
follow from them. Then (sum m J'J) a = Q - sum m J' (dJ/dt v), with J = dr/dx by complex steps.
Nothing here knows trees, joints or momenta.
"""

import numpy as np
from scipy.integrate import solve_ivp

TINY, SHORT = 1e-30, 1e-5
JOINTS = {"ball": ["turn"] * 3, "elastic": ["slide"] * 3 + ["turn"] * 3}


def turn(w):
    """Return the matrix of a rotation vector, real or complex."""
    w = np.asarray(w)
    angle2 = w @ w
    k = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    if abs(angle2) < 1e-12:
        return np.eye(3) + k + k @ k / 2
    angle = np.sqrt(angle2)
    return np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle2 * k @ k


def quaternion_matrix(q):
    """Return the matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def make_particles(body):
    """Return masses and places (n x 3) with mass, centre of mass and inertia of a body."""
    xx, yy, zz, xy, xz, yz = body.get("inertia", [0.0] * 6)
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    m = body["mass"] / 7
    spread = np.sqrt(np.maximum(moments.sum() / 2 - moments, 0) / (2 * m))
    arms = np.vstack([np.zeros(3), (axes * spread).T, -(axes * spread).T])
    return np.full(7, m), arms + np.array(body.get("com", [0.0] * 3))


class Cloud:
    """One vehicle with its parts.

    Args:
        vehicle: section of a scene with ``part`` and ``adapter``; stiffness and damping are given.
    """

    def __init__(self, vehicle):
        """Collect the particles of all bodies."""
        self.parts = [*vehicle.get("part", []), *filter(None, [vehicle.get("adapter")])]
        bodies = [{"mass": vehicle["mass"], "inertia": vehicle["inertia"]}, *self.parts]
        self.particles = [make_particles(body) for body in bodies]
        self.mass = np.repeat(np.concatenate([m for m, _ in self.particles]), 3)
        self.kinds = [JOINTS.get(part["joint"], [part["joint"]]) for part in self.parts]
        as_list = [
            [np.ravel(part.get(key, [0.0] * len(kinds))) for key in ("stiffness", "damping")]
            for part, kinds in zip(self.parts, self.kinds, strict=True)
        ]
        self.stiffness, self.damping = (np.concatenate([p[k] for p in as_list]) for k in (0, 1))
        self.size = 6 + len(self.stiffness)

    def places(self, x):
        """Return the places of all particles in one vector."""
        rotation, p = turn(x[3:6]), x[:3]
        all_places = [p + self.particles[0][1] @ rotation.T]
        at = 6
        for part, kinds, (_, arms) in zip(self.parts, self.kinds, self.particles[1:], strict=True):
            turned = rotation @ quaternion_matrix(part.get("attitude", [1, 0, 0, 0]))
            o = p + rotation @ np.array(part.get("position", [0.0] * 3))
            for k, kind in enumerate(kinds):
                axis = np.array(part["axis"]) if "axis" in part else np.eye(3)[k % 3]
                if kind in ("slide",):
                    o = o + turned @ axis * x[at]
                else:
                    turned = turned @ turn(axis * x[at])
                at += 1
            all_places.append(o + arms @ turned.T)
        return np.concatenate(all_places).ravel()

    def jacobian(self, x):
        """Return dr/dx by complex steps, exact to rounding."""
        columns = [self.places(x + 1j * TINY * e).imag / TINY for e in np.eye(self.size)]
        return np.array(columns).T

    def rates(self, x, v):
        """Return the accelerations."""
        jac = self.jacobian(x)
        turning = (self.jacobian(x + SHORT * v) - self.jacobian(x - SHORT * v)) @ v / (2 * SHORT)
        force = -jac.T @ (self.mass * turning)
        force[6:] -= self.stiffness * x[6:] + self.damping * v[6:]
        return np.linalg.solve(jac.T @ (self.mass[:, None] * jac), force)

    def run(self, x, v, stop, rtol=1e-10):
        """Integrate from coordinates and rates; returns those at the end."""

        def f(_, z):
            return np.concatenate([z[self.size :], self.rates(z[: self.size], z[self.size :])])

        found = solve_ivp(
            f, (0, stop), np.concatenate([x, v]), method="DOP853", rtol=rtol, atol=1e-12
        )
        return np.split(found.y[:, -1], 2)
