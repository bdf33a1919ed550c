// The kinds of legs in lanes: what each of them does its own way. Included by leg_lanes_body.hpp.
//
// All legs have three bodies and three joints (LegType), and everything is computed alike but for
// this: which joint coordinates bring the tip to a point, the inverse of the loop matrix, what
// force and moment do along the first and along the last joint, and how the rod moves on the tube.
#include "math/lane_arithmetic.hpp"

namespace dockloop::legs {
namespace {

using namespace lanes;

/// Mass, first moment, inertia; of cross and whole leg about the centre, of others about the elbow.
struct Moments {
  Lanes m;
  V h;
  Sym J;
};
inline Moments operator+(const Moments& a, const Moments& b) {
  return {a.m + b.m, a.h + b.h, a.J + b.J};
}
inline Moments get_moments(const Cells& in, int row) {
  return {in.get(row), in.get_vector(row + 1), in.get_symmetric(row + 4)};
}
/// About another point. @param r  from there to the former one
inline Moments shift(const Moments& of, V r) {
  const V q = of.h + of.h + of.m * r;
  const Lanes trace = dot(r, q);
  Sym J = of.J;
  J.xx += trace - r.x * q.x;
  J.yy += trace - r.y * q.y;
  J.zz += trace - r.z * q.z;
  J.xy -= r.x * of.h.y + r.y * (of.h.x + of.m * r.x);
  J.xz -= r.x * of.h.z + r.z * (of.h.x + of.m * r.x);
  J.yz -= r.y * of.h.z + r.z * (of.h.y + of.m * r.y);
  return {of.m, of.h + of.m * r, J};
}
inline Moments shift(const Moments& of, Zero) { return of; }

/// Momentum or force, and its moment about centre or elbow, E.
struct Wrench {
  V f, n;
};
inline Wrench operator+(const Wrench& a, const Wrench& b) { return {a.f + b.f, a.n + b.n}; }

/// Of a body: acceleration of its point in the elbow (cross: centre), angular velocity and
/// acceleration, E.
template <class A>
struct Motion {
  A a;
  V w, alpha;
};

/// What moves a body.
template <class A>
Wrench find_load(const Moments& of, const Motion<A>& at) {
  return {cross(at.alpha, of.h) + cross(at.w, cross(at.w, of.h)) + of.m * at.a,
          of.J * at.alpha + cross(at.w, of.J * at.w) + cross(of.h, at.a)};
}

/// What all kinds have.
struct Leg {
  Turn first, second, third;
  V tip;             ///< from the elbow, E
  Lanes l1, height;  ///< of the crank
  Lanes slide{};     ///< coordinate of the slide [m]

