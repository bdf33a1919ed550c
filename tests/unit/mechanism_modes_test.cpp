// Vibration about home.
// 1. a mass on spring and damper that also turns a rotor through a screw: the textbook formula;
// 2. a plate on six massless legs with springs: the stiffness matrix summed over the legs;
// 3. what no force opposes has frequency 0;
// 4. a double real eigenvalue is listed twice, one that grows says so.
#include "check/mechanism_modes.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;

TEST(Modes, a_screw_on_a_spring_has_the_frequency_of_the_mass_it_reflects) {
  const json document = {{"name", "screw"},
                         {"bodies",
                          {{{"name", "slide"},
                            {"parent", "base"},
                            {"joint", {{"type", "prismatic"}, {"axis", {1, 0, 0}}}},
                            {"mass", 2.0}},
                           {{"name", "rotor"},
                            {"parent", "slide"},
                            {"joint", {{"type", "revolute"}, {"axis", {1, 0, 0}}}},
                            {"inertia", {{1e-3, 0, 0}, {0, 1e-3, 0}, {0, 0, 1e-3}}}}}},
                         {"couplings",
                          {{{"name", "thread"},
                            {"dependent", "rotor"},
                            {"terms", {{{"joint", "slide"}, {"ratio", 50.0}}}}}}},
                         {"forces",
                          {{{"type", "joint_spring_damper"},
                            {"joint", "slide"},
                            {"stiffness", 90.0},
                            {"damping", 6.0}}}}};
  const Mechanism mechanism(read_mechanism(document.dump(), "screw"));
  const std::vector<Mode> modes = find_modes(mechanism);
  const double mass = 2.0 + 1e-3 * 50.0 * 50.0;
  ASSERT_EQ(modes.size(), 1u);
  EXPECT_NEAR(modes[0].frequency, std::sqrt(90.0 / mass), 1e-12);
  EXPECT_NEAR(modes[0].damping(), 6.0 / (2 * std::sqrt(90.0 * mass)), 1e-12);
}

TEST(Modes, a_plate_on_springs_has_the_frequencies_of_its_stiffness_matrix) {
  const V inertia(1.5, 2.0, 3.0);
  const double mass = 4.0, stiffness = 700.0;
  json document = {{"name", "plate"},
                   {"bodies",
                    {{{"name", "plate"},
                      {"parent", "base"},
                      {"joint", {{"type", "free"}, {"position", {0.6, 0.05, -0.02}}}},
                      {"mass", mass},
                      {"inertia", {{inertia[0], 0, 0}, {0, inertia[1], 0}, {0, 0, inertia[2]}}}}}},
                   {"legs", json::array()}};
  Mat6<double> K = Mat6<double>::Zero();
  for (int i = 0; i < 6; ++i) {
    const double a = 1.1 * i, b = 1.1 * i + (i % 2 ? 0.9 : -0.7);
    const V root(0.0, 0.5 * std::cos(a), 0.5 * std::sin(a));
    const V arm(0.02 * i, 0.4 * std::cos(b), 0.4 * std::sin(b));
    document["legs"].push_back({{"name", "leg" + std::to_string(i)},
                                {"type", "R2P1R3"},
                                {"closing", "plate"},
                                {"root_point", {root.x(), root.y(), root.z()}},
                                {"closing_point", {arm.x(), arm.y(), arm.z()}},
                                {"stiffness", stiffness}});
    const V along = (arm + V(0.6, 0.05, -0.02) - root).normalized();
    Vec6<double> column;
    column << along, arm.cross(along);
    K += stiffness * column * column.transpose();
  }
  Vec6<double> inverse_root;
  inverse_root << V::Constant(1 / std::sqrt(mass)), inertia.cwiseSqrt().cwiseInverse();
  const Mat6<double> scaled = inverse_root.asDiagonal() * K * inverse_root.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Mat6<double>> solver(scaled);
  const std::vector<Mode> modes = find_modes(Mechanism(read_mechanism(document.dump(), "plate")));
  ASSERT_EQ(modes.size(), 6u);
  Residual frequency;
  for (int i = 0; i < 6; ++i) {
    const double expected = std::sqrt(solver.eigenvalues()[i]);
    frequency.add(modes[static_cast<size_t>(i)].frequency / expected - 1, std::to_string(i));
  }
  EXPECT_RESIDUAL_BELOW(frequency, 1e-11);
}

