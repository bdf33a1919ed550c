// Discrete decisions at accepted states; see event_logic.hpp.
#include "sim/event_logic.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dockloop {

int EventLogic::count_held_latches() const {
  return count_held(model_->latches, discrete_.latch.data());
}

void EventLogic::calc_functions(DockingData<double>& at, double* roots) const {
  roots[0] = has_surfaces() && !discrete_.contacted ? at.contact.gap : 1.0;
  roots[1] = 1.0;
  roots[2] = may_part() ? model_->phase_limits.rebound_gap - find_near_gap(at) : 1.0;
  if (has_surfaces() && is_absorber()) {
    calc_absorber_functions(at.contact, roots);
  }
  for (int i = 0; i < model_->latches.count(); ++i) {
    roots[kFixedRoots + i] = is_disarmed(i) ? 1.0 : at.latch.event[i];
  }
  if (discrete_.hard_dock.joint.on) std::fill_n(roots, kFixedRoots, 1.0);  // nothing moves inside
  const HardDock& dock = model_->hard_dock;
  if (hook_root() < first_row()) {
    roots[hook_root()] =
        are_waiting(dock, discrete_.hard_dock) ? find_hook_distance(dock, at.across) : 1.0;
  }
  if (sequence_.exists()) sequence_.calc_functions(at, roots + first_row());
  if (pusher_root() == root_count()) return;
  const PusherTravel travel = discrete_.hard_dock.pushers.on
                                  ? find_pusher_travel(dock.pushers, at.across)
                                  : PusherTravel{1.0, 1.0};
  roots[pusher_root()] = travel.to_touch;
  roots[pusher_root() + 1] = travel.to_let_go;
}

/// Contact and release. A released absorber is not released again, and one in contact meets no
/// contact: steps to such an event could end a little before it, again and again.
void EventLogic::calc_absorber_functions(const ContactResult<double>& contact,
                                         double* roots) const {
  const Acting acting = memory_.absorber;
  if (acting == Acting::kByState) {
    roots[0] = contact.gap;
    roots[1] = -contact.gap;
    return;
  }
  roots[0] = acting == Acting::kYes ? 1.0 : -contact.pressed;
  roots[1] = acting == Acting::kNo ? 1.0 : contact.pressed;
}

bool EventLogic::is_disarmed(int latch) const {
  return discrete_.latch[latch].mode == LatchMode::kSpent && !discrete_.sequence.is_armed;
}

void EventLogic::calc_speeds(const DockingData<double>& at, double* speeds) const {
  std::fill_n(speeds, kFixedRoots, 0.0);
  if (has_surfaces() && model_->contact.has_surfaces()) {
    const double bound = find_approach_bound(model_->contact, at.relative);
    if (!discrete_.contacted) speeds[0] = bound;
    if (may_part()) speeds[2] = bound;
  }
  for (int i = 0; i < model_->latches.count(); ++i) {
    speeds[kFixedRoots + i] =
        find_event_speed(discrete_.latch[i], find_latch_motion(model_->latches, i, at.relative));
  }
  std::fill(speeds + hook_root(), speeds + first_row(), 0.0);
  sequence_.calc_speeds(at, speeds + first_row());
  std::fill(speeds + pusher_root(), speeds + root_count(), 0.0);
}

void EventLogic::set_due_below(DockingData<double>& at, double limit) {
  double roots[kMaxRoots];
  calc_functions(at, roots);
  for (int i = 0; i < root_count(); ++i) set_due(i, roots[i] <= limit);
}

void EventLogic::note_latches(const DockingData<double>& at) {
  for (int i = 0; i < model_->latches.count(); ++i) {
    latches_before_[i] = find_latch_motion(model_->latches, i, at.relative);
  }
}

void EventLogic::find_passed_latches(const DockingData<double>& at, double h) {
  for (int i = 0; i < model_->latches.count(); ++i) {
    passed_[i] = is_passed(model_->latches.latch[i].law, discrete_.latch[i], latches_before_[i],
                           find_latch_motion(model_->latches, i, at.relative), h);
  }
}

