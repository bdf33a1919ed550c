// How the joints of legs move with the coordinates of their platforms.
#pragma once

#include "loops/leg_platforms.hpp"

namespace dockloop {

/// Rates of the joints of legs, where rows of `columns` are other velocities of the tree that are
/// possible. @pre calc_leg_positions
template <class S>
void add_leg_columns(const LoopPlan& plan, const LoopData<S>& loops, MatX<S>& columns);

}  // namespace dockloop
