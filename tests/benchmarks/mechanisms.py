"""Mechanisms of the benchmarks as documents: for dockloop, and for engines that know no legs.

``hexapod`` makes the ring on legs of ``hexapod_bench`` with any number of legs. ``expand`` writes
its legs out as bodies and loops, at states that are closed: the format of
``tests/data/crank_nested.json``. ``take`` does so for a mechanism that is written out already.
``to_mjcf`` writes such a document for MuJoCo.
"""

import copy
import itertools
import math
from collections.abc import Iterator

import numpy as np

RING_STATES = 16  # expand() makes so many


def hexapod(bench: dict, count: int) -> dict:
    """Put the ring of the bench on `count` equal legs, evenly spread, leaning by turns.

    Args:
        bench: the document ``modelDescription/mechanisms/hexapod_bench.json``.
        count: number of legs, at least 3.

    Returns:
        A mechanism document with ``legs``.
    """

    def on_circle(radius: float, azimuth_deg: float) -> list[float]:
        azimuth = math.radians(azimuth_deg)
        return [radius * math.cos(azimuth), radius * math.sin(azimuth), 0.0]

    document = copy.deepcopy(bench)
    document["name"] = f"legs_{count}"
    document["legs"] = [
        {
            "name": f"leg{i + 1}",
            "root_point": on_circle(0.65, 360 * i / count),
            "closing_point": on_circle(0.60, 360 * i / count + 48 * (-1) ** i),
        }
        for i in range(count)
    ]
    return document


def _make_part(name: str, parent: str, joint: dict, data: dict, com: float) -> dict:
    """Make a rod-like part of a leg, its axis x, with the masses of `data` (leg_defaults)."""
    across = data.get("inertia_transverse", 0.0)
    return {
        "name": name,
        "parent": parent,
        "joint": joint,
        "mass": data.get("mass", 0.0),
        "com": [com, 0.0, 0.0],
        "inertia": np.diag([data.get("inertia_axial", 0.0), across, across]).tolist(),
    }


def _make_loop(name: str, parts: list[str], ring: str, length: float, closing: list) -> dict:
    """Make the loop of a leg whose last part meets the ring at x = `length`."""
    cut = {"type": "R3", "point_on_terminal": [length, 0.0, 0.0], "point_on_closing": closing}
    return {
        "name": name,
        "root": "base",
        "first": parts[0],
        "terminal": parts[-1],
        "closing": ring,
        "cut": cut,
        "dependent": parts,
    }


