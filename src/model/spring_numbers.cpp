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
  const bool is_crank = leg.home_length == 0.0;  // its pin travels both ways
  if (!is_crank && stops.min_length <= 0.0) {
    return "min_length is " + describe_number(stops.min_length) + "; it must be above 0";
  }
  const std::string least = describe_number(stops.min_length) + " m";
  const std::string most = describe_number(stops.max_length) + " m";
  if (!(stops.min_length < stops.max_length)) {
    return "min_length " + least + " must be below max_length " + most;
  }
  if (stops.min_length < leg.home_length && leg.home_length < stops.max_length) return "";
  return "the home length " + describe_number(leg.home_length) +
         " m must lie between min_length and max_length, " + least + " and " + most;
}

bool is_joint_spring(const MechanismModel& model, const JointForce& force) {
  const auto index = static_cast<int>(&force - model.forces.data());
  return force.is_stated && std::none_of(model.legs.begin(), model.legs.end(),
                                         [&](const Leg& leg) { return leg.force == index; });
}

void update_springs(MechanismModel& model) {
  for_each_spring_number(model, [](const std::string& name, double number, const std::string& unit,
                                   Rule rule, const std::string&) {
    const std::string why = find_fault(number, rule);
    if (why.empty()) return;
    throw ModelError(name + " is " + describe_number(number) + (unit.empty() ? "" : " " + unit) +
                     "; " + why);
  });
  for (size_t i = 0; i < model.legs.size(); ++i) {
    const Leg& leg = model.legs[i];
    if (!leg.law) continue;
    const std::string why = leg.law->stops ? find_fault(leg, *leg.law->stops) : "";
    if (!why.empty()) throw ModelError("leg[" + std::to_string(i + 1) + "].stops: " + why);
    put_leg_law(leg, *leg.law, model.forces[static_cast<size_t>(leg.force)]);
  }
}

}  // namespace dockloop
