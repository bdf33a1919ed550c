// ARKODE behind ErkStepper: Dormand-Prince 5(4), seven stages, user tolerances per component; or
// the classic four-stage method with fixed steps. Roots are searched here, on ARKODE's dense
// output: its own search remembers, beyond a reset, that there was a root once, and a run restored
// in a fresh integrator would not give the same bits.
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
  Method method;
  SUNContext context = nullptr;
  N_Vector y = nullptr, atol = nullptr;
  void* ark = nullptr;
  double t = 0.0;
  double h_restart = 0.0;
  bool restarted = true;  // no step was made since restart()
  int trouble = 0;        // what the rates said last
  bool idle = false;      // the rates are zero
  long idle_steps = 0, idle_evaluations = 0;
  std::vector<double> low, high, middle;  // event functions at both ends of a step, and inside
  bool low_valid = false;                 // low is that of the present state
  N_Vector y_inside = nullptr;
  std::vector<char> root_info;
  std::vector<double> y_before;

  Impl(Problem p, Method m) : problem(std::move(p)), method(m) {
    const size_t roots = static_cast<size_t>(problem.root_count);
    root_info.assign(roots, 0);
    for (auto* values : {&low, &high, &middle}) values->assign(roots, 0.0);
    y_before.assign(static_cast<size_t>(problem.size), 0.0);
    check(SUNContext_Create(nullptr, &context));
    y = N_VNew_Serial(problem.size, context);
    atol = N_VNew_Serial(problem.size, context);
    y_inside = N_VNew_Serial(problem.size, context);
    if (!y || !atol || !y_inside) throw std::runtime_error("SUNDIALS vectors cannot be allocated");
    N_VConst(0.0, y);
    N_VConst(1e-8, atol);
    ark = ERKStepCreate(&call_rates, 0.0, y, context);
    if (!ark) throw std::runtime_error("ARKODE cannot be created");
    check(ERKStepSetUserData(ark, this));
    if (method == Method::kClassicRk4) {
      set_classic_table();
    } else {
      check(ERKStepSetTableNum(ark, ARKODE_DORMAND_PRINCE_7_4_5));
    }
    check(ERKStepSVtolerances(ark, 1e-6, atol));
    check(ERKStepSetErrHandlerFn(ark, &ignore_message, nullptr));
    check(ERKStepSetMaxNumSteps(ark, -1));
    check(ERKStepSetMaxErrTestFails(ark, 20));
    // The first step may grow like any other: a run that goes on in a new integrator must give the
    // same bits.
    check(ERKStepSetMaxGrowth(ark, 25.0));
    check(ERKStepSetMaxFirstGrowth(ark, 25.0));
  }

  ~Impl() {
    if (ark) ERKStepFree(&ark);
    if (y) N_VDestroy(y);
    if (atol) N_VDestroy(atol);
    if (y_inside) N_VDestroy(y_inside);
    if (context) SUNContext_Free(&context);
  }

  void set_classic_table() {
    double c[] = {0.0, 0.5, 0.5, 1.0};
    double A[] = {0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1, 0};
    double b[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    ARKodeButcherTable table = ARKodeButcherTable_Create(4, 4, 0, c, A, b, nullptr);
    if (!table) throw std::runtime_error("a table of ARKODE cannot be created");
    const int flag = ERKStepSetTable(ark, table);
    ARKodeButcherTable_Free(table);
    check(flag);
  }

  static void check(int flag) {
    if (flag < 0) throw std::runtime_error("ARKODE refused a setting");
  }
  static int call_rates(realtype t, N_Vector y, N_Vector ydot, void* self) {
    Impl& me = *static_cast<Impl*>(self);
    if (me.idle) {
      N_VConst(0.0, ydot);
      return 0;
    }
    const int trouble = me.problem.rates(t, NV_DATA_S(y), NV_DATA_S(ydot));
    if (trouble > 0) me.trouble = trouble;
    return trouble;
  }
  bool find_roots(double at, N_Vector state, std::vector<double>& values) {
    return problem.roots(at, NV_DATA_S(state), values.data()) == 0;
  }

  /// Does an event function fall through zero in the step from low to high? Then t is set to where
  /// the first one has done so, y to the state there. @return false if a state cannot be evaluated
  bool search_roots(double t_before, bool& found) {
    found = false;
    for (size_t i = 0; i < low.size(); ++i) {
      root_info[i] = low[i] > 0.0 && high[i] <= 0.0;
      found = found || root_info[i];
    }
    if (!found) return true;
    // The least of those that cross, each relative to where it started, crosses first. Illinois.
    const auto least = [this](const std::vector<double>& values) {
      double smallest = 1.0;
      for (size_t i = 0; i < values.size(); ++i) {
        if (root_info[i]) smallest = std::min(smallest, values[i] / low[i]);
      }
      return smallest;
    };
    double a = t_before, b = t, fa = 1.0, fb = least(high);
    const double tolerance = 1e-14 * (std::abs(t) + (t - t_before));
    int side = 0;
    for (int i = 0; i < 100 && b - a > tolerance && fb < 0.0; ++i) {
      double c = (fa * b - fb * a) / (fa - fb);
      if (!(c > a + 0.5 * tolerance)) c = a + 0.5 * tolerance;
      if (!(c < b - 0.5 * tolerance)) c = b - 0.5 * tolerance;
      if (ERKStepGetDky(ark, c, 0, y_inside) != ARK_SUCCESS) return false;
      if (!find_roots(c, y_inside, middle)) return false;
      const double fc = least(middle);
      if (fc > 0.0) {
        a = c;
        fa = fc;
        if (side == 1) fb *= 0.5;
        side = 1;
      } else {
        b = c;
        fb = fc;
        if (side == -1) fa *= 0.5;
        side = -1;
        high = middle;
      }
    }
    for (size_t i = 0; i < high.size(); ++i) root_info[i] = root_info[i] && high[i] <= 0.0;
    if (b < t) {
      if (ERKStepGetDky(ark, b, 0, y) != ARK_SUCCESS) return false;
      t = b;
    }
    return true;
  }

  static void ignore_message(int, const char*, const char*, char*, void*) {}
};

