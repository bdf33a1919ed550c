// Laws of force elements.
// 1. stored vectors of an independent program: force, energy, powers, rate of the bristle;
// 2. f v = -dU/dt - D + W with D >= 0 at random states, dU/dt by dual numbers;
// 3. each impossible law is refused with the member and its limit.
#include "mechanism/force_laws.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "mechanism/element_forces.hpp"
#include "model/mechanism_model.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;

/// A slide with one element with these laws.
json make_document(const json& laws) {
  return {{"name", "slide"},
          {"bodies",
           {{{"name", "block"},
             {"parent", "base"},
             {"joint", {{"type", "prismatic"}, {"axis", {1, 0, 0}}}},
             {"mass", 40}}}},
          {"forces",
           {{{"name", "one"}, {"along", {{{"joint", "block"}, {"ratio", 1}}}}, {"laws", laws}}}}};
}

MechanismModel read(const json& laws) {
  return read_mechanism(make_document(laws).dump(), "slide.json");
}

/// A law of the stored file, completed by what the file leaves to its vectors.
ForceLaw read_law(json law) {
  if (law["type"] == "motor") law["commanded"] = true;
  return read(json::array({law})).elements[0].laws[0];
}

template <class S>
LawTerms<S> evaluate(const ForceLaw& law, const LawInput<S>& in) {
  return std::visit([&](const auto& each) { return calc_law(each, in); }, law);
}

TEST(ForceLaws, stored_vectors_are_met) {
  const json data = read_contact_data("joint_laws.json");
  Residual worst;
  int count = 0;
  for (const json& entry : data["laws"]) {
    for (const json& at : entry["vectors"]) {
      json described = entry["law"];
      if (at.contains("engagement")) described["engagement"] = at["engagement"];
      const ForceLaw law = read_law(described);
      LawInput<double> in;
      in.s = at.value("s", 0.0);
      in.v = at.value("v", 0.0);
      in.z = at.value("z", 0.0);
      in.time = at.value("t", 0.0);
      in.command = at.value("voltage", 0.0);
      const LawTerms<double> out = evaluate(law, in);
      const auto compare = [&](const char* name, double value, double scale) {
        if (!at.contains(name)) return;
        worst.add((value - at[name].get<double>()) / scale,
                  entry["name"].get<std::string>() + " " + name);
        ++count;
      };
      const double force = std::max(1.0, std::abs(out.force));
      compare("force", out.force, force);
      compare("energy", out.energy, std::max(1.0, out.energy));
      compare("dissipated", out.dissipation, std::max(1.0, out.dissipation));
      compare("z_rate", out.z_rate, 1.0);
      compare("work", out.work, force);
    }
  }
  EXPECT_GE(count, 150);
  EXPECT_RESIDUAL_BELOW(worst, 4e-13);
}

/// One of every law, with corners, other figures backwards, tables.
std::vector<json> list_laws() {
  return {
      {{"type", "spring"},
       {"stages", {{0, 5e3}, {0.05, 2e4}}},
       {"preload", 150},
       {"take_up", 1e-3},
       {"corner", 5e-4},
       {"rest", 0.01}},
      {{"type", "spring"},
       {"stages", {{0.01, 1e5}, {0.03, 1e6}}},
       {"side", "positive"},
       {"corner", 1e-3},
       {"preload", 50},
       {"take_up", 3e-3}},
      {{"type", "spring"}, {"stages", {{0.02, 2e4}}}, {"side", "negative"}, {"corner", 1e-3}},
      {{"type", "constant"}, {"force", 35}},
      {{"type", "damper"},
       {"linear", 500},
       {"linear_back", 4000},
       {"quadratic", 1e4},
       {"quadratic_back", 0},
       {"limit", 900},
       {"orifice", {{-0.05, 1}, {0, 1}, {0.05, 3}}}},
      {{"type", "eddy"}, {"slope", 2000}, {"peak_rate", 0.15}},
      {{"type", "brake"},
       {"forward", 200},
       {"back", 450},
       {"presliding", 5e-5},
       {"load_share", 0.1}},
      {{"type", "brake"}, {"forward", 0}, {"back", 450}, {"model", 1}},
      {{"type", "motor"},
       {"constant", 0.05},
       {"resistance", 0.6},
       {"current_limit", 8},
       {"voltage_limit", 28},
       {"corner", 0.4},
       {"commanded", true}},
      {{"type", "drive"},
       {"target", -0.05},
       {"speed", 0.1},
       {"acceleration", 0.02},
       {"gain", 2e5},
       {"limit", 600},
       {"corner", 30}},
      {{"type", "stop"},
       {"lower", -0.03},
       {"upper", 0.04},
       {"stiffness", 2e6},
       {"damping", 1},
       {"toe", 1e-3}},
      {{"type", "table"},
       {"travel", {-0.05, -0.01, 0.0, 0.02, 0.06}},
       {"rates", {-0.2, 0.0, 0.1}},
       {"force", {{90, 30, 9, -5, -95}, {80, 20, 0, -15, -99}, {75, 15, -2, -45, -99}}},
       {"factor", 2.5},
       {"rest", 0.003},
       {"outside", "extend"},
       {"outside_rate", "extend"}},
  };
}

