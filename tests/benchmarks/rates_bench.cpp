// Time of one right-hand side: `rates_bench MODEL.json [repetitions]`.
//
// Evaluates the rates of a scene, at its level (key model.level), at its start state (for scenes
// with contact conditions: at first contact, pressed 1 mm into the surfaces) and prints
// microseconds for the whole and for its parts. The best of several batches counts, because shared
// machines are noisy.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <vector>

#include "dynamics/docking_jacobian.hpp"
#include "math/rotation.hpp"

namespace {

using namespace dockloop;

template <class Work>
double find_best_time(int repetitions, Work work) {
  double best = 1e9;
  for (int batch = 0; batch < 10; ++batch) {
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < repetitions; ++i) work();
    const std::chrono::duration<double, std::micro> spent =
        std::chrono::steady_clock::now() - begin;
    best = std::min(best, spent.count() / repetitions);
  }
  return best;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: rates_bench MODEL.json [repetitions]\n");
    return 2;
  }
  std::ifstream file(argv[1]);
  std::stringstream text;
  text << file.rdbuf();
  const int repetitions = argc > 2 ? std::atoi(argv[2]) : 2000;
  const Scene scene = read_scene(text.str(), argv[1]);
  DockingModel model = make_docking_model(scene, scene.vehicle, scene.contact.law,
                                          scene.vehicle[kChaser].position, scene.level);
  DockingData<double> data(model);
  std::vector<double> y(static_cast<size_t>(model.layout.size), 0.0), ydot(y);
  int q = model.layout.mechanism_q, v = model.layout.mechanism_v;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) y[q++] = model.mechanism.model.home_q[body.q_index + j];
    for (int j = 0; j < body.nv(); ++j) y[v++] = 0.01 * (j + 1);
  }
  for (int i : {kChaser, kTarget}) {
    if (model.layout.pose[i] < 0) continue;
    const Vec3<double> x = scene.vehicle[i].position - scene.vehicle[kChaser].position;
    for (int j = 0; j < 3; ++j) y[model.layout.pose[i] + j] = x[j];
    for (int j = 0; j < 4; ++j) y[model.layout.pose[i] + 3 + j] = scene.vehicle[i].attitude[j];
  }
  const DiscreteState discrete;
  ContactMemory memory;
  Loads loads;
  loads.command.setZero(static_cast<int>(model.mechanism.model.forces.size()));
  const auto rates = [&] {
    return calc_docking<double>(model, discrete, memory, loads, 0.0, y.data(), ydot.data(), data);
  };
  if (!rates().ok()) {
    std::fprintf(stderr, "the start state cannot be evaluated\n");
    return 1;
  }
  if (scene.level == kRigid) lock_mechanism(model, data);
  std::printf("%-24s %8.3f us\n", "start state", find_best_time(repetitions, rates));
  MechanismData<double>& mechanism = data.mechanism;
  std::printf("%-24s %8.3f us\n", "  close loops", find_best_time(repetitions, [&] {
                calc_loop_position(model.mechanism.model, model.mechanism.plan, mechanism.tree,
                                   mechanism.loops);
              }));
  std::printf("%-24s %8.3f us\n", "  position (all)",
              find_best_time(repetitions, [&] { calc_position(model.mechanism, mechanism); }));
  std::printf("%-24s %8.3f us\n", "  velocity", find_best_time(repetitions, [&] {
                calc_velocity(model.mechanism, data.base, mechanism);
              }));
  std::printf("%-24s %8.3f us\n", "  acceleration", find_best_time(repetitions, [&] {
                calc_acceleration(model.mechanism, data.base, mechanism);
              }));
  if (model.present[kTarget] && !model.contact.empty()) {
    // Bring the surfaces together along the docking axis.
    const Vec3<double> axis = data.interface[kTarget].R.col(0);
    const double gap = find_gap(model.contact, data.relative, data.contact_work);
    for (int j = 0; j < 3; ++j) y[model.layout.pose[kTarget] + j] -= (gap + 1e-3) * axis[j];
    if (!rates().ok()) return 1;
    std::printf("%-24s %8.3f us\n", "in contact, no memory", find_best_time(repetitions, rates));
    update_contact_memory(model.contact, data.relative, nullptr, data.contact_work, memory);
    std::printf("%-24s %8.3f us\n", "in contact", find_best_time(repetitions, rates));
  }
  DockingPass pass(model);
  std::printf("%-24s %8.3f us\n", "eight derivatives", find_best_time(repetitions / 10 + 1, [&] {
                start_docking_pass(model, loads, 0.0, y.data(), pass);
                for (int lane = 0; lane < kLanes; ++lane) pass.y[lane].d[lane] = 1.0;
                calc_docking_pass(model, discrete, memory, data, pass);
              }));
  return 0;
}
