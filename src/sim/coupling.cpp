// The scheme of coupling.hpp in a communication step: the received motion moves the internal
// vehicles, and a look ahead announces loads.
#include "sim/coupling.hpp"

#include <algorithm>
#include <cmath>

#include "docking/base_jump.hpp"
#include "math/decompositions.hpp"
#include "sim/sim_impl.hpp"
#include "sim/start_checks.hpp"

namespace dockloop {
namespace {

constexpr std::int64_t kWorkAhead =
    10;  ///< work of a look ahead, as a multiple of that of the last step

/// Without a jump of the loads, peaks are refined across a communication point.
bool is_same_within_rounding(const std::array<double, kPeakCount>& a,
                             const std::array<double, kPeakCount>& b) {
  constexpr double kRounding = 1e-7;  // of stiff loads
  for (size_t i = 0; i < kFirstLegPeak; ++i) {
    if (std::abs(a[i] - b[i]) > kRounding * std::max(std::abs(a[i]), std::abs(b[i]))) return false;
  }
  return true;
}

}  // namespace

/// Receive the motion of driven vehicles at the start of a step of h.
Status DockingSim::Impl::receive(double h) {
  if (!host->has_host()) return {};
  Status status = evaluate(0.0);
  if (!status.ok()) return status;
  const bool first = !(last_step > 0.0);
  const double energy_before = find_total_energy(*model, present());
  const Pose<double> capture{present().capture.R, present().capture.p};
  const Pose<double> passive{present().interface[kTarget].R, present().interface[kTarget].p};
  const std::array<FrameMotion<double>, 2> before = present().vehicle;
  std::array<Wrench<double>, 2> momentum_before;
  for (int i : {kChaser, kTarget}) momentum_before[i] = find_momentum(*model, i, present());
  const std::array<Wrench<double>, 2> carried_before = find_carried_momenta();
  const std::array<double, kPeakCount> loads_before = find_searched_peaks();
  const bool grips =
      (has_surfaces() && present().contact.gap <= 0.0) || events->count_held_latches() > 0;

  std::array<bool, 2> received{false, false};
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    if (first && is_all_zero(inputs.vehicle[i])) {
      host->note_missing_inputs(i);
      continue;
    }
    status = host->check_received_attitude(i, status_text);
    if (!status.ok()) return status;
    received[i] = true;
    const VehicleState moved = host->receive(i, h);
    set_vehicle_pose(*model, i, moved.x, moved.q, step_loop->y());
  }
  if (use_host_bodies()) kept_jacobian.valid = false;
  if (grips) {
    // The ring keeps its place on the target. The received motion may have moved the target.
    Pose<double> P_in_D = model->interface_pose[kTarget];
    if (model->target) {
      P_in_D = inverse(Pose<double>{before[kTarget].R, before[kTarget].p}) * passive;
    }
    const FrameMotion<double> P =
        find_frame_on(get_vehicle_pose<double>(*model, kTarget, step_loop->y()), P_in_D);
    const Pose<double> on_target = Pose<double>{P.R, P.p} * inverse(passive) * capture;
    status = hold_capture_body(*model, on_target, step_loop->y(), present(), *jump_work);
    if (!status.ok()) return status;
  }
  status = match_momenta(received, before, carried_before);
  if (!status.ok()) return status;
  status = evaluate(0.0);
  if (!status.ok()) return status;
  const std::array<Wrench<double>, 2> carried = find_carried_momenta();
  for (int i : {kChaser, kTarget}) {
    if (received[i]) coupling.vehicle[i].pending += carried_before[i] - carried[i];
  }
  // The jump may begin a contact, and its forces count as peaks.
  update_memory();
  status = decide_absorber();
  if (!status.ok()) return status;
  if (has_surfaces() && !discrete.contacted && present().contact.gap <= 0.0)
    events->begin_contact(elapsed);
  if (!is_same_within_rounding(loads_before, find_searched_peaks())) {
    peaks.begin(elapsed, find_peak_values());
  }
  // The correction by the host counts as its work and impulse, not as an integration error.
  const double energy_after = find_total_energy(*model, present());
  energy_audit.host_work += energy_after - energy_before;
  for (int i : {kChaser, kTarget}) {
    momentum_audit.start[i] += find_momentum(*model, i, present()) - momentum_before[i];
  }
  status = host->check_modes(step_loop->y(), status_text);
  if (!status.ok()) return status;
  return host->check_energy(std::min(energy_before, energy_after), energy_audit.host_work,
                            step_loop->y(), status_text);
}

