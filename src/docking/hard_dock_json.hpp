// Reads the hardware of the hard dock, member `interface` of a mechanism document.
#pragma once

#include "docking/hard_dock.hpp"
#include "model/json_reader.hpp"

namespace dockloop {

/// @throws ModelError naming member, value and limit
HardDock read_hard_dock(const JsonReader& item);

}  // namespace dockloop
