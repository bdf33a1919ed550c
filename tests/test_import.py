"""Mechanisms of other tools: loops, accelerations, malformed files.

Accelerations are compared with MuJoCo's: of the same file where MuJoCo reads it, else of a model
written here. Loops are closed by Lagrange multipliers there, exactly, not by its soft constraints.
"""

import json
import math
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.native import core
from import_files import (
    ARM,
    IMPORTED,
    INERTIAL,
    INNER,
    MIMIC,
    SECOND,
    TURN,
    axis,
    bring,
    joint,
    link,
    mjcf,
    sdf,
    turn,
    urdf,
)

pytestmark = pytest.mark.usefixtures("own_folder")
STEWART = paths.ROOT / "scripts" / "examples" / "stewart.sdf"


def evaluate(made, state):
    """Return the accelerations of all joints, by body."""
    document = made.document
    (out,) = core.evaluate(document, Path("own"), {"states": [state]}, Path("state"))
    names, at = {}, 0
    for body in document["bodies"]:
        count = 6 if body["joint"]["type"] == "free" else 1
        names[body["name"]] = slice(at, at + count)
        at += count
    return out, names


def solve_mujoco(text, q, v, tau):
    """Return MuJoCo's accelerations: its inertia and forces; its cuts by Lagrange multipliers."""
    m = mujoco.MjModel.from_xml_string(text)
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    m.dof_damping[:] = m.jnt_stiffness[:] = 0.0
    data = mujoco.MjData(m)
    data.qpos, data.qvel, data.qfrc_applied = q, v, tau
    mujoco.mj_forward(m, data)
    mass = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, data, mass)
    force = data.qfrc_applied - data.qfrc_bias
    rows, rates = [], []
    for i in range(m.neq):
        jac, dot = np.zeros((2, 3, m.nv)), np.zeros((2, 3, m.nv))
        for side, body in enumerate((m.eq_obj1id[i], m.eq_obj2id[i])):
            local = m.eq_data[i][3 * side : 3 * side + 3]
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local
            mujoco.mj_jac(m, data, jac[side], None, point, body)
            mujoco.mj_jacDot(m, data, dot[side], None, point, body)
        rows.append(jac[0] - jac[1])
        rates.append((dot[0] - dot[1]) @ data.qvel)
    if not rows:
        return data, np.linalg.solve(mass, force)
    jac, rate = np.vstack(rows), np.concatenate(rates)
    inverse = np.linalg.inv(mass)
    multipliers = np.linalg.pinv(jac @ inverse @ jac.T, rcond=1e-10) @ (
        jac @ inverse @ force + rate
    )
    return data, inverse @ (force - jac.T @ multipliers)


def test_a_urdf_tree_accelerates_as_in_mujoco():
    text = urdf(rest=SECOND.format(""))
    made = bring(text)
    made.document["gravity"] = [0, 0, -9.81]  # which MuJoCo adds by itself
    q, v, tau = [0.4, -0.1], [0.7, 0.3], [1.5, -2.0]
    out, _ = evaluate(made, {"q": q, "v_independent": v, "tau": tau})
    assert out["a"] == pytest.approx(solve_mujoco(text, q, v, tau)[1], rel=1e-9)


def test_an_mjcf_tree_accelerates_as_in_mujoco():
    wrist = (
        '<body name="w" pos="0.1 0 0.3" euler="0.2 0.1 -0.4"><joint name="x" axis="1 0 0"/>'
        f'<joint name="y" axis="0.6 0.8 0" pos="0 0.1 0"/>{IMPORTED}</body>'
    )
    text = mjcf(inside=INNER.replace("</body>", wrist + "</body>"))
    made = bring(text)
    q, v, tau = [0.4, -0.1, 0.3, -0.5], [0.7, 0.3, -0.4, 0.9], [1.5, -2.0, 0.3, 0.2]
    out, _ = evaluate(made, {"q": q, "v_independent": v, "tau": tau})
    assert out["a"] == pytest.approx(solve_mujoco(text, q, v, tau)[1], rel=1e-9)


