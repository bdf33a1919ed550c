// The scheme of coupling.hpp: received motion, pending impulse, reported loads.
#include "sim/coupling.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "docking/base_jump.hpp"
#include "math/rigid_body.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kHostStep = 1e-3;  ///< of the host model's attitude [s]
constexpr int kMaxHostSteps = 10000;
constexpr std::int64_t kWorkAhead =
    10;  ///< work of a look ahead, as a multiple of that of the last step
constexpr double kNormWarning = 1e-6;  ///< error of the norm of a received quaternion

/// Without a jump of the loads, peaks are refined across a communication point.
bool is_same_within_rounding(const std::array<double, kPeakCount>& a,
                             const std::array<double, kPeakCount>& b) {
  constexpr double kRounding = 1e-7;  // of stiff loads
  for (size_t i = 0; i < a.size(); ++i) {
    if (std::abs(a[i] - b[i]) > kRounding * std::max(std::abs(a[i]), std::abs(b[i]))) return false;
  }
  return true;
}

bool is_same_motion(const Inputs::Vehicle& a, const Inputs::Vehicle& b) {
  return a.position == b.position && a.velocity == b.velocity && a.attitude == b.attitude &&
         a.angular_velocity == b.angular_velocity;
}

}  // namespace

const char* DockingSim::Impl::name_of(int vehicle) const {
  return vehicle == kChaser ? "chaser" : "target";
}

bool DockingSim::Impl::has_host() const { return model->driven[kChaser] || model->driven[kTarget]; }

bool DockingSim::Impl::announces() const {
  return has_host() && setup->parameters.coupling_mode == kParallel;
}

/// Stated inertia: of the vehicle as its host knows it.
Mat3<double> DockingSim::Impl::find_stated_inertia(int i) const {
  return make_symmetric(setup->parameters.vehicle[i].inertia);
}

Wrench<double> DockingSim::Impl::find_stated_momentum(int i, const VehicleState& s) const {
  return find_rigid_momentum(model->stated_mass[i], find_stated_inertia(i), s);
}

/// Motion received through the inputs, in frame O.
VehicleState DockingSim::Impl::find_received_state(int i) const {
  const Inputs::Vehicle& in = inputs.vehicle[i];
  VehicleState z;
  z.x = in.position - frame_origin - frame_shift;
  z.v = in.velocity - frame_velocity;
  z.q = in.attitude.normalized();
  z.w = in.angular_velocity;
  return z;
}

/// Rounding errors of the norm are accepted; a larger error is an error of the host.
Status DockingSim::Impl::check_received_attitude(int i) {
  const double norm = inputs.vehicle[i].attitude.norm();
  char text[200];
  if (!is_attitude(inputs.vehicle[i].attitude)) {
    std::snprintf(text, sizeof text,
                  "%s.attitude must be a unit quaternion (w, x, y, z); its norm is %.6g",
                  name_of(i), norm);
    status_text = text;
    return {StatusCode::kBadInput, -1, norm, elapsed};
  }
  if (std::abs(norm - 1.0) > kNormWarning) {
    std::snprintf(
        text, sizeof text,
        "%s.attitude has the norm %.9g; the normalised quaternion is used, but the host's "
        "integration should keep the norm at 1",
        name_of(i), norm);
    warn_once(i, kWarnedNorm, text);
  }
  return {};
}

/// Motion of the host's vehicle under a load over h, if the stated mass and loads are right.
VehicleState DockingSim::Impl::predict_host(int i, const VehicleState& z,
                                            const Wrench<double>& load, double h) {
  const Loads& known = loads.at(0.5 * h);
  const double mass = model->stated_mass[i];
  Vec3<double> force = load.f + known.force[i];
  if (!model->falling) force += mass * known.gravity;
  VehicleState next = z;
  next.x += h * z.v + (0.5 * h * h / mass) * force;
  next.v += (h / mass) * force;
  const int count = std::clamp(static_cast<int>(std::ceil(h / kHostStep)), 1, kMaxHostSteps);
  turn_rigid_body(find_stated_inertia(i), load.t + known.torque[i], h, count, next.q, next.w);
  return next;
}

/// The pending impulse starts at zero; the first load is announced from the start state.
void DockingSim::Impl::start_coupling() {
  coupling = CouplingState();
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    coupling.vehicle[i].received = coupling.vehicle[i].predicted = find_vehicle_state(i);
    coupling.vehicle[i].input = inputs.vehicle[i];
  }
}

