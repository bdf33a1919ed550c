// Written by tests/studies/accuracy.py from tests/data/accuracy.json: do not edit.
//
// Tolerances with which 98 % of the measured dockings stay below an error, so that 95 % of others
// do, too (accuracy.hpp).
#pragma once

#include <array>

#include "sim/solver_methods.hpp"

namespace dockloop {

constexpr size_t kColumns = 3;
constexpr std::array<SolverMethod, kColumns> kCalibratedMethods = {kStabilised, kBdf, kRosenbrock};

// Absolute tolerances over the relative one, for a usual approach: [m], [m/s], [J].
constexpr double kAtolPosition = 0.01;
constexpr double kAtolVelocity = 0.01;
constexpr double kAtolEnergy = 0.1;

/// The longest measured docking [s].
constexpr double kMeasuredTime = 30;

/// Limit between short and long communication steps [s].
constexpr double kLongStep = 0.05;

struct AccuracyRow {
  /// Wanted.
  double error;
  /// The cheapest ones for short and for long communication steps.
  std::array<SolverMethod, 2> method;
  /// Of each method; 0 = not reached.
  std::array<double, kColumns> rtol;
};
struct AccuracyTable {
  const AccuracyRow* row;
  size_t size;
  int dockings;  ///< that were measured

  template <size_t n>
  constexpr AccuracyTable(const std::array<AccuracyRow, n>& rows, int measured)
      : row(rows.data()), size(n), dockings(measured) {}
};

constexpr std::array<AccuracyRow, 12> kRowsOfPassiveRings = {{
    {0.1, {kRosenbrock, kRosenbrock}, {0.00014, 0.0016, 0.0047}},
    {0.03, {kRosenbrock, kRosenbrock}, {6.1e-05, 9.2e-05, 0.0023}},
    {0.01, {kRosenbrock, kRosenbrock}, {3.3e-05, 8.4e-06, 0.0012}},
    {0.003, {kRosenbrock, kRosenbrock}, {1.7e-05, 1.5e-06, 0.00043}},
    {0.001, {kRosenbrock, kRosenbrock}, {4e-06, 3.5e-07, 0.00016}},
    {0.0003, {kRosenbrock, kRosenbrock}, {4.8e-07, 7.5e-08, 4.7e-05}},
    {0.0001, {kRosenbrock, kRosenbrock}, {2.1e-07, 1.9e-08, 1.5e-05}},
    {3e-05, {kStabilised, kStabilised}, {8.2e-08, 5e-09, 4.7e-06}},
    {1e-05, {kStabilised, kStabilised}, {3.4e-08, 1.6e-09, 1.7e-06}},
    {3e-06, {kStabilised, kStabilised}, {1.3e-08, 4.5e-10, 5.8e-07}},
    {1e-06, {kStabilised, kStabilised}, {3.5e-09, 1.4e-10, 2.1e-07}},
    {3e-07, {kStabilised, kStabilised}, {6.8e-10, 0, 0}},
}};
constexpr AccuracyTable kPassiveRings(kRowsOfPassiveRings, 77);

constexpr std::array<AccuracyRow, 11> kRowsOfPassiveRingsWithBristles = {{
    {0.1, {kStabilised, kStabilised}, {1.5e-05, 0, 0}},
    {0.03, {kStabilised, kStabilised}, {3.4e-06, 0, 0}},
    {0.01, {kStabilised, kStabilised}, {6.3e-07, 0, 0}},
    {0.003, {kStabilised, kStabilised}, {2.5e-07, 0, 0}},
    {0.001, {kStabilised, kStabilised}, {1.1e-07, 0, 0}},
    {0.0003, {kStabilised, kStabilised}, {3.1e-08, 0, 0}},
    {0.0001, {kStabilised, kStabilised}, {8.6e-09, 0, 0}},
    {3e-05, {kStabilised, kStabilised}, {7.4e-10, 0, 0}},
    {1e-05, {kStabilised, kStabilised}, {3.2e-10, 0, 0}},
    {3e-06, {kStabilised, kStabilised}, {1.3e-10, 0, 0}},
    {2.3e-06, {kStabilised, kStabilised}, {1e-10, 0, 0}},
}};
constexpr AccuracyTable kPassiveRingsWithBristles(kRowsOfPassiveRingsWithBristles, 30);

constexpr std::array<AccuracyRow, 11> kRowsOfOthers = {{
    {0.1, {kRosenbrock, kRosenbrock}, {6.3e-05, 3e-05, 0.00055}},
    {0.03, {kRosenbrock, kRosenbrock}, {4.2e-06, 2.9e-06, 7.6e-05}},
    {0.01, {kRosenbrock, kRosenbrock}, {9.5e-07, 6.4e-07, 3.4e-05}},
    {0.003, {kStabilised, kStabilised}, {1.9e-07, 1.7e-07, 1.4e-05}},
    {0.001, {kStabilised, kStabilised}, {4e-08, 4.9e-08, 9e-07}},
    {0.0003, {kStabilised, kStabilised}, {7.4e-09, 1.2e-08, 3.5e-07}},
    {0.0001, {kStabilised, kStabilised}, {2.1e-09, 4.1e-09, 1.5e-07}},
    {3e-05, {kStabilised, kStabilised}, {5.3e-10, 1.4e-09, 0}},
    {1e-05, {kStabilised, kStabilised}, {1.6e-10, 2.1e-10, 0}},
    {3e-06, {kStabilised, kStabilised}, {3.6e-11, 0, 0}},
    {1.2e-06, {kStabilised, kStabilised}, {1.1e-11, 0, 0}},
}};
constexpr AccuracyTable kOthers(kRowsOfOthers, 119);

constexpr std::array<AccuracyRow, 6> kRowsOfOthersWithBristles = {{
    {0.1, {kStabilised, kStabilised}, {6e-06, 0, 0}},
    {0.03, {kStabilised, kStabilised}, {6e-07, 0, 0}},
    {0.01, {kStabilised, kStabilised}, {1.3e-08, 0, 0}},
    {0.003, {kStabilised, kStabilised}, {6.5e-10, 0, 0}},
    {0.001, {kStabilised, kStabilised}, {2.5e-10, 0, 0}},
    {0.00036, {kStabilised, kStabilised}, {1.1e-10, 0, 0}},
}};
constexpr AccuracyTable kOthersWithBristles(kRowsOfOthersWithBristles, 59);

}  // namespace dockloop
