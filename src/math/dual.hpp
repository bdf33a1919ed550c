// Dual numbers: a value and its derivatives along N directions, carried through every operation.
//
//   a = (value, d[0..N-1]),   f(a) = (f(value), f'(value) d)
//
// An algorithm that is a template on its scalar returns exact derivatives (to rounding, no step
// size) when it is run with Dual<N> and the directions are seeded in `d`. A Dual is a plain block
// of N + 1 doubles: no heap, trivially copyable. A compiler turns loops over the directions
// into vector instructions.
//
// Why not Eigen's AutoDiffScalar: its operators return expressions, each of its own type, that
// refer to their operands. In code written for any scalar, `c ? a * b : sin(a)` and std::max(a, b -
// a) do not compile for it, and a lambda that returns `t * b` with a local t returns a reference to
// the dead t. Here every operation returns a Dual.
//
// Conventions:
//  * < and > compare values only, so branches are those of the plain evaluation. == compares value
//    and derivatives: libraries skip zeros, and must not skip a zero with a derivative;
//  * at a kink the derivative belongs to the branch taken: abs(0) as from above, floor is flat;
//  * a direction without variation of the arguments has derivative 0, even if the function has no
//    derivative. In other directions sqrt(0) gives an infinite derivative and atan2(0, 0) NaN.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <type_traits>

namespace dockloop {

template <int N>
struct Dual {
  // The derivatives come first: copies then move the same 16-byte blocks that were written, which
  // processors forward from store to load (with the value first, evaluations take a third longer).
  double d[N];  ///< derivatives along the N directions
  double value;

  Dual() = default;  // like double: not initialised
  /// A constant, from any plain number.
  template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
  Dual(T constant) : d{}, value(static_cast<double>(constant)) {}
  /// An input with derivative one along direction `lane`.
  static Dual variable(double value, int lane) {
    Dual x(value);
    x.d[lane] = 1.0;
    return x;
  }

  Dual operator-() const {
    Dual r;
    r.value = -value;
    for (int i = 0; i < N; ++i) r.d[i] = -d[i];
    return r;
  }
  Dual operator+() const { return *this; }

  friend Dual operator+(const Dual& a, const Dual& b) {
    Dual r;
    r.value = a.value + b.value;
    for (int i = 0; i < N; ++i) r.d[i] = a.d[i] + b.d[i];
    return r;
  }
  friend Dual operator-(const Dual& a, const Dual& b) {
    Dual r;
    r.value = a.value - b.value;
    for (int i = 0; i < N; ++i) r.d[i] = a.d[i] - b.d[i];
    return r;
  }
  friend Dual operator*(const Dual& a, const Dual& b) {
    Dual r;
    r.value = a.value * b.value;
    for (int i = 0; i < N; ++i) r.d[i] = a.d[i] * b.value + a.value * b.d[i];
    return r;
  }
  friend Dual operator/(const Dual& a, const Dual& b) {
    Dual r;
    const double inverse = 1.0 / b.value;
    r.value = a.value / b.value;
    for (int i = 0; i < N; ++i) r.d[i] = (a.d[i] - r.value * b.d[i]) * inverse;
    return r;
  }

  // With a plain number: derivatives are not mixed.
  friend Dual operator+(Dual a, double b) {
    a.value += b;
    return a;
  }
  friend Dual operator+(double a, const Dual& b) { return b + a; }
  friend Dual operator-(Dual a, double b) {
    a.value -= b;
    return a;
  }
  friend Dual operator-(double a, const Dual& b) { return -b + a; }
  friend Dual operator*(const Dual& a, double b) { return a.with(a.value * b, b); }
  friend Dual operator*(double a, const Dual& b) { return b.with(a * b.value, a); }
  friend Dual operator/(const Dual& a, double b) { return a.with(a.value / b, 1.0 / b); }
  friend Dual operator/(double a, const Dual& b) {
    const double quotient = a / b.value;
    return b.with(quotient, -quotient / b.value);
  }

  Dual& operator+=(const Dual& b) {
    value += b.value;
    for (int i = 0; i < N; ++i) d[i] += b.d[i];
    return *this;
  }
  Dual& operator-=(const Dual& b) {
    value -= b.value;
    for (int i = 0; i < N; ++i) d[i] -= b.d[i];
    return *this;
  }
  Dual& operator*=(const Dual& b) { return *this = *this * b; }
  Dual& operator/=(const Dual& b) { return *this = *this / b; }

  friend bool operator==(const Dual& a, const Dual& b) {
    bool same = a.value == b.value;
    for (int i = 0; i < N; ++i) same = same && a.d[i] == b.d[i];
    return same;
  }
  friend bool operator!=(const Dual& a, const Dual& b) { return !(a == b); }
  friend bool operator<(const Dual& a, const Dual& b) { return a.value < b.value; }
  friend bool operator<=(const Dual& a, const Dual& b) { return a.value <= b.value; }
  friend bool operator>(const Dual& a, const Dual& b) { return a.value > b.value; }
  friend bool operator>=(const Dual& a, const Dual& b) { return a.value >= b.value; }

  friend Dual sqrt(const Dual& a) {
    const double root = std::sqrt(a.value);
    if (root > 0.0) return a.with(root, 0.5 / root);
    Dual r(root);
    for (int i = 0; i < N; ++i) r.d[i] = a.d[i] == 0.0 ? 0.0 : a.d[i] / root;
    return r;
  }
  friend Dual abs(const Dual& a) { return a.value < 0.0 ? -a : a; }
  friend Dual floor(const Dual& a) { return Dual(std::floor(a.value)); }
  friend Dual sin(const Dual& a) { return a.with(std::sin(a.value), std::cos(a.value)); }
  friend Dual cos(const Dual& a) { return a.with(std::cos(a.value), -std::sin(a.value)); }
  friend Dual log1p(const Dual& a) { return a.with(std::log1p(a.value), 1.0 / (1.0 + a.value)); }
  friend Dual atan2(const Dual& y, const Dual& x) {
    Dual r;
    r.value = std::atan2(y.value, x.value);
    const double square = x.value * x.value + y.value * y.value;
    for (int i = 0; i < N; ++i) {
      const bool varies = y.d[i] != 0.0 || x.d[i] != 0.0;
      r.d[i] = varies ? (x.value * y.d[i] - y.value * x.d[i]) / square : 0.0;
    }
    return r;
  }

 private:
  /// This with a new value and all derivatives times `slope` (the chain rule).
  Dual with(double new_value, double slope) const {
    Dual r;
    r.value = new_value;
    for (int i = 0; i < N; ++i) r.d[i] = slope * d[i];
    return r;
  }
};

}  // namespace dockloop

/// Limits are those of the value; they convert to constants.
template <int N>
struct std::numeric_limits<dockloop::Dual<N>> : std::numeric_limits<double> {};

/// Traits for Eigen matrices of dual numbers and their factorisation.
template <int N>
struct Eigen::NumTraits<dockloop::Dual<N>> : Eigen::GenericNumTraits<dockloop::Dual<N>> {
  using Real = dockloop::Dual<N>;
  using NonInteger = dockloop::Dual<N>;
  using Nested = dockloop::Dual<N>;
  using Literal = double;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 0,
    ReadCost = N + 1,
    AddCost = N + 1,
    MulCost = 3 * N + 1
  };
};
