// Legs in vector lanes against the general code.
// 1. inertia, coordinates and rates of joints that carry a force, accelerations and reactions of a
//    ring on a base at rest, on a driven base under gravity and on a free vehicle; on slide legs,
//    on crank legs of either order and on all of them together; with any mass properties and cut
//    points beside the legs: 1e-13;
// 2. the same bits with two, four and eight lanes, and from run to run;
// 3. near a singular pose and for other mechanisms the general code takes over;
// 4. three to sixty legs;
// 5. angles are right all around, and go on counting turns.
#include "mechanism/leg_kernel.hpp"

#include <gtest/gtest.h>

#include "loops/leg_lanes.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

enum class Root { kResting, kDriven, kFree };

struct LegCase {
  const char* name;
  Root root;
  bool general;                    ///< mass properties and cut points without any symmetry
  std::vector<LegKind> legs = {};  ///< of made-up legs; none: those of hexapod_r2p1r3
};

/// A joint of a leg in its canonical axes (closed_form.hpp) and where it stands at home.
struct LegStep {
  JointType type;
  Vec3<double> axis, point;  ///< point: on the body before, at its coordinate 0
  double home;
};

std::vector<LegStep> find_steps(LegKind kind, const Vec3<double>& elbow, double elbow_side) {
  const auto x = Vec3<double>::UnitX(), y = Vec3<double>::UnitY(), z = Vec3<double>::UnitZ();
  const Vec3<double> o = Vec3<double>::Zero();
  const JointType turn = JointType::kRevolute;
  if (kind == LegKind::kR2P1R3) {
    return {{turn, y, o, 0.2}, {turn, z, o, 0.3}, {JointType::kPrismatic, x, o, 0.1}};
  }
  if (kind == LegKind::kR1R2R3) {
    return {{turn, z, o, 0.3}, {turn, z, elbow, 1.1 * elbow_side}, {turn, y, o, -0.3}};
  }
  return {{turn, z, o, 0.3}, {turn, y, elbow, 0.4}, {turn, z, o, 0.8 * elbow_side}};
}

