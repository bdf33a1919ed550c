// What the integrator asks of a StepLoop: rates, event functions, matrices; see step_loop.hpp.
#include <algorithm>
#include <cmath>

#include "sim/step_loop.hpp"

namespace dockloop {

Stepper::Method find_stepper_method(const RunMethod& method) {
  if (method.is_structured) {
    return method.is_fixed_step() ? Stepper::Method::kFixedRosenbrock
                                  : Stepper::Method::kRosenbrock;
  }
  if (method.is_switching) return Stepper::Method::kSwitching;
  switch (method.facts->method) {
    case kBdf:
      return Stepper::Method::kBdf;
    case kFixedRk4:
    case kFixedRosenbrock:  // of other forms
      return Stepper::Method::kClassicRk4;
    case kAuto:
    case kStabilised:
    case kRosenbrock:  // of other forms
      return Stepper::Method::kStabilised;
    default:
      return Stepper::Method::kDormandPrince;
  }
}

/// Cost of a Jacobian, in evaluations: about one per column, measured.
int StepLoop::find_jacobian_cost() const {
  const StateLayout& layout = model_->layout;
  return layout.sums + layout.element_bristle_count + layout.bristle_count;
}

Stepper::Problem StepLoop::make_problem() {
  const StateLayout& layout = model_->layout;
  Stepper::Problem problem;
  problem.size = layout.size;
  problem.root_count = events_.root_count();
  problem.rates = [this](double t, const double* y, double* ydot) {
    const Status status = evaluator_.at_trial(t, y, ydot);
    return update_failure_code(status, t, ydot, model_->layout.size);
  };
  problem.roots = [this](double t, const double* y, double* roots) {
    const Status status = evaluator_.at_trial(t, y, nullptr);
    if (!status.ok()) {
      last_failure_ = status;
      return 1;
    }
    events_.calc_functions(evaluator_.events_at(), roots);
    return 0;
  };
  problem.root_speeds = [this](double* speeds) {
    events_.calc_speeds(evaluator_.events_at(), speeds);
  };
  if (method_.needs_jacobian()) {
    evaluator_.reserve_jacobian();
    if (method_.keeps_jacobian()) {
      kept_.entries.assign(static_cast<size_t>(layout.size * layout.size), 0.0);
    }
    problem.jacobian = [this](double t, const double* y, double* by_columns) {
      return calc_jacobian(t, y, by_columns);
    };
    problem.jacobian_cost = find_jacobian_cost();
  }
  if (method_.has_matrix()) enter_structured_matrix(problem);
  return problem;
}

int StepLoop::update_failure_code(Status status, double tau, const double* values, int count) {
  if (status.ok()) {
    double sum = 0.0;
    for (int i = 0; i < count; ++i) sum += values[i];
    if (std::isfinite(sum)) return 0;
    status.code = StatusCode::kNotFinite;
  }
  last_failure_ = status;
  last_failure_.time = state_.elapsed + tau;
  return status.code == StatusCode::kLoopSingular ? Stepper::kStepOver : Stepper::kSmaller;
}

void StepLoop::enter_structured_matrix(Stepper::Problem& problem) {
  evaluator_.reserve_matrix();
  kept_.entries.assign(static_cast<size_t>(find_mechanism_block_size(*model_)), 0.0);
  problem.matrix.build = [this](double t, const double* y, int& cost) {
    return build_matrix(t, y, cost);
  };
  problem.matrix.factor = [this](double g) { return evaluator_.matrix().factor(g); };
  problem.matrix.solve = [this](double* x) { evaluator_.matrix().solve(x); };
  problem.depends_on_time = [this] { return depends_on_time(); };
}

bool StepLoop::depends_on_time() const {
  const double now = state_.elapsed + ahead_.begin;
  const auto releases = [](const LatchState& latch) { return latch.mode == LatchMode::kReleasing; };
  return loads_.are_sloped() || model_->mechanism.plan.is_driven ||
         events_.sequence().are_drives_starting(now) ||
         is_ramping(model_->hard_dock, state_.discrete.hard_dock, now) ||
         std::any_of(state_.discrete.latch.begin(), state_.discrete.latch.end(), releases);
}

/// @return as the rates
int StepLoop::build_matrix(double t, const double* y, int& cost) {
  const bool is_accepted = std::equal(y_accepted_.begin(), y_accepted_.end(), y);
  const std::int64_t step = find_counters().steps;
  const bool renews = !kept_.valid || step - kept_.step >= kJacobianSteps;
  const Status status =
      evaluator_.build_matrix(t, y, is_accepted, renews, kept_.entries.data(), cost);
  if (renews) {
    kept_.valid = status.ok();
    kept_.step = step;
  }
  return update_failure_code(status, t, nullptr, 0);
}

/// Derivatives of the rates by the states, by columns, for implicit methods. @return as the rates
int StepLoop::calc_jacobian(double t, const double* y, double* by_columns) {
  evaluator_.forget();
  Status status = evaluator_.aside(t, y, nullptr);
  if (status.ok()) status = evaluator_.calc_jacobian(t, y);
  const MatX<double>& jacobian = evaluator_.jacobian();
  std::copy_n(jacobian.data(), jacobian.size(), by_columns);
  const int code = update_failure_code(status, t, by_columns, static_cast<int>(jacobian.size()));
  if (method_.keeps_jacobian()) {
    kept_.entries.assign(by_columns, by_columns + jacobian.size());
    kept_.valid = code == 0;
    kept_.step = find_counters().steps;
  }
  return code;
}

}  // namespace dockloop