def write_stewart():
    """Return the platform of `STEWART` as MJCF, written from its numbers here."""
    model = ElementTree.parse(STEWART).getroot().find("model")
    links = {node.get("name"): node for node in model.findall("link")}

    def inertial(name):
        node = links[name].find("inertial")
        com = " ".join((node.findtext("pose") or "0 0 0").split()[:3])
        six = " ".join(node.findtext(f"inertia/i{key}") or "0" for key in ("xx", "yy", "zz"))
        return f'<inertial pos="{com}" mass="{node.findtext("mass")}" diaginertia="{six}"/>'

    legs = cuts = ""
    for n in range(1, 7):
        words = links[f"tube{n}"].findtext("pose").split()
        length = links[f"rod{n}"].findtext("pose")
        legs += (
            f'<body pos="{" ".join(words[:3])}" euler="{" ".join(words[3:])}">'
            f'<joint axis="0 1 0"/><joint axis="0 0 1"/>{inertial(f"tube{n}")}'
            f'<body name="rod{n}" pos="{length.split()[0]} 0 0"><joint type="slide" axis="1 0 0"/>'
            f"{inertial(f'rod{n}')}</body></body>"
        )
        cuts += f'<connect body1="rod{n}" body2="ring" anchor="0 0 0"/>'
    ring = f'<body name="ring" pos="0.5 0 0"><freejoint/>{inertial("ring")}</body>'
    return (
        '<mujoco><option gravity="0 0 0"/><compiler angle="radian" eulerseq="XYZ"/><worldbody>'
        f"{ring}{legs}</worldbody><equality>{cuts}</equality></mujoco>"
    )


def test_a_stewart_platform_accelerates_as_in_mujoco():
    made = dl.import_mechanism(STEWART, ring="ring")
    assert made.check["independent"] == ["ring"]
    assert {loop["closure"] for loop in made.check["loops"]} == {"R2P1R3"}
    assert [leg["name"] for leg in made.document["legs"]] == [f"ball{n}" for n in range(1, 7)]
    turn = np.array([0.98, 0.1, -0.12, 0.05])
    q = [0.03, -0.02, 0.04, *(turn / np.linalg.norm(turn)), *[0.0] * 18]
    v = [0.1, -0.2, 0.15, 0.3, -0.25, 0.2]
    tau = {"ring": [30, -20, 10, 5, 4, -6], "rod1": [200], "rod4": [-150], "tube2": [3]}
    flat = [tau.get(body["name"], [0.0]) for body in made.document["bodies"]]
    tau = [number for part in flat for number in part]
    out, at = evaluate(made, {"q": q, "v_independent": v, "tau": tau})

    order = [at["ring"]] + [
        at[name] for n in range(1, 7) for name in (f"tube{n}_foot{n}_1", f"tube{n}", f"rod{n}")
    ]
    sort = np.concatenate([np.arange(part.start, part.stop) for part in order])
    q, v, a, tau = (np.array(part) for part in (out["q"], out["v"], out["a"], tau))
    w, x, y, z = q[3:7]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    of_legs = sort[6:]
    qpos = [*np.add(q[:3], [0.5, 0, 0]), *q[3:7], *q[of_legs + 1]]
    qvel = [*(rotation @ v[:3]), *v[3:6], *v[of_legs]]
    force = [*(rotation @ tau[:3]), *tau[3:6], *tau[of_legs]]
    _, found = solve_mujoco(write_stewart(), qpos, qvel, force)
    of_ring = [*(rotation.T @ found[:3] - np.cross(v[3:6], v[:3])), *found[3:6]]
    expected = np.array([*of_ring, *found[6:]])
    assert np.abs(a[sort] - expected).max() < 1e-9 * np.abs(expected).max()


BAR = "<inertial><pose>{0} 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>0.001</ixx><iyy>{1}</iyy><izz>{1}</izz></inertia></inertial>"
CRANK, COUPLER, ROCKER, GROUND = 0.4, 0.9, 0.7, 1.0


