// Numbers with twice the digits of double: an unevaluated sum of two doubles, 32 decimal digits.
//
//   a = high + low,   high = a rounded to double,   |low| <= half a unit in the last place of high
//
// Reference solutions (src/compare) and tests run the algorithms of the core with this scalar, to
// measure the rounding of double, which is about 1e16 times coarser. Sums and products follow T. J.
// Dekker, Numer. Math. 18 (1971) 224-242; functions start from those of double and add one step of
// an iteration that doubles (roots, angles) or triples (logarithm) the digits, or sum a series.
//
// Why not a type of 128 bits: its emulation with integers is several times slower, and some
// platforms have neither the type nor its functions. Exponents are those of double. Halves of a
// product must be exact, so all digits are right only for |a| between 1e-140 and 1e140. Do not
// compile with options that reorder or contract sums (-ffast-math, -ffp-contract=fast).
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <type_traits>

namespace dockloop {

struct Extended {
  double high, low;

  Extended() = default;  // like double: not initialised
  /// Any plain number; literals with suffix L bring the digits of long double.
  template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
  Extended(T plain)
      : high(static_cast<double>(plain)),
        low(static_cast<double>(static_cast<long double>(plain) - static_cast<long double>(high))) {
  }
  Extended(double plain) : high(plain), low(0.0) {}
  Extended(int plain) : high(plain), low(0.0) {}
  Extended(double high_part, double low_part) : high(high_part), low(low_part) {}
  explicit operator double() const { return high; }

  Extended operator-() const { return {-high, -low}; }
  Extended operator+() const { return *this; }
  friend Extended operator+(const Extended& a, const Extended& b) {
    const Extended s = add(a.high, b.high), t = add(a.low, b.low);
    const Extended u = settle(s.high, s.low + t.high);
    return settle(u.high, u.low + t.low);
  }
  friend Extended operator-(const Extended& a, const Extended& b) { return a + -b; }
  friend Extended operator*(const Extended& a, const Extended& b) {
    const Extended p = multiply(a.high, b.high);
    return settle(p.high, p.low + (a.high * b.low + a.low * b.high));
  }
  friend Extended operator/(const Extended& a, const Extended& b) {
    const double first = a.high / b.high;
    Extended rest = a - b * first;
    const double second = rest.high / b.high;
    rest = rest - b * second;
    return settle(first, second) + Extended(rest.high / b.high);
  }
  friend Extended operator*(const Extended& a, double b) {
    const Extended p = multiply(a.high, b);
    return settle(p.high, p.low + a.low * b);
  }
  Extended& operator+=(const Extended& b) { return *this = *this + b; }
  Extended& operator-=(const Extended& b) { return *this = *this - b; }
  Extended& operator*=(const Extended& b) { return *this = *this * b; }
  Extended& operator/=(const Extended& b) { return *this = *this / b; }

  friend bool operator==(const Extended& a, const Extended& b) {
    return a.high == b.high && a.low == b.low;
  }
  friend bool operator!=(const Extended& a, const Extended& b) { return !(a == b); }
  friend bool operator<(const Extended& a, const Extended& b) {
    return a.high < b.high || (a.high == b.high && a.low < b.low);
  }
  friend bool operator>(const Extended& a, const Extended& b) { return b < a; }
  friend bool operator<=(const Extended& a, const Extended& b) { return a < b || a == b; }
  friend bool operator>=(const Extended& a, const Extended& b) { return b <= a; }

