// Fuzz target: bytes -> calls of the FMI functions on one to three instances, right and wrong ones.
//
// The first bytes choose how much is watched and the scene; then every byte is an operation of the
// table at the end, and the bytes after it its arguments. After every call the promises of the
// interface are checked: a status the function may return; finite values; nothing changed by a call
// that was refused; time that goes on; a restored state that is the saved one bit for bit; other
// instances untouched. What breaks one of them aborts, and is a finding.
#include <fmi2Functions.h>

#include <cmath>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "abort_with.hpp"
#include "byte_source.hpp"
#include "interface/variables.hpp"
#include "sim/docking_sim.hpp"

namespace {

using namespace dockloop;
using nlohmann::json;

constexpr size_t kMaxInstances = 3;
constexpr int kMaxCalls = 80;              ///< per input
constexpr double kSimulatedTime = 0.06;    ///< [s] per input, of a cheap scene
constexpr size_t kMaxSavedStates = 4;      ///< per instance
constexpr size_t kLargestState = 1 << 20;  ///< bytes of a serialised state that are taken

// ---------------------------------------------------------------- scenes and their variables

/// A scene in a folder of its own, as an importer unpacks it, and the rows of its FMU.
struct SceneFolder {
  std::string uri, guid;
  std::vector<Variable> rows;  ///< their pointers belong to `sim`
  std::vector<fmi2ValueReference> reals_set, reals_computed, integers_set, integers_computed,
      booleans;
  size_t states = 0, indicators = 0;  ///< of model exchange
  double time_scale = 1.0;            ///< of steps: less for a scene that costs more
  std::unique_ptr<DockingSim> sim;
};

json read_stored(const std::string& name) {
  std::ifstream file(std::string(DOCKLOOP_TEST_DATA) + "/" + name);
  if (!file) abort_with("start", "cannot read " + name);
  return json::parse(file);
}
class Scenes {
 public:
  Scenes() {
    std::string pattern = (std::filesystem::temp_directory_path() / "dockloop-XXXXXX").string();
    if (!mkdtemp(pattern.data())) abort_with("start", "cannot make a temporary folder");
    root_ = pattern;
    const json minimal = read_stored("scene_minimal.json");
    add(minimal);
    json driven = minimal;
    driven["target"]["motion"] = "driven";
    driven["target"]["position"][0] = 19.0005;
    add(driven);
    // The default docking, 1 ms before the first contact.
    json ring = read_stored("scene_ring.json");
    for (int i = 0; i < 3; ++i) {
      const double x = ring["chaser"]["position"][i], v = ring["chaser"]["velocity"][i];
      ring["chaser"]["position"][i] = x + 1.999 * v;
    }
    ring["outputs"]["groups"] = {"relative", "capture", "contact", "phase",  "ring",
                                 "legs",     "states",  "loops",   "energy", "solver"};
    add(ring);
    scenes_.back().time_scale = 0.1;
  }
  ~Scenes() { std::filesystem::remove_all(root_); }
  Scenes(const Scenes&) = delete;
  Scenes& operator=(const Scenes&) = delete;
  const SceneFolder& operator[](size_t i) const { return scenes_[i]; }
  size_t size() const { return scenes_.size(); }

 private:
  void add(const json& document) {
    SceneFolder& made = scenes_.emplace_back();
    const std::string folder = root_ + "/" + std::to_string(scenes_.size());
    std::filesystem::create_directories(folder);
    const std::string text = document.dump();
    std::ofstream(folder + "/model.json") << text;
    made.uri = "file://" + folder;
    auto scene = std::make_shared<const Scene>(read_scene(text, "model.json"));
    made.sim = std::make_unique<DockingSim>(std::move(scene));
    made.rows = make_variables(*made.sim);
    made.guid = find_guid(made.sim->scene(), made.rows);
    for (size_t i = 0; i < made.rows.size(); ++i) {
      const Variable& v = made.rows[i];
      auto& list = v.type == Type::kBoolean ? made.booleans
                   : v.type == Type::kReal  ? (v.has_start() ? made.reals_set : made.reals_computed)
                   : v.has_start()          ? made.integers_set
                                            : made.integers_computed;
      list.push_back(static_cast<fmi2ValueReference>(i));
    }
    if (offers_model_exchange(made.sim->scene())) {
      made.states = static_cast<size_t>(made.sim->state_count());
      made.indicators = static_cast<size_t>(made.sim->indicator_count());
    }
  }

