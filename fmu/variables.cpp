// Rows of the variable table, group by group in the order of the interface description.
//
// A vector becomes scalars a[1], a[2], ...; a choice becomes an Integer counted from 1 with its
// meanings in the description, because several importers drop Enumeration variables.
#include "variables.hpp"

#include <utility>

namespace dockloop {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegrees = 57.29577951308232;  // [deg/rad]

/// What a number measures: unit, the unit people read it in, and its typical size.
struct Quantity {
  const char* unit;
  const char* display = "";
  double nominal = 1.0;
};
constexpr Quantity kNone{"1"};
constexpr Quantity kLength{"m"};
constexpr Quantity kSmallLength{"m", "mm", 0.1};
constexpr Quantity kVelocity{"m/s", "", 0.1};
constexpr Quantity kSmallVelocity{"m/s", "mm/s", 0.1};
constexpr Quantity kAngle{"rad", "deg", 0.1};
constexpr Quantity kAngularVelocity{"rad/s", "deg/s", 0.01};
constexpr Quantity kAcceleration{"m/s2"};
constexpr Quantity kTime{"s"};
constexpr Quantity kMass{"kg", "", 1e3};
constexpr Quantity kInertia{"kg.m2", "", 1e3};
constexpr Quantity kForce{"N", "", 100};
constexpr Quantity kTorque{"N.m", "", 100};
constexpr Quantity kEnergy{"J"};
constexpr Quantity kMomentum{"N.s", "", 100};
constexpr Quantity kAngularMomentum{"N.m.s", "", 100};

/// Name of element i of a vector of n: what the reader of a description expects.
std::string element_name(size_t i, size_t n) {
  static constexpr const char* kAxes[] = {"x", "y", "z"};
  static constexpr const char* kQuaternion[] = {"w", "x", "y", "z"};
  static constexpr const char* kInertiaOrder[] = {"xx", "yy", "zz", "xy", "xz", "yz"};
  return n == 3 ? kAxes[i] : n == 4 ? kQuaternion[i] : kInertiaOrder[i];
}

std::string indexed(const std::string& name, size_t i) {
  return name + "[" + std::to_string(i + 1) + "]";
}

constexpr Type type_of(const double*) { return Type::kReal; }
constexpr Type type_of(const int*) { return Type::kInteger; }
constexpr Type type_of(const char*) { return Type::kBoolean; }
constexpr Type type_of(const bool*) { return Type::kBoolean; }
static_assert(sizeof(bool) == sizeof(char), "Boolean rows read bool through char");

/// Limits of a row that was just added, so that a row reads as one statement.
class Row {
 public:
  explicit Row(Variable& variable) : variable_(variable) {}
  Row limits(double min, double max) {
    variable_.min = min;
    variable_.max = max;
    return *this;
  }
  Row not_negative() { return limits(0.0, kInfinity); }
  Row discrete() {
    variable_.variability = Variability::kDiscrete;
    return *this;
  }

 private:
  Variable& variable_;
};

class Table {
 public:
  /// Chosen before the start, then fixed.
  template <class T>
  Row parameter(std::string name, T* value, Quantity quantity, std::string description) {
    return add(std::move(name), Causality::kParameter, Variability::kFixed, value, value, quantity,
               std::move(description));
  }
  /// Told by the host at any communication point.
  Row input(std::string name, double* value, Quantity quantity, std::string description) {
    return add(std::move(name), Causality::kInput, Variability::kContinuous, value, value, quantity,
               std::move(description));
  }
  /// Computed; an Integer or Boolean changes only at communication points.
  template <class T>
  Row output(std::string name, const T* value, Quantity quantity, std::string description) {
    return add(std::move(name), Causality::kOutput, natural(value), nullptr, value, quantity,
               std::move(description));
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
  void outputs(const std::string& name, V& value, Quantity quantity, const std::string& text) {
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      output(std::move(element), &value[i], quantity, std::move(description));
    });
  }
  template <class V>
  void states(const std::string& name, V& start, V& value, Quantity quantity,
              const std::string& text) {
    each(name, value, text, [&](size_t i, std::string element, std::string description) {
      state(std::move(element), &start[i], &value[i], quantity, std::move(description));
    });
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
      v.unit = quantity.unit;
      v.display_unit = quantity.display;
      v.nominal = quantity.nominal;
    }
    v.start = start;
    v.value = value;
    return Row(v);
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

