// List of integration methods: numbers, names and properties.
//
// Messages, the description of the variable solver.method and the grid of `dockloop trade` use this
// list. A new method needs an enumerator, a row in solver_methods.cpp, and a solver.
#pragma once

#include <array>
#include <string>

#include "math/choice.hpp"

namespace dockloop {

/// Values of solver.method. A number stays reserved if a build does not contain the method.
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
  kRosenbrock = 12,
  kFixedRosenbrock = 13,
};
constexpr int kMethodCount = kFixedRosenbrock;

struct MethodFacts {
  SolverMethod method;
  const char* name;
  const char* meaning;             ///< text in the description of solver.method
  bool for_comparison;             ///< part of src/compare, not of core and FMU
  bool fixed_step = false;         ///< equal steps of solver.step
  bool needs_jacobian = false;     ///< needs the Jacobian of the rates
  bool begins_with_rates = false;  ///< a step uses the rates at the start
  int same_as = 0;                 ///< number of the method that this is another name of; 0: none
  int without_structure = 0;       ///< method of models that needs_other_matrix(); 0: the same
};

/// All methods, in the order of their numbers, from 1.
const std::array<MethodFacts, kMethodCount>& list_methods();

/// @return null if there is no method of this number
const MethodFacts* find_method(int number);

/// Number of the method that makes the steps; see MethodFacts::same_as. @pre find_method()
int find_used_method(int number);

/// The method whose steps a model takes. @param needs_other  needs_other_matrix(). @pre
/// find_method()
const MethodFacts* find_method(int number, bool needs_other);

/// Choices: all methods, or the methods of a build with or without src/compare.
const ChoiceList& get_method_choices();
ChoiceList list_carried_methods(bool has_comparison);

class Comparison;
/// Additional methods of an FMU library; null for the core only. fmu/no_comparison.cpp defines this
/// function for the FMU, src/compare/fmu_comparison.cpp for dockloop_compare.so. A library links
/// one of the two files.
const Comparison* get_fmu_comparison();

/// End of the message with which a build without src/compare refuses this method, or model.level 4.
/// The text follows the number.
std::string describe_missing_method(int number);
std::string describe_missing_reference_level();

}  // namespace dockloop
