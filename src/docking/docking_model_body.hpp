// The equations of motion of a docking.
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

namespace {

/// Contact between P and another body than that of G, about the origin of the body, axes of O.
template <class S>
Wrench<S> find_load_of_body(size_t body, const DockingData<S>& data) {
  return data.contact_bodies[body].R * data.contact_work.on_passive[body];
}

/// Nothing acts between P and bodies of the chaser.
template <class S>
void clear_capture_loads(DockingData<S>& data) {
  data.on_passive = data.by_capture = Wrench<S>();
  for (Wrench<S>& load : data.contact_work.on_passive) load = Wrench<S>();
}

/// Contact and latches, and their load on the capture body.
template <class S>
Status calc_capture_forces(const DockingModel& model, const DiscreteState& discrete,
                           const ContactMemory& memory, S t, const S* y, S* ydot,
                           DockingData<S>& data) {
  clear_capture_loads(data);
  if (!model.present[kTarget]) return {};
  if (!data.touches) {
    data.contact = ContactResult<S>();
    data.latch.power = S(0);
    if (ydot) std::fill_n(ydot + model.layout.bristles, model.layout.bristle_count, S(0));
    return {};
  }
  if (!model.contact.empty()) {
    const bool bristles = model.layout.bristle_count > 0;
    S* rates =
        bristles ? (ydot ? ydot + model.layout.bristles : data.bristle_rate.data()) : nullptr;
    const Status status = calc_contact(model.contact, memory, data.relative,
                                       bristles ? y + model.layout.bristles : nullptr, rates,
                                       data.contact_work, data.contact);
    if (!status.ok()) return status;
    data.on_passive = data.contact.on_passive;
  }
  if (model.latches.count() > 0) {
    calc_latches(model.latches, discrete.latch.data(), t, data.relative, data.latch);
    data.on_passive += data.latch.on_passive;
  }
  data.on_passive = data.by_capture = data.capture.R * data.on_passive;
  for (size_t i = 0; i < data.contact_bodies.size(); ++i) {
    const Wrench<S> load = find_load_of_body(i, data);
    data.on_passive.f += load.f;
    data.on_passive.t += load.t + (data.contact_bodies[i].p - data.capture.p).cross(load.f);
  }
  return {};
}

}  // namespace

template <class S>
void calc_coordinate_rates(const Body& body, const VecX<S>& q, const VecX<S>& v, S* qdot) {
  if (body.joint != JointType::kFree) {
    qdot[0] = v[body.v_index];
    return;
  }
  const Vec4<S> quat = q.template segment<4>(body.q_index + 3);
  const Vec3<S> rate = quat_to_matrix<S>(quat) * v.template segment<3>(body.v_index);
  const Vec4<S> quat_dot = quat_rate<S>(quat, v.template segment<3>(body.v_index + 3));
  for (int j = 0; j < 3; ++j) qdot[j] = rate[j];
  for (int j = 0; j < 4; ++j) qdot[3 + j] = quat_dot[j];
}

namespace {

template <class S>
void put(S* at, const Vec3<S>& v) {
  for (int j = 0; j < 3; ++j) at[j] = v[j];
}

/// Rates of pose and momentum of a vehicle under a force at p and a moment, axes of O.
template <class S>
void put_vehicle_rates(const DockingModel& model, int i, const FrameMotion<S>& frame,
                       const Vec3<S>& force, const Vec3<S>& moment_about_O, const S* y, S* ydot) {
  const int pose = model.layout.pose[i], momentum = model.layout.momentum[i];
  if (pose < 0) return;  // a record has them
  put<S>(ydot + pose, frame.v);
  const Vec4<S> q(y[pose + 3], y[pose + 4], y[pose + 5], y[pose + 6]);
  const Vec4<S> qdot = quat_rate<S>(q, frame.R.transpose() * frame.w);
  for (int j = 0; j < 4; ++j) ydot[pose + 3 + j] = qdot[j];
  put<S>(ydot + momentum, force);
  put<S>(ydot + momentum + 3, moment_about_O);
}

}  // namespace

template <class S>
TargetData<S>::TargetData(const Mechanism& target) : mechanism(target) {
  for (auto* x : {&no_command, &joint_force}) x->setZero(target.model.part_forces);
}

template <class S>
DockingData<S>::DockingData(const DockingModel& model)
    : mechanism(model.mechanism), contact_work(model.contact), elements(model.mechanism.model) {
  if (model.target) target.emplace(*model.target);
  command.setZero(count_commands(model.mechanism.model));
  joint_force.setZero(static_cast<int>(model.mechanism.model.forces.size()));
  bristle_rate.setZero(model.layout.bristle_count);
  contact_bodies.resize(model.contact.bodies.size() - 1);
  relative.others.resize(contact_bodies.size());
}