/// A free ring on legs, these kinds by turns: body axes, zeros and signs of joints, dimensions and
/// elbow sides at random, springs on first and last joints.
MechanismModel make_ring_on(const std::vector<LegKind>& kinds, TestRandom& random,
                            size_t count = 6) {
  MechanismModel model;
  model.name = "ring_on_legs";
  Body ring;
  ring.name = "ring";
  ring.joint = JointType::kFree;
  ring.placement = {rotation_of(random.vector(0.3)), {0.0, 0.0, 0.4}};
  ring.mass = 30.0;
  ring.com = random.vector(0.1);
  ring.inertia = make_inertia(random, 30.0, 0.4);
  model.bodies.push_back(ring);
  model.home_q = {0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
  model.capture_body = 0;
  for (size_t k = 0; k < count; ++k) {
    const LegKind kind = kinds[k % kinds.size()];
    const double side = random.uniform(-1.0, 1.0) < 0.0 ? -1.0 : 1.0;
    const Vec3<double> elbow(random.uniform(0.25, 0.4), 0.0, random.uniform(-0.1, 0.1));
    Vec3<double> tip(random.uniform(0.4, 0.6), 0.03, -0.05);
    if (kind == LegKind::kR1R2R3Perpendicular) tip.tail<2>().setZero();
    Pose<double> before{rotation_of(random.vector(2.0)), Vec3<double>::Zero()};  // canonical axes
    Pose<double> at = before;
    int parent = kBase;
    Loop loop;
    loop.name = "leg" + std::to_string(k + 1);
    for (const LegStep& step : find_steps(kind, elbow, side)) {
      const Mat3<double> axes = rotation_of(random.vector(2.0));
      const bool turns = step.type == JointType::kRevolute;
      const double sign = random.uniform(-1.0, 1.0) < 0.0 && turns ? -1.0 : 1.0;
      const double zero = turns ? random.uniform(-2.0, 2.0) : 0.0;
      Body body;
      body.name = loop.name + "_" + std::to_string(model.bodies.size());
      body.parent = parent;
      body.joint = step.type;
      body.placement = before * Pose<double>{rotation_of(zero * step.axis) * axes, step.point};
      body.axis = sign * (axes.transpose() * step.axis);
      body.mass = random.uniform(0.2, 3.0);
      body.com = random.vector(0.2);
      body.inertia = make_inertia(random, body.mass, 0.2);
      parent = static_cast<int>(model.bodies.size());
      model.bodies.push_back(body);
      loop.dependent.push_back(parent);
      model.home_q.push_back(sign * (step.home - zero));
      before = {axes.transpose(), Vec3<double>::Zero()};
      at.p += at.R * step.point;
      if (turns) at.R = at.R * rotation_of(step.home * step.axis);
      if (!turns) at.p += at.R * (step.home * step.axis);
    }
    loop.first = loop.dependent[0];
    loop.terminal = parent;
    loop.closing = 0;
    loop.point_on_terminal = before.R * tip;
    loop.point_on_closing = random.vector(0.5);
    // The leg stands where its tip is on the ring.
    model.bodies[static_cast<size_t>(loop.first)].placement.p =
        ring.placement.R * loop.point_on_closing + ring.placement.p - at.R * tip - at.p;
    model.loops.push_back(loop);
    for (const int joint : {0, 2}) {
      JointForce law;
      law.body = loop.dependent[static_cast<size_t>(joint)];
      law.stiffness = 100.0;
      model.forces.push_back(law);
    }
  }
  model.home_given = true;
  number_coordinates(model);
  check_mechanism(model);
  return model;
}

MechanismModel read_model(const std::string& path) {
  std::ifstream file(path);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return read_mechanism(text, path);
}

MechanismModel make_model(const LegCase& at, TestRandom& random) {
  MechanismModel model = at.legs.empty()
                             ? read_mechanism(read_test_file("hexapod_r2p1r3.json"), "hexapod")
                             : make_ring_on(at.legs, random);
  for (size_t i = 0; at.general && i < model.bodies.size(); ++i) {
    Body& body = model.bodies[i];
    body.mass = random.uniform(0.2, 3.0);
    body.com = random.vector(0.2);
    body.inertia = make_inertia(random, body.mass, 0.2);
  }
  for (size_t k = 0; at.general && k < model.loops.size(); ++k) {
    model.loops[k].point_on_terminal += Vec3<double>(0.0, 0.02, -0.03);
    model.home_given = false;  // closed anew
  }
  if (at.root != Root::kFree) return model;
  VehicleBody vehicle{900.0, {0.1, -0.2, 0.3}, make_inertia(random, 900.0, 1.0)};
  return attach_vehicle(model, vehicle, {rotation_of(Vec3<double>(0.3, -0.2, 0.5)), {1, 0.2, 0.1}});
}

/// Independent states, loads and motion of the base at random. @param far  of the ring from home
void put_random_state(const Mechanism& mechanism, Root root, TestRandom& random,
                      MechanismData<double>& data, BaseMotion<double>& base, double far = 1.0) {
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[i];
    const bool is_vehicle = body.parent == kBase && root == Root::kFree;
    data.tree.q.segment<3>(body.q_index) = random.vector(is_vehicle ? 3.0 : 0.05 * far);
    const Vec3<double> turn = random.vector(is_vehicle ? 1.0 : 0.1 * far);
    data.tree.q.segment<4>(body.q_index + 3) << 1.0, turn;  // of any norm
  }
  for (int i : mechanism.plan.ind_v) data.tree.v[i] = random.uniform(-0.5, 0.5);
  for (int i = 0; i < mechanism.model.nv; ++i) data.tau[i] = random.uniform(-100.0, 100.0);
  for (int i : mechanism.plan.ind_v) data.tau[i] = 0.0;
  for (int i : mechanism.plan.ind_bodies) {
    data.tree.external[i] = {random.vector(200.0), random.vector(50.0)};
  }
  base = BaseMotion<double>();
  if (root == Root::kResting) return;
  base.gravity = random.vector(9.0);
  if (root == Root::kFree) return;
  base.w = random.vector(0.5);
  base.alpha = random.vector(0.5);
  base.a = random.vector(2.0);
}

