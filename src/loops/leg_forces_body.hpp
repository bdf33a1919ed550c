// Forces in the joints of legs and gears, and loads on their bodies; see leg_platforms.hpp.
#pragma once

#include <type_traits>

#include "loops/leg_gears_body.hpp"

namespace dockloop {

namespace {

/// Forces in the joints of legs and gears; loads on their bodies as forces in the joints and as a
/// load on the root: power is the same.
template <class S>
void put_leg_forces(const MechanismModel& model, const VecX<S>& tau, TreeData<S>& tree,
                    LoopData<S>& loops, PlatformData<S>& at) {
  using Six = Eigen::Array<double, 6, 1>;
  Six loads = Six::Zero();  // their size, added up without a branch per number
  at.is_loaded = false;
  const bool looks = tree.may_load_legs;
  const auto look_at = [&](int body) {
    if (!looks) return;
    const Wrench<S>& load = tree.external[body];
    if constexpr (std::is_same_v<S, double>) {
      static_assert(sizeof load == sizeof(Six));
      loads += Eigen::Map<const Six>(load.f.data()).abs();
      return;
    }
    for (int i = 0; i < 3; ++i) {
      if (load.f[i] != S(0) || load.t[i] != S(0)) at.is_loaded = true;
    }
  };
  for (const LegPlace& leg : at.legs) {
    for (int i = 0; i < 3; ++i) {
      at.store.work(leg, legs::kForce + i) = S(leg.sign[i]) * tau[leg.v[i]];
      look_at(leg.body[i]);
    }
  }
  for (GearData<S>& gear : at.gears) {
    gear.torque = tau[gear.v];
    look_at(gear.body);
  }
  at.is_loaded = at.is_loaded || !(loads == 0.0).all();
  if (!at.is_loaded) {
    for (const GearData<S>& gear : at.gears) {
      if (std::is_same_v<S, double> && gear.torque == S(0)) continue;
      press_legs(gear, gear.torque, at);
    }
    return;
  }
  calc_leg_poses(model, tree, loops);
  at.external = Wrench<S>();
  for (const LegPlace& leg : at.legs) calc_tree_position(model, leg.body, tree);
  calc_tree_position(model, at.gear_bodies, tree);
  for (GearData<S>& gear : at.gears) {
    gear.load = tree.external[gear.body];
    gear.torque += tree.e[gear.body].dot(gear.load.t);
    gear.load.t += tree.r[gear.body].cross(gear.load.f);
    if (gear.on_root) at.external += gear.load;
    press_legs(gear, gear.torque, at);
  }
  for (const LegPlace& leg : at.legs) {
    Wrench<S> load;  // about the origin of the body
    for (int i = 2; i >= 0; --i) {
      const int body = leg.body[i];
      load += tree.external[body];
      for (const GearData<S>& gear : at.gears) {
        if (gear.carrier == body) load += gear.load;
      }
      const bool slides = model.bodies[body].joint == JointType::kPrismatic;
      const S along = tree.e[body].dot(slides ? load.f : load.t);
      at.store.work(leg, legs::kForce + i) += S(leg.sign[i]) * along;
      load.t += tree.r[body].cross(load.f);
    }
    at.external += load;
  }
}

}  // namespace

}  // namespace dockloop
