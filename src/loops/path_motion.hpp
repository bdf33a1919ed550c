// Poses and bias accelerations along a path of joints, relative to the body above it.
#pragma once

#include <vector>

#include "tree/tree.hpp"

namespace dockloop {

/// Motion of the end of a path relative to the body above it, with zero joint accelerations.
template <class S>
struct PathBias {
  Vec3<S> w = Vec3<S>::Zero(), alpha = Vec3<S>::Zero(), a = Vec3<S>::Zero();
};

/// @param pose   of the bodies of the path, in the body above
/// @param point  that moves with the last one
template <class S>
PathBias<S> calc_path_bias(const MechanismModel& model, const TreeData<S>& tree,
                           const std::vector<int>& path, const std::vector<Pose<S>>& pose,
                           const Vec3<S>& point) {
  PathBias<S> m;
  Vec3<S> origin = Vec3<S>::Zero();
  for (size_t i = 0; i < path.size(); ++i) {
    const Body& body = model.bodies[path[i]];
    if (i > 0) {
      const Vec3<S> r = pose[i].p - origin;
      m.a += m.alpha.cross(r) + m.w.cross(m.w.cross(r));
    }
    origin = pose[i].p;
    switch (body.joint) {
      case JointType::kRevolute: {
        const Vec3<S> rate = pose[i].R * (cast<S>(body.axis) * tree.v[body.v_index]);
        m.alpha += m.w.cross(rate);
        m.w += rate;
        break;
      }
      case JointType::kPrismatic: {
        const Vec3<S> rate = pose[i].R * (cast<S>(body.axis) * tree.v[body.v_index]);
        m.a += S(2) * m.w.cross(rate);
        break;
      }
      case JointType::kFree: {
        const Vec3<S> u_rel = pose[i].R * tree.v.template segment<3>(body.v_index);
        const Vec3<S> w_rel = pose[i].R * tree.v.template segment<3>(body.v_index + 3);
        m.a += (S(2) * m.w + w_rel).cross(u_rel);
        m.alpha += m.w.cross(w_rel);
        m.w += w_rel;
        break;
      }
      case JointType::kMode:
        break;
    }
  }
  const Vec3<S> arm = point - origin;
  m.a += m.alpha.cross(arm) + m.w.cross(m.w.cross(arm));
  return m;
}

}  // namespace dockloop
