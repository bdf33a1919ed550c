// Set-up and assembly of a ring on slide legs; see leg_kernel.hpp.
#include "kernels/leg_kernel.hpp"

#include <algorithm>

#include "kernels/leg_lanes.hpp"

namespace dockloop {
namespace {

using legs::kGroup;
using legs::LegGroup;
using V = Vec3<double>;
using Mat = Mat3<double>;

constexpr double kLeastMargin = 0.1;     ///< below, the general code watches branches [-]
constexpr double kLeastReference = 0.3;  ///< the same for the last accepted pose

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

/// One joint of a leg.
struct LegJoint {
  int q = 0, v = 0;
  double sign = 1.0;
};

struct LegPlace {
  LegJoint joint[3];
  int block = 0;
  LegBranch branch;
};

class LegKernel : public MechanismKernel {
 public:
  LegKernel(const Mechanism& mechanism, const legs::LegFunctions& functions);

  bool calc_position(MechanismData<double>& data) override;
  void calc_velocity(const BaseMotion<double>& base, MechanismData<double>& data) override;
  void calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) override;

 private:
  void add_leg(const Mechanism& mechanism, int loop, int lane);
  bool continues(const LoopReference<double>& reference) const;
  bool calc_legs(bool moving);
  void put_pose(const Body& body, int index, TreeData<double>& tree) const;

