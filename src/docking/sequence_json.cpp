// Reader of a sequence; see sequence_json.hpp.
#include "docking/sequence_json.hpp"

#include <algorithm>
#include <utility>

#include "docking/phases.hpp"

namespace dockloop {
namespace {

/// Quantities by name; with a count: `name[1]` to `name[count]`.
struct QuantityName {
  Measured quantity;
  const char* name;
  const char* member;  ///< after the index
  int count;           ///< 0: no index; below 0: see kCounted
};
constexpr int kPerLeg = -1, kPerLatch = -2, kPerSurface = -3;
constexpr const char* kCounted[][2] = {
    {"leg", "legs"}, {"latch", "latches"}, {"surface", "surfaces"}};
constexpr QuantityName kQuantities[] = {
    {Measured::kTime, "time", "", 0},
    {Measured::kGap, "gap", "", 0},
    {Measured::kRelativePosition, "relative.position", "", 3},
    {Measured::kRelativeVelocity, "relative.velocity", "", 3},
    {Measured::kRelativeAxial, "relative.axial", "", 0},
    {Measured::kRelativeLateral, "relative.lateral", "", 0},
    {Measured::kRelativePitchYaw, "relative.pitch_yaw", "", 0},
    {Measured::kRelativeRoll, "relative.roll", "", 0},
    {Measured::kRelativeSpeed, "relative.speed", "", 0},
    {Measured::kRelativeAngularSpeed, "relative.angular_speed", "", 0},
    {Measured::kCaptureAxial, "capture.axial", "", 0},
    {Measured::kCaptureAxialRate, "capture.axial_rate", "", 0},
    {Measured::kCaptureTension, "capture.tension", "", 0},
    {Measured::kCaptureCompression, "capture.compression", "", 0},
    {Measured::kCaptureShear, "capture.shear", "", 0},
    {Measured::kCaptureBending, "capture.bending", "", 0},
    {Measured::kCaptureTorsion, "capture.torsion", "", 0},
    {Measured::kRingPosition, "ring.position", "", 3},
    {Measured::kLegLength, "leg", ".length", kPerLeg},
    {Measured::kLegRate, "leg", ".rate", kPerLeg},
    {Measured::kLatchOpening, "latch", ".opening", kPerLatch},
    {Measured::kLatchForce, "latch", ".force", kPerLatch},
    {Measured::kSurfaceForce, "contact.surface", ".force", kPerSurface},
};
constexpr std::pair<Measured, const char*> kElementQuantities[] = {
    {Measured::kElementCoordinate, "coordinate"},
    {Measured::kElementRate, "rate"},
    {Measured::kElementForce, "force"},
    {Measured::kElementSaturation, "saturation"},
};

/// Does a name fit a pattern, where each * stands for any text?
bool fits_pattern(const std::string& name, const std::string& pattern, size_t n = 0, size_t p = 0) {
  if (p == pattern.size()) return n == name.size();
  if (pattern[p] == '*') {
    return fits_pattern(name, pattern, n, p + 1) ||
           (n < name.size() && fits_pattern(name, pattern, n + 1, p));
  }
  return n < name.size() && name[n] == pattern[p] && fits_pattern(name, pattern, n + 1, p + 1);
}

/// Names of choices in files have _ where people write a space or a hyphen.
std::string find_file_name(const Choice& choice) {
  std::string name = choice.name;
  std::replace_if(name.begin(), name.end(), [](char c) { return c == ' ' || c == '-'; }, '_');
  return name;
}

/// Number of a choice by its name in a file.
int read_choice_name(const JsonReader& item, const ChoiceList& list) {
  std::string known;
  for (const Choice& choice : list) {
    if (find_file_name(choice) == item.text()) return choice.number;
    known += (known.empty() ? "" : ", ") + find_file_name(choice);
  }
  item.fail("is '" + item.text() + "'; known names are " + known);
}

/// Position of the step that a text names. @param item  the text
int find_step(const JsonReader& item, const std::vector<std::string>& names) {
  const auto at = std::find(names.begin(), names.end(), item.text());
  if (at == names.end()) item.fail("is '" + item.text() + "'; no step has this name");
  return static_cast<int>(at - names.begin());
}

/// What the members of a sequence refer to.
struct Context {
  const JsonReader& mechanism;
  const MechanismModel& model;
  const LatchSet* latches;
  const ContactModel& contact;  ///< empty without a target
  const std::vector<std::string>& steps;
  const HardDock& hard_dock;  ///< empty without a target

