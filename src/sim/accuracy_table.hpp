// Written by tests/studies/accuracy.py from tests/data/accuracy.json: do not edit.
//
// Tolerances with which 95 % of random dockings stay below an error (accuracy.hpp).
#pragma once

#include <array>

#include "sim/solver_methods.hpp"

namespace dockloop {

constexpr int kCalibrationCount = 70;  ///< dockings
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
constexpr std::array<AccuracyRow, 11> kAccuracyTable = {{
    {0.1, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {0.00015, 0.00024, 0.0032}},
    {0.03, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {5.5e-05, 0.00013, 0.00099}},
    {0.01, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {2.6e-05, 1.5e-05, 0.00043}},
    {0.003, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {1.2e-05, 1.9e-06, 0.00018}},
    {0.001, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {2.8e-06, 4.8e-07, 7.7e-05}},
    {0.0003, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {5.5e-07, 1.3e-07, 3.2e-05}},
    {0.0001, {kRosenbrock, kRosenbrock}, {kStabilised, kStabilised}, {1.5e-07, 3.8e-08, 1.5e-05}},
    {3e-05, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {2.4e-08, 9.7e-09, 3.3e-06}},
    {1e-05, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {2.4e-09, 2.5e-09, 6.9e-07}},
    {3e-06, {kStabilised, kStabilised}, {kStabilised, kStabilised}, {2.7e-10, 6.3e-10, 2e-07}},
    {1e-06, {kBdf, kBdf}, {kBdf, kBdf}, {0, 2.2e-10, 0}},
}};

}  // namespace dockloop
