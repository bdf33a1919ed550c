// What a unit rate of each independent coordinate moves at home: the columns of the matrix H of
// the loops, under the names of joints, legs and force elements.
#pragma once

#include <string>
#include <vector>

#include "mechanism/mechanism_dynamics.hpp"
#include "model/joint_coordinates.hpp"

namespace dockloop {

/// Body name; of a free joint with .x .y .z .rx .ry .rz (body axes).
std::string find_coordinate_name(const Body& body, int k);

/// A joint, a leg or an element, and its rate per unit rate of an independent coordinate.
struct MovedPart {
  std::string name;
  double rate = 0.0;
};

struct CoordinateEffect {
  std::string coordinate;
  bool is_angle = false;
  std::vector<MovedPart> joints;    ///< that follow through loops; what stays at rest is left out
  std::vector<MovedPart> legs;      ///< their lengths
  std::vector<MovedPart> elements;  ///< their coordinates
};

/// One entry per independent coordinate, at the closed home.
std::vector<CoordinateEffect> find_coordinate_effects(const Mechanism& mechanism);

}  // namespace dockloop
