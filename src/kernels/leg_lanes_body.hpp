// Arithmetic of legs in lanes; see leg_lanes.hpp. Included once per instruction set, with LANES
// (lanes in a register), FUNCTIONS (name of the table) and NAME defined.
//
// Formulas: universal joint about y and z, slide along x, cut at (xi, dy, dz) in rod axes;
// src/kernels/README.md derives them.
#include "math/lane_arithmetic.hpp"

namespace dockloop::legs {
namespace {

using namespace lanes;

template <bool kMoving>
bool calc_group_position(LegGroup& group, int at, const M& R, V p, Lanes limit,
                         double (*sum)[kGroup]) {
  const Cells in{group.parameter, at};
  const Cells work{group.work, at};
  const Cells total{sum, at};
  // Where the tip must be, and the joint angles that bring it there.                 [Y2 (9a)]
  const M K = in.get_matrix(kAxesK);
  const M KC = {turn_back(K, R.x), turn_back(K, R.y), turn_back(K, R.z)};  // C in K
  const V s = in.get_vector(kRing), d0 = in.get_vector(kTip);
  const V L = turn_back(K, p) - in.get_vector(kCentreK) + KC * s;
  const Lanes square = dot(L, L);
  const Lanes xi2 = square - d0.y * d0.y - d0.z * d0.z;
  const Lanes X2 = L.x * L.x + L.z * L.z - d0.z * d0.z;
  const Lanes least = limit * limit * square;
  const Lanes reach = xi2 < X2 ? xi2 : X2;
  if (has_any(~(reach >= least) | ~(xi2 >= least))) return false;  // nor what is not a number
  const Lanes xi = in.get(kElbow) * take_root(xi2), X = in.get(kFlip) * take_root(X2);
  const Lanes in_plane = 1.0 / (xi2 + d0.y * d0.y), across = 1.0 / (X2 + d0.z * d0.z);
  const Lanes c2 = (xi * X + d0.y * L.y) * in_plane, s2 = (xi * L.y - d0.y * X) * in_plane;
  const Lanes c1 = (X * L.x + d0.z * L.z) * across, s1 = (d0.z * L.x - X * L.z) * across;
  const M E = {{c1 * c2, s2, -s1 * c2}, {-c1 * s2, c2, s1 * s2}, {s1, Lanes{}, c1}};  // in K
  const M EC = {turn_back(KC, E.x), turn_back(KC, E.y), turn_back(KC, E.z)};
  const Lanes slide = xi - d0.x;

  // Tube and rod about the centre, E.
  const V h2 = in.get_vector(kTube), h3_0 = in.get_vector(kRod + 1);
  const Lanes m3 = in.get(kRod);
  const V h3 = {h3_0.x + m3 * slide, h3_0.y, h3_0.z};
  Sym J = in.get_symmetric(kTube + 3) + in.get_symmetric(kRod + 4);
  const Lanes spread_x = slide * (h3_0.x + h3.x);
  J.yy += spread_x;
  J.zz += spread_x;
  J.xy -= slide * h3.y;
  J.xz -= slide * h3.z;
  const V h = h2 + h3;

  // Inertia in the joint coordinates, inverse of the loop matrix, apparent inertia at the tip.
  const Lanes A11 = in.get(kCross + 5) + s2 * s2 * J.xx + 2.0 * s2 * c2 * J.xy + c2 * c2 * J.yy;
  const Lanes A12 = s2 * J.xz + c2 * J.yz, A22 = J.zz, A13 = c2 * h3.z, A23 = -h3.y, A33 = m3;
  const Lanes k2 = 1.0 / xi;
  const Lanes k1z = 1.0 / (s2 * d0.y - c2 * xi);
  const Lanes k2z = k2 * s2 * d0.z * k1z;
  const Lanes k3y = d0.y * k2, k3z = d0.y * k2z - c2 * d0.z * k1z;
  const V wy = {A12 * k2 + A13 * k3y, A22 * k2 + A23 * k3y, A23 * k2 + A33 * k3y};
  const V wz = {A11 * k1z + A12 * k2z + A13 * k3z, A12 * k1z + A22 * k2z + A23 * k3z,
                A13 * k1z + A23 * k2z + A33 * k3z};
  const Sym apparent = {A33,
                        k2 * wy.y + k3y * wy.z,
                        k1z * wz.x + k2z * wz.y + k3z * wz.z,
                        wy.z,
                        wz.z,
                        k1z * wy.x + k2z * wy.y + k3z * wy.z};

  work.put(kAxesC, EC);
  work.put(kReach, reach);
  work.put(kReach + 1, square);
  work.put(kFirst, c1);
  work.put(kFirst + 1, s1);
  work.put(kSine, s2);
  work.put(kCosine, c2);
  work.put(kXi, xi);
  work.put(kSlide, slide);
  work.put(kInverse, k1z);
  work.put(kInverse + 1, k2);
  work.put(kInverse + 2, k2z);
  work.put(kInverse + 3, k3y);
  work.put(kInverse + 4, k3z);
  work.put(kMoment, h);
  work.put(kRodMoment, h3);
  work.put(kInertia, J);
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
    // The whole leg as one rigid body, and the momentum that its joints carry.
    const M EP = K * E;
    const V h1 = in.get_vector(kCross + 1);
    const Sym J1 = in.get_symmetric(kCross + 4);
    const V h1E = {c2 * h1.x + s2 * h1.y, c2 * h1.y - s2 * h1.x, h1.z};
    const Lanes cc = c2 * c2, ss = s2 * s2, cs = c2 * s2, between = 2.0 * cs * J1.xy;
    const Sym J1E = {cc * J1.xx + between + ss * J1.yy,
                     ss * J1.xx - between + cc * J1.yy,
                     J1.zz,
                     cs * (J1.yy - J1.xx) + (cc - ss) * J1.xy,
                     c2 * J1.xz + s2 * J1.yz,
                     c2 * J1.yz - s2 * J1.xz};
    const V ht = h + h1E;
    const Sym Jt = J + J1E;
    const V e1 = {s2, c2, Lanes{}};
    const V f1 = cross(e1, ht), n1 = Jt * e1;
    const V f2 = {-h.y, h.x, Lanes{}}, n2 = {J.xz, J.yz, J.zz};
    const V f3 = {m3, Lanes{}, Lanes{}}, n3 = {Lanes{}, h3.z, -h3.y};
    const M linear = {f3, k2 * f2 + k3y * f3, k1z * f1 + k2z * f2 + k3z * f3};
    const M angular = {n3, k2 * n2 + k3y * n3, k1z * n1 + k2z * n2 + k3z * n3};
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
    const Lanes mass = in.get(kCross) + in.get(kTubeMass) + m3;
    const V hP = EP * ht;
    Sym JP = turn(EP, Jt);
    const Lanes trace = 2.0 * dot(centre, hP) + mass * dot(centre, centre);
    const V q = hP + hP + mass * centre;
    JP.xx += trace - centre.x * q.x;
    JP.yy += trace - centre.y * q.y;
    JP.zz += trace - centre.z * q.z;
    JP.xy -= centre.x * hP.y + centre.y * (hP.x + mass * centre.x);
    JP.xz -= centre.x * hP.z + centre.z * (hP.x + mass * centre.x);
    JP.yz -= centre.y * hP.z + centre.z * (hP.y + mass * centre.y);
    total.add(kSumH, hP + mass * centre);
    total.add(kSumJ, JP);
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
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      if (!calc_group_position<kMoving>(groups[g], at, R, p, spread(limit), sum)) return false;
    }
  }
  add_lanes(sum, kSums, sums);
  return true;
}

