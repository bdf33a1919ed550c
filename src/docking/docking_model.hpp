// Two vehicles, a mechanism between them, contact and latches: one system of ordinary equations.
//
// Frame O is where everything is computed: axes of the inertial frame N, origin near the docking.
// When both vehicles can move it falls and drifts with them, so orbital positions and speeds never
// enter; gravity then drops out exactly.
//
// State y (StateLayout): for each moving vehicle its pose and, instead of a velocity, the linear
// and angular momentum (about the origin of O) of everything that moves with it, mechanism
// included; for the mechanism its independent coordinates and velocities relative to the vehicle;
// bristles (elastic states of friction) of contacts and of brakes; dissipated energies and impulses
// of external loads.
// Rates of the momenta are plain sums of forces, which Runge-Kutta methods add up without error:
// momentum balances to rounding at any tolerance. The vehicle's velocity follows from its momentum
// with the factor of the reduced inertia that the accelerations need anyway.
//
// Vehicles that are not rigid have parts (model/vehicle_part.hpp). Those of the chaser are bodies
// of the mechanism's tree, and its adapter carries the mechanism. A target with parts is a tree by
// itself. States and equations of both are the same.
//
// Two right-hand sides: the mechanism moves, or it is locked (LockedMechanism, of DockingData).
// Chaser and locked mechanism are one rigid body. Loops and inertia are not evaluated, and the
// states of the mechanism rest. Locked or not is a property of an evaluation, not of the model.
// While a rigid joint (docking/hard_dock.hpp) holds the target, it is a part of that body: its
// motion follows from the sum of both momenta, and rates need neither contact nor forces of joints.
#pragma once

#include <array>
#include <optional>

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "docking/hard_dock.hpp"
#include "docking/scene.hpp"
#include "docking/sequence.hpp"
#include "mechanism/element_forces.hpp"
#include "mechanism/joint_forces.hpp"
#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// Dissipated energies and other sums that are integrated with the state. Brakes and drives only if
/// there are force elements or a hard dock, that of the hard dock only with one. Where forces act
/// between the vehicles, one more is the last.
enum Sum {
  kSumContact,
  kSumFriction,
  kSumLegs,
  kSumLatches,
  kSumExternal,
  kSumCount,
  kSumBrakes = kSumCount,
  kSumDrives,
  kSumCountWithElements,
  kSumHardDock = kSumCountWithElements,
  kSumCountWithHardDock
};

int count_sums(const MechanismModel& mechanism, const HardDock& dock,
               const std::vector<VehicleForce>& forces);

/// Where things are in y; -1 = not there.
struct StateLayout {
  int mechanism_q = 0, mechanism_v = 0;          ///< independent coordinates, velocities
  int mechanism_nq = 0, mechanism_nv = 0;        ///< without the vehicle's own
  int target_q = 0, target_v = 0, target_n = 0;  ///< of parts of the target
  std::array<int, 2> pose{-1, -1};               ///< position (3) and quaternion (4) of a vehicle
  std::array<int, 2> momentum{-1, -1};           ///< linear (3) and angular about O (3)
  int bristles = 0, bristle_count = 0;           ///< of contact pairs
  int element_bristles = 0, element_bristle_count = 0;  ///< of brakes; just before `bristles`
  int sums = 0, sum_count = kSumCount;                  ///< energies [J]
  int force_sums = 0;  ///< of them, at the end: 1 with forces between the vehicles, else 0
  int impulse = 0;     ///< external impulse (3), external angular impulse about O (3)
  std::array<int, 2> host_impulse{-1, -1};  ///< impulses (6) of what the host of a driven vehicle
                                            ///< applies to it by itself: known loads, gravity
  int size = 0;
  bool has_element_sums() const { return sum_count - force_sums > kSumCount; }
  bool has_hard_dock_sum() const { return sum_count - force_sums > kSumCountWithElements; }
  bool has_force_sum() const { return force_sums > 0; }
  int force_sum() const { return sum_count - 1; }  ///< its place among the sums
};

