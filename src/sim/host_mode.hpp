// Does one flexible mode explain what a host reports of its vehicle?
//
// The reported point leaves the rigid body that has all of the mass: by S, with the velocity s. The
// error of a step is the change of s. A mode has one direction u in all six coordinates, and is
// driven by the load along u only. So u e = b (u f) + c (u S) + d (u s), with constants b, c, d.
// Sums of products of e, f, S, s over the steps give u, then the constants, then the frequency.
#pragma once

#include "math/types.hpp"

namespace dockloop {

/// Sums over the reports of one vehicle. Body axes; rotations are lengths, by the radius of
/// gyration.
struct ModeSums {
  using Row = Eigen::Matrix<double, 24, 1>;  ///< error, change by the load [m/s], S [m], s [m/s]
  Eigen::Matrix<double, 24, 24> products = Eigen::Matrix<double, 24, 24>::Zero();
  Vec6<double> displacement = Vec6<double>::Zero(), velocity = Vec6<double>::Zero();  ///< S, s
};

/// @param error  received minus predicted velocity; @param change  by the load, of a rigid body;
///     @param h  step [s]; @param keep  factor of older sums
void add_to_mode(const Vec6<double>& error, const Vec6<double>& change, double h, double keep,
                 ModeSums& sums);

/// Frequency of the mode that explains the errors, as steps of h show it: half of the rate of
/// reports is the highest [Hz]. 0 if no mode does, or if a rigid body explains as much.
double find_mode_frequency(const ModeSums& sums, double h);

}  // namespace dockloop
