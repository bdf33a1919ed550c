// Surfaces of revolution: cores that touch them at several places.
//
// 1. gap and energy against dense samples that know nothing of valleys: the energy is the Euler
//    characteristic of the touching part of a grid, summed over the levels of depth;
// 2. the force has no jumps: through equal valleys, at concave corners, on random paths;
// 3. the work of the force is the loss of energy, and zero over closed paths;
// 4. derivatives against differences; 32 digits; dissipation is never negative;
// 5. places appear where geometry says: a rod across a mouth, a head in a corner.
#include <gtest/gtest.h>

#include <limits>

#include "contact/contact_model.hpp"
#include "math/scalar.hpp"
#include "unit/allocations.hpp"
#include "unit/contact_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;
using Nodes = std::vector<Profile::Node>;

constexpr double kMu = 1e-4;

ContactLaw make_law(bool elastic) {
  ContactLaw law;
  law.stiffness = 1e6;
  law.regularisation = kMu;
  law.friction_model = 1;
  if (elastic) law.damping = law.friction_coefficient = 0.0;
  return law;
}

/// One core on one profile, on the side that `flip` says.
struct Hardware {
  Core core;
  Nodes nodes;
  Pose<double> axis;
  bool flip;
  ContactModel make(const ContactLaw& law) const {
    Core wall = make_revolution("wall", nodes, 0.005);
    wall.axis = axis;
    const std::vector<NamedCore> first = {named(core)}, second = {named(wall)};
    return make_surface_contact(flip ? second : first, flip ? first : second,
                                {{core.name, "wall", ""}}, law, {});
  }
  double rounding() const { return core.rounding + 0.005; }
  /// A point of the core in axes of the profile.
  V place(const V& point, const RelativeMotion<double>& x) const {
    const V other = flip ? V(x.R * point + x.p) : V(x.R.transpose() * (point - x.p));
    return axis.R.transpose() * (other - axis.p);
  }
};

/// Profiles of one, two and three pieces, with corners of both senses, discs and circles.
Nodes make_nodes(int i, TestRandom& random) {
  const auto radius = [&] { return random.uniform(0.05, 0.35); };
  const double x = random.uniform(0.02, 0.1);
  switch (i % 8) {
    case 0:
      return {{0.0, radius()}};
    case 1:
      return {{0.0, 0.0}, {0.0, radius()}};
    case 2:
      return {{0.0, radius()}, {x, radius()}};
    case 3:
      return {{0.0, 0.3}, {x, 0.2}, {2.5 * x, 0.12}};  // convex from inside
    case 4:
      return {{0.0, 0.3}, {x, 0.28}, {1.3 * x, 0.15}};  // concave from inside
    case 5:
      return {{0.0, 0.15}, {x, 0.15}, {x, 0.06}};  // a right angle
    default: {
      Nodes nodes;
      for (int k = 0; k < 4 - i % 2; ++k) nodes.push_back({k * x, radius()});
      return nodes;
    }
  }
}

Hardware make_hardware(int i, TestRandom& random) {
  Core core = make_point("head", random.vector(0.05), 0.015);
  if (i % 5 != 0) {
    const double length = i % 3 == 0 ? 0.8 : random.uniform(0.05, 0.4);
    const V along = i % 7 == 0 ? V(1, 0, 0) : random.vector(1.0).normalized();
    core = make_segment("bar", -length / 2 * along, length / 2 * along, 0.015);
  }
  Pose<double> axis;
  if (i % 2) axis = {rotation_of(random.vector(0.3)), random.vector(0.05)};
  return {core, make_nodes(i, random), axis, i % 4 == 1};
}

/// Distance of a point from a piece in the half-plane, in other words than the core's.
double find_piece_distance(const Profile::Node& a, const Profile::Node& b, double x, double r) {
  const double ux = b.x - a.x, ur = b.r - a.r, square = ux * ux + ur * ur;
  double s = square > 0 ? ((x - a.x) * ux + (r - a.r) * ur) / square : 0.0;
  s = std::min(std::max(s, 0.0), 1.0);
  return std::hypot(x - a.x - s * ux, r - a.r - s * ur);
}

