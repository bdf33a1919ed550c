// Explicit Runge-Kutta steps with nothing around them, the same for every program that is measured.
//
// The pair of Dormand and Prince, steps chosen by the usual controller on the error estimate. What
// a motion costs here is the price of its rates and no more, so engines without an integrator of
// their own are not charged for those of others.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "integrate/runge_kutta.hpp"

namespace dockloop {

/// @tparam N  number of states
template <int N>
class RungeKutta {
 public:
  using State = std::array<double, N>;

  /// @param tolerance  of a step, relative to 1 + |y|
  explicit RungeKutta(double tolerance) : tolerance_(tolerance) {
    const double* a = table_.a;
    for (size_t i = 1; i < kStages; a += i++) a_[i].assign(a, a + i);
    a_[kStages].assign(table_.b, table_.b + kStages);
    error_.assign(table_.error, table_.error + kStages + 1);
  }

  /// Advance y from t to exactly t_stop. @param rates  void(const double* y, double* dy)
  template <class Rates>
  void advance(double t, double t_stop, State& y, Rates rates) {
    if (!started_) call(rates, y, rate_[0]);
    started_ = true;
    while (t < t_stop) {
      const bool last = t + h_ * (1.0 + 1e-9) >= t_stop;
      const double h = last ? t_stop - t : h_;
      for (size_t i = 1; i <= kStages; ++i) {  // the last one is the end
        trial_ = y;
        add(h, a_[i], trial_);
        call(rates, trial_, rate_[i]);
      }
      State error{};
      add(h, error_, error);
      double sum = 0.0;
      for (size_t j = 0; j < N; ++j) {
        const double part = error[j] / (tolerance_ * (1.0 + std::abs(trial_[j])));
        sum += part * part;
      }
      const double ratio = std::sqrt(sum / N);
      const double change = 0.9 * std::pow(std::max(ratio, 1e-10), -1.0 / kOrder);
      if (!last || ratio > 1.0 || change < 1.0) h_ = h * std::min(5.0, std::max(0.2, change));
      if (ratio > 1.0) continue;
      t = last ? t_stop : t + h;
      y = trial_;
      rate_[0] = rate_[kStages];
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

  static constexpr size_t kStages = 6;
  static constexpr double kOrder = 5.0;

  const RungeKuttaTable table_ = get_dormand_prince();
  double tolerance_, h_ = 1e-3;  ///< [s]
  bool started_ = false;
  long evaluations_ = 0;
  std::array<std::vector<double>, kStages + 1> a_;
  std::vector<double> error_;
  std::array<State, kStages + 1> rate_;
  State trial_;
};

}  // namespace dockloop
