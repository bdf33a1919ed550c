// Dependent coordinates: closed forms where a leg has one, Newton iteration elsewhere.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "loops/branch_following.hpp"
#include "loops/loop_equations.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

/// Residual and G of a block from the joint poses.
template <class S>
void calc_block_position(const MechanismModel& model, const LoopPlan& plan, const LoopBlock& block,
                         const TreeData<S>& tree, LoopData<S>& loops, BlockData<S>& data) {
  if (block.loops.size() > 1) data.G.setZero();
  for (size_t i = 0; i < block.loops.size(); ++i) {
    const int k = block.loops[i];
    calc_cut_position(model, plan, k, tree, loops.cut[k]);
    for (int j = 0; j < kMaxEquations; ++j) {
      if (block.row[i][j] >= 0) data.residual[block.row[i][j]] = loops.cut[k].residual[j];
    }
    calc_cut_columns(model, plan, k, block.row[i], block.column_of, loops.cut[k], data.G);
  }
}

/// Spin about the leg that makes the cross axes square: A.B = k + alpha cos + beta sin = 0.
/// [Y2 (9a)]
template <class S>
Status calc_spin(const MechanismModel& model, const LoopPaths& paths, const Loop& loop, int k,
                 const LegSpin& spin, const LoopReference<S>& reference, bool follows,
                 TreeData<S>& tree, BlockData<S>& data) {
  using std::sqrt;
  const Body& body = model.bodies[spin.body];
  Mat3<S> R = Mat3<S>::Identity();  // axes of the spin joint at zero spin, in L
  for (int index : paths.terminal) {
    if (index == spin.body) break;
    R = R * tree.joint[index].R;
  }
  R = R * cast<S>(body.placement.R);
  Mat3<S> R_closing = Mat3<S>::Identity();
  for (int index : paths.closing) R_closing = R_closing * tree.joint[index].R;
  const Vec3<S> B = R.transpose() * (R_closing * cast<S>(loop.axis_on_closing));
  const Vec3<S> e = cast<S>(body.axis), A = cast<S>(spin.cross_axis);
  const S along = e.dot(A);
  const S constant = along * e.dot(B);
  const S alpha = (A - along * e).dot(B), beta = e.cross(A).dot(B);
  const S square = alpha * alpha + beta * beta;
  const S radicand = square - constant * constant;
  if (!(radicand > S(0))) {
    return {radicand < S(0) ? StatusCode::kOutOfReach : StatusCode::kLoopSingular, k,
            to_double(radicand), 0.0};
  }
  S& q = tree.q[body.q_index];
  const S root = sqrt(radicand);
  if (follows) {
    // f' = beta cos - alpha sin has the sign of the branch: take that of the predicted angle.
    const double at = to_double(q);
    const double slope = to_double(beta) * std::cos(at) - to_double(alpha) * std::sin(at);
    data.spin_branch = slope < 0.0 ? -1 : 1;
  }
  const S w = S(data.spin_branch) * root;
  const S c = (-constant * alpha + w * beta) / square;
  const S s = (-constant * beta - w * alpha) / square;
  q = find_angle<S>(c, s, reference.valid ? S(reference.q[body.q_index]) : q);
  calc_joint_pose(model, spin.body, c, s, tree);
  data.margin = std::min(data.margin, std::abs(to_double(w)));
  return {};
}

/// A leg in closed form.                                                      [Y2 (9a), (9b)]
template <class S>
Status solve_by_formula(const MechanismModel& model, const LoopPlan& plan, const LoopBlock& block,
                        TreeData<S>& tree, LoopData<S>& loops, BlockData<S>& data) {
  const ClosedForm& form = *block.form();
  const int k = block.loops[0];
  const Loop& loop = model.loops[k];
  const LoopPaths& paths = plan.paths[k];
  const LoopReference<S>& reference = loops.reference;
  bool follows = false;
  if (reference.valid) {
    const size_t b = static_cast<size_t>(plan.block_of_loop[k]);
    data.branch = reference.branch[b];
    data.spin_branch = reference.spin_branch[b];
    follows = is_near_singular(model, block, tree, reference, b);
  }
  const Vec3<S> L = find_leg_target(form, loop, paths, tree);
  // Near a singular pose two branches meet, and a mechanism that moves on leaves it on the one that
  // continues its motion: the branch nearest to the predicted coordinates.
  if (follows) choose_branch<S>(model, form, L, tree.q, plan.loop_size[k], 0, data.branch);
  data.leg = solve_leg<S>(form.kind, form.shape, data.branch, L);
  if (data.leg.code != StatusCode::kOk) return {data.leg.code, k, 0.0, 0.0};
  for (size_t i = 0; i < form.joint.size(); ++i) {
    const JointTurn<S> turn(model, form.joint[i], data.leg, i);
    put_coordinate(model, form.joint[i], turn, data.leg.slide, reference, tree);
    calc_joint_pose(model, form.joint[i].body, turn.c, turn.s, tree);
  }
  data.margin = data.leg.margin;
  if (!form.spin) return {};
  return calc_spin(model, paths, loop, k, *form.spin, reference, follows, tree, data);
}

