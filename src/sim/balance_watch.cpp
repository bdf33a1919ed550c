// Balances of energy and momentum during a run; see balance_watch.hpp.
#include "sim/balance_watch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace dockloop {
namespace {

constexpr double kAlike = 0.001;  ///< of the energy in play, less than kResidualsWarned

}  // namespace

BalanceWatch::BalanceWatch(SimState& state, double atol_energy, double t_start, const char* remedy,
                           std::string& status_text, std::vector<std::string>& warnings)
    : state_(state),
      atol_energy_(atol_energy),
      t_start_(t_start),
      remedy_(remedy),
      status_text_(status_text),
      warnings_(warnings) {}

EnergyBalance BalanceWatch::find_energy(const DockingModel& model, const DockingData<double>& data,
                                        const double* y) const {
  return find_energy_balance(model, data, y, state_.energy_audit);
}

double BalanceWatch::find_scale(const EnergyBalance& found) const {
  return find_energy_scale(state_.energy_audit, found, atol_energy_);
}

bool BalanceWatch::is_energy_created(const EnergyBalance& found, double tau) {
  const EnergyAudit& audit = state_.energy_audit;
  const double there = find_scale(found);
  if (!creates_energy(audit, found, there)) return false;
  char text[400];
  std::snprintf(
      text, sizeof text,
      "the inner step to t = %.9g s makes the energy audit wrong by %.3g J (%.3g J so far), "
      "with %.3g J in play: shorten the step (solver.step of a fixed-step method), decrease "
      "solver.rtol, or set solver.method = 1 (auto)",
      t_start_ + state_.elapsed + tau, std::abs(found.residual - audit.residual),
      std::abs(found.residual), there);
  status_text_ = text;
  return true;
}

bool BalanceWatch::is_good_inside(const EnergyBalance& found, const EnergyBalance& end) const {
  const double scale = find_scale(end), residual = std::abs(found.residual);
  return std::abs(found.residual - end.residual) <= kAlike * scale &&
         (residual <= kResidualsWarned[0] * scale ||
          std::abs(end.residual) > kResidualsWarned[0] * scale || state_.energy_audit.warnings > 0);
}

void BalanceWatch::update_energy(const EnergyBalance& found, double tau) {
  EnergyAudit& audit = state_.energy_audit;
  const double there = find_scale(found);
  if (!update_energy_audit(found, there, audit)) return;
  char text[300];
  std::snprintf(text, sizeof text,
                "the energy audit is off by %.3g J at t = %.9g s, %.2g of the %.3g J in play: "
                "loads and motion may have larger errors; decrease %s",
                audit.residual, t_start_ + state_.elapsed + tau, std::abs(audit.residual) / there,
                there, remedy_);
  warnings_.push_back(text);
}

void BalanceWatch::update_momentum(const DockingModel& model, const DockingData<double>& data,
                                   const double* y) {
  if (!conserves_momentum(model)) return;
  MomentumAudit& audit = state_.momentum_audit;
  update_momentum_scales(model, data, y, audit);
  audit.residual = std::max(audit.residual, find_momentum_residual(model, data, y, audit));
}

}  // namespace dockloop
