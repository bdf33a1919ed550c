// Principal moments of inertia, and their physical limits.
#pragma once

#include <Eigen/Eigenvalues>

#include "math/types.hpp"

namespace dockloop {

/// Ascending [kg m2].
inline Vec3<double> find_principal_moments(const Mat3<double>& inertia) {
  return Eigen::SelfAdjointEigenSolver<Mat3<double>>(inertia, Eigen::EigenvaluesOnly).eigenvalues();
}

/// Moments are sums of squares: no moment is larger than the sum of the two others.
/// @param moment  ascending; @param rounding  of them, relative
inline bool can_have_moments(const Vec3<double>& moment, double rounding) {
  return moment[2] <= (moment[0] + moment[1]) * (1.0 + rounding);
}

}  // namespace dockloop
