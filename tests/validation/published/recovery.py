"""Case B: the recovery coefficient of a linear spring-damper absorber, under both conventions.

With damping ratio z, s = sqrt(1 - z^2), q = sqrt(z^2 - 1): back at the point of first contact
e = exp(-pi z/s); at the release, where the force is zero, e = exp(-(2z/s) atan2(s, z)) for z < 1
and exp(-(2z/q) artanh(q/z)) for z > 1.
"""

import math

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_near, compare_words
from models import make_axial_unit, make_scene

import dockloop as dl

RATIOS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.5, 2.0)
SPEEDS = (0.03, 0.1, 0.3)  # m/s
STIFFNESS, MASS = 20e3, 25e3 * 350e3 / 375e3  # N/m, kg


def find_back(z: float) -> float:
    """Return e at the return to the point of first contact."""
    return math.exp(-math.pi * z / math.sqrt(1.0 - z * z))


def find_released(z: float) -> float:
    """Return e at the release."""
    if z < 1.0:
        s = math.sqrt(1.0 - z * z)
        return math.exp(-2.0 * z / s * math.atan2(s, z))
    q = math.sqrt(z * z - 1.0)
    return math.exp(-2.0 * z / q * math.atanh(q / z))


def run_absorber(z: float, speed: float, pulls: bool) -> dl.Result:
    """Run one rebound of the shipped absorber."""
    overrides = {
        "mechanism.set.contact.damping": 2.0 * z * math.sqrt(STIFFNESS * MASS),
        "mechanism.set.contact.pulls": pulls,
        "initial.closing_speed": speed,
    }
    return dl.run("absorber_1d", overrides, stop=10.0, step=1.0)


def find_coefficient(z: float, speed: float, pulls: bool) -> float:
    """Return the ratio of the speeds after and before."""
    return float(run_absorber(z, speed, pulls)["relative.velocity[1]"][-1]) / speed


def find_relative_peak(z: float) -> float:
    """Return the peak force over v0 sqrt(k m)."""
    run = run_absorber(z, 0.1, False)
    return float(run["capture.peak.compression"][-1]) / (0.1 * math.sqrt(STIFFNESS * MASS))


def compare_exactly() -> list[Comparison]:
    """Both conventions, over damping ratio and speed; the smallest peak."""
    rows = []
    for pulls, find, where in ((True, find_back, "x = 0"), (False, find_released, "F = 0")):
        ratios = [z for z in RATIOS if not (pulls and z > 1.0)]
        found = np.array([[find_coefficient(z, v, pulls) for v in SPEEDS] for z in ratios])
        for z, row in zip(ratios, found, strict=True):
            what = f"e at {where}, damping ratio {z:g}"
            rows.append(compare_near(what, row[1], find(z), absolute=1e-5))
        spread = float(np.ptp(found, axis=1).max())
        what = f"e at {where}, largest spread over {SPEEDS[0]:g} to {SPEEDS[-1]:g} m/s"
        rows.append(compare_near(what, spread, 0.0, absolute=1e-6))
    z = np.linspace(0.235, 0.295, 7)
    fit = np.polynomial.Polynomial.fit(z, [find_relative_peak(value) for value in z.tolist()], 4)
    roots = fit.deriv().roots()
    least = min(roots[(abs(roots.imag) < 1e-9) & (abs(roots.real - 0.265) < 0.03)].real, key=fit)
    return [
        *rows,
        compare_near("damping ratio of the smallest peak", least, 0.265, absolute=5e-4),
        compare_near("smallest peak over v0 sqrt(k m)", float(fit(least)), 0.8101, absolute=5e-5),
    ]


def recoil(forward: float) -> float:
    """Return the recovery coefficient of the differential unit on its axis, with a spring.

    Args:
        forward: level of the brake while the ring comes back [N]; it is 100 N on the way in.
    """
    brake = {"type": "brake", "forward": forward, "back": 100.0}
    laws = [
        {"type": "spring", "stages": [[0, 3e4]]},
        brake | {"presliding": 1e-6, "rate_cap": 0.01},
    ]
    contact = {"type": "absorber", "stiffness": 4e5, "damping": 0, "pulls": False}
    scene = make_scene(
        make_axial_unit(50.0, 50.0, laws, contact),
        chaser={"motion": "fixed"},
        target={"mass": 4650.0, "velocity": [-0.1, 0, 0]},
    )
    run = dl.run(scene, stop=2.5, step=0.05)
    return float(run["relative.velocity[1]"][-1]) / 0.1


def compare_trends() -> list[Comparison]:
    """A brake that holds more on the way back."""
    even, stronger = recoil(100.0), recoil(300.0)
    return [
        compare_words(
            "recovery coefficient with a brake that is stronger on the way back",
            f"{stronger:.3f}, instead of {even:.3f}",
            "lower",
            stronger < even,
        )
    ]


def draw(axes) -> None:
    """Draw e over the damping ratio."""
    z = np.linspace(0.02, 0.98, 100)
    axes.plot(z, [find_back(x) for x in z], label="back at first contact, x = 0")
    axes.plot(z, [find_released(x) for x in z], label="release, F = 0")
    for pulls, color in ((True, "C0"), (False, "C1")):
        for x in RATIOS[:7]:
            axes.plot(x, find_coefficient(x, 0.1, pulls), "o", color=color)
    axes.set_xlabel("damping ratio")
    axes.set_ylabel("recovery coefficient; dots: dockloop")
    axes.legend()


CASE = Case(
    "B",
    "Recovery coefficient of a spring-damper absorber",
    "Syromiatnikov, page 245; closed forms derived",
    (
        Input("the coefficient does not depend on the speed", "yes", GIVEN, "245"),
        Input("a brake that is stronger on the way back lowers the recoil", "yes", GIVEN, "221"),
        Input("damping ratios", "0.05 to 2", ASSUMED),
        Input("speeds", "0.03, 0.1, 0.3 m/s", ASSUMED),
        Input("stiffness and masses", "20 kN/m, 25 t and 350 t", ASSUMED, "scene absorber_1d"),
    ),
    "The two conventions differ by up to a factor of 100. dockloop has both: `pulls` of the"
    " absorber chooses. An absorber that cannot pull lets go at F = 0; contact surfaces do so.",
    exact=compare_exactly,
    trend=compare_trends,
    figure=draw,
)  # fmt: skip
