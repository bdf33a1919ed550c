// The C functions of FMI 2.0 for co-simulation and model exchange: getters and setters of
// variables, then the 44 exported functions.
//
// Every function runs inside guarded(): no exception leaves the library. A call in the wrong state
// is refused, and the log line names the function to call first. A refused call changes nothing.
// There are no mutable statics. Steps, getters and setters do not allocate, except for log lines.
#include <fmi2Functions.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "instance.hpp"
#include "interface/model_description.hpp"
#include "one_call.hpp"
#include "resource_location.hpp"

namespace dockloop {
namespace {

std::string quoted(const Variable& v, fmi2ValueReference reference) {
  return "'" + v.name + "' (value reference " + std::to_string(reference) + ")";
}

// ---------------------------------------------------------------- getters and setters

/// Stored type of a row, and its type in the FMI functions.
template <Type>
struct Wire;
template <>
struct Wire<Type::kReal> {
  using Stored = double;
  using Passed = fmi2Real;
};
template <>
struct Wire<Type::kInteger> {
  using Stored = int;
  using Passed = fmi2Integer;
};
template <>
struct Wire<Type::kBoolean> {
  using Stored = char;
  using Passed = fmi2Boolean;
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
                  name_of(type));
  }
  return v;
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

/// All or nothing: every reference and value is checked before the first value is written. Values
/// that cannot be used together are restored.
template <Type type>
fmi2Status set(Instance& self, const Call& call, const fmi2ValueReference vr[], size_t n,
               const typename Wire<type>::Passed value[]) {
  const char* function = call.name;
  check_arrays(vr, n, value, function);
  bool tunables = false;
  for (size_t i = 0; i < n; ++i) {
    const Variable& v = row<type>(self, vr[i], function);
    self.check_settable(v, function);
    check_value(v, value[i], function);
    tunables = tunables || v.variability == Variability::kTunable;
  }
  using Stored = typename Wire<type>::Stored;
  const auto cell = [&](size_t i) { return static_cast<Stored*>(self.variables[vr[i]].start); };
  if (!tunables || self.before_start()) {
    for (size_t i = 0; i < n; ++i) *cell(i) = static_cast<Stored>(value[i]);
    if (n > 0) self.note_change(false);
    return fmi2OK;
  }
  const Parameters parameters = self.sim.parameters();
  const Inputs inputs = self.sim.inputs();
  for (size_t i = 0; i < n; ++i) *cell(i) = static_cast<Stored>(value[i]);
  try {
    self.note_change(true);
  } catch (...) {
    self.sim.parameters() = parameters;
    self.sim.inputs() = inputs;
    throw;
  }
  return fmi2OK;
}

// ---------------------------------------------------------------- code shared by all functions

/// Runs `body(instance)` if the state permits `call`; any exception becomes fmi2Error.
template <class Body>
fmi2Status guarded(fmi2Component c, const Call& call, Body&& body) noexcept {
  if (!c) return fmi2Error;
  Instance& self = *static_cast<Instance*>(c);
  const OneCall one(self, call.name);
  if (!one.is_alone()) return fmi2Error;
  try {
    if (!(call.permitted & self.state) || !(call.side & self.side())) {
      throw Refusal(forbidden_text(call, self.state, self.side()));
    }
    return body(self);
  } catch (const Discard& e) {
    self.logger.write(fmi2Discard, kLogDiscard, e.what());
    return fmi2Discard;
  } catch (const std::bad_alloc&) {
    self.logger.error("out of memory");
  } catch (const std::exception& e) {
    self.logger.error(e.what());
  } catch (...) {
    self.logger.error("unknown failure");
  }
  return fmi2Error;
}

/// fmi2Get*Status for an unsupported kind.
fmi2Status no_such_status(Instance& self, const Call& call) {
  self.logger.write(fmi2Discard, kLogDiscard,
                    std::string(call.name) + ": this kind of status is not supported");
  return fmi2Discard;
}

const SavedInstance& saved_state(fmi2FMUstate saved, const char* function) {
  if (!saved) throw Refusal(std::string(function) + ": the state is null");
  return *static_cast<const SavedInstance*>(saved);
}

[[noreturn]] void refuse_value(const std::string& name, double value) {
  throw Refusal(name + " = " + shortest(value) + describe_unusable(value));
}

void check_evaluated(const Instance& self, const Status& status, const char* function) {
  if (status.ok()) return;
  throw Discard(std::string(function) + ": " + self.sim.describe(status) + ": make a smaller step");
}

void check_finite(const Variable& v, double derivative, const char* function) {
  if (!std::isfinite(derivative)) {
    throw Refusal(std::string(function) + ": '" + v.name + "' has no derivative here");
  }
}

/// Arrays over the continuous states. Computes the start state if necessary.
void check_count(Instance& self, const void* array, size_t n, const char* function) {
  check_arrays(array, n, array, function);
  if (n != static_cast<size_t>(self.sim.state_count())) {
    throw Refusal(std::string(function) + ": there are " + std::to_string(self.sim.state_count()) +
                  " continuous states, not " + std::to_string(n));
  }
  if (self.state == kInitializationMode) self.initialise();
}

Scene read_scene_file(const std::string& location) {
  const std::string name = resource_folder(location) + "/model.json";
  std::ifstream file(std::filesystem::u8path(name),
                     std::ios::binary);  // Windows: UTF-8, not its code page
  if (!file) throw Refusal("cannot read '" + name + "' (fmuResourceLocation '" + location + "')");
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return read_scene(text, name);
}

std::unique_ptr<Instance> make_instance(const char* name, fmi2Type type, const char* guid,
                                        const char* location, Logger logger) {
  if (!name || !*name) throw Refusal("instanceName is missing");
  if (type != fmi2CoSimulation && type != fmi2ModelExchange) {
    throw Refusal("fmuType must be 0 (model exchange) or 1 (co-simulation)");
  }
  if (!guid) throw Refusal("fmuGUID is missing");
  if (!location) throw Refusal("fmuResourceLocation is missing");
  auto scene = std::make_shared<const Scene>(read_scene_file(location));
  if (type == fmi2ModelExchange && !offers_model_exchange(*scene)) {
    throw Refusal(
        "a vehicle of this scene is driven at communication points, so this FMU is for "
        "co-simulation only: set the scene keys chaser.motion and target.motion to \"free\" "
        "or \"fixed\" and build it again for model exchange");
  }
  const FmiKind fmi_kind =
      type == fmi2CoSimulation ? FmiKind::kCoSimulation : FmiKind::kModelExchange;
  auto instance = std::make_unique<Instance>(std::move(scene), fmi_kind, std::move(logger));
  if (guid != instance->guid) {
    throw Refusal(std::string("fmuGUID is '") + guid + "', but this FMU is '" + instance->guid +
                  "': modelDescription.xml and resources belong to different builds");
  }
  instance->load_kernel(resource_folder(location));
  return instance;
}

}  // namespace
}  // namespace dockloop