  std::string root_;
  std::vector<SceneFolder> scenes_;
};

const Scenes& scenes() {
  static const Scenes all;
  return all;
}

// ---------------------------------------------------------------- instances as the host sees them

/// All values that can be read, with the status of each group, comparable bit for bit.
using Snapshot = std::vector<std::uint64_t>;

struct SavedState {
  fmi2FMUstate state = nullptr;
  Snapshot values;
  double time = 0.0;
};

struct Slot {
  fmi2Component c = nullptr;
  size_t scene = 0;
  double time = 0.0;
  bool watched = true;  ///< values are read before and after every call
  Snapshot fresh;       ///< values right after fmi2Instantiate
  std::vector<SavedState> saved;
};

struct Host {
  ByteSource in;
  std::vector<Slot> slots{kMaxInstances};
  size_t active = 0;
  bool watches = true;
  double budget = kSimulatedTime;
  Slot& slot() { return slots[active]; }
  const SceneFolder& scene() { return scenes()[slot().scene]; }
};

/// What most hosts do: hand the message to printf with whatever arguments follow.
void log_line(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String message,
              ...) {
  char text[1000];
  va_list arguments;
  va_start(arguments, message);
  std::vsnprintf(text, sizeof text, message, arguments);
  va_end(arguments);
}

const fmi2CallbackFunctions kCallbacks{log_line, std::calloc, std::free, nullptr, nullptr};
const fmi2CallbackFunctions kSilent{nullptr, nullptr, nullptr, nullptr, nullptr};

/// fmi2Fatal and fmi2Pending are never promised.
bool is_done(fmi2Status status, const char* call) {
  if (status < fmi2OK || status > fmi2Error) {
    abort_with(call, "returned the status " + std::to_string(status));
  }
  return status == fmi2OK || status == fmi2Warning;
}

void check_finite(const std::vector<double>& values, const char* call) {
  for (size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      abort_with(call, "element " + std::to_string(i) + " is not finite");
    }
  }
}

void append(Snapshot& to, double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  to.push_back(bits);
}

Snapshot look(const Slot& slot) {
  Snapshot all;
  if (!slot.c || !slot.watched) return all;
  const SceneFolder& scene = scenes()[slot.scene];
  for (const auto* list : {&scene.reals_set, &scene.reals_computed}) {
    std::vector<double> values(list->size(), 0.0);
    const bool done =
        is_done(fmi2GetReal(slot.c, list->data(), list->size(), values.data()), "fmi2GetReal");
    all.push_back(done);
    for (size_t i = 0; done && i < values.size(); ++i) {
      if (!std::isfinite(values[i])) {
        abort_with("fmi2GetReal", "'" + scene.rows[(*list)[i]].name + "' is not finite");
      }
      append(all, values[i]);
    }
  }
  for (const auto* list : {&scene.integers_set, &scene.integers_computed}) {
    std::vector<int> values(list->size(), 0);
    const bool done = is_done(fmi2GetInteger(slot.c, list->data(), list->size(), values.data()),
                              "fmi2GetInteger");
    all.push_back(done);
    for (size_t i = 0; done && i < values.size(); ++i) all.push_back(values[i]);
  }
  std::vector<int> values(scene.booleans.size(), 0);
  const bool done =
      is_done(fmi2GetBoolean(slot.c, scene.booleans.data(), values.size(), values.data()),
              "fmi2GetBoolean");
  all.push_back(done);
  for (size_t i = 0; done && i < values.size(); ++i) {
    if (values[i] != 0 && values[i] != 1) abort_with("fmi2GetBoolean", "neither true nor false");
    all.push_back(values[i]);
  }
  return all;
}

void check_same(const Slot& slot, const Snapshot& before, const char* call, const char* promise) {
  if (look(slot) != before) abort_with(call, promise);
}

/// Runs `call`; when it is refused, all values must be what they were.
template <class F>
bool unchanged_if_refused(Host& host, const char* name, F&& call) {
  const Snapshot before = look(host.slot());
  const bool done = is_done(call(), name);
  if (!done) check_same(host.slot(), before, name, "was refused, but has changed a value");
  return done;
}

// ---------------------------------------------------------------- life of an instance

void free_states(Slot& slot) {
  for (SavedState& saved : slot.saved) {
    if (!is_done(fmi2FreeFMUstate(slot.c, &saved.state), "fmi2FreeFMUstate") || saved.state) {
      abort_with("fmi2FreeFMUstate", "did not free a state");
    }
  }
  slot.saved.clear();
}

void free_instance(Host& host) {
  Slot& slot = host.slot();
  if (slot.c) free_states(slot);
  fmi2FreeInstance(slot.c);
  slot = Slot();
}

/// In model exchange every function of co-simulation is refused, and the other way round.
fmi2Type pick_type(ByteSource& in) {
  return in.pick(8) == 7 ? fmi2ModelExchange : fmi2CoSimulation;
}

void instantiate(Host& host) {
  free_instance(host);
  Slot& slot = host.slot();
  slot.watched = host.watches;
  slot.scene = host.in.pick(scenes().size());
  const SceneFolder& scene = scenes()[slot.scene];
  const fmi2Type type = pick_type(host.in);
  slot.c = fmi2Instantiate("fuzz", type, scene.guid.c_str(), scene.uri.c_str(), &kCallbacks,
                           fmi2False, host.in.flag());
  if (!slot.c && type == fmi2CoSimulation) abort_with("fmi2Instantiate", "has failed");
  slot.time = scene.sim->scene().experiment.start;
  slot.fresh = look(slot);
}

