// Faces, hooks, pushers and rigid joint between A and P.
// 1. the preloaded joint of 12 hooks: opening load, stiffness below and above it, load of a hook,
//    energy (closed forms);
// 2. in every mode and at random poses: power of the wrench = -rate of the energy - dissipation +
//    work, by differences in 32 digits; the tangent is the derivative by dual numbers;
// 3. separation by pushers, in the middle and off the centre; hooks opened slowly and at once;
// 4. the rigid joint: loss, twist and impulse of the stored merge; opening changes nothing;
// 5. energy and momentum through a whole sequence of commands; hooks wait for the opening;
// 6. a stack without loads drifts as an integrated one; saved states repeat the same bits in every
//    state, and a step does not allocate;
// 7. parameters out of range are refused.
#include "docking/hard_dock.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "sim/sim_state.hpp"
#include "unit/allocations.hpp"
#include "unit/contact_test_support.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;

constexpr double kReduced25t350t = 25e3 * 350e3 / 375e3;  // [kg]

json make_interface() {
  return json::parse(R"({
    "faces": {"radius": 0.65, "stiffness": 2e8, "toe": 1e-7},
    "hooks": {"radius": 0.7, "stiffness": 2e6, "preload": 3000, "toe": 1e-7, "play": 0.003,
              "close_time": 5, "rows": [{"count": 6}, {"count": 6, "azimuth": 0.5,
                                                       "close_delay": 1}]},
    "pushers": {"count": 4, "radius": 0.6, "stroke": 0.03, "preload": 250, "stiffness": 4000}})");
}

HardDock read(const json& interface) {
  json scene = json::parse(read_test_file("scene_minimal.json"));
  scene["mechanism"] = {{"name", "docked"}, {"interface", interface}};
  return read_scene(scene.dump(), "test").hard_dock;
}

RelativeMotion<double> at_opening(double opening) {
  RelativeMotion<double> motion;
  motion.p = V(opening, 0, 0);
  return motion;
}

HardDockResult<double> evaluate(const HardDock& dock, const HardDockState& state, double opening) {
  HardDockResult<double> result;
  calc_hard_dock<double>(dock, state, 100.0, at_opening(opening), result);
  return result;
}

