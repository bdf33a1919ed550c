// A matrix near the Jacobian of a docking, cheap enough to be built in every step: for linearly
// implicit methods (Stepper::Problem::Matrix).
//
// What is stiff has a structure. Contact and latches push on 6 coordinates only, those of P
// relative to G: F = K xi + C nu, xi' = nu (contact/interface_tangent.hpp). They reach all
// velocities through the inverse inertia, whose factor the evaluation has left behind. Legs and
// other parts of the mechanism act on its own n velocities. So 1/g - A of all states shrinks to
// n + 6 equations for the velocities of the mechanism, v_m, and F, in axes of G (and one for each
// bristle of a brake; and six more for each other load on P: that of each other body with active
// cores, and that of the hard dock between A and P):
//
//   nu  = N_m v_m + N_c v_c + N_t v_t
//   v_c = A_cc^-1 (p_c - A_cm v_m),  v_t = M_t^-1 p_t    momenta in body axes about own origins
//   s' = B F + L_x x + L_s s,  x' = v_m                  B = -(A_ind^-1 J_G^T), rows of v_m
//   p_c' = -P F,  p_t' = P F                             the same six numbers with both signs
//
// All loads are written as F is: about the origin of G, axes of G. A load has J and N_m of the body
// on which it acts. That of the hard dock acts on the chaser itself: both are zero.
//
// with the kinematics of this pose. Sums and impulses have no part in A. Momentum is kept to
// rounding, whatever stands in K, C and L.
//
// s is v_m and the bristles of brakes and locks. L_x, L_s (the mechanism block) come from dual
// numbers with contact and latches away. They cost more than everything else and change slowly:
// the caller keeps them for many steps.
//
// Left out: what turns with the vehicles (gyroscopic terms, loads in body axes), normals that turn,
// gravity of bodies that move. None of it is stiff. Bristles of contacts are left out too: they are
// stiff, and a docking with them needs another method. While a rigid joint holds the target,
// nothing is stiff, and A is zero.
#pragma once

#include "contact/interface_tangent.hpp"
#include "docking/docking_jacobian.hpp"
#include "math/small_lu.hpp"

namespace dockloop {

/// Numbers of a mechanism block: L_x and L_s by columns.
int find_mechanism_block_size(const DockingModel& model);

/// Mechanism block at one state. @param at  an evaluation (Need::kState) of it
/// @param block  find_mechanism_block_size() numbers
Status calc_mechanism_block(const DockingModel& model, const DiscreteState& discrete,
                            const ContactMemory& memory, const DockingData<double>& at,
                            const Loads& loads, double t, const double* y, DockingPass& pass,
                            double* block);

/// Sized by the constructor, no later allocation. Make a new object when the model changes its
/// independent coordinates.
class StructuredMatrix {
 public:
  explicit StructuredMatrix(const DockingModel& model);

  /// A at one state. @param at  an evaluation (Need::kState) of it
  /// @param block  of this state or one not far away
  void build(const DockingModel& model, const DiscreteState& discrete, const ContactMemory& memory,
             const DockingData<double>& at, double t, const double* y, const double* block);
  /// Prepare solve() for this g [s]. @return false if 1/g - A has no inverse. @pre build()
  bool factor(double g);
  /// x := (1/g - A)^-1 x, for all states
  void solve(double* x);

 private:
  /// A vehicle that moves.
  struct Vehicle {
    int pose = -1, momentum = -1;  ///< as in StateLayout
    Mat3<double> R;                ///< its axes to those of O
    Vec4<double> q;                ///< the same as it stands in y
    Mat6<double> N;                ///< nu by its motion (v, w), body axes
    Mat6<double> to_motion;        ///< its motion by its momentum as it stands in y
    Mat6<double> W;                ///< nu by that momentum: N to_motion
  };
  /// A joint between a body and the vehicle, and its velocities among those of the tree.
  struct Joint {
    int body, v_index, count;
    int column;  ///< among the velocities of the mechanism; -1 if a loop determines it
  };
  /// What acts between P and one body.
  struct Load {
    std::vector<Joint> joint;  ///< from the body inwards
    bool follows_loops = false;
    // written by build(); without `acts`, only the tangent
    InterfaceTangent tangent;
    bool acts = false;    ///< K or C is not zero
    MatX<double> motion;  ///< 6 x n: of the body by v_m, at the origin of G, axes of G
    MatX<double> N_m, N;  ///< 6 x n: nu by v_m, at fixed v_c and at fixed p_c
    MatX<double> B;       ///< n x 6
    // written by factor()
    Mat6<double> G;  ///< C + g K
  };
  Load make_load(const DockingModel& model, int body) const;
  void build_vehicle(const DockingModel& model, int i, const DockingData<double>& at,
                     const double* y);
  void build_mechanism(const DockingModel& model, const DockingData<double>& at);
  void build_tangents(const DockingModel& model, const DiscreteState& discrete,
                      const ContactMemory& memory, const DockingData<double>& at, double t);
  void calc_motion(const DockingModel& model, const DockingData<double>& at, Load& load);

  // of the model
  StateLayout layout_;
  int n_;                      ///< velocities of the mechanism
  int all_;                    ///< with the bristles of brakes and locks
  int skipped_;                ///< the chaser's velocities, which precede them in A_ind
  std::vector<Load> load_;     ///< as bodies of ContactModel; then that across A and P, if any
  std::vector<char> is_free_;  ///< joints of the mechanism's velocities: free, or single
  std::vector<Vec4<double>> joint_q_;  ///< attitudes of the free ones, as they stand in y
  // written by build()
  bool locked_ = false;  ///< the mechanism rests
  bool joined_ = false;  ///< a rigid joint holds the target
  std::array<Vehicle, 2> vehicle_;
  Mat6<double> to_O_;       ///< P: F to force and moment about the origin of O
  Mat6<double> mobility_;   ///< M: nu by F through both momenta
  MatX<double> carried_;    ///< 6 x n: A_cc^-1 A_cm
  MatX<double> J_;          ///< all velocities x 6: scratch, J_G^T
  MatX<double> L_x_, L_s_;  ///< of the mechanism block
  TreeData<double> tree_;   ///< scratch: velocities that go with one
  // written by factor()
  double g_ = 0.0;
  MatX<double> matrix_;  ///< for s and the loads
  SmallLu<double> lu_;
  VecX<double> twist_, unknown_;  ///< of v_m; s and the loads
};

}  // namespace dockloop
