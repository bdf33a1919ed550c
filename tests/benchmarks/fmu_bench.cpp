// What an FMU costs its host, through the C interface.
//
//   fmu_bench docking FOLDER [--quick]           its default experiment, step by step; get and set
//   fmu_bench exchange FOLDER [--quick]          a derivative of model exchange, at the start
//   fmu_bench motion FOLDER REFERENCE.json [METHOD] [--quick]
//                                                accuracy of hexapod_bench against time
//
// FOLDER: an unpacked FMU, absolute. A run repeats bit for bit, so that every single step is timed
// in several runs and its least time counts; times of steps are added up afterwards. Times are
// those of the processor. Prints JSON as Google Benchmark does: {"benchmarks": [{"name",
// "cpu_time" (ns), counters...}]}.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

#include "benchmarks/fmu_library.hpp"

namespace {

using dockloop::FmuLibrary;
using nlohmann::json;

json results = json::array();

json& put(const std::string& name, double nanoseconds) {
  results.push_back({{"name", name}, {"run_type", "iteration"}, {"cpu_time", nanoseconds}});
  return results.back();
}

/// Processor time of this thread [ns].
double now() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e9 * static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec);
}

/// What looking at the clock costs [ns].
double find_clock_time() {
  double least = 1e300;
  for (int i = 0; i < 1000; ++i) {
    const double before = now();
    least = std::min(least, now() - before);
  }
  return least;
}

/// [ns]
template <class Work>
double time(Work work) {
  static const double clock = find_clock_time();
  const double before = now();
  work();
  return now() - before - clock;
}

/// Least time of one call [ns], calls too short for the clock in batches.
template <class Work>
double find_least(Work work, int batches = 50, int calls = 200) {
  double least = 1e300;
  for (int i = 0; i < batches; ++i) {
    least = std::min(least, time([&] {
                              for (int j = 0; j < calls; ++j) work();
                            }) / calls);
  }
  return least;
}

double get(const FmuLibrary& fmu, fmi2Component c, const std::string& name) {
  const fmi2ValueReference at = fmu.reference(name);
  double value = 0.0;
  FmuLibrary::check(fmu.get_real(c, &at, 1, &value));
  return value;
}

/// Value references of all Reals that change during a run.
std::vector<fmi2ValueReference> find_outputs(const FmuLibrary& fmu) {
  std::vector<fmi2ValueReference> found;
  const std::regex variable("<ScalarVariable[^>]*>[^<]*<Real"),
      reference("valueReference=\"(\\d+)");
  for (std::sregex_iterator at(fmu.xml().begin(), fmu.xml().end(), variable), end; at != end;
       ++at) {
    const std::string text = at->str();
    std::smatch number;
    if (text.find("causality=\"output\"") == std::string::npos) continue;
    if (std::regex_search(text, number, reference)) {
      found.push_back(static_cast<fmi2ValueReference>(std::stoul(number[1])));
    }
  }
  return found;
}

/// Methods that choose their steps, from the description of solver.method: number and name.
std::vector<std::pair<fmi2Integer, std::string>> find_methods(const FmuLibrary& fmu) {
  const size_t from = fmu.xml().find("description=", fmu.xml().find("name=\"solver.method\""));
  const std::string text = fmu.xml().substr(from, fmu.xml().find('>', from) - from);
  const std::regex entry("(: |, | and )(\\d+) ([a-z]\\w*)");
  std::vector<std::pair<fmi2Integer, std::string>> found;
  for (std::sregex_iterator at(text.begin(), text.end(), entry), end; at != end; ++at) {
    const std::string name = at->str(3);
    if (name == "auto" || name == "dae" || name.rfind("fixed", 0) == 0) continue;
    found.emplace_back(std::stoi(at->str(2)), name);
  }
  return found;
}

