// The complete state of a docking simulation. The state can be saved and restored within a step (a
// refused step changes nothing), by the host (get and set FMU state), and in another process (as
// bytes).
//
//   Setup      data from which the model was built; fixed by initialise()
//   SimState   data that change during a run, without the vector y of the integrator
//   Snapshot   SimState, y and the accepted configuration of the loops
//   SavedSim   Snapshot with parameters, inputs and counters: complete
//
// All other data (workspaces, outputs) are computed from the state before they are read.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "docking/docking_model.hpp"
#include "integrate/stepper.hpp"
#include "sim/audit.hpp"
#include "sim/coupling.hpp"
#include "sim/limits.hpp"
#include "sim/peaks.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Peaks: loads, load ratio, forces on surfaces.
constexpr int kFirstSurfacePeak = Outputs::kLoadCount + 1;
constexpr int kPeakCount = kFirstSurfacePeak + kMaxSurfaces;

struct Setup {
  Parameters parameters;   ///< driven vehicles: at their received motion
  double t_start = 0.0;    ///< [s]
  double tolerance = 0.0;  ///< relative, of the host; 0 = none given
};

/// Is the mechanism quiescent on its vehicle? (quiescent_mode.hpp)
struct QuiescentState {
  bool on = false;
  double since = 0.0;     ///< coordinates are constant since then [s since start]
  std::vector<double> q;  ///< their values, as in y
  Vec3<double> spin = Vec3<double>::Zero();  ///< of the chaser when quiescence began [rad/s]
  double slack = 0.0;                        ///< relative change of spin that is allowed
};

/// The last Jacobian of an implicit method, by columns: the next communication step begins with it.
/// Of a linearly implicit method: the mechanism block (docking/structured_matrix.hpp).
struct KeptJacobian {
  bool valid = false;
  std::int64_t step = 0;        ///< number of the step, as in Counters
  std::vector<double> entries;  ///< empty if the method needs none
};

/// The number of near pairs of surfaces differs from state to state: later copies allocate nothing.
inline void reserve(ContactMemory& memory, size_t pairs) {
  memory.gap.reserve(pairs);
  memory.near.reserve(pairs);
  memory.near_gap.reserve(pairs);
  memory.closed.reserve(pairs);
  memory.n_last.reserve(pairs);
}

/// What an evaluation depends on, apart from time, state and loads, to the last bit.
struct EvaluationContext {
  DiscreteState discrete;
  ContactMemory memory;
  LoopReference<double> reference;
};

/// An inner step that ends after the communication point, and what decides its bits. While it is
/// pending, all other data are those at its start (run_ahead.cpp).
struct RunAhead {
  bool pending = false;
  double reached = 0.0;   ///< the communication point [s since `elapsed`]; 0 unless pending
  double begin = 0.0;     ///< of the step [s since `elapsed`]
  double farthest = 0.0;  ///< it ends there at the latest [s since `elapsed`]
  double size = 0.0;      ///< as the solver was asked for it [s]
  double proposal = 0.0;  ///< of the error control [s]
  double last_error = 1.0;
  Stepper::Pace pace;         ///< before it
  std::int64_t steps = 0;     ///< count of steps before it
  KeptJacobian jacobian;      ///< before it
  EvaluationContext context;  ///< of the rates at its start
  Loads loads;                ///< of the last communication step
  int changes = 0;            ///< bits: did a host change inputs at the last four points?
  bool is_retuned = false;    ///< parameters were changed since the last point

  // Mean loads are computed when they are read: they need evaluations at both points.
  bool is_mean_due = false;
  bool is_begin_known = true;         ///< the motion at the last communication point but one
  CouplingPoint begin_point;          ///< this motion; else it follows from:
  std::vector<double> y_before;       ///< the state there
  LoopReference<double> pose_before;  ///< the accepted configuration there
  Loads mean_known;                   ///< mean known loads since then
};

