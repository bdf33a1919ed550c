// The states in which an FMI function may be called.
//
// One row per function with its permitted states. A state is a bit. Bits have the order of the life
// of an instance, so the advice in the log line of a forbidden call follows from the row.
#pragma once

#include <string>

namespace dockloop {

enum State : unsigned {
  kInstantiated = 1,
  kInitializationMode = 2,
  kEventMode = 4,           ///< model exchange
  kContinuousTimeMode = 8,  ///< model exchange
  kStepComplete = 16,       ///< co-simulation
  kStepFailed = 32,         ///< fmi2DoStep returned fmi2Discard; still at the last point
  kTerminated = 64,
  kError = 128,  ///< fmi2DoStep returned fmi2Error
};
constexpr State kStates[] = {kInstantiated, kInitializationMode, kEventMode,  kContinuousTimeMode,
                             kStepComplete, kStepFailed,         kTerminated, kError};

/// FMI kinds of a function.
enum Side : unsigned { kForCoSimulation = 1, kForModelExchange = 2, kForBoth = 3 };

/// An FMI function and its permitted states.
struct Call {
  const char* name;
  unsigned permitted;  ///< set of State
  Side side = kForBoth;
};

constexpr unsigned kAnyState = 255;
constexpr unsigned kBeforeStart = kInstantiated | kInitializationMode;
constexpr unsigned kStepping = kStepComplete | kStepFailed;
constexpr unsigned kIntegrating = kEventMode | kContinuousTimeMode;
constexpr unsigned kRunning = kStepping | kIntegrating;
constexpr unsigned kStarted = kRunning | kTerminated | kError;

/// States of an instance of one FMI kind.
constexpr unsigned states_of(Side side) {
  return kAnyState & ~(side == kForCoSimulation ? kIntegrating : kStepping);
}

/// Some calls are permitted beyond the standard. Start values can be read before the
/// initialisation. A discarded step can be repeated with a smaller step size, because it has
/// changed nothing.
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
                                               kBeforeStart | kRunning, kForCoSimulation};
inline constexpr Call kGetRealOutputDerivatives{"fmi2GetRealOutputDerivatives", kStarted,
                                                kForCoSimulation};
inline constexpr Call kDoStep{"fmi2DoStep", kStepping, kForCoSimulation};
inline constexpr Call kCancelStep{"fmi2CancelStep", kStepping, kForCoSimulation};
inline constexpr Call kGetStatus{"fmi2GetStatus", kStarted, kForCoSimulation};
inline constexpr Call kGetRealStatus{"fmi2GetRealStatus", kStarted, kForCoSimulation};
inline constexpr Call kGetIntegerStatus{"fmi2GetIntegerStatus", kStarted, kForCoSimulation};
inline constexpr Call kGetBooleanStatus{"fmi2GetBooleanStatus", kStarted, kForCoSimulation};
inline constexpr Call kGetStringStatus{"fmi2GetStringStatus", kStarted, kForCoSimulation};

inline constexpr Call kEnterEventMode{"fmi2EnterEventMode", kIntegrating, kForModelExchange};
inline constexpr Call kNewDiscreteStates{"fmi2NewDiscreteStates", kEventMode, kForModelExchange};
inline constexpr Call kEnterContinuousTimeMode{"fmi2EnterContinuousTimeMode", kEventMode,
                                               kForModelExchange};
inline constexpr Call kCompletedIntegratorStep{"fmi2CompletedIntegratorStep", kContinuousTimeMode,
                                               kForModelExchange};
inline constexpr Call kSetTime{"fmi2SetTime", kIntegrating, kForModelExchange};
inline constexpr Call kSetContinuousStates{"fmi2SetContinuousStates", kContinuousTimeMode,
                                           kForModelExchange};
inline constexpr unsigned kEvaluable = kInitializationMode | kStarted;
inline constexpr Call kGetDerivatives{"fmi2GetDerivatives", kEvaluable, kForModelExchange};
inline constexpr Call kGetEventIndicators{"fmi2GetEventIndicators", kEvaluable, kForModelExchange};
inline constexpr Call kGetContinuousStates{"fmi2GetContinuousStates", kEvaluable,
                                           kForModelExchange};
inline constexpr Call kGetNominals{"fmi2GetNominalsOfContinuousStates", kEvaluable,
                                   kForModelExchange};
}  // namespace call

inline const char* name_of(State state) {
  switch (state) {
    case kInstantiated:
      return "instantiated";
    case kInitializationMode:
      return "initialization mode";
    case kEventMode:
      return "event mode";
    case kContinuousTimeMode:
      return "continuous-time mode";
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

/// One sentence for the log: the forbidden call, and the call to make first.
inline std::string forbidden_text(const Call& call, State state, Side side) {
  const std::string name = call.name;
  if (!(call.side & side)) {
    return name + (side == kForCoSimulation
                       ? " is for model exchange, but this instance is for co-simulation"
                       : " is for co-simulation, but this instance is for model exchange");
  }
  const unsigned permitted = call.permitted & states_of(side);
  const unsigned now = state;
  const bool lies_ahead = permitted > 2u * now - 1u;
  const char* advice = "fmi2Reset";
  if (state == kContinuousTimeMode && (permitted & kEventMode)) {
    advice = "fmi2EnterEventMode";
  } else if (lies_ahead && state == kEventMode) {
    advice = "fmi2EnterContinuousTimeMode";
  } else if (lies_ahead && state != kInstantiated) {
    advice = "fmi2ExitInitializationMode";
  } else if (lies_ahead) {
    advice = permitted & kInitializationMode
                 ? "fmi2EnterInitializationMode"
                 : "fmi2EnterInitializationMode and fmi2ExitInitializationMode";
  }
  return name + " is not permitted in state '" + name_of(state) + "': call " + advice + " first";
}

}  // namespace dockloop
