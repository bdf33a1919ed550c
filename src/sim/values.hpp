// Inputs and outputs of a docking simulation: plain data with the names and units of the FMU
// (frames: src/README.md). The variable table in src/interface/variables_*.cpp points to these
// structs.
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "docking/scene.hpp"
#include "math/members.hpp"
#include "math/types.hpp"
#include "sim/host_identification.hpp"
#include "sim/limits.hpp"
#include "sim/peaks.hpp"
#include "sim/solver_methods.hpp"

namespace dockloop {

/// Values of model.flight.
enum FreeDriftModel {
  kQuiescent = 1,   ///< far from contact the mechanism can become quiescent
  kIntegrated = 2,  ///< the mechanism is always integrated
};
inline const ChoiceList kFreeDriftModels = {
    {kQuiescent, "resting",
     "once it has kept its place for 1 s it is carried along by its vehicle and costs nothing; "
     "needs free or fixed vehicles, no loads, an adaptive method"},
    {kIntegrated, "integrated", "always"},
};

/// Values of solver.dae_form: the equations of the loops in method 9 (compare/unreduced_model.hpp).
inline const ChoiceList kDaeForms = {
    {1, "index 1", "by accelerations, drifts"},
    {2, "index 1 with Baumgarte stabilisation", "time constant 0.01 s"},
    {3, "stabilised index 2", "by velocities and positions"},
};

/// Numbers of a disturbance (docking/disturbance.hpp).
struct DisturbanceNumbers {
  double time = 0.0, duration = 0.0;                                         ///< [s]
  Vec3<double> force = Vec3<double>::Zero(), torque = Vec3<double>::Zero();  ///< [N], [N m]
};

/// Parameters of a run, fixed at the start. Start values come from the scene.
struct Parameters {
  std::array<VehicleParameters, 2> vehicle;  ///< [kChaser], [kTarget]; docking/scene.hpp
  double contact_thrust = 0.0;           ///< [N] along +x of A, from first contact until captured
  double contact_thrust_delay = 0.0;     ///< [s] after first contact
  double friction_coefficient = 0.0;     ///< [-]
  int friction_model = 1;                ///< 1 regularised, 2 bristle
  double restitution = 0.0;              ///< [-] at restitution_speed
  double restitution_speed = 0.0;        ///< [m/s]
  std::vector<double> hardware_numbers;  ///< of springs, surfaces, latches, hard dock, forces
                                         ///< (docking/hardware_numbers.hpp)
  std::vector<char> latch_overload;      ///< 0 or 1, one per latch: it releases on overload
  std::vector<double> element_numbers;   ///< of all laws (model/force_element.hpp)
  std::vector<char> failure_active;      ///< 0 or 1, one per failure
  std::vector<double> failure_numbers;   ///< time [s] and value of each
  std::vector<DisturbanceNumbers> disturbance;
  int flight = kQuiescent;                    ///< see FreeDriftModel
  int model_level = kReduced;                 ///< see ModelLevel
  double accuracy = 0.0;                      ///< [-] wanted relative error; see sim/accuracy.hpp
  int solver_method = 1;                      ///< see SolverMethod
  int dae_form = 3;                           ///< of method 9: see kDaeForms
  double step = 0.0;                          ///< [s] inner step of the fixed methods
  double rtol = 0.0;                          ///< [-]
  double atol_position = 0.0;                 ///< [m], also for attitude [-]
  double atol_velocity = 0.0;                 ///< [m/s], also for angular velocity [rad/s]
  double atol_energy = 0.0;                   ///< [J] of dissipated energies and external work
  bool measures_error = false;                ///< by a companion, see sim/companion.hpp
  int coupling_mode = 1;                      ///< see CouplingMode
  double coupling_expected_step = 0.0;        ///< [s] of the first announced load
  double coupling_velocity_tolerance = 1e-4;  ///< [m/s] for the suggested step
  double coupling_delay = 0.0;                ///< [s] of loads and motion together
  double coupling_motion_delay = 0.0;         ///< [s] part of it: of the motion
  bool coupling_identify = true;              ///< predict with identified masses
};

inline SolverSettings get_settings(const Parameters& p) {
  return {p.rtol, p.atol_position, p.atol_velocity, p.atol_energy, p.step, p.solver_method};
}

inline void put_settings(const SolverSettings& settings, Parameters& p) {
  p.rtol = settings.rtol;
  p.atol_position = settings.atol_position;
  p.atol_velocity = settings.atol_velocity;
  p.atol_energy = settings.atol_energy;
  p.step = settings.step;
  p.solver_method = settings.method;
}

/// Inputs: the host may change them at any communication point.
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
  std::vector<double> element_command;          ///< one per force element
  double next_step = 0.0;     ///< [s] of the step after the coming step, 0 = the same
  int command = kNoCommand;   ///< to the sequence, see Command
  int hard_dock_command = 1;  ///< see HardDockCommand
};

