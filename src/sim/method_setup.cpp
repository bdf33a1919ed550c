// From the chosen settings to the method of a run: integrator, tolerances, step for real time.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "mechanism/kernels.hpp"
#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

constexpr double kJudgedError = 1e-2;  ///< of an equal step: relative, and part of the rounding

constexpr double kLongestRealTimeStep = 0.01;  ///< [s]
constexpr double kAtOnce = 3.0;                ///< petals or latches that carry the load
constexpr double kPerFriction = 2.0;           ///< explicit step times rate; stable up to 2.8

/// Rate at which regularised friction stops a body that slides slowly [1/s].
double find_regularised_rate(const ContactLaw& law, double force, double mass) {
  return law.friction_coefficient * force / (law.friction_speed * mass);
}

/// Rate of bristles [1/s]: they relax, they yield while surfaces slide under little load, and they
/// damp the body while they stick. @param speed  of the approach
double find_bristle_rate(const ContactLaw& law, double speed, double mass, double pairs) {
  constexpr double kSlides = 0.5;  // of the speed, at light contact; measured
  return law.bristle_stiffness / law.bristle_relaxation +
         law.bristle_stiffness * kSlides * speed / law.bristle_force_floor +
         pairs * law.bristle_damping / mass;
}

/// Pairs that stick together: all nodes of faces that lie flat on each other, or some petals.
double count_sticking_pairs(const ContactModel& contact) {
  double nodes = 0.0;
  for (const NodeSet& set : contact.node_sets) nodes += set.count;
  return std::max(nodes, kAtOnce);
}

/// Fastest rate of friction of a body that strikes at this speed [1/s].
double find_friction_rate(const ContactModel& contact, double speed, double mass) {
  double rate = 0.0;
  for (const ContactLaw& law : contact.laws) {
    if (!(law.friction_coefficient > 0.0)) continue;
    const double force = speed * std::sqrt(kAtOnce * law.stiffness * mass);
    rate = std::max(rate, law.friction_model == 1
                              ? find_regularised_rate(law, force, mass)
                              : find_bristle_rate(law, speed, mass, count_sticking_pairs(contact)));
  }
  return rate;
}

/// Largest absolute eigenvalue, by squaring: lim |J^n|^(1/n). @param matrix  is overwritten
double find_spectral_radius(MatX<double>& matrix) {
  constexpr int kSquares = 10;
  double logarithm = 0.0, power = 1.0;
  for (int i = 0; i <= kSquares; ++i) {
    const double norm = matrix.norm();
    if (!(norm > 0.0)) return 0.0;
    logarithm += std::log(norm) / power;
    matrix /= norm;
    if (i < kSquares) matrix = (matrix * matrix).eval();
    power *= 2.0;
  }
  return std::exp(logarithm);
}

/// Mass on which a docking interface stands: springs let the vehicle behind an adapter move later,
/// and above their frequencies modes do not take part.
double find_interface_mass(const VehicleParts& parts, const VehicleParameters& vehicle,
                           double share_without_modes) {
  return parts.adapter ? parts.adapter->mass : share_without_modes * vehicle.mass;
}

}  // namespace

/// The smaller of the tolerances of parameter and host.
double DockingSim::Impl::find_relative_tolerance() const {
  const double asked = setup->tolerance;
  return asked > 0.0 ? std::min(asked, chosen.rtol) : chosen.rtol;
}

/// Does `auto` take linearly implicit steps? They pay where friction and latches limit explicit
/// steps: at loose tolerances, or if friction is steep. Limits measured with the docking scenes.
bool DockingSim::Impl::prefers_structured_matrix(double rtol) const {
  constexpr double kLoose = 1e-4, kLooseVelocity = 1e-6;  // solver.rtol, solver.atol_velocity
  constexpr double kUsual = 1e-6, kSteep = 1e-4;          // solver.rtol, contact.friction_speed
  const bool is_loose = rtol >= kLoose && chosen.atol_velocity >= kLooseVelocity;
  const bool is_steep = rtol >= kUsual && model->contact.law.friction_speed < kSteep;
  return model->contact.has_surfaces() && (is_loose || is_steep);
}

