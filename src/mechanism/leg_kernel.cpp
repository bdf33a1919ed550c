// Set-up and assembly of a ring on legs; see leg_kernel.hpp.
#include "mechanism/leg_kernel.hpp"

#include <algorithm>
#include <cmath>

#include "loops/leg_lanes.hpp"

namespace dockloop {
namespace {

using legs::LegGroup;
using V = Vec3<double>;
using Mat = Mat3<double>;

constexpr double kLeastMargin = 0.1;     ///< below, the general code watches branches [-]
constexpr double kLeastReference = 0.3;  ///< the same for the last accepted pose

static_assert(static_cast<int>(LegKind::kR2P1R3) == legs::kSlideLeg &&
              static_cast<int>(LegKind::kR1R2R3) == legs::kCrankLeg &&
              static_cast<int>(LegKind::kR1R2R3Perpendicular) == legs::kSquareCrankLeg);

Mat get_symmetric(const double* s) {
  Mat m;
  m << s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2];
  return m;
}
Mat get_columns(const double* m) { return Eigen::Map<const Mat>(m); }
Mat get_rows(const double* m) { return Eigen::Map<const Mat>(m).transpose(); }
V get_vector(const double* v) { return Eigen::Map<const V>(v); }

/// Mass, first moment, inertia about an origin.
struct Moments {
  double mass = 0.0;
  V first = V::Zero();
  Mat inertia = Mat::Zero();
};

/// Of a body, about the origin of axes in which it has this pose.
Moments find_moments(const Body& body, const Pose<double>& pose) {
  const V c = pose.R * body.com + pose.p;
  return {body.mass, body.mass * c,
          pose.R * body.inertia * pose.R.transpose() +
              body.mass * (c.squaredNorm() * Mat::Identity() - c * c.transpose())};
}

/// A leg and the lane in which it stands.
struct LegPlace {
  size_t block = 0, group = 0;
  int lane = 0;
  int q[3] = {}, v[3] = {};  ///< indices of the joint coordinates, from the root outwards
  double sign[3] = {};       ///< of the canonical coordinates in them
  V ring;                    ///< tip on the ring, axes of the ring
  ClosedForm form;
};

/// A joint whose motion is found: one that slides or carries a force.
struct ToldJoint {
  int q = 0, v = 0;
  double sign = 1.0, zero = 0.0;                    ///< canonical coordinate = sign q + zero
  const double* rate = nullptr;                     ///< canonical, in its lane
  const double *slide = nullptr, *angle = nullptr;  ///< either, where it is needed
};

/// Does a force depend on the coordinate of its joint?
bool depends_on_place(const JointForce& law) {
  return law.stiffness != 0.0 || law.preload != 0.0 || law.stops.present;
}

class LegKernel : public MechanismKernel {
 public:
  LegKernel(const Mechanism& mechanism, const legs::LegFunctions& functions);

  bool calc_position(MechanismData<double>& data) override;
  void calc_velocity(const BaseMotion<double>& base, MechanismData<double>& data) override;
  void calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) override;
  bool finds_momentum() const override { return true; }
  V find_linear_momentum() const override;
  bool serves_accepted_states() const override { return true; }
  double find_margin() const override;
  void keep_reference(MechanismData<double>& data) const override;
  void calc_reactions(const BaseMotion<double>& base, MechanismData<double>& data) override;

 private:
  void add_leg(const Mechanism& mechanism, LegPlace& place, int loop);
  bool continues(const LoopReference<double>& reference) const;
  bool calc_legs(bool moving);
  double find_margin(const LegPlace& leg) const;
  double get_work(const LegPlace& leg, int row) const {
    return groups_[leg.group].work[row][leg.lane];
  }
  Mat6<double> find_carried() const;
  Wrench<double> find_ring_load(const V& a0, const V& alpha0, const V& vdot, const V& wdot) const;
  void put_pose(const Body& body, int index, TreeData<double>& tree) const;