/// Is this a unit quaternion, within errors of rounding and integration?
inline bool is_attitude(const Vec4<double>& q) { return std::abs(q.norm() - 1.0) < 1e-3; }
/// In a host that integrates the states, the norm may drift; the equations allow for it.
inline bool has_direction(const Vec4<double>& q) { return q.norm() > 1e-3; }

/// Some hosts start with zeros in every input, before the first exchange. Zeros are not a possible
/// motion, because they are not an attitude.
inline bool is_all_zero(const Inputs::Vehicle& in) {
  return in.position.isZero(0.0) && in.velocity.isZero(0.0) && in.attitude.isZero(0.0) &&
         in.angular_velocity.isZero(0.0);
}

inline bool is_same_motion(const Inputs::Vehicle& a, const Inputs::Vehicle& b) {
  return a.position == b.position && a.velocity == b.velocity && a.attitude == b.attitude &&
         a.angular_velocity == b.angular_velocity;
}

/// Calls f(double&) for every Real input, in an order that depends on the sizes only.
template <class F>
void for_each_value(Inputs& inputs, F&& f) {
  for_each_number<double>(inputs, f);
}

/// What a list of outputs has one entry of.
enum class Per {
  kPetal,
  kSurfaceGroup,
  kLatch,
  kHook,
  kVehicleForce,
  kLeg,
  kElement,
  kPartCoordinate,
  kPosition,  ///< independent coordinates
  kVelocity,
  kLoop,
  kSequenceStep,
  kState,
  kCount
};
using ListSizes = std::array<size_t, static_cast<size_t>(Per::kCount)>;

/// A list whose size follows from the scene.
template <class T, Per per>
struct List : std::vector<T> {};

template <class T, Per per>
void set_size(const ListSizes& sizes, List<T, per>& list) {
  list.resize(sizes[static_cast<size_t>(per)]);
}
template <class T>
void set_size(const ListSizes&, T&) {}

/// Gives every list among the members its size.
template <class T>
void set_sizes(const ListSizes& sizes, T& values) {
  visit_members(values, [&](auto&... members) { (set_size(sizes, members), ...); });
}

/// Outputs that follow continuously from state and inputs; with S = Derivative, their derivatives.
template <class S>
struct OutputValues {
  struct Vehicle {
    Vec3<S> position = Vec3<S>::Zero();          ///< CoM in N [m]
    Vec3<S> velocity = Vec3<S>::Zero();          ///< in N [m/s]
    Vec4<S> attitude{S(1), S(0), S(0), S(0)};    ///< body to N
    Vec3<S> angular_velocity = Vec3<S>::Zero();  ///< body axes [rad/s]
    Vec3<S> force = Vec3<S>::Zero();             ///< of the docking system, in N [N]
    Vec3<S> torque = Vec3<S>::Zero();            ///< about CoM, body axes [N m]
    Vec3<S> force_mean = Vec3<S>::Zero();        ///< over the step just made, in N [N]
    Vec3<S> torque_mean = Vec3<S>::Zero();       ///< about CoM, body axes [N m]
    Vec3<S> force_ext = Vec3<S>::Zero();         ///< with a record: from outside, in N [N]
    Vec3<S> torque_ext = Vec3<S>::Zero();        ///< about CoM, body axes [N m]
  };
  std::array<Vehicle, 2> vehicle;

  // group relative: P with respect to A, axes of A
  Vec3<S> relative_position = Vec3<S>::Zero();          ///< [m]
  Vec4<S> relative_attitude{S(1), S(0), S(0), S(0)};    ///< q_AP
  Vec3<S> relative_velocity = Vec3<S>::Zero();          ///< d/dt relative_position [m/s]
  Vec3<S> relative_angular_velocity = Vec3<S>::Zero();  ///< [rad/s]
  S relative_axial = S(0);                              ///< relative_position[0] [m]
  S relative_lateral = S(0);                            ///< norm of the y-z part [m]
  S relative_pitch_yaw = S(0);                          ///< angle between the docking axes [rad]
  S relative_roll = S(0);                               ///< twist about the docking axis [rad]
  S gap = S(0);  ///< smallest signed distance of the capture surfaces [m]

