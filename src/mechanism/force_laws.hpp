// Laws of force elements (model/force_element.hpp) as pure functions: force, energies, powers.
//
// Every law obeys, for every history,
//
//   f v = -dU/dt - D + W,   D >= 0
//
// U energy stored, D power dissipated, W power of a drive. A brake with a bristle has one state z,
// in units of the coordinate. All formulas are C1 in s for corners above 0.
#pragma once

#include <algorithm>
#include <cmath>

#include "math/one_sided_spring.hpp"
#include "math/scalar.hpp"
#include "model/force_element.hpp"

namespace dockloop {

/// What a law depends on.
template <class S>
struct LawInput {
  S s = S(0), v = S(0);  ///< coordinate of the element and its rate
  S time = S(0);         ///< since the law acts, negative before [s]
  S engagement = S(1);   ///< of a brake; multiplies its own
  S health = S(1);       ///< what failures leave of the level of a brake
  S command = S(0);      ///< of a commanded law: voltage, current or target
  S z = S(0);            ///< bristle
  S load = S(0);         ///< size of the sum of the other laws of the element
};

template <class S>
struct LawTerms {
  S force = S(0);
  S energy = S(0);       ///< stored [J]
  S dissipation = S(0);  ///< [W]
  S work = S(0);         ///< of a drive [W]
  S z_rate = S(0);       ///< of the bristle
  S saturation = S(0);   ///< force or current as a share of its limit
  /// kOk, or where a table is left that is not to be left
  StatusCode outside = StatusCode::kOk;
};

/// max(0, u) with a parabola for |u| < eps; and its integral.
template <class S>
S calc_corner(const S& u, double eps) {
  if (!(u > S(-eps))) return S(0);
  if (!(u < S(eps))) return u;
  const S w = u + S(eps);
  return w * w / S(4.0 * eps);
}
template <class S>
S calc_corner_integral(const S& u, double eps) {
  if (!(u > S(-eps))) return S(0);
  if (!(u < S(eps))) return u * u / S(2) + S(eps * eps / 6.0);
  const S w = u + S(eps);
  return w * w * w / S(12.0 * eps);
}

/// x within +-limit, with rounded corners.
template <class S>
S calc_saturated(const S& x, double limit, double eps) {
  return x - calc_corner<S>(x - S(limit), eps) + calc_corner<S>(-x - S(limit), eps);
}

/// Increments of the stiffness along a staged spring: f(start, increment).
template <class F>
void for_each_increment(const SpringLaw& law, F&& f) {
  const double preloaded = law.preload > 0.0 ? law.preload / law.take_up : 0.0;
  for (size_t i = 0; i < law.stages.size(); ++i) {
    const double before = i > 0 ? law.stages[i - 1][1] : -preloaded;
    f(law.stages[i][0], law.stages[i][1] - before);
    if (i == 0 && preloaded > 0.0) f(law.stages[0][0] + law.take_up, -preloaded);
  }
}

template <class S>
LawTerms<S> calc_law(const SpringLaw& law, const LawInput<S>& in) {
  LawTerms<S> out;
  const S x = in.s - S(law.rest);
  const bool is_back = law.side < 0 || (law.side == 0 && x < S(0));
  const S travel = is_back ? S(-x) : x;
  S pull(0);
  bool is_first = law.side == 0;
  for_each_increment(law, [&](double start, double stiffness) {
    if (is_first) {  // no corner at the rest position
      pull += S(stiffness) * travel;
      out.energy += S(0.5 * stiffness) * travel * travel;
    } else {
      pull += S(stiffness) * calc_corner<S>(travel - S(start), law.corner);
      out.energy += S(stiffness) * calc_corner_integral<S>(travel - S(start), law.corner);
    }
    is_first = false;
  });
  out.force = is_back ? pull : S(-pull);
  return out;
}

template <class S>
LawTerms<S> calc_law(const ConstantLaw& law, const LawInput<S>& in) {
  LawTerms<S> out;
  out.force = S(law.force);
  out.energy = -S(law.force) * (in.s - S(law.rest));
  return out;
}

/// Factor of an orifice at s: linear between the rows, constant beyond.
template <class S>
S find_orifice(const std::vector<TableRow>& rows, const S& s) {
  if (rows.empty()) return S(1);
  if (!(s > S(rows.front()[0]))) return S(rows.front()[1]);
  for (size_t i = 1; i < rows.size(); ++i) {
    const TableRow &a = rows[i - 1], &b = rows[i];
    if (s < S(b[0])) return S(a[1]) + S((b[1] - a[1]) / (b[0] - a[0])) * (s - S(a[0]));
  }
  return S(rows.back()[1]);
}

template <class S>
LawTerms<S> calc_law(const DamperLaw& law, const LawInput<S>& in) {
  using std::sqrt;
  LawTerms<S> out;
  const bool is_back = in.v < S(0);
  const S speed = is_back ? S(-in.v) : in.v;
  const double linear = is_back ? law.linear_back : law.linear;
  const double quadratic = is_back ? law.quadratic_back : law.quadratic;
  S force = -(S(linear) + S(quadratic) * speed) * in.v * find_orifice<S>(law.orifice, in.s);
  if (law.limit < kUnlimited) {
    const S ratio = force / S(law.limit);
    force = force / sqrt(S(1) + ratio * ratio);
  }
  out.force = force;
  out.dissipation = -force * in.v;
  return out;
}

template <class S>
LawTerms<S> calc_law(const EddyLaw& law, const LawInput<S>& in) {
  LawTerms<S> out;
  const S ratio = in.v / S(law.peak_rate);
  out.force = S(-law.slope) * in.v / (S(1) + ratio * ratio);
  out.dissipation = -out.force * in.v;
  return out;
}

/// The numbers of a bristle, with those that follow from the levels.
struct Bristle {
  double stiffness, damping, relaxation, floor;
};
inline Bristle find_bristle(const BrakeLaw& law) {
  constexpr double kRelaxes = 1e-3, kDamps = 0.75e-3;  // [s]; as in the contact friction of a ring
  constexpr double kFloor = 0.1;                       // of the larger level; a guard only
  const double larger = std::max(law.forward, law.back);
  const double k = law.bristle_stiffness > 0.0 ? law.bristle_stiffness : larger / law.presliding;
  return {k, law.bristle_damping > 0.0 ? law.bristle_damping : kDamps * k,
          law.bristle_relaxation > 0.0 ? law.bristle_relaxation : kRelaxes * k,
          law.floor > 0.0 ? law.floor : kFloor * larger};
}

/// -L v/sqrt(v^2 + v_s^2); L goes from one level to the other in the same way. Creeps under load.
template <class S>
LawTerms<S> calc_regularised_brake(const BrakeLaw& law, const LawInput<S>& in) {
  using std::sqrt;
  LawTerms<S> out;
  const S share = in.v / sqrt(in.v * in.v + S(law.friction_speed * law.friction_speed));
  const S level =
      S(law.engagement) * in.engagement *
          (S(0.5 * (law.forward + law.back)) + S(0.5 * (law.forward - law.back)) * share) +
      S(law.load_share) * in.load;
  out.force = -in.health * level * share;
  out.dissipation = -out.force * in.v;
  return out;
}

/// Elasto-plastic bristle with two levels: the sign of the bristle selects the level, not that of
/// the rate, so that z' is continuous through a reversal. chi bounds the decay rate while sliding
/// and leaves the steady force as it is. Below a tenth of engagement the brake is open and the rest
/// of the bristle relaxes.
template <class S>
LawTerms<S> calc_law(const BrakeLaw& law, const LawInput<S>& in) {
  using std::cos;
  using std::sqrt;
  if (!law.has_bristle()) return calc_regularised_brake(law, in);
  constexpr double kOpen = 0.1;
  const Bristle bristle = find_bristle(law);
  const S k = S(bristle.stiffness), eta = S(bristle.relaxation), F = k * in.z;
  const S size = F < S(0) ? S(-F) : F;
  LawTerms<S> out;
  out.energy = F * in.z / S(2);
  const S engagement = S(law.engagement) * in.engagement * in.health;
  if (engagement < S(kOpen)) {
    // Fades out below the floor: without that, z' would jump at z = 0 for as long as v is not 0.
    const S share = std::min<S>(S(1), size / S(bristle.floor));
    const bool unloads = F * in.v < S(0);  // until then it still pulls
    if (unloads) out.force = -F * share * share;
    out.z_rate = (unloads ? in.v * share * share : S(0)) - share * F / eta;
    out.dissipation = share * F * F / eta;
    return out;
  }
  const S speed = in.v < S(0) ? S(-in.v) : in.v;
  const S level = engagement * S(in.z < S(0) ? law.back : law.forward) +
                  in.health * S(law.load_share) * in.load;
  // Plastic share: half-cosine between 0.9 and 1 of the level.
  S alpha = S(0);
  if (F * in.v > S(0) && size > S(0.9) * level) {
    const S u = size < level ? (size / level - S(0.9)) / S(0.1) : S(1);
    alpha = (S(1) - cos(S(static_cast<double>(EIGEN_PI)) * u)) / S(2);
  }
  const S chi = S(1) - alpha * (S(1) - S(1) / (S(1) + speed / S(law.rate_cap)));
  S slip = alpha * speed / std::max<S>(level, S(bristle.floor));
  if (size > level) slip += (size - level) / (eta * size);
  out.z_rate = chi * (in.v - slip * F);
  // Damping while it sticks, its force held below a tenth of the level.
  const S cap = S(0.1) * level, c = S(bristle.damping), cv = c * in.v;
  const S drag = cap > S(0) ? c * (S(1) - alpha) * cap / sqrt(cap * cap + cv * cv) : S(0);
  out.force = -(F + drag * in.v);
  out.dissipation = F * (in.v - out.z_rate) + drag * in.v * in.v;
  return out;
}

template <class S>
LawTerms<S> calc_law(const MotorLaw& law, const LawInput<S>& in) {
  LawTerms<S> out;
  S wanted(0);
  if (law.by_current) {
    if (!(in.time < S(0))) wanted = law.commanded ? in.command : S(law.current);
  } else {
    S voltage = in.time < S(0) ? S(0) : law.commanded ? in.command : S(law.voltage);
    voltage = std::min<S>(std::max<S>(voltage, S(-law.voltage_limit)), S(law.voltage_limit));
    wanted = (voltage - S(law.constant) * in.v) / S(law.resistance);
  }
  const S current = calc_saturated<S>(wanted, law.current_limit, law.corner);
  out.force = S(law.constant) * current;
  out.work = out.force * in.v;
  out.saturation = (current < S(0) ? S(-current) : current) / S(law.current_limit);
  return out;
}

/// Drives to the target with a braking profile. No memory: nothing winds up at an obstacle.
template <class S>
LawTerms<S> calc_law(const DriveLaw& law, const LawInput<S>& in) {
  using std::sqrt;
  LawTerms<S> out;
  if (in.time < S(0)) return out;  // off
  const S e = (law.commanded ? in.command : S(law.target)) - in.s;
  const S distance = e < S(0) ? S(-e) : e;
  const S starting = S(law.acceleration) * std::max<S>(in.time, S(0));
  const S most = std::min<S>(S(law.speed), starting);
  S want = e * sqrt(S(2.0 * law.deceleration) / (distance + S(law.approach)));
  want = std::min<S>(std::max<S>(want, S(-most)), most);
  out.force = calc_saturated<S>(S(law.gain) * (want - in.v), law.limit, law.corner);
  out.work = out.force * in.v;
  out.saturation = (out.force < S(0) ? S(-out.force) : out.force) / S(law.limit);
  return out;
}

/// Force of a one-sided stop on its own depth, never negative.
template <class S>
S calc_one_stop(double stiffness, double damping, double toe, const S& depth, const S& depth_rate,
                S& energy, S& dissipation) {
  if (!(depth > S(0))) return S(0);
  const Elastic<S> elastic = calc_toe_spring<S>(depth, S(stiffness), S(toe));
  const S force = calc_damped_force<S>(elastic.force, S(damping), depth_rate);
  energy += elastic.energy;
  dissipation += (force - elastic.force) * depth_rate;
  return force;
}

template <class S>
LawTerms<S> calc_law(const StopLaw& law, const LawInput<S>& in) {
  LawTerms<S> out;
  const auto stop = [&](const S& depth, const S& rate) {
    return calc_one_stop<S>(law.stiffness, law.damping, law.toe, depth, rate, out.energy,
                            out.dissipation);
  };
  out.force = stop(S(law.lower) - in.s, -in.v) - stop(in.s - S(law.upper), in.v);
  return out;
}

/// Share of a force that a table has at each rate, linear between the rates. Beyond the last one
/// the force is held, or it grows in proportion to the rate: it stays one that dissipates.
template <class S>
S find_viscous(const TableLaw& law, const S& x, const S& v) {
  const std::vector<double>& rates = law.rates;
  const auto at = [&](size_t j) { return law.viscous[j].template at<S>(x, false).value; };
  const auto beyond = [&](size_t j) {
    const bool is_held = law.outside_rate == Outside::kHold || rates[j] == 0.0;
    return is_held ? at(j) : S(at(j) * (v / S(rates[j])));
  };
  if (!(v > S(rates.front()))) return beyond(0);
  if (!(v < S(rates.back()))) return beyond(rates.size() - 1);
  size_t j = 1;
  while (!(v < S(rates[j]))) ++j;
  const S share = (v - S(rates[j - 1])) / S(rates[j] - rates[j - 1]);
  return (S(1) - share) * at(j - 1) + share * at(j);
}

template <class S>
LawTerms<S> calc_law(const TableLaw& law, const LawInput<S>& in) {
  LawTerms<S> out;
  const S x = in.s - S(law.rest);
  const bool extends = law.outside != Outside::kHold;
  const auto elastic = law.elastic.at<S>(x, extends);
  const S slack(std::clamp(0.0, law.elastic.front(), law.elastic.back()));
  const S factor(law.factor);
  out.force = factor * elastic.value;
  out.energy = -factor * (elastic.integral - law.elastic.at<S>(slack, extends).integral);
  if (law.outside == Outside::kRefuse &&
      (x < S(law.elastic.front()) || x > S(law.elastic.back()))) {
    out.outside = StatusCode::kTravelOutsideTable;
  }
  if (law.rates.size() == 1) return out;
  const S viscous = factor * find_viscous<S>(law, x, in.v);
  out.force += viscous;
  out.dissipation = -viscous * in.v;
  if (law.outside_rate == Outside::kRefuse &&
      (in.v < S(law.rates.front()) || in.v > S(law.rates.back()))) {
    out.outside = StatusCode::kRateOutsideTable;
  }
  return out;
}

}  // namespace dockloop
