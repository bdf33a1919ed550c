"""Far from contact the mechanism is at rest and costs nothing, and no result shows it.

1. After a minute of free drift a docking has the loads, times and motion of one in which everything
   was always integrated; the minute costs next to nothing. Momentum adds up, runs repeat.
2. A load in the middle of the rest moves the ring as it would have; so does a leg command.
3. A run saved while it rests, and restored in another instance, goes on with the same bits.
4. Vehicles of any inertia that tumble fast are where the integrator puts them, however long the
   steps are.
5. A mechanism that moves does not rest: not while it swings, not close to contact. One whose
   vehicle tumbles is let go whenever the spin has changed so much that it would move.
6. Rates that are read are those of the equations, whatever was read before.
"""

import json

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from extreme_cases.fmi_host import Host

QUIESCENT, INTEGRATED = 1, 2
DRIFT = 60.0  # s
GROUPS = (
    'outputs.groups=["relative", "capture", "phase", "ring", "legs", "states", "energy", "solver"]'
)
RATES = ("initial.pitch_yaw_rate_deg_s=0.2", "initial.roll_rate_deg_s=-0.2")
PEAKS = [f"capture.peak.{name}" for name in ("compression", "shear", "bending", "torsion")]
KINDS = (("attitude", 4), ("position", 3))
RING = [f"ring.position[{i}]" for i in (1, 2, 3)]


@pytest.fixture(scope="module")
def docking(runs):
    """The default scene with a minute of free drift before first contact."""
    return runs.fmu("idss_25t_350t", f"initial.approach_time={DRIFT}", GROUPS, *RATES)


def started(fmu, drift=QUIESCENT, **values):
    host = Host(fmu)
    host.choose(model__flight=drift)
    host.set(**values)
    host.start()
    return host


def evaluations(host):
    return host.value("solver.rhs_evaluations")


def test_a_drift_costs_nothing_and_changes_nothing(docking):
    runs = {}
    for name, drift, size, values in (
        ("reference", INTEGRATED, 1.0, {"solver__rtol": 1e-9, "solver__atol_velocity": 1e-10}),
        ("integrated", INTEGRATED, 1.0, {}),
        ("quiescent", QUIESCENT, 1.0, {}),
        ("short steps", QUIESCENT, 0.1, {}),
    ):
        with started(docking, drift, **values) as host:
            while host.time < DRIFT - 1.0 - 1e-6:
                host.step(size)
            in_drift = evaluations(host)
            while host.time < DRIFT + 5.0 - 1e-6:
                host.step(size)
            runs[name] = (
                in_drift,
                evaluations(host),
                host.get(*PEAKS),
                host.get("time_of_contact", "time_of_capture", *RING, "relative.axial"),
            )
            assert abs(host.value("momentum.residual")) < 1e-13, name
    share = runs["quiescent"][0] / runs["quiescent"][1]
    before = runs["integrated"][0] / runs["integrated"][1]
    print(f"free drift: {100 * share:.2f} % of the evaluations, integrated {100 * before:.0f} %")
    assert before > 0.1, before
    assert share < 0.08, share
    scale = runs["reference"][2].max()
    for name in ("integrated", "quiescent", "short steps"):
        loads = np.abs(runs[name][2] - runs["reference"][2]).max() / scale
        motion = np.abs(runs[name][3] - runs["reference"][3]).max()
        print(f"{name}: peak loads off by {loads:.1e}, times and motion by {motion:.1e} s, m")
        assert loads < 1e-4, (name, loads)  # taken at inner steps
        assert motion < 2e-6, (name, motion)


def test_loads_and_commands_wake_the_mechanism(docking):
    shaken = {}
    for drift in (QUIESCENT, INTEGRATED):
        with started(docking, drift) as host:
            for _ in range(8):
                host.step(1.0)
            before = evaluations(host)
            host.step(0.5)
            calm = evaluations(host) - before
            assert (calm == 0) == (drift == QUIESCENT), calm
            host.put("chaser.force_ext", [2000.0, 500.0, -300.0])
            host.step(0.02)
            host.put("chaser.force_ext", [0.0, 0.0, 0.0])
            seen = []
            for _ in range(20):
                host.step(0.02)
                seen.append(host.get(*RING, "relative.velocity[2]"))
            host.set(**{"leg[2]__force_command": 50.0})
            for _ in range(20):
                host.step(0.02)
                seen.append(host.get(*RING, "relative.velocity[2]"))
            shaken[drift] = np.array(seen)
    swing = np.ptp(shaken[INTEGRATED][:, :3], axis=0).max()
    off = np.abs(shaken[QUIESCENT] - shaken[INTEGRATED]).max()
    print(f"ring moved by {1e3 * swing:.2f} mm, difference {off:.1e}")
    assert swing > 1e-3, swing
    assert off < 1e-6, off


