// Numbers of springs, of the capture hardware, of the hard dock and of forces between the vehicles
// that a host may set before a run.
//
// One list gives their names in the FMU, units, limits and order: springs of legs and joints,
// contact laws, latches, faces, hooks, pushers, forces. Friction and restitution have parameters of
// their own (sim/values.hpp).
#pragma once

#include <string>
#include <vector>

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "docking/docking_model.hpp"
#include "docking/hard_dock.hpp"
#include "docking/scene.hpp"
#include "model/spring_numbers.hpp"

namespace dockloop {

/// The numbers of the common law that no other parameter sets, then those that variants state.
template <class Contact, class F>
void for_each_contact_number(Contact& contact, F&& f) {
  if (contact.kind == ContactModel::Kind::kAbsorber) {
    for_each_number(kAbsorberNumbers, contact.absorber, "contact.", f);
  }
  if (!contact.has_surfaces()) return;
  for (const LawNumber<ContactLaw>& each : kContactNumbers) {
    const bool has_parameter =
        each.member == &ContactLaw::damping || each.member == &ContactLaw::friction_coefficient;
    const bool is_of_rings = each.member == &ContactLaw::node_stiffness;
    if (has_parameter || (is_of_rings && !contact.rings)) continue;
    f(std::string("contact.") + each.name, contact.law.*each.member, each.unit, each.rule,
      std::string(each.text));
  }
  size_t k = 0;
  for (auto& variant : contact.variants) {
    const std::string prefix = "contact.law[" + std::to_string(++k) + "].";
    for (auto& [member, value] : variant.stated) {
      for (const LawNumber<ContactLaw>& each : kContactNumbers) {
        if (each.member != member) continue;
        f(prefix + each.name, value, each.unit, each.rule,
          each.text + (", law '" + variant.name + "'"));
      }
    }
  }
}

inline const MechanismModel& get_mechanism(const Scene& scene) { return scene.mechanism; }
inline MechanismModel& get_mechanism(DockingModel& model) { return model.mechanism.model; }

/// Numbers of what meets the target. @param owner  a Scene or a DockingModel, or const
template <class Owner, class F>
void for_each_docking_number(Owner& owner, F&& f) {
  for_each_contact_number(owner.contact, f);
  size_t i = 0;
  for (auto& latch : owner.latches.latch) {
    for_each_number(kLatchNumbers, latch.law, "latch[" + std::to_string(++i) + "].", f);
  }
  auto& dock = owner.hard_dock;
  if (dock.face_count() > 0) for_each_number(kFaceNumbers, dock.faces, "faces.", f);
  if (!dock.hooks.rows.empty()) for_each_number(kHookNumbers, dock.hooks, "hooks.", f);
  size_t k = 0;
  for (auto& row : dock.hooks.rows) {
    for_each_number(kHookRowNumbers, row, "hooks.row[" + std::to_string(++k) + "].", f);
  }
  if (dock.pusher_count() > 0) for_each_number(kPusherNumbers, dock.pushers, "pushers.", f);
  size_t n = 0;
  for (auto& force : owner.forces) {
    for_each_force_number(force, "force[" + std::to_string(++n) + "].", f);
  }
}

/// All numbers of the hardware.
template <class Owner, class F>
void for_each_hardware_number(Owner& owner, F&& f) {
  for_each_spring_number(get_mechanism(owner), f);
  for_each_docking_number(owner, f);
}

template <class Owner>
std::vector<double> get_hardware_numbers(const Owner& owner) {
  std::vector<double> numbers;
  for_each_hardware_number(owner, [&](const std::string&, double number, const char*, Rule,
                                      const std::string&) { numbers.push_back(number); });
  return numbers;
}

/// The numbers back, in the same order. The caller calls set_law() then, and checks them.
template <class Owner>
void put_hardware_numbers(const std::vector<double>& numbers, Owner& owner) {
  const double* next = numbers.data();
  for_each_hardware_number(owner, [&](const std::string&, double& number, const char*, Rule,
                                      const std::string&) { number = *next++; });
}

}  // namespace dockloop
