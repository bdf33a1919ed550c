// The same mechanisms in MuJoCo: loops are `connect` constraints, which are soft.
//
//   mujoco_bench [--motion REFERENCE.json] [STATES.json MODEL.xml]... [--benchmark_... options]
//
// STATES.json as for pinocchio_bench, MODEL.xml the same mechanism (mechanisms.py: to_mjcf), with
// springs and dampers in it. The counter `error` is the largest difference of an acceleration from
// the expected one, over the largest expected; it leaves out the first three of a free joint, which
// MuJoCo has in other axes. With --motion the first mechanism is also moved through the reference
// motion, by the classic Runge-Kutta method in equal steps.
#include <benchmark/benchmark.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using nlohmann::json;
using Values = std::vector<double>;

struct Peer {
  Peer(const std::string& states_file, const std::string& model_file) {
    std::ifstream stream(states_file);
    const json document = json::parse(stream);
    char why[1000] = "";
    model = mj_loadXML(model_file.c_str(), nullptr, why, sizeof why);
    if (!model) throw std::runtime_error(why);
    data = mj_makeData(model);
    is_free = model->jnt_type[0] == mjJNT_FREE;
    has_springs = document.contains("forces") && !document["forces"].empty();
    name = document.at("name");
    for (const json& state : document.at("states")) {
      const json& expected = state.at("expected");
      states.push_back({state.at("q"), expected.at("v"), state.at("tau"), expected.at("a")});
    }
  }

  struct State {
    Values q, v, tau, expected;
  };

  void put_state(const State& state) {
    const Values &q = state.q, &v = state.v, &tau = state.tau;
    std::copy(q.begin(), q.end(), data->qpos);
    std::copy(v.begin(), v.end(), data->qvel);
    std::copy(tau.begin(), tau.end(), data->qfrc_applied);
    if (has_springs) std::fill(data->qfrc_applied, data->qfrc_applied + model->nv, 0.0);
    if (!is_free) return;
    const mjtNum* home = model->body_pos + 3 * model->jnt_bodyid[0];
    for (int i = 0; i < 3; ++i) data->qpos[i] += home[i];
    mju_rotVecQuat(data->qvel, v.data(), data->qpos + 3);  // linear velocity in world axes
  }

  double find_worst_error() {
    double worst = 0.0;
    for (const State& state : states) {
      put_state(state);
      mj_forward(model, data);
      const Values& a = state.expected;
      double difference = 0.0, scale = 0.0;
      for (size_t i = is_free ? 3 : 0; i < a.size(); ++i) {
        difference = std::max(difference, std::abs(a[i] - data->qacc[i]));
        scale = std::max(scale, std::abs(a[i]));
      }
      worst = std::max(worst, difference / scale);
    }
    return worst;
  }

  std::string name;
  std::vector<State> states;
  mjModel* model = nullptr;
  mjData* data = nullptr;
  bool is_free = false, has_springs = false;
};

void add_motion(Peer& peer, const json& reference) {
  for (const int steps : {5, 10, 20, 50, 100, 200}) {  // per sample of 0.1 s
    benchmark::RegisterBenchmark(
        ("MuJoCo/RK4/" + std::to_string(1e5 / steps).substr(0, 5) + " us").c_str(),
        [&, steps](benchmark::State& state) {
          const auto p = reference.at("p").get<std::vector<Values>>();
          peer.model->opt.timestep = 0.1 / steps;
          double error = 0.0;
          for ([[maybe_unused]] auto _ : state) {
            mj_resetData(peer.model, peer.data);
            peer.put_state(peer.states[0]);
            for (size_t i = 1; i < p.size(); ++i) {
              for (int j = 0; j < steps; ++j) mj_step(peer.model, peer.data);
              const mjtNum* x = peer.data->qpos;
              error = std::max(error, std::hypot(x[0] - p[i][0], x[1] - p[i][1], x[2] - p[i][2]));
            }
          }
          state.counters["error"] = error;
          state.counters["evaluations"] = 4.0 * steps * static_cast<double>(p.size() - 1);
        });
  }
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  try {
    int first = 1;
    json reference;
    if (argc > 2 && std::string(argv[1]) == "--motion") {
      std::ifstream stream(argv[2]);
      reference = json::parse(stream);
      first = 3;
    }
    if (first + 1 >= argc) throw std::runtime_error("no STATES.json MODEL.xml given");
    std::deque<Peer> peers;
    for (int i = first; i + 1 < argc; i += 2) {
      Peer& peer = peers.emplace_back(argv[i], argv[i + 1]);
      benchmark::RegisterBenchmark((peer.name + "/MuJoCo/with reactions").c_str(),
                                   [&peer](benchmark::State& state) {
                                     size_t k = 0;
                                     for ([[maybe_unused]] auto _ : state) {
                                       peer.put_state(peer.states[k++ % peer.states.size()]);
                                       mj_forward(peer.model, peer.data);
                                     }
                                     state.counters["error"] = peer.find_worst_error();
                                   });
      if (i == first && !reference.is_null()) add_motion(peer, reference);
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mujoco_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
