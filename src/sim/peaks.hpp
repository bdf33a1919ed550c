// Largest values over the inner steps of a run, refined between the steps.
//
// Sampling at communication points misses peaks. Inner steps of a high-order method are long too,
// so near a peak (is_near()) the middle of a step is also a sample. A sample above both neighbours
// is refined by the polynomial through the last five samples (fourth order in the spacing). Two
// bounds keep it from overshooting at a kink or a jump that is not announced: the parabola through
// the three middle samples, and the lines through the two samples on either side.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/archive.hpp"

namespace dockloop {

template <int N>
class PeakTracker {
 public:
  /// Delete all samples; add the first sample of a run.
  void start(double t, const std::array<double, N>& value) {
    peak_ = value;
    begin(t, value);
  }

  /// A value jumped or has a kink here: do not interpolate across it.
  void begin(double t, const std::array<double, N>& value) {
    count_ = 0;
    push(t, value);
    raise(value);
  }

  void add(double t, const std::array<double, N>& value) {
    raise(value);
    // Samples much closer than their neighbours would only amplify rounding, or are behind a jump.
    if (count_ >= 2 && t - time_[count_ - 1] < 1e-2 * (time_[count_ - 1] - time_[count_ - 2])) {
      if (has_jumped(value)) begin(t, value);
      return;
    }
    push(t, value);
    if (count_ < kWindow) return;
    for (int i = 0; i < N; ++i) {
      const double mid = value_[2][i];
      if (mid > value_[1][i] && mid > value_[3][i] && mid > kNear * peak_[i]) refine(i);
    }
  }

  const std::array<double, N>& peak() const { return peak_; }
  /// The peaks, if these values occur now too.
  std::array<double, N> peak_with(const std::array<double, N>& value) const {
    std::array<double, N> largest = peak_;
    for (int i = 0; i < N; ++i) largest[i] = std::max(largest[i], value[i]);
    return largest;
  }

  /// Is there a value near its peak, or above it?
  bool is_near(const std::array<double, N>& value) const {
    for (int i = 0; i < N; ++i) {
      if (value[i] > 0.0 && value[i] > kNear * peak_[i]) return true;
    }
    return false;
  }

  /// For saved states (sim/archive.hpp).
  template <class A>
  friend void transfer(A& archive, PeakTracker& peaks) {
    transfer(archive, peaks.count_);
    transfer(archive, peaks.time_);
    transfer(archive, peaks.value_);
    transfer(archive, peaks.peak_);
    if (peaks.count_ < 0 || peaks.count_ > kWindow) throw ModelError("the saved state is damaged");
  }

 private:
  static constexpr int kWindow = 5;
  static constexpr double kNear = 0.95;  // of the peak

  void raise(const std::array<double, N>& value) {
    for (int i = 0; i < N; ++i) {
      if (value[i] > peak_[i]) peak_[i] = value[i];
    }
  }

  void push(double t, const std::array<double, N>& value) {
    if (count_ == kWindow) {
      for (int j = 1; j < kWindow; ++j) {
        time_[j - 1] = time_[j];
        value_[j - 1] = value_[j];
      }
      --count_;
    }
    time_[count_] = t;
    value_[count_] = value;
    ++count_;
  }

  /// Polynomial through samples first..last at time t.
  double interpolate(int i, int first, int last, double t) const {
    double sum = 0.0;
    for (int j = first; j <= last; ++j) {
      double weight = value_[j][i];
      for (int k = first; k <= last; ++k) {
        if (k != j) weight *= (t - time_[k]) / (time_[j] - time_[k]);
      }
      sum += weight;
    }
    return sum;
  }

  /// Does a value right behind the last sample differ by half as much as all samples do?
  bool has_jumped(const std::array<double, N>& value) const {
    constexpr int kLeast = 3;  // samples, of which two may be equal at a smooth peak
    for (int i = 0; i < N && count_ >= kLeast; ++i) {
      double low = value_[0][i], high = low;
      for (int j = 1; j < count_; ++j) {
        low = std::min(low, value_[j][i]);
        high = std::max(high, value_[j][i]);
      }
      if (std::abs(value[i] - value_[count_ - 1][i]) > 0.5 * (high - low)) return true;
    }
    return false;
  }

  /// Bound between samples k and k + 1 of values that are concave from k - 1 to k + 2: where the
  /// lines through the samples on either side meet. It is exact at a corner of straight lines.
  double find_bound(int i, int k) const {
    const double first = value_[k][i], last = value_[k + 1][i];
    const double from_left = interpolate(i, k - 1, k, time_[k + 1]);
    const double from_right = interpolate(i, k + 1, k + 2, time_[k]);
    const double begin = from_right - first, end = from_left - last;
    if (!(begin > 0.0 && end > 0.0)) return std::max(first, last);  // they are not concave
    return first + begin / (begin + end) * (from_left - first);
  }

  double find_maximum(int i, int first, int last) const {
    constexpr double kGolden = 0.6180339887498949;
    double a = time_[1], b = time_[3];
    double largest = value_[2][i];
    for (int n = 0; n < 40; ++n) {
      const double c = b - kGolden * (b - a), d = a + kGolden * (b - a);
      const double fc = interpolate(i, first, last, c), fd = interpolate(i, first, last, d);
      largest = largest > fc ? largest : fc;
      largest = largest > fd ? largest : fd;
      if (fc > fd) {
        b = d;
      } else {
        a = c;
      }
    }
    return largest;
  }

  void refine(int i) {
    const double mid = value_[2][i];
    const double parabola = find_maximum(i, 1, 3);
    double best = find_maximum(i, 0, 4);
    if (best > mid + 2.0 * (parabola - mid)) best = parabola;
    best = std::min(best, std::max(find_bound(i, 1), find_bound(i, 2)));
    if (best > peak_[i]) peak_[i] = best;
  }

  int count_ = 0;
  std::array<double, kWindow> time_{};
  std::array<std::array<double, N>, kWindow> value_{};
  std::array<double, N> peak_{};
};

}  // namespace dockloop
