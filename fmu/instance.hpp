// One instance of the FMU: a DockingSim with the life cycle, the checks and the log of FMI.
//
// Methods throw Refusal for impossible requests of a host. fmi2_functions.cpp turns a Refusal into
// one log line and fmi2Error. A refused call changes nothing.
#pragma once

#include <fmi2Functions.h>

#include <atomic>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "call_order.hpp"
#include "interface/variables.hpp"
#include "logger.hpp"
#include "sim/companion.hpp"
#include "sim/docking_sim.hpp"
#include "sim/sim_state.hpp"

namespace dockloop {

/// FMI status of a failed step: fmi2Discard if the host can repair the failure (smaller step,
/// corrected input), else fmi2Error. No other code decides this.
fmi2Status fmi_status(StatusCode code);

struct Refusal : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A trial state cannot be evaluated: the host must make a smaller step.
struct Discard : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Contents of an FMU state: the simulation, and the state of the instance.
struct SavedInstance {
  std::string guid;
  FmiKind fmi_kind = FmiKind::kCoSimulation;
  State state = kInstantiated;
  bool initialised = false;
  double start_time = 0.0, tolerance = 0.0, time = 0.0;
  bool has_stop_time = false;
  double stop_time = 0.0;
  int step_status = fmi2OK, phase = 0;
  SavedSim sim;
  std::vector<SavedCompanion> companion;  ///< one or none
};

struct Instance {
  static constexpr double kNoStop = std::numeric_limits<double>::infinity();
  Instance(std::shared_ptr<const Scene> scene, FmiKind fmi_kind, Logger log);

  /// Use the kernel in the FMU for this platform, if there is one. A warning is issued if the
  /// kernel cannot be loaded. Before initialise(). @param resources  folder, UTF-8
  void load_kernel(const std::string& resources);
  /// @param stop  end of the experiment, infinite if there is none [s]
  void setup(double t0, double wanted_tolerance, double stop);
  /// Compute the start state from parameters and start values, if they changed.
  void initialise();
  fmi2Status step(double t, double h);
  void reset();

  /// Address of the present value of a row. Computes its output group if out of date.
  const void* current(const Variable& v);
  /// Throws unless the row can be set now.
  void check_settable(const Variable& v, const char* function) const;
  /// After writing values. @param tunables  some are tunable. Throws if values contradict each
  /// other.
  void note_change(bool tunables);

  void save(SavedInstance& into) const;
  /// Throws, and changes nothing, if the state belongs to another FMU.
  void load(const SavedInstance& from);

  /// Log what accuracy has left out until now, and a measured error.
  void log_left_out();
  /// Log the warnings since the last call, and a change of phase (category logEvents).
  void log_events();
  /// Log the call that was refused because another one ran, if there was one.
  void log_refused() noexcept;

  /// See DockingSim::use_interruption(). Before initialise()
  void use_interruption(std::function<bool()> asks);

  void make_companion(bool wanted);

  bool before_start() const { return (state & kBeforeStart) != 0; }
  Side side() const {
    return sim.fmi_kind() == FmiKind::kCoSimulation ? kForCoSimulation : kForModelExchange;
  }

  Logger logger;
  DockingSim sim;
  std::unique_ptr<Companion> companion;  ///< measures the error; made by initialise()
  std::vector<Variable> variables;
  const std::string guid;
  std::shared_ptr<const KernelLibrary> kernels;  ///< in the FMU; may be null
  std::function<bool()> interruption;
  State state = kInstantiated;
  bool initialised = false;                ///< the start state fits the present parameters
  double start_time = 0.0;                 ///< [s]
  double tolerance = 0.0;                  ///< relative, of the host; 0 = none given
  double stop_time = kNoStop;              ///< [s] latest end of a step
  double time = 0.0;                       ///< [s] last communication point, by the host's clock
  fmi2Status step_status = fmi2OK;         ///< of the last fmi2DoStep
  int phase = 0;                           ///< as last logged
  std::string last_choice;                 ///< of accuracy, as last logged
  std::vector<std::string> last_warnings;  ///< last logged: an initialisation may be repeated
  /// Thread of the call that runs; none: no call runs. It guards this instance against a second
  /// one.
  std::atomic<std::thread::id> caller{};
  /// FMI function that was refused last because another call ran, until that is logged; or null.
  std::atomic<const char*> refused{nullptr};
};

/// A saved state as bytes, for another process: a header with its identity, and the contents.
std::vector<char> serialise(const SavedInstance& saved);
/// @throws Refusal or ModelError with the reason if these bytes are not a state of this FMU
void deserialise(const char* bytes, size_t size, const std::string& guid, SavedInstance& into);

}  // namespace dockloop
