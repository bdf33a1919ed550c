// Communication steps: inputs, integration through events, refused steps, audits.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kLongestStep = 1e9;  ///< [s]
constexpr double kFade = 0.7;         ///< per step, of the regular step after a long step
constexpr int kMaxRefused = 12;       ///< consecutive end states that cannot be evaluated

// A refusal must not take minutes. Time until a refusal on a slow processor [s]:
#ifndef DOCKLOOP_REFUSAL_TIME  // shorter for the fuzzers
#define DOCKLOOP_REFUSAL_TIME 0.5
#endif
constexpr double kRefusalTime = DOCKLOOP_REFUSAL_TIME, kRefusalTimePerSecond = 5.0;
constexpr double kLongestRefusal = 60.0;

}  // namespace

/// Upper bound of the time of one evaluation on a slow processor [s]. The bound is estimated from
/// the model, not measured, because a step must be refused after the same work on every machine.
double DockingSim::Impl::find_evaluation_cost() const {
  constexpr double kBasic = 3e-6, kPerBody = 0.6e-6, kPerLegBody = 0.1e-6, kPerBristle = 3e-9;
  const LoopPlan& plan = model->mechanism.plan;
  const double tree = kPerBody * static_cast<double>(plan.tree_bodies.size());
  const double legs = static_cast<double>(plan.leg_bodies.size());
  const double mechanism = tree + (unreduced ? kPerBody : kPerLegBody) * legs;
  return (unreduced ? 4.0 : 1.0) * (kBasic + mechanism) +
         kPerBristle * model->layout.bristle_count +
         kPerLegBody * static_cast<double>(model->mechanism.model.elements.size());
}

/// Cost of an implicit step without its evaluations, in evaluations: the factorisation of a matrix,
/// the largest cost for many states.
double DockingSim::Impl::find_factor_cost() const {
  constexpr double kStructured = 1.2;  // build, factorise, solve six times; measured
  if (uses_structured_matrix()) return kStructured;
  if (!needs_jacobian() && !unreduced) return 0.0;
  constexpr double kPerEntry = 0.5e-9;  // [s], on a slow processor
  const double n = unreduced ? unreduced->size() : model->layout.size;
  return kPerEntry * n * n * n / 3.0 / find_evaluation_cost();
}

/// Work after which a communication step is refused, in evaluations. A minimum number of steps is
/// allowed for models with expensive steps.
std::int64_t DockingSim::Impl::find_work_limit(double h) const {
  if (adapt_problem) return std::numeric_limits<std::int64_t>::max();  // reference solution
  constexpr double kLeastSteps = 200.0, kEvaluationsPerStep = 10.0;
  const double time = std::min(kRefusalTime + kRefusalTimePerSecond * h, kLongestRefusal);
  const double factor = find_factor_cost(), derivatives = factor > 0.0 ? find_jacobian_cost() : 0.0;
  return static_cast<std::int64_t>(std::max(
      time / find_evaluation_cost(), kLeastSteps * (kEvaluationsPerStep + derivatives + factor)));
}

/// Work since the start, in evaluations.
std::int64_t DockingSim::Impl::find_work() const {
  const Counters made = find_counters();
  const double steps = static_cast<double>(made.steps + made.rejected_steps);
  return made.rate_evaluations + static_cast<std::int64_t>(find_factor_cost() * steps);
}

Status DockingSim::Impl::refuse_work(double h, std::int64_t limit, double tau) {
  char text[400];
  std::snprintf(
      text, sizeof text,
      "after t = %.9g s the step needs more than %.3g evaluations, the limit for a step of %.6g s "
      "of this model: shorten the step, or check speeds, spins, contact.friction_speed, stiffness "
      "and "
      "damping of contact and legs",
      setup->t_start + elapsed + tau, static_cast<double>(limit), h);
  status_text = text;
  return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed + tau};
}

void DockingSim::Impl::read_inputs() {
  bool are_sloped = false;
  for_each_value(slopes, [&](double& slope) { are_sloped = are_sloped || slope != 0.0; });
  loads.read(scene->mechanism, inputs, slopes, are_sloped);
  loads.add(events->find_disturbing_loads());
}

