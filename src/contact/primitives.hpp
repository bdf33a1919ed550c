// Closest points of the thin convex cores that carry the surfaces: points, segments, flat
// four-cornered plates and annuli.
//
// A surface is a core plus a rounding radius, so all contact geometry is a distance between cores.
// Parallel edges and faces have many closest points; to keep one that moves continuously, the
// distance of each point from the middle of its core is added with a small weight mu (Tikhonov):
//     V = min over p, q of |p - q|^2 + mu (|p - cp|^2 + |q - cq|^2).
// The added term does not depend on the pose, hence grad sqrt(V) = (q - p)/sqrt(V) exactly
// (envelope theorem) and sqrt(V) changes by no more than the cores move. All candidates are closed
// forms except segment on annulus, which is a Newton search in one variable. Cores of other
// profiles: revolution.hpp.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "math/dual.hpp"
#include "math/ramp.hpp"
#include "math/types.hpp"

namespace dockloop {

/// Closest points on the first and second core [m] and the regularised square V [m2].
template <class S>
struct Closest {
  Vec3<S> first, second;
  S square;
};

/// Flat convex plate, corners in turn; `inward` is normal x edge, so inside is inward.(x - corner)
/// >= 0 on all four edges. `radius` bounds the corners about the centre (their mean).
template <class S>
struct Plate {
  std::array<Vec3<S>, 4> corner, edge, inward;
  Vec3<S> centre, normal;
  S radius;
  bool contains(const Vec3<S>& x) const {
    for (int k = 0; k < 4; ++k) {
      if (inward[k].dot(x - corner[k]) < S(0)) return false;
    }
    return true;
  }
};

template <class S>
Plate<S> make_plate(const std::array<Vec3<S>, 4>& corner) {
  Plate<S> plate;
  plate.corner = corner;
  plate.centre = (corner[0] + corner[1] + corner[2] + corner[3]) / S(4);
  plate.normal = (corner[1] - corner[0]).cross(corner[3] - corner[0]).normalized();
  plate.radius = S(0);
  for (int k = 0; k < 4; ++k) {
    plate.edge[k] = corner[(k + 1) % 4] - corner[k];
    plate.inward[k] = plate.normal.cross(plate.edge[k]);
    plate.radius = std::max<S>(plate.radius, (corner[k] - plate.centre).norm());
  }
  return plate;
}

/// The same plate in other axes: x -> R x + p.
template <class S>
Plate<S> place_plate(const Plate<S>& plate, const Mat3<S>& R, const Vec3<S>& p) {
  Plate<S> placed;
  for (int k = 0; k < 4; ++k) {
    placed.corner[k] = R * plate.corner[k] + p;
    placed.edge[k] = R * plate.edge[k];
    placed.inward[k] = R * plate.inward[k];
  }
  placed.centre = R * plate.centre + p;
  placed.normal = R * plate.normal;
  placed.radius = plate.radius;
  return placed;
}

/// Plane annulus about the x axis: x = `x`, `inner` <= sqrt(y^2 + z^2) <= `outer` [m].
template <class S>
struct Annulus {
  S x, inner, outer;
};

/// Point on annulus; no regularisation. On the axis, where every azimuth is closest, y is taken.
template <class S>
Closest<S> find_point_annulus(const Vec3<S>& point, const Annulus<S>& ring) {
  using std::sqrt;
  const S r = sqrt(point[1] * point[1] + point[2] * point[2]);
  const S rc = std::min<S>(std::max<S>(r, ring.inner), ring.outer);
  const Vec3<S> q =
      r > S(0) ? Vec3<S>(ring.x, point[1] * rc / r, point[2] * rc / r) : Vec3<S>(ring.x, rc, S(0));
  return {point, q, (point - q).squaredNorm()};
}

/// Point on plate; no regularisation.
template <class S>
Closest<S> find_point_plate(const Vec3<S>& point, const Plate<S>& plate) {
  const Vec3<S> foot = point - plate.normal * plate.normal.dot(point - plate.centre);
  if (plate.contains(foot)) return {point, foot, (point - foot).squaredNorm()};
  Closest<S> best{point, foot, std::numeric_limits<S>::max()};
  for (int k = 0; k < 4; ++k) {
    const S t =
        clamp_unit<S>(plate.edge[k].dot(point - plate.corner[k]) / plate.edge[k].squaredNorm());
    const Vec3<S> q = plate.corner[k] + plate.edge[k] * t;
    const S square = (point - q).squaredNorm();
    if (square < best.square) best = {point, q, square};
  }
  return best;
}

/// Point on segment q0 + t d, 0 <= t <= 1; no regularisation.
template <class S>
Closest<S> find_point_segment(const Vec3<S>& point, const Vec3<S>& q0, const Vec3<S>& d) {
  const Vec3<S> q = q0 + d * clamp_unit<S>(d.dot(point - q0) / d.squaredNorm());
  return {point, q, (point - q).squaredNorm()};
}

/// Segment p0 + s dp on segment q0 + t dq, 0 <= s, t <= 1, with middles cp, cq (which need not lie
/// on the segments: an edge of a plate uses the middle of the plate). Solution of the box problem:
/// free minimum in s, then t, then s again when t meets a bound (Ericson, Real-Time Collision
/// Detection, section 5.1.9, with the terms of mu added). Exact; parallel lines need mu > 0.
template <class S>
Closest<S> find_segment_segment(const Vec3<S>& p0, const Vec3<S>& dp, const Vec3<S>& cp,
                                const Vec3<S>& q0, const Vec3<S>& dq, const Vec3<S>& cq,
                                const S& mu) {
  const Vec3<S> r = p0 - q0;
  const S a = (S(1) + mu) * dp.squaredNorm();
  const S e = (S(1) + mu) * dq.squaredNorm();
  const S b = dp.dot(dq);
  const S g = mu * dp.dot(cp - p0) - dp.dot(r);
  const S h = mu * dq.dot(cq - q0) + dq.dot(r);
  const S det = a * e - b * b;
  S s = det > S(0) ? clamp_unit<S>((g * e + b * h) / det) : S(0.5);
  S t = (h + b * s) / e;
  if (t < S(0)) {
    t = S(0);
    s = clamp_unit<S>(g / a);
  } else if (t > S(1)) {
    t = S(1);
    s = clamp_unit<S>((g + b) / a);
  }
  const Vec3<S> p = p0 + dp * s, q = q0 + dq * t;
  return {p, q, (p - q).squaredNorm() + mu * ((p - cp).squaredNorm() + (q - cq).squaredNorm())};
}

/// Point p of the plane of face A and point q of the segment q0 + t d, 0 <= t <= 1, with middle cq,
/// that are closest. The best face point for q is c + (q - c)_in_plane/(1 + mu), which leaves a
/// quadratic in t along the segment: height^2 + m |in plane|^2 + mu |q - cq|^2.
/// @return false if p lies outside A: then an edge of A is closer
template <class S>
bool find_face_segment(const Plate<S>& A, const Vec3<S>& q0, const Vec3<S>& d, const Vec3<S>& cq,
                       const S& mu, Vec3<S>& p, Vec3<S>& q) {
  const S m = mu / (S(1) + mu);
  const Vec3<S> u = q0 - A.centre;
  const S height = A.normal.dot(u), slope = A.normal.dot(d);
  const S linear = height * slope + m * (u.dot(d) - height * slope) + mu * d.dot(q0 - cq);
  const S dd = d.squaredNorm();
  const S t = clamp_unit<S>(-linear / (slope * slope + m * (dd - slope * slope) + mu * dd));
  q = q0 + d * t;
  const Vec3<S> w = q - A.centre;
  p = A.centre + (w - A.normal * A.normal.dot(w)) / (S(1) + mu);
  return A.contains(p);
}

/// Segment p0 + t d on plate, mu > 0: the least of five candidates (four edges, the face).
template <class S>
Closest<S> find_segment_plate(const Vec3<S>& p0, const Vec3<S>& d, const Plate<S>& Q, const S& mu) {
  const Vec3<S> cp = p0 + d / S(2);
  Closest<S> best = find_segment_segment<S>(p0, d, cp, Q.corner[0], Q.edge[0], Q.centre, mu);
  for (int k = 1; k < 4; ++k) {
    const Closest<S> c = find_segment_segment<S>(p0, d, cp, Q.corner[k], Q.edge[k], Q.centre, mu);
    if (c.square < best.square) best = c;
  }
  Vec3<S> p, q;
  if (find_face_segment<S>(Q, p0, d, cp, mu, q, p)) {
    const S v =
        (p - q).squaredNorm() + mu * ((p - cp).squaredNorm() + (q - Q.centre).squaredNorm());
    if (v < best.square) best = {p, q, v};
  }
  return best;
}

template <class S>
void improve_by_faces(const Plate<S>& P, const Plate<S>& Q, const S& mu, Closest<S>& best);

/// Plate on plate, mu > 0: the least of 25 feasible candidates, one of which is the minimiser of
/// this strictly convex problem: 16 edges on edges; 8 edges on a face, the face point being free in
/// its plane; face on face. Cost about 2 000 operations; doubles find all but the last one in
/// SIMD lanes (plate_lanes.hpp).
template <class S>
Closest<S> find_plate_plate(const Plate<S>& P, const Plate<S>& Q, const S& mu) {
  const Vec3<S>&cp = P.centre, &cq = Q.centre;

  // Edge on edge.
  Closest<S> best =
      find_segment_segment<S>(P.corner[0], P.edge[0], cp, Q.corner[0], Q.edge[0], cq, mu);
  for (int k = 1; k < 16; ++k) {
    const Closest<S> c = find_segment_segment<S>(P.corner[k / 4], P.edge[k / 4], cp,
                                                 Q.corner[k % 4], Q.edge[k % 4], cq, mu);
    if (c.square < best.square) best = c;
  }
  const auto square = [&](const Vec3<S>& p, const Vec3<S>& q) -> S {
    return (p - q).squaredNorm() + mu * ((p - cp).squaredNorm() + (q - cq).squaredNorm());
  };

  // Face of A on the edges of B.
  const auto face_on_edges = [&](const Plate<S>& A, const Plate<S>& B, bool swapped) {
    for (int k = 0; k < 4; ++k) {
      Vec3<S> p, q;
      if (!find_face_segment<S>(A, B.corner[k], B.edge[k], B.centre, mu, p, q)) continue;
      const S v = swapped ? square(q, p) : square(p, q);
      if (v < best.square) best = swapped ? Closest<S>{q, p, v} : Closest<S>{p, q, v};
    }
  };
  face_on_edges(P, Q, false);
  face_on_edges(Q, P, true);

  improve_by_faces(P, Q, mu, best);
  return best;
}

/// The last candidate of find_plate_plate(), face on face, if it is less than `best`.
template <class S>
void improve_by_faces(const Plate<S>& P, const Plate<S>& Q, const S& mu, Closest<S>& best) {
  const S m = mu / (S(1) + mu);
  const Vec3<S>&cp = P.centre, &cq = Q.centre;
  // With p eliminated, q = cq + y in the plane of Q solves
  // ((m + mu) 1 + (1 - m) b b') y = -rhs, b = normal of P in the plane of Q (Sherman-Morrison).
  const auto in_plane_q = [&](const Vec3<S>& x) -> Vec3<S> {
    return x - Q.normal * Q.normal.dot(x);
  };
  const Vec3<S> w = cq - cp, b = in_plane_q(P.normal);
  const Vec3<S> rhs = in_plane_q(w) * m + b * ((S(1) - m) * P.normal.dot(w));
  const S weight = (S(1) - m) / (m + mu + (S(1) - m) * b.squaredNorm());
  const Vec3<S> y = (rhs - b * (weight * b.dot(rhs))) / (m + mu);  // sign reversed
  const Vec3<S> q = cq - in_plane_q(y);  // again: the small divisor has blown up rounding errors
  const Vec3<S> pq = q - cp;
  const Vec3<S> p = cp + (pq - P.normal * P.normal.dot(pq)) / (S(1) + mu);
  if (!Q.contains(q) || !P.contains(p)) return;
  const S v = (p - q).squaredNorm() + mu * ((p - cp).squaredNorm() + (q - cq).squaredNorm());
  if (v < best.square) best = {p, q, v};
}

/// Segment p0 + t d, 0 <= t <= 1, and an annulus: what is to be minimised is
///     f(t) = (x - ring.x)^2 + (r - clamp(r))^2 + weight (t - 1/2)^2,  r = sqrt(y^2 + z^2),
/// regularised by the middle of the segment only.
template <class S>
struct SegmentOnAnnulus {
  static constexpr int kSamples = 8;  ///< intervals of the search
  Vec3<S> p0, d;
  Annulus<S> ring;
  S weight, dr2;  ///< mu |d|^2; square of d across the axis
  struct Local {
    S value, slope, curvature;  ///< of f/2, and of f itself for `value`
  };
  Local at(const S& t, bool derivatives) const {
    using std::sqrt;
    const S x = p0[0] + t * d[0] - ring.x, y = p0[1] + t * d[1], z = p0[2] + t * d[2];
    const S r = std::max<S>(sqrt(y * y + z * z), S(1e-9));
    const S out = r - std::min<S>(std::max<S>(r, ring.inner), ring.outer);
    const S u = t - S(0.5);
    Local l{x * x + out * out + weight * u * u, S(0), S(0)};
    if (derivatives) {
      const S r1 = (y * d[1] + z * d[2]) / r;
      l.slope = x * d[0] + out * r1 + weight * u;
      l.curvature = d[0] * d[0] + weight;
      if (out != S(0)) l.curvature += r1 * r1 + out * (dr2 - r1 * r1) / r;
    }
    return l;
  }
};

/// The lowest point of a function F of 0 <= t <= 1: samples bracket the lowest valley, Newton on f'
/// (bisection where it leaves the bracket) finds its floor. Within 50 mm of a ring of 0.6 m the
/// valley of an annulus is the only one.
template <template <class> class F, class S>
S find_lowest(const F<S>& f) {
  using std::abs;
  constexpr int kSamples = F<S>::kSamples;
  std::array<S, kSamples + 1> sample;  // side by side in vector registers
  for (int i = 0; i <= kSamples; ++i) sample[i] = f.at(S(i) / S(kSamples), false).value;
  const int k = static_cast<int>(std::min_element(sample.begin(), sample.end()) - sample.begin());
  S t = S(k) / S(kSamples);
  if (k > 0 && k < kSamples) {  // begin at the vertex of the parabola through three samples
    const S bend = sample[k - 1] - S(2) * sample[k] + sample[k + 1];
    if (bend > S(0)) t += (sample[k - 1] - sample[k + 1]) / (S(2 * kSamples) * bend);
  }
  S low = S(std::max(k - 1, 0)) / S(kSamples), high = S(std::min(k + 1, kSamples)) / S(kSamples);
  for (int i = 0; i < 60; ++i) {
    const auto l = f.at(t, true);
    (l.slope > S(0) ? high : low) = t;
    S next = t - l.slope / l.curvature;
    if (!(l.curvature > S(0)) || next <= low || next >= high) next = (low + high) / S(2);
    const S change = abs(next - t);
    t = next;
    if (change <= S(4) * std::numeric_limits<S>::epsilon()) break;
  }
  return t;
}

template <int N>
Vec3<double> take_values(const Vec3<Dual<N>>& x) {
  return {x[0].value, x[1].value, x[2].value};
}

template <int N>
SegmentOnAnnulus<double> take_values(const SegmentOnAnnulus<Dual<N>>& f) {
  return {take_values<N>(f.p0),
          take_values<N>(f.d),
          {f.ring.x.value, f.ring.inner.value, f.ring.outer.value},
          f.weight.value,
          f.dr2.value};
}

/// The same with derivatives: the search runs on values. Inside the segment the derivative of t
/// follows from f'(t) = 0 (implicit function theorem). At an end of the segment t is constant.
template <template <class> class F, int N>
Dual<N> find_lowest(const F<Dual<N>>& f) {
  constexpr double kEnd = 1e-14;  // accuracy of bisection at an end
  const double lowest = find_lowest(take_values(f));
  Dual<N> t(lowest);
  if (lowest < kEnd || lowest > 1.0 - kEnd) return t;
  const auto l = f.at(t, true);
  for (int i = 0; i < N; ++i) t.d[i] = -l.slope.d[i] / l.curvature.value;
  return t;
}

/// Segment on annulus: closest points from the lowest point of f, mu > 0.
template <class S>
Closest<S> find_segment_annulus(const Vec3<S>& p0, const Vec3<S>& d, const Annulus<S>& ring,
                                const S& mu) {
  const S weight = mu * d.squaredNorm();
  const S t = find_lowest(SegmentOnAnnulus<S>{p0, d, ring, weight, d[1] * d[1] + d[2] * d[2]});
  Closest<S> c = find_point_annulus<S>(p0 + d * t, ring);
  c.square += weight * (t - S(0.5)) * (t - S(0.5));
  return c;
}

}  // namespace dockloop
