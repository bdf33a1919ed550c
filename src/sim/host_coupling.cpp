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
                           const std::array<VehicleParts, 2>& parts,
                           const Vec3<double>& frame_origin, const Inputs& inputs,
                           const StepLoads& loads, const EventLogic& events, Evaluator& evaluator,
                           SimState& state, std::vector<std::string>& warnings)
    : model_(&model),
      setup_(std::move(setup)),
      parts_(parts),
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
  const Parameters& p = setup_->parameters;
  return has_host() &&
         (p.coupling_mode != kSequential || p.coupling_delay > p.coupling_motion_delay);
}

bool HostCoupling::steps_first() const {
  return has_host() && setup_->parameters.coupling_mode == kHostFirst;
}

void HostCoupling::note_missing_inputs(int i) {
  state_.coupling.vehicle[i].input = inputs_.vehicle[i];
  state_.mean_load[i] = Wrench<double>();  // a host without results holds no load
  LoadQueue& queue = state_.coupling.vehicle[i].queue;
  if (queue.count > 1) --queue.count;
  warnings_.push_back(std::string(get_vehicle_name(i)) +
                      " is driven, but all its motion inputs are zero in the first step: the"
                      " step begins at the start values. Connect position, velocity, attitude"
                      " and angular_velocity");
}

VehicleState HostCoupling::receive(int i, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const VehicleState z = find_received_state(i);
  const double at = find_report_time();
  VehicleState now = advance_host(i, z, at, state_.elapsed);
  if (state_.last_step > 0.0) {
    if (steps_first()) diagnose(i, judge_first_end(i), state_.last_step);
    diagnose(i, judge_age(i), state_.last_step);
    v.pending = v.pending - find_delivered_impulse(i, z, at);
    const VehicleBody body = v.body;
    look_at_innovation(i, z, now);
    if (!is_same_body(body, v.body)) now = advance_host(i, z, at, state_.elapsed);
  } else {
    diagnose(i,
             judge_first_report(inputs_.vehicle[i], find_start_report(i),
                                setup_->parameters.vehicle[i].interface_position, h,
                                state_.coupling.reports[static_cast<size_t>(i)]),
             h);
  }
  v.received = z;
  v.since = at;
  v.input = inputs_.vehicle[i];
  forget_old_loads(v);
  const VehicleState moved =
      carry_along(now, v.now, find_vehicle_state(*model_, evaluator_.present(), i));
  v.now = now;
  if (steps_first()) {  // the state of the host now; no load acts after it yet
    v.predicted = z;
    v.held = Wrench<double>();
  }
  return moved;
}

Wrench<double> HostCoupling::find_internal_momentum(int i) const {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  return find_host_momentum(i, v.now) + find_pending_impulse(i, v.received, state_.elapsed);
}

VehicleBody HostCoupling::find_stated_body(int i, const Parameters& parameters) const {
  const VehicleParameters& p = parameters.vehicle[i];
  return {p.mass, Vec3<double>::Zero(), make_symmetric(p.inertia)};
}

