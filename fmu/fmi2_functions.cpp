// The C interface of FMI 2.0 for co-simulation: an instance, how it is stepped and how its
// variables are read and written, then the 34 functions that such an FMU must export.
//
// Every function passes through guarded(): no exception leaves, and a call in the wrong state is
// refused with a line that says what to call first. A refused call changes nothing. There are no
// mutable statics, and neither a step nor a get or set allocates unless it has something to log.
#include <fmi2Functions.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "call_order.hpp"
#include "logger.hpp"
#include "model_description.hpp"
#include "resource_location.hpp"
#include "sim/docking_sim.hpp"
#include "variables.hpp"

namespace dockloop {
namespace {

/// A host asked for something impossible: becomes one log line and fmi2Error.
struct Refusal : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// ---------------------------------------------------------------- the instance

struct Instance {
  Instance(std::shared_ptr<const Scene> scene, Logger log)
      : logger(std::move(log)), sim(std::move(scene)), variables(make_variables(sim)) {
    start_time = time = sim.scene().experiment.start;
  }

  void setup(double t0, double wanted_tolerance) {
    start_time = time = t0;
    tolerance = wanted_tolerance;
  }
  /// Start state from parameters and start values, if it is not there yet or one of them changed.
  void initialise();
  fmi2Status step(double t, double h);
  void reset();

  /// Where the present value of a row is; computes the outputs when they are out of date.
  const void* current(const Variable& v);
  /// Throws unless the row can be set now.
  void check_settable(const Variable& v, const char* function) const;
  /// A value was written.
  void note_change();

  bool before_start() const { return (state & kBeforeStart) != 0; }

