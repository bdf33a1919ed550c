// Rows of the variable table: ring, legs, elements, failures, disturbances, hard dock, forces,
// loops.
#include <algorithm>

#include "docking/hardware_numbers.hpp"
#include "docking/phases.hpp"
#include "interface/variable_table.hpp"

namespace dockloop {

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

namespace {

void add_crank_leg(Table& table, const std::string& leg, size_t i, Inputs& in, Outputs& out) {
  table.output(leg + ".length", &out.leg_length[i], kSmallLength,
               "Travel of the crank pin of this leg along its circle, from home");
  table.output(leg + ".rate", &out.leg_rate[i], kSmallVelocity,
               "Speed of the crank pin of this leg along its circle");
  table.output(leg + ".force", &out.leg_force[i], kForce,
               "Torque about the crank axis of this leg over the crank length, including elements "
               "and couplings on the crank, positive along the travel of the pin");
  table.input(leg + ".force_command", &in.leg_force_command[i], kForce,
              "Commanded torque of the actuator of this leg over the crank length, positive along "
              "the travel of the crank pin");
}

}  // namespace

void add_legs(Table& table, const MechanismModel& mechanism, Inputs& in, Outputs& out) {
  for (size_t i = 0; i < out.leg_length.size(); ++i) {
    const std::string leg = indexed("leg", i);
    if (mechanism.bodies[mechanism.legs[i].body].joint == JointType::kRevolute) {
      add_crank_leg(table, leg, i, in, out);
      continue;
    }
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
  for (size_t i = 0; i < std::min<size_t>(out.leg_peak.size(), kMaxLegPeaks); ++i) {
    const std::string leg = indexed("leg", i);
    add_peak(table, leg, "", out.leg_peak[i], kForce, "Size of " + leg + ".force");
  }
}

namespace {

/// Limits of a parameter with this rule. Values at a limit that is not allowed are refused when the
/// run starts.
Row limited(Row row, Rule rule) {
  if (rule == Rule::kShare) return row.limits(0.0, 1.0);
  return rule == Rule::kAny ? row : row.not_negative();
}

}  // namespace

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

/// Parts of vehicles: coordinate, rate and force of each connection, one or one per direction.
void add_parts(Table& table, const Scene& scene, Outputs& out) {
  size_t part = 0, at = 0;
  const auto add = [&](const VehiclePart& each) {
    const size_t count = each.coordinates.size();
    const std::string name = indexed("part", part++);
    const auto rows = [&](const char* member, std::vector<double>& values, const Quantity& slide,
                          const Quantity& turn, const std::string& text) {
      for (size_t k = 0; k < count; ++k) {
        const bool turns = each.coordinates[k].joint == JointType::kRevolute;
        const Quantity& quantity = is_mode(each) ? kLawNumber : turns ? turn : slide;
        const std::string vector = name + "." + member;
        table.output(count > 1 ? indexed(vector, k) : vector, &values[at + k], quantity,
                     text + " of " + each.name);
      }
    };
    const std::string of = is_mode(each) ? " of the mode (mass 1 kg)" : " of the connection";
    rows("coordinate", out.part_coordinate, kSmallLength, kAngle, "Coordinate" + of);
    rows("rate", out.part_rate, kSmallVelocity, kAngularVelocity, "Rate of the coordinate" + of);
    rows("force", out.part_force, kForce, kTorque,
         "Force of spring and damper" + of + ", positive when it increases the coordinate,");
    at += count;
  };
  scene.parts[kChaser].for_each(add);
  scene.parts[kTarget].for_each(add);
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

/// Forces of the scene between the vehicles.
void add_vehicle_forces(Table& table, const Scene& scene, Outputs& out) {
  for (size_t i = 0; i < out.vehicle_force.size(); ++i) {
    const std::string name = indexed("force", i);
    const std::string of = std::string(" of this ") + name_of(scene.forces[i].kind);
    table.outputs(name + ".force", out.vehicle_force[i], kForce,
                  "Force" + of + " on the target, axes of P");
    table.outputs(name + ".torque", out.vehicle_torque[i], kTorque,
                  "Torque" + of + " on the target about the origin of P, axes of P");
    table
        .output(name + ".distance", &out.vehicle_distance[i], kSmallLength,
                "Distance of the points" + of + " on chaser and target")
        .not_negative();
  }
}

namespace {

/// Quantity of a number of the hardware, by its unit.
const Quantity& find_quantity(const std::string& unit) {
  if (unit.empty()) return kLawNumber;
  for (const Quantity* each : {&kSmallLength, &kSmallVelocity, &kTime, &kForce, &kStiffness,
                               &kDamping, &kDampingFactor, &kMagneticMoment}) {
    if (unit == each->unit) return *each;
  }
  return kNone;
}

}  // namespace

/// Numbers of springs, and of contact laws, latches, hard dock and forces where there is a target.
void add_hardware(Table& table, DockingSim& sim) {
  Parameters& parameters = sim.parameters();
  const Scene& scene = sim.scene();
  double* number = parameters.hardware_numbers.data();
  const auto add = [&](const std::string& name, double value, const char* unit, Rule rule,
                       const std::string& text) {
    const Quantity& quantity = find_quantity(unit);
    limited(table.parameter(name, number++, quantity, text), rule)
        .nominal(value > 0.0 ? value : quantity.nominal);
  };
  for_each_spring_number(scene.mechanism, add);
  if (!scene.has_target) return;
  for_each_docking_number(scene, add);
  for (size_t i = 0; i < parameters.latch_overload.size(); ++i) {
    table.parameter(indexed("latch", i) + ".releases_on_overload", &parameters.latch_overload[i],
                    kNone, "This latch releases when its tension exceeds its rated load");
  }
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

}  // namespace dockloop
