"""``dockloop variables`` and names of choices, wherever a choice can be given.

1. The list has every key of the scene, every variable of the FMU, the numbers of the mechanism;
   what it calls a default is what the scene has; each scene key can be set to its default.
2. A name gives the bits of its number: in a scene, with ``--set``, in Python, in a sweep.
3. A wrong name is refused in one sentence with the names that are allowed.
"""

import json

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.paths import SCENES
from dockloop.scene import catalogue
from dockloop.scene.find import find_scene
from dockloop.scene.resolve import list_keys, resolve_scene, scene_members
from dockloop.scene.values import as_setting
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import make_sweep

SCENE = "idss_25t_350t"
BDF = 6


@pytest.fixture(scope="module")
def entries():
    return {entry.name + entry.set_by: entry for entry in catalogue.list_entries(SCENE)}


def test_the_list_has_every_key_and_every_variable(entries):
    docking = dl.Docking(SCENE)
    names = {entry.name for entry in entries.values()}
    lacks = "sequence."  # of the mechanism of this scene
    assert {k for k in list_keys(docking.scene.document) if not k.startswith(lacks)} <= names
    assert {n for n, v in docking.variables.items() if v.causality != "local"} <= names
    with_states = catalogue.list_entries(SCENE, has_states=True)
    assert {entry.name for entry in with_states} >= set(docking.variables)
    assert "mechanism.set.leg_defaults.stiffness--scene" in entries


def test_entries_say_unit_default_limits_and_meaning(entries):
    speed = entries["initial.closing_speed--scene"]
    assert (speed.unit, speed.default, speed.limits) == ("m/s", 0.1, "> 0")
    assert entries["solver.method--scene"].default == "auto"
    assert entries["contact.friction_model--scene"].default == "regularised"
    assert entries["contact.stiffness--scene"].default == 2e6  # of the mechanism
    stiffness = entries["mechanism.set.leg_defaults.stiffness--scene"]
    assert (stiffness.unit, stiffness.default, stiffness.limits) == ("N/m", 2000, ">= 0")
    mass = entries["chaser.mass--set"]
    assert (mass.kind, mass.unit, mass.default) == ("parameter", "kg", 25e3)
    method = entries["solver.method--set"]
    assert "bdf" in method.choices
    assert "dae" not in method.choices  # not carried
    assert "Integration method" in method.meaning
    assert entries["relative.axial"].set_by == ""


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_listed_key_of_a_shipped_scene_is_taken(path):
    """Sections depend on the mechanism; hulls need all of their members."""
    scene, known = resolve_scene(path), scene_members()
    for entry in catalogue.list_entries(str(path)):
        if entry.kind != "scene key" or ".hull." in entry.name or entry.name.endswith(".set"):
            continue
        value = entry.default
        if value is None:
            value = (known.get(entry.name, {}).get("examples") or [None])[0]
        if entry.name == "sequence.stop_after":
            value = scene["mechanism"]["sequence"]["steps"][-1]["name"]
        if value is not None:
            resolve_scene(path, [as_setting(entry.name, value)])


def test_a_section_that_a_mechanism_does_not_take_is_not_listed():
    listed = {
        scene: {entry.name.partition(".")[0] for entry in catalogue.list_entries(scene)
                if entry.kind == "scene key"}
        for scene in ("absorber_1d", SCENE, "hexapod")
    }  # fmt: skip
    found = {scene: listed[scene] & {"contact", "sequence"} for scene in listed}
    assert found == {"absorber_1d": set(), SCENE: {"contact"}, "hexapod": {"contact", "sequence"}}


def test_every_listed_scalar_of_a_scene_can_be_set_to_its_default(entries):
    path = find_scene(SCENE)
    settable = [
        as_setting(entry.name, entry.default)
        for entry in entries.values()
        if entry.set_by == "--scene" and isinstance(entry.default, int | float | str)
    ]
    assert len(settable) > 80
    document, same = resolve_scene(path), resolve_scene(path, settable)
    assert same["mechanism"] == document["mechanism"]
    assert same["initial"] == document["initial"]


def test_overrides_change_defaults_and_patterns_choose():
    changed = ["initial.closing_speed=0.07", "mechanism.set.leg_defaults.stiffness=1500"]
    wanted = ["closing_speed", "mechanism.set.leg_defaults.s*ness", "latch[1].*"]
    found = {entry.name: entry for entry in catalogue.list_entries(SCENE, changed, wanted)}
    assert found.pop("initial.closing_speed").default == 0.07
    assert found.pop("mechanism.set.leg_defaults.stiffness").default == 1500
    latch = {"latch[1].opening", "latch[1].lateral", "latch[1].state", "latch[1].force"}
    assert latch <= set(found)
    assert all(name.startswith(("latch[1].", "mechanism.set.leg_d")) for name in found)


