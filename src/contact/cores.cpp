// Bounds of cores.
#include "contact/cores.hpp"

#include "math/dock_assert.hpp"

namespace dockloop {

bool is_annulus(const Core& core) {
  const std::vector<Profile::Node>& node = core.profile.node;
  return core.kind == CoreKind::kRevolution && node.size() == 2 && node[0].x == node[1].x &&
         std::min(node[0].r, node[1].r) > 0.0 && core.axis.p.isZero(0.0) &&
         core.axis.R.isIdentity(0.0);
}

Annulus<double> get_annulus(const Core& core) {
  DOCK_ASSERT(is_annulus(core));
  const std::vector<Profile::Node>& node = core.profile.node;
  return {node[0].x, std::min(node[0].r, node[1].r), std::max(node[0].r, node[1].r)};
}

CoreSphere find_sphere(const Core& core) {
  switch (core.kind) {
    case CoreKind::kPoint:
      break;
    case CoreKind::kSegment:
      return {(core.point + core.end) / 2.0, (core.end - core.point).norm() / 2.0};
    case CoreKind::kPlate:
      return {core.plate.centre, core.plate.radius};
    case CoreKind::kRevolution: {
      double radius = 0.0;
      for (const Profile::Node& node : core.profile.node) {
        radius = std::max(radius, find_length(node.x, node.r));
      }
      return {core.axis.p, radius};
    }
  }
  return {core.point, 0.0};
}

ProfileBox find_box(const Profile& profile) {
  const Profile::Node& first = profile.node.at(0);
  ProfileBox box{first.x, first.x, first.r, first.r};
  for (const Profile::Node& node : profile.node) {
    box.x_low = std::min(box.x_low, node.x);
    box.x_high = std::max(box.x_high, node.x);
    box.r_low = std::min(box.r_low, node.r);
    box.r_high = std::max(box.r_high, node.r);
  }
  return box;
}

double find_bounding_radius(const std::vector<Core>& cores, int body) {
  double radius = 0.0;
  const auto include = [&](const Vec3<double>& point, double rounding) {
    radius = std::max(radius, point.norm() + rounding);
  };
  for (const Core& core : cores) {
    if (core.body != body) continue;
    const CoreSphere sphere = find_sphere(core);
    switch (core.kind) {
      case CoreKind::kPoint:
        include(core.point, core.rounding);
        break;
      case CoreKind::kSegment:
        include(core.point, core.rounding);
        include(core.end, core.rounding);
        break;
      case CoreKind::kPlate:
        for (const Vec3<double>& corner : core.plate.corner) include(corner, core.rounding);
        break;
      case CoreKind::kRevolution:
        include(sphere.centre, sphere.radius + core.rounding);
        break;
    }
  }
  return radius;
}

}  // namespace dockloop
