// The class for programs in C++ (api/docking.hpp). tests/test_cpp.py installs it and uses it from
// outside; tests/test_python.py and others use it through Python.
//
// Verified: (1) names and rows set and read the same; (2) a state goes on with the same bits in
// another docking; (3) what is refused, a failed step included, changes nothing and is one sentence
// without a function of FMI; (4) a docking can be moved.
#include <gtest/gtest.h>

#include <string>

#include "api/docking.hpp"

namespace dockloop {
namespace {

constexpr double kStep = 0.01;  // s
constexpr const char* kForce = "chaser.force_ext[2]";

Docking make_docking() { return Docking(DOCKLOOP_TEST_DATA "/scene_minimal.json"); }

void step_to(Docking& docking, double end) {
  while (docking.time() < end) docking.step(kStep);
}

std::vector<double> read_all(Docking& docking) {
  std::vector<std::string> names;
  for (const VariableFacts& v : docking.variables()) names.push_back(v.name);
  return docking.get(docking.find(names));
}

/// The sentence with which `body` is refused.
template <class Error, class Body>
std::string find_refusal(Body&& body) {
  try {
    body();
  } catch (const Error& error) {
    const std::runtime_error& general = error;
    return general.what();
  }
  return "not refused";
}

TEST(Api, NamesAndRowsAreTheSame) {
  Docking docking = make_docking();
  docking.set("friction.coefficient", 0.25);
  const std::vector<int> rows = docking.find({"friction.coefficient", "chaser.mass"});
  EXPECT_EQ(docking.get(rows), (std::vector<double>{0.25, 25000.0}));
  docking.set(rows, {0.5, 24000.0});
  EXPECT_EQ(docking.get("chaser.mass"), 24000.0);
  const VariableFacts mass = docking.variables()[static_cast<size_t>(rows[1])];
  EXPECT_EQ(mass.name, "chaser.mass");
  EXPECT_EQ(mass.unit, "kg");
  EXPECT_EQ(mass.start, 24000.0);
}

TEST(Api, AStateGoesOnInAnotherDocking) {
  Docking first = make_docking(), second = make_docking();
  first.set("chaser.mass", 24000.0);
  step_to(first, 0.5);
  second.restore(first.save());
  EXPECT_EQ(second.time(), first.time());
  step_to(first, 1.0);
  step_to(second, 1.0);
  EXPECT_EQ(read_all(second), read_all(first));
  EXPECT_EQ(second.save(), first.save());
  EXPECT_GT(first.get("capture.peak.compression"), 1000.0);  // the absorber was hit
}

TEST(Api, AFailedStepChangesNothing) {
  Docking docking = make_docking(), other = make_docking();
  step_to(docking, 0.3);
  step_to(other, 0.3);
  docking.set(kForce, 1e30);
  const std::vector<char> before = docking.save();
  const std::string why = find_refusal<StepError>([&] { docking.step(kStep); });
  EXPECT_NE(why, "not refused");
  EXPECT_EQ(docking.save(), before);
  docking.set(kForce, 0.0);
  step_to(docking, 0.6);
  step_to(other, 0.6);
  EXPECT_EQ(docking.save(), other.save());
}

TEST(Api, WhatIsRefusedIsOneSentenceAndChangesNothing) {
  Docking docking = make_docking();
  const std::vector<char> before = docking.save();
  const auto refuses = [&](const std::string& sentence, auto&& body) {
    EXPECT_EQ(find_refusal<UsageError>(body), sentence);
    EXPECT_EQ(docking.save(), before) << sentence;
  };
  refuses("there is no variable 'chaser.mas': 'dockloop variables SCENE' lists them",
          [&] { docking.get("chaser.mas"); });
  refuses("Docking.set: 'phase' is computed and cannot be set", [&] { docking.set("phase", 2); });
  refuses("'phase' is computed and cannot be set",
          [&] { docking.set(docking.find({"phase"}), {2}, ""); });
  refuses("Docking.set: there are 1 values for 2 rows: must be one for each",
          [&] { docking.set(docking.find({"chaser.mass", "target.mass"}), {1.0}); });
  refuses("there is no row -1: variables have the rows 0 to " +
              std::to_string(docking.variables().size() - 1),
          [&] { docking.get(std::vector<int>{-1}); });
  refuses("Docking.step: h is -0.01 s: must be a positive, finite number",
          [&] { docking.step(-0.01); });
  refuses("these bytes are not a saved state of a dockloop FMU",
          [&] { docking.restore(std::vector<char>(100, 'x')); });
  refuses(
      "no.json: no such file: 'dockloop build SCENE -o FILE.json' writes the document of a scene",
      [] { Docking("no.json"); });
  refuses("own.json: document has format ''; this build reads dockloop-scene/1",
          [] { Docking("{}", "own.json"); });
  docking.set("chaser.mass", 24000.0);  // the start values can still be set
}

TEST(Api, ADockingCanBeMoved) {
  Docking first = make_docking();
  step_to(first, 0.02);
  Docking second = std::move(first);
  step_to(second, 0.3);
  first = std::move(second);
  EXPECT_GE(first.time(), 0.3);
}

}  // namespace
}  // namespace dockloop
