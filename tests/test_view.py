"""The page of ``dockloop view``: what it holds, what it refuses, and how it works in a browser.

1. The data of a page, read back, are those of the result; lengths of legs and openings of latches
   that follow from its shapes are the recorded ones, below 0.1 mm.
2. A page is below 5 MB, written in below 10 s, and asks for nothing from outside; of a long result
   it holds some samples, those of events among them.
3. A result whose model is missing, or is another one, is refused with a sentence.
4. In Chromium: no error in the console, bodies where the result has them, all keys, 390 px.
5. Cases of a sweep, stills, films, meshes.
"""

import base64
import hashlib
import json
import re
import shutil
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.base.errors import DockloopError
from dockloop.base.files import scratch
from dockloop.fmu.host import Instance, communication_points, unpack_fmu
from dockloop.view import browser as chromium
from dockloop.view import geometry
from dockloop.view.browser import Browser
from dockloop.view.page import find_events, write_page
from dockloop.view.pictures import write_stills
from programs import needs_browser

DEFAULT = "idss_25t_350t"
MM = 1e-3
WEB = paths.ROOT / "scripts" / "dockloop" / "view" / "web"


@pytest.fixture(scope="module")
def docking(runs):
    return runs.run(DEFAULT, stop=6.0)


@pytest.fixture(scope="module")
def page(docking, tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "page.html"
    write_page(docking, path)
    return path


def rows(run, name):
    return np.hstack([run.vector(f"{name}.position"), run.vector(f"{name}.attitude")])


def read_page(path):
    """Return the data of a page, its columns as arrays."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text())
    data = json.loads(found[1])
    for name, column in data["columns"].items():
        packed = np.frombuffer(base64.b64decode(column["data"]), f"<{column['type']}")
        data["columns"][name] = packed.reshape(column["shape"])
    return data


def press(window, key, code=None):
    """Press and release a key, by its name in JavaScript."""
    text = {"text": key} if len(key) == 1 else {}
    virtual = {"ArrowLeft": 37, "ArrowRight": 39, "End": 35, "Home": 36, " ": 32}.get(key, 0)
    common = {"key": key, "code": code or key, "windowsVirtualKeyCode": virtual}
    window.call("Input.dispatchKeyEvent", type="keyDown", **common, **text)
    window.call("Input.dispatchKeyEvent", type="keyUp", **common)


# ------------------------------------------------------------------- what a page holds


def test_poses_in_the_page_are_those_of_the_result(docking, page):
    columns = read_page(page)["columns"]
    assert np.array_equal(columns["time"], docking["time"])
    assert np.max(np.abs(columns["pose.target"] - rows(docking, "relative"))) < 1e-15
    assert np.max(np.abs(columns["pose.ring"] - rows(docking, "ring"))) < 1e-15


def test_legs_in_the_page_have_the_recorded_lengths(docking, page):
    data = read_page(page)
    base = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
    assert len(data["geometry"]["legs"]) == 6
    for i, leg in enumerate(data["geometry"]["legs"]):
        drawn = geometry.find_leg_length(leg, base, data["columns"]["pose.ring"])
        assert np.max(np.abs(drawn - docking[f"leg[{i + 1}].length"])) < 0.1 * MM
    assert data["meta"]["fit"] < 1e-12


@pytest.mark.parametrize("scene", ["hexapod", "apda"])
def test_legs_are_drawn_along_their_slides(tmp_path, scene):
    """In the short form, or written out and named."""
    short = {"initial.approach_time": 0.05, "outputs.groups": ["relative", "ring", "legs", "phase"]}
    run = dl.run(scene, overrides=short, stop=0.5, step=0.05)
    run.view(tmp_path / "page.html")
    data = read_page(tmp_path / "page.html")
    legs = data["geometry"]["legs"]
    assert len(legs) == 6
    assert {"base"} == {leg["root"] for leg in legs}
    base = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
    moved = 0.0
    for i, leg in enumerate(legs, start=1):
        drawn = geometry.find_leg_length(leg, base, data["columns"]["pose.ring"])
        moved = max(moved, float(np.ptp(drawn)))
        assert np.max(np.abs(drawn - run[f"leg[{i}].length"])) < 1e-6, leg["name"]
    assert 1e-4 < moved < 0.1
    assert not any("_rod" in note for note in data["meta"]["notes"])


def run_platform(tmp_path, groups, change=lambda text: text):
    """Run the platform that ``IMPORT.md`` imports, on the vehicles of the default scene."""
    file = tmp_path / "stewart.sdf"
    file.write_text(change((paths.ROOT / "scripts" / "examples" / "stewart.sdf").read_text()))
    mine = dl.import_mechanism(file, ring="ring").document
    shipped = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
    mine |= {member: shipped[member] for member in ("contact", "latches", "limits")}
    (tmp_path / "stewart.json").write_text(json.dumps(mine))
    scene = (paths.SCENES / f"{DEFAULT}.toml").read_text()
    (tmp_path / "first.toml").write_text(scene.replace('"idss_hexapod"', '"stewart"'))
    settings = {"initial.approach_time": 0.05, "outputs.groups": ["relative", "phase", *groups]}
    run = dl.run(tmp_path / "first.toml", overrides=settings, stop=1.0, step=0.05)
    run.view(tmp_path / "page.html")
    return run, read_page(tmp_path / "page.html")


def turn_over(text):
    """Return a platform whose legs have the ball at the base."""
    axes = "<axis><xyz>0 1 0</xyz></axis><axis2><xyz>0 0 1</xyz></axis2></joint>"
    text = re.sub(
        r'type="universal">(.*?)<axis>.*?</joint>', r'type="BALL">\1</joint>', text, flags=re.DOTALL
    )
    text = re.sub(r'type="ball">(.*?)</joint>', rf'type="universal">\1{axes}', text)
    return text.replace("BALL", "ball")


def find_gaps(run, columns):
    """Return how far the two ends of each cut are from each other in a page [m]."""
    gaps = []
    for loop in run.scene["mechanism"]["loops"]:
        ends = []
        for end in ("terminal", "closing"):
            pose = columns["pose.ring" if loop[end] == "ring" else f"pose.body.{loop[end]}"]
            point = np.array(loop["cut"][f"point_on_{end}"])
            ends.append(pose[:, :3] + geometry.turn(pose[:, 3:], point))
        gaps.append(np.max(np.abs(ends[0] - ends[1])))
    return gaps


@pytest.mark.parametrize("groups", [["ring", "legs"], ["ring", "legs", "states"], ["states"]])
def test_an_imported_platform_is_drawn(tmp_path, groups):
    """Six legs wherever the ring is known; all bodies where the core can close the loops."""
    run, data = run_platform(tmp_path, groups)
    legs, columns = data["geometry"]["legs"], data["columns"]
    assert len(legs) == 6
    assert not any("not drawn" in note for note in data["meta"]["notes"])
    assert sum(name.startswith("pose.body.") for name in columns) == 18 * ("states" in groups)
    assert np.ptp(columns["pose.ring"][:, 0]) > 1e-3
    for i, leg in enumerate(legs if "legs" in groups else (), start=1):
        base = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
        drawn = geometry.find_leg_length(leg, base, columns["pose.ring"])
        assert np.max(np.abs(drawn - run[f"leg[{i}].length"])) < 1e-9
    if "states" in groups:
        assert max(find_gaps(run, columns)) < 1e-9


def test_legs_have_the_numbers_of_their_outputs(tmp_path):
    """The first slide misses its foot, so it is no leg; the others keep their numbers."""
    bent = ("<xyz>1 0 0</xyz>", "<xyz>1 0.1 0</xyz>", 1)
    run, data = run_platform(tmp_path, ["ring", "legs"], lambda text: text.replace(*bent))
    assert [leg["number"] for leg in data["geometry"]["legs"]] == [2, 3, 4, 5, 6]
    assert data["meta"]["fit"] < 1e-9
    assert "leg[6].length" in run


def test_bodies_in_loops_of_any_shape_are_placed(tmp_path):
    """Legs with the ball at the base are not drawn as legs, and the page says what they need."""
    _, data = run_platform(tmp_path, ["ring"], turn_over)
    (note,) = [note for note in data["meta"]["notes"] if "not drawn" in note]
    assert note.endswith("and others: their poses need the group 'states' in [outputs] groups")
    run, data = run_platform(tmp_path, ["ring", "states"], turn_over)
    assert data["geometry"]["legs"] == []
    assert not any("not drawn" in note for note in data["meta"]["notes"])
    assert max(find_gaps(run, data["columns"])) < 1e-9
    bodies = data["geometry"]["bodies"]
    assert sum(body["is_named"] for body in bodies) == 13  # others are coordinates of joints
    assert [len(body["ends"]) for body in bodies if body["name"].startswith("rod")] == [1] * 6


def test_what_is_not_drawn_says_what_it_needs(tmp_path):
    run = dl.run("probe_drogue_levers", stop=0.1, overrides={"outputs.groups": ["relative"]})
    run.view(tmp_path / "page.html")
    found = [n for n in read_page(tmp_path / "page.html")["meta"]["notes"] if "not drawn" in n]
    assert all("need the group 'states' in [outputs] groups" in note for note in found)
    assert found


def test_shown_loads_are_those_of_the_result_to_single_precision(docking, page):
    columns = read_page(page)["columns"]
    for name in ("capture.compression", "latch[2].opening", "contact.petal[1].force"):
        assert columns[name] == pytest.approx(docking[name], rel=1e-6, abs=1e-6)


def test_events_are_those_of_the_summary(docking, page):
    data = read_page(page)
    events = {event["key"]: event for event in data["events"]}
    for key, name in (("contact", "time_of_contact"), ("capture", "time_of_capture")):
        assert events[key]["time"] == docking[name][-1]
        assert data["columns"]["time"][events[key]["index"]] >= events[key]["time"] - 1e-9
    assert data["columns"]["captured"][events["capture"]["index"]] == 1
    peak = events["peak_compression"]
    assert f"{docking['capture.peak.compression'][-1]:.4g} N" in peak["text"]
    assert next(iter(events)) == "start"
    assert list(events)[-1] == "end"


def test_loads_above_rated_are_events(docking):
    """At the first sample that is above; a load that stays below has none."""
    times, loads = docking["time"], docking["capture.compression"]
    limits = {"compression": 0.5 * docking["capture.peak.compression"][-1], "shear": 1e9}
    scene = {**docking.scene, "mechanism": {**docking.scene["mechanism"], "limits": limits}}
    events = {event["key"]: event for event in find_events(replace(docking, scene=scene))}
    assert [key for key in events if key.startswith("limit")] == ["limit_compression"]
    found = events["limit_compression"]
    assert found["text"] == f"compression above rated {limits['compression']:g} N"
    before = times < found["time"]
    assert loads[before].max() <= limits["compression"]
    assert events["contact"]["time"] <= found["time"] <= events["peak_compression"]["time"]


def test_limits_of_the_model_are_events_and_stand_at_the_head(tmp_path):
    run = dl.run("idss_25t_350t", {"initial.closing_speed": 2.0}, stop=2.5, step=0.02)
    run.view(tmp_path / "page.html")
    data = read_page(tmp_path / "page.html")
    found = {e["key"]: e for e in data["events"]}["limit_overlap"]
    assert found["text"] == "the mating planes of A and P overlap"
    assert found["time"] == run["limits.overlap.time"][-1]
    assert f"{found['text']} at {found['time']:.3f} s" in data["meta"]["sentence"]


def test_passive_petals_face_the_active_ones(page):
    """As in src/contact/guide_ring.cpp: a turn by pi about the axis at azimuth 30 deg."""
    ring = read_page(page)["geometry"]["ring"]
    passive = np.array([ring["passive"]["pose"]["q"]])
    tips = [geometry.turn(passive, np.array(petal[2]))[0] for petal in ring["petals"]]
    middles = [geometry.turn(passive, np.mean(petal, axis=0))[0] for petal in ring["petals"]]
    assert all(tip[0] < -0.2 for tip in tips)
    azimuths = sorted(np.degrees(np.arctan2(m[2], m[1])) % 360 for m in middles)
    assert azimuths == pytest.approx([60, 180, 300])


def test_a_page_is_small_quick_and_holds_everything(runs, tmp_path):
    run = runs.run(DEFAULT)
    began = time.perf_counter()
    written = write_page(run, tmp_path / "page.html")
    assert time.perf_counter() - began < 10.0
    assert written["bytes"] == (tmp_path / "page.html").stat().st_size < 5e6
    text = (tmp_path / "page.html").read_text()
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=\"(?!data:)", text)
    assert "{{" not in text.partition("<script")[0]
    assert "Permission is hereby granted" in text  # the licence of three.js


def test_of_a_long_result_some_samples_are_shown_and_all_events(runs, tmp_path):
    run = runs.run(DEFAULT, stop=6.0, step=0.0005)
    written = write_page(run, tmp_path / "page.html")
    data = read_page(tmp_path / "page.html")
    times = data["columns"]["time"]
    assert written["bytes"] < 5e6
    assert written["samples"] == len(times) < len(run.values)
    assert set(times) <= set(run["time"])
    assert "recorded samples are in this page" in data["meta"]["notes"][0]
    for event in data["events"]:
        assert 0 <= times[event["index"]] - event["time"] < 0.00051


def test_what_is_not_recorded_is_said(runs, tmp_path):
    run = runs.run(DEFAULT, 'outputs.groups=["relative"]', stop=0.5)
    write_page(run, tmp_path / "page.html")
    data = read_page(tmp_path / "page.html")
    assert "pose.ring" not in data["columns"]
    assert any("'ring' in [outputs] groups" in note for note in data["meta"]["notes"])


def test_without_relative_motion_the_target_follows_from_the_vehicles(runs, tmp_path):
    groups = 'outputs.groups=["ring"]'
    run, full = (runs.run(DEFAULT, *more, stop=0.5) for more in ((groups,), ()))
    write_page(run, tmp_path / "page.html")
    found = read_page(tmp_path / "page.html")["columns"]["pose.target"]
    assert np.max(np.abs(found[:, :3] - rows(full, "relative")[:, :3])) < 1e-10


def test_ring_from_the_coordinates_alone(runs, tmp_path):
    run = runs.run("hexapod_bench", 'outputs.groups=["states","legs"]', stop=1.0)
    full = runs.run("hexapod_bench", stop=1.0)
    write_page(run, tmp_path / "page.html")
    data = read_page(tmp_path / "page.html")
    assert np.max(np.abs(data["columns"]["pose.ring"] - rows(full, "ring"))) < 1e-12
    assert data["meta"]["fit"] < 1e-9


def test_a_box_has_mass_and_inertia_of_its_vehicle():
    mass, size = 1200.0, np.array([2.0, 3.0, 5.0])
    inertia = [mass / 12 * (np.sum(size**2) - s**2) for s in size]
    vehicle = {
        "mass": mass,
        "inertia": [*inertia, 0.0, 0.0, 0.0],
        "interface_position": [4.0, 0.0, 0.0],
        "interface_attitude": [1.0, 0.0, 0.0, 0.0],
    }
    document = {"chaser": vehicle, "mechanism": {"name": "none"}}
    box = geometry.make_geometry(document, {})["vehicles"]["chaser"]["box"]
    assert box["size"] == pytest.approx(size)
    assert box["pose"]["p"] == [-4.0, 0.0, 0.0]
    other = geometry.make_geometry(document, {"chaser.interface_position[1]": 6.0})
    assert other["vehicles"]["chaser"]["box"]["pose"]["p"][0] == -6.0


def test_parts_and_vehicles_behind_adapters_stand_where_the_run_has_them(tmp_path):
    """Bodies of the vehicles, drawn by way of adapters and interfaces, against their poses in N."""
    elastic = {"mass": 300.0, "inertia": [90, 60, 60, 0, 0, 0], "joint": "elastic"}
    elastic |= {"frequency": 2.0, "coordinate": [0.02, -0.01, 0.03, 0.1, -0.2, 0.15]}
    mount = {"position": [1.5, 0.1, 0], "attitude": [0.96, 0, 0.28, 0]}
    boom = {"mass": 60.0, "com": [0, 1, 0], "joint": "hinge", "axis": [0, 0, 1], "coordinate": 0.5}
    tank = {"mass": 60.0, "joint": "slide", "axis": [0, 0.6, 0.8], "coordinate": 0.4}
    inertia = [700, 800, 900, 0, 0, 0]
    scene = {
        "chaser": {
            "mass": 900.0,
            "inertia": inertia,
            "interface_position": [2, 0.1, 0.2],
            "interface_attitude": [0.8, 0.6, 0, 0],
            "part": [boom | {"position": [0, 1, 0]}],
            "adapter": elastic | mount,
            "angular_velocity": [0.1, 0.2, -0.1],
        },
        "target": {
            "mass": 900.0,
            "inertia": inertia,
            "position": [6, 1, 0],
            "attitude": [0.8, 0, 0, 0.6],
            "interface_position": [-1, 0, 0.3],
            "part": [tank | {"position": [0, 0, -1]}],
            "adapter": elastic | {"position": [-0.8, 0, 0]},
        },
        "experiment": {"stop": 1.0, "step": 0.1},
        "outputs": {"groups": ["relative"]},
    }
    run = dl.run(scene)
    write_page(run, tmp_path / "page.html")
    data = read_page(tmp_path / "page.html")
    columns = data["columns"]
    assert [part["name"] for part in data["geometry"]["parts"]] == ["part 1", "adapter"] * 2

    def join(a, b):
        turned = geometry.turn(a[:, 3:], b[:, :3])
        return np.hstack([a[:, :3] + turned, geometry.multiply(a[:, 3:], b[:, 3:])])

    def invert(a):
        back = geometry.conjugate(a[:, 3:])
        return np.hstack([geometry.turn(back, -a[:, :3]), back])

    def body(name):
        pose = data["geometry"]["vehicles"][name]["pose"]
        home = np.tile([*pose["p"], *pose["q"]], (len(run.time), 1))
        return join(columns[f"pose.vehicle.{name}"], home)

    drawn = join(invert(body("chaser")), join(columns["pose.target"], body("target")))
    right = join(invert(rows(run, "chaser")), rows(run, "target"))
    assert np.abs(drawn[:, :3] - right[:, :3]).max() < 1e-9
    assert np.abs(np.sum(drawn[:, 3:] * right[:, 3:], axis=1)).min() > 1 - 1e-12
    # A slide keeps its part on a line of the body of the vehicle.
    tank = join(invert(join(columns["pose.target"], body("target"))), columns["pose.part[3]"])
    along = np.outer(run["part[3].coordinate"], [0, 0.6, 0.8]) - np.array([0, 0, 1])
    assert np.abs(tank[:, :3] - along).max() < 1e-9


def test_the_library_is_the_one_that_is_stated():
    digest = hashlib.sha256((WEB / "three.min.js").read_bytes()).hexdigest()
    assert digest in (WEB / "README.md").read_text()


# ------------------------------------------------------------------- the command


@pytest.fixture
def result(dockloop, runs, tmp_path):
    dockloop.succeed(
        *("run", runs.fmu(DEFAULT), "--stop", "3.5", "-o", "own.csv", "--no-plots", "--view")
    )
    return tmp_path / "own.csv"


def test_run_writes_the_page_and_view_the_same_from_the_result(dockloop, result, tmp_path):
    first = read_page(tmp_path / "own_view.html")
    outcome = dockloop.succeed("view", result, "-o", "again.html")
    assert "again.html (" in outcome.out
    second = read_page(tmp_path / "again.html")
    assert second["geometry"] == first["geometry"]
    for name in ("pose.ring", "pose.target"):
        assert np.max(np.abs(second["columns"][name] - first["columns"][name])) < 1e-6 * MM


def test_changed_keys_of_the_mechanism_are_drawn(dockloop, tmp_path):
    key = 'mechanism.set={"contact.petal_tip_x"=0.2}'
    arguments = ("run", DEFAULT, "--scene", key, "--stop", "0.1", "-o", "own.npz", "--no-plots")
    assert dockloop(*arguments).status == 0
    assert dockloop("view", "own.npz").status == 0
    assert read_page(tmp_path / "own_view.html")["geometry"]["ring"]["petals"][0][2][0] == 0.2


def test_a_saved_state(dockloop, runs, tmp_path):
    fmu = runs.fmu(DEFAULT)
    with scratch() as folder:
        description, _ = unpack_fmu(fmu, folder)
        times = communication_points(description, 2.5, 0.5)
        with Instance(description, str(folder), "own") as instance:
            instance.initialise([], times)
            for t in times[:-1]:
                instance.slave.doStep(t, 0.5)
            state = instance.slave.getFMUstate()
            (tmp_path / "own.bin").write_bytes(instance.slave.serializeFMUstate(state))
            instance.slave.freeFMUstate(state)
    dockloop.succeed("view", fmu, "--state", "own.bin", "-o", "own.html")
    found = read_page(tmp_path / "own.html")["columns"]
    expected = rows(runs.run(DEFAULT, stop=2.5, step=0.5), "ring")[-1]
    assert np.max(np.abs(found["pose.ring"] - expected)) < 1e-12
    (tmp_path / "own.bin").write_bytes(b"no state")
    assert "own.bin: is no state of" in refuse(dockloop, fmu, "--state", "own.bin")
    assert "go together" in refuse(dockloop, fmu)


def refuse(dockloop, *arguments):
    outcome = dockloop("view", *arguments)
    assert outcome.status == 2, outcome
    assert outcome.err.count("\n") == 1
    return outcome.err


def test_what_is_no_result_is_refused(dockloop, result, tmp_path):
    assert "none.csv: no such result file" in refuse(dockloop, "none.csv")
    (tmp_path / "foreign.csv").write_text("a,b\n1,2\n")
    assert "foreign.csv: is no result of 'dockloop run'" in refuse(dockloop, "foreign.csv")
    (tmp_path / "cut.csv").write_text("\n".join(result.read_text().splitlines()[:2])[:-30])
    assert "cut.csv: " in refuse(dockloop, "cut.csv", "--model", DEFAULT)
    lines = result.read_text().splitlines()
    (tmp_path / "back.csv").write_text("\n".join([lines[0], lines[2], lines[1]]))
    assert "time does not increase" in refuse(dockloop, "back.csv", "--model", DEFAULT)


def test_a_result_without_its_model_is_refused(dockloop, result, tmp_path):
    summary = tmp_path / "own_summary.json"
    document = json.loads(summary.read_text())
    summary.write_text(json.dumps({k: v for k, v in document.items() if k != "model"}))
    assert "own_summary.json: has no member 'model'" in refuse(dockloop, result)
    summary.write_text(json.dumps({**document, "communication_steps": 7}))
    assert "is of a run of 7 steps, but" in refuse(dockloop, result)
    summary.unlink()
    assert "own_summary.json is missing" in refuse(dockloop, result)
    assert dockloop("view", result, "--model", DEFAULT).status == 0


def test_another_model_is_refused(dockloop, result, tmp_path):
    file = tmp_path / "own_summary.json"
    summary = json.loads(file.read_text())
    summary["model"]["mechanism"]["legs"][2]["root_point"][0] -= 0.001
    file.write_text(json.dumps(summary))
    message = refuse(dockloop, result)
    assert "leg[3].length drawn from the mechanism 'idss_hexapod' differs" in message
    assert "mm" in message


def test_foreign_files_stay(dockloop, result, tmp_path):
    foreign = tmp_path / "own.html"
    foreign.write_text("<!doctype html>\n<p>mine</p>")
    message = refuse(dockloop, result, "-o", foreign)
    assert "own.html: is a file of something else, which 'dockloop view' did not write" in message
    assert "mine" in foreign.read_text()
    assert dockloop("view", result).status == 0  # its own one is made again


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "own.png"), "must end in .html for a page; pictures: --still or --film"),
        (("--still", "1", "-o", "own.html"), "must end in .png for stills"),
        (("--still", "1", "--film"), "give one of them"),
        (("--still", "captured"), "did you mean 'capture'?"),
        (("--still", "99"), "the result goes from 0 to 3.5 s"),
        (("--still", "1", "--size", "big"), "must be WIDTHxHEIGHT"),
        (("--film", "--from", "3", "--to", "2"), "must lie in order between 0 and 3.5 s"),
        (("--film", "--speed", "0"), "must be above 0"),
        (("--speed", "2"), "--speed 2.0: belongs to a film: add --film"),
        (("--still", "1", "--from", "0"), "--from 0.0: belongs to a film: add --film"),
        (("--camera", "ring"), "--camera ring: belongs to pictures: add --still or --film"),
        (("--size", "640x480"), "--size 640x480: belongs to pictures"),
        (("--case", "1"), "is no table of a sweep"),
        (("--mesh", "station.stl"), "--mesh station.stl: must be NAME=FILE, perhaps with @SCALE"),
        (("--mesh", "target=none.stl"), "none.stl: no such STL file"),
        (("--mesh", "target=none.obj"), "none.obj: no such mesh"),
        (("--mesh", "target=none.stl@1,2"), "SCALE is one number, or three"),
        (("--mesh", "target=none.stl@1e"), "SCALE is one number, or three"),
        (("--mesh", "target=none.stl@0"), "quaternion and scale must be finite and not zero"),
        (("--mesh", "target=none.stl@0,0,0,0,0,0,0,1"), "quaternion and scale must be finite"),
    ],
)
def test_bad_usage_is_one_sentence(dockloop, result, arguments, message):
    assert message in refuse(dockloop, result, *arguments)


def test_pictures_without_a_browser_say_what_to_install(dockloop, result, monkeypatch):
    monkeypatch.setattr(chromium, "find_browser", lambda: None)
    outcome = dockloop("view", result, "--still", "1")
    assert outcome.status == 1
    assert "install it (apt-get install chromium)" in outcome.err


def make_stl(path, scale=1.0, text=False):
    """A tetrahedron."""
    corners = scale * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = [corners[list(f)] for f in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    if text:
        lines = ["solid"]
        for face in faces:
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += ["vertex {} {} {}".format(*corner) for corner in face]
            lines += ["endloop", "endfacet"]
        path.write_text("\n".join([*lines, "endsolid"]))
        return
    packed = b"".join(
        np.zeros(3, "<f4").tobytes() + face.astype("<f4").tobytes() + b"\0\0" for face in faces
    )
    path.write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + packed)


def read_meshes(path):
    """Return name, points and triangles of all meshes of a page."""
    return [
        (name, *(np.frombuffer(base64.b64decode(mesh[key]), kind).reshape(-1, 3)
                 for key, kind in (("points", "<f4"), ("triangles", "<u4"))))
        for name, mesh in read_page(path)["geometry"]["meshes"]
    ]  # fmt: skip


@pytest.mark.parametrize("text", [False, True])
def test_meshes_of_vehicles_and_bodies(dockloop, result, tmp_path, text):
    make_stl(tmp_path / "hull.stl", 2.0, text)
    turned = "ring=hull.stl@0.1,0,0,1,0,0,1,0.5"  # by 90 degrees about z
    dockloop.succeed("view", result, "--mesh", "chaser=hull.stl", "--mesh", turned)
    (first, points, triangles), (second, moved, _) = read_meshes(tmp_path / "own_view.html")
    assert (first, second) == ("chaser", "ring")
    assert {tuple(p) for p in points} == {(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)}
    assert triangles.shape == (4, 3)
    corners = [(0.1, 0, 0), (0.1, 1, 0), (-0.9, 0, 0), (0.1, 0, 1)]
    assert sorted(map(tuple, moved.round(6))) == sorted(map(tuple, np.float32(corners)))
    make_stl(tmp_path / "hull.stl", 5000.0, text)
    refused = refuse(dockloop, result, "--mesh", "chaser=hull.stl")
    assert "lengths must be in metres, at most 1000: scale it, millimetres by @0.001" in refused
    make_stl(tmp_path / "hull.stl")
    refused = refuse(dockloop, result, "--mesh", "rign=hull.stl")
    assert "has no such vehicle or body (did you mean 'ring'?); it has chaser, target" in refused


@pytest.mark.parametrize("suffix", ["obj", "gltf", "glb"])
def test_meshes_of_other_formats(dockloop, result, tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((1, 2, 3))
    (tmp_path / f"hull.{suffix}").write_bytes(b"")
    refused = refuse(dockloop, result, "--mesh", f"target=hull.{suffix}")
    assert ("is no OBJ file" if suffix == "obj" else "trimesh cannot read it") in refused
    scene = trimesh.Scene(box)
    if suffix == "gltf":
        for name, content in scene.export(file_type="gltf").items():
            (tmp_path / (f"hull.{suffix}" if name.endswith("gltf") else name)).write_bytes(content)
    else:
        scene.export(tmp_path / f"hull.{suffix}")
    dockloop.succeed("view", result, "--mesh", f"target=hull.{suffix}")
    ((name, points, triangles),) = read_meshes(tmp_path / "own_view.html")
    assert (name, len(points), len(triangles)) == ("target", 8, 12)
    assert np.ptp(points, axis=0).tolist() == [1, 2, 3]


def test_without_trimesh_a_mesh_says_what_to_install(dockloop, result, tmp_path, monkeypatch):
    (tmp_path / "hull.obj").write_text("v 0 0 0")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    outcome = dockloop("view", result, "--mesh", "target=hull.obj")
    assert outcome.status == 1
    assert "pip install 'dockloop[meshes]', or give STL" in outcome.err


def test_cases_of_a_sweep(dockloop, tmp_path):
    (tmp_path / "many.toml").write_text(
        f'scene = "{DEFAULT}"\nseed = 1\ncases = 4\n'
        "[experiment]\nstop = 2.6\n"
        '[[vary]]\ntype = "uniform"\nname = "initial.closing_speed"\nrange = [0.05, 0.1]\n'
    )
    dockloop.succeed("sweep", "many.toml", "--workers", "1", "-o", "many.parquet", "--no-plots")
    worst = json.loads((tmp_path / "many_summary.json").read_text())["worst"]
    dockloop.succeed("view", "many.parquet", "-o", "own.html")
    data = read_page(tmp_path / "own.html")
    assert data["meta"]["command"] == worst["command"]
    peak = max(e["text"] for e in data["events"] if e.get("first"))
    assert peak.startswith("peak ")
    dockloop.succeed("view", "many.parquet", "--not-captured", "2")
    assert len(list(tmp_path.glob("many_view_case*.html"))) == 2
    dockloop.succeed("view", "many.parquet", "--not-captured", "1", "-o", "nc.html")
    assert [file.name for file in tmp_path.glob("nc*")] == ["nc.html"]
    assert "has the cases 1 to 4" in refuse(dockloop, "many.parquet", "--case", "5")


def test_cases_of_a_sweep_with_mechanisms_of_the_user(dockloop, tmp_path):
    for name in ("mine", "other"):
        assert dockloop("new", name, "--from", "probe_drogue").status == 0
    (tmp_path / "many.toml").write_text(
        'scene = "mine.toml"\n[experiment]\nstop = 2.2\n'
        '[[vary]]\ntype = "grid"\nname = "mechanism.name"\nvalues = ["mine", "other"]\n'
    )
    dockloop.succeed("sweep", "many.toml", "--workers", "1", "-o", "many.parquet", "--no-plots")
    dockloop.succeed("view", "many.parquet", "--case", "1", "--case", "2")
    assert len(list(tmp_path.glob("many_view_case*.html"))) == 2
    (tmp_path / "mine.json").unlink()  # the table holds what it needs
    assert dockloop("view", "many.parquet", "--case", "2", "-o", "again.html").status == 0


# ------------------------------------------------------------------- in a browser


@pytest.fixture(scope="module")
def window(page):
    with Browser(1280, 800) as opened:
        opened.open(page)
        yield opened


def pose_drawn(window, name, moment):
    """Pose of a body as three.js draws it, axes of A: rotation, position."""
    window.run(f"dockloop.show({moment!r})")
    matrix = np.array(window.run(f"dockloop.drawn({name!r})")).reshape(4, 4).T
    return matrix[:3, :3], matrix[:3, 3]


def to_matrix(quaternion):
    return np.column_stack([geometry.turn(quaternion[None], axis)[0] for axis in np.eye(3)])


@pytest.mark.long
@needs_browser
def test_the_browser_shows_bodies_where_the_result_has_them(window, docking):
    assert window.run("dockloop.draws()")
    for i in (0, 200, 308, 400, 600):
        for name, recorded in (("target", "relative"), ("ring", "ring")):
            expected = rows(docking, recorded)[i]
            rotation, position = pose_drawn(window, name, float(docking["time"][i]))
            assert np.max(np.abs(position - expected[:3])) < 0.1 * MM
            assert np.max(np.abs(rotation - to_matrix(expected[3:]))) * 0.7 < 0.1 * MM
        lengths = [docking[f"leg[{k}].length"][i] for k in range(1, 7)]
        assert window.run("dockloop.legs()") == pytest.approx(lengths, abs=0.1 * MM)


@pytest.mark.long
@needs_browser
def test_between_samples_the_motion_is_interpolated(window, docking):
    i = 100  # free motion
    _, position = pose_drawn(window, "target", float(docking["time"][i]) + 0.004)
    first, second = rows(docking, "relative")[i : i + 2, :3]
    assert position == pytest.approx(first + 0.4 * (second - first), abs=1e-9)
    assert "(between samples)" in window.run("document.getElementById('clock').textContent")


@pytest.mark.long
@needs_browser
def test_the_console_stays_without_errors_and_nothing_is_asked_for(window):
    for camera in window.run("dockloop.cameras"):
        window.run(f"dockloop.setCamera({camera!r})")
        window.settle()
    for moment in ("'contact'", "'capture'", "'peak'", "'end'"):
        window.run(f"dockloop.show({moment})")
        window.settle()
    bad = [text for text in window.messages if not text.startswith("warning: [.WebGL")]
    assert bad == []


LAY = """(() => {
  const data = structuredClone(dockloop.data), span = document.getElementById('span');
  const line = new Float32Array(data.meta.samples).map((_, i) => -i);
  const packed = btoa(String.fromCharCode(...new Uint8Array(line.buffer)));
  data.columns['relative.axial'] = { type: 'f4', shape: [line.length], data: packed };
  const pen = CanvasRenderingContext2D.prototype, { beginPath, lineTo } = pen, paths = [];
  pen.beginPath = function () { paths.push([]); beginPath.call(this); };
  pen.lineTo = function (...point) { paths.at(-1).push(point); lineTo.call(this, ...point); };
  dockloop.load(data);
  span.value = 'all';
  span.dispatchEvent(new Event('change'));
  dockloop.show(0);
  Object.assign(pen, { beginPath, lineTo });
  return paths.filter((path) => path.length > 100);
})()"""


@pytest.mark.long
@needs_browser
def test_a_falling_line_stays_one_with_many_samples_on_a_pixel(window):
    window.run("window.before = dockloop.data")
    paths = [np.diff(path, axis=0) for path in window.run(LAY)]
    window.run("dockloop.load(before)")
    assert all((steps[:, 0] >= 0.0).all() for steps in paths)
    assert any((steps[:, 1] > 0.0).all() for steps in paths)  # downwards


def clock(window):
    window.settle()
    return float(window.run("document.getElementById('clock').textContent").split()[0])


def wait_until_clock_moves(window, limit=300.0):
    """Frames come when the machine has time to draw them: wait for one, not for some seconds."""
    start = time.monotonic()
    before = clock(window)
    while clock(window) == before:
        assert time.monotonic() - start < limit, "the page plays, but its clock stands still"
        time.sleep(0.05)


@pytest.mark.long
@needs_browser
def test_keys(window, docking):
    window.run("dockloop.show(1.0)")
    press(window, "ArrowRight")
    assert clock(window) == pytest.approx(1.01)
    press(window, "ArrowLeft")
    press(window, "ArrowLeft")
    assert clock(window) == pytest.approx(0.99)
    press(window, "n")
    assert clock(window) == pytest.approx(2.0)
    assert "contact" in window.run("document.getElementById('now').textContent")
    press(window, "p")
    assert clock(window) == 0.0
    press(window, "End")
    assert clock(window) == pytest.approx(6.0)
    press(window, "Home")
    press(window, " ", "Space")
    wait_until_clock_moves(window)
    press(window, " ", "Space")
    stopped = clock(window)
    assert 0.0 < stopped <= 6.0
    assert clock(window) == stopped
    press(window, "3")
    pressed = "document.querySelector('#cameras [aria-pressed=true]').textContent"
    window.settle()
    assert window.run(pressed) == "front"


@pytest.mark.long
@needs_browser
def test_usable_at_390_px(page):
    with Browser(390, 844, 2.0) as window:
        window.open(page)
        window.settle()
        assert window.run("document.documentElement.scrollWidth") == 390
        boxes = window.run(
            "[...document.querySelectorAll('#transport button, #cameras button, select')]"
            ".map((e) => e.getBoundingClientRect().height)"
        )
        assert min(boxes) >= 30
        sizes = window.run(
            "[...document.querySelectorAll('body *')].filter((e) => e.textContent.trim())"
            ".map((e) => parseFloat(getComputedStyle(e).fontSize))"
        )
        assert min(sizes) >= 11
        assert window.run("document.getElementById('space').clientHeight") > 250


@pytest.mark.long
@needs_browser
def test_stills_and_film(dockloop, result, tmp_path):
    dockloop.succeed("view", result, "--still", "0.5,capture", "-o", "own.png")
    pictures = [(tmp_path / f"own_{i}.png").read_bytes() for i in (1, 2)]
    assert all(p.startswith(b"\x89PNG") and len(p) > 10_000 for p in pictures)
    assert pictures[0] != pictures[1]
    assert dockloop("view", result, "--still", "1,2", "-o", "own.png").status == 0  # its own
    (tmp_path / "foreign.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    assert "a figure of something else" in refuse(
        dockloop, result, "--still", "1", "-o", "foreign.png"
    )
    if not shutil.which("ffmpeg"):
        pytest.skip("ffmpeg is not installed")
    film = ("view", result, "--film", "--from", "2", "--to", "2.1", "--size", "320x240")
    for _ in range(2):  # it replaces its own
        dockloop.succeed(*film, "-o", "own.mp4")
    assert (tmp_path / "own.mp4").read_bytes()[4:8] == b"ftyp"


@pytest.mark.long
@needs_browser
def test_a_core_may_name_the_capture_body(dockloop, tmp_path):
    """The axes of G are those of the palm: pads that name it stand where they stood."""
    assert dockloop("new", "own", "--from", "gripper").status == 0
    pictures = []
    for change in ({}, {"body": "palm"}):
        mechanism = json.loads((tmp_path / "own.json").read_text())
        mechanism["contact"]["active"][0] |= change
        (tmp_path / "own.json").write_text(json.dumps(mechanism))
        run = dl.run(tmp_path / "own.toml", stop=0.1, step=0.05)
        run.view(tmp_path / "own.html")
        write_stills(tmp_path / "own.html", {tmp_path / "own.png": 0.0}, "ring", (640, 400))
        pictures.append((tmp_path / "own.png").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.long
@needs_browser
def test_a_page_that_fails_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(chromium, "_PATIENCE", 5.0)
    (tmp_path / "bad.html").write_text("<script>throw new Error('broken')</script>")
    with Browser(320, 240) as window, pytest.raises(DockloopError, match="broken"):
        window.open(tmp_path / "bad.html")
