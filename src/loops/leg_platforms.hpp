// Platforms on legs: every leg is eliminated at its tip, as an apparent inertia and a force there.
//
// The bodies of such legs leave the tree. What remains of a leg is, for its root body R, its mass
// frozen where it stands and the momentum that its joints carry; for its platform C, its apparent
// inertia. Sums over legs are 6 x 6, whatever their number. Gears, which turn with joints of legs,
// are a part of these sums. LEGS.md explains this, leg_rows.hpp the axes R, C, K, E.
// Legs of one kind stand side by side where numbers are doubles (leg_lanes.hpp); other scalars
// evaluate the same formulas leg by leg (leg_stages.hpp).
#pragma once

#include <array>
#include <vector>

#include "loops/leg_lanes.hpp"
#include "loops/loop_plan.hpp"
#include "math/scalar.hpp"
#include "tree/tree.hpp"

namespace dockloop {

/// A leg, and where its numbers stand.
struct LegPlace {
  int block = 0;
  legs::LegType type = legs::kSlideLeg;
  size_t group = 0;
  int lane = 0;
  std::vector<int> body;     ///< from the root outwards
  int q[3] = {}, v[3] = {};  ///< of its joints
  double sign[3] = {};       ///< +1 or -1: joint coordinate of the model per canonical one (K)
  ClosedForm form;
  Vec3<double> ring;  ///< tip on the platform, axes of the platform
};

/// A joint whose motion is found in every evaluation: one that slides or carries a force.
struct ReportedJoint {
  size_t leg = 0;
  int joint = 0;
  bool slides = false, needs_angle = false;
};

/// Numbers of all legs of a platform, leg by leg.
template <class S>
class LegStore {
 public:
  using Constant = std::conditional_t<std::is_same_v<S, Extended>, Extended, double>;
  void add(LegPlace& place);
  void finish() {}
  void put(const LegPlace& at, int row, const Constant& x) { legs_[at.group].parameter[row] = x; }
  const Constant& get(const LegPlace& at, int row) const { return legs_[at.group].parameter[row]; }
  S& work(const LegPlace& at, int row) { return legs_[at.group].work[row]; }
  const S& work(const LegPlace& at, int row) const { return legs_[at.group].work[row]; }
  /// Stages as in LegFunctions (leg_lanes.hpp), which explains `moving` and `least`.
  bool calc_position(const legs::PlatformMotion<S>& at, bool moving, double least, S* sums);
  void calc_angles(int) {}
  void calc_rates(const legs::PlatformMotion<S>& at);
  void calc_bias(const legs::PlatformMotion<S>& at, bool moving, S* sums);
  void calc_loads(const legs::PlatformMotion<S>& at, S* sums);

 private:
  struct One {
    legs::LegType type;
    Constant parameter[legs::kParameters];
    S work[legs::kWork];
  };
  std::vector<One> legs_;
};

/// The same for doubles: side by side.
template <>
class LegStore<double> {
 public:
  using Constant = double;
  void add(LegPlace& place);
  /// Fill the lanes that are left: the first leg of their group again, without mass and force.
  void finish();
  void put(const LegPlace& at, int row, double x) { groups_[at.group].parameter[row][at.lane] = x; }
  double get(const LegPlace& at, int row) const {
    return groups_[at.group].parameter[row][at.lane];
  }
  double& work(const LegPlace& at, int row) { return groups_[at.group].work[row][at.lane]; }
  double work(const LegPlace& at, int row) const { return groups_[at.group].work[row][at.lane]; }
  bool calc_position(const legs::PlatformMotion<double>& at, bool moving, double least,
                     double* sums) {
    return functions_->calc_position(groups_.data(), count(), at, moving, least, sums);
  }
  void calc_angles(int joint) { functions_->calc_angles(groups_.data(), count(), joint); }
  void calc_rates(const legs::PlatformMotion<double>& at) {
    functions_->calc_rates(groups_.data(), count(), at);
  }
  void calc_bias(const legs::PlatformMotion<double>& at, bool moving, double* sums) {
    functions_->calc_bias(groups_.data(), count(), at, moving, sums);
  }
  void calc_loads(const legs::PlatformMotion<double>& at, double* sums) {
    functions_->calc_loads(groups_.data(), count(), at, sums);
  }
  /// @param widest  lanes at most, for tests; results do not depend on it
  void use_lanes(int widest) { functions_ = &legs::find_leg_functions(widest); }

