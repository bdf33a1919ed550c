// Commands to the hard dock: hooks, pushers, rigid joint.
#include <cstdio>

#include "sim/sim_impl.hpp"

namespace dockloop {

/// Why chaser and target cannot become one body; null if they can.
const char* DockingSim::Impl::find_joint_obstacle() const {
  if (!model->moves[kChaser] || !model->moves[kTarget]) {
    return "a rigid joint needs two vehicles that move: set chaser.motion and target.motion to "
           "free";
  }
  if (model->has_record()) {
    return "a rigid joint needs vehicles that no record moves: let hooks hold them";
  }
  if (host->has_host()) {
    return "a rigid joint needs vehicles that no host moves: set chaser.motion and target.motion "
           "to "
           "free";
  }
  if (model->mechanism.plan.is_driven) {
    return "a rigid joint holds the mechanism, but a coupling prescribes the motion of a joint";
  }
  if (model->mechanism.model.part_forces > 0 || model->target) {
    return "a rigid joint holds two rigid vehicles, but one has parts that move: "
           "let hooks hold them, or remove parts and adapters";
  }
  if (equations) {
    return "a rigid joint needs the reduced form of the equations: set model.level = 3 (reduced)";
  }
  return nullptr;
}

/// Carry out a command at an accepted state. @pre evaluate(tau) @post the same
Status DockingSim::Impl::command(HardDockCommand command, double tau) {
  const double now = elapsed + tau;
  HardDockState& dock = discrete.hard_dock;
  kept_jacobian.valid = false;
  switch (command) {
    case HardDockCommand::kNone:
      return {};
    case HardDockCommand::kCloseHooks:
      close_hooks(dock);
      update_hooks(now);
      break;
    case HardDockCommand::kOpenHooks:
      open_hooks(model->hard_dock, now, dock);
      break;
    case HardDockCommand::kPushersOn:
    case HardDockCommand::kPushersOff:
      switch_pushers(model->hard_dock, command == HardDockCommand::kPushersOn, now, dock);
      break;
    case HardDockCommand::kJoin:
    case HardDockCommand::kRelease:
      dock.wants_joint = command == HardDockCommand::kJoin;
      return update_joint(tau);
  }
  return evaluate(tau);
}

/// Makes or opens the rigid joint if that is asked for. @pre evaluate(tau) @post the same
Status DockingSim::Impl::update_joint(double tau) {
  const HardDockState& dock = discrete.hard_dock;
  if (dock.wants_joint == dock.joint.on) return {};
  return dock.wants_joint ? join_rigidly(tau) : release_joint(tau);
}

/// Chaser, mechanism and target become one body in their present relative pose. Momenta stay; the
/// kinetic energy of relative motion is dissipated.
Status DockingSim::Impl::join_rigidly(double tau) {
  if (find_joint_obstacle()) return {StatusCode::kCannotJoin, -1, 0.0, elapsed + tau};
  const double before = find_kinetic_energy(*model, present());
  const FrameMotion<double>&chaser = present().vehicle[kChaser],
        &target = present().vehicle[kTarget];
  discrete.hard_dock.joint = {true, chaser.R.transpose() * target.R,
                              chaser.R.transpose() * (target.p - chaser.p)};
  quiescent.on = false;
  double* y = step_loop->y();
  std::fill_n(y + model->layout.mechanism_v, model->layout.mechanism_nv, 0.0);
  quiescent_mode->restore(y);
  Status status = evaluate(tau);
  if (!status.ok()) return status;
  put_joined_target();
  status = evaluate(tau);
  y[model->layout.sums + kSumHardDock] += before - find_kinetic_energy(*model, present());
  return status;
}

/// All bodies keep the common motion.
Status DockingSim::Impl::release_joint(double tau) {
  put_joined_target();
  discrete.hard_dock.joint = RigidJoint();
  quiescent.on = false;
  quiescent_mode->restore(step_loop->y());
  return evaluate(tau);
}

/// While the joint is rigid: pose and momentum of the target follow from the motion of the chaser.
/// @pre evaluate
void DockingSim::Impl::put_joined_target() {
  if (!discrete.hard_dock.joint.on) return;
  dockloop::put_joined_target(*model, quiescent_mode->locked(), present().vehicle[kChaser],
                              step_loop->y());
  evaluator->forget_present();
}

bool DockingSim::Impl::update_hooks(double now) {
  return events->update_hooks(present(), now, find_clock_rounding(now));
}

/// Does the command of the host differ from the last one?
bool DockingSim::Impl::is_hard_dock_command_new() const {
  return !model->hard_dock.empty() &&
         static_cast<HardDockCommand>(inputs.hard_dock_command) != discrete.hard_dock.command;
}

/// A command of the host that differs from the last one. @pre evaluate_start(). @post the same
Status DockingSim::Impl::update_hard_dock_command() {
  if (!is_hard_dock_command_new()) return {};
  const auto wanted = static_cast<HardDockCommand>(inputs.hard_dock_command);
  discrete.hard_dock.command = wanted;
  const Status status = command(wanted, 0.0);
  if (!status.ok()) return status;
  peaks.begin(elapsed, find_peak_values());
  return fmi_kind == FmiKind::kCoSimulation ? evaluate_start() : Status();
}

}  // namespace dockloop
