"""Hard docking and undocking of whole vehicles: hooks, pushers and rigid joint by a sequence.

1. a sequence closes hooks, joins the vehicles, opens them on command; energy and momentum balance
   at every communication point; a saved state repeats the same bits in every step;
2. a host without a sequence commands the hardware;
3. malformed files are refused in one sentence.
"""

import copy
import json

import pytest

import dockloop as dl
from dockloop.base.errors import UsageError
from dockloop.sweeps.cases import run_case
from dockloop.sweeps.planning import Planner
from dockloop.sweeps.sampling import read_sweep

INTERFACE = {
    "faces": {"radius": 0.65, "stiffness": 2e8, "damping": 3.0},
    "hooks": {
        "radius": 0.7, "stiffness": 2e6, "preload": 3000, "damping": 2.0, "play": 0.003,
        "close_time": 5.0, "rows": [{"count": 6}, {"count": 6, "azimuth_deg": 30}],
    },
    "pushers": {
        "count": 4, "radius": 0.6, "stroke": 0.03, "preload": 250, "stiffness": 4000,
        "on_at_start": False,
    },
}  # fmt: skip
APART = {"quantity": "relative.axial", "above": 0.1}
SEQUENCE = {
    "steps": [
        {"name": "close", "phase": 6, "do": [{"hooks": "close"}],
         "next": [{"when": {"hooks_closed": 12}, "go": "hard_docked"}]},
        {"name": "hard_docked", "phase": 7, "outcome": "docked", "do": [{"joint": "rigid"}],
         "next": [{"when": {"command": "undock"}, "go": "undock"}]},
        {"name": "undock", "phase": 9,
         "do": [{"joint": "open"}, {"hooks": "open"}, {"pushers": "on"}],
         "next": [{"when": APART, "go": "separated", "outcome": "undocked"}]},
        {"name": "separated", "phase": 10},
    ]
}  # fmt: skip
VEHICLES = """
[chaser]
mass = 25e3
inertia = [60.5e3, 132e3, 132e3, 0, 0, 0]
interface_position = [4, 0, 0]
velocity = [0.02, 0, 0]

[target]
mass = 350e3
inertia = [4e7, 8e7, 8e7, 0, 0, 0]
interface_position = [-15, 0, 0]
position = [19.02, 0, 0]

[solver]
rtol = 1e-9
atol_position = 1e-12
atol_velocity = 1e-12
atol_energy = 1e-10

[experiment]
stop = 20
step = 0.1

[outputs]
groups = ["relative", "phase", "energy", "solver"]

[mechanism]
name = "docked"
"""


def write(folder, sequence=None, **changes):
    """Write a scene. ``changes``: members of parts of the interface, None removes a part."""
    interface = copy.deepcopy(INTERFACE)
    for part, members in changes.items():
        if members is None:
            del interface[part]
        else:
            interface[part] |= members
    mechanism = {"name": "docked", "interface": interface}
    if sequence:
        mechanism["sequence"] = sequence
    (folder / "docked.json").write_text(json.dumps(mechanism))
    (folder / "scene.toml").write_text(VEHICLES)
    return folder / "scene.toml"


def go(docking, until, step=0.1):
    while docking.time < until - 1e-9:
        docking.step(min(step, until - docking.time))
        assert abs(docking.get("energy.residual")) < 1e-4  # of 100 J in play
        assert docking.get("momentum.residual") < 1e-12


def test_a_sequence_docks_and_undocks(tmp_path):
    docking = dl.Docking(write(tmp_path, SEQUENCE))
    go(docking, 4.0)
    assert docking.get("phase") == 6
    assert not docking.get("joint.rigid")
    go(docking, 20.0)
    assert docking.get("hooks.closed") == 12
    assert docking.get("phase") == 7
    assert docking.get("outcome") == 6
    assert docking.get("joint.rigid")
    go(docking, 2000.0, 100.0)
    assert not any(docking.get("relative.velocity"))
    docking.set("command", 7)
    state = docking.save()
    go(docking, 2003.0, 0.5)
    first = [docking.get(name) for name in ("relative.axial", "energy.kinetic", "hook[1].force")]
    docking.restore(state)
    go(docking, 2003.0, 0.5)
    assert first == [
        docking.get(name) for name in ("relative.axial", "energy.kinetic", "hook[1].force")
    ]
    assert docking.get("phase") == 10
    assert docking.get("outcome") == 7
    go(docking, 2010.0)
    # The slow release leaves what the pushers give, less their take-up.
    assert docking.get("relative.velocity")[0] == pytest.approx(0.0563, abs=1e-3)


