// The fit of host_mode.hpp.
#include "sim/host_mode.hpp"

#include <cmath>

#include "math/decompositions.hpp"

namespace dockloop {
namespace {

constexpr double kModeExplains = 0.01;  ///< of the squares of errors: what a mode may leave
constexpr double kModeGain = 0.1;       ///< of what a rigid body leaves
constexpr double kAllByRigid = 1e-8;    ///< of the squares: a rigid body explains all
constexpr double kPivot = 1e-14;        ///< of products, for regressors that are nearly the same

}  // namespace

void add_to_mode(const Vec6<double>& error, const Vec6<double>& change, double h, double keep,
                 ModeSums& sums) {
  ModeSums::Row row;
  row << error, change, sums.displacement, sums.velocity;
  sums.products *= keep;
  sums.products.noalias() += row * row.transpose();
  sums.displacement += h * (sums.velocity + 0.5 * error);
  sums.velocity += error;
}

double find_mode_frequency(const ModeSums& sums, double h) {
  const auto block = [&](int a, int b) { return sums.products.block<6, 6>(6 * a, 6 * b); };
  const Vec6<double> u = find_principal_axes(block(0, 0)).axis.col(5);
  const auto along = [&](int a, int b) { return u.dot(block(a, b) * u); };
  const double error2 = along(0, 0);
  Mat3<double> matrix;
  Vec3<double> side, scale;
  for (int a = 0; a < 3; ++a) {
    scale[a] = 1.0 / std::sqrt(along(a + 1, a + 1));
    if (!std::isfinite(scale[a])) return 0.0;
  }
  for (int a = 0; a < 3; ++a) {
    for (int b = 0; b < 3; ++b) matrix(a, b) = scale[a] * scale[b] * along(a + 1, b + 1);
    matrix(a, a) += kPivot;
    side[a] = scale[a] * along(a + 1, 0);
  }
  const Vec3<double> constant = invert(matrix) * side;
  const double by_rigid = error2 - side[0] * side[0], by_mode = error2 - constant.dot(side);
  if (!(by_rigid > kAllByRigid * error2 && by_mode < kModeGain * by_rigid &&
        by_mode < kModeExplains * error2)) {
    return 0.0;
  }
  // s moves on by c S + d s, S by the mean of s over the step: the mode swings if the eigenvalues
  // of this are complex.
  const double c = h * scale[1] * constant[1], d = scale[2] * constant[2];
  const double mean = 1.0 + 0.5 * d + 0.25 * c, size2 = 1.0 + d - 0.5 * c;
  if (!(size2 > mean * mean)) return 0.0;
  return std::acos(mean / std::sqrt(size2)) / (2.0 * static_cast<double>(EIGEN_PI) * h);
}

}  // namespace dockloop
