// Legs side by side: one leg per lane of a vector register, eight to a group.
//
// Plain arrays and functions, so that the same source (leg_lanes_body.hpp) can be compiled for several
// instruction sets without any of it reaching code that runs without a test of the processor.
// Operations are those of IEEE 754, one by one and in one order: results do not depend on the
// instruction set, to the last bit.
//
// Axes: P of the body on which the legs hang, C of the body they hold, K canonical axes of a leg at
// the centre of its universal joint, E those of its rod (x along the slide). y = velocity or
// acceleration of the tip relative to P.
#pragma once

#include "math/lanes.hpp"

namespace dockloop::legs {

/// Rows of LegGroup::parameter. Unused lanes repeat a leg without mass.
enum Parameter {
  kAxesK = 0,              ///< R_PK by columns (9)
  kCentre = kAxesK + 9,    ///< of the universal joint, P (3) [m]
  kCentreK = kCentre + 3,  ///< the same in K (3)
  kRing = kCentreK + 3,    ///< tip on C, axes of C (3) [m]
  kTip = kRing + 3,        ///< tip in E at slide coordinate 0 (3) [m]
  kElbow = kTip + 3,       ///< +1 or -1
  kFlip = kElbow + 1,      ///< +1 or -1
  kCross = kFlip + 1,      ///< cross: mass, first moment (3), inertia about the centre (6),
                           ///< in K turned by the first joint
  kTube = kCross + 10,     ///< what turns with both joints: first moment (3), inertia (6), E
  kRod = kTube + 9,        ///< what slides: mass, first moment (3), inertia (6) at slide 0, E
  kTubeMass = kRod + 10,   ///< [kg]
  kParameters = kTubeMass + 1
};

/// Rows of LegGroup::work: what later stages need of earlier ones.
enum Work {
  kAxesC = 0,           ///< R_CE by columns (9)
  kAxesP = kAxesC + 9,  ///< R_PE by columns (9); moving only
  kSine = kAxesP + 9,   ///< of the second joint
  kCosine = kSine + 1,
  kXi = kCosine + 1,          ///< tip along x of E [m]
  kSlide = kXi + 1,           ///< coordinate of the slide [m]
  kInverse = kSlide + 1,      ///< of the loop matrix: (1,z) (2,y) (2,z) (3,y) (3,z); (3,x) = 1
  kMoment = kInverse + 5,     ///< first moment of tube and rod about the centre, E (3)
  kRodMoment = kMoment + 3,   ///< of the rod alone (3)
  kInertia = kRodMoment + 3,  ///< of tube and rod about the centre, E (6): xx yy zz xy xz yz
  kApparent = kInertia + 6,   ///< apparent inertia at the tip, E (6)
  kCarried = kApparent + 6,  ///< momentum per tip velocity: linear, angular about the centre, E, by
                             ///< columns (9 + 9); moving only
  kRate = kCarried + 18,     ///< of the three joints
  kTipC = kRate + 3,         ///< v_C x velocity of the tip, C (3)
  kForce = kTipC + 3,        ///< generalised forces of the three joints, written by the caller
  kTipFree = kForce + 3,     ///< y at zero accelerations of root and joints, E (3)
  kReach = kTipFree + 3,     ///< squares whose quotient is the square of the margin (2)
  kFirst = kReach + 2,       ///< cosine and sine of the first joint (2)
  kCut = kFirst + 2,         ///< force of the cut on the rod, P (3), by calc_loads
  kWork = kCut + 3
};

struct alignas(64) LegGroup {
  double parameter[kParameters][kGroup];
  double work[kWork][kGroup];
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
