// The formulas of the three kinds of legs, for any number: a double, a dual number, one of 32
// digits, or a register with eight legs side by side.
//
// All legs have three bodies and three joints (LegType), and everything is computed alike but for
// this: which joint coordinates bring the tip to a point, the inverse of the loop matrix, what
// force and moment do along the first and along the last joint, and how the rod moves on the tube.
// P is the type of numbers, N that of the constants of a leg. Axes R, C, K, E and rows of numbers
// are those of leg_rows.hpp. LEGS.md lists the formulas.
#pragma once

#include "loops/leg_rows.hpp"
#include "math/plain_vectors.hpp"

namespace dockloop::legs {
namespace {

using namespace lanes;

/// Is this square under a root positive? Vector code also compares it with `least`: see
/// leg_lanes_body.hpp.
/// @param least  smallest quotient of `square` and `of`
template <class P>
Reached find_reached(const P& square, const P&, double) {
  if (square > P(0)) return Reached::kYes;
  return square < P(0) ? Reached::kNo : Reached::kSingular;
}

/// Mass, first moment, inertia; of cross and whole leg about the centre, of others about the elbow.
template <class Mass, class First, class Inertia>
struct Moments {
  Mass m;
  First h;
  Inertia J;
};
template <class M, class H, class J>
Moments(M, H, J) -> Moments<M, H, J>;
template <class A, class B, class C, class D, class E, class F>
auto operator+(const Moments<A, B, C>& a, const Moments<D, E, F>& b) {
  return Moments{a.m + b.m, a.h + b.h, a.J + b.J};
}
template <class Cells>
auto get_moments(const Cells& in, int row) {
  return Moments{in.get(row), in.get_vector(row + 1), in.get_symmetric(row + 4)};
}
/// About another point. @param r  from there to the former one
template <class M, class A, class B, class C, class... S, class D>
auto shift(const Moments<M, Vector<A, B, C>, Symmetric<S...>>& of, const Vector<D>& r) {
  const auto q = of.h + of.h + of.m * r;
  const auto trace = dot(r, q);
  const auto& h = of.h;
  const auto& J = of.J;
  return Moments{
      of.m, h + of.m * r,
      Symmetric{J.xx + (trace - r.x * q.x), J.yy + (trace - r.y * q.y), J.zz + (trace - r.z * q.z),
                J.xy - (r.x * h.y + r.y * (h.x + of.m * r.x)),
                J.xz - (r.x * h.z + r.z * (h.x + of.m * r.x)),
                J.yz - (r.y * h.z + r.z * (h.y + of.m * r.y))}};
}
template <class M, class H, class J>
auto shift(const Moments<M, H, J>& of, Zero) {
  return of;
}

/// In axes turned back.
template <class T, class M, class H, class J>
auto turn_back(const Turn<T>& t, const Moments<M, H, J>& of) {
  return Moments{of.m, turn_back(t, of.h), turn(reverse(t), of.J)};
}

/// Rotors on tube or rod that turn with the slide, about its axis; frozen they are a part of their
/// carrier. Zero of legs that have no slide.
template <class N>
struct Spin {
  N momentum;  ///< per rate of the slide
  N inertia;   ///< that the slide feels
};

/// Momentum or force, and its moment about centre or elbow, E.
template <class F, class M = F>
struct Wrench {
  F f;
  M n;
};
template <class F, class M>
Wrench(F, M) -> Wrench<F, M>;
template <class A, class B, class C, class D>
auto operator+(const Wrench<A, B>& a, const Wrench<C, D>& b) {
  return Wrench{a.f + b.f, a.n + b.n};
}

/// What is not zero for a kind of legs.
template <class T>
Zero if_zero(Zero, const T&) {
  return {};
}
template <class Off, class T>
T if_zero(const Off&, const T& x) {
  return x;
}

/// Of a body: acceleration of its point in the elbow (cross: centre), angular velocity and
/// acceleration, E.
template <class A, class W, class Alpha>
struct Motion {
  A a;
  W w;
  Alpha alpha;
};
template <class A, class W, class Alpha>
Motion(A, W, Alpha) -> Motion<A, W, Alpha>;

/// With the momentum of rotors per rate of the slide.
template <class N, class F, class A, class B, class C>
auto add_spin(const Wrench<F, Vector<A, B, C>>& w, const Spin<N>& spin) {
  return Wrench{w.f, Vector{w.n.x + spin.momentum, w.n.y, w.n.z}};
}
template <class F, class M>
auto add_spin(const Wrench<F, M>& w, Zero) {
  return w;
}

/// Inertia that the last joint feels of rotors.
template <class N>
N get_inertia(const Spin<N>& spin) {
  return spin.inertia;
}
inline Zero get_inertia(Zero) { return {}; }

/// What moves rotors relative to their carrier. @param w  of the carrier
/// @param rate, acceleration  of the slide
template <class N, class W, class P, class A>
auto find_spin_load(const Spin<N>& spin, const W& w, const P& rate, const A& acceleration) {
  const P momentum = spin.momentum * rate;
  return Wrench{Zero(), Vector{spin.momentum * acceleration, momentum * w.z, -(momentum * w.y)}};
}
template <class W, class P, class A>
Zero find_spin_load(Zero, const W&, const P&, const A&) {
  return {};
}

/// Force that a slide needs for its rotors.
/// @param along  angular acceleration of the carrier about the slide
template <class N, class P, class A>
P find_spin_force(const Spin<N>& spin, const P& along, const A& acceleration) {
  return spin.momentum * along + spin.inertia * acceleration;
}
template <class P, class A>
Zero find_spin_force(Zero, const P&, const A&) {
  return {};
}

/// What moves a body.
template <class M, class H, class J, class A, class W, class Alpha>
auto find_load(const Moments<M, H, J>& of, const Motion<A, W, Alpha>& at) {
  return Wrench{cross(at.alpha, of.h) + cross(at.w, cross(at.w, of.h)) + of.m * at.a,
                of.J * at.alpha + cross(at.w, of.J * at.w) + cross(of.h, at.a)};
}

template <class A, class W, class Alpha>
Wrench<Zero> find_load(Zero, const Motion<A, W, Alpha>&) {
  return {};
}

/// Lengths and assembly branch of a leg.
template <class N>
struct Shape {
  Vector<N> tip;
  N l1, height, elbow, flip;
};

/// What all kinds have. Side: of the components of the tip that may be zero for a kind.
template <class N, class P, class Side = P>
struct Leg {
  Turn<P> first, second, third;
  Vector<P, Side> tip;  ///< from the elbow, E
  N l1, height;         ///< of the crank
  P slide;              ///< coordinate of the slide [m]
  P reach[4];           ///< see kReach

