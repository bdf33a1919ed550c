// What a step in real time must not do: allocate, lock, throw, open files. Counted for the whole
// program while asked to, by defining the functions that do it (traps.cpp) and passing on to those
// of the libraries. glibc without sanitizers only, as in allocations.hpp.
#pragma once

#include "unit/allocations.hpp"

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
namespace dockloop {

struct Trapped {
  long allocations = 0, locks = 0, exceptions = 0, files = 0;
};

extern std::atomic<long> lock_count, exception_count, file_count;

/// What work() did of all this.
template <class Work>
Trapped trap(Work work) {
  lock_count = exception_count = file_count = 0;
  Trapped trapped;
  trapped.allocations = count_allocations(work);
  trapped.locks = lock_count;
  trapped.exceptions = exception_count;
  trapped.files = file_count;
  return trapped;
}

}  // namespace dockloop
#endif