void measure_docking(const std::string& folder, bool quick) {
  const FmuLibrary fmu(folder);
  const double h = 0.01, stop = 20.0;
  const size_t count = static_cast<size_t>(stop / h + 0.5);
  const fmi2ValueReference at_phase = fmu.reference("phase"),
                           at_work = fmu.reference("solver.rhs_evaluations");
  std::vector<double> least(count, 1e300);
  std::vector<fmi2Integer> phase(count);
  std::vector<double> work(count + 1);
  const auto run = [&](auto each) {
    const fmi2Component c = fmu.instantiate();
    fmu.initialise(c);
    for (size_t i = 0; i < count; ++i) each(c, i);
    fmu.release(c);
  };
  run([&](fmi2Component c, size_t i) {  // what happens, not timed
    FmuLibrary::check(fmu.step(c, static_cast<double>(i) * h, h, fmi2True));
    FmuLibrary::check(fmu.get_integer(c, &at_phase, 1, &phase[i]));
    FmuLibrary::check(fmu.get_real(c, &at_work, 1, &work[i + 1]));
  });
  for (int k = 0; k < (quick ? 2 : 7); ++k) {
    run([&](fmi2Component c, size_t i) {
      least[i] = std::min(least[i], time([&] {
                            FmuLibrary::check(fmu.step(c, static_cast<double>(i) * h, h, fmi2True));
                          }));
    });
  }
  double whole = 0.0;
  for (const double x : least) whole += x;
  json& all = put("docking/whole", whole);
  all["evaluations"] = work[count];
  all["steps"] = count;
  all["times_real_time"] = stop * 1e9 / whole;
  for (fmi2Integer p = 1; p <= 8; ++p) {
    std::vector<double> times;
    double sum = 0.0, evaluations = 0.0;
    for (size_t i = 0; i < count; ++i) {
      if (phase[i] != p) continue;
      times.push_back(least[i]);
      sum += least[i];
      evaluations += work[i + 1] - work[i];
    }
    if (times.empty()) continue;
    std::sort(times.begin(), times.end());
    json& one =
        put("docking/step in phase " + std::to_string(p), sum / static_cast<double>(times.size()));
    one["median"] = times[times.size() / 2];
    one["worst"] = times.back();
    one["steps"] = times.size();
    one["evaluations"] = evaluations;
  }

  // Get and set, in the middle of a docking.
  const fmi2Component c = fmu.instantiate();
  fmu.initialise(c);
  for (size_t i = 0; i < count / 10; ++i) {
    FmuLibrary::check(fmu.step(c, static_cast<double>(i) * h, h, fmi2True));
  }
  const std::vector<fmi2ValueReference> outputs = find_outputs(fmu);
  std::vector<double> values(outputs.size());
  const fmi2ValueReference one = fmu.reference("relative.position[1]"),
                           in = fmu.reference("chaser.force_ext[1]");
  const double push = 0.0;
  double value = 0.0;
  put("get/one output", find_least([&] { fmu.get_real(c, &one, 1, &value); }));
  put("get/all outputs", find_least([&] {
        fmu.get_real(c, outputs.data(), outputs.size(), values.data());
      }))["count"] = outputs.size();
  put("get/all outputs, one call each", find_least([&] {
        for (size_t i = 0; i < outputs.size(); ++i) fmu.get_real(c, &outputs[i], 1, &values[i]);
      }))["count"] = outputs.size();
  put("set/one input", find_least([&] { fmu.set_real(c, &in, 1, &push); }));
  put("set and get/one input, then one output", find_least([&] {  // outputs are computed again
        fmu.set_real(c, &in, 1, &push);
        fmu.get_real(c, &one, 1, &value);
      }));
  put("set and get/one input, then all outputs", find_least([&] {
        fmu.set_real(c, &in, 1, &push);
        fmu.get_real(c, outputs.data(), outputs.size(), values.data());
      }))["count"] = outputs.size();
  fmu.release(c);
}

void measure_exchange(const std::string& folder, bool quick) {
  const FmuLibrary fmu(folder);
  const fmi2Component c = fmu.instantiate(fmi2ModelExchange);
  fmu.initialise(c);
  fmi2EventInfo events{};
  do {
    FmuLibrary::check(fmu.update(c, &events));
  } while (events.newDiscreteStatesNeeded);
  FmuLibrary::check(fmu.enter_continuous(c));
  const std::regex derivative("derivative=\"");
  const auto begin = std::sregex_iterator(fmu.xml().begin(), fmu.xml().end(), derivative);
  std::vector<double> states(static_cast<size_t>(std::distance(begin, std::sregex_iterator())));
  std::vector<double> rates(states.size());
  FmuLibrary::check(fmu.get_states(c, states.data(), states.size()));
  std::vector<double> others = states;
  for (double& x : others) x *= 1.0 + 1e-9;  // an unchanged state is not evaluated again
  bool turn = false;
  json& one = put("exchange/derivative", find_least(
                                             [&] {
                                               turn = !turn;
                                               const std::vector<double>& at =
                                                   turn ? others : states;
                                               fmu.set_states(c, at.data(), at.size());
                                               fmu.get_rates(c, rates.data(), rates.size());
                                             },
                                             quick ? 2 : 50));
  one["states"] = states.size();
  for (const double x : rates) {
    if (!std::isfinite(x)) throw std::runtime_error("a derivative is not finite");
  }
  fmu.release(c);
}

