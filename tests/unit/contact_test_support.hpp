// Shared by the contact and latch tests: stored vectors, random states, worst-residual
// book-keeping.
//
// Every tolerance is ten times the worst residual measured with g++ 12.2, -O2, x86-64 (the measured
// figure stands next to it). The environment variable DOCK_TOL_SCALE scales all of them; 0 makes
// every test print its true residual.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "contact/contact_model.hpp"
#include "math/rotation.hpp"
#include "math/scalar.hpp"

namespace dockloop {

inline nlohmann::json read_contact_data(const std::string& name) {
  std::ifstream file(std::string(DOCKLOOP_TEST_DATA) + "/" + name);
  EXPECT_TRUE(file.good()) << name;
  return nlohmann::json::parse(file);
}

inline Vec3<double> to_vec3(const nlohmann::json& j) {
  return {j[0].get<double>(), j[1].get<double>(), j[2].get<double>()};
}

inline Plate<double> to_plate(const nlohmann::json& j) {
  return make_plate<double>({to_vec3(j[0]), to_vec3(j[1]), to_vec3(j[2]), to_vec3(j[3])});
}

/// The ring of the stored vectors, whatever the mechanisms of the project look like.
inline GuideRing make_test_ring() {
  GuideRing ring;
  ring.core_x = -0.010;
  ring.core_inner_radius = 0.617;
  ring.core_outer_radius = 0.647;
  ring.ring_rounding = 0.010;
  ring.node_count = 24;
  ring.node_radius = 0.632;
  ring.node_azimuth_offset = 6.5449846949787359e-2;  // pi/48
  ring.petal_count = 3;
  ring.petal_rounding = 0.012;
  ring.petal_base_x = -0.010;
  ring.petal_base_radius = 0.585;
  ring.petal_base_half_angle = 0.48869219055841229;  // 28 deg
  ring.petal_tip_x = 0.228;
  ring.petal_tip_distance = 0.415;
  ring.petal_tip_half_width = 0.050;
  return ring;
}

inline ContactModel make_test_contact(const ContactLaw& law = {}) {
  return make_ring_contact(make_test_ring(), make_test_ring(), law);
}

inline double scaled_tolerance(double tolerance) {
  static const char* scale = std::getenv("DOCK_TOL_SCALE");
  return scale ? tolerance * std::atof(scale) : tolerance;
}

/// Largest residual of a test and where it occurred.
struct Worst {
  double value = 0;
  int index = -1;
  void add(double residual, int i) {
    residual = std::isnan(residual) ? HUGE_VAL : std::abs(residual);
    if (residual > value) {
      value = residual;
      index = i;
    }
  }
};

#define EXPECT_WORST_BELOW(worst, tolerance) \
  EXPECT_LE((worst).value, scaled_tolerance(tolerance)) << "at index " << (worst).index

/// Local random numbers with a fixed seed.
struct TestRandom {
  std::mt19937_64 engine;
  explicit TestRandom(unsigned seed) : engine(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53;
  }
  Vec3<double> vector(double bound) {
    return {uniform(-bound, bound), uniform(-bound, bound), uniform(-bound, bound)};
  }
};

inline Mat3<double> rotation_of(const Vec3<double>& rotation_vector) {
  return quat_to_matrix<double>(quat_exp<double>(rotation_vector));
}

/// Generic state with the surfaces overlapping by about `depth`: random lateral offset, tilt and
/// roll, then the axial distance at which, coming from afar, the gap has fallen to -depth.
/// @param others  poses in G of the other bodies with active cores
inline RelativeMotion<double> make_touching_motion(const ContactModel& model,
                                                   ContactWorkspace<double>& work,
                                                   TestRandom& random, double depth,
                                                   double lateral = 0.2, double tilt = 0.12,
                                                   const std::vector<Pose<double>>& others = {}) {
  RelativeMotion<double> x;
  x.R = rotation_of(random.vector(tilt));
  x.w = random.vector(0.2);
  x.v = random.vector(0.1);
  x.p = random.vector(lateral);
  const auto excess = [&](double axial) {
    x.p[0] = axial;
    HardwareMotion<double> all = x;
    for (const Pose<double>& body : others) {
      RelativeMotion<double> seen;
      seen.R = body.R.transpose() * x.R;
      seen.p = body.R.transpose() * (x.p - body.p);
      all.others.push_back(seen);
    }
    return find_gap<double>(model, {}, all, work) + depth;
  };
  double high = 0.6, low = high;
  while (excess(low) > 0) {
    high = low;
    low -= 0.005;
  }
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (excess(middle) > 0 ? high : low) = middle;
  }
  x.p[0] = low;
  return x;
}

template <class S>
RelativeMotion<S> cast_motion(const RelativeMotion<double>& x) {
  return {x.R.cast<S>(), x.p.cast<S>(), x.w.cast<S>(), x.v.cast<S>()};
}

/// Power of the contact wrench in the relative motion [W]: force at the origin of G and moment.
template <class S>
S find_power(const Wrench<S>& on_passive, const RelativeMotion<S>& x) {
  return on_passive.f.dot(x.v - x.w.cross(x.p)) + on_passive.t.dot(x.w);
}

/// A core in the group of its own name.
inline NamedCore named(Core core, const std::string& law = "") {
  const std::string name = core.name;
  return {std::move(core), name, law, {}};
}

/// Contact at one pose, without friction states.
template <class S>
ContactResult<S> find_contact(const ContactModel& model, const RelativeMotion<S>& x,
                              const ContactMemory& memory = {}) {
  ContactWorkspace<S> work(model);
  ContactResult<S> result;
  EXPECT_TRUE(calc_contact<S>(model, memory, x, nullptr, nullptr, work, result).ok());
  return result;
}

/// Motion of P whose directions 0 to 2 move it and 3 to 5 turn it about the origin of G.
inline RelativeMotion<Derivative> make_directions(const RelativeMotion<double>& x) {
  using S = Derivative;
  RelativeMotion<S> motion = cast_motion<S>(x);
  const auto turn = [](const Vec3<S>& a) {
    const S w[3] = {S::variable(0.0, 3), S::variable(0.0, 4), S::variable(0.0, 5)};
    return Vec3<S>(a[0] + w[1] * a[2] - w[2] * a[1], a[1] + w[2] * a[0] - w[0] * a[2],
                   a[2] + w[0] * a[1] - w[1] * a[0]);
  };
  for (int j = 0; j < 3; ++j) motion.R.col(j) = turn(motion.R.col(j));
  motion.p = turn(motion.p);
  for (int j = 0; j < 3; ++j) motion.p[j] += S::variable(0.0, j);
  return motion;
}

/// Everything in a result as bytes, but the gap (with a list it may be a bound).
inline bool equals_in_bits(const ContactResult<double>& a, const ContactResult<double>& b) {
  const auto same = [](const Vec3<double>& x, const Vec3<double>& y) {
    return std::memcmp(x.data(), y.data(), 3 * sizeof(double)) == 0;
  };
  for (int i = 0; i < kMaxSurfaces; ++i) {
    if (!same(a.surface_force[i], b.surface_force[i])) return false;
  }
  return same(a.on_passive.f, b.on_passive.f) && same(a.on_passive.t, b.on_passive.t) &&
         a.energy == b.energy && a.contact_power == b.contact_power &&
         a.friction_power == b.friction_power && a.depth_ratio == b.depth_ratio &&
         a.active_count == b.active_count;
}

}  // namespace dockloop
