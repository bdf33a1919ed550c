// What one evaluation of a mechanism costs, whole and phase by phase, with Google Benchmark.
//
//   mechanism_bench MECHANISM.json[,KERNEL.so]... [--benchmark_... options]
//
// Names of benchmarks: MECHANISM/CODE/WHAT. CODE is `general` (the core), `generated
// kernel` (where one applies), `hand-written` (only for hexapod_bench) or `no closed forms` (the
// core with loops closed by iteration and gears as bodies of the tree, for mechanisms with gears);
// WHAT is `accelerations`, `with reactions` (cut forces and the load on the base too) or a phase.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <deque>

#include "benchmarks/hand_written_hexapod.hpp"
#include "benchmarks/mechanism_evaluation.hpp"
#include "loops/loop_equations.hpp"
#include "mechanism/mechanism_jacobian.hpp"

namespace {

using namespace dockloop;

/// Register `work()`, which is evaluated at the next state each time.
template <class Work>
void add(const std::string& name, MechanismEvaluation& at, Work work) {
  benchmark::RegisterBenchmark(name.c_str(), [&at, work](benchmark::State& state) {
    for ([[maybe_unused]] auto _ : state) {
      at.put_next_state();
      work();
      benchmark::ClobberMemory();
    }
  });
}

/// The phases, in their order. They are timed one by one at a state that has been evaluated, so
/// their sum is a little less than the whole.
void add_phases(const std::string& name, MechanismEvaluation& at) {
  const MechanismModel& model = at.mechanism.model;
  const LoopPlan& plan = at.mechanism.plan;
  MechanismData<double>& data = at.data;
  const BaseMotion<double>& base = at.base;
  const auto phase = [&](const char* what, auto work) { add(name + what, at, work); };
  phase("1 close the loops", [&] { calc_loop_position(model, plan, data.tree, data.loops); });
  phase("2 velocity maps", [&] { calc_velocity_maps(model, plan, data.loops); });
  const std::vector<int>& bodies = plan.tree_bodies;
  phase("3 tree positions", [&] { calc_tree_position(model, bodies, data.tree); });
  const bool is_free = plan.is_free_platform;
  phase("4 tree and leg inertia", [&] {
    if (is_free) return calc_free_inertia(model, plan, data.loops, data.tree, data.A_ind);
    calc_body_inertia(model, bodies, data.tree);
    add_leg_masses(plan, data.loops, data.tree);
    calc_composite_inertia(model, bodies, data.tree, data.A_tree);
    add_leg_inertia(model, plan, data.tree, data.loops, data.A_tree);
  });
  phase("5 reduce the inertia", [&] {
    if (is_free) return;
    data.A = data.A_tree;
    reduce_inertia(plan, data.A, data.loops);
  });
  phase("6 factorise", [&] { data.factor.compute(data.A_ind); });
  phase("7 velocities", [&] { calc_velocity(at.mechanism, base, data); });
  phase("8 joint forces", [&] { at.calc_forces(); });
  phase("9 bias and required forces", [&] {
    const VecX<double>* none = nullptr;
    calc_tree_acceleration(model, bodies, base, none, data.tree);
    if (is_free) {
      return calc_free_forces(model, plan, base, data.tau, data.tree, data.loops, data.b_ind);
    }
    calc_body_forces(model, bodies, data.tree);
    add_leg_biases(model, plan, base, data.tau, data.tree, data.loops);
    calc_transmitted(model, bodies, data.tree);
    data.b = data.tau - data.tree.tau_required;
  });
  phase("10 reduce the forces", [&] {
    if (is_free) return;
    calc_loop_bias(model, plan, data.tree, data.loops);
    reduce_forces(plan, data.b, data.loops);
  });
  phase("11 solve", [&] {
    data.a_ind = data.b_ind;
    data.factor.solveInPlace(data.a_ind);
  });
  phase("12 dependent accelerations", [&] { calc_loop_acceleration(plan, data.vdot, data.loops); });
  phase("13 cut forces", [&] { calc_loop_forces(plan, data.vdot, data.loops); });
  phase("14 load on the base", [&] {
    calc_tree_acceleration(model, bodies, base, &data.vdot, data.tree);
    calc_body_forces(model, bodies, data.tree);
    add_leg_loads(model, plan, base, kBase, data.vdot, data.tree, data.loops, data.on_base);
    calc_transmitted(model, bodies, data.tree);
  });
}

/// All codes for one mechanism.
struct Codes {
  explicit Codes(const Subject& subject) : general(subject.file) {
    if (general.mechanism.model.name == "hexapod_bench") hand_written.emplace(general.mechanism);
    const std::vector<Loop>& loops = general.mechanism.model.loops;
    const bool has_gears = !loops.empty() && loops.back().cut == CutType::kCoupling;
    if (has_gears) iterated.emplace(subject.file, true);
    for (const NamedKernel& kernel : find_kernels(general.mechanism, subject.kernel_file)) {
      MechanismEvaluation& at = by_kernel.emplace_back(subject.file);
      names.push_back(kernel.name);
      if (at.use(kernel.kernel)) continue;
      std::fprintf(stderr, "the %s refuses states of %s\n", kernel.name.c_str(),
                   subject.file.c_str());
      by_kernel.pop_back();
      names.pop_back();
    }
  }

