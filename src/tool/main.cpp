// dockloop-core: the C++ side of the command line, called by scripts/dockloop. One sentence on
// stderr and exit status 2 for a bad file; results go to stdout.
#include <iostream>
#include <string>
#include <vector>

#include "docking/placement.hpp"
#include "docking/scene_mechanism.hpp"
#include "interface/model_description.hpp"
#include "mechanism/leg_kernel.hpp"
#include "sim/docking_sim.hpp"
#include "sim/solver_methods.hpp"
#include "tool/arguments.hpp"
#include "tool/batch.hpp"
#include "tool/mechanism_check.hpp"

namespace {

using dockloop::find_number;
using dockloop::find_option;
using dockloop::find_options;
using dockloop::has_flag;
using dockloop::read_file;
using nlohmann::json;

constexpr const char* kUsage =
    "usage: dockloop-core check MECHANISM.json [--states STATES.json] [--newton]\n"
    "       dockloop-core place MODEL.json\n"
    "       dockloop-core describe MODEL.json --date ISO8601\n"
    "       dockloop-core methods\n"
    "       dockloop-core kernel MODEL.json\n"
    "                     the kernel of the core that serves the mechanism, if there is one\n"
    "       dockloop-core batch MODEL.json --output NAME [--output NAME...] [--stop T] [--step H]\n"
    "                     [--end-after-outcome T] [--threads N] < CASES.jsonl > RESULTS.jsonl\n"
    "                     a case is {\"scene\": {changes}, \"set\": {\"NAME\": VALUE}}\n"
    "example: dockloop-core check modelDescription/mechanisms/idss_hexapod.json\n";

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

/// The list of methods, for programs.
json list_methods() {
  json list = json::array();
  for (const dockloop::MethodFacts& m : dockloop::list_methods()) {
    list.push_back({{"number", m.method},
                    {"name", m.name},
                    {"meaning", m.meaning},
                    {"same_as", m.same_as},
                    {"for_comparison", m.for_comparison},
                    {"fixed_step", m.fixed_step}});
  }
  return list;
}

int run(const std::vector<std::string>& arguments) {
  const std::string command = arguments.empty() ? "" : arguments[0];
  if (command == "--help" || command == "-h") {
    std::cout << kUsage;
    return 0;
  }
  if (command == "methods") {
    std::cout << list_methods().dump(1) << "\n";
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
  if (command == "kernel") {
    const bool serves = dockloop::make_leg_kernel(dockloop::make_scene_mechanism(scene)) != nullptr;
    std::cout << json{{"serves", serves}} << "\n";
    return 0;
  }
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
