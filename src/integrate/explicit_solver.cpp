// Explicit Runge-Kutta steps, adaptive or of fixed size, by the tables of runge_kutta.hpp.
//
// They are our own because evaluations have become so cheap that the vectors of ERKStep cost as
// much again (tests/benchmarks/stepper_bench.cpp). Step sizes follow the PI controller of ARKODE
// with its constants. The end of a step is evaluated last: it is the first stage of the next step,
// and who asks what holds there finds everything computed.
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
constexpr int kLanes = 4;                        ///< states that are added up together

class ExplicitSolver : public Solver {
 public:
  ExplicitSolver(System& system, const RungeKuttaTable& table, bool fixed)
      : system_(system),
        table_(table),
        fixed_(fixed),
        size_(system.problem.size),
        stride_((size_ + kLanes - 1) / kLanes * kLanes),
        rates_(static_cast<size_t>(stride_) * (table.stages + 1), 0.0),
        c_(table.stages, 0.0) {
    for (auto* x : {&start_, &end_, &error_, &scale_, &atol_}) {
      x->assign(static_cast<size_t>(stride_), 0.0);
    }
    std::copy_n(NV_DATA_S(system.atol), size_, atol_.begin());
    const double* a = table_.a;
    for (int i = 1; i < table_.stages; a += i++) {
      for (int j = 0; j < i; ++j) c_[i] += a[j];
    }
  }

  void set_tolerances(double rtol, N_Vector atol) override {
    rtol_ = rtol;
    std::copy_n(NV_DATA_S(atol), size_, atol_.begin());
  }
  void restart(double t, N_Vector, double h) override {
    t_ = t;
    h_ = h;
    last_error_ = 1.0;
    rated_ = at_end_ = false;
  }
  void set_rates(const double* rates) override {
    std::copy_n(rates, size_, get_rates(0));
    rated_ = true;
  }
  StepOutcome step(double t_stop, N_Vector y, double& t) override;
  bool interpolate(double t, N_Vector y) override;
  double next_step() const override { return h_; }

 private:
  double* get_rates(int stage) { return rates_.data() + stage * stride_; }
  bool calc_rates(double t, const double* y, int stage) {
    return system_.calc_rates(t, y, get_rates(stage)) == 0;
  }
  void add_up(const double* weight, int count, double h, const double* base, double* sum) const;
  bool calc_end(double h);
  double find_error(double h);
  double find_norm(const double* weight, double h);
  bool find_first_step(double room);
  long present_steps() const override { return steps_; }
  long present_rejected() const override { return rejected_; }

  System& system_;
  const RungeKuttaTable table_;
  const bool fixed_;
  const int size_, stride_;
  std::vector<double> rates_;  // of the stages, one after another; last: at the end
  std::vector<double> c_;
  std::vector<double> start_, end_;  // of the step
  std::vector<double> error_;        // scratch
  std::vector<double> scale_;        // 1/(rtol |y| + atol)
  std::vector<double> atol_;
  double rtol_ = 1e-6;
  double t_ = 0.0, h_ = 0.0;     // end of the last step, size of the next one [s]
  double made_ = 0.0;            // size of the last one [s]
  double last_error_ = 1.0;      // of the step before, in tolerances
  bool rated_ = false;           // stage 0 holds the rates at t_
  bool at_end_ = false;          // the last stage does
  long steps_ = 0, rejected_ = 0;
};

/// sum = base + h * (weights times rates)
void ExplicitSolver::add_up(const double* weight, int count, double h, const double* base,
                            double* sum) const {
  for (int i = 0; i < stride_; i += kLanes) {
    double s[kLanes] = {};
    const double* rates = rates_.data() + i;
    for (int j = 0; j < count; ++j, rates += stride_) {
      for (int l = 0; l < kLanes; ++l) s[l] += weight[j] * rates[l];
    }
    for (int l = 0; l < kLanes; ++l) sum[i + l] = base[i + l] + h * s[l];
  }
}

/// All stages but the last, and the state at the end.
bool ExplicitSolver::calc_end(double h) {
  const double* a = table_.a;
  for (int i = 1; i < table_.stages; a += i++) {
    add_up(a, i, h, start_.data(), end_.data());
    if (!calc_rates(t_ + c_[i] * h, end_.data(), i)) return false;
  }
  add_up(table_.b, table_.stages, h, start_.data(), end_.data());
  return true;
}

/// Sum of squares of an estimate, in tolerances.
double ExplicitSolver::find_norm(const double* weight, double h) {
  std::fill(error_.begin(), error_.end(), 0.0);
  add_up(weight, table_.stages + 1, h, error_.data(), error_.data());
  double sum = 0.0;
  for (int i = 0; i < size_; ++i) {
    const double e = error_[i] * scale_[i];
    sum += e * e;
  }
  return sum;
}

