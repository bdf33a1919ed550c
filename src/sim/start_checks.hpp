// Checks of parameters, and of a start state. All throw ModelError: name, value, limit, remedy.
#pragma once

#include <string>

#include "docking/docking_model.hpp"
#include "sim/docking_sim.hpp"

namespace dockloop {

void check_quaternion(const Vec4<double>& q, const std::string& name);
/// Mass and inertia.
void check_mass(const VehicleParameters& p, const std::string& name);
/// Modes of a vehicle take part with less than the whole vehicle.
void check_modes(const VehicleBody& vehicle, const VehicleParts& parts, const std::string& name);
/// Methods and levels of src/compare are valid only with src/compare.
void check_method(const Parameters& p, bool has_comparison);
/// The form with multipliers needs method 9, and method 9 needs this form.
void check_level(const Parameters& p, FmiKind fmi_kind);
/// Everything that can be checked before a model is made.
void check_parameters(const Parameters& p, const Scene& scene, FmiKind fmi_kind,
                      bool has_comparison);
/// A start can be prescribed only for single joints that no loop determines.
void check_joint_starts(const Scene& scene, const LoopPlan& plan);
/// A locked mechanism must be at rest. @param data  evaluation of the start state
void check_mechanism_rests(const DockingModel& model, const DockingData<double>& data);

}  // namespace dockloop
