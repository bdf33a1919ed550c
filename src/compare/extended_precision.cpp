// A DockingSim that integrates with 32 digits: events, latches, peaks and audits are its own, in
// double; rates, event functions, the method and the continuous outputs are those of the reference
// solution.
//
// Discrete decisions stay in double: which pairs of surfaces are near, and on which branch the
// loops are (their reference pose). Values do not depend on the digits of either.
#include "compare/extended_solver.hpp"
#include "math/dock_assert.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {

struct ExtendedEquations {
  ExtendedSolver* solver = nullptr;  ///< the stepper owns it
  std::unique_ptr<DockingData<Extended>> data;
  std::shared_ptr<const Coordinates> coordinates;  ///< that data was made for
  ExternalLoads<Extended> loads;
  OutputValues<Extended> output;
  std::vector<const Extended*> output_cells;  ///< as for_each_value() counts them
};

namespace {

constexpr double kRootTolerance = 4e-16;  ///< resolution of the time

void copy_reference(const LoopReference<double>& from, LoopReference<Extended>& to) {
  to.valid = from.valid;
  to.q = from.q.cast<Extended>();
  for (size_t b = 0; b < from.H.size(); ++b) to.H[b] = from.H[b].cast<Extended>();
  to.sign = from.sign;
  to.margin = from.margin;
  to.branch = from.branch;
  to.spin_branch = from.spin_branch;
}

/// calc_docking() at `time` after the last communication point. @param sim  a DockingSim::Impl
template <class Sim>
Status evaluate(Sim& sim, const Extended& time, const Extended* y, Extended* ydot) {
  ExtendedEquations& me = *sim.extended;
  if (!me.data || me.coordinates != sim.coordinates) {
    me.data = std::make_unique<DockingData<Extended>>(*sim.model);
    me.coordinates = sim.coordinates;
  }
  const Loads& loads = sim.loads.at_start();
  for (int i : {kChaser, kTarget}) {
    me.loads.force[i] = loads.force[i].template cast<Extended>();
    me.loads.torque[i] = loads.torque[i].template cast<Extended>();
  }
  me.loads.gravity = loads.gravity.template cast<Extended>();
  me.loads.command = loads.command.template cast<Extended>();
  me.data->locked = sim.present().locked;
  copy_reference(sim.present().mechanism.loops.reference, me.data->mechanism.loops.reference);
  return calc_docking<Extended>(*sim.model, sim.discrete, sim.memory, me.loads, sim.elapsed + time,
                                y, ydot, *me.data);
}

template <class Sim>
int calc_rates(Sim& sim, const Extended& time, const Extended* y, Extended* ydot) {
  Status status = evaluate(sim, time, y, ydot);
  double sum = 0.0;
  for (int i = 0; i < sim.model->layout.size; ++i) sum += ydot[i].high;
  return sim.step_loop->update_failure_code(status, time.high, &sum, 1);
}

template <class Sim>
int calc_roots(Sim& sim, double time, const double* y, double* roots) {
  const Status status = evaluate(sim, time, sim.extended->solver->find_state(y).data(), nullptr);
  if (!status.ok()) {
    sim.step_loop->keep_failure(status);
    return 1;
  }
  const DockingData<Extended>& at = *sim.extended->data;
  DockingData<double>& rounded = sim.trial();
  rounded.contact.gap = to_double(at.contact.gap);
  rounded.contact.pressed = to_double(at.contact.pressed);
  for (int i = 0; i < sim.model->latches.count(); ++i) {
    rounded.latch.event[i] = to_double(at.latch.event[i]);
  }
  const auto round = [](const auto& x) {
    return x.unaryExpr([](const Extended& number) { return to_double(number); }).eval();
  };
  rounded.relative = {round(at.relative.R), round(at.relative.p), round(at.relative.w),
                      round(at.relative.v)};
  rounded.across = {round(at.across.R), round(at.across.p), round(at.across.w), round(at.across.v)};
  sim.evaluator->forget();  // trial() is no longer the evaluation of a state
  sim.events->calc_functions(rounded, roots);
  return 0;
}

}  // namespace

void DockingSim::use_extended_precision(double tolerance) {
  Impl& me = *impl_;
  me.extended = std::make_shared<ExtendedEquations>();
  me.adapt_problem = [&me, tolerance](Stepper::Problem& problem) {
    if (me.host->has_host()) {
      throw ModelError(
          "vehicles moved by a host cannot be integrated with extended precision: set "
          "chaser.motion and target.motion to free or fixed");
    }
    me.extended->data.reset();
    problem.root_tolerance = kRootTolerance;
    problem.roots = [&me](double t, const double* y, double* roots) {
      return calc_roots(me, t, y, roots);
    };
    problem.solver = [&me, tolerance](System& system) {
      const auto rates = [&me](const Extended& t, const Extended* y, Extended* ydot) {
        return calc_rates(me, t, y, ydot);
      };
      auto solver = std::make_unique<ExtendedSolver>(system, rates, tolerance);
      me.extended->solver = solver.get();
      return std::unique_ptr<Solver>(std::move(solver));
    };
  };
}

const Extended* DockingSim::extended_states() const {
  DOCK_ASSERT(impl_->extended);
  return impl_->extended->solver->state().data();
}

Status DockingSim::calc_extended_outputs(std::vector<double>& output) {
  Impl& me = *impl_;
  ExtendedEquations& extended = *me.extended;
  me.read_inputs();
  std::vector<Extended> y = extended.solver->find_state(me.step_loop->y());
  const Status status = evaluate(me, 0, y.data(), nullptr);
  if (!status.ok()) return status;
  if (extended.output_cells.empty()) {
    match_sizes(me.outputs, extended.output);
    for_each_value(extended.output,
                   [&](Extended& cell) { extended.output_cells.push_back(&cell); });
  }
  const Vec3<Extended> velocity = me.frame_velocity.cast<Extended>();
  const Vec3<Extended> shift = me.frame_shift.cast<Extended>();
  const OutputSource<Extended> source =
      me.make_output_source<Extended>(*extended.data, y.data(), velocity, shift);
  read_outputs<Extended>(source, extended.output);
  read_momentum<Extended>(source, extended.output);
  output.clear();
  for (const Extended* cell : extended.output_cells) output.push_back(to_double(*cell));
  return {};
}

}  // namespace dockloop