  template <class In, class Out>
  void read(const In& in, const Out& work) {
    second = work.get_turn(kTurns + 2);
    work.read(kArm, tip);
    l1 = in.get(kCrank);
    height = in.get(kCrank + 1);
  }
  template <class In>
  static auto get_outer(const In& in, int row) {
    return get_moments(in, row);
  }
  template <class In>
  static auto get_cross(const In& in) {
    return get_moments(in, kCross);
  }
  template <class In>
  static Zero get_spin(const In&) {
    return {};
  }
  template <class Out>
  void write(const Out& work) const {
    work.put(kTurns, first);
    work.put(kTurns + 2, second);
    work.put(kTurns + 4, third);
    work.put(kSlide, slide);
    work.put(kArm, tip);
    for (int i = 0; i < 4; ++i) work.put(kReach + i, reach[i]);
  }
  /// Two squares, and what they are compared with.
  void set_reach(const P& a, const P& of_a, const P& b, const P& of_b) {
    reach[0] = a, reach[1] = of_a, reach[2] = b, reach[3] = of_b;
  }
};

// Members of a kind, where they are not plain:
//   solve          joint coordinates that bring the tip to L, a vector from the centre, K
//   find_axes      of E, in K
//   find_inverse   of the loop matrix: its rows, E, are joint rates per velocity of the tip
//   find_elbow     from the centre, E
//   get_axis       of the first joint, E; get_along_axis: component along it, K turned by it
//   find_first     what force and moment about the elbow do along the first joint
//   find_last      the same, along the last one
//   get_outer      moments of tube or rod, whose first row is given; get_cross: of the cross
//   find_turned    inertia about the first axis, from moments about the elbow, without the part of
//                  a point mass in the elbow: kTurned holds that part
//   place_rod      moments of the rod about the elbow, E, from those at coordinate 0
//   carry_last     momentum of the rod about the elbow per rate of the last joint
//   get_spin       rotors that turn with the last joint
//   move_rod       motion of the rod. @param rate, acceleration  of the last joint

/// A universal joint and a slide.                                                      [Y2 (9a)]
/// @tparam Off  what is off the axis of the slide: numbers, or Zero where tip, tube and rod are
/// symmetric about it and the cross has no mass. Most legs are so.
template <class N, class P, class Off>
struct SlideLeg : Leg<N, P, Mix<Off, P>> {
  using Side = Mix<Off, P>;
  using Base = Leg<N, P, Side>;
  using Base::first, Base::second, Base::third, Base::tip, Base::slide;

