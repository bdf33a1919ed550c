"""Every construct of MJCF, URDF and SDF is mapped, refused or reported as left out."""

import base64
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.mesh_option import read_mesh_option
from dockloop.exchange import constructs
from dockloop.view.mesh import read_mesh
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


GEARS = (
    link("frame"), joint("bolts", "fixed", "world", "frame"),
    link("sun"), joint("a", "revolute", "frame", "sun"),
    link("wheel"), joint("b", "revolute", "frame", "wheel"),
    '<joint name="gear" type="gearbox"><parent>sun</parent><child>wheel</child>'
    "<gearbox_reference_body>frame</gearbox_reference_body><gearbox_ratio>3</gearbox_ratio></joint>",
)  # fmt: skip
# Construct of SDF: the model that has it, and what the mechanism or the report must hold.
SDF_CASES = {
    "link": (sdf(ARM, TURN), lambda m: len(m["bodies"]) == 1),
    "link/inertial": (sdf(ARM, TURN), lambda m: m["bodies"][0]["com"] == pytest.approx([0.2, 0.05, -0.02])),
    "joint": (sdf(ARM, TURN), lambda m: m["bodies"][0]["joint"]["position"] == [1, 0, 0]),
    "joint/parent": (
        sdf(ARM, TURN, link("b"), '<frame name="on" attached_to="turn"/>', joint("j", "revolute", "on", "b")),
        lambda m: m["bodies"][1]["parent"] == "arm",
    ),
    "joint/child": (
        sdf(ARM, '<frame name="f" attached_to="arm"/><frame name="g" attached_to="f"><pose>0 0 2 0 0 0</pose></frame>',
            joint("turn", "revolute", "world", "g")),
        lambda m: m["bodies"][0]["joint"]["position"] == [1, 0, 2],
    ),
    "joint[fixed]": (
        sdf(ARM, TURN, link("tool", "2 0 0 0 0 0"), joint("bolt", "fixed", "arm", "tool")),
        lambda m: (
            m["bodies"][0]["mass"] == 4 and np.allclose(m["bodies"][0]["com"], [0.7, 0.05, -0.02])
        ),
    ),
    "joint[revolute]": (sdf(ARM, TURN), lambda m: kinds(m) == ["revolute"]),
    "joint[continuous]": (
        sdf(ARM, joint("turn", "continuous", "world", "arm")),
        lambda m: kinds(m) == ["revolute"] and "forces" not in m,
    ),
    "joint[prismatic]": (
        sdf(ARM, joint("slide", "prismatic", "world", "arm")),
        lambda m: kinds(m) == ["prismatic"],
    ),
    "joint[ball]": (
        sdf(ARM, joint("ball", "ball", "world", "arm", "")),
        lambda m: kinds(m) == ["revolute"] * 3,
    ),
    "joint[universal]": (
        sdf(
            ARM, joint("u", "universal", "world", "arm", axis("") + "<axis2><xyz>0 1 0</xyz></axis2>")
        ),
        lambda m: [b["joint"]["axis"] for b in m["bodies"]] == [[0, 0, 1], [0, 1, 0]],
    ),
    "joint[revolute2]": (
        sdf(
            ARM, joint("u", "revolute2", "world", "arm", axis("") + "<axis2><xyz>1 0 0</xyz></axis2>")
        ),
        lambda m: [b["joint"]["axis"] for b in m["bodies"]] == [[0, 0, 1], [1, 0, 0]],
    ),
    "joint[screw]": (
        sdf(ARM, joint("s", "screw", "world", "arm", axis("") + "<screw_thread_pitch>0.01</screw_thread_pitch>")),
        lambda m: (
            kinds(m) == ["revolute", "prismatic"]
            and m["couplings"][0]["terms"][0]["ratio"] == pytest.approx(0.01 / (2 * math.pi))
        ),
    ),
    "joint[gearbox]": (sdf(*GEARS), lambda m: m["couplings"][0]["terms"][0]["ratio"] == -3),
    "joint/axis/limit": (
        sdf(ARM, turn("<limit><lower>-1</lower><upper>2</upper></limit>")),
        lambda m: (
            [m["forces"][0]["laws"][0][key] for key in ("lower", "upper", "stiffness")] == [-1, 2, 1e4]
        ),
    ),
    "joint/axis/limit/stiffness": (
        sdf(ARM, turn("<limit><lower>-1</lower><upper>2</upper><stiffness>77</stiffness></limit>")),
        lambda m: m["forces"][0]["laws"][0]["stiffness"] == 77,
    ),
    "joint/axis/dynamics/damping": (
        sdf(ARM, turn("<dynamics><damping>3</damping></dynamics>")),
        lambda m: m["forces"][0]["laws"] == [{"type": "damper", "linear": 3}],
    ),
    "joint/axis/dynamics/friction": (
        sdf(ARM, turn("<dynamics><friction>3</friction></dynamics>")),
        lambda m: m["forces"][0]["laws"] == [{"type": "brake", "forward": 3}],
    ),
    "joint/axis/dynamics/spring_stiffness": (
        sdf(ARM, turn("<dynamics><spring_stiffness>3</spring_stiffness></dynamics>")),
        lambda m: m["forces"][0]["laws"][0]["stages"] == [[0, 3]],
    ),
    "joint/axis/dynamics/spring_reference": (
        sdf(ARM, turn("<dynamics><spring_stiffness>3</spring_stiffness>"
                      "<spring_reference>0.2</spring_reference></dynamics>")),
        lambda m: m["forces"][0]["laws"][0]["rest"] == 0.2,
    ),
    "joint/axis/mimic": (
        sdf(ARM, TURN, link("b"), joint("follow", "revolute", "arm", "b", axis(MIMIC))),
        lambda m: (m["couplings"][0]["offset"], m["couplings"][0]["terms"]) == (0.1, [{"joint": "arm", "ratio": 2}]),
    ),
    "frame": (
        sdf('<frame name="f"><pose>0 0 3 0 0 0</pose></frame>',
            link("arm").replace("<pose>", '<pose relative_to="f">', 1), TURN),
        lambda m: m["bodies"][0]["joint"]["position"] == [0, 0, 3],
    ),
}  # fmt: skip


