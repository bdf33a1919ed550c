// The facade: start, communication steps with events inside, refusal without loss, audits.
// What is read out afterwards is computed in sim/outputs.cpp.
#include "sim/docking_sim.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr int kMaxRefused = 12;         ///< end states in a row that cannot be evaluated
constexpr int kMaxInnerSteps = 100000;  ///< per communication step
constexpr double kTouching = 1e-9;      ///< gap that counts as contact at the start [m]

std::string describe(const Status& status, const MechanismModel& mechanism) {
  char text[240];
  const auto loop = [&]() {
    return status.index >= 0 ? mechanism.loops[status.index].name : std::string("?");
  };
  switch (status.code) {
    case StatusCode::kOk:
      return "ok";
    case StatusCode::kOutOfReach:
      std::snprintf(text, sizeof text, "loop '%s' is out of reach (margin %.3g)", loop().c_str(),
                    status.margin);
      break;
    case StatusCode::kLoopSingular:
      std::snprintf(text, sizeof text, "loop '%s' is singular (margin %.3g, limit %.1g)",
                    loop().c_str(), status.margin, mechanism.singularity.error);
      break;
    case StatusCode::kBranchChanged:
      std::snprintf(text, sizeof text, "loop '%s' has left its assembly branch", loop().c_str());
      break;
    case StatusCode::kLoopNotClosed:
      std::snprintf(text, sizeof text, "loop '%s' cannot be closed by Newton iteration",
                    loop().c_str());
      break;
    case StatusCode::kRedundancyLost:
      std::snprintf(text, sizeof text,
                    "an equation of loop '%s' that follows from others at home is violated (by "
                    "%.3g): its parts do not fit together here",
                    loop().c_str(), status.margin);
      break;
    case StatusCode::kInertiaNotPositive:
      std::snprintf(text, sizeof text, "the reduced inertia is not positive definite");
      break;
    case StatusCode::kContactTooDeep:
      std::snprintf(text, sizeof text,
                    "contact pair %d is %.2f of its rounding deep (limit 0.98): too fast for the "
                    "contact stiffness, or placed inside a surface",
                    status.index + 1, status.margin);
      break;
    case StatusCode::kContactFlipped:
      std::snprintf(text, sizeof text, "contact pair %d would be passed through", status.index + 1);
      break;
    case StatusCode::kIntegrationFailed:
      std::snprintf(text, sizeof text, "the integrator cannot meet its tolerance");
      break;
    case StatusCode::kBadInput:
      std::snprintf(text, sizeof text, "an input is impossible");
      break;
    case StatusCode::kNotFinite:
      std::snprintf(text, sizeof text, "a value is not finite");
      break;
  }
  if (status.time > 0.0) {
    const size_t used = std::strlen(text);
    std::snprintf(text + used, sizeof text - used, " at t = %.9g s", status.time);
  }
  return text;
}

void check_quaternion(const Vec4<double>& q, const std::string& name) {
  if (!(std::abs(q.norm() - 1.0) < 1e-3)) {
    throw ModelError(name + " must be a unit quaternion (w, x, y, z); its norm is " +
                     std::to_string(q.norm()));
  }
}

void check_vehicle(const VehicleParameters& p, const std::string& name) {
  if (!(p.mass > 0.0)) {
    throw ModelError(name + ".mass is " + std::to_string(p.mass) + " kg; it must be above 0");
  }
  const Eigen::LLT<Mat3<double>> positive(make_symmetric(p.inertia));
  if (positive.info() != Eigen::Success) {
    std::string values;
    for (int i = 0; i < 6; ++i) values += " " + std::to_string(p.inertia[i]);
    throw ModelError(name + ".inertia (xx yy zz xy xz yz) is" + values +
                     "; it must be positive definite");
  }
  if (p.mass_includes_mechanism != 1 && p.mass_includes_mechanism != 2) {
    throw ModelError(name + ".mass_includes_mechanism must be 1 (excluded) or 2 (included)");
  }
  check_quaternion(p.interface_attitude, name + ".interface_attitude");
  check_quaternion(p.attitude, name + ".attitude");
}

}  // namespace

DockingSim::DockingSim(std::shared_ptr<const Scene> scene) : impl_(new Impl(std::move(scene))) {}
DockingSim::~DockingSim() = default;
const Scene& DockingSim::scene() const { return *impl_->scene; }
Parameters& DockingSim::parameters() { return impl_->parameters; }
Inputs& DockingSim::inputs() { return impl_->inputs; }
const std::string& DockingSim::status_text() const { return impl_->status_text; }
Outputs& DockingSim::output_storage() { return impl_->outputs; }
void DockingSim::invalidate_outputs() { impl_->outputs_valid = false; }

std::vector<std::string> DockingSim::take_warnings() {
  std::vector<std::string> taken;
  taken.swap(impl_->warnings);
  return taken;
}

