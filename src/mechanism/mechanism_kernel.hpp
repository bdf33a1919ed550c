// Generated code for one mechanism, as mechanism_dynamics.hpp calls it: the one seam between the
// two.
//
// It serves evaluations for Need::kRates, and fills everything that those may leave to a caller:
// motion of the independent bodies and the capture body, q and v of joints that carry a force, mass
// and first moment of a vehicle with all it carries, A_ind and its factor, accelerations,
// linear_momentum. For every other need, and wherever it does not apply, the general code runs.
#pragma once

#include "tree/tree.hpp"

namespace dockloop {

template <class S>
struct MechanismData;

class MechanismKernel {
 public:
  virtual ~MechanismKernel() = default;
  /// @return false if the code does not apply: a loop does not close or is close to singular, the
  /// assembly branch or the turn of an angle is in doubt. The general code then decides.
  virtual bool calc_position(MechanismData<double>& data) = 0;
  virtual void calc_velocity(const BaseMotion<double>& base, MechanismData<double>& data) = 0;
  virtual void calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) = 0;
  /// The vehicle that carries the mechanism has another mass, centre of mass or inertia.
  virtual void set_vehicle(const Body& vehicle) = 0;
};

}  // namespace dockloop
