// Motions of mechanisms on their own against motions that other programs computed.
// 1. two stored trajectories of 1 s: positions and velocities to 1e-9 and better;
// 2. a free-floating hexapod, ring and base both moving: accelerations at the start, momentum,
//    energy, and the whole state after 2 s to the digits in which the reference is stated;
// 3. a ring on six legs: accelerations at the start and the motion over 0.5 s.
//
// The reduced equations are integrated by Stepper (the product's integrator) at a tolerance far
// below what is asked.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "integrate/stepper.hpp"
#include "mechanism/joint_forces.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;

/// A mechanism on a base at rest that moves under its joint forces.
class FreeMotion {
 public:
  explicit FreeMotion(MechanismModel model) : mechanism(std::move(model)), data(mechanism) {
    command.setZero(static_cast<int>(mechanism.model.forces.size()));
    force = command;
    base.gravity = mechanism.model.gravity;
    const int size = static_cast<int>(mechanism.plan.ind_q.size() + mechanism.plan.ind_v.size());
    Stepper::Problem problem;
    problem.size = size + 1;  // and the energy dissipated
    problem.rates = [this, size](double, const double* y, double* ydot) {
      if (!rates(y, ydot).ok()) return 1;
      ydot[size] = sums.dissipation;
      return 0;
    };
    stepper = std::make_unique<Stepper>(std::move(problem));
  }

  Status rates(const double* y, double* ydot) {
    const auto put_loads = [this](MechanismData<double>& d) {
      d.tau.setZero();
      sums = calc_joint_forces<double>(mechanism.model, d.tree.q, d.tree.v, command, force, d.tau);
    };
    return calc_reduced_rates<double>(mechanism, base, put_loads, y, ydot, data);
  }

  /// From the independents in data.tree.
  void start(double tolerance) {
    const std::vector<double> y = get_reduced_state(mechanism, data);
    std::copy(y.begin(), y.end(), stepper->y());
    stepper->y()[y.size()] = 0.0;
    const std::vector<double> atol(y.size() + 1, tolerance);
    stepper->set_tolerances(tolerance, atol.data());
    stepper->restart(0.0, 0.0);
    update();
  }

  void advance(double t) {
    while (stepper->time() < t) {
      ASSERT_NE(stepper->step(t, false), StepOutcome::kFailed);
    }
    update();
  }

  /// Everything at the present state into data.
  void update() {
    std::vector<double> ydot(mechanism.plan.ind_q.size() + mechanism.plan.ind_v.size() + 1);
    ASSERT_TRUE(rates(stepper->y(), ydot.data()).ok());
  }

  double dissipated() const {
    return stepper->y()[mechanism.plan.ind_q.size() + mechanism.plan.ind_v.size()];
  }
  double kinetic_energy() const {
    VecX<double> momentum = data.tree.A * data.tree.v;
    return 0.5 * momentum.dot(data.tree.v);
  }

  Mechanism mechanism;
  MechanismData<double> data;
  BaseMotion<double> base;
  JointForceSums<double> sums;
  VecX<double> command, force;
  std::unique_ptr<Stepper> stepper;
};

class Trajectory : public ::testing::TestWithParam<const char*> {};

TEST_P(Trajectory, is_followed_over_one_second) {
  json document = json::parse(read_test_file(GetParam()));
  document["mechanism"]["forces"] = document["force_elements"];
  FreeMotion motion(read_mechanism(document.dump(), GetParam()));
  ASSERT_EQ(motion.mechanism.model.forces.size(), document["force_elements"].size());
  const json samples = document["samples"];
  ASSERT_EQ(samples.size(), 5u);
  // Tree coordinates of the first sample: independents set, dependents a start for Newton.
  for (int i = 0; i < motion.mechanism.model.nq; ++i) motion.data.tree.q[i] = samples[0]["q"][i];
  const std::vector<int>& ind = motion.mechanism.plan.ind_v;
  for (size_t i = 0; i < ind.size(); ++i) {
    motion.data.tree.v[ind[i]] = samples[0]["v_independent"][i];
  }
  motion.start(1e-13);
  Residual positions, velocities;
  for (const json& sample : samples) {
    const std::string where = "t = " + sample["t"].dump();
    motion.advance(sample["t"]);
    for (int i = 0; i < motion.mechanism.model.nq; ++i) {
      positions.add(motion.data.tree.q[i] - sample["q"][i].get<double>(), where);
    }
    for (size_t i = 0; i < ind.size(); ++i) {
      velocities.add(motion.data.tree.v[ind[i]] - sample["v_independent"][i].get<double>(), where);
    }
  }
  EXPECT_RESIDUAL_BELOW(positions, 1e-12);   // measured 9.6e-14; the reference vouches for 1e-9
  EXPECT_RESIDUAL_BELOW(velocities, 4e-11);  // measured 3.6e-12
}

