// One dial for the integration: from a wanted error to method, tolerances and inner step.
//
//   accuracy = 0    the parameters solver.* as they are
//   accuracy > 0    wanted relative error of peak loads, stroke, time of capture and final motion;
//                   method and tolerances come from measured dockings (accuracy_table.hpp)
//   accuracy = -1   real time: a method of fixed steps; the step follows from the fastest rates of
//                   the equations
//
// A parameter solver.* that differs from its default is explicit: it stays as it is, whether scene
// or host has set it.
#pragma once

#include <string>

#include "docking/docking_model.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Method, tolerances and step in use.
struct SolverChoice : SolverSettings {
  bool needs_step = false;      ///< `step` follows from the equations at the start
  double error_estimate = 0.0;  ///< [-] 95 % of the measured dockings were below; 0 = not known
  std::string stated;           ///< names of explicit settings, with commas
};

/// @throws ModelError if it is no value of accuracy
void check_accuracy(double accuracy);

/// @param tolerance  relative, of the host; 0 = none given
SolverChoice choose_solver(const Parameters& parameters, double tolerance,
                           const DockingModel& model);

/// The choice and its reason in one sentence. @pre parameters.accuracy != 0
std::string describe_choice(const Parameters& parameters, const SolverChoice& choice,
                            double tolerance, const DockingModel& model);

}  // namespace dockloop
