// Legs condensed to their tips, for any scalar; see leg_platforms.hpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "loops/branch_following.hpp"
#include "loops/leg_forces_body.hpp"
#include "loops/leg_gears_body.hpp"
#include "loops/leg_setup_body.hpp"
#include "loops/loop_equations.hpp"
#include "loops/path_motion.hpp"

namespace dockloop {

// ---------------------------------------------------------------- position

namespace {

/// Pose of C in R, and how it moves with the joints of a path that is more than a free joint.
template <class S>
void calc_platform_pose(const MechanismModel& model, const LegPlatform& platform,
                        const TreeData<S>& tree, PlatformData<S>& at) {
  if (platform.is_free) {
    const Pose<S>& joint = tree.joint[platform.body];
    Eigen::Map<Mat3<S>>(at.motion.R) = joint.R;
    as_vector(at.motion.p) = joint.p;
    return;
  }
  for (size_t i = 0; i < platform.path.size(); ++i) {
    const Pose<S>& joint = tree.joint[platform.path[i]];
    at.pose[i] = i == 0 ? joint : at.pose[i - 1] * joint;
  }
  const Pose<S>& end = at.pose.back();
  Eigen::Map<Mat3<S>>(at.motion.R) = end.R;
  as_vector(at.motion.p) = end.p;
  int column = 0;
  for (size_t i = 0; i < platform.path.size(); ++i) {
    const Body& body = model.bodies[platform.path[i]];
    Vec3<S> e = Vec3<S>::Zero();
    if (body.joint != JointType::kFree) e = at.pose[i].R * cast<S>(body.axis);
    for (int k = 0; k < body.nv(); ++k) {
      Vec3<S> angular, linear;
      get_joint_column(body, at.pose[i].R, e, k, angular, linear);
      linear += angular.cross(end.p - at.pose[i].p);
      at.J.col(column).template head<3>() = end.R.transpose() * linear;
      at.J.col(column++).template tail<3>() = end.R.transpose() * angular;
    }
  }
}

/// As is_near_singular(), for the three joints of a leg on the tangent of the reference pose.
template <class S>
bool comes_near_singular(const LoopBlock& block, const LoopReference<S>& reference, size_t b,
                         const VecX<S>& moved) {
  const double margin = reference.margin[b];
  if (margin < kNearSingular) return true;
  const S* H = reference.H[b].data();
  double step[3] = {};
  for (const int j : block.low) {
    const double x = to_double(moved[j]);
    for (double& sum : step) sum += to_double(*H++) * x;
  }
  bool near = false;
  for (int i = 0; i < 3; ++i) near |= margin * block.dep_scale[i] < 2.0 * std::abs(step[i]);
  return near;
}

/// The branch of each leg: that of the accepted pose, unless that pose is near a singular one.
template <class S>
void choose_leg_branches(const MechanismModel& model, const LoopPlan& plan, size_t n,
                         TreeData<S>& tree, LoopData<S>& loops) {
  using N = typename LegStore<S>::Constant;
  const LoopReference<S>& reference = loops.reference;
  PlatformData<S>& at = loops.platform[n];
  double square = 0.0;
  for (int j : plan.platforms[n].low) {
    const double moved = to_double(loops.moved[j]);
    square += moved * moved;
  }
  const bool is_far = square < reference.reach[n] * reference.reach[n];  // from singular poses
  for (const LegPlace& leg : at.legs) {
    const size_t b = static_cast<size_t>(leg.block);
    BlockData<S>& data = loops.block[b];
    if (reference.valid) {
      data.branch = reference.branch[b];
      const LoopBlock& block = plan.blocks[b];
      if (!is_far && comes_near_singular(block, reference, b, loops.moved)) {
        predict(model, b, block, tree, loops);
        const int k = block.loops[0];
        const Vec3<S> L = find_leg_target(leg.form, model.loops[k], plan.paths[k], tree);
        choose_branch<S>(model, leg.form, L, tree.q, plan.loop_size[k], 0, data.branch);
      }
    }
    at.store.put(leg, legs::kElbow, N(data.branch.elbow));
    at.store.put(leg, legs::kFlip, N(data.branch.flip));
  }
}

/// Why the legs cannot be closed, or not well: the first leg that cannot.
template <class S>
Status find_leg_failure(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                        const LoopData<S>& loops, const LegPlatform& platform) {
  for (int b : platform.blocks) {
    const LoopBlock& block = plan.blocks[b];
    const ClosedForm& form = *block.form();
    const int k = block.loops[0];
    const Vec3<S> L = find_leg_target(form, model.loops[k], plan.paths[k], tree);
    const LegSolution<S> leg = solve_leg<S>(form.kind, form.shape, loops.block[b].branch, L);
    if (leg.code != StatusCode::kOk) return {leg.code, k, 0.0, 0.0};
    if (!(leg.margin >= model.singularity.error)) {
      return {StatusCode::kLoopSingular, k, leg.margin, 0.0};
    }
  }
  return {StatusCode::kLoopSingular, plan.blocks[platform.blocks[0]].loops[0],
          model.singularity.error, 0.0};
}

/// Square of the margin of one leg.
template <class S>
double find_square_margin(const PlatformData<S>& at, const LegPlace& leg) {
  const auto quotient = [&](int row) {
    return to_double(at.store.work(leg, legs::kReach + row)) /
           to_double(at.store.work(leg, legs::kReach + row + 1));
  };
  return std::min(quotient(0), quotient(2));
}

/// H of one leg. v_dep = H v_low
template <class S>
void calc_leg_map(const PlatformData<S>& at, const LegPlace& leg, BlockData<S>& data) {
  for (int i = 0; i < 3; ++i) {
    const Vec6<S> rate = find_rate_per_twist(at, leg, i);
    auto row = data.H.row(leg.form.joint[i].row);
    if (at.pose.empty()) {  // a free joint: its velocities are the twist
      row = rate.transpose();
      continue;
    }
    for (int j = 0; j < at.J.cols(); ++j) row[j] = rate.dot(at.J.col(j));
  }
}

/// Coordinates of the reported joints. @pre calc_angles
template <class S>
void put_reported_coordinates(const LoopReference<S>& reference, TreeData<S>& tree,
                              const PlatformData<S>& at) {
  for (const ReportedJoint& joint : at.reported) {
    const LegPlace& leg = at.legs[joint.leg];
    S& q = tree.q[leg.q[joint.joint]];
    if (joint.slides) q = at.store.work(leg, legs::kSlide);
    if (!joint.needs_angle) continue;
    const S near = reference.valid ? reference.q[leg.q[joint.joint]] : q;
    const JointMap& map = leg.form.joint[joint.joint];
    if constexpr (std::is_same_v<S, double>) {
      const double angle = at.store.work(leg, legs::kAngles + joint.joint);
      q = add_turns<double>(map.sign * (angle - map.zero), near);
    } else {
      S c, s;
      find_joint_angle<S>(map, at.store.work(leg, legs::kTurns + 2 * joint.joint),
                          at.store.work(leg, legs::kTurns + 2 * joint.joint + 1), c, s);
      q = find_angle<S>(c, s, near);
    }
  }
}

}  // namespace

template <class S>
Status calc_leg_positions(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                          LoopData<S>& loops) {
  const double least = std::max(model.singularity.error * model.singularity.error,
                                std::numeric_limits<double>::min());
  const LoopReference<S>& reference = loops.reference;
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const LegPlatform& platform = plan.platforms[n];
    PlatformData<S>& at = loops.platform[n];
    calc_platform_pose(model, platform, tree, at);
    choose_leg_branches(model, plan, n, tree, loops);
    at.carries = platform.root != kBase;
    if (!calc_position_sums(at, at.carries, least)) {
      return find_leg_failure(model, plan, tree, loops, platform);
    }
    for (const LegPlace& leg : at.legs) {
      BlockData<S>& data = loops.block[leg.block];
      data.sign = find_leg_sign(leg.form.kind, data.branch);
      if (!reference.valid || reference.sign[leg.block] == data.sign) continue;
      calc_leg_map(at, leg, data);
      const LoopBlock& block = plan.blocks[leg.block];
      if (!continues_reference(block, reference.H[leg.block], data)) {
        return {StatusCode::kBranchChanged, block.loops[0], std::sqrt(find_square_margin(at, leg)),
                0.0};
      }
    }
    for (int i = 0; i < 3; ++i) {
      if (at.angles[i]) at.store.calc_angles(i);
    }
    put_reported_coordinates(reference, tree, at);
    for (const GearData<S>& gear : at.gears) {
      if (gear.is_reported) put_gear_coordinate(at, gear, tree);
    }
  }
  return {};
}

