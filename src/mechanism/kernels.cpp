// The choice of generated code; see kernels.hpp.
#include "mechanism/kernels.hpp"

namespace dockloop {

bool is_made_for(const KernelLibrary& generated, const Mechanism& mechanism) {
  return generated.hash() == find_kernel_hash(mechanism, KernelScope::kDocking);
}

std::shared_ptr<MechanismKernel> make_generated_kernel(
    const Mechanism& mechanism, std::shared_ptr<const KernelLibrary> generated) {
  if (!generated || !is_made_for(*generated, mechanism)) return {};
  return std::make_shared<GeneratedKernel>(mechanism, std::move(generated));
}

}  // namespace dockloop
