// From scene and parameters to the start state: checks, model, integrator, warnings.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "docking/frame_origin.hpp"
#include "math/inertia.hpp"
#include "mechanism/kernels.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kLongestRealTimeStep = 0.01;  ///< [s]

/// Motion of a vehicle at the start values of its scene.
Inputs::Vehicle find_start(const VehicleParameters& p) {
  Inputs::Vehicle start;
  start.position = p.position;
  start.velocity = p.velocity;
  start.attitude = p.attitude;
  start.angular_velocity = p.angular_velocity;
  return start;
}

void check_quaternion(const Vec4<double>& q, const std::string& name) {
  if (!is_attitude(q)) {
    throw ModelError(name + " must be a unit quaternion (w, x, y, z); its norm is " +
                     describe_number(q.norm()));
  }
}

void check_vehicle(const VehicleParameters& p, const std::string& name) {
  // Far below the mass of any vehicle, far above numbers with an infinite inverse.
  constexpr double kLeastMass = 1e-9, kLeastInertia = 1e-12;  // [kg], [kg m2]
  if (!(p.mass >= kLeastMass)) {
    throw ModelError(name + ".mass is " + describe_number(p.mass) +
                     " kg; it must be at least 1e-9 kg");
  }
  const Mat3<double> inertia = make_symmetric(p.inertia);
  const Eigen::LLT<Mat3<double>> positive(inertia);
  if (positive.info() != Eigen::Success || !(inertia.diagonal().minCoeff() >= kLeastInertia)) {
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
  if (p.mass_includes_mechanism != 1 && p.mass_includes_mechanism != 2) {
    throw ModelError(name + ".mass_includes_mechanism must be 1 (excluded) or 2 (included)");
  }
  check_quaternion(p.interface_attitude, name + ".interface_attitude");
  check_quaternion(p.attitude, name + ".attitude");
}

/// Methods and levels of src/compare are valid only with src/compare.
void check_method(const Parameters& p, bool has_comparison) {
  check_choice(p.solver_method, list_carried_methods(has_comparison), "solver.method");
  if (has_comparison) return;
  if (find_method(p.solver_method)->for_comparison) {
    throw ModelError("solver.method is " + std::to_string(p.solver_method) +
                     describe_missing_method(p.solver_method));
  }
  if (p.model_level == kReference) {
    throw ModelError("model.level is 4" + describe_missing_reference_level());
  }
}

/// The form with multipliers needs method 9, and method 9 needs this form.
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

/// Motors and drives act by themselves, failures at their time.
bool acts_by_itself(const MechanismModel& mechanism) {
  for (const ForceElement& element : mechanism.elements) {
    if (std::any_of(element.laws.begin(), element.laws.end(), is_powered)) return true;
  }
  return !mechanism.failures.empty();
}

/// Failures as the parameters have them.
void put_failures(const Parameters& p, std::vector<LawFailure>& failures) {
  for (size_t k = 0; k < failures.size(); ++k) {
    failures[k].active = p.failure_active[k] != 0;
    failures[k].onset.time = p.failure_numbers[2 * k];
    failures[k].value = p.failure_numbers[2 * k + 1];
    if (failures[k].onset.time >= 0.0 && failures[k].value >= 0.0) continue;
    throw ModelError("failure[" + std::to_string(k + 1) +
                     "] has a time or value below 0; both must be 0 or more");
  }
}

void put_disturbances(const Parameters& p, std::vector<Disturbance>& disturbances) {
  for (size_t k = 0; k < disturbances.size(); ++k) {
    const DisturbanceNumbers& from = p.disturbance[k];
    Disturbance& to = disturbances[k];
    to.onset.time = from.time;
    to.duration = from.duration;
    to.force = from.force;
    to.torque = from.torque;
    if (from.time >= 0.0 && from.duration >= 0.0) continue;
    throw ModelError("disturbance[" + std::to_string(k + 1) +
                     "] has a time or duration below 0 s; both must be 0 s or more");
  }
}

/// Largest absolute eigenvalue, by squaring: lim |J^n|^(1/n). @param matrix  is overwritten
double find_spectral_radius(MatX<double>& matrix) {
  constexpr int kSquares = 10;
  double logarithm = 0.0, power = 1.0;
  for (int i = 0; i <= kSquares; ++i) {
    const double norm = matrix.norm();
    if (!(norm > 0.0)) return 0.0;
    logarithm += std::log(norm) / power;
    matrix /= norm;
    if (i < kSquares) matrix = (matrix * matrix).eval();
    power *= 2.0;
  }
  return std::exp(logarithm);
}

Stepper::Method find_stepper_method(int method) {
  switch (method) {
    case kImplicit:
      return Stepper::Method::kEsdirk;
    case kBdf:
      return Stepper::Method::kBdf;
    case kFixedRk4:
    case kFixedRosenbrock:  // with bristles
      return Stepper::Method::kClassicRk4;
    case kAuto:
    case kStabilised:
    case kRosenbrock:  // with bristles
      return Stepper::Method::kStabilised;
    default:
      return Stepper::Method::kDormandPrince;
  }
}

/// Values of the scene; every other parameter has its default.
Parameters find_start_parameters(const Scene& scene) {
  Parameters p;
  p.vehicle = scene.vehicle;
  p.contact_thrust = scene.contact_thrust;
  p.contact_thrust_delay = scene.contact_thrust_delay;
  p.friction_coefficient = scene.contact.law.friction_coefficient;
  p.friction_model = scene.contact.law.friction_model;
  p.restitution = scene.restitution;
  p.restitution_speed = scene.restitution_speed;
  p.model_level = scene.level;
  p.accuracy = scene.accuracy;
  p.solver_method = scene.solver.method;
  p.step = scene.solver.step;
  p.rtol = scene.solver.rtol;
  p.atol_position = scene.solver.atol_position;
  p.atol_velocity = scene.solver.atol_velocity;
  p.atol_energy = scene.solver.atol_energy;
  p.coupling_mode = scene.parallel_host ? kParallel : kSequential;
  p.coupling_expected_step = scene.experiment.step;
  p.element_numbers = get_element_numbers(scene.mechanism.elements);
  for (const LawFailure& failure : scene.mechanism.failures) {
    p.failure_active.push_back(failure.active ? 1 : 0);
    p.failure_numbers.insert(p.failure_numbers.end(), {failure.onset.time, failure.value});
  }
  for (const Disturbance& d : scene.disturbances) {
    p.disturbance.push_back({d.onset.time, d.duration, d.force, d.torque});
  }
  return p;
}

Inputs find_start_inputs(const Scene& scene) {
  Inputs in;
  for (int i : {kChaser, kTarget}) in.vehicle[i] = find_start(scene.vehicle[i]);
  in.leg_force_command.assign(scene.mechanism.legs.size(), 0.0);
  in.element_command = list_start_commands(scene.mechanism.elements);
  return in;
}

}  // namespace

