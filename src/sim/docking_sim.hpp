// One docking simulation: the facade that the FMU and the C++ tests use.
//
// Life cycle: construct from a scene -> edit parameters() -> initialise() -> { edit inputs(),
// step(), outputs() } ... Everything that can throw or allocate happens before the first step().
// A step that fails returns a Status and leaves the simulation where it was.
//
// The structs below are plain data in the names and units of the FMU (frames: src/README.md); the
// variable table in fmu/variables.cpp points into them.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "math/status.hpp"
#include "math/types.hpp"
#include "model/scene.hpp"

namespace dockloop {

/// Everything that can be chosen before the run starts. Start values come from the scene.
struct Parameters {
  std::array<VehicleParameters, 2> vehicle;  ///< [kChaser], [kTarget]; model/scene.hpp
  double contact_thrust = 0.0;        ///< [N] along +x of A, from first contact until captured
  double contact_thrust_delay = 0.0;  ///< [s] after first contact
  double friction_coefficient = 0.0;  ///< [-]
  int friction_model = 1;             ///< 1 regularised, 2 bristle
  double restitution = 0.0;           ///< [-] at restitution_speed
  double restitution_speed = 0.0;     ///< [m/s]
  int solver_method = 1;              ///< 1 auto, 2 explicit
  double rtol = 0.0;                  ///< [-]
  double atol_position = 0.0;         ///< [m], also taken for attitude [-]
  double atol_velocity = 0.0;         ///< [m/s], also for angular velocity [rad/s]
  double atol_energy = 0.0;           ///< [J] of the energy sinks
};

/// What the host may change at any communication point.
struct Inputs {
  struct Vehicle {
    Vec3<double> position = Vec3<double>::Zero();          ///< driven only: CoM in N [m]
    Vec3<double> velocity = Vec3<double>::Zero();          ///< driven only: in N [m/s]
    Vec4<double> attitude{1, 0, 0, 0};                     ///< driven only: body to N, (w, x, y, z)
    Vec3<double> angular_velocity = Vec3<double>::Zero();  ///< driven only: body axes [rad/s]
    Vec3<double> force_ext = Vec3<double>::Zero();         ///< in N [N]
    Vec3<double> torque_ext = Vec3<double>::Zero();        ///< about CoM, body axes [N m]
  };
  std::array<Vehicle, 2> vehicle;
  Vec3<double> gravity = Vec3<double>::Zero();  ///< in N [m/s2]
  std::vector<double> leg_force_command;        ///< [N], one per leg
};

/// Everything that can be read at a communication point (and after initialise()).
struct Outputs {
  double time = 0.0;  ///< [s]
  struct Vehicle {
    Vec3<double> position = Vec3<double>::Zero();          ///< CoM in N [m]
    Vec3<double> velocity = Vec3<double>::Zero();          ///< in N [m/s]
    Vec4<double> attitude{1, 0, 0, 0};                     ///< body to N
    Vec3<double> angular_velocity = Vec3<double>::Zero();  ///< body axes [rad/s]
    Vec3<double> force = Vec3<double>::Zero();             ///< of the docking system, in N [N]
    Vec3<double> torque = Vec3<double>::Zero();            ///< about CoM, body axes [N m]
    Vec3<double> force_mean = Vec3<double>::Zero();        ///< over the step just made, in N [N]
    Vec3<double> torque_mean = Vec3<double>::Zero();       ///< about CoM, body axes [N m]
  };
  std::array<Vehicle, 2> vehicle;

  // group relative: P with respect to A, axes of A
  Vec3<double> relative_position = Vec3<double>::Zero();          ///< [m]
  Vec4<double> relative_attitude{1, 0, 0, 0};                     ///< q_AP
  Vec3<double> relative_velocity = Vec3<double>::Zero();          ///< d/dt relative_position [m/s]
  Vec3<double> relative_angular_velocity = Vec3<double>::Zero();  ///< [rad/s]
  double relative_axial = 0.0;                                    ///< relative_position[0] [m]
  double relative_lateral = 0.0;                                  ///< norm of the y-z part [m]
  double relative_pitch_yaw = 0.0;  ///< angle between the docking axes [rad]
  double relative_roll = 0.0;       ///< twist about the docking axis [rad]
  double gap = 0.0;                 ///< smallest signed distance of the capture surfaces [m]

