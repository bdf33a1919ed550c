// Force elements of a mechanism: coordinate, laws, generalised forces, energies, bristles.
#pragma once

#include "math/status.hpp"
#include "math/types.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// Sums over all elements.
template <class S>
struct ElementSums {
  S energy = S(0);       ///< stored [J]
  S dissipation = S(0);  ///< in dampers and stops [W]
  S braking = S(0);      ///< in brakes, friction and electromagnetic [W]
  S drive_power = S(0);  ///< of motors and drives on the mechanism [W]
};

/// Everything computed of the elements.
template <class S>
struct ElementData {
  explicit ElementData(const MechanismModel& model);
  VecX<S> coordinate, rate, force;  ///< per element
  VecX<S> saturation;  ///< per element: largest share of a limit of its motors and drives
  VecX<S> z_rate;      ///< per bristle
  ElementSums<S> sums;
};

/// Sum of ratio x number over the joints of an element. @param index  of a body into the numbers
template <class S>
S sum_along(const MechanismModel& model, const ForceElement& element, const VecX<S>& numbers,
            int Body::* index) {
  S sum(0);
  for (const ElementTerm& term : element.along) {
    sum += S(term.ratio) * numbers[model.bodies[term.body].*index];
  }
  return sum;
}

/// Coordinate of an element. @param q  all coordinates
template <class S>
S find_coordinate(const MechanismModel& model, const ForceElement& element, const VecX<S>& q) {
  return sum_along<S>(model, element, q, &Body::q_index);
}

/// Its rate. @param v  all velocities
template <class S>
S find_rate(const MechanismModel& model, const ForceElement& element, const VecX<S>& v) {
  return sum_along<S>(model, element, v, &Body::v_index);
}

/// What a sequence has done so far; null: there is none.
struct ElementSwitches {
  const LawSetting* setting = nullptr;  ///< per law of all elements
  const double* entered = nullptr;      ///< as of find_time(Onset)
  const ElementLock* lock = nullptr;    ///< per element
};

/// Add the forces of all elements to tau.
/// @param[in]  q, v     all coordinates (nq) and velocities (nv)
/// @param[in]  time     since the start [s]
/// @param[in]  command  per element; null: 0
/// @param[in]  z        bristles (count_element_bristles); null: 0
/// @param[out] tau      joint forces (nv), added to
/// @return a table is left that is not to be left; the forces are those of an extended table
template <class S>
Status calc_element_forces(const MechanismModel& model, const VecX<S>& q, const VecX<S>& v,
                           const S& time, const S* command, const ElementSwitches& switches,
                           const S* z, ElementData<S>& data, VecX<S>& tau);

}  // namespace dockloop
