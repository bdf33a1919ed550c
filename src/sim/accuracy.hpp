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
#include "sim/sim_state.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Method, tolerances and step in use.
struct SolverChoice : SolverSettings {
  bool needs_step = false;      ///< `step` follows from the equations at the start
  double atol_scale = 1.0;      ///< of chosen absolute tolerances: a slow docking is smaller
  double error_estimate = 0.0;  ///< [-] 98 % of the measured dockings were below; 0 = not known
  std::string stated;           ///< names of explicit settings, with commas
};

/// @throws ModelError if it is no value of accuracy
void check_accuracy(double accuracy);

/// @param tolerance  relative, of the host; 0 = none given
/// @param speed  of the approach at the start [m/s]
SolverChoice choose_solver(const Parameters& parameters, double tolerance,
                           const DockingModel& model, double speed);

/// The choice and its reason in one sentence. @param method  that makes the steps
/// @pre parameters.accuracy != 0
std::string describe_choice(const Parameters& parameters, const SolverChoice& choice,
                            const MethodFacts& method, double tolerance, const DockingModel& model);

/// Absolute tolerances that are left as they are while the relative one is far tighter: they decide
/// then. @return a sentence, empty where nothing is to be said. @pre error control,
/// parameters.accuracy == 0
std::string describe_forgotten(const Parameters& parameters);

/// What a run has done and has not done until now.
struct WorkDone {
  double time = 0.0;   ///< since the start [s]
  Counters counters;   ///< of the integrator
  double place = 0.0;  ///< largest error of the coordinates of a quiescent mechanism [m]
  int pairs = 0;       ///< of the contact model
  std::int64_t points = 0, read_points = 0;  ///< communication points, and those with outputs
  double accuracy = 0.0;                     ///< wanted, of error control; else 0
};

/// What was left out, and what that is worth, in one sentence; after a long motion in two more, on
/// what can be promised.
std::string describe_left_out(const WorkDone& work);

}  // namespace dockloop