def crank_hexapod(bench: dict, name: str, second_axis: list[float]) -> dict:
    """Put the ring of the bench on crank legs (R1R2R3) in place of its slide legs.

    Each has the ends and masses of the slide leg it replaces; crank and rod are equally long and
    bend upwards. A spring with damper turns each crank.

    Args:
        bench: the document ``modelDescription/mechanisms/hexapod_bench.json``.
        name: of the mechanism.
        second_axis: of the universal joint at the elbow: ``[0, 0, 1]`` parallel to the crank's
            axis, ``[0, 1, 0]`` square to it; the third axis is the other one.

    Returns:
        A mechanism document with bodies and loops, closed with all coordinates at zero.
    """
    bend = 0.93  # rad, elbow at home: far from stretched and from square
    ring, common = bench["bodies"][0], bench["leg_defaults"]
    c, s = math.cos(bend), math.sin(bend)
    bent = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    parallel = second_axis[2] != 0
    bodies, loops, forces = [ring], [], []
    for leg in bench["legs"]:
        root, closing = np.array(leg["root_point"]), np.array(leg["closing_point"])
        between = np.array(ring["joint"]["position"]) + closing - root
        length = float(np.linalg.norm(between)) / (2 * math.cos(bend / 2))
        along = between / np.linalg.norm(between)
        z = np.cross(along, [0.0, 0.0, 1.0])
        z /= np.linalg.norm(z)
        x = math.cos(bend / 2) * along - math.sin(bend / 2) * np.cross(z, along)
        axes = np.column_stack([x, np.cross(z, x), z])

        def add(part, parent, axis, like, *, leg=leg, **placement):
            joint = {"type": "revolute", "axis": axis, **placement}
            data = common.get(like, {})
            name = f"{leg['name']}_{part}"
            bodies.append(_make_part(name, parent, joint, data, data.get("com", 0.0)))
            return name

        elbow = {"position": [length, 0.0, 0.0]} | ({"rotation": bent} if parallel else {})
        crank = add(
            "crank", "base", [0, 0, 1], "cylinder", position=root.tolist(), rotation=axes.tolist()
        )
        cross = add("cross", crank, second_axis, "", **elbow)
        third_axis = [0, 1, 0] if parallel else [0, 0, 1]
        rod = add("rod", cross, third_axis, "rod", **({} if parallel else {"rotation": bent}))
        parts = [crank, cross, rod]
        loops.append(_make_loop(leg["name"], parts, ring["name"], length, closing.tolist()))
        law = {key: common[key] for key in ("stiffness", "damping")}
        forces.append({"type": "joint_spring_damper", "joint": crank, **law})
    home = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] + [0.0] * (len(bodies) - 1)
    return {
        "name": name,
        "gravity": bench["gravity"],
        "bodies": bodies,
        "loops": loops,
        "forces": forces,
        "home_q": home,
        "capture": {"body": ring["name"]},
    }


