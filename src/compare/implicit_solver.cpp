// See implicit_solver.hpp.
#include "compare/implicit_solver.hpp"

#include <sunnonlinsol/sunnonlinsol_newton.h>

#include <stdexcept>

namespace dockloop {

ImplicitSolver::ImplicitSolver(System& system, ARKRhsFn mild, ARKRhsFn stiff, ARKLsJacFn jacobian,
                               void* user_data)
    : system_(system), dense_(system, system.y), mild_(mild), stiff_(stiff) {
  newton_ = SUNNonlinSol_Newton(system.y, system.context);
  ark_ = ARKStepCreate(mild_, stiff_, 0.0, system.y, system.context);
  if (!newton_ || !ark_) throw std::runtime_error("ARKODE cannot be created");
  System::check(ARKStepSetUserData(ark_, user_data));
  System::check(ARKStepSetNonlinearSolver(ark_, newton_));
  System::check(ARKStepSetLinearSolver(ark_, dense_.linear, dense_.matrix));
  if (system.problem.jacobian) System::check(ARKStepSetJacFn(ark_, jacobian));
  System::check(ARKStepSVtolerances(ark_, 1e-6, system.atol));
  System::check(ARKStepSetErrHandlerFn(ark_, &System::ignore_message, nullptr));
  System::check(ARKStepSetMaxNumSteps(ark_, -1));
  System::check(ARKStepSetMaxErrTestFails(ark_, 20));
  // Rates of a stage follow from its solution; evaluating them there would cost more, and amplify
  // what Newton has left over. With an inexact Jacobian (split) that would be too much.
  System::check(ARKStepSetDeduceImplicitRhs(ark_, mild_ ? SUNFALSE : SUNTRUE));
}

ImplicitSolver::~ImplicitSolver() {
  if (ark_) ARKStepFree(&ark_);
  if (newton_) SUNNonlinSolFree(newton_);
}

void ImplicitSolver::set_first_step(double h) { ARKStepSetInitStep(ark_, h); }

void ImplicitSolver::set_tolerances(double rtol, N_Vector atol) {
  System::check(ARKStepSVtolerances(ark_, rtol, atol));
}

void ImplicitSolver::restart(double t, N_Vector y, double h) {
  // ARKStepReset would go on with the Jacobian of before.
  keep_counts();
  ARKStepReInit(ark_, mild_, stiff_, t, y);
  set_first_step(h);
}

StepOutcome ImplicitSolver::step(double t_stop, N_Vector y, double& t) {
  ARKStepSetStopTime(ark_, t_stop);
  const int flag = ARKStepEvolve(ark_, t_stop, y, &t, ARK_ONE_STEP);
  if (flag < 0) return StepOutcome::kFailed;
  return flag == ARK_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
}

bool ImplicitSolver::interpolate(double t, N_Vector y) {
  return ARKStepGetDky(ark_, t, 0, y) == ARK_SUCCESS;
}

double ImplicitSolver::next_step() const {
  double h = 0.0;
  ARKStepGetCurrentStep(ark_, &h);
  return h;
}

std::int64_t ImplicitSolver::present_steps() const {
  long n = 0;
  ARKStepGetNumSteps(ark_, &n);
  return n;
}

std::int64_t ImplicitSolver::present_rejected() const {
  long errors = 0, unsolved = 0;
  ARKStepGetNumErrTestFails(ark_, &errors);
  ARKStepGetNumStepSolveFails(ark_, &unsolved);
  return errors + unsolved;
}

}  // namespace dockloop
