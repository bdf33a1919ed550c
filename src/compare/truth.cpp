// Runs a scene through DockingSim with extended precision; see truth.hpp.
#include "compare/truth.hpp"

#include <algorithm>
#include <cmath>
#include <iostream>

#include "compare/extended_precision.hpp"
#include "compare/variable_access.hpp"
#include "math/status.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {
namespace {

using nlohmann::json;

void set(const std::vector<Variable>& variables, const std::string& setting) {
  const size_t equals = setting.find('=');
  const Variable& v = find_variable(variables, setting.substr(0, equals));
  const std::string text = equals == std::string::npos ? "" : setting.substr(equals + 1);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end) throw ModelError(setting + ": must be NAME=NUMBER");
  set_start(v, value);
}

/// Values per output and time point, and the work that they took.
struct Run {
  std::vector<double> time;
  std::vector<std::vector<double>> values;
  double steps = 0.0, rejected = 0.0, evaluations = 0.0;
};

Run run(const std::shared_ptr<const Scene>& scene, const SolutionOrder& order, double tolerance,
        int done_before, int of) {
  const ExtendedPrecision precision(tolerance);
  DockingSim sim(scene, FmiKind::kCoSimulation, &precision);
  const std::vector<Variable> variables = make_variables(sim);
  for (const std::string& setting : order.settings) set(variables, setting);
  std::vector<const Variable*> wanted;
  for (const std::string& name : order.outputs) wanted.push_back(&find_variable(variables, name));
  sim.initialise(0.0, 0.0);
  Run result;
  result.values.resize(wanted.size());
  const int count = static_cast<int>(std::round(order.stop / order.step));
  std::vector<double> extended;
  for (int k = 0; k <= count; ++k) {
    Status status;
    if (k > 0) status = sim.step((k - 1) * order.step, order.step);
    if (!status.ok()) throw std::runtime_error(sim.status_text());
    status = precision.calc_outputs(extended);
    if (!status.ok()) throw std::runtime_error(sim.describe(status));
    for (const Variable* v : wanted) sim.update(v->group);
    result.time.push_back(k * order.step);
    for (size_t i = 0; i < wanted.size(); ++i) {
      const int place = wanted[i]->output, state = wanted[i]->state;
      result.values[i].push_back(place >= 0   ? extended[static_cast<size_t>(place)]
                                 : state >= 0 ? precision.states()[state].high
                                              : get_value(*wanted[i]));
    }
    std::cerr << "progress " << done_before + k << " " << of << std::endl;
  }
  const Outputs& end = sim.outputs();
  result.steps = end.solver_steps;
  result.rejected = end.solver_rejected_steps;
  result.evaluations = end.solver_rhs_evaluations;
  return result;
}

}  // namespace

json make_solution(std::shared_ptr<const Scene> scene, const SolutionOrder& order) {
  constexpr double kCoarser = 1000.0;
  constexpr double kLeast = 1e-26, kMost = 1e-3, kMostSteps = 1e6;
  if (!(order.step > 0.0 && order.stop >= order.step && order.stop <= kMostSteps * order.step)) {
    throw ModelError("--stop and --step must be times with 0 < step <= stop <= 1e6 step");
  }
  if (!(order.tolerance >= kLeast && order.tolerance <= kMost)) {
    throw ModelError("--tolerance must be from 1e-26 to 1e-3");
  }
  if (order.outputs.empty()) throw ModelError("say what to write: --output NAME (repeatable)");
  const int points = static_cast<int>(std::round(order.stop / order.step)) + 1;
  const int all = order.check ? 2 * points : points;
  const Run solution = run(scene, order, order.tolerance, 0, all - 1);
  json result = {{"scene", scene->name},
                 {"settings", order.settings},
                 {"digits", std::numeric_limits<Extended>::digits10},
                 {"tolerance", order.tolerance},
                 {"work",
                  {{"steps", solution.steps},
                   {"rejected_steps", solution.rejected},
                   {"evaluations", solution.evaluations}}},
                 {"time", solution.time}};
  for (size_t i = 0; i < order.outputs.size(); ++i) {
    result["output"][order.outputs[i]] = solution.values[i];
  }
  if (!order.check) return result;
  const Run coarse = run(scene, order, kCoarser * order.tolerance, points, all - 1);
  result["check"]["tolerance"] = kCoarser * order.tolerance;
  for (size_t i = 0; i < order.outputs.size(); ++i) {
    double largest = 0.0;
    for (size_t k = 0; k < solution.time.size(); ++k) {
      largest = std::max(largest, std::abs(solution.values[i][k] - coarse.values[i][k]));
    }
    result["check"]["difference"][order.outputs[i]] = largest;
  }
  return result;
}

}  // namespace dockloop
