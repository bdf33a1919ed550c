// Arithmetic of nodes in lanes; see node_lanes.hpp. Included once per instruction set, with LANES
// (lanes in a register) defined.
#include "contact/node_lanes.hpp"
#include "math/lane_arithmetic.hpp"

namespace dockloop::nodes {
namespace {

using namespace lanes;

template <bool kOnPassive>
Touch add_nodes(const NodeGroup& group, int at, Mask used, const NodeContact& contact, bool ways,
                NodeGaps& gaps, double (*sums)[kSumLanes]) {
  const Cells in{const_cast<double (*)[kGroup]>(group.position), at};
  const Cells way{gaps.way, at};
  const Sums total{{sums, at}};
  const M R = {spread3(contact.R), spread3(contact.R + 3), spread3(contact.R + 6)};
  const V p = spread3(contact.p), x = in.get_vector(0);
  const Lanes zero{};
  // Nearest point of the face, axes of its side.
  const V node = kOnPassive ? R * x + p : turn_back(R, x - p);
  const Lanes r = take_root(node.y * node.y + node.z * node.z);
  const Lanes inner = spread(contact.ring_inner), outer = spread(contact.ring_outer);
  const Lanes at_least = r < inner ? inner : r, rc = at_least > outer ? outer : at_least;
  const Mask off_axis = r > zero;
  const V q = {spread(contact.ring_x), off_axis ? node.y * rc / r : rc,
               off_axis ? node.z * rc / r : zero};
  const V between = node - q;
  const Lanes root = take_root(dot(between, between));
  const Lanes gap = root - spread(contact.rounding);
  *reinterpret_cast<Lanes*>(&gaps.gap[at]) = gap;
  const Mask closed = (gap < zero) & used;
  const bool touches = has_any(closed);
  if (!touches && !ways) return Touch::kNone;
  const V first = kOnPassive ? q : R * node + p, second = kOnPassive ? node : R * q + p;
  way.put(0, second - first);
  if (!touches) return Touch::kNone;

  // Normal force.
  const V n = (1.0 / root) * (second - first), c = spread(0.5) * (first + second);
  const V v = spread3(contact.v) + cross(spread3(contact.w), c - p);
  const Lanes rate = -dot(n, v), depth = -gap;
  const Lanes k = spread(contact.stiffness), toe = spread(contact.toe);
  const Lanes past = depth - toe / 2.0;
  const Mask in_toe = depth < toe;
  const Lanes elastic = in_toe ? k * depth * depth / (2.0 * toe) : k * past;
  const Lanes energy =
      in_toe ? k * depth * depth * depth / (6.0 * toe) : k * (past * past / 2.0 + toe * toe / 24.0);
  const Lanes factor = 1.0 + spread(contact.damping) * rate;
  const Lanes normal = elastic * (factor > zero ? factor : zero);
  // Friction in the tangent plane.
  const Lanes along = dot(n, v) / dot(n, n);
  const V slip = v - along * n;
  const Lanes square = dot(slip, slip), speed = spread(contact.friction_speed);
  const Lanes drag =
      spread(contact.friction_coefficient) * normal / take_root(square + speed * speed);
  const V force = normal * n - drag * slip, moment = cross(c, force);
  const auto add = [&](int row, Lanes value) { total.add(row, closed ? value : zero); };
  add(kSumForce, force.x), add(kSumForce + 1, force.y), add(kSumForce + 2, force.z);
  add(kSumMoment, moment.x), add(kSumMoment + 1, moment.y), add(kSumMoment + 2, moment.z);
  add(kSumEnergy, energy);
  add(kSumContactPower, (normal - elastic) * rate);
  add(kSumFrictionPower, drag * square);
  return has_any((depth > spread(contact.rounding / 2.0)) & closed) ? Touch::kDeep
                                                                    : Touch::kShallow;
}

Touch add_group(const NodeGroup& group, int count, const NodeContact& contact, bool ways,
                NodeGaps& gaps, double (*sums)[kSumLanes]) {
  Touch touch = Touch::kNone;
  for (int at = 0; at < kGroup; at += LANES) {
    Mask used;
    for (int i = 0; i < LANES; ++i) used[i] = at + i < count ? -1 : 0;
    const Touch here = contact.on_passive
                           ? add_nodes<true>(group, at, used, contact, ways, gaps, sums)
                           : add_nodes<false>(group, at, used, contact, ways, gaps, sums);
    if (here > touch) touch = here;
  }
  return touch;
}

void add_all_lanes(const double (*row)[kSumLanes], int count, double* sums) {
  add_lanes(row, count, sums);
}

constexpr NodeFunctions kFunctions = {add_group, add_all_lanes};

}  // namespace

}  // namespace dockloop::nodes
