// Writes modelDescription.xml of FMI 2.0 for co-simulation: a small XML writer, then one function
// per section of the file in the order the schema demands.
//
// Capability flags say what the functions in fmi2_functions.cpp really do; whoever makes one true
// writes the test that fails when the function has no effect.
#include "model_description.hpp"

#include <charconv>
#include <cmath>
#include <utility>

#include "logger.hpp"
#include "variables.hpp"

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

// Names in the file, indexed by the enumerations of variables.hpp.
constexpr const char* kTypes[] = {"Real", "Integer", "Boolean"};
constexpr const char* kCausalities[] = {"parameter", "input", "output"};
constexpr const char* kVariabilities[] = {"fixed", "discrete", "continuous"};
template <class Enumeration, size_t n>
const char* name_of(Enumeration value, const char* const (&names)[n]) {
  return names[static_cast<size_t>(value)];
}

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
  xml.leaf("CoSimulation", {{"modelIdentifier", scene.name},
                            {"needsExecutionTool", "false"},
                            {"canHandleVariableCommunicationStepSize", "true"},
                            {"canInterpolateInputs", "false"},
                            {"maxOutputDerivativeOrder", "0"},
                            {"canRunAsynchronuously", "false"},
                            {"canBeInstantiatedOnlyOncePerProcess", "false"},
                            {"canNotUseMemoryManagementFunctions", "true"},
                            {"canGetAndSetFMUstate", "false"},
                            {"canSerializeFMUstate", "false"},
                            {"providesDirectionalDerivative", "false"}});
}

void write_units(XmlWriter& xml) {
  xml.open("UnitDefinitions");
  for (const Unit& unit : unit_definitions()) {
    xml.open("Unit", {{"name", unit.name}});
    XmlWriter::Attributes exponents;
    const std::pair<const char*, int> all[] = {
        {"kg", unit.kg}, {"m", unit.m}, {"s", unit.s}, {"rad", unit.rad}};
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

void write_variable(XmlWriter& xml, const Variable& v, size_t reference) {
  XmlWriter::Attributes scalar = {{"name", v.name},
                                  {"valueReference", std::to_string(reference)},
                                  {"description", v.description},
                                  {"causality", name_of(v.causality, kCausalities)},
                                  {"variability", name_of(v.variability, kVariabilities)}};
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
    type.push_back({"unit", v.unit});
    if (*v.display_unit != '\0') type.push_back({"displayUnit", v.display_unit});
  }
  limit("min", v.min);
  limit("max", v.max);
  if (v.type == Type::kReal && v.nominal != 1.0) limit("nominal", v.nominal);
  if (v.has_start()) type.push_back({"start", start_text(v)});
  xml.leaf(name_of(v.type, kTypes), type);
  xml.close("ScalarVariable");
}

/// Outputs: all, in order. InitialUnknowns: those without a start value. No `dependencies`, which
/// means "may depend on everything" and is true: contact couples all inputs to all outputs.
void write_structure(XmlWriter& xml, const std::vector<Variable>& variables) {
  const auto section = [&](const char* name, bool computed_only) {
    XmlWriter::Attributes indices;
    for (size_t i = 0; i < variables.size(); ++i) {
      const Variable& v = variables[i];
      if (v.causality != Causality::kOutput || (computed_only && v.has_start())) continue;
      indices.push_back({"index", std::to_string(i + 1)});
    }
    if (indices.empty()) return;  // the schema wants no empty section
    xml.open(name);
    for (const XmlWriter::Attribute& index : indices) xml.leaf("Unknown", {index});
    xml.close(name);
  };
  xml.open("ModelStructure");
  section("Outputs", false);
  section("InitialUnknowns", true);
  xml.close("ModelStructure");
}

}  // namespace

std::string make_model_description(DockingSim& sim, const std::string& generation_time) {
  const Scene& scene = sim.scene();
  const std::vector<Variable> variables = make_variables(sim);
  XmlWriter xml;
  xml.open("fmiModelDescription", {{"fmiVersion", "2.0"},
                                   {"modelName", scene.name},
                                   {"guid", scene.fingerprint},
                                   {"description", scene.title},
                                   {"generationTool", "dockloop " DOCKLOOP_VERSION},
                                   {"generationDateAndTime", generation_time},
                                   {"variableNamingConvention", "structured"},
                                   {"numberOfEventIndicators", "0"}});
  write_capabilities(xml, scene);
  write_units(xml);
  write_log_categories(xml);
  write_experiment(xml, scene.experiment);
  xml.open("ModelVariables");
  for (size_t i = 0; i < variables.size(); ++i) write_variable(xml, variables[i], i);
  xml.close("ModelVariables");
  write_structure(xml, variables);
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
