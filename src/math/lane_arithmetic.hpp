// SIMD arithmetic: plain_vectors.hpp with a register of which every SIMD lane holds one number.
//
// Included by sources that are compiled once per instruction set, with LANES (lanes in a register)
// defined. Operations are those of IEEE 754, one by one. Sums over lanes have one order. Results
// have the same bits for every LANES.
#pragma once

#include "math/lanes.hpp"
#include "math/plain_vectors.hpp"

namespace dockloop::lanes {
namespace {

typedef double Lanes __attribute__((vector_size(8 * LANES)));
using Mask = decltype(Lanes{} < Lanes{});
using V = Vector<Lanes>;
using M = Matrix<Lanes>;

inline bool has_any(Mask mask) {
  long long any = 0;
  for (int i = 0; i < LANES; ++i) any |= mask[i];
  return any != 0;
}

inline Lanes take_root(Lanes x) {
  Lanes root;
  for (int i = 0; i < LANES; ++i) root[i] = __builtin_sqrt(x[i]);
  return root;
}

inline Lanes spread(double x) { return x - Lanes{}; }
inline V spread3(const double* x) { return {spread(x[0]), spread(x[1]), spread(x[2])}; }
template <>
struct Spread<Lanes> {
  static Lanes of(double x) { return spread(x); }
};

/// Angle of a turn, from -pi to pi [rad], to rounding: twice the arctangent of at most tan(pi/8),
/// by the rational approximation of the library Cephes (atan.c).
inline Lanes find_angle(Turn<Lanes> t) {
  const Lanes c = t.c < 0.0 ? -t.c : t.c, s = t.s < 0.0 ? -t.s : t.s;
  const auto steep = s > c;
  const Lanes x = (steep ? c : s) / (1.0 + (steep ? s : c)), z = x * x;
  Lanes over = -8.750608600031904122785e-1 * z - 1.615753718733365076637e1;
  over = over * z - 7.500855792314704667340e1;
  over = over * z - 1.228866684490136173410e2;
  over = over * z - 6.485021904942025371773e1;
  Lanes under = z + 2.485846490142306297962e1;
  under = under * z + 1.650270098316988542046e2;
  under = under * z + 4.328810604912902668951e2;
  under = under * z + 4.853903996359136964868e2;
  under = under * z + 1.945506571482613964425e2;
  constexpr double kPi = 3.14159265358979323846;
  const Lanes least = 2.0 * (x + x * z * over / under);
  const Lanes first = steep ? 0.5 * kPi - least : least;
  const Lanes half = t.c < 0.0 ? kPi - first : first;
  return t.s < 0.0 ? -half : half;
}

/// Rows of one register.
struct Register {
  using Number = Lanes;
  double (*row)[kGroup];
  int at;
  Lanes get(int i) const { return *reinterpret_cast<const Lanes*>(&row[i][at]); }
  void put(int i, Lanes x) const { *reinterpret_cast<Lanes*>(&row[i][at]) = x; }
};
using Cells = CellsOf<Register>;

/// Sums of which every lane of a register adds to its own part.
struct SumRegister {
  using Number = Lanes;
  double (*row)[kSumLanes];
  int at;  ///< of the register in its group
  void add(int i, Lanes x) const {
    constexpr int kAtOnce = LANES < kSumLanes ? LANES : kSumLanes;
    typedef double Part __attribute__((vector_size(8 * kAtOnce)));
    Part part[LANES / kAtOnce];
    __builtin_memcpy(part, &x, sizeof x);
    Part& sum = *reinterpret_cast<Part*>(&row[i][at % kSumLanes]);
    for (const Part& each : part) sum += each;
  }
};
using Sums = SumsOf<SumRegister>;

/// Adds up the parts of each sum, in one order for every instruction set.
inline void add_lanes(const double (*row)[kSumLanes], int count, double* sums) {
  int i = 0;
#if LANES >= 4
  typedef double Four __attribute__((vector_size(32)));
  for (; i + 4 <= count; i += 4) {  // four rows at once, turned into columns
    const Four* x = reinterpret_cast<const Four*>(row[i]);
    const Four a = __builtin_shufflevector(x[0], x[1], 0, 4, 2, 6);
    const Four b = __builtin_shufflevector(x[0], x[1], 1, 5, 3, 7);
    const Four c = __builtin_shufflevector(x[2], x[3], 0, 4, 2, 6);
    const Four d = __builtin_shufflevector(x[2], x[3], 1, 5, 3, 7);
    const Four even =
        __builtin_shufflevector(a, c, 0, 1, 4, 5) + __builtin_shufflevector(a, c, 2, 3, 6, 7);
    const Four odd =
        __builtin_shufflevector(b, d, 0, 1, 4, 5) + __builtin_shufflevector(b, d, 2, 3, 6, 7);
    const Four sum = even + odd;
    __builtin_memcpy(sums + i, &sum, sizeof sum);
  }
#endif
  for (; i < count; ++i) sums[i] = (row[i][0] + row[i][2]) + (row[i][1] + row[i][3]);
}

}  // namespace
}  // namespace dockloop::lanes
