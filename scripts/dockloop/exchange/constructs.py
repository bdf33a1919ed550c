"""What each format can say, and what an import makes of that: one table per format.

A key is the path of an element below the model, ``joint[TYPE]`` a kind of joint. An element that is
not listed takes the row of the nearest listed element around it. The tables make the report of an
import and the page ``modelDescription/IMPORT.md``.
"""

from typing import NamedTuple

MAPPED, GUESSED, LEFT_OUT, REFUSED = "mapped", "guessed", "left out", "refused"
_SHAPE = "contact hardware is written by hand: member 'contact'"
_DRAWN = "drawn only"
_MESH = f"{_DRAWN}; of a mesh the report says the option of 'dockloop view'"
_OTHER = "no part of the mechanics of joints"
_EFFORT = "limits of drives: write a law 'drive' or 'motor'"
_GUESSED_BALL = "three turns, singular at 90 degrees of the second; the cut R3 of a loop"
_END = "a link, or the link to which a frame is attached"
_STOP = "law 'stop'"
_FRICTION = "law 'brake', a bristle with the default presliding"


class Row(NamedTuple):
    """What becomes of a construct.

    Attributes:
        what: `MAPPED`, `GUESSED` (mapped with a number of ours), `LEFT_OUT` or `REFUSED`.
        text: into what it is mapped, or why not.
    """

    what: str
    text: str


SDF = {
    "link": Row(MAPPED, "a body"),
    "link/inertial": Row(MAPPED, "mass, centre of mass, inertia"),
    "link/inertial/fluid_added_mass": Row(REFUSED, "a fluid has no place in space"),
    "link/visual": Row(LEFT_OUT, _MESH),
    "link/collision": Row(LEFT_OUT, _SHAPE),
    "link/light": Row(LEFT_OUT, _DRAWN),
    "link/sensor": Row(LEFT_OUT, _OTHER),
    "link/velocity_decay": Row(LEFT_OUT, "damping of the medium"),
    "link/gravity": Row(LEFT_OUT, "gravity acts on all bodies"),
    "joint": Row(MAPPED, "a joint: parent, child, pose, axes"),
    "joint/parent": Row(MAPPED, _END),
    "joint/child": Row(MAPPED, _END),
    "joint[fixed]": Row(MAPPED, "its bodies become one"),
    "joint[revolute]": Row(MAPPED, "a turn; the cut R1 or R1_planar of a loop"),
    "joint[continuous]": Row(MAPPED, "a turn; the cut R1 or R1_planar of a loop"),
    "joint[prismatic]": Row(MAPPED, "a slide"),
    "joint[ball]": Row(MAPPED, _GUESSED_BALL),
    "joint[universal]": Row(MAPPED, "two turns; the cut R2 of a loop"),
    "joint[revolute2]": Row(MAPPED, "two turns"),
    "joint[screw]": Row(MAPPED, "a turn, a slide and a coupling"),
    "joint[gearbox]": Row(MAPPED, "a coupling of the joints of its two links"),
    "joint/axis/limit": Row(MAPPED, _STOP),
    "joint/axis/limit/stiffness": Row(MAPPED, _STOP),
    "joint/axis/limit/dissipation": Row(
        LEFT_OUT, "damping of a stop is a factor of its force here"
    ),
    "joint/axis/limit/effort": Row(LEFT_OUT, _EFFORT),
    "joint/axis/limit/velocity": Row(LEFT_OUT, _EFFORT),
    "joint/axis/dynamics/damping": Row(MAPPED, "law 'damper'"),
    "joint/axis/dynamics/friction": Row(GUESSED, _FRICTION),
    "joint/axis/dynamics/spring_stiffness": Row(MAPPED, "law 'spring'"),
    "joint/axis/dynamics/spring_reference": Row(MAPPED, "its 'rest'"),
    "joint/axis/mimic": Row(MAPPED, "a coupling"),
    "joint/sensor": Row(LEFT_OUT, _OTHER),
    "joint/physics": Row(LEFT_OUT, "settings of an engine"),
    "frame": Row(MAPPED, "resolved"),
    "pose": Row(LEFT_OUT, "where the model stands: the mechanism is described from its base"),
    "model": Row(REFUSED, "nested models: expand the file with 'gz sdf -p FILE' first"),
    "include": Row(REFUSED, "another file: expand with 'gz sdf -p FILE' first"),
    "plugin": Row(LEFT_OUT, "code of an engine"),
    "gripper": Row(LEFT_OUT, _OTHER),
    "static": Row(LEFT_OUT, _OTHER),
    "self_collide": Row(LEFT_OUT, _OTHER),
    "allow_auto_disable": Row(LEFT_OUT, _OTHER),
    "enable_wind": Row(LEFT_OUT, _OTHER),
}
SDF |= {key.replace("/axis/", "/axis2/"): row for key, row in SDF.items() if "/axis/" in key}

