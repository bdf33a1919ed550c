// The floor: the hexapod of hexapod_bench reduced by hand, in plain scalar C++.
//
// What a specialist would write for this one mechanism and no other: a ring on R2P1R3 legs whose
// bodies are axisymmetric, base fixed, no gravity. Each leg acts on the ring like a mass at its tip
// (an apparent mass, three numbers in the axes of the leg) and a force; the ring is then six linear
// equations. No tables, no loops over a tree, no trigonometry. How much faster than this a general
// code can be is a question of vector instructions; how much slower, of its overhead.
// tests/unit/hand_written_test.cpp holds it to the core.
//
// Leg axes: x along the leg (u), z the second axis of the universal joint, y = z x x. Angles p1, p2
// about the first axis (fixed in the base) and z; xi is the distance between the ends. Rates of a
// quantity q are written dq.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

class HandWrittenHexapod {
 public:
  using V3 = Eigen::Vector3d;
  static constexpr int kLegs = 6;
  /// position (3) and quaternion w x y z (4) of the ring, its velocity and angular velocity, all in
  /// base axes
  static constexpr int kStates = 13;
  struct Reactions {
    std::array<V3, kLegs> cut_force;             ///< on the leg, base axes [N]
    V3 force = V3::Zero(), torque = V3::Zero();  ///< on the base, about its origin [N], [N m]
  };

  /// @param mechanism  hexapod_bench: the ring is its first body, then come six legs
  explicit HandWrittenHexapod(const Mechanism& mechanism) {
    const MechanismModel& model = mechanism.model;
    const Body& ring = model.bodies[0];
    ring_mass_ = ring.mass;
    ring_inertia_ = ring.inertia.diagonal();
    for (int i = 0; i < kLegs; ++i) {  // legs as read_mechanism() makes them: all alike, x along
      const Loop& loop = model.loops[i];
      const Body &cross = model.bodies[loop.first], &cylinder = model.bodies[loop.first + 1],
                 &rod = model.bodies[loop.terminal];
      const Mat3<double>& axes = cross.placement.R;
      legs_[i] = {cross.placement.p, loop.point_on_closing, axes.col(0),
                  axes.col(1),       axes.col(2),           loop.point_on_terminal[0]};
      m1_ = cylinder.mass;
      m2_ = rod.mass;
      c1_ = cylinder.com[0];
      delta_ = legs_[i].home_length - rod.com[0];
      axial_ = cylinder.inertia(0, 0) + rod.inertia(0, 0);
      transverse_ = cylinder.inertia(1, 1) + rod.inertia(1, 1) + m1_ * c1_ * c1_;
      stiffness_ = model.forces[model.legs[i].force].stiffness;
      damping_ = model.forces[model.legs[i].force].damping;
    }
  }

  /// State of the ring as the core has found it. @pre calc_velocity
  static void get_state(const TreeData<double>& tree, double* y) {
    const Vec4<double> quat = tree.q.segment<4>(3);
    for (int i = 0; i < 3; ++i) {
      y[i] = tree.p[0][i];
      y[7 + i] = tree.u[0][i];
      y[10 + i] = tree.w[0][i];
    }
    for (int i = 0; i < 4; ++i) y[3 + i] = quat[i];
  }

