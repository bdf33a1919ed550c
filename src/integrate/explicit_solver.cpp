// Explicit Runge-Kutta steps, adaptive or of fixed size, by the tables of runge_kutta.hpp.
//
// They are our own because evaluations have become so cheap that the vectors of ERKStep cost as
// much again (tests/benchmarks/stepper_bench.cpp). Step sizes follow the PI controller of ARKODE
// with its constants. A question about the end of a step finds everything computed.
//
// With a second, stabilised table the solver goes over to it where stability limits the steps of
// the usual one, and back. Both tables evaluate the end of the step twice, from two approximations:
// the ratio of these differences gives the fastest rate of the solution (Hairer, Wanner: Solving
// Ordinary Differential Equations II, IV.2).
#include <algorithm>
#include <cmath>
#include <vector>

#include "integrate/one_step_solver.hpp"
#include "integrate/runge_kutta.hpp"

namespace dockloop {
namespace {

constexpr double kSafety = 0.96, kBias = 1.5;  ///< of the error that is aimed at
constexpr double kProportional = 0.8, kIntegral = 0.31;
constexpr double kGrowth = 25.0, kLeastShrink = 0.2;  ///< limits of a change of the step size
// Step size times fastest rate:
constexpr double kLimited = 2.8;     ///< where stability begins to limit Dormand-Prince steps
constexpr double kWorthwhile = 4.0;  ///< where a stabilised step is cheaper than two of those
constexpr double kRateFade = 0.9;    ///< of the fastest rate seen, per step
/// Error, in tolerances, of a step that is ten times too long. Its stages have left the solution,
/// for example deep into a contact, and the rate at its end is not that of the solution.
constexpr double kFarOff = 1e5;

/// A table, and what follows from it.
struct Method {
  explicit Method(const RungeKuttaTable& t) : table(t), c(t.stages, 0.0), probe(t.stages, 0.0) {
    const double* a = table.a;
    for (int i = 1; i < table.stages; a += i++) {
      for (int j = 0; j < i; ++j) c[i] += a[j];
      if (i + 1 < table.stages) continue;
      for (int j = 0; j <= i; ++j) probe[j] = table.b[j] - (j < i ? a[j] : 0.0);
    }
  }
  RungeKuttaTable table;
  std::vector<double> c;
  std::vector<double> probe;  ///< weights of the end less the last stage, which is at the end too
};

class ExplicitSolver : public OneStepSolver {
 public:
  /// @param stable  a table to go over to, or one without stages
  ExplicitSolver(System& system, const RungeKuttaTable& usual, const RungeKuttaTable& stable = {})
      : OneStepSolver(system, !usual.error, kGrowth),
        usual_(usual),
        stable_(stable),
        rates_(static_cast<size_t>(stride_) * (std::max(usual.stages, stable.stages) + 1), 0.0),
        error_(static_cast<size_t>(stride_), 0.0) {}

  void restart(double t, N_Vector y, double h) override {
    OneStepSolver::restart(t, y, h);
    used_ = &usual_;
    fastest_ = 0.0;
  }
  void set_known(const Stepper::Known& known) override {
    if (known.rates) std::copy_n(known.rates, size_, get_rates(0));
    rated_ = known.rates != nullptr;
    last_error_ = known.last_error;
    fastest_ = known.pace.fastest_rate;
  }
  Stepper::Pace pace() const override { return {fastest_}; }
  bool interpolate(double t, N_Vector y) override;

 private:
  double* get_rates(int stage) { return rates_.data() + stage * stride_; }
  double* get_first_rates() override { return get_rates(0); }
  void continue_from_end() override {
    std::copy_n(get_rates(used_->table.stages), size_, get_rates(0));
  }
  void add_up(const double* weight, int count, double h, const double* base, double* sum) const;
  bool prepare(double room) override { return fixed_ || h_ > 0.0 || find_first_step(room); }
  void choose_method(double room) override;
  bool calc_end(double h) override;
  bool find_error(double h, double& error) override;
  double find_shrink(double error) const override;
  double find_factor(double error) override;
  void update_fastest_rate(double h);
  bool find_first_step(double room);

