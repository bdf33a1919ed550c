// Cases by threads: each takes the next line when it has finished the last one; see batch.hpp.
#include "tool/batch.hpp"

#include <cmath>
#include <istream>
#include <map>
#include <memory>
#include <mutex>
#include <ostream>
#include <system_error>
#include <thread>

#include "docking/phases.hpp"
#include "docking/placement.hpp"
#include "model/json_reader.hpp"
#include "sim/docking_sim.hpp"
#include "tool/variable_access.hpp"

namespace dockloop {
namespace {

using nlohmann::json;

/// Communication points of a run: multiples of the step, and its end.
struct Schedule {
  double start, stop, step;  ///< [s]
  int count;                 ///< of steps
  double at(int k) const { return k == count ? stop : start + step * k; }
};

Schedule make_schedule(const Experiment& experiment, const BatchOrder& order) {
  constexpr double kMostSteps = 1e7, kRounding = 1e-12;
  const double start = experiment.start, stop = order.stop.value_or(experiment.stop);
  const double step = order.step.value_or(experiment.step);
  const double count = std::ceil((stop - start) / step * (1.0 - kRounding));
  if (!(step > 0.0 && stop > start && count <= kMostSteps)) {
    throw ModelError("--stop " + std::to_string(stop) + " --step " + std::to_string(step) +
                     ": must be times with 0 < step, start < stop and at most 1e7 steps between");
  }
  return {start, stop, step, static_cast<int>(count)};
}

/// The scene of a case, vehicles placed. Errors name the file.
std::shared_ptr<const Scene> make_scene(const json& document, const std::string& source,
                                        json& result) {
  try {
    auto scene = std::make_shared<Scene>(read_scene(document.dump(), source));
    if (!scene->conditions.given) return scene;
    Placement placement = find_placement(*scene);
    scene->vehicle = placement.vehicle;
    result["touches"] = placement.touches;
    return scene;
  } catch (const ModelError& error) {
    const std::string text = error.what();
    throw ModelError(text.find(source) == std::string::npos ? source + ": " + text : text);
  }
}

std::vector<const Variable*> find_outputs(const std::vector<Variable>& variables,
                                          const std::vector<std::string>& names) {
  std::vector<const Variable*> outputs;
  for (const std::string& name : names) {
    const Variable& v = find_variable(variables, name);
    if (v.causality != Causality::kOutput) throw ModelError("'" + name + "' is no output");
    outputs.push_back(&v);
  }
  return outputs;
}

void set_starts(const std::vector<Variable>& variables, const json& starts) {
  for (const auto& [name, value] : starts.items()) {
    if (!value.is_number() && !value.is_boolean()) {
      throw ModelError("'" + name + "' = " + value.dump() + ": must be a number, true or false");
    }
    set_start(find_variable(variables, name),
              value.is_boolean() ? double(value.get<bool>()) : value.get<double>());
  }
}

void take_warnings(DockingSim& sim, json& result) {
  for (const std::string& text : sim.take_warnings()) result["warnings"].push_back(text);
}

void check(const DockingSim& sim, const Status& status) {
  if (!status.ok()) throw ModelError(sim.describe(status));
}

/// Step to the end, or until the outcome has been decided for long enough.
void step_to_end(DockingSim& sim, const Schedule& schedule, double patience, json& result) {
  int decision = kUndecided;
  double since = schedule.start;
  for (int k = 0; k < schedule.count; ++k) {
    const double begin = schedule.at(k), end = schedule.at(k + 1);
    if (!sim.step(begin, end - begin).ok()) throw ModelError(sim.status_text());
    result["end_time"] = end;
    take_warnings(sim, result);
    if (std::isinf(patience)) continue;
    check(sim, sim.update(OutputGroup::kMain));
    if (sim.output_storage().outcome != decision) {
      decision = sim.output_storage().outcome;
      since = end;
    }
    // A partial capture may still become one.
    if (decision != kUndecided && decision != kPartialCapture && end - since >= patience) return;
  }
}

void read_outputs(DockingSim& sim, const std::vector<const Variable*>& outputs, json& result) {
  result["outputs"] = json::array();
  for (const Variable* v : outputs) {
    check(sim, sim.update(v->group));
    const double value = get_value(*v);
    result["outputs"].push_back(v->type == Type::kReal ? json(value) : json(int(value)));
  }
}

/// Runs one case and fills its result as far as it comes.
void run_case(const json& base, const std::string& source, const BatchOrder& order,
              const std::string& line, json& result) {
  const json given = parse_json(line, "case");
  if (!given.is_object()) throw ModelError("case: must be an object, not " + given.dump());
  for (const auto& [name, value] : given.items()) {
    if ((name != "scene" && name != "set") || !value.is_object()) {
      throw ModelError("case: member '" + name + "' must be 'scene' or 'set', and an object");
    }
  }
  json document = base;
  if (given.contains("scene")) document.merge_patch(given["scene"]);
  const auto scene = make_scene(document, source, result);
  const Schedule schedule = make_schedule(scene->experiment, order);
  DockingSim sim(scene);
  const std::vector<Variable> variables = make_variables(sim);
  const std::vector<const Variable*> outputs = find_outputs(variables, order.outputs);
  result["end_time"] = schedule.start;
  if (given.contains("set")) set_starts(variables, given["set"]);
  sim.initialise(schedule.start, 0.0);
  take_warnings(sim, result);
  result["status"] = "failed";
  step_to_end(sim, schedule, order.end_after_outcome, result);
  read_outputs(sim, outputs, result);
  result["status"] = "done";
}

std::string find_result(const json& base, const std::string& source, const BatchOrder& order,
                        const std::string& line) {
  json result = {{"status", "refused"}, {"warnings", json::array()}};
  try {
    run_case(base, source, order, line, result);
  } catch (const std::exception& error) {
    result["reason"] = error.what();
  }
  return result.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace

void run_batch(const std::string& document, const std::string& source, const BatchOrder& order,
               std::istream& cases, std::ostream& results) {
  constexpr int kMostThreads = 1024;
  if (order.threads < 1 || order.threads > kMostThreads) {
    throw ModelError("--threads must be from 1 to " + std::to_string(kMostThreads));
  }
  if (order.outputs.empty()) throw ModelError("say what to write: --output NAME (repeatable)");
  const json base = parse_json(document, source);
  // Names that no case could have are told before the first one.
  DockingSim first(std::make_shared<const Scene>(read_scene(document, source)));
  const std::vector<Variable> variables = make_variables(first);
  find_outputs(variables, order.outputs);
  if (!std::isinf(order.end_after_outcome)) find_variable(variables, "outcome");

  std::mutex reading, writing;
  size_t taken = 0, written = 0;
  std::map<size_t, std::string> waiting;  // results that another one must precede
  const auto work = [&] {
    std::string line;
    while (true) {
      size_t number = 0;
      {
        const std::lock_guard<std::mutex> lock(reading);
        if (!std::getline(cases, line)) return;
        number = taken++;
      }
      std::string result = find_result(base, source, order, line);
      const std::lock_guard<std::mutex> lock(writing);
      waiting.emplace(number, std::move(result));
      for (; !waiting.empty() && waiting.begin()->first == written; ++written) {
        results << waiting.begin()->second << std::endl;
        waiting.erase(waiting.begin());
      }
    }
  };
  std::vector<std::thread> threads;
  try {
    for (int i = 1; i < order.threads; ++i) threads.emplace_back(work);
  } catch (const std::system_error&) {  // no more to be had: the others do the work
  }
  work();
  for (std::thread& thread : threads) thread.join();
}

}  // namespace dockloop
