// Maps of motion and momentum, the small system, and its solution for all states; see
// structured_matrix.hpp.
#include "docking/structured_matrix.hpp"

#include <algorithm>

#include "docking/rigid_maps.hpp"
#include "math/decompositions.hpp"

namespace dockloop {
namespace {

/// Turns both parts of a motion or a load.
Mat6<double> make_turn(const Mat3<double>& R) {
  Mat6<double> turn = Mat6<double>::Zero();
  turn.topLeftCorner<3, 3>() = R;
  turn.bottomRightCorner<3, 3>() = R;
  return turn;
}

/// Momentum in body axes about the body's origin from that in axes of O about the origin of O.
Mat6<double> make_momentum_map(const FrameMotion<double>& body) {
  const Mat3<double> R = body.R.transpose();
  Mat6<double> map = make_turn(R);
  map.bottomLeftCorner<3, 3>() = -R * skew<double>(body.p);
  return map;
}

/// Motion in body axes that changes position and attitude q at these rates.
Vec6<double> find_motion(const Mat3<double>& R, const Vec4<double>& q, const double* rate) {
  const Vec4<double> qdot(rate[3], rate[4], rate[5], rate[6]);
  Vec6<double> motion;
  motion.head<3>() = R.transpose() * Vec3<double>(rate[0], rate[1], rate[2]);
  motion.tail<3>() =
      2.0 / q.squaredNorm() * quat_multiply<double>(quat_conjugate<double>(q), qdot).tail<3>();
  return motion;
}

/// rate += g times the rates of position and attitude q under this motion in body axes.
void add_rates(const Mat3<double>& R, const Vec4<double>& q, const Vec6<double>& motion, double g,
               double* rate) {
  Eigen::Map<Vec3<double>>(rate) += g * (R * motion.head<3>());
  Eigen::Map<Vec4<double>>(rate + 3) += g * quat_rate<double>(q, motion.tail<3>());
}

Vec4<double> get_attitude(const double* pose) { return {pose[3], pose[4], pose[5], pose[6]}; }

}  // namespace

// ---------------------------------------------------------------- mechanism block

int find_mechanism_block_size(const DockingModel& model) {
  const int n = model.layout.mechanism_nv, all = n + model.layout.element_bristle_count;
  return all * (n + all);
}

Status calc_mechanism_block(const DockingModel& model, const DiscreteState& discrete,
                            const ContactMemory& memory, const DockingData<double>& at,
                            const Loads& loads, double t, const double* y, DockingPass& pass,
                            double* block) {
  const StateLayout& layout = model.layout;
  const int n = layout.mechanism_nv, all = n + layout.element_bristle_count;
  const auto find_state = [&](int i) {
    return i < n ? layout.mechanism_v + i : layout.element_bristles + i - n;
  };
  Status status;
  pass.data.touches = false;
  for (int first = 0; first < n + all && status.ok(); first += kLanes) {
    const int count = std::min(kLanes, n + all - first);
    start_docking_pass(model, loads, t, y, pass);
    for (int lane = 0; lane < count; ++lane) {
      const int column = first + lane;
      if (column < n) {
        seed_displacement(model, y, column, lane, pass.y);
      } else {
        pass.y[find_state(column - n)].d[lane] = 1.0;
      }
    }
    status = calc_docking_pass(model, discrete, memory, at, pass);
    for (int lane = 0; lane < count; ++lane) {
      double* column = block + all * (first + lane);
      for (int i = 0; i < all; ++i) column[i] = pass.ydot[find_state(i)].d[lane];
    }
  }
  pass.data.touches = true;
  return status;
}

// ---------------------------------------------------------------- one state

StructuredMatrix::StructuredMatrix(const DockingModel& model)
    : layout_(model.layout),
      n_(model.layout.mechanism_nv),
      all_(n_ + model.layout.element_bristle_count),
      skipped_(static_cast<int>(model.mechanism.plan.ind_v.size()) - n_),
      tree_(model.mechanism.model) {
  const MechanismModel& mechanism = model.mechanism.model;
  load_.push_back(make_load(model, mechanism.capture_body));
  for (int i = 1; i < model.contact.body_count(); ++i) {
    load_.push_back(make_load(model, mechanism.contact_bodies[i - 1]));
  }
  if (model.acts_across()) load_.push_back(make_load(model, model.mechanism.vehicle));
  for (int i : model.mechanism_bodies) {
    is_free_.push_back(mechanism.bodies[i].joint == JointType::kFree);
  }
  joint_q_.assign(is_free_.size(), Vec4<double>::Zero());
  for (int i : {kChaser, kTarget}) {
    vehicle_[i].pose = layout_.pose[i];
    vehicle_[i].momentum = layout_.momentum[i];
  }
  carried_.setZero(6, n_);
  J_.setZero(skipped_ + n_, 6);
  L_x_.setZero(all_, n_);
  L_s_.setZero(all_, all_);
  const int size = all_ + 6 * static_cast<int>(load_.size());
  matrix_.setZero(size, size);
  lu_.resize(size);
  twist_.setZero(n_);
  unknown_.setZero(size);
}

StructuredMatrix::Load StructuredMatrix::make_load(const DockingModel& model, int body) const {
  const MechanismModel& mechanism = model.mechanism.model;
  const auto find_column = [&](int of) {
    int column = 0;
    for (int i : model.mechanism_bodies) {
      if (i == of) return column;
      column += mechanism.bodies[i].nv();
    }
    return -1;
  };
  Load load;
  for (int i = body; i != kBase && i != model.mechanism.vehicle; i = mechanism.bodies[i].parent) {
    const Body& moved = mechanism.bodies[i];
    load.joint.push_back({i, moved.v_index, moved.nv(), find_column(i)});
    load.follows_loops = load.follows_loops || load.joint.back().column < 0;
  }
  for (MatX<double>* x : {&load.motion, &load.N_m, &load.N}) x->setZero(6, n_);
  load.B.setZero(n_, 6);
  return load;
}

/// Motion of a body by the velocities of the mechanism.
void StructuredMatrix::calc_motion(const DockingModel& model, const DockingData<double>& at,
                                   Load& load) {
  const TreeData<double>& tree = at.mechanism.tree;
  const Mat3<double> R = at.capture.R.transpose();
  const auto find_column = [&](const Joint& joint, int k) {
    Vec3<double> angular, linear;
    get_joint_column<double>(model.mechanism.model.bodies[joint.body], tree.R[joint.body],
                             tree.e[joint.body], k, angular, linear);
    linear += angular.cross(Vec3<double>(at.capture.p - tree.p[joint.body]));
    Vec6<double> column;
    column << R * linear, R * angular;
    return column;
  };
  load.motion.setZero();
  if (!load.follows_loops) {
    for (const Joint& joint : load.joint) {
      for (int k = 0; k < joint.count; ++k) {
        load.motion.col(joint.column + k) = find_column(joint, k);
      }
    }
    return;
  }
  const LoopPlan& plan = model.mechanism.plan;
  const auto add = [&](int column, double sign) {
    calc_loop_velocity(plan, tree_, at.mechanism.loops);
    for (const Joint& joint : load.joint) {
      for (int k = 0; k < joint.count; ++k) {
        load.motion.col(column) += sign * tree_.v[joint.v_index + k] * find_column(joint, k);
      }
    }
  };
  tree_.v.setZero();
  for (int j = 0; j < n_; ++j) {
    tree_.v[plan.ind_v[skipped_ + j]] = 1.0;
    add(j, 1.0);
    tree_.v[plan.ind_v[skipped_ + j]] = 0.0;
    if (plan.is_driven) add(j, -1.0);  // what moves by itself
  }
}

/// Motion of the mechanism, and its response to the loads on P.
void StructuredMatrix::build_mechanism(const DockingModel& model, const DockingData<double>& at) {
  carried_.setZero();
  for (Load& load : load_) {
    for (MatX<double>* x : {&load.N_m, &load.N, &load.B}) x->setZero();
  }
  if (locked_ || n_ == 0) return;
  const Vehicle& chaser = vehicle_[kChaser];
  Mat6<double> J_c = Mat6<double>::Zero();
  if (skipped_ > 0) {
    const Vec3<double> arm = chaser.R.transpose() * (at.capture.p - at.vehicle[kChaser].p);
    J_c = make_transfer(at.capture.R.transpose() * chaser.R, arm).transpose();
    for (int j = 0; j < n_; ++j) {
      Vec6<double> column = at.mechanism.A_ind.col(6 + j).head<6>();
      solve_leading<6>(at.mechanism.factor, column);
      carried_.col(j) = column;
    }
  }
  for (Load& load : load_) {
    if (!load.acts) continue;
    calc_motion(model, at, load);
    for (int j = 0; j < n_; ++j) {
      const Vec3<double> v = load.motion.col(j).head<3>(), w = load.motion.col(j).tail<3>();
      load.N_m.col(j) << -(v + w.cross(at.relative.p)), -w;
    }
    load.N = load.N_m;
    if (skipped_ > 0) {
      load.N.noalias() -= chaser.N.lazyProduct(carried_);
      J_.topRows<6>() = J_c;
    }
    J_.bottomRows(n_) = load.motion.transpose();
    at.mechanism.factor.solveInPlace(J_);
    load.B = -J_.bottomRows(n_);
  }
}

void StructuredMatrix::build_vehicle(const DockingModel& model, int i,
                                     const DockingData<double>& at, const double* y) {
  Vehicle& vehicle = vehicle_[i];
  const FrameMotion<double>& frame = at.vehicle[i];
  vehicle.R = frame.R;
  vehicle.q = get_attitude(y + vehicle.pose);
  vehicle.to_motion = make_momentum_map(frame);
  if (i == kTarget) {
    vehicle.to_motion.topRows<3>() /= model.vehicle[kTarget].mass;
    vehicle.to_motion.bottomRows<3>() =
        (invert(model.vehicle[kTarget].inertia) * vehicle.to_motion.bottomRows<3>()).eval();
  } else if (locked_) {
    vehicle.to_motion = make_mobility(at.locked->whole) * vehicle.to_motion;
  } else {
    for (int j = 0; j < 6; ++j) {
      Vec6<double> column = vehicle.to_motion.col(j);
      solve_leading<6>(at.mechanism.factor, column);
      vehicle.to_motion.col(j) = column;
    }
  }
  const Vec3<double> arm = frame.R.transpose() * (at.interface[kTarget].p - frame.p);
  const double sign = i == kTarget ? 1.0 : -1.0;
  if (joined_) vehicle.to_motion.setZero();
  vehicle.N = sign * make_transfer(at.capture.R.transpose() * frame.R, arm);
  vehicle.W.noalias() = vehicle.N * vehicle.to_motion;
}

/// What contact, latches, hard dock and forces between the vehicles add, in axes of G.
void StructuredMatrix::build_tangents(const DockingModel& model, const DiscreteState& discrete,
                                      const ContactMemory& memory, const DockingData<double>& at,
                                      double t) {
  for (Load& load : load_) load.tangent = InterfaceTangent();
  // From axes and origin of another frame.
  const auto put_in_G = [&](const FrameMotion<double>& frame, InterfaceTangent& tangent) {
    const Mat6<double> to_frame = make_turn(frame.R.transpose() * at.capture.R);
    Mat6<double> to_G = to_frame.transpose();
    const Vec3<double> arm = at.capture.R.transpose() * (frame.p - at.capture.p);
    to_G.bottomLeftCorner<3, 3>() = skew<double>(arm) * to_G.topLeftCorner<3, 3>();
    for (Mat6<double>* x : {&tangent.stiffness, &tangent.damping}) {
      *x = (to_G * *x * to_frame).eval();
    }
  };
  const auto update = [](Load& load) {
    load.acts = !load.tangent.stiffness.isZero(0.0) || !load.tangent.damping.isZero(0.0);
    return load.acts;
  };
  const bool touches = model.present[kTarget] && !joined_;
  for (int body = 0; body < model.contact.body_count(); ++body) {
    Load& load = load_[body];
    if (touches && !model.contact.empty()) {
      add_contact_tangent(model.contact, body, memory, at.relative, at.contact_work, at.contact,
                          load.tangent);
    }
    if (touches && body == 0) {
      add_latch_tangent(model.latches, discrete.latch.data(), t, at.relative, load.tangent);
    }
    if (update(load) && body > 0) put_in_G(at.contact_bodies[body - 1], load.tangent);
  }
  if (!model.acts_across()) return;
  Load& across = load_.back();
  if (touches && !model.hard_dock.empty()) {
    add_hard_dock_tangent(model.hard_dock, discrete.hard_dock, t, at.across, across.tangent);
  }
  if (touches) add_vehicle_force_tangent(model.forces, at.across, across.tangent);
  if (update(across)) put_in_G(at.interface[kChaser], across.tangent);
}

void StructuredMatrix::build(const DockingModel& model, const DiscreteState& discrete,
                             const ContactMemory& memory, const DockingData<double>& at, double t,
                             const double* y, const double* block) {
  locked_ = at.locked != nullptr;
  joined_ = locked_ && at.locked->has_target;
  build_tangents(model, discrete, memory, at, t);
  for (int i : {kChaser, kTarget}) {
    if (vehicle_[i].pose >= 0) build_vehicle(model, i, at, y);
  }
  build_mechanism(model, at);
  int q = layout_.mechanism_q;
  for (size_t i = 0; i < is_free_.size(); ++i) {
    if (is_free_[i]) joint_q_[i] = get_attitude(y + q);
    q += is_free_[i] ? 7 : 1;
  }
  if (locked_) {
    L_x_.setZero();
    L_s_.setZero();
  } else {
    L_x_ = Eigen::Map<const MatX<double>>(block, all_, n_);
    L_s_ = Eigen::Map<const MatX<double>>(block + all_ * n_, all_, all_);
  }
  to_O_ = make_turn(at.capture.R);
  to_O_.bottomLeftCorner<3, 3>() = skew<double>(at.capture.p) * at.capture.R;
  mobility_.setZero();
  for (int i : {kChaser, kTarget}) {
    if (vehicle_[i].pose >= 0) mobility_ += (i == kTarget ? 1.0 : -1.0) * vehicle_[i].W * to_O_;
  }
}

// ---------------------------------------------------------------- one step size

bool StructuredMatrix::factor(double g) {
  g_ = g;
  matrix_.setIdentity();
  matrix_.topLeftCorner(all_, all_) -= g * L_s_;
  matrix_.topLeftCorner(all_, n_) -= (g * g) * L_x_;
  int row = all_;
  for (Load& load : load_) {
    if (load.acts) {
      load.G = load.tangent.damping + g * load.tangent.stiffness;
      matrix_.block(0, row, n_, 6) = -g * load.B;
      matrix_.block(row, 0, 6, n_) = -load.G.lazyProduct(load.N);
      int column = all_;
      for (const Load& other : load_) {
        if (other.acts) {
          matrix_.block<6, 6>(row, column).noalias() -= g * load.G * mobility_;
        }
        column += 6;
      }
    }
    row += 6;
  }
  return lu_.factorise(matrix_);
}

/// Right-hand side of the small system, its solution, and everything that follows from that.
void StructuredMatrix::solve(double* x) {
  const double g = g_;
  Vec6<double> momentum_part = Vec6<double>::Zero(), displacement = momentum_part;
  int q = layout_.mechanism_q, v = 0;
  for (size_t i = 0; i < is_free_.size(); ++i) {
    if (is_free_[i]) {
      const Mat3<double> R = quat_to_matrix<double>(joint_q_[i]);
      twist_.segment<6>(v) = find_motion(R, joint_q_[i], x + q);
      q += 7;
      v += 6;
    } else {
      twist_[v++] = x[q++];
    }
  }
  for (const Vehicle& vehicle : vehicle_) {
    if (vehicle.pose < 0) continue;
    const Eigen::Map<const Vec6<double>> rate(x + vehicle.momentum);
    momentum_part.noalias() += vehicle.W * rate;
    displacement.noalias() += vehicle.N * find_motion(vehicle.R, vehicle.q, x + vehicle.pose);
  }
  Eigen::Map<VecX<double>> v_m(x + layout_.mechanism_v, n_);
  Eigen::Map<VecX<double>> bristles(x + layout_.element_bristles, all_ - n_);
  Vec6<double> F = Vec6<double>::Zero();
  unknown_.head(n_) = g * v_m;
  unknown_.segment(n_, all_ - n_) = g * bristles;
  unknown_.head(all_) += (g * g) * L_x_.lazyProduct(twist_);
  unknown_.tail(unknown_.size() - all_).setZero();
  int row = all_;
  for (const Load& load : load_) {
    if (load.acts) {
      Vec6<double> moved = displacement;
      moved.noalias() += load.N_m.lazyProduct(twist_);
      unknown_.segment<6>(row) = g * (load.G * momentum_part + load.tangent.stiffness * moved);
    }
    row += 6;
  }
  lu_.solve(unknown_);
  v_m = unknown_.head(n_);
  for (row = all_; row < unknown_.size(); row += 6) F += unknown_.segment<6>(row);

  const Vec6<double> exchanged = to_O_ * F;
  for (int i : {kChaser, kTarget}) {
    const Vehicle& vehicle = vehicle_[i];
    if (vehicle.pose < 0) continue;
    Eigen::Map<Vec6<double>> momentum(x + vehicle.momentum);
    momentum = g * (i == kTarget ? Vec6<double>(momentum + exchanged)
                                 : Vec6<double>(momentum - exchanged));
    Vec6<double> motion = vehicle.to_motion * momentum;
    if (i == kChaser) motion.noalias() -= carried_.lazyProduct(v_m);
    for (int j = 0; j < 7; ++j) x[vehicle.pose + j] *= g;
    add_rates(vehicle.R, vehicle.q, motion, g, x + vehicle.pose);
  }
  q = layout_.mechanism_q;
  v = 0;
  for (size_t i = 0; i < is_free_.size(); ++i) {
    const int count = is_free_[i] ? 7 : 1;
    for (int j = 0; j < count; ++j) x[q + j] *= g;
    if (is_free_[i]) {
      add_rates(quat_to_matrix<double>(joint_q_[i]), joint_q_[i], v_m.segment<6>(v), g, x + q);
    } else {
      x[q] += g * v_m[v];
    }
    q += count;
    v += is_free_[i] ? 6 : 1;
  }
  for (int i = layout_.sums; i < layout_.size; ++i) x[i] *= g;
  bristles = unknown_.segment(n_, all_ - n_);
}

}  // namespace dockloop
