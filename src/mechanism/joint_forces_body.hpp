// Forces that act in joints.
#pragma once

#include "math/one_sided_spring.hpp"
#include "math/scalar.hpp"
#include "mechanism/joint_forces.hpp"

namespace dockloop {
namespace {

/// Force of a stop on its own depth, never negative.
template <class S>
S calc_stop(const EndStops& stops, const S& depth, const S& depth_rate, JointForceSums<S>& sums) {
  if (!(depth > S(0))) return S(0);
  const Elastic<S> elastic = calc_toe_spring<S>(depth, S(stops.stiffness), S(stops.toe));
  const S force = calc_damped_force<S>(elastic.force, S(stops.damping), depth_rate);
  sums.energy += elastic.energy;
  sums.dissipation += (force - elastic.force) * depth_rate;
  return force;
}

}  // namespace

template <class S>
JointForceSums<S> calc_joint_forces(const MechanismModel& model, const VecX<S>& q, const VecX<S>& v,
                                    const VecX<S>& command, VecX<S>& force, VecX<S>& tau) {
  JointForceSums<S> sums;
  for (size_t i = 0; i < model.forces.size(); ++i) {
    const JointForce& law = model.forces[i];
    const Body& body = model.bodies[law.body];
    const S x = q[body.q_index] - S(law.rest), rate = v[body.v_index];
    S total = S(law.preload) - S(law.stiffness) * x - S(law.damping) * rate;
    sums.energy += S(0.5 * law.stiffness) * x * x - S(law.preload) * x;
    sums.dissipation += S(law.damping) * rate * rate;
    if (law.stops.present) {
      total += calc_stop<S>(law.stops, S(law.stops.lower) - q[body.q_index], -rate, sums);
      total -= calc_stop<S>(law.stops, q[body.q_index] - S(law.stops.upper), rate, sums);
    }
    total += command[static_cast<int>(i)];
    sums.command_power += command[static_cast<int>(i)] * rate;
    force[static_cast<int>(i)] = total;
    tau[body.v_index] += total;
  }
  return sums;
}

#define DOCK_INSTANTIATE(S)                        \
  template JointForceSums<S> calc_joint_forces<S>( \
      const MechanismModel&, const VecX<S>&, const VecX<S>&, const VecX<S>&, VecX<S>&, VecX<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
