"""Two impacts against an independent engine: a probe head in a cone, and a ring on a ring.

Both vehicles are free rigid bodies; the mechanism has no bodies. MuJoCo finds contacts by its own
collision code, moves its own bodies, and applies the forces at its own contact points. Its contact
solver is off, since a solver of constraints is another law. Instead a penalty law is written again
here, from the formulas of src/contact/README.md. Written to tests/validation/impacts.md.

    .venv/bin/pip install mujoco
    .venv/bin/python tests/studies/impacts.py           # a minute
"""

import datetime
import json
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import dockloop as dl
from dockloop.base.paths import ROOT
from page import Table, write_page

STIFFNESS, TOE = 2e6, 5e-5  # N/m, m
STEP = 1e-4  # s, of MuJoCo; results of dockloop are recorded at the same times
STOP = 1.0  # s
SPEED = 0.05  # m/s, so slow that the barrier behind half of the rounding takes no part
ACTIVE, PASSIVE = (4.0, 0.0, 0.0), (-15.0, 0.0, 0.0)  # m, docking interfaces on the vehicles
THICK = 0.05  # m, half of the plates of MuJoCo
HEAD, WALL, RING = 0.04, 0.002, 0.03  # m, rounding radii
CONE = ((0.0, 0.40), (0.205, 0.045))  # m, (x, radius)
RADIUS, NODES = 0.6, 24  # m, of the ring and its points
SCENE = """
title = "{name}"
[chaser]
mass = 25e3
inertia = [60.5e3, 132e3, 132e3, 0, 0, 0]
interface_position = [4, 0, 0]
[target]
mass = 350e3
inertia = [4e7, 8e7, 8e7, 0, 0, 0]
interface_position = [-15, 0, 0]
[mechanism]
name = "rigid"
[initial]
at = "first_contact"
approach_time = 0.05
closing_speed = {speed}
{conditions}
[solver]
rtol = 1e-12
atol_position = 1e-14
atol_velocity = 1e-14
atol_energy = 1e-13
[experiment]
stop = {stop}
step = {step}
[outputs]
groups = ["relative", "capture", "contact", "energy"]
"""

TEXT = """\
Both vehicles are free rigid bodies: 25 t with the head or the ring, 350 t with the cone or the
other ring. The mechanism has no bodies. Contact has no friction. MuJoCo begins at the start state
that dockloop has recorded. MuJoCo finds contacts by its own collision code and moves its own
bodies. At these contacts the study applies the penalty law, written a second time from the formulas
of `src/contact/README.md`. Both programs record the force on the target every 0.1 ms.
"""
DIFFERENCES = """\
What differs between the two programs:

* The solver of MuJoCo for contacts is off: it solves for accelerations, which is another law.
* MuJoCo has a flat plate in the place of the cone. The plate is tangent to the cone where the head
  meets it. All motion is in one plane, in which the section of the cone is the same straight line.
* MuJoCo has a large plate in the place of the ring face; no point leaves that face.
* MuJoCo takes Runge-Kutta steps of 0.1 ms; dockloop chooses its steps, at a tolerance of 1e-12.
* Begin and duration are counted in samples of 0.1 ms.
* No depth is more than half of the roundings, so the barrier takes no part."""


@dataclass
class Impact:
    """One impact: its surfaces for both programs.

    Attributes:
        name: for the page.
        conditions: lines of ``[initial]``.
        active: cores on the chaser, as in a mechanism.
        passive: cores on the target.
        spheres: their centres on the chaser, axes of A [m], shape (spheres, 3).
        radius: of the spheres [m].
        face: a point of the flat face on the target, axes of P [m].
        normal: of the face, towards the chaser.
    """

    name: str
    conditions: str
    active: list
    passive: list
    spheres: np.ndarray
    radius: float
    face: np.ndarray
    normal: np.ndarray


def make_head() -> Impact:
    """Return a head that meets the wall of the cone at -y: all motion is in the plane x, y."""
    along = np.subtract(CONE[1], CONE[0])
    along /= np.linalg.norm(along)
    normal = np.array([along[1], along[0], 0.0])  # towards axis and mouth
    middle = np.mean(CONE, axis=0)
    return Impact(
        "probe head in a cone",
        "lateral_offset = 0.2",
        [{"name": "head", "kind": "point", "rounding": HEAD}],
        [{"name": "wall", "kind": "revolution", "profile": CONE, "rounding": WALL}],
        np.zeros((1, 3)),
        HEAD,
        np.array([middle[0], -middle[1], 0.0]) + WALL * normal,
        normal,
    )


