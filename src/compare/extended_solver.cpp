// Extrapolated midpoint steps; see extended_solver.hpp.
#include "compare/extended_solver.hpp"

#include <algorithm>
#include <cmath>

namespace dockloop {
namespace {

constexpr double kFirstStep = 1e-3;   ///< where none is asked for [s]
constexpr double kGrowth = 10.0;      ///< at most, from step to step
constexpr double kLeastStep = 1e-15;  ///< relative to the time: steps across jumps

int substeps(int column) { return 2 * (column + 1); }
/// Evaluations for a step of so many columns; that at its start is shared.
double work(int last_column) { return (last_column + 1.0) * (last_column + 2.0) + 1.0; }

bool rounds_to(const std::vector<Extended>& state, const double* y) {
  return std::equal(state.begin(), state.end(), y,
                    [](const Extended& a, double b) { return a.high == b; });
}

void put_rounded(const std::vector<Extended>& state, N_Vector y) {
  std::transform(state.begin(), state.end(), NV_DATA_S(y),
                 [](const Extended& a) { return a.high; });
}

}  // namespace

ExtendedSolver::ExtendedSolver(System& system, Rates rates, double tolerance)
    : system_(system), rates_(std::move(rates)), tolerance_(tolerance) {
  const size_t size = static_cast<size_t>(system.problem.size);
  scale_.assign(size, 1.0);
  for (State* state : {&now_, &start_, &inside_, &plain_, &rate_, &rate_inside_, &lower_, &upper_,
                       &result_, &other_}) {
    state->assign(size, Extended(0));
  }
  for (State& state : column_) state.assign(size, Extended(0));
}

void ExtendedSolver::set_tolerances(double rtol, N_Vector atol) {
  for (size_t i = 0; i < scale_.size(); ++i) scale_[i] = NV_DATA_S(atol)[i] / rtol;
}

void ExtendedSolver::restart(double t, N_Vector y, double h) {
  const double* plain = NV_DATA_S(y);
  if (!rounds_to(now_, plain) && rounds_to(start_, plain)) now_ = start_;
  for (size_t i = 0; i < now_.size(); ++i) {
    if (now_[i].high != plain[i]) now_[i] = plain[i];
  }
  t_ = t;
  proposal_ = h > 0.0 ? h : kFirstStep;
}

const std::vector<Extended>& ExtendedSolver::find_state(const double* y) {
  for (const State* state : {&now_, &start_, &inside_}) {
    if (rounds_to(*state, y)) return *state;
  }
  plain_.assign(y, y + plain_.size());
  return plain_;
}

StepOutcome ExtendedSolver::step(double t_stop, N_Vector y, double& t) {
  start_ = now_;
  t_start_ = t_;
  if (!advance(now_, t_, t_stop, proposal_)) return StepOutcome::kFailed;
  ++count_;
  put_rounded(now_, y);
  t = t_;
  return t_ == t_stop ? StepOutcome::kStopped : StepOutcome::kStepped;
}

bool ExtendedSolver::interpolate(double t, N_Vector y) {
  inside_ = start_;
  double at = t_start_, h = t - t_start_;
  while (at < t) {
    if (!advance(inside_, at, t, h)) return false;
  }
  put_rounded(inside_, y);
  return true;
}

/// One step of y from t, not beyond t_stop. @param[in,out] h  wanted; proposed for the next one
bool ExtendedSolver::advance(State& y, double& t, double t_stop, double& h) {
  if (!calc_rates(t, y, rate_)) return false;
  for (bool refused = false;; refused = true) {
    const double left = t_stop - t;
    const double end = h >= left ? t_stop : t + (h > 0.5 * left ? 0.5 * left : h);
    if (!(end > t)) return false;
    const Trial trial = extrapolate(y, t, end);
    const double least = kLeastStep * std::max(std::abs(end), kFirstStep);
    if (trial.accepted || (trial.usable && end - t <= least)) {
      // Halves of a refused step are made one after the other.
      h = refused ? std::min(end - t, trial.h) : trial.h;
      y = result_;
      t = end;
      return true;
    }
    ++count_rejected_;
    h = trial.h;
  }
}

/// A step of y from t to `end`. @pre rate_ is that at the start. @post result_, if accepted
ExtendedSolver::Trial ExtendedSolver::extrapolate(const State& y, double t, double end) {
  const Extended h = Extended(end) - t;
  double error_before = 0.0, best_rate = 0.0, best_step = 0.0;
  for (int k = 0; k < kColumns; ++k) {
    if (!make_midpoint_steps(y, t, h, substeps(k), result_)) return {false, false, 0.25 * h.high};
    // Aitken and Neville: column_[j] is the extrapolation from the last j + 1 results.
    for (int j = 1; j <= k; ++j) {
      const Extended ratio = Extended(substeps(k)) / substeps(k - j);
      const Extended factor = Extended(1) / (ratio * ratio - 1);
      for (size_t i = 0; i < y.size(); ++i) {
        other_[i] = result_[i] + (result_[i] - column_[j - 1][i]) * factor;
      }
      std::swap(column_[j - 1], result_);
      std::swap(result_, other_);
    }
    column_[k] = result_;
    if (k == 0) continue;
    const double error = std::max(find_error(column_[k - 1], result_, y), 1e-30);
    if (!std::isfinite(error)) return {false, false, 0.25 * h.high};
    // The step at which k columns would do, and what it costs per second.
    const double step = h.high * 0.9 * std::pow(0.5 / error, 1.0 / (2 * k + 1));
    if (step / work(k) > best_rate) {
      best_rate = step / work(k);
      best_step = step;
      if (error <= 1.0) best_step *= work(std::min(k + 1, kColumns - 1)) / work(k);
    }
    if (error <= 1.0 && k > 1) return {true, true, std::min(best_step, kGrowth * h.high)};
    // What the last column can reach, if columns go on to gain as a smooth problem does.
    double reach = error, gain = k > 1 ? error / error_before : 0.0;
    for (int j = k + 1; j < kColumns && k > 1; ++j) {
      const double ratio = static_cast<double>(substeps(j - 1)) / substeps(j);
      gain *= ratio * ratio;
      reach *= gain;
    }
    error_before = error;
    if (k > 1 && !(reach <= 1.0)) break;
  }
  return {false, true, 0.5 * h.high};
}

/// The midpoint rule in `count` equal steps, then Gragg's mean of three: it takes the rates at the
/// end too, and so sees a kink in the last substep. @pre rate_
bool ExtendedSolver::make_midpoint_steps(const State& y, const Extended& t, const Extended& h,
                                         int count, State& end) {
  const Extended part = h / count, twice = part * 2.0;
  lower_ = y;
  for (size_t i = 0; i < y.size(); ++i) upper_[i] = y[i] + part * rate_[i];
  for (int m = 1; m < count; ++m) {
    if (!calc_rates(t + part * m, upper_, rate_inside_)) return false;
    for (size_t i = 0; i < y.size(); ++i) lower_[i] += twice * rate_inside_[i];
    std::swap(lower_, upper_);
  }
  if (!calc_rates(t + h, upper_, rate_inside_)) return false;
  for (size_t i = 0; i < y.size(); ++i) {
    end[i] = (lower_[i] + upper_[i] + part * rate_inside_[i]) * 0.5;
  }
  return true;
}

bool ExtendedSolver::calc_rates(const Extended& t, const State& y, State& ydot) {
  if (system_.idle) {
    std::fill(ydot.begin(), ydot.end(), Extended(0));
    return true;
  }
  ++system_.evaluations;
  const int failure = rates_(t, y.data(), ydot.data());
  if (failure > 0) system_.failure = failure;
  return failure == 0;
}

/// Largest difference of two results, in units of what is tolerated.
double ExtendedSolver::find_error(const State& before, const State& after,
                                  const State& start) const {
  double largest = 0.0;
  for (size_t i = 0; i < start.size(); ++i) {
    const double size = std::max(std::abs(start[i].high), std::abs(after[i].high)) + scale_[i];
    const double error = std::abs((after[i] - before[i]).high) / (tolerance_ * size);
    if (!(error <= largest)) largest = error;
  }
  return largest;
}

}  // namespace dockloop
