// The equations of motion of a docking.
#pragma once

#include <algorithm>

#include "docking/docking_balance_body.hpp"
#include "docking/docking_kinematics_body.hpp"
#include "docking/docking_model.hpp"
#include "math/decompositions.hpp"
#include "math/scalar.hpp"

namespace dockloop {

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
  // Bodies with surfaces are no parts of legs on platforms (loops/platform_plan.cpp).
  mechanism.tree.may_load_legs = false;
  for (int i : model.mechanism.plan.tree_bodies) mechanism.tree.external[i] = Wrench<S>();
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
