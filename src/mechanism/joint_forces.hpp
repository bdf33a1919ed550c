// Force laws along single joint coordinates: spring, damper, preload, end stops.
//
//   tau = -k (q - rest) - c v + preload + stops + command
//
// An end stop is a one-sided spring (math/one_sided_spring.hpp) on the depth past its limit.
// Limits: the toe must be small against the travel; the stop has no friction and no mass of its
// own.
#pragma once

#include "math/types.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// Sums over all joint forces.
template <class S>
struct JointForceSums {
  S energy = S(0);         ///< stored in springs and stops [J]
  S dissipation = S(0);    ///< in dampers and stops [W], >= 0
  S command_power = S(0);  ///< of commanded forces on the mechanism [W]
};

/// Add the joint forces to tau and return their energies.
/// @param[in]  q, v     all coordinates (nq) and velocities (nv)
/// @param[in]  command  extra force per entry of model.forces [N]
/// @param[out] force    force per entry of model.forces [N], positive extends
/// @param[out] tau      joint forces (nv), added to
template <class S>
JointForceSums<S> calc_joint_forces(const MechanismModel& model, const VecX<S>& q, const VecX<S>& v,
                                    const VecX<S>& command, VecX<S>& force, VecX<S>& tau);

}  // namespace dockloop
