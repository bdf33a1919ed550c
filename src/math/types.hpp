// Fixed-size vectors, poses, twists and wrenches, generic in the scalar type.
//
// Every other module uses these types. `S` is `double` in the FMU. Reference solutions and tests
// use twice the digits; dual numbers give derivatives. Do not store an expression in `auto`: Eigen
// expressions refer to temporaries.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>  // cross products
#include <cmath>

#include "math/vector_operators.hpp"

namespace dockloop {

template <class S>
using Vec3 = Eigen::Matrix<S, 3, 1>;
template <class S>
using Vec4 = Eigen::Matrix<S, 4, 1>;
template <class S>
using Vec6 = Eigen::Matrix<S, 6, 1>;
template <class S>
using Vec7 = Eigen::Matrix<S, 7, 1>;
template <class S>
using Mat3 = Eigen::Matrix<S, 3, 3>;
template <class S>
using Mat6 = Eigen::Matrix<S, 6, 6>;
template <class S>
using VecX = Eigen::Matrix<S, Eigen::Dynamic, 1>;
template <class S>
using MatX = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

/// Pose of frame B in frame A: x_A = R * x_B + p, with R = R_AB [-] and p = p_AB_A [m].
template <class S>
struct Pose {
  Mat3<S> R = Mat3<S>::Identity();
  Vec3<S> p = Vec3<S>::Zero();
};

/// Angular velocity w [rad/s] and velocity v [m/s] of a frame; the user of a Twist names the axes.
template <class S>
struct Twist {
  Vec3<S> w = Vec3<S>::Zero();
  Vec3<S> v = Vec3<S>::Zero();
};

/// Force f [N] and moment t [N m] about a point; the user of a Wrench names the point and the axes.
template <class S>
struct Wrench {
  Vec3<S> f = Vec3<S>::Zero();
  Vec3<S> t = Vec3<S>::Zero();
};

/// Of wrenches about the same point, in the same axes.
template <class S>
Wrench<S>& operator+=(Wrench<S>& a, const Wrench<S>& b) {
  a.f += b.f;
  a.t += b.t;
  return a;
}
template <class S>
Wrench<S>& operator-=(Wrench<S>& a, const Wrench<S>& b) {
  a.f -= b.f;
  a.t -= b.t;
  return a;
}
template <class S>
Wrench<S> operator+(Wrench<S> a, const Wrench<S>& b) {
  return a += b;
}
template <class S>
Wrench<S> operator-(Wrench<S> a, const Wrench<S>& b) {
  return a -= b;
}
template <class S>
Wrench<S> operator*(const S& factor, const Wrench<S>& a) {
  return {factor * a.f, factor * a.t};
}
/// In other axes.
template <class S>
Wrench<S> operator*(const Mat3<S>& R, const Wrench<S>& a) {
  return {R * a.f, R * a.t};
}

/// Length of (a, b). A plain formula: quantities of a docking neither overflow nor underflow, and
/// hypot would need a newer C library.
template <class S>
S find_length(const S& a, const S& b) {
  using std::sqrt;
  return sqrt(a * a + b * b);
}

/// Symmetric matrix from its components in the order xx yy zz xy xz yz.
inline Mat3<double> make_symmetric(const Vec6<double>& i) {
  Mat3<double> m;
  m << i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2];
  return m;
}

/// The components of a symmetric matrix, in the same order.
template <class S>
Vec6<S> get_components(const Mat3<S>& m) {
  Vec6<S> i;
  i << m(0, 0), m(1, 1), m(2, 2), m(0, 1), m(0, 2), m(1, 2);
  return i;
}

/// Inertia of a mass at a point, about the origin. @param c  the point [m]
template <class S>
Mat3<S> find_point_inertia(const S& mass, const Vec3<S>& c) {
  return mass * (c.squaredNorm() * Mat3<S>::Identity() - c * c.transpose());
}

/// pose_AC = pose_AB * pose_BC.
template <class S>
Pose<S> operator*(const Pose<S>& AB, const Pose<S>& BC) {
  return {AB.R * BC.R, AB.R * BC.p + AB.p};
}

/// pose_BA from pose_AB.
template <class S>
Pose<S> inverse(const Pose<S>& AB) {
  return {AB.R.transpose(), -(AB.R.transpose() * AB.p)};
}

}  // namespace dockloop
