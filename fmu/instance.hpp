// One instance of the FMU: a DockingSim with the life cycle, the checks and the log of FMI.
//
// Methods throw Refusal where a host asks for something impossible; fmi2_functions.cpp turns that
// into one log line and fmi2Error. A refused call changes nothing.
#pragma once

#include <fmi2Functions.h>

#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "call_order.hpp"
#include "interface/variables.hpp"
#include "logger.hpp"
#include "sim/docking_sim.hpp"
#include "sim/sim_state.hpp"

namespace dockloop {

/// The one place that decides what a failed step means to the host: fmi2Discard when the host can
/// cure it (smaller step, corrected input), fmi2Error when it cannot.
fmi2Status fmi_status(StatusCode code);

struct Refusal : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A trial state cannot be evaluated: the host must take a smaller step.
struct Discard : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// What fmi2GetFMUstate keeps: the simulation, and where the instance stands in its life.
struct SavedInstance {
  std::string fingerprint;  ///< of the scene it belongs to
  FmiKind fmi_kind = FmiKind::kCoSimulation;
  State state = kInstantiated;
  bool initialised = false;
  double start_time = 0.0, tolerance = 0.0, time = 0.0;
  bool has_stop_time = false;
  double stop_time = 0.0;
  int step_status = fmi2OK, phase = 0;
  SavedSim sim;
};

struct Instance {
  static constexpr double kNoStop = std::numeric_limits<double>::infinity();
  Instance(std::shared_ptr<const Scene> scene, FmiKind fmi_kind, Logger log);

  /// Use the kernel that the FMU carries for this platform, if it does; one that cannot be loaded
  /// is a warning. Before initialise(). @param resources  folder, UTF-8
  void load_kernel(const std::string& resources);
  /// @param stop  end of the experiment, infinite if there is none [s]
  void setup(double t0, double wanted_tolerance, double stop);
  /// Start state from parameters and start values, if it is not there yet or one of them changed.
  void initialise();
  fmi2Status step(double t, double h);
  void reset();

  /// Where the present value of a row is; computes what it belongs to when that is out of date.
  const void* current(const Variable& v);
  /// Throws unless the row can be set now.
  void check_settable(const Variable& v, const char* function) const;
  /// Values were written, `tunables` among them or not. Throws if they cannot be used together.
  void note_change(bool tunables);

  void save(SavedInstance& into) const;
  /// Throws, and changes nothing, if it is the state of something else.
  void load(const SavedInstance& from);

  /// Warnings since the last call, and a change of phase for those who want to know.
  void log_events();

  bool before_start() const { return (state & kBeforeStart) != 0; }
  Side side() const {
    return sim.fmi_kind() == FmiKind::kCoSimulation ? kForCoSimulation : kForModelExchange;
  }

  Logger logger;
  DockingSim sim;
  std::vector<Variable> variables;
  State state = kInstantiated;
  bool initialised = false;                ///< the start state fits the present parameters
  double start_time = 0.0;                 ///< [s]
  double tolerance = 0.0;                  ///< relative, of the host; 0 = none given
  double stop_time = kNoStop;              ///< [s] no step may lead beyond it
  double time = 0.0;                       ///< [s] last communication point, by the host's clock
  fmi2Status step_status = fmi2OK;         ///< of the last fmi2DoStep
  int phase = 0;                           ///< as last logged
  std::vector<std::string> last_warnings;  ///< as last logged: an initialisation may be repeated
};

/// Bytes that restore in another process: a header that says what they are, and the contents.
std::vector<char> serialise(const SavedInstance& saved);
/// @throws Refusal or ModelError with the reason why these bytes are not a state of this FMU
void deserialise(const char* bytes, size_t size, const std::string& fingerprint,
                 SavedInstance& into);

}  // namespace dockloop