template <class S>
Wrench<S> find_inertial_load(const VehicleBody& part, const FrameMotion<S>& chaser,
                             const Vec3<S>& a, const Vec3<S>& alpha) {
  const Vec3<S> c = chaser.R * cast<S>(part.com);
  const Mat3<S> I = chaser.R * cast<S>(part.inertia) * chaser.R.transpose();
  Wrench<S> load;
  load.f = S(part.mass) * (a + alpha.cross(c) + chaser.w.cross(chaser.w.cross(c)));
  load.t = c.cross(load.f) + I * alpha + chaser.w.cross(I * chaser.w);
  return load;
}

namespace {

/// Acceleration of the chaser's origin less gravity, and angular acceleration, of one rigid body.
/// @param load  on the body, about the chaser's origin
template <class S>
void calc_rigid_acceleration(const VehicleBody& whole, const FrameMotion<S>& chaser,
                             const Wrench<S>& load, Vec3<S>& a, Vec3<S>& alpha) {
  const Vec3<S> c = chaser.R * cast<S>(whole.com);
  const Vec3<S> w = chaser.R.transpose() * chaser.w;
  const Mat3<S> I = cast<S>(whole.inertia);
  const Vec3<S> moment = chaser.R.transpose() * (load.t - c.cross(load.f));
  alpha = chaser.R * (cast<S>(invert(whole.inertia)) * (moment - w.cross(I * w)));
  a = load.f / S(whole.mass) - alpha.cross(c) - chaser.w.cross(chaser.w.cross(c));
}

/// Load of the capture interface on bodies of the chaser, about the chaser's origin.
template <class S>
Wrench<S> find_captured_load(const Wrench<S>& on_passive, const DockingData<S>& data) {
  Wrench<S> load;
  load.f = -on_passive.f;
  load.t = -on_passive.t - (data.capture.p - data.vehicle[kChaser].p).cross(on_passive.f);
  return load;
}

/// Loads from outside that keep vehicles on their records.
template <class S>
void calc_record_loads(const DockingModel& model, DockingData<S>& data) {
  const Vec3<S>& gravity = data.base.gravity;
  const auto find_inertial = [&](int i, const VehicleBody& body) {
    const RecordedMotion<S>& motion = data.recorded[i];
    return find_inertial_load(body, motion.frame, Vec3<S>(motion.a - gravity), motion.alpha);
  };
  const auto find_needed = [&](const MechanismData<S>& tree, const Mat3<S>& R) {
    const Vec6<S>& load = tree.on_vehicle;
    return R * Wrench<S>{load.template head<3>(), load.template tail<3>()};
  };
  if (model.record[kChaser] >= 0) {
    Wrench<S>& load = data.record_load[kChaser];
    if (data.locked) {
      load = find_inertial(kChaser, data.locked->whole);
      load -= data.mechanism.tree.external[model.mechanism.vehicle];
      load -= find_captured_load(data.on_passive, data);
    } else {
      load = find_needed(data.mechanism, data.vehicle[kChaser].R);
    }
  }
  if (model.record[kTarget] < 0) return;
  Wrench<S>& load = data.record_load[kTarget];
  const FrameMotion<S>& target = data.vehicle[kTarget];
  if (model.target) {
    load = find_needed(data.target->mechanism, target.R);
    return;
  }
  load = find_inertial(kTarget, model.vehicle[kTarget]);
  const auto subtract = [&](const Wrench<S>& acting, const Vec3<S>& at) {
    load.f -= acting.f;
    load.t -= acting.t + (at - target.p).cross(acting.f);
  };
  subtract(data.on_passive, data.capture.p);
  if (model.acts_across()) subtract(data.on_target, data.interface[kChaser].p);
}

}  // namespace

