// How a mechanism vibrates about its home: what the choice of steps and tolerances must resolve.
#pragma once

#include <vector>

#include "dynamics/mechanism_dynamics.hpp"

namespace dockloop {

/// One pair of eigenvalues of the linearised motion, or a real one.
struct Mode {
  double frequency = 0.0;  ///< magnitude of the eigenvalue [rad/s]
  double damping = 0.0;    ///< ratio: 0 undamped, 1 no oscillation, below 0 grows
};

/// Linearised at home, at rest, on a base at rest, with the joint forces of the file; motions that
/// no force opposes have frequency 0. From exact Jacobians. Ascending frequencies.
std::vector<Mode> find_modes(const Mechanism& mechanism);

}  // namespace dockloop
