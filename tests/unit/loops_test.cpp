// Loops: their order, their blocks, their closure, and what is refused.
// 1. the order of the file, of loops or of bodies, changes nothing but rounding;
// 2. loops that need each other form one block, with the motion of any other choice of coordinates;
// 3. wrong loop tables are refused in a sentence that names the element;
// 4. the closed form of a universal-slide-spherical leg meets stored vectors and Newton iteration
//    over random poses, lateral offsets included, and refuses what it cannot reach;
// 5. singular loops are reported with a margin that falls to zero; a changed branch is noticed.
#include "loops/loops.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "check/mechanism_check.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;

/// A shuffle that keeps every parent before its children.
json shuffle_bodies(const json& bodies, TestRandom& random) {
  std::vector<json> waiting(bodies.begin(), bodies.end());
  std::vector<std::string> placed{"base"};
  json result = json::array();
  while (!waiting.empty()) {
    const size_t i = static_cast<size_t>(random.uniform(0, static_cast<double>(waiting.size())));
    const std::string parent = waiting[i]["parent"];
    if (std::find(placed.begin(), placed.end(), parent) == placed.end()) continue;
    placed.push_back(waiting[i]["name"]);
    result.push_back(waiting[i]);
    waiting.erase(waiting.begin() + static_cast<std::ptrdiff_t>(i));
  }
  return result;
}

json shuffle(const json& list, TestRandom& random) {
  std::vector<json> items(list.begin(), list.end());
  for (size_t i = items.size(); i-- > 1;) {
    std::swap(items[i], items[static_cast<size_t>(random.uniform(0, static_cast<double>(i + 1)))]);
  }
  return items;
}

/// Slices of a vector of all coordinates (or velocities), by name of the body.
std::map<std::string, std::vector<double>> slice(const json& bodies, const json& all, bool q) {
  std::map<std::string, std::vector<double>> result;
  size_t at = 0;
  for (const json& body : bodies) {
    const size_t n = body["joint"]["type"] == "free" ? (q ? 7 : 6) : 1;
    for (size_t i = 0; i < n; ++i) result[body["name"]].push_back(all[at++].get<double>());
  }
  return result;
}

json gather(const json& bodies, const std::map<std::string, std::vector<double>>& slices) {
  json all = json::array();
  for (const json& body : bodies) {
    for (double value : slices.at(body["name"].get<std::string>())) all.push_back(value);
  }
  return all;
}

TEST(LoopOrder, permuted_files_give_the_same_accelerations_and_forces) {
  TestRandom random(11);
  Residual worst;
  for (const std::string name : {"crank_nested.json", "planar_two_loop.json"}) {
    const json original = json::parse(read_test_file(name));
    const json bodies = original["mechanism"]["bodies"];
    json document = original;
    json few = json::array();
    for (size_t i = 0; i < 4; ++i) few.push_back(original["states"][i]);
    document["states"] = few;
    const std::string text = document.dump();
    const json reference = evaluate_states(text, name, text, name, false);
    for (int trial = 0; trial < 4; ++trial) {
      json permuted = document;
      permuted["mechanism"]["loops"] = shuffle(document["mechanism"]["loops"], random);
      const json order = shuffle_bodies(bodies, random);
      permuted["mechanism"]["bodies"] = order;
      permuted["home_q"] = gather(order, slice(bodies, document["home_q"], true));
      std::map<std::string, size_t> rank;  // independents come in order of the bodies
      for (const json& body : order) rank.emplace(body["name"].get<std::string>(), rank.size());
      std::vector<std::string> independent = document["independent"];
      std::vector<size_t> place(independent.size());
      std::iota(place.begin(), place.end(), size_t(0));
      std::sort(place.begin(), place.end(),
                [&](size_t a, size_t b) { return rank[independent[a]] < rank[independent[b]]; });
      for (json& state : permuted["states"]) {
        state["q"] = gather(order, slice(bodies, state["q"], true));
        state["tau"] = gather(order, slice(bodies, state["tau"], false));
        const json v = state["v_independent"];
        for (size_t i = 0; i < place.size(); ++i) state["v_independent"][i] = v[place[i]];
      }
      const std::string shuffled = permuted.dump();
      const json result = evaluate_states(shuffled, name, shuffled, name, false);
      for (size_t n = 0; n < few.size(); ++n) {
        for (const char* key : {"v", "a"}) {
          const json back = gather(bodies, slice(order, result[n][key], false));
          worst.add(find_relative_error(to_vector(back), to_vector(reference[n][key])), key);
        }
        for (const char* key : {"loop_force", "base_force", "base_moment"}) {
          worst.add(find_relative_error(to_vector(result[n][key]), to_vector(reference[n][key])),
                    key);
        }
      }
    }
  }
  EXPECT_RESIDUAL_BELOW(worst, 2e-14);  // measured 2.2e-15
}

