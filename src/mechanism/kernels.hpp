// Which generated code evaluates a mechanism.
#pragma once

#include "mechanism/generated_kernel.hpp"

namespace dockloop {

/// Was a library made for a mechanism, as docking simulations have it?
bool is_made_for(const KernelLibrary& generated, const Mechanism& mechanism);

/// Generated code that was made for this mechanism.
/// @param generated  library that came with the model; may be null
/// @return null: there is none
std::shared_ptr<MechanismKernel> make_generated_kernel(
    const Mechanism& mechanism, std::shared_ptr<const KernelLibrary> generated);

}  // namespace dockloop