/// A coupling by itself: its joint follows.
template <class S>
void solve_coupling(const MechanismModel& model, const Loop& loop, const LoopPaths& paths,
                    TreeData<S>& tree) {
  const int dependent = loop.dependent[0];
  S rest = S(loop.offset) + S(loop.rate) * tree.time;
  for (int body : paths.tied) {
    if (body == dependent) continue;
    rest -= S(find_coupling_factor(loop, body)) * tree.q[model.bodies[body].q_index];
  }
  tree.q[model.bodies[dependent].q_index] = rest / S(find_coupling_factor(loop, dependent));
  calc_joint_pose(model, dependent, tree);
}

/// Newton iteration for the dependent coordinates of a block.                       [Y2 (9)]
/// Steps are measured and capped in scaled form (angles in rad, slides in loop sizes); the accepted
/// closure is at rounding level, and a test tighter than that could cycle for ever. With a scalar
/// that carries derivatives the last step, taken at the solution, is the implicit function theorem.
template <class S>
Status solve_by_newton(const MechanismModel& model, const LoopPlan& plan, const LoopBlock& block,
                       TreeData<S>& tree, LoopData<S>& loops, BlockData<S>& data) {
  constexpr int kIterations = 25;
  constexpr double kCap = 0.3;
  const double eps = to_double(S(std::numeric_limits<S>::epsilon()));
  const double converged = 1e-13 * std::max(eps / 2.3e-16, 1e-3);
  const int k = block.loops[0];
  const int m = block.size();
  for (int i = 0; i < m; ++i) calc_joint_pose(model, block.dep_bodies[i], tree);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    calc_block_position(model, plan, block, tree, loops, data);
    bool rounding = true;
    double turned = 1.0;  // an angle is known to its own rounding only
    for (int i = 0; i < m; ++i) {
      const Body& body = model.bodies[block.dep_bodies[i]];
      if (body.joint == JointType::kRevolute) {
        turned = std::max(turned, std::abs(to_double(tree.q[body.q_index])));
      }
    }
    for (size_t i = 0; i < block.loops.size(); ++i) {
      const int loop = block.loops[i];
      const CutData<S>& cut = loops.cut[loop];
      if (model.loops[loop].cut == CutType::kCoupling) {
        const double bound = 8.0 * eps * turned * block.row_scale[block.row[i][0]];
        rounding = rounding && std::abs(to_double(cut.residual[0])) <= bound;
        continue;
      }
      const double reach = to_double(S(cut.p_T.norm() + cut.p_I.norm()));
      for (int j = 0; j < kMaxEquations; ++j) {
        if (block.row[i][j] < 0) continue;
        const double open = std::abs(to_double(cut.residual[j]));
        rounding = rounding && open <= 8.0 * eps * turned * (j < 3 ? reach : 1.0);
      }
    }
    if (!data.lu.factorise(data.G)) return {StatusCode::kLoopSingular, k, 0.0, 0.0};
    data.step = data.residual;
    data.lu.solve(data.step);
    double scaled = 0.0;
    for (int i = 0; i < m; ++i) {
      const double step = std::abs(to_double(data.step[i])) / block.dep_scale[i];
      if (!(step < 1e30)) return {StatusCode::kLoopNotClosed, k, 0.0, 0.0};
      scaled = std::max(scaled, step);
    }
    const S factor(scaled > kCap ? kCap / scaled : 1.0);
    for (int i = 0; i < m; ++i) {
      tree.q[model.bodies[block.dep_bodies[i]].q_index] -= factor * data.step[i];
      calc_joint_pose(model, block.dep_bodies[i], tree);
    }
    if (scaled <= converged * turned || rounding) return {};
  }
  return {StatusCode::kLoopNotClosed, k, 0.0, 0.0};
}

