"""The Python interface: ``import dockloop as dl``.

1. `dl.run` gives the bits of ``dockloop run``: values, names, units, parameters, summary.
2. `dl.Docking`, driven by hand, gives the bits of the FMU driven by FMPy; a state that one saved is
   restored by the other.
3. Values: numbers, vectors, Booleans; shapes and units of results and tables.
4. Refusals are one sentence that names variable, value and limit, and change nothing.
5. The interface is typed and starts quickly; pandas and matplotlib are imported when used.
"""

import json
import math
import subprocess
import sys
import tomllib
from collections.abc import Iterator

import numpy as np
import pytest
from fmpy import fmi2

import dockloop as dl
from dockloop.base import paths
from dockloop.fmu.host import Instance, unpack_fmu
from dockloop.native.core import load_core, to_json
from programs import call

pytestmark = pytest.mark.usefixtures("native")  # the bits of FMUs are compared with the core's

SCENE = "idss_25t_350t"
DRIVEN = {"target.motion": "driven"}
SLOW = {"initial.closing_speed": 0.05, "initial.approach_time": 0.2}


@pytest.mark.parametrize(
    ("overrides", "starts"), [({}, {}), (SLOW, {"friction.coefficient": 0.2}), (DRIVEN, {})]
)
def test_a_run_has_the_bits_of_the_command(runs, overrides, starts):
    texts = [
        f'{key}="{value}"' if value == "driven" else f"{key}={value}"
        for key, value in overrides.items()
    ]
    settings = tuple(f"{name}={value}" for name, value in starts.items())
    fmu = runs.run(SCENE, *texts, settings=settings, stop=2.0, step=0.05)
    ours = dl.run(SCENE, overrides=overrides, start_values=starts, stop=2.0, step=0.05)
    assert (ours.names, ours.units, ours.parameters) == (fmu.names, fmu.units, fmu.parameters)
    assert ours.values.tobytes() == fmu.values.tobytes()
    assert ours.scene == fmu.scene
    assert ours.warnings == fmu.warnings
    assert {**ours.summary, "time": 0} == {**fmu.summary, "time": 0}


class Fmu:
    """An FMU driven through FMPy by names, one call per value."""

    def __init__(self, instance: Instance) -> None:
        self.slave, self.time = instance.slave, 0.0
        self.variables = {v.name: v for v in instance.description.modelVariables}

    def set(self, name: str, value: float) -> None:
        variable = self.variables[name]
        getattr(self.slave, f"set{variable.type}")([variable.valueReference], [value])

    def get(self, name: str) -> float:
        variable = self.variables[name]
        return getattr(self.slave, f"get{variable.type}")([variable.valueReference])[0]

    def step(self, h: float) -> None:
        self.slave.fmi2DoStep(self.slave.component, self.time, h, fmi2.fmi2True)
        self.time += h


@pytest.fixture
def fmu(runs, tmp_path) -> Iterator[Fmu]:
    """The FMU of the scene whose target is driven, in initialization mode."""
    description, _ = unpack_fmu(runs.fmu(SCENE, 'target.motion="driven"'), tmp_path)
    with Instance(description, str(tmp_path), "the FMU") as instance:
        instance.slave.setupExperiment(startTime=0.0)
        instance.slave.enterInitializationMode()
        yield Fmu(instance)


def test_a_docking_driven_by_hand_has_the_bits_of_the_fmu(fmu):
    docking = dl.Docking(SCENE, DRIVEN)
    assert set(docking.variables) == set(fmu.variables)
    both = (docking, fmu)

    def compare() -> None:
        for name in docking.variables:
            assert docking.get(name) == fmu.get(name), name

    for one in both:
        one.set("friction.coefficient", 0.3)
        one.set("chaser.mass", 24e3)
        one.set("solver.method", 3)
    fmu.slave.exitInitializationMode()
    moved = np.array([fmu.get(f"target.position[{i}]") for i in (1, 2, 3)])
    velocity = np.array([fmu.get(f"target.velocity[{i}]") for i in (1, 2, 3)])
    for step in range(40):
        for one in both:
            one.step(0.05)
        moved = moved + 0.05 * velocity
        docking.set("target.position", moved)
        for i in (1, 2, 3):
            fmu.set(f"target.position[{i}]", moved[i - 1])
        if step == 20:
            for one in both:
                one.set("friction.coefficient", 0.1)
    assert docking.time == fmu.time
    compare()