#if defined(__ELF__) && defined(__clang__)
// Compilers with their own runtime (zig) omit the code that runs destructors of statics when a
// library is unloaded. The destructors would run at the end of the process, after the code was
// unloaded. A second call has no effect.
extern "C" {
extern void* __dso_handle;
void __cxa_finalize(void*);
}
namespace {
__attribute__((destructor)) void finish_statics() { __cxa_finalize(&__dso_handle); }
}  // namespace
#endif

// ---------------------------------------------------------------- exported functions

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

void fmi2FreeInstance(fmi2Component c) {
  if (!c) return;
  Instance& self = *static_cast<Instance*>(c);
  if (OneCall(self, "fmi2FreeInstance").is_alone()) delete &self;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start_time, fmi2Boolean stop_time_defined,
                               fmi2Real stop_time) {
  return guarded(c, call::kSetupExperiment, [&](Instance& self) {
    if (!is_usable(start_time)) refuse_value("fmi2SetupExperiment: startTime", start_time);
    if (stop_time_defined && !std::isfinite(stop_time)) {
      throw Refusal("fmi2SetupExperiment: stopTime is not finite");
    }
    if (stop_time_defined && !(stop_time >= start_time)) {
      throw Refusal("fmi2SetupExperiment: stopTime " + shortest(stop_time) +
                    " s is before startTime " + shortest(start_time) + " s");
    }
    if (tolerance_defined && !(tolerance > 0.0 && tolerance < 1.0)) {
      throw Refusal("fmi2SetupExperiment: tolerance is " + shortest(tolerance) +
                    ", but must lie between 0 and 1");
    }
    self.setup(start_time, tolerance_defined ? tolerance : 0.0,
               stop_time_defined && stop_time <= kLargestValue ? stop_time : Instance::kNoStop);
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
    self.state = self.side() == kForCoSimulation ? kStepComplete : kEventMode;
    return fmi2OK;
  });
}

