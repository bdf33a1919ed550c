// Damping from restitution and back, by bisection: exact for this force law, so no published
// approximation is needed (they differ from each other by half for e < 0.5).
#include "contact/laws.hpp"

#include <limits>
#include <string>

#include "math/status.hpp"

namespace dockloop {
namespace {

/// Root of an increasing function between low and high, to the last digit.
template <class F>
double bisect(double low, double high, F increasing) {
  for (double middle = (low + high) / 2; low < middle && middle < high; middle = (low + high) / 2) {
    (increasing(middle) < 0 ? low : high) = middle;
  }
  return high;
}

}  // namespace

double find_restitution(double c) {
  // Near c = 0 the two branches meet; the series is better there (next term 0.24 c^4).
  if (c < 1e-3) return 1 - c * (2.0 / 3 - c * (4.0 / 9 - c * 44.0 / 135));
  const auto excess = [c](double ec) { return std::log1p(c) - std::log1p(-ec) - c - ec; };
  return bisect(0.0, 1.0, excess) / c;
}

double find_damping_for_restitution(double restitution, double speed) {
  if (!(restitution > 0 && restitution <= 1)) {
    throw ModelError("restitution is " + describe_number(restitution) +
                     "; it must be above 0 and at most 1");
  }
  if (!(speed > 0)) {
    throw ModelError("restitution_speed is " + describe_number(speed) + " m/s; it must be above 0");
  }
  if (restitution == 1) return 0.0;
  const auto excess = [&](double c) { return restitution - find_restitution(c); };
  return bisect(0.0, 1 / restitution, excess) / speed;
}

}  // namespace dockloop