 private:
  int count() const { return static_cast<int>(groups_.size()); }
  const legs::LegFunctions* functions_ = &legs::find_leg_functions(kGroup);
  std::vector<legs::LegGroup> groups_;
};

/// A gear (LegGear): where its numbers stand, and what is computed for it.
template <class S>
struct GearData {
  struct Term {
    size_t leg = 0;
    int joint = 0;
    double ratio = 0.0;
  };
  struct User {
    size_t gear = 0;
    double factor = 0.0;
  };
  int body = 0, carrier = kBase, block = 0, q = 0, v = 0;
  double constant = 0.0;
  std::vector<Term> terms;   ///< its coordinate is the constant and the sum of these
  bool is_reported = false;  ///< its coordinate and rate are found in every evaluation
  bool on_root = false;      ///< then it is a part of the GearTrain, else of its leg (legs::kSpin)
  S inertia = S(0);          ///< about its axis [kg m2]
  Vec3<S> axis;              ///< R; of gears on tube or rod: E
  double factor = 1.0;       ///< of its own joint in its coupling
  std::vector<User> users;   ///< later gears whose couplings name this one, the last one first
  // Loads
  S torque = S(0);  ///< of forces and loads on its joint [N m]
  Wrench<S> load;   ///< from outside, passed on to the carrier; about its origin, base axes
};

/// All gears on the root together, as the joints of legs that turn them feel their inertia.
template <class S>
struct GearTrain {
  struct Joint {
    size_t leg = 0;
    int joint = 0;
    Vec3<S> momentum = Vec3<S>::Zero();  ///< of the gears per rate of this joint, R [kg m2]
    Vec6<S> row = Vec6<S>::Zero();       ///< its rate per twist of C
    Vec6<S> pressed = Vec6<S>::Zero();   ///< torque that accelerates the gears, per twist of C
    S acceleration = S(0), torque = S(0);
  };
  std::vector<Joint> joints;
  std::vector<std::vector<S>> inertia;  ///< per joint and joint [kg m2]
  // Of the gears, frozen, about the origin of R, R
  S mass = S(0);
  Vec3<S> first_moment = Vec3<S>::Zero();
  Mat3<S> frozen = Mat3<S>::Zero();
};

/// Everything computed for one platform.
template <class S>
struct PlatformData {
  PlatformData(const MechanismModel& model, const LoopPlan& plan, const LegPlatform& platform);
  std::vector<LegPlace> legs;
  std::vector<GearData<S>> gears;
  GearTrain<S> train;
  std::vector<int> gear_bodies;
  std::vector<Vec3<S>> force;  ///< with gears: scratch, forces in the joints of each leg
  std::vector<ReportedJoint> reported;
  std::array<bool, 3> angles{};  ///< is the angle of a first, second, third joint reported?
  LegStore<S> store;
  S mass = S(0);                   ///< of all legs and gears [kg]
  legs::PlatformMotion<S> motion;  ///< of C relative to R
  std::vector<Pose<S>> pose;       ///< of the bodies of the path, in R; not where one free joint is
                                   ///< the path
  Eigen::Matrix<S, 6, Eigen::Dynamic> J;  ///< twist of C relative to R (velocity of the origin,
                                          ///< angular velocity; C) per velocity of the path
  std::array<S, legs::kPositionSums> sums;
  std::array<S, legs::kBiasSums> bias;
  Wrench<S> external;      ///< loads on bodies of the legs, about the origin of R, base axes
  bool is_loaded = false;  ///< there are such loads
  bool carries = false;    ///< the sums hold what R carries along
};

template <class S>
struct LoopData;

/// Close all legs, and sum up their inertia. In: joint poses of all other bodies. Out: coordinates
/// of reported joints.
/// @return kOutOfReach, kLoopSingular, kBranchChanged with the loop index and margin
template <class S>
Status calc_leg_positions(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                          LoopData<S>& loops);

/// Coordinates of all joints of legs and gears. @pre calc_leg_positions
template <class S>
void calc_leg_coordinates(const MechanismModel& model, TreeData<S>& tree, LoopData<S>& loops);

/// The same, and poses of these joints.
template <class S>
void calc_leg_poses(const MechanismModel& model, TreeData<S>& tree, LoopData<S>& loops);

/// H, margin, sign of the blocks of legs. @pre calc_leg_positions
template <class S>
void calc_leg_maps(LoopData<S>& loops);

/// Rates of the joints of legs and gears, where rows of `columns` are other velocities of the tree
/// that are possible. @pre calc_leg_positions
template <class S>
void add_leg_columns(const LoopPlan& plan, const LoopData<S>& loops, MatX<S>& columns);

/// The masses of the legs, frozen, onto their root bodies. @pre calc_body_inertia
template <class S>
void add_leg_masses(const LoopPlan& plan, const LoopData<S>& loops, TreeData<S>& tree);

/// What moves with the platforms. @pre calc_composite_inertia
template <class S>
void add_leg_inertia(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                     const LoopData<S>& loops, MatX<S>& A);

/// Rates of the legs; out: those of reported joints. @pre calc_tree_velocity
template <class S>
void calc_leg_velocities(const MechanismModel& model, const LoopPlan& plan, const Vec3<S>& base_w,
                         TreeData<S>& tree, LoopData<S>& loops);

/// Rates of all joints of legs and gears. @pre calc_leg_velocities
template <class S>
void put_leg_velocities(TreeData<S>& tree, const LoopData<S>& loops);

/// What the legs need at zero joint accelerations, onto platforms and roots (tree.transmitted).
/// @pre calc_tree_acceleration, calc_body_forces. @param tau  joint forces
template <class S>
void add_leg_biases(const MechanismModel& model, const LoopPlan& plan, const BaseMotion<S>& base,
                    const VecX<S>& tau, TreeData<S>& tree, LoopData<S>& loops);

// Where plan.is_free_platform: the reduced equations of the whole mechanism.

/// The reduced inertia A; also mass and first moment of all that the root carries (tree.m_sum,
/// h_sum). @pre calc_leg_positions, calc_tree_position
template <class S>
void calc_free_inertia(const MechanismModel& model, const LoopPlan& plan, const LoopData<S>& loops,
                       TreeData<S>& tree, MatX<S>& A);

/// The reduced right-hand side b. @pre calc_leg_velocities, calc_tree_acceleration
template <class S>
void calc_free_forces(const MechanismModel& model, const LoopPlan& plan, const BaseMotion<S>& base,
                      const VecX<S>& tau, TreeData<S>& tree, LoopData<S>& loops, VecX<S>& b);

/// h of the blocks of legs, and the accelerations of the joints of legs and gears. @pre
/// calc_leg_maps, add_leg_biases, other accelerations
template <class S>
void put_leg_accelerations(const LoopPlan& plan, VecX<S>& vdot, LoopData<S>& loops);

/// Cut forces of the legs, forces of the couplings of gears; what both need, onto their roots
/// (tree.transmitted), or onto `on_base` where the root is `base_body`.
/// @pre add_leg_biases; calc_tree_acceleration with vdot, calc_body_forces
template <class S>
void add_leg_loads(const LoopPlan& plan, const BaseMotion<S>& base, int base_body,
                   const VecX<S>& vdot, TreeData<S>& tree, LoopData<S>& loops, Wrench<S>& on_base);

/// Sums over the legs of one platform, base axes, about the origin of its root.
template <class S>
struct LegSums {
  S mass;
  Vec3<S> first_moment;
  Wrench<S> momentum;
};
/// @pre calc_leg_velocities, on a base at rest
template <class S>
S find_leg_energy(const LegPlatform& platform, const TreeData<S>& tree, const PlatformData<S>& at);
template <class S>
LegSums<S> find_leg_sums(const LegPlatform& platform, const TreeData<S>& tree,
                         const PlatformData<S>& at);

/// Smallest margin of the legs of a platform [-].
template <class S>
double find_leg_margin(const PlatformData<S>& at);

}  // namespace dockloop
