// Histories of inputs and motions: what tables of the scene prescribe over time.
#pragma once

#include <string>
#include <vector>

#include "math/types.hpp"

namespace dockloop {

constexpr int kMaxInputHistories = 64;

enum class InputKind { kForce, kTorque, kGravity, kLegCommand, kElementCommand, kCommand, kMotion };

/// An input over time: the value of the last row, or linear to the next one. The first and the last
/// value hold before and after the table. Or the motion of a vehicle: see find_recorded_motion().
struct InputHistory {
  std::string variable;  ///< its name in the FMU
  InputKind kind = InputKind::kForce;
  int of = 0;         ///< vehicle, leg or element
  int component = 0;  ///< of a vector
  bool is_linear = true;
  std::vector<double> time;  ///< never decreases; two rows of one time are a jump. In the model
                             ///< [s since the start], in the scene the time of the run [s]
  std::vector<double> value;
  /// Of kMotion, instead: position of the vehicle and quaternion, body to N (in the model to O),
  /// and their rates.
  std::vector<Vec7<double>> pose, pose_rate;
  double acceleration = 0.0, angular_acceleration = 0.0;  ///< largest [m/s2], [rad/s2]
};

/// An input near a time: value there, and slope.
struct InputLine {
  double value = 0.0, rate = 0.0;
};

/// Integrals of an input over a duration: once, and twice from zero.
struct InputIntegrals {
  double once = 0.0, twice = 0.0;
};

/// The last row at or before a time; -1: it is before the first one.
int find_row(const InputHistory& history, double time);
/// The line that begins with a row.
InputLine find_line(const InputHistory& history, int row, double time);
InputIntegrals find_integrals(const InputHistory& history, double from, double duration);

}  // namespace dockloop
