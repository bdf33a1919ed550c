// The FMI functions as a host sees them, right and wrong. They are linked without the shared
// library, which exports nothing but the C interface: the tests look at the states behind it.
//
// Verified: (1) which call is permitted in which state, for every pair; (2) refused calls change
// nothing and say why; (3) instantiation: GUID, type, every form of the resource location; (4) log
// lines are safe for printf-like loggers and may be switched off; (5) time keeping and the mapping
// of failures; (6) reset, many instances, values in initialization mode.
#include <gtest/gtest.h>

#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>

#include "minimal_scene.hpp"
#include "resource_location.hpp"
#include "unit/fmu_test_support.hpp"

namespace dockloop {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

struct Line {
  fmi2Status status;
  std::string category, text;
};

/// What most hosts do: hand the message to printf with whatever arguments follow.
void collect(fmi2ComponentEnvironment environment, fmi2String, fmi2Status status,
             fmi2String category, fmi2String message, ...) {
  char text[2000];
  va_list arguments;
  va_start(arguments, message);
  std::vsnprintf(text, sizeof text, message, arguments);
  va_end(arguments);
  static_cast<std::vector<Line>*>(environment)->push_back({status, category, text});
}

class Fmi : public ::testing::Test {
 protected:
  void SetUp() override {
    guid_ = find_guid(minimal_scene_text());
    c_ = instantiate();
    ASSERT_NE(c_, nullptr) << last_text();
    for (size_t i = 0; i < self().variables.size(); ++i) {
      reference_[self().variables[i].name] = static_cast<fmi2ValueReference>(i);
    }
    lines_.clear();
  }
  void TearDown() override { fmi2FreeInstance(c_); }

  fmi2Component instantiate(const char* location = nullptr, fmi2Boolean debug = fmi2False) {
    const std::string uri = resources_.uri();
    return fmi2Instantiate("dut", fmi2CoSimulation, guid_.c_str(),
                           location ? location : uri.c_str(), &callbacks_, fmi2False, debug);
  }
  Instance& self() { return *static_cast<Instance*>(c_); }
  void start(double t0 = 0.0) {
    ASSERT_EQ(fmi2SetupExperiment(c_, fmi2False, 0, t0, fmi2False, 0), fmi2OK) << last_text();
    ASSERT_EQ(fmi2EnterInitializationMode(c_), fmi2OK) << last_text();
    ASSERT_EQ(fmi2ExitInitializationMode(c_), fmi2OK) << last_text();
    lines_.clear();
  }
  fmi2Status set(const std::string& name, double value) {
    return fmi2SetReal(c_, &reference_.at(name), 1, &value);
  }
  static double get(fmi2Component c, fmi2ValueReference reference) {
    double value = kNan;
    EXPECT_EQ(fmi2GetReal(c, &reference, 1, &value), fmi2OK);
    return value;
  }
  double get(const std::string& name) { return get(c_, reference_.at(name)); }
  fmi2Status step(double t, double h) { return fmi2DoStep(c_, t, h, fmi2True); }
  std::string last_text() const { return lines_.empty() ? "" : lines_.back().text; }
  void expect_text(const std::string& part) const {
    EXPECT_NE(last_text().find(part), std::string::npos) << "'" << last_text() << "'";
  }
  /// All Real values.
  std::vector<double> snapshot(fmi2Component c) {
    std::vector<double> values;
    const std::vector<Variable>& rows = static_cast<Instance*>(c)->variables;
    for (size_t i = 0; i < rows.size(); ++i) {
      if (rows[i].type == Type::kReal) values.push_back(get(c, static_cast<unsigned>(i)));
    }
    return values;
  }

