// The sentences of the causes that host_diagnosis.hpp finds.
#include <algorithm>
#include <cstdio>
#include <iterator>

#include "sim/host_diagnosis.hpp"

namespace dockloop {
namespace {

struct FaultText {
  int fault;
  const char*
      text;  ///< $v: vehicle, $x: value, $h: step, $s: stated mass, $m: from both, $d: delay
};
const FaultText kTexts[] = {
    {kQuaternionOrder, "$v.attitude has the order x, y, z, w: report the attitude as w, x, y, z"},
    {kQuaternionInverse,
     "$v.attitude is the attitude of N in the body: report the attitude of the body in N (the "
     "conjugate quaternion)"},
    {kQuaternionOrderInverse,
     "$v.attitude has the order x, y, z, w, and is the attitude of N in the body: report the "
     "attitude of the body in N as w, x, y, z"},
    {kAttitudeConstant,
     "$v.attitude does not change, but $v.angular_velocity is $x rad/s: connect the attitude"},
    {kSpinInDegrees, "$v.angular_velocity is in deg/s: report rad/s"},
    {kSpinInN, "$v.angular_velocity is in axes of N: report body axes"},
    {kSpinSign,
     "$v.angular_velocity has the wrong sign: report the angular velocity of the body in N"},
    {kSpinMissing,
     "$v.attitude turns at $x rad/s, but $v.angular_velocity is 0: connect the angular velocity"},
    {kAttitudeUnrelated,
     "$v.attitude does not follow $v.angular_velocity (difference $x rad/s): report attitude (w, "
     "x, y, z, body in N) and angular velocity (rad/s, body axes) of the same body and time"},
    {kFirstAttitude,
     "$v.attitude of the first step differs from the start attitude by $x rad: set the start "
     "attitude, or report it in the first step"},
    {kPositionUnit, "$v.position is in units of $x m (if $v.velocity is in m/s): report m and m/s"},
    {kPositionConstant,
     "$v.position does not change, but $v.velocity is $x m/s: connect the position"},
    {kInterfacePoint,
     "$v.position is the position of the docking interface, $x m from the centre of mass: report "
     "position and velocity of the centre of mass"},
    {kOtherPoint,
     "$v.position is the position of a point $x m or more from the centre of mass: report position "
     "and velocity of the centre of mass"},
    {kFirstPosition,
     "$v.position of the first step is $x m away from the start position: report the centre of "
     "mass in the same frame N as the start position, or set the start position"},
    {kVelocityInBody, "$v.velocity is in body axes: report axes of N"},
    {kVelocityTurned, "$v.velocity is turned by the attitude: report axes of N"},
    {kVelocityMissing, "$v.position moves at $x m/s, but $v.velocity is 0: connect the velocity"},
    {kPositionUnrelated,
     "$v.position does not follow $v.velocity (difference $x m/s): report both of the centre of "
     "mass, in N, at the same time"},
    {kEndOfStep,
     "$v.position of the first step is $x m away from the start position. This is the distance of "
     "one step: the host passes the motion at the end of the step. Pass the motion at "
     "currentCommunicationPoint, or set coupling.mode = 3 (host_first)"},
    {kFirstLoadMissing,
     "$v did not feel the first announced load ($x N over $h s): read $v.force_mean and "
     "$v.torque_mean after initialisation, before the first step"},
    {kLoadsEarly,
     "$v applies the announced load a step early: if the host makes each step after this FMU, set "
     "coupling.mode = 1; if it makes each step before this FMU, set "
     "coupling.mode = 3 (host_first)"},
    {kLoadsStepLate,
     "$v applies the mean load a step late: the host makes each step at the same time as this "
     "FMU; set coupling.mode = 2 (parallel)"},
    {kLoadsDelayed,
     "$v feels loads, or reports its motion, $x s late in all, but coupling.delay is $d s: set "
     "coupling.delay = $x, or take the delay out of the loop"},
    {kMotionAge,
     "$v reports its motion $x s late, but coupling.motion_delay is $d s: set "
     "coupling.motion_delay = $x, and coupling.delay to the delay of loads and motion together"},
    {kForceInBody, "$v applies force_mean in body axes: the force is in axes of N"},
    {kForceTurned,
     "$v applies force_mean turned by the inverse of its attitude: the force is in axes of N"},
    {kForceSign,
     "$v moves against the force ($x of the predicted change of velocity): connect "
     "$v.force_mean with its sign"},
    {kForceMissing,
     "$v does not move as predicted ($x of the predicted change of velocity): connect "
     "$v.force_mean, in N, with its sign"},
    {kForceUnit, "$v feels $x times the force: $v.force_mean is in N, or $v.mass is not in kg"},
    {kTorqueInN, "$v applies torque_mean in axes of N: the torque is in body axes"},
    {kTorqueTurned, "$v applies torque_mean turned by its attitude: the torque is in body axes"},
    {kTorqueSign,
     "$v turns against the torque ($x of the predicted turn): connect $v.torque_mean with its "
     "sign"},
    {kTorqueMissing,
     "$v does not turn as predicted ($x of the predicted turn): connect $v.torque_mean, about the "
     "centre of mass, in body axes, with its sign"},
    {kTorqueUnit, "$v feels $x times the torque: $v.torque_mean is in N m, $v.inertia in kg m2"},
    {kTorquePoint,
     "$v applies force_mean at the docking interface: apply the force at the centre of mass, "
     "because torque_mean contains its moment"},
    {kUnreportedForce,
     "$v has an unmodelled acceleration of $x m/s2 ($m N): connect 'gravity', and report every "
     "other load in $v.force_ext"},
    {kUnreportedTorque,
     "$v has an unmodelled angular acceleration of $x rad/s2: report every other torque in "
     "$v.torque_ext, about the centre of mass, in body axes"},
    {kWrongMass,
     "$v moves as if its mass were $m kg, but $v.mass is $s kg (mismatch $x); see also "
     "$v.mass_includes_mechanism"},
    {kWrongInertia,
     "$v turns as if its inertia were another than $v.inertia (mismatch $x about the worst axis)"},
    {kUnexplained,
     "$v does not move as a rigid body under the reported loads ($x of the changes of velocity): "
     "a flexible part, a load that is not in $v.force_ext, or a mean load that is filtered or "
     "limited"},
    {kStartOfStep,
     "$v.position after the first step is the start position, but the vehicle moves $x m in the "
     "step: report the motion at the end of the step, or set coupling.mode = 2 (parallel) or 1 "
     "(sequential)"},
    {kWrongCentre,
     "$v moves as if its centre of mass were $x m from $v.position: report position and velocity "
     "of the centre of mass, and apply force_mean and torque_mean there"},
    {kFlexiblePart,
     "$v has a flexible part, which swings at $x Hz, or at a multiple if a step has half or whole "
     "periods of the part: put a part that carries the docking hardware into the FMU ([$v.adapter] "
     "of the scene); of arrays or slosh, report the vehicle without them, and their mean loads in "
     "$v.force_ext and $v.torque_ext"},
    {kPositionAxes,
     "$v.position has the axes of N exchanged or reversed: report the axes in which the start "
     "position is stated"},
    {kForceAxes,
     "$v applies force_mean with axes exchanged or reversed: its components are along x, y, z of "
     "N"},
    {kTorqueAxes,
     "$v applies torque_mean with axes exchanged or reversed: its components are along x, y, z of "
     "the body, as those of $v.inertia"},
    {kMotionHeld,
     "$v reports a new motion only every $x s: make the communication step as long as the step of "
     "the host, or report the motion at each step"},
    {kVelocityUnit, "$v.velocity is in units of $x m/s: report m/s"},
    {kFirstVelocity,
     "$v.velocity of the first step differs from the start velocity by $x m/s: set the start "
     "velocity, or report it in the first step"},
};

}  // namespace

std::string describe_finding(const HostFinding& found, const char* vehicle, double h, double mass,
                             double delay) {
  const auto row = std::find_if(std::begin(kTexts), std::end(kTexts),
                                [&](const FaultText& t) { return t.fault == found.fault; });
  const auto number = [](double x, int digits = 3) {
    char text[32];
    std::snprintf(text, sizeof text, "%.*g", digits, x);
    return std::string(text);
  };
  std::string text;
  for (const char* c = row->text; *c; ++c) {
    if (*c != '$') {
      text += *c;
      continue;
    }
    switch (*++c) {
      case 'v':
        text += vehicle;
        break;
      case 'h':
        text += number(h);
        break;
      case 'd':
        text += number(delay);
        break;
      case 's':
        text += number(mass, 6);
        break;
      case 'm':
        text += found.fault == kWrongMass ? number(mass * (1.0 + found.value), 6)
                                          : number(mass * found.value);
        break;
      default:
        text += number(found.value);
    }
  }
  return text;
}

}  // namespace dockloop