  const legs::LegFunctions& functions_;
  std::vector<LegPlace> places_;
  std::vector<ToldJoint> told_;
  bool angles_[3] = {};  ///< is one told of the first, second, third joints?
  std::vector<LegGroup> groups_;
  Body ring_, vehicle_;
  int ring_index_ = 0;
  bool is_free_ = false;  ///< the root is a vehicle
  double margin_ = kLeastMargin;
  Moments ring_moments_, vehicle_moments_;
  double leg_mass_ = 0.0;
  legs::Platform platform_{};
  double sums_[legs::kPositionSums] = {}, bias_[legs::kBiasSums] = {};
  V root_a_ = V::Zero(), root_alpha_ = V::Zero();  ///< of the root, as far as known before, P
};

LegKernel::LegKernel(const Mechanism& mechanism, const legs::LegFunctions& functions)
    : functions_(functions) {
  const MechanismModel& model = mechanism.model;
  is_free_ = mechanism.plan.ind_bodies.size() == 2;
  ring_index_ = mechanism.plan.ind_bodies.back();
  ring_ = model.bodies[ring_index_];
  ring_moments_ = find_moments(ring_, {});
  if (is_free_) {
    vehicle_ = model.bodies[0];
    vehicle_moments_ = find_moments(vehicle_, {});
  }
  margin_ = std::max(kLeastMargin, model.singularity.error);
  places_.resize(model.loops.size());
  for (size_t k = 0; k < places_.size(); ++k) {
    places_[k].block = static_cast<size_t>(mechanism.plan.block_of_loop[k]);
    places_[k].form = *mechanism.plan.blocks[places_[k].block].form();
  }
  for (int type = legs::kSlideLeg; type <= legs::kSquareCrankLeg; ++type) {
    int lane = kGroup;
    for (size_t k = 0; k < places_.size(); ++k) {
      LegPlace& place = places_[k];
      if (static_cast<int>(place.form.kind) != type) continue;
      if (lane == kGroup) {
        groups_.push_back(LegGroup{{}, {}, static_cast<legs::LegType>(type)});
        lane = 0;
      }
      place.group = groups_.size() - 1;
      place.lane = lane++;
      add_leg(mechanism, place, static_cast<int>(k));
    }
    // What is left of the last group: its first leg again, without mass and force.
    for (; lane < kGroup; ++lane) {
      for (int i = 0; i < legs::kMasses; ++i) {
        groups_.back().parameter[i][lane] = groups_.back().parameter[i][0];
      }
    }
  }
  for (const LegPlace& leg : places_) {
    const double (*work)[kGroup] = groups_[leg.group].work;
    for (int i = 0; i < 3; ++i) {
      const int body = leg.form.joint[i].body;
      const bool slides = model.bodies[body].joint == JointType::kPrismatic;
      bool forced = false, needs_angle = false;
      for (const JointForce& law : model.forces) {
        forced = forced || law.body == body;
        needs_angle = needs_angle || (law.body == body && depends_on_place(law));
      }
      if (!slides && !forced) continue;
      needs_angle = needs_angle && !slides;
      angles_[i] = angles_[i] || needs_angle;
      told_.push_back({leg.q[i], leg.v[i], leg.sign[i], leg.form.joint[i].zero,
                       &work[legs::kRate + i][leg.lane],
                       slides ? &work[legs::kSlide][leg.lane] : nullptr,
                       needs_angle ? &work[legs::kAngles + i][leg.lane] : nullptr});
    }
  }
}