template <class S>
void calc_leg_coordinates(const MechanismModel& model, TreeData<S>& tree, LoopData<S>& loops) {
  if (std::exchange(loops.has_leg_coordinates, true)) return;
  const LoopReference<S>& reference = loops.reference;
  for (const PlatformData<S>& at : loops.platform) {
    for (const LegPlace& leg : at.legs) {
      LegSolution<S>& solved = loops.block[leg.block].leg;
      solved.slide = at.store.work(leg, legs::kSlide);
      for (int i = 0; i < 3; ++i) {
        solved.c[i] = at.store.work(leg, legs::kTurns + 2 * i);
        solved.s[i] = at.store.work(leg, legs::kTurns + 2 * i + 1);
        const JointMap& joint = leg.form.joint[i];
        const JointTurn<S> turn(model, joint, solved, static_cast<size_t>(i));
        put_coordinate(model, joint, turn, solved.slide, reference, tree);
      }
    }
    for (const GearData<S>& gear : at.gears) put_gear_coordinate(at, gear, tree);
  }
}

template <class S>
void calc_leg_poses(const MechanismModel& model, TreeData<S>& tree, LoopData<S>& loops) {
  if (std::exchange(loops.has_leg_poses, true)) return;
  calc_leg_coordinates(model, tree, loops);
  for (const PlatformData<S>& at : loops.platform) {
    for (const LegPlace& leg : at.legs) {
      const LegSolution<S>& solved = loops.block[leg.block].leg;
      for (size_t i = 0; i < 3; ++i) {
        const JointTurn<S> turn(model, leg.form.joint[i], solved, i);
        calc_joint_pose(model, leg.form.joint[i].body, turn.c, turn.s, tree);
      }
    }
    for (const GearData<S>& gear : at.gears) calc_joint_pose(model, gear.body, tree);
  }
}