  friend Extended abs(const Extended& a) { return a.high < 0.0 ? -a : a; }
  friend Extended floor(const Extended& a) {
    const double whole = std::floor(a.high);
    return whole == a.high ? settle(whole, std::floor(a.low)) : Extended(whole);
  }
  friend Extended sqrt(const Extended& a) {
    const double root = std::sqrt(a.high);
    if (!(root > 0.0)) return {root, 0.0};
    return settle(root, (a - multiply(root, root)).high / (2.0 * root));
  }
  friend Extended sin(const Extended& a) {
    Extended sine, cosine;
    calc_sin_cos(a, sine, cosine);
    return sine;
  }
  friend Extended cos(const Extended& a) {
    Extended sine, cosine;
    calc_sin_cos(a, sine, cosine);
    return cosine;
  }
  friend Extended atan2(const Extended& y, const Extended& x) {
    const double angle = std::atan2(y.high, x.high);
    Extended sine, cosine;
    calc_sin_cos(angle, sine, cosine);
    const Extended along = x * cosine + y * sine;
    return along.high == 0.0 ? Extended(angle) : angle + (y * cosine - x * sine) / along;
  }
  friend Extended exp(const Extended& a) {
    constexpr int kHalvings = 8, kTerms = 11;
    const double twos = std::round(a.high / 0.69314718055994531);
    const Extended ln2(6.931471805599452862e-01, 2.319046813846299558e-17);
    const Extended x = (a - ln2 * twos) * std::ldexp(1.0, -kHalvings);
    Extended sum(0);  // exp(x) - 1, of which the double argument has e (2 + e)
    for (int i = kTerms; i > 0; --i) sum = (sum + 1) * x / i;
    for (int i = 0; i < kHalvings; ++i) sum = sum * (sum + 2);
    return (sum + 1) * std::ldexp(1.0, static_cast<int>(twos));
  }
  friend Extended log1p(const Extended& a) {
    const double start = std::log1p(a.high);
    const Extended e = exp(Extended(start)), x = a + 1;
    return start + (x - e) * 2.0 / (x + e);
  }

 private:
  /// The rounded sum of two numbers and its rounding error.
  static Extended add(double a, double b) {
    const double sum = a + b, part = sum - a;
    return {sum, (a - (sum - part)) + (b - part)};
  }
  /// The same for |a| >= |b|.
  static Extended settle(double a, double b) {
    const double sum = a + b;
    return {sum, b - (sum - a)};
  }
  /// The rounded product of two numbers and its rounding error.
  static Extended multiply(double a, double b) {
    const double product = a * b;
#ifdef FP_FAST_FMA
    return {product, std::fma(a, b, -product)};
#else
    const auto upper_half = [](double x) {
      const double t = 134217729.0 * x;  // 2^27 + 1
      return t - (t - x);
    };
    const double a1 = upper_half(a), a2 = a - a1, b1 = upper_half(b), b2 = b - b1;
    return {product, ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2};
#endif
  }
  static void calc_sin_cos(const Extended& a, Extended& sine, Extended& cosine) {
    constexpr int kHalvings = 4;
    const Extended right_angle(1.570796326794896558e+00, 6.123233995736766036e-17);
    const double turns = std::round(a.high / right_angle.high);
    const Extended x = (a - right_angle * turns) * std::ldexp(1.0, -kHalvings), square = x * x;
    Extended s(1);
    for (int i = 16; i > 0; i -= 2) s = 1 - square / (i * (i + 1)) * s;
    s *= x;
    Extended versine = s * s / (1 + sqrt(1 - s * s));  // 1 - cos x
    for (int i = 0; i < kHalvings; ++i) {
      const Extended doubled = s * (1 - versine) * 2.0;
      versine = s * s * 2.0;
      s = doubled;
    }
    const Extended c = 1 - versine;
    const int quarter = static_cast<int>(turns - 4.0 * std::floor(turns / 4.0));
    sine = quarter == 0 ? s : quarter == 1 ? c : quarter == 2 ? -s : -c;
    cosine = quarter == 0 ? c : quarter == 1 ? -s : quarter == 2 ? -c : s;
  }
};

}  // namespace dockloop

/// The unit of rounding belongs to a few operations in a row.
template <>
struct std::numeric_limits<dockloop::Extended> : std::numeric_limits<double> {
  static constexpr int digits = 100, digits10 = 30;
  static dockloop::Extended epsilon() { return std::ldexp(1.0, 1 - digits); }
  static dockloop::Extended min() { return std::numeric_limits<double>::min(); }
  static dockloop::Extended max() { return std::numeric_limits<double>::max(); }
  static dockloop::Extended lowest() { return std::numeric_limits<double>::lowest(); }
};

/// Traits for Eigen matrices of such numbers and their factorisation.
template <>
struct Eigen::NumTraits<dockloop::Extended> : Eigen::GenericNumTraits<dockloop::Extended> {
  using Real = dockloop::Extended;
  using NonInteger = dockloop::Extended;
  using Nested = dockloop::Extended;
  using Literal = double;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 0,
    ReadCost = 2,
    AddCost = 20,
    MulCost = 24
  };
};
