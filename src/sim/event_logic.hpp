// Events at accepted states: first contact, latches, capture, hooks, sequence, thrust, absorber,
// phase.
//
// The functions depend on the model, on one evaluated state and on the discrete state, and change
// the discrete state. They return the energy that an event dissipates; the caller adds this energy
// to the state. The functions neither integrate nor evaluate the equations of motion.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "docking/docking_model.hpp"
#include "docking/phases.hpp"
#include "sim/sequence_logic.hpp"
#include "sim/values.hpp"

namespace dockloop {

/// Event functions before those of latches, waiting hooks, the sequence and pushers.
constexpr int kFixedRoots = 3;
constexpr int kPusherRoots = 2;
constexpr int kMaxRoots = kFixedRoots + kMaxLatches + 1 + kMaxRows + kPusherRoots;
constexpr double kTouching = 1e-9;  ///< gap that counts as contact at the start [m]

class EventLogic {
 public:
  /// Keeps references to all three.
  EventLogic(const DockingModel& model, DiscreteState& discrete, ContactMemory& memory)
      : model_(&model), discrete_(discrete), memory_(memory), sequence_(model, discrete, memory) {}
  /// The same events in a changed copy of the model.
  void use_model(const DockingModel& model) {
    model_ = &model;
    sequence_.use_model(model);
  }
  SequenceLogic& sequence() { return sequence_; }
  const SequenceLogic& sequence() const { return sequence_; }

  int hook_root() const { return kFixedRoots + model_->latches.count(); }
  int first_row() const { return hook_root() + (model_->hard_dock.hooks.rows.empty() ? 0 : 1); }
  int pusher_root() const { return first_row() + sequence_.root_count(); }
  int root_count() const {
    return pusher_root() + (model_->hard_dock.pusher_count() > 0 ? kPusherRoots : 0);
  }
  bool has_surfaces() const { return model_->present[kTarget] && !model_->contact.empty(); }
  bool is_absorber() const { return model_->contact.kind == ContactModel::Kind::kAbsorber; }
  int count_held_latches() const;

  // Event functions between accepted states

  /// First contact (for an absorber every onset), release of an absorber, surfaces that open as far
  /// as a rebound, latches, waiting hooks, rows of the sequence; last, where the force of pushers
  /// begins to change within millimetres: nothing is decided there, but no step passes over it.
  /// @param at  its workspace of the contact search is used
  void calc_functions(DockingData<double>& at, double* roots) const;
  /// Largest rates of event functions that may be below zero between two states.
  void calc_speeds(const DockingData<double>& at, double* speeds) const;

  // Due events at the present state

  bool is_due(int root) const { return due_[static_cast<size_t>(root)] != 0; }
  void set_due(int root, bool due) { due_[static_cast<size_t>(root)] = due; }
  void clear_due() { due_.fill(0); }
  /// Events with a function not above `limit` are due.
  void set_due_below(DockingData<double>& at, double limit);
  /// Store the latches at the start of a fixed step.
  void note_latches(const DockingData<double>& at);
  /// The latches that a fixed step of size h has passed. @pre note_latches() at its start
  void find_passed_latches(const DockingData<double>& at, double h);
  void clear_passed() { passed_.fill(0); }

  // Changes of the discrete state. @param now  [s since the start]

  /// Update the first contact, if contact is due or present. @return whether this is the first one
  bool update_first_contact(const DockingData<double>& at, double now);
  void begin_contact(double now);
  /// An absorber acts from event to event; without a located event its depth and force decide.
  /// @return whether the absorber state changed
  bool update_absorber(const DockingData<double>& at);
  /// The same without a located event: at the start, and after a host has moved a vehicle. At a gap
  /// of zero the sign of the rate decides, not the rounding of the gap.
  bool decide_absorber(const DockingData<double>& at);
  /// Change the mode of every due latch, after a root or at the start.
  /// @param dissipated  increased by the dissipated energy [J]. @return whether a latch changed
  bool update_latches(const DockingData<double>& at, double now, double& dissipated);
  void update_capture(double now);
  /// At most one change of the sequence. @post none of its rows is due
  /// @param sums  as of Occasion
  SequenceChange update_sequence(DockingData<double>& at, double now, double clock_rounding,
                                 double* sums);
  /// Rows of hooks that begin to close, ramps that end. @param clock_rounding  of the host [s]
  /// @return whether a row changed
  bool update_hooks(const DockingData<double>& at, double now, double clock_rounding);
  /// @param clock_rounding  of the host [s]
  bool update_thrust(double now, double clock_rounding);
  /// Disturbances that act from now on. @return whether others did before
  bool update_disturbances(double now, double clock_rounding);
  /// Rows of input histories that act from now on. @return whether others did before
  bool update_inputs(double now, double clock_rounding);
  void update_phases(DockingData<double>& at, double now);
  /// The same for a copy of the discrete state, but for the phase of a sequence: it follows from
  /// events only. For a state that is read before it is booked.
  void update_phases(const PhaseInputs& in, double now, DiscreteState& state) const;

  // Results

  /// Contact thrust acts from its delay after first contact until capture, or as the sequence says.
  /// @return its onset [s since the start], if the thrust is to act
  std::optional<double> find_thrust_onset() const;
  bool is_thrust_due(double now, double clock_rounding) const;
  /// When the next one begins or ends; infinite: none is known. @param now  [s since the start]
  double find_next_disturbance(double now) const;
  /// When the next row of an input history begins to act; infinite: none is left.
  double find_next_input() const;
  DisturbingLoads find_disturbing_loads() const;
  /// Their means over a step of h that has been made. @param from  [s since the start]
  DisturbingLoads find_mean_disturbing_loads(double from, double h) const;
  /// Would anything change at this state? @param now, clock_rounding  as of update_thrust()
  bool is_change_due(DockingData<double>& at, double now, double clock_rounding) const;
  /// The gap of the surfaces, exact if positive and not above rebound_gap (PhaseLimits). Above, and
  /// after a capture, the result is a lower bound that depends on the last neighbour list.
  /// @param at  its workspace of the contact search is used
  double find_near_gap(DockingData<double>& at) const;
  /// @param gap  of the surfaces there, see find_near_gap()
  PhaseInputs find_phase_inputs(const DockingData<double>& at, double gap) const;
  LatchReport find_latch_report(const DockingData<double>& at, int latch) const;
  /// Lower bound of the distance to any contact force [m]; 0 while a latch is not open.
  /// @param exact_below  the gap is computed exactly if its bound is below this limit [m]
  double find_free_gap(DockingData<double>& at, double exact_below) const;

 private:
  /// Is a rebound possible? Its event function is then checked between accepted states.
  bool may_part() const;
  int find_acting(double now, double clock_rounding) const;
  template <class Share>
  DisturbingLoads add_disturbances(Share share) const;
  /// @param roots  the first two
  void calc_absorber_functions(const ContactResult<double>& contact, double* roots) const;
  /// Has a latch released, and must not catch again?
  bool is_disarmed(int latch) const;

  const DockingModel* model_;
  DiscreteState& discrete_;
  ContactMemory& memory_;
  SequenceLogic sequence_;
  std::array<char, kMaxRoots> due_{};
  std::array<char, kMaxLatches> passed_{};                 ///< due, if not at this state
  std::array<LatchMotion, kMaxLatches> latches_before_{};  ///< at the start of a fixed step
};

}  // namespace dockloop
