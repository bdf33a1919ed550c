// Plates in the lanes that every processor of the platform has, and the choice of wider ones.
#include "contact/plate_lanes.hpp"

#define LANES 2
#define FUNCTIONS kBaseFunctions
#include "contact/plate_lanes_body.hpp"

namespace dockloop::plates {

const PlateFunctions& find_plate_functions(int widest) {
#ifdef DOCKLOOP_X86_LANES
  return choose_lanes(widest, kBaseFunctions, kAvx2Functions, kAvx512Functions);
#else
  return choose_lanes(widest, kBaseFunctions, kBaseFunctions, kBaseFunctions);
#endif
}

}  // namespace dockloop::plates
