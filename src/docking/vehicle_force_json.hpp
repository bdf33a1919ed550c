// Reads the forces between the vehicles, list `force` of a scene document.
#pragma once

#include "docking/vehicle_force.hpp"
#include "model/json_reader.hpp"

namespace dockloop {

/// @throws ModelError naming member, value and limit
std::vector<VehicleForce> read_vehicle_forces(const JsonReader& scene);

}  // namespace dockloop
