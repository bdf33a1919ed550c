// The data of each driven vehicle between communication points; see host_coupling.hpp.
#include "sim/host_coupling.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "math/rigid_body.hpp"

namespace dockloop {
namespace {

constexpr double kHostStep = 1e-3;  ///< of the host model's attitude [s]
constexpr int kMaxHostSteps = 10000;
constexpr double kNormWarning = 1e-6;  ///< error of the norm of a received quaternion

}  // namespace

const char* get_vehicle_name(int vehicle) { return vehicle == kChaser ? "chaser" : "target"; }

VehicleState find_vehicle_state(const DockingModel& model, const DockingData<double>& data,
                                int vehicle) {
  VehicleState state;
  if (!model.present[vehicle]) return state;
  const FrameMotion<double>& frame = data.vehicle[vehicle];
  state.x = frame.p;
  state.v = frame.v;
  state.q = quat_from_matrix<double>(frame.R);
  state.w = frame.R.transpose() * frame.w;
  return state;
}

CouplingPoint find_coupling_point(const DockingModel& model, const DockingData<double>& data,
                                  const double* y) {
  CouplingPoint now;
  for (int i : {kChaser, kTarget}) {
    now.vehicle[i] = find_vehicle_state(model, data, i);
    if (model.layout.host_impulse[i] < 0) continue;
    const double* known = y + model.layout.host_impulse[i];
    now.known[i] = {Vec3<double>(known[0], known[1], known[2]),
                    Vec3<double>(known[3], known[4], known[5])};
  }
  return now;
}

HostCoupling::HostCoupling(const DockingModel& model, std::shared_ptr<const Setup> setup,
                           const Vec3<double>& frame_origin, const Inputs& inputs,
                           const StepLoads& loads, const EventLogic& events, Evaluator& evaluator,
                           SimState& state, std::vector<std::string>& warnings)
    : model_(&model),
      setup_(std::move(setup)),
      frame_origin_(frame_origin),
      inputs_(inputs),
      loads_(loads),
      events_(events),
      evaluator_(evaluator),
      state_(state),
      warnings_(warnings) {
  if (has_host()) interface_work_ = std::make_unique<InterfaceWorkspace>(model);
}

void HostCoupling::use_coordinates(const DockingModel& model) {
  use_model(model);
  if (interface_work_) interface_work_ = std::make_unique<InterfaceWorkspace>(model);
}

bool HostCoupling::has_host() const { return model_->driven[kChaser] || model_->driven[kTarget]; }

bool HostCoupling::announces() const {
  return has_host() && setup_->parameters.coupling_mode != kSequential;
}

bool HostCoupling::steps_first() const {
  return has_host() && setup_->parameters.coupling_mode == kHostFirst;
}

void HostCoupling::note_missing_inputs(int i) {
  state_.coupling.vehicle[i].input = inputs_.vehicle[i];
  state_.mean_load[i] = Wrench<double>();  // a host without results holds no load
  warnings_.push_back(std::string(get_vehicle_name(i)) +
                      " is driven, but all its motion inputs are zero in the first step: the"
                      " step begins at the start values. Connect position, velocity, attitude"
                      " and angular_velocity");
}

VehicleState HostCoupling::receive(int i, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const VehicleState z = find_received_state(i);
  if (state_.last_step > 0.0) {
    if (steps_first()) diagnose(i, judge_first_end(i), state_.last_step);
    v.pending = find_pending_impulse(i, z);
    look_at_innovation(i, z);
  } else {
    diagnose(i,
             judge_first_report(inputs_.vehicle[i], find_start_report(i),
                                setup_->parameters.vehicle[i].interface_position, h,
                                state_.coupling.reports[static_cast<size_t>(i)]),
             h);
  }
  v.received = z;
  v.input = inputs_.vehicle[i];
  const VehicleState moved =
      carry_along(z, v.predicted, find_vehicle_state(*model_, evaluator_.present(), i));
  if (steps_first()) {  // the state of the host now; no load acts after it yet
    v.predicted = z;
    v.held = Wrench<double>();
  }
  return moved;
}

Wrench<double> HostCoupling::find_internal_momentum(int i) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  return find_stated_momentum(i, v.received) + v.pending;
}

void HostCoupling::announce(double h, const CouplingPoint& begin, const CouplingPoint& end) {
  // After a step much shorter than the others, only a share of the pending impulse is returned.
  const double share = h / std::max(h, state_.coupling.regular_step);
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    const DrivenVehicle& v = state_.coupling.vehicle[i];
    const Wrench<double> impulse =
        share * find_pending_impulse(i, v.predicted) + find_exerted_impulse(i, begin, end);
    state_.mean_load[i] = find_mean_load(
        impulse, v.predicted, carry_along(v.predicted, begin.vehicle[i], end.vehicle[i]), h);
  }
}

