// The loop of inner steps: integrate, locate events, repeat refused steps, and keep a step that
// ends after the communication point.
//
// The class owns the integrator and the state y. It knows when an inner step is good, and where the
// step must end. At every accepted state it calls Accept, which carries out the events there and
// says whether the integration must start again. A step is booked when this is done. Time is
// counted from SimState::elapsed, in seconds (tau; elsewhere tau is a vector of joint forces).
//
//   step_loop.cpp      inner steps, equal steps, free drift, limits of the work
//   step_problem.cpp   what the integrator asks for: rates, event functions, matrices
//   run_ahead.cpp      steps that end after the communication point
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "docking/scene.hpp"
#include "integrate/stepper.hpp"
#include "sim/balance_watch.hpp"
#include "sim/equations.hpp"
#include "sim/evaluator.hpp"
#include "sim/event_logic.hpp"
#include "sim/quiescent_mode.hpp"
#include "sim/solver_methods.hpp"
#include "sim/step_loads.hpp"

namespace dockloop {

constexpr int kJacobianSteps = 50;  ///< longest use of a Jacobian, unless Newton fails

constexpr double kFarthestAhead = 1000.0;  ///< end of a step ahead, in communication steps

/// Rounding of the host's clock [s]. @param now  [s since start]
inline double find_clock_rounding(double t_start, double now) {
  return 4e-16 * (std::abs(t_start) + std::abs(now));
}

/// The method of a run, and what follows from it. Fixed at the start.
struct RunMethod {
  const MethodFacts* facts = nullptr;
  double rtol = 0.0;               ///< the smaller of the tolerances of parameter and host
  bool is_co_simulation = true;    ///< else the host integrates
  bool is_structured = false;      ///< linearly implicit steps (docking/structured_matrix.hpp)
  bool is_switching = false;       ///< these, or stabilised steps
  bool runs_ahead = false;         ///< inner steps may end after the communication point
  Equations* equations = nullptr;  ///< null: those of the core

  /// Does the integrator make the steps, of the equations of the core?
  bool integrates_core() const { return is_co_simulation && !equations; }
  bool is_reference() const { return equations && equations->is_reference(); }
  bool is_fixed_step() const { return facts->fixed_step; }
  bool has_matrix() const { return is_structured || is_switching; }
  bool needs_jacobian() const { return facts->is_multistep; }
  /// Does the next communication step begin with the last Jacobian?
  bool keeps_jacobian() const { return needs_jacobian() && is_co_simulation; }
  /// Does the method begin a step with the rates there?
  bool begins_with_rates() const { return !facts->is_multistep && !equations; }
  /// Does an inner step end at an event?
  bool locates_events() const { return is_co_simulation && !is_fixed_step(); }
};

/// The method of the integrator. Bristles of contacts take other steps than the structured matrix.
Stepper::Method find_stepper_method(const RunMethod& method);

class StepLoop {
 public:
  /// Other parts of the simulation.
  struct Parts {
    SimState& state;
    StepLoads& loads;
    EventLogic& events;
    Evaluator& evaluator;
    QuiescentMode& quiescent_mode;
    BalanceWatch& balances;
    std::string& status_text;
  };
  /// All updates at an accepted state. @pre evaluation at tau @post the same
  /// @param changed  set if the integration must start again
  using Accept = std::function<Status(double tau, bool& changed)>;

  /// Keeps references to all parts and to `rated`.
  StepLoop(const DockingModel& model, const RunMethod& method, const Parts& parts,
           const RatedLoads& rated, double t_start, Accept accept);
  /// A changed copy of the model.
  void use_model(const DockingModel& model) { model_ = &model; }
  /// Asked before every inner step whether the user stops the step; empty: never.
  void use_interruption(std::function<bool()> asks) { interruption_ = std::move(asks); }
  /// @param atol  for all unknowns
  void set_tolerances(double rtol, const std::vector<double>& atol);
  const RunMethod& method() const { return method_; }
  /// Are steps searched for peaks? Else peaks are interpolated.
  bool searches_peaks() const { return !method_.is_reference() && !method_.is_fixed_step(); }

  /// Estimated error of the last step, in tolerances; 1 without an estimate.
  double last_error() const { return stepper_->last_error(); }

  // State

  double* y() const { return stepper_->y(); }
  /// All unknowns of a form with more than y; null without such a form.
  const double* unknowns() const { return stepper_->unknowns(); }
  /// The last state that was booked.
  const double* accepted_y() const { return is_pending() ? y_accepted_.data() : y(); }
  /// y is accepted: a refused inner step returns to it.
  void accept_state();
  /// Does y still have the bits of the last accept_state()?
  bool is_at_accepted_state() const;

  // A communication step

  /// The start state is complete. @pre evaluation
  void start();
  /// Continue the last communication step with one of h. @pre evaluation at tau = 0
  void begin(double h);
  /// Advance by h, through events. On failure the state is undefined. @pre begin(), or a pending
  /// step
  /// @param limit  of the work [evaluations]. @param was_pending  was a step pending at its start?
  Status advance(double h, std::int64_t limit, bool was_pending);

