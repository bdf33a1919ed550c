// Evaluations of the equations of motion; see evaluator.hpp.
#include "sim/evaluator.hpp"

#include <algorithm>

#include "math/dock_assert.hpp"

namespace dockloop {

Evaluator::Evaluator(std::shared_ptr<const DockingModel> model, const SimState& state,
                     const StepLoads& loads)
    : model_(std::move(model)),
      state_(state),
      loads_(loads),
      present_(std::make_unique<DockingData<double>>(*model_)),
      trial_(std::make_unique<DockingData<double>>(*model_)) {
  key_.y.assign(static_cast<size_t>(model_->layout.size), 0.0);
  key_.rates = key_.y;
}

void Evaluator::use_vehicle_bodies() {
  forget();
  forget_present();
  forget_trial();
  const Mechanism& mechanism = model_->mechanism;
  for (DockingData<double>* each : {present_.get(), trial_.get()}) {
    if (!each->mechanism.generated || mechanism.vehicle == kBase) continue;
    each->mechanism.generated->set_vehicle(mechanism.model.bodies[mechanism.vehicle]);
  }
}

void Evaluator::use_coordinates(std::shared_ptr<const DockingModel> model) {
  use_model(std::move(model));
  present_->mechanism = MechanismData<double>(model_->mechanism);
  trial_->mechanism = MechanismData<double>(model_->mechanism);
  if (pass_) pass_ = std::make_unique<DockingPass>(*model_);
  if (matrix_) matrix_ = std::make_unique<StructuredMatrix>(*model_);
}

/// Both workspaces get the code, because they change places.
void Evaluator::use_kernels(const std::shared_ptr<const KernelLibrary>& kernels) {
  for (DockingData<double>* each : {present_.get(), trial_.get()}) {
    each->mechanism.generated = make_generated_kernel(model_->mechanism, kernels);
  }
}

void Evaluator::reserve_jacobian() {
  if (pass_) return;
  pass_ = std::make_unique<DockingPass>(*model_);
  jacobian_.setZero(model_->layout.size, model_->layout.size);
}

void Evaluator::reserve_matrix() {
  reserve_jacobian();
  matrix_ = std::make_unique<StructuredMatrix>(*model_);
}

void Evaluator::keep_pose() {
  keep_reference(model_->mechanism, present_->mechanism);
  trial_->mechanism.loops.reference = present_->mechanism.loops.reference;
}

void Evaluator::use_reference(const LoopReference<double>& reference) {
  present_->mechanism.loops.reference = reference;
  trial_->mechanism.loops.reference = reference;
}

Status Evaluator::calc(double tau, const double* y, double* ydot, Need need,
                       DockingData<double>& data) {
  return calc_docking<double>(*model_, state_.discrete, state_.memory, loads_.at(tau),
                              state_.elapsed + tau, y, ydot, data, need);
}

/// A trial state is not complete after generated code, or with a locked mechanism.
bool Evaluator::is_complete_at_key(double tau, const double* y) const {
  return key_.at == trial_.get() && is_at_key(tau, y) && !present_->locked &&
         trial_->mechanism.found != Need::kRates;
}

Status Evaluator::at(double tau, const double* y, Rates rates) {
  is_present_kept_ = false;
  const bool with_rates = rates != Rates::kNone;
  Status status;
  if (is_complete_at_key(tau, y) && (key_.has_rates || !with_rates)) {
    std::swap(present_, trial_);
    forget_trial();
  } else {
    status = calc(tau, y, with_rates ? key_.rates.data() : nullptr, Need::kState, *present_);
    if (!status.ok()) status.time = state_.elapsed + tau;
  }
  if (with_rates && status.ok()) {
    set_key(present_.get(), tau, y, true);
    key_.is_counted = rates == Rates::kCounted;
  } else {
    forget();
  }
  return status;
}

Status Evaluator::at_trial(double tau, const double* y, double* ydot) {
  if (!ydot && is_at_key(tau, y)) return {};
  forget_trial();
  const Status status = calc(tau, y, ydot, Need::kRates, *trial_);
  if (!status.ok()) {
    forget();
    return status;
  }
  if (ydot) std::copy_n(ydot, key_.rates.size(), key_.rates.begin());
  set_key(trial_.get(), tau, y, ydot != nullptr);
  return status;
}

Status Evaluator::aside(double tau, const double* y, double* ydot, Need need) {
  if (key_.at == trial_.get()) forget();
  forget_trial();
  return calc(tau, y, ydot, need, *trial_);
}

Status Evaluator::calc_jacobian(double tau, const double* y, bool with_contact_bristles) {
  DOCK_ASSERT(pass_);
  return calc_docking_jacobian(*model_, state_.discrete, state_.memory, *trial_, loads_.at(tau),
                               state_.elapsed + tau, y, *pass_, jacobian_, with_contact_bristles);
}

Status Evaluator::build_matrix(double tau, const double* y, bool is_accepted, bool renews,
                               double* block, int& cost) {
  DOCK_ASSERT(matrix_);
  const StateLayout& layout = model_->layout;
  // Of dual numbers, per direction, measured.
  constexpr int kCost = 2;
  const int block_cost = kCost * (2 * layout.mechanism_nv + layout.element_bristle_count);
  const bool is_there = is_at_key(tau, y);
  const DockingData<double>* at = is_there && !is_started() ? trial_.get() : present_.get();
  Status status;
  if (!(is_there || is_accepted) || (!at->locked && at->mechanism.found == Need::kRates)) {
    at = trial_.get();
    ++cost;
    status = aside(tau, y, nullptr);
  }
  if (renews && !at->locked && status.ok()) {
    cost += block_cost;
    status = calc_mechanism_block(*model_, state_.discrete, state_.memory, *at, loads_.at(tau),
                                  state_.elapsed + tau, y, *pass_, block);
  }
  if (status.ok()) {
    matrix_->build(*model_, state_.discrete, state_.memory, *at, state_.elapsed + tau, y, block);
  }
  return status;
}

void Evaluator::begin_inner_step() {
  if (key_.at == trial_.get()) forget();
  if (is_started() && !key_.is_counted) count(1);
}

bool Evaluator::is_at_key(double tau, const double* y) const {
  return key_.at && tau == key_.tau && std::equal(key_.y.begin(), key_.y.end(), y);
}

void Evaluator::set_key(const DockingData<double>* at, double tau, const double* y,
                        bool has_rates) {
  key_.at = at;
  key_.tau = tau;
  std::copy_n(y, key_.y.size(), key_.y.begin());
  key_.has_rates = has_rates;
}

}  // namespace dockloop
