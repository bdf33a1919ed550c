// The reduced equations of motion, for any scalar; see mechanism_dynamics.hpp.
#pragma once

#include <algorithm>
#include <type_traits>

#include "loops/loop_equations.hpp"
#include "math/scalar.hpp"
#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

template <class S>
MechanismData<S>::MechanismData(const Mechanism& mechanism)
    : tree(mechanism.model), loops(mechanism.model, mechanism.plan) {
  const int nv = mechanism.model.nv, n_ind = static_cast<int>(mechanism.plan.ind_v.size());
  A.setZero(nv, nv);
  A_ind.setZero(n_ind, n_ind);
  if (n_ind > 0) factor.compute(MatX<S>::Identity(n_ind, n_ind));  // sizes it
  for (auto* x : {&b, &tau, &vdot}) x->setZero(nv);
  scratch_v.setZero(nv);
  joint_load.resize(mechanism.model.bodies.size());
  scratch.resize(mechanism.model.bodies.size());
  b_ind.setZero(n_ind);
  a_ind.setZero(n_ind);
  if (!mechanism.skips_massless) return;
  const std::vector<char> moved = find_moved_by_loops(mechanism.model, mechanism.plan);
  tree.active.erase(
      std::remove_if(tree.active.begin(), tree.active.end(), [&](int i) { return moved[i] != 0; }),
      tree.active.end());
}

template <class S>
Status calc_position(const Mechanism& mechanism, MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    data.by_kernel = data.kernel && !data.whole && data.kernel->calc_position(data);
    if (data.by_kernel) return {};
  }
  const MechanismModel& model = mechanism.model;
  const std::vector<int>& ind = mechanism.plan.ind_v;
  const Status status = calc_loop_position(model, mechanism.plan, data.tree, data.loops);
  if (!status.ok()) return status;
  calc_velocity_maps(model, mechanism.plan, data.loops);
  calc_tree_position(model, data.tree);
  // Reduce the joint-space inertia and gather what is left.                          [Y2 (10)]
  calc_tree_inertia(model, data.tree);
  if (!mechanism.skips_massless) {
    data.A = data.tree.A;
    reduce_inertia(mechanism.plan, data.A, data.loops);
  }
  const MatX<S>& A = mechanism.skips_massless ? data.tree.A : data.A;
  for (size_t i = 0; i < ind.size(); ++i) {
    for (size_t j = 0; j < ind.size(); ++j) {
      data.A_ind(static_cast<int>(i), static_cast<int>(j)) = A(ind[i], ind[j]);
    }
  }
  if (ind.empty()) return {};
  data.factor.compute(data.A_ind);
  if (data.factor.info() != Eigen::Success) return {StatusCode::kInertiaNotPositive, -1, 0.0, 0.0};
  return {};
}

template <class S>
void calc_velocity(const Mechanism& mechanism, const BaseMotion<S>& base, MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    if (data.by_kernel) return data.kernel->calc_velocity(base, data);
  }
  calc_loop_velocity(mechanism.plan, data.tree, data.loops);
  calc_tree_velocity(mechanism.model, base.w, data.tree);
}

template <class S>
void calc_acceleration(const Mechanism& mechanism, const BaseMotion<S>& base,
                       MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    if (data.by_kernel) return data.kernel->calc_acceleration(base, data);
  }
  const std::vector<int>& ind = mechanism.plan.ind_v;
  // Right-hand side: applied less what zero joint accelerations would require.
  const VecX<S>* none = nullptr;
  calc_tree_acceleration(mechanism.model, base, none, data.tree);
  calc_tree_forces(mechanism.model, data.tree);
  data.b = data.tau - data.tree.tau_required;
  // Reduce it and solve for the independent accelerations.                      [Y2 (10), (11)]
  if (mechanism.skips_massless) {
    map_forces(mechanism.plan, data.b, data.loops);
  } else {
    calc_loop_bias(mechanism.model, mechanism.plan, data.tree, data.loops);
    reduce_forces(mechanism.plan, data.b, data.loops);
  }
  for (size_t i = 0; i < ind.size(); ++i) data.b_ind[static_cast<int>(i)] = data.b[ind[i]];
  VecX<S>& x = data.a_ind;
  x = data.b_ind;
  if (!ind.empty()) data.factor.solveInPlace(x);
  for (size_t i = 0; i < ind.size(); ++i) data.vdot[ind[i]] = x[static_cast<int>(i)];
  // And the dependent ones from them, unless nothing follows from those.             [Y2 (6)]
  if (!mechanism.skips_massless) calc_loop_acceleration(mechanism.plan, data.vdot, data.loops);
}

