// The members of a plain struct, one after the other, without a list of them: structured bindings
// find them, as Boost.PFR does. What holds for all members (saved states, sizes, numbers of inputs
// and outputs) then includes a new member by itself.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace dockloop {

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

// Names of up to 8 n + 8 members: n times eight, and 1 to 8 more.
// clang-format off
#define DOCKLOOP_EIGHT(x) x##0, x##1, x##2, x##3, x##4, x##5, x##6, x##7,
#define DOCKLOOP_EIGHTS_0
#define DOCKLOOP_EIGHTS_1 DOCKLOOP_EIGHT(a)
#define DOCKLOOP_EIGHTS_2 DOCKLOOP_EIGHTS_1 DOCKLOOP_EIGHT(b)
#define DOCKLOOP_EIGHTS_3 DOCKLOOP_EIGHTS_2 DOCKLOOP_EIGHT(c)
#define DOCKLOOP_EIGHTS_4 DOCKLOOP_EIGHTS_3 DOCKLOOP_EIGHT(d)
#define DOCKLOOP_EIGHTS_5 DOCKLOOP_EIGHTS_4 DOCKLOOP_EIGHT(e)
#define DOCKLOOP_EIGHTS_6 DOCKLOOP_EIGHTS_5 DOCKLOOP_EIGHT(f)
#define DOCKLOOP_EIGHTS_7 DOCKLOOP_EIGHTS_6 DOCKLOOP_EIGHT(g)
#define DOCKLOOP_EIGHTS_8 DOCKLOOP_EIGHTS_7 DOCKLOOP_EIGHT(h)
#define DOCKLOOP_EIGHTS_9 DOCKLOOP_EIGHTS_8 DOCKLOOP_EIGHT(i)
#define DOCKLOOP_MORE_1 z1
#define DOCKLOOP_MORE_2 DOCKLOOP_MORE_1, z2
#define DOCKLOOP_MORE_3 DOCKLOOP_MORE_2, z3
#define DOCKLOOP_MORE_4 DOCKLOOP_MORE_3, z4
#define DOCKLOOP_MORE_5 DOCKLOOP_MORE_4, z5
#define DOCKLOOP_MORE_6 DOCKLOOP_MORE_5, z6
#define DOCKLOOP_MORE_7 DOCKLOOP_MORE_6, z7
#define DOCKLOOP_MORE_8 DOCKLOOP_MORE_7, z8
#define DOCKLOOP_VISIT(eights, more)                                      \
  if constexpr (count == 8 * eights + more) {                             \
    auto& [DOCKLOOP_EIGHTS_##eights DOCKLOOP_MORE_##more] = value;        \
    return visit(DOCKLOOP_EIGHTS_##eights DOCKLOOP_MORE_##more);          \
  }
#define DOCKLOOP_VISITS(n)                                                    \
  DOCKLOOP_VISIT(n, 1) DOCKLOOP_VISIT(n, 2) DOCKLOOP_VISIT(n, 3)              \
  DOCKLOOP_VISIT(n, 4) DOCKLOOP_VISIT(n, 5) DOCKLOOP_VISIT(n, 6)              \
  DOCKLOOP_VISIT(n, 7) DOCKLOOP_VISIT(n, 8)

/// Calls visit(first member, second member, ...) with references, in the order of declaration.
/// @tparam T  an aggregate without base class, or const
template <class T, class Visit>
constexpr decltype(auto) visit_members(T& value, Visit&& visit) {
  static_assert(std::is_aggregate_v<T>, "a type with a constructor: give it a visit_members()");
  constexpr size_t count = count_members<std::remove_const_t<T>>();
  static_assert(count >= 1 && count <= 80, "one more line of DOCKLOOP_EIGHTS and VISITS");
  DOCKLOOP_VISITS(0) DOCKLOOP_VISITS(1) DOCKLOOP_VISITS(2) DOCKLOOP_VISITS(3) DOCKLOOP_VISITS(4)
  DOCKLOOP_VISITS(5) DOCKLOOP_VISITS(6) DOCKLOOP_VISITS(7) DOCKLOOP_VISITS(8) DOCKLOOP_VISITS(9)
}
// clang-format on

#undef DOCKLOOP_VISITS
#undef DOCKLOOP_VISIT
#undef DOCKLOOP_EIGHT
#undef DOCKLOOP_EIGHTS_0
#undef DOCKLOOP_EIGHTS_1
#undef DOCKLOOP_EIGHTS_2
#undef DOCKLOOP_EIGHTS_3
#undef DOCKLOOP_EIGHTS_4
#undef DOCKLOOP_EIGHTS_5
#undef DOCKLOOP_EIGHTS_6
#undef DOCKLOOP_EIGHTS_7
#undef DOCKLOOP_EIGHTS_8
#undef DOCKLOOP_EIGHTS_9
#undef DOCKLOOP_MORE_1
#undef DOCKLOOP_MORE_2
#undef DOCKLOOP_MORE_3
#undef DOCKLOOP_MORE_4
#undef DOCKLOOP_MORE_5
#undef DOCKLOOP_MORE_6
#undef DOCKLOOP_MORE_7
#undef DOCKLOOP_MORE_8

/// Has it elements instead of members (std::vector, std::array, matrices)?
template <class T, class = void>
struct IsList : std::false_type {};
template <class T>
struct IsList<T, std::void_t<decltype(std::declval<T&>().size())>> : std::true_type {};

template <class T, class = void>
struct IsMatrix : std::false_type {};
template <class T>
struct IsMatrix<T, std::void_t<decltype(std::declval<T&>().rows())>> : std::true_type {};

/// Calls f(S&) for every S in `value`: members and elements, in the order of declaration. Values of
/// other types (counts, choices) are left out.
template <class S, class T, class F>
void for_each_number(T& value, F&& f) {
  if constexpr (std::is_same_v<T, S>) {
    f(value);
  } else if constexpr (IsList<T>::value) {
    for (decltype(value.size()) i = 0; i < value.size(); ++i) for_each_number<S>(value[i], f);
  } else if constexpr (std::is_class_v<T>) {
    visit_members(value, [&](auto&... members) { (for_each_number<S>(members, f), ...); });
  }
}

/// Have all lists in two values the same numbers of elements?
template <class T>
bool have_same_sizes(const T& a, const T& b) {
  bool same = true;
  if constexpr (IsMatrix<T>::value) {
    same = a.rows() == b.rows() && a.cols() == b.cols();
  } else if constexpr (IsList<T>::value) {
    same = a.size() == b.size();
    for (size_t i = 0; same && i < a.size(); ++i) same = have_same_sizes(a[i], b[i]);
  } else if constexpr (std::is_class_v<T>) {
    visit_members(a, [&](auto&... of_a) {
      visit_members(b, [&](auto&... of_b) { same = (have_same_sizes(of_a, of_b) && ...); });
    });
  }
  return same;
}

}  // namespace dockloop
