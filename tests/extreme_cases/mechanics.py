"""Extremes of the mechanics: masses, stiffnesses, poses, redundant equations, scales and frames."""

import json
import math
from pathlib import Path

import numpy as np

from extreme_cases import Part
from extreme_cases import mechanism_benchmarks as benchmarks
from extreme_cases.absolute_kkt import (
    Mechanism,
    close_states,
    find_errors,
    find_gap,
    flat,
    follow_core,
    solve,
)
from extreme_cases.reference import Bumper, Hexapod, find_rotations, integrate
from extreme_cases.scenes import (
    FIXED_BASE,
    HEXAPOD_ENDS,
    OUTPUTS,
    capture_body_section,
    hexapod,
    move,
)

GRAVITY = 9.81

# ------------------------------------------------------------------------------------------------
# The free-floating hexapod through the FMU and by `reference.Hexapod`.
CHASER = """
[chaser]
motion = "free"
mass = 500
inertia = [900, 1100, 1500, 0, 0, 0]
velocity = [0.01, 0, 0]
angular_velocity = [0, 0.002, 0.001]
"""
BASE_VELOCITY, BASE_SPIN = np.array([0.01, 0.0, 0.0]), np.array([0.0, 0.002, 0.001])
RING_VELOCITY, RING_SPIN = np.array([0.05, -0.03, -0.10]), np.array([0.05, 0.04, -0.06])
ARM = np.array([0.0, 0.0, 2.0])
RING = [f"ring.position[{i}]" for i in (1, 2, 3)]
POSE = [*(f"chaser.position[{i}]" for i in (1, 2, 3)), *RING]


def build_hexapod(shop, *, rtol=1e-11, **options):
    """FMU of the free-floating hexapod in its start state."""
    start = capture_body_section(
        np.zeros(3), np.zeros(3),
        RING_VELOCITY - BASE_VELOCITY - np.cross(BASE_SPIN, ARM), RING_SPIN - BASE_SPIN,
    )  # fmt: skip
    return shop.own(hexapod(**options), CHASER, start, OUTPUTS, rtol=rtol)


def find_hexapod(span, *, ratio=500 / 30, stiffness=2000.0, damping=40.0, leg=1.0):
    """Base position and ring position relative to the base, after `span` [s]; and the start."""
    base = ratio * 30 / 500
    model = Hexapod(
        (500 * base, 30.0),
        (base * np.array([900.0, 1100.0, 1500.0]), np.array([8.0, 9.0, 15.0])),
        HEXAPOD_ENDS,
        ((4 * leg, 0.6, 0.5 * leg), (3 * leg, 0.5, 0.4 * leg)),
        (stiffness, damping, LEG_LENGTH),
    )
    unit = [1.0, 0.0, 0.0, 0.0]
    start = np.concatenate(
        (np.zeros(3), unit, BASE_VELOCITY, BASE_SPIN, ARM, unit, RING_VELOCITY, RING_SPIN)
    )
    vibration, decay = model.find_fastest()
    first = min(span, 1.0 / vibration, 1.0 / max(decay, 1e-9))
    y = integrate(model.find_rates, start, span, tolerance=1e-13, step=first)
    relative = find_rotations(y[3:7]).T @ (y[13:16] - y[:3])
    return np.array([*y[:3], *relative])


LEG_LENGTH = float(
    np.linalg.norm([*np.subtract(HEXAPOD_ENDS[1][0], HEXAPOD_ENDS[0][0]), 0.0, 0.0, 2.0])
)


def chaser_of(ratio):
    """Settings that make the base `ratio` times as heavy as the ring."""
    base = ratio * 30 / 500
    inertia = (900.0, 1100.0, 1500.0)
    return {
        "chaser.mass": 500 * base,
        **{f"chaser.inertia[{i}]": base * x for i, x in enumerate(inertia, 1)},
    }


def find_pose_error(fmu, span, **case):
    """Error of the poses after `span`, relative to the way that the ring has made."""
    ratio = case.get("ratio", 500 / 30)
    rows = move(fmu, [span], settings=chaser_of(ratio), names=POSE)
    wanted = find_hexapod(span, **case)
    way = np.max(np.abs(wanted - rows[0]))
    return np.max(np.abs(rows[-1] - wanted)) / way


