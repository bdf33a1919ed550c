// What one-step methods of our own share: how a step is tried, accepted or rejected, and divided.
//
// A method adds its stages, its estimate of the error and its controller. The end of a step is
// evaluated last: it is the first stage of the next step.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "integrate/solver.hpp"
#include "math/column_lanes.hpp"

namespace dockloop {

class OneStepSolver : public Solver {
 public:
  void set_tolerances(double rtol, N_Vector atol) override;
  void restart(double t, N_Vector y, double h) override;
  StepOutcome step(double t_stop, N_Vector y, double& t) final;
  double next_step() const override { return h_; }
  double last_error() const override { return last_error_; }
  bool has_fixed_step() const override { return fixed_; }

 protected:
  /// @param growth  limit of the next step over this one
  OneStepSolver(System& system, bool fixed, double growth);

  /// The rates at the end of the last step become those at the start of this one.
  virtual void continue_from_end() = 0;
  /// Where the rates at the start belong.
  virtual double* get_first_rates() = 0;
  /// Before the first try: what depends on the start; a size, if there is none. @param room  [s]
  virtual bool prepare(double room) = 0;
  virtual void choose_method(double) {}
  /// Writes end_.
  virtual bool calc_end(double h) = 0;
  /// In tolerances. @pre calc_end()
  virtual bool find_error(double h, double& error) = 0;
  /// Rates at the end of an accepted step, unless find_error() needed them.
  virtual bool calc_last_rates(double) { return true; }
  /// Next step over this one, after a rejection and after an acceptance.
  virtual double find_shrink(double error) const = 0;
  virtual double find_factor(double error) = 0;

  bool calc_rates(double t, const double* y, double* ydot) {
    return system_.calc_rates(t, y, ydot) == 0;
  }
  /// Sum of squares in tolerances.
  double find_square(const double* x) const {
    double sum = 0.0;
    for (int i = 0; i < size_; ++i) {
      const double e = x[i] * scale_[i];
      sum += e * e;
    }
    return sum;
  }
  double find_mean(const double* x) const { return std::sqrt(find_square(x) / size_); }
  /// y = base + the cubic through both ends of the last step, without its start. @pre at_end_
  void interpolate_cubic(double t, const double* base, const double* first, const double* last,
                         N_Vector y) const;

  System& system_;
  const columns::ColumnFunctions& functions_ = columns::find_column_functions();
  const bool fixed_;
  const int size_, stride_;          // stride_: of columns, whole groups of lanes
  std::vector<double> start_, end_;  // of the step
  std::vector<double> scale_;        // 1/(rtol |y| + atol)
  double t_ = 0.0, h_ = 0.0;         // end of the last step, size of the next one [s]
  double made_ = 0.0;                // size of the last one [s]
  double last_error_ = 1.0;          // of the step before, in tolerances
  bool rated_ = false;               // the rates at t_ are those at the start
  bool at_end_ = false;              // the rates at t_ are those at the end

 private:
  static constexpr double kShrink = 0.2;   ///< least factor after an accepted step
  static constexpr int kMaxRejected = 20;  ///< in a row

  std::int64_t present_steps() const override { return steps_; }
  std::int64_t present_rejected() const override { return rejected_; }

  const double growth_;
  std::vector<double> atol_;
  double rtol_ = 1e-6;
  std::int64_t steps_ = 0, rejected_ = 0;
};

}  // namespace dockloop
