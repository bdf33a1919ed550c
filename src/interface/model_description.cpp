// Writes modelDescription.xml of FMI 2.0 for both FMI kinds: a small XML writer, then one function
// per section of the file in the order of the schema.
//
// Capability flags describe the functions in fmi2_functions.cpp. A flag that becomes true needs a
// test that fails if the function has no effect.
#include "interface/model_description.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <memory>
#include <set>
#include <utility>

#include "interface/log_categories.hpp"
#include "interface/variables.hpp"
#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {
namespace {

/// Elements with attributes, indented; text content does not occur in this file format.
class XmlWriter {
 public:
  struct Attribute {
    const char* name;
    std::string value;
  };
  using Attributes = std::vector<Attribute>;

  void open(const char* element, const Attributes& attributes = {}) {
    begin(element, attributes);
    text_ += ">\n";
    ++depth_;
  }
  void close(const char* element) {
    --depth_;
    indent();
    text_ += std::string("</") + element + ">\n";
  }
  void leaf(const char* element, const Attributes& attributes) {
    begin(element, attributes);
    text_ += "/>\n";
  }
  std::string take() { return std::move(text_); }

 private:
  void indent() { text_.append(2 * depth_, ' '); }
  void begin(const char* element, const Attributes& attributes) {
    indent();
    text_ += std::string("<") + element;
    for (const Attribute& a : attributes) {
      text_ += std::string(" ") + a.name + "=\"" + xml_escape(a.value) + "\"";
    }
  }