struct SimState {
  /// Inner steps count their time from here [s since start]: the last communication point, or an
  /// earlier one while a step is pending.
  double elapsed = 0.0;
  double h_warm = 0.0;      ///< step size for the next communication step [s]
  double last_step = 0.0;   ///< [s]
  double inner_step = 0.0;  ///< largest one of a method with fixed steps [s]
  Stepper::Pace pace;       ///< of the integrator, after the last inner step
  Vec3<double> frame_velocity = Vec3<double>::Zero();  ///< of O in N [m/s]
  Vec3<double> frame_shift = Vec3<double>::Zero();     ///< of O in N since the start [m]
  DiscreteState discrete;
  ContactMemory memory;  ///< a function of the last accepted state
  PeakTracker<kPeakCount> peaks;
  std::array<Wrench<double>, 2> mean_load;  ///< of the last step; if announced: of the coming step
  CouplingState coupling;                   ///< with hosts that drive vehicles
  QuiescentState quiescent;
  double margin_looked_at = kChangeMargin;  ///< margin at the last search of coordinates
  LimitRecord limits;
  bool warned_step_error = false;  ///< warned of equal steps that are too long
  /// Independent coordinates, if they differ from those of the start; else null.
  std::shared_ptr<const Coordinates> coordinates;

  KeptJacobian kept_jacobian;
  RunAhead ahead;

  double drift = 0.0;  ///< largest gap at inner steps of the last step, if multipliers hold the
                       ///< cuts [m]

  EnergyAudit energy_audit;
  MomentumAudit momentum_audit;
};

struct Snapshot {
  SimState state;
  std::vector<double> y;
  LoopReference<double> reference;
};

/// What the integrator did not have to do since the start.
struct LeftOut {
  double quiescent_time = 0.0;    ///< free drift with a quiescent mechanism [s]
  double joined_time = 0.0;       ///< with a rigid joint between the vehicles [s]
  std::int64_t booked_steps = 0;  ///< inner steps at which near pairs were counted
  std::int64_t near_pairs = 0;    ///< contact pairs near enough for a search, sum over these steps
};

/// Work of the integrator since the start.
struct Counters {
  std::int64_t steps = 0, rejected_steps = 0, rate_evaluations = 0;
  LeftOut left_out;
};

struct SavedSim {
  Parameters parameters;
  Inputs inputs, slopes;
  std::shared_ptr<const Setup> setup;  ///< null before initialise()
  Snapshot snapshot;                   ///< with a setup only
  Counters counters;
};

// ---------------------------------------------------------------- to bytes and back

template <class A>
void transfer(A& archive, VehicleParameters& v) {
  transfer_members<VehicleParameters>(archive, v.mass, v.inertia, v.interface_position,
                                      v.interface_attitude, v.mass_includes_mechanism, v.position,
                                      v.velocity, v.attitude, v.angular_velocity);
}

template <class A>
void transfer(A& archive, DisturbanceNumbers& d) {
  transfer_members<DisturbanceNumbers>(archive, d.time, d.duration, d.force, d.torque);
}

template <class A>
void transfer(A& archive, Parameters& p) {
  transfer_members<Parameters>(
      archive, p.vehicle, p.contact_thrust, p.contact_thrust_delay, p.friction_coefficient,
      p.friction_model, p.restitution, p.restitution_speed, p.hardware_numbers, p.latch_overload,
      p.element_numbers, p.failure_active, p.failure_numbers, p.disturbance, p.model_level,
      p.flight, p.accuracy, p.solver_method, p.dae_form, p.step, p.rtol, p.atol_position,
      p.atol_velocity, p.atol_energy, p.coupling_mode, p.coupling_expected_step,
      p.coupling_velocity_tolerance);
}

template <class A>
void transfer(A& archive, Inputs& inputs) {
  const size_t legs = transfer_size(archive, inputs.leg_force_command.size());
  const size_t elements = transfer_size(archive, inputs.element_command.size());
  if constexpr (A::kReads) inputs.leg_force_command.resize(legs);
  if constexpr (A::kReads) inputs.element_command.resize(elements);
  for_each_value(inputs, [&](double& value) { transfer(archive, value); });
  transfer(archive, inputs.command);
  transfer(archive, inputs.hard_dock_command);
}

template <class A>
void transfer(A& archive, Setup& setup) {
  transfer_members<Setup>(archive, setup.parameters, setup.t_start, setup.tolerance);
}

template <class A>
void transfer(A& archive, Wrench<double>& wrench) {
  transfer_members<Wrench<double>>(archive, wrench.f, wrench.t);
}