/// A slope holds for one step; the input then keeps its final value. The equations of motion
/// predict driven vehicles, not slopes.
void DockingSim::Impl::advance_inputs(double h) {
  if (!loads.are_sloped()) return;
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
  for_each_value(slopes, [](double& slope) { slope = 0.0; });
}

/// One communication step from t to exactly t + h. On failure the state is unchanged.
Status DockingSim::Impl::step(double t, double h) {
  status_text.clear();
  const double late = find_lateness(t);
  read_inputs();
  const bool goes_on = can_go_on(late, h);
  if (goes_on && ahead.reached + late + h < inner.to) {
    stride(late, h);
    return {};
  }
  keep(step_start, !pose_is_kept);
  pose_is_kept = true;
  const Counters counters = find_counters();
  const std::int64_t work = find_work();
  const bool was_pending = ahead.pending;
  Status status;
  if (h > 0.0 && h <= kLongestStep) {
    note_inputs(goes_on);
    if (ahead.pending && !goes_on) status = settle();
    if (ahead.pending) {
      ahead.reached += late;
    } else if (late != 0.0) {
      elapsed = t - setup->t_start;
      evaluator->forget_present();
    }
    const std::int64_t limit = find_work_limit(h);
    if (status.ok() && !ahead.pending) status = begin_step(h);
    if (runs_ahead()) {
      std::copy_n(was_pending ? y_inside.data() : stepper->y(), y_shown.size(),
                  ahead.y_before.begin());
    }
    if (status.ok()) {
      status = is_fixed_step() ? integrate_fixed(h, limit)
                               : integrate(ahead.begin, ahead.reached + h, may_pass(), limit);
    }
    if (runs_ahead() && !ahead.pending) ahead.loads = loads.at_start();
  } else {
    status_text = "the step must be longer than 0 s and at most 1e9 s";
    status.code = StatusCode::kBadInput;
  }
  if (status.ok()) {
    coupling.work = find_work() - work;
    finish_step(h, was_pending);
    return status;
  }
  const Status back = restore(step_start);
  set_counters(counters);
  // Outputs after a refusal are the outputs before the step; that state was valid.
  if (!back.ok() || !evaluate_point().ok()) status.code = StatusCode::kNotFinite;
  char text[120];
  std::snprintf(text, sizeof text, "step from t = %.9g s over %.6g s: ", t, h);
  if (status_text.empty()) status_text = describe(status);
  status_text = text + status_text;
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
  if (host->announces()) notice_step(h);
  Status status = receive(h);
  if (update_outside_loads(elapsed)) kept_jacobian.valid = false;  // it may be a new input
  if (status.ok()) status = evaluate_start();
  if (status.ok()) status = update_command();
  if (status.ok()) status = update_hard_dock_command();
  step_begin = find_coupling_point(*model, present(), stepper->y());
  drift = 0.0;
  if (status.ok() && !is_fixed_step()) go_on(h);
  return status;
}

/// Start the integrator (again) from its state. @param known_rates  there, or null
void DockingSim::Impl::start_stepper(double tau, double h, const double* known_rates) {
  stepper->restart(tau, h, {known_rates, fastest_rate});
}

/// The same at the start of a communication step, which continues the last step.
/// @pre evaluate_start()
void DockingSim::Impl::go_on(double h) {
  const bool is_good = needs_jacobian() && kept_jacobian.valid &&
                       find_counters().steps - kept_jacobian.step < kJacobianSteps;
  const double* known = is_good ? kept_jacobian.entries.data() : nullptr;
  accept_state();
  margin_before = find_singularity_margin(model->mechanism, present().mechanism);
  proposal = h_warm;
  ahead.begin = 0.0;
  stepper->restart(0.0, std::min(proposal, h),
                   {evaluator->start_rates(), fastest_rate, 1.0, known});
}

void DockingSim::Impl::accept_state() {
  std::copy(stepper->y(), stepper->y() + model->layout.size, y_accepted.begin());
}

/// Back to the last accepted state, from which the integrator starts again.
void DockingSim::Impl::return_to(double tau, double h) {
  std::copy(y_accepted.begin(), y_accepted.end(), stepper->y());
  start_stepper(tau, h);
}

