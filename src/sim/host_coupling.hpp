// Driven vehicles between communication points: the data that coupling.hpp explains.
//
// The class compares received with predicted motion, keeps the impulse balance, finds the loads to
// report and warns of errors of the host (coupling_monitors.cpp). It integrates nothing and moves
// no body: coupling.cpp does so in a communication step. The data are part of SimState.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "docking/interface_stiffness.hpp"
#include "sim/evaluator.hpp"
#include "sim/event_logic.hpp"

namespace dockloop {

/// Motion of a vehicle's centre-of-mass frame in O. @pre calc_docking
VehicleState find_vehicle_state(const DockingModel& model, const DockingData<double>& data,
                                int vehicle);

/// Motion of the vehicles, and impulses of the known loads of their hosts so far.
/// @pre calc_docking at y
CouplingPoint find_coupling_point(const DockingModel& model, const DockingData<double>& data,
                                  const double* y);

class HostCoupling {
 public:
  /// Keeps references to all but `setup`. @param frame_origin  O in N at the start [m]
  HostCoupling(const DockingModel& model, std::shared_ptr<const Setup> setup,
               const std::array<VehicleParts, 2>& parts, const Vec3<double>& frame_origin,
               const Inputs& inputs, const StepLoads& loads, const EventLogic& events,
               Evaluator& evaluator, SimState& state, std::vector<std::string>& warnings);
  /// A changed copy of the model; in use_coordinates() with other independent coordinates.
  void use_model(const DockingModel& model) { model_ = &model; }
  void use_coordinates(const DockingModel& model);

  bool has_host() const;
  bool announces() const;
  bool is_delayed() const;
  bool steps_first() const;  ///< the host

  // Receive

  /// By parameters, which may change during a run.
  VehicleBody find_stated_body(int vehicle, const Parameters& parameters) const;
  /// The host has another mass from now on. The estimate begins again.
  void restate(int vehicle, const VehicleBody& stated);
  /// The pending impulse starts at zero; the first load is announced from the start state.
  void start();
  /// Rounding errors of the norm are accepted; a larger error is an error of the host.
  /// @param reason  the message, if not ok
  Status check_received_attitude(int vehicle, std::string& reason);
  /// All inputs are zero in the first step: the vehicle stays at its start values.
  void note_missing_inputs(int vehicle);
  /// Take the received motion over, with pending impulse and monitors. @param h  of the coming step
  /// @return motion of the internal vehicle, moved by the innovation
  VehicleState receive(int vehicle, double h);
  /// Does the coupling create energy? One warning, then a refusal. @pre receive, evaluation of y
  /// @param energy  of everything inside [J]; @param host_work  part of it by corrections [J]
  /// @param reason  of a refusal
  Status check_energy(double energy, double host_work, const double* y, std::string& reason);
  /// Do steps resolve the flexible parts that hosts have? @param reason  of a refusal
  Status check_modes(const double* y, std::string& reason);
  /// Momentum of the internal vehicle: of the host's vehicle, plus the pending impulse.
  Wrench<double> find_internal_momentum(int vehicle) const;
  /// Is there room for one more late load, and may a step of h have this delay?
  Status check_delay(double h, std::string& reason);
  /// Time from now until the next announced load acts [s].
  double find_lead() const;

  // Impulse balance and loads

  /// Momentum of a vehicle as its host integrates it.
  Wrench<double> find_host_momentum(int vehicle, const VehicleState& state) const;
  /// After a step of h: add the exerted impulse, find the load to report. Inputs are still the
  /// inputs of the step. @pre evaluation of y at its end
  void update_impulse_balance(double h, const CouplingPoint& begin, const CouplingPoint& end,
                              const double* y);
  /// Loads of a step of h, from a look ahead: future loads and pending impulse.
  /// @param now, begin, end  the present point; begin of the step, after find_lead(); its end
  void announce(double h, const CouplingPoint& now, const CouplingPoint& begin,
                const CouplingPoint& end);
  void warn_of_look_ahead(double h, const std::string& reason);
  /// Pending impulse at the present communication point: from the motion received since the step,
  /// or from the predicted motion.
  Wrench<double> find_pending_impulse(int vehicle) const;

  // Monitors

