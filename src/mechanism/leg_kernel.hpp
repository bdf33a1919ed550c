// A ring on legs: legs eliminated one by one as apparent masses at their tips, eight at once.
//
// For one platform with a free joint on one root (the base, at rest or driven, or a free vehicle),
// held by nothing but R2P1R3 and R1R2R3 legs. Then what the general reduction does to the tree of
// all bodies is a sum over legs of a 3 x 3 apparent inertia and a force at the tip, and, if the
// root moves, of what the leg carries along with it: README.md in this folder. Legs of a kind fill
// the lanes of vector registers (leg_lanes.hpp).
#pragma once

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// A kernel, or null if the mechanism is not of this kind.
/// @param widest  lanes to use at most, for tests; results do not depend on it
std::shared_ptr<MechanismKernel> make_leg_kernel(const Mechanism& mechanism, int widest = 8);

}  // namespace dockloop
