// Legs side by side: one leg per lane of a vector register, eight to a group.
//
// Plain arrays and functions, so that the same source (leg_lanes_body.hpp) can be compiled for
// several instruction sets without any of it reaching code that runs without a test of the
// processor.
// Operations are those of IEEE 754, one by one and in one order: results do not depend on the
// instruction set, to the last bit.
#pragma once

#include "loops/leg_rows.hpp"

namespace dockloop::legs {

/// Legs of one kind.
struct alignas(64) LegGroup {
  double parameter[kParameters][kGroup];
  double work[kWork][kGroup];
  LegType type;
  int legs;  ///< how many: they have the first lanes
};

/// The stages of an evaluation, for one instruction set. `moving`: R moves or falls.
struct LegFunctions {
  /// @param least  square of the smallest margin
  /// @return false if a leg does not reach its tip or is closer to singular than that
  bool (*calc_position)(LegGroup* groups, int count, const PlatformMotion<double>& at, bool moving,
                        double least, double* sums);
  /// Angles of the first, second or third joint of each leg. @param joint  0 to 2
  void (*calc_angles)(LegGroup* groups, int count, int joint);
  void (*calc_rates)(LegGroup* groups, int count, const PlatformMotion<double>& at);
  void (*calc_bias)(LegGroup* groups, int count, const PlatformMotion<double>& at, bool moving,
                    double* sums);
  void (*calc_loads)(LegGroup* groups, int count, const PlatformMotion<double>& at, double* sums);
};

/// The widest that this processor has. @param widest  lanes at most
const LegFunctions& find_leg_functions(int widest);

}  // namespace dockloop::legs
