"""A flexible chaser of Basilisk: two hinged arrays and slosh around the docking FMU.

Basilisk integrates hub, arrays and slosh with its own effectors. The FMU receives the motion of the
hub, and takes the chaser for one rigid body with the total mass and inertia. The result is compared
with one FMU that integrates everything: the parts are `[[chaser.part]]` of its scene. The rest is a
small error, of first order in the step. The FMU notices that the vehicle is not the rigid one that
is stated: its log has a warning.
"""

import tomllib

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import (
    extForceTorque,
    hingedRigidBodyStateEffector,
    linearSpringMassDamper,
    spacecraft,
)
from Basilisk.utilities import RigidBodyKinematics as rbk
from Basilisk.utilities import SimulationBaseClass, macros
from basilisk_host import DockingModule
from docking_fmu import ACCURATE, MODES, SCENE, Docking, make_parser, print_comparison, symmetric

import dockloop as dl
from dockloop.base.paths import SCENES

MASS, ARM, SPAN, ALONG = 300.0, 4.0, 1600.0, 25.0  # an array: kg; m from hinge to CoM; kg m2
HINGE = 2.0  # m from the centre of the hub
ARRAYS = ((1.0, (1.0, 0.0, 0.0), 0.30), (-1.0, (0.0, 0.0, 1.0), 0.45))  # side, hinge axis, Hz
SLOSH, SLOSH_AXIS, SLOSH_FREQUENCY = 1000.0, (0.6, 0.8, 0.0), 0.3  # kg, Hz
DAMPING = 0.005  # ratio, of all parts


def find_hub(docking: Docking) -> tuple[float, np.ndarray]:
    """Return mass and inertia of the hub: what the total leaves (slosh begins at the centre)."""
    side = 2.0 * (SPAN + MASS * (HINGE + ARM) ** 2)
    inertia = symmetric(docking.get("chaser.inertia"))
    return (
        docking.get("chaser.mass") - 2.0 * MASS - SLOSH,
        inertia - np.diag([side, 2.0 * ALONG, side]),
    )


class HubModule(DockingModule):
    """Reports the hub, at whose centre loads act; no gravity."""

    def report_motion(self) -> None:
        """Put the motion of the hub into the inputs of the FMU."""
        motion = self.motion()
        self.docking.put("chaser.position", motion.r_BN_N)
        self.docking.put("chaser.velocity", motion.v_BN_N)
        self.docking.put("chaser.attitude", rbk.MRP2EP(motion.sigma_BN))
        self.docking.put("chaser.angular_velocity", motion.omega_BN_B)

    def gravity(self) -> np.ndarray:
        """Return none: far from any planet."""
        return np.zeros(3)


def add_parts(chaser: spacecraft.Spacecraft) -> list:
    """Hang arrays and slosh on the hub; return them, because Basilisk only borrows them."""
    parts = []
    about_hinge = SPAN + MASS * ARM**2
    for side, axis, frequency in ARRAYS:
        omega = 2.0 * np.pi * frequency
        array = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
        array.ModelTag = array.nameOfThetaState = f"theta{len(parts)}"
        array.nameOfThetaDotState = f"thetaDot{len(parts)}"
        array.mass, array.d = MASS, ARM
        array.IPntS_S = np.diag([ALONG, SPAN, SPAN]).tolist()
        array.k, array.c = omega**2 * about_hinge, 2.0 * DAMPING * omega * about_hinge
        array.r_HB_B = [[0.0], [HINGE * side], [0.0]]
        inward, hinge = np.array([0.0, -side, 0.0]), np.array(axis)  # first and second axis of H
        array.dcm_HB = np.array([inward, hinge, np.cross(inward, hinge)]).tolist()
        parts.append(array)
    omega = 2.0 * np.pi * SLOSH_FREQUENCY
    slosh = linearSpringMassDamper.LinearSpringMassDamper()
    slosh.massInit, slosh.k, slosh.c = SLOSH, omega**2 * SLOSH, 2.0 * DAMPING * omega * SLOSH
    slosh.r_PB_B, slosh.pHat_B = [[0.0], [0.0], [0.0]], [[entry] for entry in SLOSH_AXIS]
    parts.append(slosh)
    for part in parts:
        chaser.addStateEffector(part)
    return parts


