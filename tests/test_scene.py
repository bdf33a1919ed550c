"""Scene and mechanism files: what is accepted, how it is converted, what an error says.

These tests need no compiled part.
"""

import json
import math
import re
import tomllib

import pytest

import dockloop as dl
from conftest import SCENES
from dockloop.base import paths, schema
from dockloop.base.errors import UsageError
from dockloop.scene.copies import copy_scene
from dockloop.scene.find import find_scene, read_mechanism, read_toml
from dockloop.scene.placement import read_placed
from dockloop.scene.resolve import (
    SceneReader,
    apply_override,
    load_mechanism,
    parse_value,
    resolve_scene,
)

DEFAULT = "idss_25t_350t"

MINIMAL = """
[chaser]
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]
[mechanism]
name = "own"
"""

ALONE = MINIMAL.partition("[mechanism]")[0]

# A low-level mechanism as other programs write it: under a key, with siblings of their own.
LOW_LEVEL = {
    "format": "whatever",
    "states": [],
    "mechanism": {
        "name": "slider",
        "gravity": [0, 0, -9.81],
        "bodies": [
            {
                "name": "sled",
                "parent": "base",
                "joint": {"type": "prismatic", "axis": [1, 0, 0], "position": [0, 0, 0]},
                "mass": 1.0,
                "com": [0, 0, 0],
                "inertia": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            }
        ],
        "loops": [],
    },
}


def resolve(*overrides, scene=DEFAULT):
    return resolve_scene(find_scene(scene), overrides)


@pytest.mark.parametrize("scene", SCENES)
def test_every_shipped_scene_resolves_to_plain_si_json(scene):
    document = resolve(scene=scene)
    text = json.dumps(document, allow_nan=False)
    assert document["name"] == scene
    assert "_deg" not in text
    assert "comment" not in text


@pytest.mark.parametrize("path", sorted(paths.MECHANISMS.glob("*.json")), ids=lambda p: p.stem)
def test_every_shipped_mechanism_satisfies_its_schema_and_is_named_like_its_file(path):
    mechanism = read_mechanism(path)
    schema.check(mechanism, "mechanism", path)
    assert mechanism["name"] == path.stem


def test_magnitudes_and_directions_become_vectors_of_a():
    initial = resolve(
        "initial.lateral_offset=0.2",
        "initial.lateral_direction_deg=90",
        "initial.pitch_yaw_deg=2",
        "initial.pitch_yaw_direction_deg=180",
        "initial.roll_deg=-3",
        "initial.roll_rate_deg_s=0.1",
        "initial.pitch_yaw_rate_deg_s=0.2",
        "initial.pitch_yaw_rate_direction_deg=0",
    )["initial"]
    assert initial["lateral"] == pytest.approx([0.0, 0.2], abs=1e-15)
    assert initial["tilt"] == pytest.approx([-math.radians(2), 0.0], abs=1e-15)
    assert initial["roll"] == pytest.approx(-math.radians(3))
    assert initial["angular_velocity"] == pytest.approx([math.radians(0.1), math.radians(0.2), 0.0])


def test_degrees_of_the_mechanism_become_radians():
    mechanism = resolve()["mechanism"]
    assert mechanism["contact"]["petal_base_half_angle"] == pytest.approx(math.radians(29))
    assert mechanism["latches"]["azimuth"] == pytest.approx([0, math.tau / 3, 2 * math.tau / 3])


def test_overrides_reach_scene_mechanism_and_entries_of_lists_by_name():
    document = resolve(
        "chaser.motion=driven",
        "outputs.groups=['ring', 'legs']",
        "mechanism.set.leg_defaults.stiffness=7100.0",
        "mechanism.set.bodies.ring.mass=41",
        "mechanism.set.legs.4.preload=5",
        "initial.joints.crank.rate=6",
    )
    assert document["chaser"]["motion"] == "driven"
    assert document["outputs"]["groups"] == ["ring", "legs"]
    assert document["mechanism"]["leg_defaults"]["stiffness"] == 7100.0
    assert document["mechanism"]["bodies"][0]["mass"] == 41
    assert document["mechanism"]["legs"][3]["preload"] == 5
    assert document["initial"]["joints"] == {"crank": {"rate": 6}}