template <class S>
void calc_leg_maps(LoopData<S>& loops) {
  for (const PlatformData<S>& at : loops.platform) {
    for (const LegPlace& leg : at.legs) {
      BlockData<S>& data = loops.block[leg.block];
      data.margin = std::sqrt(find_square_margin(at, leg));
      calc_leg_map(at, leg, data);
    }
  }
}

template <class S>
void add_leg_columns(const LoopPlan& plan, const LoopData<S>& loops, MatX<S>& columns) {
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const PlatformData<S>& at = loops.platform[n];
    for (const LegPlace& leg : at.legs) {
      for (int i = 0; i < 3; ++i) {
        const Vec6<S> per_twist = find_rate_per_twist(at, leg, i);
        columns.col(leg.v[i]).setZero();
        for (int j = 0; j < at.J.cols(); ++j) {
          const S rate = per_twist.dot(at.J.col(j));
          columns.col(leg.v[i]) += rate * columns.col(plan.platforms[n].low[j]);
        }
      }
    }
    for (const GearData<S>& gear : at.gears) {
      columns.col(gear.v).setZero();
      for (const auto& term : gear.terms) {
        columns.col(gear.v) += S(term.ratio) * columns.col(at.legs[term.leg].v[term.joint]);
      }
    }
  }
}

