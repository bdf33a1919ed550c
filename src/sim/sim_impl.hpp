// Private parts of DockingSim, shared by the files of this folder:
//
//   start.cpp           from scene and parameters to the start state
//   method_setup.cpp    integrator, tolerances, step for real time
//   steps.cpp           communication steps and points, inputs
//   coupling.cpp        hosts of driven vehicles in a communication step
//   events.cpp          events at accepted states: contact, latches, sequence, coordinates
//   hard_docking.cpp    commands to hooks, pushers and rigid joint
//   model_exchange.cpp  the same equations for a host that integrates all states
//   outputs.cpp         outputs
//   derivatives.cpp     derivatives of outputs
//   failure_status.cpp  meaning of a Status, as a sentence
//   docking_sim.cpp     public functions; saving and restoring
//
// Parts with a class of their own: StepLoads, Evaluator, EventLogic, QuiescentMode, HostCoupling,
// BalanceWatch, StepLoop.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "docking/base_jump.hpp"
#include "docking/docking_jacobian.hpp"
#include "sim/accuracy.hpp"
#include "sim/docking_sim.hpp"
#include "sim/equations.hpp"
#include "sim/evaluator.hpp"
#include "sim/event_logic.hpp"
#include "sim/host_coupling.hpp"
#include "sim/outputs.hpp"
#include "sim/quiescent_mode.hpp"
#include "sim/step_loads.hpp"
#include "sim/step_loop.hpp"

namespace dockloop {

constexpr double kLookAgain = 0.7;  ///< factor of the margin for a new search of coordinates

/// Derivatives of all continuous outputs, along eight directions at a time.
struct DerivativePass {
  explicit DerivativePass(const DockingModel& model) : docking(model) {}
  DockingPass docking;
  Vec3<Derivative> frame_velocity, frame_shift;
  OutputValues<Derivative> output;
  /// Where an input acts; null: no output depends on it directly.
  struct Cell {
    Derivative* value = nullptr;
    double factor = 1.0;
  };
  std::vector<Cell> input_cells;                   ///< as for_each_value() counts them
  std::vector<Derivative*> output_cells;           ///< the same
  std::shared_ptr<const Coordinates> coordinates;  ///< coordinates of `docking`
};

struct DockingSim::Impl : SimState {
  Impl(std::shared_ptr<const Scene> scene, FmiKind fmi_kind, const Comparison* comparison);

  // start.cpp
  void clear();
  void initialise(double t0, double tolerance);
  void start(std::shared_ptr<const Setup> from);
  ContactLaw make_contact_law(const ContactLaw& from) const;
  void put_hardware(DockingModel& into) const;
  void choose_frame_O();
  void put_record_into_O(InputHistory& record) const;
  double find_approach_speed() const;
  void start_sequence();
  bool can_be_quiescent() const;
  bool can_drift() const;
  Status bring_joints_to_start();
  void set_start_state();
  void set_start_of_parts(double* y) const;
  void note_body(int vehicle, const VehicleBody& body);
  void warn_about_start();

  // method_setup.cpp
  double find_relative_tolerance() const;
  bool prefers_structured_matrix(double rtol) const;
  bool uses_structured_matrix(const RunMethod& method) const;
  bool makes_own_steps(const RunMethod& method) const;
  RunMethod choose_method() const;
  void make_loop();
  void attach_kernel();
  std::vector<double> find_absolute_tolerances() const;
  std::vector<double> find_absolute_tolerances(double position, double velocity,
                                               double energy) const;
  std::vector<double> find_judged_tolerances() const;
  double find_share_of_norm() const;
  double find_real_time_step(bool is_implicit);
  double find_rate_at_start();
  double find_struck_mass() const;
  double find_impacting_mass() const;
  void check_inner_step();

  // failure_status.cpp
  std::string describe(const Status& status) const;

