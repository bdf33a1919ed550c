// Closest points of cores.
// 1. stored vectors (an independent implementation) are met;
// 2. certificates of optimality: for a convex problem the point (p, q) is the minimiser if and only
//    if no feasible point is downhill, which for linear gradients is decided at the corners; plates
//    in SIMD lanes, with the same bits for every width;
// 3. segment on annulus against brute force (dense samples, golden section);
// 4. the gradient of sqrt(V) is the direction and sqrt(V) is 1-Lipschitz.
#include <gtest/gtest.h>

#include <cmath>

#include "unit/contact_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;

/// Smallest gradient . (corner - point) [m2] of V over the corners of both cores: >= 0 at a
/// minimum.
double find_certificate(const std::vector<V>& P, const std::vector<V>& Q, const V& cp, const V& cq,
                        const Closest<double>& c, double mu) {
  const V gp = 2 * (c.first - c.second) + 2 * mu * (c.first - cp);
  const V gq = 2 * (c.second - c.first) + 2 * mu * (c.second - cq);
  double over_p = 1e9, over_q = 1e9;
  for (const V& x : P) over_p = std::min(over_p, gp.dot(x - c.first));
  for (const V& x : Q) over_q = std::min(over_q, gq.dot(x - c.second));
  return std::min(over_p, over_q);
}

std::vector<V> corners(const Plate<double>& p) { return {p.corner.begin(), p.corner.end()}; }

/// Random convex plane quadrilateral like a petal, placed at random.
Plate<double> random_plate(TestRandom& random, double spread, double tilt) {
  const double a = random.uniform(0.05, 0.3), b = random.uniform(0.03, 0.2);
  const double h = random.uniform(0.1, 0.3), s = random.uniform(-0.05, 0.05);
  const Mat3<double> R = rotation_of(random.vector(tilt));
  const V o = random.vector(spread);
  return place_plate<double>(
      make_plate<double>({V(-h, -a, 0), V(-h, a, 0), V(h, b + s, 0), V(h, -b + s, 0)}), R, o);
}

TEST(ContactPrimitives, StoredPairsAreMet) {
  const nlohmann::json data = read_contact_data("contact_pairs.json");
  Worst value, point;
  int n = 0;
  const auto compare = [&](const nlohmann::json& j, const Closest<double>& c, const char* first) {
    value.add(std::sqrt(c.square) - j["value"].get<double>(), n);
    point.add((c.first - to_vec3(j[first])).norm(), n);
    point.add((c.second - to_vec3(j["q"])).norm(), n);
    if (j.contains("direction")) {
      point.add(((c.second - c.first) / std::sqrt(c.square) - to_vec3(j["direction"])).norm(), n);
    }
    ++n;
  };
  for (const auto& j : data["segment_segment"]) {
    const V p0 = to_vec3(j["p0"]), p1 = to_vec3(j["p1"]), q0 = to_vec3(j["q0"]);
    const V q1 = to_vec3(j["q1"]);
    compare(j,
            find_segment_segment<double>(p0, p1 - p0, (p0 + p1) / 2, q0, q1 - q0, (q0 + q1) / 2,
                                         j["mu"]),
            "p");
  }
  for (const auto& j : data["segment_annulus"]) {
    const V p0 = to_vec3(j["p0"]), p1 = to_vec3(j["p1"]);
    compare(j,
            find_segment_annulus<double>(
                p0, p1 - p0, {0, j["Ri"].get<double>(), j["Ro"].get<double>()}, j["mu"]),
            "p");
  }
  for (const auto& j : data["plate_plate"]) {
    const Plate<double> P = to_plate(j["P"]), Q = to_plate(j["Q"]);
    compare(j, find_plate_plate<double>(P, Q, j["mu"]), "p");
    compare(j, find_plates(plates::find_plate_functions(), P, Q, j["mu"]), "p");
  }
  for (const auto& j : data["point_plate"]) {
    compare(j, find_point_plate<double>(to_vec3(j["x"]), to_plate(j["P"])), "x");
  }
  for (const auto& j : data["point_annulus"]) {
    compare(j,
            find_point_annulus<double>(to_vec3(j["x"]),
                                       {0, j["Ri"].get<double>(), j["Ro"].get<double>()}),
            "x");
  }
  EXPECT_EQ(n, 74 + static_cast<int>(data["plate_plate"].size()));
  EXPECT_WORST_BELOW(value, 3e-15);  // measured 2.2e-16 m
  EXPECT_WORST_BELOW(point, 2e-13);  // measured 1.5e-14 m
}

TEST(ContactPrimitives, SegmentOnSegmentIsOptimalEvenIfParallel) {
  TestRandom random(1);
  Worst worst;
  const double mu = 1e-4;
  for (int i = 0; i < 10000; ++i) {
    const V p0 = random.vector(0.3), dp = random.vector(0.3), q0 = random.vector(0.3);
    V dq = random.vector(0.3);
    if (i % 3 == 0) dq = dp * random.uniform(-2, 2);
    if (i % 6 == 0) dq += random.vector(1e-5);
    const V cp = p0 + dp / 2, cq = q0 + dq / 2;
    const Closest<double> c = find_segment_segment<double>(p0, dp, cp, q0, dq, cq, mu);
    worst.add(std::min(0.0, find_certificate({p0, p0 + dp}, {q0, q0 + dq}, cp, cq, c, mu)), i);
  }
  EXPECT_WORST_BELOW(worst, 1.3e-15);  // measured 1.3e-16 m2
}

