// Forces and energies of latches.
#pragma once

#include <algorithm>
#include <cmath>

#include "contact/latches.hpp"
#include "contact/laws.hpp"
#include "math/dock_assert.hpp"
#include "math/ramp.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

constexpr double kDue = 1e-9;  // tolerance of a located event, m, s or -

/// What a latch measures, see LatchMeasure.
template <class S>
struct LatchPlace {
  Vec3<S> s, rate;  ///< striker relative to hook [m], [m/s]
};

template <class S>
LatchPlace<S> find_place(const Latch& latch, const RelativeMotion<S>& motion) {
  const Vec3<S> hook = cast<S>(latch.hook);
  const Vec3<S> lever = motion.R * cast<S>(latch.striker);
  if (latch.measure == LatchMeasure::kActiveAxis) {
    return {motion.p + lever - hook, motion.v + motion.w.cross(lever)};
  }
  const Mat3<S> to_P = motion.R.transpose();
  const Vec3<S> opening = to_P * (motion.p + lever - hook);
  const Vec3<S> opening_rate = to_P * (motion.v + motion.w.cross(hook - motion.p));
  const Vec3<S> to_axis = to_P * motion.p;
  const Vec3<S> axis_rate = to_P * (motion.v - motion.w.cross(motion.p));
  return {{opening[0], to_axis[1], to_axis[2]}, {opening_rate[0], axis_rate[1], axis_rate[2]}};
}

/// Force on the striker in axes of s [N], with its energy and power.
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
      const Ramp<S> release = calc_ramp<S>(u, ramp);
      OneLatch<S> latch = calc_hold<S>(law, s[0], rate, S(1) - release.share, release.rate);
      latch.event = left;
      return latch;
    }
    case LatchMode::kSpent:
      break;
  }
  return {Vec3<S>::Zero(), S(0), S(0), S(law.pawl_range) - s[0]};
}

}  // namespace

template <class S>
void calc_latches(const LatchSet& set, const LatchState* state, S t,
                  const RelativeMotion<S>& motion, LatchResult<S>& out) {
  DOCK_ASSERT(set.count() <= kMaxLatches);
  out = LatchResult<S>();
  for (int i = 0; i < set.count(); ++i) {
    const LatchPlace<S> place = find_place<S>(set.latch[i], motion);
    const Vec3<S>& s = place.s;
    const OneLatch<S> latch = calc_latch<S>(set.latch[i].law, state[i], t, s, place.rate[0]);
    if (set.latch[i].measure == LatchMeasure::kActiveAxis) {
      const Vec3<S> at = motion.p + motion.R * cast<S>(set.latch[i].striker);
      out.on_passive.f += latch.force;
      out.on_passive.t += at.cross(latch.force);
    } else {
      const Vec3<S> along = motion.R.col(0) * latch.force[0];
      out.on_passive.f += motion.R * latch.force;
      out.on_passive.t += cast<S>(set.latch[i].hook).cross(along);
    }
    out.energy += latch.energy;
    out.power += latch.power;
    out.opening[i] = s[0];
    out.lateral[i] = find_length<S>(s[1], s[2]);
    out.force[i] = -latch.force[0];
    out.event[i] = latch.event;
  }
}

#define DOCK_INSTANTIATE(S)                                                                      \
  template void calc_latches<S>(const LatchSet&, const LatchState*, S, const RelativeMotion<S>&, \
                                LatchResult<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
