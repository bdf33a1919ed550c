// Closest points of two plates in SIMD lanes: the edges of one against the edges of the other, and
// the face of each against the edges of the other.
//
// The problem and its candidates are those of find_plate_plate() (primitives.hpp), which adds the
// last one, face against face. Compiled for several instruction sets like the legs
// (math/lane_arithmetic.hpp).
#pragma once

#include "math/lanes.hpp"

namespace dockloop::plates {

/// A flat plate, as in primitives.hpp.
struct PlateNumbers {
  double corner[4][3], edge[4][3], inward[4][3];
  double centre[3], normal[3];
};

/// The least candidate: a point on each plate [m] and the regularised square [m2].
struct PlateCandidate {
  double first[3], second[3], square;
};

struct PlateFunctions {
  PlateCandidate (*find)(const PlateNumbers& first, const PlateNumbers& second, double mu);
};

/// Functions for the widest registers of this processor. @param widest  largest number of lanes
const PlateFunctions& find_plate_functions(int widest = kGroup);

}  // namespace dockloop::plates
