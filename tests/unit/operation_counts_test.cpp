// Arithmetic of one evaluation, watched: counts are the same on every run, unlike times.
// 1. counts are recorded: operations executed, and those left when operations with an operand 0 or
//    1 are taken off. tests/data/budgets.json says what they are today (tests/test_budgets.py);
// 2. the counted phases are the whole evaluation, and it is the product's: the counting scalar
//    returns the numbers of double.
//
// The table behind the sums: the benchmark
// operation_counts (configure with -DDOCKLOOP_BENCHMARKS=ON). A program of its own; see
// operation_counts.hpp.
#include "benchmarks/operation_counts.hpp"

#include <gtest/gtest.h>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

struct Subject {
  const char* name;
  std::string file;
};

void PrintTo(const Subject& subject, std::ostream* out) { *out << subject.name; }

// Sums of double run in another order (vector instructions): worst residual 9.9e-16.
constexpr double kSame = 1e-14;

class OperationCounts : public ::testing::TestWithParam<Subject> {};

TEST_P(OperationCounts, are_recorded) {
  CountedEvaluation evaluation(GetParam().file, true);
  evaluation.count_whole();
  OperationCount sum, accelerations;
  for (const Phase& phase : evaluation.count_phases()) {
    sum += phase.count;
    if (phase.name == "solution") accelerations = sum;
  }
  const auto record = [](const char* what, long count) {
    EXPECT_GT(count, 0) << what;
    RecordProperty(what, static_cast<int>(count));
  };
  record("accelerations", accelerations.all);  // up to the independent ones
  record("accelerations_left", accelerations.left());
  record("whole", sum.all);  // with dependent ones, cut forces, load on the base
  record("whole_left", sum.left());
}

TEST_P(OperationCounts, are_those_of_the_whole_evaluation_of_the_product) {
  Residual difference;
  for (const bool base_moves : {false, true}) {
    CountedEvaluation evaluation(GetParam().file, base_moves);
    const OperationCount whole = evaluation.count_whole();
    const auto compare = [&](const auto& counted, const auto& exact, const char* what) {
      VecX<double> values(counted.size());
      for (int i = 0; i < values.size(); ++i) values[i] = to_double(counted[i]);
      difference.add(find_relative_error(values, exact), what);
    };
    compare(evaluation.data.vdot, evaluation.exact.vdot, "accelerations");
    compare(evaluation.data.on_base.f, evaluation.exact.on_base.f, "force on the base");
    compare(evaluation.data.on_base.t, evaluation.exact.on_base.t, "moment on the base");
    OperationCount sum;
    for (const Phase& phase : evaluation.count_phases()) sum += phase.count;
    EXPECT_EQ(sum.all, whole.all);
    EXPECT_EQ(sum.trivial, whole.trivial);
  }
  EXPECT_RESIDUAL_BELOW(difference, kSame);
}

const std::string kData = DOCKLOOP_TEST_DATA "/", kModels = DOCKLOOP_MODELS "/mechanisms/";

INSTANTIATE_TEST_SUITE_P(
    mechanisms, OperationCounts,
    ::testing::Values(Subject{"hexapod_r2p1r3", kData + "hexapod_r2p1r3.json"},
                      Subject{"crank_nested", kData + "crank_nested.json"},
                      Subject{"planar_two_loop", kData + "planar_two_loop.json"},
                      Subject{"hexapod_bench", kModels + "hexapod_bench.json"}),
    [](const ::testing::TestParamInfo<Subject>& at) { return at.param.name; });

}  // namespace
}  // namespace dockloop
