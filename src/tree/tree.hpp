// Recursions over the tree that remains when the loops are cut: poses, velocities, inertia, forces.
//
// Everything is expressed in base axes but taken about each body's own origin: `r` leads from the
// parent's origin to the body's origin, so a mechanism far from the base origin loses no digits.
// Order of a full evaluation:
//   calc_joint_pose (each joint) -> calc_tree_position -> calc_tree_inertia
//   calc_tree_velocity -> calc_tree_acceleration -> calc_tree_forces
// The last two run with zero joint accelerations for the bias, with the true ones for reactions.
#pragma once

#include <vector>

#include "math/rotation.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// All that the recursions compute. Sized once by the constructor; no function below allocates.
template <class S>
struct TreeData {
  explicit TreeData(const MechanismModel& model);

  VecX<S> q;      ///< coordinates, nq; independents set by the caller, dependents by the loops
  VecX<S> v;      ///< velocities, nv
  S time = S(0);  ///< since the start, for joints that are driven [s]; set by the caller
  std::vector<int> all;  ///< all bodies, ascending

  // written by calc_joint_pose
  std::vector<Pose<S>> joint;  ///< pose of body i in its parent

  // written by calc_tree_position
  std::vector<Mat3<S>> R;  ///< body axes to base axes
  std::vector<Vec3<S>> r;  ///< parent's origin to own origin, base axes [m]
  std::vector<Vec3<S>> p;  ///< base origin to own origin, base axes [m]
  std::vector<Vec3<S>> e;  ///< joint axis, base axes (not for free joints)

  // written by calc_body_inertia
  std::vector<Vec3<S>> h_body;  ///< mass x com of the body alone, base axes [kg m]; of a mode, what
                                ///< its amplitude adds to the first moment
  std::vector<Mat3<S>> I_body;  ///< inertia of the body alone about its origin, base axes
  // written by calc_body_inertia and calc_composite_inertia
  std::vector<S> m_sum;        ///< mass of the subtree [kg]
  std::vector<Vec3<S>> h_sum;  ///< first moment of the subtree about the origin of the body
  std::vector<Mat3<S>> I_sum;  ///< inertia of the subtree about the origin of the body
  MatX<S> A;                   ///< joint-space inertia, nv x nv

  // written by calc_tree_velocity
  std::vector<Vec3<S>> w, u;  ///< angular velocity; velocity of the origin, base axes

  // written by calc_tree_acceleration, for zero or for true joint accelerations
  std::vector<Vec3<S>> alpha, a;  ///< angular acceleration; acceleration of the origin less gravity
  std::vector<S> mode_rate_dot;   ///< of modes

  // input of calc_body_forces, written by the caller
  std::vector<Wrench<S>> external;  ///< on each body about its origin, base axes
  bool may_load_legs = true;        ///< else loads on bodies of legs are always zero

  // written by calc_body_forces (a start of `transmitted`) and calc_transmitted
  std::vector<Wrench<S>> transmitted;  ///< load that joint i must pass to body i, about its origin
  VecX<S> tau_required;                ///< joint forces that these accelerations require, nv
};

/// Prescribed motion of the base, in base axes; gravity is a part of it.
template <class S>
struct BaseMotion {
  Vec3<S> w = Vec3<S>::Zero();        ///< angular velocity [rad/s]
  Vec3<S> alpha = Vec3<S>::Zero();    ///< angular acceleration [rad/s2]
  Vec3<S> a = Vec3<S>::Zero();        ///< acceleration of the base origin [m/s2]
  Vec3<S> gravity = Vec3<S>::Zero();  ///< [m/s2]
};

/// Pose of body i in its parent from its coordinates; c, s = cos, sin of a revolute coordinate.
template <class S>
void calc_joint_pose(const MechanismModel& model, int i, const S& c, const S& s, TreeData<S>& data);
/// The same with cos and sin taken from q.
template <class S>
void calc_joint_pose(const MechanismModel& model, int i, TreeData<S>& data);

