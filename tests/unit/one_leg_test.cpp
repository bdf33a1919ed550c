// One universal-slide-spherical leg, worked by hand: read this first.
// 1. a leg that must reach a point: its two angles and its slide follow from the point;
// 2. their rates and accelerations follow from the velocity of the point;
// 3. masses of the leg appear in the inertia of what it carries, and only there;
// 4. the cut force is what the removed spherical joint carried, the base feels the leg's push.
//
// The leg starts at the origin of the base. At zero coordinates it lies along x and is 1 m long;
// its first axis is y, its second z. It carries a plate that floats freely. The ball joint between
// the tip of the rod and the origin of the plate is cut: three equations, which give the three
// coordinates of the leg (the dependent ones). The six of the plate are independent.
//
// Words of the code: q, v, vdot are coordinates, velocities and accelerations of all joints of the
// tree; ind_v lists the independent velocities, dep those that a block (here the one loop)
// determines; form() is the closed form of a block, null where Newton iteration solves it; A_ind is
// the inertia in the independent velocities, tau the generalised forces, lambda the cut force on
// the tip, in base axes. tree.external holds a load for each body; body 0 is the plate. on_base is
// what the mechanism exerts on its base. u is the direction of the leg, L its length; p1 and p2 are
// its angles. scaled_tolerance() scales all tolerances alike (test_helpers.hpp).
// Run it: build/release/dockloop_tests --gtest_filter='*OneLeg*'
#include <gtest/gtest.h>

#include <cmath>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

// The mass of the rod sits in its tip, 1 m along its x axis, so its effect can be seen at once.
// "R3" is a spherical cut. home_q is the pose at home: position and quaternion (w, x, y, z) of the
// plate, then the three joints of the leg.
constexpr const char* kDocument = R"({
  "name": "one_leg",
  "bodies": [
    {"name": "plate", "parent": "base", "joint": {"type": "free"},
     "mass": 10, "inertia": [[1, 0, 0], [0, 2, 0], [0, 0, 3]]},
    {"name": "cross", "parent": "base", "joint": {"type": "revolute", "axis": [0, 1, 0]}},
    {"name": "cylinder", "parent": "cross", "joint": {"type": "revolute", "axis": [0, 0, 1]}},
    {"name": "rod", "parent": "cylinder", "joint": {"type": "prismatic", "axis": [1, 0, 0]},
     "mass": 2, "com": [1, 0, 0]}
  ],
  "loops": [
    {"name": "leg", "root": "base", "first": "cross", "terminal": "rod", "closing": "plate",
     "cut": {"type": "R3", "point_on_terminal": [1, 0, 0], "point_on_closing": [0, 0, 0]}}
  ],
  "home_q": [1, 0, 0, 1, 0, 0, 0, 0, 0, 0]
})";

// The plate is held at L u with L = 1.4 m and the unit vector u = (2, 3, -6)/7.
constexpr double kLength = 1.4;
Vec3<double> leg_direction() { return Vec3<double>(2, 3, -6) / 7.0; }

// Indices in q: plate 0-6, then the leg. In v the plate takes six.
enum { kQCross = 7, kQCylinder = 8, kQSlide = 9 };
enum { kVCross = 6, kVCylinder = 7, kVSlide = 8 };

constexpr double kKinematics = 1e-15;    // worst residual 1.1e-16
constexpr double kAcceleration = 5e-15;  // worst residual 4.5e-16 (inertia 2.2e-16)
constexpr double kForce = 5e-14;         // worst residual 5.3e-15

class OneLeg : public ::testing::TestWithParam<bool> {
 protected:
  // Parameter: solve by Newton iteration even though a closed form exists.
  OneLeg() : mechanism(read_mechanism(kDocument, "one_leg.json"), GetParam()), data(mechanism) {
    data.tree.q.head<3>() = kLength * leg_direction();
  }
  void evaluate() {
    ASSERT_TRUE(calc_position(mechanism, data).ok());
    calc_velocity(mechanism, base, data);
    calc_acceleration(mechanism, base, data);
    calc_reactions(mechanism, base, kBase, data);
  }
  Mechanism mechanism;
  MechanismData<double> data;
  BaseMotion<double> base;  // at rest
};

TEST_P(OneLeg, the_plate_is_independent_and_the_leg_dependent) {
  EXPECT_EQ(mechanism.plan.ind_v, (std::vector<int>{0, 1, 2, 3, 4, 5}));
  ASSERT_EQ(mechanism.plan.blocks.size(), 1u);
  EXPECT_EQ(mechanism.plan.blocks[0].dep, (std::vector<int>{kVCross, kVCylinder, kVSlide}));
  EXPECT_EQ(mechanism.plan.blocks[0].form() != nullptr, !GetParam());
}

