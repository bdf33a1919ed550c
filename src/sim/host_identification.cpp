// The filter of host_identification.hpp.
#include "sim/host_identification.hpp"

#include <algorithm>
#include <cmath>

#include "math/decompositions.hpp"
#include "math/rotation.hpp"

namespace dockloop {
namespace {

using Vector = MassEstimate::Vector;
using Covariance = MassEstimate::Covariance;
using Rows = Eigen::Matrix<double, 6, MassEstimate::kCount>;

// First deviations
constexpr double kMassShare = 0.5, kCentre = 0.3;          ///< of the mass [-], of its centre [m]
constexpr double kMomentShare = 0.5, kProductShare = 0.2;  ///< of the moments [-]
constexpr double kMomentCorrelation =
    0.75;                        ///< a body that is larger than stated is so in all axes
constexpr double kDrift = 4e-3;  ///< of each number after 1 s, in units of its first deviation

// Errors of an equation: of rounding and the host's integration, and of what ten numbers leave out.
constexpr double kVelocityNoise = 4e-9, kSpinNoise = 1e-8;  ///< [m/s], [rad/s]
constexpr double kErrorShare = 3e-4;                        ///< of the error of the stated numbers
constexpr double kLeastEquation = 1.0;  ///< equations with less, in units of the noise, say nothing
constexpr double kMostMisfit2 = 100;    ///< of one equation, as it counts
constexpr double kProvenCount = 8.0;    ///< of equations: one step has six, and proves no cause ...
constexpr double kUsedCount = 5.0;      ///< ... but corrects the prediction of the next step
constexpr double kMostFactor = 5.0;     ///< of mass and moments; beyond, there is another cause
constexpr double kExplained2 = 9.0;     ///< mean square of the misfit that ten numbers explain
constexpr double kThreeDeviations2 = 27.0;  ///< chi-square of ten numbers, for 99.7 %

Mat3<double> find_spread(const VehicleBody& body) {
  return find_point_inertia(body.mass, body.com);
}

Vector find_first_deviations(const VehicleBody& stated) {
  Vector d;
  d[0] = kMassShare * stated.mass;
  d.segment<3>(1).setConstant(kCentre * stated.mass);
  d.segment<3>(4) = kMomentShare * stated.inertia.diagonal();
  d.tail<3>().setConstant(kProductShare * stated.inertia.trace() / 3.0);
  return d;
}

Vector find_numbers(const VehicleBody& body) {
  Vector numbers;
  numbers << body.mass, body.mass * body.com,
      get_components<double>(body.inertia + find_spread(body));
  return numbers;
}

/// Momentum and angular momentum about O as rows on the ten numbers.
Rows find_momentum_rows(const Vec3<double>& x, const VehicleState& s) {
  const Mat3<double> R = quat_to_matrix<double>(s.q);
  Rows rows = Rows::Zero();
  rows.block<3, 1>(0, 0) = s.v;
  rows.block<3, 3>(0, 1) = R * skew<double>(s.w);
  rows.bottomLeftCorner<3, 4>() = skew<double>(x) * rows.topLeftCorner<3, 4>();
  rows.block<3, 3>(3, 1) -= skew<double>(s.v) * R;
  const Vec3<double>& w = s.w;
  Eigen::Matrix<double, 3, 6> spin;
  spin << w[0], 0, 0, w[1], w[2], 0,  //
      0, w[1], 0, w[0], 0, w[2],      //
      0, 0, w[2], 0, w[0], w[1];
  rows.bottomRightCorner<3, 6>() = R * spin;
  return rows;
}

/// Constants may drift, but never become less certain than they were at first.
void let_drift(double h, Covariance& P) {
  P.diagonal().array() += kDrift * kDrift * h;
  for (int k = 0; k < MassEstimate::kCount; ++k) {
    if (!(P(k, k) > 1.0)) continue;
    const double shrink = 1.0 / std::sqrt(P(k, k));
    P.row(k) *= shrink;
    P.col(k) *= shrink;
  }
}

/// d^T inv(P) d, by a Cholesky factor. @return a negative number if P is not positive definite
double find_distance2(Covariance P, Vector d) {
  constexpr int n = MassEstimate::kCount;
  double sum = 0.0;
  for (int j = 0; j < n; ++j) {
    if (!(P(j, j) > 0.0)) return -1.0;
    const double pivot = std::sqrt(P(j, j));
    const double part = d[j] / pivot;
    sum += part * part;
    for (int i = j + 1; i < n; ++i) {
      P(i, j) /= pivot;
      d[i] -= P(i, j) * part;
    }
    for (int k = j + 1; k < n; ++k) {
      for (int i = k; i < n; ++i) P(i, k) -= P(i, j) * P(k, j);
    }
  }
  return sum;
}

double find_misfit2(const MassEstimate& estimate) {
  return estimate.count > 0.0 ? std::max(1.0, estimate.misfit2 / estimate.count) : 1.0;
}

}  // namespace

Covariance MassEstimate::make_first_covariance() {
  Covariance first = Covariance::Identity();
  first.block<3, 3>(4, 4).setConstant(kMomentCorrelation);
  first.diagonal().setOnes();
  return first;
}

void update_mass_estimate(const VehicleBody& stated, const ReportedStep& step, double keep,
                          MassEstimate& estimate) {
  const double h = step.h;
  // O is placed where the step begins: far away, angular momentum would be that of the position.
  VehicleState begin = step.begin, end = step.end;
  end.x -= begin.x;
  begin.x.setZero();
  Rows rows = find_momentum_rows(end.x, end) - find_momentum_rows(begin.x, begin);
  rows.block<3, 1>(0, 0) -= step.fall;
  rows.block<3, 1>(3, 0) -= find_mean_position(begin, end, h).cross(step.fall);
  rows.block<3, 3>(3, 1) += skew<double>(step.fall) * find_mean_attitude(begin, end, h);
  const Wrench<double> impulse = find_delivered_impulse(step.load, begin, end, h);
  Vec6<double> error;  // of the stated numbers
  error << impulse.f, impulse.t;
  error -= rows * find_numbers(stated);

  const double mean_inertia = stated.inertia.trace() / 3.0;
  const double radius = std::sqrt(mean_inertia / stated.mass);
  const double noise[] = {find_length(stated.mass * (kVelocityNoise + step.rounding),
                                      kErrorShare * error.head<3>().norm()),
                          find_length(mean_inertia * (kSpinNoise + step.rounding / radius),
                                      kErrorShare * error.tail<3>().norm())};
  const Vector scale = find_first_deviations(stated);
  Covariance& P = estimate.covariance;
  let_drift(h, P);
  bool is_silent = true;
  for (int i = 0; i < 6; ++i) {
    const Vector row = rows.row(i).transpose().cwiseProduct(scale) / noise[i / 3];
    const double stated_error = error[i] / noise[i / 3];
    if (row.norm() < kLeastEquation && std::abs(stated_error) < kLeastEquation) continue;
    if (is_silent) {
      estimate.misfit2 *= keep;
      estimate.count *= keep;
      is_silent = false;
    }
    const Vector reach = P * row;
    const double variance = row.dot(reach) + 1.0;  // at least 1, but for rounding
    if (!(variance > 0.5)) continue;
    const double left = stated_error - row.dot(estimate.number);
    estimate.misfit2 += std::min(kMostMisfit2, left * left / variance);
    estimate.count += 1.0;
    const Vector gain = reach / variance;
    estimate.number += gain * left;
    // Joseph's form, the least sensitive to rounding, factor by factor:
    // (1 - gain row') P (1 - gain row')' + gain gain'.
    P -= gain * reach.transpose();
    const Vector rest = P * row - gain;
    P -= rest * gain.transpose();
  }
}

VehicleBody find_estimated_body(const VehicleBody& stated, const MassEstimate& estimate) {
  const Vector n =
      find_numbers(stated) + find_first_deviations(stated).cwiseProduct(estimate.number);
  constexpr double kLeastShare = 1e-3;  // a mass near zero has no centre
  VehicleBody body;
  body.mass = n[0];
  body.com = n.segment<3>(1) / std::max(n[0], kLeastShare * stated.mass);
  body.inertia = make_symmetric(n.tail<6>()) - find_spread(body);
  return body;
}

MassDeviations find_mass_deviations(const VehicleBody& stated, const MassEstimate& estimate) {
  const Vector d = std::sqrt(find_misfit2(estimate)) *
                   find_first_deviations(stated).cwiseProduct(
                       estimate.covariance.diagonal().cwiseMax(0.0).cwiseSqrt());
  return {d[0], d.segment<3>(1) / stated.mass, d.tail<6>()};
}

bool fits_reports(const MassEstimate& estimate) {
  return estimate.count > kProvenCount && find_misfit2(estimate) < kExplained2;
}

bool explains_reports(const MassEstimate& estimate) {
  const auto is_plausible = [&](int first, int count, double deviation) {
    for (int k = first; k < first + count; ++k) {
      const double factor = 1.0 + deviation * estimate.number[k];
      if (!(factor > 1.0 / kMostFactor && factor < kMostFactor)) return false;
    }
    return true;
  };
  return estimate.count > kUsedCount && find_misfit2(estimate) < kExplained2 &&
         is_plausible(0, 1, kMassShare) && is_plausible(4, 3, kMomentShare);
}

bool contradicts(const VehicleBody& stated, const MassEstimate& estimate, const VehicleBody& body) {
  const Vector from_stated =
      (find_numbers(body) - find_numbers(stated)).cwiseQuotient(find_first_deviations(stated));
  const double distance2 = find_distance2(estimate.covariance, from_stated - estimate.number);
  return distance2 > kThreeDeviations2 * find_misfit2(estimate);
}

bool can_be_rigid(const VehicleBody& body) {
  constexpr double kRounding = 1e-3;  // of moments, as identified
  return body.mass > 0.0 && is_positive_definite(body.inertia) &&
         can_have_moments(find_principal_moments(body.inertia), kRounding);
}

}  // namespace dockloop
