// A choice: an Integer in the FMU, a name in files and tables. Each choice has one list of values.
// Numbers, names, descriptions and messages follow from this list.
#pragma once

#include <string>
#include <vector>

#include "math/status.hpp"

namespace dockloop {

struct Choice {
  int number;           ///< in the FMU; numbers of a list are 1, 2, ...
  const char* name;     ///< in scenes, tables and summaries
  const char* meaning;  ///< explanation of the name; may be empty
};
using ChoiceList = std::vector<Choice>;

/// "1 rigid (one body), 2 reduced": for descriptions of variables.
inline std::string list_choices(const ChoiceList& list) {
  std::string text;
  for (const Choice& choice : list) {
    if (!text.empty()) text += ", ";
    text += std::to_string(choice.number) + ' ' + choice.name;
    if (*choice.meaning) text += std::string(" (") + choice.meaning + ')';
  }
  return text;
}

/// "rigid, massless_legs or reduced", with numbers "1 (rigid), 2 (massless_legs) or 3 (reduced)":
/// for messages.
inline std::string list_names(const ChoiceList& list, bool with_numbers = false) {
  std::string text;
  for (const Choice& choice : list) {
    if (!text.empty()) text += choice.number == list.back().number ? " or " : ", ";
    text += with_numbers ? std::to_string(choice.number) + " (" + choice.name + ')' : choice.name;
  }
  return text;
}

/// Number of a name, 0 if there is none of that name.
inline int find_choice(const ChoiceList& list, const std::string& name) {
  for (const Choice& choice : list) {
    if (choice.name == name) return choice.number;
  }
  return 0;
}

/// @throws ModelError naming the variable, its value and the possible values
inline void check_choice(int value, const ChoiceList& list, const char* variable) {
  if (value >= 1 && value <= list.back().number) return;
  throw ModelError(std::string(variable) + " is " + std::to_string(value) + "; it must be " +
                   list_names(list, true));
}

}  // namespace dockloop
