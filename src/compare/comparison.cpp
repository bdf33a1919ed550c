// Which solver stands for which number of solver.method.
#include "compare/comparison.hpp"

#include <stdexcept>

#include "compare/methods.hpp"
#include "compare/unreduced_form.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

/// The rates without contact and latches: what never is stiff.
MildRates make_mild_rates(DockingSim::Impl& sim) {
  return [&sim](double t, const double* y, double* ydot) {
    sim.evaluator->forget();
    sim.trial().touches = false;
    const Status status = sim.evaluator->aside(t, y, ydot, Need::kRates);
    sim.trial().touches = true;
    return sim.step_loop->update_failure_code(status, t, ydot, sim.model->layout.size);
  };
}

class AllMethods : public Comparison {
 public:
  std::unique_ptr<UnreducedForm> make_unreduced_form(DockingSim::Impl& sim) const override {
    return dockloop::make_unreduced_form(sim);
  }
  void enter(int method, DockingSim::Impl& sim, Stepper::Problem& problem) const override {
    switch (method) {
      case kImex:
        problem.solver = [mild = make_mild_rates(sim)](System& system) {
          return make_split_solver(system, mild);
        };
        return;
      case kAdams:
        problem.solver = make_adams_solver;
        return;
      case kFixedImplicit:
        problem.solver = make_fixed_implicit_solver;
        return;
      case kHighOrder:
        problem.solver = make_high_order_solver;
        return;
      default:
        throw std::logic_error("no such method");
    }
  }
};

}  // namespace

const Comparison* get_comparison() {
  static const AllMethods kAll;
  return &kAll;
}

}  // namespace dockloop
