// Equal implicit steps: Alexander's L-stable method of order 3 with three stages. Every step takes
// one Jacobian, one factorisation and kNewtonIterations Newton iterations per stage, whatever
// happens. The Jacobian is that at the end of an Euler step, so that it knows the contact that the
// step runs into.
#include <sunmatrix/sunmatrix_dense.h>

#include <stdexcept>

#include "compare/implicit_solver.hpp"
#include "compare/methods.hpp"

namespace dockloop {
namespace {

constexpr int kNewtonIterations = 2;  ///< one would leave order 2

class FixedImplicitSolver : public ImplicitSolver {
 public:
  explicit FixedImplicitSolver(System& system)
      : ImplicitSolver(system, nullptr, &call_rates, &call_jacobian, this) {
    set_alexander_table();
    System::check(SUNNonlinSolSetConvTestFn(newton_, &count_iterations, nullptr));
  }
  bool has_fixed_step() const override { return true; }

 private:
  void set_first_step(double h) override {
    ahead_ = h;
    ARKStepSetFixedStep(ark_, h);
  }
  static int call_rates(realtype t, N_Vector y, N_Vector ydot, void* solver) {
    return System::call_rates(t, y, ydot, &static_cast<FixedImplicitSolver*>(solver)->system_);
  }
  static int call_jacobian(realtype t, N_Vector y, N_Vector ydot, SUNMatrix jacobian, void* solver,
                           N_Vector scratch, N_Vector b, N_Vector c) {
    FixedImplicitSolver& me = *static_cast<FixedImplicitSolver*>(solver);
    System& system = me.system_;
    if (!system.idle && me.ahead_ > 0.0) {
      if (!system.spend(system.problem.jacobian_cost)) return System::kGiveUp;
      N_VLinearSum(1.0, y, me.ahead_, ydot, scratch);
      if (system.problem.jacobian(t, NV_DATA_S(scratch), SM_DATA_D(jacobian)) == 0) return 0;
      // Where that state cannot be evaluated, the present one has to do.
      return system.note(system.problem.jacobian(t, NV_DATA_S(y), SM_DATA_D(jacobian)));
    }
    return System::call_jacobian(t, y, ydot, jacobian, &system, scratch, b, c);
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

  double ahead_ = 0.0;  ///< Jacobians are taken so long ahead of the state, along its rates [s]
};

}  // namespace

std::unique_ptr<Solver> make_fixed_implicit_solver(System& system) {
  return std::make_unique<FixedImplicitSolver>(system);
}

}  // namespace dockloop