def run_hexapod_masses(shop, score, quick):
    """Item 1, motion: both ratios one after the other, from the nominal ones."""
    fmu = build_hexapod(shop)
    span = 0.5 if quick else 2.0
    for power in (0, 4, 8) if quick else range(9):
        ratio = 10.0**power
        score.right_or_refused(
            f"body/ring {ratio:.0e}", lambda ratio=ratio: find_pose_error(fmu, span, ratio=ratio)
        )
    for power in (0, -4, -9) if quick else range(0, -10, -1):
        leg = 10.0**power * 30 / 7
        fmu = build_hexapod(shop, leg=leg)
        score.right_or_refused(
            f"leg/ring 1e{power}", lambda leg=leg, fmu=fmu: find_pose_error(fmu, span, leg=leg)
        )


def read_hexapod():
    """Mechanism and states of the hexapod whose figures another program computed."""
    path = Path(__file__).parents[1] / "data" / "hexapod_r2p1r3.json"
    return json.loads(path.read_text(encoding="utf-8"))


def float_hexapod(document, ratio, leg):
    """Hang a hexapod on a free carrier; scale masses of the carrier and of the leg parts."""
    mechanism = json.loads(json.dumps(document["mechanism"]))
    ring = next(body for body in mechanism["bodies"] if body["joint"]["type"] == "free")
    parts = [body for body in mechanism["bodies"] if body is not ring]
    total = sum(body.get("mass", 0.0) for body in parts) / 6
    for body in parts:
        scale = leg * ring["mass"] / total
        body["mass"] = body.get("mass", 0.0) * scale
        body["inertia"] = (scale * np.array(body.get("inertia", np.zeros((3, 3))))).tolist()
    for body in mechanism["bodies"]:
        body["parent"] = "carrier" if body["parent"] == "base" else body["parent"]
    for loop in mechanism["loops"]:
        for end in ("root", "closing"):
            loop[end] = "carrier" if loop[end] == "base" else loop[end]
    mass = ratio * ring["mass"]
    carrier = {
        "name": "carrier",
        "parent": "base",
        "joint": {"type": "free"},
        "mass": mass,
        "inertia": np.diag([mass, 1.2 * mass, 1.5 * mass]).tolist(),
    }
    mechanism["bodies"].insert(0, carrier)
    unit = [0, 0, 0, 1, 0, 0, 0]
    mechanism["home_q"] = [*unit, *document["home_q"]]
    states = [
        {
            "q": [*unit, *state["q"]],
            "v_independent": [0.01, 0.02, -0.01, 0.02, 0.01, -0.03, *state["v_independent"]],
            "tau": [0.0] * 6 + state["tau"],
        }
        for state in document["states"][:3]
    ]
    return {"mechanism": mechanism, "states": states}


def find_oracle_error(shop, document):
    """Largest error of all figures against the dense solution in absolute coordinates."""
    m = Mechanism(document["mechanism"])
    results, file = shop.evaluate(document)
    follow_core(m, file)
    q, _ = close_states(m, np.array([state["q"] for state in document["states"]]))
    wanted = solve(m, document["states"], q)
    errors = find_errors(results, wanted)
    # A floating body carries no load to its base: a difference of inertia forces as large as this.
    inertia = max(1.0, *(np.max(m.mass) * np.max(np.abs(state["a"])) for state in wanted))
    for key in ("joint_load", "base_force", "base_moment"):
        scale = max(1.0, *(np.max(np.abs(flat(state[key]))) for state in wanted))
        errors[key] *= min(1.0, scale / inertia)
    return max(errors.values())


def run_absolute_masses(shop, score, quick):
    """Item 1, accelerations, forces and reduced inertia, over the plane of both ratios."""
    vectors = read_hexapod()
    legs = (0.0, 1e-9, 1e-4, 1.0) if quick else (0.0, *(10.0**-k for k in range(9, -1, -1)))
    for ratio in (1.0, 1e4, 1e8) if quick else [10.0**k for k in range(9)]:
        for leg in legs:
            score.right_or_refused(
                f"body/ring {ratio:.0e}, leg/ring {leg:.0e}",
                lambda ratio=ratio, leg=leg: find_oracle_error(
                    shop, float_hexapod(vectors, ratio, leg)
                ),
            )


def without_mass(mechanism, *names):
    """A mechanism in which the named bodies (all, if none is named) have no mass."""
    mechanism = json.loads(json.dumps(mechanism))
    for body in mechanism["bodies"]:
        if not names or body["name"] in names:
            body.pop("mass", None)
            body.pop("inertia", None)
    return mechanism


