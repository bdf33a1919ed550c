// Evaluations of the equations of motion; see evaluator.hpp.
#include "sim/evaluator.hpp"

#include <algorithm>

namespace dockloop {

Evaluator::Evaluator(std::shared_ptr<const DockingModel> model, const SimState& state,
                     const StepLoads& loads)
    : model_(std::move(model)),
      state_(state),
      loads_(loads),
      present_(std::make_unique<DockingData<double>>(*model_)),
      trial_(std::make_unique<DockingData<double>>(*model_)),
      start_rates_(static_cast<size_t>(model_->layout.size), 0.0),
      trial_rates_(start_rates_),
      key_y_(start_rates_) {}

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

Status Evaluator::at(double tau, const double* y, double* ydot) {
  is_present_kept_ = false;
  if (is_started()) forget();
  Status status = calc(tau, y, ydot, Need::kState, *present_);
  if (!status.ok()) status.time = state_.elapsed + tau;
  return status;
}

Status Evaluator::at_start(double tau, const double* y) {
  const Status status = at(tau, y, start_rates_.data());
  set_key(present_.get(), tau, y);
  is_start_counted_ = false;
  return status;
}

/// A trial state is not complete after generated code, or with a locked mechanism.
bool Evaluator::is_complete_at_key(double tau, const double* y) const {
  return key_ == trial_.get() && is_at_key(tau, y) && !present_->locked &&
         trial_->mechanism.found != Need::kRates;
}

Status Evaluator::at_end(double tau, const double* y) {
  if (!is_complete_at_key(tau, y)) return at(tau, y);
  std::swap(present_, trial_);
  forget();
  return {};
}

Status Evaluator::at_end_with_rates(double tau, const double* y) {
  Status status;
  if (is_complete_at_key(tau, y) && are_trial_rates_known_) {
    std::swap(present_, trial_);
    std::swap(start_rates_, trial_rates_);
    key_ = present_.get();
  } else {
    status = at_start(tau, y);
  }
  is_start_counted_ = true;
  return status;
}

Status Evaluator::at_trial(double tau, const double* y, double* ydot) {
  const Status status = calc(tau, y, ydot, Need::kRates, *trial_);
  are_trial_rates_known_ = ydot != nullptr;
  if (ydot) std::copy_n(ydot, trial_rates_.size(), trial_rates_.begin());
  set_key(trial_.get(), tau, y);
  return status;
}

Status Evaluator::at_events(double tau, const double* y) {
  if (is_at_key(tau, y)) {
    events_at_ = is_started() ? present_.get() : trial_.get();
    return {};
  }
  const Status status = at_trial(tau, y, nullptr);
  if (!status.ok()) forget();
  events_at_ = trial_.get();
  return status;
}

Status Evaluator::aside(double tau, const double* y, double* ydot, Need need) {
  if (key_ == trial_.get()) forget();
  return calc(tau, y, ydot, need, *trial_);
}

Status Evaluator::calc_jacobian(double tau, const double* y) {
  return calc_docking_jacobian(*model_, state_.discrete, state_.memory, *trial_, loads_.at(tau),
                               state_.elapsed + tau, y, *pass_, jacobian_);
}

Status Evaluator::build_matrix(double tau, const double* y, bool is_accepted, bool renews,
                               double* block, int& cost) {
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
  if (key_ == trial_.get()) forget();
  if (is_started() && !is_start_counted_) count(1);
}

bool Evaluator::is_at_key(double tau, const double* y) const {
  return key_ && tau == key_tau_ && std::equal(key_y_.begin(), key_y_.end(), y);
}

void Evaluator::set_key(const DockingData<double>* to, double tau, const double* y) {
  key_ = to;
  key_tau_ = tau;
  std::copy_n(y, key_y_.size(), key_y_.begin());
}

}  // namespace dockloop
