// Steps of arbitrary order with 32 digits, as a Solver: the method of the reference solution.
//
// Extrapolation after Gragg, Bulirsch and Stoer (Hairer, Norsett, Wanner: Solving Ordinary
// Differential Equations I, II.9): a step is made by the midpoint rule with 2, 4, 6, ... substeps,
// whose results are extrapolated to infinitely many until two columns agree. Where the rates have a
// kink that does not happen: such a step is given up early and halved, which closes in on the kink
// until a step across it is short enough to be right at any order. Across a jump of the rates a
// step is as short as the time resolves; its error is the jump times that.
//
// The state has its own extended copy; y in double is always its rounding. What is handed back in
// restart() bit by bit goes on with all digits.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "integrate/solver.hpp"
#include "math/extended.hpp"

namespace dockloop {

class ExtendedSolver : public Solver {
 public:
  /// As Stepper::Problem::rates.
  using Rates = std::function<int(const Extended& t, const Extended* y, Extended* ydot)>;

  /// @param tolerance  of a step, relative to |y| plus what set_tolerances() says
  ExtendedSolver(System& system, Rates rates, double tolerance);

  /// Scale of errors: |y| + atol/rtol.
  void set_tolerances(double rtol, N_Vector atol) override;
  void restart(double t, N_Vector y, double h) override;
  StepOutcome step(double t_stop, N_Vector y, double& t) override;
  /// By steps of its own from the start of the last one.
  bool interpolate(double t, N_Vector y) override;
  double next_step() const override { return proposal_; }

  /// The state with all its digits.
  const std::vector<Extended>& state() const { return now_; }
  /// That of state(), of the start of the last step and of the last interpolation which rounds to
  /// y; y itself if none does.
  const std::vector<Extended>& find_state(const double* y);

 private:
  static constexpr int kColumns = 14;
  using State = std::vector<Extended>;
  struct Trial {
    bool accepted, usable;  ///< within the tolerance; there is a result at all
    double h;               ///< proposed for what comes next [s]
  };

  bool advance(State& y, double& t, double t_stop, double& h);
  Trial extrapolate(const State& y, double t, double end);
  bool make_midpoint_steps(const State& y, const Extended& t, const Extended& h, int count,
                           State& end);
  bool calc_rates(const Extended& t, const State& y, State& ydot);
  double find_error(const State& before, const State& after, const State& other) const;
  std::int64_t present_steps() const override { return count_; }
  std::int64_t present_rejected() const override { return count_rejected_; }

  System& system_;
  Rates rates_;
  double tolerance_;
  std::vector<double> scale_;
  State now_, start_, inside_, plain_;
  double t_ = 0.0, t_start_ = 0.0, proposal_ = 0.0;
  std::int64_t count_ = 0, count_rejected_ = 0;
  // scratch
  State rate_, rate_inside_, lower_, upper_, result_, other_;
  std::array<State, kColumns> column_;
};

}  // namespace dockloop
