// Which kernel evaluates a mechanism; README.md in this folder.
#pragma once

#include "mechanism/generated_kernel.hpp"
#include "mechanism/leg_kernel.hpp"

namespace dockloop {

/// Was a library made for a mechanism, as docking simulations have it?
bool is_made_for(const KernelLibrary& generated, const Mechanism& mechanism);

/// The generated one if there is one and it was made for this mechanism, else legs side by side if
/// it is a ring on such legs.
/// @param generated  library that came with the model; may be null
/// @return null: the general code
std::shared_ptr<MechanismKernel> make_kernel(const Mechanism& mechanism,
                                             std::shared_ptr<const KernelLibrary> generated);

}  // namespace dockloop