ErkStepper::ErkStepper(Problem problem, Method method)
    : impl_(new Impl(std::move(problem), method)) {
  // ARKODE allocates in its first step: make one that leads nowhere.
  Impl& me = *impl_;
  me.idle = true;
  restart(0.0, 1.0);
  ERKStepSetStopTime(me.ark, 1.0);
  Impl::check(ERKStepEvolve(me.ark, 1.0, me.y, &me.t, ARK_ONE_STEP));
  Impl::check(ERKStepGetDky(me.ark, 0.5, 0, me.y_inside));
  me.idle_steps = steps();
  me.idle_evaluations = rate_evaluations();
  me.idle = false;
}
ErkStepper::~ErkStepper() = default;

double* ErkStepper::y() { return NV_DATA_S(impl_->y); }

void ErkStepper::set_tolerances(double rtol, const double* atol) {
  std::copy(atol, atol + impl_->problem.size, NV_DATA_S(impl_->atol));
  Impl::check(ERKStepSVtolerances(impl_->ark, rtol, impl_->atol));
}

void ErkStepper::restart(double t, double h) {
  impl_->t = t;
  impl_->h_restart = h;
  impl_->restarted = true;
  impl_->low_valid = false;
  ERKStepReset(impl_->ark, t, impl_->y);
  if (impl_->method == Method::kClassicRk4) {
    ERKStepSetFixedStep(impl_->ark, h);
  } else {
    ERKStepSetInitStep(impl_->ark, h);
  }
}

StepOutcome ErkStepper::step(double t_stop, bool watch_roots) {
  // A state that cannot be evaluated is cured by a smaller step, from the same start. A pose that
  // must be stepped over is cured by sizes that put no stage on it: some that end well before or
  // beyond it.
  constexpr int kRetries = 24;
  static constexpr std::array<double, 14> kLeaps = {1.5, 1.25, 0.55, 0.45, 0.35, 0.27, 0.2,
                                                    0.7, 0.8,  2.5,  4.0,  6.5,  10.0, 16.0};
  Impl& me = *impl_;
  const bool watch = watch_roots && !me.low.empty();
  const double t_before = me.t;
  double h_first = 0.0;
  size_t leaps = 0;
  std::copy(y(), y() + me.problem.size, me.y_before.begin());
  if (watch && !me.low_valid && !me.find_roots(me.t, me.y, me.low)) return StepOutcome::kFailed;
  for (int retry = 0; retry < kRetries;) {
    ERKStepSetStopTime(me.ark, t_stop);
    me.trouble = 0;
    const int flag = ERKStepEvolve(me.ark, t_stop, me.y, &me.t, ARK_ONE_STEP);
    if (flag == ARK_TSTOP_RETURN) me.t = t_stop;
    bool found = false;
    if (flag >= 0 &&
        (!watch || (me.find_roots(me.t, me.y, me.high) && me.search_roots(t_before, found)))) {
      me.restarted = false;
      me.low_valid = watch && !found;
      if (me.low_valid) std::swap(me.low, me.high);
      if (found) return StepOutcome::kRoot;
      return flag == ARK_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
    }
    if (me.method == Method::kClassicRk4) return StepOutcome::kFailed;  // no other size is allowed
    if (retry == 0 && leaps == 0) {
      // ARKODE still holds the size of the step before a restart.
      if (me.restarted) {
        h_first = me.h_restart;
      } else {
        ERKStepGetCurrentStep(me.ark, &h_first);
      }
      if (!(h_first > 0.0)) h_first = t_stop - t_before;
      h_first = std::min(h_first, t_stop - t_before);
    }
    const bool leap = me.trouble == kStepOver && leaps < kLeaps.size();
    const double factor = leap ? kLeaps[leaps++] : std::pow(0.25, ++retry);
    std::copy(me.y_before.begin(), me.y_before.end(), y());
    restart(t_before, std::min(factor * h_first, t_stop - t_before));
    me.low_valid = watch;  // the start is where it was
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
  return n - impl_->idle_steps;
}

long ErkStepper::rejected_steps() const {
  long n = 0;
  ERKStepGetNumErrTestFails(impl_->ark, &n);
  return n;
}

long ErkStepper::rate_evaluations() const {
  long n = 0;
  ERKStepGetNumRhsEvals(impl_->ark, &n);
  return n - impl_->idle_evaluations;
}

}  // namespace dockloop