  /// True mass / stated mass - 1, estimated from the motion; 0 without an estimate.
  double find_mass_mismatch(int vehicle) const;
  /// Vehicle that outputs show: if both have a diagnosis, the one with the larger error. Else the
  /// one with a diagnosis; else the chaser, or the only vehicle with a host.
  int find_shown_vehicle() const;
  /// What reports say about a step that has been refused: a clause, or nothing. @pre the state of
  /// the refusal
  std::string explain_refusal() const;
  /// Is the prediction made with identified numbers?
  bool is_identified(int vehicle) const;
  /// Highest frequency of mechanism, contact and latches between the vehicles [rad/s].
  /// @pre evaluation of y
  double find_interface_frequency(const double* y);
  /// Largest delay of the loop that is stable although coupling.delay does not state it [s].
  /// @pre find_interface_frequency
  double find_largest_delay() { return dockloop::find_largest_delay(*interface_work_); }
  /// Step over which the error of the coupling should stay below coupling.velocity_tolerance.
  /// @param contact_time  lower bound of the time until first contact [s]
  double find_suggested_step(double frequency, double contact_time) const;

 private:
  double find_report_time() const;
  double find_past_end() const;
  VehicleState find_received_state(int vehicle) const;
  VehicleState predict_host(int vehicle, const VehicleBody& body, const VehicleState& from,
                            const Wrench<double>& load, double begin, double h) const;
  template <class F>
  void for_each_held_load(int vehicle, double begin, double end, F&& f) const;
  void forget_old_loads(DrivenVehicle& v) const;
  int count_held_loads(int vehicle, double begin, double end) const;
  VehicleState advance_body(int vehicle, const VehicleBody& body, VehicleState from, double begin,
                            double end, Wrench<double>* delivered = nullptr) const;
  /// The same with the body that predictions use.
  VehicleState advance_host(int vehicle, const VehicleState& from, double begin, double end,
                            Wrench<double>* delivered = nullptr) const;
  Wrench<double> find_delivered_impulse(int vehicle, const VehicleState& host, double at) const;
  /// Impulse of the docking system on a vehicle: the change of its momentum, not a quadrature of
  /// the load.
  Wrench<double> find_exerted_impulse(int vehicle, const CouplingPoint& from,
                                      const CouplingPoint& to) const;
  Wrench<double> find_pending_impulse(int vehicle, const VehicleState& host, double until) const;
  void warn_once(int vehicle, CouplingWarning what, const std::string& text);
  /// The motion at the start, in N, as a host would report it.
  Inputs::Vehicle find_start_report(int vehicle) const;
  /// The first report of a host that steps first: is it the motion at the end of the step?
  HostFinding judge_first_end(int vehicle) const;
  /// How old is the motion in the first reports?
  HostFinding judge_age(int vehicle);
  /// Motion of the host's vehicle over the last step, compared with the predicted motion.
  /// @param received  at the time of the report. @param now  predicted from it
  void look_at_innovation(int vehicle, const VehicleState& received, const VehicleState& now);
  void find_other_loads(int vehicle, LoadStep& step) const;
  HostFinding judge(int vehicle, const VehicleState& received);
  /// Estimate the body of a vehicle from its reports, and decide which body predictions use.
  /// @param received  now, at the end of the last step
  void identify(int vehicle, const VehicleState& received, double rounding, double keep);
  HostFinding explain_by_body(int vehicle, const HostFinding& by_loads) const;
  /// The driven vehicle with the larger error of reports, relative to what it reports.
  int find_worse_vehicle() const;
  double find_stable_step(double frequency) const;
  std::string describe(int vehicle, const HostFinding& found, double h) const;
  void diagnose(int vehicle, const HostFinding& found, double h);
  void note_step(int vehicle, const Wrench<double>& exerted, const VehicleState& start,
                 const VehicleState& end, double h);

  const DockingModel* model_;
  std::shared_ptr<const Setup> setup_;
  const std::array<VehicleParts, 2>& parts_;
  const Vec3<double>& frame_origin_;
  const Inputs& inputs_;
  const StepLoads& loads_;
  const EventLogic& events_;
  Evaluator& evaluator_;
  SimState& state_;
  std::vector<std::string>& warnings_;
  std::unique_ptr<InterfaceWorkspace> interface_work_;  ///< with a driven vehicle only
};

}  // namespace dockloop
