// The one table of FMU variables.
//
// modelDescription.xml, the get and set functions and the checks on values all read these rows;
// nothing else lists variables. A row knows where its value lives inside a DockingSim, so a table
// belongs to one instance. Which rows exist is decided by the scene: how its vehicles move, which
// output groups it asks for, and how many legs, latches, petals, loops and coordinates it has.
//
// The value reference of a row is its index, one numbering for all types.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "sim/docking_sim.hpp"

namespace dockloop {

/// FMI type of a row, and what its pointers point at: double, int, char (0 or 1).
enum class Type { kReal, kInteger, kBoolean };
enum class Causality { kParameter, kInput, kOutput };
enum class Variability { kFixed, kDiscrete, kContinuous };

struct Variable {
  std::string name;         ///< structured, a.b[1]
  std::string description;  ///< one line, with the meaning of every choice
  Type type = Type::kReal;
  Causality causality = Causality::kOutput;
  Variability variability = Variability::kContinuous;
  const char* unit = "";          ///< Real only, a name in unit_definitions()
  const char* display_unit = "";  ///< a display unit of that unit, or empty
  double min = -std::numeric_limits<double>::infinity();  ///< inclusive, infinite = no limit
  double max = std::numeric_limits<double>::infinity();
  double nominal = 1.0;         ///< typical size, in the unit
  void* start = nullptr;        ///< what a set writes; null: computed, initial="calculated"
  const void* value = nullptr;  ///< what a get reads after initialisation

  /// Can be set before initialisation (or at any time: input). Otherwise the FMU computes it.
  bool has_start() const { return start != nullptr; }
};

/// Unit with its exponents of kg, m, s, rad, and other units to show it in.
struct DisplayUnit {
  const char* name;
  double factor;  ///< displayed number = factor * number in the unit
};
struct Unit {
  const char* name;
  int kg, m, s, rad;
  std::vector<DisplayUnit> display;
};
const std::vector<Unit>& unit_definitions();

/// The rows of this instance. Pointers stay valid as long as `sim` lives.
std::vector<Variable> make_variables(DockingSim& sim);

}  // namespace dockloop
