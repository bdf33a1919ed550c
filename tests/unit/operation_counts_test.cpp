// Arithmetic of one evaluation, watched: counts are the same on every run, unlike times.
// 1. four mechanisms stay within the counts of today: operations executed, and those left when
//    operations with an operand 0 or 1 are taken off;
// 2. the counted phases are the whole evaluation, and it is the product's: the counting scalar
//    returns the numbers of double.
//
// Whoever lowers a count lowers the limit. The table behind the sums: the benchmark
// operation_counts (configure with -DDOCKLOOP_BENCHMARKS=ON). A program of its own; see
// operation_counts.hpp.
#include "benchmarks/operation_counts.hpp"

#include <gtest/gtest.h>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

struct Limit {
  const char* name;
  std::string file;
  long accelerations, accelerations_left;  ///< up to the independent accelerations
  long whole, whole_left;                  ///< with dependent ones, cut forces, load on the base
};

void PrintTo(const Limit& limit, std::ostream* out) { *out << limit.name; }

// Sums of double run in another order (vector instructions): worst residual 9.9e-16.
constexpr double kSame = 1e-14;

class OperationCounts : public ::testing::TestWithParam<Limit> {};

TEST_P(OperationCounts, stay_within_those_of_today) {
  const Limit& limit = GetParam();
  CountedEvaluation evaluation(limit.file, true);
  evaluation.count_whole();
  OperationCount sum, accelerations;
  for (const Phase& phase : evaluation.count_phases()) {
    sum += phase.count;
    if (phase.name == "solution") accelerations = sum;
  }
  EXPECT_GT(accelerations.left(), 0);
  EXPECT_LE(accelerations.all, limit.accelerations);
  EXPECT_LE(accelerations.left(), limit.accelerations_left);
  EXPECT_LE(sum.all, limit.whole);
  EXPECT_LE(sum.left(), limit.whole_left);
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
    ::testing::Values(
        Limit{"hexapod_r2p1r3", kData + "hexapod_r2p1r3.json", 18676, 10787, 22498, 13842},
        Limit{"crank_nested", kData + "crank_nested.json", 45392, 22154, 53131, 27963},
        Limit{"planar_two_loop", kData + "planar_two_loop.json", 4513, 1245, 5600, 1851},
        Limit{"hexapod_bench", kModels + "hexapod_bench.json", 17728, 9365, 21550, 12039}),
    [](const ::testing::TestParamInfo<Limit>& at) { return at.param.name; });

}  // namespace
}  // namespace dockloop
