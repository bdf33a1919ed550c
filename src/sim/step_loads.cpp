// Loads from outside over a communication step; see step_loads.hpp.
#include "sim/step_loads.hpp"

namespace dockloop {
namespace {

void read_loads(const MechanismModel& mechanism, const Inputs& from, Loads& to) {
  for (int i : {kChaser, kTarget}) {
    to.force[i] = from.vehicle[i].force_ext;
    to.torque[i] = from.vehicle[i].torque_ext;
  }
  to.gravity = from.gravity;
  for (size_t i = 0; i < mechanism.legs.size(); ++i) {
    to.command[mechanism.legs[i].force] = mechanism.legs[i].arm * from.leg_force_command[i];
  }
  const int first = static_cast<int>(mechanism.forces.size());
  for (size_t i = 0; i < mechanism.elements.size(); ++i) {
    to.command[first + static_cast<int>(i)] = from.element_command[i];
  }
}

}  // namespace

void StepLoads::start(int commands) {
  start_ = Loads();
  start_.command.setZero(commands);
  rates_ = now_ = start_;
  read_ = {};
  sloped_ = false;
}

void StepLoads::read(const MechanismModel& mechanism, const Inputs& inputs, const Inputs& slopes,
                     bool are_sloped, double begin) {
  begin_ = begin;
  read_loads(mechanism, inputs, start_);
  read_loads(mechanism, slopes, rates_);
  sloped_ = are_sloped;
  for (int i : {kChaser, kTarget}) read_[i] = {start_.force[i], start_.torque[i]};
}

void StepLoads::add(const DisturbingLoads& loads) {
  for (int i : {kChaser, kTarget}) {
    start_.force[i] = read_[i].f + loads[i].f;
    start_.torque[i] = read_[i].t + loads[i].t;
  }
}

void StepLoads::hold(const Loads& loads) {
  start_ = loads;
  sloped_ = false;
}

const Loads& StepLoads::at(double tau) const {
  if (!sloped_) return start_;
  now_ = start_;
  add_slopes(tau - begin_);
  return now_;
}

const Loads& StepLoads::find_mean(double h, const DisturbingLoads& disturbing) const {
  now_ = start_;
  for (int i : {kChaser, kTarget}) {
    now_.force[i] = read_[i].f + disturbing[i].f;
    now_.torque[i] = read_[i].t + disturbing[i].t;
  }
  if (sloped_) add_slopes(0.5 * h);
  return now_;
}

const Loads& StepLoads::find_mean(const MechanismModel& mechanism, const Inputs& inputs,
                                  const DisturbingLoads& disturbing) const {
  now_ = start_;
  read_loads(mechanism, inputs, now_);
  for (int i : {kChaser, kTarget}) {
    now_.force[i] += disturbing[i].f;
    now_.torque[i] += disturbing[i].t;
  }
  return now_;
}

void StepLoads::add_slopes(double tau) const {
  for (int i : {kChaser, kTarget}) {
    now_.force[i] += tau * rates_.force[i];
    now_.torque[i] += tau * rates_.torque[i];
  }
  now_.gravity += tau * rates_.gravity;
  now_.command += tau * rates_.command;
}

bool StepLoads::are_absent(bool falling) const {
  if (sloped_ || !start_.command.isZero(0.0)) return false;
  if (!falling && !start_.gravity.isZero(0.0)) return false;
  return start_.force[kChaser].isZero(0.0) && start_.force[kTarget].isZero(0.0) &&
         start_.torque[kChaser].isZero(0.0) && start_.torque[kTarget].isZero(0.0);
}

bool are_same(const Loads& a, const Loads& b) {
  return a.force == b.force && a.torque == b.torque && a.gravity == b.gravity &&
         a.command == b.command;
}

}  // namespace dockloop
