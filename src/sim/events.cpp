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
  if (equations) drift = std::max(drift, equations->find_cut_gap(tau));
  const std::shared_ptr<const Coordinates> before = coordinates;
  const Status moved = update_coordinates(tau, changed);
  if (!moved.ok()) return moved;
  keep_pose();
  if (update_memory()) changed = true;
  bool jumped = false;
  const double now = elapsed + tau;
  if (events->update_first_contact(present(), now)) jumped = true;
  if (events->update_absorber(present())) jumped = true;
  if (update_latches(now)) jumped = true;
  events->update_capture(now);
  if (update_hooks(now)) jumped = true;
  if (update_table_command(now)) jumped = true;
  const Status switched = update_sequence(tau, changed, jumped);
  if (!switched.ok()) return switched;
  if (update_outside_loads(tau)) jumped = true;
  changed = changed || jumped;
  // Equal steps take equal work: a block of the mechanism that is old by an event will do.
  if (changed && (!step_loop->method().is_fixed_step() || coordinates != before))
    kept_jacobian.valid = false;
  warn_of_step_error(now);
  events->update_phases(present(), now);
  // Peaks include the forces on both sides of a jump. An absorber that does not pull is released at
  // zero force, except for rounding.
  if (!events->is_due(1) || model->contact.absorber.pulls) {
    peaks.add(now, find_peak_values(), !step_loop->searches_peaks());
  }
  peaks.enter(find_sequence_step());
  if (jumped) {
    const Status after = evaluate(tau);
    if (!after.ok()) return after;
    peaks.begin(now, find_peak_values());
  }
  watch_limits(now);
  return {};
}

/// The present pose becomes the accepted configuration: the next poses continue from it.
void DockingSim::Impl::keep_pose() {
  if (present().locked) return;
  pose_is_kept = false;
  evaluator->keep_pose();
}

/// Limits beyond which the present state is for the first time. @pre peaks of this state are added
void DockingSim::Impl::watch_limits(double now) {
  const LimitValues found =
      find_limit_values(*model, present(), peaks.peak()[Outputs::kLoadCount].value);
  limits.for_each_new(found, [&](Limit which) {
    notice_limit(which, now, found.value[which], found.limit[which],
                 which == kStopLimit ? found.part : nullptr);
  });
}

/// Record a limit, and warn of it, once. @param part  that it concerns
void DockingSim::Impl::notice_limit(Limit which, double now, double value, double limit,
                                    const std::string* part) {
  if (limits.has(which)) return;
  limits.add(which, now, value);
  warnings.push_back(describe_limit(which, setup->t_start + now, value, limit, part));
}

/// Equal steps of a linearly implicit method stay stable where they are too long to be right.
void DockingSim::Impl::warn_of_step_error(double now) {
  if (warned_step_error || !step_loop->method().is_fixed_step()) return;
  const double error = step_loop->last_error();
  constexpr double kLong = 2.0;  // of find_judged_tolerances()
  if (!(error > kLong)) return;
  warned_step_error = true;
  char text[300];
  std::snprintf(
      text, sizeof text,
      "solver.step = %.3g s is long for the motion at t = %.9g s: peak loads may be wrong "
      "without another sign; take %.2g s, or set solver.method = 12 (rosenbrock)",
      inner_step, setup->t_start + now, inner_step / std::cbrt(4.0 * error));
  warnings.push_back(text);
}

/// Near a singular pose of the independent coordinates, change to other independent coordinates.
/// All coordinates and velocities, and therefore momentum and energy, stay unchanged.
/// @param changed  set if the meaning of the state changed
Status DockingSim::Impl::update_coordinates(double tau, bool& changed) {
  if (present().locked) return {};
  const double margin = find_singularity_margin(model->mechanism, present().mechanism);
  const double least = model->mechanism.model.singularity.warning;
  const bool has_passed = has_passed_singular_pose(model->mechanism, present().mechanism);
  if (margin < least || has_passed) {
    notice_limit(kSingularLimit, elapsed + tau, has_passed ? 0.0 : margin, least);
  }
  if (margin >= kChangeMargin) {
    margin_looked_at = kChangeMargin;
    return {};
  }
  // The search is expensive: search again only after a much smaller margin.
  if (margin > kLookAgain * margin_looked_at) return {};
  margin_looked_at = margin;
  calc_leg_bodies(model->mechanism, present().mechanism);
  std::optional<Coordinates> better =
      find_better_coordinates(model->mechanism, present().mechanism);
  if (!better) return {};
  const VecX<double> q = present().mechanism.tree.q, v = present().mechanism.tree.v;
  use_coordinates(std::make_shared<const Coordinates>(std::move(*better)));
  TreeData<double>& tree = present().mechanism.tree;
  tree.q = q;
  tree.v = v;
  get_mechanism_state(*model, tree, step_loop->y());
  changed = true;
  return evaluate(tau);
}

