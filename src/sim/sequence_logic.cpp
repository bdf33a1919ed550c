// See sequence_logic.hpp.
#include "sim/sequence_logic.hpp"

#include <algorithm>
#include <cmath>

#include "sim/outputs.hpp"

namespace dockloop {
namespace {

/// A condition that holds ends this far beyond its bound, in the unit of the quantity: more than
/// the rounding of a located state, less than any bound means.
constexpr double kRelease = 3e-9;
constexpr double kExactGap =
    0.05;                          ///< a gap is exact as long as it is not so far above a bound [m]
constexpr double kInstant = 1e-6;  ///< changes within this time count as simultaneous [s]

double find_sign(bool holds) { return holds ? -1.0 : 1.0; }

/// Tolerance of a comparison of times [s].
double find_slack(double rounding) { return 4.0 * rounding; }

}  // namespace

// ---------------------------------------------------------------- conditions

double SequenceLogic::find_clock(double now) const {
  return (state_.command == kHold ? state_.held_since : now) - state_.stood;
}

double SequenceLogic::find_quantity(const Condition& part, DockingData<double>& at) const {
  const auto relative = [&] { return find_across(*model_, at); };
  const auto load = [&] {
    return find_capture_loads(
        at)[static_cast<size_t>(part.quantity) - static_cast<size_t>(Measured::kCaptureTension)];
  };
  const size_t latch = static_cast<size_t>(part.index);
  const MechanismModel& mechanism = model_->mechanism.model;
  switch (part.quantity) {
    case Measured::kTime:
      break;
    case Measured::kGap: {
      const double bound = std::isfinite(part.low) ? part.low : part.high;
      const bool is_sure = at.contact.gap < 0.0 || at.contact.gap > bound + kExactGap;
      if (is_sure || model_->contact.empty()) return at.contact.gap;
      return find_gap(model_->contact, memory_, at.relative, at.contact_work);
    }
    case Measured::kRelativePosition:
      return relative().p[part.index];
    case Measured::kRelativeVelocity:
      return relative().v[part.index];
    case Measured::kRelativeAxial:
      return relative().p.x();
    case Measured::kRelativeLateral:
      return relative().p.tail<2>().norm();
    case Measured::kRelativePitchYaw:
      return find_pitch_yaw<double>(quat_from_matrix<double>(relative().R));
    case Measured::kRelativeRoll:
      return find_roll<double>(quat_from_matrix<double>(relative().R));
    case Measured::kRelativeSpeed:
      return relative().v.norm();
    case Measured::kRelativeAngularSpeed:
      return relative().w.norm();
    case Measured::kCaptureAxial:
      return at.relative.p.x() + model_->contact.depth;
    case Measured::kCaptureAxialRate:
      return at.relative.v.x();
    case Measured::kCaptureTension:
    case Measured::kCaptureCompression:
    case Measured::kCaptureShear:
    case Measured::kCaptureBending:
    case Measured::kCaptureTorsion:
      return load();
    case Measured::kRingPosition:
      return find_relative(at.interface[kChaser], at.capture).p[part.index];
    case Measured::kLegLength: {
      const Leg& leg = mechanism.legs[latch];
      return leg.home_length + leg.arm * at.mechanism.tree.q[mechanism.bodies[leg.body].q_index];
    }
    case Measured::kLegRate: {
      const Leg& leg = mechanism.legs[latch];
      return leg.arm * at.mechanism.tree.v[mechanism.bodies[leg.body].v_index];
    }
    case Measured::kLatchOpening:
      return at.latch.opening[latch];
    case Measured::kLatchForce:
      return at.latch.force[latch];
    case Measured::kSurfaceForce:
      return at.contact.surface_force[static_cast<size_t>(part.index)].norm();
    case Measured::kElementCoordinate:
      return at.elements.coordinate[part.index];
    case Measured::kElementRate:
      return at.elements.rate[part.index];
    case Measured::kElementForce:
      return at.elements.force[part.index];
    case Measured::kElementSaturation:
      return at.elements.saturation[part.index];
  }
  return 0.0;
}

double SequenceLogic::find_value(const Condition& part, DockingData<double>& at, double now) const {
  const auto held = [&] { return count_held(model_->latches, discrete_.latch.data()); };
  switch (part.kind) {
    case Condition::Kind::kLatched:
      return find_sign(held() >= part.number);
    case Condition::Kind::kLatchedBelow:
      return find_sign(held() < part.number);
    case Condition::Kind::kHooksClosed:
      return find_sign(count_closed_hooks(model_->hard_dock, discrete_.hard_dock) >= part.number);
    case Condition::Kind::kCommand:
      return find_sign(state_.command == part.number);
    case Condition::Kind::kBounds:
      break;
  }
  if (part.quantity == Measured::kTime) {
    const double time = find_time_in_step(now);
    return find_sign(time >= part.low && time < part.high);
  }
  const double value = find_quantity(part, at);
  return std::max(part.low - value, value - part.high);
}

double SequenceLogic::find_value(const When& when, DockingData<double>& at, double now) const {
  double found = when.any ? kNever : -kNever;
  for (const Condition& part : when.parts) {
    const double value = find_value(part, at, now);
    found = when.any ? std::min(found, value) : std::max(found, value);
  }
  return found;
}

void SequenceLogic::calc_functions(DockingData<double>& at, double* roots) const {
  std::fill_n(roots, root_count(), 1.0);
  const std::vector<SequenceRow>& rows = step().next;
  for (size_t i = 0; i < rows.size(); ++i) {
    const double value = find_value(rows[i].when, at, state_.seen);
    roots[i] = state_.since[i] < 0.0 ? value : kRelease - value;
  }
}

double SequenceLogic::find_speed(const Condition& part, const DockingData<double>& at) const {
  if (part.kind != Condition::Kind::kBounds) return 0.0;
  const auto relative = [&] { return find_across(*model_, at); };
  switch (part.quantity) {
    case Measured::kGap:
      return model_->contact.has_surfaces() ? find_approach_bound(model_->contact, at.relative)
                                            : at.relative.v.norm();
    case Measured::kRelativePosition:
    case Measured::kRelativeAxial:
    case Measured::kRelativeLateral:
      return relative().v.norm();
    case Measured::kRelativePitchYaw:
    case Measured::kRelativeRoll:
      return relative().w.norm();
    case Measured::kCaptureAxial:
      return at.relative.v.norm();
    case Measured::kRingPosition:
      return find_relative(at.interface[kChaser], at.capture).v.norm();
    case Measured::kLegLength: {
      const MechanismModel& mechanism = model_->mechanism.model;
      const Leg& leg = mechanism.legs[static_cast<size_t>(part.index)];
      return std::abs(leg.arm * at.mechanism.tree.v[mechanism.bodies[leg.body].v_index]);
    }
    case Measured::kLatchOpening:
      return find_latch_motion(model_->latches, part.index, at.relative).rate.norm();
    case Measured::kElementCoordinate:
      return std::abs(at.elements.rate[part.index]);
    default:
      return 0.0;
  }
}

void SequenceLogic::calc_speeds(const DockingData<double>& at, double* speeds) const {
  std::fill_n(speeds, root_count(), 0.0);
  if (!exists()) return;
  const std::vector<SequenceRow>& rows = step().next;
  for (size_t i = 0; i < rows.size(); ++i) {
    for (const Condition& part : rows[i].when.parts) {
      speeds[i] = std::max(speeds[i], find_speed(part, at));
    }
  }
}

bool SequenceLogic::is_timed_out(double now, double slack) const {
  return step().timeout > 0.0 && !state_.timed_out &&
         find_time_in_step(now) + slack >= step().timeout;
}

/// The first row that is due, -1 if none is. @param[in,out] since  as SequenceState::since
int SequenceLogic::find_row(DockingData<double>& at, double now, double slack, const char* due,
                            std::array<double, kMaxRows>& since) const {
  const std::vector<SequenceRow>& rows = step().next;
  for (size_t i = 0; i < rows.size(); ++i) {
    const bool waits = since[i] >= 0.0, passed = due && due[i];
    const double value = find_value(rows[i].when, at, now + slack);
    const bool holds = waits ? !passed && value <= kRelease : passed || value <= 0.0;
    if (holds != waits) since[i] = holds ? find_clock(now) : -1.0;
    if (holds && find_clock(now) + slack >= since[i] + rows[i].when.dwell)
      return static_cast<int>(i);
  }
  return -1;
}

double SequenceLogic::find_next_time(double now) const {
  double next = kNever;
  for (const LateSettings& late : discrete_.late) {
    for (int i = 0; i < late.count; ++i) {
      const double arrival = late.entry[static_cast<size_t>(i)].arrival;
      if (arrival > now) next = std::min(next, arrival);
    }
  }
  if (!exists() || state_.command == kHold) return next;
  const auto add = [&](double clock) {
    const double time = clock + state_.stood;
    if (time > now) next = std::min(next, time);
  };
  const std::vector<SequenceRow>& rows = step().next;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (state_.since[i] >= 0.0) add(state_.since[i] + rows[i].when.dwell);
    for (const Condition& part : rows[i].when.parts) {
      if (part.kind != Condition::Kind::kBounds || part.quantity != Measured::kTime) continue;
      add(state_.began + part.low);
      add(state_.began + part.high);
    }
  }
  if (step().timeout > 0.0 && !state_.timed_out) add(state_.began + step().timeout);
  return next;
}

