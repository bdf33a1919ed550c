// A docking simulation as its users drive it: start, steps, inputs, outputs.
// 1. it starts where the scene says; placed for a first contact, it meets the stated conditions;
// 2. runs repeat to the last bit; orbital offsets and gravity do not touch the relative motion;
//    communication steps matter within the tolerance only; energy and momentum are accounted for;
// 3. a refused step (bad attitude of a driven vehicle, a load that is no number) leaves all as it
//    was, and the next valid step gives the bits that it would have given;
// 4. outputs are finite from start to capture; the time to contact is a lower bound;
// 5. thrust after contact starts after its delay;
// 6. a vehicle driven along its own free path gives nearly the free run, and the mean loads that
//    a host receives give its bodies the velocities of the free run;
// 7. step() does not allocate memory.
//
// Scenes: scene_minimal.json (a one-dimensional absorber) and scene_ring.json (idss_25t_350t as
// `dockloop build` resolves it: a guide ring on six legs, contact after 2 s, three latches).
#include "sim/docking_sim.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>

#include "docking/placement.hpp"
#include "unit/allocations.hpp"
#include "unit/minimal_scene.hpp"
#include "unit/sim_test_support.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

/// Where two lists of outputs differ first, for messages.
std::string first_difference(const std::vector<double>& a, const std::vector<double>& b) {
  for (size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    if (std::memcmp(&a[i], &b[i], sizeof(double)) != 0) {
      return "entry " + std::to_string(i) + ": " + std::to_string(a[i]) + " and " +
             std::to_string(b[i]);
    }
  }
  return "none";
}

/// An initialised simulation that is stepped evenly.
struct SteppedSim {
  explicit SteppedSim(const Scene& scene, double tolerance = 0.0) : sim(share(scene)) {
    sim.initialise(0.0, tolerance);
  }
  explicit SteppedSim(const Scene& scene, void (*change)(Parameters&)) : sim(share(scene)) {
    change(sim.parameters());
    sim.initialise(0.0, 0.0);
  }
  Status step(double h) {
    const Status status = sim.step(t, h);
    if (status.ok()) t = ++count * h;  // all steps of a run are alike
    return status;
  }
  void advance(double end, double h) {
    while (t < end - 0.5 * h) ASSERT_TRUE(step(h).ok()) << sim.status_text();
  }
  DockingSim sim;
  double t = 0.0;
  int count = 0;
};

TEST(Start, is_where_the_scene_says) {
  const Scene scene = ring_scene();
  SteppedSim run(scene);
  const Outputs& out = run.sim.outputs();
  Residual worst;
  for (int i : {kChaser, kTarget}) {
    worst.add((out.vehicle[i].position - scene.vehicle[i].position).norm(), "position");
    worst.add((out.vehicle[i].velocity - scene.vehicle[i].velocity).norm(), "velocity");
    worst.add((out.vehicle[i].attitude - scene.vehicle[i].attitude).norm(), "attitude");
    worst.add((out.vehicle[i].angular_velocity - scene.vehicle[i].angular_velocity).norm(), "rate");
  }
  EXPECT_RESIDUAL_BELOW(worst, 3e-16);  // measured 2.8e-17
  EXPECT_EQ(out.time, 0.0);
  EXPECT_EQ(out.phase, 1);
  EXPECT_EQ(out.time_of_contact, -1.0);
}

TEST(Start, of_the_ring_away_from_home_is_the_one_stated) {
  Scene scene = ring_scene();
  scene.capture_body_start.displacement = V(0.01, -0.02, 0.005);
  scene.capture_body_start.rotation_vector = V(0.02, 0.01, -0.015);
  scene.capture_body_start.velocity = V(0.01, 0.02, 0.03);
  scene.capture_body_start.angular_velocity = V(0.03, -0.01, 0.02);
  SteppedSim home(ring_scene()), run(scene);
  const Outputs &a = home.sim.outputs(), &b = run.sim.outputs();
  Residual worst;
  // The home of this mechanism has the axes of A.
  worst.add((b.ring_position - a.ring_position - V(0.01, -0.02, 0.005)).norm(), "position");
  worst.add((quat_log<double>(b.ring_attitude) - V(0.02, 0.01, -0.015)).norm(), "attitude");
  worst.add((b.ring_velocity - V(0.01, 0.02, 0.03)).norm(), "velocity");
  worst.add((b.ring_angular_velocity - V(0.03, -0.01, 0.02)).norm(), "rate");
  EXPECT_RESIDUAL_BELOW(worst, 3e-15);  // measured 2.9e-16
}

