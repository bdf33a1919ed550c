// All loop equations at once: which are redundant, and which coordinates are best independent.
//
// The loop-by-loop method trusts its table: so many equations, so many dependent joints. Here the
// whole matrix of all equations over all joints, made dimensionless, is looked at instead, with
// orthogonal factorisations. Used when a mechanism is set up and when a run comes near a pose where
// its independent coordinates stop being independent; allocates freely.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "loops/loop_plan.hpp"
#include "tree/tree.hpp"

namespace dockloop {

/// Find equations that follow from others, at home and wherever the mechanism can move from there,
/// and take them out: Loop::redundant is filled, and of the joints listed as dependent those that
/// nothing determines become independent.
/// @return one sentence for each loop that lost equations
/// @throws ModelError if the table lists fewer dependent joints than the equations determine
std::vector<std::string> remove_redundancy(MechanismModel& model);

/// Dependent joints of every loop.
using Dependents = std::vector<std::vector<int>>;

/// The choice of dependent joints that keeps the loops farthest from singular at this pose, if it
/// is much better than the present one. Free joints always stay independent.
/// @param q  all coordinates, loops closed
std::optional<Dependents> find_better_dependents(const MechanismModel& model,
                                                 const std::vector<double>& q);

/// A choice is changed when its smallest singular value is below this part of the best one's.
constexpr double kChangeBelow = 0.3;

}  // namespace dockloop