void evaluate(const Mechanism& mechanism, const BaseMotion<double>& base,
              MechanismData<double>& data) {
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  calc_velocity(mechanism, base, data);
  calc_acceleration(mechanism, base, data);
  calc_reactions(mechanism, base, mechanism.plan.ind_bodies.size() == 2 ? 0 : kBase, data);
}

/// The present pose becomes the reference of both, found by either way.
void compare_references(const Mechanism& mechanism, MechanismData<double>& data,
                        MechanismData<double>& general, const std::string& where, Residual& worst) {
  worst.add(data.kernel->find_margin() - find_singularity_margin(general), where + ", margin");
  data.kernel->keep_reference(data);
  keep_reference(general.tree, general.loops);
  const LoopReference<double>&found = data.loops.reference, &expected = general.loops.reference;
  for (size_t b = 0; b < mechanism.plan.blocks.size(); ++b) {
    worst.add(find_relative_error(found.H[b], expected.H[b]), where + ", H");
    worst.add(found.margin[b] - expected.margin[b], where + ", margin of a leg");
    EXPECT_EQ(found.sign[b], expected.sign[b]);
    EXPECT_EQ(found.branch[b].elbow, expected.branch[b].elbow);
    EXPECT_EQ(found.branch[b].flip, expected.branch[b].flip);
  }
  worst.add((found.q - expected.q).cwiseAbs().maxCoeff(), where + ", coordinates");
}

bool has_force(const MechanismModel& model, size_t body) {
  return std::any_of(model.forces.begin(), model.forces.end(),
                     [&](const JointForce& law) { return law.body == static_cast<int>(body); });
}

class LegKernels : public ::testing::TestWithParam<LegCase> {};

TEST_P(LegKernels, agree_with_the_general_code_in_any_number_of_lanes) {
  TestRandom random(7);
  const LegCase& at = GetParam();
  Mechanism mechanism(make_model(at, random));
  close_home(mechanism, "hexapod");
  MechanismData<double> general(mechanism);
  std::vector<MechanismData<double>> fast(3, general);
  for (int i = 0; i < 3; ++i) fast[i].kernel = make_leg_kernel(mechanism, 2 << i);
  ASSERT_TRUE(fast[0].kernel);
  Residual worst;
  for (int n = 0; n < 50; ++n) {
    BaseMotion<double> base;
    const double far = at.legs.empty() ? 1.0 : 0.2;  // cranks reach less far
    put_random_state(mechanism, at.root, random, general, base, far);
    for (MechanismData<double>& data : fast) {
      data.tree.q = general.tree.q;
      data.tree.v = general.tree.v;
      data.tau = general.tau;
      data.tree.external = general.tree.external;
      evaluate(mechanism, base, data);
      ASSERT_TRUE(data.by_kernel);
      EXPECT_EQ(data.vdot, fast[0].vdot);  // to the last bit
      EXPECT_EQ(data.A_ind, fast[0].A_ind);
      EXPECT_EQ(data.tree.q, fast[0].tree.q);
      EXPECT_EQ(data.tree.v, fast[0].tree.v);
    }
    evaluate(mechanism, base, general);
    const MechanismData<double>& data = fast[2];
    const std::string where = "state " + std::to_string(n);
    VecX<double> expected(mechanism.plan.ind_v.size()), actual(expected);
    for (int i = 0; i < expected.size(); ++i) {
      expected[i] = general.vdot[mechanism.plan.ind_v[i]];
      actual[i] = data.vdot[mechanism.plan.ind_v[i]];
    }
    worst.add(find_relative_error(actual, expected), where + ", accelerations");
    worst.add(find_relative_error(data.A_ind, general.A_ind), where + ", inertia");
    for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
      const Body& body = mechanism.model.bodies[i];
      if (body.joint != JointType::kPrismatic && !has_force(mechanism.model, i)) continue;
      worst.add(data.tree.q[body.q_index] - general.tree.q[body.q_index], where + ", coordinate");
      worst.add(data.tree.v[body.v_index] - general.tree.v[body.v_index], where + ", rate");
    }
    for (int i : mechanism.plan.ind_bodies) {
      worst.add(find_relative_error(data.tree.R[i], general.tree.R[i]), where + ", R");
      worst.add(find_relative_error(data.tree.p[i], general.tree.p[i]), where + ", p");
      worst.add(find_relative_error(data.tree.w[i], general.tree.w[i]), where + ", w");
      worst.add(find_relative_error(data.tree.u[i], general.tree.u[i]), where + ", u");
    }
    const auto add = [&](const auto& found, const auto& wanted, const char* what) {
      worst.add(find_relative_error(found, wanted), where + ", " + what);
    };
    add(data.on_base.f, general.on_base.f, "force on the base");
    add(data.on_base.t, general.on_base.t, "moment on the base");
    for (size_t b = 0; b < mechanism.plan.blocks.size(); ++b) {
      add(data.loops.block[b].lambda, general.loops.block[b].lambda, "cut force");
    }
    if (at.root == Root::kFree) {
      add(data.tree.a[0], general.tree.a[0], "a of the vehicle");
      add(data.tree.alpha[0], general.tree.alpha[0], "alpha of the vehicle");
      worst.add(data.tree.m_sum[0] / general.tree.m_sum[0] - 1.0, where + ", mass");
      worst.add(find_relative_error(data.tree.h_sum[0], general.tree.h_sum[0]), where + ", h");
    }
    compare_references(mechanism, fast[2], general, where, worst);
    for (MechanismData<double>& each : fast) each.loops.reference = general.loops.reference;
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-13);
}

