// The formulas of each leg type; see closed_form.hpp for axes and branches.
#pragma once

#include <algorithm>
#include <cmath>

#include "loops/closed_form.hpp"
#include "math/scalar.hpp"

namespace dockloop {
namespace {

/// Square root of a domain argument. @return false, with the reason, unless it is positive.
template <class S>
bool take_root(const S& square, S& root, LegSolution<S>& leg) {
  using std::sqrt;
  if (square > S(0)) {
    root = sqrt(square);
    return true;
  }
  leg.code = square < S(0) ? StatusCode::kOutOfReach : StatusCode::kLoopSingular;
  return false;
}

/// Universal joint Ry(a) Rz(b) that turns d into L, |d| = |L|; square = dx2 + dy2 - ly2.
template <class S>
bool aim(const Vec3<S>& d, const Vec3<S>& L, const S& square, int flip, int a, int b,
         LegSolution<S>& leg, S& X) {
  if (!take_root<S>(square, X, leg)) return false;
  if (flip < 0) X = -X;
  const S in_plane = d.x() * d.x() + d.y() * d.y();
  const S across = X * X + d.z() * d.z();
  leg.c[b] = (d.x() * X + d.y() * L.y()) / in_plane;
  leg.s[b] = (d.x() * L.y() - d.y() * X) / in_plane;
  leg.c[a] = (X * L.x() + d.z() * L.z()) / across;
  leg.s[a] = (d.z() * L.x() - X * L.z()) / across;
  return true;
}

/// Two links that reach (x, y): angle 1 of the first link, angle 2 of the second relative to it.
template <class S>
struct TwoLink {
  S c1, s1, c2, s2;
};

template <class S>
bool solve_two_link(const S& x, const S& y, const S& l1, const S& l2, int elbow, TwoLink<S>& out,
                    LegSolution<S>& leg) {
  const S square = x * x + y * y;
  S root;
  // The factored form keeps the digits near the stretched and the folded pose.
  if (!take_root<S>(((l1 + l2) * (l1 + l2) - square) * (square - (l1 - l2) * (l1 - l2)), root, leg))
    return false;
  out.c2 = (square - l1 * l1 - l2 * l2) / (S(2) * l1 * l2);
  out.s2 = S(elbow) * root / (S(2) * l1 * l2);
  const S along = l1 + l2 * out.c2, across = l2 * out.s2;
  out.c1 = (along * x + across * y) / square;
  out.s1 = (along * y - across * x) / square;
  return true;
}

template <class S>
double find_margin(const S& a, const S& b) {
  return std::min(std::abs(to_double(a)), std::abs(to_double(b)));
}

/// [Y2 (9a)], with the cut point anywhere beside the slide.
template <class S>
void solve_slide_leg(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                     LegSolution<S>& leg) {
  using std::sqrt;
  const S dy(shape.tip.y()), dz(shape.tip.z());
  const S square = L.squaredNorm();
  S xi, X;
  if (!take_root<S>(square - dy * dy - dz * dz, xi, leg)) {
    leg.code = StatusCode::kOutOfReach;  // a leg of no length has no direction either
    return;
  }
  if (branch.elbow < 0) xi = -xi;
  const Vec3<S> d(xi, dy, dz);
  if (!aim<S>(d, L, L.x() * L.x() + L.z() * L.z() - dz * dz, branch.flip, 0, 1, leg, X)) return;
  leg.slide = xi - S(shape.tip.x());
  const S length = sqrt(square);
  leg.margin = find_margin<S>(X / length, xi / length);
}

/// [Y2 (9b)]; the published steps carry errors in signs and denominators that are mended here.
/// The height of the closing point fixes angle 3; seen along z, crank and rod are two links.
template <class S>
void solve_crank_leg(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                     LegSolution<S>& leg) {
  using std::sqrt;
  const S a(shape.tip.x()), b(shape.tip.y()), c(shape.tip.z());
  const S h = L.z() - S(shape.height);
  const S square = a * a + c * c;
  S X;
  if (!take_root<S>(square - h * h, X, leg)) return;
  const S margin = X / sqrt(square);
  if (branch.flip < 0) X = -X;
  leg.c[2] = (a * X + c * h) / square;
  leg.s[2] = (c * X - a * h) / square;
  const S l2 = sqrt(X * X + b * b);
  TwoLink<S> links;
  if (!solve_two_link<S>(L.x(), L.y(), S(shape.l1), l2, branch.elbow, links, leg)) return;
  leg.c[0] = links.c1;
  leg.s[0] = links.s1;
  leg.c[1] = (links.c2 * X + links.s2 * b) / l2;
  leg.s[1] = (links.s2 * X - links.c2 * b) / l2;
  leg.margin = find_margin<S>(margin, links.s2);
}

template <class S>
void solve_crank_leg_perpendicular(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                                   LegSolution<S>& leg) {
  const S l1(shape.l1), l2(shape.l2);
  const S h = L.z() - S(shape.height);
  const S flat = L.x() * L.x() + L.y() * L.y();
  const S A = (flat + h * h - l1 * l1 - l2 * l2) / (S(2) * l1 * l2);
  const S B = -h / l2;
  S c3, s3;
  if (!take_root<S>(A * A + B * B, c3, leg)) return;
  if (!take_root<S>((S(1) - c3) * (S(1) + c3), s3, leg)) return;
  if (!(flat > S(0))) {
    leg.code = StatusCode::kLoopSingular;
    return;
  }
  leg.margin = find_margin<S>(c3, s3);
  c3 *= S(branch.flip);
  s3 *= S(branch.elbow);
  leg.c[1] = A / c3;
  leg.s[1] = B / c3;
  leg.c[2] = c3;
  leg.s[2] = s3;
  const S X = l1 + l2 * A, Y = l2 * s3;
  leg.c[0] = (X * L.x() + Y * L.y()) / flat;
  leg.s[0] = (X * L.y() - Y * L.x()) / flat;
}

template <class S>
void solve_slider_strut(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                        LegSolution<S>& leg) {
  using std::sqrt;
  const Vec3<S> axis = shape.slide.template cast<S>(), tip = shape.tip.template cast<S>();
  const S along = axis.dot(L), length2 = tip.squaredNorm();
  S w, X;
  if (!take_root<S>(length2 - (L - along * axis).squaredNorm(), w, leg)) return;
  leg.slide = along + S(branch.elbow) * w;
  const Vec3<S> D = L - leg.slide * axis;
  const S square = tip.x() * tip.x() + tip.y() * tip.y() - D.y() * D.y();
  if (!aim<S>(tip, D, square, branch.flip, 1, 2, leg, X)) return;
  const S length = sqrt(length2);
  leg.margin = find_margin<S>(w / length, X / length);
}

template <class S>
void solve_elbow_leg(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                     LegSolution<S>& leg) {
  using std::sqrt;
  const S l1(shape.l1), l2(shape.l2), height(shape.height);
  const S square = L.squaredNorm();
  TwoLink<S> links;
  S reach, X;
  if (!take_root<S>(square - height * height, reach, leg)) return;
  if (!solve_two_link<S>(reach, S(0), l1, l2, branch.elbow, links, leg)) return;
  leg.c[2] = links.c2;
  leg.s[2] = links.s2;
  const Vec3<S> d(l1 + l2 * links.c2, l2 * links.s2, height);
  if (!aim<S>(d, L, L.x() * L.x() + L.z() * L.z() - height * height, branch.flip, 0, 1, leg, X))
    return;
  leg.margin = find_margin<S>(links.s2, S(X / sqrt(square)));
}

template <class S>
void solve_planar_slide(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                        LegSolution<S>& leg) {
  using std::sqrt;
  const S d(shape.tip.y());
  const S square = L.x() * L.x() + L.y() * L.y();
  S xi;
  if (!take_root<S>(square - d * d, xi, leg)) return;
  if (branch.elbow < 0) xi = -xi;
  leg.c[0] = (xi * L.x() + d * L.y()) / square;
  leg.s[0] = (xi * L.y() - d * L.x()) / square;
  leg.slide = xi - S(shape.tip.x());
  leg.margin = std::abs(to_double(S(xi / sqrt(square))));
}

template <class S>
void solve_planar_elbow(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                        LegSolution<S>& leg) {
  TwoLink<S> links;
  if (!solve_two_link<S>(L.x(), L.y(), S(shape.l1), S(shape.l2), branch.elbow, links, leg)) return;
  leg.c = {links.c1, links.c2, S(1)};
  leg.s = {links.s1, links.s2, S(0)};
  leg.margin = std::abs(to_double(links.s2));
}

template <class S>
void solve_planar_slider(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                         LegSolution<S>& leg) {
  const S l(shape.l2);
  S w;
  if (!take_root<S>((l - L.y()) * (l + L.y()), w, leg)) return;
  leg.slide = L.x() + S(branch.elbow) * w;
  leg.c[1] = -S(branch.elbow) * w / l;
  leg.s[1] = L.y() / l;
  leg.margin = to_double(S(w / l));
}

/// From the last centre of rotation to the tip, leg axes.
template <class S>
Vec3<S> find_tip(LegKind kind, const LegShape& shape, const LegSolution<S>& leg) {
  const S a(shape.tip.x()), b(shape.tip.y()), c(shape.tip.z());
  if (kind == LegKind::kR2P1R3) return {leg.slide + a, b, c};
  if (kind == LegKind::kR1R2R3) {
    return {leg.c[2] * a + leg.s[2] * c, b, leg.c[2] * c - leg.s[2] * a};
  }
  return {S(shape.l2) * leg.c[2], S(shape.l2) * leg.s[2], S(0)};
}

}  // namespace

template <class S>
LegSolution<S> solve_leg(LegKind kind, const LegShape& shape, LegBranch branch, const Vec3<S>& L) {
  LegSolution<S> leg;
  switch (kind) {
    case LegKind::kR2P1R3:
      solve_slide_leg(shape, branch, L, leg);
      break;
    case LegKind::kR1R2R3:
      solve_crank_leg(shape, branch, L, leg);
      break;
    case LegKind::kR1R2R3Perpendicular:
      solve_crank_leg_perpendicular(shape, branch, L, leg);
      break;
    case LegKind::kP1R2R3:
      solve_slider_strut(shape, branch, L, leg);
      break;
    case LegKind::kR2R1R3:
      solve_elbow_leg(shape, branch, L, leg);
      break;
    case LegKind::kR1P1R1:
      solve_planar_slide(shape, branch, L, leg);
      break;
    case LegKind::kR1R1R1:
      solve_planar_elbow(shape, branch, L, leg);
      break;
    case LegKind::kP1R1R1:
      solve_planar_slider(shape, branch, L, leg);
      break;
  }
  return leg;
}

template <class S>
Mat3<S> find_leg_inverse(LegKind kind, const LegShape& shape, const LegSolution<S>& leg,
                         const Mat3<S>& axes) {
  const Vec3<S> x = axes.col(0), y = axes.col(1), z = axes.col(2);
  const Vec3<S> d = find_tip(kind, shape, leg);
  const S c2 = leg.c[1], s2 = leg.s[1];
  Vec3<S> rate1, rate2, rate3;
  if (kind == LegKind::kR2P1R3) {
    rate1 = z / (s2 * d.y() - c2 * d.x());
    rate2 = (y + s2 * d.z() * rate1) / d.x();
    rate3 = x - c2 * d.z() * rate1 + d.y() * rate2;
  } else if (kind == LegKind::kR1R2R3) {
    rate3 = z / -d.x();
    const Vec3<S> vx = x - d.z() * rate3;
    const S D = s2 * d.x() + c2 * d.y();
    rate1 = (d.x() * vx + d.y() * y) / (S(shape.l1) * D);
    rate2 = (s2 * y - c2 * vx) / D - rate1;
  } else {
    const Vec3<S> turn = x / d.y();
    rate1 = (y + d.x() * turn) / S(shape.l1);
    rate2 = (z + s2 * d.y() * rate1) / -d.x();
    rate3 = -turn - c2 * rate1;
  }
  Mat3<S> inverse;
  inverse.row(0) = rate1.transpose();
  inverse.row(1) = rate2.transpose();
  inverse.row(2) = rate3.transpose();
  return inverse;
}

template <class S>
int find_leg_sign(LegKind kind, const LegShape& shape, const LegSolution<S>& leg) {
  const Vec3<S> d = find_tip(kind, shape, leg);
  const S c2 = leg.c[1], s2 = leg.s[1];
  S determinant = d.x() * d.y();
  if (kind == LegKind::kR2P1R3) determinant = c2 * d.x() - s2 * d.y();
  if (kind == LegKind::kR2P1R3 && d.x() < S(0)) determinant = -determinant;
  if (kind == LegKind::kR1R2R3) determinant = -d.x() * (s2 * d.x() + c2 * d.y());
  return determinant < S(0) ? -1 : 1;
}

template <class S>
Vec3<S> find_leg_bias(LegKind kind, const LegShape& shape, const LegSolution<S>& leg,
                      const Vec3<S>& rate) {
  const Vec3<S> d = find_tip(kind, shape, leg);
  const S c2 = leg.c[1], s2 = leg.s[1];
  if (kind == LegKind::kR2P1R3) {
    const Vec3<S> w(rate[0] * s2, rate[0] * c2, rate[1]);
    const S gyro = rate[0] * rate[1];
    const Vec3<S> alpha(gyro * c2, -gyro * s2, S(0));
    const Vec3<S> sliding(S(2) * rate[2], S(0), S(0));
    return alpha.cross(d) + w.cross(Vec3<S>(w.cross(d) + sliding));
  }
  const S turn = rate[0] + rate[1], crank = rate[0] * rate[0] * S(shape.l1);
  return {-crank * c2 - d.x() * (rate[2] * rate[2] + turn * turn),
          crank * s2 + S(2) * turn * rate[2] * d.z() - d.y() * turn * turn,
          -d.z() * rate[2] * rate[2]};
}

#define DOCK_INSTANTIATE(S)                                                                  \
  template LegSolution<S> solve_leg<S>(LegKind, const LegShape&, LegBranch, const Vec3<S>&); \
  template Mat3<S> find_leg_inverse<S>(LegKind, const LegShape&, const LegSolution<S>&,      \
                                       const Mat3<S>&);                                      \
  template int find_leg_sign<S>(LegKind, const LegShape&, const LegSolution<S>&);            \
  template Vec3<S> find_leg_bias<S>(LegKind, const LegShape&, const LegSolution<S>&,         \
                                    const Vec3<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
