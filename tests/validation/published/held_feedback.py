"""Case J: the critical delay of a force that a host receives late.

m x'' + b x'(t - h) + k x(t - h) = 0 is stable below

    h = atan(b w/k)/w,   w^2 = (b^2 + sqrt(b^4 + 4 m^2 k^2))/(2 m^2).

The force is that of the shipped absorber, in an FMU whose target the host moves. The host presses
with a constant force, so that the contact never opens and works in both directions. A host that
holds the force over a step H instead has a discrete criterion of its own: the matrix that leads
from one step to the next has the spectral radius 1.
"""

import math
from collections.abc import Callable

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_near, compare_words
from models import make_scene

import dockloop as dl

MASS, STIFFNESS = 25e3 * 350e3 / 375e3, 20e3  # kg, N/m
DEPTH, START = 0.1, 0.01  # m: of the rest position, and the displacement from it
RATIOS = (0.02, 0.1, 0.3, 0.5)  # of damping
MICRO = 64  # steps of the FMU within a delay


def find_delay(z: float) -> tuple[float, float]:
    """Return the critical delay [s] and the frequency at it [rad/s]."""
    b = find_damping(z)
    w = math.sqrt((b**2 + math.sqrt(b**4 + 4.0 * MASS**2 * STIFFNESS**2)) / (2.0 * MASS**2))
    return math.atan(b * w / STIFFNESS) / w, w


def find_damping(z: float) -> float:
    """Return the damping of the absorber [N s/m]."""
    return 2.0 * z * math.sqrt(STIFFNESS * MASS)


def make_docking(z: float, step: float, mode: str = "sequential") -> dl.Docking:
    """Return an absorber whose target is moved by the host, pressed to its rest position."""
    law = {"stiffness": STIFFNESS, "damping": find_damping(z), "pulls": True}
    scene = make_scene(
        {"bodies": [], "contact": {"type": "absorber"} | law},
        chaser={"motion": "fixed"},
        target={"motion": "driven", "mass": MASS, "position": [START - DEPTH, 0, 0]},
        groups=("relative", "capture", "phase", "coupling"),
    )
    docking = dl.Docking(scene)
    docking.set("coupling.mode", mode)
    docking.set("coupling.expected_step", step)
    docking.set("target.force_ext", [-STIFFNESS * DEPTH, 0.0, 0.0])
    return docking


def couple(
    z: float, step: float, count: int, choose: Callable[[list[float], int], float]
) -> np.ndarray:
    """Move the target by the force that `choose` takes from the forces read so far.

    Returns:
        Displacements from the rest position at all steps [m].
    """
    docking = make_docking(z, step)
    x, v = START - DEPTH, 0.0
    forces = [STIFFNESS * DEPTH - STIFFNESS * START]
    path = [START]
    for i in range(count):
        docking.set("target.position", [x, 0.0, 0.0])
        docking.set("target.velocity", [v, 0.0, 0.0])
        docking.step(step)
        a = (choose(forces, i) - STIFFNESS * DEPTH) / MASS
        forces.append(docking.get("target.force[1]"))
        x, v = x + step * v + 0.5 * step**2 * a, v + step * a
        path.append(x + DEPTH)
    return np.array(path)


