// What a stepper costs next to the evaluations of the rates: time per evaluation where the rates
// cost next to nothing (oscillators without coupling), for the number of states of a ring on a
// fixed base (13) and of a docking (45).
//
//   stepper_bench [REPETITIONS]
//
// Prints nanoseconds per evaluation (least of the repetitions) and what the rates take of them.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "integrate/stepper.hpp"

using namespace dockloop;

namespace {

constexpr double kEnd = 20.0, kStop = 0.5;  ///< [s] of the run, between restarts

int calc_rates(int size, const double* y, double* ydot) {
  for (int i = 0; i + 1 < size; i += 2) {
    ydot[i] = y[i + 1];
    ydot[i + 1] = -(1.0 + 0.5 * i) * y[i];
  }
  if (size % 2 == 1) ydot[size - 1] = 1.0;
  return 0;
}

template <class Work>
double find_time(const Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin).count();
}

void run(Stepper& stepper, int size) {
  std::fill_n(stepper.y(), size, 1.0);
  for (double t = 0.0; t < kEnd; t += kStop) {
    stepper.restart(0.0, 0.02);
    while (stepper.step(kStop, false) == StepOutcome::kStepped) continue;
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int repetitions = argc > 1 ? std::atoi(argv[1]) : 200;
  struct Row {
    Stepper::Method method;
    const char* name;
  };
  for (const Row& row : {Row{Stepper::Method::kDormandPrince, "Dormand-Prince 5(4)"},
                         Row{Stepper::Method::kStabilised, "stabilised 4(3)"}}) {
    for (const int size : {13, 45}) {
      Stepper::Problem problem;
      problem.size = size;
      problem.rates = [size](double, const double* y, double* ydot) {
        return calc_rates(size, y, ydot);
      };
      Stepper stepper(std::move(problem), row.method);
      const std::vector<double> atol(static_cast<size_t>(size), 1e-8);
      stepper.set_tolerances(1e-6, atol.data());
      double least = 1e99, rates = 1e99;
      long evaluations = 0;
      std::vector<double> ydot(static_cast<size_t>(size));
      for (int i = 0; i < repetitions; ++i) {
        const long before = stepper.rate_evaluations();
        least = std::min(least, find_time([&] { run(stepper, size); }));
        evaluations = stepper.rate_evaluations() - before;
        rates = std::min(rates, find_time([&] {
                           for (long n = 0; n < evaluations; ++n) {
                             calc_rates(size, stepper.y(), ydot.data());
                             stepper.y()[0] += 1e-9 * ydot[0];
                           }
                         }));
      }
      const double count = static_cast<double>(evaluations);
      std::printf(
          "%-22s %2d states: %5.0f ns per evaluation, %3.0f of them in the rates; %ld of %s\n",
          row.name, size, least / count, rates / count, evaluations, "them");
    }
  }
  return 0;
}