  // group capture: load on the target through the capture interface, about the origin of P, axes P
  Vec3<double> capture_force = Vec3<double>::Zero();   ///< [N]
  Vec3<double> capture_torque = Vec3<double>::Zero();  ///< [N m]
  /// tension, compression, shear [N], bending, torsion [N m]
  enum Load { kTension, kCompression, kShear, kBending, kTorsion, kLoadCount };
  std::array<double, kLoadCount> capture_load{};  ///< now
  std::array<double, kLoadCount> capture_peak{};  ///< largest since the start, over inner steps
  double capture_load_ratio = 0.0;                ///< largest |load|/rated now [-]
  double capture_peak_load_ratio = 0.0;           ///< largest since the start [-]

  // group contact
  std::vector<double> petal_force;    ///< [N] resultant on each active petal
  double contact_depth_ratio = 0.0;   ///< largest depth / rounding [-]
  std::vector<double> latch_opening;  ///< [m]
  std::vector<double> latch_force;    ///< [N]

  // group phase
  int phase = 1;    ///< 1 approach ... 8 rebound, see interface
  int outcome = 1;  ///< 1 undecided, 2 captured, 3 partial capture, 4 rebound, 5 miss
  bool captured = false;
  std::vector<char> latched;      ///< 0 or 1, one per latch (char: vector<bool> has no addresses)
  double time_to_contact = 0.0;   ///< [s] lower bound from gap and closing speed
  double time_of_contact = -1.0;  ///< [s] simulation time, -1 before
  double time_of_capture = -1.0;  ///< [s] simulation time, -1 before

  // group ring: G with respect to A, axes of A (angular velocity in axes of A)
  Vec3<double> ring_position = Vec3<double>::Zero();
  Vec4<double> ring_attitude{1, 0, 0, 0};
  Vec3<double> ring_velocity = Vec3<double>::Zero();
  Vec3<double> ring_angular_velocity = Vec3<double>::Zero();

  // group legs
  std::vector<double> leg_length, leg_rate, leg_force;  ///< [m], [m/s], [N] (+ pushes ends apart)

  // group states: independent coordinates of the mechanism (without the vehicles)
  std::vector<double> state_q, state_v, state_a;

  // group loops
  std::vector<Vec3<double>> loop_force;  ///< cut force on the terminal body, axes of the lca [N]
  Vec3<double> base_force = Vec3<double>::Zero();  ///< mechanism on its base, axes and origin of B
  Vec3<double> base_torque = Vec3<double>::Zero();

  // group energy
  double energy_kinetic = 0.0, energy_potential = 0.0;  ///< [J]; kinetic in the internal frame
  double energy_dissipated = 0.0;                       ///< sum of the four below [J]
  double energy_dissipated_contact = 0.0, energy_dissipated_friction = 0.0;
  double energy_dissipated_legs = 0.0, energy_dissipated_latches = 0.0;
  double energy_external = 0.0;  ///< work done by forces from outside [J]
  double energy_residual = 0.0;  ///< what does not add up [J]
  double momentum_residual =
      0.0;  ///< largest |p - p(0) - impulse| / momentum scale since start [-]
  Vec3<double> momentum_linear = Vec3<double>::Zero();     ///< in N axes [N s]
  Vec3<double> momentum_angular = Vec3<double>::Zero();    ///< about momentum_reference [N m s]
  Vec3<double> momentum_reference = Vec3<double>::Zero();  ///< in N [m]

  // group solver
  double solver_steps = 0, solver_rhs_evaluations = 0, solver_rejected_steps = 0;
  double solver_closure_residual = 0.0;    ///< largest loop gap [m]
  double solver_singularity_margin = 1.0;  ///< smallest margin over loops [-]
};

class DockingSim {
 public:
  explicit DockingSim(std::shared_ptr<const Scene> scene);
  ~DockingSim();
  DockingSim(const DockingSim&) = delete;
  DockingSim& operator=(const DockingSim&) = delete;

  const Scene& scene() const;
  Parameters& parameters();  ///< read by initialise() only
  Inputs& inputs();          ///< read at the start of every step()

  /// Build the model from scene and parameters and set the start state.
  /// @param t0 [s] start time; @param tolerance relative tolerance of the host, 0 = none given.
  /// @throws ModelError naming the parameter, its value and the limit.
  void initialise(double t0, double tolerance);

  /// Advance from t to exactly t + h. On failure the state is as before the call and
  /// status_text() says what happened in one sentence.
  Status step(double t, double h);
  const std::string& status_text() const;

  /// Values at the last communication point; computed once, when first asked for.
  const Outputs& outputs();
  /// The struct that outputs() fills; its address and vector sizes are fixed at construction.
  Outputs& output_storage();
  /// Mark the outputs as out of date (an input changed).
  void invalidate_outputs();

  /// Back to the state after construction: parameters and inputs have the scene's values again.
  void reset();

  /// Warnings gathered since the last call (parameters that break a rule of thumb, singular loops).
  std::vector<std::string> take_warnings();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dockloop
