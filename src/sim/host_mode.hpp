// Does one flexible mode explain what a host reports of its vehicle?
//
// The reported point leaves the rigid body that has all of the mass: by S, with the velocity s. A
// mode has one direction u in all six coordinates, and is driven by the load along u only, which is
// constant over a step. So both move on by constants: u S' = a (u f) + b (u S) + c (u s), and s
// likewise. Sums of products over the steps give u, then the constants, then the frequency. The
// constants are those of an oscillator at the ends of a step. Their ratio has its frequency, even
// if it swings several times in a step.
#pragma once

#include "math/types.hpp"

namespace dockloop {

/// How a vehicle left its rigid body in a step. Body axes; rotations are lengths, by the radius of
/// gyration.
struct ModeStep {
  Vec6<double> error;   ///< of the velocity: received minus predicted [m/s]
  Vec6<double> offset;  ///< of the position, likewise [m]
  Vec6<double> change;  ///< of the velocity by the load, of a rigid body [m/s]
  double rounding;      ///< changes of velocity that are ignored [m/s]
  double h;             ///< [s]
};

/// Sums over the reports of one vehicle.
struct ModeSums {
  using Row = Eigen::Matrix<double, 30, 1>;  ///< changes of s [m/s], of S / h; change, S [m], s
  Eigen::Matrix<double, 30, 30> products = Eigen::Matrix<double, 30, 30>::Zero();
  Vec6<double> displacement = Vec6<double>::Zero(), velocity = Vec6<double>::Zero();  ///< S, s
  double rounding2 = 0.0;  ///< squares of what is ignored [m2/s2]
};

/// @param keep  factor of older sums
void add_to_mode(const ModeStep& step, double keep, ModeSums& sums);

/// A mode of the free vehicle.
struct HostMode {
  double frequency = 0.0;   ///< [Hz]; 0: no mode, or a rigid body explains as much
  bool bends = false;       ///< no rigid body, of any mass, would move so within steps
  double rate = 0.0;        ///< of its swing and decay, as steps fold them [Hz]
  double deflection = 0.0;  ///< by a load that stays, per acceleration of the rigid body [s2]
};
/// The mode that explains the reports. Where steps of whole periods hide how many these are, one
/// period per step. @param h  step [s]
HostMode find_mode(const ModeSums& sums, double h);

}  // namespace dockloop