DockingSim::Impl::Impl(std::shared_ptr<const Scene> s, FmiKind i, const Comparison* c)
    : scene(std::move(s)), fmi_kind(i), comparison(c) {
  clear();
  check_method(parameters, comparison != nullptr);
}

/// Back to the scene's values. The storage is not moved: the variable table points to it. Copies of
/// lists keep it, because their sizes follow from the scene; moves would not.
void DockingSim::Impl::clear() {
  const Parameters start_parameters = find_start_parameters(*scene);
  const Inputs start_inputs = find_start_inputs(*scene);
  parameters = start_parameters;
  inputs = start_inputs;
  for (Outputs::Vehicle& vehicle : outputs.vehicle) vehicle = Outputs::Vehicle();
  const MechanismModel& m = scene->mechanism;
  const auto zero = [](std::vector<double>& v, size_t n) { v.assign(n, 0.0); };
  for (auto* v : {&outputs.element_coordinate, &outputs.element_rate, &outputs.element_force,
                  &outputs.element_saturation}) {
    zero(*v, m.elements.size());
  }
  const size_t surfaces = scene->contact.surfaces.size();
  zero(outputs.petal_force, scene->contact.rings ? surfaces : 0);
  zero(outputs.surface_force, scene->contact.rings ? 0 : surfaces);
  zero(outputs.surface_peak, outputs.surface_force.size());
  zero(outputs.latch_opening, static_cast<size_t>(scene->latches.count()));
  zero(outputs.latch_lateral, static_cast<size_t>(scene->latches.count()));
  zero(outputs.latch_force, static_cast<size_t>(scene->latches.count()));
  zero(outputs.hook_force, static_cast<size_t>(scene->hard_dock.hooks.count()));
  outputs.latch_state.assign(static_cast<size_t>(scene->latches.count()), kFree);
  outputs.latched.assign(static_cast<size_t>(scene->latches.count()), 0);
  for (auto* v : {&outputs.leg_length, &outputs.leg_rate, &outputs.leg_force})
    zero(*v, m.legs.size());
  const LoopPlan plan = Mechanism(m).plan;
  check_joint_starts(plan);
  zero(outputs.state_q, plan.ind_q.size());
  zero(outputs.state_v, plan.ind_v.size());
  zero(outputs.state_a, plan.ind_v.size());
  state_count = count_sums(m, scene->hard_dock);
  state_count +=
      6 + count_element_bristles(m.elements, m.failures) + bristle_state_count(scene->contact);
  for (int i : plan.ind_bodies) state_count += m.bodies[i].nq() + m.bodies[i].nv();
  for (int i : {kChaser, kTarget}) {
    const bool moves = scene->motion[i] != Motion::kFixed && (i == kChaser || scene->has_target);
    if (moves) state_count += 7 + 6;
    if (moves && scene->motion[i] == Motion::kDriven) state_count += 6;
  }
  zero(outputs.states, static_cast<size_t>(state_count));
  zero(outputs.rates, static_cast<size_t>(state_count));
  outputs.loop_force.assign(m.loops.size(), Vec3<double>::Zero());
  slopes = inputs;
  for_each_value(slopes, [](double& slope) { slope = 0.0; });
  static_cast<SimState&>(*this) = SimState();
  setup.reset();
  model.reset();
  start_mechanism.reset();
  events.reset();
  evaluator.reset();
  quiescent_mode.reset();
  host.reset();
  stepper.reset();
  status_text.clear();
  warnings.clear();
  invalidate();
}

