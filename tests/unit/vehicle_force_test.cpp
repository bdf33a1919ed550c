// Forces between the vehicles: springs, tethers, magnets, tables.
// 1. of every kind at random poses: power of the wrench = -rate of the energy - dissipation, by
//    differences in 32 digits; the tangent is the derivative of the wrench;
// 2. magnets: the published force on the axis, no net torque of the pair, the exact energy of a
//    table between its rows;
// 3. two masses on a spring: frequency and energy of the closed form, by each method; a tether is
//    taut and slack; magnets conserve angular momentum; 28 digits in a reference solution;
// 4. free vehicles do not drift past a force; saved states repeat the same bits; no allocation;
// 5. members out of range are refused.
#include "docking/vehicle_force.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "compare/extended_precision.hpp"
#include "sim/sim_state.hpp"
#include "unit/allocations.hpp"
#include "unit/contact_test_support.hpp"
#include "unit/random_docking.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;
using L = Extended;

const json kSpring = json::parse(R"({"type": "spring", "stiffness": 800, "damping": 30,
  "free_length": 0.2, "chaser_point": [0, 0.1, 0], "target_point": [0.05, -0.1, 0.2]})");
const json kTether = json::parse(R"({"type": "tether", "stiffness": 900, "damping": 40,
  "free_length": 0.3, "toe": 0.1, "chaser_point": [0, 0.1, 0], "target_point": [0.05, 0, 0.2]})");
const json kDipoles = json::parse(R"({"type": "dipoles", "size": 0.02,
  "chaser_moment": [300, 40, -20], "target_moment": [200, -100, 30],
  "chaser_point": [0, 0.02, 0], "target_point": [0.01, 0, 0.03]})");
const json kTable = json::parse(R"({"type": "table", "gap": [0.05, 0.1, 0.25, 0.5],
  "offset": [0, 0.1, 0.2, 0.4], "target_point": [0.01, 0, 0.03], "scale": 1.5,
  "force": [[-90, -40, -10, 0], [-70, -38, -8, 0], [-20, -21, -7, 0], [3, -6, -3, 0]]})");
const json kAll = {kSpring, kTether, kDipoles, kTable};

json only(const json& force) { return json::array({force}); }

/// Two free vehicles of 50 kg and 80 kg, origins of A and P `gap` apart, without other hardware.
json make_scene(const json& forces, double gap = 0.3) {
  json scene = json::parse(read_test_file("scene_minimal.json"));
  scene["mechanism"] = {{"name", "none"}};
  scene["force"] = forces;
  const double mass[2] = {50.0, 80.0}, arm[2] = {0.3, -0.4};
  for (int i : {kChaser, kTarget}) {
    json& vehicle = scene[i == kChaser ? "chaser" : "target"];
    vehicle["mass"] = mass[i];
    vehicle["inertia"] = {2, 3, 3.5, 0.1, 0, 0.2};
    vehicle["interface_position"] = {arm[i], 0, 0};
    vehicle["position"] = {i == kChaser ? 0.0 : 0.7 + gap, 0, 0};
    vehicle["velocity"] = {0, 0, 0};
  }
  scene["solver"] = {
      {"rtol", 1e-12}, {"atol_position", 1e-14}, {"atol_velocity", 1e-14}, {"atol_energy", 1e-13}};
  return scene;
}

std::vector<VehicleForce> read(const json& forces) {
  return read_scene(make_scene(forces).dump(), "test").forces;
}

RelativeMotion<double> draw_motion(TestRandom& random) {
  RelativeMotion<double> x;
  x.R = rotation_of(random.vector(0.5));
  x.p = V(random.uniform(0.06, 0.6), random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2));
  x.w = random.vector(0.3);
  x.v = random.vector(0.5);
  return x;
}

class VehicleForces : public ::testing::TestWithParam<int> {};

TEST_P(VehicleForces, power_is_minus_energy_rate_minus_dissipation) {
  const std::vector<VehicleForce> forces = read(only(kAll[static_cast<size_t>(GetParam())]));
  TestRandom random(51);
  Worst worst;
  int loaded = 0;
  for (int i = 0; i < 1000; ++i) {
    const RelativeMotion<double> x = draw_motion(random);
    const L h = 1e-7L;
    const auto energy = [&](L step) {
      RelativeMotion<L> moved = cast_motion<L>(x);
      moved.R = quat_to_matrix<L>(quat_exp<L>(moved.w * step)) * moved.R;
      moved.p += moved.v * step;
      return sum_vehicle_forces<L>(forces, moved).energy;
    };
    const VehicleForceLoad<double> load = sum_vehicle_forces<double>(forces, x);
    EXPECT_GE(load.dissipation, 0.0);
    loaded += !load.on_passive.f.isZero(0.0);
    const double rate = to_double((energy(h) - energy(-h)) / (2 * h));
    worst.add(
        (find_power(load.on_passive, x) + rate + load.dissipation) / (1 + load.on_passive.f.norm()),
        i);
  }
  EXPECT_GT(loaded, 500);
  EXPECT_WORST_BELOW(worst, 1e-11);
}

