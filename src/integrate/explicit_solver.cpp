// Explicit Runge-Kutta steps by ERKStep: Dormand-Prince 5(4), seven stages, or the classic method
// of four stages with fixed steps.
#include <arkode/arkode_erkstep.h>

#include <stdexcept>

#include "integrate/solver.hpp"

namespace dockloop {
namespace {

class ExplicitSolver : public Solver {
 public:
  ExplicitSolver(System& system, bool fixed) : fixed_(fixed) {
    ark_ = ERKStepCreate(&System::call_rates, 0.0, system.y, system.context);
    if (!ark_) throw std::runtime_error("ARKODE cannot be created");
    System::check(ERKStepSetUserData(ark_, &system));
    if (fixed) {
      set_classic_table();
    } else {
      System::check(ERKStepSetTableNum(ark_, ARKODE_DORMAND_PRINCE_7_4_5));
    }
    System::check(ERKStepSVtolerances(ark_, 1e-6, system.atol));
    System::check(ERKStepSetErrHandlerFn(ark_, &System::ignore_message, nullptr));
    System::check(ERKStepSetMaxNumSteps(ark_, -1));
    System::check(ERKStepSetMaxErrTestFails(ark_, 20));
    // The first step may grow like any other: a run that goes on in a new integrator must give the
    // same bits.
    System::check(ERKStepSetMaxGrowth(ark_, 25.0));
    System::check(ERKStepSetMaxFirstGrowth(ark_, 25.0));
  }
  ~ExplicitSolver() override {
    if (ark_) ERKStepFree(&ark_);
  }

  void set_tolerances(double rtol, N_Vector atol) override {
    System::check(ERKStepSVtolerances(ark_, rtol, atol));
  }
  void restart(double t, N_Vector y, double h) override {
    ERKStepReset(ark_, t, y);
    if (fixed_) {
      ERKStepSetFixedStep(ark_, h);
    } else {
      ERKStepSetInitStep(ark_, h);
    }
  }
  StepOutcome step(double t_stop, N_Vector y, double& t) override {
    ERKStepSetStopTime(ark_, t_stop);
    const int flag = ERKStepEvolve(ark_, t_stop, y, &t, ARK_ONE_STEP);
    if (flag < 0) return StepOutcome::kFailed;
    return flag == ARK_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
  }
  bool interpolate(double t, N_Vector y) override {
    return ERKStepGetDky(ark_, t, 0, y) == ARK_SUCCESS;
  }
  double next_step() const override {
    double h = 0.0;
    ERKStepGetCurrentStep(ark_, &h);
    return h;
  }

 private:
  long present_steps() const override {
    long n = 0;
    ERKStepGetNumSteps(ark_, &n);
    return n;
  }
  long present_rejected() const override {
    long n = 0;
    ERKStepGetNumErrTestFails(ark_, &n);
    return n;
  }
  void set_classic_table() {
    double c[] = {0.0, 0.5, 0.5, 1.0};
    double A[] = {0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1, 0};
    double b[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    ARKodeButcherTable table = ARKodeButcherTable_Create(4, 4, 0, c, A, b, nullptr);
    if (!table) throw std::runtime_error("a table of ARKODE cannot be created");
    const int flag = ERKStepSetTable(ark_, table);
    ARKodeButcherTable_Free(table);
    System::check(flag);
  }

  void* ark_ = nullptr;
  bool fixed_;
};

}  // namespace

std::unique_ptr<Solver> make_explicit_solver(System& system, bool fixed) {
  return std::make_unique<ExplicitSolver>(system, fixed);
}

}  // namespace dockloop
