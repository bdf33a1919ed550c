// Legs side by side: one leg per lane of a vector register, eight to a group.
//
// Plain arrays and functions, so that the same source (leg_lanes_body.hpp) can be compiled for
// several instruction sets without any of it reaching code that runs without a test of the
// processor.
// Operations are those of IEEE 754, one by one and in one order: results do not depend on the
// instruction set, to the last bit.
//
// Three kinds of legs; a group holds one of them. All have three bodies, here named as those of a
// slide leg: cross (the crank), tube and rod. Their second joint turns about z, and its centre is
// the elbow.
//
// Axes: P of the body on which the legs hang, C of the body they hold, K canonical axes of a leg at
// the centre of its first joint, E those of its tube. y = velocity or acceleration of the tip
// relative to P.
#pragma once

#include "math/lanes.hpp"

namespace dockloop::legs {

/// By their joints, K; in the order of LegKind.
enum LegType {
  kSlideLeg,       ///< turns about y and z, slide along x; the elbow is the centre
  kCrankLeg,       ///< turns about z, z, y; elbow (l1, 0, height)
  kSquareCrankLeg  ///< turns about x, z, x; elbow (height, l1, 0), tip (0, l2, 0)
};

/// Rows of LegGroup::parameter. Unused lanes repeat a leg without mass.
enum Parameter {
  kAxesK = 0,              ///< R_PK by columns (9)
  kCentre = kAxesK + 9,    ///< of the first joint, P (3) [m]
  kCentreK = kCentre + 3,  ///< the same in K (3)
  kRing = kCentreK + 3,    ///< tip on C, axes of C (3) [m]
  kTip = kRing + 3,        ///< elbow to tip, E, at coordinate 0 of the last joint (3) [m]
  kElbow = kTip + 3,       ///< +1 or -1
  kFlip = kElbow + 1,      ///< +1 or -1
  kCrank = kFlip + 1,      ///< l1 and height (2) [m]
  kMasses = kCrank + 2,    ///< from here: mass, first moment (3), inertia (6)
  kCross = kMasses,        ///< about the centre, in K turned by the first joint
  kTube = kCross + 10,     ///< about the elbow, E
  kRod = kTube + 10,       ///< about the elbow, E, at coordinate 0 of the last joint
  kTurned = kRod + 10,     ///< inertia about the first axis: cross, and the others in the elbow
  kParameters = kTurned + 1
};

/// Rows of LegGroup::work: what later stages need of earlier ones.
enum Work {
  kAxesC = 0,                    ///< R_CE by columns (9)
  kAxesP = kAxesC + 9,           ///< R_PE by columns (9); moving only
  kTurns = kAxesP + 9,           ///< cosine and sine of each joint (6), of those that turn
  kAngles = kTurns + 6,          ///< of each joint that turns (3), -pi to pi, by calc_angles
  kSlide = kAngles + 3,          ///< coordinate of the slide [m]
  kArm = kSlide + 1,             ///< elbow to tip, E (3) [m]
  kInverse = kArm + 3,           ///< of the loop matrix, by rows (9): rates per tip velocity, E
  kRodMoment = kInverse + 9,     ///< first moment of the rod about the elbow, E (3)
  kRodInertia = kRodMoment + 3,  ///< inertia of the rod about the elbow, E (6): xx yy zz xy xz yz
  kApparent = kRodInertia + 6,   ///< apparent inertia at the tip, E (6)
  kCarried = kApparent + 6,      ///< momentum per tip velocity: linear, angular about the centre,
                                 ///< E, by columns (9 + 9); moving only
  kRate = kCarried + 18,         ///< of the three joints
  kTipC = kRate + 3,             ///< v_C x velocity of the tip, C (3)
  kForce = kTipC + 3,            ///< generalised forces of the three joints, written by the caller
  kTipFree = kForce + 3,         ///< y at zero accelerations of root and joints, E (3)
  kReach = kTipFree + 3,         ///< squares whose quotient is the square of the margin (2)
  kCut = kReach + 2,             ///< force of the cut on the rod, P (3), by calc_loads
  kWork = kCut + 3               ///< their number
};

struct alignas(64) LegGroup {
  double parameter[kParameters][kGroup];
  double work[kWork][kGroup];
  LegType type;
};

/// Relative pose and velocity of C in P: what all legs share.
struct Platform {
  double R[9];     ///< R_PC by columns
  double p[3];     ///< origin of C, P [m]
  double w[3];     ///< angular velocity of C relative to P, C
  double v[3];     ///< velocity of the origin of C relative to P, C
  double root[3];  ///< angular velocity of P, P
};

/// Rows of sums over legs after calc_position: inertia at C.
enum PositionSum {
  kSumA = 0,               ///< sum of apparent inertias, C (6)
  kSumK = kSumA + 6,       ///< [s] A by columns (9)
  kSumD = kSumK + 9,       ///< [s] A [s]^T (6)
  kFixedSums = kSumD + 6,  ///< what follows only if P moves:
  kSumH = kFixedSums,      ///< first moment about P, P (3)
  kSumJ = kSumH + 3,       ///< inertia about P, P (6)
  kSumLV = kSumJ + 6,      ///< linear momentum per v of C, rows P, columns C, by rows (9)
  kSumLW = kSumLV + 9,     ///< per w of C (9)
  kSumAV = kSumLW + 9,     ///< angular momentum about P per v of C (9)
  kSumAW = kSumAV + 9,     ///< per w of C (9)
  kPositionSums = kSumAW + 9
};

/// Rows of sums over legs after calc_bias.
enum BiasSum {
  kSumTipForce = 0,                    ///< on the legs at zero accelerations, C (3)
  kSumTipMoment = kSumTipForce + 3,    ///< about C (3)
  kFixedBiasSums = kSumTipMoment + 3,  ///< what follows only if P moves:
  kSumRootForce = kFixedBiasSums,      ///< P (3)
  kSumRootMoment = kSumRootForce + 3,  ///< about P (3)
  kBiasSums = kSumRootMoment + 3
};

/// Accelerations of root and platform, once they are known.
struct Accelerations {
  double v[3], w[3];      ///< derivatives of Platform::v, w, C
  double a[3], alpha[3];  ///< of the origin of P less gravity, and angular, P
};

/// Rows of sums over legs after calc_loads: what moves the legs, about P, P.
enum LoadSum { kSumLoad = 0, kSumLoadMoment = 3, kLoadSums = 6 };

/// The stages of an evaluation, for one instruction set. `moving`: P moves or falls.
struct LegFunctions {
  /// @param limit  smallest margin
  /// @return false if a leg does not reach its tip or is closer to singular than that
  bool (*calc_position)(LegGroup* groups, int count, const Platform& platform, bool moving,
                        double limit, double* sums);
  /// Angles of the first, second or third joint of each leg. @param joint  0 to 2
  void (*calc_angles)(LegGroup* groups, int count, int joint);
  void (*calc_rates)(LegGroup* groups, int count, const Platform& platform);
  void (*calc_bias)(LegGroup* groups, int count, const Platform& platform, bool moving,
                    double* sums);
  void (*calc_loads)(LegGroup* groups, int count, const Platform& platform, const Accelerations& at,
                     double* sums);
  const char* name;
};

extern const LegFunctions kBaseFunctions;
#ifdef DOCKLOOP_X86_LANES
extern const LegFunctions kAvx2Functions, kAvx512Functions;
#endif

/// The widest that this processor has. @param widest  lanes at most
const LegFunctions& find_leg_functions(int widest);

}  // namespace dockloop::legs
