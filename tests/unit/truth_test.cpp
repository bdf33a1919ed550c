// The scalar and the method of the reference solution, against what is known exactly.
// 1. functions of Extended satisfy their identities to 30 digits;
// 2. a damped oscillation has 25 digits, and less tolerance gives less error;
// 3. a kink of the rates, which no high order can cross, costs steps but no digits;
// 4. the one-dimensional absorber through DockingSim, communication steps and all: 1e-28 of its
//    closed form, 1e11 times closer than the resolution of double.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "compare/extended_precision.hpp"
#include "compare/extended_solver.hpp"
#include "unit/random_docking.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

TEST(Extended, FunctionsSatisfyTheirIdentities) {
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> any(-3.0, 3.0);
  Residual worst;
  for (int i = 0; i < 2000; ++i) {
    const Extended a = Extended(any(engine)) + any(engine) * 1e-17;
    const Extended b = Extended(any(engine)) / 3;
    const std::string at = std::to_string(a.high) + " " + std::to_string(b.high);
    const auto add = [&](const char* name, const Extended& difference) {
      worst.add(to_double(difference), name + (" at " + at));
    };
    add("quotient", a / b * b - a);
    add("root", sqrt(a * a) - abs(a));
    add("angle", atan2(sin(a), cos(a)) - a);
    add("sum of angles", sin(a + b) - (sin(a) * cos(b) + cos(a) * sin(b)));
    add("logarithm", log1p(exp(a) - 1) - a);
    add("exponential", exp(a) * exp(-a) - 1);
    add("floor", floor(a) + floor(-a) + 1);
  }
  EXPECT_LE(worst.value, 1e-30) << worst.where;  // measured 1e-31
}

/// Motion of one coordinate and its velocity under `rates`, in communication steps of 1 s.
struct Motion {
  Motion(Extended x, Extended v, ExtendedSolver::Rates rates, double tolerance)
      : stepper(make_problem(std::move(rates), tolerance)) {
    const double atol[2] = {1.0, 1.0};
    stepper.set_tolerances(1.0, atol);
    stepper.y()[0] = x.high;
    stepper.y()[1] = v.high;
  }
  Stepper::Problem make_problem(ExtendedSolver::Rates rates, double tolerance) {
    Stepper::Problem problem;
    problem.size = 2;
    problem.solver = [this, rates, tolerance](System& system) {
      auto made = std::make_unique<ExtendedSolver>(system, rates, tolerance);
      solver = made.get();
      return std::unique_ptr<Solver>(std::move(made));
    };
    return problem;
  }
  void advance(int seconds) {
    for (int k = 0; k < seconds; ++k) {
      stepper.restart(k, 0.1);
      while (stepper.time() < k + 1) {
        ASSERT_NE(stepper.step(k + 1, false), StepOutcome::kFailed);
      }
    }
  }
  ExtendedSolver* solver = nullptr;
  Stepper stepper;
};

TEST(ReferenceSolution, OscillationHas25DigitsAndLessToleranceGivesLessError) {
  const double s = 0.125;
  const auto rates = [s](const Extended&, const Extended* y, Extended* ydot) {
    ydot[0] = y[1];
    ydot[1] = -y[0] - 2.0 * s * y[1];
    return 0;
  };
  const Extended w = sqrt(Extended(1) - s * s), t = 5;
  const Extended exact = exp(-s * t) * (cos(w * t) + (0.25 + s) / w * sin(w * t));
  double before = 1e-9;
  for (const double tolerance : {1e-14, 1e-20, 1e-26}) {
    Motion run(1, 0.25, rates, tolerance);
    run.advance(5);
    const double error = to_double(abs(run.solver->state()[0] - exact));
    EXPECT_LE(error, 1e-4 * before) << "tolerance " << tolerance;
    EXPECT_LE(error, 20.0 * tolerance) << "tolerance " << tolerance;
    EXPECT_EQ(run.stepper.y()[0], run.solver->state()[0].high);
    before = error;
  }
}

TEST(ReferenceSolution, KinkCostsStepsButNoDigits) {
  // Free motion, half an oscillation against a spring that only pushes, free motion again.
  const double start = -0.3;
  const auto rates = [](const Extended&, const Extended* y, Extended* ydot) {
    ydot[0] = y[1];
    ydot[1] = y[0] > 0 ? -y[0] : Extended(0);
    return 0;
  };
  Motion run(start, 1, rates, 1e-22);
  run.advance(5);
  const Extended pi = atan2(Extended(0), Extended(-1));
  const Extended x = -(Extended(5) + start - pi);
  EXPECT_LE(to_double(abs(run.solver->state()[0] - x)), 5e-19);  // measured 5e-20
  EXPECT_LE(to_double(abs(run.solver->state()[1] + 1)), 5e-19);  // measured 4e-20
  EXPECT_LE(run.stepper.steps(), 400);
}

/// Depth of the absorber: how far A is beyond P.
Extended find_depth(const Extended* y, const Scene& scene, const StateLayout& layout) {
  const auto interface_at = [&](int i) {
    return y[layout.pose[i]] + scene.vehicle[i].interface_position.x();
  };
  return interface_at(kChaser) - interface_at(kTarget);
}

TEST(ReferenceSolution, AbsorberFollowsItsClosedFormThroughCommunicationSteps) {
  Scene scene = read_test_scene("scene_minimal.json");
  scene.contact = make_absorber_contact({20e3, 2000.0, true});
  const StateLayout layout = Docking(scene).model.layout;
  const ExtendedPrecision precision(1e-26);
  DockingSim sim(share(scene), FmiKind::kCoSimulation, &precision);
  sim.initialise(0.0, 0.0);
  constexpr double kStep = 1.0 / 64;
  constexpr int kBegin = 8, kEnd = 64;  // in contact from 0.1 s on
  for (int k = 0; k < kBegin; ++k) {
    ASSERT_TRUE(sim.step(k * kStep, kStep).ok()) << sim.status_text();
  }
  const Extended d0 = find_depth(precision.states(), scene, layout);
  const Extended* y = precision.states();
  const Extended mc = scene.vehicle[kChaser].mass, mt = scene.vehicle[kTarget].mass;
  const Extended v0 = y[layout.momentum[kChaser]] / mc - y[layout.momentum[kTarget]] / mt;
  ASSERT_GT(d0, 0);
  for (int k = kBegin; k < kEnd; ++k) {
    ASSERT_TRUE(sim.step(k * kStep, kStep).ok()) << sim.status_text();
  }

  const Extended m = mc * mt / (mc + mt), s = Extended(1000) / m;
  const Extended w = sqrt(Extended(20e3) / m - s * s), t = (kEnd - kBegin) * kStep;
  const Extended exact = exp(-s * t) * (d0 * cos(w * t) + (v0 + s * d0) / w * sin(w * t));
  const Extended error = abs(find_depth(precision.states(), scene, layout) - exact);
  EXPECT_LE(to_double(error), 1e-28);  // measured 3e-30
  EXPECT_GT(to_double(exact), 0.01);
}

}  // namespace
}  // namespace dockloop
