// Inner steps that end after the communication point (README.md, "Running ahead").
#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>
#include <utility>

#include "math/dock_assert.hpp"
#include "sim/host_coupling.hpp"
#include "sim/step_loop.hpp"

namespace dockloop {
namespace {

constexpr int kPointsWatched = 4, kMostChanges = 1;  ///< changes of inputs at the last points
constexpr double kClockSlack = 1e-6;                 ///< of the host, per step

}  // namespace

/// May the next inner steps end after the communication point?
bool StepLoop::may_pass() const {
  return method_.runs_ahead && !loads_.are_sloped() && !state_.discrete.hard_dock.joint.on &&
         std::bitset<kPointsWatched>(static_cast<unsigned>(ahead_.changes)).count() <= kMostChanges;
}

bool StepLoop::can_go_on(double late, double h) const {
  return ahead_.pending && !ahead_.is_retuned && !loads_.are_sloped() && h > 0.0 &&
         std::abs(late) <= kClockSlack * h && are_same(loads_.at_start(), ahead_.loads);
}

void StepLoop::note_inputs(bool goes_on) {
  if (!method_.runs_ahead) return;
  const bool changed = !goes_on && (ahead_.is_retuned || loads_.are_sloped() ||
                                    !are_same(loads_.at_start(), ahead_.loads));
  ahead_.changes = ((ahead_.changes << 1) | (changed ? 1 : 0)) & ((1 << kPointsWatched) - 1);
  ahead_.is_retuned = false;
}

bool StepLoop::stride(double late, double h) {
  DOCK_ASSERT(is_pending() && covers(late, h));
  const CouplingPoint begin = ahead_.end_point;
  if (!show_point(ahead_.reached + late + h)) return false;
  ahead_.begin_point = begin;
  note_inputs(true);
  ahead_.reached += late;
  return true;
}

/// The evaluation just made, or about to be made, has this context.
void StepLoop::keep_context() {
  ahead_.context.discrete = state_.discrete;
  ahead_.context.memory = state_.memory;
  ahead_.context.reference = present().mechanism.loops.reference;
}

/// Prepare a step that may end after the communication point: what decides its bits becomes part of
/// the state. @param h  of the communication step. @param is_evaluated  the start was the end of an
/// inner step; else evaluate it
/// @pre ahead_.size, ahead_.last_error
Status StepLoop::begin_ahead(double tau, double h, bool is_evaluated) {
  if (!is_evaluated) {
    keep_context();
    if (!evaluator_.start_rates()) {
      evaluator_.hold(quiescent_mode_.find_held());
      const Status status = evaluator_.at(tau, y(), Evaluator::Rates::kNew);
      if (!status.ok()) return status;
    }
  }
  ahead_.begin = tau;
  ahead_.farthest = tau + kFarthestAhead * h;
  ahead_.loads = loads_.at_start();
  ahead_.proposal = proposal_;
  ahead_.pace = state_.pace;
  ahead_.steps = find_counters().steps;
  ahead_.jacobian = kept_;
  start_ahead();
  return {};
}

void StepLoop::start_ahead() {
  stepper_->restart(ahead_.begin, ahead_.size,
                    {evaluator_.start_rates(), ahead_.pace, ahead_.last_error});
}

/// May the state at t inside the step just made be read? Stiff forces (bristles in explicit steps,
/// contact and drives at loose tolerances) settle faster than a long step, whose polynomial then
/// swings: energy inside it is not that at its ends. @pre evaluation at the end, inner_.energy
/// @post if so, t is the communication point: y_inside_, y_shown_, the trial state, end_point
bool StepLoop::show_point(double t) {
  hide_point();
  if (!stepper_->interpolate(t, y_inside_.data()) || !balance(t).ok()) return false;
  if (!evaluator_.aside(t, y_shown_.data(), nullptr).ok()) return false;
  const EnergyBalance found = balances_.find_energy(*model_, evaluator_.trial(), y_shown_.data());
  if (!balances_.is_good_inside(found, inner_.energy)) return false;
  ahead_.end_point = find_coupling_point(*model_, evaluator_.trial(), y_shown_.data());
  evaluator_.keep_trial();
  is_shown_ = true;
  return true;
}

/// The communication point has moved.
void StepLoop::hide_point() {
  is_shown_ = false;
  evaluator_.forget_trial();
}

/// The step just made ends after the communication point.
Status StepLoop::stay_pending(double point) {
  ahead_.pending = is_shown_ || stepper_->interpolate(point, y_inside_.data());
  return ahead_.pending ? Status() : find_failure(point);
}

Status StepLoop::remake_pending() {
  DOCK_ASSERT(is_pending());
  accepted_pose_ = present().mechanism.loops.reference;
  Counters counters = find_counters();
  counters.steps = ahead_.steps;
  set_counters(counters);
  ahead_.pending = false;
  loads_.hold(ahead_.loads);
  accept_state();
  const auto exchange_context = [this] {
    std::swap(state_.discrete, ahead_.context.discrete);
    std::swap(state_.memory, ahead_.context.memory);
  };
  exchange_context();
  evaluator_.use_reference(ahead_.context.reference);
  evaluator_.hold(quiescent_mode_.find_held());
  evaluator_.forget();
  Status status = evaluator_.at(ahead_.begin, y(), Evaluator::Rates::kNew);
  exchange_context();
  evaluator_.use_reference(accepted_pose_);
  if (!status.ok()) return status;
  margin_before_ = find_margin();
  proposal_ = ahead_.proposal;
  state_.pace = ahead_.pace;
  kept_ = ahead_.jacobian;
  start_ahead();
  stepper_->set_evaluation_limit(std::numeric_limits<std::int64_t>::max());
  status = make_inner_step(ahead_.begin, ahead_.farthest, true);
  if (!status.ok()) return status;
  if (!(inner_.to > ahead_.reached && ahead_.reached >= ahead_.begin)) {
    return find_failure(ahead_.reached);
  }
  return stay_pending(ahead_.reached);
}

Status StepLoop::settle() {
  DOCK_ASSERT(is_pending());
  const double begin = ahead_.begin, end = ahead_.reached;
  loads_.hold(ahead_.loads);
  ahead_.pending = false;
  ahead_.reached = 0.0;
  state_.h_warm = proposal_ = ahead_.proposal;
  state_.pace = ahead_.pace;
  return_to(begin, std::min(proposal_, end - begin));
  Status status = quiescent_mode_.evaluate(begin, y());
  if (status.ok() && end - begin > find_clock_rounding(t_start_, state_.elapsed + end)) {
    margin_before_ = find_margin();
    status = integrate(begin, end, false, find_work_limit(end - begin));
  }
  state_.elapsed += end;
  evaluator_.forget_present();
  return status;
}

/// The state to be read at t inside the step just made, from the polynomial of the method. Linearly
/// implicit steps are long where forces are stiff: where the rates differ from the slope of
/// the polynomial, these forces are not in balance. One linearly implicit step of no length, with
/// the matrix of the step just made, restores the balance and keeps momentum. @post y_shown_
Status StepLoop::balance(double t) {
  y_shown_ = y_inside_;
  if (!method_.has_matrix() || !stepper_->find_slope(t, slope_.data())) return {};
  const Status status = evaluator_.aside(t, y_inside_.data(), scratch_.data());
  if (!status.ok()) return status;
  for (size_t i = 0; i < scratch_.size(); ++i) scratch_[i] -= slope_[i];
  evaluator_.matrix().solve(scratch_.data());
  for (size_t i = 0; i < scratch_.size(); ++i) y_shown_[i] += scratch_[i];
  return {};
}

Status StepLoop::balance_point() {
  if (is_balanced()) return {};
  if (method_.has_matrix()) loads_.hold(ahead_.loads);
  const Status status = balance(ahead_.reached);
  is_shown_ = status.ok();
  return status;
}

}  // namespace dockloop