TEST(Start, refuses_parameters_that_cannot_be_with_their_name) {
  const auto refuse = [](void (*change)(Parameters&)) {
    return find_refusal([&] { SteppedSim run(ring_scene(), change); });
  };
  EXPECT_NE(refuse([](Parameters& p) { p.vehicle[kChaser].mass = -1.0; }).find("chaser.mass"),
            std::string::npos);
  EXPECT_NE(
      refuse([](Parameters& p) { p.vehicle[kTarget].inertia[3] = 1e9; }).find("target.inertia"),
      std::string::npos);
  EXPECT_NE(
      refuse([](Parameters& p) { p.vehicle[kTarget].attitude[0] = 2.0; }).find("target.attitude"),
      std::string::npos);
  EXPECT_NE(refuse([](Parameters& p) { p.rtol = 0.0; }).find("solver.rtol"), std::string::npos);
  EXPECT_NE(
      refuse([](Parameters& p) { p.vehicle[kChaser].mass = std::nan(""); }).find("chaser.mass"),
      std::string::npos);
  // The gap at the start is 0.215 m.
  EXPECT_NE(
      refuse([](Parameters& p) { p.vehicle[kChaser].position.x() += 0.3; }).find("start state"),
      std::string::npos);
}

TEST(Placement, meets_the_stated_conditions_at_first_contact) {
  Scene scene = ring_scene();
  scene.solver = {1e-10, 1e-12, 1e-12, 1e-10};
  const Placement placement = find_placement(scene);
  ASSERT_TRUE(placement.touches);
  EXPECT_EQ(placement.time_of_contact, 2.0);
  scene.vehicle = placement.vehicle;
  SteppedSim run(scene);
  run.advance(2.0, 0.02);
  const Outputs& out = run.sim.outputs();
  const ContactConditions& at = scene.conditions;
  Residual worst;
  worst.add(out.gap, "gap");
  worst.add(out.relative_position.y() - at.lateral.y(), "y");
  worst.add(out.relative_position.z() - at.lateral.z(), "z");
  worst.add(out.relative_velocity.x() + at.closing_speed, "closing speed");
  worst.add(out.relative_velocity.y() - at.lateral_velocity.y(), "velocity y");
  worst.add(out.relative_velocity.z() - at.lateral_velocity.z(), "velocity z");
  const Vec4<double> expected =
      quat_multiply<double>(quat_exp<double>(at.tilt), quat_exp<double>(V(at.roll, 0, 0)));
  worst.add((out.relative_attitude - expected).norm(), "attitude");
  worst.add((out.relative_angular_velocity - at.angular_velocity).norm(), "rates");
  worst.add(out.relative_roll - at.roll, "roll");
  worst.add(out.relative_pitch_yaw - at.tilt.norm(), "tilt");
  EXPECT_RESIDUAL_BELOW(worst, 2e-7);  // measured 2.0e-8 (gap)
  run.advance(2.1, 0.02);
  EXPECT_NEAR(run.sim.outputs().time_of_contact, 2.0, scaled_tolerance(4e-6));  // measured 3.6e-7
}

TEST(Placement, is_the_start_that_the_scene_document_holds) {
  // The document was resolved by the same placement, through the command-line core.
  const Scene scene = ring_scene();
  const Placement placement = find_placement(scene);
  Residual worst;
  // Its start states are the placed ones, so placing again must not move the chaser.
  const VehicleParameters &a = placement.vehicle[kChaser], &b = scene.vehicle[kChaser];
  worst.add((a.position - b.position).norm(), "position");
  worst.add((a.velocity - b.velocity).norm(), "velocity");
  worst.add((a.attitude - b.attitude).norm(), "attitude");
  worst.add((a.angular_velocity - b.angular_velocity).norm(), "rate");
  EXPECT_RESIDUAL_BELOW(worst, 1e-15);  // measured 0
}

