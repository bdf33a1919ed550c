"""A driven vehicle from a record: ``[[input]]`` with its motion, as a table or CCSDS messages.

Oracles: a docking of two free vehicles, replayed with the recorded motion of one of them; a smooth
motion in closed form, with the force and torque that a rigid body needs for it.
"""

import numpy as np
import pytest

import dockloop as dl
from dockloop.base.errors import DockloopError, UsageError
from dockloop.base.rotations import conjugate, multiply
from dockloop.fmu.build import build_fmu
from extreme_cases.fmi_host import OK, Host
from slides import VEHICLE

DOCKING = "idss_25t_350t"
ACCURATE = {"solver.rtol": 1e-9, "solver.atol_position": 1e-11, "solver.atol_velocity": 1e-11}
SIZES = {"position": 3, "velocity": 3, "attitude": 4, "angular_velocity": 3}
PEAKS = [f"capture.peak.{load}" for load in ("compression", "shear", "bending", "torsion")]
STOP = 4.0  # the latches catch at 3.08 s
MASS, INERTIA = 1000.0, np.array([1000.0, 1500.0, 900.0])
SCENE = VEHICLE.replace(
    "inertia = [1000, 1000, 1000", 'motion = "driven"\ninertia = [1000, 1500, 900'
)
SCENE += """
[solver]
rtol = 1e-10
atol_velocity = 1e-13
atol_energy = 1e-11
[[input]]
file = "motion.csv"
"""


def list_columns(vehicle):
    return [f"{vehicle}.{m}[{i}]" for m, n in SIZES.items() for i in range(1, n + 1)]


