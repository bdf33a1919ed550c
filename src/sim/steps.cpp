// Communication steps: inputs, refused steps, and what is read at a communication point.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kLongestStep = 1e9;  ///< [s]
constexpr double kFade = 0.7;         ///< per step, of the regular step after a long step

/// Inputs after a time with constant slopes.
void advance(const Inputs& slopes, double h, Inputs& inputs) {
  for (int i : {kChaser, kTarget}) {
    inputs.vehicle[i].force_ext += h * slopes.vehicle[i].force_ext;
    inputs.vehicle[i].torque_ext += h * slopes.vehicle[i].torque_ext;
  }
  inputs.gravity += h * slopes.gravity;
  for (size_t i = 0; i < inputs.leg_force_command.size(); ++i) {
    inputs.leg_force_command[i] += h * slopes.leg_force_command[i];
  }
  for (size_t i = 0; i < inputs.element_command.size(); ++i) {
    inputs.element_command[i] += h * slopes.element_command[i];
  }
}

/// The member of the inputs that a history prescribes.
double& find_member(const InputHistory& history, Inputs& inputs) {
  const size_t of = static_cast<size_t>(history.of);
  switch (history.kind) {
    case InputKind::kForce:
      return inputs.vehicle[of].force_ext[history.component];
    case InputKind::kTorque:
      return inputs.vehicle[of].torque_ext[history.component];
    case InputKind::kGravity:
      return inputs.gravity[history.component];
    case InputKind::kLegCommand:
      return inputs.leg_force_command[of];
    default:
      return inputs.element_command[of];
  }
}

/// f(history, row) for every history of a Real input.
template <class F>
void for_each_history(const DockingModel& model, const DiscreteState& discrete, F&& f) {
  for (size_t k = 0; k < model.inputs.size(); ++k) {
    const InputKind kind = model.inputs[k].kind;
    if (kind != InputKind::kCommand && kind != InputKind::kMotion) {
      f(model.inputs[k], discrete.input_row[k]);
    }
  }
}

}  // namespace

void DockingSim::Impl::read_inputs() {
  read_loads(inputs, find_point_time(), ahead.pending ? ahead.reached : 0.0);
  for (size_t k = 0; k < model->inputs.size(); ++k) {
    const InputHistory& history = model->inputs[k];
    if (history.kind == InputKind::kCommand) {
      inputs.command = static_cast<int>(find_line(history, discrete.input_row[k], 0.0).value);
    }
  }
}

/// @param from  inputs of the host; histories are put into them. @param now  [s since the start]
/// @param begin  the same, in the time of the solver
void DockingSim::Impl::read_loads(Inputs& from, double now, double begin) {
  for_each_history(*model, discrete, [&](const InputHistory& history, int row) {
    const InputLine line = find_line(history, row, now);
    find_member(history, from) = line.value;
    find_member(history, slopes) = line.rate;
  });
  bool are_sloped = false;
  for_each_value(slopes, [&](double& slope) { are_sloped = are_sloped || slope != 0.0; });
  loads.read(model->mechanism.model, from, slopes, are_sloped, begin);
  loads.add(events->find_disturbing_loads());
}

/// Means over the communication step that has been made. @param from  its start [s since the start]
const Loads& DockingSim::Impl::find_mean_loads(double from, double h) {
  const DisturbingLoads disturbing = events->find_mean_disturbing_loads(from, h);
  if (model->inputs.empty()) return loads.find_mean(h, disturbing);
  table_inputs = inputs;
  advance(slopes, 0.5 * h, table_inputs);
  for_each_history(*model, discrete, [&](const InputHistory& history, int) {
    find_member(history, table_inputs) = find_integrals(history, from, h).once / h;
  });
  return loads.find_mean(model->mechanism.model, table_inputs, disturbing);
}

/// O falls with gravity, so gravity does not act relative to O.
void DockingSim::Impl::fall(double h) {
  Vec3<double> g = inputs.gravity, slope = slopes.gravity;
  for_each_history(*model, discrete, [&](const InputHistory& history, int) {
    if (history.kind != InputKind::kGravity) return;
    const InputIntegrals fallen = find_integrals(history, find_point_time(), h);
    frame_shift[history.component] += fallen.twice;
    frame_velocity[history.component] += fallen.once;
    g[history.component] = slope[history.component] = 0.0;
  });
  frame_shift += 0.5 * h * h * g;
  frame_velocity += h * g;
  if (slope.isZero(0.0)) return;
  frame_shift += h * h * h / 6.0 * slope;
  frame_velocity += 0.5 * h * h * slope;
}

