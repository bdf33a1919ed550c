// Evaluation of pairs.
//
// Per pair and place of contact: closest points p on G and q on P with V, n = (q - p)/sqrt(V),
// depth = rounding - sqrt(V), depth rate = -n.v at c = (p + q)/2, force F n on P at c. n is not
// normalised (|n| < 1 by about mu): only then is the elastic force the gradient of its potential.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <tuple>
#include <type_traits>

#include "contact/contact_pair_body.hpp"

namespace dockloop {
namespace {

constexpr double kDeepest = 0.98;          // limit of depth/rounding of accepted states [-]
constexpr double kLeastRoot = 1e-6;        // [m] of sqrt(V)
constexpr double kSlack = 1e-9;            // [m] rounding errors of the displacement bound
constexpr double kLeastListRadius = 5e-3;  // [m] of the neighbour list
constexpr double kGapLimit = 0.1;          // [m] a bound is sufficient for larger gaps
constexpr int kSearches = 8;               // evaluations of an accepted step, about

inline Vec3<double> get_last_normal(const ContactMemory& memory, int pair) {
  return Eigen::Map<const Vec3<double>>(memory.n_last[static_cast<size_t>(pair)].data());
}

/// Displacement bound of the hardware of P from a list origin [m], rounded up.
/// 2 sin(theta/2) = |R - R_origin|_F/sqrt(2).
template <class S>
S find_displacement(const ActiveBody& body, const Pose<double>& origin,
                    const RelativeMotion<S>& x) {
  using std::sqrt;
  const S turn = (x.R - cast<S>(origin.R)).squaredNorm() / S(2);
  return (x.p - cast<S>(origin.p)).norm() + sqrt(turn) * S(body.bounding_radius) + S(kSlack);
}

/// Lower bound of the gap from two spheres about the origins of G and P [m].
template <class S>
S find_sphere_gap(const ActiveBody& body, const RelativeMotion<S>& x) {
  return x.p.norm() - S(2 * body.bounding_radius);
}

/// Upper bound of the number of places of a pair. On a piece, a segment has at most one more than
/// it has breaks, and two at its ends.
inline size_t find_most_places(const ContactModel& model, const ContactPair& pair) {
  constexpr size_t kOnPiece = std::tuple_size_v<decltype(Breaks::t)> + 3;
  const Core& second = (pair.first_on_passive ? model.active : model.passive)[pair.second];
  const size_t parts = 2 * static_cast<size_t>(second.profile.piece_count()) + 1;
  return pair.kind == PairKind::kPointRevolution     ? parts
         : pair.kind == PairKind::kSegmentRevolution ? parts * kOnPiece
                                                     : 1;
}

/// Add the force of a pair on P to the surfaces that take part. @param piece  of a profile
template <class S>
void book_force(const ContactModel& model, const ContactPair& pair, int piece, const Vec3<S>& force,
                ContactResult<S>& out) {
  const bool flip = pair.first_on_passive;
  const auto find_surface = [piece](const Core& core) {
    return core.piece_surfaces.empty() ? core.surface : core.piece_surfaces[piece];
  };
  const int on_active = find_surface(model.active[flip ? pair.second : pair.first]);
  const int on_passive = find_surface(model.passive[flip ? pair.first : pair.second]);
  if (on_active >= 0) out.surface_force[on_active] -= force;
  if (on_passive >= 0) out.surface_force[on_passive] += force;
}

/// Normal force at one place of a closed pair.
template <class S>
struct Pressing {
  Vec3<S> n, at, v;  ///< n not normalised; where; velocity of P relative to G there
  S gap, rate;       ///< rate of the depth
  Elastic<S> elastic;
  S normal;  ///< with damping
  Vec3<S> find_slip(const Vec3<S>& e) const { return v - e * e.dot(v); }
};

template <class S>
Pressing<S> find_pressing(const ContactLaw& law, const S& rounding, const RelativeMotion<S>& x,
                          const Place<S>& c) {
  using std::sqrt;
  Pressing<S> p;
  p.gap = sqrt(c.square) - rounding;
  p.n = (c.second - c.first) / (p.gap + rounding);
  p.at = (c.first + c.second) / S(2);
  p.v = x.v + x.w.cross(p.at - x.p);
  p.rate = -p.n.dot(p.v);
  p.elastic = calc_contact_spring<S>(-p.gap, S(law.stiffness), S(law.toe), rounding);
  p.normal = calc_damped_force<S>(p.elastic.force, S(law.damping), p.rate);
  return p;
}

/// Sums over the places of a pair that touches at several.
template <class S>
struct PlaceSums {
  S elastic = S(0), normal = S(0);
  Vec3<S> n = Vec3<S>::Zero(), v = Vec3<S>::Zero();      ///< weighted with the elastic force
  S damped[2] = {S(0), S(0)}, rubbed[2] = {S(0), S(0)};  ///< powers of valleys and of ridges
  /// A ridge takes back dissipation of its valleys, at most all of it.
  static S find_share(const S power[2]) { return power[1] > power[0] ? power[0] / power[1] : S(1); }
};

template <class S>
PlaceSums<S> find_sums(const ContactLaw& law, const S& rounding, const RelativeMotion<S>& x,
                       const std::vector<Place<S>>& places) {
  PlaceSums<S> sums;
  for (const Place<S>& place : places) {
    const Pressing<S> p = find_pressing<S>(law, rounding, x, place);
    const S sign(place.sign), force = sign * p.elastic.force;
    sums.elastic += force;
    sums.normal += sign * p.normal;
    sums.n += p.n * force;
    sums.v += p.v * force;
    sums.damped[place.sign < 0] += (p.normal - p.elastic.force) * p.rate;
    sums.rubbed[place.sign < 0] +=
        calc_regularised_friction<S>(law, p.normal, p.find_slip(p.n.normalized())).power;
  }
  if (sums.elastic > S(0)) {
    sums.n /= sums.elastic;
    sums.v /= sums.elastic;
  }
  return sums;
}

/// Contribution of one closed pair; z, z_dot are its bristle or null. A pair has one bristle: its
/// friction is that of the mean place, and acts at all places in proportion to their forces.
template <class S>
void add_contact(const ContactModel& model, const ContactPair& pair, const RelativeMotion<S>& x,
                 const std::vector<Place<S>>& places, const S* z, S* z_dot, ContactResult<S>& out) {
  const ContactLaw& law = model.laws[pair.law];
  const S rounding(pair.rounding);
  const bool several = places.size() > 1;
  PlaceSums<S> sums;
  if (several) sums = find_sums<S>(law, rounding, x, places);
  const S damping_share = PlaceSums<S>::find_share(sums.damped);
  const S friction_share = PlaceSums<S>::find_share(sums.rubbed);
  S damped(0), rubbed(0);
  for (const Place<S>& place : places) {
    const Pressing<S> p = find_pressing<S>(law, rounding, x, place);
    const S sign(place.sign);
    S normal = p.normal;
    if (place.sign < 0) normal = p.elastic.force + damping_share * (normal - p.elastic.force);
    out.energy += sign * p.elastic.energy;
    damped += sign * ((normal - p.elastic.force) * p.rate);

    // Friction in the tangent plane.
    const Vec3<S> e = (z && several ? sums.n : p.n).normalized();
    Friction<S> friction;
    if (!z) {
      friction = calc_regularised_friction<S>(law, p.normal, p.find_slip(e));
      if (place.sign < 0) {
        friction.force *= friction_share;
        friction.power *= friction_share;
      }
    } else {
      const Vec3<S> v = several ? sums.v : p.v;
      friction = calc_bristle_friction<S>(law, several ? sums.normal : p.normal, v - e * e.dot(v),
                                          e, Eigen::Map<const Vec3<S>>(z));
      Eigen::Map<Vec3<S>> rate_map(z_dot);
      rate_map = friction.bristle_rate;
      if (several) {
        const S part = sums.elastic > S(0) ? p.elastic.force / sums.elastic : S(0);
        friction.force *= part;
        friction.power *= part;
      }
    }
    rubbed += sign * friction.power;

    // Sum.
    const Vec3<S> f = (p.n * normal + friction.force) * sign;
    out.on_passive.f += f;
    out.on_passive.t += p.at.cross(f);
    book_force<S>(model, pair, place.piece, f, out);
    out.depth_ratio = std::max<S>(out.depth_ratio, -p.gap / rounding);
  }
  out.contact_power += std::max<S>(damped, S(0));  // rounding, where a ridge takes back all
  out.friction_power += std::max<S>(rubbed, S(0));
  ++out.active_count;
}

/// Bristles of open pairs relax as those of closed ones do without normal force; all store energy.
template <class S>
void add_bristles(const ContactModel& model, const std::vector<char>& closed, const S* z, S* z_dot,
                  ContactResult<S>& out) {
  for (size_t i = 0; i < closed.size(); ++i) {
    const ContactLaw& law = model.laws[model.pairs[i].law];
    const S k = S(law.bristle_stiffness), rate = k / S(law.bristle_relaxation);
    const S square = Eigen::Map<const Vec3<S>>(z + 3 * i).squaredNorm();
    out.energy += k * square / S(2);
    if (closed[i]) continue;
    out.friction_power += k * rate * square;
    for (size_t j = 3 * i; j < 3 * i + 3; ++j) z_dot[j] = -z[j] * rate;
  }
}

enum class NodesFound { kAdded, kTooDeep, kRefused };

/// The pairs of a set of nodes together, in groups with work.may_touch. kTooDeep: nothing was
/// added; evaluate the pairs one by one.
inline NodesFound add_nodes(const ContactModel& model, const NodeSet& set,
                            const ContactMemory& memory, const RelativeMotion<double>& motion,
                            ContactWorkspace<double>& work, ContactResult<double>& out,
                            Status& status) {
  const ContactPair& pair = model.pairs[set.first];
  const Core& face = (set.on_passive ? model.active : model.passive)[pair.second];
  const Annulus<double> ring = get_annulus(face);
  const ContactLaw& law = model.laws[pair.law];
  nodes::NodeContact contact;
  contact.on_passive = set.on_passive;
  Eigen::Map<Mat3<double>>(contact.R) = motion.R;
  Eigen::Map<Vec3<double>>(contact.p) = motion.p;
  Eigen::Map<Vec3<double>>(contact.w) = motion.w;
  Eigen::Map<Vec3<double>>(contact.v) = motion.v;
  contact.ring_x = ring.x;
  contact.ring_inner = ring.inner;
  contact.ring_outer = ring.outer;
  contact.rounding = pair.rounding;
  contact.stiffness = law.stiffness;
  contact.toe = law.toe;
  contact.damping = law.damping;
  contact.friction_coefficient = law.friction_coefficient;
  contact.friction_speed = law.friction_speed;
  alignas(64) double lanes[nodes::kNodeSums][kSumLanes] = {};
  const auto find_count = [&](size_t g) {
    return std::min(kGroup, set.count - static_cast<int>(g) * kGroup);
  };
  const auto find_before = [&](size_t g) {  // in contact at the last accepted step?
    return memory.closed.empty() ? nullptr : &memory.closed[set.first + g * kGroup];
  };
  for (size_t g = 0; g < set.groups.size(); ++g) {
    if (!work.may_touch[g]) continue;
    const char* before = find_before(g);
    const bool ways = before && std::memchr(before, 1, static_cast<size_t>(find_count(g)));
    if (work.node_functions->add_group(set.groups[g], find_count(g), contact, ways,
                                       work.node_gaps[g], lanes) == nodes::Touch::kDeep) {
      return NodesFound::kTooDeep;
    }
  }
  double least = kNoGap, deepest = 0.0;
  int active = 0;
  for (size_t g = 0; g < set.groups.size(); ++g) {
    if (!work.may_touch[g]) continue;
    const nodes::NodeGaps& gaps = work.node_gaps[g];
    const char* before = find_before(g);
    const int first = set.first + static_cast<int>(g) * kGroup, count = find_count(g);
    char* const closed = work.closed.data() + first;
    Vec3<double>* const ways = work.way.data() + first;
    for (int i = 0; i < count; ++i) {
      const double gap = gaps.gap[i];
      const bool was_closed = before && before[i];
      least = std::min(least, gap);
      if (!was_closed && !(gap < 0.0)) continue;
      const Vec3<double> way(gaps.way[0][i], gaps.way[1][i], gaps.way[2][i]);
      if (was_closed && way.dot(get_last_normal(memory, first + i)) < 0.0) {
        status = {StatusCode::kContactFlipped, first + i, -gap / contact.rounding};
        return NodesFound::kRefused;
      }
      if (!(gap < 0.0)) continue;
      deepest = std::max(deepest, -gap);
      ++active;
      closed[i] = 1;
      ways[i] = way;
    }
  }
  out.depth_ratio = std::max(out.depth_ratio, deepest / contact.rounding);
  out.active_count += active;
  double sums[nodes::kNodeSums];
  work.node_functions->add_lanes(lanes, nodes::kNodeSums, sums);
  out.gap = std::min(out.gap, least);
  const Vec3<double> force = Eigen::Map<const Vec3<double>>(sums + nodes::kSumForce);
  out.on_passive.f += force;
  out.on_passive.t += Eigen::Map<const Vec3<double>>(sums + nodes::kSumMoment);
  out.energy += sums[nodes::kSumEnergy];
  out.contact_power += sums[nodes::kSumContactPower];
  out.friction_power += sums[nodes::kSumFrictionPower];
  book_force<double>(model, pair, 0, force, out);
  return NodesFound::kAdded;
}

/// Sum over pairs of a body in index order. Pairs that are open by the bounds of spheres or list
/// origin contribute exactly nothing, so skipping them does not change a bit of the result.
template <class S>
Status add_pairs(const ContactModel& model, int body, const ContactMemory& memory,
                 const RelativeMotion<S>& motion, const S* z, S* z_dot, ContactWorkspace<S>& work,
                 ContactResult<S>& out) {
  // No contact: the spheres of the two sides are apart, or all pairs are open by the bounds of the
  // list.
  using std::sqrt;
  const ActiveBody& of = model.bodies[body];
  const NeighbourList* list = memory.find_list(body);
  if (of.count == 0) return {};
  out.gap = find_sphere_gap<S>(of, motion);
  if (out.gap > S(0)) return {};
  const S from_all = list ? find_displacement<S>(of, list->all, motion) : S(0);
  out.gap = list ? S(list->least_gap) - from_all : S(0);
  if (out.gap > S(0)) return {};

  forget_plates(work);
  const bool near_only = list && from_all <= S(list->radius);
  out.gap = near_only ? S(list->radius) - from_all : S(kNoGap);
  const S delta = near_only ? find_displacement<S>(of, list->close, motion) : from_all;
  // Of pairs that are open by their bounds, only the bounds count. All others are looked at.
  int* const pairs = work.looked_at.data();
  int count = 0;
  if (list) {
    const std::vector<double>& gaps = near_only ? list->near_gap : list->gap;
    const int* const near = near_only ? list->near.data() : nullptr;
    const char* const closed = memory.closed.data();
    for (size_t k = 0; k < gaps.size(); ++k) {
      const int i = near ? near[k] : of.first + static_cast<int>(k);
      const S bound = S(gaps[k]) - delta;
      const bool is_open = !closed[i] && bound > S(0);
      pairs[count] = i;
      count += is_open ? 0 : 1;
      if (is_open) out.gap = std::min<S>(out.gap, bound);
    }
  } else {
    count = of.count;
    std::iota(pairs, pairs + count, of.first);
  }
  const auto was_closed_at = [&](int i) { return list && memory.closed[i]; };
  [[maybe_unused]] int one_by_one = 0;  // pairs before this one are not evaluated together
  for (int k = 0; k < count; ++k) {
    const int i = pairs[k];
    const ContactPair& pair = model.pairs[i];
    const bool was_closed = was_closed_at(i);
    if constexpr (std::is_same_v<S, double>) {
      if (pair.node_set >= 0 && !z && one_by_one <= i) {
        const NodeSet& set = model.node_sets[pair.node_set];
        const int end = set.first + set.count;
        std::fill(work.may_touch.begin(), work.may_touch.end(), 0);
        char* const may_touch = work.may_touch.data();
        int last = k;  // of the set
        for (; last < count && pairs[last] < end; ++last) {
          may_touch[static_cast<unsigned>(pairs[last] - set.first) / kGroup] = 1;
        }
        Status status;
        const NodesFound found = add_nodes(model, set, memory, motion, work, out, status);
        if (found == NodesFound::kRefused) return status;
        if (found == NodesFound::kAdded) {  // continue after the set
          k = last - 1;
          continue;
        }
        one_by_one = end;
      }
    }
    Place<S> c;
    std::vector<Place<S>>& places = work.places;
    const S gap =
        find_pair<S>(model, pair, motion, work, was_closed ? S(kNoGap) : S(0), c, &places);
    out.gap = std::min<S>(out.gap, gap);
    if (gap >= S(0)) ++work.searched[body];
    if (gap >= S(0) && !was_closed) continue;

    // States that must not be accepted: no place is on the side of the last one, or one is too
    // deep.
    if (places.empty()) places.push_back(c);
    const double margin = to_double(-gap) / pair.rounding;
    const auto keeps_side = [&](const Place<S>& place) {
      return place.sign > 0 &&
             !((place.second - place.first).dot(cast<S>(get_last_normal(memory, i))) < S(0));
    };
    if (was_closed && std::none_of(places.begin(), places.end(), keeps_side)) {
      return {StatusCode::kContactFlipped, i, margin};
    }
    if (gap >= S(0)) continue;
    const S rounding(pair.rounding), least = S((1 - kDeepest) * pair.rounding);
    for (const Place<S>& place : places) {
      const S root = sqrt(place.square) - rounding + rounding;  // as its gap is rounded
      if (root <= least || root < S(kLeastRoot) || (place.second - place.first).norm() <= least) {
        return {StatusCode::kContactTooDeep, i, margin};
      }
      if constexpr (std::is_same_v<S, double>) {
        if (pair.node_set >= 0) continue;
        work.touching.push_back(
            {i, place.sign, place.second - place.first, (place.first + place.second) / 2.0, root});
      }
    }
    add_contact<S>(model, pair, motion, places, z ? z + 3 * i : nullptr,
                   z ? z_dot + 3 * i : nullptr, out);
    work.closed[i] = 1;
    work.way[i] = c.second - c.first;
  }
  return {};
}

/// Of all bodies together. @param R  axes of the body in G
template <class S>
void add_sums(const ContactResult<S>& part, const Mat3<S>& R, ContactResult<S>& out) {
  out.energy += part.energy;
  out.contact_power += part.contact_power;
  out.friction_power += part.friction_power;
  out.gap = std::min<S>(out.gap, part.gap);
  out.depth_ratio = std::max<S>(out.depth_ratio, part.depth_ratio);
  out.active_count += part.active_count;
  for (int i = 0; i < kMaxSurfaces; ++i) out.surface_force[i] += R * part.surface_force[i];
}

/// The absorber acts at the origin of P, where its depth is measured: its power is then -F d'.
template <class S>
void calc_absorber(const AbsorberLaw& law, Acting acting, const RelativeMotion<S>& x,
                   ContactResult<S>& out) {
  const S depth = -x.p[0], rate = -x.v[0];
  const S elastic = S(law.stiffness) * depth, pushing = elastic + S(law.damping) * rate;
  out.gap = -depth;
  out.pressed = law.pulls ? depth : std::min<S>(depth, pushing);
  const bool acts = acting == Acting::kByState ? out.pressed > S(0) : acting == Acting::kYes;
  if (!acts && depth <= S(0)) return;  // a released absorber returns by itself
  const S force = acts ? pushing : S(0);
  out.on_passive.f = Vec3<S>(force, S(0), S(0));
  out.on_passive.t = x.p.cross(out.on_passive.f);
  out.energy = elastic * depth / S(2);
  out.contact_power = (force - elastic) * rate;
  out.active_count = 1;
}

}  // namespace

template <class S>
ContactWorkspace<S>::ContactWorkspace(const ContactModel& model) {
  const auto cast_plates = [](const std::vector<Core>& cores) {
    std::vector<Plate<S>> plates(cores.size());
    for (size_t i = 0; i < cores.size(); ++i) {
      if (cores[i].kind != CoreKind::kPlate) continue;
      std::array<Vec3<S>, 4> corner;
      for (int k = 0; k < 4; ++k) corner[k] = cast<S>(cores[i].plate.corner[k]);
      plates[i] = make_plate<S>(corner);
    }
    return plates;
  };
  active_plates = cast_plates(model.active);
  passive_plates = passive_local = cast_plates(model.passive);
  is_placed.assign(model.passive.size(), 0);
  closed.assign(model.pairs.size(), 0);
  searched.assign(model.bodies.size(), 0);
  on_passive.resize(model.bodies.size() - 1);
  way.assign(model.pairs.size(), Vec3<S>::Zero());
  size_t most = 1, all = 0;
  for (const ContactPair& pair : model.pairs) {
    const size_t count = find_most_places(model, pair);
    most = std::max(most, count);
    all += count;
  }
  places.reserve(most);
  if (std::is_same_v<S, double>) touching.reserve(all);
  node_functions = &nodes::find_node_functions();
  plate_functions = &plates::find_plate_functions();
  for (const NodeSet& set : model.node_sets) {
    node_gaps.resize(std::max(node_gaps.size(), set.groups.size()));
  }
  may_touch.assign(node_gaps.size(), 0);
  looked_at.resize(model.pairs.size());
}

template <class S>
Status calc_contact(const ContactModel& model, const ContactMemory& memory,
                    const HardwareMotion<S>& motion, const S* z, S* z_dot,
                    ContactWorkspace<S>& work, ContactResult<S>& out) {
  out = ContactResult<S>();
  if (model.kind == ContactModel::Kind::kAbsorber) {
    calc_absorber<S>(model.absorber, memory.absorber, motion, out);
  }
  if (!model.has_surfaces()) return {};
  std::fill(work.closed.begin(), work.closed.end(), 0);
  std::fill(work.searched.begin(), work.searched.end(), 0);
  work.touching.clear();
  const bool bristles = model.law.friction_model == 2;
  if (!bristles) z = nullptr;
  Status status = add_pairs<S>(model, 0, memory, motion, z, z_dot, work, out);
  for (int body = 1; body < model.body_count() && status.ok(); ++body) {
    ContactResult<S> part;
    status = add_pairs<S>(model, body, memory, motion.of(body), z, z_dot, work, part);
    work.on_passive[body - 1] = part.on_passive;
    add_sums(part, motion.R * motion.of(body).R.transpose(), out);
  }
  if (bristles && status.ok()) add_bristles<S>(model, work.closed, z, z_dot, out);
  return status;
}

template <class S>
S find_gap(const ContactModel& model, const ContactMemory& memory, const HardwareMotion<S>& motion,
           ContactWorkspace<S>& work) {
  if (model.kind == ContactModel::Kind::kAbsorber) return motion.p[0];
  S gap = S(kNoGap);
  for (int body = 0; body < model.body_count(); ++body) {
    const ActiveBody& of = model.bodies[body];
    const RelativeMotion<S>& seen = motion.of(body);
    const NeighbourList* list = memory.find_list(body);
    const S from_all = list ? find_displacement<S>(of, list->all, seen) : S(0);
    const auto look_at = [&](int i) {
      Place<S> c;
      gap = std::min<S>(gap, find_pair<S>(model, model.pairs[i], seen, work, gap, c));
    };
    forget_plates(work);
    if (list) {  // the closest pair is one of those that were near, as a rule the closest one
      const S from_close = find_displacement<S>(of, list->close, seen);
      const std::vector<double>& gaps = list->near_gap;
      const auto closest =
          static_cast<size_t>(std::min_element(gaps.begin(), gaps.end()) - gaps.begin());
      if (!gaps.empty()) look_at(list->near[closest]);
      for (size_t k = 0; k < gaps.size(); ++k) {
        if (k != closest && S(gaps[k]) - from_close < gap) look_at(list->near[k]);
      }
      if (!(S(list->radius) - from_all < gap)) continue;
    }
    for (int k = 0; k < of.count; ++k) {
      if (!list || S(list->gap[k]) - from_all < gap) look_at(of.first + k);
    }
  }
  return gap;
}

#define DOCK_INSTANTIATE(S)                                                                     \
  template struct ContactWorkspace<S>;                                                          \
  template Status calc_contact<S>(const ContactModel&, const ContactMemory&,                    \
                                  const HardwareMotion<S>&, const S*, S*, ContactWorkspace<S>&, \
                                  ContactResult<S>&);                                           \
  template S find_gap<S>(const ContactModel&, const ContactMemory&, const HardwareMotion<S>&,   \
                         ContactWorkspace<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