def run_massless(shop, score, _quick):
    """Item 1: what a zero mass leaves singular is refused, by `check --states` and by the FMU."""
    crank = benchmarks.slider_crank()
    state = {"q": crank["home_q"], "v_independent": [1.0], "tau": [0.1, 0.0, 0.0]}
    for names in ([], ["crank"], ["rod"], ["slider"], ["crank", "rod"], ["rod", "slider"]):
        document = {"mechanism": without_mass(crank, *names), "states": [state]}
        where = f"slider-crank, massless: {' '.join(names) or 'all'}"
        if names:
            score.right_or_refused(where, lambda d=document: find_oracle_error(shop, d))
        else:
            score.must_be_refused(where, lambda d=document: shop.evaluate(d))
    floating = float_hexapod(read_hexapod(), 1.0, 0.0)
    floating["mechanism"] = without_mass(floating["mechanism"])
    score.must_be_refused("hexapod, nothing has mass", lambda: shop.evaluate(floating))
    score.must_be_refused("hexapod, legs of mass 0", lambda: build_hexapod(shop, leg=0.0))
    still = without_mass(benchmarks.slider_crank())

    def start_massless():
        start = "[initial.joints.crank]\nrate = 1.0"
        return move(shop.own(still, FIXED_BASE, start, OUTPUTS), [0.1], names=RING)

    score.must_be_refused("slider-crank of no mass in an FMU", start_massless)


# ------------------------------------------------------------------------------------------------
# 2. Stiffness, damping, friction speed.
def run_hexapod_stiffness(shop, score, quick):
    """Item 2: legs from soft to rigid, undamped to ten times critical."""
    light = 8.0 / 1.0  # kg, what a leg end feels of the ring at least
    for power in (2, 6, 10) if quick else range(2, 11):
        stiffness = 10.0**power
        for ratio in (0.0, 0.1, 10.0) if not quick else (0.0, 10.0):
            damping = 2 * ratio * math.sqrt(stiffness * light / 6)
            fastest = math.sqrt(6 * stiffness / light) * max(1.0, 2 * ratio)
            span = min(2.0, (10.0 if quick else 60.0) / fastest)
            case = {"stiffness": stiffness, "damping": damping}
            fmu = build_hexapod(shop, rtol=1e-12, **case)
            score.right_or_refused(
                f"{stiffness:.0e} N/m, {ratio:g} of critical",
                lambda fmu=fmu, span=span, case=case: find_pose_error(fmu, span, **case),
            )


BUMPER_CHASER = """
[chaser]
motion = "free"
mass = 2000
inertia = [2000, 2000, 2000, 0, 0, 0]

[target]
motion = "fixed"
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]

[initial]
at = "first_contact"
approach_time = 0.01
closing_speed = 0.05
"""
BUMPER_OUTPUTS = '[outputs]\ngroups = ["relative", "capture", "contact", "phase", "ring", "states",'
BUMPER_OUTPUTS += ' "energy", "solver"]'
NODES, TOE = 48, 1e-6  # contacts of both faces together; m over which their stiffness builds up


def bumper(stiffness, damping, wall, preload=0.0, *, rest=0.0, home=0.0):
    """A ring of 20 kg on a slide along the docking axis; only ring faces meet."""
    return {
        "name": "bumper",
        "bodies": [
            {
                "name": "ring",
                "parent": "base",
                "joint": {"type": "prismatic", "axis": [1, 0, 0]},
                "mass": 20.0,
                "inertia": np.diag([1.0, 1.0, 1.0]).tolist(),
            }
        ],
        "forces": [
            {
                "type": "joint_spring_damper",
                "joint": "ring",
                "stiffness": stiffness,
                "damping": damping,
                "rest": rest,
                "preload": preload,
            }
        ],
        "home_q": [home],
        "capture": {"body": "ring"},
        "contact": {
            "type": "guide_ring",
            "core_x": -0.01, "core_inner_radius": 0.617, "core_outer_radius": 0.647,
            "ring_rounding": 0.01, "node_count": NODES // 2, "node_radius": 0.632,
            "node_azimuth_offset_deg": 3.75, "petal_count": 0, "petal_rounding": 0.012,
            "petal_base_x": -0.01, "petal_base_radius": 0.585, "petal_base_half_angle_deg": 28,
            "petal_tip_x": 0.228, "petal_tip_distance": 0.415, "petal_tip_half_width": 0.05,
            "law": {
                "stiffness": wall, "node_stiffness": wall / NODES, "toe": TOE, "damping": 5.0,
                "regularisation": 1e-12, "friction_coefficient": 0.0,
            },
        },
    }  # fmt: skip


