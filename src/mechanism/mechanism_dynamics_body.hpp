// The reduced equations of motion, for any scalar; see mechanism_dynamics.hpp.
//
// Tags as [Y2 (10)] name equations of the paper: loops/README.md has the map. In names of
// functions, "tree" stands for bodies, "loop" for loops, "leg" for legs of platforms
// (loops/LEGS.md).
#pragma once

#include <algorithm>
#include <type_traits>

#include "loops/loop_equations.hpp"
#include "math/dock_assert.hpp"
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
  if (const int n = n_ind - 6; mechanism.vehicle != kBase && n > 0) {
    A_held.setIdentity(n, n);
    factor_held.compute(A_held);
    b_held.setZero(n);
  }
  for (auto* x : {&b, &tau, &vdot}) x->setZero(nv);
  scratch_v.setZero(nv);
  joint_load.resize(mechanism.model.bodies.size());
  scratch.resize(mechanism.model.bodies.size());
  b_ind.setZero(n_ind);
  a_ind.setZero(n_ind);
  A_tree.setZero(nv, nv);
}

namespace {

/// Joint-space inertia of what remains in the tree, and of the legs at their tips, reduced.
template <class S>
void calc_reduced_inertia(const Mechanism& mechanism, Need need, MechanismData<S>& data) {
  const MechanismModel& model = mechanism.model;
  const LoopPlan& plan = mechanism.plan;
  const std::vector<int>& ind = plan.ind_v;
  calc_body_inertia(model, plan.tree_bodies, data.tree);
  add_leg_masses(plan, data.loops, data.tree);
  calc_composite_inertia(model, plan.tree_bodies, data.tree, data.A_tree);
  add_leg_inertia(model, plan, data.tree, data.loops, data.A_tree);
  if (need == Need::kEverything && plan.platforms.empty()) data.tree.A = data.A_tree;
  // Reduce it and gather what is left.                                              [Y2 (10)]
  const bool reduces = plan.reduced_blocks > 0;
  if (reduces) {
    data.A = data.A_tree;
    reduce_inertia(plan, data.A, data.loops);
  }
  const MatX<S>& A = reduces ? data.A : data.A_tree;
  const int n = static_cast<int>(ind.size());
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) data.A_ind(i, j) = A(ind[i], ind[j]);
  }
}

}  // namespace

template <class S>
Status calc_position(const Mechanism& mechanism, MechanismData<S>& data, Need need) {
  if constexpr (std::is_same_v<S, double>) {
    // Generated code finds the position, or leaves it to the general code below.
    data.found = Need::kRates;
    if (need == Need::kRates && data.generated && data.generated->calc_position(data)) return {};
  }
  const MechanismModel& model = mechanism.model;
  const LoopPlan& plan = mechanism.plan;
  const std::vector<int>& ind = plan.ind_v;
  data.found = need == Need::kEverything ? need : Need::kState;
  const Status status = calc_loop_position(model, plan, data.tree, data.loops);
  if (!status.ok()) return status;
  calc_velocity_maps(model, plan, data.loops);
  if (need == Need::kEverything && !plan.platforms.empty()) {
    calc_leg_poses(model, data.tree, data.loops);
    calc_leg_cuts(model, plan, data.tree, data.loops);
    calc_leg_maps(data.loops);
    calc_tree_position(model, data.tree.all, data.tree);
    calc_tree_inertia(model, data.tree);
  } else {
    calc_tree_position(model, plan.tree_bodies, data.tree);
  }
  if (plan.is_free_platform) {
    calc_free_inertia(model, plan, data.loops, data.tree, data.A_ind);
  } else {
    calc_reduced_inertia(mechanism, need, data);
  }
  if (ind.empty()) return {};
  data.factor.compute(data.A_ind);
  if (data.factor.info() != Eigen::Success) return {StatusCode::kInertiaNotPositive, -1, 0.0, 0.0};
  return {};
}

template <class S>
void calc_velocity(const Mechanism& mechanism, const BaseMotion<S>& base, MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    if (data.found == Need::kRates) return data.generated->calc_velocity(base, data);
  }
  const MechanismModel& model = mechanism.model;
  const LoopPlan& plan = mechanism.plan;
  calc_loop_velocity(plan, data.tree, data.loops);
  calc_tree_velocity(model, plan.tree_bodies, base.w, data.tree);
  calc_leg_velocities(model, plan, base.w, data.tree, data.loops);
  if (data.found != Need::kEverything || plan.platforms.empty()) return;
  put_leg_velocities(data.tree, data.loops);
  calc_tree_velocity(model, plan.leg_bodies, base.w, data.tree);
}