/// A mechanism that is held still relative to its vehicle: with it, it is one rigid body, and
/// evaluations need nothing else of it. Axes and origin of the chaser.
struct LockedMechanism {
  VehicleBody mechanism;                     ///< all bodies but the chaser
  VehicleBody parts;                         ///< those of them that are parts of the chaser
  VehicleBody whole;                         ///< chaser (if it moves) and mechanism
  Pose<double> capture;                      ///< G
  std::vector<Pose<double>> contact_bodies;  ///< as in MechanismModel
  Pose<double> carrier;                      ///< body on which the mechanism stands
  VecX<double> q;                            ///< all coordinates, where they are held
  // With a rigid joint only
  bool has_target = false;
  Pose<double> target_pose;  ///< D
  VehicleBody target;        ///< the target
  VehicleBody joined;        ///< `whole` and the target
};

/// Elements and couplings that act along a leg together with its own joint force.
struct LegLoads {
  struct Term {
    int index;  ///< of the element or loop
    double factor;
  };
  std::vector<Term> elements, couplings;
};

/// Everything that does not change during a run. A simulation replaces its model by a changed copy
/// for other tunable parameters (thrust, contact law) and for other independent coordinates.
struct DockingModel {
  explicit DockingModel(Mechanism attached) : mechanism(std::move(attached)) {}
  Mechanism mechanism;  ///< on the chaser (or on the immobile base), with parts of the chaser
  std::optional<Mechanism> target;  ///< the target and its parts, if it has parts
  std::array<bool, 2> present{true, true};
  std::array<bool, 2> moves{true, true};
  std::array<bool, 2> driven{false, false};  ///< a host prescribes the motion at communication
                                             ///< points; between them the equations move it
  std::array<int, 2> record{-1, -1};   ///< the input history that prescribes the motion; -1: none
  std::array<VehicleBody, 2> of_host;  ///< vehicles as their hosts integrate them: as stated, or as
                                       ///< identified (sim/host_identification.hpp)
  std::array<Pose<double>, 2> fixed_pose;      ///< in O, of a vehicle that does not move
  std::array<Pose<double>, 2> interface_pose;  ///< A in C, P in D; coordinates of adapters at zero
  std::array<Pose<double>, 2> interface_on_carrier;  ///< A, P in adapter or vehicle
  std::array<VehicleBody, 2> vehicle;                ///< bare vehicles
  VehicleBody frozen;                                ///< stated less bare chaser, axes of C. If the
                       ///< stated mass includes the mechanism: this one at
                       ///< home. Else minus the feet of massless legs
  Pose<double> base_on_carrier;       ///< B in adapter or chaser
  Pose<double> capture_in_body;       ///< G in axes of the capture body
  std::vector<int> mechanism_bodies;  ///< independent bodies without the vehicle
  std::vector<LegLoads> leg_loads;    ///< per leg
  ContactModel contact;
  LatchSet latches;
  HardDock hard_dock;
  std::vector<VehicleForce> forces;  ///< at most kMaxVehicleForces
  PhaseLimits phase_limits;
  std::array<std::optional<Hull>, 2> hull;
  Sequence sequence;                        ///< empty: phases follow from motion and latches
  std::vector<Disturbance> disturbances;    ///< at most kMaxDisturbances
  std::vector<InputHistory> inputs;         ///< at most kMaxInputHistories
  double thrust = 0.0, thrust_delay = 0.0;  ///< [N] along x of A at the CoM, [s]
  bool falling = true;                      ///< O falls with gravity
  StateLayout layout;
  bool has_record() const { return record[kChaser] >= 0 || record[kTarget] >= 0; }
  /// Does anything act between A and P, not G and P?
  bool acts_across() const { return !hard_dock.empty() || !forces.empty(); }
};

/// What changes at events and at accepted states only, never inside a step of the integrator.
struct DiscreteState {
  std::array<LatchState, kMaxLatches> latch;
  bool contacted = false;         ///< first contact has happened
  bool captured = false;          ///< all latches hold, or the sequence states a grasp
  double time_of_contact = -1.0;  ///< [s] since start
  double time_of_capture = -1.0;  ///< [s] since start
  bool thrust_on = false;
  int phase = 1, outcome = 1;
  bool seated = false;       ///< every striker is as deep as a catch needs, not all are caught
  double seated_time = 0.0;  ///< [s] for which that was so
  double seen = 0.0;         ///< time of the last accepted state [s since start]
  SequenceState sequence;
  std::vector<LawSetting> law;     ///< of all elements; empty without a sequence
  std::vector<LateSettings> late;  ///< per failure of the file, for one that delays; as `law`
  std::vector<ElementLock> lock;   ///< per element; empty without a sequence
  std::vector<double> entered;  ///< per step of the sequence: first time [s since the start], or -1
  int disturbances = 0;         ///< bit k: disturbance k acts
  std::vector<int> input_row;   ///< per input history: see find_row()
  HardDockState hard_dock;
};

