"""The three families of mechanisms and two variants: how they dock.

A hexapod with motors, a differential unit on rods or cranks, a probe with side absorbers or levers.

Each docks under its shipped scene. Energy and momentum are audited, and what makes a family what
it is shows in the result: a brake that gives way and then sticks, a probe that ends in its socket.
Inertia, stiffness and rod forces at home are those of another program
(``tests/data/mechanisms.json``).
"""

import json
from pathlib import Path

import numpy as np
import pytest

import dockloop as dl
from dockloop.base import paths
from dockloop.result import summary

VARIANTS = {"apda_cranks": "apda", "probe_drogue_levers": "probe_drogue"}  # of which family
FAMILIES = ("hexapod", "apda", "probe_drogue", *VARIANTS)
CHECKS = json.loads((Path(__file__).parent / "data" / "mechanisms.json").read_text())
NAMES_OF_CHECKS = {"hexapod": "hexapod_actuated"}  # others have the name of the family


def read_mechanism(name: str) -> dict:
    return json.loads((paths.MECHANISMS / f"{name}.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module", params=FAMILIES)
def docking(request):
    return dl.run(request.param, stop=6.0, step=0.05)


def test_every_family_captures_and_keeps_energy_and_momentum(docking):
    assert docking["captured"][-1]
    assert np.max(np.abs(docking["energy.residual"])) < 3e-6 * docking["energy.kinetic"][0]
    assert np.max(docking["momentum.residual"]) < 1e-12


def test_a_result_of_every_family_is_known_as_one(docking, tmp_path):
    """Its own command may write it again."""
    file = tmp_path / "own.csv"
    file.write_text(",".join(docking.names) + "\n")
    assert summary.RESULT.is_own(file)


def test_rings_of_two_families_are_those_of_the_standard():
    standard = read_mechanism("idss_hexapod")
    for name in ("hexapod", "apda", "apda_cranks"):
        for part in ("contact", "latches", "limits"):
            own = read_mechanism(name)[part]
            assert without_comments(own) == without_comments(standard[part]), (name, part)


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_differs_from_its_family_in_legs_only(name):
    own, family = read_mechanism(name), read_mechanism(VARIANTS[name])
    for part in ("capture", "contact", "latches", "limits", "interface"):
        assert without_comments(own[part]) == without_comments(family[part]), part
    steps, wanted = (each["sequence"]["steps"] for each in (own, family))
    for step, other in zip(steps, wanted, strict=True):
        for action, same in zip(step.get("do", []), other.get("do", []), strict=True):
            if isinstance(action.get("run"), dict):  # the drive ends where its legs do
                action["run"]["target"] = same["run"]["target"]
        assert step == other
    laws = [{f["name"]: f["laws"][0] for f in each["forces"]} for each in (own, family)]
    shared = laws[0].keys() & laws[1].keys()
    assert shared
    assert all(laws[0][element] == laws[1][element] for element in shared)


def test_crank_legs_turn_with_the_drive():
    """The travel at the pins of all six cranks is that of the drive, whatever the ring does."""
    run = dl.run("apda_cranks", stop=6.0, step=0.05)
    travel = np.mean([run[f"leg[{i}].length"] for i in range(1, 7)], axis=0)
    assert np.ptp(travel) > 0.02
    assert travel == pytest.approx(run["element[7].coordinate"], abs=1e-9)


def test_levers_turn_with_the_gimbal():
    """Near home a lever turns as far as the housing; its link keeps the lengths of the loop."""
    run = dl.run("probe_drogue_levers", stop=6.0, step=0.05)
    turned = [np.ptp(run[f"element[{i}].coordinate"]) for i in (2, 3)]
    assert min(turned) > 0.01
    assert max(turned) < 0.6


def without_comments(part):
    if not isinstance(part, dict):
        return part
    return {key: without_comments(value) for key, value in part.items() if key != "comment"}


def test_the_drive_brake_of_the_differential_unit_gives_way_and_sticks():
    forces = read_mechanism("apda")["forces"]
    drive = 1 + [force["name"] for force in forces].index("drive")
    level, presliding = (forces[drive - 1]["laws"][1][name] for name in ("back", "presliding"))
    run = dl.run("apda", stop=12.0, step=0.05)
    travel, force = (run[f"element[{drive}].{name}"] for name in ("coordinate", "force"))
    assert 0.03 < -np.min(travel) < 0.25  # it gave way, and no stop was needed
    held = travel[run["time"] > 6.0]
    assert np.ptp(held) < presliding
    assert np.max(np.abs(force[run["time"] > 6.0])) < level


def test_motors_of_the_hexapod_follow_commands():
    """The work of a constant torque is torque times angle."""
    forces = read_mechanism("hexapod")["forces"]
    motors = [k for k, force in enumerate(forces, 1) if force["name"].startswith("motor")]
    docking = dl.Docking("hexapod")
    for k in motors:
        docking.set(f"element[{k}].command", 1.0)
    work = 0.0
    for _ in range(100):
        start = [docking.get(f"element[{k}].coordinate") for k in motors]
        docking.step(1e-3)
        turned = np.array([docking.get(f"element[{k}].coordinate") for k in motors]) - start
        work += 0.05 * np.sum(turned)
    assert work > 1e-3
    assert docking.get("energy.drive_work") == pytest.approx(work, rel=1e-6)


def test_the_probe_ends_in_the_socket():
    run = dl.run("probe_drogue", stop=6.0, step=0.05)
    names = ["head", "rod", "cone", "mouth", "socket", "floor", "rim", "edge"]
    peaks = {name: run[f"contact.surface[{k}].peak"][-1] for k, name in enumerate(names, 1)}
    assert peaks["cone"] > 10.0
    assert peaks["floor"] > 10.0
    assert run["latch[1].lateral"][-1] < 0.005


def test_the_page_draws_pawls_where_the_core_has_them(tmp_path):
    """A page is refused if its shapes give other openings of latches than the recorded ones."""
    run = dl.run("probe_drogue", stop=3.0, step=0.05)
    page = run.view(tmp_path / "probe.html")
    assert "latch[4].opening" in run.names
    assert '"kind": "revolution"' in page.read_text() or '"kind":"revolution"' in page.read_text()


@pytest.mark.long
@pytest.mark.parametrize(("accuracy", "share"), [(0.0, 1e-5), (1e-3, 1e-3)])
@pytest.mark.parametrize("name", FAMILIES)
def test_every_family_goes_from_approach_to_undocking(name, accuracy, share):
    """Captured, retracted, hooked; undocked by command; energy and momentum audited all the way."""
    docking = dl.Docking(name)
    docking.set("accuracy", accuracy)
    steps = [step["name"] for step in docking.scene.document["mechanism"]["sequence"]["steps"]]
    started = docking.get("energy.kinetic")
    seen, hooks, docked = [], 0, None
    while docking.time < 200.0 and "separated" not in seen:
        docking.step(0.5)
        if (present := steps[docking.get("sequence.step") - 1]) not in seen:
            seen.append(present)
        hooks = max(hooks, docking.get("hooks.closed"))
        if present == "hard_docked":
            docked = docked or docking.time
            assert docking.get("outcome") == 6
            if docking.time > docked + 10.0:
                docking.set("command", 7)
    wanted = ["retract", "close_in", "seated", "close_hooks", "hard_docked", "undock", "separated"]
    assert seen[-len(wanted) :] == wanted
    assert hooks == 12
    assert docking.get("outcome") == 7
    assert docking.get("relative.axial") > 0.1
    assert docking.get("momentum.residual") < 1e-12
    assert abs(docking.get("energy.residual")) < share * started


ALIGNED = {
    "initial.approach_time": 0.5,
    "initial.closing_speed": 0.1,
    "initial.lateral_offset": 0.0,
    "initial.pitch_yaw_deg": 0.0,
    "initial.roll_deg": 0.0,
}


@pytest.mark.parametrize("name", FAMILIES)
def test_without_misalignment_a_family_docks_too(name):
    """Nothing rubs then, so the rings rock for long within the play of the latches."""
    docking = dl.Docking(name, ALIGNED)
    docking.set("accuracy", 1e-3)
    steps = [step["name"] for step in docking.scene.document["mechanism"]["sequence"]["steps"]]
    while docking.time < 200.0 and steps[docking.get("sequence.step") - 1] != "hard_docked":
        docking.step(0.5)
    assert docking.get("outcome") == 6
    assert docking.get("hooks.closed") == 12


def test_all_latches_may_catch_at_the_first_contact():
    """Two steps of the sequence follow at one instant; the outcome is that of the capture."""
    thrust = {"chaser.contact_thrust": 1000.0, "chaser.contact_thrust_delay": 0.3}
    docking = dl.Docking("apda", ALIGNED | thrust)
    while docking.time < 10.0:
        docking.step(0.5)
        if docking.get("captured"):
            assert docking.get("capture.reason") == 1
            assert docking.get("outcome") == 2
    assert docking.get("captured")


SCENE_AT_HOME = """
title = "A mechanism on a fixed base"
[chaser]
motion = "fixed"
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]
[mechanism]
name = "own"
[initial]
at = "start"
{start}
[outputs]
groups = ["energy", "legs"]
"""


def make_linear(name: str) -> dict:
    """The mechanism with nothing but the first stage of each spring, as other programs have it."""
    mechanism = read_mechanism(name)
    for member in ("failures", "sequence", "interface", "contact", "latches", "limits"):
        mechanism.pop(member, None)
    for force in mechanism["forces"]:
        stages = [law["stages"][0] for law in force["laws"] if law["type"] == "spring"]
        if force["name"] == "drive":
            stages = [[0.0, CHECKS["differential"]["k_drive"]]]  # here its brake holds the drive
        force["laws"] = [{"type": "spring", "stages": [stage]} for stage in stages]
    mechanism["forces"] = [force for force in mechanism["forces"] if force["laws"]]
    return mechanism | {"name": "own"}


@pytest.fixture
def start(tmp_path):
    """Put a mechanism at a displacement or rate of its independent coordinates."""

    def call(mechanism, kind, values):
        values = [float(value) for value in values]
        if len(values) == 6:
            names = {"rate": ("velocity", "angular_velocity")}
            first, second = names.get(kind, ("displacement", "rotation_vector"))
            lines = [
                "[initial.capture_body]",
                f"{first} = {values[:3]}",
                f"{second} = {values[3:]}",
            ]
        else:
            joints = zip(("yoke", "housing", "probe"), values, strict=True)
            lines = [f"[initial.joints.{joint}]\n{kind} = {value}" for joint, value in joints]
        (tmp_path / "own.json").write_text(json.dumps(mechanism))
        (tmp_path / "own.toml").write_text(SCENE_AT_HOME.format(start="\n".join(lines)))
        return dl.Docking(tmp_path / "own.toml")

    return call


def find_matrix(energy, size, h):
    """Matrix of a quadratic form, by central differences of second order."""
    unit = h * np.eye(size)
    at_home = energy(np.zeros(size))
    alone = [energy(e) + energy(-e) - 2 * at_home for e in unit]
    matrix = np.diag(alone)
    for i, j in zip(*np.tril_indices(size, -1), strict=True):
        pair = energy(unit[i] + unit[j]) + energy(-unit[i] - unit[j]) - 2 * at_home
        matrix[i, j] = matrix[j, i] = (pair - alone[i] - alone[j]) / 2
    return matrix / h**2


@pytest.mark.parametrize("name", FAMILIES)
def test_inertia_and_stiffness_at_home_are_those_of_another_program(start, name):
    """Kinetic energy is quadratic in rates; potential energy is so for small displacements."""
    checks = CHECKS["mechanisms"][NAMES_OF_CHECKS.get(name, name)]
    mechanism = make_linear(name)
    for kind, energy, wanted, h, share in (
        ("rate", "kinetic", checks["reduced_inertia"], 1.0, 1e-7),  # measured: 1e-8
        ("position", "potential", checks["stiffness"], 1e-4, 1e-6),  # 1.4e-7
    ):
        found = find_matrix(
            lambda x, k=kind, e=energy: start(mechanism, k, x).get(f"energy.{e}"), len(wanted), h
        )
        assert np.max(np.abs(found - wanted)) < share * np.max(wanted), energy


def test_the_differential_unit_stands_on_the_stiffness_of_its_shafts(start):
    """Rods that feel each other, and the stiffness of the ring that follows from them.

    With a ring of immense inertia nothing accelerates, so rod forces are those at rest.
    """
    checks = CHECKS["differential"]
    unit = make_linear("apda")
    rates = [
        [start(unit, "rate", twist).get(f"leg[{i}].rate") for i in range(1, 7)]
        for twist in np.eye(6)
    ]
    jacobian = np.array(rates).T
    assert jacobian == pytest.approx(np.array(checks["J"]), abs=1e-9)
    (ring,) = [body for body in unit["bodies"] if body["name"] == "ring"]
    ring |= {"mass": 1e12, "inertia": (1e12 * np.eye(3)).tolist()}
    h, columns = 1e-6, []
    for twist in np.linalg.inv(jacobian).T:  # one rod longer, the others as they are
        in_, out = (
            np.array([moved.get(f"leg[{i}].force") for i in range(1, 7)])
            for moved in (start(unit, "position", side * h * twist) for side in (-1, 1))
        )
        columns.append((in_ - out) / (2 * h))
    stiffness = np.array(columns).T
    assert stiffness == pytest.approx(np.array(checks["K_rod"]), abs=1e-3)
    forces = 0.01 * stiffness[:, 0]
    assert forces == pytest.approx(checks["rod_forces_for_10_mm_in_rod_1"], abs=1e-5)
    of_ring = jacobian.T @ stiffness @ jacobian
    assert of_ring == pytest.approx(np.array(checks["K_ring"]), abs=1e-2)