void instantiate_wrongly(Host& host) {
  const SceneFolder& scene = scenes()[0];
  std::string location = scene.uri, guid = scene.guid;
  const char* name = "fuzz";
  const char *used_guid = guid.c_str(), *used_location = nullptr;
  const fmi2CallbackFunctions* callbacks = &kCallbacks;
  const size_t wrong = host.in.pick(7);
  if (wrong == 0) name = nullptr;
  if (wrong == 1) name = "";
  if (wrong == 2) used_guid = nullptr;
  if (wrong == 3) guid += "x";
  if (wrong == 4) location.clear();
  if (wrong == 5) callbacks = host.in.flag() ? &kSilent : nullptr;
  if (wrong == 6) {
    static const char* const kStarts[] = {"",         "file:",   "file://",
                                          "file:///", "http://", "file://C:"};
    location = kStarts[host.in.pick(6)];
    for (size_t n = host.in.pick(40); n > 0; --n) location += static_cast<char>(host.in.byte());
  }
  if (wrong == 3) used_guid = guid.c_str();
  if (wrong != 4 || host.in.flag()) used_location = location.c_str();
  fmi2Component c = fmi2Instantiate(name, fmi2CoSimulation, used_guid, used_location, callbacks,
                                    fmi2False, host.in.flag());
  if (c && wrong < 5) abort_with("fmi2Instantiate", "has accepted a wrong argument");
  fmi2FreeInstance(c);
}

void set_up(Host& host) {
  const fmi2Boolean tolerance_defined = host.in.flag(), stop_defined = host.in.flag();
  const double tolerance = host.in.number(), start = host.in.number(), stop = host.in.number();
  if (unchanged_if_refused(host, "fmi2SetupExperiment", [&] {
        return fmi2SetupExperiment(host.slot().c, tolerance_defined, tolerance, start, stop_defined,
                                   stop);
      })) {
    if (!std::isfinite(start)) abort_with("fmi2SetupExperiment", "has accepted the start time");
    host.slot().time = start;
  }
}

void enter_initialization(Host& host) {
  unchanged_if_refused(host, "fmi2EnterInitializationMode",
                       [&] { return fmi2EnterInitializationMode(host.slot().c); });
}

void exit_initialization(Host& host) {
  if (unchanged_if_refused(host, "fmi2ExitInitializationMode",
                           [&] { return fmi2ExitInitializationMode(host.slot().c); })) {
    look(host.slot());
  }
}

void start(Host& host) {
  enter_initialization(host);
  exit_initialization(host);
}

void terminate(Host& host) {
  const Snapshot before = look(host.slot());
  is_done(fmi2Terminate(host.slot().c), "fmi2Terminate");
  check_same(host.slot(), before, "fmi2Terminate", "has changed a value");
}

void reset(Host& host) {
  Slot& slot = host.slot();
  if (!is_done(fmi2Reset(slot.c), "fmi2Reset")) abort_with("fmi2Reset", "was refused");
  slot.time = host.scene().sim->scene().experiment.start;
  check_same(slot, slot.fresh, "fmi2Reset", "has not restored the values of a new instance");
}

void set_logging(Host& host) {
  static const char* const kCategories[] = {"logEvents",
                                            "logStatusWarning",
                                            "logStatusDiscard",
                                            "logStatusError",
                                            "no such category",
                                            "%s%n",
                                            ""};
  fmi2String categories[3];
  const size_t n = host.in.pick(4);
  for (size_t i = 0; i < n; ++i) categories[i] = kCategories[host.in.pick(7)];
  const bool null = host.in.pick(8) == 7;
  is_done(fmi2SetDebugLogging(host.slot().c, host.in.flag(), n, null ? nullptr : categories),
          "fmi2SetDebugLogging");
}

// ---------------------------------------------------------------- get and set

/// References from a list, or any.
std::vector<fmi2ValueReference> pick_references(Host& host,
                                                const std::vector<fmi2ValueReference>& list) {
  std::vector<fmi2ValueReference> references(host.in.pick(6));
  for (fmi2ValueReference& reference : references) {
    const size_t kind = host.in.pick(16);
    const size_t index = 256 * host.in.pick(8) + host.in.byte();
    if (kind < 14 && !list.empty()) {
      reference = list[index % list.size()];
    } else if (kind == 14) {
      reference = static_cast<fmi2ValueReference>(index % (host.scene().rows.size() + 1));
    } else {
      reference = static_cast<fmi2ValueReference>(-1);
    }
  }
  return references;
}

bool appears_after(const std::vector<fmi2ValueReference>& references, size_t i) {
  for (size_t j = i + 1; j < references.size(); ++j) {
    if (references[j] == references[i]) return true;
  }
  return false;
}

