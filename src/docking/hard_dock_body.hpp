// Forces and energies of the hard dock.
#pragma once

#include <algorithm>
#include <cmath>

#include "docking/hard_dock.hpp"
#include "math/one_sided_spring.hpp"
#include "math/ramp.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

/// Ramp from 0 at `since` to 1.
template <class S>
Ramp<S> calc_dock_ramp(const S& t, double since, double duration) {
  return calc_ramp<S>(clamp_unit<S>((t - S(since)) / S(duration)), S(duration));
}

/// A row of hooks that is not open: where its ends stand, how much of the tension acts.
template <class S>
struct RowNow {
  S end = S(0), end_rate = S(0);  ///< [m], [m/s]
  S grip = S(0), loss = S(0);     ///< 1 to 0, and its falling rate
};
template <class S>
RowNow<S> find_row_now(const HardDock& dock, const HookRowState& row, const S& t) {
  const HookLaw& hooks = dock.hooks;
  RowNow<S> now;
  now.grip = S(1);
  if (row.mode == HookMode::kOpening) {
    const Ramp<S> ramp = calc_dock_ramp<S>(t, row.since, hooks.open_time);
    now.end = S(row.end);
    now.grip = S(1) - ramp.share;
    now.loss = ramp.rate;
    return now;
  }
  const double end = find_preloaded_end(dock);
  now.end = S(end);
  if (row.mode == HookMode::kClosing) {
    const Ramp<S> ramp = calc_dock_ramp<S>(t, row.since, hooks.close_time);
    const S travel(end - hooks.play);
    now.end = S(hooks.play) + travel * ramp.share;
    now.end_rate = travel * ramp.rate;
  }
  return now;
}

/// Pushers now: share of the force, and its rate.
template <class S>
Ramp<S> find_pushers_now(const PusherLaw& law, const PusherState& state, const S& t) {
  const Ramp<S> ramp = calc_dock_ramp<S>(t, state.since, law.ramp);
  const S travel((state.on ? 1.0 : 0.0) - state.share);
  return {S(state.share) + travel * ramp.share, travel * ramp.rate};
}

/// Force and energy of a pusher that is compressed by c: the preload comes with a cubic over the
/// take-up, the stiffness with a toe; beyond, exactly P + k c.
template <class S>
Elastic<S> calc_pusher(const PusherLaw& law, const S& c) {
  if (c <= S(0)) return {S(0), S(0)};
  const Elastic<S> spring = calc_toe_spring<S>(c, S(law.stiffness), S(law.take_up));
  const S preload(law.preload + law.stiffness * law.take_up / 2.0), width(law.take_up);
  if (c >= width) return {preload + spring.force, preload * (c - width / S(2)) + spring.energy};
  const S u = c / width;
  return {preload * u * u * (S(3) - S(2) * u) + spring.force,
          preload * width * u * u * u * (S(1) - u / S(2)) + spring.energy};
}

/// Openings of points of A.
template <class S>
struct Openings {
  explicit Openings(const RelativeMotion<S>& motion)
      : axis(motion.R.col(0)),
        centre(axis.dot(motion.p)),
        centre_rate(axis.dot(motion.v - motion.w.cross(motion.p))),
        spin(axis.cross(motion.w)) {}
  S at(const Eigen::Vector2d& t) const { return centre - axis[1] * S(t[0]) - axis[2] * S(t[1]); }
  /// x_P . (v + w x (t - p))
  S rate_at(const Eigen::Vector2d& t) const {
    return centre_rate + spin[1] * S(t[0]) + spin[2] * S(t[1]);
  }
  Vec3<S> axis;           ///< x of P
  S centre, centre_rate;  ///< of the origin of A
  Vec3<S> spin;
};

/// Sum of forces f along x of P at points of A.
template <class S>
struct AxialSum {
  S force = S(0), y = S(0), z = S(0);
  void add(const S& f, const Eigen::Vector2d& t) {
    force += f;
    y += f * S(t[0]);
    z += f * S(t[1]);
  }
};