def find_four_bar(crank):
    """Return the angles of coupler and rocker: law of cosines."""
    x, y = GROUND - CRANK * math.cos(crank), -CRANK * math.sin(crank)
    reach = math.hypot(x, y)
    coupler = math.atan2(y, x) + math.acos(
        (COUPLER**2 + reach**2 - ROCKER**2) / (2 * COUPLER * reach)
    )
    rocker = math.atan2(
        CRANK * math.sin(crank) + COUPLER * math.sin(coupler),
        CRANK * math.cos(crank) + COUPLER * math.cos(coupler) - GROUND,
    )
    return coupler, rocker


def write_four_bar(digits=17):
    """Return a four-bar as SDF: the coupler has two parents."""
    coupler, rocker = find_four_bar(1.0)
    tip = CRANK * math.cos(1.0), CRANK * math.sin(1.0)
    places = {
        "crank": (0, 0, 1.0, CRANK),
        "coupler": (*tip, coupler, COUPLER),
        "rocker": (GROUND, 0, rocker, ROCKER),
    }
    links = [
        link(
            name,
            f"{x:.{digits}g} {y:.{digits}g} 0 0 0 {angle:.{digits}g}",
            BAR.format(length / 2, length**2 / 6),
        )
        for name, (x, y, angle, length) in places.items()
    ]
    joints = [
        joint("a", "revolute", "world", "crank"),
        joint("b", "revolute", "crank", "coupler"),
        joint("d", "revolute", "world", "rocker"),
        joint(
            "c", "revolute", "rocker", "coupler",
            f"<pose>{COUPLER} 0 0 0 0 0</pose>" + axis(""),
        ),
    ]  # fmt: skip
    return sdf(*links, *joints)


def mujoco_four_bar():
    def bar(name, place, angle, length, inside=""):
        return (
            f'<body name="{name}" pos="{place} 0 0" euler="0 0 {angle!r}"><joint name="{name}"'
            f' axis="0 0 1"/><inertial pos="{length / 2} 0 0" mass="2" diaginertia="0.001'
            f' {length**2 / 6!r} {length**2 / 6!r}"/>{inside}</body>'
        )

    coupler, rocker = find_four_bar(1.0)
    inner = bar("coupler", CRANK, coupler - 1.0, COUPLER)
    return (
        '<mujoco model="four_bar"><option gravity="0 0 0"/><compiler angle="radian"'
        ' balanceinertia="false"/><worldbody>'
        f"{bar('crank', 0, 1.0, CRANK, inner)}{bar('rocker', GROUND, rocker, ROCKER)}</worldbody>"
        f'<equality><connect name="c" body1="coupler" body2="rocker" anchor="{COUPLER} 0 0"/>'
        "</equality></mujoco>"
    )


@pytest.mark.parametrize(
    ("form", "cut"), [("sdf", ()), ("sdf", ("b",)), ("sdf", ("c",)), ("mjcf", ()), ("mjcf", ("c",))]
)
def test_a_four_bar_accelerates_as_in_mujoco_whatever_is_cut(form, cut):
    made = bring(write_four_bar() if form == "sdf" else mujoco_four_bar(), cut=list(cut))
    assert made.check["degrees_of_freedom"] == 1
    (loop,) = made.document["loops"]
    assert loop["cut"]["type"] == "R1_planar"
    assert cut in ((), (loop["name"],))
    names = [body["name"] for body in made.document["bodies"]]
    torque = {"crank": 3.0, "rocker": -2.0}  # on joints of the base, which are never cut here
    (free,) = made.check["independent"]
    q = [0.25 * (name == free) for name in names]
    tau = [torque.get(name, 0.0) for name in names]
    out, at = evaluate(made, {"q": q, "v_independent": [0.6], "tau": tau})
    q, v = ({name: out[key][at[name].start] for name in names} for key in "qv")
    coupler, rocker = find_four_bar(1.0 + q["crank"])
    turned = coupler - find_four_bar(1.0)[0] - q["crank"]
    assert q["rocker"] == pytest.approx(rocker - find_four_bar(1.0)[1], abs=1e-12)
    slope = [(find_four_bar(1.0 + q["crank"] + h)[0]) for h in (1e-6, -1e-6)]
    rate = v["crank"] * ((slope[0] - slope[1]) / 2e-6 - 1.0)  # of the joint between both
    if loop["name"] in ("c",):
        assert q["coupler"] == pytest.approx(turned, abs=1e-12)
        rate = v["coupler"]
    state = [q["crank"], turned, q["rocker"]], [v["crank"], rate, v["rocker"]]
    _, found = solve_mujoco(mujoco_four_bar(), *state, [3.0, 0.0, -2.0])
    a = [out["a"][at[name].start] for name in ("crank", "rocker")]
    bound = 1e-9 if loop["name"] == "c" else 1e-8  # there by differences of the rate
    assert a == pytest.approx(found[[0, 2]], rel=bound)


