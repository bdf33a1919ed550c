// What Stepper asks of a method, and what every method sees of the problem.
//
//   one_step_solver.cpp   what the two methods of our own share
//   explicit_solver.cpp   Runge-Kutta, adaptive or of fixed size (our own; runge_kutta.hpp)
//   rosenbrock_solver.cpp linearly implicit, one matrix a step (our own)
//   switching_solver.cpp  the one or the other, whichever makes longer steps
//   bdf_solver.cpp        multistep (CVODE)
//
// The folder src/compare adds others through Stepper::Problem::solver.
//
// After restart() a solver is as good as new: what it did before leaves no trace in any bit. It
// allocates in its first step only.
#pragma once

#include <nvector/nvector_serial.h>
#include <sundials/sundials_linearsolver.h>
#include <sundials/sundials_matrix.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>

#include "integrate/stepper.hpp"

namespace dockloop {

/// The problem as SUNDIALS calls it. Solvers pass a System as user data.
struct System {
  explicit System(Stepper::Problem problem);
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  /// A new vector, or an exception. To be destroyed by the caller.
  N_Vector make_vector() const;
  /// The rates, counted; not 0 where they cannot be reported.
  int calc_rates(double t, const double* state, double* ydot);
  static int call_rates(realtype t, N_Vector y, N_Vector ydot, void* system);
  static int call_jacobian(realtype t, N_Vector y, N_Vector ydot, SUNMatrix jacobian, void* system,
                           N_Vector, N_Vector, N_Vector);
  static void ignore_message(int, const char*, const char*, char*, void*) {}
  /// @throws std::runtime_error
  static void check(int flag);
  /// No more evaluations: SUNDIALS gives up at a negative value.
  static constexpr int kGiveUp = -1;
  bool is_exhausted() const { return evaluations >= evaluation_limit; }
  /// Counts what is about to be evaluated. @return false if nothing more is to be
  bool spend(int count) {
    if (is_exhausted()) return false;
    evaluations += count;
    return true;
  }
  /// What an evaluation says is kept, and handed on to SUNDIALS.
  int note(int said) {
    if (said > 0) failure = said;
    return said;
  }

  Stepper::Problem problem;
  SUNContext context = nullptr;
  N_Vector y = nullptr;
  N_Vector atol = nullptr;                 ///< of all unknowns
  int failure = 0;                         ///< what the rates said last
  bool idle = false;                       ///< the rates are zero, and nothing is counted
  const double* known_jacobian = nullptr;  ///< for the next call that asks for one; may be null
  std::int64_t evaluations = 0;  ///< of rates; a Jacobian counts as Problem::jacobian_cost
  std::int64_t evaluation_limit = std::numeric_limits<std::int64_t>::max();
};

/// A counter of SUNDIALS. @param get  such as CVodeGetNumSteps
inline std::int64_t read_counter(int (*get)(void*, long*), void* memory) {
  long n = 0;
  get(memory, &n);
  return n;
}

/// Is there next to no room from t to t_stop, so that SUNDIALS cannot choose a first step?
inline bool is_next_to(double t, double t_stop) {
  const double rounding =
      std::numeric_limits<double>::epsilon() * std::max(std::abs(t_stop), std::abs(t));
  return t_stop - t < 1e3 * rounding;
}

/// Newton matrix of an implicit method and its factors.
struct DenseSolver {
  /// @param like  vector of the unknowns
  DenseSolver(const System& system, N_Vector like);
  ~DenseSolver();
  DenseSolver(const DenseSolver&) = delete;
  DenseSolver& operator=(const DenseSolver&) = delete;

  SUNMatrix matrix = nullptr;
  SUNLinearSolver linear = nullptr;
};

class Solver {
 public:
  virtual ~Solver() = default;
  virtual void set_tolerances(double rtol, N_Vector atol) = 0;
  /// Start from y at t. @param h  first step, 0 = choose; multistep methods take it as a bound
  virtual void restart(double t, N_Vector y, double h) = 0;
  /// What is known at the start; for methods that have a use for it.
  virtual void set_known(const Stepper::Known&) {}
  virtual Stepper::Pace pace() const { return {}; }
  virtual double last_error() const { return 1.0; }
  /// One step towards t_stop; on failure y and t say nothing.
  virtual StepOutcome step(double t_stop, N_Vector y, double& t) = 0;
  /// State inside the last step.
  virtual bool interpolate(double t, N_Vector y) = 0;
  /// Its slope there. @return false if it is not known
  virtual bool find_slope(double, double*) { return false; }
  virtual double next_step() const = 0;
  /// All unknowns at the end of the last step; null where y is all.
  virtual const double* unknowns() const { return nullptr; }
  /// Is every step what restart() asks for? Then a step that fails is not tried again.
  virtual bool has_fixed_step() const { return false; }
  std::int64_t steps() const { return steps_ + present_steps(); }  ///< accepted, since construction
  /// Since construction, for their errors or because Newton failed.
  std::int64_t rejected_steps() const { return rejected_ + present_rejected(); }

 protected:
  virtual std::int64_t present_steps() const = 0;  ///< as SUNDIALS counts them
  virtual std::int64_t present_rejected() const = 0;
  /// SUNDIALS is about to count from zero again.
  void keep_counts() {
    steps_ += present_steps();
    rejected_ += present_rejected();
  }

 private:
  std::int64_t steps_ = 0, rejected_ = 0;  // before SUNDIALS began to count
};

struct RungeKuttaTable;

std::unique_ptr<Solver> make_explicit_solver(System& system, const RungeKuttaTable& table);
/// @param stable  a table to go over to where stability limits the steps of the usual one
std::unique_ptr<Solver> make_explicit_solver(System& system, const RungeKuttaTable& usual,
                                             const RungeKuttaTable& stable);
/// @param adapts  error control chooses the steps; else every step is what restart() asks for
std::unique_ptr<Solver> make_rosenbrock_solver(System& system, bool adapts);
/// Both: explicit steps with both tables, linearly implicit ones where they are longer.
std::unique_ptr<Solver> make_switching_solver(System& system);
std::unique_ptr<Solver> make_bdf_solver(System& system);

}  // namespace dockloop