TEST(LoopOrder, blocks_follow_dependencies_and_not_the_file) {
  TestRandom random(12);
  const json document = json::parse(read_test_file("crank_nested.json"));
  for (int trial = 0; trial < 20; ++trial) {
    json mechanism = document["mechanism"];
    mechanism["loops"] = shuffle(document["mechanism"]["loops"], random);
    const MechanismModel model = read_mechanism(mechanism.dump(), "shuffled");
    const LoopPlan plan = make_loop_plan(model, model.home_q);
    ASSERT_EQ(plan.blocks.size(), document["evaluation_order_blocks"].size());
    std::vector<char> known(static_cast<size_t>(model.nv), 0);
    for (int i : plan.ind_v) known[static_cast<size_t>(i)] = 1;
    for (const LoopBlock& block : plan.blocks) {
      EXPECT_EQ(block.loops.size(), 1u);
      for (int i : block.low) {
        EXPECT_TRUE(known[static_cast<size_t>(i)]) << model.loops[block.loops[0]].name;
      }
      for (int i : block.dep) known[static_cast<size_t>(i)] = 1;
    }
  }
}

/// A plate in the plane on three struts. Independent are either the three coordinates of the plate,
/// or the three lengths: then every loop needs all others.
json make_three_struts(bool lengths_independent) {
  json bodies = json::array(), loops = json::array();
  const auto add = [&](const std::string& name, const std::string& parent, const char* type,
                       std::vector<double> axis, std::vector<double> at, double mass) {
    bodies.push_back({{"name", name},
                      {"parent", parent},
                      {"joint", {{"type", type}, {"axis", axis}, {"position", at}}},
                      {"mass", mass},
                      {"com", {0.1, 0.02, 0}},
                      {"inertia", {{0.1 * mass, 0, 0}, {0, 0.1 * mass, 0}, {0, 0, 0.2 * mass}}}});
  };
  add("px", "base", "prismatic", {1, 0, 0}, {0, 0, 0}, 0.5);
  add("py", "px", "prismatic", {0, 1, 0}, {0, 0, 0}, 0.3);
  add("plate", "py", "revolute", {0, 0, 1}, {0, 0, 0}, 4.0);
  const double foot[3][2] = {{-1, -0.6}, {1.1, -0.5}, {0.1, 1.2}};
  const double corner[3][2] = {{0.15, -0.3}, {0.2, 0.25}, {-0.35, 0.1}};
  for (int k = 0; k < 3; ++k) {
    const std::string name = "strut" + std::to_string(k + 1);
    add(name + "_cyl", "base", "revolute", {0, 0, 1}, {foot[k][0], foot[k][1], 0}, 0.8);
    add(name + "_rod", name + "_cyl", "prismatic", {1, 0, 0}, {0, 0, 0}, 0.6);
    const std::vector<std::string> plate = {"px", "py", "plate"};
    loops.push_back(
        {{"name", name},
         {"root", "base"},
         {"first", name + "_cyl"},
         {"terminal", name + "_rod"},
         {"closing", "plate"},
         {"cut",
          {{"type", "R1_planar"},
           {"point_on_terminal", {0.2, 0, 0}},
           {"point_on_closing", {corner[k][0], corner[k][1], 0}},
           {"plane_axes_in_root", {{1, 0, 0}, {0, 1, 0}}}}},
         {"dependent", lengths_independent ? json({name + "_cyl", plate[static_cast<size_t>(k)]})
                                           : json({name + "_cyl", name + "_rod"})}});
  }
  return {{"name", "three_struts"}, {"bodies", bodies}, {"loops", loops}};
}

