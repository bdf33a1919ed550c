// Which loop is solved when, and which coordinates each one touches: a function of the model alone.
//
// Loop a needs loop b when a joint on one of a's two paths (from the lowest common ancestor of its
// terminal and closing bodies) is determined by b. Loops that need each other form one block with
// one system of equations; blocks are numbered so that each needs only earlier ones. Positions,
// velocities and accelerations run through the blocks forwards, the reduction backwards.
// The order does not depend on the order of the file beyond breaking ties.      [Y2 list 3-7]
#pragma once

#include <array>
#include <string>
#include <vector>

#include "loops/leg_geometry.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// Loops that are solved together.
struct LoopBlock {
  std::vector<int> loops;
  std::vector<std::array<int, kMaxEquations>> row;  ///< per loop: row of each equation, -1 unused
  std::vector<int> dep;                             ///< velocity indices determined here, m of them
  std::vector<int> dep_bodies;                      ///< their bodies (each with one velocity)
  std::vector<int> low;        ///< velocity indices on which they depend, ascending
  std::vector<int> touched;    ///< velocity indices coupled to dep by inertia when it is eliminated
  std::vector<int> column_of;  ///< column of each velocity in the block's matrix, -1 if none
  VecX<double> dep_scale;      ///< unit of each dependent: 1 rad, or the loop size [m] of a slide
  VecX<double> low_scale;      ///< unit of each of `low`: 1 rad, or the loop size [m]
  VecX<double> row_scale;      ///< unit of each equation: the loop size [m], or 1 of a cosine
  Recognition closure;         ///< closed form, or why Newton iteration it is
  bool is_coupling = false;    ///< one coupling by itself
  bool is_driven = false;      ///< some coupling in it moves with time
  bool is_leg = false;         ///< a leg of a platform (LegPlatform), eliminated at its tip
  bool is_gear = false;        ///< the coupling of a gear of a platform (LegGear)
  /// Do sums of a platform stand for the bodies of this block?
  bool is_condensed() const { return is_leg || is_gear; }
  const ClosedForm* form() const { return closure.form ? &*closure.form : nullptr; }
  int size() const { return static_cast<int>(dep.size()); }
};

/// A body that turns with joints of legs: the rotor of a screw, the shaft of a differential. Its
/// inertia is the same at every angle, so what it adds to its carrier is a momentum along a fixed
/// axis.
struct LegGear {
  int body = 0, block = 0;          ///< of its coupling
  double constant = 0.0;            ///< coordinate = constant + sum of ratio x coordinate
  std::vector<CouplingTerm> terms;  ///< joints of legs
  int carrier = kBase;              ///< root of the platform, or a body of a leg
};

/// A body that legs hold on a root body: each leg is one loop in closed form whose three bodies
/// belong to nothing else but gears. Blocks of legs come after all others, those of gears last.
struct LegPlatform {
  int root = kBase, body = 0;
  std::vector<int> path;       ///< bodies from below the root to the platform
  std::vector<int> low;        ///< their velocity indices, ascending
  std::vector<int> blocks;     ///< its legs
  bool is_free = false;        ///< one free joint leads from root to platform
  std::vector<LegGear> gears;  ///< a gear comes after those that its coupling names
};

struct LoopPlan {
  std::vector<LoopPaths> paths;   ///< per loop
  std::vector<double> loop_size;  ///< per loop, home length [m]: scale of its equations
  std::vector<std::vector<Vec3<double>>> cross_axes;  ///< per loop: axes of the terminal body that
                                                      ///< stay square to the closing body's axis
  std::vector<int> block_of_loop;  ///< per loop, -1 if all its equations are redundant
  std::vector<LoopBlock> blocks;   ///< in order of evaluation
  size_t reduced_blocks = 0;       ///< the others, which come last, are condensed
  std::vector<int> ind_v;          ///< independent velocities, ascending
  std::vector<int> ind_q;          ///< independent coordinates, ascending
  std::vector<int> ind_bodies;     ///< bodies with independent joints
  std::vector<int> followed;       ///< those of them on which loops depend
  std::vector<LegPlatform> platforms;
  std::vector<int> tree_bodies;   ///< bodies that are neither legs nor gears, ascending
  std::vector<int> leg_bodies;    ///< the others, ascending
  bool is_free_platform = false;  ///< the tree is one platform on a free joint, on the base or on
                                  ///< one free body; there are no other loops than its legs
  bool iterates = false;          ///< some block is solved by Newton iteration
  bool is_driven = false;         ///< some joint moves with time by itself
};

/// @param q  pose at which closed forms choose their branch (all coordinates)
/// @param newton_only never use a closed form (the oracle of the closed forms).
/// @throws ModelError for a loop table that makes no sense, naming the loop.
LoopPlan make_loop_plan(const MechanismModel& model, const std::vector<double>& q,
                        bool newton_only = false);

/// Poses of all bodies in the base at q, dependents as they stand there.
std::vector<Pose<double>> find_poses(const MechanismModel& model, const std::vector<double>& q);

/// Paths, sizes and cross axes of every loop: what a plan knows before its order.
/// @throws ModelError for paths that make no sense
LoopPlan make_loop_paths(const MechanismModel& model, const std::vector<Pose<double>>& home);

}  // namespace dockloop
