// How fast two vehicles move on what holds them together: the highest frequency, or damping rate,
// of their relative motion. A master that steps the vehicles apart from each other must resolve it.
//
// Everything is linearised at the present state. The unknowns are the n independent coordinates q
// of the mechanism, relative to its base, and the motion x of P relative to the chaser at the point
// where G is (three of translation, three of rotation, axes of the chaser):
//
//   M^-1 = sum over the vehicles that move of J B^-1 J^T              of the mass x meets, 6 x 6
//   D(w) = K + i w C, then without q:  D_xx - D_xq D_qq^-1 D_qx       dynamic stiffness, 6 x 6
//   w    = max(sqrt(eigenvalues of M^-1 Re D), eigenvalues of M^-1 Im D/w)
//
// The last is an equation for w, solved by repetition: which of springs and dampers in a row gives
// way depends on how fast they are moved. Surfaces that stick under regularised friction, a very
// strong damper, thus hold as they should, and the springs behind them tell the frequency.
//
// B is the inertia of the target, and for the chaser what its base feels while all joints are free:
// the bare vehicle plus whatever mass of the mechanism must go along. (The stated mass may include
// a mechanism frozen at home; the equations inside never do.) J leads from the vehicle's origin to
// G. K and C come from exact derivatives of the generalised forces (docking_jacobian.hpp), contact
// and latches among them: K at zero velocities, a displacement taking sticking bristles along; C at
// the present velocities, because a surface that slides resists less than one that sticks.
// In coordinates xi with x = L xi, L L^T = M^-1, the mass is one.
//
// Where nothing touches and no latch pulls, G and P are joined by a link much stiffer than the
// mechanism: what a capture that holds rigidly will feel, an upper value. Directions in which the
// mechanism cannot give at all then count for nothing, and so does a mechanism without springs.
//
// Limits: the mass of the moving parts is left out, which is good where they are light beside both
// vehicles. Loads must be small beside stiffness times lever arm: they enter with what relative
// motion changes in them, not with what turning both vehicles does. A rate c/m is up to twice the
// true one where spring and damper are about equal. A coordinate with negative stiffness is held:
// the result may jump where sliding bristles, whose force has no potential, make one.
#pragma once

#include <complex>

#include "docking/docking_jacobian.hpp"

namespace dockloop {

/// Scratch and results; sized by the constructor, nothing below allocates. To be made again when
/// the model changes its independent coordinates or its friction model. Order of the n + 6 rows and
/// columns: coordinates of the mechanism, then xi.
struct InterfaceWorkspace {
  explicit InterfaceWorkspace(const DockingModel& model);
  DockingPass pass;
  MatX<double> stiffness, damping;     ///< (n + 6) square
  MatX<std::complex<double>> dynamic;  ///< (n + 6) square, condensed in place
  MatX<double> capture;                ///< 6 x n: motion of G in xi per rate of a coordinate
  MatX<double> bristle_rate;           ///< bristles x (n + 6): that go along with a displacement
  VecX<double> column;                 ///< all independent velocities, the vehicle's too
  VecX<double> diagonal;               ///< n: magnitudes before condensation
  std::vector<char> eliminated;        ///< n

  // results of the last call, of all directions
  Vec6<double> squared_frequency = Vec6<double>::Zero();  ///< ascending but for rigid ones, 0
  Vec6<double> damping_rate = Vec6<double>::Zero();       ///< ascending [1/s]
};

/// Largest frequency [rad/s] of the relative motion, or damping rate c/m [1/s] if that is larger; 0
/// where nothing can hold, without a target, and where no derivative exists.
/// @param at  calc_docking of the same state
double find_interface_frequency(const DockingModel& model, const DiscreteState& discrete,
                                const ContactMemory& memory, const DockingData<double>& at,
                                const Loads& loads, double t, const double* y,
                                InterfaceWorkspace& work);

}  // namespace dockloop
