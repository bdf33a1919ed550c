// The scalars for which the algorithms of the core are compiled, in one place.
//
//   double       the FMU
//   Extended     reference solutions of `dockloop truth` and tests: twice the digits
//                (math/extended.hpp); src/compare compiles the algorithms for it, the core does not
//   Derivative   exact derivatives with respect to eight inputs at a time (math/dual.hpp)
//
// Eight directions: 64 bytes of derivatives fill a whole number of registers in every vector
// instruction set. A pass costs about seven plain evaluations (with sixteen directions twelve to
// sixteen). The 13 columns of a ring on legs take two passes, a planar mechanism takes one.
// Algorithms are templates with their definitions in .cpp files; each such file ends with
//   #define DOCK_INSTANTIATE(S) template void calc_something<S>(...);
//   DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
// Some programs compile algorithms for another scalar (src/compare, src/codegen, the operation
// counter). Such algorithms are in a header *_body.hpp, which a .cpp file includes. That file
// defines the list of scalars before.
#pragma once

#include "math/dual.hpp"
#include "math/extended.hpp"

namespace dockloop {

constexpr int kLanes = 8;
using Derivative = Dual<kLanes>;

/// Plain value of a scalar, for a Status, a margin or a print-out.
inline double to_double(double x) { return x; }
inline double to_double(const Extended& x) { return x.high; }
template <int N>
double to_double(const Dual<N>& x) {
  return x.value;
}

}  // namespace dockloop

#ifndef DOCK_INSTANTIATE_FOR_SCALARS
#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(double) X(Derivative)
#endif
