// Another way to evaluate a mechanism: the same results to rounding, faster.
//
// The general code (mechanism_dynamics.hpp) stays the reference and what takes over wherever a
// kernel does not apply. A kernel finds what an integrator asks for: motion of the independent
// bodies, coordinates and rates of the joints that carry a force, and independent accelerations;
// one that serves accepted states also cut forces and loads on the base, when asked. Everything
// else of MechanismData (motion of the legs, angles that no force depends on) is left as it was:
// who needs it evaluates without a kernel (Whole). Kinds of kernels: src/kernels.
#pragma once

#include <memory>

#include "tree/tree.hpp"

namespace dockloop {

template <class S>
struct MechanismData;

class MechanismKernel {
 public:
  virtual ~MechanismKernel() = default;

  /// In: independent entries of data.tree.q. Out: entries of tree.q of joints with a force law that
  /// depends on them; tree.R, r, p of the independent bodies; tree.m_sum[0], h_sum[0] where body 0
  /// is a vehicle; data.A_ind and data.factor.
  /// @return false if the kernel cannot tell: a loop does not close or is close to singular, the
  /// assembly branch or the turn of an angle is in doubt. The general code then decides.
  virtual bool calc_position(MechanismData<double>& data) = 0;

  /// In: independent entries of data.tree.v. Out: entries of tree.v of joints with a force law;
  /// tree.w, u of the independent bodies.
  virtual void calc_velocity(const BaseMotion<double>& base, MechanismData<double>& data) = 0;

  /// In: data.tau, data.tree.external of the independent bodies. Out: data.vdot of the independent
  /// joints.
  virtual void calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) = 0;

  /// Linear momentum of all bodies on a base at rest, base axes [N s], if the kernel tells it; else
  /// it fills tree.w, u, h_body of all bodies there. @pre calc_acceleration with a gravity
  virtual bool finds_momentum() const { return false; }
  virtual Vec3<double> find_linear_momentum() const { return Vec3<double>::Zero(); }

  // What accepted states need beside, if the kernel serves them.

  /// Then calc_position also finds tree.q of all slides of legs.
  virtual bool serves_accepted_states() const { return false; }
  /// Smallest loop margin [-]. @pre calc_position
  virtual double find_margin() const { return 0.0; }
  /// As keep_reference() of loops.hpp, into data.loops.reference. @pre calc_position
  virtual void keep_reference(MechanismData<double>&) const {}
  /// As calc_reactions() of mechanism_dynamics.hpp: data.on_base, lambda of the blocks; tree.a,
  /// alpha of a vehicle. @pre calc_acceleration
  virtual void calc_reactions(const BaseMotion<double>&, MechanismData<double>&) {}
};

}  // namespace dockloop
