// Instruction sets of this processor and its operating system.
//
// The code uses CPUID directly: some runtimes of portable binaries lack the function of compilers.
#include "math/lanes.hpp"

#ifdef DOCKLOOP_X86_LANES
#include <cpuid.h>
#endif

namespace dockloop {

int find_lane_count() {
#ifdef DOCKLOOP_X86_LANES
  constexpr unsigned kOsSaves = 1u << 27, kAvx = 1u << 28;                       // leaf 1, ecx
  constexpr unsigned kAvx2 = 1u << 5, kAvx512 = 1u << 16 | 1u << 17 | 1u << 31;  // leaf 7, ebx
  unsigned a = 0, b = 0, c = 0, d = 0;
  if (!__get_cpuid(1, &a, &b, &c, &d)) return 2;
  if ((c & kOsSaves) == 0 || (c & kAvx) == 0) return 2;
  unsigned saved = 0, high = 0;  // registers that the operating system keeps
  __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if ((saved & 0x6) != 0x6 || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 2;
  if ((saved & 0xe6) == 0xe6 && (b & kAvx512) == kAvx512) return 8;  // F, DQ, VL
  if ((b & kAvx2) != 0) return 4;
#endif
  return 2;
}

}  // namespace dockloop
