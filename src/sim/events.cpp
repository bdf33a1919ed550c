// What happens at accepted states: first contact, latches, capture, thrust, phase, the memory of
// the contact search, peaks, and going over to other independent coordinates.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "sim/sim_impl.hpp"

namespace dockloop {

/// Everything that happens once per accepted inner step. @pre evaluate(tau)
/// @param changed  set if the state or the equations changed, so that the integrator must start
/// again.
Status DockingSim::Impl::accept(double tau, bool& changed) {
  if (reference) update_drift(tau);
  const Status moved = update_coordinates(tau, changed);
  if (!moved.ok()) return moved;
  keep_pose();
  if (update_memory()) changed = true;
  bool jumped = false;
  const double now = elapsed + tau;
  if (!discrete.contacted && has_surfaces() && (due[0] || data->contact.gap <= 0.0)) {
    begin_contact(now);
    jumped = true;
  }
  if (update_absorber()) jumped = true;
  if (update_latches(now)) jumped = true;
  update_capture(now);
  if (update_thrust(now)) jumped = true;
  changed = changed || jumped;
  if (changed) kept_jacobian.valid = false;
  warn_of_tilt(now);
  const PhaseInputs phase_inputs = find_phase_inputs(*data, find_near_gap(*data));
  update_seat(phase_inputs, now, discrete);
  update_phase(phase_inputs, discrete);
  // Peaks see the forces on both sides of a jump. An absorber that does not pull is let go where
  // its force is zero, give or take rounding.
  if (!due[1] || model->contact.absorber.pulls) peaks.add(now, find_peak_values());
  if (!jumped) return {};
  const Status after = evaluate(tau);
  if (!after.ok()) return after;
  peaks.begin(now, find_peak_values());
  return {};
}

/// The present pose of the mechanism is accepted: the next ones continue from it.
void DockingSim::Impl::keep_pose() {
  if (model->locked.on) return;
  pose_is_kept = false;
  keep_reference(model->mechanism, data->mechanism);
  rate_data->mechanism.loops.reference = data->mechanism.loops.reference;
}

/// Rings are described for a limited tilt; what touches beyond it is not to be trusted.
void DockingSim::Impl::warn_of_tilt(double now) {
  constexpr double kMostTilt = 30.0, kInDegrees = 180.0 / static_cast<double>(EIGEN_PI);  // [deg]
  if (warned_tilt || !has_surfaces() || data->contact.active_count == 0) return;
  const double tilt = kInDegrees * std::acos(std::clamp(data->relative.R(0, 0), -1.0, 1.0));
  if (model->contact.kind != ContactModel::Kind::kRings || tilt <= kMostTilt) return;
  warned_tilt = true;
  char text[200];
  std::snprintf(
      text, sizeof text,
      "surfaces touch at t = %.9g s with the rings tilted by %.1f deg; they are described "
      "for tilts below %.0f deg: do not trust loads and motion from here on",
      setup->t_start + now, tilt, kMostTilt);
  warnings.push_back(text);
}

/// Near a pose where the independent coordinates stop being independent, go over to others. All
/// coordinates and velocities stay as they are, so momentum and energy do too.
/// @param changed  set if the meaning of the state changed
Status DockingSim::Impl::update_coordinates(double tau, bool& changed) {
  if (model->locked.on) return {};
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
  // The search is dear: look again only where things got much worse.
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

/// Go over to a choice of independent coordinates; null: that of the start.
void DockingSim::Impl::use_coordinates(std::shared_ptr<const Coordinates> choice) {
  pose_is_kept = false;
  if (!start_mechanism) start_mechanism = std::make_unique<Mechanism>(model->mechanism);
  set_mechanism(*model, choice ? with_coordinates(*start_mechanism, *choice) : *start_mechanism);
  data->mechanism = MechanismData<double>(model->mechanism);
  rate_data->mechanism = MechanismData<double>(model->mechanism);
  if (interface_work) interface_work = std::make_unique<InterfaceWorkspace>(*model);
  if (jacobian_pass) make_jacobian_pass();
  if (reference) make_reference();
  attach_kernel();
  coordinates = std::move(choice);
}

/// Bring the contact memory up to the present state and book the energy of bristles that it drops.
/// @return true if the state changed by that
bool DockingSim::Impl::update_memory() {
  if (!has_surfaces()) return false;
  const double dropped =
      update_contact_memory(model->contact, data->relative, bristles(), data->contact_work, memory);
  stepper->y()[model->layout.sums + kSumFriction] += dropped;
  return dropped > 0.0;
}

/// An absorber acts from event to event; where none was located, its depth and force tell.
/// @return true if that changed
bool DockingSim::Impl::update_absorber() {
  if (memory.absorber == Acting::kByState) return due[0] || due[1];
  const bool acts = due[0] || (!due[1] && data->contact.pressed >= 0.0);
  const Acting before = std::exchange(memory.absorber, acts ? Acting::kYes : Acting::kNo);
  return due[0] || due[1] || memory.absorber != before;
}

/// The same where no event was located: at the start, and where a host has moved a vehicle. Where
/// surfaces just touch, what they are about to do counts, not the rounding of a gap.
/// @pre evaluate(0). @post the same
Status DockingSim::Impl::decide_absorber() {
  if (model->contact.kind != ContactModel::Kind::kAbsorber || !locates_events()) return {};
  const bool touches = std::abs(data->contact.gap) <= kTouching;
  const bool acts = touches ? data->relative.v.x() < 0.0 : data->contact.pressed > 0.0;
  const Acting before = std::exchange(memory.absorber, acts ? Acting::kYes : Acting::kNo);
  if (memory.absorber == before) return {};
  kept_jacobian.valid = false;
  return evaluate(0.0);
}

/// Change the mode of every latch that is due, by a root or because it starts there.
bool DockingSim::Impl::update_latches(double now) {
  bool changed = false;
  for (int i = 0; i < model->latches.count(); ++i) {
    if (!due[kFixedRoots + i] && !passed[i] && data->latch.event[i] > 0.0) continue;
    const LatchMode before = discrete.latch[i].mode;
    stepper->y()[model->layout.sums + kSumLatches] +=
        update_latch(model->latches, i, now, data->relative, discrete.latch[i], passed[i] != 0);
    changed = changed || discrete.latch[i].mode != before;
    // In a central docking the first latch catches before any surface touches.
    if (discrete.latch[i].mode == LatchMode::kHeld && !discrete.contacted) begin_contact(now);
  }
  return changed;
}

void DockingSim::Impl::begin_contact(double now) {
  discrete.contacted = true;
  discrete.time_of_contact = now;
}

int DockingSim::Impl::count_held_latches() const {
  int held = 0;
  for (int i = 0; i < model->latches.count(); ++i) {
    held += discrete.latch[i].mode == LatchMode::kHeld;
  }
  return held;
}

void DockingSim::Impl::update_capture(double now) {
  const int count = model->latches.count();
  const bool all = count > 0 && count_held_latches() == count;
  if (all && !discrete.captured && discrete.time_of_capture < 0.0) discrete.time_of_capture = now;
  discrete.captured = all;
}

/// Rounding of the host's clock [s].
double DockingSim::Impl::find_clock_rounding(double now) const {
  return 4e-16 * (std::abs(setup->t_start) + std::abs(now));
}

/// Contact thrust acts from its delay after first contact until capture: when it begins or began [s
/// since the start], if it is to act.
std::optional<double> DockingSim::Impl::find_thrust_onset() const {
  if (model->thrust == 0.0 || !discrete.contacted || discrete.captured) return std::nullopt;
  return discrete.time_of_contact + model->thrust_delay;
}

bool DockingSim::Impl::is_thrust_due(double now) const {
  const std::optional<double> onset = find_thrust_onset();
  return onset && now + find_clock_rounding(now) >= *onset;
}

bool DockingSim::Impl::update_thrust(double now) {
  const bool on = is_thrust_due(now);
  const bool changed = on != discrete.thrust_on;
  discrete.thrust_on = on;
  return changed;
}

/// Everything at one state of the stepper, tau after the last communication point.
/// @param may_be_locked  as one body with the chaser, if the mechanism is at rest
/// @param ydot  rates, if they are wanted
Status DockingSim::Impl::evaluate(double tau, bool may_be_locked, double* ydot) {
  flown = false;
  if (parameters.model_level != kRigid) {
    model->locked.on = may_be_locked && rest_state.resting && may_rest();
  }
  Status status = calc_docking<double>(*model, discrete, memory, find_loads(tau), elapsed + tau,
                                       stepper->y(), ydot, *data);
  if (!status.ok()) status.time = elapsed + tau;
  return status;
}

/// evaluate(0), unless a flight has left just that.
Status DockingSim::Impl::evaluate_present() {
  if (flown && rest_state.resting && model->locked.on && may_rest()) return {};
  return evaluate(0.0);
}

/// The same at the start of a communication step, with the rates for methods that begin with them.
Status DockingSim::Impl::evaluate_start() {
  evaluated = Evaluated::kNothing;
  if (rest_state.resting || !begins_with_rates()) return evaluate_present();
  const Status status = evaluate(0.0, true, start_rates.data());
  note_evaluation(0.0, stepper->y());
  evaluated = Evaluated::kStart;
  return status;
}

const double* DockingSim::Impl::find_start_rates() const {
  return evaluated == Evaluated::kStart ? start_rates.data() : nullptr;
}

/// The same at the end of a step of the integrator, which has often evaluated just that.
Status DockingSim::Impl::evaluate_end(double tau) {
  const bool is_there = evaluated == Evaluated::kTrial && is_evaluated(tau, stepper->y());
  // Locked, some of rate_data is stale.
  if (!is_there || model->locked.on || rate_data->mechanism.found == Need::kRates) {
    return evaluate(tau);
  }
  std::swap(data, rate_data);
  evaluated = Evaluated::kNothing;
  return {};
}

/// rate_data is that of the state y at tau.
void DockingSim::Impl::note_evaluation(double tau, const double* y) {
  evaluated = Evaluated::kTrial;
  tau_evaluated = tau;
  std::copy_n(y, y_evaluated.size(), y_evaluated.begin());
}

bool DockingSim::Impl::is_evaluated(double tau, const double* y) const {
  return evaluated != Evaluated::kNothing && tau == tau_evaluated &&
         std::equal(y_evaluated.begin(), y_evaluated.end(), y);
}

/// Roots: first contact (for an absorber every onset), where an absorber ceases to act, surfaces
/// that open as far as a rebound needs, latches.
/// @param at  its workspace of the contact search is used
void DockingSim::Impl::calc_event_functions(DockingData<double>& at, double* roots) const {
  const bool absorber = model->contact.kind == ContactModel::Kind::kAbsorber;
  roots[0] = has_surfaces() && !discrete.contacted ? at.contact.gap : 1.0;
  roots[1] = 1.0;
  roots[2] = may_part() ? kReboundGap - find_near_gap(at) : 1.0;
  if (has_surfaces() && absorber) {
    const bool by_state = memory.absorber == Acting::kByState;
    roots[0] = by_state ? at.contact.gap : -at.contact.pressed;
    roots[1] = by_state ? -at.contact.gap : at.contact.pressed;
  }
  for (int i = 0; i < model->latches.count(); ++i) roots[kFixedRoots + i] = at.latch.event[i];
}

/// How fast the event functions may change where they may be below zero between two states.
void DockingSim::Impl::calc_event_speeds(const DockingData<double>& at, double* speeds) const {
  std::fill_n(speeds, kFixedRoots, 0.0);
  if (has_surfaces() && model->contact.kind == ContactModel::Kind::kRings) {
    const double bound = find_approach_bound(model->contact, at.relative);
    if (!discrete.contacted) speeds[0] = bound;
    if (may_part()) speeds[2] = bound;
  }
  for (int i = 0; i < model->latches.count(); ++i) {
    speeds[kFixedRoots + i] =
        find_event_speed(discrete.latch[i], find_latch_motion(model->latches, i, at.relative));
  }
}

/// A fixed step begins: where its latches are. @pre evaluate()
void DockingSim::Impl::note_latches() {
  for (int i = 0; i < model->latches.count(); ++i) {
    latches_before[i] = find_latch_motion(model->latches, i, data->relative);
  }
}

/// The latches that a fixed step of size h has passed. @pre note_latches() at its start, evaluate()
/// at its end
void DockingSim::Impl::find_passed_latches(double h) {
  for (int i = 0; i < model->latches.count(); ++i) {
    passed[i] = is_passed(model->latches.law, discrete.latch[i], latches_before[i],
                          find_latch_motion(model->latches, i, data->relative), h);
  }
}

/// Is a rebound possible, which is watched between accepted states?
bool DockingSim::Impl::may_part() const {
  return has_surfaces() && model->contact.kind == ContactModel::Kind::kRings &&
         !discrete.captured && discrete.phase != kRebound && count_held_latches() == 0;
}

/// The gap of the surfaces where it is positive and not above kReboundGap. Above, it is a lower
/// bound: what the contact search knows, which depends on where it looked last. So it is after a
/// capture, when nothing hangs on it.
/// @param at  its workspace of the contact search is used
double DockingSim::Impl::find_near_gap(DockingData<double>& at) const {
  const double gap = at.contact.gap;
  if (!has_surfaces() || discrete.captured || gap < 0.0 || gap > kReboundGap) return gap;
  return find_gap(model->contact, at.relative, at.contact_work);
}

/// @param gap  of the surfaces there, see find_near_gap()
PhaseInputs DockingSim::Impl::find_phase_inputs(const DockingData<double>& at, double gap) const {
  PhaseInputs in;
  if (!model->present[kTarget]) return in;
  const RelativeMotion<double> relative =
      find_relative(at.interface[kChaser], at.interface[kTarget]);
  in.gap = gap;
  in.axial = at.relative.p.x();
  in.axial_rate = relative.v.x();
  in.speed = relative.v.norm();
  in.angular_speed = relative.w.norm();
  in.latched = count_held_latches();
  in.seated = model->latches.count() > 0 && in.gap <= kSeatedGap;
  for (int i = 0; i < model->latches.count(); ++i) {
    in.seated = in.seated && at.latch.opening[i] <= model->latches.law.catch_distance;
  }
  for (int i = 0; i < model->contact.petal_count(); ++i) {
    in.on_petal = in.on_petal || !at.contact.petal_force[i].isZero(0.0);
  }
  return in;
}

}  // namespace dockloop
