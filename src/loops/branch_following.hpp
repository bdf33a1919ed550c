// How closed forms continue the accepted pose: which branch, near singular poses where branches
// meet, and which turn of an angle.
#pragma once

#include <algorithm>
#include <cmath>

#include "loops/loops.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

constexpr double kNearSingular = 0.3;  ///< margin below which a pose is near a singular one [-]

/// Was the reference pose of a block near a singular one, for what its joints are predicted to
/// move?
template <class S>
bool is_near_singular(const MechanismModel& model, const LoopBlock& block, const TreeData<S>& tree,
                      const LoopReference<S>& reference, size_t b) {
  double moved = 0.0;
  for (int i = 0; i < block.size(); ++i) {
    const int at = model.bodies[block.dep_bodies[i]].q_index;
    const double step = to_double(S(tree.q[at] - reference.q[at]));
    moved = std::max(moved, std::abs(step) / block.dep_scale[i]);
  }
  return reference.margin[b] < std::max(kNearSingular, 2.0 * moved);
}

/// Start the dependent coordinates of a block on the tangent of the reference pose.
template <class S>
void predict(const MechanismModel& model, size_t b, const LoopBlock& block, TreeData<S>& tree,
             const LoopData<S>& loops) {
  const MatX<S>& H = loops.reference.H[b];
  for (int i = 0; i < block.size(); ++i) {
    const int at = model.bodies[block.dep_bodies[i]].q_index;
    S q = loops.reference.q[at];
    for (int j = 0; j < H.cols(); ++j) q += H(i, j) * loops.moved[block.low[j]];
    tree.q[at] = q;
  }
}

/// Vector from a leg's centre to the closing point, canonical axes.
template <class S>
Vec3<S> find_leg_target(const ClosedForm& form, const Loop& loop, const LoopPaths& paths,
                        const TreeData<S>& tree) {
  Vec3<S> L = cast<S>(loop.point_on_closing);
  for (size_t i = paths.closing.size(); i-- > 0;) {
    const Pose<S>& joint = tree.joint[paths.closing[i]];
    L = joint.R * L + joint.p;
  }
  for (int i = 0; i <= form.parent_on_terminal; ++i) {
    const Pose<S>& joint = tree.joint[paths.terminal[i]];
    L = joint.R.transpose() * (L - joint.p);
  }
  return cast<S>(form.in_parent.R).transpose() * (L - cast<S>(form.in_parent.p));
}

/// How far joint i of a solved leg has turned; a slide has not.
template <class S>
struct JointTurn {
  JointTurn(const MechanismModel& model, const JointMap& joint, const LegSolution<S>& leg,
            size_t i) {
    if (model.bodies[joint.body].joint == JointType::kPrismatic) return;
    find_joint_angle<S>(joint, leg.c[i], leg.s[i], c, s);
  }
  S c = S(1), s = S(0);
};

/// Put the coordinate of a solved joint into the tree.
template <class S>
void put_coordinate(const MechanismModel& model, const JointMap& joint, const JointTurn<S>& turn,
                    const S& slide, const LoopReference<S>& reference, TreeData<S>& tree) {
  const Body& body = model.bodies[joint.body];
  S& q = tree.q[body.q_index];
  q = body.joint == JointType::kPrismatic
          ? slide
          : find_angle<S>(turn.c, turn.s, reference.valid ? S(reference.q[body.q_index]) : q);
}

/// Does H continue the one of the reference pose? Only asked when det C_dep has changed its sign:
/// a mechanism may run straight through a pose where branches meet, but must not turn back on
/// another branch, where H jumps. @pre H of the block
template <class S>
bool continues_reference(const LoopBlock& block, const MatX<S>& H0, const BlockData<S>& data) {
  double change = 0.0, size = 1.0;
  for (int j = 0; j < H0.cols(); ++j) {
    for (int i = 0; i < H0.rows(); ++i) {
      const double scale = block.low_scale[j] / block.dep_scale[i];
      change = std::max(change, scale * std::abs(to_double(S(data.H(i, j) - H0(i, j)))));
      size = std::max(size, scale * std::abs(to_double(H0(i, j))));
    }
  }
  return change <= 0.25 * size;
}

}  // namespace
}  // namespace dockloop