/// How far a joint has moved from the reference pose, in its velocity coordinates.
template <class S>
void calc_moved(const MechanismModel& model, int index, const TreeData<S>& tree,
                LoopData<S>& loops) {
  const Body& body = model.bodies[index];
  const VecX<S>& q0 = loops.reference.q;
  if (body.joint != JointType::kFree) {
    loops.moved[body.v_index] = tree.q[body.q_index] - q0[body.q_index];
    return;
  }
  const Vec4<S> quat0 = q0.template segment<4>(body.q_index + 3);
  const Vec4<S> quat = tree.q.template segment<4>(body.q_index + 3);
  const Vec3<S> shift =
      tree.q.template segment<3>(body.q_index) - q0.template segment<3>(body.q_index);
  // A small turn: twice the vector part of the quaternion between the two attitudes.
  const Vec4<S> turn = quat_multiply<S>(quat_conjugate<S>(quat0), quat);
  loops.moved.template segment<3>(body.v_index) = quat_to_matrix<S>(quat0).transpose() * shift;
  loops.moved.template segment<3>(body.v_index + 3) =
      turn.template tail<3>() * (turn[0] < S(0) ? S(-2) : S(2));
}

/// Leg axes in L: two joint axes of the leg and what is square to them.
template <class S>
void calc_leg_axes(const LoopPaths& paths, const MechanismModel& model, const ClosedForm& form,
                   const CutData<S>& cut, Mat3<S>& axes) {
  const auto axis = [&](int i) {
    const JointMap& joint = form.joint[i];
    const size_t at = static_cast<size_t>(form.parent_on_terminal + 1 + i);
    return S(joint.sign) * (cut.terminal[at].R * cast<S>(model.bodies[paths.terminal[at]].axis));
  };
  if (form.kind == LegKind::kR2P1R3) {
    axes.col(0) = cut.terminal.back().R * cast<S>(model.bodies[paths.terminal.back()].axis);
    axes.col(2) = axis(1);
    axes.col(1) = axes.col(2).cross(axes.col(0));
    return;
  }
  axes.col(1) = form.kind == LegKind::kR1R2R3 ? axis(2) : axis(1);
  axes.col(2) = form.kind == LegKind::kR1R2R3 ? axis(0) : axis(2);
  axes.col(0) = axes.col(1).cross(axes.col(2));
}

/// C_dep^-1 (or its factors), margin and sign of a closed block.
template <class S>
Status calc_block_inverse(const MechanismModel& model, const LoopPlan& plan, const LoopBlock& block,
                          LoopData<S>& loops, BlockData<S>& data) {
  const int k = block.loops[0];
  const ClosedForm* form = block.form();
  if (form && form->has_inverse()) {
    calc_leg_axes(plan.paths[k], model, *form, loops.cut[k], data.leg_axes);
    const Mat3<S> inverse = find_leg_inverse<S>(form->kind, form->shape, data.leg, data.leg_axes);
    data.sign = find_leg_sign(form->kind, data.branch);
    for (int i = 0; i < 3; ++i) {
      data.inverse.row(form->joint[i].row) = S(form->joint[i].sign) * inverse.row(i);
    }
    return {};
  }
  if (!data.lu.factorise(data.G)) return {StatusCode::kLoopSingular, k, 0.0, 0.0};
  data.sign = data.lu.determinant_sign();
  if (!form) {
    data.margin = 1.0 / to_double(data.lu.scaled_inverse_norm(block.row_scale, block.dep_scale));
  }
  return {};
}

/// Equations left out as redundant must be satisfied all the same.
template <class S>
Status check_redundant(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                       LoopData<S>& loops) {
  constexpr double kLimit = 1e-6;
  for (size_t k = 0; k < model.loops.size(); ++k) {
    const int loop = static_cast<int>(k);
    if (plan.block_of_loop[k] < 0) calc_cut_position(model, plan, loop, tree, loops.cut[k]);
    for (int equation : model.loops[k].redundant) {
      const double open = std::abs(to_double(loops.cut[k].residual[equation])) /
                          (equation < 3 ? plan.loop_size[k] : 1.0);
      if (!(open <= kLimit)) return {StatusCode::kRedundancyLost, loop, open, 0.0};
    }
  }
  return {};
}

template <class S>
Status solve_blocks(const MechanismModel& model, const LoopPlan& plan, bool from_reference,
                    TreeData<S>& tree, LoopData<S>& loops) {
  for (int i : plan.ind_bodies) calc_joint_pose(model, i, tree);
  if (from_reference) {
    for (int i : plan.followed) calc_moved(model, i, tree, loops);
  }
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    Status status;
    if (from_reference && !block.is_coupling) predict(model, b, block, tree, loops);
    if (block.form()) {
      status = solve_by_formula(model, plan, block, tree, loops, data);
    } else if (block.is_coupling) {
      solve_coupling(model, model.loops[block.loops[0]], plan.paths[block.loops[0]], tree);
    } else {
      status = solve_by_newton(model, plan, block, tree, loops, data);
    }
    if (!status.ok()) return status;
    if (from_reference) {
      for (int i : block.dep_bodies) calc_moved(model, i, tree, loops);
    }
    calc_block_position(model, plan, block, tree, loops, data);
    status = calc_block_inverse(model, plan, block, loops, data);
    if (!status.ok()) return status;
    if (!(data.margin >= model.singularity.error)) {
      return {StatusCode::kLoopSingular, block.loops[0], data.margin, 0.0};
    }
    if (!loops.reference.valid || loops.reference.sign[b] == data.sign) continue;
    calc_block_map(block, data);
    if (!continues_reference(block, loops.reference.H[b], data)) {
      return {StatusCode::kBranchChanged, block.loops[0], data.margin, 0.0};
    }
  }
  return check_redundant(model, plan, tree, loops);
}

}  // namespace