def fly(docking: Docking, steps: int) -> None:
    """Dock: build the Basilisk simulation around the FMU and run it."""
    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(docking.step)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    chaser = spacecraft.Spacecraft()
    mass, inertia = find_hub(docking)
    chaser.hub.mHub, chaser.hub.IHubPntBc_B = mass, inertia.tolist()
    chaser.hub.r_CN_NInit = docking.get("chaser.position")
    chaser.hub.v_CN_NInit = docking.get("chaser.velocity")
    chaser.hub.sigma_BNInit = rbk.EP2MRP(docking.get("chaser.attitude"))
    chaser.hub.omega_BN_BInit = docking.get("chaser.angular_velocity")
    parts = add_parts(chaser)
    module = HubModule(docking, "parallel", "chaser")
    module.motion.subscribeTo(chaser.scStateOutMsg)
    force = messaging.CmdForceInertialMsg().write(messaging.CmdForceInertialMsgPayload())
    torque = messaging.CmdTorqueBodyMsg().write(messaging.CmdTorqueBodyMsgPayload())
    module.control_force.subscribeTo(force)
    module.control_torque.subscribeTo(torque)
    mechanism = extForceTorque.ExtForceTorque()
    mechanism.cmdForceInertialInMsg.subscribeTo(module.force)
    mechanism.cmdTorqueInMsg.subscribeTo(module.torque)
    chaser.addDynamicEffector(mechanism)
    for priority, member in enumerate((chaser, *parts, mechanism, module)):
        simulation.AddModelToTask("task", member, priority)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(steps * step)
    simulation.ExecuteSimulation()
    module.report_motion()  # of the end, for the comparison


def fly_alone(docking: Docking, step: float, steps: int) -> dl.Docking:
    """Dock with all parts inside."""
    mass, inertia = find_hub(docking)
    arrays = [
        {
            "mass": MASS,
            "com": [0.0, ARM * side, 0.0],
            "inertia": [SPAN, ALONG, SPAN, 0.0, 0.0, 0.0],
            "position": [0.0, HINGE * side, 0.0],
            "joint": "hinge",
            "axis": list(axis),
            "frequency": frequency,
            "damping_ratio": DAMPING,
        }
        for side, axis, frequency in ARRAYS
    ]
    slosh = {"mass": SLOSH, "joint": "slide", "axis": list(SLOSH_AXIS)}
    slosh |= {"frequency": SLOSH_FREQUENCY, "damping_ratio": DAMPING}
    scene = tomllib.loads((SCENES / f"{SCENE}.toml").read_text(encoding="utf-8"))
    scene["chaser"] |= {"mass": mass, "inertia": [*np.diag(inertia).tolist(), 0.0, 0.0, 0.0]}
    scene["chaser"]["part"] = [*arrays, slosh]
    alone = dl.Docking(scene)
    for name, value in ACCURATE.items():
        alone.set(name, value)
    for _ in range(steps):
        alone.step(step)
    return alone


def main() -> None:
    """Dock with Basilisk around the FMU and with one FMU, compare."""
    parser = make_parser(
        "A flexible chaser of Basilisk, compared with one FMU for everything.",
        ".venv/bin/python scripts/examples/basilisk_flexible.py --step 0.02",
        ("parallel",),
    )
    options = parser.parse_args()
    steps = round(options.stop / options.step)
    settings = {"coupling.mode": MODES[options.mode], "coupling.expected_step": options.step}
    docking = Docking("driven", options.step, ACCURATE | settings)
    fly(docking, steps)
    print_comparison(docking, fly_alone(docking, options.step, steps))


if __name__ == "__main__":
    main()
