// What dockloop_compare.so carries more than the FMU.
#include "compare/comparison.hpp"

namespace dockloop {

const Comparison* get_fmu_comparison() { return get_comparison(); }

}  // namespace dockloop
