// Factors and solutions; see small_cholesky.hpp.
#include "math/small_cholesky.hpp"

#include "math/pair.hpp"

namespace dockloop {
namespace {

/// Columns W = L D^(1/2) of the factor, and the reciprocals of D, one after another: no operation
/// waits for a square root. Even rows first, in pairs, so that all loops have constant bounds.
template <int N, int J>
void eliminate(const double* A, std::array<Pair, N / 2>* W, double* inverse) {
  if constexpr (J < N) {
    constexpr int kFirst = J / 2, kPairs = N / 2;
    std::array<Pair, kPairs> column;
    for (int i = kFirst; i < kPairs; ++i) column[i] = load_pair(A + N * J + 2 * i);
#pragma GCC unroll 12
    for (int k = 0; k < J; ++k) {
      const double factor = W[k][kFirst][J % 2] * inverse[k];
      for (int i = kFirst; i < kPairs; ++i) column[i] -= factor * W[k][i];
    }
    inverse[J] = 1.0 / column[kFirst][J % 2];
    for (int i = kFirst; i < kPairs; ++i) W[J][i] = column[i];
    eliminate<N, J + 1>(A, W, inverse);
  }
}

/// The factor of A in the lower triangle of L; above it, numbers without meaning.
template <int N>
bool factorise(const double* A, double* L) {
  static_assert(N % 2 == 0);
  std::array<Pair, N / 2> W[N];
  std::array<double, N> inverse;
  eliminate<N, 0>(A, W, inverse.data());
  bool positive = true;
  for (int j = 0; j < N; ++j) {
    const double pivot = W[j][j / 2][j % 2];
    positive = positive && !(pivot <= 0.0);  // NaN is not detected here, as with Eigen
    const double root = 1.0 / std::sqrt(pivot);
    for (int i = j / 2; i < N / 2; ++i) store_pair(W[j][i] * root, L + N * j + 2 * i);
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