template <class S>
void calc_docking_reactions(const DockingModel& model, DockingData<S>& data) {
  const int vehicle = model.mechanism.vehicle, carrier = model.mechanism.model.carrier;
  Wrench<S>& on_base = data.mechanism.on_base;
  if (model.target) {
    calc_reactions(*model.target, data.base, model.target->vehicle, data.target->mechanism);
  }
  if (!data.locked) {
    calc_reactions(model.mechanism, data.base, carrier, data.mechanism);
    data.on_chaser = on_base;
    const int first_part = model.mechanism.model.first_part(),
              count = static_cast<int>(model.mechanism.model.bodies.size());
    if (carrier != vehicle) {
      data.on_chaser = find_carried_load(model.mechanism, vehicle, 0, count, data.mechanism.tree);
    } else if (first_part < count) {
      on_base -=
          find_carried_load(model.mechanism, vehicle, first_part, count, data.mechanism.tree);
    }
    return;
  }
  const FrameMotion<S>& chaser = data.vehicle[kChaser];
  const int capture_body = model.mechanism.model.capture_body;
  Wrench<S> on_mechanism = data.on_passive;
  if (capture_body == vehicle) on_mechanism -= data.by_capture;
  Vec3<S> a = -data.base.gravity, alpha = Vec3<S>::Zero();
  if (vehicle != kBase) {
    const Wrench<S> load =
        data.mechanism.tree.external[vehicle] + find_captured_load(data.on_passive, data);
    if (model.record[kChaser] >= 0) {
      a += data.recorded[kChaser].a;
      alpha = data.recorded[kChaser].alpha;
    } else {
      calc_rigid_acceleration(data.locked->whole, chaser, load, a, alpha);
    }
    data.mechanism.tree.a[vehicle] = a;
    data.mechanism.tree.alpha[vehicle] = alpha;
  }
  on_base = S(-1) * find_inertial_load(data.locked->mechanism, chaser, a, alpha);
  on_base += find_captured_load(on_mechanism, data);
  data.on_chaser = on_base;
  if (data.locked->parts.mass > 0.0) {
    on_base += find_inertial_load(data.locked->parts, chaser, a, alpha);
  }
  if (carrier != vehicle) {
    if (capture_body == carrier) on_base -= find_captured_load(data.by_capture, data);
    if (model.acts_across()) {
      const Vec3<S> arm = data.interface[kChaser].p - chaser.p;
      data.on_chaser.f -= data.on_target.f;
      data.on_chaser.t -= data.on_target.t + arm.cross(data.on_target.f);
    }
    on_base.t += (chaser.p - data.carrier[kChaser].p).cross(on_base.f);
  }
  if (vehicle == kBase) {
    on_base.t += chaser.p.cross(on_base.f);
    data.on_chaser = on_base;
  }
}

