// Written by tests/studies/accuracy.py from tests/data/accuracy.json: do not edit.
//
// Tolerances with which 95 % of random dockings stay below an error (accuracy.hpp).
#pragma once

#include <array>

#include "sim/solver_methods.hpp"

namespace dockloop {

constexpr int kCalibrationCount = 47;  ///< dockings
constexpr size_t kColumns = 2;
constexpr std::array<SolverMethod, kColumns> kCalibratedMethods = {kAuto, kBdf};

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
  /// Of each method; 0 = not reached.
  std::array<double, kColumns> rtol;
};
constexpr std::array<AccuracyRow, 11> kAccuracyTable = {{
    {0.1, {kBdf, kBdf}, {0.00017, 0.0023}},
    {0.03, {kBdf, kBdf}, {6e-05, 0.00048}},
    {0.01, {kBdf, kBdf}, {3.2e-05, 0.00011}},
    {0.003, {kAuto, kBdf}, {1.6e-05, 4.4e-06}},
    {0.001, {kAuto, kBdf}, {6.6e-06, 7.7e-07}},
    {0.0003, {kAuto, kBdf}, {1.4e-06, 1.7e-07}},
    {0.0001, {kAuto, kBdf}, {2.3e-07, 4.3e-08}},
    {3e-05, {kAuto, kBdf}, {3.4e-08, 9.7e-09}},
    {1e-05, {kAuto, kBdf}, {3.8e-09, 2.9e-09}},
    {3e-06, {kBdf, kBdf}, {2.7e-10, 7.6e-10}},
    {1e-06, {kBdf, kBdf}, {0, 2.3e-10}},
}};

}  // namespace dockloop