/// Change to a choice of independent coordinates; null: the choice of the start.
void DockingSim::Impl::use_coordinates(std::shared_ptr<const Coordinates> choice) {
  pose_is_kept = false;
  if (!start_mechanism) start_mechanism = std::make_unique<Mechanism>(model->mechanism);
  const auto changed = std::make_shared<DockingModel>(*model);
  set_mechanism(*changed, choice ? with_coordinates(*start_mechanism, *choice) : *start_mechanism);
  for (int i : {kChaser, kTarget}) {
    if (changed->driven[i]) set_host_body(*changed, i, changed->of_host[i]);
  }
  use_model(changed);
  evaluator->use_coordinates(model);
  host->use_coordinates(*model);
  if (equations) equations->update_coordinates();
  attach_kernel();
  coordinates = std::move(choice);
}

/// Update the contact memory to the present state. The energy of removed bristles is dissipated.
/// @return true if the state changed
bool DockingSim::Impl::update_memory() {
  if (!has_surfaces()) return false;
  const double dropped = update_contact_memory(model->contact, present().relative, bristles(),
                                               present().contact_work, memory);
  step_loop->y()[model->layout.sums + kSumFriction] += dropped;
  return dropped > 0.0;
}

/// Without a located event, the present state decides whether the absorber acts. @pre evaluate(0).
/// @post the same
Status DockingSim::Impl::decide_absorber() {
  if (!step_loop->method().locates_events() || !events->decide_absorber(present())) return {};
  kept_jacobian.valid = false;
  return evaluate(0.0);
}

/// Rounding of the host's clock [s].
double DockingSim::Impl::find_clock_rounding(double now) const {
  return dockloop::find_clock_rounding(setup->t_start, now);
}

/// Contact thrust and disturbances that begin or end, rows of input histories. @return whether they
/// change
bool DockingSim::Impl::update_outside_loads(double tau) {
  const double now = elapsed + tau, rounding = find_clock_rounding(now);
  const bool turned = events->update_inputs(now, rounding);
  const bool disturbed = events->update_disturbances(now, rounding);
  if (turned) read_tables(tau);
  if (turned || disturbed) loads.add(events->find_disturbing_loads());
  return events->update_thrust(now, rounding) || disturbed || turned;
}

bool DockingSim::Impl::update_latches(double now) {
  return events->update_latches(present(), now, step_loop->y()[model->layout.sums + kSumLatches]);
}

/// Steps of the sequence that are due at the present state. @pre evaluate(tau)
/// @param changed  set if the integrator must restart. @param jumped  set if forces have changed
Status DockingSim::Impl::update_sequence(double tau, bool& changed, bool& jumped) {
  if (!events->sequence().exists()) return {};
  const double now = elapsed + tau;
  double* const sums = step_loop->y() + model->layout.sums;
  for (;;) {
    const SequenceChange made =
        events->update_sequence(present(), now, find_clock_rounding(now), sums);
    if (made.chatters) {
      const Status status{StatusCode::kSequenceChatters, -1, 0.0, now};
      status_text = describe(status);  // names steps that a restored state does not know
      return status;
    }
    if (made.timed_out > 0.0) notice_limit(kTimeOutLimit, now, made.timed_out, made.timed_out);
    changed = changed || made.events;
    jumped = jumped || made.equations;
    if (!made.step) return {};
    events->update_capture(now);
    if (!made.equations) continue;
    update_hooks(now);
    peaks.enter(find_sequence_step());  // in which the loads are evaluated anew
    Status status = evaluate(tau);
    if (status.ok()) status = update_joint(tau);
    if (!status.ok()) return status;
  }
}

/// A command of the host that differs from the last one. @pre evaluate(0). @post the same
Status DockingSim::Impl::update_command() {
  if (!events->sequence().update_command(inputs.command, elapsed)) return {};
  bool changed = false, jumped = false;
  kept_jacobian.valid = false;
  const Status status = update_sequence(0.0, changed, jumped);
  if (!status.ok()) return status;
  peaks.enter(find_sequence_step());
  update_outside_loads(0.0);
  events->update_phases(present(), elapsed);
  return evaluate_start();
}

/// The same of a table, at any accepted state.
bool DockingSim::Impl::update_table_command(double now) {
  for (const InputHistory& history : model->inputs) {
    if (history.kind != InputKind::kCommand) continue;
    const int row = find_row(history, now + find_clock_rounding(now));
    inputs.command = static_cast<int>(find_line(history, row, now).value);
    return events->sequence().update_command(inputs.command, now);
  }
  return false;
}

/// Evaluate the state of the integrator, tau after the last communication point.
/// @param may_lock  as one body with the chaser, if the mechanism is quiescent
Status DockingSim::Impl::evaluate(double tau, bool may_lock) {
  return quiescent_mode->evaluate(tau, step_loop->y(), may_lock);
}

/// evaluate_point(), unless a free drift has just evaluated this state.
Status DockingSim::Impl::evaluate_present() {
  if (evaluator->is_present_kept() && quiescent_mode->is_in_effect()) return {};
  return evaluate_point();
}

/// The same at the start of a communication step, with the rates for methods that begin with them.
Status DockingSim::Impl::evaluate_start() {
  evaluator->forget();
  if (quiescent.on || !step_loop->method().begins_with_rates()) return evaluate_present();
  evaluator->hold(quiescent_mode->find_held());
  return evaluator->at(0.0, step_loop->y(), Evaluator::Rates::kNew);
}

}  // namespace dockloop