def test_states_travel_between_docking_and_fmu(fmu):
    docking = dl.Docking(SCENE, DRIVEN)
    fmu.slave.exitInitializationMode()
    for one in (docking, fmu):
        for _ in range(20):
            one.step(0.1)
    state = docking.save()
    ends = []
    for restored in (docking, dl.Docking(SCENE, DRIVEN)):
        restored.restore(state)
        assert restored.time == docking.time or restored is not docking
        restored.step(0.1)
        ends.append(restored.save())
    assert ends[0] == ends[1]
    component = fmu.slave
    saved = component.getFMUstate()
    of_fmu = bytes(component.serializeFMUstate(saved))
    component.freeFMUstate(saved)
    fmu.step(0.1)
    docking.restore(of_fmu)
    docking.step(0.1)
    for name in ("relative.axial", "target.force_mean[1]", "energy.kinetic"):
        assert docking.get(name) == fmu.get(name), name


def test_a_refused_step_leaves_the_docking_where_it_was():
    docking = dl.Docking("hexapod_bench")
    docking.step(0.01)
    before = docking.save()
    for h in (0.0, -1.0, float("nan"), "0.01", None, [0.01]):
        with pytest.raises(dl.UsageError, match=r"Docking\.step: h is .*a positive, finite number"):
            docking.step(h)
    assert docking.save() == before


def test_values_have_the_types_and_shapes_of_their_variables():
    docking = dl.Docking(SCENE, SLOW)
    assert isinstance(docking.get("relative.axial"), float)
    assert isinstance(docking.get("phase"), int)
    assert docking.get("captured") is False
    assert docking.get("relative.position").shape == (3,)
    assert docking.get("latched").dtype == bool
    docking.set("chaser.force_ext", [1.0, 2.0, 3.0])
    assert docking.get("chaser.force_ext").tolist() == [1.0, 2.0, 3.0]
    variable = docking.variables["chaser.mass"]
    assert (variable.unit, variable.causality, variable.start) == ("kg", "parameter", 25000.0)
    docking.set("chaser.mass", 1000)
    assert docking.get("chaser.mass") == 1000.0
    assert docking.time == 0.0


REFUSED = {
    ("gapp", 1.0): "idss_25t_350t: there is no variable 'gapp' (did you mean 'gap'?)",
    ("gap", 1.0): "Docking.set: 'gap' is computed and cannot be set",
    ("chaser.mass", -1.0): "Docking.set: 'chaser.mass' = -1 is below its minimum 0 kg",
    ("chaser.mass", "heavy"): "Docking.set: 'chaser.mass' is 'heavy': must be a number",
    ("chaser.mass", (1.0, 2.0)): "Docking.set: 'chaser.mass' is (1.0, 2.0): must be one number",
    ("chaser.force_ext", 1.0): "Docking.set: 'chaser.force_ext' is 1.0: must be 3 numbers",
    ("solver.method", 2.5): "Docking.set: 'solver.method' must be a whole number",
    ("initial.roll_deg", 1.0): "it is a key of the scene: overrides={'initial.roll_deg': ...}",
    ("coupling.mode", 2): "that a host integrates needs it: overrides={'chaser.motion': 'driven'}",
}


def test_a_key_for_hosts_says_where_there_is_none():
    mode = {"coupling.mode": "parallel"}
    said = dl.Docking(SCENE, mode).warnings
    assert len(said) == 1
    assert said[0].startswith('--scene coupling.mode="parallel": has no effect without a vehicle')
    assert not dl.Docking(SCENE, mode | {"chaser.motion": "driven"}).warnings
    parts = {"phases.rebound_gap": 0.6}
    assert "has no effect in a sequence" in dl.Docking("gripper", parts).warnings[0]
    assert not dl.Docking(SCENE, parts).warnings


