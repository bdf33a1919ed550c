// Latches: forces, energy book-keeping and mode changes.
// 1. the open pawl is conservative, also sideways; its energy peak is F_l (x_r - x_c)/2;
// 2. force and moment are continuous at catch, from the front and from the side;
// 3. power balance in every mode, release ramp included; hysteresis after release.
#include <gtest/gtest.h>

#include <cmath>

#include "contact/latches.hpp"
#include "unit/contact_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

LatchSet make_set() {
  LatchSet set;
  for (int i = 0; i < 3; ++i) {
    const double a = 2 * 3.14159265358979323846 * i / 3;
    const V at(0, 0.6 * std::cos(a), 0.6 * std::sin(a));
    set.latch.push_back({LatchLaw(), at, at, LatchMeasure::kActiveAxis});
  }
  return set;
}

template <class S>
LatchResult<S> evaluate(const LatchSet& set, const std::vector<LatchState>& state, S t,
                        const RelativeMotion<S>& x) {
  LatchResult<S> r;
  calc_latches<S>(set, state.data(), t, x, r);
  return r;
}

/// One latch whose striker stands at s relative to the hook.
LatchSet make_single() {
  LatchSet set;
  set.latch.push_back({LatchLaw(), V(0, 0.6, 0), V(0, 0.6, 0), LatchMeasure::kActiveAxis});
  return set;
}

RelativeMotion<double> at(double x, double y, double z) {
  RelativeMotion<double> motion;
  motion.p = V(x, y, z);
  return motion;
}

TEST(LatchMode, PowerOfEveryModeIsMinusEnergyRateMinusDissipation) {
  const LatchSet set = make_set();
  check_latches(set);
  TestRandom random(21);
  Worst worst;
  int loaded[5] = {};
  for (int i = 0; i < 4000; ++i) {
    RelativeMotion<double> x;
    x.R = rotation_of(random.vector(0.02));
    x.p = V(random.uniform(-0.005, 0.03), random.uniform(-0.05, 0.05), random.uniform(-0.05, 0.05));
    x.w = random.vector(0.2);
    x.v = random.vector(0.1);
    std::vector<LatchState> state(3);
    for (LatchState& s : state) s = {static_cast<LatchMode>(1 + i % 4), 0.98};
    const Extended t = 1.0L, h = 1e-7L;
    const auto energy = [&](Extended step) {
      RelativeMotion<Extended> moved = cast_motion<Extended>(x);
      moved.R = quat_to_matrix<Extended>(quat_exp<Extended>(moved.w * step)) * moved.R;
      moved.p += moved.v * step;
      return evaluate<Extended>(set, state, t + step, moved).energy;
    };
    const LatchResult<double> r = evaluate<double>(set, state, 1.0, x);
    EXPECT_GE(r.power, 0.0);
    const double rate = static_cast<double>((energy(h) - energy(-h)) / (2 * h));
    loaded[1 + i % 4] += r.energy > 0;
    worst.add((find_power(r.on_passive, x) + rate + r.power) / (1 + r.on_passive.f.norm()), i);
  }
  EXPECT_GT(loaded[1], 500);
  EXPECT_GT(loaded[2], 500);
  EXPECT_GT(loaded[3], 500);
  EXPECT_EQ(loaded[4], 0);
  EXPECT_WORST_BELOW(worst, 3e-8);  // measured 2.5e-9: difference across the toe
}