TEST(LoopOrder, loops_that_need_each_other_form_one_block) {
  const Mechanism apart(read_mechanism(make_three_struts(false).dump(), "plate"));
  const Mechanism together(read_mechanism(make_three_struts(true).dump(), "lengths"));
  EXPECT_EQ(apart.plan.blocks.size(), 3u);
  ASSERT_EQ(together.plan.blocks.size(), 1u);
  EXPECT_EQ(together.plan.blocks[0].loops.size(), 3u);
  EXPECT_EQ(together.plan.blocks[0].size(), 6);
  EXPECT_EQ(together.plan.ind_v.size(), 3u);
}

TEST(LoopOrder, a_block_of_three_loops_moves_like_three_blocks_of_one) {
  const Mechanism apart(read_mechanism(make_three_struts(false).dump(), "plate"));
  const Mechanism together(read_mechanism(make_three_struts(true).dump(), "lengths"));
  TestRandom random(13);
  Residual positions, motion;
  for (int trial = 0; trial < 50; ++trial) {
    MechanismData<double> a(apart), b(together);
    for (int k = 0; k < 3; ++k) {  // struts towards the plate; Newton needs a start
      a.tree.q[3 + 2 * k] = k == 0 ? 0.5 : k == 1 ? 2.7 : -1.5;
      a.tree.q[4 + 2 * k] = 0.5;
    }
    a.tree.q[0] = random.uniform(-0.1, 0.1);
    a.tree.q[1] = random.uniform(-0.1, 0.1);
    a.tree.q[2] = random.uniform(-0.3, 0.3);
    ASSERT_TRUE(calc_position(apart, a).ok());
    for (int j = 0; j < 3; ++j) a.tree.v[j] = random.uniform(-1, 1);
    for (int j = 0; j < 9; ++j) a.tau[j] = b.tau[j] = random.uniform(-5, 5);
    BaseMotion<double> base;
    base.gravity = V(0, -9.81, 0);
    calc_velocity(apart, base, a);
    calc_acceleration(apart, base, a);
    calc_reactions(apart, base, kBase, a);

    for (int j = 0; j < 9; ++j) b.tree.q[j] = a.tree.q[j];
    for (int j = 0; j < 3; ++j) b.tree.q[j] += random.uniform(-0.02, 0.02);  // Newton finds them
    ASSERT_TRUE(calc_position(together, b).ok());
    for (int j : together.plan.ind_v) b.tree.v[j] = a.tree.v[j];
    calc_velocity(together, base, b);
    calc_acceleration(together, base, b);
    calc_reactions(together, base, kBase, b);
    positions.add((a.tree.q - b.tree.q).cwiseAbs().maxCoeff(), std::to_string(trial));
    motion.add(find_relative_error(b.tree.v, a.tree.v), "v");
    motion.add(find_relative_error(b.vdot, a.vdot), "vdot");
    VecX<double> lambda(6);
    for (int k = 0; k < 3; ++k) lambda.segment<2>(2 * k) = a.loops.block[k].lambda;
    motion.add(find_relative_error(b.loops.block[0].lambda, lambda), "lambda");
    motion.add(find_relative_error(b.on_base.f, a.on_base.f), "base force");
    motion.add(find_relative_error(b.on_base.t, a.on_base.t), "base moment");
  }
  EXPECT_RESIDUAL_BELOW(positions, 5e-15);  // measured 4.4e-16
  EXPECT_RESIDUAL_BELOW(motion, 6e-13);     // measured 6.1e-14
}