void HostCoupling::warn_of_look_ahead(double h, const std::string& reason) {
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    char text[400];
    std::snprintf(text, sizeof text,
                  "the loads of the step after t = %.9g s could not be announced (looking %.6g s "
                  "ahead: %s); the announced load contains the pending impulse only",
                  setup_->t_start + state_.elapsed, h, reason.c_str());
    warn_once(i, kWarnedLookAhead, text);
  }
}

Mat3<double> HostCoupling::find_stated_inertia(int i) const {
  return make_symmetric(setup_->parameters.vehicle[i].inertia);
}

Wrench<double> HostCoupling::find_stated_momentum(int i, const VehicleState& s) const {
  return find_rigid_momentum(model_->stated_mass[i], find_stated_inertia(i), s);
}

/// Motion received through the inputs, in frame O.
VehicleState HostCoupling::find_received_state(int i) const {
  const Inputs::Vehicle& in = inputs_.vehicle[i];
  VehicleState z;
  z.x = in.position - frame_origin_ - state_.frame_shift;
  z.v = in.velocity - state_.frame_velocity;
  z.q = in.attitude.normalized();
  z.w = in.angular_velocity;
  return z;
}

Status HostCoupling::check_received_attitude(int i, std::string& reason) {
  const double norm = inputs_.vehicle[i].attitude.norm();
  char text[200];
  if (!is_attitude(inputs_.vehicle[i].attitude)) {
    std::snprintf(text, sizeof text,
                  "%s.attitude must be a unit quaternion (w, x, y, z); its norm is %.6g",
                  get_vehicle_name(i), norm);
    reason = text;
    return {StatusCode::kBadInput, -1, norm, state_.elapsed};
  }
  if (std::abs(norm - 1.0) > kNormWarning) {
    std::snprintf(
        text, sizeof text,
        "%s.attitude has the norm %.9g; the normalised quaternion is used, but the host's "
        "integration should keep the norm at 1",
        get_vehicle_name(i), norm);
    warn_once(i, kWarnedNorm, text);
  }
  return {};
}

/// Motion of the host's vehicle under a load over h, if the stated mass and loads are right.
VehicleState HostCoupling::predict_host(int i, const VehicleState& z, const Wrench<double>& load,
                                        double h) {
  const Loads& known = loads_.at(0.5 * h);
  const double mass = model_->stated_mass[i];
  Vec3<double> force = load.f + known.force[i];
  if (!model_->falling) force += mass * known.gravity;
  VehicleState next = z;
  next.x += h * z.v + (0.5 * h * h / mass) * force;
  next.v += (h / mass) * force;
  const int count = std::clamp(static_cast<int>(std::ceil(h / kHostStep)), 1, kMaxHostSteps);
  turn_rigid_body(find_stated_inertia(i), load.t + known.torque[i], h, count, next.q, next.w);
  return next;
}

void HostCoupling::start() {
  state_.coupling = CouplingState();
  if (has_host()) state_.coupling.reports.assign(2, make_report_sums());
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    state_.coupling.vehicle[i].received = state_.coupling.vehicle[i].predicted =
        find_vehicle_state(*model_, evaluator_.present(), i);
    state_.coupling.vehicle[i].input = inputs_.vehicle[i];
  }
}

Wrench<double> HostCoupling::find_exerted_impulse(int i, const CouplingPoint& from,
                                                  const CouplingPoint& to) const {
  return (find_stated_momentum(i, to.vehicle[i]) - find_stated_momentum(i, from.vehicle[i])) -
         (to.known[i] - from.known[i]);
}

void HostCoupling::update_impulse_balance(double h, const CouplingPoint& begin,
                                          const CouplingPoint& end, const double* y) {
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    DrivenVehicle& v = state_.coupling.vehicle[i];
    const Wrench<double> exerted = find_exerted_impulse(i, begin, end);
    v.pending += exerted;
    if (announces()) {
      v.held = state_.mean_load[i];  // announced for this step
    } else {
      const VehicleState host_end = carry_along(v.received, begin.vehicle[i], end.vehicle[i]);
      v.held = state_.mean_load[i] = find_mean_load(v.pending, v.received, host_end, h);
    }
    v.predicted = predict_host(i, v.received, v.held, h);
    note_step(i, exerted, begin.vehicle[i], end.vehicle[i], h);
  }
  const int held = events_.count_held_latches();
  if (held != state_.coupling.held_latches) {
    state_.coupling.held_latches = held;
    state_.coupling.frequency = find_interface_frequency(y);
  }
}

/// Pending impulse if the host's vehicle is at a given state, after the last step.
Wrench<double> HostCoupling::find_pending_impulse(int i, const VehicleState& host) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  if (!(state_.last_step > 0.0)) return v.pending;
  return v.pending - find_delivered_impulse(v.held, v.received, host, state_.last_step);
}

Wrench<double> HostCoupling::find_pending_impulse(int i) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  const bool is_received =
      !is_same_motion(inputs_.vehicle[i], v.input) && is_attitude(inputs_.vehicle[i].attitude);
  return find_pending_impulse(i, is_received ? find_received_state(i) : v.predicted);
}

}  // namespace dockloop
