// What 5 s of hexapod_bench cost at which accuracy, with nothing but a Runge-Kutta method around
// the evaluations (runge_kutta.hpp): the hand-written hexapod, the core, kernels.
//
//   motion_bench hexapod_bench.json[,KERNEL.so] REFERENCE.json [--benchmark_... options]
#include <benchmark/benchmark.h>

#include <cstdio>
#include <deque>

#include "benchmarks/hand_written_hexapod.hpp"
#include "benchmarks/mechanism_evaluation.hpp"
#include "benchmarks/reference_motion.hpp"

namespace {

using namespace dockloop;

constexpr int kStates = HandWrittenHexapod::kStates;
using State = RungeKutta<kStates>::State;

/// The ring in the coordinates of its free joint: position from home and velocities in its axes.
State find_joint_state(const ReferenceMotion& reference, const Pose<double>& home) {
  State y = reference.start;
  const Eigen::Map<const Vec4<double>> quat(y.data() + 3);
  const Mat3<double> R = quat_to_matrix<double>(quat);
  Eigen::Map<Vec3<double>> p(y.data()), v(y.data() + 7), w(y.data() + 10);
  p -= home.p;
  v = (R.transpose() * v).eval();
  w = (R.transpose() * w).eval();
  return y;
}

void add_core(const std::string& name, const ReferenceMotion& reference, MechanismEvaluation& at) {
  const Pose<double> home = at.mechanism.model.bodies[0].placement;
  const auto rates = [&at](const double* y, double* dy) {
    TreeData<double>& tree = at.data.tree;
    for (int i = 0; i < 7; ++i) tree.q[i] = y[i];
    for (int i = 0; i < 6; ++i) tree.v[i] = y[7 + i];
    tree.q.segment<4>(3).normalize();
    at.calc_accelerations();
    const Vec4<double> quat = tree.q.segment<4>(3);
    Eigen::Map<Vec3<double>>(dy, 3) = tree.R[0] * tree.v.segment<3>(0);
    Eigen::Map<Vec4<double>>(dy + 3, 4) = quat_rate<double>(quat, tree.v.segment<3>(3));
    for (int i = 0; i < 6; ++i) dy[7 + i] = at.data.vdot[i];
  };
  add_motions<kStates>(
      name, reference, [home](const ReferenceMotion& from) { return find_joint_state(from, home); },
      rates, [home, &at](const double* y) {  // of a sample: kernels stay near the last one
        at.accept();
        return Vec3<double>(home.p + Eigen::Map<const Vec3<double>>(y));
      });
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc != 3) {
    std::fprintf(
        stderr,
        "usage: motion_bench MECHANISM.json[,KERNEL.so] REFERENCE.json [--benchmark_...]\n");
    return 2;
  }
  try {
    const ReferenceMotion reference(argv[2]);
    const Subject subject(argv[1]);
    MechanismEvaluation general(subject.file);
    HandWrittenHexapod hexapod(general.mechanism);
    add_motions<kStates>(
        "hand-written", reference, [](const ReferenceMotion& from) { return from.start; },
        [&](const double* y, double* dy) { hexapod.calc_rates(y, dy); },
        [](const double* y) { return Vec3<double>(y[0], y[1], y[2]); });
    add_core("general", reference, general);
    std::deque<MechanismEvaluation> by_kernel;  // addresses stay
    for (const NamedKernel& kernel : find_kernels(general.mechanism, subject.kernel_file)) {
      MechanismEvaluation& at = by_kernel.emplace_back(subject.file);
      at.data.generated = kernel.kernel;
      add_core(kernel.name, reference, at);
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "motion_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