const std::vector<LegKind> kCranks = {LegKind::kR1R2R3};
const std::vector<LegKind> kSquare = {LegKind::kR1R2R3Perpendicular};
const std::vector<LegKind> kMixed = {LegKind::kR1R2R3, LegKind::kR2P1R3,
                                     LegKind::kR1R2R3Perpendicular};

INSTANTIATE_TEST_SUITE_P(
    roots, LegKernels,
    ::testing::Values(
        LegCase{"resting", Root::kResting, false}, LegCase{"resting_general", Root::kResting, true},
        LegCase{"driven", Root::kDriven, false}, LegCase{"driven_general", Root::kDriven, true},
        LegCase{"free", Root::kFree, false}, LegCase{"free_general", Root::kFree, true},
        LegCase{"resting_cranks", Root::kResting, false, kCranks},
        LegCase{"driven_cranks", Root::kDriven, false, kCranks},
        LegCase{"free_cranks", Root::kFree, false, kCranks},
        LegCase{"resting_square", Root::kResting, false, kSquare},
        LegCase{"driven_square", Root::kDriven, false, kSquare},
        LegCase{"free_square", Root::kFree, false, kSquare},
        LegCase{"resting_mixed", Root::kResting, false, kMixed},
        LegCase{"driven_mixed", Root::kDriven, false, kMixed},
        LegCase{"free_mixed", Root::kFree, false, kMixed}),
    [](const ::testing::TestParamInfo<LegCase>& at) { return std::string(at.param.name); });

TEST(LegKernel, serves_the_shipped_hexapods) {
  for (const char* name : {"hexapod_bench", "idss_hexapod"}) {
    Mechanism mechanism(read_model(std::string(DOCKLOOP_MODELS) + "/mechanisms/" + name + ".json"));
    close_home(mechanism, name);
    EXPECT_TRUE(make_leg_kernel(mechanism)) << name;
  }
}

/// A ring on `count` legs around it.
MechanismModel make_ring_on_legs(int count) {
  nlohmann::json legs = nlohmann::json::array();
  for (int k = 0; k < count; ++k) {
    const double at = 2.0 * 3.14159265358979 * k / count, lean = k % 2 == 0 ? 0.4 : -0.4;
    legs.push_back(
        {{"name", "leg" + std::to_string(k + 1)},
         {"root_point", {0.65 * std::cos(at), 0.65 * std::sin(at), 0.0}},
         {"closing_point", {0.6 * std::cos(at + lean), 0.6 * std::sin(at + lean), 0.0}}});
  }
  std::ifstream file(std::string(DOCKLOOP_MODELS) + "/mechanisms/hexapod_bench.json");
  nlohmann::json document = nlohmann::json::parse(file);
  document["legs"] = legs;
  return read_mechanism(document.dump(), "ring on legs");
}

