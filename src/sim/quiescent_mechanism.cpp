// Quiescent mechanism and free drift far from contact: bodies without loads are not integrated.
//
// A mechanism with constant coordinates becomes quiescent after a while. Vehicle and mechanism then
// drift freely as one rigid body. Its centre of mass moves on a straight line, and its attitude
// follows Euler's equations. Momentum states and mechanism coordinates keep their bits. Any load,
// thrust or command ends the quiescent state. So does a gap of a centimetre, and a change of spin
// that would move the mechanism. The error of the coordinates is then about ten absolute
// tolerances.
#include <algorithm>
#include <cmath>

#include "math/rigid_body.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kAwake = 0.01;      ///< gap below which the mechanism is integrated [m]
constexpr double kQuiet = 1.0;       ///< time with constant coordinates before quiescence [s]
constexpr double kPlace = 10.0;      ///< change of constant coordinates, in absolute tolerances
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

/// Can the mechanism become quiescent in this run? Reference solutions always integrate it.
bool DockingSim::Impl::can_be_quiescent() const {
  return setup->parameters.flight == kQuiescent && fmi_kind == FmiKind::kCoSimulation &&
         !is_fixed_step() && !has_host() && !adapt_problem && !model->mechanism.plan.is_driven;
}

/// Are vehicles and mechanism free of loads now?
bool DockingSim::Impl::may_be_quiescent() const {
  if (!can_be_quiescent() || sloped || discrete.thrust_on || events->find_thrust_onset())
    return false;
  if (!loads.command.isZero(0.0)) return false;
  if (!model->falling && !loads.gravity.isZero(0.0)) return false;
  return loads.force[kChaser].isZero(0.0) && loads.force[kTarget].isZero(0.0) &&
         loads.torque[kChaser].isZero(0.0) && loads.torque[kTarget].isZero(0.0);
}

/// Begin or end the quiescent state. @pre evaluate(tau) at an accepted state
Status DockingSim::Impl::update_quiescence(double tau) {
  const double now = elapsed + tau;
  const StateLayout& layout = model->layout;
  const double* const q = stepper->y() + layout.mechanism_q;
  double* const v = stepper->y() + layout.mechanism_v;
  const double rtol = find_relative_tolerance();
  bool kept = true;
  for (int j = 0; j < layout.mechanism_nq; ++j) {
    const double tolerance = kPlace * parameters.atol_position + rtol * std::abs(q[j]);
    kept = kept && std::abs(q[j] - quiescent.q[j]) <= tolerance;
  }
  if (!kept) {
    std::copy_n(q, layout.mechanism_nq, quiescent.q.begin());
    quiescent.since = now;
  }
  const FrameMotion<double>& chaser = data->vehicle[kChaser];
  const Vec3<double> change = chaser.R.transpose() * chaser.w - quiescent.spin;
  const bool swung = quiescent.on && layout.mechanism_nv > 0 &&
                     change.norm() > quiescent.slack * quiescent.spin.norm() + kSlowSpin;
  // An exact gap is useful only to stay quiescent.
  const double exact_below = quiescent.on ? kAwake : -kNoGap;
  if (swung || !may_be_quiescent() || events->find_free_gap(*data, exact_below) <= kAwake) {
    const bool wakes = quiescent.on;
    quiescent.on = false;
    quiescent.since = now;
    return wakes ? evaluate(tau) : Status();
  }
  if (quiescent.on) return {};
  // At the start zero velocity is sufficient; later the coordinates must have been constant.
  double speed = 0.0;
  for (int j = 0; j < layout.mechanism_nv; ++j) speed = std::max(speed, std::abs(v[j]));
  const bool starts = now == 0.0 && speed <= parameters.atol_velocity;
  if (!starts && now - quiescent.since < kQuiet) return {};
  if (!update_balance(tau)) {
    quiescent.since = now;
    return {};
  }
  std::fill_n(v, layout.mechanism_nv, 0.0);
  quiescent.on = true;
  kept_jacobian.valid = false;
  lock_quiescent();
  return evaluate(tau);
}

/// Is the mechanism in static balance? Updates the change of spin that the balance allows. The
/// distance from balance follows from the stiffness: J shift = -acceleration, of least norm.
/// Without stiffness the mechanism is in balance only if its acceleration is zero.
bool DockingSim::Impl::update_balance(double tau) {
  const StateLayout& layout = model->layout;
  const int n = layout.mechanism_nv, at = layout.mechanism_v;
  if (n == 0) return true;
  double *y = rates.data(), *ydot = balance->ydot.data();
  const auto find_pull = [&](VecX<double>& pull) {
    const Status status =
        calc_docking<double>(*model, discrete, memory, loads, elapsed + tau, y, ydot, *rate_data);
    ++counted_elsewhere.rate_evaluations;
    for (int j = 0; j < n; ++j) pull[j] = ydot[at + j];
    return status.ok() && pull.allFinite();
  };
  std::copy(stepper->y(), stepper->y() + layout.size, y);
  std::fill_n(y + at, n, 0.0);
  VecX<double>&pull = balance->pull, &spinning = balance->spinning;
  quiescent.spin.setZero();
  quiescent.slack = 1.0;
  if (model->moves[kChaser]) {
    // Effect of spin: acceleration with spin minus acceleration without spin.
    if (!find_pull(spinning)) return false;
    quiescent.spin = rate_data->vehicle[kChaser].R.transpose() * rate_data->vehicle[kChaser].w;
    std::fill_n(y + layout.momentum[kChaser], 6, 0.0);
    if (!find_pull(pull)) return false;
    spinning -= pull;
    pull += spinning;
    std::copy_n(stepper->y() + layout.momentum[kChaser], 6, y + layout.momentum[kChaser]);
  }
  if (!find_pull(pull)) return false;
  if (pull.isZero(0.0)) return true;
  if (!calc_docking_jacobian(*model, discrete, memory, *rate_data, loads, elapsed + tau, y,
                             *jacobian_pass, jacobian)
           .ok()) {
    return false;
  }
  counted_elsewhere.rate_evaluations += layout.sums;
  const auto J = jacobian.block(at, layout.mechanism_q, n, layout.mechanism_nq);
  balance->square = J.lazyProduct(J.transpose());
  balance->factor.compute(balance->square);
  if (balance->factor.info() != Eigen::Success) return false;
  const auto find_shift = [&](VecX<double>& x) {
    balance->factor.solveInPlace(x);
    double largest = 0.0;
    for (int j = 0; j < layout.mechanism_nq; ++j) {
      largest = std::max(largest, std::abs(J.col(j).dot(x)));
    }
    return largest;
  };
  const double place = kPlace * parameters.atol_position;
  if (!(find_shift(pull) <= place)) return false;
  // The load of spin is quadratic in it.
  quiescent.slack = 0.5 * place / std::max(find_shift(spinning), 0.5 * place);
  return true;
}

