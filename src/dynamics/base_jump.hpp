// What a jump of the vehicle does to the mechanism on it.
//
// A host that moves a vehicle by itself may find it elsewhere than the equations had it. Then the
// mechanism, whose coordinates are relative to the vehicle, is referred to the new motion:
//
//   velocity   as by an impulse on the vehicle: the joints are free, so loose bodies keep their
//              momentum and guided ones are taken along, v_q -= inv(A_qq) A_qb dV
//   pose       a capture body that is in contact stays where it is on the target, for a stiff
//              contact would feel a micrometre; everything else goes with the vehicle
#pragma once

#include "dynamics/docking_model.hpp"

namespace dockloop {

/// Scratch, sized once.
struct BaseJumpWorkspace {
  explicit BaseJumpWorkspace(const Mechanism& mechanism);
  MatX<double> A_qq, J_T, X;  ///< n x n, n x 6, n x 6 for n coordinates of the mechanism
  Eigen::LLT<MatX<double>> factor;
  VecX<double> dq, dv;
};

/// Give a vehicle a velocity (axes of O) and an angular velocity (body axes).
/// @param before  its motion of which mechanism velocities in y are relative; R is not read
/// @pre its pose is in y. @post y, data.mechanism (chaser) or data.vehicle (target)
Status jump_to_velocity(const DockingModel& model, int vehicle, const FrameMotion<double>& before,
                        const Vec3<double>& velocity, const Vec3<double>& angular_velocity,
                        double* y, DockingData<double>& data, BaseJumpWorkspace& work);

/// After a change of vehicle poses in y: bring the capture body to a pose, as far as the mechanism
/// can, by the motion of least kinetic energy. Nothing happens for a way of more than 20 mm.
/// @param capture  wanted pose of G in O. @post coordinates of the mechanism in y
Status hold_capture_body(const DockingModel& model, const Pose<double>& capture, double* y,
                         DockingData<double>& data, BaseJumpWorkspace& work);

}  // namespace dockloop