bool SequenceLogic::is_waiting() const {
  if (!exists()) return true;
  const auto arrives = [](const LateSettings& late) { return late.count > 0; };
  const auto is_command = [](const Condition& part) {
    return part.kind == Condition::Kind::kCommand;
  };
  const auto awaits_command = [&](const SequenceRow& row) {
    return std::all_of(row.when.parts.begin(), row.when.parts.end(), is_command);
  };
  return !(step().timeout > 0.0) &&
         std::none_of(state_.since.begin(), state_.since.end(),
                      [](double since) { return since >= 0.0; }) &&
         std::all_of(step().next.begin(), step().next.end(), awaits_command) &&
         std::none_of(discrete_.late.begin(), discrete_.late.end(), arrives);
}

namespace {

/// How much later a motor or drive starts that no sequence sets [s]. @param number  of its law
double find_start_delay(const std::vector<LawFailure>& failures, int number) {
  double delay = 0.0;
  for (const LawFailure& failure : failures) {
    if (!failure.active || failure.kind != LawFailure::Kind::kDelayed) continue;
    if (failure.number == number && failure.onset.time <= 0.0) delay = failure.value;
  }
  return delay;
}

}  // namespace

bool SequenceLogic::are_drives_starting(double now) const {
  const std::vector<LawFailure>& failures = model_->mechanism.model.failures;
  int place = 0;  // among the laws of all elements
  for (const ForceElement& element : model_->mechanism.model.elements) {
    for (const ForceLaw& law : element.laws) {
      LawSetting setting;
      if (exists()) {
        setting = discrete_.law[static_cast<size_t>(place)];
      } else {
        setting.since = find_start_delay(failures, place);
      }
      ++place;
      const DriveLaw* drive = std::get_if<DriveLaw>(&law);
      if (!drive || setting.drive == LawSetting::Drive::kOff) continue;
      const bool runs = setting.drive == LawSetting::Drive::kRuns;
      const double acceleration = runs ? setting.acceleration : drive->acceleration;
      const double speed = runs ? setting.speed : drive->speed;
      if ((now - setting.since) * acceleration < speed) return true;
    }
  }
  return false;
}