namespace {

/// Independent accelerations with that of the vehicle prescribed, and the load that this takes.
template <class S>
void solve_held(MechanismData<S>& data) {
  const int n = static_cast<int>(data.b_ind.size()) - 6;
  VecX<S>& x = data.a_ind;
  x.template head<6>() = *data.prescribed;
  x.tail(n) -= data.A_ind.bottomLeftCorner(n, 6).lazyProduct(*data.prescribed);
  if (n > 0) {
    data.A_held = data.A_ind.bottomRightCorner(n, n);
    data.b_held = x.tail(n);
    data.factor_held.compute(data.A_held);
    data.factor_held.solveInPlace(data.b_held);
    x.tail(n) = data.b_held;
  }
  data.on_vehicle = data.A_ind.template topRows<6>().lazyProduct(x) - data.b_ind.template head<6>();
}

}  // namespace

template <class S>
void calc_acceleration(const Mechanism& mechanism, const BaseMotion<S>& base,
                       MechanismData<S>& data) {
  if constexpr (std::is_same_v<S, double>) {
    if (data.found == Need::kRates) return data.generated->calc_acceleration(base, data);
  }
  const MechanismModel& model = mechanism.model;
  const LoopPlan& plan = mechanism.plan;
  const std::vector<int>& ind = plan.ind_v;
  // Right-hand side: applied less what zero joint accelerations would require.
  const VecX<S>* none = nullptr;
  calc_tree_acceleration(model, plan.tree_bodies, base, none, data.tree);
  if (plan.is_free_platform) {
    calc_free_forces(model, plan, base, data.tau, data.tree, data.loops, data.b_ind);
  } else {
    calc_body_forces(model, plan.tree_bodies, data.tree);
    add_leg_biases(model, plan, base, data.tau, data.tree, data.loops);
    calc_transmitted(model, plan.tree_bodies, data.tree);
    data.b = data.tau - data.tree.tau_required;
    // Reduce it and solve for the independent accelerations.                    [Y2 (10), (11)]
    calc_loop_bias(model, plan, data.tree, data.loops);
    reduce_forces(plan, data.b, data.loops);
    for (size_t i = 0; i < ind.size(); ++i) data.b_ind[static_cast<int>(i)] = data.b[ind[i]];
  }
  VecX<S>& x = data.a_ind;
  x = data.b_ind;
  if (data.prescribed) {
    solve_held(data);
  } else if (!ind.empty()) {
    data.factor.solveInPlace(x);
  }
  for (size_t i = 0; i < ind.size(); ++i) data.vdot[ind[i]] = x[static_cast<int>(i)];
  // And the dependent ones from them.                                                [Y2 (6)]
  calc_loop_acceleration(plan, data.vdot, data.loops);
  if (data.found == Need::kEverything) put_leg_accelerations(plan, data.vdot, data.loops);
  // A fixed base does not fall: the energy audit needs the power of the weight.
  if (mechanism.vehicle == kBase && !(base.gravity.array() == S(0)).all()) {
    data.linear_momentum = find_motion_sums(mechanism, data).momentum.f;
  }
}

template <class S>
void calc_reactions(const Mechanism& mechanism, const BaseMotion<S>& base, int base_body,
                    MechanismData<S>& data) {
  DOCK_ASSERT(data.found != Need::kRates);
  const MechanismModel& model = mechanism.model;
  const LoopPlan& plan = mechanism.plan;
  TreeData<S>& tree = data.tree;
  calc_loop_forces(plan, data.vdot, data.loops);
  // Inverse dynamics with the true accelerations and no cut forces: what the children of the base
  // need in total. Cut forces between moving bodies cancel in the sum, those on the base itself
  // are part of what the base must supply.
  calc_tree_acceleration(model, plan.tree_bodies, base, &data.vdot, tree);
  if (plan.is_free_platform) calc_body_inertia(model, plan.tree_bodies, tree);
  calc_body_forces(model, plan.tree_bodies, tree);
  data.on_base = Wrench<S>();
  add_leg_loads(plan, base, base_body, data.vdot, tree, data.loops, data.on_base);
  calc_transmitted(model, plan.tree_bodies, tree);
  for (int i : plan.tree_bodies) {
    if (model.bodies[i].parent != base_body) continue;
    const Wrench<S>& load = tree.transmitted[i];
    data.on_base.f -= load.f;
    data.on_base.t -= load.t + tree.r[i].cross(load.f);
  }
  if (data.found != Need::kEverything || plan.platforms.empty()) return;
  calc_tree_acceleration(model, plan.leg_bodies, base, &data.vdot, tree);
  calc_tree_forces(model, tree);
}

