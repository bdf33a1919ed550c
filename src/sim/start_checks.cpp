// Checks of parameters, and of a start state; see start_checks.hpp.
#include "sim/start_checks.hpp"

#include <algorithm>
#include <cstdio>

#include "math/decompositions.hpp"
#include "sim/solver_methods.hpp"

namespace dockloop {

void check_quaternion(const Vec4<double>& q, const std::string& name) {
  if (!is_attitude(q)) {
    throw ModelError(name + " must be a unit quaternion (w, x, y, z); its norm is " +
                     describe_number(q.norm()));
  }
}

void check_mass(const VehicleParameters& p, const std::string& name) {
  // Far below the mass of any vehicle, far above numbers with an infinite inverse.
  constexpr double kLeastMass = 1e-9, kLeastInertia = 1e-12;  // [kg], [kg m2]
  if (!(p.mass >= kLeastMass)) {
    throw ModelError(name + ".mass is " + describe_number(p.mass) +
                     " kg; it must be at least 1e-9 kg");
  }
  const Mat3<double> inertia = make_symmetric(p.inertia);
  if (!is_positive_definite(inertia) || !(inertia.diagonal().minCoeff() >= kLeastInertia)) {
    std::string values;
    for (int i = 0; i < 6; ++i) values += " " + describe_number(p.inertia[i]);
    throw ModelError(name + ".inertia (xx yy zz xy xz yz) is" + values +
                     "; it must be positive definite");
  }
  constexpr double kTyped = 1e-6;  // relative rounding in a data sheet
  const Vec3<double> moment = find_principal_moments(inertia);
  if (!can_have_moments(moment, kTyped)) {
    char text[300];
    std::snprintf(text, sizeof text,
                  "%s.inertia has the principal moments %.6g, %.6g and %.6g kg m2; no body has one "
                  "larger than the sum of the two others: check the order xx yy zz xy xz yz",
                  name.c_str(), moment[0], moment[1], moment[2]);
    throw ModelError(text);
  }
}

namespace {

void check_vehicle(const VehicleParameters& p, const std::string& name) {
  check_mass(p, name);
  if (p.mass_includes_mechanism != 1 && p.mass_includes_mechanism != 2) {
    throw ModelError(name + ".mass_includes_mechanism must be 1 (excluded) or 2 (included)");
  }
  check_quaternion(p.interface_attitude, name + ".interface_attitude");
  check_quaternion(p.attitude, name + ".attitude");
}

/// Levels that leave bodies out, or have other unknowns, do not know parts of vehicles.
void check_parts(const Parameters& p, const Scene& scene) {
  const bool has_parts[] = {scene.parts[kChaser].count_coordinates() > 0,
                            scene.parts[kTarget].count_coordinates() > 0};
  if (p.model_level == kRigid && (has_parts[kChaser] || has_parts[kTarget])) {
    throw ModelError(
        "model.level is 1 (rigid), but a vehicle has parts that move; set model.level = 3 "
        "(reduced)");
  }
  if (p.model_level == kReference && has_parts[kTarget]) {
    throw ModelError(
        "model.level is 4 (reference), which knows parts of the chaser only; set model.level = 3 "
        "(reduced)");
  }
  if (p.model_level == kReference && scene.parts[kChaser].has_modes()) {
    throw ModelError(
        "model.level is 4 (reference), which knows no modes of a vehicle; set model.level = 3 "
        "(reduced)");
  }
  for (int i : {kChaser, kTarget}) {
    const VehicleParameters& vehicle = p.vehicle[i];
    check_modes({vehicle.mass, Vec3<double>::Zero(), make_symmetric(vehicle.inertia)},
                scene.parts[i], get_vehicle_name(i));
  }
}

}  // namespace

void check_modes(const VehicleBody& vehicle, const VehicleParts& parts, const std::string& name) {
  if (can_carry_modes(vehicle, parts)) return;
  const double left = find_share_without_modes(vehicle, parts);
  throw ModelError(name + ".modes take part with " + describe_number(1.0 - left) +
                   " times the mass and inertia of the vehicle in one direction; the sum of their "
                   "effective masses must stay below " +
                   name + ".mass and " + name +
                   ".inertia (limit 0.9999): check units (kg^(1/2), kg^(1/2) m) and " + name +
                   ".modes.point");
}

void check_method(const Parameters& p, bool has_comparison) {
  check_choice(p.solver_method, list_carried_methods(has_comparison), "solver.method");
  if (!find_method(p.solver_method)->is_carried(has_comparison)) {
    throw ModelError("solver.method is " + std::to_string(p.solver_method) +
                     describe_missing_method(p.solver_method));
  }
  if (p.model_level == kReference && !has_comparison) {
    throw ModelError("model.level is 4" + describe_missing_reference_level());
  }
}

void check_level(const Parameters& p, FmiKind fmi_kind) {
  check_choice(p.model_level, kLevels, "model.level");
  if (fmi_kind == FmiKind::kModelExchange) {
    if (p.model_level != kReference) return;
    throw ModelError(
        "model.level is 4 (reference), which is not available for model exchange: set "
        "model.level = 3 (reduced), or use co-simulation");
  }
  if (p.model_level == kReference && p.solver_method != kDae && p.solver_method != kAuto) {
    throw ModelError(
        "model.level is 4 (reference), which only solver.method 9 (dae) or 1 (auto) "
        "integrates; solver.method is " +
        std::to_string(p.solver_method));
  }
  if (p.model_level != kReference && p.solver_method == kDae) {
    throw ModelError(
        "solver.method is 9 (dae), which integrates the mechanism with multipliers: "
        "set model.level to 4 (reference); it is " +
        std::to_string(p.model_level));
  }
}

void check_delays(const Parameters& p) {
  constexpr double kLongest = 10.0;
  if (!(p.coupling_delay >= 0.0 && p.coupling_delay <= kLongest)) {
    throw ModelError("coupling.delay is " + describe_number(p.coupling_delay) +
                     " s; it must be between 0 and " + describe_number(kLongest) + " s");
  }
  if (!(p.coupling_motion_delay >= 0.0 && p.coupling_motion_delay <= p.coupling_delay)) {
    throw ModelError("coupling.motion_delay is " + describe_number(p.coupling_motion_delay) +
                     " s; as a part of coupling.delay it must be between 0 and " +
                     describe_number(p.coupling_delay) + " s");
  }
}

void check_parameters(const Parameters& p, const Scene& scene, FmiKind fmi_kind,
                      bool has_comparison) {
  check_vehicle(p.vehicle[kChaser], "chaser");
  if (scene.has_target) check_vehicle(p.vehicle[kTarget], "target");
  const auto positive = [](double value, const char* name) {
    if (!(value > 0.0)) {
      throw ModelError(std::string(name) + " is " + describe_number(value) +
                       "; it must be above 0");
    }
  };
  positive(p.rtol, "solver.rtol");
  positive(p.atol_position, "solver.atol_position");
  positive(p.atol_velocity, "solver.atol_velocity");
  positive(p.atol_energy, "solver.atol_energy");
  positive(p.step, "solver.step");
  positive(p.coupling_expected_step, "coupling.expected_step");
  positive(p.coupling_velocity_tolerance, "coupling.velocity_tolerance");
  check_choice(p.coupling_mode, kCouplingModes, "coupling.mode");
  check_delays(p);
  check_method(p, has_comparison);
  check_level(p, fmi_kind);
  check_parts(p, scene);
  check_choice(p.flight, kFreeDriftModels, "model.flight");
  check_choice(p.dae_form, kDaeForms, "solver.dae_form");
  if (fmi_kind == FmiKind::kModelExchange && p.friction_model != scene.contact.law.friction_model) {
    throw ModelError("friction.model is " + std::to_string(p.friction_model) +
                     ", which changes the number of continuous states: for model exchange set it "
                     "in the scene (key contact.friction_model) and build the FMU again");
  }
  if (!(p.contact_thrust_delay >= 0.0)) {
    throw ModelError("chaser.contact_thrust_delay must be 0 s or more");
  }
}

/// What determines a joint that is not independent.
std::string describe_cause(const MechanismModel& mechanism, int body) {
  for (const Loop& loop : mechanism.loops) {
    const bool is_its = std::count(loop.dependent.begin(), loop.dependent.end(), body) > 0;
    if (is_its && loop.cut == CutType::kCoupling) {
      return "the coupling '" + loop.name + "' determines this joint";
    }
  }
  return "a loop determines this joint";
}

void check_joint_starts(const Scene& scene, const LoopPlan& plan) {
  const std::vector<Body>& bodies = scene.mechanism.bodies;
  const auto is_independent = [&](int i) {
    return std::find(plan.ind_bodies.begin(), plan.ind_bodies.end(), i) != plan.ind_bodies.end();
  };
  for (const JointStart& start : scene.joint_starts) {
    int at = kBase;
    std::string choice;
    for (int i = 0; i < static_cast<int>(bodies.size()); ++i) {
      if (bodies[i].name == start.name) at = i;
      if (is_independent(i) && bodies[i].joint != JointType::kFree)
        choice += (choice.empty() ? "" : ", ") + bodies[i].name;
    }
    if (at != kBase && is_independent(at) && bodies[at].joint != JointType::kFree) continue;
    const std::string reason =
        at == kBase ? "the mechanism has no body of that name"
        : !is_independent(at)
            ? describe_cause(scene.mechanism, at)
            : "a free joint has no single coordinate (initial.capture_body displaces a free "
              "capture body)";
    throw ModelError("initial.joints." + start.name + ": " + reason +
                     (choice.empty() ? "; no joint of this mechanism has a free start value"
                                     : "; joints with a free start value are " + choice));
  }
}

void check_mechanism_rests(const DockingModel& model, const DockingData<double>& data) {
  for (const Body& body : model.mechanism.model.bodies) {
    if (&body == &model.mechanism.model.bodies[0] && model.mechanism.vehicle != kBase) continue;
    const double rate = data.mechanism.tree.v.segment(body.v_index, body.nv()).norm();
    if (rate == 0.0) continue;
    char text[320];
    std::snprintf(text, sizeof text,
                  "model.level is 1 (rigid), but the joint of body '%s' starts at a rate of %.6g; "
                  "leave out rates in initial.capture_body and initial.joints (and driven "
                  "couplings), or set model.level = 3 (reduced)",
                  body.name.c_str(), rate);
    throw ModelError(text);
  }
}

}  // namespace dockloop