void DockingSim::Impl::check_parameters() const {
  const Parameters& p = parameters;
  check_vehicle(p.vehicle[kChaser], "chaser");
  if (scene->has_target) check_vehicle(p.vehicle[kTarget], "target");
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
  check_method(p, comparison != nullptr);
  check_level(p, fmi_kind);
  check_choice(p.flight, kFreeDriftModels, "model.flight");
  check_choice(p.dae_form, kDaeForms, "solver.dae_form");
  if (fmi_kind == FmiKind::kModelExchange &&
      p.friction_model != scene->contact.law.friction_model) {
    throw ModelError("friction.model is " + std::to_string(p.friction_model) +
                     ", which changes the number of continuous states: for model exchange set it "
                     "in the scene (key contact.friction_model) and build the FMU again");
  }
  if (!(p.contact_thrust_delay >= 0.0)) {
    throw ModelError("chaser.contact_thrust_delay must be 0 s or more");
  }
}

/// A start can be prescribed only for single joints that no loop determines.
void DockingSim::Impl::check_joint_starts(const LoopPlan& plan) const {
  const std::vector<Body>& bodies = scene->mechanism.bodies;
  const auto is_independent = [&](int i) {
    return std::find(plan.ind_bodies.begin(), plan.ind_bodies.end(), i) != plan.ind_bodies.end();
  };
  for (const JointStart& start : scene->joint_starts) {
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
            ? "a loop determines this joint"
            : "a free joint has no single coordinate (initial.capture_body displaces a free "
              "capture body)";
    throw ModelError("initial.joints." + start.name + ": " + reason +
                     (choice.empty() ? "; no joint of this mechanism has a free start value"
                                     : "; joints with a free start value are " + choice));
  }
}

/// A locked mechanism must be at rest. @pre evaluate
void DockingSim::Impl::check_mechanism_rests() const {
  for (const Body& body : model->mechanism.model.bodies) {
    if (&body == &model->mechanism.model.bodies[0] && model->mechanism.vehicle != kBase) continue;
    const double rate = present().mechanism.tree.v.segment(body.v_index, body.nv()).norm();
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

ContactLaw DockingSim::Impl::make_contact_law() const {
  ContactLaw law = scene->contact.law;
  law.friction_coefficient = parameters.friction_coefficient;
  law.friction_model = parameters.friction_model;
  if (parameters.restitution != scene->restitution ||
      parameters.restitution_speed != scene->restitution_speed) {
    law.damping =
        find_damping_for_restitution(parameters.restitution, parameters.restitution_speed);
  }
  return law;
}

void DockingSim::Impl::choose_frame_O() {
  frame_origin = find_frame_origin(*scene, parameters.vehicle);
  const bool drifts = scene->motion[kChaser] != Motion::kFixed &&
                      (!scene->has_target || scene->motion[kTarget] != Motion::kFixed);
  const VehicleParameters& p = parameters.vehicle[scene->has_target ? kTarget : kChaser];
  frame_velocity = drifts ? p.velocity : Vec3<double>(Vec3<double>::Zero());
  frame_shift.setZero();
}

/// Close the loops at the start of the joints, in small steps from the home pose: a loop keeps the
/// assembly branch of the home pose.
Status DockingSim::Impl::bring_joints_to_start() {
  if (scene->joint_starts.empty()) return {};
  const MechanismModel& m = model->mechanism.model;
  VecX<double> target = present().mechanism.tree.q;
  for (const JointStart& start : scene->joint_starts) {
    const int q = m.bodies[find_body(m, start.name, "initial.joints")].q_index;
    target[q] = start.position.value_or(m.home_q[q]);
  }
  return move_to(model->mechanism, target, present().mechanism);
}

void DockingSim::Impl::set_start_state() {
  double* y = stepper->y();
  const StateLayout& layout = model->layout;
  std::fill(y, y + layout.size, 0.0);
  // Mechanism in the home pose; capture body and single joints may be displaced.
  int q = layout.mechanism_q, v = layout.mechanism_v;
  for (int i : model->mechanism_bodies) {
    const Body& body = model->mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) y[q + j] = model->mechanism.model.home_q[body.q_index + j];
    if (i == model->mechanism.model.capture_body && body.joint == JointType::kFree) {
      // The start is prescribed in axes of B; the free joint uses axes of its placement.
      const CaptureBodyStart& start = scene->capture_body_start;
      const int home = scene->mechanism.capture_body;
      const Mat3<double> R_BJ = scene->mechanism.bodies[home].placement.R;
      const Vec3<double> p = R_BJ.transpose() * start.displacement;
      const Vec4<double> home_quat(y[q + 3], y[q + 4], y[q + 5], y[q + 6]);
      const Vec4<double> turn = quat_exp<double>(R_BJ.transpose() * start.rotation_vector);
      const Vec4<double> quat = quat_multiply<double>(turn, home_quat);
      const Mat3<double> R = R_BJ * quat_to_matrix<double>(quat);
      const Vec3<double> velocity = R.transpose() * start.velocity;
      const Vec3<double> rate = R.transpose() * start.angular_velocity;
      for (int j = 0; j < 3; ++j) {
        y[q + j] += p[j];
        y[v + j] = velocity[j];
        y[v + 3 + j] = rate[j];
      }
      for (int j = 0; j < 4; ++j) y[q + 3 + j] = quat[j];
    }
    for (const JointStart& start : scene->joint_starts) {
      if (start.name != body.name) continue;
      y[q] = start.position.value_or(y[q]);
      y[v] = start.rate;
    }
    q += body.nq();
    v += body.nv();
  }
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || !model->moves[i]) continue;
    const VehicleParameters& p = parameters.vehicle[i];
    set_vehicle_pose(*model, i, p.position - frame_origin - frame_shift, p.attitude, y);
    set_vehicle_velocity(*model, i, p.velocity - frame_velocity, p.angular_velocity, y, present());
  }
}

