// Laws of legs in coordinates of their joints, and checks; see spring_numbers.hpp.
#include "model/spring_numbers.hpp"

#include <algorithm>

#include "math/status.hpp"

namespace dockloop {

void put_leg_law(const Leg& leg, const LegLaw& law, JointForce& force) {
  const double arm = leg.arm, home = leg.home_length;
  force.stiffness = law.stiffness * arm * arm;
  force.damping = law.damping * arm * arm;
  force.rest = (law.free_length - home) / arm;
  force.preload = law.preload * arm;
  force.stops.present = law.stops.has_value();
  if (!law.stops) return;
  force.stops.lower = (law.stops->min_length - home) / arm;
  force.stops.upper = (law.stops->max_length - home) / arm;
  force.stops.stiffness = law.stops->stiffness * arm * arm;
  force.stops.damping = law.stops->damping * arm;
  force.stops.toe = law.stops->toe / arm;
}

std::string find_fault(const Leg& leg, const LegStops& stops) {
  if (stops.min_length < leg.home_length && leg.home_length < stops.max_length) return "";
  return "the home length " + describe_number(leg.home_length) +
         " m must lie between min_length and max_length";
}

bool is_joint_spring(const MechanismModel& model, const JointForce& force) {
  const auto index = static_cast<int>(&force - model.forces.data());
  return has_spring(force) && std::none_of(model.legs.begin(), model.legs.end(),
                                           [&](const Leg& leg) { return leg.force == index; });
}

void update_springs(MechanismModel& model) {
  for (const Leg& leg : model.legs) {
    if (!leg.law) continue;
    std::string why = find_fault(*leg.law, kLegNumbers);
    if (why.empty() && leg.law->stops) {
      why = find_fault(*leg.law->stops, kLegStopNumbers);
      if (why.empty()) why = find_fault(leg, *leg.law->stops);
      if (!why.empty()) why = "stops: " + why;
    }
    if (!why.empty()) throw ModelError("leg '" + leg.name + "': " + why);
    put_leg_law(leg, *leg.law, model.forces[static_cast<size_t>(leg.force)]);
  }
  for (const JointForce& force : model.forces) {
    const std::string why = find_fault(force, kJointForceNumbers);
    if (why.empty()) continue;
    throw ModelError("joint_spring at joint '" +
                     model.bodies[static_cast<size_t>(force.body)].name + "': " + why);
  }
}

}  // namespace dockloop
