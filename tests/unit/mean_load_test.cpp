// The mean load that a host holds over a step instead of the true, varying one.
// 1. a constant load on a body is found again;
// 2. held over the step, it gives the linear and angular impulse that it was made from: to
//    1e-8 for a hard pulse within 10 ms;
// 3. the integrals of position and attitude against fine quadrature.
#include "sim/mean_load.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

constexpr double kMass = 900.0;
const Mat3<double>& inertia() {
  static const Mat3<double> I =
      (Mat3<double>() << 800, 30, -20, 30, 1100, 40, -20, 40, 1500).finished();
  return I;
}

/// Rigid body under force (axes of O) and torque (body axes); impulses about O as states 13..18,
/// integrals of position 19..21 and of attitude 22..30.
template <class Load>
struct FreeBody {
  Load load;
  void operator()(const double* y, double* d, double time) const {
    const V x(y[0], y[1], y[2]), v(y[3], y[4], y[5]), w(y[10], y[11], y[12]);
    const Vec4<double> q(y[6], y[7], y[8], y[9]);
    const Mat3<double> R = quat_to_matrix<double>(q);
    const Wrench<double> now = load(time);
    const V wdot = inertia().inverse() * (now.t - w.cross(V(inertia() * w)));
    const Vec4<double> qdot = quat_rate<double>(q, w);
    const V angular = x.cross(now.f) + R * now.t;
    for (int i = 0; i < 3; ++i) {
      d[i] = v[i];
      d[3 + i] = now.f[i] / kMass;
      d[10 + i] = wdot[i];
      d[13 + i] = now.f[i];
      d[16 + i] = angular[i];
      d[19 + i] = x[i];
      for (int j = 0; j < 3; ++j) d[22 + 3 * i + j] = R(i, j);
    }
    for (int i = 0; i < 4; ++i) d[6 + i] = qdot[i];
  }
};

struct Result {
  VehicleState end;
  Wrench<double> impulse;
  V position_integral;
  Mat3<double> attitude_integral;
};

template <class Load>
Result fly(Load load, const VehicleState& start, double h) {
  const FreeBody<Load> body{load};
  std::vector<double> y(31, 0.0);
  for (int i = 0; i < 3; ++i) {
    y[i] = start.x[i];
    y[3 + i] = start.v[i];
    y[10 + i] = start.w[i];
  }
  for (int i = 0; i < 4; ++i) y[6 + i] = start.q[i];
  y.push_back(0.0);  // time as a state
  constexpr int kSteps = 400;
  const auto rates = [&](const double* s, double* d) {
    body(s, d, s[31]);
    d[31] = 1.0;
  };
  for (int n = 0; n < kSteps; ++n) step_rk4<double>(rates, y, h / kSteps);
  Result result;
  for (int i = 0; i < 3; ++i) {
    result.end.x[i] = y[i];
    result.end.v[i] = y[3 + i];
    result.end.w[i] = y[10 + i];
    result.impulse.f[i] = y[13 + i];
    result.impulse.t[i] = y[16 + i];
    result.position_integral[i] = y[19 + i];
    for (int j = 0; j < 3; ++j) result.attitude_integral(i, j) = y[22 + 3 * i + j];
  }
  for (int i = 0; i < 4; ++i) result.end.q[i] = y[6 + i];
  return result;
}

VehicleState make_start(TestRandom& random) {
  VehicleState s;
  s.x = random.vector(10.0);
  s.v = random.vector(0.3);
  s.q = quat_exp<double>(random.vector(2.0));
  s.w = random.vector(0.1);
  return s;
}

TEST(MeanLoad, finds_a_constant_load_again) {
  TestRandom random(41);
  Residual worst;
  for (int trial = 0; trial < 50; ++trial) {
    const VehicleState start = make_start(random);
    const Wrench<double> held{random.vector(500.0), random.vector(300.0)};
    const Result r = fly([&](double) { return held; }, start, 0.1);
    const Wrench<double> mean = find_mean_load(r.impulse, start, r.end, 0.1);
    worst.add((mean.f - held.f).norm() / held.f.norm(), "force");
    worst.add((mean.t - held.t).norm() / held.t.norm(), "torque");
  }
  EXPECT_RESIDUAL_BELOW(worst, 7e-8);  // measured 6.7e-9
}

