// Diagonally implicit Runge-Kutta steps by ARKStep: what its variants share.
#pragma once

#include <arkode/arkode_arkstep.h>

#include "integrate/solver.hpp"

namespace dockloop {

class ImplicitSolver : public Solver {
 public:
  ~ImplicitSolver() override;
  ImplicitSolver(const ImplicitSolver&) = delete;
  ImplicitSolver& operator=(const ImplicitSolver&) = delete;

  void set_tolerances(double rtol, N_Vector atol) override;
  void restart(double t, N_Vector y, double h) override;
  StepOutcome step(double t_stop, N_Vector y, double& t) override;
  bool interpolate(double t, N_Vector y) override;
  double next_step() const override;

 protected:
  /// Integrates `stiff` implicitly and `mild`, which may be null, explicitly. Both receive
  /// `user_data`, and so does `jacobian`.
  ImplicitSolver(System& system, ARKRhsFn mild, ARKRhsFn stiff, ARKLsJacFn jacobian,
                 void* user_data);
  /// Hands the first step on to ARKStep.
  virtual void set_first_step(double h);

  System& system_;
  SUNNonlinearSolver newton_ = nullptr;
  void* ark_ = nullptr;

 private:
  std::int64_t present_steps() const override;
  std::int64_t present_rejected() const override;

  DenseSolver dense_;
  ARKRhsFn mild_, stiff_;
};

}  // namespace dockloop