def test_a_mechanism_next_to_the_scene_wins_and_may_stand_under_a_key(tmp_path):
    (tmp_path / "mine.toml").write_text(MINIMAL)
    (tmp_path / "own.json").write_text(json.dumps(LOW_LEVEL))
    document = resolve_scene(tmp_path / "mine.toml")
    assert document["mechanism"]["bodies"][0]["name"] == "sled"
    assert "states" not in document["mechanism"]

    (tmp_path / "idss_hexapod.json").write_text(json.dumps(LOW_LEVEL["mechanism"]))
    mechanism = load_mechanism({"name": "idss_hexapod"}, tmp_path / "mine.toml")
    assert len(mechanism["bodies"]) == 1
    assert "legs" not in mechanism


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("chaser.mas=3", ["chaser.mas", "'chaser.mass'"]),
        ("chaser", ["KEY=VALUE"]),
        ("chaser=3", ["section", "chaser.MEMBER"]),
        ("chaser.mass=-3", ["--scene chaser.mass=-3: chaser.mass is -3", "greater than 0"]),
        ("chaser.mass=nan", ["chaser.mass", "nan", "finite"]),
        ("chaser.mass=heavy", ["chaser.mass", "heavy", "a number"]),
        ("chaser.motion=drive", ["chaser.motion", "'driven'"]),
        ("chaser.inertia=[1, 2]", ["chaser.inertia", "2 entries", "must have 6"]),
        ("initial.joints.crank.rat=1", ["initial.joints.crank", "'rat'", "'rate'"]),
        ("initial.joints.crank.rate=fast", ["initial.joints.crank.rate", "fast", "a number"]),
        ("initial.joints.crank=1", ["initial.joints.crank", "a group of members"]),
        ("outputs.groups=['rings']", ["outputs.groups[1]", "'ring'"]),
        ("experiment.stop=0", ["experiment.stop", "experiment.start"]),
        ("mechanism.name=idss_hexapd", ["mechanism.name", "idss_hexapd", "'idss_hexapod'"]),
        ("mechanism.set.bodies.rng.mass=1", ["bodies", "'rng'", "'ring'"]),
        (
            "mechanism.set.bodies.ring.mass=-1",
            ["idss_hexapod.json", "bodies[1].mass", "-1", "'ring'"],
        ),
        ("mechanism.set.contact.law.tow=1", ["contact.law", "'tow'", "'toe'"]),
        ("mechanism.set.leg_defaults.stops.toe=soft", ["leg_defaults.stops.toe", "a number"]),
    ],
)
def test_a_bad_override_is_refused_in_one_sentence_that_names_member_and_limit(override, words):
    with pytest.raises(UsageError) as error:
        resolve(override)
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("chaser.mass=-1", "chaser.mass is -1: must be greater than 0"),
        ("chaser.part.1.mass=-2", "chaser.part[1].mass is -2: must be greater than 0"),
        ("chaser.inertia.1=abc", 'chaser.inertia[1] is "abc": must be a number'),
        ("chaser.mo*=1", "chaser.motion is 1: must be one of free, driven, fixed"),
        ("c*mass=-3", "chaser.mass is -3: must be greater than 0"),
        ("target.interface_position=[1]", "target.interface_position has 1 entries: must have 3"),
        ("chaser.part.1.mass=4", "chaser.part[1] lacks the member 'joint'"),
        (
            "experiment.start=50",
            "experiment.stop is 20.0: must be greater than experiment.start = 50",
        ),
    ],
)
def test_a_bad_value_is_blamed_on_the_override_that_has_set_it(override, sentence):
    others = [
        "initial.closing_speed=0.05",
        "chaser.mass=2e3",
        "experiment.start=0",
        "target.interface_position.1=4",
    ]
    with pytest.raises(UsageError) as error:
        resolve_scene(find_scene("hexapod"), [*others, override])
    assert str(error.value) == f"--scene {override}: {sentence}"


@pytest.mark.parametrize(
    ("change", "override", "sentence"),
    [
        (("mass = ", "mass = -"), "experiment.stop=9", r"chaser\.mass is -"),
        (("[chaser]", "[chaser]\nbody = 3"), "chaser.motion=free", "chaser has an unknown member"),
        (
            ("[chaser]", "[contact]\nfriction_coefficient = 0.3\n[chaser]"),
            "contact.friction_coefficient=0.2",
            r"\[contact\] ",
        ),
    ],
)
def test_a_bad_value_of_a_file_is_blamed_on_the_file(tmp_path, change, override, sentence):
    scene = tmp_path / "alone.toml"
    assert change[0] in ALONE
    scene.write_text(ALONE.replace(*change, 1))
    with pytest.raises(UsageError, match=rf"alone\.toml: {sentence}"):
        resolve_scene(scene, [override])


