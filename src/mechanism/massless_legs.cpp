// Lumping of the masses of legs; see massless_legs.hpp.
#include "mechanism/massless_legs.hpp"

#include <algorithm>

namespace dockloop {
namespace {

[[noreturn]] void refuse(const MechanismModel& model, int body, const std::string& reason) {
  throw ModelError("model.level is 2 (massless_legs), but the mass of body '" +
                   model.bodies[body].name + "' cannot be put to the ends of a leg: " + reason +
                   "; take model.level = 3 (reduced)");
}

bool has_mass(const Body& body) { return body.mass != 0.0 || !body.inertia.isZero(0.0); }

/// Put a point mass, given in axes of B, on a body of the model, or on the base.
void add_point_mass(const TreeData<double>& home, int body, double mass, const Vec3<double>& point,
                    MasslessLegs& legs) {
  if (body == kBase) {
    legs.on_base = join(legs.on_base, {mass, point, Mat3<double>::Zero()});
    return;
  }
  const Vec3<double> at = home.R[body].transpose() * (point - home.p[body]);
  Body& b = legs.model.bodies[body];
  const VehicleBody both = join({b.mass, b.com, b.inertia}, {mass, at, Mat3<double>::Zero()});
  b.mass = both.mass;
  b.com = both.com;
  b.inertia = both.inertia;
}

}  // namespace

MasslessLegs make_legs_massless(const MechanismModel& original) {
  const Mechanism mechanism(original);
  MechanismData<double> data(mechanism);
  calc_home_position(mechanism, "mechanism", data);
  const TreeData<double>& home = data.tree;
  const std::vector<Body>& bodies = mechanism.model.bodies;
  const std::vector<int>& free = mechanism.plan.ind_bodies;
  const auto is_determined = [&](int body) {
    return body != kBase && std::find(free.begin(), free.end(), body) == free.end();
  };
  for (int i : free) {
    const int up = bodies[static_cast<size_t>(i)].parent;
    if (is_determined(up)) refuse(original, up, "it carries body '" + bodies[i].name + "'");
  }
  MasslessLegs legs{original, {}};
  for (const Loop& loop : mechanism.model.loops) {
    for (int part : loop.dependent) {
      const Body& body = bodies[part];
      if (!has_mass(body)) continue;
      if (loop.cut == CutType::kCoupling) refuse(original, part, "a coupling moves it");
      if (part == original.capture_body) refuse(original, part, "it is the capture body");
      if (original.is_contact_body(part)) refuse(original, part, "it carries contact surfaces");
      if (is_determined(loop.closing)) {
        refuse(original, part,
               "its loop closes on body '" + bodies[loop.closing].name +
                   "', which a loop determines, too");
      }
      int head = loop.terminal, first = part;
      while (head != part && head != kBase) head = bodies[head].parent;
      if (head != part) refuse(original, part, "it does not lie between foot and cut of its loop");
      const auto is_of_loop = [&](int i) {
        return std::find(loop.dependent.begin(), loop.dependent.end(), i) != loop.dependent.end();
      };
      while (is_of_loop(bodies[first].parent)) first = bodies[first].parent;
      const int root = bodies[first].parent;
      if (is_determined(root)) {
        refuse(original, part,
               "its leg stands on body '" + bodies[root].name + "', which a loop determines, too");
      }
      const Vec3<double> foot = home.p[first];
      Vec3<double> cut = loop.point_on_closing;
      if (loop.closing != kBase) cut = home.R[loop.closing] * cut + home.p[loop.closing];
      const Vec3<double> com = home.R[part] * body.com + home.p[part], way = cut - foot;
      const double length2 = way.squaredNorm();
      const double share =
          length2 > 0.0 ? std::clamp((com - foot).dot(way) / length2, 0.0, 1.0) : 0.0;
      add_point_mass(home, root, (1.0 - share) * body.mass, foot, legs);
      add_point_mass(home, loop.closing, share * body.mass, cut, legs);
      legs.model.bodies[part].mass = 0.0;
      legs.model.bodies[part].inertia.setZero();
    }
  }
  return legs;
}

}  // namespace dockloop
