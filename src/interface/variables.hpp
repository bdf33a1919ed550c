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

#include "math/choice.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {

/// FMI type of a row, and what its pointers point at: double, int, char (0 or 1).
enum class Type { kReal, kInteger, kBoolean };
enum class Causality { kParameter, kInput, kOutput, kLocal };
enum class Variability { kFixed, kTunable, kDiscrete, kContinuous };

/// What a number measures: a type of modelDescription.xml, to which every Real row refers.
struct Quantity {
  const char* name = "";     ///< of the type
  const char* unit = "";     ///< a name in unit_definitions()
  const char* display = "";  ///< unit that people read it in: a display unit of that unit, or empty
  double nominal = 1.0;      ///< typical size, in the unit
  const char* physical = "";     ///< physical quantity, empty when it is just a number
  const char* description = "";  ///< one line
};

struct Variable {
  std::string name;         ///< structured, a.b[1]
  std::string description;  ///< one line, with the meaning of every choice
  Type type = Type::kReal;
  Causality causality = Causality::kOutput;
  Variability variability = Variability::kContinuous;
  Quantity quantity{};                  ///< Real only: its declared type
  const ChoiceList* choices = nullptr;  ///< Integer only: what its numbers mean, if they are names
  const char* unit = "";                ///< Real only, a name in unit_definitions()
  const char* display_unit = "";        ///< a display unit of that unit, or empty
  double min = -std::numeric_limits<double>::infinity();  ///< inclusive, infinite = no limit
  double max = std::numeric_limits<double>::infinity();
  double nominal = 1.0;         ///< typical size, in the unit
  void* start = nullptr;        ///< what a set writes; null: computed, initial="calculated"
  const void* value = nullptr;  ///< what a get reads after initialisation
  double* slope = nullptr;      ///< input: where its rate over the coming step is written
  int input = -1;               ///< place among the inputs, as for_each_value() counts, or -1
  int output = -1;              ///< place among the continuous outputs, the same way, or -1
  int state = -1;               ///< place in the state vector, or -1
  bool jumps = false;           ///< a state that events may set anew
  OutputGroup group = OutputGroup::kMain;  ///< what is computed when it is asked for
  int rate = -1;                           ///< place of the state that this is the rate of, or -1

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

constexpr double kLargestValue = 1e30;  ///< in SI units; products of larger ones would overflow

/// Can a row hold this value? `function` is who was told it.
/// @throws ModelError naming function, variable, value and limit
void check_value(const Variable& v, double value, const char* function);

}  // namespace dockloop
