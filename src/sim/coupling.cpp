// The scheme of coupling.hpp in a communication step: the received motion moves the internal
// vehicles, and a look ahead announces loads.
#include "sim/coupling.hpp"

#include <algorithm>
#include <cmath>

#include "docking/base_jump.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr std::int64_t kWorkAhead =
    10;  ///< work of a look ahead, as a multiple of that of the last step

/// Without a jump of the loads, peaks are refined across a communication point.
bool is_same_within_rounding(const std::array<double, kPeakCount>& a,
                             const std::array<double, kPeakCount>& b) {
  constexpr double kRounding = 1e-7;  // of stiff loads
  for (size_t i = 0; i < a.size(); ++i) {
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
      host->note_missing_inputs(i);
      continue;
    }
    status = host->check_received_attitude(i, status_text);
    if (!status.ok()) return status;
    received[i] = true;
    const VehicleState moved = host->receive(i, h);
    set_vehicle_pose(*model, i, moved.x, moved.q, step_loop->y());
  }
  if (grips) {
    // The ring keeps its place on the target. The received motion may have moved the target.
    // One with parts, whose adapter is bent, is never moved by a host.
    const FrameMotion<double> P = find_frame_on(
        get_vehicle_pose<double>(*model, kTarget, step_loop->y()), model->interface_pose[kTarget]);
    const Pose<double> on_target =
        model->target ? capture : Pose<double>{P.R, P.p} * inverse(passive) * capture;
    status = hold_capture_body(*model, on_target, step_loop->y(), present(), *jump_work);
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
  const double energy_after = find_total_energy(*model, present());
  energy_audit.host_work += energy_after - energy_before;
  for (int i : {kChaser, kTarget}) {
    momentum_audit.start[i] += find_momentum(*model, i, present()) - momentum_before[i];
  }
  return host->check_energy(std::min(energy_before, energy_after), energy_audit.host_work,
                            step_loop->y(), status_text);
}

/// Momentum of each internal vehicle = momentum of the host's vehicle + pending impulse. The
/// mechanism follows the new motion of the chaser. The change of its momentum becomes pending, too
/// (receive). Chaser with mechanism therefore get: host + pending + mechanism before.
Status DockingSim::Impl::match_momenta(const std::array<bool, 2>& received,
                                       const FrameMotion<double>& chaser_before,
                                       const Wrench<double>& mechanism_before) {
  for (int i : {kChaser, kTarget}) {
    if (!received[i]) continue;
    const Wrench<double> momentum = host->find_internal_momentum(i);
    if (i == kTarget) {
      set_momentum(*model, i, momentum, step_loop->y());
      continue;
    }
    const Status status = jump_to_momentum(*model, chaser_before, momentum + mechanism_before,
                                           step_loop->y(), present(), *jump_work);
    if (!status.ok()) return status;
  }
  return {};
}

/// Momentum that moves with the chaser, without the vehicle of the host. @pre evaluate
Wrench<double> DockingSim::Impl::find_mechanism_momentum() const {
  return find_momentum(*model, kChaser, present()) -
         host->find_stated_momentum(kChaser, find_vehicle_state(*model, present(), kChaser));
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
  if (!status.ok()) host->warn_of_look_ahead(h, describe(status));
  host->announce(h, begin, end);
}

/// Integrate over h and drop the result; only the arguments change.
/// @param begin, end  of the integration; the same if it failed
Status DockingSim::Impl::look_ahead(double h, CouplingPoint& begin, CouplingPoint& end) {
  keep(*look_ahead_start);
  const Counters counters = step_loop->find_counters();
  const size_t warned = warnings.size();
  Status status = evaluate_start();
  begin = end = find_coupling_point(*model, present(), step_loop->y());
  // Not much more work than the step that was just made.
  std::int64_t limit = step_loop->find_work_limit(h);
  if (coupling.work > 0) limit = std::min(limit, kWorkAhead * (1000 + coupling.work));
  if (status.ok()) {
    step_loop->begin(h);
    status = step_loop->advance(h, limit, false);
  }
  if (status.ok()) end = find_coupling_point(*model, present(), step_loop->y());
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
      find_gap(model->contact, present().relative, present().contact_work));
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
  const HostFinding finding = host->find_diagnosis();
  outputs.coupling_diagnosis = finding.fault;
  outputs.coupling_diagnosis_value = finding.value;
  outputs.coupling_frequency = host->find_interface_frequency(step_loop->y());
  outputs.coupling_suggested_step =
      coupling.follows ? coupling.suggestion
                       : host->find_suggested_step(outputs.coupling_frequency, find_contact_time());
}

}  // namespace dockloop
