// Redundant equations and the choice of independent coordinates; see loop_analysis.hpp.
#include "loops/loop_analysis.hpp"

#include <algorithm>
#include <functional>

#include "loops/loop_equations.hpp"
#include "math/decompositions.hpp"

namespace dockloop {
namespace {

constexpr double kRank = 1e-8;  ///< pivots below this part of the largest count as zero

/// All equations of all loops at one pose.
class FullSystem {
 public:
  FullSystem(const MechanismModel& model, const std::vector<double>& q)
      : model_(model), plan_(make_loop_paths(model, find_poses(model, q))), tree_(model) {
    double length = 0.0;
    for (const double size : plan_.loop_size) length = std::max(length, size);
    column_scale_.setOnes(model.nv);
    for (const Body& body : model.bodies) {
      if (body.joint == JointType::kPrismatic) column_scale_[body.v_index] = length;
      if (body.joint == JointType::kFree) {
        column_scale_.segment<3>(body.v_index).setConstant(length);
      }
    }
    for (size_t k = 0; k < model.loops.size(); ++k) {
      CutData<double> cut;
      cut.terminal.resize(plan_.paths[k].terminal.size());
      cut.closing.resize(plan_.paths[k].closing.size());
      cut_.push_back(cut);
      std::array<int, kMaxEquations> rows;
      rows.fill(-1);
      for (int equation : find_active_equations(model.loops[k])) {
        rows[equation] = static_cast<int>(row_loop.size());
        row_loop.push_back(static_cast<int>(k));
        row_equation.push_back(equation);
      }
      rows_.push_back(rows);
    }
    G.setZero(static_cast<int>(row_loop.size()), model.nv);
    residual.setZero(G.rows());
    set_pose(q);
  }

  void set_pose(const std::vector<double>& q) {
    for (int i = 0; i < model_.nq; ++i) tree_.q[i] = q[static_cast<size_t>(i)];
    std::vector<int> column_of(static_cast<size_t>(model_.nv));
    for (int j = 0; j < model_.nv; ++j) column_of[static_cast<size_t>(j)] = j;
    for (size_t i = 0; i < model_.bodies.size(); ++i) {
      calc_joint_pose(model_, static_cast<int>(i), tree_);
    }
    G.setZero();
    for (size_t k = 0; k < model_.loops.size(); ++k) {
      const int loop = static_cast<int>(k);
      calc_cut_position(model_, plan_, loop, tree_, cut_[k]);
      calc_cut_columns(model_, plan_, loop, rows_[k], column_of, cut_[k], G);
      for (int j = 0; j < kMaxEquations; ++j) {
        if (rows_[k][j] >= 0) residual[rows_[k][j]] = cut_[k].residual[j];
      }
    }
    for (int i = 0; i < G.rows(); ++i) {
      const bool angular = row_equation[i] >= 3;
      double scale = angular ? 1.0 : plan_.loop_size[row_loop[i]];
      const Loop& loop = model_.loops[row_loop[i]];
      if (loop.cut == CutType::kCoupling) {
        scale = column_scale_[model_.bodies[loop.terminal].v_index];
      }
      residual[i] /= scale;
      G.row(i) = G.row(i).cwiseProduct(column_scale_.transpose()) / scale;
    }
  }

  /// Is a velocity on a path of this loop?
  bool touches(int loop, int velocity) const {
    const LoopPaths& paths = plan_.paths[loop];
    for (const auto* path : {&paths.terminal, &paths.closing, &paths.tied}) {
      for (int body : *path) {
        const int k = velocity - model_.bodies[body].v_index;
        if (k >= 0 && k < model_.bodies[body].nv()) return true;
      }
    }
    return false;
  }

  /// q moved by a dimensionless velocity step.
  std::vector<double> move(const std::vector<double>& q, const VecX<double>& step) const {
    std::vector<double> moved = q;
    for (const Body& body : model_.bodies) {
      const VecX<double> dv = step.segment(body.v_index, body.nv())
                                  .cwiseProduct(column_scale_.segment(body.v_index, body.nv()));
      double* at = moved.data() + body.q_index;
      if (body.joint != JointType::kFree) {
        at[0] += dv[0];
        continue;
      }
      const Vec4<double> quat(at[3], at[4], at[5], at[6]);
      const Vec3<double> shift = quat_to_matrix<double>(quat) * dv.head<3>();
      const Vec4<double> turned =
          quat_multiply<double>(quat, quat_exp<double>(Vec3<double>(dv.tail<3>())));
      for (int j = 0; j < 3; ++j) at[j] += shift[j];
      for (int j = 0; j < 4; ++j) at[3 + j] = turned[j];
    }
    return moved;
  }

