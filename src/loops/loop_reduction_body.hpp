// What loops do to velocities, accelerations and the equations of motion.
#pragma once

#include <algorithm>

#include "loops/loop_equations.hpp"
#include "math/scalar.hpp"

namespace dockloop {

template <class S>
LoopData<S>::LoopData(const MechanismModel& model, const LoopPlan& plan) {
  cut.resize(model.loops.size());
  for (size_t k = 0; k < cut.size(); ++k) {
    cut[k].terminal.resize(plan.paths[k].terminal.size());
    cut[k].closing.resize(plan.paths[k].closing.size());
    cut[k].residual.setZero();
    cut[k].plane.setZero();
    cut[k].axis_T = {Vec3<S>(Vec3<S>::Zero()), Vec3<S>(Vec3<S>::Zero())};
    cut[k].axis_I.setZero();
  }
  for (const LoopBlock& b : plan.blocks) {
    const int m = b.size(), low = static_cast<int>(b.low.size());
    const int touched = static_cast<int>(b.touched.size());
    BlockData<S> data;
    data.G.setZero(m, m + low);
    data.lu.resize(m);
    data.inverse.setZero(m, m);
    data.H.setZero(m, low);
    data.W.setZero(m, low);
    data.U.setZero(touched, low);
    data.A_dt.setZero(m, touched);
    data.A_dd.setZero(m, m);
    for (auto* x :
         {&data.residual, &data.g, &data.h, &data.b_d, &data.lambda, &data.step, &data.column}) {
      x->setZero(m);
    }
    if (b.form()) {
      data.branch = b.form()->branch;
      if (b.form()->spin) data.spin_branch = b.form()->spin->branch;
    }
    if (b.is_gear) {  // a constant
      const Loop& loop = model.loops[b.loops[0]];
      for (int body : plan.paths[b.loops[0]].tied) {
        const int column = b.column_of[model.bodies[body].v_index] - m;
        if (column < 0) continue;
        data.H(0, column) =
            S(-find_coupling_factor(loop, body) / find_coupling_factor(loop, b.dep_bodies[0]));
      }
    }
    block.push_back(data);
    reference.H.push_back(data.H);
  }
  for (const LegPlatform& each : plan.platforms) platform.emplace_back(model, plan, each);
  reference.q.setZero(model.nq);
  reference.sign.assign(plan.blocks.size(), 0);
  reference.margin.assign(plan.blocks.size(), 1.0);
  reference.branch.resize(plan.blocks.size());
  reference.spin_branch.assign(plan.blocks.size(), 1);
  reference.reach.assign(plan.platforms.size(), 0.0);
  moved.setZero(model.nv);
  target.setZero(model.nq);
}

template <class S>
void calc_velocity_maps(const MechanismModel& model, const LoopPlan& plan, LoopData<S>& loops) {
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    calc_block_map(block, data);
    if (!block.is_driven) continue;
    data.g.setZero();
    for (size_t i = 0; i < block.loops.size(); ++i) {
      const Loop& loop = model.loops[block.loops[i]];
      if (loop.rate != 0.0) data.g[block.row[i][0]] = S(loop.rate);
    }
    solve_block<S>(block, data, data.g);
  }
}

template <class S>
S find_drive_power(const MechanismModel& model, const LoopPlan& plan, const LoopData<S>& loops) {
  S power(0);
  for (size_t k = 0; k < model.loops.size(); ++k) {
    if (model.loops[k].rate == 0.0) continue;
    power += S(model.loops[k].rate) * get_cut_force(plan, loops, static_cast<int>(k), 0);
  }
  return power;
}

template <class S>
void calc_loop_velocity(const LoopPlan& plan, TreeData<S>& tree, const LoopData<S>& loops) {
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    const LoopBlock& block = plan.blocks[b];
    const BlockData<S>& data = loops.block[b];
    for (int i = 0; i < block.size(); ++i) {
      S sum = data.g[i];
      for (int j = 0; j < data.H.cols(); ++j) sum += data.H(i, j) * tree.v[block.low[j]];
      tree.v[block.dep[i]] = sum;
    }
  }
}

template <class S>
void calc_loop_bias(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                    LoopData<S>& loops) {
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    const BlockData<S>* leg = has_leg_bias(block.form()) ? &data : nullptr;
    for (size_t i = 0; i < block.loops.size(); ++i) {
      const int k = block.loops[i];
      calc_cut_bias(model, plan, k, block.row[i], tree, loops.cut[k], leg, data.h);
    }
    data.h = -data.h;
    solve_block<S>(block, data, data.h);
  }
}

