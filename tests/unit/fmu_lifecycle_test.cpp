// Instances come and go, side by side.
// 1. eight threads with a docking each, at the same time, give the bits of one alone (run it with
// the
//    preset tsan as well);
// 2. instantiating and freeing 10 000 times leaves no memory behind, whatever happened in between;
// 3. a logger that throws, or none at all, changes nothing;
// 4. an instance that is called while another call of it runs, by another thread or by its logger,
//    refuses the second call.
#include <gtest/gtest.h>
#include <malloc.h>

#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "unit/allocations.hpp"
#include "unit/fmu_test_support.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

class Lifecycle : public ::testing::Test {
 protected:
  void use(const std::string& text) {
    guid_ = find_guid(text);
    resources_ = std::make_unique<Resources>("resources", text);
  }
  fmi2Component instantiate(const fmi2CallbackFunctions& callbacks,
                            fmi2Type type = fmi2CoSimulation) const {
    return fmi2Instantiate("one", type, guid_.c_str(), resources_->uri().c_str(), &callbacks,
                           fmi2False, fmi2True);
  }
  static bool start(fmi2Component c) {
    return fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0) == fmi2OK &&
           fmi2EnterInitializationMode(c) == fmi2OK && fmi2ExitInitializationMode(c) == fmi2OK;
  }
  /// All Real values.
  static std::vector<double> read(fmi2Component c) {
    const std::vector<Variable>& rows = static_cast<Instance*>(c)->variables;
    std::vector<double> values;
    for (size_t i = 0; i < rows.size(); ++i) {
      if (rows[i].type != Type::kReal) continue;
      const fmi2ValueReference reference = static_cast<fmi2ValueReference>(i);
      double value = 0.0;
      if (fmi2GetReal(c, &reference, 1, &value) != fmi2OK) return {};
      values.push_back(value);
    }
    return values;
  }
  /// A docking from before contact into it; empty if a call failed.
  std::vector<double> run(const fmi2CallbackFunctions& callbacks) const {
    const fmi2Component c = instantiate(callbacks);
    if (!c || !start(c)) return {};
    std::vector<double> values;
    for (int i = 0; i < 300; ++i) {
      if (fmi2DoStep(c, 0.01 * i, 0.01, fmi2True) != fmi2OK) return {};
    }
    values = read(c);
    fmi2FreeInstance(c);
    return values;
  }

  std::string guid_;
  std::unique_ptr<Resources> resources_;
  const fmi2CallbackFunctions silent_{ignore_log, nullptr, nullptr, nullptr, nullptr};
};

TEST_F(Lifecycle, threads_with_an_instance_each_give_the_bits_of_one_alone) {
  use(read_test_file("scene_ring.json"));
  const std::vector<double> alone = run(silent_);
  ASSERT_GT(alone.size(), 200u);
  constexpr int kThreads = 8;
  std::vector<std::vector<double>> found(kThreads);
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([&, i] { found[static_cast<size_t>(i)] = run(silent_); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::vector<double>& values : found) EXPECT_EQ(values, alone);
}

/// Calls an instance back while the instance logs.
struct Nosy {
  static void log(fmi2ComponentEnvironment environment, fmi2String, fmi2Status, fmi2String,
                  fmi2String text, ...) {
    Nosy& self = *static_cast<Nosy*>(environment);
    self.threads.insert(std::this_thread::get_id());
    if (std::string(text).find("was refused") != std::string::npos) {
      self.refusals.emplace_back(text);
      return;
    }
    const fmi2ValueReference first = 0;
    double value = 0.0;
    self.nested = fmi2GetReal(self.instance, &first, 1, &value);
    std::thread([&] { self.foreign = fmi2GetReal(self.instance, &first, 1, &value); }).join();
    ++self.lines;
  }
  fmi2Component instance = nullptr;
  fmi2Status nested = fmi2OK, foreign = fmi2OK;
  int lines = 0;
  std::set<std::thread::id> threads;  ///< that have called the logger
  std::vector<std::string> refusals;
};

TEST_F(Lifecycle, a_second_call_of_an_instance_is_refused) {
  use(read_test_file("scene_ring.json"));
  Nosy nosy;
  const fmi2CallbackFunctions callbacks{Nosy::log, nullptr, nullptr, nullptr, &nosy};
  nosy.instance = instantiate(callbacks);
  ASSERT_NE(nosy.instance, nullptr);
  ASSERT_TRUE(start(nosy.instance));
  EXPECT_EQ(fmi2DoStep(nosy.instance, 5.0, -1.0, fmi2True), fmi2Error);  // logs
  EXPECT_GE(nosy.lines, 1);
  EXPECT_EQ(nosy.nested, fmi2Error);
  EXPECT_EQ(nosy.foreign, fmi2Error);
  // The call that ran says so when it ends: the logger is entered by one thread at a time.
  EXPECT_EQ(nosy.threads.size(), 1u);
  ASSERT_EQ(nosy.refusals.size(), 1u);
  EXPECT_NE(nosy.refusals[0].find("fmi2GetReal: was refused"), std::string::npos);
  fmi2FreeInstance(nosy.instance);
  EXPECT_EQ(nosy.refusals.size(), 1u);
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST_F(Lifecycle, ten_thousand_instances_leave_no_memory_behind) {
  use(minimal_scene_text());
  const auto live = [this](int i) {
    const fmi2Component c = instantiate(silent_, i % 5 == 4 ? fmi2ModelExchange : fmi2CoSimulation);
    ASSERT_NE(c, nullptr);
    if (i % 4 > 0) {
      ASSERT_TRUE(start(c));
      fmi2DoStep(c, 0.0, 0.01, fmi2True);  // refused by an instance for model exchange
      fmi2FMUstate saved = nullptr;
      EXPECT_EQ(fmi2GetFMUstate(c, &saved), fmi2OK);
      EXPECT_EQ(fmi2SetFMUstate(c, saved), fmi2OK);
      EXPECT_EQ(fmi2FreeFMUstate(c, &saved), fmi2OK);
    }
    if (i % 4 == 2) {
      EXPECT_EQ(fmi2Reset(c), fmi2OK);
    }
    fmi2FreeInstance(c);
  };
  for (int i = 0; i < 100; ++i) live(i);  // whatever is allocated once is there now
  const size_t before = mallinfo2().uordblks;
  for (int i = 0; i < 10000; ++i) live(i);
  const size_t after = mallinfo2().uordblks;
  // Two bytes an instance: the smallest object that is forgotten takes 24.
  EXPECT_LE(after, before + 20000) << "bytes in use before and after";
}
#endif

void throw_instead(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...) {
  throw std::runtime_error("a logger of a bad host");
}

TEST_F(Lifecycle, a_logger_that_throws_and_no_logger_change_nothing) {
  use(minimal_scene_text());
  const std::vector<double> quiet = run(silent_);
  ASSERT_FALSE(quiet.empty());
  for (const fmi2CallbackLogger logger : {&throw_instead, fmi2CallbackLogger(nullptr)}) {
    const fmi2CallbackFunctions callbacks{logger, nullptr, nullptr, nullptr, nullptr};
    EXPECT_EQ(run(callbacks), quiet);
    const fmi2Component c = instantiate(callbacks);
    ASSERT_NE(c, nullptr);
    EXPECT_EQ(fmi2DoStep(c, 0.0, 0.01, fmi2True), fmi2Error);  // not initialised: one line
    EXPECT_TRUE(start(c));
    fmi2FreeInstance(c);
  }
}

}  // namespace
}  // namespace dockloop
