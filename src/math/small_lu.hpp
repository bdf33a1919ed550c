// LU factorisation with partial pivoting of the small square systems of a loop block (m <= ~20).
//
// Works in place on a caller's buffer, generic in the scalar, without allocation: loop matrices are
// 2x2 to 4x4 (a block of mutually dependent loops is larger), where library calls cost more than
// the arithmetic.
#pragma once

#include <cmath>
#include <vector>

#include "math/types.hpp"

namespace dockloop {

template <class S>
class SmallLu {
 public:
  explicit SmallLu(int n = 0) { resize(n); }
  void resize(int n) {
    n_ = n;
    lu_.setZero(n, n);
    pivot_.assign(static_cast<size_t>(n), 0);
    column_.setZero(n);
    inverse_.setZero(n);
  }
  int size() const { return n_; }

  /// Factorise the left n x n part of A. @return false if a pivot is exactly zero or not finite.
  template <class Derived>
  bool factorise(const Eigen::MatrixBase<Derived>& A) {
    using std::abs;
    for (int j = 0; j < n_; ++j) {
      for (int i = 0; i < n_; ++i) lu_(i, j) = A(i, j);
    }
    for (int k = 0; k < n_; ++k) {
      int p = k;
      for (int i = k + 1; i < n_; ++i) {
        if (abs(lu_(i, k)) > abs(lu_(p, k))) p = i;
      }
      pivot_[k] = p;
      if (!(abs(lu_(p, k)) > S(0)) || !(abs(lu_(p, k)) < S(1e300))) return false;
      if (p != k) {
        for (int j = 0; j < n_; ++j) std::swap(lu_(p, j), lu_(k, j));
      }
      const S inverse = S(1) / lu_(k, k);
      inverse_[k] = inverse;
      S* factor = lu_.data() + n_ * k;
      for (int i = k + 1; i < n_; ++i) factor[i] *= inverse;
      for (int j = k + 1; j < n_; ++j) {  // column by column, as they stand in memory
        S* column = lu_.data() + n_ * j;
        const S top = column[k];
        for (int i = k + 1; i < n_; ++i) column[i] -= factor[i] * top;
      }
    }
    return true;
  }

  /// x := A^-1 x for one column.
  template <class Column>
  void solve(Column&& x) const {
    for (int k = 0; k < n_; ++k) {
      if (pivot_[k] != k) std::swap(x[k], x[pivot_[k]]);
    }
    for (int k = 0; k < n_; ++k) {
      for (int i = k + 1; i < n_; ++i) x[i] -= lu_(i, k) * x[k];
    }
    for (int k = n_ - 1; k >= 0; --k) {
      x[k] *= inverse_[k];
      for (int i = 0; i < k; ++i) x[i] -= lu_(i, k) * x[k];
    }
  }

  /// x := A^-T x for one column.
  template <class Column>
  void solve_transposed(Column&& x) const {
    for (int k = 0; k < n_; ++k) {
      for (int i = 0; i < k; ++i) x[k] -= lu_(i, k) * x[i];
      x[k] *= inverse_[k];
    }
    for (int k = n_ - 1; k >= 0; --k) {
      for (int i = k + 1; i < n_; ++i) x[k] -= lu_(i, k) * x[i];
    }
    for (int k = n_ - 1; k >= 0; --k) {
      if (pivot_[k] != k) std::swap(x[k], x[pivot_[k]]);
    }
  }

  /// Sign of the determinant, +1 or -1.
  int determinant_sign() const {
    int sign = 1;
    for (int k = 0; k < n_; ++k) {
      if (pivot_[k] != k) sign = -sign;
      if (lu_(k, k) < S(0)) sign = -sign;
    }
    return sign;
  }

  /// Frobenius norm of the inverse of the scaled matrix A(i, j) column[j] / row[i]: its reciprocal
  /// bounds the smallest singular value of that matrix from below (within sqrt(n)).
  S scaled_inverse_norm(const VecX<double>& row, const VecX<double>& column) {
    using std::sqrt;
    S sum(0);
    for (int j = 0; j < n_; ++j) {
      column_.setZero();
      column_[j] = S(row[j]);
      solve(column_);
      for (int i = 0; i < n_; ++i) {
        const S entry = column_[i] / S(column[i]);
        sum += entry * entry;
      }
    }
    return sqrt(sum);
  }

 private:
  int n_ = 0;
  MatX<S> lu_;
  std::vector<int> pivot_;
  VecX<S> column_, inverse_;  // scratch; reciprocals of the pivots
};

}  // namespace dockloop
