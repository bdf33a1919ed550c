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
//
// This file: the stored data of each driven vehicle, and functions of these data alone.
// host_coupling.hpp: the class that keeps them; coupling_monitors.cpp: its warnings and monitors.
// coupling.cpp: the scheme in a communication step.
#pragma once

#include "sim/host_diagnosis.hpp"
#include "sim/mean_load.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Data exchanged with the host of one driven vehicle, in frame O, which falls with gravity.
struct DrivenVehicle {
  VehicleState received;   ///< at the start of the last step
  VehicleState predicted;  ///< of the host at its end
  Wrench<double> held;     ///< load that the host held over it: force (axes of O), torque (body)
  Wrench<double> pending;  ///< impulse, angular impulse about O, at `received`
  Vec3<double> fall = Vec3<double>::Zero();  ///< change of velocity by gravity over it [m/s]
  double work = 0.0;        ///< of the mechanism on the internal vehicle over the last step [J]
  double innovation = 0.0;  ///< of the velocity at the interface, at `received` [m/s]
  double error = 0.0;       ///< of the last step, at the interface [m/s]
  Inputs::Vehicle input;    ///< inputs that `received` comes from
  HostFinding finding;      ///< the first cause of reports that do not fit
};

/// Warnings that are issued once.
enum CouplingWarning { kWarnedNorm = 1, kWarnedEnergy = 2, kWarnedLookAhead = 4 };

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

/// Momentum of a rigid body, axes of O, angular part about O.
inline Wrench<double> find_rigid_momentum(double mass, const Mat3<double>& inertia,
                                          const VehicleState& s) {
  Wrench<double> momentum;
  momentum.f = mass * s.v;
  momentum.t = s.x.cross(momentum.f) + quat_to_matrix<double>(s.q) * Vec3<double>(inertia * s.w);
  return momentum;
}

inline double find_rigid_energy(double mass, const Mat3<double>& inertia, const VehicleState& s) {
  return 0.5 * (mass * s.v.squaredNorm() + s.w.dot(inertia * s.w));
}

}  // namespace dockloop