BUMPER_NAMES = ["chaser.position[1]", "state.q[1]", "chaser.velocity[1]", "state.v[1]"]
# Published with B6: stiffness, damping, wall, end; peak force, speed of the vehicle at the end.
BUMPER_PUBLISHED = {
    "compliant": ((5e4, 300.0, 1e7, 0.9), 729.5538, -0.0471709207),
    "stiff": ((1e7, 1e4, 1e8, 0.09), 6452.645, -0.0450805382),
}


def run_bumper(shop, stiffness, damping, wall, span):
    """End state of FMU and of reference: positions from the start, speeds; and the peak force."""
    fmu = shop.own(bumper(stiffness, damping, wall), BUMPER_CHASER, BUMPER_OUTPUTS, rtol=1e-11)
    rows = move(fmu, [span], names=[*BUMPER_NAMES, "capture.peak.compression"])
    x, q, v, w, peak = rows[-1]
    ours = np.array([x - rows[0][0] - 5e-4, x - rows[0][0] - 5e-4 + q, v, v + w])
    model = Bumper((2000.0, 20.0), (stiffness, damping), (wall, TOE, 5.0))
    return ours, peak, model


def run_published_bumper(shop, score, _quick):
    """Item 2: the two published captures; they were computed with a wall without a toe."""
    for name, (case, peak, speed) in BUMPER_PUBLISHED.items():
        ours, our_peak, _ = run_bumper(shop, *case)
        score.compare(abs(our_peak / peak - 1.0), f"{name}, peak force")
        score.compare(abs(ours[2] - speed) / 0.05, f"{name}, speed of the vehicle")


def run_bumper_stiffness(shop, score, quick):
    """Item 2: spring and wall from soft to rigid, undamped to ten times critical."""
    for power in (2, 6, 10) if quick else range(2, 11):
        stiffness = 10.0**power
        for ratio in (0.0, 10.0) if quick else (0.0, 0.1, 1.0, 10.0):
            damping = 2 * ratio * math.sqrt(stiffness * 20.0)
            fastest = math.sqrt((stiffness + 1e7) / 20.0) * max(1.0, 2 * ratio)
            span = 0.01 + min(0.05, (30.0 if quick else 100.0) / fastest)

            def find_error(stiffness=stiffness, damping=damping, span=span):
                ours, _, model = run_bumper(shop, stiffness, damping, 1e7, span)
                states = model.run((-5e-4, -5e-4, 0.05, 0.05), span, 1)
                scale = np.array((5e-4, 5e-4, 0.05, 0.05))
                return np.max(np.abs(ours - states[-1]) / scale)

            score.right_or_refused(f"{stiffness:.0e} N/m, {ratio:g} of critical", find_error)


SLIDER = """
[chaser]
motion = "fixed"
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]

[target]
motion = "fixed"
mass = 1000
inertia = [1000, 1000, 1000, 0, 0, 0]

[initial]
at = "start"
"""


def run_friction_speed(shop, score, quick):
    """Item 2: a ring slides on the other until friction stops it, then creeps."""
    mass, load, friction, start, wall = 20.0, 100.0, 0.1, 0.01, 1e7
    slowing, span = friction * load / mass, 0.022
    mechanism = bumper(0.0, 0.0, wall, load)
    carriage = {
        "name": "carriage",
        "parent": "base",
        "joint": {"type": "prismatic", "axis": [0, 1, 0]},
    }
    mechanism["bodies"].insert(0, carriage)
    mechanism["bodies"][1]["parent"] = "carriage"
    mechanism["home_q"] = [0.0, load / wall + TOE / 2]
    law = mechanism["contact"]["law"]
    joints = f"[initial.joints.carriage]\nrate = {start}"
    for power in (-2, -5, -7) if quick else range(-2, -8, -1):
        slip = 10.0**power
        law |= {"friction_coefficient": friction, "friction_speed": slip}

        def path(v, slip=slip):
            # Integrals of dt and dy from v' = -slowing v/sqrt(v^2 + slip^2).
            root = math.hypot(v, slip)
            ratio = math.asinh(v / slip)
            return root - slip * math.asinh(slip / v), 0.5 * (v * root + slip**2 * ratio)

        low, high = math.log(start) - slowing * span / slip - 5.0, math.log(start)
        low = max(low, -700.0)
        for _ in range(200):
            middle = 0.5 * (low + high)
            late = path(start)[0] - path(math.exp(middle))[0] > slowing * span
            low, high = (middle, high) if late else (low, middle)
        speed = math.exp(high)
        way = (path(start)[1] - path(speed)[1]) / slowing

        def find_error(speed=speed, way=way):
            fmu = shop.own(mechanism, SLIDER, joints, BUMPER_OUTPUTS, rtol=1e-9)
            end = move(fmu, [span], names=["state.q[1]", "state.v[1]"])[-1]
            return max(abs(end[0] - way) / way, abs(end[1] - speed) / start)

        score.right_or_refused(f"{slip:.0e} m/s", find_error)


