// One docking for Python: an instance of the FMU without FMI, addressed by rows of its variable
// table.
//
// Steps, checks and saved states are those of the FMU (fmu/instance.hpp), so results have its bits
// and a state saved by one is restored by the other. Nothing here knows Python.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "docking/placement.hpp"
#include "instance.hpp"

namespace dockloop {

/// A step that failed. The docking is where it was before the step.
struct StepError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Call `body`; what it throws begins with `source`.
template <class Body>
auto naming(const std::string& source, Body&& body) {
  try {
    return body();
  } catch (const ModelError& error) {
    const std::string text = error.what();
    if (text.find(source) != std::string::npos) throw;
    throw ModelError(source + ": " + text);
  }
}

/// Start states of both vehicles that lead to the conditions of a scene at first contact.
/// @throws ModelError naming the scene if there are none, or they are not finite
Placement place_vehicles(const Scene& scene, const std::string& source);

/// What a run has recorded: one row per communication point, or the last one alone.
struct Record {
  std::vector<double> values;  ///< row by row
  double step_time = 0.0;      ///< wall time inside the steps [s]
  double read_time = 0.0;      ///< wall time for outputs [s]
};

/// What a run shall record, and when it ends before its last time.
struct RecordOrder {
  std::vector<double> times;  ///< communication points [s]; the first is the present time
  std::vector<int> rows;      ///< of the variable table
  double end_after_outcome = std::numeric_limits<double>::infinity();
  ///< the run ends when its outcome has been decided for this long [s]
  bool last_only = false;                ///< record the last point alone
  std::function<void(double)> progress;  ///< receives the finished part, some ten times a second
};

class Docking {
 public:
  /// @param place  start where the conditions at first contact are met (placement.hpp)
  Docking(const std::string& document, const std::string& source, bool place);

  const std::vector<Variable>& variables() const { return instance_.variables; }
  /// Rows of variables. @throws ModelError naming one that is not there
  std::vector<int> find(const std::vector<std::string>& names) const;
  bool touches() const { return touches_; }
  double time() const { return instance_.time; }

  /// Set all values or none. Before the first step: start values, parameters, inputs; afterwards
  /// inputs and tunable parameters. @param caller  named in messages; empty: FMI functions
  void set(const std::vector<int>& rows, const std::vector<double>& values,
           const std::string& caller);
  /// Present values; integers and Booleans (0 or 1) as numbers.
  std::vector<double> get(const std::vector<int>& rows);
  /// Rows of outputs that have derivatives: not what changes at events only.
  std::vector<int> list_differentiable() const;
  /// Exact partial derivatives at the present point. @param unknowns  rows of outputs and of rates
  /// of states. @param knowns  rows of inputs and states
  /// @return for each known those of all unknowns. @throws ModelError naming a row that is neither
  std::vector<double> find_derivatives(const std::vector<int>& unknowns,
                                       const std::vector<int>& knowns);
  /// End the phase in which start values can be set; the first step does it too.
  void start();
  /// Go back to the state after construction.
  void reset();
  /// @throws StepError
  void step(double h);
  /// Step from time to time. @throws StepError, and what `order.progress` throws
  Record record(const RecordOrder& order);

  std::vector<char> save() const;
  void restore(const char* bytes, size_t size);
  std::vector<std::string> take_warnings();
  /// What accuracy has chosen, once per run, and what log_left_out() has found.
  std::vector<std::string> take_notes();
  /// Asked ten times a second during a step whether the user stops the step; empty: never.
  std::function<bool()> interruption;
  /// Held during a call: calls of several threads wait for each other. `order.progress` may call.
  std::recursive_mutex mutex;
  /// Add a note about what accuracy has left out until now.
  void log_left_out() { instance_.log_left_out(); }

 private:
  static void log(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                  fmi2String category, fmi2String message, ...);
  const Variable& row(int place) const { return variables().at(static_cast<size_t>(place)); }
  double read(const Variable& v);
  void step_to(double t);

  std::vector<std::string> log_, notes_;
  bool touches_ = true;
  fmi2CallbackFunctions callbacks_{};
  Instance instance_;
};

}  // namespace dockloop
