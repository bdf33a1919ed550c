// Impacts of free bodies through the whole contact chain.
// 1. petal edge on crossing petal edge, frictionless: energy and momentum balance, and the
//    velocities afterwards agree with MuJoCo (stored data, see tests/data/contact_mujoco.json);
// 2. ring on ring with damping and both friction laws: energy balances to the tolerance of the
//    integrator, linear and angular momentum to rounding.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "unit/contact_test_support.hpp"
#include "unit/test_integrator.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

/// Two free bodies; the interface frame of each stands at its mass centre plus `offset`, unturned.
struct Bodies {
  std::array<double, 2> mass;
  std::array<V, 2> inertia, offset;  // principal moments [kg m2]; body axes [m]
};

// State per body: position, attitude, velocity (axes of N), angular velocity (body axes).
constexpr int kBody = 13, kDissipated = 2 * kBody, kBristles = kDissipated + 2;

struct Frame {
  Mat3<double> R;
  V p, v, w, origin, origin_velocity;  // axes of N; the origin is that of the interface
};

Frame find_frame(const Bodies& bodies, const double* y, int i) {
  const double* s = y + kBody * i;
  Frame f;
  f.p = V(s[0], s[1], s[2]);
  f.R = quat_to_matrix<double>({s[3], s[4], s[5], s[6]});
  f.v = V(s[7], s[8], s[9]);
  f.w = f.R * V(s[10], s[11], s[12]);
  f.origin = f.p + f.R * bodies.offset[i];
  f.origin_velocity = f.v + f.w.cross(V(f.R * bodies.offset[i]));
  return f;
}

RelativeMotion<double> find_relative(const Frame& a, const Frame& b) {
  RelativeMotion<double> x;
  const V d = b.origin - a.origin;
  x.R = a.R.transpose() * b.R;
  x.p = a.R.transpose() * d;
  x.w = a.R.transpose() * (b.w - a.w);
  x.v = a.R.transpose() * (b.origin_velocity - a.origin_velocity - a.w.cross(d));
  return x;
}

struct Outcome {
  TestIntegration run;
  double energy_error = 0, momentum_error = 0, depth_ratio = 0, final_gap = 0, friction = 0;
  V velocity[2], spin[2];  // axes of N; body axes
};

void put_body(std::vector<double>& y, int i, const V& p, const V& rotation_vector, const V& v,
              const V& w) {
  const Vec4<double> q = quat_exp<double>(rotation_vector);
  const double s[kBody] = {p[0], p[1], p[2], q[0], q[1], q[2], q[3],
                           v[0], v[1], v[2], w[0], w[1], w[2]};
  std::copy(s, s + kBody, y.begin() + kBody * i);
}

/// Integrate to `end` or, if `until_apart`, until a contact has ended; audit on the way.
Outcome run_impact(const ContactModel& model, const Bodies& bodies, std::vector<double> y,
                   double end, double tolerance, bool until_apart) {
  y.resize(kBristles + bristle_state_count(model), 0.0);
  ContactWorkspace<double> work(model);
  ContactMemory memory;
  ContactResult<double> contact;
  Outcome out;
  const auto rhs = [&](double, const double* s, double* s_dot) {
    const Frame f[2] = {find_frame(bodies, s, 0), find_frame(bodies, s, 1)};
    const Status status = calc_contact<double>(model, memory, find_relative(f[0], f[1]),
                                               s + kBristles, s_dot + kBristles, work, contact);
    if (!status.ok()) return false;
    const V force = f[0].R * contact.on_passive.f, moment = f[0].R * contact.on_passive.t;
    for (int i = 0; i < 2; ++i) {
      const double* b = s + kBody * i;
      double* d = s_dot + kBody * i;
      const double sign = i == 0 ? -1 : 1;
      const V torque =
          f[i].R.transpose() * V(sign * (moment + V(f[0].origin - f[i].p).cross(force)));
      const V w(b[10], b[11], b[12]), h = bodies.inertia[i].cwiseProduct(w);
      const Vec4<double> q_dot = quat_rate<double>({b[3], b[4], b[5], b[6]}, w);
      const V v_dot = sign * force / bodies.mass[i];
      const V w_dot = (torque - w.cross(h)).cwiseQuotient(bodies.inertia[i]);
      for (int k = 0; k < 3; ++k) {
        d[k] = f[i].v[k];
        d[7 + k] = v_dot[k];
        d[10 + k] = w_dot[k];
      }
      for (int k = 0; k < 4; ++k) d[3 + k] = q_dot[k];
    }
    s_dot[kDissipated] = contact.contact_power;
    s_dot[kDissipated + 1] = contact.friction_power;
    return true;
  };
  std::vector<double> scratch(y.size());
  const auto audit = [&](const double* s, double& energy, Vec6<double>& momentum) {
    rhs(0, s, scratch.data());
    energy = contact.energy + s[kDissipated] + s[kDissipated + 1];
    momentum.setZero();
    for (int i = 0; i < 2; ++i) {
      const Frame f = find_frame(bodies, s, i);
      const V w = f.R.transpose() * f.w, h = bodies.inertia[i].cwiseProduct(w);
      energy += (bodies.mass[i] * f.v.squaredNorm() + h.dot(w)) / 2;
      const V p = bodies.mass[i] * f.v;
      momentum.head<3>() += p;
      momentum.tail<3>() += f.p.cross(p) + f.R * h;
    }
  };
  double energy0 = 0;
  Vec6<double> momentum0;
  audit(y.data(), energy0, momentum0);
  bool touched = false;
  const auto accepted = [&](double, double* s) {
    const Frame f[2] = {find_frame(bodies, s, 0), find_frame(bodies, s, 1)};
    if (!rhs(0, s, scratch.data())) return false;
    s[kDissipated + 1] +=
        update_contact_memory(model, find_relative(f[0], f[1]),
                              bristle_state_count(model) ? s + kBristles : nullptr, work, memory);
    double energy = 0;
    Vec6<double> momentum;
    audit(s, energy, momentum);
    out.energy_error = std::max(out.energy_error, std::abs(energy - energy0));
    out.momentum_error = std::max(out.momentum_error, (momentum - momentum0).norm());
    out.depth_ratio = std::max(out.depth_ratio, contact.depth_ratio);
    out.final_gap = contact.gap;
    touched |= contact.active_count > 0;
    return !(until_apart && touched && contact.active_count == 0);
  };
  out.run = integrate_dormand_prince(rhs, 0.0, end, y, tolerance, 1e-3 * tolerance, 1e-4, accepted);
  out.friction = y[kDissipated + 1];
  for (int i = 0; i < 2; ++i) {
    const double* b = y.data() + kBody * i;
    out.velocity[i] = V(b[7], b[8], b[9]);
    out.spin[i] = V(b[10], b[11], b[12]);
  }
  return out;
}