template <class A>
void transfer(A& archive, VehicleState& s) {
  transfer_members<VehicleState>(archive, s.x, s.v, s.q, s.w);
}

template <class A>
void transfer(A& archive, Inputs::Vehicle& v) {
  transfer_members<Inputs::Vehicle>(archive, v.position, v.velocity, v.attitude, v.angular_velocity,
                                    v.force_ext, v.torque_ext);
}

template <class A>
void transfer(A& archive, HostFinding& f) {
  transfer_members<HostFinding>(archive, f.fault, f.value);
}

template <class A>
void transfer(A& archive, ResponseSums& r) {
  transfer_members<ResponseSums>(archive, r.left2, r.late2, r.change2, r.axis_change2,
                                 r.axis_product, r.product, r.error2, r.constant, r.time2,
                                 r.loaded);
}

template <class A>
void transfer(A& archive, ReportSums& s) {
  transfer_members<ReportSums>(archive, s.turn_error2, s.turn2, s.spin2, s.turn_errors,
                               s.first_angle, s.move_error2, s.point_matrix, s.point_side, s.move2,
                               s.move_velocity, s.velocity2, s.move_errors, s.force, s.torque,
                               s.first_load, s.unmodelled, s.unmodelled_time, s.unmodelled_sum2,
                               s.unmodelled_sum, s.held);
}

template <class A>
void transfer(A& archive, DrivenVehicle& v) {
  transfer_members<DrivenVehicle>(archive, v.received, v.predicted, v.held, v.pending, v.fall,
                                  v.work, v.innovation, v.error, v.input, v.finding);
}

template <class A>
void transfer(A& archive, CouplingPoint& p) {
  transfer_members<CouplingPoint>(archive, p.vehicle, p.known);
}

template <class A>
void transfer(A& archive, CouplingState& c) {
  transfer_members<CouplingState>(archive, c.vehicle, c.reports, c.work_residual, c.energy,
                                  c.host_work, c.created, c.suggestion, c.follows, c.regular_step,
                                  c.work, c.frequency, c.held_latches, c.warned);
}

template <class A>
void transfer(A& archive, QuiescentState& quiescent) {
  transfer_members<QuiescentState>(archive, quiescent.on, quiescent.since, quiescent.q,
                                   quiescent.spin, quiescent.slack);
}

template <class A>
void transfer(A& archive, LatchState& latch) {
  transfer_members<LatchState>(archive, latch.mode, latch.release_time);
}

template <class A>
void transfer(A& archive, SequenceState& s) {
  transfer_members<SequenceState>(archive, s.step, s.began, s.since, s.timed_out, s.outcome,
                                  s.was_captured, s.is_armed, s.thrust_since, s.command,
                                  s.held_since, s.stood, s.seen, s.instant, s.changes, s.visited);
}

template <class A>
void transfer(A& archive, LawSetting& law) {
  transfer_members<LawSetting>(archive, law.engagement, law.drive, law.is_held, law.since,
                               law.target, law.speed, law.acceleration, law.deceleration);
}

template <class A>
void transfer(A& archive, LateSettings::Entry& entry) {
  transfer_members<LateSettings::Entry>(archive, entry.arrival, entry.setting);
}

template <class A>
void transfer(A& archive, LateSettings& late) {
  transfer_members<LateSettings>(archive, late.count, late.entry);
}

template <class A>
void transfer(A& archive, ElementLock& lock) {
  transfer_members<ElementLock>(archive, lock.stiffness, lock.damping, lock.place);
}

template <class A>
void transfer(A& archive, HookRowState& row) {
  transfer_members<HookRowState>(archive, row.mode, row.since, row.end);
}

template <class A>
void transfer(A& archive, PusherState& pushers) {
  transfer_members<PusherState>(archive, pushers.on, pushers.since, pushers.share);
}

template <class A>
void transfer(A& archive, RigidJoint& joint) {
  transfer_members<RigidJoint>(archive, joint.on, joint.R, joint.p);
}

template <class A>
void transfer(A& archive, HardDockState& s) {
  transfer_members<HardDockState>(archive, s.command, s.row, s.closes, s.pushers, s.wants_joint,
                                  s.joint);
}