void LegKernel::add_leg(const Mechanism& mechanism, LegPlace& place, int k) {
  const MechanismModel& model = mechanism.model;
  const ClosedForm& form = place.form;
  LegGroup& group = groups_[place.group];
  const auto put = [&](int row, double x) { group.parameter[row][place.lane] = x; };
  const auto put_vector = [&](int row, const V& x) {
    for (int i = 0; i < 3; ++i) put(row + i, x[i]);
  };
  const auto put_moments = [&](int row, const Moments& of) {
    const Mat& m = of.inertia;
    const double cells[] = {m(0, 0), m(1, 1), m(2, 2), m(0, 1), m(0, 2), m(1, 2)};
    put(row, of.mass);
    put_vector(row + 1, of.first);
    for (int i = 0; i < 6; ++i) put(row + 4 + i, cells[i]);
  };
  place.ring = model.loops[k].point_on_closing;
  Pose<double> K = form.in_parent;
  V elbow(form.shape.l1, 0.0, form.shape.height), tip = form.shape.tip;
  int axis = form.kind == LegKind::kR2P1R3 ? 1 : 2;  // of the first joint
  if (form.kind == LegKind::kR2P1R3) elbow.setZero();
  if (form.kind == LegKind::kR1R2R3Perpendicular) {  // lanes have its second joint about z
    const Mat& axes = form.in_parent.R;
    K.R << axes.col(2), axes.col(0), axes.col(1);
    elbow = {form.shape.height, form.shape.l1, 0.0};
    tip = {0.0, form.shape.l2, 0.0};
    axis = 0;
  }
  for (int i = 0; i < 3; ++i) put_vector(legs::kAxesK + 3 * i, K.R.col(i));
  put_vector(legs::kCentre, K.p);
  put_vector(legs::kCentreK, K.R.transpose() * K.p);
  put_vector(legs::kRing, place.ring);
  put_vector(legs::kTip, tip);
  put(legs::kElbow, form.branch.elbow);
  put(legs::kFlip, form.branch.flip);
  put(legs::kCrank, form.shape.l1);
  put(legs::kCrank + 1, form.shape.height);
  // The three bodies at canonical coordinates zero, axes K; the outer two about the elbow.
  Pose<double> pose = inverse(K);
  Moments moments[3];
  for (size_t i = 0; i < 3; ++i) {
    const JointMap& joint = form.joint[i];
    const Body& body = model.bodies[joint.body];
    place.q[i] = body.q_index;
    place.v[i] = body.v_index;
    place.sign[i] = joint.sign;
    pose = pose * body.placement;
    // theta = sign q + zero = 0
    if (body.joint == JointType::kRevolute) {
      pose.R = pose.R * axis_rotation<double>(body.axis, joint.c, -joint.sign * joint.s);
    }
    moments[i] = find_moments(body, {pose.R, i == 0 ? pose.p : V(pose.p - elbow)});
    leg_mass_ += body.mass;
  }
  put_moments(legs::kCross, moments[0]);
  put_moments(legs::kTube, moments[1]);
  put_moments(legs::kRod, moments[2]);
  elbow[axis] = 0.0;
  put(legs::kTurned,
      moments[0].inertia(axis, axis) + (moments[1].mass + moments[2].mass) * elbow.squaredNorm());
}

/// Does the last accepted pose lie on the branch for which the kernel was made, well inside?
bool LegKernel::continues(const LoopReference<double>& reference) const {
  if (!reference.valid) return true;
  for (const LegPlace& leg : places_) {
    const size_t b = leg.block;
    if (!(reference.margin[b] >= kLeastReference) ||
        reference.branch[b].elbow != leg.form.branch.elbow ||
        reference.branch[b].flip != leg.form.branch.flip) {
      return false;
    }
  }
  return true;
}

bool LegKernel::calc_legs(bool moving) {
  return functions_.calc_position(groups_.data(), static_cast<int>(groups_.size()), platform_,
                                  moving, margin_, sums_);
}

/// Pose of a free body, on the base or on the vehicle.
void LegKernel::put_pose(const Body& body, int index, TreeData<double>& tree) const {
  Pose<double>& joint = tree.joint[index];
  joint.R = body.placement.R * quat_to_matrix<double>(tree.q.segment<4>(body.q_index + 3));
  joint.p = body.placement.p + body.placement.R * tree.q.segment<3>(body.q_index);
  if (body.parent == kBase) {
    tree.R[index] = joint.R;
    tree.r[index] = joint.p;
    tree.p[index] = joint.p;
  } else {
    tree.R[index] = tree.R[body.parent] * joint.R;
    tree.r[index] = tree.R[body.parent] * joint.p;
    tree.p[index] = tree.p[body.parent] + tree.r[index];
  }
}

