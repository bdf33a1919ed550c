// Templates compute the continuous outputs, one template per group: with plain numbers for the
// host, with dual numbers for derivatives (derivatives.cpp).
#pragma once

#include <algorithm>
#include <cmath>

#include "math/scalar.hpp"
#include "sim/audit.hpp"
#include "sim/outputs.hpp"

namespace dockloop {
namespace {

using std::abs;
using std::atan2;
using std::max;

/// Load on the target about the origin of P, axes of P.
template <class S>
Wrench<S> find_capture_load(const DockingData<S>& data) {
  const FrameMotion<S>& P = data.interface[kTarget];
  Wrench<S> load;
  load.f = P.R.transpose() * data.on_passive.f;
  load.t = P.R.transpose() * (data.on_passive.t + (data.capture.p - P.p).cross(data.on_passive.f));
  return load;
}

/// tension, compression, shear [N], bending, torsion [N m] of a capture load.
template <class S>
std::array<S, Outputs::kLoadCount> find_load_components(const Wrench<S>& load) {
  return {max<S>(S(0), -load.f.x()), max<S>(S(0), load.f.x()),
          find_length<S>(load.f.y(), load.f.z()), find_length<S>(load.t.y(), load.t.z()),
          abs(load.t.x())};
}

template <class S>
S find_load_ratio(const std::array<S, Outputs::kLoadCount>& load, const RatedLoads& rated) {
  const std::array<double, Outputs::kLoadCount> limit = {rated.tension, rated.compression,
                                                         rated.shear, rated.bending, rated.torsion};
  S ratio(0);
  for (int i = 0; i < Outputs::kLoadCount; ++i) {
    if (limit[i] > 0.0) ratio = max<S>(ratio, load[i] / S(limit[i]));
  }
  return ratio;
}

template <class S>
void read_vehicles(const OutputSource<S>& from, OutputValues<S>& out) {
  const DockingModel& model = from.model;
  for (int i : {kChaser, kTarget}) {
    if (!model.present[i]) continue;
    typename OutputValues<S>::Vehicle& vehicle = out.vehicle[i];
    if (!model.moves[i]) {
      const VehicleParameters& p = from.parameters.vehicle[i];
      vehicle.position = cast<S>(p.position);
      vehicle.attitude = cast<S>(p.attitude);
      continue;
    }
    if (model.record[i] >= 0) {
      const RecordedMotion<S>& motion = from.data.recorded[i];
      vehicle.position = cast<S>(from.frame_origin) + (from.frame_shift + motion.frame.p);
      vehicle.attitude = motion.attitude;
      vehicle.force_ext = from.data.record_load[i].f;
      vehicle.torque_ext = motion.frame.R.transpose() * from.data.record_load[i].t;
    } else {
      const S* at = from.y + model.layout.pose[i];
      vehicle.position =
          cast<S>(from.frame_origin) + (from.frame_shift + Vec3<S>(at[0], at[1], at[2]));
      vehicle.attitude = Vec4<S>(at[3], at[4], at[5], at[6]).normalized();
    }
    vehicle.velocity = from.frame_velocity + from.data.vehicle[i].v;
    vehicle.angular_velocity = from.data.vehicle[i].R.transpose() * from.data.vehicle[i].w;
  }
}

/// Is the docking hardware fixed on the vehicle, without an adapter?
inline bool carries_itself(const DockingModel& model, int vehicle) {
  const Mechanism* tree = vehicle == kChaser ? &model.mechanism
                          : model.target     ? &*model.target
                                             : nullptr;
  return !tree || tree->model.carrier == tree->vehicle;
}

/// Load of the docking system and of parts on each vehicle: now, and its mean over the step just
/// made.
template <class S>
void read_vehicle_loads(const OutputSource<S>& from, OutputValues<S>& out) {
  const DockingModel& model = from.model;
  const DockingData<S>& data = from.data;
  const int chaser_body = model.mechanism.vehicle;
  for (int i : {kChaser, kTarget}) {
    if (!model.present[i]) continue;
    const FrameMotion<S>& frame = data.vehicle[i];
    Wrench<S> load;  // about the CoM, axes of O
    if (i == kTarget) {
      load.f = data.on_passive.f;
      load.t = data.on_passive.t + (data.capture.p - frame.p).cross(data.on_passive.f);
      if (model.target) {
        if (!carries_itself(model, kTarget)) load = Wrench<S>();
        load += data.target->mechanism.on_base;
      }
    } else {
      load = data.on_chaser;
      if (chaser_body == kBase) load.t -= frame.p.cross(load.f);
      if (model.mechanism.model.capture_body == chaser_body) {
        load.f -= data.by_capture.f;
        load.t -= data.by_capture.t + (data.capture.p - frame.p).cross(data.by_capture.f);
      }
      load.f += data.thrust;
      if (model.frozen.mass != 0.0) {
        // The stated vehicle includes the mechanism, frozen in the home pose. The load includes the
        // force that accelerates this mass.
        load += find_inertial_load(model.frozen, frame, data.mechanism.tree.a[0],
                                   data.mechanism.tree.alpha[0]);
      }
    }
    if (model.acts_across() && carries_itself(model, i)) {
      const S sign(i == kTarget ? 1 : -1);
      const Vec3<S> arm = data.interface[kChaser].p - frame.p;
      load.f += sign * data.on_target.f;
      load.t += sign * (data.on_target.t + arm.cross(data.on_target.f));
    }
    typename OutputValues<S>::Vehicle& vehicle = out.vehicle[i];
    vehicle.force = load.f;
    vehicle.torque = frame.R.transpose() * load.t;
    const bool has_mean = from.has_mean && model.moves[i];
    vehicle.force_mean = has_mean ? cast<S>(from.mean[i].f) : vehicle.force;
    vehicle.torque_mean = has_mean ? cast<S>(from.mean[i].t) : vehicle.torque;
  }
}

template <class S>
void read_relative(const OutputSource<S>& from, OutputValues<S>& out) {
  const bool is_joined = from.data.locked && from.data.locked->has_target;
  const RelativeMotion<S> relative =
      is_joined ? from.data.across
                : find_relative(from.data.interface[kChaser], from.data.interface[kTarget]);
  out.relative_position = relative.p;
  out.relative_attitude = quat_from_matrix<S>(relative.R);
  out.relative_velocity = relative.v;
  out.relative_angular_velocity = relative.w;
  out.relative_axial = relative.p.x();
  out.relative_lateral = find_length<S>(relative.p.y(), relative.p.z());
  out.relative_pitch_yaw = find_pitch_yaw(out.relative_attitude);
  out.relative_roll = find_roll(out.relative_attitude);

  const Wrench<S> load = find_capture_load(from.data);
  out.capture_force = load.f;
  out.capture_torque = load.t;
  out.capture_load = find_load_components(load);
  out.capture_load_ratio = find_load_ratio(out.capture_load, from.rated);
}

template <class S>
void read_contact(const OutputSource<S>& from, OutputValues<S>& out) {
  const DockingModel& model = from.model;
  DockingData<S>& data = from.data;
  out.gap = S(kNoGap);
  if (model.present[kTarget] && !model.contact.empty()) {
    out.gap = find_gap(model.contact, from.memory, data.relative, data.contact_work);
    const auto read = [&](auto& force) {  // one of the two is empty
      for (size_t i = 0; i < force.size(); ++i) force[i] = data.contact.surface_force[i].norm();
    };
    read(out.petal_force);
    read(out.surface_force);
    out.contact_depth_ratio = data.contact.depth_ratio;
  }
  for (int i = 0; i < model.latches.count(); ++i) {
    out.latch_opening[i] = data.latch.opening[i];
    out.latch_lateral[i] = data.latch.lateral[i];
    out.latch_force[i] = data.latch.force[i];
  }
}

/// Loads across A and P.
template <class S>
void read_hard_dock(const OutputSource<S>& from, OutputValues<S>& out) {
  const DockingData<S>& data = from.data;
  const FrameMotion<S>& P = data.interface[kTarget];
  const Vec3<S> arm = data.interface[kChaser].p - P.p;
  out.joint_force = P.R.transpose() * data.on_target.f;
  out.joint_torque = P.R.transpose() * (data.on_target.t + arm.cross(data.on_target.f));
  out.face_force = data.hard_dock.face_force;
  out.pusher_force = data.hard_dock.pusher_force;
  std::copy_n(data.hard_dock.hook_force.begin(), out.hook_force.size(), out.hook_force.begin());
}

/// Loads of the forces between the vehicles.
template <class S>
void read_vehicle_forces(const OutputSource<S>& from, OutputValues<S>& out) {
  const RelativeMotion<S>& across = from.data.across;
  for (size_t i = 0; i < out.vehicle_force.size(); ++i) {
    const VehicleForce& force = from.model.forces[i];
    const Wrench<S> load = calc_vehicle_force<S>(force, across).on_passive;
    out.vehicle_force[i] = across.R.transpose() * load.f;
    out.vehicle_torque[i] = across.R.transpose() * (load.t - across.p.cross(load.f));
    out.vehicle_distance[i] = find_distance(force, across);
  }
}

/// Force along a leg: spring, damper, stops, laws of elements and command, and the force of
/// couplings (a screw with its rotor, a differential) on its slide or crank.
/// @param i  of the leg. @pre calc_docking_reactions()
template <class S>
S find_leg_force(const DockingModel& model, const DockingData<S>& data, size_t i) {
  const Leg& leg = model.mechanism.model.legs[i];
  const LegLoads& loads = model.leg_loads[i];
  S force = data.joint_force[leg.force];
  for (const LegLoads::Term& term : loads.elements) {
    force += S(term.factor) * data.elements.force[term.index];
  }
  if (data.locked) return force / S(leg.arm);  // forces of couplings are unknown
  for (const LegLoads::Term& term : loads.couplings) {
    force +=
        S(term.factor) * get_cut_force(model.mechanism.plan, data.mechanism.loops, term.index, 0);
  }
  return force / S(leg.arm);
}

template <class S>
void read_mechanism(const OutputSource<S>& from, OutputValues<S>& out) {
  const DockingModel& model = from.model;
  const MechanismData<S>& mechanism = from.data.mechanism;
  const RelativeMotion<S> ring = find_relative(from.data.interface[kChaser], from.data.capture);
  out.ring_position = ring.p;
  out.ring_attitude = quat_from_matrix<S>(ring.R);
  out.ring_velocity = ring.v;
  out.ring_angular_velocity = ring.w;
  for (size_t i = 0; i < model.mechanism.model.legs.size(); ++i) {
    const Leg& leg = model.mechanism.model.legs[i];
    const Body& body = model.mechanism.model.bodies[leg.body];
    out.leg_length[i] = S(leg.home_length) + S(leg.arm) * mechanism.tree.q[body.q_index];
    out.leg_rate[i] = S(leg.arm) * mechanism.tree.v[body.v_index];
    out.leg_force[i] = find_leg_force(model, from.data, i);
  }
  for (size_t i = 0; i < out.element_force.size(); ++i) {
    const ElementData<S>& elements = from.data.elements;
    const int at = static_cast<int>(i);
    out.element_coordinate[i] = elements.coordinate[at];
    out.element_rate[i] = elements.rate[at];
    out.element_force[i] = elements.force[at];
    out.element_saturation[i] = elements.saturation[at];
  }
  size_t part = 0;
  const auto read_parts = [&](const MechanismModel& tree, const MechanismData<S>& at,
                              const VecX<S>& force) {
    for (size_t k = tree.forces.size() - tree.part_forces; k < tree.forces.size(); ++k, ++part) {
      const Body& body = tree.bodies[tree.forces[k].body];
      out.part_coordinate[part] = at.tree.q[body.q_index];
      out.part_rate[part] = at.tree.v[body.v_index];
      out.part_force[part] = force[static_cast<int>(k)];
    }
  };
  read_parts(model.mechanism.model, mechanism, from.data.joint_force);
  if (model.target) {
    const TargetData<S>& target = *from.data.target;
    read_parts(model.target->model, target.mechanism, target.joint_force);
  }
  int q = 0, v = 0;
  for (int i : from.state_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) out.state_q[q++] = mechanism.tree.q[body.q_index + j];
    for (int j = 0; j < body.nv(); ++j) {
      out.state_v[v] = mechanism.tree.v[body.v_index + j];
      out.state_a[v++] = mechanism.vdot[body.v_index + j];
    }
  }
  for (size_t k = 0; k < out.loop_force.size(); ++k) {
    const int count = std::min(3, equation_count(model.mechanism.model.loops[k].cut));
    out.loop_force[k].setZero();
    if (from.data.locked) continue;  // cut forces are unknown
    for (int j = 0; j < count; ++j) {
      out.loop_force[k][j] =
          get_cut_force(model.mechanism.plan, mechanism.loops, static_cast<int>(k), j);
    }
  }
  // Load on the base in axes and about the origin of B.
  const FrameMotion<S>& carrier = from.data.carrier[kChaser];
  const FrameMotion<S> B = find_frame_on(carrier, model.base_on_carrier);
  const Vec3<S> about = model.mechanism.vehicle == kBase ? Vec3<S>(Vec3<S>::Zero()) : carrier.p;
  out.base_force = B.R.transpose() * mechanism.on_base.f;
  out.base_torque =
      B.R.transpose() * (mechanism.on_base.t + (about - B.p).cross(mechanism.on_base.f));
}

template <class S>
void read_energy(const OutputSource<S>& from, OutputValues<S>& out) {
  const DockingModel& model = from.model;
  const DockingData<S>& data = from.data;
  const S* sums = from.y + model.layout.sums;
  out.energy_kinetic = find_kinetic_energy(model, data);
  out.energy_potential = find_potential_energy(data);
  out.energy_dissipated_contact = sums[kSumContact];
  out.energy_dissipated_friction = sums[kSumFriction];
  out.energy_dissipated_legs = sums[kSumLegs];
  out.energy_dissipated_latches = sums[kSumLatches];
  out.energy_dissipated =
      sums[kSumContact] + sums[kSumFriction] + sums[kSumLegs] + sums[kSumLatches];
  out.energy_external = sums[kSumExternal] + S(from.host_work);
  if (model.layout.has_element_sums()) {
    out.energy_dissipated_brakes = sums[kSumBrakes];
    out.energy_dissipated += sums[kSumBrakes];
    out.energy_drive_work = sums[kSumDrives];
  }
  if (model.layout.has_hard_dock_sum()) {
    out.energy_dissipated_hard_dock = sums[kSumHardDock];
    out.energy_dissipated += sums[kSumHardDock];
  }
  if (model.layout.has_force_sum()) {
    out.energy_dissipated_forces = sums[model.layout.force_sum()];
    out.energy_dissipated += out.energy_dissipated_forces;
  }
  out.energy_residual = out.energy_kinetic + out.energy_potential + out.energy_dissipated -
                        out.energy_external - out.energy_drive_work - S(from.energy_start);
}

}  // namespace

