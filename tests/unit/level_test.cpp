// Levels of the model (model.level): what is left out, and that nothing else is.
// 1. rigid: the docking of one body with the stated mass; at any pose momentum, energy, load on the
//    base and acceleration are those of the tree whose joints are held; what moves is refused;
// 2. massless_legs: mass and first moment stay where they were; leaving out what is massless gives
//    what the general equations give; legs that are really light tend to it;
// 3. energy and momentum add up at every level, and steps allocate nothing;
// 4. what does not fit together, or cannot be, is refused with the reason.
//
// Scene: idss_25t_350t. Saved states of every level: saved_state_test.cpp, hosts:
// coupling_test.cpp.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "docking/docking_jacobian.hpp"
#include "mechanism/massless_legs.hpp"
#include "unit/allocations.hpp"
#include "unit/random_docking.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

/// A light chaser: locked, it can meet the target without a ring that gives.
Scene light_scene(int level) {
  Scene scene = ring_scene();
  scene.vehicle[kChaser].mass = 600.0;
  scene.vehicle[kChaser].inertia << 400.0, 2500.0, 2600.0, 10.0, -5.0, 3.0;
  scene.conditions.approach_time = 0.1;
  scene.vehicle = find_placement(scene).vehicle;
  scene.level = level;
  return scene;
}

/// Difference of loads relative to the larger one.
double find_difference(const Wrench<double>& a, const Wrench<double>& b) {
  return std::max((a.f - b.f).norm() / (1.0 + b.f.norm()), (a.t - b.t).norm() / (1.0 + b.t.norm()));
}

// ---------------------------------------------------------------- rigid

TEST(RigidLevel, is_the_docking_of_one_body_with_the_stated_mass) {
  Scene scene = light_scene(kRigid);
  scene.vehicle[kChaser].mass_includes_mechanism = 2;
  // Tight: tolerances of angular momenta follow the lever of A, which differs, and so do the steps.
  scene.solver = {1e-12, 1e-14, 1e-14, 1e-12, 1e-3};
  const Vec3<double> home(0.28, 0.0, 0.0);  // of the ring, from A
  Scene bare = scene;  // without a mechanism G is A: A stands where the ring is
  bare.vehicle[kChaser].interface_position += home;
  bare.mechanism = MechanismModel();
  bare.level = kReduced;
  DockingSim locked(share(scene)), one_body(share(bare));
  for (DockingSim* sim : {&locked, &one_body}) sim->initialise(0.0, 0.0);
  Residual worst;
  for (int i = 0; i < 60; ++i) {
    ASSERT_TRUE(locked.step(0.01 * i, 0.01).ok()) << locked.status_text();
    ASSERT_TRUE(one_body.step(0.01 * i, 0.01).ok()) << one_body.status_text();
    const Outputs &a = locked.outputs(), &b = one_body.outputs();
    const std::string where = "step " + std::to_string(i);
    for (int k : {kChaser, kTarget}) {
      worst.add((a.vehicle[k].position - b.vehicle[k].position).norm(), where);
      worst.add((a.vehicle[k].attitude - b.vehicle[k].attitude).norm(), where);
      worst.add((a.vehicle[k].force - b.vehicle[k].force).norm() / 1e4, where);
      worst.add((a.vehicle[k].torque - b.vehicle[k].torque).norm() / 1e4, where);
    }
    worst.add((a.ring_position - home - b.ring_position).norm(), where);
    worst.add(std::abs(a.energy_kinetic - b.energy_kinetic), where);
  }
  std::printf("rigid: peak %.6g N, difference from one body %.2g\n",
              locked.outputs().capture_peak[Outputs::kCompression].value, worst.value);
  EXPECT_GT(locked.outputs().capture_peak[Outputs::kCompression].value, 100.0) << "nothing touched";
  EXPECT_LE(worst.value, 1e-7) << worst.where;
}