const Outputs& DockingSim::outputs() {
  if (!impl_->outputs_valid && impl_->model) impl_->update_outputs();
  return impl_->outputs;
}

void DockingSim::reset() {
  // Storage must stay where it is: the variable table points into it.
  impl_->clear();
}

DockingSim::Impl::Impl(std::shared_ptr<const Scene> s) : scene(std::move(s)) { clear(); }

void DockingSim::Impl::clear() {
  parameters.vehicle = scene->vehicle;
  parameters.contact_thrust = scene->contact_thrust;
  parameters.contact_thrust_delay = scene->contact_thrust_delay;
  parameters.friction_coefficient = scene->contact.law.friction_coefficient;
  parameters.friction_model = scene->contact.law.friction_model;
  parameters.restitution = scene->restitution;
  parameters.restitution_speed = scene->restitution_speed;
  parameters.solver_method = 1;
  parameters.rtol = scene->solver.rtol;
  parameters.atol_position = scene->solver.atol_position;
  parameters.atol_velocity = scene->solver.atol_velocity;
  parameters.atol_energy = scene->solver.atol_energy;
  const MechanismModel& m = scene->mechanism;
  const auto zero = [](std::vector<double>& v, size_t n) { v.assign(n, 0.0); };
  for (int i : {kChaser, kTarget}) {
    inputs.vehicle[i] = Inputs::Vehicle();
    inputs.vehicle[i].position = scene->vehicle[i].position;
    inputs.vehicle[i].velocity = scene->vehicle[i].velocity;
    inputs.vehicle[i].attitude = scene->vehicle[i].attitude;
    inputs.vehicle[i].angular_velocity = scene->vehicle[i].angular_velocity;
    outputs.vehicle[i] = Outputs::Vehicle();
  }
  inputs.gravity.setZero();
  zero(inputs.leg_force_command, m.legs.size());
  zero(outputs.petal_force, static_cast<size_t>(scene->contact.petal_count()));
  zero(outputs.latch_opening, static_cast<size_t>(scene->latches.count()));
  zero(outputs.latch_force, static_cast<size_t>(scene->latches.count()));
  outputs.latched.assign(static_cast<size_t>(scene->latches.count()), 0);
  for (auto* v : {&outputs.leg_length, &outputs.leg_rate, &outputs.leg_force})
    zero(*v, m.legs.size());
  const LoopPlan plan = Mechanism(m).plan;
  check_joint_starts(plan);
  zero(outputs.state_q, plan.ind_q.size());
  zero(outputs.state_v, plan.ind_v.size());
  zero(outputs.state_a, plan.ind_v.size());
  outputs.loop_force.assign(m.loops.size(), Vec3<double>::Zero());
  model.reset();
  data.reset();
  stepper.reset();
  discrete = DiscreteState();
  memory = ContactMemory();
  status_text.clear();
  warnings.clear();
  outputs_valid = false;
}

void DockingSim::initialise(double t0, double tolerance) { impl_->initialise(t0, tolerance); }

void DockingSim::Impl::check_parameters() const {
  const Parameters& p = parameters;
  check_vehicle(p.vehicle[kChaser], "chaser");
  if (scene->has_target) check_vehicle(p.vehicle[kTarget], "target");
  const auto positive = [](double value, const char* name) {
    if (!(value > 0.0)) {
      throw ModelError(std::string(name) + " is " + std::to_string(value) + "; it must be above 0");
    }
  };
  positive(p.rtol, "solver.rtol");
  positive(p.atol_position, "solver.atol_position");
  positive(p.atol_velocity, "solver.atol_velocity");
  positive(p.atol_energy, "solver.atol_energy");
  if (p.solver_method != 1 && p.solver_method != 2) {
    throw ModelError("solver.method is " + std::to_string(p.solver_method) +
                     "; it must be 1 (auto) or 2 (explicit)");
  }
  if (!(p.contact_thrust_delay >= 0.0)) {
    throw ModelError("chaser.contact_thrust_delay must be 0 s or more");
  }
}

/// Only single joints that no loop determines can be told where to start.
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
                     (choice.empty() ? "; no joint of this mechanism can be given a start"
                                     : "; joints that can be given a start are " + choice));
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
  // Origin near the docking interface of the target (else at the chaser). Whole metres from the
  // vehicle's position, so that the differences below are exact even at orbital distances.
  const int anchor = scene->has_target ? kTarget : kChaser;
  const VehicleParameters& p = parameters.vehicle[anchor];
  Vec3<double> offset = Vec3<double>::Zero();
  if (scene->has_target) offset = quat_to_matrix<double>(p.attitude) * p.interface_position;
  frame_origin = p.position + Vec3<double>(offset.array().round());
  const bool drifts = scene->motion[kChaser] != Motion::kFixed &&
                      (!scene->has_target || scene->motion[kTarget] != Motion::kFixed);
  frame_velocity = drifts ? p.velocity : Vec3<double>(Vec3<double>::Zero());
  frame_shift.setZero();
}

