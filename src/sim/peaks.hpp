// Largest values over the inner steps of a run, refined between the steps.
//
// Sampling at communication points misses peaks, and inner steps of a high-order method are long
// too. Near a peak (is_near()) a step is therefore searched: PeakSearch proposes times at which a
// value may be largest, and the caller evaluates the state there. So the peak is a value that has
// occurred.
//
// Where no state inside a step is known (fixed steps, hosts of model exchange), a sample above both
// neighbours is refined by the polynomial through the last five samples (fourth order in the
// spacing). Two bounds keep it from overshooting at a kink or a jump that is not announced: the
// parabola through the three middle samples, and the lines through the two samples on either side.
//
// The first values of a sample decide which steps are searched. Those behind them are taken where
// the first ones are evaluated.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace dockloop {

/// Polynomial of degree n - 1 through samples (time[k], value(k)) at time t.
template <class F>
double interpolate_samples(const double* time, int n, double t, F&& value) {
  double sum = 0.0;
  for (int j = 0; j < n; ++j) {
    double weight = value(j);
    for (int k = 0; k < n; ++k) {
      if (k != j) weight *= (t - time[k]) / (time[j] - time[k]);
    }
    sum += weight;
  }
  return sum;
}

struct Maximum {
  double time, value;
};

/// Largest value of f from a to b, where f has one maximum: search by golden sections.
template <class F>
Maximum find_largest(double a, double b, int sections, F&& f) {
  constexpr double kGolden = 0.6180339887498949;
  double c = b - kGolden * (b - a), d = a + kGolden * (b - a);
  double fc = f(c), fd = f(d);
  Maximum largest = fc > fd ? Maximum{c, fc} : Maximum{d, fd};
  for (int n = 1; n < sections; ++n) {
    if (fc > fd) {
      b = d, d = c, fd = fc;
      c = b - kGolden * (b - a), fc = f(c);
    } else {
      a = c, c = d, fc = fd;
      d = a + kGolden * (b - a), fd = f(d);
    }
    if (fc > largest.value) largest = {c, fc};
    if (fd > largest.value) largest = {d, fd};
  }
  return largest;
}

/// Time of an event that has not happened, in outputs [s]. Simulation time itself may be negative.
constexpr double kNoTime = -1.0;

/// The largest value so far, and where it arose.
struct Peak {
  double value = 0.0;
  double time = kNoTime;  ///< [s]
  int step = 0;           ///< of the sequence, from 1; 0 without a sequence
};

/// @tparam kSearched  values for which steps are searched; the others follow them
template <int N, int kSearched = N>
class PeakTracker {
 public:
  /// Delete all samples; add the first sample of a run.
  /// @param step  present step of the sequence, see Peak
  void start(double t, const std::array<double, N>& value, int step = 0) {
    step_ = step;
    for (int i = 0; i < N; ++i) peak_[i] = {value[i], t, step};
    begin(t, value);
  }

  /// A value jumped or has a kink here: do not interpolate across it.
  void begin(double t, const std::array<double, N>& value) {
    count_ = 0;
    push(t, value);
    raise(t, value);
  }

  /// The sequence is in this step from here on: the next samples belong to it.
  void enter(int step) { step_ = step; }

  /// @param refines  interpolate between samples
  void add(double t, const std::array<double, N>& value, bool refines = true) {
    raise(t, value);
    // Samples much closer than their neighbours would only amplify rounding, or are behind a jump.
    if (count_ >= 2 && t - time_[count_ - 1] < 1e-2 * (time_[count_ - 1] - time_[count_ - 2])) {
      if (has_jumped(value)) begin(t, value);
      return;
    }
    push(t, value);
    if (count_ < kWindow || !refines) return;
    for (int i = 0; i < N; ++i) {
      const double mid = value_[2][i];
      if (mid > value_[1][i] && mid > value_[3][i] && mid > kNear * peak_[i].value) refine(i);
    }
  }

  /// These values have occurred.
  void raise(double t, const std::array<double, N>& value) { raise(peak_, t, value); }

  const std::array<Peak, N>& peak() const { return peak_; }
  int count() const { return count_; }
  double time(int k) const { return time_[k]; }
  const std::array<double, N>& value(int k) const { return value_[k]; }
  /// The peaks, if these values occur now too.
  std::array<Peak, N> peak_with(double t, const std::array<double, N>& value) const {
    std::array<Peak, N> largest = peak_;
    raise(largest, t, value);
    return largest;
  }

  /// Is there a value near its peak, or above it?
  bool is_near(const std::array<double, N>& value) const {
    for (int i = 0; i < kSearched; ++i) {
      if (value[i] > 0.0 && value[i] > kNear * peak_[i].value) return true;
    }
    return false;
  }

  /// For saved states (sim/archive.hpp).
  template <class Visit>
  friend constexpr decltype(auto) visit_members(PeakTracker& p, Visit&& visit) {
    return visit(p.count_, p.time_, p.value_, p.sample_step_, p.peak_, p.step_);
  }
  /// Can samples be read? A restored state may be damaged.
  bool is_valid() const { return count_ >= 0 && count_ <= kWindow; }

 private:
  static constexpr int kWindow = 5;
  static constexpr double kNear = 0.95;  // of the peak

