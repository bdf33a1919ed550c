// Residual, columns and bias of one cut; see loop_equations.hpp.
#pragma once

#include <algorithm>

#include "loops/loop_equations.hpp"
#include "loops/path_motion.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

/// Poses in L of the bodies on one path, and of a point on the last one.
template <class S>
Vec3<S> calc_path(const TreeData<S>& tree, const std::vector<int>& path, const Vec3<double>& point,
                  std::vector<Pose<S>>& pose) {
  for (size_t i = 0; i < path.size(); ++i) {
    pose[i] = i == 0 ? tree.joint[path[i]] : pose[i - 1] * tree.joint[path[i]];
  }
  const Vec3<S> local = cast<S>(point);
  return path.empty() ? local : pose.back().R * local + pose.back().p;
}

template <class S>
Vec3<S> rotate_to_lca(const std::vector<Pose<S>>& pose, const Vec3<double>& axis) {
  const Vec3<S> local = cast<S>(axis);
  return pose.empty() ? local : pose.back().R * local;
}

/// Columns of one path, times `sign`.
template <class S>
void calc_path_columns(const MechanismModel& model, const std::vector<int>& path,
                       const std::vector<Pose<S>>& pose, const Vec3<S>& point, const S& sign,
                       CutType type, size_t cross_count, const std::array<int, kMaxEquations>& rows,
                       const std::vector<int>& column_of, const CutData<S>& cut, MatX<S>& G) {
  for (size_t i = 0; i < path.size(); ++i) {
    const Body& body = model.bodies[path[i]];
    Vec3<S> e = Vec3<S>::Zero();
    if (body.joint != JointType::kFree) e = pose[i].R * cast<S>(body.axis);
    const Vec3<S> arm = point - pose[i].p;
    for (int k = 0; k < body.nv(); ++k) {
      const int column = column_of[body.v_index + k];
      if (column < 0) continue;
      Vec3<S> angular, linear;
      get_joint_column(body, pose[i].R, e, k, angular, linear);
      if (body.joint != JointType::kPrismatic) linear += angular.cross(arm);
      if (type == CutType::kPlanarRevolute) {
        for (int j = 0; j < 2; ++j) {
          if (rows[j] >= 0) G(rows[j], column) = sign * cut.plane.row(j).dot(linear);
        }
        continue;
      }
      for (int j = 0; j < 3; ++j) {
        if (rows[j] >= 0) G(rows[j], column) = sign * linear[j];
      }
      for (size_t j = 0; j < cross_count; ++j) {
        // n = A x B is a unit vector only when the loop is closed and is never normalised.
        if (rows[3 + j] >= 0) {
          G(rows[3 + j], column) = sign * cut.axis_T[j].cross(cut.axis_I).dot(angular);
        }
      }
    }
  }
}

/// The bias of a leg in closed form: only the acceleration of its tip.
template <class S>
Vec3<S> calc_leg_bias(const MechanismModel& model, const ClosedForm& form, const TreeData<S>& tree,
                      const BlockData<S>& data) {
  Vec3<S> rate;
  for (int i = 0; i < 3; ++i) {
    rate[i] = S(form.joint[i].sign) * tree.v[model.bodies[form.joint[i].body].v_index];
  }
  return data.leg_axes * find_leg_bias<S>(form.kind, form.shape, data.leg, rate);
}

}  // namespace

template <class S>
void calc_cut_position(const MechanismModel& model, const LoopPlan& plan, int loop_index,
                       const TreeData<S>& tree, CutData<S>& cut) {
  const Loop& loop = model.loops[loop_index];
  const LoopPaths& paths = plan.paths[loop_index];
  if (loop.cut == CutType::kCoupling) {
    S residual = -S(loop.offset) - S(loop.rate) * tree.time;
    for (int body : paths.tied) {
      residual += S(find_coupling_factor(loop, body)) * tree.q[model.bodies[body].q_index];
    }
    cut.residual[0] = residual;
    return;
  }
  cut.p_T = calc_path(tree, paths.terminal, loop.point_on_terminal, cut.terminal);
  cut.p_I = calc_path(tree, paths.closing, loop.point_on_closing, cut.closing);
  const Vec3<S> gap = cut.p_T - cut.p_I;
  if (loop.cut == CutType::kPlanarRevolute) {
    cut.plane = cast<S>(loop.plane_axes_in_root);
    if (paths.root_on_terminal >= 0) {
      cut.plane = cut.plane * cut.terminal[paths.root_on_terminal].R.transpose();
    }
    cut.residual.template head<2>() = cut.plane * gap;
    return;
  }
  cut.residual.template head<3>() = gap;
  const std::vector<Vec3<double>>& cross = plan.cross_axes[loop_index];
  if (cross.empty()) return;
  cut.axis_I = rotate_to_lca(cut.closing, loop.axis_on_closing);
  for (size_t j = 0; j < cross.size(); ++j) {
    cut.axis_T[j] = rotate_to_lca(cut.terminal, cross[j]);
    cut.residual[3 + static_cast<int>(j)] = cut.axis_T[j].dot(cut.axis_I);
  }
}

