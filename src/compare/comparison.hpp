// The form with multipliers (unreduced_form.cpp), to be handed to DockingSim.
#pragma once

#include "sim/equations.hpp"

namespace dockloop {

/// Its equations serve model.level 4; all other settings have those of the core.
const Comparison* get_comparison();

}  // namespace dockloop
