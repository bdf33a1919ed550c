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
constexpr double kMeanError = 0.25;          ///< of the change of a mean load: what it leaves open
constexpr double kGravityError = 1e-4;       ///< of gravity as a constant over the step
constexpr double kStableMismatch = 0.1;      ///< mismatch below which no step is too long [-]
constexpr double kStableRange = 0.8;         ///< frequency x step with a mass that is not confirmed
constexpr double kLongestSuggestion = 0.1;   ///< longest suggested step [s]
constexpr double kShare = 0.3;               ///< of the tolerance, for the next step
constexpr double kCreatedWarning = 0.01;     ///< created energy, of the largest energy so far
constexpr double kCreatedError = 0.3;        ///< the same, for a refusal
constexpr double kResolved = 0.25;           ///< periods of a flexible part, in a step
constexpr double kFelt = 0.02;               ///< deflection of a part, of that of the interface
constexpr int kLoadedSteps = 10;             ///< until identified numbers are a diagnosis
constexpr double kModeTime = 2.0;            ///< with loads: until then a mode may show [s]
constexpr double kCentreShare = 0.01;        ///< of the radius of gyration, for a wrong centre
constexpr double kSeenInnovation = 1e-2;     ///< that a refusal mentions [m/s]
constexpr double kHeldGrowth = 0.1;          ///< growth per step that damping holds, a guess [-]

/// Is a fault one of the ten numbers?
bool is_body(int fault) {
  return fault == kWrongMass || fault == kWrongInertia || fault == kWrongCentre;
}

/// Radius of gyration, a mean of all axes [m].
double find_gyration_radius(const VehicleBody& body) {
  return std::sqrt(body.inertia.trace() / (3.0 * body.mass));
}

/// Errors of motion and of responses to loads, relative to both; the largest [-].
double find_scaled_error(const ReportSums& sums) {
  double largest2 = 0.0;
  const auto consider = [&](double error2, double size2) {
    if (size2 > 0.0) largest2 = std::max(largest2, error2 / size2);
  };
  consider(sums.turn_error2[0], sums.turn2 + sums.spin_matrix.trace());
  consider(sums.move_error2[0], sums.move2 + sums.velocity2);
  for (const ResponseSums* r : {&sums.force, &sums.torque}) consider(r->error2, r->change2);
  return std::sqrt(largest2);
}

/// The model of a target without parts has its centre of mass in its origin.
void hold_centre(MassEstimate& estimate) {
  constexpr double kHeld = 1e-12;  // variance, in units of the first deviations
  estimate.number.segment<3>(1).setZero();
  estimate.covariance.middleRows<3>(1).setZero();
  estimate.covariance.middleCols<3>(1).setZero();
  estimate.covariance.diagonal().segment<3>(1).setConstant(kHeld);
}

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

int HostCoupling::find_worse_vehicle() const {
  if (!(model_->driven[kChaser] && model_->driven[kTarget])) {
    return model_->driven[kChaser] ? kChaser : kTarget;
  }
  const std::vector<ReportSums>& reports = state_.coupling.reports;
  return find_scaled_error(reports[kTarget]) > find_scaled_error(reports[kChaser]) ? kTarget
                                                                                   : kChaser;
}

int HostCoupling::find_shown_vehicle() const {
  const auto is_wrong = [&](int i) {
    return state_.coupling.vehicle[i].finding.fault != kHostRight;
  };
  if (is_wrong(kChaser) && is_wrong(kTarget)) return find_worse_vehicle();
  return is_wrong(kTarget) || !model_->driven[kChaser] ? kTarget : kChaser;
}

bool HostCoupling::is_identified(int i) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  return !is_same_body(v.body, v.stated);
}

void HostCoupling::restate(int i, const VehicleBody& stated) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  v.stated = v.body = stated;
  v.estimate = MassEstimate();
  v.restated = state_.elapsed;
  if (is_body(v.finding.fault)) v.finding = HostFinding();
  forget_responses(state_.coupling.reports[static_cast<size_t>(i)]);
}

