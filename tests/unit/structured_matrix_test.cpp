// The structured matrix of a docking compared with the exact Jacobian by dual numbers.
// 1. a solution of 1/g - A differs from one with the Jacobian by what the matrix leaves out: in
//    contact of every kind of surface, with latches open, held and releasing, apart, on an
//    absorber, with one vehicle immobile, with a loop between capture body and base, on fingers of
//    which one follows another, without a mechanism that moves; without the matrix the difference
//    is of order one where something is stiff;
// 2. momentum: what it takes from one vehicle it gives the other, to rounding;
// 3. no call allocates memory.
#include "docking/structured_matrix.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "unit/allocations.hpp"
#include "unit/random_docking.hpp"

namespace dockloop {
namespace {

constexpr int kTrials = 8;
constexpr double kShort = 1e-3, kLong = 1e-2;  ///< g [s]
/// Depth [m] at which normals that turn, left out, matter little.
constexpr double kSlight = 5e-5;

template <int kVehicle>
Scene ring_with_an_immobile_vehicle() {
  Scene scene = ring();
  scene.motion[kVehicle] = Motion::kFixed;
  return scene;
}
Scene ring_driven() {
  Scene scene = ring();
  scene.motion[kChaser] = Motion::kDriven;
  return scene;
}
/// An absorber on a mechanism.
Scene on_mechanism(nlohmann::json mechanism) {
  nlohmann::json scene = nlohmann::json::parse(read_test_file("scene_minimal.json"));
  mechanism["contact"] = scene["mechanism"]["contact"];
  scene["mechanism"] = std::move(mechanism);
  return read_scene(scene.dump(), "test");
}
/// A slide with a spring and a brake that sticks.
Scene braked_slide() {
  return on_mechanism(nlohmann::json::parse(R"({
    "name": "slide", "capture": {"body": "block"},
    "bodies": [{"name": "block", "parent": "base", "mass": 40, "com": [0.1, 0.2, 0],
                "inertia": [[2, 0, 0], [0, 3, 0], [0, 0, 4]],
                "joint": {"type": "prismatic", "axis": [1, 0, 0]}}],
    "forces": [{"name": "one", "along": [{"joint": "block", "ratio": 1}],
                "laws": [{"type": "spring", "stages": [[0, 2e4]]},
                         {"type": "brake", "forward": 200, "presliding": 1e-3}]}]})"));
}
/// The capture body is the rod of a slider and crank: a loop determines its joints.
Scene slider_crank() {
  auto scene = nlohmann::json::parse(read_test_file("scene_slider_crank.json"));
  scene["mechanism"]["capture"]["body"] = "rod";
  return on_mechanism(scene["mechanism"]);
}

struct MatrixCase {
  const char* name;
  std::function<Scene()> scene;
  double depth, lateral, tilt;
  std::optional<PairKind> touching;
  LatchMode latches;
  bool locked;
  double least, most;  ///< differences at kShort and kLong: three times those measured
};
void PrintTo(const MatrixCase& at, std::ostream* out) { *out << at.name; }

Docking draw(const MatrixCase& at, const Scene& scene, TestRandom& random) {
  return draw_docking(at.touching, [&] {
    Docking docking(scene);
    docking.set_random_state(random, at.depth, at.lateral, at.tilt);
    docking.t = 7.02;
    for (int i = 0; i < docking.model.latches.count(); ++i) {
      docking.discrete.latch[static_cast<size_t>(i)] = {at.latches, 7.0 - 0.01 * i};
    }
    return docking;
  });
}

/// Units in which states are of equal size: metres and metres per second at the vehicles.
VecX<double> find_scales(const Docking& docking) {
  const StateLayout& layout = docking.model.layout;
  VecX<double> scale = VecX<double>::Ones(layout.size);
  for (int i : {kChaser, kTarget}) {
    if (layout.momentum[i] < 0) continue;
    const double mass = docking.scene.vehicle[i].mass;
    scale.segment<3>(layout.momentum[i]).setConstant(mass);
    scale.segment<3>(layout.momentum[i] + 3).setConstant(15.0 * 15.0 * mass);  // arm to O
  }
  return scale;
}

struct Compared {
  double with = 0.0, without = 0.0;  ///< differences from the exact solution, relative
};

/// (1/g - A)^-1 x against (1/g - J)^-1 x for a random x.
Compared compare(Docking& docking, double g, TestRandom& random) {
  const StateLayout& layout = docking.model.layout;
  // Sums have no part in the matrix.
  VecX<int> part(layout.sums + layout.element_bristle_count);
  for (int i = 0; i < part.size(); ++i) {
    part[i] = i < layout.sums ? i : layout.element_bristles + i - layout.sums;
  }
  DockingPass pass(docking.model);
  pass.data.locked = docking.data.locked;
  MatX<double> J = MatX<double>::Zero(docking.model.layout.size, docking.model.layout.size);
  EXPECT_TRUE(calc_docking_jacobian(docking.model, docking.discrete, docking.memory, docking.data,
                                    docking.loads, docking.t, docking.y.data(), pass, J)
                  .ok());
  std::vector<double> block(static_cast<size_t>(find_mechanism_block_size(docking.model)));
  if (!docking.data.locked) {
    EXPECT_TRUE(calc_mechanism_block(docking.model, docking.discrete, docking.memory, docking.data,
                                     docking.loads, docking.t, docking.y.data(), pass, block.data())
                    .ok());
  }
  StructuredMatrix matrix(docking.model);
  matrix.build(docking.model, docking.discrete, docking.memory, docking.data, docking.t,
               docking.y.data(), block.data());
  EXPECT_TRUE(matrix.factor(g));

  const VecX<double> scale = find_scales(docking);
  VecX<double> x(docking.model.layout.size);
  for (int i = 0; i < x.size(); ++i) x[i] = scale[i] * random.uniform(-1, 1);
  // Attitudes change along the quaternion's own directions only.
  for (int i : {kChaser, kTarget}) {
    const int pose = docking.model.layout.pose[i];
    if (pose < 0) continue;
    const Eigen::Map<const Vec4<double>> q(docking.y.data() + pose + 3);
    Eigen::Map<Vec4<double>> rate(x.data() + pose + 3);
    rate = quat_rate<double>(q, random.vector(0.1));
  }
  int q = docking.model.layout.mechanism_q;
  for (int i : docking.model.mechanism_bodies) {
    if (docking.model.mechanism.model.bodies[i].joint == JointType::kFree) {
      const Eigen::Map<const Vec4<double>> attitude(docking.y.data() + q + 3);
      Eigen::Map<Vec4<double>> rate(x.data() + q + 3);
      rate = quat_rate<double>(attitude, random.vector(1.0));
    }
    q += docking.model.mechanism.model.bodies[i].nq();
  }
  if (docking.data.locked)
    x.head(docking.model.layout.mechanism_nq + docking.model.layout.mechanism_nv).setZero();
  VecX<double> found = x;
  matrix.solve(found.data());
  MatX<double> shifted = -J(part, part);
  shifted.diagonal().array() += 1.0 / g;
  const VecX<double> exact = shifted.partialPivLu().solve(VecX<double>(x(part)));
  const VecX<double> units = scale(part);
  const auto find_distance = [&](const VecX<double>& other) {
    const VecX<double> away = other(part) - exact;
    return away.cwiseQuotient(units).norm() / exact.cwiseQuotient(units).norm();
  };
  for (int i = layout.sums; i < layout.sums + layout.sum_count; ++i) EXPECT_EQ(found[i], g * x[i]);
  return {find_distance(found), find_distance(g * x)};
}

class StructuredMatrices : public ::testing::TestWithParam<MatrixCase> {};

TEST_P(StructuredMatrices, solve_nearly_as_the_jacobian_does) {
  const MatrixCase& at = GetParam();
  const Scene scene = at.scene();
  for (const double g : {kShort, kLong}) {
    TestRandom random(81);
    Compared worst;
    for (int trial = 0; trial < kTrials; ++trial) {
      Docking docking = draw(at, scene, random);
      LockedMechanism locked;
      if (at.locked) {
        std::fill_n(docking.y.begin() + docking.model.layout.mechanism_v,
                    docking.model.layout.mechanism_nv, 0.0);
        docking.evaluate();
        lock_mechanism(docking.model, docking.data, locked);
        if (!docking.try_evaluate().ok()) continue;
      }
      const Compared found = compare(docking, g, random);
      worst.with = std::max(worst.with, found.with);
      worst.without = std::max(worst.without, found.without);
    }
    std::printf("%s, g = %g s: %.1e, without %.1e\n", at.name, g, worst.with, worst.without);
    EXPECT_LT(worst.with, g == kShort ? at.least : at.most);
    EXPECT_GT(worst.without, worst.with);
  }
}

constexpr PairKind kPointAnnulus = PairKind::kPointAnnulus,
                   kSegmentAnnulus = PairKind::kSegmentAnnulus, kPlatePlate = PairKind::kPlatePlate,
                   kPointPlate = PairKind::kPointPlate;
constexpr auto kNone = std::nullopt;
constexpr LatchMode kOpen = LatchMode::kOpen, kHeld = LatchMode::kHeld,
                    kReleasing = LatchMode::kReleasing, kSpent = LatchMode::kSpent;

INSTANTIATE_TEST_SUITE_P(
    cases, StructuredMatrices,
    ::testing::Values(
        MatrixCase{"apart", ring, -0.05, 0.2, 0.12, kNone, kSpent, false, 5.4e-3, 4.8e-2},
        MatrixCase{"nodes_on_ring", ring, kSlight, 4e-3, 2e-3, kPointAnnulus, kSpent, false, 4.8e-3,
                   4.2e-2},
        MatrixCase{"edge_on_ring", ring, kSlight, 0.2, 0.12, kSegmentAnnulus, kSpent, false, 9.3e-4,
                   4.2e-3},
        MatrixCase{"petal_on_petal", ring, kSlight, 0.2, 0.12, kPlatePlate, kSpent, false, 2.7e-3,
                   7.5e-3},
        MatrixCase{"node_on_petal", ring, kSlight, 0.4, 0.3, kPointPlate, kSpent, false, 2.5e-2,
                   3.3e-1},
        MatrixCase{"nodes_deep_in_ring", ring, 1e-3, 4e-3, 2e-3, kPointAnnulus, kSpent, false,
                   8.7e-2, 5.1e-2},
        MatrixCase{"petal_deep_in_petal", ring, 2e-3, 0.2, 0.12, kPlatePlate, kSpent, false, 7.8e-2,
                   3e-1},
        MatrixCase{"into_the_barrier", ring, 7e-3, 0.05, 0.05, kSegmentAnnulus, kSpent, false,
                   3.3e-1, 6.3e-1},
        MatrixCase{"latches_open", ring_without_surfaces, -0.01, 0.0, 0.03, kNone, kOpen, false,
                   7.2e-2, 3.3e-1},
        MatrixCase{"latches_held", ring_without_surfaces, -0.0055, 0.0, 0.003, kNone, kHeld, false,
                   2e-2, 2.4e-1},
        MatrixCase{"latches_releasing", ring_without_surfaces, -0.0055, 0.0, 0.003, kNone,
                   kReleasing, false, 1.2e-2, 5.4e-2},
        MatrixCase{"latches_far_pulled", ring_without_surfaces, -0.012, 0.0, 0.01, kNone, kHeld,
                   false, 2.7e-1, 3e-1},
        MatrixCase{"absorber", absorber, 2e-3, 0.0, 0.1, kNone, kSpent, false, 8.1e-6, 2.3e-4},
        MatrixCase{"brake", braked_slide, 2e-3, 0.0, 0.1, kNone, kSpent, false, 2.3e-3, 6.6e-3},
        MatrixCase{"loop", slider_crank, 2e-3, 0.0, 0.1, kNone, kSpent, false, 7.2e-3, 1.3e-2},
        MatrixCase{"immobile_chaser", ring_with_an_immobile_vehicle<kChaser>, kSlight, 0.2, 0.12,
                   kSegmentAnnulus, kSpent, false, 1.3e-3, 9e-3},
        MatrixCase{"immobile_target", ring_with_an_immobile_vehicle<kTarget>, kSlight, 0.2, 0.12,
                   kSegmentAnnulus, kSpent, false, 2.2e-3, 8.7e-3},
        MatrixCase{"driven_chaser", ring_driven, kSlight, 0.2, 0.12, kSegmentAnnulus, kSpent, false,
                   2.7e-3, 2.5e-2},
        MatrixCase{"forces_between_the_vehicles", ring_with_forces, -0.3, 0.2, 0.12, kNone, kSpent,
                   false, 6e-3, 4.5e-2},
        MatrixCase{"hooks_of_fingers", fingers, kSlight, 0.02, 0.02, PairKind::kSegmentRevolution,
                   kSpent, false, 4.2e-3, 9.6e-2},
        MatrixCase{"pad_of_a_finger", fingers, kSlight, 0.05, 0.05, kPointPlate, kSpent, false,
                   3.6e-3, 1.2e-2},
        MatrixCase{"locked_fingers", fingers, kSlight, 0.02, 0.02, PairKind::kSegmentRevolution,
                   kSpent, true, 4.8e-5, 6.3e-4},
        MatrixCase{"locked", ring, kSlight, 0.2, 0.12, kSegmentAnnulus, kSpent, true, 7.5e-6,
                   1.8e-4}),
    [](const ::testing::TestParamInfo<MatrixCase>& at) { return std::string(at.param.name); });

TEST(StructuredMatrix, solves_nearly_as_the_jacobian_does_with_hooks_and_a_rigid_joint) {
  for (const bool is_joined : {false, true}) {
    for (const double g : {kShort, kLong}) {
      TestRandom random(84);
      Compared worst;
      for (int trial = 0; trial < kTrials; ++trial) {
        Docking docking(ring_with_hooks());
        docking.set_random_state(random, -0.0055, 0.0, 0.003);
        dock(docking, random);
        for (LatchState& latch : docking.discrete.latch) latch = {LatchMode::kSpent, 0.0};
        LockedMechanism locked;
        if (is_joined) join(docking, locked);
        docking.evaluate();
        const Compared found = compare(docking, g, random);
        worst.with = std::max(worst.with, found.with);
        worst.without = std::max(worst.without, found.without);
      }
      std::printf("%s, g = %g s: %.1e, without %.1e\n", is_joined ? "joint" : "hooks", g,
                  worst.with, worst.without);
      EXPECT_LT(worst.with, g == kShort ? 3e-2 : 3e-1);
      if (is_joined) continue;
      EXPECT_GT(worst.without, 2.0 * worst.with);
    }
  }
}

TEST(StructuredMatrix, keeps_momentum) {
  TestRandom random(82);
  Docking docking(ring_with_hooks());
  docking.set_random_state(random, -0.0055, 0.0, 0.003);
  docking.y[docking.model.layout.mechanism_q] -= 0.28;  // retracted: its latches hold the target
  dock(docking, random);
  for (LatchState& latch : docking.discrete.latch) latch = {LatchMode::kHeld, 0.0};
  docking.evaluate();
  ASSERT_GT(docking.data.hard_dock.face_force, 0.0);
  ASSERT_GT(docking.data.on_passive.f.norm(), 0.0);
  const StateLayout& layout = docking.model.layout;
  const std::vector<double> block(static_cast<size_t>(find_mechanism_block_size(docking.model)),
                                  -3.0);
  StructuredMatrix matrix(docking.model);
  matrix.build(docking.model, docking.discrete, docking.memory, docking.data, 0.0, docking.y.data(),
               block.data());
  for (const double g : {1e-4, 1e-2, 1.0}) {
    ASSERT_TRUE(matrix.factor(g));
    std::vector<double> x(static_cast<size_t>(layout.size));
    for (double& each : x) each = random.uniform(-1, 1);
    for (int j = 0; j < 6; ++j) x[layout.momentum[kTarget] + j] = -x[layout.momentum[kChaser] + j];
    matrix.solve(x.data());
    for (int j = 0; j < 6; ++j) {
      const double sum = x[layout.momentum[kTarget] + j] + x[layout.momentum[kChaser] + j];
      EXPECT_LE(std::abs(sum), 1e-15 * std::abs(x[layout.momentum[kTarget] + j]));
    }
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(StructuredMatrix, does_not_allocate) {
  TestRandom random(83);
  Docking docking(ring());
  docking.set_random_state(random, 2e-3);
  docking.evaluate();
  DockingPass pass(docking.model);
  StructuredMatrix matrix(docking.model);
  std::vector<double> block(static_cast<size_t>(find_mechanism_block_size(docking.model)));
  std::vector<double> x(docking.y.size(), 1.0);
  bool ok = true;
  EXPECT_EQ(count_allocations([&] {
              ok = calc_mechanism_block(docking.model, docking.discrete, docking.memory,
                                        docking.data, docking.loads, 0.0, docking.y.data(), pass,
                                        block.data())
                       .ok();
              matrix.build(docking.model, docking.discrete, docking.memory, docking.data, 0.0,
                           docking.y.data(), block.data());
              ok = ok && matrix.factor(1e-3);
              matrix.solve(x.data());
            }),
            0);
  EXPECT_TRUE(ok);
}
#endif

}  // namespace
}  // namespace dockloop