/// A hard contact inside the step: a half-sine pulse off centre.
Wrench<double> pulse(double t, double h) {
  const double phase = (t / h - 0.2) / 0.5;
  if (phase < 0.0 || phase > 1.0) return {};
  const double s = std::sin(3.14159265358979323846 * phase);
  return {V(-4000, 300, 150) * s, V(200, 900, -500) * s};
}

/// Error of the impulses when the host flies the mean load from the same start, over the impulses.
double find_impulse_error(double h, TestRandom& random) {
  const VehicleState start = make_start(random);
  const Result solution = fly([&](double t) { return pulse(t, h); }, start, h);
  const Wrench<double> mean = find_mean_load(solution.impulse, start, solution.end, h);
  const Result host = fly([&](double) { return mean; }, start, h);
  return std::max((host.impulse.f - solution.impulse.f).norm() / solution.impulse.f.norm(),
                  (host.impulse.t - solution.impulse.t).norm() / solution.impulse.t.norm());
}

TEST(MeanLoad, held_over_the_step_reproduces_the_impulses_of_a_pulse) {
  Residual fine, coarse;
  for (unsigned seed = 0; seed < 20; ++seed) {
    TestRandom random(4200 + seed), same(4200 + seed);
    fine.add(find_impulse_error(0.01, random));
    coarse.add(find_impulse_error(0.1, same));
  }
  EXPECT_RESIDUAL_BELOW(fine, 1.2e-7);    // measured 1.2e-8
  EXPECT_RESIDUAL_BELOW(coarse, 1.1e-5);  // measured 1.1e-6
}

TEST(MeanLoad, integrals_of_position_and_attitude_match_fine_quadrature) {
  TestRandom random(43);
  Residual position, attitude;
  for (int trial = 0; trial < 50; ++trial) {
    const VehicleState start = make_start(random);
    const Wrench<double> held{random.vector(500.0), random.vector(300.0)};
    const double h = 0.1;
    const Result r = fly([&](double) { return held; }, start, h);
    position.add((h * find_mean_position(start, r.end, h) - r.position_integral).norm() /
                 (h * start.x.norm()));
    attitude.add(
        (h * find_mean_attitude(start, r.end, h) - r.attitude_integral).cwiseAbs().maxCoeff() / h);
  }
  EXPECT_RESIDUAL_BELOW(position, 1.3e-14);  // measured 1.3e-15: constant force is its exact case
  EXPECT_RESIDUAL_BELOW(attitude, 2e-7);     // measured 1.8e-8
}

TEST(MeanLoad, the_attitude_integral_converges_with_the_fourth_power_of_the_step) {
  TestRandom random(44);
  const VehicleState start = make_start(random);
  const Wrench<double> held{random.vector(500.0), random.vector(300.0)};
  double last = 0.0;
  for (double h : {1.6, 0.8, 0.4}) {
    const Result r = fly([&](double) { return held; }, start, h);
    const double error =
        (h * find_mean_attitude(start, r.end, h) - r.attitude_integral).cwiseAbs().maxCoeff() / h;
    if (last > 0.0) {
      EXPECT_GT(last / error, 11.0);
      EXPECT_LT(last / error, 40.0);
    }
    last = error;
  }
}

TEST(MeanLoad, a_step_without_impulse_has_no_load) {
  TestRandom random(45);
  const VehicleState start = make_start(random);
  const Result r = fly([](double) { return Wrench<double>(); }, start, 0.2);
  const Wrench<double> mean = find_mean_load(r.impulse, start, r.end, 0.2);
  EXPECT_EQ(mean.f.norm(), 0.0);
  EXPECT_EQ(mean.t.norm(), 0.0);
}

}  // namespace
}  // namespace dockloop