# ------------------------------------------------------------------------------------------------
# 3. Near-singular closures.
def swing(k, angle, rate, times):
    """Angle and rate of p'' = k sin p at some times."""
    y, t, rows = np.array([angle, rate]), 0.0, []
    for time in times:
        y = integrate(lambda y: np.array([y[1], k * math.sin(y[0])]), y, time - t, tolerance=1e-14)
        t = time
        rows.append(y)
    return np.array(rows)


def find_four_bars_constant(count):
    """Factor k of p'' = k sin p, the motion of a chain of four-bars as a parallelogram."""
    return GRAVITY * (3 * count + 1) / 2 / ((4 * count + 1) / 3)


DOWN_Y = {"gravity[2]": -GRAVITY}
TIP = ["ring.position[1]", "ring.position[2]"]
UPRIGHT = ["state.q[1]", "state.v[1]", "state.a[1]", "solver.singularity_margin", *TIP]


def run_four_bars(shop, score, quick):
    """Item 3: through the pose in which all bars lie on one line, in steps of several sizes."""
    span = 2.0 if quick else 10.0
    for count in (1, 2, 5) if quick else (1, 2, 5, 10, 40):
        start = "[initial.joints.upright0]\nrate = 1.0"
        rtol = 1e-10 if count > 10 else 1e-11
        fmu = shop.own(benchmarks.four_bars(count), FIXED_BASE, start, OUTPUTS, rtol=rtol)
        for size in (0.1, 0.0371, 0.5):
            times = size * np.arange(1, int(span / size) + 1)
            exact = swing(find_four_bars_constant(count), 0.0, 1.0, times)[:, 0]

            def find_error(fmu=fmu, times=times, exact=exact):
                tip = move(fmu, times, settings=DOWN_Y, names=TIP)[1:]
                return np.max(np.abs(tip - np.stack((np.sin(exact), np.cos(exact)), 1)))

            score.right_or_refused(f"{count} four-bars, steps of {size:g} s", find_error)


def run_singular_starts(shop, score, quick):
    """Item 3: starts in that pose and ever closer to it, at rest and turning."""
    margins = {}
    powers = (1, 3, 5, 7, 10, 16) if quick else range(1, 17)
    for power in powers:
        distance = 0.0 if power == 16 else 10.0**-power
        for rate in (0.0, 1.0):
            angle = math.pi / 2 - distance
            start = f"[initial.joints.upright0]\nposition = {angle!r}\nrate = {rate}"
            where = f"{distance:.0e} rad from singular, {rate:g} rad/s"

            def find_error(angle=angle, rate=rate, start=start, distance=distance):
                fmu = shop.own(benchmarks.four_bars(1), FIXED_BASE, start, OUTPUTS)
                times = (0.1, 0.3)
                rows = move(fmu, times, settings=DOWN_Y, names=UPRIGHT)
                margins[f"{distance:.0e}"] = float(rows[0][3])
                exact = swing(find_four_bars_constant(1), angle, rate, times)[:, 0]
                way = max(1e-3, np.max(np.abs(exact - angle)))
                tip = rows[1:, 4:] - np.stack((np.sin(exact), np.cos(exact)), 1)
                return np.max(np.abs(tip)) / way

            if distance:
                score.right_or_refused(where, find_error)
            else:
                score.must_be_refused(where, find_error)
    score.notes["singularity margin by distance"] = margins


