// Unit rates of the independent coordinates at home; see coordinate_effects.hpp.
#include "check/coordinate_effects.hpp"

#include "mechanism/element_forces.hpp"

namespace dockloop {
namespace {

constexpr double kRest = 1e-9;  // a smaller rate per unit rate is rounding

void add_moved(const std::string& name, double rate, std::vector<MovedPart>& parts) {
  if (std::abs(rate) > kRest) parts.push_back({name, rate});
}

}  // namespace

std::string find_coordinate_name(const Body& body, int k) {
  static const char* const kNames[] = {".x", ".y", ".z", ".rx", ".ry", ".rz"};
  return body.name + (body.joint == JointType::kFree ? kNames[k] : "");
}

std::vector<CoordinateEffect> find_coordinate_effects(const Mechanism& mechanism) {
  const MechanismModel& model = mechanism.model;
  std::vector<CoordinateEffect> effects;
  MechanismData<double> data(mechanism);
  if (!calc_position(mechanism, data).ok()) return effects;
  data.tree.v.setZero();
  calc_velocity(mechanism, BaseMotion<double>(), data);
  const VecX<double> at_rest = data.tree.v;  // not zero where couplings are driven
  for (int i : mechanism.plan.ind_bodies) {
    for (int k = 0; k < model.bodies[i].nv(); ++k) {
      data.tree.v.setZero();
      data.tree.v[model.bodies[i].v_index + k] = 1.0;
      calc_velocity(mechanism, BaseMotion<double>(), data);
      CoordinateEffect effect;
      effect.coordinate = find_coordinate_name(model.bodies[i], k);
      effect.is_angle = is_angle(model.bodies[i], k);
      const VecX<double> moved = data.tree.v - at_rest;
      for (const Body& body : model.bodies) {
        if (&body == &model.bodies[i]) continue;
        for (int j = 0; j < body.nv(); ++j) {
          add_moved(find_coordinate_name(body, j), moved[body.v_index + j], effect.joints);
        }
      }
      for (const Leg& leg : model.legs) {
        add_moved(leg.name, leg.arm * moved[model.bodies[leg.body].v_index], effect.legs);
      }
      for (const ForceElement& element : model.elements) {
        add_moved(element.name, find_rate<double>(model, element, moved), effect.elements);
      }
      effects.push_back(effect);
    }
  }
  return effects;
}

}  // namespace dockloop