  static Off get_off(const N& x) { return if_zero(Off(), x); }
  Reached solve(const Shape<N>& shape, const Vector<P>& L, double least) {
    const Vector<N, Off> d = {shape.tip.x, get_off(shape.tip.y), get_off(shape.tip.z)};
    const P square = dot(L, L), xi2 = square - d.y * d.y - d.z * d.z;
    const P X2 = L.x * L.x + L.z * L.z - d.z * d.z;
    this->set_reach(xi2, square, X2, square);
    // A leg of no length has no direction either.
    if (find_reached(xi2, square, least) != Reached::kYes) return Reached::kNo;
    const Reached reached = find_reached(X2, square, least);
    if (reached != Reached::kYes) return reached;
    const P xi = shape.elbow * take_root(xi2), X = shape.flip * take_root(X2);
    const P in_plane = 1.0 / (xi2 + d.y * d.y), across = 1.0 / (X2 + d.z * d.z);
    second = {(xi * X + d.y * L.y) * in_plane, (xi * L.y - d.y * X) * in_plane};
    first = {(X * L.x + d.z * L.z) * across, (d.z * L.x - X * L.z) * across};
    third = {1.0 + P{}, P{}};
    slide = xi - d.x;
    tip = {xi, Number<Side>::of(d.y), Number<Side>::of(d.z)};
    return reached;
  }
  auto find_axes() const {
    const Turn<P>&a = first, &b = second;
    return Columns{Vector{a.c * b.c, b.s, -a.s * b.c}, Vector{-a.c * b.s, b.c, a.s * b.s},
                   Vector{a.s, Zero(), a.c}};
  }
  auto find_inverse() const {
    const P k2y = 1.0 / tip.x, k1z = 1.0 / (second.s * tip.y - second.c * tip.x);
    const Side k2z = k2y * second.s * tip.z * k1z;
    return Columns{Vector{Zero(), Zero(), k1z}, Vector{Zero(), k2y, k2z},
                   Vector{One(), tip.y * k2y, tip.y * k2z - second.c * tip.z * k1z}};
  }
  Zero find_elbow() const { return {}; }
  auto get_axis() const { return Vector{second.s, second.c, Zero()}; }
  static P get_along_axis(const Vector<P>& v) { return v.y; }
  static Zero get_along_axis(Zero) { return {}; }
  template <class AnyWrench>
  auto find_first(const AnyWrench& w) const {
    return second.s * w.n.x + second.c * w.n.y;
  }
  template <class AnyWrench>
  static auto find_last(const AnyWrench& w) {
    return w.f.x;
  }
  template <class In>
  static Spin<N> get_spin(const In& in) {
    return {in.get(kSpin), in.get(kSpin + 1)};
  }
  template <class In>
  static auto get_outer(const In& in, int row) {
    return Moments{
        in.get(row), Vector{in.get(row + 1), get_off(in.get(row + 2)), get_off(in.get(row + 3))},
        Symmetric{in.get(row + 4), in.get(row + 5), in.get(row + 6), get_off(in.get(row + 7)),
                  get_off(in.get(row + 8)), get_off(in.get(row + 9))}};
  }
  template <class In>
  static auto get_cross(const In& in) {
    return if_zero(Off(), get_moments(in, kCross));
  }
  template <class AnyMoments>
  P find_turned(const AnyMoments& of) const {
    const P &s = second.s, &c = second.c;
    return s * s * of.J.xx + 2.0 * s * c * of.J.xy + c * c * of.J.yy;
  }
  template <class AnyMoments>
  auto place_rod(const AnyMoments& rod) const {
    const Vector<P, Side> h = {rod.h.x + rod.m * slide, Number<Side>::of(rod.h.y),
                               Number<Side>::of(rod.h.z)};
    const P spread_x = slide * (rod.h.x + h.x);
    return Moments{rod.m, h,
                   Symmetric{Number<P>::of(rod.J.xx), rod.J.yy + spread_x, rod.J.zz + spread_x,
                             rod.J.xy - slide * rod.h.y, rod.J.xz - slide * rod.h.z,
                             Number<Side>::of(rod.J.yz)}};
  }
  template <class AnyMoments>
  static auto carry_last(const AnyMoments& rod) {
    return Wrench{Vector{Number<P>::of(rod.m), Zero(), Zero()}, Vector{Zero(), rod.h.z, -rod.h.y}};
  }
  template <class AnyMotion, class B>
  auto move_rod(const AnyMotion& tube, const P& rate, const B& acceleration) const {
    const P twice = 2.0 * rate;
    const auto slip = Vector{acceleration, twice * tube.w.z, -(twice * tube.w.y)};
    return Motion{slip + tube.a, tube.w, tube.alpha};
  }
};

/// A crank and a universal joint with its first axis parallel to the crank's: seen along z, crank
/// and rod are two links.                                                             [Y2 (9b)]
/// The published steps carry errors in signs and denominators that are mended here.
template <class N, class P>
struct CrankLeg : Leg<N, P> {
  using Base = Leg<N, P>;
  using Base::first, Base::second, Base::third, Base::tip, Base::l1, Base::height, Base::slide;

