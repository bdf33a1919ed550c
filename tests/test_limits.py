"""Limits of models and hardware that are watched while a docking runs.

Recordings at communication points are the oracle: a limit is noticed at the first inner step beyond
it, so never after the first sample beyond it, and not before the last one within.
"""

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.rotations import turn
from dockloop.native.core import list_limits
from dockloop.result.limits import find_exceeded, name_exceeded
from dockloop.result.summary import summarise

DEFAULT = "idss_25t_350t"
NEAR = {"initial.approach_time": 0.1}


@pytest.fixture(scope="module")
def fast():
    """2 m/s: the mating planes pass through each other, stops and rated loads are passed."""
    return dl.run(DEFAULT, NEAR | {"initial.closing_speed": 2.0}, stop=0.6, step=0.001)


def find_first(run, beyond):
    """Return the last sample within and the first one beyond a limit [s]."""
    first = np.flatnonzero(beyond)[0]
    return run.time[first - 1], run.time[first]


def test_limits_are_noticed_when_they_are_passed(fast):
    names = [f"leg[{i}].length" for i in range(1, 7)]
    shortest = np.min([fast[name] for name in names], axis=0)
    stops = fast.scene["mechanism"]["leg_defaults"]["stops"]
    beyond = {
        "overlap": -fast["relative.axial"] > 1e-3,
        "stop": shortest < stops["min_length"] - stops["toe"],
        "load": fast["capture.peak.load_ratio"] > 1.0,
    }
    for name, samples in beyond.items():
        before, after = find_first(fast, samples)
        assert before - 1e-9 <= fast[f"limits.{name}.time"][-1] <= after + 1e-3, name
    assert 1e-3 < fast["limits.overlap.value"][-1] < 5e-3
    found = {row["name"] for row in find_exceeded(fast)}
    assert found == set(beyond)
    assert set(name_exceeded(fast["limits.exceeded"][-1]).split(", ")) == found


def test_each_limit_is_warned_of_once_with_time_value_and_limit(fast):
    for row in find_exceeded(fast):
        (text,) = (text for text in fast.warnings if f"limit '{row['name']}'" in text)
        assert f"t = {row['time']:.9g} s" in text
        assert f"{row['value']:.4g}" in text
        assert "(limit " in text
    (stop,) = (text for text in fast.warnings if "'stop'" in text)
    assert "_rod')" in stop  # which
    assert [row["name"] for row in summarise(fast)["limits"]] == ["load", "overlap", "stop"]


def test_a_usual_docking_passes_no_limit():
    run = dl.run(DEFAULT, NEAR, stop=6.0, step=0.1)
    assert run["captured"][-1]
    assert run["limits.exceeded"][-1] == 0
    assert find_exceeded(run) == []
    assert run.warnings == []
    assert run["limits.load.time"][-1] == -1.0


def test_vehicles_that_miss_each_other_may_pass_the_planes():
    """Nothing is opposite: there is no overlap and no ring that is passed."""
    keys = {"initial.at": "start", "chaser.position": [-19.5, 4.0, 0.0]}
    run = dl.run(DEFAULT, keys | {"chaser.velocity": [1.0, 0.0, 0.0]}, stop=3.0, step=0.1)
    assert run["relative.axial"][-1] < -1.0
    assert run["limits.exceeded"][-1] == 0


HULLS = {
    "chaser": {"from": [-3.0, 0.0, 0.0], "to": [1.5, 0.0, 0.0], "radius": 2.2},
    "target": {"from": [-12.5, 0.0, 0.0], "to": [10.0, 1.0, 0.0], "radius": 2.0},
}


def put_hulls(hulls):
    return {f"{v}.hull.{member}": x for v, hull in hulls.items() for member, x in hull.items()}


def sample_hull(run, name):
    """Return points of the middle line of a hull, for each sample: positions in N."""
    hull = HULLS[name]
    line = np.linspace(hull["from"], hull["to"], 301)
    position = np.column_stack([run[f"{name}.position[{i}]"] for i in (1, 2, 3)])
    attitude = np.column_stack([run[f"{name}.attitude[{i}]"] for i in (1, 2, 3, 4)])
    return [
        at + turn(np.tile(q, (len(line), 1)), line)
        for at, q in zip(position, attitude, strict=True)
    ]


