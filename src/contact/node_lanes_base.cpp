// Nodes in the lanes that every processor of the platform has, and the choice of wider ones.
#include "contact/node_lanes.hpp"

#define LANES 2
#define FUNCTIONS kBaseFunctions
#include "contact/node_lanes_body.hpp"

namespace dockloop::nodes {

const NodeFunctions& find_node_functions(int widest) {
#ifdef DOCKLOOP_X86_LANES
  return choose_lanes(widest, kBaseFunctions, kAvx2Functions, kAvx512Functions);
#else
  return choose_lanes(widest, kBaseFunctions, kBaseFunctions, kBaseFunctions);
#endif
}

}  // namespace dockloop::nodes