/// Data of a quiescent mechanism for evaluations. They depend on the mechanism's coordinates alone,
/// not on the motion of the vehicle, so a restored run has the same bits.
void DockingSim::Impl::lock_quiescent() {
  if (parameters.model_level == kRigid) return;
  std::copy(stepper->y(), stepper->y() + model->layout.size, rates.begin());
  if (model->moves[kChaser]) {
    set_vehicle_pose(*model, kChaser, Vec3<double>::Zero(), {1, 0, 0, 0}, rates.data());
  }
  calc_mechanism_position(*model, rates.data(), *data);  // this pose was evaluated before
  data->vehicle[kChaser] = get_vehicle_pose(*model, kChaser, rates.data());
  data->capture = find_capture_motion(*model, data->mechanism.tree);
  lock_mechanism(*model, *data, locked);
}

/// The vehicle with all carried bodies, as one body: axes of the vehicle.
const VehicleBody& DockingSim::Impl::find_drifting_body(int i) const {
  return i == kTarget ? model->vehicle[kTarget] : locked.whole;
}

/// Time without possible contact forces and with a limited number of attitude steps [s].
/// @pre evaluate()
double DockingSim::Impl::find_drift_time() const {
  double longest = kNever, speed = 0.0;
  std::array<Vec3<double>, 2> v{Vec3<double>::Zero(), Vec3<double>::Zero()};
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || !model->moves[i]) continue;
    const VehicleBody& body = find_drifting_body(i);
    const FrameMotion<double>& frame = data->vehicle[i];
    const Vec3<double> arm = frame.R * body.com;
    const double spin = find_spin_bound(body.inertia, frame.R.transpose() * frame.w);
    v[i] = frame.v + frame.w.cross(arm);
    if (spin > 0.0) longest = std::min(longest, kMostTurns * kTurn / spin);
    if (i == kChaser && spin > 0.0 && model->layout.mechanism_nv > 0) {
      // Two principal inertias differ at most by the third one: |w'| <= w^2.
      longest = std::min(longest, 0.5 * quiescent.slack / spin);
    }
    const Vec3<double>& port = i == kChaser ? data->capture.p : data->interface[kTarget].p;
    speed += spin * ((port - frame.p - arm).norm() + model->contact.reach);
    // Latches and the absorber measure along axes of G, which turn with the chaser.
    if (i == kChaser) speed += spin * data->relative.p.norm();
  }
  if (!model->present[kTarget]) return longest;
  speed += (v[kTarget] - v[kChaser]).norm();
  const double distance = events->find_free_gap(*data, kAwake) - 0.5 * kAwake;
  return distance < longest * speed ? distance / speed : longest;
}

/// Ballistic propagation of both vehicles. @pre evaluate() @post y is ahead of the last evaluation
/// @return cost in evaluations: one at its end, and the steps of the attitudes
std::int64_t DockingSim::Impl::drift_freely(double duration) {
  std::int64_t made = 0;
  for (int i : {kChaser, kTarget}) {
    if (!model->present[i] || !model->moves[i]) continue;
    const VehicleBody& body = find_drifting_body(i);
    double* const pose = stepper->y() + model->layout.pose[i];
    const double* const momentum = stepper->y() + model->layout.momentum[i];
    const FrameMotion<double>& frame = data->vehicle[i];
    Vec4<double> q = Vec4<double>(pose[3], pose[4], pose[5], pose[6]).normalized();
    Vec3<double> w = frame.R.transpose() * frame.w;
    const Vec3<double> center =
        frame.p + frame.R * body.com +
        duration / body.mass * Vec3<double>(momentum[0], momentum[1], momentum[2]);
    const int turns = static_cast<int>(std::ceil(w.norm() * duration / kTurn));
    turn_rigid_body(body.inertia, Vec3<double>::Zero(), duration, std::max(1, turns), q, w);
    made += turns;
    set_vehicle_pose(*model, i, center - quat_to_matrix<double>(q) * body.com, q, stepper->y());
  }
  return 1 + made / kTurnsPerEvaluation;
}

}  // namespace dockloop