def test_a_list_of_a_file_that_lacks_a_number_is_named(tmp_path):
    scene = tmp_path / "alone.toml"
    scene.write_text(re.sub("inertia = .*", "inertia = [1, 2]", ALONE))
    with pytest.raises(UsageError, match=r"chaser\.inertia has no number '5': it is \[1, 2\]"):
        resolve_scene(scene, ["chaser.inertia.5=3"])
    with pytest.raises(UsageError, match=r"alone\.toml: chaser\.inertia has 2 entries"):
        resolve_scene(scene, ["chaser.inertia.1=3"])


@pytest.mark.parametrize(
    ("scene", "override", "sentence"),
    [
        (
            "hexapod",
            "chaser.motion=fixed",
            "scene 'hexapod': conditions at first contact need a chaser",
        ),
        (
            "hexapod",
            "chaser.mass=1e300",
            "chaser.mass is 1e+300; its absolute value must be at most 1e30",
        ),
        (
            "idss_25t_350t",
            "mechanism.set.legs.leg1.root_point.1=99",
            "mechanism: leg_defaults.stops (leg 'leg1'): the home length 98.7316 m must",
        ),
        (
            "idss_25t_350t",
            "mechanism.set.home_q=[1]",
            "mechanism: mechanism 'idss_hexapod': home_q",
        ),
        (
            "idss_25t_350t",
            "initial.joints.foo.position=3",
            "initial.joints.foo: the mechanism has no body of that name",
        ),
        (
            "idss_25t_350t",
            "input.1.file=none.csv",
            f"{paths.shown(paths.SCENES / 'none.csv')}: no such table",
        ),
    ],
)
def test_what_the_core_refuses_is_blamed_on_the_override_too(scene, override, sentence):
    others = ["target.inertia.1=5e7", "experiment.stop=9"]
    for overrides in ([*others, override], [override, *others]):
        with pytest.raises(UsageError) as error:
            read_placed(find_scene(scene), overrides)
        assert str(error.value).startswith(f"--scene {override}: {sentence}")


def test_what_the_core_refuses_in_a_file_is_blamed_on_the_file(tmp_path):
    scene = tmp_path / "own.toml"
    scene.write_text(f'{MINIMAL}[initial]\nat = "start"\njoints = {{foo = {{rate = 1}}}}\n')
    (tmp_path / "own.json").write_text(json.dumps(LOW_LEVEL["mechanism"]))
    with pytest.raises(UsageError, match=r"^\S*own\.toml: initial\.joints\.foo: "):
        read_placed(scene, ["chaser.mass=3"])


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("initial.lateral_offset=9", "with these conditions the capture surfaces never touch"),
        ("initial.at=start", "initial.approach_time and initial.closing_speed and"),
    ],
)
def test_a_warning_of_placement_is_blamed_on_the_override(capsys, override, sentence):
    read_placed(find_scene("idss_25t_350t"), [override, "chaser.mass=2e4"])
    assert capsys.readouterr().err.startswith(f"dockloop: warning: --scene {override}: {sentence}")


def test_two_faults_are_blamed_each_on_its_own_override():
    refused, other = "chaser.mass=-1", "target.mass=-1"
    with pytest.raises(UsageError, match=f"^--scene {refused}: chaser.mass is -1"):
        resolve_scene(find_scene("hexapod"), [refused, other])
    for overrides in ([refused, "c*.mass=-1"], [refused, "c*.mass=-1", "experiment.stop=9"]):
        with pytest.raises(UsageError, match=r"^--scene c\*\.mass=-1: chaser.mass is -1"):
            resolve_scene(find_scene("hexapod"), overrides)


def test_a_bad_mechanism_file_is_refused_with_the_path_of_the_member(tmp_path):
    (tmp_path / "mine.toml").write_text(MINIMAL)
    own = tmp_path / "own.json"
    for change, words in (
        (lambda m: m["bodies"][0].pop("joint"), ["own.json", "bodies[1]", "lacks", "'joint'"]),
        (lambda m: m["bodies"][0].update(masss=1), ["bodies[1]", "'masss'", "'mass'"]),
        (lambda m: m["bodies"][0]["joint"].pop("axis"), ["bodies[1].joint", "'axis'"]),
        (lambda m: m.update(loops=[{"name": "a"}]), ["loops[1]", "lacks"]),
    ):
        document = json.loads(json.dumps(LOW_LEVEL))
        change(document["mechanism"])
        own.write_text(json.dumps(document))
        with pytest.raises(UsageError) as error:
            resolve_scene(tmp_path / "mine.toml")
        for word in words:
            assert word in str(error.value)
    own.write_text('{"bodies": [{"name": "a", "mass": 1, "mass": 2}]}')
    with pytest.raises(UsageError, match=r"own\.json: .*bodies\[1\]\.mass is there twice"):
        resolve_scene(tmp_path / "mine.toml")
    own.write_text("{")
    with pytest.raises(UsageError, match="is not JSON"):
        resolve_scene(tmp_path / "mine.toml")


