// The rules of host_diagnosis.hpp, and the alternatives that are tried where a rule is broken.
#include "sim/host_diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "math/decompositions.hpp"
#include "math/rotation.hpp"

namespace dockloop {
namespace {

constexpr double kDegrees = 0.017453292519943295;  ///< [rad]

// First report
constexpr double kFirstDistance = 1e-3;  ///< from the start position [m]
constexpr double kFirstSpeed = 1e-3;     ///< from the start velocity [m/s]
constexpr double kSameShare = 0.05;      ///< of a vector, for an alternative that fits

// Motion: an error of the rate above all of these. Half of the change covers integrators of hosts.
constexpr double kTurnError = 1e-5;        ///< [rad/s]
constexpr double kTurnDoubt = 1e-7;        ///< [rad/s], for an angular velocity in another unit
constexpr double kMoveError = 1e-5;        ///< [m/s]
constexpr double kRateShare = 1e-3;        ///< of the rate
constexpr double kChangeShare = 0.5;       ///< of its change over the step
constexpr double kReportRounding = 1e-15;  ///< of positions and attitudes
constexpr int kFewErrors = 3;              ///< consecutive, for an alternative that fits
constexpr int kManyErrors = 6;             ///< consecutive, without such an alternative
constexpr double kHeldShare = 1e-12;       ///< of 1 m and the distance: motion that shows
constexpr double kUnchangedTime = 1.0;     ///< of a first report, beyond the stated delay [s] ...
constexpr double kStoppedTime = 10.0;      ///< ... and of a later one: hosts may have long steps
constexpr double kExplained = 0.04;        ///< of the squares of errors, by an alternative
constexpr double kUnitShare = 0.5;         ///< from 1: a smaller factor is no unit
constexpr double kNothing = 1e-6;          ///< of squares: no motion at all
constexpr double kPointRank = 1e-6;        ///< of squares of turns: a part of a point that shows

// Loads
constexpr int kEnoughSteps = 10;            ///< with loads
constexpr double kDelayTime = 0.3;          ///< with loads: until then they may be late [s]
constexpr int kUnexplainedSteps = 50;       ///< with loads, without an alternative that fits
constexpr double kUnexplainedTime = 1.5;    ///< the same, of long steps [s]
constexpr int kUnmodelledSteps = 5;         ///< consecutive
constexpr double kUnmodelledTime = 0.0499;  ///< of these steps, with rounding [s]
constexpr double kLeastError = 1e-5;        ///< of predicted changes, for loads in another step
constexpr double kLateExplained = 0.01;     ///< of the squares that another mass does not explain
constexpr double kLoadError = 0.01;         ///< of predicted changes, for all other causes
constexpr double kFlexible = 0.02;          ///< of predicted changes, without a cause
constexpr double kConstant = 1e-3;      ///< of the squares, by a constant: slow swings leave more
constexpr double kLeastPeriods = 0.25;  ///< with loads: a shorter swing has no frequency
constexpr double kLeastFelt = 0.1;      ///< of a predicted change; less counts as no change
constexpr double kUnitFelt = 0.05;      ///< around 1000 or 1/1000, relative
constexpr double kMostFelt = 10.0;      ///< of a predicted change; more has another cause
constexpr double kMassConfirmed = 0.1;  ///< mismatch below which no step is too long [-]
constexpr double kAbsurd = 1e3;         ///< inertia over that of a body of this mass and size
constexpr double kUnmodelled = 1e-4;    ///< acceleration that counts [m/s2], and part of gravity
constexpr double kSilent = 1e-7;        ///< acceleration that counts as no load [m/s2], [rad/s2]

/// A quaternion in the order x, y, z, w.
Vec4<double> reorder(const Vec4<double>& q) { return {q[3], q[0], q[1], q[2]}; }

/// How a host may mean attitude and angular velocity.
struct AttitudeReading {
  int fault;
  bool is_reordered, is_inverse;
  double spin_factor;
  bool is_spin_in_N;
};
constexpr AttitudeReading kAttitudeReadings[] = {
    {kHostRight, false, false, 1.0, false},
    {kQuaternionOrder, true, false, 1.0, false},
    {kQuaternionInverse, false, true, 1.0, false},
    {kQuaternionOrderInverse, true, true, 1.0, false},
    {kSpinInDegrees, false, false, kDegrees, false},
    {kSpinInN, false, false, 1.0, true},
    {kSpinSign, false, false, -1.0, false},
};
static_assert(std::size(kAttitudeReadings) == std::tuple_size_v<decltype(ReportSums::turn_error2)>);

Vec4<double> read_attitude(const AttitudeReading& as, const Inputs::Vehicle& report) {
  Vec4<double> q = report.attitude.normalized();
  if (as.is_reordered) q = reorder(q);
  return as.is_inverse ? quat_conjugate<double>(q) : q;
}

Vec3<double> read_spin(const AttitudeReading& as, const Inputs::Vehicle& report) {
  Vec3<double> w = as.spin_factor * report.angular_velocity;
  if (as.is_spin_in_N) w = quat_to_matrix<double>(report.attitude).transpose() * w;
  return w;
}

constexpr int kVelocityReadings[] = {kHostRight, kVelocityInBody, kVelocityTurned, kInterfacePoint};
static_assert(std::size(kVelocityReadings) == std::tuple_size_v<decltype(ReportSums::move_error2)>);

Vec3<double> read_velocity(int reading, const Inputs::Vehicle& report) {
  const Mat3<double> R = quat_to_matrix<double>(report.attitude);
  if (reading == kVelocityInBody) return R * report.velocity;
  if (reading == kVelocityTurned) return R.transpose() * report.velocity;
  return report.velocity;
}

bool is_close(const Vec3<double>& a, const Vec3<double>& b) {
  return (a - b).norm() < kSameShare * b.norm();
}

/// f(axes) for all axes that are exchanged, reversed or both; all three reversed are another sign.
template <class F>
void for_each_other_axes(const F& f) {
  int order[] = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Mat3<double> axes = Mat3<double>::Zero();
      for (int k = 0; k < 3; ++k) axes(k, order[k]) = (signs >> k) & 1 ? -1.0 : 1.0;
      if (std::abs(axes.trace()) < 3.0) f(axes);
    }
  } while (std::next_permutation(std::begin(order), std::end(order)));
}