  // Imposed by the host, or a result whose start value is the initial condition.
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
      "attitude", [](auto& s) -> auto& { return s.attitude; }, kNone,
      "Attitude quaternion" + of + ", body axes to N");
  motion_rows(
      "angular_velocity", [](auto& s) -> auto& { return s.angular_velocity; }, kAngularVelocity,
      "Angular velocity" + of + " in N, body axes");

  // What a fixed vehicle would ignore does not exist for it.
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
      v + "interface_attitude", parameter.interface_attitude, kNone,
      "Attitude quaternion of the docking interface, axes of " + interface + " to axes of " + body);

  table.outputs(v + "force", output.force, kForce,
                "Force of the docking system on the vehicle at the end of the step, in N");
  table.outputs(v + "torque", output.torque, kTorque,
                "Torque of the docking system on the vehicle at the end of the step, about the "
                "centre of mass, body axes");
  table.outputs(v + "force_mean", output.force_mean, kForce,
                "Constant force with the impulse that the vehicle received over the step, in N");
  table.outputs(v + "torque_mean", output.torque_mean, kTorque,
                "Constant torque with the angular impulse that the vehicle received over the "
                "step, about the centre of mass, body axes");
}

void add_relative(Table& table, Outputs& out) {
  table.outputs("relative.position", out.relative_position, kLength,
                "Origin of P with respect to A, axes of A");
  table.outputs("relative.attitude", out.relative_attitude, kNone,
                "Attitude quaternion of P with respect to A, axes of P to axes of A");
  table.outputs("relative.velocity", out.relative_velocity, kSmallVelocity,
                "Velocity of the origin of P with respect to A, axes of A");
  table.outputs("relative.angular_velocity", out.relative_angular_velocity, kAngularVelocity,
                "Angular velocity of P with respect to A, axes of A");
  table.output("relative.axial", &out.relative_axial, kSmallLength,
               "Distance of the mating planes along the docking axis of A");
  table.output("relative.lateral", &out.relative_lateral, kSmallLength,
               "Offset of the origin of P across the docking axis of A");
  table.output("relative.pitch_yaw", &out.relative_pitch_yaw, kAngle,
               "Angle between the docking axes of A and P");
  table.output("relative.roll", &out.relative_roll, kAngle, "Twist of P about the docking axis");
  table.output("gap", &out.gap, kSmallLength,
               "Smallest signed distance between the two capture surfaces, negative in contact");
}

void add_capture(Table& table, Outputs& out) {
  table.outputs("capture.force", out.capture_force, kForce,
                "Force on the target through the capture interface, axes of P");
  table.outputs("capture.torque", out.capture_torque, kTorque,
                "Torque on the target through the capture interface about the origin of P, axes "
                "of P");
  struct Load {
    Outputs::Load index;
    const char* name;
    const char* text;
    Quantity quantity;
  };
  const Load loads[] = {
      {Outputs::kTension, "tension", "Tension in the capture interface", kForce},
      {Outputs::kCompression, "compression", "Compression in the capture interface", kForce},
      {Outputs::kShear, "shear", "Shear force in the capture interface", kForce},
      {Outputs::kBending, "bending", "Bending moment in the capture interface", kTorque},
      {Outputs::kTorsion, "torsion", "Torsion moment in the capture interface", kTorque},
  };
  for (const Load& load : loads) {
    table.output(std::string("capture.") + load.name, &out.capture_load[load.index], load.quantity,
                 load.text);
  }
  table.output("capture.load_ratio", &out.capture_load_ratio, kNone,
               "Largest ratio of a load in the capture interface to its rated value");
  const std::string largest = ", largest since the start over all inner steps";
  for (const Load& load : loads) {
    table.output(std::string("capture.peak.") + load.name, &out.capture_peak[load.index],
                 load.quantity, load.text + largest);
  }
  table.output("capture.peak.load_ratio", &out.capture_peak_load_ratio, kNone,
               "Ratio of a load in the capture interface to its rated value" + largest);
}

void add_contact(Table& table, Parameters& parameter, Outputs& out) {
  for (size_t i = 0; i < out.petal_force.size(); ++i) {
    table.output(indexed("contact.petal", i) + ".force", &out.petal_force[i], kForce,
                 "Size of the resultant contact force on this petal");
  }
  table.output("contact.depth_ratio", &out.contact_depth_ratio, kNone,
               "Largest contact depth as a fraction of the rounding of the surfaces");
  for (size_t i = 0; i < out.latch_opening.size(); ++i) {
    table.output(indexed("latch", i) + ".opening", &out.latch_opening[i], kSmallLength,
                 "Axial distance from the hook of this latch to its striker");
    table.output(indexed("latch", i) + ".force", &out.latch_force[i], kForce,
                 "Force in this latch, tension positive");
  }
  table
      .parameter("friction.coefficient", &parameter.friction_coefficient, kNone,
                 "Coefficient of friction of the capture surfaces")
      .not_negative();
  table
      .parameter("friction.model", &parameter.friction_model, kNone,
                 "Friction law: 1 regularised (slides slowly where it should stick), 2 bristle "
                 "(sticks)")
      .limits(1, 2);
  table
      .parameter("restitution", &parameter.restitution, kNone,
                 "Coefficient of restitution of the capture surfaces at restitution_speed")
      .limits(0, 1);
  table
      .parameter("restitution_speed", &parameter.restitution_speed, kSmallVelocity,
                 "Approach speed at which restitution holds")
      .not_negative();
}

