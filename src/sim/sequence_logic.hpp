// Steps of a sequence at accepted states; see docking/sequence.hpp.
//
// A condition is a number that is positive while it is false: for a bound, how far the quantity is
// from it; all parts: the largest of their numbers, any: the smallest. What does not change between
// accepted states (latches, commands, times) counts as +1 or -1. The integrator locates where the
// number of a row falls to zero. While a row waits for the end of its dwell, its event function is
// that of the end of the condition. Ends of dwells, time-outs and bounds of the time are known
// times: a step of the integrator ends there.
//
// A failure may delay the settings of a law. Until they arrive, at known times too, they wait in
// DiscreteState::late, and the old setting acts.
#pragma once

#include <optional>
#include <string>

#include "docking/docking_model.hpp"
#include "docking/phases.hpp"

namespace dockloop {

/// What an update of the sequence has changed.
struct SequenceChange {
  bool events = false;     ///< event functions: the integrator must restart
  bool step = false;       ///< the step: look again at this instant
  bool equations = false;  ///< forces or latches: evaluate again
  bool chatters = false;   ///< more than kMaxChanges at one instant: refuse
  double timed_out = 0.0;  ///< time-out of a step that has taken that long [s]
};

/// When actions follow: at this evaluated state.
struct Occasion {
  const DockingData<double>& at;
  double now;    ///< [s since the start]
  double* sums;  ///< of the state (see Sum), increased by the energy that actions release [J]
};

class SequenceLogic {
 public:
  /// Keeps references to all.
  SequenceLogic(const DockingModel& model, DiscreteState& discrete, const ContactMemory& memory)
      : model_(&model), discrete_(discrete), memory_(memory), state_(discrete.sequence) {}
  void use_model(const DockingModel& model) { model_ = &model; }

  bool exists() const { return !model_->sequence.empty(); }
  int root_count() const { return count_rows(model_->sequence); }
  /// Event functions of the rows of the present step, root_count() of them.
  void calc_functions(DockingData<double>& at, double* roots) const;
  /// How fast they change at most. Zero for rates and forces: nothing bounds their changes.
  /// @pre calc_functions
  void calc_speeds(const DockingData<double>& at, double* speeds) const;
  /// Where the integrator must stop next, after `now` [s since the start]; kNever: nowhere.
  double find_next_time(double now) const;
  /// Does the sequence change nothing until a command comes? Without a sequence: it does not.
  bool is_waiting() const;
  /// May a drive still gain speed after `now` [s since the start]? Its force depends on time then.
  bool are_drives_starting(double now) const;
  /// The contact thrust acts from here [s since the start].
  std::optional<double> find_thrust_onset() const;
  /// Time in the present step, by the clock of the sequence [s].
  double find_time_in_step(double now) const { return find_clock(now) - state_.began; }
  /// "'capture', 'align'": the steps of the last changes at one instant.
  std::string list_visited() const;

  /// Before the first step.
  void start();
  /// Enter a step: its actions follow. @param outcome  that the way to it states; 0: none
  void enter(int step, int outcome, const Occasion& occasion);
  /// Does a command of the host differ from the last one?
  bool is_new(int command) const { return exists() && command != state_.command; }
  /// A command of the host. @return is_new()
  bool update_command(int command, double now);
  /// Take the first step that is due, if one is.
  /// @param due  per row: its event function has fallen to zero
  /// @param clock_rounding  of times [s]
  /// @param sums  as of Occasion
  SequenceChange update(DockingData<double>& at, double now, double clock_rounding, const char* due,
                        double* sums);
  /// Would update() change anything?
  bool is_change_due(DockingData<double>& at, double now, double clock_rounding) const;
  /// Phase and outcome as the sequence has them. @param held  latches that hold
  void update_phase(int held);

 private:
  const SequenceStep& step() const {
    return model_->sequence.steps[static_cast<size_t>(state_.step)];
  }
  double find_clock(double now) const;
  double find_quantity(const Condition& part, DockingData<double>& at) const;
  double find_speed(const Condition& part, const DockingData<double>& at) const;
  double find_value(const Condition& part, DockingData<double>& at, double now) const;
  double find_value(const When& when, DockingData<double>& at, double now) const;
  bool is_timed_out(double now, double slack) const;
  int find_row(DockingData<double>& at, double now, double slack, const char* due,
               std::array<double, kMaxRows>& since) const;
  SequenceChange follow(const SequenceBranch& branch, const Occasion& occasion);
  /// What an action changes, and from when it acts.
  struct Change {
    LawSetting& setting;
    double arrival;  ///< [s since the start]
  };
  /// The setting of a law that an action changes; a failure may delay it.
  /// @param law  among the laws of all elements
  Change change_setting(int law, double now);
  /// Is a setting that was on its way due? @param at  [s since the start]
  bool is_arrival_due(double at) const;
  /// Settings that are due act. @return is_arrival_due()
  bool deliver(double at);
  SequenceChange take_step(DockingData<double>& at, double now, double slack, const char* due,
                           double* sums);
  /// Does the present step begin a failure?
  bool begins_something() const;
  void act(const ThrustAction& action, const Occasion& occasion);
  void act(const LatchesAction& action, const Occasion& occasion);
  void act(const GraspAction& action, const Occasion& occasion);
  void act(const RunAction& action, const Occasion& occasion);
  void act(const EngagementAction& action, const Occasion& occasion);
  void act(const LockAction& action, const Occasion& occasion);
  void act(const HooksAction& action, const Occasion& occasion);
  void act(const PushersAction& action, const Occasion& occasion);
  void act(const JointAction& action, const Occasion& occasion);

  const DockingModel* model_;
  DiscreteState& discrete_;
  const ContactMemory& memory_;
  SequenceState& state_;
};

}  // namespace dockloop
