// Number of SIMD lanes in the groups of math/lane_arithmetic.hpp.
#pragma once

namespace dockloop {

constexpr int kGroup = 8;     ///< lanes of a group, whatever the width of a register
constexpr int kSumLanes = 4;  ///< of sums over a group: lanes i and i + 4 add to one number

/// SIMD lanes of the widest registers of this processor: 2, 4 (AVX2) or 8 (AVX-512).
int find_lane_count();

}  // namespace dockloop
