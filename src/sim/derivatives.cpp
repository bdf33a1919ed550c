// Derivatives of outputs and rates along directions in inputs, states and time, by dual numbers.
// The dependencies of outputs on inputs and states follow from these derivatives.
#include <algorithm>
#include <cmath>
#include <random>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

/// The motion of a driven vehicle takes effect at the next step, and coupling.next_step in the one
/// after: no output depends on these inputs yet.
std::vector<DerivativePass::Cell> link_inputs(const Inputs& inputs, const MechanismModel& mechanism,
                                              ExternalLoads<Derivative>& loads) {
  std::vector<DerivativePass::Cell> cells;
  Inputs place = inputs;  // every value becomes its place
  for_each_value(place, [&](double& value) {
    value = static_cast<double>(cells.size());
    cells.emplace_back();
  });
  const auto link = [&](double at, Derivative& value, double factor = 1.0) {
    cells[static_cast<size_t>(at)] = {&value, factor};
  };
  for (int j = 0; j < 3; ++j) {
    for (int i : {kChaser, kTarget}) {
      link(place.vehicle[i].force_ext[j], loads.force[i][j]);
      link(place.vehicle[i].torque_ext[j], loads.torque[i][j]);
    }
    link(place.gravity[j], loads.gravity[j]);
  }
  for (size_t k = 0; k < mechanism.legs.size(); ++k) {
    const Leg& leg = mechanism.legs[k];
    link(place.leg_force_command[k], loads.command[leg.force], leg.arm);
  }
  for (size_t k = 0; k < mechanism.elements.size(); ++k) {
    link(place.element_command[k],
         loads.command[static_cast<Eigen::Index>(mechanism.forces.size() + k)]);
  }
  return cells;
}

}  // namespace

/// Values of the present state, without variation. @post data is evaluated
Status DockingSim::Impl::start_pass() {
  read_inputs();
  const Status status = evaluate_point(false);  // a load would end the quiescent state
  if (!status.ok()) return status;
  if (!derivative_pass || derivative_pass->coordinates != coordinates) {
    derivative_pass = std::make_unique<DerivativePass>(*model);
    derivative_pass->coordinates = coordinates;
    derivative_pass->input_cells =
        link_inputs(inputs, model->mechanism.model, derivative_pass->docking.loads);
    OutputValues<Derivative>& out = derivative_pass->output;
    set_sizes(list_sizes, out);
    for_each_value(out, [this](Derivative& cell) {
      cell = Derivative(0.0);
      derivative_pass->output_cells.push_back(&cell);
    });
  }
  start_docking_pass(*model, loads.at_start(), find_point_time(), step_loop->point_y(),
                     derivative_pass->docking);
  derivative_pass->frame_velocity = frame_velocity.cast<Derivative>();
  derivative_pass->frame_shift = frame_shift.cast<Derivative>();
  return {};
}

void DockingSim::Impl::seed(const Seed& seed, int lane) {
  DockingPass& pass = derivative_pass->docking;
  const auto add = [&](Derivative& to, double factor = 1.0) { to.d[lane] += factor * seed.weight; };
  if (seed.of == Seed::Of::kState) {
    // Bristles that the friction model does not use have no effect.
    if (static_cast<size_t>(seed.place) < pass.y.size())
      add(pass.y[static_cast<size_t>(seed.place)]);
    return;
  }
  const DerivativePass::Cell& cell = derivative_pass->input_cells[static_cast<size_t>(seed.place)];
  if (cell.value) add(*cell.value, cell.factor);
}

Status DockingSim::Impl::finish_pass() {
  DerivativePass& pass = *derivative_pass;
  const Status status = calc_docking_pass(*model, discrete, memory, shown(), pass.docking);
  if (!status.ok()) return status;
  const OutputSource<Derivative> source = make_output_source<Derivative>(
      pass.docking.data, pass.docking.y.data(), pass.frame_velocity, pass.frame_shift);
  read_outputs<Derivative>(source, pass.output);
  read_momentum<Derivative>(source, pass.output);
  return {};
}

