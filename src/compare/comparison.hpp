// All methods for comparison, to be handed to DockingSim.
#pragma once

#include "sim/comparison.hpp"

namespace dockloop {

const Comparison* get_comparison();

}  // namespace dockloop
