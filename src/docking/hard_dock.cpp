// Hardware of the hard dock: commands, ramps, bounds; see hard_dock.hpp.
#include "docking/hard_dock.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "docking/hard_dock_body.hpp"
#include "math/dock_assert.hpp"
#include "math/status.hpp"

namespace dockloop {
namespace {

/// Of all points, from the origin of A [m].
double find_bounding_radius(const HardDock& dock) {
  double square = 0.0;
  const auto add = [&square](const std::vector<Eigen::Vector2d>& points) {
    for (const Eigen::Vector2d& at : points) square = std::max(square, at.squaredNorm());
  };
  add(dock.faces.points);
  add(dock.pushers.points);
  for (const HookRow& row : dock.hooks.rows) add(row.points);
  return std::sqrt(square);
}

/// End of the ramp of a row [s]; nothing without a ramp.
std::optional<double> find_ramp_end(const HardDock& dock, const HookRowState& row) {
  if (row.mode == HookMode::kClosing) return row.since + dock.hooks.close_time;
  if (row.mode == HookMode::kOpening) return row.since + dock.hooks.open_time;
  return std::nullopt;
}

}  // namespace

int HookLaw::count() const {
  size_t sum = 0;
  for (const HookRow& row : rows) sum += row.points.size();
  return static_cast<int>(sum);
}

std::vector<Eigen::Vector2d> make_circle(int count, double radius, double azimuth) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < count; ++i) {
    const double angle = azimuth + 2.0 * static_cast<double>(EIGEN_PI) * i / count;
    points.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
  }
  return points;
}

PusherTravel find_pusher_travel(const PusherLaw& law, const RelativeMotion<double>& motion) {
  const Openings<double> openings(motion);
  double least = kNoGap, largest = -kNoGap;
  for (const Eigen::Vector2d& at : law.points) {
    const double opening = openings.at(at);
    least = std::min(least, opening);
    largest = std::max(largest, opening);
  }
  return {least - law.stroke, law.stroke - law.take_up - largest};
}

double find_preloaded_end(const HardDock& dock) {
  DOCK_ASSERT(dock.face_count() > 0 && dock.hooks.count() > 0);
  const HookLaw& hooks = dock.hooks;
  const double all = hooks.preload * hooks.count();
  const double pressed = all / dock.faces.stiffness + dock.faces.toe / 2.0;
  return -pressed - hooks.preload / hooks.stiffness - hooks.toe / 2.0;
}

namespace {

/// @throws ModelError with the fault of a part, if there is one
void refuse(const char* part, const std::string& fault) {
  if (!fault.empty()) throw ModelError(std::string(part) + ": " + fault);
}

}  // namespace

void check_hard_dock(const HardDock& dock) {
  const FaceLaw& faces = dock.faces;
  const HookLaw& hooks = dock.hooks;
  const PusherLaw& pushers = dock.pushers;
  if (faces.points.empty()) {
    require("interface", hooks.rows.empty(),
            "hooks need faces that they press on each other: state interface.faces");
  } else {
    require("interface.faces", faces.points.size() >= 3,
            "count must be 3 or more, or the faces cannot carry a tilt");
    refuse("interface.faces", find_fault(faces, kFaceNumbers));
  }
  if (!hooks.rows.empty()) {
    refuse("interface.hooks", find_fault(hooks, kHookNumbers));
    for (const HookRow& row : hooks.rows) {
      refuse("interface.hooks.rows", find_fault(row, kHookRowNumbers));
    }
    require("interface.hooks", hooks.count() <= kMaxHooks, "at most 24 hooks are possible");
    require("interface.hooks", hooks.rows.size() <= kMaxHookRows, "at most 4 rows are possible");
    // Beyond their toes, where find_preloaded_end() is exact.
    require("interface.hooks",
            hooks.preload * hooks.count() > faces.stiffness * faces.toe / 2.0 &&
                hooks.preload > hooks.stiffness * hooks.toe / 2.0,
            "preload is too small to leave the toes of hooks and faces: decrease toe or increase "
            "preload");
  }
  if (!pushers.points.empty()) {
    refuse("interface.pushers", find_fault(pushers, kPusherNumbers));
    if (pushers.take_up > pushers.stroke) {
      refuse("interface.pushers", "take_up is " + describe_number(pushers.take_up) +
                                      " m; it must not exceed stroke, " +
                                      describe_number(pushers.stroke) + " m");
    }
    require("interface.pushers", pushers.preload > 0.0 || pushers.stiffness > 0.0,
            "preload or stiffness must be above 0");
  }
}

HardDockState make_start(const HardDock& dock) {
  HardDockState state;
  state.pushers.on = dock.pushers.on_at_start;
  state.pushers.share = state.pushers.on ? 1.0 : 0.0;
  return state;
}

// ---------------------------------------------------------------- commands

void close_hooks(HardDockState& state) { state.closes = true; }

void open_hooks(const HardDock& dock, double t, HardDockState& state) {
  state.closes = false;
  for (HookRowState& row : state.row) {
    if (row.mode != HookMode::kClosing && row.mode != HookMode::kClosed) continue;
    row.end = find_row_now<double>(dock, row, t).end;
    row.mode = HookMode::kOpening;
    row.since = t;
  }
}

void switch_pushers(const HardDock& dock, bool on, double t, HardDockState& state) {
  PusherState& pushers = state.pushers;
  if (pushers.on == on) return;
  pushers = {on, t, find_pushers_now<double>(dock.pushers, pushers, t).share};
}

bool are_waiting(const HardDock& dock, const HardDockState& state) {
  if (!state.closes || dock.hooks.rows.empty()) return false;
  return std::all_of(state.row.begin(), state.row.end(),
                     [](const HookRowState& row) { return row.mode == HookMode::kOpen; });
}