template <class S>
void reduce_inertia(const LoopPlan& plan, MatX<S>& A, LoopData<S>& loops) {
  for (size_t b = plan.reduced_blocks; b-- > 0;) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    const int m = block.size();
    const int n_low = static_cast<int>(block.low.size());
    const int n_touched = static_cast<int>(block.touched.size());
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < n_touched; ++j) data.A_dt(i, j) = A(block.dep[i], block.touched[j]);
      for (int j = 0; j < m; ++j) data.A_dd(i, j) = A(block.dep[i], block.dep[j]);
    }
    // A_ll += A_ld H + (A_ld H)^T + H^T A_dd H
    data.U.noalias() = data.A_dt.transpose().lazyProduct(data.H);
    data.W.noalias() = data.A_dd.lazyProduct(data.H);
    for (int j = 0; j < n_low; ++j) {
      const int column = block.low[j];
      for (int i = 0; i < n_touched; ++i) {
        A(block.touched[i], column) += data.U(i, j);
        A(column, block.touched[i]) += data.U(i, j);
      }
      for (int i = 0; i <= j; ++i) {
        S sum(0);
        for (int d = 0; d < m; ++d) sum += data.H(d, i) * data.W(d, j);
        A(block.low[i], column) += sum;
        if (i != j) A(column, block.low[i]) += sum;
      }
    }
  }
}

template <class S>
void reduce_forces(const LoopPlan& plan, VecX<S>& b, LoopData<S>& loops) {
  for (size_t k = plan.reduced_blocks; k-- > 0;) {
    const LoopBlock& block = plan.blocks[k];
    BlockData<S>& data = loops.block[k];
    const int m = block.size();
    for (int i = 0; i < m; ++i) data.b_d[i] = b[block.dep[i]];
    // b_l += -A_ld h + H^T (b_d - A_dd h)
    for (int j = 0; j < data.A_dt.cols(); ++j) {
      S sum(0);
      for (int i = 0; i < m; ++i) sum += data.A_dt(i, j) * data.h[i];
      b[block.touched[j]] -= sum;
    }
    data.step = data.b_d;
    data.step.noalias() -= data.A_dd.lazyProduct(data.h);
    for (int j = 0; j < data.H.cols(); ++j) {
      S sum(0);
      for (int i = 0; i < m; ++i) sum += data.H(i, j) * data.step[i];
      b[block.low[j]] += sum;
    }
  }
}

template <class S>
void calc_loop_acceleration(const LoopPlan& plan, VecX<S>& vdot, const LoopData<S>& loops) {
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    const LoopBlock& block = plan.blocks[b];
    const BlockData<S>& data = loops.block[b];
    for (int i = 0; i < block.size(); ++i) {
      S sum = data.h[i];
      for (int j = 0; j < data.H.cols(); ++j) sum += data.H(i, j) * vdot[block.low[j]];
      vdot[block.dep[i]] = sum;
    }
  }
}

template <class S>
void calc_loop_forces(const LoopPlan& plan, const VecX<S>& vdot, LoopData<S>& loops) {
  for (size_t b = 0; b < plan.reduced_blocks; ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    // Force the cuts must exert on the dependent joints: Q = A_dl vdot_l + A_dd vdot_d - b_d, with
    // A and b as they were when this block was eliminated.
    for (int i = 0; i < block.size(); ++i) {
      S sum = -data.b_d[i];
      for (int j = 0; j < data.A_dt.cols(); ++j) sum += data.A_dt(i, j) * vdot[block.touched[j]];
      for (int j = 0; j < block.size(); ++j) sum += data.A_dd(i, j) * vdot[block.dep[j]];
      data.lambda[i] = sum;
    }
    if (block.form() && block.form()->has_inverse()) {
      data.column = data.lambda;
      data.lambda.noalias() = data.inverse.transpose().lazyProduct(data.column);
    } else {
      data.lu.solve_transposed(data.lambda);
    }
  }
}

template <class S>
S get_cut_force(const LoopPlan& plan, const LoopData<S>& loops, int loop, int equation) {
  const int b = plan.block_of_loop[loop];
  if (b < 0) return S(0);
  const LoopBlock& block = plan.blocks[b];
  const size_t i = static_cast<size_t>(std::find(block.loops.begin(), block.loops.end(), loop) -
                                       block.loops.begin());
  const int row = block.row[i][equation];
  return row < 0 ? S(0) : loops.block[b].lambda[row];
}

#define DOCK_INSTANTIATE(S)                                                                   \
  template struct LoopData<S>;                                                                \
  template void calc_velocity_maps<S>(const MechanismModel&, const LoopPlan&, LoopData<S>&);  \
  template S find_drive_power<S>(const MechanismModel&, const LoopPlan&, const LoopData<S>&); \
  template void calc_loop_velocity<S>(const LoopPlan&, TreeData<S>&, const LoopData<S>&);     \
  template void calc_loop_bias<S>(const MechanismModel&, const LoopPlan&, const TreeData<S>&, \
                                  LoopData<S>&);                                              \
  template void reduce_inertia<S>(const LoopPlan&, MatX<S>&, LoopData<S>&);                   \
  template void reduce_forces<S>(const LoopPlan&, VecX<S>&, LoopData<S>&);                    \
  template void calc_loop_acceleration<S>(const LoopPlan&, VecX<S>&, const LoopData<S>&);     \
  template void calc_loop_forces<S>(const LoopPlan&, const VecX<S>&, LoopData<S>&);           \
  template S get_cut_force<S>(const LoopPlan&, const LoopData<S>&, int, int);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
