// Joint force laws: spring, damper, preload, end stops.
// 1. each part by hand, with its sign;
// 2. the force is the negative gradient of the energy, and the energy its integral;
// 3. the end stop is C1, never pulls, and takes energy only;
// 4. power balances: force x rate = - d energy/dt - dissipation + command power.
#include <gtest/gtest.h>

#include <cmath>

#include "math/one_sided_spring.hpp"
#include "mechanism/joint_forces.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using L = Extended;

/// One slide with one force on it.
struct OneForce {
  explicit OneForce(const JointForce& law) {
    Body body;
    body.joint = JointType::kPrismatic;
    body.mass = 1.0;
    model.bodies.push_back(body);
    model.forces.push_back(law);
    number_coordinates(model);
  }
  template <class S>
  S evaluate(S q, S v, S command, JointForceSums<S>& sums) const {
    VecX<S> q_all(1), v_all(1), commands(1), force(1), tau(1);
    q_all << q;
    v_all << v;
    commands << command;
    tau << S(1000);  // is added to
    sums = calc_joint_forces<S>(model, q_all, v_all, commands, force, tau);
    EXPECT_LE(std::abs(static_cast<double>(tau[0] - S(1000) - force[0])), 1e-11);
    return force[0];
  }
  double force(double q, double v = 0.0, double command = 0.0) const {
    JointForceSums<double> sums;
    return evaluate<double>(q, v, command, sums);
  }
  MechanismModel model;
};

JointForce make_stop_only() {
  JointForce law;
  law.stops = {true, -0.1, 0.2, 5e5, 8.0, 1e-3};
  return law;
}

JointForce make_full() {
  JointForce law = make_stop_only();
  law.stiffness = 2000.0;
  law.damping = 60.0;
  law.rest = 0.03;
  law.preload = 45.0;
  return law;
}

TEST(JointForces, a_stretched_spring_pulls_and_a_preload_extends) {
  JointForce law;
  law.stiffness = 200.0;
  law.rest = 0.1;
  EXPECT_DOUBLE_EQ(OneForce(law).force(0.35), -50.0);
  law.preload = 7.0;
  EXPECT_DOUBLE_EQ(OneForce(law).force(0.1), 7.0);
  law.damping = 3.0;
  EXPECT_DOUBLE_EQ(OneForce(law).force(0.1, 2.0), 1.0);
  EXPECT_DOUBLE_EQ(OneForce(law).force(0.1, 2.0, 10.0), 11.0);
}

TEST(JointForces, stops_push_back_from_both_ends_and_are_silent_between) {
  const OneForce stop(make_stop_only());
  EXPECT_EQ(stop.force(0.0), 0.0);
  EXPECT_EQ(stop.force(0.2), 0.0);
  EXPECT_EQ(stop.force(-0.1), 0.0);
  // Beyond the toe: k (depth - toe/2). Measured 1.7e-11 N.
  EXPECT_NEAR(stop.force(0.205), -5e5 * 4.5e-3, scaled_tolerance(2e-10));
  EXPECT_NEAR(stop.force(-0.105), 5e5 * 4.5e-3, scaled_tolerance(2e-10));
  // Damping is a factor 1 + lambda x depth rate.
  EXPECT_NEAR(stop.force(0.205, 0.05), -5e5 * 4.5e-3 * 1.4, scaled_tolerance(2e-10));
  EXPECT_NEAR(stop.force(-0.105, 0.05), 5e5 * 4.5e-3 * 0.6, scaled_tolerance(2e-10));
}

TEST(JointForces, two_forces_on_one_joint_add) {
  MechanismModel model = OneForce(make_full()).model;
  model.forces.push_back(model.forces[0]);
  VecX<double> q(1), v(1), command(2), force(2), tau(1);
  q << 0.21;
  v << -0.3;
  command << 1.0, 2.0;
  tau << 0.0;
  calc_joint_forces<double>(model, q, v, command, force, tau);
  EXPECT_DOUBLE_EQ(tau[0], force[0] + force[1]);
  EXPECT_DOUBLE_EQ(force[1], force[0] + 1.0);
}

TEST(JointForces, the_stop_is_continuous_with_its_slope) {
  const L k = 5e5L, toe = 1e-3L, step = 1e-12L;
  for (const L at : {L(0), toe}) {
    const Elastic<L> below = calc_toe_spring<L>(at - step, k, toe);
    const Elastic<L> above = calc_toe_spring<L>(at + step, k, toe);
    EXPECT_LE(std::abs(static_cast<double>(above.force - below.force)), 2.01 * 5e5 * 1e-12);
    const L slope_below =
        (calc_toe_spring<L>(at, k, toe).force - calc_toe_spring<L>(at - step, k, toe).force) / step;
    const L slope_above =
        (calc_toe_spring<L>(at + step, k, toe).force - calc_toe_spring<L>(at, k, toe).force) / step;
    EXPECT_LE(std::abs(static_cast<double>((slope_above - slope_below) / k)), 3e-9);
  }
}

