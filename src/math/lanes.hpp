// Number of SIMD lanes in the groups of math/lane_arithmetic.hpp.
#pragma once

namespace dockloop {

constexpr int kGroup = 8;     ///< lanes of a group, whatever the width of a register
constexpr int kSumLanes = 4;  ///< of sums over a group: lanes i and i + 4 add to one number

/// SIMD lanes of the widest registers of this processor: 2, 4 (AVX2) or 8 (AVX-512).
int find_lane_count();

/// The table of functions for the widest registers of this processor. @param widest  largest number
/// of lanes
template <class Functions>
const Functions& choose_lanes(int widest, const Functions& two, const Functions& four,
                              const Functions& eight) {
  const int lanes = find_lane_count();
  if (lanes >= 8 && widest >= 8) return eight;
  return lanes >= 4 && widest >= 4 ? four : two;
}

}  // namespace dockloop
