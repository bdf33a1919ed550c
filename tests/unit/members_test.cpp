// Visits of the members of a struct, and what follows from them.
//
// Verified: (1) members are visited once each, in their order, up to the largest number that the
// visitor knows; (2) numbers are found in members, elements and members of elements, others are
// left out; (3) sizes are compared at every depth; (4) bytes contain every member, and every change
// of a struct changes the number of its format.
#include <gtest/gtest.h>

#include <array>
#include <numeric>
#include <set>

#include "math/types.hpp"
#include "sim/archive.hpp"
#include "sim/values.hpp"

namespace dockloop {
namespace {

struct One {
  double only = 1.0;
};
struct Eight {
  int a = 1, b = 2, c = 3, d = 4, e = 5, f = 6, g = 7, h = 8;
};
struct Nine {
  int a = 1, b = 2, c = 3, d = 4, e = 5, f = 6, g = 7, h = 8, i = 9;
};
struct Eighty {
  int a0 = 1, a1 = 2, a2 = 3, a3 = 4, a4 = 5, a5 = 6, a6 = 7, a7 = 8, a8 = 9, a9 = 10, b0 = 11,
      b1 = 12, b2 = 13, b3 = 14, b4 = 15, b5 = 16, b6 = 17, b7 = 18, b8 = 19, b9 = 20, c0 = 21,
      c1 = 22, c2 = 23, c3 = 24, c4 = 25, c5 = 26, c6 = 27, c7 = 28, c8 = 29, c9 = 30, d0 = 31,
      d1 = 32, d2 = 33, d3 = 34, d4 = 35, d5 = 36, d6 = 37, d7 = 38, d8 = 39, d9 = 40, e0 = 41,
      e1 = 42, e2 = 43, e3 = 44, e4 = 45, e5 = 46, e6 = 47, e7 = 48, e8 = 49, e9 = 50, f0 = 51,
      f1 = 52, f2 = 53, f3 = 54, f4 = 55, f5 = 56, f6 = 57, f7 = 58, f8 = 59, f9 = 60, g0 = 61,
      g1 = 62, g2 = 63, g3 = 64, g4 = 65, g5 = 66, g6 = 67, g7 = 68, g8 = 69, g9 = 70, h0 = 71,
      h1 = 72, h2 = 73, h3 = 74, h4 = 75, h5 = 76, h6 = 77, h7 = 78, h8 = 79, h9 = 80;
};

template <class T>
std::vector<int> list(const T& value) {
  std::vector<int> all;
  visit_members(value, [&](const auto&... m) { (all.push_back(static_cast<int>(m)), ...); });
  return all;
}

TEST(Members, AreVisitedOnceInTheirOrder) {
  const auto count_to = [](int n) {
    std::vector<int> all(static_cast<size_t>(n));
    std::iota(all.begin(), all.end(), 1);
    return all;
  };
  EXPECT_EQ(list(One()), count_to(1));
  EXPECT_EQ(list(Eight()), count_to(8));
  EXPECT_EQ(list(Nine()), count_to(9));
  EXPECT_EQ(list(Eighty()), count_to(80));
}

struct Mixed {
  double first = 1.0;
  int count = 50;
  Vec3<double> vector{2.0, 3.0, 4.0};
  std::array<One, 2> pair{One{5.0}, One{6.0}};
  bool is_on = true;
  std::vector<double> list = {7.0, 8.0};
};

TEST(Members, NumbersAreFoundAtEveryDepth) {
  Mixed mixed;
  std::vector<double> found;
  for_each_number<double>(mixed, [&](double& x) { found.push_back(x); });
  EXPECT_EQ(found, (std::vector<double>{1, 2, 3, 4, 5, 6, 7, 8}));
  std::vector<int> counts;
  for_each_number<int>(mixed, [&](int& n) { counts.push_back(n); });
  EXPECT_EQ(counts, std::vector<int>{50});
}

struct Deep {
  std::vector<std::vector<double>> lists;
  std::vector<MatX<double>> matrices;
};

TEST(Members, SizesAreComparedAtEveryDepth) {
  const Deep a{{{1.0}, {2.0, 3.0}}, {MatX<double>::Zero(2, 3)}};
  Deep b{{{4.0}, {5.0, 6.0}}, {MatX<double>::Ones(2, 3)}};
  EXPECT_TRUE(have_same_sizes(a, b));
  b.lists[1].pop_back();
  EXPECT_FALSE(have_same_sizes(a, b));
  b = a;
  b.matrices[0] = MatX<double>::Zero(3, 2);
  EXPECT_FALSE(have_same_sizes(a, b));
  b = a;
  b.matrices.clear();
  EXPECT_FALSE(have_same_sizes(a, b));
}

TEST(Members, GiveEveryListOfOutputsTheSizeOfItsKind) {
  ListSizes sizes;
  std::iota(sizes.begin(), sizes.end(), size_t{3});
  OutputValues<double> values;
  set_sizes(sizes, values);
  EXPECT_EQ(values.petal_force.size(), 3 + static_cast<size_t>(Per::kPetal));
  EXPECT_EQ(values.leg_rate.size(), 3 + static_cast<size_t>(Per::kLeg));
  EXPECT_EQ(values.loop_force.size(), 3 + static_cast<size_t>(Per::kLoop));
}

TEST(Members, BytesContainAllOfThem) {
  Mixed before;
  before.list = {9.0};
  before.pair[1].only = -1.0;
  ByteWriter writer;
  transfer(writer, before);
  const std::vector<char> bytes = writer.take();
  EXPECT_EQ(bytes.size(), 8u + 4 + 24 + 16 + 1 + 8 + 8);
  ByteReader reader(bytes.data(), bytes.size());
  Mixed after;
  after.count = 0;
  after.is_on = false;
  after.vector.setZero();
  transfer(reader, after);
  EXPECT_EQ(reader.left(), 0u);
  EXPECT_EQ(after.count, 50);
  EXPECT_TRUE(after.is_on);
  EXPECT_EQ(after.vector, before.vector);
  EXPECT_EQ(after.pair[1].only, -1.0);
  EXPECT_EQ(after.list, before.list);
}

enum class Kind : int { kFirst };
struct Start {
  double a;
  int b;
  std::vector<One> c;
};
struct Added {
  double a;
  int b;
  std::vector<One> c;
  bool d;
};
struct Moved {
  int b;
  double a;
  std::vector<One> c;
};
struct Retyped {
  double a;
  Kind b;
  std::vector<One> c;
};
struct Inside {
  double a;
  int b;
  std::vector<Eight> c;
};
struct Longer {
  double a;
  int b;
  std::array<One, 2> c;
};
struct Fixed {
  double a;
  int b;
  std::array<One, 3> c;
};
struct Same {
  double other_name;
  int b;
  std::vector<One> c;
};

TEST(Formats, ChangeWithEveryChangeOfAStruct) {
  const std::set<std::uint32_t> all = {
      find_format<Start>(),  find_format<Added>(),  find_format<Moved>(), find_format<Retyped>(),
      find_format<Inside>(), find_format<Longer>(), find_format<Fixed>()};
  EXPECT_EQ(all.size(), 7u);
  EXPECT_EQ(find_format<Start>(), find_format<Same>());
}

}  // namespace
}  // namespace dockloop