void set_reals(Host& host) {
  const auto references = pick_references(host, host.scene().reals_set);
  std::vector<double> values(references.size()), back(references.size());
  is_done(fmi2GetReal(host.slot().c, references.data(), references.size(), values.data()),
          "fmi2GetReal");
  for (double& value : values) {
    const size_t kind = host.in.pick(4);
    if (kind == 0) value *= 1.0 + 1e-3 * (static_cast<int>(host.in.byte()) - 128);
    if (kind == 1) value = -value;
    if (kind >= 2) value = host.in.number();
  }
  const bool null = host.in.pick(16) == 15;
  if (!unchanged_if_refused(host, "fmi2SetReal", [&] {
        return fmi2SetReal(host.slot().c, references.data(), references.size(),
                           null ? nullptr : values.data());
      })) {
    return;
  }
  if (null && !values.empty()) abort_with("fmi2SetReal", "has accepted a null pointer");
  if (!is_done(fmi2GetReal(host.slot().c, references.data(), references.size(), back.data()),
               "fmi2GetReal")) {
    abort_with("fmi2GetReal", "cannot read what was set");
  }
  for (size_t i = 0; i < values.size(); ++i) {
    if (!appears_after(references, i) && !(back[i] == values[i])) {
      abort_with("fmi2GetReal", "'" + host.scene().rows[references[i]].name + "' is not as set");
    }
  }
}

void set_integers(Host& host) {
  const auto references = pick_references(host, host.scene().integers_set);
  std::vector<int> values(references.size());
  static const int kValues[] = {0, 1, 2, 3, -1, 100, 2147483647, -2147483647 - 1};
  for (int& value : values) value = kValues[host.in.pick(8)];
  unchanged_if_refused(host, "fmi2SetInteger", [&] {
    return fmi2SetInteger(host.slot().c, references.data(), references.size(), values.data());
  });
}

void set_booleans(Host& host) {
  const auto references = pick_references(host, host.scene().booleans);
  std::vector<int> values(references.size());
  for (int& value : values) value = static_cast<int>(host.in.pick(8)) - 3;
  unchanged_if_refused(host, "fmi2SetBoolean", [&] {
    return fmi2SetBoolean(host.slot().c, references.data(), references.size(), values.data());
  });
}

/// All four elements of a quaternion at once: turned over, scaled, zero, tiny.
void set_quaternion(Host& host) {
  const SceneFolder& scene = host.scene();
  std::vector<fmi2ValueReference> firsts;
  for (fmi2ValueReference reference : scene.reals_set) {
    const std::string& name = scene.rows[reference].name;
    if (name.size() > 11 && name.compare(name.size() - 11, 11, "attitude[1]") == 0) {
      firsts.push_back(reference);
    }
  }
  const fmi2ValueReference first = firsts[host.in.pick(firsts.size())];
  const fmi2ValueReference references[4] = {first, first + 1, first + 2, first + 3};
  double q[4] = {0, 0, 0, 0};
  is_done(fmi2GetReal(host.slot().c, references, 4, q), "fmi2GetReal");
  static const double kFactors[] = {-1, 0, 1.0009, 0.9991, 1.01, 1e-160, 5e-324, 1e160};
  const double factor = kFactors[host.in.pick(8)];
  for (double& x : q) x *= factor;
  if (host.in.flag()) std::swap(q[0], q[1 + host.in.pick(3)]);
  unchanged_if_refused(host, "fmi2SetReal",
                       [&] { return fmi2SetReal(host.slot().c, references, 4, q); });
}

void get_anything(Host& host) {
  const SceneFolder& scene = host.scene();
  const std::vector<fmi2ValueReference>* lists[] = {&scene.reals_set, &scene.reals_computed,
                                                    &scene.integers_computed, &scene.booleans};
  const auto references = pick_references(host, *lists[host.in.pick(4)]);
  const size_t n = references.size();
  const bool null = host.in.pick(16) == 15;
  fmi2Component c = host.slot().c;
  std::vector<double> reals(n, 0.0);
  std::vector<int> integers(n, 0);
  std::vector<fmi2String> strings(n, nullptr);
  const fmi2ValueReference* vr = null ? nullptr : references.data();
  is_done(fmi2GetReal(c, vr, n, reals.data()), "fmi2GetReal");
  check_finite(reals, "fmi2GetReal");
  is_done(fmi2GetInteger(c, vr, n, null ? nullptr : integers.data()), "fmi2GetInteger");
  is_done(fmi2GetBoolean(c, vr, n, integers.data()), "fmi2GetBoolean");
  is_done(fmi2GetString(c, vr, n, strings.data()), "fmi2GetString");
  unchanged_if_refused(host, "fmi2SetString",
                       [&] { return fmi2SetString(c, vr, n, strings.data()); });
}

