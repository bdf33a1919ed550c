// Coupling with a host that integrates a vehicle by itself (sim/coupling.hpp), and its parts.
// 1. a rigid body turns as the closed form of the symmetric top says;
// 2. delivered impulse and mean load are inverse to each other;
// 3. a jump of the base: joints keep their momenta, a capture body in contact keeps its pose;
// 4. with the right mass a host gives the run in which nothing is driven, in both orders of
//    exchange, with the mass of the mechanism included or not, with one vehicle driven or both;
// 5. momentum of hosts, inside and of the impulse balance adds up, with a wrong mass and changing
// steps too;
// 6. steps of a driven scene allocate nothing, looking ahead or not.
// 7. the filter of ten numbers finds a body from its momenta, and allocates nothing.
// Through the FMU, against many step sizes and other schemes: tests/test_coupling.py.
#include "sim/coupling.hpp"

#include <gtest/gtest.h>

#include "docking/base_jump.hpp"
#include "math/rigid_body.hpp"
#include "unit/allocations.hpp"
#include "unit/minimal_scene.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

TEST(RigidBody, turns_like_the_symmetric_top) {
  // Free top: in body axes the rate precesses about x with (Ix - It)/It wx.
  const double Ix = 3.0, It = 2.0, wx = 0.4;
  const Mat3<double> I = V(Ix, It, It).asDiagonal();
  Vec4<double> q(1, 0, 0, 0);
  V w(wx, 0.3, 0.0);
  const V momentum = I * w;
  const double h = 7.0, angle = (Ix - It) / It * wx * h;
  turn_rigid_body(I, V::Zero(), h, 7000, q, w);
  EXPECT_LE((w - V(wx, 0.3 * std::cos(angle), 0.3 * std::sin(angle))).norm(), 1e-13);
  EXPECT_LE((quat_to_matrix<double>(q) * V(I * w) - momentum).norm(), 1e-13);
}

TEST(MeanLoad, delivers_the_impulse_that_it_was_made_for) {
  TestRandom random(51);
  Residual worst;
  for (int i = 0; i < 50; ++i) {
    VehicleState a, b;
    a.x = random.vector(10.0);
    a.v = random.vector(0.1);
    a.q = quat_exp<double>(random.vector(1.0));
    a.w = random.vector(0.05);
    const double h = 0.1;
    b = a;
    b.x += h * a.v + random.vector(1e-4);
    b.v += random.vector(1e-2);
    b.w += random.vector(1e-3);
    b.q = quat_multiply<double>(a.q, quat_exp<double>(V(h * a.w)));
    const Wrench<double> impulse{random.vector(100.0), random.vector(100.0)};
    const Wrench<double> again = find_delivered_impulse(find_mean_load(impulse, a, b, h), a, b, h);
    worst.add((again.f - impulse.f).norm() + (again.t - impulse.t).norm());
  }
  EXPECT_RESIDUAL_BELOW(worst, 2e-12);  // measured 2e-13 [N s, N m s]
}

/// The ring scene on a driven chaser, at the state after some steps of a run.
struct RingOnChaser {
  RingOnChaser()
      : scene(make()),
        model(make_docking_model(scene, scene.vehicle, scene.contact.law, V::Zero())),
        data(model),
        work(model),
        y(static_cast<size_t>(model.layout.size), 0.0) {
    const MechanismModel& m = model.mechanism.model;
    int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
    TestRandom random(7);
    for (int i : model.mechanism_bodies) {
      const Body& body = m.bodies[i];
      for (int j = 0; j < body.nq(); ++j) y[static_cast<size_t>(q++)] = m.home_q[body.q_index + j];
      for (int j = 0; j < body.nv(); ++j) y[static_cast<size_t>(v++)] = random.vector(0.05).x();
    }
    for (int i : {kChaser, kTarget}) {
      set_vehicle_pose(model, i, scene.vehicle[i].position, scene.vehicle[i].attitude, y.data());
      EXPECT_TRUE(
          set_vehicle_velocity(model, i, V(0.1, 0.01, -0.02), V(0.01, -0.02, 0.03), y.data(), data)
              .ok());
    }
    loads.command.setZero(static_cast<int>(m.forces.size()));
  }
  static Scene make() {
    Scene scene = short_ring_scene();
    scene.motion[kChaser] = Motion::kDriven;
    return scene;
  }
  void evaluate() {
    ASSERT_TRUE(calc_docking<double>(model, DiscreteState(), ContactMemory(), loads, 0.0, y.data(),
                                     nullptr, data)
                    .ok());
  }
  /// Momenta that belong to the joints of the mechanism.
  VecX<double> find_joint_momenta() {
    const std::vector<int>& ind = model.mechanism.plan.ind_v;
    const int n = static_cast<int>(ind.size());
    VecX<double> v(n);
    for (int j = 0; j < n; ++j) v[j] = data.mechanism.tree.v[ind[static_cast<size_t>(j)]];
    return (data.mechanism.A_ind * v).tail(n - 6);
  }
  Scene scene;
  DockingModel model;
  DockingData<double> data;
  BaseJumpWorkspace work;
  std::vector<double> y;
  Loads loads;
};

