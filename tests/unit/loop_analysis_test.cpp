// All loop equations at once: couplings, redundancy, and other independent coordinates.
// 1. a gear, a differential and a screw: rates follow the ratios, and the rotating part is felt as
//    the inertia it reflects; the coupling may tie a joint that a loop determines;
// 2. a loop closed twice, and a revolute cut in a planar mechanism, have redundant equations: they
//    are found, the motion is the one without them; a merely singular home is not taken for that;
// 3. the accelerations of a mechanism do not depend on which coordinates are independent, and a
//    change of them leaves momentum and energy as they are;
// 4. loads in the joints leave every joint free along its own coordinate.
#include "loops/loop_analysis.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "check/mechanism_check.hpp"
#include "mechanism/mechanism_dynamics.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;

constexpr double kPi = 3.14159265358979323846;

json make_link(const std::string& name, const std::string& parent, const std::string& type,
               const V& axis, const V& position, double mass, double inertia) {
  return {{"name", name},
          {"parent", parent},
          {"joint",
           {{"type", type},
            {"axis", {axis.x(), axis.y(), axis.z()}},
            {"position", {position.x(), position.y(), position.z()}}}},
          {"mass", mass},
          {"inertia", {{inertia, 0, 0}, {0, inertia, 0}, {0, 0, inertia}}}};
}

/// A nut on a carriage: the slide of 2 kg and a rotor of 1e-3 kg m2 that a screw of this lead
/// turns.
json make_screw(double lead) {
  return {{"name", "screw"},
          {"bodies",
           {make_link("slide", "base", "prismatic", V::UnitX(), V::Zero(), 2.0, 0.0),
            make_link("rotor", "slide", "revolute", V::UnitX(), V::Zero(), 0.0, 1e-3)}},
          {"couplings",
           {{{"name", "thread"},
             {"dependent", "rotor"},
             {"terms", {{{"joint", "slide"}, {"ratio", 2 * kPi / lead}}}}}}}};
}

TEST(Coupling, a_screw_reflects_the_inertia_of_what_it_turns) {
  const double lead = 0.01, ratio = 2 * kPi / lead;
  const Mechanism mechanism(read_mechanism(make_screw(lead).dump(), "screw"));
  ASSERT_EQ(mechanism.plan.ind_v, (std::vector<int>{0}));
  MechanismData<double> data(mechanism);
  data.tree.q[0] = 0.003;
  data.tree.v[0] = 0.2;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  EXPECT_DOUBLE_EQ(data.tree.q[1], 0.003 * ratio);
  EXPECT_NEAR(data.A_ind(0, 0), 2.0 + 1e-3 * ratio * ratio, 1e-12);
  const BaseMotion<double> base;
  calc_velocity(mechanism, base, data);
  EXPECT_DOUBLE_EQ(data.tree.v[1], 0.2 * ratio);
  data.tau[0] = 10.0;
  data.tau[1] = -0.004;
  calc_acceleration(mechanism, base, data);
  EXPECT_NEAR(data.vdot[0], (10.0 - 0.004 * ratio) / (2.0 + 1e-3 * ratio * ratio), 1e-15);
  calc_reactions(mechanism, base, kBase, data);
  // The thread's moment on the rotor spins it up against its load.
  EXPECT_NEAR(data.loops.block[0].lambda[0], 1e-3 * data.vdot[1] + 0.004, 1e-15);
}

TEST(Coupling, a_differential_shares_its_speed_between_two_outputs) {
  json document = {
      {"name", "differential"},
      {"bodies",
       {make_link("left", "base", "revolute", V::UnitX(), V::Zero(), 1, 0.2),
        make_link("right", "base", "revolute", V::UnitX(), V::Zero(), 1, 0.3),
        make_link("cage", "base", "revolute", V::UnitX(), V::Zero(), 1, 0.5)}},
      {"couplings",
       {{{"name", "gears"},
         {"dependent", "cage"},
         {"offset", 0.25},
         {"terms", {{{"joint", "left"}, {"ratio", 0.5}}, {{"joint", "right"}, {"ratio", 0.5}}}}}}},
      {"home_q", {0, 0, 0.25}}};
  Mechanism mechanism(read_mechanism(document.dump(), "differential"));
  close_home(mechanism, "differential");
  MechanismData<double> data(mechanism);
  data.tree.q.head<2>() << 0.4, -0.1;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  EXPECT_DOUBLE_EQ(data.tree.q[2], 0.25 + 0.15);
  // Kinetic energy of the three: 0.5 v^T A v with the cage at the mean speed.
  EXPECT_DOUBLE_EQ(data.A_ind(0, 0), 0.2 + 0.125);
  EXPECT_DOUBLE_EQ(data.A_ind(0, 1), 0.125);
  EXPECT_DOUBLE_EQ(data.A_ind(1, 1), 0.3 + 0.125);
  document["home_q"] = {0, 0, 0};
  EXPECT_NE(find_refusal([&] {
              Mechanism open(read_mechanism(document.dump(), "differential"));
              close_home(open, "differential");
            }).find("'gears' (a coupling) is open by 0.25"),
            std::string::npos);
}

