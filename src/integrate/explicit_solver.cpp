// Explicit Runge-Kutta steps, adaptive or of fixed size, by the tables of runge_kutta.hpp.
//
// They are our own because evaluations have become so cheap that the vectors of ERKStep cost as
// much again (tests/benchmarks/stepper_bench.cpp). Step sizes follow the PI controller of ARKODE
// with its constants. The end of a step is evaluated last: it is the first stage of the next step,
// and a question about this point finds everything computed.
//
// With a second, stabilised table the solver goes over to it where stability limits the steps of
// the usual one, and back. Both tables evaluate the end of the step twice, from two approximations:
// the ratio of these differences gives the fastest rate of the solution (Hairer, Wanner: Solving
// Ordinary Differential Equations II, IV.2).
#include <algorithm>
#include <cmath>
#include <vector>

#include "integrate/runge_kutta.hpp"
#include "integrate/solver.hpp"

namespace dockloop {
namespace {

constexpr double kSafety = 0.96, kBias = 1.5;  ///< of the error that is aimed at
constexpr double kProportional = 0.8, kIntegral = 0.31;
constexpr double kGrowth = 25.0, kShrink = 0.2;  ///< limits of a change of the step size
constexpr int kMaxRejected = 20;                 ///< in a row
constexpr int kUnrollWidth = 4;                  ///< states that are added up together
// Step size times fastest rate:
constexpr double kLimited = 2.8;     ///< where stability begins to limit Dormand-Prince steps
constexpr double kWorthwhile = 4.0;  ///< where a stabilised step is cheaper than two of those
constexpr double kFade = 0.9;        ///< of the fastest rate seen, per step

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

class ExplicitSolver : public Solver {
 public:
  /// @param stable  a table to go over to, or one without stages
  ExplicitSolver(System& system, const RungeKuttaTable& usual, const RungeKuttaTable& stable = {})
      : system_(system),
        usual_(usual),
        stable_(stable),
        fixed_(!usual.error),
        size_(system.problem.size),
        stride_((size_ + kUnrollWidth - 1) / kUnrollWidth * kUnrollWidth),
        rates_(static_cast<size_t>(stride_) * (std::max(usual.stages, stable.stages) + 1), 0.0) {
    for (auto* x : {&start_, &end_, &error_, &scale_, &atol_}) {
      x->assign(static_cast<size_t>(stride_), 0.0);
    }
    std::copy_n(NV_DATA_S(system.atol), size_, atol_.begin());
  }

  void set_tolerances(double rtol, N_Vector atol) override {
    rtol_ = rtol;
    std::copy_n(NV_DATA_S(atol), size_, atol_.begin());
  }
  void restart(double t, N_Vector, double h) override {
    t_ = t;
    h_ = h;
    last_error_ = 1.0;
    used_ = &usual_;
    fastest_ = 0.0;
    rated_ = at_end_ = false;
  }
  void set_known(const Stepper::Known& known) override {
    if (known.rates) std::copy_n(known.rates, size_, get_rates(0));
    rated_ = known.rates != nullptr;
    fastest_ = known.fastest_rate;
  }
  double fastest_rate() const override { return fastest_; }
  StepOutcome step(double t_stop, N_Vector y, double& t) override;
  bool interpolate(double t, N_Vector y) override;
  double next_step() const override { return h_; }
  bool has_fixed_step() const override { return fixed_; }

 private:
  double* get_rates(int stage) { return rates_.data() + stage * stride_; }
  bool calc_rates(double t, const double* y, int stage) {
    return system_.calc_rates(t, y, get_rates(stage)) == 0;
  }
  void add_up(const double* weight, int count, double h, const double* base, double* sum) const;
  bool calc_end(double h);
  double find_error(double h);
  double find_norm(const double* weight, double h);
  void choose_method(double room);
  void update_fastest_rate(double h);
  bool find_first_step(double room);
  std::int64_t present_steps() const override { return steps_; }
  std::int64_t present_rejected() const override { return rejected_; }