template <class S>
double find_leg_margin(const PlatformData<S>& at) {
  double square = 1.0;
  for (const LegPlace& leg : at.legs) square = std::min(square, find_square_margin(at, leg));
  return std::sqrt(square);
}

// ---------------------------------------------------------------- inertia

namespace {

/// Sums over legs, those that only a moving root needs too.
template <class S>
using PositionSums = std::array<S, legs::kPositionSums>;

/// Momentum of the legs, linear and angular about the origin of R, axes of R, per twist of C.
template <class S>
Mat6<S> find_carried(const PositionSums<S>& sums) {
  Mat6<S> carried;
  carried << get_rows(&sums[legs::kSumLV]), get_rows(&sums[legs::kSumLW]),
      get_rows(&sums[legs::kSumAV]), get_rows(&sums[legs::kSumAW]);
  return carried;
}

/// Apparent inertia of the legs for twists of C.
template <class S>
Mat6<S> find_apparent(const PlatformData<S>& at) {
  Mat6<S> apparent;
  const Mat3<S> coupling = as_columns(&at.sums[legs::kSumK]);
  apparent << get_symmetric(&at.sums[legs::kSumA]), coupling.transpose(), coupling,
      get_symmetric(&at.sums[legs::kSumD]);
  return apparent;
}

/// Also find what the root carries. @pre calc_leg_positions
template <class S>
void make_carry(PlatformData<S>& at) {
  if (at.carries) return;
  at.carries = true;
  calc_position_sums(at, true, 0.0);
}

/// All sums over legs, where some were not needed before leg by leg.
template <class S>
PositionSums<S> find_all_sums(const PlatformData<S>& at) {
  using N = typename LegStore<S>::Constant;
  if (at.carries) return at.sums;
  PositionSums<S> sums;
  sums.fill(S(0));
  N parameter[legs::kParameters];
  S work[legs::kWork];
  for (const LegPlace& leg : at.legs) {
    for (int i = 0; i < legs::kParameters; ++i) parameter[i] = at.store.get(leg, i);
    calc_one_position<N, S>(leg.type, parameter, work, at.motion, true, 0.0, sums.data());
  }
  if (!at.train.joints.empty()) add_train_inertia(at.train, true, sums.data());
  return sums;
}

}  // namespace

template <class S>
void add_leg_masses(const LoopPlan& plan, const LoopData<S>& loops, TreeData<S>& tree) {
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const int root = plan.platforms[n].root;
    if (root == kBase) continue;
    const PlatformData<S>& at = loops.platform[n];
    const Mat3<S>& R = tree.R[root];
    tree.m_sum[root] += at.mass;
    tree.h_sum[root] += R * as_vector(&at.sums[legs::kSumH]);
    tree.I_sum[root] += R * get_symmetric(&at.sums[legs::kSumJ]) * R.transpose();
  }
}

