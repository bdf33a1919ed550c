// Rows of the variable table: energy, states, coupling, model and solver.
#include "docking/interface_stiffness.hpp"
#include "docking/phases.hpp"
#include "interface/variable_table.hpp"
#include "sim/host_diagnosis.hpp"

namespace dockloop {

void add_energy(Table& table, Outputs& out, const Scene& scene) {
  const bool has_elements = !scene.mechanism.elements.empty(),
             has_hard_dock = !scene.hard_dock.empty();
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
  if (!scene.forces.empty()) {
    table.output("energy.dissipated_forces", &out.energy_dissipated_forces, kEnergy,
                 "Energy dissipated by damping of springs and tethers between the vehicles");
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
              "value so far")
      .not_negative()
      .nominal(1e-14)
      .discrete()
      .group(OutputGroup::kMomentum);
  table
      .outputs("momentum.linear", out.momentum_linear, kMomentum,
               "Linear momentum of all bodies inside without driven vehicles, in N")
      .group(OutputGroup::kMomentum);
  table
      .outputs("momentum.angular", out.momentum_angular, kAngularMomentum,
               "Angular momentum of all bodies inside without driven vehicles, about "
               "momentum.reference, in N")
      .group(OutputGroup::kMomentum);
  table
      .outputs("momentum.reference", out.momentum_reference, kLength,
               "Reference point of momentum.angular in N")
      .group(OutputGroup::kMomentum);
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
  const auto target_parts = static_cast<size_t>(scene.parts[kTarget].count_coordinates());
  rows("ode.target.part_q", target_parts, kCoordinate, "Coordinate of a part [m, rad]");
  rows("ode.target.part_v", target_parts, kCoordinate, "Rate of a part [m/s, rad/s]");
  for (const int i : {kChaser, kTarget}) {
    const bool has_states = scene.motion[i] == Motion::kFree || scene.motion[i] == Motion::kDriven;
    if (!has_states || (i == kTarget && !scene.has_target)) continue;
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
  if (!scene.forces.empty()) {
    rows("ode.dissipated_forces", 1, kEnergy, "Energy dissipated since the start");
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
                 "Communication step of the first announced load (modes 2 and 3)")
      .not_negative();
  table
      .parameter("coupling.velocity_tolerance", &parameter.coupling_velocity_tolerance,
                 kSmallVelocity, "Allowed velocity error per step for coupling.suggested_step")
      .not_negative()
      .nominal(1e-4);
  table.parameter("coupling.identify", &parameter.coupling_identify, kNone,
                  "Predict the motion of driven vehicles with identified mass, centre of mass and "
                  "inertia, as soon as reports contradict the stated ones");
  table
      .parameter("coupling.delay", &parameter.coupling_delay, kTime,
                 "Delay of the loop: of loads on their way to the vehicle of the host and of its "
                 "motion on the way back, together")
      .limits(0, 10);
  table
      .parameter("coupling.motion_delay", &parameter.coupling_motion_delay, kTime,
                 "Part of coupling.delay: age of the reported motion")
      .limits(0, 10);
  table
      .input("coupling.next_step", &in.next_step, kTime,
             "Length of the step after the coming step, for its announced load (modes 2 and 3; 0: "
             "same "
             "as the coming step)")
      .limits(0, 10);
}

/// Estimated mass, centre of mass and inertia, each with its deviation.
void add_estimated_body(Table& table, Outputs& out) {
  const std::string which =
      " of the driven vehicle; of two: of the one that coupling.diagnosis names, else of the "
      "chaser";
  const auto add = [&](const std::string& name, auto& value, auto& deviation, Quantity quantity,
                       const std::string& text) {
    const std::string full = "coupling.estimated_" + name;
    const auto row = [&](const std::string& n, auto& v, const std::string& description) {
      if constexpr (std::is_same_v<std::decay_t<decltype(v)>, double>) {
        return table.output(n, &v, quantity, description);
      } else {
        return table.outputs(n, v, quantity, description);
      }
    };
    row(full, value, text + which).discrete().group(OutputGroup::kCoupling);
    row(full + "_deviation", deviation, "Standard deviation of " + full)
        .discrete()
        .group(OutputGroup::kCoupling);
  };
  add("mass", out.coupling_body.mass, out.coupling_deviations.mass, kMass,
      "Mass, estimated from the motion,");
  add("com", out.coupling_body.com, out.coupling_deviations.com, kLength,
      "Centre of mass, estimated from the motion, from the reported position in body axes,");
  add("inertia", out.coupling_inertia, out.coupling_deviations.inertia, kInertia,
      "Inertia about the centre of mass, estimated from the motion, body axes,");
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
      .output("coupling.diagnosis", &out.coupling_diagnosis, kNone,
              "Why reports of the host do not fit")
      .choices(kHostFaults)
      .group(OutputGroup::kCoupling);
  table
      .output("coupling.diagnosis_value", &out.coupling_diagnosis_value, kNone,
              "Size of the error of coupling.diagnosis; its list states the unit")
      .discrete()
      .group(OutputGroup::kCoupling);
  add_estimated_body(table, out);
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
      .output(
          "coupling.largest_delay", &out.coupling_largest_delay, kTime,
          "Largest delay of the loop that is stable although coupling.delay does not state it; 0 "
          "without a connection, 1000 if any delay is stable")
      .limits(0, kNoDelayLimit)
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
    if (m.is_carried(has_comparison)) continue;
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
  table.parameter("solver.measure_error", &parameter.measures_error, kNone,
                  "Measure solver.error_estimate: a companion with smaller tolerances "
                  "makes the same steps, at two to five times the cost; co-simulation only");
}

void add_solver_outputs(Table& table, Outputs& out, bool has_comparison) {
  table
      .output(
          "solver.chosen_method", &out.solver_chosen_method, kNone,
          "Integration method that makes the steps (a number of solver.method); 1 (auto) only in "
          "model exchange, where the host integrates")
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
      .output(
          "solver.error_estimate", &out.solver_error_estimate, kNone,
          "With accuracy: relative error that 98 % of the measured dockings stayed below with "
          "the method and tolerances in use (a statistical value); with solver.measure_error: of "
          "this run until now; 0 = no value")
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
              std::string("Largest gap of a closed loop") +
                  (has_comparison ? "; with method 9 over the inner steps of the last step" : ""))
      .not_negative()
      .nominal(1e-14)
      .discrete()
      .group(OutputGroup::kLoops);
  table
      .output("solver.singularity_margin", &out.solver_singularity_margin, kNone,
              "Smallest normalised distance of a loop to a singular pose")
      .limits(0, 1)
      .discrete();
}

}  // namespace dockloop
