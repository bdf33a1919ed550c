"""A docking in orbit: Basilisk flies the chaser, the FMU holds the mechanism and the target.

Basilisk integrates orbit and attitude of the chaser, one Runge-Kutta step per task step under held
loads, and controls it: the attitude of the target until first contact, then free drift and a push
until captured. `DockingModule` is what to copy: one more module of the task, which steps the FMU.
The result is compared with one FMU of both vehicles, far from any planet, under the same control.

When a task brings its modules from t to t + H, all of them see the spacecraft at t, because it is
the last. So the FMU makes its step from the motion of t, with the control loads of that very step:

    attitude control -> Control -> DockingModule -> two ExtForceTorque -> Spacecraft
"""

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback
from Basilisk.simulation import extForceTorque, gravityEffector, simpleNav, spacecraft
from Basilisk.utilities import RigidBodyKinematics as rbk
from Basilisk.utilities import SimulationBaseClass, macros
from docking_fmu import ACCURATE, MODES, Docking, make_parser, print_comparison, symmetric

MU = 3.986004418e14  # of the Earth, m3/s2
POSITION = np.array([0.0, 0.0, -6.8e6])  # where the docking is in orbit, m, and its velocity, m/s:
VELOCITY = np.array([7656.2, 0.0, 0.0])  # along the docking axis, which is +x of N within degrees
STIFFNESS, DAMPING = 36e3, 54e3  # of the attitude control: N m per unit of MRP, N m per rad/s
PUSH = 200.0  # N along +x of the chaser, from first contact until captured


def command(docking: Docking, sigma: np.ndarray, torque: np.ndarray) -> tuple:
    """Return force (N) and torque (body axes) of the chaser's control over the coming step.

    `sigma` is the attitude of the chaser (MRP), `torque` what the attitude control asks for.
    """
    contact = docking.get("phase") > 1
    push = PUSH if contact and not docking.get("captured") else 0.0
    return rbk.MRP2C(sigma).T @ [push, 0.0, 0.0], np.zeros(3) if contact else np.array(torque)


class Control(sysModel.SysModel):
    """Control software of the chaser, as far as it depends on the docking."""

    def __init__(self, docking: Docking) -> None:
        super().__init__()
        self.docking = docking
        self.motion, self.wanted = messaging.SCStatesMsgReader(), messaging.CmdTorqueBodyMsgReader()
        self.force, self.torque = messaging.CmdForceInertialMsg(), messaging.CmdTorqueBodyMsg()

    def UpdateState(self, now: int) -> None:
        """Decide the loads of the step that ends `now`, ns."""
        wanted = self.wanted().torqueRequestBody
        force, torque = command(self.docking, np.array(self.motion().sigma_BN), wanted)
        write(self, now, force, torque)


class DockingModule(sysModel.SysModel):
    """Steps the FMU: motion, gravity and control loads in, loads of the docking system out."""

    def __init__(self, docking: Docking, mode: str, gravity_at: str) -> None:
        super().__init__()
        self.docking, self.mode, self.gravity_at = docking, mode, gravity_at
        self.motion = messaging.SCStatesMsgReader()
        self.control_force = messaging.CmdForceInertialMsgReader()
        self.control_torque = messaging.CmdTorqueBodyMsgReader()
        self.force, self.torque = messaging.CmdForceInertialMsg(), messaging.CmdTorqueBodyMsg()

    def UpdateState(self, now: int) -> None:
        """Make the step that ends `now`, ns."""
        if now == 0:  # Basilisk updates its modules once at the start, over no time
            return write(self, now, np.zeros(3), np.zeros(3))
        loads = self.loads()  # parallel: announced for the coming step
        self.report_motion()
        self.docking.put("chaser.force_ext", self.control_force().forceRequestInertial)
        self.docking.put("chaser.torque_ext", self.control_torque().torqueRequestBody)
        self.docking.put("gravity", self.gravity())
        self.docking.advance()
        if self.mode == "sequential":
            loads = self.loads()  # of the step just made
        return write(self, now, *loads)

    def report_motion(self) -> None:
        """Put the motion of the spacecraft into the inputs of the FMU."""
        motion = self.motion()
        self.docking.put("chaser.position", motion.r_CN_N)  # of the centre of mass, not of B
        self.docking.put("chaser.velocity", motion.v_CN_N)
        # sigma_BN turns N to B; its Euler parameters are the quaternion (w, x, y, z) of B to N.
        self.docking.put("chaser.attitude", rbk.MRP2EP(motion.sigma_BN))
        self.docking.put("chaser.angular_velocity", motion.omega_BN_B)

    def gravity(self) -> np.ndarray:
        """Return gravity in the middle of the step: the value of t would lag by half a step."""
        position = self.docking.get(f"{self.gravity_at}.position")
        middle = position + self.docking.get(f"{self.gravity_at}.velocity") * self.docking.step / 2
        return -MU * middle / np.linalg.norm(middle) ** 3

    def loads(self) -> list[np.ndarray]:
        """Return the loads of the docking system on the chaser that are to be held over a step."""
        return [self.docking.get("chaser.force_mean"), self.docking.get("chaser.torque_mean")]