def test_a_rest_is_part_of_the_saved_state(docking):
    with started(docking) as host, started(docking) as other:
        for _ in range(10):
            host.step(0.7)
        data = host.save_bytes()
        before = evaluations(host)
        host.step(0.7)
        assert evaluations(host) == before, "it should rest here"
        other.restore_bytes(data, 7.0)
        other.time = host.time - 0.7
        other.step(0.7)
        for _ in range(6):
            host.step(10.3)
            other.step(10.3)
        assert host.differences(other) == []
        assert host.value("time_of_contact") > 0.0


def test_tumbling_vehicles_are_where_the_integrator_puts_them(runs, tmp_path):
    mechanism = json.loads((paths.MECHANISMS / "idss_hexapod.json").read_text())
    for part in ("bodies", "legs", "leg_defaults", "capture"):
        del mechanism[part]
    file = tmp_path / "rigid_ring.json"
    file.write_text(json.dumps(mechanism))
    fmu = runs.fmu(
        "idss_25t_350t",
        f"mechanism.name={file.with_suffix('')}",
        'outputs.groups=["relative", "energy", "solver"]',
        "initial.at=start",
        "chaser.inertia=[60.5e3, 132e3, 90e3, 5e3, -8e3, 2e3]",
        "chaser.position=[-200, 0, 0]",
        "chaser.angular_velocity=[0.03, -0.05, 0.04]",
        "target.angular_velocity=[0.02, 0.03, -0.01]",
    )
    tight = {"solver__rtol": 1e-11, "solver__atol_position": 1e-12, "solver__atol_velocity": 1e-12}
    names = [(f"{v}.{q}", n) for v in ("chaser", "target") for q, n in KINDS]
    ends = {}
    for drift in (QUIESCENT, INTEGRATED):
        with started(fmu, drift, **(tight if drift == INTEGRATED else {})) as host:
            for size in (20.0, 0.1, 7.3, 60.0, 60.0):
                host.step(size)
            ends[drift] = np.concatenate([host.vector(name, count) for name, count in names])
            work = evaluations(host)
            assert (work == 0) == (drift == QUIESCENT), work
    off = np.abs(ends[QUIESCENT] - ends[INTEGRATED]).max()
    print(f"attitudes and positions differ by {off:.1e}")
    assert off < 1e-6, off


@pytest.mark.parametrize("case", ["swinging", "close"])
def test_what_moves_or_is_close_does_not_rest(runs, case):
    swinging = (
        "initial.approach_time=30",
        "mechanism.set.leg_defaults.damping=0",
        "initial.capture_body.velocity=[0, 1e-4, 0]",
    )
    scene = swinging if case == "swinging" else ("initial.approach_time=0.1",)
    with started(runs.fmu("idss_25t_350t", GROUPS, *scene)) as host:
        for _ in range(5):  # longer than a step ahead of the communication points before
            before = evaluations(host)
            for _ in range(1 if case == "swinging" else 5):
                host.step(1.0 if case == "swinging" else 0.015)
            assert evaluations(host) > before


def test_a_spin_that_changes_moves_the_mechanism_as_it_should(runs):
    """About its middle axis of inertia a body turns over: the legs feel it."""
    fmu = runs.fmu(
        "idss_25t_350t",
        GROUPS,
        "initial.approach_time=600",
        "chaser.inertia=[60.5e3, 132e3, 180e3, 0, 0, 0]",
    )
    legs = [f"leg[{i}].length" for i in range(1, 7)]
    lengths, work = {}, {}
    for drift in (QUIESCENT, INTEGRATED):
        with Host(fmu) as host:
            host.choose(model__flight=drift)
            host.put("chaser.angular_velocity", [1e-5, 0.05, 0.0])
            host.start()
            seen = []
            for _ in range(60):
                host.step(5.0)
                seen.append(host.get(*legs))
            lengths[drift], work[drift] = np.array(seen), evaluations(host)
    travel = np.ptp(lengths[INTEGRATED][1:], axis=0).max()
    off = np.abs(lengths[QUIESCENT] - lengths[INTEGRATED]).max()
    print(f"legs move by {travel:.1e} m, difference {off:.1e} m, work {work}")
    assert travel > 2e-5, travel
    assert off < 5e-7, off
    assert work[QUIESCENT] < work[INTEGRATED], work


def test_creep_is_not_taken_for_rest(runs):
    """Legs so damped that they need minutes to come home."""
    fmu = runs.fmu(
        "idss_25t_350t",
        GROUPS,
        "initial.approach_time=300",
        "mechanism.set.leg_defaults.damping=1e5",
        "initial.capture_body.displacement=[1e-3, 0, 0]",
    )
    ends = {}
    for drift in (QUIESCENT, INTEGRATED):
        with Host(fmu) as host:
            host.choose(model__flight=drift, solver__method=6)
            host.start()
            for _ in range(5):
                host.step(50.0)
            ends[drift] = host.get(*RING)
    off = np.abs(ends[QUIESCENT] - ends[INTEGRATED]).max()
    print(f"ring differs by {off:.1e} m")
    assert off < 5e-7, off