MOVED = ({"interface_position[1]": 3.9}, "chaser.interface_position: ", "180 mm")
SPUN = ({"inertia[2]": 180e3}, "chaser.inertia: ", "11.1")


@pytest.mark.parametrize(
    ("keys", "values", "begin", "distance"),
    [({}, *MOVED), ({"initial.pitch_yaw_rate_deg_s": 0.2, "initial.approach_time": 60.0}, *SPUN)],
)
def test_a_start_that_was_placed_for_other_values_is_said(keys, values, begin, distance):
    starts = {f"chaser.{name}": value for name, value in values.items()}
    said = dl.run(SCENE, keys, starts, stop=0.1, step=0.1).warnings
    assert len(said) == 1, said
    assert said[0].startswith(begin)
    assert distance in said[0]
    assert not dl.run(SCENE, {}, {"chaser.mass": 2500.0}, stop=0.1, step=0.1).warnings


def test_a_body_with_moments_of_no_rigid_body_is_said():
    inertia = [[130.0, 0.0, 0.0], [0.0, 7.0, 0.0], [0.0, 0.0, 7.0]]
    said = dl.run(
        SCENE, {"mechanism.set.bodies.ring.inertia": inertia}, stop=0.1, step=0.1
    ).warnings
    assert [text[:30] for text in said] == ["inertia of 'ring': no rigid bo"]


@pytest.mark.parametrize(("setting", "words"), REFUSED.items())
def test_a_refused_value_changes_nothing(setting, words):
    docking = dl.Docking(SCENE)
    before = docking.save()
    with pytest.raises(dl.UsageError) as refusal:
        docking.set(*setting)
    assert words in str(refusal.value)
    assert docking.save() == before


def test_a_start_value_cannot_be_set_after_the_first_step():
    docking = dl.Docking(SCENE)
    docking.step(0.01)
    with pytest.raises(dl.UsageError, match=r"'chaser\.mass' is a fixed parameter"):
        docking.set("chaser.mass", 1000.0)
    before = docking.save()
    with pytest.raises(dl.UsageError, match=r"^Docking\.restore: too short for a saved state"):
        docking.restore(b"nonsense")
    with pytest.raises(dl.UsageError, match=r"^Docking\.restore: .*type str: must be bytes"):
        docking.restore("nonsense")
    assert docking.save() == before
    docking.set("friction.coefficient", 0.2)  # a tunable parameter


def test_a_column_that_is_not_there_is_refused_with_near_matches():
    result = dl.run("absorber_1d", stop=0.1)
    with pytest.raises(dl.UsageError, match=r"no column 'relative.axia' \(did you mean 'relative"):
        result["relative.axia"]


def test_scenes_are_refused_with_the_sentences_of_the_command_line():
    for bad, words in {
        "nope": "no scene 'nope'",
        "nope.toml": "nope.toml: no such scene file",
    }.items():
        with pytest.raises(dl.UsageError, match=words):
            dl.Scene(bad)
    with pytest.raises(dl.UsageError, match=r"a scene has no key 'chaser\.mas'"):
        dl.run(SCENE, {"chaser.mas": 1.0})
    with pytest.raises(dl.UsageError, match=r"chaser\.mass is -1"):
        dl.run(SCENE, {"chaser.mass": -1.0})
    with pytest.raises(dl.UsageError, match="must be greater than the start time"):
        dl.run(SCENE, stop=-1.0)


def test_a_scene_is_read_once_and_changed_by_overrides():
    scene = dl.Scene(SCENE, SLOW)
    assert (scene.name, scene.path.name) == (SCENE, f"{SCENE}.toml")
    assert scene.document["initial"]["closing_speed"] == 0.05
    other = dl.Scene(scene, {"initial.closing_speed": 0.08})
    assert other.document["initial"]["closing_speed"] == 0.08
    assert other.document["initial"]["approach_time"] == 0.2
    assert dl.Docking(scene).scene is scene


