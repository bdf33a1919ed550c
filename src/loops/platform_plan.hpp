// Which blocks of a plan are legs of platforms, and which are their gears.
#pragma once

#include <vector>

#include "loops/loop_plan.hpp"

namespace dockloop {

/// Legs and gears of platforms, and the bodies that remain in the tree. Reorders the blocks: legs
/// after all others, gears last. @param home  poses of all bodies in the base
void find_platforms(const MechanismModel& model, const std::vector<Pose<double>>& home,
                    LoopPlan& plan);

}  // namespace dockloop