fmi2Status fmi2Terminate(fmi2Component c) {
  return guarded(c, call::kTerminate, [](Instance& self) {
    if (self.initialised) self.log_left_out();
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
    throw Refusal("fmi2CancelStep: no step is pending, because fmi2DoStep always finishes");
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

// Saved states

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* saved) {
  return guarded(c, call::kGetFMUstate, [&](Instance& self) {
    check_arrays(saved, 1, saved, "fmi2GetFMUstate");
    if (*saved) {
      self.save(*static_cast<SavedInstance*>(*saved));
    } else {
      auto created = std::make_unique<SavedInstance>();
      self.save(*created);
      *saved = created.release();
    }
    return fmi2OK;
  });
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved) {
  return guarded(c, call::kSetFMUstate, [&](Instance& self) {
    self.load(saved_state(saved, "fmi2SetFMUstate"));
    return fmi2OK;
  });
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* saved) {
  return guarded(c, call::kFreeFMUstate, [&](Instance&) {
    if (!saved) return fmi2OK;  // nothing to free, like a null state
    delete static_cast<SavedInstance*>(*saved);
    *saved = nullptr;
    return fmi2OK;
  });
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate saved, size_t* size) {
  return guarded(c, call::kSerializedFMUstateSize, [&](Instance&) {
    check_arrays(size, 1, size, "fmi2SerializedFMUstateSize");
    *size = serialise(saved_state(saved, "fmi2SerializedFMUstateSize")).size();
    return fmi2OK;
  });
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate saved, fmi2Byte bytes[],
                                 size_t size) {
  return guarded(c, call::kSerializeFMUstate, [&](Instance&) {
    check_arrays(bytes, 1, bytes, "fmi2SerializeFMUstate");
    const std::vector<char> all = serialise(saved_state(saved, "fmi2SerializeFMUstate"));
    if (size < all.size()) {
      throw Refusal("fmi2SerializeFMUstate: " + std::to_string(all.size()) +
                    " bytes are needed, but there is room for " + std::to_string(size));
    }
    std::copy(all.begin(), all.end(), bytes);
    return fmi2OK;
  });
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate* saved) {
  return guarded(c, call::kDeSerializeFMUstate, [&](Instance& self) {
    check_arrays(bytes, 1, bytes, "fmi2DeSerializeFMUstate");
    check_arrays(saved, 1, saved, "fmi2DeSerializeFMUstate");
    auto read = std::make_unique<SavedInstance>();
    deserialise(bytes, size, self.guid, *read);
    if (*saved) {
      *static_cast<SavedInstance*>(*saved) = std::move(*read);
    } else {
      *saved = read.release();
    }
    return fmi2OK;
  });
}

// Derivatives

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  return guarded(c, call::kSetRealInputDerivatives, [&](Instance& self) {
    const char* function = call::kSetRealInputDerivatives.name;
    check_arrays(vr, n, value, function);
    check_arrays(vr, n, order, function);
    for (size_t i = 0; i < n; ++i) {
      const Variable& v = row<Type::kReal>(self, vr[i], function);
      const auto refuse = [&](const std::string& why) {
        throw Refusal(std::string(function) + ": " + quoted(v, vr[i]) + why);
      };
      if (v.causality != Causality::kInput) refuse(" is not an input");
      if (order[i] != 1)
        refuse(": only derivatives of order 1 are used, not of order " + std::to_string(order[i]));
      if (!is_usable(value[i])) {
        refuse_value(std::string(function) + ": the derivative of " + quoted(v, vr[i]), value[i]);
      }
    }
    for (size_t i = 0; i < n; ++i) *self.variables[vr[i]].slope = value[i];
    return fmi2OK;
  });
}
/// Order 1 is exact. Higher orders are zero, as the standard requires for unsupported orders.
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  return guarded(c, call::kGetRealOutputDerivatives, [&](Instance& self) {
    const char* function = call::kGetRealOutputDerivatives.name;
    check_arrays(vr, n, value, function);
    check_arrays(vr, n, order, function);
    for (size_t i = 0; i < n; ++i) {
      const Variable& v = row<Type::kReal>(self, vr[i], function);
      if (v.causality != Causality::kOutput) {
        throw Refusal(std::string(function) + ": " + quoted(v, vr[i]) + " is not an output");
      }
      if (order[i] < 1) {
        throw Refusal(std::string(function) + ": order " + std::to_string(order[i]) +
                      " is not a derivative");
      }
    }
    if (n == 0) return fmi2OK;
    check_evaluated(self, self.sim.calc_time_derivative(), function);
    const auto find = [&](size_t i) {
      const int place = self.variables[vr[i]].output;  // other outputs change only at events
      return place < 0 || order[i] > 1 ? 0.0 : self.sim.output_derivative(place);
    };
    for (size_t i = 0; i < n; ++i) check_finite(self.variables[vr[i]], find(i), function);
    for (size_t i = 0; i < n; ++i) value[i] = find(i);
    return fmi2OK;
  });
}