/// A step of the solver, which stores its last evaluation.
StepOutcome DockingSim::Impl::make_solver_step(double stop, bool watch_roots) {
  evaluator->begin_inner_step();
  return stepper->step(stop, watch_roots);
}

/// Make an inner step; nothing but the clocks of its solver knows of it until it is booked.
/// @param end  it ends there at the latest. @param is_single  it is one step of the solver, which
/// knows the states inside. @post inner; outcome kFailed: no step, else the end is no good
Status DockingSim::Impl::make_inner_step(double tau, double end, bool is_single) {
  last_trouble = Status();
  inner.from = tau;
  inner.outcome = make_solver_step(find_next_stop(tau, end), true);
  if (inner.outcome == StepOutcome::kFailed) return find_failure(tau);
  inner.to = stepper->time();
  if (inner.outcome == StepOutcome::kRoot) {
    const Status status = step_to_root(tau, is_single);
    if (!status.ok()) inner.outcome = StepOutcome::kFailed;
    if (!status.ok()) return status;
    inner.to = stepper->time();
  } else {
    events->clear_due();
    const bool cut_short =
        inner.outcome == StepOutcome::kStopped && inner.to - inner.from < proposal;
    proposal = cut_short ? std::max(proposal, stepper->next_step()) : stepper->next_step();
  }
  fastest_rate = stepper->fastest_rate();
  const Status status = is_single ? evaluator->at_end_with_rates(inner.to, stepper->y())
                                  : evaluator->at_end(inner.to, stepper->y());
  if (!status.ok()) return status;
  inner.audit = find_balance();
  if (!is_energy_created(inner.audit, inner.to)) return {};
  return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed + inner.to};
}

/// The inner step becomes part of the run. @param changed  set if the integrator must restart
Status DockingSim::Impl::book_inner_step(bool& changed) {
  if (inner.outcome != StepOutcome::kRoot) look_into_step(inner.from, inner.to);
  watch_energy(inner.audit, inner.to);
  changed = inner.outcome == StepOutcome::kRoot;
  const Status status = accept(inner.to, changed);
  accept_state();
  return status;
}

/// Free drift of a quiescent mechanism, to `end` at the latest. @post tau, evaluation
Status DockingSim::Impl::drift_freely(double& tau, double end, std::int64_t& turns) {
  const double stop = discrete.hard_dock.joint.on ? find_next_stop(tau, end) : end;
  const double duration = std::min(quiescent_mode->find_drift_time(), stop - tau);
  turns += quiescent_mode->drift(duration, stepper->y());
  evaluator->forget();
  tau = duration < end - tau ? tau + duration : end;
  events->clear_due();
  bool changed = false;
  const Pose<double> looked_from{memory.R_ref, memory.p_ref};
  Status status = evaluate(tau);
  if (status.ok()) status = accept(tau, changed);
  if (!status.ok()) return status;
  accept_state();
  // Another evaluation gives a better gap only with a new neighbour list.
  if (!changed && memory.p_ref == looked_from.p && memory.R_ref == looked_from.R) {
    evaluator->keep_present();
  }
  return {};
}

