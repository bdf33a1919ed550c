// Closed forms of legs for the scalars of the core; see closed_form.hpp.
#include "loops/closed_form_body.hpp"

namespace dockloop {

int find_leg_sign(LegKind kind, LegBranch branch) {
  return (kind == LegKind::kR1R2R3 ? -1 : 1) * branch.elbow * branch.flip;
}

}  // namespace dockloop