def test_a_scene_without_mechanism_is_a_vehicle_by_itself(tmp_path):
    scene = tmp_path / "alone.toml"
    scene.write_text(ALONE)
    document = resolve_scene(scene)
    assert document["mechanism"] == {"name": "none"}
    assert document["chaser"]["motion"] == "free"
    assert "target" not in document


def test_a_bad_scene_file_is_refused(tmp_path):
    bad = tmp_path / "bad.toml"
    for text, words in (
        ("[chaser", "is not TOML"),
        ("[chaser]\nmass = 1\n", "lacks the member"),
        (MINIMAL.replace("own", "nowhere"), "no nowhere.json"),
        (MINIMAL.replace('name = "own"', 'nam = "own"'), "mechanism"),
        (ALONE + "[contact]\nstiffness = 1e6\n", "guide ring, but there is none"),
    ):
        bad.write_text(text)
        with pytest.raises(UsageError, match=words):
            resolve_scene(bad)
    with pytest.raises(UsageError, match="no such scene file"):
        find_scene(str(tmp_path / "none.toml"))
    (tmp_path / "my-scene.toml").write_text(MINIMAL)
    with pytest.raises(UsageError, match="letters, digits and _"):
        find_scene(str(tmp_path / "my-scene.toml"))


def test_an_override_parses_toml_values_and_bare_words():
    scene = {}
    apply_override(scene, "chaser.mass = 2.5e4")
    apply_override(scene, "chaser.motion=fixed")
    apply_override(scene, "chaser.interface_position=[1, 2, 3]")
    assert scene == {"chaser": {"mass": 2.5e4, "motion": "fixed", "interface_position": [1, 2, 3]}}


def test_an_override_with_a_star_sets_the_joints_that_the_scene_starts():
    scene = {"initial": {"joints": {"inner": {"rate": 1.0}, "outer": {}}}}
    places = apply_override(scene, "initial.joints.*.position=0.5")
    assert [place[2] for place in places] == ["inner", "outer"]
    joints = {"inner": {"rate": 1.0, "position": 0.5}, "outer": {"position": 0.5}}
    assert scene == {"initial": {"joints": joints}}


def list_numbers(node, path=()):
    """Yield the path of every number that is a member of a group, and what kind of member it is."""
    if isinstance(node, dict):
        kind = (node.get("type"), node.get("kind"))
        for name, value in node.items():
            if type(value) in (int, float):
                yield (*path, name), (*(part for part in path if isinstance(part, str)), name, kind)
            yield from list_numbers(value, (*path, name))
    if isinstance(node, list):
        for number, value in enumerate(node):
            yield from list_numbers(value, (*path, number))


def test_an_override_sets_one_number_of_a_list():
    assert resolve("target.position.2=3", scene="absorber_1d")["target"]["position"][1] == 3
    springs = resolve("mechanism.set.forces.side*.laws.1.stages.1.2=7", scene="probe_drogue")
    stages = {e["name"]: e["laws"][0].get("stages") for e in springs["mechanism"]["forces"]}
    assert [stages[f"side{k}"] for k in range(1, 5)] == 4 * [[[0, 7]]]
    assert stages["probe"] == [[0, 4000]]
    for key, words in (
        ("target.position.4", "target.position has no number '4': it is"),
        ("target.mass.1", "a scene has no key 'target.mass.1'"),
    ):
        with pytest.raises(UsageError, match=words):
            resolve(f"{key}=1", scene="absorber_1d")
    with pytest.raises(UsageError, match=r"laws\[1\]\.stages\[1\]\[2\] is -4: must be at least 0"):
        resolve("mechanism.set.forces.side1.laws.1.stages.1.2=-4", scene="probe_drogue")
    with pytest.raises(UsageError, match="must end with the name of a member, or the place of"):
        resolve("mechanism.set.forces.side1.laws.1.stages.1.3=4", scene="probe_drogue")


def test_overrides_of_a_law_that_is_not_there_say_where_the_number_is():
    with pytest.raises(UsageError, match=r"mechanism\.set\.contact\.MEMBER"):
        resolve("contact.stiffness=3e4", scene="absorber_1d")
    made = resolve("mechanism.set.contact.stiffness=3e4", scene="absorber_1d")
    assert made["mechanism"]["contact"]["stiffness"] == 3e4