def run_hexapod_poses(shop, score, quick):
    """Item 3: hexapod nearly flat and nearly turned by 90 deg, where its legs lose their grip."""
    document = read_hexapod()
    body = next(b for b in document["mechanism"]["bodies"] if b["joint"]["type"] == "free")
    height = np.array(body["joint"]["position"])
    axis = height / np.linalg.norm(height)
    conditions = {}
    template = document["states"][0]
    mechanism = document["mechanism"] | {"home_q": document["home_q"]}
    for power in (1, 4, 8, 16) if quick else range(1, 17):
        small = 0.0 if power == 16 else 10.0**-power
        for name in ("flat", "turned"):
            turn = math.pi / 2 - small if name == "turned" else 0.0
            lift = height * (small - 1.0) if name == "flat" else np.zeros(3)
            pose = [*lift, math.cos(turn / 2), *(math.sin(turn / 2) * axis)]
            state = template | {"q": [*pose, *template["q"][7:]]}
            where = f"{name} but for {small:.0e}"

            def find_error(state=state, where=where, pose=pose):
                results, file = shop.evaluate({"mechanism": mechanism, "states": [state]})
                m = Mechanism(mechanism)
                follow_core(m, file)
                q, _ = close_states(m, np.array([state["q"]]), steps=32)
                conditions[where] = find_grip(mechanism, pose)
                errors = find_errors(results, solve(m, [state], q))
                return max(*errors.values(), find_gap(m, results))

            score.right_or_refused(where, find_error)
    score.notes["condition number of the six leg lines"] = conditions


def find_grip(mechanism, pose):
    """Condition number of the lines of the legs as forces and moments on the ring."""
    rotation = find_rotations(np.array(pose[3:]))
    body = next(b for b in mechanism["bodies"] if b["joint"]["type"] == "free")
    centre = np.array(body["joint"]["position"]) + pose[:3]
    first = {b["name"]: b for b in mechanism["bodies"]}
    lines = []
    for loop in mechanism["loops"]:
        arm = rotation @ loop["cut"]["point_on_closing"]
        line = centre + arm - np.array(first[loop["first"]]["joint"]["position"])
        line /= np.linalg.norm(line)
        lines.append([*line, *np.cross(arm, line)])
    return float(np.linalg.cond(lines))


# ------------------------------------------------------------------------------------------------
# 4. Redundant constraints.
# Overconstrained 6R at 2 s, by quadrature of the energy: hinge 3.
BRICARD_TIME, BRICARD_HINGE = 2.0, (-0.77813537303329089, -0.98035268344325656, -0.1972526706171706)


def run_bricard(shop, score, _quick):
    """Item 4: six ways to cut the overconstrained 6R, each without and with a redundant row."""
    names = [*RING, *(f"ring.attitude[{i}]" for i in (1, 2, 3, 4))]
    for kind in ("R2", "R1"):
        for cut in range(1, 7):
            fmu = shop.own(benchmarks.bricard(cut, kind), FIXED_BASE, OUTPUTS, rtol=1e-12)

            def find_error(fmu=fmu, cut=cut):
                end = move(fmu, [BRICARD_TIME], settings=DOWN_Y, names=names)[-1]
                other = find_rotations(end[3:]) @ [0.0, -1.0, 0.0]
                return np.max(np.abs(end[:3] + (cut > 2) * other - BRICARD_HINGE))

            score.right_or_refused(f"hinge {cut} cut as {kind}", find_error)


def many_uprights(count, spare):
    """A rigid beam on `count` parallel uprights: every one beyond the second is redundant.

    Args:
        count: of uprights, 1 m apart.
        spare: which body the redundant loops list next to their own upright.
    """
    backwards, bar = [0, 0, -1], (1.0, (0, 0.5), 1 / 12)
    bodies = [benchmarks.planar_body("upright0", "base", (0, 0), bar, backwards)]
    beam = (1.0, (0.5, 0), 1 / 12)
    bodies.append(benchmarks.planar_body("beam", "upright0", (0, 1), beam, backwards))
    loops = []
    for i in range(1, count):
        name = f"upright{i}"
        bodies.append(benchmarks.planar_body(name, "base", (i, 0), bar, backwards))
        dependent = [name, "beam" if i == 1 else spare]
        branch = ("upright0", "beam")
        points = ((i, 0), (0, 1))
        loops.append(benchmarks.planar_loop(f"pin{i}", branch, name, dependent, points))
    return {"name": "uprights", "bodies": bodies, "loops": loops, "capture": {"body": "beam"}}


