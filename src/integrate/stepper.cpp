// What all methods have in common: retries and roots. Roots are searched here, on the dense output
// of the last step: the search of SUNDIALS remembers, beyond a reset, that there was a root once,
// and a run restored in a fresh integrator would not give the same bits.
#include "integrate/stepper.hpp"

#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "integrate/runge_kutta.hpp"
#include "integrate/solver.hpp"

namespace dockloop {

// ---------------------------------------------------------------- the problem for SUNDIALS

System::System(Stepper::Problem p) : problem(std::move(p)) {
  check(SUNContext_Create(nullptr, &context));
  y = make_vector();
  atol = problem.unknowns > 0 ? N_VNew_Serial(problem.unknowns, context) : make_vector();
  if (!atol) throw std::runtime_error("SUNDIALS vectors cannot be allocated");
  N_VConst(0.0, y);
  N_VConst(1e-8, atol);
}

System::~System() {
  if (y) N_VDestroy(y);
  if (atol) N_VDestroy(atol);
  if (context) SUNContext_Free(&context);
}

N_Vector System::make_vector() const {
  const N_Vector vector = N_VNew_Serial(problem.size, context);
  if (!vector) throw std::runtime_error("SUNDIALS vectors cannot be allocated");
  return vector;
}

DenseSolver::DenseSolver(const System& system, N_Vector like)
    : matrix(SUNDenseMatrix(NV_LENGTH_S(like), NV_LENGTH_S(like), system.context)) {
  if (matrix) linear = SUNLinSol_Dense(like, matrix, system.context);
  if (linear) return;
  if (matrix) SUNMatDestroy(matrix);
  throw std::runtime_error("a dense solver of SUNDIALS cannot be allocated");
}

DenseSolver::~DenseSolver() {
  SUNLinSolFree(linear);
  SUNMatDestroy(matrix);
}

void System::check(int flag) {
  if (flag < 0) throw std::runtime_error("SUNDIALS refused a setting");
}

int System::calc_rates(double t, const double* state, double* ydot) {
  if (idle) {
    std::fill_n(ydot, problem.size, 0.0);
    return 0;
  }
  if (!spend(1)) return kGiveUp;
  return note(problem.rates(t, state, ydot));
}

int System::call_rates(realtype t, N_Vector y, N_Vector ydot, void* system) {
  return static_cast<System*>(system)->calc_rates(t, NV_DATA_S(y), NV_DATA_S(ydot));
}

int System::call_jacobian(realtype t, N_Vector y, N_Vector, SUNMatrix jacobian, void* system,
                          N_Vector, N_Vector, N_Vector) {
  System& me = *static_cast<System*>(system);
  if (me.idle) return SUNMatZero(jacobian);
  if (me.known_jacobian) {
    std::copy_n(me.known_jacobian, me.problem.size * me.problem.size, SM_DATA_D(jacobian));
    me.known_jacobian = nullptr;
    return 0;
  }
  if (!me.spend(me.problem.jacobian_cost)) return kGiveUp;
  return me.note(me.problem.jacobian(t, NV_DATA_S(y), SM_DATA_D(jacobian)));
}

namespace {

std::unique_ptr<Solver> make_solver(System& system, Stepper::Method method) {
  if (system.problem.solver) return system.problem.solver(system);
  switch (method) {
    case Stepper::Method::kDormandPrince:
      return make_explicit_solver(system, get_dormand_prince());
    case Stepper::Method::kStabilised:
      return make_explicit_solver(system, get_dormand_prince(), get_stabilised());
    case Stepper::Method::kClassicRk4:
      return make_explicit_solver(system, get_classic());
    case Stepper::Method::kRosenbrock:
      return make_rosenbrock_solver(system, true);
    case Stepper::Method::kSwitching:
      return make_switching_solver(system);
    case Stepper::Method::kFixedRosenbrock:
      return make_rosenbrock_solver(system, false);
    case Stepper::Method::kBdf:
      return make_bdf_solver(system);
  }
  throw std::logic_error("no such method");
}

}  // namespace

// ---------------------------------------------------------------- the stepper

struct Stepper::Impl {
  System system;
  std::unique_ptr<Solver> solver;
  double t = 0.0;
  double h_restart = 0.0;
  bool restarted = true;  // no step was made since restart()
  std::int64_t idle_steps = 0;
  /// Event functions at a time, and how fast they may change.
  struct Probe {
    double t = 0.0;
    std::vector<double> value, speed;
  };
  Probe low, high, middle;  // at both ends of a step, and inside
  bool low_valid = false;   // low is that of the present state
  static constexpr size_t kMostProbes = 24;
  std::array<Probe, kMostProbes> probes;  // in the order of time, first and last at both ends
  N_Vector y_inside = nullptr;
  std::vector<char> root_info;
  std::vector<double> y_before;

  Impl(Problem p, Method method) : system(std::move(p)), solver(make_solver(system, method)) {
    const size_t roots = static_cast<size_t>(system.problem.root_count);
    root_info.assign(roots, 0);
    low.value.assign(roots, 0.0);
    low.speed.assign(roots, 0.0);
    high = middle = low;
    probes.fill(low);
    y_before.assign(static_cast<size_t>(system.problem.size), 0.0);
    y_inside = system.make_vector();
  }
  ~Impl() {
    if (y_inside) N_VDestroy(y_inside);
  }