/// Loads from outside, held over a step.
template <class S>
struct ExternalLoads {
  std::array<Vec3<S>, 2> force{Vec3<S>::Zero(), Vec3<S>::Zero()};   ///< at the CoM, N axes [N]
  std::array<Vec3<S>, 2> torque{Vec3<S>::Zero(), Vec3<S>::Zero()};  ///< body axes [N m]
  Vec3<S> gravity = Vec3<S>::Zero();                                ///< in N axes [m/s2]
  VecX<S> command;  ///< per joint force [N], then per force element (see count_commands)
};
using Loads = ExternalLoads<double>;

/// Motion of a frame in O, axes of O.
template <class S>
struct FrameMotion {
  Mat3<S> R = Mat3<S>::Identity();
  Vec3<S> p = Vec3<S>::Zero(), w = Vec3<S>::Zero(), v = Vec3<S>::Zero();
};

/// Motion of a vehicle that a record prescribes, axes of O.
template <class S>
struct RecordedMotion {
  FrameMotion<S> frame;
  Vec4<S> attitude{S(1), S(0), S(0), S(0)};
  Vec3<S> a = Vec3<S>::Zero(), alpha = Vec3<S>::Zero();
};

/// Motion and forces of a target with parts.
template <class S>
struct TargetData {
  explicit TargetData(const Mechanism& target);
  MechanismData<S> mechanism;
  VecX<S> no_command, joint_force;  ///< per coordinate of a part [N] or [N m]
};

/// Everything computed by calc_docking().
template <class S>
struct DockingData {
  explicit DockingData(const DockingModel& model);
  const LockedMechanism* locked = nullptr;  ///< set by the caller; null: the mechanism moves
  MechanismData<S> mechanism;
  std::optional<TargetData<S>> target;  ///< if the model has it
  BaseMotion<S> base;
  std::array<FrameMotion<S>, 2> vehicle;       ///< CoM frames C, D
  std::array<FrameMotion<S>, 2> carrier;       ///< adapters, or again C, D
  std::array<FrameMotion<S>, 2> interface;     ///< A, P
  FrameMotion<S> capture;                      ///< G
  std::vector<FrameMotion<S>> contact_bodies;  ///< others with active cores, see ContactModel
  HardwareMotion<S> relative;                  ///< P relative to G and to them
  RelativeMotion<S> across;                    ///< P relative to A, where something acts across
  ContactWorkspace<S> contact_work;
  ContactResult<S> contact;
  LatchResult<S> latch;
  Wrench<S> on_passive;  ///< contact and latches, about G, axes of O
  Wrench<S> by_capture;  ///< the part of it that acts between P and G
  HardDockResult<S> hard_dock;
  VehicleForceLoad<S> forces;  ///< between the vehicles
  Wrench<S> on_target;         ///< hard dock and forces, or rigid joint, about A, axes of O
  Wrench<S> on_chaser;         ///< of bodies on the chaser, about its origin, axes of O
  JointForceSums<S> joints;
  ElementData<S> elements;
  VecX<S> command;                            ///< as in ExternalLoads
  VecX<S> joint_force;                        ///< per joint force [N]
  VecX<S> bristle_rate;                       ///< scratch where no rates are wanted
  bool touches = true;                        ///< false: as if nothing acted between the vehicles
  Vec3<S> thrust = Vec3<S>::Zero();           ///< on the chaser's CoM, axes of O
  std::array<RecordedMotion<S>, 2> recorded;  ///< of vehicles with a record
  std::array<Wrench<S>, 2> record_load;  ///< from outside, that keeps the vehicle on its record,
                                         ///< about its origin, axes of O
};

