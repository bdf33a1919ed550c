// Written by tests/studies/accuracy.py from tests/data/accuracy.json: do not edit.
//
// Tolerances with which 95 % of random dockings stay below an error (accuracy.hpp).
#pragma once

#include <array>

#include "sim/solver_methods.hpp"

namespace dockloop {

constexpr size_t kColumns = 3;
constexpr std::array<SolverMethod, kColumns> kCalibratedMethods = {kStabilised, kBdf, kRosenbrock};

// Absolute tolerances over the relative one: [m], [m/s], [J].
constexpr double kAtolPosition = 0.01;
constexpr double kAtolVelocity = 0.01;
constexpr double kAtolEnergy = 0.1;

/// Limit between short and long communication steps [s].
constexpr double kLongStep = 0.05;

struct AccuracyRow {
  /// Wanted.
  double error;
  /// The cheapest ones for short and for long communication steps.
  std::array<SolverMethod, 2> method;
  /// The same where contacts have bristles.
  std::array<SolverMethod, 2> with_bristles;
  /// Of each method; 0 = not reached.
  std::array<double, kColumns> rtol;
};
struct AccuracyTable {
  const AccuracyRow* row;
  size_t size;
  int dockings;  ///< that were measured
};

constexpr std::array<AccuracyRow, 12> kErrorsOfPassiveRings = {{
    {0.1, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {0.0004, 0.0023, 0.0057}},
    {0.03, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {0.00012, 0.0005, 0.0028}},
    {0.01, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {5.7e-05, 0.00013, 0.0015}},
    {0.003, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {2.6e-05, 4.4e-06, 0.0006}},
    {0.001, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {1.3e-05, 7.7e-07, 0.00021}},
    {0.0003, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {4.1e-06, 1.7e-07, 6.6e-05}},
    {0.0001, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {1.1e-06, 4.3e-08, 2.1e-05}},
    {3e-05, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {8e-08, 9.8e-09, 6.4e-06}},
    {1e-05, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {3.8e-08, 2.8e-09, 2.3e-06}},
    {3e-06, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {1.7e-08, 7.5e-10, 7.8e-07}},
    {1e-06, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {6.5e-09, 2.4e-10, 2.8e-07}},
    {3e-07, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {1.5e-09, 0, 0}},
}};
constexpr AccuracyTable kPassiveRings = {kErrorsOfPassiveRings.data(), 12, 47};

constexpr std::array<AccuracyRow, 12> kErrorsOfOthers = {{
    {0.1, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {3.1e-05, 0.00038, 0.0019}},
    {0.03, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {1.5e-05, 0.00013, 0.00049}},
    {0.01, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {4.3e-06, 6.6e-06, 0.00011}},
    {0.003, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {6.5e-07, 1.5e-06, 5.5e-05}},
    {0.001, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {2e-07, 3.4e-07, 3e-05}},
    {0.0003, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {3.5e-08, 7e-08, 1.6e-05}},
    {0.0001, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {6.6e-09, 2.2e-08, 7.1e-06}},
    {3e-05, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {2.1e-09, 6.2e-09, 1.4e-06}},
    {1e-05, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {7.6e-10, 2.1e-09, 4.4e-07}},
    {3e-06, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {2.5e-10, 3.9e-10, 1.3e-07}},
    {1e-06, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {9.3e-11, 0, 0}},
    {3e-07, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {3e-11, 0, 0}},
}};
constexpr AccuracyTable kOthers = {kErrorsOfOthers.data(), 12, 59};

}  // namespace dockloop
