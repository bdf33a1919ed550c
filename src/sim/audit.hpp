// Audits of the balances of energy and momentum.
//
// Energy is compared with start energy, external work and dissipated energy. Momentum, as a sum
// over bodies, is compared with start momentum and external impulses. Neither sum is a state of the
// integration, so the audits detect errors of the equations and of the integration. The stored
// numbers are part of SimState. The functions change only these numbers.
#pragma once

#include <array>
#include <string>

#include "docking/docking_model.hpp"

namespace dockloop {

constexpr double kResidualsWarned[] = {0.01, 0.1};  ///< of the energy in play

/// The energy of one state.
struct EnergyBalance {
  double residual = 0.0;  ///< error of the balance since the start [J]
  double in_play = 0.0;   ///< upper bound of the energy, if no step creates energy [J]
};

struct EnergyAudit {
  double start = 0.0;      ///< [J]
  double in_play = 0.0;    ///< largest so far [J]
  double residual = 0.0;   ///< at the last accepted inner step [J]
  int warnings = 0;        ///< number of issued warnings about the residual
  double host_work = 0.0;  ///< work of prescribed motion [J]
};

struct MomentumAudit {
  std::array<Wrench<double>, 2> start;      ///< per vehicle, with changes by its host
  double residual = 0.0;                    ///< largest seen [-]
  double scale = 0.0, angular_scale = 0.0;  ///< largest seen [N s], [N m s]
};

/// Stored energy: legs and elements, contact, latches, hard dock, forces between the vehicles [J].
/// @pre calc_docking
template <class S>
S find_potential_energy(const DockingData<S>& data) {
  return data.joints.energy + data.elements.sums.energy + data.contact.energy + data.latch.energy +
         data.hard_dock.energy + data.forces.energy;
}
/// Kinetic and elastic energy [J]. @pre calc_docking
double find_total_energy(const DockingModel& model, const DockingData<double>& data);

/// Energy in play and error of the balance. @param y  state of `data`
EnergyBalance find_energy_balance(const DockingModel& model, const DockingData<double>& data,
                                  const double* y, const EnergyAudit& audit);
/// The largest energy in play so far [J], at least the error within tolerances.
double find_energy_scale(const EnergyAudit& audit, const EnergyBalance& balance,
                         double atol_energy);

/// The first state of a run.
void start_energy_audit(const DockingModel& model, const DockingData<double>& data, const double* y,
                        EnergyAudit& audit);
/// Does the step to `balance`, alone or with earlier steps, create more energy than was in play?
/// Error control has then accepted a wrong step. @param scale  find_energy_scale()
bool creates_energy(const EnergyAudit& audit, const EnergyBalance& balance, double scale);
/// Store the balance of an accepted step. @return whether the residual needs a warning
bool update_energy_audit(const EnergyBalance& balance, double scale, EnergyAudit& audit);

/// Is momentum conserved? A fixed vehicle receives any momentum.
bool conserves_momentum(const DockingModel& model);
/// The first state of a run. @param least_scale  [N s], of a run at rest
void start_momentum_audit(const DockingModel& model, const DockingData<double>& data,
                          double least_scale, MomentumAudit& audit);
/// The scales at a communication point.
void update_momentum_scales(const DockingModel& model, const DockingData<double>& data,
                            const double* y, MomentumAudit& audit);
/// Momentum summed over bodies against its start and the impulses from outside [-].
/// @pre all of `data` was evaluated
double find_momentum_residual(const DockingModel& model, const DockingData<double>& data,
                              const double* y, const MomentumAudit& audit);

}  // namespace dockloop