/// Close the loops at the start of the joints, coming from home in small steps: a loop is closed on
/// the assembly branch it comes from.
Status DockingSim::Impl::bring_joints_to_start() {
  if (scene->joint_starts.empty()) return {};
  const MechanismModel& m = model->mechanism.model;
  VecX<double> target = data->mechanism.tree.q;
  for (const JointStart& start : scene->joint_starts) {
    const int q = m.bodies[find_body(m, start.name, "initial.joints")].q_index;
    target[q] = start.position.value_or(m.home_q[q]);
  }
  return move_to(model->mechanism, target, data->mechanism);
}

void DockingSim::Impl::set_start_state() {
  double* y = stepper->y();
  const StateLayout& layout = model->layout;
  std::fill(y, y + layout.size, 0.0);
  // Mechanism at home, the capture body and single joints possibly displaced from it.
  int q = layout.mechanism_q, v = layout.mechanism_v;
  for (int i : model->mechanism_bodies) {
    const Body& body = model->mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) y[q + j] = model->mechanism.model.home_q[body.q_index + j];
    if (i == model->mechanism.model.capture_body && body.joint == JointType::kFree) {
      // The start is stated in axes of B; the free joint counts in axes of its placement.
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
    put_pose(i, p.position, p.attitude);
    put_velocity(i, p.velocity, p.angular_velocity);
  }
}

void DockingSim::Impl::put_pose(int i, const Vec3<double>& position, const Vec4<double>& attitude) {
  double* at = stepper->y() + model->layout.pose[i];
  const Vec3<double> x = position - frame_origin - frame_shift;
  const double norm = attitude.norm();
  for (int j = 0; j < 3; ++j) at[j] = x[j];
  for (int j = 0; j < 4; ++j) at[3 + j] = attitude[j] / norm;
}

Status DockingSim::Impl::put_velocity(int i, const Vec3<double>& velocity,
                                      const Vec3<double>& angular_velocity) {
  return set_vehicle_velocity(*model, i, velocity - frame_velocity, angular_velocity, stepper->y(),
                              *data);
}

void DockingSim::Impl::initialise(double t0, double tolerance) {
  check_parameters();
  warnings.clear();
  // A driven vehicle starts where its inputs are.
  for (int i : {kChaser, kTarget}) {
    if (scene->motion[i] != Motion::kDriven) continue;
    VehicleParameters& p = parameters.vehicle[i];
    const Inputs::Vehicle& in = inputs.vehicle[i];
    check_quaternion(in.attitude, i == kChaser ? "chaser.attitude" : "target.attitude");
    p.position = in.position;
    p.velocity = in.velocity;
    p.attitude = in.attitude;
    p.angular_velocity = in.angular_velocity;
  }
  choose_frame_O();
  model = std::make_unique<DockingModel>(
      make_docking_model(*scene, parameters.vehicle, make_contact_law(), frame_origin));
  state_bodies = model->mechanism_bodies;
  model->thrust = parameters.contact_thrust;
  model->thrust_delay = parameters.contact_thrust_delay;
  data = std::make_unique<DockingData<double>>(*model);
  rate_data = std::make_unique<DockingData<double>>(*model);
  make_stepper(tolerance);
  discrete = DiscreteState();
  memory = ContactMemory();
  loads.command.setZero(static_cast<int>(model->mechanism.model.forces.size()));
  read_inputs();
  t_start = t0;
  elapsed = 0.0;
  h_warm = 0.0;
  warned_margin = false;
  margin_looked_at = kChangeMargin;
  std::fill(due.begin(), due.end(), char(0));
  host_work = 0.0;
  momentum_residual = 0.0;
  // At rest the scale is what the tolerance lets a vehicle move.
  momentum_scale = parameters.atol_velocity * parameters.vehicle[kChaser].mass;
  angular_momentum_scale = 0.0;
  mean_load = {};

  Status status = bring_joints_to_start();
  if (status.ok()) {
    set_start_state();
    status = evaluate(0.0);
  }
  if (!status.ok()) throw ModelError("start state: " + describe(status, model->mechanism.model));
  keep_pose();
  energy_start = find_total_energy();
  for (int i : {kChaser, kTarget}) momentum_start[i] = find_momentum(*model, i, *data);
  warn_about_start();
  if (has_surfaces()) {
    update_contact_memory(model->contact, data->relative, bristles(), data->contact_work, memory);
    const double gap = find_gap(model->contact, data->relative, data->contact_work);
    // A start that touches is a first contact at the start; so is one within reach of a latch.
    if (gap <= kTouching) begin_contact(0.0);
  }
  if (update_latches(0.0) && !evaluate(0.0).ok())
    throw ModelError("start state cannot be evaluated");
  update_capture(0.0);
  memory_before = memory;
  memory_before.gap.reserve(static_cast<size_t>(model->contact.pair_count()));
  memory_before.near.reserve(static_cast<size_t>(model->contact.pair_count()));
  update_phase(find_phase_inputs(), discrete);
  peaks.start(0.0, find_peak_values());
  for (int i : {kChaser, kTarget}) vehicle_before[i] = find_vehicle_state(i);
  last_step = 0.0;
  outputs_valid = false;
}

