// Outputs: from an evaluated state to the variables of the FMU. outputs_body.hpp, compiled for the
// scalars of the core.
#include "sim/outputs.hpp"

#include <algorithm>
#include <cmath>

#include "math/decompositions.hpp"
#include "sim/outputs_body.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {

std::array<double, Outputs::kLoadCount> find_capture_loads(const DockingData<double>& data) {
  return find_load_components(find_capture_load(data));
}

std::array<double, kPeakCount> find_searched_peaks(const DockingModel& model,
                                                   const RatedLoads& rated,
                                                   const DockingData<double>& data) {
  std::array<double, kPeakCount> values{};
  if (!model.present[kTarget]) return values;
  const auto load = find_capture_loads(data);
  std::copy(load.begin(), load.end(), values.begin());
  values[Outputs::kLoadCount] = find_load_ratio(load, rated);
  const size_t surfaces = model.contact.rings ? 0 : model.contact.surfaces.size();
  for (size_t i = 0; i < surfaces; ++i) {
    values[kFirstSurfacePeak + i] = data.contact.surface_force[i].norm();
  }
  return values;
}

std::array<double, kPeakCount> find_peak_values(const DockingModel& model, const RatedLoads& rated,
                                                DockingData<double>& data) {
  std::array<double, kPeakCount> values = find_searched_peaks(model, rated, data);
  const size_t legs = model.mechanism.model.legs.size();
  if (legs > 0) calc_docking_reactions(model, data);
  for (size_t i = 0; i < std::min<size_t>(legs, kMaxLegPeaks); ++i) {
    values[kFirstLegPeak + i] = std::abs(find_leg_force(model, data, i));
  }
  return values;
}

Status DockingSim::Impl::update(OutputGroup group) {
  if (group == OutputGroup::kStateVector) return update_states();
  if (group == OutputGroup::kCoupling) {
    update_coupling();
    return {};
  }
  read_inputs();
  const Status status = evaluate_present();
  if (!status.ok()) return status;
  if (group == OutputGroup::kMain) update_main();
  if (group == OutputGroup::kMomentum) update_momentum();
  if (group == OutputGroup::kLoops) update_loops();
  if (group == OutputGroup::kStack) update_stack();
  return {};
}

/// The simulation time of an event. One at kNoTime itself is an ulp later.
double DockingSim::Impl::tell_time(double since_start) const {
  if (since_start < 0.0) return kNoTime;
  const double time = setup->t_start + since_start;
  return time == kNoTime ? std::nextafter(kNoTime, 0.0) : time;
}

void DockingSim::Impl::update_main() {
  update_due_mean_loads();
  read_outputs<double>(find_source(), outputs);
  outputs.time = setup->t_start + find_point_time();
  // Loads of a pending step are not booked yet, but those of this point have occurred.
  auto peak =
      ahead.pending ? peaks.peak_with(find_point_time(), find_peak_values(shown())) : peaks.peak();
  for (Peak& each : peak) {
    each = each.value > 0.0 ? Peak{each.value, tell_time(each.time), each.step} : Peak{};
  }
  std::copy_n(peak.begin(), static_cast<int>(Outputs::kLoadCount), outputs.capture_peak.begin());
  outputs.capture_peak_load_ratio = peak[Outputs::kLoadCount];
  std::copy_n(peak.begin() + kFirstSurfacePeak, outputs.surface_peak.size(),
              outputs.surface_peak.begin());
  std::copy_n(peak.begin() + kFirstLegPeak, std::min<size_t>(outputs.leg_peak.size(), kMaxLegPeaks),
              outputs.leg_peak.begin());
  update_phase_outputs();
  if (host->has_host()) {
    outputs.coupling_pending_impulse.setZero();
    outputs.coupling_pending_angular_impulse.setZero();
    for (int i : {kChaser, kTarget}) {
      if (!model->driven[i]) continue;
      const Wrench<double> pending = host->find_pending_impulse(i);
      outputs.coupling_pending_impulse += pending.f;
      outputs.coupling_pending_angular_impulse += pending.t;
    }
  }
  const Counters counters = step_loop->find_counters();
  outputs.solver_steps = static_cast<double>(counters.steps);
  outputs.solver_rhs_evaluations = static_cast<double>(counters.rate_evaluations);
  outputs.solver_rejected_steps = static_cast<double>(counters.rejected_steps);
  outputs.solver_singularity_margin = find_singularity_margin(model->mechanism, shown().mechanism);
  outputs.solver_chosen_method = step_loop->method().is_switching && pace.is_implicit
                                     ? kRosenbrock
                                     : step_loop->method().facts->method;
  outputs.solver_chosen_rtol = step_loop->method().is_fixed_step() ? 0.0 : step_loop->method().rtol;
  outputs.solver_chosen_step = step_loop->method().is_fixed_step() ? inner_step : 0.0;
  outputs.solver_error_estimate = measured_error.value_or(chosen.error_estimate);
}