template <class S>
void calc_cut_columns(const MechanismModel& model, const LoopPlan& plan, int loop_index,
                      const std::array<int, kMaxEquations>& rows, const std::vector<int>& column_of,
                      const CutData<S>& cut, MatX<S>& G) {
  const Loop& loop = model.loops[loop_index];
  if (loop.cut == CutType::kCoupling) {
    for (int body : plan.paths[loop_index].tied) {
      const int column = column_of[model.bodies[body].v_index];
      if (rows[0] >= 0 && column >= 0) G(rows[0], column) = S(find_coupling_factor(loop, body));
    }
    return;
  }
  const LoopPaths& paths = plan.paths[loop_index];
  const size_t cross_count = plan.cross_axes[loop_index].size();
  calc_path_columns(model, paths.terminal, cut.terminal, cut.p_T, S(1), loop.cut, cross_count, rows,
                    column_of, cut, G);
  calc_path_columns(model, paths.closing, cut.closing, cut.p_I, S(-1), loop.cut, cross_count, rows,
                    column_of, cut, G);
}

template <class S>
void calc_cut_bias(const MechanismModel& model, const LoopPlan& plan, int loop_index,
                   const std::array<int, kMaxEquations>& rows, const TreeData<S>& tree,
                   const CutData<S>& cut, const BlockData<S>* leg, VecX<S>& gamma) {
  const Loop& loop = model.loops[loop_index];
  if (loop.cut == CutType::kCoupling) {
    if (rows[0] >= 0) gamma[rows[0]] = S(0);
    return;
  }
  const LoopPaths& paths = plan.paths[loop_index];
  const PathBias<S> I = calc_path_bias(model, tree, paths.closing, cut.closing, cut.p_I);
  PathBias<S> T;
  if (leg) {
    T.a = calc_leg_bias(model, *plan.blocks[plan.block_of_loop[loop_index]].form(), tree, *leg);
  } else {
    T = calc_path_bias(model, tree, paths.terminal, cut.terminal, cut.p_T);
  }
  const Vec3<S> a = T.a - I.a;
  if (loop.cut == CutType::kPlanarRevolute) {
    for (int j = 0; j < 2; ++j) {
      if (rows[j] >= 0) gamma[rows[j]] = cut.plane.row(j).dot(a);
    }
    return;
  }
  for (int j = 0; j < 3; ++j) {
    if (rows[j] >= 0) gamma[rows[j]] = a[j];
  }
  for (size_t j = 0; j < plan.cross_axes[loop_index].size(); ++j) {
    if (rows[3 + j] < 0) continue;
    const Vec3<S> n = cut.axis_T[j].cross(cut.axis_I);
    const Vec3<S> n_dot =
        T.w.cross(cut.axis_T[j]).cross(cut.axis_I) + cut.axis_T[j].cross(I.w.cross(cut.axis_I));
    gamma[rows[3 + j]] = n.dot(T.alpha - I.alpha) + n_dot.dot(T.w - I.w);
  }
}

#define DOCK_INSTANTIATE(S)                                                                 \
  template void calc_cut_position<S>(const MechanismModel&, const LoopPlan&, int,           \
                                     const TreeData<S>&, CutData<S>&);                      \
  template void calc_cut_columns<S>(const MechanismModel&, const LoopPlan&, int,            \
                                    const std::array<int, kMaxEquations>&,                  \
                                    const std::vector<int>&, const CutData<S>&, MatX<S>&);  \
  template void calc_cut_bias<S>(const MechanismModel&, const LoopPlan&, int,               \
                                 const std::array<int, kMaxEquations>&, const TreeData<S>&, \
                                 const CutData<S>&, const BlockData<S>*, VecX<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
