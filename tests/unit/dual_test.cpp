// Dual numbers: exact derivatives of every operation the core uses.
// 1. every function and operator: the analytic derivative, in each lane, to rounding;
// 2. the same and compositions of them: central differences of sixth order in long double;
// 3. plain numbers on either side are constants, order looks at the value only, equality at
// everything;
// 4. kinks and singular points behave as the header says;
// 5. a Cholesky solution has its derivative, also of a leading block; in rotations: exp and log
//    undo each other, at the zero rotation too; a spring's force is the derivative of its energy.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <type_traits>

#include "math/one_sided_spring.hpp"
#include "math/rotation.hpp"
#include "math/scalar.hpp"
#include "math/small_cholesky.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using D = Dual<3>;
using L = long double;

static_assert(std::is_trivially_copyable_v<D> && std::is_trivially_default_constructible_v<D>);
static_assert(sizeof(Derivative) == 9 * sizeof(double), "a plain block: no heap, no padding");
static_assert(!std::is_convertible_v<D, double>, "derivatives are never dropped in silence");

constexpr double kAnalytic = 3e-15;    // worst residual 2.9e-16
constexpr double kDifference = 5e-15;  // worst residual 5.2e-16
constexpr double kEigen = 2e-15;       // worst residual 2.2e-16

/// Directions of the two arguments: one alone, the other alone, both mixed.
constexpr double kAlongX[3] = {1.0, 0.0, 0.3}, kAlongY[3] = {0.0, 1.0, -0.7};

D make_argument(double value, const double* along) {
  D x(value);
  for (int i = 0; i < 3; ++i) x.d[i] = along[i];
  return x;
}

/// f(x, y) of any scalar, and its partial derivatives.
template <class F, class Fx, class Fy>
void check(const char* name, F f, Fx f_x, Fy f_y, Residual& analytic, Residual& difference) {
  TestRandom random(11);
  for (int n = 0; n < 20; ++n) {
    // Positive and negative, away from zero.
    const double x = random.uniform(0.3, 2.0) * (n % 2 == 0 ? 1 : -1);
    const double y = random.uniform(0.3, 2.0) * (n % 4 < 2 ? 1 : -1);
    const D actual = f(make_argument(x, kAlongX), make_argument(y, kAlongY));
    ASSERT_EQ(actual.value, f(x, y)) << name << ": not the value of the plain evaluation";
    for (int i = 0; i < 3; ++i) {
      const double expected = f_x(x, y) * kAlongX[i] + f_y(x, y) * kAlongY[i];
      analytic.add((actual.d[i] - expected) / (1 + std::abs(expected)), name);
      constexpr L h = 3e-4L;
      const L weight[3] = {3.0L / 4, -3.0L / 20, 1.0L / 60};
      L slope = 0;
      for (int s = 1; s <= 3; ++s) {
        const L dx = s * h * kAlongX[i], dy = s * h * kAlongY[i];
        slope += weight[s - 1] / h * (f(x + dx, y + dy) - f(x - dx, y - dy));
      }
      difference.add(static_cast<double>((actual.d[i] - slope) / (1 + std::abs(slope))), name);
    }
  }
}

