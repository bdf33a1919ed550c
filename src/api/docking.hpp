// A docking in a program of C++: opened, set, stepped, read, saved, restored.
//
// Steps, checks and saved states are those of the FMU. `dl.Docking` of Python is this class with
// conversions. So results have the same bits everywhere, and a state saved by one is restored by
// the others. Several threads may share a docking: their calls wait for each other.
//
// This header needs the standard library alone (C++17). Errors are one sentence each, in exceptions
// derived from std::runtime_error.
#pragma once

#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace dockloop {

/// A document, a variable or a value is refused; nothing is changed.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A step failed. The docking is where it was before the step; a smaller step may succeed.
struct StepError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A variable, as modelDescription.xml of the FMU states it.
struct VariableFacts {
  std::string name;             ///< structured, a.b[1]
  std::string type;             ///< Real, Integer or Boolean
  std::string causality;        ///< parameter, input, output or local
  std::string variability;      ///< fixed, tunable, discrete or continuous
  std::string unit;             ///< of a Real, SI
  std::optional<double> start;  ///< what it is unless it is set; none: it is computed
  double min, max;              ///< inclusive; infinite: no limit
  std::string description;      ///< one line; for an Integer the meaning of every choice
};

/// What a run shall record, and when it ends before its last time.
struct RecordOrder {
  std::vector<double> times;  ///< communication points [s]; the first is the present time
  std::vector<int> rows;      ///< of variables
  double end_after_outcome = std::numeric_limits<double>::infinity();
  ///< the run ends when its outcome has been decided for this long [s]
  bool last_only = false;                ///< record the last point alone
  std::function<void(double)> progress;  ///< receives the finished part, some ten times a second
};

/// What a run has recorded: one row per communication point, or the last one alone.
struct Record {
  std::vector<double> values;  ///< row by row, shape (points, rows of the order)
  double step_time = 0.0;      ///< wall time inside the steps [s]
  double read_time = 0.0;      ///< wall time for outputs [s]
};

class Docking {
 public:
  /// Open a scene. @param document  file that `dockloop build SCENE -o FILE.json` writes; an FMU
  /// has it as resources/model.json. @throws UsageError naming file, member, value and limit
  explicit Docking(const std::filesystem::path& document);
  /// The same with the text of such a file. @param source  name of the file, for messages
  /// @param place  start where the conditions at first contact are met, if the scene states any
  Docking(const std::string& text, const std::string& source, bool place = false);
  Docking(Docking&&) noexcept;
  Docking& operator=(Docking&&) noexcept;
  ~Docking();

  /// Time of the last communication point [s].
  double time() const;
  /// Everything that can be read or set, row by row.
  std::vector<VariableFacts> variables() const;
  /// Rows of variables, for set() and get() in a loop: they save the search by name.
  /// @throws UsageError naming one that is not there
  std::vector<int> find(const std::vector<std::string>& names) const;

  /// Set all values or none, in the units of the variables. Before the first step: start values,
  /// parameters, inputs; afterwards inputs and tunable parameters. Integers and Booleans (0 or 1)
  /// are numbers, too. @param caller  named in messages. @throws UsageError
  void set(const std::vector<int>& rows, const std::vector<double>& values,
           const std::string& caller = "Docking.set");
  void set(const std::string& name, double value);
  /// Present values, in the units of the variables. @throws UsageError
  std::vector<double> get(const std::vector<int>& rows);
  double get(const std::string& name);

  /// End the setting of start values; the first step does it, too. @throws UsageError
  void start();
  /// Advance by one communication step. @param h  [s], above 0. @throws StepError, UsageError
  void step(double h);
  /// Step from time to time. @throws StepError, UsageError, and what `order.progress` throws
  Record record(const RecordOrder& order);
  /// Go back to the state after construction.
  void reset();

  /// All that decides the future.
  std::vector<char> save() const;
  /// Go on from a saved state, bit for bit, in any process. @throws UsageError unless it is a state
  /// of this scene
  void restore(const std::vector<char>& state);

  /// Rows of outputs that have derivatives: not what changes at events only.
  std::vector<int> differentiable() const;
  /// Exact partial derivatives at the present point. @param unknowns  rows of outputs and of rates
  /// of states. @param knowns  rows of inputs and states
  /// @return for each known those of all unknowns. @throws UsageError naming a row that is neither
  std::vector<double> derivatives(const std::vector<int>& unknowns, const std::vector<int>& knowns);

  /// Warnings since the last call.
  std::vector<std::string> take_warnings();
  /// What `accuracy` has chosen, and what log_left_out() has found, since the last call.
  std::vector<std::string> take_notes();
  /// Add a note about what `accuracy` has left out until now.
  void log_left_out();
  /// False: the capture surfaces never meet from the start that `place` has found.
  bool touches() const;
  /// @param asks  called ten times a second during a step; if it returns true, the step fails
  void use_interruption(std::function<bool()> asks);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dockloop
