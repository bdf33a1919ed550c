// Closest points of one pair of cores, and cheap bounds of their distance.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

#include "contact/contact_model.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

/// A plate of P in axes of G. @pre is_placed is cleared for a new motion
template <class S>
const Plate<S>& get_passive_plate(int i, const RelativeMotion<S>& x, ContactWorkspace<S>& work) {
  if (!work.is_placed[i]) {
    work.passive_plates[i] = place_plate<S>(work.passive_local[i], x.R, x.p);
    work.is_placed[i] = 1;
  }
  return work.passive_plates[i];
}

template <class S>
void forget_plates(ContactWorkspace<S>& work) {
  std::fill(work.is_placed.begin(), work.is_placed.end(), 0);
}

template <class S>
Annulus<S> cast_annulus(const Annulus<double>& ring) {
  return {S(ring.x), S(ring.inner), S(ring.outer)};
}

/// Adds a place of a surface of revolution. Two of opposite sign at one point of a node cancel.
template <class S>
void add_place(const Place<S>& place, std::vector<Place<S>>& places) {
  constexpr double kSame = 1e-10;  // of t: values differ by its square
  for (auto other = places.begin(); place.node >= 0 && other != places.end(); ++other) {
    if (other->node == place.node && other->sign != place.sign &&
        std::abs(to_double(other->t - place.t)) < kSame) {
      places.erase(other);
      return;
    }
  }
  places.push_back(place);
}

/// Lower bound of the distance of a point from a profile in this box of the half-plane [m].
template <class S>
S find_box_gap(const ProfileBox& box, const Vec3<S>& centre) {
  using std::max;
  const S r = find_axis_distance<S>(centre[1], centre[2]);
  const S along = max<S>(S(box.x_low) - centre[0], centre[0] - S(box.x_high));
  return max<S>(along, max<S>(S(box.r_low) - r, r - S(box.r_high)));
}