def run_duplicates(shop, score, _quick):
    """Item 4: uprights that only repeat what others say; the core says which is independent."""
    for count in (2, 3, 4):
        for spare in ("upright0", "beam") if count > 2 else ("beam",):
            mechanism = many_uprights(count, spare)
            free = shop.check({"mechanism": mechanism})["independent"][0]
            start = f"[initial.joints.{free}]\nposition = 0.2\nrate = 1.0"
            k = GRAVITY * (count / 2 + 1) / (count / 3 + 1)

            def find_error(mechanism=mechanism, start=start, k=k):
                fmu = shop.own(mechanism, FIXED_BASE, start, OUTPUTS)
                times = (0.2, 0.4)
                tip = move(fmu, times, settings=DOWN_Y, names=TIP)[1:]
                p = swing(k, 0.2, 1.0, times)[:, 0]
                return np.max(np.abs(tip - np.stack((np.sin(p), np.cos(p)), 1)))

            score.right_or_refused(f"{count} uprights, {spare} listed again", find_error)


# ------------------------------------------------------------------------------------------------
# 10. Scales that are powers of two change no digit.
def scale_andrews(length, mass, time):
    """Squeezing mechanism in other units of length, mass and time."""
    m = benchmarks.andrews()
    for body in m["bodies"]:
        body["mass"] = body.get("mass", 0.0) * mass
        body["com"] = [x * length for x in body.get("com", (0, 0, 0))]
        inertia = np.array(body.get("inertia", np.zeros((3, 3))))
        body["inertia"] = (inertia * (mass * length**2)).tolist()
        body["joint"]["position"] = [x * length for x in body["joint"]["position"]]
    for loop in m["loops"]:
        for end in ("point_on_terminal", "point_on_closing"):
            loop["cut"][end] = [x * length for x in loop["cut"][end]]
    spring, torque = m["forces"]
    spring["stiffness"] *= mass / time**2
    spring["rest"] *= length
    torque["preload"] *= mass * length**2 / time**2
    m["home_q"][8] *= length
    return m


def run_andrews(shop, length, mass, time):
    """Figures of the scaled mechanism at 0, 0.015 and 0.03 s, in the units of the plain one."""
    rtol, span = 1e-9, 0.03
    fmu = shop.own(scale_andrews(length, mass, time), FIXED_BASE, OUTPUTS, rtol=rtol)
    settings = {
        "solver.atol_velocity": rtol / 10 / time,
        "solver.atol_energy": rtol / 10 * mass * length**2 / time**2,
    }
    names = ["state.q[1]", "state.v[1]", "state.a[1]", "loop[1].force[1]", "ring.position[1]"]
    rows = move(fmu, [span / 2 * time, span * time], settings=settings, names=names)
    return rows / [1.0, 1 / time, 1 / time**2, mass * length / time**2, length]


def run_scales(shop, score, quick):
    """Item 10: every figure has the same digits after 0.03 s."""
    plain = run_andrews(shop, 1.0, 1.0, 1.0)
    powers = (-20, 20) if quick else (-40, -20, -3, 3, 20, 40)
    cases = {
        f"{name} times 2^{power * (2 if name == 'mass' else 1)}": [
            2.0 ** (power * (i == 0)), 4.0 ** (power * (i == 1)), 2.0 ** (power * (i == 2)),
        ]
        for i, name in enumerate(("length", "mass", "time"))
        for power in powers
    }  # fmt: skip
    cases["all three, times 2^7, 2^-10, 2^5"] = [2.0**7, 2.0**-10, 2.0**5]
    for where, units in cases.items():
        score.right_or_refused(
            where, lambda units=units: np.max(np.abs(run_andrews(shop, *units) - plain))
        )


def run_odd_masses(shop, score, quick):
    """Item 10: a mass unit of an odd power meets square roots of 2; figures at the start."""
    plain = run_andrews(shop, 1.0, 1.0, 1.0)[0]
    there = plain != 0.0
    for power in (-9, 9) if quick else range(-19, 20, 2):

        def find_error(power=power):
            ours = run_andrews(shop, 1.0, 2.0**power, 1.0)[0]
            return np.max(np.abs(ours[there] / plain[there] - 1.0))

        score.right_or_refused(f"mass times 2^{power}", find_error)


