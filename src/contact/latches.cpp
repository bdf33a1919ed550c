// Forces, energies and mode changes of latches.
#include "contact/latches.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "contact/laws.hpp"
#include "math/scalar.hpp"
#include "math/status.hpp"

namespace dockloop {
namespace {

constexpr double kDue = 1e-9;  // tolerance of a located event, m, s or -

/// Force on the striker in axes of G [N], with its energy and power.
template <class S>
struct OneLatch {
  Vec3<S> force;
  S energy, power, event;
};

/// Open latch: force = -grad (E(x) W(rho)).
template <class S>
OneLatch<S> calc_pawl(const LatchLaw& law, const Vec3<S>& s) {
  using std::max;
  using std::sin;
  using std::sqrt;
  const S pi = S(3.14159265358979323846264338327950288L);
  const S x_c = S(law.catch_distance), range = S(law.pawl_range) - x_c, w = S(law.window);
  const S rho = sqrt(s[1] * s[1] + s[2] * s[2]);

  // Along the axis: E' = -F_l sin^2(pi b), b falling from 1 at x_c to 0 at x_r.
  const S b = S(1) - clamp_unit<S>((s[0] - x_c) / range);
  const S peak = S(law.push_force), sine = sin(pi * b);
  const S energy = peak * range / S(2) * (b - sin(S(2) * pi * b) / (S(2) * pi));
  const S push = peak * sine * sine;

  // Across: W = (1 - u^2)^2, u = (rho - w)/w from 0 to 1.
  const S u = clamp_unit<S>((rho - w) / w), fade = S(1) - u * u;
  const S window = fade * fade, slope = -S(4) * fade * u / w;
  const S outward = rho > S(0) ? -energy * slope / rho : S(0);
  const S event = max(max(s[0] - x_c, rho - w), -s[0] - S(law.guard));
  return {{push * window, outward * s[1], outward * s[2]}, energy * window, S(0), event};
}

/// Held latch, its tension times `grip`, which falls at the rate -`loss`.
template <class S>
OneLatch<S> calc_hold(const LatchLaw& law, const S& opening, const S& rate, const S& grip,
                      const S& loss) {
  const Elastic<S> el =
      calc_toe_spring<S>(opening - S(law.play), S(law.hold_stiffness), S(law.hold_toe));
  const S tension = calc_damped_force<S>(el.force, S(law.hold_damping), rate);
  const S reserve = law.releases_on_overload ? S(1) - tension / S(law.rated_load) : S(1);
  return {{-grip * tension, S(0), S(0)},
          grip * el.energy,
          grip * (tension - el.force) * rate + loss * el.energy,
          reserve};
}

template <class S>
OneLatch<S> calc_latch(const LatchLaw& law, const LatchState& state, const S& t, const Vec3<S>& s,
                       const S& rate) {
  switch (state.mode) {
    case LatchMode::kOpen:
      return calc_pawl<S>(law, s);
    case LatchMode::kHeld:
      return calc_hold<S>(law, s[0], rate, S(1), S(0));
    case LatchMode::kReleasing: {
      const S ramp = S(law.release_ramp), left = S(state.release_time) + ramp - t;
      const S u = clamp_unit<S>(S(1) - left / ramp);
      OneLatch<S> latch = calc_hold<S>(law, s[0], rate, S(1) - u * u * (S(3) - S(2) * u),
                                       S(6) * u * (S(1) - u) / ramp);
      latch.event = left;
      return latch;
    }
    case LatchMode::kSpent:
      break;
  }
  return {Vec3<S>::Zero(), S(0), S(0), S(law.pawl_range) - s[0]};
}

}  // namespace

void check_latches(const LatchSet& set) {
  const LatchLaw& law = set.law;
  require("latches", set.hook.size() == set.striker.size(), "every hook needs a striker");
  require("latches", set.count() <= kMaxLatches, "at most 8 latches are possible");
  require("latches", law.catch_distance > 0 && law.pawl_range > law.catch_distance,
          "catch_distance must be above 0 and below pawl_range");
  require("latches", law.play >= law.catch_distance,
          "play must not be below catch_distance, or the force jumps at the catch");
  require("latches", law.window > 0 && law.guard > 0, "window and guard must be above 0");
  require(
      "latches",
      law.push_force >= 0 && law.hold_stiffness > 0 && law.hold_toe > 0 && law.hold_damping >= 0,
      "hold_stiffness and hold_toe must be above 0, push_force and hold_damping 0 or more");
  require("latches", law.release_ramp > 0, "release_ramp must be above 0");
  require("latches", !law.releases_on_overload || law.rated_load > 0,
          "rated_load must be above 0 if latches release on overload");
}

template <class S>
void calc_latches(const LatchSet& set, const LatchState* state, S t,
                  const RelativeMotion<S>& motion, LatchResult<S>& out) {
  out = LatchResult<S>();
  for (int i = 0; i < set.count(); ++i) {
    const Vec3<S> lever = motion.R * set.striker[i].template cast<S>();
    const Vec3<S> at = motion.p + lever;
    const Vec3<S> s = at - set.hook[i].template cast<S>();
    const S rate = motion.v[0] + motion.w.cross(lever)[0];
    const OneLatch<S> latch = calc_latch<S>(set.law, state[i], t, s, rate);
    out.on_passive.f += latch.force;
    out.on_passive.t += at.cross(latch.force);
    out.energy += latch.energy;
    out.power += latch.power;
    out.opening[i] = s[0];
    out.lateral[i] = find_length<S>(s[1], s[2]);
    out.force[i] = -latch.force[0];
    out.event[i] = latch.event;
  }
}

LatchMotion find_latch_motion(const LatchSet& set, int i, const RelativeMotion<double>& motion) {
  const Vec3<double> lever = motion.R * set.striker[i];
  return {motion.p + lever - set.hook[i], motion.v + motion.w.cross(lever)};
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
  const OneLatch<double> before = calc_latch<double>(set.law, state, t, s, rate);
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
  return before.energy - calc_latch<double>(set.law, state, t, s, rate).energy;
}

#define DOCK_INSTANTIATE(S)                                                                      \
  template void calc_latches<S>(const LatchSet&, const LatchState*, S, const RelativeMotion<S>&, \
                                LatchResult<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
