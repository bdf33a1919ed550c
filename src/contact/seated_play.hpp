// Seated play: possible motion of the passive ring that sits face to face on the active ring.
//
// Petals leave three directions: y, z and roll. The play is the set of all poses without overlap
// that a motion from the centre can attain. If the lateral distance from striker to hook exceeds
// the window of the latches, seated rings may stay without capture.
#pragma once

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"

namespace dockloop {

struct SeatedPlay {
  double overlap = 0.0;  ///< of petals at the centre; above 0 the rings cannot seat there [m]
  double least_roll = 0.0, most_roll = 0.0;        ///< at the centre [rad]
  double least_lateral = 0.0, most_lateral = 0.0;  ///< over directions, without roll [m]
  double striker_opening = 0.0;  ///< largest distance of a striker before its hook [m]
  double striker_offset = 0.0;   ///< largest lateral distance of a striker from its hook [m]
};

/// Method: marching, with the gap as a safe step. Accurate to 0.01 mm; 0.1 s.
/// Limits: no tilt. At every roll, play is star-shaped about the docking axis, as for constraints
/// that repeat with the petals. Motions end at half a turn and at twice the bounding radius.
/// @pre a model of rings
SeatedPlay find_seated_play(const ContactModel& model, const LatchSet& latches);

}  // namespace dockloop