/// Advance from tau to `end`, through events. On failure the state is undefined.
/// @param passes  the last inner step may end later; it is then pending
/// @pre evaluation and start of the integrator at tau, or a pending step
Status DockingSim::Impl::integrate(double tau, double end, bool passes, std::int64_t limit) {
  const double asked = end - ahead.reached;
  const std::int64_t begun = find_work();
  stepper->set_evaluation_limit(limit);
  bool is_made = std::exchange(ahead.pending, false);
  bool is_evaluated = false;  // with rates, for a step ahead
  int refused = 0;            // consecutive end states that could not be evaluated
  const auto ask_for_proposal = [this] {
    ahead.size = proposal;
    ahead.last_error = 1.0;
  };
  if (!is_made) ask_for_proposal();
  for (std::int64_t turns = 0; find_work() - begun + turns < limit;) {
    Status status;
    if (!is_made) {
      status_text.clear();  // of an attempt that was refused and repeated
      status = quiescent_mode->update(tau, stepper->y());
      if (!status.ok()) return status;
      if (quiescent.on) {
        status = drift_freely(tau, end, turns);
        if (!status.ok() || tau >= end) return status;
        start_stepper(tau, std::min(proposal, end - tau));
        is_evaluated = false;
        ask_for_proposal();
        continue;
      }
      if (passes && discrete.hard_dock.joint.on) {  // it begins inside this communication step
        passes = false;
        return_to(tau, std::min(proposal, end - tau));
      }
      if (passes) status = begin_ahead(tau, is_evaluated);
      if (!status.ok()) return status;
      status = make_inner_step(tau, passes ? tau + kFarthestAhead : end, passes);
      if (!status.ok() && passes) {  // no failure of this communication step
        passes = false;
        return_to(tau, std::min(proposal, end - tau));
        continue;
      }
      if (inner.outcome == StepOutcome::kFailed) {
        return stepper->is_exhausted() ? refuse_work(asked, limit, tau) : status;
      }
      if (!status.ok()) {
        // Error control accepted a state that cannot be evaluated or that creates energy: make
        // smaller steps.
        if (++refused > kMaxRefused) return status;
        proposal = 0.25 * (inner.to - inner.from);
        return_to(tau, proposal);
        continue;
      }
      refused = 0;
    }
    is_made = false;
    if (inner.to > end) return stay_pending(end);
    bool changed = false;
    if (passes) keep_context();
    status = book_inner_step(changed);
    if (!status.ok()) return status;
    tau = inner.to;
    if (tau >= end) {
      h_warm = proposal;
      return {};
    }
    const double size = update_singularity_step(tau - inner.from);
    if (passes) {
      update_momentum_audit();
      is_evaluated = !changed;
      if (changed) evaluator->forget();
      ahead.size = size > 0.0 ? size : proposal;
      ahead.last_error = changed || size > 0.0 ? 1.0 : stepper->last_error();
    } else if (size > 0.0) {
      stepper->restart(tau, std::min(size, end - tau));
    } else if (changed) {
      start_stepper(tau, std::min(proposal, end - tau));
    }
  }
  return refuse_work(asked, limit, tau);
}

/// The same with a number of inner steps that depends on h only: equal steps of a Runge-Kutta
/// method, events detected at their ends. The cost is bounded; errors are not controlled.
/// @pre evaluate_start()
Status DockingSim::Impl::integrate_fixed(double h, std::int64_t limit) {
  const double wanted = std::ceil(h / inner_step * (1.0 - 1e-9));
  constexpr int kRk4 = 4, kRosenbrock = 8, kSdirk = 7;  // evaluations; the last: and a Jacobian
  const double each = needs_jacobian()           ? kSdirk + find_jacobian_cost()
                      : uses_structured_matrix() ? kRosenbrock
                                                 : kRk4;
  if (wanted * each > static_cast<double>(limit)) {
    char text[200];
    std::snprintf(
        text, sizeof text,
        "the step needs %.6g inner steps of solver.step = %.6g s, but the limit is %.6g: shorten "
        "the step or increase solver.step",
        wanted, inner_step, std::floor(static_cast<double>(limit) / each));
    status_text = text;
    return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed};
  }
  const int count = std::max(1, static_cast<int>(wanted));
  kept_jacobian.valid = false;  // made anew at the same places in every communication step
  double tau = 0.0;
  for (int k = 1; k <= count; ++k) {
    const double end = k == count ? h : h * k / count;
    last_trouble = Status();
    events->note_latches(present());
    start_stepper(tau, end - tau, k == 1 ? evaluator->start_rates() : nullptr);
    if (make_solver_step(end, false) == StepOutcome::kFailed) return find_failure(tau);
    const double made = end - tau;
    tau = end;
    Status status = evaluator->at_end(tau, stepper->y());
    if (!status.ok()) return status;
    const EnergyBalance audit = find_balance();
    if (is_energy_created(audit, tau))
      return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed + tau};
    watch_energy(audit, tau);
    events->set_due_below(present(), 0.0);
    events->find_passed_latches(present(), made);
    bool changed = false;
    status = accept(tau, changed);
    events->clear_passed();
    if (!status.ok()) return status;
  }
  return {};
}

