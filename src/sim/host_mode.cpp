// The fit of host_mode.hpp.
#include "sim/host_mode.hpp"

#include <algorithm>
#include <cmath>

#include "math/decompositions.hpp"

namespace dockloop {
namespace {

constexpr double kModeExplains = 0.01;  ///< of the squares of changes: what a mode may leave
constexpr double kModeGain = 0.1;       ///< of what a rigid body leaves
constexpr double kAllByRigid = 1e-8;    ///< of the squares: a rigid body explains all
constexpr double kSeen = 1e-3;          ///< of the changes by loads: smaller ones do not count
constexpr double kBends = 0.1;        ///< of the squares: a part that leaves a rigid body in a step
constexpr double kPivot = 1e-14;      ///< of products, for regressors that are nearly the same
constexpr double kReturns = 0.02;     ///< in a step: decay of a part that is not seen to swing
constexpr double kShown = 0.5;        ///< of the constant of a mode that steps do not fold
constexpr double kLeastRatio = 1e-6;  ///< in steps, displacement per velocity: not rounding

enum Regressor { kChange, kDisplacement, kVelocity };

/// The frequency of an oscillator that begins and ends a step as A says.
/// @param A  displacement and velocity from those before
HostMode find_swing(const Eigen::Matrix2d& A, double h) {
  const double half = 0.5 * A.trace(), size2 = A.determinant();
  const double rest2 = half * half - size2;
  const bool returns = rest2 < 0.0 || half + std::sqrt(rest2) < 1.0 - kReturns;
  if (!(size2 > 0.0 && returns)) return {};
  constexpr double kTurn = 2.0 * static_cast<double>(EIGEN_PI);
  const double size = std::sqrt(size2);
  const double angle = std::acos(std::clamp(half / size, -1.0, 1.0));
  const double decay = -std::log(size) / (kTurn * h), folded = angle / kTurn;  // in Hz, in periods
  // Steps fold a swing to less than half a period, but not the ratio of the other constants.
  const bool has_ratio = std::abs(A(0, 1)) > kLeastRatio * h;
  const double own2 = has_ratio ? -A(1, 0) / A(0, 1) / (kTurn * kTurn) - decay * decay : 0.0;
  const double periods = own2 > 0.0 ? h * std::sqrt(own2) : 0.0;
  const double above = std::round(periods - folded) + folded;
  const double below = std::round(periods + folded) - folded;
  double nearest = std::abs(above - periods) < std::abs(below - periods) ? above : below;
  // At a whole period the ratio is lost. Without a period, the velocity would show as displacement.
  const double shown = h * size * (angle > 0.0 ? std::sin(angle) / angle : 1.0);
  if (folded < 0.25 && nearest == folded && !(A(0, 1) > kShown * shown)) nearest = 1.0;
  return {find_length(nearest / h, decay), false, find_length(folded / h, decay)};
}

}  // namespace

void add_to_mode(const ModeStep& step, double keep, ModeSums& sums) {
  ModeSums::Row row;
  row << step.error, step.offset / step.h, step.change, sums.displacement, sums.velocity;
  sums.products *= keep;
  sums.rounding2 = keep * sums.rounding2 + step.rounding * step.rounding;
  sums.products.noalias() += row * row.transpose();
  sums.displacement += step.h * sums.velocity + step.offset;
  sums.velocity += step.error;
}

HostMode find_mode(const ModeSums& sums, double h) {
  const auto block = [&](int a, int b) { return sums.products.block<6, 6>(6 * a, 6 * b); };
  const Mat6<double> changes = block(0, 0) + block(1, 1);
  const Vec6<double> u = find_principal_axes(changes).axis.col(5);
  const auto along = [&](int a, int b) { return u.dot(block(a, b) * u); };
  Mat3<double> matrix;
  Vec3<double> scale;
  for (int a = 0; a < 3; ++a) {
    scale[a] = 1.0 / std::sqrt(along(a + 2, a + 2));
    if (!std::isfinite(scale[a])) return {};
  }
  for (int a = 0; a < 3; ++a) {
    for (int b = 0; b < 3; ++b) matrix(a, b) = scale[a] * scale[b] * along(a + 2, b + 2);
    matrix(a, a) += kPivot;
  }
  const Mat3<double> inverse = invert(matrix);
  const double all = u.dot(changes * u);
  double by_rigid = all, by_mode = all;
  Vec3<double> constant[2];  // of the velocity, of the displacement over h
  for (int side = 0; side < 2; ++side) {
    Vec3<double> product;
    for (int a = 0; a < 3; ++a) product[a] = scale[a] * along(a + 2, side);
    const Vec3<double> scaled = inverse * product;
    by_rigid -= product[kChange] * product[kChange];
    by_mode -= scaled.dot(product);
    constant[side] = scale.cwiseProduct(scaled);
  }
  const double seen = kSeen * kSeen * along(2, 2) + sums.rounding2;
  if (!(all > seen && by_rigid > kAllByRigid * all && by_mode < kModeGain * by_rigid &&
        by_mode < kModeExplains * all)) {
    return {};
  }
  Eigen::Matrix2d A;
  A << 1.0 + h * constant[1][kDisplacement], h * (1.0 + constant[1][kVelocity]),
      constant[0][kDisplacement], 1.0 + constant[0][kVelocity];
  HostMode mode = find_swing(A, h);
  const Eigen::Vector2d by_change(h * constant[1][kChange], constant[0][kChange]);
  mode.deflection = h * std::abs((Eigen::Matrix2d::Identity() - A).inverse().row(0) * by_change);
  mode.bends = along(1, 1) - along(0, 1) + 0.25 * along(0, 0) > kBends * all;
  return mode;
}

}  // namespace dockloop
