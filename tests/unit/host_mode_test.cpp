// Two bodies on a spring, one of which a host reports: does the fit find their mode?
#include "sim/host_mode.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>

namespace dockloop {
namespace {

constexpr double kPart = 2e3, kRest = 23e3, kAll = kPart + kRest;  // kg
constexpr double kDamping = 0.02;

ModeStep make_step(double h) {
  const Vec6<double> zero = Vec6<double>::Zero();
  return {zero, zero, zero, 1e-11, h};
}

/// Sums over steps with loads that change from step to step; the motion is a closed form.
ModeSums dock_on_spring(double frequency, double h, int steps) {
  const double w = 2.0 * static_cast<double>(EIGEN_PI) * frequency, share = kRest / kAll;
  const std::complex<double> rate(-kDamping * w, w * std::sqrt(1.0 - kDamping * kDamping));
  ModeSums sums;
  double r = 0.0, dr = 0.0;  // of the part relative to the rest
  for (int n = 0; n < steps; ++n) {
    const double force = 300.0 * std::sin(0.7 * n) + 100.0;
    const double held = force / (kPart * w * w);  // deflection if the force stays
    // x = Re(c e^{rate t}) with x and its rate at the start
    const std::complex<double> c(r - held, (rate.real() * (r - held) - dr) / rate.imag());
    const std::complex<double> end = c * std::exp(rate * h);
    const double r1 = held + end.real(), dr1 = (rate * end).real();
    ModeStep step = make_step(h);
    step.error[0] = share * (dr1 - dr);
    step.offset[0] = share * (r1 - r - h * dr);
    step.change[0] = h * force / kAll;
    add_to_mode(step, 1.0, sums);
    r = r1;
    dr = dr1;
  }
  return sums;
}

TEST(HostMode, HasTheFrequencyAndTheDeflectionOfTwoBodiesOnASpring) {
  for (const double frequency : {8.0, 12.0, 19.3}) {
    for (const double h : {0.01, 0.03, 0.1}) {
      const HostMode mode = find_mode(dock_on_spring(frequency, h, 60), h);
      const double w = 2.0 * static_cast<double>(EIGEN_PI) * frequency;
      EXPECT_NEAR(mode.frequency, frequency, 1e-6 * frequency) << h;
      EXPECT_NEAR(mode.deflection, kRest / (kPart * w * w), 1e-6 * kRest / (kPart * w * w)) << h;
    }
  }
}

TEST(HostMode, IsNoneOfARigidBodyOfAnotherMass) {
  ModeSums sums;
  for (int n = 0; n < 60; ++n) {
    ModeStep step = make_step(0.01);
    step.change[0] = 0.01 * std::sin(0.7 * n);
    step.error[0] = 0.25 * step.change[0];
    step.offset[0] = 0.5 * step.h * step.error[0];
    add_to_mode(step, 1.0, sums);
  }
  EXPECT_EQ(find_mode(sums, 0.01).frequency, 0.0);
}

}  // namespace
}  // namespace dockloop
