// Loop equations and their elimination; see loops.hpp for the equation map.
#include "loops/loops.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dockloop {
namespace {

/// Poses in L of the bodies on one path, and of a point on the last one.
template <class S>
Vec3<S> calc_path(const TreeData<S>& tree, const std::vector<int>& path, const Vec3<double>& point,
                  std::vector<Pose<S>>& pose) {
  for (size_t i = 0; i < path.size(); ++i) {
    pose[i] = i == 0 ? tree.joint[path[i]] : pose[i - 1] * tree.joint[path[i]];
  }
  const Vec3<S> local = point.cast<S>();
  return path.empty() ? local : Vec3<S>(pose.back().R * local + pose.back().p);
}

template <class S>
Vec3<S> rotate_to_lca(const std::vector<Pose<S>>& pose, const Vec3<double>& axis) {
  const Vec3<S> local = axis.cast<S>();
  return pose.empty() ? local : Vec3<S>(pose.back().R * local);
}

/// Positions of one cut and its residual.                                        [Y2 (1), (1u)]
template <class S>
void calc_cut_position(const Loop& loop, const LoopPaths& paths, const TreeData<S>& tree,
                       CutData<S>& cut, S* residual) {
  cut.p_T = calc_path(tree, paths.terminal, loop.point_on_terminal, cut.terminal);
  cut.p_I = calc_path(tree, paths.closing, loop.point_on_closing, cut.closing);
  const Vec3<S> gap = cut.p_T - cut.p_I;
  if (loop.cut == CutType::kPlanarRevolute) {
    cut.plane = loop.plane_axes_in_root.template cast<S>();
    if (paths.root_on_terminal >= 0) {
      cut.plane = (cut.plane * cut.terminal[paths.root_on_terminal].R.transpose()).eval();
    }
    const Eigen::Matrix<S, 2, 1> in_plane = cut.plane * gap;
    residual[0] = in_plane[0];
    residual[1] = in_plane[1];
    return;
  }
  for (int i = 0; i < 3; ++i) residual[i] = gap[i];
  if (loop.cut == CutType::kUniversal) {
    cut.axis_T = rotate_to_lca(cut.terminal, loop.axis_on_terminal);
    cut.axis_I = rotate_to_lca(cut.closing, loop.axis_on_closing);
    residual[3] = cut.axis_T.dot(cut.axis_I);
  }
}

/// Put the columns of one path, times `sign`, into rows row.. of G.                  [Y2 (2)]
template <class S>
void calc_path_columns(const MechanismModel& model, const Loop& loop, const CutData<S>& cut,
                       const std::vector<int>& path, const std::vector<Pose<S>>& pose,
                       const Vec3<S>& point, S sign, int row, const std::vector<int>& column_of,
                       MatX<S>& G) {
  for (size_t i = 0; i < path.size(); ++i) {
    const Body& body = model.bodies[path[i]];
    Vec3<S> e = Vec3<S>::Zero();
    if (body.joint != JointType::kFree) e = pose[i].R * body.axis.template cast<S>();
    const Vec3<S> arm = point - pose[i].p;
    for (int k = 0; k < body.nv(); ++k) {
      Vec3<S> angular, linear;
      get_joint_column(body, pose[i].R, e, k, angular, linear);
      linear += angular.cross(arm);
      const int column = column_of[body.v_index + k];
      if (loop.cut == CutType::kPlanarRevolute) {
        G.col(column).template segment<2>(row) = sign * (cut.plane * linear);
        continue;
      }
      G.col(column).template segment<3>(row) = sign * linear;
      if (loop.cut == CutType::kUniversal) {
        // n = A x B is a unit vector only when the loop is closed and is never normalised.
        G(row + 3, column) = sign * cut.axis_T.cross(cut.axis_I).dot(angular);
      }
    }
  }
}

/// Motion of the end of a path relative to L with zero joint accelerations.
template <class S>
struct PathBias {
  Vec3<S> w = Vec3<S>::Zero(), alpha = Vec3<S>::Zero(), a = Vec3<S>::Zero();
};

template <class S>
PathBias<S> calc_path_bias(const MechanismModel& model, const TreeData<S>& tree,
                           const std::vector<int>& path, const std::vector<Pose<S>>& pose,
                           const Vec3<S>& point) {
  PathBias<S> m;
  Vec3<S> origin = Vec3<S>::Zero();
  for (size_t i = 0; i < path.size(); ++i) {
    const Body& body = model.bodies[path[i]];
    const Vec3<S> r = pose[i].p - origin;
    m.a += m.alpha.cross(r) + m.w.cross(Vec3<S>(m.w.cross(r)));
    origin = pose[i].p;
    switch (body.joint) {
      case JointType::kRevolute: {
        const Vec3<S> rate = pose[i].R * (body.axis.template cast<S>() * tree.v[body.v_index]);
        m.alpha += m.w.cross(rate);
        m.w += rate;
        break;
      }
      case JointType::kPrismatic: {
        const Vec3<S> rate = pose[i].R * (body.axis.template cast<S>() * tree.v[body.v_index]);
        m.a += S(2) * m.w.cross(rate);
        break;
      }
      case JointType::kFree: {
        const Vec3<S> u_rel = pose[i].R * tree.v.template segment<3>(body.v_index);
        const Vec3<S> w_rel = pose[i].R * tree.v.template segment<3>(body.v_index + 3);
        m.a += (S(2) * m.w + w_rel).cross(u_rel);
        m.alpha += m.w.cross(w_rel);
        m.w += w_rel;
        break;
      }
    }
  }
  const Vec3<S> arm = point - origin;
  m.a += m.alpha.cross(arm) + m.w.cross(Vec3<S>(m.w.cross(arm)));
  return m;
}

/// gamma of one cut: residual acceleration at zero joint accelerations.           [Y2 (1), (1u)]
template <class S>
void calc_cut_bias(const MechanismModel& model, const Loop& loop, const LoopPaths& paths,
                   const TreeData<S>& tree, CutData<S>& cut, S* gamma) {
  const PathBias<S> T = calc_path_bias(model, tree, paths.terminal, cut.terminal, cut.p_T);
  const PathBias<S> I = calc_path_bias(model, tree, paths.closing, cut.closing, cut.p_I);
  const Vec3<S> a = T.a - I.a;
  if (loop.cut == CutType::kPlanarRevolute) {
    const Eigen::Matrix<S, 2, 1> in_plane = cut.plane * a;
    gamma[0] = in_plane[0];
    gamma[1] = in_plane[1];
    return;
  }
  for (int i = 0; i < 3; ++i) gamma[i] = a[i];
  if (loop.cut == CutType::kUniversal) {
    const Vec3<S> n = cut.axis_T.cross(cut.axis_I);
    const Vec3<S> n_dot = Vec3<S>(T.w.cross(cut.axis_T)).cross(cut.axis_I) +
                          cut.axis_T.cross(Vec3<S>(I.w.cross(cut.axis_I)));
    gamma[3] = n.dot(T.alpha - I.alpha) + n_dot.dot(T.w - I.w);
  }
}

/// Residual and Jacobian of a block from the joint poses.
template <class S>
void calc_block_position(const MechanismModel& model, const LoopPlan& plan, const LoopBlock& block,
                         const TreeData<S>& tree, LoopData<S>& loops, BlockData<S>& data) {
  if (block.loops.size() > 1) data.G.setZero();
  for (size_t i = 0; i < block.loops.size(); ++i) {
    const int k = block.loops[i];
    const Loop& loop = model.loops[k];
    const LoopPaths& paths = plan.paths[k];
    CutData<S>& cut = loops.cut[k];
    const int row = block.row[i];
    calc_cut_position(loop, paths, tree, cut, data.residual.data() + row);
    calc_path_columns(model, loop, cut, paths.terminal, cut.terminal, cut.p_T, S(1), row,
                      block.column_of, data.G);
    calc_path_columns(model, loop, cut, paths.closing, cut.closing, cut.p_I, S(-1), row,
                      block.column_of, data.G);
  }
}

/// Angle of (c, s) that lies nearest to `near`.
template <class S>
S find_angle(const S& c, const S& s, const S& near) {
  using std::atan2;
  using std::floor;
  const S turn = S(2) * S(3.14159265358979323846264338327950288L);
  const S angle = atan2(s, c);
  return angle + turn * floor((near - angle) / turn + S(0.5));
}

/// Universal joint that points `tip` at the closing point, and the slide between them.
/// The direction of the leg in canonical axes is Ry(p1) Rz(p2) x.                  [Y2 (9a)]
template <class S>
Status calc_slide_leg(const MechanismModel& model, const LoopPlan& plan, int k, const SlideLeg& leg,
                      TreeData<S>& tree, LoopData<S>& loops) {
  using std::sqrt;
  const Loop& loop = model.loops[k];
  const LoopPaths& paths = plan.paths[k];
  CutData<S>& cut = loops.cut[k];
  // Vector from the universal centre to the closing point, canonical axes.
  Vec3<S> to_closing = calc_path(tree, paths.closing, loop.point_on_closing, cut.closing);
  if (paths.root_on_terminal >= 0) {
    Pose<S> root;
    for (int i = 0; i <= paths.root_on_terminal; ++i) root = root * tree.joint[paths.terminal[i]];
    to_closing = root.R.transpose() * (to_closing - root.p);
  }
  const Vec3<S> L = leg.canonical_in_root.template cast<S>().transpose() *
                    (to_closing - leg.centre_in_root.template cast<S>());
  const S dy(leg.tip.y()), dz(leg.tip.z());
  const S square = L.squaredNorm();
  const S xi2 = square - dy * dy - dz * dz;
  const S X2 = L.x() * L.x() + L.z() * L.z() - dz * dz;
  const auto margin = [&](const S& value) {
    return square > S(0) ? static_cast<double>(value / square) : 0.0;
  };
  if (!(xi2 > S(0))) return {StatusCode::kOutOfReach, k, margin(xi2), 0.0};
  if (!(X2 > S(0))) {
    return {X2 < S(0) ? StatusCode::kOutOfReach : StatusCode::kLoopSingular, k, margin(X2), 0.0};
  }
  const S xi = sqrt(xi2), X = sqrt(X2);
  const S in_plane = xi2 + dy * dy;  // = X^2 + ly^2
  const S across = X2 + dz * dz;     // = lx^2 + lz^2
  const S c2 = (xi * X + dy * L.y()) / in_plane, s2 = (xi * L.y() - dy * X) / in_plane;
  const S c1 = (X * L.x() + dz * L.z()) / across, s1 = (dz * L.x() - X * L.z()) / across;
  const int q1 = model.bodies[leg.universal1].q_index, q2 = model.bodies[leg.universal2].q_index;
  tree.q[q1] = find_angle(c1, s1, tree.q[q1]);
  tree.q[q2] = find_angle(c2, s2, tree.q[q2]);
  tree.q[model.bodies[leg.slide].q_index] = xi - S(leg.tip.x());
  calc_joint_pose(model, leg.universal1, c1, s1, tree);
  calc_joint_pose(model, leg.universal2, c2, s2, tree);
  calc_joint_pose(model, leg.slide, tree);
  loops.block[plan.block_of_loop[k]].margin = static_cast<double>(X / sqrt(square));
  return {};
}

/// Newton iteration for the dependent coordinates of a block.                       [Y2 (9)]
/// Steps are measured and capped in scaled form (angles in rad, slides in loop sizes); the accepted
/// closure is at rounding level, and a test tighter than that could cycle for ever.
template <class S>
Status solve_by_newton(const MechanismModel& model, const LoopPlan& plan, const LoopBlock& block,
                       TreeData<S>& tree, LoopData<S>& loops, BlockData<S>& data) {
  using std::abs;
  constexpr int kIterations = 25;
  constexpr double kCap = 0.3, kConverged = 1e-13;
  const S eps(std::numeric_limits<S>::epsilon());
  const int k = block.loops[0];
  const int m = block.size();
  for (int i = 0; i < m; ++i) calc_joint_pose(model, block.dep_bodies[i], tree);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    calc_block_position(model, plan, block, tree, loops, data);
    S largest(0), reach(0);
    for (int i = 0; i < m; ++i) largest = std::max(largest, S(abs(data.residual[i])));
    for (int loop : block.loops) {
      reach = std::max(reach, S(loops.cut[loop].p_T.norm() + loops.cut[loop].p_I.norm()));
    }
    if (!data.lu.factorise(data.G)) return {StatusCode::kLoopSingular, k, 0.0, 0.0};
    data.step = data.residual;
    data.lu.solve(data.step);
    S scaled(0);
    for (int i = 0; i < m; ++i) {
      const double turning = model.bodies[block.dep_bodies[i]].joint == JointType::kPrismatic
                                 ? plan.loop_size[k]
                                 : 1.0;
      scaled = std::max(scaled, S(abs(data.step[i]) / S(turning)));
    }
    if (!(scaled < S(1e30))) return {StatusCode::kLoopNotClosed, k, 0.0, 0.0};
    const S factor = scaled > S(kCap) ? S(kCap) / scaled : S(1);
    for (int i = 0; i < m; ++i) {
      tree.q[model.bodies[block.dep_bodies[i]].q_index] -= factor * data.step[i];
      calc_joint_pose(model, block.dep_bodies[i], tree);
    }
    if (scaled <= S(kConverged) * (eps / S(2.3e-16) + S(1e-3)) || largest <= S(8) * eps * reach) {
      return {};
    }
  }
  return {StatusCode::kLoopNotClosed, k, 0.0, 0.0};
}

}  // namespace

