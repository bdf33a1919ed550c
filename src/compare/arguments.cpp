// See arguments.hpp.
#include "compare/arguments.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "math/status.hpp"

namespace dockloop {

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw ModelError(path + ": cannot be read");
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string find_option(const std::vector<std::string>& arguments, const std::string& name) {
  for (size_t i = 0; i + 1 < arguments.size(); ++i) {
    if (arguments[i] == name) return arguments[i + 1];
  }
  return "";
}

std::vector<std::string> find_options(const std::vector<std::string>& arguments,
                                      const std::string& name) {
  std::vector<std::string> values;
  for (size_t i = 0; i + 1 < arguments.size(); ++i) {
    if (arguments[i] == name) values.push_back(arguments[i + 1]);
  }
  return values;
}

double find_number(const std::vector<std::string>& arguments, const std::string& name,
                   double otherwise) {
  const std::string text = find_option(arguments, name);
  if (text.empty()) return otherwise;
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  if (*end) throw ModelError(name + " " + text + ": must be a number");
  return number;
}

bool has_flag(const std::vector<std::string>& arguments, const std::string& name) {
  for (const std::string& argument : arguments) {
    if (argument == name) return true;
  }
  return false;
}

}  // namespace dockloop
