// Loops: close them, differentiate them, and eliminate what they determine.
//
// Equation map (paper [Y2], src/README.md)                      function                 test
//   [Y2 (1)]  closure of a cut, position                        calc_cut_position        loops_test
//   [Y2 (1u)] extra equation of a universal cut                 calc_cut_position, calc_cut_bias
//   [Y2 (2)-(4)] loop equations, C_dep, C_low, gamma            calc_cut_jacobian, calc_cut_bias
//   [Y2 (5),(7)] v_dep = H v_low                                calc_loop_velocity vectors_test [Y2
//   (6),(8)] vdot_dep = H vdot_low + h                      calc_loop_bias           vectors_test
//   [Y2 (9)]  Newton iteration                                  calc_loop_position       loops_test
//   [Y2 (9a)] closed form of a universal-slide-spherical leg    calc_loop_position       loops_test
//   [Y2 (10)] reduction, last loop to first                     reduce_inertia, reduce_forces
//   [Y2 (11a)] cut force from Q = C_dep^T lambda                calc_loop_forces vectors_test
//
// All quantities of a loop are relative to, and in axes of, the lowest common ancestor L of its
// terminal and closing bodies: joints above L drop out exactly, not to rounding. [Y2 (4), differs:
// Ci holds the columns of both paths, C_low = J_I - J_T; the printed form keeps J_I alone.]
#pragma once

#include <vector>

#include "loops/loop_plan.hpp"
#include "math/small_lu.hpp"
#include "math/status.hpp"
#include "tree/tree.hpp"

namespace dockloop {

/// Geometry of one cut, axes of L.
template <class S>
struct CutData {
  std::vector<Pose<S>> terminal, closing;  ///< pose in L of each body on the two paths
  Vec3<S> p_T, p_I;                        ///< cut point on terminal and closing body [m]
  Vec3<S> axis_T, axis_I;                  ///< universal cut: cross axes
  Eigen::Matrix<S, 2, 3> plane;            ///< planar cut: in-plane axes
};

/// Matrices of one block. Shapes: m = block.size(), n_low, n_touched.
template <class S>
struct BlockData {
  VecX<S> residual;     ///< m, cut residual [m], [-]
  MatX<S> G;            ///< m x (m + n_low): columns of dep, then of low: residual rate = G v
  SmallLu<S> lu;        ///< of C_dep = G[:, :m]
  MatX<S> H;            ///< m x n_low: v_dep = H v_low
  VecX<S> h;            ///< m: vdot_dep = H vdot_low + h
  MatX<S> A_dt, A_dd;   ///< m x n_touched, m x m: saved when the block is eliminated
  MatX<S> U, W;         ///< scratch of reduce_inertia: n_touched x n_low, m x n_low
  VecX<S> b_d;          ///< m: saved when the block is eliminated
  VecX<S> lambda;       ///< m: cut forces on the terminal bodies, axes of L [N], [N m]
  VecX<S> step;         ///< m: scratch
  double margin = 1.0;  ///< dimensionless distance to singularity of C_dep [-]
  int sign = 0;         ///< of det C_dep
};

template <class S>
struct LoopData {
  LoopData(const MechanismModel& model, const LoopPlan& plan);
  std::vector<CutData<S>> cut;      ///< per loop
  std::vector<BlockData<S>> block;  ///< per block
  std::vector<int> reference_sign;  ///< per block: sign of det C_dep at initialisation, 0 = unset
};

/// Limits of the dimensionless margin [-]: below, a loop counts as singular, or earns a warning.
constexpr double kSingularMargin = 1e-4;
constexpr double kMarginWarning = 1e-2;

/// Solve every block for its dependent coordinates and set the joint poses of all bodies.
/// In: independent entries of tree.q; dependent entries as starting point of Newton and to place
/// angles within a turn. Out: all of tree.q, tree.joint, and G, lu, margin of every block.
/// @return kOutOfReach, kLoopNotClosed, kLoopSingular, kBranchChanged with the loop index.
template <class S>
Status calc_loop_position(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                          LoopData<S>& loops);

/// H of every block.
template <class S>
void calc_velocity_maps(const LoopPlan& plan, LoopData<S>& loops);

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

}  // namespace dockloop