URDF = {
    "link": Row(MAPPED, "a body"),
    "link/inertial": Row(MAPPED, "mass, centre of mass, inertia"),
    "link/visual": Row(LEFT_OUT, _MESH),
    "link/collision": Row(LEFT_OUT, _SHAPE),
    "joint": Row(MAPPED, "a joint: parent, child, origin, axis"),
    "joint[fixed]": Row(MAPPED, "its bodies become one"),
    "joint[revolute]": Row(MAPPED, "a turn"),
    "joint[continuous]": Row(MAPPED, "a turn"),
    "joint[prismatic]": Row(MAPPED, "a slide"),
    "joint[floating]": Row(MAPPED, "a free joint"),
    "joint[planar]": Row(MAPPED, "two slides and a turn"),
    "joint/limit": Row(GUESSED, f"{_STOP} with a stiffness of ours, but for a continuous joint"),
    "joint/limit/@effort": Row(LEFT_OUT, _EFFORT),
    "joint/limit/@velocity": Row(LEFT_OUT, _EFFORT),
    "joint/dynamics/@damping": Row(MAPPED, "law 'damper'"),
    "joint/dynamics/@friction": Row(GUESSED, _FRICTION),
    "joint/mimic": Row(MAPPED, "a coupling"),
    "joint/calibration": Row(LEFT_OUT, _OTHER),
    "joint/safety_controller": Row(LEFT_OUT, "a controller"),
    "material": Row(LEFT_OUT, _DRAWN),
    "transmission": Row(LEFT_OUT, "a drive: write a law 'drive' or 'motor'"),
    "gazebo": Row(LEFT_OUT, "settings of an engine"),
    "mujoco": Row(LEFT_OUT, "settings of an engine"),
}

MJCF = {
    "body": Row(MAPPED, "a body; without a joint it becomes one with its parent"),
    "body/inertial": Row(MAPPED, "mass, centre of mass, inertia"),
    "body/@gravcomp": Row(LEFT_OUT, "a force of the engine against gravity: no drive has it here"),
    "body/@mocap": Row(LEFT_OUT, "a body that a program moves: here it is fixed to its parent"),
    "body/geom": Row(LEFT_OUT, f"beyond mass and inertia; {_SHAPE}"),
    "asset": Row(LEFT_OUT, _MESH),
    "body/site": Row(MAPPED, "resolved"),
    "body/camera": Row(LEFT_OUT, _DRAWN),
    "body/light": Row(LEFT_OUT, _DRAWN),
    "body/plugin": Row(LEFT_OUT, "code of an engine"),
    "joint[hinge]": Row(MAPPED, "a turn"),
    "joint[slide]": Row(MAPPED, "a slide"),
    "joint[ball]": Row(MAPPED, _GUESSED_BALL),
    "joint[free]": Row(MAPPED, "a free joint"),
    "joint/@range": Row(GUESSED, f"{_STOP} with a stiffness of ours"),
    "joint/@damping": Row(MAPPED, "law 'damper'"),
    "joint/@stiffness": Row(MAPPED, "law 'spring'"),
    "joint/@frictionloss": Row(GUESSED, _FRICTION),
    "joint/@armature": Row(LEFT_OUT, "inertia of a rotor: add a body with a coupling"),
    "joint/@actuatorfrcrange": Row(LEFT_OUT, _EFFORT),
    "equality": Row(MAPPED, "by its kind"),
    "equality/connect": Row(MAPPED, "the cut R3 or R1_planar of a loop"),
    "equality/weld": Row(MAPPED, "its bodies become one; another joint is cut"),
    "equality/joint": Row(MAPPED, "a coupling; terms beyond the linear one are refused"),
    "equality/tendon": Row(MAPPED, "a coupling of the joints of fixed tendons; others are refused"),
    "equality/flex": Row(REFUSED, "bodies are rigid"),
    "deformable": Row(REFUSED, "bodies are rigid"),
    "tendon": Row(MAPPED, "by its kind"),
    "tendon/fixed": Row(MAPPED, "its forces: an element along several joints"),
    "tendon/spatial": Row(LEFT_OUT, "a path through space: write a force element along joints"),
    "actuator": Row(LEFT_OUT, "a drive: write a law 'drive' or 'motor'"),
    "sensor": Row(LEFT_OUT, _OTHER),
    "keyframe": Row(LEFT_OUT, "other poses: write 'home_q'"),
    "contact": Row(LEFT_OUT, _SHAPE),
    "visual": Row(LEFT_OUT, _DRAWN),
    "option": Row(
        LEFT_OUT,
        "settings of an engine; gravity is kept, and what a flag switches off is not there",
    ),
    "size": Row(LEFT_OUT, "settings of an engine"),
    "statistic": Row(LEFT_OUT, "settings of an engine"),
    "custom": Row(LEFT_OUT, _OTHER),
    "extension": Row(LEFT_OUT, "code of an engine"),
    "worldbody": Row(MAPPED, "the base, where no other link is named"),
}
# What is read with the rows above. MuJoCo checks its own format.
SIX = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # components of an inertia in URDF and SDF


