// The form of the equations in which multipliers hold the loops, for one simulation.
#pragma once

#include "sim/comparison.hpp"

namespace dockloop {

std::unique_ptr<UnreducedForm> make_unreduced_form(DockingSim::Impl& sim);

}  // namespace dockloop