  const Method usual_, stable_;
  const Method* used_ = &usual_;  // in the last step
  std::vector<double> rates_;     // of the stages, one after another; last: at the end
  std::vector<double> error_;     // scratch
  double fastest_ = 0.0;          // rate of the solution [1/s]; 0 = not known
};

/// sum = base + h * (weights times rates)
void ExplicitSolver::add_up(const double* weight, int count, double h, const double* base,
                            double* sum) const {
  functions_.add_up(weight, rates_.data(), count, stride_, h, base, sum);
}

/// All stages but the last, and the state at the end.
bool ExplicitSolver::calc_end(double h) {
  const RungeKuttaTable& table = used_->table;
  const double* a = table.a;
  for (int i = 1; i < table.stages; a += i++) {
    add_up(a, i, h, start_.data(), end_.data());
    if (!calc_rates(t_ + used_->c[i] * h, end_.data(), get_rates(i))) return false;
  }
  add_up(table.b, table.stages, h, start_.data(), end_.data());
  return true;
}

/// Estimated error of the step (root mean square). The estimate needs the rates at the end.
bool ExplicitSolver::find_error(double h, double& error) {
  const RungeKuttaTable& table = used_->table;
  if (!calc_rates(t_ + h, end_.data(), get_rates(table.stages))) return false;
  std::fill(error_.begin(), error_.end(), 0.0);
  add_up(table.error, table.stages + 1, h, error_.data(), error_.data());
  error = find_mean(error_.data());
  if (error < kFarOff) update_fastest_rate(h);
  return true;
}

double ExplicitSolver::find_shrink(double error) const {
  const double shrink = std::pow(kBias * error, -1.0 / (used_->table.error_order + 1));
  return shrink > kLeastShrink ? std::min(0.9, kSafety * shrink) : kLeastShrink;
}

double ExplicitSolver::find_factor(double error) {
  const int order = used_->table.error_order;
  const double now = std::max(kBias * error, 1e-10), before = last_error_;
  last_error_ = now;
  return kSafety * std::pow(now, -kProportional / order) * std::pow(before, kIntegral / order);
}

/// Goes over to the other table where its steps are cheaper. @param room  for the next step [s]
void ExplicitSolver::choose_method(double room) {
  if (stable_.table.stages == 0) return;
  const double wanted = h_ * fastest_, most = room * fastest_;
  const bool stiff = used_ == &stable_ ? std::min(wanted, most) > kWorthwhile
                                       : wanted > kLimited && most > kWorthwhile;
  used_ = stiff ? &stable_ : &usual_;
  if (stiff) h_ = std::min(h_, kStabilisedInterval / fastest_);
}

/// From the two evaluations at the end of a step.
void ExplicitSolver::update_fastest_rate(double h) {
  if (stable_.table.stages == 0) return;
  std::fill(error_.begin(), error_.end(), 0.0);
  add_up(used_->probe.data(), used_->table.stages, h, error_.data(), error_.data());
  const double *last = get_rates(used_->table.stages - 1), *end = get_rates(used_->table.stages);
  double apart = 0.0, change = 0.0;
  for (int i = 0; i < size_; ++i) {
    const double y = error_[i] * scale_[i], rate = (end[i] - last[i]) * scale_[i];
    apart += y * y;
    change += rate * rate;
  }
  const double seen = apart > 0.0 ? std::sqrt(change / apart) : 0.0;
  fastest_ = std::max(std::isfinite(seen) ? seen : 0.0, kRateFade * fastest_);
}

/// Without a proposal: a step in which the state bends away from its tangent by one tolerance,
/// found from a short one. In other units of time it is the same step (as that of CVODE).
bool ExplicitSolver::find_first_step(double room) {
  const double y = std::max(1.0, find_mean(start_.data())), speed = find_mean(get_rates(0));
  const double h = 0.01 * y < room * speed ? 0.01 * y / speed : 0.01 * room;
  const double one = 1.0;
  add_up(&one, 1, h, start_.data(), end_.data());
  if (!calc_rates(t_ + h, end_.data(), get_rates(1))) return false;
  for (int i = 0; i < size_; ++i) error_[i] = (get_rates(1)[i] - get_rates(0)[i]) / h;
  const double bend = find_mean(error_.data());
  h_ = std::min({100.0 * h, bend * room * room > 2.0 ? std::sqrt(2.0 / bend) : room, room});
  return true;
}

bool ExplicitSolver::interpolate(double t, N_Vector y) {
  if (fixed_) return true;  // no roots are searched inside
  if (!at_end_) return false;
  const double s = 1.0 - (t_ - t) / made_, r = 1.0 - s;
  const int stages = used_->table.stages;
  add_up(used_->table.dense, stages + 1, made_ * s * s * r * r, start_.data(), error_.data());
  interpolate_cubic(t, error_.data(), get_rates(0), get_rates(stages), y);
  return true;
}

}  // namespace

std::unique_ptr<Solver> make_explicit_solver(System& system, const RungeKuttaTable& table) {
  return std::make_unique<ExplicitSolver>(system, table);
}

std::unique_ptr<Solver> make_explicit_solver(System& system, const RungeKuttaTable& usual,
                                             const RungeKuttaTable& stable) {
  return std::make_unique<ExplicitSolver>(system, usual, stable);
}

}  // namespace dockloop
