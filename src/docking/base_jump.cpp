// Impulse and displacement of the base under a mechanism; see base_jump.hpp.
#include "docking/base_jump.hpp"

#include "math/decompositions.hpp"

namespace dockloop {
namespace {

/// Independent mechanism velocities come after the six of a vehicle that moves.
int count_vehicle_velocities(const Mechanism& mechanism) {
  return mechanism.vehicle == kBase ? 0 : 6;
}

/// Linear and angular velocity of G, axes of O.
Vec6<double> find_capture_velocity(const DockingModel& model, const DockingData<double>& data) {
  const FrameMotion<double> G = find_capture_motion(model, data.mechanism.tree);
  Vec6<double> velocity;
  velocity << G.v, G.w;
  return velocity;
}

/// Move the coordinates of the mechanism in y along independent velocities.
void move_coordinates(const DockingModel& model, const VecX<double>& dq, double* y) {
  int q = model.layout.mechanism_q, v = 0;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    if (body.joint == JointType::kFree) {
      Eigen::Map<Vec3<double>> p(y + q);
      Eigen::Map<Vec4<double>> quat(y + q + 3);
      p += quat_to_matrix<double>(quat) * dq.segment<3>(v);
      quat = quat_multiply<double>(quat, quat_exp<double>(Vec3<double>(dq.segment<3>(v + 3))))
                 .normalized();
    } else {
      y[q] += dq[v];
    }
    q += body.nq();
    v += body.nv();
  }
}

}  // namespace

BaseJumpWorkspace::BaseJumpWorkspace(const DockingModel& model) {
  const Mechanism& mechanism = model.mechanism;
  const int n = static_cast<int>(mechanism.plan.ind_v.size()) - count_vehicle_velocities(mechanism);
  A_qq.setIdentity(n, n);
  J_T.setZero(n, 6);
  X.setZero(n, 6);
  factor.compute(A_qq);
  dq.setZero(n);
  dv[kChaser].setZero(static_cast<int>(mechanism.plan.ind_v.size()));
  if (model.target) dv[kTarget].setZero(static_cast<int>(model.target->plan.ind_v.size()));
}

Status jump_to_momentum(const DockingModel& model, int vehicle, const FrameMotion<double>& before,
                        const Wrench<double>& momentum, double* y, DockingData<double>& data,
                        BaseJumpWorkspace& work) {
  const bool is_target = vehicle == kTarget;
  if (is_target ? !model.target : data.locked != nullptr) {  // carried bodies move with the vehicle
    set_momentum(model, vehicle, momentum, y);
    return {};
  }
  const Mechanism& mechanism = is_target ? *model.target : model.mechanism;
  MechanismData<double>& at = is_target ? data.target->mechanism : data.mechanism;
  VecX<double>& dv = work.dv[static_cast<size_t>(vehicle)];
  const Status status =
      is_target ? calc_parts_position(model, y, data) : calc_mechanism_position(model, y, data);
  if (!status.ok()) return status;
  TreeData<double>& tree = at.tree;
  const int body = mechanism.vehicle;
  const Mat3<double> R = tree.R[body];
  tree.v.head<3>() = R.transpose() * before.v;
  tree.v.segment<3>(3) = R.transpose() * before.w;
  calc_velocity(mechanism, data.base, at);
  const Wrench<double> now = find_momentum(model, vehicle, data);
  const Vec3<double> impulse = momentum.f - now.f;
  dv.setZero();
  dv.head<3>() = R.transpose() * impulse;
  dv.segment<3>(3) = R.transpose() * (momentum.t - now.t - tree.p[body].cross(impulse));
  at.factor.solveInPlace(dv);
  const std::vector<int>& ind = mechanism.plan.ind_v;
  for (size_t j = 0; j < ind.size(); ++j) tree.v[ind[j]] += dv[static_cast<int>(j)];
  if (is_target) {
    for (int j = 0; j < model.layout.target_n; ++j) y[model.layout.target_v + j] = tree.v[6 + j];
  } else {
    get_mechanism_state(model, tree, y);
  }
  set_momentum(model, vehicle, momentum, y);
  return {};
}

Status hold_capture_body(const DockingModel& model, const Pose<double>& capture, double* y,
                         DockingData<double>& data, BaseJumpWorkspace& work) {
  const int n = static_cast<int>(work.dq.size());
  const int body = model.mechanism.model.capture_body;
  if (n == 0 || body == kBase || body == model.mechanism.vehicle || data.locked) return {};
  const Status status = calc_mechanism_position(model, y, data);
  if (!status.ok()) return status;
  MechanismData<double>& mechanism = data.mechanism;
  TreeData<double>& tree = mechanism.tree;
  const FrameMotion<double> now = find_capture_motion(model, tree);
  Vec6<double> displacement;
  displacement.head<3>() = capture.p - now.p;
  displacement.tail<3>() =
      quat_log<double>(quat_from_matrix<double>(Mat3<double>(capture.R * now.R.transpose())));
  // A larger displacement is not a correction: the mechanism then moves with the vehicle.
  constexpr double kLongestDisplacement = 0.02, kRounding = 1e-13;  // [m], [rad]
  if (displacement.head<3>().norm() > kLongestDisplacement || displacement.norm() < kRounding)
    return {};
  const std::vector<int>& ind = model.mechanism.plan.ind_v;
  const int first = count_vehicle_velocities(model.mechanism);
  for (int j : ind) tree.v[j] = 0.0;  // the Jacobian does not depend on velocities
  calc_velocity(model.mechanism, data.base, mechanism);
  const Vec6<double> drift = find_capture_velocity(model, data);  // of driven joints
  for (int j = 0; j < n; ++j) {
    tree.v[ind[first + j]] = 1.0;
    calc_velocity(model.mechanism, data.base, mechanism);
    work.J_T.row(j) = (find_capture_velocity(model, data) - drift).transpose();
    tree.v[ind[first + j]] = 0.0;
  }
  // Least kinetic energy: dq = inv(A) J^T inv(J inv(A) J^T) distance, in directions that J allows.
  work.A_qq = mechanism.A_ind.bottomRightCorner(n, n);
  work.factor.compute(work.A_qq);
  if (work.factor.info() != Eigen::Success) return {StatusCode::kInertiaNotPositive, -1, 0.0, 0.0};
  work.X = work.J_T;
  work.factor.solveInPlace(work.X);
  const Mat6<double> mobility = work.J_T.transpose().lazyProduct(work.X);
  const PrincipalAxes principal = find_principal_axes(mobility);
  constexpr double kReachable = 1e-9;  // of the largest mobility
  Vec6<double> share = principal.axis.transpose() * displacement;
  for (int k = 0; k < 6; ++k) {
    const double mobile = principal.value[k];
    share[k] = mobile > kReachable * principal.value[5] ? share[k] / mobile : 0.0;
  }
  work.dq.noalias() = work.X.lazyProduct(Vec6<double>(principal.axis * share));
  move_coordinates(model, work.dq, y);
  return {};
}

}  // namespace dockloop
