// Effect of a jump of the vehicle on the mechanism.
//
// A host that integrates a vehicle reports a motion that differs from the prediction. The
// coordinates of the mechanism are relative to the vehicle and must be corrected:
//
//   velocity   as by an impulse on the vehicle: joints are free, so loose bodies keep their
//   momentum
//              and guided bodies move with the vehicle
//   pose       a capture body in contact keeps its place on the target, because a micrometre
//   changes
//              a stiff contact force; all other bodies move with the vehicle
#pragma once

#include <array>

#include "docking/docking_model.hpp"

namespace dockloop {

/// Scratch, sized once.
struct BaseJumpWorkspace {
  explicit BaseJumpWorkspace(const DockingModel& model);
  MatX<double> A_qq, J_T, X;  ///< n x n, n x 6, n x 6 for n coordinates of the mechanism
  SmallCholesky factor;
  VecX<double> dq;                 ///< n
  std::array<VecX<double>, 2> dv;  ///< all independent velocities of each vehicle
};

/// Give a vehicle, with what moves on it, a momentum (axes of O, about O) by one impulse on the
/// vehicle: A [dV; dv_q] = [J; 0].
/// @param before  motion of the vehicle to which velocities in y are relative; v and w
/// @pre its pose is in y. @post momentum and velocities of mechanism and parts in y
Status jump_to_momentum(const DockingModel& model, int vehicle, const FrameMotion<double>& before,
                        const Wrench<double>& momentum, double* y, DockingData<double>& data,
                        BaseJumpWorkspace& work);

/// After a change of vehicle poses in y: move the capture body to a pose, as far as the mechanism
/// allows, by the motion of least kinetic energy. No effect for a distance of more than 20 mm.
/// @param capture  wanted pose of G in O. @post coordinates of the mechanism in y
Status hold_capture_body(const DockingModel& model, const Pose<double>& capture, double* y,
                         DockingData<double>& data, BaseJumpWorkspace& work);

}  // namespace dockloop