TEST(BaseJump, leaves_the_momenta_of_free_joints_alone) {
  RingOnChaser at;
  at.evaluate();
  const VecX<double> before = at.find_joint_momenta();
  const FrameMotion<double> motion = at.data.vehicle[kChaser];
  Wrench<double> wanted = find_momentum(at.model, kChaser, at.data);
  wanted.f += V(250.0, -500.0, 120.0);
  wanted.t += V(100.0, 200.0, -100.0);
  ASSERT_TRUE(
      jump_to_momentum(at.model, kChaser, motion, wanted, at.y.data(), at.data, at.work).ok());
  at.evaluate();
  EXPECT_GT((at.data.vehicle[kChaser].v - motion.v).norm(), 0.01);
  const Wrench<double> now = find_momentum(at.model, kChaser, at.data);
  EXPECT_LE((now.f - wanted.f).norm() / wanted.f.norm(), 1e-14);
  EXPECT_LE((now.t - wanted.t).norm() / wanted.t.norm(), 1e-13);
  const VecX<double> after = at.find_joint_momenta();
  ASSERT_GT(before.norm(), 0.1);
  EXPECT_LE((after - before).norm() / before.norm(), 1e-11);
}

TEST(BaseJump, of_nothing_changes_nothing) {
  RingOnChaser at;
  at.evaluate();
  const std::vector<double> before = at.y;
  const Wrench<double> momentum = find_momentum(at.model, kChaser, at.data);
  ASSERT_TRUE(jump_to_momentum(at.model, kChaser, at.data.vehicle[kChaser], momentum, at.y.data(),
                               at.data, at.work)
                  .ok());
  Residual worst;
  for (size_t i = 0; i < before.size(); ++i) {
    worst.add((at.y[i] - before[i]) / (1.0 + std::abs(before[i])), std::to_string(i));
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-13);
}

TEST(BaseJump, holds_a_capture_body_in_its_pose) {
  RingOnChaser at;
  at.evaluate();
  const Pose<double> capture{at.data.capture.R, at.data.capture.p};
  for (const double size : {1e-3, 1e-4}) {
    RingOnChaser moved;
    const VehicleParameters& p = moved.scene.vehicle[kChaser];
    const V position = p.position + size * V(1.0, -0.5, 0.3);
    const Vec4<double> attitude =
        quat_multiply<double>(p.attitude, quat_exp<double>(V(size * V(0.2, -0.1, 0.15))));
    set_vehicle_pose(moved.model, kChaser, position, attitude, moved.y.data());
    ASSERT_TRUE(
        hold_capture_body(moved.model, capture, moved.y.data(), moved.data, moved.work).ok());
    const FrameMotion<double> chaser = at.data.vehicle[kChaser];
    ASSERT_TRUE(set_vehicle_velocity(moved.model, kChaser, chaser.v,
                                     chaser.R.transpose() * chaser.w, moved.y.data(), moved.data)
                    .ok());
    moved.evaluate();
    // First order in the change: what is left is of second order.
    EXPECT_LE((moved.data.capture.p - capture.p).norm(), 2.0 * size * size) << size;
    EXPECT_LE((moved.data.capture.R - capture.R).norm(), 2.0 * size * size) << size;
    EXPECT_GT((moved.data.vehicle[kChaser].p - at.data.vehicle[kChaser].p).norm(), size);
  }
}

