// Residual and Jacobian of the docking with multipliers; see unreduced_model.hpp.
#include "compare/unreduced_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "loops/loop_equations.hpp"

namespace dockloop {

UnreducedModel::UnreducedModel(const DockingModel& model, DaeForm chosen) : form(chosen) {
  const MechanismModel& mechanism = model.mechanism.model;
  for (const LoopBlock& block : model.mechanism.plan.blocks) {
    row.push_back(block.row);
    for (auto& rows : row.back()) {
      for (int& equation : rows) equation += equation < 0 ? 0 : cuts;
    }
    rate.resize(static_cast<size_t>(cuts + block.size()), 0.0);
    for (size_t i = 0; i < block.loops.size(); ++i) {
      const Loop& loop = mechanism.loops[block.loops[i]];
      if (loop.rate != 0.0) rate[row.back()[i][0]] = loop.rate;
    }
    for (int i = 0; i < block.size(); ++i) {
      dep_v.push_back(block.dep[i]);
      dep_q.push_back(mechanism.bodies[block.dep_bodies[i]].q_index);
    }
    cuts += block.size();
  }
  int at = head = model.layout.size;
  const auto take = [&at](int count) {
    const int first = at;
    at += count;
    return first;
  };
  q_dep = take(cuts);
  v_dep = take(cuts);
  v_chaser = take(model.mechanism.vehicle != kBase ? 6 : 0);
  lambda = take(cuts);
  mu = take(form == DaeForm::kStabilised ? cuts : 0);
  size = at;
}

UnreducedData::UnreducedData(const DockingModel& model, const UnreducedModel& unreduced)
    : docking(model) {
  const int nv = model.mechanism.model.nv;
  G.setZero(unreduced.cuts, nv);
  for (auto* x : {&gap, &bias}) x->setZero(unreduced.cuts);
  for (auto* x : {&flow, &missing}) x->setZero(nv);
  rates.setZero(unreduced.head);
  for (auto* x : {&z, &zdot, &residual}) x->setZero(unreduced.size);
  all_columns.resize(static_cast<size_t>(nv));
  std::iota(all_columns.begin(), all_columns.end(), 0);
}

namespace {

/// Motion of the tree and the cuts from z.
void calc_motion(const DockingModel& model, const UnreducedModel& unreduced, double t,
                 const double* z, UnreducedData& data) {
  const MechanismModel& mechanism = model.mechanism.model;
  const LoopPlan& plan = model.mechanism.plan;
  TreeData<double>& tree = data.docking.mechanism.tree;
  LoopData<double>& loops = data.docking.mechanism.loops;
  put_mechanism_state(model, z, tree);
  for (int i = 0; i < unreduced.cuts; ++i) {
    tree.q[unreduced.dep_q[i]] = z[unreduced.q_dep + i];
    tree.v[unreduced.dep_v[i]] = z[unreduced.v_dep + i];
  }
  if (model.mechanism.vehicle != kBase) {
    for (int i = 0; i < 6; ++i) tree.v[i] = z[unreduced.v_chaser + i];
  }
  tree.time = t;
  for (int i = 0; i < static_cast<int>(mechanism.bodies.size()); ++i) {
    calc_joint_pose(mechanism, i, tree);
  }
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    for (size_t i = 0; i < plan.blocks[b].loops.size(); ++i) {
      const int k = plan.blocks[b].loops[i];
      const std::array<int, kMaxEquations>& row = unreduced.row[b][i];
      calc_cut_position(mechanism, plan, k, tree, loops.cut[k]);
      calc_cut_columns(mechanism, plan, k, row, data.all_columns, loops.cut[k], data.G);
      calc_cut_bias<double>(mechanism, plan, k, row, tree, loops.cut[k], nullptr, data.bias);
      for (int j = 0; j < kMaxEquations; ++j) {
        if (row[j] >= 0) data.gap[row[j]] = loops.cut[k].residual[j];
      }
    }
  }
}

}  // namespace