INSTANTIATE_TEST_SUITE_P(files, Trajectory,
                         ::testing::Values("trajectory_hexapod_r2p1r3.json",
                                           "trajectory_planar_two_loop.json"),
                         [](const ::testing::TestParamInfo<const char*>& at) {
                           const std::string file = at.param;
                           return file.substr(11, file.find('.') - 11);
                         });

/// Base and ring as free bodies, six legs with mass between them, springs and dampers, no gravity.
class FreeHexapod : public ::testing::Test {
 protected:
  FreeHexapod() : motion(make()) {
    const V base_velocity(0.01, 0, 0), base_rate(0, 0.002, 0.001);
    const V ring_velocity(0.05, -0.03, -0.10), ring_rate(0.05, 0.04, -0.06);
    TreeData<double>& tree = motion.data.tree;
    // Both attitudes are the identity; the ring's velocities are relative to the base.
    tree.v.head<3>() = base_velocity;
    tree.v.segment<3>(3) = base_rate;
    tree.v.segment<3>(6) = ring_velocity - base_velocity - base_rate.cross(V(0, 0, 2));
    tree.v.segment<3>(9) = ring_rate - base_rate;
    motion.start(1e-13);
  }

  static MechanismModel make() {
    const double base_angle[6] = {-2.5, 2.5, 117.5, 122.5, 237.5, 242.5};
    const double top_angle[6] = {310, 50, 70, 170, 190, 290};
    const double degree = 3.14159265358979323846 / 180.0;
    json legs = json::array();
    for (int i = 0; i < 6; ++i) {
      const double b = base_angle[i] * degree, t = top_angle[i] * degree;
      legs.push_back({{"name", "leg" + std::to_string(i + 1)},
                      {"root_point", {3 * std::cos(b), 3 * std::sin(b), 0}},
                      {"closing_point", {std::cos(t), std::sin(t), 0}}});
    }
    const json document = {{"name", "free_hexapod"},
                           {"bodies",
                            {{{"name", "ring"},
                              {"parent", "base"},
                              {"joint", {{"type", "free"}, {"position", {0, 0, 2}}}},
                              {"mass", 30},
                              {"inertia", {{8, 0, 0}, {0, 9, 0}, {0, 0, 15}}}}}},
                           {"leg_defaults",
                            {{"type", "R2P1R3"},
                             {"root", "base"},
                             {"closing", "ring"},
                             {"reference_axis", {0, 0, 1}},
                             {"cylinder", {{"mass", 4}, {"com", 0.6}, {"inertia_transverse", 0.5}}},
                             {"rod", {{"mass", 3}, {"com", 0.5}, {"inertia_transverse", 0.4}}},
                             {"stiffness", 2000},
                             {"damping", 40}}},
                           {"legs", legs}};
    VehicleBody base;
    base.mass = 500;
    base.inertia = V(900, 1100, 1500).asDiagonal();
    return attach_vehicle(read_mechanism(document.dump(), "free_hexapod"), base, Pose<double>());
  }