  int find_element(const std::string& name) const {
    for (size_t i = 0; i < model.elements.size(); ++i) {
      if (model.elements[i].name == name) return static_cast<int>(i);
    }
    return -1;
  }
};

// ---------------------------------------------------------------- conditions

/// Reads "element.NAME.MEMBER". @return false if the name does not begin so
bool read_element_quantity(const JsonReader& item, const Context& context, Condition& condition) {
  const std::string name = item.text(), begin = "element.";
  if (name.rfind(begin, 0) != 0) return false;
  const size_t dot = name.rfind('.');
  const std::string element =
      dot > begin.size() ? name.substr(begin.size(), dot - begin.size()) : "";
  condition.index = context.find_element(element);
  if (condition.index < 0) {
    item.fail("is '" + name + "'; no force element has the name '" + element + "'");
  }
  std::string known;
  for (const auto& [quantity, member] : kElementQuantities) {
    if (name.substr(dot + 1) == member) {
      condition.quantity = quantity;
      return true;
    }
    known += (known.empty() ? "" : ", ") + std::string(member);
  }
  item.fail("is '" + name + "'; an element has " + known);
}

int find_count(const QuantityName& entry, const Context& context) {
  if (entry.count == kPerLeg) return static_cast<int>(context.model.legs.size());
  if (entry.count == kPerLatch) return context.latches ? context.latches->count() : kMaxLatches;
  if (entry.count == kPerSurface) {
    if (context.contact.empty()) return context.mechanism.has("contact") ? kMaxSurfaces : 0;
    return context.contact.rings ? 0 : static_cast<int>(context.contact.surfaces.size());
  }
  return entry.count;
}

/// Index in a name like "leg[3].length"; -1: it has not this form.
int find_index(const std::string& text, const QuantityName& entry) {
  const std::string begin = std::string(entry.name) + "[", end = std::string("]") + entry.member;
  if (text.size() <= begin.size() + end.size() || text.rfind(begin, 0) != 0) return -1;
  const std::string digits = text.substr(begin.size(), text.size() - begin.size() - end.size());
  constexpr size_t kMostDigits = 4;
  if (text.substr(begin.size() + digits.size()) != end || digits.size() > kMostDigits ||
      digits.find_first_not_of("0123456789") != std::string::npos) {
    return -1;
  }
  const int index = std::stoi(digits);
  return std::to_string(index) == digits ? index : -1;
}

/// "there are 2 latches"
std::string describe_count(const QuantityName& entry, const Context& context) {
  const int count = find_count(entry, context);
  const std::string number = std::to_string(count);
  if (entry.count > 0) return "its index is 1 to " + number;
  if (entry.count == kPerSurface && count == 0) {
    return "only surfaces of contact.type 'surfaces' have numbers";
  }
  const auto& [one, many] = kCounted[-entry.count - 1];
  if (entry.count != kPerLeg && !context.latches) {
    return "at most " + number + " " + many + " are possible";
  }
  return count == 1 ? std::string("there is 1 ") + one : "there are " + number + " " + many;
}

void read_quantity(const JsonReader& item, const Context& context, Condition& condition) {
  if (read_element_quantity(item, context, condition)) return;
  std::string known;
  for (const QuantityName& entry : kQuantities) {
    condition.quantity = entry.quantity;
    const std::string member = entry.member;
    if (entry.count == 0 && item.text() == entry.name) {
      if (entry.quantity != Measured::kGap || context.mechanism.has("contact")) return;
      item.fail("is 'gap', but the mechanism has no contact");
    }
    const int index = entry.count == 0 ? -1 : find_index(item.text(), entry);
    if (index >= 1 && index <= find_count(entry, context)) {
      condition.index = index - 1;
      return;
    }
    if (index >= 0) {
      item.fail("is '" + item.text() + "', but " + describe_count(entry, context));
    }
    known += std::string(entry.name) + (entry.count == 0 ? "" : "[i]") + member + ", ";
  }
  item.fail("is '" + item.text() + "'; known quantities are " + known +
            "element.NAME.coordinate, rate, force and saturation");
}

int read_latch_count(const JsonReader& item, const Context& context) {
  if (!context.mechanism.has("latches")) {
    item.fail("is " + item.shown() + ", but the mechanism has no latches");
  }
  return item.whole(1, context.latches ? std::max(1, context.latches->count()) : kMaxLatches);
}

Condition read_condition(const JsonReader& item, const Context& context) {
  Condition condition;
  int kinds = 0;
  for (const char* key : {"quantity", "latched", "latched_below", "hooks_closed", "command"}) {
    kinds += item.has(key) ? 1 : 0;
  }
  if (kinds != 1) {
    item.fail(
        "must have one of quantity, latched, latched_below, hooks_closed, command (all and any "
        "only once, outside); it has " +
        std::to_string(kinds));
  }
  if (item.has("latched")) {
    condition.kind = Condition::Kind::kLatched;
    condition.number = read_latch_count(item.at("latched"), context);
  } else if (item.has("latched_below")) {
    condition.kind = Condition::Kind::kLatchedBelow;
    condition.number = read_latch_count(item.at("latched_below"), context);
  } else if (item.has("hooks_closed")) {
    condition.kind = Condition::Kind::kHooksClosed;
    const int hooks = context.hard_dock.hooks.count();
    if (hooks == 0 && context.latches) {
      item.at("hooks_closed").fail("counts hooks, but the mechanism has no member interface.hooks");
    }
    condition.number = item.at("hooks_closed").whole(1, hooks > 0 ? hooks : kMaxHooks);
  } else if (item.has("command")) {
    condition.kind = Condition::Kind::kCommand;
    condition.number = read_choice_name(item.at("command"), kCommands);
  } else {
    read_quantity(item.at("quantity"), context, condition);
    const int bounds = item.has("above") + item.has("below") + item.has("between");
    if (bounds != 1) {
      item.fail("must have one of above, below, between; it has " + std::to_string(bounds));
    }
    if (item.has("above")) condition.low = item.at("above").number();
    if (item.has("below")) condition.high = item.at("below").number();
    if (item.has("between")) {
      const Eigen::Vector2d both = item.at("between").vector<2>();
      condition.low = both[0];
      condition.high = both[1];
      if (!(both[0] < both[1])) {
        item.at("between").fail("is " + describe_number(both[0]) + " and " +
                                describe_number(both[1]) +
                                "; it must be two numbers that increase");
      }
    }
  }
  return condition;
}

When read_when(const JsonReader& item, const Context& context) {
  When when;
  when.any = item.has("any");
  when.dwell = item.non_negative("for", 0.0);
  if (when.any && item.has("all")) item.fail("has both all and any; write a row for each");
  if (!when.any && !item.has("all")) {
    when.parts = {read_condition(item, context)};
    return when;
  }
  for (const JsonReader& part : item.list(when.any ? "any" : "all", kMaxParts)) {
    when.parts.push_back(read_condition(part, context));
  }
  if (when.parts.empty()) item.fail("has an empty list of conditions");
  return when;
}

// ---------------------------------------------------------------- actions

/// One of two words.
bool read_word(const JsonReader& item, const char* yes, const char* no) {
  if (item.text() != yes && item.text() != no) {
    item.fail("is '" + item.text() + "'; it must be " + yes + " or " + no);
  }
  return item.text() == yes;
}

/// Elements that an action names: f(element, its number).
/// @return the member that names them
template <class F>
JsonReader read_elements(const JsonReader& item, const Context& context, F&& f) {
  const bool is_one = item.has("element");
  if (is_one == item.has("elements")) item.fail("must have either element or elements");
  const JsonReader name = item.at(is_one ? "element" : "elements");
  int number = 0, count = 0;
  for (const ForceElement& element : context.model.elements) {
    if (is_one ? element.name == name.text() : fits_pattern(element.name, name.text())) {
      f(element, number);
      ++count;
    }
    ++number;
  }
  if (count == 0) name.fail("is '" + name.text() + "'; no force element has this name");
  return name;
}

/// Laws that an action switches: f(law, its number among all laws) for every law that it may.
/// @param types  types of laws that can be switched so
template <class F>
void read_laws(const JsonReader& item, const Context& context, std::vector<std::string> types,
               F&& f) {
  std::string wanted = types.front();
  for (size_t i = 1; i < types.size(); ++i) wanted += " or " + types[i];
  if (item.has("law")) {
    const std::string type = item.at("law").text();
    if (std::find(types.begin(), types.end(), type) == types.end()) {
      item.at("law").fail("is '" + type + "'; this action switches laws of type " + wanted);
    }
    types = {wanted = type};
  }
  const std::vector<ForceElement>& all = context.model.elements;
  int count = 0;
  const JsonReader name = read_elements(item, context, [&](const ForceElement& element, int e) {
    int number = count_laws({all.begin(), all.begin() + e});
    for (const ForceLaw& law : element.laws) {
      if (std::find(types.begin(), types.end(), describe_type(law)) != types.end()) {
        ++count;
        f(law, number);
      }
      ++number;
    }
  });
  if (count == 0) {
    name.fail("is '" + name.text() + "', which has no law of type " + wanted + " to switch");
  }
}

void read_action(const JsonReader& item, const Context&, ThrustAction& action) {
  action.on = read_word(item.at(ThrustAction::kKey), "on", "off");
}

void read_action(const JsonReader& item, const Context&, LatchesAction& action) {
  action.arm = read_word(item.at(LatchesAction::kKey), "arm", "release");
}

void read_action(const JsonReader& item, const Context& context, GraspAction& action) {
  if (context.mechanism.has("latches")) {
    item.fail(
        "states a grasp, but the mechanism has latches, which decide the capture; leave out "
        "one of both");
  }
  action.holds = read_word(item.at(GraspAction::kKey), "holds", "open");
}

void read_action(const JsonReader& item, const Context& context, RunAction& action) {
  const JsonReader run = item.at(RunAction::kKey);
  action.on = !run.node().is_string();
  if (!action.on && run.text() != "off") run.fail("must be off, or an object with a target");
  if (action.on) action.target = run.at("target").number();
  read_laws(item, context, {DriveLaw::kType}, [&](const ForceLaw& law, int number) {
    const DriveLaw& drive = std::get<DriveLaw>(law);
    if (drive.commanded) {
      item.fail("runs a drive that the host commands; leave out 'commanded' of the drive");
    }
    RunAction::Drive settings{number, drive.speed, drive.acceleration, drive.deceleration};
    if (action.on) {
      if (run.has("speed")) settings.speed = run.positive("speed");
      if (run.has("acceleration")) {
        settings.acceleration = settings.deceleration = run.positive("acceleration");
      }
      if (run.has("deceleration")) settings.deceleration = run.positive("deceleration");
    }
    action.drives.push_back(settings);
  });
}

void read_action(const JsonReader& item, const Context& context, EngagementAction& action) {
  const JsonReader engagement = item.at(EngagementAction::kKey);
  action.engagement = engagement.number();
  const std::string fault = find_fault(action.engagement, Rule::kShare);
  if (!fault.empty()) engagement.fail("is " + engagement.shown() + "; " + fault);
  read_laws(item, context, {BrakeLaw::kType, EddyLaw::kType},
            [&](const ForceLaw&, int number) { action.laws.push_back(number); });
}

void read_action(const JsonReader& item, const Context& context, LockAction& action) {
  const bool locks = read_word(item.at(LockAction::kKey), "on", "off");
  for (const char* number : {"stiffness", "damping"}) {
    if (!locks && item.has(number)) item.at(number).fail("has no effect with 'lock': 'off'");
  }
  if (locks) {
    constexpr double kRelaxation = 1e-3;  // damping over stiffness, if none is stated [s]
    ElementLock& lock = action.lock;
    lock.stiffness = item.has("stiffness") ? item.positive("stiffness") : kLockStiffness;
    lock.damping = item.non_negative("damping", kRelaxation * lock.stiffness);
  }
  read_elements(item, context,
                [&](const ForceElement&, int element) { action.elements.push_back(element); });
}

/// Refuses an action without its hardware.
void require_part(const JsonReader& item, const Context& context, bool is_there,
                  const std::string& part) {
  if (is_there || !context.latches) return;  // without a target there is no hardware at all
  item.fail("acts on the hard dock, but the mechanism has no member interface" + part);
}

void read_action(const JsonReader& item, const Context& context, HooksAction& action) {
  require_part(item, context, !context.hard_dock.hooks.rows.empty(), ".hooks");
  action.close = read_word(item.at(HooksAction::kKey), "close", "open");
}

void read_action(const JsonReader& item, const Context& context, PushersAction& action) {
  require_part(item, context, context.hard_dock.pusher_count() > 0, ".pushers");
  action.on = read_word(item.at(PushersAction::kKey), "on", "off");
}

void read_action(const JsonReader& item, const Context& context, JointAction& action) {
  require_part(item, context, !context.hard_dock.empty(), "");
  const JsonReader joint = item.at(JointAction::kKey);
  action.rigid = joint.text() == "rigid";
  if (!action.rigid && joint.text() != "elastic" && joint.text() != "open") {
    joint.fail("is '" + joint.text() + "'; it must be rigid, elastic or open");
  }
}

/// Refuses a member that an action does not use.
template <class Each>
void require_members(const JsonReader& item) {
  for (const auto& member : item.node().items()) {
    const std::string& key = member.key();
    const auto is_key = [&](const char* known) { return key == known; };
    if (key == Each::kKey || key == "comment") continue;
    if (std::any_of(Each::kMembers.begin(), Each::kMembers.end(), is_key)) continue;
    item.fail("has the member '" + key + "', which the action '" + Each::kKey +
              "' does not use; leave it out");
  }
}

/// Reads the alternative of Action whose key the item has.
template <size_t i = 0>
Action read_keyed(const JsonReader& item, const Context& context, const std::string& known = "") {
  if constexpr (i < std::variant_size_v<Action>) {
    using Each = std::variant_alternative_t<i, Action>;
    if (!item.has(Each::kKey)) {
      return read_keyed<i + 1>(item, context, known + (i > 0 ? ", " : "") + Each::kKey);
    }
    require_members<Each>(item);
    Each action;
    read_action(item, context, action);
    return action;
  } else {
    item.fail("is no action; an action has one of " + known);
  }
}

/// Refuses an item with the keys of several actions: only the first would act.
template <size_t... i>
void require_one_action(const JsonReader& item, std::index_sequence<i...>) {
  std::string keys;
  int count = 0;
  const auto add = [&](const std::string& key) {
    if (item.has(key)) keys += (count++ > 0 ? " and " : "") + key;
  };
  (add(std::variant_alternative_t<i, Action>::kKey), ...);
  if (count > 1) item.fail("has the actions " + keys + "; give each one an item of its own");
}

// ---------------------------------------------------------------- steps

SequenceBranch read_branch(const JsonReader& item, const Context& context) {
  SequenceBranch branch;
  if (item.has("go")) branch.go = find_step(item.at("go"), context.steps);
  if (item.has("outcome")) branch.outcome = read_choice_name(item.at("outcome"), kOutcomes);
  return branch;
}

SequenceStep read_step(const JsonReader& item, const Context& context) {
  SequenceStep step;
  step.name = item.at("name").text();
  step.phase = item.at("phase").whole(kPhases.front().number, kPhases.back().number);
  if (item.has("outcome")) step.outcome = read_choice_name(item.at("outcome"), kOutcomes);
  for (const JsonReader& action : item.list("do", kMaxActions)) {
    require_one_action(action, std::make_index_sequence<std::variant_size_v<Action>>());
    step.actions.push_back(read_keyed(action, context));
  }
  for (const JsonReader& row : item.list("next", kMaxRows)) {
    row.at("go");
    step.next.push_back({read_branch(row, context), read_when(row.at("when"), context)});
  }
  if (item.has("timeout")) step.timeout = item.positive("timeout");
  step.on_timeout.outcome = kTimedOut;
  if (item.has("on_timeout")) {
    if (!item.has("timeout")) item.fail("has on_timeout, but no timeout");
    step.on_timeout = read_branch(item.at("on_timeout"), context);
  }
  return step;
}

/// Refuses a step that nothing leads to. @param item  the member `sequence`
void check_reached(const JsonReader& item, const Sequence& sequence) {
  std::vector<bool> is_reached(sequence.steps.size());
  std::vector<int> open = {sequence.start};
  while (!open.empty()) {
    const int at = open.back();
    open.pop_back();
    if (at < 0 || is_reached[static_cast<size_t>(at)]) continue;
    is_reached[static_cast<size_t>(at)] = true;
    const SequenceStep& step = sequence.steps[static_cast<size_t>(at)];
    for (const SequenceRow& row : step.next) open.push_back(row.go);
    if (step.timeout > 0.0) open.push_back(step.on_timeout.go);
  }
  for (size_t i = 0; i < is_reached.size(); ++i) {
    if (is_reached[i]) continue;
    const std::string& first = sequence.steps[static_cast<size_t>(sequence.start)].name;
    item.at("steps").items(kMaxSteps)[i].fail("('" + sequence.steps[i].name +
                                              "') cannot be reached from the first step '" + first +
                                              "': add a row that leads to it, or leave it out");
  }
}

}  // namespace

Sequence read_sequence(const JsonReader& mechanism, const MechanismModel& model,
                       const LatchSet* latches, const ContactModel& contact,
                       const HardDock& hard_dock) {
  Sequence sequence;
  if (!mechanism.has("sequence")) return sequence;
  const JsonReader item = mechanism.at("sequence");
  const std::vector<JsonReader> steps = item.at("steps").items(kMaxSteps);
  std::vector<std::string> names;
  for (const JsonReader& step : steps) {
    const std::string name = step.at("name").text();
    if (std::count(names.begin(), names.end(), name)) {
      step.at("name").fail("'" + name + "' is used twice");
    }
    names.push_back(name);
  }
  if (names.empty()) item.at("steps").fail("is empty; a sequence needs a step");
  const Context context{mechanism, model, latches, contact, names, hard_dock};
  for (const JsonReader& step : steps) sequence.steps.push_back(read_step(step, context));
  if (item.has("start")) sequence.start = find_step(item.at("start"), names);
  check_reached(item, sequence);
  if (item.has("stop_after")) {
    SequenceStep& last =
        sequence.steps[static_cast<size_t>(find_step(item.at("stop_after"), names))];
    last.next.clear();
    last.timeout = 0.0;
  }
  return sequence;
}

void find_step(const JsonReader& item, const Sequence& sequence, Onset& onset) {
  if (onset.step_name.empty()) return;
  const JsonReader name = item.at("at");
  if (sequence.empty()) name.fail("names a step, but the mechanism has no sequence; give the time");
  std::vector<std::string> names;
  for (const SequenceStep& step : sequence.steps) names.push_back(step.name);
  onset.step = find_step(name, names);
}

}  // namespace dockloop