def write_table(path, time, columns):
    """Write a table in full digits."""
    rows = np.column_stack([time, *columns.values()])
    lines = [",".join(["time", *columns]), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.fixture(scope="module")
def free():
    """A docking of two free vehicles."""
    return dl.run(DOCKING, ACCURATE, stop=STOP)


def replay(free, vehicles, folder, every=1, overrides=None, **settings):
    """Run a docking again in which vehicles follow the records of another one."""
    keys = {**ACCURATE, "experiment.stop": STOP, "initial.at": "start", **(overrides or {})}
    for vehicle in ("chaser", "target"):
        if vehicle not in vehicles:
            for member in SIZES:
                keys[f"{vehicle}.{member}"] = free.vector(f"{vehicle}.{member}")[0].tolist()
            continue
        columns = {name: free[name][::every] for name in list_columns(vehicle)}
        file = write_table(folder / f"{vehicle}.csv", free.time[::every], columns)
        number = 1 + vehicles.index(vehicle)
        keys |= {f"{vehicle}.motion": "driven", f"input.{number}.file": file}
    return dl.run(DOCKING, keys, **settings)


@pytest.mark.parametrize("vehicles", [["chaser"], ["target"], ["chaser", "target"]])
def test_a_replayed_docking_has_the_loads_of_the_free_one(free, vehicles, tmp_path):
    again = replay(free, vehicles, tmp_path)
    for vehicle in vehicles:
        for name in list_columns(vehicle):
            most = 1e-15 if "position" in name else 1e-12
            assert again[name] == pytest.approx(free[name], rel=1e-12, abs=most)
    for name in PEAKS:
        assert again[name][-1] == pytest.approx(free[name][-1], rel=1e-4)
    for name in list_columns("target"):
        assert again[name] == pytest.approx(free[name], abs=1e-8)
    scale = free["energy.kinetic"][0]
    assert np.max(np.abs(again["energy.residual"])) < 1e-9 * scale
    assert np.max(again["momentum.residual"]) < 1e-11
    # Nothing acted from outside on the free vehicle, so the record needs no work and no impulse.
    assert abs(again["energy.external"][-1]) < 1e-6 * scale
    assert again["chaser.force_mean[1]"] == pytest.approx(free["chaser.force_mean[1]"], abs=0.1)
    for load in again.summary["records"].values():
        assert np.linalg.norm(load["impulse"]) < 1e-3


def test_finer_rows_have_smaller_errors(free, tmp_path):
    errors = []
    for every in (8, 4, 2):
        again = replay(free, ["chaser"], tmp_path, every)
        errors.append(abs(again["capture.peak.bending"][-1] / free["capture.peak.bending"][-1] - 1))
    assert errors[0] < 1e-3
    assert errors[2] < errors[0] / 4.0


def make_part(vehicle):
    """A slide of 300 kg on a soft spring."""
    part = {"mass": 300.0, "position": [-2.0, 0.0, 1.0], "joint": "slide", "axis": [0.0, 0.0, 1.0]}
    part |= {"stiffness": 4000.0, "damping": 20.0, "rate": [0.02]}
    return {f"{vehicle}.part.1.{name}": value for name, value in part.items()}


@pytest.mark.parametrize(
    "overrides",
    [
        {"model.level": "rigid"},
        {"model.level": "massless_legs"},
        {"chaser.mass_includes_mechanism": 2},
        {"contact.friction_model": "bristle"},
        {"target.position": [7e6, 1e5, -3e5], "target.velocity": [10.0, 7500.0, 100.0]},
        make_part("chaser") | make_part("target"),
    ],
    ids=["rigid", "massless", "included", "bristle", "orbit", "parts"],
)
def test_levels_friction_orbits_and_parts(overrides, tmp_path):
    free = dl.run(DOCKING, {**ACCURATE, **overrides}, stop=STOP)
    vehicles = ["chaser", "target"] if "target.part.1.mass" in overrides else ["chaser"]
    again = replay(free, vehicles, tmp_path, overrides=overrides)
    for name in PEAKS:
        assert again[name][-1] == pytest.approx(free[name][-1], rel=1e-3)
    assert np.max(again["momentum.residual"]) < 1e-10


def find_motion(time):
    """A smooth motion with its derivatives: position, velocity, acceleration; attitude, rates."""
    t = np.asarray(time)[:, None]
    k, size = np.array([0.7, 1.1, 1.9]), np.array([1.0, 0.3, -0.5])
    p, v, a = size * np.sin(k * t), size * k * np.cos(k * t), -size * k**2 * np.sin(k * t)
    q = np.hstack([np.ones_like(t), 0.2 * np.sin(k * t)])  # w from it, for any length
    q_1, q_2 = (np.hstack([0 * t, 0.2 * f]) for f in (k * np.cos(k * t), -(k**2) * np.sin(k * t)))
    square = np.sum(q * q, axis=1, keepdims=True)
    w = 2.0 * multiply(conjugate(q), q_1)[:, 1:] / square
    growth = 2.0 * np.sum(q * q_1, axis=1, keepdims=True) / square
    alpha = 2.0 * multiply(conjugate(q), q_2)[:, 1:] / square - growth * w
    return p, v, a, q / np.sqrt(square), w, alpha


def write_motion(folder, step, stop=3.0, names=tuple(SIZES)):
    time = np.arange(round(stop / step) + 1) * step
    p, v, _, q, w, _ = find_motion(time)
    members = dict(zip(SIZES, (p, v, q, w), strict=True))
    columns = {f"chaser.{m}[{i + 1}]": members[m][:, i] for m in names for i in range(SIZES[m])}
    write_table(folder / "motion.csv", time, columns)
    return folder / "vehicle.toml"


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "vehicle.toml").write_text(SCENE)
    return tmp_path / "vehicle.toml"


@pytest.mark.parametrize("names", [tuple(SIZES), ("position", "attitude")])
def test_the_interpolant_has_the_motion_to_the_fourth_order(scene, tmp_path, names):
    errors = []
    for step in (0.1, 0.05):
        write_motion(tmp_path, step, names=names)
        run = dl.run(scene, step=0.05 / 3.0)
        middle = (run.time > 0.5) & (run.time < 2.5)  # the ends of a spline have larger errors
        p, v, a, q, w, alpha = (each[middle] for each in find_motion(run.time))
        torque = INERTIA * alpha + np.cross(w, INERTIA * w)
        expected = {"position": p, "velocity": v, "attitude": q, "angular_velocity": w}
        expected |= {"force_ext": MASS * a, "torque_ext": torque}
        found = {name: run.vector(f"chaser.{name}")[middle] for name in expected}
        errors.append({name: np.abs(found[name] - expected[name]).max() for name in expected})
        assert np.max(np.abs(run["energy.residual"])) < 1e-9 * run["energy.kinetic"].max()
        assert np.max(run["momentum.residual"]) < 1e-9
    orders = {name: np.log2(errors[0][name] / errors[1][name]) for name in errors[0]}
    assert min(orders["position"], orders["attitude"]) > 3.7
    assert min(orders["velocity"], orders["angular_velocity"]) > 2.7
    assert min(orders["force_ext"], orders["torque_ext"]) > 1.7


