// Legs, nodes, plates and columns in the lanes that every processor of the platform has, and the
// choice of wider ones.
#define LANES 2
#define FUNCTIONS kBaseFunctions
#define NAME "2 lanes"
#include "contact/node_lanes_body.hpp"
#include "contact/plate_lanes_body.hpp"
#include "loops/leg_lanes_body.hpp"
#include "math/column_lanes_body.hpp"

#ifdef DOCKLOOP_X86_LANES
#define WIDER kAvx2Functions, kAvx512Functions
#else
#define WIDER kBaseFunctions, kBaseFunctions
#endif

namespace dockloop {

const legs::LegFunctions& legs::find_leg_functions(int widest) {
  return choose_lanes(widest, kBaseFunctions, WIDER);
}

const nodes::NodeFunctions& nodes::find_node_functions(int widest) {
  return choose_lanes(widest, kBaseFunctions, WIDER);
}

const columns::ColumnFunctions& columns::find_column_functions(int widest) {
  return choose_lanes(widest, kBaseFunctions, WIDER);
}

const plates::PlateFunctions& plates::find_plate_functions(int widest) {
  return choose_lanes(widest, kBaseFunctions, WIDER);
}

}  // namespace dockloop
