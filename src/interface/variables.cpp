// Rows of the variable table, one function per group.
//
// A vector becomes scalars a[1], a[2], ...; a choice becomes an Integer counted from 1 with its
// meanings in the description, because several importers drop Enumeration variables.
#include "interface/variables.hpp"

#include <cmath>
#include <map>
#include <utility>

#include "docking/phases.hpp"
#include "interface/model_description.hpp"

namespace dockloop {
namespace {

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
constexpr Quantity kAngularMomentum{"AngularMomentum", "N.m.s",           "", 1e3,
                                    "AngularMomentum", "Angular momentum"};

/// Name of element i of a vector of n, for the description.
std::string element_name(size_t i, size_t n) {
  static constexpr const char* kAxes[] = {"x", "y", "z"};
  static constexpr const char* kQuaternionOrder[] = {"w", "x", "y", "z"};
  static constexpr const char* kInertiaOrder[] = {"xx", "yy", "zz", "xy", "xz", "yz"};
  return n == 3 ? kAxes[i] : n == 4 ? kQuaternionOrder[i] : kInertiaOrder[i];
}

std::string indexed(const std::string& name, size_t i) {
  return name + "[" + std::to_string(i + 1) + "]";
}

/// Quantity of the rate of change of a quantity.
Quantity rate_of(const Quantity& quantity) {
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
  void parameters(const std::string& name, V& value, Quantity quantity, const std::string& text) {
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      parameter(std::move(element), &value[i], quantity, std::move(description));
    });
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

/// Motion, loads and inertia of one vehicle.
void add_vehicle(Table& table, DockingSim& sim, VehicleIndex index) {
  const std::string v = index == kChaser ? "chaser." : "target.";
  const std::string of = index == kChaser ? " of the chaser" : " of the target";
  const std::string body = index == kChaser ? "C" : "D", interface = index == kChaser ? "A" : "P";
  const Motion motion = sim.scene().motion[index];
  VehicleParameters& parameter = sim.parameters().vehicle[index];
  Inputs::Vehicle& input = sim.inputs().vehicle[index];
  Outputs::Vehicle& output = sim.output_storage().vehicle[index];

  // Input from the host, or a result with the initial condition as start value.
  const auto motion_rows = [&](const std::string& name, auto member_of, Quantity quantity,
                               const std::string& text) {
    if (motion == Motion::kDriven) {
      table.inputs(v + name, member_of(input), quantity, text);
    } else {
      table.states(v + name, member_of(parameter), member_of(output), quantity, text);
    }
  };
  motion_rows(
      "position", [](auto& s) -> auto& { return s.position; }, kLength,
      "Centre of mass" + of + " in N");
  motion_rows(
      "velocity", [](auto& s) -> auto& { return s.velocity; }, kVelocity,
      "Velocity of the centre of mass" + of + " in N");
  motion_rows(
      "attitude", [](auto& s) -> auto& { return s.attitude; }, kQuaternion,
      "Attitude quaternion" + of + ", body axes to N");
  motion_rows(
      "angular_velocity", [](auto& s) -> auto& { return s.angular_velocity; }, kAngularVelocity,
      "Angular velocity" + of + " in N, body axes");

  // A fixed vehicle has no loads and no mass.
  if (motion != Motion::kFixed) {
    table.inputs(v + "force_ext", input.force_ext, kForce,
                 "Force from outside on the centre of mass" + of + ", in N");
    table.inputs(v + "torque_ext", input.torque_ext, kTorque,
                 "Torque from outside about the centre of mass" + of + ", body axes");
    table.parameter(v + "mass", &parameter.mass, kMass, "Mass" + of).not_negative();
    table.parameters(v + "inertia", parameter.inertia, kInertia,
                     "Inertia" + of + " about its centre of mass, body axes");
    table
        .parameter(v + "mass_includes_mechanism", &parameter.mass_includes_mechanism, kNone,
                   "Mass and inertia" + of +
                       ": 1 exclude the mechanism, 2 include it, frozen at "
                       "its home pose")
        .limits(1, 2);
  }
  table.parameters(v + "interface_position", parameter.interface_position, kLength,
                   "Origin of the docking interface " + interface + " in " + body);
  table.parameters(
      v + "interface_attitude", parameter.interface_attitude, kQuaternion,
      "Attitude quaternion of the docking interface, axes of " + interface + " to axes of " + body);

  table.outputs(v + "force", output.force, kForce,
                "Force of the docking system on the vehicle at the end of the step, in N");
  table.outputs(v + "torque", output.torque, kTorque,
                "Torque of the docking system on the vehicle at the end of the step, about the "
                "centre of mass, body axes");
  const std::string step = " (the step just made; coupling.mode = 2: the coming step)";
  table.outputs(v + "force_mean", output.force_mean, kForce,
                "Constant force over a step with the true impulse on the vehicle, in N" + step);
  table.outputs(v + "torque_mean", output.torque_mean, kTorque,
                "Constant torque over a step with the true angular impulse on the vehicle, about "
                "the centre of mass, body axes" +
                    step);
}

void add_relative(Table& table, Outputs& out) {
  table.outputs("relative.position", out.relative_position, kLength,
                "Origin of P with respect to A, axes of A");
  table
      .outputs("relative.attitude", out.relative_attitude, kQuaternion,
               "Attitude quaternion of P with respect to A, axes of P to axes of A")
      .limits(-1, 1);
  table.outputs("relative.velocity", out.relative_velocity, kSmallVelocity,
                "Velocity of the origin of P with respect to A, axes of A");
  table.outputs("relative.angular_velocity", out.relative_angular_velocity, kAngularVelocity,
                "Angular velocity of P with respect to A, axes of A");
  table.output("relative.axial", &out.relative_axial, kSmallLength,
               "Distance between the mating planes along the docking axis of A");
  table
      .output("relative.lateral", &out.relative_lateral, kSmallLength,
              "Offset of the origin of P across the docking axis of A")
      .not_negative();
  table
      .output("relative.pitch_yaw", &out.relative_pitch_yaw, kAngle,
              "Angle between the docking axes of A and P")
      .limits(0, kStraightAngle);
  table.output("relative.roll", &out.relative_roll, kAngle, "Twist of P about the docking axis")
      .limits(-kStraightAngle, kStraightAngle);
  table.output("gap", &out.gap, kSmallLength,
               "Smallest signed distance between the two capture surfaces, negative in contact "
               "(1e9 where there are no surfaces)");
}

void add_capture(Table& table, Outputs& out) {
  table.outputs("capture.force", out.capture_force, kForce,
                "Force on the target through capture surfaces and latches, axes of P");
  table.outputs("capture.torque", out.capture_torque, kTorque,
                "Torque on the target through capture surfaces and latches about the origin of P, "
                "axes of P");
  for (const Load& load : list_loads()) {
    table
        .output(std::string("capture.") + load.name, &out.capture_load[load.index], load.quantity,
                load.text)
        .not_negative();
  }
  table
      .output("capture.load_ratio", &out.capture_load_ratio, kNone,
              "Largest ratio of a load between ring and target to its rated value")
      .not_negative();
  const std::string largest = ", largest since the start over all inner steps";
  for (const Load& load : list_loads()) {
    table
        .output(std::string("capture.peak.") + load.name, &out.capture_peak[load.index],
                load.quantity, load.text + largest)
        .not_negative();
  }
  table
      .output("capture.peak.load_ratio", &out.capture_peak_load_ratio, kNone,
              "Ratio of a load between ring and target to its rated value" + largest)
      .not_negative();
}

void add_surfaces(Table& table, const ContactModel& contact, Outputs& out) {
  for (size_t i = 0; i < out.surface_force.size(); ++i) {
    const Surface& surface = contact.surfaces[i];
    const std::string name = indexed("contact.surface", i);
    const std::string text = "Size of the resultant contact force on '" + surface.name +
                             "' of the " + (surface.on_passive ? "passive" : "active") + " side";
    table.output(name + ".force", &out.surface_force[i], kForce, text).not_negative();
    table
        .output(name + ".peak", &out.surface_peak[i], kForce,
                text + ", largest since the start over all inner steps")
        .not_negative();
  }
}

void add_contact(Table& table, const ContactModel& contact, Parameters& parameter, Outputs& out) {
  for (size_t i = 0; i < out.petal_force.size(); ++i) {
    table
        .output(indexed("contact.petal", i) + ".force", &out.petal_force[i], kForce,
                "Size of the resultant contact force on this petal")
        .not_negative();
  }
  add_surfaces(table, contact, out);
  table
      .output("contact.depth_ratio", &out.contact_depth_ratio, kNone,
              "Largest contact depth as a fraction of the rounding of the surfaces")
      .limits(0, 1)
      .nominal(0.1);
  for (size_t i = 0; i < out.latch_opening.size(); ++i) {
    table.output(indexed("latch", i) + ".opening", &out.latch_opening[i], kSmallLength,
                 "Axial distance from the hook of this latch to its striker");
    table
        .output(indexed("latch", i) + ".lateral", &out.latch_lateral[i], kSmallLength,
                "Distance of the striker of this latch from its hook across the docking axis")
        .not_negative();
    table.output(indexed("latch", i) + ".force", &out.latch_force[i], kForce,
                 "Force in this latch, tension positive");
    table.output(indexed("latch", i) + ".state", &out.latch_state[i], kNone, "State of this latch")
        .choices(kLatchReports);
  }
  table
      .parameter("friction.coefficient", &parameter.friction_coefficient, kNone,
                 "Coefficient of friction of the capture surfaces")
      .limits(0, 2)
      .nominal(0.1)
      .tunable();
  table.parameter("friction.model", &parameter.friction_model, kNone, "Friction law")
      .choices(kFrictionModels);
  table
      .parameter("restitution", &parameter.restitution, kNone,
                 "Coefficient of restitution of the capture surfaces at restitution_speed")
      .limits(0, 1)
      .tunable();
  table
      .parameter("restitution_speed", &parameter.restitution_speed, kSmallVelocity,
                 "Approach speed at which restitution holds")
      .not_negative()
      .tunable();
}

void add_progress(Table& table, Outputs& out) {
  table.output("phase", &out.phase, kNone, "Phase of the docking").choices(kPhases);
  table.output("outcome", &out.outcome, kNone, "Outcome so far").choices(kOutcomes);
}

void add_phase(Table& table, Parameters& parameter, Outputs& out) {
  add_progress(table, out);
  table.output("captured", &out.captured, kNone, "All latches hold");
  for (size_t i = 0; i < out.latched.size(); ++i) {
    table.output(indexed("latched", i), &out.latched[i], kNone, "This latch holds");
  }
  table.output("capture.reason", &out.capture_reason, kNone, "Reason for no capture")
      .choices(kCaptureReasons);
  table
      .output("capture.seated_time", &out.seated_time, kTime,
              "Duration of seated rings without capture")
      .not_negative()
      .discrete();
  table
      .output("time_to_contact", &out.time_to_contact, kTime,
              "Lower bound of the time until first contact, from gap and closing speed "
              "(1e9: none in sight)")
      .limits(0, 1e9)
      .discrete();
  table
      .output("time_of_contact", &out.time_of_contact, kTime,
              "Simulation time of the first contact of surfaces or the first catch of a latch, -1 "
              "before")
      .discrete();
  table
      .output("time_of_capture", &out.time_of_capture, kTime,
              "Simulation time when all latches first held, -1 before")
      .discrete();
  table
      .parameter("chaser.contact_thrust", &parameter.contact_thrust, kForce,
                 "Thrust on the chaser along +x of A from first contact until captured")
      .tunable();
  table
      .parameter("chaser.contact_thrust_delay", &parameter.contact_thrust_delay, kTime,
                 "Time from first contact to the contact thrust")
      .not_negative()
      .tunable();
}

/// Names of the steps with their numbers, for the description.
std::string list_steps(const Sequence& sequence) {
  std::string text;
  for (size_t i = 0; i < sequence.steps.size(); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(i + 1) + " " + sequence.steps[i].name;
  }
  return text;
}

void add_sequence(Table& table, const Sequence& sequence, Inputs& in, Outputs& out) {
  table.input("command", &in.command, kNone, "Command to the sequence").choices(kCommands);
  table
      .output("sequence.step", &out.sequence_step, kNone,
              "Present step of the sequence: " + list_steps(sequence))
      .limits(1, static_cast<double>(sequence.steps.size()));
  table
      .output("sequence.time_in_step", &out.sequence_time_in_step, kTime,
              "Time in this step; stands still while the command is hold")
      .not_negative()
      .discrete();
}

void add_ring(Table& table, Outputs& out) {
  table.outputs("ring.position", out.ring_position, kSmallLength,
                "Origin of the guide ring G with respect to A, axes of A");
  table
      .outputs("ring.attitude", out.ring_attitude, kQuaternion,
               "Attitude quaternion of the guide ring, axes of G to axes of A")
      .limits(-1, 1);
  table.outputs("ring.velocity", out.ring_velocity, kSmallVelocity,
                "Velocity of the origin of the guide ring with respect to A, axes of A");
  table.outputs("ring.angular_velocity", out.ring_angular_velocity, kAngularVelocity,
                "Angular velocity of the guide ring with respect to A, axes of A");
}

void add_legs(Table& table, Inputs& in, Outputs& out) {
  for (size_t i = 0; i < out.leg_length.size(); ++i) {
    const std::string leg = indexed("leg", i);
    table.output(leg + ".length", &out.leg_length[i], kSmallLength, "Length of this leg")
        .not_negative();
    table.output(leg + ".rate", &out.leg_rate[i], kSmallVelocity,
                 "Rate of change of the length of this leg");
    table.output(
        leg + ".force", &out.leg_force[i], kForce,
        "Force along this leg, including elements and couplings on its slide, positive when "
        "it pushes the ends apart");
    table.input(leg + ".force_command", &in.leg_force_command[i], kForce,
                "Commanded force of the actuator of this leg, positive when it pushes the ends "
                "apart");
  }
}

/// Limits of a parameter with this rule. Values at a limit that is not allowed are refused when the
/// run starts.
Row limited(Row row, Rule rule) {
  if (rule == Rule::kShare) return row.limits(0.0, 1.0);
  return rule == Rule::kAny ? row : row.not_negative();
}

/// Force elements: outputs, commands and every number of every law. Elements of slides and turns
/// share the types: unit 1 means m and N, or rad and N m.
void add_elements(Table& table, DockingSim& sim) {
  Outputs& out = sim.output_storage();
  std::vector<ForceElement> elements = sim.scene().mechanism.elements;
  double* number = sim.parameters().element_numbers.data();
  for (size_t i = 0; i < elements.size(); ++i) {
    const std::string name = indexed("element", i), of = " of element '" + elements[i].name + "'";
    table.output(name + ".coordinate", &out.element_coordinate[i], kCoordinate,
                 "Coordinate" + of + " [m or rad]");
    table.output(name + ".rate", &out.element_rate[i], kCoordinate,
                 "Rate" + of + " [m/s or rad/s]");
    table.output(name + ".force", &out.element_force[i], kElementForce,
                 "Force" + of + ", positive when it increases the coordinate [N or N m]");
    table
        .output(name + ".saturation", &out.element_saturation[i], kNone,
                "Largest share of a limit of the motors and drives" + of)
        .not_negative();
    for (size_t k = 0; k < elements[i].laws.size(); ++k) {
      ForceLaw& law = elements[i].laws[k];
      const std::string prefix = name + "." + indexed("law", k) + ".";
      const std::string in = std::string(", ") + describe_type(law) + of;
      for_each_number(law, [&](const std::string& member, double&, Rule rule, const char* text) {
        limited(table.parameter(prefix + member, number++, kLawNumber, text + in), rule);
      });
      if (!is_commanded(law)) continue;
      table.input(name + ".command", &sim.inputs().element_command[i], kLawNumber,
                  "Command of the " + std::string(describe_type(law)) + of +
                      " (voltage or current of a motor, target of a drive)");
    }
  }
}

/// Loads of the scene on vehicles, for a while.
void add_disturbances(Table& table, DockingSim& sim) {
  for (size_t k = 0; k < sim.parameters().disturbance.size(); ++k) {
    DisturbanceNumbers& numbers = sim.parameters().disturbance[k];
    const std::string name = indexed("disturbance", k);
    table.parameter(name + ".time", &numbers.time, kTime, "Begin of this load on a vehicle")
        .not_negative();
    table
        .parameter(name + ".duration", &numbers.duration, kTime,
                   "Time for which this load acts on a vehicle")
        .not_negative();
    table.parameters(name + ".force", numbers.force, kForce,
                     "Force of this load at the centre of mass, inertial axes");
    table.parameters(name + ".torque", numbers.torque, kTorque,
                     "Torque of this load, axes of the vehicle");
  }
}

/// Failures of laws.
void add_failures(Table& table, DockingSim& sim) {
  Parameters& parameters = sim.parameters();
  const MechanismModel& mechanism = sim.scene().mechanism;
  for (size_t k = 0; k < mechanism.failures.size(); ++k) {
    const std::string name = indexed("failure", k);
    const std::string of =
        " of a failure of element '" +
        mechanism.elements[static_cast<size_t>(mechanism.failures[k].element)].name + "'";
    table.parameter(name + ".active", &parameters.failure_active[k], kNone, "Presence" + of);
    table.parameter(name + ".time", &parameters.failure_numbers[2 * k], kTime, "Onset" + of)
        .not_negative();
    table
        .parameter(name + ".value", &parameters.failure_numbers[2 * k + 1], kLawNumber,
                   "Value" + of + " (factor, stiffness of the lock or delay)")
        .not_negative();
  }
}

/// Hardware of the hard dock between A and P.
void add_hard_dock(Table& table, const HardDock& dock, Inputs& in, Outputs& out) {
  if (dock.empty()) return;
  table
      .input("hard_dock.command", &in.hard_dock_command, kNone,
             "Command to the hard dock, carried out when it changes")
      .choices(kHardDockCommands);
  for (size_t i = 0; i < out.hook_force.size(); ++i) {
    table.output(indexed("hook", i) + ".force", &out.hook_force[i], kForce, "Tension of this hook")
        .not_negative();
  }
  if (!out.hook_force.empty()) {
    table
        .output("hooks.closed", &out.hooks_closed, kNone,
                "Number of hooks that have closed with their preload")
        .limits(0, kMaxHooks);
  }
  if (dock.face_count() > 0) {
    table.output("faces.force", &out.face_force, kForce, "Force that presses the faces, in all")
        .not_negative();
  }
  if (dock.pusher_count() > 0) {
    table.output("pushers.force", &out.pusher_force, kForce, "Force of the pushers, in all")
        .not_negative();
  }
  table.outputs("joint.force", out.joint_force, kForce,
                "Force on the target across A and P, by faces, hooks and pushers or by the rigid "
                "joint, axes of P");
  table.outputs("joint.torque", out.joint_torque, kTorque,
                "Torque on the target across A and P about the origin of P, axes of P");
  table.output("joint.rigid", &out.joint_rigid, kNone, "Chaser and target are one rigid body");
}

void add_states(Table& table, Outputs& out) {
  // Slides and turns share these arrays: unit 1 means m or rad.
  const auto rows = [&](const char* name, std::vector<double>& values, const char* text) {
    for (size_t i = 0; i < values.size(); ++i) {
      table.output(indexed(name, i), &values[i], kCoordinate, text);
    }
  };
  rows("state.q", out.state_q, "Independent coordinate of the mechanism [m or rad]");
  rows("state.v", out.state_v, "Independent velocity of the mechanism [m/s or rad/s]");
  rows("state.a", out.state_a, "Independent acceleration of the mechanism [m/s2 or rad/s2]");
}

void add_loops(Table& table, Outputs& out) {
  for (size_t k = 0; k < out.loop_force.size(); ++k) {
    table.outputs(indexed("loop", k) + ".force", out.loop_force[k], kForce,
                  "Force of the cut joint on the terminal body of this loop");
  }
  table.outputs("base.force", out.base_force, kForce,
                "Force of the mechanism on its base, axes of B");
  table.outputs("base.torque", out.base_torque, kTorque,
                "Torque of the mechanism on its base about the origin of B, axes of B");
}

void add_energy(Table& table, Outputs& out, bool has_elements, bool has_hard_dock) {
  table.output("energy.kinetic", &out.energy_kinetic, kEnergy,
               "Kinetic energy of all bodies inside");
  table.output("energy.potential", &out.energy_potential, kEnergy,
               "Potential energy of springs, contacts and latches");
  table.output("energy.dissipated", &out.energy_dissipated, kEnergy,
               "Energy dissipated since the start, sum of its parts");
  table.output("energy.dissipated_contact", &out.energy_dissipated_contact, kEnergy,
               "Energy dissipated by contact damping");
  table.output("energy.dissipated_friction", &out.energy_dissipated_friction, kEnergy,
               "Energy dissipated by friction of the capture surfaces");
  table.output("energy.dissipated_legs", &out.energy_dissipated_legs, kEnergy,
               "Energy dissipated in the joints and legs of the mechanism");
  table.output("energy.dissipated_latches", &out.energy_dissipated_latches, kEnergy,
               "Energy dissipated in the latches");
  if (has_elements) {
    table.output("energy.dissipated_brakes", &out.energy_dissipated_brakes, kEnergy,
                 "Energy dissipated in the brakes of the force elements");
  }
  if (has_hard_dock) {
    table.output("energy.dissipated_hard_dock", &out.energy_dissipated_hard_dock, kEnergy,
                 "Energy dissipated in faces, hooks and pushers, and when a rigid joint was made");
  }
  if (has_elements || has_hard_dock) {
    table.output("energy.drive_work", &out.energy_drive_work, kEnergy,
                 "Work of motors and drives, those of hooks and pushers too, since the start");
  }
  table.output("energy.external", &out.energy_external, kEnergy,
               "Work of forces from outside since the start");
  table
      .output("energy.residual", &out.energy_residual, kEnergy,
              "Energy balance error since the start")
      .nominal(1e-6);
  table
      .output("momentum.residual", &out.momentum_residual, kNone,
              "Momentum balance error since the start, relative to the largest momentum: largest "
              "value so far; with a compiled kernel the present value")
      .not_negative()
      .nominal(1e-14)
      .discrete()
      .group(OutputGroup::kBodies);
  table
      .outputs("momentum.linear", out.momentum_linear, kMomentum,
               "Linear momentum of all bodies inside without driven vehicles, in N")
      .group(OutputGroup::kBodies);
  table
      .outputs("momentum.angular", out.momentum_angular, kAngularMomentum,
               "Angular momentum of all bodies inside without driven vehicles, about "
               "momentum.reference, in N")
      .group(OutputGroup::kBodies);
  table
      .outputs("momentum.reference", out.momentum_reference, kLength,
               "Reference point of momentum.angular in N")
      .group(OutputGroup::kBodies);
}

/// The state vector of the integration and its rates, in the order of StateLayout: for model
/// exchange. Positions and momenta are relative to frame O near the docking.
void add_state_vector(Table& table, const Scene& scene, Outputs& out) {
  size_t next = 0;
  const auto rows = [&](const std::string& name, size_t count, Quantity quantity,
                        const std::string& text, bool jumps = false) {
    for (size_t i = 0; i < count; ++i, ++next) {
      const std::string element = count == 1 ? name : indexed(name, i);
      Row row = table.local(element, &out.states[next], quantity, text);
      if (jumps) row.jumps();
    }
  };
  rows("ode.mechanism.q", out.state_q.size(), kCoordinate, "Integrated coordinate [m, rad, 1]",
       true);
  rows("ode.mechanism.v", out.state_v.size(), kCoordinate, "Integrated velocity [m/s, rad/s]",
       true);
  for (const int i : {kChaser, kTarget}) {
    if (scene.motion[i] == Motion::kFixed || (i == kTarget && !scene.has_target)) continue;
    const std::string v = i == kChaser ? "ode.chaser." : "ode.target.";
    const std::string carried = i == kChaser ? " of chaser and mechanism" : " of the target";
    rows(v + "position", 3, kLength, "Centre of mass in frame O, axes of N");
    rows(v + "attitude", 4, kQuaternion, "Attitude quaternion, body to N");
    rows(v + "momentum", 3, kMomentum, "Linear momentum" + carried + " in frame O");
    rows(v + "angular_momentum", 3, kAngularMomentum,
         "Angular momentum" + carried + " about the origin of O");
  }
  for (const char* part : {"contact", "friction", "legs", "latches"}) {
    rows(std::string("ode.dissipated_") + part, 1, kEnergy, "Energy dissipated since the start",
         true);
  }
  rows("ode.external", 1, kEnergy, "Work of forces from outside since the start");
  const std::vector<ForceElement>& elements = scene.mechanism.elements;
  if (!elements.empty() || !scene.hard_dock.empty()) {
    rows("ode.dissipated_brakes", 1, kEnergy, "Energy dissipated since the start");
    rows("ode.drive_work", 1, kEnergy, "Work of motors and drives since the start");
  }
  if (!scene.hard_dock.empty()) {
    rows("ode.dissipated_hard_dock", 1, kEnergy, "Energy dissipated since the start", true);
  }
  rows("ode.impulse", 3, kMomentum, "Impulse of forces from outside since the start");
  rows("ode.angular_impulse", 3, kAngularMomentum, "Angular impulse of forces from outside");
  const size_t brakes =
      static_cast<size_t>(count_element_bristles(elements, scene.mechanism.failures));
  for (size_t i = 0; i < brakes; ++i, ++next) {
    table.local(indexed("ode.brake", i), &out.states[next], kCoordinate,
                "Deflection of the bristle of a brake [m or rad]");
  }
  rows("ode.bristle", out.states.size() - next, kSmallLength, "Deflection of a bristle", true);
  table.add_rates(out.states, out.rates);
}

/// Settings of the coupling with the host of a driven vehicle.
void add_coupling_parameters(Table& table, Parameters& parameter, Inputs& in) {
  table
      .parameter("coupling.mode", &parameter.coupling_mode, kNone,
                 "Order of exchange with the host of a driven vehicle")
      .choices(kCouplingModes);
  table
      .parameter("coupling.expected_step", &parameter.coupling_expected_step, kTime,
                 "Communication step of the first announced load (parallel)")
      .not_negative();
  table
      .parameter("coupling.velocity_tolerance", &parameter.coupling_velocity_tolerance,
                 kSmallVelocity, "Allowed velocity error per step for coupling.suggested_step")
      .not_negative()
      .nominal(1e-4);
  table
      .input("coupling.next_step", &in.next_step, kTime,
             "Length of the step after the coming step, for its announced load (parallel; 0: same "
             "as the coming step)")
      .limits(0, 10);
}

void add_coupling_outputs(Table& table, Outputs& out) {
  table
      .output("coupling.work_residual", &out.coupling_work_residual, kEnergy,
              "Work received by the vehicles of hosts minus work of the mechanism on them")
      .discrete()
      .group(OutputGroup::kCoupling);
  table
      .output("coupling.mass_mismatch", &out.coupling_mass_mismatch, kNone,
              "Mass of a driven vehicle, estimated from its motion, divided by the stated mass, "
              "minus 1")
      .discrete()
      .group(OutputGroup::kCoupling);
  table
      .output("coupling.frequency", &out.coupling_frequency, kAngularVelocity,
              "Highest frequency of the mechanism and the contact between the vehicles")
      .not_negative()
      .discrete()
      .group(OutputGroup::kCoupling);
  table
      .output("coupling.suggested_step", &out.coupling_suggested_step, kTime,
              "Communication step for an error of coupling.velocity_tolerance")
      .not_negative()
      .discrete()
      .group(OutputGroup::kCoupling);
  table
      .outputs("coupling.pending_impulse", out.coupling_pending_impulse, kMomentum,
               "Pending impulse on the driven vehicles, not yet delivered by the hosts, in N")
      .discrete();
  table
      .outputs("coupling.pending_angular_impulse", out.coupling_pending_angular_impulse,
               kAngularMomentum,
               "Pending angular impulse on the driven vehicles, about momentum.reference, in N")
      .discrete();
}

/// Numbers the rows of inputs and outputs, for input slopes and derivatives.
void number_values(std::vector<Variable>& rows, DockingSim& sim) {
  std::map<const void*, int> inputs, outputs;
  std::vector<double*> slopes;
  const auto number = [](std::map<const void*, int>& places) {
    return [&places](double& value) { places.emplace(&value, static_cast<int>(places.size())); };
  };
  for_each_value(sim.inputs(), number(inputs));
  for_each_value(static_cast<OutputValues<double>&>(sim.output_storage()), number(outputs));
  for_each_value(sim.input_slopes(), [&](double& slope) { slopes.push_back(&slope); });
  for (Variable& row : rows) {
    if (row.type != Type::kReal) continue;
    if (row.causality == Causality::kInput) {
      row.input = inputs.at(row.value);
      row.slope = slopes[static_cast<size_t>(row.input)];
    } else if (const auto place = outputs.find(row.value); place != outputs.end()) {
      row.output = place->second;
    }
  }
}

void add_model_parameters(Table& table, Parameters& parameter, bool has_comparison) {
  ChoiceList carried = kLevels;
  if (!has_comparison) carried.pop_back();
  Row level = table.parameter("model.level", &parameter.model_level, kNone, "Level of the model")
                  .choices(kLevels, carried);
  if (!has_comparison) level.refuse(kReference, describe_missing_reference_level());
}

void add_solver_parameters(Table& table, Parameters& parameter, bool has_comparison) {
  table
      .parameter("accuracy", &parameter.accuracy, kNone,
                 "Wanted relative error of peak loads, stroke, time of capture and final motion: "
                 "chooses solver.method and tolerances by measured dockings; 0: solver.* as they "
                 "are; -1: real time, fixed steps of bounded cost. Values of solver.* that "
                 "differ from their defaults stay")
      .limits(kRealTime, 1)
      .nominal(1e-3);
  table.parameter("model.flight", &parameter.flight, kNone, "Mechanism far from contact")
      .choices(kFreeDriftModels);
  Row method =
      table.parameter("solver.method", &parameter.solver_method, kNone, "Integration method")
          .choices(get_method_choices(), list_carried_methods(has_comparison));
  for (const MethodFacts& m : list_methods()) {
    if (!m.for_comparison || has_comparison) continue;
    method.refuse(m.method, describe_missing_method(m.method));
  }
  if (has_comparison) {
    table
        .parameter("solver.dae_form", &parameter.dae_form, kNone,
                   "Equations of the loops in method 9")
        .choices(kDaeForms);
  }
  table
      .parameter("solver.step", &parameter.step, kTime,
                 "Largest inner step of the fixed-step methods; all inner steps of a communication "
                 "step are equal")
      .not_negative();
  table.parameter("solver.rtol", &parameter.rtol, kNone, "Relative tolerance of the integration")
      .limits(0, 1)
      .nominal(1e-8);
  table
      .parameter("solver.atol_position", &parameter.atol_position, kSmallLength,
                 "Absolute tolerance of positions, and of attitudes [rad]")
      .not_negative()
      .nominal(1e-10);
  table
      .parameter("solver.atol_velocity", &parameter.atol_velocity, kSmallVelocity,
                 "Absolute tolerance of velocities, and of angular velocities [rad/s]")
      .not_negative()
      .nominal(1e-10);
  table
      .parameter("solver.atol_energy", &parameter.atol_energy, kEnergy,
                 "Absolute tolerance of dissipated energies and external work")
      .not_negative()
      .nominal(1e-8);
}

void add_solver_outputs(Table& table, Outputs& out) {
  table
      .output("solver.chosen_method", &out.solver_chosen_method, kNone,
              "Integration method in use (a number of solver.method): solver.method, or the choice "
              "of accuracy")
      .limits(1, kMethodCount);
  table
      .output("solver.chosen_rtol", &out.solver_chosen_rtol, kNone,
              "Relative tolerance in use: the smaller one of host and solver.rtol or the choice of "
              "accuracy; 0 with fixed steps")
      .limits(0, 1)
      .nominal(1e-8)
      .discrete();
  table
      .output("solver.chosen_step", &out.solver_chosen_step, kTime,
              "Largest inner step of a fixed-step method in use: solver.step, or the choice of "
              "accuracy; 0 without fixed steps")
      .not_negative()
      .discrete();
  table
      .output("solver.error_estimate", &out.solver_error_estimate, kNone,
              "With accuracy: relative error that 95 % of the measured dockings stayed below with "
              "the method and tolerances in use (a statistical value, not measured in this run); 0 "
              "= no value")
      .limits(0, 1)
      .nominal(1e-3)
      .discrete();
  table.output("solver.steps", &out.solver_steps, kCount, "Inner steps since the start")
      .not_negative()
      .discrete();
  table
      .output("solver.rhs_evaluations", &out.solver_rhs_evaluations, kCount,
              "Evaluations of the equations of motion since the start; a Jacobian of an implicit "
              "method counts as one per column")
      .not_negative()
      .discrete();
  table
      .output("solver.rejected_steps", &out.solver_rejected_steps, kCount,
              "Inner steps since the start that were rejected and repeated with a smaller size")
      .not_negative()
      .discrete();
  table
      .output("solver.closure_residual", &out.solver_closure_residual, kSmallLength,
              "Largest gap of a closed loop; with method 9 over the inner steps of the last step")
      .not_negative()
      .nominal(1e-14)
      .discrete()
      .group(OutputGroup::kBodies);
  table
      .output("solver.singularity_margin", &out.solver_singularity_margin, kNone,
              "Smallest normalised distance of a loop to a singular pose")
      .limits(0, 1)
      .discrete();
}

/// Name of a value, by its place in the enumeration.
template <class Enumeration, size_t n>
const char* pick(Enumeration value, const char* const (&names)[n]) {
  return names[static_cast<size_t>(value)];
}

}  // namespace

const char* name_of(Type type) {
  static constexpr const char* kNames[] = {"Real", "Integer", "Boolean"};
  return pick(type, kNames);
}

const char* name_of(Causality causality) {
  static constexpr const char* kNames[] = {"parameter", "input", "output", "local"};
  return pick(causality, kNames);
}

const char* name_of(Variability variability) {
  static constexpr const char* kNames[] = {"fixed", "tunable", "discrete", "continuous"};
  return pick(variability, kNames);
}

const std::vector<Load>& list_loads() {
  static const std::vector<Load> kLoads = {
      {Outputs::kTension, "tension", "Tension between ring and target", kForce},
      {Outputs::kCompression, "compression", "Compression between ring and target", kForce},
      {Outputs::kShear, "shear", "Shear force between ring and target", kForce},
      {Outputs::kBending, "bending", "Bending moment between ring and target", kTorque},
      {Outputs::kTorsion, "torsion", "Torsion moment between ring and target", kTorque},
  };
  return kLoads;
}

const std::vector<Unit>& unit_definitions() {
  static const std::vector<Unit> kUnits = {
      {"1", 0, 0, 0, 0, {}},
      {"m", 0, 1, 0, 0, {{"mm", 1e3}}},
      {"m/s", 0, 1, -1, 0, {{"mm/s", 1e3}}},
      {"m/s2", 0, 1, -2, 0, {}},
      {"rad", 0, 0, 0, 1, {{"deg", kDegrees}}},
      {"rad/s", 0, 0, -1, 1, {{"deg/s", kDegrees}}},
      {"s", 0, 0, 1, 0, {}},
      {"kg", 1, 0, 0, 0, {{"t", 1e-3}}},
      {"kg.m2", 1, 2, 0, 0, {}},
      {"N", 1, 1, -2, 0, {}},
      {"N.m", 1, 2, -2, 0, {}},
      {"N.s", 1, 1, -1, 0, {}},
      {"N.m.s", 1, 2, -1, 0, {}},
      {"J", 1, 2, -2, 0, {}},
      {"W", 1, 2, -3, 0, {}},
      {"1/s", 0, 0, -1, 0, {}},
  };
  return kUnits;
}

std::vector<Variable> make_variables(DockingSim& sim) {
  const Scene& scene = sim.scene();
  Parameters& parameters = sim.parameters();
  Inputs& inputs = sim.inputs();
  Outputs& outputs = sim.output_storage();
  const auto wants = [&](const char* group) { return scene.has_group(group); };

  Table table;
  add_vehicle(table, sim, kChaser);
  if (scene.has_target) add_vehicle(table, sim, kTarget);
  table.inputs("gravity", inputs.gravity, kAcceleration,
               "Acceleration of gravity in N on every body inside; do not include it in "
               "force_ext");
  if (scene.has_target) {
    if (wants("relative")) add_relative(table, outputs);
    if (wants("capture")) add_capture(table, outputs);
    if (wants("contact")) add_contact(table, scene.contact, parameters, outputs);
    if (wants("phase")) add_phase(table, parameters, outputs);
  }
  if (!scene.sequence.empty()) {
    if (!scene.has_target || !wants("phase")) add_progress(table, outputs);
    add_sequence(table, scene.sequence, inputs, outputs);
  }
  if (wants("ring")) add_ring(table, outputs);
  if (wants("legs")) add_legs(table, inputs, outputs);
  add_elements(table, sim);
  add_failures(table, sim);
  add_disturbances(table, sim);
  add_hard_dock(table, scene.hard_dock, inputs, outputs);
  if (wants("states")) add_states(table, outputs);
  if (wants("loops")) add_loops(table, outputs);
  if (wants("energy")) {
    add_energy(table, outputs, !scene.mechanism.elements.empty(), !scene.hard_dock.empty());
  }
  const bool is_driven = !offers_model_exchange(scene);
  if (is_driven) add_coupling_parameters(table, parameters, inputs);
  if (is_driven && wants("coupling")) add_coupling_outputs(table, outputs);
  add_model_parameters(table, parameters, sim.has_comparison());
  add_solver_parameters(table, parameters, sim.has_comparison());
  if (wants("solver")) add_solver_outputs(table, outputs);
  if (offers_model_exchange(scene)) add_state_vector(table, scene, outputs);
  std::vector<Variable> rows = table.take();
  number_values(rows, sim);
  return rows;
}

void check_value(const Variable& v, double value, const char* function) {
  const auto refuse = [&](const std::string& why) {
    throw ModelError(std::string(function) + ": '" + v.name + "' = " + shortest(value) + why);
  };
  if (!std::isfinite(value)) refuse(" is not a finite number");
  const auto absent = v.refused.find(static_cast<int>(std::clamp(value, -1e9, 1e9)));
  if (absent != v.refused.end()) refuse(absent->second);
  if (std::abs(value) > kLargestValue)
    refuse(" is too large: its absolute value must be at most 1e30");
  const std::string unit = v.unit == std::string("1") ? "" : std::string(" ") + v.unit;
  if (value < v.min) refuse(" is below its minimum " + shortest(v.min) + unit);
  if (value > v.max) refuse(" is above its maximum " + shortest(v.max) + unit);
}

}  // namespace dockloop