  Resources resources_;
  std::vector<Line> lines_;
  fmi2CallbackFunctions callbacks_{collect, nullptr, nullptr, nullptr, &lines_};
  std::string guid_;
  fmi2Component c_ = nullptr;
  std::map<std::string, fmi2ValueReference> reference_;
};

// ---------------------------------------------------------------- order of calls

TEST_F(Fmi, EveryForbiddenCallIsRefusedInEveryState) {
  fmi2Real real = 0;
  fmi2Integer integer = 0;
  fmi2Boolean boolean = 0;
  fmi2Status status = fmi2OK;
  fmi2String string = nullptr;
  const std::vector<std::pair<Call, std::function<fmi2Status()>>> calls = {
      {call::kSetDebugLogging, [&] { return fmi2SetDebugLogging(c_, fmi2True, 0, nullptr); }},
      {call::kSetupExperiment,
       [&] { return fmi2SetupExperiment(c_, fmi2False, 0, 0, fmi2False, 0); }},
      {call::kEnterInitializationMode, [&] { return fmi2EnterInitializationMode(c_); }},
      {call::kExitInitializationMode, [&] { return fmi2ExitInitializationMode(c_); }},
      {call::kTerminate, [&] { return fmi2Terminate(c_); }},
      {call::kReset, [&] { return fmi2Reset(c_); }},
      {call::kGetReal, [&] { return fmi2GetReal(c_, nullptr, 0, nullptr); }},
      {call::kGetInteger, [&] { return fmi2GetInteger(c_, nullptr, 0, nullptr); }},
      {call::kGetBoolean, [&] { return fmi2GetBoolean(c_, nullptr, 0, nullptr); }},
      {call::kGetString, [&] { return fmi2GetString(c_, nullptr, 0, nullptr); }},
      {call::kSetReal, [&] { return fmi2SetReal(c_, nullptr, 0, nullptr); }},
      {call::kSetInteger, [&] { return fmi2SetInteger(c_, nullptr, 0, nullptr); }},
      {call::kSetBoolean, [&] { return fmi2SetBoolean(c_, nullptr, 0, nullptr); }},
      {call::kSetString, [&] { return fmi2SetString(c_, nullptr, 0, nullptr); }},
      {call::kGetFMUstate, [&] { return fmi2GetFMUstate(c_, nullptr); }},
      {call::kSetFMUstate, [&] { return fmi2SetFMUstate(c_, nullptr); }},
      {call::kFreeFMUstate, [&] { return fmi2FreeFMUstate(c_, nullptr); }},
      {call::kSerializedFMUstateSize,
       [&] { return fmi2SerializedFMUstateSize(c_, nullptr, nullptr); }},
      {call::kSerializeFMUstate, [&] { return fmi2SerializeFMUstate(c_, nullptr, nullptr, 0); }},
      {call::kDeSerializeFMUstate,
       [&] { return fmi2DeSerializeFMUstate(c_, nullptr, 0, nullptr); }},
      {call::kGetDirectionalDerivative,
       [&] { return fmi2GetDirectionalDerivative(c_, nullptr, 0, nullptr, 0, nullptr, nullptr); }},
      {call::kSetRealInputDerivatives,
       [&] { return fmi2SetRealInputDerivatives(c_, nullptr, 0, nullptr, nullptr); }},
      {call::kGetRealOutputDerivatives,
       [&] { return fmi2GetRealOutputDerivatives(c_, nullptr, 0, nullptr, nullptr); }},
      {call::kDoStep, [&] { return step(0, kNan); }},
      {call::kCancelStep, [&] { return fmi2CancelStep(c_); }},
      {call::kGetStatus, [&] { return fmi2GetStatus(c_, fmi2DoStepStatus, &status); }},
      {call::kGetRealStatus, [&] { return fmi2GetRealStatus(c_, fmi2LastSuccessfulTime, &real); }},
      {call::kGetIntegerStatus,
       [&] { return fmi2GetIntegerStatus(c_, fmi2DoStepStatus, &integer); }},
      {call::kGetBooleanStatus, [&] { return fmi2GetBooleanStatus(c_, fmi2Terminated, &boolean); }},
      {call::kGetStringStatus, [&] { return fmi2GetStringStatus(c_, fmi2PendingStatus, &string); }},
      {call::kEnterEventMode, [&] { return fmi2EnterEventMode(c_); }},
      {call::kNewDiscreteStates, [&] { return fmi2NewDiscreteStates(c_, nullptr); }},
      {call::kEnterContinuousTimeMode, [&] { return fmi2EnterContinuousTimeMode(c_); }},
      {call::kCompletedIntegratorStep,
       [&] { return fmi2CompletedIntegratorStep(c_, fmi2True, nullptr, nullptr); }},
      {call::kSetTime, [&] { return fmi2SetTime(c_, kNan); }},
      {call::kSetContinuousStates, [&] { return fmi2SetContinuousStates(c_, nullptr, 0); }},
      {call::kGetDerivatives, [&] { return fmi2GetDerivatives(c_, nullptr, 0); }},
      {call::kGetEventIndicators, [&] { return fmi2GetEventIndicators(c_, nullptr, 0); }},
      {call::kGetContinuousStates, [&] { return fmi2GetContinuousStates(c_, nullptr, 0); }},
      {call::kGetNominals, [&] { return fmi2GetNominalsOfContinuousStates(c_, nullptr, 0); }},
  };
  ASSERT_EQ(calls.size(), 40u) << "44 without inquiry, instantiate and free";
  for (const State state : kStates) {
    for (const auto& [call, invoke] : calls) {
      SCOPED_TRACE(std::string(call.name) + " in state " + name_of(state));
      self().state = state;
      lines_.clear();
      const fmi2Status result = invoke();
      const bool refused = last_text().find("is not permitted in state") != std::string::npos ||
                           last_text().find("is for model exchange, but") != std::string::npos;
      EXPECT_EQ(refused, (call.permitted & state) == 0 || call.side == kForModelExchange);
      if (refused) {
        EXPECT_EQ(result, fmi2Error);
        EXPECT_EQ(self().state, state);
        EXPECT_EQ(lines_.back().category, "logStatusError");
        expect_text(call.name);
      }
    }
  }
}

TEST_F(Fmi, TheMessageOfAForbiddenCallNamesTheCallBefore) {
  EXPECT_EQ(step(0, 0.1), fmi2Error);
  EXPECT_EQ(last_text(),
            "fmi2DoStep is not permitted in state 'instantiated': call fmi2EnterInitializationMode "
            "and fmi2ExitInitializationMode first");
  EXPECT_EQ(fmi2EnterInitializationMode(c_), fmi2OK);
  EXPECT_EQ(step(0, 0.1), fmi2Error);
  expect_text("'initialization mode': call fmi2ExitInitializationMode first");
  EXPECT_EQ(fmi2SetupExperiment(c_, fmi2False, 0, 0, fmi2False, 0), fmi2Error);
  expect_text("call fmi2Reset first");
}

TEST_F(Fmi, CallsWithoutAnInstanceAreErrors) {
  EXPECT_EQ(fmi2DoStep(nullptr, 0, 1, fmi2True), fmi2Error);
  EXPECT_EQ(fmi2Reset(nullptr), fmi2Error);
  EXPECT_EQ(fmi2GetFMUstate(nullptr, nullptr), fmi2Error);
  fmi2FreeInstance(nullptr);
}

TEST_F(Fmi, CanBeFreedInEveryState) {
  for (const State state : kStates) {
    const fmi2Component c = instantiate();
    static_cast<Instance*>(c)->state = state;
    fmi2FreeInstance(c);
  }
}

// ---------------------------------------------------------------- instantiation

TEST(ResourceLocation, EveryFormInUseIsUnderstood) {
  const std::pair<const char*, const char*> forms[] = {
      {"file:///tmp/a/resources", "/tmp/a/resources"},
      {"file:/tmp/a/resources", "/tmp/a/resources"},
      {"file://localhost/tmp/a/resources/", "/tmp/a/resources"},
      {"FILE:///tmp/a", "/tmp/a"},
      {"file:///tmp/with%20blank/%C3%A9", "/tmp/with blank/\xc3\xa9"},
      {"file:///tmp/with blank", "/tmp/with blank"},
      {"file:///tmp/100%/x%2", "/tmp/100%/x%2"},
      {"/tmp/plain%20path/", "/tmp/plain%20path"},
      {"relative/resources", "relative/resources"},
      {"/", "/"},
      {"file:///C:/Users/a%20b/resources", "C:/Users/a b/resources"},
      {"file:/C:/Users", "C:/Users"},
      {"file://C:/Users", "C:/Users"},
      {"file:///C|/Users", "C:/Users"},
      {"C:\\Users\\resources\\", "C:\\Users\\resources"},
  };
  for (const auto& [location, folder] : forms) {
    EXPECT_EQ(resource_folder(location), folder) << location;
  }
  for (const char* location : {"", "file:", "file://", "file://server/share", "file://localhost",
                               "http://host/resources", "file:///tmp/%00"}) {
    EXPECT_THROW(resource_folder(location), std::invalid_argument) << location;
  }
}

TEST_F(Fmi, FindsItsResourcesInFoldersWithOddNames) {
  const Resources odd("a b%c");
  const std::string encoded = "file://" + odd.folder().substr(0, odd.folder().size() - 5);
  for (const std::string& location :
       {encoded + "a%20b%25c", encoded + "a%20b%25c/", odd.uri(), odd.folder()}) {
    const fmi2Component c = instantiate(location.c_str());
    EXPECT_NE(c, nullptr) << location << ": " << last_text();
    fmi2FreeInstance(c);
  }
}

TEST_F(Fmi, InstantiationFailsWithOneLineThatSaysWhy) {
  const std::string uri = resources_.uri();
  const Resources broken;
  std::ofstream(broken.folder() + "/model.json") << "{ 100%d";
  const std::string broken_uri = broken.uri();
  struct WrongCall {
    const char *name, *guid, *location;
    fmi2Type type;
    const char* text;
  };
  const WrongCall cases[] = {
      {nullptr, guid_.c_str(), uri.c_str(), fmi2CoSimulation, "instanceName"},
      {"", guid_.c_str(), uri.c_str(), fmi2CoSimulation, "instanceName"},
      {"dut", nullptr, uri.c_str(), fmi2CoSimulation, "fmuGUID"},
      {"dut", "100%s%n", uri.c_str(), fmi2CoSimulation, "fmuGUID is '100%s%n', but"},
      {"dut", guid_.c_str(), nullptr, fmi2CoSimulation, "fmuResourceLocation"},
      {"dut", guid_.c_str(), "file:///nowhere/%25d", fmi2CoSimulation, "/nowhere/%d/model.json"},
      {"dut", guid_.c_str(), broken_uri.c_str(), fmi2CoSimulation, "model.json"},
  };
  for (const WrongCall& k : cases) {
    SCOPED_TRACE(k.text);
    lines_.clear();
    EXPECT_EQ(
        fmi2Instantiate(k.name, k.type, k.guid, k.location, &callbacks_, fmi2False, fmi2False),
        nullptr);
    ASSERT_EQ(lines_.size(), 1u);
    EXPECT_EQ(lines_[0].status, fmi2Error);
    expect_text(k.text);
  }
  EXPECT_EQ(fmi2Instantiate("dut", fmi2CoSimulation, guid_.c_str(), uri.c_str(), nullptr, fmi2False,
                            fmi2False),
            nullptr);
}

// ---------------------------------------------------------------- logging

TEST_F(Fmi, WorksWithoutALogger) {
  callbacks_.logger = nullptr;
  EXPECT_EQ(instantiate("nowhere"), nullptr);
  const fmi2Component c = instantiate();
  ASSERT_NE(c, nullptr);
  EXPECT_EQ(fmi2DoStep(c, 0, 1, fmi2True), fmi2Error);
  fmi2FreeInstance(c);
}

TEST_F(Fmi, LogsOnlyTheCategoriesAskedFor) {
  const fmi2String unknown[] = {"logStatusError", "gossip"}, warnings[] = {"logStatusWarning"},
                   errors[] = {"logStatusError", "logEvents"};
  EXPECT_EQ(fmi2SetDebugLogging(c_, fmi2True, 2, unknown), fmi2Error);
  expect_text("'gossip'");
  const auto count = [&] {
    lines_.clear();
    EXPECT_EQ(fmi2CancelStep(c_), fmi2Error);
    return lines_.size();
  };
  EXPECT_EQ(count(), 1u) << "a refused filter changes nothing";
  EXPECT_EQ(fmi2SetDebugLogging(c_, fmi2True, 1, warnings), fmi2OK);
  EXPECT_EQ(count(), 0u);
  EXPECT_EQ(fmi2SetDebugLogging(c_, fmi2True, 2, errors), fmi2OK);
  EXPECT_EQ(count(), 1u);
  EXPECT_EQ(fmi2SetDebugLogging(c_, fmi2False, 0, nullptr), fmi2OK);
  EXPECT_EQ(count(), 0u);
  EXPECT_EQ(fmi2SetDebugLogging(c_, fmi2True, 0, nullptr), fmi2OK);
  EXPECT_EQ(count(), 1u);
}

TEST_F(Fmi, EveryLineHasADeclaredCategory) {
  fmi2SetDebugLogging(c_, fmi2True, 0, nullptr);
  start();
  EXPECT_EQ(step(0, 0.01), fmi2OK) << last_text();
  EXPECT_EQ(step(7, 0.01), fmi2Error);
  fmi2Integer value = 0;
  EXPECT_EQ(fmi2GetIntegerStatus(c_, fmi2DoStepStatus, &value), fmi2Discard);
  EXPECT_GE(lines_.size(), 2u);
  for (const Line& line : lines_) {
    const auto declared =
        std::find_if(kLogCategories.begin(), kLogCategories.end(),
                     [&](const LogCategory& k) { return k.name == line.category; });
    EXPECT_NE(declared, kLogCategories.end()) << line.category;
  }
}

// ---------------------------------------------------------------- get and set

TEST_F(Fmi, ASetIsAllOrNothing) {
  const double mass = get("chaser.mass");
  const fmi2ValueReference pair[] = {reference_.at("chaser.mass"), reference_.at("target.mass")};
  const double values[] = {mass + 1, kNan};
  EXPECT_EQ(fmi2SetReal(c_, pair, 2, values), fmi2Error);
  EXPECT_EQ(get("chaser.mass"), mass);
  expect_text("'target.mass' = nan is not a finite number");
}

TEST_F(Fmi, ImpossibleValuesAreRefusedByName) {
  start();
  EXPECT_EQ(set("gravity[2]", kNan), fmi2Error);
  expect_text("'gravity[2]' = nan");
  EXPECT_EQ(set("gravity[2]", std::numeric_limits<double>::infinity()), fmi2Error);
  expect_text("'gravity[2]' = inf");
  EXPECT_EQ(get("gravity[2]"), 0.0);
  EXPECT_EQ(fmi2Reset(c_), fmi2OK);
  EXPECT_EQ(set("chaser.mass", -1), fmi2Error);
  expect_text("'chaser.mass' = -1 is below its minimum 0 kg");
  const fmi2ValueReference method = reference_.at("solver.method");
  const fmi2Integer beyond = 14;
  EXPECT_EQ(fmi2SetInteger(c_, &method, 1, &beyond), fmi2Error);
  expect_text("'solver.method' = 14 is above its maximum 13");
}

TEST_F(Fmi, ReferencesAndTypesAreChecked) {
  const fmi2ValueReference beyond = static_cast<fmi2ValueReference>(self().variables.size());
  double value = 0;
  EXPECT_EQ(fmi2GetReal(c_, &beyond, 1, &value), fmi2Error);
  expect_text("no variable with value reference " + std::to_string(beyond));
  const fmi2ValueReference method = reference_.at("solver.method");
  EXPECT_EQ(fmi2GetReal(c_, &method, 1, &value), fmi2Error);
  expect_text("'solver.method'");
  expect_text("is not of type Real");
  EXPECT_EQ(fmi2SetReal(c_, &method, 1, &value), fmi2Error);
  EXPECT_EQ(fmi2GetReal(c_, nullptr, 1, &value), fmi2Error);
  EXPECT_EQ(fmi2GetReal(c_, &method, 1, nullptr), fmi2Error);
  fmi2String text = nullptr;
  EXPECT_EQ(fmi2GetString(c_, &method, 1, &text), fmi2Error);
}

TEST_F(Fmi, WhatMayBeSetDependsOnTheMoment) {
  EXPECT_EQ(set("chaser.force[1]", 1), fmi2Error);
  expect_text("is computed and cannot be set");
  EXPECT_EQ(set("chaser.mass", 1234), fmi2OK);
  EXPECT_EQ(get("chaser.mass"), 1234);
  EXPECT_EQ(set("chaser.velocity[2]", 0.25), fmi2OK);
  start();
  EXPECT_NEAR(get("chaser.velocity[2]"), 0.25, 1e-12);  // momentum inside
  EXPECT_EQ(set("chaser.mass", 1), fmi2Error);
  expect_text("'chaser.mass' is a fixed parameter");
  EXPECT_EQ(set("chaser.velocity[2]", 1), fmi2Error);
  expect_text("is a state");
  EXPECT_EQ(set("target.force_ext[1]", 1), fmi2OK);
  EXPECT_EQ(get("target.force_ext[1]"), 1);
}

TEST_F(Fmi, OutputsCanBeReadInInitializationModeAndFollowChanges) {
  double value = 0;
  const fmi2ValueReference axial = reference_.at("relative.position[1]");
  EXPECT_EQ(fmi2GetReal(c_, &axial, 1, &value), fmi2Error);
  expect_text("call fmi2EnterInitializationMode first");
  EXPECT_EQ(fmi2EnterInitializationMode(c_), fmi2OK);
  const double before = get("relative.position[1]");
  EXPECT_EQ(set("target.position[1]", get("target.position[1]") + 0.125), fmi2OK);
  EXPECT_NEAR(get("relative.position[1]"), before + 0.125, 1e-9);
  EXPECT_EQ(fmi2ExitInitializationMode(c_), fmi2OK);
  EXPECT_NEAR(get("relative.position[1]"), before + 0.125, 1e-9);
}

TEST_F(Fmi, ParametersThatCannotBeSimulatedAreNamedAndCanBeCorrected) {
  const double mass = get("chaser.mass");
  EXPECT_EQ(set("chaser.mass", 0), fmi2OK);
  EXPECT_EQ(fmi2EnterInitializationMode(c_), fmi2OK);
  EXPECT_EQ(fmi2ExitInitializationMode(c_), fmi2Error);
  expect_text("chaser.mass");
  EXPECT_EQ(set("chaser.mass", mass), fmi2OK);
  EXPECT_EQ(fmi2ExitInitializationMode(c_), fmi2OK) << last_text();
}

// ---------------------------------------------------------------- stepping

TEST_F(Fmi, StepsFollowTheClockOfTheHost) {
  start(100.0);
  double t = 100.0;
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(step(100.0 + 0.1 * i, 0.1), fmi2OK) << last_text();  // not the sum of the steps
    t += 0.1;
  }
  EXPECT_EQ(step(102.0, 0.0), fmi2Error);
  expect_text("communicationStepSize is 0 s");
  EXPECT_EQ(step(102.0, -0.1), fmi2Error);
  EXPECT_EQ(step(102.0, kNan), fmi2Error);
  EXPECT_EQ(step(102.01, 0.1), fmi2Error);
  expect_text("currentCommunicationPoint is 102.01 s, expected 102 s");
  EXPECT_EQ(step(kNan, 0.1), fmi2Error);
  // None of that has done harm; the step size may change, in nanoseconds if the host likes.
  EXPECT_EQ(step(t, 0.05), fmi2OK) << last_text();
  EXPECT_EQ(step(102.050000001, 1.0 / 60.0), fmi2OK) << last_text();
  double last = 0;
  EXPECT_EQ(fmi2GetRealStatus(c_, fmi2LastSuccessfulTime, &last), fmi2OK);
  EXPECT_EQ(last, 102.050000001 + 1.0 / 60.0);
}