/// The sum over the knowns of (partial derivative of the unknown) x seed.
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference known[],
                                        size_t knowns, const fmi2Real seed[], fmi2Real value[]) {
  return guarded(c, call::kGetDirectionalDerivative, [&](Instance& self) {
    const char* function = call::kGetDirectionalDerivative.name;
    check_arrays(unknown, unknowns, value, function);
    check_arrays(known, knowns, seed, function);
    std::vector<Seed> direction;
    for (size_t i = 0; i < knowns; ++i) {
      const Variable& v = row<Type::kReal>(self, known[i], function);
      if (v.input < 0 && v.state < 0) {
        throw Refusal(std::string(function) + ": " + quoted(v, known[i]) +
                      " is neither an input nor a continuous state");
      }
      if (!std::isfinite(seed[i])) {
        throw Refusal(std::string(function) + ": the seed of " + quoted(v, known[i]) +
                      " is not a finite number");
      }
      direction.push_back(v.input >= 0 ? Seed{Seed::Of::kInput, v.input, seed[i]}
                                       : Seed{Seed::Of::kState, v.state, seed[i]});
    }
    for (size_t i = 0; i < unknowns; ++i) {
      const Variable& v = row<Type::kReal>(self, unknown[i], function);
      if (v.rate < 0 && v.causality != Causality::kOutput) {
        throw Refusal(std::string(function) + ": " + quoted(v, unknown[i]) +
                      " is neither an output nor the derivative of a state");
      }
    }
    if (unknowns == 0) return fmi2OK;
    if (self.state == kInitializationMode) self.initialise();
    check_evaluated(self, self.sim.calc_directional_derivative(direction), function);
    const auto find = [&](size_t i) {
      const Variable& v = self.variables[unknown[i]];
      if (v.rate >= 0) return self.sim.rate_derivative(v.rate);
      return v.output < 0 ? 0.0 : self.sim.output_derivative(v.output);
    };
    for (size_t i = 0; i < unknowns; ++i)
      check_finite(self.variables[unknown[i]], find(i), function);
    for (size_t i = 0; i < unknowns; ++i) value[i] = find(i);
    return fmi2OK;
  });
}

