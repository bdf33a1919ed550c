// Which mistake of a host explains what the host reports of its vehicle?
//
// Arithmetic demands four things. The first report is the start state. The position follows the
// velocity. The attitude follows the angular velocity. Changes of velocity follow the loads that
// the host received. Where reports break such a rule, alternatives are tried on the same reports,
// as "the quaternion is in the order x, y, z, w". The alternative that explains the error is the
// diagnosis.
//
// Rules of motion come before rules of loads, because a wrong attitude also looks like a wrong
// load. A vehicle has one diagnosis: later errors may be consequences of the first cause.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "math/choice.hpp"
#include "sim/host_mode.hpp"
#include "sim/mean_load.hpp"
#include "sim/values.hpp"

namespace dockloop {

constexpr int kLateLoads = 24;        ///< longest delay that is recognised, in steps
constexpr double kFirstAngle = 1e-3;  ///< from the start attitude: a mistake [rad]

/// Values of `coupling.diagnosis`.
enum HostFault {
  kHostRight = 1,
  kQuaternionOrder,
  kQuaternionInverse,
  kQuaternionOrderInverse,
  kAttitudeConstant,
  kSpinInDegrees,
  kSpinInN,
  kSpinSign,
  kSpinMissing,
  kAttitudeUnrelated,
  kFirstAttitude,
  kPositionUnit,
  kPositionConstant,
  kInterfacePoint,
  kOtherPoint,
  kFirstPosition,
  kVelocityInBody,
  kVelocityTurned,
  kVelocityMissing,
  kPositionUnrelated,
  kEndOfStep,
  kFirstLoadMissing,
  kLoadsEarly,
  kLoadsStepLate,
  kLoadsDelayed,
  kForceInBody,
  kForceTurned,
  kForceSign,
  kForceMissing,
  kForceUnit,
  kTorqueInN,
  kTorqueTurned,
  kTorqueSign,
  kTorqueMissing,
  kTorqueUnit,
  kTorquePoint,
  kUnreportedForce,
  kUnreportedTorque,
  kWrongMass,
  kWrongInertia,
  kUnexplained,
  kStartOfStep,
  kMotionAge,
  kWrongCentre,
  kFlexiblePart,
  kPositionAxes,
  kForceAxes,
  kTorqueAxes,
  kMotionHeld,
  kVelocityUnit,
  kFirstVelocity
};
/// The meanings include those of `coupling.diagnosis_value`.
inline const ChoiceList kHostFaults = {
    {kHostRight, "none", "reports fit"},
    {kQuaternionOrder, "quaternion order", "attitude has the order x, y, z, w"},
    {kQuaternionInverse, "quaternion inverse", "attitude of N in the body"},
    {kQuaternionOrderInverse, "quaternion order and inverse", "both of these"},
    {kAttitudeConstant, "attitude constant", "despite an angular velocity; value in rad/s"},
    {kSpinInDegrees, "angular velocity in degrees", "in deg/s"},
    {kSpinInN, "angular velocity in N", "in axes of N, not of the body"},
    {kSpinSign, "angular velocity sign", "of N in the body"},
    {kSpinMissing, "angular velocity missing", "the attitude turns; value in rad/s"},
    {kAttitudeUnrelated, "attitude", "does not follow angular_velocity; value in rad/s"},
    {kFirstAttitude, "first attitude", "not the start attitude; value in rad"},
    {kPositionUnit, "position unit", "value: its unit in m, if velocity is in m/s"},
    {kPositionConstant, "position constant", "despite a velocity; value in m/s"},
    {kInterfacePoint, "interface point", "position of the docking interface; value in m"},
    {kOtherPoint, "other point", "position of another point of the vehicle; value in m"},
    {kFirstPosition, "first position", "not the start position; value in m"},
    {kVelocityInBody, "velocity in body axes", "not in axes of N"},
    {kVelocityTurned, "velocity turned", "by the attitude"},
    {kVelocityMissing, "velocity missing", "the position moves; value in m/s"},
    {kPositionUnrelated, "position", "does not follow velocity; value in m/s"},
    {kEndOfStep, "end of step", "the first report is the motion at the end of the step"},
    {kFirstLoadMissing, "first load", "the first announced load was not applied; value in N"},
    {kLoadsEarly, "loads early", "the host applies the load of the coming step; value in s"},
    {kLoadsStepLate, "loads late", "the host makes each step with the FMU; value in s"},
    {kLoadsDelayed, "delay", "loads act late or the motion is old; value in s"},
    {kForceInBody, "force in body axes", "force_mean is in axes of N"},
    {kForceTurned, "force turned", "by the inverse of the attitude"},
    {kForceSign, "force sign", "force_mean acts with the other sign"},
    {kForceMissing, "force missing", "force_mean does not act; value: share that acts"},
    {kForceUnit, "force unit", "value: force that acts, in units of force_mean"},
    {kTorqueInN, "torque in N", "torque_mean is in body axes"},
    {kTorqueTurned, "torque turned", "by the attitude"},
    {kTorqueSign, "torque sign", "torque_mean acts with the other sign"},
    {kTorqueMissing, "torque missing", "torque_mean does not act; value: share that acts"},
    {kTorqueUnit, "torque unit", "value: torque that acts, in units of torque_mean"},
    {kTorquePoint, "torque point", "force_mean acts at the docking interface"},
    {kUnreportedForce, "unreported force", "not in gravity, not in force_ext; value in m/s2"},
    {kUnreportedTorque, "unreported torque", "not in torque_ext; value in rad/s2"},
    {kWrongMass, "mass", "value: true mass / stated mass - 1"},
    {kWrongInertia, "inertia", "value: true / stated inertia - 1 of the worst axis"},
    {kUnexplained, "unexplained", "by any other cause; value: part of changes of velocity"},
    {kStartOfStep, "start of step", "coupling.mode 3, but the motion at the start of the step"},
    {kMotionAge, "age of motion", "not coupling.motion_delay; value in s"},
    {kWrongCentre, "centre of mass", "value: its distance from the reported position in m"},
    {kFlexiblePart, "flexible part", "one mode explains the reports; value: its frequency in Hz"},
    {kPositionAxes, "position axes", "those of N, but exchanged or reversed"},
    {kForceAxes, "force axes", "force_mean acts with its axes exchanged or reversed"},
    {kTorqueAxes, "torque axes", "torque_mean acts with its axes exchanged or reversed"},
    {kMotionHeld, "motion held", "over several steps of the FMU; value: step of the host in s"},
    {kVelocityUnit, "velocity unit", "value: its unit in m/s"},
    {kFirstVelocity, "first velocity", "not the start velocity; value in m/s"},
};

struct HostFinding {
  int fault = kHostRight;   ///< see HostFault
  double value = 0.0;       ///< see kHostFaults
  double deflection = 0.0;  ///< of a flexible part, see HostMode [s2]
};

/// The sentence of a finding. @param h  last step [s]; @param mass, delay  stated [kg], [s]
std::string describe_finding(const HostFinding& found, const char* vehicle, double h, double mass,
                             double delay);

struct ReportSums;
/// Why does the coupling create energy? For a sentence.
std::string describe_energy_cause(const HostFinding& found, const ReportSums& sums,
                                  const char* vehicle);

/// Errors that are left if the load of another step acts.
struct LateSums {
  double left2 = 0.0;
  double product = 0.0;  ///< with those of the load one step nearer to the present
};

/// Changes of velocity (of angular velocity) and loads, of one vehicle: sums over its reports.
struct ResponseSums {
  std::array<double, 3> left2{};  ///< errors that are left if the load acts in another way
  std::vector<LateSums> late;     ///< loads of earlier steps, the last one first; of coming steps
  double change2 = 0.0;           ///< predicted changes
  Mat3<double> axis_change2 = Mat3<double>::Zero();  ///< predicted changes by themselves
  Mat3<double> axis_product = Mat3<double>::Zero();  ///< errors by predicted changes
  double product = 0.0;                              ///< errors times predicted changes
  double error2 = 0.0;
  Vec3<double> constant = Vec3<double>::Zero();  ///< errors times steps
  double time2 = 0.0;                            ///< of steps [s2]
  int loaded = 0;  ///< steps with a change that can be seen; the other sums are over these steps
};

/// Sums over the reports of one vehicle; old reports fade out. An array has one entry for each
/// reading of the reports (host_diagnosis.cpp).
struct ReportSums {
  std::array<double, 7> turn_error2{};               ///< attitude and angular velocity [rad2/s2]
  double turn2 = 0.0;                                ///< [rad2/s2]
  Mat3<double> spin_matrix = Mat3<double>::Zero();   ///< products of angular velocities ...
  Mat3<double> turn_product = Mat3<double>::Zero();  ///< ... and of turns with them [rad2/s2]
  int turn_doubts = 0;                  ///< as below, also where a change may explain the error
  int turn_errors = 0;                  ///< consecutive reports with an error
  double first_angle = 0.0;             ///< between first attitude and start attitude [rad]
  std::array<double, 4> move_error2{};  ///< position and velocity [m2/s2]
  Mat3<double> point_matrix = Mat3<double>::Zero();  ///< equations of a point of the vehicle ...
  Vec3<double> point_side = Vec3<double>::Zero();    ///< ... whose position is reported
  double move2 = 0.0, move_velocity = 0.0, velocity2 = 0.0;  ///< [m2/s2]
  int move_errors = 0;                                       ///< consecutive, too
  int unchanged = 0;                                         ///< reports since the last new motion
  int held_reports = 0;  ///< motions that were reported several times, although the vehicle moves
  ResponseSums force, torque;  ///< [m2/s2], [rad2/s2]
  double first_load = 0.0;     ///< the first announced load, if it did not act [N]
  int unmodelled = 0;          ///< consecutive steps with an error that no load explains
  double unmodelled_time = 0.0, unmodelled_sum2 = 0.0;  ///< of these steps [s], [m2/s4]
  Vec3<double> unmodelled_sum = Vec3<double>::Zero();   ///< of their accelerations [m/s2]
  ModeSums mode;
  std::vector<Wrench<double>> held;  ///< by earlier steps, the last one first
};
/// Sums at the start. Later steps allocate nothing. @param is_delayed  loads are under way
ReportSums make_report_sums(bool is_delayed);

/// Forget how velocities followed loads: another mass is stated.
void forget_responses(ReportSums& sums);

/// First report of a vehicle. @param start  in N; @param h  step that begins there [s]
HostFinding judge_first_report(const Inputs::Vehicle& report, const Inputs::Vehicle& start,
                               const Vec3<double>& interface_position, double h, ReportSums& sums);

/// Two reports of a vehicle and the step between them.
struct ReportPair {
  const Inputs::Vehicle& begin;
  const Inputs::Vehicle& end;
  double h;                                ///< [s]
  double change;                           ///< of velocity, gravity apart [m/s]
  double speed;                            ///< in frame O, which moves with the docking [m/s]
  const Vec3<double>& interface_position;  ///< body axes [m]
};

/// Does the pose follow the rates? @param keep  factor of older sums
HostFinding judge_motion(const ReportPair& pair, double keep, ReportSums& sums);

/// Is a report that does not change older than any delay? @param delay  stated [s]
HostFinding judge_unchanged(const ReportPair& pair, double delay, ReportSums& sums);

/// What a vehicle did over a step with a load of its host.
struct LoadStep {
  double h = 0.0, mass = 0.0;  ///< [s], stated [kg]
  Mat3<double> inertia;        ///< stated, about the centre of mass [kg m2]
  double radius = 0.0;         ///< of gyration, stated [m]
  Mat3<double> R;              ///< body to N
  Vec3<double> arm;            ///< of the docking interface, body axes [m]
  bool announces = false;      ///< `next` are loads of coming steps
  bool is_host_first = false;  ///< then `next` is `held`
  double delay = 0.0;          ///< as stated [s]
  double shorter = 0.0;        ///< the same in whole steps; `next` act with shorter delays [s]
  double longer = 0.0;         ///< the same; `earlier` act with longer delays [s]
  Wrench<double> held;         ///< force in N, torque in body axes
  std::array<Wrench<double>, kLateLoads> next;     ///< of later steps, the next one first
  std::array<Wrench<double>, kLateLoads> earlier;  ///< of earlier steps, with a stated delay
  int next_count = 1;
  Vec3<double> change;               ///< of velocity as predicted, gravity apart [m/s]
  Vec3<double> error, turn_error;    ///< received minus predicted
  Vec3<double> offset, turn_offset;  ///< the same of position and attitude [m], [rad]
  double rounding = 0.0;             ///< changes of velocity that are ignored [m/s]
  double gravity = 0.0;              ///< [m/s2]
};

/// Do changes of velocity follow loads? @param keep  factor of older sums
HostFinding judge_loads(const LoadStep& step, double keep, ReportSums& sums);

/// Does a flexible mode explain the responses to loads? @param h  last step [s]; @param fits  a
/// rigid body of another mass explains the velocities: then positions decide
HostFinding explain_by_mode(double h, bool fits, const ReportSums& sums);

/// True / stated mass - 1; 0 without an estimate.
double find_mass_mismatch(const ReportSums& sums);
/// Is the stated mass right within a tenth, and does it explain the motion?
bool is_mass_confirmed(const ReportSums& sums);

}  // namespace dockloop
