// Legs, nodes, plates and columns in SIMD lanes. Included once per instruction set, with LANES
// (lanes in a register) defined.
#pragma once

#include "contact/node_lanes_body.hpp"
#include "contact/plate_lanes_body.hpp"
#include "loops/leg_lanes_body.hpp"
#include "math/column_lanes_body.hpp"

namespace dockloop {

/// All functions that are compiled for one instruction set.
struct LaneFunctions {
  legs::LegFunctions legs;
  nodes::NodeFunctions nodes;
  plates::PlateFunctions plates;
  columns::ColumnFunctions columns;
};

extern const LaneFunctions kAvx2Functions, kAvx512Functions;  ///< on x86-64 only

namespace {

constexpr LaneFunctions kFunctions = {legs::kFunctions, nodes::kFunctions, plates::kFunctions,
                                      columns::kFunctions};

}  // namespace
}  // namespace dockloop