def test_a_four_bar_with_three_digits_is_closed_within_the_stated_distance():
    stated = find_four_bar(1.0)[1]
    text = mujoco_four_bar().replace(f'euler="0 0 {stated!r}"', 'euler="0 0 1.6"')
    for side, (name, length) in enumerate((("coupler", COUPLER), ("rocker", ROCKER)), 1):
        start = text.index(">", text.index(f'body name="{name}"')) + 1
        text = f'{text[:start]}<site name="s{side}" pos="{length} 0 0"/>{text[start:]}'
    ends = f'body1="coupler" body2="rocker" anchor="{COUPLER} 0 0"'
    text = text.replace(ends, 'site1="s1" site2="s2"')
    gap = 2 * ROCKER * math.sin(abs(stated - 1.6) / 2)
    with pytest.raises(dl.UsageError, match=f"loop of 'c' is open by {gap:.6g} m .limit 0.001 m"):
        bring(text, assemble=0.001)
    made = bring(text, assemble=1.0)
    q = dict(
        zip([b["name"] for b in made.document["bodies"]], made.document["home_q"], strict=True)
    )
    crank = 1.0 + q["crank"]
    coupler, rocker = find_four_bar(crank)
    assert rocker == pytest.approx(1.6 + q["rocker"], abs=1e-12)
    assert coupler == pytest.approx(find_four_bar(1.0)[0] + q["crank"] + q["coupler"], abs=1e-12)
    assert any("was closed from there: '" in line for line in made.report)


def write_delta():
    """Return a delta robot as SDF and as MJCF: three arms, each with two rods to the platform."""

    def words(values):
        return " ".join(repr(float(value)) for value in values)

    def body(name, at, mass, com, inside=""):
        links.append(
            f'<link name="{name}"><pose>{words(at)} 0 0 0</pose><inertial><pose>{words(com)} 0 0 0'
            f"</pose><mass>{mass}</mass><inertia><ixx>0.01</ixx><iyy>0.012</iyy><izz>0.015</izz>"
            "</inertia></inertial></link>"
        )
        return (
            f'<inertial pos="{words(com)}" mass="{mass}" diaginertia="0.01 0.012 0.015"/>{inside}'
        )

    links, joints, bodies, cuts = [], [], "", ""
    for k in range(3):
        angle = 2 * math.pi * k / 3 + 0.3
        out, along = (
            np.array([math.cos(a), math.sin(a), 0.0]) for a in (angle, angle + math.pi / 2)
        )
        hip, knee = 0.2 * out, 0.45 * out + [0, 0, -0.12]
        rods = ""
        for side in (1, 2):
            name, shift = f"rod{k + 1}{side}", (side - 1.5) * 0.1 * along
            top, end = knee + shift, 0.08 * out + [0, 0, -0.7] + shift
            across = np.cross(along, end - top) / np.linalg.norm(end - top)
            inertial = body(name, top, 0.3, (end - top) / 2)
            rods += (
                f'<body name="{name}" pos="{words(top - hip)}"><joint name="{name}_u" axis="'
                f'{words(along)}"/><joint name="{name}_v" axis="{words(across)}"/>{inertial}</body>'
            )
            second = f"<axis2><xyz>{words(across)}</xyz></axis2>"
            joints.append(
                joint(f"u{name}", "universal", f"arm{k + 1}", name, axis("", words(along)) + second)
            )
            joints.append(
                joint(
                    f"ball{name}",
                    "ball",
                    name,
                    "platform",
                    f'<pose relative_to="{name}">{words(end - top)} 0 0 0</pose>',
                )
            )
            cuts += f'<connect body1="{name}" body2="platform" anchor="{words(end - top)}"/>'
        inertial = body(f"arm{k + 1}", hip, 1.1, (knee - hip) / 2)
        bodies += (
            f'<body name="arm{k + 1}" pos="{words(hip)}"><joint name="arm{k + 1}" axis="'
            f'{words(along)}"/>{inertial}{rods}</body>'
        )
        joints.append(
            joint(f"hip{k + 1}", "revolute", "world", f"arm{k + 1}", axis("", words(along)))
        )
    inertial = body("platform", (0, 0, -0.7), 2.5, (0.01, 0, 0.02))
    bodies += f'<body name="platform" pos="0 0 -0.7"><freejoint/>{inertial}</body>'
    text = (
        '<mujoco><option gravity="0 0 0"/><compiler angle="radian"/><worldbody>'
        f"{bodies}</worldbody><equality>{cuts}</equality></mujoco>"
    )
    return sdf(*links, *joints), text