bool calc_position(LegGroup* groups, int count, const Platform& platform, bool moving, double limit,
                   double* sums) {
  return moving ? calc_all_positions<true>(groups, count, platform, limit, sums)
                : calc_all_positions<false>(groups, count, platform, limit, sums);
}

/// Joint rates per tip velocity, and tip forces per generalised force: the inverse of the loop
/// matrix and its transpose.
struct LegInverse {
  Lanes k1z, k2y, k2z, k3y, k3z;
  explicit LegInverse(const Cells& work)
      : k1z(work.get(kInverse)),
        k2y(work.get(kInverse + 1)),
        k2z(work.get(kInverse + 2)),
        k3y(work.get(kInverse + 3)),
        k3z(work.get(kInverse + 4)) {}
  V find_rates(V y) const {
    return {k1z * y.z, k2y * y.y + k2z * y.z, y.x + k3y * y.y + k3z * y.z};
  }
  V find_tip_force(V joint) const {
    return {joint.z, k2y * joint.y + k3y * joint.z, k1z * joint.x + k2z * joint.y + k3z * joint.z};
  }
};

void calc_rates(LegGroup* groups, int count, const Platform& platform) {
  const V v = spread3(platform.v), w = spread3(platform.w);
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at};
      const Cells work{groups[g].work, at};
      const V tip = v + cross(w, in.get_vector(kRing));
      work.put(kRate, LegInverse(work).find_rates(turn_back(work.get_matrix(kAxesC), tip)));
      work.put(kTipC, cross(w, tip));
    }
  }
}