TEST(ForceLaws, powers_add_up_and_nothing_is_dissipated_backwards) {
  TestRandom random(18);
  Residual worst;
  double least = 0.0;
  for (const json& described : list_laws()) {
    const ForceLaw law = read_law(described);
    for (int n = 0; n < 2000; ++n) {
      using D = Dual<1>;
      LawInput<double> in;
      in.s = random.uniform(-0.08, 0.08);
      in.v = random.uniform(-0.3, 0.3);
      in.z = random.uniform(-1e-4, 1e-4);
      in.time = random.uniform(0.0, 10.0);
      in.command = random.uniform(-40.0, 40.0);
      in.load = random.uniform(0.0, 800.0);
      const LawTerms<double> at = evaluate(law, in);
      // Along the motion: ds/dt = v, dz/dt = z_rate.
      LawInput<D> moving;
      moving.s = D(in.s), moving.s.d[0] = in.v;
      moving.z = D(in.z), moving.z.d[0] = at.z_rate;
      moving.v = D(in.v), moving.time = D(in.time), moving.command = D(in.command);
      moving.load = D(in.load);
      const double stored = evaluate(law, moving).energy.d[0];
      const double power = at.force * in.v;
      const double scale = 1.0 + std::abs(power) + std::abs(stored) + std::abs(at.dissipation);
      worst.add((power + stored + at.dissipation - at.work) / scale, described.dump());
      least = std::min(least, at.dissipation / scale);
    }
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-12);
  EXPECT_GE(least, -1e-14);
}

TEST(ForceLaws, the_energy_of_a_table_is_the_integral_of_its_force_to_32_digits) {
  // Simpson's rule is exact for a cubic: both sides belong to the same interpolant, or they differ.
  const json described = {{"type", "table"},
                          {"travel", {-0.05, -0.01, 0.0, 0.02, 0.06}},
                          {"force", {80, 20, 1, -15, -99}},
                          {"outside", "extend"}};
  const ForceLaw law = read_law(described);
  const auto at = [&](const Extended& s) {
    LawInput<Extended> in;
    in.s = s;
    return evaluate(law, in);
  };
  const Extended ends[] = {Extended(-0.07), Extended(-0.05), Extended(-0.01), Extended(0.0),
                           Extended(0.02),  Extended(0.06),  Extended(0.1)};
  for (int i = 0; i + 1 < 7; ++i) {
    const Extended a = ends[i], b = ends[i + 1], middle = (a + b) / Extended(2);
    const Extended work =
        (b - a) / Extended(6) * (at(a).force + Extended(4) * at(middle).force + at(b).force);
    EXPECT_LT(std::abs(to_double(work + at(b).energy - at(a).energy)), 1e-29) << i;
  }
  EXPECT_EQ(to_double(at(Extended(0.0)).energy), 0.0);
}

TEST(ForceLaws, a_bristle_brake_below_a_tenth_of_engagement_is_open) {
  json brake = {{"type", "brake"}, {"forward", 200}, {"engagement", 0.09}};
  const ForceLaw open = read_law(brake);
  LawInput<double> in;
  in.v = 0.1;
  in.z = 1e-6;
  const LawTerms<double> out = evaluate(open, in);
  EXPECT_EQ(out.force, 0.0);
  EXPECT_LT(out.z_rate, 0.0);
  EXPECT_NEAR(out.dissipation, -200.0 / 3e-5 * in.z * out.z_rate, 1e-12);
}

TEST(ForceLaws, the_bristle_of_an_open_brake_ends_smoothly_at_rest) {
  // A jump of z' at z = 0 lets the bristle chatter there: energy is lost in the sums.
  const ForceLaw open = read_law({{"type", "brake"}, {"forward", 200}, {"engagement", 0.0}});
  LawInput<double> in;
  for (const double v : {-0.02, 0.02}) {
    in.v = v;
    for (const double z : {-1e-12, 1e-12}) {
      in.z = z;
      EXPECT_NEAR(evaluate(open, in).z_rate, 0.0, 1e-12);
      EXPECT_NEAR(evaluate(open, in).force, 0.0, 1e-9);
    }
  }
}