TEST(Coupling, a_gear_on_joints_of_a_loop_joins_its_block_or_follows_it) {
  // The crank of the two-loop linkage turns a flywheel, geared to the rocker that the loop moves.
  json document = json::parse(read_test_file("planar_two_loop.json"))["mechanism"];
  document["bodies"].push_back(
      make_link("flywheel", "base", "revolute", V::UnitZ(), V(0, 0, 0.1), 1, 0.02));
  document["couplings"] = {{{"name", "gear"},
                            {"dependent", "flywheel"},
                            {"terms", {{{"joint", "fb1_rocker"}, {"ratio", -3.0}}}}}};
  json home = json::parse(read_test_file("planar_two_loop.json"))["home_q"];
  home.push_back(-3.0 * home[1].get<double>());
  document["home_q"] = home;
  const Mechanism follows(read_mechanism(document.dump(), "geared"));
  ASSERT_EQ(follows.plan.blocks.size(), 3u);
  // The same the other way round: the flywheel is independent and drives the crank through both.
  document["couplings"][0] = {{"name", "gear"},
                              {"dependent", "crank"},
                              {"terms", {{{"joint", "fb1_rocker"}, {"ratio", 1.0}}}}};
  document["couplings"][0]["dependent"] = "fb1_rocker";
  document["couplings"][0]["terms"] = {{{"joint", "flywheel"}, {"ratio", -1.0 / 3.0}}};
  document["loops"][0]["dependent"] = {"crank", "fb1_coupler"};
  document["loops"][0]["closure"] = "automatic";
  const Mechanism driven(read_mechanism(document.dump(), "geared"));
  ASSERT_EQ(driven.plan.ind_bodies, (std::vector<int>{5, 6}));
  MechanismData<double> a(follows), b(driven);
  for (int i : follows.plan.ind_v) a.tree.v[i] = 0.3 + 0.1 * i;
  ASSERT_TRUE(calc_position(follows, a).ok());
  const BaseMotion<double> base;
  calc_velocity(follows, base, a);
  b.tree.q = a.tree.q;
  b.tree.v = a.tree.v;
  ASSERT_TRUE(calc_position(driven, b).ok());
  calc_velocity(driven, base, b);
  EXPECT_LT((a.tree.q - b.tree.q).norm(), 1e-13);
  EXPECT_LT((a.tree.v - b.tree.v).norm(), 1e-13);
  for (int j = 0; j < a.tau.size(); ++j) a.tau[j] = b.tau[j] = 1.0 - 0.3 * j;
  calc_acceleration(follows, base, a);
  calc_acceleration(driven, base, b);
  EXPECT_LT((a.vdot - b.vdot).norm(), 1e-12 * a.vdot.norm());
}

/// Four-bar of the two-loop linkage with its strut, and a second copy of the strut's cut.
TEST(Redundancy, a_loop_closed_twice_is_found_and_left_out) {
  const json file = json::parse(read_test_file("planar_two_loop.json"));
  json document = file["mechanism"];
  document["home_q"] = file["home_q"];
  const Mechanism once(read_mechanism(document.dump(), "once"));
  EXPECT_TRUE(once.notes.empty());
  json again = document["loops"][1];
  again["name"] = "again";
  again["dependent"] = json::array();
  document["loops"].push_back(again);
  const Mechanism twice(read_mechanism(document.dump(), "twice"));
  ASSERT_EQ(twice.notes.size(), 1u);
  EXPECT_NE(twice.notes[0].find("6 equations of rank 4"), std::string::npos) << twice.notes[0];
  EXPECT_EQ(twice.plan.ind_v, once.plan.ind_v);
  MechanismData<double> a(once), b(twice);
  for (int i : once.plan.ind_v) a.tree.v[i] = b.tree.v[i] = 0.7;
  const BaseMotion<double> base;
  ASSERT_TRUE(calc_position(once, a).ok());
  ASSERT_TRUE(calc_position(twice, b).ok());
  calc_velocity(once, base, a);
  calc_velocity(twice, base, b);
  calc_acceleration(once, base, a);
  calc_acceleration(twice, base, b);
  EXPECT_LT((a.vdot - b.vdot).norm(), 1e-12 * a.vdot.norm());
}

