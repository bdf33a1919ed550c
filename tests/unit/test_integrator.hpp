// Small adaptive integrator for tests: Dormand-Prince 5(4), so that unit tests of force laws need
// no outside package. Coefficients: Hairer, Norsett, Wanner, Solving ODEs I, table II.5.2.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace dockloop {

struct TestIntegration {
  int steps = 0, rejected = 0;
  bool ok = true;
};

/// Integrate y' = f from t to end (or until `accepted` returns false).
/// @param rhs       bool(double t, const double* y, double* y_dot); false asks for a smaller step
/// @param accepted  bool(double t, double* y) after every accepted step; may change y
/// Error norm: largest |error|/(atol + rtol |y|).
template <class Rhs, class Accepted>
TestIntegration integrate_dormand_prince(Rhs rhs, double t, double end, std::vector<double>& y,
                                         double rtol, double atol, double h, Accepted accepted) {
  static const double a[7][6] = {
      {},
      {1.0 / 5},
      {3.0 / 40, 9.0 / 40},
      {44.0 / 45, -56.0 / 15, 32.0 / 9},
      {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
      {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
      {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
  static const double c[7] = {0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
  static const double e[7] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                              -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
  const size_t n = y.size();
  std::vector<double> k[7], stage(n);
  for (std::vector<double>& ki : k) ki.assign(n, 0.0);
  TestIntegration result;
  while (t < end) {
    h = std::min(h, end - t);
    if (h < 1e-14 * std::max(1.0, std::abs(end))) {
      t = end;
      break;
    }
    bool valid = true;
    double error = 0;
    for (int s = 0; s < 7 && valid; ++s) {
      for (size_t i = 0; i < n; ++i) {
        double sum = 0;
        for (int j = 0; j < s; ++j) sum += a[s][j] * k[j][i];
        stage[i] = y[i] + h * sum;
      }
      valid = rhs(t + c[s] * h, stage.data(), k[s].data());
    }
    for (size_t i = 0; i < n && valid; ++i) {
      double sum = 0;
      for (int s = 0; s < 7; ++s) sum += e[s] * k[s][i];
      const double scale = atol + rtol * std::max(std::abs(y[i]), std::abs(stage[i]));
      error = std::max(error, std::abs(h * sum) / scale);
    }
    if (!valid || !(error <= 1)) {
      ++result.rejected;
      h *= valid ? std::max(0.2, 0.9 * std::pow(error, -0.2)) : 0.25;
      if (h < 1e-13) {
        result.ok = false;
        return result;
      }
      continue;
    }
    t += h;
    y = stage;  // the last stage is the fifth-order solution
    ++result.steps;
    h *= std::min(5.0, 0.9 * std::pow(std::max(error, 1e-10), -0.2));
    if (!accepted(t, y.data())) return result;
  }
  return result;
}

}  // namespace dockloop
