// Nodes of one ring on the face of the other in SIMD lanes: groups of eight nodes.
//
// The laws are those of laws.hpp with regularised friction, the geometry that of
// find_point_annulus(); compiled for several instruction sets like the legs
// (math/lane_arithmetic.hpp).
#pragma once

#include "math/lanes.hpp"

namespace dockloop::nodes {

/// Positions of the nodes, axes of their side [m]. Unused lanes repeat a node.
struct alignas(64) NodeGroup {
  double position[3][kGroup];
};

/// Motion of P relative to G (axes of G), the ring face, and the law.
struct NodeContact {
  bool on_passive;  ///< the nodes belong to P
  double R[9];      ///< R_GP by columns
  double p[3], w[3], v[3];
  double ring_x, ring_inner, ring_outer, rounding;
  double stiffness, toe, damping, friction_coefficient, friction_speed;
};

/// For every node: gap [m] and vector from G to P (3) [m], axes of G, if `ways` or a node touches.
struct alignas(64) NodeGaps {
  double gap[kGroup];
  double way[3][kGroup];
};

/// Rows of sums over the nodes of one group, for ContactResult.
enum NodeSum {
  kSumForce = 0,
  kSumMoment = 3,
  kSumEnergy = 6,
  kSumContactPower = 7,
  kSumFrictionPower = 8,
  kNodeSums = 9
};

/// Contact of a group. kDeep: deeper than half the rounding, the limit of this code.
enum class Touch { kNone, kShallow, kDeep };

struct NodeFunctions {
  /// Adds to sums[row]; adds nothing for kNone. For kDeep the sums are not valid.
  /// @param count  nodes in the group
  Touch (*add_group)(const NodeGroup& group, int count, const NodeContact& contact, bool ways,
                     NodeGaps& gaps, double (*sums)[kSumLanes]);
  void (*add_lanes)(const double (*row)[kSumLanes], int count, double* sums);
};

/// Functions for the widest registers of this processor. @param widest  largest number of lanes
const NodeFunctions& find_node_functions(int widest = kGroup);

}  // namespace dockloop::nodes