def check_case(row, construct, text, holds=lambda mechanism: True):
    """Import a model; its mechanism holds what it must, and the report has the construct."""
    made = bring(text)
    assert holds(made.document), made.document
    assert any(line.startswith(f"{row.what}: {construct} (") for line in made.report), made.report
    return made


def kinds(mechanism):
    return [body["joint"]["type"] for body in mechanism["bodies"]]


@pytest.mark.parametrize("construct", SDF_CASES)
def test_a_construct_of_sdf_is_mapped_and_reported(construct):
    made = check_case(constructs.SDF[construct], construct, *SDF_CASES[construct])
    assert made.report == made.document["comment"][1:]


URDF_CASES = {
    "link": (urdf(), lambda m: len(m["bodies"]) == 1),
    "link/inertial": (urdf(), lambda m: m["bodies"][0]["com"] == pytest.approx([0.2, 0.05, -0.02])),
    "joint": (urdf(), lambda m: m["bodies"][0]["joint"]["axis"] == [0, 1, 0]),
    "joint[fixed]": (
        urdf(rest=SECOND.replace("prismatic", "fixed").format("")),
        lambda m: m["bodies"][0]["mass"] == 4,
    ),
    "joint[revolute]": (urdf(), lambda m: kinds(m) == ["revolute"]),
    "joint[continuous]": (urdf("continuous"), lambda m: "forces" not in m),
    "joint[prismatic]": (urdf("prismatic"), lambda m: kinds(m) == ["prismatic"]),
    "joint[floating]": (urdf("floating"), lambda m: kinds(m) == ["free"]),
    "joint[planar]": (urdf("planar"), lambda m: kinds(m) == ["prismatic", "prismatic", "revolute"]),
    "joint/limit": (urdf(), lambda m: m["forces"][0]["laws"][0]["upper"] == 2),
    "joint/limit/@effort": (urdf(), lambda m: True),
    "joint/dynamics/@damping": (
        urdf(more='<dynamics damping="3"/>'),
        lambda m: m["forces"][0]["laws"] == [{"type": "damper", "linear": 3}],
    ),
    "joint/dynamics/@friction": (
        urdf(more='<dynamics friction="3"/>'),
        lambda m: m["forces"][0]["laws"] == [{"type": "brake", "forward": 3}],
    ),
    "joint/mimic": (
        urdf(rest=SECOND.format('<mimic joint="turn" multiplier="2" offset="0.1"/>')),
        lambda m: m["couplings"][0]["terms"] == [{"joint": "arm", "ratio": 2}],
    ),
    "link/visual": (urdf(inside="<visual/>"), lambda m: True),
    "transmission": (urdf(rest="<transmission/>"), lambda m: True),
}


@pytest.mark.parametrize("construct", URDF_CASES)
def test_a_construct_of_urdf_is_mapped_and_reported(construct):
    check_case(constructs.URDF[construct], construct, *URDF_CASES[construct])


