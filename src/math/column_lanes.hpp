// Columns of numbers in SIMD lanes: weighted sums, and Cholesky factors of six and twelve rows.
//
// Compiled for several instruction sets (math/lane_arithmetic.hpp). Results have the same bits for
// all of them.
#pragma once

#include "math/lanes.hpp"

namespace dockloop::columns {

struct ColumnFunctions {
  /// sum = base + h * (weight times columns). Columns stand one after another.
  /// @param length  of a column, a multiple of kGroup. @param sum  may be base
  void (*add_up)(const double* weight, const double* columns, int count, int length, double h,
                 const double* base, double* sum);
  /// The factor of A in the lower triangle of L; above it, numbers without meaning. By columns.
  /// @return is A positive definite?
  bool (*factorise_6)(const double* A, double* L);
  bool (*factorise_12)(const double* A, double* L);
  /// x := A^-1 x with this factor.
  void (*solve_12)(const double* L, double* x);
};

/// Functions for the widest registers of this processor. @param widest  largest number of lanes
const ColumnFunctions& find_column_functions(int widest = kGroup);

}  // namespace dockloop::columns
