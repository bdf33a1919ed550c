// Audits: does energy add up, does momentum balance?
//
// Energy is compared with what there was at the start, what came from outside and what was
// dissipated; momentum, summed over bodies, with its start and the impulses from outside. Neither
// sum is the state that is integrated, so an error of the equations or of the integration shows.
// The numbers kept here are part of SimState. The functions are free of side effects but on them.
#pragma once

#include <array>
#include <string>

#include "docking/docking_model.hpp"
#include "sim/archive.hpp"

namespace dockloop {

/// The energy of one state.
struct EnergyBalance {
  double residual = 0.0;  ///< what does not add up since the start [J]
  double in_play = 0.0;   ///< bound of what may be there, if no step creates energy [J]
};

struct EnergyAudit {
  double start = 0.0;      ///< [J]
  double in_play = 0.0;    ///< largest so far [J]
  double residual = 0.0;   ///< at the last accepted inner step [J]
  int warnings = 0;        ///< issued about a residual that matters
  double host_work = 0.0;  ///< that imposed motion brought in [J]
};

struct MomentumAudit {
  std::array<Wrench<double>, 2> start;      ///< per vehicle, with what its host changed
  double residual = 0.0;                    ///< largest seen [-]
  double scale = 0.0, angular_scale = 0.0;  ///< largest seen [N s], [N m s]
};

/// Elastic energy of legs, contact and latches [J]. @pre calc_docking
double find_potential_energy(const DockingData<double>& data);
/// Kinetic and elastic energy [J]. @pre calc_docking
double find_total_energy(const DockingModel& model, const DockingData<double>& data);

/// What should add up, and what does not. @param y  state of `data`
EnergyBalance find_energy_balance(const DockingModel& model, const DockingData<double>& data,
                                  const double* y, const EnergyAudit& audit);
/// The largest energy that was in play so far [J]; at least what tolerances leave open.
double find_energy_scale(const EnergyAudit& audit, const EnergyBalance& balance,
                         double atol_energy);

/// The first state of a run.
void start_energy_audit(const DockingModel& model, const DockingData<double>& data, const double* y,
                        EnergyAudit& audit);
/// Does the step to `balance` create more energy than was ever in play, or add up to it? Error
/// control has then accepted a wrong step. @param scale  find_energy_scale()
bool creates_energy(const EnergyAudit& audit, const EnergyBalance& balance, double scale);
/// Keep the balance of an accepted step. @return whether the residual has become worth a warning
bool update_energy_audit(const EnergyBalance& balance, double scale, EnergyAudit& audit);

/// Is there momentum to compare? An immobile vehicle takes up any.
bool conserves_momentum(const DockingModel& model);
/// The first state of a run. @param least_scale  [N s], of a run at rest
void start_momentum_audit(const DockingModel& model, const DockingData<double>& data,
                          double least_scale, MomentumAudit& audit);
/// The scales at a communication point.
void update_momentum_scales(const DockingModel& model, const double* y, MomentumAudit& audit);
/// Momentum summed over bodies against its start and the impulses from outside [-].
/// @pre everything of `data` was evaluated
double find_momentum_residual(const DockingModel& model, const DockingData<double>& data,
                              const double* y, const MomentumAudit& audit);

template <class A>
void transfer(A& archive, EnergyAudit& a) {
  transfer_members<EnergyAudit>(archive, a.start, a.in_play, a.residual, a.warnings, a.host_work);
}

template <class A>
void transfer(A& archive, MomentumAudit& a) {
  transfer_members<MomentumAudit>(archive, a.start, a.residual, a.scale, a.angular_scale);
}

}  // namespace dockloop