TEST(ContactImpact, CrossingPetalEdgesAgreeWithMuJoCo) {
  const nlohmann::json j = read_contact_data("contact_mujoco.json");
  ContactLaw law;
  law.damping = 0.0;
  law.friction_coefficient = 0.0;
  law.toe = 1e-9;             // MuJoCo's force is linear in depth from the start
  law.regularisation = 1e-8;  // and its distance not regularised
  law.stiffness = j["stiffness"].get<double>();
  GuideRing ring = make_test_ring();
  ring.node_count = 0;  // petals only: the ring faces are moved away
  ring.core_inner_radius = 5.0;
  ring.core_outer_radius = 5.1;
  const ContactModel model = make_ring_contact(ring, ring, law);
  ContactWorkspace<double> work(model);
  int i = 0;
  for (const auto& c : j["cases"]) {
    Bodies bodies;
    std::vector<double> y(kBristles);
    for (int b = 0; b < 2; ++b) {
      const auto& s = c["bodies"][b];
      bodies.mass[b] = s["mass"].get<double>();
      bodies.inertia[b] = to_vec3(s["inertia"]);
      bodies.offset[b] = to_vec3(s["interface"]);
      put_body(y, b, to_vec3(s["position"]), to_vec3(s["rotation_vector"]), to_vec3(s["velocity"]),
               to_vec3(s["angular_velocity"]));
    }
    const Outcome out = run_impact(model, bodies, y, 1.0, 1e-10, true);
    ASSERT_TRUE(out.run.ok);
    // Measured: velocities 3.8e-5, angular velocities (times 0.6 m) 4.7e-5 of the closing speed.
    const double closing = c["closing_speed"].get<double>();
    for (int b = 0; b < 2; ++b) {
      const double dv = (out.velocity[b] - to_vec3(c["after"][b]["velocity"])).norm();
      const double dw = (out.spin[b] - to_vec3(c["after"][b]["angular_velocity"])).norm();
      EXPECT_LE(dv / closing, scaled_tolerance(4e-4)) << i << " body " << b;
      EXPECT_LE(dw * 0.6 / closing, scaled_tolerance(5e-4)) << i << " body " << b;
    }
    EXPECT_LE(std::abs(out.depth_ratio * 0.024 / c["depth"].get<double>() - 1),
              scaled_tolerance(6e-3));                         // measured 5.5e-4
    EXPECT_LE(out.energy_error, scaled_tolerance(3.5e-8));     // measured 3.5e-9 J
    EXPECT_LE(out.momentum_error, scaled_tolerance(1.5e-13));  // measured 1.5e-14
    ++i;
  }
  EXPECT_GE(i, 3);
}

class ContactImpactFriction : public testing::TestWithParam<int> {};

TEST_P(ContactImpactFriction, RingOnRingBalancesEnergyAndMomentum) {
  ContactLaw law;
  law.friction_model = GetParam();
  law.friction_coefficient = 0.3;
  const ContactModel model = make_test_contact(law);
  ContactWorkspace<double> work(model);
  const Bodies bodies{
      {40.0, 400.0}, {V(13, 7, 7), V(200, 300, 320)}, {V(0.01, 0, 0), V(-0.8, 0.02, 0)}};
  TestRandom random(31);
  for (int i = 0; i < 4; ++i) {
    const RelativeMotion<double> start =
        make_touching_motion(model, work, random, -1e-3, 0.08, 0.04);
    std::vector<double> y(kBristles);
    put_body(y, 0, -bodies.offset[0], V::Zero(), V(0.15, 0.02, -0.03), V(0.05, 0.02, -0.02));
    const V attitude = quat_log<double>(quat_from_matrix<double>(start.R));
    put_body(y, 1, start.p - start.R * bodies.offset[1], attitude, V(-0.05, 0, 0.01), V::Zero());
    const Outcome out = run_impact(model, bodies, y, 0.4, 1e-8, false);
    ASSERT_TRUE(out.run.ok) << i;
    EXPECT_GT(out.depth_ratio, 0.0);
    EXPECT_GT(out.friction, 1e-4);
    // Measured 1.8e-7 of about 1 J, 2.8e-12 of about 20 N s.
    EXPECT_LE(out.energy_error, scaled_tolerance(1.8e-6)) << i;
    EXPECT_LE(out.momentum_error, scaled_tolerance(2.8e-11)) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(BothLaws, ContactImpactFriction, testing::Values(1, 2));

}  // namespace
}  // namespace dockloop