  void read(const Cells& in, const Cells& work) {
    second = work.get_turn(kTurns + 2);
    tip = work.get_vector(kArm);
    l1 = in.get(kCrank);
    height = in.get(kCrank + 1);
  }
  void write(const Cells& work) const {
    work.put(kTurns, first);
    work.put(kTurns + 2, second);
    work.put(kTurns + 4, third);
    work.put(kSlide, slide);
    work.put(kArm, tip);
  }
};

// Members of a kind, where they are not plain:
//   solve          joint coordinates that bring the tip to L, K; false if it is out of reach or the
//                  margin, the root of reach / square, is below the limit (or not a number)
//   find_axes      of E, in K
//   find_inverse   of the loop matrix: its rows, E, are joint rates per velocity of the tip
//   find_elbow     from the centre, E
//   get_axis       of the first joint, E; get_along_axis: component along it, K turned by it
//   find_first     what force and moment about the elbow do along the first joint
//   find_last      the same, along the last one
//   find_turned    inertia about the first axis of what has these moments about the elbow, less
//                  what it would have as a point there
//   carry_last     momentum of the rod about the elbow per rate of the last joint
//   move_rod       motion of the rod. @param rate, acceleration  of the last joint

/// [Y2 (9a)]
struct SlideLeg : Leg {
  bool solve(const Cells& in, V L, Lanes limit, Lanes& reach, Lanes& square) {
    const V d = in.get_vector(kTip);
    square = dot(L, L);
    const Lanes xi2 = square - d.y * d.y - d.z * d.z;
    const Lanes X2 = L.x * L.x + L.z * L.z - d.z * d.z;
    const Lanes least = limit * limit * square;
    reach = xi2 < X2 ? xi2 : X2;
    if (has_any(~(reach >= least) | ~(xi2 >= least))) return false;
    const Lanes xi = in.get(kElbow) * take_root(xi2), X = in.get(kFlip) * take_root(X2);
    const Lanes in_plane = 1.0 / (xi2 + d.y * d.y), across = 1.0 / (X2 + d.z * d.z);
    second = {(xi * X + d.y * L.y) * in_plane, (xi * L.y - d.y * X) * in_plane};
    first = {(X * L.x + d.z * L.z) * across, (d.z * L.x - X * L.z) * across};
    third = Turn{};
    slide = xi - d.x;
    tip = {xi, d.y, d.z};
    return true;
  }
  M find_axes() const {
    const Turn a = first, b = second;
    return {{a.c * b.c, b.s, -a.s * b.c}, {-a.c * b.s, b.c, a.s * b.s}, {a.s, Lanes{}, a.c}};
  }
  M find_inverse() const {
    const Lanes k2y = 1.0 / tip.x, k1z = 1.0 / (second.s * tip.y - second.c * tip.x);
    const Lanes k2z = k2y * second.s * tip.z * k1z, no{};
    return {{no, no, k1z},
            {no, k2y, k2z},
            {1.0 + no, tip.y * k2y, tip.y * k2z - second.c * tip.z * k1z}};
  }
  Zero find_elbow() const { return {}; }
  V get_axis() const { return {second.s, second.c, Lanes{}}; }
  static Lanes get_along_axis(V v) { return v.y; }
  Lanes find_first(const Wrench& w) const { return second.s * w.n.x + second.c * w.n.y; }
  static Lanes find_last(const Wrench& w) { return w.f.x; }
  Lanes find_turned(const Moments& of) const {
    const Lanes s = second.s, c = second.c;
    return s * s * of.J.xx + 2.0 * s * c * of.J.xy + c * c * of.J.yy;
  }
  Moments place_rod(const Moments& rod) const {
    const V h = {rod.h.x + rod.m * slide, rod.h.y, rod.h.z};
    Sym J = rod.J;
    const Lanes spread_x = slide * (rod.h.x + h.x);
    J.yy += spread_x;
    J.zz += spread_x;
    J.xy -= slide * h.y;
    J.xz -= slide * h.z;
    return {rod.m, h, J};
  }
  static Wrench carry_last(const Moments& rod) {
    return {{rod.m, Lanes{}, Lanes{}}, {Lanes{}, rod.h.z, -rod.h.y}};
  }
  template <class A, class B>
  Motion<V> move_rod(const Motion<A>& tube, Lanes rate, B acceleration) const {
    const Lanes twice = 2.0 * rate;
    const V slip = {acceleration, twice * tube.w.z, -(twice * tube.w.y)};
    return {slip + tube.a, tube.w, tube.alpha};
  }
};

/// [Y2 (9b)]: seen along z, crank and rod are two links.
struct CrankLeg : Leg {
  bool solve(const Cells& in, V L, Lanes limit, Lanes& reach, Lanes& square) {
    const V d = in.get_vector(kTip);
    l1 = in.get(kCrank);
    height = in.get(kCrank + 1);
    const Lanes h = L.z - height, steep = d.x * d.x + d.z * d.z, X2 = steep - h * h;
    const Lanes flat = L.x * L.x + L.y * L.y, rod = X2 + d.y * d.y;
    const Lanes along = (flat - l1 * l1 - rod) / (2.0 * l1);  // second link along the crank
    const Lanes across2 = rod - along * along;
    const Lanes least = limit * limit;
    if (has_any(~(X2 >= least * steep) | ~(across2 >= least * rod))) return false;
    const Mask steeper = X2 * rod < across2 * steep;
    reach = steeper ? X2 : across2;
    square = steeper ? steep : rod;
    const Lanes X = in.get(kFlip) * take_root(X2), across = in.get(kElbow) * take_root(across2);
    const Lanes in_rod = 1.0 / rod, in_flat = 1.0 / flat, in_steep = 1.0 / steep;
    const Lanes reached = l1 + along;
    first = {(reached * L.x + across * L.y) * in_flat, (reached * L.y - across * L.x) * in_flat};
    second = {(along * X + across * d.y) * in_rod, (across * X - along * d.y) * in_rod};
    third = {(d.x * X + d.z * h) * in_steep, (d.z * X - d.x * h) * in_steep};
    tip = {X, d.y, h};
    return true;
  }
  M find_axes() const {
    const Lanes c = first.c * second.c - first.s * second.s;
    const Lanes s = first.s * second.c + first.c * second.s, no{};
    return {{c, s, no}, {-s, c, no}, {no, no, 1.0 + no}};
  }
  M find_inverse() const {
    const Lanes across = second.s * tip.x + second.c * tip.y, in = 1.0 / (l1 * across);
    const Lanes in_X = 1.0 / tip.x, no{};
    const V turn1 = in * tip, both = (l1 * in) * V{-second.c, second.s, -second.c * tip.z * in_X};
    return {turn1, both - turn1, {no, no, -in_X}};
  }
  V find_elbow() const { return turn_back(second, V{l1, Lanes{}, height}); }
  V get_axis() const { return {Lanes{}, Lanes{}, 1.0 + Lanes{}}; }
  static Lanes get_along_axis(V v) { return v.z; }
  Lanes find_first(const Wrench& w) const {
    return w.n.z + l1 * (second.s * w.f.x + second.c * w.f.y);
  }
  static Lanes find_last(const Wrench& w) { return w.n.y; }
  Lanes find_turned(const Moments& of) const {
    return of.J.zz + 2.0 * l1 * (second.c * of.h.x - second.s * of.h.y);
  }
  Moments place_rod(const Moments& rod) const {
    return {rod.m, roll(third * roll_back(rod.h)), roll(turn(third, roll_back(rod.J)))};
  }
  static Wrench carry_last(const Moments& rod) {
    return {{rod.h.z, Lanes{}, -rod.h.x}, {rod.J.xy, rod.J.yy, rod.J.yz}};
  }
  template <class A, class B>
  Motion<A> move_rod(const Motion<A>& tube, Lanes rate, B acceleration) const {
    const V w = tube.w, alpha = tube.alpha;
    return {tube.a,
            {w.x, w.y + rate, w.z},
            {alpha.x - rate * w.z, alpha.y + acceleration, alpha.z + rate * w.x}};
  }
};

/// The rod turns in the plane of x and z of the tube's second joint: tip (0, l2 cos, l2 sin).
struct SquareCrankLeg : Leg {
  bool solve(const Cells& in, V L, Lanes limit, Lanes& reach, Lanes& square) {
    const Lanes l2 = in.get(kTip + 1);
    l1 = in.get(kCrank);
    height = in.get(kCrank + 1);
    const Lanes h = L.x - height, flat = L.y * L.y + L.z * L.z;
    const Lanes along = (flat + h * h - l1 * l1 - l2 * l2) / (2.0 * l1);  // rod along the crank
    const Lanes y2 = along * along + h * h;
    square = l2 * l2;
    const Lanes z2 = square - y2;
    reach = y2 < z2 ? y2 : z2;
    const Lanes least = limit * limit * square;
    if (has_any(~(reach >= least) | ~(y2 >= least))) return false;
    const Lanes y = in.get(kFlip) * take_root(y2), z = in.get(kElbow) * take_root(z2);
    const Lanes in_y = 1.0 / y, in_flat = 1.0 / flat, in_l2 = 1.0 / l2, reached = l1 + along;
    first = {(reached * L.y + z * L.z) * in_flat, (reached * L.z - z * L.y) * in_flat};
    second = {along * in_y, -h * in_y};
    third = {y * in_l2, z * in_l2};
    tip = {Lanes{}, y, z};
    return true;
  }
  M find_axes() const {
    const Turn a = first, b = second;
    return {{b.c, a.c * b.s, a.s * b.s}, {-b.s, a.c * b.c, a.s * b.c}, {Lanes{}, -a.s, a.c}};
  }
  M find_inverse() const {
    const Lanes in_z = 1.0 / tip.z, in_l1 = 1.0 / l1, in_y = 1.0 / tip.y, no{};
    const V turn1 = {no, tip.y * in_z * in_l1, in_l1};
    const V turn2 = -(second.s * tip.z * in_y) * turn1, turn3 = -second.c * turn1;
    return {turn1, {-in_y, turn2.y, turn2.z}, {no, turn3.y - in_z, turn3.z}};
  }
  V find_elbow() const { return turn_back(second, V{height, l1, Lanes{}}); }
  V get_axis() const { return {second.c, -second.s, Lanes{}}; }
  static Lanes get_along_axis(V v) { return v.x; }
  Lanes find_first(const Wrench& w) const {
    return second.c * w.n.x - second.s * w.n.y + l1 * w.f.z;
  }
  static Lanes find_last(const Wrench& w) { return w.n.x; }
  Lanes find_turned(const Moments& of) const {
    const Lanes s = second.s, c = second.c;
    return c * c * of.J.xx - 2.0 * c * s * of.J.xy + s * s * of.J.yy +
           2.0 * l1 * (c * of.h.y + s * of.h.x);
  }
  Moments place_rod(const Moments& rod) const {
    return {rod.m, roll_back(third * roll(rod.h)), roll_back(turn(third, roll(rod.J)))};
  }
  static Wrench carry_last(const Moments& rod) {
    return {{Lanes{}, -rod.h.z, rod.h.y}, {rod.J.xx, rod.J.xy, rod.J.xz}};
  }
  template <class A, class B>
  Motion<A> move_rod(const Motion<A>& tube, Lanes rate, B acceleration) const {
    const V w = tube.w, alpha = tube.alpha;
    return {tube.a,
            {w.x + rate, w.y, w.z},
            {alpha.x + acceleration, alpha.y + rate * w.z, alpha.z - rate * w.y}};
  }
};

}  // namespace
}  // namespace dockloop::legs
