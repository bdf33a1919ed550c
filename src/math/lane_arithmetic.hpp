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

/// Sums of rows over the lanes of a group, in one order for every instruction set.
inline void add_lanes(const double (*row)[kGroup], int count, double* sums) {
  for (int i = 0; i < count; ++i) {
    const double* x = row[i];
    sums[i] = ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
  }
}

}  // namespace
}  // namespace dockloop::lanes
