// Factors and solutions; see small_cholesky.hpp.
#include "math/small_cholesky.hpp"

namespace dockloop {
namespace {

/// Columns W = L D^(1/2) of the factor, and the reciprocals of D, one after another: no operation
/// waits for a square root. Even rows first, in pairs, so that all loops have constant bounds.
template <int N, int J>
void eliminate(const double* A, double* W, double* inverse) {
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

/// The factor of A in the lower triangle of L.
template <int N>
bool factorise(const double* A, double* L) {
  std::array<double, N * N> W;
  std::array<double, N> inverse;
  eliminate<N, 0>(A, W.data(), inverse.data());
  bool positive = true;
  for (int j = 0; j < N; ++j) {
    positive = positive && !(W[N * j + j] <= 0.0);  // NaN is not detected here, as with Eigen
    const double root = 1.0 / std::sqrt(W[N * j + j]);
    for (int i = j; i < N; ++i) L[N * j + i] = W[N * j + i] * root;
  }
  return positive;
}

template <int N>
void solve_each(const SmallCholesky& factor, Eigen::Ref<MatX<double>> x) {
  std::array<double, N> column;
  for (Eigen::Index j = 0; j < x.cols(); ++j) {
    for (int i = 0; i < N; ++i) column[i] = x(i, j);
    factor.solve_leading<N>(column.data());
    for (int i = 0; i < N; ++i) x(i, j) = column[i];
  }
}

}  // namespace

void SmallCholesky::compute(const MatX<double>& A) {
  bool positive = true;
  L_.resize(A.rows(), A.cols());
  if (A.rows() == 6) {
    positive = factorise<6>(A.data(), L_.data());
  } else if (A.rows() == 12) {
    positive = factorise<12>(A.data(), L_.data());
  } else {
    L_ = A;
    positive = Eigen::LLT<Eigen::Ref<MatX<double>>>(L_).info() == Eigen::Success;
  }
  info_ = positive ? Eigen::Success : Eigen::NumericalIssue;
}

void SmallCholesky::solve_column(Eigen::Ref<VecX<double>> x) const {
  if (L_.rows() == 6) {
    solve_leading<6>(x.data());
  } else if (L_.rows() == 12) {
    solve_leading<12>(x.data());
  } else {
    L_.triangularView<Eigen::Lower>().solveInPlace(x);
    L_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  }
}

void SmallCholesky::solve_columns(Eigen::Ref<MatX<double>> x) const {
  if (L_.rows() == 6) {
    solve_each<6>(*this, x);
  } else if (L_.rows() == 12) {
    solve_each<12>(*this, x);
  } else {
    L_.triangularView<Eigen::Lower>().solveInPlace(x);
    L_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  }
}

}  // namespace dockloop
