// A host whose loads act late, or whose motion comes back late, by a known time (coupling.delay).
//
// A report is the motion at an earlier time. From there the host's vehicle is predicted up to now,
// and on to the time at which the next announced load acts, with the loads that are under way.
// Without a delay these times are the same, and no load is under way.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/host_coupling.hpp"

namespace dockloop {

bool HostCoupling::is_delayed() const {
  return has_host() && setup_->parameters.coupling_delay > 0.0;
}

double HostCoupling::find_lead() const {
  const Parameters& p = setup_->parameters;
  if (!is_delayed()) return 0.0;
  const double step = p.coupling_mode == kSequential ? state_.last_step : 0.0;
  return std::max(p.coupling_delay - p.coupling_motion_delay - step, 0.0);
}

/// Time of the motion that the host reports now [s since start].
double HostCoupling::find_report_time() const {
  const double late = setup_->parameters.coupling_motion_delay;
  return late > 0.0 ? std::max(state_.elapsed - late, 0.0) : state_.elapsed;
}

/// Known loads before this time are stored: motion is late.
double HostCoupling::find_past_end() const {
  return setup_->parameters.coupling_motion_delay > 0.0 ? state_.elapsed : 0.0;
}

/// Calls f(load, length [s], is it the last one) for the loads that the host holds between two
/// times. Without a delay this is the load of the last step.
template <class F>
void HostCoupling::for_each_held_load(int i, double begin, double end, F&& f) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  if (is_delayed()) {
    for_each_load(v.queue, begin, end, f);
  } else if (end > begin) {
    f(v.held, state_.last_step, true);
  }
}

int HostCoupling::count_held_loads(int i, double begin, double end) const {
  int count = 0;
  for_each_held_load(i, begin, end, [&](const Wrench<double>&, double, bool) { ++count; });
  return count;
}

/// Motion of the host's vehicle at `end`. @param from  its motion at `begin`
/// @param delivered  impulse of the loads between, if not null
VehicleState HostCoupling::advance_body(int i, const VehicleBody& body, VehicleState from,
                                        double begin, double end, Wrench<double>* delivered) const {
  for_each_held_load(i, begin, end, [&](const Wrench<double>& load, double length, bool) {
    const VehicleState to = predict_host(i, body, from, load, begin, length);
    begin += length;
    if (delivered) *delivered += dockloop::find_delivered_impulse(load, from, to, length);
    from = to;
  });
  return from;
}

VehicleState HostCoupling::advance_host(int i, const VehicleState& from, double begin, double end,
                                        Wrench<double>* delivered) const {
  return advance_body(i, state_.coupling.vehicle[i].body, from, begin, end, delivered);
}

/// Impulse of the loads since the last report. @param host  motion at the time `at`
Wrench<double> HostCoupling::find_delivered_impulse(int i, const VehicleState& host,
                                                    double at) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  VehicleState from = v.received;
  double begin = v.since;
  Wrench<double> sum;
  for_each_held_load(i, v.since, at, [&](const Wrench<double>& load, double length, bool is_last) {
    const VehicleState to = is_last ? host : predict_host(i, v.body, from, load, begin, length);
    begin += length;
    sum += dockloop::find_delivered_impulse(load, from, to, length);
    from = to;
  });
  return sum;
}

/// Impulse exerted until now and not yet delivered at a later time.
/// @param host  motion at the time of the report that is due now
Wrench<double> HostCoupling::find_pending_impulse(int i, const VehicleState& host,
                                                  double until) const {
  const double at = find_report_time();
  Wrench<double> delivered;
  advance_host(i, host, at, until, &delivered);
  return state_.coupling.vehicle[i].pending - find_delivered_impulse(i, host, at) - delivered;
}

Wrench<double> HostCoupling::find_pending_impulse(int i) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  const bool is_received =
      !is_same_motion(inputs_.vehicle[i], v.input) && is_attitude(inputs_.vehicle[i].attitude);
  return find_pending_impulse(i, is_received ? find_received_state(i) : v.predicted,
                              state_.elapsed);
}

