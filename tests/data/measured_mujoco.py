"""Measurements of a rig that does not exist, by MuJoCo, for tests/test_measured.py.

Two bodies on one axis, 25 t and 350 t, meet at 0.10 m/s through a contact with stiffness and
damping, and rebound: the hardware of the scene absorber_1d, computed by another engine. The clock
of the rig starts 7.3 s before the contact less half a second; every sensor has noise, and the load
cell reads 2 % too much.

Command: pip install mujoco numpy && python measured_mujoco.py > measured_mujoco.csv
"""

import mujoco
import numpy as np

CHASER, TARGET, SPEED = 25e3, 350e3, 0.10  # kg, kg, m/s
STIFFNESS, RATIO = 20e3, 0.3  # N/m, of damping
APPROACH, END, SAMPLE, OFFSET = 0.5, 5.0, 0.01, 6.8  # s
NOISE = (0.5, 0.5, 15.0)  # mm, mm/s, N
MASS = CHASER * TARGET / (CHASER + TARGET)
RADIUS = 1.0

MODEL = f"""<mujoco>
  <option timestep="1e-4" integrator="RK4" gravity="0 0 0" solver="Newton" tolerance="1e-14"/>
  <default><geom type="sphere" size="{RADIUS}" condim="1" mass="0" margin="0"
    solref="{-STIFFNESS / MASS:.17g} {-2.0 * RATIO * (STIFFNESS / MASS) ** 0.5:.17g}"
    solimp="0.9999 0.9999 0.001 0.5 2"/></default>
  <worldbody>
    <body><joint type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{CHASER}" diaginertia="1 1 1"/><geom/></body>
    <body pos="{2.0 * RADIUS + SPEED * APPROACH:.17g} 0 0"><joint type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{TARGET}" diaginertia="1 1 1"/><geom/></body>
  </worldbody>
</mujoco>"""


def simulate():
    """Yield time [s], distance [m], its rate [m/s] and force [N], as they are."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qvel[0] = SPEED
    every = round(SAMPLE / model.opt.timestep)
    for _ in range(round(END / SAMPLE)):
        mujoco.mj_forward(model, data)
        gap = data.qpos[1] - data.qpos[0] + SPEED * APPROACH
        yield data.time, gap, data.qvel[1] - data.qvel[0], TARGET * data.qacc[1]
        mujoco.mj_step(model, data, every)


def main():
    """Print the table."""
    draw = np.random.default_rng(2026)
    print("time [s],relative.axial [mm],relative.velocity[1] [mm/s],capture.force[1] [N]")
    for time, gap, speed, force in simulate():
        noise = draw.normal(size=3) * NOISE
        row = (1e3 * gap + noise[0], 1e3 * speed + noise[1], 1.02 * force + noise[2])
        print(f"{time + OFFSET:.3f},{row[0]:.2f},{row[1]:.2f},{row[2]:.1f}")


if __name__ == "__main__":
    main()