TEST(Redundancy, a_revolute_cut_of_a_planar_loop_leaves_two_equations) {
  // The four-bar alone, its cut described as a hinge in space: 5 equations, 3 follow.
  const json file = json::parse(read_test_file("planar_two_loop.json"));
  json document = file["mechanism"];
  json& loop = document["loops"][0];
  const json planar = document;
  loop["cut"] = {{"type", "R1"},
                 {"point_on_terminal", loop["cut"]["point_on_terminal"]},
                 {"point_on_closing", loop["cut"]["point_on_closing"]},
                 {"axis_on_terminal", {0, 0, 1}},
                 {"axis_on_closing", {0, 0, 1}}};
  loop.erase("closure");
  document["home_q"] = file["home_q"];
  const Mechanism spatial(read_mechanism(document.dump(), "spatial"));
  ASSERT_FALSE(spatial.notes.empty());
  EXPECT_EQ(spatial.model.loops[0].redundant.size(), 3u);
  json states = {{"states", file["states"]}};
  const json found = evaluate_states(document.dump(), "spatial", states.dump(), "states", false);
  for (size_t n = 0; n < found.size(); ++n) {
    EXPECT_LT(find_relative_error(to_vector(found[n]["a"]),
                                  to_vector(file["states"][n]["expected"]["a"])),
              1e-12);
  }
}

TEST(Redundancy, a_home_that_is_only_singular_is_no_redundancy) {
  // Parallelogram with all bars in line: rank is lost here and nowhere else.
  const json document = {
      {"name", "flat"},
      {"bodies",
       {make_link("crank", "base", "revolute", V::UnitZ(), V::Zero(), 1, 0.1),
        make_link("coupler", "crank", "revolute", V::UnitZ(), V(1, 0, 0), 1, 0.1),
        make_link("rocker", "base", "revolute", V::UnitZ(), V(1, 0, 0), 1, 0.1)}},
      {"loops",
       {{{"name", "bar"},
         {"root", "crank"},
         {"first", "coupler"},
         {"terminal", "coupler"},
         {"closing", "rocker"},
         {"dependent", {"coupler", "rocker"}},
         {"cut",
          {{"type", "R1_planar"},
           {"point_on_terminal", {1, 0, 0}},
           {"point_on_closing", {1, 0, 0}},
           {"plane_axes_in_root", {{1, 0, 0}, {0, 1, 0}}}}}}}},
      {"home_q", {0, 0, 0}}};
  Mechanism mechanism(read_mechanism(document.dump(), "flat"));
  EXPECT_TRUE(mechanism.notes.empty());
  EXPECT_NE(find_refusal([&] { close_home(mechanism, "flat"); }).find("singular"),
            std::string::npos);
}

/// Slider-crank, crank 0.2 m, rod 0.5 m, with the named coordinate independent.
Mechanism make_slider_crank(const std::string& independent, double crank) {
  const double rod = -std::asin(0.2 * std::sin(crank) / 0.5);
  const double slide = 0.2 * std::cos(crank) + 0.5 * std::cos(rod);
  std::vector<std::string> dependent;
  for (const std::string name : {"crank", "rod", "slider"}) {
    if (name != independent) dependent.push_back(name);
  }
  const json document = {
      {"name", "slider_crank"},
      {"bodies",
       {make_link("crank", "base", "revolute", V::UnitZ(), V::Zero(), 1, 0.02),
        make_link("rod", "crank", "revolute", V::UnitZ(), V(0.2, 0, 0), 0.5, 0.01),
        make_link("slider", "base", "prismatic", V::UnitX(), V::Zero(), 2, 0.01)}},
      {"loops",
       {{{"name", "pin"},
         {"root", "base"},
         {"first", "crank"},
         {"terminal", "rod"},
         {"closing", "slider"},
         {"dependent", dependent},
         {"cut",
          {{"type", "R1_planar"},
           {"point_on_terminal", {0.5, 0, 0}},
           {"point_on_closing", {0, 0, 0}},
           {"plane_axes_in_root", {{1, 0, 0}, {0, 1, 0}}}}}}}},
      {"home_q", {crank, rod - crank, slide}}};
  return Mechanism(read_mechanism(document.dump(), "slider_crank"));
}

