// What a host should know about its side of the coupling: does its vehicle move as predicted, is
// the order of exchange right, how long may steps be. Every warning is told once, with numbers.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kForget = 0.98;       ///< of the sums of the mass, per kForgetTime
constexpr double kForgetTime = 0.01;   ///< [s]
constexpr double kLeastChange = 1e-6;  ///< change of velocity that says something [m/s]
constexpr int kEnoughSteps = 10;
constexpr double kMassWarning = 0.05;        ///< mismatch that is told [-]
constexpr double kMassConfirmed = 0.1;       ///< mismatch below which no step is too long [-]
constexpr double kStableRange = 0.8;         ///< frequency x step with a mass that is not confirmed
constexpr double kLongestStep = 0.1;         ///< that is suggested [s]
constexpr double kShare = 0.3;               ///< of the tolerance that the next step may use
constexpr double kLeastAcceleration = 1e-4;  ///< unmodelled, that is told [m/s2]

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
  if (!(sums.predicted2 > kLeastChange * kLeastChange * sums.samples)) return 0.0;
  if (!(sums.told_predicted > 0.0)) return 0.0;
  return sums.predicted2 / sums.told_predicted - 1.0;
}

bool DockingSim::Impl::is_mass_confirmed(int i) const {
  const InnovationSums& sums = coupling.vehicle[i].sums;
  return sums.predicted2 > kLeastChange * kLeastChange * sums.samples &&
         sums.told_predicted > 0.0 && std::abs(find_mass_mismatch(i)) < kMassConfirmed;
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

  // Mass: changes of velocity, gravity apart.
  const Vec3<double> fall =
      model->falling ? Vec3<double>(Vec3<double>::Zero()) : Vec3<double>(h * loads.gravity);
  const Vec3<double> predicted = v.predicted.v - v.received.v - fall;
  const Vec3<double> told = z.v - v.received.v - fall;
  const double keep = std::pow(kForget, h / kForgetTime);
  sums.predicted2 = keep * sums.predicted2 + predicted.squaredNorm();
  sums.told_predicted = keep * sums.told_predicted + told.dot(predicted);
  sums.samples = keep * sums.samples + 1.0;

  // Order of exchange: as if the load of the step beside had been applied, a step late (sequential
  // exchange expected) or a step early (announced load applied at once).
  const Vec3<double> load = h / mass * v.held.f;
  const Vec3<double> beside = h / mass * (announces() ? mean_load[i].f : v.before.f);
  if (load.norm() > kLeastChange || beside.norm() > kLeastChange) {
    ++sums.loaded;
    sums.innovation2 += innovation.squaredNorm();
    sums.load2 += load.squaredNorm();
    sums.innovation_load += innovation.dot(load);
    sums.shifted2 += (innovation - (beside - load)).squaredNorm();
  }
  const double known = h / mass * loads.force[i].norm();
  const bool unmodelled = innovation.norm() > h * kLeastAcceleration &&
                          innovation.norm() > 10.0 * (load.norm() + known);
  sums.unmodelled = unmodelled ? sums.unmodelled + 1 : 0;
  warn_of_exchange(i, innovation, load);
  warn_of_mass(i);
}

void DockingSim::Impl::warn_of_exchange(int i, const Vec3<double>& innovation,
                                        const Vec3<double>& load) {
  const InnovationSums& sums = coupling.vehicle[i].sums;
  const char* name = name_of(i);
  char text[400];
  if (sums.unmodelled == 5) {
    std::snprintf(text, sizeof text,
                  "%s has an unmodelled acceleration of %.3g m/s2: is 'gravity' connected, and is "
                  "every other load told in %s.force_ext?",
                  name, innovation.norm() / last_step, name);
    warn_once(i, kToldGravity, text);
  }
  if (announces() && sums.loaded == 1 && load.norm() > kLeastChange &&
      (innovation + load).norm() < 0.05 * load.norm()) {
    std::snprintf(text, sizeof text,
                  "%s did not feel the first announced load (%.6g N over %.6g s): read "
                  "%s.force_mean and %s.torque_mean after initialisation, before the first step",
                  name, coupling.vehicle[i].held.f.norm(), last_step, name, name);
    warn_once(i, kToldLate, text);
  }
  // A motion that is told a step ahead looks like many other things.
  if (sums.loaded < kEnoughSteps || (coupling.warned[i] & kToldFirst) != 0) return;
  // What a wrong mass leaves unexplained.
  const double by_mass =
      sums.load2 > 0.0 ? sums.innovation2 - sums.innovation_load * sums.innovation_load / sums.load2
                       : sums.innovation2;
  if (sums.innovation2 > 1e-4 * sums.load2 && sums.shifted2 < 0.01 * by_mass) {
    std::snprintf(
        text, sizeof text,
        announces()
            ? "%s applies the announced load a step early (innovation of velocity %.3g m/s): the "
              "host makes each step after this FMU; set coupling.mode = 1 (sequential)"
            : "%s applies the mean load a step late (innovation of velocity %.3g m/s): the host "
              "makes each step at the same time as this FMU; set coupling.mode = 2 (parallel)",
        name, innovation.norm());
    warn_once(i, kToldOrder, text);
  }
}

void DockingSim::Impl::warn_of_mass(int i) {
  const InnovationSums& sums = coupling.vehicle[i].sums;
  const double mismatch = find_mass_mismatch(i), stated = model->stated_mass[i];
  if (sums.loaded < kEnoughSteps || std::abs(mismatch) < kMassWarning) return;
  if ((coupling.warned[i] & (kToldOrder | kToldLate)) != 0) return;  // says nothing then
  char text[300];
  std::snprintf(text, sizeof text,
                "%s moves as if its mass were %.6g kg, but %s.mass is %.6g kg (mismatch %.3g): "
                "loads are right to first order of the step only; see also "
                "%s.mass_includes_mechanism",
                name_of(i), stated * (1.0 + mismatch), name_of(i), stated, mismatch, name_of(i));
  warn_once(i, kToldMass, text);
  const double product = coupling.frequency * last_step;
  if (product > kStableRange && std::abs(mismatch) > kMassConfirmed) {
    std::snprintf(text, sizeof text,
                  "the interface has a frequency of %.4g rad/s; times the step of %.4g s this is "
                  "%.3g, above %.1g, which is not stable with a mass that is wrong by %.3g: take "
                  "steps below %.3g s",
                  coupling.frequency, last_step, product, kStableRange, mismatch,
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
  Vec3<double> force = known.force[i];
  if (!model->falling) force += mass * known.gravity;
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
    step = std::min(step, std::max(find_earliest_contact(), p.coupling_expected_step));
  }
  return step;
}

/// Step over which loads are announced: what the host says, what it was suggested if it follows
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

/// @pre update_outputs
void DockingSim::Impl::update_coupling_outputs() {
  coupling_valid = true;
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
  coupling.suggestion = find_suggested_step(outputs.coupling_frequency);
  outputs.coupling_suggested_step = coupling.suggestion;
}

}  // namespace dockloop