def test_the_command_lists_and_refuses(dockloop):
    listed = dockloop("variables", "absorber_1d", "--json", "--match", "solver.rtol")
    rows = json.loads(listed.out)["variables"]
    assert [(row["set_by"], row["default"]) for row in rows] == [
        ("--scene", 1e-10),
        ("--set", 1e-10),
    ]
    assert rows[0]["range"] == "> 0, at most 0.1"
    assert {"name", "unit", "range", "default", "meaning"} <= set(rows[0])
    text = dockloop("variables", "absorber_1d", "--match", "chaser.mass").out
    assert "chaser.mass                     25000 kg" in text, text
    refused = dockloop("variables", "absorber_1d", "--match", "chaser.mas*s_")
    assert (refused.status, refused.err.count("\n")) == (2, 1), refused
    assert "nothing is called" in refused.err


# ---------------------------------------------------------------- names of choices


def end(result: dl.Result) -> bytes:
    return result.values[-1].tobytes()


def test_a_name_gives_the_bits_of_its_number_in_scene_and_python():
    short = {"stop": 2.5, "step": 0.25}
    number = dl.run(SCENE, start_values={"solver.method": BDF}, **short)
    name = dl.run(SCENE, start_values={"solver.method": "bdf"}, **short)
    scene = dl.run(SCENE, overrides={"solver.method": "bdf"}, **short)
    default = dl.run(SCENE, **short)
    assert end(number) == end(name) == end(scene)
    assert not np.array_equal(default.values, number.values)
    assert dl.Docking(SCENE, {"solver.method": "bdf"}).get("solver.method") == BDF
    assert dl.Docking(SCENE, {"contact.friction_model": "bristle"}).get("friction.model") == 2
    assert dl.Docking(SCENE, {"contact.friction_model": 2}).get("friction.model") == 2


def test_a_name_gives_the_bits_of_its_number_in_the_command(runs):
    both = [
        runs.run("absorber_1d", settings=(f"solver.method={value}",), stop=0.5, step=0.1)
        for value in ("bdf", BDF, '"bdf"')
    ]
    assert end(both[0]) == end(both[1]) == end(both[2])


def test_a_sweep_takes_names():
    given = {
        "scene": "absorber_1d",
        "vary": [
            {"type": "grid", "name": "solver.method", "values": ["explicit", "bdf"]},
            {"type": "grid", "name": "model.flight", "values": ["resting", "integrated"]},
        ],
        "experiment": {"stop": 0.5, "step": 0.1},
        "outcomes": ["capture.peak.compression", "solver.steps"],
        "worst": "solver.steps",
    }
    table = dl.sweep(given, workers=1)
    assert table["status"].tolist() == 4 * ["done"]
    assert table["solver.steps"].nunique() == 2
    assert np.ptp(table["capture.peak.compression"]) < 1e-3
    command = Planner(make_sweep(given, find_scene("absorber_1d"))).make_command(
        ("bdf", "resting"), 0.5
    )
    assert '--scene solver.method="bdf" --set model.flight="resting"' in " ".join(command)


REFUSED = {
    "scene": (
        ["run", "absorber_1d", "--scene", "solver.method=bfd"],
        'solver.method is "bfd": must be one of auto, explicit,',
    ),
    "set": (
        ["run", "absorber_1d", "--set", "solver.method=bfd"],
        "--set solver.method=bfd: 'solver.method' is 'bfd': must be one of auto, explicit,"
        " implicit, bdf, fixed_rk4, stabilised, rosenbrock, fixed_rosenbrock (did you mean 'bdf'?)",
    ),
    "not carried": (
        ["build", "absorber_1d", "--scene", "solver.method=dae", "-o", "{folder}/a.fmu"],
        "solver.method is 9 (dae), a method for comparison, which this build does not carry",
    ),
    "set what is not carried": (
        ["run", "absorber_1d", "--set", "solver.method=dae", "-o", "{folder}/a.csv"],
        "= 9 (dae), a method for comparison, which this build does not carry: take 1 (auto)",
    ),
    "no longer built": (
        ["run", "absorber_1d", "--scene", "solver.method=adams", "-o", "{folder}/a.csv"],
        "solver.method is 5 (adams), a method for comparison: multistep of order up to 12; no"
        " longer built: take 11 (stabilised)",
    ),
    "no longer built, in a grid": (
        ["trade", "absorber_1d", "--quick", "--methods", "bdf,imex", "-o", "{folder}"],
        "--methods bdf,imex: imex: implicit for contact and latches only; no longer built: take 12",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_name_is_refused_with_the_names_that_are_allowed(dockloop, tmp_path, case):
    arguments, words = REFUSED[case]
    refused = dockloop(*(text.format(folder=tmp_path) for text in arguments))
    assert (refused.status, refused.err.count("\n")) == (2, 1), refused
    assert words in refused.err


def test_a_wrong_name_is_refused_in_python():
    docking = dl.Docking("absorber_1d")
    with pytest.raises(dl.UsageError, match=r"Docking\.set: 'solver\.method' is 'rk': must be one"):
        docking.set("solver.method", "rk")
