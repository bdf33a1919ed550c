// Private parts of DockingSim, shared by docking_sim.cpp (motion) and outputs.cpp (reading out).
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "integrate/erk_stepper.hpp"
#include "sim/docking_sim.hpp"
#include "sim/mean_load.hpp"
#include "sim/peaks.hpp"
#include "sim/phases.hpp"

namespace dockloop {

constexpr int kFixedRoots = 2;  ///< event functions before those of the latches
constexpr int kPeakCount = Outputs::kLoadCount + 1;  ///< loads and load ratio

struct DockingSim::Impl {
  explicit Impl(std::shared_ptr<const Scene> scene);
  void clear();
  void initialise(double t0, double tolerance);
  void check_parameters() const;
  ContactLaw make_contact_law() const;
  void choose_frame_O();
  void make_stepper(double tolerance);
  void check_joint_starts(const LoopPlan& plan) const;
  Status bring_joints_to_start();
  void set_start_state();
  void put_pose(int vehicle, const Vec3<double>& position, const Vec4<double>& attitude);
  Status put_velocity(int vehicle, const Vec3<double>& velocity,
                      const Vec3<double>& angular_velocity);
  void warn_about_start();
  void read_inputs();
  Status receive_driven_vehicles();
  Status integrate(double h);
  double find_leap(double made, double proposal);
  double find_next_stop(double tau, double h) const;
  Status find_trouble(double tau) const;
  Status step_to_root(double tau);
  Status accept(double tau, bool& changed);
  void keep_pose();
  Status update_coordinates(double tau, bool& changed);
  void use_coordinates(const Mechanism& mechanism);
  bool update_memory();
  bool update_latches(double now);
  void begin_contact(double now);
  void update_capture(double now);
  bool update_thrust(double now);
  Status evaluate(double tau);
  void calc_event_functions(const DockingData<double>& at, double* roots) const;
  void finish_step(double t, double h);
  void update_mean_loads(double h);
  void update_momentum_audit();

  double find_total_energy() const;
  double find_potential_energy() const;
  PhaseInputs find_phase_inputs() const;
  VehicleState find_vehicle_state(int vehicle) const;
  std::array<double, kPeakCount> find_peak_values() const;
  double find_acceleration_bound() const;
  bool has_surfaces() const { return model->present[kTarget] && !model->contact.empty(); }
  double* bristles() {
    return model->layout.bristle_count > 0 ? stepper->y() + model->layout.bristles : nullptr;
  }

  // outputs.cpp, one per group
  void update_outputs();
  void update_vehicle_outputs();
  void update_load_outputs();
  void update_relative_outputs();
  void update_contact_outputs();
  void update_mechanism_outputs();
  void update_energy_outputs();

  std::shared_ptr<const Scene> scene;
  Parameters parameters;
  Inputs inputs;
  Outputs outputs;
  bool outputs_valid = false;
  std::string status_text;
  std::vector<std::string> warnings;

  // set by initialise()
  std::unique_ptr<DockingModel> model;
  std::unique_ptr<DockingData<double>> data;       ///< at the last accepted state
  std::unique_ptr<DockingData<double>> rate_data;  ///< at trial states of the integrator
  std::unique_ptr<ErkStepper> stepper;             ///< owns the state y
  std::vector<int> state_bodies;  ///< joints of state.*: the independent ones at the start
  double t_start = 0.0;
  double energy_start = 0.0;
  std::array<Wrench<double>, 2> momentum_start;      ///< per vehicle, with what the host changed
  Vec3<double> frame_origin = Vec3<double>::Zero();  ///< O in N at the start [m]

  // state beside y; also the reference pose data->mechanism.loops.reference
  double elapsed = 0.0;  ///< [s] from start to the last communication point
  double h_warm = 0.0;   ///< step size for the next communication step [s]
  Vec3<double> frame_velocity = Vec3<double>::Zero();  ///< of O in N [m/s]
  Vec3<double> frame_shift = Vec3<double>::Zero();     ///< of O in N since the start [m]
  DiscreteState discrete;
  ContactMemory memory;  ///< a function of the last accepted state
  Loads loads;
  PeakTracker<kPeakCount> peaks;
  double host_work = 0.0;          ///< energy that imposed motion brought in [J]
  double momentum_residual = 0.0;  ///< [-]
  double momentum_scale = 0.0, angular_momentum_scale = 0.0;  ///< largest seen [N s], [N m s]
  std::array<Wrench<double>, 2> mean_load;                    ///< of the step just made
  double last_step = 0.0;                                     ///< [s]
  double margin_looked_at = kChangeMargin;     ///< where other coordinates were last looked for
  bool warned_margin = false;                  ///< a loop close to singular was told once
  std::array<VehicleState, 2> vehicle_before;  ///< at the start of the last communication step

  // scratch
  std::vector<char> due = std::vector<char>(kFixedRoots + kMaxLatches, 0);
  Status last_trouble;
  double margin_before = 1.0;  ///< of the loops, at the last accepted state
  std::vector<double> y_before, y_accepted;
  DiscreteState discrete_before;
  ContactMemory memory_before;
  PeakTracker<kPeakCount> peaks_before;
  LoopReference<double> reference_before;
  std::unique_ptr<Mechanism> coordinates_before;  ///< if they changed since the step began
};

}  // namespace dockloop
