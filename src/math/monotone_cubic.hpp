// Monotone piecewise cubic through points (PCHIP), with its integral.
//
// Slopes: F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300-304; at the ends
// the three-point formula, held to the sign of the first difference. Between two points the curve
// stays between their values, and a straight table gives a straight line.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "math/scalar.hpp"

namespace dockloop {

class MonotoneCubic {
 public:
  MonotoneCubic() = default;
  /// @pre x increases; x and y have the same size, at least 2
  MonotoneCubic(const std::vector<double>& x, const std::vector<double>& y) : x_(x), y_(y) {
    const size_t n = x.size();
    std::vector<double> h(n - 1), d(n - 1);
    for (size_t i = 0; i + 1 < n; ++i) {
      h[i] = x[i + 1] - x[i];
      d[i] = (y[i + 1] - y[i]) / h[i];
    }
    slope_.assign(n, d[0]);
    for (size_t i = 1; i + 1 < n; ++i) {
      const double before = 2.0 * h[i] + h[i - 1], after = h[i] + 2.0 * h[i - 1];
      slope_[i] = d[i - 1] * d[i] > 0.0 ? (before + after) / (before / d[i - 1] + after / d[i]) : 0;
    }
    if (n > 2) {
      slope_[0] = find_end_slope(h[0], h[1], d[0], d[1]);
      slope_[n - 1] = find_end_slope(h[n - 2], h[n - 3], d[n - 2], d[n - 3]);
    }
    // With all digits, so that the integral has no jumps between pieces for any scalar.
    integral_.assign(n, Extended(0));
    for (size_t i = 0; i + 1 < n; ++i) {
      integral_[i + 1] = integral_[i] + find_piece<Extended>(i, Extended(x[i + 1])).integral;
    }
  }

  double front() const { return x_.front(); }
  double back() const { return x_.back(); }

  template <class S>
  struct At {
    S value, integral;  ///< from the first point
  };

  /// @param extends  goes on straight beyond the ends; else with the value there
  template <class S>
  At<S> at(const S& x, bool extends) const {
    if (x < S(front())) return find_beyond(0, x, extends);
    if (x > S(back())) return find_beyond(x_.size() - 1, x, extends);
    const auto next = std::upper_bound(x_.begin() + 1, x_.end() - 1, to_double(x));
    const size_t i = static_cast<size_t>(next - x_.begin()) - 1;
    At<S> found = find_piece(i, x);
    found.integral += S(integral_[i].high) + S(integral_[i].low);
    return found;
  }

 private:
  static double find_end_slope(double h, double next_h, double d, double next_d) {
    const double slope = ((2.0 * h + next_h) * d - h * next_d) / (h + next_h);
    if (slope * d <= 0.0) return 0.0;
    return d * next_d < 0.0 && std::abs(slope) > 3.0 * std::abs(d) ? 3.0 * d : slope;
  }

  /// Value, and integral from point i. @pre x in the piece behind that point
  template <class S>
  At<S> find_piece(size_t i, const S& x) const {
    const S h = S(x_[i + 1]) - S(x_[i]), t = (x - S(x_[i])) / h;
    const S rise = S(y_[i + 1]) - S(y_[i]), a = h * S(slope_[i]), b = h * S(slope_[i + 1]);
    const S c2 = S(3) * rise - S(2) * a - b, c3 = a + b - S(2) * rise;
    return {S(y_[i]) + t * (a + t * (c2 + t * c3)),
            h * t * (S(y_[i]) + t * (a / S(2) + t * (c2 / S(3) + t * c3 / S(4))))};
  }

  template <class S>
  At<S> find_beyond(size_t end, const S& x, bool extends) const {
    const S way = x - S(x_[end]), rise = extends ? S(slope_[end]) * way : S(0);
    const S before = S(integral_[end].high) + S(integral_[end].low);
    return {S(y_[end]) + rise, before + way * (S(y_[end]) + rise / S(2))};
  }

  std::vector<double> x_, y_, slope_;
  std::vector<Extended> integral_;
};

}  // namespace dockloop
