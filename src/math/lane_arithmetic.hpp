// SIMD arithmetic: every SIMD lane of a register holds one scalar, vector or matrix.
//
// Included by sources that are compiled once per instruction set, with LANES (lanes in a register)
// defined. All code is local to the including source and includes no library: the
// linker could merge inline functions with copies for other instruction sets. Operations are those
// of IEEE 754, one by one. Sums over lanes have one order. Results have the same bits for every
// LANES.
#pragma once

#include "math/lanes.hpp"

namespace dockloop::lanes {
namespace {

typedef double Lanes __attribute__((vector_size(8 * LANES)));
using Mask = decltype(Lanes{} < Lanes{});

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

struct V {
  Lanes x, y, z;
};
inline V operator+(V a, V b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline V operator-(V a, V b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline V operator*(Lanes f, V a) { return {f * a.x, f * a.y, f * a.z}; }
inline Lanes dot(V a, V b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline V cross(V a, V b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// A zero vector or component, without cost.
struct Zero {
  operator Lanes() const { return Lanes{}; }
  operator V() const { return V{}; }
};
inline V operator+(V a, Zero) { return a; }
inline V operator+(Zero, V a) { return a; }
inline Zero operator+(Zero, Zero) { return {}; }
inline Lanes operator+(Lanes a, Zero) { return a; }
inline Zero operator*(Lanes, Zero) { return {}; }
inline Zero operator*(Zero, V) { return {}; }
inline Zero cross(Zero, V) { return {}; }
inline Zero cross(V, Zero) { return {}; }
inline Zero cross(Zero, Zero) { return {}; }

/// Axes renamed y z x, and z x y.
inline V roll(V a) { return {a.y, a.z, a.x}; }
inline V roll_back(V a) { return {a.z, a.x, a.y}; }

/// By columns.
struct M {
  V x, y, z;
};
inline V operator*(const M& m, V a) { return a.x * m.x + a.y * m.y + a.z * m.z; }
inline V turn_back(const M& m, V a) { return {dot(m.x, a), dot(m.y, a), dot(m.z, a)}; }
inline M operator*(const M& a, const M& b) { return {a * b.x, a * b.y, a * b.z}; }
inline M transpose(const M& m) {
  return {{m.x.x, m.y.x, m.z.x}, {m.x.y, m.y.y, m.z.y}, {m.x.z, m.y.z, m.z.z}};
}

/// Symmetric.
struct Sym {
  Lanes xx, yy, zz, xy, xz, yz;
};
inline Sym operator+(Sym a, Sym b) {
  return {a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}
inline Sym roll(Sym s) { return {s.yy, s.zz, s.xx, s.yz, s.xy, s.xz}; }
inline Sym roll_back(Sym s) { return {s.zz, s.xx, s.yy, s.xz, s.yz, s.xy}; }
inline V operator*(const Sym& s, V a) {
  return {s.xx * a.x + s.xy * a.y + s.xz * a.z, s.xy * a.x + s.yy * a.y + s.yz * a.z,
          s.xz * a.x + s.yz * a.y + s.zz * a.z};
}
/// R s R^T
inline Sym turn(const M& R, const Sym& s) {
  const V x = {s.xx, s.xy, s.xz}, y = {s.xy, s.yy, s.yz}, z = {s.xz, s.yz, s.zz};
  const M half = {R * x, R * y, R * z};  // R s
  const M rows = transpose(R);
  const V a = half * rows.x, b = half * rows.y;
  return {a.x, b.y, half.x.z * R.x.z + half.y.z * R.y.z + half.z.z * R.z.z, a.y, a.z, b.z};
}

/// A turn about z.
struct Turn {
  Lanes c, s;
};
inline V operator*(Turn t, V a) { return {t.c * a.x - t.s * a.y, t.s * a.x + t.c * a.y, a.z}; }
inline V turn_back(Turn t, V a) { return {t.c * a.x + t.s * a.y, t.c * a.y - t.s * a.x, a.z}; }
inline Sym turn(Turn t, Sym s) {
  const Lanes cc = t.c * t.c, ss = t.s * t.s, cs = t.c * t.s, between = 2.0 * cs * s.xy;
  return {cc * s.xx - between + ss * s.yy,
          ss * s.xx + between + cc * s.yy,
          s.zz,
          cs * (s.xx - s.yy) + (cc - ss) * s.xy,
          t.c * s.xz - t.s * s.yz,
          t.s * s.xz + t.c * s.yz};
}
inline Turn reverse(Turn t) { return {t.c, -t.s}; }
/// Its angle, from -pi to pi [rad], to rounding: twice the arctangent of at most tan(pi/8), by the
/// rational approximation of the library Cephes (atan.c).
inline Lanes find_angle(Turn t) {
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
struct Cells {
  double (*row)[kGroup];
  int at;
  Lanes get(int i) const { return *reinterpret_cast<const Lanes*>(&row[i][at]); }
  V get_vector(int i) const { return {get(i), get(i + 1), get(i + 2)}; }
  Turn get_turn(int i) const { return {get(i), get(i + 1)}; }
  M get_matrix(int i) const { return {get_vector(i), get_vector(i + 3), get_vector(i + 6)}; }
  Sym get_symmetric(int i) const {
    return {get(i), get(i + 1), get(i + 2), get(i + 3), get(i + 4), get(i + 5)};
  }
  void put(int i, Lanes x) const { *reinterpret_cast<Lanes*>(&row[i][at]) = x; }
  void put(int i, Turn t) const { put(i, t.c), put(i + 1, t.s); }
  void put(int i, V v) const { put(i, v.x), put(i + 1, v.y), put(i + 2, v.z); }
  void put(int i, const M& m) const { put(i, m.x), put(i + 3, m.y), put(i + 6, m.z); }
  void put(int i, const Sym& s) const {
    put(i, s.xx), put(i + 1, s.yy), put(i + 2, s.zz);
    put(i + 3, s.xy), put(i + 4, s.xz), put(i + 5, s.yz);
  }
  void add(int i, Lanes x) const { put(i, get(i) + x); }
  void add(int i, V v) const { add(i, v.x), add(i + 1, v.y), add(i + 2, v.z); }
  void add(int i, const M& m) const { add(i, m.x), add(i + 3, m.y), add(i + 6, m.z); }
  void add(int i, const Sym& s) const {
    add(i, s.xx), add(i + 1, s.yy), add(i + 2, s.zz);
    add(i + 3, s.xy), add(i + 4, s.xz), add(i + 5, s.yz);
  }
};

inline Lanes spread(double x) { return x - Lanes{}; }
inline V spread3(const double* x) { return {spread(x[0]), spread(x[1]), spread(x[2])}; }

/// Sums of rows over the lanes of a group, in one order for every instruction set.
inline void add_lanes(const double (*row)[kGroup], int count, double* sums) {
  for (int i = 0; i < count; ++i) {
    const double* x = row[i];
    sums[i] = ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
  }
}

}  // namespace
}  // namespace dockloop::lanes