void HostCoupling::identify(int i, const VehicleState& z, double rounding, double keep) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  if (count_held_loads(i, v.since, find_report_time()) > 1) return;  // a mean has another moment
  const ReportedStep step{v.received, z, v.held + v.mean_known, v.fall, v.interval, rounding};
  const bool is_held = i == kTarget && !model_->target;
  if (is_held) hold_centre(v.estimate);
  update_mass_estimate(v.stated, step, keep, v.estimate);
  if (is_held) hold_centre(v.estimate);
  // Another mistake of the host would show as a wrong mass, too.
  const int fault = v.finding.fault;
  const bool may_be_body = fault == kHostRight || is_body(fault);
  if (!setup_->parameters.coupling_identify || !may_be_body || !explains_reports(v.estimate)) {
    v.body = v.stated;
    return;
  }
  if (!contradicts(v.stated, v.estimate, v.body)) return;
  const VehicleBody body = find_estimated_body(v.stated, v.estimate);
  const bool is_possible =
      can_be_rigid(body) &&
      (i == kTarget || can_be_rigid(find_bare_vehicle(body, model_->frozen))) &&
      can_carry_modes(body, parts_[i]);
  if (is_possible) v.body = body;
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
  if (state_.elapsed > state_.last_step || is_delayed()) return {};  // a late motion stays
  const Inputs::Vehicle& report = inputs_.vehicle[i];
  const double distance = state_.last_step * report.velocity.norm();
  const Vec3<double> moved =
      report.position - frame_origin_ - state_.coupling.vehicle[i].received.x;
  if (distance < 1e-9 || moved.norm() > 0.1 * distance) return {};
  return {kStartOfStep, distance};
}

void HostCoupling::look_at_innovation(int i, const VehicleState& z, const VehicleState& now) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const Mat3<double> R = quat_to_matrix<double>(z.q);
  const Vec3<double> arm = R * setup_->parameters.vehicle[i].interface_position;
  const Vec3<double> innovation = z.v - v.predicted.v;
  const Vec3<double> turning = R * (z.w - v.predicted.w);
  v.innovation = std::max(innovation.norm(), turning.norm() * arm.norm());

  // Work received by the host's vehicle, minus work of the mechanism: the created energy.
  const Vec3<double> turn = find_turn<double>(v.before.q, now.q);
  const double created = v.load.f.dot(now.x - v.before.x) + v.load.t.dot(turn) - v.work;
  state_.coupling.work_residual += created;
  state_.coupling.created[0] += created;

  // A late motion stays at the start first.
  if (find_report_time() - v.since < 0.5 * state_.last_step) return;
  diagnose(i, judge(i, z), state_.last_step);
}

/// @param z  motion received now, at the end of the last step
HostFinding HostCoupling::judge(int i, const VehicleState& z) {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  ReportSums& sums = state_.coupling.reports[static_cast<size_t>(i)];
  const double h = v.interval, keep = std::pow(kForget, h / kForgetTime);
  HostFinding found;
  const ReportPair pair{v.input,    inputs_.vehicle[i],
                        h,          (z.v - v.received.v).norm(),
                        z.v.norm(), setup_->parameters.vehicle[i].interface_position};
  if (!is_same_motion(inputs_.vehicle[i], v.input)) {
    found = judge_motion(pair, keep, sums);
  } else {  // a report that stays is an old one
    found = judge_unchanged(pair, setup_->parameters.coupling_delay, sums);
  }
  if (v.since < v.restated) return found;  // a report of the mass before
  LoadStep step;
  step.h = h;
  step.mass = v.stated.mass;
  step.inertia = v.stated.inertia;
  step.radius = find_gyration_radius(v.stated);
  step.R = quat_to_matrix<double>(v.received.q);
  step.arm = setup_->parameters.vehicle[i].interface_position;
  step.announces = announces();
  step.is_host_first = steps_first();
  step.held = v.held;
  find_other_loads(i, step);
  step.change = v.by_stated.v - v.received.v - v.fall;
  step.error = z.v - v.by_stated.v;
  step.turn_error = z.w - v.by_stated.w;
  step.offset = z.x - v.by_stated.x;
  step.turn_offset = find_turn<double>(v.by_stated.q, z.q);
  step.gravity = loads_.at_start().gravity.norm();
  // Gravity as a constant over the step has at least this error.
  step.rounding = kSilentChange + kRelativeRounding * inputs_.vehicle[i].velocity.norm() +
                  h * kGravityError * step.gravity + v.mean_error;
  const HostFinding by_loads = judge_loads(step, keep, sums);
  identify(i, z, step.rounding, keep);
  if (found.fault == kPositionUnrelated && sums.force.loaded > 0) {  // or it swings within steps
    if (sums.force.loaded < kLoadedSteps) return {};
    const HostFinding mode = explain_by_mode(h, false, sums);
    return mode.fault == kHostRight ? found : mode;
  }
  if (found.fault != kHostRight) return found;
  if (sums.turn_errors + sums.move_errors > 0) return {};
  const bool may_be_body =
      by_loads.fault == kHostRight || by_loads.fault == kUnexplained || is_body(by_loads.fault);
  // A part that swings on after a load is an unreported load, too.
  const bool may_be_mode =
      may_be_body || by_loads.fault == kUnreportedForce || by_loads.fault == kUnreportedTorque;
  if (!may_be_mode) return by_loads;
  const bool is_known = may_be_body && is_identified(i) && sums.force.loaded >= kLoadedSteps;
  const bool fits = fits_reports(v.estimate);
  const HostFinding mode = explain_by_mode(h, is_known || fits, sums);
  if (mode.fault != kHostRight) return mode;
  if (is_known) return explain_by_body(i, by_loads);
  if (fits) return by_loads;
  // At first a flexible part moves as another mass or inertia, but not as ten numbers.
  const bool is_open = v.estimate.count > 0.0 && sums.force.loaded * h < kModeTime;
  return may_be_body && is_open ? HostFinding() : by_loads;
}

