"""Reads MJCF through MuJoCo, which resolves includes, defaults, units and inertia of shapes."""

import warnings
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from dockloop.base.errors import DockloopError, UsageError
from dockloop.exchange.constructs import GUESSED, LEFT_OUT, MAPPED, MJCF
from dockloop.exchange.robot import (
    WORLD,
    Coupling,
    Dof,
    Joint,
    Law,
    Link,
    Mesh,
    Report,
    Robot,
    Tendon,
    find_row,
    make_ball,
    rotate_quaternion,
)

_FREE, _BALL, _SLIDE = 0, 1, 2  # kinds of joints, as compiled
_WRAPS_JOINT, _MESH = 1, 7  # parts of tendons, shapes
_PHYSICS = {"gravity", "equality", "constraint", "limit", "frictionloss", "spring", "damper"}
_CLOSED = 1e-6  # m or 1: a weld that is open by less holds


def read_mjcf(file: str, path: Path) -> Robot:
    """Read a model. Raises UsageError; DockloopError if MuJoCo is not installed."""
    try:
        import mujoco
    except ImportError:
        need = "MJCF is read by MuJoCo, which is not installed: pip install 'dockloop[import]'"
        raise DockloopError(f"{file}: {need}") from None
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(path))
            m = spec.compile()
            resolved = ElementTree.fromstring(spec.to_xml())
    except ValueError as error:
        first = " ".join(str(error).split())
        more = ": put it there, or leave out what is drawn only" if "opening" in first else ""
        raise UsageError(f"{file}: MuJoCo does not accept it: {first}{more}") from None
    robot = Robot(spec.modelname or path.stem, Report(file, MJCF), gravity=np.array(m.opt.gravity))
    for warning in warned:
        robot.report.say(GUESSED, f"MuJoCo: {' '.join(str(warning.message).split())}")
    _meet_all(robot.report, resolved)
    _switch_off(mujoco, m, robot)
    data = mujoco.MjData(m)
    data.qpos = m.qpos0
    mujoco.mj_kinematics(m, data)
    names = [WORLD] + [m.body(i).name or f"body{i}" for i in range(1, m.nbody)]
    for i in range(1, m.nbody):
        turn = rotate_quaternion(m.body_iquat[i])
        inertia = turn @ np.diag(m.body_inertia[i]) @ turn.T
        pose = data.xmat[i].reshape(3, 3).copy(), data.xpos[i].copy()
        robot.add_link(Link(names[i], *pose, float(m.body_mass[i]), m.body_ipos[i].copy(), inertia))
        if m.body_gravcomp[i]:
            robot.report.meet("body/@gravcomp")
        if m.body_mocapid[i] >= 0:
            robot.report.meet("body/@mocap")
    for i in range(1, m.nbody):
        robot.add_joint(_read_joint(m, data, i, names, robot.report))
    _read_meshes(spec, m, data, robot)
    _read_equalities(mujoco, m, data, names, robot)
    for t in range(m.ntendon):
        _read_tendon(m, t, robot)
    return robot


def _meet_all(report: Report, root: Element) -> None:
    """Count constructs; bodies are nested, and defaults are resolved in joints."""

    def visit(element: Element, path: str) -> None:
        for child in element:
            tag = "body" if child.tag == "body" else f"{path}{child.tag}"
            if child.tag in ("joint", "freejoint") and path == "body/":
                kind = "free" if child.tag == "freejoint" else child.get("type", "hinge")
                report.meet(f"joint[{kind}]")
            elif child.tag == "frame":  # resolved by MuJoCo
                visit(child, path)
            elif child.tag not in ("compiler", "default"):
                report.meet(tag, child.get("name", ""))
                if find_row(MJCF, tag)[1].what != LEFT_OUT:
                    visit(child, "body/" if child.tag == "worldbody" else f"{tag}/")

    visit(root, "")


def _switch_off(mujoco: Any, m: Any, robot: Robot) -> None:
    """Leave out what ``flag`` switches off."""
    bits = mujoco.mjtDisableBit
    found = [bit for bit in bits.__members__.values() if int(m.opt.disableflags) & int(bit)]
    off = {bit.name.removeprefix("mjDSBL_").lower() for bit in found}
    if "gravity" in off:
        robot.gravity = np.zeros(3)
    if off & {"equality", "constraint"}:
        m.eq_active0[:] = 0
    if off & {"limit", "constraint"}:
        m.jnt_limited[:] = m.tendon_limited[:] = 0
    if off & {"frictionloss", "constraint"}:
        m.dof_frictionloss[:] = m.tendon_frictionloss[:] = 0.0
    if "spring" in off:
        m.jnt_stiffness[:] = m.jnt_stiffnesspoly[:] = 0.0
        m.tendon_stiffness[:] = m.tendon_stiffnesspoly[:] = 0.0
    if "damper" in off:
        m.dof_damping[:] = m.dof_dampingpoly[:] = 0.0
        m.tendon_damping[:] = m.tendon_dampingpoly[:] = 0.0
    for name in sorted(off & _PHYSICS):
        robot.report.say(MAPPED, f"option/flag: {name} is switched off")