/// Loads that would act in the last step before the report with other delays.
void HostCoupling::find_other_loads(int i, LoadStep& step) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  if (!is_delayed()) {
    step.next[0] = step.announces ? state_.mean_load[i] : v.held;
    return;
  }
  const double h = step.h, at = find_report_time(), rounding = 1e-6;
  step.delay = setup_->parameters.coupling_delay;
  step.shorter = std::ceil(step.delay / h - rounding) * h;
  step.longer = std::floor(step.delay / h + rounding) * h;
  step.next_count = 0;
  for (int k = 0; k < kLateLoads; ++k) {
    const double early = step.delay - (step.shorter - (k + 1) * h);
    const double late = step.longer + (k + 1) * h - step.delay;
    step.earlier[static_cast<size_t>(k)] = find_mean_of_loads(v.queue, at - h - late, at - late);
    if (early > step.delay + 1.5 * h) continue;  // not announced yet
    step.next[static_cast<size_t>(step.next_count++)] =
        find_mean_of_loads(v.queue, at - h + early, at + early);
  }
}

/// How old is the motion that the host reports? Until the first motion arrives, a host reports the
/// motion at the start. Where O moves, as in an orbit, this age must be known.
HostFinding HostCoupling::judge_age(int i) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const Inputs::Vehicle& report = inputs_.vehicle[i];
  const double h = state_.last_step, stated = setup_->parameters.coupling_motion_delay;
  const double rounding = 1e-12 * (1.0 + report.position.norm());
  if (v.has_moved || (steps_first() && !is_delayed())) return {};  // judge_first_end
  const bool is_at_rest = !(h * v.input.velocity.norm() > rounding);
  if (is_same_motion(report, v.input) && !is_at_rest) return {};
  v.has_moved = true;
  if (is_at_rest) return {};
  const double age = state_.elapsed - h, error = std::abs(age - stated);
  if (error < (1.0 - 1e-6) * h) return {};
  const double distance = error * state_.frame_velocity.norm();
  constexpr double kFarAway = 1e-3;  // [m]
  return age < stated || distance > kFarAway ? HostFinding{kMotionAge, age} : HostFinding();
}

/// Loads that ended before the reports that the diagnosis compares.
void HostCoupling::forget_old_loads(DrivenVehicle& v) const {
  const double at = find_report_time();
  forget_loads(v.queue, at - (kLateLoads + 1) * state_.last_step);
  forget_loads(v.known, at);
}

Status HostCoupling::check_delay(double h, std::string& reason) {
  if (!is_delayed()) return {};
  const Parameters& p = setup_->parameters;
  const double delay = p.coupling_delay, on_the_way = delay - p.coupling_motion_delay;
  char text[300];
  if (p.coupling_mode == kSequential && on_the_way > 0.0 && on_the_way < (1.0 - 1e-6) * h) {
    std::snprintf(
        text, sizeof text,
        "coupling.delay leaves %.6g s for loads, less than the step of %.6g s, but the host "
        "makes this step after the FMU: shorten the step, or let both make it at the same "
        "time (coupling.mode, parallel)",
        on_the_way, h);
    reason = text;
    return {StatusCode::kBadInput, -1, delay, state_.elapsed};
  }
  // A shorter step later may pass, among loads of longer ones.
  bool has_room = state_.last_step > 0.0 || delay / h <= kMostQueuedLoads;
  for (int i : {kChaser, kTarget}) {
    DrivenVehicle& v = state_.coupling.vehicle[i];
    forget_old_loads(v);
    has_room = has_room && !is_full(v.queue);
  }
  if (!has_room) {
    std::snprintf(text, sizeof text,
                  "coupling.delay is %.6g s, and in steps of %.6g s more than %d loads wait to "
                  "act: make longer steps, or take the delay out of the loop",
                  delay, h, kMostQueuedLoads);
    reason = text;
    return {StatusCode::kBadInput, -1, delay, state_.elapsed};
  }
  for (double part : {on_the_way, p.coupling_motion_delay}) {
    if (std::abs(part / h - std::round(part / h)) < 1e-6) continue;
    std::snprintf(
        text, sizeof text,
        "%.6g s of coupling.delay are %.4g steps of %.6g s: the FMU assumes that loads of "
        "the host change inside its steps; if the host delays by whole steps, state this "
        "delay",
        part, part / h, h);
    for (int i : {kChaser, kTarget}) {
      if (model_->driven[i]) warn_once(i, kWarnedDelay, text);
    }
    break;
  }
  return {};
}

}  // namespace dockloop
