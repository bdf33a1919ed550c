// Legs in the lanes that every processor of the platform has, and the choice of wider ones.
#include "loops/leg_lanes.hpp"

#define LANES 2
#define FUNCTIONS kBaseFunctions
#define NAME "2 lanes"
#include "loops/leg_lanes_body.hpp"

namespace dockloop::legs {

const LegFunctions& find_leg_functions(int widest) {
#ifdef DOCKLOOP_X86_LANES
  return choose_lanes(widest, kBaseFunctions, kAvx2Functions, kAvx512Functions);
#else
  return choose_lanes(widest, kBaseFunctions, kBaseFunctions, kBaseFunctions);
#endif
}

}  // namespace dockloop::legs