  bool find_roots(double at, N_Vector state, Probe& to) {
    to.t = at;
    if (system.problem.roots(at, NV_DATA_S(state), to.value.data()) != 0) return false;
    if (system.problem.root_speeds) system.problem.root_speeds(to.speed.data());
    return true;
  }

  /// Where two neighbouring probes leave room for an event function to be below zero between them:
  /// the index of the first of the pair with most room. @return -1 if there is none
  int find_room(size_t count) const {
    constexpr double kSurely = 1.5;        // speeds between two probes are at most so much higher
    constexpr double kFine = 1.0 / 256.0;  // of a step: time that is not looked into
    const double fine = kFine * (probes[count - 1].t - probes[0].t);
    double most = fine;
    int at = -1;
    for (size_t k = 0; k + 1 < count; ++k) {
      const Probe &a = probes[k], &b = probes[k + 1];
      for (size_t i = 0; i < low.value.size(); ++i) {
        const double speed = kSurely * std::max(a.speed[i], b.speed[i]);
        // It falls to zero and comes back: what is left of the time is spent below zero.
        const double room = (b.t - a.t) - (a.value[i] + b.value[i]) / speed;
        if (!(speed > 0.0 && a.value[i] > 0.0 && b.value[i] > 0.0) || !(room > most)) continue;
        most = room;
        at = static_cast<int>(k);
      }
    }
    return at;
  }

  /// Is an event function below zero inside the step from low to high, but above it at both ends?
  /// Then `high` becomes a time at which it is. @return false if a state cannot be evaluated
  bool search_dips() {
    if (!system.problem.root_speeds) return true;
    probes[0] = low;
    probes[1] = high;
    for (size_t count = 2; count < kMostProbes; ++count) {
      const int k = find_room(count);
      if (k < 0) return true;
      const double at = 0.5 * (probes[k].t + probes[k + 1].t);
      if (!(at > probes[k].t && at < probes[k + 1].t)) return true;
      if (!solver->interpolate(at, y_inside)) return false;
      Probe& fresh = probes[count];
      if (!find_roots(at, y_inside, fresh)) return false;
      for (size_t i = 0; i < low.value.size(); ++i) {
        if (!(low.value[i] > 0.0 && fresh.value[i] <= 0.0)) continue;
        high = fresh;
        return true;
      }
      std::rotate(probes.begin() + k + 1, probes.begin() + count, probes.begin() + count + 1);
    }
    return true;
  }

