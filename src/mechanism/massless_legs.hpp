// Legs without mass: the masses of their parts go to the bodies that they connect.
//
// A leg is what one loop determines between two bodies that are not determined by loops: its foot
// is the origin of its first joint, its head the cut. A part of mass m whose centre of mass lies at
// the fraction s of the way from foot to head, at home, becomes m (1 - s) at the foot and m s at
// the head (s cut to 0..1). Total mass and first moment along the leg are kept; what is lost is the
// inertia of a leg that swings or turns about itself, and its first moment across.
#pragma once

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

struct MasslessLegs {
  MechanismModel model;  ///< the same mechanism, legs without mass
  VehicleBody on_base;   ///< what the feet put on the base, axes of B; no mass if there are none
};

/// @throws ModelError naming a body that is no part of such a leg
MasslessLegs make_legs_massless(const MechanismModel& mechanism);

}  // namespace dockloop