template <class S>
void add_leg_inertia(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                     const LoopData<S>& loops, MatX<S>& A) {
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const LegPlatform& platform = plan.platforms[n];
    const PlatformData<S>& at = loops.platform[n];
    const std::vector<int>& low = platform.low;
    const int count = static_cast<int>(low.size());
    const Mat6<S> apparent = find_apparent(at);
    if (platform.is_free) {
      A.template block<6, 6>(low[0], low[0]) += apparent;
    } else {
      for (int j = 0; j < count; ++j) {
        const Vec6<S> momentum = apparent * at.J.col(j);
        for (int i = 0; i < count; ++i) A(low[i], low[j]) += at.J.col(i).dot(momentum);
      }
    }
    if (platform.root == kBase) continue;
    // Momentum of the legs, seen by the joints that move their root.
    const Mat6<S> carried = find_carried(at.sums);
    const Body& root = model.bodies[platform.root];
    if (platform.is_free && root.parent == kBase && root.joint == JointType::kFree) {
      A.template block<6, 6>(root.v_index, low[0]) += carried;
      A.template block<6, 6>(low[0], root.v_index) += carried.transpose();
      continue;
    }
    const Mat3<S>& R = tree.R[platform.root];
    for (int j = 0; j < count; ++j) {
      const Vec6<S> momentum = carried * at.J.col(j);
      const Vec3<S> f = R * momentum.template head<3>();
      Vec3<S> t = R * momentum.template tail<3>();
      for (int i = platform.root; i != kBase; i = model.bodies[i].parent) {
        const Body& body = model.bodies[i];
        const auto add = [&](int row, const S& x) {
          A(row, low[j]) += x;
          A(low[j], row) += x;
        };
        if (body.joint == JointType::kRevolute) add(body.v_index, tree.e[i].dot(t));
        if (body.joint == JointType::kPrismatic) add(body.v_index, tree.e[i].dot(f));
        for (int k = 0; body.joint == JointType::kFree && k < 3; ++k) {
          add(body.v_index + k, tree.R[i].col(k).dot(f));
          add(body.v_index + 3 + k, tree.R[i].col(k).dot(t));
        }
        t += tree.r[i].cross(f);
      }
    }
  }
}

// ---------------------------------------------------------------- velocity

template <class S>
void calc_leg_velocities(const MechanismModel& model, const LoopPlan& plan, const Vec3<S>& base_w,
                         TreeData<S>& tree, LoopData<S>& loops) {
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const LegPlatform& platform = plan.platforms[n];
    PlatformData<S>& at = loops.platform[n];
    legs::PlatformMotion<S>& motion = at.motion;
    if (platform.is_free) {
      const Vec3<S> v = tree.v.template segment<3>(platform.low[0]);
      const Vec3<S> w = tree.v.template segment<3>(platform.low[0] + 3);
      as_vector(motion.v) = v;
      as_vector(motion.w) = w;
      as_vector(motion.a) = w.cross(v);  // velocities are held in axes that turn
      as_vector(motion.alpha).setZero();
    } else {
      Vec6<S> twist = Vec6<S>::Zero();
      for (size_t j = 0; j < platform.low.size(); ++j) {
        twist += at.J.col(static_cast<int>(j)) * tree.v[platform.low[j]];
      }
      const Pose<S>& end = at.pose.back();
      const PathBias<S> bias = calc_path_bias(model, tree, platform.path, at.pose, end.p);
      as_vector(motion.v) = twist.template head<3>();
      as_vector(motion.w) = twist.template tail<3>();
      as_vector(motion.a) = end.R.transpose() * bias.a;
      as_vector(motion.alpha) = end.R.transpose() * bias.alpha;
    }
    if (platform.root == kBase) {
      as_vector(motion.root) = base_w;
    } else {
      as_vector(motion.root) = tree.R[platform.root].transpose() * tree.w[platform.root];
    }
    at.store.calc_rates(motion);
    for (const ReportedJoint& joint : at.reported) {
      const LegPlace& leg = at.legs[joint.leg];
      tree.v[leg.v[joint.joint]] = find_joint_rate(at, leg, joint.joint);
    }
    for (const GearData<S>& gear : at.gears) {
      if (gear.is_reported) tree.v[gear.v] = find_gear_rate(at, gear);
    }
  }
}

template <class S>
void put_leg_velocities(TreeData<S>& tree, const LoopData<S>& loops) {
  for (const PlatformData<S>& at : loops.platform) {
    for (const LegPlace& leg : at.legs) {
      for (int i = 0; i < 3; ++i) {
        tree.v[leg.v[i]] = find_joint_rate(at, leg, i);
      }
    }
    for (const GearData<S>& gear : at.gears) tree.v[gear.v] = find_gear_rate(at, gear);
  }
}