void add_phase(Table& table, Parameters& parameter, Outputs& out) {
  table
      .output("phase", &out.phase, kNone,
              "Phase of the docking: 1 approach, 2 contact, 3 captured, 4 attenuating, 5 aligned, "
              "6 retracting, 7 hard docked, 8 rebound")
      .limits(1, 8);
  table.output("captured", &out.captured, kNone, "All latches hold");
  for (size_t i = 0; i < out.latched.size(); ++i) {
    table.output(indexed("latched", i), &out.latched[i], kNone, "This latch holds");
  }
  table
      .output("outcome", &out.outcome, kNone,
              "Outcome so far: 1 undecided, 2 captured, 3 partial capture (some latches hold), "
              "4 rebound, 5 miss")
      .limits(1, 5);
  table.output("time_to_contact", &out.time_to_contact, kTime,
               "Lower bound of the time until first contact, from gap and closing speed");
  table
      .output("time_of_contact", &out.time_of_contact, kTime,
              "Simulation time of the first contact, -1 before it")
      .discrete();
  table
      .output("time_of_capture", &out.time_of_capture, kTime,
              "Simulation time at which all latches held, -1 before it")
      .discrete();
  table.parameter("chaser.contact_thrust", &parameter.contact_thrust, kForce,
                  "Thrust on the chaser along +x of A from first contact until captured");
  table
      .parameter("chaser.contact_thrust_delay", &parameter.contact_thrust_delay, kTime,
                 "Time from first contact to the contact thrust")
      .not_negative();
}

void add_ring(Table& table, Outputs& out) {
  table.outputs("ring.position", out.ring_position, kSmallLength,
                "Origin of the guide ring G with respect to A, axes of A");
  table.outputs("ring.attitude", out.ring_attitude, kNone,
                "Attitude quaternion of the guide ring, axes of G to axes of A");
  table.outputs("ring.velocity", out.ring_velocity, kSmallVelocity,
                "Velocity of the origin of the guide ring with respect to A, axes of A");
  table.outputs("ring.angular_velocity", out.ring_angular_velocity, kAngularVelocity,
                "Angular velocity of the guide ring with respect to A, axes of A");
}

void add_legs(Table& table, Inputs& in, Outputs& out) {
  for (size_t i = 0; i < out.leg_length.size(); ++i) {
    const std::string leg = indexed("leg", i);
    table.output(leg + ".length", &out.leg_length[i], kSmallLength, "Length of this leg");
    table.output(leg + ".rate", &out.leg_rate[i], kSmallVelocity, "Rate of change of its length");
    table.output(leg + ".force", &out.leg_force[i], kForce,
                 "Force along this leg, positive when it pushes its ends apart");
    table.input(leg + ".force_command", &in.leg_force_command[i], kForce,
                "Force commanded to the actuator of this leg, positive when it pushes its ends "
                "apart");
  }
}