TEST_P(OneLeg, its_angles_point_it_at_the_plate_and_the_slide_makes_up_the_length) {
  evaluate();
  // Ry(p1) Rz(p2) x = (cos p1 cos p2, sin p2, -sin p1 cos p2) = (2, 3, -6)/7.
  EXPECT_NEAR(data.tree.q[kQCross], std::atan(3.0), scaled_tolerance(kKinematics));
  EXPECT_NEAR(data.tree.q[kQCylinder], std::asin(3.0 / 7.0), scaled_tolerance(kKinematics));
  EXPECT_NEAR(data.tree.q[kQSlide], kLength - 1.0, scaled_tolerance(kKinematics));
}

TEST_P(OneLeg, its_rates_follow_from_the_velocity_of_the_plate) {
  data.tree.v.head<3>() = Vec3<double>(0.7, 0, 0);
  evaluate();
  // Along the leg: u . v = 2/7 0.7 = 0.2.
  EXPECT_NEAR(data.tree.v[kVSlide], 0.2, scaled_tolerance(kKinematics));
  // Across: a rate of the first angle moves the tip by L (y x u) with y x u = (-6, 0, -2)/7. The
  // square of y x u is cos^2 p2 = 40/49, so the rate is v . (y x u)/(L cos^2 p2) with
  // v . (y x u) = -0.6 and L cos^2 p2 = 1.4 40/49.
  EXPECT_NEAR(data.tree.v[kVCross], -0.525, scaled_tolerance(kKinematics));
  // A rate of the second moves it by L along (-cos p1 sin p2, cos p2, sin p1 sin p2), a unit
  // vector; cos p1 = 1/sqrt(10).
  EXPECT_NEAR(data.tree.v[kVCylinder], -0.7 * 3.0 / 7.0 / std::sqrt(10.0) / kLength,
              scaled_tolerance(kKinematics));
}

TEST_P(OneLeg, a_plate_in_straight_motion_accelerates_the_slide) {
  data.tree.v.head<3>() = Vec3<double>(0.7, 0, 0);
  evaluate();
  EXPECT_NEAR(data.vdot.head<3>().norm(), 0.0, scaled_tolerance(kAcceleration));
  // d/dt(u . v) = (v^2 - (u . v)^2)/L = (0.49 - 0.04)/1.4.
  EXPECT_NEAR(data.vdot[kVSlide], 0.45 / 1.4, scaled_tolerance(kAcceleration));
}

TEST_P(OneLeg, the_plate_feels_the_mass_at_the_tip_as_its_own) {
  evaluate();
  MatX<double> expected = MatX<double>::Zero(6, 6);
  expected.diagonal() << 12, 12, 12, 1, 2, 3;
  EXPECT_LE((data.A_ind - expected).cwiseAbs().maxCoeff(), scaled_tolerance(kAcceleration));
}

TEST_P(OneLeg, a_force_on_the_plate_moves_plate_and_tip) {
  data.tree.external[0].f = Vec3<double>(24, 0, 0);
  evaluate();
  const Vec3<double> acceleration = data.vdot.head<3>();
  EXPECT_LE((acceleration - Vec3<double>(2, 0, 0)).norm(), scaled_tolerance(kAcceleration));
  // The ball joint pulls the 2 kg at the tip along; the base feels nothing.
  const Vec3<double> cut_force = data.loops.block[0].lambda;
  EXPECT_LE((cut_force - Vec3<double>(4, 0, 0)).norm(), scaled_tolerance(kForce));
  EXPECT_LE(data.on_base.f.norm(), scaled_tolerance(kForce));
}

TEST_P(OneLeg, a_push_of_the_slide_accelerates_along_the_leg_and_presses_on_the_base) {
  data.tau[kVSlide] = 12.0;
  evaluate();
  const Vec3<double> acceleration = data.vdot.head<3>();
  EXPECT_LE((acceleration - leg_direction()).norm(), scaled_tolerance(kAcceleration));
  // Tip: 2 kg u = 12 N u + cut force. Base: the opposite of the push, through its origin.
  const Vec3<double> cut_force = data.loops.block[0].lambda;
  EXPECT_LE((cut_force + 10.0 * leg_direction()).norm(), scaled_tolerance(kForce));
  EXPECT_LE((data.on_base.f + 12.0 * leg_direction()).norm(), scaled_tolerance(kForce));
  EXPECT_LE(data.on_base.t.norm(), scaled_tolerance(kForce));
}

INSTANTIATE_TEST_SUITE_P(closed_form_and_newton, OneLeg, ::testing::Bool(),
                         [](const ::testing::TestParamInfo<bool>& parameter) {
                           return parameter.param ? "newton" : "closed_form";
                         });

}  // namespace
}  // namespace dockloop
