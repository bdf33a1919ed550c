// Monitors of the coupling for the host: does the vehicle move as predicted, is the order of
// exchange right, how long may steps be. Every warning is issued once, with numbers.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/host_coupling.hpp"

namespace dockloop {
namespace {

constexpr double kForget = 0.98;             ///< of the sums, per kForgetTime
constexpr double kForgetTime = 0.01;         ///< [s]
constexpr double kSilentChange = 1e-11;      ///< change of velocity that is ignored [m/s] ...
constexpr double kRelativeRounding = 1e-14;  ///< ... and of the speed in N [-]
constexpr double kGravityError = 1e-4;       ///< of gravity as a constant over the step
constexpr double kStableMismatch = 0.1;      ///< mismatch below which no step is too long [-]
constexpr double kStableRange = 0.8;         ///< frequency x step with a mass that is not confirmed
constexpr double kLongestSuggestion = 0.1;   ///< longest suggested step [s]
constexpr double kShare = 0.3;               ///< of the tolerance, for the next step

}  // namespace

void HostCoupling::warn_once(int i, CouplingWarning what, const std::string& text) {
  int& warned = state_.coupling.warned[i];
  if ((warned & what) != 0) return;
  warned |= what;
  warnings_.push_back(text);
}

double HostCoupling::find_mass_mismatch(int i) const {
  return dockloop::find_mass_mismatch(state_.coupling.reports[static_cast<size_t>(i)]);
}

HostFinding HostCoupling::find_diagnosis() const {
  for (const DrivenVehicle& v : state_.coupling.vehicle) {
    if (v.finding.fault != kHostRight) return v.finding;
  }
  return {};
}

Inputs::Vehicle HostCoupling::find_start_report(int i) const {
  const VehicleState& start = state_.coupling.vehicle[i].predicted;
  Inputs::Vehicle report;
  report.position = start.x + frame_origin_ + state_.frame_shift;
  report.velocity = start.v + state_.frame_velocity;
  report.attitude = start.q;
  report.angular_velocity = start.w;
  return report;
}

void HostCoupling::look_at_innovation(int i, const VehicleState& z) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const Mat3<double> R = quat_to_matrix<double>(z.q);
  const Vec3<double> arm = R * setup_->parameters.vehicle[i].interface_position;
  const Vec3<double> innovation = z.v - v.predicted.v;
  const Vec3<double> turning = R * (z.w - v.predicted.w);
  v.innovation = std::max(innovation.norm(), turning.norm() * arm.norm());

  // Work received by the host's vehicle, minus work of the mechanism.
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(v.received.q), z.q));
  state_.coupling.work_residual += v.held.f.dot(z.x - v.received.x) + v.held.t.dot(turn) - v.work;

  diagnose(i, judge(i, z, innovation), state_.last_step);
}

/// @param z  motion received now, at the end of the last step
HostFinding HostCoupling::judge(int i, const VehicleState& z, const Vec3<double>& innovation) {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  ReportSums& sums = state_.coupling.reports[static_cast<size_t>(i)];
  const double h = state_.last_step, keep = std::pow(kForget, h / kForgetTime);
  HostFinding found;
  if (!is_same_motion(inputs_.vehicle[i], v.input)) {  // a report that stays is an old one
    const ReportPair pair{v.input,    inputs_.vehicle[i],
                          h,          (z.v - v.received.v).norm(),
                          z.v.norm(), setup_->parameters.vehicle[i].interface_position};
    found = judge_motion(pair, keep, sums);
  }
  LoadStep step;
  step.h = h;
  step.mass = model_->stated_mass[i];
  step.inertia = find_stated_inertia(i);
  step.R = quat_to_matrix<double>(v.received.q);
  step.arm = setup_->parameters.vehicle[i].interface_position;
  step.announces = announces();
  step.held = v.held;
  step.next = step.announces ? state_.mean_load[i] : v.held;
  step.change = v.predicted.v - v.received.v - v.fall;
  step.error = innovation;
  step.turn_error = z.w - v.predicted.w;
  step.gravity = loads_.at_start().gravity.norm();
  // Gravity as a constant over the step has at least this error.
  step.rounding = kSilentChange + kRelativeRounding * inputs_.vehicle[i].velocity.norm() +
                  h * kGravityError * step.gravity;
  const HostFinding by_loads = judge_loads(step, keep, sums);
  if (found.fault != kHostRight) return found;
  return sums.turn_errors + sums.move_errors > 0 ? HostFinding() : by_loads;
}