bool LegKernel::calc_position(MechanismData<double>& data) {
  const LoopReference<double>& reference = data.loops.reference;
  if (!continues(reference)) return false;
  TreeData<double>& tree = data.tree;
  if (is_free_) put_pose(vehicle_, 0, tree);
  put_pose(ring_, ring_index_, tree);
  const Pose<double>& joint = tree.joint[ring_index_];
  Eigen::Map<Mat>(platform_.R) = joint.R;
  Eigen::Map<V>(platform_.p) = joint.p;
  if (!calc_legs(is_free_)) return false;
  for (int i = 0; i < 3; ++i) {
    if (angles_[i]) functions_.calc_angles(groups_.data(), static_cast<int>(groups_.size()), i);
  }
  for (const ToldJoint& told : told_) {
    double& q = tree.q[told.q];
    if (told.slide) q = *told.slide;
    if (told.angle) {
      const double near = reference.valid ? reference.q[told.q] : q;
      q = add_turns<double>(told.sign * (*told.angle - told.zero), near);
    }
  }
  // The ring's own inertia and that of the legs at their tips, axes and origin of the ring.
  const double m = ring_moments_.mass;
  const Mat h = skew(ring_moments_.first);
  const int at = is_free_ ? 6 : 0;
  MatX<double>& A = data.A_ind;
  const Mat coupling = h + get_columns(sums_ + legs::kSumK);
  A.block<3, 3>(at, at) = m * Mat::Identity() + get_symmetric(sums_ + legs::kSumA);
  A.block<3, 3>(at + 3, at) = coupling;
  A.block<3, 3>(at, at + 3) = coupling.transpose();
  A.block<3, 3>(at + 3, at + 3) = ring_moments_.inertia + get_symmetric(sums_ + legs::kSumD);
  if (is_free_) {
    // Vehicle, ring and legs as one body; what the relative motion of the ring carries.
    const Mat& R = joint.R;
    const V hR = R * ring_moments_.first;
    const double mass = vehicle_moments_.mass + leg_mass_ + m;
    const V first = vehicle_moments_.first + get_vector(sums_ + legs::kSumH) + hR + m * joint.p;
    const Mat mixed = joint.p * (hR + 0.5 * m * joint.p).transpose();
    A.block<3, 3>(0, 0) = mass * Mat::Identity();
    A.block<3, 3>(3, 0) = skew(first);
    A.block<3, 3>(0, 3) = -skew(first);
    A.block<3, 3>(3, 3) = vehicle_moments_.inertia + get_symmetric(sums_ + legs::kSumJ) +
                          R * ring_moments_.inertia * R.transpose() +
                          2.0 * mixed.trace() * Mat::Identity() - mixed - mixed.transpose();
    A.block<6, 6>(0, 6) = find_carried();
    A.block<6, 6>(6, 0) = A.block<6, 6>(0, 6).transpose();
    tree.m_sum[0] = mass;
    tree.h_sum[0] = tree.R[0] * first;
  }
  data.factor.compute(A);
  return data.factor.info() == Eigen::Success;
}

void LegKernel::calc_velocity(const BaseMotion<double>& base, MechanismData<double>& data) {
  TreeData<double>& tree = data.tree;
  const int i = ring_index_;
  const V v = tree.v.segment<3>(ring_.v_index), w = tree.v.segment<3>(ring_.v_index + 3);
  Eigen::Map<V>(platform_.v) = v;
  Eigen::Map<V>(platform_.w) = w;
  V root = base.w, root_w = base.w, root_u = V::Zero();
  if (is_free_) {
    root = tree.v.segment<3>(3) + tree.R[0].transpose() * base.w;
    root_w = tree.R[0] * root;
    root_u = tree.R[0] * tree.v.head<3>() + base.w.cross(tree.r[0]);
    tree.w[0] = root_w;
    tree.u[0] = root_u;
  }
  Eigen::Map<V>(platform_.root) = root;
  tree.w[i] = root_w + tree.R[i] * w;
  tree.u[i] = root_u + root_w.cross(tree.r[i]) + tree.R[i] * v;
  functions_.calc_rates(groups_.data(), static_cast<int>(groups_.size()), platform_);
  for (const ToldJoint& told : told_) tree.v[told.v] = told.sign * *told.rate;
}

