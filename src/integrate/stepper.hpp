// Steps of one initial value problem, one at a time.
//
// Where inputs change the integration starts again, with most methods at every communication point.
// One-step methods do so at no cost, multistep methods with order 1. The stepper never passes the
// stop time it is given, reports roots of event functions inside a step, and keeps no state beyond
// y and the step size when it is restarted: the same y, time, step size and what is known (Known)
// give the same bits.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

namespace dockloop {

class Solver;
struct System;

enum class StepOutcome {
  kStepped,  ///< one step was accepted
  kStopped,  ///< one step was accepted and ends at the stop time
  kRoot,     ///< a root lies inside the step; y is interpolated there: restart() to go on
  kFailed,   ///< no acceptable step; y is as before the call
};

class Stepper {
 public:
  /// What to integrate. `rates` returns 0, or why a state cannot be evaluated:
  static constexpr int kSmaller = 1;   ///< a smaller step may succeed
  static constexpr int kStepOver = 2;  ///< this state only: a step of another size may avoid it
  struct Problem {
    int size = 0;
    int root_count = 0;
    std::function<int(double t, const double* y, double* ydot)> rates;
    std::function<int(double t, const double* y, double* roots)> roots;  ///< roots fall through 0
    /// How fast each event function may change [1/s times its unit] at the state that `roots` was
    /// called for last; 0 = fast enough to be seen at the ends of a step, or not known. Where the
    /// bounds allow that a function is below zero inside a step and above it at both ends, as the
    /// largest of several conditions may be, the step is searched. May be empty.
    std::function<void(double* speeds)> root_speeds;
    /// d rates / d y by columns, for implicit methods; without it SUNDIALS takes differences.
    std::function<int(double t, const double* y, double* jacobian)> jacobian;
    int jacobian_cost = 0;  ///< evaluations of the rates that a Jacobian is counted as
    /// For kRosenbrock: a matrix A near d rates / d y that knows its own structure. Without it A is
    /// zero.
    struct Matrix {
      /// A at a state whose rates have just been asked for. Adds what it costs, in evaluations of
      /// the rates. @return as rates
      std::function<int(double t, const double* y, int& cost)> build;
      /// Prepare `solve` for a g. @return false if 1/g - A has no inverse
      std::function<bool(double g)> factor;
      /// x := (1/g - A)^-1 x
      std::function<void(double* x)> solve;
    } matrix;
    std::function<bool()> depends_on_time;  ///< do rates? For kRosenbrock; empty: they do
    /// Makes a method that is not in the list below (src/compare).
    std::function<std::unique_ptr<Solver>(System&)> solver;
    /// Size of all unknowns of that method, of which y is the first part; 0 = y is all.
    int unknowns = 0;
    double root_tolerance = 1e-14;  ///< of the times of roots, relative
  };

  enum class Method {
    kDormandPrince,  ///< explicit one-step, order 5(4)
    kStabilised,     ///< kDormandPrince, and where stability would limit it a method of order 4(3)
                     ///< with a long interval of stability
    kClassicRk4,     ///< as kDormandPrince of order 4; every step is what restart() asks for
    kRosenbrock,     ///< linearly implicit one-step, L-stable, order 4(3)
    kSwitching,      ///< kStabilised, and kRosenbrock where its steps are longer
    kFixedRosenbrock,  ///< kRosenbrock without error control; steps as those of kClassicRk4
    kBdf,              ///< multistep, stiff, order up to 5
  };

  /// What a method has learned about the solution, and how it goes on.
  struct Pace {
    double fastest_rate = 0.0;  ///< [1/s]; 0 = not known
    double stable = 0.0;        ///< longest explicit step where linearly implicit ones began [s]
    bool is_implicit = false;   ///< the next step is linearly implicit (kSwitching)
    int count = 0;              ///< steps in a row that speak for the other method
    int made = 0, wait = 0;     ///< steps since the last trial, and before the next one
    int stay = 0;               ///< linearly implicit steps before the next look at explicit ones
  };
  /// What is known where the integration starts.
  struct Known {
    const double* rates = nullptr;  ///< there
    Pace pace;                      ///< as pace() reported it last
    double last_error = 1.0;        ///< as last_error() reported it last
    /// By columns, of a state not far away: stands for the first one that an implicit method asks
    /// for. Where Newton iteration fails with it, a new one is made.
    const double* jacobian = nullptr;
  };

  explicit Stepper(Problem problem, Method method = Method::kDormandPrince);
  ~Stepper();
  Stepper(const Stepper&) = delete;
  Stepper& operator=(const Stepper&) = delete;

  double* y();
  /// From now on so many evaluations of the rates are made, and no more: steps fail then.
  void set_evaluation_limit(std::int64_t count);
  /// Did a step fail for that?
  bool is_exhausted() const;
  /// Tolerances: |error_i| <= rtol |y_i| + atol[i] in the root-mean-square sense; for all unknowns.
  void set_tolerances(double rtol, const double* atol);
  /// Start (again) at time t from y() with first step h (0 = choose); multistep methods choose one
  /// that is not longer.
  void restart(double t, double h, const Known& known);
  void restart(double t, double h) { restart(t, h, Known()); }
  /// One step towards t_stop. @param watch_roots report roots of the event functions
  StepOutcome step(double t_stop, bool watch_roots);
  double time() const;
  /// State inside the last step, unless a root cut that short. @return false if it is not known
  bool interpolate(double t, double* y) const;
  /// Slope of interpolate(), of methods that know it.
  bool find_slope(double t, double* slope) const;
  /// Size of a step that passes over a state `distance` ahead, where rates do not exist: no stage
  /// lies near this state [s].
  static double find_size_across(double distance);
  /// Step size that error control proposes for the next step [s].
  double next_step() const;
  Pace pace() const;
  /// Estimated error of the last step, in tolerances; 1 = not known.
  double last_error() const;  ///< kFixedRosenbrock: as estimated, of a step that is kept anyway
  /// All unknowns at the end of the last step; null where y is all.
  const double* unknowns() const;
  /// Event functions found at their root by the step that returned kRoot.
  bool root_found(int i) const;

  std::int64_t steps() const;             ///< accepted, since construction
  std::int64_t rejected_steps() const;    ///< since construction, also where Newton failed
  std::int64_t rate_evaluations() const;  ///< since construction

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dockloop