MISSPELT = {
    "stop -1.0: must be greater than the start time": lambda: dl.run(SCENE, stop=-1.0),
    "stop inf: must be a finite number": lambda: dl.run(SCENE, stop=math.inf),
    "step 0.0: must be greater than 0": lambda: dl.run(SCENE, step=0.0),
    "step nan: must be a finite number": lambda: dl.run(SCENE, step=math.nan),
    "overrides chaser.mas=1.0: a scene has no key": lambda: dl.Scene(SCENE, {"chaser.mas": 1.0}),
    "refine, refine_accuracy: .* give both, and accuracy of": lambda: dl.sweep(SWEEP, refine="x"),
    "tolerance 0.3: must be": lambda: find_envelope(tolerance=0.3),
    "checks -1: must be at least 0": lambda: find_envelope(checks=-1),
    "seed -1: must be at least 0": lambda: find_envelope(seed=-1),
    "criteria: at least one is needed": lambda: find_envelope(criteria=[]),
    "methods nope: there is no 'nope'": lambda: dl.trade("absorber_1d", methods=["nope"]),
}


@pytest.mark.parametrize(("words", "call"), MISSPELT.items())
def test_refusals_name_arguments_of_python_and_no_options(words, call):
    with pytest.raises(dl.UsageError, match=f"^{words}") as refusal:
        call()
    assert "--" not in str(refusal.value)


def test_a_journal_that_is_there_is_refused_with_the_names_of_arguments(tmp_path):
    place = {"output": tmp_path / "own.parquet"}
    dl.sweep(SWEEP, **place)
    with pytest.raises(dl.UsageError, match=r"another sweep .*: choose another output or delete"):
        dl.sweep({**SWEEP, "set": {"chaser.inertia": [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]}}, **place)


def find_envelope(scene="absorber_1d", **options):
    """Find where the absorber compresses by less than its load at a middle speed and mass."""
    speed, mass = ("initial.closing_speed", 0.05, 0.15), ("chaser.mass", 500.0, 1500.0)
    few = {"stop": 3.0, "step": 0.5, "tolerance": 0.25, "coarse": 2, "checks": 0}
    few |= {"criteria": "compression < 100"}
    return dl.envelope(scene, speed, mass, **(few | options))


def test_sweeps_and_envelopes_take_a_scene_with_its_overrides():
    changes = {"initial.approach_time": np.float64(0.25), "chaser.interface_position": [1.5, 0, 0]}
    scene = dl.Scene("absorber_1d", changes)
    ours, expected = dl.sweep({**SWEEP, "scene": scene}), dl.sweep({**SWEEP, "set": changes})
    assert ours.equals(expected)
    assert not ours.equals(dl.sweep(SWEEP))
    ours, expected = find_envelope(scene), find_envelope(overrides=changes)
    assert ours.points.drop(columns="command").equals(expected.points.drop(columns="command"))
    assert ours.points["command"][0].count("initial.approach_time=0.25") == 1


def test_overrides_may_be_numbers_and_arrays_of_numpy():
    speed, shift = np.linspace(0.05, 0.1, 2)[0], np.array([3.0, 0.0, 0.0])
    changes = {"initial.closing_speed": speed, "chaser.interface_position": shift}
    document = dl.Scene(SCENE, changes).document
    plain = {"initial.closing_speed": 0.05, "chaser.interface_position": [3.0, 0.0, 0.0]}
    assert document == dl.Scene(SCENE, plain).document