/// Momentum of each internal vehicle = momentum of the host's vehicle + pending impulse. Mechanism
/// and parts follow the new motion of their vehicle. The change of their momentum becomes pending,
/// too (receive). A vehicle with what it carries therefore gets: host + pending + carried before.
Status DockingSim::Impl::match_momenta(const std::array<bool, 2>& received,
                                       const std::array<FrameMotion<double>, 2>& before,
                                       const std::array<Wrench<double>, 2>& carried_before) {
  for (int i : {kChaser, kTarget}) {
    if (!received[i]) continue;
    const Wrench<double> momentum = host->find_internal_momentum(i) + carried_before[i];
    const Status status =
        jump_to_momentum(*model, i, before[i], momentum, step_loop->y(), present(), *jump_work);
    if (!status.ok()) return status;
  }
  return {};
}

/// Does a parameter state another mass of a driven vehicle than before?
bool DockingSim::Impl::is_mass_new(int i) const {
  return model->driven[i] &&
         !is_same_body(host->find_stated_body(i, parameters), coupling.vehicle[i].stated);
}

/// Another stated mass of a driven vehicle is a fact: the vehicle keeps its motion.
/// @throws ModelError if it cannot be used
void DockingSim::Impl::use_stated_masses() {
  if (!is_mass_new(kChaser) && !is_mass_new(kTarget)) return;
  for (int i : {kChaser, kTarget}) {
    if (!is_mass_new(i)) continue;
    const std::string name = get_vehicle_name(i);
    check_mass(parameters.vehicle[i], name);
    const VehicleBody stated = host->find_stated_body(i, parameters);
    check_modes(stated, scene->parts[i], name);
    if (i == kChaser && !can_be_rigid(find_bare_vehicle(stated, model->frozen))) {
      throw ModelError(name + ".mass or " + name +
                       ".inertia is less than that of the mechanism it is said to include "
                       "(chaser.mass_includes_mechanism = 2)");
    }
  }
  if (!evaluate(0.0).ok()) throw ModelError("mass and inertia cannot be changed here");
  const double energy_before = find_total_energy(*model, present());
  std::array<Wrench<double>, 2> before;
  std::array<VehicleState, 2> vehicle;
  for (int i : {kChaser, kTarget}) {
    vehicle[i] = find_vehicle_state(*model, present(), i);
    before[i] = host->find_host_momentum(i, vehicle[i]);
    if (is_mass_new(i)) host->restate(i, host->find_stated_body(i, parameters));
  }
  use_host_bodies();
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    const Wrench<double> added = host->find_host_momentum(i, vehicle[i]) - before[i];
    double* momentum = step_loop->y() + model->layout.momentum[i];
    Eigen::Map<Vec3<double>>(momentum) += added.f;
    Eigen::Map<Vec3<double>>(momentum + 3) += added.t;
    momentum_audit.start[i] += added;
  }
  if (!evaluate(0.0).ok()) throw ModelError("mass and inertia cannot be changed here");
  energy_audit.host_work += find_total_energy(*model, present()) - energy_before;
}

/// Bodies of driven vehicles of the state, into the model. @return whether one is another
bool DockingSim::Impl::use_host_bodies() {
  bool changed = false;
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    const VehicleBody& body = coupling.vehicle[i].body;
    if (is_same_body(body, model->of_host[i])) continue;
    set_host_body(*model, i, body);
    note_body(i, body);
    changed = true;
  }
  if (!changed) return false;
  evaluator->use_vehicle_bodies();
  quiescent_mode->use_vehicle_bodies();
  return true;
}

/// Momentum that moves with each vehicle, without the vehicle of the host. @pre evaluate
std::array<Wrench<double>, 2> DockingSim::Impl::find_carried_momenta() const {
  std::array<Wrench<double>, 2> carried;
  for (int i : {kChaser, kTarget}) {
    if (i == kTarget && !model->target) continue;
    carried[i] = find_momentum(*model, i, present()) -
                 host->find_host_momentum(i, find_vehicle_state(*model, present(), i));
  }
  return carried;
}

/// Announce the loads of the coming step, which is expected to be h: future loads over the step,
/// and the pending impulse. @pre inputs are read
void DockingSim::Impl::announce(double h) {
  CouplingPoint now, begin, end;
  Status status = look_ahead(h, now, begin, end);
  if (!status.ok() && last_step > 0.0 && h > last_step) {
    h = last_step;
    status = look_ahead(h, now, begin, end);
  }
  if (!status.ok()) host->warn_of_look_ahead(h, describe(status));
  host->announce(h, now, begin, end);
}

