// Plain data to bytes and back, with one function per struct for both directions.
//
// A struct needs a function `transfer(archive, value)` that lists its members once, with
// transfer_members<T>(). A missing member is a compile error. ByteWriter appends the members.
// ByteReader fills them from bytes that may be damaged: it does not read beyond the end, and
// refuses impossible lengths. The byte order is the order of the machine (little-endian on all
// supported platforms; the header of a saved state contains it).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

#include "math/status.hpp"

namespace dockloop {

class ByteWriter {
 public:
  static constexpr bool kReads = false;
  void raw(const void* from, size_t size) {
    const char* bytes = static_cast<const char*>(from);
    bytes_.insert(bytes_.end(), bytes, bytes + size);
  }
  void numbers(const double* from, size_t count) { raw(from, count * sizeof(double)); }
  std::vector<char> take() { return std::move(bytes_); }

 private:
  std::vector<char> bytes_;
};

class ByteReader {
 public:
  static constexpr bool kReads = true;
  ByteReader(const char* bytes, size_t size) : at_(bytes), left_(size) {}
  /// @throws ModelError at the end of the bytes
  void raw(void* to, size_t size) {
    if (size > left_) throw ModelError("the saved state ends too early");
    if (size == 0) return;  // then `to` may be null
    std::memcpy(to, at_, size);
    at_ += size;
    left_ -= size;
  }
  /// The same for numbers that must be finite and have a finite square.
  /// @throws ModelError if a number is not
  void numbers(double* to, size_t count) {
    raw(to, count * sizeof(double));
    for (size_t i = 0; i < count; ++i) {
      if (!(std::abs(to[i]) <= kLargest)) {
        throw ModelError("the saved state holds a number that is not finite or beyond 1e100");
      }
    }
  }
  size_t left() const { return left_; }

 private:
  static constexpr double kLargest = 1e100;
  const char* at_;
  size_t left_;
};

/// A length, checked against the remaining bytes: every element takes at least one byte.
template <class A>
size_t transfer_size(A& archive, size_t size) {
  std::uint64_t count = size;
  archive.raw(&count, sizeof count);
  if constexpr (A::kReads) {
    if (count > archive.left()) throw ModelError("the saved state has an impossible length");
  }
  return static_cast<size_t>(count);
}

/// Numbers and enumerations of types with the same size on all platforms (no long, no size_t).
template <class A, class T>
std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>> transfer(A& archive, T& value) {
  if constexpr (std::is_same_v<T, bool>) {
    unsigned char byte = value ? 1 : 0;
    archive.raw(&byte, 1);
    value = byte != 0;
  } else if constexpr (std::is_same_v<T, double>) {
    archive.numbers(&value, 1);
  } else {
    archive.raw(&value, sizeof value);
  }
}

template <class A, class T, size_t n>
void transfer(A& archive, std::array<T, n>& values) {
  for (T& value : values) transfer(archive, value);
}

template <class A, class T>
void transfer(A& archive, std::vector<T>& values) {
  const size_t count = transfer_size(archive, values.size());
  if constexpr (A::kReads) values.resize(count);
  for (T& value : values) transfer(archive, value);
}

template <class A, class T, int rows, int cols, int options, int max_rows, int max_cols>
void transfer(A& archive, Eigen::Matrix<T, rows, cols, options, max_rows, max_cols>& m) {
  if constexpr (rows == Eigen::Dynamic || cols == Eigen::Dynamic) {
    const size_t r = transfer_size(archive, static_cast<size_t>(m.rows()));
    const size_t c = transfer_size(archive, static_cast<size_t>(m.cols()));
    if constexpr (A::kReads) {
      if (c > 0 && r > archive.left() / sizeof(T) / c) {
        throw ModelError("the saved state has an impossible length");
      }
      if (rows != Eigen::Dynamic && r != static_cast<size_t>(rows)) {
        throw ModelError("the saved state does not fit this model");
      }
      if (cols != Eigen::Dynamic && c != static_cast<size_t>(cols)) {
        throw ModelError("the saved state does not fit this model");
      }
      m.resize(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c));
    }
  }
  if constexpr (std::is_same_v<T, double>) {
    archive.numbers(m.data(), static_cast<size_t>(m.size()));
  } else {
    archive.raw(m.data(), static_cast<size_t>(m.size()) * sizeof(T));
  }
}

/// Converts to the type of any member.
struct AnyMember {
  template <class T>
  operator T() const;
};

template <class T, class Index, class = void>
struct TakesMembers : std::false_type {};
template <class T, size_t... i>
struct TakesMembers<T, std::index_sequence<i...>,
                    std::void_t<decltype(T{(static_cast<void>(i), AnyMember())...})>>
    : std::true_type {};

/// Number of members of an aggregate: the largest number of values for its construction.
template <class T, size_t count = 0>
constexpr size_t count_members() {
  if constexpr (TakesMembers<T, std::make_index_sequence<count + 1>>::value) {
    return count_members<T, count + 1>();
  } else {
    return count;
  }
}

/// All members of a T, one after the other. @tparam elsewhere  number of members stored elsewhere
template <class T, size_t elsewhere = 0, class A, class... Members>
void transfer_members(A& archive, Members&... members) {
  static_assert(count_members<T>() == sizeof...(Members) + elsewhere,
                "a member of T is missing, or is new");
  (transfer(archive, members), ...);
}

}  // namespace dockloop