TEST(ForceLaws, an_element_along_two_joints_acts_on_both_with_its_ratios) {
  json document = make_document(json::array({{{"type", "spring"}, {"stages", {{0, 100}}}}}));
  json second = document["bodies"][0];
  second["name"] = "slide";
  document["bodies"].push_back(second);
  document["forces"][0]["along"] = {{{"joint", "block"}, {"ratio", 0.5}},
                                    {{"joint", "slide"}, {"ratio", -2.0}}};
  const MechanismModel model = read_mechanism(document.dump(), "two.json");
  VecX<double> q(2), v(2), tau(2);
  q << 0.1, 0.2;
  v << 1.0, 3.0;
  tau << 7.0, 0.0;
  ElementData<double> data(model);
  calc_element_forces<double>(model, q, v, 0.0, nullptr, {}, nullptr, data, tau);
  EXPECT_DOUBLE_EQ(data.coordinate[0], -0.35);
  EXPECT_DOUBLE_EQ(data.rate[0], -5.5);
  EXPECT_DOUBLE_EQ(data.force[0], 35.0);
  EXPECT_DOUBLE_EQ(tau[0], 7.0 + 17.5);
  EXPECT_DOUBLE_EQ(tau[1], -70.0);
}

/// The message that refuses these laws.
std::string find_refusal(const json& law) {
  try {
    read(json::array({law}));
  } catch (const ModelError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ForceLaws, impossible_laws_are_refused_with_member_value_and_limit) {
  json spring = {{"type", "spring"}, {"stages", {{0, 8e3}, {0.06, 4e4}}}};
  const auto expect = [](const json& law, const std::string& part) {
    EXPECT_NE(find_refusal(law).find(part), std::string::npos) << find_refusal(law);
  };
  const auto with = [](json law, const json& members) {
    law.update(members);
    return law;
  };
  expect(spring, "accepted");
  expect(with(spring, {{"corner", 0.031}}), "corner is 0.031; it must be at most 0.03");
  expect(with(spring, {{"preload", 150}}), "preload is 150 without take_up");
  expect(with(spring, {{"preload", 150}, {"take_up", 1e-3}, {"corner", 2e-3}}),
         "corner is 0.002; it must be at most 0.001");
  expect(with(spring, {{"preload", 150}, {"take_up", 0.07}}), "take_up is 0.07");
  expect(with(spring, {{"stages", {{0.01, 8e3}}}}), "first stage starts at 0.01");
  expect(with(spring, {{"stages", {{0, 1}, {0, 2}}}}), "stage 2 starts at 0");
  expect(with(spring, {{"stages", {{0, -1}}}}), "stage[1].stiffness is -1");
  expect(with(spring, {{"side", "up"}}), "side is 'up'");
  json brake = {{"type", "brake"}, {"forward", 200}, {"back", 19}};
  expect(brake, "at least 0.1 of the larger");
  expect(with(brake, {{"model", 1}}), "accepted");
  expect(with(brake, {{"forward", 0}, {"back", 0}}), "needs a level above 0");
  expect(with(brake, {{"back", 450}, {"engagement", 1.5}}), "engagement is 1.5");
  expect(with(brake, {{"back", 450}, {"presliding", 0}}), "presliding is 0; it must be above 0");
  expect({{"type", "drive"}, {"target", 0}, {"speed", 1}, {"acceleration", 1}, {"gain", 1}},
         "lacks the member 'limit'");
  expect({{"type", "stop"}, {"lower", 1}, {"upper", 0}, {"stiffness", 1}, {"toe", 1}},
         "lower is 1; it must be less than upper, 0");
  json table = {{"type", "table"}, {"travel", {0, 0.1, 0.2}}, {"force", {0, -3, -9}}};
  expect(table, "accepted");
  expect(with(table, {{"travel", {0, 0.1, 0.1}}}), "travel[3] is 0.1; it must be above travel[2]");
  expect(with(table, {{"travel", {0, 0.1}}}), "force has 3 rows; travel has 2");
  expect(with(table, {{"travel", {0}}, {"force", {0}}}), "travel has 1 rows");
  expect(with(table, {{"outside", "stop"}}), "is 'stop'; it must be refuse, hold or extend");
  const json rated = with(table, {{"rates", {0, 1}}, {"force", {{0, -3, -9}, {-1, -4, -12}}}});
  expect(rated, "accepted");
  expect(with(rated, {{"rates", {0.5, 1}}}), "rates lack 0");
  expect(with(rated, {{"factor", -1}}), "it must not drive the motion");
  expect({{"type", "glue"}}, "known laws are spring, constant, damper, eddy, brake, motor, drive");
  expect(
      {{"type", "motor"}, {"constant", 1}, {"resistance", 1}, {"current_limit", 8}, {"corner", 9}},
      "corner is 9; it must be at most current_limit, 8");
  expect({{"type", "motor"},
          {"constant", 1},
          {"resistance", 1},
          {"current_limit", 8},
          {"voltage", 1},
          {"current", 1}},
         "has both voltage and current");
}

}  // namespace
}  // namespace dockloop