/// Receive the motion of driven vehicles at the start of a step of h.
Status DockingSim::Impl::receive(double h) {
  if (!has_host()) return {};
  Status status = evaluate(0.0);
  if (!status.ok()) return status;
  const bool first = !(last_step > 0.0);
  const double energy_before = find_total_energy(*model, present());
  const Pose<double> capture{present().capture.R, present().capture.p};
  const Pose<double> passive{present().interface[kTarget].R, present().interface[kTarget].p};
  const FrameMotion<double> chaser_before = present().vehicle[kChaser];
  std::array<Wrench<double>, 2> momentum_before;
  for (int i : {kChaser, kTarget}) momentum_before[i] = find_momentum(*model, i, present());
  const Wrench<double> mechanism_before = find_mechanism_momentum();
  const std::array<double, kPeakCount> loads_before = find_peak_values();
  const bool grips =
      (has_surfaces() && present().contact.gap <= 0.0) || events->count_held_latches() > 0;

  std::array<bool, 2> received{false, false};
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    if (first && is_all_zero(inputs.vehicle[i])) {
      coupling.vehicle[i].input = inputs.vehicle[i];
      mean_load[i] = Wrench<double>();  // a host without results holds no load
      warnings.push_back(std::string(name_of(i)) +
                         " is driven, but all its motion inputs are zero in the first step: the"
                         " step begins at the start values. Connect position, velocity, attitude"
                         " and angular_velocity");
      continue;
    }
    status = check_received_attitude(i);
    if (!status.ok()) return status;
    received[i] = true;
    DrivenVehicle& v = coupling.vehicle[i];
    const VehicleState z = find_received_state(i), inside = find_vehicle_state(i);
    if (first) {
      look_at_first_state(i, z, h);
    } else {
      v.pending = find_pending_impulse(i, z);
      look_at_innovation(i, z);
    }
    const VehicleState moved = carry_along(z, v.predicted, inside);
    set_vehicle_pose(*model, i, moved.x, moved.q, stepper->y());
    v.received = z;
    v.input = inputs.vehicle[i];
  }
  if (grips) {
    // The ring keeps its place on the target. The received motion may have moved the target.
    const FrameMotion<double> P = find_frame_on(
        get_vehicle_pose<double>(*model, kTarget, stepper->y()), model->interface_pose[kTarget]);
    const Pose<double> on_target = Pose<double>{P.R, P.p} * inverse(passive) * capture;
    status = hold_capture_body(*model, on_target, stepper->y(), present(), *jump_work);
    if (!status.ok()) return status;
  }
  status = match_momenta(received, chaser_before, mechanism_before);
  if (!status.ok()) return status;
  status = evaluate(0.0);
  if (!status.ok()) return status;
  if (received[kChaser]) {
    coupling.vehicle[kChaser].pending += mechanism_before - find_mechanism_momentum();
  }
  // The jump may begin a contact, and its forces count as peaks.
  update_memory();
  status = decide_absorber();
  if (!status.ok()) return status;
  if (has_surfaces() && !discrete.contacted && present().contact.gap <= 0.0)
    events->begin_contact(elapsed);
  const std::array<double, kPeakCount> loads_after = find_peak_values();
  if (!is_same_within_rounding(loads_before, loads_after)) peaks.begin(elapsed, loads_after);
  // The correction by the host counts as its work and impulse, not as an integration error.
  energy_audit.host_work += find_total_energy(*model, present()) - energy_before;
  for (int i : {kChaser, kTarget}) {
    momentum_audit.start[i] += find_momentum(*model, i, present()) - momentum_before[i];
  }
  return {};
}

/// Momentum of each internal vehicle = momentum of the host's vehicle + pending impulse. The
/// mechanism follows the new motion of the chaser. The change of its momentum becomes pending, too
/// (receive). Chaser with mechanism therefore get: host + pending + mechanism before.
Status DockingSim::Impl::match_momenta(const std::array<bool, 2>& received,
                                       const FrameMotion<double>& chaser_before,
                                       const Wrench<double>& mechanism_before) {
  for (int i : {kChaser, kTarget}) {
    if (!received[i]) continue;
    const DrivenVehicle& v = coupling.vehicle[i];
    const Wrench<double> momentum = find_stated_momentum(i, v.received) + v.pending;
    if (i == kTarget) {
      set_momentum(*model, i, momentum, stepper->y());
      continue;
    }
    const Status status = jump_to_momentum(*model, chaser_before, momentum + mechanism_before,
                                           stepper->y(), present(), *jump_work);
    if (!status.ok()) return status;
  }
  return {};
}

/// Momentum that moves with the chaser, without the vehicle of the host. @pre evaluate
Wrench<double> DockingSim::Impl::find_mechanism_momentum() const {
  return find_momentum(*model, kChaser, present()) -
         find_stated_momentum(kChaser, find_vehicle_state(kChaser));
}

/// Motion of the vehicles, and impulses of the known loads of their hosts so far. @pre evaluate
CouplingPoint DockingSim::Impl::find_coupling_point() const {
  CouplingPoint now;
  for (int i : {kChaser, kTarget}) {
    now.vehicle[i] = find_vehicle_state(i);
    if (model->layout.told[i] < 0) continue;
    const double* known = stepper->y() + model->layout.told[i];
    now.known[i] = {Vec3<double>(known[0], known[1], known[2]),
                    Vec3<double>(known[3], known[4], known[5])};
  }
  return now;
}