TEST(Runs, repeat_to_the_last_bit) {
  const Scene scene = short_ring_scene();
  SteppedSim first(scene), second(scene);
  for (int i = 0; i < 60; ++i) {
    ASSERT_TRUE(first.step(0.01).ok());
    ASSERT_TRUE(second.step(0.01).ok());
    const std::vector<double> a = flatten(first.sim.outputs(), true);
    const std::vector<double> b = flatten(second.sim.outputs(), true);
    ASSERT_TRUE(same_bits(a, b)) << "t = " << first.t << ", " << first_difference(a, b);
  }
  EXPECT_GT(first.sim.outputs().time_of_contact, 0.0);
}

TEST(Runs, repeat_to_the_last_bit_after_a_reset) {
  SteppedSim run(short_ring_scene());
  run.advance(0.6, 0.01);
  const std::vector<double> before = flatten(run.sim.outputs());
  run.sim.reset();
  run.sim.initialise(0.0, 0.0);
  run.t = 0.0;
  run.count = 0;
  run.advance(0.6, 0.01);
  const std::vector<double> after = flatten(run.sim.outputs());
  EXPECT_TRUE(same_bits(before, after)) << first_difference(before, after);
}

TEST(Runs, do_not_depend_on_when_outputs_are_read) {
  SteppedSim often(short_ring_scene()), once(short_ring_scene());
  for (int i = 0; i < 60; ++i) {
    ASSERT_TRUE(often.step(0.01).ok());
    often.sim.outputs();
    often.sim.invalidate_outputs();
    often.sim.outputs();
    ASSERT_TRUE(once.step(0.01).ok());
  }
  const std::vector<double> a = flatten(often.sim.outputs()), b = flatten(once.sim.outputs());
  EXPECT_TRUE(same_bits(a, b)) << first_difference(a, b);
}

TEST(Outputs, are_the_same_bits_whichever_group_is_read_first) {
  SteppedSim whole(short_ring_scene()), other(short_ring_scene());
  for (int i = 0; i < 60; ++i) {
    ASSERT_TRUE(whole.step(0.01).ok());
    ASSERT_TRUE(other.step(0.01).ok());
    const OutputGroup first[] = {OutputGroup::kMomentum, OutputGroup::kLoops, OutputGroup::kStack};
    ASSERT_TRUE(other.sim.update(first[i % 3]).ok());
    ASSERT_TRUE(other.sim.calc_directional_derivative({}).ok());
    const std::vector<double> a = flatten(whole.sim.outputs()), b = flatten(other.sim.outputs());
    ASSERT_TRUE(same_bits(a, b)) << first_difference(a, b);
  }
}

TEST(Outputs, leave_sums_over_all_bodies_out_until_they_are_asked_for) {
  SteppedSim run(short_ring_scene());
  run.sim.outputs();
  const V before = run.sim.output_storage().momentum_linear;
  const V stack = run.sim.output_storage().stack_com;
  run.sim.inputs().vehicle[kChaser].force_ext.x() = 100.0;
  ASSERT_TRUE(run.step(0.1).ok());
  ASSERT_TRUE(run.sim.update(OutputGroup::kMain).ok());
  const Outputs& out = run.sim.output_storage();
  EXPECT_EQ(out.time, 0.1);
  EXPECT_EQ(out.momentum_linear, before);
  ASSERT_TRUE(run.sim.update(OutputGroup::kMomentum).ok());
  EXPECT_NEAR(out.momentum_linear.x() - before.x(), 10.0, 1e-6);
  EXPECT_EQ(out.stack_com, stack);
  ASSERT_TRUE(run.sim.update(OutputGroup::kStack).ok());
  EXPECT_NE(out.stack_com, stack);
}

/// Start states on a grid that offsets of 2^22 m and 2^12 m/s leave exact.
Scene round_start(Scene scene) {
  for (VehicleParameters& p : scene.vehicle) {
    for (int j = 0; j < 3; ++j) {
      p.position[j] = std::ldexp(std::round(std::ldexp(p.position[j], 24)), -24);
      p.velocity[j] = std::ldexp(std::round(std::ldexp(p.velocity[j], 34)), -34);
    }
  }
  return scene;
}

