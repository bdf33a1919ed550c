// Explicit Runge-Kutta methods as tables: y1 = y0 + h sum b_i k_i, k_i = f(t + c_i h, y0 + h sum
// a_ij k_j), an estimate of the error of y1, and y inside the step.
//
//                      stages  order   interval of stability on the real axis, per evaluation
//   Dormand-Prince       6     5(4)     3.3, 0.55      the usual one
//   stabilised           8     4(3)     19,  2.4       damped stiffness: friction in contact
//   classic              4     4        2.8, 0.70      equal steps
#pragma once

namespace dockloop {

/// All arrays are constants. The rates at the end of the step count as one more stage, the last.
struct RungeKuttaTable {
  int stages = 0;                 ///< n, without the rates at the end
  int error_order = 0;            ///< the estimate is of order h^(error_order + 1)
  const double* a = nullptr;      ///< rows 1 to n - 1 of the lower triangle, one after another
  const double* b = nullptr;      ///< n weights
  const double* error = nullptr;  ///< n + 1 weights; null: no estimate
  /// n + 1 weights d: at t + s h, the cubic through both ends plus h s^2 (1-s)^2 sum d_i k_i.
  const double* dense = nullptr;
};

RungeKuttaTable get_dormand_prince();
RungeKuttaTable get_stabilised();
/// Step size times real rate up to which it is stable, with a margin.
constexpr double kStabilisedInterval = 18.5;
RungeKuttaTable get_classic();

}  // namespace dockloop
