// A docking at a random state, with random loads: shared by the tests of rates and derivatives.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "docking/docking_model.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {

inline Scene read_test_scene(const std::string& name) {
  return read_scene(read_test_file(name), name);
}

inline Scene ring() { return read_test_scene("scene_ring.json"); }
/// Three fingers with surfaces on a palm that slides; one follows another through gears.
inline Scene fingers() { return read_test_scene("scene_fingers.json"); }
inline Scene absorber() { return read_test_scene("scene_minimal.json"); }
inline Scene ring_without_surfaces() {
  Scene scene = ring();
  scene.contact = ContactModel();
  return scene;
}

/// A docking with a random state near the docking, for whatever scene.
struct Docking {
  explicit Docking(const Scene& from, int friction_model = 1)
      : scene(from), model(make(from, friction_model)), data(model), y(model.layout.size, 0.0) {
    loads.command.setZero(static_cast<int>(model.mechanism.model.forces.size()));
    model.fixed_pose[kTarget].p = Vec3<double>(30, 0, 0);
    put_pose(kTarget, model.fixed_pose[kTarget]);  // out of the way until the ring is placed
  }
  static DockingModel make(const Scene& scene, int friction_model) {
    ContactLaw law = scene.contact.law;
    law.friction_model = friction_model;
    return make_docking_model(scene, scene.vehicle, law, Vec3<double>(-15, 0, 0));
  }

  /// @param depth of the surfaces [m]; below 0 they are apart
  /// @param lateral, tilt  bounds of the offsets of P from G [m], [rad]
  void set_random_state(TestRandom& random, double depth, double lateral = 0.2,
                        double tilt = 0.12) {
    using V = Vec3<double>;
    int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
    for (int i : model.mechanism_bodies) {
      const Body& body = model.mechanism.model.bodies[i];
      if (body.joint == JointType::kFree) {
        const V p = random.vector(0.03);
        const Vec4<double> quat = quat_exp<double>(random.vector(0.05));
        for (int j = 0; j < 3; ++j) y[q + j] = p[j];
        for (int j = 0; j < 4; ++j) y[q + 3 + j] = quat[j];
      } else {
        y[q] = model.mechanism.model.home_q[body.q_index] + random.uniform(-0.03, 0.03);
      }
      for (int j = 0; j < body.nv(); ++j) y[v + j] = random.uniform(-0.03, 0.03);
      q += body.nq();
      v += body.nv();
    }
    for (int i : {kChaser, kTarget}) {
      if (model.layout.pose[i] < 0) continue;
      velocity[i] = random.vector(0.03);
      rate[i] = random.vector(0.003);
    }
    put_pose(kChaser, {rotation_of(random.vector(0.3)), V(-4, 0, 0) + random.vector(0.3)});
    ASSERT_TRUE(
        set_vehicle_velocity(model, kChaser, velocity[kChaser], rate[kChaser], y.data(), data)
            .ok());
    evaluate();  // where is G?
    if (model.present[kTarget]) {
      Pose<double> P_in_G;
      if (model.contact.has_surfaces()) {
        ContactWorkspace<double> work(model.contact);
        const Pose<double> G{data.capture.R, data.capture.p};
        std::vector<Pose<double>> others;
        for (const FrameMotion<double>& body : data.contact_bodies) {
          others.push_back(inverse(G) * Pose<double>{body.R, body.p});
        }
        const RelativeMotion<double> x =
            make_touching_motion(model.contact, work, random, depth, lateral, tilt, others);
        P_in_G = {x.R, x.p};
      } else {
        P_in_G = {rotation_of(random.vector(std::min(tilt, 0.1))), V(-depth, 0.02, 0.01)};
      }
      put_pose(kTarget, Pose<double>{data.capture.R, data.capture.p} * P_in_G *
                            inverse(model.interface_pose[kTarget]));
      ASSERT_TRUE(
          set_vehicle_velocity(model, kTarget, velocity[kTarget], rate[kTarget], y.data(), data)
              .ok());
    }
    for (int j = 0; j < model.layout.bristle_count; ++j) {
      y[model.layout.bristles + j] = 0.0;
    }
  }
  void set_random_loads(TestRandom& random) {
    for (int i : {kChaser, kTarget}) {
      loads.force[i] = random.vector(100.0);
      loads.torque[i] = random.vector(50.0);
    }
    for (int j = 0; j < loads.command.size(); ++j) loads.command[j] = random.uniform(-30, 30);
    loads.gravity = random.vector(0.5);
    discrete.thrust_on = true;
    model.thrust = 120.0;
  }

  /// All loops by Newton iteration from here on.
  void close_by_newton() {
    Mechanism newton(model.mechanism.model, true);
    newton.vehicle = model.mechanism.vehicle;
    set_mechanism(model, newton);
    data = DockingData<double>(model);
  }

  void put_pose(int i, const Pose<double>& pose) {
    const int at = model.layout.pose[i];
    if (at < 0) {
      if (i == kTarget) model.fixed_pose[i] = pose;
      return;
    }
    const Vec4<double> quat = quat_from_matrix<double>(pose.R);
    for (int j = 0; j < 3; ++j) y[at + j] = pose.p[j];
    for (int j = 0; j < 4; ++j) y[at + 3 + j] = quat[j];
  }
  Status try_evaluate() {
    ydot.assign(y.size(), 0.0);
    return calc_docking<double>(model, discrete, memory, loads, t, y.data(), ydot.data(), data);
  }
  void evaluate() { ASSERT_TRUE(try_evaluate().ok()); }
  Vec3<double> rate3(int at) const { return {ydot[at], ydot[at + 1], ydot[at + 2]}; }

