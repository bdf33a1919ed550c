// How a mechanism vibrates about its home: what the choice of steps and tolerances must resolve.
#pragma once

#include <vector>

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// A pair of conjugate eigenvalues of the linearised motion, or one that is real.
struct Mode {
  double frequency = 0.0;  ///< magnitude of the eigenvalue [rad/s]
  double growth = 0.0;     ///< its real part [1/s]: below 0 the motion dies out, above 0 it grows
  bool oscillates = false;
  /// 0 undamped, 1 on the verge of no oscillation; of what oscillates and does not grow.
  double damping() const { return frequency > 0.0 ? 0.0 - growth / frequency : 0.0; }
};

/// Linearised at home, at rest, on a base at rest, with the joint forces of the file; motions that
/// no force opposes have frequency 0. From exact Jacobians. Ascending frequencies; together they
/// stand for as many eigenvalues as there are coordinates and velocities.
std::vector<Mode> find_modes(const Mechanism& mechanism);

}  // namespace dockloop