def test_a_changed_number_is_checked_as_with_its_whole_document():
    """One member of each kind in all shipped files: the same sentence, or none."""
    documents = [("scene", read_toml(file)[0]) for file in sorted(paths.SCENES.glob("*.toml"))]
    files = sorted(paths.MECHANISMS.glob("*.json"))
    documents += [("mechanism", read_mechanism(file)) for file in files]
    documents.sort(key=lambda each: len(str(each)))  # each kind in the smallest one: it is quick
    seen, refused = set(), 0
    for name, document in documents:
        for path, kind in list_numbers(document):
            if (name, kind) in seen:
                continue
            seen.add((name, kind))
            group, checker = document, schema.Checker(name)
            for part in path[:-1]:
                group = group[part]
            was = group[path[-1]]
            assert checker.find_violation(document, {path: was}) is None
            for value in (-2.5, 1e4):
                group[path[-1]] = value
                found = checker.find_violation(document, {path: value})
                assert found == schema.find_violation(document, name), (path, value)
                refused += found is not None
            group[path[-1]] = was
    assert len(seen) > 100
    assert refused > 50


def test_a_reader_refuses_what_a_scene_refuses():
    """Good values first, so that only what changes is checked."""
    path = find_scene(DEFAULT)
    reader = SceneReader(path)
    for good, bad in (
        ("chaser.mass=2e4", "chaser.mass=-1"),
        ("chaser.mass=2e4", "chaser.mass=1e999"),
        ("chaser.mass=2e4", "chaser.mass=heavy"),
        ("initial.pitch_yaw_deg=1", "initial.pitch_yaw_deg=31.0"),
        ("mechanism.set.leg_defaults.stiffness=1e3", "mechanism.set.leg_defaults.stiffness=-1e3"),
        ("mechanism.set.legs.4.preload=5", "mechanism.set.legs.4.preload=inf"),
        ("solver.method=7", "solver.method=7.5"),
    ):
        assert reader.resolve([good]) == resolve_scene(path, [good])
        assert reader.resolve([good]) == resolve_scene(path, [good])
        sentences = []
        for refuse in (lambda text: reader.resolve([text]), resolve):
            with pytest.raises(UsageError) as error:
                refuse(bad)
            sentences.append(str(error.value))
        assert sentences[0] == sentences[1]


def test_numbers_of_overrides_are_those_of_toml_and_of_options():
    for text in ("1", "-0", "0.5", "-1.5e-07", "1e+300", "1E400", "+2"):
        expected = tomllib.loads(f"value = {text}")["value"]
        assert repr(parse_value(text)) == repr(expected)
    for text, expected in {"01": 1, "1.": 1.0, ".5": 0.5, "1_0": "1_0", "0x1f": "0x1f"}.items():
        assert repr(parse_value(text)) == repr(expected)


def test_a_step_that_ends_the_sequence_may_have_other_numbers_too():
    """The last step has no time-out, whatever the other key says of it."""
    set_too = {"sequence.stop_after": "seated", "sequence.set.seated.timeout": 5.0}
    for timeout in (5.0, 6.0):
        scene = dl.Scene("apda", set_too | {"sequence.set.seated.timeout": timeout})
        sequence = scene.document["mechanism"]["sequence"]
        steps = {step["name"]: step for step in sequence["steps"]}
        assert (sequence["stop_after"], steps["seated"]["timeout"]) == ("seated", timeout)


def test_a_copy_of_a_scene_and_its_mechanism_is_that_docking(tmp_path):
    for name in SCENES:
        files = copy_scene(name, "mine", tmp_path / name)
        copy, shipped = resolve_scene(files[0]), resolve_scene(paths.SCENES / f"{name}.toml")
        mechanism = copy["mechanism"] | {"name": shipped["mechanism"]["name"]}
        assert copy | {"name": name, "mechanism": mechanism} == shipped
        assert copy["mechanism"]["name"] == "mine"
        assert "# " in files[0].read_text()  # comments stay


def test_a_copy_replaces_nothing(tmp_path):
    first, _ = copy_scene("apda", "mine", tmp_path)
    before = first.read_text()
    (tmp_path / "other.json").write_text("{}")
    for name, why in (
        ("mine", "is there already"),
        ("other", "other.json: is there already"),
        ("my-docking", "letters, digits and _"),
    ):
        with pytest.raises(UsageError, match=why):
            copy_scene("hexapod", name, tmp_path)
    assert first.read_text() == before
    assert not (tmp_path / "other.toml").exists()
