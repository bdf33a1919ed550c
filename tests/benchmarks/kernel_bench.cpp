// Time and error of a generated kernel beside the general code, in one run:
// `kernel_bench MECHANISM.json KERNEL.so [repetitions]`, the kernel made by `dockloop-kernel mechanism`.
//
// One evaluation is position, velocity and acceleration at a state near home in which no coordinate,
// rate or load is special; errors are the worst over many such states. The two are timed by turns,
// and the best of many batches counts, because shared machines are noisy.
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "benchmarks/kernel_states.hpp"

namespace {

using namespace dockloop;

double find_time(int repetitions, const Mechanism& mechanism, const BaseMotion<double>& base,
                 MechanismData<double>& data) {
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < repetitions; ++i) {
    calc_position(mechanism, data);
    calc_velocity(mechanism, base, data);
    calc_acceleration(mechanism, base, data);
  }
  const std::chrono::duration<double, std::micro> spent = std::chrono::steady_clock::now() - begin;
  return spent.count() / repetitions;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: kernel_bench MECHANISM.json KERNEL.so [repetitions]\n");
    return 2;
  }
  try {
    const int repetitions = argc > 3 ? std::atoi(argv[3]) : 2000;
    const Mechanism mechanism = read_closed_mechanism(argv[1]);
    auto library = std::make_shared<const KernelLibrary>(argv[2]);
    if (library->hash() != find_kernel_hash(mechanism, KernelScope::kAny)) {
      std::fprintf(stderr, "%s was made for another mechanism\n", argv[2]);
      return 1;
    }
    KernelComparison comparison(mechanism, std::make_shared<GeneratedKernel>(mechanism, library));
    double worst = 0.0;
    for (int i = 0; i < 200; ++i) {
      comparison.take_state(i);
      worst = std::max(worst, comparison.find_error());
    }
    double general = 1e9, kernel = 1e9;
    for (int batch = 0; batch < 20; ++batch) {
      general = std::min(general, find_time(repetitions / 10 + 1, mechanism, comparison.base,
                                            comparison.general));
      kernel =
          std::min(kernel, find_time(repetitions, mechanism, comparison.base, comparison.special));
    }
    std::printf("%s: operations %d, general %.3f us, kernel %.3f us, ratio %.1f, error %.1e\n",
                mechanism.model.name.c_str(), library->counts().operations, general, kernel,
                general / kernel, worst);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