std::string DockingSim::Impl::describe_left_out() const {
  if (!setup || parameters.accuracy == 0.0 || fmi_kind == FmiKind::kModelExchange) return {};
  const double place = kQuiescentPlace * chosen.atol_position;
  Counters counters = step_loop->find_counters();
  if (ahead.pending && discrete.contacted) {  // this step is not booked yet
    counters.left_out.time_since_contact += ahead.reached - ahead.begin;
  }
  return dockloop::describe_left_out(
      {find_point_time(), counters, place, model->contact.pair_count(), points, read_points,
       step_loop->method().is_fixed_step() ? 0.0 : parameters.accuracy});
}

void DockingSim::Impl::update_momentum() {
  read_momentum<double>(find_source(), outputs);
  outputs.momentum_residual =
      std::max(momentum_audit.residual,
               find_momentum_residual(*model, shown(), step_loop->point_y(), momentum_audit));
}

void DockingSim::Impl::update_stack() {
  if (!model->moves[kChaser] || !model->moves[kTarget]) return;
  const VehicleBody stack = find_stack(*model, find_source().data);
  outputs.stack_mass = stack.mass;
  outputs.stack_com = stack.com;
  outputs.stack_inertia = get_components(stack.inertia);
}

void DockingSim::Impl::update_loops() {
  const bool moves = !shown().locked;
  outputs.solver_closure_residual =
      std::max(moves ? find_closure_residual(model->mechanism, shown().mechanism) : 0.0, drift);
}

Status DockingSim::Impl::update_states() {
  const Status status = calc_rates(rates.data());
  if (!status.ok()) return status;
  // Another friction model than the scene's changes the number of bristles, the last states.
  const size_t shared = std::min(rates.size(), outputs.rates.size());
  std::fill(outputs.rates.begin(), outputs.rates.end(), 0.0);
  std::fill(outputs.states.begin(), outputs.states.end(), 0.0);
  std::copy_n(rates.begin(), shared, outputs.rates.begin());
  std::copy_n(step_loop->point_y(), shared, outputs.states.begin());
  return {};
}

namespace {

/// Energy of the springs of parts, and of all rates of a vehicle that stands still [J].
double find_swing_energy(const Mechanism& mechanism, const MechanismData<double>& at) {
  const MechanismModel& tree = mechanism.model;
  double energy = 0.0;
  for (size_t k = tree.forces.size() - tree.part_forces; k < tree.forces.size(); ++k) {
    const double q = at.tree.q[tree.bodies[tree.forces[k].body].q_index];
    energy += 0.5 * tree.forces[k].stiffness * q * q;
  }
  const std::vector<int>& ind = mechanism.plan.ind_v;
  const int n = static_cast<int>(ind.size());
  for (int i = 6; i < n; ++i) {
    for (int j = 6; j < n; ++j) {
      energy += 0.5 * at.A_ind(i, j) * at.tree.v[ind[static_cast<size_t>(i)]] *
                at.tree.v[ind[static_cast<size_t>(j)]];
    }
  }
  return energy;
}

}  // namespace

/// Bound of the change of relative speed by swinging parts of vehicles, before contact [m/s]. Only
/// loads from outside increase the energy of the swing, and the body that carries the hardware has
/// no more than this energy. Its speed may change from one side to the other.
double DockingSim::Impl::find_swing_bound() const {
  double bound = 0.0;
  for (int i : {kChaser, kTarget}) {
    if (scene->parts[i].count_coordinates() == 0) continue;
    const Mechanism& mechanism = i == kTarget ? *model->target : model->mechanism;
    const double energy =
        find_swing_energy(mechanism, i == kTarget ? shown().target->mechanism : shown().mechanism);
    if (!(energy > 0.0)) continue;
    const std::optional<VehiclePart>& adapter = scene->parts[i].adapter;
    double mass = share_without_modes[i] * model->of_host[i].mass,
           moment = share_without_modes[i] * least_inertia[i];
    double arm = parameters.vehicle[i].interface_position.norm();
    if (adapter) {
      mass = adapter->mass;
      arm = (model->interface_on_carrier[i].p - adapter->com).norm();
      const auto turns = [](const PartCoordinate& c) { return c.joint == JointType::kRevolute; };
      if (std::any_of(adapter->coordinates.begin(), adapter->coordinates.end(), turns))
        moment = find_principal_moments(adapter->inertia)[0];
    }
    arm += find_bounding_radius(model->contact, shown().relative);
    bound += 2.0 * std::sqrt(2.0 * energy * (1.0 / mass + arm * arm / moment));
  }
  return bound;
}

