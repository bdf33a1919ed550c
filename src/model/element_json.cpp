// Reader of force elements; see element_json.hpp.
#include "model/element_json.hpp"

namespace dockloop {
namespace {

constexpr size_t kMaxLaws = 16, kMaxTerms = 100, kMaxTableRows = 100;  ///< of one element or law
constexpr size_t kMaxMeasuredRows = 10000, kMaxRates = 100;

std::vector<TableRow> read_table(const JsonReader& item, const char* key) {
  std::vector<TableRow> rows;
  for (const JsonReader& row : item.list(key, kMaxTableRows)) {
    const Eigen::Vector2d pair = row.vector<2>();
    rows.push_back({pair[0], pair[1]});
  }
  return rows;
}

void read_rest(const JsonReader& item, SpringLaw& law) {
  item.at("stages");
  law.stages = read_table(item, "stages");
  const std::string side = item.text("side", "both");
  if (side != "both" && side != "positive" && side != "negative") {
    item.at("side").fail("is '" + side + "'; it must be both, positive or negative");
  }
  law.side = side == "both" ? 0 : side == "positive" ? 1 : -1;
}

void read_rest(const JsonReader& item, DamperLaw& law) {
  law.orifice = read_table(item, "orifice");
  if (!item.has("linear_back")) law.linear_back = law.linear;
  if (!item.has("quadratic_back")) law.quadratic_back = law.quadratic;
}

void read_rest(const JsonReader& item, BrakeLaw& law) {
  law.model = item.whole("model", law.model, 1, 2);
  if (!item.has("back")) law.back = law.forward;
  if (item.has("presliding") && item.has("bristle_stiffness")) {
    item.fail("has both presliding and bristle_stiffness; one follows from the other");
  }
}

void read_rest(const JsonReader& item, MotorLaw& law) {
  law.by_current = item.has("current");
  law.commanded = item.flag("commanded", false);
  if (law.by_current && item.has("voltage")) {
    item.fail("has both voltage and current; a motor is driven by one of them");
  }
}

void read_rest(const JsonReader& item, DriveLaw& law) {
  law.commanded = item.flag("commanded", false);
  if (!item.has("deceleration")) law.deceleration = law.acceleration;
}

std::vector<double> read_numbers(const JsonReader& list, size_t most) {
  std::vector<double> numbers;
  for (const JsonReader& item : list.items(most)) numbers.push_back(item.number());
  return numbers;
}

Outside read_outside(const JsonReader& item, const char* key) {
  const std::string text = item.text(key, "refuse");
  if (text != "refuse" && text != "hold" && text != "extend") {
    item.at(key).fail("is '" + text + "'; it must be refuse, hold or extend");
  }
  return text == "refuse" ? Outside::kRefuse : text == "hold" ? Outside::kHold : Outside::kExtend;
}

void read_rest(const JsonReader& item, TableLaw& law) {
  law.outside = read_outside(item, "outside");
  law.outside_rate = read_outside(item, "outside_rate");
  law.travel = read_numbers(item.at("travel"), kMaxMeasuredRows);
  const JsonReader force = item.at("force");
  if (!item.has("rates")) {
    law.force = {read_numbers(force, kMaxMeasuredRows)};
    return;
  }
  law.rates = read_numbers(item.at("rates"), kMaxRates);
  for (const JsonReader& list : force.items(kMaxRates)) {
    law.force.push_back(read_numbers(list, kMaxMeasuredRows));
  }
}

template <class Law>
void read_rest(const JsonReader&, Law&) {}

template <class Law>
Law read_as(const JsonReader& item) {
  Law law;
  for_each_member(law, [&](const char* name, double& number, Rule, bool required, const char*) {
    if (required || item.has(name)) number = item.at(name).number();
  });
  read_rest(item, law);
  return law;
}

/// Reads the alternative of ForceLaw whose type has this name.
template <size_t i = 0>
ForceLaw read_type(const JsonReader& item, const std::string& type, const std::string& known = "") {
  if constexpr (i < std::variant_size_v<ForceLaw>) {
    using Law = std::variant_alternative_t<i, ForceLaw>;
    if (type == Law::kType) return read_as<Law>(item);
    return read_type<i + 1>(item, type, known + (i > 0 ? ", " : "") + Law::kType);
  } else {
    item.at("type").fail("is '" + type + "'; known laws are " + known);
  }
}

ElementTerm read_term(const JsonReader& item, const MechanismModel& model,
                      const ForceElement& element) {
  const JsonReader joint = item.at("joint");
  const int body =
      find_body(model, joint.text(), "element '" + element.name + "' (" + joint.path() + ")");
  if (body == kBase || model.bodies[body].joint == JointType::kFree) {
    joint.fail("(element '" + element.name + "') must name a revolute or prismatic joint");
  }
  for (const ElementTerm& other : element.along) {
    if (other.body == body) joint.fail("(element '" + element.name + "') is used twice");
  }
  const double ratio = item.number("ratio", 1.0);
  if (ratio == 0.0) item.at("ratio").fail("(element '" + element.name + "') must not be 0");
  return {body, ratio};
}

}  // namespace

ForceElement read_element(const JsonReader& item, const MechanismModel& model) {
  ForceElement element;
  element.name = item.at("name").text();
  for (const ForceElement& other : model.elements) {
    if (other.name == element.name) item.at("name").fail("'" + element.name + "' is used twice");
  }
  item.at("along"), item.at("laws");  // a missing member has its own message
  for (const JsonReader& term : item.list("along", kMaxTerms)) {
    element.along.push_back(read_term(term, model, element));
  }
  int commanded = 0;
  for (const JsonReader& law : item.list("laws", kMaxLaws)) {
    element.laws.push_back(read_type(law, law.at("type").text()));
    const std::string fault = find_fault(element.laws.back());
    if (!fault.empty()) {
      law.fail(std::string("(") + describe_type(element.laws.back()) + " of element '" +
               element.name + "'): " + fault);
    }
    if (TableLaw* table = std::get_if<TableLaw>(&element.laws.back())) table->interpolate();
    commanded += is_commanded(element.laws.back()) ? 1 : 0;
  }
  if (element.along.empty()) item.at("along").fail("is empty; an element needs a joint");
  if (element.laws.empty()) item.at("laws").fail("is empty; an element needs a law");
  if (commanded > 1) {
    item.at("laws").fail("has " + std::to_string(commanded) +
                         " commanded laws; an element has one command");
  }
  return element;
}

/// Refuses a delay without effect, or a second one. @param kind  the member of the failure
void check_delay(const JsonReader& kind, const LawFailure& failure, const MechanismModel& model) {
  const ForceElement& element = model.elements[static_cast<size_t>(failure.element)];
  const ForceLaw& law = element.laws[static_cast<size_t>(failure.law)];
  const std::string what = "is 'delayed', but law " + std::to_string(failure.law + 1) + " (" +
                           describe_type(law) + ") of element '" + element.name + "' ";
  if (!takes_settings(law)) {
    kind.fail(what + "takes no command; only a motor, drive, brake or eddy brake does");
  }
  if (is_commanded(law)) {
    kind.fail(what + "has its command from the host; delay the input of the host, or leave out " +
              "'commanded' of the law");
  }
  for (const LawFailure& other : model.failures) {
    if (other.kind == failure.kind && other.number == failure.number) {
      kind.fail(what + "is delayed already; give one failure with the sum of the delays");
    }
  }
}

Onset read_onset(const JsonReader& item) {
  return {item.non_negative("time", 0.0), item.text("at", ""), -1};
}

LawFailure read_failure(const JsonReader& item, const MechanismModel& model) {
  using Kind = LawFailure::Kind;
  LawFailure failure;
  const std::string name = item.at("element").text();
  const int count = static_cast<int>(model.elements.size());
  while (failure.element < count &&
         model.elements[static_cast<size_t>(failure.element)].name != name) {
    ++failure.element;
  }
  if (failure.element == count) {
    item.at("element").fail("is '" + name + "'; no force element has this name");
  }
  const ForceElement& element = model.elements[static_cast<size_t>(failure.element)];
  const std::string kind = item.at("kind").text();
  if (kind != "off" && kind != "factor" && kind != "jammed" && kind != "delayed") {
    item.at("kind").fail("is '" + kind + "'; known kinds are off, factor, jammed, delayed");
  }
  failure.kind = kind == "off"      ? Kind::kOff
                 : kind == "factor" ? Kind::kFactor
                 : kind == "jammed" ? Kind::kJammed
                                    : Kind::kDelayed;
  const auto first = model.elements.begin();
  failure.number = count_laws({first, first + failure.element});
  if (failure.kind != Kind::kJammed) {
    failure.law = item.at("law").whole(1, static_cast<int>(element.laws.size())) - 1;
    failure.number += failure.law;
  } else if (item.has("law")) {
    item.at("law").fail("has no effect: 'jammed' holds the whole element; leave it out");
  }
  if (failure.kind == Kind::kDelayed) check_delay(item.at("kind"), failure, model);
  failure.onset = read_onset(item);
  if (failure.kind == Kind::kFactor || failure.kind == Kind::kDelayed) item.at("value");
  failure.value = item.non_negative("value", failure.kind == Kind::kJammed ? kLockStiffness : 0.0);
  if (failure.kind == Kind::kJammed && failure.value == 0.0) {
    item.at("value").fail("is 0; the stiffness of the lock of a jammed element must be above 0");
  }
  failure.active = item.flag("active", true);
  return failure;
}

}  // namespace dockloop