void LegKernel::calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) {
  TreeData<double>& tree = data.tree;
  for (const LegPlace& leg : places_) {
    double (*force)[kGroup] = groups_[leg.group].work + legs::kForce;
    for (int j = 0; j < 3; ++j) force[j][leg.lane] = leg.sign[j] * data.tau[leg.v[j]];
  }
  // Acceleration of the root's origin less gravity, and its angular acceleration, axes of P, as far
  // as they are known.
  const V root = Eigen::Map<const V>(platform_.root);
  root_a_ = base.a - base.gravity;
  root_alpha_ = base.alpha;
  if (is_free_) {
    const Mat& RV = tree.R[0];
    const V v = tree.v.head<3>(), w = tree.v.segment<3>(3), base_w = RV.transpose() * base.w;
    const V arm = RV.transpose() * tree.r[0];
    root_a_ = RV.transpose() * (root_a_ + base.alpha.cross(tree.r[0])) +
              base_w.cross(base_w.cross(arm)) + 2.0 * base_w.cross(v) + w.cross(v);
    root_alpha_ = RV.transpose() * base.alpha + base_w.cross(w);
  }
  const bool moving =
      is_free_ || !root_a_.isZero(0.0) || !root_alpha_.isZero(0.0) || !root.isZero(0.0);
  if (moving && !is_free_) calc_legs(true);  // what it carries was not needed before
  functions_.calc_bias(groups_.data(), static_cast<int>(groups_.size()), platform_, moving, bias_);
  const Mat& R = tree.joint[ring_index_].R;
  const V& r = tree.joint[ring_index_].p;
  const Wrench<double> ring = find_ring_load(V::Zero(), V::Zero(), V::Zero(), V::Zero());
  const Mat& RC = tree.R[ring_index_];
  const Wrench<double>& load = tree.external[ring_index_];
  VecX<double>& x = data.a_ind;
  const int at = is_free_ ? 6 : 0;
  const V force = RC.transpose() * load.f - ring.f, moment = RC.transpose() * load.t - ring.t;
  x.segment<3>(at) = force - get_vector(bias_ + legs::kSumTipForce);
  x.segment<3>(at + 3) = moment - get_vector(bias_ + legs::kSumTipMoment);
  if (is_free_) {
    const Mat& RV = tree.R[0];
    const Wrench<double>& on_vehicle = tree.external[0];
    const Moments& own = vehicle_moments_;
    const V push = R * force;
    x.head<3>() = RV.transpose() * on_vehicle.f + push - root.cross(root.cross(own.first)) -
                  get_vector(bias_ + legs::kSumRootForce);
    x.segment<3>(3) = RV.transpose() * on_vehicle.t + R * moment + r.cross(push) -
                      root.cross(V(own.inertia * root)) - get_vector(bias_ + legs::kSumRootMoment);
    x.noalias() -= data.A_ind.leftCols<3>().lazyProduct(root_a_);
    x.noalias() -= data.A_ind.middleCols<3>(3).lazyProduct(root_alpha_);
  } else if (moving) {
    Vec6<double> root_acceleration;
    root_acceleration << root_a_, root_alpha_;
    x -= find_carried().transpose() * root_acceleration;
  }
  data.factor.solveInPlace(x);
  if (is_free_) data.vdot.head<6>() = x.head<6>();
  data.vdot.segment<6>(ring_.v_index) = x.segment<6>(at);
}

