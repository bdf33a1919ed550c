// Numbers of a law as a list: name, member, unit, limit, meaning. Readers of files, checks and
// parameters of the FMU follow such a list.
#pragma once

#include <cstddef>
#include <string>

#include "math/status.hpp"

namespace dockloop {

/// What a number may be.
enum class Rule { kAny, kNotNegative, kPositive, kShare };

/// Is a number as its rule says? @return the rest of a sentence; empty if it is
inline std::string find_fault(double number, Rule rule) {
  switch (rule) {
    case Rule::kAny:
      break;
    case Rule::kNotNegative:
      if (!(number >= 0.0)) return "it must be 0 or more";
      break;
    case Rule::kPositive:
      if (!(number > 0.0)) return "it must be above 0";
      break;
    case Rule::kShare:
      if (!(number >= 0.0 && number <= 1.0)) return "it must be from 0 to 1";
      break;
  }
  return "";
}

/// A number of a law of hardware. It has one name in files and in the FMU.
template <class Law>
struct LawNumber {
  const char* name;
  double Law::* member;
  const char* unit;  ///< of unit_definitions() in src/interface; empty: of a slide or a turn
  Rule rule;
  bool is_required;  ///< a file must state it
  const char* text;
};

/// What is wrong with the numbers of a law, as the rest of a sentence; empty if nothing is.
template <class Law, size_t n>
std::string find_fault(const Law& law, const LawNumber<Law> (&list)[n]) {
  for (const LawNumber<Law>& each : list) {
    const std::string why = find_fault(law.*each.member, each.rule);
    if (why.empty()) continue;
    return std::string(each.name) + " is " + describe_number(law.*each.member) + "; " + why;
  }
  return "";
}

/// f(name, number, unit, rule, text) for every number of a law. @param law  a Law, or const
template <class Law, class Same, size_t n, class F>
void for_each_number(const LawNumber<Law> (&list)[n], Same& law, const std::string& prefix, F&& f) {
  for (const LawNumber<Law>& each : list) {
    f(prefix + each.name, law.*each.member, each.unit, each.rule, std::string(each.text));
  }
}

}  // namespace dockloop
