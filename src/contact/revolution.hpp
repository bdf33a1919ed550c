// Surfaces of revolution: an open polyline (x, r) in the half-plane r >= 0, turned about the x
// axis.
//
// A cone, a cylinder, a disc and an annulus are one piece each, a rim or an edge is a single node
// (a circle); pieces in a row make a drogue. Lengths are in m, in axes of the surface. A convex
// corner of the material is no problem, because a rounded core rolls over it. A concave corner (a
// wall and a floor) needs two surfaces: on one of them the closest point would jump.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "contact/primitives.hpp"

namespace dockloop {

/// The polyline; a single node is a circle.
struct Profile {
  struct Node {
    double x, r;
  };
  std::vector<Node> node;
  int piece_count() const { return std::max(1, static_cast<int>(node.size()) - 1); }
  const Node& begin_of(int piece) const { return node[static_cast<size_t>(piece)]; }
  const Node& end_of(int piece) const {
    return node[std::min(static_cast<size_t>(piece) + 1, node.size() - 1)];
  }
};

/// Point of a profile next to a point of the half-plane.
template <class S>
struct OnProfile {
  S x, r, square;    ///< the point, and its squared distance
  int piece;         ///< that it lies on
  bool inside;       ///< of the piece, not at one of its ends
  bool same_radius;  ///< of both points: both lie on one line along the axis
};

/// Closest point of one piece: c = a + clamp((x - a).(b - a)/|b - a|^2) (b - a).
template <class S>
OnProfile<S> find_on_piece(const Profile& profile, int piece, const S& x, const S& r) {
  const Profile::Node &a = profile.begin_of(piece), &b = profile.end_of(piece);
  const double dx = b.x - a.x, dr = b.r - a.r, square = dx * dx + dr * dr;
  OnProfile<S> c{S(a.x), S(a.r), S(0), piece, false, false};
  if (square > 0.0 && dx == 0.0) {  // exact: the height of a point over a disc
    c.r = std::min<S>(std::max<S>(r, S(std::min(a.r, b.r))), S(std::max(a.r, b.r)));
    c.inside = c.same_radius = c.r == r;
  } else if (square > 0.0) {
    const S t = ((x - S(a.x)) * S(dx) + (r - S(a.r)) * S(dr)) / S(square);
    c.inside = t > S(0) && t < S(1);
    if (c.inside) {
      c.x += t * S(dx);
      c.r += t * S(dr);
    } else if (!(t < S(1))) {
      c.x = S(b.x);
      c.r = S(b.r);
    }
  }
  c.square = (x - c.x) * (x - c.x) + (r - c.r) * (r - c.r);
  return c;
}

/// The closest of all pieces; of equals the first.
template <class S>
OnProfile<S> find_on_profile(const Profile& profile, const S& x, const S& r) {
  OnProfile<S> best = find_on_piece<S>(profile, 0, x, r);
  for (int k = 1; k < profile.piece_count(); ++k) {
    const OnProfile<S> c = find_on_piece<S>(profile, k, x, r);
    if (c.square < best.square) best = c;
  }
  return best;
}

/// Distance of a point from the x axis, with a derivative on the axis, too.
template <class S>
S find_axis_distance(const S& y, const S& z) {
  using std::sqrt;
  const S square = y * y + z * z;
  return square > S(0) ? S(sqrt(square)) : S(0);
}

/// Point on a surface of revolution; no regularisation. On the axis, where every azimuth is
/// closest, y is taken. @param[out] piece  on which the closest point lies
template <class S>
Closest<S> find_point_revolution(const Vec3<S>& point, const Profile& profile, int& piece) {
  const S r = find_axis_distance<S>(point[1], point[2]);
  const OnProfile<S> c = find_on_profile<S>(profile, point[0], r);
  piece = c.piece;
  Vec3<S> q(c.x, c.r, S(0));
  if (c.same_radius) {
    q = {c.x, point[1], point[2]};
  } else if (r > S(0)) {
    q = {c.x, point[1] * c.r / r, point[2] * c.r / r};
  }
  return {point, q, (point - q).squaredNorm()};
}

/// Segment p0 + t d, 0 <= t <= 1, and a surface of revolution: as SegmentOnAnnulus for any profile.
/// The closest point of the profile moves with t; by the envelope theorem only its distance enters
/// the slope.
template <class S>
struct SegmentOnRevolution {
  static constexpr int kSamples = 16;  ///< intervals of the search
  Vec3<S> p0, d;
  const Profile* profile;
  S weight, dr2;  ///< mu |d|^2; square of d across the axis
  struct Local {
    S value, slope, curvature;  ///< of f/2, and of f itself for `value`
  };
  Local at(const S& t, bool derivatives) const {
    const S x = p0[0] + t * d[0], y = p0[1] + t * d[1], z = p0[2] + t * d[2];
    const S r = std::max<S>(find_axis_distance<S>(y, z), S(1e-9));
    const OnProfile<S> c = find_on_profile<S>(*profile, x, r);
    const S ex = x - c.x, er = r - c.r, u = t - S(0.5);
    Local l{c.square + weight * u * u, S(0), S(0)};
    if (derivatives) {
      const S r1 = (y * d[1] + z * d[2]) / r, r2 = (dr2 - r1 * r1) / r;
      l.slope = ex * d[0] + er * r1 + weight * u;
      if (c.inside) {
        const Profile::Node &a = profile->begin_of(c.piece), &b = profile->end_of(c.piece);
        const double length = find_length(b.x - a.x, b.r - a.r);
        const S nx((a.r - b.r) / length), nr((b.x - a.x) / length);  // normal of the piece
        const S across = nx * d[0] + nr * r1;
        l.curvature = across * across + (nx * ex + nr * er) * nr * r2 + weight;
      } else {
        l.curvature = d[0] * d[0] + r1 * r1 + er * r2 + weight;
      }
    }
    return l;
  }
};

template <int N>
SegmentOnRevolution<double> take_values(const SegmentOnRevolution<Dual<N>>& f) {
  return {take_values<N>(f.p0), take_values<N>(f.d), f.profile, f.weight.value, f.dr2.value};
}

/// Segment on a surface of revolution, mu > 0.
/// Limit: one contact. A rod inside a tube has two; describe them by a circle and a point.
template <class S>
Closest<S> find_segment_revolution(const Vec3<S>& p0, const Vec3<S>& d, const Profile& profile,
                                   const S& mu, int& piece) {
  const S weight = mu * d.squaredNorm();
  const S t =
      find_lowest(SegmentOnRevolution<S>{p0, d, &profile, weight, d[1] * d[1] + d[2] * d[2]});
  Closest<S> c = find_point_revolution<S>(p0 + d * t, profile, piece);
  c.square += weight * (t - S(0.5)) * (t - S(0.5));
  return c;
}

}  // namespace dockloop