/// Size of ExternalLoads::command.
inline int count_commands(const MechanismModel& mechanism) {
  return static_cast<int>(mechanism.forces.size() + mechanism.elements.size());
}

DockingModel make_docking_model(const Scene& scene,
                                const std::array<VehicleParameters, 2>& parameters,
                                const ContactLaw& law, const Vec3<double>& origin_of_O,
                                int level = kReduced);

/// Does the structured matrix (docking/structured_matrix.hpp) not know this model? Bristles couple
/// all points of contact; a hard dock on an adapter and parts of the target move P and A; vehicles
/// with a record have no states.
bool needs_other_matrix(const DockingModel& model);

/// Hold the mechanism where it is. With data.locked its coordinates and velocities in y are not
/// read, and their rates are zero.
/// @pre the poses of mechanism, chaser and capture body are those to hold, and the mechanism is at
/// rest. @post data.locked == &locked
void lock_mechanism(const DockingModel& model, DockingData<double>& data, LockedMechanism& locked);

/// Chaser, mechanism and target as one rigid body in their present poses. Axes and origin of the
/// chaser. Finds the bodies of legs. @pre calc_docking; both vehicles move
VehicleBody find_stack(const DockingModel& model, DockingData<double>& data);

/// Join the target to the locked mechanism, or release it. @pre lock_mechanism
void join_target(const DockingModel& model, const RigidJoint& joint, LockedMechanism& locked);

/// A rigid joint moves the target with the chaser: pose and momentum of the target into the state;
/// the chaser keeps the rest of the momentum of both.
/// @param chaser  its motion
void put_joined_target(const DockingModel& model, const LockedMechanism& locked,
                       const FrameMotion<double>& chaser, double* y);

/// A vehicle as its host integrates it, less what the model has in other bodies.
/// @param frozen  of the model, for the chaser; none for the target
VehicleBody find_bare_vehicle(const VehicleBody& of_host, const VehicleBody& frozen);

/// The host integrates another body. Allocates nothing. @pre without parts, a target has its centre
/// of mass in its origin
void set_host_body(DockingModel& model, int vehicle, const VehicleBody& of_host);

/// Put a mechanism in other independent coordinates into the model (the same bodies and loops).
void set_mechanism(DockingModel& model, const Mechanism& mechanism);

/// Mechanism coordinates and velocities from the tree into the state.
void get_mechanism_state(const DockingModel& model, const TreeData<double>& tree, double* y);

/// Kinematics, forces and (if ydot is not null) rates at one state.
/// @param t  [s] since start
/// @param need  Need::kRates: ydot and what event functions read; else also all of the functions
/// below
template <class S>
Status calc_docking(const DockingModel& model, const DiscreteState& discrete,
                    const ContactMemory& memory, const ExternalLoads<S>& loads, S t, const S* y,
                    S* ydot, DockingData<S>& data, Need need = Need::kState);

// The parts of calc_docking(), for callers that find the motion of the tree in another way.

/// Independent coordinates and velocities of the mechanism from the state into the tree; chaser
/// pose with them.
template <class S>
void put_mechanism_state(const DockingModel& model, const S* y, TreeData<S>& tree);

/// Vehicles, interfaces, capture body. @pre calc_tree_velocity
template <class S>
void calc_frames(const DockingModel& model, const S* y, DockingData<S>& data);

/// Contact and latches, and all loads on the bodies and joints of the tree. @pre calc_frames
/// @param ydot  rates of bristles; may be null
template <class S>
Status calc_loads(const DockingModel& model, const DiscreteState& discrete,
                  const ContactMemory& memory, const ExternalLoads<S>& loads, S t, const S* y,
                  S* ydot, DockingData<S>& data);

/// Rates of the coordinates of one body of the tree that moves with velocities v.
template <class S>
void calc_coordinate_rates(const Body& body, const VecX<S>& q, const VecX<S>& v, S* qdot);

/// Rates of all but the mechanism and bristles: vehicles and sums. @pre calc_loads; cut forces,
/// where a joint is driven
template <class S>
void calc_vehicle_rates(const DockingModel& model, const ExternalLoads<S>& loads, const S* y,
                        S* ydot, DockingData<S>& data);