TEST(Modes, a_body_that_floats_has_none) {
  const json document = {{"name", "floating"},
                         {"bodies",
                          {{{"name", "body"},
                            {"parent", "base"},
                            {"joint", {{"type", "free"}}},
                            {"mass", 1.0},
                            {"inertia", {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}}}}};
  for (const Mode& mode : find_modes(Mechanism(read_mechanism(document.dump(), "floating")))) {
    EXPECT_EQ(mode.frequency, 0.0);
  }
}

/// A mass of 2 kg on a slide, with a spring and a damper.
std::vector<Mode> find_modes_of_a_slide(double stiffness, double damping) {
  const json document = {{"name", "slide"},
                         {"bodies",
                          {{{"name", "slide"},
                            {"parent", "base"},
                            {"joint", {{"type", "prismatic"}, {"axis", {1, 0, 0}}}},
                            {"mass", 2.0}}}},
                         {"forces",
                          {{{"type", "joint_spring_damper"},
                            {"joint", "slide"},
                            {"stiffness", stiffness},
                            {"damping", damping}}}}};
  return find_modes(Mechanism(read_mechanism(document.dump(), "slide")));
}

TEST(Modes, a_double_real_eigenvalue_is_listed_twice) {
  for (double stiffness = 1.0; stiffness < 1e4;
       stiffness *= 1.37) {  // rounding splits many of them
    const std::vector<Mode> modes = find_modes_of_a_slide(stiffness, 2 * std::sqrt(stiffness * 2));
    ASSERT_EQ(modes.size(), 2u) << stiffness;
    for (const Mode& mode : modes) {
      EXPECT_FALSE(mode.oscillates);
      EXPECT_NEAR(mode.growth, -std::sqrt(stiffness / 2), 1e-6 * mode.frequency);
    }
  }
  EXPECT_EQ(find_modes_of_a_slide(18.0, 11.9).size(), 1u);  // nearly critical, but it oscillates
  EXPECT_TRUE(find_modes_of_a_slide(18.0, 11.9)[0].oscillates);
  EXPECT_EQ(find_modes_of_a_slide(18.0, 12.1).size(), 2u);
}

TEST(Modes, a_damper_alone_leaves_a_free_motion_and_one_that_dies_out) {
  const std::vector<Mode> modes = find_modes_of_a_slide(0.0, 6.0);
  ASSERT_EQ(modes.size(), 2u);
  EXPECT_EQ(modes[0].frequency, 0.0);
  EXPECT_NEAR(modes[1].growth, -3.0, 1e-12);
}

TEST(Modes, a_pendulum_on_its_head_falls_and_does_not_vibrate) {
  const json document = {{"name", "pendulum"},
                         {"gravity", {0, 0, -10}},
                         {"bodies",
                          {{{"name", "rod"},
                            {"parent", "base"},
                            {"joint", {{"type", "revolute"}, {"axis", {1, 0, 0}}}},
                            {"mass", 3.0},
                            {"com", {0, 0, 0.4}}}}}};
  const std::vector<Mode> modes =
      find_modes(Mechanism(read_mechanism(document.dump(), "pendulum")));
  ASSERT_EQ(modes.size(), 2u);
  const double rate = std::sqrt(10 / 0.4);
  EXPECT_FALSE(modes[0].oscillates || modes[1].oscillates);
  EXPECT_NEAR(std::max(modes[0].growth, modes[1].growth), rate, 1e-12);
  EXPECT_NEAR(std::min(modes[0].growth, modes[1].growth), -rate, 1e-12);
}

}  // namespace
}  // namespace dockloop