# ------------------------------------------------------------------------------------------------
# 12. A common rotation and drift change no relative motion.
def run_frames(shop, score, quick):
    """Item 12: the free-floating hexapod far away, fast and turned."""
    fmu = build_hexapod(shop)
    span = 2.0
    names = [*RING, *(f"ring.attitude[{i}]" for i in (1, 2, 3, 4))]
    times = (span / 2, span)
    plain = move(fmu, times, names=names)
    way = np.max(np.abs(plain[-1] - plain[0])[:3])
    half = 0.5 * 1.1
    turns = {"": (1.0, 0.0, 0.0, 0.0), ", turned": (math.cos(half), 0.0, 0.6 * math.sin(half),
             0.8 * math.sin(half))}  # fmt: skip
    distances = (0.0, 1e3, 7e6) if quick else (0.0, 1e3, 7e6, 1e9, 1e12)
    speeds = (0.0, 7.5e3) if quick else (0.0, 1.0, 7.5e3, 1e6)
    for distance in distances:
        for speed in speeds:
            for turned, q in turns.items():
                rotation = find_rotations(np.array(q))
                velocity = rotation @ BASE_VELOCITY + speed * np.array([0.48, -0.6, 0.64])
                settings = {
                    **{f"chaser.position[{i}]": distance * x
                       for i, x in enumerate((0.6, 0.64, -0.48), 1)},
                    **{f"chaser.velocity[{i}]": x for i, x in enumerate(velocity, 1)},
                    **{f"chaser.attitude[{i}]": x for i, x in enumerate(q, 1)},
                }  # fmt: skip

                def find_error(settings=settings):
                    rows = move(fmu, times, settings=settings, names=names)
                    return np.max(np.abs(rows - plain)) / way

                where = f"{distance:.0e} m, {speed:.1e} m/s{turned}"
                score.right_or_refused(where, find_error)


PARTS = [
    Part(1, "body/ring 1e0 to 1e8, leg/ring 1e0 to 1e-9, motion over 2 s [3 + 3 values, 0.5 s]",
         "free-floating hexapod by Kane's equations", "of the way", 1e-8, run_hexapod_masses),
    Part(1, "both ratios together, leg/ring also 0 [12 of 99]",
         "dense system in absolute coordinates", "relative", 1e-9, run_absolute_masses),
    Part(1, "bodies without mass", "dense system; nothing regular is left: a refusal", "relative",
         1e-11, run_massless),
    Part(2, "leg stiffness 1e2 to 1e10 N/m, damping 0 to 10 times critical [6 of 27]",
         "free-floating hexapod by Kane's equations", "of the way", 1e-7, run_hexapod_stiffness),
    Part(2, "capture contact, compliant and stiff", "published, micro-steps", "relative", 1e-3,
         run_published_bumper),
    Part(2, "interface stiffness 1e2 to 1e10 N/m, damping 0 to 10 times critical [6 of 36]",
         "two masses and a wall, Runge-Kutta steps", "relative", 1e-6, run_bumper_stiffness),
    Part(2, "regularised friction speed 1e-2 to 1e-7 m/s, until it creeps [3 of 6]",
         "closed form of sliding to rest", "relative", 1e-6, run_friction_speed),
    Part(3, "1 to 40 four-bars, ten singular poses, steps 0.0371, 0.1, 0.5 s [1 to 5, two poses]",
         "exact parallelogram", "m of 1 m", 1e-6, run_four_bars),
    Part(3, "start 0.1 rad to 1e-15 rad from the singular pose, and in it [6 of 16]",
         "exact parallelogram; in the pose: a refusal", "of the way", 1e-6, run_singular_starts),
    Part(3, "hexapod flat or turned by 90 deg, but for 1e-1 to 1e-15, and exactly [4 of 16]",
         "dense system in absolute coordinates", "relative", 1e-9, run_hexapod_poses),
    Part(4, "overconstrained 6R, each hinge cut, as universal and as hinge, 2 s",
         "quadrature of the energy", "m of 1 m", 1e-10, run_bricard),
    Part(4, "beam on 2 to 4 parallel uprights", "exact parallelogram", "m of 1 m", 1e-9,
         run_duplicates),
    Part(10, "squeezing mechanism, length and time times 2^-40 to 2^40, mass 4^-40 to 4^40 [half]",
         "itself, unscaled: the same digits", "of any figure", 0.0, run_scales),
    Part(10, "mass times odd powers of 2, start of the motion", "itself, unscaled", "relative",
         4.5e-16, run_odd_masses),
    Part(12, "0 to 1e12 m away, drift 0 to 1e6 m/s, as it is and turned [to 7e6 m, 7.5e3 m/s]",
         "itself at the origin", "of the way", 1e-9, run_frames),
]  # fmt: skip
