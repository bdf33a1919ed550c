// Reading out: from the state at a communication point to the variables of the interface.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

/// Rotate everything about a docking capture into the axes it is reported in: load on the target
/// about the origin of P, axes of P.
Wrench<double> find_capture_load(const DockingData<double>& data) {
  const FrameMotion<double>& P = data.interface[kTarget];
  Wrench<double> load;
  load.f = P.R.transpose() * data.on_passive.f;
  load.t = P.R.transpose() * (data.on_passive.t + (data.capture.p - P.p).cross(data.on_passive.f));
  return load;
}

/// tension, compression, shear [N], bending, torsion [N m] of a capture load.
std::array<double, Outputs::kLoadCount> find_load_components(const Wrench<double>& load) {
  return {std::max(0.0, -load.f.x()), std::max(0.0, load.f.x()),
          find_length(load.f.y(), load.f.z()), find_length(load.t.y(), load.t.z()),
          std::abs(load.t.x())};
}

double find_load_ratio(const std::array<double, Outputs::kLoadCount>& load,
                       const RatedLoads& rated) {
  const std::array<double, Outputs::kLoadCount> limit = {rated.tension, rated.compression,
                                                         rated.shear, rated.bending, rated.torsion};
  double ratio = 0.0;
  for (int i = 0; i < Outputs::kLoadCount; ++i) {
    if (limit[i] > 0.0) ratio = std::max(ratio, load[i] / limit[i]);
  }
  return ratio;
}

}  // namespace

std::array<double, kPeakCount> DockingSim::Impl::find_peak_values() const {
  std::array<double, kPeakCount> values{};
  if (!model->present[kTarget]) return values;
  const auto load = find_load_components(find_capture_load(*data));
  std::copy(load.begin(), load.end(), values.begin());
  values[Outputs::kLoadCount] = find_load_ratio(load, scene->rated);
  return values;
}

void DockingSim::Impl::update_outputs() {
  read_inputs();
  if (!evaluate(0.0).ok()) return;  // cannot happen: the state was accepted
  const int base_body = model->mechanism.vehicle;
  calc_reactions(model->mechanism, data->base, base_body, data->mechanism);
  outputs.time = t_start + elapsed;
  update_vehicle_outputs();
  update_load_outputs();
  if (model->present[kTarget]) update_relative_outputs();
  update_contact_outputs();
  update_mechanism_outputs();
  update_energy_outputs();
  outputs.solver_steps = static_cast<double>(stepper->steps());
  outputs.solver_rhs_evaluations = static_cast<double>(stepper->rate_evaluations());
  outputs.solver_rejected_steps = static_cast<double>(stepper->rejected_steps());
  outputs.solver_closure_residual = find_closure_residual(model->mechanism, data->mechanism);
  outputs.solver_singularity_margin = find_singularity_margin(data->mechanism);
  outputs_valid = true;
}

void DockingSim::Impl::update_vehicle_outputs() {
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i]) continue;
    Outputs::Vehicle& out = outputs.vehicle[i];
    if (!model->moves[i]) {
      const VehicleParameters& p = parameters.vehicle[i];
      out.position = p.position;
      out.attitude = p.attitude;
      continue;
    }
    const double* at = stepper->y() + model->layout.pose[i];
    out.position = frame_origin + (frame_shift + Vec3<double>(at[0], at[1], at[2]));
    out.attitude = Vec4<double>(at[3], at[4], at[5], at[6]).normalized();
    out.velocity = frame_velocity + data->vehicle[i].v;
    out.angular_velocity = data->vehicle[i].R.transpose() * data->vehicle[i].w;
  }
}

/// Load of the docking system on each vehicle: now, and its mean over the step just made.
void DockingSim::Impl::update_load_outputs() {
  const int chaser_body = model->mechanism.vehicle;
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i]) continue;
    const FrameMotion<double>& frame = data->vehicle[i];
    Wrench<double> load;  // about the CoM, axes of O
    if (i == kTarget) {
      load.f = data->on_passive.f;
      load.t = data->on_passive.t + (data->capture.p - frame.p).cross(data->on_passive.f);
    } else {
      load = data->mechanism.on_base;
      if (chaser_body == kBase) load.t -= frame.p.cross(load.f);
      if (model->mechanism.model.capture_body == chaser_body) {
        load.f -= data->on_passive.f;
        load.t -= data->on_passive.t + (data->capture.p - frame.p).cross(data->on_passive.f);
      }
      load.f += data->thrust;
      if (model->frozen.mass > 0.0) {
        // The stated vehicle carries the mechanism frozen at home: what moves that mass along is
        // part of the load that the stated vehicle must feel.
        const Vec3<double> a = data->mechanism.tree.a[0], alpha = data->mechanism.tree.alpha[0];
        const Vec3<double> c = frame.R * model->frozen.com;
        const Mat3<double> I = frame.R * model->frozen.inertia * frame.R.transpose();
        const Vec3<double> f = model->frozen.mass *
                               (a + alpha.cross(c) + frame.w.cross(Vec3<double>(frame.w.cross(c))));
        load.f += f;
        load.t += c.cross(f) + I * alpha + frame.w.cross(Vec3<double>(I * frame.w));
      }
    }
    outputs.vehicle[i].force = load.f;
    outputs.vehicle[i].torque = frame.R.transpose() * load.t;
    if (!(last_step > 0.0) || !model->moves[i]) {
      outputs.vehicle[i].force_mean = load.f;
      outputs.vehicle[i].torque_mean = outputs.vehicle[i].torque;
      continue;
    }
    outputs.vehicle[i].force_mean = mean_load[i].f;
    outputs.vehicle[i].torque_mean = mean_load[i].t;
  }
}