TEST(RigidLevel, is_the_tree_with_held_joints_at_any_pose) {
  TestRandom random(61);
  Residual motion, load, held;
  for (const Motion chaser : {Motion::kFree, Motion::kFixed}) {
    for (int n = 0; n < 20; ++n) {
      Scene scene = read_test_scene("scene_ring.json");
      scene.motion[kChaser] = chaser;
      Docking tree(scene);
      tree.model.falling = false;
      tree.set_random_state(random, 0.002);
      tree.set_random_loads(random);
      for (int j = 0; j < tree.model.layout.mechanism_nv; ++j) {
        tree.y[tree.model.layout.mechanism_v + j] = 0.0;
      }
      ASSERT_TRUE(set_vehicle_velocity(tree.model, kChaser, tree.velocity[kChaser],
                                       tree.rate[kChaser], tree.y.data(), tree.data)
                      .ok());
      tree.evaluate();
      const DockingModel& model = tree.model;
      LockedMechanism locked;
      lock_mechanism(model, tree.data, locked);
      tree.data.locked = nullptr;
      DockingData<double> data(model);
      data.locked = &locked;
      std::vector<double> ydot(tree.y.size(), 1.0);
      ASSERT_TRUE(calc_docking<double>(model, tree.discrete, tree.memory, tree.loads, 0.0,
                                       tree.y.data(), ydot.data(), data)
                      .ok());
      calc_docking_reactions(model, data);
      const std::string where = "state " + std::to_string(n);
      motion.add((data.capture.p - tree.data.capture.p).norm(), where);
      motion.add((data.capture.v - tree.data.capture.v).norm(), where);
      motion.add((data.capture.w - tree.data.capture.w).norm(), where);
      motion.add(find_difference(find_momentum(model, kChaser, data),
                                 find_momentum(tree.model, kChaser, tree.data)),
                 where);
      const double energy = find_kinetic_energy(tree.model, tree.data);
      motion.add(std::abs(find_kinetic_energy(model, data) / energy - 1.0), where);
      for (int j = 0; j < model.layout.mechanism_nq + model.layout.mechanism_nv; ++j) {
        EXPECT_EQ(ydot[j], 0.0) << "rate " << j << " of the mechanism";
      }
      // Inverse dynamics of the tree with the acceleration of the locked chaser, joints at rest.
      MechanismData<double>& all = tree.data.mechanism;
      const int vehicle = model.mechanism.vehicle;
      all.vdot.setZero();
      if (vehicle != kBase) {
        const Mat3<double> R = all.tree.R[vehicle].transpose();
        const V w = all.tree.w[vehicle], u = all.tree.u[vehicle];
        all.vdot.head<3>() = R * (data.mechanism.tree.a[vehicle] + tree.loads.gravity - w.cross(u));
        all.vdot.segment<3>(3) = R * data.mechanism.tree.alpha[vehicle];
      }
      calc_reactions(tree.model.mechanism, tree.data.base, vehicle, all);
      load.add(find_difference(data.mechanism.on_base, all.on_base), where);
      if (vehicle != kBase) held.add(all.tree.tau_required.head<6>().norm() / 1e3, where);
    }
  }
  std::printf("rigid: motion %.1g, load on the base %.1g, force left over %.1g\n", motion.value,
              load.value, held.value);
  EXPECT_RESIDUAL_BELOW(motion, 1e-14);  // measured 9e-16
  EXPECT_RESIDUAL_BELOW(load, 3e-12);    // measured 3e-13
  EXPECT_RESIDUAL_BELOW(held, 4e-11);    // measured 4e-12 [kN], of 12 kN
}

TEST(RigidLevel, keeps_the_pose_of_the_start_and_refuses_one_that_moves) {
  Scene scene = light_scene(kRigid);
  scene.capture_body_start.displacement = V(-0.02, 0.01, 0.0);
  DockingSim sim(share(scene));
  sim.initialise(0.0, 0.0);
  const V start = sim.outputs().ring_position;
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok()) << sim.status_text();
  const Outputs& out = sim.outputs();
  EXPECT_LE((out.ring_position - start).norm(), 1e-15);
  EXPECT_LE(out.ring_velocity.norm(), 1e-14);
  EXPECT_GT(std::abs(out.leg_force[0]), 1.0) << "what the spring would exert";
  EXPECT_EQ(out.energy_dissipated_legs, 0.0);
  EXPECT_LE(std::abs(out.energy_residual), 1e-5);
  EXPECT_LE(out.momentum_residual, 1e-13);

  scene.capture_body_start.velocity = V(0.0, 0.0, 0.01);
  const std::string refused = find_refusal([&] { DockingSim(share(scene)).initialise(0.0, 0.0); });
  EXPECT_NE(refused.find("model.level is 1 (rigid), but the joint of body 'ring'"),
            std::string::npos)
      << refused;
}

