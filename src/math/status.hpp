// Errors that can arise while a simulation runs: values, not exceptions.
//
// A step never throws. A Status names the failure and has the number that shows it. The FMU turns a
// Status into a log line and an fmi2Status. Errors of models and parameters are found before the
// run and are exceptions (ModelError).
#pragma once

#include <cstdio>
#include <stdexcept>
#include <string>

namespace dockloop {

enum class StatusCode {
  kOk = 0,
  kOutOfReach,          ///< a closed form has no real solution (radicand <= 0)
  kLoopSingular,        ///< loop matrix too close to singular
  kBranchChanged,       ///< assembly branch differs from the branch at initialisation
  kLoopNotClosed,       ///< Newton iteration did not converge
  kRedundancyLost,      ///< an equation left out as redundant is not satisfied any more
  kInertiaNotPositive,  ///< reduced inertia is not positive definite
  kContactTooDeep,      ///< rounded cores nearly touch: a smaller step is needed
  kContactFlipped,      ///< contact normal reversed: a surface was passed unseen
  kTravelOutsideTable,  ///< a force element is beyond the travel of its table
  kRateOutsideTable,    ///< the same, of its rates
  kIntegrationFailed,   ///< integrator could not meet its tolerance
  kNotFinite,           ///< NaN or infinity
  kSequenceChatters,    ///< steps of the sequence follow each other without end
  kBadInput,            ///< impossible input of the host; correct the input and repeat the step
  kCannotJoin,          ///< a rigid joint does not fit the scene
  kCouplingUnstable,    ///< a coupling has created energy: its reason is in the text
  kInterrupted,         ///< the user stopped the step; it may be made again
};

/// Outcome of an evaluation or a step. `index` is the loop, contact pair or element, `margin` the
/// normalised distance to the limit [-] (of a table: the travel or rate), `time` the time since the
/// start [s] if known, else 0.
struct Status {
  StatusCode code = StatusCode::kOk;
  int index = -1;
  double margin = 0.0;
  double time = 0.0;
  bool ok() const { return code == StatusCode::kOk; }
};

/// A model, scene or parameter that cannot be simulated. The text is one sentence for the user: it
/// names the file or element, the value, the limit and the remedy.
class ModelError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A real number in a message.
inline std::string describe_number(double value, int digits = 6) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

/// @throws ModelError "part: text" unless `ok`.
inline void require(const char* part, bool ok, const char* text) {
  if (!ok) throw ModelError(std::string(part) + ": " + text);
}

}  // namespace dockloop
