// Arithmetic of legs in lanes; see leg_lanes.hpp. Included once per instruction set, with LANES
// (lanes in a register), FUNCTIONS (name of the table) and NAME defined.
//
// Formulas: src/loops/LEGS.md derives them; what each kind of leg does its own way is in
// leg_types.hpp. Stages are flattened: vectors that pass through memory on calls cost a tenth.
#include "loops/leg_types.hpp"
#include "math/lane_arithmetic.hpp"

namespace dockloop::legs {
namespace {

/// Call work(leg, in, work, at) for the legs of all registers, with a leg of their kind.
/// @return false as soon as a call does
template <class Work>
bool visit_legs(LegGroup* groups, int count, const Work& work) {
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at}, cells{groups[g].work, at};
      bool fine = true;
      switch (groups[g].type) {
        case kSlideLeg:
          fine = work(SlideLeg(), in, cells, at);
          break;
        case kCrankLeg:
          fine = work(CrankLeg(), in, cells, at);
          break;
        case kSquareCrankLeg:
          fine = work(SquareCrankLeg(), in, cells, at);
          break;
      }
      if (!fine) return false;
    }
  }
  return true;
}

/// Loop, inertia at the tip, and what a leg adds to the sums. @param R, p  pose of C in P
/// @return false if the leg does not reach its tip or is too close to singular
template <bool kMoving, class AnyLeg>
bool calc_leg_position(AnyLeg leg, const Cells& in, const Cells& work, const Cells& total,
                       const M& R, V p, Lanes limit) {
  // Where the tip must be, and the joint coordinates that bring it there.        [Y2 (9a), (9b)]
  const M K = in.get_matrix(kAxesK);
  const M KC = {turn_back(K, R.x), turn_back(K, R.y), turn_back(K, R.z)};  // C in K
  const V s = in.get_vector(kRing);
  const V L = turn_back(K, p) - in.get_vector(kCentreK) + KC * s;
  Lanes reach, square;
  if (!leg.solve(in, L, limit, reach, square)) return false;
  const M E = leg.find_axes();
  const M EC = {turn_back(KC, E.x), turn_back(KC, E.y), turn_back(KC, E.z)};

  // Inertia in the joint coordinates, inverse of the loop matrix, apparent inertia at the tip.
  const Moments rod = leg.place_rod(get_moments(in, kRod)), outer = get_moments(in, kTube) + rod;
  const Wrench second = {{-outer.h.y, outer.h.x, Lanes{}}, {outer.J.xz, outer.J.yz, outer.J.zz}};
  const Wrench last = leg.carry_last(rod);  // momentum per joint rate
  const Sym inertia = {in.get(kTurned) + leg.find_turned(outer),
                       outer.J.zz,
                       leg.find_last(last),
                       leg.find_first(second),
                       leg.find_first(last),
                       last.n.z};
  const M inverse = leg.find_inverse();
  const M per_tip = transpose(inverse);
  const V x = inverse * (inertia * per_tip.x);
  const V y = inverse * (inertia * per_tip.y);
  const V z = inverse * (inertia * per_tip.z);
  const Sym apparent = {x.x, y.y, z.z, x.y, x.z, y.z};

  leg.write(work);
  work.put(kInverse, inverse);
  work.put(kAxesC, EC);
  work.put(kReach, reach);
  work.put(kReach + 1, square);
  work.put(kRodMoment, rod.h);
  work.put(kRodInertia, rod.J);
  work.put(kApparent, apparent);

  const Sym A = turn(EC, apparent);
  const M columns = {{A.xx, A.xy, A.xz}, {A.xy, A.yy, A.yz}, {A.xz, A.yz, A.zz}};
  const M K_ = {cross(s, columns.x), cross(s, columns.y), cross(s, columns.z)};
  const M rows = transpose(K_);
  const V Dx = cross(s, rows.x), Dy = cross(s, rows.y), Dz = cross(s, rows.z);
  total.add(kSumA, A);
  total.add(kSumK, K_);
  total.add(kSumD, Sym{Dx.x, Dy.y, Dz.z, Dx.y, Dx.z, Dy.z});
  if constexpr (kMoving) {
    // The whole leg as one rigid body about the centre, and the momentum that its joints carry.
    const M EP = K * E;
    const auto elbow = leg.find_elbow();
    const Moments cross0 = get_moments(in, kCross);
    const Moments crossE = {cross0.m, turn_back(leg.second, cross0.h),
                            turn(reverse(leg.second), cross0.J)};
    const Moments whole = shift(outer, elbow) + crossE;
    const V axis = leg.get_axis();
    const M linear = M{cross(axis, whole.h), second.f, last.f} * per_tip;
    const M angular =
        M{whole.J * axis, second.n + cross(elbow, second.f), last.n + cross(elbow, last.f)} *
        per_tip;
    work.put(kAxesP, EP);
    work.put(kCarried, linear);
    work.put(kCarried + 9, angular);
    const V centre = in.get_vector(kCentre);
    const M lE = EP * linear;
    const M aE0 = EP * angular;
    const M aE = {aE0.x + cross(centre, lE.x), aE0.y + cross(centre, lE.y),
                  aE0.z + cross(centre, lE.z)};
    // Rows of (EP linear) EC^T, and what a turn of C about its origin moves at the tip.
    const M CE = transpose(EC);
    const M lV = transpose(lE * CE), aV = transpose(aE * CE);  // columns are rows of the product
    total.add(kSumLV, lV);
    total.add(kSumLW, M{cross(s, lV.x), cross(s, lV.y), cross(s, lV.z)});
    total.add(kSumAV, aV);
    total.add(kSumAW, M{cross(s, aV.x), cross(s, aV.y), cross(s, aV.z)});
    const Moments about_P = shift({whole.m, EP * whole.h, turn(EP, whole.J)}, centre);
    total.add(kSumH, about_P.h);
    total.add(kSumJ, about_P.J);
  }
  return true;
}

