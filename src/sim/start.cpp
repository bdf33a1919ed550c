// From scene and parameters to the start state: model, parts of the simulation, warnings.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "docking/frame_origin.hpp"
#include "docking/hardware_numbers.hpp"
#include "docking/placement.hpp"
#include "math/decompositions.hpp"
#include "mechanism/kernels.hpp"
#include "sim/sim_impl.hpp"
#include "sim/start_checks.hpp"

namespace dockloop {
namespace {

/// Motion of a vehicle at the start values of its scene.
Inputs::Vehicle find_start(const VehicleParameters& p) {
  Inputs::Vehicle start;
  start.position = p.position;
  start.velocity = p.velocity;
  start.attitude = p.attitude;
  start.angular_velocity = p.angular_velocity;
  return start;
}

/// Motors and drives act by themselves.
bool acts_by_itself(const MechanismModel& mechanism) {
  return std::any_of(mechanism.elements.begin(), mechanism.elements.end(), [](const auto& element) {
    return std::any_of(element.laws.begin(), element.laws.end(), is_powered);
  });
}

/// Failures as the parameters have them.
void put_failures(const Parameters& p, std::vector<LawFailure>& failures) {
  for (size_t k = 0; k < failures.size(); ++k) {
    const std::string name = "failure[" + std::to_string(k + 1) + "]";
    failures[k].active = p.failure_active[k] != 0;
    failures[k].onset.time = p.failure_numbers[2 * k];
    failures[k].value = p.failure_numbers[2 * k + 1];
    if (!(failures[k].onset.time >= 0.0) || !(failures[k].value >= 0.0)) {
      throw ModelError(name + " has a time or value below 0; both must be 0 or more");
    }
    if (failures[k].kind == LawFailure::Kind::kJammed && failures[k].value == 0.0) {
      throw ModelError(name + ".value is 0; the stiffness of a jammed element must be above 0");
    }
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
  put_settings(scene.solver, p);
  p.coupling_mode = scene.coupling_mode;
  p.coupling_expected_step = scene.experiment.step;
  p.hardware_numbers = get_hardware_numbers(scene);
  for (const Latch& latch : scene.latches.latch) {
    p.latch_overload.push_back(latch.law.releases_on_overload ? 1 : 0);
  }
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

/// Entries of the state vector, see StateLayout.
int count_states(const Scene& scene, const LoopPlan& plan) {
  const MechanismModel& m = scene.mechanism;
  int count = count_sums(m, scene.hard_dock, scene.forces) + 6 +
              count_element_bristles(m.elements, m.failures) + bristle_state_count(scene.contact);
  for (int i : plan.ind_bodies) count += m.bodies[i].nq() + m.bodies[i].nv();
  for (int i : {kChaser, kTarget}) {
    count += 2 * scene.parts[i].count_coordinates();
    const bool moves = scene.motion[i] != Motion::kFixed && (i == kChaser || scene.has_target);
    const bool is_recorded = scene.motion[i] == Motion::kRecorded;
    if (moves && !is_recorded) count += 7 + 6;
    if (moves && (is_recorded || scene.motion[i] == Motion::kDriven)) count += 6;
  }
  return count;
}

ListSizes find_list_sizes(const Scene& scene, const LoopPlan& plan, int state_count) {
  ListSizes sizes{};
  const auto put = [&](Per per, auto size) {
    sizes[static_cast<size_t>(per)] = static_cast<size_t>(size);
  };
  const int chaser_parts = scene.parts[kChaser].count_coordinates();
  put(scene.contact.rings ? Per::kPetal : Per::kSurfaceGroup, scene.contact.surfaces.size());
  put(Per::kLatch, scene.latches.count());
  put(Per::kHook, scene.hard_dock.hooks.count());
  put(Per::kVehicleForce, scene.forces.size());
  put(Per::kLeg, scene.mechanism.legs.size());
  put(Per::kElement, scene.mechanism.elements.size());
  put(Per::kPartCoordinate, chaser_parts + scene.parts[kTarget].count_coordinates());
  put(Per::kPosition, static_cast<int>(plan.ind_q.size()) + chaser_parts);
  put(Per::kVelocity, static_cast<int>(plan.ind_v.size()) + chaser_parts);
  put(Per::kLoop, scene.mechanism.loops.size());
  put(Per::kSequenceStep, scene.sequence.steps.size());
  put(Per::kState, state_count);
  return sizes;
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
  measured_error.reset();
  const Parameters start_parameters = find_start_parameters(*scene);
  const Inputs start_inputs = find_start_inputs(*scene);
  parameters = start_parameters;
  parameters_before = start_parameters;
  inputs = start_inputs;
  const LoopPlan plan = Mechanism(scene->mechanism).plan;
  check_joint_starts(*scene, plan);
  state_count = count_states(*scene, plan);
  list_sizes = find_list_sizes(*scene, plan, state_count);
  Outputs start_outputs;
  set_sizes<OutputValues<double>>(list_sizes, start_outputs);
  set_sizes<PointOutputs>(list_sizes, start_outputs);
  for (auto* list : {&start_outputs.vehicle_force, &start_outputs.vehicle_torque}) {
    for (Vec3<double>& load : *list) load.setZero();
  }
  for (Vec3<double>& force : start_outputs.loop_force) force.setZero();
  outputs = start_outputs;
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
  step_loop.reset();
  balances.reset();
  status_text.clear();
  warnings.clear();
  invalidate();
}

/// A law with the present friction and restitution.
ContactLaw DockingSim::Impl::make_contact_law(const ContactLaw& from) const {
  ContactLaw law = from;
  law.damping = scene->contact.law.damping;
  law.friction_coefficient = parameters.friction_coefficient;
  law.friction_model = parameters.friction_model;
  if (parameters.restitution != scene->restitution ||
      parameters.restitution_speed != scene->restitution_speed) {
    law.damping =
        find_damping_for_restitution(parameters.restitution, parameters.restitution_speed);
  }
  return law;
}

/// Hardware as the parameters have it.
void DockingSim::Impl::put_hardware(DockingModel& into) const {
  put_hardware_numbers(parameters.hardware_numbers, into);
  update_springs(into.mechanism.model);
  if (!into.contact.empty()) set_law(into.contact, make_contact_law(into.contact.law));
  check_absorber(into.contact.absorber);
  for (size_t i = 0; i < into.latches.latch.size(); ++i) {
    into.latches.latch[i].law.releases_on_overload = parameters.latch_overload[i] != 0;
  }
  check_latches(into.latches);
  check_hard_dock(into.hard_dock);
  check_vehicle_forces(into.forces);
}

void DockingSim::Impl::choose_frame_O() {
  frame_origin = find_frame_origin(*scene, parameters.vehicle);
  const bool drifts = scene->motion[kChaser] != Motion::kFixed &&
                      (!scene->has_target || scene->motion[kTarget] != Motion::kFixed);
  const VehicleParameters& p = parameters.vehicle[scene->has_target ? kTarget : kChaser];
  frame_velocity = drifts ? p.velocity : Vec3<double>(Vec3<double>::Zero());
  frame_shift.setZero();
}

/// Speed of P relative to A at the start, as the parameters state it; 0 without a target [m/s].
double DockingSim::Impl::find_approach_speed() const {
  if (!scene->has_target) return 0.0;
  const auto find_velocity = [this](int i) -> Vec3<double> {
    if (scene->motion[i] == Motion::kFixed) return Vec3<double>::Zero();
    const VehicleParameters& p = parameters.vehicle[i];
    return p.velocity + quat_to_matrix<double>(p.attitude.normalized()) *
                            p.angular_velocity.cross(p.interface_position);
  };
  return (find_velocity(kTarget) - find_velocity(kChaser)).norm();
}

/// Relative to O, which drifts: differences lose no digits between rows.
/// @param record  times are since the start
void DockingSim::Impl::put_record_into_O(InputHistory& record) const {
  const int rows = static_cast<int>(record.pose.size());
  for (int k = 0; k < rows; ++k) {
    const double time = record.time[static_cast<size_t>(k)];
    record.pose[static_cast<size_t>(k)].head<3>() -= frame_origin + time * frame_velocity;
    record.pose_rate[static_cast<size_t>(k)].head<3>() -= frame_velocity;
  }
  for (int k = 0; k + 1 < rows; ++k) {
    for (int end : {k, k + 1}) {
      const double time = record.time[static_cast<size_t>(end)];
      const auto motion = find_recorded_motion<double>(record, k, time);
      record.acceleration = std::max(record.acceleration, motion.a.norm());
      record.angular_acceleration = std::max(record.angular_acceleration, motion.alpha.norm());
    }
  }
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

/// Coordinates and rates of the parts of vehicles, as the scene states them.
void DockingSim::Impl::set_start_of_parts(double* y) const {
  const StateLayout& layout = model->layout;
  const MechanismModel& mechanism = model->mechanism.model;
  int force = static_cast<int>(mechanism.forces.size()) - mechanism.part_forces;
  scene->parts[kChaser].for_each([&](const VehiclePart& part) {
    for (const PartCoordinate& coordinate : part.coordinates) {
      const int body = mechanism.forces[force++].body;
      int q = layout.mechanism_q, v = layout.mechanism_v;
      for (int i : model->mechanism_bodies) {
        if (i == body) break;
        q += mechanism.bodies[i].nq();
        v += mechanism.bodies[i].nv();
      }
      y[q] = coordinate.start;
      y[v] = coordinate.rate;
    }
  });
  if (!model->target) return;
  const MechanismModel& target = model->target->model;
  force = 0;
  scene->parts[kTarget].for_each([&](const VehiclePart& part) {
    for (const PartCoordinate& coordinate : part.coordinates) {
      const int at = target.forces[force++].body - 1;  // after the vehicle
      y[layout.target_q + at] = coordinate.start;
      y[layout.target_v + at] = coordinate.rate;
    }
  });
}

/// What bounds of motion use of the body of a vehicle.
void DockingSim::Impl::note_body(int i, const VehicleBody& body) {
  least_inertia[i] = find_principal_moments(body.inertia)[0];
  share_without_modes[i] = find_share_without_modes(body, scene->parts[i]);
}

void DockingSim::Impl::set_start_state() {
  double* y = step_loop->y();
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
  set_start_of_parts(y);
  for (int i : {kChaser, kTarget}) {
    if (model->layout.pose[i] < 0) continue;
    const VehicleParameters& p = parameters.vehicle[i];
    set_vehicle_pose(*model, i, p.position - frame_origin - frame_shift, p.attitude, y);
    set_vehicle_velocity(*model, i, p.velocity - frame_velocity, p.angular_velocity, y, present());
  }
}

/// Fix the set-up from the present parameters and inputs, and start.
void DockingSim::Impl::initialise(double t0, double tolerance) {
  measured_error.reset();
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
  const std::array<int, 2> records = find_records(*scene);
  for (int i : {kChaser, kTarget}) {
    if (records[i] < 0) continue;
    const InputHistory& record = scene->inputs[static_cast<size_t>(records[i])];
    const auto start = find_recorded_motion<double>(record, find_row(record, t0), t0);
    VehicleParameters& p = parameters.vehicle[i];
    p.position = start.frame.p;
    p.velocity = start.frame.v;
    p.attitude = start.attitude;
    p.angular_velocity = start.frame.R.transpose() * start.frame.w;
  }
  check_parameters(parameters, *scene, fmi_kind, comparison != nullptr);
  try {
    // Many hosts pass on what the default experiment suggests: that is no wish of theirs.
    const bool is_suggested = tolerance == scene->experiment.tolerance;
    const double asked = parameters.accuracy != 0.0 && is_suggested ? 0.0 : tolerance;
    start(std::make_shared<const Setup>(Setup{parameters, t0, asked}));
    if (host->announces() && parameters.coupling_mode != kSequential)
      announce(parameters.coupling_expected_step);
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
  points = 1;
  read_points = 0;
  Parameters wanted = parameters;
  if (fmi_kind == FmiKind::kModelExchange) wanted.accuracy = 0.0;  // the host integrates
  choose_frame_O();
  const auto made = std::make_shared<DockingModel>(
      make_docking_model(*scene, parameters.vehicle, make_contact_law(scene->contact.law),
                         frame_origin, parameters.model_level));
  put_hardware(*made);
  made->thrust = parameters.contact_thrust;
  made->thrust_delay = parameters.contact_thrust_delay;
  // In model exchange frame O must be a function of time alone: O then drifts and does not fall.
  if (fmi_kind == FmiKind::kModelExchange) made->falling = false;
  put_element_numbers(parameters.element_numbers, made->mechanism.model.elements);
  check_elements(made->mechanism.model.elements);
  put_failures(parameters, made->mechanism.model.failures);
  put_disturbances(parameters, made->disturbances);
  for (InputHistory& history : made->inputs) {
    for (double& time : history.time) time -= setup->t_start;
    put_record_into_O(history);
  }
  model = made;
  chosen = choose_solver(wanted, setup->tolerance, *model, find_approach_speed());
  discrete.hard_dock = make_start(model->hard_dock);
  step_loop.reset();  // it refers to the equations
  equations = comparison ? comparison->make_equations(*this) : nullptr;
  if (equations && !equations->is_reference() && model->has_record()) {
    throw ModelError(
        "the equations with multipliers know no vehicle with a record: set model.level = 3 "
        "(reduced)");
  }
  events = std::make_unique<EventLogic>(*model, discrete, memory);
  start_mechanism.reset();
  state_bodies = model->mechanism_bodies;
  loads.start(count_commands(model->mechanism.model));
  evaluator = std::make_unique<Evaluator>(model, *this, loads);
  host = std::make_unique<HostCoupling>(*model, setup, scene->parts, frame_origin, inputs, loads,
                                        *events, *evaluator, *this, warnings);
  quiescent_mode =
      std::make_unique<QuiescentMode>(*model, *this, chosen, find_relative_tolerance(),
                                      can_be_quiescent(), can_drift(), loads, *events, *evaluator);
  derivative_pass.reset();
  jump_work.reset();
  look_ahead_start.reset();
  if (host->has_host()) jump_work = std::make_unique<BaseJumpWorkspace>(*model);
  if (host->announces()) look_ahead_start = std::make_unique<Snapshot>();
  make_loop();
  discrete.input_row.assign(model->inputs.size(), -1);
  table_inputs = inputs;
  events->update_inputs(0.0, find_clock_rounding(0.0));
  read_inputs();
  events->clear_due();
  for (int i : {kChaser, kTarget}) {
    note_body(i, model->of_host[i]);
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
    check_mechanism_rests(*model, present());
    quiescent_mode->lock_always();
    if (!evaluate(0.0).ok()) throw ModelError("start state cannot be evaluated");
  }
  if (chosen.needs_step) chosen.step = find_real_time_step(step_loop->method().is_structured);
  inner_step = chosen.step;
  check_inner_step();
  if (parameters.accuracy != 0.0) {
    choice_text = fmi_kind == FmiKind::kModelExchange
                      ? "accuracy has no effect for model exchange: the host integrates"
                      : describe_choice(parameters, chosen, *step_loop->method().facts,
                                        setup->tolerance, *model);
  } else if (fmi_kind == FmiKind::kCoSimulation && !step_loop->method().is_fixed_step()) {
    choice_text = describe_forgotten(parameters);
  }
  start_energy_audit(*model, present(), step_loop->y(), energy_audit);
  start_momentum_audit(*model, present(), least_momentum, momentum_audit);
  attach_kernel();
  warn_about_start();
  if (model->present[kTarget]) {
    check_vehicle_forces(model->forces, &present().across);
    // Faces of a docked pair are compressed by much less.
    constexpr double kDeepest = 1e-3;  // [m]
    const double depth = find_face_depth(model->hard_dock, present().across);
    if (depth > kDeepest) {
      throw ModelError("start state: the mating faces of A and P are " +
                       describe_number(1e3 * depth) + " mm in each other (limit " +
                       describe_number(1e3 * kDeepest) +
                       " mm); start with the target further along +x of A, or set 'capture' of the "
                       "mechanism to the body that meets the target first");
    }
  }
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
    const double gap = find_gap(model->contact, memory, present().relative, present().contact_work);
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
  peaks.start(0.0, find_peak_values(), find_sequence_step());
  quiescent_mode->start(step_loop->y());
  host->start();
  step_loop->start();
  discrete_inside = discrete;
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
  sequence.enter(model->sequence.start, 0, {present(), 0.0, step_loop->y() + model->layout.sums});
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
         !find_method(chosen.method)->fixed_step && !host->has_host() && !model->has_record() &&
         !(equations && equations->is_reference());
}

/// Can the mechanism become quiescent in this run?
bool DockingSim::Impl::can_be_quiescent() const {
  return can_drift() && !model->target && !model->mechanism.plan.is_driven &&
         (!model->sequence.empty() || !acts_by_itself(model->mechanism.model));
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
  for (std::string& said : list_doubtful_inertias(scene->mechanism)) {
    warnings.push_back(std::move(said));
  }
  if (const Misplacement found = find_misplacement(*scene, parameters.vehicle);
      !found.names.empty()) {
    const std::string off =
        std::isfinite(found.distance)
            ? describe_number(1e3 * found.distance) + " mm from where they meet as [initial] states"
            : "and meet nowhere as [initial] states";
    warnings.push_back(found.names +
                       ": the vehicles start where the scene has placed them for other values, " +
                       off + "; set it in the scene");
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