void DockingSim::Impl::update_relative_outputs() {
  const RelativeMotion<double> relative =
      find_relative(data->interface[kChaser], data->interface[kTarget]);
  outputs.relative_position = relative.p;
  outputs.relative_attitude = quat_from_matrix<double>(relative.R);
  outputs.relative_velocity = relative.v;
  outputs.relative_angular_velocity = relative.w;
  outputs.relative_axial = relative.p.x();
  outputs.relative_lateral = find_length(relative.p.y(), relative.p.z());
  // Swing and twist about x: q = swing * twist.
  const Vec4<double>& q = outputs.relative_attitude;
  outputs.relative_pitch_yaw = 2.0 * std::atan2(find_length(q[2], q[3]), find_length(q[0], q[1]));
  outputs.relative_roll = 2.0 * std::atan2(q[1], q[0]);
  if (outputs.relative_roll > M_PI) outputs.relative_roll -= 2.0 * M_PI;
  if (outputs.relative_roll < -M_PI) outputs.relative_roll += 2.0 * M_PI;

  const Wrench<double> load = find_capture_load(*data);
  outputs.capture_force = load.f;
  outputs.capture_torque = load.t;
  outputs.capture_load = find_load_components(load);
  outputs.capture_load_ratio = find_load_ratio(outputs.capture_load, scene->rated);
  std::copy_n(peaks.peak().begin(), static_cast<int>(Outputs::kLoadCount),
              outputs.capture_peak.begin());
  outputs.capture_peak_load_ratio = peaks.peak()[Outputs::kLoadCount];
}

/// What loads from outside can at most do to the relative acceleration of any two points of the
/// capture hardware before contact [m/s2].
double DockingSim::Impl::find_acceleration_bound() const {
  double bound = model->falling ? 0.0 : loads.gravity.norm();
  for (int i : {kChaser, kTarget}) {
    if (!model->moves[i]) continue;
    const VehicleParameters& p = parameters.vehicle[i];
    const double arm = p.interface_position.norm() + model->contact.reach;
    const double least_inertia = Eigen::SelfAdjointEigenSolver<Mat3<double>>(
                                     make_symmetric(p.inertia), Eigen::EigenvaluesOnly)
                                     .eigenvalues()[0];
    bound += loads.force[i].norm() / p.mass + loads.torque[i].norm() * arm / least_inertia;
    if (i == kChaser) bound += data->thrust.norm() / p.mass;
  }
  const int ring = model->mechanism.model.capture_body;
  if (ring != kBase && ring != model->mechanism.vehicle) {
    const double mass = model->mechanism.model.bodies[ring].mass;
    if (mass > 0.0) bound += loads.command.lpNorm<1>() / mass;
  }
  return bound;
}

void DockingSim::Impl::update_contact_outputs() {
  outputs.gap = kNoGap;
  outputs.time_to_contact = kNever;
  if (has_surfaces()) {
    outputs.gap = find_gap(model->contact, data->relative, data->contact_work);
    outputs.time_to_contact =
        find_time_to_contact(outputs.gap, find_approach_bound(model->contact, data->relative),
                             find_acceleration_bound());
    for (size_t i = 0; i < outputs.petal_force.size(); ++i) {
      outputs.petal_force[i] = data->contact.petal_force[i].norm();
    }
    outputs.contact_depth_ratio = data->contact.depth_ratio;
  }
  for (int i = 0; i < model->latches.count(); ++i) {
    outputs.latch_opening[i] = data->latch.opening[i];
    outputs.latch_force[i] = data->latch.force[i];
    outputs.latched[i] = discrete.latch[i].mode == LatchMode::kHeld ? 1 : 0;
  }
  outputs.phase = discrete.phase;
  outputs.outcome = discrete.outcome;
  outputs.captured = discrete.captured;
  const auto report = [this](double since_start) {
    return since_start < 0.0 ? -1.0 : t_start + since_start;
  };
  outputs.time_of_contact = report(discrete.time_of_contact);
  outputs.time_of_capture = report(discrete.time_of_capture);
}

