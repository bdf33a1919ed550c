// A number that remembers how it was computed: the scalar with which the algorithms of the core are
// run to obtain a kernel.
//
// `Symbolic` is a double (its value at the home pose, which decides the branches of the algorithm)
// and the place of a node in the current `Trace`. A node exists once however often it is computed,
// and what is known without arithmetic (x + 0, x 1, 0 x, x - x, constants) makes none: zeros, ones
// and common sub-expressions are gone before anything is written. Divisions become products with
// reciprocals, which are shared.
//
// A decision that depends on inputs is kept as a guard, to be tested at run time:
//   sign        x > 0 (a root, a determinant): x keeps its sign and a hundredth of its home value
//   pivot       |a| > |b|: the order of pivots of home stays while none is beaten eightfold
// Numbers that are made plain (to_double) decide nothing here: margins are watched elsewhere.
//
// The trace is a global of the generator, which is a program of its own and runs once.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <unordered_map>
#include <vector>

namespace dockloop {

enum class Op : std::uint8_t {
  kConstant,
  kInput,
  kNegative,
  kAdd,
  kSubtract,
  kMultiply,
  kInverse,
  kSqrt,
  kSin,
  kCos,
  kAtan2,
  kFloor,
  kAbs
};

struct Node {
  Op op = Op::kConstant;
  int a = 0, b = 0;    ///< operands; of an input: array and index
  double value = 0.0;  ///< at the home pose
};

/// Holds while `factor` |small| <= |big|, and big has the sign `sign` (0: either).
struct Guard {
  int big, small;
  double factor;
  int sign;
};

class Trace {
 public:
  Trace() { nodes.push_back({}); }  // node 0 is the number zero: bytes of zeros are a Symbolic

  int make_constant(double x) {
    if (x == 0.0) return 0;
    const auto [at, is_new] = constants_.try_emplace(bits_of(x), size());
    if (is_new) nodes.push_back({Op::kConstant, 0, 0, x});
    return at->second;
  }

  /// From now on, the double `mark` stands for this input.
  void mark_input(double mark, int array, int index) {
    constants_[bits_of(mark)] = make_input(array, index, mark);
  }

  int make_input(int array, int index, double value) {
    return intern(Op::kInput, array, index, value);
  }

  int make(Op op, int a, int b, double value) {
    const bool known = is_constant(a) && (b < 0 || is_constant(b));
    return known ? make_constant(value) : intern(op, a, b, value);
  }

  bool is_constant(int i) const { return nodes[i].op == Op::kConstant; }
  bool is(int i, double x) const { return is_constant(i) && nodes[i].value == x; }
  /// Absolute values and their sums: pivots, and norms that nobody decides by.
  bool is_size(int i) const {
    const Node& n = nodes[i];
    return is_constant(i) || n.op == Op::kAbs || (n.op == Op::kAdd && is_size(n.a) && is_size(n.b));
  }
  int size() const { return static_cast<int>(nodes.size()); }

  int negate(int a) {
    if (a == 0) return 0;
    if (nodes[a].op == Op::kNegative) return nodes[a].a;
    return make(Op::kNegative, a, -1, -nodes[a].value);
  }
  int add(int a, int b) {
    if (a == 0) return b;
    if (b == 0) return a;
    if (nodes[b].op == Op::kNegative) return subtract(a, nodes[b].a);
    if (nodes[a].op == Op::kNegative) return subtract(b, nodes[a].a);
    if (a > b) std::swap(a, b);
    return make(Op::kAdd, a, b, nodes[a].value + nodes[b].value);
  }
  int subtract(int a, int b) {
    if (b == 0) return a;
    if (a == 0) return negate(b);
    if (a == b) return 0;
    if (nodes[b].op == Op::kNegative) return add(a, nodes[b].a);
    if (nodes[a].op == Op::kNegative) return negate(add(nodes[a].a, b));
    if (a > b) return negate(subtract(b, a));  // a - b and b - a are one node
    return make(Op::kSubtract, a, b, nodes[a].value - nodes[b].value);
  }
  int multiply(int a, int b) {
    if (a == 0 || b == 0) return 0;
    if (is(a, 1.0)) return b;
    if (is(b, 1.0)) return a;
    if (is(a, -1.0)) return negate(b);
    if (is(b, -1.0)) return negate(a);
    if (nodes[a].op == Op::kNegative) return negate(multiply(nodes[a].a, b));
    if (nodes[b].op == Op::kNegative) return negate(multiply(a, nodes[b].a));
    for (const int x : {a, b}) {  // of constants, the sign goes to the product
      if (is_constant(x) && nodes[x].value < 0.0)
        return negate(multiply(make_constant(-nodes[x].value), x == a ? b : a));
    }
    if (a > b) std::swap(a, b);
    return make(Op::kMultiply, a, b, nodes[a].value * nodes[b].value);
  }
  int invert(int a) {
    if (nodes[a].op == Op::kNegative) return negate(invert(nodes[a].a));
    if (nodes[a].op == Op::kInverse) return nodes[a].a;
    return make(Op::kInverse, a, -1, 1.0 / nodes[a].value);
  }

