// Closed forms of legs, without a mechanism around them.
// 1. stored coordinates of every leg type are met, and stored failures distinguished;
// 2. putting the solution into the chain of turns and slides leads to the point asked for, on every
//    branch, also in Extended;
// 3. the inverse of the loop matrix, its sign and the acceleration of the tip agree with numerical
//    differentiation of that chain;
// 4. margins are the factors of the determinant: they fall to zero where a leg becomes singular.
#include "loops/closed_form.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <map>

#include "math/rotation.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using L = Extended;

using nlohmann::json;
using V = Vec3<double>;

const std::map<std::string, LegKind> kKinds = {{"R2P1R3", LegKind::kR2P1R3},
                                               {"R1R2R3", LegKind::kR1R2R3},
                                               {"R1R2R3_perp", LegKind::kR1R2R3Perpendicular},
                                               {"P1R2R3", LegKind::kP1R2R3},
                                               {"R2R1R3", LegKind::kR2R1R3},
                                               {"R1P1R1", LegKind::kR1P1R1},
                                               {"R1R1R1", LegKind::kR1R1R1},
                                               {"P1R1R1", LegKind::kP1R1R1}};

bool is_planar(LegKind kind) { return kind >= LegKind::kR1P1R1; }
/// Place of the sliding joint, -1 if all of them turn.
int find_slide(LegKind kind) {
  if (kind == LegKind::kR2P1R3) return 2;
  if (kind == LegKind::kR1P1R1) return 1;
  return kind == LegKind::kP1R2R3 || kind == LegKind::kP1R1R1 ? 0 : -1;
}

LegShape read_shape(LegKind kind, const json& p) {
  LegShape shape;
  const auto get = [&](const char* key) { return p.value(key, 0.0); };
  shape.height = get("d1");
  switch (kind) {
    case LegKind::kR2P1R3:
    case LegKind::kR1P1R1:
      shape.tip = V(get("L0"), get("offset_y"), get("offset_z"));
      break;
    case LegKind::kR1R2R3:
      shape.l1 = get("l12");
      shape.tip = to_vec3(p["tip"]);
      break;
    case LegKind::kR1R2R3Perpendicular:
      shape.l1 = get("l12");
      shape.l2 = get("l23");
      break;
    case LegKind::kP1R2R3:
      shape.slide = to_vec3(p["slide_axis"]);
      shape.tip = V(get("l"), 0, 0);
      break;
    case LegKind::kP1R1R1:
      shape.l2 = get("l");
      break;
    default:
      shape.l1 = get("l1");
      shape.l2 = get("l2");
  }
  return shape;
}

V read_target(const json& item) {
  const json& tip = item["L"];
  return {tip[0], tip[1], tip.size() > 2 ? tip[2].get<double>() : 0.0};
}

template <class S>
Mat3<S> turn(int axis, const S& angle) {
  using std::cos;
  using std::sin;
  return axis_rotation<S>(Vec3<S>::Unit(axis), cos(angle), sin(angle));
}

/// Tip of the chain at canonical coordinates p: the definition that the closed forms invert.
template <class S>
Vec3<S> find_tip(LegKind kind, const LegShape& shape, const Vec3<S>& p) {
  const Vec3<S> x = Vec3<S>::UnitX(), tip = shape.tip.cast<S>();
  const S l1(shape.l1), l2(shape.l2), height(shape.height);
  switch (kind) {
    case LegKind::kR2P1R3:
      return turn<S>(1, p[0]) * (turn<S>(2, p[1]) * Vec3<S>(tip + p[2] * x));
    case LegKind::kR1R2R3:
      return turn<S>(2, p[0]) * Vec3<S>(Vec3<S>(l1, S(0), height) +
                                        turn<S>(2, p[1]) * Vec3<S>(turn<S>(1, p[2]) * tip));
    case LegKind::kR1R2R3Perpendicular:
      return turn<S>(2, p[0]) *
             Vec3<S>(Vec3<S>(l1, S(0), height) +
                     turn<S>(1, p[1]) * Vec3<S>(turn<S>(2, p[2]) * Vec3<S>(l2 * x)));
    case LegKind::kP1R2R3:
      return p[0] * shape.slide.cast<S>() + turn<S>(1, p[1]) * Vec3<S>(turn<S>(2, p[2]) * tip);
    case LegKind::kR2R1R3:
      return turn<S>(1, p[0]) *
             Vec3<S>(turn<S>(2, p[1]) *
                     Vec3<S>(Vec3<S>(l1, S(0), height) + turn<S>(2, p[2]) * Vec3<S>(l2 * x)));
    case LegKind::kR1P1R1:
      return turn<S>(2, p[0]) * Vec3<S>(tip + p[1] * x);
    case LegKind::kR1R1R1:
      return turn<S>(2, p[0]) * Vec3<S>(l1 * x + turn<S>(2, p[1]) * Vec3<S>(l2 * x));
    case LegKind::kP1R1R1:
      return p[0] * x + turn<S>(2, p[1]) * Vec3<S>(l2 * x);
  }
  return x;
}

