// A DockingSim that integrates with 32 digits: the reference solution.
#pragma once

#include "math/extended.hpp"
#include "sim/equations.hpp"

namespace dockloop {

class ExtendedEquations;

/// Steps of high order with 32 digits, for every solver.method and model.level. Serves one
/// simulation, which takes it as its Comparison.
class ExtendedPrecision final : public Comparison {
 public:
  /// @param tolerance  of steps, in units of the scene's tolerances per rtol
  explicit ExtendedPrecision(double tolerance) : tolerance_(tolerance) {}
  std::unique_ptr<Equations> make_equations(DockingSim::Impl& sim) const override;

  /// The state with all its digits, in the order of StateLayout. @pre DockingSim::initialise()
  const Extended* states() const;
  /// Continuous outputs, computed with all digits and rounded once, as for_each_value() counts
  /// them.
  Status calc_outputs(std::vector<double>& output) const;

 private:
  double tolerance_;
  mutable ExtendedEquations* made_ = nullptr;  ///< the simulation owns it
};

}  // namespace dockloop