/// Rows of input histories begin to act inside a communication step: inputs from there on.
void DockingSim::Impl::read_tables(double tau) {
  table_inputs = inputs;
  advance(slopes, tau - ahead.reached, table_inputs);
  read_loads(table_inputs, elapsed + tau, tau);
}

/// A slope holds for one step; the input then keeps its final value. The equations of motion
/// predict driven vehicles, not slopes.
void DockingSim::Impl::advance_inputs(double h) {
  if (!loads.are_sloped()) return;
  advance(slopes, h, inputs);
  for_each_value(slopes, [](double& slope) { slope = 0.0; });
}

/// Why no step over h can be made; empty: it can.
std::string DockingSim::Impl::find_step_fault(double t, double h) const {
  if (!(h > 0.0 && h <= kLongestStep)) {
    return "the step must be longer than 0 s and at most 1e9 s";
  }
  for (int i : {kChaser, kTarget}) {
    if (model->record[i] < 0) continue;
    const double now = t - setup->t_start + h;
    const double end = model->inputs[static_cast<size_t>(model->record[i])].time.back();
    if (now <= end + 1e-9 * h + find_clock_rounding(now)) continue;
    char text[160];
    std::snprintf(text, sizeof text,
                  "the record of the %s ends at t = %.9g s; end the run there, or give the record "
                  "more rows",
                  get_vehicle_name(i), setup->t_start + end);
    return text;
  }
  return {};
}

/// One communication step from t to exactly t + h. On failure the state is unchanged.
Status DockingSim::Impl::step(double t, double h) {
  status_text.clear();
  const double late = find_lateness(t);
  read_inputs();
  const bool is_commanded = events->sequence().is_new(inputs.command) || is_hard_dock_command_new();
  bool goes_on = !is_commanded && step_loop->can_go_on(late, h);
  if (goes_on && step_loop->covers(late, h)) {
    goes_on = step_loop->stride(late, h);
    if (goes_on) return finish_step(h, true);
  }
  keep(step_start, !pose_is_kept);
  pose_is_kept = true;
  const Counters counters = step_loop->find_counters();
  const std::int64_t work = step_loop->find_work();
  const bool was_pending = ahead.pending;
  Status status;
  status_text = find_step_fault(t, h);
  if (status_text.empty()) {
    step_loop->note_inputs(goes_on);
    if (ahead.pending && !goes_on) status = settle();
    if (ahead.pending) {
      ahead.reached += late;
    } else if (late != 0.0) {
      elapsed = t - setup->t_start;
      read_inputs();
      evaluator->forget_present();
    }
    const std::int64_t limit = step_loop->find_work_limit(h);
    if (status.ok() && !ahead.pending) status = begin_step(h);
    if (status.ok()) status = step_loop->advance(h, limit, was_pending);
  } else {
    status.code = StatusCode::kBadInput;
  }
  if (status.ok()) {
    coupling.work = step_loop->find_work() - work;
    status = finish_step(h, was_pending);
    if (status.ok()) return status;
  }
  // These have their own cause; others may have another in the reports of a host.
  const bool is_explained = status.code == StatusCode::kCouplingUnstable ||
                            status.code == StatusCode::kBadInput ||
                            status.code == StatusCode::kInterrupted;
  const std::string cause = is_explained || !host->has_host() ? "" : host->explain_refusal();
  const Status back = restore(step_start);
  step_loop->set_counters(counters);
  // Outputs after a refusal are the outputs before the step; that state was valid.
  if (!back.ok() || !evaluate_point().ok()) status.code = StatusCode::kNotFinite;
  char text[120];
  std::snprintf(text, sizeof text, "step from t = %.9g s over %.6g s: ", t, h);
  if (status_text.empty()) status_text = describe(status);
  status_text = text + status_text + cause;
  return status;
}

/// The host's clock minus that of the simulation, except for its rounding at large times [s].
double DockingSim::Impl::find_lateness(double t) const {
  const double late = t - setup->t_start - find_point_time();
  const double rounding = 4e-16 * std::max(std::abs(t), std::abs(setup->t_start));
  return std::abs(late) > rounding ? late : 0.0;
}

/// Inputs and the first evaluation of a step from a state that was reached exactly.
Status DockingSim::Impl::begin_step(double h) {
  Status status = host->check_delay(h, status_text);
  if (!status.ok()) return status;
  if (host->announces()) notice_step(h);
  if (!host->steps_first()) status = receive(h);
  if (update_outside_loads(0.0)) kept_jacobian.valid = false;  // it may be a new input
  if (status.ok()) status = evaluate_start();
  if (status.ok()) status = update_command();
  if (status.ok()) status = update_hard_dock_command();
  ahead.begin_point = find_coupling_point(*model, present(), step_loop->y());
  drift = 0.0;
  if (status.ok()) step_loop->begin(h);
  return status;
}

