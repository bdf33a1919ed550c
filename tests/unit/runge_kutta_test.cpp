// The tables of explicit methods, by steps made with nothing but them.
// 1. results, estimates and dense output have the orders that are stated;
// 2. the last stage of adaptive tables is at the end of the step, which gives the fastest rate;
// 3. the stabilised pair is stable as far as stated, on the real axis and where rings swing, and
//    so are its stages.
#include "integrate/runge_kutta.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <vector>

namespace dockloop {
namespace {

using State = std::array<double, 2>;

/// y0 = exp(sin t), y1 = cos t.
State find_exact(double t) { return {std::exp(std::sin(t)), std::cos(t)}; }
State find_rates(double t, const State& y) {
  return {y[0] * std::cos(t) + (y[1] - std::cos(t)) * y[0] * y[0],
          -std::sin(t) * y[0] / std::exp(std::sin(t))};
}

struct Step {
  State end, error, middle;
};

Step make_step(const RungeKuttaTable& table, double t, const State& y, double h) {
  std::vector<State> k = {find_rates(t, y)};
  const auto add_up = [&](const double* weight, size_t count) {
    State sum{};
    for (size_t j = 0; j < count; ++j) {
      for (size_t i = 0; i < 2; ++i) sum[i] += h * weight[j] * k[j][i];
    }
    return sum;
  };
  const double* a = table.a;
  for (int s = 1; s < table.stages; a += s++) {
    double c = 0.0;
    for (int j = 0; j < s; ++j) c += a[j];
    const State sum = add_up(a, k.size());
    k.push_back(find_rates(t + c * h, {y[0] + sum[0], y[1] + sum[1]}));
  }
  Step step;
  const State sum = add_up(table.b, k.size());
  step.end = {y[0] + sum[0], y[1] + sum[1]};
  k.push_back(find_rates(t + h, step.end));
  if (!table.error) return step;
  step.error = add_up(table.error, k.size());
  const State bulge = add_up(table.dense, k.size());
  for (size_t i = 0; i < 2; ++i) {
    step.middle[i] =
        (y[i] + step.end[i]) / 2 + h * (k.front()[i] - k.back()[i]) / 8 + bulge[i] / 16;
  }
  return step;
}

double find_distance(const State& a, const State& b) {
  return std::max(std::abs(a[0] - b[0]), std::abs(a[1] - b[1]));
}

TEST(RungeKuttaTables, have_their_orders) {
  struct Case {
    const char* name;
    RungeKuttaTable table;
    double order, h;
  };
  for (const Case& c :
       {Case{"Dormand-Prince", get_dormand_prince(), 5, 0.1},
        Case{"stabilised", get_stabilised(), 4, 0.2}, Case{"classic", get_classic(), 4, 0.1}}) {
    // One step: errors are of one order more.
    const State start = find_exact(0.3);
    double error[2], estimate[2], middle[2];
    for (int i = 0; i < 2; ++i) {
      const double h = c.h / (1 + i);
      const Step step = make_step(c.table, 0.3, start, h);
      error[i] = find_distance(step.end, find_exact(0.3 + h));
      estimate[i] = find_distance(step.error, {0.0, 0.0});
      const double g = h / 4;
      middle[i] = find_distance(make_step(c.table, 0.3, start, g).middle, find_exact(0.3 + g / 2));
    }
    std::printf("%s: order %.2f, of the estimate %.2f, inside %.2f\n", c.name,
                std::log2(error[0] / error[1]) - 1, std::log2(estimate[0] / estimate[1]) - 1,
                std::log2(middle[0] / middle[1]) - 1);
    EXPECT_NEAR(std::log2(error[0] / error[1]), c.order + 1, 0.5) << c.name;
    if (!c.table.error) continue;
    EXPECT_NEAR(std::log2(estimate[0] / estimate[1]), c.table.error_order + 1, 0.5) << c.name;
    EXPECT_GT(std::log2(middle[0] / middle[1]), 4.5) << c.name;
    double end = 0.0;
    const double* last = c.table.a + (c.table.stages - 1) * (c.table.stages - 2) / 2;
    for (int j = 0; j + 1 < c.table.stages; ++j) end += last[j];
    EXPECT_NEAR(end, 1.0, 1e-14) << c.name;
  }
}

/// Largest factor by which a stage or the end of a step grows where the rates are z y / h.
double find_growth(const RungeKuttaTable& table, std::complex<double> z, bool of_stages) {
  std::vector<std::complex<double>> k = {z};
  double largest = 0.0;
  const auto add_up = [&](const double* weight) {
    std::complex<double> y = 1.0;
    for (size_t j = 0; j < k.size(); ++j) y += weight[j] * k[j];
    return y;
  };
  const double* a = table.a;
  for (int s = 1; s < table.stages; a += s++) {
    const std::complex<double> y = add_up(a);
    k.push_back(z * y);
    largest = std::max(largest, std::abs(y));
  }
  return of_stages ? largest : std::abs(add_up(table.b));
}

TEST(StabilisedPair, is_stable_where_dockings_have_their_rates) {
  const RungeKuttaTable table = get_stabilised();
  double largest = 0.0, stages = 0.0;
  for (int i = 1; i <= 1000; ++i) {
    const double part = i / 1000.0;
    for (const std::complex<double> z :
         {std::complex<double>(-kStabilisedInterval, 0.0), {-0.3, 2.7}, {-0.6, 2.8}, {-0.5, 1.7}}) {
      largest = std::max(largest, find_growth(table, part * z, false));
      stages = std::max(stages, find_growth(table, part * z, true));
    }
  }
  std::printf("largest growth %.4f, of a stage %.2f\n", largest, stages);
  EXPECT_LT(largest, 1.005);
  EXPECT_LT(stages, 1.3);
  EXPECT_GT(find_growth(table, -1.3 * kStabilisedInterval, false), 1.5);  // it is not longer
  EXPECT_GT(find_growth(get_dormand_prince(), -0.3 * kStabilisedInterval, false), 1.5);
}

}  // namespace
}  // namespace dockloop
