// Errors that can arise while a simulation runs: values, not exceptions.
//
// The step path never throws. A Status names what went wrong and carries the number that shows it;
// the FMU turns it into a log line and an fmi2Status. Bad models and parameters are found at build
// time and are exceptions (ModelError), because there is no run to protect yet.
#pragma once

#include <stdexcept>
#include <string>

namespace dockloop {

enum class StatusCode {
  kOk = 0,
  kOutOfReach,          ///< a closed form has no real solution (radicand <= 0)
  kLoopSingular,        ///< loop matrix too close to singular
  kBranchChanged,       ///< assembly branch differs from the one at initialisation
  kLoopNotClosed,       ///< Newton iteration did not converge
  kRedundancyLost,      ///< an equation left out as redundant is not satisfied any more
  kInertiaNotPositive,  ///< reduced inertia is not positive definite
  kContactTooDeep,      ///< rounded cores about to meet: a smaller step is needed
  kContactFlipped,      ///< contact normal reversed: a surface was jumped over
  kIntegrationFailed,   ///< integrator could not meet its tolerance
  kNotFinite,           ///< NaN or infinity
  kBadInput,            ///< the host imposed something impossible; correct it and repeat the step
};

/// Outcome of an evaluation or a step. `index` is the loop or contact pair, `margin` the normalised
/// distance to the limit [-], `time` the time since the start [s] where it is known,
/// else 0.
struct Status {
  StatusCode code = StatusCode::kOk;
  int index = -1;
  double margin = 0.0;
  double time = 0.0;
  bool ok() const { return code == StatusCode::kOk; }
};

/// A model, scene or parameter that cannot be simulated. The text is one sentence for the user: it
/// names the file or element, the value, the limit and what to do.
class ModelError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// @throws ModelError "part: text" unless `ok`.
inline void require(const char* part, bool ok, const char* text) {
  if (!ok) throw ModelError(std::string(part) + ": " + text);
}

}  // namespace dockloop
