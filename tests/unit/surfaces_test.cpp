// Contact surfaces as data.
//
// 1. probe and drogue against stored vectors (surfaces.json): closest points, gaps, energy, force;
// 2. the guide ring written as data gives the forces of the guide ring;
// 3. force is minus the gradient of the energy for every kind of pair, by dual numbers; the
//    neighbour list changes no bit; sums over the groups are the whole force;
// 4. hardware that makes no sense is refused by name.
#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "contact/contact_model.hpp"
#include "math/scalar.hpp"
#include "unit/contact_test_support.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;
using Cores = std::vector<NamedCore>;

ContactLaw make_elastic_law() {
  ContactLaw law;
  law.damping = 0.0;
  law.friction_coefficient = 0.0;
  return law;
}

const std::vector<Profile::Node> kCone = {{0, 0.45}, {0, 0.40}, {0.205, 0.045}, {0.28, 0.045}};

Cores make_probe() {
  return {named(make_point("head", V::Zero(), 0.040)),
          named(make_segment("rod", V(-0.05, 0, 0), V(-0.80, 0, 0), 0.025))};
}

Cores make_drogue() {
  Cores cores = {named(make_revolution("cone", kCone, 0.002)),
                 named(make_revolution("floor", {{0.28, 0.0}, {0.28, 0.045}}, 0.002)),
                 named(make_revolution("rim", {{0.0, 0.40}}, 0.002)),
                 named(make_revolution("edge", {{0.205, 0.045}}, 0.002))};
  cores[0].piece_groups = {"mouth", "cone", "socket"};
  return cores;
}

const std::vector<GroupPair> kProbePairs = {
    {"head", "cone", ""}, {"head", "floor", ""}, {"rod", "rim", ""}, {"rod", "edge", ""}};

ContactModel make_probe_contact(const ContactLaw& law) {
  return make_surface_contact(make_probe(), make_drogue(), kProbePairs, law, {});
}

/// The lowest place of a point, or of a segment.
struct Lowest : Closest<double> {
  Lowest() { square = std::numeric_limits<double>::max(); }
  void operator()(const Place<double>& place) {
    if (place.square < square) static_cast<Closest<double>&>(*this) = place;
  }
};

Closest<double> find_closest(const V& point, const Profile& profile) {
  Lowest lowest;
  visit_point_places<double>(point, profile, [&](const Place<double>& place) { lowest(place); });
  return lowest;
}

Closest<double> find_closest(const V& a, const V& d, const Profile& profile) {
  Lowest lowest;
  visit_segment_places<double>(a, d, profile, 1e-4, 0.0,
                               [&](const Place<double>& place) { lowest(place); });
  return lowest;
}

/// P relative to G, from the head centre and the rows of R_PG of a stored pose.
RelativeMotion<double> read_pose(const nlohmann::json& pose, Mat3<double>& R_PG) {
  for (int i = 0; i < 3; ++i) R_PG.row(i) = to_vec3(pose["rotation"][i]).transpose();
  RelativeMotion<double> x;
  x.R = R_PG.transpose();
  x.p = -x.R * to_vec3(pose["centre"]);
  return x;
}