/// Random pose with the surfaces overlapping by 0 to 3 mm, found by dense samples only.
RelativeMotion<double> make_touching(const Hardware& h, double deepest, TestRandom& random);

/// sqrt(V) of the lowest of `count` + 1 samples of the segment, then of ever finer ones around it,
/// down to a width of `fine`.
double find_sampled_root(const Hardware& h, const RelativeMotion<double>& x, int count,
                         double fine = 1.0) {
  const bool segment = h.core.kind == CoreKind::kSegment;
  const V p = h.place(h.core.point, x), d = segment ? V(h.place(h.core.end, x) - p) : V(0, 0, 0);
  const Profile profile{h.nodes};
  double least = 1e9, at = 0;
  const auto look = [&](double t) {
    const V q = p + t * d;
    double distance = 1e9;
    for (int k = 0; k < profile.piece_count(); ++k) {
      distance = std::min(distance, find_piece_distance(profile.begin_of(k), profile.end_of(k),
                                                        q[0], std::hypot(q[1], q[2])));
    }
    const double square = distance * distance + kMu * d.squaredNorm() * (t - 0.5) * (t - 0.5);
    if (square < least) {
      least = square;
      at = t;
    }
  };
  if (!segment) {
    look(0.5);
    return std::sqrt(least);
  }
  for (int i = 0; i <= count; ++i) look(static_cast<double>(i) / count);
  for (double width = 1.0 / count; width > fine; width /= 25) {
    const double middle = at;
    for (int i = -50; i <= 50; ++i) {
      look(std::min(1.0, std::max(0.0, middle + i * width / 50)));
    }
  }
  return std::sqrt(least);
}

RelativeMotion<double> make_touching(const Hardware& h, double deepest, TestRandom& random) {
  RelativeMotion<double> x;
  x.R = rotation_of(random.vector(1.0));
  x.v = random.vector(0.1);
  x.w = random.vector(0.5);
  const V from = random.vector(0.6), way = random.vector(0.2) - from;
  const double depth = random.uniform(0.0, deepest);
  const auto excess = [&](double s) {
    x.p = from + s * way;
    return find_sampled_root(h, x, 40) - h.rounding() + depth;
  };
  double high = 0, low = 0;
  while (low < 2 && excess(low) > 0) {
    high = low;
    low += 0.02;
  }
  for (int i = 0; i < 12; ++i) {
    const double middle = (low + high) / 2;
    (excess(middle) > 0 ? high : low) = middle;
  }
  excess(low);
  return x;
}

double find_spring_energy(const ContactLaw& law, double depth, double rounding) {
  return depth <= 0 ? 0.0
                    : calc_contact_spring<double>(depth, law.stiffness, law.toe, rounding).energy;
}

/// Energy by samples of the segment: for each piece, less each node between two, the energy of all
/// samples less that of the more distant one of each two neighbours. At each depth this counts the
/// touching stretches of the segment, without any search.
double find_sampled_energy(const Hardware& h, const RelativeMotion<double>& x,
                           const ContactLaw& law, int count) {
  const bool segment = h.core.kind == CoreKind::kSegment;
  const V p = h.place(h.core.point, x), d = segment ? V(h.place(h.core.end, x) - p) : V(0, 0, 0);
  const auto add = [&](const Profile::Node& a, const Profile::Node& b) {
    double energy = 0, before = 0;
    for (int i = 0; i <= (segment ? count : 0); ++i) {
      const double t = segment ? static_cast<double>(i) / count : 0.5;
      const V q = p + t * d;
      const double distance = find_piece_distance(a, b, q[0], std::hypot(q[1], q[2]));
      const double root =
          std::sqrt(distance * distance + kMu * d.squaredNorm() * (t - 0.5) * (t - 0.5));
      energy += find_spring_energy(law, h.rounding() - root, h.rounding());
      if (i) energy -= find_spring_energy(law, h.rounding() - std::max(root, before), h.rounding());
      before = root;
    }
    return energy;
  };
  const Profile profile{h.nodes};
  double energy = 0;
  for (int k = 0; k < profile.piece_count(); ++k) {
    energy += add(profile.begin_of(k), profile.end_of(k));
    if (k) energy -= add(profile.begin_of(k), profile.begin_of(k));
  }
  return energy;
}

