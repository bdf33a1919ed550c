// Legs in the lanes that every processor of the platform has, and the choice of wider ones.
#include "kernels/leg_lanes.hpp"

#define LANES 2
#define FUNCTIONS kBaseFunctions
#define NAME "2 lanes"
#include "kernels/leg_lanes_body.hpp"

namespace dockloop::legs {

const LegFunctions& find_leg_functions(int widest) {
#ifdef DOCKLOOP_X86_LANES
  const int lanes = find_lane_count();
  if (lanes >= 8 && widest >= 8) return kAvx512Functions;
  if (lanes >= 4 && widest >= 4) return kAvx2Functions;
#endif
  (void)widest;
  return kBaseFunctions;
}

}  // namespace dockloop::legs
