// Phase and outcome logic; see phases.hpp.
#include "docking/phases.hpp"

#include <algorithm>

namespace dockloop {
namespace {

bool is_open(const PhaseInputs& now) { return now.gap > now.limits.rebound_gap - kGapRounding; }

void update_after_capture(const PhaseInputs& now, DiscreteState& state) {
  // Captured while still closing; attenuating from the first reversal; aligned once at rest.
  if (state.phase < kCaptured || state.phase == kRebound) state.phase = kCaptured;
  if (state.phase == kCaptured && now.axial_rate > 0.0) state.phase = kAttenuating;
  if (state.phase == kAttenuating && now.speed < now.limits.aligned_speed &&
      now.angular_speed < kAlignedRate) {
    state.phase = kAligned;
  }
}

}  // namespace

void update_phase(const PhaseInputs& now, DiscreteState& state) {
  if (state.captured) {
    update_after_capture(now, state);
    state.outcome = kOutcomeCaptured;
    return;
  }
  if (!state.contacted) {
    state.phase = kApproach;
    const bool passed = now.axial < -now.limits.passed_depth;
    const bool leaving = is_open(now) && now.axial_rate > 0.0;
    state.outcome = passed || leaving ? kMiss : kUndecided;
    return;
  }
  const bool away = is_open(now) && now.axial_rate > 0.0;
  const bool passed = is_open(now) && now.axial < -now.limits.passed_depth;
  if (now.latched > 0) {
    state.phase = kContact;
    state.outcome = kPartialCapture;
  } else if (passed) {
    state.phase = kRebound;
    state.outcome = kMiss;
  } else if (away || (state.phase == kRebound && now.gap > 0.0)) {
    state.phase = kRebound;
    state.outcome = kOutcomeRebound;
  } else {
    state.phase = kContact;
    state.outcome = kUndecided;
  }
}

void update_seat(const PhaseInputs& now, double t, DiscreteState& state) {
  if (state.seated) state.seated_time += t - state.seen;
  state.seated = now.seated && !state.captured;
  state.seen = t;
}

CaptureReason find_capture_reason(const PhaseInputs& now, const DiscreteState& state) {
  if (state.captured) return kNoReason;
  if (state.outcome == kMiss) return kReasonMiss;
  if (!state.contacted) return kNotTouched;
  if (state.phase == kRebound) return kReasonRebound;
  if (now.seated) return kBesideWindow;
  if (now.speed >= now.limits.aligned_speed || now.angular_speed >= kAlignedRate) return kInMotion;
  return now.on_petal ? kHungUp : kTooSlow;
}

double find_phase_indicator(const PhaseInputs& now, const DiscreteState& state) {
  if (state.captured) {
    if (state.phase == kCaptured) return -now.axial_rate;
    if (state.phase != kAttenuating) return 1.0;
    return std::max(now.speed / now.limits.aligned_speed, now.angular_speed / kAlignedRate) - 1.0;
  }
  const double leaving =
      std::max(now.limits.rebound_gap - now.gap, -now.axial_rate);  // < 0: open and opening
  if (!state.contacted) {
    const double miss = std::min(now.axial + now.limits.passed_depth, leaving);
    return state.outcome == kMiss ? -miss : miss;
  }
  if (now.latched > 0) return 1.0;
  return state.phase == kRebound ? now.gap : leaving;
}

}  // namespace dockloop