// Model exchange

fmi2Status fmi2EnterEventMode(fmi2Component c) {
  return guarded(c, call::kEnterEventMode, [](Instance& self) {
    self.state = kEventMode;
    return fmi2OK;
  });
}
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo* info) {
  return guarded(c, call::kNewDiscreteStates, [&](Instance& self) {
    check_arrays(info, 1, info, "fmi2NewDiscreteStates");
    EventUpdate update;
    const Status status = self.sim.update_discrete_states(update);
    if (!status.ok()) {
      throw Refusal("fmi2NewDiscreteStates: " + self.sim.describe(status));
    }
    info->newDiscreteStatesNeeded = fmi2False;
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = update.nominals_changed;
    info->valuesOfContinuousStatesChanged = update.states_changed;
    info->nextEventTimeDefined = update.next_time_defined;
    info->nextEventTime = update.next_time;
    self.log_events();
    return fmi2OK;
  });
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
  return guarded(c, call::kEnterContinuousTimeMode, [](Instance& self) {
    self.state = kContinuousTimeMode;
    return fmi2OK;
  });
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean /*no_rollback*/,
                                       fmi2Boolean* enter_event_mode, fmi2Boolean* terminate) {
  return guarded(c, call::kCompletedIntegratorStep, [&](Instance& self) {
    check_arrays(enter_event_mode, 1, enter_event_mode, "fmi2CompletedIntegratorStep");
    check_arrays(terminate, 1, terminate, "fmi2CompletedIntegratorStep");
    bool due = false;
    check_evaluated(self, self.sim.complete_step(due), "fmi2CompletedIntegratorStep");
    *enter_event_mode = due ? fmi2True : fmi2False;
    *terminate = fmi2False;  // this FMU never ends a run from inside
    return fmi2OK;
  });
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
  return guarded(c, call::kSetTime, [&](Instance& self) {
    if (!is_usable(time)) refuse_value("fmi2SetTime: the time", time);
    self.sim.set_time(time);
    self.time = time;
    return fmi2OK;
  });
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  return guarded(c, call::kSetContinuousStates, [&](Instance& self) {
    check_count(self, x, n, "fmi2SetContinuousStates");
    for (size_t i = 0; i < n; ++i) {
      if (!is_usable(x[i])) {
        refuse_value("fmi2SetContinuousStates: state " + std::to_string(i + 1), x[i]);
      }
    }
    self.sim.set_states(x);
    return fmi2OK;
  });
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rates[], size_t n) {
  return guarded(c, call::kGetDerivatives, [&](Instance& self) {
    check_count(self, rates, n, "fmi2GetDerivatives");
    check_evaluated(self, self.sim.get_rates(rates), "fmi2GetDerivatives");
    return fmi2OK;
  });
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n) {
  return guarded(c, call::kGetEventIndicators, [&](Instance& self) {
    check_arrays(indicators, n, indicators, "fmi2GetEventIndicators");
    if (n != static_cast<size_t>(self.sim.indicator_count())) {
      throw Refusal("fmi2GetEventIndicators: there are " +
                    std::to_string(self.sim.indicator_count()) + " event indicators, not " +
                    std::to_string(n));
    }
    if (self.state == kInitializationMode) self.initialise();
    check_evaluated(self, self.sim.get_indicators(indicators), "fmi2GetEventIndicators");
    return fmi2OK;
  });
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
  return guarded(c, call::kGetContinuousStates, [&](Instance& self) {
    check_count(self, x, n, "fmi2GetContinuousStates");
    self.sim.get_states(x);
    return fmi2OK;
  });
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n) {
  return guarded(c, call::kGetNominals, [&](Instance& self) {
    check_count(self, nominals, n, "fmi2GetNominalsOfContinuousStates");
    self.sim.get_nominals(nominals);
    return fmi2OK;
  });
}

}  // extern "C"
