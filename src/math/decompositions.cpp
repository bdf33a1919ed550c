// Eigen compiled for these matrices; see decompositions.hpp.
#include "math/decompositions.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

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

Mat3<double> invert(const Mat3<double>& matrix) { return matrix.inverse(); }

Mat6<double> find_cholesky_factor(const Mat6<double>& matrix) { return matrix.llt().matrixL(); }

}  // namespace dockloop
