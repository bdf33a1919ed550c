// Which FMI function may be called when.
//
// One row per function with the states that permit it. A state is a bit, in the order an instance
// passes through them, so that the advice in the log line of a forbidden call follows from the row.
#pragma once

#include <string>

namespace dockloop {

enum State : unsigned {
  kInstantiated = 1,
  kInitializationMode = 2,
  kStepComplete = 4,
  kStepFailed = 8,  ///< fmi2DoStep returned fmi2Discard; still at the last communication point
  kTerminated = 16,
  kError = 32,  ///< fmi2DoStep returned fmi2Error
};

/// A function of the interface and where it may be called.
struct Call {
  const char* name;
  unsigned permitted;  ///< set of State
};

constexpr unsigned kAnyState = 63;
constexpr unsigned kBeforeStart = kInstantiated | kInitializationMode;
constexpr unsigned kRunning = kStepComplete | kStepFailed;
constexpr unsigned kStarted = kRunning | kTerminated | kError;

/// More than the standard demands is permitted where it can do no harm: start values can be read
/// back before the initialisation, and a discarded step can be tried again with a smaller step
/// size, because it has changed nothing.
namespace call {
inline constexpr Call kSetDebugLogging{"fmi2SetDebugLogging", kAnyState};
inline constexpr Call kSetupExperiment{"fmi2SetupExperiment", kInstantiated};
inline constexpr Call kEnterInitializationMode{"fmi2EnterInitializationMode", kInstantiated};
inline constexpr Call kExitInitializationMode{"fmi2ExitInitializationMode", kInitializationMode};
inline constexpr Call kTerminate{"fmi2Terminate", kRunning};
inline constexpr Call kReset{"fmi2Reset", kAnyState};
inline constexpr Call kGetReal{"fmi2GetReal", kAnyState};
inline constexpr Call kGetInteger{"fmi2GetInteger", kAnyState};
inline constexpr Call kGetBoolean{"fmi2GetBoolean", kAnyState};
inline constexpr Call kGetString{"fmi2GetString", kAnyState};
inline constexpr Call kSetReal{"fmi2SetReal", kBeforeStart | kRunning};
inline constexpr Call kSetInteger{"fmi2SetInteger", kBeforeStart | kRunning};
inline constexpr Call kSetBoolean{"fmi2SetBoolean", kBeforeStart | kRunning};
inline constexpr Call kSetString{"fmi2SetString", kBeforeStart | kRunning};
inline constexpr Call kGetFMUstate{"fmi2GetFMUstate", kAnyState};
inline constexpr Call kSetFMUstate{"fmi2SetFMUstate", kAnyState};
inline constexpr Call kFreeFMUstate{"fmi2FreeFMUstate", kAnyState};
inline constexpr Call kSerializedFMUstateSize{"fmi2SerializedFMUstateSize", kAnyState};
inline constexpr Call kSerializeFMUstate{"fmi2SerializeFMUstate", kAnyState};
inline constexpr Call kDeSerializeFMUstate{"fmi2DeSerializeFMUstate", kAnyState};
inline constexpr Call kGetDirectionalDerivative{"fmi2GetDirectionalDerivative",
                                                kInitializationMode | kStarted};
inline constexpr Call kSetRealInputDerivatives{"fmi2SetRealInputDerivatives",
                                               kBeforeStart | kRunning};
inline constexpr Call kGetRealOutputDerivatives{"fmi2GetRealOutputDerivatives", kStarted};
inline constexpr Call kDoStep{"fmi2DoStep", kRunning};
inline constexpr Call kCancelStep{"fmi2CancelStep", kRunning};
inline constexpr Call kGetStatus{"fmi2GetStatus", kStarted};
inline constexpr Call kGetRealStatus{"fmi2GetRealStatus", kStarted};
inline constexpr Call kGetIntegerStatus{"fmi2GetIntegerStatus", kStarted};
inline constexpr Call kGetBooleanStatus{"fmi2GetBooleanStatus", kStarted};
inline constexpr Call kGetStringStatus{"fmi2GetStringStatus", kStarted};
}  // namespace call

inline const char* name_of(State state) {
  switch (state) {
    case kInstantiated:
      return "instantiated";
    case kInitializationMode:
      return "initialization mode";
    case kStepComplete:
      return "step complete";
    case kStepFailed:
      return "step failed";
    case kTerminated:
      return "terminated";
    case kError:
      return "error";
  }
  return "";
}

/// One sentence for the log: what is forbidden, and which call leads to where it is permitted.
inline std::string forbidden_text(const Call& call, State state) {
  const bool state_lies_ahead = call.permitted > 2u * state - 1u;
  const char* advice = !state_lies_ahead        ? "fmi2Reset"
                       : state != kInstantiated ? "fmi2ExitInitializationMode"
                       : call.permitted & kInitializationMode
                           ? "fmi2EnterInitializationMode"
                           : "fmi2EnterInitializationMode and fmi2ExitInitializationMode";
  return std::string(call.name) + " is not permitted in state '" + name_of(state) + "': call " +
         advice + " first";
}

}  // namespace dockloop