TEST(Surfaces, ProbeAndDrogueAgreeWithStoredPoses) {
  const nlohmann::json data = read_contact_data("surfaces.json");
  ContactLaw law = make_elastic_law();
  law.stiffness = data["law"]["stiffness"];
  law.toe = data["law"]["toe"];
  Worst place, gap, energy, force, moment;
  int index = 0;
  for (const nlohmann::json& pose : data["poses"]) {
    Mat3<double> R_PG;
    const RelativeMotion<double> x = read_pose(pose, R_PG);
    for (size_t i = 0; i < kProbePairs.size(); ++i) {
      const GroupPair& row = kProbePairs[i];
      const nlohmann::json& stored = pose["pairs"][i];
      ASSERT_EQ(stored["pair"], row.first + "_" + row.second);
      const ContactModel one = make_surface_contact(make_probe(), make_drogue(), {row}, law, {});
      ContactWorkspace<double> work(one);
      gap.add(find_gap<double>(one, {}, x, work) - stored["gap"].get<double>(), index);
      const ContactResult<double> r = find_contact(one, x);
      const double scale = 1.0 + stored["force"].get<double>();
      energy.add((r.energy - stored["energy"].get<double>()) / scale, index);
      const V on_probe = -(R_PG * r.on_passive.f);
      const V expected = stored["force"].get<double>() * to_vec3(stored["normal"]);
      force.add((on_probe - expected).norm() / scale, index);
      // Closest points in axes of P.
      const V centre = to_vec3(pose["centre"]);
      const Profile& profile = one.passive[i].profile;
      const V a = centre + R_PG * V(-0.05, 0, 0), d = R_PG * V(-0.75, 0, 0);
      const Closest<double> c = i < 2 ? find_closest(centre, profile) : find_closest(a, d, profile);
      place.add((c.first - to_vec3(stored["p"])).norm(), index);
      place.add((c.second - to_vec3(stored["q"])).norm(), index);
    }
    const ContactResult<double> whole = find_contact(make_probe_contact(law), x);
    const V on_probe = -(R_PG * whole.on_passive.f), expected = to_vec3(pose["force"]);
    force.add((on_probe - expected).norm() / (1.0 + expected.norm()), index);
    const V turning = -(R_PG * whole.on_passive.t),
            expected_turning = to_vec3(pose["moment_about_centre"]);
    moment.add((turning - expected_turning).norm() / (1.0 + expected.norm()), index);
    energy.add((whole.energy - pose["energy"].get<double>()) / (1.0 + expected.norm()), index);
    ++index;
  }
  EXPECT_GE(index, 37);
  EXPECT_WORST_BELOW(gap, 1e-14);
  EXPECT_WORST_BELOW(place, 1e-9);
  EXPECT_WORST_BELOW(energy, 1e-12);
  EXPECT_WORST_BELOW(force, 1e-9);
  EXPECT_WORST_BELOW(moment, 1e-9);
}

/// The stored rings, written as data.
ContactModel make_ring_as_data(const ContactLaw& law) {
  const auto make_side = [](const CaptureHardware& hardware, const std::string& ring) {
    Cores cores;
    for (const Core& core : make_ring_cores(hardware, ring)) {
      switch (core.kind) {
        case CoreKind::kPoint:
          cores.push_back({core, "node", "node", {}});
          break;
        case CoreKind::kPlate:
          cores.push_back({core, "petal", "", {}});
          cores.back().core.edges = {1, 3};
          break;
        case CoreKind::kRevolution:
          cores.push_back({core, "face", "", {}});
          break;
        case CoreKind::kSegment:  // edges of the plates are segments by themselves
          break;
      }
    }
    return cores;
  };
  return make_surface_contact(
      make_side(make_capture_hardware(make_test_ring()), "active ring"),
      make_side(make_passive_hardware(make_test_ring()), "passive ring"),
      {{"node", "face", ""},
       {"petal", "face", ""},
       {"node", "petal", "common"},
       {"petal", "petal", ""}},
      law, {{"node", {{&ContactLaw::stiffness, law.node_stiffness}}}, {"common", {}}});
}

TEST(Surfaces, GuideRingsAreDataOfThisKind) {
  const ContactModel ring = make_test_contact(), data = make_ring_as_data({});
  EXPECT_EQ(data.pair_count(), ring.pair_count());
  EXPECT_EQ(data.bounding_radius, ring.bounding_radius);
  TestRandom random(91);
  ContactWorkspace<double> work(ring), same(data);
  Worst worst;
  int closed = 0;
  for (int i = 0; i < 300; ++i) {
    const RelativeMotion<double> x = make_touching_motion(ring, work, random, 2e-3);
    const ContactResult<double> a = find_contact(ring, x), b = find_contact(data, x);
    // Edges on the face are searched by other means.
    EXPECT_NEAR(find_gap<double>(ring, {}, x, work), find_gap<double>(data, {}, x, same), 1e-15);
    EXPECT_EQ(a.active_count, b.active_count);
    closed += a.active_count;
    const double scale = a.on_passive.f.norm();
    worst.add((a.on_passive.f - b.on_passive.f).norm() / scale, i);
    worst.add((a.on_passive.t - b.on_passive.t).norm() / scale, i);
    worst.add((a.energy - b.energy) / a.energy, i);
    worst.add((a.friction_power - b.friction_power) / (1e-3 + a.friction_power), i);
  }
  EXPECT_GT(closed, 300);
  EXPECT_WORST_BELOW(worst, 1e-12);  // only the order of the sum differs
}