  Reached solve(const Shape<N>& shape, const Vector<P>& L, double least) {
    const Vector<N>& d = shape.tip;
    l1 = shape.l1;
    height = shape.height;
    const N steep = d.x * d.x + d.z * d.z;
    const P h = L.z - height, X2 = steep - h * h;
    const P flat = L.x * L.x + L.y * L.y, rod = X2 + d.y * d.y;
    const P along = (flat - l1 * l1 - rod) / (2.0 * l1);  // second link along the crank
    const P across2 = rod - along * along;
    this->set_reach(X2, steep + P{}, across2, rod);
    Reached reached = find_reached(X2, steep + P{}, least);
    if (reached == Reached::kYes) reached = find_reached(across2, rod, least);
    if (reached != Reached::kYes) return reached;
    const P X = shape.flip * take_root(X2), across = shape.elbow * take_root(across2);
    const N in_steep = 1.0 / steep;
    const P in_rod = 1.0 / rod, in_flat = 1.0 / flat, distance = l1 + along;
    first = {(distance * L.x + across * L.y) * in_flat, (distance * L.y - across * L.x) * in_flat};
    second = {(along * X + across * d.y) * in_rod, (across * X - along * d.y) * in_rod};
    third = {(d.x * X + d.z * h) * in_steep, (d.z * X - d.x * h) * in_steep};
    slide = P{};
    tip = {X, d.y + P{}, h};
    return reached;
  }
  auto find_axes() const {
    const P c = first.c * second.c - first.s * second.s;
    const P s = first.s * second.c + first.c * second.s;
    return Columns{Vector{c, s, Zero()}, Vector{-s, c, Zero()}, Vector{Zero(), Zero(), One()}};
  }
  auto find_inverse() const {
    const P across = second.s * tip.x + second.c * tip.y, in = 1.0 / (l1 * across);
    const P in_X = 1.0 / tip.x;
    const Vector<P> turn1 = in * tip;
    const Vector<P> both = (l1 * in) * Vector<P>{-second.c, second.s, -(second.c * tip.z * in_X)};
    return Columns{turn1, both - turn1, Vector{Zero(), Zero(), -in_X}};
  }
  Vector<P> find_elbow() const { return fill<P>(turn_back(second, Vector<N>{l1, N{}, height})); }
  auto get_axis() const { return Vector{Zero(), Zero(), One()}; }
  static P get_along_axis(const Vector<P>& v) { return v.z; }
  template <class AnyWrench>
  P find_first(const AnyWrench& w) const {
    return w.n.z + l1 * (second.s * w.f.x + second.c * w.f.y);
  }
  template <class AnyWrench>
  static P find_last(const AnyWrench& w) {
    return w.n.y;
  }
  template <class AnyMoments>
  P find_turned(const AnyMoments& of) const {
    return of.J.zz + 2.0 * l1 * (second.c * of.h.x - second.s * of.h.y);
  }
  template <class AnyMoments>
  auto place_rod(const AnyMoments& rod) const {
    return Moments{rod.m, roll(fill<P>(this->third * roll_back(rod.h))),
                   roll(fill<P>(turn(this->third, roll_back(rod.J))))};
  }
  template <class AnyMoments>
  static auto carry_last(const AnyMoments& rod) {
    return Wrench{Vector{rod.h.z, Zero(), -rod.h.x}, Vector{rod.J.xy, rod.J.yy, rod.J.yz}};
  }
  template <class AnyMotion, class B>
  auto move_rod(const AnyMotion& tube, const P& rate, const B& acceleration) const {
    const auto& w = tube.w;
    const auto& alpha = tube.alpha;
    return Motion{tube.a, Vector{w.x, w.y + rate, w.z},
                  Vector{alpha.x - rate * w.z, alpha.y + acceleration, alpha.z + rate * w.x}};
  }
};

/// The same with the first axis of the universal joint square to the crank's: the rod turns in the
/// plane of x and z of the tube's second joint, with its tip at (0, l2 cos, l2 sin).
template <class N, class P>
struct SquareCrankLeg : Leg<N, P> {
  using Base = Leg<N, P>;
  using Base::first, Base::second, Base::third, Base::tip, Base::l1, Base::height, Base::slide;