/// Vehicles of a host next to a simulation in which they are driven.
struct Host {
  Host(const Scene& scene, int mode, double reported_mass = 1.0) : sim(share(scene)) {
    sim.parameters().coupling_mode = mode;
    for (int i : {kChaser, kTarget}) {
      if (scene.motion[i] != Motion::kDriven) continue;
      const VehicleParameters& p = scene.vehicle[i];
      driven[i] = true;
      mass[i] = p.mass;
      inertia[i] = make_symmetric(p.inertia);
      state[i] = {p.position, p.velocity, p.attitude, p.angular_velocity};
      sim.parameters().vehicle[i].mass *= reported_mass;
      sim.parameters().vehicle[i].inertia *= reported_mass;
    }
    sim.initialise(0.0, 0.0);
    is_parallel = mode == kParallel;
  }
  void tell() {
    for (int i : {kChaser, kTarget}) {
      if (!driven[i]) continue;
      Inputs::Vehicle& in = sim.inputs().vehicle[i];
      in.position = state[i].x;
      in.velocity = state[i].v;
      in.attitude = state[i].q;
      in.angular_velocity = state[i].w;
    }
    sim.invalidate_outputs();
  }
  void step(double h) {
    tell();
    const std::array<Outputs::Vehicle, 2> announced = sim.outputs().vehicle;
    const Status status = sim.step(t, h);
    ASSERT_TRUE(status.ok()) << sim.status_text();
    t += h;
    const std::array<Outputs::Vehicle, 2>& made = sim.outputs().vehicle;
    for (int i : {kChaser, kTarget}) {
      if (!driven[i]) continue;
      const Outputs::Vehicle& load = is_parallel ? announced[i] : made[i];
      VehicleState& s = state[i];
      s.x += h * s.v + 0.5 * h * h / mass[i] * load.force_mean;
      s.v += h / mass[i] * load.force_mean;
      turn_rigid_body(inertia[i], load.torque_mean, h, 20, s.q, s.w);
    }
  }
  /// Hosts, inside and impulse balance, about the origin of N. @pre report
  Vec6<double> find_momentum() {
    const Outputs& out = sim.outputs();
    Wrench<double> sum{
        out.momentum_linear + out.coupling_pending_impulse,
        out.momentum_angular + out.coupling_pending_angular_impulse +
            out.momentum_reference.cross(V(out.momentum_linear + out.coupling_pending_impulse))};
    for (int i : {kChaser, kTarget}) {
      if (!driven[i]) continue;
      const Wrench<double> p = find_rigid_momentum({mass[i], V::Zero(), inertia[i]}, state[i]);
      sum.f += p.f;
      sum.t += p.t;
    }
    Vec6<double> all;
    all << sum.f, sum.t;
    return all;
  }
  DockingSim sim;
  double t = 0.0;
  bool is_parallel = false;
  std::array<bool, 2> driven{false, false};
  std::array<double, 2> mass{0.0, 0.0};
  std::array<Mat3<double>, 2> inertia;
  std::array<VehicleState, 2> state;
};

Scene make_accurate(Scene scene) {
  scene.solver.rtol = 1e-9;
  scene.solver.atol_position = scene.solver.atol_velocity = 1e-11;
  return scene;
}

TEST(Coupling, with_the_right_mass_gives_the_run_in_which_nothing_is_driven) {
  for (const auto& [includes, level] :
       {std::pair{1, kReduced}, {2, kReduced}, {1, kMasslessLegs}, {1, kRigid}, {2, kRigid}}) {
    Scene scene = make_accurate(short_ring_scene());
    scene.vehicle[kChaser].mass_includes_mechanism = includes;
    scene.level = level;
    // Without legs that give, contact is hard: errors of the integration grow with every impact.
    if (level == kRigid) scene.vehicle[kChaser].mass = 15e3;
    const double limit = scaled_tolerance(level == kRigid ? 1e-5 : 3e-9);
    const double h = 0.05;
    DockingSim free(share(scene));
    free.initialise(0.0, 0.0);
    std::vector<V> velocity;
    for (int i = 0; i < 24; ++i) {
      ASSERT_TRUE(free.step(h * i, h).ok());
      velocity.push_back(free.outputs().relative_velocity);
    }
    const double peak = free.outputs().capture_peak[Outputs::kCompression].value;
    EXPECT_GT(peak, 100.0);
    for (const int mode : {kSequential, kParallel}) {
      for (const std::array<bool, 2> who :
           {std::array<bool, 2>{true, false}, {false, true}, {true, true}}) {
        Scene driven = scene;
        for (int i : {kChaser, kTarget}) {
          if (who[static_cast<size_t>(i)]) driven.motion[i] = Motion::kDriven;
        }
        driven.experiment.step = h;
        Host host(driven, mode);
        Residual worst;
        for (size_t i = 0; i < velocity.size(); ++i) {
          host.step(h);
          worst.add((host.sim.outputs().relative_velocity - velocity[i]).norm() / 0.1,
                    "step " + std::to_string(i));
        }
        const std::string which = std::to_string(mode) + std::to_string(who[0]) +
                                  std::to_string(who[1]) + ", mass " + std::to_string(includes) +
                                  ", level " + std::to_string(level);
        EXPECT_LE(worst.value, limit)  // measured 3e-10 of the closing speed, rigid 9e-7
            << which << " at " << worst.where;
        EXPECT_LE(
            std::abs(host.sim.outputs().capture_peak[Outputs::kCompression].value / peak - 1.0),
            level == kRigid ? 1e-4 : 1e-6)
            << which;
        for (const std::string& warning : host.sim.take_warnings()) {
          // Without legs that give, loads are above the rated ones, as they are without a host.
          if (warning.rfind("limit 'load'", 0) != 0) ADD_FAILURE() << warning;
        }
      }
    }
  }
}