Status calc_unreduced_residual(const DockingModel& model, const UnreducedModel& unreduced,
                               const DiscreteState& discrete, const ContactMemory& memory,
                               const Loads& loads, double t, const double* z, const double* zdot,
                               double* residual, UnreducedData& data) {
  using Vector = Eigen::Map<const VecX<double>>;
  const MechanismModel& mechanism = model.mechanism.model;
  const StateLayout& layout = model.layout;
  MechanismData<double>& dynamics = data.docking.mechanism;
  TreeData<double>& tree = dynamics.tree;
  const Vector lambda(z + unreduced.lambda, unreduced.cuts);
  calc_motion(model, unreduced, t, z, data);
  calc_tree_position(mechanism, tree.all, tree);
  calc_tree_inertia(mechanism, tree);
  calc_tree_velocity(mechanism, tree.all, data.docking.base.w, tree);
  calc_frames(model, z, data.docking);
  const Status status =
      calc_loads(model, discrete, memory, loads, t, z, data.rates.data(), data.docking);
  if (!status.ok()) return status;

  // Inverse dynamics with the accelerations in zdot.
  VecX<double>& vdot = dynamics.vdot;
  int q = layout.mechanism_q, v = layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    for (int j = 0; j < mechanism.bodies[i].nv(); ++j) {
      vdot[mechanism.bodies[i].v_index + j] = zdot[v++];
    }
  }
  for (int i = 0; i < unreduced.cuts; ++i) vdot[unreduced.dep_v[i]] = zdot[unreduced.v_dep + i];
  if (model.mechanism.vehicle != kBase) {
    for (int i = 0; i < 6; ++i) vdot[i] = zdot[unreduced.v_chaser + i];
  }
  calc_tree_acceleration<double>(mechanism, tree.all, data.docking.base, &vdot, tree);
  calc_tree_forces(mechanism, tree);
  data.missing = tree.tau_required - dynamics.tau;
  data.missing.noalias() -= data.G.transpose().lazyProduct(lambda);
  data.flow = tree.v;
  if (unreduced.form == DaeForm::kStabilised) {
    data.flow.noalias() += data.G.transpose().lazyProduct(Vector(z + unreduced.mu, unreduced.cuts));
  }

  // Vehicles and contact, then the mechanism.
  int first = 0;
  for (BlockData<double>& block : dynamics.loops.block) {  // for the power of drives
    block.lambda = lambda.segment(first, block.lambda.size());
    first += static_cast<int>(block.lambda.size());
  }
  Wrench<double> momentum;  // of all bodies
  for (int i : tree.all) momentum += find_body_momentum(model.mechanism, i, tree);
  dynamics.linear_momentum = momentum.f;
  calc_vehicle_rates(model, loads, z, data.rates.data(), data.docking);
  for (int i = 0; i < unreduced.head; ++i) residual[i] = zdot[i] - data.rates[i];
  v = layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    const Body& body = mechanism.bodies[i];
    calc_coordinate_rates(body, tree.q, data.flow, data.rates.data());
    for (int j = 0; j < body.nq(); ++j, ++q) residual[q] = zdot[q] - data.rates[j];
    for (int j = 0; j < body.nv(); ++j) residual[v++] = data.missing[body.v_index + j];
  }
  for (int i = 0; i < unreduced.cuts; ++i) {
    residual[unreduced.q_dep + i] = zdot[unreduced.q_dep + i] - data.flow[unreduced.dep_v[i]];
    residual[unreduced.v_dep + i] = data.missing[unreduced.dep_v[i]];
  }
  if (model.mechanism.vehicle != kBase) {
    for (int j = 0; j < 3; ++j) {
      residual[unreduced.v_chaser + j] = momentum.f[j] - z[layout.momentum[kChaser] + j];
      residual[unreduced.v_chaser + 3 + j] = momentum.t[j] - z[layout.momentum[kChaser] + 3 + j];
    }
  }

  // Cuts.
  const double c = unreduced.form == DaeForm::kBaumgarte ? 1.0 / kBaumgarteTime : 0.0;
  for (int i = 0; i < unreduced.cuts; ++i) {
    const double gap_rate = data.G.row(i).dot(tree.v) - unreduced.rate[i];
    if (unreduced.form == DaeForm::kStabilised) {
      residual[unreduced.lambda + i] = gap_rate;
      residual[unreduced.mu + i] = data.gap[i];
    } else {
      residual[unreduced.lambda + i] =
          data.G.row(i).dot(vdot) + data.bias[i] + c * (2.0 * gap_rate + c * data.gap[i]);
    }
  }
  return {};
}

namespace {

/// Energies and impulses: only their rates enter.
bool is_sum(const DockingModel& model, int unknown) {
  return unknown >= model.layout.sums && unknown < model.layout.element_bristles;
}

}  // namespace

int find_unreduced_jacobian_cost(const DockingModel& model, const UnreducedModel& unreduced) {
  return unreduced.lambda - (model.layout.element_bristles - model.layout.sums);
}