TEST(Revolution, NoPoseMissesTheLowestValley) {
  TestRandom random(421);
  Worst worst;
  int segments = 0, touching = 0;
  for (int i = 0; i < 4000; ++i) {
    const Hardware h = make_hardware(i, random);
    const RelativeMotion<double> x = make_touching(h, 3e-3, random);
    const ContactModel model = h.make(make_law(true));
    ContactWorkspace<double> work(model);
    const double gap = find_gap<double>(model, {}, x, work);
    worst.add(gap + h.rounding() - find_sampled_root(h, x, 1000, 1e-9), i);
    segments += h.core.kind == CoreKind::kSegment;
    ContactResult<double> r;
    if (!calc_contact<double>(model, {}, x, nullptr, nullptr, work, r).ok()) continue;
    if (gap < 0) {
      EXPECT_EQ(r.gap, gap);
      ++touching;
    }
  }
  EXPECT_GT(segments, 2000);
  EXPECT_GT(touching, 2000);
  EXPECT_WORST_BELOW(worst, 1e-12);
}

TEST(Revolution, ShippedRodMissesNoValley) {
  TestRandom random(422);
  Worst worst;
  for (int i = 0; i < 4600; ++i) {
    Hardware h{make_segment("rod", V(-0.05, 0, 0), V(-0.8, 0, 0), 0.025),
               i % 2 ? Nodes{{0.0, 0.40}} : Nodes{{0.205, 0.045}},
               {},
               false};
    RelativeMotion<double> x;
    x.R = rotation_of(random.vector(1.2)).transpose();
    const V head(random.uniform(-0.1, 0.6), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3));
    x.p = -(x.R * head);
    const ContactModel model = h.make(make_law(true));
    ContactWorkspace<double> work(model);
    worst.add(
        find_gap<double>(model, {}, x, work) + h.rounding() - find_sampled_root(h, x, 1000, 1e-9),
        i);
  }
  EXPECT_WORST_BELOW(worst, 1e-12);
}

/// Cores that touch at several places: long bars in bores, heads in corners.
Hardware make_bore(int i, TestRandom& random) {
  Hardware h = make_hardware(i, random);
  switch (i % 4) {
    case 0:
      h.nodes = {{0.0, 0.10}, {0.3, 0.10}};
      break;
    case 1:
      h.nodes = {{0.0, 0.08}, {0.1, 0.11}, {0.2, 0.08}};
      break;
    case 2:
      h.nodes = {{0.0, 0.11}, {0.1, 0.07}, {0.2, 0.10}};
      break;
    default:
      h.nodes = {{0.0, 0.12}, {0.1, 0.10}, {0.12, 0.06}, {0.2, 0.06}};
  }
  if (i % 5 == 4) {
    h.core = make_point("head", random.vector(0.05), 0.045);
  } else {
    const V along = i % 3 ? random.vector(1.0).normalized() : V(1.0, 0.1, 0.2).normalized();
    const double length = i % 3 ? random.uniform(0.1, 0.3) : 0.4;
    h.core = make_segment("bar", -length / 2 * along, length / 2 * along, 0.02);
  }
  return h;
}

RelativeMotion<double> make_pose(const V& turn, const V& p) {
  RelativeMotion<double> x;
  x.R = rotation_of(turn);
  x.p = p;
  return x;
}