/// If the loads at the end of a step are near their peaks, the loads in its middle count too.
/// @pre evaluation at `to`
void DockingSim::Impl::look_into_step(double from, double to) {
  if (adapt_problem || !peaks.is_near(find_peak_values())) return;
  const double middle = 0.5 * (from + to);
  if (!stepper->interpolate(middle, rates.data())) return;
  evaluator->count(1);
  if (!evaluator->aside(middle, rates.data(), nullptr).ok()) return;
  peaks.add(elapsed + middle, find_peak_values(trial()));
}

/// Step over a singularity. A mechanism can be evaluated on both sides of a singular pose, but not
/// in the pose. Size of a step without a stage in the pose, or of a step to the start of such a
/// step. Updates the margin of the last step. @param made  size of the last step
/// @return 0 if no singular pose is ahead
double DockingSim::Impl::update_singularity_step(double made) {
  const double margin = find_singularity_margin(model->mechanism, present().mechanism);
  const double rate = (margin_before - margin) / made;
  margin_before = margin;
  if (!(rate > 0.0) || margin > 3.0 * kChangeMargin) return 0.0;
  const double distance = margin / rate;  // to the pose, with the present rate of the margin
  const double width = model->mechanism.model.singularity.error / rate;
  if (distance - width > 1.3 * proposal) return 0.0;
  // If the step over the pose is too long for the error control, end half a step before the pose.
  const double size = Stepper::find_size_across(distance);
  return size <= 1.6 * proposal ? size : distance - 0.5 * proposal;
}

/// Where the next inner step must end at the latest: the end of the communication step, the onset
/// of thrust or of another load, a known time of the sequence, an end of a ramp, and the bound that
/// prevents surfaces from passing through each other unseen.
double DockingSim::Impl::find_next_stop(double tau, double h) const {
  const double now = elapsed + tau;
  double stop = h;
  const auto stop_at = [&](double time) {
    if (time - elapsed > tau) stop = std::min(stop, time - elapsed);
  };
  const std::optional<double> onset = events->find_thrust_onset();
  if (onset && !discrete.thrust_on) stop_at(*onset);
  stop_at(events->sequence().find_next_time(now));
  for (const LawFailure& failure : model->mechanism.model.failures) {
    if (failure.active) stop_at(find_time(failure.onset, discrete.entered.data()));
  }
  stop_at(events->find_next_disturbance(now));
  if (const auto ramp = find_next_ramp(model->hard_dock, discrete.hard_dock, now)) stop_at(*ramp);
  if (has_surfaces() && model->contact.has_surfaces() && !discrete.hard_dock.joint.on) {
    const double bound = find_step_bound(model->contact, present().contact.gap, present().relative);
    if (tau + bound < stop) stop = tau + bound;
  }
  return stop;
}

Status DockingSim::Impl::find_failure(double tau) const {
  if (!last_trouble.ok()) return last_trouble;
  return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed + tau};
}

/// A root lies in the step just made: replace its interpolated state by steps that end there.
/// @param is_single  one step; if it ends earlier, the next inner step finds the root again
Status DockingSim::Impl::step_to_root(double tau, bool is_single) {
  const double root = stepper->time();
  for (int i = 0; i < events->root_count(); ++i) events->set_due(i, stepper->root_found(i));
  std::copy(y_accepted.begin(), y_accepted.end(), stepper->y());
  if (!(root > tau)) return {};
  start_stepper(tau, root - tau);
  for (;;) {  // ends with the limit of evaluations
    const StepOutcome outcome = make_solver_step(root, false);
    if (outcome == StepOutcome::kFailed) return find_failure(tau);
    if (outcome == StepOutcome::kStopped) return {};
    if (!is_single) continue;
    events->clear_due();
    inner.outcome = outcome;
    proposal = stepper->next_step();
    return {};
  }
}

