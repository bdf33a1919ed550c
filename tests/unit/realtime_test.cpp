// The step path of the FMU, as a hard real-time host needs it.
// 1. fmi2DoStep with the calls around it (set inputs, their slopes, get everything, save and
// restore
//    the state) does not allocate, lock, throw or open files: from free drift through contact and
//    capture, with adaptive and with fixed steps, and for model exchange;
// 2. the traps do trap: the same counters see what an instantiation does;
// 3. with fixed steps the number of evaluations of a communication step is always the same.
#include <gtest/gtest.h>
#include <pthread.h>

#include <algorithm>

#include "sim/solver_methods.hpp"
#include "unit/fmu_test_support.hpp"
#include "unit/test_helpers.hpp"
#include "unit/traps.hpp"

namespace dockloop {
namespace {

class RealTime : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    const std::string text = read_test_file("scene_ring.json");
    resources_ = std::make_unique<Resources>("resources", text);
    guid_ = find_guid(text);
  }
  fmi2Component instantiate(fmi2Type type = fmi2CoSimulation) {
    return fmi2Instantiate("real_time", type, guid_.c_str(), resources_->uri().c_str(), &callbacks_,
                           fmi2False, fmi2False);
  }
  static fmi2ValueReference find(fmi2Component c, const std::string& name) {
    const std::vector<Variable>& rows = static_cast<Instance*>(c)->variables;
    for (size_t i = 0; i < rows.size(); ++i) {
      if (rows[i].name == name) return static_cast<fmi2ValueReference>(i);
    }
    throw std::out_of_range(name);
  }
  fmi2Component start(fmi2Type type) {
    const fmi2Component c = instantiate(type);
    const fmi2ValueReference choices[] = {find(c, "solver.method"), find(c, "model.level")};
    const bool multipliers = type == fmi2CoSimulation && GetParam() == kDae;
    const fmi2Integer values[] = {GetParam(), multipliers ? kReference : kReduced};
    EXPECT_EQ(fmi2SetInteger(c, choices, 2, values), fmi2OK);
    EXPECT_EQ(fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0), fmi2OK);
    EXPECT_EQ(fmi2EnterInitializationMode(c), fmi2OK);
    EXPECT_EQ(fmi2ExitInitializationMode(c), fmi2OK);
    return c;
  }

  std::unique_ptr<Resources> resources_;
  std::string guid_;
  fmi2CallbackFunctions callbacks_{ignore_log, nullptr, nullptr, nullptr, nullptr};
};

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST_P(RealTime, a_step_and_the_calls_around_it_do_nothing_that_can_block) {
  const fmi2Component c = start(fmi2CoSimulation);
  std::vector<fmi2ValueReference> reals;
  const std::vector<Variable>& rows = static_cast<Instance*>(c)->variables;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].type == Type::kReal) reals.push_back(static_cast<fmi2ValueReference>(i));
  }
  std::vector<double> values(reals.size());
  const fmi2ValueReference force = find(c, "chaser.force_ext[2]"), phase = find(c, "phase");
  const fmi2Integer order = 1;
  fmi2FMUstate saved = nullptr;
  ASSERT_EQ(fmi2GetFMUstate(c, &saved), fmi2OK);
  bool ok = true;
  fmi2Integer reached = 0;
  const Trapped trapped = trap([&] {
    for (int i = 0; i < 350; ++i) {
      const double push = i % 3, slope = 0.1;
      ok = ok && fmi2SetReal(c, &force, 1, &push) == fmi2OK;
      ok = ok && fmi2SetRealInputDerivatives(c, &force, 1, &order, &slope) == fmi2OK;
      ok = ok && fmi2GetFMUstate(c, &saved) == fmi2OK;
      ok = ok && fmi2DoStep(c, 0.01 * i, 0.007, fmi2False) == fmi2OK;
      ok = ok && fmi2SetFMUstate(c, saved) == fmi2OK;
      ok = ok && fmi2DoStep(c, 0.01 * i, 0.01, fmi2True) == fmi2OK;
      ok = ok && fmi2GetReal(c, reals.data(), reals.size(), values.data()) == fmi2OK;
      ok = ok && fmi2GetInteger(c, &phase, 1, &reached) == fmi2OK;
    }
  });
  EXPECT_TRUE(ok);
  EXPECT_GE(reached, 3) << "the docking must have been captured";
  EXPECT_EQ(trapped.allocations, 0);
  EXPECT_EQ(trapped.locks, 0);
  EXPECT_EQ(trapped.exceptions, 0);
  EXPECT_EQ(trapped.files, 0);
  EXPECT_EQ(fmi2FreeFMUstate(c, &saved), fmi2OK);
  fmi2FreeInstance(c);
}