void DockingSim::Impl::make_stepper(double tolerance) {
  const StateLayout& layout = model->layout;
  const double rtol = tolerance > 0.0 ? std::min(tolerance, parameters.rtol) : parameters.rtol;
  ErkStepper::Problem problem;
  problem.size = layout.size;
  problem.root_count = kFixedRoots + model->latches.count();
  problem.rates = [this](double t, const double* y, double* ydot) {
    const Status status =
        calc_docking<double>(*model, discrete, memory, loads, elapsed + t, y, ydot, *rate_data);
    if (!status.ok()) {
      last_trouble = status;
      last_trouble.time = elapsed + t;
      return status.code == StatusCode::kLoopSingular ? ErkStepper::kStepOver
                                                      : ErkStepper::kSmaller;
    }
    double sum = 0.0;
    for (int i = 0; i < model->layout.size; ++i) sum += ydot[i];
    if (!std::isfinite(sum)) {
      last_trouble = {StatusCode::kNotFinite, -1, 0.0, elapsed + t};
      return ErkStepper::kSmaller;
    }
    return 0;
  };
  problem.roots = [this](double t, const double* y, double* roots) {
    const Status status =
        calc_docking<double>(*model, discrete, memory, loads, elapsed + t, y, nullptr, *rate_data);
    if (!status.ok()) {
      last_trouble = status;
      return 1;
    }
    calc_event_functions(*rate_data, roots);
    return 0;
  };
  stepper = std::make_unique<ErkStepper>(std::move(problem));

  // Absolute tolerances by kind; momenta are velocities times mass or inertia. The norm is a mean
  // over components, so bristles at rest must not loosen it.
  std::vector<double> atol(static_cast<size_t>(layout.size), parameters.atol_position);
  std::fill_n(atol.begin() + layout.mechanism_v, layout.mechanism_nv, parameters.atol_velocity);
  for (int i : {kChaser, kTarget}) {
    if (layout.momentum[i] < 0) continue;
    const VehicleParameters& p = parameters.vehicle[i];
    const double lever2 = p.interface_position.squaredNorm();
    const double inertia = p.inertia.head<3>().maxCoeff() + p.mass * lever2;
    std::fill_n(atol.begin() + layout.momentum[i], 3, parameters.atol_velocity * p.mass);
    std::fill_n(atol.begin() + layout.momentum[i] + 3, 3, parameters.atol_velocity * inertia);
    if (i == kChaser) {
      std::fill_n(atol.begin() + layout.impulse, 3, parameters.atol_velocity * p.mass);
      std::fill_n(atol.begin() + layout.impulse + 3, 3, parameters.atol_velocity * inertia);
    }
  }
  std::fill_n(atol.begin() + layout.sums, static_cast<int>(kSumCount), parameters.atol_energy);
  const double share = static_cast<double>(layout.size - layout.bristle_count) / layout.size;
  for (double& value : atol) value *= std::sqrt(share);
  stepper->set_tolerances(rtol * std::sqrt(share), atol.data());
  y_before.assign(static_cast<size_t>(layout.size), 0.0);
  y_accepted = y_before;
}