  // group capture: load on the target through the capture interface, about the origin of P, axes P
  Vec3<S> capture_force = Vec3<S>::Zero();   ///< [N]
  Vec3<S> capture_torque = Vec3<S>::Zero();  ///< [N m]
  /// tension, compression, shear [N], bending, torsion [N m]
  enum Load { kTension, kCompression, kShear, kBending, kTorsion, kLoadCount };
  std::array<S, kLoadCount> capture_load{};  ///< now
  S capture_load_ratio = S(0);               ///< largest |load|/rated now [-]

  // group contact
  List<S, Per::kPetal> petal_force;           ///< [N] resultant on each active petal of guide rings
  List<S, Per::kSurfaceGroup> surface_force;  ///< [N] resultant on each group of other hardware
  S contact_depth_ratio = S(0);               ///< largest depth / rounding [-]
  List<S, Per::kLatch> latch_opening;         ///< [m]
  List<S, Per::kLatch> latch_lateral;         ///< [m]
  List<S, Per::kLatch> latch_force;           ///< [N]

  // group hard_dock: load on the target across A and P, about the origin of P, axes of P
  Vec3<S> joint_force = Vec3<S>::Zero();     ///< [N]
  Vec3<S> joint_torque = Vec3<S>::Zero();    ///< [N m]
  S face_force = S(0), pusher_force = S(0);  ///< sums [N]
  List<S, Per::kHook> hook_force;            ///< tension [N]

  // forces between the vehicles: load of each on the target, about the origin of P, axes of P
  List<Vec3<S>, Per::kVehicleForce> vehicle_force, vehicle_torque;  ///< [N], [N m]
  List<S, Per::kVehicleForce> vehicle_distance;                     ///< of its points [m]

  // group ring: G with respect to A, axes of A (angular velocity in axes of A)
  Vec3<S> ring_position = Vec3<S>::Zero();
  Vec4<S> ring_attitude{S(1), S(0), S(0), S(0)};
  Vec3<S> ring_velocity = Vec3<S>::Zero();
  Vec3<S> ring_angular_velocity = Vec3<S>::Zero();

  // group legs
  List<S, Per::kLeg> leg_length, leg_rate, leg_force;  ///< [m], [m/s], [N] (+ pushes ends apart)

  // force elements: coordinate, rate, force, largest share of a limit of motors and drives
  List<S, Per::kElement> element_coordinate, element_rate, element_force, element_saturation;

  // coordinates of parts of vehicles: chaser, then target; of each its parts, then its adapter
  List<S, Per::kPartCoordinate> part_coordinate, part_rate, part_force;

  // group states: independent coordinates of mechanism and parts of the chaser
  List<S, Per::kPosition> state_q;
  List<S, Per::kVelocity> state_v, state_a;

  // group loops
  List<Vec3<S>, Per::kLoop> loop_force;  ///< cut force on the terminal body, axes of the lca [N]
  Vec3<S> base_force = Vec3<S>::Zero();  ///< mechanism on its base, axes and origin of B
  Vec3<S> base_torque = Vec3<S>::Zero();

  // group energy
  S energy_kinetic = S(0), energy_potential = S(0);  ///< [J]; kinetic in the internal frame
  S energy_dissipated = S(0);                        ///< sum of the seven below [J]
  S energy_dissipated_contact = S(0), energy_dissipated_friction = S(0);
  S energy_dissipated_legs = S(0), energy_dissipated_latches = S(0);
  S energy_dissipated_brakes = S(0), energy_dissipated_hard_dock = S(0);
  S energy_dissipated_forces = S(0);
  S energy_drive_work = S(0);                    ///< of motors and drives on the mechanism [J]
  S energy_external = S(0);                      ///< work done by forces from outside [J]
  S energy_residual = S(0);                      ///< error of the energy balance [J]
  Vec3<S> momentum_linear = Vec3<S>::Zero();     ///< in N axes [N s]
  Vec3<S> momentum_angular = Vec3<S>::Zero();    ///< about momentum_reference [N m s]
  Vec3<S> momentum_reference = Vec3<S>::Zero();  ///< in N [m]
};

