// Surfaces of revolution: an open polyline (x, r) in the half-plane r >= 0, turned about the x
// axis.
//
// A cone, a cylinder, a disc and an annulus are one piece each, a rim or an edge is a single node
// (a circle); pieces in a row make a drogue. Lengths are in m, in axes of the surface.
//
// A core may touch such a surface at several places at once. Every place is a stationary point of
// the distance, and its sign says how it counts (README.md): +1 at a valley; -1 at a ridge, where
// two valleys run together. Sums with these signs count each connected region of contact once.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "contact/primitives.hpp"
#include "math/scalar.hpp"

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

/// Point of a piece next to a point of the half-plane.
template <class S>
struct OnPiece {
  S x, r, square;    ///< the point, and its squared distance
  int end;           ///< -1 the first end of the piece, +1 the second, 0 between them
  bool same_radius;  ///< of both points: both lie on one line along the axis
};

/// Closest point of the piece a..b: c = a + clamp((x - a).(b - a)/|b - a|^2) (b - a).
template <class S>
OnPiece<S> find_on_piece(const Profile::Node& a, const Profile::Node& b, const S& x, const S& r) {
  const double dx = b.x - a.x, dr = b.r - a.r, square = dx * dx + dr * dr;
  OnPiece<S> c{S(a.x), S(a.r), S(0), -1, false};
  if (square > 0.0 && dx == 0.0) {  // exact: the height of a point over a disc
    c.r = std::min<S>(std::max<S>(r, S(std::min(a.r, b.r))), S(std::max(a.r, b.r)));
    c.same_radius = c.r == r;
    c.end = c.same_radius ? 0 : c.r == S(a.r) ? -1 : 1;
  } else if (square > 0.0) {
    const S t = ((x - S(a.x)) * S(dx) + (r - S(a.r)) * S(dr)) / S(square);
    if (t > S(0) && t < S(1)) {
      c.end = 0;
      c.x += t * S(dx);
      c.r += t * S(dr);
    } else if (!(t < S(1))) {
      c.end = 1;
      c.x = S(b.x);
      c.r = S(b.r);
    }
  }
  c.square = (x - c.x) * (x - c.x) + (r - c.r) * (r - c.r);
  return c;
}

/// Distance of a point from the x axis, with a derivative on the axis, too.
template <class S>
S find_axis_distance(const S& y, const S& z) {
  using std::sqrt;
  const S square = y * y + z * z;
  return square > S(0) ? S(sqrt(square)) : S(0);
}

/// A stationary point of the distance between a core (`first`) and a surface of revolution.
template <class S>
struct Place : Closest<S> {
  int piece = 0;  ///< of the profile
  int sign = 1;   ///< +1 valley, -1 ridge
  int node = -1;  ///< of the profile, -1 inside a piece
  S t = S(0);     ///< on a segment, 0 to 1
  Place() = default;
  explicit Place(const Closest<S>& closest) : Closest<S>(closest) {}
  Place& operator=(const Closest<S>& closest) { return *this = Place(closest); }
};

/// The place where a point of space meets this point of the profile. On the axis, where every
/// azimuth is closest, y is taken.
template <class S>
Place<S> make_place(const Vec3<S>& point, const S& r, const OnPiece<S>& c, int piece, int sign) {
  Vec3<S> q(c.x, c.r, S(0));
  if (c.same_radius) {
    q = {c.x, point[1], point[2]};
  } else if (r > S(0)) {
    q = {c.x, point[1] * c.r / r, point[2] * c.r / r};
  }
  Place<S> place(Closest<S>{point, q, (point - q).squaredNorm()});
  place.piece = piece;
  place.sign = sign;
  if (c.end != 0) place.node = piece + (c.end > 0);
  return place;
}

