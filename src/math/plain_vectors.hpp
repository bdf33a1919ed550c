// Vectors, matrices and rotations of any number type: double, dual number, or a register of SIMD
// lanes.
//
// Operands may have different number types, and so may the parts of one vector: constants can be
// plain if other operands have derivatives, and what is zero or one for every leg of a kind is a
// type, `Zero` or `One`, that costs nothing. All code is local to the including source and includes
// no library: the linker could merge inline functions with copies for other instruction sets.
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

/// What an operation on numbers of two kinds returns.
template <class A, class B>
using Mix = decltype(A{} * B{});

/// A zero: a number, a vector, a body without mass.
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
T operator-(const T& a, Zero) {
  return a;
}
template <class T>
auto operator-(Zero, const T& a) {
  return -a;
}
inline Zero operator-(Zero, Zero) { return {}; }
inline Zero operator-(Zero) { return {}; }
template <class T>
Zero operator*(const T&, Zero) {
  return {};
}
template <class T>
Zero operator*(Zero, const T&) {
  return {};
}
inline Zero operator*(Zero, Zero) { return {}; }

struct One {};
template <class T>
T operator*(const T& a, One) {
  return a;
}
template <class T>
T operator*(One, const T& a) {
  return a;
}
inline One operator*(One, One) { return {}; }
inline Zero operator*(Zero, One) { return {}; }
inline Zero operator*(One, Zero) { return {}; }

/// A number of another kind as a P.
template <class P>
struct Number {
  static P of(const P& x) { return x; }
  static P of(Zero) { return P{}; }
  static P of(One) { return 1.0 + P{}; }
  template <class N>
  static P of(const N& x) {
    return P{} + x;
  }
};
template <>
struct Number<Zero> {
  static Zero of(Zero) { return {}; }
};

/// Like all that fill several rows of an array (CellsOf), it says how many, and calls f(row, part)
/// for each part if it begins in row i.
template <class X, class Y = X, class Z = Y>
struct Vector {
  X x;
  Y y;
  Z z;

  static constexpr int kRows = 3;
  template <class Self, class F>
  static void visit(int i, Self& of, const F& f) {
    f(i, of.x), f(i + 1, of.y), f(i + 2, of.z);
  }
};
template <class X, class Y, class Z>
Vector(X, Y, Z) -> Vector<X, Y, Z>;

