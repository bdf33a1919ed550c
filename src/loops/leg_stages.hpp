// What one leg adds to its platform, stage by stage, for any number and any kind of leg: the whole
// leg condensed to its tip.
//
// Every stage is a template, so that one formula serves single legs, dual numbers and SIMD lanes:
//   In       reads the constants of a leg (rows `Parameter` of leg_rows.hpp)
//   Out      reads and writes what stages leave for later ones (rows `Work`)
//   Total    adds to the sums over all legs of the platform (`PositionSum`, `BiasSum`, `LoadSum`)
//   N        the number of the constants, In::Number
//   P        the number of what moves, Out::Number: one leg, or one leg per SIMD lane
//   kMoving  the root body R moves: sums about R are needed too
// LEGS.md lists the formulas.
#pragma once

#include "loops/leg_formulas.hpp"

namespace dockloop::legs {
namespace {

template <class In, class N = typename In::Number>
Shape<N> get_shape(const In& in) {
  return {in.get_vector(kTip), in.get(kCrank), in.get(kCrank + 1), in.get(kElbow), in.get(kFlip)};
}

/// Loop, inertia at the tip, and what a leg adds to the sums. @param R, p  pose of C in R
template <bool kMoving, class AnyLeg, class P, class In, class Out, class Total>
Reached calc_leg_position(AnyLeg leg, const In& in, const Out& work, const Total& total,
                          const Matrix<P>& R, const Vector<P>& p, double least) {
  using N = typename In::Number;
  // Where the tip must be, and the joint coordinates that bring it there.        [Y2 (9a), (9b)]
  const Matrix<N> K = in.get_matrix(kAxesK);
  const Matrix<P> KC = {turn_back(K, R.x), turn_back(K, R.y), turn_back(K, R.z)};  // C in K
  const Vector<N> s = in.get_vector(kRing);
  const Vector<P> L = turn_back(K, p) - in.get_vector(kCentreK) + KC * s;
  const Reached reached = leg.solve(get_shape(in), L, least);
  if (reached != Reached::kYes) return reached;
  const auto E = leg.find_axes();
  const Matrix<P> EC = {turn_back(KC, E.x), turn_back(KC, E.y), turn_back(KC, E.z)};

  // Inertia in the joint coordinates, inverse of the loop matrix, apparent inertia at the tip.
  const auto rod = leg.place_rod(leg.get_outer(in, kRod));
  const auto outer = leg.get_outer(in, kTube) + rod;
  const auto second =
      Wrench{Vector{-outer.h.y, outer.h.x, Zero()}, Vector{outer.J.xz, outer.J.yz, outer.J.zz}};
  const auto spin = leg.get_spin(in);
  const auto last = add_spin(leg.carry_last(rod), spin);  // momentum per joint rate
  const auto inertia = Symmetric{in.get(kTurned) + leg.find_turned(outer),
                                 outer.J.zz,
                                 leg.find_last(last) + get_inertia(spin),
                                 leg.find_first(second),
                                 leg.find_first(last),
                                 last.n.z};
  const auto inverse = leg.find_inverse();
  const auto per_tip = transpose(inverse);
  const auto x = inverse * (inertia * per_tip.x);
  const auto y = inverse * (inertia * per_tip.y);
  const auto z = inverse * (inertia * per_tip.z);
  const auto apparent = Symmetric{x.x, y.y, z.z, x.y, x.z, y.z};

  leg.write(work);
  work.put(kInverse, inverse);
  work.put(kAxesC, EC);
  work.put(kRodMoment, rod.h);
  work.put(kRodInertia, rod.J);
  work.put(kApparent, apparent);

  const Symmetric<P> A = turn(EC, apparent);
  const Matrix<P> columns = {{A.xx, A.xy, A.xz}, {A.xy, A.yy, A.yz}, {A.xz, A.yz, A.zz}};
  const Matrix<P> moments = cross(s, columns);
  const Matrix<P> rows = transpose(moments);
  const Vector<P> Dx = cross(s, rows.x), Dy = cross(s, rows.y), Dz = cross(s, rows.z);
  total.add(kSumA, A);
  total.add(kSumK, moments);
  total.add(kSumD, Symmetric<P>{Dx.x, Dy.y, Dz.z, Dx.y, Dx.z, Dy.z});
  if constexpr (kMoving) {
    // The whole leg as one rigid body about the centre, and the momentum that its joints carry.
    const Matrix<P> ER = fill<P>(K * E);
    const auto elbow = leg.find_elbow();
    const auto whole = shift(outer, elbow) + turn_back(leg.second, leg.get_cross(in));
    const auto axis = leg.get_axis();
    const auto linear = Columns{cross(axis, whole.h), second.f, last.f} * per_tip;
    const auto angular =
        Columns{whole.J * axis, second.n + cross(elbow, second.f), last.n + cross(elbow, last.f)} *
        per_tip;
    work.put(kAxesR, ER);
    work.put(kCarried, linear);
    work.put(kCarried + 9, angular);
    const Vector<N> centre = in.get_vector(kCentre);
    const Matrix<P> lE = ER * linear;
    const Matrix<P> aE0 = ER * angular, shifted = cross(centre, lE);
    const Matrix<P> aE = {aE0.x + shifted.x, aE0.y + shifted.y, aE0.z + shifted.z};
    // Rows of (ER linear) EC^T, and what a turn of C about its origin moves at the tip.
    const Matrix<P> CE = transpose(EC);
    const Matrix<P> lV = transpose(lE * CE), aV = transpose(aE * CE);  // columns are rows
    total.add(kSumLV, lV);
    total.add(kSumLW, cross(s, lV));
    total.add(kSumAV, aV);
    total.add(kSumAW, cross(s, aV));
    const auto about_R = shift(Moments{whole.m, ER * whole.h, turn(ER, whole.J)}, centre);
    total.add(kSumH, about_R.h);
    total.add(kSumJ, about_R.J);
  }
  return reached;
}

/// Rates of the joints.
template <class P, class In, class Out, class S>
void calc_leg_rates(const In& in, const Out& work, const PlatformMotion<S>& at) {
  const Vector<P> v = spread3<P>(at.v), w = spread3<P>(at.w);
  const Vector<P> tip = v + cross(w, in.get_vector(kRing));
  const Vector<P> y = turn_back(work.get_matrix(kAxesC), tip);
  work.put(kRate, turn_back(work.get_matrix(kInverse), y));
}

/// Forces that move a leg.
template <class P>
struct LegLoad {
  Wrench<Vector<P>> whole;  ///< about the centre, E
  Vector<P> joint;          ///< generalised forces of the three joints
};

/// Of tube and rod; about the elbow. @param rate, acceleration  of the last joint
template <class AnyLeg, class In, class Out, class AnyMotion, class P, class A>
LegLoad<P> find_outer_load(const AnyLeg& leg, const In& in, const Out& work, const AnyMotion& at,
                           const P& rate, const A& acceleration) {
  decltype(leg.place_rod(leg.get_outer(in, kRod))) rod;
  rod.m = in.get(kRod);
  work.read(kRodMoment, rod.h);
  work.read(kRodInertia, rod.J);
  const auto of_rod = find_load(rod, at.rod);
  const auto spin = leg.get_spin(in);
  const auto all = find_load(leg.get_outer(in, kTube), at.tube) + of_rod +
                   find_spin_load(spin, at.tube.w, rate, acceleration);
  return {{fill<P>(all.f), fill<P>(all.n)},
          {Number<P>::of(leg.find_first(all)), Number<P>::of(all.n.z),
           leg.find_last(of_rod) + find_spin_force(spin, at.tube.alpha.x, acceleration)}};
}

template <class AnyLeg, class In, class Out, class AnyMotion, class P, class A>
LegLoad<P> find_leg_load(const AnyLeg& leg, const In& in, const Out& work, const AnyMotion& at,
                         const P& rate, const A& acceleration) {
  const LegLoad<P> outer = find_outer_load(leg, in, work, at, rate, acceleration);
  const Turn<P>& turn1 = leg.second;  // from E to axes turned by the first joint only
  const auto cross_at = Motion{turn1 * at.cross.a, turn1 * at.cross.w, turn1 * at.cross.alpha};
  const auto of_cross = find_load(leg.get_cross(in), cross_at);
  return {{outer.whole.f + turn_back(turn1, of_cross.f),
           outer.whole.n + cross(leg.find_elbow(), outer.whole.f) + turn_back(turn1, of_cross.n)},
          {outer.joint.x + leg.get_along_axis(of_cross.n), outer.joint.y, outer.joint.z}};
}

/// Load at zero joint accelerations: at the tip and, of the whole leg, at the root.
/// @pre calc_leg_position, calc_leg_rates, kForce
template <bool kMoving, class AnyLeg, class In, class Out, class Total, class S>
void calc_leg_bias(AnyLeg leg, const In& in, const Out& work, const Total& total,
                   const PlatformMotion<S>& at) {
  using P = typename Out::Number;
  leg.read(in, work);
  const Vector<P> rate = work.get_vector(kRate), w = spread3<P>(at.w);
  const auto s = in.get_vector(kRing);
  const Matrix<P> EC = work.get_matrix(kAxesC);
  // Motion relative to R at zero joint accelerations.
  const auto relative = find_motion(leg, Zero(), Zero(), Zero(), rate, NoAcceleration());
  const Vector<P> tip = spread3<P>(at.a) + cross(spread3<P>(at.alpha), s) + cross(w, cross(w, s));
  const Vector<P> free =
      turn_back(EC, tip) - (cross(relative.rod.alpha, leg.tip) +
                            cross(relative.rod.w, cross(relative.rod.w, leg.tip)) + relative.rod.a);
  work.put(kTipFree, free);
  LegLoad<P> load;
  if constexpr (kMoving) {
    const Vector<P> root = spread3<P>(at.root);
    const Matrix<P> ER = work.get_matrix(kAxesR);
    const Vector<P> swing = cross(root, cross(root, in.get_vector(kCentre)));
    load = find_leg_load(
        leg, in, work,
        find_motion(leg, turn_back(ER, root), Zero(), turn_back(ER, swing), rate, NoAcceleration()),
        rate.z, Zero());
  } else {  // the cross turns about an axis at rest
    load = find_outer_load(leg, in, work, relative, rate.z, Zero());
  }
  decltype(leg.find_inverse()) inverse;
  work.read(kInverse, inverse);
  const Vector<P> b =
      work.get_symmetric(kApparent) * free + inverse * (load.joint - work.get_vector(kForce));
  const Vector<P> bC = EC * b;
  total.add(kSumTipForce, bC);
  total.add(kSumTipMoment, cross(s, bC));
  if constexpr (kMoving) {
    const Matrix<P> ER = work.get_matrix(kAxesR);
    const Vector<P> fR = ER * (load.whole.f + work.get_matrix(kCarried) * free);
    const Vector<P> nR = ER * (load.whole.n + work.get_matrix(kCarried + 9) * free);
    total.add(kSumRootForce, fR);
    total.add(kSumRootMoment, nR + cross(in.get_vector(kCentre), fR));
  }
}

/// Inverse dynamics: accelerations of the joints, force of the cut, and what moves the leg.
/// @pre calc_leg_bias
template <class AnyLeg, class In, class Out, class Total, class S>
void calc_leg_loads(AnyLeg leg, const In& in, const Out& work, const Total& total,
                    const PlatformMotion<S>& at) {
  using P = typename Out::Number;
  leg.read(in, work);
  const Vector<P> root = spread3<P>(at.root), alpha0 = spread3<P>(at.root_alpha);
  const Matrix<P> EC = work.get_matrix(kAxesC), ER = spread9<P>(at.R) * EC;
  const auto centre = in.get_vector(kCentre);
  const Vector<P> tip = spread3<P>(at.dot_v) + cross(spread3<P>(at.dot_w), in.get_vector(kRing));
  const Matrix<P> inverse = work.get_matrix(kInverse);
  const Vector<P> joint = turn_back(inverse, turn_back(EC, tip) + work.get_vector(kTipFree));
  work.put(kJoint, joint);
  const Vector<P> a =
      spread3<P>(at.root_a) + cross(alpha0, centre) + cross(root, cross(root, centre));
  const Vector<P> rate = work.get_vector(kRate);
  const auto motion =
      find_motion(leg, turn_back(ER, root), turn_back(ER, alpha0), turn_back(ER, a), rate, joint);
  work.put(kAlong, motion.tube.alpha.x);
  const LegLoad<P> load = find_leg_load(leg, in, work, motion, rate.z, joint.z);
  work.put(kCut, ER * (inverse * (load.joint - work.get_vector(kForce))));
  const Vector<P> force = ER * load.whole.f;
  total.add(kSumLoad, force);
  total.add(kSumLoadMoment, ER * load.whole.n + cross(centre, force));
}

/// Call work(leg) with a leg of this kind; an axial one may be any slide leg.
template <class N, class P, class Call>
auto visit_kind(LegType type, const Call& call) {
  if (type == kCrankLeg) return call(CrankLeg<N, P>());
  if (type == kSquareCrankLeg) return call(SquareCrankLeg<N, P>());
  return call(SlideLeg<N, P, N>());
}

/// The same with what is zero for an axial one.
template <class N, class P, class Call>
auto visit_leg(LegType type, const Call& call) {
  if (type == kAxialSlideLeg) return call(SlideLeg<N, P, Zero>());
  return visit_kind<N, P>(type, call);
}

}  // namespace
}  // namespace dockloop::legs
