// What a run says of itself, and what it refuses.
// 1. a latch is caught although it enters and leaves the range of its catch within one inner step,
//    whatever the communication step and the method;
// 2. why there is no capture: each reason in a docking that has it; no capture before a contact;
// 3. energy that does not add up is reported once where it matters, and a step that multiplies
//    energy is refused;
// 4. a refusal costs a bounded number of evaluations, also when vehicles spin impossibly fast;
// 5. vehicles that no body can be are refused;
// 6. the force of a leg holds what a screw on its slide transmits.
#include <gtest/gtest.h>

#include <cmath>

#include "docking/phases.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

/// The ring scene with the origin of P at `p` from that of the ring at home, 0.28 m in front of A.
/// Both are fixed in attitude, P moves with `v`. Without surfaces, so that nothing but latches
/// acts.
std::shared_ptr<const Scene> make_pass(const V& p, const V& v) {
  Scene scene = ring_scene();
  scene.contact = ContactModel();
  scene.level = kRigid;
  for (int i : {kChaser, kTarget}) {
    VehicleParameters& vehicle = scene.vehicle[i];
    vehicle.attitude = {1, 0, 0, 0};
    vehicle.velocity = vehicle.angular_velocity = V::Zero();
    vehicle.position = -vehicle.interface_position;
  }
  scene.vehicle[kTarget].position += V(0.28, 0.0, 0.0) + p;
  scene.vehicle[kTarget].velocity = v;
  return share(scene);
}

/// Runs to `end` in steps of h. @return the simulation
std::unique_ptr<DockingSim> run(const std::shared_ptr<const Scene>& scene, int method, double h,
                                double end) {
  auto sim = std::make_unique<DockingSim>(scene, FmiKind::kCoSimulation, get_comparison());
  sim->parameters().solver_method = method;
  sim->initialise(0.0, 0.0);
  for (int i = 0; i * h < end * (1.0 - 1e-9); ++i) {
    const Status status = sim->step(i * h, h);
    EXPECT_TRUE(status.ok()) << sim->status_text();
    if (!status.ok()) break;
  }
  return sim;
}

// ---------------------------------------------------------------- latches

class Passes : public ::testing::TestWithParam<int> {};

TEST_P(Passes, are_caught_with_any_communication_step) {
  // Deep enough from 0.05 s on, next to the window from 0.069 s on: 19 ms are left to catch.
  const double vx = 0.2, vy = 0.5, window = ring_scene().latches.latch[0].law.window;
  const double catch_at = ring_scene().latches.latch[0].law.catch_distance;
  const auto scene = make_pass(V(catch_at + 0.05 * vx, window - 0.069 * vy, 0.0), V(-vx, vy, 0.0));
  for (const double h : {0.1, 0.05, 0.01}) {
    const auto sim = run(scene, GetParam(), h, 0.1);
    EXPECT_TRUE(sim->outputs().captured) << "steps of " << h << " s";
    EXPECT_NEAR(sim->outputs().time_of_capture, 0.05, GetParam() == kFixedRk4 ? 2e-3 : 1e-4);
  }
}

