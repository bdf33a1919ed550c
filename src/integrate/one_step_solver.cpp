// See one_step_solver.hpp.
#include "integrate/one_step_solver.hpp"

namespace dockloop {

OneStepSolver::OneStepSolver(System& system, bool fixed, double growth)
    : system_(system),
      fixed_(fixed),
      size_(system.problem.size),
      stride_((size_ + kGroup - 1) / kGroup * kGroup),
      growth_(growth) {
  for (auto* x : {&start_, &end_, &scale_, &atol_}) x->assign(static_cast<size_t>(stride_), 0.0);
  std::copy_n(NV_DATA_S(system.atol), size_, atol_.begin());
}

void OneStepSolver::set_tolerances(double rtol, N_Vector atol) {
  rtol_ = rtol;
  std::copy_n(NV_DATA_S(atol), size_, atol_.begin());
}

void OneStepSolver::restart(double t, N_Vector, double h) {
  t_ = t;
  h_ = h;
  last_error_ = 1.0;
  rated_ = at_end_ = false;
}

StepOutcome OneStepSolver::step(double t_stop, N_Vector y, double& t) {
  if (at_end_) continue_from_end();
  std::copy_n(NV_DATA_S(y), size_, start_.begin());
  if (!rated_ && !at_end_ && !calc_rates(t_, start_.data(), get_first_rates())) {
    return StepOutcome::kFailed;
  }
  rated_ = true;
  at_end_ = false;
  for (int i = 0; i < size_; ++i) scale_[i] = 1.0 / (rtol_ * std::abs(start_[i]) + atol_[i]);
  const double room = t_stop - t_;
  if (!(room > 0.0)) return StepOutcome::kStopped;
  if (!prepare(room)) return StepOutcome::kFailed;
  bool grows = true;
  for (int tries = 0; tries < kMaxRejected; ++tries) {
    choose_method(room);
    // What is left is divided evenly: a last step that is much shorter would be wasted.
    const bool stops = h_ >= room * (1.0 - 1e-12);
    const double h = stops ? room : std::min(h_, 0.5 * room);
    if (!(t_ + h != t_)) return StepOutcome::kFailed;
    if (!calc_end(h)) return StepOutcome::kFailed;
    double factor = 1.0;
    if (!fixed_) {
      double error = 0.0;
      if (!find_error(h, error)) return StepOutcome::kFailed;
      if (!(error <= 1.0)) {
        ++rejected_;
        h_ = h * find_shrink(error);
        grows = false;
        continue;
      }
      if (!calc_last_rates(h)) return StepOutcome::kFailed;
      factor = std::clamp(find_factor(error), kShrink, grows ? growth_ : 1.0);
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

void OneStepSolver::interpolate_cubic(double t, const double* base, const double* first,
                                      const double* last, N_Vector y) const {
  const double s = 1.0 - (t_ - t) / made_, r = 1.0 - s;
  for (int i = 0; i < size_; ++i) {
    const double way = end_[i] - start_[i];
    const double bend = r * (made_ * first[i] - way) + s * (way - made_ * last[i]);
    NV_Ith_S(y, i) = base[i] + s * (way + r * bend);
  }
}

}  // namespace dockloop
