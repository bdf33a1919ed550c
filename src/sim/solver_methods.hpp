// The one list of integration methods: numbers, names, and what the simulation must know of each.
//
// Messages, the description of the variable solver.method and the grid of `dockloop trade` are made
// from this list. A new method is an enumerator, a row in solver_methods.cpp, and its solver.
#pragma once

#include <array>
#include <string>

#include "math/choice.hpp"

namespace dockloop {

/// Values of solver.method; numbers of the interface. They stay reserved where a build lacks one.
enum SolverMethod {
  kAuto = 1,
  kExplicit = 2,
  kImplicit = 3,
  kImex = 4,
  kAdams = 5,
  kBdf = 6,
  kFixedRk4 = 7,
  kFixedImplicit = 8,
  kDae = 9,
  kHighOrder = 10,
  kStabilised = 11,
};
constexpr int kMethodCount = kStabilised;

struct MethodFacts {
  SolverMethod method;
  const char* name;
  const char* meaning;             ///< for people, in the description of solver.method
  bool for_comparison;             ///< lives in src/compare, which core and FMU do not carry
  bool fixed_step = false;         ///< equal steps of solver.step
  bool needs_jacobian = false;     ///< of the rates
  bool begins_with_rates = false;  ///< a step begins with the rates at its start
  SolverMethod same_as = method;   ///< another name of that one
};

/// In the order of their numbers, from 1 on.
const std::array<MethodFacts, kMethodCount>& list_methods();

/// @return null if there is no method of this number
const MethodFacts* find_method(int number);

/// The same as choices: all of them, and those that a build with or without src/compare carries.
const ChoiceList& get_method_choices();
ChoiceList list_carried_methods(bool has_comparison);

class Comparison;
/// What an FMU library carries beyond the core. fmu/no_comparison.cpp defines it for the product,
/// src/compare/fmu_comparison.cpp for dockloop_compare.so; a library links one of them.
const Comparison* get_fmu_comparison();

/// Why a build without src/compare refuses this method, or model.level 4: goes on after the number.
std::string describe_missing_method(int number);
std::string describe_missing_reference_level();

}  // namespace dockloop
