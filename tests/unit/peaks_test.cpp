// Peaks between samples.
// 1. a damped cosine sampled irregularly: its largest value to 1e-6, far better than any sample;
// 2. the peak never falls, is never below a sample, and channels do not mix;
// 3. a kink or a jump does not make it overshoot; an announced one is not interpolated across;
// 4. a search finds the largest value in a step of any length, with few evaluations;
// 5. a tracker can be put back to what it was, and reports what is near a peak.
#include "sim/peaks.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <optional>
#include <string>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

TEST(Peaks, of_a_damped_cosine_between_irregular_samples_is_found_to_a_millionth) {
  TestRandom random(51);
  Residual refined;
  double worst_sample = 0.0;
  for (int trial = 0; trial < 300; ++trial) {
    const double omega = random.uniform(2.0, 20.0), decay = random.uniform(0.0, 0.2) * omega;
    const double phase = random.uniform(0.5, 2.0);
    const auto value = [&](double t) { return std::exp(-decay * t) * std::cos(omega * t - phase); };
    // d/dt = 0 at tan(omega t - phase) = -decay/omega.
    const double peak = value((phase - std::atan(decay / omega)) / omega);
    PeakTracker<1> tracker;
    double t = -1.0 / omega;  // about 85 samples per period, spaced unevenly by a factor 2
    double largest = value(t);
    tracker.start(t, {value(t)});
    while (t < (phase + 1.5) / omega) {
      t += random.uniform(0.05, 0.10) / omega;
      tracker.add(t, {value(t)});
      largest = std::max(largest, value(t));
    }
    refined.add((tracker.peak()[0].value - std::max(peak, value(-1.0 / omega))) / peak,
                "trial " + std::to_string(trial));
    worst_sample = std::max(worst_sample, 1.0 - largest / peak);
  }
  EXPECT_RESIDUAL_BELOW(refined, 1e-6);  // what is promised; measured 3.2e-7
  EXPECT_GT(worst_sample, 5e-4);         // what samples alone would miss
}

TEST(Peaks, never_fall_and_are_never_below_a_sample) {
  TestRandom random(52);
  PeakTracker<2> tracker;
  double t = 0.0, before = -1.0, largest = -1.0;
  tracker.start(t, {-1.0, 5.0});
  for (int i = 0; i < 5000; ++i) {
    t += random.uniform(1e-4, 1e-1);
    const double x = random.uniform(-1, 1);
    largest = std::max(largest, x);
    tracker.add(t, {x, 5.0});
    EXPECT_GE(tracker.peak()[0].value, before);
    EXPECT_GE(tracker.peak()[0].value, largest);
    EXPECT_EQ(tracker.peak()[1].value, 5.0);  // a constant stays what it is
    before = tracker.peak()[0].value;
  }
}

TEST(Peaks, do_not_overshoot_at_a_kink) {
  // |t| upside down with a corner at height 1: polynomials through samples would exceed it. The
  // lines on both sides meet at the corner.
  TestRandom random(53);
  Residual overshoot;
  for (int trial = 0; trial < 500; ++trial) {
    const double left = random.uniform(0.1, 3.0), right = random.uniform(0.1, 3.0);
    const auto value = [&](double t) { return 1.0 - (t < 0 ? -left * t : right * t); };
    double t = -0.5;
    PeakTracker<1> tracker;
    tracker.start(t, {value(t)});
    double spacing = 0.0;
    while (t < 0.5) {
      const double h = random.uniform(0.01, 0.02);
      spacing = std::max(spacing, h);
      t += h;
      tracker.add(t, {value(t)});
    }
    // In units of what the kink changes over one sample.
    overshoot.add(std::max(0.0, tracker.peak()[0].value - 1.0) / (spacing * std::max(left, right)));
  }
  EXPECT_RESIDUAL_BELOW(overshoot, 1e-12);  // of the change over one sample
}

