// Closed forms: the joint coordinates of a leg that reaches a given point, without iteration.
//
// Each leg type is written in its own canonical axes; L is the vector from the centre of its first
// joint to the point it must reach. Square roots and divisions only: angles come out as cosine and
// sine. Which mechanism leg is which type, and where its canonical axes are: leg_geometry.hpp.
// Kinds with an inverse have their formulas in leg_formulas.hpp, the others in
// closed_form_body.hpp.
//
// A root that is not real is refused, a root that is exactly zero is singular; nothing is ever
// clamped. Two signs choose the assembly branch: `elbow` (which way an elbow bends or a strut
// leans, whether a slide points at its target or away from it) and `flip` (a universal joint turned
// over: first angle + pi, second pi - angle).
#pragma once

#include <array>

#include "math/status.hpp"
#include "math/types.hpp"

namespace dockloop {

/// Types of legs, named by their joints from the root outwards and their cut.
enum class LegKind {
  kR2P1R3,               ///< Ry(1) Rz(2), slide x; tip (l0, dy, dz)                     [Y2 (9a)]
  kR1R2R3,               ///< Rz(1), elbow (l1, 0, height), Rz(2) Ry(3); tip (a, b, c)   [Y2 (9b)]
  kR1R2R3Perpendicular,  ///< Rz(1), elbow (l1, 0, height), Ry(2) Rz(3); tip (l2, 0, 0)
  kP1R2R3,               ///< slide along `slide`, Ry(2) Rz(3); tip of length l2
  kR2R1R3,               ///< Ry(1) Rz(2), elbow (l1, 0, .), Rz(3); tip (l2, 0, .), height of both
  kR1P1R1,               ///< planar: Rz(1), slide x; tip (l0, dy)
  kR1R1R1,               ///< planar: Rz(1), elbow (l1, 0), Rz(2); tip (l2, 0)
  kP1R1R1                ///< planar: slide x, Rz(2); tip (l2, 0)
};

/// Lengths of a leg in its canonical axes [m]; each kind says above which ones it has.
struct LegShape {
  double l1 = 0.0, l2 = 0.0, height = 0.0;
  Vec3<double> tip = Vec3<double>::Zero();
  Vec3<double> slide = Vec3<double>::UnitX();  ///< unit
};

struct LegBranch {
  int elbow = 1, flip = 1;
};

/// Canonical coordinates, in the order of the joints.
template <class S>
struct LegSolution {
  std::array<S, 3> c{S(1), S(1), S(1)}, s{S(0), S(0), S(0)};  ///< of the turning joints
  S slide = S(0);                                             ///< of the sliding one [m]
  StatusCode code = StatusCode::kOk;  ///< kOutOfReach or kLoopSingular if there is no solution
  double margin = 0.0;  ///< smallest factor of the loop matrix's determinant, 0 = singular [-]
};

/// @param L  point to reach, canonical axes [m] (planar kinds: z is not used)
template <class S>
LegSolution<S> solve_leg(LegKind kind, const LegShape& shape, LegBranch branch, const Vec3<S>& L);

/// Inverse of the loop matrix of a leg: joint rates for a velocity of its tip relative to the root.
/// Exists for kR2P1R3, kR1R2R3 and kR1R2R3Perpendicular.
/// @param axes  leg axes as columns: those in which the tip moves away from the last joint's centre
///              (kR2P1R3: Ry(1) Rz(2); kR1R2R3: Rz(1 + 2); perpendicular: Rz(1) Ry(2))
/// @return rows: canonical rates of joints 1 to 3 per unit velocity
template <class S>
Mat3<S> find_leg_inverse(LegKind kind, const LegShape& shape, const LegSolution<S>& leg,
                         const Mat3<S>& axes);

/// Sign of the determinant of that matrix.
int find_leg_sign(LegKind kind, LegBranch branch);

/// Acceleration of the tip relative to the root at zero joint accelerations, leg axes [m/s2].
/// Exists where the inverse does. @param rate  canonical joint rates
template <class S>
Vec3<S> find_leg_bias(LegKind kind, const LegShape& shape, const LegSolution<S>& leg,
                      const Vec3<S>& rate);

}  // namespace dockloop
