// Start position of frame O: a function of scene and parameters alone.
#pragma once

#include <array>

#include "docking/scene.hpp"
#include "math/rotation.hpp"

namespace dockloop {

/// Near the docking interface of the target (else at the chaser), in N [m]. Whole metres from the
/// vehicle's position, so that differences from it are exact even at orbital distances.
inline Vec3<double> find_frame_origin(const Scene& scene,
                                      const std::array<VehicleParameters, 2>& parameters) {
  const VehicleParameters& p = parameters[scene.has_target ? kTarget : kChaser];
  Vec3<double> offset = Vec3<double>::Zero();
  if (scene.has_target) offset = quat_to_matrix<double>(p.attitude) * p.interface_position;
  return p.position + Vec3<double>(offset.array().round());
}

}  // namespace dockloop
