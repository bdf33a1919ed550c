// Places nodes and petals of a guide ring from its dimensions.
#include "contact/guide_ring.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "math/rotation.hpp"
#include "math/status.hpp"

namespace dockloop {
namespace {

constexpr double kPi = static_cast<double>(EIGEN_PI);

Vec3<double> at_azimuth(double x, double radius, double azimuth) {
  return {x, radius * std::cos(azimuth), radius * std::sin(azimuth)};
}

/// "azimuth 78.8 deg", from 0 to 360.
std::string describe_azimuth(const Vec3<double>& at) {
  constexpr double kUp = 1e-6;  // halves are rounded up, on every machine
  const double tenths = std::round(std::atan2(at[2], at[1]) * 1800.0 / kPi + kUp);
  char text[32];
  std::snprintf(text, sizeof text, "azimuth %.1f deg", std::fmod(tenths + 3600.0, 3600.0) / 10.0);
  return text;
}

}  // namespace

CaptureHardware make_capture_hardware(const GuideRing& g) {
  require("guide ring", g.core_inner_radius > 0 && g.core_outer_radius >= g.core_inner_radius,
          "core radii must satisfy 0 < inner <= outer");
  require("guide ring", g.ring_rounding > 0 && g.petal_rounding > 0,
          "rounding radii must be above 0");
  require("guide ring", g.node_count >= 0, "node_count must not be negative");
  require("guide ring", g.petal_count >= 0 && g.petal_count <= 6,
          "petal_count must be between 0 and 6");
  require("guide ring",
          g.petal_base_radius > 0 && g.petal_base_half_angle > 0 && g.petal_tip_half_width > 0 &&
              g.petal_tip_x != g.petal_base_x,
          "a petal needs a base angle, a tip width and a height other than 0");
  CaptureHardware h;
  h.ring = {g.core_x, g.core_inner_radius, g.core_outer_radius};
  h.ring_rounding = g.ring_rounding;
  h.petal_rounding = g.petal_rounding;
  for (int j = 0; j < g.node_count; ++j) {
    h.nodes.push_back(
        at_azimuth(g.core_x, g.node_radius, 2 * kPi * j / g.node_count + g.node_azimuth_offset));
  }
  const Vec3<double> axis = Vec3<double>::UnitX();
  for (int j = 0; j < g.petal_count; ++j) {
    const double a = 2 * kPi * j / g.petal_count;
    const Mat3<double> turn = axis_rotation<double>(axis, std::cos(a), std::sin(a));
    const Vec3<double> tip(g.petal_tip_x, g.petal_tip_distance, g.petal_tip_half_width);
    h.petals.push_back(make_plate<double>(
        {at_azimuth(g.petal_base_x, g.petal_base_radius, a - g.petal_base_half_angle),
         at_azimuth(g.petal_base_x, g.petal_base_radius, a + g.petal_base_half_angle), turn * tip,
         turn * Vec3<double>(tip[0], tip[1], -tip[2])}));
  }
  return h;
}

CaptureHardware make_passive_hardware(const GuideRing& g) {
  CaptureHardware h = make_capture_hardware(g);
  const Vec3<double> axis = at_azimuth(0, 1, kPi / (2 * std::max(g.petal_count, 1)));
  const Mat3<double> turn = 2 * axis * axis.transpose() - Mat3<double>::Identity();
  h.ring.x = -h.ring.x;
  for (Vec3<double>& node : h.nodes) node = turn * node;
  for (Plate<double>& petal : h.petals) {
    petal = place_plate<double>(petal, turn, Vec3<double>::Zero());
  }
  return h;
}

std::vector<Core> make_ring_cores(const CaptureHardware& h, const std::string& ring) {
  std::vector<Core> cores;
  const std::string face = "the " + ring + " face";
  cores.push_back(
      make_revolution(face, {{h.ring.x, h.ring.inner}, {h.ring.x, h.ring.outer}}, h.ring_rounding));
  for (size_t i = 0; i < h.nodes.size(); ++i) {
    const std::string name =
        "node " + std::to_string(i + 1) + " (" + describe_azimuth(h.nodes[i]) + ") of " + face;
    cores.push_back(make_point(name, h.nodes[i], h.ring_rounding));
  }
  const auto describe_petal = [&](size_t i) {
    return "petal " + std::to_string(i + 1) + " of the " + ring;
  };
  for (size_t i = 0; i < h.petals.size(); ++i) {
    cores.push_back(make_plate_core(describe_petal(i), h.petals[i], h.petal_rounding));
  }
  for (size_t i = 0; i < h.petals.size(); ++i) {
    for (const int edge : CaptureHardware::kSideEdge) {
      const std::array<Vec3<double>, 4>& corner = h.petals[i].corner;
      const int base = edge == CaptureHardware::kSideEdge[0] ? 1 : 0;
      cores.push_back(make_segment(
          "the side edge (base at " + describe_azimuth(corner[base]) + ") of " + describe_petal(i),
          corner[edge], corner[(edge + 1) % 4], h.petal_rounding));
    }
  }
  return cores;
}

}  // namespace dockloop