/// Fix the set-up from the present parameters and inputs, and start.
void DockingSim::Impl::initialise(double t0, double tolerance) {
  // A driven vehicle starts at its inputs, or at the scene's values if all inputs are zero.
  for (int i : {kChaser, kTarget}) {
    if (scene->motion[i] != Motion::kDriven) continue;
    VehicleParameters& p = parameters.vehicle[i];
    const bool is_missing = is_all_zero(inputs.vehicle[i]);
    const Inputs::Vehicle in = is_missing ? find_start(scene->vehicle[i]) : inputs.vehicle[i];
    check_quaternion(in.attitude, std::string(get_vehicle_name(i)) + ".attitude");
    p.position = in.position;
    p.velocity = in.velocity;
    p.attitude = in.attitude;
    p.angular_velocity = in.angular_velocity;
  }
  check_parameters();
  try {
    start(std::make_shared<const Setup>(Setup{parameters, t0, tolerance}));
    if (host->announces()) announce(parameters.coupling_expected_step);
  } catch (...) {
    setup.reset();
    throw;
  }
}

void DockingSim::Impl::start(std::shared_ptr<const Setup> from) {
  static_cast<SimState&>(*this) = SimState();
  warnings.clear();
  check_method(from->parameters, comparison != nullptr);  // a saved state may come from elsewhere
  check_level(from->parameters, fmi_kind);
  check_accuracy(from->parameters.accuracy);
  setup = std::move(from);
  parameters = setup->parameters;
  choice_text.clear();
  Parameters wanted = parameters;
  if (fmi_kind == FmiKind::kModelExchange) wanted.accuracy = 0.0;  // the host integrates
  choose_frame_O();
  const auto made = std::make_shared<DockingModel>(make_docking_model(
      *scene, parameters.vehicle, make_contact_law(), frame_origin, parameters.model_level));
  made->thrust = parameters.contact_thrust;
  made->thrust_delay = parameters.contact_thrust_delay;
  // In model exchange frame O must be a function of time alone: O then drifts and does not fall.
  if (fmi_kind == FmiKind::kModelExchange) made->falling = false;
  put_element_numbers(parameters.element_numbers, made->mechanism.model.elements);
  check_elements(made->mechanism.model.elements);
  put_failures(parameters, made->mechanism.model.failures);
  put_disturbances(parameters, made->disturbances);
  model = made;
  chosen = choose_solver(wanted, setup->tolerance, *model);
  discrete.hard_dock = make_start(model->hard_dock);
  events = std::make_unique<EventLogic>(*model, discrete, memory);
  start_mechanism.reset();
  state_bodies = model->mechanism_bodies;
  loads.start(count_commands(model->mechanism.model));
  evaluator = std::make_unique<Evaluator>(model, *this, loads);
  host = std::make_unique<HostCoupling>(*model, setup, frame_origin, inputs, loads, *events,
                                        *evaluator, *this, warnings);
  quiescent_mode =
      std::make_unique<QuiescentMode>(*model, *this, chosen, find_relative_tolerance(),
                                      can_be_quiescent(), can_drift(), loads, *events, *evaluator);
  derivative_pass.reset();
  jump_work.reset();
  look_ahead_start.reset();
  if (host->has_host()) jump_work = std::make_unique<BaseJumpWorkspace>(model->mechanism);
  if (host->announces()) look_ahead_start = std::make_unique<Snapshot>();
  make_stepper();
  read_inputs();
  counted_elsewhere = Counters();
  events->clear_due();
  for (int i : {kChaser, kTarget}) {
    const Mat3<double> inertia = make_symmetric(parameters.vehicle[i].inertia);
    least_inertia[i] = find_principal_moments(inertia)[0];
  }
  // At rest the scale is the motion of a vehicle within the tolerance.
  const double least_momentum = chosen.atol_velocity * parameters.vehicle[kChaser].mass;

  Status status = bring_joints_to_start();
  if (status.ok()) {
    set_start_state();
    status = evaluate(0.0);
  }
  if (!status.ok()) throw ModelError("start state: " + describe(status));
  keep_pose();
  if (parameters.model_level == kRigid) {
    check_mechanism_rests();
    quiescent_mode->lock_always();
    if (!evaluate(0.0).ok()) throw ModelError("start state cannot be evaluated");
  }
  if (chosen.needs_step) chosen.step = find_real_time_step();
  inner_step = chosen.step;
  warn_about_inner_step();
  if (parameters.accuracy != 0.0) {
    choice_text = fmi_kind == FmiKind::kModelExchange
                      ? "accuracy has no effect for model exchange: the host integrates"
                      : describe_choice(parameters, chosen, setup->tolerance, *model);
  }
  start_energy_audit(*model, present(), stepper->y(), energy_audit);
  start_momentum_audit(*model, present(), least_momentum, momentum_audit);
  attach_kernel();
  warn_about_start();
  if (has_surfaces()) {
    if (have_rings_passed(model->contact, present().relative)) {
      throw ModelError(
          "start state: the passive ring is behind the active ring, so the surfaces have passed "
          "through each other (relative.position[1] would be " +
          describe_number(present().relative.p.x()) +
          " m as seen from the ring); start with the target further along +x of A");
    }
    update_contact_memory(model->contact, present().relative, bristles(), present().contact_work,
                          memory);
    const double gap = find_gap(model->contact, present().relative, present().contact_work);
    if (!decide_absorber().ok()) throw ModelError("start state cannot be evaluated");
    // A start in contact, or in the window of a latch, counts as first contact at the start.
    if (gap <= kTouching) events->begin_contact(0.0);
  }
  if (update_latches(0.0) && !evaluate(0.0).ok())
    throw ModelError("start state cannot be evaluated");
  events->update_capture(0.0);
  start_sequence();
  update_outside_loads(0.0);
  events->update_phases(present(), 0.0);
  peaks.start(0.0, find_peak_values());
  quiescent_mode->start(stepper->y());
  host->start();
  ahead.loads = ahead.mean_known = loads.at_start();
  if (runs_ahead()) {
    ahead.jacobian = kept_jacobian;
    ahead.y_before = y_accepted;
    reserve(ahead.context.memory, static_cast<size_t>(model->contact.pair_count()));
    keep_context();
  }
  keep(step_start);
  if (look_ahead_start) keep(*look_ahead_start);
  invalidate();
}

