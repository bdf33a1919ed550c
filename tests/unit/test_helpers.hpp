// Shared by the unit tests of the core: stored data, residuals, reduced equations as an ODE.
//
// Tolerances are ten times the worst residual measured (g++ 12.2, x86-64; the measured figure
// stands next to each). DOCK_TOL_SCALE scales all of them; 0 makes every test print its residual.
// Random numbers (TestRandom, fixed seed) and scaled_tolerance() come from
// contact_test_support.hpp.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "math/rotation.hpp"
#include "math/scalar.hpp"
#include "mechanism/mechanism_dynamics.hpp"
#include "unit/contact_test_support.hpp"

namespace dockloop {

/// Largest residual of a test and where it occurred; a NaN counts as infinite and stays.
struct Residual {
  double value = 0.0;
  std::string where = "nowhere";
  void add(double residual, const std::string& at = "") {
    residual = std::isnan(residual) ? std::numeric_limits<double>::infinity() : std::abs(residual);
    if (residual > value) {
      value = residual;
      where = at;
    }
  }
};

#define EXPECT_RESIDUAL_BELOW(residual, tolerance) \
  EXPECT_LE((residual).value, scaled_tolerance(tolerance)) << "at " << (residual).where

inline std::string read_test_file(const std::string& name) {
  const std::string path = std::string(DOCKLOOP_TEST_DATA) + "/" + name;
  std::ifstream file(path);
  if (!file) throw ModelError("cannot read " + path);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// All numbers of nested arrays and objects, in order of the keys.
inline void append_numbers(const nlohmann::json& j, std::vector<double>& out) {
  if (j.is_number()) {
    out.push_back(j.get<double>());
    return;
  }
  for (const nlohmann::json& item : j) append_numbers(item, out);
}

inline VecX<double> to_vector(const nlohmann::json& j) {
  std::vector<double> numbers;
  append_numbers(j, numbers);
  return Eigen::Map<VecX<double>>(numbers.data(), static_cast<int>(numbers.size()));
}

/// Largest difference over the largest magnitude expected (over 1 if all of it is zero).
template <class A, class B>
double find_relative_error(const A& actual, const B& expected) {
  if (actual.size() != expected.size()) return std::numeric_limits<double>::infinity();
  if (expected.size() == 0) return 0.0;
  if (!actual.template cast<double>().allFinite()) return std::numeric_limits<double>::infinity();
  const MatX<Extended> a = actual.template cast<Extended>();
  const MatX<Extended> b = expected.template cast<Extended>();
  const Extended scale = b.cwiseAbs().maxCoeff(), error = (a - b).cwiseAbs().maxCoeff();
  return to_double(scale > 0 ? error / scale : error);
}

/// Difference of angles modulo a full turn.
inline double find_angle_difference(double a, double b) {
  return std::remainder(a - b, 2.0 * 3.14159265358979323846);
}

/// Message of the ModelError that `call` throws, empty if none.
template <class Call>
std::string find_refusal(Call call) {
  try {
    call();
  } catch (const ModelError& error) {
    return error.what();
  }
  return "";
}

/// Random unit vector (not uniform on the sphere, which no test needs).
inline Vec3<double> make_unit(TestRandom& random) {
  for (;;) {
    const Vec3<double> v = random.vector(1.0);
    if (v.norm() > 0.1) return v.normalized();
  }
}

/// Symmetric positive definite inertia of a body of this mass and size.
inline Mat3<double> make_inertia(TestRandom& random, double mass, double size) {
  const Mat3<double> R = rotation_of(random.vector(2.0));
  const Vec3<double> squares(random.uniform(0.2, 1.0), random.uniform(0.2, 1.0),
                             random.uniform(0.2, 1.0));
  const Vec3<double> principal(squares[1] + squares[2], squares[0] + squares[2],
                               squares[0] + squares[1]);
  return mass * size * size * (R * principal.asDiagonal() * R.transpose());
}

/// The reduced equations as y' = f(y), y = (independent coordinates, independent velocities).
/// @param put_loads  void(MechanismData<S>&): fills data.tau and data.tree.external
template <class S, class PutLoads>
Status calc_reduced_rates(const Mechanism& mechanism, const BaseMotion<S>& base, PutLoads put_loads,
                          const S* y, S* ydot, MechanismData<S>& data) {
  const LoopPlan& plan = mechanism.plan;
  const size_t nq = plan.ind_q.size();
  for (size_t i = 0; i < nq; ++i) data.tree.q[plan.ind_q[i]] = y[i];
  for (size_t i = 0; i < plan.ind_v.size(); ++i) data.tree.v[plan.ind_v[i]] = y[nq + i];
  const Status status = calc_position(mechanism, data);
  if (!status.ok()) return status;
  calc_velocity(mechanism, base, data);
  put_loads(data);
  calc_acceleration(mechanism, base, data);
  size_t q = 0;
  for (int i : plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[i];
    if (body.joint != JointType::kFree) {
      ydot[q++] = data.tree.v[body.v_index];
      continue;
    }
    const Vec4<S> quat = data.tree.q.template segment<4>(body.q_index + 3);
    const Vec3<S> rate = quat_to_matrix<S>(quat) * data.tree.v.template segment<3>(body.v_index);
    const Vec4<S> turn = quat_rate<S>(quat, data.tree.v.template segment<3>(body.v_index + 3));
    for (int j = 0; j < 3; ++j) ydot[q++] = rate[j];
    for (int j = 0; j < 4; ++j) ydot[q++] = turn[j];
  }
  for (size_t i = 0; i < plan.ind_v.size(); ++i) ydot[nq + i] = data.vdot[plan.ind_v[i]];
  return status;
}

/// The state of the independents as calc_reduced_rates() wants it.
template <class S>
std::vector<S> get_reduced_state(const Mechanism& mechanism, const MechanismData<S>& data) {
  std::vector<S> y;
  for (int i : mechanism.plan.ind_q) y.push_back(data.tree.q[i]);
  for (int i : mechanism.plan.ind_v) y.push_back(data.tree.v[i]);
  return y;
}

/// One classical Runge-Kutta step of y' = f(y). @param rates void(const S* y, S* ydot)
template <class S, class Rates>
void step_rk4(Rates rates, std::vector<S>& y, S h) {
  const size_t n = y.size();
  std::vector<S> k[4], stage(n);
  for (std::vector<S>& ki : k) ki.assign(n, S(0));
  const S fraction[4] = {S(0), h / S(2), h / S(2), h};
  for (int s = 0; s < 4; ++s) {
    for (size_t i = 0; i < n; ++i) stage[i] = y[i] + (s > 0 ? fraction[s] * k[s - 1][i] : S(0));
    rates(stage.data(), k[s].data());
  }
  for (size_t i = 0; i < n; ++i) {
    y[i] += h / S(6) * (k[0][i] + S(2) * (k[1][i] + k[2][i]) + k[3][i]);
  }
}

}  // namespace dockloop
