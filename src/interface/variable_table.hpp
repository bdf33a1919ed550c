// How rows of the variable table are made: quantities, one row, the table; and the groups of rows.
//
// A vector becomes scalars a[1], a[2], ...; a choice becomes an Integer counted from 1 with its
// meanings in the description, because several importers drop Enumeration variables.
#pragma once

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "interface/variables.hpp"

namespace dockloop {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kStraightAngle = 3.141592653589793;  // [rad]
constexpr double kDegrees = 57.29577951308232;        // [deg/rad]

// Types: name, unit, display unit, typical size, physical quantity, text.
constexpr Quantity kNone{"Ratio", "1", "", 1.0, "", "Number without a unit"};
constexpr Quantity kQuaternion{"QuaternionComponent",
                               "1",
                               "",
                               1.0,
                               "Quaternion",
                               "Component of a unit quaternion (w, x, y, z)"};
constexpr Quantity kCount{"Count", "1", "", 1e3, "", "Count since the start"};
constexpr Quantity kCoordinate{
    "Coordinate", "1", "", 0.1, "", "Coordinate of a joint or its rates; 1 means m or rad"};
constexpr Quantity kElementForce{"ElementForce", "1", "",
                                 100.0,          "",  "Force of an element; 1 means N or N m"};
constexpr Quantity kLawNumber{"LawNumber", "1", "", 1.0, "", "Number of a force law, in SI units"};
constexpr Quantity kLength{"Length", "m",      "",
                           1.0,      "Length", "Position of a vehicle or docking interface"};
constexpr Quantity kSmallLength{
    "MechanismLength", "m", "mm", 0.1, "Length", "Length in the docking mechanism"};
constexpr Quantity kVelocity{"Velocity", "m/s", "", 0.1, "Velocity", "Velocity of a vehicle"};
constexpr Quantity kSmallVelocity{
    "MechanismVelocity", "m/s", "mm/s", 0.1, "Velocity", "Velocity in the docking mechanism"};
constexpr Quantity kAngle{"Angle", "rad", "deg", 0.1, "Angle", "Angle"};
constexpr Quantity kAngularVelocity{"AngularVelocity", "rad/s",           "deg/s", 0.01,
                                    "AngularVelocity", "Angular velocity"};
constexpr Quantity kAcceleration{
    "Acceleration", "m/s2", "", 1.0, "Acceleration", "Acceleration of free fall"};
constexpr Quantity kTime{"Time", "s", "", 1.0, "Time", "Time or duration"};
constexpr Quantity kMass{"Mass", "kg", "t", 1e4, "Mass", "Mass of a vehicle"};
constexpr Quantity kInertia{
    "Inertia", "kg.m2", "", 1e6, "MomentOfInertia", "Moment or product of inertia of a vehicle"};
constexpr Quantity kForce{"Force", "N", "", 100.0, "Force", "Force"};
constexpr Quantity kTorque{"Torque", "N.m", "", 100.0, "Torque", "Torque or moment"};
constexpr Quantity kEnergy{"Energy", "J", "", 10.0, "Energy", "Energy or work"};
constexpr Quantity kPower{"Power", "W", "", 10.0, "Power", "Power"};
constexpr Quantity kPerSecond{"PerSecond", "1/s", "", 1.0, "", "Rate of change, per second"};
constexpr Quantity kMomentum{"Momentum", "N.s", "", 1e3, "Momentum", "Linear momentum or impulse"};
constexpr Quantity kStiffness{"Stiffness", "N/m", "", 1e6, "", "Stiffness of a part"};
constexpr Quantity kDamping{"Damping", "N.s/m", "", 1e3, "", "Force per speed"};
constexpr Quantity kDampingFactor{
    "DampingFactor", "s/m", "", 1.0, "", "Factor of a speed on an elastic force"};
constexpr Quantity kMagneticMoment{
    "MagneticMoment", "A.m2", "", 1.0, "", "Moment of a magnet, as a dipole"};
constexpr Quantity kAngularMomentum{"AngularMomentum", "N.m.s",           "", 1e3,
                                    "AngularMomentum", "Angular momentum"};

/// Name of element i of a vector of n, for the description.
inline std::string element_name(size_t i, size_t n) {
  static constexpr const char* kAxes[] = {"x", "y", "z"};
  static constexpr const char* kQuaternionOrder[] = {"w", "x", "y", "z"};
  static constexpr const char* kInertiaOrder[] = {"xx", "yy", "zz", "xy", "xz", "yz"};
  return n == 3 ? kAxes[i] : n == 4 ? kQuaternionOrder[i] : kInertiaOrder[i];
}

inline std::string indexed(const std::string& name, size_t i) {
  return name + "[" + std::to_string(i + 1) + "]";
}

/// Quantity of the rate of change of a quantity.
inline Quantity rate_of(const Quantity& quantity) {
  const std::string unit = quantity.unit;
  if (unit == "m") return kVelocity;
  if (unit == "N.s") return kForce;
  if (unit == "N.m.s") return kTorque;
  if (unit == "J") return kPower;
  return kPerSecond;
}

constexpr Type type_of(const double*) { return Type::kReal; }
constexpr Type type_of(const int*) { return Type::kInteger; }
constexpr Type type_of(const char*) { return Type::kBoolean; }
constexpr Type type_of(const bool*) { return Type::kBoolean; }
static_assert(sizeof(bool) == sizeof(char), "Boolean rows read bool through char");

/// Limits of the row or the rows of a vector that were just added.
class Row {
 public:
  Row(std::vector<Variable>& rows, size_t first) : rows_(rows), first_(first) {}
  Row limits(double min, double max) {
    return each([&](Variable& v) {
      v.min = min;
      v.max = max;
    });
  }
  /// The numbers mean names, which the description lists.
  Row choices(const ChoiceList& list) { return choices(list, list); }
  /// The same, if this build contains only the choices `carried`.
  Row choices(const ChoiceList& list, const ChoiceList& carried) {
    return limits(list.front().number, carried.back().number).each([&](Variable& v) {
      v.choices = &list;
      v.description += ": " + list_choices(carried);
    });
  }
  Row not_negative() { return limits(0.0, kInfinity); }
  /// A value inside the limits that this build does not contain.
  Row refuse(int value, const std::string& why) {
    return each([&](Variable& v) { v.refused[value] = why; });
  }
  Row nominal(double size) {
    return each([&](Variable& v) { v.nominal = size; });
  }
  /// A state that events may change.
  Row jumps() {
    return each([](Variable& v) { v.jumps = true; });
  }
  /// May be changed between steps.
  Row tunable() {
    return each([](Variable& v) { v.variability = Variability::kTunable; });
  }
  Row group(OutputGroup group) {
    return each([&](Variable& v) { v.group = group; });
  }
  Row discrete() {
    return each([](Variable& v) { v.variability = Variability::kDiscrete; });
  }