/// Lower bound of all openings of points within this radius [m].
inline double find_least_opening(const Openings<double>& openings, double radius) {
  return openings.centre - radius * find_length(openings.axis[1], openings.axis[2]);
}

}  // namespace

template <class S>
S find_hook_distance(const HardDock& dock, const RelativeMotion<S>& motion) {
  const Openings<S> openings(motion);
  S largest(-kNoGap);
  for (const HookRow& row : dock.hooks.rows) {
    for (const Eigen::Vector2d& t : row.points) largest = std::max<S>(largest, openings.at(t));
  }
  return largest - S(dock.hooks.play);
}

template <class S>
void calc_hard_dock(const HardDock& dock, const HardDockState& state, const S& t,
                    const RelativeMotion<S>& motion, HardDockResult<S>& out) {
  out = HardDockResult<S>();
  const Openings<S> openings(motion);
  AxialSum<S> sum;
  // Faces.
  const FaceLaw& faces = dock.faces;
  const S share(faces.stiffness / std::max(1, dock.face_count()));
  for (const Eigen::Vector2d& at : faces.points) {
    const S depth = -openings.at(at);
    if (depth <= S(0)) continue;
    const S rate = -openings.rate_at(at);
    const Elastic<S> elastic = calc_toe_spring<S>(depth, share, S(faces.toe));
    const S force = calc_damped_force<S>(elastic.force, S(faces.damping), rate);
    out.energy += elastic.energy;
    out.dissipation += (force - elastic.force) * rate;
    out.face_force += force;
    sum.add(force, at);
  }
  // Hooks.
  const HookLaw& hooks = dock.hooks;
  size_t hook = 0;
  for (size_t i = 0; i < hooks.rows.size(); ++i) {
    if (state.row[i].mode == HookMode::kOpen) {
      hook += hooks.rows[i].points.size();
      continue;
    }
    const RowNow<S> row = find_row_now<S>(dock, state.row[i], t);
    for (const Eigen::Vector2d& at : hooks.rows[i].points) {
      const size_t place = hook++;
      const S stretch = openings.at(at) - row.end;
      if (stretch <= S(0)) continue;
      const S rate = openings.rate_at(at) - row.end_rate;
      const Elastic<S> elastic = calc_toe_spring<S>(stretch, S(hooks.stiffness), S(hooks.toe));
      const S tension = calc_damped_force<S>(elastic.force, S(hooks.damping), rate);
      out.energy += row.grip * elastic.energy;
      out.dissipation += row.grip * (tension - elastic.force) * rate + row.loss * elastic.energy;
      out.work -= row.grip * tension * row.end_rate;
      out.hook_force[place] = row.grip * tension;
      sum.add(-out.hook_force[place], at);
    }
  }
  // Pushers.
  if (dock.pusher_count() > 0) {
    const Ramp<S> now = find_pushers_now<S>(dock.pushers, state.pushers, t);
    for (const Eigen::Vector2d& at : dock.pushers.points) {
      const S compressed = S(dock.pushers.stroke) - openings.at(at);
      if (compressed <= S(0)) continue;
      const Elastic<S> elastic = calc_pusher<S>(dock.pushers, compressed);
      const S power = now.rate * elastic.energy;
      out.energy += now.share * elastic.energy;
      (state.pushers.on ? out.work : out.dissipation) += state.pushers.on ? power : S(-power);
      out.pusher_force += now.share * elastic.force;
      sum.add(now.share * elastic.force, at);
    }
  }
  out.on_passive.f = sum.force * openings.axis;
  out.on_passive.t = Vec3<S>(S(0), sum.y, sum.z).cross(openings.axis);
}

#define DOCK_INSTANTIATE(S)                                                        \
  template S find_hook_distance<S>(const HardDock&, const RelativeMotion<S>&);     \
  template void calc_hard_dock<S>(const HardDock&, const HardDockState&, const S&, \
                                  const RelativeMotion<S>&, HardDockResult<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