template <bool kMoving>
bool calc_all_positions(LegGroup* groups, int count, const Platform& platform, double limit,
                        double* sums) {
  constexpr int kSums = kMoving ? kPositionSums : kFixedSums;
  alignas(64) double sum[kSums][kGroup] = {};
  const M R = {spread3(platform.R), spread3(platform.R + 3), spread3(platform.R + 6)};
  const V p = spread3(platform.p);
  const Lanes least = spread(limit);
  const bool fine =
      visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
        return calc_leg_position<kMoving>(leg, in, work, Cells{sum, at}, R, p, least);
      });
  if (fine) add_lanes(sum, kSums, sums);
  return fine;
}

[[gnu::flatten]] bool calc_position(LegGroup* groups, int count, const Platform& platform,
                                    bool moving, double limit, double* sums) {
  return moving ? calc_all_positions<true>(groups, count, platform, limit, sums)
                : calc_all_positions<false>(groups, count, platform, limit, sums);
}

void calc_angles(LegGroup* groups, int count, int joint) {
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells work{groups[g].work, at};
      work.put(kAngles + joint, find_angle(work.get_turn(kTurns + 2 * joint)));
    }
  }
}

void calc_rates(LegGroup* groups, int count, const Platform& platform) {
  const V v = spread3(platform.v), w = spread3(platform.w);
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at}, work{groups[g].work, at};
      const V tip = v + cross(w, in.get_vector(kRing));
      const V y = turn_back(work.get_matrix(kAxesC), tip);
      work.put(kRate, turn_back(work.get_matrix(kInverse), y));
      work.put(kTipC, cross(w, tip));
    }
  }
}

template <class A, class B, class C>
struct LegMotion {
  Motion<A> cross;
  Motion<B> tube;
  Motion<C> rod;
};

/// Velocities, and the accelerations that follow from them.
/// @param w, alpha      of P, E
/// @param a             acceleration of the centre, E
/// @param rate          of the joints
/// @param acceleration  of the joints, or Zero
template <class AnyLeg, class W, class Alpha, class A, class Acceleration>
auto find_motion(const AnyLeg& leg, W w, Alpha alpha, A a, V rate, Acceleration acceleration) {
  const V axis = leg.get_axis();
  const V w1 = w + rate.x * axis, w2 = {w1.x, w1.y, w1.z + rate.y};
  const auto alpha1 = alpha + rate.x * cross(w, axis) + acceleration.x * axis;
  const V alpha2 = V{w1.y * rate.y, -(w1.x * rate.y), acceleration.y} + alpha1;
  const auto arm = leg.find_elbow();
  const auto elbow = a + (cross(alpha1, arm) + cross(w1, cross(w1, arm)));
  const Motion<decltype(a + Zero())> of_cross{a, w1, alpha1};
  const Motion<decltype(elbow + Zero())> tube{elbow, w2, alpha2};
  const auto rod = leg.move_rod(tube, rate.z, acceleration.z);
  return LegMotion<A, decltype(elbow + Zero()), decltype(rod.a + Zero())>{of_cross, tube, rod};
}

/// Joint accelerations that are zero.
struct NoAcceleration {
  Zero x, y, z;
};

/// Forces that move a leg.
struct LegLoad {
  Wrench whole;  ///< about the centre, E
  V joint;       ///< generalised forces of the three joints
};

/// Of tube and rod; about the elbow.
template <class AnyLeg, class AnyMotion>
LegLoad find_outer_load(const AnyLeg& leg, const Cells& in, const Cells& work,
                        const AnyMotion& at) {
  const Wrench rod = find_load(
      {in.get(kRod), work.get_vector(kRodMoment), work.get_symmetric(kRodInertia)}, at.rod);
  const Wrench both = find_load(get_moments(in, kTube), at.tube) + rod;
  return {both, {leg.find_first(both), both.n.z, leg.find_last(rod)}};
}

