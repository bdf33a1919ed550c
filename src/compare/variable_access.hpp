// Variables of a DockingSim by name, with the checks of the FMU.
#pragma once

#include <string>
#include <vector>

#include "interface/variables.hpp"

namespace dockloop {

/// @throws ModelError naming what is not there
const Variable& find_variable(const std::vector<Variable>& variables, const std::string& name);

/// Set a start value, 0 or 1 for a Boolean. @throws ModelError naming variable, value and limit
void set_start(const Variable& v, double value);

/// The present value as a number, 0 or 1 for a Boolean.
double get_value(const Variable& v);

}  // namespace dockloop
