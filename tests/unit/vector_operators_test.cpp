// Operators of vectors and matrices of fixed size, for plain numbers and for dual ones, bit by bit:
// 1. sums, differences, multiples against Eigen's own;
// 2. products of plain and transposed factors: terms are added in their order;
// 3. parts of others, wherever they lie in memory.
#include "math/vector_operators.hpp"

#include <gtest/gtest.h>

#include "math/scalar.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

template <class S>
void put_random(TestRandom& random, S& x) {
  x = S(random.uniform(-1, 1));
  if constexpr (!std::is_same_v<S, double>) {
    for (double& d : x.d) d = random.uniform(-1, 1);
  }
}
template <class Matrix>
Matrix make_random(TestRandom& random) {
  Matrix made;
  for (int i = 0; i < made.size(); ++i) put_random(random, made.data()[i]);
  return made;
}

/// @param library  of Eigen: its matrices have Eigen's operators as members
template <class Own, class Library>
void expect_same(const Own& own, const Library& library) {
  static_assert(std::is_same_v<Own, typename Library::PlainObject>);
  EXPECT_TRUE((own.array() == library.eval().array()).all());
}

template <class S>
class VectorOperators : public ::testing::Test {};
using Scalars = ::testing::Types<double, Derivative>;
TYPED_TEST_SUITE(VectorOperators, Scalars);

template <class S, int R, int C>
void compare_sums(TestRandom& random) {
  using M = Eigen::Matrix<S, R, C>;
  const M a = make_random<M>(random), b = make_random<M>(random);
  S factor;
  put_random(random, factor);
  expect_same(a + b, a.operator+(b));
  expect_same(a - b, a.operator-(b));
  expect_same(-a, a.operator-());
  expect_same(a * factor, a.operator*(factor));
  expect_same(factor * a, a.operator*(factor));
  expect_same(a / factor, a.operator/(factor));
}

TYPED_TEST(VectorOperators, sums) {
  TestRandom random(71);
  for (int trial = 0; trial < 20; ++trial) {
    compare_sums<TypeParam, 3, 1>(random);
    compare_sums<TypeParam, 3, 3>(random);
    compare_sums<TypeParam, 4, 1>(random);
    compare_sums<TypeParam, 6, 1>(random);
    compare_sums<TypeParam, 6, 6>(random);
  }
}

template <class A, class B>
auto multiply_in_order(const A& a, const B& b) {
  Eigen::Matrix<typename A::Scalar, A::RowsAtCompileTime, B::ColsAtCompileTime> product;
  for (int i = 0; i < a.rows(); ++i) {
    for (int j = 0; j < b.cols(); ++j) {
      product(i, j) = a(i, 0) * b(0, j);
      for (int k = 1; k < a.cols(); ++k) product(i, j) += a(i, k) * b(k, j);
    }
  }
  return product;
}

template <class S, int R, int K, int C>
void compare_products(TestRandom& random) {
  const auto a = make_random<Eigen::Matrix<S, R, K>>(random);
  const auto b = make_random<Eigen::Matrix<S, K, C>>(random);
  const Eigen::Matrix<S, K, R> turned = a.transpose();
  Eigen::Matrix<S, C, K> other = b.transpose();
  const Eigen::Matrix<S, R, C> expected = multiply_in_order(a, b);
  expect_same(a * b, expected);
  expect_same(turned.transpose() * b, expected);
  expect_same(a * other.transpose(), expected);
}

TYPED_TEST(VectorOperators, products) {
  TestRandom random(72);
  for (int trial = 0; trial < 20; ++trial) {
    compare_products<TypeParam, 3, 3, 1>(random);
    compare_products<TypeParam, 3, 3, 3>(random);
    compare_products<TypeParam, 2, 3, 3>(random);
    compare_products<TypeParam, 6, 6, 1>(random);
    compare_products<TypeParam, 3, 1, 3>(random);  // of two vectors
  }
}

TYPED_TEST(VectorOperators, parts) {
  TestRandom random(73);
  for (int trial = 0; trial < 20; ++trial) {
    const auto M = make_random<Mat3<TypeParam>>(random), N = make_random<Mat3<TypeParam>>(random);
    const auto v = make_random<Vec6<TypeParam>>(random);
    const Eigen::Map<const Vec3<TypeParam>> map(v.data() + 2);
    TypeParam factor;
    put_random(random, factor);
    for (int at = 0; at < 4; ++at) {
      const VecX<TypeParam> x = v;
      expect_same(M * x.template segment<3>(at), multiply_in_order(M, x.template segment<3>(at)));
    }
    expect_same(M * N.col(1), multiply_in_order(M, N.col(1)));
    expect_same(M.transpose() * v.template head<3>(),
                multiply_in_order(M.transpose(), v.template head<3>()));
    expect_same(M * map, multiply_in_order(M, map));
    expect_same(factor * map, map.operator*(factor));
    expect_same(cast<TypeParam>(M), M);
  }
}

TEST(VectorOperators, casts) {
  TestRandom random(74);
  const auto M = make_random<Mat3<double>>(random);
  expect_same(cast<Derivative>(M), M.cast<Derivative>());
}

}  // namespace
}  // namespace dockloop