/// Enter the first step of the sequence, and those that follow at once. @pre evaluate(0)
void DockingSim::Impl::start_sequence() {
  SequenceLogic& sequence = events->sequence();
  if (!sequence.exists()) return;
  if (const char* obstacle = joins_vehicles(model->sequence) ? find_joint_obstacle() : nullptr) {
    throw ModelError("the sequence has the action 'joint': 'rigid': " + std::string(obstacle));
  }
  sequence.start();
  sequence.update_command(inputs.command, 0.0);
  sequence.enter(model->sequence.start, 0,
                 {present(), 0.0, stepper->y()[model->layout.sums + kSumLatches]});
  bool changed = false, jumped = false;
  update_hooks(0.0);
  Status status = evaluate(0.0);
  if (status.ok()) status = update_joint(0.0);
  if (status.ok()) status = update_sequence(0.0, changed, jumped);
  if (!status.ok()) throw ModelError("start state: " + describe(status));
}

/// Can bodies drift in this run? Reference solutions always integrate them.
bool DockingSim::Impl::can_drift() const {
  return setup->parameters.flight == kQuiescent && fmi_kind == FmiKind::kCoSimulation &&
         !is_fixed_step() && !host->has_host() && !adapt_problem;
}

/// Can the mechanism become quiescent in this run?
bool DockingSim::Impl::can_be_quiescent() const {
  return can_drift() && !model->mechanism.plan.is_driven && model->sequence.empty() &&
         !acts_by_itself(model->mechanism.model);
}

/// The smaller of the tolerances of parameter and host.
double DockingSim::Impl::find_relative_tolerance() const {
  const double asked = setup->tolerance;
  return asked > 0.0 ? std::min(asked, chosen.rtol) : chosen.rtol;
}

