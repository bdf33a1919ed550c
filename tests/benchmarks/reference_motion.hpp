// The reference motion of hexapod_bench, and how far another one is from it.
#pragma once

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "benchmarks/runge_kutta.hpp"

namespace dockloop {

struct ReferenceMotion {
  /// tests/data/hexapod_bench_reference.json
  explicit ReferenceMotion(const std::string& file) {
    std::ifstream stream(file);
    const nlohmann::json document = nlohmann::json::parse(stream);
    t = document.at("t").get<std::vector<double>>();
    p = document.at("p").get<std::vector<std::array<double, 3>>>();
    const auto q0 = document.at("q")[0].get<std::array<double, 4>>();
    const auto v0 = document.at("v")[0].get<std::array<double, 3>>();
    const auto w0 = document.at("w")[0].get<std::array<double, 3>>();
    std::copy(p[0].begin(), p[0].end(), start.begin());
    std::copy(q0.begin(), q0.end(), start.begin() + 3);
    std::copy(v0.begin(), v0.end(), start.begin() + 7);
    std::copy(w0.begin(), w0.end(), start.begin() + 10);
  }

  /// Distance [m] of a position of the ring from that of sample i.
  double find_error(size_t i, const double* position) const {
    return std::hypot(position[0] - p[i][0], position[1] - p[i][1], position[2] - p[i][2]);
  }

  std::vector<double> t;                 ///< of the samples [s]
  std::vector<std::array<double, 3>> p;  ///< ring centre [m]
  std::array<double, 13> start;          ///< position, quaternion, velocity, angular velocity of
                                         ///< the ring at the first sample, base axes
};

/// Register the motion at each tolerance as `NAME/METHOD/TOLERANCE`; counters: largest
/// error of the ring's position over the samples [m], evaluations.
/// @param start  State(const ReferenceMotion&); @param rates  void(const double* y, double* dy)
/// @param position  of the ring in base axes, from the states: a vector of three
template <int N, class Start, class Rates, class Position>
void add_motions(const std::string& name, const ReferenceMotion& reference, Start start,
                 Rates rates, Position position) {
  for (int exponent = 3; exponent <= 11; ++exponent) {
    const double tolerance = std::pow(10.0, -exponent);
    char label[40];
    std::snprintf(label, sizeof label, "/Dormand-Prince 5/1e-%02d", exponent);
    benchmark::RegisterBenchmark((name + label).c_str(), [=, &reference](benchmark::State& state) {
      double error = 0.0;
      long evaluations = 0;
      for ([[maybe_unused]] auto _ : state) {
        RungeKutta<N> steps(tolerance);
        typename RungeKutta<N>::State y = start(reference);
        error = 0.0;
        for (size_t i = 1; i < reference.t.size(); ++i) {
          steps.advance(reference.t[i - 1], reference.t[i], y, rates);
          error = std::max(error, reference.find_error(i, position(y.data()).data()));
        }
        evaluations = steps.evaluations();
      }
      state.counters["error"] = error;
      state.counters["evaluations"] = static_cast<double>(evaluations);
    });
  }
}

}  // namespace dockloop
