// From relative motion and latches to the words users think in: phase and outcome of a docking.
#pragma once

#include "dynamics/docking_model.hpp"

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
enum Outcome { kUndecided = 1, kOutcomeCaptured, kPartialCapture, kOutcomeRebound, kMiss };

/// What the phase logic looks at, P relative to A unless stated.
struct PhaseInputs {
  double gap = 0.0;            ///< of the capture surfaces [m]
  double axial = 0.0;          ///< of P relative to G [m]
  double axial_rate = 0.0;     ///< [m/s]
  double speed = 0.0;          ///< of P relative to A [m/s]
  double angular_speed = 0.0;  ///< [rad/s]
  int latched = 0;             ///< latches that hold
};

/// Limits of the phase logic (assumptions).
constexpr double kReboundGap = 0.05;     ///< open by this much and opening: rebound [m]
constexpr double kPassedDepth = 0.05;    ///< interface behind the ring without contact: miss [m]
constexpr double kAlignedSpeed = 1e-3;   ///< at rest below [m/s]
constexpr double kAlignedRate = 3.5e-4;  ///< and below this angular rate, 0.02 deg/s [rad/s]

/// Update phase and outcome at an accepted step.
void update_phase(const PhaseInputs& now, DiscreteState& state);

/// Positive while update_phase() would leave phase and outcome as they are, falls through zero
/// where it would not. Changes that contact and latches bring about have event functions of their
/// own.
double find_phase_indicator(const PhaseInputs& now, const DiscreteState& state);

}  // namespace dockloop