TEST(Revolution, EnergyCountsEveryTouchingRegionOnce) {
  TestRandom random(423);
  const ContactLaw law = make_law(true);
  Worst worst;
  int several = 0, ridges = 0, single = 0;
  for (int i = 0; i < 60000; ++i) {
    const Hardware h = i % 2 ? make_bore(i / 2, random) : make_hardware(i, random);
    const RelativeMotion<double> x = make_pose(random.vector(0.6), random.vector(0.2));
    const ContactModel model = h.make(law);
    ContactWorkspace<double> work(model);
    ContactResult<double> r;
    if (!calc_contact<double>(model, {}, x, nullptr, nullptr, work, r).ok()) continue;
    if (r.active_count == 0 || r.depth_ratio > 0.5) continue;  // no barrier
    if (work.touching.size() == 1 && single > 1000) continue;
    single += work.touching.size() == 1;
    several += work.touching.size() > 1;
    for (const Touching& at : work.touching) ridges += at.sign < 0;
    const double places = static_cast<double>(work.touching.size());
    // Samples miss a stationary value of the square by |d|^2/(4 count^2), a micrometre of depth.
    const double force = law.stiffness * 20 * h.rounding() * places;
    worst.add((r.energy - find_sampled_energy(h, x, law, 3000)) / (force * 1e-6), i);
  }
  EXPECT_GT(single, 1000);
  EXPECT_GT(several, 150);
  EXPECT_GT(ridges, 20);
  EXPECT_WORST_BELOW(worst, 1.0);
}

/// A smooth closed path through the bore, 0 <= s <= 1, with its velocity.
struct Loop {
  V p0, p1, p2, axis, other;
  explicit Loop(TestRandom& random)
      : p0(random.vector(0.03)),
        p1(random.vector(0.06)),
        p2(random.vector(0.03)),
        axis(random.vector(0.4)),
        other(random.vector(0.3)) {}
  RelativeMotion<double> at(double s) const {
    const double turn = 2 * static_cast<double>(EIGEN_PI), w = turn * s;
    const double c = std::cos(w), d = std::sin(w), c2 = std::cos(2 * w), d2 = std::sin(2 * w);
    RelativeMotion<double> x;
    const Mat3<double> R = rotation_of(axis * d);
    x.R = R * rotation_of(other * c2);
    x.w = turn * (axis * c - R * other * 2 * d2);
    x.p = p0 + p1 * c + p2 * d2;
    x.v = turn * (2 * p2 * c2 - p1 * d);
    return x;
  }
};

void expect_no_jumps(const ContactLaw& law) {
  TestRandom random(424);
  Worst worst;
  int changes = 0, paths = 0;
  for (int i = 0; i < 400; ++i) {
    const Hardware h = make_bore(i, random);
    const ContactModel model = h.make(law);
    const Loop loop(random);
    ContactWorkspace<double> work(model);
    bool ok = true;
    size_t places = 0;
    const auto find_wrench = [&](double s) {
      ContactResult<double> r;
      ok = ok && calc_contact<double>(model, {}, loop.at(s), nullptr, nullptr, work, r).ok();
      Vec6<double> w;
      w << r.on_passive.f, r.on_passive.t / 0.1;
      return w;
    };
    const int steps = 400;
    std::vector<Vec6<double>> wrench;
    double most = 0;
    int here = 0;
    for (int k = 0; k <= steps && ok; ++k) {
      wrench.push_back(find_wrench(static_cast<double>(k) / steps));
      most = std::max(most, wrench.back().norm());
      here += k > 0 && work.touching.size() != places && places > 0;
      places = work.touching.size();
    }
    if (!ok || most < 10.0) continue;
    ++paths;
    changes += here;
    for (int k = 0; k < steps; ++k) {
      double low = static_cast<double>(k) / steps, high = (k + 1.0) / steps;
      Vec6<double> at_low = wrench[k], at_high = wrench[k + 1];
      if ((at_high - at_low).norm() < 0.02 * most) continue;
      for (int j = 0; j < 36; ++j) {  // follow the larger change
        const double middle = (low + high) / 2;
        const Vec6<double> at_middle = find_wrench(middle);
        if ((at_middle - at_low).norm() > (at_high - at_middle).norm()) {
          high = middle;
          at_high = at_middle;
        } else {
          low = middle;
          at_low = at_middle;
        }
      }
      worst.add((at_high - at_low).norm() / most, i);
    }
  }
  EXPECT_GT(paths, 60);
  EXPECT_GT(changes, 100);
  EXPECT_WORST_BELOW(worst, 1e-8);
}