TEST(LatchMode, CatchFromTheFrontIsContinuousAndBooksThePawlEnergy) {
  const LatchSet set = make_single();
  std::vector<LatchState> state(1);
  // Peak of the push in the middle of its range, energy at the catch F_l (x_r - x_c)/2.
  EXPECT_NEAR(evaluate<double>(set, state, 0.0, at(0.012, 0, 0)).on_passive.f[0], 20.0, 1e-12);
  EXPECT_NEAR(evaluate<double>(set, state, 0.0, at(0.004, 0, 0)).energy, 0.16, 1e-15);
  EXPECT_EQ(update_latch(set, 0, 0.0, at(0.0041, 0, 0), state[0]), 0.0);
  EXPECT_EQ(state[0].mode, LatchMode::kOpen);

  const RelativeMotion<double> x = at(0.004 - 1e-9, 0.01, 0.005);
  const LatchResult<double> before = evaluate<double>(set, state, 0.0, x);
  EXPECT_LE(before.event[0], 0.0);
  const double booked = update_latch(set, 0, 0.0, x, state[0]);
  EXPECT_EQ(state[0].mode, LatchMode::kHeld);
  EXPECT_NEAR(booked, 0.16, 1e-15);
  const LatchResult<double> after = evaluate<double>(set, state, 0.0, x);
  EXPECT_NEAR((after.on_passive.f - before.on_passive.f).norm(), 0.0, 1e-25);
  EXPECT_EQ(after.energy, 0.0);
  EXPECT_GT(after.event[0], 0.0);
  EXPECT_NEAR(evaluate<double>(set, state, 0.0, at(0.006, 0, 0)).force[0], 1e6 * (1e-3 - 2.5e-5),
              1e-9);
}

TEST(LatchMode, StrikerEnteringFromTheSideIsCaughtWithoutAJump) {
  const LatchSet set = make_single();
  std::vector<LatchState> state(1);
  EXPECT_GT(evaluate<double>(set, state, 0.0, at(-0.01, 0.03, 0)).event[0], 0.0);
  EXPECT_NE(evaluate<double>(set, state, 0.0, at(-0.01, 0.03, 0)).on_passive.f[1], 0.0);
  const RelativeMotion<double> x = at(-0.01, 0.025, 0);
  const LatchResult<double> before = evaluate<double>(set, state, 0.0, x);
  EXPECT_NEAR(before.event[0], 0.0, 1e-15);
  EXPECT_NEAR(before.on_passive.f.norm(), 0.0, 1e-10);
  EXPECT_NEAR(update_latch(set, 0, 0.0, x, state[0]), 0.16, 1e-12);
  EXPECT_EQ(evaluate<double>(set, state, 0.0, x).on_passive.f.norm(), 0.0);

  // Far behind the hook nothing is caught.
  std::vector<LatchState> open(1);
  EXPECT_GT(evaluate<double>(set, open, 0.0, at(-0.04, 0, 0)).event[0], 0.0);
}

TEST(LatchMode, OverloadReleasesOverARampAndRearmsOnlyBeyondThePawlRange) {
  LatchSet set = make_single();
  std::vector<LatchState> state{{LatchMode::kHeld, 0.0}};
  const RelativeMotion<double> x = at(0.0065, 0, 0);
  EXPECT_GT(evaluate<double>(set, state, 1.0, x).event[0], 0.0);  // not enabled
  set.latch[0].law.releases_on_overload = true;
  set.latch[0].law.rated_load = 1000.0;
  check_latches(set);
  const LatchResult<double> held = evaluate<double>(set, state, 1.0, x);
  EXPECT_LT(held.event[0], 0.0);
  EXPECT_EQ(update_latch(set, 0, 1.0, x, state[0]), 0.0);
  EXPECT_EQ(state[0].mode, LatchMode::kReleasing);
  EXPECT_EQ(state[0].release_time, 1.0);
  EXPECT_DOUBLE_EQ(evaluate<double>(set, state, 1.0, x).force[0], held.force[0]);
  EXPECT_NEAR(evaluate<double>(set, state, 1.025, x).force[0], held.force[0] / 2, 1e-9);
  EXPECT_NEAR(evaluate<double>(set, state, 1.05, x).force[0], 0.0, 1e-9);
  EXPECT_EQ(evaluate<double>(set, state, 1.07, x).force[0], 0.0);

  // At rest the ramp turns the whole stored energy into heat (Simpson's rule is exact here).
  double heat = 0;
  for (int k = 0; k <= 20; ++k) {
    const double weight = k == 0 || k == 20 ? 1 : (k % 2 ? 4 : 2);
    heat += weight * evaluate<double>(set, state, 1.0 + 0.05 * k / 20, x).power * 0.05 / 60;
  }
  EXPECT_NEAR(heat, held.energy, 1e-12);

  EXPECT_EQ(update_latch(set, 0, 1.03, x, state[0]), 0.0);
  EXPECT_EQ(state[0].mode, LatchMode::kReleasing);
  EXPECT_NEAR(update_latch(set, 0, 1.05, x, state[0]), 0.0, 1e-12);
  EXPECT_EQ(state[0].mode, LatchMode::kSpent);

  // Spent: no force and no catch at the hook; ready again only beyond the pawl range.
  EXPECT_EQ(evaluate<double>(set, state, 2.0, at(0.001, 0, 0)).on_passive.f.norm(), 0.0);
  EXPECT_GT(evaluate<double>(set, state, 2.0, at(0.001, 0, 0)).event[0], 0.0);
  EXPECT_EQ(update_latch(set, 0, 2.0, at(0.0201, 0, 0), state[0]), 0.0);
  EXPECT_EQ(state[0].mode, LatchMode::kOpen);
}