template <class S>
Vec3<S> get_coordinates(LegKind kind, const LegSolution<S>& leg) {
  using std::atan2;
  Vec3<S> p;
  for (int i = 0; i < 3; ++i) p[i] = atan2(leg.s[i], leg.c[i]);
  if (find_slide(kind) >= 0) p[find_slide(kind)] = leg.slide;
  return p;
}

TEST(ClosedForm, stored_coordinates_and_failures_of_every_leg_type_are_met) {
  const json document = json::parse(read_test_file("closures.json"));
  Residual worst;
  std::map<LegKind, int> met, refused;
  for (const json& item : document["cases"]) {
    const LegKind kind = kKinds.at(item["closure"]);
    const LegBranch branch{item.value("branch", 1), 1};
    const LegSolution<double> leg =
        solve_leg<double>(kind, read_shape(kind, item["parameters"]), branch, read_target(item));
    const json& expected = item["expected"];
    if (expected.contains("error")) {
      ++refused[kind];
      EXPECT_EQ(leg.code, expected["error"] == "singular" ? StatusCode::kLoopSingular
                                                          : StatusCode::kOutOfReach)
          << item.dump();
      continue;
    }
    ++met[kind];
    ASSERT_EQ(leg.code, StatusCode::kOk) << item.dump();
    const V p = get_coordinates(kind, leg);
    for (size_t i = 0; i < expected["coordinates"].size(); ++i) {
      const int at = static_cast<int>(i);
      const double value = expected["coordinates"][i];
      worst.add(at == find_slide(kind) ? p[at] - value : find_angle_difference(p[at], value),
                item.dump());
    }
  }
  for (const auto& [name, kind] : kKinds) EXPECT_GE(met[kind], 10) << name;
  EXPECT_EQ(refused.size(), 7u);  // all but R1P1R1
  EXPECT_RESIDUAL_BELOW(worst, 1e-13);
}

LegShape make_random_shape(LegKind kind, TestRandom& random) {
  LegShape shape;
  shape.l1 = random.uniform(0.3, 1.0);
  shape.l2 = random.uniform(0.3, 1.0);
  shape.height = random.uniform(-0.2, 0.2);
  shape.tip = V(random.uniform(0.4, 1.0), random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1));
  shape.slide = make_unit(random);
  if (is_planar(kind)) shape.tip.z() = shape.height = 0;
  return shape;
}

template <class S>
void check_branches(double tolerance) {
  TestRandom random(7);
  Residual gap;
  for (const auto& [name, kind] : kKinds) {
    int solved = 0;
    for (int trial = 0; trial < 300; ++trial) {
      const LegShape shape = make_random_shape(kind, random);
      V p(random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3));
      if (find_slide(kind) >= 0) p[find_slide(kind)] = random.uniform(-0.2, 0.5);
      const Vec3<S> tip = find_tip<S>(kind, shape, p.cast<S>());
      bool found = false;
      for (const int elbow : {1, -1}) {
        for (const int flip : {1, -1}) {
          const LegSolution<S> leg = solve_leg<S>(kind, shape, {elbow, flip}, tip);
          if (leg.code != StatusCode::kOk) continue;  // the other lean may not reach
          const Vec3<S> again = get_coordinates(kind, leg);
          if (leg.margin > 0.1) {
            gap.add(static_cast<double>((find_tip<S>(kind, shape, again) - tip).norm()), name);
          }
          double distance = 0;
          for (int i = 0; i < (is_planar(kind) ? 2 : 3); ++i) {
            const double d = static_cast<double>(again[i]) - p[i];
            distance = std::max(distance,
                                std::abs(i == find_slide(kind) ? d : find_angle_difference(d, 0)));
          }
          found = found || distance < 1e-6;
        }
      }
      solved += found ? 1 : 0;
    }
    // One of the branches is the pose the point came from (a slide never runs through its joint).
    EXPECT_GE(solved, 295) << name;
  }
  EXPECT_RESIDUAL_BELOW(gap, tolerance);
}

TEST(ClosedForm, the_chain_leads_back_to_the_point_on_every_branch) {
  check_branches<double>(1e-13);
  check_branches<Extended>(1e-14);
}