/// The first cause is named; later ones may be its consequences.
void HostCoupling::diagnose(int i, const HostFinding& found, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  if (v.finding.fault != kHostRight || found.fault == kHostRight) return;
  v.finding = found;
  const double mass = model_->stated_mass[i];
  std::string text = describe_finding(found, get_vehicle_name(i), h, mass);
  const double product = state_.coupling.frequency * h;
  if (found.fault == kWrongMass && product > kStableRange &&
      std::abs(found.value) > kStableMismatch) {
    char more[200];
    std::snprintf(more, sizeof more,
                  "; the coupling is not stable with it: the docking interface has %.3g rad/s, and "
                  "frequency times step is %.3g, above the limit of %.1g",
                  state_.coupling.frequency, product, kStableRange);
    text += more;
  }
  warnings_.push_back(std::move(text));
}

/// After a step: store data of the step for the monitors.
/// @param start, end  of the internal vehicle
void HostCoupling::note_step(int i, const Wrench<double>& exerted, const VehicleState& start,
                             const VehicleState& end, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const double mass = model_->stated_mass[i];
  const Mat3<double> I = find_stated_inertia(i);
  const Vec3<double> distance = end.x - start.x;
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(start.q), end.q));
  const Loads& known = loads_.at(0.5 * h);
  v.fall.setZero();
  if (!model_->falling) v.fall = h * known.gravity;
  const Vec3<double> force = known.force[i] + mass / h * v.fall;
  v.work = find_rigid_energy(mass, I, end) - find_rigid_energy(mass, I, start) -
           force.dot(distance) - known.torque[i].dot(turn);
  // Announced load compared with exerted load; first moment of the load, from the position.
  const double impulse = (exerted.f - h * v.held.f).norm() / mass;
  const double moment = (distance - (v.predicted.x - v.received.x)).norm() / h;
  v.error = std::max({v.innovation, impulse, moment});
}

double HostCoupling::find_suggested_step(double frequency, double contact_time) const {
  const Parameters& p = setup_->parameters;
  if (!(state_.last_step > 0.0)) return p.coupling_expected_step;
  double error = 0.0;
  bool confirmed = true;
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    error = std::max(error, state_.coupling.vehicle[i].error);
    confirmed = confirmed && is_mass_confirmed(state_.coupling.reports[static_cast<size_t>(i)]);
  }
  constexpr double kLeastGrowth = 0.3, kMostGrowth = 1.5;
  const double growth = error > 0.0 ? std::clamp(kShare * p.coupling_velocity_tolerance / error,
                                                 kLeastGrowth, kMostGrowth)
                                    : kMostGrowth;
  double step =
      std::min(growth * state_.last_step, std::max(kLongestSuggestion, p.coupling_expected_step));
  if (!confirmed && frequency > 0.0) step = std::min(step, kStableRange / frequency);
  // The first contact is the critical event: approach the contact in suitable steps.
  step = std::min(step, std::max(contact_time, p.coupling_expected_step));
  return step;
}

double HostCoupling::find_interface_frequency(const double* y) {
  return dockloop::find_interface_frequency(*model_, state_.discrete, state_.memory,
                                            evaluator_.present(), loads_.at_start(), state_.elapsed,
                                            y, *interface_work_);
}

}  // namespace dockloop
