// Reads the parts of a vehicle of a scene (model/vehicle_part.hpp).
#pragma once

#include <string>

#include "model/json_reader.hpp"
#include "model/vehicle_part.hpp"

namespace dockloop {

/// Members `part`, `modes` and `adapter` of a vehicle. @param name  of the vehicle
/// @throws ModelError naming the member, its value and the limit
VehicleParts read_vehicle_parts(const JsonReader& vehicle, const std::string& name);

}  // namespace dockloop