def rotation_of(vector: np.ndarray) -> np.ndarray:
    """Return the 3x3 rotation about a rotation vector [rad]."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle else (1.0, 0.0, 0.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def quaternion_of(vector: np.ndarray) -> np.ndarray:
    """Return the quaternion w x y z of a rotation vector [rad]."""
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle else np.zeros(3)
    return np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * axis])


class _Leg:
    """A leg of the bench: x along it at home, y its first axis, z its second."""

    def __init__(self, leg: dict, home: np.ndarray, reference_axis: list[float]) -> None:
        self.root = np.array(leg["root_point"])
        self.closing = np.array(leg["closing_point"])
        along = home + self.closing - self.root
        self.length = float(np.linalg.norm(along))
        x = along / self.length
        y = np.cross(reference_axis, x)
        y /= np.linalg.norm(y)
        self.axes = np.column_stack([x, y, np.cross(x, y)])

    def find_motion(self, point: np.ndarray, velocity: np.ndarray) -> tuple[list, list]:
        """Return the three coordinates [rad, rad, m] of the leg and their rates for its tip."""
        local, rate = self.axes.T @ (point - self.root), self.axes.T @ velocity
        across = math.hypot(local[0], local[2])
        length = math.hypot(across, local[1])
        c1, s1 = local[0] / across, -local[2] / across
        c2, s2 = across / length, local[1] / length
        u, z = np.array([c1 * c2, s2, -s1 * c2]), np.array([s1, 0.0, c1])
        y = np.cross(z, u)
        q = [math.atan2(s1, c1), math.atan2(s2, c2), length - self.length]
        return q, [-float(z @ rate) / across, float(y @ rate) / length, float(u @ rate)]


def expand(document: dict, start: dict) -> dict:
    """Write a ring on legs (`hexapod`) out as bodies and loops, with closed states.

    Args:
        document: a mechanism with one free body and equal R2P1R3 legs, perhaps with screws.
        start: member ``initial`` of ``tests/data/hexapod_bench.json``, the first state.

    Returns:
        name, mechanism (bodies, loops), forces, states (q, v_independent, v, tau); without
        expected accelerations.
    """
    common, ring = document["leg_defaults"], document["bodies"][0]
    home = np.array(ring["joint"]["position"])
    axis = common.get("reference_axis", [1.0, 0.0, 0.0])
    legs = [_Leg(leg, home, axis) for leg in document["legs"]]
    bodies, loops, forces, couplings = [ring], [], [], []
    screw = common.get("screw")
    turns = 2 * math.pi / screw["lead"] if screw else 0.0  # rad of a rotor per m of its rod
    law = {key: common.get(key, 0.0) for key in ("stiffness", "damping")}
    for spec, leg in zip(document["legs"], legs, strict=True):
        name = spec["name"]

        def add(part, parent, kind, axis, *, com=0.0, name=name, **placement):
            joint = {"type": kind, "axis": axis, **placement}
            bodies.append(_make_part(f"{name}_{part}", parent, joint, common.get(part, {}), com))

        placement = {"position": leg.root.tolist(), "rotation": leg.axes.tolist()}
        add("cross", "base", "revolute", [0.0, 1.0, 0.0], **placement)
        cylinder, rod = common["cylinder"]["com"], leg.length - common["rod"]["com"]
        add("cylinder", f"{name}_cross", "revolute", [0.0, 0.0, 1.0], com=cylinder)
        add("rod", f"{name}_cylinder", "prismatic", [1.0, 0.0, 0.0], com=rod)
        parts = [f"{name}_{part}" for part in ("cross", "cylinder", "rod")]
        if screw:
            data = {"inertia_axial": screw["inertia"], **screw}
            joint = {"type": "revolute", "axis": [1.0, 0.0, 0.0]}
            cylinder = f"{name}_cylinder"
            bodies.append(_make_part(f"{name}_rotor", cylinder, joint, data, screw["com"]))
            term = {"joint": f"{name}_rod", "ratio": turns}
            row = {"name": f"{name}_screw", "dependent": f"{name}_rotor", "terms": [term]}
            couplings.append(row)
        loops.append(_make_loop(name, parts, ring["name"], leg.length, leg.closing.tolist()))
        forces.append({"body": f"{name}_rod", **law})

    states = []
    names = ("displacement", "rotation_vector", "linear_velocity", "angular_velocity")
    first = tuple(np.array(start[f"ring_{name}"]) for name in names)
    motions = [first, *itertools.islice(_list_ring_motions(), 1, None)]
    for displaced, turned, velocity, spin in motions:
        rotation = rotation_of(turned)
        of_ring = [*(rotation.T @ velocity), *(rotation.T @ spin)]
        q, v = [*displaced, *quaternion_of(turned)], list(of_ring)
        tau = [0.0] * 6
        for leg in legs:
            arm = rotation @ leg.closing
            of_leg, rates = leg.find_motion(home + displaced + arm, velocity + np.cross(spin, arm))
            q += of_leg
            v += rates
            tau += [0.0, 0.0, -law["stiffness"] * of_leg[2] - law["damping"] * rates[2]]
            if screw:
                q.append(turns * of_leg[2])
                v.append(turns * rates[2])
                tau.append(0.0)
        states.append({"q": q, "v_independent": of_ring, "v": v, "tau": tau})
    mechanism = {"gravity": document.get("gravity", [0.0] * 3), "bodies": bodies, "loops": loops}
    return {
        "name": document["name"],
        "mechanism": mechanism | ({"couplings": couplings} if couplings else {}),
        "forces": forces,
        "states": [
            {key: np.asarray(value, float).tolist() for key, value in state.items()}
            for state in states
        ],
    }


def _list_ring_motions() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield displacement [m], rotation vector [rad] and rates of the ring, in axes of the base."""
    for k in range(RING_STATES):
        wave = np.sin(0.3 * k + 1.7 * np.arange(12))  # smooth in k, none of it special
        yield 0.03 * wave[:3], 0.03 * (1 + wave[3:6]), 0.1 * wave[6:9], 0.1 * wave[9:]