def find_growth(path: np.ndarray, step: float, w: float) -> float:
    """Return the mean growth of the swing per period [ln], without the first one.

    The displacement is fitted by two solutions, exponential times sine and cosine, that are known
    by three equidistant values: x(n+1) + x(n-1) q^2 = 2 q cos(w) x(n).
    """
    stride = max(1, round(0.25 * math.pi / (w * step)))
    tail = path[len(path) // 5 :: stride]
    before, middle, after = tail[:-2], tail[1:-1], tail[2:]
    (_, minus), *_ = np.linalg.lstsq(np.column_stack([middle, -before]), after, rcond=None)
    return 0.5 * math.log(minus) / (stride * step) * 2.0 * math.pi / w


def find_threshold(growth: Callable[[float], float], guess: float) -> float:
    """Return the delay at which the swing neither grows nor decays [s]."""
    low, high = 0.97 * guess, 1.03 * guess
    a, b = growth(low), growth(high)
    return low - a * (high - low) / (b - a)


def grow_delayed(z: float, delay: float) -> float:
    """Return the growth with an exact delay: the mean of two forces read a delay ago."""
    step = delay / MICRO
    w = find_delay(z)[1]

    def choose(forces: list[float], i: int) -> float:
        return 0.5 * (forces[max(0, i - MICRO)] + forces[max(0, i + 1 - MICRO)])

    count = math.ceil(6.0 * 2.0 * math.pi / (w * step))
    return find_growth(couple(z, step, count, choose), step, w)


def grow_held(z: float, hold: float, late: int) -> float:
    """Return the growth with a force held over `hold`, read `late` exchanges earlier."""
    micro = 32  # the FMU reads the force where it expects the target: error of first order
    step = hold / micro
    w = find_delay(z)[1]

    def choose(forces: list[float], i: int) -> float:
        return forces[max(0, (i // micro - late) * micro)]

    count = micro * math.ceil(8.0 * 2.0 * math.pi / (w * hold))
    return find_growth(couple(z, step, count, choose)[::micro], hold, w)


def find_hold(z: float, late: int) -> float:
    """Return the critical hold [s] from the matrix of one exchange."""
    b = find_damping(z)

    def radius(hold: float) -> float:
        force = np.array([-STIFFNESS, -b]) / MASS
        push = np.array([0.5 * hold**2, hold])
        free = np.array([[1.0, hold], [0.0, 1.0]])
        if late == 0:
            return float(max(abs(np.linalg.eigvals(free + np.outer(push, force)))))
        matrix = np.block([[free, push[:, None]], [force[None, :], np.zeros((1, 1))]])
        return float(max(abs(np.linalg.eigvals(matrix))))

    low, high = 1e-4, 3.0 * find_delay(z)[0]
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < 1.0 else (low, middle)
    return low


def grow_announced(z: float, step: float) -> float:
    """Return the growth of a host that uses the announced mean loads (coupling.mode parallel)."""
    w = find_delay(z)[1]
    docking = make_docking(z, step, "parallel")
    x, v, path = START - DEPTH, 0.0, [START]
    docking.set("target.position", [x, 0.0, 0.0])
    for _ in range(math.ceil(6.0 * 2.0 * math.pi / (w * step))):
        docking.set("target.position", [x, 0.0, 0.0])
        docking.set("target.velocity", [v, 0.0, 0.0])
        a = (docking.get("target.force_mean[1]") - STIFFNESS * DEPTH) / MASS
        docking.step(step)
        x, v = x + step * v + 0.5 * step**2 * a, v + step * a
        path.append(x + DEPTH)
    return math.log(abs(path[-1] / START) + 1e-12)


def compare_exactly() -> list[Comparison]:
    """Critical delays; critical holds; the same hold with announced loads."""
    rows = []
    for z in RATIOS:
        expected = find_delay(z)[0]
        found = find_threshold(lambda h, z=z: grow_delayed(z, h), expected)
        what = f"critical delay, damping ratio {z:g} [s]"
        rows.append(compare_near(what, found, expected, relative=1e-2))
    for late, name in ((0, "held"), (1, "held and one exchange late")):
        expected = find_hold(0.1, late)
        found = find_threshold(lambda h, late=late: grow_held(0.1, h, late), expected)
        what = f"critical exchange, force {name}, damping ratio 0.1 [s]"
        rows.append(compare_near(what, found, expected, relative=1e-2))
    grows = grow_announced(0.1, find_hold(0.1, 0))
    rows.append(
        compare_words(
            "the first of these exchanges with announced mean loads (coupling.mode parallel)",
            "decays" if grows < -1.0 else "does not decay",
            "decays",
            grows < -1.0,
        )
    )
    return rows


CASE = Case(
    "J",
    "Critical delay of a force that a host receives late",
    "arXiv 1309.3512 (abstract); closed form derived",
    (
        Input("critical delay and frequency from mass, stiffness, damping", "closed form", GIVEN),
        Input("mass, stiffness", "23 333.33 kg, 20 kN/m", ASSUMED),
        Input("damping ratios", "0.02, 0.1, 0.3, 0.5", ASSUMED),
    ),
    "A host that uses a force of the past feeds energy into a contact. For light damping the limit"
    " is b/k, whatever the mass. A force that is held over an exchange of length H is late by H/2"
    " in the mean, and by 3 H/2 if it arrives one exchange late. Announced mean loads"
    " have no such limit there.",
    exact=compare_exactly,
)  # fmt: skip
