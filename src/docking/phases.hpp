// Phase and outcome of a docking, from relative motion and latches.
#pragma once

#include "docking/docking_model.hpp"
#include "docking/phase_limits.hpp"
#include "math/choice.hpp"

namespace dockloop {

/// Values of the variable `phase`. A mechanism with a sequence has the phase of its step. Without
/// one, phases 1 to 5 and 8 follow from motion and latches.
enum Phase {
  kApproach = 1,
  kContact,
  kCaptured,
  kAttenuating,
  kAligned,
  kRetracting,
  kHardDocked,
  kRebound,
  kUndocking,
  kSeparated,
  kHeldAfterFailure
};
inline const ChoiceList kPhases = {
    {kApproach, "approach", "before the first contact"},
    {kContact, "contact", "after first contact, not captured"},
    {kCaptured, "captured",
     "all latches hold, or the sequence states a grasp; the distance still decreases"},
    {kAttenuating, "attenuating", "captured, the motion has reversed at least once"},
    {kAligned, "aligned",
     "captured, at rest: below 1 mm/s for rings of 1.2 m, see phases.aligned_speed, and "
     "0.02 deg/s"},
    {kRetracting, "retracting", "a drive pulls the vehicles together; only in a sequence"},
    {kHardDocked, "hard_docked", "the vehicles are joined; only in a sequence"},
    {kRebound, "rebound",
     "gap increasing, above 50 mm for rings of 1.2 m, see phases.rebound_gap; no latch holds"},
    {kUndocking, "undocking", "the joint opens; only in a sequence"},
    {kSeparated, "separated", "after undocking; only in a sequence"},
    {kHeldAfterFailure, "held", "the sequence waits after a failure; only in a sequence"},
};

enum Outcome {
  kUndecided = 1,
  kOutcomeCaptured,
  kPartialCapture,
  kOutcomeRebound,
  kMiss,
  kDocked,
  kUndocked,
  kHangUp,
  kRetractionStalled,
  kTimedOut
};
inline const ChoiceList kOutcomes = {
    {kUndecided, "undecided", "no final outcome yet"},
    {kOutcomeCaptured, "captured", "all latches hold, or the sequence states a grasp"},
    {kPartialCapture, "partial capture", "some latches hold"},
    {kOutcomeRebound, "rebound", "contact and separation without a latch"},
    {kMiss, "miss", "the vehicles pass each other, or separate without contact"},
    {kDocked, "docked", "the vehicles are joined; stated by a sequence, as all that follow"},
    {kUndocked, "undocked", "separation after undocking"},
    {kHangUp, "hang-up", "at rest in contact, not captured"},
    {kRetractionStalled, "retraction stalled", "the drive is at its limit and does not move"},
    {kTimedOut, "timed out", "a step took longer than its time-out"},
};
/// Can a case end with this outcome? A partial capture may still become another one.
constexpr bool is_final(int outcome) { return outcome != kUndecided && outcome != kPartialCapture; }

/// Reason for no capture (yet).
enum CaptureReason {
  kNoReason = 1,
  kNotTouched,
  kInMotion,
  kBesideWindow,
  kHungUp,
  kTooSlow,
  kReasonRebound,
  kReasonMiss
};
inline const ChoiceList kCaptureReasons = {
    {kNoReason, "none", "captured"},
    {kNotTouched, "no contact", "so far"},
    {kInMotion, "in motion", "contact, and still moving"},
    {kBesideWindow, "beside window", "seated, but a striker is outside the window of its latch"},
    {kHungUp, "hung up", "at rest against a petal"},
    {kTooSlow, "too slow", "at rest, not seated, no petal in contact"},
    {kReasonRebound, "rebound", "the vehicles separated after contact"},
    {kReasonMiss, "miss", "the vehicles passed each other, or separate without contact"},
};

/// Position of the striker of a latch.
enum LatchReport { kFree = 1, kPushed, kInReach, kCaught, kLettingGo };
inline const ChoiceList kLatchReports = {
    {kFree, "free", "the striker does not touch the pawl"},
    {kPushed, "pushed", "the striker pushes the pawl from outside the lateral window"},
    {kInReach, "in reach", "the striker pushes the pawl within the window"},
    {kCaught, "held", ""},
    {kLettingGo, "releasing", ""},
};

/// Inputs of the phase logic, P relative to A unless stated.
struct PhaseInputs {
  PhaseLimits limits;
  double gap = 0.0;            ///< of the capture surfaces; above rebound_gap a lower bound [m]
  double axial = 0.0;          ///< of P relative to G, plus ContactModel::depth [m]
  double axial_rate = 0.0;     ///< [m/s]
  double speed = 0.0;          ///< of P relative to A [m/s]
  double angular_speed = 0.0;  ///< [rad/s]
  int latched = 0;             ///< latches that hold
  bool seated = false;         ///< every striker is deep enough for a catch
  bool on_petal = false;       ///< a petal or a group of surfaces carries load
};

constexpr double kGapRounding = 1e-6;    ///< of the gap at a located event [m]
constexpr double kAlignedRate = 3.5e-4;  ///< at rest below this angular rate, 0.02 deg/s [rad/s]

/// Update phase and outcome at an accepted step of a mechanism without a sequence.
void update_phase(const PhaseInputs& now, DiscreteState& state);

/// Updates the duration of seated rings without capture. At accepted steps. @param t  [s]
void update_seat(const PhaseInputs& now, double t, DiscreteState& state);

CaptureReason find_capture_reason(const PhaseInputs& now, const DiscreteState& state);

/// Positive while update_phase() would not change phase and outcome; falls through zero at a
/// change. Changes by contact and latches have their own event functions.
double find_phase_indicator(const PhaseInputs& now, const DiscreteState& state);

}  // namespace dockloop
