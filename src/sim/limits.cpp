// Limits that are watched while a simulation runs; see limits.hpp.
#include "sim/limits.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "contact/primitives.hpp"

namespace dockloop {
namespace {

constexpr double kMostOverlap = 1e-3;  ///< of mating planes, beyond the depth of surfaces [m]
constexpr double kMostTilt = 30.0;     ///< the model of rings holds below [deg]
constexpr double kMostDepth = 0.9;     ///< of the rounding; a state beyond 0.98 is refused
constexpr double kDegree = static_cast<double>(EIGEN_PI) / 180.0;  ///< [rad]

/// Axial distances only count where the hardware of both sides is opposite each other.
void find_distances(const DockingModel& model, const DockingData<double>& data,
                    LimitValues& found) {
  const ContactModel& contact = model.contact;
  const Vec3<double> p = find_across(model, data).p;
  if (p.tail<2>().norm() > find_bounding_radius(contact, data.relative)) return;
  const double depth = data.contact.depth_ratio * contact.least_rounding;
  found.value[kOverlapLimit] = -p.x() - depth;
  found.value[kPassedLimit] = -data.relative.p.x() - contact.depth;
}

double find_hull_overlap(const DockingModel& model, const DockingData<double>& data) {
  constexpr double kRegularised = 1e-9;  // parallel hulls have many closest points
  const Hull &ours = *model.hull[kChaser], &theirs = *model.hull[kTarget];
  const auto find_start = [&](int i, const Hull& hull) -> Vec3<double> {
    return data.vehicle[i].p + data.vehicle[i].R * hull.from;
  };
  const auto find_way = [&](int i, const Hull& hull) -> Vec3<double> {
    return data.vehicle[i].R * (hull.to - hull.from);
  };
  const Vec3<double> p = find_start(kChaser, ours), dp = find_way(kChaser, ours);
  const Vec3<double> q = find_start(kTarget, theirs), dq = find_way(kTarget, theirs);
  const Closest<double> closest =
      find_segment_segment<double>(p, dp, p + 0.5 * dp, q, dq, q + 0.5 * dq, kRegularised);
  return ours.radius + theirs.radius - (closest.second - closest.first).norm();
}

/// Depth over toe of the deepest end stop.
void find_stops(const MechanismModel& mechanism, const DockingData<double>& data,
                LimitValues& found) {
  const auto add = [&found](const auto& stop, double at, const std::string& part) {
    const double ratio = std::max(stop.lower - at, at - stop.upper) / stop.toe;
    if (ratio <= found.value[kStopLimit]) return;
    found.value[kStopLimit] = ratio;
    found.part = &part;
  };
  const VecX<double>& q = data.mechanism.tree.q;
  for (const JointForce& law : mechanism.forces) {
    const Body& body = mechanism.bodies[law.body];
    if (law.stops.present) add(law.stops, q[body.q_index], body.name);
  }
  for (const ForceElement& element : mechanism.elements) {
    for (const ForceLaw& law : element.laws) {
      const StopLaw* stop = std::get_if<StopLaw>(&law);
      if (stop) add(*stop, find_coordinate(mechanism, element, q), element.name);
    }
  }
}

}  // namespace

int LimitRecord::find_bits() const {
  int bits = 0;
  for (int k = 0; k < kLimitCount; ++k) bits += has(static_cast<Limit>(k)) << k;
  return bits;
}

LimitValues find_limit_values(const DockingModel& model, const DockingData<double>& data,
                              double load_ratio) {
  LimitValues found;
  found.limit.fill(std::numeric_limits<double>::infinity());
  found.limit[kStopLimit] = 1.0;
  if (!data.locked) find_stops(model.mechanism.model, data, found);
  if (!model.present[kTarget]) return found;
  found.limit[kLoadLimit] = 1.0;
  found.value[kLoadLimit] = load_ratio;
  if (model.hull[kChaser] && model.hull[kTarget]) {
    found.limit[kHullLimit] = 0.0;
    found.value[kHullLimit] = find_hull_overlap(model, data);
  }
  const bool is_joined = data.locked && data.locked->has_target;
  if (!model.contact.has_surfaces() || is_joined) return found;
  found.limit[kOverlapLimit] = kMostOverlap;
  found.limit[kPassedLimit] = model.phase_limits.passed_depth;
  find_distances(model, data, found);
  found.limit[kDepthLimit] = kMostDepth;
  found.value[kDepthLimit] = data.contact.depth_ratio;
  if (!model.contact.rings || data.contact.active_count == 0) return found;
  found.limit[kTiltLimit] = kMostTilt * kDegree;
  found.value[kTiltLimit] = std::acos(std::clamp(data.relative.R(0, 0), -1.0, 1.0));
  return found;
}

std::string describe_limit(Limit which, double t, double value, double limit,
                           const std::string* part) {
  const WatchedLimit& row = kLimits[which];
  const bool is_angle = which == kTiltLimit;
  const double scale = is_angle ? 1.0 / kDegree : 1.0;
  const std::string unit = is_angle ? " deg" : *row.unit == '1' ? "" : std::string(" ") + row.unit;
  char text[400];
  std::snprintf(text, sizeof text, "limit '%s' at t = %.9g s: %s%s%s%s, %.4g%s (limit %.4g%s); %s",
                row.name, t, row.happened, part ? " ('" : "", part ? part->c_str() : "",
                part ? "')" : "", scale * value, unit.c_str(), scale * limit, unit.c_str(),
                row.means);
  return text;
}

}  // namespace dockloop
