// Phases and outcomes of a docking, from what update_phase() is shown.
// 1. approach, contact, captured, attenuating, aligned: in this order and only forwards;
// 2. rebound needs distance and departure, and is taken back by a new contact;
// 3. a miss needs no contact; some latches make a partial capture; a release undoes a capture.
#include "docking/phases.hpp"

#include <gtest/gtest.h>

namespace dockloop {
namespace {

class Phases : public ::testing::Test {
 protected:
  /// Update and return (phase, outcome).
  std::pair<int, int> see() {
    update_phase(now, state);
    return {state.phase, state.outcome};
  }
  static std::pair<int, int> is(int phase, int outcome) { return {phase, outcome}; }
  PhaseInputs now;
  DiscreteState state;

  void approach() {
    now.gap = 0.3;
    now.axial = 0.4;
    now.axial_rate = -0.1;
    now.speed = 0.1;
  }
  void touch() {
    approach();
    now.gap = -1e-4;
    now.axial = 0.1;
    state.contacted = true;
  }
};

TEST_F(Phases, start_with_an_undecided_approach) {
  approach();
  EXPECT_EQ(see(), is(kApproach, kUndecided));
}

TEST_F(Phases, contact_follows_the_first_touch) {
  touch();
  EXPECT_EQ(see(), is(kContact, kUndecided));
  now.gap = 0.01;  // a short hop is no rebound
  now.axial_rate = 0.05;
  EXPECT_EQ(see(), is(kContact, kUndecided));
}

TEST_F(Phases, run_from_capture_over_attenuation_to_alignment) {
  touch();
  see();
  state.captured = true;
  now.latched = 3;
  now.axial_rate = -0.05;
  EXPECT_EQ(see(), is(kCaptured, kOutcomeCaptured));
  now.axial_rate = 0.02;  // first reversal
  EXPECT_EQ(see(), is(kAttenuating, kOutcomeCaptured));
  now.axial_rate = -0.02;
  EXPECT_EQ(see(), is(kAttenuating, kOutcomeCaptured));
  now.speed = 0.5 * kAlignedSpeed;
  now.angular_speed = 2.0 * kAlignedRate;  // still turning
  EXPECT_EQ(see(), is(kAttenuating, kOutcomeCaptured));
  now.angular_speed = 0.5 * kAlignedRate;
  EXPECT_EQ(see(), is(kAligned, kOutcomeCaptured));
  now.speed = 1.0;  // aligned once is aligned
  EXPECT_EQ(see(), is(kAligned, kOutcomeCaptured));
}

TEST_F(Phases, a_capture_at_rest_is_not_aligned_before_it_was_attenuated) {
  touch();
  state.captured = true;
  now.speed = now.angular_speed = 0.0;
  now.axial_rate = 0.0;
  EXPECT_EQ(see(), is(kCaptured, kOutcomeCaptured));
  now.axial_rate = 1e-6;
  EXPECT_EQ(see(), is(kAligned, kOutcomeCaptured));
}

TEST_F(Phases, a_rebound_needs_distance_and_departure) {
  touch();
  see();
  now.gap = 2.0 * kReboundGap;
  now.axial_rate = -0.01;
  EXPECT_EQ(see(), is(kContact, kUndecided));
  now.axial_rate = 0.01;
  EXPECT_EQ(see(), is(kRebound, kOutcomeRebound));
}

TEST_F(Phases, a_rebound_lasts_until_the_surfaces_meet_again) {
  touch();
  now.gap = 2.0 * kReboundGap;
  now.axial_rate = 0.01;
  see();
  now.axial_rate = -0.01;  // thrust brings it back
  now.gap = 0.5 * kReboundGap;
  EXPECT_EQ(see(), is(kRebound, kOutcomeRebound));
  now.gap = -1e-5;
  EXPECT_EQ(see(), is(kContact, kUndecided));
}

TEST_F(Phases, a_rebound_can_end_in_capture) {
  touch();
  now.gap = 2.0 * kReboundGap;
  now.axial_rate = 0.01;
  see();
  state.captured = true;
  now.axial_rate = -0.01;
  EXPECT_EQ(see(), is(kCaptured, kOutcomeCaptured));
}

TEST_F(Phases, passing_without_contact_is_a_miss) {
  approach();
  now.axial = -2.0 * kPassedDepth;
  EXPECT_EQ(see(), is(kApproach, kMiss));
}

TEST_F(Phases, leaving_without_contact_is_a_miss_until_it_returns) {
  approach();
  now.axial_rate = 0.1;
  EXPECT_EQ(see(), is(kApproach, kMiss));
  now.axial_rate = -0.1;
  EXPECT_EQ(see(), is(kApproach, kUndecided));
}

TEST_F(Phases, some_latches_make_a_partial_capture_even_when_far_apart) {
  touch();
  now.latched = 1;
  EXPECT_EQ(see(), is(kContact, kPartialCapture));
  now.gap = 2.0 * kReboundGap;
  now.axial_rate = 0.1;
  EXPECT_EQ(see(), is(kContact, kPartialCapture));
}

TEST_F(Phases, a_released_capture_is_open_again) {
  touch();
  state.captured = true;
  now.latched = 3;
  see();
  state.captured = false;
  now.latched = 0;
  now.gap = 2.0 * kReboundGap;
  now.axial_rate = 0.1;
  EXPECT_EQ(see(), is(kRebound, kOutcomeRebound));
}

}  // namespace
}  // namespace dockloop
