// Definitions of malloc and its kin that count; see allocations.hpp.
#include "unit/allocations.hpp"

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
namespace dockloop {
std::atomic<bool> counting_allocations{false};
std::atomic<long> allocation_count{0};
}  // namespace dockloop

namespace {
void count_allocation() {
  if (dockloop::counting_allocations.load(std::memory_order_relaxed)) {
    dockloop::allocation_count.fetch_add(1);
  }
}
}  // namespace

extern "C" {
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* at, size_t size);
void* __libc_memalign(size_t alignment, size_t size);
void* malloc(size_t size) {
  count_allocation();
  return __libc_malloc(size);
}
void* calloc(size_t count, size_t size) {
  count_allocation();
  return __libc_calloc(count, size);
}
void* realloc(void* at, size_t size) {
  count_allocation();
  return __libc_realloc(at, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
  count_allocation();
  return __libc_memalign(alignment, size);
}
}
#endif