bool is_in_other_axes(const Vec3<double>& reported, const Vec3<double>& right) {
  const double most = kSameShare * (reported - right).norm();
  bool found = false;
  for_each_other_axes(
      [&](const Mat3<double>& axes) { found = found || (axes * reported - right).norm() < most; });
  return found;
}

/// The reading with the least error, if this error is a small part of the error as reported and of
/// the motion. @param motion2  squares of rates of what moves
template <size_t count>
size_t find_reading(const std::array<double, count>& error2, double motion2) {
  const auto least = std::min_element(error2.begin(), error2.end());
  const double most = kExplained * std::min(error2[0], motion2);
  return *least < most ? static_cast<size_t>(least - error2.begin()) : 0;
}

/// Squares of errors of the attitude that are left if the angular velocity has other axes.
double find_left_by_axes(const ReportSums& sums) {
  double least = sums.turn_error2[0];
  for_each_other_axes([&](const Mat3<double>& axes) {
    const double left = sums.turn2 - 2.0 * axes.cwiseProduct(sums.turn_product).sum() +
                        (axes * sums.spin_matrix).cwiseProduct(axes).sum();
    least = std::min(least, left);
  });
  return least;
}

/// Squares of errors that another mass (inertia) does not explain.
double find_left_by_scale(const ResponseSums& r) {
  if (!(r.change2 > 0.0)) return r.error2;
  return r.error2 - r.product * r.product / r.change2;
}

/// Share of the predicted change that the vehicle shows.
double find_felt(const ResponseSums& r) {
  return r.change2 > 0.0 ? 1.0 + r.product / r.change2 : 1.0;
}

/// Adds a step to the sums.
/// @param effects  change of the response if the load acts in another way
/// @param late_effect  the same for the load of another step (places of ResponseSums::late)
template <size_t count, class Late>
void add_response(ResponseSums& r, const Vec3<double>& change, const Vec3<double>& error, double h,
                  double keep, bool is_loaded, const std::array<Vec3<double>, count>& effects,
                  const Late& late_effect) {
  static_assert(count <= std::tuple_size_v<decltype(r.left2)>);
  for (double* sum : {&r.change2, &r.product, &r.error2, &r.time2}) *sum *= keep;
  for (Mat3<double>* sum : {&r.axis_change2, &r.axis_product}) *sum *= keep;
  r.constant *= keep;
  for (double& sum : r.left2) sum *= keep;
  for (LateSums& sums : r.late) {
    sums.left2 *= keep;
    sums.product *= keep;
  }
  if (!is_loaded) return;
  ++r.loaded;
  r.change2 += change.squaredNorm();
  r.product += error.dot(change);
  r.error2 += error.squaredNorm();
  r.axis_change2 += change * change.transpose();
  r.axis_product += error * change.transpose();
  r.constant += h * error;
  r.time2 += h * h;
  for (size_t i = 0; i < count; ++i) r.left2[i] += (error - effects[i]).squaredNorm();
  Vec3<double> nearer = error;
  for (size_t i = 0; i < r.late.size(); ++i) {
    if (i == kLateLoads) nearer = error;
    const Vec3<double> left = error - late_effect(i);
    r.late[i].left2 += left.squaredNorm();
    r.late[i].product += left.dot(nearer);
    nearer = left;
  }
}

