// Reading documents: what is too much is refused with one sentence, before it can do harm.
//
// Verified: (1) numbers that overflow when computed with, choices that are no whole numbers, lists
// without end, deep nesting and quaternions of length 0 are refused with file, member, value and
// limit; (2) values at the limit are read; (3) messages stay short however long the value is;
// (4) a mechanism states every dimension of its rings, with angles in rad or, in a file, in
// degrees; (5) a member that is null is as good as absent.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "minimal_scene.hpp"
#include "model/json_reader.hpp"

namespace dockloop {
namespace {

using nlohmann::json;

/// Why a document is refused; empty if it is read.
template <class Read>
std::string refusal(Read read, const std::string& text) {
  try {
    read(text, "file.json");
  } catch (const ModelError& error) {
    return error.what();
  }
  return "";
}

/// The minimal scene with one member changed.
std::string scene_with(const char* pointer, const json& value) {
  json document = json::parse(minimal_scene_text());
  document[json::json_pointer(pointer)] = value;
  return refusal(read_scene, document.dump());
}

void expect_parts(const std::string& text, const std::vector<std::string>& parts) {
  for (const std::string& part : parts) {
    EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is not in '" << text << "'";
  }
}

TEST(ModelReading, numbers_that_overflow_are_refused_by_name) {
  expect_parts(scene_with("/chaser/mass", 1e31), {"file.json", "chaser.mass", "1e+31", "1e30"});
  expect_parts(scene_with("/target/inertia/1", -1e300), {"target.inertia[2]", "-1e+300"});
  EXPECT_EQ(scene_with("/chaser/mass", 1e30), "");
}

TEST(ModelReading, choices_are_whole_numbers_within_their_range) {
  for (const json& value : {json(0), json(3), json(1.5), json(1e30), json(-2147483649.0)}) {
    expect_parts(scene_with("/chaser/mass_includes_mechanism", value),
                 {"chaser.mass_includes_mechanism", value.dump(), "from 1 to 2"});
  }
  EXPECT_EQ(scene_with("/chaser/mass_includes_mechanism", 2), "");
}

TEST(ModelReading, lists_have_a_limit) {
  expect_parts(scene_with("/outputs/groups", std::vector<std::string>(1001, "phase")),
               {"outputs.groups", "1001 elements", "1000"});
  EXPECT_EQ(scene_with("/outputs/groups", std::vector<std::string>(1000, "phase")), "");
}

TEST(ModelReading, nesting_has_a_limit) {
  const auto nested = [](int depth) {
    return "{\"bodies\": " + std::string(depth, '[') + std::string(depth, ']') + "}";
  };
  expect_parts(refusal(read_mechanism, nested(65)), {"file.json", "nested", "64"});
  expect_parts(refusal(read_mechanism, nested(100000)), {"nested"});
  expect_parts(refusal(read_mechanism, nested(60)), {"bodies[1]", "must be an object"});
}

TEST(ModelReading, mechanisms_have_a_limit_of_their_degrees_of_freedom) {
  const auto chain = [](int bodies) {
    json list = json::array();
    for (int i = 0; i < bodies; ++i) {
      const std::string name = "b" + std::to_string(i);
      const std::string parent = i == 0 ? "base" : "b" + std::to_string(i - 1);
      list.push_back({{"name", name}, {"parent", parent}, {"joint", {{"type", "free"}}}});
    }
    return refusal(read_mechanism, json({{"bodies", list}}).dump());
  };
  expect_parts(chain(101), {"606 degrees of freedom", "600"});
  EXPECT_EQ(chain(100), "");
}

TEST(ModelReading, a_free_joint_at_home_has_a_unit_quaternion) {
  const auto home = [](double w) {
    const json body = {{"name", "ring"}, {"parent", "base"}, {"joint", {{"type", "free"}}}};
    return refusal(read_mechanism,
                   json({{"bodies", {body}}, {"home_q", {0, 0, 0, w, 0, 0, 0}}}).dump());
  };
  expect_parts(home(0.0), {"home_q", "'ring'", "unit quaternion", "its norm is 0"});
  expect_parts(home(1.01), {"unit quaternion", "1.01"});
  EXPECT_EQ(home(-1.0), "");
}

TEST(ModelReading, messages_stay_short) {
  const std::string text = scene_with("/chaser/mass", std::string(100000, 'x'));
  expect_parts(text, {"chaser.mass", "must be a number", "xxx..."});
  EXPECT_LT(text.size(), 200u) << text;
}

/// A shipped mechanism as it stands in its file: with comments and angles in degrees.
json read_default_mechanism() {
  return json::parse(std::ifstream(std::string(DOCKLOOP_MODELS) + "/mechanisms/idss_hexapod.json"));
}

TEST(ModelReading, rings_and_latches_of_a_file_are_read_in_degrees_or_radians) {
  json file = read_default_mechanism();
  const Capture written = read_capture(file.dump(), "file.json");
  for (const char* name : {"node_azimuth_offset", "petal_base_half_angle"}) {
    const std::string in_degrees = std::string(name) + "_deg";
    file["contact"][name] = kDegree * file["contact"][in_degrees].get<double>();
    file["contact"].erase(in_degrees);
  }
  for (const json& azimuth : file["latches"]["azimuth_deg"]) {
    file["latches"]["azimuth"].push_back(kDegree * azimuth.get<double>());
  }
  file["latches"].erase("azimuth_deg");
  const Capture plain = read_capture(json({{"mechanism", file}}).dump(), "file.json");
  ASSERT_EQ(written.latches.count(), 3);
  ASSERT_EQ(plain.latches.count(), 3);
  EXPECT_EQ(written.latches.latch[1].hook, plain.latches.latch[1].hook);
  EXPECT_NEAR(written.latches.latch[1].hook.norm(), 0.6, 1e-15);
  const Vec3<double>& hook = written.latches.latch[1].hook;
  EXPECT_NEAR(std::atan2(hook[2], hook[1]), 120 * kDegree, 1e-15);
  ASSERT_EQ(written.contact.active.size(), plain.contact.active.size());
  for (size_t i = 0; i < plain.contact.active.size(); ++i) {
    const Core &a = written.contact.active[i], &b = plain.contact.active[i];
    EXPECT_EQ(a.point, b.point);
    EXPECT_EQ(a.end, b.end);
  }
  EXPECT_TRUE(read_capture("{}", "file.json").contact.empty());
}

TEST(ModelReading, a_ring_states_all_its_dimensions) {
  const json file = read_default_mechanism();
  for (const auto& member : file["contact"].items()) {
    if (!member.value().is_number()) continue;
    json changed = file;
    changed["contact"].erase(member.key());
    const std::string name = member.key().substr(0, member.key().find("_deg"));
    expect_parts(refusal(read_capture, changed.dump()), {"file.json", "contact lacks", name});
  }
}

TEST(ModelReading, null_is_as_good_as_absent) {
  const json document = json::parse(R"({"closure": null})");
  EXPECT_EQ(JsonReader(document, "file.json").text("closure", "automatic"), "automatic");
  EXPECT_EQ(scene_with("/gravity", nullptr), "");
  const std::string missing = scene_with("/chaser/mass", nullptr);
  EXPECT_NE(missing.find("chaser lacks the member 'mass'"), std::string::npos) << missing;
}

}  // namespace
}  // namespace dockloop
