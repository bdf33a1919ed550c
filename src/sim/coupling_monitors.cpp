// Monitors of the coupling for the host: does the vehicle move as predicted, is the order of
// exchange right, how long may steps be. Every warning is issued once, with numbers.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/host_coupling.hpp"

namespace dockloop {
namespace {

constexpr double kForget = 0.98;         ///< of the sums, per kForgetTime
constexpr double kForgetTime = 0.01;     ///< [s]
constexpr double kSilentChange = 1e-11;  ///< change of velocity that is ignored, [m/s], [rad/s] ...
constexpr double kRelativeRounding = 1e-14;  ///< ... and of the speed in N [-]
constexpr int kEnoughSteps = 10;
constexpr double kExplained = 0.05;         ///< of the squares of innovations, by an explanation
constexpr double kMassWarning = 0.05;       ///< mismatch that causes a warning [-]
constexpr double kMassConfirmed = 0.1;      ///< mismatch below which no step is too long [-]
constexpr double kLeastFelt = 0.1;          ///< of a predicted change; less counts as no change
constexpr double kMostFelt = 10.0;          ///< of a predicted change; more has another cause
constexpr double kStableRange = 0.8;        ///< frequency x step with a mass that is not confirmed
constexpr double kLongestSuggestion = 0.1;  ///< longest suggested step [s]
constexpr double kShare = 0.3;              ///< of the tolerance, for the next step
constexpr double kUnmodelled =
    1e-4;  ///< acceleration that causes a warning [m/s2], and part of gravity

}  // namespace

void HostCoupling::warn_once(int i, CouplingWarning what, const std::string& text) {
  int& warned = state_.coupling.warned[i];
  if ((warned & what) != 0) return;
  warned |= what;
  warnings_.push_back(text);
}

double HostCoupling::find_mass_mismatch(int i) const {
  const InnovationSums& sums = state_.coupling.vehicle[i].sums;
  if (sums.loaded == 0 || !(sums.predicted2 > 0.0)) return 0.0;
  const double felt = 1.0 + sums.innovation_predicted / sums.predicted2;
  if (std::abs(felt) > kMostFelt) return 0.0;  // another load moves the vehicle
  constexpr double kLeast = 1e-3;              // beyond: the vehicle does not move
  return 1.0 / std::max(felt, kLeast) - 1.0;
}

/// Squares of innovations that another mass does not explain [m2/s2].
double HostCoupling::find_unexplained_by_mass(const InnovationSums& sums) {
  if (!(sums.predicted2 > 0.0)) return sums.innovation2;
  return sums.innovation2 - sums.innovation_predicted * sums.innovation_predicted / sums.predicted2;
}

bool HostCoupling::is_mass_confirmed(int i) const {
  const InnovationSums& sums = state_.coupling.vehicle[i].sums;
  return sums.loaded >= kEnoughSteps && std::abs(find_mass_mismatch(i)) < kMassConfirmed &&
         find_unexplained_by_mass(sums) < kExplained * sums.predicted2;
}

/// The first received motion must be the motion at the start, not one step later.
void HostCoupling::look_at_first_state(int i, const VehicleState& z, double h) {
  const Vec3<double> distance = z.x - state_.coupling.vehicle[i].predicted.x;
  const Vec3<double> step = h * (state_.coupling.vehicle[i].predicted.v + state_.frame_velocity);
  if (!(step.norm() > 1e-9) || !((distance - step).norm() < 0.1 * step.norm())) return;
  char text[300];
  std::snprintf(text, sizeof text,
                "%s.position of the first step is %.3g m away from the start position. This is the "
                "distance of one step: the host passes the motion at the end of the step. Pass "
                "the motion at currentCommunicationPoint",
                get_vehicle_name(i), distance.norm());
  warn_once(i, kWarnedFirst, text);
}

/// Motion of the host's vehicle over the last step, compared with the predicted motion.
/// @param z  motion received now, at the end of the last step
void HostCoupling::look_at_innovation(int i, const VehicleState& z) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  InnovationSums& sums = v.sums;
  const double h = state_.last_step, mass = model_->stated_mass[i];
  const Mat3<double> R = quat_to_matrix<double>(z.q);
  const Vec3<double> arm = R * setup_->parameters.vehicle[i].interface_position;
  const Vec3<double> innovation = z.v - v.predicted.v;
  const Vec3<double> turning = R * (z.w - v.predicted.w);
  v.innovation = std::max(innovation.norm(), turning.norm() * arm.norm());

