// Cholesky factors of small matrices against Eigen's.
// 1. factor, solution of several columns and of a leading block, sizes with and without loops of
//    their own;
// 2. a matrix that is not positive definite is reported, wherever the bad pivot is.
#include "math/small_cholesky.hpp"

#include <gtest/gtest.h>

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

INSTANTIATE_TEST_SUITE_P(All, SmallCholeskySize, ::testing::Values(1, 5, 6, 7, 12, 13));

}  // namespace
}  // namespace dockloop
