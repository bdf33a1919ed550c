// The equations with multipliers for IDA (solver.method 9): residual, Jacobian, tolerances, and the
// gaps of the loops.
#include <algorithm>

#include "sim/sim_impl.hpp"

namespace dockloop {

void DockingSim::Impl::make_reference() {
  reference =
      std::make_unique<ReferenceModel>(*model, static_cast<DaeForm>(setup->parameters.dae_form));
  reference_data = std::make_unique<ReferenceData>(*model, *reference);
}

void DockingSim::Impl::describe_reference(Stepper::Problem& problem) {
  make_reference();
  problem.dae.size = reference->size;
  problem.dae.jacobian_cost = find_reference_jacobian_cost(*model, *reference);
  problem.dae.residual = [this](double t, const double* z, const double* zdot, double* residual) {
    const Status status =
        calc_reference_residual(*model, *reference, discrete, memory, find_loads(t), elapsed + t, z,
                                zdot, residual, *reference_data);
    return update_failure_code(status, t, residual, reference->size);
  };
  problem.dae.jacobian = [this](double t, double alpha, const double* z, const double* zdot,
                                const double* residual, double* by_columns) {
    const Status status = calc_reference_jacobian(
        *model, *reference, discrete, memory, find_loads(t), elapsed + t, alpha, z, zdot, residual,
        reference_nominal, by_columns, *reference_data);
    return update_failure_code(status, t, by_columns, reference->size * reference->size);
  };
  problem.dae.complete = [this](double* z, double* zdot) {
    complete_reference_state(*model, *reference, *rate_data, z, zdot);
  };
}

/// Dependent coordinates have the tolerances of independent ones. Multipliers have no tolerance:
/// they follow from the other unknowns, and their errors appear in those.
void DockingSim::Impl::add_reference_tolerances(std::vector<double>& atol) const {
  constexpr double kNone = 1e20;
  atol.resize(static_cast<size_t>(reference->size), kNone);
  std::fill_n(atol.begin() + reference->q_dep, reference->cuts, parameters.atol_position);
  std::fill(atol.begin() + reference->v_dep, atol.begin() + reference->lambda,
            parameters.atol_velocity);
}

void DockingSim::Impl::update_drift(double tau) {
  drift = std::max(
      drift, find_cut_gap(*model, *reference, elapsed + tau, stepper->unknowns(), *reference_data));
}

}  // namespace dockloop