  // Work received by the host's vehicle, minus work of the mechanism.
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(v.received.q), z.q));
  state_.coupling.work_residual += v.held.f.dot(z.x - v.received.x) + v.held.t.dot(turn) - v.work;

  // Changes of velocity, gravity apart.
  const Vec3<double> predicted = v.predicted.v - v.received.v - v.fall;
  const Vec3<double> turned = v.predicted.w - v.received.w;
  const double keep = std::pow(kForget, h / kForgetTime);
  for (double* sum : {&sums.predicted2, &sums.innovation_predicted, &sums.innovation2,
                      &sums.shifted2, &sums.turn2, &sums.innovation_turn, &sums.turn_innovation2}) {
    *sum *= keep;
  }
  // Gravity as a constant over the step has at least this error.
  const double rounding = kSilentChange + kRelativeRounding * inputs_.vehicle[i].velocity.norm() +
                          h * kUnmodelled * loads_.at_start().gravity.norm();
  if (predicted.norm() > rounding) {
    ++sums.loaded;
    sums.predicted2 += predicted.squaredNorm();
    sums.innovation_predicted += innovation.dot(predicted);
    sums.innovation2 += innovation.squaredNorm();
    // Order of exchange: innovation with the load of the neighbouring step, applied a step late
    // (sequential exchange expected) or a step early (announced load applied at once).
    const Vec3<double> neighbour = announces() ? state_.mean_load[i].f : v.before.f;
    sums.shifted2 += (innovation - h / mass * (neighbour - v.held.f)).squaredNorm();
  }
  if (turned.norm() > kSilentChange) {
    sums.turn2 += turned.squaredNorm();
    sums.innovation_turn += (z.w - v.predicted.w).dot(turned);
    sums.turn_innovation2 += (z.w - v.predicted.w).squaredNorm();
  }
  const double load_effect = predicted.norm();
  const double limit = kUnmodelled * std::max(1.0, loads_.at_start().gravity.norm());
  const bool unmodelled = innovation.norm() > h * limit && innovation.norm() > 10.0 * load_effect;
  sums.unmodelled = unmodelled ? sums.unmodelled + 1 : 0;
  warn_of_exchange(i, innovation, z.w - v.predicted.w);
}

/// Find the cause of innovations: one warning that fits is better than three possible ones.
void HostCoupling::warn_of_exchange(int i, const Vec3<double>& innovation,
                                    const Vec3<double>& turn_innovation) {
  const DrivenVehicle& v = state_.coupling.vehicle[i];
  const InnovationSums& sums = v.sums;
  const char* name = get_vehicle_name(i);
  const double h = state_.last_step, stated = model_->stated_mass[i];
  char text[400];
  const auto unmodelled = [&](double acceleration) {
    std::snprintf(text, sizeof text,
                  "%s has an unmodelled acceleration of %.3g m/s2: connect 'gravity', and report "
                  "every other load in %s.force_ext",
                  name, acceleration, name);
    warn_once(i, kWarnedGravity, text);
  };
  // A motion that is reported one step too early looks like many other errors.
  if ((state_.coupling.warned[i] & kWarnedFirst) != 0) return;
  if (sums.unmodelled == 5) unmodelled(innovation.norm() / h);
  const Vec3<double> held = h / stated * v.held.f;
  if (announces() && sums.loaded == 1 && (innovation + held).norm() < 0.05 * held.norm()) {
    std::snprintf(text, sizeof text,
                  "%s did not feel the first announced load (%.6g N over %.6g s): read "
                  "%s.force_mean and %s.torque_mean after initialisation, before the first step",
                  name, v.held.f.norm(), h, name, name);
    warn_once(i, kWarnedLate, text);
  }
  if (sums.loaded < kEnoughSteps) return;
  const double turn_felt = sums.turn2 > 0.0 ? 1.0 + sums.innovation_turn / sums.turn2 : 1.0;
  const double turn_left =
      sums.turn2 > 0.0
          ? sums.turn_innovation2 - sums.innovation_turn * sums.innovation_turn / sums.turn2
          : 0.0;
  if (turn_felt < kLeastFelt &&
      (turn_felt < -kMostFelt || turn_left > kExplained * sums.turn_innovation2)) {
    // Too large, or about another axis: not a torque of the mechanism of either sign.
    std::snprintf(text, sizeof text,
                  "%s has an unmodelled angular acceleration of %.3g rad/s2: report every other "
                  "torque in %s.torque_ext, about the centre of mass, in body axes",
                  name, turn_innovation.norm() / h, name);
    warn_once(i, kWarnedNoTorqueExt, text);
  } else if (turn_felt < kLeastFelt) {
    std::snprintf(text, sizeof text,
                  "%s does not turn as predicted (%.3g of the predicted turn): connect "
                  "%s.torque_mean, about the centre of mass, in body axes, with its sign",
                  name, turn_felt, name);
    warn_once(i, kWarnedNoTorque, text);
  }
  const double unexplained = find_unexplained_by_mass(sums);
  const double size = std::sqrt(sums.innovation2 / sums.predicted2);
  if (size < 1e-5) return;
  if (sums.shifted2 < 0.01 * unexplained) {
    std::snprintf(
        text, sizeof text,
        announces()
            ? "%s applies the announced load a step early (innovations are %.3g of the changes of "
              "velocity): the host makes each step after this FMU; set coupling.mode = 1 "
              "(sequential)"
            : "%s applies the mean load a step late (innovations are %.3g of the changes of "
              "velocity): the host makes each step at the same time as this FMU; set "
              "coupling.mode = 2 (parallel)",
        name, size);
    warn_once(i, kWarnedOrder, text);
    return;
  }
  if ((state_.coupling.warned[i] & kWarnedOrder) != 0 || size < kMassWarning) return;
  const double felt = 1.0 + sums.innovation_predicted / sums.predicted2;
  if (unexplained > kExplained * sums.innovation2 || std::abs(felt) > kMostFelt) {
    const double rest = size * (v.predicted.v - v.received.v - v.fall).norm() / h;
    if (rest > kUnmodelled * std::max(1.0, loads_.at_start().gravity.norm())) unmodelled(rest);
    return;
  }
  if (felt < kLeastFelt) {
    std::snprintf(text, sizeof text,
                  "%s does not move as predicted (%.3g of the predicted change of velocity): "
                  "connect %s.force_mean, in N, with its sign",
                  name, felt, name);
    warn_once(i, kWarnedNoForce, text);
    return;
  }
  const double mismatch = find_mass_mismatch(i);
  std::snprintf(text, sizeof text,
                "%s moves as if its mass were %.6g kg, but %s.mass is %.6g kg (mismatch %.3g): "
                "loads are right to first order of the step only; see also "
                "%s.mass_includes_mechanism",
                name, stated * (1.0 + mismatch), name, stated, mismatch, name);
  warn_once(i, kWarnedMass, text);
  const double product = state_.coupling.frequency * h;
  if (product > kStableRange && std::abs(mismatch) > kMassConfirmed) {
    std::snprintf(text, sizeof text,
                  "the docking interface has a frequency of %.4g rad/s; frequency times step "
                  "(%.4g s) is %.3g, above the limit of %.1g: the coupling is not stable, because "
                  "the mass is wrong by %.3g; correct the mass, or make steps below %.3g s",
                  state_.coupling.frequency, h, product, kStableRange, mismatch,
                  kStableRange / state_.coupling.frequency);
    warn_once(i, kWarnedStep, text);
  }
}

