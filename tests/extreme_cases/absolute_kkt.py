"""Oracle: a mechanism in absolute coordinates of all bodies, with multipliers for every joint.

Nothing of the core's method is used: no joint-space inertia, no elimination, no closed form. Every
body, massless or not, has six unknown accelerations; every joint of the tree is a set of rows of
one constraint matrix (revolute 5, prismatic 5, free 0), and so is every cut (spherical 3,
universal 4, revolute 5, planar 2 rows within the plane) and every coupling (1: a sum of the rows
along the coordinates it ties). One dense saddle system gives all accelerations and all joint, cut
and coupling forces:

    [ M  K^T ] [  A  ]   [ applied forces - velocity terms ]
    [ K   0  ] [ -lambda ] = [ -gamma                       ]

Positions of a state are found by a Newton iteration of this file, from home in small steps.
Rows of cuts that follow from others at home are left out of K; what their forces add is a
self-stress (null space of K^T with all rows), and forces are compared up to self-stresses. Of a
revolute cut only the force is compared as such: the axes of its two moment factors are a matter of
choice, and the moment shows in the joint load of the terminal body.

Layout: body 0 is the base, body i+1 the i-th of the file; a twist is (velocity of the body origin,
angular velocity), everything in axes of the base at this instant. The first axis of every array
counts states, so that several states are solved in one call. Conventions of the files: the member
``conventions`` of ``tests/data/crank_nested.json``.

Run it to compare the core with the oracle on one file that holds ``mechanism`` and ``states``:

    PYTHONPATH=tests .venv/bin/python -m extreme_cases.absolute_kkt FILE.json [--newton]
"""

import argparse
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dockloop.native import core

CUT_ROWS = {"R3": 3, "R2": 4, "R1": 5, "R1_planar": 2}
FORCES = ("loop_force", "joint_load")  # what a self-stress may add to
QUANTITIES = ("q", "v", "a", *FORCES, "base_force", "base_moment", "reduced_inertia")
IDENTITY = np.eye(3)
RANK = 1e-7  # a row or column of which less is left counts as a sum of others