TEST(Coupling, balances_momentum_with_a_wrong_mass_and_changing_steps) {
  Scene scene = short_ring_scene();
  scene.motion[kChaser] = Motion::kDriven;
  for (const int mode : {kSequential, kParallel}) {
    for (const double reported : {0.5, 1.0, 1.5}) {
      Host host(scene, mode, reported);
      host.tell();
      const Vec6<double> before = host.find_momentum();
      Residual linear, angular;
      for (int i = 0; i < 60; ++i) {
        host.step(0.004 * (1 + i % 5));
        host.tell();
        const Vec6<double> change = host.find_momentum() - before;
        linear.add(change.head<3>().norm() / 2500.0, "step " + std::to_string(i));
        angular.add(change.tail<3>().norm() / 1e4, "step " + std::to_string(i));
      }
      EXPECT_GT(host.sim.outputs().capture_peak[Outputs::kCompression].value, 100.0);
      EXPECT_LE(linear.value, 1e-13) << mode << " " << reported << " at " << linear.where;
      EXPECT_LE(angular.value, 1e-12) << mode << " " << reported << " at " << angular.where;
    }
  }
}

TEST(Coupling, finds_out_the_mass_that_a_host_really_has) {
  Scene scene = short_ring_scene();
  scene.motion[kChaser] = Motion::kDriven;
  for (const int mode : {kSequential, kParallel}) {
    Host host(scene, mode, 0.8);
    for (int i = 0; i < 80; ++i) host.step(0.01);
    ASSERT_TRUE(host.sim.update(OutputGroup::kCoupling).ok());
    EXPECT_NEAR(host.sim.outputs().coupling_mass_mismatch, 0.25, 1e-6);
    bool reported = false;
    for (const std::string& text : host.sim.take_warnings()) {
      reported = reported || text.find("as if its mass were 25000 kg") != std::string::npos;
    }
    EXPECT_TRUE(reported);
  }
}

// The damper of an absorber pushes from the first moment on. Whether surfaces that touch are a
// rounding error apart or into each other must not decide when: at the start, or as a host reports
// it.
TEST(Coupling, of_an_absorber_that_touches_does_not_hang_on_rounding) {
  Scene scene = minimal_scene();
  scene.motion[kTarget] = Motion::kDriven;
  scene.vehicle[kChaser].interface_position.x() = 4.1;
  scene.vehicle[kTarget].interface_position.x() = -15.3;
  for (const double speed : {0.1, -0.1}) {
    scene.vehicle[kChaser].velocity.x() = speed;
    for (const double gap : {-1e-12, 0.0, 1e-12}) {
      for (const double reported : {-1e-12, 0.0, 1e-12}) {
        scene.vehicle[kTarget].position.x() = 19.4 + gap;
        DockingSim sim(share(scene));
        sim.initialise(0.0, 0.0);
        EXPECT_NEAR(sim.outputs().capture_force.x(), speed > 0.0 ? 1296.148 : 0.0, 1e-6) << gap;
        sim.inputs().vehicle[kTarget].position.x() = 19.4 + reported;
        ASSERT_TRUE(sim.step(0.0, 1e-3).ok());
        // 1296 N less what decays within a millisecond; nothing is pulled.
        EXPECT_NEAR(sim.outputs().capture_force.x(), speed > 0.0 ? 1297.1 : 0.0, 1.0) << reported;
        EXPECT_EQ(sim.outputs().solver_rejected_steps, 0.0) << gap << ", reported " << reported;
      }
    }
  }
}

