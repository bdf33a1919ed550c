// Lengths and speeds by which phases and outcomes are judged.
#pragma once

#include <algorithm>

namespace dockloop {

// Of guide rings of 1.2 m; assumptions.
constexpr double kReboundGap = 0.05;    ///< [m]
constexpr double kSeatedGap = 1e-3;     ///< [m]
constexpr double kPassedDepth = 0.05;   ///< [m]
constexpr double kAlignedSpeed = 1e-3;  ///< [m/s]
constexpr double kRingRadius = 0.6;     ///< of these rings [m]

struct PhaseLimits {
  double rebound_gap = kReboundGap;      ///< rebound: gap above this limit and increasing [m]
  double seated_gap = kSeatedGap;        ///< largest gap of seated rings [m]
  double passed_depth = kPassedDepth;    ///< P behind the ring without contact: miss [m]
  double aligned_speed = kAlignedSpeed;  ///< at rest below [m/s]
};

/// For hardware of another size: smaller hardware has smaller limits in the same ratio.
/// @param radius  bounding radius of the surfaces [m]; 0: none
inline PhaseLimits find_phase_limits(double radius) {
  const double scale = radius > 0.0 ? std::min(1.0, radius / kRingRadius) : 1.0;
  return {scale * kReboundGap, scale * kSeatedGap, scale * kPassedDepth, scale * kAlignedSpeed};
}

}  // namespace dockloop
