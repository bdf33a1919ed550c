// Exact derivatives of the whole docking by its state, its loads and time.
//
// calc_docking() itself runs with dual numbers (math/dual.hpp), eight directions (lanes) at a time.
// A pass takes three steps, and whatever it computes can be read, not only the rates:
//
//   start_docking_pass(model, loads, t, y, pass);                          values; nothing varies
//   pass.y[i].d[0] = 1;  pass.loads.force[kTarget][2].d[1] = 1;  pass.t.d[2] = 1;   the directions
//   calc_docking_pass(model, discrete, memory, at, pass);
//   pass.ydot[j].d[0], pass.data.on_passive.f[0].d[1], pass.data.latch.force[0].d[2], ...
//
// A direction may mix components: seeds are weights. Derivatives are those of the branch taken: at
// kinks (a surface just touched, a striker just at the pawl) they are one-sided. Where a point lies
// on an axis or nothing slides, lengths that have no derivative enter only by their squares.
// The gap of surfaces that are apart is a bound, and so is its derivative.
#pragma once

#include "docking/docking_model.hpp"
#include "math/scalar.hpp"

namespace dockloop {

/// Inputs and results of one pass; sized by the constructor, nothing below allocates. To be made
/// again when the model changes its independent coordinates.
struct DockingPass {
  explicit DockingPass(const DockingModel& model);
  Derivative t = 0.0;  ///< [s]
  ExternalLoads<Derivative> loads;
  std::vector<Derivative> y, ydot;
  DockingData<Derivative> data;  ///< written by calc_docking_pass
};

/// Values in, all derivatives zero.
void start_docking_pass(const DockingModel& model, const Loads& loads, double t, const double* y,
                        DockingPass& pass);

/// @param at  a plain evaluation (calc_docking) of the same state: loops are closed from its pose,
///            on its branches. From a pose nearby a Newton closure needs more iterations.
Status calc_docking_pass(const DockingModel& model, const DiscreteState& discrete,
                         const ContactMemory& memory, const DockingData<double>& at,
                         DockingPass& pass);

/// Rates by states, d ydot / d y: square, sized by the caller. Nothing depends on the sums and
/// impulses among the states; their columns are zero and cost nothing.
Status calc_docking_jacobian(const DockingModel& model, const DiscreteState& discrete,
                             const ContactMemory& memory, const DockingData<double>& at,
                             const Loads& loads, double t, const double* y, DockingPass& pass,
                             MatX<double>& jacobian);

}  // namespace dockloop
