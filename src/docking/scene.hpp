// A resolved scene: all data of a simulation, read from resources/model.json of an FMU.
//
// `dockloop build` (scripts/dockloop/scene/resolve.py) merges a scene file, overrides and the
// mechanism file into this JSON document ("dockloop-scene/1"). A run reads no other file.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "docking/disturbance.hpp"
#include "docking/hard_dock.hpp"
#include "docking/input_history.hpp"
#include "docking/phase_limits.hpp"
#include "docking/sequence.hpp"
#include "docking/vehicle_force.hpp"
#include "math/choice.hpp"
#include "math/types.hpp"
#include "model/mechanism_model.hpp"
#include "model/vehicle_part.hpp"

namespace dockloop {

enum VehicleIndex { kChaser = 0, kTarget = 1 };
inline const char* get_vehicle_name(int vehicle) {
  return vehicle == kChaser ? "chaser" : "target";
}
/// Motion of a vehicle: integrated inside, prescribed by the host at communication points, or
/// fixed.
enum class Motion { kFree, kDriven, kFixed, kRecorded };  ///< recorded: by an input history

/// Values of model.level, from coarse to fine.
enum ModelLevel {
  kRigid = 1,         ///< the mechanism is locked at its start pose
  kMasslessLegs = 2,  ///< masses of leg parts at their ends (mechanism/massless_legs.hpp)
  kReduced = 3,       ///< every body, in the independent coordinates
  kReference = 4      ///< every body, unreduced tree with multipliers
};
inline const ChoiceList kLevels = {
    {kRigid, "rigid", "the mechanism is locked at its start pose: one body with the chaser"},
    {kMasslessLegs, "massless_legs", "masses of leg parts are moved to the ends of their legs"},
    {kReduced, "reduced", "every body"},
    {kReference, "reference", "every body, unreduced tree with multipliers; needs solver.method 9"},
};

/// Values of coupling.mode: the order of exchange with hosts of driven vehicles.
enum CouplingMode { kSequential = 1, kParallel = 2, kHostFirst = 3 };
inline const ChoiceList kCouplingModes = {
    {kSequential, "sequential",
     "this FMU steps first, then the host makes the same step with the mean load"},
    {kParallel, "parallel",
     "both step at the same time, the mean load of the coming step is announced"},
    {kHostFirst, "host_first",
     "the host makes the step with the announced mean load, then this FMU receives its motion at "
     "the "
     "end of the step"},
};

/// Values of friction.model.
inline const ChoiceList kFrictionModels = {
    {1, "regularised", "slides slowly instead of sticking"},
    {2, "bristle", "sticks"},
};

/// Parameters and initial motion of one vehicle.
struct VehicleParameters {
  double mass = 1.0;                                       ///< [kg]
  Vec6<double> inertia = Vec6<double>::Zero();             ///< xx yy zz xy xz yz about CoM [kg m2]
  Vec3<double> interface_position = Vec3<double>::Zero();  ///< origin of A in C (P in D) [m]
  Vec4<double> interface_attitude{1, 0, 0, 0};             ///< q_CA (q_DP)
  int mass_includes_mechanism = 1;                         ///< 1 excluded, 2 included
  Vec3<double> position = Vec3<double>::Zero();            ///< start: CoM in N [m]
  Vec3<double> velocity = Vec3<double>::Zero();            ///< start [m/s]
  Vec4<double> attitude{1, 0, 0, 0};                       ///< start: body to N
  Vec3<double> angular_velocity = Vec3<double>::Zero();    ///< start: body axes [rad/s]
};

/// Hull of a vehicle, for overlap only: all points within `radius` of a segment, body axes [m].
struct Hull {
  Vec3<double> from, to;
  double radius;
};

/// Displaced start of the mechanism: capture body relative to its home pose, axes of B.
struct CaptureBodyStart {
  Vec3<double> displacement = Vec3<double>::Zero();      ///< [m]
  Vec3<double> rotation_vector = Vec3<double>::Zero();   ///< [rad]
  Vec3<double> velocity = Vec3<double>::Zero();          ///< [m/s]
  Vec3<double> angular_velocity = Vec3<double>::Zero();  ///< [rad/s]
};

/// Start of one independent revolute or prismatic joint of the mechanism.
struct JointStart {
  std::string name;                ///< of the body that the joint moves
  std::optional<double> position;  ///< joint coordinate, home if not given [rad] or [m]
  double rate = 0.0;               ///< [rad/s] or [m/s]
};

/// Prescribed relative state at first contact, P with respect to A in axes of A (the IDSS table).
struct ContactConditions {
  bool given = false;
  double approach_time = 0.0;                            ///< [s] time from start to first contact
  double closing_speed = 0.0;                            ///< [m/s] along -x of A
  Vec3<double> lateral = Vec3<double>::Zero();           ///< (unused, y, z) [m]
  Vec3<double> tilt = Vec3<double>::Zero();              ///< swing (unused, y, z) [rad]
  double roll = 0.0;                                     ///< twist about x [rad]
  Vec3<double> lateral_velocity = Vec3<double>::Zero();  ///< (unused, y, z) [m/s]
  Vec3<double> angular_velocity = Vec3<double>::Zero();  ///< roll, pitch, yaw rate [rad/s]
};

/// Rated loads between ring and target; 0 = not rated.
struct RatedLoads {
  double tension = 0.0, compression = 0.0, shear = 0.0;  ///< [N]
  double bending = 0.0, torsion = 0.0;                   ///< [N m]
};

/// Value of accuracy that asks for bounded cost per step instead of a wanted error.
constexpr double kRealTime = -1.0;

struct SolverSettings {
  double rtol = 1e-6;           ///< [-]
  double atol_position = 1e-8;  ///< [m]
  double atol_velocity = 1e-8;  ///< [m/s]
  double atol_energy = 1e-7;    ///< [J]
  double step = 1e-3;           ///< [s] inner step of the fixed methods
  int method = 1;               ///< start value of solver.method (sim/solver_methods.hpp)
};

struct Experiment {
  double start = 0.0, stop = 20.0, step = 0.01, tolerance = 1e-6;  ///< [s], [-]
};

struct Scene {
  std::string name;   ///< file name of the scene, a C identifier
  std::string title;  ///< one line for people
  std::string mechanism_name;
  std::array<Motion, 2> motion{Motion::kFree, Motion::kFree};
  bool has_target = true;  ///< false: mechanism alone (no contact, no relative states)
  std::array<VehicleParameters, 2> vehicle;
  std::array<VehicleParts, 2> parts;
  std::array<std::optional<Hull>, 2> hull;
  MechanismModel mechanism;        ///< on its base B, not yet attached to the chaser
  Pose<double> base_in_interface;  ///< pose of B in A
  ContactModel contact;            ///< no pairs if the scene has no contact
  LatchSet latches;
  HardDock hard_dock;
  PhaseLimits phase_limits;  ///< follow from the surfaces where the file states none
  Sequence sequence;         ///< of the mechanism; empty if its file has none
  std::vector<Disturbance> disturbances;
  std::vector<VehicleForce> forces;  ///< between A and P; none without a target
  std::vector<InputHistory> inputs;
  RatedLoads rated;
  CaptureBodyStart capture_body_start;
  std::vector<JointStart> joint_starts;
  ContactConditions conditions;
  double contact_thrust = 0.0, contact_thrust_delay = 0.0;  ///< [N], [s]
  double restitution = 1.0, restitution_speed = 0.1;        ///< [-] at [m/s]
  SolverSettings solver;
  double accuracy = 0.0;  ///< start value of accuracy (sim/accuracy.hpp)
  Experiment experiment;
  int coupling_mode = kSequential;  ///< start value, see CouplingMode
  int level = kReduced;             ///< start value of model.level
  std::vector<std::string> groups;  ///< output groups of the FMU
  std::string fingerprint;          ///< hash of the document, 32 hex digits
  bool has_group(const std::string& group) const;
};

/// Per vehicle, the history that is its motion; -1: it has none.
std::array<int, 2> find_records(const Scene& scene);

/// Read a scene document. @throws ModelError naming the member, its value and the limit.
Scene read_scene(const std::string& json_text, const std::string& source_name);

/// Contact model of two vehicles with the same hardware; empty without contact surfaces.
struct Capture {
  ContactModel contact;
  LatchSet latches;
  Sequence sequence;
};

/// Read it from a mechanism document, by itself or under the key "mechanism"; angles in rad, or in
/// degrees where names end in _deg. @throws ModelError
Capture read_capture(const std::string& json_text, const std::string& source_name);

}  // namespace dockloop