def cross(a, b):
    """Cross product over the last axis (numpy's own is several times slower on small arrays)."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    x = a1 * b2 - a2 * b1
    c = np.empty((*x.shape, 3))
    c[..., 0], c[..., 1], c[..., 2] = x, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return c


def skew(a):
    """Matrix of the cross product with a, for any leading axes."""
    m = np.zeros((*a.shape, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    m[..., 1, 0], m[..., 2, 0], m[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return m


def axis_rotation(axis, angle):
    """Rotation matrices about one unit axis by an array of angles."""
    k = skew(np.asarray(axis, float))
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return IDENTITY + s * k + (1.0 - c) * (k @ k)


def quaternion_matrix(q):
    """Rotation matrices of unit quaternions (w, x, y, z)."""
    k = skew(q[..., 1:])
    return IDENTITY + 2.0 * (q[..., 0, None, None] * k + k @ k)


def turned(rotation, vector):
    """Rotation times vector, for any leading axes."""
    return (rotation @ vector[..., None])[..., 0]


@dataclass
class Loop:
    """One row of the loop table, with indices instead of names."""

    name: str
    cut: str
    root: int
    terminal: int
    closing: int
    common: int  # lowest common ancestor of terminal and closing
    rows: slice
    on_terminal: np.ndarray
    on_closing: np.ndarray
    square_t: np.ndarray  # axes of the terminal body that stay square to axis_i, as rows
    axis_i: np.ndarray
    plane: np.ndarray | None  # rows, axes of the root
    dependent: list[int] = field(default_factory=list)


class Mechanism:
    """A mechanism document as arrays."""

    def __init__(self, document: dict) -> None:
        bodies = document["bodies"]
        self.gravity = np.array(document.get("gravity", [0.0, 0.0, 0.0]), float)
        self.names = ["base", *(body["name"] for body in bodies)]
        index = {name: i for i, name in enumerate(self.names)}
        self.parent = np.array([0, *(index[body["parent"]] for body in bodies)])
        joints = [body["joint"] for body in bodies]
        self.kind = ["", *(joint["type"] for joint in joints)]
        self.axis = np.array([(0.0, 0.0, 1.0), *(j.get("axis", (0, 0, 1)) for j in joints)], float)
        self.place_R = np.array([np.eye(3), *(j.get("rotation", np.eye(3)) for j in joints)])
        self.place_p = np.array([np.zeros(3), *(j.get("position", np.zeros(3)) for j in joints)])
        self.mass = np.array([0.0, *(body.get("mass", 0.0) for body in bodies)])
        self.com = np.array([np.zeros(3), *(body.get("com", np.zeros(3)) for body in bodies)])
        none = np.zeros((3, 3))
        self.inertia = np.array([none, *(body.get("inertia", none) for body in bodies)])
        self.count = len(bodies)
        self._number_coordinates()
        self.home_q = np.array(document.get("home_q", []), float)
        self.loops: list[Loop] = []
        row = 0
        for item in document.get("loops", []):
            rows = slice(row, row + CUT_ROWS[item["cut"]["type"]])
            self.loops.append(self._read_loop(item, index, rows))
            row = rows.stop
        self.cut_rows = row
        self._read_couplings(document.get("couplings", []), index)
        listed = [self.v_start[b] for loop in self.loops for b in loop.dependent]
        self._choose_dependents([*listed, *self.coupled])

    def _number_coordinates(self) -> None:
        free = [kind == "free" for kind in self.kind[1:]]
        self.q_start = np.concatenate([[0, 0], np.cumsum([7 if f else 1 for f in free])])[:-1]
        self.v_start = np.concatenate([[0, 0], np.cumsum([6 if f else 1 for f in free])])[:-1]
        self.nq = sum(7 if f else 1 for f in free)
        self.nv = sum(6 if f else 1 for f in free)
        self.body_of_v = np.repeat(np.arange(1, self.count + 1), [6 if f else 1 for f in free])
        self.q_of_v = np.array(
            [self.q_start[b] + (j - self.v_start[b]) for j, b in enumerate(self.body_of_v)], int
        )
        # moves[b, j]: velocity j moves body b.
        self.moves = np.zeros((self.count + 1, self.nv), bool)
        for b in range(1, self.count + 1):
            self.moves[b] = self.moves[self.parent[b]] | (self.body_of_v == b)
        # Six directions of each joint, free ones first: (linear, angular) in axes of the joint
        # (revolute, prismatic: fixed in the parent) or of the body (free).
        self.directions = np.zeros((self.count, 6, 6))
        self.is_free = np.zeros((self.count, 6), bool)
        for i in range(self.count):
            if free[i]:
                self.directions[i] = np.eye(6)
                self.is_free[i] = True
                continue
            e = self.axis[i + 1]
            across = np.linalg.svd(e[None])[2][1:]
            first, second = (slice(0, 3), slice(3, 6))  # constrained in full, in two directions
            if self.kind[i + 1] == "prismatic":
                first, second = second, first
            self.directions[i, 0, second] = e
            self.directions[i, 1:4, first] = np.eye(3)
            self.directions[i, 4:6, second] = across
            self.is_free[i, 0] = True
        self.body_axes = np.array(free)

    def ancestors(self, body: int) -> list[int]:
        """The body itself, its parent, ..., the base."""
        chain = [body]
        while chain[-1]:
            chain.append(int(self.parent[chain[-1]]))
        return chain

    def _read_couplings(self, items: list[dict], index: dict) -> None:
        """Couplings as equations ``ratios @ q = offset``, and the unit that a large ratio asks for.

        A joint geared up by 600 is measured in 600 rad where singular values are looked at.
        """
        self.coupling_names = [item["name"] for item in items]
        self.coupled = [int(self.v_start[index[item["dependent"]]]) for item in items]
        self.ratios = np.zeros((len(items), self.nv))
        self.unit = np.ones(self.nv)
        for row, item, j in zip(self.ratios, items, self.coupled, strict=True):
            for term in item["terms"]:
                row[self.v_start[index[term["joint"]]]] = -term["ratio"]
            self.unit[j] = max(1.0, np.max(np.abs(row)))
            row[j] = 1.0
        self.offset = np.array([item.get("offset", 0.0) for item in items], float)
        self.rows = self.cut_rows + len(items)

    def _choose_dependents(self, listed: list[int]) -> None:
        """Find the rows that do not follow from others at home, and as many dependent joints."""
        self.active, self.dep = list(range(self.rows)), listed
        if len(self.home_q):
            G = find_joint_jacobian(self, *find_poses(self, self.home_q[None]))[0]  # noqa: N806
            G = self.home_jacobian = G * self.unit  # noqa: N806
            self.active = sorted(find_pivots(G.T))
            if len(listed) > len(self.active):
                chosen = find_pivots(G[self.active][:, listed])
                self.dep = [listed[i] for i in sorted(chosen)]
        self.ind = [j for j in range(self.nv) if j not in set(self.dep)]
        self.freed = len(listed) - len(self.dep)
        self.redundant = self.rows - len(self.active)

    def take_independents(self, names: list[str]) -> None:
        """Use these joints as independent ones."""
        bodies = {self.names.index(name) for name in names}
        self.ind = [j for j in range(self.nv) if self.body_of_v[j] in bodies]
        self.dep = [j for j in range(self.nv) if self.body_of_v[j] not in bodies]

    def _read_loop(self, item: dict, index: dict, rows: slice) -> Loop:
        cut = item["cut"]
        terminal, closing = index[item["terminal"]], index[item["closing"]]
        above = self.ancestors(closing)
        dependent = [index[name] for name in item.get("dependent", [])]
        if "dependent" not in item:
            chain = self.ancestors(terminal)
            dependent = chain[: chain.index(index[item["first"]]) + 1]
        square = np.array(cut.get("axis_on_terminal", np.zeros((0, 3))), float).reshape(-1, 3)
        if cut["type"] == "R1":
            square = np.linalg.svd(square)[2][1:]
        return Loop(
            name=item["name"], cut=cut["type"], root=index[item["root"]],
            terminal=terminal, closing=closing, rows=rows, dependent=dependent,
            common=next(b for b in self.ancestors(terminal) if b in above),
            on_terminal=np.array(cut["point_on_terminal"], float),
            on_closing=np.array(cut["point_on_closing"], float),
            square_t=square, axis_i=np.array(cut.get("axis_on_closing", np.zeros(3)), float),
            plane=np.array(cut["plane_axes_in_root"], float)
            if cut["type"] == "R1_planar" else None,
        )  # fmt: skip


def find_pivots(matrix):
    """Columns that span the range of a matrix, greedily by the length of what is left of them."""
    left, chosen = matrix, []
    while len(chosen) < min(matrix.shape):
        lengths = np.linalg.norm(left, axis=0)
        j = int(np.argmax(lengths))
        if lengths[j] < RANK:
            break
        direction = left[:, j] / lengths[j]
        left = left - np.outer(direction, direction @ left)
        chosen.append(j)
    return chosen


def find_poses(m: Mechanism, q):
    """Orientations and origins of all bodies in the base, at coordinates q (states, nq)."""
    states = len(q)
    R = np.empty((states, m.count + 1, 3, 3))  # noqa: N806
    p = np.empty((states, m.count + 1, 3))
    R[:, 0], p[:, 0] = np.eye(3), 0.0
    for b in range(1, m.count + 1):
        at = m.q_start[b]
        own_R, own_p = m.place_R[b], m.place_p[b]  # noqa: N806
        if m.kind[b] == "revolute":
            own_R = own_R @ axis_rotation(m.axis[b], q[:, at])  # noqa: N806
        elif m.kind[b] == "prismatic":
            own_p = own_p + q[:, at, None] * (own_R @ m.axis[b])
        else:
            own_p = own_p + q[:, at : at + 3] @ own_R.T
            own_R = own_R @ quaternion_matrix(q[:, at + 3 : at + 7])  # noqa: N806
        up = m.parent[b]
        R[:, b] = R[:, up] @ own_R
        p[:, b] = p[:, up] + turned(R[:, up], own_p)
    return R, p


def find_cut_geometry(loop: Loop, R, p):  # noqa: N803
    """Cut points on both bodies in base axes, and what the kind of cut needs next to them."""
    at_t = p[:, loop.terminal] + turned(R[:, loop.terminal], loop.on_terminal)
    at_i = p[:, loop.closing] + turned(R[:, loop.closing], loop.on_closing)
    if loop.cut == "R1_planar":
        extra = loop.plane @ np.swapaxes(R[:, loop.root], -1, -2)
    else:
        square = loop.square_t @ np.swapaxes(R[:, loop.terminal], -1, -2)
        extra = (square, turned(R[:, loop.closing], loop.axis_i)[:, None])
    return at_t, at_i, extra


def find_residual(m: Mechanism, q, R, p):  # noqa: N803
    """What is left open: lengths, cosines of axes that stay square, units of coupled joints."""
    residual = np.empty((len(p), m.rows))
    residual[:, m.cut_rows :] = (q[:, m.q_of_v] @ m.ratios.T - m.offset) / m.unit[m.coupled]
    for loop in m.loops:
        at_t, at_i, extra = find_cut_geometry(loop, R, p)
        gap = at_t - at_i
        if loop.cut == "R1_planar":
            residual[:, loop.rows] = turned(extra, gap)
            continue
        residual[:, loop.rows][:, :3] = gap
        residual[:, loop.rows][:, 3:] = np.sum(extra[0] * extra[1], axis=-1)
    return residual


def find_joint_jacobian(m: Mechanism, R, p):  # noqa: N803
    """Rates of the residuals per joint velocity, for closing loops and judging them."""
    states = len(p)
    linear, angular = np.zeros((states, m.nv, 3)), np.zeros((states, m.nv, 3))
    for b in range(1, m.count + 1):
        at = m.v_start[b]
        if m.kind[b] == "free":
            linear[:, at : at + 3] = np.swapaxes(R[:, b], -1, -2)
            angular[:, at + 3 : at + 6] = np.swapaxes(R[:, b], -1, -2)
        else:
            target = angular if m.kind[b] == "revolute" else linear
            target[:, at] = R[:, b] @ m.axis[b]
    origin = p[:, m.body_of_v]
    G = np.empty((states, m.rows, m.nv))  # noqa: N806
    G[:, m.cut_rows :] = m.ratios / m.unit[m.coupled, None]
    for loop in m.loops:
        at_t, at_i, extra = find_cut_geometry(loop, R, p)
        sees_t, sees_i = m.moves[loop.terminal], m.moves[loop.closing]
        at = linear + cross(angular, at_t[:, None] - origin)
        rate = sees_t[:, None] * at
        at = linear + cross(angular, at_i[:, None] - origin)
        rate = rate - sees_i[:, None] * at
        if loop.cut == "R1_planar":
            turn = m.moves[loop.root][:, None] * angular
            rate = rate - cross(turn, (at_t - at_i)[:, None])
            G[:, loop.rows] = extra @ np.swapaxes(rate, -1, -2)
            continue
        G[:, loop.rows][:, :3] = np.swapaxes(rate, -1, -2)
        sign = sees_t.astype(float) - sees_i
        G[:, loop.rows][:, 3:] = sign * (cross(*extra) @ np.swapaxes(angular, -1, -2))
    return G


def close_states(m: Mechanism, q, steps: int = 4):
    """Dependent coordinates of states by Newton's method, led from home in small steps.

    Args:
        m: the mechanism.
        q: coordinates (states, nq); the dependent ones are not looked at.
        steps: how many from home.

    Returns:
        All coordinates, and per state the smallest singular value of the matrix of the dependent
        joints that was met on the way (angles in rad, lengths in m), 0 where Newton failed.
    """
    dep_q = m.q_of_v[m.dep]
    quaternions = [int(m.q_start[b]) + 3 for b in range(1, m.count + 1) if m.kind[b] == "free"]
    now = np.repeat(m.home_q[None], len(q), axis=0)
    margin = np.full(len(q), np.inf)
    for step in range(1, steps + 1):
        previous = now[:, dep_q]
        now = m.home_q + step / steps * (q - m.home_q)
        for at in quaternions:
            now[:, at : at + 4] /= np.linalg.norm(now[:, at : at + 4], axis=1, keepdims=True)
        now[:, dep_q] = previous
        for _ in range(12):
            R, p = find_poses(m, now)  # noqa: N806
            residual = find_residual(m, now, R, p)[:, m.active]
            matrix = find_joint_jacobian(m, R, p)[:, m.active][:, :, m.dep] * m.unit[m.dep]
            if not np.all(np.isfinite(matrix)):
                return now, np.zeros(len(q))
            margin = np.minimum(margin, np.linalg.svd(matrix, compute_uv=False)[:, -1])
            if np.min(margin) < 1e-8:
                return now, np.where(margin < 1e-8, 0.0, margin)
            now[:, dep_q] -= m.unit[m.dep] * np.linalg.solve(matrix, residual[..., None])[..., 0]
            open_by = np.max(np.abs(residual), axis=1)
            if np.max(open_by) < (1e-9 if step < steps else 2e-15):
                break
    return now, np.where(open_by < 1e-12, margin, 0.0)


class Motion:
    """Everything at given coordinates, velocities and loads; see `solve`."""

    def __init__(self, m: Mechanism, q) -> None:
        self.m = m
        self.q = q
        self.R, self.p = find_poses(m, q)
        self._make_rows()
        self._make_mass()

    def _make_rows(self) -> None:
        """Rows of all joints (free directions too) and of all cuts, for twists of all bodies."""
        m, R, p = self.m, self.R, self.p  # noqa: N806
        states, n = len(p), m.count
        child, up = np.arange(1, n + 1), m.parent[1:]
        frame = np.where(m.body_axes[:, None, None], R[:, 1:], R[:, up] @ m.place_R[1:])
        back = np.swapaxes(frame, -1, -2)
        self.lin = m.directions[:, :, :3] @ back  # rows, (states, n, 6, 3)
        self.ang = m.directions[:, :, 3:] @ back
        arm = (p[:, 1:] - p[:, up])[:, :, None]
        rows = np.zeros((states, n, 6, n + 1, 6))
        each = np.arange(n)
        self.on_child = on_child = np.concatenate([self.lin, self.ang], axis=-1)
        on_parent = np.concatenate([-self.lin, -cross(arm, self.lin) - self.ang], axis=-1)
        rows[:, each, :, child, :] = np.swapaxes(on_child, 0, 1)
        rows[:, each, :, up, :] = np.swapaxes(on_parent, 0, 1)
        self.joint_rows = rows.reshape(states, 6 * n, 6 * (n + 1))
        cut = np.zeros((states, m.cut_rows, n + 1, 6))
        self.cut_geometry = []
        for loop in m.loops:
            at_t, at_i, extra = find_cut_geometry(loop, R, p)
            self.cut_geometry.append((at_t, at_i, extra))
            point = extra if loop.cut == "R1_planar" else np.eye(3)[None]
            part = cut[:, loop.rows]
            k = point.shape[-2]
            for body, sign, at in ((loop.terminal, 1.0, at_t), (loop.closing, -1.0, at_i)):
                part[:, :k, body, :3] += sign * point
                part[:, :k, body, 3:] += sign * cross((at - p[:, body])[:, None], point)
            if loop.cut == "R1_planar":
                part[:, :, loop.root, 3:] -= cross((at_t - at_i)[:, None], point)
            else:
                part[:, 3:, loop.terminal, 3:] += cross(*extra)
                part[:, 3:, loop.closing, 3:] -= cross(*extra)
        cut = cut.reshape(states, m.cut_rows, 6 * (n + 1))
        coupling = m.ratios @ self.joint_rows[:, m.is_free.ravel()]
        self.cut_matrix = np.concatenate([cut, coupling], axis=1)

    def _make_mass(self) -> None:
        m, R = self.m, self.R  # noqa: N806
        h = m.mass[:, None] * turned(R, m.com)
        c = turned(R, m.com)
        steiner = (
            np.sum(h * c, axis=-1)[..., None, None] * np.eye(3) - h[..., None] * c[..., None, :]
        )
        self.h = h
        self.inertia = R @ m.inertia @ np.swapaxes(R, -1, -2) + steiner
        self.M = np.zeros((len(R), m.count, 6, 6))
        self.M[..., :3, :3] = m.mass[1:, None, None] * np.eye(3)
        self.M[..., :3, 3:] = -skew(h[:, 1:])
        self.M[..., 3:, :3] = skew(h[:, 1:])
        self.M[..., 3:, 3:] = self.inertia[:, 1:]

    def find_velocities(self, v_ind, base_w):
        """Twists of all bodies and all joint velocities from the independent ones."""
        m = self.m
        free = m.is_free.ravel()
        free_rows = self.joint_rows[:, free]
        rows = np.concatenate(
            [self.joint_rows[:, ~free], self.cut_matrix[:, m.active], free_rows[:, m.ind]], axis=1
        )
        base = np.concatenate([np.zeros_like(base_w), base_w], axis=-1)
        fixed = rows.shape[1] - len(m.ind)
        wanted = np.zeros((len(rows), rows.shape[1], 1 + len(m.ind)))
        wanted[:, fixed:, 0] = v_ind
        wanted[:, fixed:, 1:] = np.eye(len(m.ind))
        wanted[:, :, 0] -= turned(rows[:, :, :6], base)
        found = solve_refined(rows[:, :, 6:], wanted)
        self.twist = np.concatenate([base, found[:, :, 0]], axis=1)
        self.v = turned(free_rows, self.twist)
        maps = found[:, :, 1:]
        blocks = maps.reshape(len(maps), m.count, 6, len(m.ind))
        self.reduced_inertia = np.swapaxes(maps, -1, -2) @ (self.M @ blocks).reshape(maps.shape)
        return self.v

    def _joint_bias(self):
        """Rates of the rows of the joints, times twists."""
        m = self.m
        twist = self.twist.reshape(len(self.twist), -1, 6)
        vel, w = twist[..., :3], twist[..., 3:]
        up = m.parent[1:]
        r_dot = vel[:, 1:] - vel[:, up]
        w_up = w[:, up]
        sliding = r_dot - cross(w_up, self.p[:, 1:] - self.p[:, up])
        turning = w[:, 1:] - w_up
        w_frame = np.where(m.body_axes[:, None], w[:, 1:], w_up)[:, :, None]
        return (
            turned(self.lin, -cross(w_up, r_dot))
            + turned(cross(w_frame, self.lin), sliding)
            + turned(cross(w_frame, self.ang), turning)
        ).reshape(len(twist), -1)

    def _cut_bias(self):
        m = self.m
        twist = self.twist.reshape(len(self.twist), -1, 6)
        vel, w = twist[..., :3], twist[..., 3:]
        bias = np.empty((len(twist), m.cut_rows))

        def point(body, at):
            arm = at - self.p[:, body]
            swing = cross(w[:, body], arm)
            return vel[:, body] + swing, cross(w[:, body], swing)

        for loop, (at_t, at_i, extra) in zip(m.loops, self.cut_geometry, strict=True):
            vel_t, acc_t = point(loop.terminal, at_t)
            vel_i, acc_i = point(loop.closing, at_i)
            acc, gap, gap_dot = acc_t - acc_i, at_t - at_i, vel_t - vel_i
            if loop.cut == "R1_planar":
                w_root = w[:, loop.root]
                turning = cross(w_root[:, None], extra)
                bias[:, loop.rows] = turned(extra, acc - cross(w_root, gap_dot)) + turned(
                    turning, gap_dot - cross(w_root, gap)
                )
                continue
            bias[:, loop.rows][:, :3] = acc
            a, b = extra
            w_t, w_i = w[:, loop.terminal, None], w[:, loop.closing, None]
            n_dot = cross(cross(w_t, a), b) + cross(a, cross(w_i, b))
            bias[:, loop.rows][:, 3:] = np.sum(n_dot * (w_t - w_i), axis=-1)
        return bias

    def find_accelerations(self, tau, external, base_a, base_alpha):
        """Accelerations and all forces; `external` is (states, bodies + 1, 6) at body origins."""
        m = self.m
        states, n = len(tau), m.count
        free = m.is_free.ravel()
        joint_bias = self._joint_bias()
        twist = self.twist.reshape(states, -1, 6)
        w = twist[..., 3:]
        load = external.copy()
        load[..., :3] += m.mass[:, None] * m.gravity - cross(w, cross(w, self.h))
        load[..., 3:] += cross(self.h, m.gravity) - cross(w, turned(self.inertia, w))
        actuated = self.joint_rows[:, free]
        joints = self.joint_rows[:, ~free]
        every = np.concatenate([joints, self.cut_matrix], axis=1)
        used = [*range(joints.shape[1]), *(joints.shape[1] + row for row in m.active)]
        K = every[:, used]  # noqa: N806
        base = np.concatenate([base_a, base_alpha], axis=-1)
        size = 6 * n + K.shape[1]
        saddle = np.zeros((states, size, size))
        for i in range(n):
            saddle[:, 6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = self.M[:, i]
        saddle[:, 6 * n :, : 6 * n] = K[:, :, 6:]
        saddle[:, : 6 * n, 6 * n :] = np.swapaxes(K[:, :, 6:], -1, -2)
        right = np.empty((states, size))
        pushed = turned(np.swapaxes(actuated, -1, -2), tau)
        right[:, : 6 * n] = load[:, 1:].reshape(states, -1) + pushed[:, 6:]
        coupling_bias = joint_bias[:, free] @ m.ratios.T
        gamma = np.concatenate([joint_bias[:, ~free], self._cut_bias(), coupling_bias], axis=1)
        right[:, 6 * n :] = -gamma[:, used] - turned(K[:, :, :6], base)
        solution = solve_refined(saddle, right[..., None])[..., 0]
        acceleration = np.concatenate([base, solution[:, : 6 * n]], axis=1)
        multiplier = np.zeros(every.shape[:2])
        multiplier[:, used] = -solution[:, 6 * n :]
        self.a = turned(actuated, acceleration) + joint_bias[:, free]
        on_base = np.swapaxes(every[:, :, :6], -1, -2)
        self.on_base = turned(on_base, multiplier) + pushed[:, :6]
        self.forces = self._name_forces(multiplier, tau)
        self.self_stresses = []
        if m.redundant:
            null = np.linalg.svd(np.swapaxes(every[:, :, 6:], -1, -2))[2][:, -m.redundant :]
            none = np.zeros_like(tau)
            self.self_stresses = [self._name_forces(null[:, i], none) for i in range(m.redundant)]

    def _name_forces(self, multiplier, tau):
        """Forces of cuts and couplings and loads of joints, as ``check --states`` gives them."""
        m = self.m
        free = m.is_free.ravel()
        fixed = int(np.sum(~free))
        cut_force, coupling = np.split(multiplier[:, fixed:], [m.cut_rows], axis=1)
        loop_force = {name: coupling[:, [i]] for i, name in enumerate(m.coupling_names)}
        for loop in m.loops:
            force = cut_force[:, loop.rows].copy()
            if loop.cut != "R1_planar":
                back = np.swapaxes(self.R[:, loop.common], -1, -2)
                force[:, :3] = turned(back, force[:, :3])
            loop_force[loop.name] = force[:, :3] if loop.cut == "R1" else force
        strength = np.empty((len(multiplier), 6 * m.count))
        strength[:, ~free] = multiplier[:, :fixed]
        strength[:, free] = tau + coupling @ m.ratios
        strength = strength.reshape(len(multiplier), m.count, 6)
        load = turned(np.swapaxes(self.on_child, -1, -2), strength)
        joint_load = {
            name: {"force": load[:, i, :3], "moment": load[:, i, 3:]}
            for i, name in enumerate(m.names[1:])
        }
        return {"loop_force": loop_force, "joint_load": joint_load}


def pick_state(values, state: int):
    """Figures of one state out of dictionaries and lists of arrays."""
    if isinstance(values, dict):
        return {key: pick_state(value, state) for key, value in values.items()}
    if isinstance(values, list):
        return [pick_state(value, state) for value in values]
    return values[state]


def solve_refined(matrix, right):
    """Solve linear systems and correct the solution with residuals of extended precision."""
    inverse = np.linalg.inv(matrix)
    exact, wanted = matrix.astype(np.longdouble), right.astype(np.longdouble)
    solution = inverse @ right
    for _ in range(2):
        short = (wanted - exact @ solution.astype(np.longdouble)).astype(float)
        solution = solution + inverse @ short
    return solution


def read_states(m: Mechanism, states: list[dict]) -> dict:
    """Arrays of the members of states, one row per state."""
    index = {name: i for i, name in enumerate(m.names)}
    base = [state.get("base_motion", {}) for state in states]
    external = np.zeros((len(states), m.count + 1, 6))
    for row, state in zip(external, states, strict=True):
        for item in state.get("external", []):
            row[index[item["body"]]] += [*item["force"], *item.get("moment", (0.0, 0.0, 0.0))]
    arrays = {key: np.array([state[key] for state in states]) for key in ("q", "tau")}
    arrays["v_ind"] = np.array([state["v_independent"] for state in states]).reshape(
        len(states), len(m.ind)
    )
    for key in ("angular_velocity", "angular_acceleration", "linear_acceleration"):
        arrays[key] = np.array([motion.get(key, np.zeros(3)) for motion in base], float)
    arrays["external"] = external
    return arrays


def solve(m: Mechanism, states: list[dict], q=None) -> list[dict]:
    """Solve states; results have the names that ``check --states`` gives them.

    Args:
        m: the mechanism.
        states: with ``q`` (dependent coordinates included), velocities and loads.
        q: closed coordinates instead of those of the states.
    """
    given = read_states(m, states)
    motion = Motion(m, given["q"] if q is None else q)
    v = motion.find_velocities(given["v_ind"], given["angular_velocity"])
    motion.find_accelerations(
        given["tau"], given["external"], given["linear_acceleration"],
        given["angular_acceleration"],
    )  # fmt: skip
    return [
        {
            "q": motion.q[s],
            "v": v[s],
            "a": motion.a[s],
            **pick_state(motion.forces, s),
            "self_stresses": pick_state(motion.self_stresses, s),
            "base_force": motion.on_base[s, :3],
            "base_moment": motion.on_base[s, 3:],
            "reduced_inertia": motion.reduced_inertia[s],
        }
        for s in range(len(states))
    ]


def find_margin(m: Mechanism) -> tuple[float, float]:
    """How well home determines the motion.

    Returns:
        Smallest singular value of the matrix of all dependent joints at home (angles in rad,
        lengths in m), and the condition of the reduced inertia scaled to a unit diagonal.
    """
    q = m.home_q[None]
    if m.dep:
        matrix = m.home_jacobian[m.active][:, m.dep]
        if len(m.dep) < len(m.active):
            return 0.0, np.inf
        smallest = float(np.linalg.svd(matrix, compute_uv=False)[-1])
        if smallest < 1e-6:
            return smallest, np.inf
    else:
        smallest = np.inf
    motion = Motion(m, q)
    motion.find_velocities(np.zeros((1, len(m.ind))), np.zeros((1, 3)))
    inertia = motion.reduced_inertia[0]
    scale = np.sqrt(np.diag(inertia))
    if not len(scale) or np.min(scale) < 1e-6:
        return smallest, np.inf
    return smallest, float(np.linalg.cond(inertia / scale / scale[:, None]))


def flat(value):
    """All numbers of nested lists and dictionaries, in order of the keys."""
    if isinstance(value, dict):
        return np.concatenate([np.zeros(0), *(flat(value[key]) for key in sorted(value))])
    return np.ravel(np.array(value, dtype=float))


def find_differences(result: dict, wanted: dict) -> dict:
    """Difference of each quantity that is there; of forces less the self-stress nearest to it."""
    differences = {}
    for key in (key for key in QUANTITIES if key in wanted):
        ours = result[key]
        if key == "loop_force":  # without moment factors of a revolute cut
            ours = {name: ours[name][: len(force)] for name, force in wanted[key].items()}
        differences[key] = flat(ours) - flat(wanted[key])
    if wanted.get("self_stresses"):
        stresses = [[flat(stress[key]) for key in FORCES] for stress in wanted["self_stresses"]]
        span = np.array([np.concatenate(parts) for parts in stresses]).T
        both = np.concatenate([differences[key] for key in FORCES])
        both -= span @ np.linalg.lstsq(span, both, rcond=None)[0]
        parts = np.split(both, [len(differences["loop_force"])])
        differences |= dict(zip(FORCES, parts, strict=True))
    return differences


def find_errors(results: list[dict], expected: list[dict]) -> dict[str, float]:
    """Largest difference of each quantity, relative to its largest figure (or to 1 if smaller).

    Base loads are sums of what acts within: they are compared on the scale of the cut forces too,
    which stays when they vanish, as under a mechanism that floats.
    """
    worst = dict.fromkeys((key for key in QUANTITIES if key in expected[0]), 0.0)
    for result, wanted in zip(results, expected, strict=True):
        for key, difference in find_differences(result, wanted).items():
            if len(difference):
                theirs = flat(wanted[key])
                within = flat(wanted["loop_force"]) if key.startswith("base_") else theirs
                scale = max(1.0, *np.abs(theirs), *np.abs(within))
                error = np.max(np.abs(difference)) / scale
                worst[key] = float(np.maximum(worst[key], error))  # keeps NaN, as max() does not
    return worst


def find_gap(m: Mechanism, results: list[dict]) -> float:
    """Largest residual of any row at the coordinates of results, by the kinematics of this file."""
    if not m.rows:
        return 0.0
    q = np.array([result["q"] for result in results])
    return float(np.max(np.abs(find_residual(m, q, *find_poses(m, q)))))


def run_check(file: Path, newton: bool = False) -> list[dict]:
    """Evaluate the states in `file` with the core."""
    text = file.read_text()
    return core.evaluate(text, file, text, file, newton=newton)


def follow_core(m: Mechanism, file: Path) -> None:
    """Where more joints are listed than rows are left, take the independent ones of the core."""
    if m.freed:
        m.take_independents(core.check(file.read_text(), file)["independent"])


def main() -> None:
    """Compare core and oracle on one file."""
    parser = argparse.ArgumentParser(description="compare the core with the absolute oracle")
    parser.add_argument("file", type=Path, help="JSON with the members mechanism and states")
    parser.add_argument("--newton", action="store_true", help="the core uses no closed form")
    options = parser.parse_args()
    document = json.loads(options.file.read_text())
    m = Mechanism(document["mechanism"])
    if not len(m.home_q):
        m.home_q = np.array(document["home_q"], float)
    follow_core(m, options.file)
    smallest, condition = find_margin(m)
    print(f"at home: smallest singular value {smallest:.3g}, condition of inertia {condition:.3g}")
    q, margin = close_states(m, read_states(m, document["states"])["q"])
    print("states: smallest singular values", *(f"{value:.3g}" for value in margin))
    results = run_check(options.file, options.newton)
    print(f"largest gap at the coordinates of the core {find_gap(m, results):.3g}")
    for key, error in find_errors(results, solve(m, document["states"], q)).items():
        print(f"{key:16} {error:.3g}")


if __name__ == "__main__":
    main()