/// The ten numbers explain the reports: which of them is most wrong?
/// @param by_loads  cause that responses to loads show
HostFinding HostCoupling::explain_by_body(int i, const HostFinding& by_loads) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  const double radius = find_gyration_radius(v.stated);
  const double distance = (v.body.com - v.stated.com).norm();
  const HostFinding mass{kWrongMass, v.body.mass / v.stated.mass - 1.0};
  HostFinding inertia{kWrongInertia, 0.0};
  const MassDeviations deviation = find_mass_deviations(v.stated, v.estimate);
  constexpr double kKnown = 0.1;  // deviation of a number that loads have excited
  if (!(deviation.mass < kKnown * v.body.mass)) return by_loads;
  for (int k = 0; k < 3; ++k) {
    const double moment = v.stated.inertia(k, k), share = v.body.inertia(k, k) / moment - 1.0;
    const bool is_known = deviation.inertia[k] < kKnown * moment;
    if (is_known && std::abs(share) > std::abs(inertia.value)) inertia.value = share;
  }
  const double body = std::max(std::abs(mass.value), std::abs(inertia.value));
  if (distance > kCentreShare * radius && distance > body * radius) {
    return {kWrongCentre, distance};
  }
  if (by_loads.fault == kHostRight || by_loads.fault == kWrongInertia) return by_loads;
  return by_loads.fault == kWrongMass || std::abs(mass.value) == body ? mass : inertia;
}

std::string HostCoupling::describe(int i, const HostFinding& found, double h) const {
  const Parameters& stated = setup_->parameters;
  const double delay =
      found.fault == kMotionAge ? stated.coupling_motion_delay : stated.coupling_delay;
  return describe_finding(found, get_vehicle_name(i), h, state_.coupling.vehicle[i].stated.mass,
                          delay);
}

std::string HostCoupling::explain_refusal() const {
  const std::string cause = "; a cause may be that ";
  const bool is_first = !(state_.last_step > 0.0);
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    HostFinding found = state_.coupling.vehicle[i].finding;
    const double first_angle = state_.coupling.reports[static_cast<size_t>(i)].first_angle;
    if (found.fault == kHostRight && is_first && first_angle > kFirstAngle) {
      found = {kFirstAttitude, first_angle};
    }
    if (found.fault != kHostRight) return cause + describe(i, found, state_.last_step);
  }
  for (int i : {kChaser, kTarget}) {
    const double innovation = state_.coupling.vehicle[i].innovation;
    if (!model_->driven[i] || !(innovation > kSeenInnovation)) continue;
    char text[120];
    std::snprintf(text, sizeof text, "the last report of %s is %.3g m/s away from its prediction",
                  get_vehicle_name(i), innovation);
    return cause + text;
  }
  return {};
}

