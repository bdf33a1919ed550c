// The seam for methods for comparison, which live in src/compare; core and FMU do not carry them.
//
// A program that links src/compare hands its one Comparison to the constructor of DockingSim. A
// simulation without one refuses such methods (solver_methods.hpp).
#pragma once

#include <memory>
#include <vector>

#include "integrate/stepper.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {

/// The unreduced form of the equations at work in one simulation (model.level 4).
class UnreducedForm {
 public:
  virtual ~UnreducedForm() = default;
  virtual int size() const = 0;            ///< of all unknowns; the state comes first
  virtual int controlled_size() const = 0;  ///< of those that have a tolerance
  virtual void enter(Stepper::Problem& problem) = 0;
  /// Appends the tolerances of unknowns beyond the state.
  virtual void add_tolerances(std::vector<double>& atol) const = 0;
  /// Sizes of all unknowns, for differences.
  virtual void set_nominals(VecX<double> nominal) = 0;
  /// Follows the mechanism to other independent coordinates.
  virtual void update_coordinates() = 0;
  /// Largest gap of the cuts at the end of the last inner step [m].
  virtual double find_cut_gap(double tau) = 0;
};

/// Immutable; serves any number of simulations.
class Comparison {
 public:
  virtual ~Comparison() = default;
  virtual std::unique_ptr<UnreducedForm> make_unreduced_form(DockingSim::Impl& sim) const = 0;
  /// Enters a method for comparison that integrates the state itself.
  virtual void enter(int method, DockingSim::Impl& sim, Stepper::Problem& problem) const = 0;
};

}  // namespace dockloop