void DockingSim::Impl::warn_about_start() {
  const double margin = find_singularity_margin(data->mechanism);
  char text[300];
  if (margin < model->mechanism.model.singularity.warning) {
    std::snprintf(text, sizeof text, "a loop starts close to singular (margin %.3g)", margin);
    warnings.push_back(text);
  }
  if (!scene->mechanism.gravity.isZero(0.0)) {
    warnings.push_back(
        "gravity in the mechanism file is used by 'dockloop check' only; connect the "
        "input 'gravity'");
  }
  if (!has_surfaces() || model->contact.kind != ContactModel::Kind::kRings) return;
  // k >= 4 m v^2/rounding^2 for what hits: the capture body on its legs.
  const int body = model->mechanism.model.capture_body;
  const double mass = body == kBase ? 0.0 : model->mechanism.model.bodies[body].mass;
  const double v = data->relative.v.norm();
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

void DockingSim::Impl::read_inputs() {
  for (int i : {kChaser, kTarget}) {
    loads.force[i] = inputs.vehicle[i].force_ext;
    loads.torque[i] = inputs.vehicle[i].torque_ext;
  }
  loads.gravity = inputs.gravity;
  for (size_t i = 0; i < scene->mechanism.legs.size(); ++i) {
    loads.command[scene->mechanism.legs[i].force] = inputs.leg_force_command[i];
  }
}

Status DockingSim::Impl::receive_driven_vehicles() {
  const bool any = (scene->motion[kChaser] == Motion::kDriven) ||
                   (scene->has_target && scene->motion[kTarget] == Motion::kDriven);
  if (!any) return {};
  Status status = evaluate(0.0);
  if (!status.ok()) return status;
  const double energy_before = find_total_energy();
  Wrench<double> before[2];
  for (int i : {kChaser, kTarget}) before[i] = find_momentum(*model, i, *data);
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || scene->motion[i] != Motion::kDriven) continue;
    const Inputs::Vehicle& in = inputs.vehicle[i];
    if (!(std::abs(in.attitude.norm() - 1.0) < 1e-3)) {
      char text[160];
      std::snprintf(text, sizeof text,
                    "%s.attitude must be a unit quaternion (w, x, y, z); its norm is %.6g",
                    i == kChaser ? "chaser" : "target", in.attitude.norm());
      status_text = text;
      return {StatusCode::kBadInput, -1, in.attitude.norm(), elapsed};
    }
    put_pose(i, in.position, in.attitude);
    status = put_velocity(i, in.velocity, in.angular_velocity);
    if (!status.ok()) return status;
  }
  status = evaluate(0.0);
  if (!status.ok()) return status;
  // The jump may begin a contact, and its forces count as peaks.
  update_memory();
  if (has_surfaces() && !discrete.contacted && data->contact.gap <= 0.0) begin_contact(elapsed);
  peaks.begin(elapsed, find_peak_values());
  // What the host did to the motion is its work and impulse, not an error of the integration.
  host_work += find_total_energy() - energy_before;
  for (int i : {kChaser, kTarget}) {
    const Wrench<double> now = find_momentum(*model, i, *data);
    momentum_start[i].f += now.f - before[i].f;
    momentum_start[i].t += now.t - before[i].t;
  }
  return {};
}

Status DockingSim::step(double t, double h) {
  Impl& me = *impl_;
  me.status_text.clear();
  // Keep what a refusal must restore.
  std::copy(me.stepper->y(), me.stepper->y() + me.model->layout.size, me.y_before.begin());
  me.discrete_before = me.discrete;
  me.peaks_before = me.peaks;
  me.memory_before = me.memory;
  me.reference_before = me.data->mechanism.loops.reference;
  me.coordinates_before.reset();
  const double host_work = me.host_work, elapsed = me.elapsed;
  const double margin_looked_at = me.margin_looked_at;
  const auto momentum_start = me.momentum_start;
  me.elapsed = t - me.t_start;
  me.read_inputs();
  Status status;
  if (h > 0.0) {
    status = me.receive_driven_vehicles();
    if (status.ok()) status = me.integrate(h);
  } else {
    me.status_text = "the step must be longer than 0 s";
    status.code = StatusCode::kBadInput;
  }
  if (!status.ok()) {
    if (me.coordinates_before) me.use_coordinates(*me.coordinates_before);
    me.data->mechanism.loops.reference = me.reference_before;
    me.rate_data->mechanism.loops.reference = me.reference_before;
    std::copy(me.y_before.begin(), me.y_before.end(), me.stepper->y());
    me.discrete = me.discrete_before;
    me.peaks = me.peaks_before;
    me.host_work = host_work;
    me.margin_looked_at = margin_looked_at;
    me.elapsed = elapsed;
    me.momentum_start = momentum_start;
    me.memory = me.memory_before;
    // Outputs read after a refusal are those of before; the state was a valid one.
    if (!me.evaluate(0.0).ok()) status.code = StatusCode::kNotFinite;
    char text[120];
    std::snprintf(text, sizeof text, "step from t = %.9g s over %.6g s: ", t, h);
    if (me.status_text.empty()) me.status_text = describe(status, me.model->mechanism.model);
    me.status_text = text + me.status_text;
    return status;
  }
  me.finish_step(t, h);
  return status;
}

