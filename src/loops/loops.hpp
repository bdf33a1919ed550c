// Loops: close them, differentiate them, and eliminate what they determine.
//
// All quantities of a loop are relative to, and in axes of, the lowest common ancestor L of its
// terminal and closing bodies: joints above L drop out exactly, not to rounding. [Y2 (4), differs:
// C_low holds the columns of both paths, J_I - J_T; the printed form keeps J_I alone.]
// Which equation of the paper is where, and which test shows it: README.md in this folder.
//
//   loop_equations_body.hpp   one cut: residual, columns of G, bias                [Y2 (1)-(4)]
//   loop_position_body.hpp    dependent coordinates: closed forms, Newton          [Y2 (9)]
//   loop_reduction_body.hpp   H, h, elimination, cut forces                        [Y2 (5)-(8),
//   (10)]
#pragma once

#include <array>
#include <vector>

#include "loops/leg_platforms.hpp"
#include "math/small_lu.hpp"
#include "math/status.hpp"
#include "tree/tree.hpp"

namespace dockloop {

/// Geometry of one cut, axes of L.
template <class S>
struct CutData {
  std::vector<Pose<S>> terminal, closing;       ///< pose in L of each body on the two paths
  Vec3<S> p_T, p_I;                             ///< cut point on terminal and closing body [m]
  std::array<Vec3<S>, 2> axis_T;                ///< cross axes of the terminal body
  Vec3<S> axis_I;                               ///< axis of the closing body they are square to
  Eigen::Matrix<S, 2, 3> plane;                 ///< planar cut: in-plane axes
  Eigen::Matrix<S, kMaxEquations, 1> residual;  ///< of all equations, redundant ones too
};

/// Matrices of one block. Of a leg of a platform: branch, sign, lambda; H, g, h, margin where
/// everything is found. Shapes: m = block.size(), n_low, n_touched.
template <class S>
struct BlockData {
  VecX<S> residual;      ///< m, cut residual [m], [-]
  MatX<S> G;             ///< m x (m + n_low): columns of dep, then of low: residual rate = G v
  LegSolution<S> leg;    ///< closed form: canonical coordinates
  LegBranch branch;      ///< closed form: the branch they are on
  int spin_branch = 1;   ///< and that of the spin
  Mat3<S> leg_axes;      ///< closed form with inverse: leg axes in L, columns
  MatX<S> inverse;       ///< closed form with inverse: of C_dep, m x m
  SmallLu<S> lu;         ///< else: of C_dep = G[:, :m]
  MatX<S> H;             ///< m x n_low: v_dep = H v_low
  VecX<S> g;             ///< m: v_dep = H v_low + g; zero unless something is driven
  VecX<S> h;             ///< m: vdot_dep = H vdot_low + h
  MatX<S> A_dt, A_dd;    ///< m x n_touched, m x m: saved when the block is eliminated
  MatX<S> U, W;          ///< scratch of reduce_inertia: n_touched x n_low, m x n_low
  VecX<S> b_d;           ///< m: saved when the block is eliminated
  VecX<S> lambda;        ///< m: cut forces on the terminal bodies, axes of L [N], [N m]
  VecX<S> step, column;  ///< m: scratch
  double margin = 1.0;   ///< dimensionless distance to singularity of C_dep [-]
  int sign = 0;          ///< of det C_dep
};

/// The last accepted pose: Newton iteration starts from its tangent, closed forms near a singular
/// pose take the branch nearest to its tangent, angles stay within half a turn of it. Results
/// depend on it, not on what was tried in between.
template <class S>
struct LoopReference {
  bool valid = false;
  VecX<S> q;                      ///< all coordinates
  std::vector<MatX<S>> H;         ///< per block
  std::vector<int> sign;          ///< per block: of det C_dep
  std::vector<double> margin;     ///< per block
  std::vector<LegBranch> branch;  ///< per block with a closed form
  std::vector<int> spin_branch;   ///< per block with a closed form and a spin
  std::vector<double> reach;      ///< per platform: motion, norm of its coordinates, that brings no
                                  ///< leg near a singular pose
};

template <class S>
struct LoopData {
  LoopData(const MechanismModel& model, const LoopPlan& plan);
  std::vector<CutData<S>> cut;            ///< per loop
  std::vector<BlockData<S>> block;        ///< per block
  std::vector<PlatformData<S>> platform;  ///< per platform on legs
  LoopReference<S> reference;
  // Have calc_leg_coordinates() and calc_leg_poses() been called at this position?
  bool has_leg_coordinates = false, has_leg_poses = false;
  VecX<S> moved, target;  ///< scratch: nv, from the reference pose; nq, pose that is sought
};

/// Solve every block for its dependent coordinates and set the joint poses of all bodies but those
/// of the legs of platforms, for which calc_leg_positions() says what is found.
/// In: independent entries of tree.q; dependent entries as starting point of Newton and to place
/// angles within a turn (the reference pose, once there is one, serves instead).
/// Out: all of tree.q, tree.joint, and G, inverse, margin of every block.
/// @return kOutOfReach, kLoopNotClosed, kLoopSingular, kBranchChanged, kRedundancyLost with the
/// loop index and margin.
template <class S>
Status calc_loop_position(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                          LoopData<S>& loops);

/// The present pose is accepted: continue from it. Out: also coordinates of all joints.
/// @pre calc_velocity_maps
template <class S>
void keep_reference(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                    LoopData<S>& loops);

/// Residual and G of the legs of platforms. @pre calc_leg_poses
template <class S>
void calc_leg_cuts(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                   LoopData<S>& loops);

// The functions below pass over the legs of platforms.

/// H of every block, and g.
template <class S>
void calc_velocity_maps(const MechanismModel& model, const LoopPlan& plan, LoopData<S>& loops);

/// Dependent entries of tree.v from the independent ones.
template <class S>
void calc_loop_velocity(const LoopPlan& plan, TreeData<S>& tree, const LoopData<S>& loops);

/// h of every block, from all velocities.
template <class S>
void calc_loop_bias(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                    LoopData<S>& loops);

/// Eliminate dependent rows and columns of A (in place), last block first.           [Y2 (10)]
template <class S>
void reduce_inertia(const LoopPlan& plan, MatX<S>& A, LoopData<S>& loops);

/// The same for the right-hand side b (in place). @pre reduce_inertia, calc_loop_bias
template <class S>
void reduce_forces(const LoopPlan& plan, VecX<S>& b, LoopData<S>& loops);

/// Dependent accelerations from the independent ones, first block to last.          [Y2 (6)]
template <class S>
void calc_loop_acceleration(const LoopPlan& plan, VecX<S>& vdot, const LoopData<S>& loops);

/// Cut forces on the terminal bodies. @pre reduce_forces, all of vdot               [Y2 (11a)]
template <class S>
void calc_loop_forces(const LoopPlan& plan, const VecX<S>& vdot, LoopData<S>& loops);

/// Power that drives put in [W]. @pre calc_loop_forces
template <class S>
S find_drive_power(const MechanismModel& model, const LoopPlan& plan, const LoopData<S>& loops);

/// Cut force of one equation of a loop; 0 of a redundant one. @pre calc_loop_forces
template <class S>
S get_cut_force(const LoopPlan& plan, const LoopData<S>& loops, int loop, int equation);

}  // namespace dockloop
