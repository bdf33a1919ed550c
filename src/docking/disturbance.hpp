// Loads on vehicles that act for a while: jets that fire by mistake, pushes of a test bench.
#pragma once

#include <array>

#include "math/types.hpp"
#include "model/onset.hpp"

namespace dockloop {

constexpr int kMaxDisturbances = 16;

/// As the inputs force_ext and torque_ext, from `onset` on.
struct Disturbance {
  int vehicle = 0;  ///< kChaser or kTarget
  Onset onset;
  double duration = 0.0;                       ///< [s]
  Vec3<double> force = Vec3<double>::Zero();   ///< at the CoM, N axes [N]
  Vec3<double> torque = Vec3<double>::Zero();  ///< body axes [N m]
};

/// Their sums, per vehicle: force in N axes, torque in body axes.
using DisturbingLoads = std::array<Wrench<double>, 2>;

}  // namespace dockloop
