// Explicit steps where accuracy limits them, linearly implicit steps where stability would.
//
// Drives, brakes and legs make the equations stiff in some phases of a run, and contact needs short
// steps in others. Explicit steps that wait at the stability limit give way to linearly implicit
// ones; these give way again where their error control asks for steps as short as those. A trial
// that fails makes the next one later. What was stiff may be over: from time to time a few explicit
// steps find out how long they would be now.
#include <algorithm>
#include <utility>

#include "integrate/runge_kutta.hpp"
#include "integrate/solver.hpp"

namespace dockloop {
namespace {

constexpr double kWorthTrial = 2.0;  ///< wanted step over the stable one, for a trial
constexpr double kTrialStep = 1.5;   ///< first linearly implicit step over the stable one
constexpr double kShortStep = 1.2;  ///< linearly implicit steps below so many stable ones cost more
constexpr int kShortSteps = 5;      ///< in a row, before explicit steps return
constexpr int kProvenSteps = 20;    ///< after which a trial counts as a success
constexpr int kLongestWait = 640;   ///< [steps]
/// Linearly implicit steps before explicit ones are tried: the first time, and at most.
constexpr int kFirstStay = 500, kLongestStay = 8000;

class SwitchingSolver : public Solver {
 public:
  explicit SwitchingSolver(System& system)
      : explicit_(make_explicit_solver(system, get_dormand_prince(), get_stabilised())),
        implicit_(make_rosenbrock_solver(system, true)),
        used_(explicit_.get()) {}

  void set_tolerances(double rtol, N_Vector atol) override {
    explicit_->set_tolerances(rtol, atol);
    implicit_->set_tolerances(rtol, atol);
  }
  void restart(double t, N_Vector y, double h) override {
    t_ = t;
    h_ = h;
    y_ = y;
  }
  void set_known(const Stepper::Known& known) override {
    pace_ = known.pace;
    use(known);
  }
  StepOutcome step(double t_stop, N_Vector y, double& t) override {
    if (is_pending()) {
      y_ = y;
      use({nullptr, pace_});
    }
    const StepOutcome made = used_->step(t_stop, y, t);
    if (made == StepOutcome::kFailed) return made;
    t_ = t;
    h_ = used_->next_step();
    update_pace();
    return made;
  }
  bool interpolate(double t, N_Vector y) override { return used_->interpolate(t, y); }
  bool find_slope(double t, double* slope) override { return used_->find_slope(t, slope); }
  double next_step() const override { return h_; }
  double last_error() const override { return is_pending() ? 1.0 : used_->last_error(); }
  Stepper::Pace pace() const override { return pace_; }

 private:
  std::int64_t present_steps() const override { return explicit_->steps() + implicit_->steps(); }
  std::int64_t present_rejected() const override {
    return explicit_->rejected_steps() + implicit_->rejected_steps();
  }
  /// Was the last step made by another method than the next one?
  bool is_pending() const { return (used_ == implicit_.get()) != pace_.is_implicit; }
  void use(const Stepper::Known& known) {
    used_ = pace_.is_implicit ? implicit_.get() : explicit_.get();
    used_->restart(t_, y_, h_);
    used_->set_known(known);
  }
  void change(bool to_implicit, double h) {
    pace_.is_implicit = to_implicit;
    pace_.count = 0;
    h_ = h;
  }

  /// After an accepted step: how the next one is made.
  void update_pace() {
    if (pace_.is_implicit) {
      if (++pace_.made == kProvenSteps) pace_.wait = 0;
      pace_.count = h_ < kShortStep * pace_.stable ? pace_.count + 1 : 0;
      if (pace_.count >= kShortSteps) {
        change(false, pace_.stable);
      } else if (const int stay = std::max(pace_.stay, kFirstStay); pace_.made >= stay) {
        pace_.stay = std::min(2 * stay, kLongestStay);
        pace_.fastest_rate = 0.0;  // is of the time before
        change(false, pace_.stable);
      }
      return;
    }
    pace_.fastest_rate = used_->pace().fastest_rate;
    const double worth = pace_.stay > 0 ? kShortStep : kWorthTrial;  // as before a look
    if (!(h_ * pace_.fastest_rate > worth * kStabilisedInterval)) {
      pace_.count = pace_.stay = 0;
      return;
    }
    constexpr int kFirstWait = 5;
    const int wait = std::max(pace_.wait, kFirstWait);
    if (++pace_.count < wait) return;
    pace_.wait = std::min(2 * wait, kLongestWait);
    pace_.made = 0;
    pace_.stable = kStabilisedInterval / pace_.fastest_rate;
    change(true, kTrialStep * pace_.stable);
  }

  std::unique_ptr<Solver> explicit_, implicit_;
  Solver* used_;  ///< in the last step
  Stepper::Pace pace_;
  double t_ = 0.0, h_ = 0.0;  ///< end of the last step, size of the next one [s]
  N_Vector y_ = nullptr;
};

}  // namespace

std::unique_ptr<Solver> make_switching_solver(System& system) {
  return std::make_unique<SwitchingSolver>(system);
}

}  // namespace dockloop
