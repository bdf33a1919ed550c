// Operations of one evaluation, phase by phase: `operation_counts MECHANISM.json...`, in Markdown.
//
// What is counted, and what "left" means: operation_counts.hpp.
// tests/unit/operation_counts_test.cpp pins the sums.
#include "benchmarks/operation_counts.hpp"

#include <cstdio>

int main(int argc, char** argv) {
  using namespace dockloop;
  if (argc < 2) {
    std::fprintf(stderr, "usage: operation_counts MECHANISM.json...\n");
    return 2;
  }
  try {
    for (int i = 1; i < argc; ++i) {
      CountedEvaluation moving(argv[i], true), quiescent(argv[i], false);
      moving.count_whole();  // fills what the phases hand to each other
      quiescent.count_whole();
      const std::vector<Phase> a = moving.count_phases(), b = quiescent.count_phases();
      std::printf("%s| %s | all | left, base moves | left, base rests |\n|---|---:|---:|---:|\n",
                  i > 1 ? "\n" : "", moving.mechanism.model.name.c_str());
      OperationCount sum_a, sum_b;
      for (size_t n = 0; n < a.size(); ++n) {
        std::printf("| %s | %ld | %ld | %ld |\n", a[n].name.c_str(), a[n].count.all,
                    a[n].count.left(), b[n].count.left());
        sum_a += a[n].count;
        sum_b += b[n].count;
        if (a[n].name == "solution" || n + 2 >= a.size()) {
          std::printf("| **so far** | **%ld** | **%ld** | **%ld** |\n", sum_a.all, sum_a.left(),
                      sum_b.left());
        }
      }
    }
  } catch (const ModelError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
