// Quiescent mechanism and free drift far from contact: bodies without loads are not integrated.
//
// A mechanism becomes quiescent after a while with constant coordinates, if its rates, too, would
// move it by no more than the tolerance. Vehicle and mechanism then
// drift freely as one rigid body. Its centre of mass moves on a straight line, and its attitude
// follows Euler's equations. Momentum states and mechanism coordinates keep their bits. Any load,
// thrust or command ends the quiescent state; where a force acts between the vehicles there is
// none. So does a gap of a centimetre, and a change of spin that would move the mechanism. The
// error of the coordinates is then about ten absolute tolerances.
//
// A rigid joint between the vehicles (docking/hard_dock.hpp) holds the mechanism too, as long as it
// is on. Without loads the stack then drifts as one body.
//
// The class decides (update()), holds the mechanism in evaluations (find_held()) and makes the
// drift. The quiescent state is part of SimState. The class owns the constants of the locked
// mechanism; they follow from that state.
#pragma once

#include <cstdint>
#include <vector>

#include "sim/evaluator.hpp"
#include "sim/event_logic.hpp"

namespace dockloop {

/// Largest change of coordinates that count as constant, in absolute tolerances.
constexpr double kQuiescentPlace = 10.0;

class QuiescentMode {
 public:
  /// Keeps references to all but the model. @param is_possible  can the mechanism become quiescent
  /// in this run? @param can_drift  can bodies drift at all?
  QuiescentMode(const DockingModel& model, SimState& state, const SolverSettings& settings,
                double rtol, bool is_possible, bool can_drift, const StepLoads& loads,
                EventLogic& events, Evaluator& evaluator);
  void use_model(const DockingModel& model) { model_ = &model; }

  /// Start in the present pose. @pre evaluator.present() is at y
  void start(const double* y);
  /// The mechanism is locked in its present pose for the whole run (model.level 1).
  void lock_always();
  /// The model has another body of a vehicle. @pre a host moves it, so only lock_always() locks
  void use_vehicle_bodies();
  /// After y and state were restored, and after the rigid joint was made or released.
  void restore(const double* y);

  bool is_on() const { return state_.quiescent.on; }
  /// Is the mechanism quiescent, and do the present loads allow it?
  bool is_in_effect() const { return is_on() && is_free(); }
  /// The locked mechanism for Evaluator::hold(); null: the mechanism moves.
  /// @param may_lock  if false, a quiescent mechanism is evaluated as one that moves
  const LockedMechanism* find_held(bool may_lock = true) const;
  const LockedMechanism& locked() const { return locked_; }
  /// A new evaluation of an accepted state, with the mechanism as find_held() has it.
  Status evaluate(double tau, const double* y, bool may_lock = true);

  /// Begin or end the quiescent state. @pre evaluation at tau of an accepted state
  Status update(double tau, double* y);
  /// Time without possible contact forces and with a limited number of attitude steps [s].
  /// @pre evaluation
  double find_drift_time() const;
  /// Ballistic propagation of both vehicles. @pre evaluation @post y is ahead of the last
  /// evaluation
  /// @return cost in evaluations: one at its end, and the steps of the attitudes
  std::int64_t drift(double duration, double* y) const;

 private:
  bool is_joined() const { return state_.discrete.hard_dock.joint.on; }
  bool is_free() const;
  bool acts_by_command_only(double now) const;
  bool is_stack_at_rest(double now) const;
  bool update_balance(double tau, const double* y);
  bool calc_pull(double tau, VecX<double>& pull);
  void lock(const double* y);
  const VehicleBody& find_drifting_body(int vehicle) const;
  std::int64_t drift_body(int vehicle, const VehicleBody& body, const Vec3<double>& momentum,
                          double duration, FrameMotion<double>& frame, double* y) const;

  const DockingModel* model_;
  SimState& state_;
  const SolverSettings& settings_;
  double rtol_;
  bool is_possible_, can_drift_, is_always_locked_ = false;
  const StepLoads& loads_;
  EventLogic& events_;
  Evaluator& evaluator_;
  LockedMechanism locked_;

  // scratch
  std::vector<double> y_, ydot_;
  VecX<double> pull_, spinning_;  ///< accelerations of the mechanism: all, of spin
  VecX<double> moving_;           ///< rates of the mechanism
  MatX<double> stiffness_;        ///< K: minus acceleration per displacement, in rates' coordinates
  MatX<double> square_;           ///< K K^T
  SmallCholesky factor_;
};

}  // namespace dockloop
