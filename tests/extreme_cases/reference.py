"""Motions of two of the problems, computed without anything of the core.

`integrate` is an extrapolation method (Gragg, Bulirsch and Stoer). `Hexapod` is the free-floating
hexapod of two bodies and six thin legs in twelve velocities of the world frame (Kane's equations
with attitudes as quaternions). `Bumper` is a vehicle on a rail with a ring on a spring in front of
it, which meets a wall.
"""

import numpy as np

_SUBSTEPS = np.array([2, 4, 6, 8, 10, 12, 14, 16])


def integrate(rate, y, span, *, tolerance, step=None):
    """Integrate y' = rate(y) over `span` [s]; returns the end state.

    Args:
        rate: function of the state.
        y: start state.
        span: duration.
        tolerance: error of a step that is accepted.
        step: first step; default: the whole span.
    """
    y, t = np.array(y, float), 0.0
    h = span if step is None else min(step, span)
    while t < span * (1.0 - 1e-15):
        h = min(h, span - t)
        row = []
        for k, n in enumerate(_SUBSTEPS):
            small = h / n
            before, now = y, y + small * rate(y)
            for _ in range(n - 1):
                before, now = now, before + 2.0 * small * rate(now)
            new = [0.5 * (before + now + small * rate(now))]
            for j in range(k):
                ratio = (n / _SUBSTEPS[k - 1 - j]) ** 2
                new.append(new[j] + (new[j] - row[j]) / (ratio - 1.0))
            row = new
            error = np.max(np.abs(row[-1] - row[-2])) if k > 2 else np.inf
            if error <= tolerance or not np.isfinite(row[-1]).all():
                break
        if error <= tolerance:
            y, t = row[-1], t + h
            h *= 1.6 if k < 6 else 1.0
        else:
            h *= 0.4
            if h < 1e-12 * span:
                raise ArithmeticError(f"no step is small enough at {t} s")
    return y