TEST(Revolution, ForceHasNoJumps) {
  for (const bool elastic : {true, false}) expect_no_jumps(make_law(elastic));
}

/// Integral over low..high: five points of Gauss, halves that agree to `tolerance`.
template <class F>
double integrate(const F& f, double low, double high, double tolerance, int depth = 0) {
  const auto gauss = [&](double a, double b) {
    constexpr double kAt[3] = {0.0, 0.53846931010568309, 0.90617984593866399};
    constexpr double kWeight[3] = {128.0 / 225, 0.47862867049936647, 0.23692688505618909};
    const double middle = (a + b) / 2, half = (b - a) / 2;
    double sum = kWeight[0] * f(middle);
    for (int i = 1; i < 3; ++i) {
      sum += kWeight[i] * (f(middle - half * kAt[i]) + f(middle + half * kAt[i]));
    }
    return sum * half;
  };
  const double middle = (low + high) / 2;
  const double whole = gauss(low, high), parts = gauss(low, middle) + gauss(middle, high);
  if ((depth > 9 && std::abs(whole - parts) < tolerance) || depth > 30) return parts;
  return integrate(f, low, middle, tolerance, depth + 1) +
         integrate(f, middle, high, tolerance, depth + 1);
}

TEST(Revolution, WorkIsTheLossOfEnergyAndZeroOverClosedPaths) {
  TestRandom random(425);
  const ContactLaw law = make_law(true);
  Worst closed, part;
  int paths = 0, changed = 0;
  for (int i = 0; i < 4000 && changed < 12; ++i) {
    const Hardware h = make_bore(i, random);
    const ContactModel model = h.make(law);
    const Loop loop(random);
    ContactWorkspace<double> work(model);
    bool ok = true;
    double most = 0;
    size_t places = 0;
    const auto find = [&](double s) {
      ContactResult<double> r;
      ok = ok && calc_contact<double>(model, {}, loop.at(s), nullptr, nullptr, work, r).ok();
      most = std::max(most, r.energy);
      places = std::max(places, work.touching.size());
      return r;
    };
    for (int k = 0; k < 200 && ok; ++k) find(k / 200.0);
    if (!ok || most < 0.01 || (places == 1 && paths - changed > 3)) continue;
    const auto find_rate = [&](double s) { return find_power(find(s).on_passive, loop.at(s)); };
    const double half = random.uniform(0.3, 0.7), tolerance = 1e-13 * most;
    const double to_half = integrate(find_rate, 0.0, half, tolerance);
    const double from_half = integrate(find_rate, half, 1.0, tolerance);
    if (!ok) continue;
    ++paths;
    changed += places > 1;
    part.add((to_half + find(half).energy - find(0.0).energy) / most, i);
    closed.add((to_half + from_half) / most, i);
  }
  EXPECT_EQ(changed, 12);
  EXPECT_WORST_BELOW(part, 1e-9);
  EXPECT_WORST_BELOW(closed, 1e-9);
}

