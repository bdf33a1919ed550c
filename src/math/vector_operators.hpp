// Sums and products of vectors and matrices of fixed size, as plain values.
//
// Eigen's operators return expressions, each of a type of its own. In algorithms that are compiled
// for several scalars, the templates of these types took a third of the compile time. The operators
// below are found first where operands are plain, transposed, or parts of others. They are compiled
// once for each size. Dynamic sizes and other expressions stay Eigen's.
//
// Operators are always inlined, as Eigen's are: a copy of its own could come from a source that is
// compiled with less optimisation (`setup_sources` in CMakeLists.txt).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <type_traits>
#include <utility>

#define DOCK_INLINE [[gnu::always_inline]] inline

namespace dockloop {

/// A plain matrix or vector, if its size is fixed.
template <class S, int R, int C>
using Fixed = std::enable_if_t<(R > 0 && C > 0), Eigen::Matrix<S, R, C>>;

/// Numbers of the largest matrix that is unrolled; clang takes at most 256.
constexpr int kUnrolled = 144;

/// Coefficients find(0), find(1) and so on, column by column. Without a loop, so that compilers
/// keep them in registers.
template <class S, int R, int C, class Find, std::size_t... i>
DOCK_INLINE Eigen::Matrix<S, R, C> make_each(const Find& find, std::index_sequence<i...>) {
  Eigen::Matrix<S, R, C> made;
  ((made.data()[i] = find(i)), ...);
  return made;
}
template <class S, int R, int C, class Find>
DOCK_INLINE Eigen::Matrix<S, R, C> make_each(const Find& find) {
  if constexpr (R * C <= kUnrolled) {
    return make_each<S, R, C>(find, std::make_index_sequence<R * C>());
  } else {
    Eigen::Matrix<S, R, C> made;
    for (int i = 0; i < R * C; ++i) made.data()[i] = find(i);
    return made;
  }
}

/// The same numbers as another scalar.
template <class S, class T, int R, int C>
DOCK_INLINE Fixed<S, R, C> cast(const Eigen::Matrix<T, R, C>& from) {
  return make_each<S, R, C>([&](int i) -> S { return S(from.data()[i]); });
}

template <class S, int R, int C>
DOCK_INLINE Fixed<S, R, C> operator+(const Eigen::Matrix<S, R, C>& a,
                                     const Eigen::Matrix<S, R, C>& b) {
  return make_each<S, R, C>([&](int i) -> S { return a.data()[i] + b.data()[i]; });
}
template <class S, int R, int C>
DOCK_INLINE Fixed<S, R, C> operator-(const Eigen::Matrix<S, R, C>& a,
                                     const Eigen::Matrix<S, R, C>& b) {
  return make_each<S, R, C>([&](int i) -> S { return a.data()[i] - b.data()[i]; });
}
template <class S, int R, int C>
DOCK_INLINE Fixed<S, R, C> operator-(const Eigen::Matrix<S, R, C>& a) {
  return make_each<S, R, C>([&](int i) -> S { return -a.data()[i]; });
}
template <class S, int R, int C>
DOCK_INLINE Fixed<S, R, C> operator*(const S& factor, const Eigen::Matrix<S, R, C>& a) {
  return make_each<S, R, C>([&](int i) -> S { return factor * a.data()[i]; });
}
template <class S, int R, int C>
DOCK_INLINE Fixed<S, R, C> operator*(const Eigen::Matrix<S, R, C>& a, const S& factor) {
  return make_each<S, R, C>([&](int i) -> S { return a.data()[i] * factor; });
}
template <class S, int R, int C>
DOCK_INLINE Fixed<S, R, C> operator/(const Eigen::Matrix<S, R, C>& a, const S& divisor) {
  return make_each<S, R, C>([&](int i) -> S { return a.data()[i] / divisor; });
}

template <class S, int R, int C>
DOCK_INLINE const S& coefficient(const Eigen::Matrix<S, R, C>& a, int i, int j) {
  return a.data()[i + R * j];
}
template <class T>
DOCK_INLINE const typename T::Scalar& coefficient(const Eigen::Transpose<T>& a, int i, int j) {
  return coefficient(a.nestedExpression(), j, i);
}
/// Coefficient (i, j) of a product. Terms are added in their order. (With Eigen the order depends
/// on the address of the result.)
template <class S, int K, class A, class B>
DOCK_INLINE S add_terms(const A& a, const B& b, int i, int j) {
  const S last = coefficient(a, i, K - 1) * coefficient(b, K - 1, j);
  if constexpr (K == 1) {
    return last;
  } else {
    return add_terms<S, K - 1>(a, b, i, j) + last;
  }
}
template <class S, int R, int K, int C, class A, class B>
DOCK_INLINE Eigen::Matrix<S, R, C> multiply_inline(const A& a, const B& b) {
  return make_each<S, R, C>([&](int n) -> S { return add_terms<S, K>(a, b, n % R, n / R); });
}
template <class S, int R, int K, int C, class A, class B>
Eigen::Matrix<S, R, C> multiply_apart(const A& a, const B& b) {
  return multiply_inline<S, R, K, C>(a, b);
}
/// Products of other scalars than double are long.
template <class S, int R, int K, int C, class A, class B>
DOCK_INLINE Eigen::Matrix<S, R, C> multiply(const A& a, const B& b) {
  if constexpr (std::is_same_v<S, double>) {
    return multiply_inline<S, R, K, C>(a, b);
  } else {
    return multiply_apart<S, R, K, C>(a, b);
  }
}
template <class S, int R, int K, int C>
DOCK_INLINE Fixed<S, R, C> operator*(const Eigen::Matrix<S, R, K>& a,
                                     const Eigen::Matrix<S, K, C>& b) {
  return multiply<S, R, K, C>(a, b);
}
template <class T, class S, int K, int C>
DOCK_INLINE Fixed<S, T::ColsAtCompileTime, C> operator*(const Eigen::Transpose<T>& a,
                                                        const Eigen::Matrix<S, K, C>& b) {
  return multiply<S, T::ColsAtCompileTime, K, C>(a, b);
}
template <class T, class S, int R, int K>
DOCK_INLINE Fixed<S, R, T::RowsAtCompileTime> operator*(const Eigen::Matrix<S, R, K>& a,
                                                        const Eigen::Transpose<T>& b) {
  return multiply<S, R, K, T::RowsAtCompileTime>(a, b);
}

/// A block, a segment or a map: copied first.
template <class B>
using Part = Eigen::MapBase<B, Eigen::ReadOnlyAccessors>;
template <class B>
DOCK_INLINE Fixed<typename B::Scalar, B::RowsAtCompileTime, B::ColsAtCompileTime> to_matrix(
    const Part<B>& part) {
  return part.derived();
}
template <class S, int R, int K, class B>
DOCK_INLINE Fixed<S, R, B::ColsAtCompileTime> operator*(const Eigen::Matrix<S, R, K>& a,
                                                        const Part<B>& b) {
  return a * to_matrix(b);
}
template <class T, class B>
DOCK_INLINE Fixed<typename B::Scalar, T::ColsAtCompileTime, B::ColsAtCompileTime> operator*(
    const Eigen::Transpose<T>& a, const Part<B>& b) {
  return a * to_matrix(b);
}
template <class B>
DOCK_INLINE Fixed<typename B::Scalar, B::RowsAtCompileTime, B::ColsAtCompileTime> operator*(
    const typename B::Scalar& factor, const Part<B>& b) {
  return factor * to_matrix(b);
}

}  // namespace dockloop

#undef DOCK_INLINE
