// Platforms on legs for the scalars of the core, and the groups of legs side by side; see
// leg_platforms.hpp.
#include "loops/leg_platforms_body.hpp"

namespace dockloop {

void LegStore<double>::add(LegPlace& place) {
  if (groups_.empty() || groups_.back().type != place.type || groups_.back().legs == kGroup) {
    groups_.push_back(legs::LegGroup{{}, {}, place.type, 0});
  }
  place.group = groups_.size() - 1;
  place.lane = groups_.back().legs++;
}

void LegStore<double>::finish() {
  for (legs::LegGroup& group : groups_) {
    for (int lane = group.legs; lane < kGroup; ++lane) {
      for (int i = 0; i < legs::kMasses; ++i) group.parameter[i][lane] = group.parameter[i][0];
    }
  }
}

}  // namespace dockloop
