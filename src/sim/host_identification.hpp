// Mass, centre of mass and inertia of a host's vehicle, from reports and delivered impulses.
//
// Ten numbers: mass, mass x centre of mass, and inertia, both about the reported point P in body
// axes. Momenta are linear in these numbers, and each step gives six equations: the change of
// momentum is the impulse of held loads, known loads and gravity. A Kalman filter of ten constants
// that may drift begins at the stated numbers. What no load excites stays there.
//
// The prediction uses the estimate where three conditions hold. The ten numbers explain the
// reports. The estimate contradicts the numbers that are in use. A rigid body can have the
// estimated numbers. So a host whose reports are right never changes the prediction.
#pragma once

#include "mechanism/mechanism_dynamics.hpp"
#include "sim/mean_load.hpp"

namespace dockloop {

/// Estimate of the ten numbers minus their stated values, in units of the first deviations.
struct MassEstimate {
  static constexpr int kCount = 10;
  using Vector = Eigen::Matrix<double, kCount, 1>;
  using Covariance = Eigen::Matrix<double, kCount, kCount>;
  static Covariance make_first_covariance();
  Vector number = Vector::Zero();
  Covariance covariance = make_first_covariance();
  double misfit2 = 0.0;  ///< squares of errors, in units of their expected deviations ...
  double count = 0.0;    ///< ... of so many equations; both fade out
};

/// A step of a host's vehicle, as its reports show it.
struct ReportedStep {
  const VehicleState& begin;
  const VehicleState& end;
  Wrench<double> load;       ///< all loads but gravity: force in axes of O, torque about P in body
                             ///< axes, constant over the step
  const Vec3<double>& fall;  ///< change of velocity by gravity [m/s]
  double h = 0.0;            ///< [s]
  double rounding = 0.0;     ///< changes of velocity that are ignored [m/s]
};

/// @param stated  centre of mass from P; @param keep  factor of older errors
void update_mass_estimate(const VehicleBody& stated, const ReportedStep& step, double keep,
                          MassEstimate& estimate);

/// The estimate as a body.
VehicleBody find_estimated_body(const VehicleBody& stated, const MassEstimate& estimate);

/// Standard deviations. Where the ten numbers do not explain the motion, they grow with the misfit.
struct MassDeviations {
  double mass = 0.0;                            ///< [kg]
  Vec3<double> com = Vec3<double>::Zero();      ///< [m]
  Vec6<double> inertia = Vec6<double>::Zero();  ///< xx yy zz xy xz yz [kg m2]
};
MassDeviations find_mass_deviations(const VehicleBody& stated, const MassEstimate& estimate);

/// Do ten numbers fit the reports?
bool fits_reports(const MassEstimate& estimate);
/// The same, and can the numbers be those of a mistake?
bool explains_reports(const MassEstimate& estimate);
/// Is a body outside of the region of three standard deviations around the estimate?
bool contradicts(const VehicleBody& stated, const MassEstimate& estimate, const VehicleBody& body);
/// Positive mass, positive definite inertia, triangle inequality of the principal moments.
bool can_be_rigid(const VehicleBody& body);

}  // namespace dockloop
