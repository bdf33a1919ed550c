// Vectors, matrices and rotations of any number type: double, dual number, or a register of SIMD
// lanes.
//
// Operands may have different number types: constants can be plain if other operands have
// derivatives. A `Zero` has no cost. All code is local to the including source and includes no
// library: the linker could merge inline functions with copies for other instruction sets.
#pragma once

namespace dockloop::lanes {
namespace {

/// Square root of a double; other number types define `sqrt`.
inline double take_root(double x) { return __builtin_sqrt(x); }
template <class T>
T take_root(const T& x) {
  return sqrt(x);
}

/// A plain number converted to type P: the same value, in every SIMD lane.
template <class P>
struct Spread {
  static const P& of(const P& x) { return x; }
};

template <class T>
struct Vector {
  T x, y, z;
};

/// A zero vector or number, without cost.
struct Zero {};
template <class T>
T operator+(const T& a, Zero) {
  return a;
}
template <class T>
T operator+(Zero, const T& a) {
  return a;
}
inline Zero operator+(Zero, Zero) { return {}; }
template <class T>
Zero operator*(const T&, Zero) {
  return {};
}
template <class T>
Zero operator*(Zero, const Vector<T>&) {
  return {};
}

/// What an operation on numbers of two kinds returns.
template <class A, class B>
using Mix = decltype(A{} * B{});

template <class A, class B>
Vector<Mix<A, B>> operator+(const Vector<A>& a, const Vector<B>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class A, class B>
Vector<Mix<A, B>> operator-(const Vector<A>& a, const Vector<B>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class F, class A>
Vector<Mix<F, A>> operator*(const F& f, const Vector<A>& a) {
  return {f * a.x, f * a.y, f * a.z};
}
template <class A, class B>
Mix<A, B> dot(const Vector<A>& a, const Vector<B>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class A, class B>
Vector<Mix<A, B>> cross(const Vector<A>& a, const Vector<B>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
Zero cross(Zero, const Vector<T>&) {
  return {};
}
template <class T>
Zero cross(const Vector<T>&, Zero) {
  return {};
}
inline Zero cross(Zero, Zero) { return {}; }

/// Axes renamed y z x, and z x y.
template <class T>
Vector<T> roll(const Vector<T>& a) {
  return {a.y, a.z, a.x};
}
template <class T>
Vector<T> roll_back(const Vector<T>& a) {
  return {a.z, a.x, a.y};
}

/// By columns.
template <class T>
struct Matrix {
  Vector<T> x, y, z;
};
template <class A, class B>
Vector<Mix<A, B>> operator*(const Matrix<A>& m, const Vector<B>& a) {
  return a.x * m.x + a.y * m.y + a.z * m.z;
}
template <class A, class B>
Vector<Mix<A, B>> turn_back(const Matrix<A>& m, const Vector<B>& a) {
  return {dot(m.x, a), dot(m.y, a), dot(m.z, a)};
}
template <class A, class B>
Matrix<Mix<A, B>> operator*(const Matrix<A>& a, const Matrix<B>& b) {
  return {a * b.x, a * b.y, a * b.z};
}
template <class T>
Matrix<T> transpose(const Matrix<T>& m) {
  return {{m.x.x, m.y.x, m.z.x}, {m.x.y, m.y.y, m.z.y}, {m.x.z, m.y.z, m.z.z}};
}
/// Columns crossed: r x m.
template <class A, class B>
Matrix<Mix<A, B>> cross(const Vector<A>& r, const Matrix<B>& m) {
  return {cross(r, m.x), cross(r, m.y), cross(r, m.z)};
}

template <class T>
struct Symmetric {
  T xx, yy, zz, xy, xz, yz;
};
template <class A, class B>
Symmetric<Mix<A, B>> operator+(const Symmetric<A>& a, const Symmetric<B>& b) {
  return {a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}
template <class T>
Symmetric<T> roll(const Symmetric<T>& s) {
  return {s.yy, s.zz, s.xx, s.yz, s.xy, s.xz};
}
template <class T>
Symmetric<T> roll_back(const Symmetric<T>& s) {
  return {s.zz, s.xx, s.yy, s.xz, s.yz, s.xy};
}
template <class A, class B>
Vector<Mix<A, B>> operator*(const Symmetric<A>& s, const Vector<B>& a) {
  return {s.xx * a.x + s.xy * a.y + s.xz * a.z, s.xy * a.x + s.yy * a.y + s.yz * a.z,
          s.xz * a.x + s.yz * a.y + s.zz * a.z};
}
/// R s R^T
template <class A, class B>
Symmetric<Mix<A, B>> turn(const Matrix<A>& R, const Symmetric<B>& s) {
  using T = Mix<A, B>;
  const Vector<B> x = {s.xx, s.xy, s.xz}, y = {s.xy, s.yy, s.yz}, z = {s.xz, s.yz, s.zz};
  const Matrix<T> half = {R * x, R * y, R * z};  // R s
  const Matrix<A> rows = transpose(R);
  const Vector<T> a = half * rows.x, b = half * rows.y;
  return {a.x, b.y, half.x.z * R.x.z + half.y.z * R.y.z + half.z.z * R.z.z, a.y, a.z, b.z};
}

/// A turn about z.
template <class T>
struct Turn {
  T c, s;
};
template <class A, class B>
Vector<Mix<A, B>> operator*(const Turn<A>& t, const Vector<B>& a) {
  return {t.c * a.x - t.s * a.y, t.s * a.x + t.c * a.y, a.z};
}
template <class A, class B>
Vector<Mix<A, B>> turn_back(const Turn<A>& t, const Vector<B>& a) {
  return {t.c * a.x + t.s * a.y, t.c * a.y - t.s * a.x, a.z};
}
template <class A, class B>
Symmetric<Mix<A, B>> turn(const Turn<A>& t, const Symmetric<B>& s) {
  const A cc = t.c * t.c, ss = t.s * t.s, cs = t.c * t.s;
  const Mix<A, B> between = 2.0 * cs * s.xy;
  return {cc * s.xx - between + ss * s.yy,
          ss * s.xx + between + cc * s.yy,
          s.zz,
          cs * (s.xx - s.yy) + (cc - ss) * s.xy,
          t.c * s.xz - t.s * s.yz,
          t.s * s.xz + t.c * s.yz};
}
template <class T>
Turn<T> reverse(const Turn<T>& t) {
  return {t.c, -t.s};
}

/// Vectors and matrices in consecutive rows of an array. Access: `get(row)` and `put(row, number)`.
template <class Access>
struct CellsOf : Access {
  using Access::get;
  using Access::put;
  using T = typename Access::Number;
  Vector<T> get_vector(int i) const { return {get(i), get(i + 1), get(i + 2)}; }
  Turn<T> get_turn(int i) const { return {get(i), get(i + 1)}; }
  Matrix<T> get_matrix(int i) const {
    return {get_vector(i), get_vector(i + 3), get_vector(i + 6)};
  }
  Symmetric<T> get_symmetric(int i) const {
    return {get(i), get(i + 1), get(i + 2), get(i + 3), get(i + 4), get(i + 5)};
  }
  void put(int i, const Turn<T>& t) const { put(i, t.c), put(i + 1, t.s); }
  void put(int i, const Vector<T>& v) const { put(i, v.x), put(i + 1, v.y), put(i + 2, v.z); }
  void put(int i, const Matrix<T>& m) const { put(i, m.x), put(i + 3, m.y), put(i + 6, m.z); }
  void put(int i, const Symmetric<T>& s) const {
    put(i, s.xx), put(i + 1, s.yy), put(i + 2, s.zz);
    put(i + 3, s.xy), put(i + 4, s.xz), put(i + 5, s.yz);
  }
};

/// Sums in consecutive rows of an array. Access: `add(row, number)`.
template <class Access>
struct SumsOf : Access {
  using Access::add;
  using T = typename Access::Number;
  void add(int i, const Vector<T>& v) const { add(i, v.x), add(i + 1, v.y), add(i + 2, v.z); }
  void add(int i, const Matrix<T>& m) const { add(i, m.x), add(i + 3, m.y), add(i + 6, m.z); }
  void add(int i, const Symmetric<T>& s) const {
    add(i, s.xx), add(i + 1, s.yy), add(i + 2, s.zz);
    add(i + 3, s.xy), add(i + 4, s.xz), add(i + 5, s.yz);
  }
};

/// One number a row.
template <class S>
struct OneByOne {
  using Number = S;
  S* row;
  const S& get(int i) const { return row[i]; }
  void put(int i, const S& x) const { row[i] = x; }
  void add(int i, const S& x) const { row[i] = row[i] + x; }
};
template <class S>
struct OneByOne<const S> {
  using Number = S;
  const S* row;
  const S& get(int i) const { return row[i]; }
  void put(int, const S&) const = delete;
};

template <class P, class S>
Vector<P> spread3(const S* x) {
  return {Spread<P>::of(x[0]), Spread<P>::of(x[1]), Spread<P>::of(x[2])};
}
template <class P, class S>
Matrix<P> spread9(const S* x) {
  return {spread3<P>(x), spread3<P>(x + 3), spread3<P>(x + 6)};
}

}  // namespace
}  // namespace dockloop::lanes
