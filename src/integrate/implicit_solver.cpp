// Diagonally implicit Runge-Kutta steps by ARKStep, for stiff contact, latches and friction.
//
// Adaptive: the pair ESDIRK4(3)7L[2]SA of Kennedy and Carpenter, L-stable and stiffly accurate,
// Newton iteration until it has converged; the Jacobian is kept while it is good enough.
// Fixed: Alexander's L-stable method of order 3 with three stages. Every step takes one Jacobian,
// one factorisation and kNewtonIterations Newton iterations per stage, whatever happens. The
// Jacobian is that at the end of an Euler step, so that it knows the contact that the step runs
// into. Split: the pair ARK4(3)6L[2]SA of the same authors, which integrates Problem::mild_rates
// explicitly and the rest of the rates implicitly. Newton uses the Jacobian of all rates: the mild
// part adds little to it.
#include <arkode/arkode_arkstep.h>
#include <sunnonlinsol/sunnonlinsol_newton.h>

#include <stdexcept>

#include "integrate/solver.hpp"

namespace dockloop {
namespace {

constexpr int kNewtonIterations = 2;  ///< one would leave order 2

class ImplicitSolver : public Solver {
 public:
  ImplicitSolver(System& system, Stepper::Method method)
      : system_(system),
        dense_(system, system.y),
        fixed_(method == Stepper::Method::kSdirk),
        mild_(method == Stepper::Method::kImex ? &System::call_mild_rates : nullptr),
        stiff_(mild_ ? &System::call_stiff_rates : &System::call_rates) {
    newton_ = SUNNonlinSol_Newton(system.y, system.context);
    ark_ = ARKStepCreate(mild_, stiff_, 0.0, system.y, system.context);
    if (!newton_ || !ark_) throw std::runtime_error("ARKODE cannot be created");
    System::check(ARKStepSetUserData(ark_, &system));
    System::check(ARKStepSetNonlinearSolver(ark_, newton_));
    System::check(ARKStepSetLinearSolver(ark_, dense_.linear, dense_.matrix));
    if (system.problem.jacobian) System::check(ARKStepSetJacFn(ark_, &System::call_jacobian));
    System::check(ARKStepSVtolerances(ark_, 1e-6, system.atol));
    System::check(ARKStepSetErrHandlerFn(ark_, &System::ignore_message, nullptr));
    System::check(ARKStepSetMaxNumSteps(ark_, -1));
    System::check(ARKStepSetMaxErrTestFails(ark_, 20));
    // Rates of a stage follow from its solution; evaluating them there would cost more, and amplify
    // what Newton has left over. With an inexact Jacobian (split) that would be too much.
    System::check(ARKStepSetDeduceImplicitRhs(ark_, mild_ ? SUNFALSE : SUNTRUE));
    if (fixed_) {
      set_alexander_table();
      System::check(SUNNonlinSolSetConvTestFn(newton_, &count_iterations, nullptr));
    } else {
      System::check(mild_ ? ARKStepSetTableNum(ark_, ARKODE_ARK436L2SA_DIRK_6_3_4,
                                               ARKODE_ARK436L2SA_ERK_6_3_4)
                          : ARKStepSetTableNum(ark_, ARKODE_ESDIRK437L2SA_7_3_4, ARKODE_ERK_NONE));
      // Newton starts from the last step, extrapolated; less far for later stages.
      System::check(ARKStepSetPredictorMethod(ark_, 2));
      // As in explicit_solver.cpp.
      System::check(ARKStepSetMaxGrowth(ark_, 25.0));
      System::check(ARKStepSetMaxFirstGrowth(ark_, 25.0));
    }
  }
  ~ImplicitSolver() override {
    if (ark_) ARKStepFree(&ark_);
    if (newton_) SUNNonlinSolFree(newton_);
  }

  void set_tolerances(double rtol, N_Vector atol) override {
    System::check(ARKStepSVtolerances(ark_, rtol, atol));
  }
  void restart(double t, N_Vector y, double h) override {
    // ARKStepReset would go on with the Jacobian of before.
    keep_counts();
    ARKStepReInit(ark_, mild_, stiff_, t, y);
    if (fixed_) {
      system_.ahead = h;
      ARKStepSetFixedStep(ark_, h);
    } else {
      ARKStepSetInitStep(ark_, h);
    }
  }
  StepOutcome step(double t_stop, N_Vector y, double& t) override {
    ARKStepSetStopTime(ark_, t_stop);
    const int flag = ARKStepEvolve(ark_, t_stop, y, &t, ARK_ONE_STEP);
    if (flag < 0) return StepOutcome::kFailed;
    return flag == ARK_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
  }
  bool interpolate(double t, N_Vector y) override {
    return ARKStepGetDky(ark_, t, 0, y) == ARK_SUCCESS;
  }
  double next_step() const override {
    double h = 0.0;
    ARKStepGetCurrentStep(ark_, &h);
    return h;
  }

 private:
  std::int64_t present_steps() const override {
    long n = 0;
    ARKStepGetNumSteps(ark_, &n);
    return n;
  }
  std::int64_t present_rejected() const override {
    long errors = 0, unsolved = 0;
    ARKStepGetNumErrTestFails(ark_, &errors);
    ARKStepGetNumStepSolveFails(ark_, &unsolved);
    return errors + unsolved;
  }
  static int count_iterations(SUNNonlinearSolver newton, N_Vector, N_Vector, realtype, N_Vector,
                              void*) {
    int made = 0;  // before this one
    SUNNonlinSolGetCurIter(newton, &made);
    return made + 1 < kNewtonIterations ? SUN_NLS_CONTINUE : SUN_NLS_SUCCESS;
  }
  void set_alexander_table() {
    const double g = 0.435866521508458999416019;  // root of x^3 - 3 x^2 + 3/2 x - 1/6
    const double b1 = -(6 * g * g - 16 * g + 1) / 4, b2 = (6 * g * g - 20 * g + 5) / 4;
    double c[] = {g, (1 + g) / 2, 1.0};
    double A[] = {g, 0, 0, (1 - g) / 2, g, 0, b1, b2, g};
    double b[] = {b1, b2, g};
    ARKodeButcherTable table = ARKodeButcherTable_Create(3, 3, 0, c, A, b, nullptr);
    if (!table) throw std::runtime_error("a table of ARKODE cannot be created");
    const int flag = ARKStepSetTables(ark_, 3, 0, table, nullptr);
    ARKodeButcherTable_Free(table);
    System::check(flag);
  }

  System& system_;
  DenseSolver dense_;
  SUNNonlinearSolver newton_ = nullptr;
  void* ark_ = nullptr;
  bool fixed_;
  ARKRhsFn mild_, stiff_;
};

}  // namespace

std::unique_ptr<Solver> make_implicit_solver(System& system, Stepper::Method method) {
  return std::make_unique<ImplicitSolver>(system, method);
}

}  // namespace dockloop
