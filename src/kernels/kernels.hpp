// Which kernel evaluates a mechanism: the generated one if there is one and it was made for this
// mechanism, else none (the general code). README.md in this folder.
#pragma once

#include "kernels/generated_kernel.hpp"

namespace dockloop {

/// @param generated  library that came with the model; may be null
/// @return null: the general code
std::shared_ptr<MechanismKernel> make_kernel(const Mechanism& mechanism,
                                             std::shared_ptr<const KernelLibrary> generated);

/// While it lives, the general code evaluates: for who needs more than a kernel finds.
class WithoutKernel {
 public:
  explicit WithoutKernel(MechanismData<double>& data) : data_(data) { kept_.swap(data.kernel); }
  ~WithoutKernel() { kept_.swap(data_.kernel); }
  WithoutKernel(const WithoutKernel&) = delete;
  WithoutKernel& operator=(const WithoutKernel&) = delete;

 private:
  MechanismData<double>& data_;
  std::shared_ptr<MechanismKernel> kept_;
};

}  // namespace dockloop