 private:
  template <class F>
  Row each(F&& change) {
    for (size_t i = first_; i < rows_.size(); ++i) change(rows_[i]);
    return *this;
  }

  std::vector<Variable>& rows_;
  size_t first_;
};

class Table {
 public:
  /// Fixed at the start.
  template <class T>
  Row parameter(std::string name, T* value, Quantity quantity, std::string description) {
    return add(std::move(name), Causality::kParameter, Variability::kFixed, value, value, quantity,
               std::move(description));
  }
  /// Set by the host at any communication point.
  template <class T>
  Row input(std::string name, T* value, Quantity quantity, std::string description) {
    return add(std::move(name), Causality::kInput, natural(value), value, value, quantity,
               std::move(description));
  }
  /// Computed; an Integer or Boolean changes only at communication points.
  template <class T>
  Row output(std::string name, const T* value, Quantity quantity, std::string description) {
    return add(std::move(name), Causality::kOutput, natural(value), nullptr, value, quantity,
               std::move(description));
  }
  /// Neither input nor output: the state vector and its rates.
  Row local(std::string name, const double* value, Quantity quantity, std::string description) {
    return append(std::move(name), Causality::kLocal, Variability::kContinuous, Type::kReal,
                  nullptr, value, quantity, std::move(description))
        .group(OutputGroup::kStateVector);
  }
  /// Computed from the start value that the host may set.
  Row state(std::string name, double* start, const double* value, Quantity quantity,
            std::string description) {
    return add(std::move(name), Causality::kOutput, Variability::kContinuous, start, value,
               quantity, std::move(description));
  }