/// All places of a point, along the profile; no regularisation. A node counts once for each
/// adjoining piece that ends nearest to the point there, and a node between two pieces once less:
/// 1 where both do (a convex corner), 0 where one does, -1 where none does (a concave corner).
/// @param take  receives a Place; the closest of them is a valley
template <class S, class Take>
void visit_point_places(const Vec3<S>& point, const Profile& profile, const Take& take) {
  const S r = find_axis_distance<S>(point[1], point[2]);
  const int pieces = profile.piece_count();
  OnPiece<S> before{};
  for (int k = 0; k <= pieces; ++k) {
    const bool last = k == pieces;
    const Profile::Node& a = last ? profile.end_of(k - 1) : profile.begin_of(k);
    OnPiece<S> c{};
    if (!last) c = find_on_piece<S>(a, profile.end_of(k), point[0], r);
    const int count = (k > 0 && before.end > 0) + (!last && c.end < 0) - (k > 0 && !last);
    if (count != 0) {
      const OnPiece<S> node{S(a.x), S(a.r), S(0), -1, false};
      Place<S> place = make_place<S>(point, r, node, std::max(k - 1, 0), count);
      place.node = k;
      take(place);
    }
    if (!last && c.end == 0) take(make_place<S>(point, r, c, k, 1));
    before = c;
  }
}

/// Segment p0 + t d, 0 <= t <= 1, and the piece a..b, a circle if a = b:
///     f(t) = distance^2 + weight (t - 1/2)^2.
/// The closest point of the piece moves with t; by the envelope theorem only its distance enters
/// the slope.
template <class S>
struct SegmentOnPiece {
  Vec3<S> p0, d;
  Profile::Node a, b;
  S weight;  ///< mu |d|^2
  struct Local {
    S t, distance, value, slope, curvature;  ///< of f/2, and of f itself for `value`
  };
  Local at(const S& t) const {
    using std::sqrt;
    const S x = p0[0] + t * d[0], y = p0[1] + t * d[1], z = p0[2] + t * d[2];
    const S r = std::max<S>(find_axis_distance<S>(y, z), S(kLeastRadius));
    const OnPiece<S> c = find_on_piece<S>(a, b, x, r);
    const S ex = x - c.x, er = r - c.r, u = t - S(0.5);
    const S r1 = (y * d[1] + z * d[2]) / r;
    const S r2 = (d[1] * d[1] + d[2] * d[2] - r1 * r1) / r;
    Local l{t, sqrt(c.square), c.square + weight * u * u, ex * d[0] + er * r1 + weight * u, S(0)};
    if (c.end == 0) {
      const double length = find_length(b.x - a.x, b.r - a.r);
      const S nx((a.r - b.r) / length), nr((b.x - a.x) / length);  // normal of the piece
      const S across = nx * d[0] + nr * r1;
      l.curvature = across * across + (nx * ex + nr * er) * nr * r2 + weight;
    } else {
      l.curvature = d[0] * d[0] + r1 * r1 + er * r2 + weight;
    }
    return l;
  }
  static constexpr double kLeastRadius = 1e-9;  ///< [m], so that slopes exist on the axis
};

/// Ascending places 0 < t < 1.
struct Breaks {
  std::array<double, 10> t;
  int count = 0;
  void add(double place) {
    if (!(place > 0.0 && place < 1.0)) return;
    int i = count++;
    for (; i > 0 && t[i - 1] > place; --i) t[i] = t[i - 1];
    t[i] = place;
  }
};

