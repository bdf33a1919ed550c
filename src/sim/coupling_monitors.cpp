// What a host should know about its side of the coupling: does its vehicle move as predicted, is
// the order of exchange right, how long may steps be. Every warning is told once, with numbers.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kForget = 0.98;      ///< of the sums, per kForgetTime
constexpr double kForgetTime = 0.01;  ///< [s]
constexpr double kSilentChange =
    1e-11;  ///< change of velocity that says nothing, [m/s], [rad/s] ...
constexpr double kRelativeRounding = 1e-14;  ///< ... and of the speed in N [-]
constexpr int kEnoughSteps = 10;
constexpr double kExplained = 0.05;     ///< of the squares of innovations, by an explanation
constexpr double kMassWarning = 0.05;   ///< mismatch that is told [-]
constexpr double kMassConfirmed = 0.1;  ///< mismatch below which no step is too long [-]
constexpr double kLeastFelt = 0.1;      ///< of a predicted change, less is none at all
constexpr double kMostFelt = 10.0;      ///< more is not the effect of that load
constexpr double kStableRange = 0.8;    ///< frequency x step with a mass that is not confirmed
constexpr double kLongestStep = 0.1;    ///< that is suggested [s]
constexpr double kShare = 0.3;          ///< of the tolerance that the next step may use
constexpr double kUnmodelled = 1e-4;    ///< acceleration that is told [m/s2], and part of gravity

}  // namespace

void DockingSim::Impl::warn_once(int i, CouplingWarning what, const std::string& text) {
  int& warned = coupling.warned[i];
  if ((warned & what) != 0) return;
  warned |= what;
  warnings.push_back(text);
}

/// True mass / stated mass - 1 as the motion shows it; 0 while it shows nothing.
double DockingSim::Impl::find_mass_mismatch(int i) const {
  const InnovationSums& sums = coupling.vehicle[i].sums;
  if (sums.loaded == 0 || !(sums.predicted2 > 0.0)) return 0.0;
  const double felt = 1.0 + sums.innovation_predicted / sums.predicted2;
  if (std::abs(felt) > kMostFelt) return 0.0;  // something else moves it
  constexpr double kLeast = 1e-3;              // heavier by more: it does not move at all
  return 1.0 / std::max(felt, kLeast) - 1.0;
}

/// Squares of innovations that another mass does not explain [m2/s2].
double DockingSim::Impl::find_unexplained_by_mass(const InnovationSums& sums) {
  if (!(sums.predicted2 > 0.0)) return sums.innovation2;
  return sums.innovation2 - sums.innovation_predicted * sums.innovation_predicted / sums.predicted2;
}

bool DockingSim::Impl::is_mass_confirmed(int i) const {
  const InnovationSums& sums = coupling.vehicle[i].sums;
  return sums.loaded >= kEnoughSteps && std::abs(find_mass_mismatch(i)) < kMassConfirmed &&
         find_unexplained_by_mass(sums) < kExplained * sums.predicted2;
}

/// The first motion that is told must be that of the start, not of a step later.
void DockingSim::Impl::look_at_first_state(int i, const VehicleState& z, double h) {
  const Vec3<double> way = z.x - coupling.vehicle[i].predicted.x;
  const Vec3<double> step = h * (coupling.vehicle[i].predicted.v + frame_velocity);
  if (!(step.norm() > 1e-9) || !((way - step).norm() < 0.1 * step.norm())) return;
  char text[300];
  std::snprintf(text, sizeof text,
                "%s.position of the first step is %.3g m further than at the start, which is the "
                "way of one step: the host passes the motion at the end of a step as that of its "
                "beginning; pass the motion at currentCommunicationPoint",
                name_of(i), way.norm());
  warn_once(i, kToldFirst, text);
}

