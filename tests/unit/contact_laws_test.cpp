// Force laws of a contact, in one dimension.
// 1. stored elastic forces, energies and restitutions; force is the derivative of the energy;
// 2. restitution of single impacts is exact, from soft to 23 t on one pair (barrier included);
// 3. friction: the regularised law creeps as its formula says, the bristle sticks and stops.
#include <gtest/gtest.h>

#include <cmath>

#include "contact/laws.hpp"
#include "unit/contact_test_support.hpp"
#include "unit/test_integrator.hpp"

namespace dockloop {
namespace {

constexpr double kPi = 3.14159265358979323846;

TEST(ContactLaws, StoredForcesAndEnergiesAreMet) {
  const nlohmann::json data = read_contact_data("contact_pairs.json");
  Worst worst;
  int n = 0;
  for (const auto& j : data["elastic_law"]) {
    const Elastic<double> e = calc_contact_spring<double>(j["depth"], j["k"], j["toe"], j["core"]);
    worst.add(e.force / j["force"].get<double>() - 1, n);
    worst.add(e.energy / j["energy"].get<double>() - 1, n++);
  }
  for (const auto& j : data["restitution"]) {
    worst.add(find_restitution(j["c"]) - j["e"].get<double>(), n++);
  }
  EXPECT_EQ(n, 16);
  EXPECT_WORST_BELOW(worst, 1e-13);  // measured 1.1e-14
}

TEST(ContactLaws, ForceIsTheDerivativeOfTheEnergy) {
  const long double k = 2e6L, toe = 5e-5L, rs = 0.022L, h = 1e-8L;
  Worst worst;
  for (int i = 1; i < 210; ++i) {
    const long double d = 1e-4L * static_cast<long double>(i) + 3e-6L;
    const auto U = [&](long double x) { return calc_contact_spring<long double>(x, k, toe, rs); };
    const long double slope = (U(d + h).energy - U(d - h).energy) / (2 * h);
    worst.add(static_cast<double>(slope / U(d).force - 1), i);
  }
  EXPECT_WORST_BELOW(worst, 1e-9);  // measured 9.4e-11
}

TEST(ContactLaws, DampedForceNeverPullsAndNeverGainsEnergy) {
  for (const double rate : {-2.0, -0.3, -0.1, 0.0, 0.2, 3.0}) {
    const double force = calc_damped_force<double>(100.0, 4.0, rate);
    EXPECT_GE(force, 0.0);
    EXPECT_GE((force - 100.0) * rate, 0.0);
  }
}

TEST(ContactLaws, DampingForARestitutionIsTheInverseOfRestitution) {
  // Wanted e and exact c = lambda v of the root, five digits.
  EXPECT_NEAR(find_damping_for_restitution(0.9, 1.0), 0.16648, 5e-6);
  EXPECT_NEAR(find_damping_for_restitution(0.5, 1.0), 1.43275, 5e-6);
  EXPECT_NEAR(find_damping_for_restitution(0.1, 1.0), 9.99816, 5e-6);
  EXPECT_NEAR(find_damping_for_restitution(0.01, 1.0), 100.0, 5e-4);
  EXPECT_EQ(find_damping_for_restitution(1.0, 0.1), 0.0);
  Worst worst;
  for (int i = 1; i <= 199; ++i) {
    const double e = i / 200.0, v = 0.07;
    worst.add(find_restitution(v * find_damping_for_restitution(e, v)) - e, i);
  }
  EXPECT_WORST_BELOW(worst, 7e-14);  // measured 7.2e-15
  EXPECT_THROW(find_damping_for_restitution(0.0, 0.1), ModelError);
  EXPECT_THROW(find_damping_for_restitution(1.1, 0.1), ModelError);
  EXPECT_THROW(find_damping_for_restitution(0.5, 0.0), ModelError);
}

TEST(ContactLaws, RestitutionSeriesMeetsTheRootWithoutAStep) {
  const double below = find_restitution(1e-3 * (1 - 1e-9)), above = find_restitution(1e-3);
  EXPECT_NEAR(below - above, 2.0 / 3 * 1e-12, scaled_tolerance(3e-13));  // measured 2.9e-14
}

struct Impact {
  double restitution, depth, audit;
};

/// Mass on one pair, one bounce. State: depth, speed into the surface, dissipated energy.
Impact find_impact(double mass, double k, double speed, double tolerance) {
  const double toe = 5e-5, rs = 0.022, lambda = 4.0;
  std::vector<double> y{-1e-4, speed, 0.0};
  Impact impact{0, 0, 0};
  const double energy = mass * speed * speed / 2;
  const auto rhs = [&](double, const double* s, double* s_dot) {
    if (s[0] >= 0.98 * rs) return false;
    const double el = calc_contact_spring<double>(s[0], k, toe, rs).force;
    const double force = calc_damped_force<double>(el, lambda, s[1]);
    s_dot[0] = s[1];
    s_dot[1] = -force / mass;
    s_dot[2] = (force - el) * s[1];
    return true;
  };
  const auto accepted = [&](double, double* s) {
    const double U = calc_contact_spring<double>(s[0], k, toe, rs).energy;
    impact.depth = std::max(impact.depth, s[0]);
    impact.audit =
        std::max(impact.audit, std::abs(mass * s[1] * s[1] / 2 + U + s[2] - energy) / energy);
    return s[0] > -2e-4;
  };
  integrate_dormand_prince(rhs, 0.0, 10.0, y, tolerance, 1e-3 * tolerance, 1e-5, accepted);
  impact.restitution = -y[1] / speed;
  return impact;
}

TEST(ContactLaws, ImpactHasTheExactRestitution) {
  Worst worst, audit;
  int i = 0;
  for (const auto& [v, e] : {std::pair(0.05, 0.8821899862473064),
                             {0.10, 0.7885391259070651},
                             {1.0, 0.2412785579360691}}) {
    const Impact impact = find_impact(20.0, 2e6, v, 1e-12);
    worst.add(impact.restitution - e, i);
    audit.add(impact.audit, i++);
  }
  EXPECT_WORST_BELOW(worst, 4e-10);  // measured 3.7e-11
  EXPECT_WORST_BELOW(audit, 8e-10);  // measured 8.0e-11
}

TEST(ContactLaws, BarrierStopsTwentyThreeTonnesOnOnePair) {
  const Impact soft = find_impact(23300.0, 2e6, 1.0, 1e-11),
               stiff = find_impact(23300.0, 2e8, 1.0, 1e-11);
  EXPECT_NEAR(soft.depth, 21.40e-3, 5e-6);
  EXPECT_NEAR(stiff.depth, 5.93e-3, 5e-6);
  EXPECT_NEAR(soft.restitution, 0.24127855794, scaled_tolerance(3e-10));  // measured 2.9e-11
  EXPECT_NEAR(stiff.restitution, 0.24127855794, scaled_tolerance(3e-10));
  EXPECT_LT(soft.audit, scaled_tolerance(4e-9));   // measured 3.9e-10
  EXPECT_LT(stiff.audit, scaled_tolerance(4e-9));  // measured 2.1e-10
}

/// 40 kg pressed on a plane by 500 N, mu = 0.1, pulled by `load`(t): position x(end) in m.
/// State: x, v, bristle z, dissipated energy. Checks power and energy balance on the way.
template <class Load>
double find_slide(ContactLaw law, double v0, double end, Load load) {
  const double mass = 40.0, normal = 500.0;
  std::vector<double> y{0.0, v0, 0.0, 0.0, 0.0};
  const Vec3<double> n = Vec3<double>::UnitZ();
  const auto friction = [&](const double* s) {
    const Vec3<double> v(s[1], 0, 0);
    return law.friction_model == 2
               ? calc_bristle_friction<double>(law, normal, v, n, Vec3<double>(s[2], 0, 0))
               : calc_regularised_friction<double>(law, normal, v);
  };
  const auto rhs = [&](double t, const double* s, double* s_dot) {
    const Friction<double> f = friction(s);
    EXPECT_GE(f.power, 0.0);
    const double pull = load(t);
    s_dot[0] = s[1];
    s_dot[1] = (f.force[0] + pull) / mass;
    s_dot[2] = f.bristle_rate[0];
    s_dot[3] = f.power;
    s_dot[4] = pull * s[1];
    return true;
  };
  const auto accepted = [](double, double*) { return true; };
  const TestIntegration run =
      integrate_dormand_prince(rhs, 0.0, end, y, 1e-7, 1e-9, 1e-4, accepted);
  EXPECT_TRUE(run.ok);
  const double kinetic = mass * (y[1] * y[1] - v0 * v0) / 2;
  const double stored = law.friction_model == 2 ? law.bristle_stiffness * y[2] * y[2] / 2 : 0.0;
  EXPECT_NEAR(kinetic + stored + y[3] - y[4], 0.0, scaled_tolerance(7e-7));  // measured 6.8e-8 J
  return y[0];
}

TEST(ContactLaws, SlidingMassStopsWhereFrictionSays) {
  // Exact Coulomb friction: v^2/(2 mu g') = 4.000 mm; the bristle adds its spring-back.
  const auto free = [](double) { return 0.0; };
  ContactLaw law;
  EXPECT_NEAR(find_slide(law, 0.1, 2.0, free), 4.002e-3, 1e-6);
  law.friction_speed = 1e-2;
  EXPECT_NEAR(find_slide(law, 0.1, 2.0, free), 4.140e-3, 1e-6);
  law.friction_model = 2;
  EXPECT_NEAR(find_slide(law, 0.1, 2.0, free), 3.853e-3, 2e-6);
}

TEST(ContactLaws, RegularisedFrictionCreepsAsItsFormulaSays) {
  ContactLaw law;
  law.friction_speed = 1e-2;
  const double creep = find_slide(law, 0.0, 10.0, [](double) { return 25.0; });
  EXPECT_NEAR(creep, 57.7e-3, 1e-4);
  EXPECT_NEAR(creep, 10 * 1e-2 * 25 / std::sqrt(50.0 * 50 - 25 * 25), 1e-4);
  EXPECT_NEAR(
      find_slide(law, 0.0, 10.0, [](double t) { return 25 + 15 * std::sin(2 * kPi * 5 * t); }),
      63.9e-3, 1e-3);
}

TEST(ContactLaws, BristleSticksUnderConstantAndVibratingLoad) {
  ContactLaw law;
  law.friction_model = 2;
  const double back = find_slide(law, 0.0, 12.0, [](double t) { return t < 10 ? 25.0 : 0.0; });
  EXPECT_NEAR(back, 0.0, 1e-6);
  // Onset: the sudden load overshoots to the limit once. Then 45 periods of vibration add nothing.
  const auto shaking = [](double t) { return 25 + 15 * std::sin(2 * kPi * 5 * t); };
  const double early = find_slide(law, 0.0, 1.0, shaking),
               late = find_slide(law, 0.0, 10.0, shaking);
  EXPECT_NEAR(late - 25.0 / law.bristle_stiffness, 0.096e-3, 1e-5);
  EXPECT_NEAR(late - early, 0.0, 1e-6);
}

TEST(ContactLaws, BristleDissipatesForEveryStateAndNormalForce) {
  TestRandom random(5);
  ContactLaw law;
  law.friction_model = 2;
  Worst balance;
  for (int i = 0; i < 20000; ++i) {
    const Vec3<double> n = random.vector(1).normalized();
    const Vec3<double> any = random.vector(0.3), z = random.vector(1e-3);
    const Vec3<double> v_t = any - n * n.dot(any);
    const double normal = i % 5 ? random.uniform(0, 3000) : 0.0;
    const Friction<double> f = calc_bristle_friction<double>(law, normal, v_t, n, z);
    EXPECT_GE(f.power, 0.0);
    // Work on the bodies + stored + dissipated = 0.
    const double stored = law.bristle_stiffness * z.dot(f.bristle_rate);
    balance.add((f.force.dot(v_t) + stored + f.power) / (1 + f.power), i);
    EXPECT_NEAR(f.force.dot(n), 0.0, 1e-10);
  }
  EXPECT_WORST_BELOW(balance, 1.3e-13);  // measured 1.3e-14
}

TEST(ContactLaws, BristleIsContinuousWhereItBeginsToUnload) {
  TestRandom random(6);
  ContactLaw law;
  law.friction_model = 2;
  const double normal = 500.0, limit = law.friction_coefficient * normal;
  const Vec3<double> n = Vec3<double>::UnitZ();
  for (int i = 0; i < 200; ++i) {
    const double deflection = random.uniform(0.9, 1.3) * limit / law.bristle_stiffness;
    const Vec3<double> z(deflection, 0, 0);
    const double speed = random.uniform(1e-3, 0.3);
    const auto find = [&](double along) {
      return calc_bristle_friction<double>(law, normal, Vec3<double>(along, speed, 0), n, z);
    };
    const Friction<double> loading = find(1e-12), unloading = find(-1e-12);
    EXPECT_LT((loading.force - unloading.force).norm(), 1e-8);
    EXPECT_LT((loading.bristle_rate - unloading.bristle_rate).norm(), 1e-11);
  }
}

}  // namespace
}  // namespace dockloop
