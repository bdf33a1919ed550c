// A number that remembers how it was computed: the scalar with which the algorithms of the core are
// run to obtain a kernel.
//
// A `Symbolic` is the place of a node in the current `Trace`. Each node knows its value at three
// states: the home pose, which decides the branches of the algorithm, and two random states near
// it. Numbers that agree at all three are the same number (up to rounding, 46 bits), however they
// were computed: that finds common sub-expressions, halves of symmetric matrices, and what is
// always zero or constant, such as cos^2 + sin^2; none of it is computed twice. What is known
// without arithmetic (x + 0, x 1, 0 x) makes no node. Divisions become products with reciprocals,
// which are shared.
//
// A decision that depends on inputs is kept as a guard, to be tested at run time:
//   sign        x > 0 (a root, a determinant): x keeps its sign and a hundredth of its home value;
//               x <= 0 (the test of a factorisation): x keeps its sign
//   pivot       |a| > |b|: the order of pivots of home stays while none is beaten eightfold
// Numbers that are made plain (to_double) decide nothing here: margins are watched by the caller of
// a kernel.
//
// The trace is a global of the generator, which is a program of its own and runs once.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <random>
#include <utility>
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

using Values = std::array<double, 3>;  ///< at the home pose and at two random states

struct Node {
  Op op = Op::kConstant;
  int a = 0, b = -1;  ///< operands; of an input: array and index
  Values value{};
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
    const auto mark = marks_.find(x);
    return mark != marks_.end() ? mark->second : find_or_add(Op::kConstant, -1, -1, {x, x, x});
  }
  /// @param home  value at the home pose; the random states are within `way` of it
  int make_input(int array, int index, double home, double way) {
    const auto [at, is_new] = inputs_.try_emplace({array, index}, size());
    if (is_new) {
      nodes.push_back({Op::kInput, array, index, {home, pick(home, way), pick(home, way)}});
    }
    return at->second;
  }
  /// From now on, the double `mark` stands for this input.
  void mark_input(double mark, int array, int index) {
    marks_[mark] = make_input(array, index, mark, 0.1 * mark);
  }

  bool is_constant(int i) const {
    const Node& n = nodes[i];
    return n.op == Op::kConstant || (n.op == Op::kNegative && is_constant(n.a));
  }
  bool is(int i, double x) const { return is_constant(i) && nodes[i].value[0] == x; }
  int size() const { return static_cast<int>(nodes.size()); }

  int negate(int a) {
    if (a == 0) return 0;
    if (nodes[a].op == Op::kNegative) return nodes[a].a;
    return negate_known(a);
  }
  int add(int a, int b) {
    if (a == 0) return b;
    if (b == 0) return a;
    if (nodes[b].op == Op::kNegative) return subtract(a, nodes[b].a);
    if (nodes[a].op == Op::kNegative) return subtract(b, nodes[a].a);
    return make(Op::kAdd, a, b, [](double x, double y) { return x + y; });
  }
  int subtract(int a, int b) {
    if (b == 0) return a;
    if (a == 0) return negate(b);
    if (a == b) return 0;
    if (nodes[b].op == Op::kNegative) return add(a, nodes[b].a);
    if (nodes[a].op == Op::kNegative) return negate(add(nodes[a].a, b));
    return make(Op::kSubtract, a, b, [](double x, double y) { return x - y; });
  }
  int multiply(int a, int b) {
    if (a == 0 || b == 0) return 0;
    if (is(a, 1.0)) return b;
    if (is(b, 1.0)) return a;
    if (nodes[a].op == Op::kNegative) return negate(multiply(nodes[a].a, b));
    if (nodes[b].op == Op::kNegative) return negate(multiply(a, nodes[b].a));
    if (is_constant(b)) std::swap(a, b);
    if (is_constant(a) && nodes[b].op == Op::kMultiply && is_constant(nodes[b].a)) {
      const int factor = make_constant(nodes[a].value[0] * nodes[nodes[b].a].value[0]);
      return multiply(factor, nodes[b].b);
    }
    return make(Op::kMultiply, a, b, [](double x, double y) { return x * y; });
  }
  int invert(int a) {
    if (nodes[a].op == Op::kNegative) return negate(invert(nodes[a].a));
    if (nodes[a].op == Op::kInverse) return nodes[a].a;
    return make(Op::kInverse, a, -1, [](double x, double) { return 1.0 / x; });
  }
  template <class Function>
  int make(Op op, int a, int b, Function function) {
    const Values &x = nodes[a].value, &y = nodes[b < 0 ? 0 : b].value;
    Values value;
    double size = 0.0;
    for (size_t k = 0; k < value.size(); ++k) {
      value[k] = function(x[k], y[k]);
      size = std::max(size, std::abs(value[k]) / std::max(std::abs(x[k]), std::abs(y[k])));
    }
    if ((op == Op::kAdd || op == Op::kSubtract) && size < kRounding) return 0;
    return find_or_add(op, a, b, value);
  }

  void keep_sign(int a, bool positive, double part = 0.01) {
    if (is_constant(a)) return;
    const int least = make_constant(part * std::abs(nodes[a].value[0]));
    guards.push_back({a, least, 1.0, positive ? 1 : -1});
  }
  void keep_pivot(int big, int small) {
    constexpr double kBeaten = 0.125;
    const auto counts = [this](int i) { return is_constant(i) || nodes[i].op == Op::kAbs; };
    if (small == 0 || (is_constant(big) && nodes[big].value[0] > 1e200)) return;
    if (counts(big) && counts(small) && !(is_constant(big) && is_constant(small)))
      guards.push_back({big, small, kBeaten, 0});
  }

  std::vector<Node> nodes;
  std::vector<Guard> guards;

 private:
  static constexpr double kRounding = 1e-14;  ///< what is left of x - x

  double pick(double home, double way) {
    return home + way * std::uniform_real_distribution<double>(-1.0, 1.0)(random_);
  }
  /// The leading 46 bits, without the sign.
  static std::uint64_t round(double x) {
    x = std::abs(x);
    std::uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return (bits + 32) >> 6;
  }

  /// The node of this number, or of its negative; a new one if there is none.
  int find_or_add(Op op, int a, int b, const Values& value) {
    // These look constant, or like their operand, at states where they do not switch.
    if (op == Op::kFloor || op == Op::kAbs) {
      if (is_constant(a)) return make_constant(value[0]);
      const auto [at, is_new] = switches_.try_emplace({op, a}, size());
      if (is_new) nodes.push_back({op, a, b, value});
      return at->second;
    }
    const int made = size();
    if (!std::isfinite(value[0] + value[1] + value[2])) {
      nodes.push_back({op, a, b, value});
      return made;
    }
    const std::array<std::uint64_t, 3> key{round(value[0]), round(value[1]), round(value[2])};
    const auto [at, is_new] = known_.try_emplace(key, made);
    if (!is_new) {
      const bool same = nodes[at->second].value[1] * value[1] > 0.0;
      return same ? at->second : negate_known(at->second);
    }
    const bool constant = key[0] == key[1] && key[0] == key[2] && value[0] * value[1] > 0.0 &&
                          value[0] * value[2] > 0.0;
    const double x = std::abs(value[0]);
    nodes.push_back(constant ? Node{Op::kConstant, -1, -1, {x, x, x}} : Node{op, a, b, value});
    return constant && value[0] < 0.0 ? negate_known(made) : made;
  }
  int negate_known(int a) {
    if (nodes[a].op == Op::kNegative) return nodes[a].a;
    const auto [at, is_new] = negatives_.try_emplace(a, size());
    if (is_new) {
      const Values& v = nodes[a].value;
      nodes.push_back({Op::kNegative, a, -1, {-v[0], -v[1], -v[2]}});
    }
    return at->second;
  }

  std::map<double, int> marks_;
  std::map<std::pair<int, int>, int> inputs_;
  std::map<std::array<std::uint64_t, 3>, int> known_;
  std::map<int, int> negatives_;
  std::map<std::pair<Op, int>, int> switches_;
  std::mt19937 random_{1};
};