  Logger logger;
  DockingSim sim;
  std::vector<Variable> variables;
  State state = kInstantiated;
  bool initialised = false;                ///< the start state fits the present parameters
  double start_time = 0.0;                 ///< [s]
  double tolerance = 0.0;                  ///< relative, of the host; 0 = none given
  double time = 0.0;                       ///< [s] last communication point, by the host's clock
  fmi2Status step_status = fmi2OK;         ///< of the last fmi2DoStep
  int phase = 0;                           ///< as last logged
  std::vector<std::string> last_warnings;  ///< as last logged: an initialisation may be repeated
};

std::string quoted(const Variable& v, fmi2ValueReference reference) {
  return "'" + v.name + "' (value reference " + std::to_string(reference) + ")";
}

void Instance::initialise() {
  if (initialised) return;
  sim.initialise(start_time, tolerance);
  initialised = true;
  std::vector<std::string> warnings = sim.take_warnings();
  if (warnings != last_warnings) {
    for (const std::string& text : warnings) logger.write(fmi2Warning, kLogWarning, text);
    last_warnings = std::move(warnings);
  }
}

/// The one place that decides what a failed step means to the host: fmi2Discard when the host can
/// cure it (smaller step, corrected input), fmi2Error when it cannot.
fmi2Status fmi_status(StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return fmi2OK;
    case StatusCode::kBranchChanged:
    case StatusCode::kLoopNotClosed:
    case StatusCode::kContactTooDeep:
    case StatusCode::kContactFlipped:
    case StatusCode::kIntegrationFailed:
    case StatusCode::kBadInput:  // correct the input and repeat the step
      return fmi2Discard;
    case StatusCode::kOutOfReach:
    case StatusCode::kLoopSingular:
    case StatusCode::kRedundancyLost:
    case StatusCode::kInertiaNotPositive:
    case StatusCode::kNotFinite:
      return fmi2Error;
  }
  return fmi2Error;
}

fmi2Status Instance::step(double t, double h) {
  if (!(std::isfinite(h) && h > 0.0)) {
    throw Refusal("fmi2DoStep: communicationStepSize is " + shortest(h) +
                  " s, but must be positive and finite");
  }
  // Rounding of the host's clock (some count nanoseconds) is accepted, a gap or overlap is not.
  const double slack = 1e-6 * h + 1e-12 * std::max(std::abs(t), h);
  if (!(std::abs(t - time) <= slack)) {
    throw Refusal("fmi2DoStep: currentCommunicationPoint is " + shortest(t) + " s, expected " +
                  shortest(time) + " s, the end of the last step");
  }
  state = kError;  // stays if anything below throws
  step_status = fmi2Error;
  step_status = fmi_status(sim.step(t, h).code);
  if (step_status != fmi2OK) {
    const bool discard = step_status == fmi2Discard;
    if (discard) state = kStepFailed;
    logger.write(step_status, discard ? kLogDiscard : kLogError, sim.status_text());
    return step_status;
  }
  state = kStepComplete;
  time = t + h;
  for (const std::string& text : sim.take_warnings()) logger.write(fmi2Warning, kLogWarning, text);
  if (logger.enabled(kLogEvents) && sim.outputs().phase != phase) {
    phase = sim.outputs().phase;
    logger.write(fmi2OK, kLogEvents,
                 "phase " + std::to_string(phase) + " at t = " + shortest(time) + " s");
  }
  return fmi2OK;
}

void Instance::reset() {
  sim.reset();
  variables = make_variables(sim);
  setup(sim.scene().experiment.start, 0.0);
  state = kInstantiated;
  initialised = false;
  step_status = fmi2OK;
  phase = 0;
  last_warnings.clear();
}

const void* Instance::current(const Variable& v) {
  if (v.has_start() && before_start()) return v.start;
  if (v.causality == Causality::kOutput) {
    if (state == kInstantiated) {
      throw Refusal("'" + v.name + "' has no value yet: call fmi2EnterInitializationMode first");
    }
    if (state == kInitializationMode) initialise();
    sim.outputs();
  }
  return v.value;
}

void Instance::check_settable(const Variable& v, const char* function) const {
  const auto refuse = [&](const char* why) {
    throw Refusal(std::string(function) + ": '" + v.name + "' " + why);
  };
  if (!v.has_start()) refuse("is computed by the FMU and cannot be set");
  if (v.causality == Causality::kInput || before_start()) return;
  refuse(v.causality == Causality::kParameter
             ? "is a fixed parameter: it can be set only before fmi2ExitInitializationMode"
             : "is a state: its start value can be set only before fmi2ExitInitializationMode");
}

void Instance::note_change() {
  if (before_start()) {
    initialised = false;
  } else {
    sim.invalidate_outputs();
  }
}

// ---------------------------------------------------------------- get and set

/// What a row of a type stores, and what the interface passes.
template <Type>
struct Wire;
template <>
struct Wire<Type::kReal> {
  using Stored = double;
  using Passed = fmi2Real;
  static constexpr const char* kName = "Real";
};
template <>
struct Wire<Type::kInteger> {
  using Stored = int;
  using Passed = fmi2Integer;
  static constexpr const char* kName = "Integer";
};
template <>
struct Wire<Type::kBoolean> {
  using Stored = char;
  using Passed = fmi2Boolean;
  static constexpr const char* kName = "Boolean";
};

void check_arrays(const void* vr, size_t n, const void* value, const char* function) {
  if (n > 0 && (!vr || !value)) throw Refusal(std::string(function) + ": an array is null");
}

template <Type type>
const Variable& row(const Instance& self, fmi2ValueReference reference, const char* function) {
  if (reference >= self.variables.size()) {
    throw Refusal(std::string(function) + ": there is no variable with value reference " +
                  std::to_string(reference));
  }
  const Variable& v = self.variables[reference];
  if (v.type != type) {
    throw Refusal(std::string(function) + ": " + quoted(v, reference) + " is not of type " +
                  Wire<type>::kName);
  }
  return v;
}

void check_value(const Variable& v, double value, const char* function) {
  const auto refuse = [&](const std::string& why) {
    throw Refusal(std::string(function) + ": '" + v.name + "' = " + shortest(value) + why);
  };
  if (!std::isfinite(value)) refuse(" is not a finite number");
  if (value < v.min) refuse(" is below its minimum " + shortest(v.min) + ' ' + v.unit);
  if (value > v.max) refuse(" is above its maximum " + shortest(v.max) + ' ' + v.unit);
}

template <Type type>
fmi2Status get(Instance& self, const Call& call, const fmi2ValueReference vr[], size_t n,
               typename Wire<type>::Passed value[]) {
  const char* function = call.name;
  check_arrays(vr, n, value, function);
  for (size_t i = 0; i < n; ++i) {
    const void* p = self.current(row<type>(self, vr[i], function));
    value[i] = *static_cast<const typename Wire<type>::Stored*>(p);
  }
  return fmi2OK;
}

/// All or nothing: every reference and value is checked before the first is written.
template <Type type>
fmi2Status set(Instance& self, const Call& call, const fmi2ValueReference vr[], size_t n,
               const typename Wire<type>::Passed value[]) {
  const char* function = call.name;
  check_arrays(vr, n, value, function);
  for (size_t i = 0; i < n; ++i) {
    const Variable& v = row<type>(self, vr[i], function);
    self.check_settable(v, function);
    check_value(v, value[i], function);
  }
  using Stored = typename Wire<type>::Stored;
  for (size_t i = 0; i < n; ++i) {
    *static_cast<Stored*>(self.variables[vr[i]].start) = static_cast<Stored>(value[i]);
  }
  if (n > 0) self.note_change();
  return fmi2OK;
}

// ---------------------------------------------------------------- what every function shares

/// Runs `body(instance)` if the state permits `call`; whatever it throws becomes fmi2Error.
template <class Body>
fmi2Status guarded(fmi2Component c, const Call& call, Body&& body) noexcept {
  if (!c) return fmi2Error;
  Instance& self = *static_cast<Instance*>(c);
  try {
    if (!(call.permitted & self.state)) throw Refusal(forbidden_text(call, self.state));
    return body(self);
  } catch (const std::bad_alloc&) {
    self.logger.error("out of memory");
  } catch (const std::exception& e) {
    self.logger.error(e.what());
  } catch (...) {
    self.logger.error("unknown failure");
  }
  return fmi2Error;
}

/// A function that modelDescription.xml says is not there.
fmi2Status not_supported(fmi2Component c, const Call& call, const char* flag,
                         const char* value = "false") {
  return guarded(c, call, [&](Instance&) -> fmi2Status {
    throw Refusal(std::string(call.name) + " is not supported: capability flag " + flag + " is " +
                  value);
  });
}

/// fmi2Get*Status for a kind that the function does not answer.
fmi2Status no_such_status(Instance& self, const Call& call) {
  self.logger.write(fmi2Discard, kLogDiscard, std::string(call.name) + ": no such status is kept");
  return fmi2Discard;
}

Scene read_scene_file(const std::string& location) {
  const std::string name = resource_folder(location) + "/model.json";
  std::ifstream file(name, std::ios::binary);
  if (!file) throw Refusal("cannot read '" + name + "' (fmuResourceLocation '" + location + "')");
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return read_scene(text, name);
}

std::unique_ptr<Instance> make_instance(const char* name, fmi2Type type, const char* guid,
                                        const char* location, Logger logger) {
  if (!name || !*name) throw Refusal("instanceName is missing");
  if (type != fmi2CoSimulation) throw Refusal("this FMU is for co-simulation only");
  if (!guid) throw Refusal("fmuGUID is missing");
  if (!location) throw Refusal("fmuResourceLocation is missing");
  auto scene = std::make_shared<const Scene>(read_scene_file(location));
  if (guid != scene->fingerprint) {
    throw Refusal(std::string("fmuGUID is '") + guid + "', but this FMU is '" + scene->fingerprint +
                  "': modelDescription.xml and resources belong to different builds");
  }
  return std::make_unique<Instance>(std::move(scene), std::move(logger));
}

}  // namespace
}  // namespace dockloop

