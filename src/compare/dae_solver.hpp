// Differential-algebraic equations as a solver for Stepper::Problem::solver.
#pragma once

#include <functional>
#include <memory>

#include "integrate/solver.hpp"

namespace dockloop {

/// The equations as 0 = residual(t, z, zdot) in more unknowns z, of which y is the first part.
struct Dae {
  std::function<int(double t, const double* z, const double* zdot, double* residual)> residual;
  /// d residual / d z + alpha d residual / d zdot, by columns.
  std::function<int(double t, double alpha, const double* z, const double* zdot,
                    const double* residual, double* jacobian)>
      jacobian;
  int jacobian_cost = 0;  ///< residuals that a Jacobian is counted as
  /// The rest of z and zdot, so that all equations hold. Called where rates(y) has just been.
  std::function<void(double* z, double* zdot)> complete;
};
/// Multistep, stiff, order up to 5. @pre Stepper::Problem::unknowns is the size of z
std::unique_ptr<Solver> make_dae_solver(System& system, Dae dae);

}  // namespace dockloop
