// A spring that only pushes, with damping that never pulls: for contacts and end stops.
//
// The elastic force is C1 in the depth (a parabolic toe, then linear) and has a closed potential;
// damping is a factor on it, so force and dissipation vanish together at depth 0.
#pragma once

#include <algorithm>

namespace dockloop {

/// Elastic force [N] and the energy stored [J].
template <class S>
struct Elastic {
  S force, energy;
};

/// Spring with a parabolic toe: force k d^2/(2 eps) below d = eps, k (d - eps/2) above; C1.
template <class S>
Elastic<S> calc_toe_spring(const S& depth, const S& stiffness, const S& toe) {
  if (depth <= S(0)) return {S(0), S(0)};
  if (depth < toe) {
    return {stiffness * depth * depth / (S(2) * toe),
            stiffness * depth * depth * depth / (S(6) * toe)};
  }
  const S d = depth - toe / S(2);
  return {stiffness * d, stiffness * (d * d / S(2) + toe * toe / S(24))};
}

/// Damped force F_el max(0, 1 + lambda d'): never pulls. Dissipates (F - F_el) d' >= 0.
template <class S>
S calc_damped_force(const S& elastic, const S& lambda, const S& rate) {
  return elastic * std::max<S>(S(0), S(1) + lambda * rate);
}

}  // namespace dockloop
