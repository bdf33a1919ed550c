// What makes and changes the model of a docking; docking_model_body.hpp, compiled for the scalars
// of the core.
#include "docking/docking_model.hpp"

#include <cstdio>

#include "docking/docking_model_body.hpp"
#include "math/decompositions.hpp"
#include "mechanism/massless_legs.hpp"

namespace dockloop {

namespace {

/// Mechanism on a moving or fixed chaser. @return with `bare` the chaser without mechanism.
Mechanism make_attached_mechanism(const MechanismModel& described, const VehicleBody& on_base,
                                  const VehicleParameters& chaser, bool moves,
                                  const Pose<double>& base_in_chaser,
                                  const Pose<double>& chaser_pose, VehicleParts parts,
                                  VehicleBody& bare, VehicleBody& frozen_in_chaser) {
  bare.mass = chaser.mass;
  bare.inertia = make_symmetric(chaser.inertia);
  if (!moves) return Mechanism(fix_base(described, chaser_pose * base_in_chaser));
  if (chaser.mass_includes_mechanism == 2 && parts.adapter) {
    throw ModelError(
        "chaser.mass_includes_mechanism is 2 (included), but an adapter carries the mechanism; set "
        "1 and state the mass of the vehicle behind the adapter");
  }
  if (chaser.mass_includes_mechanism == 2 && !described.bodies.empty()) {
    // The stated vehicle is the bare one plus the mechanism frozen at home: take it out again.
    frozen_in_chaser = transform(base_in_chaser, find_frozen_body(Mechanism(described)));
    if (!(chaser.mass > frozen_in_chaser.mass)) {
      char text[200];
      std::snprintf(text, sizeof text,
                    "chaser.mass is %.6g kg and includes a mechanism of %.6g kg; it must be larger",
                    chaser.mass, frozen_in_chaser.mass);
      throw ModelError(text);
    }
    bare = find_bare_vehicle(bare, frozen_in_chaser);
    if (!is_positive_definite(bare.inertia)) {
      throw ModelError("chaser.inertia is less than that of the mechanism it is said to include");
    }
  } else if (on_base.mass > 0.0 && parts.adapter) {
    VehiclePart& adapter = *parts.adapter;
    const VehicleBody whole = join({adapter.mass, adapter.com, adapter.inertia},
                                   transform(inverse(adapter.placement) * base_in_chaser, on_base));
    adapter.mass = whole.mass;
    adapter.com = whole.com;
    adapter.inertia = whole.inertia;
  } else if (on_base.mass > 0.0) {
    const VehicleBody feet = transform(base_in_chaser, on_base);
    frozen_in_chaser = {-feet.mass, feet.com, -feet.inertia};
    bare = find_bare_vehicle(bare, frozen_in_chaser);
  }
  Mechanism mechanism(attach_vehicle(described, bare, base_in_chaser, parts));
  mechanism.vehicle = 0;
  return mechanism;
}

StateLayout make_layout(const DockingModel& model) {
  StateLayout layout;
  int at = 0;
  const auto take = [&](int count) {
    const int first = at;
    at += count;
    return first;
  };
  const MechanismModel& mechanism = model.mechanism.model;
  for (int i : model.mechanism_bodies) {
    layout.mechanism_nq += mechanism.bodies[i].nq();
    layout.mechanism_nv += mechanism.bodies[i].nv();
  }
  layout.mechanism_q = take(layout.mechanism_nq);
  layout.mechanism_v = take(layout.mechanism_nv);
  if (model.target) layout.target_n = model.target->model.part_forces;
  layout.target_q = take(layout.target_n);
  layout.target_v = take(layout.target_n);
  for (int i : {kChaser, kTarget}) {
    if (!model.present[i] || !model.moves[i] || model.record[i] >= 0) continue;
    layout.pose[i] = take(7);
    layout.momentum[i] = take(6);
  }
  layout.sum_count = count_sums(mechanism, model.hard_dock, model.forces);
  layout.force_sums = model.forces.empty() ? 0 : 1;
  layout.sums = take(layout.sum_count);
  layout.impulse = take(6);
  for (int i : {kChaser, kTarget}) {
    if (model.driven[i] || model.record[i] >= 0) layout.host_impulse[i] = take(6);
  }
  layout.element_bristle_count = count_element_bristles(mechanism.elements, mechanism.failures);
  layout.element_bristles = take(layout.element_bristle_count);
  layout.bristle_count = bristle_state_count(model.contact);
  layout.bristles = take(layout.bristle_count);
  layout.size = at;
  return layout;
}

/// Bodies whose coordinates are states: the independent ones of the mechanism.
void list_mechanism_bodies(DockingModel& model) {
  model.mechanism_bodies.clear();
  for (int i : model.mechanism.plan.ind_bodies) {
    if (i != model.mechanism.vehicle) model.mechanism_bodies.push_back(i);
  }
}

void list_leg_loads(DockingModel& model) {
  const MechanismModel& mechanism = model.mechanism.model;
  model.leg_loads.assign(mechanism.legs.size(), {});
  for (size_t i = 0; i < mechanism.legs.size(); ++i) {
    const int body = mechanism.legs[i].body;
    LegLoads& loads = model.leg_loads[i];
    for (size_t e = 0; e < mechanism.elements.size(); ++e) {
      for (const ElementTerm& term : mechanism.elements[e].along) {
        if (term.body == body) loads.elements.push_back({static_cast<int>(e), term.ratio});
      }
    }
    for (size_t k = 0; k < mechanism.loops.size(); ++k) {
      const Loop& loop = mechanism.loops[k];
      const double factor = loop.cut == CutType::kCoupling ? find_coupling_factor(loop, body) : 0.0;
      if (factor != 0.0) loads.couplings.push_back({static_cast<int>(k), factor});
    }
  }
}

void make_lists(DockingModel& model) {
  list_mechanism_bodies(model);
  list_leg_loads(model);
}

}  // namespace

int count_sums(const MechanismModel& mechanism, const HardDock& dock,
               const std::vector<VehicleForce>& forces) {
  const int more = forces.empty() ? 0 : 1;
  if (!dock.empty()) return kSumCountWithHardDock + more;
  return (mechanism.elements.empty() ? kSumCount : kSumCountWithElements) + more;
}

VehicleBody find_bare_vehicle(const VehicleBody& of_host, const VehicleBody& frozen) {
  if (frozen.mass == 0.0) return of_host;
  if (frozen.mass < 0.0) return join(of_host, {-frozen.mass, frozen.com, -frozen.inertia});
  const auto find_spread = [](const VehicleBody& body) {
    return find_point_inertia(body.mass, body.com);
  };
  VehicleBody bare;
  bare.mass = of_host.mass - frozen.mass;
  bare.com = (of_host.mass * of_host.com - frozen.mass * frozen.com) / bare.mass;
  const Mat3<double> frozen_about_origin = frozen.inertia + find_spread(frozen);
  bare.inertia = of_host.inertia + find_spread(of_host) - frozen_about_origin - find_spread(bare);
  return bare;
}

void set_host_body(DockingModel& model, int vehicle, const VehicleBody& of_host) {
  const bool is_chaser = vehicle == kChaser;
  model.of_host[vehicle] = of_host;
  model.vehicle[vehicle] = is_chaser ? find_bare_vehicle(of_host, model.frozen) : of_host;
  const VehicleBody& bare = model.vehicle[vehicle];
  Mechanism* tree = is_chaser ? &model.mechanism : model.target ? &*model.target : nullptr;
  if (!tree || tree->vehicle == kBase) return;
  Body& body = tree->model.bodies[tree->vehicle];
  body.mass = bare.mass;
  body.com = bare.com;
  body.inertia = bare.inertia;
}

void set_mechanism(DockingModel& model, const Mechanism& mechanism) {
  model.mechanism = mechanism;
  make_lists(model);
}

void get_mechanism_state(const DockingModel& model, const TreeData<double>& tree, double* y) {
  int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) y[q++] = tree.q[body.q_index + j];
    for (int j = 0; j < body.nv(); ++j) y[v++] = tree.v[body.v_index + j];
  }
}