  std::string text_ = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  size_t depth_ = 0;
};

std::string start_text(const Variable& v) {
  switch (v.type) {
    case Type::kReal:
      return shortest(*static_cast<const double*>(v.start));
    case Type::kInteger:
      return std::to_string(*static_cast<const int*>(v.start));
    case Type::kBoolean:
      return *static_cast<const char*>(v.start) ? "true" : "false";
  }
  return "";
}

void write_capabilities(XmlWriter& xml, const Scene& scene) {
  const XmlWriter::Attributes shared = {{"modelIdentifier", scene.name},
                                        {"needsExecutionTool", "false"},
                                        {"canBeInstantiatedOnlyOncePerProcess", "false"},
                                        {"canNotUseMemoryManagementFunctions", "true"},
                                        {"canGetAndSetFMUstate", "true"},
                                        {"canSerializeFMUstate", "true"},
                                        {"providesDirectionalDerivative", "true"}};
  if (offers_model_exchange(scene)) {
    XmlWriter::Attributes attributes = shared;
    attributes.push_back({"completedIntegratorStepNotNeeded", "false"});
    xml.leaf("ModelExchange", attributes);
  }
  XmlWriter::Attributes attributes = shared;
  attributes.insert(attributes.end(), {{"canHandleVariableCommunicationStepSize", "true"},
                                       {"canInterpolateInputs", "true"},
                                       {"maxOutputDerivativeOrder", "1"},
                                       {"canRunAsynchronuously", "false"}});
  xml.leaf("CoSimulation", attributes);
}

void write_units(XmlWriter& xml) {
  xml.open("UnitDefinitions");
  for (const Unit& unit : unit_definitions()) {
    xml.open("Unit", {{"name", unit.name}});
    XmlWriter::Attributes exponents;
    const std::pair<const char*, int> all[] = {
        {"kg", unit.kg}, {"m", unit.m}, {"s", unit.s}, {"A", unit.A}, {"rad", unit.rad}};
    for (const auto& [base, exponent] : all) {
      if (exponent != 0) exponents.push_back({base, std::to_string(exponent)});
    }
    xml.leaf("BaseUnit", exponents);
    for (const DisplayUnit& display : unit.display) {
      xml.leaf("DisplayUnit", {{"name", display.name}, {"factor", shortest(display.factor)}});
    }
    xml.close("Unit");
  }
  xml.close("UnitDefinitions");
}

/// The types of the variables of this scene, in order of occurrence.
void write_types(XmlWriter& xml, const std::vector<Variable>& variables) {
  std::set<std::string> written;
  for (const Variable& v : variables) {
    const Quantity& type = v.quantity;
    if (v.type != Type::kReal || !written.insert(type.name).second) continue;
    if (written.size() == 1) xml.open("TypeDefinitions");  // the schema wants no empty section
    xml.open("SimpleType", {{"name", type.name}, {"description", type.description}});
    XmlWriter::Attributes real;
    if (*type.physical != '\0') real.push_back({"quantity", type.physical});
    real.push_back({"unit", type.unit});
    if (*type.display != '\0') real.push_back({"displayUnit", type.display});
    if (type.nominal != 1.0) real.push_back({"nominal", shortest(type.nominal)});
    xml.leaf("Real", real);
    xml.close("SimpleType");
  }
  if (!written.empty()) xml.close("TypeDefinitions");
}

void write_log_categories(XmlWriter& xml) {
  xml.open("LogCategories");
  for (const LogCategory& category : kLogCategories) {
    xml.leaf("Category", {{"name", category.name}, {"description", category.description}});
  }
  xml.close("LogCategories");
}

void write_experiment(XmlWriter& xml, const Experiment& e) {
  xml.leaf("DefaultExperiment", {{"startTime", shortest(e.start)},
                                 {"stopTime", shortest(e.stop)},
                                 {"tolerance", shortest(e.tolerance)},
                                 {"stepSize", shortest(e.step)}});
}

void write_variable(XmlWriter& xml, const Variable& v, size_t reference, size_t state_count) {
  XmlWriter::Attributes scalar = {{"name", v.name},
                                  {"valueReference", std::to_string(reference)},
                                  {"description", v.description},
                                  {"causality", name_of(v.causality)},
                                  {"variability", name_of(v.variability)}};
  // The standard forbids `initial` on inputs.
  if (v.causality != Causality::kInput) {
    scalar.push_back({"initial", v.has_start() ? "exact" : "calculated"});
  }
  xml.open("ScalarVariable", scalar);

  XmlWriter::Attributes type;
  const auto limit = [&](const char* name, double value) {
    if (std::isfinite(value)) type.push_back({name, shortest(value)});
  };
  if (v.type == Type::kReal) {
    // The unit is repeated for importers that do not look into the declared type.
    type.push_back({"declaredType", v.quantity.name});
    type.push_back({"unit", v.unit});
    if (*v.display_unit != '\0') type.push_back({"displayUnit", v.display_unit});
  }
  limit("min", v.min);
  limit("max", v.max);
  if (v.type == Type::kReal && (v.nominal != 1.0 || v.quantity.nominal != 1.0)) {
    limit("nominal", v.nominal);
  }
  if (v.has_start()) type.push_back({"start", start_text(v)});
  if (v.jumps) type.push_back({"reinit", "true"});
  // Rates follow the states in the table.
  if (v.rate >= 0) type.push_back({"derivative", std::to_string(reference + 1 - state_count)});
  xml.leaf(name_of(v.type), type);
  xml.close("ScalarVariable");
}

/// Facts that need an initialised simulation. Empty if the start values cannot be simulated, or if
/// dependencies may change: the file then has no dependencies ("on everything").
struct StartFacts {
  std::vector<std::vector<size_t>>
      known;                    ///< per unknown row: indices (from 1) of its dependencies
  std::vector<double> nominal;  ///< per continuous state
};

/// Near singular poses other joints may become the states, which changes dependencies.
bool may_change_coordinates(const Scene& scene) {
  const Mechanism mechanism(scene.mechanism);
  const std::vector<int>& bodies = mechanism.plan.ind_bodies;
  return !scene.mechanism.loops.empty() && std::any_of(bodies.begin(), bodies.end(), [&](int body) {
    return mechanism.model.bodies[static_cast<size_t>(body)].joint != JointType::kFree;
  });
}

/// Dependencies are merged over both FMI kinds, which treat gravity differently.
StartFacts find_start_facts(const std::shared_ptr<const Scene>& scene,
                            const std::vector<Variable>& variables) {
  StartFacts facts;
  std::vector<std::vector<size_t>> known(variables.size());
  for (const FmiKind fmi_kind : {FmiKind::kCoSimulation, FmiKind::kModelExchange}) {
    if (fmi_kind == FmiKind::kModelExchange && !offers_model_exchange(*scene)) continue;
    DockingSim sim(scene, fmi_kind);
    // Friction and damping that a host can switch on count as present.
    Parameters& parameters = sim.parameters();
    parameters.friction_coefficient = std::max(parameters.friction_coefficient, 0.1);
    parameters.restitution = std::min(parameters.restitution, 0.9);
    parameters.model_level = kReduced;  // the level with all dependencies
    try {
      sim.initialise(scene->experiment.start, 0.0);
    } catch (const ModelError&) {
      return {};
    }
    facts.nominal.resize(static_cast<size_t>(sim.state_count()));
    sim.get_nominals(facts.nominal.data());
    const Dependencies found = sim.find_dependencies();
    for (size_t i = 0; i < variables.size(); ++i) {
      const Variable& unknown = variables[i];
      if (unknown.output < 0 && unknown.rate < 0) continue;
      const Dependencies::Row& row = unknown.rate >= 0
                                         ? found.rate[static_cast<size_t>(unknown.rate)]
                                         : found.output[static_cast<size_t>(unknown.output)];
      for (size_t j = 0; j < variables.size(); ++j) {
        const Variable& v = variables[j];
        if ((v.input >= 0 && row.input[static_cast<size_t>(v.input)]) ||
            (v.state >= 0 && row.state[static_cast<size_t>(v.state)])) {
          known[i].push_back(j + 1);
        }
      }
    }
  }
  for (std::vector<size_t>& rows : known) {
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  }
  if (!may_change_coordinates(*scene)) facts.known = std::move(known);
  return facts;
}

/// Outputs: all, in order. Derivatives: the rates of all states, in order. InitialUnknowns: outputs
/// without a start value, states and rates. InitialUnknowns also depend on parameters and start
/// values, so they have no list of dependencies ("on everything").
void write_structure(XmlWriter& xml, const std::vector<Variable>& variables,
                     const std::vector<std::vector<size_t>>& known) {
  const auto section = [&](const char* name, bool initial, auto&& belongs) {
    std::vector<size_t> rows;
    for (size_t i = 0; i < variables.size(); ++i) {
      if (belongs(variables[i])) rows.push_back(i);
    }
    if (rows.empty()) return;  // the schema wants no empty section
    xml.open(name);
    for (const size_t i : rows) {
      XmlWriter::Attributes attributes = {{"index", std::to_string(i + 1)}};
      if (!initial && !known.empty()) {
        std::string list;
        for (const size_t j : known[i]) list += (list.empty() ? "" : " ") + std::to_string(j);
        attributes.push_back({"dependencies", list});
      }
      xml.leaf("Unknown", attributes);
    }
    xml.close(name);
  };
  const auto is_output = [](const Variable& v) { return v.causality == Causality::kOutput; };
  xml.open("ModelStructure");
  section("Outputs", false, is_output);
  section("Derivatives", false, [](const Variable& v) { return v.rate >= 0; });
  section("InitialUnknowns", true, [&](const Variable& v) {
    return (is_output(v) && !v.has_start()) || v.state >= 0 || v.rate >= 0;
  });
  xml.close("ModelStructure");
}

}  // namespace