// ---------------------------------------------------------------- stepping

double last_time(const Slot& slot) {
  double time = slot.time;
  is_done(fmi2GetRealStatus(slot.c, fmi2LastSuccessfulTime, &time), "fmi2GetRealStatus");
  return time;
}

/// A step of the active instance; checks everything that a step promises.
bool do_step(Host& host, double t, double h) {
  Slot& slot = host.slot();
  const Snapshot before = look(slot);
  const double time_before = last_time(slot);
  const fmi2Status status = fmi2DoStep(slot.c, t, h, host.in.flag());
  if (!is_done(status, "fmi2DoStep")) {
    check_same(slot, before, "fmi2DoStep", "was not made, but has changed a value");
    if (last_time(slot) != time_before) abort_with("fmi2DoStep", "was not made, but time went on");
    return false;
  }
  slot.time = t + h;
  if (last_time(slot) != slot.time) abort_with("fmi2DoStep", "has not reached the end of the step");
  look(slot);
  return true;
}

double pick_step(Host& host) {
  static const double kSteps[] = {1e-3, 0.01, 0.02, 1e-4, 1e-6, 1e-9, 1e-12, 1e-16, 1e-300, 0.005};
  const size_t choice = host.in.pick(11);
  const double scale = host.scene().time_scale;
  const double h = choice < 10 ? kSteps[choice] * scale : host.in.number();
  // What would be simulated for long is left out; what should be refused at once is not.
  const bool harmless = !(h > 0.0) || !(h < 1e12) || h <= host.budget * scale;
  if (!harmless) return 1e-6;
  if (h > 0.0 && h < 1.0) host.budget -= h / scale;
  return h;
}

void step(Host& host) {
  double t = host.slot().time;
  const size_t wrong = host.in.pick(12);
  if (wrong == 11) t = host.in.number();
  if (wrong == 10) t += 1e-9;
  if (wrong == 9) t = std::nextafter(t, 1e300);
  do_step(host, t, pick_step(host));
}

void ask_status(Host& host) {
  fmi2Component c = host.slot().c;
  const auto kind = static_cast<fmi2StatusKind>(host.in.pick(4));
  const bool null = host.in.pick(8) == 7;
  fmi2Status status = fmi2OK;
  double real = 0.0;
  int integer = 0, boolean = 0;
  fmi2String text = nullptr;
  is_done(fmi2GetStatus(c, kind, null ? nullptr : &status), "fmi2GetStatus");
  is_done(status, "fmi2GetStatus");
  is_done(fmi2GetRealStatus(c, kind, null ? nullptr : &real), "fmi2GetRealStatus");
  check_finite({real}, "fmi2GetRealStatus");
  is_done(fmi2GetIntegerStatus(c, kind, null ? nullptr : &integer), "fmi2GetIntegerStatus");
  is_done(fmi2GetBooleanStatus(c, kind, null ? nullptr : &boolean), "fmi2GetBooleanStatus");
  is_done(fmi2GetStringStatus(c, kind, null ? nullptr : &text), "fmi2GetStringStatus");
  is_done(fmi2CancelStep(c), "fmi2CancelStep");
}

// ---------------------------------------------------------------- saved states

void save_state(Host& host) {
  Slot& slot = host.slot();
  if (slot.saved.size() >= kMaxSavedStates) return;
  SavedState saved;
  const Snapshot before = look(slot);
  const bool done = is_done(fmi2GetFMUstate(slot.c, &saved.state), "fmi2GetFMUstate");
  check_same(slot, before, "fmi2GetFMUstate", "has changed a value");
  if (!done) return;
  if (!saved.state) abort_with("fmi2GetFMUstate", "returned no state");
  saved.values = before;
  saved.time = slot.time;
  slot.saved.push_back(saved);
}

/// Puts a saved state, of any instance, into the active one.
void restore_state(Host& host) {
  Slot& slot = host.slot();
  const Slot& owner = host.slots[host.in.pick(4) == 3 ? host.in.pick(kMaxInstances) : host.active];
  if (owner.saved.empty()) {
    unchanged_if_refused(host, "fmi2SetFMUstate", [&] { return fmi2SetFMUstate(slot.c, nullptr); });
    return;
  }
  const SavedState& saved = owner.saved[host.in.pick(owner.saved.size())];
  if (!unchanged_if_refused(host, "fmi2SetFMUstate",
                            [&] { return fmi2SetFMUstate(slot.c, saved.state); })) {
    if (&owner == &slot) abort_with("fmi2SetFMUstate", "has refused a state of this instance");
    return;
  }
  if (owner.scene != slot.scene) abort_with("fmi2SetFMUstate", "took the state of another scene");
  check_same(slot, saved.values, "fmi2SetFMUstate", "the values are not those that were saved");
  slot.time = saved.time;
}