  Wrench<double> find_momentum_about_origin() const {
    Wrench<double> sum;
    const TreeData<double>& tree = motion.data.tree;
    for (size_t i = 0; i < motion.mechanism.model.bodies.size(); ++i) {
      const V p =
          motion.mechanism.model.bodies[i].mass * tree.u[i] + tree.w[i].cross(tree.h_body[i]);
      sum.f += p;
      sum.t += tree.p[i].cross(p) + tree.I_body[i] * tree.w[i] + tree.h_body[i].cross(tree.u[i]);
    }
    return sum;
  }

  static double distance(const VecX<double>& actual, const std::vector<double>& expected) {
    return (actual - Eigen::Map<const VecX<double>>(expected.data(), actual.size()))
        .cwiseAbs()
        .maxCoeff();
  }

  FreeMotion motion;
  static constexpr int kRing = 1;  ///< body index; the base is body 0
};

TEST_F(FreeHexapod, starts_with_the_energy_and_momentum_of_the_reference) {
  EXPECT_NEAR(motion.kinetic_energy(), 0.4264357122151621, scaled_tolerance(6e-16));
  EXPECT_NEAR(motion.sums.energy, 0.0, scaled_tolerance(4e-27));  // measured 4e-28
  const Wrench<double> p = find_momentum_about_origin();
  // Stated to nine digits.
  EXPECT_LE(distance(p.f, {7.6833466, -1.46717431, -4.90236452}), scaled_tolerance(6e-9));
  EXPECT_LE(distance(p.t, {3.61390802, 7.68722149, -0.7117741}), scaled_tolerance(6e-9));
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_NEAR(motion.mechanism.model.legs[i].home_length, 3.15380068, scaled_tolerance(6e-9));
  }
}

TEST_F(FreeHexapod, starts_with_the_accelerations_of_the_reference) {
  calc_tree_acceleration(motion.mechanism.model, motion.data.tree.all, motion.base,
                         &motion.data.vdot, motion.data.tree);
  const TreeData<double>& tree = motion.data.tree;
  Residual worst;
  worst.add(distance(tree.a[0], {0.0071025583032879, -0.0067637947516008, -0.019890093350009}),
            "base linear");
  worst.add(distance(tree.alpha[0], {0.010407260751864, 0.0083948392162534, -0.0055556506537058}),
            "base angular");
  worst.add(distance(tree.a[kRing], {-0.076262367168869, 0.072838717034256, 0.21236327601276}),
            "ring linear");
  worst.add(distance(tree.alpha[kRing], {-0.19697245575157, -0.16392400862043, 0.23349135871859}),
            "ring angular");
  EXPECT_RESIDUAL_BELOW(worst, 4e-13);  // measured 3.8e-14; the reference vouches for 1.3e-13
}

TEST_F(FreeHexapod, is_after_two_seconds_where_the_reference_is) {
  const Wrench<double> before = find_momentum_about_origin();
  motion.advance(2.0);
  const TreeData<double>& tree = motion.data.tree;
  Residual state, energy, momentum;
  state.add(distance(tree.p[kRing], {0.043807310507, -0.015633548123, 1.982311647668}), "ring p");
  state.add(distance(quat_from_matrix<double>(tree.R[kRing]),
                     {0.9999840853665, 0.00296967660211, 0.00477643089554, -0.00044242793085}),
            "ring q");
  state.add(distance(tree.p[0], {0.0252522153142, -0.0041301989575, -0.0170896812076}), "base p");
  state.add(distance(quat_from_matrix<double>(tree.R[0]),
                     {0.9999848423933, 0.00289526365171, 0.00466440574177, -0.00041922673760}),
            "base q");
  state.add(distance(tree.u[0], {0.0128959226557, -0.0021921223083, -0.0093246701705}), "base v");
  state.add(distance(tree.w[0], {0.0030116344149, 0.0048237162344, -0.0004474452989}), "base w");
  state.add(distance(tree.u[kRing], {0.0190437985890, -0.0064655097245, -0.0005244825788}),
            "ring v");
  state.add(distance(tree.w[kRing], {0.0033045687290, 0.0077588773864, 0.0006835770587}), "ring w");
  const double length[6] = {3.153418355592, 3.153531227102, 3.153473361997,
                            3.153540275342, 3.15369576913,  3.153320900893};
  for (size_t i = 0; i < 6; ++i) {
    const Leg& leg = motion.mechanism.model.legs[i];
    const int slide = motion.mechanism.model.bodies[leg.body].q_index;
    state.add(leg.home_length + tree.q[slide] - length[i], leg.name);
  }
  energy.add(motion.kinetic_energy() + motion.sums.energy - 0.0969757294406, "mechanical");
  energy.add(motion.dissipated() - 0.3294599827746, "dissipated");
  const double total = motion.kinetic_energy() + motion.sums.energy + motion.dissipated();
  EXPECT_NEAR(total, 0.4264357122151621, scaled_tolerance(6e-12));  // measured 5.8e-13
  const Wrench<double> after = find_momentum_about_origin();
  momentum.add((after.f - before.f).norm() / before.f.norm(), "linear");
  momentum.add((after.t - before.t).norm() / before.t.norm(), "angular");
  EXPECT_RESIDUAL_BELOW(state, 5e-12);     // measured 4.7e-13; the reference states 12 digits
  EXPECT_RESIDUAL_BELOW(energy, 5e-12);    // measured 5.3e-13
  EXPECT_RESIDUAL_BELOW(momentum, 1e-14);  // measured 9.3e-16
}

