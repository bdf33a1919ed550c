// Differential-algebraic form by IDA: BDF of variable order up to 5, Newton iteration with a dense
// matrix.
//
// As with the other multistep methods, a restart begins with order 1. It begins from the state y
// alone: what the equations add to it is completed so that all of them hold, so nothing that has
// drifted survives a communication point or an event.
#include "compare/dae_solver.hpp"

#include <ida/ida.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <stdexcept>

#include "math/dock_assert.hpp"

namespace dockloop {
namespace {

/// Newton iteration ends at this part of the tolerance: what is left over opens the loops.
constexpr double kConvergence = 1e-3;

class DaeSolver : public Solver {
 public:
  DaeSolver(System& system, Dae dae)
      : system_(system),
        dae_(std::move(dae)),
        z_(N_VClone(system.atol)),
        zdot_(N_VClone(system.atol)),
        ydot_(system.make_vector()),
        dense_(system, system.atol),
        ida_(IDACreate(system.context)) {
    if (!z_ || !zdot_ || !ida_) throw std::runtime_error("IDA cannot be created");
    N_VConst(0.0, z_);
    N_VConst(0.0, zdot_);
    System::check(IDAInit(ida_, &call_residual, 0.0, z_, zdot_));
    System::check(IDASetUserData(ida_, this));
    System::check(IDASVtolerances(ida_, 1e-6, system.atol));
    System::check(IDASetErrHandlerFn(ida_, &System::ignore_message, nullptr));
    System::check(IDASetMaxNumSteps(ida_, -1));
    System::check(IDASetMaxErrTestFails(ida_, 20));
    System::check(IDASetNonlinConvCoef(ida_, kConvergence));
    System::check(IDASetLinearSolver(ida_, dense_.linear, dense_.matrix));
    System::check(IDASetJacFn(ida_, &call_jacobian));
  }
  ~DaeSolver() override {
    if (ida_) IDAFree(&ida_);
    for (N_Vector vector : {z_, zdot_, ydot_}) {
      if (vector) N_VDestroy(vector);
    }
  }

  void set_tolerances(double rtol, N_Vector atol) override {
    System::check(IDASVtolerances(ida_, rtol, atol));
  }
  void restart(double t, N_Vector y, double h) override {
    N_VConst(0.0, z_);
    N_VConst(0.0, zdot_);
    consistent_ = System::call_rates(t, y, ydot_, &system_) == 0;
    if (consistent_ && !system_.idle) {
      std::copy_n(NV_DATA_S(y), NV_LENGTH_S(y), NV_DATA_S(z_));
      std::copy_n(NV_DATA_S(ydot_), NV_LENGTH_S(y), NV_DATA_S(zdot_));
      dae_.complete(NV_DATA_S(z_), NV_DATA_S(zdot_));
    }
    begin(t, h);
  }
  StepOutcome step(double t_stop, N_Vector y, double& t) override {
    if (!consistent_) return StepOutcome::kFailed;
    if (first_ && is_next_to(t_restart_, t_stop)) {  // IDA refuses to begin there
      N_VLinearSum(1.0, z_, t_stop - t_restart_, zdot_, z_);
      read(y);
      begin(t_stop, 0.0);
      t = t_stop;
      return StepOutcome::kStopped;
    }
    IDASetStopTime(ida_, t_stop);
    const int flag = IDASolve(ida_, t_stop, &t, z_, zdot_, IDA_ONE_STEP);
    if (flag < 0) return StepOutcome::kFailed;
    if (first_) IDASetMaxStep(ida_, 0.0);
    first_ = false;
    read(y);
    return flag == IDA_TSTOP_RETURN ? StepOutcome::kStopped : StepOutcome::kStepped;
  }
  bool interpolate(double t, N_Vector y) override {
    if (!first_ && IDAGetDky(ida_, t, 0, z_) != IDA_SUCCESS) return false;
    read(y);
    return true;
  }
  double next_step() const override {
    double h = 0.0;
    IDAGetCurrentStep(ida_, &h);
    return h;
  }
  const double* unknowns() const override { return NV_DATA_S(z_); }

 private:
  void begin(double t, double h) {
    keep_counts();
    IDAReInit(ida_, t, z_, zdot_);
    IDASetMaxStep(ida_, h);  // of the first step; 0 = none
    t_restart_ = t;
    first_ = true;
  }
  void read(N_Vector y) const { std::copy_n(NV_DATA_S(z_), NV_LENGTH_S(y), NV_DATA_S(y)); }

  std::int64_t present_steps() const override { return read_counter(IDAGetNumSteps, ida_); }
  std::int64_t present_rejected() const override {
    return read_counter(IDAGetNumErrTestFails, ida_) + read_counter(IDAGetNumStepSolveFails, ida_);
  }
  static int call_residual(realtype t, N_Vector z, N_Vector zdot, N_Vector residual, void* solver) {
    DaeSolver& me = *static_cast<DaeSolver*>(solver);
    if (me.system_.idle) {
      N_VScale(1.0, zdot, residual);
      return 0;
    }
    if (!me.system_.spend(1)) return System::kGiveUp;
    return me.system_.note(me.dae_.residual(t, NV_DATA_S(z), NV_DATA_S(zdot), NV_DATA_S(residual)));
  }
  static int call_jacobian(realtype t, realtype alpha, N_Vector z, N_Vector zdot, N_Vector residual,
                           SUNMatrix jacobian, void* solver, N_Vector, N_Vector, N_Vector) {
    DaeSolver& me = *static_cast<DaeSolver*>(solver);
    if (me.system_.idle) {
      SUNMatZero(jacobian);
      for (sunindextype i = 0; i < NV_LENGTH_S(z); ++i) SM_ELEMENT_D(jacobian, i, i) = alpha;
      return 0;
    }
    if (!me.system_.spend(me.dae_.jacobian_cost)) return System::kGiveUp;
    return me.system_.note(me.dae_.jacobian(t, alpha, NV_DATA_S(z), NV_DATA_S(zdot),
                                            NV_DATA_S(residual), SM_DATA_D(jacobian)));
  }

  System& system_;
  const Dae dae_;
  N_Vector z_, zdot_;  ///< all unknowns and their rates
  N_Vector ydot_;
  DenseSolver dense_;
  void* ida_ = nullptr;
  double t_restart_ = 0.0;
  bool first_ = true, consistent_ = true;
};

}  // namespace

std::unique_ptr<Solver> make_dae_solver(System& system, Dae dae) {
  DOCK_ASSERT(system.problem.unknowns > 0);
  return std::make_unique<DaeSolver>(system, std::move(dae));
}

}  // namespace dockloop
