// Backward differentiation formulas (BDF) up to order 5 by CVODE, with Newton iteration.
//
// They live on their history. A restart begins with order 1 and a small step again, which is what
// every communication point and every event costs.
#include <cvode/cvode.h>
#include <sunnonlinsol/sunnonlinsol_newton.h>

#include <stdexcept>

#include "integrate/solver.hpp"

namespace dockloop {
namespace {

class BdfSolver : public Solver {
 public:
  explicit BdfSolver(System& system)
      : cvode_(CVodeCreate(CV_BDF, system.context)),
        newton_(SUNNonlinSol_Newton(system.y, system.context)),
        dense_(system, system.y) {
    if (!cvode_ || !newton_) throw std::runtime_error("CVODE cannot be created");
    System::check(CVodeInit(cvode_, &System::call_rates, 0.0, system.y));
    System::check(CVodeSetUserData(cvode_, &system));
    System::check(CVodeSVtolerances(cvode_, 1e-6, system.atol));
    System::check(CVodeSetErrHandlerFn(cvode_, &System::ignore_message, nullptr));
    System::check(CVodeSetMaxNumSteps(cvode_, -1));
    System::check(CVodeSetMaxErrTestFails(cvode_, 20));
    System::check(CVodeSetNonlinearSolver(cvode_, newton_));
    System::check(CVodeSetLinearSolver(cvode_, dense_.linear, dense_.matrix));
    if (system.problem.jacobian) System::check(CVodeSetJacFn(cvode_, &System::call_jacobian));
  }
  ~BdfSolver() override {
    if (cvode_) CVodeFree(&cvode_);
    if (newton_) SUNNonlinSolFree(newton_);
  }
  BdfSolver(const BdfSolver&) = delete;
  BdfSolver& operator=(const BdfSolver&) = delete;

  void set_tolerances(double rtol, N_Vector atol) override {
    System::check(CVodeSVtolerances(cvode_, rtol, atol));
  }
  void restart(double t, N_Vector y, double h) override;
  StepOutcome step(double t_stop, N_Vector y, double& t) override;
  bool interpolate(double t, N_Vector y) override {
    return CVodeGetDky(cvode_, t, 0, y) == CV_SUCCESS;
  }
  double next_step() const override {
    double h = 0.0;
    CVodeGetCurrentStep(cvode_, &h);
    return h;
  }

 private:
  std::int64_t present_steps() const override { return read_counter(CVodeGetNumSteps, cvode_); }
  std::int64_t present_rejected() const override {
    return read_counter(CVodeGetNumErrTestFails, cvode_) +
           read_counter(CVodeGetNumStepSolveFails, cvode_);
  }

  void* cvode_ = nullptr;
  SUNNonlinearSolver newton_ = nullptr;
  DenseSolver dense_;
  double t_restart_ = 0.0;
  bool first_ = true;
};

void BdfSolver::restart(double t, N_Vector y, double h) {
  keep_counts();
  CVodeReInit(cvode_, t, y);
  CVodeSetMaxStep(cvode_, h);  // of the first step; 0 = none
  t_restart_ = t;
  first_ = true;
}

StepOutcome BdfSolver::step(double t_stop, N_Vector y, double& t) {
  if (first_) {
    // CVODE estimates the first step of order 1, unless there is no room to do so.
    CVodeSetInitStep(cvode_, is_next_to(t_restart_, t_stop) ? t_stop - t_restart_ : 0.0);
  }
  CVodeSetStopTime(cvode_, t_stop);
  const int flag = CVode(cvode_, t_stop, y, &t, CV_ONE_STEP);
  if (flag < 0) return StepOutcome::kFailed;
  if (first_) CVodeSetMaxStep(cvode_, 0.0);
  first_ = false;
  return flag == CV_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
}

}  // namespace

std::unique_ptr<Solver> make_bdf_solver(System& system) {
  return std::make_unique<BdfSolver>(system);
}

}  // namespace dockloop