/// Motion and load of one leg, E; `cross` in axes turned by the first joint only.
struct LegMotion {
  V w0, w1, w2;              ///< angular velocity of P, cross, tube and rod
  V alpha1, alpha2, a, rod;  ///< angular accelerations; of the centre; of the rod along the tube
};
struct LegLoad {
  V force, moment;  ///< that move the leg, moment about the centre
  V joint;          ///< generalised forces of the three joints
};

/// Velocities, and the accelerations that follow from them.
/// @param a  acceleration of the centre, E
LegMotion find_motion(V w0, V alpha0, V a, V rate, Lanes s2, Lanes c2, V acceleration) {
  LegMotion motion;
  const V e1 = {s2, c2, Lanes{}};
  motion.w0 = w0;
  motion.w1 = w0 + rate.x * e1;
  motion.w2 = {motion.w1.x, motion.w1.y, motion.w1.z + rate.y};
  motion.alpha1 = alpha0 + rate.x * cross(w0, e1) + acceleration.x * e1;
  motion.alpha2 = {motion.alpha1.x + motion.w1.y * rate.y, motion.alpha1.y - motion.w1.x * rate.y,
                   motion.alpha1.z + acceleration.y};
  motion.a = a;
  const Lanes twice = 2.0 * rate.z;
  motion.rod = {acceleration.z, twice * motion.w2.z, -(twice * motion.w2.y)};
  return motion;
}

LegLoad find_load(const Cells& in, const Cells& work, const LegMotion& at) {
  const Lanes s2 = work.get(kSine), c2 = work.get(kCosine), m3 = in.get(kRod);
  const V h = work.get_vector(kMoment), h3 = work.get_vector(kRodMoment);
  const Sym J = work.get_symmetric(kInertia);
  const auto turn_up = [&](V v) { return V{c2 * v.x - s2 * v.y, s2 * v.x + c2 * v.y, v.z}; };
  const auto turn_down = [&](V v) { return V{c2 * v.x + s2 * v.y, c2 * v.y - s2 * v.x, v.z}; };
  const V wh3 = cross(at.w2, h3);
  const Lanes axial = m3 * (at.a.x + at.rod.x) + at.alpha2.y * h3.z - at.alpha2.z * h3.y +
                      at.w2.y * wh3.z - at.w2.z * wh3.y;
  const V force = (in.get(kTubeMass) + m3) * at.a + cross(at.alpha2, h) +
                  cross(at.w2, cross(at.w2, h)) + m3 * at.rod;
  const V moment = J * at.alpha2 + cross(at.w2, J * at.w2) + cross(h, at.a) + cross(h3, at.rod);
  const V w = turn_up(at.w1), alpha = turn_up(at.alpha1), a = turn_up(at.a);
  const V h1 = in.get_vector(kCross + 1);
  const Sym J1 = in.get_symmetric(kCross + 4);
  const V force1 = in.get(kCross) * a + cross(alpha, h1) + cross(w, cross(w, h1));
  const V moment1 = J1 * alpha + cross(w, J1 * w) + cross(h1, a);
  return {force + turn_down(force1),
          moment + turn_down(moment1),
          {s2 * moment.x + c2 * moment.y + moment1.y, moment.z, axial}};
}