def _list_parts(text: str, poses: str) -> frozenset[str]:
    """Return the paths of a text; `poses` are attributes of places."""
    parts = set(text.split())
    parts |= {part.replace("/axis", "/axis2", 1) for part in parts if "/axis" in part}
    places = [part for part in parts if part.endswith(("/pose", "/origin"))]
    return frozenset(parts | {f"{place}/@{each}" for place in places for each in poses.split()})


SDF_PARTS = _list_parts(
    "link/@name link/pose link/inertial/pose link/inertial/mass link/inertial/inertia"
    " joint/@name joint/@type joint/pose joint/axis joint/axis/xyz"
    " joint/axis/xyz/@expressed_in joint/axis/use_parent_model_frame joint/axis/dynamics"
    " joint/axis/limit/lower joint/axis/limit/upper joint/axis/mimic/@joint joint/axis/mimic/@axis"
    " joint/axis/mimic/multiplier joint/axis/mimic/offset joint/axis/mimic/reference"
    " joint/screw_thread_pitch joint/thread_pitch joint/gearbox_ratio"
    " joint/gearbox_reference_body frame/@name frame/@attached_to frame/pose",
    "relative_to rotation_format degrees",
) | {f"link/inertial/inertia/{each}" for each in SIX}
URDF_PARTS = _list_parts(
    "link/@name link/inertial/origin link/inertial/mass link/inertial/mass/@value"
    " link/inertial/inertia joint/@name joint/@type joint/parent joint/parent/@link joint/child"
    " joint/child/@link joint/origin joint/axis joint/axis/@xyz joint/dynamics joint/limit/@lower"
    " joint/limit/@upper joint/mimic/@joint joint/mimic/@multiplier joint/mimic/@offset",
    "xyz rpy quat_xyzw",
) | {f"link/inertial/inertia/@{each}" for each in SIX}
FORMATS = {"sdf": SDF, "robot": URDF, "mujoco": MJCF}  # by the root element of a file
UNKNOWN = Row(LEFT_OUT, "no construct that this import knows")


def find_row(table: dict[str, Row], path: str) -> tuple[str, Row]:
    """Return the key and the row of the nearest listed element; the path and UNKNOWN if none."""
    at = path
    while at:
        if at in table:
            return at, table[at]
        at = at.rpartition("/")[0]
    return path, UNKNOWN


def describe(table: dict[str, Row]) -> str:
    """Return a table of constructs as Markdown."""
    rows = [f"| `{key}` | {row.what} | {row.text} |" for key, row in table.items()]
    return "\n".join(["| construct | what becomes of it | into, or why |", "|---|---|---|", *rows])