namespace {

/// Forces of elements, and rates of their bristles. The bristles of a locked mechanism rest.
template <class S>
Status calc_element_loads(const DockingModel& model, const DiscreteState& discrete, const S& t,
                          const S* y, S* ydot, DockingData<S>& data) {
  const StateLayout& layout = model.layout;
  const MechanismModel& mechanism = model.mechanism.model;
  const TreeData<S>& tree = data.mechanism.tree;
  ElementData<S>& elements = data.elements;
  ElementSwitches switches;
  if (!model.sequence.empty()) {
    switches = {discrete.law.data(), discrete.entered.data(), discrete.lock.data()};
  }
  const Status status = calc_element_forces(
      mechanism, tree.q, tree.v, t, data.command.data() + mechanism.forces.size(), switches,
      y + layout.element_bristles, elements, data.mechanism.tau);
  if (data.locked) {
    elements.z_rate.setZero();
    elements.sums.braking = S(0);
  }
  if (!ydot) return status;
  for (int i = 0; i < layout.element_bristle_count; ++i) {
    ydot[layout.element_bristles + i] = elements.z_rate[i];
  }
  return status;
}

/// Load across A and P: hard dock and forces between the vehicles; with a rigid joint, what moves
/// the target with the chaser. @pre loads on the chaser from outside; contact and latches
template <class S>
void calc_load_on_target(const DockingModel& model, const DiscreteState& discrete,
                         const ExternalLoads<S>& loads, const S& t, DockingData<S>& data) {
  const FrameMotion<S>&chaser = data.vehicle[kChaser], &A = data.interface[kChaser];
  const bool is_joined = data.locked && data.locked->has_target;
  calc_hard_dock(model.hard_dock, discrete.hard_dock, t, data.across, data.hard_dock);
  Wrench<S> across = data.hard_dock.on_passive;
  if (!model.forces.empty()) {
    data.forces = sum_vehicle_forces<S>(model.forces, data.across);
    across += data.forces.on_passive;
  }
  if (!is_joined) {
    data.on_target = A.R * across;
  } else {
    const FrameMotion<S>& target = data.vehicle[kTarget];
    Wrench<S> outside;  // about the chaser's origin, without weight
    outside.f = loads.force[kTarget];
    outside.t = target.R * loads.torque[kTarget] + (target.p - chaser.p).cross(outside.f);
    Vec3<S> a, alpha;
    calc_rigid_acceleration(data.locked->joined, chaser,
                            data.mechanism.tree.external[model.mechanism.vehicle] + outside, a,
                            alpha);
    Wrench<S> load = find_inertial_load(data.locked->target, chaser, a, alpha);
    load -= outside;
    load.f -= data.on_passive.f;
    load.t -= data.on_passive.t + (data.capture.p - chaser.p).cross(data.on_passive.f);
    data.on_target.f = load.f;
    data.on_target.t = load.t - (A.p - chaser.p).cross(load.f);
  }
  if (model.mechanism.vehicle == kBase) return;
  Wrench<S>& on_chaser =
      data.mechanism.tree
          .external[data.locked ? model.mechanism.vehicle : model.mechanism.model.carrier];
  const Vec3<S> arm = A.p - (data.locked ? chaser : data.carrier[kChaser]).p;
  on_chaser.f -= data.on_target.f;
  on_chaser.t -= data.on_target.t + arm.cross(data.on_target.f);
}

/// Weight of the mechanism, contact and latches on the capture body, loads from outside on the
/// chaser, and the load across A and P.
template <class S>
void calc_outside_loads(const DockingModel& model, const DiscreteState& discrete,
                        const ExternalLoads<S>& loads, const S& t, DockingData<S>& data) {
  MechanismData<S>& mechanism = data.mechanism;
  const Vec3<S> gravity = model.falling ? Vec3<S>(Vec3<S>::Zero()) : loads.gravity;
  data.base.gravity = gravity;
  for (Wrench<S>& load : mechanism.tree.external) load = Wrench<S>();
  const int capture_body = model.mechanism.model.capture_body;
  if (capture_body != kBase && !data.locked) {
    Wrench<S>& load = mechanism.tree.external[capture_body];
    load.f -= data.by_capture.f;
    load.t -= data.by_capture.t +
              (data.capture.p - mechanism.tree.p[capture_body]).cross(data.by_capture.f);
  }
  for (size_t i = 0; i < data.contact_bodies.size() && !data.locked; ++i) {
    mechanism.tree.external[model.mechanism.model.contact_bodies[i]] -= find_load_of_body(i, data);
  }
  data.thrust = discrete.thrust_on
                    ? find_frame_on(data.vehicle[kChaser], model.interface_pose[kChaser]).R.col(0) *
                          S(model.thrust)
                    : Vec3<S>(Vec3<S>::Zero());
  if (model.mechanism.vehicle != kBase) {
    Wrench<S>& load = mechanism.tree.external[model.mechanism.vehicle];
    load.f += loads.force[kChaser] + data.thrust;
    load.t += data.vehicle[kChaser].R * loads.torque[kChaser];
  }
  if (!model.acts_across()) return;
  data.on_target = Wrench<S>();
  if (data.touches) calc_load_on_target(model, discrete, loads, t, data);
}

/// Loads on a target with parts. @pre calc_outside_loads; sums of the joints of the mechanism
template <class S>
void calc_target_loads(const DockingModel& model, const ExternalLoads<S>& loads,
                       DockingData<S>& data) {
  MechanismData<S>& target = data.target->mechanism;
  for (Wrench<S>& load : target.tree.external) load = Wrench<S>();
  const auto add = [&](const Wrench<S>& load, const Vec3<S>& at) {
    Wrench<S>& sum = target.tree.external[model.target->model.carrier];
    sum.f += load.f;
    sum.t += load.t + (at - data.carrier[kTarget].p).cross(load.f);
  };
  add(data.on_passive, data.capture.p);
  if (model.acts_across()) add(data.on_target, data.interface[kChaser].p);
  Wrench<S>& outside = target.tree.external[model.target->vehicle];
  outside.f += loads.force[kTarget];
  outside.t += data.vehicle[kTarget].R * loads.torque[kTarget];
  target.tau.setZero();
  const JointForceSums<S> sums =
      calc_joint_forces(model.target->model, target.tree.q, target.tree.v, data.target->no_command,
                        data.target->joint_force, target.tau);
  data.joints.energy += sums.energy;
  data.joints.dissipation += sums.dissipation;
}

/// The same for chaser, mechanism and target as one body. Of what acts inside, rates need only what
/// releases energy: latches, hooks, pushers.
template <class S>
void calc_joined_loads(const DockingModel& model, const DiscreteState& discrete,
                       const ExternalLoads<S>& loads, const S& t, DockingData<S>& data) {
  clear_capture_loads(data);
  data.contact.contact_power = data.contact.friction_power = S(0);
  data.contact.surface_force.fill(Vec3<S>::Zero());
  data.joints = JointForceSums<S>();
  data.elements.sums = {};
  if (model.latches.count() > 0) {
    calc_latches(model.latches, discrete.latch.data(), t, data.relative, data.latch);
  }
  calc_outside_loads(model, discrete, loads, t, data);
}

}  // namespace

