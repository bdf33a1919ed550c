// The choice of a kernel; see kernels.hpp.
#include "kernels/kernels.hpp"

namespace dockloop {

std::shared_ptr<MechanismKernel> make_kernel(const Mechanism& mechanism,
                                             std::shared_ptr<const KernelLibrary> generated) {
  if (generated && generated->hash() == find_kernel_hash(mechanism, KernelScope::kDocking)) {
    return std::make_shared<GeneratedKernel>(mechanism, std::move(generated));
  }
  return make_leg_kernel(mechanism);
}

}  // namespace dockloop