using GroupPairs = std::vector<GroupPair>;

/// Every group of make_mixed_contact() on G with every one on P.
GroupPairs list_mixed_pairs() {
  GroupPairs pairs;
  for (const char* a : {"point", "bar", "plate"}) {
    for (const char* p : {"ball", "rail", "across", "tilted"}) pairs.push_back({a, p, ""});
  }
  return pairs;
}

/// Hardware with every kind of pair; sides that overlap near the origin of G.
ContactModel make_mixed_contact(const ContactLaw& law,
                                const GroupPairs& pairs = list_mixed_pairs()) {
  const std::array<V, 4> corner = {V(0.02, -0.2, -0.2), V(0.02, 0.2, -0.2), V(0.02, 0.15, 0.2),
                                   V(0.02, -0.15, 0.2)};
  Core plate = make_plate_core("plate", make_plate<double>(corner), 0.010);
  plate.edges = {0, 1, 2, 3};
  Core across = plate;
  across.name = "across";
  across.plate = place_plate<double>(plate.plate, rotation_of(V(0, 0.05, 0.03)), V(0.06, 0, 0));
  Core tilted = make_revolution("tilted", {{0.01, 0.30}, {0.03, 0.20}, {0.10, 0.12}}, 0.005);
  tilted.axis = {rotation_of(V(0.1, 0.2, -0.1)), V(0.02, 0.01, -0.02)};
  const Cores active = {named(make_point("point", V(0.04, 0.02, 0.03), 0.020)),
                        named(make_segment("bar", V(0.03, -0.2, 0.01), V(0.05, 0.2, 0.04), 0.015)),
                        named(plate)};
  const Cores passive = {
      named(make_point("ball", V(0.05, 0.03, 0.01), 0.020)),
      named(make_segment("rail", V(0.05, 0.05, -0.2), V(0.06, 0.02, 0.2), 0.015)), named(across),
      named(tilted)};
  return make_surface_contact(active, passive, pairs, law, {});
}

TEST(Surfaces, ForceIsTheGradientForEveryKindOfPair) {
  std::array<int, 10> closed{};
  std::vector<ContactModel> models = {make_mixed_contact(make_elastic_law()),
                                      make_probe_contact(make_elastic_law())};
  for (const GroupPair& pair : list_mixed_pairs()) {
    models.push_back(make_mixed_contact(make_elastic_law(), {pair}));
  }
  TestRandom random(92);
  for (const ContactModel& model : models) {
    Worst worst;
    for (int i = 0; i < 1500; ++i) {
      RelativeMotion<double> x;
      const bool probe = model.active.size() == 2;  // a head and a rod
      x.R = rotation_of(random.vector(probe ? 0.6 : 0.3));
      const V head =
          probe ? V(random.uniform(0.0, 0.26), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3))
                : random.vector(0.05);
      x.p = probe ? V(-(x.R * head)) : head;
      ContactWorkspace<double> work(model);
      ContactResult<double> r;
      if (!calc_contact<double>(model, {}, x, nullptr, nullptr, work, r).ok()) continue;
      if (r.active_count == 0) continue;
      for (int k = 0; k < model.pair_count(); ++k) {
        closed[static_cast<size_t>(model.pairs[k].kind)] += work.closed[k];
      }
      const ContactResult<Derivative> e = find_contact(model, make_directions(x));
      EXPECT_NEAR(e.energy.value, r.energy, 1e-12 * r.energy + 1e-15);
      for (int j = 0; j < 3; ++j) {
        const double scale = r.on_passive.f.norm() + r.on_passive.t.norm() + 1.0;
        worst.add((e.energy.d[j] + r.on_passive.f[j]) / scale, i);
        worst.add((e.energy.d[3 + j] + r.on_passive.t[j]) / scale, i);
      }
    }
    EXPECT_WORST_BELOW(worst, 1e-9);
  }
  for (const PairKind kind :
       {PairKind::kPointPoint, PairKind::kPointSegment, PairKind::kPointPlate,
        PairKind::kPointRevolution, PairKind::kSegmentSegment, PairKind::kSegmentPlate,
        PairKind::kSegmentRevolution, PairKind::kPlatePlate}) {
    EXPECT_GT(closed[static_cast<size_t>(kind)], 20) << static_cast<int>(kind);
  }
}