TEST_P(VehicleForces, tangent_is_the_derivative) {
  const std::vector<VehicleForce> forces = read(only(kAll[static_cast<size_t>(GetParam())]));
  TestRandom random(52);
  Worst worst;
  for (int i = 0; i < 200; ++i) {
    const RelativeMotion<double> x = draw_motion(random);
    InterfaceTangent tangent;
    add_vehicle_force_tangent(forces, x, tangent);
    for (int column = 0; column < 12; ++column) {
      const auto find_load = [&](L step) {
        RelativeMotion<L> moved = cast_motion<L>(x);
        const Vec3<L> along = V::Unit(column % 3).cast<L>() * step;
        if (column < 3) moved.p += along;
        if (column / 3 == 1) moved.R = quat_to_matrix<L>(quat_exp<L>(along)) * moved.R;
        if (column / 3 == 2) moved.v += along;
        if (column >= 9) moved.w += along;
        const Wrench<L> load = sum_vehicle_forces<L>(forces, moved).on_passive;
        Vec6<L> all;
        all << load.f, load.t;
        return all;
      };
      const L h = 1e-9L;
      const Vec6<L> slope = (find_load(h) - find_load(-h)) / (2 * h);
      const Mat6<double>& map = column < 6 ? tangent.stiffness : tangent.damping;
      const Vec6<double> found = map.col(column % 6);
      worst.add(to_double((found.cast<L>() - slope).norm() / (1 + slope.norm())), i);
    }
  }
  EXPECT_WORST_BELOW(worst, 1e-11);
}

INSTANTIATE_TEST_SUITE_P(kinds, VehicleForces, ::testing::Range(0, 4),
                         [](const ::testing::TestParamInfo<int>& at) {
                           return kAll[static_cast<size_t>(at.param)]["type"].get<std::string>();
                         });

TEST(Dipoles, follow_the_published_force_on_the_axis) {
  json dipoles = kDipoles;
  dipoles.update({{"size", 1e-9},
                  {"chaser_moment", {12, 0, 0}},
                  {"target_moment", {15, 0, 0}},
                  {"chaser_point", {0, 0, 0}},
                  {"target_point", {0, 0, 0}}});
  for (const double r : {0.05, 0.1, 1.0}) {
    RelativeMotion<double> x;
    x.p = V(r, 0, 0);
    const double found = sum_vehicle_forces<double>(read(only(dipoles)), x).on_passive.f[0];
    const double mu0 = 4e-7 * static_cast<double>(EIGEN_PI);
    const double known = -3 * mu0 * 12 * 15 / (2 * static_cast<double>(EIGEN_PI) * r * r * r * r);
    EXPECT_NEAR(found / known, 1.0, 1e-14);
  }
}

TEST(ForceTable, has_its_values_at_its_points_and_no_force_beyond) {
  json table = kTable;
  table.update({{"target_point", {0, 0, 0}}, {"scale", 1.0}});
  const std::vector<VehicleForce> forces = read(only(table));
  const auto find_force = [&](double gap, double y, double z) {
    RelativeMotion<double> x;
    x.p = V(gap, y, z);
    return sum_vehicle_forces<double>(forces, x).on_passive.f;
  };
  for (size_t j = 0; j < table["offset"].size(); ++j) {
    const double offset = table["offset"][j];
    for (size_t i = 0; i < table["gap"].size(); ++i) {
      const double known = table["force"][j][i];
      EXPECT_NEAR(find_force(table["gap"][i], 0.6 * offset, 0.8 * offset)[0], known, 1e-12);
    }
  }
  EXPECT_TRUE(find_force(0.5, 0.05, 0.0).isZero(0.0));
  EXPECT_TRUE(find_force(0.7, 0.05, 0.0).isZero(0.0));
  EXPECT_NEAR(find_force(0.01, 0.0, 0.0)[0], -90.0, 1e-12);
  EXPECT_EQ(find_force(0.1, 0.6, 0.0)[1], 0.0);
  EXPECT_LT(find_force(0.1, 0.05, 0.0)[1], 0.0) << "it pulls towards its axis";
}

// ---------------------------------------------------------------- runs