Scene offset(Scene scene, const V& position, const V& velocity) {
  for (VehicleParameters& p : scene.vehicle) {
    p.position += position;
    p.velocity += velocity;
  }
  return scene;
}

/// Largest difference of relative motion, ring and capture force between two runs over 1.5 s.
struct RelativeDifference {
  Residual position, velocity, force;
};

RelativeDifference compare(SteppedSim& a, SteppedSim& b, double end = 1.5, double h = 0.01) {
  RelativeDifference worst;
  while (a.t < end - 0.5 * h) {
    EXPECT_TRUE(a.step(h).ok()) << a.sim.status_text();
    EXPECT_TRUE(b.step(h).ok()) << b.sim.status_text();
    const Outputs &x = a.sim.outputs(), &y = b.sim.outputs();
    const std::string where = "t = " + std::to_string(a.t);
    worst.position.add((x.relative_position - y.relative_position).norm(), where);
    worst.position.add((x.ring_position - y.ring_position).norm(), where);
    worst.velocity.add((x.relative_velocity - y.relative_velocity).norm(), where);
    worst.velocity.add((x.relative_angular_velocity - y.relative_angular_velocity).norm(), where);
    worst.force.add((x.capture_force - y.capture_force).norm(), where);
  }
  EXPECT_GT(a.sim.outputs().time_of_contact, 0.0);
  return worst;
}

TEST(Frames, an_orbital_offset_that_is_exact_changes_no_bit_of_the_relative_motion) {
  const Scene near = round_start(short_ring_scene());
  SteppedSim a(near), b(offset(near, V(4194304, -2097152, 1048576), V(4096, 2048, -4096)));
  const RelativeDifference worst = compare(a, b);
  EXPECT_EQ(worst.position.value, 0.0);
  EXPECT_EQ(worst.velocity.value, 0.0);
  EXPECT_EQ(worst.force.value, 0.0);
}

TEST(Frames, an_orbital_offset_of_7000_km_and_7_5_km_per_s_costs_only_the_rounding_of_the_start) {
  // 7e6 m are stated to 9e-10 m, 7.5e3 m/s to 9e-13 m/s: that much the start differs.
  const Scene near = short_ring_scene();
  SteppedSim a(near), b(offset(near, V(7e6, 1e5, -3e5), V(-200.0, 7.5e3, 100.0)));
  const RelativeDifference worst = compare(a, b);
  EXPECT_RESIDUAL_BELOW(worst.position, 9e-8);    // measured 8.6e-9
  EXPECT_RESIDUAL_BELOW(worst.velocity, 1.4e-8);  // measured 1.4e-9
  EXPECT_RESIDUAL_BELOW(worst.force, 0.13);       // measured 0.013 [N]
}

TEST(Frames, gravity_leaves_the_relative_motion_of_two_free_vehicles_unchanged) {
  SteppedSim a(short_ring_scene()), b(short_ring_scene());
  b.sim.inputs().gravity = V(1.5, -8.2, 3.0);
  const V start = b.sim.outputs().vehicle[kTarget].position;
  const V velocity = b.sim.outputs().vehicle[kTarget].velocity;
  const RelativeDifference worst = compare(a, b);
  EXPECT_EQ(worst.position.value, 0.0);
  EXPECT_EQ(worst.velocity.value, 0.0);
  EXPECT_EQ(worst.force.value, 0.0);
  // Both fell alike.
  const V fall = 0.5 * 1.5 * 1.5 * V(1.5, -8.2, 3.0) + 1.5 * velocity;
  const V seen = b.sim.outputs().vehicle[kTarget].position - start;
  const V without = a.sim.outputs().vehicle[kTarget].position - start;
  EXPECT_LE((seen - without - fall + 1.5 * velocity).norm(),
            scaled_tolerance(4e-14));  // measured 3.8e-15
}