TEST(Dual, every_operation_has_its_derivative) {
  using std::abs, std::atan2, std::cos, std::floor, std::log1p, std::sin, std::sqrt;
  Residual analytic, difference;
  const auto run = [&](const char* name, auto f, auto f_x, auto f_y) {
    check(name, f, f_x, f_y, analytic, difference);
  };
  const auto zero = [](double, double) { return 0.0; };
  const auto one = [](double, double) { return 1.0; };
  run("+", [](auto x, auto y) { return x + y; }, one, one);
  run("-", [](auto x, auto y) { return x - y; }, one, [](double, double) { return -1.0; });
  run(
      "*", [](auto x, auto y) { return x * y; }, [](double, double y) { return y; },
      [](double x, double) { return x; });
  run(
      "/", [](auto x, auto y) { return x / y; }, [](double, double y) { return 1 / y; },
      [](double x, double y) { return -x / (y * y); });
  run("unary -", [](auto x, auto) { return -x; }, [](double, double) { return -1.0; }, zero);
  run(
      "+=, -=, *=, /=",
      [](auto x, auto y) {
        auto z = x;
        z += y;
        z *= x;
        z -= y;
        z /= y;
        return z;
      },
      [](double x, double y) { return (2 * x + y) / y; },
      [](double x, double y) { return -x * x / (y * y); });
  run(
      "sqrt", [](auto x, auto) { return sqrt(x * x); },
      [](double x, double) { return std::copysign(1.0, x); }, zero);
  run(
      "abs", [](auto x, auto) { return abs(x); },
      [](double x, double) { return std::copysign(1.0, x); }, zero);
  run("floor", [](auto x, auto y) { return floor(x / 100) + y; }, zero, one);
  run(
      "sin", [](auto x, auto) { return sin(x); }, [](double x, double) { return std::cos(x); },
      zero);
  run(
      "cos", [](auto x, auto) { return cos(x); }, [](double x, double) { return -std::sin(x); },
      zero);
  run(
      "log1p", [](auto x, auto) { return log1p(x * x); },
      [](double x, double) { return 2 * x / (1 + x * x); }, zero);
  run(
      "atan2", [](auto y, auto x) { return atan2(y, x); },
      [](double y, double x) { return x / (x * x + y * y); },
      [](double y, double x) { return -y / (x * x + y * y); });
  run(
      "a composition", [](auto x, auto y) { return sin(x * y) / sqrt(x * x + y * y); },
      [](double x, double y) {
        const double r = std::sqrt(x * x + y * y);
        return y * std::cos(x * y) / r - x * std::sin(x * y) / (r * r * r);
      },
      [](double x, double y) {
        const double r = std::sqrt(x * x + y * y);
        return x * std::cos(x * y) / r - y * std::sin(x * y) / (r * r * r);
      });
  EXPECT_RESIDUAL_BELOW(analytic, kAnalytic);
  EXPECT_RESIDUAL_BELOW(difference, kDifference);
}

TEST(Dual, plain_numbers_on_either_side_are_constants) {
  const D x = make_argument(1.7, kAlongX), c(3);
  const auto expect_same = [](const D& actual, const D& expected) {
    EXPECT_DOUBLE_EQ(actual.value, expected.value);
    for (int i = 0; i < 3; ++i) EXPECT_DOUBLE_EQ(actual.d[i], expected.d[i]);
  };
  for (const double slope : c.d) EXPECT_EQ(slope, 0.0);
  expect_same(x + 3, x + c);
  expect_same(3.0 + x, c + x);
  expect_same(x - 3.0, x - c);
  expect_same(3 - x, c - x);
  expect_same(x * 3.0, x * c);
  expect_same(3 * x, c * x);
  expect_same(x / 3, x / c);
  expect_same(3.0 / x, c / x);
  expect_same(x * 3.0L, x * c);
  D sum = x;
  sum += 3;
  expect_same(sum, x + c);
}

TEST(Dual, order_looks_at_the_value_only_and_equality_at_everything) {
  const D a = D::variable(1.0, 0), b = D::variable(1.0, 1), c = D::variable(2.0, 0);
  EXPECT_TRUE(a <= b && a >= b && !(a < b) && !(a > b));
  EXPECT_TRUE(a != b && !(a == b) && a == a && !(a != a));
  EXPECT_TRUE(D::variable(0.0, 2) != D(0) && D(0) == 0);  // a zero that varies is not nothing
  EXPECT_TRUE(a < c && c > a && a <= c && c >= a && a != c && a < 2 && 2.0 > a);
  const D nan = std::numeric_limits<D>::quiet_NaN();
  EXPECT_FALSE(nan == nan || nan < a || nan > a || nan <= a || nan >= a);
  // The larger one brings its derivatives along.
  EXPECT_EQ(std::max(a, c).d[0], 1.0);
  EXPECT_EQ(to_double(std::max<D>(D(0), c)), 2.0);
  EXPECT_EQ(to_double(2.5), 2.5);
  EXPECT_EQ(to_double(2.5L), 2.5);
}

TEST(Dual, kinks_and_singular_points_are_as_stated) {
  const double infinite = std::numeric_limits<double>::infinity();
  const D zero = D::variable(0.0, 1);
  // abs(0) as from above, floor flat at its steps.
  EXPECT_EQ(abs(zero).d[1], 1.0);
  EXPECT_EQ(floor(D::variable(2.0, 1)).value, 2.0);
  EXPECT_EQ(floor(D::variable(2.0, 1)).d[1], 0.0);
  // Lanes in which nothing varies stay at zero; the others show that there is no derivative.
  EXPECT_EQ(sqrt(zero).value, 0.0);
  EXPECT_EQ(sqrt(zero).d[0], 0.0);
  EXPECT_EQ(sqrt(zero).d[1], infinite);
  EXPECT_TRUE(std::isnan(sqrt(D(-1)).value));
  const D angle = atan2(zero, D(0));
  EXPECT_EQ(angle.value, 0.0);
  EXPECT_EQ(angle.d[0], 0.0);
  EXPECT_TRUE(std::isnan(angle.d[1]));
  // On the negative axis atan2 jumps; its derivative does not.
  EXPECT_EQ(atan2(zero, D(-2)).d[1], -0.5);
  // The length of a vector that passes through zero.
  EXPECT_EQ(sqrt(zero * zero).d[1], 0.0);
}

