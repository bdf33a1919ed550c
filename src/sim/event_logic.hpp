// What happens at accepted states: first contact, latches, capture, thrust, absorber, phase.
//
// Everything here is a function of the model, of one evaluated state and of the discrete state,
// which it changes. Energy that an event takes from the system is returned, for the caller to book.
// Nothing here integrates, and nothing evaluates the equations of motion.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "docking/docking_model.hpp"
#include "docking/phases.hpp"
#include "sim/values.hpp"

namespace dockloop {

constexpr int kFixedRoots = 3;      ///< event functions before those of the latches
constexpr double kTouching = 1e-9;  ///< gap that counts as contact at the start [m]

class EventLogic {
 public:
  /// Keeps references to all three.
  EventLogic(const DockingModel& model, DiscreteState& discrete, ContactMemory& memory)
      : model_(model), discrete_(discrete), memory_(memory) {}

  int root_count() const { return kFixedRoots + model_.latches.count(); }
  bool has_surfaces() const { return model_.present[kTarget] && !model_.contact.empty(); }
  bool is_absorber() const { return model_.contact.kind == ContactModel::Kind::kAbsorber; }
  int count_held_latches() const;

  // Roots that are watched between accepted states

  /// First contact (for an absorber every onset), where an absorber ceases to act, surfaces that
  /// open as far as a rebound needs, latches. @param at  its workspace of the contact search is
  /// used
  void calc_functions(DockingData<double>& at, double* roots) const;
  /// How fast the event functions may change where they may be below zero between two states.
  void calc_speeds(const DockingData<double>& at, double* speeds) const;

  // Which of them are due at the present state

  bool is_due(int root) const { return due_[static_cast<size_t>(root)] != 0; }
  void set_due(int root, bool due) { due_[static_cast<size_t>(root)] = due; }
  void clear_due() { due_.fill(0); }
  /// Those whose function is not above `limit`.
  void set_due_below(DockingData<double>& at, double limit);
  /// A fixed step begins: where its latches are.
  void note_latches(const DockingData<double>& at);
  /// The latches that a fixed step of size h has passed. @pre note_latches() at its start
  void find_passed_latches(const DockingData<double>& at, double h);
  void clear_passed() { passed_.fill(0); }

  // Changes of the discrete state. @param now  [s since the start]

  /// Contact that is due, or is there. @return whether it is the first one
  bool update_first_contact(const DockingData<double>& at, double now);
  void begin_contact(double now);
  /// An absorber acts from event to event; where none was located, its depth and force decide.
  /// @return whether that changed
  bool update_absorber(const DockingData<double>& at);
  /// The same where no event was located: at the start, and where a host has moved a vehicle.
  /// Where surfaces just touch, what they are about to do counts, not the rounding of a gap.
  bool decide_absorber(const DockingData<double>& at);
  /// Change the mode of every latch that is due, by a root or because it starts there.
  /// @param dissipated  grows by the energy that is lost [J]. @return whether one changed
  bool update_latches(const DockingData<double>& at, double now, double& dissipated);
  void update_capture(double now);
  /// @param clock_rounding  of the host [s]
  bool update_thrust(double now, double clock_rounding);
  void update_phases(DockingData<double>& at, double now);

  // What follows from it

  /// Contact thrust acts from its delay after first contact until capture: when it begins or began
  /// [s since the start], if it is to act.
  std::optional<double> find_thrust_onset() const;
  bool is_thrust_due(double now, double clock_rounding) const;
  /// Would anything change at this state? @param now, clock_rounding  as of update_thrust()
  bool is_change_due(DockingData<double>& at, double now, double clock_rounding) const;
  /// The gap of the surfaces where it is positive and not above kReboundGap. Above, it is a lower
  /// bound: what the contact search knows, which depends on where it looked last. So it is after a
  /// capture, when nothing depends on it. @param at  its workspace of the contact search is used
  double find_near_gap(DockingData<double>& at) const;
  /// @param gap  of the surfaces there, see find_near_gap()
  PhaseInputs find_phase_inputs(const DockingData<double>& at, double gap) const;
  LatchReport find_latch_report(const DockingData<double>& at, int latch) const;
  /// Lower bound of the distance to any contact force [m]; 0 while a latch is not open.
  /// @param exact_below  the gap of the surfaces is found exactly where its bound is below [m]
  double find_free_gap(DockingData<double>& at, double exact_below) const;

 private:
  /// Is a rebound possible, which is watched between accepted states?
  bool may_part() const;

  const DockingModel& model_;
  DiscreteState& discrete_;
  ContactMemory& memory_;
  std::array<char, kFixedRoots + kMaxLatches> due_{};
  std::array<char, kMaxLatches> passed_{};                 ///< due, if not at this state
  std::array<LatchMotion, kMaxLatches> latches_before_{};  ///< at the start of a fixed step
};

}  // namespace dockloop