inline Trace* current_trace = nullptr;  ///< the one that is being made

struct Symbolic {
  int node;
  bool is_size;  ///< an absolute value or a sum of such: what pivots and norms are compared by

  Symbolic() = default;
  template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
  Symbolic(T number)
      : node(current_trace->make_constant(static_cast<double>(number))), is_size(number >= T(0)) {}
  static Symbolic at(int node, bool is_size = false) {
    Symbolic made;
    made.node = node;
    made.is_size = is_size;
    return made;
  }
  double value() const { return current_trace->nodes[node].value[0]; }
  explicit operator double() const { return value(); }

  Symbolic operator-() const { return at(current_trace->negate(node)); }
  friend Symbolic operator+(const Symbolic& a, const Symbolic& b) {
    return at(current_trace->add(a.node, b.node), a.is_size && b.is_size);
  }
  friend Symbolic operator-(const Symbolic& a, const Symbolic& b) {
    return at(current_trace->subtract(a.node, b.node));
  }
  friend Symbolic operator*(const Symbolic& a, const Symbolic& b) {
    return at(current_trace->multiply(a.node, b.node));
  }
  friend Symbolic operator/(const Symbolic& a, const Symbolic& b) {
    if (a.node == 0 || a.node == b.node) return Symbolic(a.node == 0 ? 0.0 : 1.0);
    return at(current_trace->multiply(a.node, current_trace->invert(b.node)));
  }
  Symbolic& operator+=(const Symbolic& b) { return *this = *this + b; }
  Symbolic& operator-=(const Symbolic& b) { return *this = *this - b; }
  Symbolic& operator*=(const Symbolic& b) { return *this = *this * b; }
  Symbolic& operator/=(const Symbolic& b) { return *this = *this / b; }