/// Load of the mechanism on its base (data.mechanism.on_base) and of all that the chaser carries on
/// it (data.on_chaser), acceleration of the chaser, and cut forces unless the mechanism is locked:
/// nothing defines them then. @pre calc_docking
template <class S>
void calc_docking_reactions(const DockingModel& model, DockingData<S>& data);

/// Load that a part of the chaser needs to be accelerated so, about the chaser's origin, axes of O.
/// @param a  of the chaser's origin less gravity
template <class S>
Wrench<S> find_inertial_load(const VehicleBody& part, const FrameMotion<S>& chaser,
                             const Vec3<S>& a, const Vec3<S>& alpha);

/// Motion of a vehicle by its record: between two rows the cubic that has poses and rates of both.
/// @param row  see find_row()
template <class S>
RecordedMotion<S> find_recorded_motion(const InputHistory& record, int row, const S& time);

/// Motion of a frame that is fixed on another one.
template <class S>
FrameMotion<S> find_frame_on(const FrameMotion<S>& body, const Pose<double>& pose);

/// Motion of frame `to` relative to frame `from`, axes of `from`, from differences of states.
template <class S>
RelativeMotion<S> find_relative(const FrameMotion<S>& from, const FrameMotion<S>& to);
/// P relative to A. @pre calc_frames()
template <class S>
RelativeMotion<S> find_across(const DockingModel& model, const DockingData<S>& data) {
  return model.acts_across() ? data.across
                             : find_relative(data.interface[kChaser], data.interface[kTarget]);
}

/// Pose of a vehicle in O from its states, velocities zero.
template <class S>
FrameMotion<S> get_vehicle_pose(const DockingModel& model, int vehicle, const S* y);

/// Motion of G from the tree.
template <class S>
FrameMotion<S> find_capture_motion(const DockingModel& model, const TreeData<S>& tree);

/// Kinetic energy of everything [J]. @pre calc_docking
template <class S>
S find_kinetic_energy(const DockingModel& model, const DockingData<S>& data);

/// Momentum of one body of a tree, axes of O, angular part about the origin of O.
template <class S>
Wrench<S> find_body_momentum(const Mechanism& mechanism, int body, const TreeData<S>& tree);

/// Momentum of one vehicle (with its parts, and the mechanism for the chaser) as a sum over bodies
/// and legs, axes of O, angular part about the origin of O. Independent of the momentum states.
/// @pre calc_docking
template <class S>
Wrench<S> find_momentum(const DockingModel& model, int vehicle, const DockingData<S>& data);

/// The same as states have it; as a sum, too, of a vehicle without states.
template <class S>
Wrench<S> get_momentum(const DockingModel& model, int vehicle, const S* y,
                       const DockingData<S>& data);

/// Momentum of everything but the driven vehicles, axes of O, angular part about the origin of O.
/// @param mass, first_moment  of the same [kg], [kg m]. @pre calc_docking
template <class S>
Wrench<S> find_inside_momentum(const DockingModel& model, const DockingData<S>& data, S& mass,
                               Vec3<S>& first_moment);

/// Put a vehicle's velocity (axes of O) and angular velocity (body axes) into the momentum states;
/// poses, mechanism coordinates and velocities are taken from y as they stand.
Status set_vehicle_velocity(const DockingModel& model, int vehicle, const Vec3<double>& velocity,
                            const Vec3<double>& angular_velocity, double* y,
                            DockingData<double>& data);

/// Position, inertia and its factor of the mechanism at the coordinates in y, nothing else.
Status calc_mechanism_position(const DockingModel& model, const double* y,
                               DockingData<double>& data);

/// The same of a target with parts. @pre model.target
Status calc_parts_position(const DockingModel& model, const double* y, DockingData<double>& data);

/// Put momentum (axes of O, angular part about O) into the states of a vehicle.
void set_momentum(const DockingModel& model, int vehicle, const Wrench<double>& momentum,
                  double* y);

/// Put a pose (axes of O) into the states of a vehicle.
void set_vehicle_pose(const DockingModel& model, int vehicle, const Vec3<double>& position,
                      const Vec4<double>& attitude, double* y);

}  // namespace dockloop