def test_a_result_becomes_tables_with_units():
    result = dl.run("hexapod_bench", stop=0.5, step=0.05)
    assert result.time.tolist() == pytest.approx(np.arange(11) * 0.05)
    assert result["ring.position[1]"].shape == (11,)
    assert result["ring.position"].shape == (11, 3)
    assert result["ring.position"].tobytes() == result.vector("ring.position").tobytes()
    assert "ring.position" in result
    assert "ring" not in result
    with pytest.raises(dl.UsageError, match="no column 'leg'"):  # leg[1].length is no vector
        result["leg"]
    table = result.to_pandas()
    assert table.shape == (11, len(result.names) - 1)
    assert table.index.name == "time"
    assert table.attrs["units"]["ring.position[1]"] == "m"
    data = result.to_xarray()
    assert data["ring.position"].shape == (11, 3)
    assert data["ring.position"].attrs == {"units": "m"}
    assert data["time"].attrs == {"units": "s"}
    assert data["ring.position"].values.tobytes() == result.vector("ring.position").tobytes()
    assert data["leg[1].length"].dims == ("time",)
    assert set(result.plot()) == {"ring", "legs", "energy"}
    assert json.loads(json.dumps(result.summary))["scene"] == "hexapod_bench"


def test_a_result_writes_the_page_of_its_motion(tmp_path):
    result = dl.run(SCENE, stop=0.5, step=0.1)
    page = result.view(tmp_path / "docking.html")
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    with pytest.raises(dl.UsageError, match=r"Result\.view: .*page must end in \.html"):
        result.view(tmp_path / "page")


