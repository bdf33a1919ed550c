// Evaluations against errors for several methods of integration, on the same docking.
//
//   work_precision MODEL STEP STOP METHOD...
//
// MODEL is resources/model.json of an FMU; STEP in s between communication points, STOP in s;
// METHOD are values of solver.method. Every method runs at relative tolerances from 1e-3 to 1e-9,
// absolute ones in proportion, always integrated (model.flight 2). Errors are the largest
// differences from Dormand-Prince at 1e-11, every 0.1 s, of the target's place seen from the chaser
// and of the ring's.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "compare/comparison.hpp"
#include "sim/docking_sim.hpp"

using namespace dockloop;

namespace {

struct Result {
  std::vector<Vec3<double>> relative, ring;  ///< at the samples [m]
  double evaluations = 0.0, peak = 0.0;      ///< peak of compression [N]
};

Result run(const std::shared_ptr<const Scene>& scene, int method, double rtol, double step,
           double stop) {
  DockingSim sim(scene, FmiKind::kCoSimulation, get_comparison());
  Parameters& p = sim.parameters();
  const double share = rtol / p.rtol;
  constexpr double kLeast = 1e-14;  // [m], [m/s]
  p.solver_method = method;
  p.flight = kIntegrated;
  p.rtol = rtol;
  p.atol_position = std::max(share * p.atol_position, kLeast);
  p.atol_velocity = std::max(share * p.atol_velocity, kLeast);
  p.atol_energy *= share;
  sim.initialise(0.0, 0.0);
  Result result;
  const int count = static_cast<int>(std::lround(stop / step));
  const int every = std::max(1, static_cast<int>(std::lround(0.1 / step)));
  for (int i = 1; i <= count; ++i) {
    if (!sim.step((i - 1) * step, step).ok()) {
      std::fprintf(stderr, "work_precision: %s\n", sim.status_text().c_str());
      std::exit(1);
    }
    if (i % every != 0) continue;
    result.relative.push_back(sim.outputs().relative_position);
    result.ring.push_back(sim.outputs().ring_position);
  }
  result.evaluations = sim.outputs().solver_rhs_evaluations;
  result.peak = sim.outputs().capture_peak[Outputs::kCompression].value;
  return result;
}

double find_distance(const std::vector<Vec3<double>>& a, const std::vector<Vec3<double>>& b) {
  double largest = 0.0;
  for (size_t i = 0; i < a.size(); ++i) largest = std::max(largest, (a[i] - b[i]).norm());
  return largest;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fprintf(stderr, "usage: work_precision MODEL STEP STOP METHOD...\n");
    return 2;
  }
  std::ifstream file(argv[1]);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const auto scene = std::make_shared<const Scene>(read_scene(text, argv[1]));
  const double step = std::atof(argv[2]), stop = std::atof(argv[3]);
  const Result solution = run(scene, kExplicit, 1e-11, step, stop);
  std::printf(
      "| method | rtol | evaluations | relative m | ring m | peak |\n|---|---|---|---|---|---|\n");
  for (int k = 4; k < argc; ++k) {
    const int method = std::atoi(argv[k]);
    for (int digits = 3; digits <= 9; ++digits) {
      const Result result = run(scene, method, std::pow(10.0, -digits), step, stop);
      std::printf("| %d | 1e-%d | %.0f | %.1e | %.1e | %.1e |\n", method, digits,
                  result.evaluations, find_distance(result.relative, solution.relative),
                  find_distance(result.ring, solution.ring),
                  solution.peak > 0.0 ? std::abs(result.peak / solution.peak - 1.0) : 0.0);
      std::fflush(stdout);
    }
  }
  return 0;
}
