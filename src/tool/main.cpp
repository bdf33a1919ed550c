// dockloop-core: the C++ program for `dockloop truth`, the one command that needs 32 digits. One
// sentence on stderr and exit status 2 for a bad file; results go to stdout.
#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "math/status.hpp"
#include "tool/truth.hpp"

namespace {

using dockloop::ModelError;
using Arguments = std::vector<std::string>;

constexpr const char* kUsage =
    "usage: dockloop-core truth MODEL.json --stop T --step H --output NAME [--output NAME...]\n"
    "                     [--set NAME=VALUE...] [--tolerance 1e-18] [--check]\n";

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw ModelError(path + ": cannot be read");
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

/// Values of an option that may be given several times.
Arguments find_options(const Arguments& arguments, const std::string& name) {
  Arguments values;
  for (size_t i = 0; i + 1 < arguments.size(); ++i) {
    if (arguments[i] == name) values.push_back(arguments[i + 1]);
  }
  return values;
}

double find_number(const Arguments& arguments, const std::string& name, double otherwise) {
  const Arguments found = find_options(arguments, name);
  if (found.empty()) return otherwise;
  char* end = nullptr;
  const double number = std::strtod(found[0].c_str(), &end);
  if (*end) throw ModelError(name + " " + found[0] + ": must be a number");
  return number;
}

int run(const Arguments& arguments) {
  if (arguments.size() < 2 || arguments[0] != "truth") {
    const bool is_help = !arguments.empty() && (arguments[0] == "--help" || arguments[0] == "-h");
    (is_help ? std::cout : std::cerr) << kUsage;
    return is_help ? 0 : 2;
  }
  const std::string& path = arguments[1];
  const auto scene =
      std::make_shared<const dockloop::Scene>(dockloop::read_scene(read_file(path), path));
  dockloop::TruthOrder order;
  order.stop = find_number(arguments, "--stop", 0.0);
  order.step = find_number(arguments, "--step", 0.0);
  order.tolerance = find_number(arguments, "--tolerance", order.tolerance);
  order.check = std::count(arguments.begin(), arguments.end(), "--check") > 0;
  order.outputs = find_options(arguments, "--output");
  order.settings = find_options(arguments, "--set");
  std::cout << make_truth(scene, order).dump(1) << "\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 2;
  }
}
