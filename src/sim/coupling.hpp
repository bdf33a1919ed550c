// Coupling with hosts that integrate a vehicle by themselves ("driven" vehicles).
//
// A host holds a constant load over a communication step and reports the motion of its vehicle at
// the end. The reported motion must not replace the internal motion for two reasons. The host used
// a mean load, not the true load. In a parallel master the load was announced before the step.
// Therefore:
//
//   internal vehicle   the simulation integrates its own copy of the driven vehicle together with
//                      all other bodies: inside a step nothing is held or extrapolated
//   innovation         reported motion minus predicted motion: only the innovation corrects the
//                      copy (0 if the host has the same mass and loads)
//   pending impulse    exerted impulse minus delivered impulse. Exerted: the change of the copy's
//                      momentum. Delivered: follows from the host's states. The sum of momentum of
//                      host and copy and pending impulse is constant to rounding
//   sequential         the simulation steps first; the host makes the same step with the mean load
//   parallel           both step at the same time: the load of the coming step is announced, from a
//                      look ahead on a copy of the state
//   host first         the host makes the step with the announced load, then the simulation
//                      makes its step and receives the motion at the end of the step
//   delay              loads reach the host late, or its motion comes back late, by a known time:
//                      a load is announced for the step in which it will act, from a look ahead
//                      over the delay and this step. A report is compared with the prediction for
//                      its time, then predicted up to now with the loads under way
//
// This file: the stored data of each driven vehicle, and functions of these data alone.
// host_coupling.hpp: the class that keeps them; coupling_monitors.cpp: its warnings and monitors.
// coupling.cpp: the scheme in a communication step.
#pragma once

#include "sim/host_diagnosis.hpp"
#include "sim/host_identification.hpp"
#include "sim/load_queue.hpp"
#include "sim/mean_load.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Data exchanged with the host of one driven vehicle, in frame O, which falls with gravity.
struct DrivenVehicle {
  VehicleState received;   ///< the last report: the start of the last step, without a delay
  double since = 0.0;      ///< time of this report [s since start]
  VehicleState predicted;  ///< of the host at the time of the next report, a step later
  Wrench<double> held;     ///< load that the host held between: force (axes of O), torque (body)
  VehicleState before;  ///< of the host at the start of the last step, from all reports until then
  VehicleState now;     ///< the same at the present communication point
  Wrench<double> load;  ///< mean load that the host held over the last step
  LoadQueue queue;      ///< with a delay
  LoadQueue known;      ///< known loads of the host since the last report, if motion is late
  Wrench<double> pending;  ///< impulse, angular impulse about O: exerted until now, and not yet
                           ///< delivered at `received`
  Vec3<double> fall = Vec3<double>::Zero();  ///< change of velocity by gravity over it [m/s]
  double work = 0.0;          ///< of the mechanism on the internal vehicle over the last step [J]
  double innovation = 0.0;    ///< of the velocity at the interface, at `received` [m/s]
  double error = 0.0;         ///< of the last step, at the interface [m/s]
  Inputs::Vehicle input;      ///< inputs that `received` comes from
  bool has_moved = false;     ///< a report after the first one differs from it
  VehicleBody stated;         ///< by parameters
  VehicleBody body;           ///< that predictions use: as stated, or as identified
  VehicleState by_stated;     ///< as `predicted`, of the stated body
  Wrench<double> mean_known;  ///< mean known load of the host over the last step, as `held`
  double mean_error = 0.0;    ///< of the velocity within it, because that load is a mean [m/s]
  MassEstimate estimate;
  double restated = 0.0;  ///< time from which `stated` holds [s since start]
  double interval = 0.0;  ///< between `received` and the next report [s]
  HostFinding finding;    ///< the first cause of reports that do not fit
};

/// Warnings that are issued once.
enum CouplingWarning { kWarnedNorm = 1, kWarnedEnergy = 2, kWarnedLookAhead = 4, kWarnedDelay = 8 };

/// Start or end of an integration: motion, and impulses of the known loads of hosts until then.
struct CouplingPoint {
  std::array<VehicleState, 2> vehicle;
  std::array<Wrench<double>, 2> known;
};

struct CouplingState {
  std::array<DrivenVehicle, 2> vehicle;
  std::vector<ReportSums> reports;  ///< of both vehicles; empty without a host
  double work_residual = 0.0;       ///< [J]
  double energy = 0.0;              ///< largest of everything inside so far, in frame O [J]
  double host_work = 0.0;           ///< of corrections by hosts that count in `energy` [J]
  std::array<double, 8> created{};  ///< changes of work_residual in the last steps, newest first
  double suggestion = 0.0;    ///< step of announced loads, if the host follows suggestions [s]
  bool follows = false;       ///< the host makes the suggested steps
  double regular_step = 0.0;  ///< longest of the last few steps [s]
  std::int64_t work = 0;      ///< of the last step, in evaluations
  double frequency =
      0.0;               ///< of the docking interface at the last latch event [rad/s], 0 = unknown
  int held_latches = 0;  ///< then
  std::array<int, 2> warned{0, 0};
};

inline bool is_same_body(const VehicleBody& a, const VehicleBody& b) {
  return a.mass == b.mass && a.com == b.com && a.inertia == b.inertia;
}

/// `z` moved like `from` -> `to`: positions by addition, attitudes by composition.
inline VehicleState carry_along(const VehicleState& z, const VehicleState& from,
                                const VehicleState& to) {
  VehicleState moved;
  moved.x = z.x + (to.x - from.x);
  moved.v = z.v + (to.v - from.v);
  moved.w = z.w + (to.w - from.w);
  moved.q = quat_multiply<double>(z.q, quat_multiply<double>(quat_conjugate<double>(from.q), to.q))
                .normalized();
  return moved;
}

/// Motion of a point of the same body. @param arm  of the point, body axes [m]
inline VehicleState move_origin(const VehicleState& s, const Vec3<double>& arm) {
  const Mat3<double> R = quat_to_matrix<double>(s.q);
  VehicleState moved = s;
  moved.x += R * arm;
  moved.v += R * s.w.cross(arm);
  return moved;
}

/// Momentum of a rigid body, axes of O, angular part about O.
inline Wrench<double> find_rigid_momentum(const VehicleBody& body, const VehicleState& s) {
  const VehicleState centre = move_origin(s, body.com);
  Wrench<double> momentum;
  momentum.f = body.mass * centre.v;
  momentum.t =
      centre.x.cross(momentum.f) + quat_to_matrix<double>(s.q) * Vec3<double>(body.inertia * s.w);
  return momentum;
}

inline double find_rigid_energy(const VehicleBody& body, const VehicleState& s) {
  const Vec3<double> v = move_origin(s, body.com).v;
  return 0.5 * (body.mass * v.squaredNorm() + s.w.dot(body.inertia * s.w));
}

}  // namespace dockloop