TEST(Peaks, do_not_overshoot_at_a_jump_that_is_not_announced) {
  // Tension on a ring that leaves the other one: it rises more and more slowly, then is zero from
  // one step to the next. Steps are short there, and grow again.
  const double at = 0.4, after[] = {1e-6, 3e-6, 1e-3, 3e-2, 6e-2};
  const auto value = [&](double t) { return t < at ? t - t * t : 0.0; };
  for (const double left : {1.0, 1e-2, 1e-4}) {  // steps of 0.05, and the last one shorter
    PeakTracker<1> tracker;
    tracker.start(0.0, {0.0});
    for (int i = 1; i < 8; ++i) tracker.add(0.05 * i, {value(0.05 * i)});
    const double last = 0.35 + 0.05 * (1.0 - 1e-6) * left;
    tracker.add(last, {value(last)});
    for (const double h : after) tracker.add(at + h, {value(at + h)});
    EXPECT_GE(tracker.peak()[0].value, value(last)) << left;
    EXPECT_LE(tracker.peak()[0].value, at - at * at) << left;
    PeakTracker<1> far;  // no short steps
    far.start(0.0, {0.0});
    for (int i = 1; i < 20; ++i) far.add(0.05 * i - 0.025, {value(0.05 * i - 0.025)});
    EXPECT_NEAR(far.peak()[0].value, value(0.375),
                0.005);  // as much as the slope changes over a step
  }
}

TEST(Peaks, do_not_overshoot_on_a_plateau_behind_a_steep_onset) {
  // The fifth sample lies before the corner: the polynomial through all five would rise 4 % above
  // the plateau.
  const auto value = [](double t) { return t < -1.5 ? 0.0 : 1.0 - 1e-3 * t * t; };
  PeakTracker<1> tracker;
  tracker.start(-4.0, {value(-4.0)});
  for (int i = -3; i <= 4; ++i) tracker.add(i, {value(i)});
  EXPECT_NEAR(tracker.peak()[0].value, 1.0, scaled_tolerance(1e-12));  // measured 0
}

TEST(Peaks, are_exact_at_a_kink_that_is_announced) {
  PeakTracker<1> tracker;
  tracker.start(0.0, {0.0});
  for (int i = 1; i <= 10; ++i) tracker.add(0.1 * i, {0.1 * i});
  tracker.begin(1.0, {1.0});  // the slope changes here
  for (int i = 1; i <= 10; ++i) tracker.add(1.0 + 0.1 * i, {1.0 - 0.1 * i});
  EXPECT_EQ(tracker.peak()[0].value, 1.0);
}

TEST(Peaks, take_both_sides_of_a_jump_and_nothing_between) {
  PeakTracker<1> tracker;
  tracker.start(0.0, {0.0});
  for (int i = 1; i <= 5; ++i) tracker.add(0.1 * i, {0.0});
  tracker.begin(0.5, {2.0});  // onset of a damper
  for (int i = 1; i <= 10; ++i) tracker.add(0.5 + 0.1 * i, {2.0 - 0.15 * i});
  EXPECT_EQ(tracker.peak()[0].value, 2.0);
}

TEST(Peaks, are_searched_in_long_steps) {
  TestRandom random(54);
  Residual error;
  int evaluations = 0, searched = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const double omega = random.uniform(2.0, 20.0), decay = random.uniform(0.0, 0.1) * omega;
    const double phase = random.uniform(0.0, 1.0);
    const auto value = [&](double t) {
      const double sum = std::exp(-decay * t) * std::sin(omega * t);
      return std::array<double, 2>{sum, 2.0 + 0.5 * std::cos(omega * t - phase)};
    };
    const double peak[] = {value(std::atan2(omega, decay) / omega)[0], 2.5};
    PeakTracker<2> tracker;
    tracker.start(0.0, value(0.0));
    double t = 0.0;
    while (t < 3.0 / omega) {  // about 12 steps per period
      const double begin = t;
      t += random.uniform(0.4, 0.6) / omega;
      if (!tracker.is_near(value(t)) && !tracker.is_near(value(begin))) {
        tracker.add(t, value(t), false);
        continue;
      }
      const double middle = 0.5 * (begin + t);
      PeakSearch<2> search(tracker, begin, t);
      EXPECT_FALSE(search.lacks_begin());
      search.add(middle, value(middle));
      search.add(t, value(t));
      tracker.add(middle, value(middle), false);
      tracker.raise(t, value(t));
      while (!search.is_full()) {
        const std::optional<double> at = search.find_time(1e-9);
        if (!at) break;
        EXPECT_TRUE(*at > begin && *at < t);
        search.add(*at, value(*at));
        tracker.raise(*at, value(*at));
        ++evaluations;
      }
      tracker.add(t, value(t), false);
      ++searched;
    }
    for (int i : {0, 1}) {
      error.add((tracker.peak()[i].value - peak[i]) / peak[i], "trial " + std::to_string(trial));
      EXPECT_LE(tracker.peak()[i].value, peak[i] * (1.0 + 1e-15));  // every value has occurred
    }
  }
  EXPECT_RESIDUAL_BELOW(error, 3e-6);  // measured 1.3e-6
  EXPECT_LT(evaluations, 2 * searched);
}