template <class S>
Status calc_loads(const DockingModel& model, const DiscreteState& discrete,
                  const ContactMemory& memory, const ExternalLoads<S>& loads, S t, const S* y,
                  S* ydot, DockingData<S>& data) {
  const Status status = calc_capture_forces(model, discrete, memory, t, y, ydot, data);
  if (!status.ok()) return status;
  calc_outside_loads(model, discrete, loads, t, data);
  MechanismData<S>& mechanism = data.mechanism;
  mechanism.tau.setZero();
  data.command = loads.command;
  data.joints = calc_joint_forces(model.mechanism.model, mechanism.tree.q, mechanism.tree.v,
                                  data.command, data.joint_force, mechanism.tau);
  if (model.target) calc_target_loads(model, loads, data);
  if (model.mechanism.model.elements.empty()) return {};
  return calc_element_loads(model, discrete, t, y, ydot, data);
}

namespace {

/// Bristles rest in a stack that moves as one body.
template <class S>
void rest_bristles(const DockingModel& model, S* ydot, DockingData<S>& data) {
  data.contact.friction_power = S(0);
  if (!ydot) return;
  std::fill_n(ydot + model.layout.bristles, model.layout.bristle_count, S(0));
  std::fill_n(ydot + model.layout.element_bristles, model.layout.element_bristle_count, S(0));
}

/// Rates of all states. @pre calc_loads; accelerations of a mechanism that moves
template <class S>
void put_rates(const DockingModel& model, const ExternalLoads<S>& loads, const S* y, S* ydot,
               DockingData<S>& data) {
  // Mechanism relative to its vehicle.
  MechanismData<S>& mechanism = data.mechanism;
  int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    calc_coordinate_rates(body, mechanism.tree.q, mechanism.tree.v, ydot + q);
    q += body.nq();
    for (int j = 0; j < body.nv(); ++j) ydot[v++] = mechanism.vdot[body.v_index + j];
  }
  if (model.mechanism.plan.is_driven) {
    calc_loop_forces(model.mechanism.plan, mechanism.vdot, mechanism.loops);
  }
  for (int j = 0; j < model.layout.target_n; ++j) {
    ydot[model.layout.target_q + j] = data.target->mechanism.tree.v[6 + j];
    ydot[model.layout.target_v + j] = data.target->mechanism.vdot[6 + j];
  }
  calc_vehicle_rates(model, loads, y, ydot, data);
}

}  // namespace

template <class S>
Status calc_docking(const DockingModel& model, const DiscreteState& discrete,
                    const ContactMemory& memory, const ExternalLoads<S>& loads, S t, const S* y,
                    S* ydot, DockingData<S>& data, Need need) {
  for (int i : {kChaser, kTarget}) {
    if (model.record[i] < 0) continue;
    const size_t k = static_cast<size_t>(model.record[i]);
    data.recorded[i] = find_recorded_motion(model.inputs[k], discrete.input_row[k], t);
  }
  Status status = calc_target_kinematics(model, y, data);
  if (!status.ok()) return status;
  if (data.locked) {
    calc_locked_kinematics(model, y, data);
    const bool is_joined = data.locked->has_target;
    if (is_joined && need == Need::kRates) {
      calc_joined_loads(model, discrete, loads, t, data);
    } else {
      status = calc_loads(model, discrete, memory, loads, t, y, ydot, data);
    }
    if (is_joined) rest_bristles(model, ydot, data);
    if (!status.ok()) return status;
  } else {
    status = calc_kinematics(model, t, y, need, data);
    if (status.ok()) status = calc_loads(model, discrete, memory, loads, t, y, ydot, data);
    if (!status.ok()) return status;
    calc_acceleration(model.mechanism, data.base, data.mechanism);
  }
  if (model.target) calc_acceleration(*model.target, data.base, data.target->mechanism);
  calc_record_loads(model, data);
  if (ydot) put_rates(model, loads, y, ydot, data);
  return {};
}

namespace {

/// Known loads of a vehicle and what keeps it on its record, about its origin, axes of O.
template <class S>
Wrench<S> find_known_load(const DockingModel& model, int i, const ExternalLoads<S>& loads,
                          const DockingData<S>& data) {
  Wrench<S> load{loads.force[i], data.vehicle[i].R * loads.torque[i]};
  if (model.record[i] >= 0) load += data.record_load[i];
  return load;
}

}  // namespace

