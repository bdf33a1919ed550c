// Adams-Moulton up to order 12 with fixed-point iteration, by CVODE.
#include <cvode/cvode.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include "compare/methods.hpp"
#include "integrate/multistep_solver.hpp"

namespace dockloop {
namespace {

class AdamsSolver : public MultistepSolver {
 public:
  explicit AdamsSolver(System& system)
      : MultistepSolver(system, CV_ADAMS, SUNNonlinSol_FixedPoint(system.y, 0, system.context)) {}
};

}  // namespace

std::unique_ptr<Solver> make_adams_solver(System& system) {
  return std::make_unique<AdamsSolver>(system);
}

}  // namespace dockloop