DockingModel make_docking_model(const Scene& scene,
                                const std::array<VehicleParameters, 2>& parameters,
                                const ContactLaw& law, const Vec3<double>& origin_of_O, int level) {
  std::array<Pose<double>, 2> interface_pose, fixed_pose;
  for (int i : {kChaser, kTarget}) {
    const VehicleParameters& p = parameters[i];
    interface_pose[i] = {quat_to_matrix<double>(p.interface_attitude), p.interface_position};
    fixed_pose[i] = {quat_to_matrix<double>(p.attitude), p.position - origin_of_O};
  }
  const bool chaser_moves = scene.motion[kChaser] != Motion::kFixed;
  const Pose<double> base_in_chaser = interface_pose[kChaser] * scene.base_in_interface;
  const MasslessLegs described = level == kMasslessLegs ? make_legs_massless(scene.mechanism)
                                                        : MasslessLegs{scene.mechanism, {}};
  VehicleBody bare, frozen;
  DockingModel model(make_attached_mechanism(
      described.model, described.on_base, parameters[kChaser], chaser_moves, base_in_chaser,
      fixed_pose[kChaser], scene.parts[kChaser], bare, frozen));
  model.present = {true, scene.has_target};
  model.moves = {chaser_moves, scene.has_target && scene.motion[kTarget] != Motion::kFixed};
  for (int i : {kChaser, kTarget}) {
    model.driven[i] = model.present[i] && scene.motion[i] == Motion::kDriven;
    model.of_host[i].mass = parameters[i].mass;
    model.of_host[i].inertia = make_symmetric(parameters[i].inertia);
  }
  model.fixed_pose = fixed_pose;
  model.interface_pose = interface_pose;
  model.vehicle[kChaser] = bare;
  model.frozen = std::move(frozen);
  model.vehicle[kTarget] = model.of_host[kTarget];
  if (scene.parts[kTarget].count_coordinates() > 0) {
    model.target.emplace(
        attach_vehicle(MechanismModel(), model.vehicle[kTarget], {}, scene.parts[kTarget]));
    model.target->vehicle = 0;
  }
  model.interface_on_carrier = interface_pose;
  model.base_on_carrier = base_in_chaser;
  for (int i : {kChaser, kTarget}) {
    if (!scene.parts[i].adapter) continue;
    const Pose<double> to_carrier = inverse(scene.parts[i].adapter->placement);
    model.interface_on_carrier[i] = to_carrier * interface_pose[i];
    if (i == kChaser) model.base_on_carrier = to_carrier * base_in_chaser;
  }
  // Without a capture body G is placed in B, fixed on the carrier (or on the immobile base).
  model.capture_in_body = scene.mechanism.capture_in_body;
  if (scene.mechanism.capture_body == kBase) {
    const Pose<double> B =
        chaser_moves ? model.base_on_carrier : fixed_pose[kChaser] * base_in_chaser;
    model.capture_in_body = B * model.capture_in_body;
  }
  make_lists(model);
  model.contact = scene.contact;
  if (!model.contact.empty()) set_law(model.contact, law);
  model.latches = scene.latches;
  model.phase_limits = scene.phase_limits;
  model.hull = scene.hull;
  model.sequence = scene.sequence;
  model.disturbances = scene.disturbances;
  model.inputs = scene.inputs;
  model.hard_dock = scene.hard_dock;
  model.forces = scene.forces;
  model.record = find_records(scene);
  model.falling =
      chaser_moves && (!scene.has_target || model.moves[kTarget]) && !model.has_record();
  model.layout = make_layout(model);
  return model;
}