std::string make_model_description(DockingSim& sim, const std::string& generation_time) {
  const Scene& scene = sim.scene();
  std::vector<Variable> variables = make_variables(sim);
  const bool exchanges = offers_model_exchange(scene);
  const size_t state_count = exchanges ? static_cast<size_t>(sim.state_count()) : 0;
  const StartFacts facts = find_start_facts(sim.shared_scene(), variables);
  for (Variable& v : variables) {
    if (v.state >= 0 && !facts.nominal.empty())
      v.nominal = facts.nominal[static_cast<size_t>(v.state)];
  }
  XmlWriter xml;
  xml.open("fmiModelDescription",
           {{"fmiVersion", "2.0"},
            {"modelName", scene.name},
            {"guid", find_guid(scene, variables)},
            {"description", scene.title},
            {"generationTool", "dockloop " DOCKLOOP_VERSION},
            {"generationDateAndTime", generation_time},
            {"variableNamingConvention", "structured"},
            {"numberOfEventIndicators", std::to_string(exchanges ? sim.indicator_count() : 0)}});
  write_capabilities(xml, scene);
  write_units(xml);
  write_types(xml, variables);
  write_log_categories(xml);
  write_experiment(xml, scene.experiment);
  xml.open("ModelVariables");
  for (size_t i = 0; i < variables.size(); ++i) write_variable(xml, variables[i], i, state_count);
  xml.close("ModelVariables");
  write_structure(xml, variables, facts.known);
  xml.close("fmiModelDescription");
  return xml.take();
}

std::string xml_escape(const std::string& text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    const char* entity = c == '&'    ? "&amp;"
                         : c == '<'  ? "&lt;"
                         : c == '>'  ? "&gt;"
                         : c == '"'  ? "&quot;"
                         : c == '\'' ? "&apos;"
                                     : nullptr;
    if (entity) {
      out += entity;
    } else {
      // XML 1.0 cannot write control characters.
      out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return out;
}

std::string shortest(double value) {
  char buffer[32];
  const std::to_chars_result end = std::to_chars(buffer, buffer + sizeof buffer, value);
  return std::string(buffer, end.ptr);
}

}  // namespace dockloop