template <class S>
Status calc_loop_position(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                          LoopData<S>& loops) {
  loops.has_leg_coordinates = loops.has_leg_poses = false;
  if (!loops.reference.valid) {
    const Status status = solve_blocks(model, plan, false, tree, loops);
    return status.ok() ? calc_leg_positions(model, plan, tree, loops) : status;
  }
  if (plan.iterates) loops.target = tree.q;
  Status status = solve_blocks(model, plan, true, tree, loops);
  if (status.ok()) return calc_leg_positions(model, plan, tree, loops);
  if (status.code != StatusCode::kLoopNotClosed) return status;
  // Too far for one step: walk there from the reference pose.
  constexpr int kSubSteps = 5;
  tree.q = loops.reference.q;
  for (int step = 1; step <= kSubSteps; ++step) {
    const S part = S(step) / S(kSubSteps);
    for (int i : plan.ind_q) {
      const S& from = loops.reference.q[i];
      tree.q[i] = step == kSubSteps ? loops.target[i] : S(from + part * (loops.target[i] - from));
    }
    status = solve_blocks(model, plan, false, tree, loops);
    if (!status.ok()) return status;
  }
  for (int i : plan.followed) calc_moved(model, i, tree, loops);
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    for (int i : plan.blocks[b].dep_bodies) calc_moved(model, i, tree, loops);
  }
  return calc_leg_positions(model, plan, tree, loops);
}

template <class S>
void calc_leg_cuts(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                   LoopData<S>& loops) {
  for (size_t b = plan.reduced_blocks; b < plan.blocks.size(); ++b) {
    calc_block_position(model, plan, plan.blocks[b], tree, loops, loops.block[b]);
  }
}

namespace {

/// reference.reach. @pre the rest of loops.reference
template <class S>
void keep_leg_reach(const LoopPlan& plan, LoopData<S>& loops) {
  constexpr double kRounding = 1e-9;
  LoopReference<S>& reference = loops.reference;
  for (size_t n = 0; n < loops.platform.size(); ++n) {
    double& least = reference.reach[n];
    least = std::numeric_limits<double>::infinity();
    for (const LegPlace& leg : loops.platform[n].legs) {
      const size_t b = static_cast<size_t>(leg.block);
      const LoopBlock& block = plan.blocks[b];
      const double margin = reference.margin[b];
      for (int i = 0; i < 3; ++i) {
        double row = 0.0;
        for (int j = 0; j < reference.H[b].cols(); ++j) {
          row += to_double(reference.H[b](i, j)) * to_double(reference.H[b](i, j));
        }
        const double reach =
            (1.0 - kRounding) * margin * block.dep_scale[i] / (2.0 * std::sqrt(row));
        least = std::min(least, margin < kNearSingular ? 0.0 : reach);
      }
    }
  }
}

}  // namespace

template <class S>
void keep_reference(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                    LoopData<S>& loops) {
  LoopReference<S>& reference = loops.reference;
  calc_leg_coordinates(model, tree, loops);
  calc_leg_maps(loops);
  reference.valid = true;
  reference.q = tree.q;
  for (size_t b = 0; b < loops.block.size(); ++b) {
    reference.H[b] = loops.block[b].H;
    reference.margin[b] = loops.block[b].margin;
    reference.branch[b] = loops.block[b].branch;
    reference.spin_branch[b] = loops.block[b].spin_branch;
    reference.sign[b] = loops.block[b].sign;
  }
  keep_leg_reach(plan, loops);
}

#define DOCK_INSTANTIATE(S)                                                                   \
  template Status calc_loop_position<S>(const MechanismModel&, const LoopPlan&, TreeData<S>&, \
                                        LoopData<S>&);                                        \
  template void keep_reference<S>(const MechanismModel&, const LoopPlan&, TreeData<S>&,       \
                                  LoopData<S>&);                                              \
  template void calc_leg_cuts<S>(const MechanismModel&, const LoopPlan&, const TreeData<S>&,  \
                                 LoopData<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
