// The variable table of a simulation: order of its groups, units, loads, checks of values.
#include "interface/variables.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "interface/model_description.hpp"
#include "interface/variable_table.hpp"
#include "model/text_hash.hpp"

namespace dockloop {
namespace {

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
      {"N/m", 1, 0, -2, 0, {}},
      {"N.s/m", 1, 0, -1, 0, {}},
      {"s/m", 0, -1, 1, 0, {}},
      {"A.m2", 0, 2, 0, 0, {}, 1},
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
    const bool both_move = std::none_of(scene.motion.begin(), scene.motion.end(),
                                        [](Motion m) { return m == Motion::kFixed; });
    if (wants("relative") && both_move) add_stack(table, outputs);
    if (wants("capture")) add_capture(table, outputs);
    if (wants("contact")) add_contact(table, scene.contact, parameters, outputs);
    if (wants("phase")) add_phase(table, parameters, outputs);
  }
  if (!scene.sequence.empty()) {
    if (!scene.has_target || !wants("phase")) add_progress(table, outputs);
    add_sequence(table, scene.sequence, inputs, outputs);
  }
  if (wants("ring")) add_ring(table, outputs);
  if (wants("legs")) add_legs(table, scene.mechanism, inputs, outputs);
  add_parts(table, scene, outputs);
  add_elements(table, sim);
  add_failures(table, sim);
  add_disturbances(table, sim);
  add_hard_dock(table, scene.hard_dock, inputs, outputs);
  add_vehicle_forces(table, scene, outputs);
  add_hardware(table, sim);
  if (wants("states")) add_states(table, outputs);
  if (wants("loops")) add_loops(table, outputs);
  if (wants("energy")) {
    add_energy(table, outputs, scene);
  }
  const bool is_driven = !offers_model_exchange(scene);
  if (is_driven) add_coupling_parameters(table, parameters, inputs);
  if (is_driven && wants("coupling")) add_coupling_outputs(table, outputs);
  add_model_parameters(table, parameters, sim.has_comparison());
  add_solver_parameters(table, parameters, sim.has_comparison());
  if (wants("solver")) add_solver_outputs(table, outputs, sim.has_comparison());
  if (offers_model_exchange(scene)) add_state_vector(table, scene, outputs);
  std::vector<Variable> rows = table.take();
  for (const InputHistory& history : scene.inputs) {
    for (Variable& row : rows) {
      if (row.name != history.variable) continue;
      row.causality = Causality::kOutput;
      row.start = nullptr;
      row.description += " (as a table of the scene prescribes)";
    }
  }
  number_values(rows, sim);
  return rows;
}

std::string find_guid(const Scene& scene, const std::vector<Variable>& rows) {
  std::string text = scene.fingerprint;
  for (const Variable& v : rows) {
    for (const std::string& part : {v.name, v.description, std::string(v.unit)})
      text += part + '\n';
    for (const char* kind : {name_of(v.type), name_of(v.causality), name_of(v.variability)})
      text += kind;
  }
  return hash_text(text);
}

std::string describe_unusable(double value) {
  if (!std::isfinite(value)) return " is not a finite number";
  return " is too large: its absolute value must be at most 1e30";
}

void check_value(const Variable& v, double value, const char* function) {
  const auto refuse = [&](const std::string& why) {
    throw ModelError(std::string(function) + ": '" + v.name + "' = " + shortest(value) + why);
  };
  if (!is_usable(value)) refuse(describe_unusable(value));
  if (v.type == Type::kBoolean && value != 0.0 && value != 1.0) {
    refuse(": must be false (0) or true (1)");
  }
  const auto absent = v.refused.find(static_cast<int>(std::clamp(value, -1e9, 1e9)));
  if (absent != v.refused.end()) refuse(absent->second);
  const std::string unit = v.unit == std::string("1") ? "" : std::string(" ") + v.unit;
  if (value < v.min) refuse(" is below its minimum " + shortest(v.min) + unit);
  if (value > v.max) refuse(" is above its maximum " + shortest(v.max) + unit);
}

}  // namespace dockloop