void HostCoupling::announce(double h, const CouplingPoint& now, const CouplingPoint& begin,
                            const CouplingPoint& end) {
  // After a step much shorter than the others, only a share of the pending impulse is returned.
  const double share = h / std::max(h, state_.coupling.regular_step);
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    DrivenVehicle& v = state_.coupling.vehicle[i];
    const double time = state_.elapsed + find_lead();  // when the load begins to act
    Wrench<double> pending = find_pending_impulse(i, v.predicted, time);
    if (is_delayed()) pending += find_exerted_impulse(i, now, begin);
    const Wrench<double> impulse = share * pending + find_exerted_impulse(i, begin, end);
    const VehicleState start = advance_host(i, v.now, state_.elapsed, time);
    state_.mean_load[i] =
        find_mean_load(impulse, start, carry_along(start, begin.vehicle[i], end.vehicle[i]), h);
    if (is_delayed()) add_load(v.queue, time, state_.mean_load[i]);
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

Wrench<double> HostCoupling::find_host_momentum(int i, const VehicleState& s) const {
  return find_rigid_momentum(model_->of_host[i], s);
}

/// Motion received through the inputs, in frame O as it was then.
VehicleState HostCoupling::find_received_state(int i) const {
  const Inputs::Vehicle& in = inputs_.vehicle[i];
  VehicleState z;
  z.x = in.position - frame_origin_ - state_.frame_shift;
  z.v = in.velocity - state_.frame_velocity;
  if (const double late = state_.elapsed - find_report_time(); late > 0.0) {
    Vec3<double> fall = Vec3<double>::Zero();  // change of the velocity of O
    if (model_->falling) fall = late * loads_.at_start().gravity;
    z.x += late * (state_.frame_velocity - 0.5 * fall);
    z.v += fall;
  }
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

/// Motion of the host's vehicle under a load over h, if the body and the loads are right.
/// @param begin  time of `z` [s since start]
VehicleState HostCoupling::predict_host(int i, const VehicleBody& body, const VehicleState& z,
                                        const Wrench<double>& load, double begin, double h) const {
  const Loads& present = loads_.at(0.5 * h);
  const bool is_past = begin < find_past_end();
  const Wrench<double> known =
      is_past ? find_mean_of_loads(state_.coupling.vehicle[i].known, begin, begin + h)
              : Wrench<double>{present.force[i], present.torque[i]};
  Vec3<double> force = load.f + known.f;
  // The host applies forces at the reported point.
  const Vec4<double> middle = quat_multiply<double>(z.q, quat_exp<double>(0.5 * h * z.w));
  const Vec3<double> torque =
      load.t + known.t - body.com.cross(quat_to_matrix<double>(middle).transpose() * force);
  if (!model_->falling) force += body.mass * present.gravity;
  VehicleState next = move_origin(z, body.com);
  next.x += h * next.v + (0.5 * h * h / body.mass) * force;
  next.v += (h / body.mass) * force;
  const int count = std::clamp(static_cast<int>(std::ceil(h / kHostStep)), 1, kMaxHostSteps);
  turn_rigid_body(body.inertia, torque, h, count, next.q, next.w);
  return move_origin(next, -body.com);
}

void HostCoupling::start() {
  state_.coupling = CouplingState();
  if (has_host()) state_.coupling.reports.assign(2, make_report_sums(is_delayed()));
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    DrivenVehicle& v = state_.coupling.vehicle[i];
    v.received = v.predicted = v.before = v.now =
        find_vehicle_state(*model_, evaluator_.present(), i);
    v.input = inputs_.vehicle[i];
    if (is_delayed()) v.queue = v.known = make_load_queue();
    v.stated = v.body = model_->of_host[i];
  }
}

Wrench<double> HostCoupling::find_exerted_impulse(int i, const CouplingPoint& from,
                                                  const CouplingPoint& to) const {
  return (find_host_momentum(i, to.vehicle[i]) - find_host_momentum(i, from.vehicle[i])) -
         (to.known[i] - from.known[i]);
}

void HostCoupling::update_impulse_balance(double h, const CouplingPoint& begin,
                                          const CouplingPoint& end, const double* y) {
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    DrivenVehicle& v = state_.coupling.vehicle[i];
    const Wrench<double> exerted = find_exerted_impulse(i, begin, end);
    v.pending += exerted;
    const double start = state_.elapsed - h, at = find_report_time();
    if (setup_->parameters.coupling_motion_delay > 0.0) {
      const Loads& known = loads_.at(0.5 * h);
      add_load(v.known, start, {known.force[i], known.torque[i]});
    }
    if (!announces()) {
      const VehicleState host_end = carry_along(v.now, begin.vehicle[i], end.vehicle[i]);
      Wrench<double> pending = v.pending;
      if (is_delayed()) {
        Wrench<double> delivered;
        advance_host(i, v.received, v.since, start, &delivered);
        pending -= delivered;
      }
      state_.mean_load[i] = find_mean_load(pending, v.now, host_end, h);
      if (is_delayed()) add_load(v.queue, start, state_.mean_load[i]);
    }
    v.load = is_delayed() ? find_mean_of_loads(v.queue, start, state_.elapsed)
                          : state_.mean_load[i];  // of this step, or announced for it
    v.held = is_delayed() ? find_mean_of_loads(v.queue, v.since, at) : v.load;
    v.predicted = advance_host(i, v.received, v.since, at);
    v.by_stated =
        is_identified(i) ? advance_body(i, v.stated, v.received, v.since, at) : v.predicted;
    v.before = v.now;
    v.now = advance_host(i, v.predicted, at, state_.elapsed);
    note_step(i, exerted, begin.vehicle[i], end.vehicle[i], h);
  }
  const int held = events_.count_held_latches();
  if (held != state_.coupling.held_latches) {
    state_.coupling.held_latches = held;
    state_.coupling.frequency = find_interface_frequency(y);
  }
}

}  // namespace dockloop