template <class S>
LoopData<S>::LoopData(const MechanismModel& model, const LoopPlan& plan) {
  cut.resize(model.loops.size());
  for (size_t k = 0; k < cut.size(); ++k) {
    cut[k].terminal.resize(plan.paths[k].terminal.size());
    cut[k].closing.resize(plan.paths[k].closing.size());
  }
  for (const LoopBlock& b : plan.blocks) {
    const int m = b.size(), low = static_cast<int>(b.low.size());
    const int touched = static_cast<int>(b.touched.size());
    BlockData<S> data;
    data.G.setZero(m, m + low);
    data.lu.resize(m);
    data.H.setZero(m, low);
    data.W.setZero(m, low);
    data.U.setZero(touched, low);
    data.A_dt.setZero(m, touched);
    data.A_dd.setZero(m, m);
    for (auto* x : {&data.residual, &data.h, &data.b_d, &data.lambda, &data.step}) {
      x->setZero(m);
    }
    block.push_back(data);
  }
  reference_sign.assign(plan.blocks.size(), 0);
}

template <class S>
Status calc_loop_position(const MechanismModel& model, const LoopPlan& plan, TreeData<S>& tree,
                          LoopData<S>& loops) {
  for (int i : plan.ind_bodies) calc_joint_pose(model, i, tree);
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    if (block.slide_leg) {
      const Status status =
          calc_slide_leg(model, plan, block.loops[0], *block.slide_leg, tree, loops);
      if (!status.ok()) return status;
    } else {
      const Status status = solve_by_newton(model, plan, block, tree, loops, data);
      if (!status.ok()) return status;
    }
    calc_block_position(model, plan, block, tree, loops, data);
    if (!data.lu.factorise(data.G)) return {StatusCode::kLoopSingular, block.loops[0], 0.0, 0.0};
    if (!block.slide_leg) {
      // Rows are lengths over the loop size, slides are lengths: C~^-1 = D C^-1.
      data.step = block.dep_scale.template cast<S>();
      data.margin = static_cast<double>(S(1) / data.lu.inverse_norm(data.step));
    }
    data.sign = data.lu.determinant_sign();
    if (!(data.margin >= kSingularMargin)) {
      return {StatusCode::kLoopSingular, block.loops[0], data.margin, 0.0};
    }
    if (loops.reference_sign[b] != 0 && loops.reference_sign[b] != data.sign) {
      return {StatusCode::kBranchChanged, block.loops[0], data.margin, 0.0};
    }
  }
  return {};
}