/// Integrate until announced loads act, then over h, and drop the result; only the arguments
/// change. @param now, begin, end  of both integrations; the same if they failed
Status DockingSim::Impl::look_ahead(double h, CouplingPoint& now, CouplingPoint& begin,
                                    CouplingPoint& end) {
  keep(*look_ahead_start);
  const Counters counters = step_loop->find_counters();
  const size_t warned = warnings.size();
  Status status = evaluate_start();
  now = find_coupling_point(*model, present(), step_loop->y());
  const auto advance = [&](double length, CouplingPoint& point) {
    // Not much more work than the step that was just made.
    std::int64_t limit = step_loop->find_work_limit(length);
    const double steps = last_step > 0.0 ? std::max(1.0, std::ceil(length / last_step)) : 1.0;
    if (coupling.work > 0) {
      limit =
          std::min(limit, static_cast<std::int64_t>(steps) * kWorkAhead * (1000 + coupling.work));
    }
    step_loop->begin(length);
    Status made = step_loop->advance(length, limit, false);
    if (made.ok()) point = find_coupling_point(*model, present(), step_loop->y());
    return made;
  };
  begin = now;
  const double lead = host->find_lead();
  if (status.ok() && lead > 0.0) {
    status = advance(lead, begin);
    elapsed += lead;
    evaluator->forget_present();
    if (status.ok()) status = evaluate_start();
  }
  end = begin;
  if (status.ok()) status = advance(h, end);
  if (!status.ok()) begin = end = now;
  restore(*look_ahead_start);
  step_loop->set_counters(counters);
  warnings.resize(warned);
  status_text.clear();
  return status;
}

/// Lower bound of the time until first contact [s]; no bound after it.
double DockingSim::Impl::find_contact_time() const {
  if (discrete.contacted || !has_surfaces()) return kNever;
  return find_earliest_contact(
      find_gap(model->contact, memory, present().relative, present().contact_work));
}

/// A host that changes its step to the suggested step follows suggestions. The suggestion depends
/// on the state alone, not on getter calls.
void DockingSim::Impl::notice_step(double h) {
  constexpr double kSame = 1e-6;
  if (!(last_step > 0.0)) return;
  double suggested = coupling.suggestion;
  if (!coupling.follows) {
    if (h == last_step || !evaluate(0.0).ok()) return;
    suggested = host->find_suggested_step(host->find_interface_frequency(step_loop->y()),
                                          find_contact_time());
  }
  coupling.follows = std::abs(h - suggested) <= kSame * suggested;
}

/// Step of the announced loads: the step of the host's input, the suggested step if the host
/// follows suggestions, or the last step. Updates the suggestion.
double DockingSim::Impl::update_expected_step() {
  if (inputs.next_step > 0.0) return inputs.next_step;
  if (!coupling.follows || !evaluate(0.0).ok()) return last_step;
  coupling.suggestion = host->find_suggested_step(host->find_interface_frequency(step_loop->y()),
                                                  find_contact_time());
  return coupling.suggestion;
}

/// @pre update_main
void DockingSim::Impl::update_coupling() {
  if (!host->has_host()) return;
  outputs.coupling_work_residual = coupling.work_residual;
  outputs.coupling_mass_mismatch = 0.0;
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    const double mismatch = host->find_mass_mismatch(i);
    if (std::abs(mismatch) > std::abs(outputs.coupling_mass_mismatch)) {
      outputs.coupling_mass_mismatch = mismatch;
    }
  }
  const DrivenVehicle& shown = coupling.vehicle[host->find_shown_vehicle()];
  outputs.coupling_diagnosis = shown.finding.fault;
  outputs.coupling_diagnosis_value = shown.finding.value;
  outputs.coupling_body = find_estimated_body(shown.stated, shown.estimate);
  outputs.coupling_inertia = get_components(outputs.coupling_body.inertia);
  outputs.coupling_deviations = find_mass_deviations(shown.stated, shown.estimate);
  outputs.coupling_frequency = host->find_interface_frequency(step_loop->y());
  outputs.coupling_largest_delay = host->find_largest_delay();
  outputs.coupling_suggested_step =
      coupling.follows ? coupling.suggestion
                       : host->find_suggested_step(outputs.coupling_frequency, find_contact_time());
}

}  // namespace dockloop
