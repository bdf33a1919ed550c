// Explicit Runge-Kutta steps by SUNDIALS ARKODE, adaptive or of fixed size, one at a time.
//
// A one-step method restarts at no cost, which is what co-simulation asks for: every communication
// point is a stop, and inputs may change there. The stepper never passes the stop time it is given,
// reports roots of event functions inside a step, and keeps no state beyond y and the step size:
// the same y, time and step size give the same bits.
#pragma once

#include <functional>
#include <memory>

namespace dockloop {

enum class StepOutcome {
  kStepped,  ///< one step was accepted
  kStopped,  ///< one step was accepted and ends at the stop time
  kRoot,     ///< a root lies inside the step; y is interpolated there
  kFailed,   ///< no acceptable step; y is as before the call
};

class ErkStepper {
 public:
  /// What to integrate. `rates` returns 0, or why a state cannot be evaluated:
  static constexpr int kSmaller = 1;   ///< a smaller step, please
  static constexpr int kStepOver = 2;  ///< this state only: a step of another size may avoid it
  struct Problem {
    int size = 0;
    int root_count = 0;
    std::function<int(double t, const double* y, double* ydot)> rates;
    std::function<int(double t, const double* y, double* roots)> roots;  ///< roots fall through 0
  };

  /// kDormandPrince: adaptive, order 5(4). kClassicRk4: every step is what restart() asks for.
  enum class Method { kDormandPrince, kClassicRk4 };

  explicit ErkStepper(Problem problem, Method method = Method::kDormandPrince);
  ~ErkStepper();
  ErkStepper(const ErkStepper&) = delete;
  ErkStepper& operator=(const ErkStepper&) = delete;

  double* y();
  /// Tolerances: |error_i| <= rtol |y_i| + atol[i] in the root-mean-square sense.
  void set_tolerances(double rtol, const double* atol);
  /// Start (again) at time t from y() with first step h (0 = choose).
  void restart(double t, double h);
  /// One step towards t_stop. @param watch_roots report roots of the event functions
  StepOutcome step(double t_stop, bool watch_roots);
  double time() const;
  /// Step size that error control proposes for the next step [s].
  double next_step() const;
  /// Event functions found at their root by the step that returned kRoot.
  bool root_found(int i) const;

  long steps() const;             ///< accepted, since construction
  long rejected_steps() const;    ///< since construction
  long rate_evaluations() const;  ///< since construction

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dockloop
