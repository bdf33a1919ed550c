// Loads and energies of the forces between the vehicles.
#pragma once

#include <algorithm>
#include <cmath>

#include "docking/vehicle_force.hpp"
#include "math/one_sided_spring.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

/// mu0/(4 pi) [N/A2]; the measured value differs by 2e-10 of it.
constexpr double kMagnetic = 1e-7;

/// Force on P at b, torque on P about b.
template <class S>
struct PointLoad {
  Vec3<S> f = Vec3<S>::Zero(), t = Vec3<S>::Zero();
  S energy = S(0), dissipation = S(0);
};

/// @param d, rate  of the line. Where the points coincide it has no direction.
template <class S>
PointLoad<S> calc_spring(const VehicleForce& force, const Vec3<S>& d, const Vec3<S>& rate) {
  using std::sqrt;
  const S k(force.stiffness), free(force.free_length), square = d.squaredNorm();
  PointLoad<S> load;
  load.f = -k * d;
  load.energy = k / S(2) * free * free;
  if (!(square > S(0))) return load;
  const S length = sqrt(square), stretch = length - free, speed = d.dot(rate) / length;
  const S damping(force.damping);
  load.f += (k * free - damping * speed) / length * d;
  load.energy = k / S(2) * stretch * stretch;
  load.dissipation = damping * speed * speed;
  return load;
}

template <class S>
PointLoad<S> calc_tether(const VehicleForce& force, const Vec3<S>& d, const Vec3<S>& rate) {
  using std::sqrt;
  PointLoad<S> load;
  const S square = d.squaredNorm();
  if (!(square > S(force.free_length * force.free_length))) return load;
  const S length = sqrt(square), stretch = length - S(force.free_length), toe(force.toe);
  const S speed = d.dot(rate) / length;
  const Elastic<S> elastic = calc_toe_spring<S>(stretch, S(force.stiffness), toe);
  const S damping = S(force.damping) * std::min<S>(S(1), stretch / toe);
  const S tension = std::max<S>(S(0), elastic.force + damping * speed);
  load.f = -(tension / length) * d;
  load.energy = elastic.energy;
  load.dissipation = (tension - elastic.force) * speed;
  return load;
}

template <class S>
PointLoad<S> calc_dipoles(const VehicleForce& force, const Vec3<S>& d, const Mat3<S>& R) {
  using std::sqrt;
  const Vec3<S> m = cast<S>(force.chaser_moment), n = R * cast<S>(force.target_moment);
  const S square = d.squaredNorm() + S(force.size) * S(force.size);
  const S by_3 = S(kMagnetic) / (square * sqrt(square)), by_5 = S(3) * by_3 / square;
  const S along_m = m.dot(d), along_n = n.dot(d), both = along_m * along_n / square;
  PointLoad<S> load;
  load.energy = by_3 * (m.dot(n) - S(3) * both);
  load.f = by_5 * ((m.dot(n) - S(5) * both) * d + along_n * m + along_m * n);
  load.t = n.cross(Vec3<S>(by_5 * along_m * d - by_3 * m));
  return load;
}

/// Weight of an offset in the sum over offsets, and its slope by the square u of the offset.
template <class S>
struct OffsetWeight {
  S value, slope;
};
template <class S>
OffsetWeight<S> find_weight(const ForceTable& table, size_t j, const S& u) {
  const std::vector<double>& at = table.square;
  if (!(u < S(at.back()))) return {S(j + 1 == at.size() ? 1.0 : 0.0), S(0)};
  const auto next = std::upper_bound(at.begin() + 1, at.end() - 1, to_double(u));
  const size_t i = static_cast<size_t>(next - at.begin()) - 1;
  const S h = S(at[i + 1]) - S(at[i]), x = (u - S(at[i])) / h;
  const S start(j == i ? 1.0 : 0.0), rise = S(j == i + 1 ? 1.0 : 0.0) - start;
  const S a = h * S(table.slope[i][j]), b = h * S(table.slope[i + 1][j]);
  const S c2 = S(3) * rise - S(2) * a - b, c3 = a + b - S(2) * rise;
  return {start + x * (a + x * (c2 + x * c3)), (a + x * (S(2) * c2 + x * S(3) * c3)) / h};
}

template <class S>
PointLoad<S> calc_table(const VehicleForce& force, const Vec3<S>& d) {
  PointLoad<S> load;
  const ForceTable& table = force.table;
  const S last(table.force.front().back()), u = d[1] * d[1] + d[2] * d[2], scale(force.scale);
  if (d[0] >= last) return load;
  for (size_t j = 0; j < table.force.size(); ++j) {
    const OffsetWeight<S> weight = find_weight<S>(table, j, u);
    const MonotoneCubic& over_gap = table.force[j];
    const MonotoneCubic::At<S> at = over_gap.at<S>(d[0], false);
    const S stored = scale * (over_gap.at<S>(last, false).integral - at.integral);
    load.energy += weight.value * stored;
    load.f[0] += weight.value * scale * at.value;
    for (int i : {1, 2}) load.f[i] -= S(2) * weight.slope * stored * d[i];
  }
  return load;
}

}  // namespace

template <class S>
VehicleForceLoad<S> calc_vehicle_force(const VehicleForce& force, const RelativeMotion<S>& motion) {
  const Vec3<S> arm = motion.R * cast<S>(force.target_point);
  const Vec3<S> d = find_line(force, motion), rate = motion.v + motion.w.cross(arm);
  PointLoad<S> load;
  switch (force.kind) {
    case VehicleForce::Kind::kSpring:
      load = calc_spring<S>(force, d, rate);
      break;
    case VehicleForce::Kind::kTether:
      load = calc_tether<S>(force, d, rate);
      break;
    case VehicleForce::Kind::kDipoles:
      load = calc_dipoles<S>(force, d, motion.R);
      break;
    case VehicleForce::Kind::kTable:
      load = calc_table<S>(force, d);
      break;
  }
  VehicleForceLoad<S> sum;
  sum.on_passive.f = load.f;
  sum.on_passive.t = load.t + (motion.p + arm).cross(load.f);
  sum.energy = load.energy;
  sum.dissipation = load.dissipation;
  return sum;
}

template <class S>
VehicleForceLoad<S> sum_vehicle_forces(const std::vector<VehicleForce>& forces,
                                       const RelativeMotion<S>& motion) {
  VehicleForceLoad<S> sum;
  for (const VehicleForce& force : forces) {
    const VehicleForceLoad<S> load = calc_vehicle_force<S>(force, motion);
    sum.on_passive += load.on_passive;
    sum.energy += load.energy;
    sum.dissipation += load.dissipation;
  }
  return sum;
}

#define DOCK_INSTANTIATE(S)                                                            \
  template VehicleForceLoad<S> calc_vehicle_force<S>(const VehicleForce&,              \
                                                     const RelativeMotion<S>&);        \
  template VehicleForceLoad<S> sum_vehicle_forces<S>(const std::vector<VehicleForce>&, \
                                                     const RelativeMotion<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
