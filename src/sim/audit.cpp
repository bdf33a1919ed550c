// Sums of energy and momentum, and what they are compared with; see audit.hpp.
#include "sim/audit.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace dockloop {

double find_total_energy(const DockingModel& model, const DockingData<double>& data) {
  return find_kinetic_energy(model, data) + find_potential_energy(data);
}

EnergyBalance find_energy_balance(const DockingModel& model, const DockingData<double>& data,
                                  const double* y, const EnergyAudit& audit) {
  const double* sums = y + model.layout.sums;
  const double kinetic = find_kinetic_energy(model, data), potential = find_potential_energy(data);
  double dissipated = 0.0;
  for (int i : {kSumContact, kSumFriction, kSumLegs, kSumLatches}) dissipated += sums[i];
  EnergyBalance balance;
  double brought = sums[kSumExternal] + audit.host_work;
  if (model.layout.has_element_sums()) {
    dissipated += sums[kSumBrakes];
    brought += sums[kSumDrives];
  }
  if (model.layout.has_hard_dock_sum()) dissipated += sums[kSumHardDock];
  if (model.layout.has_force_sum()) dissipated += sums[model.layout.force_sum()];
  balance.residual = kinetic + potential + dissipated - brought - audit.start;
  // Start energy, external work and energy of springs: no quantity with an integration error.
  balance.in_play = std::abs(audit.start) + std::abs(brought) + std::max(0.0, -potential);
  return balance;
}

double find_energy_scale(const EnergyAudit& audit, const EnergyBalance& balance,
                         double atol_energy) {
  return std::max({audit.in_play, balance.in_play, 1e4 * atol_energy});
}

void start_energy_audit(const DockingModel& model, const DockingData<double>& data, const double* y,
                        EnergyAudit& audit) {
  audit.start = find_total_energy(model, data);
  audit.in_play = find_energy_balance(model, data, y, audit).in_play;
}

bool creates_energy(const EnergyAudit& audit, const EnergyBalance& balance, double scale) {
  constexpr double kMostMissing = 0.5;  // of the energy in play, for the sum of all steps
  const double created = std::abs(balance.residual - audit.residual);
  const bool adds_up = std::abs(balance.residual) > kMostMissing * scale &&
                       std::abs(balance.residual) > std::abs(audit.residual);
  return created > scale || adds_up;
}

bool update_energy_audit(const EnergyBalance& balance, double scale, EnergyAudit& audit) {
  audit.residual = balance.residual;
  audit.in_play = std::max(audit.in_play, balance.in_play);
  const double share = std::abs(audit.residual) / scale;
  const auto reached = std::count_if(std::begin(kResidualsWarned), std::end(kResidualsWarned),
                                     [&](double warned) { return share > warned; });
  if (reached <= audit.warnings) return false;
  audit.warnings = static_cast<int>(reached);
  return true;
}

bool conserves_momentum(const DockingModel& model) {
  return model.moves[kChaser] && (!model.present[kTarget] || model.moves[kTarget]);
}

void start_momentum_audit(const DockingModel& model, const DockingData<double>& data,
                          double least_scale, MomentumAudit& audit) {
  audit.scale = least_scale;
  for (int i : {kChaser, kTarget}) {
    audit.start[i] = find_momentum(model, i, data);
    audit.scale = std::max(audit.scale, audit.start[i].f.norm());
    audit.angular_scale = std::max(audit.angular_scale, audit.start[i].t.norm());
  }
}

void update_momentum_scales(const DockingModel& model, const DockingData<double>& data,
                            const double* y, MomentumAudit& audit) {
  for (int i : {kChaser, kTarget}) {
    if (!model.present[i]) continue;
    const Wrench<double> momentum = get_momentum(model, i, y, data);
    audit.scale = std::max({audit.scale, audit.start[i].f.norm(), momentum.f.norm()});
    audit.angular_scale =
        std::max({audit.angular_scale, audit.start[i].t.norm(), momentum.t.norm()});
  }
}

double find_momentum_residual(const DockingModel& model, const DockingData<double>& data,
                              const double* y, const MomentumAudit& audit) {
  if (!conserves_momentum(model)) return 0.0;
  Wrench<double> difference;
  for (int i : {kChaser, kTarget}) {
    if (model.present[i]) difference += find_momentum(model, i, data) - audit.start[i];
  }
  const double* impulse = y + model.layout.impulse;
  for (int j = 0; j < 3; ++j) {
    difference.f[j] -= impulse[j];
    difference.t[j] -= impulse[3 + j];
  }
  // An aligned docking has nearly no angular momentum about O. The scale is then the linear
  // momentum with a lever of 1 m.
  const double angular_scale = std::max(audit.angular_scale, audit.scale * 1.0);
  return std::max(difference.f.norm() / audit.scale, difference.t.norm() / angular_scale);
}

}  // namespace dockloop
