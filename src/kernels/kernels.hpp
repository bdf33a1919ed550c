// Which kernel a mechanism gets; see dynamics/mechanism_kernel.hpp for what a kernel is.
#pragma once

#include "kernels/leg_kernel.hpp"

namespace dockloop {

/// The fastest kernel there is for a mechanism; null if only the general code serves it.
inline std::shared_ptr<MechanismKernel> make_kernel(const Mechanism& mechanism) {
  return make_leg_kernel(mechanism);
}

}  // namespace dockloop
