// Where the numbers of a leg stand: rows of arrays, of which a group of legs has one column a leg.
//
// Three kinds of legs. All have three bodies, here named as those of a slide leg: cross (the
// crank), tube and rod. Their second joint turns about z, and its centre is the elbow.
//
// Axes: R of the root body, on which the legs hang, C of the platform, K canonical axes of a leg at
// the centre of its first joint, E those of its tube. y = velocity or acceleration of the tip
// relative to R. Plain enums and arrays, so that vector code can include this file.
#pragma once

#include "math/lanes.hpp"

namespace dockloop::legs {

/// By their joints, K; first in the order of LegKind.
enum LegType {
  kSlideLeg,        ///< turns about y and z, slide along x; the elbow is the centre
  kCrankLeg,        ///< turns about z, z, y; elbow (l1, 0, height)
  kSquareCrankLeg,  ///< turns about x, z, x; elbow (height, l1, 0), tip (0, l2, 0)
  kAxialSlideLeg    ///< a slide leg with nothing off the axis of its slide, and a massless cross
};

/// Constants of a leg. Unused lanes of a group repeat a leg without mass.
enum Parameter {
  kAxesK = 0,              ///< R_RK by columns (9)
  kCentre = kAxesK + 9,    ///< of the first joint, R (3) [m]
  kCentreK = kCentre + 3,  ///< the same in K (3)
  kRing = kCentreK + 3,    ///< tip on C, axes of C (3) [m]
  kTip = kRing + 3,        ///< elbow to tip, E, at coordinate 0 of the last joint (3) [m]
  kCrank = kTip + 3,       ///< l1 and height (2) [m]
  kElbow = kCrank + 2,     ///< assembly branch: +1 or -1; may change near a singular pose
  kFlip = kElbow + 1,      ///< +1 or -1
  kMasses = kFlip + 1,     ///< from here: mass, first moment (3), inertia (6)
  kCross = kMasses,        ///< about the centre, in K turned by the first joint
  kTube = kCross + 10,     ///< about the elbow, E
  kRod = kTube + 10,       ///< about the elbow, E, at coordinate 0 of the last joint
  kTurned = kRod + 10,     ///< inertia about the first axis: cross, and the others in the elbow
  kSpin = kTurned + 1,     ///< rotors that turn with the slide: momentum along it per its rate, and
                           ///< inertia that they reflect (2)
  kParameters = kSpin + 2
};

/// What one stage leaves for later ones.
enum Work {
  kAxesC = 0,                    ///< R_CE by columns (9)
  kAxesR = kAxesC + 9,           ///< R_RE by columns (9); moving only
  kTurns = kAxesR + 9,           ///< cosine and sine of each joint (6), of those that turn
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
  kForce = kRate + 3,            ///< generalised forces of the three joints, written by the caller
  kTipFree = kForce + 3,         ///< y at zero accelerations of root and joints, E (3)
  kReach = kTipFree + 3,         ///< two pairs of squares; the margin is the smaller root of their
                                 ///< quotients (4)
  kCut = kReach + 4,             ///< force of the cut on the rod, R (3), by calc_loads
  kJoint = kCut + 3,             ///< accelerations of the three joints, by calc_loads
  kAlong = kJoint + 3,           ///< angular acceleration of the tube along x, by calc_loads
  kWork = kAlong + 1             ///< their number
};

/// Motion of C relative to R: what all legs of a platform share.
template <class S>
struct PlatformMotion {
  S R[9];                ///< R_RC by columns
  S p[3];                ///< origin of C, R [m]
  S w[3], v[3];          ///< angular velocity; velocity of the origin; C
  S alpha[3], a[3];      ///< the accelerations at zero joint accelerations, seen from R, C
  S root[3];             ///< angular velocity of R, R
  S dot_w[3], dot_v[3];  ///< what joint accelerations add to alpha and a, C
  S root_alpha[3];       ///< angular acceleration of R, R
  S root_a[3];           ///< acceleration of the origin of R less gravity, R
};

/// Sums over legs after calc_position: inertia at C.
enum PositionSum {
  kSumA = 0,               ///< sum of apparent inertias, C (6)
  kSumK = kSumA + 6,       ///< [s] A by columns (9)
  kSumD = kSumK + 9,       ///< [s] A [s]^T (6)
  kFixedSums = kSumD + 6,  ///< what follows only if R moves:
  kSumH = kFixedSums,      ///< first moment about R, R (3)
  kSumJ = kSumH + 3,       ///< inertia about R, R (6)
  kSumLV = kSumJ + 6,      ///< linear momentum per v of C, rows R, columns C, by rows (9)
  kSumLW = kSumLV + 9,     ///< per w of C (9)
  kSumAV = kSumLW + 9,     ///< angular momentum about R per v of C (9)
  kSumAW = kSumAV + 9,     ///< per w of C (9)
  kPositionSums = kSumAW + 9
};

/// Sums over legs after calc_bias.
enum BiasSum {
  kSumTipForce = 0,                    ///< on the legs at zero accelerations, C (3)
  kSumTipMoment = kSumTipForce + 3,    ///< about C (3)
  kFixedBiasSums = kSumTipMoment + 3,  ///< what follows only if R moves:
  kSumRootForce = kFixedBiasSums,      ///< on the whole legs, R (3)
  kSumRootMoment = kSumRootForce + 3,  ///< about R (3)
  kBiasSums = kSumRootMoment + 3
};

/// Sums over legs after calc_loads: what moves the legs, about R, R.
enum LoadSum { kSumLoad = 0, kSumLoadMoment = 3, kLoadSums = 6 };

/// Does a leg reach its tip?
enum class Reached { kYes, kNo, kSingular };

}  // namespace dockloop::legs