template <class A, class B, class C, class D, class E, class F>
auto operator+(const Vector<A, B, C>& a, const Vector<D, E, F>& b) {
  return Vector{a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class A, class B, class C, class D, class E, class F>
auto operator-(const Vector<A, B, C>& a, const Vector<D, E, F>& b) {
  return Vector{a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class A, class B, class C>
auto operator-(const Vector<A, B, C>& a) {
  return Vector{-a.x, -a.y, -a.z};
}
template <class S, class A, class B, class C>
auto operator*(const S& f, const Vector<A, B, C>& a) {
  return Vector{f * a.x, f * a.y, f * a.z};
}
template <class A, class B, class C>
Zero operator*(Zero, const Vector<A, B, C>&) {
  return {};
}
template <class A, class B, class C>
Vector<A, B, C> operator*(One, const Vector<A, B, C>& a) {
  return a;
}
template <class A, class B, class C, class D, class E, class F>
auto dot(const Vector<A, B, C>& a, const Vector<D, E, F>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class A, class B, class C, class D, class E, class F>
auto cross(const Vector<A, B, C>& a, const Vector<D, E, F>& b) {
  return Vector{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
Zero cross(Zero, const T&) {
  return {};
}
template <class T>
Zero cross(const T&, Zero) {
  return {};
}
inline Zero cross(Zero, Zero) { return {}; }
/// All parts as P.
template <class P, class A, class B, class C>
Vector<P> fill(const Vector<A, B, C>& a) {
  return {Number<P>::of(a.x), Number<P>::of(a.y), Number<P>::of(a.z)};
}
template <class P>
Vector<P> fill(Zero) {
  return {P{}, P{}, P{}};
}

/// Axes renamed y z x, and z x y.
template <class T>
Vector<T> roll(const Vector<T>& a) {
  return {a.y, a.z, a.x};
}
template <class T>
Vector<T> roll_back(const Vector<T>& a) {
  return {a.z, a.x, a.y};
}

/// A matrix by columns.
template <class X, class Y = X, class Z = Y>
struct Columns {
  X x;
  Y y;
  Z z;

  static constexpr int kRows = 9;
  template <class Self, class F>
  static void visit(int i, Self& of, const F& f) {
    f(i, of.x), f(i + 3, of.y), f(i + 6, of.z);
  }
};
template <class X, class Y, class Z>
Columns(X, Y, Z) -> Columns<X, Y, Z>;
template <class T>
using Matrix = Columns<Vector<T>>;

template <class P, class A, class B, class C>
Matrix<P> fill(const Columns<A, B, C>& m) {
  return {fill<P>(m.x), fill<P>(m.y), fill<P>(m.z)};
}
template <class A, class B, class C, class D, class E, class F>
auto operator*(const Columns<A, B, C>& m, const Vector<D, E, F>& a) {
  return a.x * m.x + a.y * m.y + a.z * m.z;
}
template <class A, class B, class C, class D, class E, class F>
auto turn_back(const Columns<A, B, C>& m, const Vector<D, E, F>& a) {
  return Vector{dot(m.x, a), dot(m.y, a), dot(m.z, a)};
}
template <class A, class B, class C>
Zero turn_back(const Columns<A, B, C>&, Zero) {
  return {};
}
template <class A, class B, class C, class D, class E, class F>
auto operator*(const Columns<A, B, C>& a, const Columns<D, E, F>& b) {
  return Columns{a * b.x, a * b.y, a * b.z};
}
template <class A, class B, class C>
auto transpose(const Columns<A, B, C>& m) {
  return Columns{Vector{m.x.x, m.y.x, m.z.x}, Vector{m.x.y, m.y.y, m.z.y},
                 Vector{m.x.z, m.y.z, m.z.z}};
}
/// Columns crossed: r x m.
template <class R, class A, class B, class C>
auto cross(const Vector<R>& r, const Columns<A, B, C>& m) {
  return Columns{cross(r, m.x), cross(r, m.y), cross(r, m.z)};
}

template <class XX, class YY = XX, class ZZ = YY, class XY = ZZ, class XZ = XY, class YZ = XZ>
struct Symmetric {
  XX xx;
  YY yy;
  ZZ zz;
  XY xy;
  XZ xz;
  YZ yz;

  static constexpr int kRows = 6;
  template <class Self, class F>
  static void visit(int i, Self& of, const F& f) {
    f(i, of.xx), f(i + 1, of.yy), f(i + 2, of.zz), f(i + 3, of.xy), f(i + 4, of.xz),
        f(i + 5, of.yz);
  }
};
template <class XX, class YY, class ZZ, class XY, class XZ, class YZ>
Symmetric(XX, YY, ZZ, XY, XZ, YZ) -> Symmetric<XX, YY, ZZ, XY, XZ, YZ>;

template <class... A, class... B>
auto operator+(const Symmetric<A...>& a, const Symmetric<B...>& b) {
  return Symmetric{a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}
template <class T>
Symmetric<T> roll(const Symmetric<T>& s) {
  return {s.yy, s.zz, s.xx, s.yz, s.xy, s.xz};
}
template <class T>
Symmetric<T> roll_back(const Symmetric<T>& s) {
  return {s.zz, s.xx, s.yy, s.xz, s.yz, s.xy};
}
template <class... S, class A, class B, class C>
auto operator*(const Symmetric<S...>& s, const Vector<A, B, C>& a) {
  return Vector{s.xx * a.x + s.xy * a.y + s.xz * a.z, s.xy * a.x + s.yy * a.y + s.yz * a.z,
                s.xz * a.x + s.yz * a.y + s.zz * a.z};
}
template <class P, class... S>
Symmetric<P> fill(const Symmetric<S...>& s) {
  return {Number<P>::of(s.xx), Number<P>::of(s.yy), Number<P>::of(s.zz),
          Number<P>::of(s.xy), Number<P>::of(s.xz), Number<P>::of(s.yz)};
}
/// R s R^T
template <class A, class B, class C, class... S>
auto turn(const Columns<A, B, C>& R, const Symmetric<S...>& s) {
  const auto half = Columns{R * Vector{s.xx, s.xy, s.xz}, R * Vector{s.xy, s.yy, s.yz},
                            R * Vector{s.xz, s.yz, s.zz}};  // R s
  const auto rows = transpose(R);
  const auto a = half * rows.x, b = half * rows.y;
  return Symmetric{a.x, b.y, half.x.z * R.x.z + half.y.z * R.y.z + half.z.z * R.z.z, a.y, a.z, b.z};
}

/// A turn about z.
template <class T>
struct Turn {
  T c, s;

  static constexpr int kRows = 2;
  template <class Self, class F>
  static void visit(int i, Self& of, const F& f) {
    f(i, of.c), f(i + 1, of.s);
  }
};
template <class T, class A, class B, class C>
auto operator*(const Turn<T>& t, const Vector<A, B, C>& a) {
  return Vector{t.c * a.x - t.s * a.y, t.s * a.x + t.c * a.y, a.z};
}
template <class T, class A, class B, class C>
auto turn_back(const Turn<T>& t, const Vector<A, B, C>& a) {
  return Vector{t.c * a.x + t.s * a.y, t.c * a.y - t.s * a.x, a.z};
}
template <class T>
Zero turn_back(const Turn<T>&, Zero) {
  return {};
}
template <class T, class... S>
auto turn(const Turn<T>& t, const Symmetric<S...>& s) {
  const T cc = t.c * t.c, ss = t.s * t.s, cs = t.c * t.s;
  const auto between = 2.0 * cs * s.xy;
  return Symmetric{cc * s.xx - between + ss * s.yy,
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
  /// Parts that are types are not there to be read.
  void read(int, Zero&) const {}
  void read(int, One&) const {}
  void read(int i, T& x) const { x = get(i); }
  template <class V, int = V::kRows>
  void read(int i, V& v) const {
    V::visit(i, v, [&](int k, auto& part) { read(k, part); });
  }
  void put(int i, Zero) const { put(i, T{}); }
  void put(int i, One) const { put(i, 1.0 + T{}); }
  template <class V, int = V::kRows>
  void put(int i, const V& v) const {
    V::visit(i, v, [&](int k, const auto& part) { put(k, part); });
  }
};

/// Sums in consecutive rows of an array. Access: `add(row, number)`.
template <class Access>
struct SumsOf : Access {
  using Access::add;
  void add(int, Zero) const {}
  template <class V, int = V::kRows>
  void add(int i, const V& v) const {
    V::visit(i, v, [&](int k, const auto& part) { add(k, part); });
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