void DockingSim::Impl::update_mechanism_outputs() {
  const MechanismData<double>& mechanism = data->mechanism;
  const RelativeMotion<double> ring = find_relative(data->interface[kChaser], data->capture);
  outputs.ring_position = ring.p;
  outputs.ring_attitude = quat_from_matrix<double>(ring.R);
  outputs.ring_velocity = ring.v;
  outputs.ring_angular_velocity = ring.w;
  for (size_t i = 0; i < model->mechanism.model.legs.size(); ++i) {
    const Leg& leg = model->mechanism.model.legs[i];
    const Body& slide = model->mechanism.model.bodies[leg.slide_body];
    outputs.leg_length[i] = leg.home_length + mechanism.tree.q[slide.q_index];
    outputs.leg_rate[i] = mechanism.tree.v[slide.v_index];
    outputs.leg_force[i] = data->joint_force[leg.force];
  }
  int q = 0, v = 0;
  for (int i : state_bodies) {
    const Body& body = model->mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) outputs.state_q[q++] = mechanism.tree.q[body.q_index + j];
    for (int j = 0; j < body.nv(); ++j) {
      outputs.state_v[v] = mechanism.tree.v[body.v_index + j];
      outputs.state_a[v++] = mechanism.vdot[body.v_index + j];
    }
  }
  for (size_t k = 0; k < outputs.loop_force.size(); ++k) {
    const int count = std::min(3, equation_count(model->mechanism.model.loops[k].cut));
    for (int j = 0; j < count; ++j) {
      outputs.loop_force[k][j] =
          get_cut_force(model->mechanism.plan, mechanism.loops, static_cast<int>(k), j);
    }
  }
  // Load on the base in axes and about the origin of B.
  const FrameMotion<double> B = find_frame_on(data->vehicle[kChaser], model->base_in_chaser);
  const Vec3<double> about = model->mechanism.vehicle == kBase
                                 ? Vec3<double>(Vec3<double>::Zero())
                                 : mechanism.tree.p[model->mechanism.vehicle];
  outputs.base_force = B.R.transpose() * mechanism.on_base.f;
  outputs.base_torque =
      B.R.transpose() * (mechanism.on_base.t + (about - B.p).cross(mechanism.on_base.f));
}

void DockingSim::Impl::update_energy_outputs() {
  const double* sums = stepper->y() + model->layout.sums;
  outputs.energy_kinetic = find_kinetic_energy(*model, *data);
  outputs.energy_potential = find_potential_energy();
  outputs.energy_dissipated_contact = sums[kSumContact];
  outputs.energy_dissipated_friction = sums[kSumFriction];
  outputs.energy_dissipated_legs = sums[kSumLegs];
  outputs.energy_dissipated_latches = sums[kSumLatches];
  outputs.energy_dissipated =
      sums[kSumContact] + sums[kSumFriction] + sums[kSumLegs] + sums[kSumLatches];
  outputs.energy_external = sums[kSumExternal] + host_work;
  outputs.energy_residual = outputs.energy_kinetic + outputs.energy_potential +
                            outputs.energy_dissipated - outputs.energy_external - energy_start;
  outputs.momentum_residual = momentum_residual;
  // Everything inside but the driven vehicles themselves.
  const TreeData<double>& tree = data->mechanism.tree;
  Wrench<double> sum;
  double mass = 0.0;
  Vec3<double> first_moment = Vec3<double>::Zero();
  if (model->moves[kTarget] && scene->motion[kTarget] != Motion::kDriven) {
    sum = find_momentum(*model, kTarget, *data);
    mass = parameters.vehicle[kTarget].mass;
    first_moment = mass * data->vehicle[kTarget].p;
  }
  const bool driven = scene->motion[kChaser] == Motion::kDriven;
  for (int i = 0; i < static_cast<int>(tree.R.size()); ++i) {
    if (driven && i == model->mechanism.vehicle) continue;
    const Wrench<double> p = find_body_momentum(*model, i, *data);
    const double m = model->mechanism.model.bodies[i].mass;
    sum.f += p.f;
    sum.t += p.t;
    mass += m;
    first_moment += tree.h_body[i] + m * tree.p[i];
  }
  outputs.momentum_linear = sum.f + mass * frame_velocity;
  outputs.momentum_angular = sum.t + first_moment.cross(frame_velocity);
  outputs.momentum_reference = frame_origin + frame_shift;
}

}  // namespace dockloop
