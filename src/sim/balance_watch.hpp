// Balances of energy and momentum during a run (audit.hpp), with their messages.
#pragma once

#include <string>
#include <vector>

#include "sim/sim_state.hpp"

namespace dockloop {

class BalanceWatch {
 public:
  /// Keeps references to `state` and to both texts. @param remedy  for a step that creates energy
  BalanceWatch(SimState& state, double atol_energy, double t_start, const char* remedy,
               std::string& status_text, std::vector<std::string>& warnings);

  /// The energy of one state. @param data  evaluation of y
  EnergyBalance find_energy(const DockingModel& model, const DockingData<double>& data,
                            const double* y) const;
  /// Does the inner step that ends at tau create energy? If so, status_text contains the message.
  bool is_energy_created(const EnergyBalance& found, double tau);
  /// Has a state inside an inner step the balance of its end, within a part of the energy in play,
  /// and no residual that needs a warning where the end needs none?
  bool is_good_inside(const EnergyBalance& found, const EnergyBalance& end) const;
  /// Updates the energy audit. Issues a warning at a residual of 1 %, and again at 10 %.
  void update_energy(const EnergyBalance& found, double tau);
  /// Updates the scales of momentum and the largest residual. @param data  complete evaluation of y
  void update_momentum(const DockingModel& model, const DockingData<double>& data, const double* y);

 private:
  double find_scale(const EnergyBalance& found) const;

  SimState& state_;
  double atol_energy_, t_start_;
  const char* remedy_;
  std::string& status_text_;
  std::vector<std::string>& warnings_;
};

}  // namespace dockloop
