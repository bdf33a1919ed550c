// Time and error of a generated kernel next to the general code, in one run:
//
//   kernel_bench mechanism MECHANISM.json KERNEL.so [repetitions]
//   kernel_bench scene MODEL.json KERNEL.so [repetitions]
//
// KERNEL.so is made by `dockloop-kernel` from the same two arguments and a C compiler. Mechanism:
// position, velocity and acceleration at states near home in which no coordinate, rate or load is
// special. Scene: its mechanism, and all rates of the docking, at its start state. The two are
// timed by turns, and the best of many batches counts, because shared machines are noisy.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "benchmarks/kernel_states.hpp"
#include "docking/docking_model.hpp"
#include "docking/frame_origin.hpp"

namespace {

using namespace dockloop;

struct Times {
  double general = 1e9, kernel = 1e9;  ///< [us]
};

template <class General, class Special>
Times find_times(int repetitions, General general, Special special) {
  const auto time = [](int count, const auto& work) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < count; ++i) work();
    const std::chrono::duration<double, std::micro> spent =
        std::chrono::steady_clock::now() - begin;
    return spent.count() / count;
  };
  Times best;
  for (int batch = 0; batch < 40; ++batch) {
    best.general = std::min(best.general, time(repetitions / 8 + 1, general));
    best.kernel = std::min(best.kernel, time(repetitions, special));
  }
  return best;
}

void evaluate(const Mechanism& mechanism, const BaseMotion<double>& base,
              MechanismData<double>& data) {
  calc_position(mechanism, data, Need::kRates);
  calc_velocity(mechanism, base, data);
  calc_acceleration(mechanism, base, data);
}

void check_hash(const Mechanism& mechanism, KernelScope scope, const KernelLibrary& library) {
  if (library.hash() != find_kernel_hash(mechanism, scope))
    throw ModelError("the kernel was made for another mechanism");
}

void print(const std::string& name, int operations, const Times& times, double error) {
  std::printf("| %s | %d | %.3f | %.3f | %.1f | %.0e |\n", name.c_str(), operations, times.general,
              times.kernel, times.general / times.kernel, error);
}

void measure_mechanism(const std::string& file, std::shared_ptr<const KernelLibrary> library,
                       int repetitions) {
  const Mechanism mechanism = read_closed_mechanism(file);
  check_hash(mechanism, KernelScope::kAny, *library);
  KernelComparison comparison(mechanism, std::make_shared<GeneratedKernel>(mechanism, library));
  double error = 0.0;
  for (unsigned i = 0; i < 200; ++i) {
    comparison.take_state(i);
    error = std::max(error, comparison.find_error());
  }
  const Times times = find_times(
      repetitions, [&] { evaluate(mechanism, comparison.base, comparison.general); },
      [&] { evaluate(mechanism, comparison.base, comparison.special); });
  print(mechanism.model.name, library->counts().operations, times, error);
}

void measure_scene(const std::string& file, std::shared_ptr<const KernelLibrary> library,
                   int repetitions) {
  std::ifstream stream(file);
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  const Scene scene = read_scene(text, file);
  const Vec3<double> origin = find_frame_origin(scene, scene.vehicle);
  const DockingModel model =
      make_docking_model(scene, scene.vehicle, scene.contact.law, origin, scene.level);
  check_hash(model.mechanism, KernelScope::kDocking, *library);
  DockingData<double> general(model), special(model);
  std::vector<double> y(static_cast<size_t>(model.layout.size), 0.0), ydot(y), ydot_special(y);
  int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) y[q++] = model.mechanism.model.home_q[body.q_index + j];
    for (int j = 0; j < body.nv(); ++j) y[v++] = 0.01 * (j + 1);
  }
  for (int i : {kChaser, kTarget}) {
    if (model.layout.pose[i] < 0) continue;
    const Vec3<double> x = scene.vehicle[i].position - origin;
    for (int j = 0; j < 3; ++j) y[model.layout.pose[i] + j] = x[j];
    for (int j = 0; j < 4; ++j) y[model.layout.pose[i] + 3 + j] = scene.vehicle[i].attitude[j];
  }
  const DiscreteState discrete;
  const ContactMemory memory;
  Loads loads;
  loads.command.setZero(static_cast<int>(model.mechanism.model.forces.size()));
  const auto rates = [&](DockingData<double>& data, std::vector<double>& to) {
    return calc_docking<double>(model, discrete, memory, loads, 0.0, y.data(), to.data(), data,
                                Need::kRates);
  };
  if (!rates(general, ydot).ok()) throw ModelError("the start state cannot be evaluated");
  keep_reference(model.mechanism, general.mechanism);
  special.mechanism.loops.reference = general.mechanism.loops.reference;
  special.mechanism.generated = std::make_shared<GeneratedKernel>(model.mechanism, library);
  rates(special, ydot_special);
  if (special.mechanism.found != Need::kRates) throw ModelError("the kernel does not apply");
  double error = 0.0, size = 0.0;
  for (size_t i = 0; i < y.size(); ++i) {
    error = std::max(error, std::abs(ydot[i] - ydot_special[i]));
    size = std::max(size, std::abs(ydot[i]));
  }
  const int operations = library->counts().operations;
  print(scene.name + ", mechanism", operations,
        find_times(
            repetitions, [&] { evaluate(model.mechanism, general.base, general.mechanism); },
            [&] { evaluate(model.mechanism, special.base, special.mechanism); }),
        error / std::max(size, 1e-300));
  print(scene.name + ", all rates", operations,
        find_times(
            repetitions, [&] { rates(general, ydot); }, [&] { rates(special, ydot_special); }),
        error / std::max(size, 1e-300));
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 3 ? argv[1] : "";
  if (what != "scene" && what != "mechanism") {
    std::fprintf(stderr,
                 "usage: kernel_bench mechanism MECHANISM.json KERNEL.so [repetitions]\n"
                 "       kernel_bench scene MODEL.json KERNEL.so [repetitions]\n");
    return 2;
  }
  try {
    const auto library = std::make_shared<const KernelLibrary>(argv[3]);
    const int repetitions = argc > 4 ? std::atoi(argv[4]) : 2000;
    (what == "scene" ? measure_scene : measure_mechanism)(argv[2], library, repetitions);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