/// The alternative that leaves the least of the squares of errors.
class Search {
 public:
  explicit Search(const ResponseSums& r) : sums_(r), least_(kExplained * r.error2) {}
  void consider(double left, int fault, double value = 0.0) {
    if (!(left < least_)) return;
    least_ = left;
    found_ = {fault, value};
  }
  void consider_constant(int fault) {
    if (!(sums_.time2 > 0.0)) return;
    const Vec3<double> mean = sums_.constant / sums_.time2;
    const double left = sums_.error2 - mean.dot(sums_.constant);
    if (left < kConstant * sums_.error2) consider(left, fault, mean.norm());
  }
  /// The load acts with its axes exchanged or reversed. @param inertia  loads are mass or inertia
  /// times changes
  void consider_axes(int fault, const Mat3<double>& inertia) {
    const double equal = kNothing * sums_.error2;  // as good as another cause that fits
    if (!(equal < least_)) return;
    const Mat3<double> inverse = invert(inertia);
    for_each_other_axes([&](const Mat3<double>& axes) {
      const Mat3<double> more = inverse * (axes - Mat3<double>::Identity()) * inertia;
      const double left = sums_.error2 - 2.0 * more.cwiseProduct(sums_.axis_product).sum() +
                          (more * sums_.axis_change2).cwiseProduct(more).sum();
      consider(std::max(left, equal), fault);
    });
  }
  const HostFinding& found() const { return found_; }

 private:
  const ResponseSums& sums_;
  double least_;
  HostFinding found_;
};

/// Are loads that do not act late ones perhaps?
bool may_be_late(const ResponseSums& r, double h) {
  return r.loaded < kEnoughSteps + kLateLoads && r.loaded * h < kDelayTime &&
         find_left_by_scale(r) < kExplained * r.error2;
}

bool is_near_unit(double felt) {
  return std::abs(felt / 1e3 - 1.0) < kUnitFelt || std::abs(felt * 1e3 - 1.0) < kUnitFelt;
}

double find_error_size(const ResponseSums& r) {
  return r.loaded >= kEnoughSteps && r.change2 > 0.0 ? std::sqrt(r.error2 / r.change2) : 0.0;
}

/// A mass a thousand times too large, or a force in another unit? The mass that gives the more
/// natural radius of gyration is right.
bool is_mass_plausible(const LoadStep& step, double mass) {
  const double inertia = step.inertia.trace() / 3.0, size = std::max(step.arm.norm(), 0.1);
  const auto distance = [&](double m) { return std::abs(std::log(inertia / (m * size * size))); };
  return distance(mass) < distance(step.mass);
}

HostFinding explain_force(const LoadStep& step, const ResponseSums& r) {
  Search search(r);
  const double felt = find_felt(r), left = find_left_by_scale(r);
  if (is_near_unit(felt) && !is_mass_plausible(step, step.mass / felt)) {
    search.consider(left, kForceUnit, felt);
  } else if (felt < -kLeastFelt) {
    search.consider(left, kForceSign, felt);
  } else if (felt < kLeastFelt && !is_near_unit(felt)) {
    if (may_be_late(r, step.h)) return {};
    search.consider(left, kForceMissing, felt);
  } else {
    search.consider(left, kWrongMass, 1.0 / felt - 1.0);
  }
  search.consider(r.left2[0], kForceInBody);
  search.consider(r.left2[1], kForceTurned);
  search.consider_axes(kForceAxes, Mat3<double>::Identity());
  search.consider_constant(kUnreportedForce);
  return search.found();
}

