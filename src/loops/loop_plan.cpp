// Paths, dependency blocks, elimination pattern and closed-form recognition; see loop_plan.hpp.
#include "loops/loop_plan.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "loops/platform_plan.hpp"
#include "math/rotation.hpp"
#include "math/status.hpp"

namespace dockloop {
namespace {

std::vector<int> find_ancestors(const MechanismModel& model, int body) {
  std::vector<int> list;
  for (; body != kBase; body = model.bodies[body].parent) list.push_back(body);
  list.push_back(kBase);
  return list;  // body itself first, base last
}

LoopPaths make_paths(const MechanismModel& model, const Loop& loop) {
  LoopPaths paths;
  if (loop.cut == CutType::kCoupling) {
    paths.tied = {loop.terminal};
    for (const CouplingTerm& term : loop.terms) paths.tied.push_back(term.body);
    return paths;
  }
  const std::vector<int> up_T = find_ancestors(model, loop.terminal);
  const std::vector<int> up_I = find_ancestors(model, loop.closing);
  for (int body : up_T) {
    if (std::find(up_I.begin(), up_I.end(), body) != up_I.end()) {
      paths.lca = body;
      break;
    }
  }
  for (int body : up_T) {
    if (body == paths.lca) break;
    paths.terminal.insert(paths.terminal.begin(), body);
  }
  for (int body : up_I) {
    if (body == paths.lca) break;
    paths.closing.insert(paths.closing.begin(), body);
  }
  const auto at = std::find(paths.terminal.begin(), paths.terminal.end(), loop.root);
  if (at != paths.terminal.end()) {
    paths.root_on_terminal = static_cast<int>(at - paths.terminal.begin());
  } else if (std::find(up_T.begin(), up_T.end(), loop.root) == up_T.end()) {
    throw ModelError("loop '" + loop.name + "': root is not on the path to the terminal body");
  } else if (loop.root != paths.lca && loop.cut == CutType::kPlanarRevolute) {
    throw ModelError("loop '" + loop.name +
                     "': the root of a planar cut, whose axes its plane is given in, must not lie "
                     "above the lowest common ancestor of terminal and closing body");
  }
  return paths;
}

/// Scale of a loop: length of its terminal path laid straight, the same at every pose.
double find_loop_size(const MechanismModel& model, const Loop& loop, const LoopPaths& paths) {
  if (loop.cut == CutType::kCoupling) return 1.0;
  const auto find_length = [&](const std::vector<int>& path, const Vec3<double>& point) {
    double length = point.norm();
    for (size_t i = 0; i < path.size(); ++i) {
      const Body& body = model.bodies[path[i]];
      if (i > 0) length += body.placement.p.norm();
      if (body.joint == JointType::kPrismatic) length += std::abs(model.home_q[body.q_index]);
    }
    return length;
  };
  const double size = find_length(paths.terminal, loop.point_on_terminal);
  if (size > 1e-9) return size;
  const double other = find_length(paths.closing, loop.point_on_closing);
  return other > 1e-9 ? other : 1.0;
}

void check_loop_table(const MechanismModel& model) {
  std::vector<int> owner(model.bodies.size(), -1);
  for (size_t k = 0; k < model.loops.size(); ++k) {
    const Loop& loop = model.loops[k];
    const std::string who = "loop '" + loop.name + "': ";
    const size_t m = find_active_equations(loop).size();
    if (loop.dependent.size() != m) {
      throw ModelError(who + std::to_string(m) + " cut equations but " +
                       std::to_string(loop.dependent.size()) +
                       " dependent joints; list exactly as many joints under 'dependent'");
    }
    if (model.bodies[loop.first].parent != loop.root) {
      throw ModelError(who + "the parent of first body '" + model.bodies[loop.first].name +
                       "' is not the root");
    }
    for (int body : loop.dependent) {
      if (model.bodies[body].joint == JointType::kFree) {
        throw ModelError(who + "dependent joint '" + model.bodies[body].name +
                         "' is free; only single revolute or prismatic joints can be dependent");
      }
      if (owner[body] >= 0) {
        throw ModelError(who + "joint '" + model.bodies[body].name +
                         "' is already determined by loop '" + model.loops[owner[body]].name + "'");
      }
      owner[body] = static_cast<int>(k);
    }
  }
}

/// A planar cut leaves out the equations across its plane: the joints must keep them by themselves.
void check_plane(const MechanismModel& model, const Loop& loop, const LoopPaths& paths,
                 const std::vector<Pose<double>>& home, double size) {
  if (loop.cut != CutType::kPlanarRevolute) return;
  const std::string who = "loop '" + loop.name + "' is not planar: ";
  const Vec3<double> in_root = Vec3<double>(loop.plane_axes_in_root.row(0))
                                   .cross(Vec3<double>(loop.plane_axes_in_root.row(1)));
  const Vec3<double> normal = loop.root == kBase ? in_root : home[loop.root].R * in_root;
  for (const auto* path : {&paths.terminal, &paths.closing}) {
    for (int index : *path) {
      const Body& body = model.bodies[index];
      const Vec3<double> axis = home[index].R * body.axis;
      const bool fits = body.joint == JointType::kRevolute ? axis.cross(normal).norm() < 1e-9
                                                           : body.joint == JointType::kPrismatic &&
                                                                 std::abs(axis.dot(normal)) < 1e-9;
      if (!fits) {
        throw ModelError(who + "joint '" + body.name +
                         "' leaves the plane of its cut; turn 'plane_axes_in_root' or use a "
                         "spherical cut");
      }
    }
  }
  const auto locate = [&](int body, const Vec3<double>& point) {
    return body == kBase ? point : Vec3<double>(home[body].R * point + home[body].p);
  };
  const double gap = normal.dot(locate(loop.terminal, loop.point_on_terminal) -
                                locate(loop.closing, loop.point_on_closing));
  if (std::abs(gap) > 1e-9 * size) {
    throw ModelError(who + "its cut points are " + std::to_string(gap) +
                     " m apart across the plane, which no joint of it can change");
  }
}

/// Axes of the terminal body that stay square to an axis of the closing body.
std::vector<Vec3<double>> find_cross_axes(const Loop& loop) {
  if (loop.cut == CutType::kUniversal) return {loop.axis_on_terminal};
  if (loop.cut != CutType::kRevolute) return {};
  int least = 0;
  loop.axis_on_terminal.cwiseAbs().minCoeff(&least);
  const Vec3<double> first =
      loop.axis_on_terminal.cross(Vec3<double>(Vec3<double>::Unit(least))).normalized();
  return {first, loop.axis_on_terminal.cross(first)};
}

/// needs[a][b]: a joint on a path of loop a is determined by loop b (a != b), or reachable so.
std::vector<std::vector<char>> make_needs(const MechanismModel& model, const LoopPlan& plan) {
  const size_t count = model.loops.size();
  std::vector<std::vector<char>> needs(count, std::vector<char>(count, 0));
  for (size_t a = 0; a < count; ++a) {
    for (size_t b = 0; b < count; ++b) {
      for (int body : model.loops[b].dependent) {
        for (const auto* path :
             {&plan.paths[a].terminal, &plan.paths[a].closing, &plan.paths[a].tied}) {
          if (a != b && std::find(path->begin(), path->end(), body) != path->end()) {
            needs[a][b] = 1;
          }
        }
      }
    }
  }
  for (size_t via = 0; via < count; ++via) {
    for (size_t a = 0; a < count; ++a) {
      for (size_t b = 0; b < count && needs[a][via]; ++b) {
        if (needs[via][b]) needs[a][b] = 1;
      }
    }
  }
  return needs;
}

void order_blocks(const MechanismModel& model, LoopPlan& plan) {
  const auto needs = make_needs(model, plan);
  const size_t count = model.loops.size();
  plan.block_of_loop.assign(count, -1);
  std::vector<char> placed(count, 0);
  for (size_t a = 0; a < count; ++a) placed[a] = model.loops[a].dependent.empty();
  const auto is_ready = [&](size_t a) {
    for (size_t b = 0; b < count; ++b) {
      if (needs[a][b] && !needs[b][a] && !placed[b]) return false;
    }
    return !placed[a];
  };
  for (size_t a = 0; a < count;) {
    if (!is_ready(a)) {
      ++a;
      continue;
    }
    LoopBlock block;
    for (size_t b = 0; b < count; ++b) {
      if (b == a || (needs[a][b] && needs[b][a])) {
        block.loops.push_back(static_cast<int>(b));
        plan.block_of_loop[b] = static_cast<int>(plan.blocks.size());
        placed[b] = 1;
      }
    }
    plan.blocks.push_back(block);
    a = 0;  // the first loop of the table that is ready now
  }
}

void fill_block(const MechanismModel& model, const LoopPlan& plan, LoopBlock& block) {
  std::vector<char> is_dep(model.nv, 0), on_path(model.nv, 0);
  std::vector<double> dep_scale, row_scale;
  for (int k : block.loops) {
    const Loop& loop = model.loops[k];
    const double size = plan.loop_size[k];
    std::array<int, kMaxEquations> rows;
    rows.fill(-1);
    for (int equation : find_active_equations(loop)) {
      rows[equation] = static_cast<int>(row_scale.size());
      row_scale.push_back(equation < 3 ? size : 1.0);
    }
    block.row.push_back(rows);
    for (int body : loop.dependent) {
      block.dep.push_back(model.bodies[body].v_index);
      block.dep_bodies.push_back(body);
      is_dep[model.bodies[body].v_index] = 1;
      dep_scale.push_back(model.bodies[body].joint == JointType::kPrismatic ? size : 1.0);
    }
    if (loop.cut == CutType::kCoupling) {
      // A screw turns by far more than its slide moves: measure it by what it is geared to.
      const double factor = std::abs(find_coupling_factor(loop, loop.dependent[0]));
      for (int body : plan.paths[k].tied) {
        const double ratio = std::abs(find_coupling_factor(loop, body)) / factor;
        dep_scale.back() = std::max(dep_scale.back(), ratio);
      }
      row_scale.back() = factor * dep_scale.back();
    }
    for (const auto* path :
         {&plan.paths[k].terminal, &plan.paths[k].closing, &plan.paths[k].tied}) {
      for (int body : *path) {
        for (int j = 0; j < model.bodies[body].nv(); ++j)
          on_path[model.bodies[body].v_index + j] = 1;
      }
    }
  }
  block.dep_scale = Eigen::Map<VecX<double>>(dep_scale.data(), static_cast<int>(dep_scale.size()));
  block.row_scale = Eigen::Map<VecX<double>>(row_scale.data(), static_cast<int>(row_scale.size()));
  for (int d = 0; d < block.size(); ++d) {
    if (!on_path[block.dep[d]]) {
      throw ModelError("loop '" + model.loops[block.loops[0]].name + "': dependent joint '" +
                       model.bodies[block.dep_bodies[d]].name +
                       "' is not on the loop; it cannot close it");
    }
  }
  std::vector<double> low_scale;
  for (const Body& body : model.bodies) {
    for (int k = 0; k < body.nv(); ++k) {
      const int j = body.v_index + k;
      if (!on_path[j] || is_dep[j]) continue;
      const bool turns =
          body.joint == JointType::kRevolute || (body.joint == JointType::kFree && k >= 3);
      block.low.push_back(j);
      low_scale.push_back(turns ? 1.0 : plan.loop_size[block.loops[0]]);
    }
  }
  block.low_scale = Eigen::Map<VecX<double>>(low_scale.data(), static_cast<int>(low_scale.size()));
  block.column_of.assign(model.nv, -1);
  for (int i = 0; i < block.size(); ++i) block.column_of[block.dep[i]] = i;
  for (size_t j = 0; j < block.low.size(); ++j) {
    block.column_of[block.low[j]] = block.size() + static_cast<int>(j);
  }
}

/// Symbolic elimination, last block first: which rows of A does each block touch?
void find_touched(const MechanismModel& model, LoopPlan& plan) {
  const int nv = model.nv;
  std::vector<std::vector<char>> nonzero(nv, std::vector<char>(nv, 0));
  for (const Body& body : model.bodies) {
    for (const Body* up = &body;;) {
      for (int i = 0; i < body.nv(); ++i) {
        for (int j = 0; j < up->nv(); ++j) {
          nonzero[body.v_index + i][up->v_index + j] = nonzero[up->v_index + j][body.v_index + i] =
              1;
        }
      }
      if (up->parent == kBase) break;
      up = &model.bodies[up->parent];
    }
  }
  std::vector<char> eliminated(nv, 0);
  for (auto block = plan.blocks.rbegin(); block != plan.blocks.rend(); ++block) {
    for (int d : block->dep) eliminated[d] = 1;
    // Couples only what lies above its platform, as the tree does.
    if (block->is_condensed()) continue;
    for (int i = 0; i < nv; ++i) {
      const bool coupled = std::any_of(block->dep.begin(), block->dep.end(),
                                       [&](int d) { return nonzero[i][d] != 0; });
      if (coupled && !eliminated[i]) block->touched.push_back(i);
    }
    for (int l : block->low) {
      for (int t : block->touched) nonzero[t][l] = nonzero[l][t] = 1;
      for (int l2 : block->low) nonzero[l][l2] = 1;
    }
  }
}

/// How the coordinates of a block are found.
Recognition choose_closure(const MechanismModel& model, const LoopPlan& plan,
                           const LoopBlock& block, const std::vector<Pose<double>>& home,
                           const std::vector<double>& q, bool newton_only) {
  const Loop& loop = model.loops[block.loops[0]];
  if (newton_only || loop.closure == ClosureKind::kNewton)
    return {std::nullopt, "as asked for", false};
  if (block.loops.size() > 1) return {std::nullopt, "its loops depend on each other", false};
  const int k = block.loops[0];
  Recognition found = recognise_leg(model, loop, plan.paths[k], home, q, plan.loop_size[k]);
  const bool fits = found.form ? fits_declaration(loop.closure, *found.form) : !found.misfit;
  if (loop.closure == ClosureKind::kAutomatic || fits) return found;
  throw ModelError("loop '" + loop.name + "': its joints do not fit the closure '" +
                   describe_closure(loop.closure) + "' it declares (" +
                   (found.form ? "they are " + describe_leg(*found.form) : found.reason) +
                   "); correct the geometry or leave 'closure' out");
}

}  // namespace

std::vector<Pose<double>> find_poses(const MechanismModel& model,
                                     const std::vector<double>& q_all) {
  std::vector<Pose<double>> pose(model.bodies.size());
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    Pose<double> joint;
    const double* q = q_all.data() + body.q_index;
    if (body.joint == JointType::kRevolute) {
      joint.R = axis_rotation<double>(body.axis, std::cos(q[0]), std::sin(q[0]));
    } else if (body.joint == JointType::kPrismatic) {
      joint.p = body.axis * q[0];
    } else {
      joint.p = Vec3<double>(q[0], q[1], q[2]);
      joint.R = quat_to_matrix<double>({q[3], q[4], q[5], q[6]});
    }
    pose[i] = body.placement * joint;
    if (body.parent != kBase) pose[i] = pose[body.parent] * pose[i];
  }
  return pose;
}