TEST(JointForces, the_energy_of_a_stop_is_the_integral_of_its_force) {
  // Simpson is exact for the parabola and the line, taken on either side of the toe.
  const double k = 5e5, toe = 1e-3;
  Residual worst;
  for (double depth : {2e-4, 9e-4, 1e-3, 1.5e-3, 7e-3}) {
    double sum = 0.0, from = 0.0;
    for (double to : {std::min(depth, toe), depth}) {
      const auto force = [&](double d) { return calc_toe_spring<double>(d, k, toe).force; };
      sum += (to - from) / 6.0 * (force(from) + 4.0 * force((from + to) / 2) + force(to));
      from = to;
    }
    worst.add(calc_toe_spring<double>(depth, k, toe).energy / sum - 1.0, std::to_string(depth));
  }
  EXPECT_RESIDUAL_BELOW(worst, 2e-15);  // measured 2.2e-16
}

TEST(JointForces, the_elastic_force_is_the_gradient_of_the_energy) {
  const OneForce all(make_full());
  TestRandom random(31);
  Residual worst;
  for (int i = 0; i < 2000; ++i) {
    const L q = random.uniform(-0.12, 0.22), h = 1e-7L;
    JointForceSums<L> above, below, sums;
    all.evaluate<L>(q + h, 0, 0, above);
    all.evaluate<L>(q - h, 0, 0, below);
    const L force = all.evaluate<L>(q, 0, 0, sums);
    const L scale = 45 + abs(force);
    worst.add(static_cast<double>((force + (above.energy - below.energy) / (2 * h)) / scale),
              "q = " + std::to_string(static_cast<double>(q)));
  }
  EXPECT_RESIDUAL_BELOW(worst, 2.4e-8);  // measured 2.4e-9, across the start of the toe
}

TEST(JointForces, nothing_but_the_command_feeds_energy) {
  const OneForce all(make_full());
  TestRandom random(32);
  Residual balance;
  for (int i = 0; i < 20000; ++i) {
    const double q = random.uniform(-0.12, 0.22), v = random.uniform(-1, 1);
    const double command = random.uniform(-20, 20);
    JointForceSums<double> sums, rest;
    const double force = all.evaluate<double>(q, v, command, sums);
    const double elastic = all.evaluate<double>(q, 0.0, 0.0, rest);  // - d energy/dq
    EXPECT_GE(sums.dissipation, 0.0);
    EXPECT_EQ(sums.energy, rest.energy);
    balance.add((force * v - (elastic * v - sums.dissipation + sums.command_power)) /
                (1.0 + std::abs(force * v) + sums.dissipation));
  }
  EXPECT_RESIDUAL_BELOW(balance, 4e-15);  // measured 3.7e-16
}

TEST(JointForces, a_stop_never_pulls_however_fast_it_is_left) {
  const OneForce stop(make_stop_only());
  for (double speed : {0.0, 0.1, 0.125, 0.2, 5.0, 1e3}) {
    EXPECT_LE(stop.force(0.205, -speed), 0.0);
    EXPECT_GE(stop.force(-0.105, speed), 0.0);
  }
  EXPECT_EQ(stop.force(0.205, -0.125), 0.0);  // 1/lambda: the force has just vanished
}

TEST(JointForces, a_bounce_on_a_stop_loses_what_is_booked) {
  const OneForce stop(make_stop_only());
  // q'' = force at 1 kg, from contact with 0.3 m/s until it has left; y = q, v, loss.
  std::vector<double> y{0.2, 0.3, 0.0};
  const auto rates = [&](const double* s, double* d) {
    JointForceSums<double> sums;
    d[0] = s[1];
    d[1] = stop.evaluate<double>(s[0], s[1], 0.0, sums);
    d[2] = sums.dissipation;
  };
  for (int i = 0; i < 20000 && y[0] >= 0.2; ++i) step_rk4<double>(rates, y, 1e-6);
  EXPECT_LT(y[0], 0.2);
  EXPECT_LT(y[1], -0.05);
  EXPECT_NEAR(0.5 * y[1] * y[1] + y[2], 0.5 * 0.3 * 0.3,
              scaled_tolerance(2e-13));  // measured 1.7e-14
}

}  // namespace
}  // namespace dockloop