Status calc_unreduced_jacobian(const DockingModel& model, const UnreducedModel& unreduced,
                               const DiscreteState& discrete, const ContactMemory& memory,
                               const Loads& loads, double t, double alpha, const double* z,
                               const double* zdot, const double* residual,
                               const VecX<double>& nominal, double* by_columns,
                               UnreducedData& data) {
  const int n = unreduced.size;
  Eigen::Map<MatX<double>> J(by_columns, n, n);
  J.setZero();
  // Multipliers. The power of drives is neglected: no equation depends on this sum.
  calc_motion(model, unreduced, t, z, data);
  const TreeData<double>& tree = data.docking.mechanism.tree;
  for (int k = 0; k < unreduced.cuts; ++k) {
    data.flow = -data.G.row(k).transpose();
    const int force = unreduced.lambda + k, shift = unreduced.mu + k;
    const bool shifts = unreduced.form == DaeForm::kStabilised;
    int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
    for (int i : model.mechanism_bodies) {
      const Body& body = model.mechanism.model.bodies[i];
      if (shifts) calc_coordinate_rates(body, tree.q, data.flow, &J(q, shift));
      q += body.nq();
      for (int j = 0; j < body.nv(); ++j) J(v++, force) = data.flow[body.v_index + j];
    }
    for (int i = 0; i < unreduced.cuts; ++i) {
      J(unreduced.v_dep + i, force) = data.flow[unreduced.dep_v[i]];
      if (shifts) J(unreduced.q_dep + i, shift) = data.flow[unreduced.dep_v[i]];
    }
  }
  std::copy(z, z + n, data.z.data());
  std::copy(zdot, zdot + n, data.zdot.data());
  const double part = std::sqrt(std::numeric_limits<double>::epsilon());
  for (int k = 0; k < unreduced.lambda; ++k) {
    if (is_sum(model, k)) {
      J(k, k) = alpha;
      continue;
    }
    double step = part * std::max(std::abs(z[k]), nominal[k]);
    Status status;
    for (int side = 0; side < 2; ++side, step = -step) {  // in the other direction, if one fails
      data.z[k] = z[k] + step;
      step = data.z[k] - z[k];
      data.zdot[k] = zdot[k] + alpha * step;
      status = calc_unreduced_residual(model, unreduced, discrete, memory, loads, t, data.z.data(),
                                       data.zdot.data(), data.residual.data(), data);
      if (status.ok()) break;
    }
    if (!status.ok()) return status;
    for (int i = 0; i < n; ++i) J(i, k) = (data.residual[i] - residual[i]) / step;
    data.z[k] = z[k];
    data.zdot[k] = zdot[k];
  }
  return {};
}

void complete_unreduced_state(const DockingModel& model, const UnreducedModel& unreduced,
                              DockingData<double>& reduced, double* z, double* zdot) {
  MechanismData<double>& mechanism = reduced.mechanism;
  calc_leg_bodies(model.mechanism, mechanism);
  calc_leg_maps(mechanism.loops);
  put_leg_accelerations(model.mechanism.plan, mechanism.vdot, mechanism.loops);
  calc_reactions(model.mechanism, reduced.base, model.mechanism.vehicle, mechanism);
  std::fill(z + unreduced.head, z + unreduced.size, 0.0);
  std::fill(zdot + unreduced.head, zdot + unreduced.size, 0.0);
  for (int i = 0; i < unreduced.cuts; ++i) {
    const int v = unreduced.dep_v[i];
    z[unreduced.q_dep + i] = mechanism.tree.q[unreduced.dep_q[i]];
    zdot[unreduced.q_dep + i] = z[unreduced.v_dep + i] = mechanism.tree.v[v];
    zdot[unreduced.v_dep + i] = mechanism.vdot[v];
  }
  if (model.mechanism.vehicle != kBase) {
    for (int i = 0; i < 6; ++i) {
      z[unreduced.v_chaser + i] = mechanism.tree.v[i];
      zdot[unreduced.v_chaser + i] = mechanism.vdot[i];
    }
  }
  double* lambda = z + unreduced.lambda;
  for (const BlockData<double>& block : mechanism.loops.block) {
    lambda = std::copy_n(block.lambda.data(), block.lambda.size(), lambda);
  }
}

double find_cut_gap(const DockingModel& model, const UnreducedModel& unreduced, double t,
                    const double* z, UnreducedData& data) {
  calc_motion(model, unreduced, t, z, data);
  return unreduced.cuts > 0 ? data.gap.cwiseAbs().maxCoeff() : 0.0;
}

}  // namespace dockloop
