// Equations that a run integrates in place of those of the core: other unknowns, other digits.
//
// src/compare contains them; core and FMU do not. A program that links src/compare passes a
// Comparison to the constructor of DockingSim. A simulation without a Comparison refuses what needs
// one (solver_methods.hpp).
#pragma once

#include <memory>
#include <vector>

#include "integrate/stepper.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {

class Equations {
 public:
  virtual ~Equations() = default;
  /// Replace rates, event functions or method.
  virtual void enter(Stepper::Problem& problem) = 0;
  /// Do they make a reference solution? Then all motion is integrated, at any cost.
  virtual bool is_reference() const { return false; }
  virtual int size() const = 0;  ///< number of unknowns; the state is first
  virtual int controlled_size() const { return size(); }  ///< number of unknowns with a tolerance
  /// Append the tolerances of the unknowns after the state.
  virtual void add_tolerances(std::vector<double>&) const {}
  /// Sizes of all unknowns, for differences.
  virtual void set_nominals(VecX<double>) {}
  /// Update after a change of the independent coordinates of the mechanism.
  virtual void update_coordinates() {}
  /// Largest gap of the cuts at the end of the last inner step [m].
  virtual double find_cut_gap(double) { return 0.0; }
};

class Comparison {
 public:
  virtual ~Comparison() = default;
  /// @return null: those of the core
  virtual std::unique_ptr<Equations> make_equations(DockingSim::Impl& sim) const = 0;
};

}  // namespace dockloop