  /// Close all loops from q by Gauss-Newton steps of least size in the given velocities.
  bool close(std::vector<double>& q, const std::vector<int>& velocities) {
    for (int iteration = 0; iteration < 50; ++iteration) {
      set_pose(q);
      const double open = residual.size() > 0 ? residual.cwiseAbs().maxCoeff() : 0.0;
      if (open < 1e-13) return true;
      if (velocities.empty()) return open < 1e-10;
      MatX<double> part(G.rows(), static_cast<int>(velocities.size()));
      for (size_t j = 0; j < velocities.size(); ++j) {
        part.col(static_cast<int>(j)) = G.col(velocities[j]);
      }
      const VecX<double> step = solve_least(part, residual, kRank);
      const double size = step.cwiseAbs().maxCoeff();
      if (!(size < 1e6)) return false;
      if (size < 1e-13) return open < 1e-10;
      VecX<double> full = VecX<double>::Zero(model_.nv);
      for (size_t j = 0; j < velocities.size(); ++j) {
        full[velocities[j]] = -step[static_cast<int>(j)] * std::min(1.0, 0.3 / size);
      }
      q = move(q, full);
    }
    return residual.cwiseAbs().maxCoeff() < 1e-10;
  }

  /// Orthonormal basis of the motions that keep all loops closed, as columns.
  MatX<double> find_motions() const { return find_null_space(G, kRank); }

  MatX<double> G;  ///< dimensionless: equations x velocities
  VecX<double> residual;
  std::vector<int> row_loop, row_equation;

