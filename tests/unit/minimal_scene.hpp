// The scene that the FMU tests share: tests/data/scene_minimal.json, two free vehicles and a
// mechanism. Tests that need another motion or other groups change the Scene after reading it.
#pragma once

#include <fstream>
#include <iterator>
#include <string>

#include "docking/scene.hpp"

namespace dockloop {

inline std::string minimal_scene_file() {
  return std::string(DOCKLOOP_TEST_DATA) + "/scene_minimal.json";
}

inline std::string minimal_scene_text() {
  std::ifstream file(minimal_scene_file());
  if (!file) throw ModelError("cannot read " + minimal_scene_file());
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

inline Scene minimal_scene() { return read_scene(minimal_scene_text(), minimal_scene_file()); }

}  // namespace dockloop
