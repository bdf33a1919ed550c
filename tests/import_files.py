"""Small files of SDF, URDF and MJCF, and their import, for tests."""

from pathlib import Path

import dockloop as dl

INERTIAL = (
    "<inertial><mass>2</mass><pose>0.2 0.05 -0.02 0.3 -0.2 0.5</pose><inertia><ixx>0.02</ixx>"
    "<iyy>0.05</iyy><izz>0.06</izz><ixy>0.003</ixy><ixz>-0.002</ixz><iyz>0.004</iyz></inertia>"
    "</inertial>"
)


def bring(text, name="own.xml", **options):
    Path(name).write_text(text)
    return dl.import_mechanism(name, **options)


def link(name, pose="0 0 0 0 0 0", more=INERTIAL):
    return f'<link name="{name}"><pose>{pose}</pose>{more}</link>'


def joint(name, kind, parent, child, more="<axis><xyz>0 0 1</xyz></axis>"):
    ends = f"<parent>{parent}</parent><child>{child}</child>"
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


def sdf(*parts):
    return f'<sdf version="1.10"><model name="own">{"".join(parts)}</model></sdf>'


ARM = link("arm", "1 0 0 0 0 0")
TURN = joint("turn", "revolute", "world", "arm")


def axis(more, xyz="0 0 1"):
    return f"<axis><xyz>{xyz}</xyz>{more}</axis>"


def turn(more):
    return joint("turn", "revolute", "world", "arm", axis(more))


MIMIC = '<mimic joint="turn"><multiplier>2</multiplier><offset>0.1</offset></mimic>'
ROBOT_LINK = (
    '<link name="{}"><inertial><origin xyz="0.2 0.05 -0.02" rpy="0.3 -0.2 0.5"/><mass value="2"/>'
    '<inertia ixx="0.02" iyy="0.05" izz="0.06" ixy="0.003" ixz="-0.002" iyz="0.004"/></inertial>'
    "{}</link>"
)


def urdf(
    kind="revolute",
    more='<limit lower="-1" upper="2" effort="1" velocity="1"/>',
    rest="",
    inside="",
):
    base = '<link name="base"/>'
    ends = '<parent link="base"/><child link="arm"/><origin xyz="1 0 0" rpy="0 0 0.5"/><axis xyz="0 1 0"/>'
    arm = ROBOT_LINK.format("arm", inside)
    return f'<robot name="own">{base}{arm}<joint name="turn" type="{kind}">{ends}{more}</joint>{rest}</robot>'


SECOND = ROBOT_LINK.format("b", "") + (
    '<joint name="follow" type="prismatic"><parent link="arm"/><child link="b"/>'
    '<origin xyz="0 0.4 0"/><axis xyz="1 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{}</joint>'
)
IMPORTED = (
    '<inertial pos="0.2 0.05 -0.02" mass="2" fullinertia="0.02 0.05 0.06 0.003 -0.002 0.004"/>'
)


def mjcf(joints='<joint name="turn" axis="0 1 0"/>', inside="", rest=""):
    body = f'<body name="arm" pos="1 0 0" euler="0 0 0.5">{joints}{IMPORTED}{inside}</body>'
    return (
        '<mujoco model="own"><compiler angle="radian" balanceinertia="false"/>'
        f"<worldbody>{body}</worldbody>{rest}</mujoco>"
    )


INNER = f'<body name="b" pos="0 0.4 0"><joint name="follow" type="slide" axis="1 0 1"/>{IMPORTED}</body>'