TEST(Surfaces, NeighbourListChangesNoBit) {
  for (const ContactModel& model : {make_mixed_contact({}), make_probe_contact({})}) {
    const bool probe = model.active.size() == 2;
    TestRandom random(93);
    int closed = 0, skipped = 0;
    for (int path = 0; path < 20; ++path) {
      const V from = probe ? V(0.0, 0, 0) : V(0.3, 0, 0), turn = random.vector(0.3);
      const V to = probe ? V(-0.27, random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2))
                         : random.vector(0.03);
      ContactMemory memory;
      ContactWorkspace<double> work(model);
      for (int i = 0; i <= 200; ++i) {
        RelativeMotion<double> x;
        x.R = rotation_of(turn * (i / 200.0));
        x.p = from + (to - from) * (i / 200.0);
        x.v = random.vector(0.1);
        x.w = random.vector(0.1);
        ContactResult<double> listed, plain;
        const Status with = calc_contact<double>(model, memory, x, nullptr, nullptr, work, listed);
        if (!with.ok()) break;
        ContactWorkspace<double> other(model);
        ASSERT_TRUE(calc_contact<double>(model, {}, x, nullptr, nullptr, other, plain).ok());
        ASSERT_TRUE(equals_in_bits(listed, plain)) << "path " << path << ", place " << i;
        const double gap = find_gap<double>(model, {}, x, other);
        ASSERT_LE(listed.gap, gap + 1e-15);
        closed += plain.active_count;
        skipped += memory.find_list(0) && memory.lists[0].near.size() < model.pairs.size();
        update_contact_memory(model, x, nullptr, work, memory);
      }
    }
    EXPECT_GT(closed, 50);
    EXPECT_GT(skipped, 100);
  }
}

TEST(Surfaces, ForcesOnGroupsAddUpAndPiecesHaveTheirOwn) {
  const ContactModel model = make_probe_contact({});
  std::vector<std::string> names;
  for (const Surface& surface : model.surfaces) {
    names.push_back((surface.on_passive ? "P " : "G ") + surface.name);
  }
  EXPECT_EQ(names, (std::vector<std::string>{"G head", "G rod", "P cone", "P mouth", "P socket",
                                             "P floor", "P rim", "P edge"}));
  EXPECT_EQ(model.depth, 0.28);
  const auto touch = [&](const V& head, size_t surface) {
    RelativeMotion<double> x;
    x.p = -head;
    const ContactResult<double> r = find_contact(model, x);
    EXPECT_EQ(r.active_count, 1);
    EXPECT_EQ(r.surface_force[0], V(-r.on_passive.f));
    EXPECT_EQ(r.surface_force[surface], r.on_passive.f);
    EXPECT_GT(r.on_passive.f.norm(), 100.0);
  };
  touch(V(-0.041, 0.43, 0), 3);  // mouth
  touch(V(0.22, 0, 0.0035), 4);  // socket
  const V on_cone = V(0.1025, 0.2225, 0), inward = V(-0.355, -0.205, 0).normalized();
  touch(on_cone + 0.041 * inward, 2);
  touch(V(0.239, 0, 0), 5);  // floor
}