/// Advance by h from the present state, through events. On failure the state is undefined.
Status DockingSim::Impl::integrate(double h) {
  Status status = evaluate(0.0);
  if (!status.ok()) return status;
  for (int i : {kChaser, kTarget}) vehicle_before[i] = find_vehicle_state(i);
  std::copy(stepper->y(), stepper->y() + model->layout.size, y_accepted.begin());
  margin_before = find_singularity_margin(data->mechanism);
  double tau = 0.0;
  int refused = 0;           // end states in a row that could not be evaluated
  double proposal = h_warm;  // step size that error control asks for; stops do not count
  stepper->restart(0.0, std::min(proposal, h));
  for (int inner = 0; inner < kMaxInnerSteps; ++inner) {
    const double stop = find_next_stop(tau, h);
    last_trouble = Status();
    const StepOutcome outcome = stepper->step(stop, true);
    if (outcome == StepOutcome::kFailed) return find_trouble(tau);
    bool restart = false;
    const double made = stepper->time() - tau;
    if (outcome == StepOutcome::kRoot) {
      status = step_to_root(tau);
      if (!status.ok()) return status;
      restart = true;
    } else {
      std::fill(due.begin(), due.end(), char(0));
      const bool cut_short = outcome == StepOutcome::kStopped && made < proposal;
      proposal = cut_short ? std::max(proposal, stepper->next_step()) : stepper->next_step();
    }
    status = evaluate(stepper->time());
    if (!status.ok()) {
      // Error control was content with a state that cannot be evaluated: take smaller steps to it.
      if (++refused > kMaxRefused) return status;
      std::copy(y_accepted.begin(), y_accepted.end(), stepper->y());
      proposal = 0.25 * made;
      stepper->restart(tau, proposal);
      continue;
    }
    refused = 0;
    tau = stepper->time();
    status = accept(tau, restart);
    if (!status.ok()) return status;
    std::copy(stepper->y(), stepper->y() + model->layout.size, y_accepted.begin());
    if (tau >= h) {
      h_warm = proposal;
      return {};
    }
    const double leap = find_leap(made, proposal);
    if (leap > 0.0) {
      stepper->restart(tau, std::min(leap, h - tau));
    } else if (restart) {
      stepper->restart(tau, std::min(proposal, h - tau));
    }
  }
  if (!last_trouble.ok()) return last_trouble;  // what the last steps had to get around
  status_text =
      "it needs more than " + std::to_string(kMaxInnerSteps) +
      " inner steps: contact far too fast or too stiff; shorten the step or check the speeds";
  return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed + tau};
}

/// A mechanism on its way through a pose where its loops lose rank is fine on both sides of it, but
/// cannot be evaluated on it: size of a step that has no stage there, or one that ends where such a
/// step can begin. @param made, proposal  last step, size that error control asks for
/// @return 0 if there is nothing to leap over
double DockingSim::Impl::find_leap(double made, double proposal) {
  const double margin = find_singularity_margin(data->mechanism);
  const double rate = (margin_before - margin) / made;
  margin_before = margin;
  if (!(rate > 0.0) || margin > 3.0 * kChangeMargin) return 0.0;
  const double way = margin / rate;  // to the pose, if the margin goes on like this
  const double width = model->mechanism.model.singularity.error / rate;
  if (way - width > 1.3 * proposal) return 0.0;
  // Stages lie at 0.2, 0.3, 0.8, 0.89 and 1 of a step: put the pose into the middle of the largest
  // gap. If that asks for a longer step than error control likes, end half a step before the pose.
  const double leap = way / 0.55;
  return leap <= 1.6 * proposal ? leap : way - 0.5 * proposal;
}

/// Where the next inner step must end at the latest: the end of the communication step, the onset
/// of thrust, and never so far that a surface could be passed unseen.
double DockingSim::Impl::find_next_stop(double tau, double h) const {
  double stop = h;
  if (model->thrust != 0.0 && discrete.contacted && !discrete.captured && !discrete.thrust_on) {
    const double onset = discrete.time_of_contact + model->thrust_delay - elapsed;
    if (onset > tau) stop = std::min(stop, onset);
  }
  if (has_surfaces() && model->contact.kind == ContactModel::Kind::kRings) {
    const double bound = find_step_bound(model->contact, data->contact.gap, data->relative);
    if (tau + bound < stop) stop = tau + bound;
  }
  return stop;
}

Status DockingSim::Impl::find_trouble(double tau) const {
  if (!last_trouble.ok()) return last_trouble;
  return {StatusCode::kIntegrationFailed, -1, 0.0, elapsed + tau};
}

/// A root lies in the step just made: replace its interpolated state by steps that end there.
Status DockingSim::Impl::step_to_root(double tau) {
  const double root = stepper->time();
  for (int i = 0; i < kFixedRoots + model->latches.count(); ++i) due[i] = stepper->root_found(i);
  std::copy(y_accepted.begin(), y_accepted.end(), stepper->y());
  if (!(root > tau)) return {};
  stepper->restart(tau, root - tau);
  for (int inner = 0; inner < kMaxInnerSteps; ++inner) {
    const StepOutcome outcome = stepper->step(root, false);
    if (outcome == StepOutcome::kFailed) return find_trouble(tau);
    if (outcome == StepOutcome::kStopped) return {};
  }
  return find_trouble(tau);
}

