// Seated play: how far the passive ring can move while it sits face to face on the active one.
//
// Petals leave it three ways to go: y, z and roll. Everything it reaches from the centre without a
// surface in another one is its play. Where strikers stand beside their hooks by more than the
// window of the latches, rings can sit there and not be caught.
#pragma once

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"

namespace dockloop {

struct SeatedPlay {
  double overlap = 0.0;  ///< of petals at the centre; above 0 the rings cannot seat there [m]
  double least_roll = 0.0, most_roll = 0.0;        ///< at the centre [rad]
  double least_lateral = 0.0, most_lateral = 0.0;  ///< by direction, without roll [m]
  double striker_opening = 0.0;  ///< largest distance of a striker before its hook [m]
  double striker_offset = 0.0;   ///< largest lateral distance of a striker from its hook [m]
};

/// Found by marching: the gap is a way that is surely free. Accurate to 0.01 mm; 0.1 s.
/// Limits: no tilt; at every roll, play is what can be seen from the docking axis (constraints that
/// repeat with the petals leave nothing else); ways end at half a turn and at twice the reach.
/// @pre a model of rings
SeatedPlay find_seated_play(const ContactModel& model, const LatchSet& latches);

}  // namespace dockloop
