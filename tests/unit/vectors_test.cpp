// Mechanisms at generic states against figures of an independent implementation.
// 1. positions, velocities, accelerations, cut forces, load on the base, reduced equations and
//    condition of three mechanisms, 20 states each, to eleven digits and better;
// 2. with closed forms where they exist, and by Newton iteration alone.
//
// hexapod_r2p1r3: six legs under a free ring. crank_nested: universal cuts, planar four-bars and
// struts that close on dependent bodies, loops out of order in the file, on a carriage.
// planar_two_loop: a strut that closes on the coupler of a four-bar. Half of the states move the
// base. The files say in `conventions` which axes their figures refer to.
#include <gtest/gtest.h>

#include <cmath>

#include "check/mechanism_check.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;

struct VectorCase {
  const char* file;
  bool newton_only;
  double positions;  ///< tolerance [m], [rad] modulo a turn
  double relative;   ///< tolerance of everything else, max-norm
};

class Vectors : public ::testing::TestWithParam<VectorCase> {};

/// Coordinates that are angles: the others are compared as they stand.
std::vector<char> find_angles(const json& bodies) {
  std::vector<char> angles;
  for (const json& body : bodies) {
    const std::string type = body["joint"]["type"];
    angles.insert(angles.end(), type == "free" ? 7 : 1, type == "revolute" ? 1 : 0);
  }
  return angles;
}

TEST_P(Vectors, every_expected_figure_is_met) {
  const VectorCase& at = GetParam();
  const std::string text = read_test_file(at.file);
  const json document = json::parse(text);
  const json results = evaluate_states(text, at.file, text, at.file, at.newton_only);
  const std::vector<char> angles = find_angles(document["mechanism"]["bodies"]);
  ASSERT_EQ(results.size(), 20u);
  Residual positions, relative;
  for (size_t n = 0; n < results.size(); ++n) {
    const json& state = document["states"][n];
    const json& result = results[n];
    const std::string where = "state " + std::to_string(n + 1);
    ASSERT_EQ(result["q"].size(), angles.size());
    for (size_t i = 0; i < angles.size(); ++i) {
      const double actual = result["q"][i], expected = state["q"][i];
      positions.add(angles[i] ? find_angle_difference(actual, expected) : actual - expected,
                    where + " q[" + std::to_string(i) + "]");
    }
    for (const auto& [key, expected] : state["expected"].items()) {
      ASSERT_TRUE(result.contains(key)) << key;
      if (key == "loop_force") {
        for (const auto& [name, force] : expected.items()) {
          relative.add(find_relative_error(to_vector(result[key][name]), to_vector(force)),
                       where + ", cut " + name);
        }
        continue;
      }
      relative.add(find_relative_error(to_vector(result[key]), to_vector(expected)),
                   where + ", " + key);
    }
  }
  EXPECT_RESIDUAL_BELOW(positions, at.positions);
  EXPECT_RESIDUAL_BELOW(relative, at.relative);
}

INSTANTIATE_TEST_SUITE_P(
    files, Vectors,
    // Measured: positions 2e-15 (crank_nested), the rest 1e-14 (planar_two_loop, hexapod by
    // Newton). The reference itself promises 1e-12 and 1e-11.
    ::testing::Values(VectorCase{"hexapod_r2p1r3.json", false, 4e-15, 1e-13},
                      VectorCase{"hexapod_r2p1r3.json", true, 4e-15, 1e-13},
                      VectorCase{"crank_nested.json", false, 2e-14, 5e-14},
                      VectorCase{"crank_nested.json", true, 2e-14, 5e-14},
                      VectorCase{"planar_two_loop.json", false, 7e-15, 1e-13},
                      VectorCase{"planar_two_loop.json", true, 7e-15, 1e-13}),
    [](const ::testing::TestParamInfo<VectorCase>& at) {
      const std::string file = at.param.file;
      return file.substr(0, file.find('.')) + (at.param.newton_only ? "_newton" : "_closed_form");
    });

}  // namespace
}  // namespace dockloop