def test_a_delta_robot_accelerates_as_in_mujoco():
    text, other = write_delta()
    made = bring(text)
    assert made.check["degrees_of_freedom"] == 3
    assert len(made.document["loops"]) == 5
    m = mujoco.MjModel.from_xml_string(other)
    index = {m.joint(j).name: int(m.jnt_dofadr[j]) for j in range(m.njnt)}
    names = {f"arm{k}": f"arm{k}" for k in (1, 2, 3)}
    for rod in (f"rod{k}{side}" for k in (1, 2, 3) for side in (1, 2)):
        names |= {f"{rod}_u{rod}_1": f"{rod}_u", rod: f"{rod}_v"}
    at_home = np.zeros(m.nv + 1)
    data = mujoco.MjData(m)
    at_home = data.qpos.copy()
    mujoco.mj_forward(m, data)
    jac = np.zeros((18, m.nv))
    for i in range(m.neq):
        for side, sign in ((0, 1.0), (1, -1.0)):
            body = (m.eq_obj1id[i], m.eq_obj2id[i])[side]
            local, part = m.eq_data[i][3 * side : 3 * side + 3], np.zeros((3, m.nv))
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local
            mujoco.mj_jac(m, data, part, None, point, body)
            jac[3 * i : 3 * i + 3] += sign * part
    rates = np.linalg.svd(jac)[2][-3:].T @ [0.5, -0.8, 0.6]  # a motion of the mechanism
    assert np.abs(jac @ rates).max() < 1e-12
    independent = [index[names[name]] for name in made.check["independent"]]
    bodies = [body["name"] for body in made.document["bodies"]]
    tau = {"arm1": 1.0, "arm2": -2.0, "rod12": 0.3}
    state = {"q": [0.0] * len(bodies), "v_independent": rates[independent].tolist()}
    out, place = evaluate(made, {**state, "tau": [tau.get(name, 0.0) for name in bodies]})
    force = np.zeros(m.nv)
    for name, value in tau.items():
        force[index[names[name]]] = value
    _, found = solve_mujoco(other, at_home, rates, force)
    for name in (name for name in bodies if name in names):
        assert out["v"][place[name].start] == pytest.approx(rates[index[names[name]]], abs=1e-11)
        a = found[index[names[name]]]
        assert out["a"][place[name].start] == pytest.approx(a, abs=1e-9 * np.abs(found).max())