template <class S>
void calc_velocity_maps(const LoopPlan& plan, LoopData<S>& loops) {
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    BlockData<S>& data = loops.block[b];
    const int m = plan.blocks[b].size();
    for (int j = 0; j < data.H.cols(); ++j) {
      data.H.col(j) = -data.G.col(m + j);
      data.lu.solve(data.H.col(j));
    }
  }
}

template <class S>
void calc_loop_velocity(const LoopPlan& plan, TreeData<S>& tree, const LoopData<S>& loops) {
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    const LoopBlock& block = plan.blocks[b];
    const BlockData<S>& data = loops.block[b];
    for (int i = 0; i < block.size(); ++i) {
      S sum(0);
      for (int j = 0; j < data.H.cols(); ++j) sum += data.H(i, j) * tree.v[block.low[j]];
      tree.v[block.dep[i]] = sum;
    }
  }
}

template <class S>
void calc_loop_bias(const MechanismModel& model, const LoopPlan& plan, const TreeData<S>& tree,
                    LoopData<S>& loops) {
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    for (size_t i = 0; i < block.loops.size(); ++i) {
      const int k = block.loops[i];
      calc_cut_bias(model, model.loops[k], plan.paths[k], tree, loops.cut[k],
                    data.h.data() + block.row[i]);
    }
    data.h = -data.h;
    data.lu.solve(data.h);
  }
}