TEST(Dual, a_cholesky_solution_has_its_derivative) {
  // x = A^-1 b has dx = A^-1 (db - dA x). The upper triangle of A must not count.
  Residual residual;
  for (int n : {6, 40}) {
    TestRandom random(5);
    MatX<double> A(n, n), dA(n, n);
    VecX<double> b(n), db(n);
    for (int i = 0; i < n; ++i) {
      b[i] = i % 2 ? random.uniform(-1, 1) : 0.0;  // Eigen skips zeros, but not those that vary
      db[i] = random.uniform(-1, 1);
      for (int j = 0; j <= i; ++j) {
        A(i, j) = A(j, i) = random.uniform(-1, 1) + (i == j ? n : 0);
        dA(i, j) = dA(j, i) = random.uniform(-1, 1);
      }
    }
    MatX<D> A_dual = A.cast<D>();
    VecX<D> x_dual = b.cast<D>();
    for (int i = 0; i < n; ++i) {
      x_dual[i].d[2] = db[i];
      for (int j = 0; j < n; ++j) A_dual(i, j).d[2] = dA(i, j);
    }
    A_dual.triangularView<Eigen::StrictlyUpper>().setConstant(D(7.0));
    Cholesky<D> factor(n);
    factor.compute(A_dual);
    ASSERT_EQ(factor.info(), Eigen::Success);
    factor.solveInPlace(x_dual);
    const VecX<double> x = A.llt().solve(b), dx = A.llt().solve(db - dA * x);
    for (int i = 0; i < n; ++i) {
      residual.add(x_dual[i].value - x[i], "value");
      residual.add(x_dual[i].d[2] - dx[i], "derivative");
      residual.add(x_dual[i].d[0], "lane that does not vary");
    }
    const MatX<double> block = A.topLeftCorner<6, 6>();
    Eigen::Matrix<D, 6, 1> leading = b.head<6>().cast<D>();
    for (int i = 0; i < 6; ++i) leading[i].d[2] = db[i];
    solve_leading<6>(factor, leading);
    const VecX<double> y = block.llt().solve(b.head<6>());
    const VecX<double> dy = block.llt().solve(db.head<6>() - dA.topLeftCorner<6, 6>() * y);
    for (int i = 0; i < 6; ++i) {
      residual.add(leading[i].value - y[i], "value with a leading block");
      residual.add(leading[i].d[2] - dy[i], "derivative with a leading block");
    }
  }
  EXPECT_RESIDUAL_BELOW(residual, kEigen);
}

TEST(Dual, exponential_and_logarithm_of_a_rotation_undo_each_other) {
  Residual residual;
  TestRandom random(3);
  for (const double size : {0.0, 1e-8, 1e-5, 1.0}) {
    const Vec3<double> value = size * make_unit(random);
    Vec3<D> r;
    for (int i = 0; i < 3; ++i) r[i] = D::variable(value[i], i);
    const Vec3<D> back = quat_log<D>(quat_exp<D>(r));
    for (int i = 0; i < 3; ++i) {
      residual.add(back[i].value - value[i], "value at angle " + std::to_string(size));
      for (int j = 0; j < 3; ++j) {
        residual.add(back[i].d[j] - (i == j ? 1.0 : 0.0), "slope at angle " + std::to_string(size));
      }
    }
  }
  EXPECT_RESIDUAL_BELOW(residual, kEigen);
}

TEST(Dual, the_force_of_a_spring_is_the_derivative_of_its_energy) {
  Residual residual;
  for (const double depth : {-0.1, 0.0, 0.004, 0.01, 0.2}) {
    const Elastic<D> spring = calc_toe_spring<D>(D::variable(depth, 0), D(5e3), D(0.01));
    residual.add((spring.energy.d[0] - spring.force.value) / 1e3);
    EXPECT_EQ(calc_damped_force<D>(spring.force, D(2), D(-1)).value, 0.0) << "a stop does not pull";
  }
  EXPECT_RESIDUAL_BELOW(residual, kAnalytic);
}

}  // namespace
}  // namespace dockloop
