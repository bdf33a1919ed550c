// Cholesky factors of small matrices against Eigen's.
// 1. factor, solution of several columns and of a leading block, sizes with and without loops of
//    their own;
// 2. a matrix that is not positive definite is reported, wherever the bad pivot is;
// 3. factors, solutions and weighted sums have the same bits in SIMD lanes of every width.
#include "math/small_cholesky.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

/// Random, symmetric, eigenvalues 0.1 to about n; the upper triangle is spoilt: it must not count.
MatX<double> make_positive(TestRandom& random, int n) {
  MatX<double> B(n, n);
  for (int i = 0; i < B.size(); ++i) B.data()[i] = random.uniform(-1, 1);
  MatX<double> A = B * B.transpose() + 0.1 * MatX<double>::Identity(n, n);
  A.triangularView<Eigen::StrictlyUpper>().setConstant(7.0);
  return A;
}

class SmallCholeskySize : public ::testing::TestWithParam<int> {};

TEST_P(SmallCholeskySize, agrees_with_the_library) {
  const int n = GetParam();
  TestRandom random(61);
  Residual factor, solution, leading;
  SmallCholesky own(n);
  for (int trial = 0; trial < 200; ++trial) {
    const MatX<double> A = make_positive(random, n);
    const Eigen::LLT<MatX<double>> library(A);
    own.compute(A);
    ASSERT_EQ(own.info(), Eigen::Success);
    const MatX<double> found = own.matrixLLT().triangularView<Eigen::Lower>();
    const MatX<double> expected = library.matrixL();
    factor.add((found - expected).norm() / expected.norm());
    MatX<double> X(n, 3);
    for (int i = 0; i < X.size(); ++i) X.data()[i] = random.uniform(-1, 1);
    const MatX<double> right = X;
    own.solveInPlace(X);
    const MatX<double> whole = A.selfadjointView<Eigen::Lower>();
    solution.add((whole * X - right).norm() / (whole.norm() * X.norm()));
    if (n < 6) continue;
    Vec6<double> x = right.col(0).head<6>();
    solve_leading<6>(own, x);
    leading.add((whole.topLeftCorner<6, 6>() * x - right.col(0).head<6>()).norm() /
                (whole.norm() * x.norm()));
  }
  EXPECT_RESIDUAL_BELOW(factor, 1e-13);
  EXPECT_RESIDUAL_BELOW(solution, 1e-14);
  EXPECT_RESIDUAL_BELOW(leading, 1e-14);
}

TEST_P(SmallCholeskySize, tells_what_is_not_positive) {
  const int n = GetParam();
  TestRandom random(62);
  for (int bad = 0; bad < n; ++bad) {
    SmallCholesky own(n);
    MatX<double> A = make_positive(random, n);
    A(bad, bad) = -A(bad, bad);
    own.compute(A);
    EXPECT_EQ(own.info(), Eigen::NumericalIssue) << bad;
  }
}

TEST(Columns, have_the_same_bits_for_every_width) {
  TestRandom random(63);
  const auto draw = [&](int count) {
    std::vector<double> numbers(static_cast<size_t>(count));
    for (double& number : numbers) number = random.uniform(-1, 1);
    return numbers;
  };
  const auto find = [](int widest, const auto& put, int count) {
    std::vector<double> found(static_cast<size_t>(count), 0.0);
    put(columns::find_column_functions(widest), found.data());
    return found;
  };
  for (int trial = 0; trial < 100; ++trial) {
    const MatX<double> A = make_positive(random, 12), B = make_positive(random, 6);
    const std::vector<double> right = draw(12), base = draw(24), stages = draw(7 * 24);
    const std::vector<double> weight = draw(7);
    const double h = random.uniform(1e-3, 1.0);
    SmallCholesky factor(12);
    factor.compute(A);
    const auto factorise_12 = [&](const auto& of, double* L) {
      EXPECT_TRUE(of.factorise_12(A.data(), L));
    };
    const auto factorise_6 = [&](const auto& of, double* L) {
      EXPECT_TRUE(of.factorise_6(B.data(), L));
    };
    const auto solve_12 = [&](const auto& of, double* x) {
      std::copy(right.begin(), right.end(), x);
      of.solve_12(factor.matrixLLT().data(), x);
    };
    const auto add_up = [&](const auto& of, double* sum) {
      of.add_up(weight.data(), stages.data(), 7, 24, h, base.data(), sum);
    };
    for (const int widest : {4, 8}) {
      ASSERT_EQ(find(widest, solve_12, 12), find(2, solve_12, 12));
      ASSERT_EQ(find(widest, add_up, 24), find(2, add_up, 24));
      const auto are_same = [&](const auto& put, int n) {
        const auto lower = [&](int lanes) {
          const std::vector<double> L = find(lanes, put, n * n);
          return MatX<double>(
              Eigen::Map<const MatX<double>>(L.data(), n, n).triangularView<Eigen::Lower>());
        };
        return lower(widest) == lower(2);
      };
      ASSERT_TRUE(are_same(factorise_12, 12) && are_same(factorise_6, 6));
    }
    for (size_t i = 0; i < 24; ++i) {
      double sum = 0.0;
      for (size_t j = 0; j < 7; ++j) sum += weight[j] * stages[24 * j + i];
      ASSERT_EQ(find(8, add_up, 24)[i], base[i] + h * sum);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, SmallCholeskySize, ::testing::Values(1, 5, 6, 7, 12, 13));

}  // namespace
}  // namespace dockloop