  // steps.cpp
  Status step(double t, double h);
  double find_lateness(double t) const;
  std::string find_step_fault(double t, double h) const;
  Status begin_step(double h);
  void read_inputs();
  void read_tables(double tau);
  void read_loads(Inputs& from, double now, double begin);
  const Loads& find_mean_loads(double from, double h);
  void fall(double h);
  void advance_inputs(double h);
  Status finish_step(double h, bool was_pending);
  void update_mean_loads(double h, const CouplingPoint& begin, const CouplingPoint& end,
                         const Loads& known);
  Status settle();
  void settle_for_parameters();
  void update_due_mean_loads();
  Status balance_point();
  Status evaluate_point(bool may_lock = true);
  /// The communication point [s since start]
  double find_point_time() const { return elapsed + ahead.reached; }
  /// The workspace of evaluate_point().
  DockingData<double>& shown() const { return ahead.pending ? trial() : present(); }

  // coupling.cpp
  Status receive(double h);
  Status match_momenta(const std::array<bool, 2>& received,
                       const std::array<FrameMotion<double>, 2>& before,
                       const std::array<Wrench<double>, 2>& carried_before);
  std::array<Wrench<double>, 2> find_carried_momenta() const;
  bool is_mass_new(int vehicle) const;
  void use_stated_masses();
  bool use_host_bodies();
  void announce(double h);
  Status look_ahead(double h, CouplingPoint& now, CouplingPoint& begin, CouplingPoint& end);
  double find_contact_time() const;
  void notice_step(double h);
  double update_expected_step();
  void update_coupling();

  // events.cpp
  Status accept(double tau, bool& changed);
  void keep_pose();
  Status update_coordinates(double tau, bool& changed);
  void use_coordinates(std::shared_ptr<const Coordinates> choice);
  bool update_memory();
  Status decide_absorber();
  bool update_latches(double now);
  double find_clock_rounding(double now) const;
  bool update_outside_loads(double tau);
  bool update_table_command(double now);
  Status update_sequence(double tau, bool& changed, bool& jumped);
  Status update_command();
  Status evaluate(double tau, bool may_lock = true);
  Status evaluate_present();
  Status evaluate_start();
  void watch_limits(double now);
  void notice_limit(Limit which, double now, double value, double limit,
                    const std::string* part = nullptr);
  void warn_of_step_error(double now);

  // hard_docking.cpp
  const char* find_joint_obstacle() const;
  Status command(HardDockCommand command, double tau);
  bool is_hard_dock_command_new() const;
  Status update_hard_dock_command();
  Status update_joint(double tau);
  Status join_rigidly(double tau);
  Status release_joint(double tau);
  bool update_hooks(double now);
  void put_joined_target();

  // model_exchange.cpp
  Status calc_rates(double* ydot);
  bool is_event_due() const;

  // docking_sim.cpp
  void keep(Snapshot& into, bool with_pose = true) const;
  Status restore(const Snapshot& from);
  void save(SavedSim& into) const;
  void load(const SavedSim& from);
  void build_for(const SavedSim& from);
  void check_restored();
  std::string find_other_attitude(const double* y, bool (*is_right)(const Vec4<double>&)) const;
  void take(const SavedSim& from);
  bool are_tunables_new() const;
  void adopt_tunables();
  void use_tunables();
  void use_model(std::shared_ptr<DockingModel> changed);

  // outputs.cpp
  std::array<double, kPeakCount> find_peak_values(DockingData<double>& at) const {
    return dockloop::find_peak_values(*model, scene->rated, at);
  }
  std::array<double, kPeakCount> find_peak_values() const { return find_peak_values(present()); }
  std::array<double, kPeakCount> find_searched_peaks() const {
    return dockloop::find_searched_peaks(*model, scene->rated, present());
  }
  /// Present step of the sequence, from 1; 0 without a sequence.
  int find_sequence_step() const {
    return events->sequence().exists() ? discrete.sequence.step + 1 : 0;
  }
  double find_swing_bound() const;
  double find_acceleration_bound() const;
  double find_earliest_contact(double gap) const;
  Status update(OutputGroup group);
  double tell_time(double since_start) const;
  void update_main();
  void update_momentum();
  void update_loops();
  void update_stack();
  Status update_states();
  void update_phase_outputs();
  std::string describe_left_out() const;
  OutputSource<double> find_source() {
    return make_output_source(shown(), step_loop->point_y(), frame_velocity, frame_shift);
  }
  template <class S>
  OutputSource<S> make_output_source(DockingData<S>& at, const S* y, const Vec3<S>& velocity,
                                     const Vec3<S>& shift) const {
    return {*model,
            parameters,
            scene->rated,
            state_bodies,
            at,
            y,
            memory,
            frame_origin,
            velocity,
            shift,
            last_step > 0.0 || host->announces(),
            mean_load,
            energy_audit.host_work,
            energy_audit.start};
  }