// ---------------------------------------------------------------- the C interface

using namespace dockloop;

extern "C" {

// Inquiry and logging

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                               const fmi2String categories[]) {
  return guarded(c, call::kSetDebugLogging, [&](Instance& self) {
    check_arrays(categories, n, categories, "fmi2SetDebugLogging");
    if (const char* unknown = self.logger.select(on != fmi2False, n, categories)) {
      throw Refusal(std::string("fmi2SetDebugLogging: there is no category '") + unknown + "'");
    }
    return fmi2OK;
  });
}

// Life of an instance

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean /*visible*/,
                              fmi2Boolean logging_on) {
  if (!callbacks) return nullptr;
  Logger logger;
  try {
    logger = Logger(*callbacks, name, logging_on != fmi2False);
    return make_instance(name, type, guid, location, logger).release();
  } catch (const std::exception& e) {
    logger.error(e.what());
  } catch (...) {
    logger.error("unknown failure");
  }
  return nullptr;
}

void fmi2FreeInstance(fmi2Component c) { delete static_cast<Instance*>(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start_time, fmi2Boolean stop_time_defined,
                               fmi2Real stop_time) {
  return guarded(c, call::kSetupExperiment, [&](Instance& self) {
    if (!std::isfinite(start_time)) throw Refusal("fmi2SetupExperiment: startTime is not finite");
    if (stop_time_defined && !(stop_time >= start_time)) {
      throw Refusal("fmi2SetupExperiment: stopTime " + shortest(stop_time) +
                    " s is before startTime " + shortest(start_time) + " s");
    }
    if (tolerance_defined && !(tolerance > 0.0 && tolerance < 1.0)) {
      throw Refusal("fmi2SetupExperiment: tolerance is " + shortest(tolerance) +
                    ", but must lie between 0 and 1");
    }
    self.setup(start_time, tolerance_defined ? tolerance : 0.0);
    return fmi2OK;
  });
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  return guarded(c, call::kEnterInitializationMode, [](Instance& self) {
    self.state = kInitializationMode;
    return fmi2OK;
  });
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  return guarded(c, call::kExitInitializationMode, [](Instance& self) {
    self.initialise();
    self.state = kStepComplete;
    return fmi2OK;
  });
}

fmi2Status fmi2Terminate(fmi2Component c) {
  return guarded(c, call::kTerminate, [](Instance& self) {
    self.state = kTerminated;
    return fmi2OK;
  });
}

fmi2Status fmi2Reset(fmi2Component c) {
  return guarded(c, call::kReset, [](Instance& self) {
    self.reset();
    return fmi2OK;
  });
}

// Variables

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  return guarded(c, call::kGetReal, [&](Instance& self) {
    return get<Type::kReal>(self, call::kGetReal, vr, n, value);
  });
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Integer value[]) {
  return guarded(c, call::kGetInteger, [&](Instance& self) {
    return get<Type::kInteger>(self, call::kGetInteger, vr, n, value);
  });
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Boolean value[]) {
  return guarded(c, call::kGetBoolean, [&](Instance& self) {
    return get<Type::kBoolean>(self, call::kGetBoolean, vr, n, value);
  });
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference[], size_t n, fmi2String[]) {
  return guarded(c, call::kGetString, [&](Instance&) {
    if (n > 0) throw Refusal("fmi2GetString: there are no String variables");
    return fmi2OK;
  });
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
  return guarded(c, call::kSetReal, [&](Instance& self) {
    return set<Type::kReal>(self, call::kSetReal, vr, n, value);
  });
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Integer value[]) {
  return guarded(c, call::kSetInteger, [&](Instance& self) {
    return set<Type::kInteger>(self, call::kSetInteger, vr, n, value);
  });
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Boolean value[]) {
  return guarded(c, call::kSetBoolean, [&](Instance& self) {
    return set<Type::kBoolean>(self, call::kSetBoolean, vr, n, value);
  });
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference[], size_t n,
                         const fmi2String[]) {
  return guarded(c, call::kSetString, [&](Instance&) {
    if (n > 0) throw Refusal("fmi2SetString: there are no String variables");
    return fmi2OK;
  });
}