  friend bool operator>(const Symbolic& a, const Symbolic& b) {
    Trace& trace = *current_trace;
    const bool is = a.value() > b.value();
    if (a.is_size && b.is_size) {
      trace.keep_pivot(is ? a.node : b.node, is ? b.node : a.node);
    } else {
      trace.keep_sign(trace.subtract(a.node, b.node), is);
    }
    return is;
  }
  friend bool operator<(const Symbolic& a, const Symbolic& b) { return b > a; }
  friend bool operator<=(const Symbolic& a, const Symbolic& b) {
    const bool is = a.value() <= b.value();
    current_trace->keep_sign(current_trace->subtract(a.node, b.node), !is, 1e-300);
    return is;
  }
  friend bool operator>=(const Symbolic& a, const Symbolic& b) { return !(b > a); }
  /// Equal for every input.
  friend bool operator==(const Symbolic& a, const Symbolic& b) { return a.node == b.node; }
  friend bool operator!=(const Symbolic& a, const Symbolic& b) { return a.node != b.node; }

  template <class Function>
  static Symbolic apply(Op op, const Symbolic& a, Function function) {
    return at(current_trace->make(op, a.node, -1, [&](double x, double) { return function(x); }));
  }
  friend Symbolic sqrt(const Symbolic& a) {
    return apply(Op::kSqrt, a, [](double x) { return std::sqrt(x); });
  }
  friend Symbolic sin(const Symbolic& a) {
    return apply(Op::kSin, a, [](double x) { return std::sin(x); });
  }
  friend Symbolic cos(const Symbolic& a) {
    return apply(Op::kCos, a, [](double x) { return std::cos(x); });
  }
  friend Symbolic abs(const Symbolic& a) {
    Symbolic size = apply(Op::kAbs, a, [](double x) { return std::abs(x); });
    size.is_size = true;
    return size;
  }
  friend Symbolic floor(const Symbolic& a) {
    return apply(Op::kFloor, a, [](double x) { return std::floor(x); });
  }
  friend Symbolic atan2(const Symbolic& y, const Symbolic& x) {
    return at(current_trace->make(Op::kAtan2, y.node, x.node,
                                  [](double b, double a) { return std::atan2(b, a); }));
  }
  friend double to_double(const Symbolic& a) { return a.value(); }
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
