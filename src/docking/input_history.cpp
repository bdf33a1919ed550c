// Histories of inputs; see input_history.hpp.
#include "docking/input_history.hpp"

#include <algorithm>

namespace dockloop {

int find_row(const InputHistory& history, double time) {
  const auto& times = history.time;
  const auto next = std::upper_bound(times.begin(), times.end(), time);
  return static_cast<int>(next - times.begin()) - 1;
}

InputLine find_line(const InputHistory& history, int row, double time) {
  const size_t i = static_cast<size_t>(std::max(row, 0));
  const bool is_flat = !history.is_linear || row < 0 || i + 1 >= history.time.size();
  if (is_flat) return {history.value[i], 0.0};
  const double length = history.time[i + 1] - history.time[i];
  const double rate = (history.value[i + 1] - history.value[i]) / length;
  return {history.value[i] + rate * (time - history.time[i]), rate};
}

InputIntegrals find_integrals(const InputHistory& history, double from, double duration) {
  InputIntegrals sum;
  const double end = from + duration;
  const int rows = static_cast<int>(history.time.size());
  int row = find_row(history, from);
  for (double at = from; at < end; ++row) {
    const double stop = row + 1 < rows ? std::min(end, history.time[row + 1]) : end;
    const double h = stop - at;
    if (!(h > 0.0)) continue;  // a jump
    const InputLine line = find_line(history, row, at);
    sum.twice += h * (sum.once + h * (line.value / 2.0 + h * line.rate / 6.0));
    sum.once += h * (line.value + h * line.rate / 2.0);
    at = stop;
  }
  return sum;
}

}  // namespace dockloop