TEST(Surfaces, PairsHaveTheirLaw) {
  const ContactLaw law = make_elastic_law();
  const auto find_force = [&](const std::string& of_core, const std::string& of_pair) {
    Cores probe = make_probe();
    probe[0].law = of_core;
    const ContactModel model = make_surface_contact(
        probe, make_drogue(), {{"head", "floor", of_pair}}, law,
        {{"half", {{&ContactLaw::stiffness, 1e6}}}, {"double", {{&ContactLaw::stiffness, 4e6}}}});
    RelativeMotion<double> x;
    x.p = V(-0.239, 0, 0);
    return find_contact(model, x).on_passive.f.norm();
  };
  const double common = find_force("", "");
  EXPECT_NEAR(find_force("half", ""), common / 2, 1e-9 * common);
  EXPECT_NEAR(find_force("half", "double"), 2 * common, 1e-9 * common);
  EXPECT_THROW(find_force("quarter", ""), ModelError);
}

TEST(Surfaces, SegmentOnPlateIsTheLowestPoint) {
  TestRandom random(94);
  const double mu = 1e-4;
  Worst worst;
  for (int i = 0; i < 2000; ++i) {
    const std::array<V, 4> corner = {V(0, -0.2, -0.2), V(0, 0.2, -0.2), V(0, 0.15, 0.2),
                                     V(0, -0.15, 0.2)};
    const Plate<double> plate = make_plate<double>(corner);
    const V a = random.vector(0.3), d = random.vector(0.3);
    const Closest<double> c = find_segment_plate<double>(a, d, plate, mu);
    // For every point of the segment, the best point of the plate by alternating projection.
    double least = std::numeric_limits<double>::max();
    for (int k = 0; k <= 50; ++k) {
      const V p = a + d * (k / 50.0);
      const V pulled = (p + mu * plate.centre) / (1.0 + mu);
      const V q = find_point_plate<double>(pulled, plate).second;
      least = std::min(least, (p - q).squaredNorm() + mu * ((p - a - d / 2).squaredNorm() +
                                                            (q - plate.centre).squaredNorm()));
    }
    worst.add(std::max(c.square - least, 0.0), i);
    EXPECT_NEAR(c.square,
                (c.first - c.second).squaredNorm() + mu * ((c.first - a - d / 2).squaredNorm() +
                                                           (c.second - plate.centre).squaredNorm()),
                1e-15);
  }
  EXPECT_WORST_BELOW(worst, 1e-13);
}

std::string find_refusal(const Cores& active, const Cores& passive,
                         const std::vector<GroupPair>& pairs) {
  try {
    make_surface_contact(active, passive, pairs, {}, {});
  } catch (const ModelError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Surfaces, HardwareThatMakesNoSenseIsRefused) {
  const auto expect = [&](const Cores& active, const Cores& passive,
                          const std::vector<GroupPair>& pairs, const char* text) {
    const std::string found = find_refusal(active, passive, pairs);
    EXPECT_NE(found.find(text), std::string::npos) << found;
  };
  const Cores probe = make_probe(), drogue = make_drogue();
  expect(probe, drogue, {{"head", "ring", ""}}, "no two cores of opposite sides have");
  expect(probe, drogue, {{"head", "rod", ""}}, "no two cores of opposite sides have");
  expect(probe, drogue, {}, "nothing could touch");
  expect(probe, drogue, {{"head", "cone", ""}, {"cone", "head", ""}}, "twice");
  expect(probe, drogue, {{"head", "cone", "soft"}}, "contact.laws lacks");
  Cores fat = probe;
  fat[0].core.rounding = 0.044;  // 46 mm with the drogue, whose socket has a radius of 45 mm
  expect(fat, drogue, {{"head", "cone", ""}}, "has a radius of 0.045 m");
  EXPECT_EQ(find_refusal(fat, drogue, {{"head", "floor", ""}}), "accepted");
  expect(drogue, drogue, {{"cone", "cone", ""}}, "both surfaces of revolution");
  Core plate = make_plate_core(
      "fin", make_plate<double>({V(0, 0, 0), V(0, 0, 1), V(1, 0, 1), V(1, 0, 0)}), 0.01);
  expect({named(plate)}, drogue, {{"fin", "rim", ""}}, "'edges'");
  Cores many;
  for (int i = 0; i <= kMaxSurfaces; ++i) {
    many.push_back(named(make_point("p" + std::to_string(i), V::Zero(), 0.01)));
  }
  expect(many, drogue, {{"p1", "cone", ""}}, "more than 16 groups");
}

}  // namespace
}  // namespace dockloop
