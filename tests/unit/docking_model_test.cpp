// Two vehicles, mechanism, contact and latches as one system of equations, at random states.
// 1. the velocity recovered from a momentum state is the velocity that was put in;
// 2. momentum is a plain sum: without loads from outside its rates cancel to the last bit, with
//    loads they are the rates of the external impulse;
// 3. momentum states are the momentum of the bodies, and their rates are its rates;
// 4. energy: d/dt(kinetic + potential) + dissipated energies - external work = 0 along the flow, in
// free drift,
//    in contact with either friction law, with latches, with gravity and loads, fixed or free;
// 5. nothing depends on where frame O is.
#include "docking/docking_model.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "unit/random_docking.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;
using L = Extended;

TEST(MomentumStates, give_back_the_velocity_that_was_put_in) {
  Residual ring, bare;
  TestRandom random(61);
  const Scene scenes[2] = {read_test_scene("scene_ring.json"),
                           read_test_scene("scene_minimal.json")};
  for (int trial = 0; trial < 100; ++trial) {
    for (int s = 0; s < 2; ++s) {
      Docking docking(scenes[s]);
      docking.set_random_state(random, -0.01);
      docking.evaluate();
      for (int i : {kChaser, kTarget}) {
        const FrameMotion<double>& frame = docking.data.vehicle[i];
        Residual& worst = s == 0 ? ring : bare;
        worst.add((frame.v - docking.velocity[i]).norm() / docking.velocity[i].norm(), "velocity");
        worst.add((frame.R.transpose() * frame.w - docking.rate[i]).norm() / docking.rate[i].norm(),
                  "rate");
      }
    }
  }
  EXPECT_RESIDUAL_BELOW(ring, 7e-14);    // measured 7.1e-15
  EXPECT_RESIDUAL_BELOW(bare, 1.2e-14);  // measured 1.2e-15
}

TEST(MomentumStates, are_the_momentum_of_the_bodies) {
  Residual worst;
  TestRandom random(62);
  const Scene scene = read_test_scene("scene_ring.json");
  for (int trial = 0; trial < 50; ++trial) {
    Docking docking(scene);
    docking.set_random_state(random, -0.01);
    docking.evaluate();
    for (int i : {kChaser, kTarget}) {
      const Wrench<double> sum = find_momentum(docking.model, i, docking.data);
      const double* at = docking.y.data() + docking.model.layout.momentum[i];
      worst.add((sum.f - V(at[0], at[1], at[2])).norm() / sum.f.norm(), "linear");
      worst.add((sum.t - V(at[3], at[4], at[5])).norm() / sum.t.norm(), "angular");
    }
  }
  EXPECT_RESIDUAL_BELOW(worst, 9e-15);  // measured 9.1e-16
}

TEST(MomentumStates, have_rates_that_cancel_to_the_last_bit_without_outside_loads) {
  TestRandom random(63);
  const Scene scenes[2] = {ring(), fingers()};
  int touching = 0;
  for (int trial = 0; trial < 100; ++trial) {
    Docking docking(scenes[trial / 2 % 2], 1 + trial % 2);
    docking.set_random_state(random, 5e-4);
    for (int j = 0; j < docking.loads.command.size(); ++j) {
      docking.loads.command[j] = random.uniform(-30, 30);  // internal
    }
    docking.evaluate();
    touching += docking.data.contact.active_count > 0;
    for (int part : {0, 3}) {
      const V chaser = docking.rate3(docking.model.layout.momentum[kChaser] + part);
      const V target = docking.rate3(docking.model.layout.momentum[kTarget] + part);
      EXPECT_EQ((chaser + target).norm(), 0.0) << "trial " << trial;
      EXPECT_EQ(docking.rate3(docking.model.layout.impulse + part).norm(), 0.0);
      EXPECT_GT(chaser.norm(), 0.0);
    }
  }
  EXPECT_EQ(touching, 100);
}