TEST(LegKernel, serves_any_number_of_legs) {
  for (const int count : {3, 7, 8, 9, 24, 60}) {
    TestRandom random(11);
    Mechanism mechanism(make_ring_on_legs(count));
    close_home(mechanism, "ring on legs");
    MechanismData<double> general(mechanism), fast(general);
    fast.kernel = make_leg_kernel(mechanism);
    ASSERT_TRUE(fast.kernel) << count;
    BaseMotion<double> base;
    put_random_state(mechanism, Root::kDriven, random, general, base);
    fast.tree.q = general.tree.q;
    fast.tree.v = general.tree.v;
    fast.tau = general.tau;
    fast.tree.external = general.tree.external;
    evaluate(mechanism, base, general);
    evaluate(mechanism, base, fast);
    ASSERT_TRUE(fast.by_kernel);
    EXPECT_LE(find_relative_error(fast.vdot.head<6>(), general.vdot.head<6>()), 1e-13) << count;
    EXPECT_LE(find_relative_error(fast.on_base.f, general.on_base.f), 1e-13) << count;
  }
}

TEST(LegKernel, leaves_poses_near_a_singular_one_to_the_general_code) {
  Mechanism mechanism(make_ring_on_legs(6));
  close_home(mechanism, "ring on legs");
  MechanismData<double> data(mechanism);
  data.kernel = make_leg_kernel(mechanism);
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  EXPECT_TRUE(data.by_kernel);
  // A leg along the first axis of its universal joint: its centre and the tip on that axis.
  const ClosedForm& form = *mechanism.plan.blocks[0].form();
  const Vec3<double> wanted = form.in_parent.p + 0.5 * form.in_parent.R.col(1);
  const Vec3<double> tip = mechanism.model.loops[0].point_on_closing;
  const Body& ring = mechanism.model.bodies[mechanism.plan.ind_bodies[0]];
  data.tree.q.segment<3>(ring.q_index) =
      ring.placement.R.transpose() * (wanted - ring.placement.p) - tip +
      Vec3<double>(0.0, 0.0, 0.02);
  calc_position(mechanism, data);
  EXPECT_FALSE(data.by_kernel);
  // A reference pose on another branch, or close to a singular one, is not the kernel's either.
  data.tree.q.head(mechanism.model.nq) =
      Eigen::Map<const VecX<double>>(mechanism.model.home_q.data(), mechanism.model.nq);
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  ASSERT_TRUE(data.by_kernel);
  data.kernel->keep_reference(data);
  data.loops.reference.branch[2].flip *= -1;
  calc_position(mechanism, data);
  EXPECT_FALSE(data.by_kernel);
  data.loops.reference.branch[2].flip *= -1;
  data.loops.reference.margin[3] = 0.2;
  calc_position(mechanism, data);
  EXPECT_FALSE(data.by_kernel);
}