/// Estimated error of the step, in tolerances (root mean square).
double ExplicitSolver::find_error(double h) {
  const double high = find_norm(table_.error, h);
  if (!table_.low_error) return std::sqrt(high / size_);
  const double low = find_norm(table_.low_error, h);
  const double both = high + 0.01 * low;  // as DOP853 has it
  return both > 0.0 ? high / std::sqrt(both * size_) : 0.0;
}

/// Where nobody says: from the sizes of rates and of their change (Hairer, Norsett, Wanner, II.4).
bool ExplicitSolver::find_first_step(double room) {
  const auto find_size = [this](const double* x) {
    double sum = 0.0;
    for (int i = 0; i < size_; ++i) sum += x[i] * scale_[i] * (x[i] * scale_[i]);
    return std::sqrt(sum / size_);
  };
  const double y = find_size(start_.data()), speed = find_size(get_rates(0));
  double h = y > 1e-5 && speed > 1e-5 ? 0.01 * y / speed : 1e-6;
  h = std::min(h, room);
  const double one = 1.0;
  add_up(&one, 1, h, start_.data(), end_.data());
  if (!calc_rates(t_ + h, end_.data(), 1)) return false;
  for (int i = 0; i < size_; ++i) error_[i] = (get_rates(1)[i] - get_rates(0)[i]) / h;
  const double most = std::max(speed, find_size(error_.data()));
  const double wanted =
      most > 1e-15 ? std::pow(0.01 / most, 1.0 / (table_.error_order + 1)) : std::max(1e-6, 1e-3 * h);
  h_ = std::min({100.0 * h, wanted, room});
  return true;
}

StepOutcome ExplicitSolver::step(double t_stop, N_Vector y, double& t) {
  if (at_end_) std::copy_n(get_rates(table_.stages), size_, get_rates(0));
  std::copy_n(NV_DATA_S(y), size_, start_.begin());
  if (!rated_ && !at_end_ && !calc_rates(t_, start_.data(), 0)) return StepOutcome::kFailed;
  rated_ = true;
  at_end_ = false;
  for (int i = 0; i < size_; ++i) scale_[i] = 1.0 / (rtol_ * std::abs(start_[i]) + atol_[i]);
  const double room = t_stop - t_;
  if (!fixed_ && !(h_ > 0.0) && !find_first_step(room)) return StepOutcome::kFailed;
  bool grows = true;
  for (int tries = 0; tries < kMaxRejected; ++tries) {
    // What is left is divided evenly: a last step that is much shorter would be wasted.
    const bool stops = h_ >= room * (1.0 - 1e-12);
    const double h = stops ? room : std::min(h_, 0.5 * room);
    if (!(t_ + h != t_)) return StepOutcome::kFailed;
    if (!calc_end(h)) return StepOutcome::kFailed;
    double factor = 1.0;
    if (!fixed_) {
      if (!calc_rates(t_ + h, end_.data(), table_.stages)) return StepOutcome::kFailed;
      const double error = find_error(h);
      if (!(error <= 1.0)) {
        ++rejected_;
        const double shrink = std::pow(kBias * error, -1.0 / (table_.error_order + 1));
        h_ = h * (shrink > kShrink ? std::min(0.9, kSafety * shrink) : kShrink);
        grows = false;
        continue;
      }
      const double now = std::max(kBias * error, 1e-10);
      factor = kSafety * std::pow(now, -kProportional / table_.error_order) *
               std::pow(last_error_, kIntegral / table_.error_order);
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
  if (fixed_) return true;  // nobody looks inside
  if (!at_end_) return false;
  const double s = 1.0 - (t_ - t) / made_, r = 1.0 - s;
  add_up(table_.dense, table_.stages + 1, made_ * s * s * r * r, start_.data(), error_.data());
  const double *first = get_rates(0), *last = get_rates(table_.stages);
  for (int i = 0; i < size_; ++i) {
    const double way = end_[i] - start_[i];
    const double bend = r * (made_ * first[i] - way) + s * (way - made_ * last[i]);
    NV_Ith_S(y, i) = error_[i] + s * (way + r * bend);
  }
  return true;
}

}  // namespace

std::unique_ptr<Solver> make_explicit_solver(System& system, Stepper::Method method) {
  switch (method) {
    case Stepper::Method::kClassicRk4:
      return std::make_unique<ExplicitSolver>(system, get_classic(), true);
    case Stepper::Method::kDop853:
      return std::make_unique<ExplicitSolver>(system, get_dop853(), false);
    case Stepper::Method::kStabilised:
      return std::make_unique<ExplicitSolver>(system, get_stabilised(), false);
    default:
      return std::make_unique<ExplicitSolver>(system, get_dormand_prince(), false);
  }
}

}  // namespace dockloop
