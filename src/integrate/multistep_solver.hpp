// Linear multistep methods by CVODE: what BDF and Adams (src/compare) share.
#pragma once

#include <sundials/sundials_nonlinearsolver.h>

#include "integrate/solver.hpp"

namespace dockloop {

class MultistepSolver : public Solver {
 public:
  ~MultistepSolver() override;
  MultistepSolver(const MultistepSolver&) = delete;
  MultistepSolver& operator=(const MultistepSolver&) = delete;

  void set_tolerances(double rtol, N_Vector atol) override;
  void restart(double t, N_Vector y, double h) override;
  StepOutcome step(double t_stop, N_Vector y, double& t) override;
  bool interpolate(double t, N_Vector y) override;
  double next_step() const override;

 protected:
  /// @param family     CV_BDF or CV_ADAMS
  /// @param iteration  solves the implicit equation of a step; this object owns it from now on
  MultistepSolver(System& system, int family, SUNNonlinearSolver iteration);

  void* cvode_ = nullptr;

 private:
  std::int64_t present_steps() const override;
  std::int64_t present_rejected() const override;

  SUNNonlinearSolver iteration_ = nullptr;
  double t_restart_ = 0.0;
  bool first_ = true;
};

}  // namespace dockloop