/// Linearly implicit steps? Some models and other equations need another method.
bool DockingSim::Impl::uses_structured_matrix(const RunMethod& method) const {
  if (!method.integrates_core() || needs_other_matrix(*model)) return false;
  const int number = method.facts->method;
  return number == kRosenbrock || number == kFixedRosenbrock ||
         (number == kAuto && prefers_structured_matrix(method.rtol));
}

/// One-step methods of our own with error control?
bool DockingSim::Impl::makes_own_steps(const RunMethod& method) const {
  if (method.is_structured) return !method.is_fixed_step();
  if (!method.integrates_core()) return false;
  const Stepper::Method used = find_stepper_method(method);
  return used == Stepper::Method::kDormandPrince || used == Stepper::Method::kStabilised ||
         used == Stepper::Method::kSwitching;
}

/// The method and what follows from it. Steps that pass communication points need a one-step method
/// and no host that integrates a vehicle. What acts at known times ends a step; a sequence acts at
/// booked states only.
RunMethod DockingSim::Impl::choose_method() const {
  RunMethod method;
  method.facts = find_method(chosen.method, needs_other_matrix(*model));
  method.rtol = find_relative_tolerance();
  method.is_co_simulation = fmi_kind == FmiKind::kCoSimulation;
  method.equations = equations.get();
  method.is_structured = uses_structured_matrix(method);
  method.is_switching = method.facts->method == kAuto && method.integrates_core() &&
                        !method.is_structured && !needs_other_matrix(*model);
  if (method.facts->method == kAuto && method.is_co_simulation && !method.is_reference()) {
    method.facts = find_method(method.equations       ? kDae
                               : method.is_structured ? kRosenbrock
                                                      : kStabilised);
  }
  method.runs_ahead = makes_own_steps(method) && !host->has_host();
  return method;
}

void DockingSim::Impl::make_loop() {
  const RunMethod method = choose_method();
  balances = std::make_unique<BalanceWatch>(
      *this, chosen.atol_energy, setup->t_start,
      !method.is_co_simulation ? "the tolerance of the host's solver"
      : method.is_fixed_step() ? "solver.step, or set solver.method = 1 (auto)"
                               : "solver.rtol",
      status_text, warnings);
  step_loop = std::make_unique<StepLoop>(
      *model, method,
      StepLoop::Parts{*this, loads, *events, *evaluator, *quiescent_mode, *balances, status_text},
      scene->rated, setup->t_start,
      [this](double tau, bool& changed) { return accept(tau, changed); });
  step_loop->use_interruption(interruption);

  if (method.is_fixed_step()) {
    step_loop->set_tolerances(kJudgedError * std::sqrt(find_share_of_norm()),
                              find_judged_tolerances());
  }
  std::vector<double> atol = find_absolute_tolerances();
  // A smaller relative tolerance of the host also reduces absolute tolerances, down to rounding.
  const double share_of_atol = method.rtol / chosen.rtol;
  constexpr double kRounding = 1e-13;  // [m], [m/s]; of positions and speeds near the docking
  const double least = kRounding / std::max(chosen.atol_position, kRounding);
  for (double& value : atol) value *= std::max(share_of_atol, least);
  if (!method.is_fixed_step()) {
    step_loop->set_tolerances(method.rtol * std::sqrt(find_share_of_norm()), atol);
  }
  if (equations) {
    equations->set_nominals(Eigen::Map<VecX<double>>(atol.data(), equations->size()) / method.rtol);
  }
  rates.assign(static_cast<size_t>(model->layout.size), 0.0);
}

/// Generated code evaluates trial states, if the FMU has such code and the code applies. Equations
/// of others use no generated code.
void DockingSim::Impl::attach_kernel() {
  const bool serves = !equations && parameters.model_level != kRigid;
  evaluator->use_kernels(serves ? kernels : nullptr);
}

/// Above these errors, an equal step is long for the motion. Measured with the shipped families and
/// surfaces up to 20 times as stiff: peaks are wrong by 5 % where the largest error of a step is 2.
std::vector<double> DockingSim::Impl::find_judged_tolerances() const {
  constexpr double kSums = 1e30;  // sums of energy have no influence on the motion
  const double rounding = model->contact.least_rounding;
  const double place = kJudgedError * (rounding > 0.0 ? rounding : 0.02);
  return find_absolute_tolerances(place, place, kSums);
}

