// How a fuzz target reports a broken promise: one line, then abort, which every fuzzer notices.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <string>

namespace dockloop {

[[noreturn]] inline void abort_with(const char* when, const std::string& what) {
  std::fprintf(stderr, "FINDING: %s: %s\n", when, what.c_str());
  std::abort();
}

}  // namespace dockloop