/// The same step twice from the same state: the same bits.
void repeat_step(Host& host) {
  Slot& slot = host.slot();
  fmi2FMUstate state = nullptr;
  if (!is_done(fmi2GetFMUstate(slot.c, &state), "fmi2GetFMUstate")) return;
  const double t = slot.time, h = pick_step(host);
  const bool made = do_step(host, t, h);
  const Snapshot first = look(slot);
  if (!is_done(fmi2SetFMUstate(slot.c, state), "fmi2SetFMUstate")) {
    abort_with("fmi2SetFMUstate", "has refused a state of this instance");
  }
  slot.time = t;
  if (do_step(host, t, h) != made) abort_with("fmi2DoStep", "a repeated step ends otherwise");
  check_same(slot, first, "fmi2DoStep", "a repeated step gives other values");
  is_done(fmi2FreeFMUstate(slot.c, &state), "fmi2FreeFMUstate");
}

void serialise(Host& host) {
  Slot& slot = host.slot();
  const bool have = !slot.saved.empty();
  const fmi2FMUstate state = have ? slot.saved.back().state : nullptr;
  size_t size = 0;
  if (!is_done(fmi2SerializedFMUstateSize(slot.c, state, &size), "fmi2SerializedFMUstateSize")) {
    return;
  }
  if (!have) abort_with("fmi2SerializedFMUstateSize", "accepted no state");
  if (size == 0 || size > kLargestState)
    abort_with("fmi2SerializedFMUstateSize", "is not credible");
  std::vector<char> bytes(size, 0);
  if (!is_done(fmi2SerializeFMUstate(slot.c, state, bytes.data(), size), "fmi2SerializeFMUstate")) {
    abort_with("fmi2SerializeFMUstate", "was refused");
  }
  // Too small a buffer, or a state from a file that has been damaged.
  if (host.in.pick(4) == 3) {
    std::vector<char> small(size / 2);
    is_done(fmi2SerializeFMUstate(slot.c, state, small.data(), small.size()),
            "fmi2SerializeFMUstate");
  }
  const size_t changes = host.in.pick(4);
  for (size_t i = 0; i < changes; ++i) {
    const size_t at = (static_cast<size_t>(host.in.byte()) * 256 + host.in.byte()) % size;
    bytes[at] = static_cast<char>(bytes[at] ^ static_cast<char>(host.in.byte()));
  }
  if (host.in.pick(8) == 7) bytes.resize(bytes.size() * host.in.pick(16) / 16);
  const bool damaged = changes > 0 || bytes.size() != size;
  SavedState copy;
  if (!is_done(fmi2DeSerializeFMUstate(slot.c, bytes.data(), bytes.size(), &copy.state),
               "fmi2DeSerializeFMUstate")) {
    if (!damaged) abort_with("fmi2DeSerializeFMUstate", "was refused");
    return;
  }
  const bool done = unchanged_if_refused(host, "fmi2SetFMUstate",
                                         [&] { return fmi2SetFMUstate(slot.c, copy.state); });
  if (!done && !damaged) abort_with("fmi2SetFMUstate", "has refused a state of this instance");
  if (done && !damaged) {
    check_same(slot, slot.saved.back().values, "fmi2SetFMUstate",
               "the values are not those that were serialised");
  }
  if (done) slot.time = damaged ? last_time(slot) : slot.saved.back().time;
  is_done(fmi2FreeFMUstate(slot.c, &copy.state), "fmi2FreeFMUstate");
}

void drop_states(Host& host) {
  fmi2FMUstate none = nullptr;
  free_states(host.slot());
  is_done(fmi2FreeFMUstate(host.slot().c, &none), "fmi2FreeFMUstate");
  is_done(fmi2FreeFMUstate(host.slot().c, nullptr), "fmi2FreeFMUstate");
  is_done(fmi2GetFMUstate(host.slot().c, nullptr), "fmi2GetFMUstate");
}

// ---------------------------------------------------------------- derivatives

void ask_directional_derivative(Host& host) {
  const SceneFolder& scene = host.scene();
  const auto unknown = pick_references(host, scene.reals_computed);
  const auto known = pick_references(host, scene.reals_set);
  std::vector<double> seed(known.size()), result(unknown.size(), 0.0);
  for (double& x : seed) x = host.in.number();
  const bool null = host.in.pick(16) == 15;
  const Snapshot before = look(host.slot());
  const bool done = is_done(
      fmi2GetDirectionalDerivative(host.slot().c, unknown.data(), unknown.size(), known.data(),
                                   known.size(), null ? nullptr : seed.data(), result.data()),
      "fmi2GetDirectionalDerivative");
  check_same(host.slot(), before, "fmi2GetDirectionalDerivative", "has changed a value");
  if (done) check_finite(result, "fmi2GetDirectionalDerivative");
}

void pick_orders(Host& host, std::vector<int>& orders) {
  static const int kOrders[] = {1, 2, 0, -1, 100};
  for (int& order : orders) order = kOrders[host.in.pick(5)];
}

