// Settings of the companion, and the figures of both runs; see companion.hpp.
#include "sim/companion.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "math/rotation.hpp"
#include "sim/solver_methods.hpp"

namespace dockloop {
namespace {

constexpr double kTighter = 1e-2;  ///< accuracy or tolerances of the companion
constexpr double kLeastRtol = 1e-13;
constexpr double kShorter = 0.25;    ///< its inner step, with fixed steps
constexpr double kOwnError = 0.1;    ///< of the companion, at most, over that of the run
constexpr double kLeast = 1e-3;      ///< no scale but that of a peak is smaller, in its unit
constexpr double kLeastPeak = 0.05;  ///< of the largest peak of its unit
constexpr double kLeastArm = 1e-3;   ///< [m] no moment has less than the largest force at this arm

enum Figure { kOutcome, kPeaks, kStroke = kPeaks + Outputs::kLoadCount, kCapture, kMotion };
constexpr const char* kErrorFigures[] = {"outcome",    "peak tension",    "peak compression",
                                         "peak shear", "peak bending",    "peak torsion",
                                         "stroke",     "time of capture", "position",
                                         "attitude",   "velocity",        "angular velocity"};
static_assert(std::size(kErrorFigures) == kMotion + ErrorRecord::kFrameCount);

/// Parameters of a run with smaller tolerances, without choices of its own.
Parameters tighten(DockingSim& run) {
  Parameters p = run.parameters();
  const Outputs& made = run.outputs();
  const Parameters stated = p;
  p.measures_error = false;
  p.solver_method = made.solver_chosen_method;
  if (find_method(made.solver_chosen_method)->fixed_step) {
    p.accuracy = 0.0;
    p.step = kShorter * made.solver_chosen_step;
    return p;
  }
  p.accuracy = std::max(0.0, stated.accuracy);  // real time chooses no tolerances
  const double used = made.solver_chosen_rtol;
  const double rtol = std::max(kTighter * used, std::min(used, kLeastRtol));
  // Never the default: it counts as not stated, and `accuracy` would choose it.
  p.rtol = p.accuracy > 0.0 ? rtol * (1.0 + 1e-9) : rtol;
  const SolverSettings defaults;
  const auto tighten_one = [&](double& value, double standard) {
    if (p.accuracy > 0.0 && value == standard) return;  // follows from the docking
    value *= std::min(1.0, used / stated.rtol) * rtol / used;
  };
  tighten_one(p.atol_position, defaults.atol_position);
  tighten_one(p.atol_velocity, defaults.atol_velocity);
  tighten_one(p.atol_energy, defaults.atol_energy);
  return p;
}

/// The frame whose motion is judged: P seen from A, without a target the ring.
struct FrameValues {
  Vec3<double> position;
  Vec4<double> attitude;
  Vec3<double> velocity, angular_velocity;
};

FrameValues find_frame(const Outputs& o, bool has_target) {
  if (!has_target) {
    return {o.ring_position, o.ring_attitude, o.ring_velocity, o.ring_angular_velocity};
  }
  return {o.relative_position, o.relative_attitude, o.relative_velocity,
          o.relative_angular_velocity};
}

/// What peaks are divided by; 0: there is no load of this unit.
std::array<double, Outputs::kLoadCount> find_peak_scales(const Outputs& finer) {
  double force = 0.0, moment = 0.0;
  const auto is_force = [](int load) { return load < Outputs::kBending; };
  for (int i = 0; i < Outputs::kLoadCount; ++i) {
    double& largest = is_force(i) ? force : moment;
    largest = std::max(largest, finer.capture_peak[static_cast<size_t>(i)].value);
  }
  std::array<double, Outputs::kLoadCount> scales{};
  for (int i = 0; i < Outputs::kLoadCount; ++i) {
    const double least =
        is_force(i) ? kLeastPeak * force : std::max(kLeastPeak * moment, kLeastArm * force);
    const auto at = static_cast<size_t>(i);
    scales[at] = std::max(finer.capture_peak[at].value, least);
  }
  return scales;
}

void begin(ErrorRecord& record, const Outputs& run, const Outputs& finer, bool has_target) {
  record = {};
  record.ring_start = {run.ring_position, finer.ring_position};
  const FrameValues frame = find_frame(finer, has_target);
  record.position_start = frame.position;
  record.attitude_start = frame.attitude;
}

/// The figures at the present point; the largest is kept.
void note(ErrorRecord& record, const Outputs& run, const Outputs& finer, bool has_target) {
  record.error = 0.0;
  const auto add = [&](int figure, double difference, double scale) {
    const double error = scale > 0.0 ? difference / scale : 0.0;
    if (error > record.error) {
      record.error = error;
      record.figure = figure;
    }
  };
  const bool is_captured = run.time_of_capture != kNoTime;
  const bool is_other = finer.time_of_capture != kNoTime;
  if (run.outcome != finer.outcome || run.captured != finer.captured || is_captured != is_other) {
    add(kOutcome, 1.0, 1.0);
  } else if (is_captured) {
    add(kCapture, std::abs(run.time_of_capture - finer.time_of_capture),
        std::max(finer.time_of_capture - finer.time_of_contact, kLeast));
  }
  const auto scales = find_peak_scales(finer);
  for (size_t i = 0; i < scales.size(); ++i) {
    add(kPeaks + static_cast<int>(i),
        std::abs(run.capture_peak[i].value - finer.capture_peak[i].value), scales[i]);
  }
  const auto raise = [](double& largest, double value) { largest = std::max(largest, value); };
  raise(record.stroke[0], (run.ring_position - record.ring_start[0]).norm());
  raise(record.stroke[1], (finer.ring_position - record.ring_start[1]).norm());
  add(kStroke, std::abs(record.stroke[0] - record.stroke[1]), std::max(record.stroke[1], kLeast));
  const FrameValues ours = find_frame(run, has_target), theirs = find_frame(finer, has_target);
  raise(record.largest[ErrorRecord::kPosition], (theirs.position - record.position_start).norm());
  raise(record.largest[ErrorRecord::kAttitude],
        find_turn<double>(record.attitude_start, theirs.attitude).norm());
  raise(record.largest[ErrorRecord::kVelocity], theirs.velocity.norm());
  raise(record.largest[ErrorRecord::kAngularVelocity], theirs.angular_velocity.norm());
  const std::array<double, ErrorRecord::kFrameCount> apart = {
      (ours.position - theirs.position).norm(),
      find_turn<double>(ours.attitude, theirs.attitude).norm(),
      (ours.velocity - theirs.velocity).norm(),
      (ours.angular_velocity - theirs.angular_velocity).norm()};
  for (size_t i = 0; i < apart.size(); ++i) {
    add(kMotion + static_cast<int>(i), apart[i], std::max(record.largest[i], kLeast));
  }
}

}  // namespace

Companion::Companion(const DockingSim& run, const Comparison* comparison,
                     std::shared_ptr<const KernelLibrary> kernels)
    : sim_(run.shared_scene(), run.fmi_kind(), comparison) {
  sim_.use_kernels(std::move(kernels));
}

/// Let a smaller accuracy choose: the cheapest settings. @return whether their promise is small
/// enough; not where settings are stated, or where no error was measured
bool Companion::choose_finer(DockingSim& run, double t0, double tolerance) {
  sim_.parameters() = run.parameters();
  sim_.parameters().measures_error = false;
  sim_.parameters().accuracy *= kTighter;
  constexpr double kSlack = 1.1;
  const double promised = run.outputs().solver_error_estimate;
  if (!(promised > 0.0)) return false;
  sim_.initialise(t0, tolerance);
  const double own = sim_.outputs().solver_error_estimate;
  return own > 0.0 && own <= kSlack * kTighter * promised;
}

void Companion::start(DockingSim& run, double t0, double tolerance) {
  sim_.inputs() = run.inputs();
  if (!choose_finer(run, t0, tolerance)) {
    sim_.parameters() = tighten(run);
    sim_.initialise(t0, tolerance);
  }
  begin(record_, run.outputs(), sim_.outputs(), run.scene().has_target);
  run.state_error(0.0);
}

void Companion::take_inputs(DockingSim& run) {
  if (record_.is_lost) return;
  sim_.inputs() = run.inputs();
  sim_.input_slopes() = run.input_slopes();
}

void Companion::take_tunables(DockingSim& run) {
  if (record_.is_lost) return;
  Parameters& own = sim_.parameters();
  const SolverSettings settings = get_settings(own);
  const double accuracy = own.accuracy;
  own = run.parameters();
  own.measures_error = false;
  own.accuracy = accuracy;
  put_settings(settings, own);
  sim_.adopt_tunables();
}

void Companion::follow(DockingSim& run, double t, double h) {
  if (record_.is_lost) return;
  record_.is_lost = !sim_.step(t, h).ok();
  if (!record_.is_lost && run.update(OutputGroup::kMain).ok() &&
      sim_.update(OutputGroup::kMain).ok()) {
    note(record_, run.output_storage(), sim_.output_storage(), run.scene().has_target);
  }
  state_error(run);
}

/// @post the output solver.error_estimate of `run`
void Companion::state_error(DockingSim& run) const {
  run.state_error(record_.is_lost ? 0.0 : std::min(1.0, (1.0 + kOwnError) * record_.error));
}

Companion::Finding Companion::describe(DockingSim& run) const {
  if (record_.is_lost) {
    return {true,
            "solver.error_estimate has no value: a step of the companion with smaller tolerances "
            "failed (" +
                sim_.status_text() + ")"};
  }
  if (record_.figure == kOutcome && record_.error >= 1.0) {
    return {true,
            "the outcome depends on the last digits: a companion with smaller tolerances ends "
            "otherwise, so loads and times are not determined"};
  }
  const double accuracy = run.parameters().accuracy;
  const bool is_above = accuracy > 0.0 && record_.error > accuracy;
  char text[300];
  const int length = std::snprintf(text, sizeof text,
                                   "the error of this run is %.2g (%s), measured by a companion",
                                   record_.error, kErrorFigures[record_.figure]);
  if (is_above) {
    std::snprintf(text + length, sizeof text - static_cast<size_t>(length),
                  ", above accuracy = %.3g: small changes grow in this motion (repeated contacts, "
                  "play); a smaller accuracy helps",
                  accuracy);
  }
  return {is_above, text};
}

void Companion::save(SavedCompanion& into) const {
  sim_.save(into.sim);
  into.record = record_;
}

void Companion::load(const SavedCompanion& from, DockingSim& run) {
  constexpr int kCount = static_cast<int>(std::size(kErrorFigures));
  if (from.record.figure < 0 || from.record.figure >= kCount) {
    throw ModelError("the saved state does not fit this model");
  }
  sim_.load(from.sim);
  record_ = from.record;
  state_error(run);
}

}  // namespace dockloop
