// The same equations for a host that integrates all states (FMI for model exchange).
//
// The host sets time and states, reads rates, and reports accepted states. Between events, accepted
// states change only the data that guide the search for contacts and loops. All changes of the
// equations happen in update_discrete_states(). Frame O drifts with constant velocity and does not
// fall here, so frame O is a function of time alone.
#include <algorithm>
#include <cmath>

#include "sim/sim_impl.hpp"

namespace dockloop {

int DockingSim::state_count() const { return impl_->state_count; }

int DockingSim::indicator_count() const {
  const Scene& scene = *impl_->scene;
  const int hooks = scene.hard_dock.hooks.rows.empty() ? 0 : 1;
  const int pushers = scene.hard_dock.pusher_count() > 0 ? kPusherRoots : 0;
  return kFixedRoots + 2 * scene.latches.count() + hooks + count_rows(scene.sequence) + pushers;
}

void DockingSim::set_time(double t) {
  Impl& me = *impl_;
  me.elapsed = t - me.setup->t_start;
  me.frame_shift = me.frame_velocity * me.elapsed;
  me.invalidate();
}

void DockingSim::set_states(const double* y) {
  if (const std::string name = impl_->find_other_attitude(y, has_direction); !name.empty()) {
    throw ModelError("the quaternion of the attitude of " + name +
                     " is nearly zero: its norm must be near 1");
  }
  std::copy(y, y + impl_->state_count, impl_->step_loop->y());
  impl_->invalidate();
}

void DockingSim::get_states(double* y) const {
  std::copy(impl_->step_loop->y(), impl_->step_loop->y() + impl_->state_count, y);
}

/// Relative tolerance of the solver times nominal value = absolute tolerance of the scene.
void DockingSim::get_nominals(double* nominal) const {
  for (const double atol : impl_->find_absolute_tolerances()) {
    *nominal++ = atol / impl_->chosen.rtol;
  }
}

Status DockingSim::get_rates(double* ydot) {
  impl_->evaluator->count(1);
  impl_->valid[static_cast<size_t>(OutputGroup::kMain)] = false;  // it has the count
  return impl_->calc_rates(ydot);
}

Status DockingSim::Impl::calc_rates(double* ydot) {
  read_inputs();
  Status status = balance_point();
  if (status.ok()) status = evaluator->aside(ahead.reached, step_loop->point_y(), ydot);
  if (!status.ok()) return status;
  const bool finite =
      std::all_of(ydot, ydot + model->layout.size, [](double rate) { return std::isfinite(rate); });
  return finite ? Status() : Status{StatusCode::kNotFinite, -1, 0.0, elapsed};
}

Status DockingSim::get_indicators(double* indicator) {
  Impl& me = *impl_;
  me.read_inputs();
  const Status status = me.evaluator->aside(0.0, me.step_loop->y(), nullptr);
  if (!status.ok()) return status;
  // A host sees signs at the ends of its steps only. Each condition for a catch has its own
  // indicator, so two sign changes within one step are not missed.
  double roots[kMaxRoots];
  me.events->calc_functions(me.trial(), roots);
  if (!me.events->sequence().exists()) {
    const double gap = me.events->find_near_gap(me.trial());
    roots[2] = find_phase_indicator(me.events->find_phase_inputs(me.trial(), gap), me.discrete);
  }
  std::copy_n(roots, kFixedRoots, indicator);
  for (int i = 0; i < me.model->latches.count(); ++i) {
    const LatchMotion motion = find_latch_motion(me.model->latches, i, me.trial().relative);
    const std::array<double, 2> both = find_conditions(
        me.model->latches.latch[i].law, me.discrete.latch[i], motion, roots[kFixedRoots + i]);
    std::copy(both.begin(), both.end(), indicator + kFixedRoots + 2 * i);
  }
  std::copy(roots + me.events->hook_root(), roots + me.events->root_count(),
            indicator + kFixedRoots + 2 * me.model->latches.count());
  return {};
}

Status DockingSim::complete_step(bool& event_due) {
  Impl& me = *impl_;
  me.read_inputs();
  const Status status = me.evaluate(0.0);
  if (!status.ok()) return status;
  me.step_loop->count_step();
  me.keep_pose();
  // Bristles of open pairs decay by their rates; setting them to zero would be an event.
  if (me.has_surfaces()) {
    update_contact_memory(me.model->contact, me.present().relative, nullptr,
                          me.present().contact_work, me.memory);
  }
  me.balances->update_energy(me.balances->find_energy(*me.model, me.present(), me.step_loop->y()),
                             0.0);
  me.peaks.add(me.elapsed, me.find_peak_values());
  me.watch_limits(me.elapsed);
  me.balances->update_momentum(*me.model, me.present(), me.step_loop->y());
  if (find_singularity_margin(me.model->mechanism, me.present().mechanism) >= kChangeMargin) {
    me.margin_looked_at = kChangeMargin;
  }
  event_due = me.is_event_due();
  me.invalidate();
  return {};
}

/// Would update_discrete_states() change anything here? @pre evaluate(0)
bool DockingSim::Impl::is_event_due() const {
  const double margin = find_singularity_margin(model->mechanism, present().mechanism);
  return events->is_change_due(present(), elapsed, find_clock_rounding(elapsed)) ||
         (!present().locked && margin < kChangeMargin && margin <= kLookAgain * margin_looked_at);
}

Status DockingSim::update_discrete_states(EventUpdate& update) {
  Impl& me = *impl_;
  update = EventUpdate();
  me.read_inputs();
  const std::shared_ptr<const Coordinates> coordinates = me.coordinates;
  me.step_loop->accept_state();
  me.events->sequence().update_command(me.inputs.command, me.elapsed);
  if (me.inputs.hard_dock_command != static_cast<int>(me.discrete.hard_dock.command)) {
    Status status = me.evaluate(0.0);
    if (status.ok()) status = me.update_hard_dock_command();
    if (!status.ok()) return status;
  }
  // An event may cause the next event.
  constexpr int kPasses = 8;
  for (int pass = 0; pass < kPasses; ++pass) {
    Status status = me.evaluate(0.0);
    if (!status.ok()) return status;
    me.events->set_due_below(me.present(), kTouching);
    bool changed = false;
    status = me.accept(0.0, changed);
    if (!status.ok()) return status;
    if (!me.is_event_due()) break;
  }
  me.invalidate();
  update.nominals_changed = me.coordinates != coordinates;
  update.states_changed = update.nominals_changed || !me.step_loop->is_at_accepted_state();
  double next = me.events->sequence().find_next_time(me.elapsed);
  const std::optional<double> onset = me.events->find_thrust_onset();
  if (onset && !me.events->is_thrust_due(me.elapsed, me.find_clock_rounding(me.elapsed))) {
    next = std::min(next, *onset);
  }
  next = std::min(next, me.events->find_next_disturbance(me.elapsed));
  next = std::min(next, me.events->find_next_input());
  next = std::min(next, find_next_failure(me.model->mechanism.model.failures,
                                          me.discrete.entered.data(), me.elapsed));
  next = std::min(
      next,
      find_next_ramp(me.model->hard_dock, me.discrete.hard_dock, me.elapsed).value_or(kNever));
  update.next_time_defined = next < kNever;
  if (update.next_time_defined) update.next_time = me.setup->t_start + next;
  return {};
}

}  // namespace dockloop