  /// Rates of the state; with `reactions` also the cut forces and the load on the base.
  template <bool kReactions = false>
  void calc_rates(const double* y, double* dy, Reactions* reactions = nullptr) {
    const V3 p(y[0], y[1], y[2]), v(y[7], y[8], y[9]), w(y[10], y[11], y[12]);
    const double qw = y[3], qx = y[4], qy = y[5], qz = y[6];
    const double scale = 2.0 / (qw * qw + qx * qx + qy * qy + qz * qz);
    Eigen::Matrix3d R;
    R << 1 - scale * (qy * qy + qz * qz), scale * (qx * qy - qw * qz), scale * (qx * qz + qw * qy),
        scale * (qx * qy + qw * qz), 1 - scale * (qx * qx + qz * qz), scale * (qy * qz - qw * qx),
        scale * (qx * qz - qw * qy), scale * (qy * qz + qw * qx), 1 - scale * (qx * qx + qy * qy);

    // The ring alone, about its centre: inertia in base axes and gyroscopic moment.
    double axx = ring_mass_, axy = 0, axz = 0, ayy = ring_mass_, ayz = 0, azz = ring_mass_;
    Eigen::Matrix3d K = Eigen::Matrix3d::Zero();
    const Eigen::Matrix3d D0 = R * ring_inertia_.asDiagonal() * R.transpose();
    double dxx = D0(0, 0), dxy = D0(0, 1), dxz = D0(0, 2), dyy = D0(1, 1), dyz = D0(1, 2),
           dzz = D0(2, 2);
    V3 f = V3::Zero(), n = -w.cross(D0 * w);

    for (int i = 0; i < kLegs; ++i) {
      const Leg& leg = legs_[i];
      Tip& t = tips_[i];
      // Pose of the leg.
      t.s = R * leg.ring;
      const V3 L = p + t.s - leg.base;
      const double lx = L.dot(leg.x0), ly = L.dot(leg.y0), lz = L.dot(leg.z0);
      const double r2 = lx * lx + lz * lz, r = std::sqrt(r2), xi = std::sqrt(r2 + ly * ly);
      const double per_r = 1.0 / r, per_xi = 1.0 / xi;
      const double cos1 = lx * per_r, sin1 = -lz * per_r, c2 = r * per_xi, s2 = ly * per_xi;
      t.u = L * per_xi;
      t.z = sin1 * leg.x0 + cos1 * leg.z0;
      t.y = t.z.cross(t.u);
      // Rates of its coordinates.
      const V3 ws = w.cross(t.s), vt = v + ws;
      const double dp3 = t.u.dot(vt), dp2 = t.y.dot(vt) * per_xi;
      const double per_arm = 1.0 / r;  // xi c2 = r
      const double dp1 = -t.z.dot(vt) * per_arm;
      // Apparent mass.
      const double lever = xi - delta_, m2_lever = m2_ * lever;
      const double jt = transverse_ + m2_lever * lever;
      t.mass_y = jt * per_xi * per_xi;
      t.mass_z = (axial_ * s2 * s2 + jt * c2 * c2) * per_arm * per_arm;
      // Acceleration of the tip at zero joint accelerations, less that of the ring at zero ones.
      const double c2dp1 = c2 * dp1, turn = c2dp1 * c2dp1 + dp2 * dp2, s2dp1 = s2 * dp1;
      const double wx = -xi * turn, wy = 2.0 * dp3 * dp2 + xi * s2dp1 * c2dp1,
                   wz = 2.0 * (xi * s2dp1 * dp2 - dp3 * c2dp1);
      t.centripetal = w.cross(ws);
      const double gx = t.u.dot(t.centripetal) - wx, gy = t.y.dot(t.centripetal) - wy,
                   gz = t.z.dot(t.centripetal) - wz;
      // Force on the leg at zero acceleration of the ring.
      const double nu1 = 2.0 * c2dp1 * (s2 * (axial_ - jt) * dp2 + m2_lever * c2 * dp3);
      const double nu2 = 2.0 * m2_lever * dp2 * dp3 - (axial_ - jt) * s2dp1 * c2dp1;
      const double nu3 = -m2_lever * turn;
      const double axial_force = -stiffness_ * (xi - leg.home_length) - damping_ * dp3;
      const double fx = m2_ * gx + nu3 - axial_force, fy = t.mass_y * gy + nu2 * per_xi,
                   fz = t.mass_z * gz - nu1 * per_arm;
      t.force = fx * t.u + fy * t.y + fz * t.z;
      f -= t.force;
      n -= t.s.cross(t.force);
      // Apparent mass in base axes: mass_y 1 + (m2 - mass_y) u u' + (mass_z - mass_y) z z'.
      const V3 a = (m2_ - t.mass_y) * t.u, b = (t.mass_z - t.mass_y) * t.z;
      const double xx = t.mass_y + a[0] * t.u[0] + b[0] * t.z[0],
                   xy = a[0] * t.u[1] + b[0] * t.z[1], xz = a[0] * t.u[2] + b[0] * t.z[2],
                   yy = t.mass_y + a[1] * t.u[1] + b[1] * t.z[1],
                   yz = a[1] * t.u[2] + b[1] * t.z[2],
                   zz = t.mass_y + a[2] * t.u[2] + b[2] * t.z[2];
      axx += xx, axy += xy, axz += xz, ayy += yy, ayz += yz, azz += zz;
      const double sx = t.s[0], sy = t.s[1], sz = t.s[2];
      const double kxx = sy * xz - sz * xy, kxy = sy * yz - sz * yy, kxz = sy * zz - sz * yz;
      const double kyx = sz * xx - sx * xz, kyy = sz * xy - sx * yz, kyz = sz * xz - sx * zz;
      const double kzx = sx * xy - sy * xx, kzy = sx * yy - sy * xy, kzz = sx * yz - sy * xz;
      K(0, 0) += kxx, K(0, 1) += kxy, K(0, 2) += kxz;
      K(1, 0) += kyx, K(1, 1) += kyy, K(1, 2) += kyz;
      K(2, 0) += kzx, K(2, 1) += kzy, K(2, 2) += kzz;
      dxx += sy * kxz - sz * kxy;
      dxy += sz * kxx - sx * kxz;
      dxz += sx * kxy - sy * kxx;
      dyy += sz * kyx - sx * kyz;
      dyz += sx * kyy - sy * kyx;
      dzz += sx * kzy - sy * kzx;
    }

    // Six equations, symmetric and positive: A = L D L', rows a then alpha.
    double m[6][6] = {{axx}, {axy, ayy}, {axz, ayz, azz}, {}, {}, {}};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) m[3 + i][j] = K(i, j);
    }
    m[3][3] = dxx, m[4][3] = dxy, m[4][4] = dyy, m[5][3] = dxz, m[5][4] = dyz, m[5][5] = dzz;
    double x[6] = {f[0], f[1], f[2], n[0], n[1], n[2]}, per_d[6];
    for (int j = 0; j < 6; ++j) {
      double scaled[6] = {};
      for (int k = 0; k < j; ++k) {
        scaled[k] = m[j][k] * m[k][k];
        m[j][j] -= m[j][k] * scaled[k];
      }
      per_d[j] = 1.0 / m[j][j];
      for (int i = j + 1; i < 6; ++i) {
        for (int k = 0; k < j; ++k) m[i][j] -= m[i][k] * scaled[k];
        m[i][j] *= per_d[j];
      }
      for (int k = 0; k < j; ++k) x[j] -= m[j][k] * x[k];
    }
    for (int j = 5; j >= 0; --j) {
      x[j] *= per_d[j];
      for (int i = j + 1; i < 6; ++i) x[j] -= m[i][j] * x[i];
    }

    dy[0] = v[0], dy[1] = v[1], dy[2] = v[2];
    dy[3] = -0.5 * (w[0] * qx + w[1] * qy + w[2] * qz);
    dy[4] = 0.5 * (w[0] * qw + w[1] * qz - w[2] * qy);
    dy[5] = 0.5 * (w[1] * qw + w[2] * qx - w[0] * qz);
    dy[6] = 0.5 * (w[2] * qw + w[0] * qy - w[1] * qx);
    for (int i = 0; i < 6; ++i) dy[7 + i] = x[i];
    if constexpr (kReactions) calc_reactions(p, v, w, dy, *reactions);
  }

 private:
  struct Leg {
    V3 base, ring;       ///< ends: base axes; ring axes [m]
    V3 x0, y0, z0;       ///< leg at home, first axis, second axis at home; base axes
    double home_length;  ///< [m]
  };
  struct Tip {
    V3 s, u, y, z;          ///< ring point from the ring's centre; leg axes; base axes
    V3 force, centripetal;  ///< on the leg at zero acceleration; w x (w x s)
    double mass_y, mass_z;  ///< apparent mass across the leg; along it, it is that of the rod
  };

  /// From the accelerations of the ring: what each leg feels at its tip, and what is left for the
  /// base when its own momentum has taken its share.
  void calc_reactions(const V3& p, const V3& v, const V3& w, const double* dy, Reactions& out) {
    const V3 a(dy[7], dy[8], dy[9]), alpha(dy[10], dy[11], dy[12]);
    out.force.setZero();
    out.torque.setZero();
    for (int i = 0; i < kLegs; ++i) {
      const Leg& leg = legs_[i];
      const Tip& t = tips_[i];
      const V3 moved = a + alpha.cross(t.s);
      const double fx = t.u.dot(moved), fy = t.y.dot(moved), fz = t.z.dot(moved);
      const V3 force = t.force + m2_ * fx * t.u + t.mass_y * fy * t.y + t.mass_z * fz * t.z;
      out.cut_force[i] = force;
      // Motion of u, from that of the tip.
      const V3 L = p + t.s - leg.base, vt = v + w.cross(t.s), at = moved + t.centripetal;
      const double xi = L.dot(t.u), per_xi = 1.0 / xi, dxi = t.u.dot(vt);
      const V3 du = (vt - dxi * t.u) * per_xi;
      const double ddxi = t.u.dot(at) + xi * du.squaredNorm();
      const V3 ddu = (at - ddxi * t.u - 2.0 * dxi * du) * per_xi;
      const V3 on_base =
          force - (m1_ * c1_ + m2_ * (xi - delta_)) * ddu - m2_ * (ddxi * t.u + 2.0 * dxi * du);
      // The universal joint passes a moment across its two axes: what the axial spin needs.
      const double s2 = t.u.dot(leg.y0), c2 = t.z.cross(t.u).dot(leg.y0);
      const double dp1 = -t.z.dot(du) / c2, dp2 = t.y.dot(du);
      const double ddp1 = (-t.z.dot(ddu) + 2.0 * s2 * dp1 * dp2) / c2;
      const double moment = axial_ * (ddp1 * s2 / c2 + dp1 * dp2);
      out.force += on_base;
      out.torque += leg.base.cross(on_base) - moment * leg.y0.cross(t.z);
    }
  }

  std::array<Leg, kLegs> legs_;
  std::array<Tip, kLegs> tips_;
  double ring_mass_ = 0.0, stiffness_ = 0.0, damping_ = 0.0;
  V3 ring_inertia_ = V3::Zero();
  double m1_ = 0.0, m2_ = 0.0, c1_ = 0.0;  ///< masses; base joint to com of the cylinder
  double delta_ = 0.0;                     ///< com of the rod to the ring joint
  double axial_ = 0.0, transverse_ = 0.0;  ///< both bodies; the rod without its way to the base
};

}  // namespace dockloop
