// Cholesky factor of a small symmetric positive definite matrix, A = L L^T, for plain numbers.
//
// A ring on a fixed base has 6 coordinates, on a vehicle 12. Loops of these lengths take about half
// the time of Eigen's LLT (tests/unit/small_cholesky_test.cpp compares the results). Eigen's LLT
// serves all other sizes and scalars.
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

#include "math/types.hpp"

namespace dockloop {

class SmallCholesky {
 public:
  /// @param n  rows of the matrix
  explicit SmallCholesky(int n = 0) : L_(MatX<double>::Identity(n, n)) {}

  /// Factorise A (n x n; its lower triangle counts). No allocation unless the size changes.
  void compute(const MatX<double>& A) {
    bool positive = true;
    L_ = A;
    if (A.rows() == 6) {
      positive = factorise<6>(L_.data());
    } else if (A.rows() == 12) {
      positive = factorise<12>(L_.data());
    } else {
      positive = Eigen::LLT<Eigen::Ref<MatX<double>>>(L_).info() == Eigen::Success;
    }
    info_ = positive ? Eigen::Success : Eigen::NumericalIssue;
  }
  Eigen::ComputationInfo info() const { return info_; }

  /// The factor in the lower triangle.
  const MatX<double>& matrixLLT() const { return L_; }
  double* data() { return L_.data(); }  ///< by columns, for code that computes the factor itself

  /// x := A^-1 x, every column.
  template <class Derived>
  void solveInPlace(const Eigen::MatrixBase<Derived>& x) const {
    Derived& target = x.const_cast_derived();
    if (L_.rows() == 6) {
      solve_columns<6>(target);
    } else if (L_.rows() == 12) {
      solve_columns<12>(target);
    } else {
      L_.triangularView<Eigen::Lower>().solveInPlace(target);
      L_.transpose().triangularView<Eigen::Upper>().solveInPlace(target);
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
  /// Columns W = L D^(1/2) of the factor, and the reciprocals of D, one after another: no operation
  /// waits for a square root. Even rows first, in pairs, so that all loops have constant bounds.
  template <int N, int J>
  static void eliminate(const double* A, double* W, double* inverse) {
    if constexpr (J < N) {
      constexpr int kFirst = J / 2 * 2;
      std::array<double, N> column;
      for (int i = kFirst; i < N; ++i) column[i] = A[N * J + i];
      for (int k = 0; k < J; ++k) {
        const double factor = W[N * k + J] * inverse[k];
        for (int i = kFirst; i < N; ++i) column[i] -= factor * W[N * k + i];
      }
      inverse[J] = 1.0 / column[J];
      for (int i = kFirst; i < N; ++i) W[N * J + i] = column[i];
      eliminate<N, J + 1>(A, W, inverse);
    }
  }

  template <int N>
  static bool factorise(double* A) {
    std::array<double, N * N> W;
    std::array<double, N> inverse;
    eliminate<N, 0>(A, W.data(), inverse.data());
    bool positive = true;
    for (int j = 0; j < N; ++j) {
      positive = positive && !(W[N * j + j] <= 0.0);  // NaN is not detected here, as with Eigen
      const double root = 1.0 / std::sqrt(W[N * j + j]);
      for (int i = j; i < N; ++i) A[N * j + i] = W[N * j + i] * root;
    }
    return positive;
  }

  template <int N, int J>
  static void solve_lower(const double* L, int stride, const double* inverse, double* x) {
    if constexpr (J < N) {
      x[J] *= inverse[J];
      for (int i = J + 1; i < N; ++i) x[i] -= x[J] * L[stride * J + i];
      solve_lower<N, J + 1>(L, stride, inverse, x);
    }
  }

  template <int N, int J>
  static void solve_upper(const double* L, int stride, const double* inverse, double* x) {
    if constexpr (J >= 0) {
      x[J] *= inverse[J];
      for (int i = 0; i < J; ++i) x[i] -= x[J] * L[stride * i + J];
      solve_upper<N, J - 1>(L, stride, inverse, x);
    }
  }

  template <int N, class Derived>
  void solve_columns(Derived& x) const {
    std::array<double, N> column;
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      for (int i = 0; i < N; ++i) column[i] = x(i, j);
      solve_leading<N>(column.data());
      for (int i = 0; i < N; ++i) x(i, j) = column[i];
    }
  }

  MatX<double> L_;
  Eigen::ComputationInfo info_ = Eigen::Success;
};

/// Factorisation of matrices of S.
template <class S>
using Cholesky = std::conditional_t<std::is_same_v<S, double>, SmallCholesky, Eigen::LLT<MatX<S>>>;

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

}  // namespace dockloop
