// The formulas of leg types without an inverse, and the way to those of leg_formulas.hpp; see
// closed_form.hpp for axes and branches.
#pragma once

#include <algorithm>
#include <cmath>

#include "loops/closed_form.hpp"
#include "loops/leg_stages.hpp"
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

/// The leg of leg_formulas.hpp with these lengths.
template <class S>
legs::Shape<double> make_leg_shape(LegKind kind, const LegShape& shape, LegBranch branch) {
  const bool is_square = kind == LegKind::kR1R2R3Perpendicular;
  const Vec3<double> tip = is_square ? Vec3<double>(0.0, shape.l2, 0.0) : shape.tip;
  return {{tip.x(), tip.y(), tip.z()},
          shape.l1,
          shape.height,
          static_cast<double>(branch.elbow),
          static_cast<double>(branch.flip)};
}

static_assert(static_cast<int>(LegKind::kR2P1R3) == legs::kSlideLeg &&
              static_cast<int>(LegKind::kR1R2R3) == legs::kCrankLeg &&
              static_cast<int>(LegKind::kR1R2R3Perpendicular) == legs::kSquareCrankLeg);
inline legs::LegType get_leg_type(LegKind kind) {
  return static_cast<legs::LegType>(static_cast<int>(kind));
}

/// A leg with an inverse. The square crank has its axes renamed in leg_formulas.hpp: z x y.
template <class S>
void solve_leg_with_inverse(LegKind kind, const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                            LegSolution<S>& leg) {
  legs::visit_kind<double, S>(get_leg_type(kind), [&](auto solved) {
    const bool is_square = kind == LegKind::kR1R2R3Perpendicular;
    const lanes::Vector<S> target =
        is_square ? lanes::Vector<S>{L.z(), L.x(), L.y()} : lanes::Vector<S>{L.x(), L.y(), L.z()};
    const legs::Reached reached = solved.solve(make_leg_shape<S>(kind, shape, branch), target, 0.0);
    if (reached != legs::Reached::kYes) {
      leg.code =
          reached == legs::Reached::kNo ? StatusCode::kOutOfReach : StatusCode::kLoopSingular;
      return;
    }
    leg.c = {solved.first.c, solved.second.c, solved.third.c};
    leg.s = {solved.first.s, solved.second.s, solved.third.s};
    leg.slide = solved.slide;
    leg.margin = std::sqrt(std::min(to_double(solved.reach[0]) / to_double(solved.reach[1]),
                                    to_double(solved.reach[2]) / to_double(solved.reach[3])));
  });
}

/// Call work(leg) with a leg of leg_formulas.hpp that stands at this solution.
template <class S, class Work>
void visit_solved(LegKind kind, const LegShape& shape, const LegSolution<S>& at, const Work& work) {
  legs::visit_kind<double, S>(get_leg_type(kind), [&](auto leg) {
    leg.first = {at.c[0], at.s[0]};
    leg.second = {at.c[1], at.s[1]};
    leg.third = {at.c[2], at.s[2]};
    leg.slide = at.slide;
    leg.l1 = shape.l1;
    leg.height = shape.height;
    const S a(shape.tip.x()), b(shape.tip.y()), c(shape.tip.z());
    if (kind == LegKind::kR2P1R3) {
      leg.tip = {at.slide + a, b, c};
    } else if (kind == LegKind::kR1R2R3) {
      leg.tip = {at.c[2] * a + at.s[2] * c, b, at.c[2] * c - at.s[2] * a};
    } else {
      leg.tip = {S(0), S(shape.l2) * at.c[2], S(shape.l2) * at.s[2]};
    }
    work(leg);
  });
}

template <class S>
void solve_slider_strut(const LegShape& shape, LegBranch branch, const Vec3<S>& L,
                        LegSolution<S>& leg) {
  using std::sqrt;
  const Vec3<S> axis = cast<S>(shape.slide), tip = cast<S>(shape.tip);
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

}  // namespace

template <class S>
LegSolution<S> solve_leg(LegKind kind, const LegShape& shape, LegBranch branch, const Vec3<S>& L) {
  LegSolution<S> leg;
  switch (kind) {
    case LegKind::kR2P1R3:
    case LegKind::kR1R2R3:
    case LegKind::kR1R2R3Perpendicular:
      solve_leg_with_inverse(kind, shape, branch, L, leg);
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
  Mat3<S> inverse;
  visit_solved(kind, shape, leg, [&](const auto& solved) {
    const lanes::Matrix<S> columns = lanes::transpose(lanes::fill<S>(solved.find_inverse()));
    inverse << columns.x.x, columns.y.x, columns.z.x, columns.x.y, columns.y.y, columns.z.y,
        columns.x.z, columns.y.z, columns.z.z;
  });
  // Components along the leg axes, in the names of closed_form.hpp.
  if (kind == LegKind::kR1R2R3Perpendicular) {
    const Mat3<S> renamed = inverse;
    inverse << renamed.col(1), renamed.col(2), renamed.col(0);
  }
  return inverse * axes.transpose();
}

template <class S>
Vec3<S> find_leg_bias(LegKind kind, const LegShape& shape, const LegSolution<S>& leg,
                      const Vec3<S>& rate) {
  Vec3<S> bias;
  visit_solved(kind, shape, leg, [&](const auto& solved) {
    const lanes::Vector<S> a =
        legs::find_tip_bias(solved, lanes::Vector<S>{rate[0], rate[1], rate[2]});
    bias = {a.x, a.y, a.z};
  });
  if (kind == LegKind::kR1R2R3Perpendicular) return {bias.y(), bias.z(), bias.x()};
  return bias;
}

#define DOCK_INSTANTIATE(S)                                                                  \
  template LegSolution<S> solve_leg<S>(LegKind, const LegShape&, LegBranch, const Vec3<S>&); \
  template Mat3<S> find_leg_inverse<S>(LegKind, const LegShape&, const LegSolution<S>&,      \
                                       const Mat3<S>&);                                      \
  template Vec3<S> find_leg_bias<S>(LegKind, const LegShape&, const LegSolution<S>&,         \
                                    const Vec3<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