template <class A>
void transfer(A& archive, DiscreteState& d) {
  transfer_members<DiscreteState>(archive, d.latch, d.contacted, d.captured, d.time_of_contact,
                                  d.time_of_capture, d.thrust_on, d.phase, d.outcome, d.seated,
                                  d.seated_time, d.seen, d.hard_dock, d.sequence, d.law, d.late,
                                  d.lock, d.entered, d.disturbances);
}

template <class A>
void transfer(A& archive, Pose<double>& pose) {
  transfer_members<Pose<double>>(archive, pose.R, pose.p);
}

template <class A>
void transfer(A& archive, ContactMemory& m) {
  transfer_members<ContactMemory>(archive, m.has_reference, m.all, m.close, m.least_gap, m.radius,
                                  m.gap, m.near, m.near_gap, m.searched, m.closed, m.n_last,
                                  m.absorber);
}

template <class A>
void transfer(A& archive, LegBranch& branch) {
  transfer_members<LegBranch>(archive, branch.elbow, branch.flip);
}

template <class A>
void transfer(A& archive, LoopReference<double>& r) {
  transfer_members<LoopReference<double>>(archive, r.valid, r.q, r.H, r.sign, r.margin, r.branch,
                                          r.spin_branch);
}

template <class A>
void transfer(A& archive, Coordinates& c) {
  transfer_members<Coordinates>(archive, c.dependent, c.closure, c.pose);
}

/// An optional object.
template <class A, class T>
void transfer(A& archive, std::shared_ptr<const T>& pointer) {
  bool there = pointer != nullptr;
  transfer(archive, there);
  if (!there) {
    pointer.reset();
    return;
  }
  T value = pointer ? *pointer : T();
  transfer(archive, value);
  if constexpr (A::kReads) pointer = std::make_shared<const T>(std::move(value));
}

template <class A>
void transfer(A& archive, KeptJacobian& kept) {
  transfer_members<KeptJacobian>(archive, kept.valid, kept.step, kept.entries);
}

template <class A>
void transfer(A& archive, EvaluationContext& c) {
  transfer_members<EvaluationContext>(archive, c.discrete, c.memory, c.reference);
}

template <class A>
void transfer(A& archive, Loads& l) {
  transfer_members<Loads>(archive, l.force, l.torque, l.gravity, l.command);
}

template <class A>
void transfer(A& archive, Stepper::Pace& p) {
  transfer_members<Stepper::Pace>(archive, p.fastest_rate, p.stable, p.is_implicit, p.count, p.made,
                                  p.wait);
}

template <class A>
void transfer(A& archive, RunAhead& a) {
  transfer_members<RunAhead>(archive, a.pending, a.reached, a.begin, a.farthest, a.size, a.proposal,
                             a.last_error, a.pace, a.steps, a.jacobian, a.context, a.loads,
                             a.changes, a.is_retuned, a.is_mean_due, a.is_begin_known,
                             a.begin_point, a.y_before, a.pose_before, a.mean_known);
}

template <class A>
void transfer(A& archive, SimState& s) {
  transfer_members<SimState>(archive, s.elapsed, s.h_warm, s.last_step, s.inner_step, s.pace,
                             s.frame_velocity, s.frame_shift, s.discrete, s.memory, s.peaks,
                             s.mean_load, s.coupling, s.quiescent, s.margin_looked_at, s.limits,
                             s.warned_step_error, s.coordinates, s.kept_jacobian, s.ahead, s.drift,
                             s.energy_audit, s.momentum_audit);
}

template <class A>
void transfer(A& archive, Snapshot& snapshot) {
  transfer_members<Snapshot>(archive, snapshot.state, snapshot.y, snapshot.reference);
}

template <class A>
void transfer(A& archive, LeftOut& left) {
  transfer_members<LeftOut>(archive, left.quiescent_time, left.joined_time, left.booked_steps,
                            left.near_pairs);
}

template <class A>
void transfer(A& archive, Counters& c) {
  transfer_members<Counters>(archive, c.steps, c.rejected_steps, c.rate_evaluations, c.left_out);
}

template <class A>
void transfer(A& archive, SavedSim& saved) {
  transfer_members<SavedSim>(archive, saved.parameters, saved.inputs, saved.slopes, saved.setup,
                             saved.snapshot, saved.counters);
}

}  // namespace dockloop