TEST(MomentumStates, change_by_the_external_impulse) {
  TestRandom random(64);
  Residual worst;
  const Scene scene = read_test_scene("scene_ring.json");
  for (int trial = 0; trial < 50; ++trial) {
    Docking docking(scene);
    docking.set_random_state(random, 5e-4);
    docking.set_random_loads(random);
    docking.evaluate();
    // By hand: forces on the vehicles at their CoM, torques in body axes, thrust along x of A.
    V force = docking.data.interface[kChaser].R.col(0) * 120.0;
    V moment = docking.data.vehicle[kChaser].p.cross(force);
    for (int i : {kChaser, kTarget}) {
      const FrameMotion<double>& frame = docking.data.vehicle[i];
      force += docking.loads.force[i];
      moment += frame.p.cross(docking.loads.force[i]) + frame.R * docking.loads.torque[i];
    }
    const V sum = docking.rate3(docking.model.layout.momentum[kChaser]) +
                  docking.rate3(docking.model.layout.momentum[kTarget]);
    const V angular = docking.rate3(docking.model.layout.momentum[kChaser] + 3) +
                      docking.rate3(docking.model.layout.momentum[kTarget] + 3);
    worst.add((sum - force).norm() / force.norm(), "force");
    worst.add((docking.rate3(docking.model.layout.impulse) - force).norm() / force.norm(), "sum");
    worst.add((angular - moment).norm() / moment.norm(), "moment");
    worst.add((docking.rate3(docking.model.layout.impulse + 3) - moment).norm() / moment.norm(),
              "angular sum");
  }
  EXPECT_RESIDUAL_BELOW(worst, 1.3e-14);  // measured 1.3e-15
}

/// Rates of total energy (what must be 0) and of momentum, by central differences along the flow.
struct Balance {
  double energy = 0.0;    ///< over the powers that occur
  double momentum = 0.0;  ///< |rate of the state - rate of the bodies' momentum|, over momentum/s
};

Balance find_balance(const Docking& docking, L h) {
  const DockingModel& model = docking.model;
  const StateLayout& layout = model.layout;
  DockingData<L> data(model);
  const ExternalLoads<L> loads = cast_loads<L>(docking.loads);
  const auto rates = [&](const L* y, L* ydot) {
    ASSERT_TRUE(
        calc_docking<L>(model, docking.discrete, docking.memory, loads, 0, y, ydot, data).ok());
  };
  struct Sample {
    L energy;
    std::array<Wrench<L>, 2> momentum;
  };
  const auto sample = [&](const std::vector<L>& y) {
    std::vector<L> ydot(y.size());
    rates(y.data(), ydot.data());
    Sample s;
    s.energy = find_kinetic_energy(model, data) + data.joints.energy + data.contact.energy +
               data.latch.energy - y[layout.sums + kSumExternal];
    for (int dissipated : {kSumContact, kSumFriction, kSumLegs, kSumLatches}) {
      s.energy += y[layout.sums + dissipated];
    }
    for (int i : {kChaser, kTarget}) s.momentum[i] = find_momentum(model, i, data);
    return s;
  };
  std::vector<L> y0(docking.y.begin(), docking.y.end()), ydot(y0.size());
  rates(y0.data(), ydot.data());
  // The scale: all powers, and the kinetic power of the contact and leg forces.
  L power = 1e-3L + abs(ydot[layout.sums + kSumExternal]);
  for (int k = 0; k < kSumCount; ++k) power += abs(ydot[layout.sums + k]);
  power += data.on_passive.f.norm() * (data.relative.v.norm() + L(0.1));
  Balance balance;
  L energy_rate = 0;
  std::array<Wrench<L>, 2> momentum_rate;
  const L weight[2] = {2.0L / 3, -1.0L / 12};
  for (int s = 1; s <= 2; ++s) {
    for (int side : {-1, 1}) {
      std::vector<L> y = y0;
      step_rk4<L>(rates, y, L(side * s) * h);
      const Sample at = sample(y);
      const L factor = weight[s - 1] * L(side) / h;
      energy_rate += factor * at.energy;
      for (int i : {kChaser, kTarget}) {
        momentum_rate[i].f += factor * at.momentum[i].f;
        momentum_rate[i].t += factor * at.momentum[i].t;
      }
    }
  }
  balance.energy = static_cast<double>(abs(energy_rate) / power);
  for (int i : {kChaser, kTarget}) {
    if (layout.momentum[i] < 0) continue;
    const L* at = ydot.data() + layout.momentum[i];
    const double* p = docking.y.data() + layout.momentum[i];
    const Vec3<L> f(at[0], at[1], at[2]), t(at[3], at[4], at[5]);
    const L linear = f.norm() + V(p[0], p[1], p[2]).norm();
    const L angular = t.norm() + V(p[3], p[4], p[5]).norm();
    balance.momentum =
        std::max({balance.momentum, static_cast<double>((momentum_rate[i].f - f).norm() / linear),
                  static_cast<double>((momentum_rate[i].t - t).norm() / angular)});
  }
  return balance;
}

