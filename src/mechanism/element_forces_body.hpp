// Forces of elements, for any scalar; see element_forces.hpp.
#pragma once

#include <algorithm>
#include <type_traits>

#include "math/ramp.hpp"
#include "math/scalar.hpp"
#include "mechanism/element_forces.hpp"
#include "mechanism/force_laws.hpp"

namespace dockloop {

template <class S>
ElementData<S>::ElementData(const MechanismModel& model) {
  const int count = static_cast<int>(model.elements.size());
  for (auto* x : {&coordinate, &rate, &force, &saturation}) x->setZero(count);
  z_rate.setZero(count_element_bristles(model.elements, model.failures));
}

namespace {

/// Effect of failures on a law: factor g of its force and energy, its rate, delay of its start.
/// The sequence itself delays what it sets (sim/sequence_logic.cpp).
template <class S>
struct FailureEffect {
  S factor = S(1), rate = S(0);
  double delay = 0.0;
  bool fades = false;  ///< else the factor is one, and its rate zero
};

template <class S>
FailureEffect<S> find_failure(const MechanismModel& model, size_t element, size_t law,
                              const S& time, const double* entered) {
  constexpr double kFades = 0.05;  // [s]
  using Kind = LawFailure::Kind;
  FailureEffect<S> effect;
  for (const LawFailure& failure : model.failures) {
    if (!failure.active || failure.kind == Kind::kJammed) continue;
    if (failure.element != static_cast<int>(element) || failure.law != static_cast<int>(law)) {
      continue;
    }
    const double onset = find_time(failure.onset, entered);
    if (failure.kind == Kind::kDelayed) {
      if (onset <= 0.0) effect.delay = failure.value;
      continue;
    }
    const S u = (time - S(onset)) / S(kFades);
    if (!(u > S(0))) continue;
    const double last = failure.kind == Kind::kOff ? 0.0 : failure.value;
    const Ramp<S> fade = calc_ramp<S>(clamp_unit<S>(u), S(kFades));
    const S g = S(1) + S(last - 1.0) * fade.share;
    effect.rate = effect.rate * g + effect.factor * S(last - 1.0) * fade.rate;
    effect.factor = effect.factor * g;
    effect.fades = true;
  }
  return effect;
}

/// A law with the factor g: f v = -d(g U)/dt + g' U - g D + g W. What fading releases is
/// dissipated, what growth needs is work of a drive.
template <class S>
void scale_terms(const FailureEffect<S>& effect, LawTerms<S>& terms) {
  const S& g = effect.factor;
  const S change = effect.rate * terms.energy;
  terms.force = terms.force * g;
  terms.energy = terms.energy * g;
  terms.dissipation = terms.dissipation * g;
  terms.work = terms.work * g;
  if (change > S(0)) {
    terms.work += change;
  } else {
    terms.dissipation -= change;
  }
}

/// A law as a sequence has switched it; a motor or drive with the numbers of the file may start
/// late. @param[in, out] effect  of failures; an eddy brake that is not engaged is as one that has
/// failed
template <class Law, class S>
LawTerms<S> calc_switched_law(const Law& law, const LawSetting* setting, LawInput<S>& in,
                              FailureEffect<S>& effect) {
  if constexpr (std::is_same_v<Law, EddyLaw>) {
    if (setting && setting->engagement != 1.0) {
      effect.factor = effect.factor * in.engagement;
      effect.fades = true;
    }
  }
  if constexpr (std::is_same_v<Law, DriveLaw>) {
    if (setting && setting->drive == LawSetting::Drive::kOff) return {};
    if (setting && setting->drive == LawSetting::Drive::kRuns) {
      DriveLaw running = law;
      running.target = setting->target;
      running.speed = setting->is_held ? 0.0 : setting->speed;
      running.acceleration = setting->acceleration;
      running.deceleration = setting->deceleration;
      in.time = in.time - S(setting->since);
      return calc_law(running, in);
    }
  }
  if (effect.delay != 0.0) in.time = in.time - S(effect.delay);
  return calc_law(law, in);
}

/// Elastic locks of jammed elements: their bristles come after those of the brakes.
template <class S>
void add_locks(const MechanismModel& model, const S& time, const double* entered, const S* z,
               int bristle, ElementData<S>& data, VecX<S>& tau) {
  for (const LawFailure& failure : model.failures) {
    if (failure.kind != LawFailure::Kind::kJammed) continue;
    const int i = failure.element;
    const S deflection = z ? z[bristle] : S(0);
    const bool holds = failure.active && !(time < S(find_time(failure.onset, entered)));
    const S force = S(-failure.value) * deflection;
    data.z_rate[bristle++] = holds ? data.rate[i] : S(0);
    data.force[i] += force;
    data.sums.energy += S(0.5 * failure.value) * deflection * deflection;
    for (const ElementTerm& term : model.elements[static_cast<size_t>(i)].along) {
      tau[model.bodies[term.body].v_index] += S(term.ratio) * force;
    }
  }
}

/// Lock of an element by a sequence: a spring and a damper about the place where it was.
template <class S>
S calc_lock(const ElementLock& lock, const S& coordinate, const S& rate, ElementSums<S>& sums) {
  sums.energy += lock.find_energy(coordinate);
  sums.braking += S(lock.damping) * rate * rate;
  return S(-lock.stiffness) * (coordinate - S(lock.place)) - S(lock.damping) * rate;
}

/// Book the powers of a law: brakes and drives have lines of their own.
template <class Law, class S>
void add_terms(const LawTerms<S>& terms, ElementSums<S>& sums) {
  constexpr bool kBrakes = std::is_same_v<Law, BrakeLaw> || std::is_same_v<Law, EddyLaw>;
  sums.energy += terms.energy;
  (kBrakes ? sums.braking : sums.dissipation) += terms.dissipation;
  sums.drive_power += terms.work;
}

}  // namespace

template <class S>
Status calc_element_forces(const MechanismModel& model, const VecX<S>& q, const VecX<S>& v,
                           const S& time, const S* command, const ElementSwitches& switches,
                           const S* z, ElementData<S>& data, VecX<S>& tau) {
  Status found;
  data.sums = ElementSums<S>();
  const bool has_failures = std::any_of(model.failures.begin(), model.failures.end(),
                                        [](const LawFailure& failure) { return failure.active; });
  int bristle = 0;
  size_t first_law = 0;  // of the element, among all laws
  for (size_t e = 0; e < model.elements.size(); ++e) {
    const ForceElement& element = model.elements[e];
    const int i = static_cast<int>(e);
    LawInput<S> in;
    if (command) in.command = command[i];
    in.s = find_coordinate<S>(model, element, q);
    in.v = find_rate<S>(model, element, v);
    S force(0), saturation(0);
    const auto add = [&](const auto& law, size_t k) {
      using Law = std::decay_t<decltype(law)>;
      FailureEffect<S> failure;
      if (has_failures) failure = find_failure(model, e, k, time, switches.entered);
      const LawSetting* setting = switches.setting ? switches.setting + first_law + k : nullptr;
      in.time = time;
      in.engagement = S(setting ? setting->engagement : 1.0);
      in.health = failure.factor;
      LawTerms<S> terms = calc_switched_law(law, setting, in, failure);
      if (failure.fades && !std::is_same_v<Law, BrakeLaw>) scale_terms(failure, terms);
      force += terms.force;
      saturation = std::max<S>(saturation, terms.saturation);
      add_terms<Law>(terms, data.sums);
      if (terms.outside != StatusCode::kOk) {
        const bool is_rate = terms.outside == StatusCode::kRateOutsideTable;
        found = {terms.outside, i, to_double(is_rate ? in.v : in.s), 0.0};
      }
      return terms.z_rate;
    };
    // The level of a brake may depend on the load of the other laws: brakes come last.
    size_t brakes = 0;
    for (size_t k = 0; k < element.laws.size(); ++k) {
      const auto add_others = [&](const auto& law) {
        if constexpr (std::is_same_v<std::decay_t<decltype(law)>, BrakeLaw>) {
          ++brakes;
        } else {
          add(law, k);
        }
      };
      std::visit(add_others, element.laws[k]);
    }
    in.load = force < S(0) ? S(-force) : force;
    for (size_t k = 0; brakes > 0; ++k) {
      const BrakeLaw* brake = std::get_if<BrakeLaw>(&element.laws[k]);
      if (!brake) continue;
      --brakes;
      const bool sticks = brake->has_bristle();
      in.z = sticks && z ? z[bristle] : S(0);
      const S z_rate = add(*brake, k);
      if (sticks) data.z_rate[bristle++] = z_rate;
    }
    if (switches.lock && switches.lock[e].is_closed()) {
      force += calc_lock(switches.lock[e], in.s, in.v, data.sums);
    }
    for (const ElementTerm& term : element.along) {
      tau[model.bodies[term.body].v_index] += S(term.ratio) * force;
    }
    first_law += element.laws.size();
    data.coordinate[i] = in.s;
    data.rate[i] = in.v;
    data.force[i] = force;
    data.saturation[i] = saturation;
  }
  add_locks(model, time, switches.entered, z, bristle, data, tau);
  return found;
}

#define DOCK_INSTANTIATE(S)                                                                     \
  template struct ElementData<S>;                                                               \
  template Status calc_element_forces<S>(const MechanismModel&, const VecX<S>&, const VecX<S>&, \
                                         const S&, const S*, const ElementSwitches&, const S*,  \
                                         ElementData<S>&, VecX<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
