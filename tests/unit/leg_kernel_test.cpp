// Legs in vector lanes against the general code.
// 1. inertia, slides, rates, accelerations of a ring on a base at rest, on a driven base under
//    gravity and on a free vehicle, with legs of any mass properties and cut points beside the
//    slide: 1e-13;
// 2. the same bits with two, four and eight lanes, and from run to run;
// 3. near a singular pose and for other mechanisms the general code takes over;
// 4. three to sixty legs.
#include "kernels/leg_kernel.hpp"

#include <gtest/gtest.h>

#include "kernels/leg_lanes.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

enum class Root { kResting, kDriven, kFree };

struct LegCase {
  const char* name;
  Root root;
  bool general;  ///< mass properties and cut points without any symmetry
};

MechanismModel read_model(const std::string& path) {
  std::ifstream file(path);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return read_mechanism(text, path);
}

MechanismModel make_model(const LegCase& at, TestRandom& random) {
  MechanismModel model = read_mechanism(read_test_file("hexapod_r2p1r3.json"), "hexapod");
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

/// Independent states, loads and motion of the base at random.
void put_random_state(const Mechanism& mechanism, Root root, TestRandom& random,
                      MechanismData<double>& data, BaseMotion<double>& base) {
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[i];
    const bool is_vehicle = body.parent == kBase && root == Root::kFree;
    data.tree.q.segment<3>(body.q_index) = random.vector(is_vehicle ? 3.0 : 0.05);
    const Vec3<double> turn = random.vector(is_vehicle ? 1.0 : 0.1);
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
    put_random_state(mechanism, at.root, random, general, base);
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
    for (const Body& slide : mechanism.model.bodies) {
      if (slide.joint != JointType::kPrismatic) continue;
      worst.add(data.tree.q[slide.q_index] - general.tree.q[slide.q_index], where + ", slide");
      worst.add(data.tree.v[slide.v_index] - general.tree.v[slide.v_index], where + ", rate");
    }
    for (int i : mechanism.plan.ind_bodies) {
      worst.add(find_relative_error(data.tree.R[i], general.tree.R[i]), where + ", R");
      worst.add(find_relative_error(data.tree.p[i], general.tree.p[i]), where + ", p");
      worst.add(find_relative_error(data.tree.w[i], general.tree.w[i]), where + ", w");
      worst.add(find_relative_error(data.tree.u[i], general.tree.u[i]), where + ", u");
    }
    if (at.root == Root::kFree) {
      worst.add(data.tree.m_sum[0] / general.tree.m_sum[0] - 1.0, where + ", mass");
      worst.add(find_relative_error(data.tree.h_sum[0], general.tree.h_sum[0]), where + ", h");
    }
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-13);
}

INSTANTIATE_TEST_SUITE_P(
    roots, LegKernels,
    ::testing::Values(LegCase{"resting", Root::kResting, false},
                      LegCase{"resting_general", Root::kResting, true},
                      LegCase{"driven", Root::kDriven, false},
                      LegCase{"driven_general", Root::kDriven, true},
                      LegCase{"free", Root::kFree, false},
                      LegCase{"free_general", Root::kFree, true}),
    [](const ::testing::TestParamInfo<LegCase>& at) { return std::string(at.param.name); });

TEST(LegKernel, serves_the_shipped_hexapods) {
  for (const char* name : {"hexapod_bench", "idss_hexapod"}) {
    Mechanism mechanism(
        read_model(std::string(DOCKLOOP_MODELS) + "/mechanisms/" + name + ".json"));
    close_home(mechanism, name);
    EXPECT_TRUE(make_leg_kernel(mechanism)) << name;
  }
}

TEST(LegKernel, leaves_other_mechanisms_alone) {
  for (const char* name : {"crank_nested.json", "planar_two_loop.json"}) {
    EXPECT_FALSE(make_leg_kernel(Mechanism(read_mechanism(read_test_file(name), name)))) << name;
  }
}

}  // namespace
}  // namespace dockloop
