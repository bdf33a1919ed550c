// ARKODE behind ErkStepper: Dormand-Prince 5(4), seven stages, user tolerances per component.
#include "integrate/erk_stepper.hpp"

#include <arkode/arkode_erkstep.h>
#include <nvector/nvector_serial.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace dockloop {

struct ErkStepper::Impl {
  Problem problem;
  SUNContext context = nullptr;
  N_Vector y = nullptr, atol = nullptr;
  void* ark = nullptr;
  double t = 0.0;
  double t_restart = 0.0, h_restart = 0.0;
  bool watch_roots = false;
  int trouble = 0;  // what the rates said last
  std::vector<int> root_info;
  std::vector<double> y_before;

  explicit Impl(Problem p) : problem(std::move(p)) {
    root_info.assign(static_cast<size_t>(std::max(1, problem.root_count)), 0);
    y_before.assign(static_cast<size_t>(problem.size), 0.0);
    check(SUNContext_Create(nullptr, &context));
    y = N_VNew_Serial(problem.size, context);
    atol = N_VNew_Serial(problem.size, context);
    if (!y || !atol) throw std::runtime_error("SUNDIALS vectors cannot be allocated");
    N_VConst(0.0, y);
    N_VConst(1e-8, atol);
    ark = ERKStepCreate(&call_rates, 0.0, y, context);
    if (!ark) throw std::runtime_error("ARKODE cannot be created");
    check(ERKStepSetUserData(ark, this));
    check(ERKStepSetTableNum(ark, ARKODE_DORMAND_PRINCE_7_4_5));
    check(ERKStepSVtolerances(ark, 1e-6, atol));
    check(ERKStepSetErrHandlerFn(ark, &ignore_message, nullptr));
    check(ERKStepSetMaxNumSteps(ark, -1));
    check(ERKStepSetMaxErrTestFails(ark, 20));
    if (problem.root_count > 0) {
      check(ERKStepRootInit(ark, problem.root_count, &call_roots));
      std::vector<int> falling(static_cast<size_t>(problem.root_count), -1);
      check(ERKStepSetRootDirection(ark, falling.data()));
      check(ERKStepSetNoInactiveRootWarn(ark));
    }
  }

  ~Impl() {
    if (ark) ERKStepFree(&ark);
    if (y) N_VDestroy(y);
    if (atol) N_VDestroy(atol);
    if (context) SUNContext_Free(&context);
  }

  static void check(int flag) {
    if (flag < 0) throw std::runtime_error("ARKODE refused a setting");
  }
  static int call_rates(realtype t, N_Vector y, N_Vector ydot, void* self) {
    Impl& me = *static_cast<Impl*>(self);
    const int trouble = me.problem.rates(t, NV_DATA_S(y), NV_DATA_S(ydot));
    if (trouble > 0) me.trouble = trouble;
    return trouble;
  }
  static int call_roots(realtype t, N_Vector y, realtype* roots, void* self) {
    Impl& me = *static_cast<Impl*>(self);
    if (me.watch_roots) return me.problem.roots(t, NV_DATA_S(y), roots);
    std::fill(roots, roots + me.problem.root_count, 1.0);
    return 0;
  }
  static void ignore_message(int, const char*, const char*, char*, void*) {}
};

ErkStepper::ErkStepper(Problem problem) : impl_(new Impl(std::move(problem))) {}
ErkStepper::~ErkStepper() = default;

double* ErkStepper::y() { return NV_DATA_S(impl_->y); }

void ErkStepper::set_tolerances(double rtol, const double* atol) {
  std::copy(atol, atol + impl_->problem.size, NV_DATA_S(impl_->atol));
  Impl::check(ERKStepSVtolerances(impl_->ark, rtol, impl_->atol));
}

void ErkStepper::restart(double t, double h) {
  impl_->t = t;
  impl_->t_restart = t;
  impl_->h_restart = h;
  ERKStepReset(impl_->ark, t, impl_->y);
  ERKStepSetInitStep(impl_->ark, h);
}

StepOutcome ErkStepper::step(double t_stop, bool watch_roots) {
  // A state that cannot be evaluated is cured by a smaller step, from the same start. A pose that
  // must be stepped over is cured by sizes that put no stage on it: some that end well before or
  // beyond it.
  constexpr int kRetries = 24;
  static constexpr std::array<double, 14> kLeaps = {1.5, 1.25, 0.55, 0.45, 0.35, 0.27, 0.2,
                                                    0.7, 0.8,  2.5,  4.0,  6.5,  10.0, 16.0};
  Impl& me = *impl_;
  me.watch_roots = watch_roots;
  const double t_before = me.t;
  double h_first = 0.0;
  size_t leaps = 0;
  std::copy(y(), y() + me.problem.size, me.y_before.begin());
  for (int retry = 0; retry < kRetries;) {
    ERKStepSetStopTime(me.ark, t_stop);
    me.trouble = 0;
    const int flag = ERKStepEvolve(me.ark, t_stop, me.y, &me.t, ARK_ONE_STEP);
    if (flag == ARK_TSTOP_RETURN) {
      me.t = t_stop;
      return StepOutcome::kStopped;
    }
    if (flag == ARK_ROOT_RETURN) {
      ERKStepGetRootInfo(me.ark, me.root_info.data());
      return StepOutcome::kRoot;
    }
    if (flag >= 0) return StepOutcome::kStepped;
    if (retry == 0 && leaps == 0) {
      ERKStepGetCurrentStep(me.ark, &h_first);
      if (!(h_first > 0.0)) h_first = me.h_restart;
      if (!(h_first > 0.0)) h_first = t_stop - t_before;
      h_first = std::min(h_first, t_stop - t_before);
    }
    const bool leap = me.trouble == kStepOver && leaps < kLeaps.size();
    const double factor = leap ? kLeaps[leaps++] : std::pow(0.25, ++retry);
    std::copy(me.y_before.begin(), me.y_before.end(), y());
    restart(t_before, std::min(factor * h_first, t_stop - t_before));
  }
  return StepOutcome::kFailed;
}

double ErkStepper::time() const { return impl_->t; }

double ErkStepper::next_step() const {
  double h = 0.0;
  ERKStepGetCurrentStep(impl_->ark, &h);
  return h;
}

bool ErkStepper::root_found(int i) const { return impl_->root_info[i] != 0; }

long ErkStepper::steps() const {
  long n = 0;
  ERKStepGetNumSteps(impl_->ark, &n);
  return n;
}

long ErkStepper::rejected_steps() const {
  long n = 0;
  ERKStepGetNumErrTestFails(impl_->ark, &n);
  return n;
}

long ErkStepper::rate_evaluations() const {
  long n = 0;
  ERKStepGetNumRhsEvals(impl_->ark, &n);
  return n;
}

}  // namespace dockloop