bool EventLogic::update_first_contact(const DockingData<double>& at, double now) {
  if (discrete_.contacted || !has_surfaces()) return false;
  if (!is_due(0) && !(at.contact.gap <= 0.0)) return false;
  begin_contact(now);
  return true;
}

void EventLogic::begin_contact(double now) {
  discrete_.contacted = true;
  discrete_.time_of_contact = now;
}

bool EventLogic::update_absorber(const DockingData<double>& at) {
  if (memory_.absorber == Acting::kByState) return is_due(0) || is_due(1);
  const bool acts = is_due(0) || (!is_due(1) && at.contact.pressed >= 0.0);
  const Acting before = std::exchange(memory_.absorber, acts ? Acting::kYes : Acting::kNo);
  return is_due(0) || is_due(1) || memory_.absorber != before;
}

bool EventLogic::decide_absorber(const DockingData<double>& at) {
  if (!is_absorber()) return false;
  const bool touches = std::abs(at.contact.gap) <= kTouching;
  const bool acts = touches ? at.relative.v.x() < 0.0 : at.contact.pressed > 0.0;
  const Acting before = std::exchange(memory_.absorber, acts ? Acting::kYes : Acting::kNo);
  return memory_.absorber != before;
}

bool EventLogic::update_latches(const DockingData<double>& at, double now, double& dissipated) {
  bool changed = false;
  for (int i = 0; i < model_->latches.count(); ++i) {
    if (!is_due(kFixedRoots + i) && !passed_[i] && at.latch.event[i] > 0.0) continue;
    if (is_disarmed(i)) continue;
    LatchState& latch = discrete_.latch[i];
    const LatchMode before = latch.mode;
    dissipated += update_latch(model_->latches, i, now, at.relative, latch, passed_[i] != 0);
    changed = changed || latch.mode != before;
    // In a central docking the first latch catches before any surface touches.
    if (latch.mode == LatchMode::kHeld && !discrete_.contacted) begin_contact(now);
  }
  return changed;
}

bool EventLogic::update_hooks(const DockingData<double>& at, double now, double clock_rounding) {
  const HardDock& dock = model_->hard_dock;
  if (dock.hooks.rows.empty()) return false;
  const bool can_close = are_waiting(dock, discrete_.hard_dock) &&
                         (is_due(hook_root()) || find_hook_distance(dock, at.across) <= 0.0);
  return dockloop::update_hooks(dock, can_close, now + clock_rounding, discrete_.hard_dock);
}

void EventLogic::update_capture(double now) {
  const bool holds =
      model_->latches.is_capture(count_held_latches()) || discrete_.sequence.has_grasped;
  if (holds && !discrete_.captured && discrete_.time_of_capture < 0.0) {
    discrete_.time_of_capture = now;
  }
  discrete_.captured = holds;
}

SequenceChange EventLogic::update_sequence(DockingData<double>& at, double now,
                                           double clock_rounding, double* sums) {
  char* const due = due_.data() + first_row();
  const SequenceChange change = sequence_.update(at, now, clock_rounding, due, sums);
  std::fill_n(due, sequence_.root_count(), 0);
  return change;
}

std::optional<double> EventLogic::find_thrust_onset() const {
  if (model_->thrust == 0.0) return std::nullopt;
  if (sequence_.exists()) return sequence_.find_thrust_onset();
  if (!discrete_.contacted || discrete_.captured) return std::nullopt;
  return discrete_.time_of_contact + model_->thrust_delay;
}

bool EventLogic::is_thrust_due(double now, double clock_rounding) const {
  const std::optional<double> onset = find_thrust_onset();
  return onset && now + clock_rounding >= *onset;
}

bool EventLogic::update_thrust(double now, double clock_rounding) {
  const bool on = is_thrust_due(now, clock_rounding);
  return std::exchange(discrete_.thrust_on, on) != on;
}