def test_the_file_of_the_user_is_never_replaced():
    Path("own.xml").write_text(sdf(ARM, TURN))
    dl.import_mechanism("own.xml", "mine.json")
    assert dl.check("mine.json")["degrees_of_freedom"] == 1
    assert json.loads(Path("mine.json").read_text())["comment"][0] == "dockloop import own.xml"
    with pytest.raises(dl.UsageError, match=r"mine.json: is there already"):
        dl.import_mechanism("own.xml", "mine.json")


def test_lengths_that_are_no_metres_are_asked_for():
    made = bring(sdf(ARM, TURN, link("far", "500 0 0 0 0 0"), joint("j", "revolute", "arm", "far")))
    assert any("499 m long: millimetres?" in line for line in made.report)


def test_axes_of_a_planar_loop_that_are_rounded_become_parallel():
    made = bring(write_four_bar().replace("<xyz>0 0 1</xyz>", "<xyz>0 1e-6 1</xyz>", 1))
    (line,) = (line for line in made.report if "planar loop" in line)
    assert "turned by up to 1e-06 rad" in line
    assert made.check["degrees_of_freedom"] == 1


def test_the_base_can_be_any_link():
    made = bring(write_four_bar(), base="crank")
    assert made.check["degrees_of_freedom"] == 1
    assert {body["name"] for body in made.document["bodies"]} == {"ground", "coupler", "rocker"}


LOOP_OF_SLIDES = sdf(
    link("a"), link("b"), joint("x", "prismatic", "world", "a"), joint("y", "prismatic", "a", "b"),
    joint("z", "prismatic", "world", "b"),
)  # fmt: skip
MALFORMED = {
    "no XML": ("{}", "own.xml: is no XML"),
    "cut off": (sdf(ARM, TURN)[:-20], "own.xml: is no XML"),
    "another root": ("<svg/>", "root element <svg>: an import reads"),
    "no model": ('<sdf version="1.9"/>', "has 0 models"),
    "two models": (
        '<sdf version="1.9"><model name="a"/><model name="b"/></sdf>', "has 2 models"),
    "a link without name": (sdf("<link/>"), "link lacks the attribute 'name'"),
    "a link twice": (sdf(ARM, ARM, TURN), "link 'arm' has the name of another"),
    "a joint twice": (sdf(ARM, link("b"), TURN, joint("turn", "revolute", "arm", "b")), "joint 'turn' has the name of another"),
    "a pose of five numbers": (sdf(link("arm", "1 2 3 4 5"), TURN), "'pose' '1 2 3 4 5': must be 6"),
    "a word for a number": (sdf(link("arm", "1 2 x 0 0 0"), TURN), "must be 6 finite numbers"),
    "no number": (sdf(ARM, turn("<dynamics><damping>nan</damping></dynamics>")), "damping' 'nan': must be a finite"),
    "an unknown parent": (sdf(ARM, joint("turn", "revolute", "wall", "arm")), "joint 'turn' names the link 'wall'"),
    "an unknown child": (sdf(ARM, joint("turn", "revolute", "world", "leg")), "names the frame 'leg', not there"),
    "no child": (sdf(ARM, '<joint name="t" type="revolute"><parent>world</parent></joint>'), "joint 't' lacks the element 'child'"),
    "an unknown type": (sdf(ARM, joint("turn", "hinge", "world", "arm")), "has the type 'hinge': known are"),
    "an axis of zero": (sdf(ARM, joint("turn", "revolute", "world", "arm", axis("", "0 0 0"))), "'xyz' '0 0 0': must not be zero"),
    "a frame on itself": (
        sdf('<frame name="f"><pose relative_to="f">0 0 1 0 0 0</pose></frame>',
            link("arm").replace("<pose>", '<pose relative_to="f">', 1), TURN),
        "stands relative to itself"),
    "frames on each other": (
        sdf('<frame name="f" attached_to="g"><pose relative_to="__model__"/></frame><frame name="g" attached_to="f"/>',
            ARM, joint("turn", "revolute", "f", "arm")),
        "frame 'f' is attached to itself"),
    "a loop of slides": (LOOP_OF_SLIDES, "no joint of the loop through .* can be cut"),
    "a mimic of nothing": (
        sdf(ARM, turn(MIMIC.replace('"turn"', '"gone"'))), "names the joint 'gone', not there"),
    "a negative mass": (
        sdf(link("arm", more=INERTIAL.replace("<mass>2", "<mass>-2")), TURN), "mass is -2"),
    "two roots": (urdf().replace('<link name="base"/>', '<link name="base"/><link name="c"/>'), "has 2 links without parent"),
    "two parents": (
        urdf(rest='<joint name="k" type="fixed"><parent link="base"/><child link="arm"/></joint>'),
        "child of two joints: URDF has no loops, use SDF"),
    "no inertia": (urdf().replace('ixx="0.02"', ""), "inertia lacks the attribute 'ixx'"),
    "inertia from shapes": (
        sdf(link("arm", more='<inertial auto="true"/>'), TURN), "expand it with 'gz sdf --expand-auto-inertials"),
    "a macro": (
        urdf(rest='<xacro:leg xmlns:xacro="http://www.ros.org/wiki/xacro"/>'), "has <leg>: expand it with 'xacro FILE'"),
    "a property": (urdf().replace('"2"', '"${mass}"'), 'value="..mass."'),
    "a mimic of a fixed joint": (
        urdf("fixed", rest=SECOND.format('<mimic joint="turn"/>')), "couples 'turn', which has no coordinate of its own"),
    "a joint without parent": (urdf().replace('<parent link="base"/>', ""), "lacks the element 'parent'"),
}  # fmt: skip


