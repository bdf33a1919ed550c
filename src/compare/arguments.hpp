// Arguments of the programs of the command line, and the files that they name.
#pragma once

#include <string>
#include <vector>

namespace dockloop {

/// @throws ModelError naming the file
std::string read_file(const std::string& path);

/// Value of an option, or an empty text.
std::string find_option(const std::vector<std::string>& arguments, const std::string& name);

/// Values of an option that may be given several times.
std::vector<std::string> find_options(const std::vector<std::string>& arguments,
                                      const std::string& name);

/// @throws ModelError naming option and value
double find_number(const std::vector<std::string>& arguments, const std::string& name,
                   double otherwise);

bool has_flag(const std::vector<std::string>& arguments, const std::string& name);

}  // namespace dockloop