// A plate on one leg, with lateral offsets of the ball joint from the line of the slide.
json make_leg(double L0, double offset_y, double offset_z, const std::string& closure) {
  const json inertia = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  return {{"name", "leg"},
          {"bodies",
           {{{"name", "plate"},
             {"parent", "base"},
             {"joint", {{"type", "free"}}},
             {"mass", 1},
             {"inertia", inertia}},
            {{"name", "cross"},
             {"parent", "base"},
             {"joint", {{"type", "revolute"}, {"axis", {0, 1, 0}}}}},
            {{"name", "cylinder"},
             {"parent", "cross"},
             {"joint", {{"type", "revolute"}, {"axis", {0, 0, 1}}}}},
            {{"name", "rod"},
             {"parent", "cylinder"},
             {"joint",
              {{"type", "prismatic"},
               {"axis", {1, 0, 0}},
               {"position", {0.3 * L0, 0.4 * offset_y, 0}}}},
             {"mass", 0.1}}}},
          {"loops",
           {{{"name", "the_leg"},
             {"root", "base"},
             {"first", "cross"},
             {"terminal", "rod"},
             {"closing", "plate"},
             {"closure", closure},
             {"cut",
              {{"type", "R3"},
               {"point_on_terminal", {0.7 * L0, 0.6 * offset_y, offset_z}},
               {"point_on_closing", {0, 0, 0}}}}}}}};
}

/// Coordinates of all joints, where a leg leaves them out.
void keep_angles(const Mechanism& mechanism, MechanismData<double>& data) {
  calc_leg_coordinates(mechanism.model, data.tree, data.loops);
  calc_leg_maps(data.loops);
}

Status close_leg(const Mechanism& mechanism, const V& L, MechanismData<double>& data) {
  data.tree.q.head<3>() = L;
  const Status status = calc_loop_position(mechanism.model, mechanism.plan, data.tree, data.loops);
  if (status.ok()) keep_angles(mechanism, data);
  return status;
}

/// The same leg somewhere in space, on a carriage that turns, so that nothing is aligned.
MechanismModel make_placed_leg(TestRandom& random) {
  MechanismModel model =
      read_mechanism(make_leg(random.uniform(0.3, 1.5), random.uniform(-0.1, 0.1),
                              random.uniform(-0.1, 0.1), "automatic")
                         .dump(),
                     "leg");
  Body carriage;
  carriage.name = "carriage";
  carriage.joint = JointType::kRevolute;
  carriage.axis = make_unit(random);
  carriage.placement = {rotation_of(random.vector(2.0)), random.vector(1.0)};
  carriage.mass = 2.0;
  carriage.inertia = Mat3<double>::Identity();
  // Order: plate, carriage, cross, cylinder, rod.
  model.bodies.insert(model.bodies.begin() + 1, carriage);
  model.bodies[2].parent = 1;
  model.bodies[2].placement = {rotation_of(random.vector(2.0)), random.vector(0.5)};
  model.bodies[3].parent = 2;
  model.bodies[4].parent = 3;
  Loop& loop = model.loops[0];
  loop.root = 1;
  loop.first = 2;
  loop.terminal = 4;
  loop.dependent = {2, 3, 4};
  loop.point_on_closing = random.vector(0.2);
  model.home_q.clear();
  number_coordinates(model);
  return model;
}

