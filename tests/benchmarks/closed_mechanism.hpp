// A mechanism from its file, closed at home.
#pragma once

#include <fstream>
#include <iterator>
#include <string>

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

/// @throws ModelError if it cannot be read or closed
inline Mechanism read_closed_mechanism(const std::string& file, bool newton_only = false) {
  std::ifstream stream(file);
  if (!stream) throw ModelError("cannot read " + file);
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  Mechanism mechanism(read_mechanism(text, file), newton_only);
  close_home(mechanism, file);
  return mechanism;
}

}  // namespace dockloop
