// dockloop-core: the C++ side of the command line, called by scripts/dockloop. One sentence on
// stderr and exit status 2 for a bad file; results go to stdout.
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "docking/placement.hpp"
#include "interface/model_description.hpp"
#include "sim/docking_sim.hpp"
#include "tool/batch.hpp"
#include "tool/mechanism_check.hpp"
#include "tool/truth.hpp"

namespace {

using dockloop::ModelError;
using nlohmann::json;

constexpr const char* kUsage =
    "usage: dockloop-core check MECHANISM.json [--states STATES.json] [--newton]\n"
    "       dockloop-core place MODEL.json\n"
    "       dockloop-core describe MODEL.json --date ISO8601\n"
    "       dockloop-core truth MODEL.json --stop T --step H --output NAME [--output NAME...]\n"
    "                     [--set NAME=VALUE...] [--tolerance 1e-18] [--check]\n"
    "       dockloop-core batch MODEL.json --output NAME [--output NAME...] [--stop T] [--step H]\n"
    "                     [--end-after-outcome T] [--threads N] < CASES.jsonl > RESULTS.jsonl\n"
    "                     a case is {\"scene\": {changes}, \"set\": {\"NAME\": VALUE}}\n"
    "example: dockloop-core check modelDescription/mechanisms/idss_hexapod.json\n";

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

/// Values of an option that may be given several times.
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

template <int N>
std::vector<double> to_list(const Eigen::Matrix<double, N, 1>& v) {
  return {v.data(), v.data() + N};
}

json start_state(const dockloop::VehicleParameters& p) {
  return {{"position", to_list<3>(p.position)},
          {"velocity", to_list<3>(p.velocity)},
          {"attitude", to_list<4>(p.attitude)},
          {"angular_velocity", to_list<3>(p.angular_velocity)}};
}

int run(const std::vector<std::string>& arguments) {
  const std::string command = arguments.empty() ? "" : arguments[0];
  if (command == "--help" || command == "-h") {
    std::cout << kUsage;
    return 0;
  }
  if (arguments.size() < 2) {
    std::cerr << kUsage;
    return 2;
  }
  const std::string path = arguments[1];
  if (command == "check") {
    const std::string states = find_option(arguments, "--states");
    const bool newton = has_flag(arguments, "--newton");
    const json result =
        states.empty()
            ? dockloop::check_mechanism_file(read_file(path), path)
            : dockloop::evaluate_states(read_file(path), path, read_file(states), states, newton);
    std::cout << result.dump(1) << "\n";
    return 0;
  }
  if (command == "batch") {
    dockloop::BatchOrder order;
    const auto time = [&](const char* name) -> std::optional<double> {
      if (find_option(arguments, name).empty()) return std::nullopt;
      return find_number(arguments, name, 0.0);
    };
    order.stop = time("--stop");
    order.step = time("--step");
    order.end_after_outcome =
        find_number(arguments, "--end-after-outcome", order.end_after_outcome);
    const double threads = find_number(arguments, "--threads", 1.0);
    order.threads = threads >= 1.0 && threads <= 1e6 ? static_cast<int>(threads) : 0;
    order.outputs = find_options(arguments, "--output");
    dockloop::run_batch(read_file(path), path, order, std::cin, std::cout);
    return 0;
  }
  const dockloop::Scene scene = dockloop::read_scene(read_file(path), path);
  if (command == "place") {
    const dockloop::Placement placement = dockloop::find_placement(scene);
    const json result = {{"chaser", start_state(placement.vehicle[dockloop::kChaser])},
                         {"target", start_state(placement.vehicle[dockloop::kTarget])},
                         {"time_of_contact", placement.time_of_contact},
                         {"touches", placement.touches}};
    std::cout << result.dump(1) << "\n";
    return 0;
  }
  if (command == "describe") {
    dockloop::DockingSim sim(std::make_shared<const dockloop::Scene>(scene));
    std::cout << dockloop::make_model_description(sim, find_option(arguments, "--date"));
    return 0;
  }
  if (command == "truth") {
#ifdef DOCKLOOP_EXTENDED
    dockloop::TruthOrder order;
    order.stop = find_number(arguments, "--stop", 0.0);
    order.step = find_number(arguments, "--step", 0.0);
    order.tolerance = find_number(arguments, "--tolerance", order.tolerance);
    order.check = has_flag(arguments, "--check");
    order.outputs = find_options(arguments, "--output");
    order.settings = find_options(arguments, "--set");
    std::cout << make_truth(std::make_shared<const dockloop::Scene>(scene), order).dump(1) << "\n";
    return 0;
#else
    throw ModelError("this build has double precision only: configure with -DDOCKLOOP_EXTENDED=ON");
#endif
  }
  std::cerr << kUsage;
  return 2;
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
