// Two doubles side by side, in one register. Every processor of our platforms adds and multiplies
// pairs, and compilers rarely find them: sums of a dozen numbers were scalar code. The operations,
// and so the bits, are those of plain numbers.
#pragma once

#include <cstring>

namespace dockloop {

typedef double Pair __attribute__((vector_size(16)));

inline Pair load_pair(const double* from) {
  Pair pair;
  std::memcpy(&pair, from, sizeof pair);
  return pair;
}

inline void store_pair(const Pair& pair, double* to) { std::memcpy(to, &pair, sizeof pair); }

}  // namespace dockloop