/// Inner step for real time [s], by the fastest rates of the equations: those of the mechanism at
/// the start, and those of its capture body in contact, in latches and sliding. A Runge-Kutta step
/// of order 4 is stable up to 2.8 over the rate; an oscillation needs shorter steps.
/// @pre evaluate
double DockingSim::Impl::find_real_time_step() {
  constexpr double kPerRate = 1.0, kPerOscillation = 0.3, kPerFriction = 2.0;
  constexpr double kAtOnce = 3.0;  // petals or latches that carry the load
  evaluator->reserve_jacobian();
  MatX<double> jacobian;
  if (evaluator->aside(0.0, stepper->y(), nullptr).ok() &&
      evaluator->calc_jacobian(0.0, stepper->y()).ok()) {
    jacobian = evaluator->jacobian();
  }
  double step = kLongestRealTimeStep;
  const auto limit = [&step](double rate, double factor) {
    if (rate * step > factor) step = factor / rate;
  };
  evaluator->forget();
  if (jacobian.size() > 0 && jacobian.allFinite()) limit(find_spectral_radius(jacobian), kPerRate);
  double mass = find_impacting_mass();
  if (!(mass > 0.0)) {  // no capture body: the lighter vehicle
    for (int i : {kChaser, kTarget}) {
      const double other = parameters.vehicle[i].mass;
      if (model->moves[i]) mass = mass > 0.0 ? std::min(mass, other) : other;
    }
  }
  if (!(mass > 0.0)) return step;
  const ContactModel& contact = model->contact;
  double stiffness = 0.0;
  if (contact.kind == ContactModel::Kind::kAbsorber) stiffness = contact.absorber.stiffness;
  if (contact.has_surfaces()) {
    for (const ContactLaw& law : contact.laws) {
      stiffness = std::max(stiffness, kAtOnce * law.stiffness);
      const double force = present().relative.v.norm() * std::sqrt(kAtOnce * law.stiffness * mass);
      const double friction = law.friction_coefficient * force / (law.friction_speed * mass);
      const double bristle = law.bristle_stiffness / law.bristle_relaxation;
      if (law.friction_coefficient > 0.0) {
        limit(law.friction_model == 1 ? friction : bristle, kPerFriction);
      }
    }
  }
  for (const Latch& latch : model->latches.latch) {
    stiffness = std::max(stiffness, kAtOnce * latch.law.hold_stiffness);
  }
  limit(std::sqrt(stiffness / mass), kPerOscillation);
  const HardDock& dock = model->hard_dock;
  double inverse_mass = 0.0;
  for (int i : {kChaser, kTarget}) {
    if (model->moves[i]) inverse_mass += 1.0 / parameters.vehicle[i].mass;
  }
  const double docked = dock.faces.stiffness + dock.hooks.stiffness * dock.hooks.count();
  limit(std::sqrt(docked * inverse_mass), kPerOscillation);
  return step;
}

/// Mass that meets the target: the capture body on its legs, or all bodies; 0 without such bodies
/// [kg].
double DockingSim::Impl::find_impacting_mass() const {
  const int body = model->mechanism.model.capture_body;
  if (!present().locked) return body == kBase ? 0.0 : model->mechanism.model.bodies[body].mass;
  double inverse_mass = 0.0;
  if (model->moves[kChaser]) inverse_mass += 1.0 / quiescent_mode->locked().whole.mass;
  if (model->moves[kTarget]) inverse_mass += 1.0 / model->vehicle[kTarget].mass;
  return inverse_mass > 0.0 ? 1.0 / inverse_mass : 0.0;
}

/// Generated code evaluates trial states, if the FMU has such code and the code applies. The form
/// with multipliers and the reference solution use no generated code.
void DockingSim::Impl::attach_kernel() {
  const bool serves = !unreduced && !adapt_problem && parameters.model_level != kRigid;
  evaluator->use_kernels(serves ? kernels : nullptr);
}

void DockingSim::Impl::make_stepper() {
  const StateLayout& layout = model->layout;
  Stepper::Problem problem;
  problem.size = layout.size;
  problem.root_count = events->root_count();
  problem.rates = [this](double t, const double* y, double* ydot) {
    const Status status = evaluator->at_trial(t, y, ydot);
    return update_failure_code(status, t, ydot, model->layout.size);
  };
  problem.roots = [this](double t, const double* y, double* roots) {
    const Status status = evaluator->at_events(t, y);
    if (!status.ok()) {
      last_trouble = status;
      return 1;
    }
    events->calc_functions(evaluator->events_at(), roots);
    return 0;
  };
  problem.root_speeds = [this](double* speeds) {
    events->calc_speeds(evaluator->events_at(), speeds);
  };
  if (needs_jacobian()) {
    evaluator->reserve_jacobian();
    if (keeps_jacobian()) {
      kept_jacobian.entries.assign(static_cast<size_t>(layout.size * layout.size), 0.0);
    }
    problem.jacobian = [this](double t, const double* y, double* by_columns) {
      return calc_jacobian(t, y, by_columns);
    };
    problem.jacobian_cost = find_jacobian_cost();
  }
  if (uses_structured_matrix()) enter_structured_matrix(problem);
  unreduced.reset();
  if (adapt_problem) {
    adapt_problem(problem);
  } else if (fmi_kind == FmiKind::kCoSimulation) {
    if (setup->parameters.model_level == kReference) {
      unreduced = comparison->make_unreduced_form(*this);
      unreduced->enter(problem);
    } else if (method().for_comparison) {
      comparison->enter(method().method, *this, problem);
    }
  }
  const Stepper::Method implicit =
      is_fixed_step() ? Stepper::Method::kFixedRosenbrock : Stepper::Method::kRosenbrock;
  stepper = std::make_unique<Stepper>(
      std::move(problem), uses_structured_matrix() ? implicit : find_stepper_method(chosen.method));

  std::vector<double> atol = find_absolute_tolerances();
  // A smaller relative tolerance of the host also reduces absolute tolerances, down to rounding.
  const double rtol = find_relative_tolerance(), share_of_atol = rtol / chosen.rtol;
  constexpr double kRounding = 1e-13;  // [m], [m/s]; of positions and speeds near the docking
  const double least = kRounding / std::max(chosen.atol_position, kRounding);
  for (double& value : atol) value *= std::max(share_of_atol, least);
  stepper->set_tolerances(rtol * std::sqrt(find_share_of_norm()), atol.data());
  if (unreduced) {
    unreduced->set_nominals(Eigen::Map<VecX<double>>(atol.data(), unreduced->size()) / rtol);
  }
  y_accepted.assign(static_cast<size_t>(layout.size), 0.0);
  rates = y_inside = y_shown = y_accepted;
}