LoopPlan make_loop_paths(const MechanismModel& model, const std::vector<Pose<double>>& home) {
  LoopPlan plan;
  for (const Loop& loop : model.loops) {
    plan.paths.push_back(make_paths(model, loop));
    plan.loop_size.push_back(find_loop_size(model, loop, plan.paths.back()));
    plan.cross_axes.push_back(find_cross_axes(loop));
    check_plane(model, loop, plan.paths.back(), home, plan.loop_size.back());
  }
  return plan;
}

LoopPlan make_loop_plan(const MechanismModel& model, const std::vector<double>& q,
                        bool newton_only) {
  check_loop_table(model);
  const std::vector<Pose<double>> home = find_poses(model, q);
  LoopPlan plan = make_loop_paths(model, home);
  order_blocks(model, plan);
  for (LoopBlock& block : plan.blocks) {
    fill_block(model, plan, block);
    block.closure = choose_closure(model, plan, block, home, q, newton_only);
    block.is_coupling =
        block.loops.size() == 1 && model.loops[block.loops[0]].cut == CutType::kCoupling;
    for (int k : block.loops) block.is_driven = block.is_driven || model.loops[k].rate != 0.0;
    plan.is_driven = plan.is_driven || block.is_driven;
    plan.iterates = plan.iterates || (!block.form() && !block.is_coupling);
  }
  find_platforms(model, home, plan);
  find_touched(model, plan);
  std::vector<char> dependent(model.nv, 0), followed(model.nv, 0);
  for (const LoopBlock& block : plan.blocks) {
    for (int d : block.dep) dependent[d] = 1;
    for (int l : block.low) followed[l] = 1;
  }
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    if (dependent[body.v_index]) continue;
    plan.ind_bodies.push_back(static_cast<int>(i));
    if (followed[body.v_index]) plan.followed.push_back(static_cast<int>(i));
    for (int j = 0; j < body.nv(); ++j) plan.ind_v.push_back(body.v_index + j);
    for (int j = 0; j < body.nq(); ++j) plan.ind_q.push_back(body.q_index + j);
  }
  return plan;
}

}  // namespace dockloop