TEST(Runs, with_different_communication_steps_agree_within_the_tolerance) {
  Scene scene = short_ring_scene();
  scene.solver = {1e-9, 1e-11, 1e-11, 1e-9};
  SteppedSim reference(scene);
  reference.advance(1.5, 0.01);
  const Outputs& r = reference.sim.outputs();
  Residual position, velocity, peak;
  for (const double h : {0.0025, 0.025, 0.1, 0.5, 1.5}) {
    SteppedSim run(scene);
    run.advance(1.5, h);
    const Outputs& out = run.sim.outputs();
    const std::string where = "h = " + std::to_string(h);
    position.add((out.relative_position - r.relative_position).norm(), where);
    position.add((out.ring_position - r.ring_position).norm(), where);
    velocity.add((out.relative_velocity - r.relative_velocity).norm(), where);
    peak.add(out.capture_peak[Outputs::kCompression].value /
                     r.capture_peak[Outputs::kCompression].value -
                 1.0,
             where);
  }
  EXPECT_RESIDUAL_BELOW(position, 6e-10);  // measured 6.2e-11
  EXPECT_RESIDUAL_BELOW(velocity, 3e-10);  // measured 2.7e-11
  EXPECT_RESIDUAL_BELOW(peak, 9e-6);       // measured 9.1e-7
}

TEST(Runs, account_for_energy_and_momentum_through_contact_and_capture) {
  SteppedSim run(short_ring_scene());
  Residual energy, momentum;
  bool captured = false;
  while (run.t < 6.0) {
    ASSERT_TRUE(run.step(0.02).ok()) << run.sim.status_text();
    const Outputs& out = run.sim.outputs();
    energy.add(out.energy_residual, "t = " + std::to_string(run.t));
    momentum.add(out.momentum_residual, "t = " + std::to_string(run.t));
    captured = captured || out.captured;
  }
  EXPECT_GT(run.sim.outputs().energy_dissipated, 1.0);
  EXPECT_RESIDUAL_BELOW(energy, 7e-5);     // measured 6.7e-6 [J]
  EXPECT_RESIDUAL_BELOW(momentum, 5e-14);  // measured 5.0e-15
}

TEST(Outputs, are_finite_from_start_to_end) {
  for (const Scene& scene : {short_ring_scene(), minimal_scene()}) {
    SteppedSim run(scene);
    while (run.t < 5.0) {
      for (double value : flatten(run.sim.outputs(), true)) ASSERT_TRUE(std::isfinite(value));
      ASSERT_TRUE(run.step(0.02).ok()) << run.sim.status_text();
    }
    EXPECT_GT(run.sim.outputs().time_of_contact, 0.0);
  }
}

/// Bound that is announced under inputs held from the start, and when contact comes.
std::pair<double, double> find_contact_bound(Motion target, void (*load)(Inputs&)) {
  Scene scene = ring_scene();
  scene.motion[kTarget] = target;
  SteppedSim run(scene);
  load(run.sim.inputs());
  run.sim.invalidate_outputs();
  const double bound = run.sim.outputs().time_to_contact;
  while (run.t < 3.0 && run.sim.outputs().time_of_contact < 0.0) {
    EXPECT_TRUE(run.step(0.01).ok()) << run.sim.status_text();
  }
  return {bound, run.sim.outputs().time_of_contact};
}

TEST(Outputs, time_to_contact_is_a_lower_bound_in_free_drift_and_under_forces) {
  const auto free = find_contact_bound(Motion::kFree, [](Inputs&) {});
  EXPECT_GT(free.first, 0.5 * free.second);
  EXPECT_LE(free.first, free.second);
  const auto pushed = find_contact_bound(
      Motion::kFree, [](Inputs& in) { in.vehicle[kChaser].force_ext = V(2000, 0, 0); });
  EXPECT_LE(pushed.first, pushed.second);
}

TEST(Outputs, time_to_contact_is_a_lower_bound_under_torques) {
  const auto turned = find_contact_bound(
      Motion::kFree, [](Inputs& in) { in.vehicle[kChaser].torque_ext = V(0, 20000, 0); });
  EXPECT_LE(turned.first, turned.second);
}

TEST(Outputs, time_to_contact_is_a_lower_bound_when_one_vehicle_falls_onto_a_fixed_one) {
  const auto falls =
      find_contact_bound(Motion::kFixed, [](Inputs& in) { in.gravity = V(0.5, 0, 0); });
  EXPECT_LE(falls.first, falls.second);
}