// ---------------------------------------------------------------- steps

void SequenceLogic::start() {
  state_ = SequenceState();
  state_.since.fill(-1.0);
  state_.step = model_->sequence.start;
  discrete_.entered.assign(model_->sequence.steps.size(), -1.0);
  discrete_.law.assign(static_cast<size_t>(count_laws(model_->mechanism.model.elements)),
                       LawSetting());
  discrete_.late.assign(model_->mechanism.model.failures.size(), LateSettings());
  discrete_.lock.assign(model_->mechanism.model.elements.size(), ElementLock());
}

bool SequenceLogic::update_command(int command, double now) {
  if (!is_new(command)) return false;
  const bool resumes = state_.command == kHold;
  if (resumes) state_.stood += now - state_.held_since;
  state_.command = command;
  state_.held_since = now;
  if (command != kHold && !resumes) return true;
  for (int law = 0; law < static_cast<int>(discrete_.law.size()); ++law) {
    const Change made = change_setting(law, now);
    made.setting.is_held = command == kHold;
    if (resumes) made.setting.since = made.arrival;
  }
  return true;
}

SequenceChange SequenceLogic::update(DockingData<double>& at, double now, double clock_rounding,
                                     const char* due, double* sums) {
  const double slack = find_slack(clock_rounding);
  const bool arrives = deliver(now + slack);
  SequenceChange change = take_step(at, now, slack, due, sums);
  change.events = change.events || arrives;
  change.equations = change.equations || arrives;
  return change;
}

