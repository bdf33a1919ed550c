// Writes a trace as C: straight-line functions that share a work array.
//
// A function computes what its outputs and guards need and no earlier function has computed. What a
// later function needs of it goes through `work`.
#pragma once

#include <string>
#include <vector>

#include "codegen/trace.hpp"

namespace dockloop {

/// One number that a function writes.
struct TraceOutput {
  int array, index, node;
};

struct TraceFunction {
  std::string name;
  std::vector<TraceOutput> outputs;
  std::vector<Guard> guards;
  bool shares = true;  ///< with the functions that come after it
};

/// C functions `int dockloop_kernel_NAME(double* const* x, double* work)`.
/// @param[out] work, operations  doubles in the work array; + - * / and functions of all that share
std::string print_functions(const Trace& trace, const std::vector<TraceFunction>& functions,
                            int& work, int& operations);

}  // namespace dockloop
