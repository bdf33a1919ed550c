// dockloop-compare: what the command line asks of src/compare. One sentence on stderr and exit
// status 2 for a bad file; results go to stdout.
#include <iostream>
#include <string>
#include <vector>

#include "compare/arguments.hpp"
#include "compare/comparison.hpp"
#include "compare/truth.hpp"
#include "interface/model_description.hpp"

namespace {

constexpr const char* kUsage =
    "usage: dockloop-compare truth MODEL.json --stop T --step H --output NAME [--output NAME...]\n"
    "                        [--set NAME=VALUE...] [--tolerance 1e-18] [--check]\n"
    "       dockloop-compare describe MODEL.json --date ISO8601\n"
    "example: dockloop-compare truth model.json --stop 3 --step 0.1 --output relative.axial\n";

int run(const std::vector<std::string>& arguments) {
  using namespace dockloop;
  const std::string command = arguments.empty() ? "" : arguments[0];
  if (command == "--help" || command == "-h") {
    std::cout << kUsage;
    return 0;
  }
  if (arguments.size() < 2 || (command != "truth" && command != "describe")) {
    std::cerr << kUsage;
    return 2;
  }
  const std::string& path = arguments[1];
  const auto scene = std::make_shared<const Scene>(read_scene(read_file(path), path));
  if (command == "describe") {
    DockingSim sim(scene, FmiKind::kCoSimulation, get_comparison());
    std::cout << make_model_description(sim, find_option(arguments, "--date"));
    return 0;
  }
  SolutionOrder order;
  order.stop = find_number(arguments, "--stop", 0.0);
  order.step = find_number(arguments, "--step", 0.0);
  order.tolerance = find_number(arguments, "--tolerance", order.tolerance);
  order.check = has_flag(arguments, "--check");
  order.outputs = find_options(arguments, "--output");
  order.settings = find_options(arguments, "--set");
  std::cout << make_solution(scene, order).dump(1) << "\n";
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