/// The ring scene with a chaser that the host moves.
Scene driven_scene(Scene scene) {
  scene.motion[kChaser] = Motion::kDriven;
  return scene;
}

void drive(Inputs::Vehicle& in, const Outputs::Vehicle& at) {
  in.position = at.position;
  in.velocity = at.velocity;
  in.attitude = at.attitude;
  in.angular_velocity = at.angular_velocity;
}

TEST(RefusedSteps, with_a_bad_attitude_leave_everything_as_it_was) {
  const Scene scene = short_ring_scene();
  SteppedSim path(scene), plain(driven_scene(scene)), disturbed(driven_scene(scene));
  int refused = 0;
  for (int i = 0; i < 60; ++i) {
    for (SteppedSim* run : {&plain, &disturbed}) {
      drive(run->sim.inputs().vehicle[kChaser], path.sim.outputs().vehicle[kChaser]);
    }
    if (i % 7 == 3) {
      const std::vector<double> before = flatten(disturbed.sim.outputs());
      for (const Vec4<double>& bad : {Vec4<double>(0, 0, 0, 0), Vec4<double>(0.9, 0, 0, 0),
                                      Vec4<double>(std::nan(""), 0, 0, 1)}) {
        disturbed.sim.inputs().vehicle[kChaser].attitude = bad;
        const Status status = disturbed.step(0.01);
        EXPECT_EQ(status.code, StatusCode::kBadInput);
        EXPECT_NE(disturbed.sim.status_text().find("chaser.attitude"), std::string::npos);
        ++refused;
      }
      drive(disturbed.sim.inputs().vehicle[kChaser], path.sim.outputs().vehicle[kChaser]);
      disturbed.sim.invalidate_outputs();
      const std::vector<double> after = flatten(disturbed.sim.outputs());
      ASSERT_TRUE(same_bits(before, after)) << first_difference(before, after);
    }
    ASSERT_TRUE(path.step(0.01).ok());
    ASSERT_TRUE(plain.step(0.01).ok()) << plain.sim.status_text();
    ASSERT_TRUE(disturbed.step(0.01).ok()) << disturbed.sim.status_text();
    const std::vector<double> a = flatten(plain.sim.outputs());
    const std::vector<double> b = flatten(disturbed.sim.outputs());
    ASSERT_TRUE(same_bits(a, b)) << "t = " << plain.t << ", " << first_difference(a, b);
  }
  EXPECT_GT(refused, 20);
  EXPECT_GT(plain.sim.outputs().time_of_contact, 0.0);
}

TEST(RefusedSteps, under_a_load_that_is_no_number_leave_everything_as_it_was) {
  const Scene scene = short_ring_scene();
  SteppedSim plain(scene), disturbed(scene);
  int refused = 0;
  for (int i = 0; i < 60; ++i) {
    if (i % 7 == 3) {
      const std::vector<double> before = flatten(disturbed.sim.outputs());
      for (double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
        disturbed.sim.inputs().vehicle[kTarget].force_ext.y() = bad;
        const Status status = disturbed.step(0.01);
        EXPECT_FALSE(status.ok());
        ++refused;
      }
      disturbed.sim.inputs().vehicle[kTarget].force_ext.y() = 0.0;
      disturbed.sim.invalidate_outputs();
      const std::vector<double> after = flatten(disturbed.sim.outputs());
      EXPECT_TRUE(same_bits(before, after))
          << "t = " << plain.t << ", " << first_difference(before, after);
    }
    ASSERT_TRUE(plain.step(0.01).ok()) << plain.sim.status_text();
    ASSERT_TRUE(disturbed.step(0.01).ok()) << disturbed.sim.status_text();
    const std::vector<double> a = flatten(plain.sim.outputs());
    const std::vector<double> b = flatten(disturbed.sim.outputs());
    ASSERT_TRUE(same_bits(a, b)) << "t = " << plain.t << ", " << first_difference(a, b);
  }
  EXPECT_GT(refused, 10);
}

