// Eigenvalues, singular values, ranks and inverses of plain matrices, and the physical limits of
// moments of inertia.
//
// decompositions.cpp alone compiles these parts of Eigen: each costs seconds. One other file
// compiles complex eigenvalues.
#pragma once

#include <vector>

#include "math/types.hpp"

namespace dockloop {

/// @pre it is symmetric
bool is_positive_definite(const Mat3<double>& matrix);

/// Ascending [kg m2].
Vec3<double> find_principal_moments(const Mat3<double>& inertia);

/// Moments are sums of squares: no moment is larger than the sum of the two others.
/// @param moment  ascending; @param rounding  of them, relative
inline bool can_have_moments(const Vec3<double>& moment, double rounding) {
  return moment[2] <= (moment[0] + moment[1]) * (1.0 + rounding);
}

/// Of a symmetric matrix, ascending.
Vec6<double> find_eigenvalues(const Mat6<double>& matrix);

struct PrincipalAxes {
  Vec6<double> value;  ///< ascending
  Mat6<double> axis;   ///< columns of length 1
};
/// Eigenvalues and eigenvectors of a symmetric matrix.
PrincipalAxes find_principal_axes(const Mat6<double>& matrix);

/// Descending.
VecX<double> find_singular_values(const MatX<double>& matrix);

/// Orthonormal basis, as columns. @param threshold  smaller singular values count as zero, relative
MatX<double> find_null_space(const MatX<double>& matrix, double threshold);

/// By a QR factorisation with column pivoting.
/// @param threshold  smaller pivots count as zero, relative
int find_rank(const MatX<double>& matrix, double threshold);
/// The columns of the first pivots of such a factorisation, ascending.
std::vector<int> find_pivots(const MatX<double>& matrix, int count);

/// The smallest x with the smallest |matrix x - right|. @param threshold  as for find_rank
VecX<double> solve_least(const MatX<double>& matrix, const VecX<double>& right, double threshold);

Mat3<double> invert(const Mat3<double>& matrix);

/// L of L L^T = matrix. @pre it is positive definite
Mat6<double> find_cholesky_factor(const Mat6<double>& matrix);

}  // namespace dockloop
