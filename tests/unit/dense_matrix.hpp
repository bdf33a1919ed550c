// A stiff problem, and a Jacobian as the matrix of a linearly implicit method: for tests.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include "integrate/stepper.hpp"
#include "math/small_lu.hpp"

namespace dockloop {

/// y' = -k (y - cos t) - sin t, y = cos t.
inline Stepper::Problem make_stiff(double k) {
  Stepper::Problem p;
  p.size = 1;
  p.rates = [k](double t, const double* y, double* ydot) {
    ydot[0] = -k * (y[0] - std::cos(t)) - std::sin(t);
    return 0;
  };
  return p;
}

/// @param fill  A(t, y), a square matrix
inline Stepper::Problem::Matrix make_dense_matrix(
    int size, std::function<void(double, const double*, MatX<double>&)> fill, int cost = 0) {
  struct Dense {
    MatX<double> A, shifted;
    SmallLu<double> lu;
  };
  const auto dense = std::make_shared<Dense>();
  dense->A.setZero(size, size);
  dense->shifted = dense->A;
  dense->lu.resize(size);
  Stepper::Problem::Matrix matrix;
  matrix.build = [dense, fill, cost](double t, const double* y, int& spent) {
    fill(t, y, dense->A);
    spent += cost;
    return 0;
  };
  matrix.factor = [dense](double g) {
    dense->shifted = -dense->A;
    dense->shifted.diagonal().array() += 1.0 / g;
    return dense->lu.factorise(dense->shifted);
  };
  matrix.solve = [dense](double* x) { dense->lu.solve(x); };
  return matrix;
}

/// Of the problem's Jacobian; of differences, which are exact for linear rates, if it has none.
inline Stepper::Problem::Matrix make_dense_matrix(const Stepper::Problem& problem) {
  const int n = problem.size;
  const auto jacobian = problem.jacobian;
  const auto rates = problem.rates;
  const auto work = std::make_shared<std::vector<double>>(3 * static_cast<size_t>(n));
  return make_dense_matrix(
      n,
      [n, jacobian, rates, work](double t, const double* y, MatX<double>& A) {
        if (jacobian) {
          jacobian(t, y, A.data());
          return;
        }
        double *at = work->data(), *before = at + n, *after = before + n;
        for (int j = 0; j < n; ++j) {
          constexpr double kShift = 1e-6;
          std::copy_n(y, n, at);
          rates(t, at, before);
          at[j] += kShift;
          rates(t, at, after);
          for (int i = 0; i < n; ++i) A(i, j) = (after[i] - before[i]) / (at[j] - y[j]);
        }
      },
      problem.jacobian_cost);
}

}  // namespace dockloop
