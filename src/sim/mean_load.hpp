// The constant load over a step that gives a vehicle exactly the linear and angular impulse of the
// true, varying load.
//
// A host holds a force in N axes and a torque in body axes. Meanwhile the vehicle moves and turns.
// Therefore the angular impulse about a fixed point O of the held load is X x F + RI T with
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

/// Mean of R over a step: Lobatto quadrature (5 points) of the cubic that has both attitudes and
/// both rates; error O(h^4) of the attitude between.
inline Mat3<double> find_mean_attitude(const VehicleState& a, const VehicleState& b, double h) {
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(a.q), b.q));
  // Rates of the rotation vector at both ends, per step: the series of the inverse of its Jacobian.
  const Vec3<double> first = h * a.w, w = h * b.w, lag = turn.cross(w);
  const Vec3<double> last = w + 0.5 * lag + turn.cross(lag) / 12.0;
  const auto attitude = [&](double s) {
    const double s2 = s * s, s3 = s2 * s;
    const Vec3<double> r =
        (3.0 * s2 - 2.0 * s3) * turn + (s - 2.0 * s2 + s3) * first + (s3 - s2) * last;
    return quat_to_matrix<double>(quat_multiply<double>(a.q, quat_exp<double>(r)));
  };
  constexpr double kNode = 0.32732683535398857;  // sqrt(3/7)/2
  return (quat_to_matrix<double>(a.q) + quat_to_matrix<double>(b.q)) / 20.0 +
         49.0 / 180.0 * (attitude(0.5 - kNode) + attitude(0.5 + kNode)) +
         16.0 / 45.0 * attitude(0.5);
}

/// Impulse and angular impulse about O of a constant load over a step.
/// @param load  force in axes of O, torque about the CoM in body axes
inline Wrench<double> find_delivered_impulse(const Wrench<double>& load, const VehicleState& a,
                                             const VehicleState& b, double h) {
  Wrench<double> impulse;
  impulse.f = h * load.f;
  impulse.t =
      h * (find_mean_position(a, b, h).cross(load.f) + find_mean_attitude(a, b, h) * load.t);
  return impulse;
}

/// A shorter step has no mean load: the rounding of momenta, divided by it, would be larger [s].
constexpr double kShortestMean = 1e-9;

/// The constant load with a given impulse; none in a step that is too short to have one.
/// @param impulse  linear, and angular about O, on the vehicle over the step
/// @return force in axes of O, torque about the CoM in body axes
inline Wrench<double> find_mean_load(const Wrench<double>& impulse, const VehicleState& a,
                                     const VehicleState& b, double h) {
  Wrench<double> mean;
  if (h < kShortestMean) return mean;
  mean.f = impulse.f / h;
  const Vec3<double> rest = impulse.t / h - find_mean_position(a, b, h).cross(mean.f);
  mean.t = find_mean_attitude(a, b, h).inverse() * rest;
  return mean;
}

}  // namespace dockloop