template <class S>
Wrench<S> find_carried_load(const Mechanism& mechanism, int parent, int first, int end,
                            const TreeData<S>& tree) {
  Wrench<S> sum;
  for (int i = first; i < end; ++i) {
    if (mechanism.model.bodies[i].parent != parent) continue;
    const Wrench<S>& load = tree.transmitted[i];
    sum.f -= load.f;
    sum.t -= load.t + tree.r[i].cross(load.f);
  }
  return sum;
}

template <class S>
void keep_reference(const Mechanism& mechanism, MechanismData<S>& data) {
  keep_reference(mechanism.model, mechanism.plan, data.tree, data.loops);
}

template <class S>
void calc_leg_bodies(const Mechanism& mechanism, MechanismData<S>& data) {
  DOCK_ASSERT(data.found != Need::kRates);
  calc_leg_poses(mechanism.model, data.tree, data.loops);
  put_leg_velocities(data.tree, data.loops);
  calc_tree_position(mechanism.model, mechanism.plan.leg_bodies, data.tree);
}

namespace {

/// Momentum of one body, angular part about its origin, base axes.
template <class S>
Wrench<S> find_own_momentum(const Mechanism& mechanism, int i, const TreeData<S>& tree) {
  const Vec3<S>&w = tree.w[i], &u = tree.u[i];
  const BodyInertia<S> of = get_body_inertia(mechanism, i, tree);
  const Body& body = mechanism.model.bodies[i];
  Wrench<S> own{S(body.mass) * u + w.cross(of.h), of.I * w + of.h.cross(u)};
  if (body.joint == JointType::kMode)
    own += tree.v[body.v_index] * find_mode_momentum(body, tree.R[i]);
  return own;
}

}  // namespace

template <class S>
S find_mechanism_energy(const Mechanism& mechanism, const MechanismData<S>& data) {
  DOCK_ASSERT(data.found != Need::kRates);
  const TreeData<S>& tree = data.tree;
  S energy(0);
  for (int i : mechanism.plan.tree_bodies) {
    if (i == mechanism.vehicle) continue;
    const Wrench<S> own = find_own_momentum(mechanism, i, tree);
    energy += S(0.5) * (tree.u[i].dot(own.f) + tree.w[i].dot(own.t));
    const Body& body = mechanism.model.bodies[i];
    if (body.joint != JointType::kMode) continue;
    const Wrench<S> momentum = find_mode_momentum(body, tree.R[i]);
    const S& rate = tree.v[body.v_index];
    energy += S(0.5) * rate * (tree.u[i].dot(momentum.f) + tree.w[i].dot(momentum.t) + rate);
  }
  for (size_t n = 0; n < mechanism.plan.platforms.size(); ++n) {
    energy += find_leg_energy(mechanism.plan.platforms[n], tree, data.loops.platform[n]);
  }
  return energy;
}

template <class S>
LegSums<S> find_motion_sums(const Mechanism& mechanism, const MechanismData<S>& data) {
  DOCK_ASSERT(data.found != Need::kRates);
  const TreeData<S>& tree = data.tree;
  LegSums<S> sum{S(0), Vec3<S>::Zero(), {}};
  for (int i : mechanism.plan.tree_bodies) {
    if (i == mechanism.vehicle) continue;
    const S m(mechanism.model.bodies[i].mass);
    const Wrench<S> own = find_own_momentum(mechanism, i, tree);
    sum.mass += m;
    sum.first_moment += get_body_inertia(mechanism, i, tree).h + m * tree.p[i];
    sum.momentum.f += own.f;
    sum.momentum.t += own.t + tree.p[i].cross(own.f);
  }
  for (size_t n = 0; n < mechanism.plan.platforms.size(); ++n) {
    const LegPlatform& platform = mechanism.plan.platforms[n];
    const LegSums<S> legs = find_leg_sums(platform, tree, data.loops.platform[n]);
    Vec3<S> p = Vec3<S>::Zero();
    if (platform.root != kBase) p = tree.p[platform.root];
    sum.mass += legs.mass;
    sum.first_moment += legs.first_moment + legs.mass * p;
    sum.momentum.f += legs.momentum.f;
    sum.momentum.t += legs.momentum.t + p.cross(legs.momentum.f);
  }
  return sum;
}

