// Explicit Runge-Kutta steps with nothing around them, the same for every program that is measured.
//
// Pairs of SUNDIALS' tables, steps chosen by the usual controller on the error estimate. What a
// motion costs here is the price of its rates and no more, so engines without an integrator of
// their own are not charged for those of others.
#pragma once

#include <arkode/arkode_butcher_erk.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace dockloop {

/// How a motion is integrated.
struct Pair {
  const char* name;
  ARKODE_ERKTableID table;
};
constexpr Pair kPairs[] = {{"Dormand-Prince 5", ARKODE_DORMAND_PRINCE_7_4_5},
                           {"Fehlberg 8", ARKODE_FEHLBERG_13_7_8}};

/// @tparam N  number of states
template <int N>
class RungeKutta {
 public:
  using State = std::array<double, N>;

  /// @param tolerance  of a step, relative to 1 + |y|
  RungeKutta(ARKODE_ERKTableID id, double tolerance) : tolerance_(tolerance) {
    const ARKodeButcherTable table = ARKodeButcherTable_LoadERK(id);
    stages_ = static_cast<size_t>(table->stages);
    order_ = std::min(table->q, table->p) + 1;
    rate_.resize(stages_);
    for (size_t i = 0; i < stages_; ++i) {
      a_.emplace_back(table->A[i], table->A[i] + i);
      b_.push_back(table->b[i]);
      error_.push_back(table->b[i] - table->d[i]);
    }
    reuses_last_ = std::equal(b_.begin(), b_.end() - 1, a_.back().begin()) && b_.back() == 0.0;
    ARKodeButcherTable_Free(table);
  }

  /// Advance y from t to exactly t_stop. @param rates  void(const double* y, double* dy)
  template <class Rates>
  void advance(double t, double t_stop, State& y, Rates rates) {
    if (!started_) call(rates, y, rate_[0]);
    started_ = true;
    while (t < t_stop) {
      const bool last = t + h_ * (1.0 + 1e-9) >= t_stop;
      const double h = last ? t_stop - t : h_;
      for (size_t i = 1; i < stages_; ++i) {
        trial_ = y;
        add(h, a_[i], trial_);
        call(rates, trial_, rate_[i]);
      }
      if (!reuses_last_) {
        trial_ = y;
        add(h, b_, trial_);
      }
      State error{};
      add(h, error_, error);
      double sum = 0.0;
      for (size_t j = 0; j < N; ++j) {
        const double part = error[j] / (tolerance_ * (1.0 + std::abs(trial_[j])));
        sum += part * part;
      }
      const double ratio = std::sqrt(sum / N);
      const double change = 0.9 * std::pow(std::max(ratio, 1e-10), -1.0 / order_);
      if (!last || ratio > 1.0 || change < 1.0) h_ = h * std::min(5.0, std::max(0.2, change));
      if (ratio > 1.0) continue;
      t = last ? t_stop : t + h;
      y = trial_;
      if (reuses_last_) {
        rate_[0] = rate_[stages_ - 1];
      } else {
        call(rates, y, rate_[0]);
      }
    }
  }

  long evaluations() const { return evaluations_; }

 private:
  template <class Rates>
  void call(Rates& rates, const State& y, State& dy) {
    rates(y.data(), dy.data());
    ++evaluations_;
  }
  void add(double h, const std::vector<double>& weights, State& y) const {
    for (size_t i = 0; i < weights.size(); ++i) {
      if (weights[i] == 0.0) continue;
      for (size_t j = 0; j < N; ++j) y[j] += h * weights[i] * rate_[i][j];
    }
  }

  double tolerance_, h_ = 1e-3;  ///< [s]
  size_t stages_ = 0;
  int order_ = 0;
  bool reuses_last_ = false, started_ = false;
  long evaluations_ = 0;
  std::vector<std::vector<double>> a_;
  std::vector<double> b_, error_;
  std::vector<State> rate_;
  State trial_;
};

}  // namespace dockloop