template <class S>
void reduce_inertia(const LoopPlan& plan, MatX<S>& A, LoopData<S>& loops) {
  for (size_t b = plan.blocks.size(); b-- > 0;) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    const int m = block.size();
    const int n_low = static_cast<int>(block.low.size());
    const int n_touched = static_cast<int>(block.touched.size());
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < n_touched; ++j) data.A_dt(i, j) = A(block.dep[i], block.touched[j]);
      for (int j = 0; j < m; ++j) data.A_dd(i, j) = A(block.dep[i], block.dep[j]);
    }
    // A_ll += A_ld H + (A_ld H)^T + H^T A_dd H
    data.U.noalias() = data.A_dt.transpose().lazyProduct(data.H);
    data.W.noalias() = data.A_dd.lazyProduct(data.H);
    for (int j = 0; j < n_low; ++j) {
      const int column = block.low[j];
      for (int i = 0; i < n_touched; ++i) {
        A(block.touched[i], column) += data.U(i, j);
        A(column, block.touched[i]) += data.U(i, j);
      }
      for (int i = 0; i <= j; ++i) {
        S sum(0);
        for (int d = 0; d < m; ++d) sum += data.H(d, i) * data.W(d, j);
        A(block.low[i], column) += sum;
        if (i != j) A(column, block.low[i]) += sum;
      }
    }
  }
}

