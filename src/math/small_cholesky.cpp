// Factors and solutions; see small_cholesky.hpp.
#include "math/small_cholesky.hpp"

namespace dockloop {
namespace {

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
    positive = functions_->factorise_6(A.data(), L_.data());
  } else if (A.rows() == 12) {
    positive = functions_->factorise_12(A.data(), L_.data());
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
    functions_->solve_12(L_.data(), x.data());
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