def test_progress_is_reported_and_can_end_a_run():
    parts: list[float] = []
    dl.run("absorber_1d", stop=1.0, progress=parts.append)
    assert parts[-1] == 1.0

    def stop(_part: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        dl.run("absorber_1d", stop=1.0, progress=stop)


def test_a_mechanism_is_checked_by_name_by_file_and_as_a_document():
    file = paths.MECHANISMS / "idss_hexapod.json"
    report = dl.check("idss_hexapod")
    assert report["degrees_of_freedom"] == 6
    assert dl.check(file) == report
    with pytest.raises(dl.UsageError, match=r"absorber_1d\.toml: is a scene: must be a mechanism"):
        dl.check(paths.SCENES / "absorber_1d.toml")
    assert dl.check(json.loads(file.read_text())) == report
    with pytest.raises(dl.UsageError, match="bodies"):
        dl.check({"name": "mine", "bodies": 3})


def read_members(name):
    """Return the members of a shipped scene, with the whole mechanism in it."""
    scene = tomllib.loads((paths.SCENES / f"{name}.toml").read_text())
    file = paths.MECHANISMS / f"{scene['mechanism']['name']}.json"
    scene["mechanism"] = {**scene["mechanism"], **json.loads(file.read_text())}
    return scene


@pytest.mark.parametrize("name", ["absorber_1d", SCENE])
def test_scene_and_mechanism_may_be_dictionaries(name):
    members = read_members(name)
    ours, file = dl.run(members, stop=0.5, step=0.1), dl.run(name, stop=0.5, step=0.1)
    assert ours.values.tobytes() == file.values.tobytes()
    members["chaser"]["mass"] = np.float64(777.0)
    assert dl.Docking(members).get("chaser.mass") == 777.0
    assert dl.Scene(members, {"chaser.mass": 778.0}).document["chaser"]["mass"] == 778.0
    members["chaser"]["mas"] = 1.0
    with pytest.raises(dl.UsageError, match=r"scene\.toml: chaser has an unknown member 'mas'"):
        dl.run(members)


def test_sweeps_and_envelopes_take_scenes_as_dictionaries():
    members = read_members("absorber_1d")
    ours, expected = dl.sweep({**SWEEP, "scene": members}), dl.sweep(SWEEP)
    assert ours.equals(expected)
    ours, expected = find_envelope(members), find_envelope()
    assert ours.points.drop(columns="command").equals(expected.points.drop(columns="command"))


def test_a_docking_begins_anew():
    docking, other = dl.Docking("absorber_1d"), dl.Docking("absorber_1d")
    docking.set("chaser.mass", 700.0)
    for _ in range(3):
        docking.step(0.5)
    docking.reset()
    assert (docking.time, docking.get("chaser.mass")) == (0.0, other.get("chaser.mass"))
    docking.step(0.5)
    other.step(0.5)
    assert docking.save() == other.save()
    assert docking.warnings == other.warnings


def test_a_docking_has_the_summary_of_a_run():
    docking = dl.Docking(SCENE, {"initial.approach_time": 0.2})
    assert docking.summary["simulated_time"] == 0.0  # before the first step
    times = 0.1 * np.arange(101)
    expected = dl.run(docking.scene, stop=10.0, step=0.1).summary
    for t in np.diff(times):
        docking.step(t)
    found = docking.summary
    assert (found["outcome"], found["communication_steps"]) == (expected["outcome"], 100)
    assert found["outcome"] == "captured"
    assert found["simulated_time"] == pytest.approx(10.0)
    for name, load in expected["peak_loads"].items():
        assert found["peak_loads"][name]["value"] == pytest.approx(load["value"], rel=1e-9)


def test_a_name_with_a_star_sets_all_that_are_like_it_and_says_how_many():
    docking = dl.Docking("absorber_1d")
    docking.set("*.mass", 700.0)
    assert docking.get("chaser.mass") == docking.get("target.mass") == 700.0
    assert docking.notes == ["*.mass=700.0: 2 names set"]
    with pytest.raises(dl.UsageError, match=r"like '\*\.mas' \(did you mean 'mass'"):
        docking.set("*.mas", 1.0)
    with pytest.raises(dl.UsageError, match="must be one number"):
        docking.set("*.mass", [1.0, 2.0])
    bodies = dl.Scene("apda").document["mechanism"]["bodies"]
    scene = dl.Scene("apda", {"mechanism.set.bodies.r*.mass": 3.5})
    for old, new in zip(bodies, scene.document["mechanism"]["bodies"], strict=True):
        assert new == (old | {"mass": 3.5} if old["name"].startswith("r") else old)
    count = sum(body["name"].startswith("r") for body in bodies)
    assert scene.notes == [f"mechanism.set.bodies.r*.mass=3.5: {count} name{'s' * (count > 1)} set"]
    assert count > 0
    with pytest.raises(dl.UsageError, match=r"like 'rig\*' \(did you mean 'ring'"):
        dl.Scene("apda", {"mechanism.set.bodies.rig*.mass": 1.0})


def test_a_key_of_the_scene_with_a_star_means_all_keys_that_are_like_it():
    scene = dl.Scene("absorber_1d", {"*.mass": 700.0})
    assert [scene.document[v]["mass"] for v in ("chaser", "target")] == [700.0, 700.0]
    assert scene.notes == ["*.mass=700.0: 2 names set"]
    members = tomllib.loads((paths.SCENES / "absorber_1d.toml").read_text())
    members["disturbance"] = [{"vehicle": v, "duration": 1.0} for v in ("chaser", "target")]
    disturbances = dl.Scene(members, {"disturbance.*.force.2": 5.0}).document["disturbance"]
    assert [row["force"] for row in disturbances] == [[0.0, 5.0, 0.0]] * 2
    del members["target"], members["disturbance"]
    members["initial"] = {"at": "start"}
    alone = dl.Scene(members, {"*.mass": 700.0}).document
    assert alone["chaser"]["mass"] == 700.0
    assert "target" not in alone
    with pytest.raises(dl.UsageError, match=r"'solver\.rtoll\*' \(did you mean 'solver\.rtol'"):
        dl.Scene("absorber_1d", {"solver.rtoll*": 1e-6})


def test_a_result_is_a_mapping_with_names_of_choices():
    result = dl.run(SCENE, {"initial.approach_time": 0.2}, stop=10.0, step=0.1)
    assert len(repr(result)) < 120
    assert "101 points from 0 to 10 s" in repr(result)
    assert list(result) == result.keys() == result.names
    assert len(result) == len(dict(result)) == result.values.shape[1]
    assert dict(result)["time"].tolist() == result.time.tolist()
    assert (result.units["relative.axial"], result.units[0]) == ("m", "s")
    with pytest.raises(dl.UsageError, match=r"no column 'relative.axia' \(did you mean"):
        result.units["relative.axia"]
    assert result.outcome == "captured" == result.get_choices("outcome")[-1]
    assert result.get_choices("outcome")[0] != "captured"
    assert result.choose(lambda name: name == "outcome").units["outcome"] == result.units["outcome"]
    with pytest.raises(dl.UsageError, match="values of 'gap' have no names"):
        result.get_choices("gap")


SWEEP = {
    "scene": "absorber_1d",
    "outcomes": ["relative.axial", "solver.steps"],
    "vary": [{"type": "grid", "name": "chaser.mass", "values": [800.0, 1000.0]}],
    "experiment": {"stop": 0.5, "step": 0.1},
}


def test_a_sweep_returns_a_table():
    table = dl.sweep(SWEEP, workers=2)
    assert table["status"].tolist() == ["done", "done"]
    assert table["chaser.mass"].tolist() == [800.0, 1000.0]
    assert table.attrs["units"]["relative.axial"] == "m"
    alone = dl.run("absorber_1d", {"chaser.mass": 800.0}, stop=0.5, step=0.1)
    assert table["relative.axial"][0] == alone["relative.axial"][-1]
    with pytest.raises(dl.UsageError, match=r"sweep: vary 'chaser\.mas'"):
        dl.sweep({**SWEEP, "vary": [{**SWEEP["vary"][0], "name": "chaser.mas"}]})


def test_a_sweep_builds_no_fmu(monkeypatch):

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("an FMU is built")

    monkeypatch.setattr("dockloop.sweeps.cases.write_fmu", fail)
    assert dl.sweep(SWEEP)["status"].tolist() == ["done", "done"]


def test_figures_alone_need_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = dl.run("absorber_1d", stop=0.1)
    assert len(result.to_pandas()) > 1
    with pytest.raises(dl.DockloopError, match="matplotlib is needed here"):
        result.plot()


@pytest.mark.parametrize(
    ("is_installed", "command"),
    [
        (True, "'pip install pandas'"),
        (False, r"\.venv/bin/pip install -e '\.\[review,sweep,tables\]'"),
    ],
)
def test_a_missing_package_is_named_with_the_command_that_installs_it(
    monkeypatch, is_installed, command
):
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setattr(paths, "IS_INSTALLED", is_installed)
    with pytest.raises(dl.DockloopError, match=f"pandas is needed here .*{command}"):
        dl.run("absorber_1d", stop=0.1).to_pandas()


def test_names_are_imported_when_they_are_used():
    code = (
        "import sys, dockloop as dl\n"
        "assert not {'numpy', 'fmpy', 'dockloop._core'} & set(sys.modules)\n"
        "assert sorted([*dl.__all__, '__version__']) == dir(dl)\n"
        "[getattr(dl, name) for name in dl.__all__]\n"
        "assert not {'pandas', 'matplotlib', 'distributed'} & set(sys.modules)\n"
        "import dockloop.sweeps.run, dockloop.result.recording\n"
        "assert callable(dl.sweep) and callable(dl.run) and callable(dl.check)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_missing_module_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "dockloop._core", None)
    monkeypatch.delattr("dockloop._core", raising=False)
    with pytest.raises(dl.DockloopError, match=r"dockloop\._core cannot be loaded .*scripts/demo"):
        dl.Docking(SCENE)


def test_the_core_names_its_source_whatever_is_wrong():
    core = load_core()
    for text in ("nope", "{}", to_json({"format": "dockloop-scene/1"})):
        with pytest.raises(core.ModelError, match=r"^mine\.toml: "):
            core.Docking(text, "mine.toml")
    with pytest.raises(core.ModelError, match="no times"):
        core.Docking(to_json(dl.Scene("absorber_1d").document), "mine.toml").record([], [])


def test_the_package_is_typed():
    call(sys.executable, "-m", "mypy", "--no-incremental", cwd=paths.ROOT)
    assert (paths.ROOT / "scripts" / "dockloop" / "py.typed").exists()