std::vector<double> DockingSim::Impl::find_absolute_tolerances() const {
  return find_absolute_tolerances(chosen.atol_position, chosen.atol_velocity, chosen.atol_energy);
}

/// Per state, by kind; momenta are velocities times mass or inertia.
std::vector<double> DockingSim::Impl::find_absolute_tolerances(double position, double velocity,
                                                               double energy) const {
  const StateLayout& layout = model->layout;
  std::vector<double> atol(static_cast<size_t>(layout.size), position);
  std::fill_n(atol.begin() + layout.mechanism_v, layout.mechanism_nv, velocity);
  std::fill_n(atol.begin() + layout.target_v, layout.target_n, velocity);
  for (int i : {kChaser, kTarget}) {
    const VehicleParameters& p = parameters.vehicle[i];
    const double lever2 = p.interface_position.squaredNorm();
    const double inertia = p.inertia.head<3>().maxCoeff() + p.mass * lever2;
    const auto put = [&](int first) {
      std::fill_n(atol.begin() + first, 3, velocity * p.mass);
      std::fill_n(atol.begin() + first + 3, 3, velocity * inertia);
    };
    if (layout.momentum[i] >= 0) put(layout.momentum[i]);
    if (layout.host_impulse[i] >= 0) put(layout.host_impulse[i]);
    if (i == kChaser && model->moves[i]) put(layout.impulse);
  }
  std::fill_n(atol.begin() + layout.sums, layout.sum_count, energy);
  if (equations) equations->add_tolerances(atol);
  for (double& value : atol) value *= std::sqrt(find_share_of_norm());
  return atol;
}

/// Error norms are means over unknowns: idle bristles and multipliers must not reduce the norm.
double DockingSim::Impl::find_share_of_norm() const {
  const int all = equations ? equations->size() : model->layout.size;
  const int counted = equations ? equations->controlled_size() : all;
  return static_cast<double>(counted - model->layout.bristle_count) / all;
}

/// Inner step for real time [s], by the fastest rates of the equations: those of the mechanism at
/// the start, and those of its capture body in contact, in latches and sliding. A Runge-Kutta step
/// of order 4 is stable up to 2.8 over the rate; an oscillation needs shorter steps. Linearly
/// implicit steps are stable at any rate: they may pass over fast rates of mechanism and friction.
/// @pre evaluation of the start
double DockingSim::Impl::find_real_time_step(bool is_implicit) {
  const double per_rate = is_implicit ? 10.0 : 1.0, per_oscillation = is_implicit ? 0.2 : 0.3;
  double step = kLongestRealTimeStep;
  const auto limit = [&step](double rate, double factor) {
    if (rate * step > factor) step = factor / rate;
  };
  limit(find_rate_at_start(), per_rate);
  const double mass = find_struck_mass();
  if (!(mass > 0.0)) return step;
  const ContactModel& contact = model->contact;
  double stiffness = 0.0;
  if (contact.kind == ContactModel::Kind::kAbsorber) stiffness = contact.absorber.stiffness;
  if (contact.has_surfaces()) {
    for (const ContactLaw& law : contact.laws) {
      stiffness = std::max(stiffness, kAtOnce * law.stiffness);
    }
    const double friction = find_friction_rate(contact, present().relative.v.norm(), mass);
    if (!is_implicit) limit(friction, kPerFriction);
  }
  for (const Latch& latch : model->latches.latch) {
    stiffness = std::max(stiffness, kAtOnce * latch.law.hold_stiffness);
  }
  limit(std::sqrt(stiffness / mass), per_oscillation);
  const HardDock& dock = model->hard_dock;
  double inverse_mass = 0.0;
  for (int i : {kChaser, kTarget}) {
    if (model->moves[i])
      inverse_mass +=
          1.0 / find_interface_mass(scene->parts[i], parameters.vehicle[i], share_without_modes[i]);
  }
  double docked = dock.faces.stiffness + dock.hooks.stiffness * dock.hooks.count();
  for (const VehicleForce& force : model->forces) docked += force.stiffness;
  limit(std::sqrt(docked * inverse_mass), per_oscillation);
  return step;
}