TEST_P(RealTime, neither_do_the_calls_of_a_host_that_integrates_by_itself) {
  const fmi2Component c = start(fmi2ModelExchange);
  Instance& self = *static_cast<Instance*>(c);
  const size_t n = static_cast<size_t>(self.sim.state_count());
  const size_t m = static_cast<size_t>(self.sim.indicator_count());
  std::vector<double> x(n), rate(n), indicator(m);
  fmi2EventInfo info{};
  ASSERT_EQ(fmi2NewDiscreteStates(c, &info), fmi2OK);
  ASSERT_EQ(fmi2EnterContinuousTimeMode(c), fmi2OK);
  bool ok = true;
  double t = 0.0;
  const Trapped trapped = trap([&] {
    for (int i = 0; i < 3000; ++i) {
      const double h = 2e-4 + (i < 1000 ? 2e-3 : 0.0);
      ok = ok && fmi2GetContinuousStates(c, x.data(), n) == fmi2OK;
      ok = ok && fmi2GetDerivatives(c, rate.data(), n) == fmi2OK;
      for (size_t k = 0; k < n; ++k) x[k] += h * rate[k];
      t += h;
      ok = ok && fmi2SetTime(c, t) == fmi2OK;
      ok = ok && fmi2SetContinuousStates(c, x.data(), n) == fmi2OK;
      ok = ok && fmi2GetEventIndicators(c, indicator.data(), m) == fmi2OK;
      fmi2Boolean event = fmi2False, end = fmi2False;
      ok = ok && fmi2CompletedIntegratorStep(c, fmi2True, &event, &end) == fmi2OK;
      if (event == fmi2False) continue;
      ok = ok && fmi2EnterEventMode(c) == fmi2OK;
      ok = ok && fmi2NewDiscreteStates(c, &info) == fmi2OK;
      ok = ok && fmi2EnterContinuousTimeMode(c) == fmi2OK;
    }
  });
  EXPECT_TRUE(ok);
  EXPECT_EQ(trapped.allocations, 0);
  EXPECT_EQ(trapped.locks, 0);
  EXPECT_EQ(trapped.exceptions, 0);
  EXPECT_EQ(trapped.files, 0);
  fmi2FreeInstance(c);
}

TEST_P(RealTime, the_traps_see_what_an_instantiation_does) {
  fmi2Component c = nullptr;
  const Trapped trapped = trap([&] {
    c = instantiate();
    fmi2DoStep(c, 0.0, 0.01, fmi2True);  // refused: not initialised
  });
  EXPECT_GT(trapped.allocations, 100);
  EXPECT_GE(trapped.exceptions, 1);
  EXPECT_GE(trapped.files, 1);
  fmi2FreeInstance(c);
  const Trapped locked = trap([] {
    pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&mutex);
    pthread_mutex_unlock(&mutex);
  });
  EXPECT_EQ(locked.locks, 1);
}
#else
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RealTime);  // sanitizers count allocations
#endif

class FixedSteps : public RealTime {};

TEST_P(FixedSteps, take_the_same_work_everywhere) {
  const fmi2Component c = start(fmi2CoSimulation);
  const fmi2ValueReference counter = find(c, "solver.rhs_evaluations");
  std::vector<double> work;
  for (int i = 0; i < 350; ++i) {
    double before = 0.0, after = 0.0;
    ASSERT_EQ(fmi2GetReal(c, &counter, 1, &before), fmi2OK);
    ASSERT_EQ(fmi2DoStep(c, 0.01 * i, 0.01, fmi2True), fmi2OK);
    ASSERT_EQ(fmi2GetReal(c, &counter, 1, &after), fmi2OK);
    work.push_back(after - before);
  }
  EXPECT_EQ(*std::min_element(work.begin(), work.end()),
            *std::max_element(work.begin(), work.end()));
  // Ten steps of solver.step = 1 ms: four evaluations each, or six and one mechanism block.
  EXPECT_EQ(work.front(), GetParam() == kFixedRk4 ? 40.0 : 84.0);
  fmi2FreeInstance(c);
}

const auto kNameOf = [](const ::testing::TestParamInfo<int>& method) {
  return std::string(find_method(method.param)->name);
};
INSTANTIATE_TEST_SUITE_P(Methods, FixedSteps,
                         ::testing::Values(int(kFixedRk4), int(kFixedRosenbrock)), kNameOf);
INSTANTIATE_TEST_SUITE_P(Methods, RealTime,
                         ::testing::Values(int(kExplicit), int(kBdf), int(kFixedRk4), int(kDae),
                                           int(kRosenbrock), int(kFixedRosenbrock)),
                         kNameOf);

}  // namespace
}  // namespace dockloop
