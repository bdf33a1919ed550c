// When something begins that a file states: a failure of a law, a load on a vehicle.
#pragma once

#include <limits>
#include <string>

namespace dockloop {

/// At a time, or that long after a step of the sequence is first entered.
struct Onset {
  double time = 0.0;      ///< [s since the start, or since the step]
  std::string step_name;  ///< empty: the start of the run
  int step = -1;          ///< position of step_name in the sequence; -1: not found yet
};

/// @param entered  per step of the sequence, when it was entered first [s since the start], -1: not
/// yet; null: there is no sequence
/// @return [s since the start]; infinite: not known yet
inline double find_time(const Onset& onset, const double* entered) {
  if (onset.step_name.empty()) return onset.time;
  if (!entered || onset.step < 0 || entered[onset.step] < 0.0) {
    return std::numeric_limits<double>::infinity();
  }
  return entered[onset.step] + onset.time;
}

}  // namespace dockloop
