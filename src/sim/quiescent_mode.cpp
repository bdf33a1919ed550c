// Quiescent mechanism and free drift; see quiescent_mode.hpp.
#include "sim/quiescent_mode.hpp"

#include <algorithm>
#include <cmath>

#include "math/rigid_body.hpp"

namespace dockloop {
namespace {

constexpr double kAwake = 0.01;      ///< gap below which the mechanism is integrated [m]
constexpr double kQuiet = 1.0;       ///< time with constant coordinates before quiescence [s]
constexpr double kLongDrift = 1e5;   ///< longest time over which a rate may be left out [s]
constexpr double kSlowSpin = 1e-12;  ///< [rad/s] rounding
constexpr double kTurn = 0.005;      ///< turn of a vehicle in one step of its attitude [rad]
constexpr int kMostTurns = 10000;    ///< steps of the attitude in one free drift
constexpr std::int64_t kTurnsPerEvaluation = 8;  ///< at the same cost

/// Upper bound of the angular speed of a free body at all times [rad/s]. It follows from the energy
/// and the smallest principal inertia, which is at least 4 det/trace^2.
double find_spin_bound(const Mat3<double>& inertia, const Vec3<double>& w) {
  return std::sqrt(w.dot(inertia * w) / inertia.determinant()) * inertia.trace() / 2.0;
}

}  // namespace

QuiescentMode::QuiescentMode(const DockingModel& model, SimState& state,
                             const SolverSettings& settings, double rtol, bool is_possible,
                             bool can_drift, const StepLoads& loads, EventLogic& events,
                             Evaluator& evaluator)
    : model_(&model),
      state_(state),
      settings_(settings),
      rtol_(rtol),
      is_possible_(is_possible),
      can_drift_(can_drift),
      loads_(loads),
      events_(events),
      evaluator_(evaluator),
      y_(static_cast<size_t>(model.layout.size)),
      ydot_(y_),
      factor_(is_possible ? model.layout.mechanism_nv : 0) {
  if (!is_possible) return;
  const int n = model.layout.mechanism_nv;
  pull_.setZero(n);
  spinning_ = moving_ = pull_;
  stiffness_ = square_.setIdentity(n, n);
  evaluator.reserve_jacobian();
}

void QuiescentMode::start(const double* y) {
  const StateLayout& layout = model_->layout;
  const double* q = y + layout.mechanism_q;
  state_.quiescent.q.assign(q, q + layout.mechanism_nq);
  if (is_always_locked_) return;
  locked_.q = evaluator_.present().mechanism.tree.q;  // memory for later
  locked_.contact_bodies.resize(evaluator_.present().contact_bodies.size());
}

void QuiescentMode::lock_always() {
  lock_mechanism(*model_, evaluator_.present(), locked_);
  evaluator_.hold_always(&locked_);
  is_always_locked_ = true;
}

void QuiescentMode::use_vehicle_bodies() {
  if (is_always_locked_ && model_->moves[kChaser])
    locked_.whole = join(model_->vehicle[kChaser], locked_.mechanism);
}

void QuiescentMode::restore(const double* y) {
  if (is_on() || is_joined()) lock(y);
  join_target(*model_, state_.discrete.hard_dock.joint, locked_);
  evaluator_.hold_always(is_always_locked_ || is_joined() ? &locked_ : nullptr);
}

const LockedMechanism* QuiescentMode::find_held(bool may_lock) const {
  return is_always_locked_ || is_joined() || (may_lock && is_in_effect()) ? &locked_ : nullptr;
}

/// Are vehicles and mechanism free of loads now?
bool QuiescentMode::is_free() const {
  return (is_joined() ? can_drift_ : is_possible_) && !state_.discrete.thrust_on &&
         !events_.find_thrust_onset() && model_->disturbances.empty() && model_->inputs.empty() &&
         (is_joined() || model_->forces.empty()) && loads_.are_absent(model_->falling);
}

/// Do drives and the sequence change nothing by themselves, nor failures at their time?
bool QuiescentMode::acts_by_command_only(double now) const {
  const auto is_active = [](const LawFailure& failure) { return failure.active; };
  const auto& failures = model_->mechanism.model.failures;
  return events_.sequence().is_waiting() && !events_.sequence().are_drives_starting(now) &&
         std::none_of(failures.begin(), failures.end(), is_active);
}

/// Does nothing inside a stack release energy?
bool QuiescentMode::is_stack_at_rest(double now) const {
  const auto& latches = state_.discrete.latch;
  return !is_ramping(model_->hard_dock, state_.discrete.hard_dock, now) &&
         model_->mechanism.model.failures.empty() &&
         std::none_of(latches.begin(), latches.end(),
                      [](const LatchState& latch) { return latch.mode == LatchMode::kReleasing; });
}

Status QuiescentMode::evaluate(double tau, const double* y, bool may_lock) {
  evaluator_.forget();
  evaluator_.hold(find_held(may_lock));
  return evaluator_.at(tau, y);
}

Status QuiescentMode::update(double tau, double* y) {
  const double now = state_.elapsed + tau;
  const StateLayout& layout = model_->layout;
  QuiescentState& quiescent = state_.quiescent;
  if (is_joined()) {
    quiescent.on = is_free() && is_stack_at_rest(now);
    quiescent.since = now;
    return {};
  }
  const double* const q = y + layout.mechanism_q;
  bool kept = true;
  for (int j = 0; j < layout.mechanism_nq; ++j) {
    const double tolerance = kQuiescentPlace * settings_.atol_position + rtol_ * std::abs(q[j]);
    kept = kept && std::abs(q[j] - quiescent.q[j]) <= tolerance;
  }
  if (!kept) {
    std::copy_n(q, layout.mechanism_nq, quiescent.q.begin());
    quiescent.since = now;
  }
  const FrameMotion<double>& chaser = evaluator_.present().vehicle[kChaser];
  const Vec3<double> change = chaser.R.transpose() * chaser.w - quiescent.spin;
  const bool swung = quiescent.on && layout.mechanism_nv > 0 &&
                     change.norm() > quiescent.slack * quiescent.spin.norm() + kSlowSpin;
  // An exact gap is useful only to stay quiescent.
  const double exact_below = quiescent.on ? kAwake : -kNoGap;
  if (swung || !is_free() || !acts_by_command_only(now) ||
      events_.find_free_gap(evaluator_.present(), exact_below) <= kAwake) {
    const bool wakes = quiescent.on;
    quiescent.on = false;
    quiescent.since = now;
    return wakes ? evaluate(tau, y) : Status();
  }
  if (quiescent.on) return {};
  // At the start nothing has moved yet; later the coordinates must have been constant.
  if (now > 0.0 && now - quiescent.since < kQuiet) return {};
  if (!update_balance(tau, y)) {
    quiescent.since = now;
    return {};
  }
  std::fill_n(y + layout.mechanism_v, layout.mechanism_nv, 0.0);
  quiescent.on = true;
  state_.kept_jacobian.valid = false;
  lock(y);
  return evaluate(tau, y);
}

/// Accelerations of the mechanism at y_. @return whether they exist
bool QuiescentMode::calc_pull(double tau, VecX<double>& pull) {
  const Status status = evaluator_.aside(tau, y_.data(), ydot_.data());
  evaluator_.count(1);
  const int at = model_->layout.mechanism_v;
  for (int j = 0; j < model_->layout.mechanism_nv; ++j) pull[j] = ydot_[at + j];
  return status.ok() && pull.allFinite();
}

/// Is the mechanism at rest in static balance? Updates the change of spin that the balance allows.
/// The distance from balance follows from the stiffness: K shift = -acceleration, of least norm. So
/// does the motion that the present rates would cause: a swing of v / sqrt(K). A shift of joints
/// carries bristles of brakes along, which may be all that holds a joint. Without stiffness the
/// mechanism is in balance only if its acceleration is zero, and at rest only if its rates are
/// worth nothing over a long drift.
bool QuiescentMode::update_balance(double tau, const double* y) {
  const StateLayout& layout = model_->layout;
  QuiescentState& quiescent = state_.quiescent;
  const int n = layout.mechanism_nv, at = layout.mechanism_v;
  if (n == 0) return true;
  double speed = 0.0;
  for (int j = 0; j < n; ++j) {
    moving_[j] = y[at + j];
    speed = std::max(speed, std::abs(moving_[j]));
  }
  const double place = kQuiescentPlace * settings_.atol_position;
  const bool is_slow = speed * kLongDrift <= place;
  std::copy_n(y, y_.size(), y_.begin());
  std::fill_n(y_.begin() + at, n, 0.0);
  quiescent.spin.setZero();
  quiescent.slack = 1.0;
  if (model_->moves[kChaser]) {
    // Effect of spin: acceleration with spin minus acceleration without spin.
    const int momentum = layout.momentum[kChaser];
    if (!calc_pull(tau, spinning_)) return false;
    const FrameMotion<double>& chaser = evaluator_.trial().vehicle[kChaser];
    quiescent.spin = chaser.R.transpose() * chaser.w;
    std::fill_n(y_.begin() + momentum, 6, 0.0);
    if (!calc_pull(tau, pull_)) return false;
    spinning_ -= pull_;
    std::copy_n(y + momentum, 6, y_.begin() + momentum);
  }
  if (!calc_pull(tau, pull_)) return false;
  if (pull_.isZero(0.0) && is_slow) return true;
  if (!evaluator_.calc_jacobian(tau, y_.data()).ok()) return false;
  evaluator_.count(layout.sums);
  const auto& J = evaluator_.jacobian();
  const int q = layout.mechanism_q, nq = layout.mechanism_nq;
  const int z = layout.element_bristles, nz = layout.element_bristle_count;
  stiffness_ = J.block(at, q, n, nq).lazyProduct(J.block(q, at, nq, n));
  stiffness_ += J.block(at, z, n, nz).lazyProduct(J.block(z, at, nz, n));
  square_ = stiffness_.lazyProduct(stiffness_.transpose());
  factor_.compute(square_);
  if (factor_.info() != Eigen::Success) return false;
  const auto find_shift = [&](VecX<double>& x) {
    factor_.solveInPlace(x);
    double largest = 0.0;
    for (int j = 0; j < n; ++j) {
      largest = std::max(largest, std::abs(stiffness_.col(j).dot(x)));
    }
    return largest;
  };
  if (!(find_shift(pull_) <= place)) return false;
  if (!is_slow && !(speed * find_shift(moving_) <= place * place)) return false;
  // The load of spin is quadratic in it.
  quiescent.slack = 0.5 * place / std::max(find_shift(spinning_), 0.5 * place);
  return true;
}

/// Data of a quiescent mechanism for evaluations. They depend on the mechanism's coordinates alone,
/// not on the motion of the vehicle, so a restored run has the same bits.
void QuiescentMode::lock(const double* y) {
  if (is_always_locked_) return;
  std::copy_n(y, y_.size(), y_.begin());
  if (model_->moves[kChaser]) {
    set_vehicle_pose(*model_, kChaser, Vec3<double>::Zero(), {1, 0, 0, 0}, y_.data());
  }
  DockingData<double>& data = evaluator_.present();
  calc_mechanism_position(*model_, y_.data(), data);  // this pose was evaluated before
  data.vehicle[kChaser] = get_vehicle_pose(*model_, kChaser, y_.data());
  lock_mechanism(*model_, data, locked_);
}

/// The vehicle with all carried bodies, as one body: axes of the vehicle.
const VehicleBody& QuiescentMode::find_drifting_body(int i) const {
  return i == kTarget ? model_->vehicle[kTarget] : locked_.whole;
}

double QuiescentMode::find_drift_time() const {
  const DockingModel& model = *model_;
  DockingData<double>& data = evaluator_.present();
  double longest = kNever, speed = 0.0;
  if (is_joined()) {
    const FrameMotion<double>& chaser = data.vehicle[kChaser];
    const double spin = find_spin_bound(locked_.joined.inertia, chaser.R.transpose() * chaser.w);
    return spin > 0.0 ? std::min(longest, kMostTurns * kTurn / spin) : longest;
  }
  const double radius = find_bounding_radius(model.contact, data.relative);
  std::array<Vec3<double>, 2> v{Vec3<double>::Zero(), Vec3<double>::Zero()};
  for (int i : {kChaser, kTarget}) {
    if (!model.present[i] || !model.moves[i]) continue;
    const VehicleBody& body = find_drifting_body(i);
    const FrameMotion<double>& frame = data.vehicle[i];
    const Vec3<double> arm = frame.R * body.com;
    const double spin = find_spin_bound(body.inertia, frame.R.transpose() * frame.w);
    v[i] = frame.v + frame.w.cross(arm);
    if (spin > 0.0) longest = std::min(longest, kMostTurns * kTurn / spin);
    if (i == kChaser && spin > 0.0 && model.layout.mechanism_nv > 0) {
      // Two principal inertias differ at most by the third one: |w'| <= w^2.
      longest = std::min(longest, 0.5 * state_.quiescent.slack / spin);
    }
    const Vec3<double>& port = i == kChaser ? data.capture.p : data.interface[kTarget].p;
    speed += spin * ((port - frame.p - arm).norm() + radius);
    // Latches and the absorber measure along axes of G, which turn with the chaser.
    if (i == kChaser) speed += spin * data.relative.p.norm();
  }
  if (!model.present[kTarget]) return longest;
  speed += (v[kTarget] - v[kChaser]).norm();
  const double distance = events_.find_free_gap(data, kAwake) - 0.5 * kAwake;
  return distance < longest * speed ? distance / speed : longest;
}

/// Ballistic propagation of one vehicle as this body. @return steps of its attitude
std::int64_t QuiescentMode::drift_body(int i, const VehicleBody& body, const Vec3<double>& momentum,
                                       double duration, FrameMotion<double>& frame,
                                       double* y) const {
  double* const pose = y + model_->layout.pose[i];
  Vec4<double> q = Vec4<double>(pose[3], pose[4], pose[5], pose[6]).normalized();
  Vec3<double> w = frame.R.transpose() * frame.w;
  const Vec3<double> center = frame.p + frame.R * body.com + duration / body.mass * momentum;
  const int turns = static_cast<int>(std::ceil(w.norm() * duration / kTurn));
  turn_rigid_body(body.inertia, Vec3<double>::Zero(), duration, std::max(1, turns), q, w);
  set_vehicle_pose(*model_, i, center - quat_to_matrix<double>(q) * body.com, q, y);
  frame = get_vehicle_pose(*model_, i, y);
  frame.w = frame.R * w;
  frame.v = momentum / body.mass - frame.w.cross(Vec3<double>(frame.R * body.com));
  return turns;
}

std::int64_t QuiescentMode::drift(double duration, double* y) const {
  std::int64_t made = 0;
  const auto get_momentum = [&](int i) {
    const double* const x = y + model_->layout.momentum[i];
    return Vec3<double>(x[0], x[1], x[2]);
  };
  if (is_joined()) {
    FrameMotion<double> chaser = evaluator_.present().vehicle[kChaser];
    made = drift_body(kChaser, locked_.joined, get_momentum(kChaser) + get_momentum(kTarget),
                      duration, chaser, y);
    put_joined_target(*model_, locked_, chaser, y);
    return 1 + made / kTurnsPerEvaluation;
  }
  for (int i : {kChaser, kTarget}) {
    if (!model_->present[i] || !model_->moves[i]) continue;
    FrameMotion<double> frame = evaluator_.present().vehicle[i];
    made += drift_body(i, find_drifting_body(i), get_momentum(i), duration, frame, y);
  }
  return 1 + made / kTurnsPerEvaluation;
}

}  // namespace dockloop