/// Everything that happens once per accepted inner step. @pre evaluate(tau)
/// @param changed  set if the state or the
/// equations changed, so that the integrator must start again.
Status DockingSim::Impl::accept(double tau, bool& changed) {
  const Status moved = update_coordinates(tau, changed);
  if (!moved.ok()) return moved;
  keep_pose();
  if (update_memory()) changed = true;
  bool jumped = false;
  const double now = elapsed + tau;
  if (!discrete.contacted && has_surfaces() && (due[0] || data->contact.gap <= 0.0)) {
    begin_contact(now);
    jumped = true;
  }
  if (due[0] || due[1]) jumped = true;
  if (update_latches(now)) jumped = true;
  update_capture(now);
  if (update_thrust(now)) jumped = true;
  changed = changed || jumped;
  update_phase(find_phase_inputs(), discrete);
  // Peaks see the forces on both sides of a jump.
  if (jumped) {
    peaks.add(now, find_peak_values());
    const Status after = evaluate(tau);
    if (!after.ok()) return after;
    peaks.begin(now, find_peak_values());
  } else {
    peaks.add(now, find_peak_values());
  }
  return {};
}

/// The present pose of the mechanism is accepted: the next ones continue from it.
void DockingSim::Impl::keep_pose() {
  keep_reference(data->mechanism.tree, data->mechanism.loops);
  rate_data->mechanism.loops.reference = data->mechanism.loops.reference;
}

/// Near a pose where the independent coordinates stop being independent, go over to others. All
/// coordinates and velocities stay as they are, so momentum and energy do too.
/// @param changed  set if the meaning of the state changed
Status DockingSim::Impl::update_coordinates(double tau, bool& changed) {
  const double margin = find_singularity_margin(data->mechanism);
  if (margin < model->mechanism.model.singularity.warning && !warned_margin) {
    char text[120];
    std::snprintf(text, sizeof text, "a loop is close to singular (margin %.3g) at t = %.9g s",
                  margin, elapsed + tau);
    warnings.push_back(text);
    warned_margin = true;
  }
  if (margin >= kChangeMargin) {
    margin_looked_at = kChangeMargin;
    return {};
  }
  // The search is dear: look again only where things got much worse.
  if (margin > 0.7 * margin_looked_at) return {};
  margin_looked_at = margin;
  std::optional<Mechanism> better = find_better_coordinates(model->mechanism, data->mechanism);
  if (!better) return {};
  const VecX<double> q = data->mechanism.tree.q, v = data->mechanism.tree.v;
  if (!coordinates_before) coordinates_before = std::make_unique<Mechanism>(model->mechanism);
  use_coordinates(*better);
  TreeData<double>& tree = data->mechanism.tree;
  tree.q = q;
  tree.v = v;
  get_mechanism_state(*model, tree, stepper->y());
  changed = true;
  return evaluate(tau);
}

/// Take over a mechanism that differs from the present one in its independent coordinates only.
void DockingSim::Impl::use_coordinates(const Mechanism& mechanism) {
  set_mechanism(*model, mechanism);
  data->mechanism = MechanismData<double>(model->mechanism);
  rate_data->mechanism = MechanismData<double>(model->mechanism);
}

/// Bring the contact memory up to the present state and book the energy of bristles that it drops.
/// @return true if the state changed by that
bool DockingSim::Impl::update_memory() {
  if (!has_surfaces()) return false;
  const double dropped =
      update_contact_memory(model->contact, data->relative, bristles(), data->contact_work, memory);
  stepper->y()[model->layout.sums + kSumFriction] += dropped;
  return dropped > 0.0;
}

/// Change the mode of every latch that is due, by a root or because it starts there.
bool DockingSim::Impl::update_latches(double now) {
  bool changed = false;
  for (int i = 0; i < model->latches.count(); ++i) {
    if (!due[kFixedRoots + i] && data->latch.event[i] > 0.0) continue;
    const LatchMode before = discrete.latch[i].mode;
    stepper->y()[model->layout.sums + kSumLatches] +=
        update_latch(model->latches, i, now, data->relative, discrete.latch[i]);
    changed = changed || discrete.latch[i].mode != before;
  }
  return changed;
}

void DockingSim::Impl::begin_contact(double now) {
  discrete.contacted = true;
  discrete.time_of_contact = now;
}

void DockingSim::Impl::update_capture(double now) {
  const int count = model->latches.count();
  bool all = count > 0;
  for (int i = 0; i < count; ++i) all = all && discrete.latch[i].mode == LatchMode::kHeld;
  if (all && !discrete.captured && discrete.time_of_capture < 0.0) discrete.time_of_capture = now;
  discrete.captured = all;
}

bool DockingSim::Impl::update_thrust(double now) {
  const bool on = model->thrust != 0.0 && discrete.contacted && !discrete.captured &&
                  now >= discrete.time_of_contact + model->thrust_delay;
  const bool changed = on != discrete.thrust_on;
  discrete.thrust_on = on;
  return changed;
}

/// Everything at one state of the stepper, tau after the last communication point.
Status DockingSim::Impl::evaluate(double tau) {
  Status status = calc_docking<double>(*model, discrete, memory, loads, elapsed + tau, stepper->y(),
                                       nullptr, *data);
  if (!status.ok()) status.time = elapsed + tau;
  return status;
}