namespace {

/// Velocity and momentum of the legs of a platform, linear and angular about R, axes of R.
template <class S>
struct LegMotion {
  Vec3<S> u, w;     ///< velocity and angular velocity of R
  Vec3<S> f, t;     ///< momentum of the legs as if frozen on R
  Vec6<S> carried;  ///< what the motion of C relative to R adds
};

template <class S>
Vec6<S> get_twist(const PlatformData<S>& at) {
  Vec6<S> twist;
  twist << as_vector(at.motion.v), as_vector(at.motion.w);
  return twist;
}

/// @param sums  those that a moving root needs, too
template <class S>
LegMotion<S> find_leg_motion(const LegPlatform& platform, const TreeData<S>& tree,
                             const PlatformData<S>& at, const PositionSums<S>& sums) {
  LegMotion<S> m;
  m.u = m.w = Vec3<S>::Zero();
  if (platform.root != kBase) {
    const Mat3<S>& R = tree.R[platform.root];
    m.u = R.transpose() * tree.u[platform.root];
    m.w = R.transpose() * tree.w[platform.root];
  }
  const Vec3<S> h = as_vector(&sums[legs::kSumH]);
  m.f = at.mass * m.u + m.w.cross(h);
  m.t = h.cross(m.u) + get_symmetric(&sums[legs::kSumJ]) * m.w;
  m.carried = find_carried(sums) * get_twist(at);
  return m;
}

}  // namespace

template <class S>
S find_leg_energy(const LegPlatform& platform, const TreeData<S>& tree, const PlatformData<S>& at) {
  const Vec6<S> twist = get_twist(at);
  const S relative = twist.dot(Vec6<S>(find_apparent(at) * twist));
  if (platform.root == kBase) return S(0.5) * relative;  // nothing is carried along
  const LegMotion<S> m = find_leg_motion(platform, tree, at, at.sums);
  return S(0.5) * (m.u.dot(m.f) + m.w.dot(m.t) + relative) + m.u.dot(m.carried.template head<3>()) +
         m.w.dot(m.carried.template tail<3>());
}

template <class S>
LegSums<S> find_leg_sums(const LegPlatform& platform, const TreeData<S>& tree,
                         const PlatformData<S>& at) {
  const PositionSums<S> sums = find_all_sums(at);
  const LegMotion<S> m = find_leg_motion(platform, tree, at, sums);
  Mat3<S> R = Mat3<S>::Identity();
  if (platform.root != kBase) R = tree.R[platform.root];
  LegSums<S> sum;
  sum.mass = at.mass;
  sum.first_moment = R * as_vector(&sums[legs::kSumH]);
  sum.momentum = {R * (m.f + m.carried.template head<3>()),
                  R * (m.t + m.carried.template tail<3>())};
  return sum;
}

// ---------------------------------------------------------------- acceleration