/// Poses in which the hardware touches at several places, and as many with one.
template <class F>
void visit_touching(const ContactLaw& law, unsigned seed, int wanted, const F& visit) {
  TestRandom random(seed);
  int single = 0, several = 0;
  for (int i = 0; several < wanted; ++i) {
    ASSERT_LT(i, 400000);
    const Hardware h = make_bore(i, random);
    RelativeMotion<double> x = make_pose(random.vector(0.6), random.vector(0.2));
    x.v = random.vector(0.1);
    x.w = random.vector(1.0);
    const ContactModel model = h.make(law);
    ContactWorkspace<double> work(model);
    ContactResult<double> r;
    if (!calc_contact<double>(model, {}, x, nullptr, nullptr, work, r).ok()) continue;
    if (r.active_count == 0) continue;
    int& count = work.touching.size() > 1 ? several : single;
    if (count < wanted) visit(model, x, r, work, ++count);
  }
}

TEST(Revolution, DerivativesAgreeWithDifferences) {
  std::vector<double> errors;
  visit_touching(make_law(true), 426, 200,
                 [&](const ContactModel& model, const RelativeMotion<double>& x,
                     const ContactResult<double>& r, const ContactWorkspace<double>&, int) {
                   RelativeMotion<double> still = x;
                   still.v = still.w = V::Zero();
                   const ContactResult<Derivative> exact =
                       find_contact(model, make_directions(still));
                   const double scale = r.on_passive.f.norm();
                   for (int j = 0; j < 3; ++j) {
                     EXPECT_NEAR(exact.energy.d[j], -r.on_passive.f[j], 1e-9 * scale);
                     EXPECT_NEAR(exact.energy.d[3 + j], -r.on_passive.t[j], 1e-9 * scale);
                     constexpr double kStep = 1e-7;
                     V force[2];
                     for (const int side : {0, 1}) {
                       RelativeMotion<double> moved = still;
                       moved.p[j] += side ? kStep : -kStep;
                       force[side] = find_contact(model, moved).on_passive.f;
                     }
                     for (int k = 0; k < 3; ++k) {
                       const double slope = (force[1][k] - force[0][k]) / (2 * kStep);
                       errors.push_back(std::abs(exact.on_passive.f[k].d[j] - slope) / 1e6);
                     }
                   }
                 });
  ASSERT_GT(errors.size(), 3000u);
  std::sort(errors.begin(), errors.end());
  EXPECT_LE(errors[errors.size() / 2], 1e-8);
  EXPECT_LE(errors[errors.size() * 97 / 100], 1e-4);  // the others cross a kink within the step
}

TEST(Revolution, ExtendedAgrees) {
  Worst energy, force, gap;
  visit_touching(make_law(false), 427, 150,
                 [&](const ContactModel& model, const RelativeMotion<double>& x,
                     const ContactResult<double>& r, const ContactWorkspace<double>&, int i) {
                   const ContactResult<Extended> e = find_contact(model, cast_motion<Extended>(x));
                   energy.add(r.energy / to_double(e.energy) - 1, i);
                   gap.add(r.gap - to_double(e.gap), i);
                   const double size = r.on_passive.f.norm();  // 0 where surfaces part fast
                   for (int k = 0; k < 3; ++k) {
                     const double error = r.on_passive.f[k] - to_double(e.on_passive.f[k]);
                     force.add(size > 0.0 ? error / size : error, i);
                   }
                 });
  EXPECT_WORST_BELOW(gap, 4e-16);
  EXPECT_WORST_BELOW(energy, 6e-12);
  EXPECT_WORST_BELOW(force, 3e-12);
}

