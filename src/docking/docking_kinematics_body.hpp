// Poses and velocities of a docking: vehicles, mechanism, frames A, G and P.
#pragma once

#include <algorithm>

#include "docking/docking_model.hpp"
#include "math/decompositions.hpp"
#include "math/scalar.hpp"

namespace dockloop {

template <class S>
FrameMotion<S> find_frame_on(const FrameMotion<S>& body, const Pose<double>& pose) {
  FrameMotion<S> frame;
  const Vec3<S> arm = body.R * cast<S>(pose.p);
  frame.R = body.R * cast<S>(pose.R);
  frame.p = body.p + arm;
  frame.w = body.w;
  frame.v = body.v + body.w.cross(arm);
  return frame;
}

template <class S>
RelativeMotion<S> find_relative(const FrameMotion<S>& from, const FrameMotion<S>& to) {
  RelativeMotion<S> relative;
  const Mat3<S> R_to_from = from.R.transpose();
  const Vec3<S> arm = to.p - from.p;
  relative.R = R_to_from * to.R;
  relative.p = R_to_from * arm;
  relative.w = R_to_from * (to.w - from.w);
  relative.v = R_to_from * (to.v - from.v - from.w.cross(arm));
  return relative;
}

template <class S>
RecordedMotion<S> find_recorded_motion(const InputHistory& record, int row, const S& time) {
  const size_t i = std::min(static_cast<size_t>(std::max(row, 0)), record.time.size() - 2);
  const double h = record.time[i + 1] - record.time[i];
  const Vec7<double> mean = (record.pose[i + 1] - record.pose[i]) / h;
  const Vec7<double>&v_0 = record.pose_rate[i], &v_1 = record.pose_rate[i + 1];
  const Vec7<S> first = cast<S>(record.pose[i]), rate = cast<S>(v_0);
  const Vec7<S> square = cast<S>(Vec7<double>((3.0 * mean - 2.0 * v_0 - v_1) / h));
  const Vec7<S> cube = cast<S>(Vec7<double>((v_0 + v_1 - 2.0 * mean) / (h * h)));
  const S s = time - S(record.time[i]);
  const Vec7<S> x = first + s * (rate + s * (square + s * cube));
  const Vec7<S> x_1 = rate + s * (S(2) * square + S(3) * s * cube);
  const Vec7<S> x_2 = S(2) * square + S(6) * s * cube;
  // The cubic of the quaternion is not of unit length; w = 2 conj(q) q_1 / |q|^2 for any length.
  const Vec4<S> q = x.template tail<4>(), q_1 = x_1.template tail<4>(),
                q_2 = x_2.template tail<4>();
  const S factor = S(2) / q.squaredNorm();
  const auto turn = [&](const Vec4<S>& of) -> Vec3<S> {
    return factor * quat_multiply<S>(quat_conjugate<S>(q), of).template tail<3>();
  };
  const Vec3<S> w = turn(q_1);
  RecordedMotion<S> motion;
  motion.attitude = q.normalized();
  motion.frame.R = quat_to_matrix<S>(motion.attitude);
  motion.frame.p = x.template head<3>();
  motion.frame.v = x_1.template head<3>();
  motion.frame.w = motion.frame.R * w;
  motion.a = x_2.template head<3>();
  motion.alpha = motion.frame.R * (turn(q_2) - factor * q.dot(q_1) * w);
  return motion;
}

template <class S>
FrameMotion<S> get_vehicle_pose(const DockingModel& model, int i, const S* y) {
  FrameMotion<S> frame;
  if (model.layout.pose[i] < 0) {
    frame.R = cast<S>(model.fixed_pose[i].R);
    frame.p = cast<S>(model.fixed_pose[i].p);
    return frame;
  }
  const S* x = y + model.layout.pose[i];
  frame.p = Vec3<S>(x[0], x[1], x[2]);
  frame.R = quat_to_matrix<S>(Vec4<S>(x[3], x[4], x[5], x[6]));
  return frame;
}

namespace {

/// Motion of a body of the tree, or of what its base stands for.
template <class S>
FrameMotion<S> get_body_motion(const TreeData<S>& tree, int body) {
  FrameMotion<S> frame;
  if (body == kBase) return frame;
  frame.R = tree.R[body];
  frame.p = tree.p[body];
  frame.w = tree.w[body];
  frame.v = tree.u[body];
  return frame;
}

}  // namespace

template <class S>
FrameMotion<S> find_capture_motion(const DockingModel& model, const TreeData<S>& tree) {
  return find_frame_on(get_body_motion(tree, model.mechanism.model.capture_body),
                       model.capture_in_body);
}

template <class S>
void put_mechanism_state(const DockingModel& model, const S* y, TreeData<S>& tree) {
  int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) tree.q[body.q_index + j] = y[q++];
    for (int j = 0; j < body.nv(); ++j) tree.v[body.v_index + j] = y[v++];
  }
  if (model.layout.pose[kChaser] >= 0) {
    for (int j = 0; j < 7; ++j) tree.q[j] = y[model.layout.pose[kChaser] + j];
  }
}

