// Seeds and harvest of the dual numbers, and the Jacobian by forces; see mechanism_jacobian.hpp.
#include "mechanism/mechanism_jacobian.hpp"

#include <algorithm>

namespace dockloop {

void copy_pose(const MechanismData<double>& at, MechanismData<Derivative>& dual) {
  copy_constants(at.tree.q, dual.tree.q);
  for (size_t i = 0; i < at.loops.block.size(); ++i) {
    dual.loops.block[i].branch = at.loops.block[i].branch;
    dual.loops.block[i].spin_branch = at.loops.block[i].spin_branch;
  }
}

AccelerationJacobian::AccelerationJacobian(const Mechanism& mechanism) {
  const int n = static_cast<int>(mechanism.plan.ind_v.size());
  dq.setZero(n, static_cast<int>(mechanism.plan.ind_q.size()));
  dv.setZero(n, n);
  dtau.setZero(n, mechanism.model.nv);
}

JacobianData::JacobianData(const Mechanism& mechanism) : dual(mechanism), tree(mechanism.model) {
  column.setZero(static_cast<int>(mechanism.plan.ind_v.size()));
}

int start_jacobian_columns(const Mechanism& mechanism, const BaseMotion<double>& base,
                           const MechanismData<double>& at, int first, JacobianData& work) {
  const std::vector<int>& ind_q = mechanism.plan.ind_q;
  const std::vector<int>& ind_v = mechanism.plan.ind_v;
  TreeData<Derivative>& tree = work.dual.tree;
  copy_constants(base.w, work.base.w);
  copy_constants(base.alpha, work.base.alpha);
  copy_constants(base.a, work.base.a);
  copy_constants(base.gravity, work.base.gravity);
  copy_pose(at, work.dual);
  copy_constants(at.tree.v, tree.v);
  tree.time = Derivative(at.tree.time);
  copy_constants(at.tau, work.dual.tau);
  for (size_t i = 0; i < tree.external.size(); ++i) {
    copy_constants(at.tree.external[i].f, tree.external[i].f);
    copy_constants(at.tree.external[i].t, tree.external[i].t);
  }
  const int nq = static_cast<int>(ind_q.size()), n = nq + static_cast<int>(ind_v.size());
  const int count = std::min(kLanes, n - first);
  for (int lane = 0; lane < count; ++lane) {
    const int i = first + lane;
    (i < nq ? tree.q[ind_q[i]] : tree.v[ind_v[i - nq]]).d[lane] = 1.0;
  }
  return count;
}

void read_jacobian_columns(const Mechanism& mechanism, int first, int count,
                           const JacobianData& work, AccelerationJacobian& jacobian) {
  const std::vector<int>& ind_v = mechanism.plan.ind_v;
  const int nq = static_cast<int>(jacobian.dq.cols());
  for (int lane = 0; lane < count; ++lane) {
    const int j = first + lane;
    for (int i = 0; i < static_cast<int>(ind_v.size()); ++i) {
      const double slope = work.dual.vdot[ind_v[i]].d[lane];
      (j < nq ? jacobian.dq(i, j) : jacobian.dv(i, j - nq)) = slope;
    }
  }
}

void calc_force_jacobian(const Mechanism& mechanism, const MechanismData<double>& at,
                         JacobianData& work, MatX<double>& dtau) {
  const std::vector<int>& ind_v = mechanism.plan.ind_v;
  // Rows of N^T, one independent velocity at a time, then A_ind^-1 from the left.
  work.tree.v.setZero();
  for (size_t i = 0; i < ind_v.size(); ++i) {
    work.tree.v[ind_v[i]] = 1.0;
    calc_loop_velocity(mechanism.plan, work.tree, at.loops);
    dtau.row(static_cast<int>(i)) = work.tree.v.transpose();
    work.tree.v[ind_v[i]] = 0.0;
    if (!mechanism.plan.is_driven) continue;
    calc_loop_velocity(mechanism.plan, work.tree, at.loops);  // what moves by itself
    dtau.row(static_cast<int>(i)) -= work.tree.v.transpose();
  }
  add_leg_columns(mechanism.plan, at.loops, dtau);
  for (int j = 0; j < dtau.cols(); ++j) {
    work.column = dtau.col(j);
    at.factor.solveInPlace(work.column);
    dtau.col(j) = work.column;
  }
}

Status calc_acceleration_jacobian(const Mechanism& mechanism, const BaseMotion<double>& base,
                                  const MechanismData<double>& at, JacobianData& work,
                                  AccelerationJacobian& jacobian) {
  const auto held = [](MechanismData<Derivative>&) {};
  return calc_acceleration_jacobian(mechanism, base, at, held, work, jacobian);
}

}  // namespace dockloop
