// Definitions that count and pass on; see traps.hpp.
#include "unit/traps.hpp"

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>

#include <cstdarg>
#include <cstdio>
#include <typeinfo>

namespace dockloop {
std::atomic<long> lock_count{0}, exception_count{0}, file_count{0};
}  // namespace dockloop

namespace {

void count(std::atomic<long>& what) {
  if (dockloop::counting_allocations.load(std::memory_order_relaxed)) what.fetch_add(1);
}

/// The definition that would have been called without ours.
template <class Function>
Function* find_next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

// Visible, so that the libraries call them too.
#pragma GCC visibility push(default)
extern "C" {

int pthread_mutex_lock(pthread_mutex_t* mutex) {
  static auto* const next = find_next<int(pthread_mutex_t*)>("pthread_mutex_lock");
  count(dockloop::lock_count);
  return next(mutex);
}

[[noreturn]] void __cxa_throw(void* object, std::type_info* type, void (*destroy)(void*)) {
  count(dockloop::exception_count);
  using Throw = void(void*, std::type_info*, void (*)(void*));
  find_next<Throw>("__cxa_throw")(object, type, destroy);
  __builtin_unreachable();
}

FILE* fopen(const char* path, const char* mode) {
  count(dockloop::file_count);
  return find_next<FILE*(const char*, const char*)>("fopen")(path, mode);
}

FILE* fopen64(const char* path, const char* mode) {
  count(dockloop::file_count);
  return find_next<FILE*(const char*, const char*)>("fopen64")(path, mode);
}

int open(const char* path, int flags, ...) {
  count(dockloop::file_count);
  va_list arguments;
  va_start(arguments, flags);
  const int mode = va_arg(arguments, int);
  va_end(arguments);
  return find_next<int(const char*, int, ...)>("open")(path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  count(dockloop::file_count);
  va_list arguments;
  va_start(arguments, flags);
  const int mode = va_arg(arguments, int);
  va_end(arguments);
  return find_next<int(const char*, int, ...)>("open64")(path, flags, mode);
}

}  // extern "C"
#pragma GCC visibility pop
#endif
