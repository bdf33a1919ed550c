// The scalars for which the algorithms of the core are compiled, in one place.
//
//   double       the product
//   Extended     the oracle of the truth and the tests: twice the digits (math/extended.hpp), where
//                the build asks for it (DOCKLOOP_EXTENDED); portable binaries do without
//   Derivative   exact derivatives with respect to eight inputs at a time (math/dual.hpp)
//
// Eight lanes: 64 bytes of derivatives are a whole number of registers in every vector instruction
// set. A pass costs about seven plain evaluations (with sixteen lanes twelve to sixteen); the 13
// columns of a ring on legs take two passes, those of a planar mechanism one.
// Algorithms are templates with their definitions in .cpp files; each such file ends with
//   #define DOCK_INSTANTIATE(S) template void calc_something<S>(...);
//   DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
// Those that programs with a scalar of their own compile again (the generator, the operation
// counter) are in a header *_body.hpp, which a .cpp file includes; such a program defines the list
// before.
#pragma once

#include "math/dual.hpp"
#include "math/extended.hpp"

namespace dockloop {

constexpr int kLanes = 8;
using Derivative = Dual<kLanes>;

/// Plain value of a scalar: what a Status, a margin or a print-out shows.
inline double to_double(double x) { return x; }
inline double to_double(const Extended& x) { return x.high; }
template <int N>
double to_double(const Dual<N>& x) {
  return x.value;
}

}  // namespace dockloop

#ifndef DOCK_INSTANTIATE_FOR_SCALARS
#ifdef DOCKLOOP_EXTENDED
#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(double) X(Extended) X(Derivative)
#else
#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(double) X(Derivative)
#endif
#endif