TEST(Coordinates, near_dead_centre_the_crank_takes_over_from_the_slider) {
  const auto change = [](const char* independent, double crank) {
    const Mechanism mechanism = make_slider_crank(independent, crank);
    MechanismData<double> data(mechanism);
    EXPECT_TRUE(calc_position(mechanism, data).ok());
    std::vector<int> independent_bodies;
    if (const auto better = find_better_coordinates(mechanism, data))
      independent_bodies = with_coordinates(mechanism, *better).plan.ind_bodies;
    return independent_bodies;
  };
  EXPECT_TRUE(change("crank", 0.02).empty());
  const std::vector<int> changed = change("slider", 0.02);
  ASSERT_EQ(changed.size(), 1u);
  EXPECT_NE(changed, (std::vector<int>{2}));  // either hinge will do
}

TEST(Coordinates, a_change_leaves_motion_and_accelerations_as_they_are) {
  const Mechanism slider = make_slider_crank("slider", 0.1);
  MechanismData<double> a(slider);
  a.tree.v[2] = 0.05;
  const BaseMotion<double> base;
  ASSERT_TRUE(calc_position(slider, a).ok());
  calc_velocity(slider, base, a);
  a.tau << 0.3, -0.2, 1.0;
  calc_acceleration(slider, base, a);
  calc_reactions(slider, base, kBase, a);
  const std::optional<Coordinates> better = find_better_coordinates(slider, a);
  ASSERT_TRUE(better.has_value());
  const Mechanism crank = with_coordinates(slider, *better);
  MechanismData<double> b(crank);
  b.tree.q = a.tree.q;
  b.tree.v = a.tree.v;
  b.tau = a.tau;
  ASSERT_TRUE(calc_position(crank, b).ok());
  calc_velocity(crank, base, b);
  calc_acceleration(crank, base, b);
  calc_reactions(crank, base, kBase, b);
  EXPECT_LT((b.tree.v - a.tree.v).norm(), 1e-13 * a.tree.v.norm());
  EXPECT_LT((b.vdot - a.vdot).norm(), 1e-11 * a.vdot.norm());
  EXPECT_LT((b.on_base.f - a.on_base.f).norm(), 1e-10 * a.on_base.f.norm());
}

TEST(JointLoads, no_joint_resists_along_its_own_coordinate) {
  // With the cut forces put on as loads, what each joint passes on along its axis must be what is
  // applied there: this holds only if every cut force and every load in between is right.
  for (const char* file : {"hexapod_r2p1r3.json", "crank_nested.json", "planar_two_loop.json"}) {
    const json document = json::parse(read_test_file(file));
    Mechanism mechanism(read_mechanism(document.dump(), file));
    Residual along, on_base;
    for (const json& state : document["states"]) {
      MechanismData<double> data(mechanism);
      data.tree.q = to_vector(state["q"]);
      data.tree.v = to_vector(state["expected"]["v"]);
      data.tau = to_vector(state["tau"]);
      BaseMotion<double> base;
      base.gravity = V(0.1, -9.8, 0.2);
      data.tree.external.back().f = V(3, -4, 5);
      ASSERT_TRUE(calc_position(mechanism, data).ok());
      calc_velocity(mechanism, base, data);
      calc_acceleration(mechanism, base, data);
      calc_reactions(mechanism, base, kBase, data);
      calc_joint_loads(mechanism, data);
      const double scale = data.tau.lpNorm<Eigen::Infinity>() + data.on_base.f.norm();
      V force = V::Zero();
      for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
        const Body& body = mechanism.model.bodies[i];
        const Wrench<double>& load = data.joint_load[i];
        if (body.parent == kBase) force -= load.f;
        if (body.joint == JointType::kRevolute) {
          along.add((data.tree.e[i].dot(load.t) - data.tau[body.v_index]) / scale, body.name);
        } else if (body.joint == JointType::kPrismatic) {
          along.add((data.tree.e[i].dot(load.f) - data.tau[body.v_index]) / scale, body.name);
        } else {
          const V f = data.tree.R[i].transpose() * load.f, t = data.tree.R[i].transpose() * load.t;
          along.add((f - data.tau.segment<3>(body.v_index)).norm() / scale, body.name);
          along.add((t - data.tau.segment<3>(body.v_index + 3)).norm() / scale, body.name);
        }
      }
      // The base feels the joints of its children and the cuts that were made at it.
      for (size_t k = 0; k < mechanism.model.loops.size(); ++k) {
        const Loop& loop = mechanism.model.loops[k];
        if (loop.closing != kBase) continue;
        for (int j = 0; j < 3; ++j) {
          force[j] -= get_cut_force(mechanism.plan, data.loops, static_cast<int>(k), j);
        }
      }
      on_base.add((force - data.on_base.f).norm() / scale, file);
    }
    EXPECT_RESIDUAL_BELOW(along, 1e-12);
    EXPECT_RESIDUAL_BELOW(on_base, 1e-12);
  }
}

}  // namespace
}  // namespace dockloop