/// Closest points of one pair, first on G, second on P, axes of G; returns the gap [m].
/// If a cheap lower bound of the gap exceeds `limit`, that is returned and `c` is not set.
/// Pairs with a surface of revolution work in its axes.
/// @param[out] places  where such a pair touches, empty for other pairs; null: only `c` is wanted
template <class S>
S find_pair(const ContactModel& model, const ContactPair& pair, const RelativeMotion<S>& x,
            ContactWorkspace<S>& work, const S& limit, Place<S>& c,
            std::vector<Place<S>>* places = nullptr) {
  if (places) places->clear();
  using std::abs;
  using std::max;
  using std::min;
  using std::sqrt;
  const bool on_passive = pair.first_on_passive;
  const Core& first = (on_passive ? model.passive : model.active)[pair.first];
  const Core& second = (on_passive ? model.active : model.passive)[pair.second];
  const S rounding = S(pair.rounding), mu = S(model.laws[pair.law].regularisation);
  const auto into_other = [&](const Vec3<double>& point) -> Vec3<S> {
    const Vec3<S> r = cast<S>(point);
    return on_passive ? x.R * r + x.p : x.R.transpose() * (r - x.p);
  };
  const auto into_axis = [&](const Vec3<double>& point) -> Vec3<S> {
    const Mat3<S> R = cast<S>(second.axis.R);
    return R.transpose() * (into_other(point) - cast<S>(second.axis.p));
  };
  const auto into_G = [&](const Vec3<double>& point, bool passive) -> Vec3<S> {
    const Vec3<S> r = cast<S>(point);
    return passive ? x.R * r + x.p : r;
  };
  const auto find_sphere_bound = [&]() -> S {
    const CoreSphere &a = first.sphere, &b = second.sphere;
    const Vec3<S> between = into_G(b.centre, !on_passive) - into_G(a.centre, on_passive);
    return between.norm() - S(a.radius + b.radius) - rounding;
  };
  const auto put_sides = [&]() -> S {  // points in axes of G, so far in the order of the pair
    if (on_passive) std::swap(c.first, c.second);
    return sqrt(c.square) - rounding;
  };
  const auto get_second_plate = [&]() -> const Plate<S>& {
    return on_passive ? work.active_plates[pair.second] : get_passive_plate(pair.second, x, work);
  };
  const auto take = [&](const Place<S>& place) {
    if (place.sign > 0 && place.square < c.square) c = place;
    if (places && sqrt(place.square) - rounding < S(0)) add_place<S>(place, *places);
  };
  switch (pair.kind) {
    case PairKind::kPointAnnulus: {
      const Annulus<double> ring = get_annulus(second);
      const Vec3<S> node = into_other(first.point);
      const S bound = abs(node[0] - S(ring.x)) - rounding;
      if (bound > limit) return bound;
      c = find_point_annulus<S>(node, cast_annulus<S>(ring));
      break;
    }
    case PairKind::kSegmentAnnulus: {
      const Annulus<double> ring = get_annulus(second);
      const Vec3<S> a = into_other(first.point), b = into_other(first.end);
      // Slab of the ring face, and the bore of the ring (the radius is largest at an end).
      const S xa = a[0] - S(ring.x), xb = b[0] - S(ring.x);
      const S slab = xa * xb > S(0) ? min(abs(xa), abs(xb)) : S(0);
      const S r2 = max(a[1] * a[1] + a[2] * a[2], b[1] * b[1] + b[2] * b[2]);
      const S bound = max<S>(slab, S(ring.inner) - sqrt(r2)) - rounding;
      if (bound > limit) return bound;
      c = find_segment_annulus<S>(a, b - a, cast_annulus<S>(ring), mu);
      break;
    }
    case PairKind::kPointRevolution: {
      const Vec3<S> point = into_axis(first.point);
      const S bound = find_box_gap<S>(second.box, point) - rounding;
      if (bound > limit) return bound;
      c.square = std::numeric_limits<S>::max();
      visit_point_places<S>(point, second.profile, take);
      break;
    }
    case PairKind::kSegmentRevolution: {
      const Vec3<S> a = into_axis(first.point), b = into_axis(first.end);
      const S bound =
          find_box_gap<S>(second.box, (a + b) / S(2)) - S(first.sphere.radius) - rounding;
      if (bound > limit) return bound;
      c.square = std::numeric_limits<S>::max();
      visit_segment_places<S>(a, b - a, second.profile, mu, places ? rounding : S(0), take);
      break;
    }
    case PairKind::kPlatePlate: {
      const Plate<S>&P = work.active_plates[pair.first],
            &Q = get_passive_plate(pair.second, x, work);
      const S bound = (Q.centre - P.centre).norm() - P.radius - Q.radius - rounding;
      if (bound > limit) return bound;
      if constexpr (std::is_same_v<S, double>) {
        c = find_plates(*work.plate_functions, P, Q, mu);
      } else {
        c = find_plate_plate<S>(P, Q, mu);
      }
      return sqrt(c.square) - rounding;
    }
    case PairKind::kPointPlate: {
      const Vec3<S> point = into_G(first.point, on_passive);
      const Plate<S>& plate = get_second_plate();
      const Vec3<S> d = point - plate.centre;
      const S bound = max<S>(abs(plate.normal.dot(d)), d.norm() - plate.radius) - rounding;
      if (bound > limit) return bound;
      c = find_point_plate<S>(point, plate);
      return put_sides();
    }
    default: {
      const S bound = find_sphere_bound();
      if (bound > limit) return bound;
      const Vec3<S> p0 = into_G(first.point, on_passive);
      const Vec3<S> d = into_G(first.end, on_passive) - p0;
      const Vec3<S> q0 = into_G(second.point, !on_passive);
      const Vec3<S> e = into_G(second.end, !on_passive) - q0;
      if (pair.kind == PairKind::kPointPoint) {
        c = Closest<S>{p0, q0, (p0 - q0).squaredNorm()};
      } else if (pair.kind == PairKind::kPointSegment) {
        c = find_point_segment<S>(p0, q0, e);
      } else if (pair.kind == PairKind::kSegmentSegment) {
        c = find_segment_segment<S>(p0, d, p0 + d / S(2), q0, e, q0 + e / S(2), mu);
      } else {
        c = find_segment_plate<S>(p0, d, get_second_plate(), mu);
      }
      return put_sides();
    }
  }
  // Back from the axes of the surface of revolution, and of the side that carries it.
  const bool turned =
      pair.kind == PairKind::kPointRevolution || pair.kind == PairKind::kSegmentRevolution;
  const auto put_into_G = [&](Place<S>& place) {
    if (turned) {
      const Mat3<S> R = cast<S>(second.axis.R);
      const Vec3<S> p = cast<S>(second.axis.p);
      place.first = R * place.first + p;
      place.second = R * place.second + p;
    }
    if (on_passive) {
      std::swap(place.first, place.second);
    } else {
      place.first = x.R * place.first + x.p;
      place.second = x.R * place.second + x.p;
    }
  };
  const S gap = sqrt(c.square) - rounding;
  if (!places || places->empty()) {
    put_into_G(c);
  } else {
    std::for_each(places->begin(), places->end(), put_into_G);
    c = *std::min_element(places->begin(), places->end(), [](const auto& a, const auto& b) {
      return a.sign != b.sign ? a.sign > b.sign : a.square < b.square;
    });
  }
  return gap;
}

}  // namespace
}  // namespace dockloop