bool update_hooks(const HardDock& dock, bool can_close, double t, HardDockState& state) {
  bool changed = false;
  for (HookRowState& row : state.row) {
    const std::optional<double> end = find_ramp_end(dock, row);
    if (!end || t < *end) continue;
    row.mode = row.mode == HookMode::kClosing ? HookMode::kClosed : HookMode::kOpen;
    changed = true;
  }
  if (!can_close || !are_waiting(dock, state)) return changed;
  for (size_t i = 0; i < dock.hooks.rows.size(); ++i) {
    state.row[i] = {HookMode::kClosing, t + dock.hooks.rows[i].close_delay, 0.0};
  }
  return true;
}

std::optional<double> find_next_ramp(const HardDock& dock, const HardDockState& state, double t) {
  std::optional<double> next;
  const auto add = [&](double time) {
    if (time > t && (!next || time < *next)) next = time;
  };
  for (const HookRowState& row : state.row) {
    if (const std::optional<double> end = find_ramp_end(dock, row)) {
      add(row.since);
      add(*end);
    }
  }
  if (dock.pusher_count() > 0) add(state.pushers.since + dock.pushers.ramp);
  return next;
}

bool is_ramping(const HardDock& dock, const HardDockState& state, double t) {
  const bool hooks = std::any_of(state.row.begin(), state.row.end(), [&](const HookRowState& row) {
    return find_ramp_end(dock, row).has_value();
  });
  return hooks || (dock.pusher_count() > 0 && t < state.pushers.since + dock.pushers.ramp);
}

int count_closed_hooks(const HardDock& dock, const HardDockState& state) {
  size_t closed = 0;
  for (size_t i = 0; i < dock.hooks.rows.size(); ++i) {
    if (state.row[i].mode == HookMode::kClosed) closed += dock.hooks.rows[i].points.size();
  }
  return static_cast<int>(closed);
}

// ---------------------------------------------------------------- bounds and slopes

double find_face_depth(const HardDock& dock, const RelativeMotion<double>& motion) {
  const Openings<double> openings(motion);
  double least = kNoGap;
  for (const Eigen::Vector2d& at : dock.faces.points) least = std::min(least, openings.at(at));
  return -least;
}

double find_free_opening(const HardDock& dock, const HardDockState& state,
                         const RelativeMotion<double>& motion) {
  const bool grips = std::any_of(state.row.begin(), state.row.end(), [](const HookRowState& row) {
    return row.mode != HookMode::kOpen;
  });
  if (grips) return 0.0;
  double acting = 0.0;  // largest opening with a force
  if (dock.pusher_count() > 0) acting = dock.pushers.stroke;
  if (state.closes) acting = std::max(acting, dock.hooks.play);
  return find_least_opening(Openings<double>(motion), find_bounding_radius(dock)) - acting;
}

void add_hard_dock_tangent(const HardDock& dock, const HardDockState& state, double t,
                           const RelativeMotion<double>& motion, InterfaceTangent& tangent) {
  const Openings<double> openings(motion);
  // Slopes of a force along x of P at a point of A, by opening and by its rate.
  const auto add = [&](const Eigen::Vector2d& at, double stiffness, double damping) {
    const Vec3<double> point(0.0, at[0], at[1]);
    Vec6<double> a, b;
    a << openings.axis, point.cross(openings.axis);
    b << openings.axis, Vec3<double>(point - motion.p).cross(openings.axis);
    tangent.stiffness.noalias() += stiffness * a * b.transpose();
    tangent.damping.noalias() += damping * a * b.transpose();
  };
  const auto find_slope = [](double depth, double stiffness, double toe) {
    return stiffness * std::min(1.0, depth / toe);
  };
  const FaceLaw& faces = dock.faces;
  const double share = faces.stiffness / std::max(1, dock.face_count());
  for (const Eigen::Vector2d& at : faces.points) {
    const double depth = -openings.at(at), phi = 1.0 - faces.damping * openings.rate_at(at);
    if (depth <= 0.0 || phi <= 0.0) continue;
    const double elastic = calc_toe_spring<double>(depth, share, faces.toe).force;
    add(at, -phi * find_slope(depth, share, faces.toe), -faces.damping * elastic);
  }
  const HookLaw& hooks = dock.hooks;
  for (size_t i = 0; i < hooks.rows.size(); ++i) {
    if (state.row[i].mode == HookMode::kOpen) continue;
    const RowNow<double> row = find_row_now<double>(dock, state.row[i], t);
    for (const Eigen::Vector2d& at : hooks.rows[i].points) {
      const double stretch = openings.at(at) - row.end;
      const double phi = 1.0 + hooks.damping * (openings.rate_at(at) - row.end_rate);
      if (stretch <= 0.0 || phi <= 0.0) continue;
      const double elastic = calc_toe_spring<double>(stretch, hooks.stiffness, hooks.toe).force;
      add(at, -row.grip * phi * find_slope(stretch, hooks.stiffness, hooks.toe),
          -row.grip * hooks.damping * elastic);
    }
  }
  if (dock.pusher_count() == 0) return;
  const double on = find_pushers_now<double>(dock.pushers, state.pushers, t).share;
  for (const Eigen::Vector2d& at : dock.pushers.points) {
    const double u = (dock.pushers.stroke - openings.at(at)) / dock.pushers.take_up;
    if (u <= 0.0) continue;
    const double bend = u < 1.0 ? 6.0 * u * (1.0 - u) / dock.pushers.take_up : 0.0;
    const double preload = dock.pushers.preload + dock.pushers.stiffness * dock.pushers.take_up / 2;
    add(at, -on * (preload * bend + dock.pushers.stiffness * std::min(1.0, u)), 0.0);
  }
}

}  // namespace dockloop