HostFinding explain_torque(const LoadStep& step, const ResponseSums& r) {
  Search search(r);
  const double felt = find_felt(r), left = find_left_by_scale(r);
  if (is_near_unit(felt)) {
    search.consider(left, kTorqueUnit, felt);
  } else if (felt < -kLeastFelt) {
    search.consider(left, kTorqueSign, felt);
  } else if (felt < kLeastFelt) {
    if (may_be_late(r, step.h)) return {};
    search.consider(left, kTorqueMissing, felt);
  } else {
    double by_axis = r.error2, worst = 0.0, least = felt;
    for (int k = 0; k < 3; ++k) {
      const double change2 = r.axis_change2(k, k), product = r.axis_product(k, k);
      if (!(change2 > 0.0)) continue;
      by_axis -= product * product / change2;
      const double value = change2 / (change2 + product) - 1.0;
      if (!(change2 > kExplained * r.change2)) continue;
      least = std::min(least, 1.0 + product / change2);
      if (std::abs(value) > std::abs(worst)) worst = value;
    }
    const bool is_missing = least < kLeastFelt;  // about an axis
    search.consider(by_axis, is_missing ? kTorqueMissing : kWrongInertia,
                    is_missing ? felt : worst);
  }
  search.consider(r.left2[0], kTorqueInN);
  search.consider(r.left2[1], kTorqueTurned);
  search.consider(r.left2[2], kTorquePoint);
  search.consider_axes(kTorqueAxes, step.inertia);
  search.consider_constant(kUnreportedTorque);
  return search.found();
}

/// Loads of other steps, which act instead of those of the present one. Steps by which they act
/// late; negative for early loads.
struct LateLoads {
  int nearer = 0, farther = 0;  ///< the same for a whole number of steps
  double share = 1.0;           ///< of the step that the farther load acts
};

/// The loads of another step explain the responses, or those of two adjacent steps: the delay is no
/// whole number of steps then.
std::optional<LateLoads> find_late_loads(const ResponseSums& r) {
  if (r.loaded < kEnoughSteps || !(r.error2 > kLeastError * kLeastError * r.change2)) return {};
  const double left = find_left_by_scale(r);
  // Before a delay is over, a late load is a missing one.
  if (left < kExplained * r.error2) return {};
  double least = kLateExplained * left;
  std::optional<LateLoads> found;
  const auto find_steps = [](int i) { return i < kLateLoads ? i + 1 : kLateLoads - 1 - i; };
  const int count = static_cast<int>(r.late.size());
  for (int i = 0; i < count; ++i) {
    const double of_one = r.late[static_cast<size_t>(i)].left2;
    if (!(of_one < least)) continue;
    least = of_one;
    found = LateLoads{find_steps(i), find_steps(i)};
  }
  if (found) return found;
  for (int i = 0; i < count; ++i) {
    const bool is_first = i % kLateLoads == 0;
    const LateSums& sums = r.late[static_cast<size_t>(i)];
    const double nearer2 = is_first ? r.error2 : r.late[static_cast<size_t>(i - 1)].left2;
    const double apart2 = nearer2 - 2.0 * sums.product + sums.left2;
    const double share = (nearer2 - sums.product) / apart2;
    const double of_both = (nearer2 * sums.left2 - sums.product * sums.product) / apart2;
    if (!(apart2 > 0.0 && share > 0.0 && share < 1.0 && of_both < least)) continue;
    least = of_both;
    found = LateLoads{is_first ? 0 : find_steps(i - 1), find_steps(i), share};
  }
  return found;
}

HostFinding explain_late(const LoadStep& step, const LateLoads& loads) {
  const auto find_delay = [&](int steps) {
    return steps == 0 ? step.delay : (steps < 0 ? step.shorter : step.longer) + steps * step.h;
  };
  const double nearer = find_delay(loads.nearer);
  const double delay = nearer + loads.share * (find_delay(loads.farther) - nearer);
  if (step.delay > 0.0 && delay > -0.5 * step.h) return {kLoadsDelayed, std::max(delay, 0.0)};
  if (delay < 0.0) return {kLoadsEarly, step.h};
  const bool may_be_order = !step.announces || step.is_host_first;
  const bool is_one_step = loads.nearer == 1 && loads.farther == 1;
  return {is_one_step && may_be_order ? kLoadsStepLate : kLoadsDelayed, delay};
}

}  // namespace