def _read_joint(m: Any, data: Any, body: int, names: list[str], report: Report) -> Joint:
    """Return the joints of a body as one, in their order."""
    first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
    parent, child = names[m.body_parentid[body]], names[body]
    if count == 0:
        return Joint(f"{child}_fixed", "fixed", parent, child, data.xpos[body].copy())
    dofs: list[Dof] = []
    for j in range(first, first + count):
        name = m.joint(j).name or (f"{child}_joint" + (f"{j - first + 1}" if count > 1 else ""))
        kind, point = m.jnt_type[j], data.xanchor[j].copy()
        law = _read_law(m, j, name, report)
        if kind == _FREE:
            report.say_lost(name, "free", law)
            return Joint(name, "free", parent, child, point)
        if kind == _BALL:
            dofs += make_ball(name, point, data.xmat[body].reshape(3, 3))
            report.say_lost(name, "ball", law)
            continue
        axis = data.xaxis[j].copy()
        dofs.append(Dof(name, "prismatic" if kind == _SLIDE else "revolute", axis, point, law))
    is_ball = len(dofs) == 3 and count == 1
    kind = "ball" if is_ball else dofs[0].kind if len(dofs) == 1 else "chain"
    name = dofs[0].name if count == 1 and not is_ball else name if is_ball else child
    return Joint(name, kind, parent, child, dofs[0].point, dofs)


def _read_law(m: Any, j: int, name: str, report: Report) -> Law:
    """Return forces of a joint; coordinates count from ``ref``, where the file shows it."""
    dof, q = int(m.jnt_dofadr[j]), int(m.jnt_qposadr[j])
    law = Law(damping=float(m.dof_damping[dof]), stiffness=float(m.jnt_stiffness[j]))
    law.friction = float(m.dof_frictionloss[dof])
    law.rest = float(m.qpos_spring[q] - m.qpos0[q])
    if m.jnt_limited[j]:
        law.lower, law.upper = (float(end) for end in m.jnt_range[j] - m.qpos0[q])
        report.meet("joint/@range")
    for key, value in (("damping", law.damping), ("stiffness", law.stiffness)):
        if value:
            report.meet(f"joint/@{key}")
    if law.friction:
        report.meet("joint/@frictionloss")
    if m.dof_armature[dof]:
        report.meet("joint/@armature")
    if m.jnt_actfrclimited[j]:
        report.meet("joint/@actuatorfrcrange")
    if np.any(m.dof_dampingpoly[dof]) or np.any(m.jnt_stiffnesspoly[j]):
        report.say(LEFT_OUT, f"joint '{name}': damping and stiffness beyond the linear term")
    return law


def _read_meshes(spec: Any, m: Any, data: Any, robot: Robot) -> None:
    """Add the files of shapes; MuJoCo has moved their axes to the centre of mass."""
    folder, names = Path(robot.report.file).parent / spec.meshdir, [WORLD, *robot.links]
    for geom in range(m.ngeom):
        if m.geom_type[geom] == _MESH:
            mesh = int(m.geom_dataid[geom])
            turn = data.geom_xmat[geom].reshape(3, 3) @ rotate_quaternion(m.mesh_quat[mesh]).T
            origin = data.geom_xpos[geom] - turn @ m.mesh_pos[mesh]
            file, scale = str(folder / spec.meshes[mesh].file), m.mesh_scale[mesh].copy()
            robot.meshes.append(Mesh(names[m.geom_bodyid[geom]], file, turn, origin, scale))


def _find_terms(m: Any, tendon: int) -> dict[str, float]:
    """Return the joints of a fixed tendon, each with its coefficient; of a spatial one nothing."""
    parts = range(m.tendon_adr[tendon], m.tendon_adr[tendon] + m.tendon_num[tendon])
    joints = [i for i in parts if m.wrap_type[i] == _WRAPS_JOINT]
    return {m.joint(m.wrap_objid[i]).name: float(m.wrap_prm[i]) for i in joints}