/// Opening at which the interfaces push with this force.
double find_opening(const HardDock& dock, const HardDockState& state, double force) {
  double low = -0.01, high = 0.01;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (evaluate(dock, state, middle).on_passive.f[0] > force ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

TEST(HardDock, preloaded_joint) {
  json interface = make_interface();
  interface.erase("pushers");
  interface["hooks"]["rows"] = {{{"count", 12}}};
  const HardDock dock = read(interface);
  HardDockState state = make_start(dock);
  state.row[0].mode = HookMode::kClosed;
  const auto tension_of = [&](double load) {
    return evaluate(dock, state, find_opening(dock, state, -load)).hook_force[3];
  };
  const double closed = find_opening(dock, state, 0.0);
  const HardDockResult<double> at_rest = evaluate(dock, state, closed);
  EXPECT_NEAR(closed, -0.18e-3, 1e-7);  // the toe
  EXPECT_NEAR(at_rest.hook_force[0], 3000.0, 1e-6);
  EXPECT_NEAR(at_rest.face_force, 36e3, 1e-5);
  EXPECT_NEAR(at_rest.energy, 30.24, 1e-5);
  // 12 x 3000 (1 + 12 x 2e6/2e8) = 40 320 N opens the faces; 2.24e8 N/m below, 2.4e7 N/m above.
  EXPECT_NEAR(tension_of(20e3), 3178.571, 1e-3);
  const auto stiffness_at = [&](double load) {
    const double h = 100.0;
    return 2 * h / (find_opening(dock, state, -load - h) - find_opening(dock, state, -load + h));
  };
  EXPECT_NEAR(stiffness_at(20e3) / 2.24e8, 1.0, 1e-6);
  EXPECT_NEAR(stiffness_at(60e3) / 2.4e7, 1.0, 1e-6);
  EXPECT_GT(evaluate(dock, state, find_opening(dock, state, -40.2e3)).face_force, 0.0);
  EXPECT_EQ(evaluate(dock, state, find_opening(dock, state, -40.4e3)).face_force, 0.0);
}

/// A state in which every row and the pushers are in some mode, at t = 100 s.
HardDockState draw_state(TestRandom& random, int i) {
  HardDockState state;
  for (HookRowState& row : state.row) {
    row.mode = static_cast<HookMode>(1 + (i + (&row - &state.row[0])) % 4);
    const double ramp = row.mode == HookMode::kOpening ? 0.5 : 5.0;
    row.since = 100.0 - ramp * random.uniform(0.05, 0.95);
    row.end = random.uniform(-0.002, 0.0);
  }
  state.pushers = {i % 2 == 0, 100.0 - 0.05 * random.uniform(0.05, 1.5), random.uniform(0, 1)};
  return state;
}

RelativeMotion<double> draw_motion(TestRandom& random) {
  RelativeMotion<double> x;
  x.R = rotation_of(random.vector(0.003));
  x.p = V(random.uniform(-0.002, 0.006), random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02));
  x.w = random.vector(0.01);
  x.v = random.vector(0.02);
  return x;
}

json make_soft_interface() {
  json interface = make_interface();
  interface["faces"].update({{"damping", 3.0}, {"toe", 1e-4}});
  interface["hooks"].update({{"damping", 2.0}, {"toe", 1e-4}});
  return interface;
}

TEST(HardDock, power_is_minus_energy_rate_minus_dissipation_plus_work) {
  const HardDock dock = read(make_soft_interface());
  TestRandom random(41);
  Worst worst;
  int hooked = 0, pressed = 0;
  for (int i = 0; i < 4000; ++i) {
    const RelativeMotion<double> x = draw_motion(random);
    const HardDockState state = draw_state(random, i);
    const Extended h = 1e-8L;
    const auto energy = [&](Extended step) {
      RelativeMotion<Extended> moved = cast_motion<Extended>(x);
      moved.R = quat_to_matrix<Extended>(quat_exp<Extended>(moved.w * step)) * moved.R;
      moved.p += moved.v * step;
      HardDockResult<Extended> result;
      calc_hard_dock<Extended>(dock, state, 100.0L + step, moved, result);
      return result.energy;
    };
    HardDockResult<double> r;
    calc_hard_dock<double>(dock, state, 100.0, x, r);
    EXPECT_GE(r.dissipation, 0.0);
    const double rate = static_cast<double>((energy(h) - energy(-h)) / (2 * h));
    hooked += r.hook_force[0] > 0.0;
    pressed += r.face_force > 0.0;
    worst.add(
        (find_power(r.on_passive, x) + rate + r.dissipation - r.work) / (1 + r.on_passive.f.norm()),
        i);
  }
  EXPECT_GT(hooked, 1000);
  EXPECT_GT(pressed, 1000);
  EXPECT_WORST_BELOW(worst, 2e-11);
}

TEST(HardDock, tangent_is_the_derivative_but_for_what_turns) {
  const HardDock dock = read(make_soft_interface());
  TestRandom random(42);
  Worst worst;
  for (int i = 0; i < 500; ++i) {
    RelativeMotion<double> x = draw_motion(random);
    const HardDockState state = draw_state(random, i);
    InterfaceTangent tangent;
    add_hard_dock_tangent(dock, state, 100.0, x, tangent);
    for (int column = 0; column < 12; ++column) {
      RelativeMotion<Derivative> seeded = cast_motion<Derivative>(x);
      const int axis = column % 3;
      const V unit = V::Unit(axis);
      const auto seed = [&](auto& target, const auto& slope) {
        for (Eigen::Index k = 0; k < slope.size(); ++k) target(k).d[0] = slope(k);
      };
      if (column < 3) seed(seeded.p, unit);
      if (column >= 3 && column < 6) seed(seeded.R, Mat3<double>(skew<double>(unit) * x.R));
      if (column >= 6 && column < 9) seed(seeded.v, unit);
      if (column >= 9) seed(seeded.w, unit);
      HardDockResult<Derivative> result;
      calc_hard_dock<Derivative>(dock, state, Derivative(100.0), seeded, result);
      Vec6<double> exact;
      for (int k = 0; k < 3; ++k) {
        exact[k] = result.on_passive.f[k].d[0];
        exact[3 + k] = result.on_passive.t[k].d[0];
      }
      const Mat6<double>& map = column < 6 ? tangent.stiffness : tangent.damping;
      // Left out: the load itself, which turns with P.
      const double turning =
          column < 6 ? 3.0 * (result.on_passive.f.norm().value + result.on_passive.t.norm().value)
                     : 0.0;
      worst.add(
          std::max(0.0, (map.col(column % 6) - exact).norm() - turning) / (1e3 + exact.norm()), i);
    }
  }
  EXPECT_WORST_BELOW(worst, 2e-2);  // dampers: the rate changes when the axis turns
}

// ---------------------------------------------------------------- whole dockings

/// Two free vehicles whose interfaces are `opening` apart, at rest, without other hardware.
Scene make_scene(const json& interface, double opening, double closing_speed = 0.0) {
  json scene = json::parse(read_test_file("scene_minimal.json"));
  scene["mechanism"] = {{"name", "docked"}, {"interface", interface}};
  scene["chaser"]["velocity"] = {closing_speed, 0, 0};
  scene["target"]["position"] = {19.0 + opening, 0, 0};
  scene["solver"] = {
      {"rtol", 1e-9}, {"atol_position", 1e-12}, {"atol_velocity", 1e-12}, {"atol_energy", 1e-10}};
  return read_scene(scene.dump(), "test");
}

constexpr double kShortest = 1e-9;  // [s] step

struct DockedRun {
  explicit DockedRun(const Scene& scene) : sim(share(scene)) { sim.initialise(0.0, 1e-9); }
  void go(double until, double h = 0.01) {
    while (time < until - kShortest / 2) {
      const double step = std::min(h, until - time);
      ASSERT_TRUE(sim.step(time, step).ok()) << sim.status_text();
      time += step;
    }
  }
  /// Takes effect at the start of a step, which is very short.
  void command(HardDockCommand what) {
    sim.inputs().hard_dock_command = static_cast<int>(what);
    go(time + kShortest);
  }
  const Outputs& out() { return sim.outputs(); }
  DockingSim sim;
  double time = 0.0;
};

json only(const char* part) { return {{part, make_interface()[part]}}; }

TEST(HardDocking, pushers_separate_the_vehicles) {
  const json oracle = read_contact_data("mechanism_oracles.json")["pushers"];
  json interface = only("pushers");
  interface["pushers"]["take_up"] = 1e-7;
  DockedRun run(make_scene(interface, 0.0));
  EXPECT_NEAR(run.out().energy_potential, 4 * 9.3, 1e-3);
  run.go(oracle["time"]);
  EXPECT_NEAR(run.out().relative_axial, 0.03, 1e-7);
  run.go(2.0);
  EXPECT_NEAR(run.out().relative_velocity[0], oracle["separation_speed"], 1e-7);
  EXPECT_NEAR(run.out().vehicle[kChaser].velocity[0], oracle["chaser_speed"], 1e-7);
  EXPECT_NEAR(run.out().vehicle[kTarget].velocity[0], oracle["target_speed"], 1e-7);
  EXPECT_LT(std::abs(run.out().energy_residual), 3e-5);  // its force ends within 0.1 um
  EXPECT_EQ(run.out().energy_potential, 0.0);
}

TEST(HardDocking, a_pusher_off_the_centre_turns_the_vehicles) {
  const json oracle =
      read_contact_data("mechanism_oracles.json")["pushers"]["single_pusher_at_0.60"];
  json interface = only("pushers");
  interface["pushers"].update({{"count", 1}, {"take_up", 1e-5}});
  DockedRun run(make_scene(interface, 0.0));
  run.go(3.0);
  // The oracle leaves out the turn during the stroke: measured 6e-3.
  EXPECT_NEAR(run.out().relative_velocity[0] / double(oracle["centre_speed"]), 1.0, 1e-2);
  EXPECT_NEAR(
      std::abs(run.out().vehicle[kChaser].angular_velocity[2]) / double(oracle["chaser_rate"]), 1.0,
      1e-2);
  EXPECT_NEAR(
      std::abs(run.out().vehicle[kTarget].angular_velocity[2]) / double(oracle["target_rate"]), 1.0,
      1e-2);
  EXPECT_LT(std::abs(run.out().energy_residual), 1e-6);  // its force grows within 10 um
  EXPECT_LT(run.out().momentum_residual, 1e-12);
}

TEST(HardDocking, hooks_opened_at_once_leave_the_energy_of_the_faces) {
  json interface = make_interface();
  interface.erase("pushers");
  // Closing takes 5 s, far longer than an oscillation of 0.07 s.
  for (const double open_time : {1e-4, 0.5, 3.0}) {
    interface["hooks"]["open_time"] = open_time;
    Scene scene = make_scene(interface, 0.0);
    DockedRun run(scene);
    run.command(HardDockCommand::kCloseHooks);
    run.go(8.0);
    EXPECT_EQ(run.out().hooks_closed, 12);
    EXPECT_NEAR(run.out().energy_potential, 30.24, 0.05);
    EXPECT_NEAR(run.out().energy_drive_work, 30.24, 0.05);
    run.command(HardDockCommand::kOpenHooks);
    run.go(12.0);
    EXPECT_EQ(run.out().hooks_closed, 0);
    const double speed = run.out().relative_velocity[0];
    const double left = 0.5 * kReduced25t350t * speed * speed;
    if (open_time == 1e-4) {
      EXPECT_NEAR(speed, 0.016664, 2e-4);  // sqrt(2 x 3.24 J/m)
      EXPECT_NEAR(left, 3.24, 0.05);
    } else {
      EXPECT_LT(left, 0.05);
    }
    EXPECT_LT(std::abs(run.out().energy_residual), 3e-6);
  }
}

TEST(HardDocking, energy_and_momentum_through_every_command) {
  DockedRun run(make_scene(make_soft_interface(), 0.02, 0.02));
  const auto check = [&](const char* when) {
    EXPECT_LT(std::abs(run.out().energy_residual), 3e-5) << when;  // of 100 J in play
    EXPECT_LT(run.out().momentum_residual, 1e-12) << when;
  };
  run.command(HardDockCommand::kPushersOff);  // they would keep the interfaces apart
  run.command(HardDockCommand::kCloseHooks);
  EXPECT_EQ(run.out().hook_force[0], 0.0);
  run.go(0.5);
  check("closing in");
  run.go(12.0);
  EXPECT_EQ(run.out().hooks_closed, 12);
  EXPECT_LT(run.out().relative_velocity.norm(), 1e-4);
  EXPECT_NEAR(run.out().hook_force[0], 3000.0, 5.0);
  check("hooks closed");
  run.command(HardDockCommand::kPushersOn);
  run.go(13.0);
  check("pushers on");
  const double work = run.out().energy_drive_work;
  EXPECT_GT(work, 60.0);
  const double before = run.out().energy_kinetic;
  run.command(HardDockCommand::kJoin);
  EXPECT_TRUE(run.out().joint_rigid);
  EXPECT_LE(run.out().energy_kinetic, before);
  check("joined");
  run.go(300.0, 10.0);
  check("stack");
  EXPECT_EQ(run.out().relative_velocity.norm(), 0.0);
  run.command(HardDockCommand::kRelease);
  check("released");
  run.go(301.0);
  check("elastic again");
  EXPECT_LT(run.out().relative_velocity.norm(), 1e-4);
  run.command(HardDockCommand::kOpenHooks);
  run.go(310.0);
  check("separated");
  EXPECT_GT(run.out().relative_axial, 0.2);
  EXPECT_NEAR(run.out().relative_velocity[0], 0.0565, 1e-3);
}

TEST(HardDocking, hooks_wait_for_the_opening) {
  json interface = make_soft_interface();
  interface["pushers"]["on_at_start"] = false;
  DockedRun run(make_scene(interface, 0.02, 0.02));
  run.command(HardDockCommand::kCloseHooks);
  run.go(0.8);  // 4 mm apart: play is 3 mm
  SavedSim saved;
  run.sim.save(saved);
  EXPECT_EQ(saved.snapshot.state.discrete.hard_dock.row[0].mode, HookMode::kOpen);
  run.go(0.9);
  run.sim.save(saved);
  const HardDockState& state = saved.snapshot.state.discrete.hard_dock;
  EXPECT_EQ(state.row[0].mode, HookMode::kClosing);
  EXPECT_NEAR(state.row[0].since, 0.85, 1e-9);
  EXPECT_NEAR(state.row[1].since - state.row[0].since, 1.0, 1e-12);
}

TEST(HardDocking, rigid_joint_is_the_stored_merge) {
  const json merge = read_contact_data("mechanism_oracles.json")["merge"];
  json scene = json::parse(read_test_file("scene_minimal.json"));
  scene["mechanism"] = {{"name", "docked"}, {"interface", only("faces")}};
  const char* names[] = {"chaser", "target"};
  for (int i : {kChaser, kTarget}) {
    json& vehicle = scene[names[i]];
    vehicle["mass"] = merge["m"][i];
    vehicle["inertia"] = {merge["inertia_diag"][i][0],
                          merge["inertia_diag"][i][1],
                          merge["inertia_diag"][i][2],
                          0,
                          0,
                          0};
    vehicle["position"] = merge["com"][i];
    vehicle["velocity"] = merge["v"][i];
    vehicle["angular_velocity"] = merge["w"][i];
    V to_joint = -to_vec3(merge["com"][i]);
    if (i == kTarget) to_joint[0] += 0.01;  // apart: no force acts
    vehicle["interface_position"] = {to_joint[0], to_joint[1], to_joint[2]};
  }
  DockedRun run(read_scene(scene.dump(), "test"));
  const double before_merge = run.out().energy_kinetic;  // in a frame of its own
  const V linear = run.out().momentum_linear, angular = run.out().momentum_angular;
  const V before = run.out().relative_position;
  run.command(HardDockCommand::kJoin);
  const V relative = run.out().relative_position;
  EXPECT_LT((relative - before).norm(), 1e-14);
  const auto check = [&](double tolerance) {
    EXPECT_NEAR(run.out().energy_dissipated_hard_dock, merge["loss"], 1e-12);
    EXPECT_NEAR(before_merge - run.out().energy_kinetic, merge["loss"], 1e-12);
    for (int i : {kChaser, kTarget}) {
      const Outputs::Vehicle& vehicle = run.out().vehicle[i];
      EXPECT_LT((vehicle.angular_velocity - to_vec3(merge["w_after"])).norm(), tolerance);
    }
    EXPECT_LT((run.out().momentum_linear - linear).norm(), 1e-12 * linear.norm());
    EXPECT_LT((run.out().momentum_angular - angular).norm(), 1e-12 * angular.norm());
  };
  check(1e-17);
  // Momentum that the target received = impulse at the joint.
  const Outputs::Vehicle& target = run.out().vehicle[kTarget];
  const V impulse = 350e3 * (target.velocity - to_vec3(merge["v"][1]));
  for (int j = 0; j < 3; ++j) EXPECT_NEAR(impulse[j], merge["impulse_on_2_at_joint"][j], 1e-8);
  // Hours as one body, then two bodies with the common twist.
  run.go(7200.0, 600.0);
  EXPECT_EQ(run.out().relative_position, relative);
  const double kinetic = run.out().energy_kinetic;
  run.command(HardDockCommand::kRelease);
  EXPECT_FALSE(run.out().joint_rigid);
  EXPECT_NEAR(run.out().energy_kinetic, kinetic, 1e-14);
  EXPECT_LT(run.out().relative_angular_velocity.norm(), 1e-15);
  run.go(7200.0 + 1.0);
  EXPECT_LT(std::abs(run.out().energy_residual), 1e-9);
  EXPECT_LT(run.out().momentum_residual, 1e-13);
}

TEST(HardDocking, a_stack_under_loads_turns_as_one_body) {
  json interface = make_soft_interface();
  interface["pushers"]["on_at_start"] = false;
  DockedRun run(make_scene(interface, 0.0));
  run.command(HardDockCommand::kCloseHooks);
  run.go(8.0);
  run.command(HardDockCommand::kJoin);
  run.sim.inputs().vehicle[kChaser].force_ext = V(300, 40, -20);
  run.sim.inputs().vehicle[kTarget].torque_ext = V(500, -900, 400);
  run.go(40.0, 1.0);
  EXPECT_LT(std::abs(run.out().energy_residual), 1e-6);
  EXPECT_LT(run.out().momentum_residual, 1e-12);
  EXPECT_NEAR(run.out().momentum_linear[0], 300.0 * 32.0, 1e-6);
  // The joint carries the share of the target: 350/375 of the thrust.
  EXPECT_NEAR(run.out().joint_force[0], 300.0 * 350.0 / 375.0, 0.5);
  EXPECT_NEAR(run.out().vehicle[kTarget].force[0], run.out().joint_force[0], 0.5);
}

TEST(HardDocking, a_stack_without_loads_drifts_as_an_integrated_one) {
  const auto run = [](int flight) {
    Scene scene = make_scene(make_soft_interface(), 0.0);
    scene.vehicle[kChaser].angular_velocity = V(0.002, -0.003, 0.004);
    auto made = std::make_unique<DockedRun>(scene);
    made->sim.reset();
    made->sim.parameters().flight = flight;
    made->sim.initialise(0.0, 1e-9);
    made->command(HardDockCommand::kJoin);
    made->go(600.0, 50.0);
    return made;
  };
  const auto drifted = run(kQuiescent), integrated = run(kIntegrated);
  for (int i : {kChaser, kTarget}) {
    const Outputs::Vehicle &a = drifted->out().vehicle[i], &b = integrated->out().vehicle[i];
    EXPECT_LT((a.position - b.position).norm(), 1e-6);
    EXPECT_LT((a.attitude - b.attitude).norm(), 1e-7);
    EXPECT_LT((a.angular_velocity - b.angular_velocity).norm(), 1e-9);
  }
  EXPECT_LT(drifted->out().solver_rhs_evaluations, 100);
}

TEST(HardDocking, saved_states_repeat_the_same_bits) {
  using C = HardDockCommand;
  const std::vector<std::pair<double, std::optional<C>>> plan = {
      {0.0, C::kPushersOff}, {0.02, C::kCloseHooks}, {0.5, std::nullopt},   {1.2, std::nullopt},
      {3.0, std::nullopt},   {9.0, C::kPushersOn},   {9.03, std::nullopt},  {10.0, C::kJoin},
      {12.0, std::nullopt},  {15.0, C::kRelease},    {16.0, C::kOpenHooks}, {16.2, std::nullopt},
      {18.0, std::nullopt}};
  DockedRun run(make_scene(make_soft_interface(), 0.02, 0.02));
  DockingSim other(run.sim.shared_scene());
  SavedSim saved;
  for (const auto& [time, command] : plan) {
    run.go(time, 0.05);
    if (command) run.command(*command);
    run.sim.save(saved);
    other.load(through_bytes(saved));
    ASSERT_TRUE(run.sim.step(run.time, 0.013).ok());
    ASSERT_TRUE(other.step(run.time, 0.013).ok());
    run.time += 0.013;
    EXPECT_TRUE(same_bits(flatten(run.out(), true), flatten(other.outputs(), true)))
        << "after " << time << " s";
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(HardDocking, does_not_allocate) {
  DockedRun run(make_scene(make_soft_interface(), 0.02, 0.02));
  const auto step = [&] {
    ASSERT_TRUE(run.sim.step(run.time, 0.05).ok());
    run.time += 0.05;
  };
  step();
  using C = HardDockCommand;
  for (const C command :
       {C::kPushersOff, C::kCloseHooks, C::kPushersOn, C::kJoin, C::kRelease, C::kOpenHooks}) {
    EXPECT_EQ(count_allocations([&] {
                run.command(command);
                for (int i = 0; i < 40; ++i) step();
              }),
              0);
  }
}
#endif

TEST(HardDocking, a_joint_that_is_not_possible_is_refused) {
  Scene scene = make_scene(make_interface(), 0.1);
  scene.motion[kTarget] = Motion::kFixed;
  DockedRun run(scene);
  run.sim.inputs().hard_dock_command = static_cast<int>(HardDockCommand::kJoin);
  EXPECT_FALSE(run.sim.step(0.0, 0.1).ok());
  EXPECT_NE(run.sim.status_text().find("two vehicles that move"), std::string::npos);
  run.sim.inputs().hard_dock_command = static_cast<int>(HardDockCommand::kNone);
  run.go(0.1);
}

struct Malformed {
  const char* member;
  json value;
  const char* message;
};

TEST(HardDock, parameters_out_of_range_are_refused) {
  const std::vector<Malformed> cases = {
      {"/faces/count", 2, "count must be 3 or more"},
      {"/faces/radius", 0, "must be above 0"},
      {"/faces/stiffness", -1, "must be above 0"},
      {"/faces/toe", 0, "faces.toe is 0; it must be above 0"},
      {"/hooks/rows", json::array(), "at least one entry in 'rows'"},
      {"/hooks/rows/0/count", 30, "count"},
      {"/hooks/preload", 0.01, "increase preload"},
      {"/hooks/play", -0.001, "must be above 0"},
      {"/hooks/open_time", 0, "open_time is 0; it must be above 0"},
      {"/hooks/rows/0/close_delay", -1, "close_delay"},
      {"/pushers/stroke", 0, "must be above 0"},
      {"/pushers/take_up", 0.04, "take_up is 0.04 m; it must not exceed stroke, 0.03 m"},
      {"/pushers/ramp", 0, "ramp is 0; it must be above 0"},
      {"/pushers/on_at_start", "yes", "must be true or false"},
  };
  for (const Malformed& at : cases) {
    json interface = make_interface();
    interface[json::json_pointer(at.member)] = at.value;
    std::string text;
    try {
      read(interface);
    } catch (const ModelError& error) {
      text = error.what();
    }
    EXPECT_NE(text.find(at.message), std::string::npos) << at.member << ": " << text;
  }
  json interface = make_interface();
  interface.erase("faces");
  EXPECT_THROW(read(interface), ModelError);
  interface = make_interface();
  interface["hooks"]["rows"] = {{{"count", 20}}, {{"count", 5}}};
  EXPECT_THROW(read(interface), ModelError);
  EXPECT_THROW(read(json::object()), ModelError);
}

}  // namespace
}  // namespace dockloop