std::string describe_energy_cause(const HostFinding& found, const ReportSums& sums,
                                  const char* vehicle) {
  const std::string name = vehicle;
  const ResponseSums& r = sums.force;
  int fault = found.fault;
  if (fault == kHostRight && sums.unmodelled > 0) fault = kUnreportedForce;
  if (fault == kHostRight && r.loaded > 0 && r.error2 > kFlexible * kFlexible * r.change2) {
    const bool is_mass = find_left_by_scale(r) < kExplained * r.error2 && find_felt(r) > kLeastFelt;
    fault = is_mass ? kWrongMass : kUnexplained;
  }
  switch (fault) {
    case kHostRight:
      return "the step";
    case kUnexplained:
    case kFlexiblePart:
    case kUnreportedForce:
      return "a flexible part of " + name +
             " between its docking interface and its mass, or a load "
             "that is not in " +
             name + ".force_ext: the FMU takes the vehicle for rigid";
    case kWrongMass:
      return name + ".mass, which is not the mass that moves";
    case kWrongInertia:
      return name + ".inertia, which is not the inertia that turns";
    default: {
      const auto row = std::find_if(kHostFaults.begin(), kHostFaults.end(),
                                    [&](const Choice& c) { return c.number == fault; });
      return "the mistake that coupling.diagnosis names (" + std::string(row->name) + ")";
    }
  }
}

ReportSums make_report_sums(bool is_delayed) {
  ReportSums sums;
  const size_t places = kLateLoads + (is_delayed ? kLateLoads : 1);
  sums.force.late.assign(places, LateSums());
  sums.torque.late.assign(places, LateSums());
  sums.held.assign(kLateLoads, Wrench<double>());
  return sums;
}

void forget_responses(ReportSums& sums) {
  for (ResponseSums* each : {&sums.force, &sums.torque}) {
    std::vector<LateSums> late = std::move(each->late);
    std::fill(late.begin(), late.end(), LateSums());
    *each = ResponseSums();
    each->late = std::move(late);
  }
  sums.first_load = 0.0;
  sums.mode = ModeSums();
}

HostFinding judge_first_report(const Inputs::Vehicle& report, const Inputs::Vehicle& start,
                               const Vec3<double>& interface_position, double h, ReportSums& sums) {
  const Vec3<double> away = report.position - start.position, step = h * start.velocity;
  if (step.norm() > 1e-9 && (away - step).norm() < 0.1 * step.norm()) {
    return {kEndOfStep, away.norm()};
  }
  const Vec4<double> attitude = report.attitude.normalized();
  sums.first_angle = find_turn<double>(start.attitude, attitude).norm();
  HostFinding turned;
  double least = kSameShare * sums.first_angle;
  for (const AttitudeReading& as : kAttitudeReadings) {
    if (!(sums.first_angle > kFirstAngle)) {
      const Vec3<double> spin = report.angular_velocity - start.angular_velocity;
      if (!(spin.norm() < 0.5 * start.angular_velocity.norm()) &&
          is_close(read_spin(as, report), start.angular_velocity)) {
        return {as.fault, 0.0};
      }
    } else if (const double angle =
                   find_turn<double>(start.attitude, read_attitude(as, report)).norm();
               angle < least) {
      least = angle;
      turned.fault = as.fault;
    }
  }
  if (turned.fault != kHostRight) return turned;
  for (int reading : {kVelocityInBody, kVelocityTurned}) {
    if (!is_close(report.velocity, start.velocity) &&
        is_close(read_velocity(reading, report), start.velocity)) {
      return {reading, 0.0};
    }
  }
  const auto find_unit = [](const Vec3<double>& reported, const Vec3<double>& right) {
    for (double unit : {1e-3, 1e-2, 0.3048, 1e3}) {  // mm, cm, ft, km
      if ((unit * reported - right).norm() < 1e-3 * (reported - right).norm()) return unit;
    }
    return 0.0;
  };
  if (away.norm() < kFirstDistance) {
    const double faster = (report.velocity - start.velocity).norm();
    if (faster < kFirstSpeed) return {};
    const double unit = find_unit(report.velocity, start.velocity);
    return unit > 0.0 ? HostFinding{kVelocityUnit, unit} : HostFinding{kFirstVelocity, faster};
  }
  const double unit = find_unit(report.position, start.position);
  if (unit > 0.0) return {kPositionUnit, unit};
  const Vec3<double> arm = quat_to_matrix<double>(start.attitude) * interface_position;
  if (is_close(away, arm)) return {kInterfacePoint, arm.norm()};
  if (is_in_other_axes(report.position, start.position)) return {kPositionAxes, 0.0};
  return {kFirstPosition, away.norm()};
}