template <class AnyLeg, class AnyMotion>
LegLoad find_leg_load(const AnyLeg& leg, const Cells& in, const Cells& work, const AnyMotion& at) {
  const LegLoad outer = find_outer_load(leg, in, work, at);
  const Turn turn1 = leg.second;  // from E to axes turned by the first joint only
  const Motion<V> cross_at = {turn1 * at.cross.a, turn1 * at.cross.w, turn1 * at.cross.alpha};
  const Wrench of_cross = find_load(get_moments(in, kCross), cross_at);
  return {{outer.whole.f + turn_back(turn1, of_cross.f),
           outer.whole.n + cross(leg.find_elbow(), outer.whole.f) + turn_back(turn1, of_cross.n)},
          {outer.joint.x + leg.get_along_axis(of_cross.n), outer.joint.y, outer.joint.z}};
}

template <bool kMoving>
void calc_all_biases(LegGroup* groups, int count, const Platform& platform, double* sums) {
  constexpr int kSums = kMoving ? kBiasSums : kFixedBiasSums;
  alignas(64) double sum[kSums][kGroup] = {};
  visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
    leg.read(in, work);
    const Cells total{sum, at};
    const V rate = work.get_vector(kRate);
    const M EC = work.get_matrix(kAxesC);
    // Motion relative to P at zero joint accelerations.
    const auto relative = find_motion(leg, Zero(), Zero(), Zero(), rate, NoAcceleration());
    const V free = turn_back(EC, work.get_vector(kTipC)) -
                   (cross(relative.rod.alpha, leg.tip) +
                    cross(relative.rod.w, cross(relative.rod.w, leg.tip)) + relative.rod.a);
    work.put(kTipFree, free);
    LegLoad load;
    if constexpr (kMoving) {
      const V root = spread3(platform.root);
      const M EP = work.get_matrix(kAxesP);
      const V swing = cross(root, cross(root, in.get_vector(kCentre)));
      load = find_leg_load(leg, in, work,
                           find_motion(leg, turn_back(EP, root), Zero(), turn_back(EP, swing), rate,
                                       NoAcceleration()));
    } else {  // the cross turns about an axis at rest
      load = find_outer_load(leg, in, work, relative);
    }
    const V b = work.get_symmetric(kApparent) * free +
                work.get_matrix(kInverse) * (load.joint - work.get_vector(kForce));
    const V bC = EC * b;
    total.add(kSumTipForce, bC);
    total.add(kSumTipMoment, cross(in.get_vector(kRing), bC));
    if constexpr (kMoving) {
      const M EP = work.get_matrix(kAxesP);
      const V fP = EP * (load.whole.f + work.get_matrix(kCarried) * free);
      const V nP = EP * (load.whole.n + work.get_matrix(kCarried + 9) * free);
      total.add(kSumRootForce, fP);
      total.add(kSumRootMoment, nP + cross(in.get_vector(kCentre), fP));
    }
    return true;
  });
  add_lanes(sum, kSums, sums);
}

[[gnu::flatten]] void calc_bias(LegGroup* groups, int count, const Platform& platform, bool moving,
                                double* sums) {
  if (moving) return calc_all_biases<true>(groups, count, platform, sums);
  calc_all_biases<false>(groups, count, platform, sums);
}

/// Inverse dynamics of the legs: cut forces, and what moves the legs.
[[gnu::flatten]] void calc_loads(LegGroup* groups, int count, const Platform& platform,
                                 const Accelerations& given, double* sums) {
  alignas(64) double sum[kLoadSums][kGroup] = {};
  const M R = {spread3(platform.R), spread3(platform.R + 3), spread3(platform.R + 6)};
  const V root = spread3(platform.root), alpha0 = spread3(given.alpha);
  visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
    leg.read(in, work);
    const Cells total{sum, at};
    const M EC = work.get_matrix(kAxesC), EP = R * EC;
    const V centre = in.get_vector(kCentre);
    const V tip = spread3(given.v) + cross(spread3(given.w), in.get_vector(kRing));
    const M inverse = work.get_matrix(kInverse);
    const V joint = turn_back(inverse, turn_back(EC, tip) + work.get_vector(kTipFree));
    const V a = spread3(given.a) + cross(alpha0, centre) + cross(root, cross(root, centre));
    const LegLoad load =
        find_leg_load(leg, in, work,
                      find_motion(leg, turn_back(EP, root), turn_back(EP, alpha0), turn_back(EP, a),
                                  work.get_vector(kRate), joint));
    work.put(kCut, EP * (inverse * (load.joint - work.get_vector(kForce))));
    const V force = EP * load.whole.f;
    total.add(kSumLoad, force);
    total.add(kSumLoadMoment, EP * load.whole.n + cross(centre, force));
    return true;
  });
  add_lanes(sum, kLoadSums, sums);
}

}  // namespace

const LegFunctions FUNCTIONS = {calc_position, calc_angles, calc_rates,
                                calc_bias,     calc_loads,  NAME};

}  // namespace dockloop::legs
