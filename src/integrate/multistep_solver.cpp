// Linear multistep methods by CVODE: Adams-Moulton up to order 12 with fixed-point iteration, BDF
// up to order 5 with Newton iteration.
//
// They live on their history. A restart begins with order 1 and a small step again, which is what
// every communication point and every event costs.
#include <cvode/cvode.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>
#include <sunnonlinsol/sunnonlinsol_newton.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "integrate/solver.hpp"

namespace dockloop {
namespace {

class MultistepSolver : public Solver {
 public:
  MultistepSolver(System& system, bool stiff) {
    cvode_ = CVodeCreate(stiff ? CV_BDF : CV_ADAMS, system.context);
    if (!cvode_) throw std::runtime_error("CVODE cannot be created");
    System::check(CVodeInit(cvode_, &System::call_rates, 0.0, system.y));
    System::check(CVodeSetUserData(cvode_, &system));
    System::check(CVodeSVtolerances(cvode_, 1e-6, system.atol));
    System::check(CVodeSetErrHandlerFn(cvode_, &System::ignore_message, nullptr));
    System::check(CVodeSetMaxNumSteps(cvode_, -1));
    System::check(CVodeSetMaxErrTestFails(cvode_, 20));
    iteration_ = stiff ? SUNNonlinSol_Newton(system.y, system.context)
                       : SUNNonlinSol_FixedPoint(system.y, 0, system.context);
    if (!iteration_) throw std::runtime_error("CVODE cannot be created");
    System::check(CVodeSetNonlinearSolver(cvode_, iteration_));
    if (!stiff) return;
    dense_ = std::make_unique<DenseSolver>(system, system.y);
    System::check(CVodeSetLinearSolver(cvode_, dense_->linear, dense_->matrix));
    if (system.problem.jacobian) System::check(CVodeSetJacFn(cvode_, &System::call_jacobian));
  }
  ~MultistepSolver() override {
    if (cvode_) CVodeFree(&cvode_);
    if (iteration_) SUNNonlinSolFree(iteration_);
  }

  void set_tolerances(double rtol, N_Vector atol) override {
    System::check(CVodeSVtolerances(cvode_, rtol, atol));
  }
  void restart(double t, N_Vector y, double h) override {
    keep_counts();
    CVodeReInit(cvode_, t, y);
    CVodeSetMaxStep(cvode_, h);  // of the first step; 0 = none
    t_restart_ = t;
    first_ = true;
  }
  StepOutcome step(double t_stop, N_Vector y, double& t) override {
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
  bool interpolate(double t, N_Vector y) override {
    return CVodeGetDky(cvode_, t, 0, y) == CV_SUCCESS;
  }
  double next_step() const override {
    double h = 0.0;
    CVodeGetCurrentStep(cvode_, &h);
    return h;
  }

 private:
  std::int64_t present_steps() const override {
    long n = 0;
    CVodeGetNumSteps(cvode_, &n);
    return n;
  }
  std::int64_t present_rejected() const override {
    long errors = 0, unsolved = 0;
    CVodeGetNumErrTestFails(cvode_, &errors);
    CVodeGetNumStepSolveFails(cvode_, &unsolved);
    return errors + unsolved;
  }

  void* cvode_ = nullptr;
  SUNNonlinearSolver iteration_ = nullptr;
  std::unique_ptr<DenseSolver> dense_;  // BDF only
  double t_restart_ = 0.0;
  bool first_ = true;
};

}  // namespace

std::unique_ptr<Solver> make_multistep_solver(System& system, bool stiff) {
  return std::make_unique<MultistepSolver>(system, stiff);
}

}  // namespace dockloop
