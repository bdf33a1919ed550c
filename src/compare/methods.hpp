// Methods of integration that the core does not carry, as solvers for Stepper::Problem::solver.
#pragma once

#include <functional>
#include <memory>

#include "integrate/runge_kutta.hpp"
#include "integrate/solver.hpp"

namespace dockloop {

/// Explicit, order 8(5,3), for smooth motion at tight tolerances.
std::unique_ptr<Solver> make_high_order_solver(System& system);
RungeKuttaTable get_dop853();

/// The part of the rates that is never stiff.
using MildRates = std::function<int(double t, const double* y, double* ydot)>;
/// Explicit for the mild rates, implicit for the rest, order 4(3).
std::unique_ptr<Solver> make_split_solver(System& system, MildRates mild);

/// Equal implicit steps of order 3; every step is what restart() asks for.
std::unique_ptr<Solver> make_fixed_implicit_solver(System& system);

/// Multistep, order up to 12.
std::unique_ptr<Solver> make_adams_solver(System& system);

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
