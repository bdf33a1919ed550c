// Gears: bodies that turn with joints of legs (LegGear), for any scalar. LEGS.md derives the
// formulas.
//
// The inertia of a gear is the same at every angle. Frozen it is a part of its carrier; what turns
// is a momentum along a fixed axis. Gears on tube or rod are constants of their leg (legs::kSpin).
// The functions below add the gears on the root to the sums over legs, and find what the couplings
// of all gears transmit.
#pragma once

#include "loops/leg_store_body.hpp"
#include "loops/loops.hpp"

namespace dockloop {
namespace {

/// Rate of a joint of a leg per twist of the platform.
template <class S>
Vec6<S> find_rate_per_twist(const PlatformData<S>& at, const LegPlace& leg, int joint) {
  Mat3<S> axes;  // E in C
  Vec3<S> row;   // of the inverse of the loop matrix
  for (int i = 0; i < 9; ++i) axes(i % 3, i / 3) = at.store.work(leg, legs::kAxesC + i);
  for (int i = 0; i < 3; ++i) row[i] = at.store.work(leg, legs::kInverse + 3 * joint + i);
  const Vec3<S> force = S(leg.sign[joint]) * (axes * row);
  Vec6<S> rate;
  rate << force, cast<S>(leg.ring).cross(force);
  return rate;
}

/// @pre calc_rates
template <class S>
S find_joint_rate(const PlatformData<S>& at, const LegPlace& leg, int i) {
  return S(leg.sign[i]) * at.store.work(leg, legs::kRate + i);
}

/// Sum over the terms of a gear. @param get  value of a joint of a leg
template <class S, class Get>
S find_gear_sum(const PlatformData<S>& at, const GearData<S>& gear, const Get& get) {
  S sum(0);
  for (const auto& term : gear.terms) sum += S(term.ratio) * get(at.legs[term.leg], term.joint);
  return sum;
}

/// @pre coordinates of the joints of its legs
template <class S>
void put_gear_coordinate(const PlatformData<S>& at, const GearData<S>& gear, TreeData<S>& tree) {
  tree.q[gear.q] = S(gear.constant) + find_gear_sum(at, gear, [&](const LegPlace& leg, int i) {
                     return tree.q[leg.q[i]];
                   });
}

template <class S>
S find_gear_rate(const PlatformData<S>& at, const GearData<S>& gear) {
  return find_gear_sum(at, gear,
                       [&](const LegPlace& leg, int i) { return find_joint_rate(at, leg, i); });
}

/// Acceleration of a joint of a leg while the twist of the platform rests. @pre calc_bias
template <class S>
S find_free_acceleration(const PlatformData<S>& at, const LegPlace& leg, int i) {
  S sum(0);
  for (int j = 0; j < 3; ++j) {
    sum += at.store.work(leg, legs::kInverse + 3 * i + j) * at.store.work(leg, legs::kTipFree + j);
  }
  return S(leg.sign[i]) * sum;
}

/// What accelerates the gears on the root, as torques of their joints.
template <class S>
void calc_train_torques(GearTrain<S>& train) {
  for (size_t i = 0; i < train.joints.size(); ++i) {
    S torque(0);
    for (size_t j = 0; j < train.joints.size(); ++j) {
      torque += train.inertia[i][j] * train.joints[j].acceleration;
    }
    train.joints[i].torque = torque;
  }
}

/// @pre positions of the legs
template <class S>
void calc_train_rows(PlatformData<S>& at) {
  std::vector<typename GearTrain<S>::Joint>& joints = at.train.joints;
  for (auto& joint : joints) {
    joint.row = find_rate_per_twist(at, at.legs[joint.leg], joint.joint);
  }
  for (size_t i = 0; i < joints.size(); ++i) {
    Vec6<S> pressed = Vec6<S>::Zero();
    for (size_t j = 0; j < joints.size(); ++j) pressed += at.train.inertia[i][j] * joints[j].row;
    joints[i].pressed = pressed;
  }
}

/// What the gears on the root add to the sums over legs. @param moving  also what R carries
template <class S>
void add_train_inertia(const GearTrain<S>& train, bool moving, S* sums) {
  const auto add_symmetric = [&](int at, const Vec3<S>& x, const Vec3<S>& y) {
    const S cells[] = {x[0] * y[0], x[1] * y[1], x[2] * y[2],
                       x[0] * y[1], x[0] * y[2], x[1] * y[2]};
    for (int i = 0; i < 6; ++i) sums[at + i] += cells[i];
  };
  for (const auto& joint : train.joints) {
    const Vec3<S> v = joint.row.template head<3>(), w = joint.row.template tail<3>();
    const Vec3<S> t = joint.pressed.template tail<3>();
    add_symmetric(legs::kSumA, v, joint.pressed.template head<3>());
    add_symmetric(legs::kSumD, w, t);
    for (int i = 0; i < 9; ++i) sums[legs::kSumK + i] += t[i % 3] * v[i / 3];
    if (!moving) continue;
    for (int i = 0; i < 9; ++i) {
      sums[legs::kSumAV + i] += joint.momentum[i / 3] * v[i % 3];
      sums[legs::kSumAW + i] += joint.momentum[i / 3] * w[i % 3];
    }
  }
  if (!moving) return;
  const Vec6<S> cells = get_components(train.frozen);
  for (int i = 0; i < 3; ++i) sums[legs::kSumH + i] += train.first_moment[i];
  for (int i = 0; i < 6; ++i) sums[legs::kSumJ + i] += cells[i];
}

/// Positions of the legs and all sums of the platform.
template <class S>
bool calc_position_sums(PlatformData<S>& at, bool moving, double least) {
  if (!at.store.calc_position(at.motion, moving, least, at.sums.data())) return false;
  if (at.train.joints.empty()) return true;
  calc_train_rows(at);
  add_train_inertia(at.train, moving, at.sums.data());
  return true;
}

/// What moves the gears on a root that does not accelerate, about the origin of R, R.
/// @pre accelerations of their joints
template <class S>
Wrench<S> find_train_load(const PlatformData<S>& at) {
  const GearTrain<S>& train = at.train;
  const Vec3<S> w = as_vector(at.motion.root);
  Vec3<S> momentum = train.frozen * w, moment = Vec3<S>::Zero();
  for (const auto& joint : train.joints) {
    momentum += find_joint_rate(at, at.legs[joint.leg], joint.joint) * joint.momentum;
    moment += joint.acceleration * joint.momentum;
  }
  return {w.cross(w.cross(train.first_moment)), w.cross(momentum) + moment};
}

/// Loads of the gears on the root at zero joint accelerations, into the sums of bias.
template <class S>
void add_train_bias(bool moving, PlatformData<S>& at) {
  if (at.train.joints.empty()) return;
  for (auto& joint : at.train.joints) {
    joint.acceleration = find_free_acceleration(at, at.legs[joint.leg], joint.joint);
  }
  calc_train_torques(at.train);
  for (const auto& joint : at.train.joints) {
    as_vector(&at.bias[legs::kSumTipForce]) += joint.torque * joint.row.template head<3>();
    as_vector(&at.bias[legs::kSumTipMoment]) += joint.torque * joint.row.template tail<3>();
  }
  if (!moving) return;
  const Wrench<S> load = find_train_load(at);
  as_vector(&at.bias[legs::kSumRootForce]) += load.f;
  as_vector(&at.bias[legs::kSumRootMoment]) += load.t;
}

/// A torque on the joint of a gear, onto the joints of legs that turn the gear.
template <class S>
void press_legs(const GearData<S>& gear, const S& torque, PlatformData<S>& at) {
  for (const auto& term : gear.terms) {
    const LegPlace& leg = at.legs[term.leg];
    at.store.work(leg, legs::kForce + term.joint) += S(leg.sign[term.joint] * term.ratio) * torque;
  }
}

/// Loads of legs and gears at the accelerations of at.motion; the legs feel the gears on the root.
template <class S>
void calc_load_sums(PlatformData<S>& at, std::array<S, legs::kLoadSums>& sums) {
  const Vec3<S> a = as_vector(at.motion.root_a), alpha = as_vector(at.motion.root_alpha);
  for (size_t k = 0; k < at.legs.size() && !at.gears.empty(); ++k) {
    for (int i = 0; i < 3; ++i) at.force[k][i] = at.store.work(at.legs[k], legs::kForce + i);
  }
  GearTrain<S>& train = at.train;
  for (auto& joint : train.joints) {
    joint.acceleration = find_free_acceleration(at, at.legs[joint.leg], joint.joint) +
                         joint.row.template head<3>().dot(as_vector(at.motion.dot_v)) +
                         joint.row.template tail<3>().dot(as_vector(at.motion.dot_w));
  }
  calc_train_torques(train);
  for (const auto& joint : train.joints) {
    const LegPlace& leg = at.legs[joint.leg];
    at.store.work(leg, legs::kForce + joint.joint) -=
        S(leg.sign[joint.joint]) * (joint.torque + joint.momentum.dot(alpha));
  }
  at.store.calc_loads(at.motion, sums.data());
  for (size_t k = 0; k < at.legs.size() && !at.gears.empty(); ++k) {
    for (int i = 0; i < 3; ++i) at.store.work(at.legs[k], legs::kForce + i) = at.force[k][i];
  }
  if (train.joints.empty()) return;
  const Wrench<S> load = find_train_load(at);
  as_vector(&sums[legs::kSumLoad]) += load.f + train.mass * a + alpha.cross(train.first_moment);
  as_vector(&sums[legs::kSumLoadMoment]) +=
      load.t + train.frozen * alpha + train.first_moment.cross(a);
}

/// Forces of the couplings of gears, last first: a gear also turns those that name it.
/// @pre calc_load_sums
template <class S>
void calc_gear_forces(const PlatformData<S>& at, LoopData<S>& loops) {
  for (auto gear = at.gears.rbegin(); gear != at.gears.rend(); ++gear) {
    const S along =
        gear->on_root ? S(gear->axis.dot(as_vector(at.motion.root_alpha)))
                      : S(gear->axis[0] * at.store.work(at.legs[gear->terms[0].leg], legs::kAlong));
    const S turning = find_gear_sum(at, *gear, [&](const LegPlace& leg, int i) {
      return S(S(leg.sign[i]) * at.store.work(leg, legs::kJoint + i));
    });
    S torque = gear->inertia * (turning + along) - gear->torque;
    for (const auto& user : gear->users) {
      torque -= S(user.factor) * loops.block[at.gears[user.gear].block].lambda[0];
    }
    loops.block[gear->block].lambda[0] = torque / S(gear->factor);
  }
}

}  // namespace
}  // namespace dockloop