// Stepping

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean /*no_rollback*/) {
  return guarded(c, call::kDoStep, [&](Instance& self) { return self.step(t, h); });
}
fmi2Status fmi2CancelStep(fmi2Component c) {
  return guarded(c, call::kCancelStep, [](Instance&) -> fmi2Status {
    throw Refusal("fmi2CancelStep: no step is pending, fmi2DoStep always finishes");
  });
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status* value) {
  return guarded(c, call::kGetStatus, [&](Instance& self) {
    check_arrays(value, 1, value, "fmi2GetStatus");
    if (kind != fmi2DoStepStatus) return no_such_status(self, call::kGetStatus);
    *value = self.step_status;
    return fmi2OK;
  });
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real* value) {
  return guarded(c, call::kGetRealStatus, [&](Instance& self) {
    check_arrays(value, 1, value, "fmi2GetRealStatus");
    if (kind != fmi2LastSuccessfulTime) return no_such_status(self, call::kGetRealStatus);
    *value = self.time;
    return fmi2OK;
  });
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind, fmi2Integer*) {
  return guarded(c, call::kGetIntegerStatus,
                 [](Instance& self) { return no_such_status(self, call::kGetIntegerStatus); });
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean* value) {
  return guarded(c, call::kGetBooleanStatus, [&](Instance& self) {
    check_arrays(value, 1, value, "fmi2GetBooleanStatus");
    if (kind != fmi2Terminated) return no_such_status(self, call::kGetBooleanStatus);
    *value = fmi2False;  // this FMU never ends a run from inside
    return fmi2OK;
  });
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind, fmi2String*) {
  return guarded(c, call::kGetStringStatus,
                 [](Instance& self) { return no_such_status(self, call::kGetStringStatus); });
}

// Capabilities that are not there

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate*) {
  return not_supported(c, call::kGetFMUstate, "canGetAndSetFMUstate");
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate) {
  return not_supported(c, call::kSetFMUstate, "canGetAndSetFMUstate");
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate*) {
  return not_supported(c, call::kFreeFMUstate, "canGetAndSetFMUstate");
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate, size_t*) {
  return not_supported(c, call::kSerializedFMUstateSize, "canSerializeFMUstate");
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate, fmi2Byte[], size_t) {
  return not_supported(c, call::kSerializeFMUstate, "canSerializeFMUstate");
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte[], size_t, fmi2FMUstate*) {
  return not_supported(c, call::kDeSerializeFMUstate, "canSerializeFMUstate");
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference[], size_t,
                                        const fmi2ValueReference[], size_t, const fmi2Real[],
                                        fmi2Real[]) {
  return not_supported(c, call::kGetDirectionalDerivative, "providesDirectionalDerivative");
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t,
                                       const fmi2Integer[], const fmi2Real[]) {
  return not_supported(c, call::kSetRealInputDerivatives, "canInterpolateInputs");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t,
                                        const fmi2Integer[], fmi2Real[]) {
  return not_supported(c, call::kGetRealOutputDerivatives, "maxOutputDerivativeOrder", "0");
}

}  // extern "C"
