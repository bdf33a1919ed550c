// Maps of motion and inertia of a rigid body as matrices, for (v, w) and (f, t).
#pragma once

#include "docking/docking_model.hpp"
#include "math/decompositions.hpp"

namespace dockloop {

/// Velocity (v, w) of a point of a body, in axes R, from that of its origin in body axes.
/// @param arm  from the origin to the point, body axes
inline Mat6<double> make_transfer(const Mat3<double>& R, const Vec3<double>& arm) {
  Mat6<double> map = Mat6<double>::Zero();
  map.topLeftCorner<3, 3>() = R;
  map.bottomRightCorner<3, 3>() = R;
  map.topRightCorner<3, 3>() = -R * skew<double>(arm);
  return map;
}

/// Inertia of a rigid body about the origin of its axes.
inline Mat6<double> make_inertia(const VehicleBody& body) {
  Mat6<double> A = Mat6<double>::Zero();
  const Mat3<double> h = body.mass * skew<double>(body.com);
  A.topLeftCorner<3, 3>() = body.mass * Mat3<double>::Identity();
  A.topRightCorner<3, 3>() = -h;
  A.bottomLeftCorner<3, 3>() = h;
  A.bottomRightCorner<3, 3>() = body.inertia - h * skew<double>(body.com);
  return A;
}

/// Its inverse: motion of the origin per impulse there.
inline Mat6<double> make_mobility(const VehicleBody& body) {
  Mat6<double> inverse = Mat6<double>::Identity() / body.mass;
  inverse.bottomRightCorner<3, 3>() = invert(body.inertia);
  const Mat6<double> from_com = make_transfer(Mat3<double>::Identity(), -body.com);
  return from_com * inverse * from_com.transpose();
}

}  // namespace dockloop