TEST(Revolution, EnergyBalancesWithDampingAndBothFrictions) {
  for (const int friction : {1, 2}) {
    ContactLaw law = make_law(false);
    law.friction_model = friction;
    law.friction_coefficient = 0.3;
    Worst balance;
    TestRandom random(428);
    const double k = law.bristle_stiffness;
    ContactLaw first = law;
    first.friction_model = 1;
    visit_touching(
        first, 429, 200,
        [&](ContactModel model, const RelativeMotion<double>& x, const ContactResult<double>& was,
            const ContactWorkspace<double>&, int i) {
          set_law(model, law);
          ContactWorkspace<double> work(model);
          const V z = random.vector(was.on_passive.f.norm() * 0.2 / k);
          V rate = V::Zero();
          ContactResult<double> r;
          ASSERT_TRUE(calc_contact<double>(model, {}, x, z.data(), rate.data(), work, r).ok());
          EXPECT_GE(r.contact_power, 0.0);
          EXPECT_GE(r.friction_power, 0.0);
          set_law(model, first);
          const ContactResult<Derivative> e = find_contact(model, make_directions(x));
          const V v = x.v - x.w.cross(x.p);
          double stored = friction == 2 ? k * z.dot(rate) : 0.0;
          for (int j = 0; j < 3; ++j) stored += e.energy.d[j] * v[j] + e.energy.d[3 + j] * x.w[j];
          balance.add((find_power(r.on_passive, x) + stored + r.contact_power + r.friction_power) /
                          (r.on_passive.f.norm() * 0.1),
                      i);
        });
    EXPECT_WORST_BELOW(balance, 2e-11);
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(Revolution, EvaluationDoesNotAllocate) {
  long allocations = 0;
  visit_touching(make_law(false), 430, 200,
                 [&](const ContactModel& model, const RelativeMotion<double>& x,
                     const ContactResult<double>&, const ContactWorkspace<double>&, int) {
                   ContactWorkspace<double> work(model);
                   ContactResult<double> r;
                   allocations += count_allocations(
                       [&] { calc_contact<double>(model, {}, x, nullptr, nullptr, work, r); });
                 });
  EXPECT_EQ(allocations, 0);
}
#endif

std::vector<Touching> find_places(const Hardware& h, const RelativeMotion<double>& x) {
  const ContactModel model = h.make(make_law(true));
  ContactWorkspace<double> work(model);
  ContactResult<double> r;
  EXPECT_TRUE(calc_contact<double>(model, {}, x, nullptr, nullptr, work, r).ok());
  return work.touching;
}

TEST(Revolution, PlacesAreWhereTheyShouldBe) {
  constexpr double kShift = 3e-5;  // by the regularisation
  const auto expect = [](const Hardware& h, const V& p, const std::vector<V>& ways) {
    const std::vector<Touching> places = find_places(h, make_pose(V::Zero(), p));
    ASSERT_EQ(places.size(), ways.size());
    for (size_t i = 0; i < ways.size(); ++i) {
      EXPECT_EQ(places[i].sign, 1);
      EXPECT_NEAR((places[i].way - ways[i]).norm(), 0.0, kShift) << places[i].way.transpose();
    }
  };
  // A rod across the mouth rests on the rim at both sides.
  const Core rod = make_segment("rod", V(0, -0.3, 0), V(0, 0.3, 0), 0.015);
  expect({rod, {{0.0, 0.2}, {0.1, 0.1}}, {}, false}, V(0.019, 0, 0),
         {V(0.019, 0, 0), V(0.019, 0, 0)});
  // A rod in a tube touches with both ends, one at each side.
  const Core bar = make_segment("bar", V(-0.3, -0.03, 0), V(0.3, 0.03, 0), 0.015);
  expect({bar, {{-1.0, 0.049}, {1.0, 0.049}}, {}, false}, V::Zero(),
         {V(0, -0.019, 0), V(0, 0.019, 0)});
  // A head in the corner of wall and floor touches both; on a convex corner it touches once.
  const Core head = make_point("head", V::Zero(), 0.015);
  const Nodes corner = {{-0.3, 0.1}, {0.0, 0.1}, {0.0, 0.05}};
  expect({head, corner, {}, false}, V(0.019, -0.081, 0), {V(0, 0.019, 0), V(0.019, 0, 0)});
  expect({head, {{-0.3, 0.1}, {0.0, 0.1}, {0.0, 0.2}}, {}, false}, V(-0.012, -0.088, 0),
         {V(-0.012, 0.012, 0)});
  // A wall that is bent by less and less comes to touch as a straight one.
  const auto find_energy = [&](double bend) {
    const Hardware h{head, {{-0.3, 0.1 - bend}, {0.0, 0.1}, {0.3, 0.1 - bend}}, {}, false};
    return find_contact(h.make(make_law(true)), make_pose(V::Zero(), V(0, -0.081, 0))).energy;
  };
  const double straight = find_energy(0.0);
  EXPECT_NEAR(find_energy(1e-6) / straight, 1.0, 1e-7);
  EXPECT_NEAR(find_energy(1e-3) / straight, 1.0, 0.1);
  EXPECT_GT(find_energy(0.06) / straight, 1.2);
}

TEST(Revolution, AlignedPosesAreNoSpecialCase) {
  const ContactLaw law = make_law(true);
  const std::vector<Nodes> profiles = {{{0.0, 0.1}},
                                       {{-0.1, 0.1}, {0.2, 0.1}},
                                       {{0.0, 0.2}, {0.1, 0.1}},
                                       {{0.0, 0.0}, {0.0, 0.1}},
                                       {{-0.2, 0.1}, {0.0, 0.1}, {0.0, 0.05}, {0.2, 0.05}}};
  const std::vector<V> directions = {V(1, 0, 0), V(0, 1, 0),  V(0, 0, 1),
                                     V(1, 1, 0), V(-1, 1, 0), V(0, 1, 1)};
  const double places[] = {0.0, 0.05, 0.081, 0.1, 0.119, 0.15};
  int touching = 0, index = 0;
  Worst worst;
  for (const Nodes& nodes : profiles) {
    for (const V& along : directions) {
      const V half = 0.1 * along.normalized();
      const Hardware h{make_segment("bar", -half, half, 0.015), nodes, {}, false};
      const ContactModel model = h.make(law);
      for (const double x : {-0.019, 0.0, 0.019, 0.05}) {
        for (const double y : places) {
          for (const double z : {0.0, 0.05}) {
            const RelativeMotion<double> motion = make_pose(V::Zero(), -V(x, y, z));
            ContactWorkspace<double> work(model);
            ContactResult<double> r;
            if (!calc_contact<double>(model, {}, motion, nullptr, nullptr, work, r).ok()) continue;
            if (r.active_count == 0 || r.depth_ratio > 0.5) continue;
            ++touching;
            const double energy = find_sampled_energy(h, motion, law, 20000);
            worst.add((r.energy - energy) / (law.stiffness * h.rounding() * 1e-6), ++index);
            const ContactResult<Derivative> e = find_contact(model, make_directions(motion));
            for (int j = 0; j < 3; ++j) {
              const double scale = 1e-9 * r.on_passive.f.norm();
              EXPECT_NEAR(e.energy.d[j], -r.on_passive.f[j], scale) << index;
              EXPECT_NEAR(e.energy.d[3 + j], -r.on_passive.t[j], scale) << index;
            }
          }
        }
      }
    }
  }
  EXPECT_GT(touching, 150);
  EXPECT_WORST_BELOW(worst, 1.0);
}

TEST(Revolution, TheDeeperPlaceMayChangeSides) {
  const Core bar = make_segment("bar", V(-0.3, -0.03, 0), V(0.3, 0.03, 0), 0.015);
  const Hardware h{bar, {{-1.0, 0.049}, {1.0, 0.049}}, {}, false};
  const ContactModel model = h.make(make_law(true));
  ContactMemory memory;
  ContactWorkspace<double> work(model);
  ContactResult<double> r;
  for (const double y : {-1e-3, -5e-4, 5e-4, 1e-3}) {
    const RelativeMotion<double> x = make_pose(V::Zero(), V(0, y, 0));
    ASSERT_TRUE(calc_contact<double>(model, memory, x, nullptr, nullptr, work, r).ok());
    EXPECT_EQ(work.touching.size(), 2u - (std::abs(y) >= 1e-3));
    EXPECT_GT(r.on_passive.f.y() * (y > 0 ? -1 : 1), 0.0);
    update_contact_memory(model, x, nullptr, work, memory);
  }
}

}  // namespace
}  // namespace dockloop
