// Forces between the vehicles that a scene states: springs, tethers, magnets, measured tables.
//
// A force acts between a point a, fixed on A, and a point b, fixed on P. With p and R of P relative
// to A, everything in axes of A:
//
//   d = p + R b - a,  L = |d|,  s^2 = d.d + size^2,  K = mu0/(4 pi)
//
//   spring   f = -(k (L - L0) + c L') d/L on P at b
//   tether   the same where L > L0, with a toe, and it never pushes; slack elsewhere
//   dipoles  U = K (m.n/s^3 - 3 (m.d)(n.d)/s^5), m the moment on A, n that on P
//   table    U = sum over offsets of B_j(d_y^2 + d_z^2) times the integral of F_j from d_x on
//
// f = -dU/dd, and the torques of dipoles are those of U, so the energy audit is exact. The chaser
// gets the opposite of the wrench on P: momentum balances to rounding.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "contact/contact_model.hpp"
#include "contact/interface_tangent.hpp"
#include "math/law_number.hpp"
#include "math/monotone_cubic.hpp"
#include "math/types.hpp"

namespace dockloop {

constexpr int kMaxVehicleForces = 16;

/// Axial force over gap and lateral offset: monotone cubics over the gap; between them cubics over
/// the square of the offset, with the slopes of parabolas through three. Beyond the largest gap
/// there is no force, elsewhere the value at the edge holds.
struct ForceTable {
  std::vector<double> square;              ///< of the offsets [m2], increasing from 0
  std::vector<MonotoneCubic> force;        ///< per offset, over the gap [N]
  std::vector<std::vector<double>> slope;  ///< per offset: weights of the values in the slope there
};

/// @param force  per offset, of every gap [N]
/// @pre gap and offset increase, offset from 0
ForceTable make_force_table(const std::vector<double>& gap, const std::vector<double>& offset,
                            const std::vector<std::vector<double>>& force);

struct VehicleForce {
  enum class Kind { kSpring, kTether, kDipoles, kTable };
  Kind kind = Kind::kSpring;
  Vec3<double> chaser_point = Vec3<double>::Zero();   ///< in A [m]
  Vec3<double> target_point = Vec3<double>::Zero();   ///< in P [m]
  double stiffness = 0.0;                             ///< [N/m]
  double damping = 0.0;                               ///< along the line [N s/m]
  double free_length = 0.0;                           ///< [m]
  double toe = 1e-3;                                  ///< of a tether [m]
  double size = 0.0;                                  ///< of magnets [m]
  Vec3<double> chaser_moment = Vec3<double>::Zero();  ///< axes of A [A m2]
  Vec3<double> target_moment = Vec3<double>::Zero();  ///< axes of P [A m2]
  double scale = 1.0;                                 ///< of a table
  ForceTable table;
};

inline constexpr LawNumber<VehicleForce> kLineNumbers[] = {
    {"stiffness", &VehicleForce::stiffness, "N/m", Rule::kPositive, true,
     "Stiffness along the line between the points"},
    {"damping", &VehicleForce::damping, "N.s/m", Rule::kNotNegative, false,
     "Damping along the line between the points"},
    {"free_length", &VehicleForce::free_length, "m", Rule::kNotNegative, true,
     "Distance of the points without force"},
};

inline constexpr LawNumber<VehicleForce> kTetherNumbers[] = {
    {"toe", &VehicleForce::toe, "m", Rule::kPositive, false,
     "Stretch over which the stiffness of a tether builds up"},
};

inline constexpr LawNumber<VehicleForce> kDipoleNumbers[] = {
    {"size", &VehicleForce::size, "m", Rule::kPositive, true,
     "Size of the magnets: at smaller distances their force does not grow"},
};

inline constexpr LawNumber<VehicleForce> kTableNumbers[] = {
    {"scale", &VehicleForce::scale, "1", Rule::kAny, false, "Factor on the force of the table"},
};

/// As files write it.
inline const char* name_of(VehicleForce::Kind kind) {
  static constexpr const char* kNames[] = {"spring", "tether", "dipoles", "table"};
  return kNames[static_cast<size_t>(kind)];
}

/// f(name, number, unit, rule, text) for every number that a host may set before a run.
/// @param force  a VehicleForce, or const
template <class Force, class F>
void for_each_force_number(Force& force, const std::string& prefix, F&& f) {
  switch (force.kind) {
    case VehicleForce::Kind::kTether:
    case VehicleForce::Kind::kSpring:
      for_each_number(kLineNumbers, force, prefix, f);
      if (force.kind == VehicleForce::Kind::kTether)
        for_each_number(kTetherNumbers, force, prefix, f);
      break;
    case VehicleForce::Kind::kDipoles:
      for_each_number(kDipoleNumbers, force, prefix, f);
      break;
    case VehicleForce::Kind::kTable:
      for_each_number(kTableNumbers, force, prefix, f);
      break;
  }
  const auto vector = [&](const char* name, auto& numbers, const char* unit, const char* text) {
    for (int i = 0; i < 3; ++i) {
      f(prefix + name + "[" + std::to_string(i + 1) + "]", numbers[i], unit, Rule::kAny,
        std::string(text) + ", " + "xyz"[i]);
    }
  };
  vector("chaser_point", force.chaser_point, "m", "Where this force acts on the chaser, in A");
  vector("target_point", force.target_point, "m", "Where this force acts on the target, in P");
  if (force.kind != VehicleForce::Kind::kDipoles) return;
  vector("chaser_moment", force.chaser_moment, "A.m2", "Moment of the chaser's magnet, axes of A");
  vector("target_moment", force.target_moment, "A.m2", "Moment of the target's magnet, axes of P");
}

template <class S>
struct VehicleForceLoad {
  Wrench<S> on_passive;  ///< about the origin of A, axes of A [N], [N m]
  S energy = S(0);       ///< stored; of magnets, below 0 where they attract [J]
  S dissipation = S(0);  ///< >= 0 [W]
};

/// @param motion  of P relative to A, axes of A. No allocation.
template <class S>
VehicleForceLoad<S> calc_vehicle_force(const VehicleForce& force, const RelativeMotion<S>& motion);

/// The sum of all.
template <class S>
VehicleForceLoad<S> sum_vehicle_forces(const std::vector<VehicleForce>& forces,
                                       const RelativeMotion<S>& motion);

/// From the point on A to that on P, axes of A [m].
template <class S>
Vec3<S> find_line(const VehicleForce& force, const RelativeMotion<S>& motion) {
  return motion.p + motion.R * cast<S>(force.target_point) - cast<S>(force.chaser_point);
}

/// Distance of the points [m].
template <class S>
S find_distance(const VehicleForce& force, const RelativeMotion<S>& motion) {
  using std::sqrt;
  const S square = find_line(force, motion).squaredNorm();
  return square > S(0) ? S(sqrt(square)) : S(0);
}

/// How the wrench on P about the origin of A changes with the motion of P relative to A, axes of A
/// (contact/interface_tangent.hpp): exact, by dual numbers.
void add_vehicle_force_tangent(const std::vector<VehicleForce>& forces,
                               const RelativeMotion<double>& motion, InterfaceTangent& tangent);

/// Puts forces in their place that depend on the same numbers, and act at every distance: to find
/// on which states a rate depends.
void make_forces_felt(std::vector<VehicleForce>& forces);

/// @throws ModelError for numbers out of range. @param motion  at the start; null: not known
void check_vehicle_forces(const std::vector<VehicleForce>& forces,
                          const RelativeMotion<double>* motion = nullptr);

}  // namespace dockloop
