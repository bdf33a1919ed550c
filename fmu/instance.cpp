// One instance: initialisation, steps, values, saved states.
#include "instance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <utility>

#include "interface/model_description.hpp"
#include "mechanism/generated_kernel.hpp"
#include "sim/solver_methods.hpp"

namespace dockloop {

fmi2Status fmi_status(StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return fmi2OK;
    case StatusCode::kBranchChanged:
    case StatusCode::kLoopNotClosed:
    case StatusCode::kContactTooDeep:
    case StatusCode::kTravelOutsideTable:
    case StatusCode::kRateOutsideTable:
    case StatusCode::kContactFlipped:
    case StatusCode::kIntegrationFailed:
    case StatusCode::kLoopSingular:  // another step size may step over the singularity
    case StatusCode::kBadInput:      // correct the input and repeat the step
    case StatusCode::kInterrupted:
      return fmi2Discard;
    case StatusCode::kOutOfReach:
    case StatusCode::kRedundancyLost:
    case StatusCode::kInertiaNotPositive:
    case StatusCode::kSequenceChatters:
    case StatusCode::kCannotJoin:
    case StatusCode::kCouplingUnstable:
    case StatusCode::kNotFinite:
      return fmi2Error;
  }
  return fmi2Error;
}

Instance::Instance(std::shared_ptr<const Scene> scene, FmiKind fmi_kind, Logger log)
    : logger(std::move(log)),
      sim(std::move(scene), fmi_kind, get_fmu_comparison()),
      variables(make_variables(sim)),
      guid(find_guid(sim.scene(), variables)) {
  start_time = time = sim.scene().experiment.start;
}

namespace {

/// Folder of this platform, named as below binaries/, and file name of a kernel.
#if defined(_WIN32)
constexpr const char* kKernelFile = "win64/kernel.dll";
#elif defined(__APPLE__) && defined(__aarch64__)
constexpr const char* kKernelFile = "aarch64-darwin/kernel.dylib";
#elif defined(__APPLE__)
constexpr const char* kKernelFile = "darwin64/kernel.dylib";
#elif defined(__aarch64__)
constexpr const char* kKernelFile = "aarch64-linux/kernel.so";
#else
constexpr const char* kKernelFile = "linux64/kernel.so";
#endif

}  // namespace

void Instance::load_kernel(const std::string& resources) {
  const std::string file = resources + "/kernels/" + kKernelFile;
  std::error_code none;
  if (!std::filesystem::exists(std::filesystem::u8path(file), none)) return;
  try {
    kernels = std::make_shared<const KernelLibrary>(file);
    sim.use_kernels(kernels);
  } catch (const std::exception& e) {
    logger.write(fmi2Warning, kLogWarning,
                 std::string(e.what()) + "; the kernel is not used (same results, slower)");
  }
}

/// @post there is a companion, or none
void Instance::make_companion(bool wanted) {
  if (!wanted || sim.fmi_kind() == FmiKind::kModelExchange) {
    companion.reset();
  } else if (!companion) {
    companion = std::make_unique<Companion>(sim, get_fmu_comparison(), kernels);
    companion->use_interruption(interruption);
  }
}

void Instance::use_interruption(std::function<bool()> asks) {
  interruption = std::move(asks);
  sim.use_interruption(interruption);
}

void Instance::setup(double t0, double wanted_tolerance, double stop) {
  start_time = time = t0;
  tolerance = wanted_tolerance;
  stop_time = stop;
}

void Instance::initialise() {
  if (initialised) return;
  sim.initialise(start_time, tolerance);
  make_companion(sim.parameters().measures_error);
  if (companion) companion->start(sim, start_time, tolerance);
  initialised = true;
  std::vector<std::string> warnings = sim.take_warnings();
  if (warnings != last_warnings) {
    for (const std::string& text : warnings) logger.write(fmi2Warning, kLogWarning, text);
    last_warnings = std::move(warnings);
  }
  if (sim.choice_text() == last_choice) return;
  last_choice = sim.choice_text();
  if (!last_choice.empty()) logger.write(fmi2OK, kLogChoices, last_choice);
}

void Instance::log_left_out() {
  const std::string text = logger.enabled(kLogChoices) ? sim.left_out_text() : std::string();
  if (!text.empty()) logger.write(fmi2OK, kLogChoices, text);
  if (!companion) return;
  const Companion::Finding found = companion->describe(sim);
  logger.write(found.is_warning ? fmi2Warning : fmi2OK,
               found.is_warning ? kLogWarning : kLogChoices, found.text);
}

void Instance::log_events() {
  for (const std::string& text : sim.take_warnings()) logger.write(fmi2Warning, kLogWarning, text);
  if (!logger.enabled(kLogEvents) || !sim.update(OutputGroup::kMain).ok()) return;
  if (sim.output_storage().phase == phase) return;
  phase = sim.output_storage().phase;
  logger.write(fmi2OK, kLogEvents,
               "phase " + std::to_string(phase) + " at t = " + shortest(time) + " s");
}