template <class S>
void calc_vehicle_rates(const DockingModel& model, const ExternalLoads<S>& loads, const S* y,
                        S* ydot, DockingData<S>& data) {
  const MechanismData<S>& mechanism = data.mechanism;
  const Vec3<S> gravity = data.base.gravity;
  const FrameMotion<S>& chaser = data.vehicle[kChaser];
  const Wrench<S> known_on_chaser = find_known_load(model, kChaser, loads, data);
  const Vec3<S> chaser_force = known_on_chaser.f + data.thrust;
  const Vec3<S> chaser_moment = known_on_chaser.t;
  // Vehicles: the forces between them act on both at the same point, so their rates cancel exactly.
  Vec3<S> impulse = Vec3<S>::Zero(), angular_impulse = Vec3<S>::Zero();
  S power = data.joints.command_power;
  if (model.mechanism.plan.is_driven) {
    power += find_drive_power(model.mechanism.model, model.mechanism.plan, mechanism.loops);
  }
  Vec3<S> exchanged = data.on_passive.f;
  Vec3<S> exchanged_moment = data.capture.p.cross(data.on_passive.f) + data.on_passive.t;
  if (model.acts_across()) {
    exchanged += data.on_target.f;
    exchanged_moment += data.interface[kChaser].p.cross(data.on_target.f) + data.on_target.t;
  }
  if (model.moves[kChaser]) {
    const S mass = mechanism.tree.m_sum[0];
    const Vec3<S> weight_moment =
        (mechanism.tree.h_sum[0] + mass * mechanism.tree.p[0]).cross(gravity);
    const Vec3<S> force = chaser_force + mass * gravity;
    const Vec3<S> moment = chaser_moment + chaser.p.cross(chaser_force) + weight_moment;
    put_vehicle_rates<S>(model, kChaser, chaser, force - exchanged, moment - exchanged_moment, y,
                         ydot);
    impulse += force;
    angular_impulse += moment;
    power += chaser_force.dot(chaser.v) + chaser_moment.dot(chaser.w);
    power += gravity.dot(get_momentum(model, kChaser, y, data).f);
  } else if (!(gravity.array() == S(0)).all()) {
    power += gravity.dot(mechanism.linear_momentum);  // weight of the mechanism
  }
  if (model.moves[kTarget]) {
    const FrameMotion<S>& target = data.vehicle[kTarget];
    const Wrench<S> known = find_known_load(model, kTarget, loads, data);
    Vec3<S> force = known.f + S(model.vehicle[kTarget].mass) * gravity;
    const Vec3<S> moment = known.t;
    Vec3<S> moment_about_O = moment + target.p.cross(force);
    power += force.dot(target.v) + moment.dot(target.w);
    if (model.target) {
      const LegSums<S> parts = find_motion_sums(*model.target, data.target->mechanism);
      force += parts.mass * gravity;
      moment_about_O += parts.first_moment.cross(gravity);
      power += gravity.dot(parts.momentum.f);
    }
    put_vehicle_rates<S>(model, kTarget, target, force + exchanged,
                         moment_about_O + exchanged_moment, y, ydot);
    impulse += force;
    angular_impulse += moment_about_O;
  }
  S* sums = ydot + model.layout.sums;
  sums[kSumContact] = data.contact.contact_power;
  sums[kSumFriction] = data.contact.friction_power;
  sums[kSumLegs] = data.joints.dissipation + data.elements.sums.dissipation;
  sums[kSumLatches] = data.latch.power;
  sums[kSumExternal] = power;
  if (model.layout.has_element_sums()) {
    sums[kSumBrakes] = data.elements.sums.braking;
    sums[kSumDrives] = data.elements.sums.drive_power;
  }
  if (model.layout.has_hard_dock_sum()) {
    sums[kSumDrives] += data.hard_dock.work;
    sums[kSumHardDock] = data.hard_dock.dissipation;
  }
  if (model.layout.has_force_sum()) {
    sums[model.layout.force_sum()] = data.forces.dissipation;
  }
  put<S>(ydot + model.layout.impulse, impulse);
  put<S>(ydot + model.layout.impulse + 3, angular_impulse);
  for (int i : {kChaser, kTarget}) {
    if (model.layout.host_impulse[i] < 0) continue;
    const FrameMotion<S>& frame = data.vehicle[i];
    const Vec3<S> weight = S(model.of_host[i].mass) * gravity;
    const Wrench<S> known = find_known_load(model, i, loads, data);
    const Vec3<S> force = known.f + weight;
    put<S>(ydot + model.layout.host_impulse[i], force);
    put<S>(
        ydot + model.layout.host_impulse[i] + 3,
        known.t + frame.p.cross(force) + (frame.R * cast<S>(model.of_host[i].com)).cross(weight));
  }
}