/// Motion after a step, without an integration: momenta change by the impulse of the load.
VehicleState find_pushed(const VehicleBody& body, const VehicleState& from,
                         const Wrench<double>& load, double h) {
  VehicleState to = from;
  for (int i = 0; i < 40; ++i) {  // a contraction: the impulse depends on the end of the step
    const Wrench<double> impulse = find_delivered_impulse(load, from, to, h);
    const Wrench<double> goal = find_rigid_momentum(body, from) + impulse;
    const V centre = move_origin(to, body.com).x, v = goal.f / body.mass;
    const Mat3<double> R = quat_to_matrix<double>(to.q);
    to.w = body.inertia.inverse() * (R.transpose() * V(goal.t - centre.cross(goal.f)));
    to.v = v - R * V(to.w.cross(body.com));
    to.x = from.x + 0.5 * h * (from.v + to.v);
  }
  return to;
}

TEST(MassEstimate, finds_a_body_from_its_momenta) {
  VehicleBody stated, body;
  stated.mass = 1000.0;
  stated.inertia = V(800.0, 1200.0, 1500.0).asDiagonal();
  body = stated;
  body.mass *= 1.6;
  body.com = V(0.04, -0.07, 0.1);
  body.inertia *= 0.7;
  VehicleState at;
  at.x = V(30.0, -20.0, 10.0);
  at.v = V(0.1, -0.02, 0.05);
  at.w = V(0.01, -0.02, 0.015);
  MassEstimate estimate;
  const double h = 0.01;
  const V fall = V::Zero();
  for (int i = 0; i < 60; ++i) {
    const double s = 0.3 * i;
    const Wrench<double> load{V(50.0, 30.0 * std::sin(s), 20.0 * std::cos(s)),
                              V(20.0 * std::cos(2.0 * s), 30.0, 10.0 * std::sin(2.0 * s))};
    const VehicleState next = find_pushed(body, at, load, h);
    update_mass_estimate(stated, {at, next, load, fall, h, 0.0}, 0.98, estimate);
    at = next;
  }
  const VehicleBody found = find_estimated_body(stated, estimate);
  EXPECT_TRUE(explains_reports(estimate));
  EXPECT_TRUE(contradicts(stated, estimate, stated));
  EXPECT_NEAR(found.mass, body.mass, 1e-3 * body.mass);
  EXPECT_LE((found.com - body.com).norm(), 2e-3);
  EXPECT_LE((found.inertia - body.inertia).norm(), 1e-2 * body.inertia.norm());
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(MassEstimate, allocates_nothing) {
  VehicleBody stated;
  stated.mass = 1000.0;
  stated.inertia = V(800.0, 1200.0, 1500.0).asDiagonal();
  VehicleState from, to;
  to.v = V(0.01, 0.0, 0.0);
  const V fall = V::Zero();
  MassEstimate estimate;
  EXPECT_EQ(count_allocations([&] {
              const ReportedStep step{from, to, {V(500.0, 0.0, 0.0), V::Zero()}, fall, 0.01, 0.0};
              for (int i = 0; i < 10; ++i) update_mass_estimate(stated, step, 0.98, estimate);
              if (contradicts(stated, estimate, stated)) {
                can_be_rigid(find_estimated_body(stated, estimate));
              }
            }),
            0);
}

TEST(Coupling, allocates_nothing_in_steps) {
  for (const int mode : {kSequential, kParallel}) {
    Scene scene = short_ring_scene();
    scene.motion[kChaser] = scene.motion[kTarget] = Motion::kDriven;
    Host host(scene, mode);
    for (int i = 0; i < 3; ++i) host.step(0.01);
    ASSERT_TRUE(host.sim.update(OutputGroup::kCoupling).ok());
    const long count = count_allocations([&] {
      for (int i = 0; i < 200; ++i) {
        host.step(0.01);
        host.sim.update(OutputGroup::kCoupling);
      }
    });
    EXPECT_EQ(count, 0) << "mode " << mode;
    EXPECT_TRUE(host.sim.outputs().captured);
  }
}
#endif

}  // namespace
}  // namespace dockloop