/// The first cause is named; later ones may be its consequences.
void HostCoupling::diagnose(int i, const HostFinding& found, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  if (v.finding.fault != kHostRight || found.fault == kHostRight) return;
  v.finding = found;
  std::string text = describe(i, found, h);
  if (is_body(found.fault)) {
    text += is_identified(i) ? "; the prediction uses the identified value (coupling.identify)"
                             : "; loads are right to first order of the step only";
  }
  const double product = state_.coupling.frequency * h;
  if (found.fault == kWrongMass && !is_identified(i) && product > kStableRange &&
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
  const bool is_found = c.vehicle[find_shown_vehicle()].finding.fault != kHostRight;
  const int i = is_found ? find_shown_vehicle() : find_worse_vehicle();
  const bool is_warned = ((c.warned[kChaser] | c.warned[kTarget]) & kWarnedEnergy) != 0;
  if (!(c.work_residual > kCreatedWarning * c.energy)) c.host_work = host_work;
  c.energy = std::max({c.energy, energy - (host_work - c.host_work),
                       1e4 * setup_->parameters.atol_energy});  // as in the energy balance
  const double share = c.work_residual / c.energy;
  const bool is_refused = share > kCreatedError;
  // A cause that has been named explains the energy, too.
  const int fault = c.vehicle[i].finding.fault;
  const bool is_new =
      !is_warned && (fault == kHostRight || fault == kUnexplained || fault == kFlexiblePart);
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

/// Steps that do not resolve a flexible part of a host create no energy that would show. Its
/// deflection per acceleration, times the square of the interface's frequency, is its share.
Status HostCoupling::check_modes(const double* y, std::string& reason) {
  for (int i : {kChaser, kTarget}) {
    const HostFinding& found = state_.coupling.vehicle[i].finding;
    const double h = state_.last_step;
    if (found.fault != kFlexiblePart || !(found.value * h > kResolved)) continue;
    const double frequency = find_interface_frequency(y);
    const double share = found.deflection * frequency * frequency;
    if (!(share > kFelt)) continue;
    char text[200];
    std::snprintf(text, sizeof text,
                  "; a step of %.3g s does not resolve it, and the docking interface (%.3g rad/s) "
                  "is stiff enough to deflect it: loads would be wrong",
                  h, frequency);
    reason = describe(i, found, h) + text;
    return {StatusCode::kCouplingUnstable, -1, share, state_.elapsed};
  }
  return {};
}

/// After a step: store data of the step for the monitors.
/// @param start, end  of the internal vehicle
void HostCoupling::note_step(int i, const Wrench<double>& exerted, const VehicleState& start,
                             const VehicleState& end, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const Vec3<double> distance = end.x - start.x;
  const Vec3<double> turn = find_turn<double>(start.q, end.q);
  const Loads& known = loads_.at(0.5 * h);
  Vec3<double> fall = Vec3<double>::Zero();
  if (!model_->falling) fall = h * known.gravity;
  const Wrench<double> change{known.force[i] - v.mean_known.f, known.torque[i] - v.mean_known.t};
  const bool is_first = !(v.interval > 0.0);
  v.mean_error = is_first
                     ? 0.0
                     : kMeanError * h / v.stated.mass *
                           (change.f.norm() + change.t.norm() / find_gyration_radius(v.stated));
  v.interval = h;
  v.fall = fall;
  v.mean_known = {known.force[i], known.torque[i]};
  if (setup_->parameters.coupling_motion_delay > 0.0) {
    v.interval = find_report_time() - v.since;
    v.fall = v.interval / h * fall;
    v.mean_known = find_mean_of_loads(v.known, v.since, find_report_time());
  }
  const double mass = v.body.mass;
  const Vec3<double> weight = mass / h * fall, force = known.force[i] + weight;
  const Vec3<double> swing = (move_origin(end, v.body.com).x - end.x) -
                             (move_origin(start, v.body.com).x - start.x);  // of the centre of mass
  v.work = find_rigid_energy(v.body, end) - find_rigid_energy(v.body, start) - force.dot(distance) -
           known.torque[i].dot(turn) - weight.dot(swing);
  // Announced load compared with exerted load; first moment of the load, from the position.
  const double impulse = (exerted.f - h * v.load.f).norm() / mass;
  const double moment = (distance - (v.now.x - v.before.x)).norm() / h;
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
    confirmed = confirmed && (is_identified(i) ||
                              is_mass_confirmed(state_.coupling.reports[static_cast<size_t>(i)]));
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