def make_ring() -> Impact:
    """Return a ring of points that meets the face of another ring with one edge first."""
    angles = np.arange(NODES) * 2.0 * math.pi / NODES
    points = np.column_stack([0.0 * angles, RADIUS * np.cos(angles), RADIUS * np.sin(angles)])
    face = [[0.0, RADIUS - 0.1], [0.0, RADIUS + 0.1]]
    return Impact(
        "ring on ring, one edge first",
        "pitch_yaw_deg = 2.0\npitch_yaw_direction_deg = 90.0",
        [
            {
                "name": f"node{number}",
                "group": "ring",
                "kind": "point",
                "position": point,
                "rounding": RING,
            }
            for number, point in enumerate(points.tolist(), 1)
        ],
        [{"name": "wall", "kind": "revolution", "profile": face, "rounding": RING}],
        points,
        RING,
        np.array([-RING, 0.0, 0.0]),
        np.array([-1.0, 0.0, 0.0]),
    )


def run_dockloop(impact: Impact, damping: float) -> dl.Result:
    """Run an impact in dockloop; the record begins with the start of both programs."""
    law = {"stiffness": STIFFNESS, "toe": TOE, "damping": damping, "friction_coefficient": 0.0}
    law["friction_speed"] = 1e-3
    first = impact.active[0]
    pairs = [[first.get("group", first["name"]), "wall"]]
    contact = {"type": "surfaces", "active": impact.active, "passive": impact.passive}
    mechanism = {"name": "rigid", "contact": {**contact, "pairs": pairs, "law": law}}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "rigid.json").write_text(json.dumps(mechanism))
        scene = Path(folder) / "impact.toml"
        scene.write_text(
            SCENE.format(
                name=impact.name, conditions=impact.conditions, speed=SPEED, stop=STOP, step=STEP
            )
        )
        return dl.run(scene)