def test_hulls_that_overlap_are_noticed():
    """The chaser passes the target 4 m off its axis while it turns; nothing but hulls is there."""
    keys = {
        "initial.at": "start",
        "chaser.position": [-19.5, 4.0, 0.5],
        "chaser.velocity": [1.0, 0.0, 0.0],
        "chaser.angular_velocity": [0.0, 0.02, 0.05],
    }
    run = dl.run(DEFAULT, keys | put_hulls(HULLS), stop=8.0, step=0.05)
    lines = zip(*(sample_hull(run, name) for name in ("chaser", "target")), strict=True)
    gaps = [np.min(np.linalg.norm(a[:, None] - b, axis=-1)) for a, b in lines]
    overlap = sum(hull["radius"] for hull in HULLS.values()) - np.array(gaps)
    before, after = find_first(run, overlap > 0.0)
    (row,) = find_exceeded(run)
    assert row["name"] == "hull"
    assert before - 1e-9 <= row["time"] <= after + 1e-3
    assert 0.0 < row["value"] <= overlap[run.time >= after][0] + 1e-3
    (text,) = (text for text in run.warnings if "limit 'hull'" in text)
    assert "the hulls of the vehicles overlap" in text
    one = put_hulls({"chaser": HULLS["chaser"]})
    alone = dl.run(DEFAULT, keys | one, stop=8.0, step=0.05)
    assert find_exceeded(alone) == []


def test_hulls_with_room_for_the_hardware_change_nothing():
    plain, run = (
        dl.run(DEFAULT, NEAR | put_hulls(hulls), stop=3.0, step=0.1) for hulls in ({}, HULLS)
    )
    assert find_exceeded(run) == []
    assert all(np.array_equal(plain[name], run[name]) for name in plain)


@pytest.mark.parametrize(
    ("hull", "said"),
    [
        ({"from": [1.0, 0.0, 0.0], "to": [1.0, 0.0, 0.0], "radius": 2.0}, "the same point as"),
        ({"from": [1.0, 0.0, 0.0], "to": [2.0, 0.0, 0.0], "radius": 0.0}, "hull.radius"),
        ({"from": [1.0, 0.0, 0.0], "radius": 1.0}, "'to'"),
        ({"from": [1.0, 0.0, 0.0], "to": [2.0, 0.0, 0.0], "length": 1.0}, "length"),
    ],
)
def test_impossible_hulls_are_refused(hull, said):
    with pytest.raises(dl.UsageError, match="hull") as refused:
        dl.Docking(DEFAULT, put_hulls({"chaser": hull}))
    assert said in str(refused.value)


def test_rings_touch_with_too_much_tilt():
    keys = {
        "mechanism.set.leg_defaults.stiffness": 2e5,
        "initial.pitch_yaw_deg": 29.99,
        "initial.pitch_yaw_direction_deg": 65.0,
        "initial.pitch_yaw_rate_deg_s": 5.0,
        "initial.pitch_yaw_rate_direction_deg": 65.0,
    }
    run = dl.run(DEFAULT, NEAR | keys, stop=1.0, step=0.01)
    _, after = find_first(run, run["relative.pitch_yaw"] > np.radians(33.0))
    (tilt,) = (row for row in find_exceeded(run) if row["name"] == "tilt")
    assert np.radians(30.0) < tilt["value"] < np.radians(33.0)
    assert run["time_of_contact"][-1] <= tilt["time"] < after
    assert any("limit 'tilt'" in text and "(limit 30 deg)" in text for text in run.warnings)