SWEEP = """
scene = "scene.toml"
[[vary]]
type = "grid"
name = "hooks.close_time"
values = [4.0]
[experiment]
stop = 30.0
step = 0.5
end_after_outcome = 2.0
"""


def test_cases_of_a_sweep_end_after_an_outcome_that_a_sequence_states(tmp_path):
    write(tmp_path, SEQUENCE)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    planner = Planner(read_sweep(str(tmp_path / "sweep.toml")))
    results = [
        run_case(planner.make_job(engine), *planner.resolve((4.0,))) for engine in ("fmu", "core")
    ]
    assert [result.reason for result in results] == [None, None]
    assert results[0].end_time == results[1].end_time < 30.0


def test_faces_that_are_in_each_other_at_the_start_are_refused(tmp_path):
    scene = write(tmp_path)
    scene.write_text(VEHICLES.replace("19.02", "18.97"))
    with pytest.raises(UsageError, match=r"mating faces of A and P are 30 mm in each other"):
        dl.Docking(scene).step(0.1)


def test_a_host_commands_the_hardware(tmp_path):
    docking = dl.Docking(write(tmp_path))
    docking.set("hard_dock.command", "close_hooks")
    go(docking, 12.0)
    assert docking.get("hooks.closed") == 12
    assert docking.get("hook[12].force") == pytest.approx(3000, abs=5)
    assert docking.get("faces.force") == pytest.approx(36e3, abs=60)
    docking.set("hard_dock.command", "join")
    go(docking, 100.0, 20.0)
    assert docking.get("joint.rigid")
    docking.set("hard_dock.command", "release")
    go(docking, 101.0)
    docking.set("hard_dock.command", "open_hooks")
    go(docking, 102.0)
    assert docking.get("hooks.closed") == 0
    assert docking.get("energy.dissipated_hard_dock") > 25.0


@pytest.mark.parametrize(
    ("part", "members", "message"),
    [
        ("faces", None, "hooks need faces"),
        ("faces", {"count": 2}, "count"),
        ("faces", {"stiffness": -2e8}, "stiffness"),
        ("hooks", {"rows": []}, "rows"),
        ("hooks", {"rows": [{"count": 20}, {"count": 20}]}, "at most 24 hooks"),
        ("hooks", {"preload": 0.01}, "increase preload"),
        ("hooks", {"playy": 0.1}, "unknown member 'playy' (did you mean 'play'"),
        ("hooks", {"open_time": 0}, "open_time"),
        ("pushers", {"take_up": 0.1}, "take_up is 0.1 m; it must not exceed stroke, 0.03 m"),
        ("pushers", {"stroke": 0}, "stroke"),
    ],
)
def test_malformed_hardware_is_refused_in_one_sentence(tmp_path, part, members, message):
    with pytest.raises(UsageError) as caught:
        dl.Docking(write(tmp_path, **{part: members}))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("action", "part", "message"),
    [
        ({"hooks": "shut"}, {}, "close"),
        ({"joint": "stiff"}, {}, "rigid"),
        ({"pushers": "on"}, {"pushers": None}, "no member interface.pushers"),
        ({"hooks": "close"}, {"hooks": None}, "no member interface.hooks"),
        ({"hooks": "close", "law": "brake"}, {}, "the member 'law', which the action 'hooks'"),
    ],
)
def test_actions_without_hardware_are_refused(tmp_path, action, part, message):
    sequence = {"steps": [{"name": "one", "phase": 6, "do": [action]}]}
    with pytest.raises(UsageError) as caught:
        dl.Docking(write(tmp_path, sequence, **part))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_rigid_joint_needs_two_free_vehicles(tmp_path):
    scene = dl.Scene(write(tmp_path, SEQUENCE), {"target.motion": "fixed"})
    with pytest.raises(UsageError, match="two vehicles that move"):
        dl.Docking(scene).step(0.1)
