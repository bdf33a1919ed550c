"""The shortest honest host: a vehicle in numpy, all the rest of a docking in an FMU.

The chaser is `driven`: this program integrates it, under the mean loads of the FMU, held
over each step. The same docking with both vehicles inside one FMU shows what that costs.

With `--adapter` the docking hardware sits on a tunnel of 2 t that vibrates at 12 Hz. The tunnel is
in the FMU, and the vehicle here is what is behind its springs: mean loads are right for nothing
that vibrates within a step.
"""

import numpy as np
from docking_fmu import ACCURATE, MODES, Docking, make_parser, print_comparison, symmetric

MOTION = [f"chaser.{name}" for name in ("position", "velocity", "attitude", "angular_velocity")]
LOADS = ("chaser.force_mean", "chaser.torque_mean")
ADAPTER = (
    "chaser.mass=23000",  # without the tunnel
    "chaser.adapter.mass=2000",
    "chaser.adapter.inertia=[2000, 1500, 1500, 0, 0, 0]",
    "chaser.adapter.position=[2.5, 0, 0]",
    'chaser.adapter.joint="elastic"',
    "chaser.adapter.frequency=12",
    "chaser.adapter.damping_ratio=0.01",
)


class Vehicle:
    """A rigid body; its state is position, velocity, attitude (w, x, y, z), angular velocity."""

    def __init__(self, docking: Docking) -> None:
        """Begin where the scene says."""
        self.state = np.concatenate([docking.get(name) for name in MOTION])
        self.mass = docking.get("chaser.mass")
        self.inertia = symmetric(docking.get("chaser.inertia"))

    def report(self, docking: Docking) -> None:
        """Put the motion of now into the inputs of the FMU."""
        for name, value in zip(MOTION, np.split(self.state, (3, 6, 10)), strict=True):
            docking.put(name, value)

    def rates(self, state: np.ndarray, force: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the time derivative of the state: force in N, torque in body axes."""
        _, v, q, w = np.split(state, (3, 6, 10))
        turning = np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))]) / 2
        spin = np.linalg.solve(self.inertia, torque - np.cross(w, self.inertia @ w))
        return np.concatenate([v, force / self.mass, turning, spin])

    def advance(self, step: float, force: np.ndarray, torque: np.ndarray) -> None:
        """Make one Runge-Kutta step; the loads are held."""
        k1 = self.rates(self.state, force, torque)
        k2 = self.rates(self.state + step / 2 * k1, force, torque)
        k3 = self.rates(self.state + step / 2 * k2, force, torque)
        k4 = self.rates(self.state + step * k3, force, torque)
        self.state += step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self.state[6:10] /= np.linalg.norm(self.state[6:10])


def main() -> None:
    """Dock with a host, dock without, compare."""
    parser = make_parser(
        "A docking with the chaser integrated in numpy, compared with one FMU for both vehicles.",
        ".venv/bin/python scripts/examples/python_host.py --mode sequential --step 0.02",
    )
    parser.add_argument("--adapter", action="store_true", help="with a tunnel that vibrates")
    options = parser.parse_args()
    keys = ADAPTER if options.adapter else ()
    steps = round(options.stop / options.step)

    settings = {"coupling.mode": MODES[options.mode], "coupling.expected_step": options.step}
    docking = Docking("driven", options.step, ACCURATE | settings, keys)
    vehicle = Vehicle(docking)
    for _ in range(steps):
        coming = [
            docking.get(name) for name in LOADS
        ]  # parallel, host_first: known before the step
        if options.mode == "host_first":
            vehicle.advance(options.step, *coming)
        vehicle.report(docking)  # the motion of t; host_first: of t + H
        docking.advance()  # to t + H
        made = [docking.get(name) for name in LOADS]  # sequential: known after the step
        if options.mode != "host_first":
            vehicle.advance(options.step, *(coming if options.mode == "parallel" else made))
    vehicle.report(docking)  # the motion of the end, for the comparison

    alone = Docking("free", options.step, ACCURATE, keys)
    for _ in range(steps):
        alone.advance()
    print_comparison(docking, alone)


if __name__ == "__main__":
    main()