namespace {

/// What the legs need at zero joint accelerations.
template <class S>
struct LegBias {
  Wrench<S> tip;   ///< from the platform, about its origin, C
  Wrench<S> root;  ///< from both, about the origin of a moving root, R
};

/// @pre calc_tree_acceleration
template <class S>
LegBias<S> find_leg_bias(const MechanismModel& model, const LegPlatform& platform,
                         const BaseMotion<S>& base, const VecX<S>& tau, TreeData<S>& tree,
                         LoopData<S>& loops, PlatformData<S>& at) {
  put_leg_forces(model, tau, tree, loops, at);
  Vec6<S> root;  // acceleration less gravity, and angular, R
  bool moving = true;
  if (platform.root == kBase) {
    root << base.a - base.gravity, base.alpha;
    moving = !((root.array() == S(0)).all() && (base.w.array() == S(0)).all());
    if (moving) make_carry(at);
  } else {
    const Mat3<S>& R = tree.R[platform.root];
    root << R.transpose() * tree.a[platform.root], R.transpose() * tree.alpha[platform.root];
  }
  at.store.calc_bias(at.motion, moving, at.bias.data());
  add_train_bias(moving, at);
  Vec6<S> tip;
  tip << as_vector(&at.bias[legs::kSumTipForce]), as_vector(&at.bias[legs::kSumTipMoment]);
  if (moving) tip += find_carried(at.sums).transpose() * root;
  LegBias<S> bias;
  bias.tip = {tip.template head<3>(), tip.template tail<3>()};
  if (platform.root == kBase) return bias;
  const Vec3<S> a = root.template head<3>(), alpha = root.template tail<3>();
  const Vec3<S> h = as_vector(&at.sums[legs::kSumH]);
  bias.root = {as_vector(&at.bias[legs::kSumRootForce]) + at.mass * a + alpha.cross(h),
               as_vector(&at.bias[legs::kSumRootMoment]) + h.cross(a) +
                   get_symmetric(&at.sums[legs::kSumJ]) * alpha};
  return bias;
}

}  // namespace

template <class S>
void add_leg_biases(const MechanismModel& model, const LoopPlan& plan, const BaseMotion<S>& base,
                    const VecX<S>& tau, TreeData<S>& tree, LoopData<S>& loops) {
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const LegPlatform& platform = plan.platforms[n];
    PlatformData<S>& at = loops.platform[n];
    const LegBias<S> bias = find_leg_bias(model, platform, base, tau, tree, loops, at);
    // What the platform passes to the legs at their tips.
    const Mat3<S>& RC = tree.R[platform.body];
    const Vec3<S> f = RC * bias.tip.f, t = RC * bias.tip.t;
    tree.transmitted[platform.body].f += f;
    tree.transmitted[platform.body].t += t;
    if (platform.root == kBase) continue;
    // And the root, by the first joints: the rest of what they need.
    const Mat3<S>& R = tree.R[platform.root];
    const Vec3<S> arm = R * as_vector(at.motion.p);
    Wrench<S>& load = tree.transmitted[platform.root];
    load.f += R * bias.root.f - f;
    load.t += R * bias.root.t - t - arm.cross(f);
    if (at.is_loaded) load -= at.external;
  }
}

template <class S>
void put_leg_accelerations(const LoopPlan& plan, VecX<S>& vdot, LoopData<S>& loops) {
  for (const PlatformData<S>& at : loops.platform) {
    for (const LegPlace& leg : at.legs) {
      BlockData<S>& data = loops.block[leg.block];
      for (int i = 0; i < 3; ++i) {
        data.h[leg.form.joint[i].row] = find_free_acceleration(at, leg, i);
      }
      const LoopBlock& block = plan.blocks[leg.block];
      for (int i = 0; i < 3; ++i) {
        S sum = data.h[i];
        for (int j = 0; j < data.H.cols(); ++j) sum += data.H(i, j) * vdot[block.low[j]];
        vdot[block.dep[i]] = sum;
      }
    }
    for (const GearData<S>& gear : at.gears) {
      vdot[gear.v] =
          find_gear_sum(at, gear, [&](const LegPlace& leg, int i) { return vdot[leg.v[i]]; });
    }
  }
}

