// Loads that the host of a vehicle feels later than they are announced (coupling.delay).
//
// Each load acts from a known time until the next one begins to act. A load whose end the host has
// not reported yet stays in the queue: its impulse is not delivered. Some older loads stay for the
// diagnosis. Without a delay there is no queue.
#pragma once

#include <vector>

#include "sim/mean_load.hpp"

namespace dockloop {

struct LoadQueue {
  struct Entry {
    double begin = 0.0;  ///< it acts from then on [s since start]
    Wrench<double> load;
  };
  std::vector<Entry> entry;  ///< oldest first; of a fixed size, empty without a delay
  int count = 0;             ///< entries in use
};

constexpr int kMostQueuedLoads = 256;
constexpr int kQueueSize = kMostQueuedLoads + 32;  ///< with older loads

/// No load acts until the first entry begins. Later functions allocate nothing.
LoadQueue make_load_queue();
/// @pre is_full() is false. @param begin  not before that of the last entry
void add_load(LoadQueue& queue, double begin, const Wrench<double>& load);
/// Drop loads that ended before a time.
void forget_loads(LoadQueue& queue, double time);
inline bool is_full(const LoadQueue& queue) { return queue.count >= kQueueSize; }

/// Calls f(load, length [s], is it the last one) for the loads that act between two times.
template <class F>
void for_each_load(const LoadQueue& queue, double begin, double end, F&& f) {
  const double rounding = 1e-6 * (end - begin);  // of times, much less than a step
  double from = begin;
  for (int k = 0; k < queue.count && from < end; ++k) {
    const bool is_newest = k + 1 == queue.count;
    double to = is_newest ? end : queue.entry[static_cast<size_t>(k) + 1].begin;
    if (to < from + rounding) continue;
    if (to > end - rounding) to = end;
    f(queue.entry[static_cast<size_t>(k)].load, to - from, to == end);
    from = to;
  }
}

/// The mean of the loads that act between two times; zero if these are the same.
Wrench<double> find_mean_of_loads(const LoadQueue& queue, double begin, double end);

}  // namespace dockloop
