// The FMU contains no methods for comparison.
#include "sim/solver_methods.hpp"

namespace dockloop {

const Comparison* get_fmu_comparison() { return nullptr; }

}  // namespace dockloop