  void push(double t, const std::array<double, N>& value) {
    if (count_ == kWindow) {
      for (int j = 1; j < kWindow; ++j) {
        time_[j - 1] = time_[j];
        value_[j - 1] = value_[j];
        sample_step_[j - 1] = sample_step_[j];
      }
      --count_;
    }
    time_[count_] = t;
    value_[count_] = value;
    sample_step_[count_] = step_;
    ++count_;
  }

  void raise(std::array<Peak, N>& peak, double t, const std::array<double, N>& value) const {
    for (int i = 0; i < N; ++i) {
      if (value[i] > peak[i].value) peak[i] = {value[i], t, step_};
    }
  }

  /// Polynomial through samples first..last at time t.
  double interpolate(int i, int first, int last, double t) const {
    return interpolate_samples(&time_[first], last - first + 1, t,
                               [&](int k) { return value_[first + k][i]; });
  }

  /// Does a value right behind the last sample differ by half as much as all samples do?
  bool has_jumped(const std::array<double, N>& value) const {
    constexpr int kLeast = 3;  // samples, of which two may be equal at a smooth peak
    for (int i = 0; i < kSearched && count_ >= kLeast; ++i) {
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

  Maximum find_maximum(int i, int first, int last) const {
    const auto at = [&](double t) { return interpolate(i, first, last, t); };
    const Maximum found = find_largest(time_[1], time_[3], 40, at);
    return found.value > value_[2][i] ? found : Maximum{time_[2], value_[2][i]};
  }

  void refine(int i) {
    const double mid = value_[2][i];
    const Maximum parabola = find_maximum(i, 1, 3);
    Maximum best = find_maximum(i, 0, 4);
    if (best.value > mid + 2.0 * (parabola.value - mid)) best = parabola;
    best.value = std::min(best.value, std::max(find_bound(i, 1), find_bound(i, 2)));
    if (!(best.value > peak_[i].value)) return;
    // The step of the sequence changes behind a sample: a sample ends the interval of its step.
    peak_[i] = {best.value, best.time, sample_step_[best.time > time_[2] ? 3 : 2]};
  }

  int count_ = 0;
  std::array<double, kWindow> time_{};
  std::array<std::array<double, N>, kWindow> value_{};
  std::array<int, kWindow> sample_step_{};
  std::array<Peak, N> peak_{};
  int step_ = 0;
};

/// Searches one step for values above their peaks.
template <int N, int kSearched = N>
class PeakSearch {
 public:
  /// @param tracker  its last sample is the begin of the step, unless the tracker left that out:
  /// the step before was much shorter than those before it
  PeakSearch(const PeakTracker<N, kSearched>& tracker, double from, double to) : tracker_(tracker) {
    constexpr double kSame = 1e-3;  // of the step
    for (int k = 0; k < tracker.count(); ++k) {
      if (tracker.time(k) < from - kSame * (to - from)) ++begin_;
      add(tracker.time(k), tracker.value(k));
    }
  }

  /// Is the begin of the step no sample? Ask before another one is added.
  bool lacks_begin() const { return begin_ == count_; }

  /// A sample in the step. @pre not full
  void add(double t, const std::array<double, N>& value) {
    int k = count_++;
    for (; k > 0 && time_[k - 1] > t; --k) {
      time_[k] = time_[k - 1];
      value_[k] = value_[k - 1];
    }
    time_[k] = t;
    value_[k] = value;
  }

  bool is_full() const { return count_ == kRoom; }

  /// Time inside the step at which a value may exceed its peak by more than a share.
  /// @pre the end of the step is a sample
  std::optional<double> find_time(double share) const {
    std::optional<double> time;
    double most = share;
    for (int i = 0; i < kSearched; ++i) {
      int top = begin_;
      for (int k = begin_; k < count_; ++k) top = value_[k][i] > value_[top][i] ? k : top;
      const double peak = std::max(tracker_.peak()[i].value, value_[top][i]);
      if (!(peak > 0.0 && value_[top][i] > kWorth * peak)) continue;
      const Maximum found = find_maximum(i, top);
      const double gain = found.value / peak - 1.0;
      if (gain > most && is_new(found.time)) {
        most = gain;
        time = found.time;
      }
    }
    return time;
  }

 private:
  static constexpr int kRoom = 12, kThrough = 5;
  static constexpr double kWorth = 0.8;  // of its peak must a sample have

  /// Of the polynomial through the samples next to the highest one, between its neighbours.
  Maximum find_maximum(int i, int top) const {
    const int n = std::min(kThrough, count_);
    const int first = std::clamp(top - n / 2, 0, count_ - n);
    const auto at = [&](double t) {
      return interpolate_samples(&time_[first], n, t, [&](int k) { return value_[first + k][i]; });
    };
    const int left = std::max(top - 1, begin_), right = std::min(top + 1, count_ - 1);
    return find_largest(time_[left], time_[right], 16, at);
  }

  /// Is a time not that of a sample?
  bool is_new(double t) const {
    const double least = 1e-4 * (time_[count_ - 1] - time_[begin_]);
    for (int k = begin_; k < count_; ++k) {
      if (std::abs(t - time_[k]) < least) return false;
    }
    return true;
  }

  const PeakTracker<N, kSearched>& tracker_;
  int count_ = 0;
  int begin_ = 0;  ///< first sample that belongs to the step
  std::array<double, kRoom> time_{};
  std::array<std::array<double, N>, kRoom> value_{};
};

}  // namespace dockloop
