"""Reference impacts by MuJoCo for tests/unit/contact_impact_test.cpp.

Two free bodies carry the side edges of three petals each as capsules; one edge strikes a crossing
edge without friction or damping. MuJoCo normalises stiffness by the effective mass at the contact,
so k/m_eff is given as solref (with constant impedance this is an exact spring). RK4, 10 us.

Command: pip install mujoco numpy && python contact_mujoco.py > contact_mujoco.json
"""

import json

import mujoco
import numpy as np

RADIUS = 0.012  # m, rounding of a petal
STIFFNESS = 2e6  # N/m
MODEL = """<mujoco>
  <option timestep="1e-5" integrator="RK4" gravity="0 0 0" solver="Newton" tolerance="1e-15"
          iterations="100"/>
  <default><geom type="capsule" size="{radius}" condim="1" mass="0" margin="0"
      solref="{solref:.17g} 0" solimp="0.9999 0.9999 0.001 0.5 2"/></default>
  <worldbody>{bodies}</worldbody>
</mujoco>"""
BODY = """<body name="{name}"><freejoint/>
  <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/>{geoms}</body>"""


def side_edges(passive):
    """Side edges of three petals (3*2, 2 ends, 3), m, axes of the interface of that side."""
    half = np.deg2rad(28.0)
    edges = []
    for j in range(3):
        a = 2 * np.pi * j / 3
        turn = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        for sign in (1, -1):
            base = [-0.010, 0.585 * np.cos(half), sign * 0.585 * np.sin(half)]
            edges.append([turn @ base, turn @ [0.228, 0.415, sign * 0.050]])
    edges = np.array(edges)
    if passive:  # half a turn about the transverse axis at azimuth 30 deg
        axis = np.array([0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
        edges = edges @ (2 * np.outer(axis, axis) - np.eye(3))
    return edges


def rotation(vector):
    q = np.zeros(4)
    angle = np.linalg.norm(vector)
    mujoco.mju_axisAngle2Quat(
        q, np.array(vector) / angle if angle else np.array([1.0, 0, 0]), angle
    )
    m = np.zeros(9)
    mujoco.mju_quat2Mat(m, q)
    return q, m.reshape(3, 3)


def closest(p, q):
    """Closest points of two segments by a fine projected search (start values only)."""
    d1, d2, r = p[1] - p[0], q[1] - q[0], p[0] - q[0]
    a, b, e = d1 @ d1, d1 @ d2, d2 @ d2
    s = np.clip((b * (d2 @ r) - (d1 @ r) * e) / (a * e - b * b), 0, 1)
    t = np.clip((d2 @ r + b * s) / e, 0, 1)
    s = np.clip((b * t - d1 @ r) / a, 0, 1)
    return s, t, p[0] + s * d1, q[0] + t * d2


def best_pair(active, passive):
    found = [
        (np.linalg.norm(c[3] - c[2]), c) for p in active for q in passive for c in [closest(p, q)]
    ]
    return min(found, key=lambda x: x[0])


def main():
    rng = np.random.default_rng(7)
    active, passive = side_edges(False), side_edges(True)
    body = [
        dict(mass=40.0, inertia=[13.0, 7.0, 7.0], interface=[0.0, 0.0, 0.0]),
        dict(mass=400.0, inertia=[200.0, 300.0, 320.0], interface=[-0.8, 0.02, 0.0]),
    ]
    cases = []
    while len(cases) < 4:
        vector = rng.uniform(-0.06, 0.06, 3) * [4, 1, 1]
        quat, turn = rotation(vector)
        lateral = rng.uniform(-0.15, 0.15, 2)

        def pair_at(x, lateral=lateral, turn=turn):
            return best_pair(active, passive @ turn.T + np.array([x, *lateral]))

        # From afar to a gap of 0.5 mm: coarse steps, then bisection.
        x = 0.5
        while pair_at(x)[0] > 2 * RADIUS + 5e-4 and x > 0:
            x -= 5e-3
        if x <= 0:
            continue
        low, high = x, x + 5e-3
        for _ in range(30):
            x = (low + high) / 2
            low, high = (low, x) if pair_at(x)[0] < 2 * RADIUS + 5e-4 else (x, high)
        _, (s, t, p, q) = pair_at(x)
        if not (0.1 < s < 0.9 and 0.1 < t < 0.9):
            continue
        interface = np.array([x, *lateral])
        position = [np.zeros(3), interface - turn @ np.array(body[1]["interface"])]
        velocity = [np.array([0.10, 0.02, -0.01]), np.array([-0.02, 0.0, 0.01])]
        spin = [rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.01, 0.01, 3)]
        turns = [np.eye(3), turn]
        n, c = (q - p) / np.linalg.norm(q - p), (p + q) / 2
        inverse, closing = 0.0, 0.0
        for b in range(2):
            arm = turns[b].T @ np.cross(c - position[b], n)
            inverse += 1 / body[b]["mass"] + np.sum(arm**2 / body[b]["inertia"])
            speed = velocity[b] + np.cross(turns[b] @ spin[b], c - position[b])
            closing += (1, -1)[b] * (n @ speed)
        if closing < 0.03:
            continue
        geoms = []
        for b, edges in enumerate((active, passive)):
            edges = edges + np.array(body[b]["interface"])
            geoms.append(
                "".join(
                    '<geom fromto="{}" contype="{}" conaffinity="{}"/>'.format(
                        " ".join("%.17g" % v for v in e.ravel()), 1 + b, 2 - b
                    )
                    for e in edges
                )
            )
        model = mujoco.MjModel.from_xml_string(
            MODEL.format(
                radius=RADIUS,
                solref=-STIFFNESS * inverse,
                bodies="".join(
                    BODY.format(
                        name="AP"[b],
                        mass=body[b]["mass"],
                        geoms=geoms[b],
                        inertia=" ".join(map(str, body[b]["inertia"])),
                    )
                    for b in range(2)
                ),
            )
        )
        data = mujoco.MjData(model)
        for b in range(2):
            data.qpos[7 * b : 7 * b + 3] = position[b]
            data.qpos[7 * b + 3 : 7 * b + 7] = (np.array([1.0, 0, 0, 0]), quat)[b]
            data.qvel[6 * b : 6 * b + 6] = [*velocity[b], *spin[b]]
        depth, most = 0.0, 0
        while data.time < 0.2:
            mujoco.mj_step(model, data)
            most = max(most, data.ncon)
            if data.ncon:
                depth = max(depth, -min(data.contact.dist))
            elif depth > 0:
                break
        if most != 1:
            continue
        bodies = [
            dict(
                body[b],
                position=list(position[b]),
                velocity=list(velocity[b]),
                rotation_vector=list((np.zeros(3), vector)[b]),
                angular_velocity=list(spin[b]),
            )
            for b in range(2)
        ]
        cases.append(
            dict(
                bodies=bodies,
                closing_speed=closing,
                depth=depth,
                after=[
                    dict(
                        velocity=list(data.qvel[6 * b : 6 * b + 3]),
                        angular_velocity=list(data.qvel[6 * b + 3 : 6 * b + 6]),
                    )
                    for b in range(2)
                ],
            )
        )
    print(
        json.dumps(
            dict(
                source="contact_mujoco.py (the model is its text MODEL)",
                mujoco=mujoco.__version__,
                command="python contact_mujoco.py > contact_mujoco.json",
                conventions="SI; velocity of the mass centre in world axes, angular velocity in body axes",
                stiffness=STIFFNESS,
                cases=cases,
            ),
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
