// How many numbers stand side by side in the groups that math/lane_arithmetic.hpp computes with.
#pragma once

namespace dockloop {

constexpr int kGroup = 8;  ///< lanes of a group, whatever the width of a register

/// Lanes of the widest registers that this processor has: 2, 4 (AVX2) or 8 (AVX-512).
int find_lane_count();

/// The widest of three tables of functions that this processor has. @param widest  lanes at most
template <class Functions>
const Functions& choose_lanes(int widest, const Functions& two, const Functions& four,
                              const Functions& eight) {
  const int lanes = find_lane_count();
  if (lanes >= 8 && widest >= 8) return eight;
  return lanes >= 4 && widest >= 4 ? four : two;
}

}  // namespace dockloop