TEST_F(Fmi, StatusIsMappedInOnePlace) {
  using Code = StatusCode;
  EXPECT_EQ(fmi_status(Code::kOk), fmi2OK);
  for (const Code code : {Code::kBranchChanged, Code::kLoopNotClosed, Code::kContactTooDeep,
                          Code::kContactFlipped, Code::kIntegrationFailed, Code::kLoopSingular}) {
    EXPECT_EQ(fmi_status(code), fmi2Discard);
  }
  for (const Code code : {Code::kOutOfReach, Code::kInertiaNotPositive, Code::kNotFinite}) {
    EXPECT_EQ(fmi_status(code), fmi2Error);
  }
}

TEST_F(Fmi, AFailedStepLeavesTheInstanceAtTheLastPoint) {
  start();
  ASSERT_EQ(step(0, 0.01), fmi2OK) << last_text();
  const std::vector<double> before = snapshot(c_);
  ASSERT_EQ(set("chaser.force_ext[2]", 1e30), fmi2OK);
  const fmi2Status status = step(0.01, 0.01);
  ASSERT_TRUE(status == fmi2Discard || status == fmi2Error) << status;
  ASSERT_EQ(lines_.size(), 1u);
  EXPECT_EQ(lines_[0].category, status == fmi2Discard ? "logStatusDiscard" : "logStatusError");
  EXPECT_EQ(self().state, status == fmi2Discard ? kStepFailed : kError);
  fmi2Status kept = fmi2OK;
  EXPECT_EQ(fmi2GetStatus(c_, fmi2DoStepStatus, &kept), fmi2OK);
  EXPECT_EQ(kept, status);
  double last = 0;
  EXPECT_EQ(fmi2GetRealStatus(c_, fmi2LastSuccessfulTime, &last), fmi2OK);
  EXPECT_EQ(last, 0.01);
  self().state = kStepFailed;  // from where the step may be repeated
  ASSERT_EQ(set("chaser.force_ext[2]", 0), fmi2OK);
  const std::vector<double> after = snapshot(c_);
  for (size_t i = 0, k = 0; i < self().variables.size(); ++i) {
    const Variable& v = self().variables[i];
    if (v.type != Type::kReal) continue;
    EXPECT_EQ(after[k], before[k]) << v.name;
    ++k;
  }
  EXPECT_EQ(step(0.01, 0.005), fmi2OK) << last_text();
}