def write(module: sysModel.SysModel, now: int, force: np.ndarray, torque: np.ndarray) -> None:
    """Publish the loads of a module."""
    payload = messaging.CmdForceInertialMsgPayload(forceRequestInertial=force)
    module.force.write(payload, now, module.moduleID)
    payload = messaging.CmdTorqueBodyMsgPayload(torqueRequestBody=torque)
    module.torque.write(payload, now, module.moduleID)


def fly(docking: Docking, mode: str, gravity_at: str, steps: int) -> None:
    """Dock in orbit: build the Basilisk simulation around the FMU and run it."""
    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(docking.step)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))

    chaser = spacecraft.Spacecraft()
    earth = gravityEffector.GravBodyData()  # a point mass
    earth.planetName, earth.mu, earth.isCentralBody = "earth", MU, True
    chaser.gravField.gravBodies = gravityEffector.GravBodyVector([earth])
    inertia = symmetric(docking.get("chaser.inertia"))
    sigma = rbk.EP2MRP(docking.get("chaser.attitude"))
    chaser.hub.mHub = docking.get("chaser.mass")
    chaser.hub.IHubPntBc_B = inertia.tolist()
    chaser.hub.r_CN_NInit = docking.get("chaser.position")
    chaser.hub.v_CN_NInit = docking.get("chaser.velocity")
    chaser.hub.sigma_BNInit = sigma
    chaser.hub.omega_BN_BInit = docking.get("chaser.angular_velocity")

    navigation = simpleNav.SimpleNav()
    reference = inertial3D.inertial3D()
    reference.sigma_R0N = rbk.EP2MRP(docking.get("target.attitude"))
    error = attTrackingError.attTrackingError()
    feedback = mrpFeedback.mrpFeedback()
    feedback.K, feedback.P, feedback.Ki = STIFFNESS, DAMPING, -1.0  # negative: no integral part
    configuration = messaging.VehicleConfigMsgPayload(ISCPntB_B=inertia.ravel().tolist())
    configuration = messaging.VehicleConfigMsg().write(configuration)
    control = Control(docking)
    module = DockingModule(docking, mode, gravity_at)
    thrusters, mechanism = extForceTorque.ExtForceTorque(), extForceTorque.ExtForceTorque()

    navigation.scStateInMsg.subscribeTo(chaser.scStateOutMsg)
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
    feedback.guidInMsg.subscribeTo(error.attGuidOutMsg)
    feedback.vehConfigInMsg.subscribeTo(configuration)
    control.wanted.subscribeTo(feedback.cmdTorqueOutMsg)
    module.control_force.subscribeTo(control.force)
    module.control_torque.subscribeTo(control.torque)
    for source, effector in ((control, thrusters), (module, mechanism)):
        source.motion.subscribeTo(chaser.scStateOutMsg)
        effector.cmdForceInertialInMsg.subscribeTo(source.force)
        effector.cmdTorqueInMsg.subscribeTo(source.torque)
        chaser.addDynamicEffector(effector)
    order = (navigation, reference, error, feedback, control, module, thrusters, mechanism, chaser)
    for priority, member in enumerate(reversed(order)):  # high priority goes first
        simulation.AddModelToTask("task", member, priority)

    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(steps * step)
    simulation.ExecuteSimulation()
    module.report_motion()  # of the end, for the comparison


def fly_alone(docking: Docking, steps: int) -> None:
    """Dock with both vehicles inside the FMU, which receives the loads of the same control."""
    reference = rbk.EP2MRP(docking.get("target.attitude"))
    for _ in range(steps):
        sigma = rbk.EP2MRP(docking.get("chaser.attitude"))
        rate = docking.get("chaser.angular_velocity")
        wanted = -STIFFNESS * rbk.subMRP(sigma, reference) - DAMPING * rate
        force, torque = command(docking, sigma, wanted)
        docking.put("chaser.force_ext", force)
        docking.put("chaser.torque_ext", torque)
        docking.advance()


def main() -> None:
    """Dock in orbit and far from any planet, compare."""
    parser = make_parser(
        "A docking in orbit with the chaser moved by Basilisk, compared with one FMU for both.",
        ".venv/bin/python scripts/examples/basilisk_host.py --gravity-at target",
        ("parallel", "sequential"),  # Basilisk moves the spacecraft after its modules
    )
    parser.add_argument(
        "--gravity-at",
        choices=("chaser", "target"),
        default="chaser",
        help="whose gravity acts inside the FMU: that of the chaser shows the error of the coupling"
        " alone, that of the target lets it fly its own orbit (default: %(default)s)",
    )
    options = parser.parse_args()
    steps = round(options.stop / options.step)

    alone = Docking("free", options.step, ACCURATE)
    settings = {"coupling.mode": MODES[options.mode], "coupling.expected_step": options.step}
    for vehicle in ("chaser", "target"):  # the same relative motion, in orbit
        settings[f"{vehicle}.position"] = alone.get(f"{vehicle}.position") + POSITION
        settings[f"{vehicle}.velocity"] = alone.get(f"{vehicle}.velocity") + VELOCITY
    docking = Docking("driven", options.step, ACCURATE | settings)
    fly(docking, options.mode, options.gravity_at, steps)
    fly_alone(alone, steps)
    print_comparison(docking, alone)


if __name__ == "__main__":
    main()
