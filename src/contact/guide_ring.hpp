// Capture hardware of one side: a ring face with contact nodes on it, and guide petals.
//
// Androgynous: both sides carry the same hardware. It is described once, as seen on the active
// side (+x out of its interface, mating plane x = 0), and placed a second time on the passive side
// turned by half a turn, so that its petals stand between the petals of the active side.
#pragma once

#include <vector>

#include "contact/cores.hpp"
#include "contact/primitives.hpp"
#include "math/types.hpp"

namespace dockloop {

/// Dimensions of one side, axes of its own interface; azimuth counts from y to z.
/// A surface is a core plus a rounding radius. A mechanism file states all dimensions.
struct GuideRing {
  double core_x = 0.0;                 ///< plane of the annulus core of the ring face [m]
  double core_inner_radius = 0.0;      ///< [m]
  double core_outer_radius = 0.0;      ///< [m]
  double ring_rounding = 0.0;          ///< [m]
  int node_count = 0;                  ///< contact points on the ring face, 0 for none
  double node_radius = 0.0;            ///< [m]
  double node_azimuth_offset = 0.0;    ///< of the first node [rad]
  int petal_count = 0;                 ///< middles at azimuth 0, 2 pi/n, ...; at most 6
  double petal_rounding = 0.0;         ///< [m]
  double petal_base_x = 0.0;           ///< [m]
  double petal_base_radius = 0.0;      ///< of the two base corners [m]
  double petal_base_half_angle = 0.0;  ///< [rad]
  double petal_tip_x = 0.0;            ///< [m]
  double petal_tip_distance = 0.0;     ///< of the tip edge from the docking axis [m]
  double petal_tip_half_width = 0.0;   ///< [m]
};

/// The shapes of one side in axes of the body that carries them (G or P).
struct CaptureHardware {
  Annulus<double> ring{};
  double ring_rounding = 0.0, petal_rounding = 0.0;  ///< [m]
  std::vector<Vec3<double>> nodes;                   ///< [m]
  std::vector<Plate<double>> petals;                 ///< corners: base -, base +, tip +, tip -
  /// Side edge i = 0 (azimuth +) or 1 (azimuth -) of a petal: index of its edge in the plate.
  static constexpr int kSideEdge[2] = {1, 3};
};

/// Hardware of an active side. @throws ModelError if the dimensions make no ring or no petal.
CaptureHardware make_capture_hardware(const GuideRing& ring);

/// The same for a passive side: half a turn about the transverse axis at azimuth pi/(2 petals),
/// which maps x to -x and azimuth f to pi/petals - f (a rotation, no mirror image).
CaptureHardware make_passive_hardware(const GuideRing& ring);

/// Its cores, in this order: the ring face, the nodes, the petals, two side edges per petal.
/// @param ring  "active ring" or "passive ring"
std::vector<Core> make_ring_cores(const CaptureHardware& hardware, const std::string& ring);

}  // namespace dockloop
