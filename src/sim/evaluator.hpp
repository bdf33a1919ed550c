// Evaluations of the equations of motion, and the states they are valid for.
//
// Two workspaces: `present` belongs to the last accepted state, `trial` to other states. One key
// names the state (tau, y) of the last evaluation for the integrator, and its workspace. If the
// integrator, the search for events or the end of an inner step asks for the state of the key,
// nothing is computed: the same state gives the same bits. The key is void as soon as the state
// that it names may have other loads, latches or contacts (forget(), begin_inner_step()).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "docking/structured_matrix.hpp"
#include "mechanism/kernels.hpp"
#include "sim/sim_state.hpp"
#include "sim/step_loads.hpp"

namespace dockloop {

class Evaluator {
 public:
  /// Keeps references to `state` (time, latches, contacts) and `loads`.
  Evaluator(std::shared_ptr<const DockingModel> model, const SimState& state,
            const StepLoads& loads);

  // Model

  /// A changed copy of the model, with the same coordinates.
  void use_model(std::shared_ptr<const DockingModel> model) { model_ = std::move(model); }
  /// A changed copy of the model, in other independent coordinates.
  void use_coordinates(std::shared_ptr<const DockingModel> model);
  /// Generated code evaluates trial states, if the code applies; null: the core evaluates them.
  void use_kernels(const std::shared_ptr<const KernelLibrary>& kernels);
  /// calc_jacobian() will be called.
  void reserve_jacobian();
  /// build_matrix() will be called.
  void reserve_matrix();
  /// From now on the mechanism is locked in `present`, or moves (null).
  void hold(const LockedMechanism* locked) { present_->locked = locked; }
  /// The same in both workspaces, for the whole run.
  void hold_always(const LockedMechanism* locked) { present_->locked = trial_->locked = locked; }

  // Workspaces

  DockingData<double>& present() { return *present_; }
  const DockingData<double>& present() const { return *present_; }
  DockingData<double>& trial() { return *trial_; }
  /// The pose of `present` becomes the accepted configuration: the next poses continue from it.
  void keep_pose();
  /// The same, with a saved configuration.
  void use_reference(const LoopReference<double>& reference);

  // Evaluations: y at tau after the last communication point

  /// Everything, into `present`. @param ydot  rates, or null
  Status at(double tau, const double* y, double* ydot = nullptr);
  /// at(), with the rates. @post start_rates() until an inner step has been made
  Status at_start(double tau, const double* y);
  /// The end of an inner step: at(), unless this state was evaluated completely.
  Status at_end(double tau, const double* y);
  /// The same with the rates, which the integrator has counted. @post as of at_start()
  Status at_end_with_rates(double tau, const double* y);
  /// A trial state, as far as rates and event functions need it.
  Status at_trial(double tau, const double* y, double* ydot);
  /// What event functions are read from. @post events_at()
  Status at_events(double tau, const double* y);
  /// Everything, into `trial`, without a key: for other purposes than the integration.
  Status aside(double tau, const double* y, double* ydot, Need need = Need::kState);
  /// Derivatives of the rates. @pre reserve_jacobian(); aside() at this state
  Status calc_jacobian(double tau, const double* y);
  const MatX<double>& jacobian() const { return jacobian_; }

  /// Structured matrix at the state whose rates the integrator has asked for last.
  /// @param is_accepted  y is the state of `present`
  /// @param block  its mechanism block. @param renews  compute the block at this state first
  /// @param[out] cost  what this takes, in evaluations. @pre reserve_matrix()
  Status build_matrix(double tau, const double* y, bool is_accepted, bool renews, double* block,
                      int& cost);
  StructuredMatrix& matrix() { return *matrix_; }

  // Validity

  /// The state of the key is no longer valid.
  void forget() { key_ = nullptr; }
  /// Trial states before this inner step are not valid in it. The integrator does not count an
  /// evaluation if it starts with start_rates().
  void begin_inner_step();
  /// Rates where the next inner step starts; null: not known.
  const double* start_rates() const { return is_started() ? start_rates_.data() : nullptr; }
  /// `present` is exactly at the present state until forget_present() or at().
  void keep_present() { is_present_kept_ = true; }
  void forget_present() { is_present_kept_ = false; }
  bool is_present_kept() const { return is_present_kept_; }
  /// The workspace of the last event functions.
  DockingData<double>& events_at() { return *events_at_; }
  /// Another form of the equations has written the values for event functions into `trial`.
  void put_events_into_trial() { events_at_ = trial_.get(); }

  // Evaluations that the integrator does not count

  void count(std::int64_t evaluations) { counted_ += evaluations; }
  std::int64_t counted() const { return counted_; }

 private:
  bool is_started() const { return key_ == present_.get(); }
  bool is_at_key(double tau, const double* y) const;
  bool is_complete_at_key(double tau, const double* y) const;
  void set_key(const DockingData<double>* to, double tau, const double* y);
  Status calc(double tau, const double* y, double* ydot, Need need, DockingData<double>& data);

  std::shared_ptr<const DockingModel> model_;
  const SimState& state_;
  const StepLoads& loads_;
  std::unique_ptr<DockingData<double>> present_, trial_;
  std::vector<double> start_rates_, trial_rates_;
  bool are_trial_rates_known_ = false;
  bool is_start_counted_ = false;             ///< the evaluation of start_rates()
  const DockingData<double>* key_ = nullptr;  ///< workspace of the key: present_, trial_ or none
  double key_tau_ = 0.0;
  std::vector<double> key_y_;
  DockingData<double>* events_at_ = nullptr;
  bool is_present_kept_ = false;
  std::unique_ptr<DockingPass> pass_;  ///< with reserve_jacobian() only
  MatX<double> jacobian_;
  std::unique_ptr<StructuredMatrix> matrix_;  ///< with reserve_matrix() only
  std::int64_t counted_ = 0;
};

}  // namespace dockloop