// Swing and twist about x: q = swing * twist.
template <class S>
S find_pitch_yaw(const Vec4<S>& q) {
  return S(2) * atan2(find_length<S>(q[2], q[3]), find_length<S>(q[0], q[1]));
}

template <class S>
S find_roll(const Vec4<S>& q) {
  constexpr double kPi = static_cast<double>(EIGEN_PI);
  S roll = S(2) * atan2(q[1], q[0]);
  if (roll > S(kPi)) roll -= S(2.0 * kPi);
  if (roll < S(-kPi)) roll += S(2.0 * kPi);
  return roll;
}

template <class S>
void read_momentum(const OutputSource<S>& from, OutputValues<S>& out) {
  S mass(0);
  Vec3<S> first_moment;
  const Wrench<S> sum = find_inside_momentum(from.model, from.data, mass, first_moment);
  out.momentum_linear = sum.f + mass * from.frame_velocity;
  out.momentum_angular = sum.t + first_moment.cross(from.frame_velocity);
  out.momentum_reference = cast<S>(from.frame_origin) + from.frame_shift;
}

template <class S>
void read_outputs(const OutputSource<S>& from, OutputValues<S>& out) {
  calc_docking_reactions(from.model, from.data);
  read_vehicles(from, out);
  read_vehicle_loads(from, out);
  if (from.model.present[kTarget]) read_relative(from, out);
  read_contact(from, out);
  if (!from.model.hard_dock.empty()) read_hard_dock(from, out);
  read_vehicle_forces(from, out);
  read_mechanism(from, out);
  read_energy(from, out);
}

#define DOCK_INSTANTIATE(S)                                                 \
  template void read_outputs<S>(const OutputSource<S>&, OutputValues<S>&);  \
  template void read_momentum<S>(const OutputSource<S>&, OutputValues<S>&); \
  template S find_pitch_yaw<S>(const Vec4<S>&);                             \
  template S find_roll<S>(const Vec4<S>&);
DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