Status DockingSim::calc_directional_derivative(const std::vector<Seed>& direction) {
  const Status status = impl_->start_pass();
  if (!status.ok()) return status;
  for (const Seed& seed : direction) impl_->seed(seed, 0);
  return impl_->finish_pass();
}

Status DockingSim::calc_time_derivative() {
  Impl& me = *impl_;
  const Status status = me.start_pass();
  if (!status.ok()) return status;
  const Status states = update(OutputGroup::kStateVector);
  if (!states.ok()) return states;
  DerivativePass& pass = *me.derivative_pass;
  pass.docking.t.d[0] = 1.0;
  for (size_t i = 0; i < me.rates.size(); ++i) pass.docking.y[i].d[0] = me.rates[i];
  for (int j = 0; j < 3; ++j) {
    pass.frame_shift[j].d[0] = me.frame_velocity[j];
    if (me.model->falling) pass.frame_velocity[j].d[0] = me.loads.at_start().gravity[j];
  }
  int place = 0;
  for_each_value(me.slopes, [&](double& slope) {
    if (slope != 0.0) me.seed({Seed::Of::kInput, place, slope}, 0);
    ++place;
  });
  return me.finish_pass();
}

double DockingSim::output_derivative(int place) const {
  return impl_->derivative_pass->output_cells[static_cast<size_t>(place)]->d[0];
}

double DockingSim::rate_derivative(int place) const {
  const std::vector<Derivative>& ydot = impl_->derivative_pass->docking.ydot;
  return static_cast<size_t>(place) < ydot.size() ? ydot[static_cast<size_t>(place)].d[0] : 0.0;
}

// ---------------------------------------------------------------- dependencies

/// A random state near the present state, with capture surfaces in contact if possible.
void DockingSim::Impl::spread_states(std::mt19937_64& random) {
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  double* y = step_loop->y();
  const StateLayout& layout = model->layout;
  const auto vary = [&](int first, int count, double by) {
    for (int i = first; i < first + count; ++i) y[i] += by * any(random);
  };
  vary(layout.mechanism_q, layout.mechanism_nq, 3e-3);
  vary(layout.mechanism_v, layout.mechanism_nv, 3e-2);
  vary(layout.target_q, layout.target_n, 3e-3);
  vary(layout.target_v, layout.target_n, 3e-2);
  for (int i : {kChaser, kTarget}) {
    if (layout.pose[i] < 0) continue;
    const double mass = parameters.vehicle[i].mass;
    vary(layout.pose[i], 3, 0.3);
    vary(layout.pose[i] + 3, 4, 0.3);
    vary(layout.momentum[i], 6, 0.03 * mass);
  }
  vary(layout.sums, layout.sum_count + 6, 1.0);
  vary(layout.element_bristles, layout.element_bristle_count, 1e-5);
  vary(layout.bristles, layout.bristle_count, 1e-5);
  const int moved = layout.pose[kTarget] >= 0 ? kTarget : kChaser;
  if (!has_surfaces() || layout.pose[moved] < 0 || !evaluate(0.0).ok()) return;
  // Bring the docking interfaces together, within millimetres and degrees.
  Pose<double> G_P;
  G_P.p = Vec3<double>(0.01 * any(random), 0.02 * any(random), 0.02 * any(random));
  G_P.R = quat_to_matrix<double>(
      quat_exp<double>(Vec3<double>(0.02 * any(random), 0.02 * any(random), 0.02 * any(random))));
  const Pose<double> G{present().capture.R, present().capture.p};
  const Pose<double> P{present().interface[kTarget].R, present().interface[kTarget].p};
  const FrameMotion<double>& body = present().vehicle[moved];
  const Pose<double> at{body.R, body.p};
  const Pose<double> wanted =
      moved == kTarget ? G * G_P * inverse(P) * at : P * inverse(G_P) * inverse(G) * at;
  const Vec4<double> q = quat_from_matrix<double>(wanted.R);
  for (int j = 0; j < 3; ++j) y[layout.pose[moved] + j] = wanted.p[j];
  for (int j = 0; j < 4; ++j) y[layout.pose[moved] + 3 + j] = q[j];
}

