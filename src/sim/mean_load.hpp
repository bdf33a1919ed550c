// The constant load that, held over a whole step, gives a vehicle exactly the linear and angular
// impulse that the true, varying load gave it.
//
// A host holds a force in N axes and a torque in body axes. While it does so the vehicle moves and
// turns, so the angular impulse about a fixed point O of the held load is X x F + RI T with
// X = integral of the position from O and RI = integral of the attitude matrix over the step.
#pragma once

#include "math/rotation.hpp"

namespace dockloop {

/// Motion of a vehicle at one end of a step, axes of O.
struct VehicleState {
  Vec3<double> x = Vec3<double>::Zero();  ///< CoM from O [m]
  Vec3<double> v = Vec3<double>::Zero();  ///< [m/s]
  Vec4<double> q{1, 0, 0, 0};             ///< body to O
  Vec3<double> w = Vec3<double>::Zero();  ///< body axes [rad/s]
};

/// Mean of x over a step of constant force [m].
inline Vec3<double> find_mean_position(const VehicleState& a, const VehicleState& b, double h) {
  return 0.5 * (a.x + b.x) + h / 12.0 * (a.v - b.v);
}

/// Mean of R over a step: Simpson with the Hermite middle attitude, error O(h^4).
inline Mat3<double> find_mean_attitude(const VehicleState& a, const VehicleState& b, double h) {
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(a.q), b.q));
  const Vec3<double> middle =
      0.5 * turn + h / 8.0 * (a.w - b.w - turn.cross(Vec3<double>(0.5 * b.w)));
  const Mat3<double> R_middle =
      quat_to_matrix<double>(quat_multiply<double>(a.q, quat_exp<double>(middle)));
  return (quat_to_matrix<double>(a.q) + 4.0 * R_middle + quat_to_matrix<double>(b.q)) / 6.0;
}

/// @param impulse  linear, and angular about O, given to the vehicle over the step
/// @return force in axes of O, torque about the CoM in body axes
inline Wrench<double> find_mean_load(const Wrench<double>& impulse, const VehicleState& a,
                                     const VehicleState& b, double h) {
  Wrench<double> mean;
  mean.f = impulse.f / h;
  const Vec3<double> rest = impulse.t / h - find_mean_position(a, b, h).cross(mean.f);
  mean.t = find_mean_attitude(a, b, h).inverse() * rest;
  return mean;
}

}  // namespace dockloop
