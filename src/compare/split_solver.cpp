// Steps that are explicit for the mild part of the rates and implicit for the rest: the pair
// ARK4(3)6L[2]SA of Kennedy and Carpenter. Newton uses the Jacobian of all rates: the mild part
// adds little.
#include "compare/implicit_solver.hpp"
#include "compare/methods.hpp"

namespace dockloop {
namespace {

class SplitSolver : public ImplicitSolver {
 public:
  SplitSolver(System& system, MildRates mild)
      : ImplicitSolver(system, &call_mild, &call_stiff, &call_jacobian, this),
        mild_(std::move(mild)),
        scratch_(system.make_vector()) {
    System::check(
        ARKStepSetTableNum(ark_, ARKODE_ARK436L2SA_DIRK_6_3_4, ARKODE_ARK436L2SA_ERK_6_3_4));
    // Newton starts from the last step, extrapolated; less far for later stages.
    System::check(ARKStepSetPredictorMethod(ark_, 2));
    // As in explicit_solver.cpp.
    System::check(ARKStepSetMaxGrowth(ark_, 25.0));
    System::check(ARKStepSetMaxFirstGrowth(ark_, 25.0));
  }
  ~SplitSolver() override { N_VDestroy(scratch_); }

 private:
  static int call_mild(realtype t, N_Vector y, N_Vector ydot, void* solver) {
    SplitSolver& me = *static_cast<SplitSolver*>(solver);
    if (me.system_.idle) return System::call_rates(t, y, ydot, &me.system_);
    if (!me.system_.spend(1)) return System::kGiveUp;
    return me.system_.note(me.mild_(t, NV_DATA_S(y), NV_DATA_S(ydot)));
  }
  /// All rates less the mild ones: two evaluations.
  static int call_stiff(realtype t, N_Vector y, N_Vector ydot, void* solver) {
    SplitSolver& me = *static_cast<SplitSolver*>(solver);
    int said = call_mild(t, y, me.scratch_, solver);
    if (said == 0) said = System::call_rates(t, y, ydot, &me.system_);
    if (said == 0) N_VLinearSum(1.0, ydot, -1.0, me.scratch_, ydot);
    return said;
  }
  static int call_jacobian(realtype t, N_Vector y, N_Vector ydot, SUNMatrix jacobian, void* solver,
                           N_Vector a, N_Vector b, N_Vector c) {
    SplitSolver& me = *static_cast<SplitSolver*>(solver);
    return System::call_jacobian(t, y, ydot, jacobian, &me.system_, a, b, c);
  }

  MildRates mild_;
  N_Vector scratch_;
};

}  // namespace

std::unique_ptr<Solver> make_split_solver(System& system, MildRates mild) {
  return std::make_unique<SplitSolver>(system, std::move(mild));
}

}  // namespace dockloop