TEST(SlideLeg, closed_form_and_newton_iteration_agree_over_random_poses) {
  TestRandom random(14);
  Residual coordinates, gap, margins;
  int solved = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const MechanismModel model = make_placed_leg(random);
    const Mechanism closed(model), iterated(model, true);
    ASSERT_TRUE(closed.plan.blocks[0].form() != nullptr);
    ASSERT_FALSE(iterated.plan.blocks[0].form() != nullptr);
    MechanismData<double> a(closed), b(iterated);
    a.tree.q.head<3>() = random.vector(1.5);
    a.tree.q.segment<4>(3) = quat_exp<double>(random.vector(2.0));
    a.tree.q[7] = random.uniform(-3, 3);
    const Status status = calc_loop_position(closed.model, closed.plan, a.tree, a.loops);
    if (!status.ok() || a.loops.block[0].margin < 0.2) continue;
    ++solved;
    b.tree.q = a.tree.q;
    for (int j = 8; j < 11; ++j) b.tree.q[j] += random.uniform(-0.05, 0.05);
    ASSERT_TRUE(calc_loop_position(iterated.model, iterated.plan, b.tree, b.loops).ok()) << trial;
    coordinates.add((a.tree.q - b.tree.q).cwiseAbs().maxCoeff(), std::to_string(trial));
    gap.add(find_closure_residual(closed, a), std::to_string(trial));
    gap.add(find_closure_residual(iterated, b), std::to_string(trial));
  }
  EXPECT_GT(solved, 700);
  EXPECT_RESIDUAL_BELOW(coordinates, 4e-14);  // measured 3.6e-15
  EXPECT_RESIDUAL_BELOW(gap, 4e-14);          // measured 3.8e-15
}

TEST(SlideLeg, angles_stay_within_half_a_turn_of_where_they_were) {
  const Mechanism mechanism(read_mechanism(make_leg(1, 0, 0, "R2P1R3").dump(), "leg"));
  MechanismData<double> data(mechanism);
  const double pi = 3.14159265358979323846;
  double last = 0.0;
  for (int i = 0; i <= 400; ++i) {  // the tip circles the first axis twice
    const double angle = i * pi / 100;
    ASSERT_TRUE(close_leg(mechanism, V(std::cos(angle), 0.1, -std::sin(angle)), data).ok());
    EXPECT_LT(std::abs(data.tree.q[7] - last), 0.04);
    last = data.tree.q[7];
  }
  EXPECT_NEAR(last, 4 * pi, scaled_tolerance(1e-14));
}

TEST(SlideLeg, the_margin_falls_to_zero_where_the_first_axis_loses_its_effect) {
  const auto make = [](const char* closure) {
    json document = make_leg(0.5, 0, 0, closure);
    document["home_q"] = {0.5, 0, 0, 1, 0, 0, 0, 0, 0, 0};
    return Mechanism(read_mechanism(document.dump(), "leg"));
  };
  const Mechanism closed = make("R2P1R3"), iterated = make("newton");
  Residual exact;
  double last = 1.0;
  for (double x : {0.4, 0.1, 1e-2, 1e-3, 2e-4}) {
    MechanismData<double> a(closed), b(iterated);
    const V tip(x, std::sqrt(0.25 - x * x), 0);  // 0.5 m away; the second axis turned by acos(2 x)
    ASSERT_TRUE(close_leg(closed, tip, a).ok());
    const double margin = a.loops.block[0].margin;
    exact.add(margin - 2 * x);
    EXPECT_LT(margin, last);
    last = margin;
    b.tree.q = a.tree.q;
    ASSERT_TRUE(close_leg(iterated, tip, b).ok());
    // The bound from the inverse matrix is below the exact one, within sqrt(3).
    EXPECT_LE(b.loops.block[0].margin, margin);
    EXPECT_GE(b.loops.block[0].margin, margin / std::sqrt(3.0));
  }
  EXPECT_RESIDUAL_BELOW(exact, 1e-15);  // measured 0
  MechanismData<double> a(closed), b(iterated);
  const double x = 0.25 * SingularityLimits().error;
  const V tip(x, std::sqrt(0.25 - x * x), 0);
  const Status status = close_leg(closed, tip, a);
  EXPECT_EQ(status.code, StatusCode::kLoopSingular);
  EXPECT_EQ(status.index, 0);
  EXPECT_NEAR(status.margin, 0.5 * SingularityLimits().error, 1e-9);
  b.tree.q = a.tree.q;
  EXPECT_EQ(close_leg(iterated, tip, b).code, StatusCode::kLoopSingular);
}