  void add_benchmarks() {
    const std::string& name = general.mechanism.model.name;
    add(name + "/general/accelerations", general, [this] { general.calc_accelerations(); });
    if (iterated) {
      add(name + "/no closed forms/accelerations", *iterated,
          [this] { iterated->calc_accelerations(); });
    }
    add(name + "/general/with reactions", general, [this] {
      general.calc_accelerations();
      calc_reactions(general.mechanism, general.base, kBase, general.data);
    });
    for (size_t i = 0; i < by_kernel.size(); ++i) add_kernel(name + "/" + names[i], by_kernel[i]);
    add(name + "/general/eight derivatives", general, [this] {
      start_jacobian_columns(general.mechanism, general.base, general.data, 0, *jacobian);
      calc_position(general.mechanism, jacobian->dual, Need::kRates);
      calc_velocity(general.mechanism, jacobian->base, jacobian->dual);
      calc_acceleration(general.mechanism, jacobian->base, jacobian->dual);
    });
    if (hand_written) add_hand_written(name);
    add_phases(name + "/phase/", general);
  }

  static void add_kernel(const std::string& name, MechanismEvaluation& at) {
    add(name + "/accelerations", at, [&] { at.calc_accelerations(); });
    add(name + "/1 position", at, [&] { calc_position(at.mechanism, at.data, Need::kRates); });
    add(name + "/2 velocity", at, [&] { calc_velocity(at.mechanism, at.base, at.data); });
    add(name + "/3 joint forces", at, [&] { at.calc_forces(); });
    add(name + "/4 acceleration", at, [&] { calc_acceleration(at.mechanism, at.base, at.data); });
  }

  void add_hand_written(const std::string& name) {
    for (int k = 0; k < MechanismEvaluation::kStates; ++k) {
      general.put_next_state();
      general.calc_accelerations();
      HandWrittenHexapod::get_state(general.data.tree, y[k]);
    }
    benchmark::RegisterBenchmark(
        (name + "/hand-written/accelerations").c_str(), [this](benchmark::State& state) {
          for ([[maybe_unused]] auto _ : state) {
            hand_written->calc_rates(y[next++ % MechanismEvaluation::kStates], dy);
            benchmark::ClobberMemory();
          }
        });
    benchmark::RegisterBenchmark((name + "/hand-written/with reactions").c_str(),
                                 [this](benchmark::State& state) {
                                   for ([[maybe_unused]] auto _ : state) {
                                     hand_written->calc_rates<true>(
                                         y[next++ % MechanismEvaluation::kStates], dy, &reactions);
                                     benchmark::ClobberMemory();
                                   }
                                 });
  }

  MechanismEvaluation general;
  std::optional<MechanismEvaluation> iterated;
  std::unique_ptr<JacobianData> jacobian = std::make_unique<JacobianData>(general.mechanism);
  std::deque<MechanismEvaluation> by_kernel;  // addresses stay
  std::vector<std::string> names;
  std::optional<HandWrittenHexapod> hand_written;
  HandWrittenHexapod::Reactions reactions;
  double y[MechanismEvaluation::kStates][HandWrittenHexapod::kStates], dy[13];
  size_t next = 0;
};

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc < 2) {
    std::fprintf(stderr,
                 "usage: mechanism_bench MECHANISM.json[,KERNEL.so]... [--benchmark_...]\n");
    return 2;
  }
  try {
    std::deque<Codes> codes;  // addresses stay
    for (int i = 1; i < argc; ++i) codes.emplace_back(Subject(argv[i])).add_benchmarks();
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mechanism_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