def test_limits_do_not_depend_on_communication_points_and_survive_a_restored_state():
    """The same inner steps notice the same limits; a restored run does not notice them again."""
    scene = dl.Scene(DEFAULT, NEAR | {"initial.closing_speed": 2.0})
    ends = []
    for count in (1, 6):
        docking = dl.Docking(scene)
        for _ in range(count):
            docking.step(0.6 / count)
        ends.append([docking.get(f"limits.{limit.name}.time") for limit in list_limits()])
    assert ends[0] == pytest.approx(ends[1], abs=2e-3)
    first = dl.Docking(scene)
    first.step(0.3)
    state = first.save()
    second = dl.Docking(scene)
    second.restore(state)
    for docking in (first, second):
        docking.step(0.1)
    for limit in list_limits():
        name = f"limits.{limit.name}.time"
        assert first.get(name) == second.get(name), name


def find_limit(run, name):
    """Return time and value of a limit that was passed; None: it was not."""
    return next(((r["time"], r["value"]) for r in find_exceeded(run) if r["name"] == name), None)


@pytest.mark.parametrize(("stiffness", "is_beyond"), [(2000.0, False), (1200.0, True)])
def test_surfaces_are_pressed_in_by_nine_tenths_of_their_rounding(stiffness, is_beyond):
    keys = {"initial.approach_time": 0.05, "contact.stiffness": stiffness}
    run = dl.run("probe_drogue", keys, stop=3.0, step=0.005)
    ratio, found = run["contact.depth_ratio"], find_limit(run, "depth")
    assert ratio.max() > 0.88
    assert (ratio.max() > 0.9) == is_beyond == (found is not None)
    if is_beyond:
        before, after = find_first(run, ratio > 0.9)
        assert before <= found[0] <= after
        assert 0.9 < found[1] <= ratio[run.time == after][0]


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_target_is_behind_the_capture_surfaces(share):
    """The cone misses the probe head: no contact, so the ring of the probe stays at home."""
    start = {
        "initial.at": "start",
        "target.position": [0.0, 0.0, 0.0],
        "chaser.velocity": [0.5, 0.0, 0.0],
    }
    document = dl.Scene("probe_drogue").document
    arms = [document[vehicle]["interface_position"][0] for vehicle in ("chaser", "target")]
    start["chaser.position"] = [arms[1] - arms[0] - 1.0, 0.6, 0.0]
    stop = 1.8
    profiles = [part["profile"] for part in document["mechanism"]["contact"]["passive"]]
    depth = max(x for profile in profiles for x, _ in profile)  # of the socket, along x of P
    first = dl.run("probe_drogue", start, stop=stop, step=0.02)
    assert first["contact.depth_ratio"].max() == 0.0
    behind = first["ring.position"][:, 0] - first["relative.axial"] - depth
    limit = share * behind[-1]
    run = dl.run("probe_drogue", start | {"phases.passed_depth": limit}, stop=stop, step=0.02)
    found = find_limit(run, "passed")
    assert (found is not None) == (share < 1.0)
    if found:
        before, after = find_first(first, behind > limit)
        assert before <= found[0] <= after + 1e-9
        assert found[1] == pytest.approx(np.interp(found[0], first.time, behind), abs=1e-6)
        assert limit < found[1] <= behind[-1] + 1e-9


def test_a_step_of_the_sequence_times_out():
    base = dl.run("apda", NEAR, stop=2.0, step=0.05)
    steps = [step["name"] for step in base.scene["mechanism"]["sequence"]["steps"]]
    entered = {n: base[f"sequence.entered[{i}]"][-1] for i, n in enumerate(steps, 1)}
    lasted = entered["capture"] - entered["contact"]
    assert find_limit(base, "time_out") is None
    for share in (0.99, 1.01):
        keys = NEAR | {"sequence.set.contact.timeout": share * lasted}
        run = dl.run("apda", keys, stop=2.0, step=0.05)
        found = find_limit(run, "time_out")
        if share > 1.0:
            assert found is None
            continue
        assert found[0] == pytest.approx(entered["contact"] + share * lasted, abs=1e-6)
        assert found[1] == pytest.approx(share * lasted, rel=1e-12)
        assert run["sequence.entered[3]"][-1] == -1.0  # capture is not entered any more