TEST(ClosedForm, rates_sign_and_acceleration_agree_with_the_chain_differentiated) {
  TestRandom random(11);
  Residual inverse, bias;
  for (const LegKind kind : {LegKind::kR2P1R3, LegKind::kR1R2R3, LegKind::kR1R2R3Perpendicular}) {
    for (int trial = 0; trial < 50; ++trial) {
      const LegShape shape = make_random_shape(kind, random);
      V p(random.uniform(-3, 3), random.uniform(-1, 1), random.uniform(0.3, 1.2));
      const LegBranch branch{random.uniform(0, 1) < 0.5 ? 1 : -1, 1};
      const LegSolution<double> leg =
          solve_leg<double>(kind, shape, branch, find_tip<double>(kind, shape, p));
      if (leg.code != StatusCode::kOk || leg.margin < 0.2) continue;
      p = get_coordinates(kind, leg);
      Mat3<double> axes;
      if (kind == LegKind::kR2P1R3) axes = turn<double>(1, p[0]) * turn<double>(2, p[1]);
      if (kind == LegKind::kR1R2R3) axes = turn<double>(2, p[0] + p[1]);
      if (kind == LegKind::kR1R2R3Perpendicular)
        axes = turn<double>(2, p[0]) * turn<double>(1, p[1]);
      // Central differences of fourth order.
      const Vec3<L> at = p.cast<L>();
      const auto along = [&](const Vec3<L>& direction, L s) {
        return find_tip<L>(kind, shape, Vec3<L>(at + s * direction));
      };
      const L h = 1e-3L;
      Mat3<double> C;
      for (int j = 0; j < 3; ++j) {
        const Vec3<L> e = Vec3<L>::Unit(j);
        C.col(j) = (((along(e, h) - along(e, -h)) * L(8) - (along(e, 2 * h) - along(e, -2 * h))) /
                    (12 * h))
                       .cast<double>();
      }
      const Mat3<double> found = find_leg_inverse<double>(kind, shape, leg, axes);
      inverse.add((found * C - Mat3<double>::Identity()).norm(), std::to_string(trial));
      EXPECT_EQ(find_leg_sign(kind, branch), C.determinant() < 0 ? -1 : 1);
      const V rate = random.vector(1.0);
      const Vec3<L> r = rate.cast<L>();
      const Vec3<L> second = ((along(r, h) + along(r, -h)) * L(16) -
                              (along(r, 2 * h) + along(r, -2 * h)) - along(r, 0) * L(30)) /
                             (12 * h * h);
      const V w = axes * find_leg_bias<double>(kind, shape, leg, rate);
      bias.add((w - second.cast<double>()).norm(), std::to_string(trial));
    }
  }
  EXPECT_RESIDUAL_BELOW(inverse, 1e-10);
  EXPECT_RESIDUAL_BELOW(bias, 1e-10);
}

TEST(ClosedForm, margins_are_the_factors_of_the_determinant) {
  const LegShape arm = [] {
    LegShape shape;
    shape.l1 = 0.5;
    shape.l2 = 0.4;
    shape.tip = V(0.4, 0, 0);
    return shape;
  }();
  for (double angle : {1.0, 0.1, 1e-3, 1e-6}) {
    // Crank leg: elbow nearly straight; planar arm: the same.
    const V straight = find_tip<double>(LegKind::kR1R2R3, arm, V(0.3, angle, 0.0));
    EXPECT_NEAR(solve_leg<double>(LegKind::kR1R2R3, arm, {1, 1}, straight).margin, std::sin(angle),
                1e-9);
    const V planar = find_tip<double>(LegKind::kR1R1R1, arm, V(0.3, angle, 0.0));
    EXPECT_NEAR(solve_leg<double>(LegKind::kR1R1R1, arm, {1, 1}, planar).margin, std::sin(angle),
                1e-9);
    // Slide leg whose cut point lies next to it: the slide nearly at its foot.
    LegShape aside;
    aside.tip = V(0, 0.3, 0);
    const V foot = find_tip<double>(LegKind::kR2P1R3, aside, V(0.3, 0.2, 0.3 * std::tan(angle)));
    EXPECT_LE(solve_leg<double>(LegKind::kR2P1R3, aside, {1, 1}, foot).margin,
              std::sin(angle) + 1e-9);
    // Slide leg: nearly along the first axis of its universal joint.
    const double turned = 0.5 * 3.14159265358979323846 - angle;
    const V aligned = find_tip<double>(LegKind::kR2P1R3, arm, V(0.3, turned, 0.1));
    EXPECT_NEAR(solve_leg<double>(LegKind::kR2P1R3, arm, {1, 1}, aligned).margin, std::sin(angle),
                1e-9);
  }
}

}  // namespace
}  // namespace dockloop