struct ForcedRun {
  explicit ForcedRun(const json& scene) : sim(share(read_scene(scene.dump(), "test"))) {
    sim.initialise(0.0, 0.0);
  }
  void go(double until, double h = 0.05) {
    while (time < until - h / 2) {
      ASSERT_TRUE(sim.step(time, h).ok()) << sim.status_text();
      time += h;
    }
  }
  const Outputs& out() { return sim.outputs(); }
  ComparingSim sim;
  double time = 0.0;
};

/// On the line through both centres of mass.
json make_central_spring() {
  json spring = kSpring;
  spring.update({{"damping", 0}, {"chaser_point", {0, 0, 0}}, {"target_point", {0, 0, 0}}});
  return spring;
}

TEST(VehicleForceRuns, two_masses_on_a_spring_oscillate_as_in_the_closed_form) {
  const double w = std::sqrt(800.0 * (50.0 + 80.0) / (50.0 * 80.0));
  for (const int method : {kAuto, kExplicit, kBdf, kRosenbrock}) {
    json scene = make_scene(only(make_central_spring()));
    scene["solver"]["method"] = method;
    if (method == kRosenbrock) {
      scene["solver"] = {{"method", method},
                         {"rtol", 1e-9},
                         {"atol_position", 1e-11},
                         {"atol_velocity", 1e-11},
                         {"atol_energy", 1e-11}};
    }
    ForcedRun run(scene);
    EXPECT_NEAR(run.out().energy_potential, 4.0, 1e-12);
    run.go(5.0);
    const double exact = 0.2 + 0.1 * std::cos(w * 5.0);
    const double tolerance = method == kRosenbrock || method == kBdf ? 1e-6 : 1e-9;
    EXPECT_NEAR(run.out().relative_axial, exact, tolerance) << "method " << method;
    EXPECT_NEAR(run.out().vehicle_distance[0], exact, tolerance);
    EXPECT_LT(std::abs(run.out().energy_residual), tolerance) << "method " << method;
    EXPECT_NEAR(run.out().vehicle_force[0][0], -800.0 * 0.1 * std::cos(w * 5.0), 800 * tolerance);
    EXPECT_EQ(run.out().vehicle[kTarget].force, run.out().vehicle_force[0]);
    EXPECT_EQ(run.out().vehicle[kChaser].force, -run.out().vehicle_force[0]);
  }
}

TEST(VehicleForceRuns, energy_and_momentum_balance_with_every_kind) {
  json scene = make_scene(kAll);
  scene["chaser"]["angular_velocity"] = {0.02, 0.1, -0.05};
  scene["solver"]["rtol"] = 1e-13;
  ForcedRun run(scene);
  const V linear = run.out().momentum_linear, angular = run.out().momentum_angular;
  run.go(0.5);  // before they pass through each other
  EXPECT_LT(std::abs(run.out().energy_residual), 1e-9);
  EXPECT_GT(run.out().energy_dissipated_forces, 0.1);
  EXPECT_EQ(run.out().energy_dissipated, run.out().energy_dissipated_forces);
  EXPECT_LT(run.out().momentum_residual, 1e-12);
  EXPECT_LT((run.out().momentum_linear - linear).norm(), 1e-12);
  EXPECT_GT(angular.norm(), 0.1);
}

TEST(VehicleForceRuns, magnets_keep_angular_momentum) {
  json scene = make_scene(only(kDipoles));
  scene["target"]["angular_velocity"] = {0.1, 0.2, -0.1};
  ForcedRun run(scene);
  const V before = run.out().vehicle[kChaser].angular_velocity;
  run.go(3.0);
  EXPECT_GT((run.out().vehicle[kChaser].angular_velocity - before).norm(), 1e-3);
  EXPECT_LT(std::abs(run.out().energy_residual), 1e-9);
  EXPECT_LT(run.out().momentum_residual, 1e-12);
  EXPECT_LT(run.out().energy_potential, 0.0);
}

TEST(VehicleForceRuns, a_tether_is_slack_then_taut_then_slack) {
  json tether = kTether;
  tether.update(
      {{"damping", 0}, {"toe", 1e-4}, {"chaser_point", {0, 0, 0}}, {"target_point", {0, 0, 0}}});
  json scene = make_scene(only(tether), 0.2);
  scene["target"]["velocity"] = {0.1, 0, 0};
  ForcedRun run(scene);
  EXPECT_EQ(run.out().vehicle_force[0], V::Zero());
  run.go(0.95);
  EXPECT_EQ(run.out().vehicle_force[0], V::Zero());
  run.go(1.05);
  EXPECT_LT(run.out().vehicle_force[0][0], -1.0);
  const double half = static_cast<double>(EIGEN_PI) / std::sqrt(900.0 * 130.0 / 4000.0);
  run.go(1.0 + half + 0.1);
  EXPECT_EQ(run.out().vehicle_force[0], V::Zero());
  EXPECT_NEAR(run.out().relative_velocity[0], -0.1, 1e-9);
  EXPECT_LT(std::abs(run.out().energy_residual), 1e-9);
}