TEST(Newton, a_linkage_that_cannot_reach_is_not_closed_by_force) {
  // Crank 0.2, coupler 0.5, rocker 0.35: with the base pivot moved to 3 m nothing meets.
  json document = json::parse(read_test_file("planar_two_loop.json"))["mechanism"];
  document["bodies"][1]["joint"]["position"] = {3.0, 0.05, 0.0};
  const Mechanism mechanism(read_mechanism(document.dump(), "far"), true);
  MechanismData<double> data(mechanism);
  data.tree.q << 1.0, 1.4, 2.2, 0, 0, 0;
  const Status status = calc_position(mechanism, data);
  EXPECT_TRUE(status.code == StatusCode::kLoopNotClosed ||
              status.code == StatusCode::kLoopSingular);
  EXPECT_EQ(status.index, 0);
}

TEST(Newton, a_changed_assembly_branch_is_noticed_once_the_start_has_fixed_it) {
  const json document = json::parse(read_test_file("planar_two_loop.json"));
  const Mechanism mechanism(read_mechanism(document.dump(), "planar"), true);
  MechanismData<double> data(mechanism);
  const VecX<double> home = data.tree.q;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  const int sign = data.loops.block[0].sign;
  EXPECT_NE(sign, 0);
  // The rocker mirrored at the line from its pivot to the crank pin.
  const V pin(0.2 * std::cos(1.0), 0.2 * std::sin(1.0), 0), pivot(0.5, 0.05, 0);
  const double line = std::atan2(pin.y() - pivot.y(), pin.x() - pivot.x());
  VecX<double> mirrored = home;
  mirrored[1] = 2 * line - home[1];
  mirrored[2] = -home[2];
  data.tree.q = mirrored;
  const Status unguarded =
      calc_loop_position(mechanism.model, mechanism.plan, data.tree, data.loops);
  EXPECT_TRUE(unguarded.ok() || unguarded.index == 1);
  EXPECT_EQ(data.loops.block[0].sign, -sign);
  // Accepted at home, found mirrored: H jumps with the sign.
  data.tree.q = home;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  keep_reference(mechanism, data);
  data.loops.block[0].sign = -sign;
  const MatX<double> H = data.loops.block[0].H;
  data.loops.reference.sign[0] = -sign;
  data.loops.reference.H[0] = -H;
  data.tree.q = home;
  const Status status = calc_position(mechanism, data);
  EXPECT_EQ(status.code, StatusCode::kBranchChanged);
  EXPECT_EQ(status.index, 0);
  // A sign that changes while H goes on smoothly is a pose where branches meet: passed.
  data.loops.reference.H[0] = H;
  data.tree.q = home;
  EXPECT_TRUE(calc_position(mechanism, data).ok());
}

/// Message with which a changed planar_two_loop (home stated) is refused.
std::string refuse(void (*change)(json&)) {
  json document = json::parse(read_test_file("planar_two_loop.json"));
  change(document);
  const std::string text = document.dump();
  return find_refusal([&] {
    Mechanism mechanism(read_mechanism(text, "wrong.json"));
    close_home(mechanism, "wrong.json");
  });
}

void expect_mentions(const std::string& text, const std::vector<std::string>& words) {
  for (const std::string& word : words) {
    EXPECT_NE(text.find(word), std::string::npos) << "'" << word << "' not in: " << text;
  }
}

