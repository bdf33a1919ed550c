// Inner steps that end after the communication point (README.md, "Running ahead").
#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>
#include <utility>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr int kPointsWatched = 4, kMostChanges = 1;  ///< changes of inputs at the last points
constexpr double kClockSlack = 1e-6;                 ///< of the host, per step

}  // namespace

/// Steps that pass communication points need a one-step method and no host that integrates a
/// vehicle. What acts at known times ends a step; a sequence acts at booked states only.
bool DockingSim::Impl::runs_ahead() const {
  return uses_structured_matrix() && !is_fixed_step() && !host->has_host();
}

/// May the next inner steps end after the communication point?
bool DockingSim::Impl::may_pass() const {
  return runs_ahead() && !loads.are_sloped() && !discrete.hard_dock.joint.on &&
         std::bitset<kPointsWatched>(static_cast<unsigned>(ahead.changes)).count() <= kMostChanges;
}

/// Is the pending step valid for a communication step of h too? @pre read_inputs()
bool DockingSim::Impl::can_go_on(double late, double h) const {
  const bool is_commanded = events->sequence().is_new(inputs.command) || is_hard_dock_command_new();
  return ahead.pending && !ahead.is_retuned && !is_commanded && !loads.are_sloped() && h > 0.0 &&
         std::abs(late) <= kClockSlack * h && are_same(loads.at_start(), ahead.loads);
}

/// A host that changes its inputs at every point would pay for steps that are dropped: count.
void DockingSim::Impl::note_inputs(bool goes_on) {
  if (!runs_ahead()) return;
  const bool changed = !goes_on && (ahead.is_retuned || loads.are_sloped() ||
                                    !are_same(loads.at_start(), ahead.loads));
  ahead.changes = ((ahead.changes << 1) | (changed ? 1 : 0)) & ((1 << kPointsWatched) - 1);
  ahead.is_retuned = false;
}

/// A communication step inside the pending step: no evaluation.
void DockingSim::Impl::stride(double late, double h) {
  note_inputs(true);
  ahead.reached += late;
  ahead.y_before.swap(y_inside);
  stepper->interpolate(ahead.reached + h, y_inside.data());
  is_shown = false;
  finish_step(h, true);
}

/// The evaluation just made, or about to be made, has this context.
void DockingSim::Impl::keep_context() {
  ahead.context.discrete = discrete;
  ahead.context.memory = memory;
  ahead.context.reference = present().mechanism.loops.reference;
}

/// Prepare a step that may end after the communication point: what decides its bits becomes part of
/// the state. @param is_evaluated  the start was the end of an inner step; else evaluate it
/// @pre ahead.size, ahead.last_error
Status DockingSim::Impl::begin_ahead(double tau, bool is_evaluated) {
  if (!is_evaluated) {
    keep_context();
    if (!evaluator->start_rates()) {
      evaluator->hold(quiescent_mode->find_held());
      const Status status = evaluator->at_start(tau, stepper->y());
      if (!status.ok()) return status;
    }
  }
  ahead.begin = tau;
  ahead.loads = loads.at_start();
  ahead.proposal = proposal;
  ahead.steps = find_counters().steps;
  ahead.jacobian = kept_jacobian;
  start_ahead();
  return {};
}

void DockingSim::Impl::start_ahead() {
  stepper->restart(ahead.begin, ahead.size,
                   {evaluator->start_rates(), fastest_rate, ahead.last_error});
}

/// The step just made ends after the communication point.
Status DockingSim::Impl::stay_pending(double point) {
  ahead.pending = stepper->interpolate(point, y_inside.data());
  is_shown = false;
  return ahead.pending ? Status() : find_failure(point);
}