/// Impulse of the docking system on a vehicle: the change of its momentum, not a quadrature of the
/// load.
Wrench<double> DockingSim::Impl::find_exerted_impulse(int i, const CouplingPoint& from,
                                                      const CouplingPoint& to) const {
  return (find_stated_momentum(i, to.vehicle[i]) - find_stated_momentum(i, from.vehicle[i])) -
         (to.known[i] - from.known[i]);
}

/// After a step of h from step_begin: add the exerted impulse, find the load to report. Inputs are
/// still the inputs of the step. @pre evaluate at its end
void DockingSim::Impl::update_impulse_balance(double h, const CouplingPoint& end) {
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    DrivenVehicle& v = coupling.vehicle[i];
    const Wrench<double> exerted = find_exerted_impulse(i, step_begin, end);
    v.pending += exerted;
    v.before = v.held;
    if (announces()) {
      v.held = mean_load[i];  // announced for this step
    } else {
      const VehicleState host_end = carry_along(v.received, step_begin.vehicle[i], end.vehicle[i]);
      v.held = mean_load[i] = find_mean_load(v.pending, v.received, host_end, h);
    }
    v.predicted = predict_host(i, v.received, v.held, h);
    note_step(i, exerted, end.vehicle[i], h);
  }
  const int held = events->count_held_latches();
  if (held != coupling.held_latches) {
    coupling.held_latches = held;
    coupling.frequency = find_interface_frequency();
  }
}

/// Announce the loads of the coming step, which is expected to be h: future loads over the step,
/// and the pending impulse. @pre inputs are read
void DockingSim::Impl::announce(double h) {
  CouplingPoint begin, end;
  Status status = look_ahead(h, begin, end);
  if (!status.ok() && last_step > 0.0 && h > last_step) {
    h = last_step;
    status = look_ahead(h, begin, end);
  }
  if (!status.ok()) {
    for (int i : {kChaser, kTarget}) {
      if (!model->driven[i]) continue;
      char text[400];
      std::snprintf(text, sizeof text,
                    "the loads of the step after t = %.9g s could not be announced (looking %.6g s "
                    "ahead: %s); the announced load contains the pending impulse only",
                    setup->t_start + elapsed, h, describe(status).c_str());
      warn_once(i, kWarnedLookAhead, text);
    }
  }
  // After a step much shorter than the others, only a share of the pending impulse is returned.
  const double share = h / std::max(h, coupling.regular_step);
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    const DrivenVehicle& v = coupling.vehicle[i];
    const Wrench<double> impulse =
        share * find_pending_impulse(i, v.predicted) + find_exerted_impulse(i, begin, end);
    mean_load[i] = find_mean_load(impulse, v.predicted,
                                  carry_along(v.predicted, begin.vehicle[i], end.vehicle[i]), h);
  }
}

/// Integrate over h and drop the result; only the arguments change.
/// @param begin, end  of the integration; the same if it failed
Status DockingSim::Impl::look_ahead(double h, CouplingPoint& begin, CouplingPoint& end) {
  keep(*look_ahead_start);
  const Counters counters = find_counters();
  const size_t warned = warnings.size();
  Status status = evaluate_start();
  begin = end = find_coupling_point();
  // Not much more work than the step that was just made.
  std::int64_t limit = find_work_limit(h);
  if (coupling.work > 0) limit = std::min(limit, kWorkAhead * (1000 + coupling.work));
  if (status.ok()) status = is_fixed_step() ? integrate_fixed(h, limit) : integrate(h, limit);
  if (status.ok()) end = find_coupling_point();
  restore(*look_ahead_start);
  set_counters(counters);
  warnings.resize(warned);
  status_text.clear();
  return status;
}

/// Pending impulse if the host's vehicle is at a given state, after the last step.
Wrench<double> DockingSim::Impl::find_pending_impulse(int i, const VehicleState& host) const {
  const DrivenVehicle& v = coupling.vehicle[i];
  if (!(last_step > 0.0)) return v.pending;
  return v.pending - find_delivered_impulse(v.held, v.received, host, last_step);
}

/// Pending impulse at the present communication point: from the motion received since the step, or
/// from the predicted motion.
Wrench<double> DockingSim::Impl::find_pending_impulse(int i) const {
  const DrivenVehicle& v = coupling.vehicle[i];
  const bool is_received =
      !is_same_motion(inputs.vehicle[i], v.input) && is_attitude(inputs.vehicle[i].attitude);
  return find_pending_impulse(i, is_received ? find_received_state(i) : v.predicted);
}

}  // namespace dockloop
