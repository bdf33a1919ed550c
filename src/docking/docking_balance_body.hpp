// Kinetic energy and momentum of a docking, for audits and outputs.
#pragma once

#include "docking/docking_kinematics_body.hpp"

namespace dockloop {

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

}  // namespace dockloop