def make_model(impact: Impact) -> "mujoco.MjModel":
    """Return both vehicles for MuJoCo; contacts are found, but its solver leaves them out."""
    n = impact.normal
    centre = list_numbers(np.array(PASSIVE) + impact.face - THICK * n)
    spheres = "".join(
        f'<geom type="sphere" size="{impact.radius}" pos="{list_numbers(np.array(ACTIVE) + c)}"/>'
        for c in impact.spheres
    )
    across = list_numbers([*n, -n[1], n[0], 0.0])
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP}" integrator="RK4" gravity="0 0 0"/><worldbody>
        <body name="chaser"><freejoint/>
          <inertial pos="0 0 0" mass="25e3" diaginertia="60.5e3 132e3 132e3"/>{spheres}</body>
        <body name="target"><freejoint/>
          <inertial pos="0 0 0" mass="350e3" diaginertia="4e7 8e7 8e7"/>
          <geom type="box" size="{THICK} 1 1" pos="{centre}" xyaxes="{across}"/></body>
        </worldbody></mujoco>"""
    )
    # Contacts are found below 0.95 m, and left to the solver below -0.05 m: never.
    model.geom_margin[:], model.geom_gap[:] = -0.05, 1.0
    return model


def list_numbers(values: list | np.ndarray) -> str:
    """Return numbers as MuJoCo reads them."""
    return " ".join(repr(float(value)) for value in values)


def run_mujoco(impact: Impact, damping: float, start: dict) -> tuple[np.ndarray, np.ndarray]:
    """Run an impact in MuJoCo from the start of the other program.

    Returns:
        The force on the target at every step, shape (points, 3) [N], and the velocities of chaser
        and target at the end, shape (2, 6): linear in inertial axes, angular in body axes.
    """
    model = make_model(impact)
    data = mujoco.MjData(model)
    for vehicle, (q, v) in {"chaser": (0, 0), "target": (7, 6)}.items():
        data.qpos[q : q + 7] = [*start[f"{vehicle}.position"], *start[f"{vehicle}.attitude"]]
        data.qvel[v : v + 6] = [
            *start[f"{vehicle}.velocity"],
            *start[f"{vehicle}.angular_velocity"],
        ]
    chaser, target = (model.body(name).id for name in ("chaser", "target"))
    total = np.zeros(3)

    def act(model: "mujoco.MjModel", data: "mujoco.MjData") -> None:
        """Apply the penalty law at all contacts."""
        total[:] = 0.0
        for contact in data.contact:
            if contact.dist >= 0.0:
                continue
            normal, point = np.array(contact.frame[:3]), np.array(contact.pos)
            if model.geom_bodyid[contact.geom1] == target:
                normal = -normal  # from chaser to target
            speeds = []
            for body in (chaser, target):
                linear = np.zeros((3, model.nv))
                mujoco.mj_jac(model, data, linear, None, point, body)
                speeds.append(linear @ data.qvel)
            rate = normal @ (speeds[0] - speeds[1])  # of the depth
            force = find_force(-contact.dist, rate, damping) * normal
            total[:] += force
            for body, sign in ((chaser, -1.0), (target, 1.0)):
                mujoco.mj_applyFT(
                    model, data, sign * force, np.zeros(3), point, body, data.qfrc_passive
                )

    mujoco.set_mjcb_passive(act)
    try:
        forces = []
        for _ in range(round(STOP / STEP)):
            mujoco.mj_forward(model, data)
            forces.append(total.copy())
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        forces.append(total.copy())
    finally:
        mujoco.set_mjcb_passive(None)
    return np.array(forces), data.qvel.reshape(2, 6).copy()


def find_force(depth: float, rate: float, damping: float) -> float:
    """Return the penalty force [N]: a spring with a parabolic start, times 1 + damping rate."""
    spring = depth - TOE / 2.0 if depth > TOE else depth**2 / (2.0 * TOE)
    return STIFFNESS * spring * max(0.0, 1.0 + damping * rate)


def find_figures(forces: np.ndarray) -> list[float]:
    """Return peak force, momentum exchange, begin and duration of an impact."""
    size = np.linalg.norm(forces, axis=1)
    touching = np.flatnonzero(size > 0.0)
    assert 0 < touching[0] <= touching[-1] < len(size) - 1, "the impact is not over"
    exchange = np.linalg.norm(np.trapezoid(forces, dx=STEP, axis=0))
    duration = (touching[-1] - touching[0]) * STEP
    return [size.max(), exchange, touching[0] * STEP, duration]


def compare(table: Table, impact: Impact, damping: float) -> None:
    """Add the rows of one impact."""
    run = run_dockloop(impact, damping)
    names = ("position", "attitude", "velocity", "angular_velocity")
    vectors = {f"{v}.{n}": run.vector(f"{v}.{n}") for v in ("chaser", "target") for n in names}
    own = find_figures(run.vector("capture.force"))
    ends = np.array(
        [
            [*vectors[f"{v}.velocity"][-1], *vectors[f"{v}.angular_velocity"][-1]]
            for v in ("chaser", "target")
        ]
    )
    forces, other_ends = run_mujoco(
        impact, damping, {name: values[0] for name, values in vectors.items()}
    )
    other = find_figures(forces)
    off = np.abs(ends - other_ends)
    case = f"{impact.name}, damping {damping:g} s/m"
    for program, figures in (("dockloop", own), ("MuJoCo", other)):
        table.add(case, program, *(f"{value:.5g}" for value in figures))
    parts = [f"{abs(a / b - 1.0):.1e}" for a, b in zip(own, other, strict=True)]
    table.add("", "difference, relative", *parts)
    note = f"{off[:, :3].max():.1e} m/s, {off[:, 3:].max():.1e} rad/s"
    table.add("", "velocities at the end differ by", note, "", "", "")


def main() -> None:
    """Write the page."""
    table = Table("impact", "program", "peak N", "impulse N s", "begin s", "duration s")
    for impact in (make_head(), make_ring()):
        for damping in (0.0, 4.0):
            compare(table, impact, damping)
    write_page(
        ROOT / "tests" / "validation" / "impacts.md",
        "Impacts against another engine",
        "tests/studies/impacts.py",
        f"MuJoCo {mujoco.__version__}, {datetime.datetime.now(datetime.UTC):%Y-%m-%d}.",
        TEXT,
        table,
        DIFFERENCES,
    )


if __name__ == "__main__":
    main()
