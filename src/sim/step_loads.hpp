// Loads from outside over a communication step: values at its start, and constant slopes.
#pragma once

#include "docking/docking_model.hpp"
#include "sim/values.hpp"

namespace dockloop {

class StepLoads {
 public:
  /// Zero loads. @param commands  see count_commands()
  void start(int commands);
  /// Loads of the coming step. @param slopes  rates of the inputs; are_sloped: some are not zero
  /// @param begin  where that step begins, in the time of at()
  void read(const MechanismModel& mechanism, const Inputs& inputs, const Inputs& slopes,
            bool are_sloped, double begin);

  /// Loads of disturbances in addition to those that were read, from now on.
  void add(const DisturbingLoads& loads);

  /// The same loads at all times.
  void hold(const Loads& loads);

  const Loads& at_start() const { return start_; }
  const Loads& rates() const { return rates_; }
  bool are_sloped() const { return sloped_; }
  /// Loads at tau, in the time of the solver; valid until the next call.
  const Loads& at(double tau) const;
  /// Means over a step of h; valid until the next call. @param disturbing  means of disturbances
  const Loads& find_mean(double h, const DisturbingLoads& disturbing) const;
  /// The same of mean inputs.
  const Loads& find_mean(const MechanismModel& mechanism, const Inputs& inputs,
                         const DisturbingLoads& disturbing) const;
  /// No force, torque, gravity or command now and over the step? @param falling  gravity has no
  /// effect, because frame O falls
  bool are_absent(bool falling) const;

 private:
  /// now_ += tau times the slopes.
  void add_slopes(double tau) const;

  Loads start_, rates_;
  DisturbingLoads read_{};  ///< on vehicles, without disturbances
  mutable Loads now_;       ///< result of at() and find_mean()
  bool sloped_ = false;
  double begin_ = 0.0;  ///< where the slopes begin
};

bool are_same(const Loads& a, const Loads& b);

}  // namespace dockloop
