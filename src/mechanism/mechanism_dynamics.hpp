// A mechanism in its independent coordinates only: reads like the method.
//
//   position      close the loops, pose the tree, inertia, reduce, factorise      [Y2 (9), (10)]
//   velocity      dependent velocities, velocities of all bodies                   [Y2 (5)]
//   acceleration  bias, reduce the right-hand side, solve, dependent accelerations [Y2 (10), (11)]
//   reactions     cut forces and the load on the base, only when a caller asks    [Y2 (11a)]
//
// Legs of platforms never enter the matrices (loops/leg_platforms.hpp): they are summed up at their
// tips. What is found of their bodies depends on what is needed (Need).
//
// The base of the tree is prescribed (usually at rest). A free-flying vehicle is a body with a free
// joint: attach_vehicle() puts it between the base and the mechanism.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "loops/loops.hpp"
#include "math/small_cholesky.hpp"
#include "mechanism/mechanism_kernel.hpp"
#include "model/vehicle_part.hpp"

namespace dockloop {

/// Model and plan together; const during a run (but for a change of independent coordinates).
struct Mechanism {
  /// Redundant equations are taken out, closed forms chosen on the branch of the home pose.
  explicit Mechanism(MechanismModel description, bool newton_only = false);
  MechanismModel model;
  LoopPlan plan;
  bool newton_only = false;
  std::vector<std::string> notes;  ///< what was found about redundant equations
  int vehicle = kBase;             ///< body of the vehicle if attach_vehicle() put one in
};

/// How much of a MechanismData an evaluation must fill.
enum class Need {
  kRates,  ///< for an integrator: motion of the bodies with independent joints, q and v of joints
           ///< that carry a force, accelerations. Generated code may serve this, and only this.
  kState,  ///< also for accepted states: margins, reference pose, reactions, momentum, energy, q
           ///< and v of all slides, all bodies but those of legs
  kEverything  ///< also every body and every loop
};

/// Everything computed. One per evaluation thread; sized by the constructor.
template <class S>
struct MechanismData {
  explicit MechanismData(const Mechanism& mechanism);
  TreeData<S> tree;
  LoopData<S> loops;
  MatX<S> A;                          ///< joint-space inertia while it is being reduced, nv x nv
  MatX<S> A_ind;                      ///< reduced inertia, n_ind x n_ind
  Cholesky<S> factor;                 ///< of A_ind
  VecX<S> b, b_ind;                   ///< right-hand side: full (nv), reduced (n_ind)
  VecX<S> a_ind;                      ///< independent accelerations (n_ind)
  VecX<S> tau;                        ///< joint forces (nv), written by the caller
  std::optional<Vec6<S>> prescribed;  ///< acceleration of a vehicle, where the caller prescribes it
  MatX<S> A_held;                     ///< then A_ind without the vehicle
  Cholesky<S> factor_held;            ///< of A_held
  VecX<S> b_held;                     ///< right-hand side with it
  Vec6<S> on_vehicle;                 ///< the load that prescribes it, about its origin, its axes
  VecX<S> vdot;                       ///< all accelerations (nv)
  std::vector<Wrench<S>> joint_load;  ///< per body: what its joint (with its parent) exerts on it,
                                      ///< about its origin, base axes (calc_joint_loads)
  std::vector<Wrench<S>> scratch;     ///< per body
  VecX<S> scratch_v;                  ///< nv
  MatX<S> A_tree;     ///< nv x nv: inertia of the tree with the legs of platforms condensed, before
                      ///< other loops are eliminated
  Wrench<S> on_base;  ///< of what the base body carries on it, about that body's origin,
                      ///< base axes of the tree (calc_reactions)
  Vec3<S> linear_momentum = Vec3<S>::Zero();   ///< of all bodies, base axes, on a base at rest
                                               ///< under gravity (calc_acceleration) [N s]
  Need found = Need::kState;                   ///< how much the present evaluation finds, at least
  std::shared_ptr<MechanismKernel> generated;  ///< generated code for Need::kRates; double only
};

/// In: independent entries of data.tree.q (dependent ones as a start).
/// @param need  how much this function and those below find
template <class S>
Status calc_position(const Mechanism& mechanism, MechanismData<S>& data,
                     Need need = Need::kEverything);

/// Walk from home to a pose in steps small enough to stay on the assembly branch, each the
/// reference of the next. @param q  all coordinates; the independent ones count
Status move_to(const Mechanism& mechanism, const VecX<double>& q, MechanismData<double>& data);

/// In: independent entries of data.tree.v. @pre calc_position
template <class S>
void calc_velocity(const Mechanism& mechanism, const BaseMotion<S>& base, MechanismData<S>& data);

/// In: data.tau, data.tree.external. Out: data.vdot. @pre calc_velocity
template <class S>
void calc_acceleration(const Mechanism& mechanism, const BaseMotion<S>& base,
                       MechanismData<S>& data);

/// The present pose is accepted: continue from it. @pre calc_position
template <class S>
void keep_reference(const Mechanism& mechanism, MechanismData<S>& data);

/// Coordinates, rates and poses of the bodies of legs. @pre calc_velocity for Need::kState
template <class S>
void calc_leg_bodies(const Mechanism& mechanism, MechanismData<S>& data);

/// First moment and inertia of a body alone. @pre calc_position
template <class S>
BodyInertia<S> get_body_inertia(const Mechanism& mechanism, int i, const TreeData<S>& tree) {
  if (mechanism.plan.is_free_platform)
    return find_body_inertia(mechanism.model.bodies[i], tree.R[i]);
  return {tree.h_body[i], tree.I_body[i]};
}

/// Kinetic energy of all bodies but a vehicle; and their other sums, momentum about the base
/// origin, base axes.
/// @pre calc_velocity for Need::kState, on a base at rest
template <class S>
S find_mechanism_energy(const Mechanism& mechanism, const MechanismData<S>& data);
template <class S>
LegSums<S> find_motion_sums(const Mechanism& mechanism, const MechanismData<S>& data);

/// Cut forces (data.loops.block[].lambda) and the load on `base_body` (data.on_base).
/// @pre calc_acceleration for Need::kState
template <class S>
void calc_reactions(const Mechanism& mechanism, const BaseMotion<S>& base, int base_body,
                    MechanismData<S>& data);

/// Load of bodies that `parent` carries on it, about its origin. @param first, end  bodies that
/// count
/// @pre calc_reactions
template <class S>
Wrench<S> find_carried_load(const Mechanism& mechanism, int parent, int first, int end,
                            const TreeData<S>& tree);

/// Full load in every joint of the tree, cut forces taken into account: data.joint_load. The load
/// of a planar cut across its plane is not determined and counts as zero.
/// @pre calc_reactions for Need::kEverything
template <class S>
void calc_joint_loads(const Mechanism& mechanism, MechanismData<S>& data);

/// A choice of independent coordinates: the joints that each loop determines, how it is closed, and
/// the pose whose assembly branch counts.
struct Coordinates {
  std::vector<std::vector<int>> dependent;  ///< per loop
  std::vector<ClosureKind> closure;         ///< per loop
  std::vector<double> pose;                 ///< all coordinates, nq
};

/// The choice that suits the present pose best, if it is much better than the mechanism's own;
/// otherwise nothing. Allocates. @pre all coordinates are known (calc_leg_bodies)
std::optional<Coordinates> find_better_coordinates(const Mechanism& mechanism,
                                                   const MechanismData<double>& data);

/// The mechanism in other independent coordinates. @throws ModelError if they do not fit it
Mechanism with_coordinates(const Mechanism& mechanism, const Coordinates& coordinates);

/// Below this margin a better choice of coordinates is looked for.
constexpr double kChangeMargin = 0.1;

/// Largest loop gap [m] of the present position, for monitoring. Finds the bodies of legs.
/// @pre calc_position for Need::kState
template <class S>
double find_closure_residual(const Mechanism& mechanism, MechanismData<S>& data);

/// Smallest loop margin [-] of the present position; 1 without loops.
template <class S>
double find_singularity_margin(const Mechanism& mechanism, const MechanismData<S>& data);

/// Has a loop passed a singular pose since the accepted configuration? The determinant of its
/// matrix has then changed its sign.
template <class S>
bool has_passed_singular_pose(const Mechanism& mechanism, const MechanismData<S>& data);

/// Gap of every loop at home_q as it stands [m].
std::vector<double> find_home_gaps(const Mechanism& mechanism);

/// calc_position() at home. @param source  begins the message
/// @throws ModelError that says why the pose cannot be evaluated
void calc_home_position(const Mechanism& mechanism, const std::string& source,
                        MechanismData<double>& data);

constexpr double kHomeGap = 1e-6;  ///< a loop is closed at home to this part of its size [-]

/// Close the home pose: replaces the dependent entries of home_q by a solution, and notes how far
/// loops were open. A stated home may be a first guess: the independent entries are held.
/// @throws ModelError when a stated home is open by more than 1 % of a loop, or cannot be closed.
void close_home(Mechanism& mechanism, const std::string& source_name);

/// Rigid body onto which a mechanism is put.
struct VehicleBody {
  double mass = 0.0;
  Vec3<double> com = Vec3<double>::Zero();
  Mat3<double> inertia = Mat3<double>::Zero();  ///< about com
};

/// Two bodies that are one.
VehicleBody join(const VehicleBody& a, const VehicleBody& b);

/// The same body in other axes.
VehicleBody transform(const Pose<double>& pose, const VehicleBody& body);

/// The mechanism on a free-flying vehicle: body 0 is "vehicle" with a free joint, then comes its
/// adapter. What hung on the base hangs on the last of them. Other parts are the last bodies.
/// @param base_in_vehicle pose of B in the vehicle's axes, coordinates of the adapter at zero.
MechanismModel attach_vehicle(const MechanismModel& mechanism, const VehicleBody& vehicle,
                              const Pose<double>& base_in_vehicle, const VehicleParts& parts = {});

/// All parts of a vehicle as one body, coordinates at zero, axes of the vehicle.
VehicleBody find_rigid_parts(const VehicleParts& parts);

/// Share of its mass and inertia that a vehicle has left without its modes, in the direction in
/// which modes take part most: 1 without modes; 0 or less for modes that no body has.
double find_share_without_modes(const VehicleBody& vehicle, const VehicleParts& parts);
constexpr double kLeastShareWithoutModes = 1e-4;
inline bool can_carry_modes(const VehicleBody& vehicle, const VehicleParts& parts) {
  return find_share_without_modes(vehicle, parts) >= kLeastShareWithoutModes;
}

/// The mechanism on a vehicle that does not move: base placements become `base_pose`.
MechanismModel fix_base(const MechanismModel& mechanism, const Pose<double>& base_pose);

/// Mass properties of the mechanism frozen at its (closed) home pose, in base axes.
VehicleBody find_frozen_body(const Mechanism& mechanism);

}  // namespace dockloop