/// Roots: first contact (for an absorber every onset), end of an absorber's contact, latches.
void DockingSim::Impl::calc_event_functions(const DockingData<double>& at, double* roots) const {
  const bool absorber = model->contact.kind == ContactModel::Kind::kAbsorber;
  roots[0] = has_surfaces() && (absorber || !discrete.contacted) ? at.contact.gap : 1.0;
  roots[1] = has_surfaces() && absorber ? -at.contact.gap : 1.0;
  for (int i = 0; i < model->latches.count(); ++i) roots[kFixedRoots + i] = at.latch.event[i];
}

double DockingSim::Impl::find_total_energy() const {
  return find_kinetic_energy(*model, *data) + find_potential_energy();
}

double DockingSim::Impl::find_potential_energy() const {
  return data->joints.energy + data->contact.energy + data->latch.energy;
}

PhaseInputs DockingSim::Impl::find_phase_inputs() const {
  PhaseInputs in;
  if (!model->present[kTarget]) return in;
  const RelativeMotion<double> relative =
      find_relative(data->interface[kChaser], data->interface[kTarget]);
  in.gap = data->contact.gap;
  in.axial = data->relative.p.x();
  in.axial_rate = relative.v.x();
  in.speed = relative.v.norm();
  in.angular_speed = relative.w.norm();
  for (int i = 0; i < model->latches.count(); ++i)
    in.latched += discrete.latch[i].mode == LatchMode::kHeld;
  return in;
}

/// Motion of a vehicle's CoM frame in O, from the last evaluation.
VehicleState DockingSim::Impl::find_vehicle_state(int i) const {
  VehicleState state;
  if (!model->present[i]) return state;
  const FrameMotion<double>& frame = data->vehicle[i];
  state.x = frame.p;
  state.v = frame.v;
  state.q = quat_from_matrix<double>(frame.R);
  state.w = frame.R.transpose() * frame.w;
  return state;
}

/// Close a communication step that succeeded.
void DockingSim::Impl::finish_step(double t, double h) {
  elapsed = t + h - t_start;
  // O drifts with its velocity and falls with gravity, which its contents then do not feel.
  frame_shift += frame_velocity * h;
  if (model->falling) {
    frame_shift += 0.5 * h * h * loads.gravity;
    frame_velocity += h * loads.gravity;
  }
  last_step = h;
  outputs_valid = false;
  update_mean_loads(h);
  update_momentum_audit();
}

/// Mean loads over the step just made, with the inputs that it was made with.
void DockingSim::Impl::update_mean_loads(double h) {
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || !model->moves[i]) continue;
    // Impulse on the vehicle as its host knows it (stated mass and inertia), less known loads.
    const VehicleParameters& p = parameters.vehicle[i];
    const Mat3<double> I = make_symmetric(p.inertia);
    const VehicleState before = vehicle_before[i], after = find_vehicle_state(i);
    const auto spin = [&](const VehicleState& s) {
      return Vec3<double>(p.mass * s.x.cross(s.v) +
                          quat_to_matrix<double>(s.q) * Vec3<double>(I * s.w));
    };
    Wrench<double> impulse;
    impulse.f = p.mass * (after.v - before.v);
    impulse.t = spin(after) - spin(before);
    mean_load[i] = find_mean_load(impulse, before, after, h);
    mean_load[i].f -= loads.force[i];
    if (!model->falling) mean_load[i].f -= p.mass * loads.gravity;
    mean_load[i].t -= loads.torque[i];
  }
}

/// Compare the momentum summed over bodies with its start and the impulses from outside.
void DockingSim::Impl::update_momentum_audit() {
  // An immobile vehicle takes up any momentum: there is nothing to compare then.
  if (!model->moves[kChaser] || (model->present[kTarget] && !model->moves[kTarget])) return;
  Wrench<double> difference;
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i]) continue;
    const Wrench<double> now = find_momentum(*model, i, *data);
    difference.f += now.f - momentum_start[i].f;
    difference.t += now.t - momentum_start[i].t;
    momentum_scale = std::max({momentum_scale, momentum_start[i].f.norm(), now.f.norm()});
    angular_momentum_scale =
        std::max({angular_momentum_scale, momentum_start[i].t.norm(), now.t.norm()});
  }
  const double* impulse = stepper->y() + model->layout.impulse;
  for (int j = 0; j < 3; ++j) {
    difference.f[j] -= impulse[j];
    difference.t[j] -= impulse[3 + j];
  }
  // An aligned docking has next to no angular momentum about O: measure it by the linear one at a
  // lever of 1 m then.
  const double angular_scale = std::max(angular_momentum_scale, momentum_scale * 1.0);
  momentum_residual = std::max({momentum_residual, difference.f.norm() / momentum_scale,
                                difference.t.norm() / angular_scale});
}

}  // namespace dockloop
