// Cholesky factor of a small symmetric positive definite matrix, A = L L^T.
//
// Plain numbers: a ring on a fixed base has 6 coordinates, on a vehicle 12. Loops of these lengths
// take about half the time of Eigen's LLT (tests/unit/small_cholesky_test.cpp compares the
// results). Eigen's LLT serves all other sizes.
//
// Dual numbers: the factor of the values serves the derivatives x' of a solution x too,
//   A x = b,   A x' = b' - A' x
// so no factor of dual numbers is made. Eigen's LLT serves all other scalars.
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

#include "math/column_lanes.hpp"
#include "math/dual.hpp"
#include "math/types.hpp"

namespace dockloop {

class SmallCholesky {
 public:
  /// @param n  rows of the matrix
  explicit SmallCholesky(int n = 0) : L_(MatX<double>::Identity(n, n)) {}

  /// Factorise A (n x n; its lower triangle counts). No allocation unless the size changes.
  void compute(const MatX<double>& A);
  Eigen::ComputationInfo info() const { return info_; }

  /// The factor in the lower triangle.
  const MatX<double>& matrixLLT() const { return L_; }
  double* data() { return L_.data(); }  ///< by columns, for code that computes the factor itself

  /// x := A^-1 x, every column.
  template <class Derived>
  void solveInPlace(const Eigen::MatrixBase<Derived>& x) const {
    if constexpr (Derived::ColsAtCompileTime == 1) {
      solve_column(x.const_cast_derived());
    } else {
      solve_columns(x.const_cast_derived());
    }
  }

  /// x := A_N^-1 x with the leading N x N block of A, whose factor is the leading block of L.
  template <int N>
  void solve_leading(double* x) const {
    const double* L = L_.data();
    const int stride = static_cast<int>(L_.rows());
    std::array<double, N> inverse;
    for (int j = 0; j < N; ++j) inverse[j] = 1.0 / L[stride * j + j];
    solve_lower<N, 0>(L, stride, inverse.data(), x);
    solve_upper<N, N - 1>(L, stride, inverse.data(), x);
  }

 private:
  void solve_column(Eigen::Ref<VecX<double>> x) const;
  void solve_columns(Eigen::Ref<MatX<double>> x) const;

  template <int N, int J>
  static void solve_lower(const double* L, int stride, const double* inverse, double* x) {
    if constexpr (J < N) {
      x[J] *= inverse[J];
#pragma GCC unroll 12  // vectors of so few numbers cost more than they save
      for (int i = J + 1; i < N; ++i) x[i] -= x[J] * L[stride * J + i];
      solve_lower<N, J + 1>(L, stride, inverse, x);
    }
  }

  template <int N, int J>
  static void solve_upper(const double* L, int stride, const double* inverse, double* x) {
    if constexpr (J >= 0) {
      x[J] *= inverse[J];
#pragma GCC unroll 12
      for (int i = 0; i < J; ++i) x[i] -= x[J] * L[stride * i + J];
      solve_upper<N, J - 1>(L, stride, inverse, x);
    }
  }

  const columns::ColumnFunctions* functions_ = &columns::find_column_functions();
  MatX<double> L_;
  Eigen::ComputationInfo info_ = Eigen::Success;
};

/// Factor of the values of a matrix of dual numbers, and the derivatives of the matrix.
template <int N>
class DualCholesky {
 public:
  explicit DualCholesky(int n = 0) : factor_(n) { compute(MatX<Dual<N>>::Identity(n, n)); }

  /// The lower triangle of A counts. No allocation unless the size changes.
  void compute(const MatX<Dual<N>>& A) {
    A_ = A;
    value_.resize(A.rows(), A.cols());
    for (Eigen::Index i = 0; i < A.size(); ++i) value_.data()[i] = A.data()[i].value;
    factor_.compute(value_);
  }
  Eigen::ComputationInfo info() const { return factor_.info(); }

  void solveInPlace(VecX<Dual<N>>& x) const { solve(static_cast<int>(x.size()), x.data()); }

  /// x := A_n^-1 x with the leading n x n block of A.
  void solve(int n, Dual<N>* x) const {
    const auto each_lane = [](auto&& change) {
      for (int k = 0; k < N; ++k) change(k);
    };
    const MatX<double>& L = factor_.matrixLLT();
    for (int j = 0; j < n; ++j) {
      x[j].value /= L(j, j);
      for (int i = j + 1; i < n; ++i) x[i].value -= L(i, j) * x[j].value;
    }
    for (int j = n - 1; j >= 0; --j) {
      for (int i = j + 1; i < n; ++i) x[j].value -= L(i, j) * x[i].value;
      x[j].value /= L(j, j);
    }
    for (int j = 0; j < n; ++j) {
      each_lane([&](int k) { x[j].d[k] -= A_(j, j).d[k] * x[j].value; });
      for (int i = j + 1; i < n; ++i) {
        each_lane([&](int k) {
          x[i].d[k] -= A_(i, j).d[k] * x[j].value;
          x[j].d[k] -= A_(i, j).d[k] * x[i].value;
        });
      }
    }
    for (int j = 0; j < n; ++j) {
      const double inverse = 1.0 / L(j, j);
      each_lane([&](int k) { x[j].d[k] *= inverse; });
      for (int i = j + 1; i < n; ++i) each_lane([&](int k) { x[i].d[k] -= L(i, j) * x[j].d[k]; });
    }
    for (int j = n - 1; j >= 0; --j) {
      for (int i = j + 1; i < n; ++i) each_lane([&](int k) { x[j].d[k] -= L(i, j) * x[i].d[k]; });
      const double inverse = 1.0 / L(j, j);
      each_lane([&](int k) { x[j].d[k] *= inverse; });
    }
  }

 private:
  SmallCholesky factor_;
  MatX<Dual<N>> A_;
  MatX<double> value_;
};

/// The class that factorises matrices of S.
template <class S>
struct CholeskyOf {
  using type = Eigen::LLT<MatX<S>>;
};
template <>
struct CholeskyOf<double> {
  using type = SmallCholesky;
};
template <int N>
struct CholeskyOf<Dual<N>> {
  using type = DualCholesky<N>;
};
template <class S>
using Cholesky = typename CholeskyOf<S>::type;

/// x := A_N^-1 x, as SmallCholesky::solve_leading.
template <int N, class S>
void solve_leading(const Eigen::LLT<MatX<S>>& factor, Eigen::Matrix<S, N, 1>& x) {
  const Eigen::Matrix<S, N, N> L = factor.matrixLLT().template topLeftCorner<N, N>();
  L.template triangularView<Eigen::Lower>().solveInPlace(x);
  L.transpose().template triangularView<Eigen::Upper>().solveInPlace(x);
}
template <int N>
void solve_leading(const SmallCholesky& factor, Eigen::Matrix<double, N, 1>& x) {
  factor.solve_leading<N>(x.data());
}
template <int N, int Lanes>
void solve_leading(const DualCholesky<Lanes>& factor, Eigen::Matrix<Dual<Lanes>, N, 1>& x) {
  factor.solve(N, x.data());
}

}  // namespace dockloop