EQUAL = '<equality><joint joint1="follow" joint2="turn" polycoef="0.1 2 0 0 0"/></equality>'
TENDON = "<tendon>{}</tendon>{}"
TWIN = '<body name="b" pos="0.3 0 0">{}' + IMPORTED + "</body>"
MJCF_CASES = {
    "body": (mjcf(), lambda m: len(m["bodies"]) == 1),
    "joint[hinge]": (mjcf(), lambda m: m["bodies"][0]["joint"]["axis"] == [0, 1, 0]),
    "joint[slide]": (mjcf('<joint type="slide"/>'), lambda m: kinds(m) == ["prismatic"]),
    "joint[ball]": (mjcf('<joint type="ball"/>'), lambda m: kinds(m) == ["revolute"] * 3),
    "joint[free]": (mjcf("<freejoint/>"), lambda m: kinds(m) == ["free"]),
    "joint/@range": (
        mjcf('<joint range="-1 2" limited="true" ref="0.5"/>'),
        lambda m: m["forces"][0]["laws"][0]["lower"] == -1.5,
    ),
    "joint/@damping": (
        mjcf('<joint damping="3"/>'),
        lambda m: m["forces"][0]["laws"] == [{"type": "damper", "linear": 3}],
    ),
    "joint/@stiffness": (
        mjcf('<joint stiffness="3" springref="0.7" ref="0.5"/>'),
        lambda m: m["forces"][0]["laws"][0]["rest"] == pytest.approx(0.2),
    ),
    "joint/@frictionloss": (
        mjcf('<joint frictionloss="3"/>'),
        lambda m: m["forces"][0]["laws"] == [{"type": "brake", "forward": 3}],
    ),
    "joint/@armature": (mjcf('<joint armature="3"/>'), lambda m: True),
    "joint/@actuatorfrcrange": (mjcf('<joint actuatorfrcrange="-1 1"/>'), lambda m: "forces" not in m),
    "body/@gravcomp": (mjcf().replace('"arm"', '"arm" gravcomp="1"'), lambda m: len(m["bodies"]) == 1),
    "body/@mocap": (
        mjcf().replace("</worldbody>", '<body mocap="true"/></worldbody>'),
        lambda m: len(m["bodies"]) == 1,
    ),
    "equality/connect": (
        mjcf(inside=TWIN.format('<joint type="ball"/>'),
             rest='<equality><connect body1="b" anchor="0 0 0.2"/></equality>'),
        lambda m: m["loops"][0]["cut"]["type"] == "R3",
    ),
    "equality/weld": (
        mjcf(inside=TWIN.format("<joint/>"), rest='<equality><weld body1="arm" body2="b"/></equality>'),
        lambda m: len(m["bodies"]) == 1 and m["bodies"][0]["mass"] == 4,
    ),
    "equality/joint": (
        mjcf(inside=INNER, rest=EQUAL),
        lambda m: (m["couplings"][0]["offset"], m["couplings"][0]["terms"]) == (0.1, [{"joint": "arm", "ratio": 2}]),
    ),
    "tendon/fixed": (
        mjcf('<joint name="turn" ref="0.5"/>', INNER, TENDON.format(
            "<fixed name='t' stiffness='3' springlength='1.7' damping='7' range='-1 3' limited='true'>"
            "<joint joint='turn' coef='2'/><joint joint='follow' coef='-4'/></fixed>", "")),
        lambda m: m["forces"] == [
            {"name": "t", "along": [{"joint": "arm", "ratio": 2}, {"joint": "b", "ratio": -4}],
             "laws": [{"type": "spring", "stages": [[0, 3]], "rest": pytest.approx(0.7)},
                      {"type": "damper", "linear": 7},
                      {"type": "stop", "lower": -2, "upper": 2, "stiffness": 1e4, "toe": 0.01}]}],
    ),
    "equality/tendon": (
        mjcf('<joint name="turn" ref="0.5"/>', INNER, TENDON.format(
            "<fixed name='t'><joint joint='turn' coef='2'/><joint joint='follow' coef='-4'/></fixed>"
            "<fixed name='s'><joint joint='follow' coef='1'/></fixed>",
            "<equality><tendon tendon1='t' tendon2='s' polycoef='0.6 2 0 0 0'/></equality>")),
        lambda m: m["couplings"] == [
            {"name": "equality1", "dependent": "arm", "terms": [{"joint": "b", "ratio": 3}], "offset": 0.3}
        ],
    ),
    "body/geom": (mjcf(inside='<geom size="0.1"/>'), lambda m: True),
    "actuator": (mjcf(rest='<actuator><motor joint="turn"/></actuator>'), lambda m: True),
    "keyframe": (mjcf(rest='<keyframe><key qpos="0.1"/></keyframe>'), lambda m: True),
}  # fmt: skip