struct BalanceCase {
  const char* name;
  const char* scene;
  double depth;
  int friction_model;
  bool loads, held;
  Motion chaser, target;
  double h;                 ///< of the differences [s]
  double energy, momentum;  ///< tolerances, ten times what was measured
};

class Balances : public ::testing::TestWithParam<BalanceCase> {};

TEST_P(Balances, hold_along_the_flow) {
  const BalanceCase& at = GetParam();
  Scene scene = read_test_scene(at.scene);
  scene.motion = {at.chaser, at.target};
  TestRandom random(65);
  Residual energy, momentum;
  for (int trial = 0; trial < 20; ++trial) {
    Docking docking(scene, at.friction_model);
    docking.set_random_state(random, at.depth);
    if (at.loads) docking.set_random_loads(random);
    if (at.held) {
      for (int i = 0; i < docking.model.latches.count(); ++i) {
        docking.discrete.latch[i].mode = LatchMode::kHeld;
      }
    }
    for (int j = 0; j < docking.model.layout.bristle_count; ++j) {
      docking.y[docking.model.layout.bristles + j] = random.uniform(-1e-5, 1e-5);
    }
    const Balance balance = find_balance(docking, static_cast<L>(at.h));
    energy.add(balance.energy, "trial " + std::to_string(trial));
    momentum.add(balance.momentum, "trial " + std::to_string(trial));
  }
  EXPECT_RESIDUAL_BELOW(energy, at.energy);
  EXPECT_RESIDUAL_BELOW(momentum, at.momentum);
}

constexpr Motion kFreeMotion = Motion::kFree, kFixedMotion = Motion::kFixed;
INSTANTIATE_TEST_SUITE_P(
    // Held latches are pulled far at random states: stiff, so h is smaller and rounding larger.
    cases, Balances,
    ::testing::Values(BalanceCase{"free_flight", "scene_ring.json", -0.05, 1, false, false,
                                  kFreeMotion, kFreeMotion, 1e-6, 4e-10, 4e-12},
                      BalanceCase{"contact", "scene_ring.json", 5e-4, 1, false, false, kFreeMotion,
                                  kFreeMotion, 1e-6, 5e-11, 4e-12},
                      BalanceCase{"contact_bristles", "scene_ring.json", 5e-4, 2, false, false,
                                  kFreeMotion, kFreeMotion, 1e-6, 6e-11, 3e-12},
                      BalanceCase{"contact_and_held_latches", "scene_ring.json", 5e-4, 1, false,
                                  true, kFreeMotion, kFreeMotion, 1e-7, 7e-8, 5e-8},
                      BalanceCase{"loads_and_gravity", "scene_ring.json", 5e-4, 1, true, false,
                                  kFreeMotion, kFreeMotion, 1e-6, 4e-11, 7e-12},
                      BalanceCase{"gravity_with_a_fixed_target", "scene_ring.json", 5e-4, 1, true,
                                  false, kFreeMotion, kFixedMotion, 1e-6, 8e-12, 3e-13},
                      BalanceCase{"gravity_on_an_immobile_base", "scene_ring.json", 5e-4, 1, true,
                                  false, kFixedMotion, kFreeMotion, 1e-6, 2e-12, 3e-13},
                      BalanceCase{"fingers", "scene_fingers.json", 5e-4, 1, true, false,
                                  kFreeMotion, kFreeMotion, 1e-6, 9e-14, 2.8e-10},
                      BalanceCase{"fingers_with_bristles", "scene_fingers.json", 5e-4, 2, false,
                                  false, kFreeMotion, kFreeMotion, 1e-6, 6e-14, 1.5e-12},
                      BalanceCase{"fingers_on_an_immobile_base", "scene_fingers.json", 5e-4, 1,
                                  true, false, kFixedMotion, kFreeMotion, 1e-6, 9e-14, 1.2e-11},
                      BalanceCase{"absorber", "scene_minimal.json", 2e-3, 1, true, false,
                                  kFreeMotion, kFreeMotion, 1e-6, 3e-10, 3e-12}),
    [](const ::testing::TestParamInfo<BalanceCase>& at) { return std::string(at.param.name); });