/// Calls f(S&) for every number of `values`, in an order that depends on the sizes only.
template <class S, class F>
void for_each_value(OutputValues<S>& values, F&& f) {
  for_each_number<S>(values, f);
}

constexpr int kMaxLegPeaks = 16;  ///< legs of which peaks are kept, the first ones

/// Outputs without derivatives.
struct PointOutputs {
  double time = 0.0;  ///< [s]

  // group capture: largest since the start, over inner steps
  std::array<Peak, OutputValues<double>::kLoadCount> capture_peak{};
  Peak capture_peak_load_ratio;                 ///< [-]
  List<Peak, Per::kSurfaceGroup> surface_peak;  ///< per group of hardware that is no guide ring [N]
  List<Peak, Per::kLeg> leg_peak;               ///< of the first kMaxLegPeaks legs [N]

  // group phase
  int phase = 1;                       ///< see docking/phases.hpp
  int outcome = 1;                     ///< the same
  int sequence_step = 1;               ///< place in the list of steps, from 1
  double sequence_time_in_step = 0.0;  ///< [s]
  List<double, Per::kSequenceStep>
      sequence_entered;  ///< simulation time of the first entry, one per step; or -1
  bool captured = false;
  List<char, Per::kLatch> latched;  ///< 0 or 1, one per latch (char: vector<bool> has no addresses)
  List<int, Per::kLatch> latch_state;  ///< see LatchReport, one per latch
  int capture_reason = 1;              ///< see CaptureReason
  double seated_time = 0.0;            ///< [s] seated without capture
  int hooks_closed = 0;                ///< with their preload
  bool joint_rigid = false;
  double time_to_contact = 0.0;      ///< [s] lower bound from gap and closing speed
  double time_of_contact = kNoTime;  ///< [s] simulation time
  double time_of_capture = kNoTime;  ///< [s] simulation time
  int limits_exceeded = 0;           ///< see LimitRecord::find_bits()
  LimitRecord limits;                ///< with simulation times

  /// group energy: |p - p(0) - impulse| / momentum scale [-]; with kernels at present, else largest
  double momentum_residual = 0.0;

  // group relative, if both vehicles move: chaser, mechanism and target as one rigid body
  double stack_mass = 0.0;                            ///< [kg]
  Vec3<double> stack_com = Vec3<double>::Zero();      ///< in C [m]
  Vec6<double> stack_inertia = Vec6<double>::Zero();  ///< about stack_com, axes of C [kg m2]

  // group coupling, if a vehicle is driven
  double coupling_work_residual = 0.0;                                   ///< [J]
  double coupling_mass_mismatch = 0.0;                                   ///< [-]
  int coupling_diagnosis = 1;                                            ///< see HostFault
  double coupling_diagnosis_value = 0;                                   ///< see kHostFaults
  VehicleBody coupling_body;                                             ///< estimated
  Vec6<double> coupling_inertia = Vec6<double>::Zero();                  ///< the same [kg m2]
  MassDeviations coupling_deviations;                                    ///< of the estimate
  double coupling_frequency = 0.0;                                       ///< [rad/s]
  double coupling_suggested_step = 0.0;                                  ///< [s]
  double coupling_largest_delay = 0.0;                                   ///< [s]
  Vec3<double> coupling_pending_impulse = Vec3<double>::Zero();          ///< [N s]
  Vec3<double> coupling_pending_angular_impulse = Vec3<double>::Zero();  ///< [N m s]

  // the state vector of the integration and its rates, in the order of StateLayout
  List<double, Per::kState> states, rates;

  // group solver
  double solver_steps = 0, solver_rhs_evaluations = 0, solver_rejected_steps = 0;
  double solver_closure_residual = 0.0;    ///< largest loop gap, see SimState::drift [m]
  double solver_singularity_margin = 1.0;  ///< smallest margin over loops [-]
  int solver_chosen_method = kAuto;        ///< see SolverMethod
  double solver_chosen_rtol = 0.0;         ///< [-] 0 with fixed steps
  double solver_chosen_step = 0.0;         ///< [s] 0 without fixed steps
  double solver_error_estimate = 0.0;      ///< [-] 0 = none; measured with a companion
};

/// All outputs at a communication point (and after initialise()).
struct Outputs : OutputValues<double>, PointOutputs {};

}  // namespace dockloop
