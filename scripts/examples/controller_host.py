"""A controller in the loop: it steers the vehicle of a host to the docking port and lets go.

The controller reads attitude and angular velocity at every communication point. Its commands act
`--delay` steps later, as they do on a bus. It turns the chaser to the attitude of the target until
first contact. Then it lets the rings align the vehicles, and pushes until captured. Commands are
reported in `force_ext` and `torque_ext` for the step in which they act: the FMU knows them, and
their delay costs no accuracy. One FMU of both vehicles under the same controller shows that.
"""

import numpy as np
from docking_fmu import ACCURATE, MODES, Docking, make_parser, print_comparison
from python_host import LOADS, Vehicle

STIFFNESS, DAMPING = 9e3, 54e3  # N m per rad, N m per rad/s: slow against the delay
PUSH = 200.0  # N along +x of the chaser, from first contact until captured


class Controller:
    """Commands from measurements; they act some steps after these."""

    def __init__(self, docking: Docking, delay: int) -> None:
        """Begin without a command."""
        self.docking = docking
        self.wanted = docking.get("target.attitude")
        self.line = [(np.zeros(3), np.zeros(3))] * delay

    def command(self, attitude: np.ndarray, rate: np.ndarray) -> tuple:
        """Measure, and return force (in N) and torque (body axes) that act in the coming step."""
        force, torque = np.zeros(3), np.zeros(3)
        if self.docking.get("phase") == 1:
            torque = -STIFFNESS * find_turn(self.wanted, attitude) - DAMPING * rate
        elif not self.docking.get("captured"):
            force = PUSH * find_axis(attitude)
        self.line.append((force, torque))
        return self.line.pop(0)


def find_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the small rotation vector from attitude a to attitude b, body axes."""
    turn = a[0] * b[1:] - b[0] * a[1:] - np.cross(a[1:], b[1:])
    return 2.0 * np.sign(a @ b) * turn


def find_axis(attitude: np.ndarray) -> np.ndarray:
    """Return +x of the body in N."""
    w, x, y, z = attitude
    return np.array([w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])


def report(docking: Docking, loads: tuple) -> None:
    """Put the commands that act in the coming step into the inputs of the FMU."""
    for name, value in zip(("force_ext", "torque_ext"), loads, strict=True):
        docking.put(f"chaser.{name}", value)


def main() -> None:
    """Dock with a host and a controller, dock with one FMU and a controller, compare."""
    parser = make_parser(
        "A docking with a controller on the host, compared with one FMU for both vehicles.",
        ".venv/bin/python scripts/examples/controller_host.py --step 0.02 --delay 3",
        ("parallel",),
    )
    text = "from measurement to command, in steps (default: %(default)s)"
    parser.add_argument("--delay", type=int, default=2, metavar="N", help=text)
    options = parser.parse_args()
    steps = round(options.stop / options.step)

    settings = {"coupling.mode": MODES[options.mode], "coupling.expected_step": options.step}
    docking = Docking("driven", options.step, ACCURATE | settings)
    vehicle, controller = Vehicle(docking), Controller(docking, options.delay)
    for _ in range(steps):
        force, torque = (docking.get(name) for name in LOADS)
        own = controller.command(vehicle.state[6:10], vehicle.state[10:])
        vehicle.report(docking)
        report(docking, own)
        docking.advance()
        vehicle.advance(options.step, force + own[0], torque + own[1])
    vehicle.report(docking)  # the motion of the end, for the comparison

    alone = Docking("free", options.step, ACCURATE)
    controller = Controller(alone, options.delay)
    for _ in range(steps):
        motion = (alone.get(f"chaser.{name}") for name in ("attitude", "angular_velocity"))
        report(alone, controller.command(*motion))
        alone.advance()
    print_comparison(docking, alone)
    away = find_turn(docking.get("target.attitude"), docking.get("chaser.attitude"))
    print(f"chaser turned from the target, at the end: {np.linalg.norm(away):.3e} rad")


if __name__ == "__main__":
    main()