/// Keep a failure for the message. @param values  computed values: all must be finite
/// @return status code for Stepper::Problem
int DockingSim::Impl::update_failure_code(Status status, double t, const double* values,
                                          int count) {
  if (status.ok()) {
    double sum = 0.0;
    for (int i = 0; i < count; ++i) sum += values[i];
    if (std::isfinite(sum)) return 0;
    status.code = StatusCode::kNotFinite;
  }
  last_trouble = status;
  last_trouble.time = elapsed + t;
  return status.code == StatusCode::kLoopSingular ? Stepper::kStepOver : Stepper::kSmaller;
}

/// Does `auto` take linearly implicit steps? They pay where friction and latches limit explicit
/// steps: at loose tolerances, or if friction is steep. Limits measured with the docking scenes.
bool DockingSim::Impl::prefers_structured_matrix() const {
  constexpr double kLoose = 1e-4, kLooseVelocity = 1e-6;  // solver.rtol, solver.atol_velocity
  constexpr double kUsual = 1e-6, kSteep = 1e-4;          // solver.rtol, contact.friction_speed
  const double rtol = find_relative_tolerance();
  const bool is_loose = rtol >= kLoose && chosen.atol_velocity >= kLooseVelocity;
  const bool is_steep = rtol >= kUsual && model->contact.law.friction_speed < kSteep;
  return model->contact.has_surfaces() && (is_loose || is_steep);
}

/// Linearly implicit steps? Bristles of contacts, and forms that integrate other unknowns, need
/// another method.
bool DockingSim::Impl::uses_structured_matrix() const {
  if (fmi_kind != FmiKind::kCoSimulation || adapt_problem) return false;
  if (setup->parameters.model_level == kReference || model->layout.bristle_count > 0) return false;
  return method().method == kRosenbrock || method().method == kFixedRosenbrock ||
         (method().method == kAuto && prefers_structured_matrix());
}

void DockingSim::Impl::enter_structured_matrix(Stepper::Problem& problem) {
  evaluator->reserve_matrix();
  kept_jacobian.entries.assign(static_cast<size_t>(find_mechanism_block_size(*model)), 0.0);
  problem.matrix.build = [this](double t, const double* y, int& cost) {
    return build_matrix(t, y, cost);
  };
  problem.matrix.factor = [this](double g) { return evaluator->matrix().factor(g); };
  problem.matrix.solve = [this](double* x) { evaluator->matrix().solve(x); };
  problem.depends_on_time = [this] {
    const auto releases = [](const LatchState& latch) {
      return latch.mode == LatchMode::kReleasing;
    };
    return loads.are_sloped() || model->mechanism.plan.is_driven || is_drive_starting() ||
           is_ramping(model->hard_dock, discrete.hard_dock, elapsed + ahead.begin) ||
           std::any_of(discrete.latch.begin(), discrete.latch.end(), releases);
  };
}

/// May a drive that the sequence runs still gain speed in the inner steps from here on?
bool DockingSim::Impl::is_drive_starting() const {
  const double now = elapsed + ahead.begin;
  return std::any_of(discrete.law.begin(), discrete.law.end(), [now](const LawSetting& law) {
    return law.drive == LawSetting::Drive::kRuns &&
           (now - law.since) * law.acceleration < law.speed;
  });
}

/// @return as the rates
int DockingSim::Impl::build_matrix(double t, const double* y, int& cost) {
  const bool is_accepted = std::equal(y_accepted.begin(), y_accepted.end(), y);
  const std::int64_t step = find_counters().steps;
  const bool renews = !kept_jacobian.valid || step - kept_jacobian.step >= kJacobianSteps;
  const Status status =
      evaluator->build_matrix(t, y, is_accepted, renews, kept_jacobian.entries.data(), cost);
  if (renews) {
    kept_jacobian.valid = status.ok();
    kept_jacobian.step = step;
  }
  return update_failure_code(status, t, nullptr, 0);
}

/// Derivatives of the rates by the states, by columns, for implicit methods. @return as the rates
int DockingSim::Impl::calc_jacobian(double t, const double* y, double* by_columns) {
  evaluator->forget();
  Status status = evaluator->aside(t, y, nullptr);
  if (status.ok()) status = evaluator->calc_jacobian(t, y);
  const MatX<double>& jacobian = evaluator->jacobian();
  std::copy_n(jacobian.data(), jacobian.size(), by_columns);
  const int code = update_failure_code(status, t, by_columns, static_cast<int>(jacobian.size()));
  if (keeps_jacobian()) {
    kept_jacobian.entries.assign(by_columns, by_columns + jacobian.size());
    kept_jacobian.valid = code == 0;
    kept_jacobian.step = find_counters().steps;
  }
  return code;
}