/// Finish a successful communication step. A host that steps first may report a motion that is
/// refused. @param was_pending  did a pending step cover its start?
Status DockingSim::Impl::finish_step(double h, bool was_pending) {
  frame_shift += frame_velocity * h;
  if (model->falling) fall(h);
  const double from = find_point_time();
  if (!ahead.pending) elapsed += ahead.reached + h;
  ahead.reached = ahead.pending ? ahead.reached + h : 0.0;
  coupling.regular_step = std::max(h, kFade * coupling.regular_step);
  last_step = h;
  ++points;
  invalidate();
  put_joined_target();
  const CouplingPoint& begin = ahead.begin_point;
  CouplingPoint& end = ahead.end_point;
  if (!ahead.pending) end = find_coupling_point(*model, present(), step_loop->y());
  ahead.is_mean_due = was_pending || ahead.pending;
  if (ahead.is_mean_due) {
    ahead.mean_known = find_mean_loads(from, h);
  } else {
    update_mean_loads(h, begin, end, find_mean_loads(from, h));
    if (host->has_host()) host->update_impulse_balance(h, begin, end, step_loop->y());
  }
  if (!ahead.pending) balances->update_momentum(*model, present(), step_loop->y());
  if (host->steps_first()) {
    const Status status = receive(h);
    if (!status.ok()) return status;
  }
  advance_inputs(h);
  if (!model->inputs.empty()) read_inputs();
  if (host->announces()) {
    read_inputs();
    // In sequential mode the load of this step acts over its length, later.
    announce(parameters.coupling_mode == kSequential ? h : update_expected_step());
  }
  return {};
}

/// Mean loads over the step just made, on vehicles that are not driven. Those of the step before
/// stay where this one is too short. @param known  mean loads from outside
void DockingSim::Impl::update_mean_loads(double h, const CouplingPoint& begin,
                                         const CouplingPoint& end, const Loads& known) {
  if (h < kShortestMean) return;
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || !model->moves[i] || model->driven[i]) continue;
    const VehicleState &before = begin.vehicle[i], &after = end.vehicle[i];
    const Wrench<double> impulse =
        host->find_host_momentum(i, after) - host->find_host_momentum(i, before);
    if (model->record[i] >= 0) {  // known loads and weight have been integrated
      mean_load[i] = find_mean_load(impulse - (end.known[i] - begin.known[i]), before, after, h);
      continue;
    }
    mean_load[i] = find_mean_load(impulse, before, after, h);
    mean_load[i].f -= known.force[i];
    if (!model->falling) mean_load[i].f -= model->of_host[i].mass * known.gravity;
    mean_load[i].t -= known.torque[i];
  }
}

/// Inputs are about to change: the pending step ends at the communication point. On failure the
/// state is undefined.
Status DockingSim::Impl::settle() {
  const Status status = step_loop->settle();
  read_inputs();
  return status;
}

/// settle() between communication steps. @throws ModelError; then nothing has changed
void DockingSim::Impl::settle_for_parameters() {
  const Counters counters = step_loop->find_counters();
  keep(step_start, !pose_is_kept);
  pose_is_kept = true;
  const Status status = settle();
  ahead.is_retuned = true;
  if (status.ok()) return;
  const std::string reason = status_text.empty() ? describe(status) : status_text;
  restore(step_start);
  step_loop->set_counters(counters);
  throw ModelError("parameters cannot be changed here: " + reason);
}

/// Mean loads over the last communication step, if they have not been computed yet.
void DockingSim::Impl::update_due_mean_loads() {
  if (!ahead.is_mean_due) return;
  update_mean_loads(last_step, ahead.begin_point, ahead.end_point, ahead.mean_known);
  ahead.is_mean_due = false;
}

/// The state that is read at the communication point.
Status DockingSim::Impl::balance_point() {
  if (step_loop->is_balanced()) return {};
  const Status status = step_loop->balance_point();
  read_inputs();
  return status;
}

/// Evaluate the state at the communication point. @param may_lock  as of evaluate()
Status DockingSim::Impl::evaluate_point(bool may_lock) {
  if (!ahead.pending) return evaluate(0.0, may_lock);
  const Status status = balance_point();
  if (!status.ok()) return status;
  // With other inputs nothing is kept: they may be set back before the next reading.
  const bool is_of_step = !loads.are_sloped() && are_same(loads.at_start(), ahead.loads);
  if (is_of_step && evaluator->is_trial_kept()) return {};
  const Status found = evaluator->aside(ahead.reached, step_loop->point_y(), nullptr);
  if (is_of_step && found.ok()) evaluator->keep_trial();
  return found;
}

}  // namespace dockloop
