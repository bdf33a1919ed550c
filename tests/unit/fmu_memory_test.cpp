// Memory that a host sees an FMU ask for while it steps.
// 1. fmi2DoStep, fmi2GetReal and fmi2SetReal allocate nothing, from the first step of a docking on,
//    through contact, capture and rest, also with a companion that measures the error.
//    tests/data/budgets.json holds the figure recorded here.
#include <gtest/gtest.h>

#include "unit/allocations.hpp"
#include "unit/fmu_test_support.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
/// Allocations of 5 s of a docking, with get and set.
long count_while_stepping(bool measures_error) {
  const std::string text = read_test_file("scene_ring.json");
  const Resources resources("resources", text);
  const std::string guid = find_guid(text);
  const fmi2CallbackFunctions callbacks{ignore_log, nullptr, nullptr, nullptr, nullptr};
  const fmi2Component c =
      fmi2Instantiate("one", fmi2CoSimulation, guid.c_str(), resources.uri().c_str(), &callbacks,
                      fmi2False, fmi2False);
  std::vector<fmi2ValueReference> reals;
  fmi2ValueReference push = 0, measure = 0;
  const std::vector<Variable>& rows = static_cast<Instance*>(c)->variables;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].type == Type::kReal) reals.push_back(static_cast<fmi2ValueReference>(i));
    if (rows[i].name == "chaser.force_ext[1]") push = static_cast<fmi2ValueReference>(i);
    if (rows[i].name == "solver.measure_error") measure = static_cast<fmi2ValueReference>(i);
  }
  const fmi2Boolean measured = measures_error ? fmi2True : fmi2False;
  bool ok = fmi2SetBoolean(c, &measure, 1, &measured) == fmi2OK &&
            fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0) == fmi2OK &&
            fmi2EnterInitializationMode(c) == fmi2OK && fmi2ExitInitializationMode(c) == fmi2OK;
  std::vector<double> values(reals.size());
  const long count = count_allocations([&] {
    for (int i = 0; i < 500 && ok; ++i) {
      const double force = i == 300 ? 1.0 : 0.0;
      ok = fmi2SetReal(c, &push, 1, &force) == fmi2OK &&
           fmi2DoStep(c, 0.01 * i, 0.01, fmi2True) == fmi2OK &&
           fmi2GetReal(c, reals.data(), reals.size(), values.data()) == fmi2OK;
    }
  });
  EXPECT_TRUE(ok);
  fmi2FreeInstance(c);
  return count;
}

TEST(FmuMemory, is_not_allocated_while_a_docking_is_stepped) {
  const long count = count_while_stepping(false);
  RecordProperty("allocations", static_cast<int>(count));
  EXPECT_EQ(count, 0);
}

TEST(FmuMemory, is_not_allocated_by_a_companion) { EXPECT_EQ(count_while_stepping(true), 0); }
#endif

}  // namespace
}  // namespace dockloop