 private:
  const MechanismModel& model_;
  LoopPlan plan_;
  TreeData<double> tree_;
  std::vector<CutData<double>> cut_;
  std::vector<std::array<int, kMaxEquations>> rows_;
  VecX<double> column_scale_;
};

/// Share joints out among loops, each loop as many as it has equations: a joint goes to its present
/// owner where that is possible (augmenting paths).
std::optional<Dependents> assign_owners(const MechanismModel& model, const FullSystem& system,
                                        const std::vector<int>& joints) {
  const size_t loops = model.loops.size();
  Dependents owned(loops);
  std::vector<size_t> room(loops);
  for (size_t k = 0; k < loops; ++k) room[k] = find_active_equations(model.loops[k]).size();
  std::vector<char> seen;
  const std::function<bool(int)> place = [&](int joint) {
    std::vector<size_t> order;
    for (size_t k = 0; k < loops; ++k) {
      const std::vector<int>& now = model.loops[k].dependent;
      const bool owner = std::find(now.begin(), now.end(), joint) != now.end();
      order.insert(owner ? order.begin() : order.end(), k);
    }
    for (size_t k : order) {
      if (seen[k] || room[k] == 0 ||
          !system.touches(static_cast<int>(k), model.bodies[joint].v_index)) {
        continue;
      }
      seen[k] = 1;
      if (owned[k].size() < room[k]) {
        owned[k].push_back(joint);
        return true;
      }
      for (size_t i = 0; i < owned[k].size(); ++i) {
        const int other = owned[k][i];
        owned[k].erase(owned[k].begin() + static_cast<std::ptrdiff_t>(i));
        if (place(other)) {
          owned[k].push_back(joint);
          return true;
        }
        owned[k].insert(owned[k].begin() + static_cast<std::ptrdiff_t>(i), other);
      }
    }
    return false;
  };
  for (int joint : joints) {
    seen.assign(loops, 0);
    if (!place(joint)) return std::nullopt;
  }
  for (std::vector<int>& list : owned) std::sort(list.begin(), list.end());
  return owned;
}

std::vector<int> find_listed_joints(const MechanismModel& model) {
  std::vector<int> joints;
  for (const Loop& loop : model.loops) {
    for (int body : loop.dependent) {
      if (std::find(joints.begin(), joints.end(), body) == joints.end()) joints.push_back(body);
    }
  }
  return joints;
}

}  // namespace

std::vector<std::string> remove_redundancy(MechanismModel& model) {
  std::vector<std::string> notes;
  if (model.loops.empty()) return notes;
  std::vector<double> q = model.home_q;
  FullSystem system(model, q);
  const int equations = static_cast<int>(system.G.rows());
  const std::vector<int> listed = find_listed_joints(model);
  std::vector<int> every, velocities;
  for (int j = 0; j < model.nv; ++j) every.push_back(j);
  for (int joint : listed) {
    if (model.bodies[joint].nv() == 1) velocities.push_back(model.bodies[joint].v_index);
  }
  if (!system.close(q, velocities)) return notes;  // close_home() will say so
  const int rank = find_rank(system.G, kRank);
  if (rank == equations) return notes;
  // Singular only here, or redundant everywhere? Look from a pose nearby.
  const MatX<double> motions = system.find_motions();
  for (int sign : {1, -1}) {
    std::vector<double> nearby = q;
    if (motions.cols() > 0) {
      nearby = system.move(q, VecX<double>(motions.rowwise().sum().normalized() *
                                           (0.05 * static_cast<double>(sign))));
    }
    // Off the pose, equations that are redundant must still have a common solution.
    if (!system.close(nearby, every) || find_rank(system.G, kRank) != rank) return notes;
  }
  const std::vector<int> kept = find_pivots(system.G.transpose(), rank);
  MatX<double> columns(rank, static_cast<int>(velocities.size()));
  for (int i = 0; i < rank; ++i) {
    for (size_t j = 0; j < velocities.size(); ++j) {
      columns(i, static_cast<int>(j)) = system.G(kept[static_cast<size_t>(i)], velocities[j]);
    }
  }
  const std::string found =
      "the loops have " + std::to_string(equations) + " equations of rank " + std::to_string(rank);
  if (static_cast<int>(velocities.size()) < rank) {
    throw ModelError(found + ", but only " + std::to_string(velocities.size()) +
                     " joints are listed as dependent; list more");
  }
  const auto is_kept = [&](int row) { return std::binary_search(kept.begin(), kept.end(), row); };
  for (int i = 0; i < equations; ++i) {
    if (!is_kept(i)) model.loops[system.row_loop[i]].redundant.push_back(system.row_equation[i]);
  }
  std::vector<int> joints;
  for (int j : find_pivots(columns, rank)) {
    for (const Body& body : model.bodies) {
      if (body.v_index == velocities[static_cast<size_t>(j)]) {
        joints.push_back(static_cast<int>(&body - model.bodies.data()));
      }
    }
  }
  const std::optional<Dependents> owners = assign_owners(model, system, joints);
  if (!owners) throw ModelError(found + "; no choice of dependent joints among those listed fits");
  for (size_t k = 0; k < model.loops.size(); ++k) {
    Loop& loop = model.loops[k];
    loop.dependent = (*owners)[k];
    if (loop.redundant.empty()) continue;
    std::string text = "loop '" + loop.name + "': " + std::to_string(loop.redundant.size()) +
                       " of its " + std::to_string(equation_count(loop.cut)) +
                       " equations follow from others (" + found + "); left out";
    notes.push_back(text);
  }
  for (int joint : listed) {
    if (std::find(joints.begin(), joints.end(), joint) != joints.end()) continue;
    notes.push_back("joint '" + model.bodies[joint].name +
                    "', listed as dependent, is determined by no equation and stays independent");
  }
  return notes;
}

std::optional<Dependents> find_better_dependents(const MechanismModel& model,
                                                 const std::vector<double>& q) {
  const FullSystem system(model, q);
  const MatX<double> motions = system.find_motions();
  const int n = static_cast<int>(motions.cols());
  if (n != model.nv - static_cast<int>(system.G.rows())) return std::nullopt;  // rank loss
  // Smallest singular value of the rows that a choice of independents takes from `motions`.
  const auto find_quality = [&](const std::vector<int>& rows) {
    MatX<double> part(n, n);
    for (int i = 0; i < n; ++i) part.row(i) = motions.row(rows[static_cast<size_t>(i)]);
    return n > 0 ? find_singular_values(part)[n - 1] : 1.0;
  };
  std::vector<char> dependent(static_cast<size_t>(model.nv), 0);
  for (const Loop& loop : model.loops) {
    for (int body : loop.dependent) dependent[static_cast<size_t>(model.bodies[body].v_index)] = 1;
  }
  std::vector<int> present, best;
  for (int j = 0; j < model.nv; ++j) {
    if (!dependent[static_cast<size_t>(j)]) present.push_back(j);
  }
  // Best choice: velocities of free joints first, then greedily what is farthest from the span.
  MatX<double> left = motions;
  const auto take = [&](int row) {
    best.push_back(row);
    const VecX<double> direction = left.row(row).transpose().normalized();
    left -= (left * direction * direction.transpose()).eval();
  };
  for (const Body& body : model.bodies) {
    for (int k = 0; body.joint == JointType::kFree && k < 6; ++k) {
      if (!(left.row(body.v_index + k).norm() > kRank)) return std::nullopt;
      take(body.v_index + k);
    }
  }
  while (static_cast<int>(best.size()) < n) {
    int farthest = 0;
    left.rowwise().norm().maxCoeff(&farthest);
    take(farthest);
  }
  if (!(find_quality(present) < kChangeBelow * find_quality(best))) return std::nullopt;
  std::vector<int> joints;
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    if (body.nv() == 1 && std::find(best.begin(), best.end(), body.v_index) == best.end()) {
      joints.push_back(static_cast<int>(i));
    }
  }
  return assign_owners(model, system, joints);
}

}  // namespace dockloop