/// Momentum of ring and legs, linear and angular about P, axes of P, per velocity of the ring,
/// linear and angular, C. @pre calc_legs(true)
Mat6<double> LegKernel::find_carried() const {
  const Mat R = get_columns(platform_.R), Rh = R * skew(ring_moments_.first);
  const Mat lever = skew(get_vector(platform_.p));
  const double m = ring_moments_.mass;
  Mat6<double> carried;
  carried.topLeftCorner<3, 3>() = m * R + get_rows(sums_ + legs::kSumLV);
  carried.topRightCorner<3, 3>() = get_rows(sums_ + legs::kSumLW) - Rh;
  carried.bottomLeftCorner<3, 3>() = get_rows(sums_ + legs::kSumAV) + m * lever * R + Rh;
  carried.bottomRightCorner<3, 3>() =
      get_rows(sums_ + legs::kSumAW) - lever * Rh + R * ring_moments_.inertia;
  return carried;
}

/// What moves the ring, about its origin, C. @param a0, alpha0  of the root, P
Wrench<double> LegKernel::find_ring_load(const V& a0, const V& alpha0, const V& vdot,
                                         const V& wdot) const {
  const Mat R = get_columns(platform_.R);
  const V r = get_vector(platform_.p), v = get_vector(platform_.v), w = get_vector(platform_.w);
  const V root = get_vector(platform_.root), rootC = R.transpose() * root, wC = rootC + w;
  const V a = R.transpose() * V(a0 + alpha0.cross(r) + root.cross(root.cross(r))) +
              2.0 * rootC.cross(v) + w.cross(v) + vdot;
  const V alpha = R.transpose() * alpha0 + rootC.cross(w) + wdot;
  const Moments& own = ring_moments_;
  return {own.mass * a + alpha.cross(own.first) + wC.cross(wC.cross(own.first)),
          own.first.cross(a) + own.inertia * alpha + wC.cross(V(own.inertia * wC))};
}

void LegKernel::calc_reactions(const BaseMotion<double>&, MechanismData<double>& data) {
  TreeData<double>& tree = data.tree;
  const V vdot = data.vdot.segment<3>(ring_.v_index),
          wdot = data.vdot.segment<3>(ring_.v_index + 3);
  V a = root_a_, alpha = root_alpha_;
  if (is_free_) {
    a += data.vdot.head<3>();
    alpha += data.vdot.segment<3>(3);
  }
  legs::Accelerations at;
  Eigen::Map<V>(at.v) = vdot;
  Eigen::Map<V>(at.w) = wdot;
  Eigen::Map<V>(at.a) = a;
  Eigen::Map<V>(at.alpha) = alpha;
  double sums[legs::kLoadSums];
  functions_.calc_loads(groups_.data(), static_cast<int>(groups_.size()), platform_, at, sums);
  for (const LegPlace& leg : places_) {
    VecX<double>& lambda = data.loops.block[leg.block].lambda;
    for (int i = 0; i < 3; ++i) lambda[i] = get_work(leg, legs::kCut + i);
  }
  const Wrench<double> ring = find_ring_load(a, alpha, vdot, wdot);
  const Mat& R = tree.joint[ring_index_].R;
  const Mat& RC = tree.R[ring_index_];
  const V& r = tree.joint[ring_index_].p;
  const Wrench<double>& load = tree.external[ring_index_];
  const V push = R * V(RC.transpose() * load.f - ring.f);
  Wrench<double>& on_base = data.on_base;
  on_base.f = push - get_vector(sums + legs::kSumLoad);
  on_base.t = R * V(RC.transpose() * load.t - ring.t) + r.cross(push) -
              get_vector(sums + legs::kSumLoadMoment);
  if (!is_free_) return;
  on_base = {tree.R[0] * on_base.f, tree.R[0] * on_base.t};
  tree.a[0] = tree.R[0] * a;
  tree.alpha[0] = tree.R[0] * alpha;
}

V LegKernel::find_linear_momentum() const {
  Vec6<double> velocity;
  velocity << get_vector(platform_.v), get_vector(platform_.w);
  return find_carried().topRows<3>() * velocity;
}

double LegKernel::find_margin(const LegPlace& leg) const {
  return std::sqrt(get_work(leg, legs::kReach) / get_work(leg, legs::kReach + 1));
}

double LegKernel::find_margin() const {
  double margin = 1.0;
  for (const LegPlace& leg : places_) margin = std::min(margin, find_margin(leg));
  return margin;
}

