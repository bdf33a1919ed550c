// Linear multistep methods by CVODE: BDF up to order 5 with Newton iteration.
//
// They live on their history. A restart begins with order 1 and a small step again, which is what
// every communication point and every event costs.
#include "integrate/multistep_solver.hpp"

#include <cvode/cvode.h>
#include <sunnonlinsol/sunnonlinsol_newton.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace dockloop {

MultistepSolver::MultistepSolver(System& system, int family, SUNNonlinearSolver iteration)
    : cvode_(CVodeCreate(family, system.context)), iteration_(iteration) {
  if (!cvode_ || !iteration_) throw std::runtime_error("CVODE cannot be created");
  System::check(CVodeInit(cvode_, &System::call_rates, 0.0, system.y));
  System::check(CVodeSetUserData(cvode_, &system));
  System::check(CVodeSVtolerances(cvode_, 1e-6, system.atol));
  System::check(CVodeSetErrHandlerFn(cvode_, &System::ignore_message, nullptr));
  System::check(CVodeSetMaxNumSteps(cvode_, -1));
  System::check(CVodeSetMaxErrTestFails(cvode_, 20));
  System::check(CVodeSetNonlinearSolver(cvode_, iteration_));
}

MultistepSolver::~MultistepSolver() {
  if (cvode_) CVodeFree(&cvode_);
  if (iteration_) SUNNonlinSolFree(iteration_);
}

void MultistepSolver::set_tolerances(double rtol, N_Vector atol) {
  System::check(CVodeSVtolerances(cvode_, rtol, atol));
}

void MultistepSolver::restart(double t, N_Vector y, double h) {
  keep_counts();
  CVodeReInit(cvode_, t, y);
  CVodeSetMaxStep(cvode_, h);  // of the first step; 0 = none
  t_restart_ = t;
  first_ = true;
}

StepOutcome MultistepSolver::step(double t_stop, N_Vector y, double& t) {
  if (first_) {
    // CVODE estimates the first step of order 1, unless there is no room to do so.
    const double room = t_stop - t_restart_;
    const double rounding =
        std::numeric_limits<double>::epsilon() * std::max(std::abs(t_stop), std::abs(t_restart_));
    CVodeSetInitStep(cvode_, room < 1e3 * rounding ? room : 0.0);
  }
  CVodeSetStopTime(cvode_, t_stop);
  const int flag = CVode(cvode_, t_stop, y, &t, CV_ONE_STEP);
  if (flag < 0) return StepOutcome::kFailed;
  if (first_) CVodeSetMaxStep(cvode_, 0.0);
  first_ = false;
  return flag == CV_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
}

bool MultistepSolver::interpolate(double t, N_Vector y) {
  return CVodeGetDky(cvode_, t, 0, y) == CV_SUCCESS;
}

double MultistepSolver::next_step() const {
  double h = 0.0;
  CVodeGetCurrentStep(cvode_, &h);
  return h;
}

std::int64_t MultistepSolver::present_steps() const {
  long n = 0;
  CVodeGetNumSteps(cvode_, &n);
  return n;
}

std::int64_t MultistepSolver::present_rejected() const {
  long errors = 0, unsolved = 0;
  CVodeGetNumErrTestFails(cvode_, &errors);
  CVodeGetNumStepSolveFails(cvode_, &unsolved);
  return errors + unsolved;
}

namespace {

class BdfSolver : public MultistepSolver {
 public:
  explicit BdfSolver(System& system)
      : MultistepSolver(system, CV_BDF, SUNNonlinSol_Newton(system.y, system.context)),
        dense_(system, system.y) {
    System::check(CVodeSetLinearSolver(cvode_, dense_.linear, dense_.matrix));
    if (system.problem.jacobian) System::check(CVodeSetJacFn(cvode_, &System::call_jacobian));
  }

 private:
  DenseSolver dense_;
};

}  // namespace

std::unique_ptr<Solver> make_bdf_solver(System& system) {
  return std::make_unique<BdfSolver>(system);
}

}  // namespace dockloop