SequenceChange SequenceLogic::take_step(DockingData<double>& at, double now, double slack,
                                        const char* due, double* sums) {
  if (discrete_.captured != state_.was_captured) {
    if (discrete_.captured) state_.outcome = kOutcomeCaptured;
    if (!discrete_.captured && state_.outcome == kOutcomeCaptured) state_.outcome = 0;
  }
  state_.was_captured = discrete_.captured;
  state_.seen = now;
  const std::array<double, kMaxRows> before = state_.since;
  const int row = find_row(at, now, slack, due, state_.since);
  const Occasion occasion{at, now, sums};
  if (row >= 0) return follow(step().next[static_cast<size_t>(row)], occasion);
  SequenceChange change;
  if (is_timed_out(now, slack)) {
    const double timeout = step().timeout;
    change = follow(step().on_timeout, occasion);
    change.timed_out = timeout;
    return change;
  }
  change.events = state_.since != before;
  return change;
}

bool SequenceLogic::is_change_due(DockingData<double>& at, double now,
                                  double clock_rounding) const {
  const double slack = find_slack(clock_rounding);
  std::array<double, kMaxRows> since = state_.since;
  return is_arrival_due(now + slack) || find_row(at, now, slack, nullptr, since) >= 0 ||
         since != state_.since || is_timed_out(now, slack);
}

SequenceChange SequenceLogic::follow(const SequenceBranch& branch, const Occasion& occasion) {
  const double now = occasion.now;
  SequenceChange change;
  change.events = true;
  if (branch.go < 0) {
    state_.timed_out = true;
    state_.outcome = branch.outcome;
    return change;
  }
  if (!(now - state_.instant <= kInstant)) {
    state_.instant = now;
    state_.changes = 0;
  }
  if (state_.changes == kMaxChanges) {
    change.chatters = true;
    return change;
  }
  state_.visited[static_cast<size_t>(state_.changes++)] = state_.step;
  enter(branch.go, branch.outcome, occasion);
  change.step = true;
  change.equations = !step().actions.empty() || begins_something();
  return change;
}

void SequenceLogic::enter(int to, int outcome, const Occasion& occasion) {
  state_.step = to;
  state_.began = find_clock(occasion.now);
  state_.since.fill(-1.0);
  state_.timed_out = false;
  double& entered = discrete_.entered[static_cast<size_t>(to)];
  if (entered < 0.0) entered = occasion.now;
  if (step().outcome) outcome = step().outcome;
  // All latches may catch at the first contact.
  const int begun = discrete_.captured ? kOutcomeCaptured : 0;
  if (outcome || step().phase <= kContact) state_.outcome = outcome ? outcome : begun;
  for (const Action& action : step().actions) {
    std::visit([&](const auto& each) { act(each, occasion); }, action);
  }
}

bool SequenceLogic::begins_something() const {
  const auto& failures = model_->mechanism.model.failures;
  return std::any_of(failures.begin(), failures.end(), [this](const LawFailure& failure) {
    return failure.onset.step == state_.step;
  });
}

std::string SequenceLogic::list_visited() const {
  std::string text;
  for (int i = 0; i < state_.changes; ++i) {
    const int at = state_.visited[static_cast<size_t>(i)];
    const std::string name = "'" + model_->sequence.steps[static_cast<size_t>(at)].name + "'";
    if (text.find(name) == std::string::npos) text += (text.empty() ? "" : ", ") + name;
  }
  return text;
}

void SequenceLogic::update_phase(int held) {
  discrete_.phase = step().phase;
  const int so_far = held > 0 ? kPartialCapture : kUndecided;
  discrete_.outcome = state_.outcome ? state_.outcome : so_far;
}

// ---------------------------------------------------------------- actions

void SequenceLogic::act(const ThrustAction& action, const Occasion& occasion) {
  state_.thrust_since = action.on ? occasion.now : -1.0;
}

std::optional<double> SequenceLogic::find_thrust_onset() const {
  if (state_.thrust_since < 0.0) return std::nullopt;
  return state_.thrust_since + model_->thrust_delay;
}