/// What the host's vehicle did over the last step, beside what was predicted of it.
/// @param z  as told now, at the end of that step
void DockingSim::Impl::look_at_innovation(int i, const VehicleState& z) {
  DrivenVehicle& v = coupling.vehicle[i];
  InnovationSums& sums = v.sums;
  const double h = last_step, mass = model->stated_mass[i];
  const Mat3<double> R = quat_to_matrix<double>(z.q);
  const Vec3<double> arm = R * setup->parameters.vehicle[i].interface_position;
  const Vec3<double> innovation = z.v - v.predicted.v;
  const Vec3<double> turning = R * (z.w - v.predicted.w);
  v.innovation = std::max(innovation.norm(), turning.norm() * arm.norm());

  // Work that the host's vehicle took up, less what the mechanism gave.
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(v.received.q), z.q));
  coupling.work_residual += v.held.f.dot(z.x - v.received.x) + v.held.t.dot(turn) - v.work;

  // Changes of velocity, gravity apart.
  const Vec3<double> predicted = v.predicted.v - v.received.v - v.fall;
  const Vec3<double> turned = v.predicted.w - v.received.w;
  const double keep = std::pow(kForget, h / kForgetTime);
  for (double* sum : {&sums.predicted2, &sums.innovation_predicted, &sums.innovation2,
                      &sums.shifted2, &sums.turn2, &sums.innovation_turn, &sums.turn_innovation2}) {
    *sum *= keep;
  }
  // Gravity that is told as a constant over the step is not known better than this.
  const double rounding = kSilentChange + kRelativeRounding * inputs.vehicle[i].velocity.norm() +
                          h * kUnmodelled * loads.gravity.norm();
  if (predicted.norm() > rounding) {
    ++sums.loaded;
    sums.predicted2 += predicted.squaredNorm();
    sums.innovation_predicted += innovation.dot(predicted);
    sums.innovation2 += innovation.squaredNorm();
    // Order of exchange: as if the load of the step beside had been applied, a step late
    // (sequential exchange expected) or a step early (announced load applied at once).
    const Vec3<double> beside = announces() ? mean_load[i].f : v.before.f;
    sums.shifted2 += (innovation - h / mass * (beside - v.held.f)).squaredNorm();
  }
  if (turned.norm() > kSilentChange) {
    sums.turn2 += turned.squaredNorm();
    sums.innovation_turn += (z.w - v.predicted.w).dot(turned);
    sums.turn_innovation2 += (z.w - v.predicted.w).squaredNorm();
  }
  const double told = predicted.norm();
  const double limit = kUnmodelled * std::max(1.0, loads.gravity.norm());
  const bool unmodelled = innovation.norm() > h * limit && innovation.norm() > 10.0 * told;
  sums.unmodelled = unmodelled ? sums.unmodelled + 1 : 0;
  warn_of_exchange(i, innovation, z.w - v.predicted.w);
}

