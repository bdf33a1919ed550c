// From relative motion and latches to the words users think in: phase and outcome of a docking.
#pragma once

#include "docking/docking_model.hpp"
#include "math/choice.hpp"

namespace dockloop {

/// Numbers of the interface: phase 6 (retracting) and 7 (hard docked) need a retraction drive,
/// which no shipped mechanism has.
enum Phase {
  kApproach = 1,
  kContact,
  kCaptured,
  kAttenuating,
  kAligned,
  kRetracting,
  kHardDocked,
  kRebound
};
inline const ChoiceList kPhases = {
    {kApproach, "approach", "before the first touch"},
    {kContact, "contact", "the capture surfaces have touched, not all latches hold"},
    {kCaptured, "captured", "all latches hold, the interfaces still close"},
    {kAttenuating, "attenuating", "held, the motion has reversed at least once"},
    {kAligned, "aligned", "held and at rest: below 1 mm/s and 0.02 deg/s"},
    {kRetracting, "retracting", "needs a retraction drive, which the mechanism does not have"},
    {kHardDocked, "hard_docked", "as 6"},
    {kRebound, "rebound", "open by more than 50 mm and opening, no latch holds"},
};

enum Outcome { kUndecided = 1, kOutcomeCaptured, kPartialCapture, kOutcomeRebound, kMiss };
inline const ChoiceList kOutcomes = {
    {kUndecided, "undecided", "nothing final has happened"},
    {kOutcomeCaptured, "captured", "all latches hold"},
    {kPartialCapture, "partial capture", "some latches hold"},
    {kOutcomeRebound, "rebound", "touched and left again without a latch"},
    {kMiss, "miss", "leaving or passed by without a touch"},
};

/// Why there is no capture (yet).
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
    {kInMotion, "in motion", "touched and still moving"},
    {kBesideWindow, "beside window", "seated, but a striker is outside the window of its latch"},
    {kHungUp, "hung up", "at rest against a petal"},
    {kTooSlow, "too slow", "at rest, not seated, no petal in the way"},
    {kReasonRebound, "rebound", "the vehicles parted again"},
    {kReasonMiss, "miss", "they passed each other, or part without contact"},
};

/// Where the striker of a latch is.
enum LatchReport { kFree = 1, kPushed, kInReach, kCaught, kLettingGo };
inline const ChoiceList kLatchReports = {
    {kFree, "free", "the striker does not touch the pawl"},
    {kPushed, "pushed", "the striker pushes the pawl from outside the lateral window"},
    {kInReach, "in reach", "the striker pushes the pawl within the window"},
    {kCaught, "held", ""},
    {kLettingGo, "releasing", ""},
};

/// What the phase logic looks at, P relative to A unless stated.
struct PhaseInputs {
  double gap = 0.0;            ///< of the capture surfaces; above kReboundGap a lower bound [m]
  double axial = 0.0;          ///< of P relative to G [m]
  double axial_rate = 0.0;     ///< [m/s]
  double speed = 0.0;          ///< of P relative to A [m/s]
  double angular_speed = 0.0;  ///< [rad/s]
  int latched = 0;             ///< latches that hold
  bool seated = false;         ///< every striker is as deep as a catch needs
  bool on_petal = false;       ///< a petal carries load
};

/// Limits of the phase logic (assumptions).
constexpr double kReboundGap = 0.05;     ///< open by this much and opening: rebound [m]
constexpr double kGapRounding = 1e-6;    ///< of a gap where an event was located [m]
constexpr double kSeatedGap = 1e-3;      ///< seated rings touch, to this [m]
constexpr double kPassedDepth = 0.05;    ///< interface behind the ring without contact: miss [m]
constexpr double kAlignedSpeed = 1e-3;   ///< at rest below [m/s]
constexpr double kAlignedRate = 3.5e-4;  ///< and below this angular rate, 0.02 deg/s [rad/s]

/// Update phase and outcome at an accepted step.
void update_phase(const PhaseInputs& now, DiscreteState& state);

/// Adds up for how long the rings are seated without capture. At accepted steps. @param t  [s]
void update_seat(const PhaseInputs& now, double t, DiscreteState& state);

CaptureReason find_capture_reason(const PhaseInputs& now, const DiscreteState& state);

/// Positive while update_phase() would leave phase and outcome as they are, falls through zero
/// where it would not. Changes that contact and latches bring about have event functions of their
/// own.
double find_phase_indicator(const PhaseInputs& now, const DiscreteState& state);

}  // namespace dockloop