template <class S>
void calc_joint_loads(const Mechanism& mechanism, MechanismData<S>& data) {
  DOCK_ASSERT(data.found == Need::kEverything);
  const MechanismModel& model = mechanism.model;
  TreeData<S>& tree = data.tree;
  data.scratch = tree.external;
  // Put the cut forces on both bodies as external loads; then the tree finds the rest.
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
      force = tree.R[lca] * force;
      moment = tree.R[lca] * moment;
    }
    const auto add = [&](int body, const Vec3<double>& point, const S& sign) {
      if (body == kBase) return;
      const Vec3<S> arm = tree.R[body] * cast<S>(point);
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
double find_closure_residual(const Mechanism& mechanism, MechanismData<S>& data) {
  DOCK_ASSERT(data.found != Need::kRates);
  const LoopPlan& plan = mechanism.plan;
  if (!plan.platforms.empty()) {
    calc_leg_poses(mechanism.model, data.tree, data.loops);
    calc_leg_cuts(mechanism.model, plan, data.tree, data.loops);
  }
  double largest = 0.0;
  for (size_t k = 0; k < mechanism.model.loops.size(); ++k) {
    for (int j = 0; j < equation_count(mechanism.model.loops[k].cut); ++j) {
      largest = std::max(largest, std::abs(to_double(data.loops.cut[k].residual[j])));
    }
  }
  return largest;
}

template <class S>
double find_singularity_margin(const Mechanism& mechanism, const MechanismData<S>& data) {
  double margin = 1.0;
  for (size_t b = 0; b < mechanism.plan.reduced_blocks; ++b) {
    margin = std::min(margin, data.loops.block[b].margin);
  }
  for (const PlatformData<S>& at : data.loops.platform) {
    margin = std::min(margin, find_leg_margin(at));
  }
  return margin;
}

template <class S>
bool has_passed_singular_pose(const Mechanism& mechanism, const MechanismData<S>& data) {
  const LoopReference<S>& reference = data.loops.reference;
  if (!reference.valid) return false;
  for (size_t b = 0; b < mechanism.plan.reduced_blocks; ++b) {
    if (data.loops.block[b].sign != reference.sign[b]) return true;
  }
  return false;
}

#define DOCK_INSTANTIATE(S)                                                                        \
  template struct MechanismData<S>;                                                                \
  template Status calc_position<S>(const Mechanism&, MechanismData<S>&, Need);                     \
  template void calc_velocity<S>(const Mechanism&, const BaseMotion<S>&, MechanismData<S>&);       \
  template void calc_acceleration<S>(const Mechanism&, const BaseMotion<S>&, MechanismData<S>&);   \
  template void calc_joint_loads<S>(const Mechanism&, MechanismData<S>&);                          \
  template void calc_reactions<S>(const Mechanism&, const BaseMotion<S>&, int, MechanismData<S>&); \
  template Wrench<S> find_carried_load<S>(const Mechanism&, int, int, int, const TreeData<S>&);    \
  template void keep_reference<S>(const Mechanism&, MechanismData<S>&);                            \
  template void calc_leg_bodies<S>(const Mechanism&, MechanismData<S>&);                           \
  template S find_mechanism_energy<S>(const Mechanism&, const MechanismData<S>&);                  \
  template LegSums<S> find_motion_sums<S>(const Mechanism&, const MechanismData<S>&);              \
  template double find_closure_residual<S>(const Mechanism&, MechanismData<S>&);                   \
  template double find_singularity_margin<S>(const Mechanism&, const MechanismData<S>&);           \
  template bool has_passed_singular_pose<S>(const Mechanism&, const MechanismData<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