  void keep_sign(int a, bool positive) {
    if (!is_constant(a)) {
      const double least = 0.01 * std::abs(nodes[a].value);
      guards.push_back({a, make_constant(least), 1.0, positive ? 1 : -1});
    }
  }
  void keep_pivot(int big, int small) {
    constexpr double kBeaten = 0.125;
    const auto counts = [this](int i) { return is_constant(i) || nodes[i].op == Op::kAbs; };
    if (small == 0 || (is_constant(big) && nodes[big].value > 1e200)) return;
    if (counts(big) && counts(small)) guards.push_back({big, small, kBeaten, 0});
  }

  std::vector<Node> nodes;
  std::vector<Guard> guards;

 private:
  static std::uint64_t bits_of(double x) {
    std::uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return bits;
  }
  int intern(Op op, int a, int b, double value) {
    const std::uint64_t key = (static_cast<std::uint64_t>(op) << 60) ^
                              (static_cast<std::uint64_t>(a) << 30) ^
                              static_cast<std::uint64_t>(b + 1);
    const auto [at, is_new] = known_.try_emplace(key, size());
    if (is_new) nodes.push_back({op, a, b, value});
    return at->second;
  }
  std::unordered_map<std::uint64_t, int> constants_, known_;
};

inline Trace* current_trace = nullptr;  ///< the one that is being made

struct Symbolic {
  double value;
  int node;

  Symbolic() = default;
  template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
  Symbolic(T number)
      : value(static_cast<double>(number)), node(current_trace->make_constant(static_cast<double>(number))) {}
  Symbolic(double at, int place) : value(at), node(place) {}
  explicit operator double() const { return value; }

  Symbolic operator-() const { return {-value, current_trace->negate(node)}; }
  friend Symbolic operator+(const Symbolic& a, const Symbolic& b) {
    return {a.value + b.value, current_trace->add(a.node, b.node)};
  }
  friend Symbolic operator-(const Symbolic& a, const Symbolic& b) {
    return {a.value - b.value, current_trace->subtract(a.node, b.node)};
  }
  friend Symbolic operator*(const Symbolic& a, const Symbolic& b) {
    return {a.value * b.value, current_trace->multiply(a.node, b.node)};
  }
  friend Symbolic operator/(const Symbolic& a, const Symbolic& b) {
    const double quotient = a.value / b.value;
    if (a.node == 0) return {quotient, 0};
    if (a.node == b.node) return {quotient, current_trace->make_constant(1.0)};
    return {quotient, current_trace->multiply(a.node, current_trace->invert(b.node))};
  }
  Symbolic& operator+=(const Symbolic& b) { return *this = *this + b; }
  Symbolic& operator-=(const Symbolic& b) { return *this = *this - b; }
  Symbolic& operator*=(const Symbolic& b) { return *this = *this * b; }
  Symbolic& operator/=(const Symbolic& b) { return *this = *this / b; }

  bool is_plain() const { return current_trace->is_constant(node); }
  bool is_size() const { return current_trace->is_size(node); }
  friend bool operator>(const Symbolic& a, const Symbolic& b) {
    const bool is = a.value > b.value;
    if (a.is_plain() && b.is_plain()) return is;
    if (a.is_size() && b.is_size()) {
      current_trace->keep_pivot(is ? a.node : b.node, is ? b.node : a.node);
    } else {
      current_trace->keep_sign(current_trace->subtract(a.node, b.node), is);
    }
    return is;
  }
  friend bool operator<(const Symbolic& a, const Symbolic& b) { return b > a; }
  friend bool operator<=(const Symbolic& a, const Symbolic& b) { return !(a > b); }
  friend bool operator>=(const Symbolic& a, const Symbolic& b) { return !(b > a); }
  /// Equal for every input.
  friend bool operator==(const Symbolic& a, const Symbolic& b) { return a.node == b.node; }
  friend bool operator!=(const Symbolic& a, const Symbolic& b) { return a.node != b.node; }

  static Symbolic apply(Op op, const Symbolic& a, double value) {
    return {value, current_trace->make(op, a.node, -1, value)};
  }
  friend Symbolic sqrt(const Symbolic& a) { return apply(Op::kSqrt, a, std::sqrt(a.value)); }
  friend Symbolic sin(const Symbolic& a) { return apply(Op::kSin, a, std::sin(a.value)); }
  friend Symbolic cos(const Symbolic& a) { return apply(Op::kCos, a, std::cos(a.value)); }
  friend Symbolic abs(const Symbolic& a) { return apply(Op::kAbs, a, std::abs(a.value)); }
  friend Symbolic floor(const Symbolic& a) { return apply(Op::kFloor, a, std::floor(a.value)); }
  friend Symbolic atan2(const Symbolic& y, const Symbolic& x) {
    const double value = std::atan2(y.value, x.value);
    return {value, current_trace->make(Op::kAtan2, y.node, x.node, value)};
  }
  friend double to_double(const Symbolic& a) { return a.value; }
};

}  // namespace dockloop

template <>
struct std::numeric_limits<dockloop::Symbolic> : std::numeric_limits<double> {};

template <>
struct Eigen::NumTraits<dockloop::Symbolic> : Eigen::GenericNumTraits<dockloop::Symbolic> {
  using Real = dockloop::Symbolic;
  using NonInteger = dockloop::Symbolic;
  using Nested = dockloop::Symbolic;
  using Literal = double;
  enum { IsComplex = 0, IsInteger = 0, IsSigned = 1, RequireInitialization = 0 };
};