void LegKernel::keep_reference(MechanismData<double>& data) const {
  LoopReference<double>& reference = data.loops.reference;
  TreeData<double>& tree = data.tree;
  for (const LegPlace& leg : places_) {
    const ClosedForm& form = leg.form;
    LegSolution<double> solution;
    solution.slide = get_work(leg, legs::kSlide);
    for (int i = 0; i < 3; ++i) {
      solution.c[i] = get_work(leg, legs::kTurns + 2 * i);
      solution.s[i] = get_work(leg, legs::kTurns + 2 * i + 1);
      if (form.kind == LegKind::kR2P1R3 && i == 2) continue;
      double c, s;
      find_joint_angle(form.joint[i], solution.c[i], solution.s[i], c, s);
      double& q = tree.q[leg.q[i]];
      q = find_angle(c, s, reference.valid ? reference.q[leg.q[i]] : q);
    }
    // v_dep = H v_low with the six velocities of the ring for v_low.
    Mat axes, rows;  // E in C; inverse of the loop matrix by columns
    for (int i = 0; i < 9; ++i) {
      axes(i % 3, i / 3) = get_work(leg, legs::kAxesC + i);
      rows(i % 3, i / 3) = get_work(leg, legs::kInverse + i);
    }
    for (int i = 0; i < 3; ++i) {
      const V row = leg.sign[i] * (axes * rows.col(i));
      reference.H[leg.block].row(form.joint[i].row) << row.transpose(),
          leg.ring.cross(row).transpose();
    }
    reference.margin[leg.block] = find_margin(leg);
    reference.branch[leg.block] = form.branch;
    reference.spin_branch[leg.block] = 1;
    reference.sign[leg.block] = find_leg_sign(form.kind, form.shape, solution);
  }
  reference.q = tree.q;
  reference.valid = true;
}

/// Does a leg of a kind that lanes know hang on the root and hold the ring?
bool is_leg(const Mechanism& mechanism, int k, int root, int ring) {
  const MechanismModel& model = mechanism.model;
  const Loop& loop = model.loops[k];
  const int b = mechanism.plan.block_of_loop[k];
  if (b < 0 || mechanism.plan.blocks[b].loops.size() != 1) return false;
  const LoopBlock& block = mechanism.plan.blocks[b];
  const int first = model.bodies[ring].v_index;
  if (block.low != std::vector<int>{first, first + 1, first + 2, first + 3, first + 4, first + 5}) {
    return false;
  }
  const ClosedForm* form = block.form();
  if (!form || !form->has_inverse()) return false;
  int parent = root;
  for (const JointMap& joint : form->joint) {
    if (model.bodies[joint.body].parent != parent) return false;
    parent = joint.body;
  }
  return parent == loop.terminal && loop.closing == ring;
}

}  // namespace

std::shared_ptr<MechanismKernel> make_leg_kernel(const Mechanism& mechanism, int widest) {
  const MechanismModel& model = mechanism.model;
  const std::vector<int>& ind = mechanism.plan.ind_bodies;
  if (model.loops.empty() || mechanism.plan.is_driven || ind.empty() || ind.size() > 2) return {};
  // A ring on the base, or on a vehicle on the base; and legs between the two, nothing else.
  const bool is_free = ind.size() == 2;
  if (is_free && ind[0] != 0) return {};
  const int root = is_free ? 0 : kBase;
  for (int i : ind) {
    if (model.bodies[i].joint != JointType::kFree) return {};
    if (model.bodies[i].parent != (i == ind.back() ? root : kBase)) return {};
  }
  if (model.bodies.size() != ind.size() + 3 * model.loops.size()) return {};
  for (size_t k = 0; k < model.loops.size(); ++k) {
    if (!is_leg(mechanism, static_cast<int>(k), root, ind.back())) return {};
  }
  // Loads act on the ring and on the root only, and where they act must be found.
  const int captured = model.capture_body;
  if (captured != kBase && captured != root && captured != ind.back()) return {};
  return std::make_shared<LegKernel>(mechanism, legs::find_leg_functions(widest));
}

}  // namespace dockloop
