// Preconditions that an expression can check.
//
// A precondition is an error of the caller inside this code, never bad input: input gets a message.
// DOCK_ASSERT is on where NDEBUG is not defined: presets debug, asan-ubsan, tsan and fuzz. In a
// release the condition is compiled, but not evaluated.
#pragma once

#include <cstdio>
#include <cstdlib>

namespace dockloop {

/// Report a precondition that does not hold, and abort.
[[noreturn]] inline void fail_assertion(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "%s:%d: precondition does not hold: %s\n", file, line, condition);
  std::abort();
}

}  // namespace dockloop

#ifdef NDEBUG
#define DOCK_ASSERT(condition) static_cast<void>(sizeof((condition) ? 1 : 0))
#else
#define DOCK_ASSERT(condition) \
  ((condition) ? static_cast<void>(0) : ::dockloop::fail_assertion(#condition, __FILE__, __LINE__))
#endif
