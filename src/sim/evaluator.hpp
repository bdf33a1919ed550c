// Evaluations of the equations of motion, and the states they are valid for.
//
// Two workspaces: `present` belongs to the last accepted state, `trial` to other states. One key
// names the state (tau, y) of the last evaluation for the integrator, its workspace and its rates.
// If the search for events or the end of an inner step asks for the state of the key, nothing is
// computed: the same state gives the same bits. The key is void as soon as the state that it names
// may have other loads, latches or contacts (forget(), begin_inner_step()).
//
// There is one entry for each purpose: at() for accepted states, at_trial() for what the integrator
// asks for, aside() for all other states, which must not disturb the key.
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
  /// The model has another body of a vehicle.
  void use_vehicle_bodies();
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

  // Evaluations: y at tau [s since SimState::elapsed]

  /// Rates of an accepted state. kCounted: the integrator has counted their evaluation already.
  enum class Rates { kNone, kNew, kCounted };

  /// An accepted state: everything, into `present`. Nothing is computed if the key names this state
  /// with all of it; where loads, latches or contacts may have changed, forget() first.
  /// @post with rates: start_rates() until an inner step has been made
  Status at(double tau, const double* y, Rates rates = Rates::kNone);
  /// A trial state of the integrator, as far as rates and event functions need it. @param ydot
  /// rates; null: event functions only, and nothing is computed at the state of the key.
  /// @post events_at()
  Status at_trial(double tau, const double* y, double* ydot);
  /// Everything, into `trial`, without a key: for other purposes than the integration.
  Status aside(double tau, const double* y, double* ydot, Need need = Need::kState);
  /// Derivatives of the rates. @pre reserve_jacobian(); aside() at this state
  Status calc_jacobian(double tau, const double* y, bool with_contact_bristles = true);
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
  void forget() { key_.at = nullptr; }
  /// Trial states before this inner step are not valid in it. The integrator does not count an
  /// evaluation if it starts with start_rates().
  void begin_inner_step();
  /// Rates where the next inner step starts; null: not known.
  const double* start_rates() const { return is_started() ? key_.rates.data() : nullptr; }
  /// `present` is exactly at the present state until forget_present() or at().
  void keep_present() { is_present_kept_ = true; }
  void forget_present() { is_present_kept_ = false; }
  bool is_present_kept() const { return is_present_kept_; }
  /// `trial` is exactly at the communication point until the next evaluation of a trial state.
  void keep_trial() { is_trial_kept_ = true; }
  void forget_trial() { is_trial_kept_ = false; }
  bool is_trial_kept() const { return is_trial_kept_; }
  /// The workspace that event functions are read from.
  DockingData<double>& events_at() { return is_started() ? *present_ : *trial_; }

  // Evaluations that the integrator does not count

  void count(std::int64_t evaluations) { counted_ += evaluations; }
  std::int64_t counted() const { return counted_; }

 private:
  /// The state of the last evaluation for the integrator.
  struct Key {
    const DockingData<double>* at = nullptr;  ///< its workspace: present_, trial_ or none
    double tau = 0.0;
    std::vector<double> y, rates;
    bool has_rates = false;
    bool is_counted = false;  ///< the evaluation of the rates
  };
  bool is_started() const { return key_.at == present_.get(); }
  bool is_at_key(double tau, const double* y) const;
  bool is_complete_at_key(double tau, const double* y) const;
  void set_key(const DockingData<double>* at, double tau, const double* y, bool has_rates);
  Status calc(double tau, const double* y, double* ydot, Need need, DockingData<double>& data);

  std::shared_ptr<const DockingModel> model_;
  const SimState& state_;
  const StepLoads& loads_;
  std::unique_ptr<DockingData<double>> present_, trial_;
  Key key_;
  bool is_present_kept_ = false, is_trial_kept_ = false;
  std::unique_ptr<DockingPass> pass_;  ///< with reserve_jacobian() only
  MatX<double> jacobian_;
  std::unique_ptr<StructuredMatrix> matrix_;  ///< with reserve_matrix() only
  std::int64_t counted_ = 0;
};

}  // namespace dockloop
