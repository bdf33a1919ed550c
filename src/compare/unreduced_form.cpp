// The equations with multipliers for IDA (solver.method 9): residual, Jacobian, tolerances, and the
// gaps of the loops.
#include <algorithm>

#include "compare/comparison.hpp"
#include "compare/dae_solver.hpp"
#include "compare/unreduced_model.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

class Multipliers final : public Equations {
 public:
  explicit Multipliers(DockingSim::Impl& sim) : sim_(sim) { update_coordinates(); }

  int size() const override { return form_->size; }
  int controlled_size() const override { return form_->lambda; }
  void update_coordinates() override {
    const DockingModel& model = *sim_.model;
    form_ = std::make_unique<UnreducedModel>(model,
                                             static_cast<DaeForm>(sim_.setup->parameters.dae_form));
    data_ = std::make_unique<UnreducedData>(model, *form_);
  }
  void enter(Stepper::Problem& problem) override {
    problem.unknowns = form_->size;
    problem.solver = [this](System& system) { return make_dae_solver(system, make_equations()); };
  }
  /// Dependent coordinates have the tolerances of independent ones. Multipliers have no tolerance:
  /// they follow from the other unknowns, and their errors appear in those.
  void add_tolerances(std::vector<double>& atol) const override {
    constexpr double kNone = 1e20;
    atol.resize(static_cast<size_t>(form_->size), kNone);
    std::fill_n(atol.begin() + form_->q_dep, form_->cuts, sim_.chosen.atol_position);
    std::fill(atol.begin() + form_->v_dep, atol.begin() + form_->lambda, sim_.chosen.atol_velocity);
  }
  void set_nominals(VecX<double> nominal) override { nominal_ = std::move(nominal); }
  double find_cut_gap(double tau) override {
    return dockloop::find_cut_gap(*sim_.model, *form_, sim_.elapsed + tau,
                                  sim_.step_loop->unknowns(), *data_);
  }

 private:
  Dae make_equations() {
    Dae dae;
    dae.jacobian_cost = find_unreduced_jacobian_cost(*sim_.model, *form_);
    dae.residual = [this](double t, const double* z, const double* zdot, double* residual) {
      const Status status =
          calc_unreduced_residual(*sim_.model, *form_, sim_.discrete, sim_.memory, sim_.loads.at(t),
                                  sim_.elapsed + t, z, zdot, residual, *data_);
      return sim_.step_loop->update_failure_code(status, t, residual, form_->size);
    };
    dae.jacobian = [this](double t, double alpha, const double* z, const double* zdot,
                          const double* residual, double* by_columns) {
      const Status status = calc_unreduced_jacobian(*sim_.model, *form_, sim_.discrete, sim_.memory,
                                                    sim_.loads.at(t), sim_.elapsed + t, alpha, z,
                                                    zdot, residual, nominal_, by_columns, *data_);
      return sim_.step_loop->update_failure_code(status, t, by_columns, form_->size * form_->size);
    };
    dae.complete = [this](double* z, double* zdot) {
      complete_unreduced_state(*sim_.model, *form_, sim_.trial(), z, zdot);
    };
    return dae;
  }

  DockingSim::Impl& sim_;
  std::unique_ptr<UnreducedModel> form_;
  std::unique_ptr<UnreducedData> data_;
  VecX<double> nominal_;  ///< size of the unknowns
};

class WithMultipliers final : public Comparison {
  std::unique_ptr<Equations> make_equations(DockingSim::Impl& sim) const override {
    if (sim.parameters.model_level != kReference) return nullptr;
    return std::make_unique<Multipliers>(sim);
  }
};

}  // namespace

const Comparison* get_comparison() {
  static const WithMultipliers kForm;
  return &kForm;
}

}  // namespace dockloop