namespace {

/// Momentum of a part of the chaser, axes of O, angular part about the origin of O.
template <class S>
Wrench<S> find_part_momentum(const VehicleBody& part, const FrameMotion<S>& chaser) {
  const Vec3<S> c = chaser.R * cast<S>(part.com), at = chaser.p + c;
  const Mat3<S> I = chaser.R * cast<S>(part.inertia) * chaser.R.transpose();
  Wrench<S> p;
  p.f = S(part.mass) * (chaser.v + chaser.w.cross(c));
  p.t = at.cross(p.f) + I * chaser.w;
  return p;
}

/// Kinetic energy of the body of a vehicle, without what it carries.
template <class S>
S find_vehicle_energy(const Mechanism& mechanism, const TreeData<S>& tree) {
  const int i = mechanism.vehicle;
  const Body& body = mechanism.model.bodies[i];
  const BodyInertia<S> of = get_body_inertia(mechanism, i, tree);
  return S(0.5 * body.mass) * tree.u[i].squaredNorm() + tree.u[i].dot(tree.w[i].cross(of.h)) +
         S(0.5) * tree.w[i].dot(of.I * tree.w[i]);
}

}  // namespace

template <class S>
S find_kinetic_energy(const DockingModel& model, const DockingData<S>& data) {
  S energy(0);
  if (data.locked) {
    const FrameMotion<S>& chaser = data.vehicle[kChaser];
    const Wrench<S> p = find_part_momentum(data.locked->whole, chaser);
    energy += S(0.5) * (chaser.v.dot(p.f) + chaser.w.dot(p.t - chaser.p.cross(p.f)));
  } else {
    energy += find_mechanism_energy(model.mechanism, data.mechanism);
    if (model.mechanism.vehicle != kBase) {
      energy += find_vehicle_energy(model.mechanism, data.mechanism.tree);
    }
  }
  if (model.target) {
    energy += find_mechanism_energy(*model.target, data.target->mechanism) +
              find_vehicle_energy(*model.target, data.target->mechanism.tree);
  } else if (model.moves[kTarget]) {
    const FrameMotion<S>& target = data.vehicle[kTarget];
    const Vec3<S> w = target.R.transpose() * target.w;
    energy += S(0.5 * model.vehicle[kTarget].mass) * target.v.squaredNorm() +
              S(0.5) * w.dot(cast<S>(model.vehicle[kTarget].inertia) * w);
  }
  return energy;
}

template <class S>
Wrench<S> find_body_momentum(const Mechanism& mechanism, int body, const TreeData<S>& tree) {
  const BodyInertia<S> of = get_body_inertia(mechanism, body, tree);
  Wrench<S> p;
  p.f = S(mechanism.model.bodies[body].mass) * tree.u[body] + tree.w[body].cross(of.h);
  p.t = tree.p[body].cross(p.f) + of.I * tree.w[body] + of.h.cross(tree.u[body]);
  return p;
}

namespace {

/// Momentum of a tree with its vehicle.
template <class S>
Wrench<S> find_tree_momentum(const Mechanism& mechanism, const MechanismData<S>& data) {
  Wrench<S> sum = find_motion_sums(mechanism, data).momentum;
  if (mechanism.vehicle != kBase)
    sum += find_body_momentum(mechanism, mechanism.vehicle, data.tree);
  return sum;
}

}  // namespace

template <class S>
Wrench<S> get_momentum(const DockingModel& model, int vehicle, const S* y,
                       const DockingData<S>& data) {
  if (model.layout.momentum[vehicle] < 0) return find_momentum(model, vehicle, data);
  const S* x = y + model.layout.momentum[vehicle];
  return {Vec3<S>(x[0], x[1], x[2]), Vec3<S>(x[3], x[4], x[5])};
}

template <class S>
Wrench<S> find_momentum(const DockingModel& model, int vehicle, const DockingData<S>& data) {
  Wrench<S> sum;
  if (vehicle == kTarget) {
    if (!model.moves[kTarget]) return sum;
    if (model.target) return find_tree_momentum(*model.target, data.target->mechanism);
    const FrameMotion<S>& target = data.vehicle[kTarget];
    sum.f = S(model.vehicle[kTarget].mass) * target.v;
    sum.t = target.p.cross(sum.f) + target.R * (cast<S>(model.vehicle[kTarget].inertia) *
                                                (target.R.transpose() * target.w));
    return sum;
  }
  if (data.locked) return find_part_momentum(data.locked->whole, data.vehicle[kChaser]);
  return find_tree_momentum(model.mechanism, data.mechanism);
}