void measure_motion(const std::string& folder, const std::string& file, const std::string& only,
                    bool quick) {
  const FmuLibrary fmu(folder);
  std::ifstream stream(file);
  const json reference = json::parse(stream);
  const auto t = reference.at("t").get<std::vector<double>>();
  const auto p = reference.at("p").get<std::vector<std::vector<double>>>();
  const fmi2ValueReference ring[3] = {fmu.reference("ring.position[1]"),
                                      fmu.reference("ring.position[2]"),
                                      fmu.reference("ring.position[3]")},
                           at_method = fmu.reference("solver.method"),
                           at_work = fmu.reference("solver.rhs_evaluations");
  constexpr double kMostExpensive = 5e7;  // [ns]
  // Tolerances in the proportion in which the scene has them.
  const char* const names[] = {"solver.rtol", "solver.atol_position", "solver.atol_velocity",
                               "solver.atol_energy"};
  std::vector<fmi2ValueReference> at;
  std::vector<double> scene;
  const fmi2Component first = fmu.instantiate();
  for (const char* name : names) {
    at.push_back(fmu.reference(name));
    scene.push_back(get(fmu, first, name));
  }
  fmu.release(first);
  for (const auto& [number, name] : find_methods(fmu)) {
    if (!only.empty() && only != name) continue;
    for (int exponent = 2; exponent <= 12; ++exponent) {
      const double tolerance = std::pow(10.0, -exponent);
      std::vector<double> least(t.size(), 1e300), tolerances;
      for (const double x : scene) tolerances.push_back(x * tolerance / scene[0]);
      double error = 0.0;
      double evaluations = 0.0;
      for (int k = 0; k < (quick ? 2 : 7); ++k) {
        const fmi2Component c = fmu.instantiate();
        FmuLibrary::check(fmu.set_integer(c, &at_method, 1, &number));
        FmuLibrary::check(fmu.set_real(c, at.data(), at.size(), tolerances.data()));
        fmu.initialise(c);
        for (size_t i = 1; i < t.size(); ++i) {
          double x[3];
          least[i] = std::min(least[i], time([&] {
                                FmuLibrary::check(fmu.step(c, t[i - 1], t[i] - t[i - 1], fmi2True));
                                FmuLibrary::check(fmu.get_real(c, ring, 3, x));
                              }));
          error = std::max(error, std::hypot(x[0] - p[i][0], x[1] - p[i][1], x[2] - p[i][2]));
        }
        FmuLibrary::check(fmu.get_real(c, &at_work, 1, &evaluations));
        fmu.release(c);
      }
      double whole = 0.0;
      for (size_t i = 1; i < t.size(); ++i) whole += least[i];
      char label[64];
      std::snprintf(label, sizeof label, "FMU/%s/1e-%02d", name.c_str(), exponent);
      json& one = put(label, whole);
      one["error"] = error;
      one["evaluations"] = evaluations;
      if (whole > kMostExpensive) break;  // a longer run has no use
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  const bool quick = argc > 1 && std::string(argv[argc - 1]) == "--quick";
  try {
    if (what == "docking" && argc >= 3) {
      measure_docking(argv[2], quick);
    } else if (what == "exchange" && argc >= 3) {
      measure_exchange(argv[2], quick);
    } else if (what == "motion" && argc >= 4) {
      measure_motion(argv[2], argv[3], argc - quick > 4 ? argv[4] : "", quick);
    } else {
      std::fprintf(stderr,
                   "usage: fmu_bench docking FOLDER [--quick]\n"
                   "       fmu_bench exchange FOLDER [--quick]\n"
                   "       fmu_bench motion FOLDER REFERENCE.json [METHOD] [--quick]\n");
      return 2;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fmu_bench: %s\n", error.what());
    return 1;
  }
  std::printf("%s\n", json({{"benchmarks", results}}).dump().c_str());
  return 0;
}