void set_input_derivatives(Host& host) {
  const auto references = pick_references(host, host.scene().reals_set);
  std::vector<int> orders(references.size());
  std::vector<double> values(references.size());
  pick_orders(host, orders);
  for (double& x : values) x = host.in.number();
  unchanged_if_refused(host, "fmi2SetRealInputDerivatives", [&] {
    return fmi2SetRealInputDerivatives(host.slot().c, references.data(), references.size(),
                                       orders.data(), values.data());
  });
}

void get_output_derivatives(Host& host) {
  const auto references = pick_references(host, host.scene().reals_computed);
  std::vector<int> orders(references.size());
  std::vector<double> values(references.size(), 0.0);
  pick_orders(host, orders);
  const Snapshot before = look(host.slot());
  const bool done =
      is_done(fmi2GetRealOutputDerivatives(host.slot().c, references.data(), references.size(),
                                           orders.data(), values.data()),
              "fmi2GetRealOutputDerivatives");
  check_same(host.slot(), before, "fmi2GetRealOutputDerivatives", "has changed a value");
  if (done) check_finite(values, "fmi2GetRealOutputDerivatives");
}

// ---------------------------------------------------------------- model exchange

void find_events(Host& host) {
  fmi2EventInfo info{};
  for (int i = 0; i < 5; ++i) {
    if (!is_done(fmi2NewDiscreteStates(host.slot().c, &info), "fmi2NewDiscreteStates")) return;
    if (info.nextEventTimeDefined && !std::isfinite(info.nextEventTime)) {
      abort_with("fmi2NewDiscreteStates", "the next event time is not finite");
    }
    if (!info.newDiscreteStatesNeeded) return;
  }
  abort_with("fmi2NewDiscreteStates", "comes to no end");
}

void set_continuous_states(Host& host) {
  const size_t n = host.scene().states - (host.in.pick(16) == 15 && host.scene().states > 0);
  std::vector<double> x(n, 0.0);
  is_done(fmi2GetContinuousStates(host.slot().c, x.data(), n), "fmi2GetContinuousStates");
  for (size_t changes = host.in.pick(4); n > 0 && changes > 0; --changes) {
    double& value = x[host.in.byte() % n];
    value = host.in.flag() ? host.in.number() : value + 1e-4 * (host.in.byte() - 128);
  }
  unchanged_if_refused(host, "fmi2SetContinuousStates",
                       [&] { return fmi2SetContinuousStates(host.slot().c, x.data(), n); });
}

void get_continuous(Host& host) {
  fmi2Component c = host.slot().c;
  const size_t n = host.scene().states, events = host.scene().indicators;
  std::vector<double> x(n, 0.0), rates(n, 0.0), nominals(n, 1.0), indicators(events, 0.0);
  is_done(fmi2GetContinuousStates(c, x.data(), n), "fmi2GetContinuousStates");
  check_finite(x, "fmi2GetContinuousStates");
  if (is_done(fmi2GetDerivatives(c, rates.data(), n), "fmi2GetDerivatives")) {
    check_finite(rates, "fmi2GetDerivatives");
  }
  if (is_done(fmi2GetNominalsOfContinuousStates(c, nominals.data(), n),
              "fmi2GetNominalsOfContinuousStates")) {
    for (double x0 : nominals) {
      if (!(std::isfinite(x0) && x0 != 0.0)) abort_with("nominal", "is zero or not finite");
    }
  }
  if (is_done(fmi2GetEventIndicators(c, indicators.data(), events), "fmi2GetEventIndicators")) {
    check_finite(indicators, "fmi2GetEventIndicators");
  }
  const bool null = host.in.pick(8) == 7;
  is_done(fmi2GetDerivatives(c, null ? nullptr : rates.data(), n), "fmi2GetDerivatives");
  is_done(fmi2GetEventIndicators(c, null ? nullptr : indicators.data(), events + null),
          "fmi2GetEventIndicators");
}

void set_time(Host& host) {
  double t = host.slot().time + pick_step(host);
  if (host.in.pick(8) == 7) t = host.in.number();
  if (unchanged_if_refused(host, "fmi2SetTime", [&] { return fmi2SetTime(host.slot().c, t); })) {
    host.slot().time = t;
  }
}

void enter_event_mode(Host& host) {
  is_done(fmi2EnterEventMode(host.slot().c), "fmi2EnterEventMode");
}
void enter_continuous_time_mode(Host& host) {
  is_done(fmi2EnterContinuousTimeMode(host.slot().c), "fmi2EnterContinuousTimeMode");
}
void complete_step(Host& host) {
  fmi2Boolean event = fmi2False, terminates = fmi2False;
  const bool null = host.in.pick(8) == 7;
  is_done(fmi2CompletedIntegratorStep(host.slot().c, host.in.flag(), null ? nullptr : &event,
                                      &terminates),
          "fmi2CompletedIntegratorStep");
}