HostFinding judge_motion(const ReportPair& pair, double keep, ReportSums& sums) {
  const double h = pair.h;
  const int steps = 1 + std::exchange(sums.unchanged, 0);
  const double least = kHeldShare * (1.0 + pair.begin.position.norm());
  const bool is_held = steps > 1 && h * pair.begin.velocity.norm() > least;
  sums.held_reports = is_held ? sums.held_reports + 1 : 0;
  if (sums.held_reports >= kFewErrors) return {kMotionHeld, steps * h};
  // Attitude and angular velocity.
  double error = 0.0, allowed = 0.0;
  for (size_t i = 0; i < std::size(kAttitudeReadings); ++i) {
    const AttitudeReading& as = kAttitudeReadings[i];
    const Vec3<double> w0 = read_spin(as, pair.begin), w1 = read_spin(as, pair.end);
    const Vec3<double> mean = 0.5 * (w0 + w1);
    const Vec3<double> rate =
        find_turn<double>(read_attitude(as, pair.begin), read_attitude(as, pair.end)) / h;
    sums.turn_error2[i] = keep * sums.turn_error2[i] + (rate - mean).squaredNorm();
    if (i > 0) continue;
    sums.turn2 = keep * sums.turn2 + rate.squaredNorm();
    sums.spin_matrix = keep * sums.spin_matrix + mean * mean.transpose();
    sums.turn_product = keep * sums.turn_product + rate * mean.transpose();
    error = (rate - mean).norm();
    const double small = kReportRounding / h + kRateShare * mean.norm();
    sums.turn_doubts = error > kTurnDoubt + small ? sums.turn_doubts + 1 : 0;
    allowed = kTurnError + small + kChangeShare * (w1 - w0).norm();
  }
  sums.turn_errors = error > allowed ? sums.turn_errors + 1 : 0;
  const double spin2 = sums.spin_matrix.trace();
  const bool is_constant = sums.turn2 < kNothing * spin2;
  const bool is_missing = spin2 < kNothing * sums.turn2;
  if (sums.turn_errors >= kFewErrors && !is_constant && !is_missing) {
    const size_t reading = find_reading(sums.turn_error2, sums.turn2);
    const double most = kExplained * sums.turn_error2[reading];  // exchanged axes fit much better
    const bool is_exact = sums.turn_error2[reading] < kNothing * sums.turn_error2[0];
    if (reading > 0 && (is_exact || find_left_by_axes(sums) > most)) {
      return {kAttitudeReadings[reading].fault, 0.0};
    }
  }
  if (sums.turn_doubts >= kManyErrors && !is_constant && !is_missing) {
    const double share = sums.turn_product.trace() / spin2;
    const double left = sums.turn2 - share * sums.turn_product.trace();
    if (left < kExplained * sums.turn_error2[0]) return {kAttitudeUnrelated, error};
  }
  if (sums.turn_errors >= kManyErrors) {
    if (is_constant) return {kAttitudeConstant, error};
    if (is_missing) return {kSpinMissing, error};
    return {kAttitudeUnrelated, error};
  }
  if (sums.turn_errors > 0) return {};

  // Position and velocity.
  const Vec3<double> rate = (pair.end.position - pair.begin.position) / h;
  const Mat3<double> turned =
      (quat_to_matrix<double>(pair.end.attitude) - quat_to_matrix<double>(pair.begin.attitude)) / h;
  for (size_t i = 0; i < std::size(kVelocityReadings); ++i) {
    Vec3<double> mean = 0.5 * (read_velocity(kVelocityReadings[i], pair.begin) +
                               read_velocity(kVelocityReadings[i], pair.end));
    if (kVelocityReadings[i] == kInterfacePoint) mean += turned * pair.interface_position;
    sums.move_error2[i] = keep * sums.move_error2[i] + (rate - mean).squaredNorm();
    if (i > 0) continue;
    sums.move2 = keep * sums.move2 + rate.squaredNorm();
    sums.velocity2 = keep * sums.velocity2 + mean.squaredNorm();
    sums.move_velocity = keep * sums.move_velocity + rate.dot(mean);
    sums.point_matrix = keep * sums.point_matrix + turned.transpose() * turned;
    sums.point_side = keep * sums.point_side + turned.transpose() * (rate - mean);
    error = (rate - mean).norm();
  }
  allowed = kMoveError + kReportRounding * pair.end.position.norm() / h + kRateShare * pair.speed +
            kChangeShare * pair.change;
  sums.move_errors = error > allowed ? sums.move_errors + 1 : 0;
  if (sums.move_errors >= kFewErrors) {
    const size_t reading = find_reading(sums.move_error2, sums.move2);
    if (reading > 0) return {kVelocityReadings[reading], pair.interface_position.norm()};
    const double units = sums.velocity2 > 0.0 ? sums.move_velocity / sums.velocity2 : 0.0;
    const double left = sums.move2 - units * sums.move_velocity;
    if (std::abs(units) > 1e-5 && left < kExplained * sums.move_error2[0]) {
      if (std::abs(units - 1.0) > kUnitShare) return {kPositionUnit, 1.0 / units};
      return {kPositionUnrelated, error};
    }
    // Its part along the axis of rotation does not show: the smallest vector.
    const Mat3<double> regular =
        sums.point_matrix + kPointRank * sums.point_matrix.trace() * Mat3<double>::Identity();
    const Vec3<double> point = invert(regular) * sums.point_side;
    if (sums.move_error2[0] - point.dot(sums.point_side) < kExplained * sums.move_error2[0])
      return {kOtherPoint, point.norm()};
  }
  if (sums.move_errors >= kManyErrors) {
    if (sums.move2 < kNothing * sums.velocity2) return {kPositionConstant, error};
    if (sums.velocity2 < kNothing * sums.move2) return {kVelocityMissing, error};
    return {kPositionUnrelated, error};
  }
  // A first attitude that nothing else explains.
  if (sums.first_angle > kFirstAngle && sums.move_errors == 0) {
    return {kFirstAttitude, sums.first_angle};
  }
  return {};
}

