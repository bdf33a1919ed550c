// Factors and solutions; see small_cholesky.hpp.
#include "math/small_cholesky.hpp"

namespace dockloop {
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
  if (L_.rows() == 6 || L_.rows() == 12) {
    for (Eigen::Index j = 0; j < x.cols(); ++j) solve_column(x.col(j));
  } else {
    L_.triangularView<Eigen::Lower>().solveInPlace(x);
    L_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  }
}

}  // namespace dockloop