  const legs::LegFunctions& functions_;
  std::vector<LegPlace> places_;
  std::vector<LegGroup> groups_;
  Body ring_, vehicle_;
  int ring_index_ = 0;
  bool is_free_ = false;  ///< the root is a vehicle
  double margin_ = kLeastMargin;
  Moments ring_moments_, vehicle_moments_;
  double leg_mass_ = 0.0;
  legs::Platform platform_{};
  double sums_[legs::kPositionSums] = {}, bias_[legs::kBiasSums] = {};
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
  const int count = static_cast<int>(model.loops.size());
  places_.resize(model.loops.size());
  groups_.resize((model.loops.size() + kGroup - 1) / kGroup);
  for (LegGroup& group : groups_) group = LegGroup{};
  for (int k = 0; k < count; ++k) add_leg(mechanism, k, k);
  // What is left of the last group: the first leg again, without mass and force.
  for (int lane = count; lane < static_cast<int>(groups_.size()) * kGroup; ++lane) {
    for (int i = 0; i < legs::kCross; ++i) {
      groups_[lane / kGroup].parameter[i][lane % kGroup] = groups_[0].parameter[i][0];
    }
  }
}

void LegKernel::add_leg(const Mechanism& mechanism, int k, int lane) {
  const MechanismModel& model = mechanism.model;
  const Loop& loop = model.loops[k];
  LegPlace& place = places_[k];
  place.block = mechanism.plan.block_of_loop[k];
  const ClosedForm& form = *mechanism.plan.blocks[place.block].form();
  place.branch = form.branch;
  LegGroup& group = groups_[lane / kGroup];
  const int at = lane % kGroup;
  const auto put = [&](int row, double x) { group.parameter[row][at] = x; };
  const auto put_vector = [&](int row, const V& x) {
    for (int i = 0; i < 3; ++i) put(row + i, x[i]);
  };
  const auto put_symmetric = [&](int row, const Mat& m) {
    const double cells[] = {m(0, 0), m(1, 1), m(2, 2), m(0, 1), m(0, 2), m(1, 2)};
    for (int i = 0; i < 6; ++i) put(row + i, cells[i]);
  };
  const Pose<double>& K = form.in_parent;
  for (int i = 0; i < 3; ++i) put_vector(legs::kAxesK + 3 * i, K.R.col(i));
  put_vector(legs::kCentre, K.p);
  put_vector(legs::kCentreK, K.R.transpose() * K.p);
  put_vector(legs::kRing, loop.point_on_closing);
  put_vector(legs::kTip, form.shape.tip);
  put(legs::kElbow, form.branch.elbow);
  put(legs::kFlip, form.branch.flip);
  // The three bodies at canonical coordinates zero, axes K at the centre.
  Pose<double> pose = inverse(K);
  Moments moments[3];
  for (int i = 0; i < 3; ++i) {
    const JointMap& joint = form.joint[static_cast<size_t>(i)];
    const Body& body = model.bodies[joint.body];
    place.joint[i] = {body.q_index, body.v_index, static_cast<double>(joint.sign)};
    pose = pose * body.placement;
    // theta = sign q + zero = 0
    if (body.joint == JointType::kRevolute) {
      pose.R = pose.R * axis_rotation<double>(body.axis, joint.c, -joint.sign * joint.s);
    }
    moments[i] = find_moments(body, pose);
    leg_mass_ += body.mass;
  }
  put(legs::kCross, moments[0].mass);
  put_vector(legs::kCross + 1, moments[0].first);
  put_symmetric(legs::kCross + 4, moments[0].inertia);
  put_vector(legs::kTube, moments[1].first);
  put_symmetric(legs::kTube + 3, moments[1].inertia);
  put(legs::kTubeMass, moments[1].mass);
  put(legs::kRod, moments[2].mass);
  put_vector(legs::kRod + 1, moments[2].first);
  put_symmetric(legs::kRod + 4, moments[2].inertia);
}

/// Does the last accepted pose lie on the branch for which the kernel was made, well inside?
bool LegKernel::continues(const LoopReference<double>& reference) const {
  if (!reference.valid) return true;
  for (const LegPlace& place : places_) {
    const size_t b = static_cast<size_t>(place.block);
    if (!(reference.margin[b] >= kLeastReference) ||
        reference.branch[b].elbow != place.branch.elbow ||
        reference.branch[b].flip != place.branch.flip) {
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
  if (!continues(data.loops.reference)) return false;
  TreeData<double>& tree = data.tree;
  if (is_free_) put_pose(vehicle_, 0, tree);
  put_pose(ring_, ring_index_, tree);
  const Pose<double>& joint = tree.joint[ring_index_];
  Eigen::Map<Mat>(platform_.R) = joint.R;
  Eigen::Map<V>(platform_.p) = joint.p;
  if (!calc_legs(is_free_)) return false;
  for (size_t k = 0; k < places_.size(); ++k) {
    const LegJoint& slide = places_[k].joint[2];
    tree.q[slide.q] = slide.sign * groups_[k / kGroup].work[legs::kSlide][k % kGroup];
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
    const Mat Rh = R * h, lever = skew(joint.p);
    A.block<3, 3>(0, 6) = m * R + get_rows(sums_ + legs::kSumLV);
    A.block<3, 3>(0, 9) = get_rows(sums_ + legs::kSumLW) - Rh;
    A.block<3, 3>(3, 6) = get_rows(sums_ + legs::kSumAV) + m * lever * R + Rh;
    A.block<3, 3>(3, 9) =
        get_rows(sums_ + legs::kSumAW) - lever * Rh + R * ring_moments_.inertia;
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
  for (size_t k = 0; k < places_.size(); ++k) {
    const LegJoint& slide = places_[k].joint[2];
    tree.v[slide.v] = slide.sign * groups_[k / kGroup].work[legs::kRate + 2][k % kGroup];
  }
}

void LegKernel::calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) {
  TreeData<double>& tree = data.tree;
  for (size_t k = 0; k < places_.size(); ++k) {
    double(*force)[kGroup] = groups_[k / kGroup].work + legs::kForce;
    for (int j = 0; j < 3; ++j) {
      const LegJoint& joint = places_[k].joint[j];
      force[j][k % kGroup] = joint.sign * data.tau[joint.v];
    }
  }
  // Acceleration of the root's origin less gravity, and its angular acceleration, axes of P, as far
  // as they are known.
  const V w = Eigen::Map<const V>(platform_.w), v = Eigen::Map<const V>(platform_.v);
  const V root = Eigen::Map<const V>(platform_.root);
  V a0 = base.a - base.gravity, alpha0 = base.alpha;
  const bool moving = is_free_ || !a0.isZero(0.0) || !alpha0.isZero(0.0) || !root.isZero(0.0);
  if (moving && !is_free_) calc_legs(true);  // what it carries was not needed before
  functions_.calc_bias(groups_.data(), static_cast<int>(groups_.size()), platform_, moving, bias_);
  const Mat& R = tree.joint[ring_index_].R;
  const V r = tree.joint[ring_index_].p;
  const V rootC = R.transpose() * root;
  const V wC = rootC + w;
  V a = w.cross(v), alpha = V::Zero();
  if (moving) {
    a += R.transpose() * root.cross(root.cross(r)) + 2.0 * rootC.cross(v);
    alpha = rootC.cross(w);
  }
  const V& h = ring_moments_.first;
  const V ring_force = ring_moments_.mass * a + alpha.cross(h) + wC.cross(wC.cross(h));
  const V ring_moment = h.cross(a) + ring_moments_.inertia * alpha +
                        wC.cross(V(ring_moments_.inertia * wC));
  const Mat& RC = tree.R[ring_index_];
  const Wrench<double>& load = tree.external[ring_index_];
  VecX<double>& x = data.a_ind;
  const int at = is_free_ ? 6 : 0;
  x.segment<3>(at) =
      RC.transpose() * load.f - ring_force - get_vector(bias_ + legs::kSumTipForce);
  x.segment<3>(at + 3) =
      RC.transpose() * load.t - ring_moment - get_vector(bias_ + legs::kSumTipMoment);
  if (is_free_) {
    const Mat& RV = tree.R[0];
    const V vV = tree.v.head<3>(), wV = tree.v.segment<3>(3);
    // The known part of the vehicle's acceleration, as if the base were a third body.
    const V base_w = RV.transpose() * base.w;
    const V arm = RV.transpose() * tree.r[0];
    alpha0 = RV.transpose() * alpha0 + base_w.cross(wV);
    a0 = RV.transpose() * (base.a - base.gravity + base.alpha.cross(tree.r[0])) +
         base_w.cross(base_w.cross(arm)) + 2.0 * base_w.cross(vV) + wV.cross(vV);
    const V& hV = vehicle_moments_.first;
    const V force = root.cross(root.cross(hV)), moment = root.cross(V(vehicle_moments_.inertia * root));
    const V ring_push = R * ring_force;
    const Wrench<double>& on_vehicle = tree.external[0];
    x.head<3>() = RV.transpose() * on_vehicle.f + R * (RC.transpose() * load.f) - force - ring_push -
                  get_vector(bias_ + legs::kSumRootForce);
    x.segment<3>(3) = RV.transpose() * on_vehicle.t + R * (RC.transpose() * load.t) +
                      r.cross(V(R * (RC.transpose() * load.f))) - moment - R * ring_moment -
                      r.cross(ring_push) - get_vector(bias_ + legs::kSumRootMoment);
    x -= data.A_ind.leftCols<3>() * a0;
    x -= data.A_ind.middleCols<3>(3) * alpha0;
  } else if (moving) {
    // Momentum of legs and ring per acceleration of the base, seen by the ring: transposed.
    const Mat Rh = R * skew(h), lever = skew(r);
    const double m = ring_moments_.mass;
    const Mat LV = m * R + get_rows(sums_ + legs::kSumLV);
    const Mat LW = get_rows(sums_ + legs::kSumLW) - Rh;
    const Mat AV = get_rows(sums_ + legs::kSumAV) + m * lever * R + Rh;
    const Mat AW = get_rows(sums_ + legs::kSumAW) - lever * Rh + R * ring_moments_.inertia;
    x.head<3>() -= LV.transpose() * a0 + AV.transpose() * alpha0;
    x.segment<3>(3) -= LW.transpose() * a0 + AW.transpose() * alpha0;
  }
  data.factor.solveInPlace(x);
  if (is_free_) data.vdot.head<6>() = x.head<6>();
  data.vdot.segment<6>(ring_.v_index) = x.segment<6>(at);
}

bool is_slide_leg(const Mechanism& mechanism, int k, int root, int ring) {
  const MechanismModel& model = mechanism.model;
  const Loop& loop = model.loops[k];
  const int b = mechanism.plan.block_of_loop[k];
  if (b < 0 || mechanism.plan.blocks[b].loops.size() != 1) return false;
  const ClosedForm* form = mechanism.plan.blocks[b].form();
  if (!form || form->kind != LegKind::kR2P1R3 || form->spin) return false;
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
    if (!is_slide_leg(mechanism, static_cast<int>(k), root, ind.back())) return {};
  }
  for (const JointForce& force : model.forces) {  // turns of the legs are not found
    if (model.bodies[force.body].joint != JointType::kPrismatic) return {};
  }
  return std::make_shared<LegKernel>(mechanism, legs::find_leg_functions(widest));
}

}  // namespace dockloop
