// The variable table and the modelDescription.xml made from it.
//
// Verified: (1) every row is complete and named by the rules of FMI; (2) which rows exist follows
// from the scene and from nothing else; (3) rows point at the storage they name; (4) the XML is
// well formed, escaped, reproducible, and its lists follow the rules of FMI 2.0.
#include <gtest/gtest.h>

#include <cctype>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <set>

#include "interface/model_description.hpp"
#include "interface/variables.hpp"
#include "logger.hpp"
#include "minimal_scene.hpp"

namespace dockloop {
namespace {

const std::vector<std::string> kAllGroups = {"relative", "capture", "contact", "phase",  "ring",
                                             "legs",     "states",  "loops",   "energy", "solver"};
constexpr char kTime[] = "2025-01-31T12:00:00Z";

std::unique_ptr<DockingSim> make_sim(const std::vector<std::string>& groups = kAllGroups,
                                     Motion motion = Motion::kFree, bool has_target = true) {
  Scene scene = minimal_scene();
  scene.groups = groups;
  scene.motion = {motion, motion};
  scene.has_target = has_target;
  return std::make_unique<DockingSim>(std::make_shared<const Scene>(std::move(scene)));
}

std::map<std::string, Variable> by_name(DockingSim& sim) {
  std::map<std::string, Variable> rows;
  for (const Variable& v : make_variables(sim)) rows[v.name] = v;
  return rows;
}

bool has_prefix(const std::string& text, const std::string& prefix) {
  return text.rfind(prefix, 0) == 0;
}

const Unit* find_unit(const std::string& name) {
  for (const Unit& unit : unit_definitions()) {
    if (unit.name == name) return &unit;
  }
  return nullptr;
}

double start_of(const Variable& v) {
  switch (v.type) {
    case Type::kReal:
      return *static_cast<const double*>(v.start);
    case Type::kInteger:
      return *static_cast<const int*>(v.start);
    case Type::kBoolean:
      return *static_cast<const char*>(v.start);
  }
  return 0.0;
}

/// Identifiers with an optional index each, joined by dots.
bool is_structured(const std::string& name) {
  size_t i = 0;
  const auto is = [&](int (*kind)(int)) {
    return i < name.size() && kind(static_cast<unsigned char>(name[i])) != 0;
  };
  do {
    if (!is(std::isalpha)) return false;
    while (is(std::isalnum) || (i < name.size() && name[i] == '_')) ++i;
    if (i < name.size() && name[i] == '[') {
      if (++i; !is(std::isdigit)) return false;
      while (is(std::isdigit)) ++i;
      if (i == name.size() || name[i++] != ']') return false;
    }
  } while (i < name.size() && name[i++] == '.');
  return i == name.size() && name.back() != '.';
}

TEST(VariableTable, EveryRowIsComplete) {
  for (const Motion motion : {Motion::kFree, Motion::kDriven, Motion::kFixed}) {
    const auto sim = make_sim(kAllGroups, motion);
    std::set<std::string> names;
    for (const Variable& v : make_variables(*sim)) {
      SCOPED_TRACE(v.name);
      EXPECT_TRUE(names.insert(v.name).second) << "name is not unique";
      const bool is_rate = has_prefix(v.name, "der(") && v.name.back() == ')';
      EXPECT_TRUE(is_structured(is_rate ? v.name.substr(4, v.name.size() - 5) : v.name));
      EXPECT_EQ(is_rate, v.rate >= 0);
      EXPECT_FALSE(v.description.empty());
      EXPECT_NE(v.value, nullptr);
      EXPECT_LE(v.min, v.max);
      EXPECT_GT(v.nominal, 0.0);
      if (v.type == Type::kReal) {
        const Unit* unit = find_unit(v.unit);
        ASSERT_NE(unit, nullptr) << "unit '" << v.unit << "'";
        bool display_known = *v.display_unit == '\0';
        for (const DisplayUnit& d : unit->display) display_known |= !strcmp(d.name, v.display_unit);
        EXPECT_TRUE(display_known) << v.display_unit;
      } else {
        EXPECT_STREQ(v.unit, "");
        EXPECT_NE(v.variability, Variability::kContinuous);
      }
      if (v.causality == Causality::kParameter || v.causality == Causality::kInput) {
        EXPECT_EQ(v.start, v.value);
      }
      EXPECT_EQ(v.causality == Causality::kParameter,
                v.variability == Variability::kFixed || v.variability == Variability::kTunable);
      // Rows of the state vector and their rates, one for one.
      EXPECT_EQ(v.causality == Causality::kLocal, v.state >= 0 || v.rate >= 0);
      EXPECT_EQ(v.causality == Causality::kInput, v.input >= 0);
      EXPECT_EQ(v.causality == Causality::kInput, v.slope != nullptr);
      if (v.has_start()) {
        EXPECT_TRUE(std::isfinite(start_of(v)));
        EXPECT_GE(start_of(v), v.min);
        EXPECT_LE(start_of(v), v.max);
      }
    }
  }
}

TEST(VariableTable, RowsOfOneTypeAgree) {
  const auto sim = make_sim();
  std::map<std::string, Quantity> types;
  for (const Variable& v : make_variables(*sim)) {
    SCOPED_TRACE(v.name);
    if (v.type != Type::kReal) continue;
    EXPECT_STRNE(v.quantity.name, "");
    EXPECT_STREQ(v.quantity.unit, v.unit);
    EXPECT_STREQ(v.quantity.display, v.display_unit);
    const Quantity& first = types.emplace(v.quantity.name, v.quantity).first->second;
    EXPECT_STREQ(first.unit, v.quantity.unit);
    EXPECT_STREQ(first.display, v.quantity.display);
    EXPECT_EQ(first.nominal, v.quantity.nominal);
    EXPECT_GT(v.nominal, 0.0);
  }
  EXPECT_GT(types.size(), 10u);
}

TEST(VariableTable, HasTheNamesOfTheInterface) {
  const auto sim = make_sim();
  const auto rows = by_name(*sim);
  for (const char* name : {"chaser.position[1]",
                           "chaser.velocity[3]",
                           "chaser.attitude[4]",
                           "chaser.angular_velocity[2]",
                           "chaser.force_ext[1]",
                           "chaser.torque_ext[3]",
                           "chaser.mass",
                           "chaser.inertia[6]",
                           "chaser.interface_position[3]",
                           "chaser.interface_attitude[4]",
                           "chaser.force[3]",
                           "chaser.torque[3]",
                           "chaser.force_mean[3]",
                           "chaser.torque_mean[3]",
                           "chaser.mass_includes_mechanism",
                           "target.position[1]",
                           "gravity[3]",
                           "relative.position[3]",
                           "relative.attitude[4]",
                           "relative.velocity[3]",
                           "relative.angular_velocity[3]",
                           "relative.axial",
                           "relative.lateral",
                           "relative.pitch_yaw",
                           "relative.roll",
                           "gap",
                           "capture.force[3]",
                           "capture.torque[3]",
                           "capture.tension",
                           "capture.compression",
                           "capture.shear",
                           "capture.bending",
                           "capture.torsion",
                           "capture.load_ratio",
                           "capture.peak.tension",
                           "capture.peak.load_ratio",
                           "contact.depth_ratio",
                           "friction.coefficient",
                           "friction.model",
                           "restitution",
                           "restitution_speed",
                           "phase",
                           "captured",
                           "outcome",
                           "time_to_contact",
                           "time_of_contact",
                           "time_of_capture",
                           "chaser.contact_thrust",
                           "chaser.contact_thrust_delay",
                           "ring.position[3]",
                           "ring.attitude[4]",
                           "ring.velocity[3]",
                           "ring.angular_velocity[3]",
                           "base.force[3]",
                           "base.torque[3]",
                           "energy.kinetic",
                           "energy.potential",
                           "energy.dissipated",
                           "energy.dissipated_contact",
                           "energy.dissipated_friction",
                           "energy.dissipated_legs",
                           "energy.dissipated_latches",
                           "energy.external",
                           "energy.residual",
                           "momentum.residual",
                           "momentum.linear[3]",
                           "momentum.angular[3]",
                           "momentum.reference[3]",
                           "solver.steps",
                           "solver.rhs_evaluations",
                           "solver.rejected_steps",
                           "solver.closure_residual",
                           "solver.singularity_margin",
                           "accuracy",
                           "solver.chosen_method",
                           "solver.chosen_rtol",
                           "solver.chosen_step",
                           "solver.error_estimate",
                           "solver.method",
                           "solver.rtol",
                           "solver.atol_position",
                           "solver.atol_velocity",
                           "solver.atol_energy"}) {
    EXPECT_EQ(rows.count(name), 1u) << name;
  }
  // One row or vector per leg, latch, petal, loop and coordinate.
  const Outputs& out = sim->output_storage();
  const auto expect_count = [&](const std::string& name, const std::string& tail, size_t n) {
    for (size_t i = 1; i <= n + 1; ++i) {
      const std::string element = name + "[" + std::to_string(i) + "]" + tail;
      EXPECT_EQ(rows.count(element), i <= n ? 1u : 0u) << element;
    }
  };
  for (const char* tail : {".length", ".rate", ".force", ".force_command"}) {
    expect_count("leg", tail, out.leg_length.size());
  }
  for (const char* tail : {".opening", ".lateral", ".force", ".state"}) {
    expect_count("latch", tail, out.latch_opening.size());
  }
  expect_count("latched", "", out.latched.size());
  expect_count("contact.petal", ".force", out.petal_force.size());
  expect_count("loop", ".force[3]", out.loop_force.size());
  for (const char* name : {"state.q", "state.v", "state.a"}) {
    expect_count(name, "", out.state_q.size());
  }
}

TEST(VariableTable, MotionDecidesWhatAVehicleStateIs) {
  const auto causality = [](Motion motion) {
    return by_name(*make_sim({}, motion)).at("target.attitude[1]").causality;
  };
  EXPECT_EQ(causality(Motion::kFree), Causality::kOutput);
  EXPECT_EQ(causality(Motion::kFixed), Causality::kOutput);
  EXPECT_EQ(causality(Motion::kDriven), Causality::kInput);
  const auto free_sim = make_sim({}, Motion::kFree), fixed_sim = make_sim({}, Motion::kFixed);
  EXPECT_TRUE(by_name(*free_sim).at("target.attitude[1]").has_start());
  EXPECT_EQ(by_name(*free_sim).count("chaser.force_ext[1]"), 1u);
  EXPECT_EQ(by_name(*fixed_sim).count("chaser.force_ext[1]"), 0u);
  EXPECT_EQ(by_name(*fixed_sim).count("chaser.force[1]"), 1u);
}

TEST(VariableTable, OutputsOfNoGroupDoNotExist) {
  const auto sim = make_sim({});
  for (const Variable& v : make_variables(*sim)) {
    EXPECT_TRUE(has_prefix(v.name, "chaser.") || has_prefix(v.name, "target.") ||
                has_prefix(v.name, "gravity") || has_prefix(v.name, "model.") ||
                has_prefix(v.name, "solver.") || v.name == "accuracy" ||
                v.causality == Causality::kLocal || v.causality == Causality::kParameter)
        << v.name;
  }
  EXPECT_EQ(by_name(*sim).count("solver.steps"), 0u);
  for (const std::string& group : kAllGroups) {
    if (group == "legs" || group == "states") continue;  // the minimal scene may have none
    EXPECT_GT(by_name(*make_sim({group})).size(), by_name(*sim).size()) << group;
  }
}

TEST(VariableTable, WithoutATargetNothingSpeaksOfIt) {
  const auto sim = make_sim(kAllGroups, Motion::kFree, false);
  for (const Variable& v : make_variables(*sim)) {
    for (const char* prefix : {"target.", "relative.", "gap", "capture.", "contact.", "latch",
                               "phase", "outcome", "time_"}) {
      EXPECT_FALSE(has_prefix(v.name, prefix)) << v.name;
    }
  }
}

TEST(VariableTable, RowsPointAtTheStorageTheyName) {
  const auto sim = make_sim();
  const auto rows = by_name(*sim);
  VehicleParameters& target = sim->parameters().vehicle[kTarget];
  Outputs& out = sim->output_storage();
  EXPECT_EQ(rows.at("target.mass").start, &target.mass);
  EXPECT_EQ(rows.at("target.position[2]").start, &target.position[1]);
  EXPECT_EQ(rows.at("target.position[2]").value, &out.vehicle[kTarget].position[1]);
  EXPECT_EQ(rows.at("target.torque_ext[3]").start, &sim->inputs().vehicle[kTarget].torque_ext[2]);
  EXPECT_EQ(rows.at("chaser.torque_mean[1]").value, &out.vehicle[kChaser].torque_mean[0]);
  EXPECT_EQ(rows.at("capture.peak.bending").value, &out.capture_peak[Outputs::kBending].value);
  EXPECT_EQ(rows.at("solver.method").start, &sim->parameters().solver_method);
  EXPECT_EQ(rows.at("captured").value, static_cast<const void*>(&out.captured));
}

// ---------------------------------------------------------------- modelDescription.xml

struct Tag {
  std::string name;
  bool closes = false, is_empty = false;  ///< </name>, <name/>
  std::map<std::string, std::string> attributes;
};

/// The tags of a document that holds nothing but tags; stops at what it does not understand.
std::vector<Tag> tags(const std::string& xml) {
  std::vector<Tag> found;
  size_t at = xml.find("?>");
  while ((at = xml.find('<', at)) != std::string::npos) {
    Tag tag;
    tag.closes = xml[++at] == '/';
    if (tag.closes) ++at;
    size_t end = xml.find_first_of(" />", at);
    tag.name = xml.substr(at, end - at);
    for (at = end; xml[at] == ' '; at = end + 1) {
      const size_t equals = xml.find("=\"", at);
      end = xml.find('"', equals + 2);
      tag.attributes[xml.substr(at + 1, equals - at - 1)] =
          xml.substr(equals + 2, end - equals - 2);
    }
    tag.is_empty = xml[at] == '/';
    found.push_back(tag);
  }
  return found;
}

/// Attribute `name` of every element called `element`, where it is given, in order.
std::vector<std::string> attributes(const std::string& xml, const std::string& element,
                                    const std::string& name) {
  std::vector<std::string> found;
  for (const Tag& tag : tags(xml)) {
    const auto attribute = tag.attributes.find(name);
    if (tag.name == element && attribute != tag.attributes.end())
      found.push_back(attribute->second);
  }
  return found;
}

std::string section(const std::string& xml, const std::string& element) {
  const size_t begin = xml.find("<" + element + ">"), end = xml.find("</" + element + ">");
  return begin == std::string::npos ? "" : "?>" + xml.substr(begin, end - begin);
}

TEST(ModelDescription, EscapesMarkupAndControlCharacters) {
  EXPECT_EQ(xml_escape("a<b & \"c\" > 'd'\n\x01"),
            "a&lt;b &amp; &quot;c&quot; &gt; &apos;d&apos;  ");
  EXPECT_EQ(xml_escape("\xc3\xa9"), "\xc3\xa9") << "UTF-8 passes";
  Scene scene = minimal_scene();
  scene.title = "<loud> & \"odd\"";
  DockingSim sim(std::make_shared<const Scene>(scene));
  const std::string xml = make_model_description(sim, kTime);
  EXPECT_NE(xml.find("description=\"&lt;loud&gt; &amp; &quot;odd&quot;\""), std::string::npos);
}

TEST(ModelDescription, NumbersAreShortAndReadBackExactly) {
  EXPECT_EQ(shortest(0.1), "0.1");
  EXPECT_EQ(shortest(12000), "12000");
  for (const double x : {1.0 / 3.0, 7.1e6 + 1e-9, 5e-324, -1.7976931348623157e308}) {
    EXPECT_EQ(std::strtod(shortest(x).c_str(), nullptr), x);
  }
}

TEST(ModelDescription, TagsAreBalanced) {
  std::vector<std::string> open;
  for (const Tag& tag : tags(make_model_description(*make_sim(), kTime))) {
    if (tag.closes) {
      ASSERT_FALSE(open.empty());
      ASSERT_EQ(open.back(), tag.name);
      open.pop_back();
    } else if (!tag.is_empty) {
      open.push_back(tag.name);
    }
  }
  EXPECT_TRUE(open.empty());
}

TEST(ModelDescription, SectionsStandInTheOrderOfTheSchema) {
  const std::string xml = make_model_description(*make_sim(), kTime);
  size_t last = 0;
  for (const char* element :
       {"<fmiModelDescription", "<CoSimulation", "<UnitDefinitions", "<TypeDefinitions",
        "<LogCategories", "<DefaultExperiment", "<ModelVariables", "<ModelStructure", "<Outputs",
        "<InitialUnknowns"}) {
    const size_t at = xml.find(element);
    ASSERT_NE(at, std::string::npos) << element;
    EXPECT_GT(at, last) << element;
    last = at;
  }
  for (const char* name : {"startTime", "stopTime", "tolerance", "stepSize"}) {
    EXPECT_EQ(attributes(xml, "DefaultExperiment", name).size(), 1u) << name;
  }
  EXPECT_EQ(attributes(xml, "Category", "name").size(), kLogCategories.size());
}

TEST(ModelDescription, IdentifiesTheSceneAndIsReproducible) {
  const auto sim = make_sim();
  const std::string xml = make_model_description(*sim, kTime);
  const std::vector<std::string> name = {sim->scene().name},
                                 guid = {find_guid(sim->scene(), make_variables(*sim))};
  EXPECT_EQ(attributes(xml, "fmiModelDescription", "modelName"), name);
  EXPECT_EQ(attributes(xml, "CoSimulation", "modelIdentifier"), name);
  EXPECT_EQ(attributes(xml, "fmiModelDescription", "guid"), guid);
  EXPECT_EQ(xml, make_model_description(*make_sim(), kTime));
}

TEST(Guid, ChangesWithEveryChangeOfTheTable) {
  const auto sim = make_sim();
  const std::vector<Variable> rows = make_variables(*sim);
  const std::string now = find_guid(sim->scene(), rows);
  EXPECT_EQ(now.size(), 32u);
  EXPECT_EQ(now, find_guid(make_sim()->scene(), make_variables(*make_sim()))) << "of two instances";
  std::set<std::string> seen = {now};
  const auto expect_new = [&](const char* what, auto change) {
    std::vector<Variable> changed = rows;
    change(changed);
    EXPECT_TRUE(seen.insert(find_guid(sim->scene(), changed)).second) << what;
  };
  using Rows = std::vector<Variable>;
  expect_new("an output more", [](Rows& r) { r.insert(r.begin() + 40, r.back()); });
  expect_new("one less", [](Rows& r) { r.pop_back(); });
  expect_new("another order", [](Rows& r) { std::swap(r[3], r[4]); });
  expect_new("another name", [](Rows& r) { r[5].name = "chaser.place[1]"; });
  expect_new("another unit", [](Rows& r) { r[5].unit = "mm"; });
  expect_new("another type", [](Rows& r) { r[5].type = Type::kInteger; });
  expect_new("another causality", [](Rows& r) { r[5].causality = Causality::kLocal; });
  expect_new("another variability", [](Rows& r) { r[5].variability = Variability::kTunable; });
  expect_new("another meaning", [](Rows& r) { r[5].description += ", 3 locked"; });
  Scene other = sim->scene();
  other.fingerprint[7] = other.fingerprint[7] == '0' ? '1' : '0';
  EXPECT_TRUE(seen.insert(find_guid(other, rows)).second) << "another document";
}

TEST(ModelDescription, ListsFollowTheTable) {
  for (const Motion motion : {Motion::kFree, Motion::kDriven, Motion::kFixed}) {
    const auto sim = make_sim(kAllGroups, motion);
    const std::vector<Variable> rows = make_variables(*sim);
    const std::string xml = make_model_description(*sim, kTime);
    std::vector<std::string> names, references, outputs, unknowns;
    size_t starts = 0, initials = 0;
    for (size_t i = 0; i < rows.size(); ++i) {
      names.push_back(rows[i].name);
      references.push_back(std::to_string(i));
      if (rows[i].has_start()) ++starts;
      if (rows[i].causality != Causality::kInput) ++initials;
      if (rows[i].causality == Causality::kLocal) unknowns.push_back(std::to_string(i + 1));
      if (rows[i].causality != Causality::kOutput) continue;
      outputs.push_back(std::to_string(i + 1));
      if (!rows[i].has_start()) unknowns.push_back(std::to_string(i + 1));
    }
    EXPECT_EQ(attributes(xml, "ScalarVariable", "name"), names);
    EXPECT_EQ(attributes(xml, "ScalarVariable", "valueReference"), references);
    EXPECT_EQ(attributes(section(xml, "Outputs"), "Unknown", "index"), outputs);
    EXPECT_EQ(attributes(section(xml, "InitialUnknowns"), "Unknown", "index"), unknowns);
    // Start values where they are allowed and nowhere else; no `initial` on inputs.
    size_t written = 0;
    for (const char* type : {"Real", "Integer", "Boolean"}) {
      written += attributes(xml, type, "start").size();
    }
    EXPECT_EQ(written, starts);
    EXPECT_EQ(attributes(xml, "ScalarVariable", "initial").size(), initials);
  }
}

}  // namespace
}  // namespace dockloop