template <class S>
Wrench<S> find_inside_momentum(const DockingModel& model, const DockingData<S>& data, S& mass,
                               Vec3<S>& first_moment) {
  Wrench<S> sum;
  mass = S(0);
  first_moment.setZero();
  if (model.moves[kTarget] && !model.driven[kTarget]) {
    sum = find_momentum(model, kTarget, data);
    mass = S(model.vehicle[kTarget].mass);
    first_moment = mass * data.vehicle[kTarget].p;
    if (model.target) {
      const LegSums<S> parts = find_motion_sums(*model.target, data.target->mechanism);
      mass += parts.mass;
      first_moment += parts.first_moment;
    }
  }
  const TreeData<S>& tree = data.mechanism.tree;
  const FrameMotion<S>& chaser = data.vehicle[kChaser];
  const auto add = [&](const VehicleBody& part, const S& sign) {
    sum += sign * find_part_momentum(part, chaser);
    mass += sign * S(part.mass);
    first_moment += sign * S(part.mass) * (chaser.p + chaser.R * cast<S>(part.com));
  };
  if (data.locked) {
    add(model.driven[kChaser] ? data.locked->mechanism : data.locked->whole, S(1));
  } else {
    const LegSums<S> moving = find_motion_sums(model.mechanism, data.mechanism);
    sum += moving.momentum;
    mass += moving.mass;
    first_moment += moving.first_moment;
    const int vehicle = model.mechanism.vehicle;
    if (vehicle != kBase && !model.driven[kChaser]) {
      const S m(model.mechanism.model.bodies[vehicle].mass);
      sum += find_body_momentum(model.mechanism, vehicle, tree);
      mass += m;
      first_moment += get_body_inertia(model.mechanism, vehicle, tree).h + m * tree.p[vehicle];
    }
  }
  // The host's vehicle carries the mechanism frozen at home already.
  if (model.driven[kChaser] && model.frozen.mass != 0.0) add(model.frozen, S(-1));
  return sum;
}

#define DOCK_INSTANTIATE(S)                                                                        \
  template void put_mechanism_state<S>(const DockingModel&, const S*, TreeData<S>&);               \
  template void calc_frames<S>(const DockingModel&, const S*, DockingData<S>&);                    \
  template void calc_coordinate_rates<S>(const Body&, const VecX<S>&, const VecX<S>&, S*);         \
  template Status calc_loads<S>(const DockingModel&, const DiscreteState&, const ContactMemory&,   \
                                const ExternalLoads<S>&, S, const S*, S*, DockingData<S>&);        \
  template void calc_vehicle_rates<S>(const DockingModel&, const ExternalLoads<S>&, const S*, S*,  \
                                      DockingData<S>&);                                            \
  template struct TargetData<S>;                                                                   \
  template struct DockingData<S>;                                                                  \
  template Status calc_docking<S>(const DockingModel&, const DiscreteState&, const ContactMemory&, \
                                  const ExternalLoads<S>&, S, const S*, S*, DockingData<S>&,       \
                                  Need);                                                           \
  template void calc_docking_reactions<S>(const DockingModel&, DockingData<S>&);                   \
  template Wrench<S> find_inertial_load<S>(const VehicleBody&, const FrameMotion<S>&,              \
                                           const Vec3<S>&, const Vec3<S>&);                        \
  template RecordedMotion<S> find_recorded_motion<S>(const InputHistory&, int, const S&);          \
  template FrameMotion<S> find_frame_on<S>(const FrameMotion<S>&, const Pose<double>&);            \
  template RelativeMotion<S> find_relative<S>(const FrameMotion<S>&, const FrameMotion<S>&);       \
  template FrameMotion<S> get_vehicle_pose<S>(const DockingModel&, int, const S*);                 \
  template FrameMotion<S> find_capture_motion<S>(const DockingModel&, const TreeData<S>&);         \
  template S find_kinetic_energy<S>(const DockingModel&, const DockingData<S>&);                   \
  template Wrench<S> find_body_momentum<S>(const Mechanism&, int, const TreeData<S>&);             \
  template Wrench<S> find_momentum<S>(const DockingModel&, int, const DockingData<S>&);            \
  template Wrench<S> get_momentum<S>(const DockingModel&, int, const S*, const DockingData<S>&);   \
  template Wrench<S> find_inside_momentum<S>(const DockingModel&, const DockingData<S>&, S&,       \
                                             Vec3<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