@pytest.mark.parametrize("construct", MJCF_CASES)
def test_a_construct_of_mjcf_is_mapped_and_reported(construct):
    check_case(constructs.MJCF[construct], construct, *MJCF_CASES[construct])


def put(root, key):
    """Add the element (and attribute) that a key names, with the elements above it."""
    at = root
    *above, last = key.split("/")
    for tag in above:
        name = tag.partition("[")[0]
        found = at.find(name)
        at = found if found is not None else ElementTree.SubElement(at, name)
    if last.startswith("@"):
        at.set(last[1:], "1")
    else:
        ElementTree.SubElement(at, last, {"name": "extra"})


@pytest.mark.parametrize(
    "construct", sorted(key for key, row in constructs.SDF.items() if key not in SDF_CASES)
)
def test_other_constructs_of_sdf_are_reported_as_left_out_or_refused(construct):
    row = constructs.SDF[construct]
    root = ElementTree.fromstring(sdf(ARM, TURN))
    if construct.startswith("joint/axis2"):  # as axis, which has its cases
        assert row == constructs.SDF[construct.replace("axis2", "axis")]
        return
    put(root.find("model"), construct)
    text = ElementTree.tostring(root, encoding="unicode")
    if row.what == constructs.REFUSED:
        with pytest.raises(dl.UsageError, match=f"own.xml: {construct}.* cannot be mapped: "):
            bring(text)
    else:
        assert f"left out: {construct} (1): {row.text}" in bring(text).report


@pytest.mark.parametrize(
    "construct", sorted(key for key, row in constructs.URDF.items() if key not in URDF_CASES)
)
def test_other_constructs_of_urdf_are_reported_as_left_out(construct):
    root = ElementTree.fromstring(urdf())
    put(root, construct)
    row = constructs.URDF[construct]
    made = bring(ElementTree.tostring(root, encoding="unicode"))
    assert f"left out: {construct} (1): {row.text}" in made.report


def test_what_no_table_lists_is_reported():
    assert (
        "left out: warp (1): no construct that this import knows"
        in bring(sdf(ARM, TURN, "<warp/>")).report
    )


MJCF_OTHERS = {  # construct: the model that has it, in the words of the format
    "body/inertial": mjcf(),
    "body/site": mjcf(inside='<site name="s"/>'),
    "body/camera": mjcf(inside='<camera name="s"/>'),
    "body/light": mjcf(inside='<light name="s"/>'),
    "tendon": mjcf(rest='<tendon><fixed name="t"><joint joint="turn" coef="1"/></fixed></tendon>'),
    "sensor": mjcf(rest='<sensor><jointpos joint="turn"/></sensor>'),
    "contact": mjcf(inside=INNER, rest='<contact><exclude body1="arm" body2="b"/></contact>'),
    "asset": mjcf(rest='<asset><material name="m"/></asset>'),
    "visual": mjcf(rest='<visual><map znear="0.5"/></visual>'),
    "option": mjcf(rest='<option timestep="0.01"/>'),
    "size": mjcf(rest='<size memory="1M"/>'),
    "statistic": mjcf(rest='<statistic extent="2"/>'),
    "custom": mjcf(rest='<custom><numeric name="n" data="1"/></custom>'),
    "worldbody": mjcf(),
    "equality": mjcf(inside=INNER, rest=EQUAL),
    "tendon/spatial": mjcf(
        inside='<site name="s"/>',
        rest='<tendon><spatial stiffness="1"><site site="s"/><site site="o"/></spatial></tendon>',
    ).replace("<worldbody>", '<worldbody><site name="o"/>'),
}


@pytest.mark.parametrize("construct", MJCF_OTHERS)
def test_other_constructs_of_mjcf_are_reported_or_refused(construct):
    row = constructs.MJCF[construct]
    if row.what == constructs.REFUSED:
        with pytest.raises(dl.UsageError, match=f"{construct}.* cannot be mapped: "):
            bring(MJCF_OTHERS[construct])
        return
    check_case(row, construct, MJCF_OTHERS[construct])


