// Highest frequency, or damping rate, of the relative motion of two connected vehicles. A master
// that integrates the vehicles separately must resolve this frequency.
//
// The equations are linearised at the present state. The unknowns are the n independent coordinates
// q of the mechanism, relative to its base, and the motion x of P relative to the chaser at the
// position of G (three of translation, three of rotation, axes of the chaser):
//
//   M^-1 = sum over the vehicles that move of J B^-1 J^T              inverse mass for x, 6 x 6
//   D(w) = K + i w C, then without q:  D_xx - D_xq D_qq^-1 D_qx       dynamic stiffness, 6 x 6
//   w    = max(sqrt(eigenvalues of M^-1 Re D), eigenvalues of M^-1 Im D/w)
//
// The last is an equation for w, solved by fixed-point iteration: the stiffness of springs and
// dampers in series depends on w. Regularised friction acts as a very strong damper. Sticking
// surfaces therefore hold, and the springs in series with them determine the frequency.
//
// B is the inertia of the target. For the chaser B is the effective inertia of the base with free
// joints: the vehicle plus the mass of the mechanism that must move with it. (The stated mass may
// include a mechanism frozen in its home pose; B does not.) J leads from the vehicle's origin to
// G. K and C come from exact derivatives of the generalised forces (docking_jacobian.hpp), contact
// and latches among them: K at zero velocities, where a displacement moves sticking bristles; C at
// the present velocities, because a sliding surface resists less than a sticking surface. In
// coordinates xi with x = L xi, L L^T = M^-1, the mass is one.
//
// Without contact and latch forces, G and P are joined by a link much stiffer than the mechanism.
// The result is an upper value for a rigid capture. Directions in which the mechanism is rigid are
// then ignored, and so is a mechanism without springs.
//
// The largest delay: a host applies loads a time T late, and nothing knows this. In one mode of
// stiffness k and damping c (its coordinate has the mass one), a share mu of M^-1 belongs to
// vehicles of hosts, and at the limit of stability the motion has a constant amplitude:
//
//   w^2 = (k + i w c) (1 - mu + mu exp(-i w T))
//
// With mu = 1 this is w^2 = (c^2 + sqrt(c^4 + 4 k^2))/2, T = atan(w c/k)/w: for little damping
// T = c/k. Modes are those of Re D at their own w; coupling of modes by C and mu is left out, and
// the communication step must be short. A mode with mu < 1/2 may be stable with any delay.
//
// Limits: the mass of the moving parts is neglected, so they must be light compared with both
// vehicles. Loads must be small compared with stiffness times lever arm: only their change by
// relative motion is included, not the rotation of both vehicles. A rate c/m is up to twice the
// true rate if spring and damper are about equal. A coordinate with negative stiffness is held.
// Sliding bristles have no potential and can cause negative stiffness; the result then jumps.
#pragma once

#include <array>
#include <complex>

#include "docking/docking_jacobian.hpp"

namespace dockloop {

/// Scratch and results; sized by the constructor, no later allocation. Make a new object when the
/// model changes its independent coordinates or its friction model. Order of the n + 6 rows and
/// columns: coordinates of the mechanism, then xi.
struct InterfaceWorkspace {
  explicit InterfaceWorkspace(const DockingModel& model);
  DockingPass pass;
  MatX<double> stiffness, damping;     ///< (n + 6) square
  MatX<std::complex<double>> dynamic;  ///< (n + 6) square, condensed in place
  MatX<double> capture;                ///< 6 x n: motion of G in xi per rate of a coordinate
  MatX<double> bristle_rate;           ///< bristles x (n + 6): bristle rates for a displacement
  std::array<VecX<double>, 2> column;  ///< per vehicle: all independent velocities
  VecX<double> diagonal;               ///< n: magnitudes before condensation
  std::vector<char> eliminated;        ///< n
  double rigid = 0.0;                  ///< squared frequencies from here on mean no spring
  Mat6<double> hosts = Mat6<double>::Zero();  ///< share of M^-1 of driven vehicles, in xi

  // results of the last call, of all directions
  Vec6<double> squared_frequency =
      Vec6<double>::Zero();  ///< ascending; 0 for rigid directions, at the end
  Vec6<double> damping_rate = Vec6<double>::Zero();  ///< ascending [1/s]
};

/// Largest frequency [rad/s] of the relative motion, or damping rate c/m [1/s] if larger; 0 without
/// a connection, without a target, and if no derivative exists.
/// @param at  calc_docking of the same state
double find_interface_frequency(const DockingModel& model, const DiscreteState& discrete,
                                const ContactMemory& memory, const DockingData<double>& at,
                                const Loads& loads, double t, const double* y,
                                InterfaceWorkspace& work);

/// Largest delay of loads of hosts that is stable although nothing knows it [s]; 0 without a
/// connection, kNoDelayLimit if any delay is stable. @pre find_interface_frequency
double find_largest_delay(InterfaceWorkspace& work);
constexpr double kNoDelayLimit = 1e3;

/// The same of one mode. @param k, c  of unit mass [1/s2], [1/s]; @param share  of hosts in the
/// inverse mass, above 0. @param w  receives the frequency there [rad/s]; 0 without a limit
double find_largest_delay(double k, double c, double share, double& w);

}  // namespace dockloop