def take(document: dict) -> dict:
    """Return a mechanism of bodies, loops and couplings with states of its ring.

    Args:
        document: a mechanism; its first body is free, loops and couplings give all others.

    Returns:
        As `expand`. Coordinates of the other joints are zero:
        `dockloop.native.core.evaluate` closes them.
    """
    others = [0.0] * (len(document["bodies"]) - 1)
    states = []
    for displaced, turned, velocity, spin in _list_ring_motions():
        rotation = rotation_of(turned)
        of_ring = [*(rotation.T @ velocity), *(rotation.T @ spin)]
        states.append(
            {
                "q": [*displaced.tolist(), *quaternion_of(turned).tolist(), *others],
                "v_independent": np.asarray(of_ring).tolist(),
                "tau": [0.0] * 6 + others,
            }
        )
    parts = {key: document[key] for key in ("bodies", "loops", "couplings")}
    mechanism = {"gravity": document.get("gravity", [0.0] * 3), **parts}
    return {"name": document["name"], "mechanism": mechanism, "states": states}


def to_mjcf(document: dict) -> str:
    """Return a document of `expand` as MuJoCo's XML: loops are `connect` constraints.

    A body without mass, which MuJoCo refuses, becomes a further joint of the body on it.
    """

    def words(values) -> str:
        return " ".join(repr(float(x)) for x in np.ravel(values))

    laws = {force["body"]: force for force in document.get("forces", [])}
    bodies = document["mechanism"]["bodies"]
    kinds = {"revolute": "hinge", "prismatic": "slide"}

    def joints_of(body: dict) -> str:
        joint = body["joint"]
        if joint["type"] == "free":
            return "<freejoint/>"
        law = laws.get(body["name"], {"stiffness": 0, "damping": 0})
        return (
            f'<joint type="{kinds[joint["type"]]}" axis="{words(joint["axis"])}" '
            f'stiffness="{law["stiffness"]}" damping="{law["damping"]}"/>'
        )

    def write(parent: str) -> str:
        text = ""
        for child in bodies:
            if child["parent"] != parent:
                continue
            body, joint, joints = child, child["joint"], ""
            while not body.get("mass"):  # its joint belongs to the one body that it carries
                joints += joints_of(body)
                (body,) = [b for b in bodies if b["parent"] == body["name"]]
            name = body["name"]
            axes = np.array(joint.get("rotation", np.eye(3)))
            inertia = np.array(body.get("inertia", np.zeros((3, 3))))
            six = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
            text += (
                f'<body name="{name}" pos="{words(joint.get("position", [0, 0, 0]))}" '
                f'xyaxes="{words(axes.T[:2])}">{joints}{joints_of(body)}'
                f'<inertial pos="{words(body.get("com", [0, 0, 0]))}" mass="{body["mass"]}" '
                f'fullinertia="{words(six)}"/>{write(name)}</body>'
            )
        return text

    def anchor(loop: dict) -> str:
        return (
            f'<connect site1="{loop["name"]}_terminal" site2="{loop["name"]}_closing" '
            'solref="0.002 1" solimp="0.9999 0.9999 0.001"/>'
        )

    text = write("base")
    for loop in document["mechanism"]["loops"]:
        for end in ("terminal", "closing"):
            at = words(loop["cut"][f"point_on_{end}"])
            site = f'<site name="{loop["name"]}_{end}" pos="{at}"/>'
            head = f'<body name="{loop[end]}"'
            start = text.index(">", text.index(head)) + 1
            text = text[:start] + site + text[start:]
    gravity = words(document["mechanism"].get("gravity", [0, 0, 0]))
    return (
        f'<mujoco model="{document["name"]}"><option integrator="RK4" gravity="{gravity}" '
        'tolerance="1e-14"/><compiler balanceinertia="false" boundmass="0" boundinertia="0"/>'
        f"<worldbody>{text}</worldbody>"
        f"<equality>{''.join(anchor(loop) for loop in document['mechanism']['loops'])}</equality>"
        "</mujoco>"
    )
