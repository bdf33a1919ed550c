// Accepted states: events (event_logic.hpp), memory of the contact search, peaks, change of the
// independent coordinates; and the evaluations for these tasks.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/sim_impl.hpp"

namespace dockloop {

/// All updates after an accepted inner step. @pre evaluate(tau)
/// @param changed  set if the state or the equations changed, so that the integrator must
/// restart.
Status DockingSim::Impl::accept(double tau, bool& changed) {
  if (unreduced) drift = std::max(drift, unreduced->find_cut_gap(tau));
  const Status moved = update_coordinates(tau, changed);
  if (!moved.ok()) return moved;
  keep_pose();
  if (update_memory()) changed = true;
  bool jumped = false;
  const double now = elapsed + tau;
  if (events->update_first_contact(*data, now)) jumped = true;
  if (events->update_absorber(*data)) jumped = true;
  if (update_latches(now)) jumped = true;
  events->update_capture(now);
  if (update_thrust(now)) jumped = true;
  changed = changed || jumped;
  if (changed) kept_jacobian.valid = false;
  warn_of_tilt(now);
  events->update_phases(*data, now);
  // Peaks include the forces on both sides of a jump. An absorber that does not pull is released at
  // zero force, except for rounding.
  if (!events->is_due(1) || model->contact.absorber.pulls) peaks.add(now, find_peak_values());
  if (!jumped) return {};
  const Status after = evaluate(tau);
  if (!after.ok()) return after;
  peaks.begin(now, find_peak_values());
  return {};
}

/// The present pose becomes the accepted configuration: the next poses continue from it.
void DockingSim::Impl::keep_pose() {
  if (data->locked) return;
  pose_is_kept = false;
  keep_reference(model->mechanism, data->mechanism);
  rate_data->mechanism.loops.reference = data->mechanism.loops.reference;
}

/// The model of rings is valid for a limited tilt only.
void DockingSim::Impl::warn_of_tilt(double now) {
  constexpr double kMostTilt = 30.0, kInDegrees = 180.0 / static_cast<double>(EIGEN_PI);  // [deg]
  if (warned_tilt || !has_surfaces() || data->contact.active_count == 0) return;
  const double tilt = kInDegrees * std::acos(std::clamp(data->relative.R(0, 0), -1.0, 1.0));
  if (model->contact.kind != ContactModel::Kind::kRings || tilt <= kMostTilt) return;
  warned_tilt = true;
  char text[200];
  std::snprintf(
      text, sizeof text,
      "surfaces touch at t = %.9g s with the rings tilted by %.1f deg; the limit of the model is "
      "%.0f deg: do not trust loads and motion from here on",
      setup->t_start + now, tilt, kMostTilt);
  warnings.push_back(text);
}

/// Near a singular pose of the independent coordinates, change to other independent coordinates.
/// All coordinates and velocities, and therefore momentum and energy, stay unchanged.
/// @param changed  set if the meaning of the state changed
Status DockingSim::Impl::update_coordinates(double tau, bool& changed) {
  if (data->locked) return {};
  const double margin = find_singularity_margin(model->mechanism, data->mechanism);
  if (margin < model->mechanism.model.singularity.warning && !warned_margin) {
    char text[120];
    std::snprintf(text, sizeof text, "a loop is close to singular (margin %.3g) at t = %.9g s",
                  margin, setup->t_start + elapsed + tau);
    warnings.push_back(text);
    warned_margin = true;
  }
  if (margin >= kChangeMargin) {
    margin_looked_at = kChangeMargin;
    return {};
  }
  // The search is expensive: search again only after a much smaller margin.
  if (margin > kLookAgain * margin_looked_at) return {};
  margin_looked_at = margin;
  calc_leg_bodies(model->mechanism, data->mechanism);
  std::optional<Coordinates> better = find_better_coordinates(model->mechanism, data->mechanism);
  if (!better) return {};
  const VecX<double> q = data->mechanism.tree.q, v = data->mechanism.tree.v;
  use_coordinates(std::make_shared<const Coordinates>(std::move(*better)));
  TreeData<double>& tree = data->mechanism.tree;
  tree.q = q;
  tree.v = v;
  get_mechanism_state(*model, tree, stepper->y());
  changed = true;
  return evaluate(tau);
}

/// Change to a choice of independent coordinates; null: the choice of the start.
void DockingSim::Impl::use_coordinates(std::shared_ptr<const Coordinates> choice) {
  pose_is_kept = false;
  if (!start_mechanism) start_mechanism = std::make_unique<Mechanism>(model->mechanism);
  const auto changed = std::make_shared<DockingModel>(*model);
  set_mechanism(*changed, choice ? with_coordinates(*start_mechanism, *choice) : *start_mechanism);
  use_model(changed);
  data->mechanism = MechanismData<double>(model->mechanism);
  rate_data->mechanism = MechanismData<double>(model->mechanism);
  if (interface_work) interface_work = std::make_unique<InterfaceWorkspace>(*model);
  if (jacobian_pass) make_jacobian_pass();
  if (unreduced) unreduced->update_coordinates();
  attach_kernel();
  coordinates = std::move(choice);
}

/// Update the contact memory to the present state. The energy of removed bristles is dissipated.
/// @return true if the state changed
bool DockingSim::Impl::update_memory() {
  if (!has_surfaces()) return false;
  const double dropped =
      update_contact_memory(model->contact, data->relative, bristles(), data->contact_work, memory);
  stepper->y()[model->layout.sums + kSumFriction] += dropped;
  return dropped > 0.0;
}

/// Without a located event, the present state decides whether the absorber acts. @pre evaluate(0).
/// @post the same
Status DockingSim::Impl::decide_absorber() {
  if (!locates_events() || !events->decide_absorber(*data)) return {};
  kept_jacobian.valid = false;
  return evaluate(0.0);
}

/// Rounding of the host's clock [s].
double DockingSim::Impl::find_clock_rounding(double now) const {
  return 4e-16 * (std::abs(setup->t_start) + std::abs(now));
}

bool DockingSim::Impl::update_thrust(double now) {
  return events->update_thrust(now, find_clock_rounding(now));
}

bool DockingSim::Impl::update_latches(double now) {
  return events->update_latches(*data, now, stepper->y()[model->layout.sums + kSumLatches]);
}

/// Evaluate one state of the stepper, tau after the last communication point.
/// @param may_be_locked  as one body with the chaser, if the mechanism is quiescent
/// @param ydot  rates, or null
Status DockingSim::Impl::evaluate(double tau, bool may_be_locked, double* ydot) {
  drifted = false;
  if (parameters.model_level != kRigid) {
    data->locked = may_be_locked && quiescent.on && may_be_quiescent() ? &locked : nullptr;
  }
  Status status = calc_docking<double>(*model, discrete, memory, find_loads(tau), elapsed + tau,
                                       stepper->y(), ydot, *data);
  if (!status.ok()) status.time = elapsed + tau;
  return status;
}

/// evaluate(0), unless a free drift has just evaluated this state.
Status DockingSim::Impl::evaluate_present() {
  if (drifted && quiescent.on && data->locked && may_be_quiescent()) return {};
  return evaluate(0.0);
}

/// The same at the start of a communication step, with the rates for methods that begin with them.
Status DockingSim::Impl::evaluate_start() {
  evaluated = Evaluated::kNothing;
  if (quiescent.on || !begins_with_rates()) return evaluate_present();
  const Status status = evaluate(0.0, true, start_rates.data());
  note_evaluation(0.0, stepper->y());
  evaluated = Evaluated::kStart;
  return status;
}

const double* DockingSim::Impl::find_start_rates() const {
  return evaluated == Evaluated::kStart ? start_rates.data() : nullptr;
}

/// The same at the end of a step of the integrator, which has often evaluated this state.
Status DockingSim::Impl::evaluate_end(double tau) {
  const bool is_there = evaluated == Evaluated::kTrial && is_evaluated(tau, stepper->y());
  // If locked, parts of rate_data are out of date.
  if (!is_there || data->locked || rate_data->mechanism.found == Need::kRates) {
    return evaluate(tau);
  }
  std::swap(data, rate_data);
  evaluated = Evaluated::kNothing;
  return {};
}

/// rate_data belongs to the state y at tau.
void DockingSim::Impl::note_evaluation(double tau, const double* y) {
  evaluated = Evaluated::kTrial;
  tau_evaluated = tau;
  std::copy_n(y, y_evaluated.size(), y_evaluated.begin());
}

bool DockingSim::Impl::is_evaluated(double tau, const double* y) const {
  return evaluated != Evaluated::kNothing && tau == tau_evaluated &&
         std::equal(y_evaluated.begin(), y_evaluated.end(), y);
}

}  // namespace dockloop