def find_rotations(q):
    """Rotation matrix of a quaternion (w, x, y, z), whatever its length."""
    w, x, y, z = q / np.sqrt(q @ q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _cross(a, b):
    """Cross products over the last axis."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0), -1)


def _skew(a):
    """Matrices of the cross product with each row of a."""
    m = np.zeros((*a.shape, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return m - np.swapaxes(m, -1, -2)


class Hexapod:
    """Two bodies joined by six legs of two thin parts each; state: p, q, v, w of base and ring.

    Attributes:
        mass: of base and ring [kg].
        inertia: principal moments of base and ring, centres of mass at their origins [kg m2].
        ends: leg ends on base and ring, shape (2, 6, 3) [m].
        part: mass, centre and transverse inertia of the lower and the upper part of a leg.
        spring: stiffness [N/m], damping [N s/m], free length [m] of all legs.
    """

    def __init__(self, mass, inertia, ends, part, spring):
        self.mass, self.inertia, self.ends = mass, inertia, np.array(ends, float)
        self.part, self.spring = part, spring

    def find_rates(self, y):
        """Rates of the state (26 numbers, world frame)."""
        rotation = [find_rotations(y[3:7]), find_rotations(y[16:20])]
        velocity = np.concatenate((y[7:13], y[20:26]))
        spin = (velocity[3:6], velocity[9:12])
        arms = [self.ends[i] @ rotation[i].T for i in (0, 1)]
        to_end = np.zeros((2, 6, 3, 12))  # velocity of the leg ends by velocities of the bodies
        for i in (0, 1):
            to_end[i, :, :, 6 * i : 6 * i + 3] = np.eye(3)
            to_end[i, :, :, 6 * i + 3 : 6 * i + 6] = -_skew(arms[i])
        turning = [_cross(spin[i], _cross(spin[i], arms[i])) for i in (0, 1)]
        d = y[13:16] + arms[1] - y[:3] - arms[0]
        length = np.sqrt(np.sum(d * d, -1))[:, None]
        u = d / length
        to_d = to_end[1] - to_end[0]
        d_rate = to_d @ velocity
        length_rate = np.sum(u * d_rate, -1)[:, None]
        u_rate = (d_rate - u * length_rate) / length
        bias_d = turning[1] - turning[0]
        across = bias_d - u * np.sum(u * bias_d, -1)[:, None]
        bias_u = (across - 2 * length_rate * u_rate) / length
        bias_u -= u * np.sum(u_rate * u_rate, -1)[:, None]
        along = np.einsum("li,lij->lj", u, to_d)
        to_u = (to_d - u[:, :, None] * along[:, None, :]) / length[:, :, None]

        stiffness, damping, free = self.spring
        push = -stiffness * (length - free) - damping * length_rate
        matrix, force = np.zeros((12, 12)), np.sum(push * along, 0)
        for i, sign in ((0, 1.0), (1, -1.0)):
            mass, centre, transverse = self.part[i]
            to_centre = to_end[i] + sign * centre * to_u
            bias = turning[i] + sign * centre * bias_u
            matrix += mass * np.einsum("lki,lkj->ij", to_centre, to_centre)
            # Of a thin rod only u x u' counts; its square is that of u'.
            matrix += transverse * np.einsum("lki,lkj->ij", to_u, to_u)
            force -= mass * np.einsum("lki,lk->i", to_centre, bias)
            force -= transverse * np.einsum("lki,lk->i", to_u, bias_u)
            world = rotation[i] * self.inertia[i] @ rotation[i].T
            a = 6 * i
            matrix[a : a + 3, a : a + 3] += self.mass[i] * np.eye(3)
            matrix[a + 3 : a + 6, a + 3 : a + 6] += world
            force[a + 3 : a + 6] -= np.cross(spin[i], world @ spin[i])
        acceleration = np.linalg.solve(matrix, force)
        rates = np.empty(26)
        for i in (0, 1):
            at, q = 13 * i, y[13 * i + 3 : 13 * i + 7]
            rates[at : at + 3] = velocity[6 * i : 6 * i + 3]
            rates[at + 3] = -0.5 * spin[i] @ q[1:]
            rates[at + 4 : at + 7] = 0.5 * (q[0] * spin[i] + np.cross(spin[i], q[1:]))
            rates[at + 7 : at + 13] = acceleration[6 * i : 6 * i + 6]
        return rates

    def find_fastest(self):
        """Bounds of the fastest vibration and decay [1/s], the base held."""
        ring = min(self.mass[1], min(self.inertia[1]) / np.max(np.sum(self.ends[1] ** 2, -1)))
        light = min(ring, self.mass[0])
        return np.sqrt(6 * self.spring[0] / light), 6 * self.spring[1] / light


class Bumper:
    """Vehicle and ring on one line, a spring-damper between them, a wall at 0 for the ring.

    Attributes:
        mass: of vehicle and ring [kg]; None for a vehicle that does not move.
        spring: stiffness [N/m] and damping [N s/m].
        wall: stiffness [N/m], toe [m], damping factor [s/m].
        preload: force of the spring at rest length, pushing the ring to the wall [N].
    """

    def __init__(self, mass, spring, wall, preload=0.0):
        self.mass, self.spring, self.wall, self.preload = mass, spring, wall, preload

    def push(self, depth, rate):
        """Force of the wall: parabola up to the toe, then a line; never pulls."""
        stiffness, toe, factor = self.wall
        if depth <= 0.0:
            return 0.0
        elastic = depth * depth / (2 * toe) if depth < toe else depth - toe / 2
        return stiffness * elastic * max(0.0, 1.0 + factor * rate)

    def find_rates(self, y):
        """Rates of (vehicle, ring, their speeds)."""
        vehicle, ring, v, w = y
        pull = self.spring[0] * (vehicle - ring) + self.spring[1] * (v - w) + self.preload
        body = 0.0 if self.mass[0] is None else -pull / self.mass[0]
        return v, w, body, (pull - self.push(ring, w)) / self.mass[1]

    def run(self, y, span, pieces):
        """States at the ends of equal pieces of the span.

        Classic Runge-Kutta steps of 1/200 of the fastest time constant; a step in which the ring
        meets an edge of the force law is divided there, so that every step sees smooth forces.
        """
        stiffness = self.spring[0] + self.wall[0]
        fastest = (stiffness / self.mass[1]) ** 0.5 + self.spring[1] / self.mass[1]
        size, states = 0.005 / fastest, [tuple(y)]
        for _ in range(pieces):
            y, left = states[-1], span / pieces
            while left > 1e-14 * span:
                h = min(size, left)
                new = self._step(y, h)
                if self._region(new[1]) != self._region(y[1]):
                    low = 0.0
                    for _ in range(45):
                        middle = 0.5 * (low + h)
                        inside = self._region(self._step(y, middle)[1]) == self._region(y[1])
                        low, h = (middle, h) if inside else (low, middle)
                    new = self._step(y, h)
                y, left = new, left - h
            states.append(y)
        return np.array(states)

    def _region(self, depth):
        """Outside, in the toe, or beyond it."""
        return (depth > 0.0) + (depth > self.wall[1])

    def _step(self, y, h):
        """State after one Runge-Kutta step."""
        a = self.find_rates(y)
        b = self.find_rates([x + h / 2 * r for x, r in zip(y, a, strict=True)])
        c = self.find_rates([x + h / 2 * r for x, r in zip(y, b, strict=True)])
        d = self.find_rates([x + h * r for x, r in zip(y, c, strict=True)])
        return tuple(
            x + h / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(y, a, b, c, d, strict=True)
        )
