// Exact derivatives of the whole docking with respect to state, loads and time.
//
// calc_docking() runs with dual numbers (math/dual.hpp), eight directions at a time. A pass takes
// three steps. All computed values have derivatives, not only the rates:
//
//   start_docking_pass(model, loads, t, y, pass);                          values; nothing varies
//   pass.y[i].d[0] = 1;  pass.loads.force[kTarget][2].d[1] = 1;  pass.t.d[2] = 1;   the directions
//   calc_docking_pass(model, discrete, memory, at, pass);
//   pass.ydot[j].d[0], pass.data.on_passive.f[0].d[1], pass.data.latch.force[0].d[2], ...
//
// A direction may mix components: seeds are weights. Derivatives belong to the branch taken. At
// kinks (a surface just in contact, a striker just at the pawl) they are one-sided. Lengths without
// a derivative (a point on an axis, no sliding) enter only by their squares. The gap of surfaces
// without contact is a bound; its derivative is the derivative of the bound.
#pragma once

#include "docking/docking_model.hpp"
#include "math/scalar.hpp"

namespace dockloop {

/// Inputs and results of one pass; sized by the constructor, no later allocation. Make a new object
/// when the model changes its independent coordinates.
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

/// Puts a displacement along one velocity of the mechanism into one lane of a state.
void seed_displacement(const DockingModel& model, const double* y, int direction, int lane,
                       std::vector<Derivative>& seeded);

/// @param at  a plain evaluation (calc_docking) of the same state: start pose and branches of the
///            loops. From a pose nearby a Newton closure needs more iterations.
Status calc_docking_pass(const DockingModel& model, const DiscreteState& discrete,
                         const ContactMemory& memory, const DockingData<double>& at,
                         DockingPass& pass);

/// Rates by states, d ydot / d y: square, sized by the caller. No rate depends on sums
/// and impulses; their columns are zero and cost nothing. So are those of bristles of contacts
/// where they are not wanted: there may be hundreds.
Status calc_docking_jacobian(const DockingModel& model, const DiscreteState& discrete,
                             const ContactMemory& memory, const DockingData<double>& at,
                             const Loads& loads, double t, const double* y, DockingPass& pass,
                             MatX<double>& jacobian, bool with_contact_bristles = true);

}  // namespace dockloop