/// Find the reason of innovations: one warning that fits is better than three that may.
void DockingSim::Impl::warn_of_exchange(int i, const Vec3<double>& innovation,
                                        const Vec3<double>& turn_innovation) {
  const DrivenVehicle& v = coupling.vehicle[i];
  const InnovationSums& sums = v.sums;
  const char* name = name_of(i);
  const double h = last_step, stated = model->stated_mass[i];
  char text[400];
  const auto unmodelled = [&](double acceleration) {
    std::snprintf(text, sizeof text,
                  "%s has an unmodelled acceleration of %.3g m/s2: is 'gravity' connected, and is "
                  "every other load told in %s.force_ext?",
                  name, acceleration, name);
    warn_once(i, kToldGravity, text);
  };
  // A motion that is told a step ahead looks like many other things.
  if ((coupling.warned[i] & kToldFirst) != 0) return;
  if (sums.unmodelled == 5) unmodelled(innovation.norm() / h);
  const Vec3<double> held = h / stated * v.held.f;
  if (announces() && sums.loaded == 1 && (innovation + held).norm() < 0.05 * held.norm()) {
    std::snprintf(text, sizeof text,
                  "%s did not feel the first announced load (%.6g N over %.6g s): read "
                  "%s.force_mean and %s.torque_mean after initialisation, before the first step",
                  name, v.held.f.norm(), h, name, name);
    warn_once(i, kToldLate, text);
  }
  if (sums.loaded < kEnoughSteps) return;
  const double turn_felt = sums.turn2 > 0.0 ? 1.0 + sums.innovation_turn / sums.turn2 : 1.0;
  const double turn_left =
      sums.turn2 > 0.0
          ? sums.turn_innovation2 - sums.innovation_turn * sums.innovation_turn / sums.turn2
          : 0.0;
  if (turn_felt < kLeastFelt &&
      (turn_felt < -kMostFelt || turn_left > kExplained * sums.turn_innovation2)) {
    // Too much, or about another axis: no torque of the mechanism, whatever its sign.
    std::snprintf(text, sizeof text,
                  "%s has an unmodelled angular acceleration of %.3g rad/s2: is every torque that "
                  "acts on it reported in %s.torque_ext, about the centre of mass, in body axes?",
                  name, turn_innovation.norm() / h, name);
    warn_once(i, kToldNoTorqueExt, text);
  } else if (turn_felt < kLeastFelt) {
    std::snprintf(text, sizeof text,
                  "%s does not turn as predicted (%.3g of it): is %s.torque_mean connected, about "
                  "the centre of mass, in body axes, with its sign?",
                  name, turn_felt, name);
    warn_once(i, kToldNoTorque, text);
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
    warn_once(i, kToldOrder, text);
    return;
  }
  if ((coupling.warned[i] & kToldOrder) != 0 || size < kMassWarning) return;
  const double felt = 1.0 + sums.innovation_predicted / sums.predicted2;
  if (unexplained > kExplained * sums.innovation2 || std::abs(felt) > kMostFelt) {
    const double rest = size * (v.predicted.v - v.received.v - v.fall).norm() / h;
    if (rest > kUnmodelled * std::max(1.0, loads.gravity.norm())) unmodelled(rest);
    return;
  }
  if (felt < kLeastFelt) {
    std::snprintf(text, sizeof text,
                  "%s does not move as predicted (%.3g of it): is %s.force_mean connected, in N, "
                  "with its sign?",
                  name, felt, name);
    warn_once(i, kToldNoForce, text);
    return;
  }
  const double mismatch = find_mass_mismatch(i);
  std::snprintf(text, sizeof text,
                "%s moves as if its mass were %.6g kg, but %s.mass is %.6g kg (mismatch %.3g): "
                "loads are right to first order of the step only; see also "
                "%s.mass_includes_mechanism",
                name, stated * (1.0 + mismatch), name, stated, mismatch, name);
  warn_once(i, kToldMass, text);
  const double product = coupling.frequency * h;
  if (product > kStableRange && std::abs(mismatch) > kMassConfirmed) {
    std::snprintf(text, sizeof text,
                  "the interface has a frequency of %.4g rad/s; times the step of %.4g s this is "
                  "%.3g, above %.1g, which is not stable with a mass that is wrong by %.3g: take "
                  "steps below %.3g s",
                  coupling.frequency, h, product, kStableRange, mismatch,
                  kStableRange / coupling.frequency);
    warn_once(i, kToldStep, text);
  }
}

