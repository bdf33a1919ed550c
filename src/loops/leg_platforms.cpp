// Platforms on legs for the scalars of the core, and the groups of legs side by side; see
// leg_platforms.hpp.
#include "loops/leg_platforms_body.hpp"

namespace dockloop {

void LegStore<double>::add(LegPlace& place) {
  if (groups_.empty() || groups_.back().type != place.type || used_.back() == kGroup) {
    groups_.push_back(legs::LegGroup{{}, {}, place.type});
    used_.push_back(0);
  }
  place.group = groups_.size() - 1;
  place.lane = used_.back()++;
}

void LegStore<double>::finish() {
  for (size_t g = 0; g < groups_.size(); ++g) {
    for (int lane = used_[g]; lane < kGroup; ++lane) {
      for (int i = 0; i < legs::kMasses; ++i) {
        groups_[g].parameter[i][lane] = groups_[g].parameter[i][0];
      }
    }
  }
}

}  // namespace dockloop