@pytest.mark.parametrize("fault", MALFORMED)
def test_a_malformed_file_gets_one_sentence_and_nothing_is_written(fault):
    text, words = MALFORMED[fault]
    with pytest.raises(dl.UsageError, match=words) as refused:
        bring(text, output="mine.json")
    assert "own.xml" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not Path("mine.json").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "MuJoCo does not accept it: "),
        (mjcf(rest='<equality><joint joint1="turn" polycoef="0 1 2 0 0"/></equality>'), "polynomial .0.0, 1.0, 2.0"),
        ("<mujoco><include file='gone.xml'/></mujoco>", "MuJoCo does not accept it: .*gone.xml"),
    ],
)  # fmt: skip
def test_a_malformed_mjcf_gets_one_sentence(text, words):
    with pytest.raises(dl.UsageError, match=words) as refused:
        bring(text)
    assert "\n" not in str(refused.value)


DAMPED = "<dynamics><damping>3</damping></dynamics>"
LIMITED = "<limit><lower>-180</lower><upper>180</upper></limit>"
SAID = [  # file, line of the report: what is not as it seems is said
    (sdf(ARM, joint("b", "ball", "world", "arm", axis(DAMPED))), "left out: forces and limits of 'b': a ball joint has none here"),
    (sdf(ARM, joint("c", "continuous", "world", "arm", axis(LIMITED))), "left out: limits of 'c': a continuous joint has none here"),
    (urdf("continuous"), "left out: limits of 'turn': a continuous joint has none here"),
    (urdf("planar"), "left out: forces and limits of 'turn': a planar joint has none here"),
    (urdf("floating", '<dynamics damping="3"/>'), "left out: forces and limits of 'turn': a floating joint has none here"),
    (mjcf('<joint name="turn" type="free" damping="2"/>'), "left out: forces and limits of 'turn': a free joint has none here"),
    (sdf(ARM, turn(LIMITED)), "guessed: limits are radians, although 'turn' turns up to 180: degrees?"),
    (mjcf().replace("balance", 'settotalmass="3" balance'), "guessed: MuJoCo: compiler attribute 'settotalmass'"),
    (mjcf().replace("<body", '<geom size="1"/><frame pos="1 0 0"><body').replace("</body>", "</body></frame>"),
     "left out: body/geom (1): beyond mass and inertia"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line"), SAID)
def test_what_becomes_of_a_part_is_said(text, line, capfd):
    if text.startswith("<mujoco"):
        pytest.importorskip("mujoco")
    report = bring(text).report
    assert any(each.startswith(line) for each in report), report
    assert not any("no construct" in each for each in report)
    assert capfd.readouterr().err == ""


def test_the_words_of_an_earlier_version_keep_their_meaning():
    """gazebosim/sdformat#48, bulletphysics/bullet3#1707: axes of 1.4 are those of the model."""
    turned = link("arm", "1 0 0 0 0 1.5707963267948966")
    text = sdf(turned, joint("t", "revolute", "world", "arm", axis("", "1 0 0")))
    for version, expected in (("1.4", [0, -1, 0]), ("1.5", [1, 0, 0]), ("1.10", [1, 0, 0])):
        made = bring(text.replace("1.10", version)).document
        assert np.allclose(made["bodies"][0]["joint"]["axis"], expected)
    framed = link("b", "0 0 2 0 0 0").replace("<pose>", '<pose frame="arm">', 1)
    made = bring(sdf(ARM, TURN, framed, joint("t", "revolute", "arm", "b")).replace("1.10", "1.6"))
    assert made.document["bodies"][1]["joint"]["position"] == [0, 0, 2]


def test_gravity_is_that_of_the_world_around_a_model():
    world = '<world name="moon"><gravity>0 0 -1.62</gravity><include><uri>sun</uri></include>'
    text = sdf("<pose>0 0 0 1.5707963267948966 0 0</pose>", ARM, TURN)
    text = text.replace("<model", f"{world}<model").replace("</model>", "</model></world>")
    made = bring(text)
    assert np.allclose(made.document["gravity"], [0, -1.62, 0])
    assert "left out: of the world: include; its model is read only" in made.report


def test_a_second_hinge_on_the_axis_of_the_first_closes_nothing():
    """A loop without equations that count, and one without joints that follow."""
    made = bring(sdf(ARM, TURN, joint("hinge", "revolute", "world", "arm")))
    assert made.check["degrees_of_freedom"] == 1
    (loop,) = made.document["loops"]
    assert loop["dependent"] == []
    loop["cut"]["point_on_closing"] = [1.001, 0, 0]
    with pytest.raises(dl.UsageError, match="2 cut equations but 0 dependent joints"):
        dl.check(made.document)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"base": "arms"}, r"base arms: own.xml has no such link \(did you mean 'arm'"),
        ({"ring": "gone"}, "ring gone: own.xml has no such link"),
        ({"cut": ["turn"]}, "cut turn: 'arm' would hang on nothing"),
        ({"cut": ["gone"]}, "cut gone: is no joint of own.xml; joints that can be cut are turn"),
        ({"output": "mine.xml"}, "must end in .json"),
    ],
)
def test_options_that_do_not_fit_are_refused(options, words):
    with pytest.raises(dl.UsageError, match=words):
        bring(sdf(ARM, TURN), **options)


def test_any_axis_of_a_file_can_point_forward():
    """Base and ring turn alike; the motion is the same, in other axes of the base."""
    plain = dl.import_mechanism(STEWART, ring="ring")
    state = {"q": [0.01, 0.02, -0.01, 1, 0, 0, 0, *[0.0] * 18], "tau": [0.0] * 24}
    state["v_independent"] = [0.1, -0.2, 0.3, 0.2, -0.1, 0.3]
    for forward, axes in (
        ("z", [[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
        ("-y", [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    ):
        made = dl.import_mechanism(STEWART, ring="ring", forward=forward)
        was, ring = (each.document["bodies"][0]["joint"] for each in (plain, made))
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert ring["position"] == pytest.approx(np.transpose(axes) @ was["position"])
        assert made.document["capture"]["rotation"] == axes
        (out, _), (other, _) = evaluate(plain, state), evaluate(made, state)
        assert other["a"] == pytest.approx(out["a"], rel=1e-9, abs=1e-9)
        assert other["base_force"] == pytest.approx(np.transpose(axes) @ out["base_force"])
    with pytest.raises(dl.UsageError, match="forward w: must be one of x, y, z, -x, -y, -z"):
        dl.import_mechanism(STEWART, forward="w")