  // derivatives.cpp
  Status start_pass();
  void seed(const Seed& seed, int lane);
  Status finish_pass();
  void spread_states(std::mt19937_64& random);
  void add_dependencies(Dependencies& found);

  void invalidate() { valid.fill(false); }
  /// Evaluations of the last accepted state, and of trial states of the integrator.
  DockingData<double>& present() const { return evaluator->present(); }
  DockingData<double>& trial() const { return evaluator->trial(); }
  bool has_surfaces() const { return events->has_surfaces(); }
  double* bristles() {
    return model->layout.bristle_count > 0 ? step_loop->y() + model->layout.bristles : nullptr;
  }

  std::shared_ptr<const Scene> scene;
  FmiKind fmi_kind;
  const Comparison* comparison;  ///< null: the core only
  Parameters parameters;
  Parameters parameters_before;  ///< load(): kept in case it fails, of the same sizes
  Inputs inputs;
  Inputs slopes;  ///< rates of the inputs over the coming step
  Outputs outputs;
  ListSizes list_sizes{};  ///< of outputs; fixed at construction
  std::array<bool, static_cast<size_t>(OutputGroup::kCount)> valid{};
  std::string status_text;
  std::vector<std::string> warnings;
  std::function<bool()> interruption;  ///< see DockingSim::use_interruption()
  std::string choice_text;             ///< what accuracy has chosen, or what was forgotten
  /// Communication points since the start, and times at which outputs were computed.
  std::int64_t points = 0, read_points = 0;

  // set by start(); the model is replaced for other tunable parameters or coordinates. Only bodies
  // of driven vehicles change in place (use_host_bodies).
  std::shared_ptr<const Setup> setup;    ///< null before start()
  SolverChoice chosen;                   ///< of the setup
  std::optional<double> measured_error;  ///< [-] of a companion (sim/companion.hpp)
  std::shared_ptr<DockingModel> model;
  std::unique_ptr<Equations> equations;          ///< null: those of the core
  std::unique_ptr<Mechanism> start_mechanism;    ///< in the coordinates of the start
  std::shared_ptr<const KernelLibrary> kernels;  ///< from the FMU; may be null
  std::unique_ptr<EventLogic> events;            ///< of model, discrete and memory
  std::unique_ptr<Evaluator> evaluator;
  std::unique_ptr<QuiescentMode> quiescent_mode;
  std::unique_ptr<HostCoupling> host;  ///< of driven vehicles
  std::unique_ptr<BalanceWatch> balances;
  std::unique_ptr<StepLoop> step_loop;  ///< owns the state y
  int state_count = 0;                  ///< of y; fixed at construction
  std::vector<int> state_bodies;        ///< joints of state.*: the independent ones at the start
  Vec3<double> frame_origin = Vec3<double>::Zero();  ///< O in N at the start [m]
  std::array<double, 2> least_inertia{};             ///< of the vehicles, about any axis [kg m2]
  std::array<double, 2> share_without_modes{1, 1};   ///< find_share_without_modes
  std::unique_ptr<DerivativePass> derivative_pass;   ///< made at the first call

  // scratch
  StepLoads loads;
  Inputs table_inputs;                           ///< inside a step, with histories of the scene
  std::unique_ptr<BaseJumpWorkspace> jump_work;  ///< with a driven vehicle only
  std::unique_ptr<Snapshot> look_ahead_start;    ///< only if loads are announced
  std::vector<double> rates;                     ///< for outputs
  DiscreteState discrete_inside;                 ///< with the phases inside a pending step
  bool pose_is_kept = false;  ///< step_start holds the accepted configuration of the loops
  Snapshot step_start;        ///< state to restore after a refused step
};

}  // namespace dockloop
