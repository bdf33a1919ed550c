// Which loop is solved when, and which coordinates each one touches: a function of the model alone.
//
// Loop a needs loop b when a joint on one of a's two paths (from the lowest common ancestor of its
// terminal and closing bodies) is determined by b. Loops that need each other form one block with
// one system of equations; blocks are numbered so that each needs only earlier ones. Positions,
// velocities and accelerations run through the blocks forwards, the reduction backwards.
// The order does not depend on the order of the file beyond breaking ties.      [Y2 list 3-7]
#pragma once

#include <optional>
#include <vector>

#include "model/mechanism_model.hpp"

namespace dockloop {

/// The two paths of a loop, from below the lowest common ancestor down to terminal and closing.
struct LoopPaths {
  int lca = kBase;
  std::vector<int> terminal, closing;  ///< bodies; empty if the lca is that body itself
  int root_on_terminal = -1;  ///< position of the root in `terminal`, -1 if the root is the lca
};

/// Geometry of a leg that is solved in closed form: universal joint, slide, spherical cut.
struct SlideLeg {
  int universal1 = 0, universal2 = 0, slide = 0;  ///< bodies
  Mat3<double> canonical_in_root;                 ///< columns: a1 x a2, a1, a2 at zero, root axes
  Vec3<double> centre_in_root;                    ///< centre of the universal joint [m]
  Vec3<double> tip;  ///< centre to cut point at zero coordinates, canonical axes [m]
};

/// Loops that are solved together.
struct LoopBlock {
  std::vector<int> loops;
  std::vector<int> row;         ///< first equation of each loop in the block
  std::vector<int> dep;         ///< velocity indices determined here, m of them
  std::vector<int> dep_bodies;  ///< their bodies (each with one velocity)
  std::vector<int> low;         ///< velocity indices on which they depend, ascending
  std::vector<int> touched;    ///< velocity indices coupled to dep by inertia when it is eliminated
  std::vector<int> column_of;  ///< column of each velocity in the block's matrix, -1 if none
  VecX<double> dep_scale;      ///< 1 for a slide, loop size [m] for a turning joint
  std::optional<SlideLeg> slide_leg;  ///< closed form, if one serves
  int size() const { return static_cast<int>(dep.size()); }
};

struct LoopPlan {
  std::vector<LoopPaths> paths;    ///< per loop
  std::vector<double> loop_size;   ///< per loop, home length [m]: scale of its equations
  std::vector<int> block_of_loop;  ///< per loop
  std::vector<LoopBlock> blocks;   ///< in order of evaluation
  std::vector<int> ind_v;          ///< independent velocities, ascending
  std::vector<int> ind_q;          ///< independent coordinates, ascending
  std::vector<int> ind_bodies;     ///< bodies with independent joints
};

/// @param newton_only never use a closed form (the oracle of the closed forms).
/// @throws ModelError for a loop table that makes no sense, naming the loop.
LoopPlan make_loop_plan(const MechanismModel& model, bool newton_only = false);

}  // namespace dockloop
