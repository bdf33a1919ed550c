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
#include <dlfcn.h>
#include <fmi2Functions.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

namespace {

void ignore_log(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...) {}

[[noreturn]] void fail(const std::string& why) {
  std::fprintf(stderr, "step_times: %s\n", why.c_str());
  std::exit(1);
}

/// Value of an XML attribute that follows `after`.
std::string attribute(const std::string& xml, const std::string& after, const std::string& name) {
  const size_t from = xml.find(after);
  std::smatch found;
  const std::string rest = from == std::string::npos ? "" : xml.substr(from, 2000);
  if (!std::regex_search(rest, found, std::regex(name + "=\"([^\"]*)\""))) fail("no " + name);
  return found[1];
}

template <class Function>
Function* load(void* library, const char* name) {
  auto* const function = reinterpret_cast<Function*>(dlsym(library, name));
  if (!function) fail(std::string(name) + " is not in the library");
  return function;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) fail("usage: step_times FOLDER [STEP [METHOD [SOLVER_STEP]]]");
  const std::string folder = argv[1];
  const double h = argc > 2 ? std::atof(argv[2]) : 0.01;
  const fmi2Integer method = argc > 3 ? std::atoi(argv[3]) : 7;
  const double inner = argc > 4 ? std::atof(argv[4]) : 1e-3;
  std::ifstream file(folder + "/modelDescription.xml");
  const std::string xml{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  if (xml.empty()) fail("cannot read " + folder + "/modelDescription.xml");
  const std::string guid = attribute(xml, "<fmiModelDescription", "guid");
  const std::string name = attribute(xml, "<CoSimulation", "modelIdentifier");
  const double stop = std::stod(attribute(xml, "<DefaultExperiment", "stopTime"));
  const auto reference = [&](const std::string& variable) {
    return static_cast<fmi2ValueReference>(
        std::stoul(attribute(xml, "name=\"" + variable + "\"", "valueReference")));
  };

  const std::string path = folder + "/binaries/linux64/" + name + ".so";
  void* const library = dlopen(path.c_str(), RTLD_NOW);
  if (!library) fail(dlerror());
  auto* const instantiate = load<fmi2InstantiateTYPE>(library, "fmi2Instantiate");
  auto* const set_integer = load<fmi2SetIntegerTYPE>(library, "fmi2SetInteger");
  auto* const set_real = load<fmi2SetRealTYPE>(library, "fmi2SetReal");
  auto* const setup = load<fmi2SetupExperimentTYPE>(library, "fmi2SetupExperiment");
  auto* const enter = load<fmi2EnterInitializationModeTYPE>(library, "fmi2EnterInitializationMode");
  auto* const exit = load<fmi2ExitInitializationModeTYPE>(library, "fmi2ExitInitializationMode");
  auto* const step = load<fmi2DoStepTYPE>(library, "fmi2DoStep");
  auto* const get_integer = load<fmi2GetIntegerTYPE>(library, "fmi2GetInteger");
  auto* const release = load<fmi2FreeInstanceTYPE>(library, "fmi2FreeInstance");

  const fmi2CallbackFunctions callbacks{ignore_log, nullptr, nullptr, nullptr, nullptr};
  const std::string resources = "file://" + folder + "/resources";
  std::vector<double> times;  // [us]
  constexpr int kRuns = 5;
  const int count = static_cast<int>(stop / h + 0.5);
  const fmi2ValueReference at_phase = reference("phase");
  std::vector<double> least(static_cast<size_t>(count), 1e99);  // of every step [us]
  std::vector<fmi2Integer> phases(static_cast<size_t>(count), 0);
  for (int run = 0; run < kRuns; ++run) {
    const fmi2Component c = instantiate("step_times", fmi2CoSimulation, guid.c_str(),
                                        resources.c_str(), &callbacks, fmi2False, fmi2False);
    if (!c) fail("fmi2Instantiate refused");
    const fmi2ValueReference at_method = reference("solver.method");
    const fmi2ValueReference at_step = reference("solver.step");
    if (set_integer(c, &at_method, 1, &method) != fmi2OK ||
        set_real(c, &at_step, 1, &inner) != fmi2OK ||
        setup(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) != fmi2OK || enter(c) != fmi2OK ||
        exit(c) != fmi2OK) {
      fail("the run could not be started");
    }
    for (int i = 0; i < count; ++i) {
      const auto before = std::chrono::steady_clock::now();
      if (step(c, i * h, h, fmi2True) != fmi2OK) fail("a step failed");
      const auto after = std::chrono::steady_clock::now();
      times.push_back(std::chrono::duration<double, std::micro>(after - before).count());
      const size_t place = static_cast<size_t>(i);
      least[place] = std::min(least[place], times.back());
      if (run + 1 == kRuns && get_integer(c, &at_phase, 1, &phases[place]) != fmi2OK) {
        fail("the phase cannot be read");
      }
    }
    release(c);
  }
  std::sort(times.begin(), times.end());
  std::printf(
      "%zu steps of %g s, solver.method %d, solver.step %g s: median %.1f us, 99.9 %% %.1f us, "
      "worst %.1f us\n",
      times.size(), h, method, inner, times[times.size() / 2],
      times[static_cast<size_t>(0.999 * static_cast<double>(times.size()))], times.back());
  double sum = 0.0;
  for (const double time : least) sum += time;
  std::printf("%.0f times faster than real time\n", 1e6 * stop / sum);
  constexpr std::array<const char*, 8> kPhases = {
      "approach", "contact", "captured", "attenuating", "aligned", "retracting", "hard docked",
      "rebound"};
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
  return 0;
}
