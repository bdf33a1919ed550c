// Start state for prescribed conditions at first contact.
//
// Docking standards prescribe misalignments and rates at first contact. A long approach changes
// these values. The vehicles are placed with the prescribed relative state and moved along the
// docking axis until the surfaces just touch. Their free motion, backwards in time, gives the start
// state.
#pragma once

#include <array>
#include <string>

#include "docking/scene.hpp"

namespace dockloop {

struct Placement {
  std::array<VehicleParameters, 2> vehicle;  ///< start states; other members as in the scene
  double time_of_contact = 0.0;              ///< [s] after the start, by free motion
  bool touches = true;  ///< false: the surfaces never meet on this line; A and P coincide axially
};

/// @throws ModelError if the scene has no such conditions, its chaser is fixed, or the surfaces
/// overlap at the start.
Placement find_placement(const Scene& scene);

/// Parameters can be changed after a scene was placed. Its conditions at first contact then hold
/// for the old values.
struct Misplacement {
  std::string names;      ///< of the changed parameters, with commas; empty: nothing is off
  double distance = 0.0;  ///< of P from where it had to start, relative to A [m]; infinite: nowhere
};

/// @param now  with the start states of the scene, else nothing is off
Misplacement find_misplacement(const Scene& scene, const std::array<VehicleParameters, 2>& now);

}  // namespace dockloop