  /// Fixed-size vectors, one row per element.
  template <class V>
  Row parameters(const std::string& name, V& value, Quantity quantity, const std::string& text) {
    const size_t first = rows_.size();
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      parameter(std::move(element), &value[i], quantity, std::move(description));
    });
    return Row(rows_, first);
  }
  template <class V>
  void inputs(const std::string& name, V& value, Quantity quantity, const std::string& text) {
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      input(std::move(element), &value[i], quantity, std::move(description));
    });
  }
  template <class V>
  Row outputs(const std::string& name, V& value, Quantity quantity, const std::string& text) {
    const size_t first = rows_.size();
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      output(std::move(element), &value[i], quantity, std::move(description));
    });
    return Row(rows_, first);
  }
  template <class V>
  void states(const std::string& name, V& start, V& value, Quantity quantity,
              const std::string& text) {
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      state(std::move(element), &start[i], &value[i], quantity, std::move(description));
    });
  }

  /// A row der(x) for every row x of the state vector.
  void add_rates(const std::vector<double>& states, const std::vector<double>& rates) {
    const size_t first = rows_.size() - states.size();
    for (size_t i = 0; i < states.size(); ++i) {
      rows_[first + i].state = static_cast<int>(i);
      const std::string name = rows_[first + i].name;
      const Quantity quantity = rate_of(rows_[first + i].quantity);
      local("der(" + name + ")", &rates[i], quantity, "Rate of change of " + name + ", per second");
      rows_.back().rate = static_cast<int>(i);
    }
  }

  std::vector<Variable> take() { return std::move(rows_); }

 private:
  template <class T>
  static constexpr Variability natural(const T* value) {
    return type_of(value) == Type::kReal ? Variability::kContinuous : Variability::kDiscrete;
  }

  template <class V, class F>
  static void each(const std::string& name, const V& vector, const std::string& text, F&& f) {
    const size_t n = static_cast<size_t>(vector.size());
    for (size_t i = 0; i < n; ++i) f(i, indexed(name, i), text + ", " + element_name(i, n));
  }

  template <class T>
  Row add(std::string name, Causality causality, Variability variability, T* start, const T* value,
          Quantity quantity, std::string description) {
    return append(std::move(name), causality, variability, type_of(value), start, value, quantity,
                  std::move(description));
  }
  template <class T>
  Row add(std::string name, Causality causality, Variability variability, std::nullptr_t,
          const T* value, Quantity quantity, std::string description) {
    return append(std::move(name), causality, variability, type_of(value), nullptr, value, quantity,
                  std::move(description));
  }
  Row append(std::string name, Causality causality, Variability variability, Type type, void* start,
             const void* value, Quantity quantity, std::string description) {
    Variable& v = rows_.emplace_back();
    v.name = std::move(name);
    v.description = std::move(description);
    v.type = type;
    v.causality = causality;
    v.variability = variability;
    if (type == Type::kReal) {
      v.quantity = quantity;
      v.unit = quantity.unit;
      v.display_unit = quantity.display;
      v.nominal = quantity.nominal;
    }
    v.start = start;
    v.value = value;
    return Row(rows_, rows_.size() - 1);
  }

  std::vector<Variable> rows_;
};

// variables_docking.cpp

void add_vehicle(Table& table, DockingSim& sim, VehicleIndex index);
void add_relative(Table& table, Outputs& out);
void add_stack(Table& table, Outputs& out);
/// A peak: its value, time and step of the sequence.
/// @param before, after  of the names: BEFORE.peak_time.AFTER
void add_peak(Table& table, const std::string& before, const std::string& after, const Peak& peak,
              Quantity quantity, const std::string& text);
void add_capture(Table& table, Outputs& out);
void add_contact(Table& table, const ContactModel& contact, Parameters& parameter, Outputs& out);
void add_progress(Table& table, Outputs& out);
void add_phase(Table& table, Parameters& parameter, Outputs& out);
void add_sequence(Table& table, const Sequence& sequence, Inputs& in, Outputs& out);

// variables_mechanism.cpp

void add_ring(Table& table, Outputs& out);
void add_legs(Table& table, const MechanismModel& mechanism, Inputs& in, Outputs& out);
void add_parts(Table& table, const Scene& scene, Outputs& out);
void add_elements(Table& table, DockingSim& sim);
void add_disturbances(Table& table, DockingSim& sim);
void add_failures(Table& table, DockingSim& sim);
void add_hard_dock(Table& table, const HardDock& dock, Inputs& in, Outputs& out);
void add_vehicle_forces(Table& table, const Scene& scene, Outputs& out);
void add_hardware(Table& table, DockingSim& sim);
void add_states(Table& table, Outputs& out);
void add_loops(Table& table, Outputs& out);

// variables_solver.cpp

void add_energy(Table& table, Outputs& out, const Scene& scene);
void add_state_vector(Table& table, const Scene& scene, Outputs& out);
void add_coupling_parameters(Table& table, Parameters& parameter, Inputs& in);
void add_coupling_outputs(Table& table, Outputs& out);
void add_model_parameters(Table& table, Parameters& parameter, bool has_comparison);
void add_solver_parameters(Table& table, Parameters& parameter, bool has_comparison);
void add_solver_outputs(Table& table, Outputs& out, bool has_comparison);

}  // namespace dockloop
