// The unreduced model: the docking in all coordinates of the tree, with multipliers for the loops.
// Differential-algebraic equations, for comparison with the reduction.
//
// Unknowns z (UnreducedModel): the state y (docking_model.hpp), then the unknowns that the
// reduction eliminates: dependent coordinates and velocities, the velocity of the chaser, cut
// forces lambda, and mu. Equations, 0 = residual(t, z, zdot), with G v the rate of the gaps of the
// cuts:
//
//   coordinates   q' = v (+ G^T mu)
//   velocities    M v' + bias - tau - G^T lambda = 0        by inverse dynamics of the tree
//   chaser        momentum of all bodies = momentum states  (its velocity is algebraic)
//   the rest      as in calc_docking(): momenta stay plain sums of forces
//   cuts          one of three forms, DaeForm
//
// The cut equations are those of the plan: redundant ones are left out, so that multipliers are
// unique. Cuts do not depend on the chaser, because they are relative to bodies on it.
#pragma once

#include "docking/docking_model.hpp"

namespace dockloop {

/// Equations of the cuts; values of solver.dae_form.
enum class DaeForm {
  kIndex1 = 1,      ///< accelerations: G v' + gamma = 0; a gap remains
  kBaumgarte = 2,   ///< the same with damping and stiffness on gap rate and gap
  kStabilised = 3,  ///< velocities by lambda and positions by mu (Gear, Gupta, Leimkuhler 1985)
};

/// Time constant of kBaumgarte, critically damped: gap'' + 2/tau gap' + gap/tau^2 = 0 [s]. A few
/// steps of the integrator: gaps close quickly, without additional stiffness.
constexpr double kBaumgarteTime = 0.01;

/// Places of the unknowns in z.
struct UnreducedModel {
  UnreducedModel(const DockingModel& model, DaeForm form);
  DaeForm form;
  int head = 0;              ///< size of y, which comes first
  int q_dep = 0, v_dep = 0;  ///< dependents, in the order of the blocks
  int v_chaser = 0;          ///< 6 if the chaser moves
  int lambda = 0, mu = 0;    ///< multipliers, last; mu for kStabilised only
  int cuts = 0;              ///< equations of cuts, and dependents
  int size = 0;
  std::vector<int> dep_q, dep_v;                                 ///< their indices in the tree
  std::vector<std::vector<std::array<int, kMaxEquations>>> row;  ///< per block and loop
  std::vector<double> rate;  ///< per cut equation: that of a drive
};

struct UnreducedData {
  UnreducedData(const DockingModel& model, const UnreducedModel& unreduced);
  DockingData<double> docking;     ///< tree and forces; no reduced quantities
  MatX<double> G;                  ///< cuts x nv
  VecX<double> gap, bias;          ///< of the cuts
  VecX<double> flow;               ///< nv: velocities of the coordinates
  VecX<double> missing;            ///< nv: residual forces of the equations of motion
  VecX<double> rates;              ///< scratch: as ydot
  std::vector<int> all_columns;    ///< 0, 1, ... nv - 1
  VecX<double> z, zdot, residual;  ///< scratch of the Jacobian
};

Status calc_unreduced_residual(const DockingModel& model, const UnreducedModel& unreduced,
                               const DiscreteState& discrete, const ContactMemory& memory,
                               const Loads& loads, double t, const double* z, const double* zdot,
                               double* residual, UnreducedData& data);

/// d residual / d z + alpha d residual / d zdot, by columns: multipliers and sums exactly, other
/// columns by differences. @param nominal  size of each unknown, for the differences
Status calc_unreduced_jacobian(const DockingModel& model, const UnreducedModel& unreduced,
                               const DiscreteState& discrete, const ContactMemory& memory,
                               const Loads& loads, double t, double alpha, const double* z,
                               const double* zdot, const double* residual,
                               const VecX<double>& nominal, double* by_columns,
                               UnreducedData& data);

/// Number of residual evaluations of a Jacobian.
int find_unreduced_jacobian_cost(const DockingModel& model, const UnreducedModel& unreduced);

/// The other unknowns of z and zdot from y and its rates, with closed loops.
/// @param reduced  of calc_docking() at y, with rates
void complete_unreduced_state(const DockingModel& model, const UnreducedModel& unreduced,
                              DockingData<double>& reduced, double* z, double* zdot);

/// Largest gap of the cuts [m].
double find_cut_gap(const DockingModel& model, const UnreducedModel& unreduced, double t,
                    const double* z, UnreducedData& data);

}  // namespace dockloop
