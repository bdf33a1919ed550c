// Heap allocations of the whole program, counted while asked to.
//
// Eigen and SUNDIALS call malloc directly, so operator new alone would not see them; glibc lets a
// program define malloc (allocations.cpp). Other C libraries and the sanitizers have their own:
// there DOCKLOOP_COUNTS_ALLOCATIONS is not defined, and tests that need it are left out.
#pragma once

#include <atomic>
#include <cstdlib>  // defines __GLIBC__

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // of GCC
#define DOCKLOOP_IS_SANITIZED 1
#elif defined(__has_feature)  // of Clang
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define DOCKLOOP_IS_SANITIZED 1
#endif
#endif

#if defined(__GLIBC__) && !defined(DOCKLOOP_IS_SANITIZED)
#define DOCKLOOP_COUNTS_ALLOCATIONS 1

namespace dockloop {

extern std::atomic<bool> counting_allocations;
extern std::atomic<long> allocation_count;

/// Number of allocations while work() runs.
template <class Work>
long count_allocations(Work work) {
  allocation_count = 0;
  counting_allocations = true;
  work();
  counting_allocations = false;
  return allocation_count;
}

}  // namespace dockloop
#endif