def test_fmu_model_exchange_and_saved_states(scene, tmp_path):
    write_motion(tmp_path, 0.1)
    fmu = build_fmu(scene, output=tmp_path / "vehicle.fmu")
    docking = dl.Docking(scene)
    with Host(fmu) as host:
        host.start()
        for _ in range(10):
            assert host.step_status(0.3) == OK
            docking.step(0.3)
        for name in ("position[1]", "attitude[2]", "force_ext[3]", "torque_ext[2]"):
            assert host.value(f"chaser.{name}") == docking.get(f"chaser.{name}")
    with Host(fmu, exchange=True) as host:
        host.integrate(3.0, 0.01, host.start_exchange())
        assert host.value("chaser.position[1]") == pytest.approx(
            docking.get("chaser.position[1]"), rel=1e-12
        )
    docking = dl.Docking(scene)
    docking.step(1.07)
    state, ends = docking.save(), []
    for _ in range(2):
        docking.step(0.4)
        ends.append([docking.get(name) for name in ("chaser.force_ext[1]", "energy.external")])
        docking.restore(state)
    assert ends[0] == ends[1]


def test_a_step_beyond_the_record_is_refused(scene, tmp_path):
    write_motion(tmp_path, 0.1)
    docking = dl.Docking(scene)
    docking.step(3.0)
    with pytest.raises(DockloopError, match=r"the record of the chaser ends at t = 3 s"):
        docking.step(0.1)
    assert docking.time == 3.0


def test_what_keeps_the_vehicle_is_an_output(scene, tmp_path):
    write_motion(tmp_path, 0.1)
    docking = dl.Docking(scene)
    assert docking.variables["chaser.force_ext[1]"].causality == "output"
    with pytest.raises(UsageError, match=r"chaser\.position\[1\]"):
        docking.set("chaser.position[1]", 1.0)


# ---------------------------------------------------------------- CCSDS

OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-06-01T00:00:00
ORIGINATOR = RIG
META_START
OBJECT_NAME = CHASER
OBJECT_ID = 2026-001A
CENTER_NAME = STATION
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 2026-06-01T23:59:59.000
STOP_TIME = 2026-06-02T00:00:02.000
INTERPOLATION = HERMITE
META_STOP
COMMENT position in km, velocity in km/s
{rows}COVARIANCE_START
EPOCH = 2026-06-01T23:59:59.000
1 2 3
COVARIANCE_STOP
"""
AEM = """CCSDS_AEM_VERS = 1.0
META_START
REF_FRAME_A = EME2000
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = A2B
TIME_SYSTEM = UTC
ATTITUDE_TYPE = QUATERNION
QUATERNION_TYPE = LAST
META_STOP
DATA_START
{rows}DATA_STOP
"""
EPOCHS = [
    *(f"2026-06-01T23:59:59.{ms:03d}" for ms in range(0, 1000, 250)),
    *(f"2026-06-02T00:00:0{s}.{ms:03d}" for s in (0, 1) for ms in range(0, 1000, 250)),
    "2026-06-02T00:00:02.000",
]
MESSAGES = SCENE.replace('file = "motion.csv"', 'file = "a.oem"\n[[input]]\nfile = "a.aem"')


def write_messages(folder, *, oem=OEM, aem=AEM, order=(1, 2, 3, 0), sign=1.0, scene=MESSAGES):
    """Write both messages, and a table of the same numbers."""
    p, v, _, q, *_ = find_motion(0.25 * np.arange(len(EPOCHS)))
    lines = {"oem": np.hstack([p, v]) / 1e3, "aem": (q * [1.0, sign, sign, sign])[:, order]}
    texts = {
        kind: "".join(
            f"{epoch} {' '.join(map(repr, row))}\n"
            for epoch, row in zip(EPOCHS, rows.tolist(), strict=True)
        )
        for kind, rows in lines.items()
    }
    (folder / "a.oem").write_text(oem.format(rows=texts["oem"]))
    (folder / "a.aem").write_text(aem.format(rows=texts["aem"]))
    names = [f"chaser.position[{i}] [km]" for i in (1, 2, 3)]
    names += [f"chaser.velocity[{i}] [km/s]" for i in (1, 2, 3)]
    names += [f"chaser.attitude[{i}] [1]" for i in (1, 2, 3, 4)]
    rows = [
        ",".join([epoch, *map(repr, row)])
        for epoch, row in zip(EPOCHS, np.hstack([lines["oem"], q]).tolist(), strict=True)
    ]
    (folder / "motion.csv").write_text("\n".join([",".join(["time", *names]), *rows]) + "\n")
    (folder / "vehicle.toml").write_text(scene)
    return folder / "vehicle.toml"


SHOWN = [f"chaser.{m}[{i}]" for m, n in SIZES.items() for i in range(1, n + 1)]


@pytest.mark.parametrize(
    ("changes", "order", "sign"),
    [
        ([], (1, 2, 3, 0), 1.0),
        ([("= LAST", "= FIRST")], (0, 1, 2, 3), 1.0),
        ([("= A2B", "= B2A")], (1, 2, 3, 0), -1.0),
        (
            [("_A = EME2000", "_A = SC_BODY_1"), ("_B = SC_BODY_1", "_B = EME2000")],
            (1, 2, 3, 0),
            -1,
        ),
        ([("ATTITUDE_DIR = A2B\n", ""), ("QUATERNION_TYPE = LAST\n", "")], (1, 2, 3, 0), 1.0),
    ],
    ids=["last", "first", "to body", "from body", "version 2"],
)
def test_messages_have_the_bits_of_the_table(tmp_path, changes, order, sign, capsys):
    aem = AEM
    for old, new in changes:
        aem = aem.replace(old, new)
    scene = write_messages(tmp_path, aem=aem, order=order, sign=sign)
    runs = [dl.run(scene, step=0.1)]
    said = capsys.readouterr().err
    assert said.count("'EME2000' is taken as the frame N of the scene") == 2
    (tmp_path / "vehicle.toml").write_text(SCENE)
    runs.append(dl.run(scene, step=0.1))
    for name in [*SHOWN, "chaser.torque_ext[1]", "energy.external"]:
        assert np.array_equal(runs[0][name], runs[1][name]), name


def test_day_of_year_other_rows_and_a_start(tmp_path):
    """Attitude at half the rows, epochs by the day of the year, and t = 0 within the record."""
    scene = write_messages(tmp_path)
    text = (tmp_path / "a.aem").read_text().splitlines(keepends=True)
    first = next(i for i, line in enumerate(text) if line.startswith("2026"))
    rows = text[first:-1:2]
    (tmp_path / "a.aem").write_text("".join([*text[:first], *rows, text[-1]]))
    oem = (tmp_path / "a.oem").read_text().replace("\n2026-06-01T", "\n2026-152T")
    (tmp_path / "a.oem").write_text(oem)
    start = 'start = "2026-06-01T23:59:59.5"\n'
    later = MESSAGES.replace("stop = 3.0", "stop = 2.5").replace('oem"\n', f'oem"\n{start}')
    scene.write_text(later + start)
    run = dl.run(scene, step=0.1)
    p, _, _, q, *_ = find_motion(run.time + 0.5)
    assert run.vector("chaser.position") == pytest.approx(p, abs=1e-3)
    assert run.vector("chaser.attitude") == pytest.approx(q, abs=5e-3)


# ---------------------------------------------------------------- sentences


def change(text, old, new):
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("oem", "aem", "scene", "expected"),
    [
        (("= UTC", "= TDB"), None, None, "has times of 'UTC', another motion of 'TDB'"),
        (("META_STOP\n", "META_STOP\n2026-06-01T23:59:58 1 2\n"), None, None, "must have 6"),
        (("{rows}", "{rows}2026-06-01T23:59:58 0 0 0 0 0 0\n"), None, None, "time must not decr"),
        (("{rows}", ""), None, None, "is the message cut off?"),
        (("{rows}", "{rows}META_START\n"), None, None, "begins a second segment"),
        (None, ("= QUATERNION\n", "= SPIN\n"), None, "ATTITUDE_TYPE is 'SPIN': must be QUATERN"),
        (None, ("= LAST", "= THIRD"), None, "QUATERNION_TYPE is 'THIRD': must be FIRST or LAST"),
        (None, ("= SC_BODY_1", "= LVLH"), None, "one of them must be SC_BODY_1"),
        (None, ("= A2B", "= UP"), None, "ATTITUDE_DIR is 'UP': must be A2B or B2A"),
        (None, ("{rows}", "{rows}2026-06-02T00:00:03 0 0 0 2\n"), None, "has length 2: must be 1"),
        (None, ("{rows}", "{rows}2026-06-02T00:00:03 1 0 0 0\n"), None, "deg between the rows at"),
        (None, None, ("stop = 3.0", "stop = 3.4"), "is from 0 to 3 s, the run from 0 to 3.4 s"),
        (None, None, ('motion = "driven"', ""), "the chaser is not driven: set chaser.motion"),
        (None, None, ('file = "a.oem"\n[[input]]\n', ""), "the record of the chaser has no posit"),
        (None, None, ('"a.oem"', '"motion.csv"\nvehicle = "chaser"'), "is of CCSDS messages"),
        (None, None, ('"a.aem"', '"a.aem"\ninterpolation = "hold"'), "which cannot hold"),
        (None, None, ('"a.aem"', '"a.aem"\nstart = 3'), "start is '3': must be a date"),
        (None, None, ('"a.aem"', '"a.aem"\nvehicle = "target"'), "the target is not driven"),
        (
            None,
            None,
            ('"a.aem"', '"a.aem"\n[[disturbance]]\nvehicle = "chaser"\ntime = 1\nduration = 1'),
            "a disturbance of this vehicle would have no effect",
        ),
    ],
)
def test_a_bad_record_is_refused_in_one_sentence(tmp_path, oem, aem, scene, expected):
    path = write_messages(
        tmp_path,
        oem=change(OEM, *oem) if oem else OEM,
        aem=change(AEM, *aem) if aem else AEM,
        scene=change(MESSAGES, *scene) if scene else MESSAGES,
    )
    with pytest.raises(UsageError) as caught:
        dl.Docking(path)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (lambda t, c: c.pop("chaser.attitude[4]"), "has no column 'chaser.attitude[4]'"),
        (lambda t, c: t.__setitem__(3, t[2]), "has two rows at t = 0.2 s"),
        (lambda t, c: c["chaser.position[2]"].__setitem__(4, np.nan), "at t = 0.4 s is not compl"),
        (lambda t, c: [c.pop(f"chaser.position[{i}]") for i in (1, 2, 3)], "has no position"),
        (lambda t, c: [c.pop(f"chaser.attitude[{i}]") for i in (1, 2, 3, 4)], "but no attitude"),
    ],
)
def test_a_bad_table_of_motion_is_refused(scene, tmp_path, edit, expected):
    time = np.arange(31) * 0.1
    p, v, _, q, w, _ = find_motion(time)
    columns = dict(zip(SHOWN, np.hstack([p, v, q, w]).T.copy(), strict=True))
    edit(time, columns)
    write_table(tmp_path / "motion.csv", time, columns)
    with pytest.raises(UsageError, match=expected.replace("[", r"\[").replace(".", r"\.")):
        dl.Docking(scene)


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (
            lambda c, _: c["chaser.velocity[1]"].__setitem__(12, 0.0),
            "velocity contradicts the rows of chaser.position by 0.467 m/s at t = 1.2 s",
        ),
        (
            lambda c, _: c["chaser.angular_velocity[3]"].__imul__(-1.0),
            "angular_velocity contradicts the rows of chaser.attitude by",
        ),
        (
            lambda _, keep: keep.__setitem__(slice(1, 15), False),
            "has a gap of 1.5 s at t = 0 s, between rows every 0.1 s",
        ),
    ],
)
def test_contradictions_and_gaps_are_said(scene, tmp_path, edit, expected, capsys):
    time, keep = np.arange(31) * 0.1, np.full(31, fill_value=True)
    p, v, _, q, w, _ = find_motion(time)
    columns = dict(zip(SHOWN, np.hstack([p, v, q, w]).T.copy(), strict=True))
    edit(columns, keep)
    columns = {name: values[keep] for name, values in columns.items()}
    write_table(tmp_path / "motion.csv", time[keep], columns)
    dl.Docking(scene)
    assert expected in capsys.readouterr().err


def test_position_alone_keeps_the_attitude_and_unknown_keywords_are_said(tmp_path, capsys):
    scene = write_messages(
        tmp_path,
        oem=change(OEM, "CENTER_NAME", "CENTRE_NAME"),
        scene=change(SCENE, "motion.csv", "a.oem"),
    )
    run = dl.run(scene)
    said = capsys.readouterr().err
    assert "nothing uses the keyword 'CENTRE_NAME (did you mean" in said.replace("; ", " (")
    assert "has no attitude: the chaser keeps that of the scene" in said
    assert np.array_equal(run.vector("chaser.attitude")[-1], [1.0, 0.0, 0.0, 0.0])