/// The ring of 30 kg on which other engines were measured, displaced and moving.
class HexapodBench : public ::testing::Test {
 protected:
  HexapodBench() : motion(make()) {
    const json initial = json::parse(read_test_file("hexapod_bench.json"))["initial"];
    TreeData<double>& tree = motion.data.tree;
    const Vec4<double> q = quat_exp<double>(to_vec3(initial["ring_rotation_vector"]));
    const Mat3<double> R = quat_to_matrix<double>(q);
    tree.q.head<3>() = to_vec3(initial["ring_displacement"]);
    tree.q.segment<4>(3) = q;
    tree.v.head<3>() = R.transpose() * to_vec3(initial["ring_linear_velocity"]);
    tree.v.segment<3>(3) = R.transpose() * to_vec3(initial["ring_angular_velocity"]);
    motion.start(1e-13);
  }
  static MechanismModel make() {
    const std::string path = std::string(DOCKLOOP_MODELS) + "/mechanisms/hexapod_bench.json";
    std::ifstream file(path);
    return read_mechanism({std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()},
                          path);
  }
  FreeMotion motion;
  const json reference = json::parse(read_test_file("hexapod_bench_reference.json"));
};

TEST_F(HexapodBench, starts_with_the_accelerations_of_the_reference) {
  calc_tree_acceleration(motion.mechanism.model, motion.data.tree.all, motion.base,
                         &motion.data.vdot, motion.data.tree);
  Vec6<double> actual;
  actual << motion.data.tree.a[0], motion.data.tree.alpha[0];
  EXPECT_LE(find_relative_error(actual, to_vector(reference["acc0"])),
            scaled_tolerance(3e-14));  // measured 3.2e-15
}

TEST_F(HexapodBench, follows_the_reference_for_half_a_second) {
  Residual worst;
  for (size_t n = 0; n <= 5; ++n) {
    motion.advance(reference["t"][n]);
    const TreeData<double>& tree = motion.data.tree;
    const std::string where = "sample " + std::to_string(n);
    worst.add((tree.p[0] - to_vec3(reference["p"][n])).cwiseAbs().maxCoeff(), where + " p");
    worst.add((tree.u[0] - to_vec3(reference["v"][n])).cwiseAbs().maxCoeff(), where + " v");
    worst.add((tree.w[0] - to_vec3(reference["w"][n])).cwiseAbs().maxCoeff(), where + " w");
    const VecX<double> q = quat_from_matrix<double>(tree.R[0]);
    worst.add((q - to_vector(reference["q"][n])).cwiseAbs().maxCoeff(), where + " q");
  }
  EXPECT_RESIDUAL_BELOW(worst, 4e-13);  // measured 3.6e-14
}

}  // namespace
}  // namespace dockloop