TEST_P(Passes, are_not_caught_next_to_the_window) {
  const auto scene = make_pass(V(0.014, 0.0265, 0.0), V(-0.2, 0.5, 0.0));
  for (const double h : {0.1, 0.01}) {
    const auto sim = run(scene, GetParam(), h, 0.1);
    EXPECT_FALSE(sim->outputs().captured);
    EXPECT_EQ(sim->outputs().latched[0], 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, Passes,
                         ::testing::Values(kAuto, kExplicit, kRosenbrock, kFixedRk4));

// ---------------------------------------------------------------- reasons

TEST(CaptureReasons, of_seated_rings_next_to_their_strikers_name_the_lateral_distance) {
  // No surfaces: the rings are as deep as a catch needs and 31 mm apart, and stay there.
  const auto scene = make_pass(V(0.001, 0.031, 0.0), V::Zero());
  const auto sim = run(scene, kAuto, 0.1, 1.0);
  const Outputs& out = sim->outputs();
  EXPECT_NEAR(out.latch_lateral[0], 0.031, 2e-3);  // the pawls push it further out
  EXPECT_EQ(out.latch_state[0], kPushed);
  EXPECT_FALSE(out.captured);
}

TEST(CaptureReasons, follow_from_what_the_docking_does) {
  PhaseInputs now;
  DiscreteState state;
  now.gap = 0.3;
  EXPECT_EQ(find_capture_reason(now, state), kNotTouched);
  state.contacted = true;
  now.gap = -1e-4;
  now.speed = 0.05;
  EXPECT_EQ(find_capture_reason(now, state), kInMotion);
  now.speed = 1e-5;
  EXPECT_EQ(find_capture_reason(now, state), kTooSlow);
  now.on_petal = true;
  EXPECT_EQ(find_capture_reason(now, state), kHungUp);
  now.seated = true;
  EXPECT_EQ(find_capture_reason(now, state), kBesideWindow);
  state.phase = kRebound;
  EXPECT_EQ(find_capture_reason(now, state), kReasonRebound);
  state.captured = true;
  EXPECT_EQ(find_capture_reason(now, state), kNoReason);
  state = DiscreteState();
  state.outcome = kMiss;
  EXPECT_EQ(find_capture_reason(now, state), kReasonMiss);
}

TEST(CaptureReasons, count_the_time_for_which_rings_are_seated) {
  PhaseInputs now;
  DiscreteState state;
  state.contacted = true;
  update_seat(now, 1.0, state);
  now.seated = true;
  update_seat(now, 2.0, state);
  EXPECT_EQ(state.seated_time, 0.0);
  update_seat(now, 2.5, state);
  now.seated = false;
  update_seat(now, 4.0, state);
  EXPECT_EQ(state.seated_time, 2.0);
  update_seat(now, 5.0, state);
  EXPECT_EQ(state.seated_time, 2.0);
  state.captured = now.seated = true;
  update_seat(now, 6.0, state);
  update_seat(now, 7.0, state);
  EXPECT_EQ(state.seated_time, 2.0);
}

TEST(Capture, is_never_before_the_first_contact) {
  Scene scene = ring_scene();
  scene.conditions = ContactConditions();
  scene.conditions.given = true;
  scene.conditions.closing_speed = 0.1;
  scene.conditions.approach_time = 0.2;
  scene.vehicle = find_placement(scene).vehicle;
  const auto sim = run(share(scene), kAuto, 0.01, 1.0);
  const Outputs& out = sim->outputs();
  EXPECT_TRUE(out.captured);
  EXPECT_GE(out.time_of_contact, 0.0);
  EXPECT_GE(out.time_of_capture, out.time_of_contact);
  EXPECT_EQ(out.capture_reason, kNoReason);
  EXPECT_EQ(out.latch_state[0], kCaught);
}

// ---------------------------------------------------------------- energy

TEST(EnergyWatch, refuses_a_step_that_multiplies_energy) {
  // Dampers of the legs let the ring decay with hundreds per second: steps of 0.05 s are unstable.
  Scene scene = ring_scene();
  scene.capture_body_start.displacement = V(-0.01, 0.005, 0.0);
  DockingSim sim(share(scene));
  sim.parameters().solver_method = kFixedRk4;
  sim.parameters().step = 0.05;
  sim.initialise(0.0, 0.0);
  const double start = sim.outputs().energy_kinetic + sim.outputs().energy_potential;
  Status status;
  for (int i = 0; i < 40 && status.ok(); ++i) status = sim.step(0.05 * i, 0.05);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(sim.status_text().find("makes the energy audit wrong"), std::string::npos)
      << sim.status_text();
  EXPECT_NE(sim.status_text().find("solver.step"), std::string::npos) << sim.status_text();
  EXPECT_LT(std::abs(sim.outputs().energy_residual), 2.0 * start);
}

TEST(EnergyWatch, bounds_what_any_method_makes_in_contact) {
  for (int method = kAuto; method <= kMethodCount; ++method) {
    if (!find_method(method)->is_carried(false)) continue;
    for (const double step : {0.02, 0.05}) {
      ComparingSim sim(share(short_ring_scene()));
      sim.parameters().solver_method = method;
      sim.parameters().step = step;
      sim.parameters().rtol = 1e-2;
      sim.initialise(0.0, 0.0);
      const double start = sim.outputs().energy_kinetic;
      Status status;
      for (int i = 0; i < 40 && status.ok(); ++i) status = sim.step(step * i, step);
      EXPECT_LT(std::abs(sim.outputs().energy_residual), 2.0 * start) << "method " << method;
    }
  }
}

TEST(EnergyWatch, warns_once_where_the_audit_is_off_and_never_where_it_holds) {
  for (const double step : {2e-2, 1e-4}) {
    DockingSim sim(share(short_ring_scene()));
    sim.parameters().solver_method = kFixedRk4;
    sim.parameters().step = step;
    sim.initialise(0.0, 0.0);
    sim.take_warnings();
    int reported = 0;
    Status status;
    for (int i = 0; i < 40 && status.ok(); ++i) {
      status = sim.step(0.02 * i, 0.02);
      for (const std::string& text : sim.take_warnings()) {
        reported += text.find("energy audit is off by") != std::string::npos;
      }
    }
    if (step > 1e-3) {
      EXPECT_EQ(reported, 1) << sim.status_text();
    } else {
      EXPECT_TRUE(status.ok()) << sim.status_text();
      EXPECT_EQ(reported, 0);
    }
  }
}

// ---------------------------------------------------------------- work

TEST(Refusals, cost_a_bounded_number_of_evaluations) {
  // Friction so steep that explicit steps last nanoseconds.
  Scene scene = short_ring_scene();
  scene.contact.law.friction_speed = 1e-9;
  for (const int method : {kExplicit, kStabilised}) {
    DockingSim sim(share(scene));
    sim.parameters().solver_method = method;
    sim.initialise(0.0, 0.0);
    Status status;
    double evaluations = 0.0;
    for (int i = 0; i < 100 && status.ok(); ++i) {
      evaluations = sim.outputs().solver_rhs_evaluations;
      status = sim.step(0.01 * i, 0.01);
    }
    ASSERT_FALSE(status.ok());
    EXPECT_NE(sim.status_text().find("the step needs more than"), std::string::npos)
        << sim.status_text();
    // A refused step is taken out of the count again.
    EXPECT_EQ(sim.outputs().solver_rhs_evaluations, evaluations);
  }
}

TEST(Refusals, of_impossible_spins_take_no_time) {
  Scene scene = ring_scene();
  scene.conditions.approach_time = 100.0;
  scene.vehicle = find_placement(scene).vehicle;
  DockingSim sim(share(scene));
  sim.parameters().vehicle[kTarget].angular_velocity = V(1e9, 0.0, 0.0);
  sim.initialise(0.0, 0.0);
  for (const double h : {1e-3, 1.0}) {
    const Status status = sim.step(0.0, h);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(sim.status_text().find("spins"), std::string::npos) << sim.status_text();
  }
}

TEST(Refusals, name_an_inertia_that_no_body_has) {
  DockingSim sim(share(ring_scene()));
  sim.parameters().vehicle[kTarget].inertia << 1e3, 132e3, 1e6, 0, 0, 0;
  try {
    sim.initialise(0.0, 0.0);
    FAIL() << "is accepted";
  } catch (const ModelError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("target.inertia"), std::string::npos) << text;
    EXPECT_NE(text.find("1000, 132000 and 1e+06"), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace dockloop