void add_states(Table& table, Outputs& out) {
  // Slides and turns share these arrays: unit 1 stands for m or rad.
  const auto rows = [&](const char* name, std::vector<double>& values, const char* text) {
    for (size_t i = 0; i < values.size(); ++i) {
      table.output(indexed(name, i), &values[i], kNone, text);
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

void add_energy(Table& table, Outputs& out) {
  table.output("energy.kinetic", &out.energy_kinetic, kEnergy, "Kinetic energy of all inside");
  table.output("energy.potential", &out.energy_potential, kEnergy,
               "Potential energy of springs, contacts and latches");
  table.output("energy.dissipated", &out.energy_dissipated, kEnergy,
               "Energy dissipated since the start, sum of its four parts");
  table.output("energy.dissipated_contact", &out.energy_dissipated_contact, kEnergy,
               "Energy dissipated by contact damping");
  table.output("energy.dissipated_friction", &out.energy_dissipated_friction, kEnergy,
               "Energy dissipated by friction of the capture surfaces");
  table.output("energy.dissipated_legs", &out.energy_dissipated_legs, kEnergy,
               "Energy dissipated in the joints and legs of the mechanism");
  table.output("energy.dissipated_latches", &out.energy_dissipated_latches, kEnergy,
               "Energy dissipated in the latches");
  table.output("energy.external", &out.energy_external, kEnergy,
               "Work of forces from outside since the start");
  table.output("energy.residual", &out.energy_residual, kEnergy,
               "Energy that does not add up since the start");
  table.output("momentum.residual", &out.momentum_residual, kNone,
               "Largest momentum that does not add up since the start, as a fraction");
  table.outputs("momentum.linear", out.momentum_linear, kMomentum,
                "Linear momentum of all inside but the driven vehicles, in N");
  table.outputs("momentum.angular", out.momentum_angular, kAngularMomentum,
                "Angular momentum of all inside but the driven vehicles about "
                "momentum.reference, in N");
  table.outputs("momentum.reference", out.momentum_reference, kLength,
                "Reference point of momentum.angular in N");
}

void add_solver_parameters(Table& table, Parameters& parameter) {
  table
      .parameter("solver.method", &parameter.solver_method, kNone,
                 "Integration method: 1 auto, 2 explicit (adaptive one-step)")
      .limits(1, 2);
  table.parameter("solver.rtol", &parameter.rtol, kNone, "Relative tolerance of the integration")
      .limits(0, 1);
  table
      .parameter("solver.atol_position", &parameter.atol_position, kSmallLength,
                 "Absolute tolerance of positions, also of attitudes [rad]")
      .not_negative();
  table
      .parameter("solver.atol_velocity", &parameter.atol_velocity, kSmallVelocity,
                 "Absolute tolerance of velocities, also of angular velocities [rad/s]")
      .not_negative();
  table
      .parameter("solver.atol_energy", &parameter.atol_energy, kEnergy,
                 "Absolute tolerance of dissipated energies and external work")
      .not_negative();
}

void add_solver_outputs(Table& table, Outputs& out) {
  table.output("solver.steps", &out.solver_steps, kNone, "Inner steps since the start").discrete();
  table
      .output("solver.rhs_evaluations", &out.solver_rhs_evaluations, kNone,
              "Evaluations of the equations of motion since the start")
      .discrete();
  table
      .output("solver.rejected_steps", &out.solver_rejected_steps, kNone,
              "Inner steps that were tried and repeated with a smaller one since the start")
      .discrete();
  table.output("solver.closure_residual", &out.solver_closure_residual, kSmallLength,
               "Largest gap of a closed loop");
  table.output("solver.singularity_margin", &out.solver_singularity_margin, kNone,
               "Smallest normalised distance of a loop to a singular pose");
}

}  // namespace

const std::vector<Unit>& unit_definitions() {
  static const std::vector<Unit> kUnits = {
      {"1", 0, 0, 0, 0, {}},
      {"m", 0, 1, 0, 0, {{"mm", 1e3}}},
      {"m/s", 0, 1, -1, 0, {{"mm/s", 1e3}}},
      {"m/s2", 0, 1, -2, 0, {}},
      {"rad", 0, 0, 0, 1, {{"deg", kDegrees}}},
      {"rad/s", 0, 0, -1, 1, {{"deg/s", kDegrees}}},
      {"s", 0, 0, 1, 0, {}},
      {"kg", 1, 0, 0, 0, {}},
      {"kg.m2", 1, 2, 0, 0, {}},
      {"N", 1, 1, -2, 0, {}},
      {"N.m", 1, 2, -2, 0, {}},
      {"N.s", 1, 1, -1, 0, {}},
      {"N.m.s", 1, 2, -1, 0, {}},
      {"J", 1, 2, -2, 0, {}},
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
               "Acceleration in N that acts on every body inside; not to be told as force_ext "
               "as well");
  if (scene.has_target) {
    if (wants("relative")) add_relative(table, outputs);
    if (wants("capture")) add_capture(table, outputs);
    if (wants("contact")) add_contact(table, parameters, outputs);
    if (wants("phase")) add_phase(table, parameters, outputs);
  }
  if (wants("ring")) add_ring(table, outputs);
  if (wants("legs")) add_legs(table, inputs, outputs);
  if (wants("states")) add_states(table, outputs);
  if (wants("loops")) add_loops(table, outputs);
  if (wants("energy")) add_energy(table, outputs);
  add_solver_parameters(table, parameters);
  if (wants("solver")) add_solver_outputs(table, outputs);
  return table.take();
}

}  // namespace dockloop