template <class S>
void calc_reactions(const Mechanism& mechanism, const BaseMotion<S>& base, int base_body,
                    MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    if (data.by_kernel) return data.kernel->calc_reactions(base, data);
  }
  if (mechanism.skips_massless) {
    calc_loop_bias(mechanism.model, mechanism.plan, data.tree, data.loops);
    calc_loop_acceleration(mechanism.plan, data.vdot, data.loops);
  }
  calc_loop_forces(mechanism.plan, data.vdot, data.loops);
  // Inverse dynamics with the true accelerations and no cut forces: what the children of the base
  // need in total. Cut forces between moving bodies cancel in the sum, those on the base itself
  // are part of what the base must supply.
  calc_tree_acceleration(mechanism.model, base, &data.vdot, data.tree);
  calc_tree_forces(mechanism.model, data.tree);
  data.on_base = Wrench<S>();
  for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
    if (mechanism.model.bodies[i].parent != base_body) continue;
    const Wrench<S>& load = data.tree.transmitted[i];
    data.on_base.f -= load.f;
    data.on_base.t -= load.t + data.tree.r[i].cross(load.f);
  }
}

template <class S>
void calc_joint_loads(const Mechanism& mechanism, MechanismData<S>& data) {
  const MechanismModel& model = mechanism.model;
  TreeData<S>& tree = data.tree;
  data.scratch = tree.external;
  // Put the cut forces on both bodies as external loads; then the tree tells the rest.
  for (size_t k = 0; k < model.loops.size(); ++k) {
    const Loop& loop = model.loops[k];
    if (loop.cut == CutType::kCoupling) continue;
    const CutData<S>& cut = data.loops.cut[k];
    S lambda[kMaxEquations];
    for (int j = 0; j < equation_count(loop.cut); ++j) {
      lambda[j] = get_cut_force(mechanism.plan, data.loops, static_cast<int>(k), j);
    }
    Vec3<S> force = Vec3<S>::Zero(), moment = Vec3<S>::Zero();
    if (loop.cut == CutType::kPlanarRevolute) {
      force = cut.plane.row(0).transpose() * lambda[0] + cut.plane.row(1).transpose() * lambda[1];
    } else {
      force = Vec3<S>(lambda[0], lambda[1], lambda[2]);
    }
    for (size_t j = 0; j < mechanism.plan.cross_axes[k].size(); ++j) {
      moment += lambda[3 + j] * cut.axis_T[j].cross(cut.axis_I);
    }
    const int lca = mechanism.plan.paths[k].lca;
    if (lca != kBase) {
      force = (tree.R[lca] * force).eval();
      moment = (tree.R[lca] * moment).eval();
    }
    const auto add = [&](int body, const Vec3<double>& point, const S& sign) {
      if (body == kBase) return;
      const Vec3<S> arm = tree.R[body] * point.template cast<S>();
      tree.external[body].f += sign * force;
      tree.external[body].t += sign * (moment + arm.cross(force));
    };
    add(loop.terminal, loop.point_on_terminal, S(1));
    add(loop.closing, loop.point_on_closing, S(-1));
  }
  calc_tree_forces(model, tree);
  data.joint_load = tree.transmitted;
  tree.external = data.scratch;
}

template <class S>
double find_closure_residual(const Mechanism& mechanism, const MechanismData<S>& data) {
  double largest = 0.0;
  for (size_t k = 0; k < mechanism.model.loops.size(); ++k) {
    for (int j = 0; j < equation_count(mechanism.model.loops[k].cut); ++j) {
      largest = std::max(largest, std::abs(to_double(data.loops.cut[k].residual[j])));
    }
  }
  return largest;
}

template <class S>
double find_singularity_margin(const MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    if (data.by_kernel) return data.kernel->find_margin();
  }
  double margin = 1.0;
  for (const BlockData<S>& block : data.loops.block) margin = std::min(margin, block.margin);
  return margin;
}

#define DOCK_INSTANTIATE(S)                                                                        \
  template struct MechanismData<S>;                                                                \
  template Status calc_position<S>(const Mechanism&, MechanismData<S>&);                           \
  template void calc_velocity<S>(const Mechanism&, const BaseMotion<S>&, MechanismData<S>&);       \
  template void calc_acceleration<S>(const Mechanism&, const BaseMotion<S>&, MechanismData<S>&);   \
  template void calc_joint_loads<S>(const Mechanism&, MechanismData<S>&);                          \
  template void calc_reactions<S>(const Mechanism&, const BaseMotion<S>&, int, MechanismData<S>&); \
  template double find_closure_residual<S>(const Mechanism&, const MechanismData<S>&);             \
  template double find_singularity_margin<S>(const MechanismData<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
