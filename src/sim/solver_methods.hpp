// List of integration methods: numbers, names and properties.
//
// Messages, the description of the variable solver.method and the grid of `dockloop trade` use this
// list. A new method needs an enumerator, a row in solver_methods.cpp, and a solver.
#pragma once

#include <array>
#include <string>

#include "math/choice.hpp"

namespace dockloop {

/// Values of solver.method. A number and its name stay reserved if no build contains the method.
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

/// Builds that contain a method: all; those with src/compare; none any longer.
enum class Carried { kAlways, kForComparison, kNoLonger };

struct MethodFacts {
  SolverMethod method;
  const char* name;
  const char* meaning;  ///< text in the description of solver.method
  Carried carried;
  bool fixed_step = false;    ///< equal steps of solver.step
  bool is_multistep = false;  ///< restarts with order 1; iterates with the Jacobian of the rates
  int same_as = 0;            ///< number of the method that this is another name of; 0: none
  int without_structure = 0;  ///< method of models that needs_other_matrix(); 0: the same

  bool is_carried(bool has_comparison) const {
    return carried == Carried::kAlways || (has_comparison && carried == Carried::kForComparison);
  }
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

/// Choices: all names, or the methods of a build with or without src/compare.
const ChoiceList& get_method_choices();
ChoiceList list_carried_methods(bool has_comparison);

class Comparison;
/// Additional methods of an FMU library; null for the core only. fmu/no_comparison.cpp defines this
/// function for the FMU, src/compare/fmu_comparison.cpp for dockloop_compare.so. A library links
/// one of the two files.
const Comparison* get_fmu_comparison();

/// End of the message with which a build refuses a method that it does not carry, or model.level 4.
/// The text follows the number.
std::string describe_missing_method(int number);
std::string describe_missing_reference_level();

}  // namespace dockloop