TEST(RigidLevel, has_the_derivatives_of_its_rates) {
  TestRandom random(64);
  Docking docking(read_test_scene("scene_ring.json"));
  docking.set_random_state(random, 0.002);
  docking.set_random_loads(random);
  docking.evaluate();
  const DockingModel& model = docking.model;
  LockedMechanism locked;
  lock_mechanism(model, docking.data, locked);
  docking.evaluate();
  const int size = model.layout.size;
  DockingPass pass(model);
  MatX<double> J(size, size);
  ASSERT_TRUE(calc_docking_jacobian(model, docking.discrete, docking.memory, docking.data,
                                    docking.loads, 0.0, docking.y.data(), pass, J)
                  .ok());
  Residual worst;
  const std::vector<double> y = docking.y;
  for (int n = 0; n < 10; ++n) {
    // Steps of 1e-7 m, and of momenta to match.
    VecX<double> way(size), rates[2];
    for (int j = 0; j < size; ++j) way[j] = 1e-7 * random.uniform(-1.0, 1.0);
    for (int k : {0, 1}) {
      for (int j = 0; j < size; ++j) docking.y[j] = y[j] + (k == 0 ? -way[j] : way[j]);
      docking.evaluate();
      rates[k] = Eigen::Map<const VecX<double>>(docking.ydot.data(), size);
    }
    const VecX<double> difference = 0.5 * (rates[1] - rates[0]), expected = J * way;
    worst.add((difference - expected).norm() / expected.norm(), "direction " + std::to_string(n));
  }
  std::printf("rigid: derivatives off by %.1g\n", worst.value);
  EXPECT_RESIDUAL_BELOW(worst, 1e-6);
  EXPECT_EQ(J.leftCols(model.layout.mechanism_nq + model.layout.mechanism_nv).norm(), 0.0);
}

// ---------------------------------------------------------------- massless legs

TEST(MasslessLegsLevel, keeps_mass_and_first_moment) {
  const Scene scene = ring_scene();
  const MasslessLegs legs = make_legs_massless(scene.mechanism);
  const VehicleBody before = find_frozen_body(Mechanism(scene.mechanism));
  const VehicleBody after = join(legs.on_base, find_frozen_body(Mechanism(legs.model)));
  std::printf("massless legs: %.4g kg to the base, %.4g kg to the ring; inertia %.4g -> %.4g\n",
              legs.on_base.mass, after.mass - legs.on_base.mass - 40.0, before.inertia(1, 1),
              after.inertia(1, 1));
  EXPECT_NEAR(after.mass, before.mass, 1e-13 * before.mass);
  EXPECT_LE((after.com - before.com).norm(), 1e-14);  // these parts lie on the axes of their legs
  EXPECT_GT(legs.on_base.mass, 1.0);
}

/// The same state and loads for a docking of another model.
void copy_state(const Docking& from, Docking& to) {
  to.y = from.y;
  to.loads = from.loads;
  to.discrete = from.discrete;
  to.model.thrust = from.model.thrust;
  to.model.falling = from.model.falling;
  ASSERT_TRUE(set_vehicle_velocity(to.model, kChaser, from.velocity[kChaser], from.rate[kChaser],
                                   to.y.data(), to.data)
                  .ok());
}

void use_level(Docking& docking, int level) {
  docking.model = make_docking_model(docking.scene, docking.scene.vehicle,
                                     docking.scene.contact.law, V(-15, 0, 0), level);
  docking.data = DockingData<double>(docking.model);
}

