// Nodes in the lanes that every processor of the platform has, and the choice of wider ones.
#include "contact/node_lanes.hpp"

#define LANES 2
#define FUNCTIONS kBaseFunctions
#include "contact/node_lanes.inl"

namespace dockloop::nodes {

const NodeFunctions& find_node_functions(int widest) {
#ifdef DOCKLOOP_X86_LANES
  if (widest >= 8 && __builtin_cpu_supports("avx512f")) return kAvx512Functions;
  if (widest >= 4 && __builtin_cpu_supports("avx2")) return kAvx2Functions;
#endif
  (void)widest;
  return kBaseFunctions;
}

}  // namespace dockloop::nodes
