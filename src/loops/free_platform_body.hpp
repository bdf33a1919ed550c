// A platform on a free joint, on the base or on one free body, when nothing else is in the tree:
// the reduced equations without recursions and blocks, each body in its own axes. See
// leg_platforms.hpp.
//
// R is the root and C the platform. M_C is the inertia of C in its own axes, X carries a momentum
// from C to R. What legs add is called apparent and carried in LEGS.md.
//
//   | M_R + X M_C X^T + frozen legs     X M_C + carried |   velocities of R
//   |                     symmetric      M_C + apparent |   velocities of C relative to R
#pragma once

#include "loops/leg_platforms.hpp"
#include "loops/leg_store_body.hpp"

namespace dockloop {

namespace {

/// Mass, first moment and inertia about the origin of a body, its own axes.
template <class S>
struct OwnInertia {
  S mass;
  Vec3<S> h;
  Mat3<S> I;
};

template <class S>
OwnInertia<S> find_own_inertia(const Body& body) {
  const S mass(body.mass);
  const Vec3<S> c = cast<S>(body.com);
  return {mass, mass * c, cast<S>(body.inertia) + find_point_inertia(mass, c)};
}

/// Momentum, linear and angular about the origin, per twist.
template <class S, class Block>
void put_inertia(const OwnInertia<S>& of, Block A) {
  const Mat3<S> coupling = skew<S>(of.h);
  A.template topLeftCorner<3, 3>() = of.mass * Mat3<S>::Identity();
  A.template bottomLeftCorner<3, 3>() = coupling;
  A.template topRightCorner<3, 3>() = -coupling;
  A.template bottomRightCorner<3, 3>() = of.I;
}

/// Outside load less the load that moves body i as it moves now, its own axes.
/// @pre calc_tree_acceleration
template <class S>
Wrench<S> find_free_load(const MechanismModel& model, const TreeData<S>& tree, int i) {
  const Body& body = model.bodies[i];
  const Mat3<S> I = cast<S>(body.inertia);
  const Vec3<S> c = cast<S>(body.com);
  const auto turn_back = [&](const Vec3<S>& x) -> Vec3<S> { return tree.R[i].transpose() * x; };
  const Vec3<S> w = turn_back(tree.w[i]), alpha = turn_back(tree.alpha[i]);
  const Vec3<S> Iw = I * w, swing = w.cross(c);
  const Vec3<S> force = S(body.mass) * (turn_back(tree.a[i]) + alpha.cross(c) + w.cross(swing));
  return {turn_back(tree.external[i].f) - force,
          turn_back(tree.external[i].t) - (I * alpha + w.cross(Iw) + c.cross(force))};
}

template <class S>
void put_free_load(const Body& body, const VecX<S>& tau, const Wrench<S>& load, int at,
                   VecX<S>& b) {
  b.template segment<3>(at) = tau.template segment<3>(body.v_index) + load.f;
  b.template segment<3>(at + 3) = tau.template segment<3>(body.v_index + 3) + load.t;
}

}  // namespace

template <class S>
void calc_free_inertia(const MechanismModel& model, const LoopPlan& plan, const LoopData<S>& loops,
                       TreeData<S>& tree, MatX<S>& A) {
  const LegPlatform& platform = plan.platforms[0];
  const PlatformData<S>& legs = loops.platform[0];
  const OwnInertia<S> C = find_own_inertia<S>(model.bodies[platform.body]);
  auto own = A.template bottomRightCorner<6, 6>();
  put_inertia(C, own);
  own += find_apparent(legs);
  if (platform.root == kBase) return;
  const OwnInertia<S> R = find_own_inertia<S>(model.bodies[platform.root]);
  const Pose<S>& pose = tree.joint[platform.body];
  const Mat3<S> coupling = pose.R * skew<S>(C.h), turned = pose.R * C.I;
  const Mat3<S> arm = skew<S>(pose.p), linear = C.mass * pose.R;
  Mat6<S> carried = find_carried(legs.sums);
  carried.template topLeftCorner<3, 3>() += linear;
  carried.template topRightCorner<3, 3>() -= coupling;
  carried.template bottomLeftCorner<3, 3>() += coupling + arm * linear;
  carried.template bottomRightCorner<3, 3>() += turned - arm * coupling;
  A.template topRightCorner<6, 6>() = carried;
  A.template bottomLeftCorner<6, 6>() = carried.transpose();
  // All of it frozen on R.
  const Vec3<S> h = pose.R * C.h;
  const Mat3<S> mixed = pose.p * (h + S(0.5) * C.mass * pose.p).transpose();
  const OwnInertia<S> all = {
      R.mass + C.mass + legs.mass, R.h + h + C.mass * pose.p + as_vector(&legs.sums[legs::kSumH]),
      R.I + turned * pose.R.transpose() + S(2) * mixed.trace() * Mat3<S>::Identity() - mixed -
          mixed.transpose() + get_symmetric(&legs.sums[legs::kSumJ])};
  put_inertia(all, A.template topLeftCorner<6, 6>());
  tree.m_sum[platform.root] = all.mass;
  tree.h_sum[platform.root] = tree.R[platform.root] * all.h;
}

template <class S>
void calc_free_forces(const MechanismModel& model, const LoopPlan& plan, const BaseMotion<S>& base,
                      const VecX<S>& tau, TreeData<S>& tree, LoopData<S>& loops, VecX<S>& b) {
  const LegPlatform& platform = plan.platforms[0];
  PlatformData<S>& at = loops.platform[0];
  const LegBias<S> legs = find_leg_bias(model, platform, base, tau, tree, loops, at);
  const Wrench<S> C = find_free_load(model, tree, platform.body);
  const bool is_carried = platform.root != kBase;
  put_free_load<S>(model.bodies[platform.body], tau, {C.f - legs.tip.f, C.t - legs.tip.t},
                   is_carried ? 6 : 0, b);
  if (!is_carried) return;
  const Pose<S>& pose = tree.joint[platform.body];
  const Vec3<S> force = pose.R * C.f;
  Wrench<S> R = find_free_load(model, tree, platform.root);
  R.f += force - legs.root.f;
  R.t += pose.R * C.t + pose.p.cross(force) - legs.root.t;
  if (at.is_loaded) {
    const Mat3<S>& axes = tree.R[platform.root];
    R.f += axes.transpose() * at.external.f;
    R.t += axes.transpose() * at.external.t;
  }
  put_free_load<S>(model.bodies[platform.root], tau, R, 0, b);
}

}  // namespace dockloop