fmi2Status Instance::step(double t, double h) {
  if (!(std::isfinite(h) && h > 0.0)) {
    throw Refusal("fmi2DoStep: communicationStepSize is " + shortest(h) +
                  " s, but must be positive and finite");
  }
  // Rounding of the host's clock (some count nanoseconds) is accepted; a gap or overlap is not.
  const double slack = 1e-6 * h + 1e-15 * std::abs(time);
  if (!(std::abs(t - time) <= slack)) {
    throw Refusal("fmi2DoStep: currentCommunicationPoint is " + shortest(t) + " s, expected " +
                  shortest(time) + " s, the end of the last step");
  }
  if (!(t + h > t)) {
    throw Refusal("fmi2DoStep: communicationStepSize is " + shortest(h) +
                  " s, too small for a clock at " + shortest(t) + " s");
  }
  if (!(t + h <= stop_time + slack)) {
    throw Refusal("fmi2DoStep: the step ends at " + shortest(t + h) +
                  " s, after the stopTime of fmi2SetupExperiment, " + shortest(stop_time) + " s");
  }
  state = kError;  // remains after an exception
  step_status = fmi2Error;
  if (companion) companion->take_inputs(sim);
  step_status = fmi_status(sim.step(t, h).code);
  if (step_status != fmi2OK) {
    const bool can_repeat = step_status == fmi2Discard;
    if (can_repeat) state = kStepFailed;
    logger.write(step_status, can_repeat ? kLogDiscard : kLogError, sim.status_text());
    return step_status;
  }
  if (companion) companion->follow(sim, t, h);
  state = kStepComplete;
  time = t + h;
  log_events();
  return fmi2OK;
}

void Instance::log_refused() noexcept {
  const char* name = refused.exchange(nullptr);
  if (!name) return;
  char text[200];
  std::snprintf(text, sizeof text,
                "%s: was refused, because another call of this instance ran; use an instance from "
                "one thread at a time, and not from its callbacks",
                name);
  logger.error(text);
}

void Instance::reset() {
  companion.reset();
  sim.reset();
  variables = make_variables(sim);
  setup(sim.scene().experiment.start, 0.0, kNoStop);
  state = kInstantiated;
  initialised = false;
  step_status = fmi2OK;
  phase = 0;
  last_warnings.clear();
  last_choice.clear();
}

// ---------------------------------------------------------------- values

const void* Instance::current(const Variable& v) {
  if (v.has_start() && before_start()) return v.start;
  if (v.causality == Causality::kOutput || v.causality == Causality::kLocal) {
    if (state == kInstantiated) {
      throw Refusal("'" + v.name + "' has no value yet: call fmi2EnterInitializationMode first");
    }
    if (state == kInitializationMode) initialise();
    const Status status = sim.update(v.group);
    if (!status.ok()) throw Discard("'" + v.name + "' has no value here: " + sim.describe(status));
  }
  return v.value;
}

void Instance::check_settable(const Variable& v, const char* function) const {
  const auto refuse = [&](const char* why) {
    throw Refusal(std::string(function) + ": '" + v.name + "' " + why);
  };
  if (!v.has_start()) refuse("is computed and cannot be set");
  if (v.causality == Causality::kInput || before_start()) return;
  if (v.variability == Variability::kTunable && (state & (kStepping | kEventMode))) return;
  refuse(
      v.variability == Variability::kTunable
          ? "is a tunable parameter: it can be set between steps or in event mode only"
      : v.causality == Causality::kParameter
          ? "is a fixed parameter: it can be set only before the start (fmi2ExitInitializationMode)"
          : "is a state: its start value can be set only before the start "
            "(fmi2ExitInitializationMode)");
}

void Instance::note_change(bool tunables) {
  if (before_start()) {
    initialised = false;
    return;
  }
  if (tunables) {
    sim.adopt_tunables();
    if (companion) companion->take_tunables(sim);
  }
  sim.invalidate_outputs();
}

// ---------------------------------------------------------------- saved states

void Instance::save(SavedInstance& into) const {
  into.guid = guid;
  into.fmi_kind = sim.fmi_kind();
  into.state = state;
  into.initialised = initialised;
  into.start_time = start_time;
  into.tolerance = tolerance;
  into.has_stop_time = stop_time < kNoStop;
  into.stop_time = into.has_stop_time ? stop_time : 0.0;
  into.time = time;
  into.step_status = step_status;
  into.phase = phase;
  sim.save(into.sim);
  into.companion.resize(companion ? 1 : 0);
  if (companion) companion->save(into.companion[0]);
  if (!initialised) into.sim.setup.reset();  // the set-up does not fit the present parameters
}

