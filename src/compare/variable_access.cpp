// By name and as numbers; see variable_access.hpp.
#include "compare/variable_access.hpp"

#include <algorithm>
#include <climits>
#include <cmath>

#include "math/status.hpp"

namespace dockloop {

const Variable& find_variable(const std::vector<Variable>& variables, const std::string& name) {
  const auto found = std::find_if(variables.begin(), variables.end(),
                                  [&](const Variable& v) { return v.name == name; });
  if (found != variables.end()) return *found;
  throw ModelError("there is no variable '" + name +
                   "': names are those of modelDescription.xml in the FMU of this scene");
}

void set_start(const Variable& v, double value) {
  if (!v.has_start()) throw ModelError("'" + v.name + "' is computed and cannot be set");
  switch (v.type) {
    case Type::kReal:
      check_value(v, value, "fmi2SetReal");
      *static_cast<double*>(v.start) = value;
      break;
    case Type::kInteger:
      check_value(v, value, "fmi2SetInteger");
      if (value != std::floor(value) || std::abs(value) > INT_MAX) {
        throw ModelError("'" + v.name + "' must be a whole number");
      }
      *static_cast<int*>(v.start) = static_cast<int>(value);
      break;
    case Type::kBoolean:
      check_value(v, value, "fmi2SetBoolean");
      *static_cast<char*>(v.start) = value != 0.0;
      break;
  }
}

double get_value(const Variable& v) {
  switch (v.type) {
    case Type::kInteger:
      return *static_cast<const int*>(v.value);
    case Type::kBoolean:
      return *static_cast<const char*>(v.value);
    default:
      return *static_cast<const double*>(v.value);
  }
}

}  // namespace dockloop
