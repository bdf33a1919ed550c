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
#include "sim/archive.hpp"
#include "sim/audit.hpp"
#include "sim/coupling.hpp"
#include "sim/limits.hpp"
#include "sim/peaks.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Peaks: loads, load ratio, forces on surfaces; then sizes of the forces along legs, for which no
/// step is searched.
constexpr int kFirstSurfacePeak = Outputs::kLoadCount + 1;
constexpr int kFirstLegPeak = kFirstSurfacePeak + kMaxSurfaces;
constexpr int kPeakCount = kFirstLegPeak + kMaxLegPeaks;

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
/// @param from  is copied next. An assignment drops the reserved lists that it lacks
inline void reserve(ContactMemory& memory, const ContactMemory& from, const ContactModel& contact) {
  memory.lists.resize(from.lists.size());
  for (size_t body = 0; body < memory.lists.size(); ++body) {
    memory.lists[body].reserve(contact.bodies[body].count);
  }
  const size_t pairs = contact.pairs.size();
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

  // Mean loads are computed when they are read.
  bool is_mean_due = false;
  CouplingPoint begin_point, end_point;  ///< where the last communication step began and ended
  Loads mean_known;                      ///< mean known loads over it
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
  PeakTracker<kPeakCount, kFirstLegPeak> peaks;
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
  double quiescent_time = 0.0;      ///< free drift with a quiescent mechanism [s]
  double joined_time = 0.0;         ///< with a rigid joint between the vehicles [s]
  double time_since_contact = 0.0;  ///< made with inner steps after first contact [s]
  std::int64_t booked_steps = 0;    ///< inner steps at which near pairs were counted
  std::int64_t near_pairs = 0;  ///< contact pairs near enough for a search, sum over these steps
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

}  // namespace dockloop
