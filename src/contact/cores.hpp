// Contact hardware as data: the cores that one side carries.
//
// A surface is a core plus a rounding radius. Cores stand in axes of their body: G or another body
// of the mechanism on the active side, P on the passive side. Pairs of cores and their laws:
// contact_model.hpp.
#pragma once

#include <string>
#include <vector>

#include "contact/primitives.hpp"
#include "contact/revolution.hpp"
#include "math/types.hpp"

namespace dockloop {

/// From simple to complex: the first core of a pair is the simpler one.
enum class CoreKind : signed char { kPoint, kSegment, kPlate, kRevolution };

/// Sphere that contains a core, without its rounding; axes of the body.
struct CoreSphere {
  Vec3<double> centre = Vec3<double>::Zero();
  double radius = 0.0;
};

/// Rectangle that contains a profile.
struct ProfileBox {
  double x_low = 0.0, x_high = 0.0, r_low = 0.0, r_high = 0.0;
};

struct Core {
  std::string name;  ///< in words, for messages
  CoreKind kind = CoreKind::kPoint;
  int body = 0;                               ///< of ContactModel::bodies, on the active side
  double rounding = 0.0;                      ///< [m]
  Vec3<double> point = Vec3<double>::Zero();  ///< of kPoint; an end of kSegment [m]
  Vec3<double> end = Vec3<double>::Zero();    ///< the other end of kSegment [m]
  Plate<double> plate{};                      ///< kPlate
  Profile profile;                            ///< kRevolution, turned about the x axis of `axis`
  Pose<double> axis;                          ///< in axes of the body
  int surface = -1;                           ///< of ContactModel::surfaces, -1 for none
  std::vector<int> piece_surfaces;            ///< per piece of a profile; empty: `surface`
  std::vector<int> edges;                     ///< of a plate: cores of this side, segments
  CoreSphere sphere;                          ///< with it: written when a contact model is made
  ProfileBox box;                             ///< of kRevolution
};

inline Core make_point(std::string name, const Vec3<double>& at, double rounding) {
  Core core;
  core.name = std::move(name);
  core.rounding = rounding;
  core.point = at;
  return core;
}

inline Core make_segment(std::string name, const Vec3<double>& from, const Vec3<double>& to,
                         double rounding) {
  Core core = make_point(std::move(name), from, rounding);
  core.kind = CoreKind::kSegment;
  core.end = to;
  return core;
}

inline Core make_plate_core(std::string name, const Plate<double>& plate, double rounding) {
  Core core = make_point(std::move(name), plate.centre, rounding);
  core.kind = CoreKind::kPlate;
  core.plate = plate;
  return core;
}

inline Core make_revolution(std::string name, std::vector<Profile::Node> nodes, double rounding) {
  Core core = make_point(std::move(name), Vec3<double>::Zero(), rounding);
  core.kind = CoreKind::kRevolution;
  core.profile.node = std::move(nodes);
  return core;
}

/// Is it a plane ring about the x axis of its body, with a bore?
bool is_annulus(const Core& core);
/// @pre is_annulus
Annulus<double> get_annulus(const Core& core);

CoreSphere find_sphere(const Core& core);
ProfileBox find_box(const Profile& profile);

/// Radius of a sphere about the origin that contains all surfaces of one body [m].
double find_bounding_radius(const std::vector<Core>& cores, int body = 0);

}  // namespace dockloop
