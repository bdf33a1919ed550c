// One run of a scene with 32 digits, as numbers that errors can be measured against.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "docking/scene.hpp"

namespace dockloop {

struct SolutionOrder {
  double stop = 0.0, step = 0.0;      ///< communication points are k step, up to stop [s]
  double tolerance = 1e-18;           ///< of the steps inside, relative
  bool check = false;                 ///< run again with 1000 times the tolerance
  std::vector<std::string> outputs;   ///< names of FMU variables
  std::vector<std::string> settings;  ///< NAME=VALUE, of FMU variables that have a start value
};

/// @return time points, values of the outputs at each, work, and (with check) how far they are
/// from those of the second run. Progress goes to stderr, as lines "progress DONE OF".
/// @throws ModelError naming variable and value
nlohmann::json make_solution(std::shared_ptr<const Scene> scene, const SolutionOrder& order);

}  // namespace dockloop
