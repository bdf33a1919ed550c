// What the module of Python needs of a scene without a docking: messages with its file, its start.
#pragma once

#include <string>

#include "docking/placement.hpp"
#include "math/status.hpp"

namespace dockloop {

/// Call `body`; what it throws begins with `source`.
template <class Body>
auto naming(const std::string& source, Body&& body) {
  try {
    return body();
  } catch (const ModelError& error) {
    const std::string text = error.what();
    if (text.find(source) != std::string::npos) throw;
    throw ModelError(source + ": " + text);
  }
}

/// Start states of both vehicles that lead to the conditions of a scene at first contact.
/// @throws ModelError naming the scene if there are none, or they are not finite
Placement place_vehicles(const Scene& scene, const std::string& source);

}  // namespace dockloop
