// The mechanism of a scene, as in the simulation.
#pragma once

#include "docking/scene.hpp"
#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// The mechanism of make_docking_model(), on the chaser. The mass of the chaser has no effect.
Mechanism make_scene_mechanism(const Scene& scene);

}  // namespace dockloop
