// The bytes of an input, read as decisions: small choices and numbers that are likely to hurt.
//
// Printable on purpose: '0' is choice 0, '1' is choice 1 and so on, and after the last byte every
// choice is 0, so that seeds can be written by hand (tests/fuzz/README.md).
#pragma once

#include <cstdint>
#include <cstring>
#include <limits>

namespace dockloop {

class ByteSource {
 public:
  ByteSource(const std::uint8_t* data, size_t size) : at_(data), end_(data + size) {}

  bool empty() const { return at_ == end_; }
  std::uint8_t byte() { return empty() ? std::uint8_t{'0'} : *at_++; }

  /// 0 ... count - 1.
  size_t pick(size_t count) { return static_cast<std::uint8_t>(byte() - '0') % count; }
  bool flag() { return pick(2) == 1; }

  /// A number from a list, a small decimal fraction, or any eight bytes.
  double number() {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    static constexpr double kNumbers[] = {0.0,
                                          1.0,
                                          -1.0,
                                          1e-3,
                                          0.01,
                                          0.5,
                                          2.0,
                                          100.0,
                                          25e3,
                                          1e9,
                                          -0.0,
                                          -0.01,
                                          -0.5,
                                          -1e9,
                                          1e-16,
                                          1e-8,
                                          0.999999,
                                          1.5707963267948966,
                                          3.141592653589793,
                                          1e18,
                                          1e154,
                                          1e300,
                                          -1e300,
                                          std::numeric_limits<double>::max(),
                                          std::numeric_limits<double>::denorm_min(),
                                          std::numeric_limits<double>::min(),
                                          kInfinity,
                                          -kInfinity,
                                          std::numeric_limits<double>::quiet_NaN()};
    constexpr size_t kCount = sizeof kNumbers / sizeof kNumbers[0];
    const size_t choice = pick(kCount + 2);
    if (choice < kCount) return kNumbers[choice];
    if (choice == kCount) return (static_cast<int>(byte()) - 128) / 16.0;
    std::uint64_t bits = 0;
    for (int i = 0; i < 8; ++i) bits = (bits << 8) | byte();
    double value = 0.0;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }

 private:
  const std::uint8_t *at_, *end_;
};

}  // namespace dockloop
