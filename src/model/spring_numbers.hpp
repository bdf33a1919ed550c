// Numbers of the springs, dampers and stops of legs and joints, as a host sets them before a run.
#pragma once

#include <string>

#include "model/mechanism_model.hpp"

namespace dockloop {

/// The law of a leg in coordinates of its joint.
void put_leg_law(const Leg& leg, const LegLaw& law, JointForce& force);

/// What is wrong with the stops of a leg, as the rest of a sentence; empty if nothing is.
std::string find_fault(const Leg& leg, const LegStops& stops);

/// Is this a spring that the file states for a joint, not for a leg?
bool is_joint_spring(const MechanismModel& model, const JointForce& force);

/// f(name, number, unit, rule, text) for every number. @param model  or const
template <class Model, class F>
void for_each_spring_number(Model& model, F&& f) {
  std::string of;  // part that the text of a number ends with
  const auto add = [&](const std::string& name, auto& number, const char* unit, Rule rule,
                       const std::string& text) { f(name, number, unit, rule, text + of); };
  size_t i = 0, k = 0;
  for (auto& leg : model.legs) {
    const std::string prefix = "leg[" + std::to_string(++i) + "].";
    if (!leg.law) continue;
    of = ", leg '" + leg.name + "'";
    for_each_number(kLegNumbers, *leg.law, prefix, add);
    if (leg.law->stops) for_each_number(kLegStopNumbers, *leg.law->stops, prefix + "stops.", add);
  }
  for (auto& force : model.forces) {
    if (!is_joint_spring(model, force)) continue;
    const Body& body = model.bodies[static_cast<size_t>(force.body)];
    of = ", spring at joint '" + body.name + "', SI units";
    for_each_number(kJointForceNumbers, force, "joint_spring[" + std::to_string(++k) + "].", add);
  }
}

/// Numbers have changed: check them and let them act. @throws ModelError naming leg, number, limit
void update_springs(MechanismModel& model);

}  // namespace dockloop
