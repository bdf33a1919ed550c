// The branch on which a leg stands, for any scalar.
#pragma once

#include <cmath>
#include <limits>

#include "loops/leg_geometry.hpp"
#include "math/scalar.hpp"

namespace dockloop {

template <class S>
double choose_branch(const MechanismModel& model, const ClosedForm& form, const Vec3<S>& L,
                     const VecX<S>& q, double size, int elbow_given, LegBranch& branch) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const int elbow : {1, -1}) {
    if (elbow_given != 0 && elbow != elbow_given) continue;
    for (const int flip : {1, -1}) {
      const LegSolution<S> leg = solve_leg<S>(form.kind, form.shape, {elbow, flip}, L);
      if (leg.code != StatusCode::kOk) continue;
      double distance = 0.0;
      for (size_t i = 0; i < form.joint.size(); ++i) {
        const Body& body = model.bodies[form.joint[i].body];
        const double at = to_double(q[body.q_index]);
        if (body.joint == JointType::kPrismatic) {
          distance = std::max(distance, std::abs(to_double(leg.slide) - at) / size);
          continue;
        }
        S c, s;
        find_joint_angle<S>(form.joint[i], leg.c[i], leg.s[i], c, s);
        distance = std::max(distance,
                            find_length(to_double(c) - std::cos(at), to_double(s) - std::sin(at)));
      }
      if (distance < nearest) {
        nearest = distance;
        branch = {elbow, flip};
      }
    }
  }
  return nearest;
}

#define DOCK_INSTANTIATE(S)                                                                  \
  template double choose_branch<S>(const MechanismModel&, const ClosedForm&, const Vec3<S>&, \
                                   const VecX<S>&, double, int, LegBranch&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