TEST(RefusedSteps, that_would_drive_a_vehicle_through_the_ring_leave_everything_as_it_was) {
  const Scene scene = short_ring_scene();
  SteppedSim path(scene), plain(driven_scene(scene)), disturbed(driven_scene(scene));
  for (int i = 0; i < 40; ++i) {
    for (SteppedSim* run : {&plain, &disturbed}) {
      drive(run->sim.inputs().vehicle[kChaser], path.sim.outputs().vehicle[kChaser]);
    }
    if (i == 20 || i == 30) {
      const std::vector<double> before = flatten(disturbed.sim.outputs());
      disturbed.sim.inputs().vehicle[kChaser].position.x() += 0.1;
      EXPECT_FALSE(disturbed.step(0.01).ok());
      EXPECT_NE(disturbed.sim.status_text(), "");
      drive(disturbed.sim.inputs().vehicle[kChaser], path.sim.outputs().vehicle[kChaser]);
      disturbed.sim.invalidate_outputs();
      const std::vector<double> after = flatten(disturbed.sim.outputs());
      EXPECT_TRUE(same_bits(before, after)) << first_difference(before, after);
    }
    ASSERT_TRUE(path.step(0.01).ok());
    ASSERT_TRUE(plain.step(0.01).ok());
    ASSERT_TRUE(disturbed.step(0.01).ok()) << disturbed.sim.status_text();
    const std::vector<double> a = flatten(plain.sim.outputs());
    const std::vector<double> b = flatten(disturbed.sim.outputs());
    ASSERT_TRUE(same_bits(a, b)) << "t = " << plain.t << ", " << first_difference(a, b);
  }
}

TEST(Thrust, starts_after_first_contact_and_its_delay) {
  SteppedSim run(short_ring_scene(), [](Parameters& p) {
    p.contact_thrust = 100.0;
    p.contact_thrust_delay = 0.233;
  });
  const V before = run.sim.outputs().momentum_linear;
  Residual impulse;
  int on = 0;
  while (run.t < 1.0) {
    ASSERT_TRUE(run.step(0.01).ok());
    const Outputs& out = run.sim.outputs();
    if (out.captured) break;
    const double onset = out.time_of_contact >= 0.0 ? out.time_of_contact + 0.233 : run.t + 1.0;
    const double seconds = std::max(0.0, run.t - onset);
    on += seconds > 0.0;
    const V gained = out.momentum_linear - before;
    if (seconds == 0.0) {
      EXPECT_EQ(out.energy_external, 0.0) << run.t;
      impulse.add(gained.norm(), "before, t = " + std::to_string(run.t));
    } else {
      impulse.add(gained.norm() - 100.0 * seconds, "after, t = " + std::to_string(run.t));
    }
  }
  EXPECT_GT(on, 10);
  EXPECT_RESIDUAL_BELOW(impulse, 2e-5);  // measured 2.0e-6 [N s]
}

TEST(Driven, along_its_own_free_path_a_vehicle_gives_nearly_the_free_run) {
  const Scene scene = short_ring_scene();
  SteppedSim path(scene), driven(driven_scene(scene));
  Residual target, force;
  double largest = 0.0;
  for (int i = 0; i < 150; ++i) {
    drive(driven.sim.inputs().vehicle[kChaser], path.sim.outputs().vehicle[kChaser]);
    ASSERT_TRUE(path.step(0.01).ok());
    ASSERT_TRUE(driven.step(0.01).ok()) << driven.sim.status_text();
    const Outputs &a = path.sim.outputs(), &b = driven.sim.outputs();
    const std::string where = "t = " + std::to_string(path.t);
    target.add((a.vehicle[kTarget].velocity - b.vehicle[kTarget].velocity).norm() / 0.1, where);
    force.add((a.capture_force - b.capture_force).norm(), where);
    largest = std::max(largest, a.capture_force.norm());
  }
  EXPECT_GT(largest, 100.0);
  // This host moves under the true loads, not under their means: its pose differs by H^2 a/12.
  EXPECT_RESIDUAL_BELOW(target, 2.6e-7);  // measured 2.6e-8 of the closing speed
  EXPECT_RESIDUAL_BELOW(force, 0.24);     // measured 0.019 [N]
}

