"""What must come out of the families of mechanisms: expectations and results of short runs.

Part of the study families.py.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

import dockloop as dl
from dockloop.scene.values import as_setting

ACCURACY = 1e-3
ALIGNED = {
    "initial.approach_time": 0.2,
    "initial.lateral_offset": 0.0,
    "initial.pitch_yaw_deg": 0.0,
    "initial.roll_deg": 0.0,
}
STANDARD_CASES = {  # of the shipped sweeps contact_cases_*, but for one direction
    "central": {},
    "with roll": {"initial.roll_deg": 4.0},
    "guides on guides": {"initial.lateral_offset": 0.10, "initial.lateral_direction_deg": 0.0},
    "guides on ring": {"initial.lateral_offset": 0.30, "initial.lateral_direction_deg": 60.0},
    "ring on ring": {"initial.pitch_yaw_deg": 4.0, "initial.pitch_yaw_direction_deg": 90.0},
}
DIFFERENCES, TILTS, DRIVE = (1, 2, 3), (4, 5, 6), 7  # elements of apda
BRAKES = {f"element[{i}].law[3].engagement": 0.0 for i in DIFFERENCES}  # open
NO_DRIVE_BRAKE = {"failure[1].active": True}
Values = Mapping[str, Any]


class Row(NamedTuple):
    """An expectation and what came out.

    Attributes:
        case: name.
        expected: in words.
        found: in numbers.
        agrees: whether it is as expected.
        why: if not.
        command: shows it.
    """

    case: str
    expected: str
    found: str
    agrees: bool
    why: str
    command: str


class Order(NamedTuple):
    """A docking: scene, keys of the scene, start values, end [s]."""

    scene: str
    keys: Values
    values: Values = MappingProxyType({})
    stop: float = 8.0

    def run(self, step: float = 0.02) -> dl.Result:
        """Run it."""
        return dl.run(
            self.scene, self.keys, self.values, stop=self.stop, step=step, accuracy=ACCURACY
        )

    def write_command(self) -> str:
        """Return the command that runs it."""
        keys = [f"--scene '{as_setting(name, value)}'" for name, value in self.keys.items()]
        values = [
            f"--set '{name}={str(value).lower()}'"
            for name, value in {"accuracy": ACCURACY, **self.values}.items()
        ]
        return " ".join(["dockloop run", self.scene, *keys, *values, f"--stop {self.stop:g}"])


def meet(case: str, speed: float = 0.10, values: Values | None = None, stop: float = 8.0) -> Order:
    """Return a standard case of the differential unit."""
    keys = ALIGNED | STANDARD_CASES[case] | {"initial.closing_speed": speed}
    return Order("apda", keys, values or {}, stop)


def find_travel(run: dl.Result, elements: tuple[int, ...]) -> float:
    """Return the largest travel of some elements [mm]."""
    return 1e3 * max(float(np.max(np.abs(run[f"element[{i}].coordinate"]))) for i in elements)


def find_roll(run: dl.Result) -> np.ndarray:
    """Return the roll of the target against the ring [deg], shape (points,)."""
    w, x, y, z = run.vector("ring.attitude").T
    v, p, q, r = run.vector("relative.attitude").T
    about, left = w * p - x * v - y * r + z * q, w * v + x * p + y * q + z * r
    return 2 * np.degrees(np.arctan2(about, left))


def find_return(run: dl.Result) -> float:
    """Return the largest speed at which the vehicles part, of the closing speed."""
    rate = run["relative.velocity[1]"]
    return float(np.max(rate) / -rate[0])


def find_tilt(run: dl.Result) -> float:
    """Return the largest tilt of the ring against A [deg]."""
    _, _, y, z = run.vector("ring.attitude").T
    return float(np.max(2 * np.degrees(np.hypot(y, z))))


def find_duration(run: dl.Result) -> float:
    """Return the time from first contact to capture [s], infinite without capture."""
    if not run["captured"][-1]:
        return np.inf
    return float(run["time_of_capture"][-1] - run["time_of_contact"][-1])


def find_least_speed(
    order: Order, low: float = 0.001, high: float = 0.2, halvings: int = 8
) -> float:
    """Return the least closing speed that leads to capture [m/s]; infinite if none does."""

    def captures(speed: float) -> bool:
        keys = {**order.keys, "initial.closing_speed": speed}
        return bool(order._replace(keys=keys).run(0.5)["captured"][-1])

    if not captures(high):
        return np.inf
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if captures(middle) else (middle, high)
    return high


def find_missed(table: Any) -> float:
    """Return the share of dockings of a sweep that are not captured."""
    return 1.0 - float(np.mean(table["outcome"].isin(("captured", "docked"))))


def write_share(run: dl.Result, name: str) -> str:
    """Return what one kind of loss took."""
    return f"{run['energy.dissipated_' + name][-1]:.0f} J"


# ------------------------------------------------ rings


def central() -> list[Row]:
    """A central impact at four speeds, then with softer springs and less inertia."""
    speeds = (0.03, 0.05, 0.10, 0.15)
    orders = [meet("central", v, stop=4.0) for v in speeds]
    runs = [order.run() for order in orders]
    peaks = [float(run["capture.peak.compression"][-1]) for run in runs]
    waits = [find_duration(run) for run in runs]
    document = dl.Scene("apda").document["mechanism"]
    lighter = {
        f"mechanism.set.bodies.{body['name']}.inertia": (np.array(body["inertia"]) / 2).tolist()
        for body in document["bodies"]
        if body["name"].endswith(("nut", "sum", "difference")) or "drive" in body["name"]
    }
    softer = {
        f"mechanism.set.forces.{force['name']}.laws.1.stages": [
            [start, stiffness / 2] for start, stiffness in force["laws"][0]["stages"]
        ]
        for force in document["forces"]
        if force["laws"][0]["type"] == "spring"
    }
    undamped = {"mechanism.set.forces.drive.laws.1.linear": 0.0}
    order = orders[2]
    changed = []
    for change in (softer, lighter, undamped, {**softer, **lighter, **undamped}):
        other = order._replace(keys={**order.keys, **change})
        changed.append(1 - float(other.run()["capture.peak.compression"][-1]) / peaks[2])
    soft, light, loose, all_ = (f"{100 * part:.0f} %" for part in changed)
    return [
        Row(
            "central impact",
            "captured at any speed; the peak rises with the speed",
            f"captured after {waits[0]:.2f} to {waits[-1]:.2f} s; compression "
            + ", ".join(f"{peak:.0f}" for peak in peaks)
            + " N at "
            + ", ".join(f"{v:g}" for v in speeds)
            + " m/s",
            bool(max(waits) < np.inf and np.all(np.diff(peaks) > 0)),
            "",
            orders[2].write_command(),
        ),
        Row(
            "central impact, softer and lighter",
            "softer springs and half of the spinning inertia lower the peak markedly (above 10 %)",
            f"springs {soft}, inertia {light}, no damper on the drive {loose}, all {all_} less",
            changed[0] + changed[1] > 0.10,
            "on the axis all springs of the unit are at rest: only damper, brake and inertia of the"
            " drive act, and the stiffness of the contact"
            " ([case A](published.md#a-central-impact-on-a-screw-driven-ring) has springs there)",
            order._replace(keys={**order.keys, **undamped}).write_command(),
        ),
    ]


def roll() -> list[Row]:
    """Impact with roll."""
    order = meet("with roll", stop=30.0)
    run, plain = order.run(0.05), meet("central", stop=30.0).run(0.05)
    play = max(abs(x) for x in dl.check("apda")["seated_play"]["roll_deg"])
    late = run["time"] > run["time_of_capture"][-1] + 5.0
    left = float(np.max(np.abs(find_roll(run)[late])))
    opening = 1e3 * max(float(np.max(run[f"latch[{i}].opening"][late])) for i in (1, 2, 3))
    travel, other = find_travel(run, DIFFERENCES), find_travel(plain, DIFFERENCES)
    torsion, less = (float(r["capture.peak.torsion"][-1]) for r in (run, plain))
    return [
        Row(
            "impact with roll",
            "torsion; the differences take it; the roll stays within the play when latched",
            f"torsion {torsion:.0f} N m (central {less:.0f}); differences {travel:.1f} mm"
            f" (central {other:.1f}); later roll up to {left:.2f} deg,"
            f" play of seated rings {play:.2f} deg; latches open up to {opening:.1f} mm",
            bool(run["captured"][-1]) and torsion > less and travel > other and left < play,
            "latches hold the rings apart by up to their play, where petals leave more room than"
            " between seated rings",
            order.write_command(),
        )
    ]


def guides_on_guides() -> list[Row]:
    """Lateral offset: shafts that move, and a brake that is stronger on its return."""
    order = meet("guides on guides")
    run, plain = order.run(), meet("central").run()
    before = run["time"] <= run["time_of_capture"][-1]
    travel = [
        1e3 * max(float(np.max(np.abs(run[f"element[{i}].coordinate"][before]))) for i in part)
        for part in (DIFFERENCES, TILTS, (DRIVE,))
    ]
    weak = {f"element[{i}].law[3].back": 40.0 for i in DIFFERENCES}
    strong = {f"element[{i}].law[3].back": 400.0 for i in DIFFERENCES}
    swings = []
    for values in (weak, {}, strong):
        other = meet("guides on guides", values=values, stop=20.0).run(0.05)
        lateral = other["relative.lateral"]
        late = other["time"] > other["time_of_capture"][-1]
        swings.append(1e3 * float(np.ptp(lateral[late])))
    return [
        Row(
            "guides on guides",
            "until capture, differences and tilts move, the drive hardly",
            f"differences {travel[0]:.1f} mm, tilts {travel[1]:.1f} mm, drive {travel[2]:.1f} mm;"
            f" drive after the capture {find_travel(run, (DRIVE,)):.0f} mm"
            f" (central {find_travel(plain, (DRIVE,)):.0f} mm)",
            travel[2] < 0.1 * max(travel[:2]),
            "as soon as the rings meet, the closing speed moves the drive, with or without offset",
            order.write_command(),
        ),
        Row(
            "brake of the differences stronger on its return",
            "less rebound: the vehicles swing less sideways after capture",
            "lateral swing " + ", ".join(f"{x:.1f}" for x in swings) + " mm for 40, 120, 400 N",
            swings[0] >= swings[1] >= swings[2],
            "",
            meet("guides on guides", values=strong, stop=20.0).write_command(),
        ),
    ]


def guides_on_ring() -> list[Row]:
    """Petal tips on the other ring."""
    orders = {name: meet(name, stop=20.0) for name in STANDARD_CASES}
    runs = {name: order.run(0.05) for name, order in orders.items()}
    waits = {name: find_duration(run) for name, run in runs.items()}
    tilts = {name: find_tilt(run) for name, run in runs.items()}
    case, other = "guides on ring", "guides on guides"
    keys = orders[case].keys | {"initial.lateral_direction_deg": 0.0}
    missed = orders[case]._replace(keys=keys).run(0.05).summary["outcome"]
    return [
        Row(
            case,
            f"more tilt than {other}; longest time to capture",
            f"tilt {tilts[case]:.1f} deg, {other} {tilts[other]:.1f} deg; time to capture "
            + ", ".join(f"{name} {wait:.2f} s" for name, wait in waits.items())
            + f"; with the offset towards a petal of the ring: {missed} after 20 s",
            tilts[case] > tilts[other] and waits[case] == max(waits.values()),
            "",
            orders[case].write_command(),
        )
    ]


def friction() -> list[Row]:
    """Share of dockings without capture over the friction."""
    coefficients = [0.0, 0.1, 0.3, 0.5, 0.8]
    table = dl.sweep(
        {
            "scene": "apda",
            "seed": 1,
            "cases": 32,
            "set": {
                "initial.approach_time": 0.2,
                "initial.closing_speed": 0.05,
                "accuracy": ACCURACY,
            },
            "vary": [
                {"type": "grid", "name": "friction.coefficient", "values": coefficients},
                {
                    "type": "disc",
                    "magnitude": "initial.lateral_offset",
                    "direction": "initial.lateral_direction_deg",
                    "range": [0.0, 0.10],
                },
                {
                    "type": "disc",
                    "magnitude": "initial.pitch_yaw_deg",
                    "direction": "initial.pitch_yaw_direction_deg",
                    "range": [0.0, 4.0],
                },
                {"type": "uniform", "name": "initial.roll_deg", "range": [-4.0, 4.0]},
            ],
            "experiment": {"stop": 25.0, "step": 0.5},
        }
    )
    groups = [table[table["friction.coefficient"] == mu] for mu in coefficients]
    missed = [find_missed(group) for group in groups]
    kinds = sorted(set(table["outcome"]) - {"captured", "docked"})
    return [
        Row(
            "friction",
            "more friction hinders capture or hangs up",
            "not captured "
            + ", ".join(
                f"{100 * m:.0f} % at {mu:g}" for m, mu in zip(missed, coefficients, strict=True)
            )
            + f" (0.05 m/s, IDSS box); outcomes then: {', '.join(kinds) or 'none'}",
            bool(np.all(np.diff(missed) >= 0) and missed[-1] > missed[0]),
            "",
            "dl.sweep in `tests/studies/family_trends.py`",
        )
    ]


def ring_on_ring() -> list[Row]:
    """Least speed of capture over thrust and its delay; rebound with and without brake."""
    keys = ALIGNED | STANDARD_CASES["ring on ring"]
    table = {}
    for thrust, delay in ((0.0, 0.0), (100.0, 0.3), (100.0, 0.5), (100.0, 2.0), (1000.0, 0.3)):
        values = {"chaser.contact_thrust": thrust, "chaser.contact_thrust_delay": delay}
        table[thrust, delay] = find_least_speed(Order("apda", keys, values, 30.0))
    least = {
        name: find_least_speed(Order("apda", ALIGNED | STANDARD_CASES[name], {}, 30.0))
        for name in ("central", "with roll", "guides on guides")
    }
    orders = [meet("ring on ring", values=values) for values in ({}, NO_DRIVE_BRAKE)]
    returns = [find_return(order.run()) for order in orders]
    return [
        Row(
            "ring on ring",
            "needs more axial speed than the other cases; thrust lowers the least speed, delay"
            " raises it",
            "least speed "
            + ", ".join(
                f"{1e3 * v:.1f} mm/s at {f:.0f} N after {d:g} s" for (f, d), v in table.items()
            )
            + "; without thrust "
            + ", ".join(f"{name} {1e3 * v:.1f} mm/s" for name, v in least.items()),
            table[0.0, 0.0] > max(least.values())
            and table[100.0, 0.3] < table[100.0, 0.5] < table[100.0, 2.0] < table[0.0, 0.0],
            "thrust and delay act as expected, but an impact with roll needs about the same speed",
            Order(
                "apda",
                keys | {"initial.closing_speed": 0.02},
                {"chaser.contact_thrust": 100.0, "chaser.contact_thrust_delay": 0.5},
                30.0,
            ).write_command(),
        ),
        Row(
            "brake of the drive",
            "removes the rebound",
            f"the vehicles part at {returns[0]:.3f} of the closing speed with the brake,"
            f" {returns[1]:.3f} without",
            returns[0] < 0.2 * returns[1],
            "springs of tilts and differences push the vehicles apart, which the brake of the drive"
            " does not hold; the drive itself has no spring",
            orders[1].write_command(),
        ),
    ]


def differential() -> list[Row]:
    """Travel of rods and shafts under combined offsets."""
    keys = ALIGNED | {
        "initial.closing_speed": 0.10,
        "initial.lateral_offset": 0.10,
        "initial.pitch_yaw_deg": 4.0,
        "initial.roll_deg": 4.0,
    }
    order = Order("apda", keys, stop=12.0)
    run = order.run(0.01)
    rods = 1e3 * max(
        float(np.max(np.abs(run[f"leg[{i}].length"] - run[f"leg[{i}].length"][0])))
        for i in range(1, 7)
    )
    shafts = [find_travel(run, part) for part in (DIFFERENCES, TILTS, (DRIVE,))]
    return [
        Row(
            "differential against independent legs",
            "combined offsets take more travel of a rod than of any shaft",
            f"rods {rods:.0f} mm; differences {shafts[0]:.0f} mm (stop 70), tilts {shafts[1]:.0f}"
            f" mm (stop 45), drive {shafts[2]:.0f} mm (stop 280); ranges:"
            " [case D](published.md#d-differential-unit-against-independent-legs)",
            rods > max(shafts),
            "",
            order.write_command(),
        )
    ]


def brakes_off() -> list[Row]:
    """All brakes off, and those of the differences only."""
    case, found = "guides on guides", []
    for values in ({}, BRAKES, BRAKES | NO_DRIVE_BRAKE):
        order = meet(case, values=values, stop=20.0)
        run = order.run(0.05)
        late = run["time"] > 15.0
        rate = np.linalg.norm(run.vector("relative.angular_velocity")[late], axis=1)
        found.append((find_return(run), 1e3 * float(np.max(rate)), write_share(run, "brakes")))
    returns, rates, _ = zip(*found, strict=True)
    return [
        Row(
            "brakes off",
            "all off: more rebound; those of the differences off: less damping of the tilt",
            "; ".join(
                f"{name}: parts at {r:.3f} of the closing speed, angular rate after 15 s {w:.2f}"
                f" mrad/s, brakes take {e}"
                for name, (r, w, e) in zip(
                    ("all on", "differences off", "all off"), found, strict=True
                )
            ),
            returns[2] > returns[0] and rates[1] > rates[0],
            "the axial return comes from springs behind eddy brakes, which stay on; the angular"
            " motion is damped less, as expected",
            meet(case, values=BRAKES, stop=20.0).write_command(),
        )
    ]


def jammed() -> list[Row]:
    """A jammed leg, or pair of rods."""
    rows = []
    keys = ALIGNED | {"initial.closing_speed": 0.10, "initial.pitch_yaw_deg": 4.0}
    keys |= {"initial.lateral_offset": 0.05}
    sides = [
        {"initial.lateral_direction_deg": d, "initial.pitch_yaw_direction_deg": d}
        for d in range(0, 360, 60)
    ]
    for scene, failure, what in (
        ("hexapod", 1, "leg 1 jammed"),
        ("apda", 2, "the rods of pair 1 jammed against each other"),
    ):
        orders = [
            Order(scene, keys, values) for values in ({}, {f"failure[{failure}].active": True})
        ]
        forces = []
        for order in orders:
            runs = [order._replace(keys=keys | side).run(0.01) for side in sides]
            forces.append(
                [
                    max(float(np.max(np.abs(run[f"leg[{i}].force"]))) for run in runs)
                    for i in range(1, 7)
                ]
            )
        growth = np.array(forces[1]) / np.array(forces[0])
        own = (0,) if scene == "hexapod" else (0, 1)
        near = (1, 5) if scene == "hexapod" else (2, 5)
        rows.append(
            Row(
                f"{scene}: {what}",
                "loads rise on the jammed rods and their two neighbours",
                "largest force of rods 1 to 6, misaligned to six sides: "
                + ", ".join(f"{f:.0f}" for f in forces[0])
                + " N free, "
                + ", ".join(f"{f:.0f}" for f in forces[1])
                + " N jammed",
                bool(np.all(growth[list(own)] > 1) and np.all(growth[list(near)] > 1)),
                "the load of one neighbour falls a little, that of rods farther away rises",
                orders[1].write_command(),
            )
        )
    return rows


def thrust_failures() -> list[Row]:
    """Slow dockings with thrust in time, late and missing."""
    shares = {}
    for name, thrust, delay in (
        ("in time", 1000.0, 0.3),
        ("late", 1000.0, 5.0),
        ("missing", 0.0, 0.0),
    ):
        table = dl.sweep(
            {
                "scene": "apda",
                "seed": 2,
                "cases": 32,
                "set": {
                    "initial.approach_time": 0.2,
                    "initial.closing_speed": 0.01,
                    "initial.pitch_yaw_deg": 4.0,
                    "chaser.contact_thrust": thrust,
                    "chaser.contact_thrust_delay": delay,
                    "accuracy": ACCURACY,
                },
                "vary": [
                    {
                        "type": "disc",
                        "magnitude": "initial.lateral_offset",
                        "direction": "initial.lateral_direction_deg",
                        "range": [0.0, 0.10],
                    },
                    {"type": "uniform", "name": "initial.roll_deg", "range": [-4.0, 4.0]},
                ],
                "experiment": {"stop": 30.0, "step": 0.5},
            }
        )
        shares[name] = find_missed(table)
    return [
        Row(
            "delayed or missing thrust",
            "more failures at the slow end",
            "not captured at 10 mm/s "
            + ", ".join(
                f"{100 * share:.0f} % with thrust {name}" for name, share in shares.items()
            ),
            shares["in time"] <= shares["late"] <= shares["missing"]
            and shares["missing"] > shares["in time"],
            "",
            "dl.sweep in `tests/studies/family_trends.py`; `dockloop sweep contact_cases_apda`",
        )
    ]


def stalled() -> list[Row]:
    """A jet during the retraction, with the drive as it is and with less force or more gain."""
    jet = {
        "vehicle": "chaser",
        "at": "retract",
        "time": 2.0,
        "duration": 150.0,
        "force": [-2500, 0, 0],
    }
    law = f"element[{DRIVE}].law[3]"
    keys = {"disturbance": [jet]}
    orders = {
        "no jet": Order("apda", {}, stop=180.0),
        "jet of 2500 N, as shipped": Order("apda", keys, stop=180.0),
        "jet, limit 300 N": Order("apda", keys, {f"{law}.limit": 300.0}, 180.0),
        "jet, limit 3000 N and ten times the gain": Order(
            "apda", keys, {f"{law}.gain": 1e6}, 180.0
        ),
    }
    found = {}
    for name, order in orders.items():
        run = order.run(0.5)
        load = np.abs(run[f"element[{DRIVE}].saturation"])[run["phase"] == 6]
        found[name] = (run.summary["outcome"], float(np.max(load)))
    shipped, weak = (found[name][0] for name in ("jet of 2500 N, as shipped", "jet, limit 300 N"))
    return [
        Row(
            "jet during retraction",
            "the drive reaches its limit and stalls",
            "; ".join(
                f"{name}: {o}, up to {100 * s:.0f} % of the limit" for name, (o, s) in found.items()
            ),
            shipped == weak == "retraction stalled",
            "at a standstill the drive pushes with gain times speed, which is less than its limit;"
            " so the step ends by its time-out, not by the condition on the limit",
            orders["jet of 2500 N, as shipped"].write_command(),
        )
    ]


# ------------------------------------------------ probe


def wedging() -> list[Row]:
    """Friction on the cone, pushed by a thrust."""
    coefficients = (0.2, 0.4, 0.5, 0.55, 0.6, 0.7)
    found = {}
    for mu in coefficients:
        keys = ALIGNED | {"initial.lateral_offset": 0.15, "initial.closing_speed": 0.05}
        values = {"friction.coefficient": mu, "friction.model": "bristle"}
        thrust = {"chaser.contact_thrust": 300.0}
        order = Order("probe_drogue", without_roll(keys), values | thrust, 40.0)
        found[mu] = order.run(0.1)
    captured = {mu: bool(run["captured"][-1]) for mu, run in found.items()}
    loads = [float(found[0.2][f"contact.surface[{k}].peak"][-1]) for k in (3, 5)]
    return [
        Row(
            "probe on the cone",
            "friction above 0.577 wedges; below, the head slides into the socket",
            ", ".join(
                f"{mu:g}: "
                + (f"captured after {find_duration(run):.1f} s" if captured[mu] else "not captured")
                for mu, run in found.items()
            )
            + f"; at 0.2 the cone carries {loads[0]:.0f} N, the socket {loads[1]:.0f} N",
            all(captured[mu] == (mu < 0.577) for mu in coefficients),
            "",
            order.write_command(),
        )
    ]


def without_roll(keys: Values) -> Values:
    """The scene of the probe does not set a roll."""
    return {name: value for name, value in keys.items() if name != "initial.roll_deg"}


def deflection() -> list[Row]:
    """Least speed without thrust over the lateral offset, and the energy of the deflection."""
    stiffness, mass = 1526.0, 25e3 * 350e3 / 375e3
    found = {}
    for offset in (0.05, 0.10, 0.20, 0.30):
        keys = without_roll(ALIGNED | {"initial.lateral_offset": offset})
        found[offset] = find_least_speed(Order("probe_drogue", keys, {}, 40.0))
    exact = {y: float(np.sqrt(stiffness * y**2 / mass)) for y in found}
    return [
        Row(
            "probe, energy of the deflection",
            "the closing energy must be near k y^2/2 (1526 N/m): speeds within a factor of 1.5",
            "least speed "
            + ", ".join(
                f"{1e3 * v:.0f} mm/s at {y:g} m (energy alone: {1e3 * exact[y]:.0f})"
                for y, v in found.items()
            ),
            bool(np.all(np.diff(list(found.values())) > 0))
            and all(exact[y] / 1.5 < v < 1.5 * exact[y] for y, v in found.items()),
            "",
            Order(
                "probe_drogue", without_roll(ALIGNED | {"initial.lateral_offset": 0.3}), {}, 40.0
            ).write_command(),
        )
    ]


def side_dampers() -> list[Row]:
    """Lateral motion with and without the brakes of the side absorbers."""
    off = {f"element[{i}].law[2].slope": 0.0 for i in range(2, 6)}
    keys = {"initial.approach_time": 0.2, "sequence.stop_after": "attenuate"}
    orders = [Order("probe_drogue", keys, values, 300.0) for values in ({}, off)]
    swings = []
    for order in orders:
        run = order.run(0.1)
        time, y = run["time"], run["relative.position[2]"]
        swings.append(
            [1e3 * float(np.ptp(y[(time > a) & (time < a + 50.0)])) for a in (10.0, 250.0)]
        )
    return [
        Row(
            "probe without side dampers",
            "poorly damped lateral motion after capture",
            "; ".join(
                f"{name}: lateral swing {a:.0f} mm from 10 s on, {b:.0f} mm from 250 s on"
                for name, (a, b) in zip(("as shipped", "no side dampers"), swings, strict=True)
            ),
            swings[0][1] < 0.2 * swings[0][0] and swings[1][1] > 0.8 * swings[1][0],
            "",
            orders[1].write_command(),
        )
    ]


TRENDS: dict[str, Callable[[], list[Row]]] = {
    "central": central,
    "roll": roll,
    "guides_on_guides": guides_on_guides,
    "guides_on_ring": guides_on_ring,
    "friction": friction,
    "ring_on_ring": ring_on_ring,
    "differential": differential,
    "brakes_off": brakes_off,
    "jammed": jammed,
    "thrust_failures": thrust_failures,
    "stalled": stalled,
    "wedging": wedging,
    "deflection": deflection,
    "side_dampers": side_dampers,
}