namespace {

/// Pose and velocity of the vehicle of a tree as its record has them.
template <class S>
void put_recorded_motion(const RecordedMotion<S>& motion, TreeData<S>& tree) {
  const FrameMotion<S>& frame = motion.frame;
  tree.q.template head<3>() = frame.p;
  tree.q.template segment<4>(3) = motion.attitude;
  tree.v.template head<3>() = frame.R.transpose() * frame.v;
  tree.v.template segment<3>(3) = frame.R.transpose() * frame.w;
}

/// Let the equations of a tree find the load that gives its vehicle the recorded acceleration.
template <class S>
void prescribe_acceleration(const RecordedMotion<S>& motion, MechanismData<S>& data) {
  const FrameMotion<S>& frame = motion.frame;
  Vec6<S>& vdot = data.prescribed.emplace();
  vdot.template head<3>() = frame.R.transpose() * (motion.a - frame.w.cross(frame.v));
  vdot.template tail<3>() = frame.R.transpose() * motion.alpha;
}

/// Velocity of a vehicle from the momentum x of everything that moves with it:
/// A_cc v_c + A_cm v_m = p, with p the momentum in body axes about the vehicle's origin.
template <class S>
void calc_vehicle_velocity(const Mechanism& mechanism, const FrameMotion<S>& vehicle, const S* x,
                           MechanismData<S>& data) {
  const Vec3<S> linear(x[0], x[1], x[2]), angular(x[3], x[4], x[5]);
  Vec6<S> p;
  p.template head<3>() = vehicle.R.transpose() * linear;
  p.template tail<3>() = vehicle.R.transpose() * (angular - vehicle.p.cross(linear));
  const std::vector<int>& ind = mechanism.plan.ind_v;
  for (int j = 6; j < static_cast<int>(ind.size()); ++j) {
    p -= data.A_ind.col(j).template head<6>() * data.tree.v[ind[j]];
  }
  if (mechanism.plan.is_driven) {
    // Momentum of the joints that move by themselves, everything else at rest.
    TreeData<S>& tree = data.tree;
    data.scratch_v = tree.v;
    for (int j : ind) tree.v[j] = S(0);
    calc_loop_velocity(mechanism.plan, tree, data.loops);
    p -= data.A_tree.template topRows<6>().lazyProduct(tree.v);
    tree.v = data.scratch_v;
  }
  solve_leading<6>(data.factor, p);
  data.tree.v.template head<6>() = p;
}

template <class S>
void calc_target_velocity(const DockingModel& model, const S* y, FrameMotion<S>& target) {
  const S* x = y + model.layout.momentum[kTarget];
  const Vec3<S> linear(x[0], x[1], x[2]), angular(x[3], x[4], x[5]);
  target.v = linear / S(model.vehicle[kTarget].mass);
  const Vec3<S> spin = target.R.transpose() * (angular - target.p.cross(linear));
  target.w = target.R * (cast<S>(invert(model.vehicle[kTarget].inertia)) * spin);
}

/// Motion of the chaser with a locked mechanism, and what else evaluations read of the tree.
template <class S>
void calc_locked_kinematics(const DockingModel& model, const S* y, DockingData<S>& data) {
  FrameMotion<S>& chaser = data.vehicle[kChaser];
  const bool is_recorded = model.record[kChaser] >= 0;
  chaser = is_recorded ? data.recorded[kChaser].frame : get_vehicle_pose(model, kChaser, y);
  TreeData<S>& tree = data.mechanism.tree;
  const LockedMechanism& locked = *data.locked;
  tree.q = locked.q.template cast<S>();
  tree.v.setZero();
  data.mechanism.vdot.setZero();
  data.mechanism.linear_momentum.setZero();
  if (model.layout.momentum[kChaser] >= 0) {
    const VehicleBody& body = locked.has_target ? locked.joined : locked.whole;
    const S* x = y + model.layout.momentum[kChaser];
    Vec3<S> linear(x[0], x[1], x[2]), angular(x[3], x[4], x[5]);
    if (locked.has_target) {
      const S* x_t = y + model.layout.momentum[kTarget];
      linear += Vec3<S>(x_t[0], x_t[1], x_t[2]);
      angular += Vec3<S>(x_t[3], x_t[4], x_t[5]);
    }
    const Vec3<S> c = chaser.R * cast<S>(body.com);
    const Vec3<S> spin = chaser.R.transpose() * (angular - (chaser.p + c).cross(linear));
    chaser.w = chaser.R * (cast<S>(invert(body.inertia)) * spin);
    chaser.v = linear / S(body.mass) - chaser.w.cross(c);
  }
  if (model.mechanism.vehicle != kBase) {
    tree.p[0] = chaser.p;
    tree.m_sum[0] = S(locked.whole.mass);
    tree.h_sum[0] = S(locked.whole.mass) * (chaser.R * cast<S>(locked.whole.com));
  }
  data.carrier[kChaser] = find_frame_on(chaser, locked.carrier);
  data.capture = find_frame_on(chaser, locked.capture);
  for (size_t i = 0; i < data.contact_bodies.size(); ++i) {
    data.contact_bodies[i] = find_frame_on(chaser, locked.contact_bodies[i]);
  }
  calc_frames(model, y, data);
}

/// Everything that follows from position and velocity alone, with a mechanism that moves.
template <class S>
Status calc_kinematics(const DockingModel& model, const S& t, const S* y, Need need,
                       DockingData<S>& data) {
  put_mechanism_state(model, y, data.mechanism.tree);
  data.mechanism.tree.time = t;
  const bool is_recorded = model.record[kChaser] >= 0;
  if (is_recorded) {
    put_recorded_motion(data.recorded[kChaser], data.mechanism.tree);
    need = std::max(need, Need::kState);  // generated code knows free vehicles only
  }
  const Status status = calc_position(model.mechanism, data.mechanism, need);
  if (!status.ok()) return status;
  if (is_recorded) {
    prescribe_acceleration(data.recorded[kChaser], data.mechanism);
  } else if (model.mechanism.vehicle != kBase) {
    calc_vehicle_velocity(model.mechanism, get_vehicle_pose(model, kChaser, y),
                          y + model.layout.momentum[kChaser], data.mechanism);
  }
  calc_velocity(model.mechanism, data.base, data.mechanism);
  calc_frames(model, y, data);
  return {};
}

/// Position and inertia of a target with parts; velocities of its parts as they are in the state.
template <class S>
Status calc_target_position(const DockingModel& model, const S* y, TargetData<S>& target) {
  TreeData<S>& tree = target.mechanism.tree;
  const StateLayout& layout = model.layout;
  for (int j = 0; j < 7 && layout.pose[kTarget] >= 0; ++j) tree.q[j] = y[layout.pose[kTarget] + j];
  for (int j = 0; j < layout.target_n; ++j) {
    tree.q[7 + j] = y[layout.target_q + j];
    tree.v[6 + j] = y[layout.target_v + j];
  }
  return calc_position(*model.target, target.mechanism, Need::kState);
}

/// Motion of a target with parts.
template <class S>
Status calc_target_kinematics(const DockingModel& model, const S* y, DockingData<S>& data) {
  if (!model.target) return {};
  const bool is_recorded = model.record[kTarget] >= 0;
  if (is_recorded) put_recorded_motion(data.recorded[kTarget], data.target->mechanism.tree);
  const Status status = calc_target_position(model, y, *data.target);
  if (!status.ok()) return status;
  if (is_recorded) {
    prescribe_acceleration(data.recorded[kTarget], data.target->mechanism);
    calc_velocity(*model.target, data.base, data.target->mechanism);
    return {};
  }
  calc_vehicle_velocity(*model.target, get_vehicle_pose(model, kTarget, y),
                        y + model.layout.momentum[kTarget], data.target->mechanism);
  calc_velocity(*model.target, data.base, data.target->mechanism);
  return {};
}

/// Relative motion of frames that are fixed on one body.
template <class S>
RelativeMotion<S> find_rest(const Pose<double>& pose) {
  RelativeMotion<S> motion;
  motion.R = cast<S>(pose.R);
  motion.p = cast<S>(pose.p);
  return motion;
}

}  // namespace

