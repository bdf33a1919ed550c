// Eigen compiled for these matrices; see decompositions.hpp.
#include "math/decompositions.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>

namespace dockloop {

bool is_positive_definite(const Mat3<double>& matrix) {
  return matrix(0, 0) > 0.0 && matrix.topLeftCorner<2, 2>().determinant() > 0.0 &&
         matrix.determinant() > 0.0;
}

Vec3<double> find_principal_moments(const Mat3<double>& inertia) {
  return Eigen::SelfAdjointEigenSolver<Mat3<double>>(inertia, Eigen::EigenvaluesOnly).eigenvalues();
}

Vec6<double> find_eigenvalues(const Mat6<double>& matrix) {
  return Eigen::SelfAdjointEigenSolver<Mat6<double>>(matrix, Eigen::EigenvaluesOnly).eigenvalues();
}

PrincipalAxes find_principal_axes(const Mat6<double>& matrix) {
  const Eigen::SelfAdjointEigenSolver<Mat6<double>> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

VecX<double> find_singular_values(const MatX<double>& matrix) {
  return Eigen::JacobiSVD<MatX<double>>(matrix).singularValues();
}

MatX<double> find_null_space(const MatX<double>& matrix, double threshold) {
  Eigen::JacobiSVD<MatX<double>> svd(matrix, Eigen::ComputeFullV);
  svd.setThreshold(threshold);
  return svd.matrixV().rightCols(matrix.cols() - svd.rank());
}

int find_rank(const MatX<double>& matrix, double threshold) {
  Eigen::ColPivHouseholderQR<MatX<double>> qr;
  qr.setThreshold(threshold);
  qr.compute(matrix);
  return static_cast<int>(qr.rank());
}

std::vector<int> find_pivots(const MatX<double>& matrix, int count) {
  if (count == 0) return {};  // a matrix without rows has no factorisation
  const Eigen::ColPivHouseholderQR<MatX<double>> qr(matrix);
  const auto* first = qr.colsPermutation().indices().data();
  std::vector<int> pivots(first, first + count);
  std::sort(pivots.begin(), pivots.end());
  return pivots;
}

VecX<double> solve_least(const MatX<double>& matrix, const VecX<double>& right, double threshold) {
  Eigen::CompleteOrthogonalDecomposition<MatX<double>> solver;
  solver.setThreshold(threshold);
  solver.compute(matrix);
  return solver.solve(right);
}

Mat3<double> invert(const Mat3<double>& matrix) { return matrix.inverse(); }

Mat6<double> find_cholesky_factor(const Mat6<double>& matrix) { return matrix.llt().matrixL(); }

}  // namespace dockloop
