// Hash of a text, as identity of kernels and FMUs (scene document and rows of variables). The hash
// does not protect against intended changes.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace dockloop {

/// 128 bits of FNV-1a (two offsets), as 32 hex digits.
inline std::string hash_text(const std::string& text) {
  std::uint64_t a = 14695981039346656037ull, b = 1099511628211ull ^ 0x9e3779b97f4a7c15ull;
  for (unsigned char c : text) {
    a = (a ^ c) * 1099511628211ull;
    b = (b ^ (c + 0x51u)) * 1099511628211ull;
  }
  char hex[33];
  std::snprintf(hex, sizeof hex, "%016llx%016llx", static_cast<unsigned long long>(a),
                static_cast<unsigned long long>(b));
  return hex;
}

}  // namespace dockloop