TEST(VehicleForceRuns, have_28_digits_in_a_reference_solution) {
  const Scene scene = read_scene(make_scene(only(make_central_spring())).dump(), "test");
  const ExtendedPrecision precision(1e-26);
  DockingSim sim(share(scene), FmiKind::kCoSimulation, &precision);
  sim.initialise(0.0, 0.0);
  for (int k = 0; k < 8; ++k) ASSERT_TRUE(sim.step(k / 8.0, 1.0 / 8).ok()) << sim.status_text();
  const StateLayout layout = Docking(scene).model.layout;
  const L* y = precision.states();
  const L length = y[layout.pose[kTarget]] - y[layout.pose[kChaser]] - (L(0.3) + L(0.4));
  const L start = L(scene.vehicle[kTarget].position[0]) - (L(0.3) + L(0.4));
  const L w = sqrt(L(800.0) * 130 / 4000), free = L(0.2);
  EXPECT_LE(to_double(abs(length - (free + (start - free) * cos(w)))), 1e-27);
}

TEST(VehicleForceRuns, saved_states_repeat_the_same_bits) {
  json scene = make_scene(kAll);
  scene["chaser"]["angular_velocity"] = {0.02, 0.1, -0.05};
  ForcedRun run(scene);
  ComparingSim other(run.sim.shared_scene());
  SavedSim saved;
  for (const double time : {0.0, 0.35, 1.0}) {
    run.go(time);
    run.sim.save(saved);
    other.load(through_bytes(saved));
    ASSERT_TRUE(run.sim.step(run.time, 0.05).ok());
    ASSERT_TRUE(other.step(run.time, 0.05).ok());
    run.time += 0.05;
    EXPECT_TRUE(same_bits(flatten(run.out(), true), flatten(other.outputs(), true)));
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(VehicleForceRuns, do_not_allocate) {
  for (const int method : {kExplicit, kRosenbrock}) {
    json scene = make_scene(kAll);
    scene["solver"] = {{"method", method}, {"rtol", 1e-6}};
    ForcedRun run(scene);
    run.go(0.2);
    EXPECT_EQ(count_allocations([&] { run.go(1.0); }), 0) << "method " << method;
  }
}
#endif

struct Malformed {
  const char* member;
  json value;
  const char* message;
};

TEST(VehicleForce, members_out_of_range_are_refused) {
  const std::vector<Malformed> cases = {
      {"/0/type", "rope", "is 'rope'; it must be spring, tether, dipoles or table"},
      {"/0/stiffness", 0, "force[1].stiffness is 0; it must be above 0"},
      {"/0/free_length", -1, "must be 0 or more"},
      {"/0/toe", 0.1, "force[1].toe is no member of a force of type 'spring'"},
      {"/1/toe", 0, "force[2].toe is 0; it must be above 0"},
      {"/2/size", 0, "force[3].size is 0; it must be above 0"},
      {"/2/target_moment", {0, 0, 0}, "a magnet needs a moment that is not zero"},
      {"/3/gap", {0.1, 0.1, 0.2, 0.3}, "must be above the number before, 0.1"},
      {"/3/offset", {0.1, 0.2, 0.3, 0.4}, "must begin with 0"},
      {"/3/force/1", {1, 2, 0}, "has 3 numbers; it must have one per gap, 4"},
      {"/3/force/0/3", -1, "it must end with 0 N at the largest gap"},
      {"/3/offset", {0, 0.1}, "has 4 rows; it must have one per offset, 2"},
  };
  for (const Malformed& at : cases) {
    json forces = kAll;
    forces[json::json_pointer(at.member)] = at.value;
    std::string text;
    try {
      read(forces);
    } catch (const ModelError& error) {
      text = error.what();
    }
    EXPECT_NE(text.find(at.message), std::string::npos) << at.member << ": " << text;
  }
  json alone = make_scene(only(kSpring));
  alone.erase("target");
  EXPECT_THROW(read_scene(alone.dump(), "test"), ModelError);
  json spring = make_central_spring();
  Scene coincident = read_scene(make_scene(only(spring), 0.0).dump(), "test");
  DockingSim sim(share(coincident));
  EXPECT_THROW(sim.initialise(0.0, 1e-6), ModelError);
}

}  // namespace
}  // namespace dockloop