TEST(LegKernel, leaves_crank_legs_near_a_singular_pose_to_the_general_code) {
  for (const LegKind kind : {LegKind::kR1R2R3, LegKind::kR1R2R3Perpendicular}) {
    TestRandom random(3);
    Mechanism mechanism(make_ring_on({kind}, random, 1));
    close_home(mechanism, "ring on a crank leg");
    MechanismData<double> data(mechanism);
    data.kernel = make_leg_kernel(mechanism);
    ASSERT_TRUE(data.kernel);
    ASSERT_TRUE(calc_position(mechanism, data).ok());
    EXPECT_TRUE(data.by_kernel);
    const ClosedForm& form = *mechanism.plan.blocks[0].form();
    const LegShape& shape = form.shape;
    const bool parallel = kind == LegKind::kR1R2R3;
    const double rod = parallel ? shape.tip.norm() : shape.l2;
    const Body& ring = mechanism.model.bodies[0];
    const auto reaches = [&](double x, double y, double z) {  // the tip to there, canonical axes
      const Vec3<double> tip = form.in_parent.p + form.in_parent.R * Vec3<double>(x, y, z);
      data.tree.q.segment<3>(0) = ring.placement.R.transpose() * (tip - ring.placement.p) -
                                  mechanism.model.loops[0].point_on_closing;
      return data.kernel->calc_position(data);
    };
    // Crank and rod level and in one line: less is fine, all but that and more are not.
    const double stretched = shape.l1 + rod;
    EXPECT_TRUE(reaches(0.95 * stretched, 0.0, shape.height));
    EXPECT_FALSE(reaches((1.0 - 1e-4) * stretched, 0.0, shape.height));
    EXPECT_FALSE(reaches((1.0 + 1e-4) * stretched, 0.0, shape.height));
    // The rod along the first axis of its universal joint.
    const double up = parallel ? 0.999 * std::hypot(shape.tip.x(), shape.tip.z()) : 0.0;
    EXPECT_FALSE(reaches(shape.l1, parallel ? 0.0 : rod, shape.height + up));
  }
}

TEST(LegKernel, counts_the_turns_of_joints_with_a_force_that_depends_on_them) {
  TestRandom random(5);
  const MechanismModel model = make_ring_on({LegKind::kR1R2R3}, random);
  Mechanism mechanism(model);
  close_home(mechanism, "ring on crank legs");
  MechanismData<double> data(mechanism);
  data.kernel = make_leg_kernel(mechanism);
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  const int at = model.bodies[static_cast<size_t>(model.loops[4].first)].q_index;
  const double home = data.tree.q[at], turn = 2.0 * 3.14159265358979323846;
  data.tree.q[at] = home + turn + 0.3;  // where the search starts
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  EXPECT_NEAR(data.tree.q[at], home + turn, 1e-14);
  keep_reference(data);
  data.loops.reference.q[at] = home - 2.0 * turn;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  ASSERT_TRUE(data.by_kernel);
  EXPECT_NEAR(data.tree.q[at], home - 2.0 * turn, 1e-14);
}

TEST(LegKernel, finds_angles_to_rounding_all_around) {
  for (const int widest : {2, 4, 8}) {
    const legs::LegFunctions& functions = legs::find_leg_functions(widest);
    Residual worst;
    for (int n = -2000; n <= 2000; ++n) {
      legs::LegGroup group{};
      const double step = 3.14159265358979323846 / 2000.0, angle = n * step;
      for (int lane = 0; lane < kGroup; ++lane) {
        group.work[legs::kTurns + 2][lane] = std::cos(angle + 0.1 * lane * step);
        group.work[legs::kTurns + 3][lane] = std::sin(angle + 0.1 * lane * step);
      }
      functions.calc_angles(&group, 1, 1);
      for (int lane = 0; lane < kGroup; ++lane) {
        const double expected =
            std::atan2(group.work[legs::kTurns + 3][lane], group.work[legs::kTurns + 2][lane]);
        worst.add(group.work[legs::kAngles + 1][lane] - expected, std::to_string(expected));
      }
    }
    EXPECT_RESIDUAL_BELOW(worst, 1e-15);
  }
}

TEST(LegKernel, is_not_asked_where_everything_is_wanted) {
  Mechanism mechanism(make_ring_on_legs(6));
  close_home(mechanism, "ring on legs");
  MechanismData<double> data(mechanism);
  data.kernel = make_leg_kernel(mechanism);
  data.whole = true;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  EXPECT_FALSE(data.by_kernel);
}

TEST(LegKernel, leaves_other_mechanisms_alone) {
  for (const char* name : {"crank_nested.json", "planar_two_loop.json"}) {
    EXPECT_FALSE(make_leg_kernel(Mechanism(read_mechanism(read_test_file(name), name)))) << name;
  }
}

}  // namespace
}  // namespace dockloop