int EventLogic::find_acting(double now, double clock_rounding) const {
  int acting = 0;
  for (size_t k = 0; k < model_->disturbances.size(); ++k) {
    const Disturbance& disturbance = model_->disturbances[k];
    const double begin = find_time(disturbance.onset, discrete_.entered.data());
    const double at = now + clock_rounding;
    if (at >= begin && at < begin + disturbance.duration) acting |= 1 << k;
  }
  return acting;
}

bool EventLogic::update_disturbances(double now, double clock_rounding) {
  const int acting = find_acting(now, clock_rounding);
  return std::exchange(discrete_.disturbances, acting) != acting;
}

double EventLogic::find_next_disturbance(double now) const {
  double next = std::numeric_limits<double>::infinity();
  for (const Disturbance& disturbance : model_->disturbances) {
    const double begin = find_time(disturbance.onset, discrete_.entered.data());
    for (const double change : {begin, begin + disturbance.duration}) {
      if (change > now) next = std::min(next, change);
    }
  }
  return next;
}

bool EventLogic::update_inputs(double now, double clock_rounding) {
  bool changed = false;
  for (size_t k = 0; k < model_->inputs.size(); ++k) {
    const int row = find_row(model_->inputs[k], now + clock_rounding);
    if (std::exchange(discrete_.input_row[k], row) != row) changed = true;
  }
  return changed;
}

double EventLogic::find_next_input() const {
  double next = std::numeric_limits<double>::infinity();
  for (size_t k = 0; k < model_->inputs.size(); ++k) {
    const std::vector<double>& time = model_->inputs[k].time;
    const size_t row = static_cast<size_t>(discrete_.input_row[k] + 1);
    if (row < time.size()) next = std::min(next, time[row]);
  }
  return next;
}

DisturbingLoads EventLogic::find_disturbing_loads() const {
  return add_disturbances(
      [this](size_t k) { return discrete_.disturbances & (1 << k) ? 1.0 : 0.0; });
}

DisturbingLoads EventLogic::find_mean_disturbing_loads(double from, double h) const {
  return add_disturbances([&](size_t k) {
    const Disturbance& disturbance = model_->disturbances[k];
    const double begin = find_time(disturbance.onset, discrete_.entered.data());
    const double end = begin + disturbance.duration;
    return std::clamp((std::min(end, from + h) - std::max(begin, from)) / h, 0.0, 1.0);
  });
}

/// @param share  of each disturbance
template <class Share>
DisturbingLoads EventLogic::add_disturbances(Share share) const {
  DisturbingLoads loads{};
  for (size_t k = 0; k < model_->disturbances.size(); ++k) {
    const Disturbance& disturbance = model_->disturbances[k];
    if (model_->driven[disturbance.vehicle]) continue;  // the host states what acts
    const double part = share(k);
    if (part == 0.0) continue;
    loads[disturbance.vehicle] +=
        Wrench<double>{part * disturbance.force, part * disturbance.torque};
  }
  return loads;
}

void EventLogic::update_phases(DockingData<double>& at, double now) {
  const PhaseInputs in = find_phase_inputs(at, find_near_gap(at));
  update_phases(in, now, discrete_);
  if (sequence_.exists()) sequence_.update_phase(in.latched);
}

void EventLogic::update_phases(const PhaseInputs& in, double now, DiscreteState& state) const {
  update_seat(in, now, state);
  if (!sequence_.exists()) update_phase(in, state);
}

