// The linearly implicit method on problems whose solutions are known.
// 1. order 4 with the exact matrix, also where rates depend on time; at least 2 with a wrong one
//    and with none;
// 2. stiff decay: gone after one step of any size; a stiff solution that varies slowly is followed;
// 3. sums that neither the rates nor the matrix change are kept to rounding, with any matrix;
// 4. inside a step the state is that of the cubic through both ends;
// 5. a matrix is built once per step, and factorised once more per rejected step.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "integrate/stepper.hpp"
#include "unit/dense_matrix.hpp"

namespace dockloop {
namespace {

constexpr Stepper::Method kMethod = Stepper::Method::kRosenbrock;
constexpr Stepper::Method kFixed = Stepper::Method::kFixedRosenbrock;

/// A pendulum that is pushed by cos(2 t).
Stepper::Problem make_pendulum() {
  Stepper::Problem p;
  p.size = 2;
  p.rates = [](double t, const double* y, double* ydot) {
    ydot[0] = y[1];
    ydot[1] = -std::sin(y[0]) - 0.1 * y[1] * y[1] * y[1] + std::cos(2.0 * t);
    return 0;
  };
  return p;
}
/// @param share  of the true Jacobian
Stepper::Problem::Matrix make_pendulum_matrix(double share) {
  return make_dense_matrix(2, [share](double, const double* y, MatX<double>& A) {
    A << 0.0, 1.0, -std::cos(y[0]), -0.3 * y[1] * y[1];
    A *= share;
  });
}

std::array<double, 2> run_pendulum(const Stepper::Problem::Matrix& matrix, int count) {
  Stepper::Problem problem = make_pendulum();
  problem.matrix = matrix;
  Stepper stepper(problem, kFixed);
  stepper.y()[0] = 1.0;
  stepper.y()[1] = 0.5;
  for (int i = 0; i < count; ++i) {
    stepper.restart(3.0 * i / count, 3.0 / count);
    EXPECT_EQ(stepper.step(3.0 * (i + 1) / count, false), StepOutcome::kStopped);
  }
  return {stepper.y()[0], stepper.y()[1]};
}

double find_order(const Stepper::Problem::Matrix& matrix) {
  static const std::array<double, 2> exact = run_pendulum(make_pendulum_matrix(1.0), 6000);
  const auto find_error = [&](int count) {
    const auto y = run_pendulum(matrix, count);
    return std::max(std::abs(y[0] - exact[0]), std::abs(y[1] - exact[1]));
  };
  const double coarse = find_error(80), fine = find_error(160);
  std::printf("errors %.2e, %.2e\n", coarse, fine);
  return std::log2(coarse / fine);
}

TEST(Rosenbrock, has_order_four_with_the_exact_matrix_and_two_with_any) {
  EXPECT_NEAR(find_order(make_pendulum_matrix(1.0)), 4.0, 0.2);
  EXPECT_GE(find_order(make_pendulum_matrix(0.7)), 1.9);
  EXPECT_GE(find_order(make_pendulum_matrix(-0.5)), 1.9);
  EXPECT_GE(find_order({}), 1.9);
}

/// With its exact matrix.
Stepper::Problem make_decay(double k) {
  Stepper::Problem p = make_stiff(k);
  p.matrix = make_dense_matrix(1, [k](double, const double*, MatX<double>& A) { A(0, 0) = -k; });
  return p;
}

/// Growth over one step of y' = lambda y.
double find_growth(double h_lambda) {
  Stepper::Problem p;
  p.size = 1;
  p.rates = [h_lambda](double, const double* y, double* ydot) {
    ydot[0] = h_lambda * y[0];
    return 0;
  };
  p.matrix = make_dense_matrix(p);
  Stepper stepper(p, kFixed);
  stepper.y()[0] = 1.0;
  stepper.restart(0.0, 1.0);
  EXPECT_EQ(stepper.step(1.0, false), StepOutcome::kStopped);
  return stepper.y()[0];
}

TEST(Rosenbrock, ends_stiff_decay_in_one_step) {
  for (const double h_lambda : {-1e3, -1e6, -1e9}) {
    EXPECT_LT(std::abs(find_growth(h_lambda)), 10.0 / std::abs(h_lambda) + 1e-6) << h_lambda;
  }
  const double coarse = find_growth(-0.1) - std::exp(-0.1),
               fine = find_growth(-0.05) - std::exp(-0.05);
  EXPECT_NEAR(std::log2(coarse / fine), 5.0, 0.1);
}

TEST(Rosenbrock, follows_a_slow_solution_past_stiffness) {
  for (const double k : {1e2, 1e4, 1e6, 1e8}) {
    Stepper stepper(make_decay(k), kMethod);
    stepper.set_tolerances(1e-5, std::array{1e-5}.data());
    stepper.y()[0] = 1.0;
    stepper.restart(0.0, 0.01);
    while (stepper.step(10.0, false) == StepOutcome::kStepped) continue;
    EXPECT_NEAR(stepper.y()[0], std::cos(10.0), 2e-5) << k;
    EXPECT_LT(stepper.steps(), 120) << k;
  }
}

/// Three bodies that pull at each other, stiffly; the sum of their momenta stays.
TEST(Rosenbrock, keeps_linear_sums_with_any_matrix) {
  static constexpr double kStiff = 3e5, kDamping = 4e3;
  Stepper::Problem p;
  p.size = 6;
  p.rates = [](double, const double* y, double* ydot) {
    const auto pull = [&](int i, int j) {
      const double way = y[j] - y[i];
      return kStiff * (way + way * way * way) + kDamping * (y[3 + j] - y[3 + i]);
    };
    const double a = pull(0, 1), b = pull(1, 2);
    std::copy_n(y + 3, 3, ydot);
    ydot[3] = a;
    ydot[4] = b - a;
    ydot[5] = -b;
    return 0;
  };
  p.depends_on_time = [] { return false; };
  for (const double share : {1.0, 0.8}) {
    p.matrix = make_dense_matrix(6, [share](double, const double*, MatX<double>& A) {
      A.setZero();
      A.topRightCorner<3, 3>().setIdentity();
      Mat3<double> chain;
      chain << -1, 1, 0, 1, -2, 1, 0, 1, -1;
      A.bottomLeftCorner<3, 3>() = share * kStiff * chain;
      A.bottomRightCorner<3, 3>() = kDamping * chain;
    });
    Stepper stepper(p, kMethod);
    stepper.set_tolerances(1e-4, std::array{1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6}.data());
    const double start[] = {0.0, 1.01, 1.97, 3.0, -1.0, 0.25};
    std::copy_n(start, 6, stepper.y());
    stepper.restart(0.0, 1e-4);
    double largest = 0.0;
    StepOutcome outcome = StepOutcome::kStepped;
    while (outcome == StepOutcome::kStepped) {
      outcome = stepper.step(1.0, false);
      const double* y = stepper.y();
      for (int i = 3; i < 6; ++i) largest = std::max(largest, std::abs(y[i]));
      EXPECT_NEAR(y[3] + y[4] + y[5], 2.25, 1e-13 * largest);
    }
    EXPECT_EQ(outcome, StepOutcome::kStopped);
    EXPECT_LT(stepper.steps(), 4000);  // stability of an explicit method asks for 8000
  }
}

TEST(Rosenbrock, follows_the_solution_inside_a_step) {
  Stepper stepper(make_decay(1e4), kMethod);
  stepper.set_tolerances(1e-5, std::array{1e-5}.data());
  stepper.y()[0] = 1.0;
  stepper.restart(0.0, 0.01);
  double from = 0.0;
  while (stepper.step(10.0, false) == StepOutcome::kStepped) {
    for (const double share : {0.25, 0.5, 0.75, 1.0}) {
      const double h = stepper.time() - from, at = from + share * h;
      double y = 0.0;
      ASSERT_TRUE(stepper.interpolate(at, &y));
      EXPECT_NEAR(y, std::cos(at), 2e-5 + h * h * h * h / 300.0);
    }
    from = stepper.time();
  }
}

TEST(Rosenbrock, builds_one_matrix_a_step) {
  Stepper::Problem p = make_pendulum();
  p.matrix = make_pendulum_matrix(1.0);
  int built = 0, factors = 0;
  const auto build = p.matrix.build;
  const auto factor = p.matrix.factor;
  p.matrix.build = [&built, build](double t, const double* y, int& cost) {
    ++built;
    return build(t, y, cost);
  };
  p.matrix.factor = [&factors, factor](double g) {
    ++factors;
    return factor(g);
  };
  p.depends_on_time = [] { return false; };
  Stepper stepper(p, kMethod);
  stepper.set_tolerances(1e-6, std::array{1e-6, 1e-6}.data());
  stepper.y()[0] = 1.0;
  stepper.restart(0.0, 1.0);  // too long: the first step is rejected
  while (stepper.step(3.0, false) == StepOutcome::kStepped) continue;
  EXPECT_EQ(built, stepper.steps());
  EXPECT_GT(stepper.rejected_steps(), 0);
  EXPECT_EQ(factors, stepper.steps() + stepper.rejected_steps());
  EXPECT_EQ(stepper.rate_evaluations(), 1 + 6 * stepper.steps() + 5 * stepper.rejected_steps());
}

}  // namespace
}  // namespace dockloop
