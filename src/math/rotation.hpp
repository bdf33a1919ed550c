// Rotations: quaternions as plain 4-vectors (w, x, y, z), from body axes to outer axes.
//
// Eigen::Quaternion stores (x, y, z, w) and is not used, so there is only one order.
// q_AB belongs to R_AB, x_A = R_AB x_B, and composes as q_AC = q_AB (x) q_BC.
#pragma once

#include <cmath>

#include "math/types.hpp"

namespace dockloop {

/// Skew matrix: skew(a) b = a x b.
template <class S>
Mat3<S> skew(const Vec3<S>& a) {
  Mat3<S> m;
  m << S(0), -a.z(), a.y(), a.z(), S(0), -a.x(), -a.y(), a.x(), S(0);
  return m;
}

/// Product of quaternions, q_AC = q_AB (x) q_BC.
template <class S>
Vec4<S> quat_multiply(const Vec4<S>& a, const Vec4<S>& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
          a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
          a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

/// Conjugate, q_BA from q_AB (unit norm assumed).
template <class S>
Vec4<S> quat_conjugate(const Vec4<S>& q) {
  return {q[0], -q[1], -q[2], -q[3]};
}

/// Rotation matrix R_AB of q_AB. The norm of q does not matter (it is divided out), so stages of an
/// integrator may pass quaternions that are off unit norm by the local error.
template <class S>
Mat3<S> quat_to_matrix(const Vec4<S>& q) {
  const S s = S(2) / q.squaredNorm();
  const S w = q[0], x = q[1], y = q[2], z = q[3];
  Mat3<S> R;
  R << S(1) - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y),  //
      s * (x * y + w * z), S(1) - s * (x * x + z * z), s * (y * z - w * x),   //
      s * (x * z - w * y), s * (y * z + w * x), S(1) - s * (x * x + y * y);
  return R;
}

/// Unit quaternion of a rotation matrix, w >= 0 unless the angle is near pi (Shepperd 1978).
template <class S>
Vec4<S> quat_from_matrix(const Mat3<S>& R) {
  using std::sqrt;
  const S t = R.trace();
  Vec4<S> q;
  if (t >= R(0, 0) && t >= R(1, 1) && t >= R(2, 2)) {
    q << S(1) + t, R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1);
  } else if (R(0, 0) >= R(1, 1) && R(0, 0) >= R(2, 2)) {
    q << R(2, 1) - R(1, 2), S(1) + S(2) * R(0, 0) - t, R(0, 1) + R(1, 0), R(0, 2) + R(2, 0);
  } else if (R(1, 1) >= R(2, 2)) {
    q << R(0, 2) - R(2, 0), R(0, 1) + R(1, 0), S(1) + S(2) * R(1, 1) - t, R(1, 2) + R(2, 1);
  } else {
    q << R(1, 0) - R(0, 1), R(0, 2) + R(2, 0), R(1, 2) + R(2, 1), S(1) + S(2) * R(2, 2) - t;
  }
  q /= q.norm();
  if (q[0] < S(0)) q = -q;
  return q;
}

/// Time derivative of q_AB for w = w_AB_B [rad/s], body axes.
template <class S>
Vec4<S> quat_rate(const Vec4<S>& q, const Vec3<S>& w) {
  const Vec4<S> pure(S(0), w[0], w[1], w[2]);
  return quat_multiply<S>(q, pure) * S(0.5);
}

/// Quaternion of a rotation vector [rad] (exponential map).
template <class S>
Vec4<S> quat_exp(const Vec3<S>& r) {
  using std::cos;
  using std::sin;
  const S a = r.norm();
  const S k = a < S(1e-4) ? S(0.5) - a * a / S(48) : sin(a / S(2)) / a;
  return {cos(a / S(2)), k * r[0], k * r[1], k * r[2]};
}

/// Rotation vector [rad] of a unit quaternion, angle in [0, pi] (both signs of q are one attitude).
template <class S>
Vec3<S> quat_log(const Vec4<S>& q) {
  using std::atan2;
  const S sign = q[0] < S(0) ? S(-1) : S(1);
  const Vec3<S> u = q.template tail<3>() * sign;
  const S n = u.norm();
  const S k = n < S(1e-6) ? S(2) + n * n / S(3) : S(2) * atan2(n, sign * q[0]) / n;
  return u * k;
}

/// Rotation vector [rad] from one attitude to another, in axes of the first.
template <class S>
Vec3<S> find_turn(const Vec4<S>& from, const Vec4<S>& to) {
  return quat_log<S>(quat_multiply<S>(quat_conjugate<S>(from), to));
}

/// Rotation by `angle` given as (cos, sin) about a unit axis (Rodrigues).
template <class S>
Mat3<S> axis_rotation(const Vec3<S>& e, const S& c, const S& s) {
  const S d = S(1) - c;
  Mat3<S> R;
  R << c + d * e[0] * e[0], d * e[0] * e[1] - s * e[2], d * e[0] * e[2] + s * e[1],  //
      d * e[1] * e[0] + s * e[2], c + d * e[1] * e[1], d * e[1] * e[2] - s * e[0],   //
      d * e[2] * e[0] - s * e[1], d * e[2] * e[1] + s * e[0], c + d * e[2] * e[2];
  return R;
}

}  // namespace dockloop