TEST(Peaks, need_no_evaluation_where_values_fall_or_rise) {
  for (const double sign : {1.0, -1.0}) {
    const auto value = [&](double t) {
      return std::array<double, 1>{3.0 + sign * t + 0.1 * t * t};
    };
    PeakTracker<1> tracker;
    tracker.start(0.0, value(0.0));
    tracker.add(0.1, value(0.1), false);
    PeakSearch<1> search(tracker, 0.1, 0.2);
    search.add(0.15, value(0.15));
    search.add(0.2, value(0.2));
    tracker.raise(0.2, value(0.2));
    EXPECT_FALSE(search.find_time(1e-9).has_value());
  }
}

// A tiny step (to an event) is no sample of the tracker. The next step was then searched from the
// sample before: at times before its start, where its polynomial says nothing.
TEST(Peaks, are_searched_inside_the_step_alone) {
  const auto before = [](double t) { return 5.0 - (t - 0.8) * (t - 0.8); };
  for (const double tiny : {1e-9, 1e-3, 9e-3}) {
    for (const double place : {0.2, 0.35, 0.65, 0.8}) {  // of the peak in the step
      PeakTracker<1> tracker;
      tracker.start(0.0, {before(0.0)});
      const double begin = 0.9 + 0.3 * tiny, length = 0.3 * tiny, end = begin + length;
      for (const double t : {0.3, 0.6, 0.9, begin}) tracker.add(t, {before(t)}, false);
      EXPECT_EQ(tracker.time(tracker.count() - 1), 0.9);  // the begin is no sample
      // Forces settle inside the step, and rise above all samples before it.
      const auto value = [&](double t) {
        const double s = (t - begin) / length - place;
        return std::array<double, 1>{5.3 - s * s};
      };
      PeakSearch<1> search(tracker, begin, end);
      EXPECT_TRUE(search.lacks_begin());
      search.add(begin + 0.5 * length, value(begin + 0.5 * length));
      search.add(end, value(end));
      search.add(begin, value(begin));
      int found = 0;
      double largest = 0.0;
      while (!search.is_full()) {
        const std::optional<double> at = search.find_time(1e-9);
        if (!at) break;
        EXPECT_GE(*at, begin);
        EXPECT_LE(*at, end);
        search.add(*at, value(*at));
        largest = std::max(largest, value(*at)[0]);
        ++found;
      }
      EXPECT_GE(found, 1);
      EXPECT_NEAR(largest, 5.3, 0.02);
    }
  }
}

TEST(Peaks, are_near_from_a_twentieth_below_in_any_channel) {
  PeakTracker<2> tracker;
  tracker.start(0.0, {0.0, 10.0});
  EXPECT_FALSE(tracker.is_near({0.0, 9.4}));  // nothing is no peak of nothing
  EXPECT_TRUE(tracker.is_near({0.0, 9.6}));
  EXPECT_TRUE(tracker.is_near({1e-3, 0.0}));
}

TEST(Peaks, forget_everything_at_a_start) {
  PeakTracker<1> tracker;
  tracker.start(0.0, {7.0});
  tracker.start(0.0, {1.0});
  EXPECT_EQ(tracker.peak()[0].value, 1.0);
}

TEST(Peaks, bear_samples_at_the_same_or_nearly_the_same_time) {
  PeakTracker<1> tracker;
  const auto value = [](double t) { return std::cos(t - 1.0); };
  tracker.start(0.0, {value(0.0)});
  double t = 0.0;
  for (int i = 0; i < 40; ++i) {
    t += 0.05;
    tracker.add(t, {value(t)});
    tracker.add(t, {value(t)});
    tracker.add(t + 1e-15, {value(t)});
  }
  EXPECT_NEAR(tracker.peak()[0].value, 1.0, scaled_tolerance(1e-6));
  EXPECT_TRUE(std::isfinite(tracker.peak()[0].value));
}

