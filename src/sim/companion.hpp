// The error of a run, measured while it runs: a companion makes the same communication steps with
// smaller tolerances (or a quarter of the inner step). Its own error is far smaller, so the
// difference of the two is the error of the run.
//
// Figures and their scales are those of `dockloop run --estimate-error`
// (scripts/dockloop/result/run_errors.py): peak loads, stroke, time of capture, and the motion at
// the present point. A host with a vehicle of its own reacts to the run alone; the companion
// receives the same inputs. So the error of the inputs is not included.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "sim/docking_sim.hpp"
#include "sim/sim_state.hpp"

namespace dockloop {

/// What differences of the two runs are divided by, and the largest figure now.
struct ErrorRecord {
  enum Frame { kPosition, kAttitude, kVelocity, kAngularVelocity, kFrameCount };
  std::array<Vec3<double>, 2> ring_start{Vec3<double>::Zero(), Vec3<double>::Zero()};
  std::array<double, 2> stroke{};  ///< largest displacement of the ring [m]: run, companion
  Vec3<double> position_start = Vec3<double>::Zero();  ///< of the companion
  Vec4<double> attitude_start{1, 0, 0, 0};
  std::array<double, kFrameCount> largest{};  ///< of the companion: displacement, turn, speeds
  double error = 0.0;                         ///< [-] largest figure at the present point
  int figure = 0;                             ///< which one, see kErrorFigures
  bool is_lost = false;                       ///< a step of the companion failed
};

/// Contents of a saved state.
struct SavedCompanion {
  SavedSim sim;
  ErrorRecord record;
};

class Companion {
 public:
  /// @param kernels  as in DockingSim::use_kernels()
  Companion(const DockingSim& run, const Comparison* comparison,
            std::shared_ptr<const KernelLibrary> kernels);

  /// Start where the run has started. @throws ModelError as DockingSim::initialise() does
  void start(DockingSim& run, double t0, double tolerance);
  /// Take over the inputs of the coming step. Before the step of the run
  void take_inputs(DockingSim& run);
  /// Take over parameters that were changed between steps. @throws ModelError
  void take_tunables(DockingSim& run);
  /// Make the step that the run has made, and compare. @post `run` outputs the error
  void follow(DockingSim& run, double t, double h);
  void use_interruption(std::function<bool()> asks) { sim_.use_interruption(std::move(asks)); }

  struct Finding {
    bool is_warning;
    std::string text;
  };
  /// The error of the run. It is a warning where it is not known, or above the wanted one.
  Finding describe(DockingSim& run) const;

  void save(SavedCompanion& into) const;
  void load(const SavedCompanion& from, DockingSim& run);

 private:
  bool choose_finer(DockingSim& run, double t0, double tolerance);
  void state_error(DockingSim& run) const;

  DockingSim sim_;
  ErrorRecord record_;
};

}  // namespace dockloop