bool needs_other_matrix(const DockingModel& model) {
  const bool is_on_adapter = model.mechanism.model.carrier != model.mechanism.vehicle;
  return model.layout.bristle_count > 0 || model.target || model.has_record() ||
         (is_on_adapter && model.acts_across());
}

namespace {

/// The bodies of a tree but its vehicle as one, those that are wanted.
/// @param to_chaser  turns a pose in O into one in C
template <class Wanted>
VehicleBody join_bodies(const Mechanism& mechanism, const TreeData<double>& tree,
                        const Pose<double>& to_chaser, const Wanted& wanted) {
  VehicleBody sum;
  for (int i = 0; i < static_cast<int>(tree.R.size()); ++i) {
    if (i == mechanism.vehicle || !wanted(i)) continue;
    const Body& body = mechanism.model.bodies[i];
    sum = join(sum, transform(to_chaser * Pose<double>{tree.R[i], tree.p[i]},
                              {body.mass, body.com, body.inertia}));
  }
  return sum;
}

bool is_any(int) { return true; }

}  // namespace

void lock_mechanism(const DockingModel& model, DockingData<double>& data, LockedMechanism& locked) {
  calc_leg_bodies(model.mechanism, data.mechanism);
  const TreeData<double>& tree = data.mechanism.tree;
  const MechanismModel& mechanism = model.mechanism.model;
  const FrameMotion<double>&chaser = data.vehicle[kChaser], G = find_capture_motion(model, tree);
  const Pose<double> to_chaser = inverse(Pose<double>{chaser.R, chaser.p});
  locked.q = tree.q;
  locked.capture = to_chaser * Pose<double>{G.R, G.p};
  locked.contact_bodies.clear();
  for (int body : mechanism.contact_bodies) {
    locked.contact_bodies.push_back(to_chaser * Pose<double>{tree.R[body], tree.p[body]});
  }
  locked.carrier = Pose<double>();
  if (mechanism.carrier != model.mechanism.vehicle) {
    locked.carrier = to_chaser * Pose<double>{tree.R[mechanism.carrier], tree.p[mechanism.carrier]};
  }
  locked.mechanism = join_bodies(model.mechanism, tree, to_chaser, is_any);
  locked.parts = join_bodies(model.mechanism, tree, to_chaser, [&](int i) {
    return i <= mechanism.carrier || i >= mechanism.first_part();
  });
  locked.whole =
      model.moves[kChaser] ? join(model.vehicle[kChaser], locked.mechanism) : locked.mechanism;
  data.locked = &locked;
}

