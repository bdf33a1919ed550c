// Parts of a vehicle that is not rigid: appendages, slosh masses, a soft structure in front.
//
// A part hangs on the vehicle by one connection: a chain of slides and hinges, each with a spring
// and a damper. An adapter is the part that carries the mechanism, or the passive side. A normal
// mode of the vehicle is a part without mass and with one coordinate: its mass is in the vehicle's.
#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "model/mechanism_model.hpp"

namespace dockloop {

/// One coordinate of a connection.
struct PartCoordinate {
  JointType joint = JointType::kRevolute;
  Vec3<double> axis = Vec3<double>::UnitX();  ///< unit, axes of the part; of a mode, as in Body
  Vec3<double> axis_of_rotation = Vec3<double>::Zero();  ///< of a mode, as in Body
  double stiffness = 0.0, damping = 0.0;  ///< [N/m], [N s/m]; of hinges [N m/rad], [N m s/rad]
  double inertia = 1.0;            ///< that the spring moves, with the vehicle held [kg], [kg m2]
  double start = 0.0, rate = 0.0;  ///< at the start [m], [m/s] or [rad], [rad/s]
};

struct VehiclePart {
  std::string name;
  Pose<double> placement;  ///< of the part in axes of the vehicle, coordinates at zero
  std::vector<PartCoordinate> coordinates;
  double mass = 0.0;                            ///< [kg]
  Vec3<double> com = Vec3<double>::Zero();      ///< axes of the part [m]
  Mat3<double> inertia = Mat3<double>::Zero();  ///< about com, axes of the part [kg m2]
};

inline bool is_mode(const VehiclePart& part) {
  return part.coordinates.front().joint == JointType::kMode;
}

/// All parts of one vehicle.
struct VehicleParts {
  std::vector<VehiclePart> hung;  ///< modes last
  std::optional<VehiclePart> adapter;
  /// In the order of the outputs: parts that hang on the vehicle, adapter.
  template <class F>
  void for_each(F&& f) const {
    for (const VehiclePart& part : hung) f(part);
    if (adapter) f(*adapter);
  }
  bool has_modes() const { return std::any_of(hung.begin(), hung.end(), is_mode); }
  int count_coordinates() const {
    int count = 0;
    for_each([&](const VehiclePart& part) { count += static_cast<int>(part.coordinates.size()); });
    return count;
  }
};

}  // namespace dockloop