  System& system_;
  const Method usual_, stable_;
  const Method* used_ = &usual_;  // in the last step
  const bool fixed_;
  const int size_, stride_;
  std::vector<double> rates_;        // of the stages, one after another; last: at the end
  std::vector<double> start_, end_;  // of the step
  std::vector<double> error_;        // scratch
  std::vector<double> scale_;        // 1/(rtol |y| + atol)
  std::vector<double> atol_;
  double rtol_ = 1e-6;
  double t_ = 0.0, h_ = 0.0;  // end of the last step, size of the next one [s]
  double made_ = 0.0;         // size of the last one [s]
  double last_error_ = 1.0;   // of the step before, in tolerances
  double fastest_ = 0.0;      // rate of the solution [1/s]; 0 = not known
  bool rated_ = false;        // stage 0 holds the rates at t_
  bool at_end_ = false;       // the last stage does
  std::int64_t steps_ = 0, rejected_ = 0;
};

/// sum = base + h * (weights times rates)
void ExplicitSolver::add_up(const double* weight, int count, double h, const double* base,
                            double* sum) const {
  for (int i = 0; i < stride_; i += kUnrollWidth) {
    double s[kUnrollWidth] = {};
    const double* rates = rates_.data() + i;
    for (int j = 0; j < count; ++j, rates += stride_) {
      for (int l = 0; l < kUnrollWidth; ++l) s[l] += weight[j] * rates[l];
    }
    for (int l = 0; l < kUnrollWidth; ++l) sum[i + l] = base[i + l] + h * s[l];
  }
}

/// All stages but the last, and the state at the end.
bool ExplicitSolver::calc_end(double h) {
  const RungeKuttaTable& table = used_->table;
  const double* a = table.a;
  for (int i = 1; i < table.stages; a += i++) {
    add_up(a, i, h, start_.data(), end_.data());
    if (!calc_rates(t_ + used_->c[i] * h, end_.data(), i)) return false;
  }
  add_up(table.b, table.stages, h, start_.data(), end_.data());
  return true;
}

/// Sum of squares of an estimate, in tolerances.
double ExplicitSolver::find_norm(const double* weight, double h) {
  std::fill(error_.begin(), error_.end(), 0.0);
  add_up(weight, used_->table.stages + 1, h, error_.data(), error_.data());
  double sum = 0.0;
  for (int i = 0; i < size_; ++i) {
    const double e = error_[i] * scale_[i];
    sum += e * e;
  }
  return sum;
}

/// Estimated error of the step, in tolerances (root mean square).
double ExplicitSolver::find_error(double h) {
  const RungeKuttaTable& table = used_->table;
  const double high = find_norm(table.error, h);
  if (!table.low_error) return std::sqrt(high / size_);
  const double low = find_norm(table.low_error, h);
  const double both = high + 0.01 * low;  // as DOP853 has it
  return both > 0.0 ? high / std::sqrt(both * size_) : 0.0;
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
  fastest_ = std::max(std::isfinite(seen) ? seen : 0.0, kFade * fastest_);
}

/// Without a proposal: a step in which the state bends away from its tangent by one tolerance,
/// found from a short one. In other units of time it is the same step (as that of CVODE).
bool ExplicitSolver::find_first_step(double room) {
  const auto find_size = [this](const double* x) {
    double sum = 0.0;
    for (int i = 0; i < size_; ++i) sum += x[i] * scale_[i] * (x[i] * scale_[i]);
    return std::sqrt(sum / size_);
  };
  const double y = std::max(1.0, find_size(start_.data())), speed = find_size(get_rates(0));
  const double h = 0.01 * y < room * speed ? 0.01 * y / speed : 0.01 * room;
  const double one = 1.0;
  add_up(&one, 1, h, start_.data(), end_.data());
  if (!calc_rates(t_ + h, end_.data(), 1)) return false;
  for (int i = 0; i < size_; ++i) error_[i] = (get_rates(1)[i] - get_rates(0)[i]) / h;
  const double bend = find_size(error_.data());
  h_ = std::min({100.0 * h, bend * room * room > 2.0 ? std::sqrt(2.0 / bend) : room, room});
  return true;
}

StepOutcome ExplicitSolver::step(double t_stop, N_Vector y, double& t) {
  if (at_end_) std::copy_n(get_rates(used_->table.stages), size_, get_rates(0));
  std::copy_n(NV_DATA_S(y), size_, start_.begin());
  if (!rated_ && !at_end_ && !calc_rates(t_, start_.data(), 0)) return StepOutcome::kFailed;
  rated_ = true;
  at_end_ = false;
  for (int i = 0; i < size_; ++i) scale_[i] = 1.0 / (rtol_ * std::abs(start_[i]) + atol_[i]);
  const double room = t_stop - t_;
  if (!(room > 0.0)) return StepOutcome::kStopped;
  if (!fixed_ && !(h_ > 0.0) && !find_first_step(room)) return StepOutcome::kFailed;
  bool grows = true;
  for (int tries = 0; tries < kMaxRejected; ++tries) {
    choose_method(room);
    const int order = used_->table.error_order, stages = used_->table.stages;
    // What is left is divided evenly: a last step that is much shorter would be wasted.
    const bool stops = h_ >= room * (1.0 - 1e-12);
    const double h = stops ? room : std::min(h_, 0.5 * room);
    if (!(t_ + h != t_)) return StepOutcome::kFailed;
    if (!calc_end(h)) return StepOutcome::kFailed;
    double factor = 1.0;
    if (!fixed_) {
      if (!calc_rates(t_ + h, end_.data(), stages)) return StepOutcome::kFailed;
      update_fastest_rate(h);
      const double error = find_error(h);
      if (!(error <= 1.0)) {
        ++rejected_;
        const double shrink = std::pow(kBias * error, -1.0 / (order + 1));
        h_ = h * (shrink > kShrink ? std::min(0.9, kSafety * shrink) : kShrink);
        grows = false;
        continue;
      }
      const double now = std::max(kBias * error, 1e-10);
      factor = kSafety * std::pow(now, -kProportional / order) *
               std::pow(last_error_, kIntegral / order);
      factor = std::clamp(factor, kShrink, grows ? kGrowth : 1.0);
      last_error_ = now;
      at_end_ = true;
    }
    rated_ = false;
    made_ = h;
    h_ = h * factor;
    t_ = stops ? t_stop : t_ + h;
    t = t_;
    std::copy_n(end_.begin(), size_, NV_DATA_S(y));
    ++steps_;
    return stops ? StepOutcome::kStopped : StepOutcome::kStepped;
  }
  return StepOutcome::kFailed;
}

bool ExplicitSolver::interpolate(double t, N_Vector y) {
  if (fixed_) return true;  // no roots are searched inside
  if (!at_end_) return false;
  const double s = 1.0 - (t_ - t) / made_, r = 1.0 - s;
  const int stages = used_->table.stages;
  add_up(used_->table.dense, stages + 1, made_ * s * s * r * r, start_.data(), error_.data());
  const double *first = get_rates(0), *last = get_rates(stages);
  for (int i = 0; i < size_; ++i) {
    const double way = end_[i] - start_[i];
    const double bend = r * (made_ * first[i] - way) + s * (way - made_ * last[i]);
    NV_Ith_S(y, i) = error_[i] + s * (way + r * bend);
  }
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
