// The queue of load_queue.hpp.
#include "sim/load_queue.hpp"

#include <algorithm>

namespace dockloop {

LoadQueue make_load_queue() {
  LoadQueue queue;
  queue.entry.resize(kQueueSize);
  queue.count = 1;  // no load, until the first one arrives
  return queue;
}

void add_load(LoadQueue& queue, double begin, const Wrench<double>& load) {
  queue.entry[static_cast<size_t>(queue.count++)] = {begin, load};
}

void forget_loads(LoadQueue& queue, double time) {
  int ended = 0;
  while (ended + 1 < queue.count && queue.entry[static_cast<size_t>(ended) + 1].begin <= time) {
    ++ended;
  }
  std::rotate(queue.entry.begin(), queue.entry.begin() + ended, queue.entry.begin() + queue.count);
  queue.count -= ended;
}

Wrench<double> find_mean_of_loads(const LoadQueue& queue, double begin, double end) {
  Wrench<double> mean;
  for_each_load(queue, begin, end, [&](const Wrench<double>& load, double length, bool) {
    if (length == end - begin) {
      mean = load;
    } else {
      mean += length / (end - begin) * load;
    }
  });
  return mean;
}

}  // namespace dockloop