/// The loops closed by iteration and eliminated from the inertia of all bodies.
TEST(MasslessLegsLevel, agrees_with_newton_iteration_on_the_whole_tree) {
  TestRandom random(62);
  Residual rate, load, cut;
  for (const Motion chaser : {Motion::kFree, Motion::kFixed}) {
    Scene scene = read_test_scene("scene_ring.json");
    scene.motion[kChaser] = chaser;
    for (int n = 0; n < 20; ++n) {
      Docking fast(scene);
      use_level(fast, kMasslessLegs);
      fast.put_pose(kTarget, {Mat3<double>::Identity(), V(30, 0, 0)});  // until it is placed
      ASSERT_FALSE(fast.model.mechanism.plan.platforms.empty());
      fast.set_random_state(random, 0.002);
      fast.set_random_loads(random);
      fast.model.falling = false;
      fast.evaluate();
      Docking general(scene);
      use_level(general, kMasslessLegs);
      Mechanism oracle(fast.model.mechanism.model, true);
      oracle.vehicle = fast.model.mechanism.vehicle;
      set_mechanism(general.model, oracle);
      general.data = DockingData<double>(general.model);
      copy_state(fast, general);
      general.y = fast.y;
      general.model.fixed_pose = fast.model.fixed_pose;
      general.evaluate();
      const std::string where = "state " + std::to_string(n);
      for (size_t j = 0; j < fast.y.size(); ++j) {
        rate.add(std::abs(fast.ydot[j] - general.ydot[j]) / (1.0 + std::abs(general.ydot[j])),
                 where + ", rate " + std::to_string(j));
      }
      calc_docking_reactions(fast.model, fast.data);
      calc_docking_reactions(general.model, general.data);
      load.add(find_difference(fast.data.mechanism.on_base, general.data.mechanism.on_base), where);
      for (size_t b = 0; b < fast.data.mechanism.loops.block.size(); ++b) {
        const int k = fast.model.mechanism.plan.blocks[b].loops[0];
        const int other = general.model.mechanism.plan.block_of_loop[k];
        const VecX<double>& expected = general.data.mechanism.loops.block[other].lambda;
        cut.add((fast.data.mechanism.loops.block[b].lambda - expected).norm() / expected.norm(),
                where);
      }
      EXPECT_EQ(fast.model.mechanism.plan.tree_bodies.size(), chaser == Motion::kFree ? 2u : 1u);
    }
  }
  std::printf("massless legs and Newton iteration: rates %.1g, loads %.1g, cuts %.1g\n", rate.value,
              load.value, cut.value);
  EXPECT_RESIDUAL_BELOW(rate, 1e-12);
  EXPECT_RESIDUAL_BELOW(load, 1e-12);
  EXPECT_RESIDUAL_BELOW(cut, 1e-11);
}

TEST(MasslessLegsLevel, is_the_limit_of_light_legs) {
  TestRandom random(63);
  Docking state(read_test_scene("scene_ring.json"));
  state.set_random_state(random, 0.002);
  state.set_random_loads(random);
  double difference[2];
  for (int i : {0, 1}) {
    Scene light = state.scene;
    const double scale = i == 0 ? 1e-2 : 1e-3;
    for (Body& body : light.mechanism.bodies) {
      if (body.name == "ring") continue;
      body.mass *= scale;
      body.inertia *= scale;
    }
    Docking with_mass(light), without(light);
    use_level(without, kMasslessLegs);
    copy_state(state, with_mass);
    copy_state(state, without);
    with_mass.evaluate();
    without.evaluate();
    double largest = 0.0;
    difference[i] = 0.0;
    for (int j = 0; j < state.model.layout.mechanism_nv; ++j) {
      const int at = state.model.layout.mechanism_v + j;
      difference[i] = std::max(difference[i], std::abs(with_mass.ydot[at] - without.ydot[at]));
      largest = std::max(largest, std::abs(with_mass.ydot[at]));
    }
    difference[i] /= largest;
  }
  std::printf("light legs: accelerations off by %.3g with 1 %% of the mass, %.3g with 0.1 %%\n",
              difference[0], difference[1]);
  EXPECT_LE(difference[1], 1e-4);  // measured 3.6e-5
  EXPECT_NEAR(difference[0] / difference[1], 10.0, 0.5) << "not of first order in the mass";
}