  Scene scene;
  DockingModel model;
  DockingData<double> data;
  std::vector<double> y, ydot;
  DiscreteState discrete;
  ContactMemory memory;
  Loads loads;
  double t = 0.0;
  std::array<Vec3<double>, 2> velocity{Vec3<double>::Zero(), Vec3<double>::Zero()};
  std::array<Vec3<double>, 2> rate{Vec3<double>::Zero(), Vec3<double>::Zero()};
};

/// The ring without surfaces, and hooks on faces between A and P.
inline Scene ring_with_hooks() {
  Scene scene = ring_without_surfaces();
  HardDock& dock = scene.hard_dock;
  dock.faces = {make_circle(24, 0.65, 0.0), 1e8, 1.0, 1e-5};
  dock.hooks.rows = {{make_circle(6, 0.7, 0.1), 0.0}, {make_circle(6, 0.7, 0.6), 0.0}};
  dock.hooks.stiffness = 1e6;
  dock.hooks.preload = 2000.0;
  dock.hooks.damping = 1.0;
  dock.hooks.play = 0.003;
  dock.hooks.close_time = 5.0;
  dock.pushers.points = make_circle(4, 0.6, 0.3);
  dock.pushers.stroke = 0.03;
  dock.pushers.preload = 200.0;
  dock.pushers.stiffness = 4e3;
  return scene;
}

/// A spring, a taut tether, magnets and a table between the vehicles.
inline Scene ring_with_forces() {
  using V = Vec3<double>;
  Scene scene = ring_without_surfaces();
  for (Latch& latch : scene.latches.latch) latch.law.push_force = 0.0;
  VehicleForce force;
  force.chaser_point = V(0.1, 0.2, -0.1);
  force.target_point = V(0.2, -0.1, 0.3);
  force.stiffness = 3e3;
  force.damping = 200.0;
  force.free_length = 0.2;
  force.toe = 0.05;
  force.size = 0.1;
  force.chaser_moment = V(3e3, 500.0, -200.0);
  force.target_moment = V(2e3, -700.0, 900.0);
  force.table = make_force_table({-3.0, 0.0, 3.0}, {0.0, 0.5, 1.0},
                                 {{-90.0, -50.0, 0.0}, {-70.0, -45.0, 0.0}, {-9.0, -3.0, 0.0}});
  using Kind = VehicleForce::Kind;
  for (const Kind kind : {Kind::kSpring, Kind::kTether, Kind::kDipoles, Kind::kTable}) {
    force.kind = kind;
    scene.forces.push_back(force);
  }
  return scene;
}

/// Faces pressed, one row of hooks closed, the other one in the middle of a ramp at t = 7.02 s.
inline void dock(Docking& docking, TestRandom& random) {
  using V = Vec3<double>;
  const FrameMotion<double>& A = docking.data.interface[kChaser];
  const V p(random.uniform(-3e-4, -1e-4), random.uniform(-0.01, 0.01), random.uniform(-0.01, 0.01));
  docking.put_pose(kTarget, Pose<double>{A.R, A.p} *
                                Pose<double>{rotation_of(random.vector(1e-4)), p} *
                                inverse(docking.model.interface_pose[kTarget]));
  ASSERT_TRUE(set_vehicle_velocity(docking.model, kTarget, docking.velocity[kTarget],
                                   docking.rate[kTarget], docking.y.data(), docking.data)
                  .ok());
  docking.t = 7.02;
  docking.discrete.hard_dock.row[0] = {HookMode::kClosed, 0.0, 0.0};
  docking.discrete.hard_dock.row[1] = {HookMode::kClosing, 3.2, 0.0};
  docking.discrete.hard_dock.pushers = {false, 7.0, 1.0};
}

/// A rigid joint in the present pose; the mechanism rests.
inline void join(Docking& docking, LockedMechanism& locked) {
  std::fill_n(docking.y.begin() + docking.model.layout.mechanism_v,
              docking.model.layout.mechanism_nv, 0.0);
  docking.evaluate();
  lock_mechanism(docking.model, docking.data, locked);
  const FrameMotion<double>&C = docking.data.vehicle[kChaser], &D = docking.data.vehicle[kTarget];
  docking.discrete.hard_dock.joint = {true, C.R.transpose() * D.R, C.R.transpose() * (D.p - C.p)};
  join_target(docking.model, docking.discrete.hard_dock.joint, locked);
}

/// Is a pair of this kind closed?
inline bool touches(const Docking& docking, PairKind kind) {
  const ContactModel& contact = docking.model.contact;
  for (int i = 0; i < contact.pair_count(); ++i) {
    if (contact.pairs[i].kind == kind && docking.data.contact_work.closed[i]) return true;
  }
  return false;
}

/// The first docking that can be evaluated, and touches as it should.
/// @param touching  kind of a pair that takes part, or none
template <class Make>
Docking draw_docking(const std::optional<PairKind>& touching, const Make& make) {
  for (int draws = 0; draws < 300; ++draws) {
    Docking docking = make();
    if (!docking.try_evaluate().ok()) continue;  // where two cores meet
    if (!touching || touches(docking, *touching)) return docking;
  }
  throw ModelError("no random state touches as it should");
}

template <class S>
ExternalLoads<S> cast_loads(const Loads& loads) {
  ExternalLoads<S> cast;
  for (int i : {kChaser, kTarget}) {
    cast.force[i] = loads.force[i].cast<S>();
    cast.torque[i] = loads.torque[i].cast<S>();
  }
  cast.gravity = loads.gravity.cast<S>();
  cast.command = loads.command.cast<S>();
  return cast;
}

}  // namespace dockloop