bool EventLogic::is_change_due(DockingData<double>& at, double now, double clock_rounding) const {
  double roots[kMaxRoots];
  calc_functions(at, roots);
  const bool touched = !discrete_.contacted && has_surfaces() && at.contact.gap <= 0.0;
  const bool latch = std::any_of(roots + kFixedRoots, roots + first_row(),
                                 [](double root) { return root <= 0.0; });
  HardDockState docking = discrete_.hard_dock;
  const bool ramp = dockloop::update_hooks(model_->hard_dock, false, now + clock_rounding, docking);
  if (touched || latch || ramp) return true;
  if (is_thrust_due(now, clock_rounding) != discrete_.thrust_on) return true;
  if (find_acting(now, clock_rounding) != discrete_.disturbances) return true;
  if (now + clock_rounding >= find_next_input()) return true;
  if (sequence_.exists()) return sequence_.is_change_due(at, now, clock_rounding);
  DiscreteState next = discrete_;
  update_phase(find_phase_inputs(at, find_near_gap(at)), next);
  return next.phase != discrete_.phase || next.outcome != discrete_.outcome;
}

bool EventLogic::may_part() const {
  return !sequence_.exists() && has_surfaces() && model_->contact.has_surfaces() &&
         !discrete_.captured && discrete_.phase != kRebound && count_held_latches() == 0;
}

double EventLogic::find_near_gap(DockingData<double>& at) const {
  const double gap = at.contact.gap;
  const bool is_far = gap > model_->phase_limits.rebound_gap;
  if (!has_surfaces() || discrete_.captured || gap < 0.0 || is_far) return gap;
  return find_gap(model_->contact, memory_, at.relative, at.contact_work);
}

PhaseInputs EventLogic::find_phase_inputs(const DockingData<double>& at, double gap) const {
  PhaseInputs in;
  in.limits = model_->phase_limits;
  if (!model_->present[kTarget]) return in;
  const RelativeMotion<double> relative = find_across(*model_, at);
  in.gap = gap;
  in.axial = at.relative.p.x() + model_->contact.depth;
  in.axial_rate = relative.v.x();
  in.speed = relative.v.norm();
  in.angular_speed = relative.w.norm();
  in.latched = count_held_latches();
  in.seated = model_->latches.count() > 0 && in.gap <= in.limits.seated_gap;
  for (int i = 0; i < model_->latches.count(); ++i) {
    in.seated = in.seated && at.latch.opening[i] <= model_->latches.latch[i].law.catch_distance;
  }
  for (size_t i = 0; i < model_->contact.surfaces.size(); ++i) {
    in.on_petal = in.on_petal || !at.contact.surface_force[i].isZero(0.0);
  }
  return in;
}

LatchReport EventLogic::find_latch_report(const DockingData<double>& at, int i) const {
  const LatchLaw& law = model_->latches.latch[i].law;
  switch (discrete_.latch[i].mode) {
    case LatchMode::kHeld:
      return kCaught;
    case LatchMode::kReleasing:
      return kLettingGo;
    case LatchMode::kSpent:
      return kFree;
    case LatchMode::kOpen:
      break;
  }
  const double opening = at.latch.opening[i], lateral = at.latch.lateral[i];
  if (opening >= law.pawl_range || opening <= -law.guard || lateral >= 2.0 * law.window) {
    return kFree;
  }
  return lateral < law.window ? kInReach : kPushed;
}

double EventLogic::find_free_gap(DockingData<double>& at, double exact_below) const {
  if (!model_->present[kTarget]) return kNoGap;
  double gap = at.contact.gap;  // a cheap bound
  if (gap <= exact_below && has_surfaces()) {
    gap = find_gap(model_->contact, memory_, at.relative, at.contact_work);
  }
  if (!model_->hard_dock.empty()) {
    gap = std::min(gap, find_free_opening(model_->hard_dock, discrete_.hard_dock, at.across));
  }
  for (int i = 0; i < model_->latches.count(); ++i) {
    const LatchMode mode = discrete_.latch[i].mode;
    if (mode == LatchMode::kHeld || mode == LatchMode::kReleasing) return 0.0;
    const LatchLaw& law = model_->latches.latch[i].law;
    const Vec3<double> s = find_latch_motion(model_->latches, i, at.relative).s;
    gap = std::min(gap, std::max(s.x() - law.pawl_range, s.tail<2>().norm() - 2.0 * law.window));
  }
  return gap;
}

}  // namespace dockloop
