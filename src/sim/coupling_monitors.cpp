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
constexpr double kCreatedWarning = 0.01;     ///< created energy, of the largest energy so far
constexpr double kCreatedError = 0.3;        ///< the same, for a refusal
constexpr double kHeldGrowth = 0.1;          ///< growth per step that damping holds, a guess [-]

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

int HostCoupling::find_diagnosed_vehicle() const {
  for (int i : {kChaser, kTarget}) {
    if (state_.coupling.vehicle[i].finding.fault != kHostRight) return i;
  }
  return model_->driven[kChaser] ? kChaser : kTarget;
}

HostFinding HostCoupling::find_diagnosis() const {
  return state_.coupling.vehicle[find_diagnosed_vehicle()].finding;
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

HostFinding HostCoupling::judge_first_end(int i) const {
  if (state_.elapsed > state_.last_step) return {};
  const Inputs::Vehicle& report = inputs_.vehicle[i];
  const double distance = state_.last_step * report.velocity.norm();
  const Vec3<double> moved =
      report.position - frame_origin_ - state_.coupling.vehicle[i].received.x;
  if (distance < 1e-9 || moved.norm() > 0.1 * distance) return {};
  return {kStartOfStep, distance};
}

void HostCoupling::look_at_innovation(int i, const VehicleState& z) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const Mat3<double> R = quat_to_matrix<double>(z.q);
  const Vec3<double> arm = R * setup_->parameters.vehicle[i].interface_position;
  const Vec3<double> innovation = z.v - v.predicted.v;
  const Vec3<double> turning = R * (z.w - v.predicted.w);
  v.innovation = std::max(innovation.norm(), turning.norm() * arm.norm());

  // Work received by the host's vehicle, minus work of the mechanism: the created energy.
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(v.received.q), z.q));
  const double created = v.held.f.dot(z.x - v.received.x) + v.held.t.dot(turn) - v.work;
  state_.coupling.work_residual += created;
  state_.coupling.created[0] += created;

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
  step.is_host_first = steps_first();
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

/// The step at which growth of oscillations should end. Growth per step is proportional to the step
/// in a coupling with held loads.
double HostCoupling::find_stable_step(double frequency) const {
  const auto& created = state_.coupling.created;
  double late = 0.0, early = 0.0;
  for (size_t i = 0; i < created.size(); ++i) {
    (i < created.size() / 2 ? late : early) += std::abs(created[i]);
  }
  constexpr double kMostGrowth = 1e3;
  const double steps = 0.5 * static_cast<double>(created.size());
  const double ratio = early > 0.0 ? std::clamp(late / early, 1.0, kMostGrowth) : kMostGrowth;
  const double growth = 0.5 * std::log(ratio) / steps;  // of amplitudes
  double step = state_.last_step / (1.0 + std::max(1.0, growth / kHeldGrowth));
  if (frequency > 0.0) step = std::min(step, kStableRange / frequency);
  return step;
}

Status HostCoupling::check_energy(double energy, double host_work, const double* y,
                                  std::string& reason) {
  CouplingState& c = state_.coupling;
  // An unstable coupling brings energy by corrections, too: then these count no more.
  const int i = find_diagnosed_vehicle();
  const bool is_warned = ((c.warned[kChaser] | c.warned[kTarget]) & kWarnedEnergy) != 0;
  if (!(c.work_residual > kCreatedWarning * c.energy)) c.host_work = host_work;
  c.energy = std::max({c.energy, energy - (host_work - c.host_work),
                       1e4 * setup_->parameters.atol_energy});  // as in the energy balance
  const double share = c.work_residual / c.energy;
  const bool is_refused = share > kCreatedError;
  // A cause that has been named explains the energy, too.
  const int fault = c.vehicle[i].finding.fault;
  const bool is_new = !is_warned && (fault == kHostRight || fault == kUnexplained);
  if (is_refused || (share > kCreatedWarning && is_new)) {
    const double frequency = find_interface_frequency(y), h = state_.last_step;
    const std::string cause = describe_energy_cause(
        c.vehicle[i].finding, c.reports[static_cast<size_t>(i)], get_vehicle_name(i));
    char text[700];
    std::snprintf(text, sizeof text,
                  "the coupling creates energy%s: coupling.work_residual is %.3g J, %.3g %% of the "
                  "largest energy so far (%.3g J, limit %.0f %%); the cause is %s; frequency of "
                  "the docking interface times step is %.2g (%.3g rad/s, %.3g s); %sa step of "
                  "%.2g s should be stable",
                  is_refused ? " and is unstable" : "", c.work_residual, 100.0 * share, c.energy,
                  100.0 * kCreatedError, cause.c_str(), frequency * h, frequency, h,
                  is_refused ? "start again: " : "", find_stable_step(frequency));
    if (is_refused) {
      reason = text;
      return {StatusCode::kCouplingUnstable, -1, share, state_.elapsed};
    }
    warn_once(i, kWarnedEnergy, text);
  }
  std::rotate(c.created.begin(), c.created.end() - 1, c.created.end());
  c.created[0] = 0.0;
  return {};
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
