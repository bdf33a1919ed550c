// Rotation of one rigid body under a constant torque in body axes.
#pragma once

#include "math/types.hpp"

namespace dockloop {

/// Euler's equations by the classic Runge-Kutta method in `count` equal steps.
/// @param inertia  about the CoM [kg m2]; @param torque  body axes [N m]
/// @param h  duration, negative for back in time [s]
/// @param q, w  attitude and angular velocity (body axes), replaced by the values after h
void turn_rigid_body(const Mat3<double>& inertia, const Vec3<double>& torque, double h, int count,
                     Vec4<double>& q, Vec3<double>& w);

}  // namespace dockloop
