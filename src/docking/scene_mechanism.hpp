// The mechanism of a scene as its simulation has it.
#pragma once

#include "docking/scene.hpp"
#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// As make_docking_model() puts it on its chaser; the chaser's mass does not matter.
Mechanism make_scene_mechanism(const Scene& scene);

}  // namespace dockloop
