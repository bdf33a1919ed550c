// How many numbers stand side by side in the groups that math/lane_arithmetic.hpp computes with.
#pragma once

namespace dockloop {

constexpr int kGroup = 8;  ///< lanes of a group, whatever the width of a register

/// Lanes of the widest registers that this processor has: 2, 4 (AVX2) or 8 (AVX-512).
int find_lane_count();

}  // namespace dockloop