/// Make the pending step again after its start was restored, with the same bits. @pre the counters
/// have no meaning
Status DockingSim::Impl::remake_pending() {
  const LoopReference<double> accepted = present().mechanism.loops.reference;
  Counters counters = find_counters();
  counters.steps = ahead.steps;
  set_counters(counters);
  ahead.pending = false;
  loads.hold(ahead.loads);
  accept_state();
  const auto exchange_context = [this] {
    std::swap(discrete, ahead.context.discrete);
    std::swap(memory, ahead.context.memory);
  };
  exchange_context();
  evaluator->use_reference(ahead.context.reference);
  evaluator->hold(quiescent_mode->find_held());
  Status status = evaluator->at_start(ahead.begin, stepper->y());
  exchange_context();
  evaluator->use_reference(accepted);
  if (!status.ok()) return status;
  margin_before = find_singularity_margin(model->mechanism, present().mechanism);
  proposal = ahead.proposal;
  kept_jacobian = ahead.jacobian;
  start_ahead();
  stepper->set_evaluation_limit(std::numeric_limits<std::int64_t>::max());
  status = make_inner_step(ahead.begin, ahead.begin + kFarthestAhead, true);
  if (!status.ok()) return status;
  if (!(inner.to > ahead.reached && ahead.reached >= ahead.begin)) {
    return find_failure(ahead.reached);
  }
  return stay_pending(ahead.reached);
}

/// Inputs are about to change: make the pending step again, as a step to the communication point.
/// On failure the state is undefined.
Status DockingSim::Impl::settle() {
  const double begin = ahead.begin, end = ahead.reached;
  loads.hold(ahead.loads);
  ahead.pending = false;
  ahead.reached = 0.0;
  h_warm = proposal = ahead.proposal;
  return_to(begin, std::min(proposal, end - begin));
  Status status = evaluate(begin);
  if (status.ok() && end - begin > find_clock_rounding(elapsed + end)) {
    margin_before = find_singularity_margin(model->mechanism, present().mechanism);
    status = integrate(begin, end, false, find_work_limit(end - begin));
  }
  elapsed += end;
  evaluator->forget_present();
  read_inputs();
  return status;
}

/// The same between communication steps. @throws ModelError; then nothing has changed
void DockingSim::Impl::settle_for_parameters() {
  const Counters counters = find_counters();
  keep(step_start, !pose_is_kept);
  pose_is_kept = true;
  const Status status = settle();
  ahead.is_retuned = true;
  if (status.ok()) return;
  const std::string reason = status_text.empty() ? describe(status) : status_text;
  restore(step_start);
  set_counters(counters);
  throw ModelError("parameters cannot be changed here: " + reason);
}

/// Mean loads since the last communication point, if they have not been computed yet.
Status DockingSim::Impl::calc_due_mean_loads() {
  if (!ahead.is_mean_due) return {};
  const double* now = ahead.pending ? y_inside.data() : stepper->y();
  CouplingPoint begin, end;
  Status status = calc_coupling_point(ahead.reached - last_step, ahead.y_before.data(), begin);
  if (status.ok()) status = calc_coupling_point(ahead.reached, now, end);
  if (!status.ok()) return status;
  update_mean_loads(last_step, begin, end, ahead.mean_known);
  ahead.is_mean_due = false;
  return {};
}

/// The vehicles at another time than that of the contact memory. Their motion does not depend on
/// contact.
Status DockingSim::Impl::calc_coupling_point(double tau, const double* y, CouplingPoint& point) {
  trial().touches = false;
  const Status status = evaluator->aside(tau, y, nullptr);
  trial().touches = true;
  if (status.ok()) point = find_coupling_point(*model, trial(), y);
  return status;
}

/// The state to be read inside a pending step, from that of the cubic. Where the rates differ from
/// the slope of the cubic, stiff forces are not in balance: one linearly implicit step of no
/// length, with the matrix of the pending step, restores the balance and keeps momentum.
Status DockingSim::Impl::balance_point() {
  if (is_shown || !ahead.pending) return {};
  loads.hold(ahead.loads);
  const Status status = evaluator->aside(ahead.reached, y_inside.data(), rates.data());
  read_inputs();
  if (!status.ok() || !stepper->find_slope(ahead.reached, y_shown.data())) return status;
  for (size_t i = 0; i < rates.size(); ++i) rates[i] -= y_shown[i];
  evaluator->matrix().solve(rates.data());
  for (size_t i = 0; i < rates.size(); ++i) y_shown[i] = y_inside[i] + rates[i];
  is_shown = true;
  return {};
}

/// Evaluate the state at the communication point. @param may_lock  as of evaluate()
Status DockingSim::Impl::evaluate_point(bool may_lock) {
  if (!ahead.pending) return evaluate(0.0, may_lock);
  const Status status = balance_point();
  return status.ok() ? evaluator->aside(ahead.reached, y_shown.data(), nullptr) : status;
}

}  // namespace dockloop