// ---------------------------------------------------------------- every level

TEST(Levels, account_for_energy_and_momentum) {
  for (const int level : {kRigid, kMasslessLegs, kReduced}) {
    for (const int includes : {1, 2}) {
      Scene scene = light_scene(level);
      scene.vehicle[kChaser].mass_includes_mechanism = includes;
      DockingSim sim(share(scene));
      sim.initialise(0.0, 0.0);
      for (int i = 0; i < 60; ++i) ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok()) << sim.status_text();
      const Outputs& out = sim.outputs();
      std::printf("level %d: peak %.5g N, energy %.1g J, momentum %.1g, %.0f evaluations\n", level,
                  out.capture_peak[Outputs::kCompression].value, out.energy_residual,
                  out.momentum_residual, out.solver_rhs_evaluations);
      EXPECT_GT(out.capture_peak[Outputs::kCompression].value, 50.0) << level;
      EXPECT_LE(std::abs(out.energy_residual), 3e-4) << level;  // measured 4e-5 J of 3 J
      EXPECT_LE(out.momentum_residual, 1e-13) << level;
    }
  }
}

TEST(Levels, have_the_same_states) {
  std::vector<double> states;
  for (const int level : {kRigid, kMasslessLegs, kReduced}) {
    DockingSim sim(share(light_scene(level)), FmiKind::kModelExchange);
    sim.initialise(0.0, 0.0);
    std::vector<double> y(static_cast<size_t>(sim.state_count())), rates(y.size());
    sim.get_states(y.data());
    ASSERT_TRUE(sim.get_rates(rates.data()).ok()) << level;
    if (states.empty()) states = y;
    ASSERT_EQ(y.size(), states.size());
    for (int j = 0; j < 13; ++j) {
      EXPECT_EQ(y[static_cast<size_t>(j)], states[static_cast<size_t>(j)]) << "of the ring";
      if (level == kRigid) {
        EXPECT_EQ(rates[static_cast<size_t>(j)], 0.0);
      }
    }
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(Levels, allocate_nothing_in_steps) {
  for (const int level : {kRigid, kMasslessLegs}) {
    DockingSim sim(share(light_scene(level)));
    sim.initialise(0.0, 0.0);
    for (int i = 0; i < 5; ++i) ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok());
    sim.outputs();
    EXPECT_EQ(count_allocations([&] {
                for (int i = 5; i < 60; ++i) {
                  sim.step(0.01 * i, 0.01);
                  sim.outputs();
                }
              }),
              0)
        << level;
  }
}
#endif

TEST(Levels, that_cannot_be_are_refused_with_the_reason) {
  for (const auto& [level, reason] : {std::pair{0, "model.level is 0; it must be 1 (rigid)"},
                                      {5, "model.level is 5; it must be"}}) {
    ComparingSim sim(share(ring_scene()));
    sim.parameters().model_level = level;
    const std::string refused = find_refusal([&] { sim.initialise(0.0, 0.0); });
    EXPECT_NE(refused.find(reason), std::string::npos) << refused;
  }
  ComparingSim multipliers(share(ring_scene()));
  multipliers.parameters().model_level = kReference;
  multipliers.parameters().solver_method = kExplicit;
  EXPECT_NE(find_refusal([&] { multipliers.initialise(0.0, 0.0); }).find("only solver.method 9"),
            std::string::npos);
  multipliers.parameters().model_level = kReduced;
  multipliers.parameters().solver_method = kDae;
  EXPECT_NE(find_refusal([&] { multipliers.initialise(0.0, 0.0); }).find("set model.level to 4"),
            std::string::npos);
  const MechanismModel nested =
      read_mechanism(read_test_file("crank_nested.json"), "crank_nested.json");
  const std::string refused = find_refusal([&] { make_legs_massless(nested); });
  std::printf("%s\n", refused.c_str());
  EXPECT_NE(refused.find("model.level is 2 (massless_legs), but the mass of body '"),
            std::string::npos)
      << refused;
  EXPECT_NE(refused.find("take model.level = 3 (reduced)"), std::string::npos) << refused;
}

}  // namespace
}  // namespace dockloop
