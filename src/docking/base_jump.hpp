// What a jump of the vehicle does to the mechanism on it.
//
// A host that moves a vehicle by itself may find it elsewhere than the equations had it. Then the
// mechanism, whose coordinates are relative to the vehicle, is referred to the new motion:
//
//   velocity   as by an impulse on the vehicle: the joints are free, so loose bodies keep their
//              momentum and guided ones are taken along
//   pose       a capture body that is in contact stays where it is on the target, for a stiff
//              contact would feel a micrometre; everything else goes with the vehicle
#pragma once

#include "docking/docking_model.hpp"

namespace dockloop {

/// Scratch, sized once.
struct BaseJumpWorkspace {
  explicit BaseJumpWorkspace(const Mechanism& mechanism);
  MatX<double> A_qq, J_T, X;  ///< n x n, n x 6, n x 6 for n coordinates of the mechanism
  Eigen::LLT<MatX<double>> factor;
  VecX<double> dq, dv;  ///< n; all independent velocities
};

/// Give the chaser, with the mechanism on it, a momentum (axes of O, about O) by one impulse on the
/// vehicle: A [dV; dv_q] = [J; 0].
/// @param before  motion of the vehicle that mechanism velocities in y are relative to; v and w
/// @pre its pose is in y. @post momentum and mechanism velocities in y
Status jump_to_momentum(const DockingModel& model, const FrameMotion<double>& before,
                        const Wrench<double>& momentum, double* y, DockingData<double>& data,
                        BaseJumpWorkspace& work);

/// After a change of vehicle poses in y: bring the capture body to a pose, as far as the mechanism
/// can, by the motion of least kinetic energy. Nothing happens for a way of more than 20 mm.
/// @param capture  wanted pose of G in O. @post coordinates of the mechanism in y
Status hold_capture_body(const DockingModel& model, const Pose<double>& capture, double* y,
                         DockingData<double>& data, BaseJumpWorkspace& work);

}  // namespace dockloop