/// What a simple host does: explicit Euler steps and events between them.
void integrate(Host& host) {
  Slot& slot = host.slot();
  enter_event_mode(host);
  find_events(host);
  enter_continuous_time_mode(host);
  std::vector<double> x(host.scene().states, 0.0), rates(x);
  for (size_t steps = host.in.pick(5); steps > 0; --steps) {
    const double h = 1e-4;
    if (!is_done(fmi2GetContinuousStates(slot.c, x.data(), x.size()), "fmi2GetContinuousStates") ||
        !is_done(fmi2GetDerivatives(slot.c, rates.data(), x.size()), "fmi2GetDerivatives")) {
      return;
    }
    check_finite(rates, "fmi2GetDerivatives");
    for (size_t i = 0; i < x.size(); ++i) x[i] += h * rates[i];
    if (!is_done(fmi2SetTime(slot.c, slot.time + h), "fmi2SetTime")) return;
    slot.time += h;
    if (!is_done(fmi2SetContinuousStates(slot.c, x.data(), x.size()), "fmi2SetContinuousStates")) {
      return;
    }
    complete_step(host);
  }
  look(slot);
}

// ---------------------------------------------------------------- the operations

void choose_instance(Host& host) { host.active = host.in.pick(kMaxInstances); }

void inquire(Host&) {
  if (std::string(fmi2GetVersion()) != "2.0") abort_with("fmi2GetVersion", "is not 2.0");
  if (std::string(fmi2GetTypesPlatform()) != "default") {
    abort_with("fmi2GetTypesPlatform", "is not default");
  }
  // Without an instance everything is an error, and freeing does nothing.
  double value = 0.0;
  fmi2FMUstate state = nullptr;
  const fmi2Status statuses[] = {fmi2Reset(nullptr),
                                 fmi2Terminate(nullptr),
                                 fmi2DoStep(nullptr, 0.0, 1e-3, fmi2True),
                                 fmi2GetReal(nullptr, nullptr, 0, &value),
                                 fmi2SetReal(nullptr, nullptr, 0, &value),
                                 fmi2GetFMUstate(nullptr, &state)};
  for (fmi2Status status : statuses) {
    if (status != fmi2Error) abort_with("a call", "without an instance was not refused");
  }
  fmi2FreeInstance(nullptr);
}

struct Operation {
  char key;  ///< its byte in an input
  void (*run)(Host&);
};

constexpr Operation kOperations[] = {
    {'N', instantiate},
    {'n', instantiate_wrongly},
    {'F', free_instance},
    {'#', choose_instance},
    {'v', inquire},
    {'L', set_logging},
    {'S', set_up},
    {'i', enter_initialization},
    {'x', exit_initialization},
    {'I', start},
    {'T', terminate},
    {'Z', reset},
    {'r', set_reals},
    {'q', set_quaternion},
    {'d', set_integers},
    {'b', set_booleans},
    {'g', get_anything},
    {'s', step},
    {'?', ask_status},
    {'G', save_state},
    {'P', restore_state},
    {'R', repeat_step},
    {'B', serialise},
    {'f', drop_states},
    {'D', ask_directional_derivative},
    {'u', set_input_derivatives},
    {'y', get_output_derivatives},
    {'E', enter_event_mode},
    {'e', find_events},
    {'C', enter_continuous_time_mode},
    {'t', set_time},
    {'X', set_continuous_states},
    {'c', get_continuous},
    {'p', complete_step},
    {'M', integrate},
};
constexpr size_t kOperationCount = sizeof kOperations / sizeof kOperations[0];

const Operation& find_operation(std::uint8_t byte) {
  for (const Operation& operation : kOperations) {
    if (operation.key == static_cast<char>(byte)) return operation;
  }
  return kOperations[byte % kOperationCount];
}

void check_neighbour(Host& host, const Operation& operation) {
  // Whatever happens to one instance, the next one does not notice.
  const size_t at = host.active;
  const Slot& other = host.slots[(at + 1) % kMaxInstances];
  const Snapshot before = look(other);
  operation.run(host);
  check_same(other, before, "another instance", "has changed a value of this one");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, size_t size) {
  Host host{ByteSource(data, size)};
  // Reading in initialization mode computes the start; some inputs do without.
  host.watches = host.in.pick(4) != 3;
  instantiate(host);
  for (int calls = 0; calls < kMaxCalls && !host.in.empty(); ++calls) {
    const std::uint8_t byte = host.in.byte();
    if (byte == ' ' || byte == '\n') continue;  // layout of seeds
    const Operation& operation = find_operation(byte);
    if (!host.slot().c) instantiate(host);
    if (!host.slot().c) continue;  // model exchange where there is none
    check_neighbour(host, operation);
  }
  for (host.active = 0; host.active < kMaxInstances; ++host.active) free_instance(host);
  return 0;
}
