// What a velocity coordinate of a joint is.
#pragma once

#include "model/mechanism_model.hpp"

namespace dockloop {

/// Is velocity coordinate k of the body an angle?
inline bool is_angle(const Body& body, int k) {
  return body.joint == JointType::kRevolute || (body.joint == JointType::kFree && k >= 3);
}

}  // namespace dockloop