TEST_F(Fmi, StatusFunctionsAnswerWhatIsKept) {
  start();
  ASSERT_EQ(step(0, 0.01), fmi2OK) << last_text();
  fmi2Status status = fmi2Error;
  EXPECT_EQ(fmi2GetStatus(c_, fmi2DoStepStatus, &status), fmi2OK);
  EXPECT_EQ(status, fmi2OK);
  fmi2Boolean terminated = fmi2True;
  EXPECT_EQ(fmi2GetBooleanStatus(c_, fmi2Terminated, &terminated), fmi2OK);
  EXPECT_EQ(terminated, fmi2False);
  EXPECT_EQ(fmi2GetStatus(c_, fmi2PendingStatus, &status), fmi2Discard);
  EXPECT_EQ(fmi2GetStatus(c_, fmi2DoStepStatus, nullptr), fmi2Error);
}

TEST_F(Fmi, ResetRepeatsTheRunBitForBit) {
  const double mass = get("chaser.mass");
  EXPECT_EQ(set("chaser.mass", 2 * mass), fmi2OK);
  EXPECT_EQ(fmi2Reset(c_), fmi2OK);
  EXPECT_EQ(get("chaser.mass"), mass) << "parameters are those of the scene again";
  std::vector<std::vector<double>> ends;
  for (int run = 0; run < 2; ++run) {
    start();
    for (int i = 0; i < 20; ++i) ASSERT_EQ(step(0.01 * i, 0.01), fmi2OK) << last_text();
    ends.push_back(snapshot(c_));
    EXPECT_EQ(fmi2Terminate(c_), fmi2OK);
    EXPECT_EQ(fmi2Reset(c_), fmi2OK);
  }
  EXPECT_EQ(ends[0], ends[1]);
}

TEST_F(Fmi, InstancesDoNotDisturbEachOther) {
  const fmi2Component first = c_;
  start();
  const fmi2Component second = c_ = instantiate();
  EXPECT_EQ(set("chaser.velocity[1]", 0.02), fmi2OK);
  start();
  for (int i = 0; i < 20; ++i) {
    for (const fmi2Component c : {first, second}) {
      ASSERT_EQ(fmi2DoStep(c, 0.01 * i, 0.01, fmi2True), fmi2OK) << last_text();
    }
  }
  const std::vector<double> interleaved = snapshot(first);
  EXPECT_NE(interleaved, snapshot(second));
  fmi2FreeInstance(second);
  c_ = first;
  EXPECT_EQ(fmi2Reset(c_), fmi2OK);
  start();
  for (int i = 0; i < 20; ++i) ASSERT_EQ(step(0.01 * i, 0.01), fmi2OK) << last_text();
  EXPECT_EQ(interleaved, snapshot(c_));
}

}  // namespace
}  // namespace dockloop
