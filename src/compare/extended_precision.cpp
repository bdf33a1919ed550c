// Events, latches, peaks and audits of a reference solution are those of the simulation, in double;
// rates, event functions, the method and the continuous outputs have 32 digits.
//
// Discrete decisions stay in double: which pairs of surfaces are near, and on which branch the
// loops are (their reference pose). Values do not depend on the digits of either.
#include "compare/extended_precision.hpp"

#include "compare/extended_solver.hpp"
#include "math/dock_assert.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
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

}  // namespace

class ExtendedEquations final : public Equations {
 public:
  ExtendedEquations(DockingSim::Impl& sim, double tolerance) : sim_(sim), tolerance_(tolerance) {}

  bool is_reference() const override { return true; }
  int size() const override { return sim_.model->layout.size; }
  void enter(Stepper::Problem& problem) override {
    if (sim_.host->has_host()) {
      throw ModelError(
          "vehicles moved by a host cannot be integrated with extended precision: set "
          "chaser.motion and target.motion to free or fixed");
    }
    problem.root_tolerance = kRootTolerance;
    problem.roots = [this](double t, const double* y, double* roots) {
      return calc_roots(t, y, roots);
    };
    problem.solver = [this](System& system) {
      const auto rates = [this](const Extended& t, const Extended* y, Extended* ydot) {
        return calc_rates(t, y, ydot);
      };
      auto made = std::make_unique<ExtendedSolver>(system, rates, tolerance_);
      solver_ = made.get();
      return std::unique_ptr<Solver>(std::move(made));
    };
  }

  const Extended* states() const { return solver_->state().data(); }
  Status calc_outputs(std::vector<double>& output) {
    sim_.read_inputs();
    std::vector<Extended> y = solver_->find_state(sim_.step_loop->y());
    const Status status = evaluate(0, y.data(), nullptr);
    if (!status.ok()) return status;
    set_sizes(sim_.list_sizes, output_);
    const Vec3<Extended> velocity = sim_.frame_velocity.cast<Extended>();
    const Vec3<Extended> shift = sim_.frame_shift.cast<Extended>();
    const OutputSource<Extended> source =
        sim_.make_output_source<Extended>(*data_, y.data(), velocity, shift);
    read_outputs<Extended>(source, output_);
    read_momentum<Extended>(source, output_);
    output.clear();
    for_each_value(output_, [&](Extended& cell) { output.push_back(to_double(cell)); });
    return {};
  }

 private:
  /// calc_docking() at `time` after the last communication point.
  Status evaluate(const Extended& time, const Extended* y, Extended* ydot) {
    if (!data_ || coordinates_ != sim_.coordinates) {
      data_ = std::make_unique<DockingData<Extended>>(*sim_.model);
      coordinates_ = sim_.coordinates;
    }
    const Loads& loads = sim_.loads.at_start();
    for (int i : {kChaser, kTarget}) {
      loads_.force[i] = loads.force[i].cast<Extended>();
      loads_.torque[i] = loads.torque[i].cast<Extended>();
    }
    loads_.gravity = loads.gravity.cast<Extended>();
    loads_.command = loads.command.cast<Extended>();
    data_->locked = sim_.present().locked;
    copy_reference(sim_.present().mechanism.loops.reference, data_->mechanism.loops.reference);
    return calc_docking<Extended>(*sim_.model, sim_.discrete, sim_.memory, loads_,
                                  sim_.elapsed + time, y, ydot, *data_);
  }

  int calc_rates(const Extended& time, const Extended* y, Extended* ydot) {
    const Status status = evaluate(time, y, ydot);
    double sum = 0.0;
    for (int i = 0; i < size(); ++i) sum += ydot[i].high;
    return sim_.step_loop->update_failure_code(status, time.high, &sum, 1);
  }

  int calc_roots(double time, const double* y, double* roots) {
    const Status status = evaluate(time, solver_->find_state(y).data(), nullptr);
    if (!status.ok()) {
      sim_.step_loop->keep_failure(status);
      return 1;
    }
    DockingData<double>& rounded = sim_.trial();
    rounded.contact.gap = to_double(data_->contact.gap);
    rounded.contact.pressed = to_double(data_->contact.pressed);
    for (int i = 0; i < sim_.model->latches.count(); ++i) {
      rounded.latch.event[i] = to_double(data_->latch.event[i]);
    }
    const auto round = [](const auto& x) {
      return x.unaryExpr([](const Extended& number) { return to_double(number); }).eval();
    };
    const auto round_motion = [&](const RelativeMotion<Extended>& x) -> RelativeMotion<double> {
      return {round(x.R), round(x.p), round(x.w), round(x.v)};
    };
    rounded.relative = round_motion(data_->relative);
    std::transform(data_->relative.others.begin(), data_->relative.others.end(),
                   rounded.relative.others.begin(), round_motion);
    rounded.across = round_motion(data_->across);
    sim_.evaluator->forget();  // trial() is no longer the evaluation of a state
    sim_.events->calc_functions(rounded, roots);
    return 0;
  }

  DockingSim::Impl& sim_;
  double tolerance_;
  ExtendedSolver* solver_ = nullptr;  ///< the stepper owns it
  std::unique_ptr<DockingData<Extended>> data_;
  std::shared_ptr<const Coordinates> coordinates_;  ///< that data_ was made for
  ExternalLoads<Extended> loads_;
  OutputValues<Extended> output_;
};

std::unique_ptr<Equations> ExtendedPrecision::make_equations(DockingSim::Impl& sim) const {
  auto equations = std::make_unique<ExtendedEquations>(sim, tolerance_);
  made_ = equations.get();
  return equations;
}

const Extended* ExtendedPrecision::states() const {
  DOCK_ASSERT(made_);
  return made_->states();
}

Status ExtendedPrecision::calc_outputs(std::vector<double>& output) const {
  return made_->calc_outputs(output);
}

}  // namespace dockloop
