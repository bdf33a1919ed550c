// One docking simulation: the public class for the FMU and the C++ tests.
//
// Life cycle: construct from a scene -> edit parameters() -> initialise() -> { edit inputs(),
// step(), outputs() } ... All exceptions and allocations happen before the first step(). A step
// that fails returns a Status and leaves the state unchanged. In model exchange step() is not
// called: the host sets time and states and reads rates.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "docking/scene.hpp"
#include "math/status.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Integration by communication steps inside, or by the host.
enum class FmiKind : int { kCoSimulation = 1, kModelExchange = 2 };

/// Is model exchange possible? Not with driven vehicles, whose motion comes at communication
/// points.
bool offers_model_exchange(const Scene& scene);

/// Data for the host of a model exchange after an event.
struct EventUpdate {
  bool states_changed = false;    ///< the state vector has jumped
  bool nominals_changed = false;  ///< the meaning of its components has changed
  bool next_time_defined = false;
  double next_time = 0.0;  ///< [s] of the next time event
};

/// One component of a direction in the space of inputs and states.
struct Seed {
  enum class Of { kInput, kState } of = Of::kInput;
  int place = 0;        ///< as for_each_value() counts inputs, or in the state vector
  double weight = 1.0;  ///< unit of the component per unit of the direction
};

/// Lazy output groups: the first getter call of a group computes the whole group. (The scene key
/// [outputs] groups is something else: it selects the variables of the FMU.)
enum class OutputGroup {
  kMain,         ///< all other outputs
  kMomentum,     ///< sums over all bodies
  kLoops,        ///< gaps of loops
  kStack,        ///< all bodies as one
  kCoupling,     ///< monitors of the coupling with hosts: expensive
  kStateVector,  ///< and its rates
  kCount
};

/// Direct dependencies of continuous outputs and rates on inputs and states.
struct Dependencies {
  struct Row {
    std::vector<char> input, state;  ///< 0 or 1 per input, per state
  };
  std::vector<Row> output, rate;  ///< as for_each_value() counts outputs; per state
};

struct SavedSim;
class Comparison;
class KernelLibrary;

class DockingSim {
 public:
  /// @param comparison  methods beyond those of the core (sim/equations.hpp); outlives this object
  explicit DockingSim(std::shared_ptr<const Scene> scene, FmiKind fmi_kind = FmiKind::kCoSimulation,
                      const Comparison* comparison = nullptr);
  ~DockingSim();
  DockingSim(const DockingSim&) = delete;
  DockingSim& operator=(const DockingSim&) = delete;

  const Scene& scene() const;
  std::shared_ptr<const Scene> shared_scene() const;
  FmiKind fmi_kind() const;
  bool has_comparison() const;  ///< are there methods beyond those of the core?
  /// Read by initialise(); thrust, friction coefficient and restitution also at the start of a
  /// step.
  Parameters& parameters();
  Inputs& inputs();  ///< read at the start of every step()
  /// Rates of change of the inputs over the coming step, then zero again. Only loads have an
  /// effect; the equations of motion predict driven vehicles.
  Inputs& input_slopes();

  /// Build the model from scene and parameters and set the start state.
  /// @param t0 [s] start time; @param tolerance relative tolerance of the host, 0 = none given.
  /// @throws ModelError naming the parameter, its value and the limit.
  void initialise(double t0, double tolerance);

  /// Advance from t to exactly t + h. On failure the state is unchanged and status_text() gives
  /// the reason in one sentence.
  Status step(double t, double h);
  const std::string& status_text() const;
  /// @param asks  called before every inner step; true: the step is refused with kInterrupted.
  /// Before initialise()
  void use_interruption(std::function<bool()> asks);

  /// Values at the last communication point (model exchange: at the present time and states);
  /// computed once, at the first call.
  /// @return not ok if the host's trial states cannot be evaluated
  Status update(OutputGroup group);
  /// Groups main and bodies, at states where they cannot fail.
  const Outputs& outputs();
  /// The struct of all outputs; its address and vector sizes are fixed at construction.
  Outputs& output_storage();
  /// Mark the outputs as out of date (an input or a tunable parameter changed).
  void invalidate_outputs();
  /// The error of this run is measured: solver.error_estimate has it, until initialise() or
  /// reset(). None: the statistical value
  void state_error(std::optional<double> relative);
  /// The meaning of a Status, in one sentence.
  std::string describe(const Status& status) const;

  /// Take over parameters that may be changed during a run: thrust, friction coefficient,
  /// restitution, and mass and inertia of driven vehicles. @throws ModelError if they cannot be
  /// used
  void adopt_tunables();

  /// Back to the state after construction: parameters and inputs have the scene's values again.
  void reset();

  /// What accuracy has chosen, and why, in one sentence; empty without accuracy.
  const std::string& choice_text() const;
  /// With accuracy: what was left out since the start, and what that is worth; else empty.
  std::string left_out_text() const;

  /// Warnings gathered since the last call (parameters that break a rule of thumb, singular loops).
  std::vector<std::string> take_warnings();

  // Derivatives, exact (dual numbers), for the present branch of contact and latches

  /// @post output_derivative() and rate_derivative() return derivatives along the direction
  Status calc_directional_derivative(const std::vector<Seed>& direction);
  /// The same with time as direction: motion continues, inputs change by input_slopes().
  Status calc_time_derivative();
  double output_derivative(int place) const;  ///< as for_each_value() counts outputs
  double rate_derivative(int place) const;    ///< in the state vector
  /// Found by derivatives at random states, apart and in contact, in all modes of the latches.
  Dependencies find_dependencies();

  /// From the next initialise() on, the kernel of this library evaluates trial states, if the
  /// kernel was made for the mechanism with its parameters. Null: the core evaluates them.
  void use_kernels(std::shared_ptr<const KernelLibrary> library);

  // Saving and restoring (sim/sim_state.hpp)

  /// Save the complete state. Saving into the same object again allocates nothing.
  void save(SavedSim& into) const;
  /// Restore a complete state, bit for bit. Builds the model again for other parameters.
  /// @throws ModelError if the state does not fit this scene; then nothing has changed.
  void load(const SavedSim& from);

  // Model exchange: the state vector in the order of StateLayout

  int state_count() const;      ///< fixed at construction
  int indicator_count() const;  ///< fixed at construction
  void set_time(double t);
  /// @throws ModelError if a quaternion of an attitude is nearly zero; then nothing has changed
  void set_states(const double* y);
  void get_states(double* y) const;
  void get_nominals(double* nominal) const;
  /// @return not ok if the state cannot be evaluated: the host must try a smaller step.
  Status get_rates(double* ydot);
  /// An event is due when an indicator falls through zero.
  Status get_indicators(double* indicator);
  /// The present state is accepted. @return whether an event is due
  Status complete_step(bool& event_due);
  Status update_discrete_states(EventUpdate& update);

  struct Impl;  ///< sim/sim_impl.hpp

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace dockloop
