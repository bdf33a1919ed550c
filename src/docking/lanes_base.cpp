// The lanes that every processor of the platform has, and the choice of wider ones.
#define LANES 2
#include <algorithm>

#include "docking/lanes_body.hpp"

namespace dockloop {
namespace {

const LaneFunctions& find_functions([[maybe_unused]] int widest) {
#ifdef DOCKLOOP_X86_LANES
  const int lanes = std::min(widest, find_lane_count());
  if (lanes >= 8) return kAvx512Functions;
  if (lanes >= 4) return kAvx2Functions;
#endif
  return kFunctions;
}

}  // namespace

const legs::LegFunctions& legs::find_leg_functions(int widest) {
  return find_functions(widest).legs;
}

const nodes::NodeFunctions& nodes::find_node_functions(int widest) {
  return find_functions(widest).nodes;
}

const plates::PlateFunctions& plates::find_plate_functions(int widest) {
  return find_functions(widest).plates;
}

const columns::ColumnFunctions& columns::find_column_functions(int widest) {
  return find_functions(widest).columns;
}

}  // namespace dockloop