/// A rigid body of the host under a force (N axes) and a torque (body axes) held over h.
Outputs::Vehicle fly_in_host(const VehicleParameters& p, const Outputs::Vehicle& from,
                             const V& force, const V& torque, double h) {
  const Mat3<double> I = make_symmetric(p.inertia), inverse = I.inverse();
  std::vector<double> y(from.attitude.data(), from.attitude.data() + 4);
  y.insert(y.end(), from.angular_velocity.data(), from.angular_velocity.data() + 3);
  const auto rates = [&](const double* s, double* d) {
    const Vec4<double> q(s[0], s[1], s[2], s[3]);
    const V w(s[4], s[5], s[6]);
    const Vec4<double> qdot = quat_rate<double>(q, w);
    const V wdot = inverse * (torque - w.cross(V(I * w)));
    for (int j = 0; j < 4; ++j) d[j] = qdot[j];
    for (int j = 0; j < 3; ++j) d[4 + j] = wdot[j];
  };
  for (int n = 0; n < 10; ++n) step_rk4<double>(rates, y, h / 10);
  Outputs::Vehicle to;
  to.velocity = from.velocity + h / p.mass * force;
  to.angular_velocity = V(y[4], y[5], y[6]);
  return to;
}

TEST(Driven, mean_loads_give_a_host_the_velocities_of_the_free_run) {
  for (int includes : {1, 2}) {
    Scene scene = short_ring_scene();
    scene.vehicle[kChaser].mass_includes_mechanism = includes;
    SteppedSim run(scene);
    const double h = 0.05;
    Residual velocity, rate;
    for (int i = 0; i < 40; ++i) {
      const std::array<Outputs::Vehicle, 2> before = run.sim.outputs().vehicle;
      ASSERT_TRUE(run.step(h).ok());
      for (int k : {kChaser, kTarget}) {
        const Outputs::Vehicle& now = run.sim.outputs().vehicle[k];
        const Outputs::Vehicle host =
            fly_in_host(scene.vehicle[k], before[k], now.force_mean, now.torque_mean, h);
        const std::string where = "step " + std::to_string(i) + ", vehicle " + std::to_string(k);
        velocity.add((host.velocity - now.velocity).norm(), where);
        rate.add((host.angular_velocity - now.angular_velocity).norm(), where);
      }
    }
    EXPECT_GT(run.sim.outputs().capture_peak[Outputs::kCompression].value, 50.0);
    EXPECT_RESIDUAL_BELOW(velocity, 1e-15);  // measured 3e-20 [m/s]: a few ulp
    EXPECT_RESIDUAL_BELOW(rate, 1.4e-7);     // measured 1.4e-8 [rad/s]
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
long count_in_steps(SteppedSim& run, double from, double to, double h, bool read) {
  run.advance(from, h);
  run.sim.outputs();
  return count_allocations([&] {
    while (run.t < to - 0.5 * h && run.step(h).ok()) {
      if (read) run.sim.outputs();
    }
  });
}

TEST(Memory, is_counted_where_it_is_allocated) {
  // volatile: a compiler may leave out allocations without effect.
  std::vector<double>* volatile made = nullptr;
  void* volatile raw = nullptr;
  const long count = count_allocations([&] {
    made = new std::vector<double>(100);
    raw = std::malloc(10);
  });
  EXPECT_GE(count, 3);
  std::free(raw);
  delete made;
}

TEST(Memory, is_not_allocated_by_steps_in_drift) {
  SteppedSim run(ring_scene());
  EXPECT_EQ(count_in_steps(run, 0.1, 1.5, 0.01, false), 0);
}

TEST(Memory, is_not_allocated_by_steps_in_contact) {
  SteppedSim run(short_ring_scene());
  EXPECT_EQ(count_in_steps(run, 0.03, 2.0, 0.01, false), 0);
}

TEST(Memory, is_not_allocated_by_outputs) {
  SteppedSim run(short_ring_scene());
  EXPECT_EQ(count_in_steps(run, 0.03, 2.0, 0.01, true), 0);
}

TEST(Memory, is_not_allocated_by_steps_with_bristle_friction) {
  Scene scene = short_ring_scene();
  scene.contact.law.friction_model = 2;
  SteppedSim run(scene);
  EXPECT_EQ(count_in_steps(run, 0.03, 1.0, 0.01, false), 0);
}
#endif

}  // namespace
}  // namespace dockloop
