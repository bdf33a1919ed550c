// Loads from outside over a communication step; see step_loads.hpp.
#include "sim/step_loads.hpp"

namespace dockloop {
namespace {

void read_loads(const std::vector<Leg>& legs, const Inputs& from, Loads& to) {
  for (int i : {kChaser, kTarget}) {
    to.force[i] = from.vehicle[i].force_ext;
    to.torque[i] = from.vehicle[i].torque_ext;
  }
  to.gravity = from.gravity;
  for (size_t i = 0; i < legs.size(); ++i) to.command[legs[i].force] = from.leg_force_command[i];
}

}  // namespace

void StepLoads::start(int forces) {
  start_ = Loads();
  start_.command.setZero(forces);
  rates_ = now_ = start_;
  sloped_ = false;
}

void StepLoads::read(const std::vector<Leg>& legs, const Inputs& inputs, const Inputs& slopes,
                     bool are_sloped) {
  read_loads(legs, inputs, start_);
  read_loads(legs, slopes, rates_);
  sloped_ = are_sloped;
}

const Loads& StepLoads::at(double tau) const {
  if (!sloped_) return start_;
  for (int i : {kChaser, kTarget}) {
    now_.force[i] = start_.force[i] + tau * rates_.force[i];
    now_.torque[i] = start_.torque[i] + tau * rates_.torque[i];
  }
  now_.gravity = start_.gravity + tau * rates_.gravity;
  now_.command = start_.command + tau * rates_.command;
  return now_;
}

bool StepLoads::are_absent(bool falling) const {
  if (sloped_ || !start_.command.isZero(0.0)) return false;
  if (!falling && !start_.gravity.isZero(0.0)) return false;
  return start_.force[kChaser].isZero(0.0) && start_.force[kTarget].isZero(0.0) &&
         start_.torque[kChaser].isZero(0.0) && start_.torque[kTarget].isZero(0.0);
}

}  // namespace dockloop