  Reached solve(const Shape<N>& shape, const Vector<P>& L, double least) {
    const N l2 = shape.tip.y, square = l2 * l2;
    l1 = shape.l1;
    height = shape.height;
    const P h = L.x - height, flat = L.y * L.y + L.z * L.z;
    const P along = (flat + h * h - l1 * l1 - square) / (2.0 * l1);  // rod along the crank
    const P y2 = along * along + h * h, z2 = square - y2;
    this->set_reach(y2, square + P{}, z2, square + P{});
    Reached reached = find_reached(y2, square + P{}, least);
    if (reached == Reached::kYes) reached = find_reached(z2, square + P{}, least);
    if (reached != Reached::kYes) return reached;
    const P y = shape.flip * take_root(y2), z = shape.elbow * take_root(z2);
    const N in_l2 = 1.0 / l2;
    const P in_y = 1.0 / y, in_flat = 1.0 / flat, distance = l1 + along;
    first = {(distance * L.y + z * L.z) * in_flat, (distance * L.z - z * L.y) * in_flat};
    second = {along * in_y, -(h * in_y)};
    third = {y * in_l2, z * in_l2};
    slide = P{};
    tip = {P{}, y, z};
    return reached;
  }
  auto find_axes() const {
    const Turn<P>&a = first, &b = second;
    return Columns{Vector{b.c, a.c * b.s, a.s * b.s}, Vector{-b.s, a.c * b.c, a.s * b.c},
                   Vector{Zero(), -a.s, a.c}};
  }
  auto find_inverse() const {
    const N in_l1 = 1.0 / l1;
    const P in_z = 1.0 / tip.z, in_y = 1.0 / tip.y;
    const auto turn1 = Vector{Zero(), tip.y * in_z * in_l1, Number<P>::of(in_l1)};
    const auto turn2 = -(second.s * tip.z * in_y) * turn1, turn3 = -second.c * turn1;
    return Columns{turn1, Vector{-in_y, turn2.y, turn2.z}, Vector{Zero(), turn3.y - in_z, turn3.z}};
  }
  Vector<P> find_elbow() const { return fill<P>(turn_back(second, Vector<N>{height, l1, N{}})); }
  auto get_axis() const { return Vector{second.c, -second.s, Zero()}; }
  static P get_along_axis(const Vector<P>& v) { return v.x; }
  template <class AnyWrench>
  P find_first(const AnyWrench& w) const {
    return second.c * w.n.x - second.s * w.n.y + l1 * w.f.z;
  }
  template <class AnyWrench>
  static P find_last(const AnyWrench& w) {
    return w.n.x;
  }
  template <class AnyMoments>
  P find_turned(const AnyMoments& of) const {
    const P &s = second.s, &c = second.c;
    return c * c * of.J.xx - 2.0 * c * s * of.J.xy + s * s * of.J.yy +
           2.0 * l1 * (c * of.h.y + s * of.h.x);
  }
  template <class AnyMoments>
  auto place_rod(const AnyMoments& rod) const {
    return Moments{rod.m, roll_back(fill<P>(this->third * roll(rod.h))),
                   roll_back(fill<P>(turn(this->third, roll(rod.J))))};
  }
  template <class AnyMoments>
  static auto carry_last(const AnyMoments& rod) {
    return Wrench{Vector{Zero(), -rod.h.z, rod.h.y}, Vector{rod.J.xx, rod.J.xy, rod.J.xz}};
  }
  template <class AnyMotion, class B>
  auto move_rod(const AnyMotion& tube, const P& rate, const B& acceleration) const {
    const auto& w = tube.w;
    const auto& alpha = tube.alpha;
    return Motion{tube.a, Vector{w.x + rate, w.y, w.z},
                  Vector{alpha.x + acceleration, alpha.y + rate * w.z, alpha.z - rate * w.y}};
  }
};

template <class Cross, class Tube, class Rod>
struct LegMotion {
  Cross cross;
  Tube tube;
  Rod rod;
};
template <class A, class B, class C>
LegMotion(A, B, C) -> LegMotion<A, B, C>;

/// Velocities, and the accelerations that follow from them.
/// @param w, alpha      of R, E
/// @param a             acceleration of the centre, E
/// @param rate          of the joints
/// @param acceleration  of the joints, or Zero
template <class AnyLeg, class W, class Alpha, class A, class P, class Acceleration>
auto find_motion(const AnyLeg& leg, const W& w, const Alpha& alpha, const A& a,
                 const Vector<P>& rate, const Acceleration& acceleration) {
  const auto axis = leg.get_axis();
  const auto w1 = w + rate.x * axis;
  const auto w2 = Vector{w1.x, w1.y, w1.z + rate.y};
  const auto alpha1 = alpha + rate.x * cross(w, axis) + acceleration.x * axis;
  const auto alpha2 = Vector{w1.y * rate.y, -(w1.x * rate.y), acceleration.y} + alpha1;
  const auto arm = leg.find_elbow();
  const auto elbow = a + (cross(alpha1, arm) + cross(w1, cross(w1, arm)));
  const auto tube = Motion{elbow, w2, alpha2};
  return LegMotion{Motion{a, w1, alpha1}, tube, leg.move_rod(tube, rate.z, acceleration.z)};
}

/// Joint accelerations that are zero.
struct NoAcceleration {
  Zero x, y, z;
};

/// Acceleration of the tip relative to R at zero joint accelerations, E.
template <class AnyLeg, class P>
Vector<P> find_tip_bias(const AnyLeg& leg, const Vector<P>& rate) {
  const auto rod = find_motion(leg, Zero(), Zero(), Zero(), rate, NoAcceleration()).rod;
  return fill<P>(cross(rod.alpha, leg.tip) + cross(rod.w, cross(rod.w, leg.tip)) + rod.a);
}

}  // namespace
}  // namespace dockloop::legs