TEST(DockingModel, gravity_leaves_everything_in_a_falling_frame_as_it_was) {
  TestRandom random(66);
  Docking docking(read_test_scene("scene_ring.json"));
  docking.set_random_state(random, 5e-4);
  docking.evaluate();
  const std::vector<double> before = docking.ydot;
  docking.loads.gravity = V(3.0, -8.0, 1.0);
  docking.evaluate();
  EXPECT_EQ(docking.ydot, before);
}

TEST(DockingModel, does_not_depend_on_where_its_frame_is) {
  TestRandom random(67);
  Residual worst;
  const Scene scene = read_test_scene("scene_ring.json");
  for (int trial = 0; trial < 20; ++trial) {
    Docking docking(scene), moved(scene);
    docking.set_random_state(random, 5e-4);
    docking.evaluate();
    const Pose<double> shift{rotation_of(random.vector(2.0)), random.vector(3.0)};
    moved.y = docking.y;
    for (int i : {kChaser, kTarget}) {
      const FrameMotion<double>& frame = docking.data.vehicle[i];
      moved.put_pose(i, shift * Pose<double>{frame.R, frame.p});
      ASSERT_TRUE(set_vehicle_velocity(moved.model, i, shift.R * docking.velocity[i],
                                       docking.rate[i], moved.y.data(), moved.data)
                      .ok());
    }
    moved.evaluate();
    const int v = docking.model.layout.mechanism_v;
    const Eigen::Map<const VecX<double>> a(docking.ydot.data() + v, 6), b(moved.ydot.data() + v, 6);
    worst.add(find_relative_error(VecX<double>(b), VecX<double>(a)), "mechanism");
    const V f = docking.data.on_passive.f;
    worst.add((moved.data.on_passive.f - shift.R * f).norm() / f.norm(), "capture force");
  }
  EXPECT_RESIDUAL_BELOW(worst,
                        1e-10);  // measured 1.0e-11: stiff contact magnifies the rounding of poses
}

TEST(DockingModel, a_mass_that_includes_the_mechanism_is_that_of_all_bodies_together) {
  Scene scene = read_test_scene("scene_ring.json");
  scene.vehicle[kChaser].mass_includes_mechanism = 2;
  const DockingModel model =
      make_docking_model(scene, scene.vehicle, scene.contact.law, V(0, 0, 0));
  MechanismModel attached = model.mechanism.model;
  const VehicleBody whole = find_frozen_body(Mechanism(attached));
  EXPECT_NEAR(whole.mass, 25000.0, scaled_tolerance(4e-11));  // measured 3.6e-12
  EXPECT_LE(whole.com.norm(), scaled_tolerance(1e-16));       // measured 5e-18
  const Mat3<double> stated = make_symmetric(scene.vehicle[kChaser].inertia);
  EXPECT_LE((whole.inertia - stated).norm() / stated.norm(), scaled_tolerance(4e-15));
}

TEST(DockingModel, a_vehicle_lighter_than_what_it_includes_is_refused) {
  Scene scene = read_test_scene("scene_ring.json");
  scene.vehicle[kChaser].mass_includes_mechanism = 2;
  scene.vehicle[kChaser].mass = 30.0;
  const std::string text = find_refusal(
      [&] { make_docking_model(scene, scene.vehicle, scene.contact.law, V(0, 0, 0)); });
  EXPECT_NE(text.find("chaser.mass is 30 kg"), std::string::npos) << text;
}

}  // namespace
}  // namespace dockloop