TEST(LatchMode, PawlsOfAProbeHeadMeasureAlongThePassiveAxis) {
  // Head centre 10 mm before the seat and 3 mm off the axis, tilted.
  LatchSet set;
  set.latch.push_back(
      {LatchLaw(), V(0.01, 0.03, 0.02), V(0.238, 0.5, -0.3), LatchMeasure::kPassivePlane});
  RelativeMotion<double> x;
  x.R = rotation_of(V(0.3, 0.1, -0.2));
  const V head(0.226, 0.002, -0.003);  // of G in axes of P
  x.p = -x.R * head;
  const V tip = head + x.R.transpose() * set.latch[0].hook;
  const LatchMotion at = find_latch_motion(set, 0, x);
  EXPECT_NEAR(at.s[0], 0.238 - tip[0], 1e-15);
  EXPECT_NEAR(at.s.tail<2>().norm(), head.tail<2>().norm(), 1e-15);
  EXPECT_FALSE(set.is_capture(0));
  EXPECT_TRUE(set.is_capture(1));
}

TEST(LatchMode, ForcesOfBothMeasuresAreGradients) {
  using S = Derivative;
  TestRandom random(17);
  for (const LatchMeasure measure : {LatchMeasure::kActiveAxis, LatchMeasure::kPassivePlane}) {
    const bool plane = measure == LatchMeasure::kPassivePlane;
    LatchSet set;
    const V hook(0.01, 0.03, 0.02);
    set.latch.push_back({LatchLaw(), hook, V(0.238, plane ? 0.5 : 0.03, 0.02), measure});
    int pushed = 0;
    for (int i = 0; i < 400; ++i) {
      RelativeMotion<double> x;
      x.R = rotation_of(random.vector(0.1));
      x.p = -x.R * (V(0.216, 0, 0) + random.vector(0.04));
      x.v = random.vector(0.1);
      x.w = random.vector(0.1);
      for (const LatchMode mode : {LatchMode::kOpen, LatchMode::kHeld}) {
        const std::vector<LatchState> state{{mode, 0.0}};
        // P moves with its velocities: the energy changes with the power of the force.
        RelativeMotion<S> motion = cast_motion<S>(x);
        const S t = S::variable(0.0, 0);
        const Vec3<S> w = x.w.cast<S>() * t, v = x.v.cast<S>() * t;
        for (int j = 0; j < 3; ++j) {
          const Vec3<S> column = motion.R.col(j);
          motion.R.col(j) = column + w.cross(column);
        }
        motion.p += v;
        const LatchResult<S> rate = evaluate<S>(set, state, S(0), motion);
        const LatchResult<double> r = evaluate<double>(set, state, 0.0, x);
        const double power = r.on_passive.f.dot(x.v - x.w.cross(x.p)) + r.on_passive.t.dot(x.w);
        const double scale = 1.0 + r.on_passive.f.norm();
        EXPECT_NEAR(rate.energy.d[0] + power + r.power, 0.0, 1e-9 * scale) << i;
        pushed += r.on_passive.f.norm() > 0.1;
      }
    }
    EXPECT_GT(pushed, 100);
  }
}

TEST(LatchMode, BadParametersAreRefused) {
  LatchSet set = make_single();
  set.latch[0].law.play = 0.003;
  EXPECT_THROW(check_latches(set), ModelError);
  set = make_single();
  set.required = 2;
  EXPECT_THROW(check_latches(set), ModelError);
  set = make_single();
  set.latch[0].law.releases_on_overload = true;
  EXPECT_THROW(check_latches(set), ModelError);
}

}  // namespace
}  // namespace dockloop