/// Places between which f' has at most one zero.
///
/// With s = (t - foot) |across|, the distance of the axis is r = sqrt(gap^2 + s^2), and both f over
/// a circle and f over the line of a piece are |m + E s + N r|^2 with vectors m, E, N of a plane.
/// The hyperbola (s, r) is its own image in s = s' ch + r' sh, r = r' ch + s' sh (a Lorentz boost).
/// The boost that makes E' and N' orthogonal leaves df/ds'/2 = alpha s' + beta + gamma s'/r'. Its
/// slope alpha + gamma gap^2/r'^3 changes sign at most twice: where r' = (-gamma
/// gap^2/alpha)^(1/3).
inline Breaks find_breaks(const SegmentOnPiece<double>& f) {
  Breaks breaks;
  const Vec3<double>&p = f.p0, &d = f.d;
  const double dr2 = d[1] * d[1] + d[2] * d[2], along = p[1] * d[1] + p[2] * d[2];
  if (dr2 == 0.0) {  // r is constant: f is a parabola on each of the three parts
    const double dx = f.b.x - f.a.x, dr = f.b.r - f.a.r, r = find_length(p[1], p[2]);
    for (const double c : {0.0, dx * dx + dr * dr}) {
      breaks.add((c - (r - f.a.r) * dr - (p[0] - f.a.x) * dx) / (dx * d[0]));
    }
    return breaks;
  }
  const double across = std::sqrt(dr2), foot = -along / dr2;
  const double gap =
      std::max(std::abs(p[1] * d[2] - p[2] * d[1]) / across, SegmentOnPiece<double>::kLeastRadius);
  // EE = |E|^2, EN = E.N, NN = |N|^2, mE = m.E, mN = m.N
  const auto add_turns = [&](double EE, double EN, double NN, double mE, double mN) {
    const double sum = EE + NN, alpha = std::sqrt((sum - 2 * EN) * (sum + 2 * EN));
    if (!(alpha > 0.0)) return;
    const double ch = std::sqrt((sum / alpha + 1) / 2), sh = -EN / (alpha * ch);
    const double gamma = mE * sh + mN * ch;
    const double r = std::cbrt(-gamma * gap * gap / alpha);
    if (!(r > gap)) return;
    const double s = std::sqrt((r - gap) * (r + gap));
    for (const double turn : {-s, s}) breaks.add(foot + (turn * ch + r * sh) / across);
  };
  const double xs = d[0] / across, weight = f.weight / dr2, x_foot = p[0] + foot * d[0];
  const auto add_circle = [&](const Profile::Node& node) {
    add_turns(xs * xs + weight, 0.0, 1.0, 0.0, -node.r);
  };
  add_circle(f.a);
  const double dx = f.b.x - f.a.x, dr = f.b.r - f.a.r, length = find_length(dx, dr);
  if (length == 0.0) return breaks;
  add_circle(f.b);
  const double nx = -dr / length, nr = dx / length;
  const double height = nx * (x_foot - f.a.x) - nr * f.a.r;
  add_turns(nx * nx * xs * xs + weight, nx * xs * nr, nr * nr,
            nx * xs * height + weight * (foot - 0.5) * across, nr * height);
  // Where the closest point reaches an end of the piece: dr r = rest - dx d[0] t, squared.
  for (const double c : {0.0, length * length}) {
    const double rest = c + f.a.r * dr - (p[0] - f.a.x) * dx, slope = dx * d[0];
    const double A = dr * dr * dr2 - slope * slope, B = dr * dr * along + rest * slope;
    const double C = dr * dr * (p[1] * p[1] + p[2] * p[2]) - rest * rest;
    const double q = -(B + std::copysign(std::sqrt(std::max(B * B - A * C, 0.0)), B));
    breaks.add(q / A);
    breaks.add(C / q);
  }
  return breaks;
}

template <class S>
SegmentOnPiece<double> take_values(const SegmentOnPiece<S>& f) {
  const auto plain = [](const Vec3<S>& x) {
    return Vec3<double>(to_double(x[0]), to_double(x[1]), to_double(x[2]));
  };
  return {plain(f.p0), plain(f.d), f.a, f.b, to_double(f.weight)};
}

/// The only zero of f' between two places: Newton, bisection where it leaves the bracket.
template <class S>
typename SegmentOnPiece<S>::Local find_zero(const SegmentOnPiece<S>& f,
                                            const typename SegmentOnPiece<S>::Local& from,
                                            const typename SegmentOnPiece<S>::Local& to) {
  using std::abs;
  constexpr int kMost = 120;  // bisections to the digits of 32-digit numbers
  S low = from.t, high = to.t;
  S t = low + (high - low) * (from.slope / (from.slope - to.slope));
  const S small = S(4) * std::numeric_limits<S>::epsilon();
  for (int i = 0;; ++i) {
    const auto l = f.at(t);
    ((l.slope < S(0)) == (from.slope < S(0)) ? low : high) = t;
    S change = -(l.slope / l.curvature);
    const bool inside = t + change > low && t + change < high;
    if (!inside && !(abs(change) <= small)) change = (low + high) / S(2) - t;
    if (abs(change) <= small || i == kMost) return l;
    t += change;
  }
}