/// Does the step that ends here create energy? If so, status_text contains the message.
bool DockingSim::Impl::is_energy_created(const EnergyBalance& found, double tau) {
  const double there = find_energy_scale(energy_audit, found, chosen.atol_energy);
  if (!creates_energy(energy_audit, found, there)) return false;
  char text[400];
  std::snprintf(
      text, sizeof text,
      "the inner step to t = %.9g s makes the energy audit wrong by %.3g J (%.3g J so far), "
      "with %.3g J in play: shorten the step (solver.step of a fixed-step method), decrease "
      "solver.rtol, or set solver.method = 1 (auto)",
      setup->t_start + elapsed + tau, std::abs(found.residual - energy_audit.residual),
      std::abs(found.residual), there);
  status_text = text;
  return true;
}

/// Updates the energy audit. Issues a warning at a residual of 1 %, and again at 10 %.
void DockingSim::Impl::watch_energy(const EnergyBalance& found, double tau) {
  const double there = find_energy_scale(energy_audit, found, chosen.atol_energy);
  if (!update_energy_audit(found, there, energy_audit)) return;
  char text[300];
  std::snprintf(text, sizeof text,
                "the energy audit is off by %.3g J at t = %.9g s, %.2g of the %.3g J in play: "
                "loads and motion may have larger errors; decrease %s",
                energy_audit.residual, setup->t_start + elapsed + tau,
                std::abs(energy_audit.residual) / there, there,
                is_fixed_step() ? "solver.step, or set solver.method = 1 (auto)" : "solver.rtol");
  warnings.push_back(text);
}

/// Finish a successful communication step. @param was_pending  did a pending step cover its start?
void DockingSim::Impl::finish_step(double h, bool was_pending) {
  // O drifts with its velocity and falls with gravity, so gravity does not act relative to O.
  frame_shift += frame_velocity * h;
  if (model->falling) {
    frame_shift += 0.5 * h * h * loads.at_start().gravity;
    frame_velocity += h * loads.at_start().gravity;
    if (loads.are_sloped()) {
      frame_shift += h * h * h / 6.0 * loads.rates().gravity;
      frame_velocity += 0.5 * h * h * loads.rates().gravity;
    }
  }
  const DisturbingLoads disturbing = events->find_mean_disturbing_loads(find_point_time(), h);
  if (!ahead.pending) elapsed += ahead.reached + h;
  ahead.reached = ahead.pending ? ahead.reached + h : 0.0;
  coupling.regular_step = std::max(h, kFade * coupling.regular_step);
  last_step = h;
  invalidate();
  put_joined_target();
  ahead.is_mean_due = was_pending || ahead.pending;
  if (ahead.is_mean_due) {
    ahead.mean_known = loads.find_mean(h, disturbing);
  } else {
    const CouplingPoint end = find_coupling_point(*model, present(), stepper->y());
    update_mean_loads(h, step_begin, end, loads.find_mean(h, disturbing));
    if (host->has_host()) host->update_impulse_balance(h, step_begin, end, stepper->y());
  }
  if (!ahead.pending) update_momentum_audit();
  advance_inputs(h);
  if (host->announces()) {
    read_inputs();
    announce(update_expected_step());
  }
}

/// Mean loads over the step just made, on vehicles that are not driven. @param known  mean loads
/// from outside
void DockingSim::Impl::update_mean_loads(double h, const CouplingPoint& begin,
                                         const CouplingPoint& end, const Loads& known) {
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || !model->moves[i] || model->driven[i]) continue;
    const VehicleState &before = begin.vehicle[i], &after = end.vehicle[i];
    const Wrench<double> impulse =
        host->find_stated_momentum(i, after) - host->find_stated_momentum(i, before);
    mean_load[i] = find_mean_load(impulse, before, after, h);
    mean_load[i].f -= known.force[i];
    if (!model->falling) mean_load[i].f -= model->stated_mass[i] * known.gravity;
    mean_load[i].t -= known.torque[i];
  }
}

/// Update the scales and the residual at this communication point.
void DockingSim::Impl::update_momentum_audit() {
  if (!conserves_momentum(*model)) return;
  update_momentum_scales(*model, stepper->y(), momentum_audit);
  momentum_audit.residual =
      std::max(momentum_audit.residual,
               find_momentum_residual(*model, present(), stepper->y(), momentum_audit));
}

}  // namespace dockloop
