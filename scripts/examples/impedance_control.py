"""A controller of a hexapod on the host: motor currents that make the ring feel like a damper.

The controller reads the motion of the ring every millisecond and wants a force and a moment against
it. The forces of the six legs follow from the geometry, and currents from the ball screws. Motors
of 8 A reach 126 N along a leg; what is wanted beyond is cut off. The same docking without currents
shows what the controller changes: the swing of the vehicles after capture dies out sooner.
"""

import argparse

import numpy as np

import dockloop as dl

DAMPING, TURN_DAMPING = 1500.0, 300.0  # N s/m and N m s/rad, of the ring in A


class Impedance:
    """Currents against the motion of the ring."""

    def __init__(self, docking: dl.Docking) -> None:
        """Read the geometry of the legs and the constants of screws and motors."""
        mechanism = docking.scene.document["mechanism"]
        self.roots = np.array([leg["root_point"] for leg in mechanism["legs"]])
        self.tips = np.array([leg["closing_point"] for leg in mechanism["legs"]])
        motor = next(law for law in mechanism["forces"][1]["laws"] if law["type"] == "motor")
        lead = mechanism["leg_defaults"]["screw"]["lead"]
        self.force_per_current = 2.0 * np.pi * motor["constant"] / lead  # N/A
        self.largest = motor["current_limit"]  # A

    def find_currents(self, docking: dl.Docking) -> np.ndarray:
        """Return the current of each motor [A]."""
        arms = turn(docking.get("ring.attitude"), self.tips)
        along = docking.get("ring.position") + arms - self.roots
        along /= np.linalg.norm(along, axis=1)[:, None]
        # Force and moment on the ring = sum over legs of (u, r x u) times the force of the leg.
        jacobian = np.hstack([along, np.cross(arms, along)])
        wanted = -np.concatenate(
            [DAMPING * docking.get("ring.velocity"),
             TURN_DAMPING * docking.get("ring.angular_velocity")]
        )  # fmt: skip
        currents = np.linalg.solve(jacobian.T, wanted) / self.force_per_current
        return currents * min(1.0, self.largest / max(np.max(np.abs(currents)), 1e-9))


def turn(quaternion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors turned by a unit quaternion (w, x, y, z)."""
    w, u = quaternion[0], quaternion[1:]
    return vectors + 2.0 * np.cross(u, w * vectors + np.cross(u, vectors))


def dock(damps: bool, step: float, stop: float) -> dict[str, float]:
    """Dock, with currents or without; returns what the table shows."""
    docking = dl.Docking("hexapod")
    control = Impedance(docking)
    axial = []
    while docking.time < stop - 0.5 * step:
        if damps:
            for leg, current in enumerate(control.find_currents(docking), 1):
                docking.set(f"element[{2 * leg}].command", current)
        docking.step(step)
        if docking.get("time_of_capture") > 0.0 and docking.time > 0.6 * stop:
            axial.append(docking.get("relative.axial"))
    return {
        "time_of_capture": docking.get("time_of_capture"),
        "capture.peak.compression": docking.get("capture.peak.compression"),
        "swing of relative.axial": float(np.ptp(axial)) if axial else np.nan,
        "energy.drive_work": docking.get("energy.drive_work"),
        "energy.residual": docking.get("energy.residual"),
    }


def main() -> None:
    """Dock with the controller and without, compare."""
    parser = argparse.ArgumentParser(
        description="Damp the ring of a hexapod by its motors, with a controller on the host.",
        epilog="example: .venv/bin/python scripts/examples/impedance_control.py --step 0.002",
    )
    parser.add_argument("--step", type=float, default=0.001, metavar="S", help="of the controller")
    parser.add_argument("--stop", type=float, default=20.0, metavar="S", help="end of the docking")
    options = parser.parse_args()
    runs = [dock(damps, options.step, options.stop) for damps in (True, False)]
    print(f"{'':28}{'with currents':>16}{'without':>16}")
    for name, value in runs[0].items():
        print(f"{name:28}{value:16.6g}{runs[1][name]:16.6g}")


if __name__ == "__main__":
    main()