  // Steps that end after the communication point (run_ahead.cpp)

  bool is_pending() const { return ahead_.pending; }
  /// Is the pending step valid for a communication step of h too? @pre the loads were read
  /// @param late  how far the clock of the host is ahead of ours [s]
  bool can_go_on(double late, double h) const;
  /// Does a communication step of h end inside the pending step?
  bool covers(double late, double h) const { return ahead_.reached + late + h < inner_.to; }
  /// A communication step inside the pending step. @pre covers()
  /// @return false: the state there is not good enough; nothing has changed
  bool stride(double late, double h);
  /// A host that changes its inputs at every point would pay for steps that are dropped: count.
  void note_inputs(bool goes_on);
  /// Inputs are about to change: make the pending step again, as a step to the communication point.
  /// On failure the state is undefined. @pre is_pending() @post the loads are those of the pending
  /// step
  Status settle();
  /// Make the pending step again after its start was restored, with the same bits.
  /// @pre is_pending(); the counters have no meaning
  Status remake_pending();
  /// The state at the communication point.
  const double* point_y() const { return is_pending() ? y_shown_.data() : y(); }
  /// Is point_y() known?
  bool is_balanced() const { return is_shown_ || !is_pending(); }
  /// Compute point_y(). @post the loads are those of the pending step
  Status balance_point();

  // Work

  Counters find_counters() const;
  void set_counters(const Counters& wanted);
  /// A step that the host has made.
  void count_step() { ++counted_elsewhere_.steps; }
  /// Work after which a communication step is refused [evaluations].
  std::int64_t find_work_limit(double h) const;
  /// Work since the start [evaluations].
  std::int64_t find_work() const;

  // Failures

  /// Keep a failure for the message. @param values  computed values: all must be finite
  /// @return status code for Stepper::Problem
  int update_failure_code(Status status, double tau, const double* values, int count);
  void keep_failure(const Status& status) { last_failure_ = status; }

 private:
  /// A step of the integrator, not booked yet.
  struct InnerStep {
    StepOutcome outcome = StepOutcome::kFailed;
    double from = 0.0, to = 0.0;
    bool is_one = false;   ///< one step of the solver, which knows all states inside
    EnergyBalance energy;  ///< at its end
  };

  // step_loop.cpp
  DockingData<double>& present() const { return evaluator_.present(); }
  Status integrate(double tau, double end, bool passes, std::int64_t limit);
  Status integrate_fixed(double h, std::int64_t limit);
  void start_stepper(double tau, double h, const double* known_rates = nullptr);
  void return_to(double tau, double h);
  StepOutcome make_solver_step(double stop, bool watch_roots);
  Status make_inner_step(double tau, double end, bool is_single);
  void count_left_out(double length);
  Status book_inner_step(bool& changed);
  Status step_to_root(double tau, bool is_single);
  Status drift_freely(double& tau, double end, std::int64_t& turns);
  void search_peaks(double from, double to);
  double update_singularity_step(double made);
  double find_margin() const;
  double find_next_stop(double tau, double end) const;
  Status find_failure(double tau) const;
  double find_evaluation_cost() const;
  double find_factor_cost() const;
  Status refuse_work(double h, std::int64_t limit, double tau);
  bool is_interrupted() const { return interruption_ && interruption_(); }

  // step_problem.cpp
  Stepper::Problem make_problem();
  void enter_structured_matrix(Stepper::Problem& problem);
  bool depends_on_time() const;
  int build_matrix(double tau, const double* y, int& cost);
  int calc_jacobian(double tau, const double* y, double* by_columns);
  int find_jacobian_cost() const;

  // run_ahead.cpp
  bool may_pass() const;
  void keep_context();
  Status begin_ahead(double tau, double h, bool is_evaluated);
  void start_ahead();
  bool show_point(double t);
  Status balance(double t);
  Status stay_pending(double point);
  void hide_point();

  const DockingModel* model_;
  RunMethod method_;
  SimState& state_;
  RunAhead& ahead_;     ///< of state_
  KeptJacobian& kept_;  ///< of state_
  StepLoads& loads_;
  EventLogic& events_;
  Evaluator& evaluator_;
  QuiescentMode& quiescent_mode_;
  BalanceWatch& balances_;
  std::string& status_text_;
  const RatedLoads& rated_;
  double t_start_;
  Accept accept_;
  std::function<bool()> interruption_;
  std::unique_ptr<Stepper> stepper_;
  Counters counted_elsewhere_;  ///< work of other integrators that led to the present state

  InnerStep inner_;             ///< the last one, or the pending one
  double proposal_ = 0.0;       ///< step size of the error control, without stops [s]
  double margin_before_ = 1.0;  ///< of the loops, at the last accepted state
  Status last_failure_;
  std::vector<double> y_accepted_;
  /// At a communication point inside a pending step: interpolated, and as it is read.
  std::vector<double> y_inside_, y_shown_;
  bool is_shown_ = false;                ///< y_shown_ is valid
  LoopReference<double> accepted_pose_;  ///< while a pending step is made again
  std::vector<double> scratch_, slope_;  ///< size of y
};

}  // namespace dockloop