HostFinding judge_unchanged(const ReportPair& pair, double delay, ReportSums& sums) {
  const double time = sums.velocity2 > 0.0 ? kStoppedTime : kUnchangedTime;
  const bool is_old = ++sums.unchanged >= kManyErrors && sums.unchanged * pair.h > time + delay;
  const double speed = pair.end.velocity.norm();
  return is_old && speed > kMoveError ? HostFinding{kPositionConstant, speed} : HostFinding();
}

HostFinding judge_loads(const LoadStep& step, double keep, ReportSums& sums) {
  const Mat3<double> inverse = invert(step.inertia);
  const auto accelerate = [&](const Vec3<double>& force) -> Vec3<double> {
    return step.h / step.mass * (force - step.held.f);
  };
  const auto turn = [&](const Vec3<double>& torque) -> Vec3<double> {
    return step.h * (inverse * (torque - step.held.t));
  };
  const auto find_load = [&](size_t i) -> const Wrench<double>& {
    if (i < kLateLoads) return step.delay > 0.0 ? step.earlier[i] : sums.held[i];
    return step.next[std::min(i - kLateLoads, static_cast<size_t>(step.next_count - 1))];
  };
  const Vec3<double>& f = step.held.f;
  const Vec3<double>& t = step.held.t;
  const Vec3<double> turned = step.h * (inverse * t);
  const bool has_force = step.change.norm() > step.rounding + kSilent * step.h;
  add_response(
      sums.force, step.change, step.error, step.h, keep, has_force,
      std::array<Vec3<double>, 2>{accelerate(step.R * f), accelerate(step.R.transpose() * f)},
      [&](size_t i) { return accelerate(find_load(i).f); });
  const double size = std::max(step.arm.norm(), 0.1), natural = step.mass * size * size;
  const double stated = step.inertia.trace() / 3.0;
  const double inertia = stated > kAbsurd * natural ? natural : stated;  // it may be in kg mm2
  add_response(sums.torque, turned, step.turn_error, step.h, keep, t.norm() > kSilent * inertia,
               std::array<Vec3<double>, 3>{turn(step.R.transpose() * t), turn(step.R * t),
                                           turn(t + step.arm.cross(step.R.transpose() * f))},
               [&](size_t i) { return turn(find_load(i).t); });
  std::rotate(sums.held.begin(), sums.held.end() - 1, sums.held.end());
  sums.held.front() = step.held;
  ModeStep mode;
  mode.error << step.R.transpose() * step.error, step.radius * step.turn_error;
  mode.offset << step.R.transpose() * step.offset, step.radius * step.turn_offset;
  mode.change << step.R.transpose() * f, t / step.radius;
  mode.change *= step.h / step.mass;
  mode.rounding = step.rounding;
  mode.h = step.h;
  add_to_mode(mode, keep, sums.mode);

  const double limit = kUnmodelled * std::max(1.0, step.gravity), missing = step.error.norm();
  // Errors that begin without a load are no wrong response to loads.
  const bool is_response = has_force && sums.unmodelled == 0 &&
                           find_left_by_scale(sums.force) < kExplained * sums.force.error2;
  const bool unmodelled =
      missing > step.h * limit && missing > kMostFelt * step.change.norm() && !is_response;
  if (unmodelled) {
    const Vec3<double> acceleration = step.error / step.h;
    ++sums.unmodelled;
    sums.unmodelled_time += step.h;
    sums.unmodelled_sum += acceleration;
    sums.unmodelled_sum2 += acceleration.squaredNorm();
    // Constant, unlike the oscillation of a flexible part.
    const Vec3<double> mean = sums.unmodelled_sum / sums.unmodelled;
    if (sums.unmodelled >= kUnmodelledSteps && sums.unmodelled_time >= kUnmodelledTime &&
        sums.unmodelled_sum2 / sums.unmodelled < (1.0 + kExplained) * mean.squaredNorm()) {
      return {kUnreportedForce, mean.norm()};
    }
  } else {
    sums.unmodelled = 0;
    sums.unmodelled_time = sums.unmodelled_sum2 = 0.0;
    sums.unmodelled_sum.setZero();
  }

  // The first announced load alone, or the first of many late loads?
  const Vec3<double> held = step.h / step.mass * f;
  const bool is_missing = (step.error + held).norm() < kSameShare * held.norm();
  if (step.announces && has_force && sums.force.loaded == 1 && is_missing) {
    sums.first_load = f.norm();
  } else if (sums.first_load > 0.0 && has_force) {
    const double first = sums.first_load;
    sums.first_load = 0.0;
    if (missing < kSameShare * held.norm()) return {kFirstLoadMissing, first};
  }
  for (const ResponseSums* r : {&sums.force, &sums.torque}) {
    const std::optional<LateLoads> late = find_late_loads(*r);
    if (late && (late->farther > 0 || step.announces)) return explain_late(step, *late);
  }
  const double force_size = find_error_size(sums.force), torque_size = find_error_size(sums.torque);
  const HostFinding by_force =
      force_size > kLoadError ? explain_force(step, sums.force) : HostFinding();
  const HostFinding by_torque =
      torque_size > kLoadError ? explain_torque(step, sums.torque) : HostFinding();
  const bool is_turn_larger = sums.torque.error2 * step.arm.squaredNorm() > sums.force.error2;
  const HostFinding& larger = is_turn_larger ? by_torque : by_force;
  const HostFinding& smaller = is_turn_larger ? by_force : by_torque;
  if (larger.fault == kWrongInertia) {  // a wrong mass makes a wrong inertia plausible
    if (sums.force.loaded < kEnoughSteps) return {};
    return smaller.fault == kWrongMass ? smaller : larger;
  }
  if (larger.fault != kHostRight) return larger;
  const auto is_known = [&](const ResponseSums& r) {
    return r.loaded >= kUnexplainedSteps || r.loaded * step.h >= kUnexplainedTime;
  };
  if (is_known(sums.force) && smaller.fault != kHostRight) return smaller;
  if (is_known(sums.force) && force_size > kFlexible) return {kUnexplained, force_size};
  if (is_known(sums.torque) && torque_size > kFlexible) return {kUnexplained, torque_size};
  return {};
}

