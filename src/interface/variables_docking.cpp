// Rows of the variable table: vehicles, relative motion, capture, contact, phases, sequence.
#include "docking/phases.hpp"
#include "interface/variable_table.hpp"

namespace dockloop {

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
    } else if (motion == Motion::kRecorded) {
      table.outputs(v + name, member_of(output), quantity, text + " (as a record prescribes)");
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
    const std::string force = "Force from outside on the centre of mass" + of + ", in N";
    const std::string torque = "Torque from outside about the centre of mass" + of + ", body axes";
    if (motion == Motion::kRecorded) {
      const std::string why = ": what keeps the vehicle on its record";
      table.outputs(v + "force_ext", output.force_ext, kForce, force + why);
      table.outputs(v + "torque_ext", output.torque_ext, kTorque, torque + why);
    } else {
      table.inputs(v + "force_ext", input.force_ext, kForce, force);
      table.inputs(v + "torque_ext", input.torque_ext, kTorque, torque);
    }
    Row mass = table.parameter(v + "mass", &parameter.mass, kMass, "Mass" + of).not_negative();
    Row inertia = table.parameters(v + "inertia", parameter.inertia, kInertia,
                                   "Inertia" + of + " about its centre of mass, body axes");
    if (motion == Motion::kDriven) {  // of the host, whose vehicle may lose fuel or parts
      mass.tunable();
      inertia.tunable();
    }
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
  const std::string step = " (the step just made; coupling.mode = 2 or 3: the coming step)";
  table.outputs(v + "force_mean", output.force_mean, kForce,
                "Constant force over a step with the true impulse on the vehicle, in N" + step);
  table.outputs(v + "torque_mean", output.torque_mean, kTorque,
                "Constant torque over a step with the true angular impulse on the vehicle, about "
                "the centre of mass, body axes" +
                    step);
}

void add_stack(Table& table, Outputs& out) {
  const std::string text = " of chaser, mechanism and target as one rigid body in their poses now";
  const auto finish = [](auto row) { row.discrete().group(OutputGroup::kStack); };
  finish(table.output("stack.mass", &out.stack_mass, kMass, "Mass" + text));
  finish(table.outputs("stack.com", out.stack_com, kLength,
                       "Centre of mass" + text + ", from the centre of mass of the chaser, C"));
  finish(table.outputs("stack.inertia", out.stack_inertia, kInertia,
                       "Inertia" + text + ", about stack.com, axes of C"));
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

void add_peak(Table& table, const std::string& before, const std::string& after, const Peak& peak,
              Quantity quantity, const std::string& text) {
  const std::string largest = "largest since the start over all inner steps";
  table.output(before + ".peak" + after, &peak.value, quantity, text + ", " + largest)
      .not_negative();
  table.output(before + ".peak_time" + after, &peak.time, kTime,
               "Simulation time of " + before + ".peak" + after + ", -1 before");
  table
      .output(before + ".peak_step" + after, &peak.step, kNone,
              "Step of the sequence in which " + before + ".peak" + after +
                  " arose, as in sequence.step; 0 before, or without a sequence")
      .limits(0, kMaxSteps);
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
  for (const Load& load : list_loads()) {
    add_peak(table, "capture", std::string(".") + load.name, out.capture_peak[load.index],
             load.quantity, load.text);
  }
  add_peak(table, "capture", ".load_ratio", out.capture_peak_load_ratio, kNone,
           "Ratio of a load between ring and target to its rated value");
}

namespace {

void add_surfaces(Table& table, const ContactModel& contact, Outputs& out) {
  for (size_t i = 0; i < out.surface_force.size(); ++i) {
    const Surface& surface = contact.surfaces[i];
    const std::string name = indexed("contact.surface", i);
    const std::string text = "Size of the resultant contact force on '" + surface.name +
                             "' of the " + (surface.on_passive ? "passive" : "active") + " side";
    table.output(name + ".force", &out.surface_force[i], kForce, text).not_negative();
    add_peak(table, name, "", out.surface_peak[i], kForce, text);
  }
}

}  // namespace

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

namespace {

Quantity find_quantity(const WatchedLimit& limit) {
  switch (*limit.unit) {
    case 'm':
      return kSmallLength;
    case 'r':
      return kAngle;
    case 's':
      return kTime;
    default:
      return kNone;
  }
}

void add_limits(Table& table, Outputs& out) {
  std::string bits;
  for (size_t i = 0; i < kLimits.size(); ++i) {
    bits += std::string(i ? ", " : "") + kLimits[i].name + ' ' + std::to_string(1 << i);
  }
  table.output("limits.exceeded", &out.limits_exceeded, kNone,
               "Limits passed since the start, sum of " + bits);
  for (size_t i = 0; i < kLimits.size(); ++i) {
    const std::string name = std::string("limits.") + kLimits[i].name;
    table
        .output(name + ".time", &out.limits.time[i], kTime,
                std::string("Simulation time when first ") + kLimits[i].happened + ", -1 before")
        .discrete();
    table
        .output(name + ".value", &out.limits.value[i], find_quantity(kLimits[i]),
                "Value at this time, 0 before")
        .discrete();
  }
}

}  // namespace

void add_phase(Table& table, Parameters& parameter, Outputs& out) {
  add_progress(table, out);
  table.output("captured", &out.captured, kNone,
               "All latches hold, or the sequence states a grasp");
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
              "Simulation time of the first capture, -1 before")
      .discrete();
  add_limits(table, out);
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
namespace {

std::string list_steps(const Sequence& sequence) {
  std::string text;
  for (size_t i = 0; i < sequence.steps.size(); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(i + 1) + " " + sequence.steps[i].name;
  }
  return text;
}

}  // namespace

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
  for (size_t i = 0; i < sequence.steps.size(); ++i) {
    table
        .output(indexed("sequence.entered", i), &out.sequence_entered[i], kTime,
                "Time at which step '" + sequence.steps[i].name + "' was first entered, -1 before")
        .discrete();
  }
}

}  // namespace dockloop