def _read_tendon(m: Any, t: int, robot: Robot) -> None:
    """Add the forces of a fixed tendon, counted from the pose of the file."""
    terms = _find_terms(m, t)
    name, report = m.tendon(t).name or f"tendon{t + 1}", robot.report
    stiffness, damping = float(m.tendon_stiffness[t]), float(m.tendon_damping[t])
    (start, end), zero = m.tendon_lengthspring[t], m.tendon_length0[t]
    law = Law(damping=damping, stiffness=stiffness, rest=float(start - zero))
    law.friction = float(m.tendon_frictionloss[t])
    if m.tendon_limited[t]:
        law.lower, law.upper = (float(limit - zero) for limit in m.tendon_range[t])
    if law.is_empty():
        return
    if not terms or (stiffness and start != end):
        why = "a spring with play" if terms else "a path through space"
        report.say(LEFT_OUT, f"forces of tendon '{name}': {why}")
        return
    if np.any(m.tendon_dampingpoly[t]) or np.any(m.tendon_stiffnesspoly[t]):
        report.say(LEFT_OUT, f"tendon '{name}': damping and stiffness beyond the linear term")
    joint = m.joint(next(iter(terms)))
    kind = "prismatic" if joint.type[0] == _SLIDE else "revolute"
    along = Dof(name, kind, np.zeros(3), np.zeros(3), law)
    robot.tendons.append(Tendon(along, list(terms.items())))


def _read_equalities(mujoco: Any, m: Any, data: Any, names: list[str], robot: Robot) -> None:
    kinds, site = mujoco.mjtEq, mujoco.mjtObj.mjOBJ_SITE
    file = robot.report.file
    for i in range(m.neq):
        kind, numbers = kinds(m.eq_type[i]), m.eq_data[i]
        name = m.equality(i).name or f"equality{i + 1}"
        if not m.eq_active0[i]:
            robot.report.say(LEFT_OUT, f"equality '{name}' is not active")
            continue
        ends = [int(m.eq_obj1id[i]), int(m.eq_obj2id[i])]
        if kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
            is_joint = kind == kinds.mjEQ_JOINT
            first, second = (
                ({m.joint(end).name: 1.0} if is_joint else _find_terms(m, end)) if end >= 0 else {}
                for end in ends
            )
            robot.couplings.append(_read_coupling(robot, name, first, second, numbers))
            continue
        if kind not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            raise UsageError(f"{file}: equality '{name}' cannot be mapped: write it by hand")
        places = []
        for side, end in enumerate(ends):
            if m.eq_objtype[i] == site:
                places.append((int(m.site_bodyid[end]), data.site_xpos[end].copy()))
                continue
            local = numbers[3 * side : 3 * side + 3]
            if kind == kinds.mjEQ_WELD:
                local = numbers[:3] if side else np.zeros(3)
            places.append((end, data.xpos[end] + data.xmat[end].reshape(3, 3) @ local))
        (a, point), (b, other) = places
        joint = Joint(name, "ball", names[a], names[b], point)
        if kind == kinds.mjEQ_WELD:
            joint.kind = "fixed"
            turn = data.xmat[a].reshape(3, 3)
            stated = data.xpos[a] + turn @ numbers[3:6]
            turned = turn @ rotate_quaternion(numbers[6:10]) - data.xmat[b].reshape(3, 3)
            if max(np.abs(stated - other).max(), np.abs(turned).max()) > _CLOSED:
                raise UsageError(f"{file}: weld '{name}' is open at the pose of the file: close it")
        else:
            joint.dofs, joint.point_on_child = make_ball(name, point, np.eye(3)), other
        robot.add_joint(joint)


def _read_coupling(
    robot: Robot, name: str, first: dict[str, float], second: dict[str, float], numbers: np.ndarray
) -> Coupling:
    """Return the sum of the first = a0 + a1 x that of the second, all from the pose of the file."""
    file = robot.report.file
    if np.any(numbers[2:5]):
        raise UsageError(
            f"{file}: equality '{name}' has the polynomial {numbers[:5].tolist()}: only the first"
            " two coefficients can be mapped, since ratios of couplings are constant"
        )
    weights = first | {
        joint: first.get(joint, 0.0) - numbers[1] * ratio for joint, ratio in second.items()
    }
    taken = {coupling.dependent for coupling in robot.couplings}
    dependent = next((joint for joint, w in weights.items() if w and joint not in taken), None)
    if dependent is None:
        raise UsageError(
            f"{file}: equality '{name}' cannot be mapped: it needs a joint that no other equality"
            " determines, and spatial tendons have none"
        )
    whole = weights.pop(dependent)
    terms = [(joint, float(-weight / whole)) for joint, weight in weights.items() if weight]
    return Coupling(name, dependent, terms, float(numbers[0] / whole))
