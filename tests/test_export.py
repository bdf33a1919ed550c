"""Mechanisms written for MuJoCo move and accelerate there as here."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.rotations import find_matrix
from dockloop.exchange.exporting import export_mechanism
from dockloop.native import core
from dockloop.scene.find import read_mechanism

pytestmark = pytest.mark.usefixtures("own_folder")


def load_export(name):
    """Return MuJoCo, model and data of a shipped mechanism, the mechanism in bodies, the report."""
    report = export_mechanism(name, "out.xml")
    m = mujoco.MjModel.from_xml_path("out.xml")
    off = mujoco.mjtDisableBit
    m.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_SPRING | off.mjDSBL_DAMPER
    m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    path = paths.MECHANISMS / f"{name}.json"
    document = core.expand(read_mechanism(path), path)
    return mujoco, m, mujoco.MjData(m), document, report


def to_mujoco(m, document, out, tau):
    """Return qpos, qvel and forces of MuJoCo for a state, and its accelerations by this project."""
    q, v, a, force = (np.array(part) for part in (out["q"], out["v"], out["a"], tau))
    qpos, qvel, applied, expected = (np.zeros(n) for n in (m.nq, m.nv, m.nv, m.nv))
    at_q = at_v = 0
    for body in document["bodies"]:
        joint = m.joint(body["name"])
        to_q, to_v = int(joint.qposadr[0]), int(joint.dofadr[0])
        if body["joint"]["type"] == "free":
            w, x, y, z = q[at_q + 3 : at_q + 7]
            turn = find_matrix((w, x, y, z))
            start = np.array(body["joint"].get("position", (0, 0, 0)))
            line, spin = slice(at_v, at_v + 3), slice(at_v + 3, at_v + 6)
            qpos[to_q : to_q + 7] = [*(start + q[at_q : at_q + 3]), w, x, y, z]
            qvel[to_v : to_v + 6] = [*(turn @ v[line]), *v[spin]]
            applied[to_v : to_v + 6] = [*(turn @ force[line]), *force[spin]]
            linear = turn @ (a[line] + np.cross(v[spin], v[line]))
            expected[to_v : to_v + 6] = [*linear, *a[spin]]
            at_q, at_v = at_q + 7, at_v + 6
            continue
        qpos[to_q], qvel[to_v], applied[to_v], expected[to_v] = (
            q[at_q],
            v[at_v],
            force[at_v],
            a[at_v],
        )
        at_q, at_v = at_q + 1, at_v + 1
    return qpos, qvel, applied, expected


SHIPPED = (
    "hexapod_bench",
    "hexapod",
    "idss_hexapod",
    "apda",
    "apda_cranks",
    "probe_drogue",
    "probe_drogue_levers",
    "gripper",
)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_mechanism_is_the_same_in_mujoco(name):
    mujoco, m, data, document, _ = load_export(name)
    report = dl.check(name)
    at, state = 0, []
    counts = [7 if body["joint"]["type"] == "free" else 1 for body in document["bodies"]]
    free = set(report["independent"])
    for body, count in zip(document["bodies"], counts, strict=True):
        part = list(report["home_q"][at : at + count])
        if body["name"] in free:
            shift = [0.02, -0.015, 0.01] if count == 7 else [0.01]
            part[: len(shift)] = np.add(part[: len(shift)], shift)
            if count == 7:
                part[3:] = np.array([0.999, 0.02, -0.03, 0.01]) / np.linalg.norm(
                    [0.999, 0.02, -0.03, 0.01]
                )
        state += part
        at += count
    size = sum(6 if count == 7 else 1 for count in counts)
    degrees = report["degrees_of_freedom"]
    rng = np.random.default_rng(5)
    tau = (10.0 * rng.standard_normal(size)).tolist()
    rates = (0.1 * rng.standard_normal(degrees)).tolist()
    (out,) = core.evaluate(
        read_mechanism(paths.MECHANISMS / f"{name}.json"), Path(name),
        {"states": [{"q": state, "v_independent": rates, "tau": tau}]}, Path("state"),
    )  # fmt: skip
    qpos, qvel, applied, expected = to_mujoco(m, document, out, tau)

    data.qpos, data.qvel, data.qfrc_applied = qpos, qvel, applied
    mujoco.mj_forward(m, data)
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    jac, gaps = data.efc_J.reshape(-1, m.nv)[rows], data.efc_pos[rows]
    # Kinematics: loops and couplings are closed there, and stay so.
    assert np.abs(gaps).max(initial=0.0) < 1e-13  # measured: 2e-15
    assert np.abs(jac @ qvel).max(initial=0.0) < 1e-13  # measured: 7e-15
    mass = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, data, mass)
    force = data.qfrc_applied - data.qfrc_bias
    rate = np.concatenate([np.zeros(0), *(find_rates(m, data, i) for i in range(m.neq))])
    root = np.linalg.cholesky(mass)  # of coordinates in which the mass is one
    free, whitened = np.linalg.solve(root, force), np.linalg.solve(root, jac.T).T
    held = free - np.linalg.pinv(whitened, rcond=1e-10) @ (whitened @ free + rate)
    found = np.linalg.solve(root.T, held)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def find_rates(m, data, equality):
    """Return the rates of the equations of an equality by its changing Jacobian."""
    if m.eq_type[equality] != mujoco.mjtEq.mjEQ_CONNECT:
        return np.zeros(1)  # ratios are constant
    rates = []
    for site in (m.eq_obj1id[equality], m.eq_obj2id[equality]):
        dot = np.zeros((3, m.nv))
        mujoco.mj_jacDot(m, data, dot, None, data.site_xpos[site], m.site_bodyid[site])
        rates.append(dot @ data.qvel)
    return rates[0] - rates[1]


def test_an_export_says_what_it_leaves_out_and_replaces_no_other_file():
    report = export_mechanism("hexapod", "out.xml")
    assert any(line.startswith("left out: law 'drive'") for line in report)
    assert "left out: member 'contact'" in report
    export_mechanism("hexapod", "out.xml")  # its own file
    Path("own.xml").write_text("<mujoco/>")
    with pytest.raises(dl.UsageError, match="which 'dockloop export' did not write"):
        export_mechanism("hexapod", "own.xml")
    assert Path("own.xml").read_text() == "<mujoco/>"


def test_springs_and_dampers_of_legs_are_those_of_the_file():
    mujoco, m, data, *_ = load_export("hexapod_bench")
    m.opt.disableflags = 0
    numbers = read_mechanism(paths.MECHANISMS / "hexapod_bench.json")["leg_defaults"]
    rod = m.joint("leg3_rod")
    data.qpos[rod.qposadr[0]], data.qvel[rod.dofadr[0]] = 0.02, -0.3
    mujoco.mj_forward(m, data)
    expected = -numbers["stiffness"] * 0.02 + numbers["damping"] * 0.3
    assert data.qfrc_passive[rod.dofadr[0]] == pytest.approx(expected, rel=1e-12)


def test_springs_of_one_joint_add_up_and_nothing_is_left_out_silently():
    """Two springs side by side: k = 100 + 300, rest where both together are at rest."""
    laws = [
        {"type": "spring", "stages": [[0.0, 100.0]], "rest": 0.2},
        {"type": "spring", "stages": [[0.0, 300.0]]},
        {"type": "damper", "linear": 1.0},
        {"type": "damper", "linear": 7.0},
    ]
    along = [{"joint": "b"}]
    forces = [{"name": "two", "along": along, "laws": laws}]
    damped = {"type": "joint_spring_damper", "joint": "b", "stiffness": 50.0, "damping": 2.0}
    forces += [damped, damped | {"stiffness": 0.0, "preload": 50.0}]
    body = {"name": "b", "parent": "base", "mass": 1.0, "inertia": np.eye(3).tolist()}
    body |= {"com": [0, 0, 0], "joint": {"type": "prismatic", "axis": [1, 0, 0]}}
    capture = {"body": "b"}
    Path("own.json").write_text(
        json.dumps({"name": "own", "bodies": [body], "forces": forces, "capture": capture})
    )
    report = export_mechanism("own.json", "out.xml")
    assert "left out: law 'constant' of 'b_spring'" in report
    assert "left out: member 'capture'" in report
    m = mujoco.MjModel.from_xml_path("out.xml")
    data = mujoco.MjData(m)
    data.qpos[0], data.qvel[0] = 0.1, -0.3
    mujoco.mj_forward(m, data)
    expected = -100.0 * (0.1 - 0.2) - (300.0 + 50.0) * 0.1 + (1.0 + 7.0 + 2.0 + 2.0) * 0.3
    assert data.qfrc_passive[0] == pytest.approx(expected, rel=1e-12)


def make_body(inertia, **more):
    """A mechanism of one sliding body."""
    body = {"name": "b", "parent": "base", "mass": 1.0, "inertia": np.array(inertia).tolist()}
    body |= {"com": [0, 0, 0], "joint": {"type": "prismatic", "axis": [1, 0, 0]}}
    Path("own.json").write_text(json.dumps({"name": "own", "bodies": [body | more]}))


def test_flat_bodies_are_rounded_to_what_mujoco_takes():
    rng = np.random.default_rng(1)
    for _ in range(20):
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        inertia = axes @ np.diag([1.0, 1.3, 2.3]) @ axes.T
        make_body((inertia + inertia.T) / 2)
        export_mechanism("own.json", "out.xml")
        m = mujoco.MjModel.from_xml_path("out.xml")
        assert sorted(m.body_inertia[1]) == pytest.approx([1.0, 1.3, 2.3], rel=1e-11)


@pytest.mark.parametrize(
    ("inertia", "more", "words"),
    [
        (
            np.diag([1, 1, 2.1]),
            {},
            r"body 'b' has the principal moments 1, 1 and 2.1 kg m2: MuJoCo",
        ),
        (np.diag([1, 0, 0]), {}, r"body 'b' has the principal moments 0, 0 and 1 kg m2"),
        (np.eye(3), {"name": "world"}, r"own\.json: MuJoCo does not accept what it would become: "),
    ],
)
def test_what_mujoco_refuses_is_not_written(inertia, more, words):
    make_body(inertia, **more)
    with pytest.raises(dl.UsageError, match=words):
        export_mechanism("own.json", "out.xml")
    assert not Path("out.xml").exists()


def move(document, values, rates):
    """Return the state of a mechanism where its independent coordinates have these values."""
    report, bodies = (core_of(document, Path("own")) for core_of in (core.check, core.expand))
    q, slices, at, at_v = [], {}, 0, 0
    for body in bodies["bodies"]:
        count = 7 if body["joint"]["type"] == "free" else 1
        home = report["home_q"][at : at + count]
        is_free = body["name"] in report["independent"]
        q += values.setdefault(body["name"], home) if is_free else home
        slices[body["name"]] = slice(at_v, at_v + (6 if count == 7 else 1))
        at, at_v = at + count, at_v + (6 if count == 7 else 1)
    state = {"q": q, "v_independent": rates, "tau": [0.0] * at_v}
    (out,) = core.evaluate(document, Path("own"), {"states": [state]}, Path("state"))
    return report, out, [a for name in report["independent"] for a in out["a"][slices[name]]]


@pytest.mark.parametrize("name", SHIPPED)
def test_what_was_exported_can_be_imported(name):
    """Also couplings of several joints, and springs along them."""
    export_mechanism(name, "out.xml")
    shipped = read_mechanism(paths.MECHANISMS / f"{name}.json")
    imported = dl.import_mechanism("out.xml", ring=shipped["capture"]["body"]).document
    degrees = dl.check(name)["degrees_of_freedom"]
    rates = (0.1 * np.random.default_rng(3).standard_normal(degrees)).tolist()
    turned = [0.9998, 0.02, 0.0, 0.0]
    values = {body["name"]: [0.01] for body in shipped["bodies"] if "axis" in body["joint"]}
    for body in shipped["bodies"]:
        if body["joint"]["type"] == "free":
            at = np.array([0.01, 0.02, -0.01])
            values[body["name"]] = [*at, *(turned / np.linalg.norm(turned))]
    first, before, a = move(shipped, values, rates)
    again, after, b = move(imported, values, rates)
    for key in ("degrees_of_freedom", "independent", "mass", "tree_velocities"):
        assert again[key] == pytest.approx(first[key])
    for found in (first, again):
        found["closures"] = sorted(loop["closure"] for loop in found["loops"])
    assert again["closures"] == first["closures"]
    scale = np.abs(a).max()
    assert b == pytest.approx(a, abs=1e-9 * scale)
    for one, other in zip(before["reduced_inertia"], after["reduced_inertia"], strict=True):
        assert other == pytest.approx(one, rel=1e-9, abs=1e-9)