// Recursions go over `bodies`, ascending: all, or those that belong to no leg of a platform. With a
// list goes everything that carries a body of the list.

/// R, r, p, e of bodies from the joint poses.
template <class S>
void calc_tree_position(const MechanismModel& model, const std::vector<int>& bodies,
                        TreeData<S>& data);

/// First moment and inertia of a body alone about its origin, base axes. @param R  attitude
template <class S>
struct BodyInertia {
  Vec3<S> h = Vec3<S>::Zero();
  Mat3<S> I = Mat3<S>::Zero();
};
template <class S>
BodyInertia<S> find_body_inertia(const Body& body, const Mat3<S>& R) {
  if (body.mass == 0.0 && body.inertia.isZero(0.0)) return {};
  const S m(body.mass);
  const Vec3<S> c = R * cast<S>(body.com);
  return {m * c, R * cast<S>(body.inertia) * R.transpose() + find_point_inertia(m, c)};
}

/// The same of each body, also as a start of the sums.
template <class S>
void calc_body_inertia(const MechanismModel& model, const std::vector<int>& bodies,
                       TreeData<S>& data);
/// Joint-space inertia A (its rows and columns of these bodies) by composite bodies.
/// Featherstone, Rigid Body Dynamics Algorithms, 6.2
template <class S>
void calc_composite_inertia(const MechanismModel& model, const std::vector<int>& bodies,
                            TreeData<S>& data, MatX<S>& A);
/// Both for all bodies, into data.A.
template <class S>
void calc_tree_inertia(const MechanismModel& model, TreeData<S>& data);

/// w, u of every body from v. The base turns with base_w and its origin is taken at rest.
template <class S>
void calc_tree_velocity(const MechanismModel& model, const std::vector<int>& bodies,
                        const Vec3<S>& base_w, TreeData<S>& data);

/// alpha, a of every body for given joint accelerations (null = zero: the bias).
/// Gravity enters as an acceleration of the base, so `a` is the true acceleration less gravity.
template <class S>
void calc_tree_acceleration(const MechanismModel& model, const std::vector<int>& bodies,
                            const BaseMotion<S>& base, const VecX<S>* vdot, TreeData<S>& data);

/// Inverse dynamics of each body alone, for the alpha, a present: a start of `transmitted`.
template <class S>
void calc_body_forces(const MechanismModel& model, const std::vector<int>& bodies,
                      TreeData<S>& data);
/// tau_required, and what bodies pass on to those that carry them.
template <class S>
void calc_transmitted(const MechanismModel& model, const std::vector<int>& bodies,
                      TreeData<S>& data);
/// Both for all bodies: tau_required and transmitted loads.
///                                          Featherstone, Rigid Body Dynamics Algorithms, 5.3
template <class S>
void calc_tree_forces(const MechanismModel& model, TreeData<S>& data);

/// Momentum per unit rate of a mode, about the origin, base axes.
template <class S>
Wrench<S> find_mode_momentum(const Body& mode, const Mat3<S>& R) {
  return {R * cast<S>(mode.axis), R * cast<S>(mode.axis_of_rotation)};
}

/// Column k of joint i at a point `r` from the body's origin: velocity of that point and angular
/// velocity per unit joint velocity, base axes.
template <class S>
inline void get_joint_column(const Body& body, const Mat3<S>& R, const Vec3<S>& e, int k,
                             Vec3<S>& angular, Vec3<S>& linear) {
  angular.setZero();
  linear.setZero();
  switch (body.joint) {
    case JointType::kRevolute:
      angular = e;
      break;
    case JointType::kPrismatic:
      linear = e;
      break;
    case JointType::kFree:
      if (k < 3) {
        linear = R.col(k);
      } else {
        angular = R.col(k - 3);
      }
      break;
    case JointType::kMode:
      break;
  }
}

}  // namespace dockloop
