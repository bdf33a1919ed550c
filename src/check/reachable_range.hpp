// How far each independent coordinate can go from home, one at a time, before a loop ends its way,
// and where on this way the first end stop begins.
#pragma once

#include <string>
#include <vector>

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// One end of a range.
struct RangeEnd {
  double value = 0.0;  ///< distance from home [m] or [rad]
  Status status;       ///< why it ends there; ok if nothing stopped the search
  /// Body whose joint comes to an end stop on the way, kBase if none does, and where it begins.
  int stopped_body = kBase;
  double stop = 0.0;  ///< [m] or [rad]
};

struct CoordinateRange {
  std::string coordinate;  ///< body name; of a free joint with .x .y .z .rx .ry .rz (body axes)
  bool is_angle = false;
  RangeEnd lower, upper;
};

/// Of the coordinates that move a loop or have an end stop, from the closed home. The search ends
/// at a full turn or twice the size of the largest loop; without a loop a little beyond the stops.
std::vector<CoordinateRange> find_reachable_ranges(const Mechanism& mechanism);

}  // namespace dockloop
