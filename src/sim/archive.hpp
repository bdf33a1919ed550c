// Plain data to bytes and back, and the number of their format.
//
// transfer(archive, value) works for both directions, and for any struct: it visits all members
// (math/members.hpp). ByteWriter appends the members. ByteReader fills them from bytes that may be
// damaged: it does not read beyond the end, and refuses impossible lengths. The byte order is the
// order of the machine (little-endian on all supported platforms; the header of a saved state
// contains it).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "math/members.hpp"
#include "math/status.hpp"

namespace dockloop {

class ByteWriter {
 public:
  static constexpr bool kReads = false;
  template <class T>
  void raw(const T* from, size_t count) {
    const char* bytes = reinterpret_cast<const char*>(from);
    bytes_.insert(bytes_.end(), bytes, bytes + count * sizeof(T));
  }
  void numbers(const double* from, size_t count) { raw(from, count); }
  std::vector<char> take() { return std::move(bytes_); }

 private:
  std::vector<char> bytes_;
};

class ByteReader {
 public:
  static constexpr bool kReads = true;
  ByteReader(const char* bytes, size_t size) : at_(bytes), left_(size) {}
  /// @throws ModelError at the end of the bytes
  template <class T>
  void raw(T* to, size_t count) {
    if (count > left_ / sizeof(T)) throw ModelError("the saved state ends too early");
    if (count == 0) return;  // then `to` may be null
    std::memcpy(to, at_, count * sizeof(T));
    at_ += count * sizeof(T);
    left_ -= count * sizeof(T);
  }
  /// The same for numbers that must be finite and have a finite square.
  /// @throws ModelError if a number is not
  void numbers(double* to, size_t count) {
    raw(to, count);
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

/// Reads ones, also as lengths, and hashes (FNV-1a) types and numbers of what is read.
class FormatReader {
 public:
  static constexpr bool kReads = true;
  template <class T>
  void raw(T* to, size_t count) {
    std::fill_n(to, count, static_cast<T>(1));
    const size_t kind = std::is_enum_v<T> ? 1 : std::is_floating_point_v<T> ? 2 : 3;
    // Plain char has a sign on some platforms only.
    const bool is_unsigned = std::is_unsigned_v<T> && !std::is_same_v<T, char>;
    for (const size_t word : {kind + 3 * is_unsigned, sizeof(T), count}) {
      hash_ = (hash_ ^ static_cast<std::uint32_t>(word)) * 16777619u;
    }
  }
  void numbers(double* to, size_t count) { raw(to, count); }
  size_t left() const { return std::numeric_limits<size_t>::max(); }
  std::uint32_t format() const { return hash_; }

 private:
  /// Types do not show it where a member has another meaning or unit: then take another number.
  static constexpr std::uint32_t kMeaning = 1;
  std::uint32_t hash_ = 2166136261u ^ kMeaning;
};

/// A length, checked against the remaining bytes: every element takes at least one byte.
template <class A>
size_t transfer_size(A& archive, size_t size) {
  std::uint64_t count = size;
  archive.raw(&count, 1);
  if constexpr (A::kReads) {
    if (count > archive.left()) throw ModelError("the saved state has an impossible length");
  }
  return static_cast<size_t>(count);
}

/// Numbers and enumerations of types with the same size on all platforms (no long, no size_t).
template <class A, class T>
std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>> transfer(A& archive, T& value) {
  if constexpr (std::is_same_v<T, bool>) {
    unsigned char byte = 0;
    if constexpr (!A::kReads) byte = value ? 1 : 0;
    archive.raw(&byte, 1);
    value = byte != 0;
  } else if constexpr (std::is_same_v<T, double>) {
    archive.numbers(&value, 1);
  } else {
    archive.raw(&value, 1);
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

template <class A>
void transfer(A& archive, std::string& text) {
  text.resize(transfer_size(archive, text.size()));
  archive.raw(text.data(), text.size());
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
    archive.raw(m.data(), static_cast<size_t>(m.size()));
  }
}

/// An optional object.
template <class A, class T>
void transfer(A& archive, std::shared_ptr<const T>& pointer) {
  bool there = pointer != nullptr;
  transfer(archive, there);
  if (!there) {
    pointer.reset();
    return;
  }
  T value = pointer ? *pointer : T();
  transfer(archive, value);
  if constexpr (A::kReads) pointer = std::make_shared<const T>(std::move(value));
}

/// A struct: all its members.
template <class A, class T>
std::enable_if_t<std::is_class_v<T>> transfer(A& archive, T& value) {
  visit_members(value, [&](auto&... members) { (transfer(archive, members), ...); });
}

/// Number of the format of the bytes of a T: another one as soon as a member is added, removed, of
/// another type, or moved among members of other types.
template <class T>
std::uint32_t find_format() {
  FormatReader reader;
  T value{};
  transfer(reader, value);
  return reader.format();
}

}  // namespace dockloop
