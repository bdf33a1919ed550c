// The one table of FMU variables.
//
// modelDescription.xml, getters and setters, and the checks of values read these rows; there is no
// other list of variables. A row points to its value inside a DockingSim, so a table belongs to one
// instance. The scene determines the rows: motion of its vehicles, output groups, and numbers of
// legs, latches, petals, loops and coordinates.
//
// The value reference of a row is its index, one numbering for all types.
#pragma once

#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "math/choice.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {

/// FMI type of a row, and type of its values: double, int, char (0 or 1).
enum class Type { kReal, kInteger, kBoolean };
enum class Causality { kParameter, kInput, kOutput, kLocal };
enum class Variability { kFixed, kTunable, kDiscrete, kContinuous };

/// Names of FMI.
const char* name_of(Type type);
const char* name_of(Causality causality);
const char* name_of(Variability variability);

/// A quantity: a type of modelDescription.xml, to which every Real row refers.
struct Quantity {
  const char* name = "";         ///< of the type
  const char* unit = "";         ///< a name in unit_definitions()
  const char* display = "";      ///< display unit, or empty
  double nominal = 1.0;          ///< typical size, in the unit
  const char* physical = "";     ///< physical quantity, or empty
  const char* description = "";  ///< one line
};

struct Variable {
  std::string name;         ///< structured, a.b[1]
  std::string description;  ///< one line, with the meaning of every choice
  Type type = Type::kReal;
  Causality causality = Causality::kOutput;
  Variability variability = Variability::kContinuous;
  Quantity quantity{};                  ///< Real only: its declared type
  const ChoiceList* choices = nullptr;  ///< Integer only: meanings of the numbers, or null
  const char* unit = "";                ///< Real only, a name in unit_definitions()
  const char* display_unit = "";        ///< display unit, or empty
  double min = -std::numeric_limits<double>::infinity();  ///< inclusive, infinite = no limit
  double max = std::numeric_limits<double>::infinity();
  std::map<int, std::string> refused;  ///< values inside these limits, and why; after the number
  double nominal = 1.0;                ///< typical size, in the unit
  void* start = nullptr;               ///< written by setters; null: computed, initial="calculated"
  const void* value = nullptr;         ///< read by getters after initialisation
  double* slope = nullptr;             ///< input: place of its rate over the coming step
  int input = -1;                      ///< number of the input in for_each_value(), or -1
  int output = -1;     ///< number of the continuous output in for_each_value(), or -1
  int state = -1;      ///< place in the state vector, or -1
  bool jumps = false;  ///< a state that events may change
  OutputGroup group = OutputGroup::kMain;  ///< computed by the first getter call
  int rate = -1;                           ///< for a rate: place of its state, or -1

  /// Can be set before initialisation (or at any time: input). Otherwise the FMU computes it.
  bool has_start() const { return start != nullptr; }
};

/// Unit with its exponents of kg, m, s, rad, and its display units.
struct DisplayUnit {
  const char* name;
  double factor;  ///< displayed number = factor * number in the unit
};
struct Unit {
  const char* name;
  int kg, m, s, rad;
  std::vector<DisplayUnit> display;
  int A = 0;
};
const std::vector<Unit>& unit_definitions();

/// A load between ring and target: `capture.NAME` and `capture.peak.NAME`.
struct Load {
  Outputs::Load index;
  const char* name;
  const char* text;
  Quantity quantity;
};
const std::vector<Load>& list_loads();

/// The rows of this instance. Pointers stay valid as long as `sim` lives.
std::vector<Variable> make_variables(DockingSim& sim);

/// GUID of the FMU, 32 hex digits: another one as soon as the document of the scene, or the name,
/// order, type or meaning of a row changes.
std::string find_guid(const Scene& scene, const std::vector<Variable>& rows);

constexpr double kLargestValue = 1e30;  ///< in SI units; products of larger values would overflow

inline bool is_usable(double value) { return std::abs(value) <= kLargestValue; }

/// What a message says of a value that is not usable, to be put after its name.
std::string describe_unusable(double value);

/// Check a value for a row. @param function  name of the FMI function with this value
/// @throws ModelError naming function, variable, value and limit
void check_value(const Variable& v, double value, const char* function);

}  // namespace dockloop