TEST(ContactPrimitives, PlateOnPlateIsOptimalForAllFeatures) {
  TestRandom random(2);
  Worst worst;
  const double mu = 1e-4;
  int interior[2][2] = {};  // face point of P, of Q inside its plate
  for (int i = 0; i < 22000; ++i) {
    // Every eleventh pair has parallel or nearly parallel faces.
    const Plate<double> P = random_plate(random, 0.0, i % 11 ? 3.0 : 0.0);
    const Plate<double> Q =
        random_plate(random, 0.3, i % 11 ? 3.0 : (i % 2 ? random.uniform(0, 1e-4) : 0.0));
    const Closest<double> c = find_plate_plate<double>(P, Q, mu);
    if (std::sqrt(c.square) < 0.002) continue;  // crossed cores: the depth limit excludes these
    worst.add(std::min(0.0, find_certificate(corners(P), corners(Q), P.centre, Q.centre, c, mu)),
              i);
    const auto inside = [](const Plate<double>& plate, const V& x) {
      for (int k = 0; k < 4; ++k) {
        if (plate.inward[k].dot(x - plate.corner[k]) < 1e-9) return 0;
      }
      return 1;
    };
    ++interior[inside(P, c.first)][inside(Q, c.second)];
    // The same in SIMD lanes, with the same bits for every width.
    const Closest<double> lanes = find_plates(plates::find_plate_functions(2), P, Q, mu);
    worst.add(
        std::min(0.0, find_certificate(corners(P), corners(Q), P.centre, Q.centre, lanes, mu)), i);
    for (const int widest : {4, 8}) {
      const Closest<double> same = find_plates(plates::find_plate_functions(widest), P, Q, mu);
      ASSERT_EQ(same.square, lanes.square) << i;
      ASSERT_EQ(same.first, lanes.first) << i;
      ASSERT_EQ(same.second, lanes.second) << i;
    }
  }
  EXPECT_WORST_BELOW(worst, 3e-12);  // measured 3.1e-13 m2
  for (int k = 0; k < 4; ++k) EXPECT_GT(interior[k / 2][k % 2], 50) << "feature kind " << k;
}

TEST(ContactPrimitives, SegmentOnAnnulusFindsTheLowestValley) {
  TestRandom random(3);
  Worst worst;
  const CaptureHardware hardware = make_capture_hardware(make_test_ring());
  const CaptureHardware opposite = make_passive_hardware(make_test_ring());
  const double mu = 1e-4;
  const Annulus<double> ring = hardware.ring;
  for (int i = 0; i < 4000; ++i) {
    const Plate<double>& petal = opposite.petals[i % 3];
    const int k = CaptureHardware::kSideEdge[i % 2];
    const Mat3<double> R =
        rotation_of(random.vector(0.17)) * rotation_of(V(random.uniform(-3, 3), 0, 0));
    const V p =
        V(random.uniform(-0.05, 0.35), random.uniform(-0.25, 0.25), random.uniform(-0.25, 0.25));
    const V a = R * petal.corner[k] + p, d = R * petal.edge[k];
    const Closest<double> c = find_segment_annulus<double>(a, d, ring, mu);
    const auto f = [&](double t) {
      const V x = a + t * d;
      const double r = std::hypot(x[1], x[2]);
      const double out = r - std::min(std::max(r, ring.inner), ring.outer);
      return std::pow(x[0] - ring.x, 2) + out * out + mu * d.squaredNorm() * std::pow(t - 0.5, 2);
    };
    // Dense samples, then golden section.
    double best = 0;
    for (int s = 0; s <= 2000; ++s) best = f(s / 2000.0) < f(best) ? s / 2000.0 : best;
    double low = std::max(0.0, best - 5e-4), high = std::min(1.0, best + 5e-4);
    const double golden = (std::sqrt(5.0) - 1) / 2;
    for (int s = 0; s < 60; ++s) {
      const double u = high - golden * (high - low), v = low + golden * (high - low);
      (f(u) < f(v) ? high : low) = f(u) < f(v) ? v : u;
    }
    const double lowest = std::min({f(best), f(low), f(high)});
    if (lowest > 0.01) continue;  // beyond 0.1 m a second valley may be lower
    worst.add(std::sqrt(c.square) - std::sqrt(lowest), i);
  }
  EXPECT_WORST_BELOW(worst, 2.5e-15);  // measured 2.5e-16 m
}

TEST(ContactPrimitives, DirectionIsTheGradientOfTheDistance) {
  TestRandom random(4);
  Worst gradient;
  const Extended mu = 1e-4L, h = 1e-7L;
  const auto wide = [](const Plate<double>& p) {
    std::array<Vec3<Extended>, 4> corner;
    for (int k = 0; k < 4; ++k) corner[k] = p.corner[k].cast<Extended>();
    return make_plate<Extended>(corner);
  };
  for (int i = 0; i < 1000; ++i) {
    const Plate<Extended> P = wide(random_plate(random, 0, 3)),
                          Q = wide(random_plate(random, 0.3, 3));
    const Vec3<Extended> u = random.vector(1).normalized().cast<Extended>();
    const auto root = [&](Extended s) {
      const Mat3<Extended> I = Mat3<Extended>::Identity();
      return sqrt(find_plate_plate<Extended>(P, place_plate<Extended>(Q, I, u * s), mu).square);
    };
    const Closest<Extended> c = find_plate_plate<Extended>(P, Q, mu);
    if (c.square < 1e-4L) continue;
    const Extended slope = (root(h) - root(-h)) / (2 * h);
    const Extended exact = u.dot(c.second - c.first) / sqrt(c.square);
    // Where the feature changes within h the quotient is off by the kink of the second derivative.
    gradient.add(static_cast<double>(slope - exact), i);
    EXPECT_LE(abs(root(0.01L) - root(0)), 0.01L * (1 + 1e-12L));
  }
  EXPECT_WORST_BELOW(gradient, 1e-10);  // measured 1.1e-11
}

}  // namespace
}  // namespace dockloop
