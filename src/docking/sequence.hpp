// Sequence of a docking as data: a table of steps, each with actions, conditions and a time-out.
//
// At every accepted state the rows of the present step are read in their order; the first row whose
// condition holds leads to its step, whose actions follow at once. A condition is a number that is
// positive while the condition is false: it is located like a contact (sim/sequence_logic.hpp).
// Everything that a run changes is in SequenceState and in the settings of laws.
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <variant>
#include <vector>

#include "math/choice.hpp"
#include "model/force_element.hpp"

namespace dockloop {

constexpr int kMaxSteps = 64;    ///< of a sequence
constexpr int kMaxRows = 8;      ///< of `next` of a step
constexpr int kMaxParts = 8;     ///< of all or any
constexpr int kMaxActions = 32;  ///< of a step
constexpr int kMaxChanges = 8;   ///< of the step at one instant

/// Values of the input `command`.
enum Command {
  kNoCommand = 1,
  kHold,
  kExtend,
  kRetract,
  kCloseHooks,
  kReleaseLatches,
  kUndock,
  kAbort
};
inline const ChoiceList kCommands = {
    {kNoCommand, "none", ""},
    {kHold, "hold", "drives that run keep their place, timers stop"},
    {kExtend, "extend", "for conditions of the sequence, as all that follow"},
    {kRetract, "retract", ""},
    {kCloseHooks, "close_hooks", ""},
    {kReleaseLatches, "release_latches", ""},
    {kUndock, "undock", ""},
    {kAbort, "abort", ""},
};

/// What a condition may measure. An index is one of `name[index]`, from 0; of an element it is the
/// element.
enum class Measured : int {
  kTime,  ///< in the step [s]
  kGap,
  kRelativePosition,
  kRelativeVelocity,
  kRelativeAxial,
  kRelativeLateral,
  kRelativePitchYaw,
  kRelativeRoll,
  kRelativeSpeed,         ///< of P with respect to A [m/s]
  kRelativeAngularSpeed,  ///< [rad/s]
  kCaptureAxial,          ///< P with respect to G, 0 where the capture interfaces meet [m]
  kCaptureAxialRate,      ///< [m/s]
  kCaptureTension,
  kCaptureCompression,
  kCaptureShear,
  kCaptureBending,
  kCaptureTorsion,
  kRingPosition,
  kLegLength,
  kLegRate,
  kLatchOpening,
  kLatchForce,
  kSurfaceForce,  ///< index of ContactModel::surfaces
  kElementCoordinate,
  kElementRate,
  kElementForce,
  kElementSaturation
};

/// One part of a condition.
struct Condition {
  enum class Kind { kBounds, kLatched, kLatchedBelow, kHooksClosed, kCommand };
  Kind kind = Kind::kBounds;
  Measured quantity = Measured::kTime;
  int index = 0;
  double low = -std::numeric_limits<double>::infinity();  ///< holds from low to high
  double high = std::numeric_limits<double>::infinity();
  int number = 0;  ///< of latches or hooks, or of the command
};

/// All parts, or any of them, for a time.
struct When {
  std::vector<Condition> parts;
  bool any = false;
  double dwell = 0.0;  ///< [s]
};

/// Where a step leads. @see Outcome
struct SequenceBranch {
  int go = -1;      ///< step, -1: stay
  int outcome = 0;  ///< 0: none is stated
};
struct SequenceRow : SequenceBranch {
  When when;
};

// Actions: each has the key by which files name it. To add one: its struct here and its place in
// Action; read_action() in sequence_json.cpp; act() in sim/sequence_logic.cpp.
// kMembers are the members that may stand next to the key.
constexpr std::array<const char*, 0> kNoMembers{};
constexpr std::array<const char*, 3> kLawMembers{"element", "elements", "law"};
constexpr std::array<const char*, 4> kLockMembers{"element", "elements", "stiffness", "damping"};

/// The contact thrust comes on after its delay, or goes off.
struct ThrustAction {
  static constexpr const char* kKey = "thrust";
  static constexpr auto kMembers = kNoMembers;
  bool on = false;
};

/// All latches release, or may catch again.
struct LatchesAction {
  static constexpr const char* kKey = "latches";
  static constexpr auto kMembers = kNoMembers;
  bool arm = false;
};

/// A mechanism without latches holds the target as it has closed around it, or lets go.
struct GraspAction {
  static constexpr const char* kKey = "grasp";
  static constexpr auto kMembers = kNoMembers;
  bool holds = false;
};

/// Drives run to a target, or are off.
struct RunAction {
  static constexpr const char* kKey = "run";
  static constexpr auto kMembers = kLawMembers;
  struct Drive {
    int law = 0;  ///< among the laws of all elements
    double speed = 0.0, acceleration = 0.0, deceleration = 0.0;
  };
  std::vector<Drive> drives;
  bool on = true;
  double target = 0.0;
};

/// Brakes engage or open.
struct EngagementAction {
  static constexpr const char* kKey = "engagement";
  static constexpr auto kMembers = kLawMembers;
  std::vector<int> laws;  ///< among the laws of all elements
  double engagement = 1.0;
};

/// Elements are held where they are, or free again.
struct LockAction {
  static constexpr const char* kKey = "lock";
  static constexpr auto kMembers = kLockMembers;
  std::vector<int> elements;
  ElementLock lock;  ///< open: free again
};

/// Hooks close as soon as the opening allows, or open.
struct HooksAction {
  static constexpr const char* kKey = "hooks";
  static constexpr auto kMembers = kNoMembers;
  bool close = false;
};

/// Pushers act, or are held back.
struct PushersAction {
  static constexpr const char* kKey = "pushers";
  static constexpr auto kMembers = kNoMembers;
  bool on = false;
};

/// Chaser, mechanism and target become one rigid body, or move as hooks and faces let them.
struct JointAction {
  static constexpr const char* kKey = "joint";
  static constexpr auto kMembers = kNoMembers;
  bool rigid = false;
};

using Action = std::variant<ThrustAction, LatchesAction, GraspAction, RunAction, EngagementAction,
                            LockAction, HooksAction, PushersAction, JointAction>;

struct SequenceStep {
  std::string name;
  int phase = 1;    ///< see Phase
  int outcome = 0;  ///< that entering the step states; 0: none
  std::vector<Action> actions;
  std::vector<SequenceRow> next;
  double timeout = 0.0;  ///< [s], 0: none
  SequenceBranch on_timeout;
};

struct Sequence {
  std::vector<SequenceStep> steps;
  int start = 0;
  bool empty() const { return steps.empty(); }
};

/// Has the sequence a rigid joint?
inline bool joins_vehicles(const Sequence& sequence) {
  for (const SequenceStep& step : sequence.steps) {
    for (const Action& action : step.actions) {
      const JointAction* joint = std::get_if<JointAction>(&action);
      if (joint && joint->rigid) return true;
    }
  }
  return false;
}

/// Largest number of rows of a step.
inline int count_rows(const Sequence& sequence) {
  size_t most = 0;
  for (const SequenceStep& step : sequence.steps) most = std::max(most, step.next.size());
  return static_cast<int>(most);
}

/// What changes of a sequence during a run. Times are those of its clock, which stands still while
/// the command is kHold.
struct SequenceState {
  int step = 0;
  double began = 0.0;                    ///< of the step [s]
  std::array<double, kMaxRows> since{};  ///< a row holds since then, for its dwell [s]; -1: not
  bool timed_out = false;
  int outcome = 0;             ///< stated last; 0: none
  bool was_captured = false;   ///< at the last state
  bool is_armed = true;        ///< latches that have released may catch again
  bool has_grasped = false;    ///< action
  double thrust_since = -1.0;  ///< action [s since the start], -1: off
  int command = kNoCommand;    ///< read last
  double held_since = 0.0;     ///< begin of the command kHold [s since the start]
  double stood = 0.0;          ///< the clock in all, without a command that still holds [s]
  double seen = 0.0;           ///< time of the last state [s since the start]
  double instant = -1.0;       ///< of the first of the last changes [s since the start]
  int changes = 0;             ///< since that instant
  std::array<int, kMaxChanges> visited{};  ///< the steps that they left
};

}  // namespace dockloop