/// Fastest rate of the equations at the start; 0 if there is no derivative [1/s]. Bristles of
/// contacts stay out: hundreds of unknowns, which act on nothing while surfaces are apart, and
/// whose rates find_friction_rate() has.
double DockingSim::Impl::find_rate_at_start() {
  evaluator->reserve_jacobian();
  MatX<double> jacobian;
  if (evaluator->aside(0.0, step_loop->y(), nullptr).ok() &&
      evaluator->calc_jacobian(0.0, step_loop->y(), false).ok()) {
    const MatX<double>& all = evaluator->jacobian();
    const Eigen::Index count = model->layout.bristle_count, before = model->layout.bristles,
                       after = all.rows() - before - count;
    jacobian.resize(before + after, before + after);
    jacobian << all.topLeftCorner(before, before), all.topRightCorner(before, after),
        all.bottomLeftCorner(after, before), all.bottomRightCorner(after, after);
  }
  evaluator->forget();
  return jacobian.size() > 0 && jacobian.allFinite() ? find_spectral_radius(jacobian) : 0.0;
}

/// Mass that surfaces stop; without a capture body the lighter vehicle that moves, else 0 [kg].
double DockingSim::Impl::find_struck_mass() const {
  double mass = find_impacting_mass();
  if (mass > 0.0) return mass;
  for (int i : {kChaser, kTarget}) {
    const double other =
        find_interface_mass(scene->parts[i], parameters.vehicle[i], share_without_modes[i]);
    if (model->moves[i]) mass = mass > 0.0 ? std::min(mass, other) : other;
  }
  return mass;
}

/// Mass that meets the target: the capture body on its legs, or all bodies; 0 without such bodies
/// [kg].
double DockingSim::Impl::find_impacting_mass() const {
  const int body = model->mechanism.model.capture_body;
  if (!present().locked) return body == kBase ? 0.0 : model->mechanism.model.bodies[body].mass;
  double inverse_mass = 0.0;
  if (model->moves[kChaser]) inverse_mass += 1.0 / quiescent_mode->locked().whole.mass;
  if (model->moves[kTarget]) inverse_mass += 1.0 / model->vehicle[kTarget].mass;
  return inverse_mass > 0.0 ? 1.0 / inverse_mass : 0.0;
}

/// Explicit equal steps that are long for the scene show nothing but wrong loads. Parts and modes
/// of vehicles that equal steps do not follow are refused.
void DockingSim::Impl::check_inner_step() {
  // Measured with the default docking: four times the step for real time costs some percent.
  constexpr double kLong = 4.0;
  constexpr double kResolved = 1.0;  // angle of a mode per step [rad]
  constexpr double kTurn = 2.0 * static_cast<double>(EIGEN_PI);
  if (fmi_kind != FmiKind::kCoSimulation || !step_loop->method().is_fixed_step() ||
      chosen.needs_step)
    return;
  for (int i : {kChaser, kTarget}) {
    scene->parts[i].for_each([&](const VehiclePart& part) {
      double rate = 0.0;
      for (const PartCoordinate& coordinate : part.coordinates) {
        rate = std::max(rate, std::sqrt(coordinate.stiffness / coordinate.inertia));
      }
      // The rest of a free vehicle moves against a mode.
      if (is_mode(part)) rate /= std::sqrt(share_without_modes[i]);
      if (rate * inner_step <= kResolved) return;
      throw ModelError(part.name + " has up to " + describe_number(rate / kTurn) + " Hz on the " +
                       (is_mode(part) ? "free" : "held") +
                       " vehicle, which solver.step = " + describe_number(inner_step) +
                       " s does not resolve; take at most " + describe_number(kResolved / rate) +
                       " s or solver.method = 1 (auto), or leave it out");
    });
  }
  if (step_loop->method().is_structured) return;
  const double suggested = find_real_time_step(false);
  if (inner_step <= kLong * suggested || suggested >= kLongestRealTimeStep) return;
  char text[300];
  std::snprintf(text, sizeof text,
                "solver.step = %.3g s is long for the fastest rates of this scene: peak loads may "
                "be wrong without another sign; take %.3g s, or set accuracy = -1 (real-time)",
                inner_step, suggested);
  warnings.push_back(text);
}

}  // namespace dockloop
