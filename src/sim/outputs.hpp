// From an evaluated state to the continuous outputs, for plain and for dual numbers.
#pragma once

#include <array>
#include <vector>

#include "docking/docking_model.hpp"
#include "sim/sim_state.hpp"

namespace dockloop {

/// What outputs are read from.
template <class S>
struct OutputSource {
  const DockingModel& model;
  const Parameters& parameters;
  const RatedLoads& rated;
  const std::vector<int>& state_bodies;  ///< joints of state.*
  DockingData<S>& data;                  ///< after calc_docking; cut forces are written into it
  const S* y;                            ///< the state that it was evaluated at
  const ContactMemory& memory;           ///< of the last accepted state
  Vec3<double> frame_origin;             ///< O in N at the start [m]
  Vec3<S> frame_velocity, frame_shift;   ///< of O in N [m/s], [m]
  bool has_mean;                         ///< a step has been made
  std::array<Wrench<double>, 2> mean;    ///< mean load over it
  double host_work, energy_start;        ///< [J]
};

/// All but momentum. @pre calc_docking
template <class S>
void read_outputs(const OutputSource<S>& from, OutputValues<S>& out);

/// Momentum as a sum over bodies. @pre calc_docking, by the general code
template <class S>
void read_momentum(const OutputSource<S>& from, OutputValues<S>& out);

/// Loads on the target through the capture interface: tension, compression, shear [N], bending,
/// torsion [N m].
std::array<double, Outputs::kLoadCount> find_capture_loads(const DockingData<double>& data);

/// Values of which SimState keeps the peaks, but for those of legs: zero, because they need
/// reactions.
std::array<double, kPeakCount> find_searched_peaks(const DockingModel& model,
                                                   const RatedLoads& rated,
                                                   const DockingData<double>& data);
/// All of them. @param data  its reactions are computed
std::array<double, kPeakCount> find_peak_values(const DockingModel& model, const RatedLoads& rated,
                                                DockingData<double>& data);

/// Angle between the docking axes, and twist about them, of an attitude [rad].
template <class S>
S find_pitch_yaw(const Vec4<S>& attitude);
template <class S>
S find_roll(const Vec4<S>& attitude);

}  // namespace dockloop
