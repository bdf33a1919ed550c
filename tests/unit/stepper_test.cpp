// Every method of integration on small problems whose solutions are known.
// 1. adaptive methods keep to their tolerance;
// 2. fixed steps have the order of their method, and the same number of evaluations in every step;
// 3. a restart leaves no trace of what was before, to the last bit: with another problem half way,
//    after refusals, with and without a Jacobian;
// 4. steps and restarts do not allocate;
// 5. roots are found where they are; a state that cannot be evaluated makes the step smaller;
// 6. what stiffness costs: implicit methods need few steps where explicit ones need many, and equal
//    implicit steps are stable where explicit ones of the same size are not; a step that runs deep
//    into a contact does not decide the sizes of later ones; states inside long linearly implicit
//    steps are right;
// 7. an event function that is below zero inside a step only is seen, if its speed is known;
// 8. steps fail once all evaluations that are allowed have been made.
#include "integrate/stepper.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "unit/allocations.hpp"
#include "unit/dense_matrix.hpp"

namespace dockloop {
namespace {

using Method = Stepper::Method;

struct Case {
  Method method;
  const char* name;
  bool fixed;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

const std::array<Case, 6> kCases = {{{Method::kDormandPrince, "dormand_prince", false},
                                     {Method::kClassicRk4, "classic_rk4", true},
                                     {Method::kBdf, "bdf", false},
                                     {Method::kStabilised, "stabilised", false},
                                     {Method::kRosenbrock, "rosenbrock", false},
                                     {Method::kFixedRosenbrock, "fixed_rosenbrock", true}}};

Stepper make_stepper(Stepper::Problem problem, const Case& c) {
  if (c.method == Method::kRosenbrock || c.method == Method::kFixedRosenbrock) {
    problem.matrix = make_dense_matrix(problem);
  }
  return Stepper(std::move(problem), c.method);
}

std::vector<Case> find_adaptive() {
  std::vector<Case> cases;
  for (const Case& c : kCases) {
    if (!c.fixed) cases.push_back(c);
  }
  return cases;
}

/// y0 = 1/(1 + t^2), y1 = cos t, y2 = -sin t: nonlinear, not autonomous, an oscillation.
Stepper::Problem make_smooth(bool with_jacobian = false) {
  Stepper::Problem p;
  p.size = 3;
  p.root_count = 1;
  p.rates = [](double t, const double* y, double* ydot) {
    ydot[0] = -2.0 * t * y[0] * y[0];
    ydot[1] = y[2];
    ydot[2] = -y[1];
    return 0;
  };
  p.roots = [](double, const double* y, double* roots) {
    roots[0] = y[1];
    return 0;
  };
  if (with_jacobian) {
    p.jacobian = [](double t, const double* y, double* by_columns) {
      const double J[9] = {-4.0 * t * y[0], 0, 0, 0, 0, -1, 0, 1, 0};
      std::memcpy(by_columns, J, sizeof J);
      return 0;
    };
  }
  return p;
}
void set_smooth(double* y) {
  y[0] = y[1] = 1.0;
  y[2] = 0.0;
}
double find_smooth_error(double t, const double* y) {
  return std::max({std::abs(y[0] - 1.0 / (1.0 + t * t)), std::abs(y[1] - std::cos(t)),
                   std::abs(y[2] + std::sin(t))});
}

void set_tolerance(Stepper& stepper, int size, double tolerance) {
  stepper.set_tolerances(tolerance, std::vector<double>(size, tolerance).data());
}

/// @return was the end reached?
bool run_to(Stepper& stepper, double end, bool watch_roots = false) {
  for (int i = 0; i < 1000000; ++i) {
    const StepOutcome outcome = stepper.step(end, watch_roots);
    if (outcome != StepOutcome::kStepped) return outcome == StepOutcome::kStopped;
  }
  return false;
}

/// Equal steps, each a restart, as the simulation makes them.
bool run_fixed(Stepper& stepper, double end, int count) {
  for (int i = 0; i < count; ++i) {
    const double t = end * i / count, next = end * (i + 1) / count;
    stepper.restart(t, next - t);
    if (stepper.step(next, false) == StepOutcome::kFailed) return false;
  }
  return true;
}

class Steppers : public ::testing::TestWithParam<Case> {
 protected:
  bool advance(Stepper& stepper, double end) const {
    return GetParam().fixed ? run_fixed(stepper, end, 200) : run_to(stepper, end);
  }
};

TEST_P(Steppers, keep_the_tolerance_or_have_their_order) {
  std::vector<double> error;
  for (int level = 0; level < 3; ++level) {
    Stepper stepper = make_stepper(make_smooth(level == 1), GetParam());
    set_smooth(stepper.y());
    if (GetParam().fixed) {
      ASSERT_TRUE(run_fixed(stepper, 3.0, 30 << level));
    } else {
      set_tolerance(stepper, 3, 1e-5 * std::pow(0.1, 2 * level));
      stepper.restart(0.0, 0.0);
      ASSERT_TRUE(run_to(stepper, 3.0));
    }
    error.push_back(find_smooth_error(3.0, stepper.y()));
    std::printf("%s, level %d: error %.2e, %ld steps, %ld evaluations\n", GetParam().name, level,
                error.back(), stepper.steps(), stepper.rate_evaluations());
  }
  if (GetParam().fixed) {
    const double order = std::log2(error[1] / error[2]);
    EXPECT_NEAR(order, 4.0, 0.1) << "errors " << error[1] << ", " << error[2];
    return;
  }
  for (int level = 0; level < 3; ++level) {  // measured: 31 tolerances, BDF
    EXPECT_LT(error[level], 100.0 * 1e-5 * std::pow(0.1, 2 * level)) << "level " << level;
  }
}

TEST_P(Steppers, forget_everything_at_a_restart) {
  for (const bool with_jacobian : {false, true}) {
    const auto run = [&](Stepper& stepper) {
      set_tolerance(stepper, 3, 1e-7);
      set_smooth(stepper.y());
      stepper.restart(0.0, 0.01);
      EXPECT_TRUE(advance(stepper, 1.0));
      return std::vector<double>(stepper.y(), stepper.y() + 3);
    };
    Stepper fresh = make_stepper(make_smooth(with_jacobian), GetParam());
    const std::vector<double> expected = run(fresh);
    Stepper used = make_stepper(make_smooth(with_jacobian), GetParam());
    for (double where : {30.0, -2.0, 0.3}) {  // other states, times, tolerances and lengths
      set_tolerance(used, 3, where < 0.0 ? 1e-4 : 1e-9);
      set_smooth(used.y());
      used.y()[1] *= where;
      used.restart(where, 0.1);
      for (int i = 0; i < 7; ++i) used.step(where + 1.0, i > 3);
      const std::vector<double> actual = run(used);
      EXPECT_EQ(std::memcmp(actual.data(), expected.data(), 3 * sizeof(double)), 0)
          << "after a run from " << where << ": " << actual[0] - expected[0];
    }
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST_P(Steppers, do_not_allocate) {
  Stepper stepper = make_stepper(make_smooth(true), GetParam());
  set_tolerance(stepper, 3, 1e-7);
  set_smooth(stepper.y());
  bool ok = true;
  const long allocated = count_allocations([&] {
    stepper.restart(0.0, 0.01);
    ok = ok && advance(stepper, 1.0);
    if (!GetParam().fixed) {
      stepper.restart(1.0, 0.0);
      for (int i = 0; i < 100; ++i) ok = ok && stepper.step(3.0, true) != StepOutcome::kFailed;
    }
  });
  EXPECT_TRUE(ok);
  EXPECT_EQ(allocated, 0);
}
#endif

class AdaptiveSteppers : public Steppers {};

TEST_P(AdaptiveSteppers, find_roots) {
  Stepper stepper = make_stepper(make_smooth(true), GetParam());
  set_tolerance(stepper, 3, 1e-9);
  set_smooth(stepper.y());
  stepper.restart(0.0, 0.0);
  StepOutcome outcome = StepOutcome::kStepped;
  while (outcome == StepOutcome::kStepped) outcome = stepper.step(3.0, true);
  ASSERT_EQ(outcome, StepOutcome::kRoot);
  EXPECT_TRUE(stepper.root_found(0));
  EXPECT_NEAR(stepper.time(), std::acos(0.0), 1e-7);
  EXPECT_NEAR(stepper.y()[1], 0.0, 1e-7);
}

TEST_P(AdaptiveSteppers, get_around_states_that_cannot_be_evaluated) {
  Stepper::Problem p;
  p.size = 1;
  p.rates = [](double, const double* y, double* ydot) {
    ydot[0] = -2.0 * std::sqrt(y[0]);  // y = (1 - t)^2
    return y[0] > 0.0 ? 0 : Stepper::kSmaller;
  };
  Stepper stepper = make_stepper(p, GetParam());
  set_tolerance(stepper, 1, 1e-6);
  stepper.y()[0] = 1.0;
  stepper.restart(0.0, 50.0);
  ASSERT_TRUE(run_to(stepper, 0.9));
  EXPECT_NEAR(stepper.y()[0], 0.01, 1e-4);
}

TEST(StiffProblems, are_stepped_over_by_implicit_methods_only) {
  long steps[kCases.size()] = {};
  for (size_t i = 0; i < kCases.size(); ++i) {
    if (kCases[i].fixed) continue;
    Stepper stepper = make_stepper(make_stiff(1e5), kCases[i]);
    set_tolerance(stepper, 1, 1e-6);
    stepper.y()[0] = 1.0;
    stepper.restart(0.0, 0.0);
    ASSERT_TRUE(run_to(stepper, 3.0)) << kCases[i].name;
    EXPECT_NEAR(stepper.y()[0], std::cos(3.0), 1e-5) << kCases[i].name;
    steps[i] = stepper.steps();
    std::printf("%s: %ld steps, %ld evaluations\n", kCases[i].name, steps[i],
                stepper.rate_evaluations());
  }
  EXPECT_GT(steps[0], 100 * steps[2]) << "explicit against BDF";
  EXPECT_GT(steps[0], 100 * steps[4]) << "explicit against linearly implicit";
}

TEST(StiffProblems, are_cheaper_with_stabilised_steps_and_as_accurate) {
  double error[2];
  long evaluations[2];
  const Method methods[] = {Method::kDormandPrince, Method::kStabilised};
  for (int i = 0; i < 2; ++i) {
    Stepper stepper(make_stiff(2e3), methods[i]);
    set_tolerance(stepper, 1, 1e-4);
    stepper.y()[0] = 1.0;
    stepper.restart(0.0, 0.0);
    ASSERT_TRUE(run_to(stepper, 3.0));
    error[i] = std::abs(stepper.y()[0] - std::cos(3.0));
    evaluations[i] = stepper.rate_evaluations();
    EXPECT_NEAR(stepper.pace().fastest_rate, i == 0 ? 0.0 : 2e3, 50.0);
    std::printf("error %.2e, %ld evaluations\n", error[i], evaluations[i]);
  }
  EXPECT_LT(2 * evaluations[1], evaluations[0]);
  EXPECT_LT(error[1], 1e-4);
}

TEST(StiffProblems, that_become_smooth_are_handed_back_to_explicit_steps) {
  // Tight tolerances make linearly implicit steps short, but not as short as explicit ones were.
  Stepper::Problem problem;
  problem.size = 1;
  problem.rates = [](double t, const double* y, double* ydot) {
    const double k = t < 0.5 ? 1e6 : 1.0;
    ydot[0] = -k * (y[0] - std::cos(t)) - std::sin(t);
    return 0;
  };
  long evaluations[2];
  const Method methods[] = {Method::kStabilised, Method::kSwitching};
  for (int i = 0; i < 2; ++i) {
    problem.matrix = make_dense_matrix(problem);
    Stepper stepper(problem, methods[i]);
    set_tolerance(stepper, 1, 1e-12);
    stepper.y()[0] = 1.0;
    stepper.restart(0.0, 0.0);
    ASSERT_TRUE(run_to(stepper, 0.6));
    const long before = stepper.rate_evaluations();
    ASSERT_TRUE(run_to(stepper, 30.0));
    EXPECT_NEAR(stepper.y()[0], std::cos(30.0), 1e-9);
    evaluations[i] = stepper.rate_evaluations() - before;
    std::printf("%ld of %ld evaluations after the stiff time\n", evaluations[i],
                static_cast<long>(stepper.rate_evaluations()));
  }
  EXPECT_LT(evaluations[1], 5000 + 2 * evaluations[0]);
}

TEST(StiffProblems, that_begin_inside_a_step_leave_no_rate_of_stages_that_are_far_off) {
  // A ball flies freely, so steps grow, and meets a wall of cubic stiffness. Stages of the long
  // step that meets it lie a metre deep.
  Stepper::Problem p;
  p.size = 2;
  p.rates = [](double, const double* y, double* ydot) {
    const double depth = std::max(0.0, y[0]);
    ydot[0] = y[1];
    ydot[1] = -1e9 * depth * depth * depth;
    return 0;
  };
  long evaluations[2];
  const Method methods[] = {Method::kDormandPrince, Method::kStabilised};
  for (int i = 0; i < 2; ++i) {
    Stepper stepper(p, methods[i]);
    set_tolerance(stepper, 2, 1e-8);
    stepper.y()[0] = -0.25;
    stepper.y()[1] = 1.0;
    stepper.restart(0.0, 1e-6);
    ASSERT_TRUE(run_to(stepper, 1.0));
    EXPECT_NEAR(stepper.y()[1], -1.0, 1e-5);
    evaluations[i] = stepper.rate_evaluations();
    std::printf("%ld evaluations, fastest rate %.3g/s\n", evaluations[i],
                stepper.pace().fastest_rate);
  }
  EXPECT_LT(evaluations[1], 2 * evaluations[0]);
}

TEST(SmoothProblems, are_never_handed_to_the_stabilised_pair) {
  double end[2];
  const Method methods[] = {Method::kDormandPrince, Method::kStabilised};
  for (int i = 0; i < 2; ++i) {
    Stepper stepper(make_smooth(), methods[i]);
    set_tolerance(stepper, 3, 1e-7);
    set_smooth(stepper.y());
    stepper.restart(0.0, 0.01);
    ASSERT_TRUE(run_to(stepper, 3.0));
    end[i] = stepper.y()[0];
  }
  EXPECT_EQ(end[0], end[1]);
}

TEST(Restarts, with_known_rates_give_the_same_bits_and_cost_less) {
  double end[2];
  long evaluations[2];
  for (int i = 0; i < 2; ++i) {
    Stepper stepper(make_smooth(), Method::kDormandPrince);
    set_tolerance(stepper, 3, 1e-7);
    set_smooth(stepper.y());
    const double rates[] = {0.0, 0.0, -1.0};
    stepper.restart(0.0, 0.01, {i == 0 ? nullptr : rates, 0.0});
    ASSERT_TRUE(run_to(stepper, 3.0));
    end[i] = stepper.y()[0];
    evaluations[i] = stepper.rate_evaluations();
  }
  EXPECT_EQ(end[0], end[1]);
  EXPECT_EQ(evaluations[1], evaluations[0] - 1);
}

TEST(StiffProblems, are_stable_with_equal_implicit_steps) {
  for (const Case& c : kCases) {
    if (!c.fixed) continue;
    Stepper stepper = make_stepper(make_stiff(1e5), c);
    stepper.y()[0] = 2.0;  // not on the slow solution
    const bool made = run_fixed(stepper, 3.0, 300);
    const double error =
        made ? std::abs(stepper.y()[0] - std::cos(3.0)) : std::numeric_limits<double>::infinity();
    std::printf("%s: error %.2e\n", c.name, error);
    if (c.method == Method::kFixedRosenbrock) {
      EXPECT_LT(error, 1e-6);
    } else {
      EXPECT_FALSE(error < 1e100);
    }
  }
}

/// An oscillation (y1, y2), and y0 = cos^2 t that a stiffness k holds.
Stepper::Problem make_follower(double k) {
  Stepper::Problem p;
  p.size = 3;
  p.rates = [k](double, const double* y, double* ydot) {
    ydot[0] = -k * (y[0] - y[1] * y[1]) + 2.0 * y[1] * y[2];
    ydot[1] = y[2];
    ydot[2] = -y[1];
    return 0;
  };
  return p;
}

// The rates at the ends of a long step hold the error of the state times the stiffness, which a
// polynomial through them would spread over the inside of the step.
TEST(StiffProblems, are_as_right_inside_linearly_implicit_steps_as_at_their_ends) {
  constexpr double kTolerance = 1e-4;
  const auto find_square_of_cosine = [](double t) { return std::cos(t) * std::cos(t); };
  for (const double k : {1e2, 1e5, 1e8}) {
    Stepper::Problem problem = make_follower(k);
    const auto rates = problem.rates;
    problem.matrix = make_dense_matrix(3, [k](double, const double* y, MatX<double>& A) {
      A << -k, 1.98 * k * y[1], 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0;  // a little off
    });
    Stepper stepper(std::move(problem), Method::kRosenbrock);
    set_tolerance(stepper, 3, kTolerance);
    stepper.y()[0] = stepper.y()[1] = 1.0;
    stepper.y()[2] = 0.0;
    stepper.restart(0.0, 1e-3);
    double longest = 0.0, at_ends = 0.0, inside = 0.0, slopes = 0.0, rate_error = 0.0;
    for (double t = 0.0; t < 10.0;) {
      ASSERT_NE(stepper.step(10.0, false), StepOutcome::kFailed);
      const double h = stepper.time() - t;
      longest = std::max(longest, h);
      at_ends = std::max(at_ends, std::abs(stepper.y()[0] - find_square_of_cosine(stepper.time())));
      std::array<double, 3> rate;
      rates(stepper.time(), stepper.y(), rate.data());
      rate_error = std::max(rate_error, h * std::abs(rate[0] + std::sin(2.0 * stepper.time())));
      for (const double part : {0.1, 0.3, 0.5, 0.7, 0.9}) {
        const double at = t + part * h;
        std::array<double, 3> y, slope;
        ASSERT_TRUE(stepper.interpolate(at, y.data()));
        ASSERT_TRUE(stepper.find_slope(at, slope.data()));
        inside = std::max(inside, std::abs(y[0] - find_square_of_cosine(at)));
        slopes = std::max(slopes, h * std::abs(slope[0] + std::sin(2.0 * at)));
      }
      t = stepper.time();
    }
    std::printf(
        "stiffness %g: steps up to %.2g s, errors %.1e at ends, %.1e inside, %.1e of slopes, %.1e "
        "of "
        "rates at ends\n",
        k, longest, at_ends, inside, slopes, rate_error);
    EXPECT_GT(k * longest, 10.0);
    if (k > 1e4) {
      EXPECT_GT(rate_error, 100.0 * inside);
    }
    EXPECT_LT(inside, 10.0 * kTolerance);
    EXPECT_LT(slopes, 50.0 * kTolerance);
  }
}

TEST(FixedSteps, cost_the_same_wherever_they_are) {
  for (const Case& c : kCases) {
    if (!c.fixed) continue;
    for (const double k : {0.0, 1.0, 1e5}) {
      Stepper::Problem problem = make_stiff(k);
      problem.jacobian = [k](double, const double*, double* J) {
        J[0] = -k;
        return 0;
      };
      problem.jacobian_cost = 100;
      Stepper stepper = make_stepper(problem, c);
      stepper.y()[0] = 1.0;
      for (int i = 0; i < 20; ++i) {
        const long before = stepper.rate_evaluations();
        stepper.restart(0.01 * i, 0.01);
        ASSERT_NE(stepper.step(0.01 * (i + 1), false), StepOutcome::kFailed);
        // A Rosenbrock step: six stages, the slope over time, a matrix.
        const long expected = c.method == Method::kFixedRosenbrock ? 107 : 4;
        EXPECT_EQ(stepper.rate_evaluations() - before, expected)
            << c.name << ", k = " << k << ", step " << i;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, AdaptiveSteppers, ::testing::ValuesIn(find_adaptive()),
                         [](const auto& c) { return std::string(c.param.name); });
INSTANTIATE_TEST_SUITE_P(Methods, Steppers, ::testing::ValuesIn(kCases),
                         [](const auto& c) { return std::string(c.param.name); });

// ---------------------------------------------------------------- events inside a step

/// y' = 1, and an event function that is the largest of two conditions: below zero for `length`.
Stepper::Problem make_dip(double from, double length, bool knows_speed) {
  Stepper::Problem p;
  p.size = 1;
  p.root_count = 2;
  p.rates = [](double, const double*, double* ydot) {
    ydot[0] = 1.0;
    return 0;
  };
  p.roots = [from, length](double, const double* y, double* roots) {
    roots[0] = 1.0;
    roots[1] = std::max(from - y[0], y[0] - (from + length));
    return 0;
  };
  if (knows_speed) {
    p.root_speeds = [](double* speeds) {
      speeds[0] = 0.0;
      speeds[1] = 1.0;
    };
  }
  return p;
}

TEST(Roots, between_two_positive_ends_are_found_where_the_speed_is_known) {
  for (const double from : {0.013, 0.3, 0.5, 0.77, 0.98}) {
    for (const double length : {0.2, 0.05, 0.019, 0.004}) {
      if (from + length >= 1.0) continue;
      Stepper stepper(make_dip(from, length, true), Method::kDormandPrince);
      stepper.y()[0] = 0.0;
      stepper.restart(0.0, 1.0);
      EXPECT_EQ(stepper.step(1.0, true), StepOutcome::kRoot) << from << " + " << length;
      EXPECT_NEAR(stepper.time(), from, 1e-9);
      EXPECT_TRUE(stepper.root_found(1));
      EXPECT_FALSE(stepper.root_found(0));
    }
  }
}

TEST(Roots, between_two_positive_ends_are_not_looked_for_where_it_is_not) {
  Stepper stepper(make_dip(0.5, 0.05, false), Method::kDormandPrince);
  stepper.y()[0] = 0.0;
  stepper.restart(0.0, 1.0);
  EXPECT_EQ(stepper.step(1.0, true), StepOutcome::kStopped);
}

TEST_P(AdaptiveSteppers, fail_when_their_evaluations_are_used_up) {
  Stepper stepper = make_stepper(make_smooth(true), GetParam());
  const std::array<double, 3> atol = {1e-12, 1e-12, 1e-12};
  stepper.set_tolerances(1e-10, atol.data());
  stepper.y()[0] = stepper.y()[1] = 1.0;
  stepper.y()[2] = 0.0;
  const long before = stepper.rate_evaluations();
  constexpr long kAllowed = 60;
  stepper.set_evaluation_limit(kAllowed);
  stepper.restart(0.0, 1e-3);
  StepOutcome outcome = StepOutcome::kStepped;
  while (outcome == StepOutcome::kStepped) outcome = stepper.step(1e3, false);
  EXPECT_EQ(outcome, StepOutcome::kFailed);
  EXPECT_TRUE(stepper.is_exhausted());
  EXPECT_LE(stepper.rate_evaluations() - before, kAllowed + 10);  // a Jacobian counts as a few
}

}  // namespace
}  // namespace dockloop