TEST(Peaks, go_on_alike_after_being_restored) {
  const auto value = [](double t) { return std::sin(3 * t) + 0.3 * std::sin(7 * t); };
  PeakTracker<1> tracker;
  tracker.start(0.0, {value(0.0)});
  for (int i = 1; i < 8; ++i) tracker.add(0.05 * i, {value(0.05 * i)});
  const PeakTracker<1> kept = tracker;
  for (int i = 8; i < 40; ++i) tracker.add(0.05 * i, {value(0.05 * i)});
  const double first = tracker.peak()[0].value;
  tracker = kept;
  for (int i = 8; i < 40; ++i) tracker.add(0.05 * i, {value(0.05 * i)});
  EXPECT_EQ(tracker.peak()[0].value, first);
}

/// A half sine of height 1 in step 1 of a sequence, and one of height 2 in step 2, whose largest
/// values are at 0.5 and at 1.5 by the formula.
TEST(Peaks, carry_the_time_and_the_step_of_the_sequence_in_which_they_arose) {
  const double pi = std::acos(-1.0);
  PeakTracker<2> tracker;
  const auto value = [&](double t) {
    const double sine = std::sin(pi * t);
    return std::array<double, 2>{sine > 0.0 ? sine : 0.0, sine < 0.0 ? -2.0 * sine : 0.0};
  };
  tracker.start(0.0, value(0.0), 1);
  for (int i = 1; i <= 80; ++i) {
    const double t = 0.0251 * i;  // no sample is at a largest value
    if (t > 1.0 && t < 1.02) {
      tracker.enter(2);
      tracker.begin(1.0, value(1.0));
    }
    tracker.add(t, value(t));
  }
  EXPECT_NEAR(tracker.peak()[0].time, 0.5, 1e-4);
  EXPECT_EQ(tracker.peak()[0].step, 1);
  EXPECT_NEAR(tracker.peak()[1].time, 1.5, 1e-4);
  EXPECT_EQ(tracker.peak()[1].step, 2);
  tracker.raise(7.0, {0.5, 3.0});  // lower than the first peak, higher than the second
  EXPECT_NEAR(tracker.peak()[0].time, 0.5, 1e-4);
  EXPECT_EQ(tracker.peak()[1].time, 7.0);
}

/// The second value is at its peak all the time and jumps: neither is a reason to search a step.
TEST(Peaks, of_values_that_are_not_searched_follow_the_others) {
  PeakTracker<2, 1> tracker;
  tracker.start(0.0, {1.0, 5.0});
  for (int i = 1; i < 5; ++i) tracker.add(0.1 * i, {0.1, 5.0 + i});
  EXPECT_FALSE(tracker.is_near({0.1, 9.0}));
  EXPECT_TRUE(tracker.is_near({1.0, 0.0}));
  EXPECT_EQ(tracker.peak()[1].value, 9.0);
  tracker.add(0.4 + 1e-9, {0.1, 90.0});
  EXPECT_EQ(tracker.count(), 5);  // the samples have stayed
  EXPECT_EQ(tracker.peak()[1].value, 90.0);
  PeakSearch<2, 1> search(tracker, 0.4, 0.5);
  search.add(0.45, {0.1, 200.0});
  search.add(0.5, {0.1, 50.0});
  EXPECT_FALSE(search.find_time(1e-3));
}

/// The sequence changes its step right behind the sample that is the last one before a maximum
/// between samples: a parabola of height 1 at t = 0.
TEST(Peaks, between_samples_belong_to_the_step_that_is_present_there) {
  for (const double from : {-2.75, -2.25}) {  // the maximum is behind or before the middle sample
    PeakTracker<1> tracker;
    const auto value = [](double t) { return std::array<double, 1>{1.0 - 0.01 * t * t}; };
    tracker.start(from, value(from), 1);
    for (int k = 1; k < 7; ++k) {
      const double t = from + k;
      tracker.add(t, value(t));
      if (t > -1.0 && t < 0.0) tracker.enter(2);
    }
    EXPECT_NEAR(tracker.peak()[0].value, 1.0, 1e-12);
    EXPECT_NEAR(tracker.peak()[0].time, 0.0, 1e-6) << from;
    EXPECT_EQ(tracker.peak()[0].step, 2) << from;
  }
}

}  // namespace
}  // namespace dockloop