TEST(LoopTable, a_sound_one_is_accepted) {
  EXPECT_EQ(refuse([](json&) {}), "");
}

TEST(LoopTable, too_few_dependent_joints_are_refused) {
  expect_mentions(refuse([](json& d) { d["mechanism"]["loops"][0]["dependent"] = {"fb1_rocker"}; }),
                  {"'fb1'", "2 cut equations", "1 dependent"});
}

TEST(LoopTable, a_joint_that_two_loops_determine_is_refused) {
  expect_mentions(refuse([](json& d) {
                    d["mechanism"]["loops"][1]["dependent"] = {"strut_cyl", "fb1_coupler"};
                  }),
                  {"'strut'", "'fb1_coupler'", "'fb1'"});
}

TEST(LoopTable, a_dependent_joint_off_the_loop_is_refused) {
  expect_mentions(
      refuse([](json& d) { d["mechanism"]["loops"][0]["dependent"] = {"fb1_rocker", "slider"}; }),
      {"'fb1'", "'slider'", "not on the loop"});
}

TEST(LoopTable, a_root_off_the_path_is_refused) {
  expect_mentions(refuse([](json& d) { d["mechanism"]["loops"][0]["root"] = "crank"; }),
                  {"'fb1'", "root"});
}

TEST(LoopTable, unknown_bodies_are_refused) {
  expect_mentions(refuse([](json& d) { d["mechanism"]["loops"][1]["closing"] = "copler"; }),
                  {"wrong.json", "'strut'", "closing", "'copler'"});
}

TEST(LoopTable, an_unknown_cut_is_refused_with_the_known_ones) {
  expect_mentions(refuse([](json& d) { d["mechanism"]["loops"][1]["cut"]["type"] = "R4"; }),
                  {"wrong.json", "R4", "R3", "R2", "R1_planar"});
}

TEST(LoopTable, planes_that_are_not_orthonormal_are_refused) {
  expect_mentions(refuse([](json& d) {
                    d["mechanism"]["loops"][0]["cut"]["plane_axes_in_root"] = {{1, 0, 0},
                                                                               {0.1, 1, 0}};
                  }),
                  {"wrong.json", "plane_axes_in_root", "orthonormal"});
}

TEST(LoopTable, a_stated_home_that_is_far_open_is_refused_with_its_gap_and_the_limit) {
  expect_mentions(refuse([](json& d) { d["home_q"][0] = 1.2; }),
                  {"'fb1'", "open by 0.0", "limit 0.0085 m", "home_q"});
  EXPECT_EQ(refuse([](json& d) { d["home_q"][0] = 1.001; }), "");  // a first guess
}

TEST(LoopTable, free_joints_cannot_be_dependent) {
  json document = make_leg(1, 0, 0, "automatic");
  document["loops"][0]["dependent"] = {"cross", "cylinder", "plate"};
  expect_mentions(
      find_refusal([&] { Mechanism mechanism(read_mechanism(document.dump(), "leg")); }),
      {"'the_leg'", "'plate'", "free"});
}

TEST(LoopTable, a_declared_closed_form_that_does_not_fit_is_refused) {
  json document = make_leg(1, 0, 0, "R2P1R3");
  document["bodies"][2]["joint"]["axis"] = {0.01, 0,
                                            0.99995};        // not square to the first axis: fits
  document["bodies"][2]["joint"]["position"] = {0.1, 0, 0};  // but not through one point
  expect_mentions(
      find_refusal([&] { Mechanism mechanism(read_mechanism(document.dump(), "leg")); }),
      {"'the_leg'", "R2P1R3", "leave 'closure' out"});
  document["loops"][0]["closure"] = "automatic";
  const Mechanism mechanism(read_mechanism(document.dump(), "leg"));
  EXPECT_FALSE(mechanism.plan.blocks[0].form() != nullptr);
}

}  // namespace
}  // namespace dockloop
