// Exact derivatives of the independent accelerations: for implicit integrators, linearisation,
// sensitivities.
//
//   a = f(q, v, tau)      da = dq δq + dv δv + dtau δtau
//
// dq and dv come from the very algorithm of the accelerations, run with dual numbers
// (math/dual.hpp) for eight columns at a time; dtau from the factor of the reduced inertia: a grows
// with A_ind^-1 N^T tau, where v = N v_ind.
//
// Dependent coordinates move with the independent ones. Where a closed form serves, the derivative
// runs through it. A Newton closure starts at the solution and makes a step in dual numbers: by
// the implicit function theorem this step carries the exact derivative, -C_dep^-1 C δq, because the
// residual that multiplies the derivative of the matrix is zero.
#pragma once

#include "math/scalar.hpp"
#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// Plain numbers into dual ones, whose derivatives are then zero.
template <class To, class From>
void copy_constants(const From& from, To& to) {
  to = from.template cast<Derivative>();
}

/// A solved pose into dual numbers: all coordinates, and the branches that they are on. Loops are
/// closed from there, without a reference pose.
void copy_pose(const MechanismData<double>& at, MechanismData<Derivative>& dual);

/// Rows: independent velocities, in the order of LoopPlan::ind_v.
struct AccelerationJacobian {
  explicit AccelerationJacobian(const Mechanism& mechanism);
  MatX<double> dq;    ///< n_ind x ind_q: by raw coordinates (free joint: position, quaternion)
  MatX<double> dv;    ///< n_ind x n_ind: by independent velocities
  MatX<double> dtau;  ///< n_ind x nv: by the joint forces of all tree velocities
};

/// Workspace; sized by the constructor, nothing below allocates.
struct JacobianData {
  explicit JacobianData(const Mechanism& mechanism);
  MechanismData<Derivative> dual;
  BaseMotion<Derivative> base;
  TreeData<double> tree;  ///< velocities per unit independent velocity
  VecX<double> column;    ///< n_ind: scratch of the solution
};

/// Put the state of `at` into work.dual and seed columns first, first + 1, ... of (q, v). Joint
/// forces and external loads are those of `at`, held. @return number of columns seeded
int start_jacobian_columns(const Mechanism& mechanism, const BaseMotion<double>& base,
                           const MechanismData<double>& at, int first, JacobianData& work);

/// Take the derivatives of these columns from work.dual.
void read_jacobian_columns(const Mechanism& mechanism, int first, int count,
                           const JacobianData& work, AccelerationJacobian& jacobian);

/// Jacobian by joint forces. @pre calc_position of `at`
void calc_force_jacobian(const Mechanism& mechanism, const MechanismData<double>& at,
                         JacobianData& work, MatX<double>& dtau);

/// Jacobians at a state with forces that depend on it.
/// @param[in] at         an evaluated state (calc_position to calc_acceleration)
/// @param[in] put_loads  void(MechanismData<Derivative>&): sets tau and tree.external from tree.q
/// and
///                       tree.v, as the caller does for double; what it leaves alone is held
template <class PutLoads>
Status calc_acceleration_jacobian(const Mechanism& mechanism, const BaseMotion<double>& base,
                                  const MechanismData<double>& at, PutLoads put_loads,
                                  JacobianData& work, AccelerationJacobian& jacobian) {
  const int columns = static_cast<int>(jacobian.dq.cols() + jacobian.dv.cols());
  for (int first = 0, count = 0; first < columns; first += count) {
    count = start_jacobian_columns(mechanism, base, at, first, work);
    const Status status = calc_position(mechanism, work.dual);
    if (!status.ok()) return status;
    calc_velocity(mechanism, work.base, work.dual);
    put_loads(work.dual);
    calc_acceleration(mechanism, work.base, work.dual);
    read_jacobian_columns(mechanism, first, count, work, jacobian);
  }
  calc_force_jacobian(mechanism, at, work, jacobian.dtau);
  return {};
}

/// The same with joint forces and external loads held.
Status calc_acceleration_jacobian(const Mechanism& mechanism, const BaseMotion<double>& base,
                                  const MechanismData<double>& at, JacobianData& work,
                                  AccelerationJacobian& jacobian);

}  // namespace dockloop