void Instance::load(const SavedInstance& from) {
  if (from.guid != guid) {
    throw Refusal("the state belongs to the FMU with GUID '" + from.guid + "', this one is '" +
                  guid + "'");
  }
  if (from.fmi_kind != sim.fmi_kind()) {
    throw Refusal(
        "the state belongs to the other FMI kind (co-simulation or model "
        "exchange)");
  }
  const bool had_companion = companion != nullptr, wanted = !from.companion.empty();
  SavedSim before;
  if (wanted) sim.save(before);
  sim.load(from.sim);
  try {
    make_companion(wanted);
    if (wanted) companion->load(from.companion[0], sim);
  } catch (...) {
    if (!had_companion) companion.reset();
    sim.load(before);
    throw;
  }
  if (!wanted) sim.state_error(std::nullopt);
  state = from.state;
  initialised = from.initialised;
  start_time = from.start_time;
  tolerance = from.tolerance;
  stop_time = from.has_stop_time ? from.stop_time : kNoStop;
  time = from.time;
  step_status = static_cast<fmi2Status>(from.step_status);
  phase = from.phase;
}

namespace {

constexpr char kMagic[8] = {'D', 'O', 'C', 'K', 'L', 'O', 'O', 'P'};
constexpr std::uint32_t kByteOrder = 0x01020304;

struct Header {
  char magic[8];
  std::uint32_t byte_order, format;
  char version[16];  ///< of dockloop, zero-terminated
  char guid[32];
  std::uint64_t size;      ///< of the contents
  std::uint64_t checksum;  ///< of header and contents
};
static_assert(sizeof(Header) == 80, "no padding: files contain these bytes");

std::uint64_t add_to_hash(std::uint64_t hash, const char* bytes, size_t size) {
  for (size_t i = 0; i < size; ++i) {
    hash = (hash ^ static_cast<unsigned char>(bytes[i])) * 1099511628211ull;
  }
  return hash;
}

/// FNV-1a, 64 bits, of the header (without this number) and the contents.
std::uint64_t find_checksum(const Header& header, const char* contents, size_t size) {
  Header plain = header;
  plain.checksum = 0;
  std::uint64_t hash =
      add_to_hash(14695981039346656037ull, reinterpret_cast<const char*>(&plain), sizeof plain);
  return add_to_hash(hash, contents, size);
}

/// Printable characters for a log line.
std::string printable(std::string text) {
  for (char& c : text) {
    if (c < 0x20 || c > 0x7e) c = '?';
  }
  return text;
}

}  // namespace

std::vector<char> serialise(const SavedInstance& saved) {
  ByteWriter writer;
  transfer(writer, const_cast<SavedInstance&>(saved));  // writing reads only
  const std::vector<char> contents = writer.take();
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.byte_order = kByteOrder;
  header.format = find_format<SavedInstance>();
  std::strncpy(header.version, DOCKLOOP_VERSION, sizeof header.version - 1);
  std::copy_n(saved.guid.begin(), std::min(saved.guid.size(), sizeof header.guid), header.guid);
  header.size = contents.size();
  header.checksum = find_checksum(header, contents.data(), contents.size());
  std::vector<char> bytes(sizeof header + contents.size());
  std::memcpy(bytes.data(), &header, sizeof header);
  std::copy(contents.begin(), contents.end(), bytes.data() + sizeof header);
  return bytes;
}

void deserialise(const char* bytes, size_t size, const std::string& guid, SavedInstance& into) {
  Header header;
  if (size < sizeof header) throw Refusal("too short for a saved state");
  std::memcpy(&header, bytes, sizeof header);
  if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0) {
    throw Refusal("these bytes are not a saved state of a dockloop FMU");
  }
  if (header.byte_order != kByteOrder) throw Refusal("saved on a machine of other byte order");
  const std::string version(header.version, strnlen(header.version, sizeof header.version));
  const std::uint32_t format = find_format<SavedInstance>();
  if (header.format != format || version != DOCKLOOP_VERSION) {
    throw Refusal("saved by dockloop " + printable(version) + " in format " +
                  std::to_string(header.format) +
                  "; this is dockloop " DOCKLOOP_VERSION " with format " + std::to_string(format) +
                  ": load it with the library that saved it, or repeat the run");
  }
  const std::string saved_by(header.guid, sizeof header.guid);
  if (saved_by != guid) {
    throw Refusal("saved by the FMU with GUID '" + printable(saved_by) + "', this one is '" + guid +
                  "'");
  }
  const char* contents = bytes + sizeof header;
  if (header.size != size - sizeof header ||
      header.checksum != find_checksum(header, contents, header.size)) {
    throw Refusal("the saved state is damaged (length or checksum)");
  }
  ByteReader reader(contents, header.size);
  transfer(reader, into);
  const bool is_state =
      std::find(std::begin(kStates), std::end(kStates), into.state) != std::end(kStates);
  if (reader.left() != 0 || !is_state || into.companion.size() > 1)
    throw Refusal("the saved state is damaged");
}

}  // namespace dockloop