VehicleBody find_stack(const DockingModel& model, DockingData<double>& data) {
  if (data.locked && data.locked->has_target) return data.locked->joined;
  const FrameMotion<double>&chaser = data.vehicle[kChaser], &target = data.vehicle[kTarget];
  const Pose<double> to_chaser = inverse(Pose<double>{chaser.R, chaser.p});
  if (!data.locked) calc_leg_bodies(model.mechanism, data.mechanism);
  const VehicleBody active =
      data.locked ? data.locked->whole
                  : join(model.vehicle[kChaser],
                         join_bodies(model.mechanism, data.mechanism.tree, to_chaser, is_any));
  const VehicleBody stack =
      join(active, transform(to_chaser * Pose<double>{target.R, target.p}, model.vehicle[kTarget]));
  if (!data.target) return stack;
  return join(stack, join_bodies(*model.target, data.target->mechanism.tree, to_chaser, is_any));
}

void join_target(const DockingModel& model, const RigidJoint& joint, LockedMechanism& locked) {
  locked.has_target = joint.on;
  if (!joint.on) return;
  locked.target_pose = {joint.R, joint.p};
  locked.target = transform(locked.target_pose, model.vehicle[kTarget]);
  locked.joined = join(locked.whole, locked.target);
}

void put_joined_target(const DockingModel& model, const LockedMechanism& locked,
                       const FrameMotion<double>& chaser, double* y) {
  const FrameMotion<double> target = find_frame_on(chaser, locked.target_pose);
  const double* q = y + model.layout.pose[kTarget] + 3;
  Vec4<double> attitude = quat_from_matrix<double>(target.R);
  if (attitude.dot(Vec4<double>(q[0], q[1], q[2], q[3])) < 0.0) attitude = -attitude;
  set_vehicle_pose(model, kTarget, target.p, attitude, y);
  const Wrench<double> momentum = find_part_momentum(locked.target, chaser);
  double *of_chaser = y + model.layout.momentum[kChaser],
         *of_target = y + model.layout.momentum[kTarget];
  for (int j = 0; j < 6; ++j) of_chaser[j] += of_target[j];
  set_momentum(model, kTarget, momentum, y);
  for (int j = 0; j < 6; ++j) of_chaser[j] -= of_target[j];
}

Status calc_mechanism_position(const DockingModel& model, const double* y,
                               DockingData<double>& data) {
  put_mechanism_state(model, y, data.mechanism.tree);
  return calc_position(model.mechanism, data.mechanism, Need::kState);
}

Status calc_parts_position(const DockingModel& model, const double* y, DockingData<double>& data) {
  return calc_target_position(model, y, *data.target);
}

void set_momentum(const DockingModel& model, int vehicle, const Wrench<double>& momentum,
                  double* y) {
  put<double>(y + model.layout.momentum[vehicle], momentum.f);
  put<double>(y + model.layout.momentum[vehicle] + 3, momentum.t);
}

void set_vehicle_pose(const DockingModel& model, int vehicle, const Vec3<double>& position,
                      const Vec4<double>& attitude, double* y) {
  double* at = y + model.layout.pose[vehicle];
  const double norm = attitude.norm();
  for (int j = 0; j < 3; ++j) at[j] = position[j];
  for (int j = 0; j < 4; ++j) at[3 + j] = attitude[j] / norm;
}

Status set_vehicle_velocity(const DockingModel& model, int vehicle, const Vec3<double>& velocity,
                            const Vec3<double>& angular_velocity, double* y,
                            DockingData<double>& data) {
  if (model.layout.pose[vehicle] < 0) return {};
  FrameMotion<double> frame = get_vehicle_pose(model, vehicle, y);
  if (vehicle == kTarget) {
    data.vehicle[kTarget] = frame;
    data.vehicle[kTarget].v = velocity;
    data.vehicle[kTarget].w = frame.R * angular_velocity;
    if (model.target) {
      MechanismData<double>& target = data.target->mechanism;
      const Status status = calc_target_position(model, y, *data.target);
      if (!status.ok()) return status;
      target.tree.v.head<3>() = frame.R.transpose() * velocity;
      target.tree.v.segment<3>(3) = angular_velocity;
      calc_velocity(*model.target, data.base, target);
    }
  } else {
    const Status status = calc_mechanism_position(model, y, data);
    if (!status.ok()) return status;
    data.mechanism.tree.v.head<3>() = frame.R.transpose() * velocity;
    data.mechanism.tree.v.segment<3>(3) = angular_velocity;
    calc_velocity(model.mechanism, data.base, data.mechanism);
  }
  set_momentum(model, vehicle, find_momentum(model, vehicle, data), y);
  return {};
}

}  // namespace dockloop
