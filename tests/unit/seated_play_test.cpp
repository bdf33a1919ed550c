// Seated play of two rings.
// 1. Stored dimensions have the play that was found by hand;
// 2. it is all that can be reached: a flood of a grid finds no striker further from its hook;
// 3. rings whose petals overlap cannot seat; without petals only the ends of the search stop them.
#include "contact/seated_play.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <set>
#include <vector>

#include "model/json_reader.hpp"
#include "unit/contact_test_support.hpp"

namespace dockloop {
namespace {

LatchSet make_three_latches() {
  LatchSet set;
  for (const double azimuth : {0.0, 120.0, 240.0}) {
    const Vec3<double> at(0.0, 0.6 * std::cos(azimuth * kDegree),
                          0.6 * std::sin(azimuth * kDegree));
    set.latch.push_back({LatchLaw(), at, at, LatchMeasure::kActiveAxis});
  }
  return set;
}

/// Wider petals on a larger circle leave less play.
GuideRing make_tight_ring() {
  GuideRing ring = make_test_ring();
  ring.petal_base_radius = 0.600;
  ring.petal_base_half_angle = 29.0 * kDegree;
  return ring;
}

/// Largest distance of a striker from its hook over all points of a grid that lead back to the
/// centre from neighbour to neighbour without a touch.
double find_by_flood(const ContactModel& model, const LatchSet& latches, double step, double turn) {
  ContactWorkspace<double> work(model);
  std::set<std::array<int, 3>> seen{{0, 0, 0}};
  std::vector<std::array<int, 3>> left{{0, 0, 0}};
  double largest = 0.0;
  while (!left.empty()) {
    const std::array<int, 3> at = left.back();
    left.pop_back();
    RelativeMotion<double> x;
    x.p = {1e-5, at[0] * step, at[1] * step};  // ring faces just apart
    x.R = rotation_of({at[2] * turn, 0.0, 0.0});
    if (find_gap<double>(model, {}, x, work) < 0.0) continue;
    for (int i = 0; i < latches.count(); ++i) {
      const Vec3<double> s = find_latch_motion(latches, i, x).s;
      largest = std::max(largest, s.tail<2>().norm());
    }
    for (int i = 0; i < 3; ++i) {
      for (const int by : {-1, 1}) {
        std::array<int, 3> next = at;
        next[i] += by;
        if (seen.insert(next).second) left.push_back(next);
      }
    }
  }
  return largest;
}

TEST(SeatedPlay, OfStoredDimensionsIsAsFoundByHand) {
  const LatchSet latches = make_three_latches();
  const SeatedPlay play = find_seated_play(make_test_contact(), latches);
  EXPECT_EQ(play.overlap, 0.0);
  EXPECT_NEAR(play.least_roll / kDegree, -2.4935, 1e-3);
  EXPECT_NEAR(play.most_roll / kDegree, 2.4935, 1e-3);
  EXPECT_NEAR(play.least_lateral, 20.01e-3, 1e-5);
  EXPECT_NEAR(play.most_lateral, 23.54e-3, 1e-5);
  EXPECT_NEAR(play.striker_offset, 39.01e-3, 2e-5);
  const GuideRing ring = make_tight_ring();
  const SeatedPlay tight = find_seated_play(make_ring_contact(ring, ring, {}), latches);
  EXPECT_NEAR(tight.most_roll / kDegree, 0.5553, 1e-3);
  EXPECT_NEAR(tight.least_lateral, 5.45e-3, 1e-5);
  EXPECT_NEAR(tight.most_lateral, 6.37e-3, 1e-5);
  EXPECT_NEAR(tight.striker_offset, 8.724e-3, 2e-5);
}

TEST(SeatedPlay, IsAllThatCanBeReachedFromTheCentre) {
  const LatchSet latches = make_three_latches();
  const GuideRing ring = make_tight_ring();
  constexpr double kStep = 0.5e-3, kTurn = 0.05 * kDegree;
  for (const auto& [model, scale] :
       {std::pair{make_test_contact(), 4.0}, std::pair{make_ring_contact(ring, ring, {}), 1.0}}) {
    const double found = find_seated_play(model, latches).striker_offset;
    const double flooded = find_by_flood(model, latches, scale * kStep, scale * kTurn);
    EXPECT_LE(flooded, found + 2e-5);
    EXPECT_GE(flooded, found - scale * (2 * kStep + 0.6 * kTurn));
  }
}

TEST(SeatedPlay, OfRingsThatCannotSeatIsNone) {
  GuideRing ring = make_test_ring();
  ring.petal_base_half_angle = 32.0 * kDegree;  // more than a sixth of the circle
  const SeatedPlay play = find_seated_play(make_ring_contact(ring, ring, {}), make_three_latches());
  EXPECT_GT(play.overlap, 1e-3);
  EXPECT_EQ(play.striker_offset, 0.0);
}

TEST(SeatedPlay, WithoutPetalsEndsWithTheSearch) {
  GuideRing ring = make_test_ring();
  ring.petal_count = 0;
  const ContactModel model = make_ring_contact(ring, ring, {});
  const SeatedPlay play = find_seated_play(model, make_three_latches());
  EXPECT_NEAR(play.most_roll, 180.0 * kDegree, 1e-12);
  EXPECT_NEAR(play.least_lateral, 2.0 * model.bounding_radius, 1e-12);
  EXPECT_GT(play.striker_offset, 2.0 * model.bounding_radius);
}

}  // namespace
}  // namespace dockloop