  /// Does an event function fall through zero in the step from low to high? Then t is set to where
  /// the first one has done so, y to the state there. @return false if a state cannot be evaluated
  bool search_roots(bool& found) {
    found = false;
    double end;
    do {  // where a dip is found there may be an earlier one of another function
      end = high.t;
      if (!search_dips()) return false;
    } while (high.t < end);
    for (size_t i = 0; i < low.value.size(); ++i) {
      root_info[i] = low.value[i] > 0.0 && high.value[i] <= 0.0;
      found = found || root_info[i];
    }
    if (!found) return true;
    // The least of those that cross, each relative to where it started, crosses first. Illinois.
    const auto least = [this](const Probe& at) {
      double smallest = 1.0;
      for (size_t i = 0; i < at.value.size(); ++i) {
        if (root_info[i]) smallest = std::min(smallest, at.value[i] / low.value[i]);
      }
      return smallest;
    };
    double a = low.t, b = end, fa = 1.0, fb = least(high);
    const double tolerance = system.problem.root_tolerance * (std::abs(t) + (t - low.t));
    int side = 0;
    for (int i = 0; i < 100 && b - a > tolerance && fb < 0.0; ++i) {
      double c = (fa * b - fb * a) / (fa - fb);
      if (!(c > a + 0.5 * tolerance)) c = a + 0.5 * tolerance;
      if (!(c < b - 0.5 * tolerance)) c = b - 0.5 * tolerance;
      if (!solver->interpolate(c, y_inside)) return false;
      if (!find_roots(c, y_inside, middle)) return false;
      const double fc = least(middle);
      if (fc > 0.0) {
        a = c;
        fa = fc;
        if (side == 1) fb *= 0.5;
        side = 1;
      } else {
        b = c;
        fb = fc;
        if (side == -1) fa *= 0.5;
        side = -1;
        high = middle;
      }
    }
    for (size_t i = 0; i < high.value.size(); ++i) {
      root_info[i] = root_info[i] && high.value[i] <= 0.0;
    }
    if (b < t) {
      if (!solver->interpolate(b, system.y)) return false;
      t = b;
    }
    return true;
  }
};

Stepper::Stepper(Problem problem, Method method) : impl_(new Impl(std::move(problem), method)) {
  // SUNDIALS allocates in its first step: make one that leads nowhere.
  Impl& me = *impl_;
  me.system.idle = true;
  restart(0.0, 1.0);
  if (me.solver->step(1.0, me.system.y, me.t) == StepOutcome::kFailed ||
      !me.solver->interpolate(0.5 * me.t, me.y_inside)) {
    throw std::runtime_error("SUNDIALS cannot make a step");
  }
  me.idle_steps = steps();
  me.system.idle = false;
}
Stepper::~Stepper() = default;

void Stepper::set_evaluation_limit(std::int64_t count) {
  System& system = impl_->system;
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  system.evaluation_limit = count < kMost - system.evaluations ? system.evaluations + count : kMost;
}
bool Stepper::is_exhausted() const { return impl_->system.is_exhausted(); }

double* Stepper::y() { return NV_DATA_S(impl_->system.y); }

void Stepper::set_tolerances(double rtol, const double* atol) {
  System& system = impl_->system;
  std::copy(atol, atol + NV_LENGTH_S(system.atol), NV_DATA_S(system.atol));
  impl_->solver->set_tolerances(rtol, system.atol);
}

void Stepper::restart(double t, double h, const Known& known) {
  impl_->t = t;
  impl_->h_restart = h;
  impl_->restarted = true;
  impl_->low_valid = false;
  impl_->solver->restart(t, impl_->system.y, h);
  impl_->solver->set_known(known);
  impl_->system.known_jacobian = known.jacobian;
}

StepOutcome Stepper::step(double t_stop, bool watch_roots) {
  // A state that cannot be evaluated is cured by a smaller step, from the same start. A pose that
  // must be stepped over is cured by sizes that put no stage on it: some that end well before or
  // beyond it.
  constexpr int kRetries = 24;
  static constexpr std::array<double, 14> kStepsOver = {1.5, 1.25, 0.55, 0.45, 0.35, 0.27, 0.2,
                                                        0.7, 0.8,  2.5,  4.0,  6.5,  10.0, 16.0};
  Impl& me = *impl_;
  const bool watch = watch_roots && !me.low.value.empty();
  const double t_before = me.t;
  double h_first = 0.0;
  size_t steps_over = 0;
  std::copy(y(), y() + me.system.problem.size, me.y_before.begin());
  if (watch && !me.low_valid && !me.find_roots(me.t, me.system.y, me.low))
    return StepOutcome::kFailed;
  for (int retry = 0; retry < kRetries;) {
    me.system.failure = 0;
    const StepOutcome made = me.solver->step(t_stop, me.system.y, me.t);
    if (made == StepOutcome::kStopped) me.t = t_stop;
    bool found = false;
    if (made != StepOutcome::kFailed &&
        (!watch || (me.find_roots(me.t, me.system.y, me.high) && me.search_roots(found)))) {
      me.restarted = false;
      me.low_valid = watch && !found;
      if (me.low_valid) std::swap(me.low, me.high);
      return found ? StepOutcome::kRoot : made;
    }
    if (me.solver->has_fixed_step() || me.system.is_exhausted()) return StepOutcome::kFailed;
    if (retry == 0 && steps_over == 0) {
      // The solver still holds the size of the step before a restart.
      if (me.restarted) {
        h_first = me.h_restart;
      } else {
        h_first = me.solver->next_step();
      }
      if (!(h_first > 0.0)) h_first = t_stop - t_before;
      h_first = std::min(h_first, t_stop - t_before);
    }
    const bool steps_on = me.system.failure == kStepOver && steps_over < kStepsOver.size();
    const double factor = steps_on ? kStepsOver[steps_over++] : std::pow(0.25, ++retry);
    std::copy(me.y_before.begin(), me.y_before.end(), y());
    restart(t_before, std::min(factor * h_first, t_stop - t_before), {nullptr, me.solver->pace()});
    me.low_valid = watch;  // the start is where it was
  }
  return StepOutcome::kFailed;
}

double Stepper::time() const { return impl_->t; }
bool Stepper::interpolate(double t, double* y) const {
  if (!impl_->solver->interpolate(t, impl_->y_inside)) return false;
  std::copy_n(NV_DATA_S(impl_->y_inside), impl_->system.problem.size, y);
  return true;
}
bool Stepper::find_slope(double t, double* slope) const {
  return impl_->solver->find_slope(t, slope);
}
/// Dormand-Prince has stages at 0.2, 0.3, 0.8, 0.89 and 1 of a step: the state is in the middle of
/// the largest gap. The other methods use the same size.
double Stepper::find_size_across(double distance) { return distance / 0.55; }
double Stepper::next_step() const { return impl_->solver->next_step(); }
Stepper::Pace Stepper::pace() const { return impl_->solver->pace(); }
double Stepper::last_error() const { return impl_->solver->last_error(); }
const double* Stepper::unknowns() const { return impl_->solver->unknowns(); }
bool Stepper::root_found(int i) const { return impl_->root_info[i] != 0; }
std::int64_t Stepper::steps() const { return impl_->solver->steps() - impl_->idle_steps; }
std::int64_t Stepper::rejected_steps() const { return impl_->solver->rejected_steps(); }
std::int64_t Stepper::rate_evaluations() const { return impl_->system.evaluations; }

}  // namespace dockloop