/// Per state, by kind; momenta are velocities times mass or inertia.
std::vector<double> DockingSim::Impl::find_absolute_tolerances() const {
  const StateLayout& layout = model->layout;
  std::vector<double> atol(static_cast<size_t>(layout.size), chosen.atol_position);
  std::fill_n(atol.begin() + layout.mechanism_v, layout.mechanism_nv, chosen.atol_velocity);
  for (int i : {kChaser, kTarget}) {
    if (layout.momentum[i] < 0) continue;
    const VehicleParameters& p = parameters.vehicle[i];
    const double lever2 = p.interface_position.squaredNorm();
    const double inertia = p.inertia.head<3>().maxCoeff() + p.mass * lever2;
    std::fill_n(atol.begin() + layout.momentum[i], 3, chosen.atol_velocity * p.mass);
    std::fill_n(atol.begin() + layout.momentum[i] + 3, 3, chosen.atol_velocity * inertia);
    if (i == kChaser) {
      std::fill_n(atol.begin() + layout.impulse, 3, chosen.atol_velocity * p.mass);
      std::fill_n(atol.begin() + layout.impulse + 3, 3, chosen.atol_velocity * inertia);
    }
  }
  std::fill_n(atol.begin() + layout.sums, layout.sum_count, chosen.atol_energy);
  if (unreduced) unreduced->add_tolerances(atol);
  for (int i : {kChaser, kTarget}) {
    if (layout.host_impulse[i] < 0) continue;
    std::copy_n(atol.begin() + layout.momentum[i], 6, atol.begin() + layout.host_impulse[i]);
  }
  for (double& value : atol) value *= std::sqrt(find_share_of_norm());
  return atol;
}

/// Error norms are means over unknowns: idle bristles and multipliers must not reduce the norm.
double DockingSim::Impl::find_share_of_norm() const {
  const int all = unreduced ? unreduced->size() : model->layout.size;
  const int counted = unreduced ? unreduced->controlled_size() : all;
  return static_cast<double>(counted - model->layout.bristle_count) / all;
}

/// Explicit equal steps that are long for the scene show nothing but wrong loads.
void DockingSim::Impl::warn_about_inner_step() {
  // Measured with the default docking: four times the step for real time costs some percent.
  constexpr double kLong = 4.0;
  if (fmi_kind != FmiKind::kCoSimulation || !is_fixed_step() || chosen.needs_step) return;
  if (needs_jacobian() || uses_structured_matrix()) return;
  const double suggested = find_real_time_step();
  if (inner_step <= kLong * suggested || suggested >= kLongestRealTimeStep) return;
  char text[300];
  std::snprintf(text, sizeof text,
                "solver.step = %.3g s is long for the fastest rates of this scene: peak loads may "
                "be wrong without another sign; accuracy = -1 (real-time) takes %.3g s",
                inner_step, suggested);
  warnings.push_back(text);
}

/// Warnings about unusual values, which may be right.
void DockingSim::Impl::warn_about_start() {
  const double margin = find_singularity_margin(model->mechanism, present().mechanism);
  char text[300];
  if (margin < model->mechanism.model.singularity.warning) {
    std::snprintf(text, sizeof text, "a loop starts close to singular (margin %.3g)", margin);
    warnings.push_back(text);
  }
  if (!scene->mechanism.gravity.isZero(0.0)) {
    warnings.push_back(
        "gravity in the mechanism file is used by 'dockloop check' only: connect the "
        "input 'gravity'");
  }
  const VehicleParameters &p = parameters.vehicle[kChaser], &stated = scene->vehicle[kChaser];
  const bool as_stated = parameters.model_level == scene->level && !present().locked &&
                         p.interface_position == stated.interface_position &&
                         p.interface_attitude == stated.interface_attitude && model->moves[kChaser];
  if (kernels && as_stated && !is_made_for(*kernels, model->mechanism)) {
    warnings.push_back(
        "the kernel in the FMU was made for another mechanism and is not used (same results, "
        "slower)");
  }
  if (!has_surfaces() || !model->contact.has_surfaces()) return;
  // k >= 4 m v^2/rounding^2 for the impacting mass: the capture body on its legs, or all bodies.
  const double mass = find_impacting_mass();
  const double v = present().relative.v.norm();
  const double needed =
      4.0 * mass * v * v / (model->contact.least_rounding * model->contact.least_rounding);
  if (needed > model->contact.law.stiffness) {
    std::snprintf(text, sizeof text,
                  "contact stiffness %.3g N/m is low for a closing speed of %.3g m/s: at least "
                  "%.3g N/m keeps the depth below half the rounding",
                  model->contact.law.stiffness, v, needed);
    warnings.push_back(text);
  }
}

}  // namespace dockloop