/// Bound of the relative acceleration that loads from outside cause between any two points of the
/// capture hardware before contact [m/s2]. Parts may overshoot, to twice the acceleration.
double DockingSim::Impl::find_acceleration_bound() const {
  double bound = model->falling ? 0.0 : loads.at_start().gravity.norm();
  for (int i : {kChaser, kTarget}) {
    if (!model->moves[i]) continue;
    const VehicleParameters& p = parameters.vehicle[i];
    const double arm =
        p.interface_position.norm() + find_bounding_radius(model->contact, shown().relative);
    const double overshoot =
        (scene->parts[i].count_coordinates() > 0 ? 2.0 : 1.0) / share_without_modes[i];
    if (model->record[i] >= 0) {
      const InputHistory& record = model->inputs[static_cast<size_t>(model->record[i])];
      bound += overshoot * (record.acceleration + record.angular_acceleration * arm);
      continue;
    }
    const double mass = model->of_host[i].mass;
    bound += overshoot * (loads.at_start().force[i].norm() / mass +
                          loads.at_start().torque[i].norm() * arm / least_inertia[i]);
    if (i == kChaser) bound += overshoot * (shown().thrust.norm() / mass);
  }
  const int ring = model->mechanism.model.capture_body;
  if (ring != kBase && ring != model->mechanism.vehicle) {
    const double mass = model->mechanism.model.bodies[ring].mass;
    const int forces = static_cast<int>(model->mechanism.model.forces.size());
    if (mass > 0.0) bound += loads.at_start().command.head(forces).lpNorm<1>() / mass;
  }
  return bound;
}

/// Lower bound of the time until surfaces touch [s]. @param gap  of find_gap() [m]
double DockingSim::Impl::find_earliest_contact(double gap) const {
  const double speed = find_approach_bound(model->contact, shown().relative) + find_swing_bound();
  return find_time_to_contact(gap, speed, find_acceleration_bound());
}

void DockingSim::Impl::update_phase_outputs() {
  outputs.time_to_contact = kNever;
  if (has_surfaces()) outputs.time_to_contact = find_earliest_contact(outputs.gap);
  for (int i = 0; i < model->latches.count(); ++i) {
    outputs.latched[i] = discrete.latch[i].mode == LatchMode::kHeld ? 1 : 0;
    outputs.latch_state[i] = events->find_latch_report(shown(), i);
  }
  const PhaseInputs in = events->find_phase_inputs(shown(), outputs.gap);
  if (ahead.pending) {
    discrete_inside = discrete;
    events->update_phases(in, find_point_time(), discrete_inside);
  }
  const DiscreteState& there = ahead.pending ? discrete_inside : discrete;
  outputs.capture_reason = find_capture_reason(in, there);
  outputs.seated_time = there.seated_time;
  outputs.sequence_step = discrete.sequence.step + 1;
  outputs.sequence_time_in_step = 0.0;
  const auto report = [this](double since_start) { return tell_time(since_start); };
  if (events->sequence().exists()) {
    outputs.sequence_time_in_step = events->sequence().find_time_in_step(find_point_time());
    std::transform(discrete.entered.begin(), discrete.entered.end(),
                   outputs.sequence_entered.begin(), report);
  }
  outputs.hooks_closed = count_closed_hooks(model->hard_dock, discrete.hard_dock);
  outputs.joint_rigid = discrete.hard_dock.joint.on;
  outputs.phase = there.phase;
  outputs.outcome = there.outcome;
  outputs.captured = discrete.captured;
  outputs.time_of_contact = report(discrete.time_of_contact);
  outputs.time_of_capture = report(discrete.time_of_capture);
  LimitRecord passed = limits;
  if (ahead.pending) {
    const LimitValues found =
        find_limit_values(*model, shown(), outputs.capture_peak_load_ratio.value);
    limits.for_each_new(
        found, [&](Limit which) { passed.add(which, find_point_time(), found.value[which]); });
  }
  outputs.limits_exceeded = passed.find_bits();
  outputs.limits.value = passed.value;
  std::transform(passed.time.begin(), passed.time.end(), outputs.limits.time.begin(), report);
}

}  // namespace dockloop