template <bool kMoving>
void calc_all_biases(LegGroup* groups, int count, const Platform& platform, double* sums) {
  constexpr int kSums = kMoving ? kBiasSums : kFixedBiasSums;
  alignas(64) double sum[kSums][kGroup] = {};
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at};
      const Cells work{groups[g].work, at};
      const Cells total{sum, at};
      const Lanes s2 = work.get(kSine), c2 = work.get(kCosine);
      const V rate = work.get_vector(kRate);
      const V d0 = in.get_vector(kTip), d = {work.get(kXi), d0.y, d0.z};
      const M EC = work.get_matrix(kAxesC);
      // Motion relative to P at zero joint accelerations.
      const V w = {s2 * rate.x, c2 * rate.x, rate.y};
      const Lanes both = rate.x * rate.y, twice = 2.0 * rate.z;
      const V alpha = {c2 * both, -s2 * both, Lanes{}};
      const V slip = {Lanes{}, twice * w.z, -(twice * w.y)};
      const V free =
          turn_back(EC, work.get_vector(kTipC)) - (cross(alpha, d) + cross(w, cross(w, d)) + slip);
      work.put(kTipFree, free);
      LegLoad load;
      if constexpr (kMoving) {
        const V root = spread3(platform.root);
        const M EP = work.get_matrix(kAxesP);
        const V swing = cross(root, cross(root, in.get_vector(kCentre)));
        load = find_load(
            in, work,
            find_motion(turn_back(EP, root), V{}, turn_back(EP, swing), rate, s2, c2, V{}));
      } else {  // the same where P is at rest
        const V h3 = work.get_vector(kRodMoment), wh3 = cross(w, h3);
        const Sym J = work.get_symmetric(kInertia);
        const V moment = J * alpha + cross(w, J * w) + cross(h3, slip);
        load.joint = {s2 * moment.x + c2 * moment.y, moment.z,
                      alpha.y * h3.z - alpha.z * h3.y + w.y * wh3.z - w.z * wh3.y};
      }
      const LegInverse inverse(work);
      const V b = work.get_symmetric(kApparent) * free +
                  inverse.find_tip_force(load.joint - work.get_vector(kForce));
      const V bC = EC * b;
      total.add(kSumTipForce, bC);
      total.add(kSumTipMoment, cross(in.get_vector(kRing), bC));
      if constexpr (kMoving) {
        const M EP = work.get_matrix(kAxesP);
        const V fP = EP * (load.force + work.get_matrix(kCarried) * free);
        const V nP = EP * (load.moment + work.get_matrix(kCarried + 9) * free);
        total.add(kSumRootForce, fP);
        total.add(kSumRootMoment, nP + cross(in.get_vector(kCentre), fP));
      }
    }
  }
  add_lanes(sum, kSums, sums);
}

void calc_bias(LegGroup* groups, int count, const Platform& platform, bool moving, double* sums) {
  if (moving) return calc_all_biases<true>(groups, count, platform, sums);
  calc_all_biases<false>(groups, count, platform, sums);
}

/// Inverse dynamics of the legs: cut forces, and what moves the legs.
void calc_loads(LegGroup* groups, int count, const Platform& platform, const Accelerations& given,
                double* sums) {
  alignas(64) double sum[kLoadSums][kGroup] = {};
  const M R = {spread3(platform.R), spread3(platform.R + 3), spread3(platform.R + 6)};
  const V root = spread3(platform.root), alpha0 = spread3(given.alpha);
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at};
      const Cells work{groups[g].work, at};
      const Cells total{sum, at};
      const M EC = work.get_matrix(kAxesC), EP = R * EC;
      const V centre = in.get_vector(kCentre);
      const V tip = spread3(given.v) + cross(spread3(given.w), in.get_vector(kRing));
      const LegInverse inverse(work);
      const V joint = inverse.find_rates(turn_back(EC, tip) + work.get_vector(kTipFree));
      const V a = spread3(given.a) + cross(alpha0, centre) + cross(root, cross(root, centre));
      const LegLoad load =
          find_load(in, work,
                    find_motion(turn_back(EP, root), turn_back(EP, alpha0), turn_back(EP, a),
                                work.get_vector(kRate), work.get(kSine), work.get(kCosine), joint));
      work.put(kCut, EP * inverse.find_tip_force(load.joint - work.get_vector(kForce)));
      const V force = EP * load.force;
      total.add(kSumLoad, force);
      total.add(kSumLoadMoment, EP * load.moment + cross(centre, force));
    }
  }
  add_lanes(sum, kLoadSums, sums);
}

}  // namespace

const LegFunctions FUNCTIONS = {calc_position, calc_rates, calc_bias, calc_loads, NAME};

}  // namespace dockloop::legs
