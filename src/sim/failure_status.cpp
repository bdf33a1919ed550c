// The meaning of a Status, in one sentence for the log.
#include <cstdio>
#include <cstring>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

/// May a state of this kind be that of an equal step which is too long?
bool is_due_to_step(StatusCode code) {
  switch (code) {
    case StatusCode::kOutOfReach:
    case StatusCode::kLoopSingular:
    case StatusCode::kBranchChanged:
    case StatusCode::kLoopNotClosed:
    case StatusCode::kContactTooDeep:
    case StatusCode::kContactFlipped:
    case StatusCode::kNotFinite:
      return true;
    default:
      return false;
  }
}

}  // namespace

std::string DockingSim::Impl::describe(const Status& status) const {
  char text[400];
  const MechanismModel& mechanism = model->mechanism.model;
  const auto loop = [&]() {
    return status.index >= 0 ? mechanism.loops[status.index].name : std::string("?");
  };
  const auto surfaces = [&]() { return describe_pair(model->contact, status.index); };
  switch (status.code) {
    case StatusCode::kOk:
      return "ok";
    case StatusCode::kOutOfReach:
      std::snprintf(text, sizeof text,
                    "loop '%s' cannot be closed: the pose is outside its workspace (margin %.3g)",
                    loop().c_str(), status.margin);
      break;
    case StatusCode::kLoopSingular:
      std::snprintf(text, sizeof text,
                    "loop '%s' is singular (margin %.3g, limit %.1g): no forces are determined in "
                    "such a pose; keep the motion away from it, by a stop or another geometry",
                    loop().c_str(), status.margin, mechanism.singularity.error);
      break;
    case StatusCode::kBranchChanged:
      std::snprintf(text, sizeof text, "loop '%s' has left its assembly branch", loop().c_str());
      break;
    case StatusCode::kLoopNotClosed:
      std::snprintf(text, sizeof text, "loop '%s' cannot be closed by Newton iteration",
                    loop().c_str());
      break;
    case StatusCode::kRedundancyLost:
      std::snprintf(text, sizeof text,
                    "a redundant equation of loop '%s' is violated (by %.3g): its parts fit "
                    "together in the home pose, but not in this pose",
                    loop().c_str(), status.margin);
      break;
    case StatusCode::kInertiaNotPositive:
      std::snprintf(text, sizeof text,
                    "the reduced inertia is not positive definite: check masses and inertias");
      break;
    case StatusCode::kContactTooDeep:
      std::snprintf(
          text, sizeof text,
          "%s are pressed together by %.0f %% of their rounding, more than the contact law "
          "allows: the impact is too fast for contact.stiffness, or the surfaces overlap "
          "at the start",
          surfaces().c_str(), 100.0 * status.margin);
      break;
    case StatusCode::kContactFlipped:
      std::snprintf(text, sizeof text, "%s would pass through each other", surfaces().c_str());
      break;
    case StatusCode::kTravelOutsideTable:
    case StatusCode::kRateOutsideTable: {
      const bool is_rate = status.code == StatusCode::kRateOutsideTable;
      const ForceElement& element = mechanism.elements[static_cast<size_t>(status.index)];
      double least = 0.0, most = 0.0;
      for (const ForceLaw& law : element.laws) {
        const TableLaw* table = std::get_if<TableLaw>(&law);
        if (!table) continue;
        const std::vector<double>& range = is_rate ? table->rates : table->travel;
        const double rest = is_rate ? 0.0 : table->rest;
        least = rest + range.front();
        most = rest + range.back();
        if (status.margin < least || status.margin > most) break;
      }
      std::snprintf(text, sizeof text,
                    "element '%s' leaves its table: %s %.6g is not between %.6g and %.6g; measure "
                    "more rows, or state %s = 'hold' or 'extend' of the law",
                    element.name.c_str(), is_rate ? "the rate" : "the coordinate", status.margin,
                    least, most, is_rate ? "outside_rate" : "outside");
      break;
    }
    case StatusCode::kIntegrationFailed:
      std::snprintf(text, sizeof text,
                    "the integrator cannot meet its tolerance: increase solver.rtol, or "
                    "set another solver.method (6, bdf, for stiff parts)");
      break;
    case StatusCode::kSequenceChatters:
      std::snprintf(text, sizeof text,
                    "the sequence changes its step more than %d times at one instant (%s): its "
                    "conditions hold at once; give them a dwell ('for') or bounds that differ",
                    kMaxChanges, events->sequence().list_visited().c_str());
      break;
    case StatusCode::kBadInput:
      std::snprintf(text, sizeof text, "an input has an impossible value");
      break;
    case StatusCode::kCannotJoin:
      std::snprintf(text, sizeof text, "%s", find_joint_obstacle());
      break;
    case StatusCode::kCouplingUnstable:
      std::snprintf(text, sizeof text, "the coupling is unstable");
      break;
    case StatusCode::kInterrupted:
      std::snprintf(text, sizeof text, "stopped by the user; the step may be made again");
      break;
    case StatusCode::kNotFinite:
      std::snprintf(text, sizeof text, "a value is not finite: check parameters and inputs");
      break;
  }
  if (status.time > 0.0) {
    const size_t used = std::strlen(text);
    std::snprintf(text + used, sizeof text - used, " at t = %.9g s%s", setup->t_start + status.time,
                  is_due_to_step(status.code) && step_loop && step_loop->method().is_fixed_step()
                      ? "; or solver.step is too long for what happens there: shorten it"
                      : "");
  }
  return text;
}

}  // namespace dockloop