def test_a_tendon_without_a_free_joint_cannot_be_coupled():
    """Two equalities for one joint; a path through space; beyond the linear term."""
    one = "<fixed name='t'><joint joint='turn' coef='1'/></fixed>"
    words = "cannot be mapped: it needs a joint that no other equality determines"
    twice = "<equality><tendon tendon1='t'/><tendon tendon1='t' polycoef='1 0 0 0 0'/></equality>"
    with pytest.raises(dl.UsageError, match=words):
        bring(mjcf(rest=TENDON.format(one, twice)))
    spatial = "<spatial name='t'><site site='s'/><site site='o'/></spatial>"
    spatial = mjcf(
        inside='<site name="s"/>',
        rest=TENDON.format(spatial, "<equality><tendon tendon1='t'/></equality>"),
    )
    with pytest.raises(dl.UsageError, match=words):
        bring(spatial.replace("<worldbody>", '<worldbody><site name="o"/>'))
    bent = "<equality><tendon tendon1='t' polycoef='0 0 1 0 0'/></equality>"
    with pytest.raises(dl.UsageError, match="has the polynomial"):
        bring(mjcf(rest=TENDON.format(one, bent)))


def test_equalities_of_one_joint_determine_one_after_the_other():
    two = INNER.replace('name="b"', 'name="c"').replace('"follow"', '"third"')
    equal = EQUAL.replace("</equality>", "<joint joint1='follow' joint2='third'/></equality>")
    made = bring(mjcf(inside=INNER + two, rest=equal)).document["couplings"]
    assert [coupling["dependent"] for coupling in made] == ["b", "c"]
    assert made[1]["terms"] == [{"joint": "b", "ratio": 1.0}]


# Those that need an engine's plugin or files of soft bodies have no example here.
WITHOUT_EXAMPLE = {"body/plugin", "extension", "equality/flex", "deformable"}


def test_every_construct_has_a_case():
    assert set(constructs.MJCF) == set(MJCF_CASES) | set(MJCF_OTHERS) | WITHOUT_EXAMPLE


@pytest.mark.parametrize("root", constructs.FORMATS)
def test_the_page_lists_the_constructs(root):
    page = (paths.MODELS / "IMPORT.md").read_text()
    assert constructs.describe(constructs.FORMATS[root]) in page


VISUAL = "<visual name='v'><pose>0 0.5 0 0 0 1.5707963267948966</pose><geometry><mesh><uri>{}</uri>{}</mesh></geometry></visual>"
MESHES = {
    "sdf": sdf(link("arm", "1 0 0 0 0 0", INERTIAL + VISUAL.format("model://own/arm.stl", "<scale>2 2 2</scale>")), TURN),
    "urdf": urdf(inside='<visual><origin xyz="0 0.5 0" rpy="0 0 1.5707963267948966"/><geometry>'
                 '<mesh filename="package://own/arm.stl" scale="2 2 2"/></geometry></visual>'),
    "mjcf": mjcf(inside='<geom type="mesh" mesh="arm" pos="0 0.5 0" euler="0 0 1.5707963267948966"/>',
                 rest='<asset><mesh name="arm" file="arm.stl" scale="2 2 2"/></asset>'),
}  # fmt: skip


@pytest.mark.parametrize("form", MESHES)
def test_the_report_has_the_option_that_draws_a_mesh(form):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3.0]], "<f4")
    facets = (
        corners[list(face)].tobytes() for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    )
    content = b"".join(bytes(12) + facet + bytes(2) for facet in facets)
    Path("arm.stl").write_bytes(bytes(80) + (4).to_bytes(4, "little") + content)
    report = bring(MESHES[form]).report
    words = "left out: mesh of 'arm': dockloop view RESULT --mesh "
    (text,) = [line.removeprefix(words) for line in report if line.startswith(words)]
    option = read_mesh_option(text)
    assert (option.name, option.file) == ("arm", "arm.stl")
    half = np.sqrt(0.5)
    assert option.pose == pytest.approx([0, 0.5, 0, half, 0, 0, half], abs=1e-9)
    assert option.scale == pytest.approx([2, 2, 2])
    _, mesh = read_mesh(text)
    points = np.frombuffer(base64.b64decode(mesh["points"]), "<f4").reshape(-1, 3)
    assert points.max(axis=0) == pytest.approx([0, 2.5, 6], abs=1e-6)


def test_a_mesh_at_the_axes_of_its_body_needs_no_pose():
    plain = VISUAL.replace("0 0.5 0 0 0 1.5707963267948966", "0 0 0 0 0 0").format("my arm.stl", "")
    report = bring(sdf(link("arm", "1 0 0 0 0 0", INERTIAL + plain), TURN)).report
    assert "left out: mesh of 'arm': dockloop view RESULT --mesh 'arm=my arm.stl'" in report
