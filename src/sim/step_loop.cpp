// Inner steps; see step_loop.hpp.
#include "sim/step_loop.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "math/dock_assert.hpp"
#include "sim/outputs.hpp"

namespace dockloop {
namespace {

constexpr int kMaxRefused = 12;  ///< consecutive end states that cannot be evaluated

// A refusal must not take minutes. Time until a refusal on a slow processor [s]:
#ifndef DOCKLOOP_REFUSAL_TIME  // shorter for the fuzzers
#define DOCKLOOP_REFUSAL_TIME 0.5
#endif
constexpr double kRefusalTime = DOCKLOOP_REFUSAL_TIME, kRefusalTimePerSecond = 4.0;
constexpr double kLongestRefusal = 1.25;  // 2 s on the slowest processor that was measured

}  // namespace

StepLoop::StepLoop(const DockingModel& model, const RunMethod& method, const Parts& parts,
                   const RatedLoads& rated, double t_start, Accept accept)
    : model_(&model),
      method_(method),
      state_(parts.state),
      ahead_(parts.state.ahead),
      kept_(parts.state.kept_jacobian),
      loads_(parts.loads),
      events_(parts.events),
      evaluator_(parts.evaluator),
      quiescent_mode_(parts.quiescent_mode),
      balances_(parts.balances),
      status_text_(parts.status_text),
      rated_(rated),
      t_start_(t_start),
      accept_(std::move(accept)),
      y_accepted_(static_cast<size_t>(model.layout.size), 0.0),
      y_inside_(y_accepted_),
      y_shown_(y_accepted_),
      scratch_(y_accepted_),
      slope_(y_accepted_) {
  Stepper::Problem problem = make_problem();
  if (method_.equations) method_.equations->enter(problem);
  stepper_ = std::make_unique<Stepper>(std::move(problem), find_stepper_method(method_));
}

void StepLoop::set_tolerances(double rtol, const std::vector<double>& atol) {
  stepper_->set_tolerances(rtol, atol.data());
}

void StepLoop::start() {
  ahead_.loads = ahead_.mean_known = loads_.at_start();
  if (!method_.runs_ahead) return;
  ahead_.jacobian = kept_;
  reserve(ahead_.context.memory, state_.memory, model_->contact);
  keep_context();
  accepted_pose_ = ahead_.context.reference;
}

Status StepLoop::advance(double h, std::int64_t limit, bool was_pending) {
  DOCK_ASSERT(h > 0.0);
  if (was_pending) ahead_.begin_point = ahead_.end_point;
  const Status status = method_.is_fixed_step()
                            ? integrate_fixed(h, limit)
                            : integrate(ahead_.begin, ahead_.reached + h, may_pass(), limit);
  if (method_.runs_ahead && !is_pending()) ahead_.loads = loads_.at_start();
  return status;
}

Counters StepLoop::find_counters() const {
  return {counted_elsewhere_.steps + stepper_->steps(),
          counted_elsewhere_.rejected_steps + stepper_->rejected_steps(),
          counted_elsewhere_.rate_evaluations + evaluator_.counted() + stepper_->rate_evaluations(),
          counted_elsewhere_.left_out};
}

void StepLoop::set_counters(const Counters& wanted) {
  const Counters here = find_counters();
  counted_elsewhere_.steps += wanted.steps - here.steps;
  counted_elsewhere_.rejected_steps += wanted.rejected_steps - here.rejected_steps;
  counted_elsewhere_.rate_evaluations += wanted.rate_evaluations - here.rate_evaluations;
  counted_elsewhere_.left_out = wanted.left_out;
}

bool StepLoop::is_at_accepted_state() const {
  return std::equal(y_accepted_.begin(), y_accepted_.end(), y());
}

double StepLoop::find_margin() const {
  return find_singularity_margin(model_->mechanism, present().mechanism);
}

/// Upper bound of the time of one evaluation on a slow processor [s]. The bound is estimated from
/// the model, not measured, because a step must be refused after the same work on every machine.
double StepLoop::find_evaluation_cost() const {
  constexpr double kBasic = 6e-6, kPerBody = 0.6e-6, kPerLegBody = 0.1e-6, kPerBristle = 3e-9;
  const LoopPlan& plan = model_->mechanism.plan;
  const double tree = kPerBody * static_cast<double>(plan.tree_bodies.size());
  const double legs = static_cast<double>(plan.leg_bodies.size());
  const double mechanism = tree + (method_.equations ? kPerBody : kPerLegBody) * legs;
  return (method_.equations ? 4.0 : 1.0) * (kBasic + mechanism) +
         kPerBristle * model_->layout.bristle_count +
         kPerLegBody * static_cast<double>(model_->mechanism.model.elements.size());
}

/// Cost of an implicit step without its evaluations, in evaluations: the factorisation of a matrix,
/// the largest cost for many states.
double StepLoop::find_factor_cost() const {
  constexpr double kStructured = 1.2;  // build, factorise, solve six times; measured
  if (method_.has_matrix()) return kStructured;
  if (!method_.needs_jacobian() && !method_.equations) return 0.0;
  constexpr double kPerEntry = 0.5e-9;  // [s], on a slow processor
  const double n = method_.equations ? method_.equations->size() : model_->layout.size;
  return kPerEntry * n * n * n / 3.0 / find_evaluation_cost();
}

/// A minimum number of steps is allowed for models with expensive steps.
std::int64_t StepLoop::find_work_limit(double h) const {
  if (method_.is_reference()) return std::numeric_limits<std::int64_t>::max();
  constexpr double kLeastSteps = 200.0, kEvaluationsPerStep = 10.0;
  const double time = std::min(kRefusalTime + kRefusalTimePerSecond * h, kLongestRefusal);
  const double factor = find_factor_cost(), derivatives = factor > 0.0 ? find_jacobian_cost() : 0.0;
  return static_cast<std::int64_t>(std::max(
      time / find_evaluation_cost(), kLeastSteps * (kEvaluationsPerStep + derivatives + factor)));
}

std::int64_t StepLoop::find_work() const {
  const Counters made = find_counters();
  const double steps = static_cast<double>(made.steps + made.rejected_steps);
  return made.rate_evaluations + static_cast<std::int64_t>(find_factor_cost() * steps);
}

Status StepLoop::refuse_work(double h, std::int64_t limit, double tau) {
  char text[400];
  std::snprintf(
      text, sizeof text,
      "after t = %.9g s the step needs more than %.3g evaluations, the limit for a step of %.6g s "
      "of this model: shorten the step, or check speeds, spins, contact.friction_speed, stiffness "
      "and damping of contact and legs",
      t_start_ + state_.elapsed + tau, static_cast<double>(limit), h);
  status_text_ = text;
  return {StatusCode::kIntegrationFailed, -1, 0.0, state_.elapsed + tau};
}

/// Start the integrator (again) from its state. @param known_rates  there, or null
void StepLoop::start_stepper(double tau, double h, const double* known_rates) {
  stepper_->restart(tau, h, {known_rates, state_.pace});
}

void StepLoop::begin(double h) {
  if (method_.is_fixed_step()) return;
  const bool is_good = method_.needs_jacobian() && kept_.valid &&
                       find_counters().steps - kept_.step < kJacobianSteps;
  const double* known = is_good ? kept_.entries.data() : nullptr;
  accept_state();
  margin_before_ = find_margin();
  proposal_ = state_.h_warm;
  ahead_.begin = 0.0;
  stepper_->restart(0.0, std::min(proposal_, h),
                    {evaluator_.start_rates(), state_.pace, 1.0, known});
}

void StepLoop::accept_state() { std::copy(y(), y() + model_->layout.size, y_accepted_.begin()); }

/// Back to the last accepted state, from which the integrator starts again.
void StepLoop::return_to(double tau, double h) {
  std::copy(y_accepted_.begin(), y_accepted_.end(), y());
  start_stepper(tau, h);
}

/// A step of the solver, which stores its last evaluation.
StepOutcome StepLoop::make_solver_step(double stop, bool watch_roots) {
  evaluator_.begin_inner_step();
  return stepper_->step(stop, watch_roots);
}

/// Make an inner step. Only the solver has advanced; nothing is recorded yet.
/// @param end  it ends there at the latest. @param is_single  it is one step of the solver, which
/// knows the states inside. @post inner; outcome kFailed: no step, else the end is no good
Status StepLoop::make_inner_step(double tau, double end, bool is_single) {
  hide_point();
  last_failure_ = Status();
  inner_.from = tau;
  inner_.is_one = true;
  inner_.outcome = make_solver_step(find_next_stop(tau, end), true);
  if (inner_.outcome == StepOutcome::kFailed) return find_failure(tau);
  inner_.to = stepper_->time();
  if (inner_.outcome == StepOutcome::kRoot) {
    const Status status = step_to_root(tau, is_single);
    if (!status.ok()) inner_.outcome = StepOutcome::kFailed;
    if (!status.ok()) return status;
    inner_.to = stepper_->time();
  } else {
    events_.clear_due();
    const bool cut_short =
        inner_.outcome == StepOutcome::kStopped && inner_.to - inner_.from < proposal_;
    proposal_ = cut_short ? std::max(proposal_, stepper_->next_step()) : stepper_->next_step();
  }
  state_.pace = stepper_->pace();
  const Status status = evaluator_.at(
      inner_.to, y(), is_single ? Evaluator::Rates::kCounted : Evaluator::Rates::kNone);
  if (!status.ok()) return status;
  inner_.energy = balances_.find_energy(*model_, present(), y());
  if (!balances_.is_energy_created(inner_.energy, inner_.to)) return {};
  return {StatusCode::kIntegrationFailed, -1, 0.0, state_.elapsed + inner_.to};
}

/// An inner step of this length is about to be booked. @pre evaluation at its end
void StepLoop::count_left_out(double length) {
  LeftOut& left = counted_elsewhere_.left_out;
  ++left.booked_steps;
  for (const NeighbourList& list : state_.memory.lists) {
    left.near_pairs += static_cast<std::int64_t>(list.near.size());
  }
  if (state_.discrete.hard_dock.joint.on) {
    left.joined_time += length;
  } else if (state_.discrete.contacted) {
    left.time_since_contact += length;
  }
}

/// The inner step becomes part of the run. @param changed  set if the integrator must restart
Status StepLoop::book_inner_step(bool& changed) {
  count_left_out(inner_.to - inner_.from);
  if (searches_peaks() && inner_.is_one) search_peaks(inner_.from, inner_.to);
  balances_.update_energy(inner_.energy, inner_.to);
  changed = inner_.outcome == StepOutcome::kRoot;
  const Status status = accept_(inner_.to, changed);
  accept_state();
  return status;
}

/// Free drift of a quiescent mechanism, to `end` at the latest. @post tau, evaluation
Status StepLoop::drift_freely(double& tau, double end, std::int64_t& turns) {
  const double stop = state_.discrete.hard_dock.joint.on ? find_next_stop(tau, end) : end;
  const double duration = std::min(quiescent_mode_.find_drift_time(), stop - tau);
  LeftOut& left = counted_elsewhere_.left_out;
  (state_.discrete.hard_dock.joint.on ? left.joined_time : left.quiescent_time) += duration;
  turns += quiescent_mode_.drift(duration, y());
  evaluator_.forget();
  tau = duration < end - tau ? tau + duration : end;
  events_.clear_due();
  bool changed = false;
  const unsigned origins = state_.memory.origins;
  Status status = quiescent_mode_.evaluate(tau, y());
  if (status.ok()) status = accept_(tau, changed);
  if (!status.ok()) return status;
  accept_state();
  // Another evaluation gives a better gap only with a new neighbour list.
  if (!changed && state_.memory.origins == origins) evaluator_.keep_present();
  return {};
}

/// Advance from tau to `end`, through events. On failure the state is undefined.
/// @param passes  the last inner step may end after `end`; it is then pending. The loop sets it to
/// false when it must end at `end` after all
/// @pre evaluation and start of the integrator at tau, or a pending step
Status StepLoop::integrate(double tau, double end, bool passes, std::int64_t limit) {
  const double asked = end - ahead_.reached;
  hide_point();
  const std::int64_t begun = find_work();
  stepper_->set_evaluation_limit(limit);
  // The pending inner step of the last call is made already: book it, make no other one.
  bool is_made = std::exchange(ahead_.pending, false);
  // The rates at tau are those of the last booked inner step: a step ahead need not evaluate them.
  bool is_evaluated = false;
  int refused = 0;  // consecutive end states that could not be evaluated
  const auto ask_for_proposal = [this] {
    ahead_.size = proposal_;
    ahead_.last_error = 1.0;
  };
  if (!is_made) ask_for_proposal();
  for (std::int64_t turns = 0; find_work() - begun + turns < limit;) {
    if (is_interrupted()) return {StatusCode::kInterrupted, -1, 0.0, state_.elapsed + tau};
    Status status;
    if (!is_made) {
      status_text_.clear();  // of an attempt that was refused and repeated
      status = quiescent_mode_.update(tau, y());
      if (!status.ok()) return status;
      if (state_.quiescent.on) {
        status = drift_freely(tau, end, turns);
        if (!status.ok() || tau >= end) return status;
        start_stepper(tau, std::min(proposal_, end - tau));
        is_evaluated = false;
        ask_for_proposal();
        continue;
      }
      // A rigid joint, or slopes of an input, may begin inside this communication step.
      if (passes && (state_.discrete.hard_dock.joint.on || loads_.are_sloped())) {
        passes = false;
        return_to(tau, std::min(proposal_, end - tau));
      }
      if (passes) status = begin_ahead(tau, asked, is_evaluated);
      if (!status.ok()) return status;
      status = make_inner_step(tau, passes ? ahead_.farthest : end, passes);
      if (passes && (!status.ok() || (inner_.to > end && !show_point(end)))) {
        passes = false;  // no failure of this communication step: make it without a step ahead
        state_.pace = ahead_.pace;
        return_to(tau, std::min(proposal_, end - tau));
        status = quiescent_mode_.evaluate(tau, y());
        if (!status.ok()) return status;
        continue;
      }
      if (inner_.outcome == StepOutcome::kFailed) {
        return stepper_->is_exhausted() ? refuse_work(asked, limit, tau) : status;
      }
      if (!status.ok()) {
        // Error control accepted a state that cannot be evaluated or that creates energy: make
        // smaller steps.
        if (++refused > kMaxRefused) return status;
        proposal_ = 0.25 * (inner_.to - inner_.from);
        return_to(tau, proposal_);
        continue;
      }
      refused = 0;
    }
    is_made = false;
    if (inner_.to > end) return stay_pending(end);
    bool changed = false;
    if (passes) keep_context();
    status = book_inner_step(changed);
    if (!status.ok()) return status;
    tau = inner_.to;
    if (tau >= end) {
      state_.h_warm = proposal_;
      return {};
    }
    const double size = update_singularity_step(tau - inner_.from);
    if (passes) {
      balances_.update_momentum(*model_, present(), y());
      is_evaluated = !changed;
      if (changed) evaluator_.forget();
      ahead_.size = size > 0.0 ? size : proposal_;
      ahead_.last_error = changed || size > 0.0 ? 1.0 : stepper_->last_error();
    } else if (size > 0.0) {
      start_stepper(tau, std::min(size, end - tau));
    } else if (changed) {
      start_stepper(tau, std::min(proposal_, end - tau));
    }
  }
  return refuse_work(asked, limit, tau);
}

/// The same with a number of inner steps that depends on h only: equal steps of a Runge-Kutta
/// method, events detected at their ends. The cost is bounded; errors are not controlled.
/// @pre evaluation at tau = 0
Status StepLoop::integrate_fixed(double h, std::int64_t limit) {
  const double wanted = std::ceil(h / state_.inner_step * (1.0 - 1e-9));
  constexpr double kRk4 = 4.0, kRosenbrock = 8.0;  // evaluations
  const double each = method_.is_structured ? kRosenbrock : kRk4;
  if (wanted * each > static_cast<double>(limit)) {
    char text[200];
    std::snprintf(
        text, sizeof text,
        "the step needs %.6g inner steps of solver.step = %.6g s, but the limit is %.6g: shorten "
        "the step or increase solver.step",
        wanted, state_.inner_step, std::floor(static_cast<double>(limit) / each));
    status_text_ = text;
    return {StatusCode::kIntegrationFailed, -1, 0.0, state_.elapsed};
  }
  const int count = std::max(1, static_cast<int>(wanted));
  kept_.valid = false;  // made anew at the same places in every communication step
  double tau = 0.0;
  for (int k = 1; k <= count;) {
    if (is_interrupted()) return {StatusCode::kInterrupted, -1, 0.0, state_.elapsed + tau};
    double end = k == count ? h : h * k / count;
    const double next = events_.find_next_input() - state_.elapsed;
    if (next > tau && next < end) {
      end = next;  // of an input: an additional step
    } else {
      ++k;
    }
    last_failure_ = Status();
    events_.note_latches(present());
    start_stepper(tau, end - tau, tau == 0.0 ? evaluator_.start_rates() : nullptr);
    if (make_solver_step(end, false) == StepOutcome::kFailed) return find_failure(tau);
    const double made = end - tau;
    tau = end;
    Status status = evaluator_.at(tau, y());
    if (!status.ok()) return status;
    const EnergyBalance audit = balances_.find_energy(*model_, present(), y());
    if (balances_.is_energy_created(audit, tau))
      return {StatusCode::kIntegrationFailed, -1, 0.0, state_.elapsed + tau};
    balances_.update_energy(audit, tau);
    count_left_out(made);
    events_.set_due_below(present(), 0.0);
    events_.find_passed_latches(present(), made);
    bool changed = false;
    status = accept_(tau, changed);
    events_.clear_passed();
    if (!status.ok()) return status;
  }
  return {};
}

/// Loads near their peaks: evaluate the middle of the step, then where they may be largest.
/// @pre evaluation at `to`
void StepLoop::search_peaks(double from, double to) {
  const double share = std::max(1e-2 * method_.rtol, 1e-10);  // of a peak, worth an evaluation
  auto& peaks = state_.peaks;
  const auto end = find_searched_peaks(*model_, rated_, present());
  if (!peaks.is_near(end) && !peaks.is_near(peaks.value(peaks.count() - 1))) return;
  std::array<double, kPeakCount> value;
  const auto evaluate = [&](double t) {
    if (!stepper_->interpolate(t, scratch_.data())) return false;
    evaluator_.count(1);
    if (!evaluator_.aside(t, scratch_.data(), nullptr).ok()) return false;
    value = find_peak_values(*model_, rated_, evaluator_.trial());
    const EnergyBalance found = balances_.find_energy(*model_, evaluator_.trial(), scratch_.data());
    return balances_.is_good_inside(found, inner_.energy);
  };
  const double middle = 0.5 * (from + to);
  if (!evaluate(middle)) return;
  PeakSearch<kPeakCount, kFirstLegPeak> search(peaks, state_.elapsed + from, state_.elapsed + to);
  const bool lacks_begin = search.lacks_begin();
  search.add(state_.elapsed + middle, value);
  search.add(state_.elapsed + to, end);
  peaks.add(state_.elapsed + middle, value, false);
  if (lacks_begin && evaluate(from)) search.add(state_.elapsed + from, value);
  while (!search.is_full()) {
    const std::optional<double> t = search.find_time(share);
    if (!t || !evaluate(*t - state_.elapsed)) break;
    search.add(*t, value);
    peaks.raise(*t, value);
  }
}

/// Step over a singularity. A mechanism can be evaluated on both sides of a singular pose, but not
/// in the pose. Size of a step without a stage in the pose, or of a step to the start of such a
/// step. Updates the margin of the last step. @param made  size of the last step
/// @return 0 if no singular pose is ahead
double StepLoop::update_singularity_step(double made) {
  const double margin = find_margin();
  const double rate = (margin_before_ - margin) / made;
  margin_before_ = margin;
  if (!(rate > 0.0) || margin > 3.0 * kChangeMargin) return 0.0;
  const double distance = margin / rate;  // to the pose, with the present rate of the margin
  const double width = model_->mechanism.model.singularity.error / rate;
  if (distance - width > 1.3 * proposal_) return 0.0;
  // If the step over the pose is too long for the error control, end half a step before the pose.
  const double size = Stepper::find_size_across(distance);
  return size <= 1.6 * proposal_ ? size : distance - 0.5 * proposal_;
}

/// Where the next inner step must end at the latest: the end of the communication step, the onset
/// of thrust or of another load, a known time of the sequence, an end of a ramp, and the bound that
/// prevents surfaces from passing through each other unseen.
double StepLoop::find_next_stop(double tau, double end) const {
  const double now = state_.elapsed + tau;
  double stop = end;
  const auto stop_at = [&](double time) {
    if (time - state_.elapsed > tau) stop = std::min(stop, time - state_.elapsed);
  };
  const std::optional<double> onset = events_.find_thrust_onset();
  if (onset && !state_.discrete.thrust_on) stop_at(*onset);
  stop_at(events_.sequence().find_next_time(now));
  stop_at(find_next_failure(model_->mechanism.model.failures, state_.discrete.entered.data(), now));
  stop_at(events_.find_next_disturbance(now));
  stop_at(events_.find_next_input());
  if (const auto ramp = find_next_ramp(model_->hard_dock, state_.discrete.hard_dock, now))
    stop_at(*ramp);
  if (events_.has_surfaces() && model_->contact.has_surfaces() &&
      !state_.discrete.hard_dock.joint.on) {
    const double bound =
        find_step_bound(model_->contact, present().contact.gap, present().relative);
    if (tau + bound < stop) stop = tau + bound;
  }
  return stop;
}

Status StepLoop::find_failure(double tau) const {
  if (!last_failure_.ok()) return last_failure_;
  return {StatusCode::kIntegrationFailed, -1, 0.0, state_.elapsed + tau};
}

/// A root lies in the step just made: replace its interpolated state by steps that end there.
/// @param is_single  one step; if it ends earlier, the next inner step finds the root again
Status StepLoop::step_to_root(double tau, bool is_single) {
  const double root = stepper_->time();
  for (int i = 0; i < events_.root_count(); ++i) events_.set_due(i, stepper_->root_found(i));
  std::copy(y_accepted_.begin(), y_accepted_.end(), y());
  inner_.is_one = root > tau;
  if (!inner_.is_one) return {};
  start_stepper(tau, root - tau);
  for (;; inner_.is_one = false) {  // ends with the limit of evaluations
    const StepOutcome outcome = make_solver_step(root, false);
    if (outcome == StepOutcome::kFailed) return find_failure(tau);
    if (outcome == StepOutcome::kStopped) return {};
    if (!is_single) continue;
    events_.clear_due();
    inner_.outcome = outcome;
    proposal_ = stepper_->next_step();
    return {};
  }
}

}  // namespace dockloop
