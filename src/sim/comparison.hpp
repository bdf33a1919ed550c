// Interface to the methods for comparison. src/compare contains them; core and FMU do not.
//
// A program that links src/compare passes its Comparison to the constructor of DockingSim. A
// simulation without a Comparison refuses such methods (solver_methods.hpp).
#pragma once

#include <memory>
#include <vector>

#include "integrate/stepper.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {

/// The unreduced form of the equations in one simulation (model.level 4).
class UnreducedForm {
 public:
  virtual ~UnreducedForm() = default;
  virtual int size() const = 0;             ///< number of unknowns; the state is first
  virtual int controlled_size() const = 0;  ///< number of unknowns with a tolerance
  virtual void enter(Stepper::Problem& problem) = 0;
  /// Append the tolerances of the unknowns after the state.
  virtual void add_tolerances(std::vector<double>& atol) const = 0;
  /// Sizes of all unknowns, for differences.
  virtual void set_nominals(VecX<double> nominal) = 0;
  /// Update after a change of the independent coordinates of the mechanism.
  virtual void update_coordinates() = 0;
  /// Largest gap of the cuts at the end of the last inner step [m].
  virtual double find_cut_gap(double tau) = 0;
};

/// Immutable; any number of simulations can use one object.
class Comparison {
 public:
  virtual ~Comparison() = default;
  virtual std::unique_ptr<UnreducedForm> make_unreduced_form(DockingSim::Impl& sim) const = 0;
  /// Enter a method for comparison that integrates the state.
  virtual void enter(int method, DockingSim::Impl& sim, Stepper::Problem& problem) const = 0;
};

}  // namespace dockloop