/// All valleys and ridges of f with values below max(range^2, `least`), ascending; valleys are one
/// more than ridges. A smaller value of a valley replaces `least`, so that range 0 finds the
/// lowest.
/// @param take  receives t and the sign
template <class S, class Take>
void visit_valleys(const SegmentOnPiece<S>& f, const S& range, S& least, const Take& take) {
  const Breaks breaks = find_breaks(take_values(f));
  const S length = f.d.norm();
  const auto report = [&](const typename SegmentOnPiece<S>::Local& l, int sign) {
    if (sign > 0) least = std::min<S>(least, l.value);
    take(l.t, sign);
  };
  auto from = f.at(S(0));
  if (!(from.slope < S(0))) report(from, 1);
  for (int i = 0; i <= breaks.count; ++i) {
    const auto to = f.at(i < breaks.count ? S(breaks.t[i]) : S(1));
    const bool falls = from.slope < S(0), rises = !(to.slope < S(0));
    if (falls == rises) {  // no point between comes closer than this bound
      const S bound = (from.distance + to.distance - length * (to.t - from.t)) / S(2);
      if (!(bound > S(0) && bound * bound >= std::max<S>(range * range, least))) {
        report(find_zero<S>(f, from, to), falls ? 1 : -1);
      }
    }
    from = to;
  }
  if (from.slope < S(0)) report(from, 1);
}

/// The same with derivatives: the search runs on values. Inside the segment the derivative of t
/// follows from f'(t) = 0 (implicit function theorem). At an end of the segment t is constant.
template <int N, class Take>
void visit_valleys(const SegmentOnPiece<Dual<N>>& f, const Dual<N>& range, Dual<N>& least,
                   const Take& take) {
  double lowest = least.value;
  visit_valleys(take_values(f), range.value, lowest, [&](double place, int sign) {
    Dual<N> t(place);
    if (place > 0.0 && place < 1.0) {
      const auto l = f.at(t);
      for (int i = 0; i < N && l.curvature.value != 0.0; ++i) {
        t.d[i] = -l.slope.d[i] / l.curvature.value;
      }
    }
    take(t, sign);
  });
  least = Dual<N>(lowest);
}

/// All places of a segment p0 + t d with values V below range^2, and the lowest valley, regularised
/// by the middle of the segment, mu > 0: those of each piece, less those of each node between two
/// pieces. Far from a corner that cancels: a piece that ends nearest to the segment has the
/// places of its node.
/// @param take  receives a Place
template <class S, class Take>
void visit_segment_places(const Vec3<S>& p0, const Vec3<S>& d, const Profile& profile, const S& mu,
                          const S& range, const Take& take) {
  SegmentOnPiece<S> f{p0, d, {}, {}, mu * d.squaredNorm()};
  S least = std::numeric_limits<S>::max();
  const auto visit = [&](int piece, int factor) {
    visit_valleys(f, range, least, [&](const S& t, int sign) {
      const Vec3<S> point = p0 + d * t;
      const S r = find_axis_distance<S>(point[1], point[2]), u = t - S(0.5);
      Place<S> place =
          make_place<S>(point, r, find_on_piece<S>(f.a, f.b, point[0], r), piece, factor * sign);
      place.square += f.weight * u * u;
      place.t = t;
      take(place);
    });
  };
  for (int k = 0; k < profile.piece_count(); ++k) {
    f.a = profile.begin_of(k);
    f.b = profile.end_of(k);
    visit(k, 1);
  }
  if (!(least < range * range)) return;
  for (int k = 1; k < profile.piece_count(); ++k) {
    f.a = f.b = profile.begin_of(k);
    visit(k, -1);
  }
}

}  // namespace dockloop
