// The public functions; saving and restoring the complete state.
#include "sim/docking_sim.hpp"

#include <algorithm>
#include <cmath>

#include "sim/sim_impl.hpp"

namespace dockloop {
namespace {

/// All that outputs() has: what is read of a state and its evaluation.
constexpr OutputGroup kReadGroups[] = {OutputGroup::kMain, OutputGroup::kMomentum,
                                       OutputGroup::kLoops, OutputGroup::kStack};

}  // namespace

DockingSim::DockingSim(std::shared_ptr<const Scene> scene, FmiKind fmi_kind,
                       const Comparison* comparison)
    : impl_(new Impl(std::move(scene), fmi_kind, comparison)) {}
DockingSim::~DockingSim() = default;
const Scene& DockingSim::scene() const { return *impl_->scene; }
std::shared_ptr<const Scene> DockingSim::shared_scene() const { return impl_->scene; }
FmiKind DockingSim::fmi_kind() const { return impl_->fmi_kind; }
bool DockingSim::has_comparison() const { return impl_->comparison != nullptr; }
Parameters& DockingSim::parameters() { return impl_->parameters; }
Inputs& DockingSim::inputs() { return impl_->inputs; }
Inputs& DockingSim::input_slopes() { return impl_->slopes; }
const std::string& DockingSim::status_text() const { return impl_->status_text; }
Outputs& DockingSim::output_storage() { return impl_->outputs; }
void DockingSim::invalidate_outputs() { impl_->invalidate(); }
void DockingSim::state_error(std::optional<double> relative) {
  impl_->measured_error = relative;
  impl_->valid[static_cast<size_t>(OutputGroup::kMain)] = false;
}
void DockingSim::initialise(double t0, double tolerance) { impl_->initialise(t0, tolerance); }
Status DockingSim::step(double t, double h) { return impl_->step(t, h); }
void DockingSim::reset() { impl_->clear(); }
void DockingSim::use_interruption(std::function<bool()> asks) {
  impl_->interruption = std::move(asks);
}
void DockingSim::use_kernels(std::shared_ptr<const KernelLibrary> library) {
  impl_->kernels = std::move(library);
}

const std::string& DockingSim::choice_text() const { return impl_->choice_text; }
std::string DockingSim::left_out_text() const { return impl_->describe_left_out(); }

std::vector<std::string> DockingSim::take_warnings() {
  std::vector<std::string> taken;
  taken.swap(impl_->warnings);
  return taken;
}

Status DockingSim::update(OutputGroup group) {
  bool& valid = impl_->valid[static_cast<size_t>(group)];
  if (valid || !impl_->setup) return {};
  Status status;
  if (group == OutputGroup::kCoupling) status = update(OutputGroup::kMain);
  if (status.ok()) status = impl_->update(group);
  valid = status.ok();
  if (valid && group == OutputGroup::kMain) ++impl_->read_points;
  return status;
}

const Outputs& DockingSim::outputs() {
  for (OutputGroup group : kReadGroups) update(group);
  return impl_->outputs;
}

std::string DockingSim::describe(const Status& status) const { return impl_->describe(status); }

void DockingSim::adopt_tunables() { impl_->adopt_tunables(); }

bool offers_model_exchange(const Scene& scene) {
  return scene.motion[kChaser] != Motion::kDriven &&
         !(scene.has_target && scene.motion[kTarget] == Motion::kDriven);
}

// ---------------------------------------------------------------- saving and restoring

void DockingSim::save(SavedSim& into) const { impl_->save(into); }
void DockingSim::load(const SavedSim& from) { impl_->load(from); }

/// @post restore(into) restores this state. Allocates only if `into` was never used.
/// @param with_pose  if false, `into` holds the accepted configuration of the loops already
void DockingSim::Impl::keep(Snapshot& into, bool with_pose) const {
  reserve(into.state.memory, memory, model->contact);
  reserve(into.state.ahead.context.memory, ahead.context.memory, model->contact);
  into.state = *this;
  into.y.assign(step_loop->accepted_y(), step_loop->accepted_y() + model->layout.size);
  if (with_pose) into.reference = present().mechanism.loops.reference;
}

/// @return not ok if a pending step cannot be made again, which happens to damaged states only
Status DockingSim::Impl::restore(const Snapshot& from) {
  if (coordinates != from.state.coordinates) use_coordinates(from.state.coordinates);
  static_cast<SimState&>(*this) = from.state;
  use_host_bodies();
  std::copy(from.y.begin(), from.y.end(), step_loop->y());
  evaluator->use_reference(from.reference);
  quiescent_mode->restore(step_loop->y());
  evaluator->forget_present();
  pose_is_kept = false;
  invalidate();
  return ahead.pending ? step_loop->remake_pending() : Status();
}

void DockingSim::Impl::save(SavedSim& into) const {
  into.parameters = parameters;
  into.inputs = inputs;
  into.slopes = slopes;
  into.setup = setup;
  if (!setup) return;
  keep(into.snapshot);
  into.counters = step_loop->find_counters();
}

namespace {

/// Equal sizes: the saved state was made by the same model.
bool have_same_shape(const LoopReference<double>& r, const LoopReference<double>& s) {
  return r.valid == s.valid && have_same_sizes(r, s);
}

bool have_same_shape(const Snapshot& a, const Snapshot& b) {
  return a.y.size() == b.y.size() && a.state.quiescent.q.size() == b.state.quiescent.q.size() &&
         a.state.kept_jacobian.entries.size() == b.state.kept_jacobian.entries.size() &&
         have_same_shape(a.reference, b.reference);
}

/// The list of a body has an entry per pair of it, and contains its pairs only.
bool fits(const NeighbourList& list, const ActiveBody& body) {
  return (!list.has_reference || list.gap.size() == static_cast<size_t>(body.count)) &&
         list.near_gap.size() == list.near.size() && list.searched >= 0 &&
         list.searched <= 2 * body.count &&
         std::all_of(list.near.begin(), list.near.end(),
                     [&](int i) { return i >= body.first && i < body.first + body.count; });
}

bool fits(const ContactMemory& memory, const ContactModel& contact) {
  if (memory.lists.empty() && memory.closed.empty()) return true;
  return memory.closed.size() == contact.pairs.size() &&
         memory.n_last.size() == contact.pairs.size() &&
         std::equal(memory.lists.begin(), memory.lists.end(), contact.bodies.begin(),
                    contact.bodies.end(),
                    [](const auto& list, const auto& body) { return fits(list, body); });
}

bool are_modes(const DiscreteState& discrete) {
  const bool named = discrete.phase >= kApproach && discrete.phase <= kPhases.back().number &&
                     discrete.outcome >= kUndecided && discrete.outcome <= kOutcomes.back().number;
  const auto is_mode = [](const HookRowState& row) {
    return row.mode >= HookMode::kOpen && row.mode <= HookMode::kOpening;
  };
  const Mat3<double>& turn = discrete.hard_dock.joint.R;
  const bool is_turn = (turn * turn.transpose()).isIdentity(1e-6) && turn.determinant() > 0.0;
  const int command = static_cast<int>(discrete.hard_dock.command);
  return named && is_turn && command >= 1 && command <= kHardDockCommands.back().number &&
         std::all_of(discrete.hard_dock.row.begin(), discrete.hard_dock.row.end(), is_mode) &&
         std::all_of(discrete.latch.begin(), discrete.latch.end(), [](const LatchState& latch) {
           return latch.mode >= LatchMode::kOpen && latch.mode <= LatchMode::kSpent;
         });
}

bool are_rows(const DiscreteState& discrete, const DockingModel& model) {
  const std::vector<int>& row = discrete.input_row;
  bool fine = row.size() == model.inputs.size();
  for (size_t k = 0; fine && k < row.size(); ++k) {
    fine = row[k] >= -1 && row[k] < static_cast<int>(model.inputs[k].time.size());
  }
  return fine;
}

/// Steps and settings exist, and the command has a meaning.
bool fits(const DiscreteState& discrete, int command, const DockingModel& model) {
  const SequenceState& s = discrete.sequence;
  const std::vector<ForceElement>& elements = model.mechanism.model.elements;
  const bool none = model.sequence.empty();
  const size_t laws = none ? 0 : static_cast<size_t>(count_laws(elements));
  const size_t locks = none ? 0 : elements.size();
  const size_t failures = none ? 0 : model.mechanism.model.failures.size();
  const int steps = std::max(1, static_cast<int>(model.sequence.steps.size()));
  const auto is_step = [&](int step) { return step >= 0 && step < steps; };
  const auto is_command = [](int number) {
    return number >= kNoCommand && number <= kCommands.back().number;
  };
  const auto is_queue = [](const LateSettings& late) {
    return late.count >= 0 && late.count <= kMaxUnderWay;
  };
  const int known = 1 << model.disturbances.size();
  return discrete.law.size() == laws && discrete.lock.size() == locks &&
         discrete.late.size() == failures &&
         std::all_of(discrete.late.begin(), discrete.late.end(), is_queue) &&
         discrete.entered.size() == model.sequence.steps.size() && discrete.disturbances >= 0 &&
         discrete.disturbances < known && is_step(s.step) && is_command(s.command) &&
         is_command(command) && s.outcome >= 0 && s.outcome <= kOutcomes.back().number &&
         s.changes >= 0 && s.changes <= kMaxChanges && are_rows(discrete, model) &&
         std::all_of(s.visited.begin(), s.visited.end(), is_step);
}

/// Queues of loads are as long as those of this model, and hold no more than fits.
bool fits(const CouplingState& coupling, const CouplingState& fresh, const Scene& scene) {
  const auto is_queue = [](const LoadQueue& a, const LoadQueue& b) {
    const int size = static_cast<int>(a.entry.size());
    return a.entry.size() == b.entry.size() && a.count >= std::min(size, 1) && a.count <= size;
  };
  const auto have_places = [](const ReportSums& a, const ReportSums& b) {
    return a.held.size() == b.held.size() && a.force.late.size() == b.force.late.size() &&
           a.torque.late.size() == b.torque.late.size();
  };
  bool fine = coupling.reports.size() == fresh.reports.size();
  for (size_t i = 0; fine && i < coupling.vehicle.size(); ++i) {
    const DrivenVehicle &a = coupling.vehicle[i], &b = fresh.vehicle[i];
    fine =
        is_queue(a.queue, b.queue) && is_queue(a.known, b.known) &&
        (fresh.reports.empty() || have_places(coupling.reports[i], fresh.reports[i])) &&
        (b.body.mass == 0.0 || (can_be_rigid(a.body) && can_carry_modes(a.body, scene.parts[i])));
  }
  return fine;
}

/// Assembly branches are signs.
bool are_branches(const LoopReference<double>& reference) {
  const auto is_sign = [](int sign) { return sign == 1 || sign == -1; };
  return std::all_of(reference.branch.begin(), reference.branch.end(),
                     [&](const LegBranch& b) { return is_sign(b.elbow) && is_sign(b.flip); });
}

/// Is there all that a pending step, or the next one, is made of?
bool fits(const RunAhead& ahead, const Snapshot& all, const DockingModel& model) {
  const auto commands = count_commands(model.mechanism.model);
  if (ahead.loads.command.size() != commands || ahead.mean_known.command.size() != commands) {
    return false;
  }
  if (!ahead.pending) return ahead.reached == 0.0;
  return ahead.reached >= ahead.begin && ahead.size >= 0.0 && ahead.last_error > 0.0 &&
         are_modes(ahead.context.discrete) &&
         fits(ahead.context.discrete, ahead.context.discrete.sequence.command, model) &&
         fits(ahead.context.memory, model.contact) && are_branches(ahead.context.reference) &&
         have_same_shape(ahead.context.reference, all.reference) &&
         ahead.jacobian.entries.size() == all.state.kept_jacobian.entries.size();
}

}  // namespace

/// Build the model of a saved state, which has other parameters or comes from another process.
/// @throws ModelError if they do not fit
void DockingSim::Impl::build_for(const SavedSim& from) {
  inputs = from.inputs;
  start(from.setup);
  if (from.snapshot.state.coordinates) use_coordinates(from.snapshot.state.coordinates);
  Snapshot fresh;
  keep(fresh);
  fresh.reference.valid = from.snapshot.reference.valid;
  if (!have_same_shape(fresh, from.snapshot) || !fits(from.snapshot.state.memory, model->contact) ||
      !from.snapshot.state.peaks.is_valid() || !(from.snapshot.state.inner_step > 0.0) ||
      !are_modes(from.snapshot.state.discrete) ||
      !fits(from.snapshot.state.discrete, from.inputs.command, *model) ||
      !fits(from.snapshot.state.coupling, fresh.state.coupling, *scene) ||
      !are_branches(from.snapshot.reference) ||
      !fits(from.snapshot.state.ahead, from.snapshot, *model) ||
      (from.snapshot.state.ahead.pending && !step_loop->method().runs_ahead)) {
    throw ModelError("the saved state does not fit this model");
  }
  warnings.clear();  // already issued when the state was made
}

/// Whose attitude in y is not as it should be; empty: all are.
std::string DockingSim::Impl::find_other_attitude(const double* y,
                                                  bool (*is_right)(const Vec4<double>&)) const {
  const auto fits = [&](int at) { return is_right({y[at], y[at + 1], y[at + 2], y[at + 3]}); };
  for (int i : {kChaser, kTarget}) {
    const int pose = model->layout.pose[i];
    if (pose >= 0 && !fits(pose + 3)) return get_vehicle_name(i);
  }
  int q = model->layout.mechanism_q;
  for (int i : model->mechanism_bodies) {
    const Body& body = model->mechanism.model.bodies[i];
    if (body.joint == JointType::kFree && !fits(q + 3)) return "body '" + body.name + "'";
    q += body.nq();
  }
  return {};
}

/// Check a state restored from bytes: unit quaternions, and finite results of an evaluation.
/// @throws ModelError
void DockingSim::Impl::check_restored() {
  const auto is_right = fmi_kind == FmiKind::kModelExchange ? has_direction : is_attitude;
  if (const std::string name = find_other_attitude(step_loop->accepted_y(), is_right);
      !name.empty()) {
    throw ModelError("the saved state is damaged: the attitude of " + name +
                     " is not a unit quaternion");
  }
  Status status = update_states();
  for (OutputGroup group : kReadGroups) {
    if (status.ok()) status = update(group);
  }
  if (!status.ok()) {
    throw ModelError("the saved state is damaged: " + describe(status));
  }
  for_each_value<double>(outputs, [](double value) {
    if (!std::isfinite(value)) {
      throw ModelError("the saved state is damaged: an evaluation of it is not finite");
    }
  });
  invalidate();
}

/// Load the complete state into its model.
void DockingSim::Impl::take(const SavedSim& from) {
  parameters = from.parameters;
  if (from.setup) use_tunables();
  inputs = from.inputs;
  slopes = from.slopes;
  setup = from.setup;
  invalidate();
  if (!setup) return;
  const Status status = restore(from.snapshot);
  if (!status.ok()) throw ModelError("the saved state is damaged: " + describe(status));
  step_loop->set_counters(from.counters);
}

void DockingSim::Impl::load(const SavedSim& from) {
  if (!have_same_sizes(from.inputs, inputs) || !have_same_sizes(from.slopes, inputs) ||
      !have_same_sizes(from.parameters, parameters) ||
      (from.setup && !have_same_sizes(from.setup->parameters, parameters))) {
    throw ModelError("the saved state does not fit this model");
  }
  const bool rebuild = from.setup && from.setup != setup;
  parameters_before = parameters;
  SavedSim before;
  if (rebuild) save(before);
  try {
    if (rebuild) build_for(from);
    take(from);
    if (rebuild) check_restored();
  } catch (...) {
    parameters = parameters_before;
    if (rebuild) {
      setup.reset();
      if (before.setup) start(before.setup);
      take(before);
      warnings.clear();
    }
    throw;
  }
}

/// Do parameters that may be changed during a run have other values than the model?
bool DockingSim::Impl::are_tunables_new() const {
  const ContactLaw &last = model->contact.law, law = make_contact_law(last);
  const bool same_law = model->contact.empty() ||
                        (law.friction_coefficient == last.friction_coefficient &&
                         law.friction_model == last.friction_model && law.damping == last.damping);
  return !same_law || parameters.contact_thrust != model->thrust ||
         parameters.contact_thrust_delay != model->thrust_delay;
}

/// Take over these parameters. The step to the communication point still has their last values.
void DockingSim::Impl::adopt_tunables() {
  if (ahead.pending && !are_tunables_new()) return;
  if (are_tunables_new() && !model->contact.empty()) {
    ContactModel tried = model->contact;
    set_law(tried, make_contact_law(tried.law));  // may throw, before anything changes
  }
  if (ahead.pending) settle_for_parameters();
  use_tunables();
}

/// Other values make a new model.
void DockingSim::Impl::use_tunables() {
  use_stated_masses();
  if (are_tunables_new()) {
    const auto changed = std::make_shared<DockingModel>(*model);
    if (!changed->contact.empty()) {
      set_law(changed->contact, make_contact_law(changed->contact.law));  // may throw
    }
    changed->thrust = parameters.contact_thrust;
    changed->thrust_delay = parameters.contact_thrust_delay;
    use_model(changed);
  }
  evaluator->forget_present();
  kept_jacobian.valid = false;
  update_outside_loads(0.0);
}

/// From now on the equations are those of a changed copy of the model. The layout of the state is
/// the same.
void DockingSim::Impl::use_model(std::shared_ptr<DockingModel> changed) {
  events->use_model(*changed);
  evaluator->use_model(changed);
  quiescent_mode->use_model(*changed);
  host->use_model(*changed);
  step_loop->use_model(*changed);
  model = std::move(changed);
}

}  // namespace dockloop