template <class S>
void reduce_forces(const LoopPlan& plan, VecX<S>& b, LoopData<S>& loops) {
  for (size_t k = plan.blocks.size(); k-- > 0;) {
    const LoopBlock& block = plan.blocks[k];
    BlockData<S>& data = loops.block[k];
    const int m = block.size();
    for (int i = 0; i < m; ++i) data.b_d[i] = b[block.dep[i]];
    // b_l += -A_ld h + H^T (b_d - A_dd h)
    for (int j = 0; j < data.A_dt.cols(); ++j) {
      S sum(0);
      for (int i = 0; i < m; ++i) sum += data.A_dt(i, j) * data.h[i];
      b[block.touched[j]] -= sum;
    }
    data.step = data.b_d;
    data.step.noalias() -= data.A_dd.lazyProduct(data.h);
    for (int j = 0; j < data.H.cols(); ++j) {
      S sum(0);
      for (int i = 0; i < m; ++i) sum += data.H(i, j) * data.step[i];
      b[block.low[j]] += sum;
    }
  }
}

template <class S>
void calc_loop_acceleration(const LoopPlan& plan, VecX<S>& vdot, const LoopData<S>& loops) {
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    const LoopBlock& block = plan.blocks[b];
    const BlockData<S>& data = loops.block[b];
    for (int i = 0; i < block.size(); ++i) {
      S sum = data.h[i];
      for (int j = 0; j < data.H.cols(); ++j) sum += data.H(i, j) * vdot[block.low[j]];
      vdot[block.dep[i]] = sum;
    }
  }
}

template <class S>
void calc_loop_forces(const LoopPlan& plan, const VecX<S>& vdot, LoopData<S>& loops) {
  for (size_t b = 0; b < plan.blocks.size(); ++b) {
    const LoopBlock& block = plan.blocks[b];
    BlockData<S>& data = loops.block[b];
    // Force the cuts must exert on the dependent joints: Q = A_dl vdot_l + A_dd vdot_d - b_d, with
    // A and b as they were when this block was eliminated.
    for (int i = 0; i < block.size(); ++i) {
      S sum = -data.b_d[i];
      for (int j = 0; j < data.A_dt.cols(); ++j) sum += data.A_dt(i, j) * vdot[block.touched[j]];
      for (int j = 0; j < block.size(); ++j) sum += data.A_dd(i, j) * vdot[block.dep[j]];
      data.lambda[i] = sum;
    }
    data.lu.solve_transposed(data.lambda);
  }
}

#define DOCK_INSTANTIATE(S)                                                                   \
  template struct LoopData<S>;                                                                \
  template Status calc_loop_position<S>(const MechanismModel&, const LoopPlan&, TreeData<S>&, \
                                        LoopData<S>&);                                        \
  template void calc_velocity_maps<S>(const LoopPlan&, LoopData<S>&);                         \
  template void calc_loop_velocity<S>(const LoopPlan&, TreeData<S>&, const LoopData<S>&);     \
  template void calc_loop_bias<S>(const MechanismModel&, const LoopPlan&, const TreeData<S>&, \
                                  LoopData<S>&);                                              \
  template void reduce_inertia<S>(const LoopPlan&, MatX<S>&, LoopData<S>&);                   \
  template void reduce_forces<S>(const LoopPlan&, VecX<S>&, LoopData<S>&);                    \
  template void calc_loop_acceleration<S>(const LoopPlan&, VecX<S>&, const LoopData<S>&);     \
  template void calc_loop_forces<S>(const LoopPlan&, const VecX<S>&, LoopData<S>&);

DOCK_INSTANTIATE(double)
DOCK_INSTANTIATE(long double)

}  // namespace dockloop
