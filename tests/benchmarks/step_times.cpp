// Distribution of the times of fmi2DoStep over a docking, as a real-time host sees them: loads the
// library of an unpacked FMU and runs its default experiment a few times.
//
//   step_times FOLDER [STEP [METHOD [SOLVER_STEP]]]
//
// FOLDER holds modelDescription.xml, binaries/, resources/; STEP in s (default 0.01); METHOD is
// solver.method (default 7, fixed_rk4), SOLVER_STEP is solver.step in s (default 1e-3). Prints
// microseconds: median, 99.9 %, worst (on a machine that is not real-time the operating system's);
// then, from the least time of every step over the runs, how much faster than real time all of it
// is, and the median of each phase.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "benchmarks/fmu_library.hpp"

namespace {

using dockloop::FmuLibrary;

void measure(const std::string& folder, double h, fmi2Integer method, double inner) {
  const FmuLibrary fmu(folder);
  const fmi2ValueReference at_method = fmu.reference("solver.method");
  const fmi2ValueReference at_step = fmu.reference("solver.step");
  const int count = static_cast<int>(fmu.experiment("stopTime") / h + 0.5);
  std::vector<double> times;  // [us]
  constexpr int kRuns = 5;
  const bool has_phases = fmu.xml().find("name=\"phase\"") != std::string::npos;
  const fmi2ValueReference at_phase = has_phases ? fmu.reference("phase") : 0;
  std::vector<double> least(static_cast<size_t>(count), 1e99);  // of every step [us]
  std::vector<fmi2Integer> phases(static_cast<size_t>(count), 0);
  for (int run = 0; run < kRuns; ++run) {
    const fmi2Component c = fmu.instantiate();
    FmuLibrary::check(fmu.set_integer(c, &at_method, 1, &method));
    FmuLibrary::check(fmu.set_real(c, &at_step, 1, &inner));
    fmu.initialise(c);
    for (int i = 0; i < count; ++i) {
      const auto before = std::chrono::steady_clock::now();
      FmuLibrary::check(fmu.step(c, i * h, h, fmi2True));
      const auto after = std::chrono::steady_clock::now();
      times.push_back(std::chrono::duration<double, std::micro>(after - before).count());
      const size_t place = static_cast<size_t>(i);
      least[place] = std::min(least[place], times.back());
      if (has_phases && run + 1 == kRuns)
        FmuLibrary::check(fmu.get_integer(c, &at_phase, 1, &phases[place]));
    }
    fmu.release(c);
  }
  std::sort(times.begin(), times.end());
  std::printf(
      "%zu steps of %g s, solver.method %d, solver.step %g s: median %.1f us, 99.9 %% %.1f us, "
      "worst %.1f us\n",
      times.size(), h, method, inner, times[times.size() / 2],
      times[static_cast<size_t>(0.999 * static_cast<double>(times.size()))], times.back());
  double sum = 0.0;
  for (const double time : least) sum += time;
  std::printf("%.0f times faster than real time\n", 1e6 * h * count / sum);
  constexpr std::array<const char*, 8> kPhases = {"approach",    "contact", "captured",
                                                  "attenuating", "aligned", "retracting",
                                                  "hard docked", "rebound"};
  for (size_t phase = 0; phase < kPhases.size(); ++phase) {
    std::vector<double> inside;
    for (size_t i = 0; i < least.size(); ++i) {
      if (phases[i] == static_cast<fmi2Integer>(phase + 1)) inside.push_back(least[i]);
    }
    if (inside.empty()) continue;
    std::sort(inside.begin(), inside.end());
    std::printf("  %-12s %6zu steps, median %.2f us\n", kPhases[phase], inside.size(),
                inside[inside.size() / 2]);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: step_times FOLDER [STEP [METHOD [SOLVER_STEP]]]\n");
    return 2;
  }
  try {
    measure(argv[1], argc > 2 ? std::atof(argv[2]) : 0.01, argc > 3 ? std::atoi(argv[3]) : 7,
            argc > 4 ? std::atof(argv[4]) : 1e-3);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "step_times: %s\n", error.what());
    return 1;
  }
  return 0;
}
