// Where to start so that stated conditions hold at first contact.
//
// Docking standards state misalignments and rates at first contact; after a long approach they
// would be something else. The vehicles are placed with the stated relative state, moved along the
// docking axis until the surfaces just touch, and taken back along their free motion.
#pragma once

#include <array>

#include "docking/scene.hpp"

namespace dockloop {

struct Placement {
  std::array<VehicleParameters, 2> vehicle;  ///< start states; other members as in the scene
  double time_of_contact = 0.0;              ///< [s] after the start, by free motion
  bool touches = true;  ///< false: the surfaces never meet on this line; A and P coincide axially
};

/// @throws ModelError if the scene states no conditions, its chaser cannot move, or the way to them
/// would begin inside the surfaces.
Placement find_placement(const Scene& scene);

}  // namespace dockloop
