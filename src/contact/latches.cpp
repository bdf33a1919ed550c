// Mode changes of latches; latches_body.hpp, compiled for the scalars of the core.
#include "contact/latches.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "contact/latches_body.hpp"
#include "math/status.hpp"

namespace dockloop {

namespace {

/// What is wrong with a latch, as the rest of a sentence; empty if nothing is.
std::string find_law_fault(const LatchLaw& law) {
  const std::string fault = find_fault(law, kLatchNumbers);
  if (!fault.empty()) return fault;
  const auto length = [](const char* name, double value, const char* limit, double bound) {
    return std::string(name) + " is " + describe_number(value) + " m; it must be " + limit + ", " +
           describe_number(bound) + " m";
  };
  if (!(law.pawl_range > law.catch_distance)) {
    return length("range", law.pawl_range, "above catch", law.catch_distance);
  }
  if (!(law.play >= law.catch_distance)) {
    return length("play", law.play, "at least catch", law.catch_distance) +
           ", or the force jumps when the latch catches";
  }
  if (law.releases_on_overload && law.rated_load == 0.0) {
    return "rated_load is 0; a latch that releases on overload needs a rated_load above 0";
  }
  return "";
}

}  // namespace

void check_latches(const LatchSet& set) {
  require("latches", set.count() <= kMaxLatches, "at most 8 latches are possible");
  require("latches", set.required >= 0 && set.required <= set.count(),
          "required must be 1 or more and not above the number of latches");
  for (int i = 0; i < set.count(); ++i) {
    const std::string fault = find_law_fault(set.latch[i].law);
    if (!fault.empty()) throw ModelError("latch " + std::to_string(i + 1) + ": " + fault);
  }
}

LatchMotion find_latch_motion(const LatchSet& set, int i, const RelativeMotion<double>& motion) {
  const LatchPlace<double> place = find_place<double>(set.latch[i], motion);
  return {place.s, place.rate};
}

std::array<double, 2> find_conditions(const LatchLaw& law, const LatchState& state,
                                      const LatchMotion& motion, double event) {
  if (state.mode != LatchMode::kOpen) return {event, event};
  const double x = motion.s[0], rho = find_length(motion.s[1], motion.s[2]);
  return {x - law.catch_distance, std::max(rho - law.window, -x - law.guard)};
}

double find_event_speed(const LatchState& state, const LatchMotion& motion) {
  switch (state.mode) {
    case LatchMode::kOpen:  // the largest of three lengths along or across
      return motion.rate.norm();
    case LatchMode::kSpent:
      return std::abs(motion.rate[0]);
    case LatchMode::kReleasing:
      return 1.0;  // the remaining time
    case LatchMode::kHeld:
      break;
  }
  return 0.0;
}

bool is_passed(const LatchLaw& law, const LatchState& state, const LatchMotion& from,
               const LatchMotion& to, double h) {
  if (state.mode != LatchMode::kOpen && state.mode != LatchMode::kSpent) return false;
  const auto find_event = [&](double u) {  // Hermite
    const double v = 1.0 - u;
    const Vec3<double> s = v * v * (1.0 + 2.0 * u) * from.s + u * u * (1.0 + 2.0 * v) * to.s +
                           h * u * v * (v * from.rate - u * to.rate);
    return calc_latch<double>(law, state, 0.0, s, 0.0).event;
  };
  constexpr int kPlaces = 64;
  // Bound of the rate by both ends and their distance: nearly all steps end here.
  const double speed = 1.5 * std::max({find_event_speed(state, from), find_event_speed(state, to),
                                       (to.s - from.s).norm() / h});
  if (find_event(0.0) + find_event(1.0) > speed * h) return false;
  for (int k = 1; k < kPlaces; ++k) {
    if (find_event(static_cast<double>(k) / kPlaces) <= 0.0) return true;
  }
  return false;
}

double update_latch(const LatchSet& set, int i, double t, const RelativeMotion<double>& motion,
                    LatchState& state, bool passed) {
  const LatchMotion at = find_latch_motion(set, i, motion);
  const Vec3<double>& s = at.s;
  const double rate = at.rate[0];
  const LatchLaw& law = set.latch[i].law;
  const OneLatch<double> before = calc_latch<double>(law, state, t, s, rate);
  if (before.event > kDue && !passed) return 0.0;
  switch (state.mode) {
    case LatchMode::kOpen:
      state.mode = LatchMode::kHeld;
      break;
    case LatchMode::kHeld:
      state = {LatchMode::kReleasing, t};
      break;
    case LatchMode::kReleasing:
      state.mode = LatchMode::kSpent;
      break;
    case LatchMode::kSpent:
      state.mode = LatchMode::kOpen;
      break;
  }
  return before.energy - calc_latch<double>(law, state, t, s, rate).energy;
}

int count_held(const LatchSet& set, const LatchState* states) {
  return static_cast<int>(std::count_if(states, states + set.count(), [](const LatchState& latch) {
    return latch.mode == LatchMode::kHeld;
  }));
}

double release_latch(const LatchSet& set, int i, double t, const RelativeMotion<double>& motion,
                     LatchState& state) {
  const LatchMotion at = find_latch_motion(set, i, motion);
  const auto find_energy = [&] {
    return calc_latch<double>(set.latch[i].law, state, t, at.s, at.rate[0]).energy;
  };
  const double before = find_energy();
  if (state.mode == LatchMode::kHeld) state = {LatchMode::kReleasing, t};
  if (state.mode == LatchMode::kOpen) state.mode = LatchMode::kSpent;
  return before - find_energy();
}

}  // namespace dockloop
