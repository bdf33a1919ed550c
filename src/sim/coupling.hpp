// Coupling with hosts that integrate a vehicle by themselves ("driven" vehicles).
//
// A host holds a constant load over a communication step and tells where its vehicle is at the
// end. Feeding that back as it stands is wrong in two ways: the host moved under a mean, not under
// the true load, and in a parallel master under a load announced before the step. Therefore:
//
//   internal vehicle   the simulation keeps its own copy of the driven vehicle and integrates it
//                      with everything else: inside a step nothing is held or extrapolated
//   innovation         what the host tells less what was predicted of it: only this corrects the
//                      copy (0 if the host has the same mass and loads)
//   ledger             impulse that the mechanism exerted and the host was not yet given. Exerted
//                      is the change of the copy's momentum, delivered follows from the host's
//                      states; momentum of host, inside and ledger is constant to rounding
//   sequential         the simulation steps first; the host makes the same step with the mean load
//   parallel           both step at once: the load of the coming step is announced, from a look
//                      ahead on a copy that is dropped
//
// This file: what is kept of each driven vehicle, and the arithmetic of states that depends on
// nothing else. coupling.cpp: the scheme; coupling_monitors.cpp: what the host should know.
#pragma once

#include "sim/mean_load.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Sums over the steps of one vehicle, forgotten with time.
struct InnovationSums {
  double predicted2 = 0.0;            ///< changes of velocity as predicted, gravity apart [m2/s2]
  double innovation_predicted = 0.0;  ///< innovation times these [m2/s2]
  double innovation2 = 0.0;           ///< [m2/s2]
  double shifted2 = 0.0;  ///< what remains if the load of the step beside was applied [m2/s2]
  /// The same of angular velocities: predicted2, innovation_predicted, innovation2 [rad2/s2]
  double turn2 = 0.0, innovation_turn = 0.0, turn_innovation2 = 0.0;
  int loaded = 0;                             ///< steps with a change that can be seen
  int unmodelled = 0;  ///< steps in a row with an innovation that no load explains
};

/// What was told to and by the host of one driven vehicle. Frame O, which falls with gravity.
struct DrivenVehicle {
  VehicleState received;   ///< at the start of the last step
  VehicleState predicted;  ///< of the host at its end
  Wrench<double> held;     ///< load that the host held over it: force (axes of O), torque (body)
  Wrench<double> before;   ///< the same, a step earlier
  Wrench<double> pending;  ///< ledger: impulse, angular impulse about O, as of `received`
  Vec3<double> fall = Vec3<double>::Zero();  ///< change of velocity by gravity over it [m/s]
  double work = 0.0;        ///< of the mechanism on the internal vehicle over the last step [J]
  double innovation = 0.0;  ///< of the velocity at the interface, at `received` [m/s]
  double error = 0.0;       ///< of the last step, at the interface [m/s]
  Inputs::Vehicle told;     ///< inputs that `received` comes from
  InnovationSums sums;
};

/// Things that are told once.
enum CouplingWarning {
  kToldLate = 1,
  kToldOrder = 2,
  kToldGravity = 4,
  kToldMass = 8,
  kToldNorm = 16,
  kToldStep = 32,
  kToldFirst = 64,
  kToldLookAhead = 128,
  kToldNoForce = 256,
  kToldNoTorque = 512,
  kToldNoTorqueExt = 1024,
};

/// One end of an integration: motion, and impulses that hosts gave by themselves until then.
struct CouplingPoint {
  std::array<VehicleState, 2> vehicle;
  std::array<Wrench<double>, 2> told;
};

struct CouplingState {
  std::array<DrivenVehicle, 2> vehicle;
  double work_residual = 0.0;  ///< [J]
  double suggestion = 0.0;     ///< step that loads are announced for, to a host that follows [s]
  bool follows = false;        ///< the host makes the steps that are suggested
  double regular_step = 0.0;   ///< longest of the last few steps [s]
  std::int64_t work = 0;       ///< of the last step, in evaluations
  double frequency = 0.0;      ///< of the interface when a latch last changed [rad/s], 0 = unknown
  int held_latches = 0;        ///< then
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