HostFinding explain_by_mode(double h, bool fits, const ReportSums& sums) {
  const ResponseSums &f = sums.force, &t = sums.torque;
  const int loaded = std::max(f.loaded, t.loaded);
  if (loaded < kEnoughSteps) return {};
  for (const ResponseSums* r : {&f, &t}) {
    if (find_felt(*r) < kLeastFelt && may_be_late(*r, h)) return {};
  }
  const HostMode mode = find_mode(sums.mode, h);
  const bool is_seen = mode.rate * loaded * h > kLeastPeriods && (mode.bends || !fits);
  return is_seen ? HostFinding{kFlexiblePart, mode.frequency, mode.deflection} : HostFinding();
}

double find_mass_mismatch(const ReportSums& sums) {
  const ResponseSums& r = sums.force;
  if (r.loaded == 0 || !(r.change2 > 0.0)) return 0.0;
  const double felt = find_felt(r);
  if (std::abs(felt) > kMostFelt) return 0.0;  // another load moves the vehicle
  constexpr double kLeast = 1e-3;              // beyond: the vehicle does not move
  return 1.0 / std::max(felt, kLeast) - 1.0;
}

bool is_mass_confirmed(const ReportSums& sums) {
  constexpr double kUnexplainedShare = 0.05;
  return sums.force.loaded >= kEnoughSteps && std::abs(find_mass_mismatch(sums)) < kMassConfirmed &&
         find_left_by_scale(sums.force) < kUnexplainedShare * sums.force.change2;
}

}  // namespace dockloop
