// Paths, dependency blocks, elimination pattern and closed-form recognition; see loop_plan.hpp.
#include "loops/loop_plan.hpp"

#include <algorithm>
#include <cmath>
#include <string>

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
  if (loop.root != paths.lca) {
    const auto at = std::find(paths.terminal.begin(), paths.terminal.end(), loop.root);
    if (at == paths.terminal.end()) {
      throw ModelError("loop '" + loop.name + "': root is not on the path to the terminal body");
    }
    paths.root_on_terminal = static_cast<int>(at - paths.terminal.begin());
  }
  return paths;
}

/// Home poses of all bodies in the base, from home_q (dependents as they stand there).
std::vector<Pose<double>> make_home_poses(const MechanismModel& model) {
  std::vector<Pose<double>> pose(model.bodies.size());
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    Pose<double> joint;
    const double* q = model.home_q.data() + body.q_index;
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

/// Scale of a loop: distance from the first joint to the cut point at home.
double find_loop_size(const Loop& loop, const std::vector<Pose<double>>& home) {
  const Vec3<double> cut =
      loop.closing == kBase
          ? loop.point_on_closing
          : Vec3<double>(home[loop.closing].R * loop.point_on_closing + home[loop.closing].p);
  const double size = (cut - home[loop.first].p).norm();
  const double fallback = loop.point_on_terminal.norm();
  if (size > 1e-9) return size;
  return fallback > 1e-9 ? fallback : 1.0;
}

/// Universal joint, slide along its third axis, spherical cut, all hung on the root.
std::optional<SlideLeg> find_slide_leg(const MechanismModel& model, const Loop& loop) {
  if (loop.cut != CutType::kSpherical || loop.dependent.size() != 3) return std::nullopt;
  const Body& third = model.bodies[loop.terminal];
  if (third.parent == kBase || model.bodies[third.parent].parent == kBase) return std::nullopt;
  const int second_index = third.parent;
  const Body& second = model.bodies[second_index];
  const int first_index = second.parent;
  const Body& first = model.bodies[first_index];
  if (first_index != loop.first || first.parent != loop.root) return std::nullopt;
  for (int body : {first_index, second_index, loop.terminal}) {
    if (std::find(loop.dependent.begin(), loop.dependent.end(), body) == loop.dependent.end()) {
      return std::nullopt;
    }
  }
  if (first.joint != JointType::kRevolute || second.joint != JointType::kRevolute ||
      third.joint != JointType::kPrismatic) {
    return std::nullopt;
  }
  // Geometry at zero coordinates, axes of the first joint.
  constexpr double kFits = 1e-12;
  const Vec3<double> a1 = first.axis;
  const Vec3<double> a2 = second.placement.R * second.axis;
  const Mat3<double> R3 = second.placement.R * third.placement.R;
  const Vec3<double> a3 = R3 * third.axis;
  if (second.placement.p.norm() > kFits || std::abs(a1.dot(a2)) > kFits ||
      (a1.cross(a2) - a3).norm() > 2 * kFits) {
    return std::nullopt;
  }
  Mat3<double> canonical;
  canonical << a1.cross(a2), a1, a2;
  SlideLeg leg;
  leg.universal1 = first_index;
  leg.universal2 = second_index;
  leg.slide = loop.terminal;
  leg.canonical_in_root = first.placement.R * canonical;
  leg.centre_in_root = first.placement.p;
  leg.tip = canonical.transpose() *
            (second.placement.R * third.placement.p + R3 * loop.point_on_terminal);
  return leg;
}

void check_loop_table(const MechanismModel& model) {
  std::vector<int> owner(model.bodies.size(), -1);
  for (size_t k = 0; k < model.loops.size(); ++k) {
    const Loop& loop = model.loops[k];
    const std::string who = "loop '" + loop.name + "': ";
    const int m = equation_count(loop.cut);
    if (static_cast<int>(loop.dependent.size()) != m) {
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

/// needs[a][b]: a joint on a path of loop a is determined by loop b (a != b), or reachable so.
std::vector<std::vector<char>> make_needs(const MechanismModel& model, const LoopPlan& plan) {
  const size_t count = model.loops.size();
  std::vector<std::vector<char>> needs(count, std::vector<char>(count, 0));
  for (size_t a = 0; a < count; ++a) {
    for (size_t b = 0; b < count; ++b) {
      for (int body : model.loops[b].dependent) {
        for (const auto* path : {&plan.paths[a].terminal, &plan.paths[a].closing}) {
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
  for (size_t done = 0; done < count;) {
    for (size_t a = 0; a < count; ++a) {
      if (plan.block_of_loop[a] >= 0) continue;
      bool ready = true;
      for (size_t b = 0; b < count; ++b) {
        if (needs[a][b] && !needs[b][a] && plan.block_of_loop[b] < 0) ready = false;
      }
      if (!ready) continue;
      LoopBlock block;
      for (size_t b = 0; b < count; ++b) {
        if (b == a || (needs[a][b] && needs[b][a])) {
          block.loops.push_back(static_cast<int>(b));
          plan.block_of_loop[b] = static_cast<int>(plan.blocks.size());
          ++done;
        }
      }
      plan.blocks.push_back(block);
      break;
    }
  }
}

void fill_block(const MechanismModel& model, const LoopPlan& plan, LoopBlock& block) {
  int row = 0;
  std::vector<char> is_dep(model.nv, 0), is_low(model.nv, 0);
  std::vector<double> scale;
  for (int k : block.loops) {
    block.row.push_back(row);
    row += equation_count(model.loops[k].cut);
    for (int body : model.loops[k].dependent) {
      block.dep.push_back(model.bodies[body].v_index);
      block.dep_bodies.push_back(body);
      is_dep[model.bodies[body].v_index] = 1;
      scale.push_back(model.bodies[body].joint == JointType::kPrismatic ? 1.0 : plan.loop_size[k]);
    }
  }
  block.dep_scale = Eigen::Map<VecX<double>>(scale.data(), static_cast<int>(scale.size()));
  std::vector<char> on_path(model.nv, 0);
  for (int k : block.loops) {
    for (const auto* path : {&plan.paths[k].terminal, &plan.paths[k].closing}) {
      for (int body : *path) {
        for (int j = 0; j < model.bodies[body].nv(); ++j)
          on_path[model.bodies[body].v_index + j] = 1;
      }
    }
  }
  for (int d = 0; d < block.size(); ++d) {
    if (!on_path[block.dep[d]]) {
      throw ModelError("loop '" + model.loops[block.loops[0]].name + "': dependent joint '" +
                       model.bodies[block.dep_bodies[d]].name +
                       "' is not on the loop; it cannot close it");
    }
  }
  for (int j = 0; j < model.nv; ++j) {
    if (on_path[j] && !is_dep[j]) block.low.push_back(j);
  }
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

}  // namespace

LoopPlan make_loop_plan(const MechanismModel& model, bool newton_only) {
  check_loop_table(model);
  LoopPlan plan;
  const std::vector<Pose<double>> home = make_home_poses(model);
  for (const Loop& loop : model.loops) {
    plan.paths.push_back(make_paths(model, loop));
    plan.loop_size.push_back(find_loop_size(loop, home));
  }
  order_blocks(model, plan);
  for (LoopBlock& block : plan.blocks) {
    fill_block(model, plan, block);
    if (block.loops.size() != 1) continue;
    const Loop& loop = model.loops[block.loops[0]];
    if (!newton_only && loop.closure != ClosureKind::kNewton && loop.branch > 0) {
      block.slide_leg = find_slide_leg(model, loop);
    }
    if (loop.closure == ClosureKind::kR2P1R3 && !newton_only && !block.slide_leg) {
      throw ModelError("loop '" + loop.name +
                       "': closure 'R2P1R3' does not fit its joints (two orthogonal revolute axes "
                       "through one point, then a slide along their cross product, branch +1); "
                       "correct the geometry or leave 'closure' out");
    }
  }
  find_touched(model, plan);
  std::vector<char> dependent(model.nv, 0);
  for (const LoopBlock& block : plan.blocks) {
    for (int d : block.dep) dependent[d] = 1;
  }
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    if (dependent[body.v_index]) continue;
    plan.ind_bodies.push_back(static_cast<int>(i));
    for (int j = 0; j < body.nv(); ++j) plan.ind_v.push_back(body.v_index + j);
    for (int j = 0; j < body.nq(); ++j) plan.ind_q.push_back(body.q_index + j);
  }
  return plan;
}

}  // namespace dockloop
