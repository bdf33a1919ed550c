// Limits that are watched while a simulation runs: those of the models, and those of the hardware.
//
// One table for all places that state them: log, FMU outputs limits.*, summaries, sweeps, reports.
// A limit is noticed once, at the first accepted inner step beyond it.
#pragma once

#include <array>
#include <string>

#include "docking/docking_model.hpp"

namespace dockloop {

enum Limit {
  kOverlapLimit,
  kPassedLimit,
  kStopLimit,
  kLoadLimit,
  kTiltLimit,
  kDepthLimit,
  kTimeOutLimit,
  kSingularLimit,
  kHullLimit,
  kLimitCount
};

/// A row of the table.
struct WatchedLimit {
  const char* name;      ///< in outputs and tables
  const char* unit;      ///< of value and limit: m, rad, s or 1
  const char* happened;  ///< the sentence for people: what is beyond the limit
  const char* means;     ///< and what follows from that
};

inline constexpr std::array<WatchedLimit, kLimitCount> kLimits = {{
    {"overlap", "m", "the mating planes of A and P overlap",
     "nothing is modelled behind them: do not trust loads and motion from here on"},
    {"passed", "m", "P is behind the capture surfaces of the chaser",
     "nothing is modelled there: do not trust loads and motion from here on"},
    {"stop", "1", "an end stop is deeper than its toe",
     "the travel of the mechanism is used up, and loads follow from the stiffness of the stop"},
    {"load", "1", "a load between ring and target is above its rated value",
     "nothing breaks in the model: compare capture.peak.* with the rated loads"},
    {"tilt", "rad", "surfaces touch with the rings tilted",
     "do not trust loads and motion from here on"},
    {"depth", "1", "surfaces are pressed in by nearly their rounding",
     "stiffen contact.stiffness or close more slowly: behind the rounding a step fails"},
    {"time_out", "s", "a step of the sequence timed out",
     "the sequence goes on as on_timeout of this step states"},
    {"singular", "1", "a loop is close to singular, or has passed a singular pose",
     "forces in the mechanism grow there, and motions that meet there differ by rounding"},
    {"hull", "m", "the hulls of the vehicles overlap",
     "nothing acts between hulls: do not trust loads and motion from here on"},
}};

/// Values at one state, and limits, of what is not noticed at an event.
struct LimitValues {
  std::array<double, kLimitCount> value{}, limit{};
  const std::string* part = nullptr;  ///< with the deepest end stop
};

/// First time beyond each limit [s since the start], -1 before, and the value then.
struct LimitRecord {
  bool has(Limit which) const { return time[which] >= 0.0; }
  void add(Limit which, double now, double at) {
    time[which] = now;
    value[which] = at;
  }
  /// Calls notice(Limit) for every limit that values are beyond for the first time.
  template <class F>
  void for_each_new(const LimitValues& found, F&& notice) const {
    for (int k = 0; k < kLimitCount; ++k) {
      const Limit which = static_cast<Limit>(k);
      if (!has(which) && found.value[k] > found.limit[k]) notice(which);
    }
  }
  /// Sum of 2^k over the limits k of the table.
  int find_bits() const;
  std::array<double, kLimitCount> time = [] {
    std::array<double, kLimitCount> never{};
    never.fill(-1.0);
    return never;
  }();
  std::array<double, kLimitCount> value{};
};

/// @param load_ratio  largest so far. @param data  after calc_docking()
LimitValues find_limit_values(const DockingModel& model, const DockingData<double>& data,
                              double load_ratio);

/// Sentence of one limit. @param t  [s]. @param part  that it concerns; may be null
std::string describe_limit(Limit which, double t, double value, double limit,
                           const std::string* part);

}  // namespace dockloop