def test_rates_do_not_depend_on_what_was_read_before(docking):
    with started(docking) as host:
        for _ in range(8):
            host.step(1.0)
        names = [name for name in host.reference if name.startswith("der(ode.mechanism.v")]
        host.put("chaser.force_ext", [100.0, 0.0, 0.0])
        first = host.get(*names)
        host.value("relative.axial")
        host.put("chaser.force_ext", [100.0, 0.0, 0.0])
        second = host.get(*names)
        assert np.abs(first).max() > 1e-3, first
        assert (first == second).all(), (first, second)


SLOW = [
    ("revolute", 100.0, 5e-4, 1e-3),
    ("revolute", 1.0, 5e-6, 1e-3),
    ("prismatic", 0.1, 1e-3, 0.1),
]


@pytest.mark.parametrize("stiffness", [0.0, 1e-6], ids=["free", "period of 2000 s"])
@pytest.mark.parametrize("case", SLOW)
@pytest.mark.parametrize("touches", [False, True], ids=["alone", "inputs change"])
def test_a_slow_motion_is_not_stopped(tmp_path, case, touches, stiffness):
    """A joint of 0.1 kg m2 or 0.1 kg moves for ten minutes, freely or as a slow oscillator."""
    kind, start, rate, accuracy = case
    probe = {
        "name": "probe",
        "parent": "base",
        "mass": 0.1,
        "inertia": np.diag([0.1, 0.1, 0.1]).tolist(),
        "joint": {"type": kind, "axis": [0, 0, 1]},
    }
    spring = {
        "name": "spring",
        "along": [{"joint": "probe"}],
        "laws": [{"type": "spring", "stages": [[0, stiffness]]}],
    }
    mechanism = {"name": "swing", "bodies": [probe], "forces": [spring] if stiffness else []}
    (tmp_path / "swing.json").write_text(json.dumps(mechanism))
    (tmp_path / "swing.toml").write_text(
        "[chaser]\nmass = 1e9\ninertia = [1e9, 1e9, 1e9, 0, 0, 0]\n"
        f'[mechanism]\nname = "swing"\n[initial.joints.probe]\nposition = {start}\nrate = {rate}\n'
        '[experiment]\nstop = 600\nstep = 0.1\n[outputs]\ngroups = ["states", "solver"]\n'
    )
    docking = dl.Docking(tmp_path / "swing.toml")
    docking.set("accuracy", accuracy)
    docking.set("model.flight", QUIESCENT)
    for i in range(600):
        if touches and i < 20:
            docking.set("gravity", [0.0, 0.0, -1e-12 * (i % 2)])
        docking.step(1.0)
    omega, t = np.sqrt(stiffness / 0.1), 600.0
    if stiffness:
        moved = start * (np.cos(omega * t) - 1.0) + rate / omega * np.sin(omega * t)
    else:
        moved = rate * t
    assert docking.get("state.q[1]") - start == pytest.approx(moved, rel=0.01)


@pytest.mark.parametrize("family", ["hexapod", "probe_drogue", "apda"])
def test_drift_after_undocking_costs_nothing(family):
    """A sequence that waits for a command leaves the mechanism quiescent; momentum stays."""
    docking = dl.Docking(family)
    docking.set("command", "undock")
    while docking.get("phase") != 10:  # separated
        docking.step(1.0)
        assert docking.time < 400.0
    docking.step(20.0)
    made, place = docking.get("solver.rhs_evaluations"), docking.get("relative.axial")
    speed = docking.get("relative.velocity")[0]
    docking.step(100.0)
    assert docking.get("solver.rhs_evaluations") - made < 100
    if family == "hexapod":  # the other chaser turns
        assert docking.get("relative.axial") - place == pytest.approx(100.0 * speed, rel=0.01)
    assert docking.get("momentum.residual") < 1e-12
    docking.set("command", "hold")
    docking.step(1.0)


def test_bodies_with_surfaces_stay_where_they_came_to_rest():
    """The fingers of the gripper rest after a release, and the gap is that of moving fingers."""
    gaps = []
    for flight in ("resting", "integrated"):
        docking = dl.Docking("gripper")
        docking.set("model.flight", flight)
        docking.record([0.0, 60.0])
        docking.set("command", "undock")
        run = docking.record(np.linspace(60.0, 112.0, 105))
        gaps.append(run["gap"])
    assert run["gap"][-1] > 0.2  # fingers are the closest surfaces
    np.testing.assert_allclose(gaps[0], gaps[1], rtol=0.0, atol=1e-7)