template <class S>
void add_leg_loads(const LoopPlan& plan, const BaseMotion<S>& base, int base_body,
                   const VecX<S>& vdot, TreeData<S>& tree, LoopData<S>& loops, Wrench<S>& on_base) {
  for (size_t n = 0; n < plan.platforms.size(); ++n) {
    const LegPlatform& platform = plan.platforms[n];
    PlatformData<S>& at = loops.platform[n];
    legs::PlatformMotion<S>& motion = at.motion;
    Vec6<S> dot = Vec6<S>::Zero();
    for (size_t j = 0; j < platform.low.size(); ++j) {
      dot += at.J.col(static_cast<int>(j)) * vdot[platform.low[j]];
    }
    as_vector(motion.dot_v) = dot.template head<3>();
    as_vector(motion.dot_w) = dot.template tail<3>();
    Mat3<S> R = Mat3<S>::Identity();
    if (platform.root == kBase) {
      as_vector(motion.root_a) = base.a - base.gravity;
      as_vector(motion.root_alpha) = base.alpha;
    } else {
      R = tree.R[platform.root];
      as_vector(motion.root_a) = R.transpose() * tree.a[platform.root];
      as_vector(motion.root_alpha) = R.transpose() * tree.alpha[platform.root];
    }
    std::array<S, legs::kLoadSums> sums;
    calc_load_sums(at, sums);
    calc_gear_forces(at, loops);
    for (const LegPlace& leg : at.legs) {
      for (int i = 0; i < 3; ++i) {
        loops.block[leg.block].lambda[i] = at.store.work(leg, legs::kCut + i);
      }
    }
    Wrench<S> load{R * as_vector(&sums[legs::kSumLoad]),
                   R * as_vector(&sums[legs::kSumLoadMoment])};
    if (at.is_loaded) load -= at.external;
    if (platform.root != kBase) tree.transmitted[platform.root] += load;
    if (platform.root == base_body) on_base -= load;
  }
}

}  // namespace dockloop

#include "loops/free_platform_body.hpp"

namespace dockloop {

#define DOCK_INSTANTIATE(S)                                                                       \
  template class LegStore<S>;                                                                     \
  template struct PlatformData<S>;                                                                \
  template Status calc_leg_positions<S>(const MechanismModel&, const LoopPlan&, TreeData<S>&,     \
                                        LoopData<S>&);                                            \
  template void calc_leg_coordinates<S>(const MechanismModel&, TreeData<S>&, LoopData<S>&);       \
  template void calc_leg_poses<S>(const MechanismModel&, TreeData<S>&, LoopData<S>&);             \
  template void calc_leg_maps<S>(LoopData<S>&);                                                   \
  template void add_leg_columns<S>(const LoopPlan&, const LoopData<S>&, MatX<S>&);                \
  template void add_leg_masses<S>(const LoopPlan&, const LoopData<S>&, TreeData<S>&);             \
  template void add_leg_inertia<S>(const MechanismModel&, const LoopPlan&, const TreeData<S>&,    \
                                   const LoopData<S>&, MatX<S>&);                                 \
  template void calc_leg_velocities<S>(const MechanismModel&, const LoopPlan&, const Vec3<S>&,    \
                                       TreeData<S>&, LoopData<S>&);                               \
  template void put_leg_velocities<S>(TreeData<S>&, const LoopData<S>&);                          \
  template S find_leg_energy<S>(const LegPlatform&, const TreeData<S>&, const PlatformData<S>&);  \
  template LegSums<S> find_leg_sums<S>(const LegPlatform&, const TreeData<S>&,                    \
                                       const PlatformData<S>&);                                   \
  template void add_leg_biases<S>(const MechanismModel&, const LoopPlan&, const BaseMotion<S>&,   \
                                  const VecX<S>&, TreeData<S>&, LoopData<S>&);                    \
  template void put_leg_accelerations<S>(const LoopPlan&, VecX<S>&, LoopData<S>&);                \
  template void add_leg_loads<S>(const LoopPlan&, const BaseMotion<S>&, int, const VecX<S>&,      \
                                 TreeData<S>&, LoopData<S>&, Wrench<S>&);                         \
  template void calc_free_inertia<S>(const MechanismModel&, const LoopPlan&, const LoopData<S>&,  \
                                     TreeData<S>&, MatX<S>&);                                     \
  template void calc_free_forces<S>(const MechanismModel&, const LoopPlan&, const BaseMotion<S>&, \
                                    const VecX<S>&, TreeData<S>&, LoopData<S>&, VecX<S>&);        \
  template double find_leg_margin<S>(const PlatformData<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