void SequenceLogic::act(const LatchesAction& action, const Occasion& occasion) {
  state_.is_armed = action.arm;
  if (action.arm) return;
  for (int i = 0; i < model_->latches.count(); ++i) {
    occasion.sums[kSumLatches] +=
        release_latch(model_->latches, i, occasion.now, occasion.at.relative,
                      discrete_.latch[static_cast<size_t>(i)]);
  }
}

/// EventLogic::update_capture() follows.
void SequenceLogic::act(const GraspAction& action, const Occasion&) {
  state_.has_grasped = action.holds;
}

/// If too many settings are on their way, the last one is replaced.
SequenceLogic::Change SequenceLogic::change_setting(int law, double now) {
  LawSetting& acting = discrete_.law[static_cast<size_t>(law)];
  const std::vector<LawFailure>& failures = model_->mechanism.model.failures;
  for (size_t k = 0; k < failures.size(); ++k) {
    const LawFailure& failure = failures[k];
    if (failure.kind != LawFailure::Kind::kDelayed || failure.number != law) continue;
    if (!failure.active || now < find_time(failure.onset, discrete_.entered.data())) continue;
    LateSettings& late = discrete_.late[k];
    const size_t last = static_cast<size_t>(std::max(late.count - 1, 0));
    const LawSetting newest = late.count > 0 ? late.entry[last].setting : acting;
    late.count = std::min(late.count + 1, kMaxUnderWay);
    LateSettings::Entry& entry = late.entry[static_cast<size_t>(late.count - 1)];
    entry = {now + failure.value, newest};
    return {entry.setting, entry.arrival};
  }
  return {acting, now};
}

bool SequenceLogic::is_arrival_due(double at) const {
  return std::any_of(discrete_.late.begin(), discrete_.late.end(), [at](const LateSettings& late) {
    return late.count > 0 && late.entry[0].arrival <= at;
  });
}

bool SequenceLogic::deliver(double at) {
  if (!is_arrival_due(at)) return false;
  for (size_t k = 0; k < discrete_.late.size(); ++k) {
    LateSettings& late = discrete_.late[k];
    const auto begin = late.entry.begin(), end = begin + late.count;
    const auto waits = std::find_if(begin, end, [at](const auto& e) { return e.arrival > at; });
    if (waits == begin) continue;
    const size_t law = static_cast<size_t>(model_->mechanism.model.failures[k].number);
    discrete_.law[law] = (waits - 1)->setting;
    late.count = static_cast<int>(end - waits);
    std::move(waits, end, begin);
  }
  return true;
}

void SequenceLogic::act(const RunAction& action, const Occasion& occasion) {
  for (const RunAction::Drive& drive : action.drives) {
    const Change made = change_setting(drive.law, occasion.now);
    LawSetting& law = made.setting;
    law.drive = action.on ? LawSetting::Drive::kRuns : LawSetting::Drive::kOff;
    law.since = made.arrival;
    law.target = action.target;
    law.speed = drive.speed;
    law.acceleration = drive.acceleration;
    law.deceleration = drive.deceleration;
  }
}

void SequenceLogic::act(const EngagementAction& action, const Occasion& occasion) {
  for (const int law : action.laws) {
    change_setting(law, occasion.now).setting.engagement = action.engagement;
  }
}

/// An element that is held already stays where it is. What an open lock has stored is lost.
void SequenceLogic::act(const LockAction& action, const Occasion& occasion) {
  for (const int element : action.elements) {
    ElementLock& lock = discrete_.lock[static_cast<size_t>(element)];
    if (lock.is_closed() == action.lock.is_closed()) continue;
    const double place = occasion.at.elements.coordinate[element];
    if (lock.is_closed()) occasion.sums[kSumBrakes] += lock.find_energy(place);
    lock = action.lock;
    lock.place = place;
  }
}

void SequenceLogic::act(const HooksAction& action, const Occasion& occasion) {
  if (action.close) {
    close_hooks(discrete_.hard_dock);
  } else {
    open_hooks(model_->hard_dock, occasion.now, discrete_.hard_dock);
  }
}

void SequenceLogic::act(const PushersAction& action, const Occasion& occasion) {
  switch_pushers(model_->hard_dock, action.on, occasion.now, discrete_.hard_dock);
}

/// The caller of update() carries it out: momenta and poses change.
void SequenceLogic::act(const JointAction& action, const Occasion&) {
  discrete_.hard_dock.wants_joint = action.rigid && model_->present[kTarget];
}

}  // namespace dockloop