template <class S>
void calc_frames(const DockingModel& model, const S* y, DockingData<S>& data) {
  if (!data.locked) {
    data.vehicle[kChaser] = model.mechanism.vehicle != kBase
                                ? get_body_motion(data.mechanism.tree, model.mechanism.vehicle)
                                : get_vehicle_pose(model, kChaser, y);
    data.carrier[kChaser] =
        model.mechanism.vehicle != kBase
            ? get_body_motion(data.mechanism.tree, model.mechanism.model.carrier)
            : data.vehicle[kChaser];
    data.capture = find_capture_motion(model, data.mechanism.tree);
    for (size_t i = 0; i < data.contact_bodies.size(); ++i) {
      data.contact_bodies[i] =
          get_body_motion(data.mechanism.tree, model.mechanism.model.contact_bodies[i]);
    }
  }
  data.interface[kChaser] =
      find_frame_on(data.carrier[kChaser], model.interface_on_carrier[kChaser]);
  if (model.present[kTarget]) {
    const bool is_joined = data.locked && data.locked->has_target;
    if (is_joined) {
      data.vehicle[kTarget] = find_frame_on(data.vehicle[kChaser], data.locked->target_pose);
    } else if (model.target) {
      data.vehicle[kTarget] = get_body_motion(data.target->mechanism.tree, model.target->vehicle);
    } else if (model.record[kTarget] >= 0) {
      data.vehicle[kTarget] = data.recorded[kTarget].frame;
    } else {
      data.vehicle[kTarget] = get_vehicle_pose(model, kTarget, y);
      if (model.moves[kTarget]) calc_target_velocity(model, y, data.vehicle[kTarget]);
    }
    data.carrier[kTarget] =
        model.target ? get_body_motion(data.target->mechanism.tree, model.target->model.carrier)
                     : data.vehicle[kTarget];
    data.interface[kTarget] =
        find_frame_on(data.carrier[kTarget], model.interface_on_carrier[kTarget]);
    if (is_joined) {
      const Pose<double> P = data.locked->target_pose * model.interface_pose[kTarget];
      data.relative = find_rest<S>(inverse(data.locked->capture) * P);
      for (size_t i = 0; i < data.contact_bodies.size(); ++i) {
        data.relative.others[i] = find_rest<S>(inverse(data.locked->contact_bodies[i]) * P);
      }
      data.across = find_rest<S>(inverse(model.interface_pose[kChaser]) * P);
      return;
    }
    data.relative = find_relative(data.capture, data.interface[kTarget]);
    for (size_t i = 0; i < data.contact_bodies.size(); ++i) {
      data.relative.others[i] = find_relative(data.contact_bodies[i], data.interface[kTarget]);
    }
    if (model.acts_across()) {
      data.across = find_relative(data.interface[kChaser], data.interface[kTarget]);
    }
  }
}

}  // namespace dockloop