/// Mark the dependencies with a derivative at the present state.
void DockingSim::Impl::add_dependencies(Dependencies& found) {
  std::vector<Seed> knowns;
  int inputs_count = 0;
  for_each_value(inputs,
                 [&](double&) { knowns.push_back({Seed::Of::kInput, inputs_count++, 1.0}); });
  // Entries are compared in units of the accuracy of states.
  const std::vector<double> scale = find_absolute_tolerances();
  for (int i = 0; i < state_count; ++i) knowns.push_back({Seed::Of::kState, i, scale[i] * 1e6});
  const size_t outputs_count = found.output.size(), unknowns = outputs_count + found.rate.size();
  MatX<double> J(unknowns, knowns.size());
  for (size_t first = 0; first < knowns.size(); first += kLanes) {
    if (!start_pass().ok()) return;
    const size_t count = std::min<size_t>(kLanes, knowns.size() - first);
    for (size_t k = 0; k < count; ++k) seed(knowns[first + k], static_cast<int>(k));
    if (!finish_pass().ok()) return;
    for (size_t i = 0; i < unknowns; ++i) {
      const Derivative& cell = i < outputs_count ? *derivative_pass->output_cells[i]
                                                 : derivative_pass->docking.ydot[i - outputs_count];
      for (size_t k = 0; k < count; ++k) J(i, first + k) = cell.d[k];
    }
  }
  constexpr double kRounding = 1e-13;  // of the largest entry of a row
  for (size_t i = 0; i < unknowns; ++i) {
    const double least = kRounding * J.row(i).lpNorm<Eigen::Infinity>();
    Dependencies::Row& row = i < outputs_count ? found.output[i] : found.rate[i - outputs_count];
    for (size_t k = 0; k < knowns.size(); ++k) {
      if (!(std::abs(J(i, k)) > least)) continue;
      (knowns[k].of == Seed::Of::kInput ? row.input
                                        : row.state)[static_cast<size_t>(knowns[k].place)] = 1;
    }
  }
}

Dependencies DockingSim::find_dependencies() {
  Impl& me = *impl_;
  SavedSim present;
  save(present);
  size_t input_count = 0, output_count = 0;
  for_each_value(me.inputs, [&](double&) { ++input_count; });
  for_each_value(static_cast<OutputValues<double>&>(me.outputs), [&](double&) { ++output_count; });
  const Dependencies::Row none{std::vector<char>(input_count, 0),
                               std::vector<char>(static_cast<size_t>(me.state_count), 0)};
  Dependencies found;
  found.output.assign(output_count, none);
  found.rate.assign(static_cast<size_t>(me.state_count), none);

  std::mt19937_64 random(20180713);
  constexpr int kStates = 48;
  for (int sample = 0; sample < kStates; ++sample) {
    load(present);
    std::uniform_real_distribution<double> any(-1.0, 1.0);
    for_each_value(me.inputs, [&](double& value) { value += any(random); });
    if (sample > 0) me.spread_states(random);
    me.memory = ContactMemory();
    if (sample % 2) me.parameters.contact_thrust = 100.0;
    me.adopt_tunables();
    if (!me.model->forces.empty()) {
      const auto changed = std::make_shared<DockingModel>(*me.model);
      make_forces_felt(changed->forces);
      me.use_model(changed);
    }
    me.discrete.thrust_on = sample % 2 != 0;
    for (LatchState& latch : me.discrete.latch) {
      latch.mode = static_cast<LatchMode>(1 + sample % 4);
      latch.release_time = me.elapsed - 0.01;
    }
    for (HookRowState& row : me.discrete.hard_dock.row) {
      row = {static_cast<HookMode>(1 + sample % 4), me.elapsed - 0.01, 0.0};
    }
    const bool can_join = !me.model->hard_dock.empty() && !me.find_joint_obstacle();
    if (can_join && sample % 3 == 1 && me.evaluate(0.0).ok()) me.join_rigidly(0.0);
    me.add_dependencies(found);
  }
  load(present);
  return found;
}

}  // namespace dockloop