/// After a step: store data of the step for the monitors.
/// @param start, end  of the internal vehicle
void HostCoupling::note_step(int i, const Wrench<double>& exerted, const VehicleState& start,
                             const VehicleState& end, double h) {
  DrivenVehicle& v = state_.coupling.vehicle[i];
  const double mass = model_->stated_mass[i];
  const Mat3<double> I = find_stated_inertia(i);
  const Vec3<double> distance = end.x - start.x;
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(start.q), end.q));
  const Loads& known = loads_.at(0.5 * h);
  v.fall.setZero();
  if (!model_->falling) v.fall = h * known.gravity;
  const Vec3<double> force = known.force[i] + mass / h * v.fall;
  v.work = find_rigid_energy(mass, I, end) - find_rigid_energy(mass, I, start) -
           force.dot(distance) - known.torque[i].dot(turn);
  // Announced load compared with exerted load; first moment of the load, from the position.
  const double impulse = (exerted.f - h * v.held.f).norm() / mass;
  const double moment = (distance - (v.predicted.x - v.received.x)).norm() / h;
  v.error = std::max({v.innovation, impulse, moment});
}

double HostCoupling::find_suggested_step(double frequency, double contact_time) const {
  const Parameters& p = setup_->parameters;
  if (!(state_.last_step > 0.0)) return p.coupling_expected_step;
  double error = 0.0;
  bool confirmed = true;
  for (int i : {kChaser, kTarget}) {
    if (!model_->driven[i]) continue;
    error = std::max(error, state_.coupling.vehicle[i].error);
    confirmed = confirmed && is_mass_confirmed(i);
  }
  constexpr double kLeastGrowth = 0.3, kMostGrowth = 1.5;
  const double growth = error > 0.0 ? std::clamp(kShare * p.coupling_velocity_tolerance / error,
                                                 kLeastGrowth, kMostGrowth)
                                    : kMostGrowth;
  double step =
      std::min(growth * state_.last_step, std::max(kLongestSuggestion, p.coupling_expected_step));
  if (!confirmed && frequency > 0.0) step = std::min(step, kStableRange / frequency);
  // The first contact is the critical event: approach the contact in suitable steps.
  step = std::min(step, std::max(contact_time, p.coupling_expected_step));
  return step;
}

double HostCoupling::find_interface_frequency(const double* y) {
  return dockloop::find_interface_frequency(*model_, state_.discrete, state_.memory,
                                            evaluator_.present(), loads_.at_start(), state_.elapsed,
                                            y, *interface_work_);
}

}  // namespace dockloop