/// After a step: what the monitors need of it. @param end  of the internal vehicle
void DockingSim::Impl::note_step(int i, const Wrench<double>& exerted, const VehicleState& end,
                                 double h) {
  DrivenVehicle& v = coupling.vehicle[i];
  const VehicleState& start = step_begin.vehicle[i];
  const double mass = model->stated_mass[i];
  const Mat3<double> I = find_stated_inertia(i);
  const Vec3<double> way = end.x - start.x;
  const Vec3<double> turn =
      quat_log<double>(quat_multiply<double>(quat_conjugate<double>(start.q), end.q));
  const Loads& known = find_loads(0.5 * h);
  v.fall.setZero();
  if (!model->falling) v.fall = h * known.gravity;
  const Vec3<double> force = known.force[i] + mass / h * v.fall;
  v.work = find_rigid_energy(mass, I, end) - find_rigid_energy(mass, I, start) - force.dot(way) -
           known.torque[i].dot(turn);
  // Announced beside exerted load; the first moment of the load, seen in the position.
  const double impulse = (exerted.f - h * v.held.f).norm() / mass;
  const double moment = (way - (v.predicted.x - v.received.x)).norm() / h;
  v.error = std::max({v.innovation, impulse, moment});
}

/// Step over which the error of the coupling should stay below coupling.velocity_tolerance.
double DockingSim::Impl::find_suggested_step(double frequency) const {
  const Parameters& p = setup->parameters;
  if (!(last_step > 0.0)) return p.coupling_expected_step;
  double error = 0.0;
  bool confirmed = true;
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    error = std::max(error, coupling.vehicle[i].error);
    confirmed = confirmed && is_mass_confirmed(i);
  }
  constexpr double kLeastGrowth = 0.3, kMostGrowth = 1.5;
  const double growth = error > 0.0 ? std::clamp(kShare * p.coupling_velocity_tolerance / error,
                                                 kLeastGrowth, kMostGrowth)
                                    : kMostGrowth;
  double step = std::min(growth * last_step, std::max(kLongestStep, p.coupling_expected_step));
  if (!confirmed && frequency > 0.0) step = std::min(step, kStableRange / frequency);
  // The first contact is the worst moment: come to it in steps that are meant for it.
  if (!discrete.contacted && has_surfaces()) {
    const double gap = find_gap(model->contact, data->relative, data->contact_work);
    step = std::min(step, std::max(find_earliest_contact(gap), p.coupling_expected_step));
  }
  return step;
}

/// A host that changes its step to the suggested one follows suggestions. What is suggested
/// follows from the state alone, whether it was read or not.
void DockingSim::Impl::notice_step(double h) {
  constexpr double kSame = 1e-6;
  if (!(last_step > 0.0)) return;
  double suggested = coupling.suggestion;
  if (!coupling.follows) {
    if (h == last_step || !evaluate(0.0).ok()) return;
    suggested = find_suggested_step(find_interface_frequency());
  }
  coupling.follows = std::abs(h - suggested) <= kSame * suggested;
}

/// Step over which loads are announced: what the host says, what is suggested to it if it follows
/// suggestions, or as the last.
double DockingSim::Impl::find_expected_step() {
  if (inputs.next_step > 0.0) return inputs.next_step;
  if (!coupling.follows || !evaluate(0.0).ok()) return last_step;
  coupling.suggestion = find_suggested_step(find_interface_frequency());
  return coupling.suggestion;
}

/// Of the mechanism and what holds it between the vehicles [rad/s]. @pre evaluate
double DockingSim::Impl::find_interface_frequency() {
  return dockloop::find_interface_frequency(*model, discrete, memory, *data, loads, elapsed,
                                            stepper->y(), *interface_work);
}

/// @pre update_main
void DockingSim::Impl::update_coupling() {
  if (!has_host()) return;
  outputs.coupling_work_residual = coupling.work_residual;
  outputs.coupling_mass_mismatch = 0.0;
  for (int i : {kChaser, kTarget}) {
    if (!model->driven[i]) continue;
    const double mismatch = find_mass_mismatch(i);
    if (std::abs(mismatch) > std::abs(outputs.coupling_mass_mismatch)) {
      outputs.coupling_mass_mismatch = mismatch;
    }
  }
  outputs.coupling_frequency = find_interface_frequency();
  outputs.coupling_suggested_step =
      coupling.follows ? coupling.suggestion : find_suggested_step(outputs.coupling_frequency);
}

}  // namespace dockloop
